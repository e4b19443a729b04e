//! Measured passes fitted by simulated ones, and compared with them; the attitude of a known shape.
//!
//! - [`compare`]: a measured pass beside the simulated one;
//! - [`measured`] and [`scene`]: measured curves with their scenes, and scenes in which numbers are set by name;
//! - [`mod@fit`]: measured passes fitted by simulated ones;
//! - [`solver`]: the mathematics of a fit of measured passes by simulated ones;
//! - [`attitude`]: spin axis, period and phase of a known shape;
//! - [`range`]: how far the lit and seen surface is;
//! - [`bisector`]: the way of the bisector of Sun and station along a scene;
//! - [`lit_curve`]: a curve and the light under which it was taken;
//! - [`unmix`]: how much of the light of a curve comes from which material;
//! - [`endmembers`]: the spectra that a curve is made of;
//! - [`map`]: samples of a curve, or all directions, on the body's frame.
//!
//! # A curve, fitted
//!
//! A sphere of albedo 0.5 is simulated; the fit of the curve finds that number again, starting from a scene that says 0.2:
//!
//! ```
//! use sunglint_formats::{atomic::Overwrite, ecsv};
//! use sunglint_inference::fit::{FitOptions, fit};
//! use sunglint_inference::measured::joined;
//! use sunglint_numerics::progress::Silent;
//! use sunglint_radiometry::light_curve::published::MagnitudeOptions;
//! use sunglint_simulator::pass::{Overrides, PassFile};
//!
//! let scene = |reflectance: f64| format!(r#"
//! target.sphere = {{ radius_m = 0.18, reflectance = {reflectance} }}
//! station.name = "ufo"
//! times = {{ from = "2020-11-18T16:24:00", to = "2020-11-18T16:25:00", step_s = 5, exposure_s = 1 }}
//! fit.free = ["albedo"]
//! orbit.lines = [
//!   "1 99004U 20001A   20323.50000000  .00000000  00000-0  10000-4 0    19",
//!   "2 99004  98.6000 318.0000 0010000  90.0000  90.0000 14.27000000    13",
//! ]
//! "#);
//! let folder = std::env::temp_dir().join(format!("sunglint-fit-{}", std::process::id()));
//! std::fs::create_dir_all(&folder)?;
//! let [curve, guess] = [folder.join("curve.ecsv"), folder.join("guess.toml")];
//! let pass = PassFile::parse("truth.toml", &scene(0.5))?.resolve(Overrides::default())?;
//! let measured = pass.simulate(&|_| ())?.light_curve("example");
//! ecsv::write_file(&curve, &measured.to_table()?, Overwrite::Allow)?;
//! std::fs::write(&guess, scene(0.2))?;
//!
//! let curves = joined(&[&curve, &guess], &MagnitudeOptions::default())?;
//! let found = fit(&curves, &FitOptions::of_scene(&guess)?, &Silent)?;
//! assert!(found.fit.parameters.iter().all(|albedo| (albedo.value - 0.5).abs() < 0.01));
//! std::fs::remove_dir_all(&folder)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod attitude;
pub mod bisector;
pub mod compare;
pub mod endmembers;
pub mod fit;
pub mod lit_curve;
pub mod map;
pub mod measured;
mod progress;
pub mod range;
pub mod scene;
pub mod solver;
pub mod unmix;
