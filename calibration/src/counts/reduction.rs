//! The run over the bins of the visits.

use super::curves::Summary;
use super::gate::{Gate, over_bin, q};
use super::off_target::{BackgroundSource, OffTarget};
use super::spans::{Seen, Spans, View};
use super::{Bin, CountChannel};
use crate::detector::{Counted, DetectorError, FineBins, Glints, Linear};
use crate::track::{Place, Track};
use hifitime::{Duration, Epoch};
use std::collections::VecDeque;
use sunglint_formats::CountFlags;
use sunglint_numerics::measured::Measured;
use sunglint_radiometry::light_curve::Flags;

/// How bins become samples.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Options {
    /// The fibre's gate and coupling.
    pub gate: Gate,
    /// How tags are binned.
    pub fine: FineBins,
    /// When bins without tags are flagged for light that changed within them.
    pub glints: Glints,
}

/// One channel's part of a sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChannelSample {
    /// Rate as counted, Hz, and its standard uncertainty without regard to dead time; NaN where nothing was counted.
    pub measured_hz: Measured,
    /// The target's rate, linear, background subtracted, divided by the coupling, Hz; NaN where a flag excludes it.
    pub rate_hz: f64,
    /// Standard uncertainty of `rate_hz`, Hz; NaN where that is NaN.
    pub sigma_hz: f64,
    /// The part in it of the background, which was looked at a few times and taken off all samples, Hz; NaN where `rate_hz` is NaN.
    pub common_sigma_hz: f64,
    /// Background that was subtracted, and its standard uncertainty, Hz, before the coupling; NaN where none was subtracted.
    pub background_hz: Measured,
    /// Where the background came from; `None` where none was subtracted.
    pub background_from: Option<BackgroundSource>,
    /// The coupling and its standard uncertainty from the target's place; NaN where none was applied.
    pub coupling: Measured,
    /// Part of the events that the detector lost.
    pub lost_fraction: f64,
    /// Whether it was linearised in fine bins, from tags.
    pub from_tags: bool,
    /// Flags of the channel in this sample.
    pub flags: Flags,
}

/// A bin of a visit.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// The middle of the bin.
    pub time: Epoch,
    /// Length of the bin, s.
    pub exposure_s: f64,
    /// Which visit it belongs to.
    pub visit: usize,
    /// Where the target stood then, where the frames tell.
    pub place: Option<Place>,
    /// The channels, in their order.
    pub channels: Vec<ChannelSample>,
}

/// Samples from bins: an iterator that holds three bins at a time, and the summary of what it did.
pub struct Reduction<'a, I> {
    bins: I,
    channels: &'a [CountChannel],
    spans: &'a Spans,
    tracks: &'a [Track],
    wander: Vec<f64>,
    off: &'a OffTarget,
    options: Options,
    before: Option<Bin>,
    now: Option<Bin>,
    ready: VecDeque<Sample>,
    summary: Summary,
}

impl<'a, E, I: Iterator<Item = Result<Bin, E>>> Reduction<'a, I> {
    /// A run over the bins of one counter, in the order of time. `tracks` are those of the visits, by their number; one that is missing, or has no
    /// points, detects nothing.
    pub fn new(
        bins: impl IntoIterator<IntoIter = I>,
        channels: &'a [CountChannel],
        spans: &'a Spans,
        tracks: &'a [Track],
        off: &'a OffTarget,
        options: Options,
    ) -> Self {
        let wander = |track: &Track| {
            options.gate.wander_px2_per_s.unwrap_or_else(|| track.wander_px2_per_s())
        };
        Self {
            bins: bins.into_iter(),
            channels,
            spans,
            tracks,
            wander: tracks.iter().map(wander).collect(),
            off,
            options,
            before: None,
            now: None,
            ready: VecDeque::new(),
            summary: Summary::new(channels),
        }
    }

    /// Returns the summary of the work so far; it is complete once the iterator has ended.
    pub fn summary(&self) -> &Summary {
        &self.summary
    }

    /// Makes samples of the bin between two others.
    fn finish(&mut self, bin: &Bin, after: Option<&Bin>) {
        self.summary.bins += 1;
        if bin.record.length_ps <= 0 {
            self.summary.without_length += 1;
            return;
        }
        let hole_s = self.before.as_ref().and_then(|before| hole_s(before, bin));
        match hole_s {
            Some(hole_s) if hole_s > 0.0 => self.gap(bin, hole_s),
            Some(hole_s) if hole_s < 0.0 => self.summary.overlapping += 1,
            _ => {}
        }
        let visit = match self.spans.seen(bin.record.start, bin.end()) {
            Seen::Whole(View::Target(visit), _) | Seen::Partly(visit) => Some(visit),
            _ => self.spans.visit_at(bin.middle()),
        };
        let Some(visit) = visit else {
            self.summary.outside += 1;
            return;
        };
        let sample = self.sample(bin, after, visit, hole_s);
        self.push(sample);
    }

    /// A sample in place of the bins that are missing before this one, of the visit that their middle lies in.
    fn gap(&mut self, bin: &Bin, hole_s: f64) {
        let time = bin.record.start - Duration::from_seconds(0.5 * hole_s);
        let Some(visit) = self.spans.visit_at(time) else { return };
        let channels = vec![ChannelSample::nothing(Flags::GAP); self.channels.len()];
        self.push(Sample { time, exposure_s: hole_s, visit, place: None, channels });
    }

    fn push(&mut self, sample: Sample) {
        self.summary.add(&sample);
        self.ready.push_back(sample);
    }

    fn sample(&self, bin: &Bin, after: Option<&Bin>, visit: usize, hole_s: Option<f64>) -> Sample {
        let time = bin.middle();
        let track = self.tracks.get(visit);
        let wander = self.wander.get(visit).copied().unwrap_or(0.0);
        let place = track.and_then(|t| t.at(time, self.options.gate.apart_s, wander).ok());
        let place = place.map(|at| at.place);
        let mut common = Flags::empty();
        common.set(Flags::CLOCK_FREE, bin.record.flags.contains(CountFlags::CLOCK_FREE));
        common.set(Flags::OVERFLOW, bin.record.flags.contains(CountFlags::OVERFLOW));
        // Where the clock shows the hole it has a sample of its own.
        let unseen = bin.record.flags.contains(CountFlags::GAP) && hole_s.is_none_or(|s| s <= 0.0);
        common.set(Flags::GAP, unseen);
        let on_target = self.spans.seen(bin.record.start, bin.end());
        let on_target = matches!(on_target, Seen::Whole(View::Target(_), _));
        common.set(Flags::OFF_TARGET, !on_target);
        let channels = self.channels.iter().enumerate().map(|(number, channel)| {
            let mut sample = self.count(bin, after, number, common);
            self.gate(&mut sample, channel, bin, visit, place);
            sample.exclude(bin.record.flags);
            sample
        });
        Sample { time, exposure_s: bin.exposure_s(), visit, place, channels: channels.collect() }
    }

    /// A channel's linear rate less its background.
    fn count(&self, bin: &Bin, after: Option<&Bin>, number: usize, common: Flags) -> ChannelSample {
        let channel = &self.channels[number];
        let exposure_s = bin.exposure_s();
        let mut sample = ChannelSample::nothing(common);
        let Some(&counts) = bin.record.counts.get(channel.column) else {
            sample.flags |= Flags::GAP;
            return sample;
        };
        let missed = bin.record.missed.get(channel.column).is_some_and(|missed| *missed > 0);
        sample.flags.set(Flags::OVERFLOW, missed || common.contains(Flags::OVERFLOW));
        sample.flags.set(Flags::SATURATED, bin.record.flags.contains(CountFlags::SATURATED));
        let measured_hz = counts as f64 / exposure_s;
        sample.measured_hz = Measured::new(measured_hz, (counts.max(1) as f64).sqrt() / exposure_s);
        let tags = bin.tags_ps.get(channel.column).and_then(Option::as_deref);
        // Tags that do not make up the counts are not all of them.
        let tags = tags.filter(|tags| tags.len() as u64 == counts);
        let (start_ps, length_ps) = (bin.record.start_ps, bin.record.length_ps);
        let linear: Result<(Linear, bool), DetectorError> = match tags {
            Some(tags) => {
                let fine = &self.options.fine;
                let found = channel.linearity.linearise_tags(tags, start_ps, length_ps, fine);
                found.map(|found| {
                    sample.from_tags = true;
                    (found.linear, found.too_fast)
                })
            }
            None => channel.linearity.linearise(counts, exposure_s).map(|linear| {
                let beside = [self.before.as_ref(), after];
                let beside = beside.map(|other| counted_beside(bin, other?, channel.column));
                let own = (measured_hz, exposure_s);
                let law = &channel.linearity;
                let off_hz = self.options.glints.unresolved_hz(law, own, &beside);
                let most_hz = self.options.glints.tolerance * linear.rate_hz.abs();
                (linear, off_hz > most_hz)
            }),
        };
        match linear {
            Ok((linear, changed)) => {
                sample.flags.set(Flags::FAST_GLINT, changed);
                sample.flags.set(Flags::NONLINEAR, !linear.trusted);
                sample.lost_fraction = linear.lost_fraction;
                let background = self.off.at(bin.middle(), number);
                let stand_in =
                    matches!(background.source, BackgroundSource::Dark | BackgroundSource::Station);
                sample.flags.set(Flags::NO_OFF_TARGET, stand_in);
                sample.background_hz = Measured::new(background.rate_hz, background.sigma_hz);
                sample.background_from = Some(background.source);
                sample.rate_hz = linear.rate_hz - background.rate_hz;
                sample.sigma_hz = linear.sigma_hz.hypot(background.sigma_hz);
                sample.common_sigma_hz = background.sigma_hz;
            }
            Err(DetectorError::Saturated { .. }) => sample.flags |= Flags::SATURATED,
            // Tags out of their order: nothing can be said of their clock.
            Err(_) => sample.flags |= Flags::GAP,
        }
        sample
    }

    /// The fibre's gate and coupling.
    fn gate(
        &self,
        sample: &mut ChannelSample,
        channel: &CountChannel,
        bin: &Bin,
        visit: usize,
        place: Option<Place>,
    ) {
        let gate = &self.options.gate;
        let Some(fibre) = &channel.fibre else { return };
        if gate.most_q.is_none() && !gate.divide {
            return;
        }
        let (Some(place), Some(track)) = (place, self.tracks.get(visit)) else {
            sample.flags |= Flags::UNDETECTED;
            return;
        };
        if gate.most_q.is_some_and(|most| q(fibre, place.offset_px) > most) {
            sample.flags |= Flags::OFF_AXIS;
        }
        if !gate.divide {
            return;
        }
        let wander = self.wander[visit];
        match over_bin(fibre, track, bin.record.start, bin.exposure_s(), gate, wander) {
            Ok(coupling) if coupling.mean > 0.0 => {
                let relative = coupling.sigma / coupling.mean;
                sample.coupling = Measured::new(coupling.mean, coupling.sigma);
                sample.rate_hz /= coupling.mean;
                sample.common_sigma_hz /= coupling.mean;
                sample.sigma_hz =
                    (sample.sigma_hz / coupling.mean).hypot(sample.rate_hz * relative);
            }
            Ok(_) => sample.flags |= Flags::OFF_AXIS,
            Err(_) => sample.flags |= Flags::UNDETECTED,
        }
    }
}

impl ChannelSample {
    /// A sample of which nothing is known.
    fn nothing(flags: Flags) -> Self {
        Self {
            measured_hz: Measured::new(f64::NAN, f64::NAN),
            rate_hz: f64::NAN,
            sigma_hz: f64::NAN,
            common_sigma_hz: f64::NAN,
            background_hz: Measured::new(f64::NAN, f64::NAN),
            background_from: None,
            coupling: Measured::new(f64::NAN, f64::NAN),
            lost_fraction: 0.0,
            from_tags: false,
            flags,
        }
    }

    /// Takes the rate away where a flag excludes it.
    fn exclude(&mut self, counter: CountFlags) {
        const EXCLUDED: Flags = Flags::SATURATED
            .union(Flags::OFF_TARGET)
            .union(Flags::UNDETECTED)
            .union(Flags::OFF_AXIS);
        if counter.contains(CountFlags::ERROR) {
            self.flags |= Flags::GAP;
        }
        let excluded = self.flags.intersects(EXCLUDED) || counter.contains(CountFlags::ERROR);
        if excluded || !self.rate_hz.is_finite() {
            (self.rate_hz, self.sigma_hz) = (f64::NAN, f64::NAN);
            self.common_sigma_hz = f64::NAN;
        }
    }
}

/// Time between two bins on the counter's clock, s; `None` where it is not one clock.
fn hole_s(before: &Bin, bin: &Bin) -> Option<f64> {
    let jumped = |bin: &Bin| bin.record.flags.contains(CountFlags::ERROR);
    // A clock that began anew lies far back.
    if jumped(before) || jumped(bin) || bin.record.start_ps < before.record.start_ps {
        return None;
    }
    Some(bin.record.start_ps.checked_sub(before.end_ps())? as f64 * 1e-12)
}

/// Returns the counts of a bin right beside this one.
fn counted_beside(bin: &Bin, other: &Bin, column: usize) -> Option<Counted> {
    let (first, second) =
        if other.record.start < bin.record.start { (other, bin) } else { (bin, other) };
    let exposure_s = other.exposure_s();
    let beside = hole_s(first, second) == Some(0.0) && exposure_s > 0.0;
    let counts = *other.record.counts.get(column)?;
    beside.then(|| (counts as f64 / exposure_s, exposure_s))
}

impl<E, I: Iterator<Item = Result<Bin, E>>> Iterator for Reduction<'_, I> {
    type Item = Result<Sample, E>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(sample) = self.ready.pop_front() {
                return Some(Ok(sample));
            }
            let after = match self.bins.next() {
                Some(Err(error)) => return Some(Err(error)),
                after => after.and_then(Result::ok),
            };
            let ended = after.is_none();
            if let Some(bin) = self.now.take() {
                self.finish(&bin, after.as_ref());
                self.before = Some(bin);
            } else if ended {
                return None;
            }
            self.now = after;
        }
    }
}
