//! A measured light curve beside a simulated one of the same epochs: what they differ by, and what each claims of itself.
//!
//! In the order in which data flows through it:
//!
//! - [`overlap`], [`in_order`]: whether two spans of time meet, whether times increase;
//! - [`Given`]: a channel as it comes, measured and simulated; [`Channel`]: which of its samples count, why the others do not, and what those that do say
//!   ([`Numbers`]);
//! - [`Bin`]: the same against phase angle, airmass or time;
//! - [`Ratio`]: channels over one another, measured and simulated;
//! - [`time_shift`]: whether the curves lie beside each other in time.
//!
//! The *scale* of a channel is all the light that was measured over all that was simulated, Σ t m / Σ t s over the samples with exposures t. It needs no weights:
//! such by the samples' own σ favour those that came out faint (by 1/N for N photons a sample). Its uncertainty is stated twice: as the samples' own σ make it, and
//! as blocks of time differ from one another (a jackknife), which knows of twinkling, clouds and a model that is wrong.
//!
//! Magnitudes are compared as such: their uncertainties are shares of the light, of which the mean is more than the light (by half the square of the share). There the scale is exp of the mean of
//! ln(m/s), weighted by the samples' own uncertainties.

mod bins;
mod blocks;
mod channel;
mod ratio;
mod shift;

pub use bins::{Axis, Bin, bins, edges};
pub use blocks::{BLOCKS, Blocks, student_95};
pub use channel::{Channel, Chi2, Given, LeftOut, MaterialBudget, Numbers, Reason};
pub use ratio::{Moment, Ratio};
pub use shift::{TimeShift, time_shift};

use hifitime::Epoch;
use sunglint_formats::time::{format_utc, tai_nanoseconds};

/// Flags that a sample may carry and still be compared: what they say is in its uncertainty, or does not change its rate.
pub use sunglint_radiometry::light_curve::TOLERATED;

/// Why there is nothing to compare.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ComparisonError {
    /// The measurement has no sample.
    #[error("there is no sample")]
    Empty,
    /// Times that do not increase.
    #[error(
        "time_utc, row {row}: {time} comes after {before} of the row before: sort the samples by time"
    )]
    OutOfOrder {
        /// The row, from 1.
        row: usize,
        /// Time of the row.
        time: String,
        /// That of the row before.
        before: String,
    },
    /// Measured and simulated spans do not meet.
    #[error(
        "measured from {measured_from} to {measured_to}, simulated from {simulated_from} to {simulated_to}: the spans do not meet"
    )]
    NoOverlap {
        /// First measured time.
        measured_from: String,
        /// Last measured time.
        measured_to: String,
        /// First simulated time.
        simulated_from: String,
        /// Last simulated time.
        simulated_to: String,
    },
    /// No sample of any channel can be compared.
    #[error("no sample is left to compare: {}", .why.join("; "))]
    NothingLeft {
        /// Channel by channel, what left its samples out.
        why: Vec<String>,
    },
}

/// Whether times increase, or repeat (rows of several instruments may).
///
/// # Errors
/// [`ComparisonError::OutOfOrder`] at the first that does not; [`ComparisonError::Empty`].
pub fn in_order(times: &[Epoch]) -> Result<(), ComparisonError> {
    if times.is_empty() {
        return Err(ComparisonError::Empty);
    }
    match times.windows(2).position(|p| tai_nanoseconds(p[1]) < tai_nanoseconds(p[0])) {
        None => Ok(()),
        Some(i) => Err(ComparisonError::OutOfOrder {
            row: i + 2,
            time: format_utc(times[i + 1], 3),
            before: format_utc(times[i], 3),
        }),
    }
}

/// Which measured times lie within a simulated span, its ends included, with so much room (s) beyond them.
///
/// # Errors
/// [`ComparisonError::NoOverlap`] where none does.
pub fn overlap(
    times: &[Epoch],
    (from, to): (Epoch, Epoch),
    room_s: f64,
) -> Result<Vec<bool>, ComparisonError> {
    let ns = tai_nanoseconds;
    // A cast of a float saturates, and no span is as long as that.
    let room = (1e9 * room_s) as i128;
    let within: Vec<bool> =
        times.iter().map(|t| (ns(from) - room..=ns(to) + room).contains(&ns(*t))).collect();
    let (Some(first), Some(last)) = (times.first(), times.last()) else {
        return Err(ComparisonError::Empty);
    };
    if within.contains(&true) {
        return Ok(within);
    }
    let text = |t: Epoch| format_utc(t, 1);
    Err(ComparisonError::NoOverlap {
        measured_from: text(*first),
        measured_to: text(*last),
        simulated_from: text(from),
        simulated_to: text(to),
    })
}

/// Refuses channels of which no sample is left.
///
/// # Errors
/// [`ComparisonError::NothingLeft`] where that is so of all of them.
pub fn something_left(channels: &[Channel]) -> Result<(), ComparisonError> {
    if channels.iter().any(|c| c.numbers.is_some()) {
        return Ok(());
    }
    let why = channels.iter().map(|c| format!("{}: {}", c.name, c.left_out)).collect();
    Err(ComparisonError::NothingLeft { why })
}
