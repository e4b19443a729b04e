//! Surroundings of a body along its orbit.

use super::field::{MainField, years};
use glam::DVec3;
use hifitime::{Duration, Epoch};
use sunglint_ephemeris::orbit::eclipse::{EARTH_EQUATORIAL_RADIUS_M, EarthShape, visible_fraction};
use sunglint_ephemeris::orbit::{Orbit, State, in_tai, seconds_between};
use sunglint_formats::time::format_utc_shortest;
use sunglint_radiometry::constants::AU_M;
use sunglint_radiometry::sky::{EarthOrientation, SkyFrames};

/// The total irradiance of the Sun at 1 au, W m⁻² (IAU 2015 resolution B3).
pub const SOLAR_CONSTANT_W_M2: f64 = 1361.0;
const LIGHT_M_PER_S: f64 = 299_792_458.0;
/// Between nodes of the table, s.
const STEP_S: f64 = 10.0;
/// Nodes on each side of an interval that the interpolation takes.
const SIDE: usize = 3;
/// More nodes than this (231 days) are a slip of an epoch.
const MOST_NODES: usize = 2_000_000;

/// Surroundings of a body at one moment, GCRS axes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Around {
    /// From the Earth's centre, m.
    pub position_m: DVec3,
    /// Magnetic flux density, T.
    pub field_t: DVec3,
    /// How it changes at the body, which moves, T/s.
    pub field_rate_t_s: DVec3,
    /// Unit vector to the Sun.
    pub to_sun: DVec3,
    /// Pressure of sunlight on what absorbs it, Pa: 0 in the Earth's shadow.
    pub pressure_pa: f64,
    /// Velocity against the air, which turns with the Earth, m/s.
    pub through_air_m_s: DVec3,
    /// Density of the air, kg m⁻³.
    pub air_kg_m3: f64,
}

/// Surroundings as a function of time.
pub trait Surroundings {
    /// The surroundings so many seconds after the epoch at which the motion starts.
    fn at(&self, after_s: f64) -> Around;
    /// A rate that surroundings change with, rad/s: the integration's steps are shorter than its inverse.
    fn rate_rad_s(&self) -> f64;
}

/// Density of the air over height: exponential about one height.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Density {
    /// At that height, kg m⁻³.
    pub kg_m3: f64,
    /// The height above a sphere of the equatorial radius, m.
    pub height_m: f64,
    /// Scale height, m; infinite for one density everywhere.
    pub scale_height_m: f64,
}

/// Fault of the surroundings.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AroundError {
    /// A moment at which the orbit has no state.
    #[error("at {epoch_utc} the target has no place: {why}")]
    Orbit {
        /// The moment.
        epoch_utc: String,
        /// The orbit's own words.
        why: String,
    },
    /// A moment outside the field's model.
    #[error("at {epoch_utc} there is no magnetic field: IGRF-14 runs from {first} to {last}")]
    Field {
        /// The moment.
        epoch_utc: String,
        /// First year.
        first: f64,
        /// Last year.
        last: f64,
    },
    /// A span that is too long.
    #[error(
        "{days:.0} days lie between the start of the motion and the last moment that is asked for, at most {most:.0} are followed: give an attitude nearer to the pass"
    )]
    Span {
        /// Length of the span, days.
        days: f64,
        /// Longest span, days.
        most: f64,
    },
}

/// A row of the table.
#[derive(Debug, Clone, Copy, Default)]
struct Row {
    position_m: DVec3,
    field_t: DVec3,
    sun: DVec3,
    pressure_pa: f64,
    through_air_m_s: DVec3,
}

/// Surroundings along an orbit, tabulated every 10 s: positions, field and velocities by Lagrange's polynomials through six rows, sunlight
/// linearly.
#[derive(Debug, Clone)]
pub struct Along {
    first_s: f64,
    rows: Vec<Row>,
    density: Option<Density>,
    rate_rad_s: f64,
}

impl Along {
    /// Tabulates the surroundings between two times, s after `epoch`. IGRF-14 gives the field, `shadow` the Earth that hides the Sun
    /// (`None` for none).
    ///
    /// # Errors
    /// [`AroundError`].
    pub fn new(
        orbit: &Orbit,
        epoch: Epoch,
        (from_s, to_s): (f64, f64),
        earth: &EarthOrientation,
        shadow: Option<EarthShape>,
        density: Option<Density>,
    ) -> Result<Self, AroundError> {
        let first_s = from_s - SIDE as f64 * STEP_S;
        let nodes = ((to_s - first_s) / STEP_S).ceil() + SIDE as f64 + 1.0;
        // Written so that NaN is refused too.
        if nodes.is_nan() || nodes > MOST_NODES as f64 {
            let most = MOST_NODES as f64 * STEP_S / 86_400.0;
            return Err(AroundError::Span { days: (to_s - from_s) / 86_400.0, most });
        }
        let nodes = nodes as usize;
        let start = in_tai(epoch);
        let at = |s: f64| start + Duration::from_total_nanoseconds((s * 1e9).round() as i128);
        let (begin, end) = (at(first_s), at(first_s + nodes as f64 * STEP_S));
        let fault = |epoch: Epoch, why: String| AroundError::Orbit {
            epoch_utc: format_utc_shortest(epoch),
            why,
        };
        let frames = SkyFrames::over(begin, end, earth).map_err(|e| fault(begin, e.to_string()))?;
        let orbit = orbit.near(begin, end);
        let field = |epoch: Epoch| {
            let (first, last) = years();
            let year = 2000.0 + seconds_between(j2000(), epoch) / (365.25 * 86_400.0);
            MainField::at(year).ok_or_else(|| AroundError::Field {
                epoch_utc: format_utc_shortest(epoch),
                first,
                last,
            })
        };
        let main = field(begin)?;
        field(end)?;
        let mut rows = Vec::with_capacity(nodes);
        let mut rate: f64 = 0.0;
        for k in 0..nodes {
            let epoch = at(first_s + k as f64 * STEP_S);
            let frame = frames.at(epoch).map_err(|e| fault(epoch, e.to_string()))?;
            let State { position_m, velocity_m_s } =
                orbit.state(epoch, &frame).map_err(|e| fault(epoch, e.to_string()))?;
            let itrs = frame.gcrs_to_itrs() * position_m;
            let sun =
                frame.sun_from(position_m, DVec3::ZERO).map_err(|e| fault(epoch, e.to_string()))?;
            let sunlit = shadow.map_or(1.0, |shape| visible_fraction(position_m, &sun, shape));
            let r = position_m.length();
            rate = rate.max(position_m.cross(velocity_m_s).length() / (r * r));
            rows.push(Row {
                position_m,
                field_t: frame.itrs_to_gcrs() * main.tesla(itrs),
                sun: sun.direction_gcrs,
                pressure_pa: sunlit * SOLAR_CONSTANT_W_M2 / LIGHT_M_PER_S
                    * (AU_M / sun.distance_m).powi(2),
                through_air_m_s: velocity_m_s - frame.earth_rotation_gcrs_rad_s().cross(position_m),
            });
        }
        Ok(Self { first_s, rows, density, rate_rad_s: rate })
    }
}

fn j2000() -> Epoch {
    Epoch::from_gregorian_tai_at_noon(2000, 1, 1)
}

impl Surroundings for Along {
    fn at(&self, after_s: f64) -> Around {
        let x = (after_s - self.first_s) / STEP_S;
        // The table reaches beyond both ends of the span.
        let base = (x.floor().max(0.0) as usize)
            .clamp(SIDE - 1, self.rows.len().saturating_sub(SIDE + 1).max(SIDE - 1))
            - (SIDE - 1);
        let rows = &self.rows[base..base + 2 * SIDE];
        let u = x - base as f64;
        let mut out = Around::default();
        for (j, row) in rows.iter().enumerate() {
            let (mut weight, mut slope) = (1.0, 0.0);
            for m in (0..2 * SIDE).filter(|m| *m != j) {
                let width = j as f64 - m as f64;
                slope = (slope * (u - m as f64) + weight) / width;
                weight *= (u - m as f64) / width;
            }
            out.position_m += weight * row.position_m;
            out.field_t += weight * row.field_t;
            out.field_rate_t_s += slope / STEP_S * row.field_t;
            out.through_air_m_s += weight * row.through_air_m_s;
        }
        let (a, b) = (&rows[SIDE - 1], &rows[SIDE]);
        let part = u - (SIDE - 1) as f64;
        out.to_sun = (a.sun + part * (b.sun - a.sun)).normalize_or_zero();
        out.pressure_pa = a.pressure_pa + part * (b.pressure_pa - a.pressure_pa);
        out.air_kg_m3 = self.density.map_or(0.0, |d| {
            let height_m = out.position_m.length() - EARTH_EQUATORIAL_RADIUS_M;
            d.kg_m3 * (-(height_m - d.height_m) / d.scale_height_m).exp()
        });
        out
    }

    fn rate_rad_s(&self) -> f64 {
        self.rate_rad_s
    }
}
