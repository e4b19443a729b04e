//! Abilities of each kind of device, whoever made it.
//!
//! One small trait a kind: [`PhotonCounter`], [`Camera`], [`PowerMeter`], [`RotationStage`], [`FilterWheel`], [`Focuser`],
//! [`Mount`], and of a bench [`Meter`], [`Source`], [`Spectrometer`], [`Monochromator`], each a [`Device`]. Every call blocks until it is done, and takes a [`Deadline`] that says how long it may; the deadline's token
//! stops it early. Units are in the names. What was set is read back from the device, and what it then says is what the
//! call returns. A long call that fails gives what it had done with the error ([`Interrupted`]).

mod bench;
mod confirmed;
mod error;
mod focuser;
mod host_time;
mod mount;
mod pace;
mod scale;
mod sink;

pub use bench::{Level, Meter, Monochromator, Source, Spectrometer, Spectrum};
pub use confirmed::Confirmed;
pub(crate) use error::not_taken;
pub use error::{DeviceError, Interrupted, Side};
pub(crate) use focuser::check_steps;
pub(crate) use scale::Scale;

pub use focuser::Focuser;
pub(crate) use host_time::HostTime;
pub use host_time::{CLOCKS_S, HOST_DIFFERENCE};
pub use mount::{
    Finder, FinderFrame, Mount, MountAbilities, MountAxes, MountClock, MountKnown, MountMotion,
    MountPlace, MountRates, MountReading, MountSite, MountTime, PierSide, Spot,
};
pub(crate) use pace::Pace;
pub use pace::{Repeats, Update};
pub use sink::TagSink;

use crate::clock::Deadline;
use serde::Serialize;
use std::fmt;
use std::ops::ControlFlow;
use sunglint_formats::{CountRecord, Frame};
use sunglint_numerics::measured::Interval;

/// Who a device says it is.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Identity {
    /// The maker.
    pub vendor: String,
    /// The model, as the device names itself.
    pub model: String,
    /// The serial number, where the device tells it.
    pub serial: Option<String>,
    /// The firmware's version, where the device tells it.
    pub firmware: Option<String>,
    /// The driver that speaks to it (`tmcl`).
    pub driver: &'static str,
}

/// A value of a setting.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Value {
    /// A number, in the unit of the setting's name.
    Number(f64),
    /// A whole number.
    Integer(i64),
    /// A name out of the device's own list.
    Text(String),
    /// On or off.
    Flag(bool),
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(number) => write!(f, "{number}"),
            Self::Integer(number) => write!(f, "{number}"),
            Self::Text(text) => f.write_str(text),
            Self::Flag(flag) => f.write_str(if *flag { "on" } else { "off" }),
        }
    }
}

/// Where a setting's value comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Origin {
    /// The device said so.
    ReadBack,
    /// The user said so; the device cannot be asked.
    Configured,
    /// Nobody said so: it is what most devices of the kind have.
    Assumed,
}

/// A setting, for metadata and for people.
#[derive(Debug, Clone, PartialEq)]
pub struct Setting {
    /// Name of the setting with its unit (`wavelength_nm`).
    pub name: &'static str,
    /// Value of the setting.
    pub value: Value,
    /// Who said so.
    pub origin: Origin,
}

/// Abilities that every device has.
pub trait Device: Send {
    /// Asks the device who it is.
    ///
    /// # Errors
    /// See [`DeviceError`].
    fn identity(&mut self, deadline: &Deadline) -> Result<Identity, DeviceError>;

    /// All settings that a measurement's metadata should hold, read from the device where it can be asked.
    ///
    /// # Errors
    /// See [`DeviceError`].
    fn settings(&mut self, deadline: &Deadline) -> Result<Vec<Setting>, DeviceError>;

    /// Names of the settings that this device takes beyond those of its kind, each with what it takes, in words.
    fn own_settings(&self) -> &'static [(&'static str, &'static str)] {
        &[]
    }

    /// Sets one of [`own_settings`](Self::own_settings) and gives the value that the device then has.
    ///
    /// # Errors
    /// [`DeviceError::Unknown`] for a name or value that it does not have, or see [`DeviceError`].
    fn set_own(
        &mut self,
        name: &str,
        value: &str,
        deadline: &Deadline,
    ) -> Result<Value, DeviceError> {
        let _ = (value, deadline);
        let known: Vec<&str> = self.own_settings().iter().map(|(name, _)| *name).collect();
        Err(DeviceError::Unknown {
            name: "setting",
            asked: name.to_owned(),
            known: if known.is_empty() { "none".to_owned() } else { known.join(", ") },
        })
    }
}

/// A counter of photons with one or more channels, numbered from 0 in the order in which they were opened.
///
/// Bins are finished bins only, each given once: no count is lost or doubled by when it is asked for.
pub trait PhotonCounter: Device {
    /// Names of the channels.
    fn channels(&self) -> &[String];

    /// Sets the level at which a pulse counts, V, and gives the level that the device then has.
    ///
    /// # Errors
    /// No such channel or level, or see [`DeviceError`].
    fn set_trigger_level_v(
        &mut self,
        channel: usize,
        level_v: f64,
        deadline: &Deadline,
    ) -> Result<f64, DeviceError>;

    /// Sets a channel's delay, ps, and gives the delay that the device then has.
    ///
    /// # Errors
    /// The errors of [`set_trigger_level_v`](Self::set_trigger_level_v).
    fn set_input_delay_ps(
        &mut self,
        channel: usize,
        delay_ps: i64,
        deadline: &Deadline,
    ) -> Result<i64, DeviceError>;

    /// Sets the time after a pulse in which a channel does not count, ps, and gives the time that the device then has.
    ///
    /// # Errors
    /// The errors of [`set_trigger_level_v`](Self::set_trigger_level_v).
    fn set_dead_time_ps(
        &mut self,
        channel: usize,
        dead_time_ps: i64,
        deadline: &Deadline,
    ) -> Result<i64, DeviceError>;

    /// Starts counting in bins of `bin_ps`, ps.
    ///
    /// # Errors
    /// See [`DeviceError`].
    fn start(&mut self, bin_ps: i64, deadline: &Deadline) -> Result<(), DeviceError>;

    /// Whether it can count with [`start_with_tags`](Self::start_with_tags).
    fn streams_tags(&self) -> bool {
        false
    }

    /// Starts counting in bins of `bin_ps`, ps, that are made of a stream of time tags, and hands all records of the stream to `sink`
    /// as they come, during every call: bins and tags are of the same photons.
    ///
    /// # Errors
    /// It streams no tags, or see [`DeviceError`].
    fn start_with_tags(
        &mut self,
        bin_ps: i64,
        sink: TagSink,
        deadline: &Deadline,
    ) -> Result<(), DeviceError> {
        let _ = (bin_ps, sink, deadline);
        let reason = "it counts in bins and hands over no time tags: observe without `raw_tags`";
        Err(DeviceError::NotReady { device: "photon counter", reason })
    }

    /// Waits for the next `bins` finished bins.
    ///
    /// # Errors
    /// The bins that had come, with the error.
    fn read(
        &mut self,
        bins: usize,
        deadline: &Deadline,
    ) -> Result<Vec<CountRecord>, Interrupted<Vec<CountRecord>>>;

    /// Stops counting.
    ///
    /// # Errors
    /// See [`DeviceError`].
    fn stop(&mut self, deadline: &Deadline) -> Result<(), DeviceError>;
}

/// A part of a camera's sensor, in unbinned pixels from its first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// First column and row, px.
    pub origin_px: [u32; 2],
    /// Columns and rows, px, before binning.
    pub size_px: [u32; 2],
    /// Sensor columns and rows in one pixel of the frame.
    pub binning: [u32; 2],
}

/// Purpose of a frame; a driver closes the shutter, if there is one, for a dark or a bias frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum FrameType {
    /// The sky.
    #[default]
    Light,
    /// The least exposure in the dark.
    Bias,
    /// In the dark.
    Dark,
    /// A lit screen.
    Flat,
}

impl FrameType {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Light, Self::Bias, Self::Dark, Self::Flat];
    /// The setting of cameras that take it, with what it takes: an entry of [`Device::own_settings`].
    pub const SETTING: (&'static str, &'static str) = ("frame_type", "light, bias, dark or flat");

    /// `light`, `bias`, `dark` or `flat`.
    pub fn word(self) -> &'static str {
        match self {
            Self::Light => "light",
            Self::Bias => "bias",
            Self::Dark => "dark",
            Self::Flat => "flat",
        }
    }

    /// The value of the setting `name`, for [`Device::set_own`].
    pub(crate) fn of_setting(name: &str, value: &str) -> Result<Self, DeviceError> {
        if name != Self::SETTING.0 {
            let (asked, known) = (name.to_owned(), Self::SETTING.0.to_owned());
            return Err(DeviceError::Unknown { name: "setting", asked, known });
        }
        Self::ALL.into_iter().find(|kind| kind.word() == value).ok_or_else(|| {
            let known = Self::ALL.map(Self::word).join(", ");
            DeviceError::Unknown { name: Self::SETTING.0, asked: value.to_owned(), known }
        })
    }
}

/// Ranges of a camera's settings, as its driver says them.
#[derive(Debug, Clone, PartialEq, Default)]
#[non_exhaustive]
pub struct Limits {
    /// Shortest and longest exposure, s.
    pub exposure_s: Option<Interval>,
    /// Least and largest gain, in the camera's own steps; `None` for a camera without.
    pub gain: Option<Interval>,
    /// Lowest and highest temperature that the cooler takes, °C; `None` for a camera without.
    pub temperature_c: Option<Interval>,
    /// The largest binning.
    pub binning: Option<u32>,
    /// Names of the filters before it, where they are known.
    pub filters: Vec<String>,
}

/// A camera.
pub trait Camera: Device {
    /// Ranges of its settings, where its driver says them. Nothing is asked or set.
    fn limits(&self) -> Option<Limits> {
        None
    }

    /// Columns and rows of the sensor, px.
    fn sensor_px(&self) -> [u32; 2];

    /// Sets the part of the sensor that is read, and gives the part that the device then has.
    ///
    /// # Errors
    /// A window beyond the sensor, or see [`DeviceError`].
    fn set_window(&mut self, window: Window, deadline: &Deadline) -> Result<Window, DeviceError>;

    /// Sets the gain in the camera's own steps, and gives the gain that it then has.
    ///
    /// # Errors
    /// A gain that it has not, or see [`DeviceError`].
    fn set_gain(&mut self, gain: f64, deadline: &Deadline) -> Result<f64, DeviceError>;

    /// Asks for a sensor temperature, °C, and gives the temperature that the sensor has now; it takes minutes to follow.
    ///
    /// # Errors
    /// A camera without cooling, or see [`DeviceError`].
    fn set_temperature_c(
        &mut self,
        temperature_c: f64,
        deadline: &Deadline,
    ) -> Result<f64, DeviceError>;

    /// Takes one frame of `exposure_s`, s. If it is stopped early, the exposure is aborted in the camera too.
    ///
    /// # Errors
    /// See [`DeviceError`].
    fn expose(&mut self, exposure_s: f64, deadline: &Deadline) -> Result<Frame, DeviceError>;

    /// Streams frames of `exposure_s`, s, to `take` until it breaks, and gives their number: one exposure after the other, where the camera can do no better.
    ///
    /// # Errors
    /// The number of frames that were taken, with the error.
    fn stream(
        &mut self,
        exposure_s: f64,
        take: &mut dyn FnMut(Frame) -> ControlFlow<()>,
        deadline: &Deadline,
    ) -> Result<u64, Interrupted<u64>> {
        let mut taken = 0;
        loop {
            let frame =
                self.expose(exposure_s, deadline).map_err(|e| Interrupted::new(taken, e))?;
            taken += 1;
            if take(frame).is_break() {
                return Ok(taken);
            }
        }
    }
}

/// Object in the beam of a goniometer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum InBeam {
    /// The meter itself, in the sample's place.
    Head,
    /// Nothing: the beam goes on into a trap.
    Nothing,
    /// The sample.
    #[default]
    Sample,
    /// The Lambert standard.
    Standard,
    /// No sample: the beam goes on straight, to a detector that stands there.
    Through,
    /// The beam is blocked before it reaches the sample.
    Blocked,
}

impl InBeam {
    /// All of them.
    pub const ALL: [Self; 6] =
        [Self::Blocked, Self::Head, Self::Nothing, Self::Sample, Self::Standard, Self::Through];

    /// Name of it on a line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Blocked => "blocked",
            Self::Head => "head",
            Self::Nothing => "nothing",
            Self::Sample => "sample",
            Self::Standard => "standard",
            Self::Through => "through",
        }
    }
}

/// Reading that a power meter shows.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Power {
    /// A power, W. It may be negative, near zero.
    Watts(f64),
    /// More than the range holds.
    Over {
        /// The end of the range, W, where it is known.
        range_w: Option<f64>,
    },
}

/// An optical power meter.
pub trait PowerMeter: Device {
    /// Reads the power, W.
    ///
    /// # Errors
    /// See [`DeviceError`].
    fn power(&mut self, deadline: &Deadline) -> Result<Power, DeviceError>;

    /// Sets the wavelength for which the reading is corrected, nm, and gives the wavelength that the device then has.
    ///
    /// # Errors
    /// A wavelength beyond the head, or see [`DeviceError`].
    fn set_wavelength_nm(
        &mut self,
        wavelength_nm: f64,
        deadline: &Deadline,
    ) -> Result<f64, DeviceError>;

    /// Names of the ranges, as the device lists them, the automatic one included.
    ///
    /// # Errors
    /// See [`DeviceError`].
    fn ranges(&mut self, deadline: &Deadline) -> Result<Vec<String>, DeviceError>;

    /// Chooses a range by its name, and gives the range that the device then has.
    ///
    /// # Errors
    /// No such range, or see [`DeviceError`].
    fn set_range(&mut self, range: &str, deadline: &Deadline) -> Result<String, DeviceError>;

    /// Takes what it reads now, with the head covered, as zero.
    ///
    /// # Errors
    /// See [`DeviceError`].
    fn zero(&mut self, deadline: &Deadline) -> Result<(), DeviceError>;
}

/// A stage that turns. Angles are absolute, in degrees, and grow in the direction that the stage's configuration names.
pub trait RotationStage: Device {
    /// The angles between which it may stand, deg; `None` if it turns freely.
    fn travel_deg(&self) -> Option<Interval>;

    /// Where it stands, deg.
    ///
    /// # Errors
    /// See [`DeviceError`].
    fn angle_deg(&mut self, deadline: &Deadline) -> Result<f64, DeviceError>;

    /// Finds the reference, from which angles count, and gives where it stands then, deg.
    ///
    /// # Errors
    /// Where it stands (deg, if it can still be asked), with the error. The motor was stopped if it could be reached.
    fn home(&mut self, deadline: &Deadline) -> Result<f64, Interrupted<Option<f64>>>;

    /// Turns to `angle_deg` and gives the angle at which it stands: the nearest that the motor's steps allow.
    ///
    /// # Errors
    /// Where it stands (deg, if it can still be asked), with the error. The motor was stopped if it could be reached.
    fn move_to(
        &mut self,
        angle_deg: f64,
        deadline: &Deadline,
    ) -> Result<f64, Interrupted<Option<f64>>>;

    /// Stops the motor at once.
    ///
    /// # Errors
    /// See [`DeviceError`]; the motor may still be turning.
    fn stop(&mut self, deadline: &Deadline) -> Result<(), DeviceError>;
}

/// A wheel of filters. Slots count from 1, as they are engraved.
pub trait FilterWheel: Device {
    /// How many slots it has.
    fn slots(&self) -> u32;

    /// Names of the filters, that of slot 1 first, as the driver has them; empty where it has none.
    fn names(&self) -> Vec<String> {
        Vec::new()
    }

    /// The slot in the beam.
    ///
    /// # Errors
    /// See [`DeviceError`].
    fn slot(&mut self, deadline: &Deadline) -> Result<u32, DeviceError>;

    /// The slots in which it has stood since the last look, the present one last; `None` while it turns or turned. Somebody else may turn it: what it said of
    /// that by itself is among them, in order.
    ///
    /// # Errors
    /// See [`DeviceError`].
    fn look(&mut self, deadline: &Deadline) -> Result<Vec<Option<u32>>, DeviceError> {
        Ok(vec![Some(self.slot(deadline)?)])
    }

    /// What it has said by itself since the last look, as in [`look`](Self::look); nothing is asked. Empty for a wheel that says nothing by itself.
    ///
    /// # Errors
    /// See [`DeviceError`].
    fn heard(&mut self, deadline: &Deadline) -> Result<Vec<Option<u32>>, DeviceError> {
        let _ = deadline;
        Ok(Vec::new())
    }

    /// Turns slot `slot` into the beam and gives the slot that is there then.
    ///
    /// # Errors
    /// The slot in the beam (if it can still be asked), with the error.
    fn select(&mut self, slot: u32, deadline: &Deadline) -> Result<u32, Interrupted<Option<u32>>>;
}
