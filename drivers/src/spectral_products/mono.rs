//! A CM110 as a monochromator.

use super::DEVICE;
use super::frame::{Command, Query, Unit};
use super::link::{Link, LinkSettings};
use crate::clock::Deadline;
use crate::device::{
    Device, DeviceError, Identity, Interrupted, Monochromator, Origin, Setting, Value, not_taken,
};
use crate::transport::Bytes;
use std::time::Duration;
use sunglint_numerics::measured::Interval;

/// The largest wavelength that two bytes hold in tenths of a nanometre, nm.
const MOST_NM: f64 = 6553.5;
/// How far from its target it may stand, tenths of a nanometre.
const TOLERANCE: u16 = 1;

/// Settings that the driver needs for the instrument.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MonoSettings {
    /// Wavelengths that may be asked for, nm; `None` leaves it to the instrument.
    pub range_nm: Option<Interval>,
    /// Slowest speed of a slew, nm/s: the deadline of a move is of it.
    pub slew_nm_s: f64,
    /// Time that a move may take beside that.
    pub start: Duration,
    /// Time that turning in another grating may take.
    pub grating_within: Duration,
    /// How long looking where it stands may take after a move that failed: a call ends at most this long after its deadline.
    pub look_within: Duration,
}

impl Default for MonoSettings {
    /// 25 nm/s, a quarter of what a grating of 1200 lines reaches.
    fn default() -> Self {
        Self {
            range_nm: None,
            slew_nm_s: 25.0,
            start: Duration::from_secs(2),
            grating_within: Duration::from_secs(60),
            look_within: Duration::from_secs(2),
        }
    }
}

/// A monochromator, in tenths of a nanometre.
#[derive(Debug)]
pub struct Mono<T> {
    link: Link<T>,
    settings: MonoSettings,
    gratings: u16,
}

impl<T: Bytes> Mono<T> {
    /// Brings the line into step, asks how many gratings there are, and sets the unit to tenths of a nanometre.
    ///
    /// # Errors
    /// An instrument that does not answer, or see [`DeviceError`].
    pub fn open(
        line: T,
        link: LinkSettings,
        settings: MonoSettings,
        deadline: &Deadline,
    ) -> Result<Self, DeviceError> {
        let mut mono = Self { link: Link::new(line, link), settings, gratings: 0 };
        mono.require_unit(deadline)?;
        mono.gratings = mono.steady(Query::Gratings, deadline)?;
        if !(1..=9).contains(&mono.gratings) {
            let reason =
                format!("it says that it has {} gratings: is this a CM110?", mono.gratings);
            return Err(DeviceError::Protocol { device: DEVICE, reason });
        }
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

    /// Number of the grating in use, from 1.
    ///
    /// # Errors
    /// See [`DeviceError`].
    pub fn grating(&mut self, deadline: &Deadline) -> Result<u16, DeviceError> {
        self.steady(Query::Grating, deadline)
    }

    /// Turns in a grating, numbered from 1, which takes up to a minute, and gives the number of the one that then is in.
    ///
    /// # Errors
    /// A number that it does not have, or see [`DeviceError`]. It cannot be stopped.
    pub fn set_grating(&mut self, grating: u16, deadline: &Deadline) -> Result<u16, DeviceError> {
        if !(1..=self.gratings).contains(&grating) {
            return Err(unknown_grating(&grating.to_string(), self.gratings));
        }
        let within = self.settings.grating_within;
        // At most 9.
        match self.link.act(Command::Select(grating as u8), within, deadline) {
            Ok(_) => {}
            Err(error @ DeviceError::Refused { .. }) => return Err(error),
            // Whether it did it is asked below.
            Err(error) if may_pass(&error) => {}
            Err(error) => return Err(error),
        }
        let got = self.grating(deadline)?;
        self.require_unit(deadline)?;
        if got == grating {
            return Ok(got);
        }
        Err(not_taken(DEVICE, "grating", &grating.to_string(), &got.to_string()))
    }

    /// A number that comes twice the same.
    fn steady(&mut self, query: Query, deadline: &Deadline) -> Result<u16, DeviceError> {
        let mut last = None;
        for _ in 0..4 {
            let answer = self.link.ask(query, deadline)?;
            // In another unit a wavelength is another number.
            let unit = answer.status.unit();
            let next = (answer.value, unit);
            if last == Some(next)
                && let (Some(value), true) =
                    (answer.value, query != Query::Position || unit == Some(Unit::Angstrom))
            {
                return Ok(value);
            }
            last = Some(next);
        }
        let reason = match last {
            Some((_, Some(unit))) if query == Query::Position && unit != Unit::Angstrom => {
                "its unit is no longer tenths of a nanometre (was it switched off?): open it again"
                    .to_owned()
            }
            _ => format!("{} reads differently each time", query.name()),
        };
        Err(DeviceError::Protocol { device: DEVICE, reason })
    }

    /// Has it speak in tenths of a nanometre.
    fn require_unit(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        let ours = u16::from(Unit::Angstrom.number());
        if self.steady(Query::Units, deadline)? == ours {
            return Ok(());
        }
        match self.link.act(Command::Units(Unit::Angstrom), Duration::ZERO, deadline) {
            Err(error) if !may_pass(&error) => return Err(error),
            _ => {}
        }
        match self.steady(Query::Units, deadline)? {
            got if got == ours => Ok(()),
            got => Err(not_taken(DEVICE, "unit", &ours.to_string(), &got.to_string())),
        }
    }

    /// Where it stands, tenths of a nanometre.
    fn place(&mut self, deadline: &Deadline) -> Result<u16, DeviceError> {
        self.steady(Query::Position, deadline)
    }

    /// The place of a wavelength that may be asked for.
    fn target(&self, nm: f64) -> Result<u16, DeviceError> {
        let range = self.settings.range_nm.unwrap_or(Interval::new(0.0, MOST_NM));
        let (least, most) = (range.low.max(0.0), range.high.min(MOST_NM));
        if !(least..=most).contains(&nm) {
            let name = "wavelength_nm";
            return Err(DeviceError::OutOfRange { name, asked: nm, least, most });
        }
        // 0 to 65535.
        Ok((nm * 10.0).round() as u16)
    }

    /// Goes there and gives where it then stands.
    fn go(&mut self, target: u16, deadline: &Deadline) -> Result<u16, DeviceError> {
        let mut from = self.place(deadline)?;
        for _ in 0..2 {
            let way_nm = f64::from(from.abs_diff(target)) / 10.0;
            let slew = Duration::try_from_secs_f64(way_nm / self.settings.slew_nm_s);
            let work = self.settings.start.saturating_add(slew.unwrap_or(Duration::MAX));
            match self.link.act(Command::Goto(target), work, deadline) {
                Ok(_) => {}
                // Neither its answer nor that there is none says where it stands: that is asked.
                Err(error) if may_pass(&error) => {
                    deadline
                        .remaining()
                        .map_err(|expired| DeviceError::expired(DEVICE, "the move", expired))?;
                }
                Err(error) => return Err(error),
            }
            from = self.place(deadline)?;
            if from.abs_diff(target) <= TOLERANCE {
                return Ok(from);
            }
        }
        Err(not_taken(DEVICE, "wavelength_nm", &nm(target).to_string(), &nm(from).to_string()))
    }
}

fn nm(place: u16) -> f64 {
    f64::from(place) / 10.0
}

fn unknown_grating(asked: &str, gratings: u16) -> DeviceError {
    let known: Vec<String> = (1..=gratings).map(|number| number.to_string()).collect();
    DeviceError::Unknown { name: "grating", asked: asked.to_owned(), known: known.join(", ") }
}

/// Whether it is worth asking what came of a command: its answer was late, lost or spoilt.
fn may_pass(error: &DeviceError) -> bool {
    match error {
        DeviceError::Protocol { .. } => true,
        DeviceError::Transport { source, .. } => source.is_timeout(),
        _ => false,
    }
}

impl<T: Bytes> Device for Mono<T> {
    fn identity(&mut self, deadline: &Deadline) -> Result<Identity, DeviceError> {
        let serial = self.steady(Query::Serial, deadline)?;
        Ok(Identity {
            vendor: "Spectral Products".into(),
            model: "CM110/CM112".into(),
            serial: Some(serial.to_string()),
            firmware: None,
            driver: "cm110",
        })
    }

    fn settings(&mut self, deadline: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let wavelength_nm = nm(self.place(deadline)?);
        let mut values = vec![("wavelength_nm", Value::Number(wavelength_nm))];
        for (name, query) in [
            ("grating", Query::Grating),
            ("grooves_per_mm", Query::Ruling),
            ("blaze_nm", Query::Blaze),
        ] {
            values.push((name, Value::Integer(i64::from(self.steady(query, deadline)?))));
        }
        values.push(("gratings", Value::Integer(i64::from(self.gratings))));
        let read = |(name, value)| Setting { name, value, origin: Origin::ReadBack };
        Ok(values.into_iter().map(read).collect())
    }

    fn own_settings(&self) -> &'static [(&'static str, &'static str)] {
        &[("grating", "number of a grating, from 1; it takes up to a minute")]
    }

    fn set_own(&mut self, name: &str, value: &str, d: &Deadline) -> Result<Value, DeviceError> {
        if name != "grating" {
            let (asked, known) = (name.to_owned(), "grating".to_owned());
            return Err(DeviceError::Unknown { name: "setting", asked, known });
        }
        let number = value.parse().map_err(|_| unknown_grating(value, self.gratings))?;
        self.set_grating(number, d).map(|got| Value::Integer(i64::from(got)))
    }
}

impl<T: Bytes> Monochromator for Mono<T> {
    fn range_nm(&self) -> Option<Interval> {
        self.settings.range_nm
    }

    fn wavelength_nm(&mut self, deadline: &Deadline) -> Result<f64, DeviceError> {
        self.place(deadline).map(nm)
    }

    /// Goes there. A move that is under way cannot be stopped: where the deadline or the token ends the wait, the error says that it may still be turning.
    fn move_to(
        &mut self,
        wavelength_nm: f64,
        deadline: &Deadline,
    ) -> Result<f64, Interrupted<Option<f64>>> {
        let target = self.target(wavelength_nm).map_err(|error| Interrupted::new(None, error))?;
        self.go(target, deadline).map(nm).map_err(|error| {
            // One that answers stands.
            let stands = self.place(&deadline.grace(self.settings.look_within));
            Interrupted::stopped(DEVICE, error, stands.map(|place| Some(nm(place))))
        })
    }
}
