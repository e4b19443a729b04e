//! A telescope mount.

use super::client::{Wanted, declined, hear};
use super::property::{Event, State, Vector};
use super::session::{Kind, Session, SessionSettings, check_range};
use crate::clock::{Deadline, utc_now};
use crate::device::{
    self, Device, DeviceError, Identity, MountAbilities, MountAxes, MountClock, MountKnown,
    MountMotion, MountPlace, MountRates, MountReading, MountSite, MountTime, PierSide, Setting,
};
use crate::transport::{Bytes, TransportError};
use hifitime::Epoch;
use std::time::Duration;
use sunglint_formats::time::{format_utc, parse_utc};
use sunglint_numerics::axes::Axes;
use sunglint_numerics::measured::Interval;

const DEVICE: &str = "INDI telescope";
const PLACE: &str = "EQUATORIAL_EOD_COORD";
const ABORT: (&str, &str) = ("TELESCOPE_ABORT_MOTION", "ABORT");
const RATE: &str = "TELESCOPE_TRACK_RATE";
const RATES: [&str; 2] = ["TRACK_RATE_RA", "TRACK_RATE_DE"];
const MODE: &str = "TELESCOPE_TRACK_MODE";
const CUSTOM: &str = "TRACK_CUSTOM";
const SIDEREAL: &str = "TRACK_SIDEREAL";
const TRACK: &str = "TELESCOPE_TRACK_STATE";
const PARK: &str = "TELESCOPE_PARK";
const PIER: &str = "TELESCOPE_PIER_SIDE";
/// Drivers of mounts that say no side make one up from the hour angle while this is on.
const MADE_UP_PIER: (&str, &str) = ("SIMULATE_PIER_SIDE", "SIMULATE_YES");
const SITE: &str = "GEOGRAPHIC_COORD";
const SIDEREAL_TIME: &str = "TIME_LST";
const TIME: &str = "TIME_UTC";
const KIND: Kind =
    Kind { label: DEVICE, what: "telescope", interface: 1, required: &[PLACE, ABORT.0] };

/// Time after which a mount that says nothing of a slew counts as there, where it stands on its place.
const NEAR_AFTER: Duration = Duration::from_millis(800);
/// Time in which a mount has to say that it slews.
const PATIENCE: Duration = Duration::from_secs(3);
/// Time in which a clock that runs says another time.
const RUNS_IN: Duration = Duration::from_millis(1500);
/// Time of a call that is left to ask for the place.
const TO_ASK: Duration = Duration::from_millis(150);

/// The rate of a mount that follows the stars, arcsec/s of hour angle.
const SIDEREAL_ARCSEC_S: f64 = 15.041_067;

/// How a mount is used.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MountSettings {
    /// How its server is spoken to.
    pub session: SessionSettings,
    /// How often it should say where it points.
    pub poll: Duration,
    /// How fast and how long it turns in declination to find out which way is up, arcsec/s and s.
    pub test_move: (f64, Duration),
    /// How long an abort may take.
    pub abort_within: Duration,
}

impl Default for MountSettings {
    fn default() -> Self {
        Self {
            session: SessionSettings::default(),
            poll: Duration::from_millis(50),
            test_move: (200.0, Duration::from_millis(500)),
            abort_within: Duration::from_secs(2),
        }
    }
}

/// A telescope mount on an INDI server.
///
/// Rates go through `TELESCOPE_TRACK_RATE`, which drivers follow only while `TELESCOPE_TRACK_STATE` is on and the mode is custom. Its first value is
/// the rate of the hour angle; the sense of its second turns round with the side of the pier in some drivers, so it is tried by a short move.
#[derive(Debug)]
pub struct Mount<T> {
    session: Session<T>,
    settings: MountSettings,
    abilities: MountAbilities,
    poll: Duration,
    /// Sense of the declination's rate, and the side of the pier on which it was found.
    sense: Option<(f64, Option<PierSide>)>,
    /// Side of the pier that it said last: drivers say none for a moment while they turn over.
    side: Option<PierSide>,
    /// Whether the mode is custom and the state on, as far as we set it.
    custom: bool,
}

impl<T: Bytes> Mount<T> {
    /// Connects to the mount of that name.
    ///
    /// # Errors
    /// See [`DeviceError`]; [`DeviceError::Unknown`] if the server has none of that name ([`devices`](super::devices) lists them).
    pub fn open(
        line: T,
        device: &str,
        settings: MountSettings,
        deadline: &Deadline,
    ) -> Result<Self, DeviceError> {
        let mut session = Session::new(line, device, KIND, settings.session);
        session.define(deadline)?;
        let mut poll = Duration::from_secs(1);
        if session.property("POLLING_PERIOD").is_some() {
            let asked = settings.poll.as_secs_f64() * 1e3;
            let soon = deadline.at_most(settings.session.answer_within);
            let wanted = Wanted::Numbers(&[("PERIOD_MS", asked)]);
            let period = session.change("POLLING_PERIOD", wanted, &soon)?;
            if let Some(period_ms) =
                period.number("PERIOD_MS").filter(|ms| (1.0..=1e4).contains(ms))
            {
                poll = Duration::from_secs_f64(period_ms / 1e3);
            }
        }
        let abilities = abilities(&session);
        Ok(Self { session, settings, abilities, poll, sense: None, side: None, custom: false })
    }

    /// Goes on over a new line to the server, from scratch; gives the old one.
    ///
    /// # Errors
    /// The errors of [`open`](Self::open).
    pub fn reconnect(&mut self, line: T, deadline: &Deadline) -> Result<T, DeviceError> {
        let old = self.session.client.replace_line(line);
        (self.sense, self.side, self.custom) = (None, None, false);
        self.session.define(deadline)?;
        Ok(old)
    }

    /// The line.
    pub fn line(&self) -> &T {
        self.session.client.line()
    }

    /// The line.
    pub fn into_line(self) -> T {
        self.session.client.into_line()
    }

    fn soon(&self, deadline: &Deadline) -> Deadline {
        deadline.at_most(self.settings.session.answer_within)
    }

    fn is_on(&self, name: &str, member: &str) -> Option<bool> {
        self.session.property(name)?.is_on(member)
    }

    fn pier(&mut self) -> Option<PierSide> {
        if !self.abilities.tells_pier_side
            || self.is_on(MADE_UP_PIER.0, MADE_UP_PIER.1) == Some(true)
        {
            self.side = None;
            return None;
        }
        let now = |vector: &Vector| match (vector.is_on("PIER_EAST"), vector.is_on("PIER_WEST")) {
            (Some(true), Some(false)) => Some(PierSide::East),
            (Some(false), Some(true)) => Some(PierSide::West),
            _ => None,
        };
        self.side = self.session.property(PIER).and_then(now).or(self.side);
        self.side
    }

    fn of(&mut self, vector: &Vector, utc: Epoch) -> Result<MountReading, DeviceError> {
        let number = |member| {
            vector.number(member).ok_or_else(|| {
                self.session.protocol(format!(
                    "{PLACE} has no number {member}: it does not say where it points"
                ))
            })
        };
        let place =
            MountPlace::Equatorial { ra_deg: number("RA")? * 15.0, dec_deg: number("DEC")? };
        let parked = self.is_on(PARK, "PARK") == Some(true);
        let parking = self.session.property(PARK).is_some_and(|park| park.state == State::Busy);
        let motion = match vector.state {
            State::Busy => MountMotion::Slewing,
            _ if parking => MountMotion::Slewing,
            _ if parked => MountMotion::Parked,
            _ if self.is_on(TRACK, "TRACK_ON") == Some(true) => MountMotion::Tracking,
            _ => MountMotion::Still,
        };
        Ok(MountReading { utc, place, pier: self.pier(), motion })
    }

    /// The next change of the place; `None` if none comes in time. What came before is taken in first.
    fn fresh(&mut self, deadline: &Deadline) -> Result<Option<MountReading>, DeviceError> {
        // What lies in the socket came at a time that nobody knows.
        while self.event_within(Duration::from_micros(500), deadline)?.is_some() {}
        // A call that is short has time to ask, where no change comes by itself.
        let most = deadline.remaining().unwrap_or_default().saturating_sub(TO_ASK);
        let end = deadline.now() + (self.poll + self.poll / 2).min(most);
        loop {
            let left = end.saturating_sub(deadline.now());
            if left.is_zero() {
                return Ok(None);
            }
            match self.event_within(left, deadline)? {
                None => return Ok(None),
                Some(Event::Changed(place, _))
                    if place.device == self.session.device && place.name == PLACE =>
                {
                    let utc = utc_now();
                    let vector = self.session.require(PLACE)?.clone();
                    return self.of(&vector, utc).map(Some);
                }
                Some(_) => {}
            }
        }
    }

    fn event_within(
        &mut self,
        time: Duration,
        deadline: &Deadline,
    ) -> Result<Option<Event>, DeviceError> {
        match self.session.client.event(&deadline.at_most(time)) {
            Ok(event) => Ok(Some(event)),
            Err(DeviceError::Transport { source: TransportError::Timeout { .. }, .. }) => {
                match deadline.remaining() {
                    Ok(_) => Ok(None),
                    Err(expired) => Err(DeviceError::transport(DEVICE, expired.into())),
                }
            }
            Err(error) => Err(error),
        }
    }

    fn switch(&mut self, name: &str, member: &str, deadline: &Deadline) -> Result<(), DeviceError> {
        let soon = self.soon(deadline);
        let device = self.session.device.clone();
        self.session.client.set(&device, name, Wanted::Switches(&[(member, true)]), &soon)?;
        let (awaited, request) =
            (format!("the answer to {name} {member}"), format!("{name} {member}"));
        let mut said = Vec::new();
        // A state that lasts (the following of the stars) stays Busy: the first answer counts.
        self.session.client.wait(&device, &awaited, &soon, |client, event| match event {
            Event::Message { text, .. } => {
                hear(&mut said, text);
                None
            }
            Event::Changed(place, state) if place.device == device && place.name == name => {
                let is_on = client.property(&device, name).and_then(|vector| vector.is_on(member));
                Some(match (state, is_on) {
                    (State::Alert, _) | (_, Some(false) | None) => {
                        Err(declined(DEVICE, request.clone(), &said))
                    }
                    _ => Ok(()),
                })
            }
            _ => None,
        })
    }

    /// Sends a place after the switch of `ON_COORD_SET`, and waits until the mount has taken it or said no.
    fn send_place(
        &mut self,
        verb: &'static str,
        place: MountPlace,
        deadline: &Deadline,
    ) -> Result<(), DeviceError> {
        let MountPlace::Equatorial { ra_deg, dec_deg } = place else {
            let reason = "it takes right ascension and declination, no azimuth and altitude";
            return Err(DeviceError::NotReady { device: DEVICE, reason });
        };
        check_range("declination, deg", dec_deg, Some(Interval::new(-90.0, 90.0)))?;
        if self.is_on(PARK, "PARK") == Some(true) {
            let reason = "it is parked: unpark it first";
            return Err(DeviceError::NotReady { device: DEVICE, reason });
        }
        self.custom = false;
        if self.is_on("ON_COORD_SET", verb) != Some(true) {
            self.switch("ON_COORD_SET", verb, deadline)?;
        }
        let ra_h = ra_deg.rem_euclid(360.0) / 15.0;
        let wanted = Wanted::Numbers(&[("RA", ra_h), ("DEC", dec_deg)]);
        let device = self.session.device.clone();
        let request = format!("{verb} to RA {ra_h:.5} h, declination {dec_deg:.4} deg");
        self.session.client.set(&device, PLACE, wanted, deadline)?;
        let soon = self.soon(deadline);
        let mut said = Vec::new();
        // A refusal is a message with a state that stays as it was; a place that is near is reached between two reports. A mount on a slow line says late that it slews.
        let begun = soon.now();
        let (near_after, patience) = (NEAR_AFTER.max(self.poll * 3), PATIENCE.max(self.poll * 3));
        loop {
            let gone = soon.now().saturating_sub(begun);
            let until = if gone < near_after { near_after } else { patience };
            let left = until.saturating_sub(gone);
            match if left.is_zero() { None } else { self.event_within(left, &soon)? } {
                Some(Event::Message { text, .. }) => hear(&mut said, text),
                Some(Event::Changed(place, state))
                    if place.device == device && place.name == PLACE =>
                {
                    match state {
                        State::Busy => return Ok(()),
                        State::Alert => return Err(declined(DEVICE, request, &said)),
                        State::Ok if verb == "SYNC" => return Ok(()),
                        _ => {}
                    }
                }
                Some(Event::Lost(lost)) if lost == device => {
                    return Err(DeviceError::Lost {
                        device: DEVICE,
                        what: "its driver has ended".into(),
                    });
                }
                Some(_) => {}
                None => {
                    let vector = self.session.require(PLACE)?;
                    let near = vector.number("DEC").is_some_and(|got| (got - dec_deg).abs() < 0.02)
                        && vector.number("RA").is_some_and(|got| {
                            let off = (got - ra_h + 12.0).rem_euclid(24.0) - 12.0;
                            (off * 15.0 * dec_deg.to_radians().cos()).abs() < 0.02
                        });
                    if near {
                        return Ok(());
                    }
                    if soon.now().saturating_sub(begun) >= patience {
                        return Err(declined(DEVICE, request, &said));
                    }
                }
            }
        }
    }

    /// Custom rates, as the driver takes them.
    fn send_rates(&mut self, arcsec_s: [f64; 2], deadline: &Deadline) -> Result<(), DeviceError> {
        // What somebody else did since is not undone.
        if self.is_on(PARK, "PARK") == Some(true) {
            return Err(DeviceError::Taken {
                device: DEVICE,
                what: "the mount was parked by somebody else",
            });
        }
        if self.custom && self.is_on(TRACK, "TRACK_ON") == Some(false) {
            return Err(DeviceError::Taken {
                device: DEVICE,
                what: "the mount was stopped by somebody else",
            });
        }
        let vector = self.session.property(RATE).ok_or(DeviceError::NotReady {
            device: DEVICE,
            reason: "it takes no rates of its own (TELESCOPE_TRACK_RATE): send it to places",
        })?;
        for (name, rate) in RATES.iter().zip(arcsec_s) {
            // Beyond it the simulator answers with an error and goes on at the old rate.
            check_range("rate, arcsec/s", rate, vector.range(name))?;
        }
        // INDI's drivers refuse to turn an axis round while they follow ("Cannot reverse tracking"): by way of zero they take it.
        let mut last = [0.0; 2];
        for (last, name) in last.iter_mut().zip(RATES) {
            *last = vector.number(name).unwrap_or(0.0);
        }
        let turns = [0, 1].map(|axis| last[axis] * arcsec_s[axis] < 0.0);
        let soon = self.soon(deadline);
        let mut send = |rates: [f64; 2]| {
            let wanted = [(RATES[0], rates[0]), (RATES[1], rates[1])];
            self.session.change(RATE, Wanted::Numbers(&wanted), &soon).map(drop)
        };
        if turns.contains(&true) {
            send([0, 1].map(|axis| if turns[axis] { 0.0 } else { last[axis] }))?;
        }
        match send(arcsec_s) {
            // Some drivers (older EQMOD) do not change the gear of an axis that turns: by way of zero they take the rate.
            Err(DeviceError::Declined { .. }) => {
                let changed = [0, 1].map(|axis| last[axis] != arcsec_s[axis]);
                send([0, 1].map(|axis| if changed[axis] { 0.0 } else { last[axis] }))?;
                send(arcsec_s)?;
            }
            done => done?,
        }
        let tracks = self.is_on(TRACK, "TRACK_ON");
        if self.custom && tracks == Some(false) {
            return Err(DeviceError::Taken {
                device: DEVICE,
                what: "the mount was stopped by somebody else",
            });
        }
        if self.custom && self.is_on(MODE, CUSTOM) == Some(true) && tracks == Some(true) {
            return Ok(());
        }
        if self.is_on(MODE, CUSTOM) != Some(true) {
            self.switch(MODE, CUSTOM, deadline)?;
        }
        // Without it the rate is answered with Ok, and nothing moves.
        if self.is_on(TRACK, "TRACK_ON") != Some(true) {
            self.switch(TRACK, "TRACK_ON", deadline)?;
        }
        self.custom = true;
        Ok(())
    }

    /// When it stood there, and its declination.
    fn declination(&mut self, deadline: &Deadline) -> Result<(Epoch, f64), DeviceError> {
        let now = device::Mount::reading(self, deadline)?;
        match now.place {
            MountPlace::Equatorial { dec_deg, .. } => Ok((now.utc, dec_deg)),
            MountPlace::Horizontal { .. } => Err(self.session.protocol("no declination".into())),
        }
    }

    /// Turns in declination there and back, and gives the sense. The rate is that between two places that the mount says while it turns: some say theirs once a second.
    fn try_declination(
        &mut self,
        beat: &dyn Fn(),
        deadline: &Deadline,
    ) -> Result<f64, DeviceError> {
        let (rate, time) = self.settings.test_move;
        let slept = |expired: crate::clock::Expired| DeviceError::transport(DEVICE, expired.into());
        let (_, before) = self.declination(deadline)?;
        // Away from a pole nearby; the stars are followed meanwhile.
        let rate = if before > 80.0 { -rate } else { rate };
        beat();
        self.send_rates([SIDEREAL_ARCSEC_S, rate], deadline)?;
        let begun = deadline.now();
        deadline.sleep(time / 2).map_err(slept)?;
        beat();
        let (from, first) = self.declination(deadline)?;
        deadline.sleep(time).map_err(slept)?;
        beat();
        let (to, last) = self.declination(deadline)?;
        beat();
        let way = deadline.now().saturating_sub(begun);
        self.send_rates([SIDEREAL_ARCSEC_S, -rate], deadline)?;
        deadline.sleep(way).map_err(slept)?;
        beat();
        self.send_rates([SIDEREAL_ARCSEC_S, 0.0], deadline)?;
        beat();
        let seconds = (to - from).to_seconds().max(1e-3);
        let part = (last - first) * 3600.0 / seconds / rate;
        if !(0.3..=3.0).contains(&part.abs()) {
            return Err(DeviceError::NotTaken {
                device: DEVICE,
                name: "rate in declination",
                asked: format!("{rate:.0} arcsec/s"),
                got: format!("{:.1} arcsec/s over {seconds:.1} s", part * rate),
            });
        }
        Ok(part.signum())
    }
}

fn abilities<T: Bytes>(session: &Session<T>) -> MountAbilities {
    let rates = session.property(RATE).map(|vector| {
        let most = RATES.map(|name| {
            let [least, most] = vector
                .range(name)
                .map_or([-SIDEREAL_ARCSEC_S, SIDEREAL_ARCSEC_S], Interval::to_array);
            least.abs().min(most.abs()) / 3600.0
        });
        MountRates::Continuous { most_deg_s: most.into() }
    });
    let has = |name| session.property(name).is_some();
    let made_up = session.property(MADE_UP_PIER.0).and_then(|vector| vector.is_on(MADE_UP_PIER.1));
    let tells_pier_side = has(PIER) && made_up != Some(true);
    let has_mode = has(MODE) && has(TRACK);
    MountAbilities {
        axes: MountAxes::Equatorial,
        // A side of the pier is that of an equatorial mount; of others nobody says.
        turns_about: tells_pier_side.then_some(MountAxes::Equatorial),
        least_deg_s: Axes::default(),
        rates: rates.filter(|_| has_mode).unwrap_or(MountRates::Absent),
        parks: has(PARK),
        syncs: session.property("ON_COORD_SET").is_some_and(|v| v.member("SYNC").is_some()),
        tells_pier_side,
        is_fork: false,
        tells_tracking: has(TRACK),
        refracts: None,
        altitude_deg: None,
    }
}

impl<T: Bytes> Device for Mount<T> {
    fn identity(&mut self, _: &Deadline) -> Result<Identity, DeviceError> {
        self.session.identity()
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
        if let Some(reading) = self.fresh(deadline)? {
            return Ok(reading);
        }
        // It only speaks when something changes: a mount that follows the stars says nothing for seconds.
        let soon = self.soon(deadline);
        let device = self.session.device.clone();
        self.session.require(PLACE)?;
        let vector = self.session.client.refresh(&device, PLACE, &soon)?;
        self.of(&vector, utc_now())
    }

    fn begin_goto(&mut self, place: MountPlace, deadline: &Deadline) -> Result<(), DeviceError> {
        if self.session.property(MODE).is_some() && self.is_on(MODE, SIDEREAL) == Some(false) {
            self.switch(MODE, SIDEREAL, deadline)?;
        }
        self.send_place("TRACK", place, deadline)
    }

    fn sync(&mut self, place: MountPlace, deadline: &Deadline) -> Result<(), DeviceError> {
        if !self.abilities.syncs {
            let reason = "it cannot be told where it points (ON_COORD_SET has no SYNC)";
            return Err(DeviceError::NotReady { device: DEVICE, reason });
        }
        self.send_place("SYNC", place, deadline)
    }

    fn set_tracking(&mut self, on: bool, deadline: &Deadline) -> Result<(), DeviceError> {
        self.custom = false;
        if on && self.is_on(MODE, SIDEREAL) == Some(false) {
            self.switch(MODE, SIDEREAL, deadline)?;
        }
        self.switch(TRACK, if on { "TRACK_ON" } else { "TRACK_OFF" }, deadline)
    }

    fn learn_senses(&mut self, beat: &dyn Fn(), deadline: &Deadline) -> Result<(), DeviceError> {
        self.sense = None;
        let before = self.pier();
        let sense = self.try_declination(beat, deadline).inspect_err(|_| {
            let _ = device::Mount::stop(self, &deadline.grace(self.settings.abort_within));
        })?;
        // Where it turned over meanwhile, what was found holds on neither side.
        let after = self.pier();
        self.sense = Some((sense, after)).filter(|_| before.is_none() || before == after);
        Ok(())
    }

    fn set_rates(&mut self, deg_s: [f64; 2], deadline: &Deadline) -> Result<(), DeviceError> {
        let pier = self.pier();
        let sense = self.sense.filter(|(_, found)| *found == pier).map(|(sense, _)| sense);
        // Zero is zero in any sense.
        let sense = sense.or((deg_s == [0.0; 2]).then_some(1.0));
        let Some(sense) = sense else {
            let reason = "the sense of its declination is not known on this side of the pier: learn it after a goto";
            return Err(DeviceError::NotReady { device: DEVICE, reason });
        };
        let [first, second] = [0, 1].map(|axis| self.abilities.taken_deg_s(axis, deg_s[axis]));
        self.send_rates([first * 3600.0, second * sense * 3600.0], deadline)
    }

    fn stop(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        self.custom = false;
        let device = self.session.device.clone();
        // The switch springs back: that it was answered at all is what counts.
        let wanted = Wanted::Switches(&[(ABORT.1, true)]);
        let soon = self.soon(deadline);
        self.session.client.pulse(&device, ABORT.0, wanted, &soon)?;
        // Some drivers follow the stars again after an abort.
        if self.is_on(TRACK, "TRACK_ON") == Some(true) {
            self.switch(TRACK, "TRACK_OFF", deadline)?;
        }
        Ok(())
    }

    fn set_parked(&mut self, parked: bool, deadline: &Deadline) -> Result<(), DeviceError> {
        if !self.abilities.parks {
            let reason = "it cannot be parked (TELESCOPE_PARK)";
            return Err(DeviceError::NotReady { device: DEVICE, reason });
        }
        let member = if parked { "PARK" } else { "UNPARK" };
        if self.is_on(PARK, member) == Some(true) {
            return Ok(());
        }
        self.custom = false;
        let device = self.session.device.clone();
        let wanted = Wanted::Switches(&[(member, true)]);
        self.session.client.set(&device, PARK, wanted, deadline)?;
        let soon = self.soon(deadline);
        let mut said = Vec::new();
        let request = member.to_lowercase();
        self.session.client.wait(
            &device,
            "the answer to the parking",
            &soon,
            |_, event| match event {
                Event::Message { text, .. } => {
                    hear(&mut said, text);
                    None
                }
                Event::Changed(place, state) if place.device == device && place.name == PARK => {
                    Some(match state {
                        State::Alert => Err(declined(DEVICE, request.clone(), &said)),
                        _ => Ok(()),
                    })
                }
                _ => None,
            },
        )
    }

    fn site(&mut self, _: &Deadline) -> Result<Option<MountSite>, DeviceError> {
        let Some(vector) = self.session.property(SITE) else { return Ok(None) };
        let number = |member| vector.number(member);
        let (Some(latitude_deg), Some(east)) = (number("LAT"), number("LONG")) else {
            return Ok(None);
        };
        let longitude_deg = (east + 180.0).rem_euclid(360.0) - 180.0;
        Ok(Some(MountSite { latitude_deg, longitude_deg, height_m: number("ELEV").unwrap_or(0.0) }))
    }

    /// Sidereal time, where it runs; otherwise what it was told as UTC.
    fn time(&mut self, deadline: &Deadline) -> Result<Option<MountTime>, DeviceError> {
        let device = self.session.device.clone();
        let soon = self.soon(deadline);
        if let Some(before) = self.session.property(SIDEREAL_TIME).and_then(|v| v.number("LST")) {
            let mut now = self.session.client.refresh(&device, SIDEREAL_TIME, &soon)?;
            if now.number("LST") == Some(before) {
                soon.sleep(RUNS_IN)
                    .map_err(|expired| DeviceError::transport(DEVICE, expired.into()))?;
                now = self.session.client.refresh(&device, SIDEREAL_TIME, &soon)?;
            }
            if let Some(hours) = now.number("LST").filter(|hours| *hours != before) {
                let clock = MountClock::SiderealDeg((hours * 15.0).rem_euclid(360.0));
                return Ok(Some(MountTime { utc: utc_now(), clock }));
            }
        }
        let text = self.session.property(TIME).and_then(|vector| vector.text("UTC"));
        // Drivers leave the Z out.
        let set_to = text.map(|text| format!("{}Z", text.trim_end_matches('Z')));
        let set_to = set_to.and_then(|text| parse_utc(&text).ok());
        Ok(set_to.map(|set_to| MountTime { utc: utc_now(), clock: MountClock::SetTo(set_to) }))
    }

    fn set_site(
        &mut self,
        site: MountSite,
        utc: Epoch,
        deadline: &Deadline,
    ) -> Result<(), DeviceError> {
        if self.session.property(TIME).is_some() {
            let soon = self.soon(deadline);
            let text = format_utc(utc, 0);
            let texts = [("UTC", text.trim_end_matches('Z')), ("OFFSET", "0")];
            self.session.change(TIME, Wanted::Texts(&texts), &soon)?;
        }
        if self.session.property(SITE).is_some() {
            let soon = self.soon(deadline);
            let numbers = [
                ("LAT", site.latitude_deg),
                ("LONG", site.longitude_deg.rem_euclid(360.0)),
                ("ELEV", site.height_m),
            ];
            self.session.change(SITE, Wanted::Numbers(&numbers), &soon)?;
        }
        Ok(())
    }
}
