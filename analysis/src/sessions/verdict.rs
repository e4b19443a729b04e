//! The verdict on sessions: one period, a family of at most three, or not decided.

use super::Session;
use super::scan::{Fit, Rows, light};
use crate::period::FrequencyGrid;
use crate::period::sums::turns;
use serde::Serialize;
use std::ops::Range;
use sunglint_formats::text::counted;
use sunglint_numerics::measured::{Interval, pair};
use sunglint_numerics::order::{median, robust_sigma};
use sunglint_numerics::progress::{Cancelled, Progress};

/// Harmonics of the models. Four leave fewer multiples of a period possible, eight see more of a body's shape: six stand between and give the numbers.
const ORDERS: [usize; 3] = [4, 6, 8];
/// Place of six harmonics among them.
const MIDDLE: usize = 1;
/// Harmonics of the largest model.
const MOST: usize = ORDERS[2];
/// Δ by which eight harmonics beat four before four are too few: 25 above twice the eight coefficients more.
const TOO_FEW: f64 = RULED_OUT + 16.0;
/// Frequencies to a resolution of the highest harmonic.
const OVERSAMPLING: f64 = 5.0;
/// Longest period, in lengths of the longest session.
const LONGEST_SESSIONS: f64 = 8.0;
/// Parts of a period that are asked about where they lie below the search.
const MOST_PARTS: usize = 8;
/// A period whose Δ is larger is ruled out.
const RULED_OUT: f64 = 25.0;
/// Where more than three periods are left, those with a larger Δ are not named.
const UNLIKELY: f64 = 16.0;
/// Two periods that differ by less are one, whose cycles may not be counted.
const SAME: f64 = 0.01;
/// The models agree on a period where theirs differ by less.
const AGREE: f64 = 0.005;
/// Most members of a family.
const MOST_MEMBERS: usize = 3;
/// Residuals are weighted down beyond so many times their robust scale.
const CLIP: f64 = 4.0;
/// A session with fewer samples fixes its zero point and says nothing else.
const LEAST_SAMPLES: usize = 3;
/// Frequencies at most, of a range that nobody asked for and of one that was asked for.
const MOST_BY_DEFAULT: f64 = 3e5;
const MOST_FREQUENCIES: usize = 20_000_000;
/// More rows than these are put together in bins.
const MOST_ROWS: usize = 20_000;
/// Bins to the shortest turn of the highest harmonic.
const BINS_PER_TURN: f64 = 20.0;
/// Minima that are refined, of one period's aliases and in all.
const MOST_ALIASES: usize = 12;
const MOST_MINIMA: usize = 120;
/// Shortest period, in median steps.
const SAMPLED: f64 = 12.0;
/// Half a 95 % interval in standard uncertainties.
const SIGMAS_95: f64 = 1.96;
/// Phase bins in which a period's coverage is counted.
const PHASE_BINS: usize = 20;

/// Options of the search over sessions.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[non_exhaustive]
pub struct Options {
    /// The shortest period, s [default: twelve median steps, so that six harmonics are sampled; longer where the whole would need more than 300,000 frequencies].
    pub shortest_s: Option<f64>,
    /// The longest period, s [default: eight times the longest session].
    pub longest_s: Option<f64>,
}

impl Options {
    /// Options with bounds of the period, s.
    pub fn between(shortest_s: Option<f64>, longest_s: Option<f64>) -> Self {
        Self { shortest_s, longest_s }
    }
}

/// Why sessions cannot be searched.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SessionsError {
    /// A session whose columns differ in length.
    #[error("{name}: {times} times and {values} magnitudes, expected as many of each")]
    Lengths {
        /// The session.
        name: String,
        /// Number of times.
        times: usize,
        /// Number of magnitudes.
        values: usize,
    },
    /// Bounds without a period between.
    #[error(
        "periods from {shortest_s} s to {longest_s} s, expected the first above 0 and below the second"
    )]
    Range {
        /// The shortest period, s.
        shortest_s: f64,
        /// The longest, s.
        longest_s: f64,
    },
    /// More frequencies than anyone waits for.
    #[error(
        "{frequencies} frequencies, expected at most {most}: ask for longer periods than {shortest_s} s, or give fewer sessions"
    )]
    TooMany {
        /// The frequencies that the range needs.
        frequencies: usize,
        /// The most.
        most: usize,
        /// The shortest period that was asked for, s.
        shortest_s: f64,
    },
    /// The work was ended early.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// Why sessions decide nothing.
#[derive(Debug, Clone, PartialEq, thiserror::Error, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Reason {
    /// Too few samples for the model.
    #[error(
        "{samples} samples in {sessions} sessions of at least {LEAST_SAMPLES}: harmonics and zero points need more than {needed}"
    )]
    Samples {
        /// Samples that count.
        samples: usize,
        /// Sessions that count.
        sessions: usize,
        /// Samples that are needed.
        needed: usize,
    },
    /// No light that changes within a session.
    #[error("the magnitudes are constant within every session")]
    Constant,
    /// All samples at one moment, or sessions that leave no period to look for.
    #[error(
        "the longest session lasts {longest_session_s:.4} s, with a sample every {step_s:.4} s: that leaves no period to look for"
    )]
    Range {
        /// Length of the longest session, s.
        longest_session_s: f64,
        /// Median step, s.
        step_s: f64,
    },
    /// Too many periods fit about as well as the best.
    #[error(
        "at least {periods} periods fit about as well as the best, {period_s:.2} s: more or longer sessions would decide"
    )]
    Many {
        /// The best period, s.
        period_s: f64,
        /// Periods that fit.
        periods: usize,
    },
    /// The best lies at a bound of the search.
    #[error(
        "the best period, {period_s:.2} s, lies at the bound of the search: longer sessions (or other bounds) would decide"
    )]
    Bound {
        /// The period, s.
        period_s: f64,
    },
    /// The models contradict each other.
    #[error(
        "six harmonics give {six_s:.2} s and eight {eight_s:.2} s, and each rules the other out: more sessions would decide"
    )]
    Disagree {
        /// The best period of six harmonics, s.
        six_s: f64,
        /// The best of eight, s.
        eight_s: f64,
    },
}

/// Answer that sessions give.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// One period.
    Single,
    /// Two or three, the best first.
    Family,
    /// None.
    NotDecided,
}

/// A period that the sessions leave possible.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Member {
    /// The period, s, of the model with six harmonics.
    pub period_s: f64,
    /// Standard uncertainty within its own minimum of χ², s: where cycles are not counted the truth may lie in a neighbouring one.
    pub sigma_s: f64,
    /// Interval that holds the period in 95 %; over all neighbouring cycle counts that fit.
    pub interval_s: Interval,
    /// Whether the number of turns between the sessions is known.
    pub cycles_counted: bool,
    /// Number of cycle counts that fit, itself included.
    pub cycle_counts: usize,
    /// Turns from the first to the last sample.
    pub turns: f64,
    /// Δ above the best by four, six and eight harmonics.
    pub gaps: [f64; 3],
    /// Share of a turn that was seen.
    pub phase_seen: f64,
    /// From the brightest to the faintest of the model where it was seen, mag.
    pub amplitude_mag: f64,
}

/// A session as the search took it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SessionFound {
    /// Name of the session.
    pub name: String,
    /// Samples that count.
    pub samples: usize,
    /// First and last moment, s.
    #[serde(with = "pair")]
    pub from_to_s: Interval,
    /// Zero point with the best period, mag; `None` where the session was left out.
    pub zero_mag: Option<f64>,
    /// Robust scatter about the best model, mag.
    pub scatter_mag: Option<f64>,
}

/// The verdict on sessions and what it rests on.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct SessionPeriods {
    /// Answer that the data give.
    pub verdict: Outcome,
    /// Periods that are possible, the best first: one of a single answer, two or three of a family, the best alone where nothing is decided.
    pub members: Vec<Member>,
    /// Why nothing is decided, in words.
    pub reason: Option<String>,
    /// The same as a kind with its numbers.
    pub because: Option<Reason>,
    /// The shortest and the longest period that were looked for, s.
    #[serde(with = "pair")]
    pub searched_s: Option<Interval>,
    /// Number of frequencies.
    pub frequencies: usize,
    /// Δ from the best period to the best one that differs by more than 1 %: of four, six and eight harmonics.
    pub smallest_gap: [Option<f64>; 3],
    /// The best period of four, six and eight harmonics, s.
    pub best_s: Option<[f64; 3]>,
    /// Correlation of neighbouring residuals, of four, six and eight harmonics.
    pub correlation: [f64; 3],
    /// Scatter about the best model, mag.
    pub scatter_mag: Option<f64>,
    /// Samples that count; rows that they were put together in.
    pub samples: usize,
    /// Rows that were fitted.
    pub rows: usize,
    /// Sessions, those that were left out among them.
    pub sessions: Vec<SessionFound>,
    /// Warnings to the user about the result.
    pub warnings: Vec<String>,
    /// Coefficients [cos, sin] of the best model, mag; phase 0 is at `middle_s`.
    pub harmonics: Vec<[f64; 2]>,
    /// Moment of phase 0, s.
    pub middle_s: f64,
    /// Δ over the frequencies of the search, six harmonics: for figures.
    #[serde(skip)]
    pub drawn: Vec<(f64, f64)>,
    /// Phase and magnitude less zero point of each row with the best period, by session: for figures.
    #[serde(skip)]
    pub folded: Vec<(String, Vec<(f64, f64)>)>,
}

impl SessionPeriods {
    fn empty() -> Self {
        Self {
            verdict: Outcome::NotDecided,
            members: Vec::new(),
            reason: None,
            because: None,
            searched_s: None,
            frequencies: 0,
            smallest_gap: [None; 3],
            best_s: None,
            correlation: [0.0; 3],
            scatter_mag: None,
            samples: 0,
            rows: 0,
            sessions: Vec::new(),
            warnings: Vec::new(),
            harmonics: Vec::new(),
            middle_s: 0.0,
            drawn: Vec::new(),
            folded: Vec::new(),
        }
    }

    fn not_decided(mut self, reason: Reason) -> Self {
        self.reason = Some(reason.to_string());
        self.because = Some(reason);
        self
    }

    /// The best model's light at a moment, mag above its zero point.
    pub fn light_mag(&self, time_s: f64) -> Option<f64> {
        let best = self.members.first()?;
        Some(light(&self.harmonics, turns(1.0 / best.period_s, time_s - self.middle_s)))
    }
}

/// A minimum of χ² of one model.
#[derive(Debug, Clone, Copy)]
struct Minimum {
    frequency_hz: f64,
    chi2: f64,
}

/// Minima that belong to one period, within 1 % of the lowest; the lowest first.
#[derive(Debug, Clone)]
struct Cluster {
    minima: Vec<Minimum>,
}

impl Cluster {
    fn best(&self) -> Minimum {
        self.minima[0]
    }

    fn holds(&self, frequency_hz: f64) -> bool {
        (frequency_hz / self.best().frequency_hz - 1.0).abs() <= SAME
    }
}

/// One model over the grid: its weights, χ², and the scale of its Δ.
struct Model {
    order: usize,
    weight: Vec<f64>,
    chi2: Vec<f64>,
    clusters: Vec<Cluster>,
    /// Δ per χ².
    scale: f64,
    correlation: f64,
    scatter: f64,
}

impl Model {
    fn best(&self) -> Minimum {
        self.clusters[0].best()
    }

    fn gap(&self, chi2: f64) -> f64 {
        (chi2 - self.best().chi2) * self.scale
    }

    /// Δ at a frequency, by the lowest minimum within 1 % of it.
    fn gap_at(&self, rows: &Rows, frequency_hz: f64, step_hz: f64) -> f64 {
        let near = self
            .clusters
            .iter()
            .flat_map(|c| &c.minima)
            .filter(|m| (m.frequency_hz / frequency_hz - 1.0).abs() <= SAME);
        let near = near.map(|m| m.chi2).fold(f64::INFINITY, f64::min);
        let chi2 = if near.is_finite() {
            near
        } else {
            refined(rows, &self.weight, self.order, frequency_hz, step_hz).chi2
        };
        self.gap(chi2)
    }
}

/// The lowest χ² within a step of a frequency, by golden sections.
fn refined(rows: &Rows, weight: &[f64], order: usize, frequency_hz: f64, step_hz: f64) -> Minimum {
    const GOLDEN: f64 = 0.618_033_988_749_895;
    let at = |f: f64| rows.fit(weight, f, order).chi2;
    let (mut a, mut b) =
        ((frequency_hz - step_hz).max(0.25 * frequency_hz), frequency_hz + step_hz);
    let (mut x, mut y) = (b - GOLDEN * (b - a), a + GOLDEN * (b - a));
    let (mut at_x, mut at_y) = (at(x), at(y));
    for _ in 0..20 {
        if at_x < at_y {
            (b, y, at_y) = (y, x, at_x);
            x = b - GOLDEN * (b - a);
            at_x = at(x);
        } else {
            (a, x, at_x) = (x, y, at_y);
            y = a + GOLDEN * (b - a);
            at_y = at(y);
        }
    }
    let frequency_hz = 0.5 * (a + b);
    Minimum { frequency_hz, chi2: at(frequency_hz) }
}

/// Sessions as rows on one clock, from the middle of the whole; sorted by time, and by magnitude where times are the same.
struct Taken {
    rows: Rows,
    middle_s: f64,
    /// Place among the sessions that were given.
    place: Vec<usize>,
    found: Vec<SessionFound>,
    doubled: usize,
    not_finite: usize,
}

fn taken(sessions: &[Session]) -> Result<Taken, SessionsError> {
    let mut rows =
        Rows { time: Vec::new(), value: Vec::new(), count: Vec::new(), sessions: Vec::new() };
    let (mut place, mut found) = (Vec::new(), Vec::new());
    let (mut doubled, mut not_finite) = (0, 0);
    for (k, session) in sessions.iter().enumerate() {
        let (times, values) = (session.time_s.len(), session.magnitude.len());
        if times != values {
            return Err(SessionsError::Lengths { name: session.name.clone(), times, values });
        }
        let mut pairs: Vec<(f64, f64)> =
            session.time_s.iter().copied().zip(session.magnitude.iter().copied()).collect();
        pairs.retain(|(t, m)| t.is_finite() && m.is_finite());
        not_finite += times - pairs.len();
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        doubled += pairs.windows(2).filter(|p| p[0].0 == p[1].0).count();
        let ends = match (pairs.first(), pairs.last()) {
            (Some(a), Some(b)) => [a.0, b.0],
            _ => [f64::NAN; 2],
        };
        found.push(SessionFound {
            name: session.name.clone(),
            samples: pairs.len(),
            from_to_s: ends.into(),
            zero_mag: None,
            scatter_mag: None,
        });
        if pairs.len() < LEAST_SAMPLES {
            continue;
        }
        let begin = rows.time.len();
        rows.time.extend(pairs.iter().map(|p| p.0));
        rows.value.extend(pairs.iter().map(|p| p.1));
        rows.sessions.push(begin..rows.time.len());
        place.push(k);
    }
    rows.count = vec![1.0; rows.time.len()];
    let first = rows.time.iter().copied().fold(f64::INFINITY, f64::min);
    let middle_s = if rows.time.is_empty() { 0.0 } else { first + 0.5 * rows.span_s() };
    rows.time.iter_mut().for_each(|t| *t -= middle_s);
    Ok(Taken { rows, middle_s, place, found, doubled, not_finite })
}

/// Puts neighbouring rows of a session together in bins of a width.
fn binned(rows: &Rows, width_s: f64) -> Rows {
    let mut all =
        Rows { time: Vec::new(), value: Vec::new(), count: Vec::new(), sessions: Vec::new() };
    for session in &rows.sessions {
        let begin = all.time.len();
        let mut i = session.start;
        while i < session.end {
            let from = rows.time[i];
            let (mut t, mut v, mut n) = (0.0, 0.0, 0.0);
            while i < session.end && rows.time[i] - from < width_s {
                t += rows.time[i];
                v += rows.value[i];
                n += 1.0;
                i += 1;
            }
            all.time.push(t / n);
            all.value.push(v / n);
            all.count.push(n);
        }
        all.sessions.push(begin..all.time.len());
    }
    all
}

/// Samples that harmonics and zero points of so many sessions need at least.
fn needed(sessions: usize) -> usize {
    2 * MOST + sessions + 1
}

/// Looks for the period of sessions with a zero point each.
///
/// # Errors
/// Columns of different lengths; bounds that hold no period, or need too many frequencies; an early end by whoever watches.
///
/// ```
/// use sunglint_analysis::sessions::{Options, Outcome, Session, search};
/// use sunglint_numerics::progress::Silent;
///
/// // Four nights of a body that turns in 5.3 h, each with a zero point of its own.
/// let night = |k: u32| {
///     let time_s: Vec<f64> = (0..120).map(|i| 86_400.0 * f64::from(k * k) + 240.0 * f64::from(i)).collect();
///     let turn = |t: f64| std::f64::consts::TAU * t / (5.3 * 3600.0);
///     let noise = |t: f64| 0.01 * (91.7 * t * t).sin();
///     let light = |t: &f64| f64::from(k) + 0.2 * (2.0 * turn(*t)).sin() + 0.1 * (3.0 * turn(*t)).cos() + noise(*t);
///     Session { name: format!("night {k}"), magnitude: time_s.iter().map(light).collect(), time_s }
/// };
/// let sessions: Vec<Session> = (0..4).map(night).collect();
/// let found = search(&sessions, &Options::default(), &Silent)?;
/// // Twice the period, with even harmonics alone, is nearly the same light: it may stand behind the truth.
/// assert_ne!(found.verdict, Outcome::NotDecided);
/// assert!((found.members[0].period_s / 3600.0 - 5.3).abs() < 0.01);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn search(
    sessions: &[Session],
    options: &Options,
    progress: &dyn Progress,
) -> Result<SessionPeriods, SessionsError> {
    let Taken { rows, middle_s, place, found, doubled, not_finite } = taken(sessions)?;
    let mut answer = SessionPeriods::empty();
    answer.middle_s = middle_s;
    answer.samples = rows.len();
    for session in found.iter().filter(|s| s.samples < LEAST_SAMPLES) {
        answer.warnings.push(format!(
            "left out: {}: {}, a session needs {LEAST_SAMPLES}",
            session.name,
            counted(session.samples, "sample")
        ));
    }
    answer.sessions = found;
    if doubled > 0 {
        answer.warnings.push(format!(
            "{} at the time of another of their session: all are used",
            counted(doubled, "sample")
        ));
    }
    if not_finite > 0 {
        answer
            .warnings
            .push(format!("{} without a number: left out", counted(not_finite, "sample")));
    }
    let number = rows.sessions.len();
    if rows.len() <= needed(number) {
        let reason =
            Reason::Samples { samples: rows.len(), sessions: number, needed: needed(number) };
        return Ok(answer.not_decided(reason));
    }
    let constant = |s: &Range<usize>| rows.value[s.clone()].windows(2).all(|p| p[0] == p[1]);
    if rows.sessions.iter().all(constant) {
        return Ok(answer.not_decided(Reason::Constant));
    }
    let Some((shortest_s, longest_s)) = range(&rows, options, &mut answer)? else {
        return Ok(answer);
    };
    let span_s = rows.span_s();
    let step_hz = 1.0 / (OVERSAMPLING * MOST as f64 * span_s);
    let first_hz = 1.0 / longest_s;
    let n = ((1.0 / shortest_s - first_hz) / step_hz).floor() as usize + 1;
    if n > MOST_FREQUENCIES {
        return Err(SessionsError::TooMany { frequencies: n, most: MOST_FREQUENCIES, shortest_s });
    }
    let grid = FrequencyGrid { first_hz, step_hz, n };
    answer.frequencies = n;
    answer.searched_s = Some(Interval::new(shortest_s, longest_s));
    let rows = if rows.len() > MOST_ROWS {
        binned(&rows, shortest_s / (BINS_PER_TURN * MOST as f64))
    } else {
        rows
    };
    answer.rows = rows.len();
    if rows.len() <= needed(number) {
        let reason =
            Reason::Samples { samples: rows.len(), sessions: number, needed: needed(number) };
        return Ok(answer.not_decided(reason));
    }
    progress
        .begin("looking for periods over all sessions", Some((1 + ORDERS.len() as u64) * n as u64));
    let first = rows.scan(&rows.count, &ORDERS, &grid, progress)?;
    let mut models = Vec::new();
    for (order, chi2) in ORDERS.into_iter().zip(first) {
        models.push(model(&rows, order, &chi2, &grid, progress)?);
    }
    let Ok(models) = <[Model; 3]>::try_from(models) else { return Ok(answer) };
    judge(&rows, &models, &grid, &mut answer);
    draw(&rows, &models[MIDDLE], &grid, &place, sessions, &mut answer);
    Ok(answer)
}

/// The median step between samples of a session, s.
fn step_s(rows: &Rows) -> f64 {
    let steps =
        rows.sessions.iter().flat_map(|s| rows.time[s.clone()].windows(2).map(|p| p[1] - p[0]));
    median(steps.filter(|s| *s > 0.0)).unwrap_or(f64::NAN)
}

/// The shortest and the longest period of the search; `None` where there is none between.
fn range(
    rows: &Rows,
    options: &Options,
    answer: &mut SessionPeriods,
) -> Result<Option<(f64, f64)>, SessionsError> {
    let own = |s: &Range<usize>| rows.time[s.end - 1] - rows.time[s.start];
    let longest_session_s = rows.sessions.iter().map(own).fold(0.0, f64::max);
    let step_s = step_s(rows);
    let longest_s = options.longest_s.unwrap_or(LONGEST_SESSIONS * longest_session_s);
    let sampled_s = SAMPLED * step_s;
    let affordable_s = OVERSAMPLING * MOST as f64 * rows.span_s() / MOST_BY_DEFAULT;
    let shortest_s = options.shortest_s.unwrap_or(sampled_s.max(affordable_s));
    if options.shortest_s.is_none() && affordable_s > sampled_s {
        answer.warnings.push(format!(
            "periods below {affordable_s:.4} s are not looked for: the whole would need too many frequencies (--shortest asks for them)"
        ));
    }
    let good = shortest_s > 0.0 && shortest_s < longest_s && longest_s.is_finite();
    if good {
        return Ok(Some((shortest_s, longest_s)));
    }
    if options.shortest_s.is_some() || options.longest_s.is_some() {
        return Err(SessionsError::Range { shortest_s, longest_s });
    }
    let reason = Reason::Range { longest_session_s, step_s };
    answer.reason = Some(reason.to_string());
    answer.because = Some(reason);
    Ok(None)
}

/// One model with its weights: residuals of the first scan's best are weighted down, and all is scanned again.
fn model(
    rows: &Rows,
    order: usize,
    first: &[f64],
    grid: &FrequencyGrid,
    progress: &dyn Progress,
) -> Result<Model, SessionsError> {
    let lowest = first.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1)).map_or(0, |(i, _)| i);
    let at = refined(rows, &rows.count, order, grid.frequency_hz(lowest), grid.step_hz);
    let residuals = rows.residuals(&rows.fit(&rows.count, at.frequency_hz, order), at.frequency_hz);
    // A row of many samples has less scatter: its residual counts in that of one.
    let single: Vec<f64> = residuals.iter().zip(&rows.count).map(|(r, n)| r * n.sqrt()).collect();
    let scale = robust_sigma(single.iter().copied()).unwrap_or(0.0);
    let down = |r: &f64| {
        let far = r.abs() / (CLIP * scale);
        if far > 1.0 { 1.0 / (far * far) } else { 1.0 }
    };
    let weight: Vec<f64> = single.iter().zip(&rows.count).map(|(r, n)| n * down(r)).collect();
    let chi2 = rows.scan(&weight, &[order], grid, progress)?.pop().unwrap_or_default();
    let mut model = Model {
        order,
        weight,
        chi2,
        clusters: Vec::new(),
        scale: 1.0,
        correlation: 0.0,
        scatter: 0.0,
    };
    let freedom = (rows.len() - 2 * order - rows.sessions.len() - 1) as f64;
    model.clusters = clusters(rows, &model, grid, freedom);
    let best = model.best();
    let fit = rows.fit(&model.weight, best.frequency_hz, order);
    let left = rows.residuals(&fit, best.frequency_hz);
    model.correlation = correlation(rows, &left, &model.weight);
    let variance = (best.chi2 / freedom).max(f64::MIN_POSITIVE);
    model.scatter = variance.sqrt();
    model.scale = (1.0 - model.correlation) / (1.0 + model.correlation) / variance;
    Ok(model)
}

/// Correlation of neighbouring residuals within sessions, 0 to 0.98.
fn correlation(rows: &Rows, residuals: &[f64], weight: &[f64]) -> f64 {
    let scaled: Vec<f64> = residuals.iter().zip(weight).map(|(r, w)| r * w.sqrt()).collect();
    let (mut products, mut pairs, mut squares) = (0.0, 0.0, 0.0);
    for session in &rows.sessions {
        let own = &scaled[session.clone()];
        products += own.windows(2).map(|p| p[0] * p[1]).sum::<f64>();
        pairs += (own.len() - 1) as f64;
        squares += own.iter().map(|r| r * r).sum::<f64>();
    }
    let share = (products / pairs) / (squares / scaled.len() as f64);
    if share.is_finite() { share.clamp(0.0, 0.98) } else { 0.0 }
}

/// The minima of a model, refined, by period; the lowest first.
fn clusters(rows: &Rows, model: &Model, grid: &FrequencyGrid, freedom: f64) -> Vec<Cluster> {
    let chi2 = &model.chi2;
    let mut places: Vec<usize> = (0..chi2.len())
        .filter(|i| {
            let below =
                |j: Option<usize>| j.and_then(|j| chi2.get(j)).is_none_or(|c| chi2[*i] <= *c);
            below(i.checked_sub(1)) && below(i.checked_add(1))
        })
        .collect();
    places.sort_by(|a, b| chi2[*a].total_cmp(&chi2[*b]));
    let lowest = places.first().map_or(0.0, |i| chi2[*i]);
    // What the grid shows too high by far is no rival, refined or not.
    let far = lowest + (0.15 * lowest).max(60.0 * lowest / freedom) * 4.0;
    let mut found: Vec<Cluster> = Vec::new();
    let mut looked = 0;
    for i in places {
        let frequency_hz = grid.frequency_hz(i);
        let own = found.iter().position(|c| c.holds(frequency_hz));
        if own.is_some_and(|k| found[k].minima.len() >= MOST_ALIASES) {
            continue;
        }
        let enough = looked >= MOST_MINIMA || found.len() > 4 * MOST_MEMBERS;
        if enough || (chi2[i] > far && found.len() > 1) {
            break;
        }
        looked += 1;
        let minimum = refined(rows, &model.weight, model.order, frequency_hz, grid.step_hz);
        match own {
            Some(k) => found[k].minima.push(minimum),
            None => found.push(Cluster { minima: vec![minimum] }),
        }
    }
    // Refined, another may be the lowest: of a period and of all. What lies farther than 1 % from its new lowest is a period of its own.
    let mut minima: Vec<Minimum> = found.into_iter().flat_map(|c| c.minima).collect();
    minima.sort_by(|a, b| a.chi2.total_cmp(&b.chi2));
    let mut sorted: Vec<Cluster> = Vec::new();
    for minimum in minima {
        match sorted.iter_mut().find(|c| c.holds(minimum.frequency_hz)) {
            Some(cluster) => {
                let apart = |m: &Minimum| {
                    (m.frequency_hz - minimum.frequency_hz).abs() > 0.5 * grid.step_hz
                };
                if cluster.minima.iter().all(apart) {
                    cluster.minima.push(minimum);
                }
            }
            None => sorted.push(Cluster { minima: vec![minimum] }),
        }
    }
    sorted
}

/// Share of a turn in which there are samples.
fn phase_seen(rows: &Rows, frequency_hz: f64) -> f64 {
    let mut bins = [false; PHASE_BINS];
    for t in &rows.time {
        let turn = turns(frequency_hz, *t);
        let turn = turn - turn.floor();
        bins[((turn * PHASE_BINS as f64) as usize).min(PHASE_BINS - 1)] = true;
    }
    bins.iter().filter(|b| **b).count() as f64 / PHASE_BINS as f64
}

/// A period of a family with its uncertainty, by the model of six harmonics.
fn member(rows: &Rows, models: &[Model; 3], near_hz: f64, step_hz: f64) -> Member {
    let six = &models[MIDDLE];
    let order = six.order.min(shown(rows, near_hz)).max(1);
    let cluster = six.clusters.iter().find(|c| c.holds(near_hz)).cloned().unwrap_or_else(|| {
        Cluster { minima: vec![refined(rows, &six.weight, order, near_hz, step_hz)] }
    });
    let best = cluster.best();
    let f = best.frequency_hz;
    // The curvature of χ² about a standard deviation to both sides: over half a step of the search it is less where the period is known far better than that.
    let at = |f: f64| rows.fit(&six.weight, f, order).chi2;
    let by = |h: f64| {
        let rise = (at(f + h) - best.chi2).max(0.0) + (at(f - h) - best.chi2).max(0.0);
        (2.0 / (rise / (h * h) * six.scale)).sqrt()
    };
    let mut sigma_hz = by(0.5 * step_hz);
    for _ in 0..3 {
        if sigma_hz < 0.5 * step_hz && sigma_hz > 0.0 {
            sigma_hz = by(sigma_hz);
        }
    }
    let sigma_s = sigma_hz / (f * f);
    // Cycle counts are neighbours of one period: minima that any of the models leaves.
    let mut counts = vec![f];
    for model in models {
        let own =
            model.clusters.iter().flat_map(|c| &c.minima).filter(|m| cluster.holds(m.frequency_hz));
        let lowest = own.clone().map(|m| m.chi2).fold(f64::INFINITY, f64::min);
        counts.extend(
            own.filter(|m| (m.chi2 - lowest) * model.scale <= RULED_OUT).map(|m| m.frequency_hz),
        );
    }
    counts.sort_by(f64::total_cmp);
    // A cycle more or less over the whole is about a resolution away.
    let resolution = 0.5 / rows.span_s();
    let mut apart: Vec<f64> = Vec::new();
    for c in counts.iter().copied() {
        if apart.last().is_none_or(|last| c - last > resolution) {
            apart.push(c);
        }
    }
    let half = SIGMAS_95 * sigma_s;
    let interval_s = Interval::new(1.0 / counts[counts.len() - 1] - half, 1.0 / counts[0] + half);
    let fit = rows.fit(&six.weight, f, order);
    Member {
        period_s: 1.0 / f,
        sigma_s,
        interval_s,
        cycles_counted: apart.len() == 1,
        cycle_counts: apart.len(),
        turns: rows.span_s() * f,
        gaps: std::array::from_fn(|k| models[k].gap_at(rows, f, step_hz)),
        phase_seen: phase_seen(rows, f),
        amplitude_mag: amplitude(rows, &fit, f),
    }
}

/// From the brightest to the faintest of a model where there are samples, mag.
fn amplitude(rows: &Rows, fit: &Fit, frequency_hz: f64) -> f64 {
    let all = rows.time.iter().map(|t| light(&fit.harmonics, turns(frequency_hz, *t)));
    let (low, high) =
        all.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), m| (a.min(m), b.max(m)));
    high - low
}

/// Whether two frequencies are of one period.
fn same(a: f64, b: f64, within: f64) -> bool {
    (a / b - 1.0).abs() <= within
}

/// Periods that the models leave possible, by frequency: one, several, or why there is no answer.
fn possible(rows: &Rows, models: &[Model; 3], step_hz: f64) -> Result<Vec<f64>, Reason> {
    let [four, six, eight] = models;
    let best = models.each_ref().map(|m| m.best().frequency_hz);
    let clear = models
        .each_ref()
        .map(|m| m.clusters.get(1).is_none_or(|c| m.gap(c.best().chi2) > RULED_OUT));
    let more_agree = clear[1] && clear[2] && same(best[1], best[2], AGREE);
    let fewer_agree =
        clear[0] && clear[1] && same(best[0], best[1], AGREE) && same(best[1], best[2], SAME);
    if more_agree || fewer_agree {
        // Many harmonics fit multiples of a period, too: where four prefer a part of it, both are possible.
        let is_part = [2.0, 3.0].iter().any(|n| same(best[0], n * best[1], SAME));
        return Ok(if is_part { vec![best[1], best[0]] } else { vec![best[1]] });
    }
    if six.gap_at(rows, best[2], step_hz) > RULED_OUT
        && eight.gap_at(rows, best[1], step_hz) > RULED_OUT
    {
        return Err(Reason::Disagree { six_s: 1.0 / best[1], eight_s: 1.0 / best[2] });
    }
    let left = |m: &Model, limit: f64| -> Vec<f64> {
        let own = m.clusters.iter().map(Cluster::best).filter(|c| m.gap(c.chi2) <= limit);
        own.map(|c| c.frequency_hz).collect()
    };
    let together = |lists: [Vec<f64>; 3]| {
        let mut all: Vec<f64> = Vec::new();
        for f in lists.into_iter().flatten() {
            if !all.iter().any(|other| same(*other, f, SAME)) {
                all.push(f);
            }
        }
        all
    };
    // Where four harmonics are enough they choose better: more leave more multiples.
    let lost = rows.fit(&eight.weight, best[0], four.order).chi2
        - rows.fit(&eight.weight, best[2], eight.order).chi2;
    let is_enough = lost * eight.scale <= TOO_FEW;
    for limit in [RULED_OUT, UNLIKELY] {
        let many = together([left(six, limit), left(eight, limit), vec![best[0]]]);
        if many.len() <= MOST_MEMBERS {
            return Ok(many);
        }
        let few = together([left(four, limit), vec![best[1]], vec![best[2]]]);
        if is_enough && few.len() <= MOST_MEMBERS {
            return Ok(few);
        }
    }
    let all = together([left(six, RULED_OUT), left(eight, RULED_OUT), vec![best[0]]]);
    Err(Reason::Many { period_s: 1.0 / best[1], periods: all.len() })
}

/// Harmonics of a frequency that the sampling shows.
fn shown(rows: &Rows, frequency_hz: f64) -> usize {
    (0.5 / (step_s(rows) * frequency_hz) * (1.0 + 1e-9)) as usize
}

/// Halves, thirds and further parts of some periods that lie below the search and do as well: of a period that is too short to be looked for, the search finds a multiple.
fn parts_below(
    rows: &Rows,
    models: &[Model; 3],
    periods: &[f64],
    grid: &FrequencyGrid,
) -> Vec<f64> {
    let mut found: Vec<f64> = Vec::new();
    for f in periods {
        for part in (2..=MOST_PARTS).map(|n| n as f64 * f) {
            let (known, is_known) = (found.clone(), |g: &f64| same(*g, part, SAME));
            if part <= grid.last_hz() + grid.step_hz || known.iter().any(is_known) {
                continue;
            }
            let does_as_well = models[MIDDLE..].iter().any(|m| {
                let order = m.order.min(shown(rows, part));
                order > 0
                    && m.gap(refined(rows, &m.weight, order, part, grid.step_hz).chi2) <= RULED_OUT
            });
            if does_as_well {
                found.push(part);
            }
        }
    }
    found
}

/// The verdict of all models.
fn judge(rows: &Rows, models: &[Model; 3], grid: &FrequencyGrid, answer: &mut SessionPeriods) {
    answer.smallest_gap =
        models.each_ref().map(|m| m.clusters.get(1).map(|c| m.gap(c.best().chi2)));
    answer.best_s = Some(models.each_ref().map(|m| 1.0 / m.best().frequency_hz));
    answer.correlation = models.each_ref().map(|m| m.correlation);
    answer.scatter_mag = Some(models[MIDDLE].scatter);
    let make = |f: f64| member(rows, models, f, grid.step_hz);
    let found = possible(rows, models, grid.step_hz).and_then(|mut periods| {
        let below = parts_below(rows, models, &periods, grid);
        let all = periods.len() + below.len();
        if !below.is_empty() && all > MOST_MEMBERS {
            return Err(Reason::Many { period_s: 1.0 / periods[0], periods: all });
        }
        periods.extend(below);
        Ok(periods)
    });
    let reason = match found {
        Ok(periods) => {
            let mut members: Vec<Member> = periods.into_iter().map(make).collect();
            members.sort_by(|a, b| a.gaps[MIDDLE].total_cmp(&b.gaps[MIDDLE]));
            let margin = 2.0 * grid.step_hz;
            let is_bound = |m: &&Member| {
                let f = 1.0 / m.period_s;
                // Parts of a period that lie below the search were asked for by name.
                let last = grid.last_hz();
                f < grid.first_hz + margin || (last - margin..=last + margin).contains(&f)
            };
            let bound =
                members.iter().find(is_bound).map(|m| Reason::Bound { period_s: m.period_s });
            if bound.is_none() {
                answer.verdict = if members.len() == 1 { Outcome::Single } else { Outcome::Family };
            }
            answer.members = members;
            bound
        }
        Err(reason) => {
            answer.members = vec![make(models[MIDDLE].best().frequency_hz)];
            Some(reason)
        }
    };
    answer.reason = reason.as_ref().map(Reason::to_string);
    answer.because = reason;
}

/// The best model's folded curve and Δ over the frequencies.
fn draw(
    rows: &Rows,
    many: &Model,
    grid: &FrequencyGrid,
    place: &[usize],
    sessions: &[Session],
    answer: &mut SessionPeriods,
) {
    const MOST_DRAWN: usize = 20_000;
    let Some(best) = answer.members.first() else { return };
    let f = 1.0 / best.period_s;
    let fit = rows.fit(&many.weight, f, many.order);
    let left = rows.residuals(&fit, f);
    for ((session, zero), k) in rows.sessions.iter().zip(&fit.zero).zip(place) {
        let own = session.clone().map(|i| {
            let turn = turns(f, rows.time[i]);
            (turn - turn.floor(), rows.value[i] - zero)
        });
        answer.folded.push((sessions[*k].name.clone(), own.collect()));
        answer.sessions[*k].zero_mag = Some(*zero);
        answer.sessions[*k].scatter_mag = robust_sigma(left[session.clone()].iter().copied());
    }
    answer.harmonics = fit.harmonics;
    // The lowest of each stretch, so that no narrow minimum is lost.
    let stretch = grid.n.div_ceil(MOST_DRAWN).max(1);
    answer.drawn = (0..grid.n)
        .step_by(stretch)
        .filter_map(|first| {
            let own = first..grid.n.min(first + stretch);
            let lowest = own.min_by(|a, b| many.chi2[*a].total_cmp(&many.chi2[*b]))?;
            Some((1.0 / grid.frequency_hz(lowest), many.gap(many.chi2[lowest]).max(0.0)))
        })
        .collect();
}
