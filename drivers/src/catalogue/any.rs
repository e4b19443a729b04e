//! A device of any kind, and its settings by name.

use super::Kind;
use crate::clock::Deadline;
use crate::device::{
    Camera, Device, DeviceError, FilterWheel, Focuser, Meter, Monochromator, Mount, PhotonCounter,
    PowerMeter, RotationStage, Source, Spectrometer, Value, Window,
};

/// A device of one of the kinds.
pub enum AnyDevice {
    /// A photon counter.
    PhotonCounter(Box<dyn PhotonCounter>),
    /// A camera.
    Camera(Box<dyn Camera>),
    /// A power meter.
    PowerMeter(Box<dyn PowerMeter>),
    /// A rotation stage.
    RotationStage(Box<dyn RotationStage>),
    /// A filter wheel.
    FilterWheel(Box<dyn FilterWheel>),
    /// A focuser.
    Focuser(Box<dyn Focuser>),
    /// A telescope mount.
    Mount(Box<dyn Mount>),
    /// A meter of any quantity.
    Meter(Box<dyn Meter>),
    /// A source.
    Source(Box<dyn Source>),
    /// A spectrometer.
    Spectrometer(Box<dyn Spectrometer>),
    /// A monochromator.
    Monochromator(Box<dyn Monochromator>),
}

impl std::fmt::Debug for AnyDevice {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "AnyDevice({})", self.kind())
    }
}

impl AnyDevice {
    /// Returns the kind of the device.
    pub fn kind(&self) -> Kind {
        match self {
            Self::PhotonCounter(_) => Kind::PhotonCounter,
            Self::Camera(_) => Kind::Camera,
            Self::PowerMeter(_) => Kind::PowerMeter,
            Self::RotationStage(_) => Kind::RotationStage,
            Self::FilterWheel(_) => Kind::FilterWheel,
            Self::Focuser(_) => Kind::Focuser,
            Self::Mount(_) => Kind::Mount,
            Self::Meter(_) => Kind::Meter,
            Self::Source(_) => Kind::Source,
            Self::Spectrometer(_) => Kind::Spectrometer,
            Self::Monochromator(_) => Kind::Monochromator,
        }
    }

    /// Returns the device by the trait that every device has.
    pub fn device(&mut self) -> &mut dyn Device {
        match self {
            Self::PhotonCounter(device) => device.as_mut(),
            Self::Camera(device) => device.as_mut(),
            Self::PowerMeter(device) => device.as_mut(),
            Self::RotationStage(device) => device.as_mut(),
            Self::FilterWheel(device) => device.as_mut(),
            Self::Focuser(device) => device.as_mut(),
            Self::Mount(device) => device.as_mut(),
            Self::Meter(device) => device.as_mut(),
            Self::Source(device) => device.as_mut(),
            Self::Spectrometer(device) => device.as_mut(),
            Self::Monochromator(device) => device.as_mut(),
        }
    }

    /// The settings that it takes: their names, and what they take, in words. Those of its kind first, then its own.
    pub fn settable(&mut self) -> Vec<(&'static str, &'static str)> {
        let mut settable: Vec<(&'static str, &'static str)> = match self {
            Self::PhotonCounter(_) => vec![
                ("trigger_level_v", "CHANNEL:V"),
                ("input_delay_ps", "CHANNEL:PS"),
                ("dead_time_ps", "CHANNEL:PS"),
            ],
            Self::Camera(_) => vec![
                ("gain", "the camera's own steps"),
                ("temperature_c", "°C, for the cooler"),
                ("window_px", "X,Y,COLUMNS,ROWS[,BINNING]"),
            ],
            Self::PowerMeter(_) => vec![
                ("wavelength_nm", "nm"),
                ("range", "a range's name"),
                ("zero", "now, with the head covered"),
            ],
            Self::Source(_) => vec![("level", "a level, in its unit"), ("output", "on or off")],
            Self::RotationStage(_)
            | Self::FilterWheel(_)
            | Self::Focuser(_)
            | Self::Mount(_)
            | Self::Meter(_)
            | Self::Spectrometer(_)
            | Self::Monochromator(_) => Vec::new(),
        };
        settable.extend(self.device().own_settings());
        settable
    }

    /// Sets a setting by its name and gives the value that the device then has.
    ///
    /// # Errors
    /// No such setting (the known ones are named), a value that is none, or see [`DeviceError`].
    pub fn set(&mut self, name: &str, value: &str, d: &Deadline) -> Result<Value, DeviceError> {
        let settable = self.settable();
        let Some((known, takes)) = settable.iter().find(|(known, _)| *known == name) else {
            let known: Vec<&str> = settable.iter().map(|(name, _)| *name).collect();
            let none = "none: it has no settings to change";
            let known = if known.is_empty() { none.to_owned() } else { known.join(", ") };
            return Err(DeviceError::Unknown { name: "setting", asked: name.to_owned(), known });
        };
        let bad = || no_value(known, value, takes);
        match (self, *known) {
            (Self::PowerMeter(meter), "wavelength_nm") => {
                meter.set_wavelength_nm(real(value).ok_or_else(bad)?, d).map(Value::Number)
            }
            (Self::PowerMeter(meter), "range") => meter.set_range(value, d).map(Value::Text),
            (Self::PowerMeter(meter), "zero") if value == "now" => {
                meter.zero(d).map(|()| Value::Text("done".into()))
            }
            (Self::PowerMeter(_), "zero") => Err(bad()),
            (Self::Camera(camera), "gain") => {
                camera.set_gain(real(value).ok_or_else(bad)?, d).map(Value::Number)
            }
            (Self::Camera(camera), "temperature_c") => {
                camera.set_temperature_c(real(value).ok_or_else(bad)?, d).map(Value::Number)
            }
            (Self::Camera(camera), "window_px") => {
                let asked = window(value).ok_or_else(bad)?;
                camera.set_window(asked, d).map(|window| Value::Text(window_text(&window)))
            }
            (Self::Source(source), "level") => {
                source.set_level(real(value).ok_or_else(bad)?, d).map(Value::Number)
            }
            (Self::Source(source), "output") => match value {
                "on" | "off" => source.switch(value == "on", d).map(Value::Flag),
                _ => Err(bad()),
            },
            (Self::PhotonCounter(counter), known) if !is_own(counter.as_ref(), known) => {
                set_channel(counter.as_mut(), known, value, d).unwrap_or_else(|| Err(bad()))
            }
            (device, known) => device.device().set_own(known, value, d),
        }
    }
}

fn is_own(device: &dyn PhotonCounter, name: &str) -> bool {
    device.own_settings().iter().any(|(own, _)| *own == name)
}

/// Sets `CHANNEL:VALUE`; `None` if it is none.
fn set_channel(
    counter: &mut dyn PhotonCounter,
    name: &str,
    value: &str,
    d: &Deadline,
) -> Option<Result<Value, DeviceError>> {
    let (channel, value) = value.split_once(':')?;
    let channel = counter.channels().iter().position(|known| known == channel)?;
    Some(match name {
        "trigger_level_v" => {
            counter.set_trigger_level_v(channel, real(value)?, d).map(Value::Number)
        }
        "input_delay_ps" => {
            counter.set_input_delay_ps(channel, value.parse().ok()?, d).map(Value::Integer)
        }
        _ => counter.set_dead_time_ps(channel, value.parse().ok()?, d).map(Value::Integer),
    })
}

fn no_value(name: &'static str, value: &str, takes: &str) -> DeviceError {
    DeviceError::Unknown { name, asked: format!("`{value}`"), known: takes.to_owned() }
}

fn real(text: &str) -> Option<f64> {
    text.parse().ok().filter(|number: &f64| number.is_finite())
}

fn window(text: &str) -> Option<Window> {
    let numbers: Option<Vec<u32>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    let (place, binning) = match numbers?.as_slice() {
        [x, y, columns, rows] => ([*x, *y, *columns, *rows], 1),
        [x, y, columns, rows, binning] => ([*x, *y, *columns, *rows], *binning),
        _ => return None,
    };
    let [x, y, columns, rows] = place;
    Some(Window { origin_px: [x, y], size_px: [columns, rows], binning: [binning, binning] })
}

fn window_text(window: &Window) -> String {
    let Window { origin_px: [x, y], size_px: [columns, rows], binning: [across, down] } = window;
    format!("{x},{y},{columns},{rows} binned {across}x{down}")
}
