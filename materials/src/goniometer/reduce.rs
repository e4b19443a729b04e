//! A goniometer's run as BRDF values.
//!
//! f = (Φ − Φ_dark − s(δ) Φ_i(t) Ω) / (Φ_i(t) Ω cosθ_o p)
//!
//! with the incident power Φ_i from the readings of the beam, carried through the run by the reference direction; s the stray light by the detector's angle; Ω the
//! stop's solid angle; p the part of the beam that lies on the sample and in the detector's field ([`super::overlap`]); and all angles less the axes' zeros, which come from the beam
//! straight through and from the sample's lobe seen from both sides.
//!
//! A run with several channels has this for each of them, with the dark, the lamp and the stray light of its own. The geometry is one: the zeros and the part of the beam that the detector
//! takes in come from the channel with most light.

use super::bench::Bench;
use super::channels::{Band, Reads};
use super::line::{Line, seen};
use super::measure::done_of;
use super::overlap::Sizes;
use super::pose::{Angles, Kinematics, Pose};
use super::signature::{
    Point, Signature, fwhm_deg, lobe_fwhm_deg, measured, optional, peak, signature,
};
use super::tasks::{Part, RESUMED, Task};
use crate::instrument::Index;
use crate::plan::Planned;
use crate::reading::{State, kept};
use crate::retro::AtAngle;
use crate::retro::readings::{Mean, means};
use crate::samples::{Sample, Samples, direction};
use rayon::prelude::*;
use serde::Serialize;
use serde_json::json;
use std::collections::{BTreeMap, HashSet};
use sunglint_formats::Meta;
use sunglint_numerics::measured::Measured;
use sunglint_numerics::order::median;

/// Relative uncertainty assumed for the incident power where the signature was not measured: the part of the beam that the detector takes in is not known.
pub const WITHOUT_SIGNATURE: f64 = 0.05;
/// A change between the beam's readings at both ends, beyond what the reference direction says, that is worth a warning.
const MUCH: f64 = 0.02;
/// Less of the beam in the detector than this says nothing of its power.
const LEAST_CAPTURED: f64 = 0.02;
/// A lobe whose width is not known to this part of it is not told from the instrument, nor one that is narrower than this part of the instrument's.
const BELOW: f64 = 0.04;
const LEAST: f64 = 0.8;

/// Why there are no values.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GoniometerError {
    /// A part that the reduction cannot do without.
    #[error("there are no readings of {0}: go on with the run (sunglint brdf run … --resume)")]
    Missing(&'static str),
    /// The beam is none.
    #[error(
        "the beam is {power_w:e} W above the dark reading: expected light (is the shutter open, does the detector stand in the beam?)"
    )]
    NoLight {
        /// Net power, W.
        power_w: f64,
    },
    /// The detector stood beside the beam.
    #[error(
        "the detector took in {:.1} % of the beam where it should have stood in it: the axes' zeros are off by more than the stop and the beam are wide, so that the incident power is not known. Correct zero_deg of the axes in the bench's file, and run again",
        100.0 * captured
    )]
    Beside {
        /// The part of the beam that it took in.
        captured: f64,
    },
    /// The beam is more than the detector shows.
    #[error(
        "the detector is over its range in the beam: choose a higher range or a shorter integration, or put a filter into the beam and name it in [beam] filter_transmission"
    )]
    BeamOver,
    /// No direction has a value.
    #[error(
        "none of {directions} directions has a value: {over} are over the meter's range, {refused} have less than the least part of the beam on the sample and in the detector's field"
    )]
    Nothing {
        /// Directions that were read.
        directions: usize,
        /// Directions over range.
        over: usize,
        /// Directions that are refused.
        refused: usize,
    },
}

/// Zeros of the axes: what the bench's angles are too large by, degrees with their standard uncertainty.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Zeros {
    /// Zero of the sample's axis.
    #[serde(serialize_with = "measured")]
    pub sample_deg: Measured,
    /// Zero of the detector's axis.
    #[serde(serialize_with = "measured")]
    pub detector_deg: Measured,
    /// Zero of the azimuth's axis.
    #[serde(serialize_with = "optional")]
    pub azimuth_deg: Option<Measured>,
    /// True where they were measured.
    pub measured: bool,
}

/// Stray light, as BRDF times cosθ_o, sr⁻¹.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Floor {
    /// Mean over the detector's angles.
    pub mean_per_sr: f64,
    /// Least.
    pub least_per_sr: f64,
    /// Largest.
    pub largest_per_sr: f64,
}

/// The sample's lobe in the mirrored direction beside the instrument's own width.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Mirrored {
    /// Angle of incidence, degrees.
    pub theta_i_deg: f64,
    /// Full width at half maximum as it was seen, in the plane of incidence, degrees.
    pub seen_fwhm_deg: f64,
    /// The same of the beam without a sample.
    pub instrument_fwhm_deg: f64,
    /// The same of the sample alone; none where it is below the instrument.
    #[serde(serialize_with = "optional")]
    pub sample_fwhm_deg: Option<Measured>,
}

/// The lamp at a look at the reference direction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Look {
    /// Seconds since the run's begin.
    pub time_s: f64,
    /// Light over that at the first look.
    pub relative: f64,
    /// Standard uncertainty of that.
    pub sigma: f64,
}

/// The instrument, as a run found it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Instrument {
    /// Vacuum wavelength, nm.
    pub wavelength_nm: f64,
    /// Solid angle of the detector, sr.
    pub solid_angle_sr: f64,
    /// Half-angle of its cone, degrees.
    pub cone_half_angle_deg: f64,
    /// Incident power at the first look at the reference direction, W; not a number of channels that have another unit.
    #[serde(serialize_with = "measured", skip_serializing_if = "is_none")]
    pub incident_w: Measured,
    /// Reading of the meter without light, W; not a number of channels that have another unit.
    #[serde(serialize_with = "measured", skip_serializing_if = "is_none")]
    pub dark_w: Measured,
    /// Channels that have values, by rising wavelength; empty of a power meter at one wavelength.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub channels: Vec<ChannelState>,
    /// The beam straight through.
    pub signature: Option<Signature>,
    /// Stray light.
    pub floor: Option<Floor>,
    /// Standard uncertainty of a value that does not grow with it, sr⁻¹, the median of all directions: the meter's noise in the dark, and the stray light that was taken off.
    pub additive_per_sr: f64,
    /// The part of that which all values share: the dark reading's own uncertainty and that of the stray light, sr⁻¹.
    pub common_additive_per_sr: f64,
    /// Stray light that may be in all values, sr⁻¹ times cosθ_o: the least that was seen. None where it was measured.
    pub stray_bound_per_sr: Option<f64>,
    /// Zeros of the axes.
    pub zeros: Zeros,
    /// Looks at the reference direction.
    pub drift: Vec<Look>,
    /// The mirrored lobe.
    pub mirrored: Option<Mirrored>,
    /// The part of the beam on the sample and in the field, least of all directions that have a value.
    pub least_part: f64,
    /// Polarisation of source and detector, in words.
    pub polarisation: [Option<String>; 2],
    /// The share of what is measured that is polarised across the plane of incidence less that in it; none where it is not said.
    pub polarised: Option<f64>,
    /// The detector's own part of that.
    pub detector_polarised: f64,
    /// Refractive index n + ik of the sample's facets, where it is said.
    pub sample_index: Option<Index>,
    /// Quantities that were not measured, and what is assumed instead.
    pub missing: Vec<String>,
}

/// A channel, as a run found it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ChannelState {
    /// Middle, nm.
    pub wavelength_nm: f64,
    /// Width, nm; 0 of a monochromator's wavelength.
    pub width_nm: f64,
    /// Unit of the next two; none where the files do not say it.
    pub unit: Option<&'static str>,
    /// The incident beam at the first look at the reference direction.
    #[serde(serialize_with = "measured")]
    pub incident: Measured,
    /// Reading without light, of a spectrometer at its longest integration.
    #[serde(serialize_with = "measured")]
    pub dark: Measured,
    /// Relative standard uncertainty that all its values share.
    pub scale_sigma: f64,
    /// Standard uncertainty of a value that does not grow with it, sr⁻¹, the median of all directions.
    pub additive_per_sr: f64,
    /// Mean stray light, sr⁻¹.
    pub floor_per_sr: Option<f64>,
    /// Change of the lamp from the first look to the last, relative.
    pub drift: Option<f64>,
    /// Directions that were over range.
    pub over: usize,
}

fn is_none(value: &Measured) -> bool {
    value.value.is_nan()
}

/// Values of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Reduced {
    /// The values, one row for each direction that has one, in the order of the run.
    pub samples: Samples,
    /// The instrument.
    pub instrument: Instrument,
    /// Scans through the beam: in the plane of incidence and across.
    pub scans: [Vec<Point>; 2],
    /// Relative uncertainty that all values share.
    pub scale_sigma: f64,
    /// Directions of the plan that the bench does not reach.
    pub unreachable: usize,
    /// Directions that are not measured yet.
    pub left: usize,
    /// Directions over the meter's range.
    pub over: usize,
    /// Directions with too small a part of the beam on the sample and in the field.
    pub refused: usize,
    /// Warnings for the user.
    pub warnings: Vec<String>,
    /// The channel whose beam the scans show, by its place among the values' wavelengths.
    pub channel: usize,
    /// Incident beam of that channel, in its unit.
    pub incident: f64,
}

/// Readings at a place as one.
#[derive(Debug, Clone)]
struct Read {
    number: u32,
    stages: Angles,
    time_s: f64,
    mean: Mean,
    range: String,
}

/// Standard deviations of the readings that count, where their files tell them: of each place those before its last line that keeps them.
fn noises(lines: &[Line]) -> BTreeMap<(Part, u32), Vec<f64>> {
    let mut found = BTreeMap::new();
    let mut now: Vec<f64> = Vec::new();
    let mut before = None;
    for line in lines {
        let key = (line.part, line.number);
        if before.replace(key) != Some(key) {
            now.clear();
        }
        match line.state {
            State::Read => now.extend(line.noise.iter().copied().filter(|n| n.is_finite())),
            State::Over => {}
            State::Again => now.clear(),
            State::Kept => {
                found.insert(key, std::mem::take(&mut now));
            }
        }
    }
    found
}

/// The readings of all parts.
fn reads(lines: &[Line]) -> BTreeMap<Part, Vec<Read>> {
    let mut stages: BTreeMap<(Part, u32), Angles> = BTreeMap::new();
    for line in lines.iter().filter(|line| line.state == State::Kept) {
        stages.insert((line.part, line.number), line.stages);
    }
    let mut parts: BTreeMap<Part, (Vec<u32>, Vec<AtAngle>)> = BTreeMap::new();
    for ((part, number), at) in kept(seen(lines)) {
        let (numbers, all) = parts.entry(part).or_default();
        numbers.push(number);
        all.push(at);
    }
    let noises = noises(lines);
    let read = |(part, (numbers, all)): (Part, (Vec<u32>, Vec<AtAngle>))| {
        let means = means(&all);
        let each = numbers.into_iter().zip(all).zip(means).map(|((number, at), mut mean)| {
            // One file tells its own scatter; several tell theirs, and count as no better than each says.
            if let Some(noise) = noises.get(&(part, number)).filter(|noise| !noise.is_empty()) {
                let square = noise.iter().map(|n| n * n).sum::<f64>() / noise.len() as f64;
                let own = (square / noise.len() as f64).sqrt();
                mean.sigma_w = if mean.used > 1 { mean.sigma_w.max(own) } else { own };
            }
            Read {
                number,
                stages: stages.get(&(part, number)).copied().unwrap_or([None; 4]),
                time_s: at.time_s,
                mean,
                range: at.range,
            }
        });
        (part, each.collect())
    };
    parts.into_iter().map(read).collect()
}

/// A value at a time: on a straight line between, held beyond the ends.
fn between(points: &[(f64, f64)], at: f64) -> f64 {
    let k = points.partition_point(|p| p.0 < at);
    match (k.checked_sub(1).and_then(|j| points.get(j)), points.get(k)) {
        (Some(a), Some(b)) if b.0 > a.0 => a.1 + (b.1 - a.1) * (at - a.0) / (b.0 - a.0),
        (Some(a), None) => a.1,
        (_, Some(b)) => b.1,
        (None, None) => f64::NAN,
    }
}

/// The dark reading in a range.
struct DarkIn {
    range: String,
    points: Vec<(f64, f64)>,
    sigma_w: f64,
    /// Scatter of a measurement in the dark, W.
    noise_w: f64,
}

impl DarkIn {
    fn new(range: &str, all: &[&Read]) -> Self {
        let points: Vec<(f64, f64)> = all.iter().map(|r| (r.time_s, r.mean.power_w)).collect();
        let n = all.len().max(1) as f64;
        let noise = all.iter().map(|r| r.mean.sigma_w.powi(2)).sum::<f64>().sqrt() / n;
        // What changed between two of them may have changed unevenly.
        let change = points.windows(2).map(|w| (w[1].1 - w[0].1).abs()).fold(0.0, f64::max);
        let noise_w = median(all.iter().map(|r| r.mean.sigma_w)).unwrap_or(0.0);
        let sigma_w = noise.hypot(change / 12.0_f64.sqrt());
        Self { range: range.to_owned(), points, sigma_w, noise_w }
    }
}

/// The dark reading: of a spectrometer one of each integration, by which it has counts that do not grow with time.
struct Dark {
    all: Vec<DarkIn>,
    by_range: bool,
}

impl Dark {
    fn new(reads: Option<&Vec<Read>>, by_range: bool) -> Self {
        let all: Vec<&Read> =
            reads.into_iter().flatten().filter(|r| r.mean.power_w.is_finite()).collect();
        let mut ranges: Vec<&str> = Vec::new();
        for read in &all {
            if by_range && !ranges.contains(&read.range.as_str()) {
                ranges.push(&read.range);
            }
        }
        if !by_range && !all.is_empty() {
            ranges.push("");
        }
        let of = |range: &str| {
            let mine = all.iter().filter(|r| !by_range || r.range == range).copied();
            DarkIn::new(range, &mine.collect::<Vec<_>>())
        };
        Self { all: ranges.into_iter().map(of).collect(), by_range }
    }

    fn is_empty(&self) -> bool {
        self.all.is_empty()
    }

    fn of(&self, read: &Read) -> Option<&DarkIn> {
        self.all.iter().find(|dark| !self.by_range || dark.range == read.range)
    }

    /// Level for a measurement; not a number where its range has none.
    fn at(&self, read: &Read) -> f64 {
        self.of(read).map_or(f64::NAN, |dark| between(&dark.points, read.time_s))
    }

    fn sigma_w(&self, read: &Read) -> f64 {
        self.of(read).map_or(f64::NAN, |dark| dark.sigma_w)
    }

    fn noise_w(&self, read: &Read) -> f64 {
        self.of(read).map_or(f64::NAN, |dark| dark.noise_w)
    }
}

/// Geometry that all channels share.
#[derive(Clone, Copy)]
struct Shared {
    signature: Option<Signature>,
    zeros: Zeros,
    /// Relative standard uncertainty of the part of the beam that the detector takes in.
    beam_sigma: f64,
    /// Whether the channel's own signature is compared with the shared one.
    compare: bool,
}

/// A run's directions as values of one channel.
struct One {
    reduced: Reduced,
    /// Number of each row's direction.
    numbers: Vec<u32>,
    shared: Shared,
    /// How much more of the beam the detector takes in by the channel's own scans, relative, and the uncertainty of that.
    captured: Option<(f64, f64)>,
}

/// Start of the reduction of a channel.
struct Given<'a> {
    bench: &'a Bench,
    kinematics: &'a Kinematics,
    tasks: &'a [Task],
    missing: &'a [String],
    unreachable: usize,
    band: Band,
    /// Transmission of the filter in the beam.
    filter: f64,
    shared: Option<Shared>,
}

/// Values of a run's lines. `tasks` is all that was to be measured, `unreachable` the directions that it has not.
///
/// # Errors
/// Parts without which there are no values, a beam that is no light or over range.
pub fn reduce(
    lines: &[Line],
    bench: &Bench,
    kinematics: &Kinematics,
    tasks: &[Task],
    missing: &[String],
    unreachable: &[Planned],
) -> Result<Reduced, GoniometerError> {
    let given = |k: usize, shared: Option<Shared>| {
        let each = bench.beam.filter_transmissions.as_ref().and_then(|all| all.get(k));
        let filter = each.unwrap_or(&bench.beam.filter_transmission).get();
        let unreachable = unreachable.len();
        let band = bench.bands[k];
        Given { bench, kinematics, tasks, missing, unreachable, band, filter, shared }
    };
    if matches!(bench.reads, Reads::Meter) {
        return Ok(one(lines, &given(0, None))?.reduced);
    }
    let of_channel = |k: usize| Line::of_channel(lines, &bench.reads, k, bench.bands[k].nm);
    let brightest = brightest(bench, &of_channel)?;
    let first = one(&of_channel(brightest), &given(brightest, None))?;
    let count = bench.bands.len();
    // As many comparisons as say whether the beam differs from channel to channel.
    let every = count.div_ceil(COMPARED).max(1);
    let all: Vec<Result<One, GoniometerError>> = (0..count)
        .into_par_iter()
        .map(|k| {
            let compare = k % every == 0 || k + 1 == count;
            let shared = Shared { compare, ..first.shared };
            let lines = of_channel(k);
            one(&lines, &given(k, Some(shared)))
        })
        .collect();
    let kept = done_of(lines, bench);
    let left =
        |task: &&Task| task.part == Part::Direction && !kept.contains(&(task.part, task.number));
    joined(bench, brightest, &first, all, tasks.iter().filter(left).count())
}

/// Channels whose own signature is compared with the shared one.
const COMPARED: usize = 8;
/// Parts of the beam that differ by less than this are the same.
const SAME_CAPTURED: f64 = 2e-3;
/// Channels that are named one by one in a warning.
const NAMED: usize = 4;

/// A channel whose beam has less than this part of the brightest one's light does not tell the geometry for all.
const LEAST_OF_BRIGHTEST: f64 = 0.1;

/// A channel's beam.
struct OfBeam {
    channel: usize,
    /// Places of the scans that tell the geometry where it is over range.
    over: usize,
    /// The most light of its looks that are not over range; below all numbers where there is none.
    net: f64,
    /// Whether each of those stands out of the noise.
    is_seen: bool,
    /// Whether a look is over range.
    is_over: bool,
}

/// The channel that tells the geometry for all: of those with much light in the beam, those that are least often over range in the scans, and of these the one with most light.
///
/// # Errors
/// No channel with light in the beam, or all over range.
fn brightest(
    bench: &Bench,
    of_channel: &(dyn Fn(usize) -> Vec<Line> + Sync),
) -> Result<usize, GoniometerError> {
    let scans = [
        Part::Beam,
        Part::SignatureIn,
        Part::SignatureOut,
        Part::ZeroPlus,
        Part::ZeroMinus,
        Part::Reference,
    ];
    let of = |k: usize| {
        let lines = of_channel(k);
        let reads = reads(&lines);
        let dark = Dark::new(reads.get(&Part::Dark), matches!(bench.reads, Reads::Spectrometer(_)));
        let over = scans.iter().filter_map(|part| reads.get(part)).flatten();
        let over = over.filter(|read| read.mean.over > 0).count();
        let beams = reads.get(&Part::Beam).map_or(&[][..], Vec::as_slice);
        let (mut net, mut is_seen) = (f64::NEG_INFINITY, true);
        for read in beams.iter().filter(|read| read.mean.over == 0) {
            let light = read.mean.power_w - dark.at(read);
            net = net.max(light);
            is_seen &= light > 5.0 * read.mean.sigma_w.hypot(dark.sigma_w(read));
        }
        let is_over = beams.iter().any(|read| read.mean.over > 0);
        OfBeam { channel: k, over, net, is_seen: is_seen && net.is_finite(), is_over }
    };
    let all: Vec<OfBeam> = (0..bench.bands.len()).into_par_iter().map(of).collect();
    let seen = || all.iter().filter(|one| one.is_seen);
    let most = seen().map(|one| one.net).fold(0.0, f64::max);
    let bright = seen().filter(|one| one.net >= LEAST_OF_BRIGHTEST * most);
    let best = bright.max_by(|a, b| b.over.cmp(&a.over).then(a.net.total_cmp(&b.net)));
    if let Some(best) = best {
        return Ok(best.channel);
    }
    if all.iter().any(|one| one.is_over) {
        return Err(GoniometerError::BeamOver);
    }
    // The one with most light, of which it is then said how little that is.
    let read = all.iter().filter(|one| one.net.is_finite());
    let best = read.max_by(|a, b| a.net.total_cmp(&b.net));
    best.map(|one| one.channel).ok_or(GoniometerError::Missing("the beam"))
}

/// Channels as one table.
fn joined(
    bench: &Bench,
    brightest: usize,
    first: &One,
    all: Vec<Result<One, GoniometerError>>,
    left: usize,
) -> Result<Reduced, GoniometerError> {
    let mut warnings: Vec<String> = Vec::new();
    let mut good: Vec<(usize, One)> = Vec::new();
    let mut dark: Vec<String> = Vec::new();
    for (k, found) in all.into_iter().enumerate() {
        match found {
            Ok(found) => good.push((k, found)),
            Err(error) => {
                let why = match error {
                    GoniometerError::BeamOver => {
                        "the beam is over its detector's range (a shorter integration, or a filter in the beam)".to_owned()
                    }
                    GoniometerError::NoLight { .. } => "no light in the beam".to_owned(),
                    error => error.to_string(),
                };
                dark.push(format!("{} nm: {why}", bench.bands[k].nm));
            }
        }
    }
    if !dark.is_empty() {
        warnings.push(format!(
            "{} of {} channels have no values and are left out: {}{}",
            dark.len(),
            bench.bands.len(),
            dark[..dark.len().min(NAMED)].join("; "),
            if dark.len() > NAMED { "; …" } else { "" }
        ));
    }
    let Some(channel) = good.iter().position(|(k, _)| *k == brightest) else {
        return Err(GoniometerError::Missing("the beam"));
    };
    // What a channel's own scans say of the part of the beam in the detector.
    let beam_sigma = first.shared.beam_sigma;
    let mut differs = 0.0_f64;
    for (k, found) in &good {
        let Some((off, sigma)) = found.captured else { continue };
        if off.abs() > SAME_CAPTURED + 3.0 * sigma.hypot(beam_sigma) {
            differs = differs.max(off.abs());
            warnings.push(format!(
                "at {} nm the detector takes in {:+.2} % of the beam beside the channel at {} nm, whose beam all channels are taken to have: the beam differs with the wavelength, and that is in scale_sigma",
                bench.bands[*k].nm,
                100.0 * off,
                bench.bands[brightest].nm
            ));
        }
    }
    // One number for the scale of all: what a noisier channel has beyond it is in the σ of its values.
    let scale = median(good.iter().map(|(_, one)| one.reduced.scale_sigma)).unwrap_or(0.0);
    let mut rows: BTreeMap<u32, Sample> = BTreeMap::new();
    let mut order: Vec<u32> = first.numbers.clone();
    let n = good.len();
    let mut channels = Vec::with_capacity(n);
    // Warnings that differ in their numbers alone are one.
    let mut others: BTreeMap<String, (String, Vec<f64>)> = BTreeMap::new();
    for (place, (k, found)) in good.iter().enumerate() {
        let own = &found.reduced;
        let beyond = (own.scale_sigma.powi(2) - scale * scale).max(0.0).sqrt();
        for (number, row) in found.numbers.iter().zip(&own.samples.rows) {
            if !rows.contains_key(number) && !first.numbers.contains(number) {
                order.push(*number);
            }
            let into = rows.entry(*number).or_insert_with(|| Sample {
                brdf_per_sr: vec![f64::NAN; n],
                sigma_per_sr: vec![f64::NAN; n],
                ..row.clone()
            });
            into.brdf_per_sr[place] = row.brdf_per_sr[0];
            into.sigma_per_sr[place] = row.sigma_per_sr[0].hypot(beyond * row.brdf_per_sr[0]);
        }
        for warning in &own.warnings {
            let key = warning.chars().filter(|c| !c.is_ascii_digit()).collect();
            let entry = others.entry(key).or_insert_with(|| (warning.clone(), Vec::new()));
            entry.1.push(bench.bands[*k].nm);
        }
        let it = &own.instrument;
        channels.push(ChannelState {
            wavelength_nm: bench.bands[*k].nm,
            width_nm: bench.bands[*k].width_nm,
            unit: bench.reads.unit(),
            incident: it.incident_w,
            dark: it.dark_w,
            scale_sigma: own.scale_sigma,
            additive_per_sr: it.additive_per_sr,
            floor_per_sr: it.floor.map(|floor| floor.mean_per_sr),
            drift: it.drift.last().map(|look| look.relative - 1.0),
            over: own.over,
        });
    }
    // What one channel says alone, and what all say.
    let mut missing = first.reduced.instrument.missing.clone();
    for (text, nm) in others.into_values() {
        if let Some(what) = text.strip_prefix("not measured: ") {
            let kind = what.split(':').next().unwrap_or(what);
            if !missing.iter().any(|m| m.starts_with(kind)) {
                missing.push(format!("{what} (at {})", named_nm(&nm)));
            }
            continue;
        }
        if text.ends_with("go on with --resume") {
            continue;
        }
        let at = if nm.len() == n { String::new() } else { format!("{}: ", named_nm(&nm)) };
        warnings.push(format!("{at}{text}"));
    }
    warnings.extend(missing.iter().map(|what| format!("not measured: {what}")));
    if left > 0 {
        warnings.push(format!("{left} directions are not measured yet: go on with --resume"));
    }
    let most = |of: &dyn Fn(&Instrument) -> f64| {
        good.iter().map(|(_, one)| of(&one.reduced.instrument)).fold(0.0, f64::max)
    };
    let is_watts = bench.reads.unit() == Some("W");
    let watts = |value: Measured| if is_watts { value } else { Measured::new(f64::NAN, f64::NAN) };
    let it = &good[channel].1.reduced.instrument;
    let instrument = Instrument {
        incident_w: watts(it.incident_w),
        dark_w: watts(it.dark_w),
        channels,
        additive_per_sr: most(&|it| it.additive_per_sr),
        common_additive_per_sr: most(&|it| it.common_additive_per_sr),
        stray_bound_per_sr: it
            .stray_bound_per_sr
            .map(|_| most(&|it| it.stray_bound_per_sr.unwrap_or(0.0))),
        least_part: good.iter().map(|(_, o)| o.reduced.instrument.least_part).fold(1.0, f64::min),
        mirrored: first.reduced.instrument.mirrored,
        missing,
        ..it.clone()
    };
    let scale_sigma = scale.hypot(differs);
    let mut meta = first.reduced.samples.meta.clone();
    meta.insert("scale_sigma".into(), json!(scale_sigma));
    meta.insert("instrument".into(), json!(instrument));
    let rows: Vec<Sample> = order.iter().filter_map(|number| rows.remove(number)).collect();
    let wavelength_nm = good.iter().map(|(k, _)| bench.bands[*k].nm).collect();
    // Directions without a value in any channel.
    let over = good.iter().map(|(_, one)| one.reduced.over).min().unwrap_or(0);
    Ok(Reduced {
        samples: Samples { wavelength_nm, rows, meta },
        scans: first.reduced.scans.clone(),
        scale_sigma,
        unreachable: first.reduced.unreachable,
        left,
        over,
        refused: good[channel].1.reduced.refused,
        warnings,
        channel,
        incident: it.incident_w.value,
        instrument,
    })
}

/// Wavelengths in words: few one by one.
fn named_nm(nm: &[f64]) -> String {
    let few: Vec<String> = nm.iter().take(NAMED).map(ToString::to_string).collect();
    let more =
        if nm.len() > NAMED { format!(" and {} more", nm.len() - NAMED) } else { String::new() };
    format!("{} nm{more}", few.join(", "))
}

/// Values of one channel's lines.
fn one(lines: &[Line], given: &Given<'_>) -> Result<One, GoniometerError> {
    let Given { bench, kinematics, tasks, shared, .. } = *given;
    let reads = reads(lines);
    let of = |part: Part| reads.get(&part).map_or(&[][..], Vec::as_slice);
    let directions = of(Part::Direction);
    if directions.is_empty() {
        return Err(GoniometerError::Missing("directions"));
    }
    let dark = Dark::new(reads.get(&Part::Dark), matches!(bench.reads, Reads::Spectrometer(_)));
    if dark.is_empty() {
        return Err(GoniometerError::Missing("the dark (the beam blocked)"));
    }
    let solid_angle_sr = bench.stop.solid_angle_sr();
    let cone_half_angle_deg = bench.stop.cone_half_angle_deg();
    let mut missing: Vec<String> = given.missing.to_vec();
    let mut warnings = Vec::new();
    let net = |read: &Read| Point {
        offset_deg: f64::NAN,
        power_w: read.mean.power_w - dark.at(read),
        sigma_w: read.mean.sigma_w.hypot(dark.sigma_w(read)),
    };
    // The scans' offsets are what the stages stood off from where the beam should be.
    let scan = |part: Part, offset: &dyn Fn([f64; 4]) -> f64| -> Vec<Point> {
        let point = |read: &Read| {
            let offset_deg = offset(kinematics.bench(&read.stages, [0.0; 4]));
            Point { offset_deg, ..net(read) }
        };
        let mut points: Vec<Point> =
            of(part).iter().map(point).filter(|p| p.power_w.is_finite()).collect();
        points.sort_by(|a, b| a.offset_deg.total_cmp(&b.offset_deg));
        points
    };
    let along = scan(Part::SignatureIn, &|b| b[0] + b[1] - 180.0);
    let across = scan(Part::SignatureOut, &|b| b[2]);
    let own = || {
        if along.len() < 5 { None } else { signature(&along, &across, cone_half_angle_deg) }
    };
    let (found, captured_by) = match shared {
        None => (own(), None),
        Some(shared) => {
            let own = if shared.compare { own() } else { None };
            let off = own
                .zip(shared.signature)
                .map(|(own, all)| (own.captured / all.captured - 1.0, own.captured_sigma));
            (shared.signature, off)
        }
    };
    if found.is_none() {
        if !missing.iter().any(|m| m.starts_with("the signature")) {
            missing.push("the signature (no beam in its scans)".into());
        }
        if !along.is_empty() {
            warnings.push(
                "the scans straight through show no beam that falls to half on both sides: look at [signature] half_width_deg and at the zeros of the axes".into(),
            );
        }
    }
    let captured = found.map_or(1.0, |s| s.captured);
    // The incident power at both ends.
    let filter = given.filter;
    let of_beam = || {
        of(Part::Beam).iter().filter(|read| read.mean.power_w.is_finite() && read.mean.over == 0)
    };
    // Zeros that are off by more than the stop's half-angle and the beam's width leave the detector beside the beam.
    let dim = of_beam().map(net).find(|p| p.power_w <= 5.0 * p.sigma_w);
    if let Some(Point { power_w, .. }) = dim {
        return Err(GoniometerError::NoLight { power_w });
    }
    let beams: Vec<(f64, f64, f64)> = of_beam()
        .map(|read| {
            let point = net(read);
            let factor = 1.0 / (captured * filter);
            (read.time_s, point.power_w * factor, point.sigma_w * factor)
        })
        .collect();
    if of(Part::Beam).iter().any(|read| read.mean.over > 0) && beams.is_empty() {
        return Err(GoniometerError::BeamOver);
    }
    if beams.is_empty() {
        return Err(GoniometerError::Missing("the beam"));
    }
    if captured.is_nan() || captured < LEAST_CAPTURED {
        return Err(GoniometerError::Beside { captured: captured.max(0.0) });
    }
    // Scans that tell no signature may still be brighter elsewhere than where the beam was read.
    let brightest = along.iter().chain(&across).map(|p| p.power_w).fold(0.0, f64::max);
    let in_beam = of_beam().map(|read| net(read).power_w).fold(0.0, f64::max);
    if found.is_none() && in_beam < 0.5 * brightest {
        return Err(GoniometerError::Beside { captured: in_beam / brightest });
    }
    let lamp = Lamp::new(of(Part::Reference), &beams, &dark, &mut missing);
    if lamp.disagree > MUCH {
        warnings.push(format!(
            "the beam changed by {:.2} % more than the reference direction says between both ends of the run: half of it is in scale_sigma",
            100.0 * lamp.disagree
        ));
    }
    let zeros = match shared {
        Some(shared) => shared.zeros,
        None => zeros(bench, kinematics, found.as_ref(), &scan, &mut missing),
    };
    let floor = FloorScan::new(of(Part::Floor), kinematics, &dark, &lamp, solid_angle_sr);
    let mirrored = match shared {
        Some(_) => None,
        None => mirrored(bench, found.as_ref(), cone_half_angle_deg, &scan),
    };
    // All directions.
    let sizes = Sizes {
        beam_mm: bench.beam.diameter_mm.get(),
        width_mm: bench.sample.width_mm.get(),
        height_mm: bench.sample.height_mm.get(),
        field_mm: bench.field_mm,
    };
    let errors = [
        zeros.sample_deg.value,
        zeros.detector_deg.value,
        zeros.azimuth_deg.map_or(0.0, |z| z.value),
        0.0,
    ];
    let least_part = bench.sample.least_part.get();
    let (mut rows, mut over, mut refused) = (Vec::new(), 0, 0);
    let mut smallest_part = 1.0_f64;
    let (mut additive, mut common_additive) = (Vec::new(), Vec::new());
    let mut numbers = Vec::new();
    for read in directions {
        // One of a range whose dark is not known has no value either.
        if read.mean.over > 0 || !(read.mean.power_w - dark.at(read)).is_finite() {
            over += 1;
            continue;
        }
        let angles = kinematics.bench(&read.stages, errors);
        let pose = Kinematics::pose(angles);
        let o = direction(pose.theta_o_deg, pose.phi_o_deg - pose.phi_i_deg);
        let part = sizes.part(pose.theta_i_deg, pose.phi_i_deg, o);
        if part < least_part || pose.theta_i_deg >= 90.0 || o.z <= 0.0 {
            refused += 1;
            continue;
        }
        smallest_part = smallest_part.min(part);
        let (incident, drift) = lamp.at(read.time_s);
        let point = net(read);
        let (stray, stray_sigma) = floor.at(angles[1]);
        let per_watt = 1.0 / (incident * solid_angle_sr * o.z * part);
        let value = (point.power_w - stray * incident * solid_angle_sr) * per_watt;
        let noise = point.sigma_w * per_watt;
        let from_floor = stray_sigma / (o.z * part);
        let common = (dark.sigma_w(read) * per_watt).hypot(from_floor);
        common_additive.push(common);
        additive.push((dark.noise_w(read) * per_watt).hypot(common));
        numbers.push(read.number);
        rows.push(Row {
            pose,
            value,
            sigma: noise.hypot(from_floor).hypot(value * drift),
            cos: o.z * part,
        });
    }
    if rows.is_empty() {
        return Err(GoniometerError::Nothing { directions: directions.len(), over, refused });
    }
    if over > 0 {
        warnings.push(format!("{over} directions were over the meter's range: they have no value"));
    }
    if refused > 0 {
        warnings.push(format!(
            "{refused} directions have less than {:.0} % of the beam on the sample and in the detector's field: they are left out (a narrower beam, or [sample] least_part)",
            100.0 * least_part
        ));
    }
    let mut stray_bound_per_sr = None;
    if floor.points.is_empty() {
        // Stray light is not more than the least that was seen.
        let least = rows.iter().map(|r| r.value * r.cos).fold(f64::INFINITY, f64::min).max(0.0);
        stray_bound_per_sr = Some(least);
        for row in &mut rows {
            row.sigma = row.sigma.hypot(least / row.cos);
        }
        for text in missing.iter_mut().filter(|m| m.starts_with("stray light")) {
            *text += &format!(": up to {least:.2e} /sr, the least that was seen, is in σ");
        }
    }
    widen(&mut rows, &zeros);
    for text in missing.iter_mut().filter(|m| m.starts_with("the signature")) {
        if found.is_none() && !text.contains(':') {
            *text += &format!(
                ": the detector is taken to hold the whole beam, ± {:.0} % in scale_sigma",
                100.0 * WITHOUT_SIGNATURE
            );
        }
    }
    let beam_sigma = found.map_or(WITHOUT_SIGNATURE, |s| s.captured_sigma);
    if found.is_some_and(|s| s.centre_out_deg.is_none()) {
        for text in missing.iter_mut().filter(|m| m.starts_with("the signature across")) {
            *text += &format!(
                ": the beam is taken to be half to twice as wide there as in the plane, ± {:.2} % in scale_sigma",
                100.0 * beam_sigma
            );
        }
    }
    if bench.polarised().is_none() {
        missing.push("the polarisation of beam and detector ([beam] polarised, [aperture] polarised): any is taken as likely, which a reflection tells most of at 56°".into());
    }
    for what in &missing {
        warnings.push(format!("not measured: {what}"));
    }
    let scale_sigma = bench
        .stop_sigma
        .hypot(bench.beam.filter_relative_sigma.get())
        .hypot(beam_sigma)
        .hypot(lamp.scale_sigma)
        .hypot(0.5 * lamp.disagree);
    // Of a spectrometer's integrations the last is the longest.
    let dark_w = match dark.all.last().filter(|_| dark.by_range) {
        Some(longest) => {
            let points = &longest.points;
            let mean = points.iter().map(|p| p.1).sum::<f64>() / points.len() as f64;
            Measured::new(mean, longest.sigma_w)
        }
        None => {
            let all = of(Part::Dark);
            let mean = all.iter().map(|r| r.mean.power_w).sum::<f64>() / all.len() as f64;
            Measured::new(mean, dark.all[0].sigma_w)
        }
    };
    let instrument = Instrument {
        wavelength_nm: given.band.nm,
        solid_angle_sr,
        cone_half_angle_deg,
        incident_w: Measured::new(lamp.scale_w, lamp.scale_w * lamp.scale_sigma.hypot(beam_sigma)),
        dark_w,
        channels: Vec::new(),
        signature: found,
        floor: floor.summary(),
        additive_per_sr: median(additive).unwrap_or(0.0),
        common_additive_per_sr: median(common_additive).unwrap_or(0.0),
        stray_bound_per_sr,
        zeros,
        drift: lamp.looks,
        mirrored,
        least_part: smallest_part,
        polarisation: [bench.beam.polarisation.clone(), bench.detector_polarisation.clone()],
        polarised: bench.polarised(),
        detector_polarised: bench.detector_polarised.unwrap_or(0.0),
        sample_index: bench.sample.index.map(|(n, k)| Index { n: n.get(), k: k.get() }),
        missing,
    };
    let known: HashSet<u32> = directions.iter().map(|read| read.number).collect();
    let left = |task: &&Task| task.part == Part::Direction && !known.contains(&task.number);
    let left = tasks.iter().filter(left).count();
    if left > 0 {
        warnings.push(format!("{left} directions are not measured yet: go on with --resume"));
    }
    let mut meta = Meta::new();
    meta.insert("solid_angle_sr".into(), json!(solid_angle_sr));
    meta.insert("scale_sigma".into(), json!(scale_sigma));
    meta.insert("instrument".into(), json!(instrument));
    let rows = rows.into_iter().map(|row| Sample {
        theta_i_deg: row.pose.theta_i_deg,
        phi_i_deg: row.pose.phi_i_deg,
        theta_o_deg: row.pose.theta_o_deg,
        phi_o_deg: row.pose.phi_o_deg,
        brdf_per_sr: vec![row.value],
        sigma_per_sr: vec![row.sigma],
    });
    let samples = Samples { wavelength_nm: vec![given.band.nm], rows: rows.collect(), meta };
    let incident = instrument.incident_w.value;
    let reduced = Reduced {
        samples,
        instrument,
        scans: [along, across],
        scale_sigma,
        unreachable: given.unreachable,
        left,
        over,
        refused,
        warnings,
        channel: 0,
        incident,
    };
    let shared = Shared { signature: found, zeros, beam_sigma, compare: false };
    Ok(One { reduced, numbers, shared, captured: captured_by })
}

struct Row {
    pose: Pose,
    value: f64,
    sigma: f64,
    cos: f64,
}

/// The incident power through the run.
struct Lamp {
    looks: Vec<Look>,
    track: Track,
    /// Incident power over the first look's light, W; the power itself where there is no reference.
    scale_w: f64,
    /// Relative standard uncertainty of that.
    scale_sigma: f64,
    /// How far the two ends of the beam and the reference direction disagree, relative.
    disagree: f64,
}

impl Lamp {
    fn new(
        references: &[Read],
        beams: &[(f64, f64, f64)],
        dark: &Dark,
        missing: &mut Vec<String>,
    ) -> Self {
        let mut all: Vec<&Read> =
            references.iter().filter(|r| r.mean.over == 0 && r.mean.power_w.is_finite()).collect();
        all.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        let net = |r: &Read| r.mean.power_w - dark.at(r);
        let light = |r: &&Read| net(r) > 10.0 * r.mean.sigma_w.hypot(dark.sigma_w(r));
        if all.is_empty() || !all.iter().all(light) {
            if !missing.iter().any(|m| m.starts_with("the reference")) {
                missing.push("the reference direction (no light there): the lamp's drift is taken as even between both readings of the beam".into());
            }
            let points = beams.iter().map(|b| (b.0, b.1 / beams[0].1, b.2 / beams[0].1));
            let track = Track::new(points.collect());
            let (scale_w, scale_sigma) = (beams[0].1, beams[0].2 / beams[0].1);
            return Self { looks: vec![], track, scale_w, scale_sigma, disagree: 0.0 };
        }
        let first = net(all[0]);
        let looks: Vec<Look> = all
            .iter()
            .map(|r| Look {
                time_s: r.time_s,
                relative: net(r) / first,
                sigma: r.mean.sigma_w.hypot(dark.sigma_w(r)) / first,
            })
            .collect();
        let track = Track::new(looks.iter().map(|l| (l.time_s, l.relative, l.sigma)).collect());
        let gains: Vec<(f64, f64)> = beams
            .iter()
            .map(|b| {
                let (here, sigma) = track.at(b.0);
                (b.1 / here, (b.2 / b.1).hypot(sigma / here))
            })
            .collect();
        // Those next to a look weigh more: the lamp has walked less.
        let weight = |g: &(f64, f64)| 1.0 / (g.1 * g.1).max(1e-18);
        let weights: f64 = gains.iter().map(weight).sum();
        let scale_w = gains.iter().map(|g| weight(g) * g.0).sum::<f64>() / weights;
        let scale_sigma = weights.sqrt().recip();
        // Of the beam just before the sample came and the one after it went.
        let ends = gains.len().saturating_sub(2);
        let of_ends = &gains[ends..];
        let high = of_ends.iter().map(|g| g.0).fold(f64::NEG_INFINITY, f64::max);
        let low = of_ends.iter().map(|g| g.0).fold(f64::INFINITY, f64::min);
        Self { looks, track, scale_w, scale_sigma, disagree: (high - low) / scale_w }
    }

    /// Incident power at a time, W, and its relative uncertainty by the drift and the looks' noise.
    fn at(&self, time_s: f64) -> (f64, f64) {
        let (here, sigma) = self.track.at(time_s);
        (self.scale_w * here, sigma / here.abs().max(f64::MIN_POSITIVE))
    }
}

/// A number that walks at random and is seen now and then with noise: what it was meanwhile, after Rauch, Tung and Striebel (AIAA Journal 3, 1445, 1965). How fast it walks is
/// what looks differ by beyond their noise, over the number of steps where that is most.
struct Track {
    /// Time, value, variance.
    points: Vec<(f64, f64, f64)>,
    /// Variance that it gains in a second.
    walk: f64,
}

impl Track {
    /// From times, values and standard uncertainties.
    fn new(seen: Vec<(f64, f64, f64)>) -> Self {
        // Over any number of steps: a slow drift shows over many alone.
        let over = |lag: usize| {
            let pairs = || seen.iter().zip(&seen[lag..]);
            let beyond: f64 =
                pairs().map(|(a, b)| (b.1 - a.1).powi(2) - a.2 * a.2 - b.2 * b.2).sum();
            let time: f64 = pairs().map(|(a, b)| b.0 - a.0).sum();
            if time > 0.0 { beyond / time } else { 0.0 }
        };
        let walk = (1..seen.len()).map(over).fold(0.0, f64::max);
        // Forwards.
        let mut forwards: Vec<(f64, f64, f64, f64)> = Vec::with_capacity(seen.len());
        for (time_s, value, sigma) in &seen {
            let noise = (sigma * sigma).max(1e-18);
            let (value, variance, before) = match forwards.last() {
                None => (*value, noise, noise),
                Some((t, x, p, _)) => {
                    let before = p + walk * (time_s - t);
                    let gain = before / (before + noise);
                    (x + gain * (value - x), before * (1.0 - gain), before)
                }
            };
            forwards.push((*time_s, value, variance, before));
        }
        // Backwards.
        let mut points: Vec<(f64, f64, f64)> =
            forwards.iter().map(|(t, x, p, _)| (*t, *x, *p)).collect();
        for k in (0..points.len().saturating_sub(1)).rev() {
            let (_, x, p, _) = forwards[k];
            let before = forwards[k + 1].3;
            let back = p / before;
            let (_, next, variance) = points[k + 1];
            points[k].1 = x + back * (next - x);
            points[k].2 = p + back * back * (variance - before);
        }
        Self { points, walk }
    }

    /// Value at a time and its standard uncertainty.
    fn at(&self, time_s: f64) -> (f64, f64) {
        let k = self.points.partition_point(|p| p.0 < time_s);
        match (k.checked_sub(1).map(|j| self.points[j]), self.points.get(k)) {
            (Some(a), Some(b)) if b.0 > a.0 => {
                let t = (time_s - a.0) / (b.0 - a.0);
                let bridge = self.walk * (b.0 - a.0) * t * (1.0 - t);
                let known = ((1.0 - t) * a.2.sqrt() + t * b.2.sqrt()).powi(2);
                (a.1 + t * (b.1 - a.1), (known + bridge).sqrt())
            }
            (Some(a), _) => (a.1, (a.2 + self.walk * (time_s - a.0)).sqrt()),
            (None, Some(b)) => (b.1, (b.2 + self.walk * (b.0 - time_s)).sqrt()),
            (None, None) => (f64::NAN, f64::NAN),
        }
    }
}

/// Stray light by the detector's angle.
struct FloorScan {
    /// Angle, light over incident power and solid angle, its uncertainty.
    points: Vec<(f64, f64, f64)>,
}

impl FloorScan {
    fn new(
        reads: &[Read],
        kinematics: &Kinematics,
        dark: &Dark,
        lamp: &Lamp,
        solid_angle_sr: f64,
    ) -> Self {
        let good = reads.iter().filter(|r| r.mean.over == 0 && r.mean.power_w.is_finite());
        let mut points: Vec<(f64, f64, f64)> = good
            .map(|r| {
                let per_watt = 1.0 / (lamp.at(r.time_s).0 * solid_angle_sr);
                let net = r.mean.power_w - dark.at(r);
                let angle = kinematics.bench(&r.stages, [0.0; 4])[1];
                (angle, net * per_watt, r.mean.sigma_w.hypot(dark.sigma_w(r)) * per_watt)
            })
            .collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        Self { points }
    }

    /// Stray light at an angle of the detector, and its uncertainty: noise, and half of the change to the next angle that was read.
    fn at(&self, detector_deg: f64) -> (f64, f64) {
        if self.points.is_empty() {
            return (0.0, 0.0);
        }
        let values: Vec<(f64, f64)> = self.points.iter().map(|p| (p.0, p.1)).collect();
        let k = self.points.partition_point(|p| p.0 < detector_deg);
        let a = self.points[k.saturating_sub(1)];
        let b = self.points[k.min(self.points.len() - 1)];
        (between(&values, detector_deg), a.2.max(b.2).hypot(0.5 * (a.1 - b.1)))
    }

    fn summary(&self) -> Option<Floor> {
        let values = || self.points.iter().map(|p| p.1);
        (!self.points.is_empty()).then(|| Floor {
            mean_per_sr: values().sum::<f64>() / self.points.len() as f64,
            least_per_sr: values().fold(f64::INFINITY, f64::min),
            largest_per_sr: values().fold(f64::NEG_INFINITY, f64::max),
        })
    }
}

/// Points of a part's scan by an offset of the bench's angles.
type Scan<'a> = dyn Fn(Part, &dyn Fn([f64; 4]) -> f64) -> Vec<Point> + 'a;

/// The peaks of the lobe seen from both sides: offsets of the detector's stage from where the mirrored direction should be, degrees.
fn peaks(
    bench: &Bench,
    kinematics: &Kinematics,
    scan: &Scan<'_>,
) -> Option<[super::signature::Peak; 2]> {
    let theta = bench.zero.theta_i_deg.get();
    // The stage's offset, not the angle from the normal: an arm on the table does not turn with the sample.
    let offset = |sign: f64| {
        move |b: [f64; 4]| {
            if kinematics.is_from_lamp() {
                b[0] + b[1] - 2.0 * sign * theta
            } else {
                b[1] - sign * theta
            }
        }
    };
    let plus = peak(&scan(Part::ZeroPlus, &offset(1.0)))?;
    let minus = peak(&scan(Part::ZeroMinus, &offset(-1.0)))?;
    Some([plus, minus])
}

fn zeros(
    bench: &Bench,
    kinematics: &Kinematics,
    signature: Option<&Signature>,
    scan: &Scan<'_>,
    missing: &mut Vec<String>,
) -> Zeros {
    let unknown = Measured::new(0.0, bench.zero.sigma_deg.get());
    let mut zeros = Zeros {
        sample_deg: unknown,
        detector_deg: unknown,
        azimuth_deg: kinematics.has(2).then_some(unknown),
        measured: false,
    };
    if let Some(centre) = signature.and_then(|s| s.centre_out_deg) {
        zeros.azimuth_deg = Some(centre);
    }
    let named = missing.iter().any(|m| m.starts_with("the axes' zeros"));
    let found = peaks(bench, kinematics, scan).zip(signature);
    let Some(([plus, minus], signature)) = found else {
        if named {
            for text in missing.iter_mut().filter(|m| m.starts_with("the axes' zeros")) {
                *text += &format!(": ± {}° of each is in σ", unknown.sigma);
            }
        } else {
            let why = if signature.is_none() {
                "they need the signature"
            } else {
                "the sample has no lobe there"
            };
            missing.push(format!("the axes' zeros ({why}): ± {}° of each is in σ", unknown.sigma));
        }
        return zeros;
    };
    // Lit from both sides a lobe that is off its mirrored direction is so to both sides: the mean does not know of it.
    let c = 0.5 * (plus.place_deg.value + minus.place_deg.value);
    let sigma = 0.5 * plus.place_deg.sigma.hypot(minus.place_deg.sigma);
    let x = signature.centre_in_deg;
    if kinematics.is_from_lamp() {
        zeros.detector_deg = x;
        zeros.sample_deg = Measured::new(0.5 * (x.value - c), 0.5 * x.sigma.hypot(sigma));
    } else {
        let half = 0.5 * x.sigma.hypot(sigma);
        zeros.detector_deg = Measured::new(0.5 * (x.value + c), half);
        zeros.sample_deg = Measured::new(0.5 * (x.value - c), half);
    }
    zeros.measured = true;
    zeros
}

fn mirrored(
    bench: &Bench,
    signature: Option<&Signature>,
    cone_deg: f64,
    scan: &Scan<'_>,
) -> Option<Mirrored> {
    let signature = signature?;
    let theta_i_deg = bench.zero.theta_i_deg.get();
    let points = scan(Part::ZeroPlus, &|b| b[1] - theta_i_deg);
    // A lobe that does not fall to half in the scan has no width there.
    let seen_fwhm_deg = fwhm_deg(&points)?;
    let own = lobe_fwhm_deg(&points, signature, cone_deg, theta_i_deg);
    let widest = signature.fwhm_in_deg.max(signature.fwhm_out_deg.unwrap_or(0.0));
    let told = |own: &Measured| own.sigma < BELOW * own.value && own.value > LEAST * widest;
    Some(Mirrored {
        theta_i_deg,
        seen_fwhm_deg,
        instrument_fwhm_deg: signature.fwhm_in_deg,
        sample_fwhm_deg: own.filter(told),
    })
}

/// Adds the uncertainty of the axes' zeros: the slope of ln f to the nearest directions of the same incidence, times the zeros' uncertainty.
fn widen(rows: &mut [Row], zeros: &Zeros) {
    const NEAREST: usize = 4;
    let sigma_deg = zeros.sample_deg.sigma.hypot(zeros.detector_deg.sigma);
    if sigma_deg <= 0.0 {
        return;
    }
    let place: Vec<glam::DVec3> =
        rows.iter().map(|r| direction(r.pose.theta_o_deg, r.pose.phi_o_deg)).collect();
    let mut order: Vec<usize> = (0..rows.len()).collect();
    order.sort_by(|a, b| rows[*a].pose.theta_i_deg.total_cmp(&rows[*b].pose.theta_i_deg));
    let mut slopes = vec![0.0; rows.len()];
    for (at, k) in order.iter().enumerate() {
        let here = &rows[*k];
        let same = |j: &&usize| (rows[**j].pose.theta_i_deg - here.pose.theta_i_deg).abs() < 0.01;
        let up = order[at + 1..].iter().take_while(same);
        let down = order[..at].iter().rev().take_while(same);
        let mut near: Vec<(f64, f64)> = up
            .chain(down)
            .filter(|j| rows[**j].value > 0.0 && here.value > 0.0)
            .map(|j| {
                let away = (place[*j] - place[*k]).length().to_degrees();
                (away, (rows[*j].value / here.value).ln().abs())
            })
            .collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        let steep = near.iter().take(NEAREST).map(|(away, ratio)| ratio / away.max(1e-3));
        slopes[*k] = median(steep).unwrap_or(0.0);
    }
    for (row, slope) in rows.iter_mut().zip(slopes) {
        let cosine = row.pose.theta_o_deg.to_radians().tan() * sigma_deg.to_radians();
        row.sigma = row.sigma.hypot(row.value * slope * sigma_deg).hypot(row.value * cosine);
    }
}

/// Whether a reference was read because a run went on.
#[must_use]
pub fn is_resumed(number: u32) -> bool {
    number >= RESUMED
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: closed forms. Without a walk all looks are one mean, σ/√n; without noise they stand as they are, and half way between two the bridge of a random walk
    /// has the variance q dt/4.
    #[test]
    fn a_lamp_is_followed() {
        let still: Vec<(f64, f64, f64)> =
            (0..16).map(|k| (f64::from(k), 1.0 + [0.001, -0.001][k as usize % 2], 0.004)).collect();
        let track = Track::new(still);
        assert_eq!(track.walk, 0.0);
        for time in [0.0, 3.3, 15.0, 40.0] {
            let (value, sigma) = track.at(time);
            assert!((value - 1.0).abs() < 1e-12 && (sigma - 0.001).abs() < 1e-9, "{value} {sigma}");
        }
        let walk = [(0.0, 1.0, 0.0), (10.0, 1.02, 0.0), (20.0, 1.0, 0.0)];
        let track = Track::new(walk.to_vec());
        assert!((track.walk - 0.0004 / 10.0).abs() < 1e-9);
        assert!((track.at(10.0).0 - 1.02).abs() < 1e-9);
        let (value, sigma) = track.at(15.0);
        assert!((value - 1.01).abs() < 1e-9 && (sigma / 1e-2 - 1.0).abs() < 1e-6, "{sigma}");
    }
}
