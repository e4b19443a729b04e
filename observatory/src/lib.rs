//! A night of observation as it runs: from its plan to the folder of its session.
//!
//! Each device has a thread of its own on a clock of its own, and waits for no other: not for a target to be found, not for the
//! display; a camera waits for the wheel before it. All data go to the one thread that writes. Where the telescope points is a function of time
//! ([`Schedule`]); a [`mount`] is brought there, and cameras wait until it is on its target.
//!
//! - [`Plan`]: NIGHT.toml: station, devices, targets and their times;
//! - [`preflight`]: whether a night can be what its plan says, before it begins;
//! - [`Night`]: a night that is ready to run, and [`Night::run`];
//! - [`planner`]: a plan out of passes, with stars to calibrate by;
//! - [`Opener`]: the source of the devices: the [`Catalogue`] of drivers, a session that is played back ([`Playback`]), recordings of
//!   a frame grabber ([`Films`]), or anything else that implements the trait, such as a virtual observatory;
//! - [`Snapshot`]: the live status, twenty times a second; [`Summary`]: how the night went;
//! - [`live`]: the state of a running night for other threads, and the queue of their commands;
//! - [`telescope`]: a mount that follows a satellite;
//! - [`clock`]: how far the computer's clock is from UTC.
//!
//! # A night with simulated devices
//!
//! ```
//! use std::sync::Arc;
//! use sunglint_drivers::clock::Cancel;
//! use sunglint_observatory::{Catalogue, Night, Plan};
//!
//! let folder = std::env::temp_dir().join(format!("sunglint-night-{}", std::process::id()));
//! std::fs::create_dir_all(&folder)?;
//! std::fs::write(
//!     folder.join("night.toml"),
//!     r#"
//!         station = "ufo"
//!         for_s = 1.0
//!         [[counter]]
//!         name = "tagger"
//!         device = "sim-timetagger"
//!         channels = { g = 1 }
//!         bin_s = 0.1
//!     "#,
//! )?;
//! let plan = Plan::read(&folder.join("night.toml"))?;
//! let night = Night::planned(plan, Arc::new(Catalogue), Some(&folder.join("session")), "an example");
//! let summary = night.run(&Cancel::new(), &mut |snapshot| {
//!     for message in &snapshot.messages {
//!         println!("{message}");
//!     }
//! })?;
//! summary.check()?;
//! assert!(summary.taken["tagger"] > 0);
//! # std::fs::remove_dir_all(&folder)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod camera;
pub mod clock;
mod counter;
mod disk;
mod films;
pub mod focus;
pub mod live;
pub mod mount;
mod movers;
mod night;
mod opener;
mod plan;
pub mod planner;
mod playback;
mod pointing;
mod preflight;
mod replay;
mod room;
mod saturation;
mod schedule;
mod sequence;
mod spots;
mod status;
mod tags;
pub mod telescope;
mod worker;

pub use camera::begin_doubt_s;
pub use films::Films;
pub use live::{Control, ControlError, LiveState};
pub use mount::MountPlan;
pub use night::{Incomplete, Night, NightError, Summary};
pub use opener::{Catalogue, Opener};
pub use plan::{
    CameraPlan, CounterPlan, FocuserPlan, MakeVirtual, NightClock, Plan, PlanError, RotatorPlan,
    VIRTUAL_ADDRESS, VirtualRequest, WheelPlan,
};
pub use playback::Playback;
pub use pointing::Pointing;
pub use preflight::{Level, PlanFinding, Preflight, PreflightOptions, check_pass, preflight};
pub use replay::ReplayError;
pub use schedule::{Schedule, Slot};
pub use sequence::{CameraSetup, Exposing, Step};
pub use status::{DeviceStatus, LastFrame, MountStatus, Snapshot, State, free_bytes};
