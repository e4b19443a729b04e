//! Light that simulated photon counters count.

use crate::tags::{Tag, TagKind};
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;

/// Content of a bin of a counter.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct LightBin {
    /// Events of each channel.
    pub counts: Vec<u64>,
    /// Missed events of each channel.
    pub missed: Vec<u64>,
    /// An overflow begins or ends in the bin.
    pub overflow: bool,
    /// Whether events are being dropped at the bin's end; `None` if nothing was said about it in the bin.
    pub dropping: Option<bool>,
    /// The counter reports an error.
    pub error: bool,
}

/// Light on the detectors of a counter. Time is asked for in order, without a gap within one measurement.
///
/// Any `FnMut(&[i32], i64, i64, &mut Vec<Tag>)` is one.
pub trait Light: Send {
    /// Appends what comes on these channels from `from_ps` to before `to_ps` on the counter's clock: time tags, and what the
    /// counter reports between them, in the order in which it sends them.
    fn tags(&mut self, channels: &[i32], from_ps: i64, to_ps: i64, into: &mut Vec<Tag>);

    /// Returns the content of a bin: the tags, counted. For light that knows its counts without tags, write another.
    fn bin(&mut self, channels: &[i32], from_ps: i64, to_ps: i64) -> LightBin {
        let mut tags = Vec::new();
        self.tags(channels, from_ps, to_ps, &mut tags);
        let none = vec![0; channels.len()];
        let mut bin = LightBin { counts: none.clone(), missed: none, ..LightBin::default() };
        for tag in tags {
            let channel = channels.iter().position(|channel| *channel == tag.channel);
            match (tag.kind(), channel) {
                (Some(TagKind::TimeTag), Some(i)) => bin.counts[i] += 1,
                (Some(TagKind::MissedEvents), Some(i)) => bin.missed[i] += u64::from(tag.missed),
                (Some(kind @ (TagKind::OverflowBegin | TagKind::OverflowEnd)), _) => {
                    bin.overflow = true;
                    bin.dropping = Some(kind == TagKind::OverflowBegin);
                }
                (Some(TagKind::Error), _) => bin.error = true,
                _ => {}
            }
        }
        bin
    }
}

impl<F: FnMut(&[i32], i64, i64, &mut Vec<Tag>) + Send> Light for F {
    fn tags(&mut self, channels: &[i32], from_ps: i64, to_ps: i64, into: &mut Vec<Tag>) {
        self(channels, from_ps, to_ps, into);
    }
}

/// Light of steady mean rates, photon by photon: exponential gaps, channels independent of each other.
#[derive(Debug, Clone)]
pub struct Poisson {
    rates_hz: Vec<(i32, f64)>,
    random: Xoshiro256PlusPlus,
    /// The next photon of each channel, ps.
    next_ps: Vec<f64>,
    until_ps: Option<i64>,
}

impl Poisson {
    /// Channels and their mean rates, Hz; rates that are not above 0 are darkness.
    pub fn new(rates_hz: &[(i32, f64)], seed: u64) -> Self {
        Self {
            rates_hz: rates_hz.to_vec(),
            random: Xoshiro256PlusPlus::seed_from_u64(seed),
            next_ps: vec![f64::INFINITY; rates_hz.len()],
            until_ps: None,
        }
    }

    fn gap_ps(&mut self, rate_hz: f64) -> f64 {
        if rate_hz > 0.0 {
            -(1.0 - self.random.random::<f64>()).ln() / rate_hz * 1e12
        } else {
            f64::INFINITY
        }
    }
}

impl Light for Poisson {
    fn tags(&mut self, channels: &[i32], from_ps: i64, to_ps: i64, into: &mut Vec<Tag>) {
        let begun = into.len();
        for i in 0..self.rates_hz.len() {
            let (channel, rate_hz) = self.rates_hz[i];
            // No memory: after a pause the wait for the next photon is as long as at first.
            if self.until_ps != Some(from_ps) {
                self.next_ps[i] = from_ps as f64 + self.gap_ps(rate_hz);
            }
            while self.next_ps[i] < to_ps as f64 {
                if channels.contains(&channel) {
                    into.push(Tag::photon(channel, self.next_ps[i] as i64));
                }
                self.next_ps[i] += self.gap_ps(rate_hz);
            }
        }
        self.until_ps = Some(to_ps);
        into[begun..].sort_by_key(|tag| tag.time_ps);
    }
}
