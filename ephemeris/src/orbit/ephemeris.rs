//! A table of positions in place of elements.

use super::eclipse::EARTH_EQUATORIAL_RADIUS_M;
use super::interpolation::Series;
use super::{OrbitError, State, seconds_between};
use glam::DVec3;
use hifitime::{Duration, Epoch};
use sunglint_formats::time::{format_utc, format_utc_shortest};

/// The polar radius of WGS 84, m.
const POLAR_RADIUS_M: f64 = 6_356_752.3;
/// Nothing that is seen by reflected sunlight from the ground as a satellite is further: three times the distance of L2.
const FURTHEST_M: f64 = 5e9;
/// Rows nearer than this are one row twice: divided differences between them would be those of rounding, or 0/0, s.
const LEAST_STEP_S: f64 = 1e-3;
/// An interpolation error from which on a person is warned, m: 2″ at 1000 km.
const COARSE_M: f64 = 10.0;

/// One row of an ephemeris.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EphemerisRow {
    /// When.
    pub epoch: Epoch,
    /// Position in the GCRS, m from the Earth's centre.
    pub position_m: DVec3,
    /// The velocity in the GCRS, m/s; all rows have one, or none has.
    pub velocity_m_s: Option<DVec3>,
}

/// A table of GCRS positions, with or without velocities, interpolated and never extrapolated.
///
/// Between rows stands the polynomial of degree 7 through positions and velocities of the four rows around, or without
/// velocities that of degree 9 through the ten positions around; less in tables that have fewer rows. Near the ends it is the
/// polynomial of the first or last rows, which errs more. In low orbit (7000 km) the error is below 1e-6 m at steps of 60 s;
/// at 300 s it is 0.02 m with velocities, without them 0.03 m and in the intervals at the ends 1.4 m.
/// [`Ephemeris::interpolation_error_m`] says what it is for the table at hand.
#[derive(Debug, Clone, PartialEq)]
pub struct Ephemeris {
    name: String,
    first: Epoch,
    last: Epoch,
    times_s: Vec<f64>,
    positions_m: Vec<DVec3>,
    velocities_m_s: Vec<DVec3>,
    error_m: f64,
    error_at: Epoch,
}

/// Fault of a row, by field.
pub(super) struct Fault {
    pub field: &'static str,
    pub value: String,
    pub expected: &'static str,
}

/// Returns the fault of a row after the one before it.
pub(super) fn fault(before: Option<&EphemerisRow>, row: &EphemerisRow) -> Option<Fault> {
    let fault = |field, value, expected| Some(Fault { field, value, expected });
    if let Some(before) = before {
        let step_s = seconds_between(before.epoch, row.epoch);
        if step_s <= 0.0 {
            let value = format_utc_shortest(row.epoch);
            return fault("time_utc", value, "a time after that of the row before");
        }
        if step_s < LEAST_STEP_S {
            let value = format_utc_shortest(row.epoch);
            return fault("time_utc", value, "a time 1 ms or more after that of the row before");
        }
        if before.velocity_m_s.is_some() != row.velocity_m_s.is_some() {
            return fault("vx_km_s", "nothing".to_owned(), "velocities in all rows, or in none");
        }
    }
    let p = row.position_m;
    let velocity = row.velocity_m_s.unwrap_or(DVec3::ZERO);
    let fields = [
        ("x_km", p.x),
        ("y_km", p.y),
        ("z_km", p.z),
        ("vx_km_s", velocity.x),
        ("vy_km_s", velocity.y),
        ("vz_km_s", velocity.z),
    ];
    for (field, value) in fields {
        if !value.is_finite() {
            return fault(field, format!("{value}"), "a finite number");
        }
    }
    let km = format!("a place {:.3} km from the Earth's centre", p.length() / 1e3);
    let level = (p.x * p.x + p.y * p.y) / EARTH_EQUATORIAL_RADIUS_M.powi(2)
        + (p.z / POLAR_RADIUS_M).powi(2);
    if level < 1.0 {
        return fault("x_km", km, "a place above the Earth's surface, GCRS kilometres");
    }
    if p.length() > FURTHEST_M {
        return fault("x_km", km, "at most 5 million km, GCRS kilometres (not metres)");
    }
    if velocity.length() > 1e5 {
        let value = format!("{} km/s", velocity.length() / 1e3);
        return fault(
            "vx_km_s",
            value,
            "at most 100 km/s, GCRS kilometres per second (not metres)",
        );
    }
    None
}

impl Ephemeris {
    /// An ephemeris from rows in the order of time. `name` is what a person calls the target.
    ///
    /// # Errors
    /// [`OrbitError::TooFewRows`]: fewer than two rows with velocities, four without. [`OrbitError::Row`]: times that do not
    /// increase, a value that is not a number, a place inside the Earth or beyond 5 million km, velocities in some rows only.
    pub fn new(name: impl Into<String>, rows: &[EphemerisRow]) -> Result<Self, OrbitError> {
        let name = name.into();
        for (index, row) in rows.iter().enumerate() {
            let before = index.checked_sub(1).map(|i| &rows[i]);
            if let Some(Fault { field, value, expected }) = fault(before, row) {
                return Err(OrbitError::Row { name, row: index, quantity: field, value, expected });
            }
        }
        let needed = if rows.first().is_some_and(|r| r.velocity_m_s.is_some()) { 2 } else { 4 };
        let (Some(first), Some(last)) = (rows.first(), rows.last()) else {
            return Err(OrbitError::TooFewRows { name, rows: 0, needed });
        };
        if rows.len() < needed {
            return Err(OrbitError::TooFewRows { name, rows: rows.len(), needed });
        }
        let mut ephemeris = Self {
            name,
            first: first.epoch,
            last: last.epoch,
            times_s: rows.iter().map(|r| seconds_between(first.epoch, r.epoch)).collect(),
            positions_m: rows.iter().map(|r| r.position_m).collect(),
            velocities_m_s: rows.iter().filter_map(|r| r.velocity_m_s).collect(),
            error_m: 0.0,
            error_at: first.epoch,
        };
        let (error_m, at_s) = ephemeris.series().largest_error();
        ephemeris.error_m = error_m;
        ephemeris.error_at = first.epoch + Duration::from_total_nanoseconds((at_s * 1e9) as i128);
        Ok(ephemeris)
    }

    /// The state at an epoch.
    ///
    /// # Errors
    /// [`OrbitError::OutsideEphemeris`].
    pub fn state(&self, epoch: Epoch) -> Result<State, OrbitError> {
        let time_s = seconds_between(self.first, epoch);
        let outside = time_s < 0.0 || seconds_between(epoch, self.last) < 0.0;
        if outside {
            return Err(OrbitError::OutsideEphemeris {
                name: self.name.clone(),
                epoch_utc: format_utc(epoch, 3),
                first_utc: format_utc(self.first, 3),
                last_utc: format_utc(self.last, 3),
            });
        }
        let series = self.series();
        let (position_m, velocity_m_s) = series.at(time_s, series.rows());
        Ok(State { position_m, velocity_m_s })
    }

    /// Returns the name of the target.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The first and the last epoch.
    pub fn range(&self) -> (Epoch, Epoch) {
        (self.first, self.last)
    }

    /// Returns the number of rows.
    pub fn rows(&self) -> usize {
        self.times_s.len()
    }

    /// An upper estimate of the interpolation's error anywhere in the table, m: the largest difference, in the middle of any
    /// interval, between the polynomial that is used and the one through fewer rows (two fewer, with velocities one). Where
    /// the rows are dense enough for an orbit that is ten to thousands of times the error itself; where they are not, or the
    /// rows are noisy, it is of the size of the error.
    pub fn interpolation_error_m(&self) -> f64 {
        self.error_m
    }

    /// Returns a warning where the rows are too far apart.
    pub fn warnings(&self) -> Vec<String> {
        if self.error_m <= COARSE_M {
            return Vec::new();
        }
        vec![format!(
            "{}: between the rows of the table near {} the interpolation may err by {:.0} m; give rows closer together, or velocities",
            self.name,
            format_utc(self.error_at, 0),
            self.error_m
        )]
    }

    fn series(&self) -> Series<'_> {
        Series {
            times_s: &self.times_s,
            positions_m: &self.positions_m,
            velocities_m_s: &self.velocities_m_s,
        }
    }
}
