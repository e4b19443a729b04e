//! A spectrometer on OBP: its integration, its wavelengths, and its traits.

use super::DEVICE;
use super::fresh::{Instrument, Integration};
use super::link::{Link, LinkSettings};
use super::obp::message;
use crate::clock::Deadline;
use crate::device::{
    Device, DeviceError, Identity, Origin, Setting, Spectrometer, Spectrum, Value,
};
use crate::transport::Bytes;
use std::time::Duration;
use sunglint_numerics::measured::Interval;

/// Properties of a model, as seabreeze has them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Model {
    /// Name.
    pub name: &'static str,
    /// Product number on USB, which the network models tell, too; 0 where none was found.
    pub product: u16,
    /// Pixels of a spectrum.
    pub pixels: usize,
    /// Shortest and longest integration, µs.
    pub integration_us: [u32; 2],
    /// Value at which the converter ends.
    pub saturation: u16,
    /// Message that asks for a spectrum.
    pub spectrum: u32,
}

impl Model {
    /// All that are driven.
    pub const ALL: [Self; 4] = [
        Self {
            name: "HDX",
            product: 0x2003,
            pixels: 2068,
            integration_us: [6_000, 10_000_000],
            saturation: 65_535,
            spectrum: message::SPECTRUM_HDX,
        },
        Self {
            name: "FX",
            product: 0,
            pixels: 2136,
            integration_us: [6_000, 10_000_000],
            saturation: 65_535,
            spectrum: message::SPECTRUM_HDX,
        },
        Self {
            name: "STS",
            product: 0x4000,
            pixels: 1024,
            integration_us: [10, 85_000_000],
            saturation: 16_383,
            spectrum: message::SPECTRUM,
        },
        Self {
            name: "VENTANA",
            product: 0x5000,
            pixels: 1024,
            integration_us: [22_000, 60_000_000],
            saturation: 65_535,
            spectrum: message::SPECTRUM,
        },
    ];

    /// The model of a name, in letters of either size.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|model| model.name.eq_ignore_ascii_case(name))
    }
}

/// Settings that the driver needs for the instrument.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ObpSettings {
    /// The model; `None` asks for its product number.
    pub model: Option<Model>,
    /// Spectra that are thrown away after a change of the time of integration.
    pub stale: u32,
}

impl Default for ObpSettings {
    fn default() -> Self {
        Self { model: None, stale: 1 }
    }
}

/// A spectrometer.
#[derive(Debug)]
pub struct Obp<T> {
    link: Link<T>,
    settings: ObpSettings,
    model: Model,
    serial: String,
    coefficients: Vec<f64>,
    wavelength_nm: Vec<f64>,
    integration: Integration,
    /// Whether it tells its time of integration; known once it was asked.
    tells: Option<bool>,
}

impl<T: Bytes> Obp<T> {
    /// Asks the instrument who it is, which model, and for its wavelengths.
    ///
    /// # Errors
    /// An instrument that does not answer; a model that is not known; wavelengths that do not rise.
    pub fn open(
        line: T,
        link: LinkSettings,
        settings: ObpSettings,
        deadline: &Deadline,
    ) -> Result<Self, DeviceError> {
        let mut link = Link::new(line, link);
        let serial = link.serial(deadline)?;
        let model = match settings.model {
            Some(model) => model,
            None => model(&mut link, deadline)?,
        };
        let coefficients = coefficients(&mut link, deadline)?;
        let wavelength_nm = wavelengths(&coefficients, 0, model.pixels)?;
        let integration = Integration::Unknown;
        Ok(Self {
            link,
            settings,
            model,
            serial,
            coefficients,
            wavelength_nm,
            integration,
            tells: None,
        })
    }

    /// The model.
    pub fn model(&self) -> Model {
        self.model
    }

    /// Coefficients of the wavelength: nm at pixel 0, nm/px, nm/px² …
    pub fn coefficients(&self) -> &[f64] {
        &self.coefficients
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
}

/// The instrument behind its integration.
struct Telling<'a, T> {
    link: &'a mut Link<T>,
    tells: &'a mut Option<bool>,
    model: Model,
}

impl<T: Bytes> Instrument for Telling<'_, T> {
    fn told_us(&mut self, deadline: &Deadline) -> Result<Option<u32>, DeviceError> {
        if *self.tells == Some(false) {
            return Ok(None);
        }
        match self.link.ask(message::INTEGRATION, &[], deadline) {
            Ok(data) => {
                let us = number(message::INTEGRATION, &data)?;
                *self.tells = Some(true);
                Ok(Some(us))
            }
            // One that has told it once may refuse for another reason.
            Err(DeviceError::Refused { .. }) if self.tells.is_none() => {
                *self.tells = Some(false);
                Ok(None)
            }
            Err(error) => Err(error),
        }
    }

    fn set_us(&mut self, us: u32, deadline: &Deadline) -> Result<(), DeviceError> {
        self.link.set(message::SET_INTEGRATION, &us.to_le_bytes(), deadline)
    }

    fn raw(&mut self, work: Duration, deadline: &Deadline) -> Result<Vec<f64>, DeviceError> {
        let data = self.link.wait(self.model.spectrum, work, deadline)?;
        if data.len() != 2 * self.model.pixels {
            let (got, pixels) = (data.len(), self.model.pixels);
            let reason = format!(
                "a spectrum of {got} bytes, {} has {pixels} pixels of 2 bytes: name its model",
                self.model.name
            );
            return Err(DeviceError::Protocol { device: DEVICE, reason });
        }
        let value = |pair: &[u8]| f64::from(u16::from_le_bytes([pair[0], pair[1]]));
        Ok(data.chunks_exact(2).map(value).collect())
    }
}

/// Asks for the product number.
fn model<T: Bytes>(link: &mut Link<T>, deadline: &Deadline) -> Result<Model, DeviceError> {
    let known = || Model::ALL.map(|model| model.name).join(", ");
    let data = match link.ask(message::PRODUCT, &[], deadline) {
        Ok(data) => data,
        Err(DeviceError::Refused { .. }) => {
            let asked = "none told".to_owned();
            return Err(DeviceError::Unknown { name: "model", asked, known: known() });
        }
        Err(error) => return Err(error),
    };
    let [low, high] = data[..] else {
        return Err(wrong_length(message::PRODUCT, data.len(), 2));
    };
    let product = u16::from_le_bytes([low, high]);
    let found = Model::ALL.into_iter().find(|model| model.product == product && product != 0);
    found.ok_or_else(|| {
        let asked = format!("product {product:04x}");
        DeviceError::Unknown { name: "model", asked, known: known() }
    })
}

fn wrong_length(message: u32, got: usize, expected: usize) -> DeviceError {
    let reason = format!("the answer to {message:08x}: found {got} bytes, expected {expected}");
    DeviceError::Protocol { device: DEVICE, reason }
}

fn number(message: u32, data: &[u8]) -> Result<u32, DeviceError> {
    let bytes = data.try_into().map_err(|_| wrong_length(message, data.len(), 4))?;
    Ok(u32::from_le_bytes(bytes))
}

/// Asks for the coefficients of the wavelength.
fn coefficients<T: Bytes>(link: &mut Link<T>, d: &Deadline) -> Result<Vec<f64>, DeviceError> {
    let count = link.ask(message::COEFFICIENTS, &[], d)?;
    let [count] = count[..] else {
        return Err(wrong_length(message::COEFFICIENTS, count.len(), 1));
    };
    if !(2..=8).contains(&count) {
        let reason = format!("it says that its wavelength has {count} coefficients, not 2 to 8");
        return Err(DeviceError::Protocol { device: DEVICE, reason });
    }
    let one = |place| {
        let data = link.ask(message::COEFFICIENT, &[place], d)?;
        number(message::COEFFICIENT, &data).map(|bits| f64::from(f32::from_bits(bits)))
    };
    (0..count).map(one).collect()
}

/// The wavelength of each pixel, nm; the first has that number in the polynomial.
pub(super) fn wavelengths(
    coefficients: &[f64],
    first: i32,
    pixels: usize,
) -> Result<Vec<f64>, DeviceError> {
    let at = |pixel: usize| {
        let place = pixel as f64 + f64::from(first);
        coefficients.iter().rev().fold(0.0, |sum, c| sum * place + c)
    };
    let all: Vec<f64> = (0..pixels).map(at).collect();
    let rises = all.windows(2).all(|pair| pair[0] < pair[1]);
    let light = |nm: &f64| (100.0..10_000.0).contains(nm);
    if rises && all.iter().all(light) {
        return Ok(all);
    }
    let reason = format!(
        "its wavelengths do not rise from pixel to pixel within 100 nm to 10 µm (coefficients {coefficients:?}): it was not calibrated, or another model was named"
    );
    Err(DeviceError::Protocol { device: DEVICE, reason })
}

impl<T: Bytes> Device for Obp<T> {
    fn identity(&mut self, deadline: &Deadline) -> Result<Identity, DeviceError> {
        self.serial = self.link.serial(deadline)?;
        Ok(Identity {
            vendor: "Ocean Optics".into(),
            model: self.model.name.into(),
            serial: Some(self.serial.clone()),
            firmware: None,
            driver: "ocean",
        })
    }

    fn settings(&mut self, deadline: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let read = |name, value| Setting { name, value, origin: Origin::ReadBack };
        let configured = |name, value| Setting { name, value, origin: Origin::Configured };
        let ends = [self.wavelength_nm.first(), self.wavelength_nm.last()];
        let [first, last] = ends.map(|nm| Value::Number(nm.copied().unwrap_or(f64::NAN)));
        // At most 2136.
        let pixels = Value::Integer(self.model.pixels as i64);
        let mut settings = vec![
            configured("pixels", pixels),
            configured("saturation_counts", Value::Integer(i64::from(self.model.saturation))),
            read("first_nm", first),
            read("last_nm", last),
        ];
        let Self { link, tells, model, .. } = self;
        let mut instrument = Telling { link, tells, model: *model };
        if let Some(us) = instrument.told_us(deadline)? {
            settings.push(read("integration_us", Value::Integer(i64::from(us))));
        }
        Ok(settings)
    }
}

impl<T: Bytes> Spectrometer for Obp<T> {
    fn wavelength_nm(&self) -> &[f64] {
        &self.wavelength_nm
    }

    fn integration_s(&self) -> Option<Interval> {
        let [least, most] = self.model.integration_us.map(|us| f64::from(us) / 1e6);
        Some(Interval::new(least, most))
    }

    /// Takes a spectrum; one that is older is thrown away, which takes its time.
    fn expose(&mut self, integration_s: f64, deadline: &Deadline) -> Result<Spectrum, DeviceError> {
        let [least, most] = self.model.integration_us;
        let us = (integration_s * 1e6).round();
        if !(f64::from(least)..=f64::from(most)).contains(&us) {
            let [least, most] = [least, most].map(|us| f64::from(us) / 1e6);
            let name = "integration_s";
            return Err(DeviceError::OutOfRange { name, asked: integration_s, least, most });
        }
        // Within the model's limits.
        let us = us as u32;
        let longest = Duration::from_micros(u64::from(most));
        let Self { link, tells, model, integration, settings, .. } = self;
        let mut instrument = Telling { link, tells, model: *model };
        let (start, counts) =
            integration.expose(&mut instrument, us, settings.stale, longest, deadline)?;
        Ok(Spectrum {
            start,
            integration_s: f64::from(us) / 1e6,
            wavelength_nm: self.wavelength_nm.clone(),
            counts,
            saturation_counts: Some(f64::from(self.model.saturation)),
        })
    }
}
