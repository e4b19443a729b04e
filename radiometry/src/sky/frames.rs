//! Frames at many epochs of a night, at a twentieth of the cost.

use super::frame::{SkyError, SkyFrame, Slow, StateAu};
use super::orientation::EarthOrientation;
use super::time::{TimeScales, tai_seconds};
use hifitime::{Duration, Epoch};
use sunglint_formats::time::tai_nanoseconds;

/// Between knots, s.
const STEP_S: f64 = 3600.0;

/// [`SkyFrame`]s at many epochs of a stretch of time.
///
/// Precession, nutation and the Earth's orbit cost 50 µs a frame and move slowly: they are calculated every hour, the
/// rotation's matrix is interpolated linearly and the orbit by cubics through positions and velocities. What turns fast, the
/// Earth rotation angle, UT1 and the pole, is calculated for every epoch. That errs by 1e-10 rad at most (0.02 mas:
/// nutation's terms of some days curve by 2e-7 rad/day²), and by 1 cm in the Sun's place. Outside the stretch a frame is
/// calculated in full.
#[derive(Debug, Clone)]
pub struct SkyFrames<'a> {
    earth: &'a EarthOrientation,
    first_tai_s: f64,
    knots: Vec<Slow>,
}

impl<'a> SkyFrames<'a> {
    /// Frames between two epochs: one knot an hour, each as expensive as a frame.
    ///
    /// # Errors
    /// The errors of [`SkyFrame::new`] anywhere in the stretch.
    pub fn over(from: Epoch, to: Epoch, earth: &'a EarthOrientation) -> Result<Self, SkyError> {
        let tai_ns = tai_nanoseconds(from);
        let hours = ((tai_seconds(to) - tai_seconds(from)) / STEP_S).ceil().max(1.0) as i128;
        let knot = |hour: i128| {
            let elapsed = Duration::from_total_nanoseconds(tai_ns + hour * 3_600_000_000_000);
            let epoch = Epoch::from_tai_duration(elapsed);
            let times = TimeScales::at(epoch, earth.at(epoch)?.ut1_minus_tai_s)?;
            Slow::at(times.tt)
        };
        // A stretch that leaves the ephemeris is refused before the work, which a century of it would be.
        knot(hours)?;
        let knots = (0..=hours).map(knot).collect::<Result<_, _>>()?;
        Ok(Self { earth, first_tai_s: tai_seconds(from), knots })
    }

    /// The frame at an epoch.
    ///
    /// # Errors
    /// The errors of [`SkyFrame::new`].
    pub fn at(&self, epoch: Epoch) -> Result<SkyFrame, SkyError> {
        let hours = (tai_seconds(epoch) - self.first_tai_s) / STEP_S;
        let index = hours.floor();
        // Written so that no index leaves the knots.
        if !(index >= 0.0 && index + 1.0 < self.knots.len() as f64) {
            return SkyFrame::new(epoch, self.earth);
        }
        let pair = (&self.knots[index as usize], &self.knots[index as usize + 1]);
        let orientation = self.earth.at(epoch)?;
        let times = TimeScales::at(epoch, orientation.ut1_minus_tai_s)?;
        Ok(SkyFrame::of(epoch, orientation, times, &between(pair, hours - index)))
    }
}

/// Part of the way from one knot to the next.
fn between((low, high): (&Slow, &Slow), part: f64) -> Slow {
    let mix = |a: f64, b: f64| a + part * (b - a);
    let celestial = std::array::from_fn(|i| {
        std::array::from_fn(|j| mix(low.celestial[i][j], high.celestial[i][j]))
    });
    Slow {
        celestial,
        equation_of_origins_rad: mix(low.equation_of_origins_rad, high.equation_of_origins_rad),
        earth_from_sun: along(&low.earth_from_sun, &high.earth_from_sun, part),
        earth_from_barycentre: along(&low.earth_from_barycentre, &high.earth_from_barycentre, part),
    }
}

/// Hermite's cubic, in differences from the first place so that nothing of an astronomical unit is lost.
fn along(low: &StateAu, high: &StateAu, u: f64) -> StateAu {
    let days = STEP_S / 86_400.0;
    let (start, end) = (low.velocity * days, high.velocity * days);
    let way = high.position - low.position;
    let (square, cube) = (way * 3.0 - start * 2.0 - end, start + end - way * 2.0);
    StateAu {
        position: low.position + (start + (square + cube * u) * u) * u,
        velocity: (start + (square * 2.0 + cube * 3.0 * u) * u) / days,
    }
}
