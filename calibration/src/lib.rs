//! From what was recorded to what it means: linear rates, calibrated light curves, materials, fits.
//! Stands on `sunglint-simulator`.
//!
//! Nothing is here yet. What will stand here, in the order in which data flows through it:
//!
//! - `detector`: dead time and other non-linearity, inverted with its uncertainty;
//! - `photometry`: masks, detection, centroids, apertures, backgrounds;
//! - `alignment`: the fibre's field on the camera image;
//! - `stars`: the night's coefficient per channel from stars;
//! - `brdf`: from retro-reflection to a measured material, and parametric fits;
//! - `pass`: the fit of a measured pass by a simulated one.
