//! Spectrometers of Ocean Optics, and simulated ones.

use super::options::OptionKind::{Flag, Integer, Number, Word};
use super::{Address, AnyDevice, Bus, Driver, Kind, Line, OptionSpec, Place, UsbId, Wire};
use crate::clock::Deadline;
use crate::device::DeviceError;
use crate::ocean;
use crate::ocean::ooi::Model;
use crate::simulated::{InMemory, ocean as sim_ocean, ooi as sim_ooi};
use crate::transport::TransportError;

/// How many product numbers there are.
const IDS: usize = ocean::PRODUCTS.len() + Model::ALL.len();

const fn ids() -> [UsbId; IDS] {
    let empty = UsbId { bus: Bus::Usb, vendor: ocean::VENDOR, product: None, name: "" };
    let mut ids = [empty; IDS];
    let mut i = 0;
    while i < IDS {
        let (product, name) = if i < ocean::PRODUCTS.len() {
            ocean::PRODUCTS[i]
        } else {
            let model = &Model::ALL[i - ocean::PRODUCTS.len()];
            (model.product, model.title)
        };
        ids[i] = UsbId { product: Some(product), name, ..empty };
        i += 1;
    }
    ids
}

const MODEL: OptionSpec = OptionSpec {
    name: "model",
    kind: Word(&[
        "auto",
        "hdx",
        "fx",
        "sts",
        "ventana",
        "usb2000",
        "hr2000",
        "hr4000",
        "usb650",
        "hr2000plus",
        "qe65000",
        "usb2000plus",
        "usb4000",
        "nirquest512",
        "nirquest256",
        "maya2000pro",
        "maya2000",
        "torus",
        "apex",
        "mayalsl",
        "jaz",
    ]),
    default: "auto",
    about: "the model: its pixels, its limits, how it is asked; auto goes by its product number",
};

const STALE: OptionSpec = OptionSpec {
    name: "stale",
    kind: Integer(1, 8),
    default: "1",
    about: "spectra that are thrown away after a change of the time of integration",
};

/// Ocean Optics on OBP and on the older USB protocol.
pub(super) static OCEAN: Driver = Driver {
    name: "ocean",
    kind: Kind::Spectrometer,
    vendor: "Ocean Optics (Ocean Insight)",
    title: "spectrometers: HDX, FX by network; by USB HDX, STS, Ventana and the older USB2000, USB4000, Flame, HR2000, HR4000, QE65000, Maya, NIRQuest, Torus, Apex, Jaz, USB650",
    tried: "our simulated HDX over TCP and each older model in memory, which seabreeze 2.11.0 drives too; no real one yet",
    simulated: false,
    place: Place { form: "tcp:HOST:PORT", example: "ocean:tcp:192.168.1.20:57357", optional: true },
    options: &[MODEL, STALE],
    ids: &ids(),
    wire: Wire::Bytes,
    connect,
    open,
};

/// The simulated HDX, or one of the older models.
pub(super) static SIM_OCEAN: Driver = Driver {
    name: "sim-ocean",
    kind: Kind::Spectrometer,
    vendor: "sunglint",
    title: "a simulated HDX, or an older model by its name, that looks at a mercury-argon lamp",
    tried: "seabreeze 2.11.0 drives it, the HDX over TCP and each older model by its USB transport",
    simulated: true,
    place: Place { form: "", example: "sim-ocean", optional: true },
    options: &[
        MODEL,
        STALE,
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
            about: "whether the answers of an HDX have an MD5",
        },
    ],
    ids: &[],
    wire: Wire::Bytes,
    connect: |address, _| {
        let lamp = address.number("lamp").unwrap_or(1.0);
        if let Some(model) = older(address) {
            let settings = sim_ooi::OoiSettings { lamp, ..sim_ooi::OoiSettings::of(model) };
            return Ok(Line::transfers(sim_ooi::Ooi::new(settings)));
        }
        let settings = sim_ocean::OceanSettings {
            lamp,
            checked: address.flag("checksum"),
            ..Default::default()
        };
        Ok(Line::bytes(InMemory::new(sim_ocean::Ocean::new(settings))))
    },
    open,
};

/// The model on the older protocol that an address names.
fn older(address: &Address) -> Option<Model> {
    address.text(MODEL.name).and_then(Model::named)
}

/// Traffic on the line of an address, where the model says another than the driver.
pub(super) fn wire(address: &Address) -> Option<Wire> {
    let ours = [OCEAN.name, SIM_OCEAN.name].contains(&address.driver.name);
    (ours && older(address).is_some()).then_some(Wire::Transfers)
}

/// Product numbers that an address means on USB: those of its model, or all.
fn products(address: &Address) -> Vec<u16> {
    if let Some(model) = older(address) {
        return vec![model.product];
    }
    let obp = ocean::PRODUCTS.map(|(product, _)| product);
    match address.text(MODEL.name).and_then(ocean::Model::named) {
        // A model without a number on USB may be any that speaks as it does.
        Some(model) if obp.contains(&model.product) => vec![model.product],
        Some(_) => obp.to_vec(),
        None => obp.into_iter().chain(Model::ALL.map(|model| model.product)).collect(),
    }
}

fn connect(address: &mut Address, deadline: &Deadline) -> Result<Line, DeviceError> {
    match &address.place {
        None => {
            let (usb, product) = ocean::open_product(&products(address))?;
            match Model::of_product(product) {
                Some(model) => {
                    address.found(MODEL.name, model.option.to_owned());
                    Ok(Line::transfers(usb))
                }
                None => Ok(Line::bytes(ocean::Bulk::new(usb, ocean::endpoints(product)))),
            }
        }
        Some(place) if place.starts_with("tcp:") => match older(address) {
            None => super::line::serial(ocean::DEVICE, address, deadline),
            Some(model) => Err(DeviceError::transport(
                ocean::DEVICE,
                TransportError::NotFound {
                    what: format!("a {} at {place}", model.name),
                    hint: "it has no network: write ocean alone for USB".to_owned(),
                },
            )),
        },
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
    let stale = address.integer(STALE.name).unwrap_or(1);
    if let Some(model) = older(address) {
        let settings = ocean::ooi::OoiSettings { stale, ..Default::default() };
        let line = line.into_transfers(ocean::DEVICE)?;
        let device = ocean::ooi::Ooi::open(line, model, settings, deadline)?;
        return Ok(AnyDevice::Spectrometer(Box::new(device)));
    }
    let model = address.text(MODEL.name).and_then(ocean::Model::named);
    let settings = ocean::ObpSettings { model, stale };
    let link = ocean::LinkSettings::default();
    let device = ocean::Obp::open(line.into_bytes(ocean::DEVICE)?, link, settings, deadline)?;
    Ok(AnyDevice::Spectrometer(Box::new(device)))
}
