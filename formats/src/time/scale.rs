//! Time scales beside UTC.

use super::{DAY_NS, Digits, MJD_1900, UtcDay, UtcError, calendar, nine_decimals, split};
use hifitime::{Duration, Epoch};

/// TT − TAI, s: by definition (IAU 1991, recommendation IV).
const TT_MINUS_TAI_S: f64 = 32.184;
/// TAI − time of GPS, s (IS-GPS-200, section 3.3.4, with TAI − UTC = 19 s at its origin).
const TAI_MINUS_GPS_S: f64 = 19.0;

/// Time scale of a text or of a Julian date.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    /// Coordinated universal time.
    Utc,
    /// International atomic time.
    Tai,
    /// Terrestrial time.
    Tt,
    /// Barycentric dynamical time. It stays within 2 ms of TT (IERS Conventions 2010, section 10.1) and is taken from it by the seven largest terms of their difference, to 10 µs.
    Tdb,
    /// The time of GPS: 19 s behind TAI.
    Gps,
}

impl Scale {
    /// The scale of that name: UTC, TAI, TT, TDB or GPS, in letters of any case.
    pub fn named(name: &str) -> Option<Self> {
        Some(match name.to_ascii_lowercase().as_str() {
            "utc" => Self::Utc,
            "tai" => Self::Tai,
            "tt" => Self::Tt,
            "tdb" => Self::Tdb,
            "gps" => Self::Gps,
            _ => return None,
        })
    }
}

/// The moment of a day and a part of it in a time scale; `None` before 1972 or after 2100. `day` is a Modified Julian Date.
pub fn moment(day: i64, part: f64, scale: Scale) -> Option<Epoch> {
    if !part.is_finite() {
        return None;
    }
    let (day, part) = (day.checked_add(part.floor() as i64)?, part - part.floor());
    of_day(day, (part * 86_400.0 * 1e9).round() as i128, scale)
}

/// The moment so many nanoseconds after the begin of a day.
fn of_day(mjd: i64, ns: i128, scale: Scale) -> Option<Epoch> {
    let day = UtcDay::of_mjd(mjd)?;
    let first = i128::from(mjd - MJD_1900) * DAY_NS;
    let ahead_s = match scale {
        Scale::Utc => None,
        Scale::Tai => Some(0.0),
        Scale::Gps => Some(TAI_MINUS_GPS_S),
        Scale::Tt => Some(-TT_MINUS_TAI_S),
        Scale::Tdb => {
            let days = (mjd - 51_544) as f64 + ns as f64 / DAY_NS as f64 - 0.5;
            Some(-TT_MINUS_TAI_S - tdb_minus_tt_s(days))
        }
    };
    let tai = match ahead_s {
        None => day.start_tai_ns + ns,
        Some(s) => first + ns + (s * 1e9).round() as i128,
    };
    Some(Epoch::from_tai_duration(Duration::from_total_nanoseconds(tai)))
}

/// TDB − TT at a date of TT, days from 2000-01-01T12:00 (Kaplan 2005, USNO Circular 179, eq. 2.6: to 10 µs from 1600 to 2200; within 9.3 µs of ERFA's `dtdb` from 1972 to 2100).
fn tdb_minus_tt_s(days: f64) -> f64 {
    let t = days / 36_525.0;
    let term = |amplitude_s: f64, rate: f64, phase: f64| amplitude_s * (rate * t + phase).sin();
    term(0.001_657, 628.3076, 6.2401)
        + term(0.000_022, 575.3385, 4.2970)
        + term(0.000_014, 1256.6152, 6.1969)
        + term(0.000_005, 606.9777, 4.0212)
        + term(0.000_005, 52.9691, 0.4444)
        + term(0.000_002, 21.3299, 5.5431)
        + t * term(0.000_010, 628.3076, 4.2490)
}

/// The instant of a text in a time scale, as other programs write it: `2026-03-04T05:06:07.89`, with the day of the year (`2026-063T05:06:07`), or with the day first (`04.03.2026 05:06:07`).
/// A `Z` at its end says nothing more. Decimals of a second beyond the ninth are left out. Second 60 is only one of UTC.
///
/// # Errors
/// [`UtcError`] says what stands there and what should.
///
/// ```
/// use sunglint_formats::time::{Scale, format_utc, parse_in};
///
/// assert_eq!(format_utc(parse_in("2026-063T05:06:07", Scale::Utc)?, 0), "2026-03-04T05:06:07Z");
/// assert_eq!(format_utc(parse_in("2026-03-04T05:06:07", Scale::Gps)?, 0), "2026-03-04T05:05:49Z");
/// # Ok::<(), sunglint_formats::time::UtcError>(())
/// ```
pub fn parse_in(text: &str, scale: Scale) -> Result<Epoch, UtcError> {
    let text = text.trim();
    let (date, clock) = split(text.strip_suffix(['Z', 'z']).unwrap_or(text));
    let date = calendar(text, date)?;
    let clock = clock.map(nine_decimals);
    let at = Digits::read(text, &date, clock, 0, scale == Scale::Utc)?;
    of_day(at.mjd, at.nanoseconds, scale).ok_or_else(|| at.outside(text))
}
