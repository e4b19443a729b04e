//! The bisector of Sun and station along a scene.

use crate::simulate;
use crate::station::StationArgs;
use anyhow::Context as _;
use hifitime::{Duration, Epoch};
use std::path::Path;
use sunglint_analysis::series::Series;
use sunglint_analysis::synodic::Bisectors;
use sunglint_ephemeris::geometry::Geometry;
use sunglint_radiometry::sky::{EarthOrientation, Observer, SkyFrame};
use sunglint_simulator::pass::{Overrides, Pass};

/// Moments between the first and the last sample: the bisector moves smoothly.
const MOMENTS: usize = 400;

/// The bisector of Sun and station of a scene at the times of some series, which count seconds from `zero`; `None` where the samples are too few or Sun and station stand opposite one another.
pub fn bisectors(
    path: &Path,
    station: &StationArgs,
    zero: Epoch,
    series: &[Series],
) -> anyhow::Result<Option<Bisectors>> {
    let pass = simulate::read(path, station, Overrides::default())?;
    let mut times: Vec<f64> = series.iter().flat_map(|s| s.time_s.iter().copied()).collect();
    times.sort_by(f64::total_cmp);
    times.dedup();
    let every = times.len().div_ceil(MOMENTS).max(1);
    let last = times.len().saturating_sub(1);
    let moments = times
        .iter()
        .enumerate()
        .filter(|(i, _)| i % every == 0 || *i == last)
        .map(|(_, t)| {
            let epoch = zero + Duration::from_seconds(*t);
            let frame = SkyFrame::new(epoch, earth(&pass))?;
            let geometry = Geometry::at(&pass.orbit, &Observer::new(frame, &pass.station.site))?;
            Ok((*t, geometry.sun.direction_gcrs, geometry.to_observer))
        })
        .collect::<anyhow::Result<Vec<_>>>()
        .with_context(|| path.display().to_string())?;
    Ok(Bisectors::new(&moments))
}

fn earth(pass: &Pass) -> &EarthOrientation {
    pass.orientation.as_ref().unwrap_or_else(|| EarthOrientation::embedded())
}
