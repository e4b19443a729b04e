//! What the minima mean: how probable each is, how uncertain, and which symmetry made it.

use super::descent::{Descent, Found, Sample, Space};
use super::forward::Measured;
use super::search::{Checkpoint, Options, Question, Searched, Watch, search};
use super::state::{Law, State, Turn};
use super::twins::{self, Symmetry, Twin};
use super::{AttitudeError, Scale};
use glam::DVec3;
use nalgebra::{DMatrix, Matrix2, SymmetricEigen};
use std::f64::consts::TAU;

/// A minimum with less than this part of the probability is excluded.
const EXCLUDED: f64 = 1e-3;
/// The best one alone is the answer from here on.
const ALONE: f64 = 0.95;
/// A minimum this near to a twin of the best is that twin, radians.
const TWIN: f64 = 0.45;
/// An angle that is less certain than this is not determined, radians.
const UNDETERMINED: f64 = 0.5;
/// Where more than this is left over of the light, or χ² is larger than so many degrees of freedom, the search is made again, finer.
const POOR_EXTRA: f64 = 0.15;
/// See [`POOR_EXTRA`].
const POOR_CHI2: f64 = 1.5;
/// Noise beyond the stated of more than this says that the model is not that of the light.
const NO_MODEL: f64 = 0.3;

/// What is known of an axis on the sphere: standard uncertainties along the two axes of its ellipse.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ellipse {
    /// The longer one, degrees.
    pub major_deg: f64,
    /// The shorter one, degrees.
    pub minor_deg: f64,
    /// Where the longer one points, from north through east, 0 to 180 degrees.
    pub position_deg: f64,
}

/// A minimum of χ².
#[derive(Debug, Clone)]
pub struct Minimum {
    /// The trial.
    pub state: State,
    /// The spin, as a scene file has it.
    pub turn: Turn,
    /// Its axis' right ascension, degrees, 0 to 360.
    pub ra_deg: f64,
    /// Its axis' declination, degrees.
    pub dec_deg: f64,
    /// Its period, s: negative is left-handed; infinite where it does not turn.
    pub period_s: f64,
    /// Its phase at the law's epoch, degrees, 0 to 360.
    pub phase_deg: f64,
    /// χ² with noise that the best one has; large residuals count linearly.
    pub chi2: f64,
    /// χ² above that of the best, over the scale of the errors.
    pub delta_chi2: f64,
    /// How probable it is among the minima, by χ² and by how wide it is.
    pub probability: f64,
    /// How uncertain the axis is; `None` where it is known or not determined.
    pub axis: Option<Ellipse>,
    /// Standard uncertainty of the turn about the axis in the middle of the data, degrees; likewise.
    pub turn_sigma_deg: Option<f64>,
    /// Standard uncertainty of the phase at the law's epoch, degrees; likewise.
    pub phase_sigma_deg: Option<f64>,
    /// Standard uncertainty of the period, s; likewise.
    pub period_sigma_s: Option<f64>,
    /// Standard uncertainty of the attitude in the middle of the data as one angle (root of the sum of squares over the axes), degrees.
    pub attitude_sigma_deg: Option<f64>,
    /// Covariance of small turns of the body about three axes, radians², and of the turn at the end of the data that the period's error makes: what is unknown of them,
    /// in the order of [`Law::moved`].
    pub covariance: Vec<Vec<f64>>,
    /// Factors of the brightness with their standard uncertainties.
    pub scales: Vec<(f64, f64)>,
    /// The symmetry that makes this one of the best, and how far it lies from where that would be, degrees.
    pub twin: Option<(Twin, f64)>,
    /// How far it is from the best: the largest angle between the two attitudes at the ends and in the middle of the data, degrees.
    pub from_best_deg: f64,
}

/// What the search says.
#[derive(Debug, Clone, PartialEq)]
pub enum Verdict {
    /// One attitude.
    One,
    /// So many that the data do not choose from.
    Several(usize),
    /// None that means something, with the reason.
    Undetermined(String),
}

/// The answer.
#[derive(Debug, Clone)]
pub struct Answer {
    /// What it comes to.
    pub verdict: Verdict,
    /// Minima, the most probable first.
    pub minima: Vec<Minimum>,
    /// Samples that count.
    pub samples: usize,
    /// Epochs that have one.
    pub epochs: usize,
    /// Epochs that χ² is of, where not all were taken.
    pub epochs_taken: usize,
    /// χ² of the best over its degrees of freedom, with the noise beyond the stated.
    pub reduced_chi2: f64,
    /// Noise beyond the stated, of the rate: what brings the middle residual to where noise has it.
    pub extra_noise: f64,
    /// What the data span, s.
    pub span_s: f64,
    /// Turns of the best in that.
    pub turns: f64,
    /// The axes that were looked at first, and the mean cost of the best place of each: the error surface, coarse.
    pub surface: Vec<(DVec3, f64)>,
    /// The body's symmetries, with how unlike the light is that each makes.
    pub symmetries: Vec<Symmetry>,
    /// Periods (and senses) of the first look.
    pub periods: usize,
    /// Epochs that were simulated in all.
    pub simulated: usize,
    /// Whether the first look was made again, finer.
    pub finer: bool,
    /// The median and the largest share of light by other ways than the direct one, at the best.
    pub other_light: (f64, f64),
    /// All samples of the best.
    pub best: Vec<Sample>,
    /// Of each epoch that has a sample the curve and the sample of that, from 0: what [`Sample::moment`] counts.
    pub moments: Vec<(usize, usize)>,
    /// The law, for [`Law::at`].
    pub law: Law,
    /// What a person should hear of.
    pub warnings: Vec<String>,
}

/// Finds the attitude.
///
/// The search is the same whatever the number of threads; `from` goes on with one that was cut off.
///
/// # Errors
/// Too few samples; light that does not change; a body that looks the same from all sides; a scene that cannot be simulated; more periods than anyone waits for; a
/// checkpoint of another search.
pub fn find(
    curves: &[Measured],
    question: &Question,
    options: &Options,
    watch: &dyn Watch,
    from: Option<&Checkpoint>,
) -> Result<Answer, AttitudeError> {
    let searched = search(curves, question, options, watch, from, false)?;
    let usual = answer(question, searched)?;
    if usual.finer || !usual.is_poor() {
        return Ok(usual);
    }
    // What noise does not explain may be another attitude's light: once more, finer.
    let searched = search(curves, question, options, watch, from.filter(|c| c.finer), true)?;
    let mut finer = answer(question, searched)?;
    finer.simulated += usual.simulated;
    let better = finer.extra_noise <= usual.extra_noise;
    Ok(if better { finer } else { Answer { finer: true, simulated: finer.simulated, ..usual } })
}

fn answer(question: &Question, searched: Searched) -> Result<Answer, AttitudeError> {
    let unknowns = question.unknowns;
    let law = searched.law;
    let best = searched.minima.first().ok_or(AttitudeError::NoMinimum)?.clone();
    let compared = super::compare::Compared::new(&searched.forward)?;
    let own = &searched.forward;
    let all: Vec<usize> = (0..own.moments.len()).collect();
    let descent = |moments| Descent {
        forward: own,
        compared: &compared,
        law: &law,
        unknowns,
        moments,
        space: Space::Rates { extra: searched.extra },
        scale: question.scale,
        materials: &searched.materials,
        held: best.held.as_ref().map(|h| h.as_slice()),
    };
    let samples = descent(&all).samples(&mut own.eye(), &best.state)?;
    let taken = searched.moments.len();
    let counted: usize = searched
        .moments
        .iter()
        .map(|m| searched.forward.rates(*m).iter().filter(|r| r.is_finite()).count())
        .sum();
    let freedom = counted.saturating_sub(best.normal.nrows()).max(1) as f64;
    let reduced_chi2 = best.cost / freedom;
    let scale = reduced_chi2.max(1.0);
    let mut minima = Vec::new();
    for found in &searched.minima {
        let mut minimum = described(found, &law, question, scale)?;
        minimum.delta_chi2 = (found.cost - best.cost) / scale;
        minimum.from_best_deg = law.apart(&best.state, &found.state).to_degrees();
        minima.push(minimum);
    }
    probabilities(&mut minima, &searched.minima);
    minima.sort_by(|a, b| b.probability.total_cmp(&a.probability).then(a.chi2.total_cmp(&b.chi2)));
    let twins = twins::twins(&searched.forward, &law, &minima[0].state, &searched.symmetries);
    for minimum in minima.iter_mut().skip(1) {
        let near = twins.iter().map(|(twin, state)| (*twin, law.apart(state, &minimum.state)));
        let near = near.min_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, far)| *far < TWIN);
        minimum.twin = near.map(|(twin, far)| (twin, far.to_degrees()));
    }
    let span_s = 2.0 * law.half_span_s;
    let turns = minima[0].turn.turns_per_s.abs() * span_s;
    let mut warnings = searched.warnings;
    if searched.extra > 0.1 {
        warnings.push(format!(
            "the model leaves {:.0} % of the light over beyond the stated noise: materials, shape or motion are not quite the body's, and uncertainties hold only if what is missing is random",
            100.0 * searched.extra
        ));
    }
    if unknowns.period && turns < 1.0 {
        warnings.push(format!(
            "the body turns {turns:.2} times within the data: the period rests on the shape of less than a turn"
        ));
    }
    // By how much the body turns while a sample is exposed.
    let blur = searched
        .forward
        .moments
        .iter()
        .map(|m| m.exposure_s * minima[0].turn.turns_per_s.abs() * 360.0)
        .fold(0.0, f64::max);
    if blur > 5.0 {
        warnings.push(format!(
            "the body turns by {blur:.0}° within an exposure; samples are compared with the middle of theirs"
        ));
    }
    if taken < all.len() {
        warnings.push(format!("of {} epochs {taken} were taken, evenly spread", all.len()));
    }
    if reduced_chi2 > POOR_CHI2 {
        warnings.push(format!(
            "reduced chi-square is {reduced_chi2:.2}: residuals have longer tails than noise; another attitude, or what the scene does not know of the body, may be behind that"
        ));
    }
    let verdict = verdict(&minima, unknowns.count(), searched.extra);
    Ok(Answer {
        verdict,
        samples: samples.len(),
        epochs: all.len(),
        epochs_taken: taken,
        minima,
        reduced_chi2,
        extra_noise: searched.extra,
        span_s,
        turns,
        surface: searched.surface,
        symmetries: searched.symmetries,
        periods: searched.rates,
        simulated: searched.simulated,
        finer: searched.finer,
        other_light: searched.other_light,
        best: samples,
        moments: searched.forward.moments.iter().map(|m| (m.curve, m.sample)).collect(),
        law,
        warnings,
    })
}

fn verdict(minima: &[Minimum], unknowns: usize, extra: f64) -> Verdict {
    let best = &minima[0];
    if extra > NO_MODEL {
        return Verdict::Undetermined(format!(
            "no attitude that was tried has the light that was measured: {:.0} % of it are left over",
            100.0 * extra
        ));
    }
    let known = best.covariance.iter().enumerate().filter(|(i, r)| r[*i].sqrt() < UNDETERMINED);
    let loose = known.count() < unknowns;
    if loose {
        return Verdict::Undetermined(
            "the light hardly changes with some turn of the body: too little was seen of it".into(),
        );
    }
    if best.probability >= ALONE {
        return Verdict::One;
    }
    Verdict::Several(minima.iter().filter(|m| m.probability > EXCLUDED).count())
}

/// A minimum in numbers that a person knows.
fn described(
    found: &Found,
    law: &Law,
    question: &Question,
    scale: f64,
) -> Result<Minimum, AttitudeError> {
    let unknowns = question.unknowns;
    let turn = law.turn(&found.state)?;
    let axis = turn.axis_gcrs;
    let ra_deg = axis.y.atan2(axis.x).to_degrees().rem_euclid(360.0);
    let dec_deg = axis.z.clamp(-1.0, 1.0).asin().to_degrees();
    let steps = unknowns.count();
    let covariance = covariance(&found.normal, scale);
    let own = covariance.as_ref().map(|c| c.view((0, 0), (steps, steps)).into_owned());
    let sigma = |k: usize| -> Option<f64> {
        let s = own.as_ref()?[(k, k)].sqrt();
        (s < UNDETERMINED).then_some(s)
    };
    let across = axis.any_orthonormal_vector();
    let frame = [across, axis.cross(across)];
    let ellipse = own.as_ref().filter(|_| unknowns.axis).and_then(|c| {
        // A turn of the body about `across` tilts the axis along axis × (−across) …: rotation vector × axis.
        let tilt = frame.map(|turn| turn.cross(axis));
        let east = DVec3::Z.cross(axis).try_normalize().unwrap_or(DVec3::Y);
        let north = axis.cross(east);
        let to = Matrix2::new(
            tilt[0].dot(north),
            tilt[1].dot(north),
            tilt[0].dot(east),
            tilt[1].dot(east),
        );
        let own = Matrix2::new(c[(0, 0)], c[(0, 1)], c[(1, 0)], c[(1, 1)]);
        let eigen = SymmetricEigen::new(to * own * to.transpose());
        let (major, minor) =
            if eigen.eigenvalues[0] >= eigen.eigenvalues[1] { (0, 1) } else { (1, 0) };
        let v = eigen.eigenvectors.column(major);
        let of = |k: usize| eigen.eigenvalues[k].max(0.0).sqrt();
        (of(major) < UNDETERMINED).then(|| Ellipse {
            major_deg: of(major).to_degrees(),
            minor_deg: of(minor).to_degrees(),
            position_deg: v[1].atan2(v[0]).to_degrees().rem_euclid(180.0),
        })
    });
    let rest = 2 * usize::from(unknowns.axis);
    let turn_sigma = if unknowns.phase { sigma(rest) } else { None };
    let rate_sigma = if unknowns.period { sigma(steps - 1) } else { None };
    let per_s = rate_sigma.map(|s| s / (TAU * law.half_span_s));
    let period_s = if turn.turns_per_s == 0.0 { f64::INFINITY } else { 1.0 / turn.turns_per_s };
    let phase_sigma = match own.as_ref().filter(|_| unknowns.phase) {
        Some(c) => phase_sigma(found, law, question, c)?,
        None => None,
    };
    let attitude = own.as_ref().map(|c| {
        let free = rest + usize::from(unknowns.phase);
        (0..free).map(|k| c[(k, k)]).sum::<f64>().sqrt()
    });
    let rows = |c: &DMatrix<f64>| c.row_iter().map(|r| r.iter().copied().collect()).collect();
    let scales = found.scales.iter().enumerate().map(|(k, s)| {
        let own = covariance.as_ref().map_or(f64::NAN, |c| c[(steps + k, steps + k)].sqrt());
        (*s, own)
    });
    Ok(Minimum {
        state: found.state,
        turn,
        ra_deg,
        dec_deg,
        period_s,
        phase_deg: turn.phase_rad.to_degrees(),
        chi2: found.cost,
        delta_chi2: 0.0,
        probability: 0.0,
        axis: ellipse,
        turn_sigma_deg: turn_sigma.map(f64::to_degrees),
        phase_sigma_deg: phase_sigma.map(f64::to_degrees),
        period_sigma_s: per_s.map(|s| s * period_s * period_s).filter(|s| s.is_finite()),
        attitude_sigma_deg: attitude.filter(|a| *a < UNDETERMINED).map(f64::to_degrees),
        covariance: own.as_ref().map_or_else(Vec::new, rows),
        scales: scales.collect(),
        twin: None,
        from_best_deg: 0.0,
    })
}

/// The uncertainty of the phase at the law's epoch, radians: it grows with that of the period and of the axis.
fn phase_sigma(
    found: &Found,
    law: &Law,
    question: &Question,
    covariance: &DMatrix<f64>,
) -> Result<Option<f64>, AttitudeError> {
    const STEP: f64 = 1e-6;
    let steps = question.unknowns.count();
    let mut slopes = Vec::new();
    for k in 0..steps {
        let mut ends = [0.0; 2];
        for (end, sign) in ends.iter_mut().zip([-1.0, 1.0]) {
            let mut step = vec![0.0; steps];
            step[k] = sign * STEP;
            *end = law.turn(&law.moved(&found.state, question.unknowns, &step)?)?.phase_rad;
        }
        let turn = (ends[1] - ends[0] + 0.5 * TAU).rem_euclid(TAU) - 0.5 * TAU;
        slopes.push(turn / (2.0 * STEP));
    }
    let mut variance = 0.0;
    for (i, a) in slopes.iter().enumerate() {
        for (j, b) in slopes.iter().enumerate() {
            variance += a * b * covariance[(i, j)];
        }
    }
    let sigma = variance.max(0.0).sqrt();
    Ok((sigma < std::f64::consts::PI / 2.0).then_some(sigma))
}

/// The inverse of a normal matrix, scaled; `None` where it is singular.
fn covariance(normal: &DMatrix<f64>, scale: f64) -> Option<DMatrix<f64>> {
    let n = normal.nrows();
    let root: Vec<f64> = (0..n).map(|i| normal[(i, i)].sqrt()).collect();
    if root.iter().any(|r| !(*r > 0.0 && r.is_finite())) {
        return None;
    }
    let scaled = DMatrix::from_fn(n, n, |i, j| normal[(i, j)] / (root[i] * root[j]));
    let inverse = scaled.cholesky()?.inverse();
    Some(DMatrix::from_fn(n, n, |i, j| scale * inverse[(i, j)] / (root[i] * root[j])))
}

/// Probabilities by χ² and by the width of each minimum (Laplace's approximation), all attitudes alike beforehand.
fn probabilities(minima: &mut [Minimum], found: &[Found]) {
    let width = |f: &Found| {
        let determinant = f.normal.clone().cholesky().map(|c| c.determinant());
        // A minimum without curvature is no narrower than the sphere.
        -0.5 * determinant.filter(|d| *d > 0.0).map_or(0.0, f64::ln)
    };
    let logs: Vec<f64> =
        minima.iter().zip(found).map(|(m, f)| width(f) - 0.5 * m.delta_chi2).collect();
    let most = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let sum: f64 = logs.iter().map(|l| (l - most).exp()).sum();
    for (minimum, log) in minima.iter_mut().zip(&logs) {
        minimum.probability = (log - most).exp() / sum;
    }
}

impl Answer {
    /// Whether more is left over than noise: too much of the light, or more outliers than noise has.
    fn is_poor(&self) -> bool {
        self.extra_noise > POOR_EXTRA || self.reduced_chi2 > POOR_CHI2
    }

    /// Factors of the brightness by name: channels or materials in their order.
    pub fn scale_names(scale: Scale, channels: &[String], materials: &[String]) -> Vec<String> {
        match scale {
            Scale::None => Vec::new(),
            Scale::Grey => vec!["all".into()],
            Scale::Channels => channels.to_vec(),
            Scale::Materials => materials.to_vec(),
        }
    }
}
