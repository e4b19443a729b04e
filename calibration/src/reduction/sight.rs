//! Where a satellite stood when its light was measured, by its elements: range, phase angle, altitude.

use super::ReduceError;
use hifitime::Epoch;
use serde::Serialize;
use sunglint_ephemeris::geometry::Geometry;
use sunglint_ephemeris::orbit::tle::Tle;
use sunglint_ephemeris::orbit::{Orbit, TleOrbit, seconds_between};
use sunglint_radiometry::sky::{EarthOrientation, Observer, Site, SkyFrames};

/// Range to which magnitudes are brought, km.
pub const STANDARD_RANGE_KM: f64 = 1000.0;

/// A satellite as a site sees it at a moment.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Sight {
    /// Distance, km.
    pub range_km: f64,
    /// Change of the distance, km/s; above 0 where it goes away.
    pub range_rate_km_s: f64,
    /// Angle Sun–satellite–site, deg; 0 where it is lit from behind the observer.
    pub phase_angle_deg: f64,
    /// True altitude (no refraction), deg.
    pub altitude_deg: f64,
    /// Azimuth from north by east, deg.
    pub azimuth_deg: f64,
    /// Part of the Sun's disc that the Earth leaves visible at the satellite, 0 to 1.
    pub sunlit: f64,
}

impl Sight {
    /// A magnitude as it would be at 1,000 km: the light falls with the square of the range. Phase and air stay as they are.
    pub fn standard(&self, magnitude: f64) -> f64 {
        magnitude - 5.0 * (self.range_km / STANDARD_RANGE_KM).log10()
    }
}

/// Whose elements these are, and how old.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SightedObject {
    /// Name, or the number where the elements have none.
    pub object: String,
    /// Number in the catalogue.
    pub norad_id: u32,
    /// Time from the epoch of the elements to the first moment, days; below 0 where the elements are later.
    pub elements_age_days: f64,
    /// Degrees of geodetic latitude, degrees of longitude (east), height in m of the site.
    pub site: [f64; 3],
}

/// Seconds over which a range's change is taken.
const STEP_S: f64 = 0.5;

/// Sights at some moments, in their order.
///
/// # Errors
/// Elements that give no orbit; a moment for which orbit or sky are not known.
pub fn sights(
    tle: &Tle,
    site: &Site,
    times: &[Epoch],
) -> Result<(SightedObject, Vec<Sight>), ReduceError> {
    let orbit = Orbit::from(TleOrbit::new(tle.clone())?);
    let first = times.iter().copied().min().unwrap_or(tle.epoch);
    let last = times.iter().copied().max().unwrap_or(first);
    let step = hifitime::Duration::from_seconds(STEP_S);
    let frames = SkyFrames::over(first - step, last + step, EarthOrientation::embedded())?;
    let at = |time: Epoch| -> Result<Geometry, ReduceError> {
        Ok(Geometry::at(&orbit, &Observer::new(frames.at(time)?, site))?)
    };
    let sight = |time: &Epoch| -> Result<Sight, ReduceError> {
        let (before, here, after) = (at(*time - step)?, at(*time)?, at(*time + step)?);
        Ok(Sight {
            range_km: 1e-3 * here.range_m,
            range_rate_km_s: 1e-3 * (after.range_m - before.range_m) / (2.0 * STEP_S),
            phase_angle_deg: here.phase_deg(),
            altitude_deg: here.horizontal.altitude_deg(),
            azimuth_deg: here.horizontal.azimuth_deg(),
            sunlit: here.sunlit,
        })
    };
    let place = site.geodetic();
    let object = SightedObject {
        object: tle.name.clone().unwrap_or_else(|| tle.norad_id.to_string()),
        norad_id: tle.norad_id,
        elements_age_days: seconds_between(tle.epoch, first) / 86_400.0,
        site: [place.latitude_deg, place.longitude_deg, place.height_m],
    };
    Ok((object, times.iter().map(sight).collect::<Result<_, _>>()?))
}
