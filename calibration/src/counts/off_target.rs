//! Rates of a channel beside the targets: sky and dark counts, measured together.

use super::spans::{Seen, Spans, View};
use super::{Bin, CountChannel};
use crate::detector::Linear;
use hifitime::{Duration, Epoch};
use sunglint_formats::CountFlags;
use sunglint_numerics::order::{median, robust_sigma};

/// How the off-target rate is taken between two pieces.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Between {
    /// On the line between them.
    #[default]
    Linear,
    /// The mean of both.
    Constant,
}

/// How off-target rates are measured and used.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OffOptions {
    /// Longer stretches are cut into pieces of this length, s, so that they follow the sky.
    pub piece_s: f64,
    /// Fewer bins make no piece.
    pub least_bins: usize,
    /// Bins this many σ from the median of their piece are left out: a star that passed through.
    pub clip_sigmas: f64,
    /// How the rate is taken between pieces.
    pub between: Between,
    /// A piece further than this, s, says nothing of a sample.
    pub near_s: f64,
}

impl Default for OffOptions {
    fn default() -> Self {
        Self {
            piece_s: 60.0,
            least_bins: 3,
            clip_sigmas: 5.0,
            between: Between::Linear,
            near_s: 1800.0,
        }
    }
}

/// A rate that was measured off the target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OffRate {
    /// The linear rate, Hz.
    pub rate_hz: f64,
    /// Standard uncertainty of the rate, Hz: from counting, or from the scatter of the bins where that is larger.
    pub sigma_hz: f64,
    /// Bins in it.
    pub bins: usize,
    /// Bins that were left out as outliers.
    pub clipped: usize,
    /// Bins that were left out by a flag or by saturation.
    pub excluded: usize,
}

/// A piece of an off-target stretch.
#[derive(Debug, Clone, PartialEq)]
pub struct OffPiece {
    /// Middle of the piece.
    pub time: Epoch,
    /// Sky or dark.
    pub view: View,
    /// Rate of each channel; `None` where too few bins were left.
    pub rates: Vec<Option<OffRate>>,
}

/// Where a background came from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BackgroundSource {
    /// Off-target pieces before and after.
    Between,
    /// One off-target piece, before or after: whatever the sky did since is not known.
    Nearest,
    /// The nearest dark piece: the sky is missing.
    Dark,
    /// The station's dark rate: the sky is missing.
    Station,
}

/// The rate to subtract from a sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Background {
    /// It, Hz.
    pub rate_hz: f64,
    /// Standard uncertainty of the background, Hz; it is not known for a station's dark rate.
    pub sigma_hz: f64,
    /// Where it came from.
    pub source: BackgroundSource,
}

/// The off-target rates of a night.
#[derive(Debug, Clone, PartialEq)]
pub struct OffTarget {
    pieces: Vec<OffPiece>,
    options: OffOptions,
    station_hz: Vec<f64>,
}

impl OffTarget {
    /// Measures the off-target spans: one run over the bins, which holds one piece at a time.
    ///
    /// # Errors
    /// Those of the bins.
    pub fn measure<E>(
        bins: impl IntoIterator<Item = Result<Bin, E>>,
        channels: &[CountChannel],
        spans: &Spans,
        options: &OffOptions,
    ) -> Result<Self, E> {
        let mut pieces = Vec::new();
        let mut open: Option<Open> = None;
        for bin in bins {
            let bin = bin?;
            let key = match spans.seen(bin.record.start, bin.end()) {
                Seen::Whole(view @ (View::Sky | View::Dark), span) => Some((view, span)),
                _ => None,
            };
            let continues = open.as_ref().is_some_and(|open| {
                let length_s = (bin.end() - open.from).to_seconds();
                Some((open.view, open.span)) == key && (0.0..=options.piece_s).contains(&length_s)
            });
            if !continues {
                pieces.extend(open.take().map(|open| open.close(channels, options)));
            }
            let Some((view, span)) = key else { continue };
            let start = bin.record.start;
            let open = open.get_or_insert_with(|| Open::new(view, span, start, channels.len()));
            open.add(&bin, channels);
        }
        pieces.extend(open.map(|open| open.close(channels, options)));
        pieces.sort_by_key(|piece| piece.time);
        let station_hz = channels.iter().map(|channel| channel.dark_rate_hz).collect();
        Ok(Self { pieces, options: *options, station_hz })
    }

    /// The pieces, in the order of time.
    pub fn pieces(&self) -> &[OffPiece] {
        &self.pieces
    }

    /// The background of a channel, by its number, at a time. Between two pieces the uncertainty holds how far the sky may have left the line: the sag
    /// w(1−w)|Δ| of a parabola that turns at one of them (|Δ|/√12 for [`Between::Constant`]).
    pub fn at(&self, time: Epoch, channel: usize) -> Background {
        let near =
            |piece: &&OffPiece| (piece.time - time).to_seconds().abs() <= self.options.near_s;
        let rate = |piece: &OffPiece| Some((piece.time, piece.rates.get(channel).copied()??));
        let next = self.pieces.partition_point(|piece| piece.time <= time);
        let nearest = |view: View| {
            let found = |piece: &OffPiece| (piece.view == view).then(|| rate(piece)).flatten();
            let before = self.pieces[..next].iter().rev().take_while(near).find_map(found);
            (before, self.pieces[next..].iter().take_while(near).find_map(found))
        };
        let single = |(_, rate): (Epoch, OffRate), source| Background {
            rate_hz: rate.rate_hz,
            sigma_hz: rate.sigma_hz,
            source,
        };
        match nearest(View::Sky) {
            (Some((t1, one)), Some((t2, two))) => {
                let part = (time - t1).to_seconds() / (t2 - t1).to_seconds();
                let change = two.rate_hz - one.rate_hz;
                let (w, drift) = match self.options.between {
                    Between::Linear => (part, part * (1.0 - part) * change),
                    Between::Constant => (0.5, change / 12.0_f64.sqrt()),
                };
                let parts = [(1.0 - w) * one.sigma_hz, w * two.sigma_hz, drift];
                Background {
                    rate_hz: one.rate_hz + w * change,
                    sigma_hz: parts.iter().map(|part| part * part).sum::<f64>().sqrt(),
                    source: BackgroundSource::Between,
                }
            }
            (Some(one), None) | (None, Some(one)) => single(one, BackgroundSource::Nearest),
            (None, None) => {
                let (before, after) = nearest(View::Dark);
                let apart = |(at, _): &(Epoch, OffRate)| (*at - time).to_seconds().abs();
                let dark = before.into_iter().chain(after);
                match dark.min_by(|a, b| apart(a).total_cmp(&apart(b))) {
                    Some(dark) => single(dark, BackgroundSource::Dark),
                    None => Background {
                        rate_hz: self.station_hz.get(channel).copied().unwrap_or(0.0),
                        sigma_hz: 0.0,
                        source: BackgroundSource::Station,
                    },
                }
            }
        }
    }
}

/// A piece that is still being read.
struct Open {
    view: View,
    span: usize,
    from: Epoch,
    to: Epoch,
    channels: Vec<OpenChannel>,
}

/// Bins of one channel in a piece that is still open.
#[derive(Clone, Default)]
struct OpenChannel {
    /// Rate, counts, exposure.
    bins: Vec<(Linear, u64, f64)>,
    excluded: usize,
}

/// Flags of bins whose counts are not the light's.
const SPOILT: CountFlags = CountFlags::OVERFLOW
    .union(CountFlags::MISSED)
    .union(CountFlags::SATURATED)
    .union(CountFlags::ERROR);

impl Open {
    fn new(view: View, span: usize, from: Epoch, channels: usize) -> Self {
        Self { view, span, from, to: from, channels: vec![OpenChannel::default(); channels] }
    }

    fn add(&mut self, bin: &Bin, channels: &[CountChannel]) {
        self.to = bin.end();
        for (channel, open) in channels.iter().zip(&mut self.channels) {
            let counts = bin.record.counts.get(channel.column).copied();
            let missed = bin.record.missed.get(channel.column).is_some_and(|missed| *missed > 0);
            let exposure_s = bin.exposure_s();
            let linear = counts.and_then(|n| channel.linearity.linearise(n, exposure_s).ok());
            match (linear, counts) {
                (Some(linear), Some(counts)) if !missed && !bin.record.flags.intersects(SPOILT) => {
                    open.bins.push((linear, counts, exposure_s));
                }
                _ => open.excluded += 1,
            }
        }
    }

    fn close(self, channels: &[CountChannel], options: &OffOptions) -> OffPiece {
        let time = self.from + Duration::from_seconds(0.5 * (self.to - self.from).to_seconds());
        let rates = channels.iter().zip(self.channels);
        let rates = rates.map(|(channel, open)| off_rate(channel, open, options));
        OffPiece { time, view: self.view, rates: rates.collect() }
    }
}

/// The rate of all bins together, without outliers.
fn off_rate(channel: &CountChannel, open: OpenChannel, options: &OffOptions) -> Option<OffRate> {
    let OpenChannel { mut bins, excluded } = open;
    let all = bins.len();
    let middle = median(bins.iter().map(|(linear, ..)| linear.rate_hz))?;
    let off = |linear: &Linear| (linear.rate_hz - middle).abs();
    let spread = robust_sigma(bins.iter().map(|(linear, ..)| off(linear)))?;
    // Of few counts the median deviation may be nothing.
    let noise = median(bins.iter().map(|(linear, ..)| linear.sigma_hz))?;
    bins.retain(|(linear, ..)| off(linear) <= options.clip_sigmas * spread.max(noise));
    if bins.len() < options.least_bins.max(1) {
        return None;
    }
    let counts: u64 = bins.iter().map(|(_, counts, _)| counts).sum();
    let exposure_s: f64 = bins.iter().map(|(.., exposure_s)| exposure_s).sum();
    let pooled = channel.linearity.linearise(counts, exposure_s).ok()?;
    // The bins' scatter about the pooled rate, against what counting explains of it.
    let chi2: f64 = bins
        .iter()
        .map(|(linear, _, bin_s)| {
            (linear.rate_hz - pooled.rate_hz).powi(2)
                / (pooled.sigma_hz.powi(2) * exposure_s / bin_s)
        })
        .sum();
    let reduced = chi2 / (bins.len().max(2) - 1) as f64;
    Some(OffRate {
        rate_hz: pooled.rate_hz,
        sigma_hz: pooled.sigma_hz * reduced.max(1.0).sqrt(),
        bins: bins.len(),
        clipped: all - bins.len(),
        excluded,
    })
}
