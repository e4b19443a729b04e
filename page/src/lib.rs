//! A night in the browser: one page over a running night or a recorded session, and its server.
//!
//! - [`Server`]: HTTP in a thread of its own, for this computer alone unless it is told otherwise; no path of a request leads to the disk;
//! - [`Source`]: what answers it: [`Recording`] for a session's folder, [`LiveNight`] for a night that runs, [`PlanDesk`] for a night that is planned, [`LabRun`] for a run in the lab;
//! - [`frame`]: frames on their way to a canvas;
//! - [`sky`]: the sky above the station.
//!
//! # A recorded session
//!
//! ```no_run
//! use std::sync::Arc;
//! use sunglint_page::{Recording, Server};
//!
//! let server = Server::start(None, Arc::new(Recording::open("2026-11-21_ufo")?))?;
//! println!("{}", server.url());
//! std::thread::park();
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod clip;
mod corrected;
pub mod frame;
mod gate;
mod lab;
mod live;
mod magnitudes;
mod marks;
mod plan;
mod predicted;
mod recorded;
mod request;
mod rework;
mod server;
pub mod sky;

pub use gate::Token;
pub use lab::{LabReading, LabRun, LabState};
pub use live::LiveNight;
pub use magnitudes::{Calibration, MagnitudesView};
pub use plan::{PlanCurve, PlanDesk, PlanPass, PlanPoint, PlanRate, PlanSurroundings};
pub use recorded::{About, CountsView, DeviceView, FibreView, Recording, VisitView};
pub use request::{Answer, Request, Source};
pub use server::{Server, ServerError};
