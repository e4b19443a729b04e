//! An Acton monochromator: moves, gratings, and its traits.

use super::DEVICE;
use super::link::{Link, LinkSettings};
use super::reply::{self, Grating};
use crate::clock::Deadline;
use crate::device::{
    Device, DeviceError, Identity, Interrupted, Monochromator, Origin, Setting, Value, not_taken,
};
use crate::reply::ReplyError;
use crate::transport::Bytes;
use std::time::Duration;
use sunglint_numerics::measured::Interval;

/// How it goes to a wavelength.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Motion {
    /// At full speed (`GOTO`): it cannot be stopped on the way.
    Goto,
    /// With the speed that is set in nm/min (`>NM`): it can be stopped.
    Scan,
}

/// Settings that the driver needs for the instrument.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MonoSettings {
    /// Wavelengths that may be asked for, nm; `None` leaves it to the instrument.
    pub range_nm: Option<Interval>,
    /// How it goes to a wavelength.
    pub motion: Motion,
    /// Slowest speed of `GOTO`, nm/s: the deadline of a move is of it.
    pub slew_nm_s: f64,
    /// Time that a move may take beside that.
    pub start: Duration,
    /// How far from its target it may stand, nm.
    pub tolerance_nm: f64,
    /// Time that turning in another grating may take.
    pub grating_within: Duration,
    /// How often a scan that is under way is asked whether it is there.
    pub poll: Duration,
    /// How long stopping, and looking where it stands, may take after a move that failed: a call ends at most this long after its deadline.
    pub stop_within: Duration,
}

impl Default for MonoSettings {
    fn default() -> Self {
        Self {
            range_nm: None,
            motion: Motion::Goto,
            slew_nm_s: 10.0,
            start: Duration::from_secs(5),
            tolerance_nm: 0.05,
            grating_within: Duration::from_secs(60),
            poll: Duration::from_millis(100),
            stop_within: Duration::from_secs(3),
        }
    }
}

/// A monochromator.
#[derive(Debug)]
pub struct Mono<T> {
    link: Link<T>,
    settings: MonoSettings,
    model: String,
    serial: String,
    gratings: Vec<Grating>,
}

impl<T: Bytes> Mono<T> {
    /// Asks the instrument who it is and which gratings it has.
    ///
    /// # Errors
    /// An instrument that does not answer, or see [`DeviceError`].
    pub fn open(
        line: T,
        link: LinkSettings,
        settings: MonoSettings,
        deadline: &Deadline,
    ) -> Result<Self, DeviceError> {
        let mut link = Link::new(line, link);
        // The second time it has to be what it was the first time.
        link.model(deadline)?;
        let model = link.model(deadline)?;
        let (serial, gratings) = (String::new(), Vec::new());
        let mut mono = Self { link, settings, model, serial, gratings };
        let word = |body: &str| match !body.is_empty()
            && body.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'-')
        {
            true => Ok(body.to_owned()),
            false => Err(ReplyError::new(body, "a serial number")),
        };
        mono.serial = mono.steady("SERIAL", word, deadline)?;
        mono.gratings = mono.steady("?GRATINGS", reply::gratings, deadline)?;
        Ok(mono)
    }

    /// The line to the instrument.
    pub fn line(&self) -> &T {
        self.link.line()
    }

    /// The line to the instrument; what is said on it behind the driver's back, the driver does not know.
    pub fn line_mut(&mut self) -> &mut T {
        self.link.line_mut()
    }

    /// The line to the instrument.
    pub fn into_line(self) -> T {
        self.link.into_line()
    }

    /// Gratings that are installed.
    pub fn gratings(&self) -> &[Grating] {
        &self.gratings
    }

    /// Number of the grating in use, from 1.
    ///
    /// # Errors
    /// See [`DeviceError`].
    pub fn grating(&mut self, deadline: &Deadline) -> Result<u8, DeviceError> {
        self.steady("?GRATING", reply::grating, deadline)
    }

    /// Turns in a grating, which takes up to a minute, and gives the number of the one that then is in.
    ///
    /// # Errors
    /// A number that it does not have, or see [`DeviceError`]. It cannot be stopped.
    pub fn set_grating(&mut self, grating: u8, deadline: &Deadline) -> Result<u8, DeviceError> {
        if !self.gratings.iter().any(|known| known.number == grating) {
            return Err(self.unknown_grating(&grating.to_string()));
        }
        let within = self.settings.grating_within;
        let done = self.link.act(&format!("{grating} GRATING"), within, deadline);
        // Neither its answer nor that there is none says which one is in: that is asked.
        done.or_else(|error| if may_pass(&error) { Ok(()) } else { Err(error) })?;
        let got = self.grating(deadline)?;
        if got == grating {
            return Ok(got);
        }
        Err(not_taken(DEVICE, "grating", &grating.to_string(), &got.to_string()))
    }

    /// Speed of a scan, nm/min.
    ///
    /// # Errors
    /// See [`DeviceError`].
    pub fn speed_nm_min(&mut self, deadline: &Deadline) -> Result<f64, DeviceError> {
        self.steady("?NM/MIN", reply::speed_nm_min, deadline)
    }

    /// Sets the speed of a scan, nm/min, and gives the speed that it then has.
    ///
    /// # Errors
    /// A speed that is none or that it does not take, or see [`DeviceError`].
    pub fn set_speed_nm_min(
        &mut self,
        speed: f64,
        deadline: &Deadline,
    ) -> Result<f64, DeviceError> {
        let (least, most) = (0.01, 1e5);
        if !(least..=most).contains(&speed) {
            let name = "speed_nm_min";
            return Err(DeviceError::OutOfRange { name, asked: speed, least, most });
        }
        let done = self.link.act(&format!("{speed:.3} NM/MIN"), Duration::ZERO, deadline);
        done.or_else(|error| if may_pass(&error) { Ok(()) } else { Err(error) })?;
        let got = self.speed_nm_min(deadline)?;
        // It takes steps of its own.
        if (got - speed).abs() <= 0.01 * speed {
            return Ok(got);
        }
        Err(not_taken(DEVICE, "speed_nm_min", &speed.to_string(), &got.to_string()))
    }

    /// An answer that comes twice the same.
    fn steady<V: PartialEq>(
        &mut self,
        command: &str,
        parse: impl Fn(&str) -> Result<V, ReplyError>,
        deadline: &Deadline,
    ) -> Result<V, DeviceError> {
        let mut last = self.link.ask(command, &parse, deadline)?;
        for _ in 0..3 {
            let next = self.link.ask(command, &parse, deadline)?;
            if next == last {
                return Ok(next);
            }
            last = next;
        }
        let reason = format!("it answers {command} differently each time");
        Err(DeviceError::Protocol { device: DEVICE, reason })
    }

    /// Where it stands, nm.
    fn place(&mut self, deadline: &Deadline) -> Result<f64, DeviceError> {
        self.steady("?NM", reply::wavelength_nm, deadline)
    }

    fn unknown_grating(&self, asked: &str) -> DeviceError {
        let known: Vec<String> = self
            .gratings
            .iter()
            .map(|known| format!("{} ({})", known.number, known.about))
            .collect();
        DeviceError::Unknown { name: "grating", asked: asked.to_owned(), known: known.join(", ") }
    }

    /// The time in which it has to be there.
    fn work(&self, way_nm: f64, speed_nm_s: f64) -> Duration {
        let slew = Duration::try_from_secs_f64(way_nm / speed_nm_s).unwrap_or(Duration::MAX);
        self.settings.start.saturating_add(slew)
    }

    /// Goes there and gives where it then stands.
    fn go(&mut self, target: f64, deadline: &Deadline) -> Result<f64, DeviceError> {
        let mut at = self.place(deadline)?;
        for again in [false, true] {
            let way_nm = (at - target).abs();
            let gone = match self.settings.motion {
                Motion::Goto => {
                    let work = self.work(way_nm, self.settings.slew_nm_s);
                    self.link.act(&format!("{target:.3} GOTO"), work, deadline)
                }
                Motion::Scan => self.scan(target, way_nm, deadline),
            };
            match gone {
                Ok(()) => {}
                Err(error @ DeviceError::Rejected { .. }) if again => return Err(error),
                // Neither its answer nor that there is none says where it stands: that is asked.
                Err(error) if may_pass(&error) => {
                    deadline
                        .remaining()
                        .map_err(|expired| DeviceError::expired(DEVICE, "the move", expired))?;
                }
                Err(error) => return Err(error),
            }
            at = self.place(deadline)?;
            if (at - target).abs() <= self.settings.tolerance_nm {
                return Ok(at);
            }
        }
        Err(not_taken(DEVICE, "wavelength_nm", &target.to_string(), &at.to_string()))
    }

    /// Goes there with the speed that is set, and looks on.
    fn scan(&mut self, target: f64, way_nm: f64, deadline: &Deadline) -> Result<(), DeviceError> {
        let speed_nm_s = self.speed_nm_min(deadline)? / 60.0;
        // Twice the time that it takes at this speed.
        let work = self.work(2.0 * way_nm, speed_nm_s);
        let moving = deadline.at_most(work);
        let expired = |expired| DeviceError::expired(DEVICE, "the move", expired);
        // Whether it was understood shows in what it does.
        let sent = self.link.act(&format!("{target:.3} >NM"), Duration::ZERO, deadline);
        sent.or_else(|error| if may_pass(&error) { Ok(()) } else { Err(error) })?;
        while !self.steady_done(deadline)? {
            moving.sleep(self.settings.poll).map_err(expired)?;
        }
        self.link.act("MONO-STOP", Duration::ZERO, deadline)
    }

    /// Whether it has arrived; a yes is asked for twice.
    fn steady_done(&mut self, deadline: &Deadline) -> Result<bool, DeviceError> {
        Ok(self.link.ask("MONO-?DONE", reply::is_done, deadline)?
            && self.link.ask("MONO-?DONE", reply::is_done, deadline)?)
    }

    /// Stops a scan, and looks where it stands.
    fn halt(&mut self, deadline: &Deadline) -> Result<Option<f64>, DeviceError> {
        if self.settings.motion == Motion::Scan {
            let stop = |mono: &mut Self| mono.link.act("MONO-STOP", Duration::ZERO, deadline);
            stop(self).or_else(|error| if may_pass(&error) { stop(self) } else { Err(error) })?;
        }
        self.place(deadline).map(Some)
    }
}

/// Whether it is worth asking what came of a command: its answer was late, lost or spoilt.
fn may_pass(error: &DeviceError) -> bool {
    match error {
        DeviceError::Protocol { .. } | DeviceError::Rejected { .. } => true,
        DeviceError::Transport { source, .. } => source.is_timeout(),
        _ => false,
    }
}

impl<T: Bytes> Device for Mono<T> {
    fn identity(&mut self, deadline: &Deadline) -> Result<Identity, DeviceError> {
        self.model = self.link.model(deadline)?;
        Ok(Identity {
            vendor: "Princeton Instruments (Acton)".into(),
            model: self.model.clone(),
            serial: Some(self.serial.clone()),
            firmware: None,
            driver: "sp2150",
        })
    }

    fn settings(&mut self, deadline: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let wavelength_nm = self.place(deadline)?;
        let number = self.grating(deadline)?;
        let speed = self.speed_nm_min(deadline)?;
        let about = self.gratings.iter().find(|known| known.number == number);
        let about = about.map_or("not in its list", |grating| grating.about.as_str());
        let values = [
            ("wavelength_nm", Value::Number(wavelength_nm)),
            ("grating", Value::Integer(i64::from(number))),
            ("grating_about", Value::Text(about.to_owned())),
            ("speed_nm_min", Value::Number(speed)),
            ("echo", Value::Flag(self.link.echoes())),
        ];
        Ok(values.map(|(name, value)| Setting { name, value, origin: Origin::ReadBack }).into())
    }

    fn own_settings(&self) -> &'static [(&'static str, &'static str)] {
        &[
            ("grating", "number of a grating, from 1; it takes up to a minute"),
            ("speed_nm_min", "speed of a scan, nm/min"),
        ]
    }

    fn set_own(&mut self, name: &str, value: &str, d: &Deadline) -> Result<Value, DeviceError> {
        match name {
            "grating" => {
                let number = value.parse().map_err(|_| self.unknown_grating(value))?;
                self.set_grating(number, d).map(|got| Value::Integer(i64::from(got)))
            }
            "speed_nm_min" => {
                let (asked, known) = (format!("`{value}`"), "a speed in nm/min".to_owned());
                let bad = DeviceError::Unknown { name: "speed_nm_min", asked, known };
                let speed = value.parse().map_err(|_| bad)?;
                self.set_speed_nm_min(speed, d).map(Value::Number)
            }
            _ => {
                let (asked, known) = (name.to_owned(), "grating, speed_nm_min".to_owned());
                Err(DeviceError::Unknown { name: "setting", asked, known })
            }
        }
    }
}

impl<T: Bytes> Monochromator for Mono<T> {
    fn range_nm(&self) -> Option<Interval> {
        self.settings.range_nm
    }

    fn wavelength_nm(&mut self, deadline: &Deadline) -> Result<f64, DeviceError> {
        self.place(deadline)
    }

    /// Goes there. A [`Motion::Goto`] that is under way cannot be stopped: where the deadline or the token ends the wait, the error says that it may still be
    /// turning.
    fn move_to(
        &mut self,
        wavelength_nm: f64,
        deadline: &Deadline,
    ) -> Result<f64, Interrupted<Option<f64>>> {
        // Beyond that its own words would not say the same number.
        let range = self.settings.range_nm.unwrap_or(Interval::new(-100.0, 20_000.0));
        if !(range.low..=range.high).contains(&wavelength_nm) {
            let (least, most) = (range.low, range.high);
            let name = "wavelength_nm";
            let error = DeviceError::OutOfRange { name, asked: wavelength_nm, least, most };
            return Err(Interrupted::new(None, error));
        }
        self.go(wavelength_nm, deadline).map_err(|error| {
            let halted = self.halt(&deadline.grace(self.settings.stop_within));
            Interrupted::stopped(DEVICE, error, halted)
        })
    }
}
