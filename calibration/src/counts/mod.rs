//! Bins of a photon counter, turned into the linear rate of a target alone.
//!
//! Two runs over the bins of a night, each in flat memory:
//!
//! 1. [`OffTarget::measure`] finds what the channels show beside the targets: sky and dark counts together, piece by piece.
//! 2. [`Reduction`] turns each bin of a visit into a [`Sample`]: ν = lin(m_on) − lin(m_off), the off-target rate between the
//!    pieces on either side as the camera's sky went ([`SkyLevels`]), or in time, kept where the target stood in the fibre's field and divided by the coupling there.
//!
//! [`Curves`] collects samples into a raw and a linear light curve, [`Summary`] counts what each rule did. Nothing is left out without a flag:
//!
//! | flag | when | rate |
//! |---|---|---|
//! | `SATURATED` | the counter says so, or its law ([`crate::detector`]) | NaN |
//! | `NONLINEAR` | beyond where the law is trusted | kept |
//! | `FAST_GLINT` | light may have changed within the bin by more than can be linearised | kept |
//! | `OVERFLOW` | events overflowed or were missed: a lower bound | kept |
//! | `GAP` | no bin here, or the counter reported an error in it | NaN |
//! | `GAP` | the counter says that bins are missing before, and its clock does not show how many | kept |
//! | `OFF_TARGET` | not on the target for the whole of the bin | NaN |
//! | `UNDETECTED` | the frames on either side do not both show the target | NaN |
//! | `OFF_AXIS` | outside the gate | NaN |
//! | `NO_OFF_TARGET` | no off-target piece near: the dark rate stands in | kept |
//! | `CLOCK_FREE` | the time is the computer's | kept |
//!
//! σ holds counting on and off the target, and the coupling's uncertainty from the target's place. The background's and the place's parts are common to
//! neighbouring samples.
//!
//! # From bins to a linear rate
//!
//! Ten seconds of sky beside the target, then ten seconds of the target:
//!
//! ```
//! use hifitime::{Epoch, Unit};
//! use std::convert::Infallible;
//! use sunglint_calibration::counts::{
//!     Bin, CountChannel, OffOptions, OffTarget, Options, Reduction, Span, Spans, View,
//! };
//! use sunglint_calibration::detector::Linearity;
//! use sunglint_formats::{CountFlags, CountRecord};
//! use sunglint_radiometry::station::DeadTime;
//!
//! let start = Epoch::from_gregorian_utc_at_midnight(2026, 11, 21);
//! let bin = |second: i64| Bin::from(CountRecord {
//!     start: start + second as f64 * Unit::Second,
//!     start_ps: second * 1_000_000_000_000,
//!     length_ps: 1_000_000_000_000,
//!     counts: vec![if second < 10 { 100 } else { 1000 }],
//!     missed: vec![0],
//!     flags: CountFlags::empty(),
//! });
//! let bins = || (0..20).map(|second| Ok::<_, Infallible>(bin(second)));
//! let linearity = Linearity::new(&DeadTime::None)?;
//! let channels =
//!     [CountChannel { name: "spad".into(), column: 0, linearity, dark_rate_hz: 0.0, fibre: None }];
//! let at = |s: f64| start + s * Unit::Second;
//! let spans = Spans::new([
//!     Span { from: at(0.0), to: at(10.0), view: View::Sky },
//!     Span { from: at(10.0), to: at(20.0), view: View::Target(0) },
//! ]);
//! let off = OffTarget::measure(bins(), &channels, &spans, &OffOptions::default())?;
//! let samples: Vec<_> =
//!     Reduction::new(bins(), &channels, &spans, &[], &off, Options::default()).collect::<Result<_, _>>()?;
//! assert_eq!(samples.len(), 10);
//! assert!((samples[5].channels[0].rate_hz - 900.0).abs() < 1e-6);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod curves;
mod gate;
mod off_target;
mod reduction;
mod skies;
mod sky_level;
mod spans;

pub use curves::{ChannelSummary, Curves, Summary};
pub use gate::{Coupling, Gate, coupling};
pub use off_target::{
    Background, BackgroundSource, Between, NotCarried, OffOptions, OffPiece, OffRate, OffTarget,
};
pub use reduction::{ChannelSample, Options, Reduction, Sample};
pub use skies::SkyTally;
pub use sky_level::{SkyLevel, SkyLevels};
pub use spans::{Away, Seen, Span, Spans, View, away};

use crate::detector::{DetectorError, Linearity};
use sunglint_formats::CountRecord;
use sunglint_radiometry::station::{Counter, Fibre};

/// A channel of a counter.
#[derive(Debug, Clone, PartialEq)]
pub struct CountChannel {
    /// Name of the channel in the station, and in light curves.
    pub name: String,
    /// Which of the counter's channels it is, from 0.
    pub column: usize,
    /// Linearity law of the channel.
    pub linearity: Linearity,
    /// Dark rate of the channel, Hz, where nothing was measured.
    pub dark_rate_hz: f64,
    /// Where its fibre looks; `None` for a detector that needs no gate.
    pub fibre: Option<Fibre>,
}

impl CountChannel {
    /// A channel of a station's counter.
    ///
    /// # Errors
    /// A law that no detector can have.
    pub fn of(name: &str, column: usize, counter: &Counter) -> Result<Self, DetectorError> {
        Ok(Self {
            name: name.to_owned(),
            column,
            linearity: Linearity::of(counter)?,
            dark_rate_hz: counter.dark_rate_hz,
            fibre: counter.fibre,
        })
    }
}

/// A bin, with the time tags in it where they were kept.
#[derive(Debug, Clone, PartialEq)]
pub struct Bin {
    /// The counter's record.
    pub record: CountRecord,
    /// Tags of each channel in the bin, ps on the clock of [`CountRecord::start_ps`], in order; `None`, or no entry, without tags.
    pub tags_ps: Vec<Option<Vec<i64>>>,
}

impl From<CountRecord> for Bin {
    fn from(record: CountRecord) -> Self {
        Self { record, tags_ps: Vec::new() }
    }
}

impl Bin {
    fn exposure_s(&self) -> f64 {
        // A division rounds 0.1 s to 0.1; a product does not.
        self.record.length_ps as f64 / 1e12
    }

    fn middle(&self) -> hifitime::Epoch {
        self.after_ps(self.record.length_ps / 2)
    }

    fn end(&self) -> hifitime::Epoch {
        self.after_ps(self.record.length_ps)
    }

    /// So long after its start, to the nanosecond.
    fn after_ps(&self, ps: i64) -> hifitime::Epoch {
        self.record.start + hifitime::Duration::from_total_nanoseconds(i128::from(ps) / 1000)
    }

    /// End on the counter's clock, ps.
    fn end_ps(&self) -> i64 {
        self.record.start_ps.saturating_add(self.record.length_ps)
    }
}
