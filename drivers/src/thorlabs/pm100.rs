//! A power meter with its sensor: settings, readings, and its traits.

use super::DEVICE;
use super::scpi::{Complaint, Instrument, Reading, Sensor, flag};
use crate::clock::Deadline;
use crate::device::{
    Device, DeviceError, Identity, Origin, Power, PowerMeter, Setting, Value, not_taken,
};
use crate::reply::{integer, number, power_w};
use crate::transport::Transfers;
use crate::usbtmc::{Tmc, TmcSettings};
use std::time::Duration;
use sunglint_numerics::measured::Interval;

/// The name of the range that the meter chooses by itself.
const AUTO: &str = "AUTO";

/// Settings that the driver needs for a meter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pm100Settings {
    /// Whether the unit is asked for after each reading, so that a key pressed on the meter (dBm) cannot go unseen.
    pub guard_unit: bool,
    /// How often a meter that is zeroing is asked how it stands.
    pub zero_poll: Duration,
    /// How long stopping a zeroing may take: a call ends at most this long after its deadline.
    pub abort_within: Duration,
}

impl Default for Pm100Settings {
    fn default() -> Self {
        Self {
            guard_unit: true,
            zero_poll: Duration::from_millis(200),
            abort_within: Duration::from_secs(2),
        }
    }
}

/// A power meter, in watts.
#[derive(Debug)]
pub struct Pm100<T> {
    tmc: Tmc<T>,
    settings: Pm100Settings,
    sensor: Sensor,
}

impl<T: Transfers> Pm100<T> {
    /// Asks the meter who it is and what its sensor can do, forgets complaints about what others asked, and has it measure
    /// in watts and absolutely (not in dBm or relative to a reference, which a key on it may have chosen).
    ///
    /// # Errors
    /// No sensor, or one without power ([`DeviceError::NotReady`]); a meter that does not answer, or see [`DeviceError`].
    pub fn open(
        usb: T,
        tmc: TmcSettings,
        settings: Pm100Settings,
        deadline: &Deadline,
    ) -> Result<Self, DeviceError> {
        /// More complaints than the queue of any meter holds.
        const MOST: usize = 64;
        let mut tmc = Tmc::new(DEVICE, usb, tmc);
        tmc.ask_as("*IDN?", Instrument::parse, deadline)?;
        let mut old = 0;
        while tmc.ask_as("SYST:ERR?", Complaint::parse, deadline)?.code != 0 {
            old += 1;
            if old > MOST {
                let reason = format!("{MOST} complaints and no end: switch it off and on");
                return Err(DeviceError::Protocol { device: DEVICE, reason });
            }
        }
        let sensor = tmc.ask_as("SYST:SENS:IDN?", Sensor::parse, deadline)?;
        let not_ready = |reason| DeviceError::NotReady { device: DEVICE, reason };
        let no_sensor = "no sensor: plug one in, and open the meter again";
        let sensor = sensor.ok_or(not_ready(no_sensor))?;
        if !sensor.measures_power() {
            return Err(not_ready("the sensor measures no power: plug in one that does"));
        }
        let mut meter = Self { tmc, settings, sensor };
        meter.set("SENS:POW:UNIT W", deadline)?;
        meter.require_watts(deadline)?;
        meter.set("SENS:POW:REF:STAT 0", deadline)?;
        if meter.tmc.ask_as("SENS:POW:REF:STAT?", flag, deadline)? {
            return Err(not_taken(DEVICE, "relative readings", "off", "on"));
        }
        Ok(meter)
    }

    /// The sensor.
    pub fn sensor(&self) -> &Sensor {
        &self.sensor
    }

    /// The USB device.
    pub fn usb(&self) -> &T {
        self.tmc.usb()
    }

    /// The USB device; what is said on it behind the driver's back, the driver does not know.
    pub fn usb_mut(&mut self) -> &mut T {
        self.tmc.usb_mut()
    }

    /// The USB device.
    pub fn into_usb(self) -> T {
        self.tmc.into_usb()
    }

    /// How many measurements are averaged in a reading.
    ///
    /// # Errors
    /// See [`DeviceError`].
    pub fn averaging(&mut self, deadline: &Deadline) -> Result<u32, DeviceError> {
        let count = self.tmc.ask_as("SENS:AVER:COUN?", integer, deadline)?;
        u32::try_from(count).map_err(|_| DeviceError::Protocol {
            device: DEVICE,
            reason: format!("it averages {count} measurements"),
        })
    }

    /// Sets how many measurements (each about 3 ms) are averaged in a reading, and gives how many the meter then averages.
    ///
    /// # Errors
    /// See [`DeviceError`].
    pub fn set_averaging(&mut self, count: u32, deadline: &Deadline) -> Result<u32, DeviceError> {
        self.set(&format!("SENS:AVER:COUN {count}"), deadline)?;
        let got = self.averaging(deadline)?;
        if got == count {
            return Ok(got);
        }
        Err(not_taken(DEVICE, "averaging", &count.to_string(), &got.to_string()))
    }

    /// The attenuation in front of the sensor that somebody told the meter, by which its readings are corrected, dB.
    ///
    /// # Errors
    /// See [`DeviceError`].
    pub fn attenuation_db(&mut self, deadline: &Deadline) -> Result<f64, DeviceError> {
        self.tmc.ask_as("SENS:CORR:LOSS:INP:MAGN?", number, deadline)
    }

    /// The shortest and longest wavelength of the sensor, nm.
    ///
    /// # Errors
    /// See [`DeviceError`].
    pub fn wavelengths_nm(&mut self, deadline: &Deadline) -> Result<Interval, DeviceError> {
        let least = self.tmc.ask_as("SENS:CORR:WAV? MIN", number, deadline)?;
        Ok(Interval::new(least, self.tmc.ask_as("SENS:CORR:WAV? MAX", number, deadline)?))
    }

    /// The ends of the smallest and the largest range, W.
    ///
    /// # Errors
    /// See [`DeviceError`].
    pub fn range_ends_w(&mut self, deadline: &Deadline) -> Result<Interval, DeviceError> {
        let least = self.tmc.ask_as("SENS:POW:RANG? MIN", number, deadline)?;
        Ok(Interval::new(least, self.tmc.ask_as("SENS:POW:RANG? MAX", number, deadline)?))
    }

    fn range(&mut self, deadline: &Deadline) -> Result<(bool, f64), DeviceError> {
        let auto = self.tmc.ask_as("SENS:POW:RANG:AUTO?", flag, deadline)?;
        Ok((auto, self.tmc.ask_as("SENS:POW:RANG?", number, deadline)?))
    }

    /// Sends a command and asks whether the meter had anything against it.
    fn set(&mut self, command: &str, deadline: &Deadline) -> Result<(), DeviceError> {
        self.tmc.tell(command, deadline)?;
        let complaint = self.tmc.ask_as("SYST:ERR?", Complaint::parse, deadline)?;
        if complaint.code == 0 {
            return Ok(());
        }
        let (request, said) = (command.to_owned(), complaint.to_string());
        Err(DeviceError::Rejected { device: DEVICE, request, said })
    }

    fn require_watts(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        let unit = self.tmc.ask_as("SENS:POW:UNIT?", |text| Ok(text.to_owned()), deadline)?;
        if unit == "W" { Ok(()) } else { Err(not_taken(DEVICE, "unit", "W", &unit)) }
    }

    fn wait_for_zero(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        while self.tmc.ask_as("SENS:CORR:COLL:ZERO:STAT?", flag, deadline)? {
            deadline
                .sleep(self.settings.zero_poll)
                .map_err(|expired| DeviceError::expired(DEVICE, "zeroing", expired))?;
        }
        let complaint = self.tmc.ask_as("SYST:ERR?", Complaint::parse, deadline)?;
        if complaint.code == 0 {
            return Ok(());
        }
        let (request, said) = ("zeroing".to_owned(), complaint.to_string());
        Err(DeviceError::Rejected { device: DEVICE, request, said })
    }
}

impl<T: Transfers> Device for Pm100<T> {
    fn identity(&mut self, deadline: &Deadline) -> Result<Identity, DeviceError> {
        let about = self.tmc.ask_as("*IDN?", Instrument::parse, deadline)?;
        Ok(Identity {
            vendor: "Thorlabs".into(),
            model: about.model,
            serial: Some(about.serial),
            firmware: Some(about.firmware),
            driver: "pm100",
        })
    }

    fn settings(&mut self, deadline: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let sensor = self.tmc.ask_as("SYST:SENS:IDN?", Sensor::parse, deadline)?;
        let reason = "the sensor was pulled out: plug it in, and open the meter again";
        let sensor = sensor.ok_or(DeviceError::NotReady { device: DEVICE, reason })?;
        self.require_watts(deadline)?;
        let (auto, range_w) = self.range(deadline)?;
        let mut values = vec![
            ("sensor", Value::Text(sensor.name.clone())),
            ("sensor_serial", Value::Text(sensor.serial.clone())),
            ("sensor_calibration", Value::Text(sensor.calibration.clone())),
            ("unit", Value::Text("W".into())),
            ("range_auto", Value::Flag(auto)),
            ("range_w", Value::Number(range_w)),
            ("averaging", Value::Integer(self.averaging(deadline)?.into())),
            ("attenuation_db", Value::Number(self.attenuation_db(deadline)?)),
        ];
        if sensor.knows_wavelengths() {
            let nm = self.tmc.ask_as("SENS:CORR:WAV?", number, deadline)?;
            values.push(("wavelength_nm", Value::Number(nm)));
        }
        let read = |(name, value)| Setting { name, value, origin: Origin::ReadBack };
        Ok(values.into_iter().map(read).collect())
    }

    fn own_settings(&self) -> &'static [(&'static str, &'static str)] {
        &[("averaging", "how many readings of 0.3 ms or 3 ms make one")]
    }

    fn set_own(&mut self, name: &str, value: &str, d: &Deadline) -> Result<Value, DeviceError> {
        let unknown = |name, asked: &str, known: &str| {
            let (asked, known) = (asked.to_owned(), known.to_owned());
            Err(DeviceError::Unknown { name, asked, known })
        };
        match (name, value.parse()) {
            ("averaging", Ok(count)) => {
                self.set_averaging(count, d).map(|count| Value::Integer(count.into()))
            }
            ("averaging", Err(_)) => unknown("averaging", value, "the whole numbers"),
            _ => unknown("setting", name, "averaging"),
        }
    }
}

impl<T: Transfers> PowerMeter for Pm100<T> {
    fn power(&mut self, deadline: &Deadline) -> Result<Power, DeviceError> {
        let reading = self.tmc.ask_as("MEAS:POW?", Reading::parse, deadline)?;
        if self.settings.guard_unit {
            self.require_watts(deadline)?;
        }
        match reading {
            Reading::Value(watts) => Ok(Power::Watts(watts)),
            Reading::Over => Ok(Power::Over { range_w: Some(self.range(deadline)?.1) }),
        }
    }

    fn set_wavelength_nm(
        &mut self,
        wavelength_nm: f64,
        deadline: &Deadline,
    ) -> Result<f64, DeviceError> {
        if !self.sensor.knows_wavelengths() {
            let reason = "this sensor is not corrected for the wavelength";
            return Err(DeviceError::NotReady { device: DEVICE, reason });
        }
        let [least, most] = self.wavelengths_nm(deadline)?.to_array();
        if !(least..=most).contains(&wavelength_nm) {
            let name = "wavelength_nm";
            return Err(DeviceError::OutOfRange { name, asked: wavelength_nm, least, most });
        }
        self.set(&format!("SENS:CORR:WAV {wavelength_nm}"), deadline)?;
        let got = self.tmc.ask_as("SENS:CORR:WAV?", number, deadline)?;
        if got == wavelength_nm {
            return Ok(got);
        }
        // Some models take whole nanometres only; what they have, and say twice, is what is given.
        let again = self.tmc.ask_as("SENS:CORR:WAV?", number, deadline)?;
        if got == again && (got - wavelength_nm).abs() <= 0.5 {
            return Ok(got);
        }
        Err(not_taken(DEVICE, "wavelength_nm", &wavelength_nm.to_string(), &got.to_string()))
    }

    /// `AUTO`, and the ends of the smallest and the largest range: any power between them may be named (`5mW`), and the
    /// meter takes the range that holds it.
    fn ranges(&mut self, deadline: &Deadline) -> Result<Vec<String>, DeviceError> {
        let [least, most] = self.range_ends_w(deadline)?.to_array();
        Ok(vec![AUTO.to_owned(), format!("{least:e}W"), format!("{most:e}W")])
    }

    fn set_range(&mut self, range: &str, deadline: &Deadline) -> Result<String, DeviceError> {
        if range == AUTO {
            self.set("SENS:POW:RANG:AUTO 1", deadline)?;
            let (auto, got_w) = self.range(deadline)?;
            let got = format!("{got_w:e}W");
            return if auto { Ok(got) } else { Err(not_taken(DEVICE, "range", AUTO, &got)) };
        }
        let known = self.ranges(deadline)?;
        let asked_w = power_w(range).map_err(|_| DeviceError::Unknown {
            name: "range",
            asked: range.to_owned(),
            known: known.join(", "),
        })?;
        let [least, most] = self.range_ends_w(deadline)?.to_array();
        // The ends are written with fewer digits than doubles have.
        if asked_w > most * (1.0 + 1e-9) {
            return Err(DeviceError::OutOfRange { name: "range_w", asked: asked_w, least, most });
        }
        // Setting a range switches the automatic off.
        self.set(&format!("SENS:POW:RANG {asked_w:e}"), deadline)?;
        let (auto, got_w) = self.range(deadline)?;
        let got = format!("{got_w:e}W");
        if !auto && got_w >= asked_w * (1.0 - 1e-6) {
            return Ok(got);
        }
        Err(not_taken(DEVICE, "range", range, if auto { AUTO } else { &got }))
    }

    fn zero(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        self.set("SENS:CORR:COLL:ZERO:INIT", deadline)?;
        self.wait_for_zero(deadline).inspect_err(|error| {
            if !matches!(error, DeviceError::Rejected { .. }) {
                let grace = deadline.grace(self.settings.abort_within);
                // What is told is why it did not come to its end.
                let _ = self.tmc.tell("SENS:CORR:COLL:ZERO:ABOR", &grace);
            }
        })
    }
}
