//! Settings and readings of meters, sources and power meters that a file describes.

use super::definition::{AUTO, Definition, DeviceKind, Fresh, Read, SettingPlan};
use super::link::Link;
use super::names::{Takes, kept_list};
use super::pattern::Captured;
use super::reply::{Given, number_at_start};
use crate::clock::Deadline;
use crate::device::{DeviceError, Identity, Level, Origin, Setting, Value, not_taken};

/// Relative difference of two numbers that are one: what a device's six digits leave.
const SAME: f64 = 2e-6;

/// Values that a person gives because the device cannot be asked.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Told {
    /// Name of the amplifier's gain.
    pub gain: Option<String>,
    /// Wavelength of the light, nm.
    pub wavelength_nm: Option<f64>,
}

/// An instrument on its link.
#[derive(Debug)]
pub(super) struct Instrument {
    pub link: Link,
    pub about: Definition,
    driver: &'static str,
    /// The gain, V/A, and its name.
    gain: Option<(String, f64)>,
    pub wavelength_nm: Option<f64>,
    own: Takes,
}

/// A reading in the unit of `[read]`.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Raw {
    Number(f64),
    Over,
}

impl Instrument {
    pub fn open(
        mut link: Link,
        about: Definition,
        driver: &'static str,
        kind: DeviceKind,
        told: &Told,
        deadline: &Deadline,
    ) -> Result<Self, DeviceError> {
        let device = about.name;
        if about.kind != kind {
            let reason = "its file describes a device of another kind: use the driver scpi-meter, scpi-source or scpi-power-meter, as its `kind` says";
            return Err(DeviceError::NotReady { device, reason });
        }
        if let Some(read) = &about.read
            && !link.is_checked()
            && matches!(read.fresh, Fresh::Trigger)
            && read.again.is_none()
            && read.agree.is_none()
        {
            let reason = "a serial line does not notice a digit that it alters: the file's [read] needs `again`, a question that repeats the last reading, or `agree`";
            return Err(DeviceError::NotReady { device, reason });
        }
        let built_in: &[&str] = match kind {
            DeviceKind::Meter => &[],
            DeviceKind::Source => &["level", "output"],
            DeviceKind::PowerMeter => &["range", "wavelength_nm"],
        };
        let mut own: Vec<(&'static str, &'static str)> = about
            .settings
            .iter()
            .map(|setting| (setting.name, setting.takes))
            .filter(|(name, _)| !built_in.contains(name))
            .collect();
        if about.gain.is_some() {
            own.push((
                "gain",
                "a name of the amplifier's gains: tells, as the amplifier is set by hand",
            ));
        }
        link.instrument(deadline)?;
        let (lines, settle) = &about.open;
        if !lines.is_empty() {
            let lines: Vec<&str> = lines.iter().map(String::as_str).collect();
            link.tell(&lines, deadline)?;
        }
        deadline.sleep(*settle).map_err(|e| DeviceError::expired(device, "settling", e))?;
        let own = kept_list(&own);
        let mut this = Self { link, driver, gain: None, wavelength_nm: None, own, about };
        let gain = told.gain.clone().or_else(|| this.about.gain.as_ref()?.is.clone());
        if let Some(gain) = gain {
            this.set_gain(&gain)?;
        }
        if let Some(nm) = told.wavelength_nm {
            if this.about.response.is_none() {
                let reason = "its file has no table [response], which a wavelength would choose from: set the device's own instead";
                return Err(DeviceError::NotReady { device, reason });
            }
            this.use_wavelength(nm)?;
        } else {
            this.wavelength_nm = this.about.wavelength_nm;
        }
        Ok(this)
    }

    fn device(&self) -> &'static str {
        self.about.name
    }

    pub fn identity(&mut self, deadline: &Deadline) -> Result<Identity, DeviceError> {
        let Captured { vendor, model, serial, firmware, .. } = self.link.who(deadline)?;
        Ok(Identity {
            vendor: vendor.unwrap_or_else(|| "unknown".to_owned()),
            model: model.unwrap_or_else(|| self.about.name.to_owned()),
            serial,
            firmware,
            driver: self.driver,
        })
    }

    pub fn own_settings(&self) -> Takes {
        self.own
    }

    pub fn settings(&mut self, deadline: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let mut all = vec![
            told("definition", Value::Text(self.about.name.to_owned())),
            told("unit", Value::Text(self.about.unit.clone())),
        ];
        for plan in self.about.settings.clone() {
            if plan.ask.is_some() {
                let value = self.get(&plan, deadline)?;
                all.push(Setting { name: plan.name, value, origin: Origin::ReadBack });
            }
        }
        if let Some((name, v_per_a)) = &self.gain {
            all.push(told("gain", Value::Text(name.clone())));
            all.push(told("gain_v_per_a", Value::Number(*v_per_a)));
        }
        if let (Some(response), Some(nm)) = (&self.about.response, self.wavelength_nm) {
            all.push(told("wavelength_nm", Value::Number(nm)));
            let a_per_w = response.a_per_w(nm);
            all.extend(a_per_w.map(|a_per_w| told("responsivity_a_per_w", Value::Number(a_per_w))));
        }
        Ok(all)
    }

    /// The setting of that name, if the file has it.
    pub fn plan(&self, name: &str) -> Option<SettingPlan> {
        self.about.settings.iter().find(|setting| setting.name == name).cloned()
    }

    pub fn set_own(
        &mut self,
        name: &str,
        value: &str,
        deadline: &Deadline,
    ) -> Result<Value, DeviceError> {
        if name == "gain" && self.about.gain.is_some() {
            return self.set_gain(value);
        }
        let known = self.own.iter().any(|(own, _)| *own == name);
        let Some(plan) = self.plan(name).filter(|_| known) else {
            let known: Vec<&str> = self.own.iter().map(|(name, _)| *name).collect();
            let known = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
            return Err(DeviceError::Unknown { name: "setting", asked: name.to_owned(), known });
        };
        self.set_text(&plan, value, deadline)
    }

    fn set_gain(&mut self, name: &str) -> Result<Value, DeviceError> {
        let Some(gain) = &self.about.gain else {
            let reason = "its file has no table [gain]";
            return Err(DeviceError::NotReady { device: self.about.name, reason });
        };
        let found = gain.v_per_a.iter().find(|(known, _)| known == name);
        let Some(found) = found.cloned() else {
            return Err(self.no_gain(&format!("`{name}`")));
        };
        self.gain = Some(found);
        Ok(Value::Text(name.to_owned()))
    }

    fn no_gain(&self, asked: &str) -> DeviceError {
        let gains = self.about.gain.iter().flat_map(|gain| &gain.v_per_a);
        let known: Vec<&str> = gains.map(|(name, _)| name.as_str()).collect();
        DeviceError::Unknown { name: "gain", asked: asked.to_owned(), known: known.join(", ") }
    }

    /// Takes a wavelength for the responsivity.
    pub fn use_wavelength(&mut self, nm: f64) -> Result<f64, DeviceError> {
        let Some(response) = &self.about.response else { return Ok(nm) };
        if response.a_per_w(nm).is_none() {
            let [least, most] = response.ends_nm().to_array();
            return Err(DeviceError::OutOfRange { name: "wavelength_nm", asked: nm, least, most });
        }
        self.wavelength_nm = Some(nm);
        Ok(nm)
    }

    /// Sets what a person wrote.
    pub fn set_text(
        &mut self,
        plan: &SettingPlan,
        value: &str,
        deadline: &Deadline,
    ) -> Result<Value, DeviceError> {
        let unknown = |known: String| DeviceError::Unknown {
            name: plan.name,
            asked: format!("`{value}`"),
            known,
        };
        if plan.names.is_empty() {
            let number = value.parse().ok().filter(|number: &f64| number.is_finite());
            let number = number.ok_or_else(|| unknown(plan.takes.to_owned()))?;
            return self.set_number(plan, number, deadline).map(Value::Number);
        }
        let commands = if let Some(auto) = plan.auto.as_ref().filter(|_| value == AUTO) {
            auto.send.clone()
        } else {
            let named = plan.names.iter().find(|named| named.name == value);
            let named = named.ok_or_else(|| unknown(plan.known().join(", ")))?;
            plan.send.replace("{value}", &named.sent)
        };
        self.apply(plan, &commands, deadline)?;
        if plan.ask.is_none() {
            return Ok(Value::Text(value.to_owned()));
        }
        let got = self.get(plan, deadline)?;
        if got == Value::Text(value.to_owned()) {
            return Ok(got);
        }
        Err(not_taken(self.device(), plan.name, value, &got.to_string()))
    }

    /// Sets a number and gives the number that the device then has, which differs by its resolution at most.
    pub fn set_number(
        &mut self,
        plan: &SettingPlan,
        number: f64,
        deadline: &Deadline,
    ) -> Result<f64, DeviceError> {
        let SettingPlan { name, least, most, scale, .. } = *plan;
        if !number.is_finite() || !(least..=most).contains(&number) {
            return Err(DeviceError::OutOfRange { name, asked: number, least, most });
        }
        let command = plan.send.replace("{value}", &format!("{:E}", number / scale));
        let close = |got: f64| {
            let room = plan.resolution.unwrap_or(0.0).max(SAME * number.abs());
            (got - number).abs() <= room * (1.0 + SAME)
        };
        let mut last = number;
        // A command that a line altered into another that the device understands is sent once more.
        for _ in 0..2 {
            self.apply(plan, &command, deadline)?;
            if plan.ask.is_none() {
                return Ok(number);
            }
            match self.get(plan, deadline)? {
                Value::Number(got) if close(got) => return Ok(got),
                Value::Number(got) => last = got,
                other => {
                    return Err(not_taken(
                        self.device(),
                        name,
                        &number.to_string(),
                        &other.to_string(),
                    ));
                }
            }
            if self.link.is_checked() {
                break;
            }
        }
        Err(not_taken(self.device(), name, &number.to_string(), &last.to_string()))
    }

    fn apply(
        &mut self,
        plan: &SettingPlan,
        command: &str,
        deadline: &Deadline,
    ) -> Result<(), DeviceError> {
        self.link.tell(&[command], deadline)?;
        let settled = deadline.sleep(plan.settle);
        settled.map_err(|expired| DeviceError::expired(self.about.name, "settling", expired))
    }

    /// Asks for a setting.
    pub fn get(&mut self, plan: &SettingPlan, deadline: &Deadline) -> Result<Value, DeviceError> {
        let Some(ask) = &plan.ask else {
            let reason = "its file has no `ask` for this setting";
            return Err(DeviceError::NotReady { device: self.device(), reason });
        };
        if let Some(auto) = &plan.auto {
            let said = self.link.ask_surely(&auto.ask, |said| Ok(said.to_owned()), deadline)?;
            if is_same(&said, &auto.on) {
                return Ok(Value::Text(AUTO.to_owned()));
            }
        }
        let of = |answer: &str| {
            let found = plan.expect.of(answer);
            found.ok_or_else(|| format!("`{}`", plan.expect.source()))
        };
        let found = self.link.ask_surely(ask, of, deadline)?;
        let said = match (found.value, found.word) {
            (Some(number), _) => match Given::of(number, f64::INFINITY) {
                Given::Number(number) if plan.names.is_empty() => {
                    return Ok(Value::Number(number * plan.scale));
                }
                Given::Number(number) => format!("{number:E}"),
                Given::Over | Given::NotANumber => return Err(self.not_a_number(ask)),
            },
            (None, Some(word)) => word,
            // A pattern of a setting has one of both.
            (None, None) => String::new(),
        };
        let named = plan.names.iter().find(|named| is_same(&named.sent, &said));
        named.map(|named| Value::Text(named.name.clone())).ok_or_else(|| DeviceError::Protocol {
            device: self.about.name,
            reason: format!(
                "the answer to {ask}: found {said}, expected one of {}: the file's names do not have it",
                plan.names.iter().map(|named| named.sent.as_str()).collect::<Vec<_>>().join(", ")
            ),
        })
    }

    fn not_a_number(&self, question: &str) -> DeviceError {
        let reason =
            format!("the answer to {question}: 9.91E37, which is SCPI's sign for no number");
        DeviceError::Protocol { device: self.about.name, reason }
    }

    /// Takes a new reading and gives it in the file's unit: through the amplifier, and for a power meter through the responsivity.
    pub fn level(&mut self, deadline: &Deadline) -> Result<Level, DeviceError> {
        // What cannot be told is said before the device is asked.
        let mut factor = 1.0;
        if self.about.gain.is_some() {
            let Some((_, v_per_a)) = &self.gain else {
                return Err(self.no_gain("none (tell it: --with gain=NAME)"));
            };
            factor /= v_per_a;
        }
        if let Some(response) = &self.about.response {
            let Some(a_per_w) = self.wavelength_nm.and_then(|nm| response.a_per_w(nm)) else {
                let device = self.device();
                let reason = "it needs the wavelength of the light: --with wavelength_nm=NM";
                return Err(DeviceError::NotReady { device, reason });
            };
            factor /= a_per_w;
        }
        Ok(match self.raw(deadline)? {
            Raw::Number(number) => Level::Value(number * factor),
            Raw::Over => Level::Over,
        })
    }

    fn raw(&mut self, deadline: &Deadline) -> Result<Raw, DeviceError> {
        /// How often a reading is taken until it is confirmed.
        const TRIES: usize = 6;
        let device = self.device();
        let Some(read) = self.about.read.clone() else {
            let reason = "its file has no table [read]";
            return Err(DeviceError::NotReady { device, reason });
        };
        let sleep = |time, action| {
            deadline.sleep(time).map_err(|expired| DeviceError::expired(device, action, expired))
        };
        // A device that measures by itself shows what it measured before: the next value but one began after this call.
        if let Fresh::Poll { wait } = read.fresh {
            sleep(wait, "waiting for a new value")?;
        }
        let mut before: Option<Raw> = None;
        for _ in 0..TRIES {
            if !read.first.is_empty() {
                let first: Vec<&str> = read.first.iter().map(String::as_str).collect();
                self.link.tell(&first, deadline)?;
            }
            sleep(read.settle, "settling")?;
            let found = self.ask_reading(&read, &read.send, deadline)?;
            if self.link.is_checked() {
                return Ok(found);
            }
            match (&read.again, read.agree, read.fresh) {
                // The device says the same reading once more.
                (Some(again), _, _) => {
                    if self.ask_reading(&read, again, deadline)? == found {
                        return Ok(found);
                    }
                }
                (None, Some(within), _) => {
                    if before.is_some_and(|before| agree(before, found, within)) {
                        return Ok(found);
                    }
                    before = Some(found);
                }
                // The value stands until the next one, so that one of a few pairs is the same.
                (None, None, _) => {
                    if self.ask_reading(&read, &read.send, deadline)? == found {
                        return Ok(found);
                    }
                }
            }
        }
        let reason =
            format!("of {TRIES} readings none was said twice: a bad line, or unsteady light");
        Err(DeviceError::Protocol { device, reason })
    }

    fn ask_reading(
        &mut self,
        read: &Read,
        question: &str,
        deadline: &Deadline,
    ) -> Result<Raw, DeviceError> {
        let given = self.link.ask_as(
            question,
            |answer| {
                if read.overflow_word.as_deref() == Some(answer) {
                    return Ok(Given::Over);
                }
                let value = read.expect.of(answer).and_then(|found| found.value);
                let value = value.ok_or_else(|| format!("`{}`", read.expect.source()))?;
                Ok(Given::of(value, read.overflow))
            },
            deadline,
        )?;
        match given {
            Given::Number(number) => Ok(Raw::Number(number * read.scale)),
            Given::Over => Ok(Raw::Over),
            Given::NotANumber => Err(self.not_a_number(question)),
        }
    }
}

fn told(name: &'static str, value: Value) -> Setting {
    Setting { name, value, origin: Origin::Configured }
}

fn agree(one: Raw, other: Raw, (relative, absolute): (f64, f64)) -> bool {
    match (one, other) {
        (Raw::Number(a), Raw::Number(b)) => {
            (a - b).abs() <= (relative * a.abs().max(b.abs())).max(absolute)
        }
        (one, other) => one == other,
    }
}

/// Whether two words are the same, or two numbers (`2E-9`, `2.000000E-09`).
fn is_same(one: &str, other: &str) -> bool {
    let whole = |text: &str| match number_at_start(text.trim()) {
        Some((number, "")) => Some(number),
        _ => None,
    };
    match (whole(one), whole(other)) {
        (Some(a), Some(b)) => (a - b).abs() <= SAME * a.abs().max(b.abs()),
        _ => one.trim() == other.trim(),
    }
}
