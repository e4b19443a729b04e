//! Frames at many epochs of a night, at a twentieth of the cost.

use super::frame::{SkyError, SkyFrame, Slow, StateAu};
use super::orientation::EarthOrientation;
use super::time::{TimeScales, tai_seconds};
use hifitime::{Duration, Epoch};
use std::collections::BTreeMap;
use sunglint_formats::time::tai_nanoseconds;

/// Between knots, s.
const STEP_S: f64 = 3600.0;
/// Between knots of scattered epochs, s.
const WIDE_S: f64 = 8.0 * 3600.0;
/// An epoch between two of these is interpolated from so many: two on either side.
const BESIDE: [i64; 4] = [-1, 0, 1, 2];

/// [`SkyFrame`]s at many epochs of a stretch of time.
///
/// Precession, nutation and the Earth's orbit cost 50 µs a frame and move slowly: they are calculated every hour, the
/// rotation's matrix is interpolated linearly and the orbit by cubics through positions and velocities. What turns fast, the
/// Earth rotation angle, UT1 and the pole, is calculated for every epoch. That errs by 1e-10 rad at most (0.02 mas:
/// nutation's terms of some days curve by 2e-7 rad/day²), and by 1 cm in the Sun's place. Outside the stretch a frame is
/// calculated in full.
///
/// Epochs that are scattered over many nights ([`SkyFrames::among`]) have knots of eight hours, where that makes fewer of them than epochs, and cubics between: with
/// the same error of a frame, and 2 m in the Sun's place (1e-11 rad).
#[derive(Debug, Clone)]
pub struct SkyFrames<'a> {
    earth: &'a EarthOrientation,
    first_tai_s: f64,
    knots: Vec<Slow>,
    /// By the number of their step since the beginning of TAI.
    wide: BTreeMap<i64, Slow>,
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
        Ok(Self { earth, first_tai_s: tai_seconds(from), knots, wide: BTreeMap::new() })
    }

    /// Frames at some epochs in any order, and around each of them: a stretch where they lie close together ([`SkyFrames::over`]), knots where several of them share these, and each
    /// on its own otherwise.
    ///
    /// # Errors
    /// The errors of [`SkyFrame::new`] anywhere in a stretch.
    pub fn among(epochs: &[Epoch], earth: &'a EarthOrientation) -> Result<Self, SkyError> {
        let mut alone = Self { earth, first_tai_s: 0.0, knots: Vec::new(), wide: BTreeMap::new() };
        let mut sorted = epochs.to_vec();
        sorted.sort_unstable_by_key(|epoch| tai_nanoseconds(*epoch));
        let Some((first, last)) = sorted.first().copied().zip(sorted.last().copied()) else {
            return Ok(alone);
        };
        if (tai_seconds(last) - tai_seconds(first)) / STEP_S <= epochs.len() as f64 {
            return Self::over(first, last, earth);
        }
        let steps = sorted.iter().map(|epoch| (tai_seconds(*epoch) / WIDE_S).floor() as i64);
        let mut wanted: Vec<i64> = steps.flat_map(|step| BESIDE.map(|k| step + k)).collect();
        wanted.sort_unstable();
        wanted.dedup();
        if wanted.len() >= epochs.len() {
            return Ok(alone);
        }
        let knot = |step: i64| {
            let epoch = Epoch::from_tai_duration(Duration::from_seconds(step as f64 * WIDE_S));
            let times = TimeScales::at(epoch, earth.at(epoch)?.ut1_minus_tai_s)?;
            Ok((step, Slow::at(times.tt)?))
        };
        // Where a knot has no frame, an epoch beside it may have one.
        let wide = wanted.into_iter().map(knot).collect::<Result<_, SkyError>>();
        alone.wide = wide.unwrap_or_default();
        Ok(alone)
    }

    /// The frame at an epoch.
    ///
    /// # Errors
    /// The errors of [`SkyFrame::new`].
    pub fn at(&self, epoch: Epoch) -> Result<SkyFrame, SkyError> {
        let hours = (tai_seconds(epoch) - self.first_tai_s) / STEP_S;
        let index = hours.floor();
        // Written so that no index leaves the knots.
        let slow = if index >= 0.0 && index + 1.0 < self.knots.len() as f64 {
            let pair = (&self.knots[index as usize], &self.knots[index as usize + 1]);
            between(pair, hours - index)
        } else {
            let steps = tai_seconds(epoch) / WIDE_S;
            let step = steps.floor();
            match BESIDE.map(|k| self.wide.get(&(step as i64 + k))) {
                [Some(a), Some(b), Some(c), Some(d)] => among([a, b, c, d], steps - step),
                _ => return SkyFrame::new(epoch, self.earth),
            }
        };
        let orientation = self.earth.at(epoch)?;
        let times = TimeScales::at(epoch, orientation.ut1_minus_tai_s)?;
        Ok(SkyFrame::of(epoch, orientation, times, &slow))
    }
}

/// Part of the way from the second of four knots to the third, by the cubic through all of them.
fn among(knots: [&Slow; 4], u: f64) -> Slow {
    let parts = BESIDE.map(|k| {
        let others = BESIDE.into_iter().filter(|j| *j != k);
        others.map(|j| (u - j as f64) / (k - j) as f64).product::<f64>()
    });
    let mix = |of: &dyn Fn(&Slow) -> f64| {
        knots.iter().zip(parts).map(|(knot, part)| part * of(knot)).sum::<f64>()
    };
    let [_, low, high, _] = knots;
    Slow {
        celestial: std::array::from_fn(|i| std::array::from_fn(|j| mix(&|s| s.celestial[i][j]))),
        equation_of_origins_rad: mix(&|s| s.equation_of_origins_rad),
        earth_from_sun: along(&low.earth_from_sun, &high.earth_from_sun, u, WIDE_S),
        earth_from_barycentre: along(
            &low.earth_from_barycentre,
            &high.earth_from_barycentre,
            u,
            WIDE_S,
        ),
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
        earth_from_sun: along(&low.earth_from_sun, &high.earth_from_sun, part, STEP_S),
        earth_from_barycentre: along(
            &low.earth_from_barycentre,
            &high.earth_from_barycentre,
            part,
            STEP_S,
        ),
    }
}

/// Hermite's cubic, in differences from the first place so that nothing of an astronomical unit is lost.
fn along(low: &StateAu, high: &StateAu, u: f64, step_s: f64) -> StateAu {
    let days = step_s / 86_400.0;
    let (start, end) = (low.velocity * days, high.velocity * days);
    let way = high.position - low.position;
    let (square, cube) = (way * 3.0 - start * 2.0 - end, start + end - way * 2.0);
    StateAu {
        position: low.position + (start + (square + cube * u) * u) * u,
        velocity: (start + (square * 2.0 + cube * 3.0 * u) * u) / days,
    }
}
