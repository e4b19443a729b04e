//! The way of the bisector of Sun and station along a scene.

use hifitime::{Duration, Epoch};
use sunglint_analysis::series::Series;
use sunglint_analysis::synodic::Bisectors;
use sunglint_ephemeris::geometry::{Geometry, GeometryError};
use sunglint_radiometry::sky::{Observer, SkyError, SkyFrame};
use sunglint_simulator::pass::Pass;

/// Moments between the first and the last sample: the bisector moves smoothly.
const MOMENTS: usize = 400;

/// Why the bisector is not known.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BisectorError {
    /// A moment at which the sky is not known.
    #[error(transparent)]
    Sky(#[from] SkyError),
    /// A moment at which target, Sun or station have no place.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
}

/// Finds the bisector of Sun and station of a scene at the times of some series, which count seconds from `zero`. Returns `None` where the samples are too few or Sun and station
/// stand opposite one another.
///
/// # Errors
/// A time outside the orbit or the tables of the sky.
pub fn bisectors(
    pass: &Pass,
    zero: Epoch,
    series: &[Series],
) -> Result<Option<Bisectors>, BisectorError> {
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
            let frame = SkyFrame::new(epoch, pass.orientation())?;
            let geometry = Geometry::at(&pass.orbit, &Observer::new(frame, &pass.station.site))?;
            Ok((*t, geometry.sun.direction_gcrs, geometry.to_observer))
        })
        .collect::<Result<Vec<_>, BisectorError>>()?;
    Ok(Bisectors::new(&moments))
}
