//! From [`hifitime::Epoch`] to the Julian dates that astronomy wants, through leap seconds.
//!
//! An instant is a count of TAI nanoseconds, and the day of UTC in which it lies comes from
//! [`sunglint_formats::time`], which also says why not from `hifitime`: an `Epoch` that must be able to lie in a leap
//! second is of scale TAI, as [`parse_utc`](sunglint_formats::time::parse_utc) makes it.

use hifitime::Epoch;
use sunglint_formats::time::{UtcDay, format_utc, tai_nanoseconds};

/// Modified Julian date of 1900-01-01, where `hifitime` counts from.
const MJD_1900: i64 = 15_020;
/// TT − TAI, s.
const TT_MINUS_TAI_S: f64 = 32.184;
const DAY_S: f64 = 86_400.0;
const DAY_NS: i128 = 86_400_000_000_000;
const SECOND_NS: i128 = 1_000_000_000;

/// Error in a time.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TimeError {
    /// Before UTC had leap seconds, or too far ahead for a calendar to make sense.
    #[error(
        "{epoch} is outside 1972-01-01 to 2100-12-31, where UTC with leap seconds is defined here"
    )]
    OutsideUtc {
        /// The epoch, as text.
        epoch: String,
    },
}

/// A Julian date in two parts, so that it holds nanoseconds: `midnight` ends in .5, `fraction` is the part of
/// the day since, in [0, 1).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JulianDate {
    /// The Julian date of the last midnight, days.
    pub midnight: f64,
    /// The part of the day since midnight; in UTC a day with a leap second has 86 401 s (SOFA's quasi-JD).
    pub fraction: f64,
}

impl JulianDate {
    /// From a whole modified Julian date and the seconds since its midnight, which may lie outside the day.
    fn from_mjd_seconds(mjd: i64, seconds: f64) -> Self {
        let days = (seconds / DAY_S).floor();
        Self {
            midnight: 2_400_000.5 + mjd as f64 + days,
            fraction: (seconds - days * DAY_S) / DAY_S,
        }
    }

    /// The date as one number, days, good to about 40 µs.
    pub fn days(self) -> f64 {
        self.midnight + self.fraction
    }

    /// The modified Julian date as one number, days, good to about 1 µs.
    pub fn mjd(self) -> f64 {
        (self.midnight - 2_400_000.5) + self.fraction
    }

    /// `self − earlier` in seconds, on a scale whose days all have 86 400 s (not UTC).
    pub fn seconds_since(self, earlier: Self) -> f64 {
        ((self.midnight - earlier.midnight) + (self.fraction - earlier.fraction)) * DAY_S
    }
}

/// One instant on the time scales of astronomy.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimeScales {
    /// UTC as SOFA's quasi-Julian date: the fraction of a day that may have 86 401 s.
    pub utc: JulianDate,
    /// International atomic time.
    pub tai: JulianDate,
    /// Terrestrial time, TAI + 32.184 s. It also stands for TDB, which differs by at most 1.7 ms.
    pub tt: JulianDate,
    /// Universal time, the Earth's rotation angle as a clock.
    pub ut1: JulianDate,
    /// ΔAT = TAI − UTC, s.
    pub tai_minus_utc_s: f64,
}

impl TimeScales {
    /// The scales at an epoch, UT1 from `ut1_minus_tai_s` (which, unlike UT1−UTC, does not jump; see
    /// [`Orientation`](super::Orientation)). Right to better than 1 ns.
    ///
    /// # Errors
    /// [`TimeError::OutsideUtc`] before 1972 or after 2100.
    pub fn at(epoch: Epoch, ut1_minus_tai_s: f64) -> Result<Self, TimeError> {
        let tai_ns = tai_nanoseconds(epoch);
        let day = UtcDay::containing(epoch).ok_or_else(|| outside(epoch))?;
        let tai_mjd = MJD_1900 + tai_ns.div_euclid(DAY_NS) as i64;
        let tai_s = tai_ns.rem_euclid(DAY_NS) as f64 / SECOND_NS as f64;
        Ok(Self {
            utc: JulianDate {
                midnight: 2_400_000.5 + day.mjd as f64,
                fraction: (tai_ns - day.start_tai_ns) as f64 / day.length_ns as f64,
            },
            tai: JulianDate::from_mjd_seconds(tai_mjd, tai_s),
            tt: JulianDate::from_mjd_seconds(tai_mjd, tai_s + TT_MINUS_TAI_S),
            ut1: JulianDate::from_mjd_seconds(tai_mjd, tai_s + ut1_minus_tai_s),
            tai_minus_utc_s: day.tai_minus_utc_s as f64,
        })
    }
}

/// ΔAT = TAI − UTC in s at an epoch: 37 s since 2017-01-01.
///
/// # Errors
/// [`TimeError::OutsideUtc`] before 1972 or after 2100.
pub fn tai_minus_utc_s(epoch: Epoch) -> Result<f64, TimeError> {
    let day = UtcDay::containing(epoch).ok_or_else(|| outside(epoch))?;
    Ok(day.tai_minus_utc_s as f64)
}

/// TAI seconds since 1900-01-01T00:00:00 TAI of a modified Julian date of UTC, good to 1 µs.
pub(super) fn tai_seconds_of_mjd_utc(mjd_utc: f64) -> Option<f64> {
    let whole = mjd_utc.floor();
    let day = UtcDay::of_mjd(whole as i64)?;
    Some((day.start_tai_ns as f64 + (mjd_utc - whole) * day.length_ns as f64) / SECOND_NS as f64)
}

/// TAI seconds since 1900-01-01T00:00:00 TAI of an epoch, good to 1 µs.
pub(super) fn tai_seconds(epoch: Epoch) -> f64 {
    tai_nanoseconds(epoch) as f64 / SECOND_NS as f64
}

fn outside(epoch: Epoch) -> TimeError {
    TimeError::OutsideUtc { epoch: format_utc(epoch, 0) }
}
