//! The counts of a night: two runs over a counter's bins, off the targets and on them.

use super::error::Within as _;
use super::tags::{Run, TagSummary, Tags};
use super::{ReduceError, Stay, step};
use crate::counts::{
    Bin, CountChannel, Curves, Gate, OffOptions, OffTarget, Options, Reduction, Sample, SkyLevels,
    SkyTally, Span, Spans, Summary, View,
};
use crate::track::Track;
use sunglint_formats::FileError;
use sunglint_formats::session::{Counts, Session, TargetKind};
use sunglint_numerics::progress::{Cancelled, Progress};
use sunglint_radiometry::light_curve::{LightCurve, Provenance, RateKind};
use sunglint_radiometry::station::{Detector, Fibre, Station};

/// Progress is told of so many bins at once.
const STEP: u64 = 256;

/// Results of a counter.
#[derive(Debug)]
pub struct CounterNight {
    /// The counter's name in the session.
    pub counter: String,
    /// Raw and linear curve of the counter's channels for each stay; `None` without bins.
    pub curves: Vec<Option<[LightCurve; 2]>>,
    /// Where the sky came from, for each stay and channel; nothing for stays without samples.
    pub skies: Vec<Vec<SkyTally>>,
    /// Summary of what each rule did.
    pub summary: Summary,
    /// Rates of the channels off the targets.
    pub off: OffTarget,
    /// Channels of the counter that the station has not: they are not reduced.
    pub unknown: Vec<String>,
    /// Bytes of a last line without its end, which were left out.
    pub torn_bytes: u64,
    /// Summary of the counter's raw tags; `None` where none were used.
    pub tags: Option<TagSummary>,
    /// Warnings for the user about the tags.
    pub warnings: Vec<String>,
}

/// How counts are reduced.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CountOptions {
    /// The fibre's gate and coupling, tags, glints.
    pub bins: Options,
    /// Off-target rates.
    pub off: OffOptions,
}

/// A fibre's field in place of the station's, by channel.
pub type Fibres = std::collections::BTreeMap<String, Fibre>;

/// The channels of a counter that the station knows, and the names of the others.
fn channels(
    counts: &Counts,
    station: &Station,
    fibres: &Fibres,
) -> Result<(Vec<CountChannel>, Vec<String>), ReduceError> {
    let (mut known, mut unknown) = (Vec::new(), Vec::new());
    for (column, name) in counts.channels().iter().enumerate() {
        match station.channel(name).map(|channel| &channel.detector) {
            Some(Detector::Counter(counter)) => {
                let mut channel = CountChannel::of(name, column, counter)
                    .within(|| format!("channel {name} of station {}", station.name))?;
                channel.fibre = fibres.get(name).copied().or(channel.fibre);
                known.push(channel);
            }
            _ => unknown.push(name.clone()),
        }
    }
    Ok((known, unknown))
}

/// Targets, sky and dark as the log has them, and the sky that the frames show within stays at a target.
pub fn spans(stays: &[Stay], seen_off: &[Span]) -> Spans {
    let logged = stays.iter().enumerate().filter_map(|(number, stay)| {
        let view = match stay.target.target_kind {
            TargetKind::Star | TargetKind::Satellite if stay.target.on => View::Target(number),
            TargetKind::Dark => View::Dark,
            // A camera's own bias frames and flats say nothing of what its neighbours see.
            TargetKind::None | TargetKind::Bias | TargetKind::Flat => return None,
            _ => View::Sky,
        };
        Some(Span { from: stay.from, to: stay.to, view })
    });
    Spans::new(logged.chain(seen_off.iter().copied()))
}

/// Reads a counter's bins, twice. `sky` carries the background between two looks at the sky. Holds the curves of the stays, and a piece of bins. `each` sees every sample as it comes.
///
/// # Errors
/// A table that cannot be read, a station whose law no detector can have, a stop.
#[expect(clippy::too_many_arguments, reason = "a night has as many sides")]
pub fn counter_night(
    session: &Session,
    counter: &str,
    station: &Station,
    fibres: &Fibres,
    spans: &Spans,
    (tracks, sky): (&[Track], &SkyLevels),
    options: &CountOptions,
    progress: &dyn Progress,
    each: &mut dyn FnMut(&[CountChannel], &Sample),
) -> Result<CounterNight, ReduceError> {
    let open = || session.counts(counter);
    let (channels, unknown) = channels(&open()?, station, fibres)?;
    if channels.is_empty() {
        return Err(ReduceError::NoChannel {
            counter: counter.to_owned(),
            channels: unknown,
            station: station.name.clone(),
        });
    }
    let mut warnings = Vec::new();
    let mut tags = Tags::open(session, counter, open()?.channels(), &mut warnings)?;
    let run = tags.as_ref().map(Tags::run);
    let mut watched = Watched { bins: open()?, tags: run, progress, passed: 0, stopped: None };
    let off = OffTarget::measure(watched.by_ref(), &channels, spans, &options.off)?;
    let off = off.carried_by(sky.clone());
    let found = watched.ended()?.map(|(_, found)| found);
    if let (Some(tags), Some(found)) = (&mut tags, found) {
        tags.judge(found);
    }
    let run = tags.as_ref().map(Tags::run);
    let mut watched = Watched { bins: open()?, tags: run, progress, passed: 0, stopped: None };
    let mut curves: Vec<Option<Curves>> = vec![None; tracks.len()];
    let mut skies: Vec<Vec<SkyTally>> = vec![Vec::new(); tracks.len()];
    let mut reduction =
        Reduction::new(watched.by_ref(), &channels, spans, tracks, &off, options.bins);
    for sample in reduction.by_ref() {
        let sample = sample?;
        each(&channels, &sample);
        if let Some(curve) = curves.get_mut(sample.visit) {
            curve.get_or_insert_with(|| Curves::new(&channels)).push(&sample);
        }
        if let Some(skies) = skies.get_mut(sample.visit) {
            skies.resize_with(channels.len(), SkyTally::default);
            skies.iter_mut().zip(&sample.channels).for_each(|(sky, channel)| sky.add(channel));
        }
    }
    let summary = reduction.summary().clone();
    let torn_bytes = watched.bins.torn_bytes();
    let of_tags = watched.ended()?.map(|(of_tags, _)| of_tags);
    if let (Some(tags), Some(of_tags)) = (&tags, &of_tags) {
        warnings.extend(tags.warnings(counter, of_tags));
    }
    let finish = |curves: Curves| curves.finish(Provenance::default());
    Ok(CounterNight {
        counter: counter.to_owned(),
        curves: curves.into_iter().map(|curves| curves.map(finish)).collect(),
        skies,
        summary,
        off,
        unknown,
        torn_bytes,
        tags: of_tags,
        warnings,
    })
}

/// Summary of a counter's tags, and for each stretch the bins that were compared and those that agree.
type OfTags = (TagSummary, Vec<[u64; 2]>);

/// Bins that are counted as they pass, with their tags.
struct Watched<'a> {
    bins: Counts,
    tags: Option<Run<'a>>,
    progress: &'a dyn Progress,
    /// Bins that `progress` has not been told of.
    passed: u64,
    stopped: Option<Cancelled>,
}

impl Watched<'_> {
    /// Ends the reading of the tags and returns their summary.
    fn ended(self) -> Result<Option<OfTags>, Cancelled> {
        step(self.progress, self.passed)?;
        self.stopped.map_or_else(|| Ok(self.tags.map(Run::finish)), Err)
    }
}

impl Iterator for Watched<'_> {
    type Item = Result<Bin, FileError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.passed += 1;
        if self.passed == STEP {
            self.passed = 0;
            if let Err(error) = step(self.progress, STEP) {
                self.stopped = Some(error);
                return None;
            }
        }
        let record = match self.bins.next()? {
            Ok(record) => record,
            Err(error) => return Some(Err(error)),
        };
        Some(match &mut self.tags {
            Some(tags) => tags.bin(record),
            None => Ok(Bin::from(record)),
        })
    }
}

/// Raw and linear parts of curves that [`Curves::finish`] gave.
pub fn of_kind(curves: [LightCurve; 2], kind: RateKind) -> LightCurve {
    let [raw, linear] = curves;
    if kind == RateKind::Raw { raw } else { linear }
}

/// The gate of options that a person gave: the ellipse's q, and whether to divide by the coupling.
pub fn gate(most_q: Option<f64>, divide: bool) -> Gate {
    Gate { most_q, divide, ..Gate::default() }
}
