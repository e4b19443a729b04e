//! The period of whole curves: the verdict of all channels, on the clock of the body where a pass says how that goes, and the periodograms to draw.

use super::alone::{self, Without};
use super::spectrum::median_step;
use super::verdict::{Along, Outcome, Tracks, compared, verdict_along};
use super::{
    FlashTrain, FrequencyGrid, Options, PeriodError, Spectrum, Verdict, lomb_scargle, pdm,
    spectrum, verdict, window, with_flashes,
};
use crate::curves::{Curves, GAP_S};
use crate::series::{Series, SeriesError};
use crate::spin::by_pass;
use crate::synodic::{Bisectors, Sidereal};
use sunglint_formats::text::counted;
use sunglint_numerics::progress::Progress;

/// Frequencies of the periodograms at most: every k-th where the search has more.
const MOST_ROWS: usize = 20_000;
/// A series of more samples is looked at in so many means.
const MOST_SAMPLES: usize = 100_000;
const MEANS: f64 = 50_000.0;
/// A gap is longer than that many steps.
const GAP_STEPS: f64 = 20.0;
/// Frequencies to a resolution.
const OVERSAMPLING: f64 = 5.0;
/// Phase bins of the dispersion.
const BINS: usize = 20;
/// Warning that a scene cannot say how the body of several tracks was seen.
pub const GEOMETRY_NOT_USED: &str =
    "the scene's geometry is not used: it is that of one pass, and these are several tracks";
/// Begin of the warning that the period is not the same in all tracks.
pub const PERIOD_CHANGES: &str = "the period changes from track to track";

/// Options of the search for the period of whole curves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PeriodOptions {
    /// The shortest and the longest period.
    pub search: Options,
    /// Gaps longer than this part a curve into tracks, s; `None`: an hour where the body is near ([`Curves::is_near`]) or the whole needs too many frequencies, else none.
    pub gap_s: Option<f64>,
    /// Harmonics of the periodograms; the verdict chooses its own.
    pub harmonics: usize,
}

impl Default for PeriodOptions {
    fn default() -> Self {
        Self { search: Options::default(), gap_s: None, harmonics: 1 }
    }
}

/// Periodograms of a channel over the frequencies of [`FoundPeriod::grid`].
#[derive(Debug, Clone)]
pub struct Drawn {
    /// The channel's name.
    pub name: String,
    /// Power of the harmonics.
    pub power: Vec<f64>,
    /// Phase dispersion.
    pub theta: Vec<f64>,
    /// Amplitudes of the Fourier spectrum where the sampling is regular: at frequencies of its own.
    pub fourier: Option<Spectrum>,
}

/// The period of some curves.
#[derive(Debug, Clone)]
pub struct FoundPeriod {
    /// The curves.
    pub curves: Curves,
    /// The samples that were looked at, on the clock of the body where there is one.
    pub series: Vec<Series>,
    /// The verdict; with a clock in the time of the spin.
    pub verdict: Verdict,
    /// The frequencies of the periodograms; `None` where no period could be looked for.
    pub grid: Option<FrequencyGrid>,
    /// The periodograms, channel by channel.
    pub drawn: Vec<Drawn>,
    /// Spectral window: the power that the sampling alone makes.
    pub window: Vec<f64>,
    /// Bounds of the spin's period by the geometry of the pass.
    pub sidereal: Option<Sidereal>,
    /// The clock that goes with the body, where one was found.
    pub along: Option<Along>,
    /// The flashes, where the light of a single track has a train of them.
    pub flashes: Option<FlashTrain>,
    /// Periods of the tracks alone, where there are several that show one.
    pub tracks: Option<Tracks>,
    /// Warnings to the user about the result.
    pub warnings: Vec<String>,
    /// Harmonics of the periodograms.
    pub harmonics: usize,
}

/// Finds the way of the bisector of Sun and station at the times of some series; `None` where it is not known.
pub type Geometry<'a, E> = &'a dyn Fn(&[Series]) -> Result<Option<Bisectors>, E>;

/// Looks for the period of some curves. `geometry` is asked once, after the first verdict, and only if the curves are one track.
///
/// # Errors
/// Bounds or numbers of harmonics that cannot be; more frequencies than can be looked at; what `geometry` fails with.
pub fn find_period<E>(
    curves: Curves,
    options: &PeriodOptions,
    geometry: Option<Geometry<'_, E>>,
    progress: &dyn Progress,
) -> Result<FoundPeriod, E>
where
    E: From<PeriodError> + From<SeriesError>,
{
    progress.begin("looking for periods", None);
    let mut warnings = curves.warnings.clone();
    let Asked { series, verdict, tracks, flashes, whole } =
        ask::<E>(&curves, options, &mut warnings)?;
    if tracks > 1 {
        warnings.push(format!(
            "{tracks} tracks: turns between them are not counted, and one period is taken to hold in all (each track in a file of its own shows its own period)"
        ));
    }
    if geometry.is_some() && tracks > 1 {
        warnings.push(GEOMETRY_NOT_USED.into());
    }
    let mut found = FoundPeriod {
        curves,
        series,
        verdict,
        grid: None,
        drawn: Vec::new(),
        window: Vec::new(),
        sidereal: None,
        along: None,
        flashes,
        tracks: None,
        warnings,
        harmonics: options.harmonics,
    };
    if let Some(geometry) = geometry.filter(|_| tracks == 1)
        && let Some(bisectors) = geometry(&found.series)?
    {
        progress.begin("looking for a clock that goes with the body", None);
        found.follow(&bisectors, &options.search)?;
    }
    // A clock that bends with the body is chosen by harmonics, whose verdict stands then.
    let is_thinned = whole.is_some();
    let is_answered = !matches!(found.verdict.outcome, Outcome::NotEnough(_));
    let is_asked = found.flashes.is_none() && !(is_thinned && is_answered);
    if tracks == 1 && found.along.is_none() && is_asked {
        progress.begin("folding flashes", None);
        let by_harmonics = found.verdict.clone();
        let of = whole.as_deref().unwrap_or(&found.series);
        (found.verdict, found.flashes) = with_flashes(of, &options.search, by_harmonics);
    }
    found.compare_tracks(&options.search, options.gap_s.unwrap_or(GAP_S));
    progress.begin("drawing the periodograms", None);
    found.draw()?;
    found.concerns();
    Ok(found)
}

/// Series that were looked at, and the verdict on them.
struct Asked {
    series: Vec<Series>,
    verdict: Verdict,
    /// Tracks that a file has at most.
    tracks: usize,
    /// The flashes of all samples, where some that stand alone were left out and the others have no period.
    flashes: Option<FlashTrain>,
    /// All samples, where means of them were looked at.
    whole: Option<Vec<Series>>,
}

/// The verdict on curves, or on their tracks.
fn ask<E>(curves: &Curves, options: &PeriodOptions, warnings: &mut Vec<String>) -> Result<Asked, E>
where
    E: From<PeriodError> + From<SeriesError>,
{
    let gap_s = options.gap_s.or_else(|| curves.is_near().then_some(GAP_S));
    let (mut series, mut tracks) = match gap_s {
        Some(gap_s) => curves.tracks(gap_s)?,
        None => (curves.series()?, 1),
    };
    let mut whole = None;
    if let Some((means, width_s)) = means(&series, &options.search) {
        let most = series.iter().map(Series::len).max().unwrap_or(0);
        warnings.push(format!(
            "{most} samples are put together in means over {width_s:.4} s: periods below {:.4} s are not looked for (--shortest asks for them)",
            2.0 * width_s
        ));
        whole = Some(std::mem::replace(&mut series, means));
    }
    let found = match verdict(&series, &options.search) {
        Err(error @ PeriodError::TooMany { .. }) if gap_s.is_none() => {
            let (parted, number) = curves.tracks(GAP_S)?;
            if number == 1 {
                return Err(error.into());
            }
            (series, tracks, whole) = (parted, number, None);
            verdict(&series, &options.search)?
        }
        found => found?,
    };
    let asked = Asked { series, verdict: found, tracks, flashes: None, whole };
    if asked.whole.is_some() {
        return Ok(asked);
    }
    Ok(match alone::without(&asked.series, &options.search, &asked.verdict)? {
        None => asked,
        Some(Without { series, verdict, flashes, left_out }) => {
            warnings.push(format!(
                "{} alone, far from all neighbours, with nothing alike a turn later: left out",
                counted(left_out, "sample")
            ));
            Asked { series, verdict, flashes, ..asked }
        }
    })
}

/// Means of series that are too long to be looked at sample by sample, and over how long they are taken; `None` where they are not, or shorter periods are asked for.
fn means(series: &[Series], options: &Options) -> Option<(Vec<Series>, f64)> {
    let longest = series.iter().max_by_key(|s| s.len()).filter(|s| s.len() > MOST_SAMPLES)?;
    // Gaps have no means: the length of what was seen counts.
    let step_s = median_step(longest)?;
    let gaps = longest.time_s.windows(2).map(|t| t[1] - t[0]).filter(|s| *s > GAP_STEPS * step_s);
    let width_s = (longest.span_s() - gaps.sum::<f64>()) / MEANS;
    let is_asked = options.shortest_s.is_some_and(|s| s < 2.0 * width_s);
    let good = !is_asked && width_s > step_s;
    good.then(|| (series.iter().map(|s| s.binned(width_s)).collect(), width_s))
}

impl FoundPeriod {
    /// Looks for a clock that goes with the body along a pass.
    fn follow(&mut self, bisectors: &Bisectors, options: &Options) -> Result<(), PeriodError> {
        self.along = verdict_along(&self.series, options, &self.verdict, bisectors)?;
        if let Some(along) = &self.along {
            self.verdict = along.verdict.clone();
            self.series.clone_from(&along.series);
        }
        let best = self.drawn_verdict().best;
        self.sidereal = best.map(|best| bisectors.bounds(best.period_s));
        Ok(())
    }

    /// Asks each track for its own period, and says where they differ.
    fn compare_tracks(&mut self, options: &Options, gap_s: f64) {
        let is_by_flashes = self.flashes.as_ref().is_some_and(|f| f.decides);
        if self.along.is_some() || is_by_flashes {
            return;
        }
        let tracks = by_pass(self.series.clone(), gap_s);
        if tracks.len() < 2 {
            return;
        }
        self.tracks = compared(&tracks, options, &mut self.verdict);
        if let Some(tracks) = self.tracks.as_ref().filter(|t| t.differ()) {
            let (from, to) = tracks.from_to_s();
            self.warnings.push(format!(
                "{PERIOD_CHANGES}: {} tracks have periods from {from:.5} s to {to:.5} s, by chance with a probability of {:.1e}: the stated uncertainty holds them all",
                tracks.periods.len(),
                tracks.chance
            ));
        }
    }

    /// Periodograms, dispersions and the window over the frequencies that were looked at.
    fn draw(&mut self) -> Result<(), PeriodError> {
        let Some((shortest_s, longest_s)) = self.verdict.searched_s else { return Ok(()) };
        let span_s = self.series.iter().map(Series::span_s).fold(0.0, f64::max);
        let (first_hz, last_hz) = (1.0 / longest_s, 1.0 / shortest_s);
        let fine = 1.0 / (OVERSAMPLING * self.harmonics as f64 * span_s);
        let step_hz = fine.max((last_hz - first_hz) / MOST_ROWS as f64);
        if step_hz > 1.5 * fine {
            self.warnings.push(format!(
                "table and figure hold {MOST_ROWS} frequencies, one in {:.0}: narrow peaks may fall between them; the verdict saw all",
                step_hz / fine
            ));
        }
        let n = ((last_hz - first_hz) / step_hz).floor() as usize + 1;
        let grid = FrequencyGrid { first_hz, step_hz, n };
        let periods: Vec<f64> = (0..n).map(|i| 1.0 / grid.frequency_hz(i)).collect();
        let left_out = |s: &Series| self.verdict.left_out.iter().any(|(name, _)| *name == s.name);
        let mut drawn = Vec::new();
        for series in self.series.iter().filter(|s| !left_out(s)) {
            let bins = BINS.min(series.len() / 3).max(2);
            drawn.push(Drawn {
                name: series.name.clone(),
                power: lomb_scargle(series, &grid, self.harmonics)?,
                theta: pdm(series, &periods, bins)?.iter().map(|d| d.theta).collect(),
                fourier: spectrum(series).ok().filter(|s| s.beside == 0),
            });
        }
        let longest = self.series.iter().max_by(|a, b| a.span_s().total_cmp(&b.span_s()));
        if let Some(series) = longest {
            let even = Series { weight: vec![1.0; series.len()], ..series.clone() };
            self.window = window(&even, &grid)?;
        }
        (self.grid, self.drawn) = (Some(grid), drawn);
        Ok(())
    }

    /// Adds what was left out and found odd to the warnings.
    fn concerns(&mut self) {
        if let Some(uneven) = self.verdict.uneven.filter(|u| u.is_cut)
            && let Outcome::NotEnough(_) = self.verdict.outcome
        {
            self.warnings.push(format!(
                "the samples are uneven and may show periods below {:.5} s: they were not looked for (--shortest asks for them)",
                uneven.shortest_s
            ));
        }
        for (name, error) in &self.verdict.left_out {
            let text = error.to_string();
            let named = text.starts_with(name.as_str());
            self.warnings.push(if named {
                format!("left out: {text}")
            } else {
                format!("left out: {name}: {text}")
            });
        }
        for series in &self.series {
            let odd = series.left_out;
            if odd.same_time > 0 {
                self.warnings.push(format!(
                    "{}: {} at the time of another: all are used",
                    series.name,
                    counted(odd.same_time, "sample")
                ));
            }
            if !series.is_weighted && !series.is_empty() {
                self.warnings.push(format!(
                    "{}: an uncertainty is 0 or missing: all samples weigh the same",
                    series.name
                ));
            }
        }
        for drawn in &self.drawn {
            if let Some(fourier) = drawn.fourier.as_ref().filter(|f| f.missing > 0) {
                self.warnings.push(format!(
                    "{}: the Fourier spectrum takes {} missing samples for the mean",
                    drawn.name, fourier.missing
                ));
            }
        }
    }

    /// The period to fold on, s: the verdict's best, if it has one that was accepted.
    pub fn folds_on(&self) -> Option<f64> {
        let verdict = self.drawn_verdict();
        match &verdict.outcome {
            Outcome::One(_) | Outcome::Family(_) => verdict.best.map(|b| b.period_s),
            _ => None,
        }
    }

    /// The verdict in the time of the series, which may be a clock's.
    pub fn drawn_verdict(&self) -> &Verdict {
        self.along.as_ref().map_or(&self.verdict, |along| &along.in_clock)
    }
}
