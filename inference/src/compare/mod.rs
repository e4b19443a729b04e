//! A measured pass beside the simulated one, on the same epochs.
//!
//! The scene is simulated at the measured times, averaged over each exposure, and set beside: residuals, ratios of the channels, what both claim of their
//! errors. Nothing is fitted but a scale for each channel, which is given.
//!
//! - [`MeasuredPass`]: what was measured; [`Kappa`]: what calibrated it;
//! - [`at_measured_times`]: the scene at the measured times;
//! - [`compare()`]: simulates it, and sets both side by side: [`Comparison`].
//!
//! ```no_run
//! use std::path::Path;
//! use sunglint_inference::compare::{MeasuredPass, at_measured_times, compare};
//! use sunglint_numerics::progress::Silent;
//! use sunglint_radiometry::light_curve::published::MagnitudeOptions;
//! use sunglint_simulator::pass::{Overrides, PassFile};
//!
//! let scene = PassFile::read("pass.toml")?.resolve(Overrides::default())?;
//! // The options are for magnitudes; a calibrated curve needs none of them.
//! let options = MagnitudeOptions::default();
//! let mut measured = MeasuredPass::read(Path::new("calibrated.ecsv"), &options, &scene)?;
//! measured.keep(&["g".to_owned()], &scene.station)?;
//! let scene = at_measured_times(scene, &measured)?;
//! let compared = compare(&scene, measured, &Silent)?;
//! for pair in &compared.pairs {
//!     println!("{}: {:?}", pair.measured.name, pair.channel.numbers);
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod error;
mod kappa;
mod measured;

pub use error::CompareError;
pub use kappa::{Kappa, KappaRow};
pub use measured::{MeasuredChannel, MeasuredPass, Quantity, magnitude};

use crate::progress::Stages;
use hifitime::Epoch;
use rayon::prelude::*;
use std::ops::Range;
use sunglint_calibration::comparison::{
    self, Axis, Bin, Blocks, Channel, Given, Ratio, TimeShift, something_left, time_shift,
};
use sunglint_calibration::stars::scintillation::{Aperture, USUAL_COEFFICIENT};
use sunglint_formats::time::tai_nanoseconds;
use sunglint_numerics::order::median;
use sunglint_numerics::progress::Progress;
use sunglint_radiometry::air::Zenith;
use sunglint_radiometry::light_curve::Flags;
use sunglint_simulator::pass::file::MOST_SAMPLES;
use sunglint_simulator::pass::{Cost, Stopwatch};
use sunglint_simulator::pass::{ExposureMeans, MaterialDoubt, Pass, Simulation};

/// A ratio of measured to simulated light beyond which, or below the inverse of which, no albedo or attitude explains it.
const ABSURD: f64 = 1000.0;

/// Stretches of a track in which ratios of channels are taken.
const STRETCHES: usize = 60;
/// Rows of a stretch at least.
const STRETCH_ROWS: usize = 8;
/// Bins of an angle or an airmass.
const BINS: usize = 12;

/// Computing effort of a comparison.
#[derive(Debug, Clone)]
pub struct Effort {
    /// The simulation of the middles of the exposures.
    pub middles: Cost,
    /// The means over the exposures.
    pub means: Cost,
}

/// A channel with all that is known of each sample, in the rows of the measured file.
#[derive(Debug, Clone)]
pub struct ComparedChannel {
    /// Measured data.
    pub measured: MeasuredChannel,
    /// Simulated values: means over the exposures; NaN outside the scene's times.
    pub simulated: Vec<f64>,
    /// Stated error of the simulated values.
    pub model_error: Vec<f64>,
    /// Half-width of the 95 % interval of the simulated values by the doubt of the materials; `None` where no material says how well it is known.
    pub material: Option<Vec<f64>>,
    /// Which samples count, and what they say.
    pub channel: Channel,
    /// Residuals in bins, along each axis.
    pub bins: Vec<(Axis, Vec<Bin>)>,
}

/// Where the target stood at each row of the measured file; NaN outside the scene's times.
#[derive(Debug, Clone, Default)]
pub struct Course {
    /// Distance, m.
    pub range_m: Vec<f64>,
    /// Phase angle, degrees.
    pub phase_deg: Vec<f64>,
    /// True zenith angle, degrees.
    pub zenith_deg: Vec<f64>,
    /// Airmass of the pass's air; all NaN where there is none.
    pub airmass: Vec<f64>,
}

/// A scene at the measured times that lie within its own.
#[derive(Debug, Clone)]
pub struct SceneAtTimes {
    /// The scene, with these times.
    pub pass: Pass,
    /// The rows of the measured file that they are of, in order.
    pub rows: Vec<usize>,
}

/// A measured pass beside the simulated one.
pub struct Comparison<'a> {
    /// Measured data.
    pub measured: MeasuredPass,
    /// Simulation of the pass.
    pub simulation: Simulation<'a>,
    /// Means of the simulation over the exposures, one row for each simulated exposure.
    pub means: ExposureMeans,
    /// The rows of the measured file that were simulated.
    pub rows: Vec<usize>,
    /// Exposures of all rows, s.
    pub exposure_s: Vec<f64>,
    /// Channel by channel.
    pub pairs: Vec<ComparedChannel>,
    /// Channels over the one that is known best.
    pub ratios: Vec<Ratio>,
    /// Doubt of the materials at the middles of the exposures; `None` where none says how well it is known.
    pub material: Option<MaterialDoubt>,
    /// Where the target stood.
    pub course: Course,
    /// Computing effort.
    pub effort: Effort,
    /// Warnings for the user.
    pub warnings: Vec<String>,
}

/// A scene at the measured times that lie within its own (a step's room at both ends), and the rows of those.
///
/// # Errors
/// A scene without times; spans of time that do not meet; more samples than are compared.
pub fn at_measured_times(
    scene: Pass,
    measured: &MeasuredPass,
) -> Result<SceneAtTimes, CompareError> {
    let mut own = scene.times.clone();
    own.sort_by_key(|t| tai_nanoseconds(*t));
    let seconds: Vec<f64> = own.iter().map(|t| tai_nanoseconds(*t) as f64 * 1e-9).collect();
    let room_s = sunglint_radiometry::light_curve::usual_step_s(&seconds);
    let (Some(first), Some(last)) = (own.first(), own.last()) else {
        return Err(CompareError::NoTimes);
    };
    let within =
        comparison::overlap(&measured.times, (*first, *last), room_s).map_err(|source| {
            CompareError::Times {
                path: measured.path.clone(),
                scene: scene.name.clone(),
                source: Box::new(source),
            }
        })?;
    let rows: Vec<usize> = (0..within.len()).filter(|i| within[*i]).collect();
    if rows.len() > MOST_SAMPLES {
        return Err(CompareError::TooMany {
            path: measured.path.clone(),
            samples: rows.len(),
            most: MOST_SAMPLES,
        });
    }
    let usual = scene.exposure_s.first().copied().unwrap_or(0.1);
    let exposure = |i: usize| measured.exposure_s.as_ref().map_or(usual, |e| e[i]);
    let times: Vec<Epoch> = rows.iter().map(|i| measured.times[*i]).collect();
    let exposure_s = rows.iter().map(|i| exposure(*i)).collect();
    let edges_nm = scene.edges_nm.iter().copied();
    // Rates and magnitudes need no bins.
    let edges_nm = edges_nm.clone().take(1).chain(edges_nm.last()).collect();
    let file_rows: Vec<usize> = rows.iter().map(|i| measured.file_rows[*i]).collect();
    let pass = Pass { edges_nm, ..scene }.at_times(times, exposure_s, &file_rows)?;
    Ok(SceneAtTimes { pass, rows })
}

/// Simulates a scene at the measured times, averages it over the exposures, and sets it beside what was measured.
///
/// # Errors
/// A scene that cannot be simulated; no sample that is left to compare.
pub fn compare<'a>(
    scene: &'a SceneAtTimes,
    measured: MeasuredPass,
    progress: &dyn Progress,
) -> Result<Comparison<'a>, CompareError> {
    let pass = &scene.pass;
    let (watch, stages) = (Stopwatch::new(pass.times.len()), Stages::new(progress));
    let simulation = pass.simulate(&|at| {
        watch.tell(at);
        stages.tell(at);
    })?;
    let (again, stages) = (Stopwatch::new(pass.times.len()), Stages::new(progress));
    let means =
        simulation.exposure_means(&|s| measured.quantity.of(s, &measured.channels), &|at| {
            again.tell(at);
            stages.tell(at);
        })?;
    let effort = Effort { middles: watch.cost(), means: again.cost() };
    let material = simulation.material_doubt(&|_| {})?;
    Comparison::new(measured, simulation, (means, material), scene.rows.clone(), effort)
}

impl<'a> Comparison<'a> {
    /// Sets them beside one another. `rows` are those of the measured file that the simulation has, in order.
    fn new(
        measured: MeasuredPass,
        simulation: Simulation<'a>,
        (means, material): (ExposureMeans, Option<MaterialDoubt>),
        rows: Vec<usize>,
        effort: Effort,
    ) -> Result<Self, CompareError> {
        let n = measured.times.len();
        let usual = simulation.pass.exposure_s[0];
        let exposure_s = measured.exposure_s.clone().unwrap_or_else(|| vec![usual; n]);
        let course = course(&simulation, &rows, n);
        let mut within = vec![false; n];
        let mut hidden = vec![Flags::empty(); n];
        for (k, i) in rows.iter().enumerate() {
            within[*i] = true;
            hidden[*i] = simulation.flags(k);
        }
        let variance = twinkling(&simulation, &course, &exposure_s);
        let errors = measured.quantity.errors(&simulation, &measured.channels);
        let middle = measured.quantity.of(&simulation, &measured.channels);
        let blocks = Blocks::new(n);
        let all = |values: &dyn Fn(usize) -> f64| {
            let mut full = vec![f64::NAN; n];
            rows.iter().enumerate().for_each(|(k, i)| full[*i] = values(k));
            full
        };
        let doubts = material
            .as_ref()
            .map(|doubt| measured.quantity.material(doubt, &simulation, &measured.channels));
        // Light, its error, and the doubt of the materials.
        type Columns = (Vec<f64>, Vec<f64>, Option<Vec<f64>>);
        let columns: Vec<Columns> = (0..measured.channels.len())
            .map(|c| {
                let simulated = all(&|k| means.values[[k, c]]);
                let share = |k: usize| {
                    let (mean, middle) = (means.values[[k, c]], middle[[k, c]]);
                    if mean > 0.0 && middle > 0.0 { mean / middle } else { 1.0 }
                };
                let error = all(&|k| errors[[k, c]] * share(k) + means.unsettled[[k, c]]);
                let doubt = doubts.as_ref().map(|d| all(&|k| d[[k, c]] * share(k)));
                (simulated, error, doubt)
            })
            .collect();
        let given: Vec<Given<'_>> = measured
            .channels
            .iter()
            .zip(&columns)
            .map(|(channel, (simulated, model_error, material))| Given {
                name: &channel.name,
                exposure_s: &exposure_s,
                measured: &channel.value,
                sigma: &channel.sigma,
                flags: &channel.flags,
                simulated,
                model_error,
                material: material.as_deref(),
                simulated_flags: &hidden,
                within: &within,
                twinkling: variance.as_deref(),
                common_sigma: measured
                    .kappa
                    .as_ref()
                    .and_then(|k| Some(k.row(&channel.name)?.relative_sigma)),
                of_magnitudes: measured.quantity != Quantity::Rate,
            })
            .collect();
        let channels: Vec<Channel> = given.iter().map(|g| Channel::new(g, &blocks)).collect();
        something_left(&channels).map_err(|source| CompareError::NothingLeft {
            path: measured.path.clone(),
            source: Box::new(source),
        })?;
        let ratios = ratios(&measured, &given, &channels, &blocks);
        let axes = [(Axis::Phase, &course.phase_deg), (Axis::Airmass, &course.airmass)];
        let bins: Vec<Vec<(Axis, Vec<Bin>)>> = given
            .iter()
            .zip(&channels)
            .map(|(g, c)| {
                let of = |(axis, values): (Axis, &Vec<f64>)| {
                    let edges = comparison::edges(values, BINS);
                    (axis, comparison::bins(g, c, values, &edges))
                };
                axes.map(of).to_vec()
            })
            .collect();
        let mut warnings = warnings(&measured, &simulation, &means, &channels, rows.len());
        let seconds: Vec<f64> =
            measured.times.iter().map(|t| (*t - measured.times[0]).to_seconds()).collect();
        let pairs: Vec<(&Given<'_>, &Channel)> = given.iter().zip(&channels).collect();
        warnings.extend(
            time_shift(&seconds, &pairs).map(|shift| shifted(&shift, &measured, &exposure_s)),
        );
        let pairs = (measured.channels.iter().cloned())
            .zip(columns)
            .zip(channels)
            .zip(bins)
            .map(|(((measured, column), channel), bins)| {
                let (simulated, model_error, material) = column;
                ComparedChannel { measured, simulated, model_error, material, channel, bins }
            })
            .collect();
        Ok(Self {
            measured,
            simulation,
            means,
            rows,
            exposure_s,
            pairs,
            ratios,
            material,
            course,
            effort,
            warnings,
        })
    }

    /// Returns a title of the comparison, in a line.
    pub fn title(&self) -> String {
        let pass = self.simulation.pass;
        let name = if self.measured.target.is_empty() {
            pass.object().to_owned()
        } else {
            self.measured.target.clone()
        };
        format!("{name}: measured from {} and simulated as {}", pass.station.name, pass.target.name)
    }

    /// Stretches of rows without a long gap.
    pub fn tracks(&self) -> Vec<Range<usize>> {
        let tracks = sunglint_radiometry::light_curve::tracks(&self.measured.times);
        tracks.into_iter().map(|t| t.samples).collect()
    }

    /// Samples that count, over all channels, and all that there are.
    pub fn numbers(&self) -> (usize, usize) {
        let used = self.pairs.iter().map(|p| p.channel.samples - p.channel.left_out.samples).sum();
        (used, self.pairs.iter().map(|p| p.channel.samples).sum())
    }

    /// Whether the values are rates, not magnitudes.
    pub fn is_rate(&self) -> bool {
        self.measured.quantity == Quantity::Rate
    }
}

fn course(simulation: &Simulation<'_>, rows: &[usize], n: usize) -> Course {
    let full = |values: Vec<f64>| {
        let mut all = vec![f64::NAN; n];
        rows.iter().zip(values).for_each(|(i, v)| all[*i] = v);
        all
    };
    let places = &simulation.places;
    let airmass = |zenith_deg: Option<f64>| {
        let (Some(air), Some(z)) = (&simulation.pass.air, zenith_deg) else { return f64::NAN };
        air.path(Zenith::Apparent(z)).map_or(f64::NAN, |path| air.air_masses(&path).rayleigh)
    };
    Course {
        range_m: full(places.iter().map(|p| p.geometry.range_m).collect()),
        phase_deg: full(places.iter().map(|p| p.geometry.phase_deg()).collect()),
        zenith_deg: full(places.iter().map(|p| p.geometry.zenith_deg()).collect()),
        airmass: full(places.par_iter().map(|p| airmass(p.apparent_zenith_deg)).collect()),
    }
}

/// The relative variance of each sample by twinkling, by Young's law; `None` without an airmass.
fn twinkling(simulation: &Simulation<'_>, course: &Course, exposure_s: &[f64]) -> Option<Vec<f64>> {
    simulation.pass.air.as_ref()?;
    let station = &simulation.pass.station;
    let aperture = Aperture {
        diameter_m: station.telescope.primary_diameter_m,
        height_m: station.site.geodetic().height_m,
        coefficient: USUAL_COEFFICIENT,
    };
    let at = |(x, t): (&f64, &f64)| aperture.variance(*t, *x);
    Some(course.airmass.iter().zip(exposure_s).map(at).collect())
}

/// The channels over the one whose scale is known best.
fn ratios(
    measured: &MeasuredPass,
    given: &[Given<'_>],
    channels: &[Channel],
    blocks: &Blocks,
) -> Vec<Ratio> {
    let known = |c: &usize| {
        let numbers = channels[*c].numbers.as_ref()?;
        Some(numbers.scale_sigma? / numbers.scale)
    };
    let best = (0..channels.len())
        .filter_map(|c| Some((c, known(&c)?)))
        .filter(|(_, sigma)| *sigma > 0.0)
        .min_by(|a, b| a.1.total_cmp(&b.1));
    let Some((best, _)) = best else { return Vec::new() };
    let mut stretches: Vec<Range<usize>> = Vec::new();
    for track in sunglint_radiometry::light_curve::tracks(&measured.times) {
        let rows = track.samples;
        let count = (rows.len() / STRETCH_ROWS).clamp(1, STRETCHES);
        let edge = |k: usize| rows.start + k * rows.len() / count;
        stretches.extend((0..count).map(|k| edge(k)..edge(k + 1)));
    }
    let others = (0..channels.len()).filter(|c| *c != best);
    others
        .filter_map(|c| {
            let kappa = measured.kappa.as_ref();
            let common = kappa.and_then(|k| k.ratio_sigma(given[c].name, given[best].name));
            let pair = |c: usize| (&given[c], &channels[c]);
            Ratio::new(pair(c), pair(best), blocks, &stretches, common)
        })
        .collect()
}

/// The warning that the measured times are off, with what may be the reason of such a number of seconds.
fn shifted(shift: &TimeShift, measured: &MeasuredPass, exposure_s: &[f64]) -> String {
    // Clocks and centres of exposures are often half a second off.
    let near_s = shift.doubt_s.max(0.5);
    let tai_s = measured.times[0].leap_seconds(true).unwrap_or(37.0);
    let half_s = median(exposure_s.iter().copied()).unwrap_or(0.0) / 2.0;
    let scales = [("TAI", tai_s), ("GPS time", tai_s - 19.0), ("Terrestrial Time", tai_s + 32.184)];
    let named = scales.iter().find(|(_, s)| (shift.late_s.abs() - s).abs() < near_s);
    let off = shift.late_s.abs();
    let reason = match named {
        Some((scale, s)) => format!("{scale} and UTC are {s} s apart"),
        None if half_s >= 0.5 && (off - half_s).abs() < 0.2 * half_s => {
            "half an exposure: is that the time of its start or end?".to_owned()
        }
        None => "is a clock off, the orbit old, or the attitude's phase another?".to_owned(),
    };
    let way = if shift.late_s > 0.0 { "earlier" } else { "later" };
    format!(
        "measured and simulated light agree much better with the measured times {off:.1} s {way}, ± {:.1} s (scatter {:.2} % instead of {:.2} %): {reason}",
        shift.doubt_s,
        1e2 * shift.moved_scatter,
        1e2 * shift.scatter
    )
}

fn warnings(
    measured: &MeasuredPass,
    simulation: &Simulation<'_>,
    means: &ExposureMeans,
    channels: &[Channel],
    simulated: usize,
) -> Vec<String> {
    let pass = simulation.pass;
    let mut warnings = pass.warnings.clone();
    warnings.extend(simulation.concerns());
    if !measured.station.is_empty() && measured.station != pass.station.name {
        warnings.push(format!(
            "measured from the station {}, simulated from {}",
            measured.station, pass.station.name
        ));
    }
    if measured.doubled > 0 {
        warnings.push(format!(
            "{} samples stand there twice (time, light and flags are the same): each counts once",
            measured.doubled
        ));
    }
    warnings.extend(measured.warnings.iter().cloned());
    let outside = measured.times.len() - simulated;
    if outside > 0 {
        warnings.push(format!(
            "{outside} of {} rows lie outside the times of the scene: they are not compared",
            measured.times.len()
        ));
    }
    for channel in channels.iter().filter(|c| c.numbers.is_none() && c.samples > 0) {
        warnings.push(format!("{}: nothing to compare, {}", channel.name, channel.left_out));
    }
    for channel in channels {
        let Some(scale) = channel.numbers.as_ref().map(|numbers| numbers.scale) else { continue };
        if scale > 0.0 && !(1.0 / ABSURD..ABSURD).contains(&scale) {
            warnings.push(format!(
                "{}: the measured light is {scale:.2e} times the simulated: is a unit wrong (Hz, m and km, mm of a telescope), or a zero point, or the object?",
                channel.name
            ));
        }
    }
    if means.beyond > 0 {
        warnings.push(format!(
            "the exposures of {} samples reach beyond a table of positions or attitudes: the light of their middles is taken",
            means.beyond
        ));
    }
    if means.coarse > 0 {
        warnings.push(format!(
            "in {} samples the light changes too fast within the exposure for its mean to be sure: the difference of the last two refinements is in the stated error",
            means.coarse
        ));
    }
    if measured.quantity == Quantity::Rate && measured.kappa.is_none() {
        warnings.push(format!(
            "{} does not say what calibrated it: the uncertainty that all its samples have in common is not known",
            measured.path.display()
        ));
    }
    warnings
}
