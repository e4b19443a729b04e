//! Bins made of the tag stream, and the tags themselves handed on.

use super::bridge::protocol;
use super::frame::{Bin, Frame};
use super::utc::Placement;
use crate::device::{DeviceError, TagSink};
use crate::tags::{BinStream, Tags};
use std::collections::VecDeque;
use sunglint_formats::{CountFlags, CountRecord};

/// The longest stretch that is believed, ps: ten minutes. A longer one is a clock that jumped.
const LONGEST_PS: i64 = 600_000_000_000_000;

/// A stream that is counted.
#[derive(Debug)]
pub(super) struct Streamed {
    channels: Vec<i32>,
    bin_ps: i64,
    sink: TagSink,
    /// From the first stretch on, which says where the stream's time stands.
    bins: Option<(BinStream, i64)>,
    placement: Placement,
    finished: VecDeque<CountRecord>,
}

impl Streamed {
    pub(super) fn new(channels: Vec<i32>, bin_ps: i64, sink: TagSink) -> Self {
        let (bins, placement, finished) = (None, Placement::default(), VecDeque::new());
        Self { channels, bin_ps, sink, bins, placement, finished }
    }

    /// The next finished bin, of those that have come.
    pub(super) fn next(&mut self) -> Option<CountRecord> {
        self.finished.pop_front()
    }

    /// Takes what the bridge sends.
    pub(super) fn take(&mut self, frame: Frame) -> Result<(), DeviceError> {
        match frame {
            Frame::Tags(records) => {
                if let Some((bins, _)) = &mut self.bins {
                    bins.add(Tags::of_records(&records));
                }
                self.sink.take(records);
                Ok(())
            }
            Frame::Bin(stretch) if stretch.counts.is_empty() => self.stretch(&stretch),
            _ => Err(protocol("a bin came, expected tags".into())),
        }
    }

    fn stretch(&mut self, stretch: &Bin) -> Result<(), DeviceError> {
        // The parser has looked that this is no overflow.
        let end_ps = stretch.start_ps.saturating_add(stretch.width_ps);
        let Some((bins, until_ps)) = &mut self.bins else {
            let bins = BinStream::new(&self.channels, self.bin_ps, end_ps);
            let bins = bins.map_err(|error| protocol(error.to_string()))?;
            self.bins = Some((bins, end_ps));
            return Ok(());
        };
        if stretch.start_ps != *until_ps || stretch.width_ps > LONGEST_PS {
            return Err(protocol(format!(
                "tags from {} to {end_ps} ps came after those up to {until_ps} ps: its clock jumped",
                stretch.start_ps
            )));
        }
        *until_ps = end_ps;
        while let Some(bin) = bins.finished(end_ps) {
            self.finished.push_back(CountRecord {
                start: self.placement.start_within(bin.start_ps, stretch),
                start_ps: bin.start_ps,
                length_ps: self.bin_ps,
                counts: bin.counts,
                missed: bin.missed,
                flags: bin.flags | CountFlags::CLOCK_FREE,
            });
            if bin.flags.contains(CountFlags::ERROR) {
                self.placement.forget();
            }
        }
        Ok(())
    }
}
