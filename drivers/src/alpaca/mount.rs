//! A telescope mount.

use super::answer::{Fail, PARKED};
use super::session::{Place, Session, SessionSettings};
use crate::clock::{Deadline, utc_now};
use crate::device::{
    self, Device, DeviceError, Identity, MountAbilities, MountAxes, MountClock, MountKnown,
    MountMotion, MountPlace, MountRates, MountReading, MountSite, MountTime, PierSide, Setting,
};
use crate::transport::{Bytes, TransportError};
use hifitime::Epoch;
use std::time::Duration;
use sunglint_formats::time::format_utc;

const DEVICE: &str = "Alpaca telescope";
/// Turn of the stars, deg/s of hour angle.
const SIDEREAL_DEG_S: f64 = 15.041_067 / 3600.0;
/// A slowest rate up to which rates count as continuous, deg/s: 1 arcsec/s.
const SLOWEST_DEG_S: f64 = 1.0 / 3600.0;
/// How far from its goal a mount may stand that says that it is there, deg.
const THERE_DEG: f64 = 0.5;
/// Way in [`MOVES_IN`] from which a mount counts as moving, deg.
const MOVES_DEG: f64 = 0.02;
/// Time over which it is looked at whether a mount moves.
const MOVES_IN: Duration = Duration::from_secs(1);
/// Time after a goto in which a mount need not move yet, nor say so.
const STARTS: Duration = Duration::from_secs(5);

/// How a mount is used.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MountSettings {
    /// How its server is spoken to.
    pub session: SessionSettings,
    /// Rate and time of the short move that tells which way the axes turn, deg/s and s.
    pub test_move: (f64, Duration),
}

impl Default for MountSettings {
    fn default() -> Self {
        let session =
            SessionSettings { answer_within: Duration::from_secs(3), ..SessionSettings::default() };
        Self { session, test_move: (0.1, Duration::from_millis(600)) }
    }
}

/// Time for which a mount that has rates does not say that it moves, though it said so at these rates before: somebody stopped it. What it says may be as old.
const STANDS: Duration = Duration::from_secs(1);

/// Rates in force, and what `Slewing` says of them.
#[derive(Debug, Clone, Copy, Default)]
struct Turning {
    /// Rates in the axes of the sky, deg/s.
    deg_s: [f64; 2],
    /// The faster of the two that were sent, deg/s.
    fastest_deg_s: f64,
    /// Since when it does not say that it moves.
    silent: Option<Duration>,
}

/// A place that the mount was sent to.
#[derive(Debug, Clone, Copy)]
struct Goal {
    place: MountPlace,
    since: Duration,
    /// Whether it has said since then that it slews.
    slewed: bool,
    /// When and where it was seen moving last.
    last: Option<(Duration, MountPlace)>,
}

/// A telescope mount of an Alpaca server.
///
/// Rates go through `MoveAxis`, with `Tracking` off, so that they count against the ground. ASCOM does not say which way an axis turns: it is tried by a short move.
/// While the axes move, mounts say that they slew: after a goto that is held against where they stand. One that said so of its rates and says it no more was stopped.
#[derive(Debug)]
pub struct Mount<T> {
    session: Session<T>,
    settings: MountSettings,
    abilities: MountAbilities,
    /// Senses of the axes, and the side of the pier on which they were found.
    senses: Option<([f64; 2], Option<PierSide>)>,
    pier: Option<PierSide>,
    /// Rates that are in force.
    rates: Option<Turning>,
    /// Slowest rate at which it said that it slews, deg/s: not every mount says so of every rate.
    says_from_deg_s: f64,
    /// Rates until they gave way to others, within the last second: when, and the faster axis, deg/s.
    sent: Vec<(Duration, f64)>,
    goal: Option<Goal>,
}

fn wrapped(deg: f64) -> f64 {
    (deg + 180.0).rem_euclid(360.0) - 180.0
}

/// Both numbers of a place.
fn both(place: MountPlace) -> [f64; 2] {
    match place {
        MountPlace::Equatorial { ra_deg, dec_deg } => [ra_deg, dec_deg],
        MountPlace::Horizontal { azimuth_deg, altitude_deg } => [azimuth_deg, altitude_deg],
    }
}

/// Distance of two places in the same axes, deg.
fn distance_deg(a: MountPlace, b: MountPlace) -> f64 {
    let ([a1, a2], [b1, b2]) = (both(a), both(b));
    let (first, second) = (wrapped(a1 - b1), a2 - b2);
    (first * (0.5 * (a2 + b2)).to_radians().cos()).hypot(second)
}

impl<T: Bytes> Mount<T> {
    /// Opens the mount and asks what it can do. Nothing moves.
    ///
    /// # Errors
    /// See [`DeviceError`]; [`DeviceError::NotReady`] if it takes places of another equinox than that of date.
    pub fn open(
        line: T,
        place: &Place,
        settings: MountSettings,
        deadline: &Deadline,
    ) -> Result<Self, DeviceError> {
        let mut session =
            Session::open(line, place, [DEVICE, "telescope"], settings.session, deadline)?;
        let abilities = abilities(&mut session, deadline)?;
        Ok(Self {
            session,
            settings,
            abilities,
            senses: None,
            pier: None,
            rates: None,
            says_from_deg_s: f64::INFINITY,
            sent: Vec::new(),
            goal: None,
        })
    }

    /// The line.
    pub fn line(&self) -> &T {
        self.session.line()
    }

    /// Where it stands, and when. The second angle is read after the first; what it moved meanwhile is taken off.
    fn place(&mut self, deadline: &Deadline) -> Result<(Epoch, MountPlace), DeviceError> {
        let equatorial = self.abilities.axes == MountAxes::Equatorial;
        let ([first, second], [least, most]) = if equatorial {
            (["rightascension", "declination"], [0.0, 24.0])
        } else {
            (["azimuth", "altitude"], [-0.001, 360.001])
        };
        let begun = utc_now();
        let a = self.session.number(first, [least, most], deadline)?;
        let between = utc_now();
        let b = self.session.number(second, [-90.001, 90.001], deadline)?;
        let ended = utc_now();
        let later_s = (0.5 * (ended - begun)).to_seconds();
        let b = (b - self.rates.map_or(0.0, |rates| rates.deg_s[1] * later_s)).clamp(-90.0, 90.0);
        let place = if equatorial {
            MountPlace::Equatorial { ra_deg: (a * 15.0).rem_euclid(360.0), dec_deg: b }
        } else {
            MountPlace::Horizontal { azimuth_deg: a.rem_euclid(360.0), altitude_deg: b }
        };
        Ok((begun + 0.5 * (between - begun), place))
    }

    fn read_pier(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        if self.abilities.tells_pier_side {
            // ASCOM: 0 is east of the pier, 1 west, -1 unknown: it is where it was, as far as is known.
            self.pier = match self.session.integer("sideofpier", [-1, 1], deadline)? {
                0 => Some(PierSide::East),
                1 => Some(PierSide::West),
                _ => self.pier,
            };
        }
        Ok(())
    }

    /// Motion of a mount that has rates. Somebody else may have parked it, or stopped it.
    fn turning(&mut self, deadline: &Deadline) -> Result<MountMotion, DeviceError> {
        let slewing = self.session.flag("slewing", deadline)?;
        if !slewing && self.abilities.parks && self.session.flag("atpark", deadline)? {
            self.rates = None;
            return Ok(MountMotion::Parked);
        }
        let says_from_deg_s = self.says_from_deg_s;
        let Some(turning) = &mut self.rates else { return Ok(MountMotion::Still) };
        // It may speak of rates of a moment ago.
        let now = deadline.now();
        let late = self.sent.iter().filter(|(at, _)| now.saturating_sub(*at) < STANDS);
        let fastest_deg_s = late.map(|(_, deg_s)| *deg_s).fold(turning.fastest_deg_s, f64::max);
        if slewing && fastest_deg_s > 0.0 {
            self.says_from_deg_s = says_from_deg_s.min(fastest_deg_s);
        }
        turning.silent = match !slewing && turning.fastest_deg_s >= says_from_deg_s {
            true => Some(turning.silent.unwrap_or(now)),
            false => None,
        };
        let stands = turning.silent.is_some_and(|since| now.saturating_sub(since) >= STANDS);
        Ok(if stands { MountMotion::Still } else { MountMotion::Tracking })
    }

    /// Motion as the mount says it, held against where it stands after a goto.
    fn motion(
        &mut self,
        place: MountPlace,
        deadline: &Deadline,
    ) -> Result<MountMotion, DeviceError> {
        if self.rates.is_some() {
            return self.turning(deadline);
        }
        if self.abilities.parks && self.session.flag("atpark", deadline)? {
            self.goal = None;
            return Ok(MountMotion::Parked);
        }
        let slewing = self.session.flag("slewing", deadline)?;
        if let Some(goal) = &mut self.goal {
            let now = deadline.now();
            let young = now.saturating_sub(goal.since) < STARTS;
            let off = distance_deg(place, goal.place);
            // Two readings may lie closer together than a slow motion shows.
            let (seen_at, seen) = *goal.last.get_or_insert((now, place));
            let moved = distance_deg(place, seen) > MOVES_DEG;
            if moved {
                goal.last = Some((now, place));
            }
            let moves = moved || now.saturating_sub(seen_at) < MOVES_IN;
            goal.slewed |= slewing || moved;
            // A short way may not have begun yet.
            let begun = goal.slewed || !young || off < MOVES_DEG;
            if !slewing && off <= THERE_DEG && begun {
                self.goal = None;
            } else if slewing || (young && !goal.slewed) || moves {
                return Ok(MountMotion::Slewing);
            } else {
                let (asked, slewed) = (goal.place, goal.slewed);
                self.goal = None;
                // It was on its way, and it ended before the goal.
                return Err(match slewed {
                    true => DeviceError::Taken {
                        device: DEVICE,
                        what: "the mount was stopped by somebody else",
                    },
                    false => not_there(asked, place),
                });
            }
        } else if slewing {
            return Ok(MountMotion::Slewing);
        }
        Ok(if self.session.can("tracking", deadline)? {
            MountMotion::Tracking
        } else {
            MountMotion::Still
        })
    }

    fn check_place(&self, place: MountPlace) -> Result<(), DeviceError> {
        let equatorial = self.abilities.axes == MountAxes::Equatorial;
        let fits = matches!(place, MountPlace::Equatorial { .. }) == equatorial;
        if !fits {
            let reason = if equatorial {
                "it is sent to right ascension and declination"
            } else {
                "it is sent to azimuth and altitude"
            };
            return Err(DeviceError::NotReady { device: DEVICE, reason });
        }
        let [first, second] = both(place);
        let asked = second;
        if !first.is_finite() || !(-90.0..=90.0).contains(&second) {
            let name = "declination or altitude, deg";
            return Err(DeviceError::OutOfRange { name, asked, least: -90.0, most: 90.0 });
        }
        Ok(())
    }

    /// The parameters of a place.
    fn form(place: MountPlace) -> [(&'static str, String); 2] {
        match place {
            MountPlace::Equatorial { ra_deg, dec_deg } => [
                ("RightAscension", (ra_deg.rem_euclid(360.0) / 15.0).to_string()),
                ("Declination", dec_deg.to_string()),
            ],
            MountPlace::Horizontal { azimuth_deg, altitude_deg } => [
                ("Azimuth", azimuth_deg.rem_euclid(360.0).to_string()),
                ("Altitude", altitude_deg.to_string()),
            ],
        }
    }

    fn track(&mut self, on: bool, deadline: &Deadline) -> Result<(), DeviceError> {
        if self.session.can("tracking", deadline)? == on {
            return Ok(());
        }
        self.session.set("tracking", "Tracking", on.to_string(), deadline)?;
        // It is read back: a mount may say yes and go on.
        if self.session.flag("tracking", deadline)? != on {
            let (asked, got) = (on.to_string(), (!on).to_string());
            return Err(DeviceError::NotTaken { device: DEVICE, name: "tracking", asked, got });
        }
        Ok(())
    }

    fn move_axis(
        &mut self,
        axis: usize,
        deg_s: f64,
        deadline: &Deadline,
    ) -> Result<(), DeviceError> {
        let parameters = [("Axis", axis.to_string()), ("Rate", (deg_s + 0.0).to_string())];
        // A command that arrived may have been followed by another client's stop, or a watchdog's: it is not sent again by itself. A stop is.
        let put = if deg_s == 0.0 {
            self.session.put("moveaxis", &parameters, deadline)
        } else {
            self.session.put_once("moveaxis", &parameters, deadline)
        };
        put.map_err(|fail| taken_or(fail, &format!("{deg_s} deg/s of axis {axis}")))
    }

    fn move_axes(&mut self, deg_s: [f64; 2], deadline: &Deadline) -> Result<(), DeviceError> {
        self.move_axis(0, deg_s[0], deadline)?;
        self.move_axis(1, deg_s[1], deadline)
    }

    /// Rate of the axes as the sky sees them, deg/s, between two readings.
    fn rate_between(&self, a: (Epoch, MountPlace), b: (Epoch, MountPlace)) -> [f64; 2] {
        let seconds = (b.0 - a.0).to_seconds().max(1e-3);
        let ([a1, a2], [b1, b2]) = (both(a.1), both(b.1));
        let first = wrapped(b1 - a1) / seconds;
        let first = match self.abilities.axes {
            MountAxes::Equatorial => SIDEREAL_DEG_S - first,
            MountAxes::Horizontal => first,
        };
        [first, (b2 - a2) / seconds]
    }

    /// Moves both axes there and back, and gives the senses.
    fn try_axes(&mut self, beat: &dyn Fn(), deadline: &Deadline) -> Result<[f64; 2], DeviceError> {
        let (rate, time) = self.settings.test_move;
        let most = self.abilities.fastest_deg_s().unwrap_or_default();
        let rate = match &self.abilities.rates {
            MountRates::Discrete { deg_s } => test_rate_deg_s(deg_s, rate)?,
            _ => rate,
        };
        let slept = |expired| DeviceError::expired(DEVICE, "a short move", expired);
        let start = self.place(deadline)?;
        let near_pole = both(start.1)[1] > 80.0;
        let (first, second) = (rate.min(most[0]), rate.min(most[1]));
        let rates = [first, if near_pole { -second } else { second }];
        beat();
        self.move_axes(rates, deadline)?;
        // The first part of the move is the mount's own: delay and acceleration.
        deadline.sleep(time / 2).map_err(slept)?;
        beat();
        let a = self.place(deadline)?;
        deadline.sleep(time).map_err(slept)?;
        beat();
        let b = self.place(deadline)?;
        beat();
        self.move_axes(rates.map(|rate| -rate), deadline)?;
        deadline.sleep(time + time / 2).map_err(slept)?;
        beat();
        self.move_axes([0.0; 2], deadline)?;
        beat();
        let found = self.rate_between(a, b);
        let mut senses = [1.0; 2];
        for axis in 0..2 {
            let part = found[axis] / rates[axis];
            if !(0.5..=1.5).contains(&part.abs()) {
                let name =
                    ["rate of the first axis, deg/s", "rate of the second axis, deg/s"][axis];
                let (asked, got) = (rates[axis].to_string(), format!("{:.4}", found[axis]));
                return Err(DeviceError::NotTaken { device: DEVICE, name, asked, got });
            }
            senses[axis] = part.signum();
        }
        Ok(senses)
    }
}

/// Rates of a short move of a mount that has a few rates only, deg/s: slower ones are lost in what it reads, faster ones lead it away.
const TEST_DEG_S: (f64, f64) = (0.01, 1.5);

/// The rate nearest to one, in proportion, of those that a short move may have, deg/s.
fn test_rate_deg_s(steps: &[f64], wanted: f64) -> Result<f64, DeviceError> {
    let fit = steps.iter().copied().filter(|rate| (TEST_DEG_S.0..=TEST_DEG_S.1).contains(rate));
    let off = |rate: f64| (rate / wanted).ln().abs();
    fit.min_by(|a, b| off(*a).total_cmp(&off(*b))).ok_or(DeviceError::NotReady {
        device: DEVICE,
        reason: "none of its rates (AxisRates) lies between 0.01 and 1.5 deg/s: which way its axes turn cannot be tried",
    })
}

/// The error of a command. A mount that is parked was parked by somebody else.
fn taken_or(fail: Fail, request: &str) -> DeviceError {
    if fail.has_code(PARKED) {
        let what = "the mount was parked by somebody else";
        return DeviceError::Taken { device: DEVICE, what };
    }
    fail.error(DEVICE, request)
}

fn not_there(asked: MountPlace, got: MountPlace) -> DeviceError {
    let words = |place| {
        let [first, second] = both(place);
        format!("{first:.4} {second:+.4}")
    };
    let (asked, got) = (words(asked), words(got));
    DeviceError::NotTaken { device: DEVICE, name: "place, deg", asked, got }
}

/// Asks what it can do.
fn abilities<T: Bytes>(
    session: &mut Session<T>,
    deadline: &Deadline,
) -> Result<MountAbilities, DeviceError> {
    // ASCOM: 0 azimuth and altitude, 1 polar, 2 German.
    let alignment = session.optional("alignmentmode", deadline)?.and_then(|v| v.as_i64());
    let axes = if alignment == Some(0) { MountAxes::Horizontal } else { MountAxes::Equatorial };
    let turns_about = matches!(alignment, Some(0..=2)).then_some(axes);
    if axes == MountAxes::Equatorial {
        // ASCOM: 0 other, 1 of date, 2 J2000, 3 J2050, 4 B1950.
        let system = session.optional("equatorialsystem", deadline)?;
        let reason = match system.as_ref().map(|system| system.as_i64()) {
            // The simulators, and drivers that never thought of it, say 0 or nothing: their places are of date.
            None | Some(Some(0 | 1)) => None,
            Some(Some(2..=4)) => Some(
                "it takes places of another equinox: set its driver to the equinox of date (JNow, topocentric)",
            ),
            _ => Some(
                "it does not say of which equinox its places are (EquatorialSystem): set its driver to the equinox of date (JNow, topocentric)",
            ),
        };
        if let Some(reason) = reason {
            return Err(DeviceError::NotReady { device: DEVICE, reason });
        }
    }
    let (mut most, mut least) = ([0.0; 2], [0.0; 2]);
    let mut of_axes = [Vec::new(), Vec::new()];
    let mut moves = session.can("cansettracking", deadline)?;
    let tells_tracking = moves && axes == MountAxes::Equatorial;
    let mut continuous = true;
    for axis in 0..2_usize {
        if !moves {
            break;
        }
        let parameter = [("Axis", axis.to_string())];
        let can = match session.get("canmoveaxis", &parameter, deadline) {
            Ok(can) => can.as_bool().unwrap_or(false),
            Err(fail) if fail.is_absent() => false,
            Err(fail) => return Err(fail.error(DEVICE, "canmoveaxis")),
        };
        let rates = if can {
            let rates = session.get("axisrates", &parameter, deadline);
            rates.map_err(|fail| fail.error(DEVICE, "axisrates"))?
        } else {
            serde_json::Value::Null
        };
        let ranges = ranges(&rates);
        moves &= !ranges.is_empty();
        let slowest = ranges.iter().map(|range| range[0]).fold(f64::INFINITY, f64::min);
        least[axis] = slowest;
        most[axis] = ranges.iter().map(|range| range[1]).fold(0.0, f64::max);
        continuous &= slowest <= SLOWEST_DEG_S && is_gapless(&ranges);
        of_axes[axis] = ranges;
    }
    let steps = steps(&of_axes);
    let rates = match (moves, continuous) {
        (false, _) => MountRates::Absent,
        (true, true) => MountRates::Continuous { most_deg_s: most.into() },
        (true, false) if steps.is_empty() => MountRates::Absent,
        (true, false) => MountRates::Discrete { deg_s: steps },
    };
    let parks = session.can("canpark", deadline)? && session.can("canunpark", deadline)?;
    let syncs = match axes {
        MountAxes::Equatorial => session.can("cansync", deadline)?,
        MountAxes::Horizontal => session.can("cansyncaltaz", deadline)?,
    };
    // A mount that is no German one may answer with a side that never changes.
    let tells_pier_side = alignment == Some(2)
        && session.optional("sideofpier", deadline)?.and_then(|v| v.as_i64()).is_some();
    let refracts = session.optional("doesrefraction", deadline)?.and_then(|v| v.as_bool());
    Ok(MountAbilities {
        axes,
        turns_about,
        rates,
        least_deg_s: least.into(),
        parks,
        syncs,
        tells_pier_side,
        is_fork: alignment == Some(1),
        tells_tracking,
        refracts,
        altitude_deg: None,
    })
}

/// Whether ranges of rates leave no rate between them out.
fn is_gapless(ranges: &[[f64; 2]]) -> bool {
    let mut sorted = ranges.to_vec();
    sorted.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut up_to = sorted.first().map_or(0.0, |range| range[1]);
    sorted.iter().all(|[least, most]| {
        let follows = *least <= up_to * 1.0001;
        up_to = up_to.max(*most);
        follows
    })
}

/// Speeds that are told of a range of rates, besides its ends.
const WITHIN: u32 = 63;

/// Rates that both axes have, increasing, deg/s: they are sent the same ones. Of a range its ends and some between them.
fn steps(of_axes: &[Vec<[f64; 2]>; 2]) -> Vec<f64> {
    let has = |ranges: &[[f64; 2]], rate: f64| {
        let within = |[a, b]: &[f64; 2]| (a * (1.0 - 1e-6)..=b * (1.0 + 1e-6)).contains(&rate);
        ranges.iter().any(within)
    };
    let of = |[a, b]: &[f64; 2]| {
        let (a, step) = (*a, (b - a) / f64::from(WITHIN + 1));
        let last = if step > 0.0 { WITHIN + 1 } else { 0 };
        (0..=last).map(move |k| a + step * f64::from(k))
    };
    let mut steps: Vec<f64> = of_axes.iter().flatten().flat_map(of).collect();
    steps.retain(|rate| *rate > 0.0 && of_axes.iter().all(|ranges| has(ranges, *rate)));
    steps.sort_by(f64::total_cmp);
    steps.dedup_by(|a, b| (*a - *b).abs() <= 1e-6 * *b);
    steps
}

/// Ranges of rates, deg/s, at most 100; none where they make no sense.
fn ranges(rates: &serde_json::Value) -> Vec<[f64; 2]> {
    let all = rates.as_array().map(Vec::as_slice).unwrap_or_default();
    let of = |rate: &serde_json::Value| {
        let [least, most] = ["Minimum", "Maximum"].map(|name| rate.get(name)?.as_f64());
        let (least, most) = (least?, most?);
        (least >= 0.0 && most >= least && most > 0.0 && most <= 360.0).then_some([least, most])
    };
    all.iter().take(100).filter_map(of).collect()
}

impl<T: Bytes> Device for Mount<T> {
    fn identity(&mut self, deadline: &Deadline) -> Result<Identity, DeviceError> {
        self.session.identity(deadline)
    }

    fn settings(&mut self, deadline: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let now = device::Mount::reading(self, deadline)?;
        Ok(now.settings(&self.abilities))
    }
}

impl<T: Bytes> device::Mount for Mount<T> {
    fn abilities(&self) -> &MountAbilities {
        &self.abilities
    }

    fn know(&mut self, known: &MountKnown) {
        self.abilities.know(known);
    }

    fn reading(&mut self, deadline: &Deadline) -> Result<MountReading, DeviceError> {
        let was_sent = self.goal.is_some();
        let (mut utc, mut place) = self.place(deadline)?;
        let motion = self.motion(place, deadline)?;
        if was_sent && motion != MountMotion::Slewing {
            // It arrived after its place was read: on a slow line that lies where it still was on its way.
            (utc, place) = self.place(deadline)?;
        }
        self.read_pier(deadline)?;
        Ok(MountReading { utc, place, pier: self.pier, motion })
    }

    fn begin_goto(&mut self, place: MountPlace, deadline: &Deadline) -> Result<(), DeviceError> {
        self.check_place(place)?;
        if self.rates.take().is_some() {
            self.move_axes([0.0; 2], deadline)?;
        }
        // ASCOM: a mount slews to equatorial places with tracking on, to horizontal ones with tracking off.
        let equatorial = matches!(place, MountPlace::Equatorial { .. });
        self.track(equatorial, deadline)?;
        let member = if equatorial { "slewtocoordinatesasync" } else { "slewtoaltazasync" };
        let put = self.session.put_once(member, &Self::form(place), deadline);
        let [first, second] = both(place);
        put.map_err(|fail| taken_or(fail, &format!("to go to {first:.4}, {second:.4} deg")))?;
        self.goal = Some(Goal { place, since: deadline.now(), slewed: false, last: None });
        Ok(())
    }

    fn sync(&mut self, place: MountPlace, deadline: &Deadline) -> Result<(), DeviceError> {
        self.check_place(place)?;
        if !self.abilities.syncs {
            let reason = "it cannot be told where it points";
            return Err(DeviceError::NotReady { device: DEVICE, reason });
        }
        let equatorial = matches!(place, MountPlace::Equatorial { .. });
        let member = if equatorial { "synctocoordinates" } else { "synctoaltaz" };
        let put = self.session.put(member, &Self::form(place), deadline);
        put.map_err(|fail| fail.error(DEVICE, "to be told where it points"))?;
        let (_, now) = self.place(deadline)?;
        // It stands there now, within what passes until it is asked.
        if distance_deg(now, place) > 0.1 { Err(not_there(place, now)) } else { Ok(()) }
    }

    fn set_tracking(&mut self, on: bool, deadline: &Deadline) -> Result<(), DeviceError> {
        if self.rates.take().is_some() {
            self.move_axes([0.0; 2], deadline)?;
        }
        self.track(on, deadline)
    }

    fn learn_senses(&mut self, beat: &dyn Fn(), deadline: &Deadline) -> Result<(), DeviceError> {
        self.senses = None;
        if self.abilities.fastest_deg_s().is_none() {
            let reason = "it takes no rates (MoveAxis): send it to places";
            return Err(DeviceError::NotReady { device: DEVICE, reason });
        }
        // Rates count against the ground then.
        self.track(false, deadline)?;
        beat();
        self.read_pier(deadline)?;
        self.rates = Some(Turning::default());
        let senses = self.try_axes(beat, deadline).inspect_err(|_| {
            let _ = device::Mount::stop(self, &deadline.grace(Duration::from_secs(2)));
        })?;
        // Where it turned over meanwhile, what was found holds on neither side.
        let before = self.pier;
        self.read_pier(deadline)?;
        self.senses = Some((senses, self.pier)).filter(|_| before.is_none() || before == self.pier);
        Ok(())
    }

    fn set_rates(&mut self, deg_s: [f64; 2], deadline: &Deadline) -> Result<(), DeviceError> {
        let senses = self.senses.filter(|(_, found)| *found == self.pier).map(|(senses, _)| senses);
        // Zero is zero in any sense.
        let senses = senses.or((deg_s == [0.0; 2]).then_some([1.0; 2]));
        let Some(senses) = senses else {
            let reason = "it is not known which way its axes turn on this side of the pier: learn it after a goto";
            return Err(DeviceError::NotReady { device: DEVICE, reason });
        };
        let most = self.abilities.fastest_deg_s().unwrap_or_default();
        for (axis, asked) in deg_s.into_iter().enumerate() {
            if !asked.is_finite() || asked.abs() > most[axis] {
                let (name, most) = ("rate, deg/s", most[axis]);
                return Err(DeviceError::OutOfRange { name, asked, least: -most, most });
            }
        }
        let rates = [0, 1].map(|axis| senses[axis] * self.abilities.taken_deg_s(axis, deg_s[axis]));
        self.goal = None;
        let fastest_deg_s = rates[0].abs().max(rates[1].abs());
        let now = deadline.now();
        self.sent.retain(|(at, _)| now.saturating_sub(*at) < STANDS);
        self.sent.push((now, self.rates.map_or(0.0, |turning| turning.fastest_deg_s)));
        let silent = self.rates.and_then(|turning| turning.silent);
        self.rates = Some(Turning { deg_s, fastest_deg_s, silent });
        self.move_axes(rates, deadline)
    }

    /// Stops the axes one by one and the slew: some mounts stop only what they are named.
    fn stop(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        (self.rates, self.goal) = (None, None);
        let mut failed = None;
        let moves = !matches!(self.abilities.rates, MountRates::Absent);
        // After a failure the rest is tried all the same, each in its share of the time.
        let share = |left: u32| deadline.at_most(deadline.remaining().unwrap_or_default() / left);
        for axis in (0..2).filter(|_| moves) {
            let parameters = [("Axis", axis.to_string()), ("Rate", "0".to_owned())];
            match self.session.put("moveaxis", &parameters, &share(4 - axis)) {
                Err(fail) if fail.has_code(PARKED) => {}
                Err(fail) => failed = failed.or(Some(fail.error(DEVICE, "to stop an axis"))),
                Ok(()) => {}
            }
        }
        match self.session.put("abortslew", &[], &share(2)) {
            Err(fail) if fail.has_code(PARKED) || fail.is_absent() => {}
            Err(fail) => failed = failed.or(Some(fail.error(DEVICE, "to stop"))),
            Ok(()) => {}
        }
        match self.session.put("tracking", &[("Tracking", "false".into())], &share(1)) {
            Err(fail) if fail.has_code(PARKED) || fail.is_absent() => {}
            Err(fail) => {
                failed = failed.or(Some(fail.error(DEVICE, "to stop following the stars")));
            }
            Ok(()) => {}
        }
        failed.map_or(Ok(()), Err)
    }

    fn set_parked(&mut self, parked: bool, deadline: &Deadline) -> Result<(), DeviceError> {
        if !self.abilities.parks {
            let reason = "it cannot be parked";
            return Err(DeviceError::NotReady { device: DEVICE, reason });
        }
        if self.session.flag("atpark", deadline)? == parked {
            return Ok(());
        }
        (self.goal, self.rates) = (None, None);
        let (member, request) = if parked { ("park", "to park") } else { ("unpark", "to unpark") };
        let error = match self.session.put_once(member, &[], deadline) {
            Ok(()) => return Ok(()),
            Err(fail) => fail.error(DEVICE, request),
        };
        // Some answer only once they are parked, which takes minutes: that it has begun is enough.
        let late =
            matches!(&error, DeviceError::Transport { source: TransportError::Timeout { .. }, .. });
        let grace = deadline.grace(self.settings.session.answer_within);
        let begun = late
            && (self.session.flag("slewing", &grace)?
                || self.session.flag("atpark", &grace)? == parked);
        if begun { Ok(()) } else { Err(error) }
    }

    fn site(&mut self, deadline: &Deadline) -> Result<Option<MountSite>, DeviceError> {
        let [latitude, longitude, height] = ["sitelatitude", "sitelongitude", "siteelevation"]
            .map(|member| self.session.optional_number(member, deadline));
        let (Some(latitude_deg), Some(longitude_deg)) = (latitude?, longitude?) else {
            return Ok(None);
        };
        let within = (-180.0..=180.0).contains(&longitude_deg);
        let longitude_deg = if within { longitude_deg } else { wrapped(longitude_deg) };
        Ok(Some(MountSite { latitude_deg, longitude_deg, height_m: height?.unwrap_or(0.0) }))
    }

    fn time(&mut self, deadline: &Deadline) -> Result<Option<MountTime>, DeviceError> {
        let begun = utc_now();
        let hours = self.session.optional_number("siderealtime", deadline)?;
        let utc = begun + 0.5 * (utc_now() - begun);
        let clock = |hours: f64| MountClock::SiderealDeg((hours * 15.0).rem_euclid(360.0));
        // A driver that knows none says 0.
        let hours = hours.filter(|hours| *hours != 0.0);
        Ok(hours.map(|hours| MountTime { utc, clock: clock(hours) }))
    }

    fn set_site(
        &mut self,
        site: MountSite,
        utc: Epoch,
        deadline: &Deadline,
    ) -> Result<(), DeviceError> {
        let values = [
            ("sitelatitude", "SiteLatitude", site.latitude_deg.to_string()),
            ("sitelongitude", "SiteLongitude", site.longitude_deg.to_string()),
            ("siteelevation", "SiteElevation", site.height_m.clamp(-300.0, 10_000.0).to_string()),
            ("utcdate", "UTCDate", format_utc(utc, 3)),
        ];
        for (member, name, value) in values {
            match self.session.put(member, &[(name, value)], deadline) {
                // A mount that keeps its own says where it stands: that is held against the station.
                Err(fail) if fail.is_absent() => {}
                Err(fail) => return Err(fail.error(DEVICE, name)),
                Ok(()) => {}
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: by hand. Single rates that one axis lacks are left out, ends that differ by rounding are one rate, and a range that begins above what counts as continuous has rates between its ends.
    #[test]
    fn both_axes_are_sent_rates_that_both_have() {
        let single = |rates: &[f64]| rates.iter().map(|r| [*r, *r]).collect::<Vec<_>>();
        let found = steps(&[single(&[0.004, 0.5, 4.0]), single(&[0.004, 0.500_000_01, 2.0])]);
        assert_eq!(found.len(), 2, "{found:?}");
        let found = steps(&[vec![[0.002, 4.0]], vec![[0.002, 3.5]]]);
        assert!(found.iter().any(|r| (0.01..1.0).contains(r)), "{found:?}");
        assert!(found.iter().all(|r| (0.002..=3.5 + 1e-5).contains(r)), "{found:?}");
        assert!((found[found.len() - 1] - 3.5).abs() < 1e-9, "{found:?}");
        assert!(steps(&[single(&[1.0]), Vec::new()]).is_empty());
    }
}
