//! Answers of a meter to SCPI questions, parsed strictly.

pub use crate::reply::ReplyError;
use crate::reply::{integer, number};
pub use crate::scpi::reply::Complaint;
use crate::scpi::reply::{fields, is_text};

/// The answer to `*IDN?`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Instrument {
    /// The maker.
    pub maker: String,
    /// The model.
    pub model: String,
    /// The serial number.
    pub serial: String,
    /// The firmware's version.
    pub firmware: String,
}

impl Instrument {
    /// Reads `Thorlabs,PM100D,P0000001,2.6.0`.
    ///
    /// # Errors
    /// Anything else.
    pub fn parse(text: &str) -> Result<Self, ReplyError> {
        let error =
            || ReplyError::new(text, "an instrument such as `Thorlabs,PM100D,P0000001,2.6.0`");
        let fields: [String; 4] = fields(text).try_into().map_err(|_| error())?;
        if !is_text(text) || fields.iter().any(String::is_empty) {
            return Err(error());
        }
        let [maker, model, serial, firmware] = fields;
        Ok(Self { maker, model, serial, firmware })
    }
}

/// The answer to `SYST:SENS:IDN?`: the sensor.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Sensor {
    /// Name of the sensor (`S120C`).
    pub name: String,
    /// Serial number of the sensor.
    pub serial: String,
    /// When it was calibrated, as it says.
    pub calibration: String,
    /// Type and subtype of the sensor, as the maker numbers them.
    pub kind: [i32; 2],
    /// Capabilities of the sensor, bit by bit: 1 power, 2 energy, 16 response settable, 32 wavelength settable, 64 time constant
    /// settable, 256 temperature.
    pub flags: u32,
}

impl Sensor {
    /// Reads `S120C,180101101,24-Jan-2018,1,18,289`; `None` for `no sensor`.
    ///
    /// # Errors
    /// Anything else.
    pub fn parse(text: &str) -> Result<Option<Self>, ReplyError> {
        let error =
            || ReplyError::new(text, "a sensor such as `S120C,180101101,24-Jan-2018,1,18,289`");
        let fields: [String; 6] = fields(text).try_into().or_else(|fields: Vec<String>| {
            // Without a sensor some firmwares leave out the rest.
            let mut fields = fields;
            fields.resize(6, String::new());
            let none = fields.first().is_some_and(|name| is_none(name));
            fields.try_into().ok().filter(|_| none).ok_or_else(error)
        })?;
        let [name, serial, calibration, kind, subtype, flags] = fields;
        if is_none(&name) {
            return Ok(None);
        }
        if !is_text(text) || name.is_empty() {
            return Err(error());
        }
        let whole = |text: &str| integer(text).map_err(|_| error());
        let kind = [whole(&kind)?, whole(&subtype)?];
        let flags = u32::try_from(whole(&flags)?).map_err(|_| error())?;
        Ok(Some(Self { name, serial, calibration, kind, flags }))
    }

    /// Whether it measures power.
    pub fn measures_power(&self) -> bool {
        self.flags & 1 != 0
    }

    /// Whether it is corrected for the wavelength.
    pub fn knows_wavelengths(&self) -> bool {
        self.flags & 32 != 0
    }
}

fn is_none(name: &str) -> bool {
    name.eq_ignore_ascii_case("no sensor")
}

/// A number that may be beyond what can be measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reading {
    /// A number.
    Value(f64),
    /// SCPI's infinity, 9.9E37 (SCPI-99, 7.2.1.4): more than the range holds.
    Over,
}

impl Reading {
    /// Reads an answer to `MEAS:POW?`.
    ///
    /// # Errors
    /// No number, SCPI's not-a-number (9.91E37), or its negative infinity.
    pub fn parse(text: &str) -> Result<Self, ReplyError> {
        let value = number(text)?;
        // The codes are written with up to 9 decimals; between them nothing is measured.
        if (value / 9.9e37 - 1.0).abs() < 1e-6 {
            return Ok(Self::Over);
        }
        if value.abs() > 1e30 {
            return Err(ReplyError::new(text, "a reading, or 9.9E37 for one beyond the range"));
        }
        Ok(Self::Value(value))
    }
}

/// A switch: `0` or `1`, `OFF` or `ON`.
///
/// # Errors
/// Anything else.
pub fn flag(text: &str) -> Result<bool, ReplyError> {
    match text {
        "0" | "OFF" => Ok(false),
        "1" | "ON" => Ok(true),
        _ => Err(ReplyError::new(text, "0 or 1")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the layouts of the PM100D's manual (6.4.2), its flags by number.
    #[test]
    fn answers_are_read_as_the_manual_lays_them_out() {
        let sensor = Sensor::parse("S120C,180101101,24-Jan-2018,1,18,289").unwrap().unwrap();
        assert_eq!((sensor.name.as_str(), sensor.kind), ("S120C", [1, 18]));
        assert!(sensor.measures_power() && sensor.knows_wavelengths());
        let thermal = Sensor::parse("S302C,1,\"12-Jun-2014, NIST\",2,0,81").unwrap().unwrap();
        assert_eq!(thermal.calibration, "12-Jun-2014, NIST");
        assert!(thermal.measures_power() && !thermal.knows_wavelengths());
        assert_eq!(Sensor::parse("no sensor"), Ok(None));
        assert_eq!(Sensor::parse("\"no sensor\",\"\",\"\",0,0,0"), Ok(None));
        assert!(Sensor::parse("S120C,1,2").is_err() && Sensor::parse("S120C,1,2,3,4,x").is_err());
        let complaint = Complaint::parse("-222,\"Data out of range\"").unwrap();
        assert_eq!(complaint.to_string(), "-222, Data out of range");
        assert!(Complaint::parse("0").is_err() && Complaint::parse("0,No error").is_err());
        assert_eq!(Reading::parse("9.90000000E+37"), Ok(Reading::Over));
        assert_eq!(Reading::parse("-1.2E-9"), Ok(Reading::Value(-1.2e-9)));
        assert!(Reading::parse("9.91E37").is_err() && Reading::parse("-9.9E37").is_err());
        assert!(Instrument::parse("Thorlabs,PM100D,P1").is_err());
    }
}
