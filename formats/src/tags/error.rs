//! Errors of a request about tags.

use crate::FileError;

/// Why tags could not be cut, binned or handed on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TagError {
    /// The bytes are no whole number of records.
    #[error(
        "{bytes} bytes are {records} whole records of 16 bytes and {torn} bytes of one that is torn, at byte {at_byte}"
    )]
    NotWhole {
        /// How many bytes there are.
        bytes: usize,
        /// How many whole records.
        records: usize,
        /// How many bytes are left over.
        torn: usize,
        /// Where the torn record begins, bytes.
        at_byte: usize,
    },
    /// A tag is earlier than the one before it, so that times cannot be searched.
    #[error(
        "the tags are not in time: record {record} (byte {}) is at {time_ps} ps, after one at {before_ps} ps; binning needs no order, cutting does",
        record * 16
    )]
    Unsorted {
        /// The record, counted from 0.
        record: u64,
        /// Time of the tag, ps.
        time_ps: i64,
        /// The time of the record before it, ps.
        before_ps: i64,
    },
    /// A bin has to have a length.
    #[error("a bin of {width_ps} ps: it has to be at least 1 ps wide")]
    Width {
        /// The width that was asked for, ps.
        width_ps: i64,
    },
    /// The span is empty or runs backwards.
    #[error("from {from_ps} ps to {to_ps} ps is no span: the end has to be later than the start")]
    Span {
        /// Start, ps.
        from_ps: i64,
        /// End, ps (exclusive).
        to_ps: i64,
    },
    /// No channel was asked for, or one twice.
    #[error("the channels {channels:?}: each has to be named once, and at least one")]
    Channels {
        /// Requested channels.
        channels: Vec<i32>,
    },
    /// The bins would not fit into memory.
    #[error(
        "{bins} bins of {channels} channels are more than the {most} counts that are kept at once: take wider bins or a shorter span"
    )]
    TooManyBins {
        /// How many bins the span has.
        bins: u64,
        /// How many channels.
        channels: usize,
        /// The most counts (bins × channels) that are kept, [`MOST_CELLS`](super::MOST_CELLS).
        most: u64,
    },
    /// Names and channels differ in number.
    #[error("{names} names for {channels} channels: give one for each, in their order")]
    Names {
        /// How many names.
        names: usize,
        /// How many channels.
        channels: usize,
    },
    /// The file could not be read.
    #[error(transparent)]
    File(#[from] FileError),
}
