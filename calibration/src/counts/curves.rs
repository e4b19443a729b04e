//! Samples as light curves, and what the rules did to them.

use super::CountChannel;
use super::reduction::Sample;
use std::collections::BTreeMap;
use std::fmt;
use sunglint_formats::Meta;
use sunglint_radiometry::light_curve::{
    ChannelCurve, Flags, LightCurve, Provenance, RateKind, Samples,
};

/// Numbers of samples of one channel, by what became of them.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct ChannelSummary {
    /// The channel.
    pub name: String,
    /// Number of samples.
    pub samples: u64,
    /// Those with a rate.
    pub with_rate: u64,
    /// Those without any flag.
    pub clean: u64,
    /// Those that were linearised from tags.
    pub from_tags: u64,
    /// Those that were divided by a coupling.
    pub coupled: u64,
    /// How many samples have each flag; one sample may have several.
    pub flags: BTreeMap<&'static str, u64>,
}

/// Summary of the work of a [`Reduction`](super::Reduction).
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Summary {
    /// Bins that were read.
    pub bins: u64,
    /// Bins that belong to no visit.
    pub outside: u64,
    /// Bins without a length, which make no sample.
    pub without_length: u64,
    /// Bins that begin before the one before has ended, on the counter's clock.
    pub overlapping: u64,
    /// The channels.
    pub channels: Vec<ChannelSummary>,
}

impl Summary {
    pub(super) fn new(channels: &[CountChannel]) -> Self {
        let named = |c: &CountChannel| ChannelSummary { name: c.name.clone(), ..<_>::default() };
        Self { channels: channels.iter().map(named).collect(), ..Self::default() }
    }

    pub(super) fn add(&mut self, sample: &Sample) {
        for (summary, channel) in self.channels.iter_mut().zip(&sample.channels) {
            summary.samples += 1;
            summary.with_rate += u64::from(channel.rate_hz.is_finite());
            summary.clean += u64::from(channel.flags.is_empty());
            summary.from_tags += u64::from(channel.from_tags);
            summary.coupled += u64::from(channel.coupling.value.is_finite());
            for (name, _) in channel.flags.iter_names() {
                *summary.flags.entry(name).or_default() += 1;
            }
        }
    }
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { bins, outside, without_length, overlapping, .. } = self;
        write!(
            f,
            "{bins} bins, {outside} of no visit, {without_length} without length, {overlapping} overlapping"
        )?;
        for channel in &self.channels {
            let ChannelSummary { name, samples, with_rate, clean, .. } = channel;
            write!(
                f,
                "\n{name}: {samples} samples, {with_rate} with a rate, {clean} without flags"
            )?;
            for (flag, n) in &channel.flags {
                write!(f, "; {} {n}", flag.to_ascii_lowercase())?;
            }
        }
        Ok(())
    }
}

/// Samples of a visit, as they come, in columns.
#[derive(Debug, Clone, PartialEq)]
pub struct Curves {
    samples: Samples,
    raw: Vec<ChannelCurve>,
    linear: Vec<ChannelCurve>,
}

impl Curves {
    /// Empty curves of these channels.
    pub fn new(channels: &[CountChannel]) -> Self {
        let empty = |channel: &CountChannel| ChannelCurve {
            name: channel.name.clone(),
            rate_hz: Vec::new(),
            sigma_hz: Vec::new(),
            flags: Vec::new(),
            model_error_hz: None,
            common_sigma_hz: None,
        };
        let raw: Vec<ChannelCurve> = channels.iter().map(empty).collect();
        let mut linear = raw.clone();
        linear.iter_mut().for_each(|channel| channel.common_sigma_hz = Some(Vec::new()));
        Self { samples: Samples::default(), raw, linear }
    }

    /// Adds a sample of these channels.
    pub fn push(&mut self, sample: &Sample) {
        self.samples.time.push(sample.time);
        self.samples.exposure_s.push(sample.exposure_s);
        let add = |curve: &mut ChannelCurve, [rate_hz, sigma_hz]: [f64; 2], flags: Flags| {
            curve.rate_hz.push(rate_hz);
            curve.sigma_hz.push(sigma_hz);
            curve.flags.push(flags);
        };
        for (i, channel) in sample.channels.iter().enumerate() {
            add(&mut self.raw[i], channel.measured_hz.to_array(), channel.flags);
            add(&mut self.linear[i], [channel.rate_hz, channel.sigma_hz], channel.flags);
            self.linear[i].common_sigma_hz.get_or_insert_default().push(channel.common_sigma_hz);
        }
    }

    /// The raw curve (as counted, dead time and background included, flags as below) and the linear one.
    pub fn finish(self, provenance: Provenance) -> [LightCurve; 2] {
        [(RateKind::Raw, self.raw), (RateKind::Linear, self.linear)].map(|(kind, channels)| {
            LightCurve {
                kind,
                samples: self.samples.clone(),
                channels,
                provenance: provenance.clone(),
                other: Meta::new(),
            }
        })
    }
}
