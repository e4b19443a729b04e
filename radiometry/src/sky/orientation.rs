//! How the Earth is turned: UT1 and the pole, from a table, from the user's rows, or constant.

use super::time::{TimeError, tai_minus_utc_s, tai_seconds, tai_seconds_of_mjd_utc};
use crate::tables;
use hifitime::{Duration, Epoch};
use std::fmt;
use std::sync::OnceLock;
use sunglint_formats::time::{UtcDay, format_utc};
use sunglint_formats::{Table, TableError};

/// Rows further apart than this are not bridged: UT1 would be a guess.
const LONGEST_GAP_DAYS: f64 = 31.0;
const DAY_S: f64 = 86_400.0;
/// The drift of UT1 is a mean over so many days: a whole year, so that the seasons cancel.
const DRIFT_DAYS: f64 = 365.25;
/// Error of UT1 after the last row, s: this, and its growth by days and by days squared. Of 8,700 forecasts from rows since 2006 over 10 days to 2 years 99 % err less, none by half more.
const FORECAST_S: [f64; 3] = [0.01, 6e-4, 2e-7];
/// The same for each day where the rows span less than a year: UT1 has gained or lost no more than 3 ms a day since 1962.
const WITHOUT_DRIFT_S: f64 = 3e-3;
/// Largest difference of UT1−UTC from 0, s, as leap seconds are set: a forecast that may err by more is none.
const MOST_S: f64 = 0.9;
/// Speed of the equator's ground, m s⁻¹, and the Earth's rotation in a second, arcseconds.
const GROUND_M_S: f64 = 465.0;
const ARCSEC_S: f64 = 15.04;

/// One row of Earth orientation, as the IERS gives them (EOP C04, finals2000A).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrientationRow {
    /// Modified Julian date of UTC, days.
    pub mjd_utc: f64,
    /// The pole's x (towards Greenwich), arcseconds.
    pub x_pole_arcsec: f64,
    /// The pole's y (towards 90° west), arcseconds.
    pub y_pole_arcsec: f64,
    /// UT1 − UTC, s.
    pub ut1_minus_utc_s: f64,
}

/// Error in a table of Earth orientation.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum OrientationError {
    /// Fewer than two rows.
    #[error("Earth orientation needs at least two rows to interpolate between, found {rows}")]
    TooFewRows {
        /// How many there were.
        rows: usize,
    },
    /// A value that cannot be.
    #[error(
        "Earth orientation, row {row} (MJD {mjd_utc}): {name} is {value}, expected a number within ±{limit} {unit}"
    )]
    ImpossibleValue {
        /// The row, from 1.
        row: usize,
        /// Date of the row, MJD (UTC).
        mjd_utc: f64,
        /// The quantity.
        name: &'static str,
        /// Value of the quantity.
        value: f64,
        /// Largest possible size of the value.
        limit: f64,
        /// The unit of both.
        unit: &'static str,
    },
    /// A date before 1972, after 2100, or not a number.
    #[error("Earth orientation, row {row}: MJD {mjd_utc} is not a date of UTC since 1972")]
    ImpossibleDate {
        /// The row, from 1.
        row: usize,
        /// The date.
        mjd_utc: f64,
    },
    /// Dates that do not increase.
    #[error("Earth orientation, row {row}: MJD {mjd_utc} does not come after MJD {before}")]
    NotIncreasing {
        /// The row, from 1.
        row: usize,
        /// Date of the row, MJD (UTC).
        mjd_utc: f64,
        /// The date of the row before.
        before: f64,
    },
    /// Two rows too far apart.
    #[error(
        "Earth orientation, row {row}: {gap_days} days after the row before; more than {limit_days} are not bridged"
    )]
    Gap {
        /// The row, from 1.
        row: usize,
        /// The gap, days.
        gap_days: f64,
        /// The longest gap allowed, days.
        limit_days: f64,
    },
    /// The table lacks a column.
    #[error(transparent)]
    Table(#[from] TableError),
}

/// Where the values come from.
#[derive(Debug, Clone, PartialEq)]
enum Source {
    Table { knots: Vec<Knot>, first_mjd_utc: f64, last_mjd_utc: f64 },
    Constant { ut1_minus_utc_s: f64, x_pole_arcsec: f64, y_pole_arcsec: f64 },
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Knot {
    tai_s: f64,
    ut1_minus_tai_s: f64,
    x_pole_arcsec: f64,
    y_pole_arcsec: f64,
}

/// UT1 and the pole as functions of time.
///
/// Between rows, UT1−TAI and the pole are interpolated linearly; UT1−TAI, because UT1−UTC jumps by a second at a leap
/// second. On the embedded 5-day table this errs by at most 1.1 ms of UT1 (0.29 ms rms; it is the tides of 5 to
/// 14 days) and 2.0 mas of pole, measured against every day of the IERS series: 0.016″ on the sky, 0.5 m in low orbit. The celestial
/// pole offsets dX, dY (below 1 mas) are left out.
#[derive(Debug, Clone, PartialEq)]
pub struct EarthOrientation {
    source: Source,
    title: String,
}

/// The Earth's orientation at one epoch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Orientation {
    /// UT1 − UTC, s.
    pub ut1_minus_utc_s: f64,
    /// UT1 − TAI, s: continuous through leap seconds.
    pub ut1_minus_tai_s: f64,
    /// The pole's x (towards Greenwich), arcseconds.
    pub x_pole_arcsec: f64,
    /// The pole's y (towards 90° west), arcseconds.
    pub y_pole_arcsec: f64,
    /// Where the values come from.
    pub origin: OrientationOrigin,
}

/// Where the values of an [`Orientation`] come from.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum OrientationOrigin {
    /// Between two rows of a table.
    Interpolated,
    /// Constants that the caller chose.
    Constant,
    /// The epoch is after the last row of the table: UT1 goes on with the mean drift of the last year, the pole stays. It prints as a warning.
    Extrapolated {
        /// The epoch.
        mjd_utc: f64,
        /// The last date of the table.
        last_mjd_utc: f64,
        /// Error of UT1 that forecasts of that length mostly do not exceed, s.
        error_s: f64,
    },
    /// The epoch is before the table or so long after it that UT1 is unknown, so UT1−UTC and the pole are taken as 0. It prints as a warning.
    Outside {
        /// The epoch.
        mjd_utc: f64,
        /// The first date of the table.
        first_mjd_utc: f64,
        /// The last date of the table.
        last_mjd_utc: f64,
    },
}

impl OrientationOrigin {
    /// Whether the values are a stand-in that the person should hear of.
    pub fn is_outside(self) -> bool {
        matches!(self, Self::Outside { .. } | Self::Extrapolated { .. })
    }
}

/// A day as people write it, `2026-10-08`.
fn date(mjd_utc: f64) -> String {
    let text = UtcDay::of_mjd(mjd_utc.floor() as i64).map(|day| {
        let start = Epoch::from_tai_duration(Duration::from_total_nanoseconds(day.start_tai_ns));
        format_utc(start, 0)
    });
    text.map_or_else(|| format!("MJD {mjd_utc:.0}"), |text| text.chars().take(10).collect())
}

impl fmt::Display for OrientationOrigin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Interpolated => f.write_str("Earth orientation interpolated in a table"),
            Self::Constant => f.write_str("constant Earth orientation"),
            Self::Extrapolated { mjd_utc, last_mjd_utc, error_s } => write!(
                f,
                "Earth orientation of {} is extrapolated (the table ends on {}): UT1 goes on with the mean drift of the year before, which errs by up to {error_s:.2} s \
                 of rotation ({:.1} arcsec on the sky, {:.0} m in low orbit); give IERS rows that cover it",
                date(*mjd_utc),
                date(*last_mjd_utc),
                ARCSEC_S * error_s,
                GROUND_M_S * error_s
            ),
            Self::Outside { mjd_utc, first_mjd_utc, last_mjd_utc } => write!(
                f,
                "no Earth orientation for {} (the table holds {} to {}): UT1-UTC and the pole are taken as 0; within a year or two of the table \
                 that errs by up to 0.9 s of rotation (14 arcsec on the sky, 450 m in low orbit); give IERS rows that cover it",
                date(*mjd_utc),
                date(*first_mjd_utc),
                date(*last_mjd_utc)
            ),
        }
    }
}

impl EarthOrientation {
    /// The table that the program carries: IERS EOP 20 C04, every 5 days since 2005.
    pub fn embedded() -> &'static Self {
        static EMBEDDED: OnceLock<EarthOrientation> = OnceLock::new();
        EMBEDDED.get_or_init(|| {
            // A test builds it, so this cannot fail in a program that passed it.
            #[expect(clippy::unwrap_used, reason = "embedded table, built by a test")]
            Self::from_table(tables::EARTH_ORIENTATION.table()).unwrap()
        })
    }

    /// From a table with the columns `mjd_utc`, `x_pole_arcsec`, `y_pole_arcsec`, `ut1_minus_utc_s`; its metadata
    /// `title` names it.
    ///
    /// # Errors
    /// The errors of [`EarthOrientation::from_rows`], or a column that is not there.
    pub fn from_table(table: &Table) -> Result<Self, OrientationError> {
        let (mjd, ut1) = (table.quantity("mjd_utc", "d")?, table.quantity("ut1_minus_utc_s", "s")?);
        let (x, y) = (
            table.quantity("x_pole_arcsec", "arcsec")?,
            table.quantity("y_pole_arcsec", "arcsec")?,
        );
        let rows: Vec<OrientationRow> = (0..table.rows())
            .map(|i| OrientationRow {
                mjd_utc: mjd[i],
                x_pole_arcsec: x[i],
                y_pole_arcsec: y[i],
                ut1_minus_utc_s: ut1[i],
            })
            .collect();
        Self::from_rows(table.meta_text("title").unwrap_or("a table without title"), &rows)
    }

    /// From rows in increasing time, at most 31 days apart. `title` says where they come from.
    ///
    /// # Errors
    /// Fewer than two rows, dates that do not increase or lie too far apart, and values that cannot be (UT1−UTC beyond
    /// ±1 s, the pole beyond ±2″): the row is named.
    pub fn from_rows(
        title: impl Into<String>,
        rows: &[OrientationRow],
    ) -> Result<Self, OrientationError> {
        let [first, .., last] = rows else {
            return Err(OrientationError::TooFewRows { rows: rows.len() });
        };
        let mut knots = Vec::with_capacity(rows.len());
        let mut before: Option<f64> = None;
        for (index, row) in rows.iter().enumerate() {
            check_row(index + 1, row, before)?;
            knots.push(knot(index + 1, row)?);
            before = Some(row.mjd_utc);
        }
        let source =
            Source::Table { knots, first_mjd_utc: first.mjd_utc, last_mjd_utc: last.mjd_utc };
        Ok(Self { source, title: title.into() })
    }

    /// The same values at every epoch, as another program may use them. UT1−UTC is constant, so UT1 steps with
    /// UTC at a leap second.
    ///
    /// # Errors
    /// [`OrientationError::ImpossibleValue`] for UT1−UTC beyond ±1 s or the pole beyond ±2″.
    pub fn constant(
        ut1_minus_utc_s: f64,
        x_pole_arcsec: f64,
        y_pole_arcsec: f64,
    ) -> Result<Self, OrientationError> {
        check_values(
            1,
            &OrientationRow { mjd_utc: f64::NAN, x_pole_arcsec, y_pole_arcsec, ut1_minus_utc_s },
        )?;
        let source = Source::Constant { ut1_minus_utc_s, x_pole_arcsec, y_pole_arcsec };
        Ok(Self { source, title: "constant".to_owned() })
    }

    /// UT1 = UTC and the pole at 0: what programs without a table assume.
    pub fn zero() -> Self {
        let source =
            Source::Constant { ut1_minus_utc_s: 0.0, x_pole_arcsec: 0.0, y_pole_arcsec: 0.0 };
        Self { source, title: "zero".to_owned() }
    }

    /// Where the values come from, in words.
    pub fn title(&self) -> &str {
        &self.title
    }

    /// The first and last date of the table (modified Julian dates of UTC); `None` for constants.
    pub fn range_mjd_utc(&self) -> Option<std::ops::RangeInclusive<f64>> {
        match &self.source {
            Source::Table { first_mjd_utc, last_mjd_utc, .. } => {
                Some(*first_mjd_utc..=*last_mjd_utc)
            }
            Source::Constant { .. } => None,
        }
    }

    /// The orientation at an epoch. After the last row UT1 goes on with its mean drift, as long as that is known to 0.9 s, and says so
    /// ([`OrientationOrigin::Extrapolated`]); elsewhere outside the table UT1−UTC is 0 and says so ([`OrientationOrigin::Outside`]).
    ///
    /// # Errors
    /// [`TimeError::OutsideUtc`] before 1972 or after 2100.
    pub fn at(&self, epoch: Epoch) -> Result<Orientation, TimeError> {
        let delta_at_s = tai_minus_utc_s(epoch)?;
        let from_utc = |ut1_minus_utc_s, x_pole_arcsec, y_pole_arcsec, origin| Orientation {
            ut1_minus_utc_s,
            ut1_minus_tai_s: ut1_minus_utc_s - delta_at_s,
            x_pole_arcsec,
            y_pole_arcsec,
            origin,
        };
        match &self.source {
            Source::Constant { ut1_minus_utc_s, x_pole_arcsec, y_pole_arcsec } => {
                let (x, y) = (*x_pole_arcsec, *y_pole_arcsec);
                Ok(from_utc(*ut1_minus_utc_s, x, y, OrientationOrigin::Constant))
            }
            Source::Table { knots, first_mjd_utc, last_mjd_utc } => {
                let tai_s = tai_seconds(epoch);
                if let Some(knot) = interpolate(knots, tai_s) {
                    return Ok(Orientation {
                        ut1_minus_utc_s: knot.ut1_minus_tai_s + delta_at_s,
                        ut1_minus_tai_s: knot.ut1_minus_tai_s,
                        x_pole_arcsec: knot.x_pole_arcsec,
                        y_pole_arcsec: knot.y_pole_arcsec,
                        origin: OrientationOrigin::Interpolated,
                    });
                }
                let mjd_utc = 15_020.0 + (tai_s - delta_at_s) / DAY_S;
                if let Some((knot, error_s)) = forecast(knots, tai_s) {
                    return Ok(Orientation {
                        ut1_minus_utc_s: knot.ut1_minus_tai_s + delta_at_s,
                        ut1_minus_tai_s: knot.ut1_minus_tai_s,
                        x_pole_arcsec: knot.x_pole_arcsec,
                        y_pole_arcsec: knot.y_pole_arcsec,
                        origin: OrientationOrigin::Extrapolated {
                            mjd_utc,
                            last_mjd_utc: *last_mjd_utc,
                            error_s,
                        },
                    });
                }
                let origin = OrientationOrigin::Outside {
                    mjd_utc,
                    first_mjd_utc: *first_mjd_utc,
                    last_mjd_utc: *last_mjd_utc,
                };
                Ok(from_utc(0.0, 0.0, 0.0, origin))
            }
        }
    }
}

fn interpolate(knots: &[Knot], tai_s: f64) -> Option<Knot> {
    let next = knots.partition_point(|k| k.tai_s <= tai_s);
    if next == 0 {
        return None;
    }
    let a = knots[next - 1];
    let Some(&b) = knots.get(next) else {
        return (a.tai_s == tai_s).then_some(a);
    };
    let part = (tai_s - a.tai_s) / (b.tai_s - a.tai_s);
    let mix = |from: f64, to: f64| from + part * (to - from);
    Some(Knot {
        tai_s,
        ut1_minus_tai_s: mix(a.ut1_minus_tai_s, b.ut1_minus_tai_s),
        x_pole_arcsec: mix(a.x_pole_arcsec, b.x_pole_arcsec),
        y_pole_arcsec: mix(a.y_pole_arcsec, b.y_pole_arcsec),
    })
}

/// UT1 after the last row, by the mean drift of the year before it, with its error, s; `None` before it and where that is unknown.
fn forecast(knots: &[Knot], tai_s: f64) -> Option<(Knot, f64)> {
    let last = *knots.last()?;
    let days = (tai_s - last.tai_s) / DAY_S;
    if days < 0.0 {
        return None;
    }
    let year_ago = last.tai_s - DRIFT_DAYS * DAY_S;
    // The last row that is at least a year before the last.
    let before = knots.partition_point(|k| k.tai_s <= year_ago).checked_sub(1).map(|k| knots[k]);
    let [least, daily, growing] = FORECAST_S;
    let (rate, error_s) = match before {
        Some(before) => {
            let rate =
                (last.ut1_minus_tai_s - before.ut1_minus_tai_s) / (last.tai_s - before.tai_s);
            (rate, least + days * (daily + days * growing))
        }
        None => (0.0, least + days * WITHOUT_DRIFT_S),
    };
    let ut1_minus_tai_s = last.ut1_minus_tai_s + rate * (tai_s - last.tai_s);
    (error_s < MOST_S).then_some((Knot { tai_s, ut1_minus_tai_s, ..last }, error_s))
}

fn knot(row_number: usize, row: &OrientationRow) -> Result<Knot, OrientationError> {
    let impossible = || OrientationError::ImpossibleDate { row: row_number, mjd_utc: row.mjd_utc };
    let tai_s = tai_seconds_of_mjd_utc(row.mjd_utc).ok_or_else(impossible)?;
    // ΔAT of the row's own day, which its UT1−UTC refers to.
    let midnight_tai_s = tai_seconds_of_mjd_utc(row.mjd_utc.floor()).ok_or_else(impossible)?;
    let delta_at_s = (midnight_tai_s - (row.mjd_utc.floor() - 15_020.0) * DAY_S).round();
    Ok(Knot {
        tai_s,
        ut1_minus_tai_s: row.ut1_minus_utc_s - delta_at_s,
        x_pole_arcsec: row.x_pole_arcsec,
        y_pole_arcsec: row.y_pole_arcsec,
    })
}

fn check_row(
    number: usize,
    row: &OrientationRow,
    before: Option<f64>,
) -> Result<(), OrientationError> {
    if !row.mjd_utc.is_finite() {
        return Err(OrientationError::ImpossibleDate { row: number, mjd_utc: row.mjd_utc });
    }
    if let Some(before) = before {
        let gap_days = row.mjd_utc - before;
        if gap_days <= 0.0 {
            return Err(OrientationError::NotIncreasing {
                row: number,
                mjd_utc: row.mjd_utc,
                before,
            });
        }
        if gap_days > LONGEST_GAP_DAYS {
            return Err(OrientationError::Gap {
                row: number,
                gap_days,
                limit_days: LONGEST_GAP_DAYS,
            });
        }
    }
    check_values(number, row)
}

fn check_values(number: usize, row: &OrientationRow) -> Result<(), OrientationError> {
    let values = [
        ("UT1-UTC", row.ut1_minus_utc_s, 1.0, "s"),
        ("the pole's x", row.x_pole_arcsec, 2.0, "arcsec"),
        ("the pole's y", row.y_pole_arcsec, 2.0, "arcsec"),
    ];
    for (name, value, limit, unit) in values {
        if value.is_nan() || value.abs() > limit {
            let mjd_utc = row.mjd_utc;
            return Err(OrientationError::ImpossibleValue {
                row: number,
                mjd_utc,
                name,
                value,
                limit,
                unit,
            });
        }
    }
    Ok(())
}
