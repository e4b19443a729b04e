//! The models that speak OOI: how each is reached, and how its spectra are laid out.

use super::frame::{Layout, Saturation};

/// Endpoints of a model: bulk, addresses with the direction's bit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Endpoints {
    /// To the instrument.
    pub commands: u8,
    /// Answers to questions, and at full speed the spectra of models that tell their speed.
    pub answers: u8,
    /// Spectra.
    pub spectra: u8,
    /// The first 2048 bytes of a spectrum at high speed, where they have an endpoint of their own.
    pub beginnings: Option<u8>,
}

/// Properties of a model.
///
/// # Source
/// Product numbers, endpoints, values of a frame, limits and units of the integration, converters' ends and dark pixels are those of seabreeze 2.11.0, its pure Python
/// backend; a test holds them against it. The pixels that are the detector's own are those of the maker's library (libseabreeze 3.0, `numberOfPixels`), and for the Torus those
/// of its frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Model {
    /// Name.
    pub name: &'static str,
    /// Name in options of an address.
    pub option: &'static str,
    /// Product number on USB.
    pub product: u16,
    /// Name in lists of devices.
    pub title: &'static str,
    /// Endpoints.
    pub endpoints: Endpoints,
    /// Whether it tells its status (FE), and in it the speed of its bus.
    pub tells_status: bool,
    /// Values of a frame; those behind [`pixels`](Self::pixels) are filler.
    pub values: usize,
    /// Pixels of the detector.
    pub pixels: usize,
    /// Layout of a frame.
    pub layout: Layout,
    /// Bits of a value that are sent turned over.
    pub flipped: u16,
    /// Bits of the converter.
    pub bits: u32,
    /// Whether a frame ends with the byte 69.
    pub ends_with_mark: bool,
    /// Unit in which the time of integration is sent, µs.
    pub unit_us: u32,
    /// Shortest and longest integration, µs.
    pub integration_us: [u32; 2],
    /// Value at which a spectrum saturates, where slot 17 says no other.
    pub saturation: u16,
    /// Form of slot 17.
    pub slot_17: Saturation,
    /// Number of the first pixel in the wavelength's polynomial.
    pub first_pixel: i32,
    /// Pixels that see no light: the first of each range, and the first behind it.
    pub dark: &'static [[usize; 2]],
}

/// Endpoints of the oldest models.
const OLD: Endpoints = Endpoints { commands: 0x02, answers: 0x87, spectra: 0x82, beginnings: None };
/// Endpoints of the others.
const NEW: Endpoints = Endpoints { commands: 0x01, answers: 0x81, spectra: 0x82, beginnings: None };

/// The USB2000, on which the others' rows are built.
const USB2000: Model = Model {
    name: "USB2000",
    option: "usb2000",
    product: 0x1002,
    title: "Ocean Optics USB2000",
    endpoints: OLD,
    tells_status: false,
    values: 2048,
    pixels: 2048,
    layout: Layout::Halves,
    flipped: 0,
    bits: 12,
    ends_with_mark: true,
    unit_us: 1000,
    integration_us: [3_000, 655_350_000],
    saturation: 4095,
    slot_17: Saturation::Unused,
    first_pixel: 0,
    dark: &[[2, 24]],
};

/// The USB2000+.
const USB2000_PLUS: Model = Model {
    name: "USB2000+",
    option: "usb2000plus",
    product: 0x101e,
    title: "Ocean Optics USB2000+ or Flame-S",
    endpoints: NEW,
    tells_status: true,
    layout: Layout::Words,
    bits: 16,
    unit_us: 1,
    integration_us: [1_000, 655_350_000],
    saturation: 65_535,
    slot_17: Saturation::Word { at: 4 },
    dark: &[[6, 21]],
    ..USB2000
};

/// The Maya2000 Pro.
const MAYA2000_PRO: Model = Model {
    name: "Maya2000 Pro",
    option: "maya2000pro",
    product: 0x102a,
    title: "Ocean Optics Maya2000 Pro",
    values: 2304,
    pixels: 2068,
    integration_us: [7_200, 65_000_000],
    saturation: 64_000,
    slot_17: Saturation::FirstWord,
    dark: &[[0, 4], [2064, 2068]],
    ..USB2000_PLUS
};

/// The USB4000.
const USB4000: Model = Model {
    name: "USB4000",
    option: "usb4000",
    product: 0x1022,
    title: "Ocean Optics USB4000 or Flame-T",
    endpoints: Endpoints { beginnings: Some(0x86), ..NEW },
    values: 3840,
    pixels: 3648,
    integration_us: [10, 65_535_000],
    dark: &[[5, 16]],
    ..USB2000_PLUS
};

/// The NIRQuest of 512 pixels.
const NIRQUEST512: Model = Model {
    name: "NIRQuest512",
    option: "nirquest512",
    product: 0x1026,
    title: "Ocean Optics NIRQuest512",
    tells_status: false,
    values: 512,
    pixels: 512,
    flipped: 0x8000,
    unit_us: 1000,
    integration_us: [1_000, 1_600_000_000],
    slot_17: Saturation::Long { at: 4 },
    dark: &[],
    ..USB2000_PLUS
};

impl Model {
    /// All that are driven.
    pub const ALL: [Self; 16] = [
        USB2000,
        Self {
            name: "HR2000",
            option: "hr2000",
            product: 0x100a,
            title: "Ocean Optics HR2000",
            ..USB2000
        },
        Self {
            name: "HR4000",
            option: "hr4000",
            product: 0x1012,
            title: "Ocean Optics HR4000",
            flipped: 0x2000,
            bits: 14,
            integration_us: [10, 655_350_000],
            saturation: 16_383,
            slot_17: Saturation::Unused,
            dark: &[[2, 13]],
            ..USB4000
        },
        Self {
            name: "USB650",
            option: "usb650",
            product: 0x1014,
            title: "Ocean Optics USB650",
            dark: &[],
            ..USB2000
        },
        Self {
            name: "HR2000+",
            option: "hr2000plus",
            product: 0x1016,
            title: "Ocean Optics HR2000+",
            flipped: 0x2000,
            bits: 14,
            saturation: 16_383,
            slot_17: Saturation::Unused,
            dark: &[[2, 24]],
            ..USB2000_PLUS
        },
        Self {
            name: "QE65000",
            option: "qe65000",
            product: 0x1018,
            title: "Ocean Optics QE65000",
            values: 1280,
            pixels: 1044,
            flipped: 0x8000,
            unit_us: 1000,
            integration_us: [8_000, 1_600_000_000],
            slot_17: Saturation::Unused,
            first_pixel: -10,
            dark: &[[0, 4], [1040, 1044]],
            ..USB2000_PLUS
        },
        USB2000_PLUS,
        USB4000,
        NIRQUEST512,
        Self {
            name: "NIRQuest256",
            option: "nirquest256",
            product: 0x1028,
            title: "Ocean Optics NIRQuest256",
            values: 256,
            pixels: 256,
            ..NIRQUEST512
        },
        MAYA2000_PRO,
        Self {
            name: "Maya2000",
            option: "maya2000",
            product: 0x102c,
            title: "Ocean Optics Maya2000",
            pixels: 2080,
            integration_us: [15_000, 1_600_000_000],
            saturation: 65_535,
            slot_17: Saturation::Unused,
            dark: &[[0, 8], [2072, 2080]],
            ..MAYA2000_PRO
        },
        Self {
            name: "Torus",
            option: "torus",
            product: 0x1040,
            title: "Ocean Optics Torus",
            dark: &[],
            ..USB2000_PLUS
        },
        Self {
            name: "Apex",
            option: "apex",
            product: 0x1044,
            title: "Ocean Optics Apex",
            integration_us: [15_000, 1_600_000_000],
            ..MAYA2000_PRO
        },
        Self {
            name: "Maya LSL",
            option: "mayalsl",
            product: 0x1046,
            title: "Ocean Optics Maya LSL",
            ..MAYA2000_PRO
        },
        Self {
            name: "Jaz",
            option: "jaz",
            product: 0x2000,
            title: "Ocean Optics Jaz",
            tells_status: false,
            ends_with_mark: false,
            dark: &[[2, 24]],
            ..USB2000_PLUS
        },
    ];

    /// The model of a name, in letters of either size; its name in options is one, too.
    pub fn named(name: &str) -> Option<Self> {
        let is = |model: &Self| {
            [model.name, model.option].iter().any(|own| own.eq_ignore_ascii_case(name))
        };
        Self::ALL.into_iter().find(is)
    }

    /// The model of a product number.
    pub fn of_product(product: u16) -> Option<Self> {
        Self::ALL.into_iter().find(|model| model.product == product)
    }

    /// Bytes of a frame, its mark included.
    pub fn frame_length(&self) -> usize {
        2 * self.values + usize::from(self.ends_with_mark)
    }
}
