//! Rates of a channel beside the targets: sky and dark counts, measured together.

use super::sky_level::{Brightness, SkyLevels};
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
    /// Length of the piece, s.
    pub length_s: f64,
    /// Sky or dark.
    pub view: View,
    /// Rate of each channel; `None` where too few bins were left.
    pub rates: Vec<Option<OffRate>>,
}

/// Where a background came from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BackgroundSource {
    /// Off-target pieces before and after that hardly differ, and on the line between them, or their mean.
    Between,
    /// Off-target pieces before and after that differ, and on the line between them, because the camera's frames tell it no better.
    OnLine(NotCarried),
    /// Off-target pieces before and after, and between them as the sky went in the camera's frames.
    Carried,
    /// One off-target piece, before or after: whatever the sky did since is not known.
    Nearest,
    /// The nearest dark piece: the sky is missing.
    Dark,
    /// The station's dark rate: the sky is missing.
    Station,
}

/// Why a sky that changed between two pieces does not go as in the camera's frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum NotCarried {
    /// There are too few frames at the time or in one of the pieces.
    NoFrames,
    /// There are frames at the time and in both pieces, but not with the same setting (exposure, gain, binning, window, filter) in all three.
    OtherSettings,
    /// The camera's sky did not change as the channel's did.
    OtherChange,
    /// The frames do not tell it better than the line.
    NoBetter,
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
    sky: SkyLevels,
    /// The camera's sky in each piece, for each of its settings.
    sky_of_pieces: Vec<Vec<Option<Brightness>>>,
    /// Whether there are frames in each piece, of whatever setting.
    seen_in_pieces: Vec<bool>,
}

/// Exponents by which a channel's sky may change with the camera's, and both still be the same sky in other colours: twice as fast or half as fast, in magnitudes. Beyond these another light came or went.
const EXPONENTS: (f64, f64) = (0.5, 2.0);
/// A sky changed if its brightness differs by so many standard errors.
const CHANGED_SIGMAS: f64 = 5.0;

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
        let sky = SkyLevels::default();
        let (sky_of_pieces, seen_in_pieces) = (Vec::new(), Vec::new());
        Ok(Self { pieces, options: *options, station_hz, sky, sky_of_pieces, seen_in_pieces })
    }

    /// Takes the sky between the pieces from a camera's frames, where they tell it better than the line between the pieces.
    #[must_use]
    pub fn carried_by(mut self, sky: SkyLevels) -> Self {
        let over = |setting: usize, piece: &OffPiece| {
            let looked = piece.view == View::Sky;
            looked.then(|| sky.over(setting, piece.time, piece.length_s)).flatten()
        };
        self.sky_of_pieces = (0..sky.settings())
            .map(|setting| self.pieces.iter().map(|piece| over(setting, piece)).collect())
            .collect();
        self.seen_in_pieces = self.pieces.iter().map(|piece| sky.is_near(piece.time)).collect();
        self.sky = sky;
        self
    }

    /// The rate between two pieces as the sky went in the camera's frames, and its standard uncertainty but for that of the pieces, Hz. The sky of a channel is
    /// a power of the camera's, which both pieces fix: where twilight changes its colour, both skies change exponentially, each at a rate of its own. Half of the
    /// difference from a straight line in the camera's brightness is in the uncertainty.
    fn carried(
        &self,
        time: Epoch,
        dark_hz: f64,
        pieces: [usize; 2],
        rates_hz: [f64; 2],
    ) -> Result<Carried, NotCarried> {
        let mut changes_otherwise = false;
        for (setting, over) in self.sky_of_pieces.iter().enumerate() {
            let [one, two] = pieces.map(|piece| over.get(piece).copied().flatten());
            let (Some(one), Some(two)) = (one, two) else { continue };
            let Some(here) = self.sky.at(setting, time) else { continue };
            match Carried::of(here, [one, two], rates_hz, dark_hz) {
                Some(carried) => return Ok(carried),
                None => changes_otherwise = true,
            }
        }
        let in_pieces =
            pieces.iter().all(|piece| self.seen_in_pieces.get(*piece).is_some_and(|seen| *seen));
        Err(match changes_otherwise {
            true => NotCarried::OtherChange,
            false if in_pieces && self.sky.is_near(time) => NotCarried::OtherSettings,
            false => NotCarried::NoFrames,
        })
    }

    /// Rate without light of a channel, Hz: that of the nearest dark piece, else the station's.
    fn dark_hz(&self, time: Epoch, channel: usize) -> f64 {
        let of_it = |piece: &OffPiece| Some((piece.time, rate_of(piece, channel)?));
        let dark = self.pieces.iter().filter(|piece| piece.view == View::Dark).filter_map(of_it);
        let apart = |at: &Epoch| (*at - time).to_seconds().abs();
        let nearest = dark.min_by(|a, b| apart(&a.0).total_cmp(&apart(&b.0)));
        let station_hz = self.station_hz.get(channel).copied().unwrap_or(0.0);
        nearest.map_or(station_hz, |(_, rate)| rate.rate_hz)
    }

    /// The pieces, in the order of time.
    pub fn pieces(&self) -> &[OffPiece] {
        &self.pieces
    }

    /// The background of a channel, by its number, at a time. Between two pieces it goes as the sky in the camera's frames ([`OffTarget::carried_by`]), or on a line: then the uncertainty holds how far the sky may have left the line: the sag
    /// w(1−w)|Δ| of a parabola that turns at one of them (|Δ|/√12 for [`Between::Constant`]).
    pub fn at(&self, time: Epoch, channel: usize) -> Background {
        let near =
            |piece: &&OffPiece| (piece.time - time).to_seconds().abs() <= self.options.near_s;
        let next = self.pieces.partition_point(|piece| piece.time <= time);
        let nearest = |view: View| {
            let found = |piece: &OffPiece| piece.view == view && rate_of(piece, channel).is_some();
            let before = (0..next).rev().take_while(|k| near(&&self.pieces[*k]));
            let after = (next..self.pieces.len()).take_while(|k| near(&&self.pieces[*k]));
            let (mut before, mut after) = (before, after);
            let is_found = |k: &usize| found(&self.pieces[*k]);
            [before.find(is_found), after.find(is_found)]
                .map(|k| Some((k?, rate_of(&self.pieces[k?], channel)?)))
        };
        let single = |(_, rate): (usize, OffRate), source| Background {
            rate_hz: rate.rate_hz,
            sigma_hz: rate.sigma_hz,
            source,
        };
        match nearest(View::Sky) {
            [Some((before, one)), Some((after, two))] => {
                let [from, to] = [before, after].map(|k| self.pieces[k].time);
                let part = (time - from).to_seconds() / (to - from).to_seconds();
                let change = two.rate_hz - one.rate_hz;
                let (w, drift) = match self.options.between {
                    Between::Linear => (part, part * (1.0 - part) * change),
                    Between::Constant => (0.5, change / 12.0_f64.sqrt()),
                };
                let of = |rate_hz: f64, w: f64, drift: f64, source| {
                    let parts = [(1.0 - w) * one.sigma_hz, w * two.sigma_hz, drift];
                    let sigma_hz = parts.iter().map(|part| part * part).sum::<f64>().sqrt();
                    Background { rate_hz, sigma_hz, source }
                };
                let line = |source| of(one.rate_hz + w * change, w, drift, source);
                let changed = change.abs() > CHANGED_SIGMAS * one.sigma_hz.hypot(two.sigma_hz);
                if !changed || self.options.between != Between::Linear {
                    return line(BackgroundSource::Between);
                }
                if self.sky_of_pieces.is_empty() {
                    return line(BackgroundSource::OnLine(NotCarried::NoFrames));
                }
                let rates_hz = [one.rate_hz, two.rate_hz];
                let dark_hz = self.dark_hz(time, channel);
                match self.carried(time, dark_hz, [before, after], rates_hz) {
                    Ok(Carried { rate_hz, part, sigma_hz }) if sigma_hz < drift.abs() => {
                        of(rate_hz, part, sigma_hz, BackgroundSource::Carried)
                    }
                    Ok(_) => line(BackgroundSource::OnLine(NotCarried::NoBetter)),
                    Err(why) => line(BackgroundSource::OnLine(why)),
                }
            }
            [Some(one), None] | [None, Some(one)] => single(one, BackgroundSource::Nearest),
            [None, None] => {
                let apart =
                    |(k, _): &(usize, OffRate)| (self.pieces[*k].time - time).to_seconds().abs();
                let dark = nearest(View::Dark).into_iter().flatten();
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

/// Rate of a channel in a piece.
fn rate_of(piece: &OffPiece, channel: usize) -> Option<OffRate> {
    piece.rates.get(channel).copied().flatten()
}

/// A rate between two pieces as the camera's sky went.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Carried {
    rate_hz: f64,
    /// Part of the second piece in it.
    part: f64,
    /// Standard uncertainty but for that of the pieces, Hz.
    sigma_hz: f64,
}

impl Carried {
    /// From the camera's sky at a time and in both pieces, and the channel's rates in them.
    fn of(
        here: Brightness,
        [one, two]: [Brightness; 2],
        [first_hz, last_hz]: [f64; 2],
        dark_hz: f64,
    ) -> Option<Self> {
        let change = two.level - one.level;
        if change.abs() < CHANGED_SIGMAS * one.sigma.hypot(two.sigma) {
            return None;
        }
        let part = (here.level - one.level) / change;
        if !(-0.2..=1.2).contains(&part) {
            return None;
        }
        let straight_hz = first_hz + part * (last_hz - first_hz);
        let exponent =
            ((last_hz - dark_hz) / (first_hz - dark_hz)).ln() / (two.level / one.level).ln();
        // NaN where one of them is not above what is seen without light.
        let is_likely = (EXPONENTS.0..=EXPONENTS.1).contains(&exponent);
        let power_hz = dark_hz + (first_hz - dark_hz) * (here.level / one.level).powf(exponent);
        if !(is_likely && power_hz.is_finite()) {
            return None;
        }
        let levels = [here.sigma, (1.0 - part) * one.sigma, part * two.sigma];
        let noise = levels.iter().map(|sigma| sigma * sigma).sum::<f64>().sqrt() / change.abs();
        let sigma_hz = (noise * (last_hz - first_hz)).hypot(0.5 * (power_hz - straight_hz));
        Some(Self { rate_hz: power_hz, part, sigma_hz })
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
        let length_s = (self.to - self.from).to_seconds();
        let time = self.from + Duration::from_seconds(0.5 * length_s);
        let rates = channels.iter().zip(self.channels);
        let rates = rates.map(|(channel, open)| off_rate(channel, open, options));
        OffPiece { time, length_s, view: self.view, rates: rates.collect() }
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
