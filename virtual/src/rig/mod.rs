//! The virtual rig: a sample of known reflectance on a stage that turns, in a laser's beam, under a power meter.
//!
//! - [`options`]: what a rig is like, the keys of a `rig.toml`;
//! - [`sample`]: closed forms of what samples reflect;
//! - [`mod@bench`]: the light on the meter for an angle of the stage and a time;
//! - [`stage`]: where a stage stands that was sent somewhere: steps, play;
//! - [`meter`]: what a meter shows of light: ranges, settling, noise, an offset, its end.
//!
//! It gives what a measurement is made of and knows nothing of how one is evaluated: no solid angle is divided by, no power becomes a reflectance. The
//! light in the cone that the aperture takes is summed direction by direction. Time is an argument (seconds since the laser's power was stated), chance
//! comes from a seed and the number of the reading.
//!
//! # A rig, turned and read
//!
//! ```
//! use std::time::Duration;
//! use sunglint_drivers::clock::Deadline;
//! use sunglint_drivers::device::{InBeam, Power, PowerMeter, RotationStage};
//! use sunglint_virtual::rig::devices::VirtualRig;
//! use sunglint_virtual::rig::options::{Options, SampleKind};
//!
//! let mut options = Options::default();
//! (options.sample.kind, options.sample.reflectance) = (SampleKind::Lambert, 0.7);
//! options.optics.stray = 0.0;
//! // No waiting: a fast stage, and ranges that need no time.
//! (options.stage.speed_deg_per_s, options.meter.settling_s) = (1e4, 0.0);
//! let rig = VirtualRig::new(options, 0)?;
//! rig.place(InBeam::Sample);
//! let (mut stage, mut meter) = (rig.stage(), rig.meter());
//!
//! let deadline = Deadline::within(Duration::from_secs(60));
//! let Power::Watts(normal) = meter.power(&deadline)? else { return Err("over the range".into()) };
//! stage.move_to(60.0, &deadline)?;
//! assert!((stage.angle_deg(&deadline)? - 60.0).abs() < 0.002);
//! let Power::Watts(oblique) = meter.power(&deadline)? else { return Err("over the range".into()) };
//! // Lambert's law: the cosine of 60 degrees.
//! assert!((oblique / normal - 0.5).abs() < 0.01);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod bench;
pub mod devices;
pub mod meter;
pub mod options;
pub mod sample;
pub mod stage;
