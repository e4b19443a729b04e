//! The three kinds of device.

use super::definition::{Definition, DeviceKind};
use super::instrument::{Instrument, Told};
use super::link::Link;
use crate::clock::Deadline;
use crate::device::{
    Device, DeviceError, Identity, Level, Meter, Power, PowerMeter, Setting, Source, Value,
};
use sunglint_numerics::measured::Interval;

macro_rules! device {
    ($(#[doc = $doc:literal])* $name:ident, $kind:ident, $driver:literal) => {
        $(#[doc = $doc])*
        #[derive(Debug)]
        pub struct $name(Instrument);

        impl $name {
            /// Opens the device: asks who it is, and sends what its file says is sent at opening.
            ///
            /// # Errors
            /// A file of another kind, a file that has too little for this line, a device that is another or does not answer, or see [`DeviceError`].
            pub fn open(
                link: Link,
                about: Definition,
                told: &Told,
                deadline: &Deadline,
            ) -> Result<Self, DeviceError> {
                let kind = DeviceKind::$kind;
                Instrument::open(link, about, $driver, kind, told, deadline).map(Self)
            }
        }

        impl Device for $name {
            fn identity(&mut self, deadline: &Deadline) -> Result<Identity, DeviceError> {
                self.0.identity(deadline)
            }

            fn settings(&mut self, deadline: &Deadline) -> Result<Vec<Setting>, DeviceError> {
                self.0.settings(deadline)
            }

            fn own_settings(&self) -> &'static [(&'static str, &'static str)] {
                self.0.own_settings()
            }

            fn set_own(
                &mut self,
                name: &str,
                value: &str,
                deadline: &Deadline,
            ) -> Result<Value, DeviceError> {
                self.0.set_own(name, value, deadline)
            }
        }
    };
}

device!(
    /// A meter that a file describes.
    ScpiMeter,
    Meter,
    "scpi-meter"
);
device!(
    /// A source that a file describes.
    ScpiSource,
    Source,
    "scpi-source"
);
device!(
    /// A power meter that a file describes: one that tells watts, or a photodiode with its responsivity.
    ScpiPowerMeter,
    PowerMeter,
    "scpi-power-meter"
);

impl Meter for ScpiMeter {
    fn unit(&self) -> &str {
        self.0.about.unit()
    }

    fn read(&mut self, deadline: &Deadline) -> Result<Level, DeviceError> {
        self.0.level(deadline)
    }
}

impl ScpiSource {
    fn plan(&self, name: &'static str) -> Result<super::definition::SettingPlan, DeviceError> {
        // A file of a source has both.
        let (device, reason) = (self.0.about.name(), "its file lacks a setting of every source");
        self.0.plan(name).ok_or(DeviceError::NotReady { device, reason })
    }
}

impl Source for ScpiSource {
    fn unit(&self) -> &str {
        self.0.about.unit()
    }

    fn range(&self) -> Option<Interval> {
        let plan = self.0.plan("level")?;
        (plan.least.is_finite() && plan.most.is_finite())
            .then_some(Interval::new(plan.least, plan.most))
    }

    fn level(&mut self, deadline: &Deadline) -> Result<f64, DeviceError> {
        let plan = self.plan("level")?;
        match self.0.get(&plan, deadline)? {
            Value::Number(level) => Ok(level),
            other => Err(DeviceError::Protocol {
                device: self.0.about.name(),
                reason: format!("its level is `{other}`, expected a number"),
            }),
        }
    }

    fn set_level(&mut self, level: f64, deadline: &Deadline) -> Result<f64, DeviceError> {
        let plan = self.plan("level")?;
        self.0.set_number(&plan, level, deadline)
    }

    fn is_on(&mut self, deadline: &Deadline) -> Result<bool, DeviceError> {
        let plan = self.plan("output")?;
        Ok(self.0.get(&plan, deadline)? == Value::Text("on".to_owned()))
    }

    fn switch(&mut self, on: bool, deadline: &Deadline) -> Result<bool, DeviceError> {
        let plan = self.plan("output")?;
        self.0.set_text(&plan, if on { "on" } else { "off" }, deadline)?;
        Ok(on)
    }
}

impl PowerMeter for ScpiPowerMeter {
    fn power(&mut self, deadline: &Deadline) -> Result<Power, DeviceError> {
        Ok(match self.0.level(deadline)? {
            Level::Value(watts) => Power::Watts(watts),
            Level::Over => Power::Over { range_w: None },
        })
    }

    /// With a responsivity, chooses its place there; the device is not asked.
    fn set_wavelength_nm(&mut self, nm: f64, deadline: &Deadline) -> Result<f64, DeviceError> {
        if self.0.about.response.is_some() {
            return self.0.use_wavelength(nm);
        }
        match self.0.plan("wavelength_nm") {
            Some(plan) => self.0.set_number(&plan, nm, deadline),
            None => self.not_ready("its file has neither [response] nor [settings.wavelength_nm]"),
        }
    }

    fn ranges(&mut self, _: &Deadline) -> Result<Vec<String>, DeviceError> {
        match self.0.plan("range") {
            Some(plan) => Ok(plan.known()),
            None => Ok(Vec::new()),
        }
    }

    fn set_range(&mut self, range: &str, deadline: &Deadline) -> Result<String, DeviceError> {
        match self.0.plan("range") {
            Some(plan) => Ok(self.0.set_text(&plan, range, deadline)?.to_string()),
            None => self.not_ready("its file has no [settings.range]"),
        }
    }

    fn zero(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        let Some((lines, settle)) = self.0.about.zero.clone() else {
            return self.not_ready("its file has no [zero]");
        };
        let lines: Vec<&str> = lines.iter().map(String::as_str).collect();
        self.0.link.tell(&lines, deadline)?;
        let device = self.0.about.name();
        deadline.sleep(settle).map_err(|expired| DeviceError::expired(device, "zeroing", expired))
    }
}

impl ScpiPowerMeter {
    fn not_ready<V>(&self, reason: &'static str) -> Result<V, DeviceError> {
        Err(DeviceError::NotReady { device: self.0.about.name(), reason })
    }
}
