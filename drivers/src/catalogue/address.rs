//! Addresses of devices: a driver, where, and what it has to be told.

use super::options::{OptionKind, Options};
use super::{AnyDevice, DRIVERS, Driver, Line, Wire, opencv};
use crate::clock::Deadline;
use crate::device::DeviceError;
use std::fmt;
use sunglint_formats::nearest_names;

/// Fault in an address or one of its options.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{field}: found `{found}`, expected {expected}")]
pub struct AddressError {
    /// Part of the address or option that is wrong.
    pub field: String,
    /// Text that was found there.
    pub found: String,
    /// Description of what should stand there.
    pub expected: String,
}

impl AddressError {
    pub(super) fn new(field: impl Into<String>, found: &str, expected: impl Into<String>) -> Self {
        Self { field: field.into(), found: found.to_owned(), expected: expected.into() }
    }

    pub(super) fn no_driver(name: &str) -> Self {
        let names = || DRIVERS.into_iter().map(|driver| driver.name);
        let nearest = nearest_names(name, names(), 3);
        let expected = if nearest.is_empty() {
            format!("DRIVER[:WHERE], the driver one of {}", names().collect::<Vec<_>>().join(", "))
        } else {
            let forms = nearest.iter().filter_map(|near| Driver::named(near).ok());
            format!(
                "DRIVER[:WHERE]; nearest: {}",
                forms.map(Driver::form).collect::<Vec<_>>().join(", ")
            )
        };
        Self::new("driver", name, expected)
    }
}

/// Where a device is, and what its driver was told.
#[derive(Debug, Clone)]
pub struct Address {
    /// The driver.
    pub driver: &'static Driver,
    /// Text behind the driver's name: where the device is.
    pub place: Option<String>,
    pub(super) options: Options,
}

impl Address {
    /// Reads `DRIVER[:WHERE]` and options `NAME=VALUE`.
    ///
    /// # Errors
    /// No such driver or option, with the nearest names; a place that the driver needs and does not have, or the other way
    /// round; a value that is none.
    pub fn parse(text: &str, options: &[String]) -> Result<Self, AddressError> {
        let (name, place) = match text.split_once(':') {
            Some((name, place)) => (name.trim(), Some(place.trim())),
            None => (text.trim(), None),
        };
        // The mount is what `alpaca:HOST/0` means most often.
        let name = if name == "alpaca" { "alpaca-telescope" } else { name };
        // The device's file says which of three it is.
        let name = super::scpi::driver_of(name, options)?.unwrap_or(name);
        let driver = Driver::named(name)?;
        let place = place.filter(|place| !place.is_empty()).map(str::to_owned);
        let form = || format!("{} (such as {})", driver.form(), driver.place.example);
        if place.is_some() && driver.place.form.is_empty() {
            return Err(AddressError::new("address", text, form()));
        }
        if place.is_none() && !driver.place.optional {
            return Err(AddressError::new("address", text, form()));
        }
        let options = Options::parse(driver, options)?;
        Ok(Self { driver, place, options })
    }

    /// The options that were given, as they are given.
    pub fn given_options(&self) -> Vec<String> {
        self.options.given()
    }

    /// Traffic on its line: its driver's, but where the place or the model says otherwise.
    pub fn wire(&self) -> Wire {
        super::scpi::wire(self.driver, self.place.as_deref())
            .or_else(|| super::ocean::wire(self))
            .unwrap_or(self.driver.wire)
    }

    /// Opens a line to the device; the driver may put what it finds on the way into the address.
    ///
    /// # Errors
    /// Nothing there, no permission, or the system's own.
    pub fn connect(&mut self, deadline: &Deadline) -> Result<Line, DeviceError> {
        (self.driver.connect)(self, deadline)
    }

    /// Makes the device on a line, which may be recorded or a recording.
    ///
    /// # Errors
    /// The error of the driver; see [`DeviceError`].
    pub fn open(&self, line: Line, deadline: &Deadline) -> Result<AnyDevice, DeviceError> {
        (self.driver.open)(line, self, deadline)
    }

    /// Whether both name the same device: driver, server and device, or, without a place, what was said to find it. Each simulated device is one of its own.
    pub fn is_same_device(&self, other: &Self) -> bool {
        if self.driver.name != other.driver.name || self.driver.simulated || self.is_recording() {
            return false;
        }
        match (&self.place, &other.place) {
            (None, None) => self.given_options() == other.given_options(),
            (Some(own), Some(other)) => plain(own) == plain(other),
            _ => false,
        }
    }

    /// Whether it names what was recorded before: it has times of its own, and an end.
    pub fn is_recording(&self) -> bool {
        self.driver.name == opencv::OPENCV.name
            && self.place.as_deref().is_some_and(opencv::is_recording)
    }

    /// An option's number, its default where it was not given; `None` if it has neither.
    pub fn number(&self, name: &str) -> Option<f64> {
        self.text(name)?.parse().ok()
    }

    /// An option's whole number, which its range lets fit.
    pub fn integer<N: TryFrom<i64>>(&self, name: &str) -> Option<N> {
        N::try_from(self.text(name)?.parse::<i64>().ok()?).ok()
    }

    /// An option's yes; `false` where it was not given and has no default.
    pub fn flag(&self, name: &str) -> bool {
        self.text(name).and_then(OptionKind::flag).unwrap_or(false)
    }

    /// An option's text, its default where it was not given; `None` if it has neither.
    pub fn text(&self, name: &str) -> Option<&str> {
        self.options.get(name).or_else(|| {
            let spec = self.driver.options.iter().find(|spec| spec.name == name)?;
            Some(spec.default).filter(|default| !default.is_empty())
        })
    }

    /// Tells the driver's `open` what `connect` has found.
    pub(super) fn found(&mut self, name: &'static str, value: String) {
        self.options.set(name, value);
    }
}

/// A place without what two names of the same may differ in: how this computer is called, the usual port of INDI.
fn plain(place: &str) -> String {
    let Some((host, rest)) = place.split_once('/').filter(|(host, _)| !host.is_empty()) else {
        // A serial port, or an INDI device of this computer.
        return if place.contains('/') {
            place.to_owned()
        } else {
            plain(&format!("localhost/{place}"))
        };
    };
    let (name, port) = match host.rsplit_once(':') {
        Some((name, port)) if !host.ends_with(']') => (name, port.to_owned()),
        _ => (host, crate::indi::PORT.to_string()),
    };
    let own = ["localhost", "127.0.0.1", "[::1]"];
    let name = if own.contains(&name.to_ascii_lowercase().as_str()) { own[0] } else { name };
    format!("{}:{port}/{rest}", name.to_ascii_lowercase())
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.driver.name)?;
        match &self.place {
            Some(place) => write!(f, ":{place}"),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wrong(text: &str, options: &[&str]) -> String {
        let options: Vec<String> = options.iter().map(|&option| option.to_owned()).collect();
        Address::parse(text, &options).unwrap_err().to_string()
    }

    /// Truth: the grammar in the module's documentation.
    #[test]
    fn addresses_are_read_and_wrong_ones_say_what_is_right() {
        let address = Address::parse("indi-camera:localhost:7624/CCD Simulator", &[]).unwrap();
        assert_eq!(address.place.as_deref(), Some("localhost:7624/CCD Simulator"));
        assert_eq!(address.to_string(), "indi-camera:localhost:7624/CCD Simulator");
        assert_eq!(
            wrong("ofir:/dev/ttyUSB0", &[]),
            "driver: found `ofir`, expected DRIVER[:WHERE]; nearest: ophir:PORT"
        );
        assert_eq!(
            wrong("ophir", &[]),
            "address: found `ophir`, expected ophir:PORT (such as ophir:/dev/ttyUSB0)"
        );
        assert_eq!(
            wrong("sim-efw:3", &[]),
            "address: found `sim-efw:3`, expected sim-efw (such as sim-efw)"
        );
        assert_eq!(
            wrong("tmcl", &["gaer=3"]),
            "option of tmcl: found `gaer`, expected NAME=VALUE; nearest: gear"
        );
        assert_eq!(
            wrong("tmcl", &["gear=0"]),
            "option gear: found `0`, expected a number, 0.000001 to 1000000"
        );
        assert!(wrong("tmcl", &["gear"]).contains("expected NAME=VALUE"));
        assert!(wrong("tmcl", &["gear=1", "gear=2"]).contains("once"));
        assert!(wrong("zzz", &[]).contains("one of timetagger, tmcl, apt, elliptec"));
    }

    /// Truth: by hand: this computer has several names, INDI's port is 7624; other devices, drivers and simulated ones are not the same.
    #[test]
    fn one_device_is_known_by_its_names() {
        let same = |a: &str, b: &str| {
            let of = |text| Address::parse(text, &[]).unwrap();
            of(a).is_same_device(&of(b))
        };
        for (a, b) in [
            ("indi-camera:localhost:7624/CCD Simulator", "indi-camera:127.0.0.1/CCD Simulator"),
            ("indi-camera:CCD Simulator", "indi-camera:LocalHost:7624/CCD Simulator"),
            ("indi-camera:lab:7700/A", "indi-camera:LAB:7700/A"),
            ("alpaca-camera:127.0.0.1:11111/0", "alpaca-camera:localhost:11111/0"),
            ("timetagger", "timetagger"),
            ("ophir:/dev/ttyUSB0", "ophir:/dev/ttyUSB0"),
        ] {
            assert!(same(a, b), "{a} {b}");
        }
        for (a, b) in [
            ("indi-camera:lab/A", "indi-camera:lab/B"),
            ("indi-camera:lab/A", "indi-wheel:lab/A"),
            ("indi-camera:lab:7624/A", "indi-camera:lab:7625/A"),
            ("alpaca-camera:127.0.0.1:11111/0", "alpaca-camera:127.0.0.1:11111/1"),
            ("sim-camera", "sim-camera"),
            ("ophir:/dev/ttyUSB0", "ophir:/dev/ttyUSB1"),
        ] {
            assert!(!same(a, b), "{a} {b}");
        }
    }

    #[test]
    fn every_entry_is_whole() {
        for (i, driver) in DRIVERS.into_iter().enumerate() {
            assert!(DRIVERS[..i].iter().all(|other| other.name != driver.name), "{}", driver.name);
            assert!(
                !driver.tried.is_empty() && !driver.title.is_empty() && !driver.vendor.is_empty()
            );
            assert_eq!(driver.simulated, driver.name.starts_with("sim-"));
            Address::parse(driver.place.example, &[]).unwrap();
            for spec in driver.options.iter().filter(|spec| !spec.default.is_empty()) {
                spec.kind.check(spec.default).unwrap_or_else(|e| panic!("{}: {e}", spec.name));
            }
        }
    }
}
