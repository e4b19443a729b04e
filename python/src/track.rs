//! Following a satellite: the plan, and a rehearsal with a virtual telescope. Real mounts are driven by the program, which has a watchdog beside it.

use crate::product::Outcome;
use crate::sky::within;
use crate::watch::{Watch, run};
use crate::workflows::{moment, needed, station_or_usual, unknown};
use pyo3::prelude::*;
use std::path::PathBuf;
use sunglint_drivers::device::MountKnown;
use sunglint_ephemeris::orbit::Orbit;
use sunglint_observatory::telescope::TrackOptions;
use sunglint_rehearsal::track::{Limits, MOUNTS, Rehearsal, VirtualMount, next_pass, rehearse};
use sunglint_report::track::TrackReport;

/// Numbers of a rehearsal, as Python names them.
#[derive(Debug, FromPyObject)]
#[pyo3(from_item_all)]
struct Wanted {
    min_elevation_deg: f64,
    for_s: Option<f64>,
    sun_limit_deg: f64,
    latency_s: f64,
    past_meridian_deg: f64,
    slew_deg_s: Option<f64>,
    late_s: f64,
}

/// Plans a pass, or follows it with a virtual telescope.
#[pyfunction]
#[pyo3(signature = (elements, name, at, wanted, mount="virtual".into(), station=None, dry_run=false, progress=None))]
#[expect(clippy::too_many_arguments, reason = "keywords of a Python call")]
fn track(
    py: Python<'_>,
    elements: PathBuf,
    name: String,
    at: String,
    wanted: Wanted,
    mount: String,
    station: Option<String>,
    dry_run: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<Outcome> {
    run(py, progress, move |watch: &Watch| {
        within("min_elevation_deg", wanted.min_elevation_deg, 0.0, 89.0)?;
        within("sun_limit_deg", wanted.sun_limit_deg, 10.0, 90.0)?;
        within("latency_s", wanted.latency_s, 0.0, 5.0)?;
        within("past_meridian_deg", wanted.past_meridian_deg, 0.0, 85.0)?;
        within("slew_deg_s", wanted.slew_deg_s.unwrap_or(1.0), 0.1, 100.0)?;
        within("late_s", wanted.late_s, -60.0, 60.0)?;
        within("for_s", wanted.for_s.unwrap_or(1.0), 0.1, 86_400.0)?;
        let made = VirtualMount::named(&mount).ok_or_else(|| {
            let names = MOUNTS.map(|mount| mount.name).join(", ");
            unknown(
                "mount",
                &mount,
                &format!("{names}; real mounts are driven by `sunglint track`"),
            )
        })?;
        let at = needed("at", moment("at", Some(&at))?)?;
        let station = needed("station", station_or_usual(station.as_deref())?)?;
        let orbit = Orbit::read(&elements, Some(&name), Some(at))?;
        // A target that comes late is where its elements say that it was before.
        let asked = at - hifitime::Duration::from_seconds(wanted.late_s);
        let (from, seconds) =
            next_pass(&orbit, &station, asked, wanted.min_elevation_deg, wanted.for_s)?;
        let warnings = orbit.warnings(from, from + hifitime::Duration::from_seconds(seconds));
        let mut options = TrackOptions::default();
        options.latency_s = wanted.latency_s;
        options.past_meridian_deg = wanted.past_meridian_deg;
        options.slew_deg_s = wanted.slew_deg_s;
        if let Some(speed) = wanted.slew_deg_s {
            options.slew_within_s = options.slew_within_s.max(360.0 / speed + 60.0);
        }
        let rehearsal = Rehearsal {
            limits: Limits {
                min_altitude_deg: wanted.min_elevation_deg,
                sun_limit_deg: wanted.sun_limit_deg,
            },
            late_s: wanted.late_s,
            known: MountKnown::default(),
            options,
            only_plan: dry_run,
        };
        let done = rehearse(&orbit, &station, (from, seconds), made, &rehearsal, watch.cancel())?;
        let mut report = TrackReport::planned(done.plan, mount);
        match done.ended {
            None if dry_run => {}
            None => {
                let why = report.plan.refused.clone();
                return Err(why.unwrap_or_else(|| "the plan is refused".into()).into());
            }
            Some(ended) => {
                report.went(ended?, &done.steps);
                report.knows(&done.steps, &done.truth);
            }
        }
        Ok(Outcome::new(report.product(&done.steps)?, report.text(), warnings))
    })
}

/// Adds the function to the module.
pub fn add(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_function(wrap_pyfunction!(track, module)?)
}
