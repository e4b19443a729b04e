//! What a satellite pass should look like in every spectral channel. Stands on `sunglint-radiometry`.
//!
//! Nothing is here yet. What will stand here, in the order in which data flows through it:
//!
//! - `orbit`: TLE, SGP4, TEME to ITRS to GCRS, light time, eclipse;
//! - `attitude`: inertial, spinning, tumbling, orbit-following bodies and sun-tracking panels;
//! - `mesh`: OBJ, PLY, STL, glTF and built-in bodies, their parts and faults;
//! - `surface`: Lambert, microfacet, measured and parametric materials;
//! - `light`: the engines, from the exact polygons of planar facets to inter-reflection, and the scene's own report;
//! - `ranging`: lasers, photons per shot, range histograms;
//! - `observatory`: photon events, frames, the virtual sample.
