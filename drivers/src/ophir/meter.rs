//! A power meter with its head: settings, readings, and its traits.

use super::DEVICE;
use super::link::{Link, LinkSettings, spoilt};
use super::reply::{
    Choice, Head, Instrument, Ranges, Reading, ReplyError, Wavelengths, Zeroing, name_nm,
};
use crate::clock::Deadline;
use crate::device::{
    Device, DeviceError, Identity, Origin, Pace, Power, PowerMeter, Repeats, Setting, Update,
    Value, not_taken,
};
use crate::transport::Bytes;
use std::time::Duration;

/// Settings that the driver needs for a meter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MeterSettings {
    /// How long the meter needs for its next measurement after a setting was changed.
    pub settle: Duration,
    /// Whether the unit is asked for after each reading, so that a key pressed on the meter (dBm) cannot go unseen.
    pub guard_unit: bool,
    /// Time from one value of the meter to the next: asked sooner, it tells the last one again.
    pub update: Update,
    /// How often a meter that is zeroing is asked how it stands.
    pub zero_poll: Duration,
    /// How long stopping a zeroing may take: a call ends at most this long after its deadline.
    pub abort_within: Duration,
}

impl Default for MeterSettings {
    fn default() -> Self {
        Self {
            settle: Duration::from_millis(300),
            guard_unit: true,
            // 15 a second.
            update: Update::Measured(Duration::from_nanos(66_666_667)),
            zero_poll: Duration::from_millis(500),
            abort_within: Duration::from_secs(2),
        }
    }
}

/// The filter in front of a photodiode head, as the meter believes it to be. A PD300's takes away about 99 %: with the
/// filter off and the meter believing it on, or the reverse, readings are wrong by about 100.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Filter {
    /// Off.
    Out,
    /// On.
    In,
}

impl Filter {
    /// The word of the meter.
    pub fn name(self) -> &'static str {
        match self {
            Self::Out => "OUT",
            Self::In => "IN",
        }
    }
}

/// A power meter, in watts.
#[derive(Debug)]
pub struct Meter<T> {
    link: Link<T>,
    settings: MeterSettings,
    instrument: Instrument,
    version: String,
    head: Head,
    ranges: Ranges,
    pace: Pace<Reading>,
}

impl<T: Bytes> Meter<T> {
    /// Asks the meter who it is and what its head can do, has it measure power (`$FP` or `$MM2`), and, if it shows dBm, has it choose
    /// its range by itself, which brings back watts.
    ///
    /// # Errors
    /// No head, or one without power ([`DeviceError::NotReady`]); another unit than W ([`DeviceError::NotTaken`]); a meter
    /// that does not answer, or see [`DeviceError`].
    pub fn open(
        line: T,
        link: LinkSettings,
        settings: MeterSettings,
        deadline: &Deadline,
    ) -> Result<Self, DeviceError> {
        let mut link = Link::new(line, link);
        let instrument = link.instrument(deadline)?;
        let version = link.ask("$VE", deadline)?;
        let head = link.ask_as("$HI", Head::parse, deadline)?;
        let not_ready = |reason| Err(DeviceError::NotReady { device: DEVICE, reason });
        if !head.is_there() {
            return not_ready("no head: plug one in, and open the meter again");
        }
        if !head.measures_power() {
            return not_ready("the head measures no power: plug in one that does");
        }
        match link.ask("$FP", deadline) {
            // Newer meters have a number for each mode instead.
            Err(DeviceError::Rejected { .. }) => link.ask("$MM2", deadline)?,
            other => other?,
        };
        let mut ranges = link.ask_as("$AR", Ranges::parse, deadline)?;
        if ranges.is_dbm() {
            link.ask("$WN-1", deadline)?;
            deadline
                .sleep(settings.settle)
                .map_err(|expired| DeviceError::expired(DEVICE, "leaving dBm", expired))?;
            ranges = link.ask_as("$AR", Ranges::parse, deadline)?;
        }
        let pace = Pace::new(settings.update);
        let mut meter = Self { link, settings, instrument, version, head, ranges, pace };
        meter.require_watts(deadline)?;
        Ok(meter)
    }

    /// The head.
    pub fn head(&self) -> &Head {
        &self.head
    }

    /// Account of the readings so far: copies that were thrown away, and the time from one value to the next.
    pub fn repeats(&self) -> Repeats {
        self.pace.repeats()
    }

    /// The line to the meter.
    pub fn line(&self) -> &T {
        self.link.line()
    }

    /// The line to the meter; what is said on it behind the driver's back, the driver does not know.
    pub fn line_mut(&mut self) -> &mut T {
        self.link.line_mut()
    }

    /// The line to the meter.
    pub fn into_line(self) -> T {
        self.link.into_line()
    }

    /// The wavelengths that the head knows, and the one in use.
    ///
    /// # Errors
    /// See [`DeviceError`].
    pub fn wavelengths(&mut self, deadline: &Deadline) -> Result<Wavelengths, DeviceError> {
        self.link.ask_as("$AW", Wavelengths::parse, deadline)
    }

    /// Returns the filter setting that the meter assumes; `None` for a head without.
    ///
    /// # Errors
    /// See [`DeviceError`].
    pub fn filter(&mut self, deadline: &Deadline) -> Result<Option<Filter>, DeviceError> {
        let Some(choice) = self.choice("$FQ", deadline)? else { return Ok(None) };
        filter_of(&choice).map(Some).map_err(|error| spoilt("$FQ", &error))
    }

    /// Tells the meter whether the filter is on; it cannot see that itself.
    ///
    /// # Errors
    /// A head without filter, or see [`DeviceError`].
    pub fn set_filter(&mut self, filter: Filter, deadline: &Deadline) -> Result<(), DeviceError> {
        let number = if filter == Filter::In { 2 } else { 1 };
        self.link.ask(&format!("$FQ{number}"), deadline)?;
        self.settle(deadline)?;
        let got = self.link.ask_as("$FQ", Choice::parse, deadline)?;
        match filter_of(&got) {
            Ok(got) if got == filter => Ok(()),
            _ => Err(not_taken(DEVICE, "filter", filter.name(), got.name())),
        }
    }

    /// The time over which readings are averaged, in the meter's own words, out of those that it has; `None` for a meter
    /// without.
    ///
    /// # Errors
    /// See [`DeviceError`].
    pub fn averaging(&mut self, deadline: &Deadline) -> Result<Option<Choice>, DeviceError> {
        self.choice("$AQ", deadline)
    }

    /// Chooses the time over which readings are averaged, by the name that [`averaging`](Self::averaging) lists.
    ///
    /// # Errors
    /// No such name, or see [`DeviceError`].
    pub fn set_averaging(&mut self, name: &str, deadline: &Deadline) -> Result<(), DeviceError> {
        let choice = self.link.ask_as("$AQ", Choice::parse, deadline)?;
        let place = choice.names.iter().position(|known| known == name);
        let place = place.ok_or_else(|| unknown("averaging", name, &choice.names))?;
        self.link.ask(&format!("$AQ{}", place + 1), deadline)?;
        self.pace.forget();
        self.settle(deadline)?;
        let got = self.link.ask_as("$AQ", Choice::parse, deadline)?;
        if got.index == place {
            return Ok(());
        }
        Err(not_taken(DEVICE, "averaging", name, got.name()))
    }

    /// A list that not every meter or head has: those without refuse.
    fn choice(&mut self, command: &str, d: &Deadline) -> Result<Option<Choice>, DeviceError> {
        match self.link.ask_as(command, Choice::parse, d) {
            Ok(choice) => Ok(Some(choice)),
            Err(DeviceError::Rejected { .. }) => Ok(None),
            Err(error) => Err(error),
        }
    }

    fn settle(&self, deadline: &Deadline) -> Result<(), DeviceError> {
        deadline
            .sleep(self.settings.settle)
            .map_err(|expired| DeviceError::expired(DEVICE, "taking the setting", expired))
    }

    fn require_watts(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        let unit = self.link.ask("$SI", deadline)?;
        if unit == "W" { Ok(()) } else { Err(not_taken(DEVICE, "unit", "W", &unit)) }
    }

    /// The command that brings a wavelength, and the wavelength that it brings, nm.
    fn plan_wavelength(&mut self, nm: f64, d: &Deadline) -> Result<(String, f64), DeviceError> {
        match self.wavelengths(d)? {
            Wavelengths::Continuous { range_nm: [least, most], slots, .. } => {
                if let Some(slot) = slots.iter().position(|slot| *slot == Some(nm)) {
                    return Ok((format!("$WI{}", slot + 1), nm));
                }
                // The meter takes whole nanometres.
                let whole = nm.round();
                if !(least..=most).contains(&whole) {
                    let name = "wavelength_nm";
                    return Err(DeviceError::OutOfRange { name, asked: nm, least, most });
                }
                Ok((format!("$WL{whole:.0}"), whole))
            }
            Wavelengths::Discrete(choice) => {
                let name = choice.names.iter().find(|name| name_nm(name) == Some(nm));
                let name =
                    name.ok_or_else(|| unknown("wavelength_nm", &nm.to_string(), &choice.names))?;
                Ok((format!("$WW{name}"), nm))
            }
        }
    }

    /// Stops a zeroing that did not come to its end; the first error is the one that is told.
    fn abort_zeroing(&mut self, error: DeviceError, deadline: &Deadline) -> DeviceError {
        let grace = deadline.grace(self.settings.abort_within);
        let _ = self.link.ask("$ZA", &grace);
        error
    }

    fn wait_for_zero(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        loop {
            deadline
                .sleep(self.settings.zero_poll)
                .map_err(|expired| DeviceError::expired(DEVICE, "zeroing", expired))?;
            match self.link.ask_as("$ZQ", Zeroing::parse, deadline)? {
                Zeroing::Done => return Ok(()),
                Zeroing::Running => {}
                state => {
                    let said = format!("zeroing {state}");
                    let request = "$ZE".to_owned();
                    return Err(DeviceError::Rejected { device: DEVICE, request, said });
                }
            }
        }
    }
}

fn filter_of(choice: &Choice) -> Result<Filter, ReplyError> {
    match choice.name() {
        "OUT" => Ok(Filter::Out),
        "IN" => Ok(Filter::In),
        other => Err(ReplyError::new(other, "OUT or IN")),
    }
}

fn unknown(name: &'static str, asked: &str, known: &[String]) -> DeviceError {
    DeviceError::Unknown { name, asked: asked.to_owned(), known: known.join(", ") }
}

impl<T: Bytes> Device for Meter<T> {
    fn identity(&mut self, deadline: &Deadline) -> Result<Identity, DeviceError> {
        self.instrument = self.link.instrument(deadline)?;
        Ok(Identity {
            vendor: "Ophir".into(),
            model: self.instrument.name.clone(),
            serial: Some(self.instrument.serial.clone()),
            firmware: Some(self.version.clone()),
            driver: "ophir",
        })
    }

    fn settings(&mut self, deadline: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let head = self.link.ask_as("$HI", Head::parse, deadline)?;
        self.require_watts(deadline)?;
        let ranges = self.link.ask_as("$AR", Ranges::parse, deadline)?;
        let wavelengths = self.wavelengths(deadline)?;
        let filter = self.filter(deadline)?;
        let averaging = self.averaging(deadline)?;
        let mains = self.choice("$MA", deadline)?;
        let text = |text: &str| Value::Text(text.to_owned());
        let wavelength = match &wavelengths {
            Wavelengths::Discrete(choice) => text(choice.name()),
            Wavelengths::Continuous { .. } => {
                wavelengths.in_use_nm().map_or(text("none"), Value::Number)
            }
        };
        let name_or_none =
            |choice: &Option<Choice>| text(choice.as_ref().map_or("none", Choice::name));
        let values = [
            ("head", Value::Text(format!("{} {}", head.kind, head.name))),
            ("head_serial", text(&head.serial)),
            ("unit", text("W")),
            ("range", text(ranges.name())),
            ("wavelength_nm", wavelength),
            ("filter", text(filter.map_or("none", Filter::name))),
            ("averaging", name_or_none(&averaging)),
            ("mains", name_or_none(&mains)),
        ];
        let mut all: Vec<Setting> =
            values.map(|(name, value)| Setting { name, value, origin: Origin::ReadBack }).into();
        let repeats = self.repeats();
        let origin = match self.settings.update {
            _ if repeats.is_measured => Origin::ReadBack,
            Update::Known(_) => Origin::Configured,
            Update::Measured(_) => Origin::Assumed,
        };
        let update_ms = (repeats.period.as_secs_f64() * 1e4).round() / 10.0;
        all.push(Setting { name: "update_ms", value: Value::Number(update_ms), origin });
        Ok(all)
    }

    fn own_settings(&self) -> &'static [(&'static str, &'static str)] {
        &[
            ("filter", "in or out: whether the head's filter is on"),
            ("averaging", "a time that the meter lists"),
        ]
    }

    fn set_own(&mut self, name: &str, value: &str, d: &Deadline) -> Result<Value, DeviceError> {
        match (name, value.to_lowercase().as_str()) {
            ("filter", "in") => self.set_filter(Filter::In, d).map(|()| Value::Text("IN".into())),
            ("filter", "out") => {
                self.set_filter(Filter::Out, d).map(|()| Value::Text("OUT".into()))
            }
            ("filter", _) => Err(unknown("filter", value, &["in".into(), "out".into()])),
            ("averaging", _) => {
                self.set_averaging(value, d).map(|()| Value::Text(value.to_owned()))
            }
            _ => Err(unknown("setting", name, &["filter".into(), "averaging".into()])),
        }
    }
}

impl<T: Bytes> PowerMeter for Meter<T> {
    /// Takes a reading that the meter measured after this call began.
    fn power(&mut self, deadline: &Deadline) -> Result<Power, DeviceError> {
        let Self { pace, link, .. } = self;
        let reading = pace.read(DEVICE, deadline, |d| link.ask_as("$SP", Reading::parse, d))?;
        if self.settings.guard_unit {
            self.require_watts(deadline)?;
        }
        match reading {
            Reading::Over => {
                self.ranges = self.link.ask_as("$AR", Ranges::parse, deadline)?;
                Ok(Power::Over { range_w: self.ranges.end_w() })
            }
            Reading::Value(watts) => {
                // A meter shows a little more than its range, then OVER. Twice the largest is a spoilt line.
                let most = self.ranges.largest_w().unwrap_or(f64::MAX);
                if watts.abs() > 2.0 * most {
                    let reason =
                        format!("it reads {watts:e} W, its largest range ends at {most:e} W");
                    return Err(DeviceError::Protocol { device: DEVICE, reason });
                }
                Ok(Power::Watts(watts))
            }
        }
    }

    fn set_wavelength_nm(
        &mut self,
        wavelength_nm: f64,
        deadline: &Deadline,
    ) -> Result<f64, DeviceError> {
        let (command, expected) = self.plan_wavelength(wavelength_nm, deadline)?;
        self.link.ask(&command, deadline)?;
        self.settle(deadline)?;
        match self.wavelengths(deadline)?.in_use_nm() {
            Some(got) if got == expected => Ok(got),
            got => {
                let got = got.map_or("a name".to_owned(), |nm| nm.to_string());
                Err(not_taken(DEVICE, "wavelength_nm", &expected.to_string(), &got))
            }
        }
    }

    fn ranges(&mut self, deadline: &Deadline) -> Result<Vec<String>, DeviceError> {
        self.ranges = self.link.ask_as("$AR", Ranges::parse, deadline)?;
        // In dBm nothing here can measure.
        Ok(self.ranges.names.iter().filter(|name| *name != "dBm").cloned().collect())
    }

    fn set_range(&mut self, range: &str, deadline: &Deadline) -> Result<String, DeviceError> {
        let known = self.ranges(deadline)?;
        let number = self.ranges.number_of(range).filter(|number| *number >= -1);
        let number = number.ok_or_else(|| unknown("range", range, &known))?;
        self.link.ask(&format!("$WN{number}"), deadline)?;
        self.settle(deadline)?;
        self.ranges = self.link.ask_as("$AR", Ranges::parse, deadline)?;
        let got = self.ranges.name();
        if got == range {
            Ok(range.to_owned())
        } else {
            Err(not_taken(DEVICE, "range", range, got))
        }
    }

    fn zero(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        self.link.ask("$ZE", deadline)?;
        self.wait_for_zero(deadline).map_err(|error| match error {
            DeviceError::TooSlow { .. }
            | DeviceError::Cancelled { .. }
            | DeviceError::Transport { .. } => self.abort_zeroing(error, deadline),
            other => other,
        })
    }
}

impl<T: Bytes> Meter<T> {
    /// Keeps the zero of the last [`zero`](PowerMeter::zero) in the meter, beyond its next start (`$ZS`).
    ///
    /// # Errors
    /// See [`DeviceError`].
    pub fn save_zero(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        self.link.ask("$ZS", deadline).map(|_| ())
    }
}
