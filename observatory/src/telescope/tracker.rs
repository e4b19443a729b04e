//! Tracker: follows a path with a mount, learns from a finder, and watches itself.

use super::estimate::{ARCSEC, Estimator, EstimatorOptions, Found};
use super::hold::Hold;
use super::path::{TargetPath, angles, direction, wrapped};
use super::pier;
use super::plan::Keyhole;
use super::safety::{Danger, Guard};
use super::sense::Sense;
use super::steer::{Order, Orders};
use glam::{DVec2, DVec3};
use hifitime::Epoch;
use serde::Serialize;
use std::collections::VecDeque;
use std::ops::ControlFlow;
use std::time::Duration;
use sunglint_drivers::clock::{Cancel, Deadline, DeviceClock, clock_offset_s};
use sunglint_drivers::device::{
    DeviceError, Finder, Mount, MountAxes, MountMotion, MountRates, MountReading, PierSide, Spot,
};
use sunglint_numerics::axes::Axes;

/// A step of the clock that stops the tracking, s.
const CLOCK_STEP_S: f64 = 0.010;
/// How far ahead of its place the target's way is held against the Sun, s: what stopping takes, and two seconds.
const AHEAD_S: f64 = 3.0;
/// Turn of the stars in the axes of the Earth, rad/s.
const STARS_RAD_S: f64 = 7.292_115e-5;

/// How a mount follows.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct TrackOptions {
    /// Time between two commands, s.
    pub period_s: f64,
    /// Time from a command to the mount's doing it, motor lag included, s.
    pub latency_s: f64,
    /// Gain of the position's error, 1/s.
    pub gain_per_s: f64,
    /// Acceleration that the mount can do, deg/s²: it brakes in time.
    pub acceleration_deg_s2: f64,
    /// Estimator of the target's offset.
    pub estimator: EstimatorOptions,
    /// How much before the target the mount is sent to a place, s.
    pub lead_s: f64,
    /// Longest time that a slew may take, s.
    pub slew_within_s: f64,
    /// Whether the mount follows the prediction alone, finder or not.
    pub open_loop: bool,
    /// Whether the program checks that the clock does not step: not for a virtual clock.
    pub watch_clock: bool,
    /// How far from its prediction a star is looked for in the frames, arcsec.
    pub reach_arcsec: f64,
    /// Whether a mount that is found parked is freed: not where somebody else parked it.
    pub unpark: bool,
    /// Hour angle past the meridian up to which a mount that tells its side of the pier follows before it is turned over, deg.
    pub past_meridian_deg: f64,
    /// Speed of a slew, deg/s, where it is known: a mount that turns over is sent to where the target will be after half a turn at this speed. Without it the speed is that of its
    /// rates, 2°/s at least.
    pub slew_deg_s: Option<f64>,
    /// Whether a mount that tells a side of the pier is a German one. A fork may tell one, too: it does not turn over, nor does its camera.
    pub german: bool,
}

impl Default for TrackOptions {
    fn default() -> Self {
        Self {
            period_s: 0.1,
            latency_s: 0.25,
            gain_per_s: 3.0,
            acceleration_deg_s2: 2.0,
            estimator: EstimatorOptions::default(),
            lead_s: 10.0,
            slew_within_s: 240.0,
            open_loop: false,
            watch_clock: true,
            reach_arcsec: 1800.0,
            unpark: true,
            past_meridian_deg: 0.0,
            slew_deg_s: None,
            german: true,
        }
    }
}

/// Speed against the stars below which a target is one of them, rad/s: 2″/s.
const AMONG_STARS_RAD_S: f64 = 1e-5;
/// Frames without the target after which it is searched for along the track.
const EMPTY: u32 = 3;
/// A slew that ends farther from its goal was stopped, deg: pointing errors are smaller. Some mounts go to the hour angle that the place had in the beginning: what the
/// stars turn meanwhile is added.
const ARRIVES_DEG: f64 = 0.5;
/// Nearer than that to its goal, deg, a mount that has not said that it slews need not say it any more.
const NEAR_DEG: f64 = 0.02;
/// Time after which a mount says that it slews, s.
const BEGINS_S: f64 = 5.0;
/// Time for which a mount has to stand away from its goal before it counts as stopped, s, and the way that is no motion, deg: one bad reading is no stop.
const STANDS: (f64, f64) = (3.0, 0.1);
/// A mount that is sent so far past the end of the side that it says, deg, names its sides the other way round; not near the pole, deg of declination.
const OWN_CHOICE_DEG: f64 = 5.0;
const OWN_CHOICE_BELOW_DEG: f64 = 85.0;
/// Time for which it is looked whether a mount that was turned over says the other side, s.
const SAYS_SIDE_S: f64 = 2.0;
/// Hour angle after which a mount that did not turn over is asked again, deg: for the first time, and from then on.
const AGAIN_DEG: [f64; 2] = [1.0, 5.0];
/// After a turn over the mount has to come so far past the end of its side, deg, to be turned over again within so many seconds.
const BACK: (f64, f64) = (0.5, 300.0);
/// Farthest past the end of a side at which a mount that stands is taken to be at its own limit, deg.
const LIMIT_DEG: f64 = 20.0;
/// Slowest speed that is believed of a slew where nobody says it, deg/s.
const SLEW_DEG_S: f64 = 2.0;
/// Time over which a mount that moved by itself is seen to do no more than it was told, s; way that is none, deg, and part of the way that may be missing.
const RESTS: (f64, f64, f64) = (1.0, 0.1, 0.25);
/// Time before it is noticed that a mount goes its own way, s.
const BEFORE_S: f64 = 3.0;
/// Time of a call that sends the mount to a place, s: it may have to wait until the mount says that it slews. Shorter than the watchdog's patience.
const GOTO_S: f64 = 3.8;
/// Time that a mount takes to begin and end the turn over, beside the way, s.
const TURN_ENDS_S: f64 = 5.0;
/// Farthest from the finder's middle that a target is kept, arcsec: 2°.
const FARTHEST_ARCSEC: f64 = 7200.0;
/// Texts of what somebody else did.
pub(super) const PARKED: &str = "the mount was parked by somebody else";
pub(super) const STOPPED: &str = "the mount was stopped by somebody else";
/// A person's order that needs the camera's axes.
const NO_SIDE: &str = "not done: the mount does not say on which side of its pier it hangs, and on one of them the image is upside down";
/// Time over which it is seen that a mount goes a way that it was not told, s, and that way, deg; and the time for which that explains another side of the pier, s.
const STRAYS: (f64, f64) = (3.0, 3.0);
const SWEPT_S: f64 = 120.0;
/// Way by which the place may be below the horizon or the lowest altitude, deg, and the time for which it may be lower, s: a target that is a little late is found lower.
const LOW: (f64, f64) = (0.5, 5.0);
/// Time for which a mount may refuse its rates, s.
const REFUSED_S: f64 = 1.0;
/// Time by which a change of the rates may act sooner or later than is believed, s: jitter of commands, and what a motor needs.
const ACTS_S: f64 = 0.02;
/// Readings that are kept: a minute of ten a second, for frames with long exposures.
const READINGS: usize = 600;

/// State of a tracker.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum TrackState {
    /// On the way to the place where the path begins.
    Slewing,
    /// There, before the target.
    Waiting,
    /// Follows the prediction: there is no finder, or it is not used.
    Predicted,
    /// Looks for the target along the track.
    Searching,
    /// Sees the target.
    Locked,
    /// Goes on with what it learnt, without the target: cloud, shadow, a star.
    Coasting,
}

/// One step of a tracker.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[non_exhaustive]
pub struct TrackStep {
    /// Seconds of the path.
    pub time_s: f64,
    /// State.
    pub state: TrackState,
    /// Angles at which the target is believed to be, deg.
    pub target_deg: Axes,
    /// Angles that the mount says, deg.
    pub mount_deg: Axes,
    /// Rates that were commanded, deg/s.
    pub commanded_deg_s: Axes,
    /// Distance of the mount from where the target is believed to be, arcsec.
    pub error_arcsec: f64,
    /// Distance of the target from the finder's middle, arcsec, when it was seen last.
    pub seen_arcsec: Option<f64>,
    /// Learnt offset of a star from the prediction along the growing axes, arcsec.
    pub held_arcsec: Option<DVec2>,
    /// What was learnt: by how much the target is ahead of its prediction, s; for one slower than 1″/s, the distance along its track, arcsec.
    pub ahead_s: f64,
    /// What was learnt: by how much it is left of its track, arcsec.
    pub left_arcsec: f64,
    /// Distance of the Sun from the mount's direction, deg.
    pub sun_deg: f64,
    /// Altitude of the mount's direction, deg.
    pub altitude_deg: f64,
    /// Azimuth of the mount's direction, deg.
    pub azimuth_deg: f64,
    /// Side of the pier, where the mount says it.
    pub pier: Option<PierSide>,
    /// Whether the finder was seen to be turned or mirrored otherwise than it is told: its frames correct nothing any more.
    pub misled: bool,
}

/// Reason why a tracking ended before its path did.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TrackError {
    /// The mount or the finder.
    #[error(transparent)]
    Device(DeviceError),
    /// Not safe.
    #[error(transparent)]
    Danger(#[from] Danger),
    /// Somebody else stopped or parked it.
    #[error("{what}: it is left as it is until the next visit, a resume or a new start")]
    ByHand {
        /// What was done to it.
        what: &'static str,
    },
    /// The program's own watchdog stopped it.
    #[error(
        "the program stood still for more than 0.5 s (a paused or busy computer), and its own watchdog stopped the mount"
    )]
    Silent,
    /// A mount that only goes to places.
    #[error("this mount takes no rates: it can be sent to places, not follow a satellite")]
    NoRates,
    /// Nothing to follow.
    #[error("the path ended {ago_s:.0} s ago")]
    Over {
        /// Since when, s.
        ago_s: f64,
    },
    /// The mount did not end its slew.
    #[error("the mount was still on its way after {after_s:.0} s: it was stopped")]
    SlewTooLong {
        /// How long was waited, s.
        after_s: f64,
    },
    /// The mount says yes and does something else.
    #[error(
        "the mount does not do what it is told: {asked_deg:.3}° were asked for in 2 s, it moved by {moved_deg:.3}°; it was stopped (is its tracking on? are its motors?)"
    )]
    DoesNotFollow {
        /// Way that it should have gone, deg.
        asked_deg: f64,
        /// Way that it went, deg.
        moved_deg: f64,
    },
    /// The mount stands, past the meridian.
    #[error(
        "the mount stopped {past_deg:.1}° past the meridian: that looks like its own meridian limit (in its driver or its handset), if nobody stopped it; set it wider there, or let sunglint turn a German mount over before it (`past_meridian_deg`, --past-meridian)"
    )]
    MeridianLimit {
        /// Hour angle past the meridian, deg.
        past_deg: f64,
    },
}

/// A move of the mount that nobody asked for.
enum Own {
    /// Nothing.
    Nothing,
    /// It moved, or turned over: the senses were learnt anew.
    Moved,
    /// `each` broke meanwhile.
    Broken,
}

/// A mount that did not turn over when it should have.
#[derive(Debug, Clone, Copy)]
struct Stays {
    side: PierSide,
    hour_angle_deg: f64,
    times: usize,
}

/// How a tracking went.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[non_exhaustive]
pub struct TrackSummary {
    /// Steps that were done.
    pub steps: u64,
    /// Time of the path at which the target was locked first, s.
    pub locked_s: Option<f64>,
    /// Time of the path at which it began to follow, s.
    pub began_s: f64,
    /// Steps with the target in the finder.
    pub seen: u64,
    /// Whether it was stopped by a person.
    pub cancelled: bool,
}

/// A mount that follows a path.
pub struct Tracker<'a> {
    path: &'a TargetPath,
    guard: &'a Guard,
    mount: &'a mut dyn Mount,
    finder: Option<&'a mut dyn Finder>,
    orders: Option<&'a Orders>,
    clock: DeviceClock,
    options: TrackOptions,
    keyhole: Option<Keyhole>,
    cancel: Cancel,
    estimator: Estimator,
    /// Sign of life for a watchdog, between calls that take their time.
    beat: Option<Box<dyn Fn() + 'a>>,
    /// The last commands: when, and the rates, deg/s.
    commands: VecDeque<(f64, [f64; 2])>,
    /// The last readings: when, and the angles, deg; the first unwrapped.
    readings: VecDeque<(f64, [f64; 2])>,
    /// Side of the pier that it says.
    pier: Option<PierSide>,
    /// Side on which the camera hangs: some drivers make up the side that they say, and a camera turns over only with the mount.
    hangs: Option<PierSide>,
    /// When it said last that it slews, or went a way that it was not told, s of the path.
    swept_s: Option<f64>,
    /// Since when it is, or will be, too low, s of the path.
    low_s: Option<f64>,
    /// Since when it refuses its rates, s of the path.
    refused_s: Option<f64>,
    motion: Option<MountMotion>,
    /// Whether it was seen following the rates that it was given.
    followed: bool,
    /// Side of the pier on which the senses were learnt.
    learnt: Option<PierSide>,
    /// Where it did not turn over when it should have: it is not asked again soon.
    stays: Option<Stays>,
    /// Whether it says east where others say west.
    names_swapped: bool,
    /// When it turned over last, s of the path.
    turned_s: Option<f64>,
    /// Whether it was tried to turn it over where it stood still.
    limit_tried: bool,
    most_deg_s: [f64; 2],
    seen_arcsec: Option<f64>,
    search_from_s: Option<f64>,
    zero_step_s: f64,
    /// Frames since the beginning in which the target was not found.
    empty: u32,
    /// Offset of a target that stands among the stars.
    hold: Option<Hold>,
    /// Whether the finder sees the axes as it is told, as far as a star shows it.
    sense: Sense,
    misled: bool,
}

impl std::fmt::Debug for Tracker<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Tracker").field("options", &self.options).finish_non_exhaustive()
    }
}

impl<'a> Tracker<'a> {
    /// A tracker of a path. Nothing moves yet.
    pub fn new(
        path: &'a TargetPath,
        guard: &'a Guard,
        mount: &'a mut dyn Mount,
        finder: Option<&'a mut dyn Finder>,
        clock: DeviceClock,
        options: TrackOptions,
    ) -> Self {
        Self {
            path,
            guard,
            mount,
            finder,
            orders: None,
            clock,
            options,
            keyhole: None,
            cancel: Cancel::new(),
            estimator: Estimator::new(options.estimator),
            beat: None,
            commands: VecDeque::new(),
            readings: VecDeque::new(),
            pier: None,
            hangs: None,
            swept_s: None,
            low_s: None,
            refused_s: None,
            motion: None,
            followed: false,
            learnt: None,
            stays: None,
            names_swapped: false,
            turned_s: None,
            limit_tried: false,
            most_deg_s: [0.0; 2],
            seen_arcsec: None,
            search_from_s: None,
            zero_step_s: 0.0,
            empty: 0,
            hold: among_stars(path).then(|| {
                let coast_s = options.estimator.coast_s.max(3.0 * options.estimator.frame_s);
                Hold::new(options.reach_arcsec, coast_s)
            }),
            sense: Sense::default(),
            misled: false,
        }
    }

    /// Takes a person's orders while it follows.
    #[must_use]
    pub fn steered_by(mut self, orders: &'a Orders) -> Self {
        self.orders = Some(orders);
        self
    }

    /// Calls this as a sign of life between calls to the mount that take their time, beside `each` after each step.
    #[must_use]
    pub fn beating(mut self, beat: impl Fn() + 'a) -> Self {
        self.beat = Some(Box::new(beat));
        self
    }

    fn beat(&self) {
        if let Some(beat) = &self.beat {
            beat();
        }
    }

    /// Follows until the path ends, `each` breaks, or the token is set; in every case the mount is stopped at the end, but not where somebody else parks it.
    ///
    /// # Errors
    /// See [`TrackError`]. The mount was told to stop; where even that failed, the error is [`DeviceError::NotStopped`].
    pub fn run(
        &mut self,
        cancel: &Cancel,
        each: &mut dyn FnMut(&TrackStep) -> ControlFlow<()>,
    ) -> Result<TrackSummary, TrackError> {
        self.cancel = cancel.clone();
        let ended = self.follow(each);
        if matches!(ended, Err(TrackError::ByHand { what }) if what == PARKED) {
            // A stop would end the parking.
            return ended;
        }
        let grace = Deadline::after(self.clock.clock.clone(), Duration::from_secs(2));
        let stopped = self.mount.stop(&grace);
        match (ended, stopped) {
            (Ok(summary), Ok(())) => Ok(summary),
            (Err(TrackError::Device(DeviceError::Cancelled { .. })), Ok(())) => {
                Ok(TrackSummary { cancelled: true, ..self.summary() })
            }
            (Err(error), Ok(())) => Err(error),
            (_, Err(source)) => Err(TrackError::Device(DeviceError::NotStopped {
                device: "mount",
                source: Box::new(source),
            })),
        }
    }

    /// Goes to where the target is now, or will be when the path begins, and leaves the mount there as its goto does: it follows the stars, or stands. False where `each`
    /// broke; the mount is then stopped, as after an error.
    ///
    /// # Errors
    /// See [`TrackError`], as of [`Tracker::run`]. Rates are not needed.
    pub fn go(
        &mut self,
        cancel: &Cancel,
        each: &mut dyn FnMut(&TrackStep) -> ControlFlow<()>,
    ) -> Result<bool, TrackError> {
        self.cancel = cancel.clone();
        self.zero_step_s = clock_offset_s();
        let went = self.slew(self.options.lead_s, each);
        if matches!(went, Ok(true) | Err(TrackError::ByHand { what: PARKED })) {
            return went;
        }
        let grace = Deadline::after(self.clock.clock.clone(), Duration::from_secs(2));
        match self.mount.stop(&grace) {
            Ok(()) => went,
            Err(source) => Err(TrackError::Device(DeviceError::NotStopped {
                device: "mount",
                source: Box::new(source),
            })),
        }
    }

    fn summary(&self) -> TrackSummary {
        TrackSummary { steps: 0, locked_s: None, began_s: self.now_s(), seen: 0, cancelled: false }
    }

    fn now_s(&self) -> f64 {
        self.path.time_s(self.clock.utc())
    }

    fn soon(&self) -> Deadline {
        self.within(2.0)
    }

    fn within(&self, seconds: f64) -> Deadline {
        let time = Duration::from_secs_f64(seconds.max(0.0));
        Deadline::after(self.clock.clock.clone(), time).with_cancel(&self.cancel)
    }

    fn sleep(&self, seconds: f64) -> Result<(), TrackError> {
        let long = self.within(seconds + 60.0);
        let slept = long.sleep(Duration::from_secs_f64(seconds.max(0.0)));
        slept.map_err(|_| DeviceError::Cancelled { device: "mount", action: "following" }.into())
    }

    fn check_clock(&self) -> Result<(), TrackError> {
        if !self.options.watch_clock {
            return Ok(());
        }
        let step_s = clock_offset_s() - self.zero_step_s;
        if step_s.abs() > CLOCK_STEP_S {
            return Err(Danger::ClockStep { step_ms: step_s * 1e3 }.into());
        }
        Ok(())
    }

    /// Whether the finder looks upside down; `None` where its axes are known for one side of the pier, and the mount does not say on which it hangs.
    fn is_upside_down(&self) -> Option<bool> {
        let side = self.finder.as_ref().and_then(|finder| finder.side());
        match (side.filter(|_| self.options.german), self.hangs) {
            (None, _) => Some(false),
            (Some(side), Some(hangs)) => Some(side != hangs),
            (Some(_), None) => None,
        }
    }

    /// An offset that the finder, or a person by its frames, gives: along the growing axes on the side of the pier on which the mount hangs; `None` where that is not known.
    fn along_axes(&self, of_finder: [f64; 2]) -> Option<[f64; 2]> {
        let sign = if self.is_upside_down()? { -1.0 } else { 1.0 };
        Some(of_finder.map(|arcsec| sign * arcsec))
    }

    /// Where the telescope should look at a time: at the target, or so that it stands in the frame where a person wants it.
    fn target(&self, time_s: f64) -> DVec3 {
        let target = self.believed(time_s);
        let keep = self.orders.map(Orders::keep_arcsec).filter(|keep| *keep != DVec2::ZERO);
        match keep.and_then(|keep| self.along_axes(keep.to_array())) {
            Some(keep) => shifted(target, keep.map(|arcsec| -arcsec)),
            None => target,
        }
    }

    /// Where the target is believed to be at a time, with what was learnt.
    fn believed(&self, time_s: f64) -> DVec3 {
        if let Some(hold) = &self.hold {
            return shifted(self.path.at(time_s).direction, hold.off);
        }
        // From the time on up to which the offset was carried on.
        let learnt_s = self.estimator.since_s(time_s).clamp(0.0, 5.0);
        let ahead_s = if self.estimator.locked { learnt_s } else { 0.0 };
        let along = self.estimator.offset.along.after(ahead_s) + self.search_s(time_s);
        self.estimator.displaced(&self.path.at(time_s + along), ahead_s)
    }

    /// Offset of the search along the track, s: sweeps that grow, at a pace that the finder's field allows.
    fn search_s(&self, time_s: f64) -> f64 {
        let (Some(from_s), Some(finder)) = (self.search_from_s, self.finder.as_ref()) else {
            return 0.0;
        };
        let speed = self.path.at(time_s).speed_rad_s().to_degrees().max(1e-4);
        let most_s = 3.0 * self.options.estimator.along_s;
        let pace = 0.5 * finder.half_width_deg() / speed;
        let mut way = (time_s - from_s).max(0.0) * pace;
        let mut reach = (0.5 * self.options.estimator.along_s).min(most_s);
        loop {
            // Out, back over the middle to the other side, and home.
            for (length, at, sign) in
                [(reach, 0.0, 1.0), (2.0 * reach, reach, -1.0), (reach, -reach, 1.0)]
            {
                if way < length {
                    return at + sign * way;
                }
                way -= length;
            }
            if reach >= most_s {
                way = way.rem_euclid(4.0 * most_s);
            }
            reach = (2.0 * reach).min(most_s);
        }
    }

    /// The angles to be shown at a time, deg; the first within 180° of `near`.
    fn target_deg(&self, time_s: f64, near: f64) -> [f64; 2] {
        let mut angle = angles(self.target(time_s)).to_array();
        if let Some(keyhole) = &self.keyhole
            && let Some(first) = keyhole.first_deg(time_s)
        {
            angle[0] = first;
        }
        angle[0] = near + wrapped(angle[0] - near);
        angle
    }

    fn read(&mut self) -> Result<[f64; 2], TrackError> {
        Ok(self.reading()?.1)
    }

    /// A reading, and its angles, deg; the first unwrapped.
    fn reading(&mut self) -> Result<(MountReading, [f64; 2]), TrackError> {
        let reading = self.mount.reading(&self.soon())?;
        // A mount that says no side for a moment, as while it turns over, hangs where it hung.
        let pier = reading.pier.or(self.pier);
        let mut angle = self.path.angles_of(&reading).to_array();
        let time_s = self.path.time_s(reading.utc);
        if reading.motion == MountMotion::Slewing || self.strays(time_s, angle) {
            self.swept_s = Some(time_s);
        }
        let swept = self.swept_s.is_some_and(|swept_s| time_s - swept_s < SWEPT_S);
        if self.hangs != pier && (self.hangs.is_none() || swept) {
            // Frames of before were taken by a camera that was upside down.
            self.readings.clear();
            self.hangs = pier;
        }
        if let Some((_, last)) = self.readings.back() {
            angle[0] = last[0] + wrapped(angle[0] - last[0]);
        }
        if self.readings.back().is_none_or(|(last_s, _)| time_s > *last_s) {
            self.readings.push_back((time_s, angle));
        }
        // What a frame's middle is held against, also of long exposures.
        let frames = (3.0 * self.options.estimator.frame_s / self.options.period_s) as usize;
        if self.readings.len() > READINGS.max(frames.min(20 * READINGS)) {
            self.readings.pop_front();
        }
        (self.pier, self.motion) = (pier, Some(reading.motion));
        self.beat();
        Ok((reading, angle))
    }

    /// Whether it went a way in the last seconds that it was not told, as a mount does that turns over.
    fn strays(&self, time_s: f64, angle: [f64; 2]) -> bool {
        let since = self.readings.iter().find(|(at_s, _)| time_s - at_s < STRAYS.0);
        since.is_some_and(|(at_s, from)| {
            let told = self.carried(*at_s, *from, time_s);
            direction(angle).angle_between(direction(told)).to_degrees() > STRAYS.1
        })
    }

    /// Whether somebody else stopped or parked the mount since it was told to move: that is not undone.
    fn check_hand(&mut self) -> Result<(), TrackError> {
        match self.motion {
            Some(MountMotion::Parked) => Err(TrackError::ByHand { what: PARKED }),
            Some(MountMotion::Tracking) => {
                self.followed |= !self.commands.is_empty();
                Ok(())
            }
            Some(MountMotion::Still) if self.followed && self.is_told_to_move() => {
                Err(TrackError::ByHand { what: STOPPED })
            }
            _ => Ok(()),
        }
    }

    /// Whether all rates that were commanded within the last seconds are motions. A command takes its time.
    fn is_told_to_move(&self) -> bool {
        let since_s = self.now_s() - self.options.latency_s - 1.0;
        for (sent_s, rates) in self.commands.iter().rev() {
            if *rates == [0.0; 2] {
                return false;
            }
            if *sent_s < since_s {
                return true;
            }
        }
        false
    }

    /// Angles that a mount had at a time, from its readings; the commands carry the last one on.
    fn angles_then(&self, time_s: f64) -> Option<[f64; 2]> {
        let (last_s, last) = *self.readings.back()?;
        if time_s >= last_s {
            return Some(self.carried(last_s, last, time_s));
        }
        let after = self.readings.iter().position(|(s, _)| *s >= time_s)?;
        let (b_s, b) = self.readings[after];
        if after == 0 {
            return (b_s - time_s < 0.05).then_some(b);
        }
        let (a_s, a) = self.readings[after - 1];
        let part = (time_s - a_s) / (b_s - a_s);
        // Between them on the way that it was told, where its rates change.
        let (then, told) = (self.carried(a_s, a, time_s), self.carried(a_s, a, b_s));
        Some([0, 1].map(|i| then[i] + part * (b[i] - told[i])))
    }

    /// Where the mount will be: its reading, and the commands that act between.
    fn carried(&self, from_s: f64, angle: [f64; 2], to_s: f64) -> [f64; 2] {
        let mut angle = angle;
        let delay = self.options.latency_s;
        for (i, (sent_s, rate)) in self.commands.iter().enumerate() {
            let begins = (sent_s + delay).max(from_s);
            let ends = self.commands.get(i + 1).map_or(to_s, |next| (next.0 + delay).min(to_s));
            if ends > begins {
                for (angle, rate) in angle.iter_mut().zip(rate) {
                    *angle += rate * (ends - begins);
                }
            }
        }
        angle
    }

    /// Goes to where the path begins, or to where the target of one that is on will be in `lead_s`.
    fn slew(
        &mut self,
        lead_s: f64,
        each: &mut dyn FnMut(&TrackStep) -> ControlFlow<()>,
    ) -> Result<bool, TrackError> {
        let frame = self.path.frame();
        let start_s = self.now_s().max(0.0);
        let mut meet_s = start_s + if start_s > 0.0 { lead_s } else { 0.0 };
        self.beat();
        let here = self.read()?;
        if self.motion == Some(MountMotion::Parked) && !self.options.unpark {
            return Err(TrackError::ByHand { what: PARKED });
        }
        if self.options.unpark {
            self.mount.set_parked(false, &self.soon()).or_else(|error| match error {
                DeviceError::NotReady { .. } => Ok(()),
                error => Err(error),
            })?;
            self.beat();
        }
        let goal = |tracker: &Self, meet_s: f64| tracker.target_deg(meet_s, here[0]);
        let to = goal(self, meet_s);
        let way = self.guard.way(
            frame.to_enu(direction(here)),
            frame.to_enu(direction(to)),
            self.clock.utc(),
            self.options.slew_within_s,
        )?;
        for (i, by) in way.iter().enumerate() {
            let last = i + 1 == way.len();
            if last {
                meet_s = meet_s.max(self.now_s() + if self.now_s() > 0.0 { lead_s } else { 0.0 });
            }
            let angle_to =
                if last { goal(self, meet_s) } else { angles(frame.of_enu(*by)).to_array() };
            let now_s = self.now_s();
            // A mount that follows the stars afterwards should stand where the target comes.
            let place = self.path.place_of(angle_to, now_s);
            let soon = self.within(GOTO_S);
            self.beat();
            self.mount.begin_goto(place, &soon)?;
            self.beat();
            let begun_s = self.now_s();
            let mut slewed = false;
            // Since when it stands beside its goal, and where.
            let mut beside: Option<(f64, [f64; 2])> = None;
            loop {
                self.sleep(self.options.period_s)?;
                self.check_clock()?;
                let (reading, angle) = self.reading()?;
                let step = self.step(TrackState::Slewing, angle, to, [0.0; 2]);
                self.guard.check_sun(frame.to_enu(direction(angle)), self.clock.utc())?;
                if each(&step).is_break() {
                    return Ok(false);
                }
                let after_s = self.now_s() - begun_s;
                slewed |= reading.motion == MountMotion::Slewing;
                if reading.motion == MountMotion::Parked {
                    return Err(TrackError::ByHand { what: PARKED });
                }
                if reading.motion == MountMotion::Slewing {
                    beside = None;
                } else {
                    // A mount that follows the stars stays at their places.
                    let goal = match reading.motion {
                        MountMotion::Tracking => {
                            self.path.angles_at(place, self.path.time_s(reading.utc)).to_array()
                        }
                        _ => angle_to,
                    };
                    let off = direction(angle).angle_between(direction(goal)).to_degrees();
                    // One that says that it follows the stars does so where it has arrived; one that was stopped may go back to it.
                    let stands = reading.motion == MountMotion::Still && self.tells_tracking();
                    let begun = slewed || off < NEAR_DEG || after_s > BEGINS_S;
                    let arrives_deg = ARRIVES_DEG + 0.0042 * after_s;
                    if begun && !stands && off < arrives_deg {
                        break;
                    }
                    let moved = |from: [f64; 2]| {
                        direction(angle).angle_between(direction(from)).to_degrees() > STANDS.1
                    };
                    match beside {
                        Some((since_s, from)) if !moved(from) => {
                            if after_s - since_s >= STANDS.0 && (slewed || after_s > BEGINS_S) {
                                return Err(TrackError::ByHand { what: STOPPED });
                            }
                        }
                        _ => beside = Some((after_s, angle)),
                    }
                }
                if after_s > self.options.slew_within_s {
                    return Err(TrackError::SlewTooLong { after_s });
                }
            }
        }
        self.learn_names();
        Ok(true)
    }

    /// Whether a mount that stands after a goto was stopped.
    fn tells_tracking(&self) -> bool {
        let abilities = self.mount.abilities();
        abilities.tells_tracking && self.path.frame().axes == MountAxes::Equatorial
    }

    /// Whether it is a German mount that says on which side of the pier it hangs.
    fn is_german(&self) -> bool {
        let equatorial = self.path.frame().axes == MountAxes::Equatorial;
        equatorial && self.options.german && self.mount.abilities().tells_pier_side
    }

    /// The side of the pier by the name that others give it.
    fn true_side(&self) -> Option<PierSide> {
        self.pier.map(|side| if self.names_swapped { pier::other(side) } else { side })
    }

    /// A mount that chose, by a goto, the side that cannot be names its sides the other way round.
    fn learn_names(&mut self) {
        let Some((_, [hour_angle, declination])) = self.readings.back().copied() else { return };
        let Some(side) = self.true_side().filter(|_| self.is_german()) else { return };
        let margin_deg = pier::margin_deg(OWN_CHOICE_DEG, declination);
        let past_deg = pier::past_deg(side, hour_angle) - self.options.past_meridian_deg;
        if past_deg > margin_deg && declination.abs() < OWN_CHOICE_BELOW_DEG {
            self.names_swapped = !self.names_swapped;
        }
    }

    /// Tries which way the axes turn, on the side of the pier on which it hangs now. What it was told before, and where it stood, counts no more.
    fn learn(&mut self) -> Result<(), TrackError> {
        let within = self.within(20.0);
        let beat = &self.beat;
        let beat = || beat.as_ref().map_or((), |beat| beat());
        self.mount.learn_senses(&beat, &within)?;
        (self.readings, self.commands) = (VecDeque::new(), VecDeque::new());
        self.beat();
        self.read()?;
        self.learnt = self.pier;
        self.followed = false;
        Ok(())
    }

    /// Lets a mount end what it does by itself: a slew of its own, as when it turns over at its own limit, or a turn that only the side of the pier tells. Nothing is sent
    /// meanwhile, as that would end it half-way. Then the senses are learnt anew.
    fn own_motion(
        &mut self,
        each: &mut dyn FnMut(&TrackStep) -> ControlFlow<()>,
    ) -> Result<Own, TrackError> {
        // Some mounts say for ever that they slew, while they have rates.
        let slews = self.motion == Some(MountMotion::Slewing) && self.followed;
        let turned = self.pier != self.learnt;
        if !slews && !turned {
            return Ok(Own::Nothing);
        }
        self.wait_for_it(each)
    }

    /// Waits until the mount does no more than it was told, and learns the senses anew.
    fn wait_for_it(
        &mut self,
        each: &mut dyn FnMut(&TrackStep) -> ControlFlow<()>,
    ) -> Result<Own, TrackError> {
        let begun_s = self.now_s();
        let commands = self.commands.clone();
        let last = commands.back().map_or([0.0; 2], |(_, rates)| *rates);
        // Rates of before it went its own way: those since then ran after it.
        let before = commands.iter().rev().find(|(sent_s, _)| *sent_s < begun_s - BEFORE_S);
        let rates = before.map_or(last, |(_, rates)| *rates);
        let most_s = self.turn_s().max(60.0).min(self.options.slew_within_s);
        // Where it stood a second ago.
        let mut from: Option<(f64, [f64; 2])> = None;
        loop {
            self.sleep(self.options.period_s)?;
            self.check_clock()?;
            let (reading, angle) = self.reading()?;
            let frame = self.path.frame();
            self.guard.check_sun(frame.to_enu(direction(angle)), self.clock.utc())?;
            let now_s = self.now_s();
            let target = self.target_deg(now_s.max(0.0), angle[0]);
            if each(&self.step(TrackState::Slewing, angle, target, rates)).is_break() {
                return Ok(Own::Broken);
            }
            match reading.motion {
                MountMotion::Parked => return Err(TrackError::ByHand { what: PARKED }),
                MountMotion::Slewing => from = None,
                _ => {
                    let read_s = self.path.time_s(reading.utc);
                    match from {
                        Some((from_s, at)) if read_s - from_s >= RESTS.0 => {
                            // The sense of an axis may have turned round with the side.
                            let rests = [0, 1].into_iter().all(|i| {
                                let went = wrapped(angle[i] - at[i]).abs();
                                let told = (rates[i] * (read_s - from_s)).abs();
                                went < RESTS.1 || (went - told).abs() < RESTS.1 + RESTS.2 * told
                            });
                            let stopped = reading.motion == MountMotion::Still;
                            if rests && stopped && self.tells_tracking() && rates != [0.0; 2] {
                                // After a turn of its own it follows again.
                                return Err(TrackError::ByHand { what: STOPPED });
                            }
                            if rests {
                                break;
                            }
                            from = Some((read_s, angle));
                        }
                        Some(_) => {}
                        None => from = Some((read_s, angle)),
                    }
                }
            }
            let after_s = now_s - begun_s;
            if after_s > most_s {
                return Err(TrackError::SlewTooLong { after_s });
            }
        }
        self.estimator.rest();
        self.turned_s = Some(self.now_s());
        self.learn()?;
        Ok(Own::Moved)
    }

    fn step(
        &self,
        state: TrackState,
        mount: [f64; 2],
        target: [f64; 2],
        rates: [f64; 2],
    ) -> TrackStep {
        let enu = self.path.frame().to_enu(direction(mount));
        let error = direction(mount).angle_between(direction(target)) * ARCSEC;
        TrackStep {
            time_s: self.now_s(),
            state,
            target_deg: target.into(),
            mount_deg: mount.into(),
            commanded_deg_s: rates.into(),
            error_arcsec: error,
            seen_arcsec: self.seen_arcsec,
            held_arcsec: self.hold.as_ref().filter(|hold| hold.locked).map(|hold| hold.off.into()),
            ahead_s: self.estimator.offset.along.value,
            left_arcsec: self.estimator.offset.across.value,
            sun_deg: self.guard.sun_distance_deg(enu, self.clock.utc()),
            altitude_deg: enu.z.clamp(-1.0, 1.0).asin().to_degrees(),
            azimuth_deg: enu.x.atan2(enu.y).to_degrees().rem_euclid(360.0),
            pier: self.pier,
            misled: self.misled,
        }
    }

    fn follow(
        &mut self,
        each: &mut dyn FnMut(&TrackStep) -> ControlFlow<()>,
    ) -> Result<TrackSummary, TrackError> {
        self.zero_step_s = clock_offset_s();
        let most = self.mount.abilities().fastest_deg_s().ok_or(TrackError::NoRates)?;
        self.most_deg_s = most.map(|rate| 0.98 * rate).to_array();
        let ago_s = self.now_s() - self.path.seconds();
        if ago_s > 0.0 {
            return Err(TrackError::Over { ago_s });
        }
        // Near the pole of its axes: the zenith, or the pole of the sky.
        self.keyhole = Keyhole::of(self.path, self.most_deg_s[0]);
        let mut summary = self.summary();
        if !self.slew(self.options.lead_s, each)? {
            return Ok(TrackSummary { cancelled: true, ..summary });
        }
        self.learn()?;
        // Before the target comes, the mount stands.
        while self.now_s() < 0.0 {
            self.sleep(self.options.period_s.min(-self.now_s()).max(0.001))?;
            self.check_clock()?;
            let angle = self.read()?;
            match self.own_motion(each)? {
                Own::Nothing => {}
                Own::Moved => continue,
                Own::Broken => return Ok(TrackSummary { cancelled: true, ..summary }),
            }
            self.check_hand()?;
            self.check_ahead(angle)?;
            let target = self.target_deg(0.0, angle[0]);
            if self.now_s() < -2.0 {
                // It keeps the place of the first moment: a mount that follows the stars would leave it.
                let wanted = self.rates(angle, target, [0.0; 2]);
                self.command(wanted)?;
            }
            if each(&self.step(TrackState::Waiting, angle, target, [0.0; 2])).is_break() {
                return Ok(TrackSummary { cancelled: true, ..summary });
            }
        }
        summary.began_s = self.now_s();
        let mut next_s = self.now_s();
        let mut check: Option<(f64, [f64; 2])> = None;
        while self.now_s() < self.path.seconds() {
            self.check_clock()?;
            let angle = self.read()?;
            match self.own_motion(each)? {
                Own::Nothing => {}
                Own::Moved => {
                    check = None;
                    continue;
                }
                Own::Broken => return Ok(TrackSummary { cancelled: true, ..summary }),
            }
            self.check_hand().map_err(|error| self.limit(error, angle))?;
            if let Some(side) = self.ends_its_side(angle) {
                check = None;
                if !self.turn_over(side, each)? {
                    return Ok(TrackSummary { cancelled: true, ..summary });
                }
                continue;
            }
            self.obey();
            self.check_ahead(angle)?;
            let state = self.look(&mut summary)?;
            let now_s = self.now_s();
            let (read_s, _) = self.readings.back().copied().unwrap_or((now_s, angle));
            let acts_s = now_s + self.options.latency_s;
            let then = self.carried(read_s, angle, acts_s);
            let target = self.target_deg(acts_s, then[0]);
            let half = 0.5 * self.options.period_s;
            let (before, after) =
                (self.target_deg(acts_s, then[0]), self.target_deg(acts_s + 2.0 * half, then[0]));
            let ahead = [0, 1].map(|i| (after[i] - before[i]) / (2.0 * half));
            let rates = self.rates(then, target, ahead);
            self.command(rates).map_err(|error| self.limit(error, angle))?;
            if let Err(error) = self.check_follows(&mut check, read_s, angle) {
                // It goes elsewhere where it may turn over, and does not say that it slews: that is left to it, once.
                if self.turns_by_itself(&error) && !self.limit_tried {
                    self.limit_tried = true;
                    check = None;
                    match self.wait_for_it(each)? {
                        Own::Broken => return Ok(TrackSummary { cancelled: true, ..summary }),
                        _ => continue,
                    }
                }
                let error = self.limit(error, angle);
                // It says that it follows, and stands: at its limit. On the other side there is none.
                let side = match error {
                    TrackError::MeridianLimit { .. } if !self.limit_tried => {
                        self.pier.filter(|_| self.is_german())
                    }
                    _ => None,
                };
                let Some(side) = side else { return Err(error) };
                self.limit_tried = true;
                check = None;
                if !self.turn_over(side, each)? {
                    return Ok(TrackSummary { cancelled: true, ..summary });
                }
                if self.pier == Some(side) {
                    return Err(error);
                }
                continue;
            }
            let shown = self.target_deg(read_s, angle[0]);
            summary.steps += 1;
            let mut step = self.step(state, angle, shown, rates);
            step.time_s = read_s;
            if each(&step).is_break() {
                summary.cancelled = true;
                return Ok(summary);
            }
            next_s = (next_s + self.options.period_s).max(self.now_s());
            self.sleep(next_s - self.now_s())?;
        }
        Ok(summary)
    }

    /// The side of the pier on which a German mount hangs, where it has followed as far as it may there.
    fn ends_its_side(&self, angle: [f64; 2]) -> Option<PierSide> {
        let side = self.pier.filter(|_| self.is_german())?;
        let past_deg = pier::past_deg(self.true_side()?, angle[0]);
        let now_s = self.now_s();
        // A mount that chose its side at the meridian is not sent to and fro.
        let fresh = self.turned_s.is_some_and(|turned_s| now_s - turned_s < BACK.1);
        let margin_deg = if fresh { pier::margin_deg(BACK.0, angle[1]) } else { 0.0 };
        let stays = self.stays.is_some_and(|stays| {
            let again_deg = AGAIN_DEG[stays.times.min(AGAIN_DEG.len()) - 1];
            let went_deg = wrapped(angle[0] - stays.hour_angle_deg).abs();
            stays.side == side && went_deg < pier::margin_deg(again_deg, angle[1])
        });
        // It would be there when all is over.
        let is_over = now_s + self.turn_s() > self.path.seconds();
        let past = past_deg > self.options.past_meridian_deg + margin_deg;
        (past && !stays && !is_over).then_some(side)
    }

    /// Time that a turn over takes, s: both axes go half a circle at most.
    fn turn_s(&self) -> f64 {
        let rates = self.most_deg_s[0].min(self.most_deg_s[1]);
        let speed = self.options.slew_deg_s.unwrap_or(rates.max(SLEW_DEG_S));
        180.0 / speed.max(0.1) + TURN_ENDS_S
    }

    /// Whether what a mount does, where the target is past the meridian, looks like a turn over of its own: in two seconds it goes more than twice the target's way, and a degree.
    fn turns_by_itself(&self, error: &TrackError) -> bool {
        let TrackError::DoesNotFollow { moved_deg, .. } = error else { return false };
        let Some(side) = self.true_side().filter(|_| self.is_german()) else { return false };
        let now_s = self.now_s();
        let past_deg = pier::past_deg(side, self.target_deg(now_s, 0.0)[0]);
        let speed_deg_s = self.path.at(now_s).speed_rad_s().to_degrees();
        *moved_deg > 1.0 + 4.0 * speed_deg_s && past_deg > 0.0 && past_deg < LIMIT_DEG
    }

    /// The error; it names the mount's own limit where the mount stands where one may be.
    fn limit(&self, error: TrackError, [hour_angle, declination]: [f64; 2]) -> TrackError {
        let stands = matches!(error, TrackError::ByHand { what: STOPPED })
            || matches!(error, TrackError::DoesNotFollow { asked_deg, moved_deg } if moved_deg < asked_deg);
        if !stands || self.path.frame().axes != MountAxes::Equatorial {
            return error;
        }
        let past_deg = match self.true_side().filter(|_| self.is_german()) {
            Some(side) => pier::past_deg(side, hour_angle),
            // Not known: past the upper meridian, or the lower one, in the sense in which the target goes.
            None => {
                let at = |time_s: f64| angles(self.path.at(time_s).direction)[0];
                let now_s = self.now_s();
                let sense = wrapped(at(now_s + 1.0) - at(now_s)).signum();
                let lower = wrapped(hour_angle - 180.0);
                sense * if hour_angle.abs() < lower.abs() { hour_angle } else { lower }
            }
        };
        let early_deg = pier::margin_deg(0.5, declination);
        match past_deg > -early_deg && past_deg < LIMIT_DEG {
            true => TrackError::MeridianLimit { past_deg },
            false => error,
        }
    }

    /// Turns a German mount over, to where the target will be. False where `each` broke.
    fn turn_over(
        &mut self,
        side: PierSide,
        each: &mut dyn FnMut(&TrackStep) -> ControlFlow<()>,
    ) -> Result<bool, TrackError> {
        self.command([0.0; 2])?;
        // It is there before the target.
        let left_s = (self.path.seconds() - self.now_s()).max(0.0);
        let lead_s = self.turn_s().min(left_s);
        // What was learnt of the target's drift does not hold for so long.
        self.estimator.rest();
        if !self.slew(lead_s, each)? {
            return Ok(false);
        }
        // Some say the new side late.
        let until_s = self.now_s() + SAYS_SIDE_S;
        while self.pier == Some(side) && self.now_s() < until_s {
            self.sleep(self.options.period_s)?;
            let angle = self.read()?;
            let target = self.target_deg(self.now_s(), angle[0]);
            if each(&self.step(TrackState::Slewing, angle, target, [0.0; 2])).is_break() {
                return Ok(false);
            }
        }
        self.turned_s = Some(self.now_s());
        self.stays = match (self.pier == Some(side), self.readings.back()) {
            // It says that it can go on there.
            (true, Some((_, angle))) => {
                let before = self.stays.filter(|stays| stays.side == side);
                let times = before.map_or(1, |stays| stays.times + 1);
                Some(Stays { side, hour_angle_deg: angle[0], times })
            }
            _ => None,
        };
        self.learn()?;
        Ok(true)
    }

    /// Stops before the place comes near the Sun, and where it stays too low.
    fn check_ahead(&mut self, angle: [f64; 2]) -> Result<(), TrackError> {
        let frame = self.path.frame();
        let utc = self.clock.utc();
        self.guard.check_sun(frame.to_enu(direction(angle)), utc)?;
        let now_s = self.now_s();
        let is_low = |enu: DVec3| self.guard.check_low(enu, LOW.0);
        let mut low = is_low(frame.to_enu(direction(angle)));
        for ahead_s in [0.0, AHEAD_S] {
            let target = self.target((now_s + ahead_s).clamp(0.0, self.path.seconds()));
            let target = frame.to_enu(target);
            self.guard.check_sun(target, utc)?;
            low = low.and_then(|()| is_low(target));
        }
        // The mount itself, at the rates that it has.
        if let Some((_, rates)) = self.commands.back() {
            let coming = [0, 1].map(|i| angle[i] + rates[i] * AHEAD_S);
            let coming = frame.to_enu(direction(coming));
            self.guard.check_sun(coming, utc)?;
            low = low.and_then(|()| is_low(coming));
        }
        // Before the path begins it stands at its first place, which was allowed.
        let Err(danger) = low.or_else(|low| if now_s < 0.0 { Ok(()) } else { Err(low) }) else {
            self.low_s = None;
            return Ok(());
        };
        if let Some(from_s) = &mut self.search_from_s {
            // The target is not down there: the search begins anew in the middle, which is not low but where the mount itself is.
            *from_s = now_s;
        }
        match now_s - *self.low_s.get_or_insert(now_s) > LOW.1 {
            true => Err(danger.into()),
            false => Ok(()),
        }
    }

    /// Rates that bring the mount from where it will be to the target. Of a mount that has a few rates only they are those that come nearest to the target at the end of the period: it goes to and
    /// fro about it, between neighbouring rates, by half of what they differ by in a period.
    fn rates(&self, then: [f64; 2], target: [f64; 2], ahead: [f64; 2]) -> [f64; 2] {
        let abilities = self.mount.abilities();
        let steps = matches!(abilities.rates, MountRates::Discrete { .. });
        let gain_per_s =
            if steps { self.options.period_s.recip() } else { self.options.gain_per_s };
        [0, 1].map(|i| {
            let error = target[i] - then[i];
            let brakes = (2.0 * self.options.acceleration_deg_s2 * error.abs()).sqrt();
            let back = (gain_per_s * error.abs()).min(brakes);
            let rate =
                (ahead[i] + back.copysign(error)).clamp(-self.most_deg_s[i], self.most_deg_s[i]);
            if steps { abilities.taken_deg_s(i, rate) } else { rate }
        })
    }

    fn command(&mut self, rates: [f64; 2]) -> Result<(), TrackError> {
        let sent_s = self.now_s();
        match self.mount.set_rates(rates, &self.soon()) {
            Err(DeviceError::NotReady { device, reason }) => {
                // It may have turned over since it was read: the senses are learnt before the next command.
                self.read()?;
                return match self.pier != self.learnt {
                    true => Ok(()),
                    false => Err(DeviceError::NotReady { device, reason }.into()),
                };
            }
            Err(error @ DeviceError::Declined { .. }) => {
                // It goes on at the rates that it has.
                return match sent_s - *self.refused_s.get_or_insert(sent_s) > REFUSED_S {
                    true => Err(error.into()),
                    false => Ok(()),
                };
            }
            done => done?,
        }
        self.refused_s = None;
        self.commands.push_back((sent_s, rates));
        if self.commands.len() > 100 {
            self.commands.pop_front();
        }
        Ok(())
    }

    /// Does what a person asked for.
    fn obey(&mut self) {
        let Some(orders) = self.orders else { return };
        while let Some(order) = orders.next() {
            let before = (orders.keep_arcsec(), self.estimator.clone(), self.hold.clone());
            match order {
                _ if self.is_upside_down().is_none() => orders.refuse(NO_SIDE.to_owned()),
                Order::Keep { offset_arcsec } => orders.keep(offset_arcsec),
                // Both count in the frame.
                Order::Jog { arcsec } if self.holds_light() => {
                    let keep = orders.keep_arcsec();
                    orders.keep([0, 1].map(|i| keep[i] - arcsec[i]).into());
                }
                Order::Jog { arcsec } => {
                    let arcsec = arcsec.to_array();
                    self.shift(self.along_axes(arcsec).unwrap_or(arcsec));
                }
                Order::Lock { middle, offset_arcsec } => {
                    if let Err(why) = self.lock(middle, offset_arcsec.to_array()) {
                        orders.refuse(why);
                    }
                }
            }
            if let Err(why) = self.check_order(orders.keep_arcsec().to_array()) {
                orders.refuse(format!("not done: {why}"));
                orders.keep(before.0);
                (self.estimator, self.hold) = (before.1, before.2);
            }
        }
    }

    /// Whether the telescope may look where it is to look after a person's order: Sun, horizon and lowest altitude; and not so far beside the target that it would come
    /// below them with it.
    fn check_order(&self, keep: [f64; 2]) -> Result<(), String> {
        let beside = keep[0].hypot(keep[1]);
        if beside > FARTHEST_ARCSEC {
            let degrees = beside / 3600.0;
            return Err(format!("the target would be kept {degrees:.1}° beside, 2° at most"));
        }
        let (frame, now_s) = (self.path.frame(), self.now_s());
        [0.0, AHEAD_S].into_iter().try_for_each(|ahead_s| {
            let target = self.target((now_s + ahead_s).clamp(0.0, self.path.seconds()));
            let place = frame.to_enu(target);
            self.guard.check_place(place, self.clock.utc()).map_err(|danger| danger.to_string())
        })
    }

    /// Whether it follows the target's light, and not the prediction.
    fn holds_light(&self) -> bool {
        match &self.hold {
            Some(hold) => hold.locked,
            None => self.estimator.locked,
        }
    }

    /// The target is believed to be elsewhere by so much along the growing axes, arcsec.
    fn shift(&mut self, arcsec: [f64; 2]) {
        if let Some(hold) = &mut self.hold {
            return hold.shift(arcsec);
        }
        let now_s = self.now_s();
        let [first, second] = tangent(self.believed(now_s));
        let by = (first * arcsec[0] + second * arcsec[1]) / ARCSEC;
        let place = self.path.at(now_s + self.estimator.offset.along.value);
        self.estimator.shift(by, &place);
    }

    /// A light of a frame is the target.
    fn lock(&mut self, middle: Epoch, offset_arcsec: [f64; 2]) -> Result<(), String> {
        let (time_s, now_s) = (self.path.time_s(middle), self.now_s());
        if time_s > now_s + 1.0 {
            return Err("the frame's time lies ahead of the mount's".to_owned());
        }
        let Some(angle) = self.angles_then(time_s) else {
            let ago_s = now_s - time_s;
            return Err(format!(
                "where the mount stood {ago_s:.0} s ago, at the time of that frame, is not known any more: take a newer frame"
            ));
        };
        let offset_arcsec = self.along_axes(offset_arcsec).ok_or(NO_SIDE)?;
        let seen = seen_at(angle, &Spot { offset_arcsec: offset_arcsec.into(), flux: 0.0 });
        if self.hold.is_some() {
            let predicted = self.path.at(time_s).direction;
            let off = off_of(predicted, seen);
            if let Some(hold) = &mut self.hold {
                hold.lock(off, now_s);
            }
            return Ok(());
        }
        let place = self.path.at(time_s + self.estimator.offset.along.value);
        self.estimator.lock(seen, time_s, &place, now_s);
        self.search_from_s = None;
        Ok(())
    }

    /// Takes the finder's frame, if there is one, and says how things stand.
    fn look(&mut self, summary: &mut TrackSummary) -> Result<TrackState, TrackError> {
        let soon = self.soon();
        let Some(finder) = self.finder.as_mut().filter(|_| !self.options.open_loop && !self.misled)
        else {
            return Ok(TrackState::Predicted);
        };
        if let Some(mut frame) = finder.frame(&soon)? {
            let Some(is_upside_down) = self.is_upside_down() else {
                // Its frames would steer the wrong way on one of the sides.
                return Ok(TrackState::Predicted);
            };
            if is_upside_down {
                for spot in &mut frame.spots {
                    spot.offset_arcsec = spot.offset_arcsec.map(|arcsec| -arcsec);
                }
            }
            self.seen_arcsec = None;
            let time_s = self.path.time_s(frame.middle);
            if let (Some(angle), true) = (self.angles_then(time_s), self.hold.is_some()) {
                return Ok(self.look_at_star(&frame.spots, time_s, angle, summary));
            }
            if let Some(angle) = self.angles_then(time_s) {
                let spots: Vec<(DVec3, f64)> =
                    frame.spots.iter().map(|spot| (seen_at(angle, spot), spot.flux)).collect();
                let speed = self.path.at(time_s).speed_rad_s();
                self.estimator.advance(time_s, speed);
                let place = self.path.at(time_s + self.estimator.offset.along.value);
                let pole = match self.path.frame().axes {
                    MountAxes::Equatorial => DVec3::Z,
                    MountAxes::Horizontal => {
                        let (sin, cos) = self.path.frame().latitude_deg.to_radians().sin_cos();
                        DVec3::new(0.0, cos, sin)
                    }
                };
                // The stars turn about the pole, from east to west.
                let stars = -pole.cross(place.direction) * STARS_RAD_S;
                let against = (place.per_s - stars).length();
                // A change of the rates acts sooner or later than is believed, and is not there at once.
                let near_s = self.options.period_s;
                let changes = self.rate_range(time_s - near_s, time_s + near_s);
                let blur_arcsec = changes[0].hypot(changes[1]) * 3600.0 * ACTS_S;
                let found = self.estimator.learn(&spots, time_s, &place, against, blur_arcsec);
                if found == Found::Locked && summary.locked_s.is_none() {
                    summary.locked_s = Some(self.now_s());
                }
                if found == Found::Nothing {
                    self.empty = self.empty.saturating_add(1);
                } else {
                    summary.seen += 1;
                    let target = self.target(time_s);
                    self.seen_arcsec = Some(direction(angle).angle_between(target) * ARCSEC);
                }
            }
        }
        if self.is_upside_down().is_none() {
            return Ok(TrackState::Predicted);
        }
        let now_s = self.now_s();
        if let Some(hold) = &self.hold {
            return Ok(held(hold, now_s, self.options.estimator.frame_s));
        }
        if self.estimator.locked {
            self.search_from_s = None;
            let fresh = self
                .estimator
                .seen_s
                .is_some_and(|seen| now_s - seen < (3.0 * self.options.estimator.frame_s).max(0.5));
            return Ok(if fresh { TrackState::Locked } else { TrackState::Coasting });
        }
        // Where the field holds the doubt of the elements, the target is in it.
        let seen_nothing_s = (4.0 * self.options.estimator.frame_s).max(3.0);
        if now_s - summary.began_s > seen_nothing_s && self.empty >= EMPTY {
            self.search_from_s.get_or_insert(now_s);
        }
        Ok(TrackState::Searching)
    }

    /// Takes a finder's frame of a target that stands among the stars.
    fn look_at_star(
        &mut self,
        spots: &[Spot],
        time_s: f64,
        angle: [f64; 2],
        summary: &mut TrackSummary,
    ) -> TrackState {
        let now_s = self.now_s();
        let predicted = self.path.at(time_s).direction;
        let seen: Vec<([f64; 2], f64)> =
            spots.iter().map(|spot| (off_of(predicted, seen_at(angle, spot)), spot.flux)).collect();
        let Some(hold) = self.hold.as_mut() else { return TrackState::Predicted };
        let lights = spots.iter().map(|spot| (spot.offset_arcsec.to_array(), spot.flux));
        if self.sense.misleads(off_of(predicted, direction(angle)), lights) {
            self.misled = true;
            hold.forget();
            return TrackState::Predicted;
        }
        let found = hold.learn(&seen, time_s);
        let state = held(hold, now_s, self.options.estimator.frame_s);
        if found == Found::Locked && summary.locked_s.is_none() {
            summary.locked_s = Some(now_s);
        }
        if found != Found::Nothing {
            summary.seen += 1;
            let target = self.target(time_s);
            self.seen_arcsec = Some(direction(angle).angle_between(target) * ARCSEC);
        }
        state
    }

    /// How far apart the rates of each axis are that act within a time, deg/s; with the last one of before.
    fn rate_range(&self, from_s: f64, to_s: f64) -> [f64; 2] {
        let acts = |sent_s: f64| sent_s + self.options.latency_s;
        let first = self.commands.iter().rposition(|(sent_s, _)| acts(*sent_s) <= from_s);
        let acting = self.commands.iter().skip(first.unwrap_or(0));
        let acting = acting.take_while(|(sent_s, _)| acts(*sent_s) <= to_s);
        let ends = acting.fold([[f64::INFINITY, f64::NEG_INFINITY]; 2], |ends, (_, rates)| {
            [0, 1].map(|i| [ends[i][0].min(rates[i]), ends[i][1].max(rates[i])])
        });
        ends.map(|[least, most]| (most - least).max(0.0))
    }

    /// Holds what the mount did in two seconds against what it was told.
    fn check_follows(
        &self,
        check: &mut Option<(f64, [f64; 2])>,
        read_s: f64,
        angle: [f64; 2],
    ) -> Result<(), TrackError> {
        let Some((from_s, from)) = *check else {
            *check = Some((read_s, angle));
            return Ok(());
        };
        if read_s - from_s < 2.0 {
            return Ok(());
        }
        *check = Some((read_s, angle));
        let told = self.carried(from_s, from, read_s);
        let length = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
        let (asked_deg, moved_deg, off) =
            (length(told, from), length(angle, from), length(angle, told));
        // A change of the rate by v takes v²/2a of the way, as where the search turns round. Lost commands and a flip of the rates cost some, too: half of the way, and a tenth
        // of a degree, is a fault.
        let changes = self.rate_range(from_s - 1.0, f64::INFINITY).map(|range| range * range);
        let turns_deg = 0.5 * changes[0].hypot(changes[1]) / self.options.acceleration_deg_s2;
        if off > 0.5 * asked_deg.max(moved_deg) + 0.1 + turns_deg {
            return Err(TrackError::DoesNotFollow { asked_deg, moved_deg });
        }
        Ok(())
    }
}

impl From<DeviceError> for TrackError {
    /// Signs, in a mount's answers, that somebody else moves it, are told as such.
    fn from(error: DeviceError) -> Self {
        match error {
            DeviceError::Taken { what, .. } => Self::ByHand { what },
            error => Self::Device(error),
        }
    }
}

/// Whether a path's target stands among the stars.
fn among_stars(path: &TargetPath) -> bool {
    let frame = path.frame();
    let (sin, cos) = frame.latitude_deg.to_radians().sin_cos();
    let pole = frame.of_enu(DVec3::new(0.0, cos, sin));
    let place = path.at(0.5 * path.seconds());
    (place.per_s + pole.cross(place.direction) * STARS_RAD_S).length() < AMONG_STARS_RAD_S
}

/// State of a tracker that holds a star.
fn held(hold: &Hold, now_s: f64, frame_s: f64) -> TrackState {
    // Exposures of stars are long.
    let fresh_s = (3.0 * frame_s).max(10.0);
    match (hold.locked, hold.seen_s.is_some_and(|seen| now_s - seen < fresh_s)) {
        (true, true) => TrackState::Locked,
        (true, false) => TrackState::Coasting,
        _ => TrackState::Searching,
    }
}

/// Directions of growing first and second angle at a direction.
pub(super) fn tangent(at: DVec3) -> [DVec3; 2] {
    let flat = at.x.hypot(at.y).max(1e-9);
    let first = DVec3::new(at.y / flat, -at.x / flat, 0.0);
    [first, first.cross(at)]
}

/// A direction that is displaced along the growing axes, arcsec.
pub(super) fn shifted(at: DVec3, off: [f64; 2]) -> DVec3 {
    let [first, second] = tangent(at);
    (at + (first * off[0] + second * off[1]) / ARCSEC).normalize()
}

/// Offset of a direction from another along the growing axes, arcsec.
pub(super) fn off_of(at: DVec3, seen: DVec3) -> [f64; 2] {
    let [first, second] = tangent(at);
    [seen.dot(first) * ARCSEC, seen.dot(second) * ARCSEC]
}

/// Direction of a spot in the axes of a mount that stands at two angles.
fn seen_at(angle_deg: [f64; 2], spot: &Spot) -> DVec3 {
    let (sin1, cos1) = angle_deg[0].to_radians().sin_cos();
    let (sin2, cos2) = angle_deg[1].to_radians().sin_cos();
    let middle = DVec3::new(cos2 * sin1, cos2 * cos1, sin2);
    let first = DVec3::new(cos1, -sin1, 0.0);
    let second = DVec3::new(-sin2 * sin1, -sin2 * cos1, cos2);
    let [x, y] = spot.offset_arcsec.to_array().map(|offset| offset / ARCSEC);
    (middle + x * first + y * second).normalize()
}
