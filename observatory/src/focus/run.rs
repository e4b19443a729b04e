//! A run through the focus.

use super::curve::{Curve, CurveError, Point, fit};
use super::star::{Sharpness, sharpness};
use hifitime::Epoch;
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;
use std::time::Duration;
use sunglint_drivers::clock::{Deadline, DeviceClock};
use sunglint_drivers::device::{Camera, DeviceError, Focuser};
use sunglint_formats::Frame;
use sunglint_formats::time::format_utc;

/// Longest time of one move.
const MOVES: Duration = Duration::from_secs(180);
/// Steps that a focuser may be off and still be there.
const THERE: i64 = 1;
/// How much longer than its exposure a frame may take.
const FRAME: Duration = Duration::from_secs(60);

/// Side from which positions are approached: the gears' play lies on the other side then, each time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Approach {
    /// From lower positions.
    Up,
    /// From higher positions.
    Down,
}

/// How a run is made.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct RunOptions {
    /// Middle of the positions, steps; `None` for where the focuser stands.
    pub center: Option<i64>,
    /// Distance of two positions, steps.
    pub step: i64,
    /// Positions.
    pub points: usize,
    /// Frames at each position.
    pub frames: usize,
    /// Exposure of a frame, s.
    pub exposure_s: f64,
    /// Steps by which a position is passed before it is approached; more than the gears' play.
    pub overshoot: i64,
    /// Side from which positions are approached.
    pub approach: Approach,
}

impl RunOptions {
    /// Nine positions with one frame each, approached from below.
    pub fn new(step: i64, exposure_s: f64) -> Self {
        Self {
            center: None,
            step,
            points: 9,
            frames: 1,
            exposure_s,
            overshoot: step.saturating_mul(2),
            approach: Approach::Up,
        }
    }

    /// Changes them.
    #[must_use]
    pub fn with(mut self, change: impl FnOnce(&mut Self)) -> Self {
        change(&mut self);
        self
    }
}

/// One position of a run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Seen {
    /// Position, steps.
    pub position: i64,
    /// Half-flux radius; nothing where no star was seen.
    #[serde(flatten)]
    pub sharpness: Option<Sharpness>,
}

/// Result of a run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FocusRun {
    /// Begin of the run, UTC.
    pub begin_utc: String,
    /// Side from which positions were approached.
    pub approach: Approach,
    /// Where the focuser stood before, steps.
    pub started_at: i64,
    /// Positions in the order in which they were taken.
    pub points: Vec<Seen>,
    /// The curve; nothing where there is no best position.
    pub curve: Option<Curve>,
    /// Where the focuser stands now, steps; nothing where it did not say so after a move that failed.
    pub stands_at: Option<i64>,
    /// Half-flux radius of a frame at the best position.
    pub there: Option<Sharpness>,
    /// Temperature at the focuser, °C: mean of begin and end.
    pub temperature_c: Option<f64>,
}

/// Why a run did not end in focus.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// Camera or focuser.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// Options that make no sense.
    #[error("{what} is {found}, expected {expected}")]
    Option {
        /// Option.
        what: &'static str,
        /// Value that was given.
        found: String,
        /// Values that it may have.
        expected: String,
    },
    /// Positions that the focuser does not have.
    #[error(
        "the run goes from {from} to {to}, the overshoot included; the focuser has {least} to {most}: choose another --center, or smaller steps"
    )]
    Beyond {
        /// First position.
        from: i64,
        /// Last position.
        to: i64,
        /// Lowest position of the focuser.
        least: i64,
        /// Highest position of the focuser.
        most: i64,
    },
    /// No star anywhere.
    #[error(
        "no star was measured in any of {frames} frames: expose longer, look at a frame (`sunglint devices read`), or begin nearer to the focus"
    )]
    NoStar {
        /// Frames.
        frames: usize,
    },
    /// No best position.
    #[error(transparent)]
    Curve(#[from] CurveError),
    /// The frame at the best position is not sharp.
    #[error(
        "at {position}, the best position by the curve, the radius is {found:.2} px and not {expected:.2}: did the focuser slip, or the overshoot ({overshoot} steps) not take up its play?"
    )]
    NotSharp {
        /// Position.
        position: i64,
        /// Radius there, px.
        found: f64,
        /// Radius by the curve, px.
        expected: f64,
        /// Overshoot, steps.
        overshoot: i64,
    },
}

/// A run that did not end in focus: what was seen, and why. The focuser was sent back to where it stood.
#[derive(Debug, thiserror::Error)]
#[error("{error}")]
pub struct FailedRun {
    /// Positions and stars that were seen.
    pub run: Box<FocusRun>,
    /// Why it failed.
    #[source]
    pub error: RunError,
    /// Whether the focuser stands where it stood before.
    pub returned: bool,
}

struct Runner<'a> {
    camera: &'a mut dyn Camera,
    focuser: &'a mut dyn Focuser,
    show: &'a mut dyn FnMut(Frame, Epoch),
    clock: &'a DeviceClock,
    options: RunOptions,
    cancel: sunglint_drivers::clock::Cancel,
    /// Where it stands; nothing where that is not known.
    stands: Option<i64>,
    /// Whether it was told to move at all.
    moved: bool,
    /// Whether the last move ended where it was to: only then it is known which way the gears lie.
    settled: bool,
}

impl Runner<'_> {
    fn within(&self, time: Duration) -> Deadline {
        Deadline::after(self.clock.clock.clone(), time).with_cancel(&self.cancel)
    }

    fn step_to(&mut self, position: i64) -> Result<i64, DeviceError> {
        let deadline = self.within(MOVES);
        (self.moved, self.settled) = (true, false);
        let moved = self.focuser.move_to(position, &deadline);
        // A move that fails has moved it, too: as far as it says, or nobody knows where.
        self.stands = moved.as_ref().map_or_else(|failed| failed.done, |at| Some(*at));
        let at = moved.map_err(|failed| *failed.error)?;
        if (at - position).abs() > THERE {
            let (asked, got) = (position.to_string(), at.to_string());
            let (device, name) = ("focuser", "position, steps");
            return Err(DeviceError::NotTaken { device, name, asked, got });
        }
        self.settled = true;
        Ok(at)
    }

    /// Moves to a position from the chosen side.
    fn approach(&mut self, position: i64) -> Result<i64, DeviceError> {
        let overshoot = self.options.overshoot;
        let from = self.stands.filter(|_| self.settled);
        let (before, comes) = match self.options.approach {
            Approach::Up => (position - overshoot, from.is_some_and(|at| at < position)),
            Approach::Down => (position + overshoot, from.is_some_and(|at| at > position)),
        };
        // A run stays within the range with its overshoot. The way back may end nearer to the end of the travel: there is no more room for it then.
        let [least, most] = self.focuser.range();
        let before = before.max(least).min(most);
        if !comes && before != position {
            self.step_to(before)?;
        }
        self.step_to(position)
    }

    fn look(&mut self) -> Result<Option<Sharpness>, DeviceError> {
        let mut seen = Vec::new();
        for _ in 0..self.options.frames {
            let time = FRAME + Duration::from_secs_f64(self.options.exposure_s);
            let deadline = self.within(time);
            let asked = self.clock.utc();
            let frame = self.camera.expose(self.options.exposure_s, &deadline)?;
            seen.extend(sharpness(&frame));
            (self.show)(frame, asked);
        }
        Ok(mean(&seen))
    }
}

/// Mean of several frames; where they scatter more than they say, by the air or the guiding, that is its uncertainty.
fn mean(seen: &[Sharpness]) -> Option<Sharpness> {
    let weight = |s: &Sharpness| s.sigma_px.powi(-2);
    let total: f64 = seen.iter().map(weight).sum();
    let stars = seen.iter().map(|s| s.stars).min()?;
    let hfr_px = seen.iter().map(|s| weight(s) * s.hfr_px).sum::<f64>() / total;
    let chi2: f64 = seen.iter().map(|s| weight(s) * (s.hfr_px - hfr_px).powi(2)).sum();
    let scale = if seen.len() > 1 { (chi2 / (seen.len() - 1) as f64).max(1.0) } else { 1.0 };
    Some(Sharpness { hfr_px, sigma_px: (scale / total).sqrt(), stars })
}

impl RunOptions {
    /// Refuses what makes no run.
    ///
    /// # Errors
    /// [`RunError::Option`], by the names of the command's options.
    pub fn check(&self) -> Result<(), RunError> {
        check(self)
    }
}

fn check(options: &RunOptions) -> Result<(), RunError> {
    let within = |what, found: f64, [least, most]: [f64; 2]| {
        if (least..=most).contains(&found) {
            return Ok(());
        }
        let expected = format!("{least} to {most}");
        Err(RunError::Option { what, found: found.to_string(), expected })
    };
    within("--step", options.step as f64, [1.0, 1e6])?;
    within("--points", options.points as f64, [5.0, 99.0])?;
    within("--frames", options.frames as f64, [1.0, 99.0])?;
    within("--exposure-s", options.exposure_s, [1e-6, 600.0])?;
    within("--overshoot", options.overshoot as f64, [0.0, 1e6])?;
    within("--center", options.center.unwrap_or(0) as f64, [-1e9, 1e9])
}

/// Goes through the focus and to the best position. `each` sees each position and may break.
///
/// # Errors
/// See [`FailedRun`].
pub fn run(
    camera: &mut dyn Camera,
    focuser: &mut dyn Focuser,
    clock: &DeviceClock,
    cancel: &sunglint_drivers::clock::Cancel,
    options: RunOptions,
    each: &mut dyn FnMut(&Seen) -> ControlFlow<()>,
) -> Result<FocusRun, FailedRun> {
    run_showing(camera, focuser, clock, cancel, options, each, &mut |_, _| {})
}

/// The same; `show` gets each frame, and when it was asked for.
///
/// # Errors
/// See [`FailedRun`].
pub fn run_showing(
    camera: &mut dyn Camera,
    focuser: &mut dyn Focuser,
    clock: &DeviceClock,
    cancel: &sunglint_drivers::clock::Cancel,
    options: RunOptions,
    each: &mut dyn FnMut(&Seen) -> ControlFlow<()>,
    show: &mut dyn FnMut(Frame, Epoch),
) -> Result<FocusRun, FailedRun> {
    let begun: Epoch = clock.utc();
    let mut result = FocusRun {
        begin_utc: format_utc(begun, 0),
        approach: options.approach,
        started_at: 0,
        points: Vec::new(),
        curve: None,
        stands_at: None,
        there: None,
        temperature_c: None,
    };
    let cancel = cancel.clone();
    let (stands, moved, settled) = (None, false, false);
    let mut runner =
        Runner { camera, focuser, show, clock, options, cancel, stands, moved, settled };
    let done = go(&mut runner, &mut result, each);
    result.stands_at = runner.stands;
    match done {
        Ok(()) => Ok(result),
        Err(error) => {
            // Whatever ended it, a cancelled token among it: the focus of before is better than none.
            runner.cancel = sunglint_drivers::clock::Cancel::new();
            let returned = !runner.moved || runner.approach(result.started_at).is_ok();
            result.stands_at = runner.stands;
            Err(FailedRun { run: Box::new(result), error, returned })
        }
    }
}

fn go(
    runner: &mut Runner<'_>,
    result: &mut FocusRun,
    each: &mut dyn FnMut(&Seen) -> ControlFlow<()>,
) -> Result<(), RunError> {
    let options = runner.options;
    check(&options)?;
    let soon = runner.within(Duration::from_secs(10));
    result.started_at = runner.focuser.position(&soon)?;
    runner.stands = Some(result.started_at);
    // A thermometer that fails is no reason not to focus: the run has no temperature then.
    let before = match runner.focuser.temperature_c(&soon) {
        Err(error @ DeviceError::Cancelled { .. }) => return Err(error.into()),
        read => read.ok().flatten(),
    };
    let center = options.center.unwrap_or(result.started_at);
    // At most 99 points of a million steps.
    let half = options.step * (options.points as i64 - 1) / 2;
    let mut positions: Vec<i64> =
        (0..options.points as i64).map(|i| center - half + i * options.step).collect();
    let [least, most] = runner.focuser.range();
    let (mut from, mut to) =
        (center - half, center - half + options.step * (options.points as i64 - 1));
    match options.approach {
        Approach::Up => from -= options.overshoot,
        Approach::Down => {
            positions.reverse();
            to += options.overshoot;
        }
    }
    if from < least || to > most {
        return Err(RunError::Beyond { from, to, least, most });
    }
    for position in positions {
        let position = runner.approach(position)?;
        let seen = Seen { position, sharpness: runner.look()? };
        result.points.push(seen);
        if each(&seen).is_break() {
            return Err(DeviceError::Cancelled { device: "focuser", action: "focusing" }.into());
        }
    }
    let seen = |seen: &Seen| {
        let Sharpness { hfr_px, sigma_px, .. } = seen.sharpness?;
        Some(Point { position: seen.position as f64, hfr_px, sigma_px })
    };
    let points: Vec<Point> = result.points.iter().filter_map(seen).collect();
    if points.is_empty() {
        return Err(RunError::NoStar { frames: options.points * options.frames });
    }
    let curve = fit(&points)?;
    result.curve = Some(curve);
    let best = curve.best.round();
    let position = runner.approach(best as i64)?;
    let there = runner.look()?;
    result.there = there;
    // Where it should stand, and not where it says that it does: a focuser that stands still elsewhere is on the curve, too.
    let expected = curve.at(best);
    let noise = points.iter().map(|p| p.sigma_px).fold(curve.scatter * expected, f64::max);
    match there {
        Some(there) if there.hfr_px <= 1.2 * expected + 4.0 * noise.hypot(there.sigma_px) => {}
        there => {
            let found = there.map_or(f64::NAN, |there| there.hfr_px);
            let overshoot = options.overshoot;
            return Err(RunError::NotSharp { position, found, expected, overshoot });
        }
    }
    let soon = runner.within(Duration::from_secs(10));
    let after = runner.focuser.temperature_c(&soon).ok().flatten();
    result.temperature_c = before.zip(after).map(|(a, b)| 0.5 * (a + b));
    Ok(())
}
