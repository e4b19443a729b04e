//! Spectrometers of Ocean Optics, and a simulated one.

use super::options::OptionKind::{Flag, Number, Word};
use super::{Address, AnyDevice, Bus, Driver, Kind, Line, OptionSpec, Place, UsbId, Wire};
use crate::clock::Deadline;
use crate::device::DeviceError;
use crate::ocean;
use crate::simulated::{InMemory, ocean as sim_ocean};
use crate::transport::TransportError;

const fn ids() -> [UsbId; ocean::PRODUCTS.len()] {
    let empty = UsbId { bus: Bus::Usb, vendor: ocean::VENDOR, product: None, name: "" };
    let mut ids = [empty; ocean::PRODUCTS.len()];
    let mut i = 0;
    while i < ids.len() {
        let (product, name) = ocean::PRODUCTS[i];
        ids[i] = UsbId { product: Some(product), name, ..empty };
        i += 1;
    }
    ids
}

const MODEL: OptionSpec = OptionSpec {
    name: "model",
    kind: Word(&["auto", "hdx", "fx", "sts", "ventana"]),
    default: "auto",
    about: "the model: its pixels, its limits, how it is asked; auto asks for its product number",
};

/// Ocean Optics on OBP.
pub(super) static OCEAN: Driver = Driver {
    name: "ocean",
    kind: Kind::Spectrometer,
    vendor: "Ocean Optics (Ocean Insight)",
    title: "spectrometers on the Ocean Binary Protocol: HDX, FX by network; HDX, STS, Ventana by USB",
    tried: "our simulated HDX, which seabreeze 2.11.0 drives too, over TCP; no real one yet",
    simulated: false,
    place: Place { form: "tcp:HOST:PORT", example: "ocean:tcp:192.168.1.20:57357", optional: true },
    options: &[MODEL],
    ids: &ids(),
    wire: Wire::Bytes,
    connect,
    open,
};

/// The simulated HDX.
pub(super) static SIM_OCEAN: Driver = Driver {
    name: "sim-ocean",
    kind: Kind::Spectrometer,
    vendor: "sunglint",
    title: "a simulated HDX that looks at a mercury-argon lamp",
    tried: "seabreeze 2.11.0 drives it over TCP",
    simulated: true,
    place: Place { form: "", example: "sim-ocean", optional: true },
    options: &[
        MODEL,
        OptionSpec {
            name: "lamp",
            kind: Number(0.0, 1e3),
            default: "0.3",
            about: "light of the lamp; 0 is the dark, and 1 saturates in 0.1 s",
        },
        OptionSpec {
            name: "checksum",
            kind: Flag,
            default: "no",
            about: "whether its answers have an MD5",
        },
    ],
    ids: &[],
    wire: Wire::Bytes,
    connect: |address, _| {
        let settings = sim_ocean::OceanSettings {
            lamp: address.number("lamp").unwrap_or(1.0),
            checked: address.flag("checksum"),
            ..Default::default()
        };
        Ok(Line::bytes(InMemory::new(sim_ocean::Ocean::new(settings))))
    },
    open,
};

fn connect(address: &mut Address, deadline: &Deadline) -> Result<Line, DeviceError> {
    match &address.place {
        None => {
            let (usb, endpoints) = ocean::open()?;
            Ok(Line::bytes(ocean::Bulk::new(usb, endpoints)))
        }
        Some(place) if place.starts_with("tcp:") => {
            super::line::serial(ocean::DEVICE, address, deadline)
        }
        // A serial line has no checksum, and few of their spectra would be whole.
        Some(place) => Err(DeviceError::transport(
            ocean::DEVICE,
            TransportError::NotFound {
                what: place.clone(),
                hint: format!("write {}, or ocean alone for USB", address.driver.place.example),
            },
        )),
    }
}

fn open(line: Line, address: &Address, deadline: &Deadline) -> Result<AnyDevice, DeviceError> {
    let model = address.text("model").and_then(ocean::Model::named);
    let settings = ocean::ObpSettings { model, ..Default::default() };
    let link = ocean::LinkSettings::default();
    let device = ocean::Obp::open(line.into_bytes(ocean::DEVICE)?, link, settings, deadline)?;
    Ok(AnyDevice::Spectrometer(Box::new(device)))
}
