//! Telescope with known truth: a mount with motors, gears and an axis that is not quite where it should be, and a finder that sees what it points at.
//!
//! Nothing here is taken from a tracker: the mount is two motors on a time grid of milliseconds, and the camera projects directions onto the tube's own axes.
//! The sky is a function of time that the caller gives.

use glam::{DMat3, DVec2, DVec3};
use hifitime::{Epoch, Unit};
use rand::{RngExt as _, SeedableRng as _};
use rand_distr::{Distribution as _, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::collections::VecDeque;
use std::f64::consts::FRAC_PI_2;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use sunglint_drivers::clock::{Deadline, DeviceClock};
use sunglint_drivers::device::{
    Device, DeviceError, Finder, FinderFrame, Identity, Mount, MountAbilities, MountAxes,
    MountClock, MountKnown, MountMotion, MountPlace, MountRates, MountReading, MountSite,
    MountTime, Origin, PierSide, Setting, Spot, Value,
};
use sunglint_numerics::measured::{Interval, Measured};

const DEVICE: &str = "virtual mount";
/// One second of arc, rad.
const ARCSEC_RAD: f64 = std::f64::consts::PI / 648_000.0;
/// Step of the motors' motion, s.
const STEP_S: f64 = 0.005;
/// Turn of the Earth, rad/s.
const EARTH_RAD_S: f64 = 7.292_115_855e-5;

/// Makings of a virtual telescope.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct TelescopeOptions {
    /// The axes.
    pub axes: MountAxes,
    /// Site: geodetic latitude and longitude (east), deg.
    pub site_deg: [f64; 2],
    /// A German mount, which stands still this far past the meridian, deg of hour angle: it turns over where a goto ends on the other side, and its tube and
    /// camera are upside down west of the pier. `None` of a fork. Only with equatorial axes.
    pub past_meridian_deg: Option<f64>,
    /// A German mount that turns over by itself where it would stand still.
    pub turns_itself: bool,
    /// Whether it says that it follows while it turns over by itself, and passes over the rates that it is told meanwhile. Otherwise it says that it slews, and rates end that.
    pub hides_turn: bool,
    /// A German mount that says east where others say west.
    pub swaps_names: bool,
    /// A fork that says the side of a pier which its driver makes up from the hour angle; only with equatorial axes.
    pub makes_sides_up: bool,
    /// Time by which its own clock is ahead of UTC, s.
    pub clock_off_s: f64,
    /// Fastest rate of both axes, deg/s.
    pub fastest_deg_s: f64,
    /// Rates other than none that it takes, deg/s, from the slowest; all of them where there are none here.
    pub steps_deg_s: Vec<f64>,
    /// Strongest acceleration, deg/s².
    pub acceleration_deg_s2: f64,
    /// Time constant of a motor, s.
    pub motor_s: f64,
    /// Backlash of each gear, arcsec.
    pub backlash_arcsec: f64,
    /// Amplitude of the worm's periodic error, arcsec.
    pub periodic_arcsec: f64,
    /// Turn of an axis in which that error repeats, deg.
    pub worm_deg: f64,
    /// Noise of an encoder's reading, arcsec.
    pub encoder_arcsec: f64,
    /// Tilt of the first axis, arcsec.
    pub tilt_arcsec: f64,
    /// Shaking by the wind, arcsec rms on each axis, with a memory of a second.
    pub wind_arcsec: f64,
    /// Time from a command to its effect, s, and its jitter (1 σ).
    pub latency_s: Measured,
    /// Part of the commands that are lost.
    pub dropped: f64,
    /// Half the width of the finder's field, deg.
    pub field_deg: f64,
    /// Seeing (full width at half maximum), arcsec: of it a centroid keeps a fifth on each axis.
    pub seeing_arcsec: f64,
    /// Time between two frames of the finder, s.
    pub frame_s: f64,
    /// Error of a centroid beside the seeing, arcsec.
    pub centroid_arcsec: f64,
    /// Part of the frames that are lost.
    pub lost_frames: f64,
    /// Spans without sight (cloud), seconds from the start.
    pub clouds_s: Vec<Interval>,
    /// Stars of the field for each square degree, and their brightness against the target's.
    pub stars: (f64, f64),
    /// Seed of everything random.
    pub seed: u64,
}

impl Default for TelescopeOptions {
    fn default() -> Self {
        Self {
            axes: MountAxes::Horizontal,
            site_deg: [48.78, 9.18],
            past_meridian_deg: None,
            turns_itself: false,
            hides_turn: false,
            swaps_names: false,
            makes_sides_up: false,
            clock_off_s: 0.0,
            fastest_deg_s: 10.0,
            steps_deg_s: Vec::new(),
            acceleration_deg_s2: 10.0,
            motor_s: 0.05,
            backlash_arcsec: 10.0,
            periodic_arcsec: 2.0,
            worm_deg: 2.0,
            encoder_arcsec: 0.3,
            tilt_arcsec: 60.0,
            wind_arcsec: 0.6,
            latency_s: Measured::new(0.2, 0.02),
            dropped: 0.0,
            field_deg: 2.0,
            seeing_arcsec: 2.0,
            frame_s: 0.1,
            centroid_arcsec: 0.15,
            lost_frames: 0.0,
            clouds_s: Vec::new(),
            stars: (0.0, 1.0),
            seed: 0,
        }
    }
}

impl TelescopeOptions {
    /// Angles of the first motor of a German mount, rad.
    fn span_rad(&self) -> Option<[f64; 2]> {
        let past = self.past_meridian_deg.filter(|_| self.axes == MountAxes::Equatorial)?;
        let past = past.to_radians();
        Some([-past, std::f64::consts::PI + past])
    }

    /// Turn of the second motor over the elevated pole to the same declination on the other side, less twice that declination: half a circle, rad.
    fn over_rad(&self) -> f64 {
        std::f64::consts::PI.copysign(self.site_deg[0])
    }

    /// Sets each option by what a closure does to the defaults.
    #[must_use]
    pub fn with(mut self, set: impl FnOnce(&mut Self)) -> Self {
        set(&mut self);
        self
    }
}

/// Direction of the target at an epoch, in east, north, up of the site; `None` where it gives no light.
pub type TargetSky = Arc<dyn Fn(Epoch) -> Option<DVec3> + Send + Sync>;

/// One motor with its gear.
#[derive(Debug, Clone, Copy, Default)]
struct Motor {
    /// Where the motor's side of the gear stands, rad; what its encoder counts.
    angle: f64,
    /// Speed, rad/s.
    speed: f64,
    /// Where the axis itself stands within the play of the gear, rad.
    axis: f64,
    /// The shaking, rad.
    wind: f64,
    /// Rate that was commanded, rad/s, or place to go to.
    rate: f64,
    goal: Option<f64>,
}

/// State shared by the mount and its finder.
struct Tube {
    options: TelescopeOptions,
    clock: DeviceClock,
    start: Epoch,
    sky: TargetSky,
    motors: [Motor; 2],
    /// Time up to which the motors have moved, s from the start.
    now_s: f64,
    queue: VecDeque<(f64, Command)>,
    following_stars: bool,
    parked: bool,
    /// Whether it turns over by itself now.
    own_turn: bool,
    /// Whether a German mount ran into an end of its first axis.
    hit_end: bool,
    wobble: DMat3,
    random: Xoshiro256PlusPlus,
    /// Truth: where the tube pointed at the middle of each frame, and the target's offset, arcsec.
    truth: Vec<TruthRow>,
    next_frame_s: f64,
    frames: VecDeque<(f64, FinderFrame)>,
    /// Stars, each with its number, by the height above the equator of their own frame.
    stars: Vec<(usize, DVec3)>,
    /// Where the axes stood, s from the start and rad, where that is kept.
    history: Option<VecDeque<(f64, [f64; 2])>>,
}

/// Time between two places of the history, s, and how far it goes back, places: an hour.
const HISTORY_S: f64 = 0.02;
const HISTORY: usize = 185_000;

#[derive(Debug, Clone, Copy)]
enum Command {
    Rates([f64; 2]),
    Goto([f64; 2], bool),
    Stop,
}

/// Truth at the middle of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TruthRow {
    /// Seconds from the start.
    pub time_s: f64,
    /// Distance of the target from the tube's axis, arcsec.
    pub off_arcsec: f64,
    /// Where the tube pointed, in east, north, up.
    pub pointing: DVec3,
    /// Whether the target gave light.
    pub lit: bool,
}

/// Handle to a virtual telescope.
#[derive(Clone)]
pub struct Telescope(Arc<Mutex<Tube>>);

/// The mount of a virtual telescope.
pub struct VirtualMount {
    tube: Telescope,
    abilities: MountAbilities,
    /// Whether the tube hung west of its pier when the senses were learnt. A German mount's second motor turns the other way on the other side.
    learnt: Option<bool>,
}

/// The finder of a virtual telescope.
pub struct VirtualFinder {
    tube: Telescope,
}

impl std::fmt::Debug for Telescope {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Telescope").finish_non_exhaustive()
    }
}

impl Telescope {
    /// A telescope that points north at 45° altitude (or at the meridian and the equator) when its clock begins.
    pub fn new(options: TelescopeOptions, clock: DeviceClock, sky: TargetSky) -> Self {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(options.seed);
        let tilt = options.tilt_arcsec * ARCSEC_RAD;
        let towards = random.random::<f64>() * std::f64::consts::TAU;
        // The first axis leans over; the frame turns with it.
        let wobble = DMat3::from_axis_angle(DVec3::new(towards.cos(), towards.sin(), 0.0), tilt);
        let mut motors = [Motor::default(); 2];
        if options.axes == MountAxes::Horizontal {
            motors[1].angle = std::f64::consts::FRAC_PI_4;
            motors[1].axis = motors[1].angle;
        }
        let count = (options.stars.0 * 41_253.0).min(2e6) as usize;
        let mut stars: Vec<(usize, DVec3)> = (0..count)
            .map(|number| {
                let z = 2.0 * random.random::<f64>() - 1.0;
                let turn = random.random::<f64>() * std::f64::consts::TAU;
                let flat = (1.0 - z * z).sqrt();
                (number, DVec3::new(flat * turn.cos(), flat * turn.sin(), z))
            })
            .collect();
        stars.sort_by(|a, b| a.1.z.total_cmp(&b.1.z));
        let start = clock.utc();
        Self(Arc::new(Mutex::new(Tube {
            options,
            clock,
            start,
            sky,
            motors,
            now_s: 0.0,
            queue: VecDeque::new(),
            following_stars: false,
            parked: false,
            own_turn: false,
            hit_end: false,
            wobble,
            random,
            truth: Vec::new(),
            next_frame_s: 0.0,
            frames: VecDeque::new(),
            stars,
            history: None,
        })))
    }

    fn lock(&self) -> MutexGuard<'_, Tube> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The mount.
    pub fn mount(&self) -> VirtualMount {
        let tube = self.lock();
        let most = tube.options.fastest_deg_s;
        let rates = match tube.options.steps_deg_s.as_slice() {
            [] => MountRates::Continuous { most_deg_s: [most, most].into() },
            steps => MountRates::Discrete { deg_s: steps.to_vec() },
        };
        let mut abilities = MountAbilities::new(tube.options.axes, rates);
        abilities.parks = true;
        abilities.tells_pier_side = tube.side().is_some();
        abilities.is_fork = !abilities.tells_pier_side;
        abilities.tells_tracking = tube.options.axes == MountAxes::Equatorial;
        drop(tube);
        VirtualMount { tube: self.clone(), abilities, learnt: None }
    }

    /// The finder.
    pub fn finder(&self) -> VirtualFinder {
        VirtualFinder { tube: self.clone() }
    }

    /// Truth of all frames so far.
    pub fn truth(&self) -> Vec<TruthRow> {
        self.lock().truth.clone()
    }

    /// The telescope, which remembers for an hour where it pointed.
    #[must_use]
    pub fn with_history(self) -> Self {
        self.lock().history = Some(VecDeque::new());
        self
    }

    /// Whether a German mount ran into an end of its first axis.
    pub fn hit_end(&self) -> bool {
        self.lock().hit_end
    }

    /// Moves the motors on to the clock's time.
    pub fn advance(&self) {
        self.lock().advance();
    }

    /// The tube's directions in east, north, up at a time, s from the start: to the right of it (growing first angle), up (growing second), ahead. `None` where that is not remembered.
    pub fn axes_at(&self, time_s: f64) -> Option<DMat3> {
        let tube = self.lock();
        let history = tube.history.as_ref()?;
        let after = history.partition_point(|(at, _)| *at <= time_s);
        let (last_s, last) = *history.get(after.checked_sub(1)?)?;
        // Beyond the last place the motors' own, with their speed for the part of a step that is left.
        let (next_s, next) = match history.get(after) {
            Some((next_s, next)) => (*next_s, *next),
            None => {
                let left_s = (time_s - tube.now_s).max(0.0);
                let now = tube.true_angles();
                let angle = [0, 1].map(|i| now[i] + tube.motors[i].speed * left_s);
                (tube.now_s.max(time_s), angle)
            }
        };
        let part = if next_s > last_s { (time_s - last_s) / (next_s - last_s) } else { 1.0 };
        let angle = [0, 1].map(|i| last[i] + part * (next[i] - last[i]));
        Some(tube.axes(angle))
    }

    /// Moment from which its seconds count.
    pub fn start(&self) -> Epoch {
        self.lock().start
    }
}

impl Tube {
    fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.random)
    }

    /// The matrix whose columns are the tube's directions: to the right of it (growing first angle), up (growing second), ahead.
    fn axes(&self, angle: [f64; 2]) -> DMat3 {
        // Seen from outside, azimuth turns clockwise about the vertical: x east, y north, z up.
        let turn = DMat3::from_rotation_z(-angle[0]);
        let lift = DMat3::from_rotation_x(angle[1]);
        let body = turn * lift;
        let (right, ahead, up) = (body.x_axis, body.y_axis, body.z_axis);
        let to_sky = self.to_sky() * self.wobble;
        DMat3::from_cols(to_sky * right, to_sky * up, to_sky * ahead)
    }

    /// From the mount's base to east, north, up: an equatorial base leans with the pole, its first angle counts from the meridian to the west.
    fn to_sky(&self) -> DMat3 {
        match self.options.axes {
            MountAxes::Horizontal => DMat3::IDENTITY,
            MountAxes::Equatorial => {
                let latitude = self.options.site_deg[0].to_radians();
                let (sin, cos) = latitude.sin_cos();
                // Base axes: x the west, y the equator's point on the meridian, z the pole.
                DMat3::from_cols(
                    DVec3::new(-1.0, 0.0, 0.0),
                    DVec3::new(0.0, -sin, cos),
                    DVec3::new(0.0, cos, sin),
                )
            }
        }
    }

    /// Where the axes point, errors included, rad.
    fn true_angles(&self) -> [f64; 2] {
        [0, 1].map(|i| {
            let motor = &self.motors[i];
            let worm = std::f64::consts::TAU * motor.angle / self.options.worm_deg.to_radians();
            motor.axis + self.options.periodic_arcsec * ARCSEC_RAD * worm.sin() + motor.wind
        })
    }

    /// Moves on to the clock's time.
    fn advance(&mut self) {
        let until_s = (self.clock.utc() - self.start).to_seconds();
        while self.now_s + STEP_S <= until_s + 1e-9 {
            if let Some(history) = &self.history
                && history.back().is_none_or(|(at, _)| self.now_s >= at + HISTORY_S - 1e-9)
            {
                let place = (self.now_s, self.true_angles());
                if let Some(history) = &mut self.history {
                    history.push_back(place);
                    while history.len() > HISTORY {
                        history.pop_front();
                    }
                }
            }
            self.one_step();
            self.now_s += STEP_S;
            if self.now_s + 1e-9 >= self.next_frame_s {
                self.expose();
                self.next_frame_s += self.options.frame_s;
            }
        }
    }

    fn one_step(&mut self) {
        while let Some((at, _)) = self.queue.front()
            && *at <= self.now_s
        {
            let Some((_, command)) = self.queue.pop_front() else { break };
            match command {
                Command::Rates(_) if self.own_turn && self.options.hides_turn => {}
                Command::Rates(rates) => {
                    (self.following_stars, self.own_turn) = (false, false);
                    for (motor, rate) in self.motors.iter_mut().zip(rates) {
                        (motor.rate, motor.goal) = (rate, None);
                    }
                }
                Command::Goto(goal, stars) => {
                    (self.following_stars, self.own_turn) = (stars, false);
                    for (motor, goal) in self.motors.iter_mut().zip(goal) {
                        motor.goal = Some(goal);
                    }
                }
                Command::Stop => {
                    (self.following_stars, self.own_turn) = (false, false);
                    for motor in &mut self.motors {
                        (motor.rate, motor.goal) = (0.0, None);
                    }
                }
            }
        }
        let shake = [self.normal(), self.normal()];
        let options = &self.options;
        let fastest = options.fastest_deg_s.to_radians();
        let strongest = options.acceleration_deg_s2.to_radians();
        let play = options.backlash_arcsec * ARCSEC_RAD;
        let (motor_s, wind) = (options.motor_s, options.wind_arcsec * ARCSEC_RAD);
        let span = options.span_rad();
        if let Some([least, most]) = span.filter(|_| options.turns_itself && !self.own_turn)
            && !(least..=most).contains(&self.motors[0].angle)
        {
            // The same direction on the other side.
            let half = std::f64::consts::PI;
            let [first, second] = self.motors.map(|motor| motor.angle);
            let first = if first > most { first - half } else { first + half };
            (self.own_turn, self.following_stars) = (true, true);
            let second = options.over_rad() - second;
            (self.motors[0].goal, self.motors[1].goal) = (Some(first), Some(second));
        }
        let options = &self.options;
        self.own_turn &= self.motors.iter().any(|motor| motor.goal.is_some());
        let turns = options.turns_itself;
        for (i, motor) in self.motors.iter_mut().enumerate() {
            let mut wanted = motor.rate;
            if let Some(goal) = motor.goal {
                let left = goal - motor.angle;
                if left.abs() < 2.0 * ARCSEC_RAD && motor.speed.abs() < 1e-4 {
                    motor.goal = None;
                    motor.rate = 0.0;
                    wanted = 0.0;
                } else {
                    let brake = (1.2 * strongest * left.abs()).sqrt();
                    wanted = brake.min(4.0 * left.abs()).min(fastest).copysign(left);
                }
            } else if self.following_stars && i == 0 {
                wanted = EARTH_RAD_S;
            }
            let wanted = wanted.clamp(-fastest, fastest);
            let pull = ((wanted - motor.speed) / motor_s.max(STEP_S)).clamp(-strongest, strongest);
            let before = motor.speed;
            motor.speed += pull * STEP_S;
            motor.angle += 0.5 * (before + motor.speed) * STEP_S;
            if let (0, false, Some([least, most])) = (i, turns, span)
                && !(least..=most).contains(&motor.angle)
            {
                // The switches at the ends.
                motor.angle = motor.angle.clamp(least, most);
                (motor.speed, motor.rate, motor.goal) = (0.0, 0.0, None);
                self.following_stars = false;
                self.hit_end = true;
            }
            // The axis is pushed along by either flank of the gear.
            motor.axis = motor.axis.clamp(motor.angle - play, motor.angle);
            let memory = (-STEP_S / 1.0_f64).exp();
            motor.wind = motor.wind * memory + wind * (1.0 - memory * memory).sqrt() * shake[i];
        }
    }

    /// Takes a frame whose middle is now; it is there after a frame's time.
    fn expose(&mut self) {
        let angle = self.true_angles();
        let axes = self.axes(angle);
        let (right, up, ahead) = (axes.x_axis, axes.y_axis, axes.z_axis);
        let middle = self.start + self.now_s * Unit::Second;
        let target = (self.sky)(middle);
        let lit = target.is_some();
        if let Some(target) = target {
            let off = ahead.cross(target).length().atan2(ahead.dot(target)) / ARCSEC_RAD;
            self.truth.push(TruthRow { time_s: self.now_s, off_arcsec: off, pointing: ahead, lit });
        }
        let cloudy = self.options.clouds_s.iter().any(|c| (c.low..c.high).contains(&self.now_s));
        let lost = self.random.random::<f64>() < self.options.lost_frames;
        if lost {
            return;
        }
        let sigma = (0.21 * self.options.seeing_arcsec).hypot(self.options.centroid_arcsec);
        let half = self.options.field_deg.to_radians().tan();
        let mut lights: Vec<(DVec3, f64)> = Vec::new();
        if !cloudy {
            lights.extend(target.map(|target| (target, 1.0)));
            let turn = DMat3::from_axis_angle(self.pole(), -EARTH_RAD_S * self.now_s);
            let flux = self.options.stars.1;
            let near = (1.5 * half).atan();
            let base = turn.transpose() * ahead;
            // Only a zone about the pole of the stars is looked through; what is found keeps the order in which it was drawn.
            let up = base.z.clamp(-1.0, 1.0).asin();
            let edge = |by: f64| (up + by).clamp(-FRAC_PI_2, FRAC_PI_2).sin() + by.signum() * 1e-9;
            let from = self.stars.partition_point(|(_, star)| star.z < edge(-near));
            let to = self.stars.partition_point(|(_, star)| star.z <= edge(near));
            let mut found: Vec<_> = self.stars[from..to]
                .iter()
                .filter(|(_, star)| star.dot(base) > near.cos())
                .collect();
            found.sort_by_key(|(number, _)| *number);
            lights.extend(found.into_iter().map(|(_, star)| (turn * *star, flux)));
        }
        let mut spots: Vec<Spot> = Vec::new();
        for (light, flux) in lights {
            let depth = light.dot(ahead);
            let (x, y) = (light.dot(right) / depth, light.dot(up) / depth);
            if depth <= 0.0 || x.abs() > half || y.abs() > half {
                continue;
            }
            let noise = [self.normal(), self.normal()];
            let offset_arcsec =
                DVec2::new(x / ARCSEC_RAD + sigma * noise[0], y / ARCSEC_RAD + sigma * noise[1]);
            // Two lights closer than the seeing are one, between them.
            let seeing_arcsec = self.options.seeing_arcsec;
            match spots
                .iter_mut()
                .find(|spot| spot.offset_arcsec.distance(offset_arcsec) < 1.5 * seeing_arcsec)
            {
                Some(spot) => {
                    let whole = spot.flux + flux;
                    let sum = spot.offset_arcsec * spot.flux + offset_arcsec * flux;
                    spot.offset_arcsec = sum / whole;
                    spot.flux = whole;
                }
                None => spots.push(Spot { offset_arcsec, flux }),
            }
        }
        spots.sort_by(|a, b| b.flux.total_cmp(&a.flux));
        let ready_s = self.now_s + self.options.frame_s;
        self.frames.push_back((ready_s, FinderFrame { middle, spots }));
        if self.frames.len() > 100 {
            self.frames.pop_front();
        }
    }

    fn pole(&self) -> DVec3 {
        let (sin, cos) = self.options.site_deg[0].to_radians().sin_cos();
        DVec3::new(0.0, cos, sin)
    }

    fn send(&mut self, command: Command) {
        let jitter = self.normal();
        let lost = self.random.random::<f64>() < self.options.dropped;
        if lost && matches!(command, Command::Rates(_)) {
            return;
        }
        let [latency, sigma] = self.options.latency_s.to_array();
        let at = self.now_s + (latency + sigma * jitter).max(0.0);
        // A command does not overtake the one before.
        let at = self.queue.back().map_or(at, |(last, _)| at.max(*last));
        self.queue.push_back((at, command));
    }

    /// Greenwich sidereal time by the Almanac's linear formula, and the longitude, rad: for a mount that speaks of right ascension.
    fn sidereal(&self) -> f64 {
        let days = self.clock.utc().to_mjd_utc_days() - 51_544.5;
        let right = 280.460_618_37 + 360.985_647_366_29 * days + self.options.site_deg[1];
        right.to_radians() + self.options.clock_off_s * EARTH_RAD_S
    }

    /// Whether the tube of a German mount hangs west of its pier: beyond the elevated pole of the second axis.
    fn is_turned(&self) -> bool {
        let towards_pole = self.motors[1].angle * self.options.over_rad().signum();
        self.options.span_rad().is_some() && towards_pole > std::f64::consts::FRAC_PI_2
    }

    /// Side of the pier that it says.
    fn side(&self) -> Option<PierSide> {
        if self.options.makes_sides_up && self.options.axes == MountAxes::Equatorial {
            let half = std::f64::consts::PI;
            let hour_angle = (self.motors[0].angle + half).rem_euclid(2.0 * half) - half;
            return Some(if hour_angle < 0.0 { PierSide::West } else { PierSide::East });
        }
        self.options.span_rad()?;
        let west = self.is_turned() != self.options.swaps_names;
        Some(if west { PierSide::West } else { PierSide::East })
    }

    fn moving(&self) -> bool {
        if self.own_turn && self.options.hides_turn {
            return false;
        }
        self.motors.iter().any(|motor| motor.goal.is_some())
            || self.queue.iter().any(|(_, command)| matches!(command, Command::Goto(..)))
    }
}

impl Device for VirtualMount {
    fn identity(&mut self, _: &Deadline) -> Result<Identity, DeviceError> {
        Ok(Identity {
            vendor: "sunglint".into(),
            model: "virtual telescope".into(),
            serial: None,
            firmware: None,
            driver: "virtual",
        })
    }

    fn settings(&mut self, _: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let most = self.tube.lock().options.fastest_deg_s;
        let origin = Origin::Configured;
        Ok(vec![Setting { name: "most_rate_deg_s", value: Value::Number(most), origin }])
    }
}

impl Mount for VirtualMount {
    fn abilities(&self) -> &MountAbilities {
        &self.abilities
    }

    fn know(&mut self, known: &MountKnown) {
        self.abilities.know(known);
    }

    fn reading(&mut self, _: &Deadline) -> Result<MountReading, DeviceError> {
        let mut tube = self.tube.lock();
        tube.advance();
        let noise = tube.options.encoder_arcsec * ARCSEC_RAD;
        let noise = [noise * tube.normal(), noise * tube.normal()];
        let mut angle = [0, 1].map(|i| tube.motors[i].angle + noise[i]);
        if tube.is_turned() {
            angle = [angle[0] - std::f64::consts::PI, tube.options.over_rad() - angle[1]];
        }
        // The motors stand at their last step, not at the clock's time.
        let utc = tube.start + tube.now_s * Unit::Second;
        let place = match tube.options.axes {
            MountAxes::Horizontal => MountPlace::Horizontal {
                azimuth_deg: angle[0].to_degrees().rem_euclid(360.0),
                altitude_deg: angle[1].to_degrees(),
            },
            MountAxes::Equatorial => {
                let late = (tube.clock.utc() - utc).to_seconds() * EARTH_RAD_S;
                let ra = tube.sidereal() - late - angle[0];
                MountPlace::Equatorial {
                    ra_deg: ra.to_degrees().rem_euclid(360.0),
                    dec_deg: angle[1].to_degrees(),
                }
            }
        };
        let motion = if tube.parked {
            MountMotion::Parked
        } else if tube.moving() {
            MountMotion::Slewing
        } else if tube.following_stars || tube.motors.iter().any(|motor| motor.rate != 0.0) {
            MountMotion::Tracking
        } else {
            MountMotion::Still
        };
        let pier = tube.side();
        Ok(MountReading { utc, place, pier, motion })
    }

    fn begin_goto(&mut self, place: MountPlace, _: &Deadline) -> Result<(), DeviceError> {
        let mut tube = self.tube.lock();
        tube.advance();
        if tube.parked {
            return Err(DeviceError::NotReady {
                device: DEVICE,
                reason: "it is parked: unpark it first",
            });
        }
        let goal = match (place, tube.options.axes) {
            (MountPlace::Horizontal { azimuth_deg, altitude_deg }, MountAxes::Horizontal) => {
                [azimuth_deg.to_radians(), altitude_deg.to_radians()]
            }
            (MountPlace::Equatorial { ra_deg, dec_deg }, MountAxes::Equatorial) => {
                [tube.sidereal() - ra_deg.to_radians(), dec_deg.to_radians()]
            }
            _ => {
                let reason = "it takes places in its own axes only";
                return Err(DeviceError::NotReady { device: DEVICE, reason });
            }
        };
        let now = tube.motors[0].angle;
        let turn = std::f64::consts::TAU;
        let half = turn / 2.0;
        let mut goal = goal;
        let mut first = now + (goal[0] - now + half).rem_euclid(turn) - half;
        if tube.options.span_rad().is_some() {
            // Hour angle from the east by the south to the west.
            let hour_angle = (goal[0] + half).rem_euclid(turn) - half;
            (first, goal[1]) = match hour_angle < 0.0 {
                true => (hour_angle + half, tube.options.over_rad() - goal[1]),
                false => (hour_angle, goal[1]),
            };
        }
        let stars = tube.options.axes == MountAxes::Equatorial;
        tube.send(Command::Goto([first, goal[1]], stars));
        Ok(())
    }

    fn sync(&mut self, _: MountPlace, _: &Deadline) -> Result<(), DeviceError> {
        Err(DeviceError::NotReady { device: DEVICE, reason: "it cannot be told where it points" })
    }

    fn set_tracking(&mut self, on: bool, _: &Deadline) -> Result<(), DeviceError> {
        let mut tube = self.tube.lock();
        tube.advance();
        let rate = if on && tube.options.axes == MountAxes::Equatorial { EARTH_RAD_S } else { 0.0 };
        tube.send(Command::Rates([rate, 0.0]));
        Ok(())
    }

    fn learn_senses(&mut self, _: &dyn Fn(), _: &Deadline) -> Result<(), DeviceError> {
        let mut tube = self.tube.lock();
        tube.advance();
        self.learnt = Some(tube.is_turned());
        Ok(())
    }

    fn set_rates(&mut self, deg_s: [f64; 2], _: &Deadline) -> Result<(), DeviceError> {
        let mut tube = self.tube.lock();
        tube.advance();
        if tube.parked {
            return Err(DeviceError::NotReady {
                device: DEVICE,
                reason: "it is parked: unpark it first",
            });
        }
        let steps = &tube.options.steps_deg_s;
        let has = |rate: &f64| *rate == 0.0 || steps.iter().any(|step| *step == rate.abs());
        if let Some(asked) = deg_s.iter().copied().find(|rate| !steps.is_empty() && !has(rate)) {
            let most = steps.last().copied().unwrap_or_default();
            return Err(DeviceError::OutOfRange { name: "rate, deg/s", asked, least: -most, most });
        }
        // Stricter than it must be: not even rates of zero.
        let is_german = tube.options.span_rad().is_some();
        if is_german && self.learnt != Some(tube.is_turned()) {
            let reason = "the sense of its second axis is not known on this side of the pier: learn it after a goto";
            return Err(DeviceError::NotReady { device: DEVICE, reason });
        }
        let sense = if tube.is_turned() { -1.0 } else { 1.0 };
        tube.send(Command::Rates([deg_s[0].to_radians(), sense * deg_s[1].to_radians()]));
        Ok(())
    }

    fn stop(&mut self, _: &Deadline) -> Result<(), DeviceError> {
        let mut tube = self.tube.lock();
        tube.advance();
        tube.queue.clear();
        tube.send(Command::Stop);
        Ok(())
    }

    fn set_parked(&mut self, parked: bool, _: &Deadline) -> Result<(), DeviceError> {
        let mut tube = self.tube.lock();
        tube.advance();
        tube.parked = parked;
        if parked {
            tube.queue.clear();
            tube.send(Command::Stop);
        }
        Ok(())
    }

    fn site(&mut self, _: &Deadline) -> Result<Option<MountSite>, DeviceError> {
        let [latitude_deg, longitude_deg] = self.tube.lock().options.site_deg;
        Ok(Some(MountSite { latitude_deg, longitude_deg, height_m: 0.0 }))
    }

    fn time(&mut self, _: &Deadline) -> Result<Option<MountTime>, DeviceError> {
        let tube = self.tube.lock();
        let clock = MountClock::SiderealDeg(tube.sidereal().to_degrees().rem_euclid(360.0));
        Ok(Some(MountTime { utc: tube.clock.utc(), clock }))
    }

    fn set_site(&mut self, site: MountSite, _: Epoch, _: &Deadline) -> Result<(), DeviceError> {
        self.tube.lock().options.site_deg = [site.latitude_deg, site.longitude_deg];
        Ok(())
    }
}

impl Finder for VirtualFinder {
    fn half_width_deg(&self) -> f64 {
        self.tube.lock().options.field_deg
    }

    fn side(&self) -> Option<PierSide> {
        let tube = self.tube.lock();
        let side = if tube.options.swaps_names { PierSide::West } else { PierSide::East };
        tube.options.span_rad().map(|_| side)
    }

    fn frame(&mut self, _: &Deadline) -> Result<Option<FinderFrame>, DeviceError> {
        let mut tube = self.tube.lock();
        tube.advance();
        let now_s = tube.now_s;
        // The newest that is ready; older ones are passed over.
        let mut newest = None;
        while tube.frames.front().is_some_and(|(ready_s, _)| *ready_s <= now_s + 1e-9) {
            newest = tube.frames.pop_front().map(|(_, frame)| frame);
        }
        Ok(newest)
    }
}
