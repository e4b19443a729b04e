//! Newport's motion controllers, and simulated ones.

use super::elliptec::turning;
use super::options::OptionKind::{Flag, Integer, Number, Pair};
use super::{
    Address, AnyDevice, Bus, Driver, Kind, Line, OptionKind, OptionSpec, Place, UsbId, Wire,
};
use crate::clock::Deadline;
use crate::device::DeviceError;
use crate::newport::{esp, smc100};
use crate::simulated::InMemory;
use crate::simulated::esp301::{Esp301, Esp301Settings};
use crate::simulated::smc100::{Smc100, Smc100Settings};
use crate::transport::serial::{Flow, PortSettings};

const fn option(
    name: &'static str,
    kind: OptionKind,
    default: &'static str,
    about: &'static str,
) -> OptionSpec {
    OptionSpec { name, kind, default, about }
}

const INVERTED: OptionSpec =
    option("inverted", Flag, "no", "angles grow while the controller's positions fall");
const ZERO: OptionSpec =
    option("zero_deg", Number(-1e6, 1e6), "0", "the angle at which the controller's position is 0");
const TRAVEL: OptionSpec = option("travel_deg", Pair, "", "angles between which it may stand");
const TOLERANCE: OptionSpec = option(
    "tolerance_deg",
    Number(0.0, 360.0),
    "0.01",
    "how far from its target it may come to rest",
);

const fn esp_options(trust: &'static str) -> [OptionSpec; 9] {
    [
        option(
            "baud",
            Integer(1200, 1_000_000),
            "921600",
            "speed of the serial line (ESP300: 19200)",
        ),
        option("rts_cts", Flag, "no", "flow control by RTS and CTS (ESP300: yes)"),
        option("axis", Integer(1, 3), "1", "the controller's axis"),
        option(
            "home_mode",
            Integer(0, 6),
            "",
            "kind of reference search, as the manual numbers them; the controller's own if it is not given",
        ),
        INVERTED,
        ZERO,
        TRAVEL,
        TOLERANCE,
        option("trust_counter", Flag, trust, "take the position as it is: it was homed before"),
    ]
}

const fn smc_options() -> [OptionSpec; 7] {
    [
        option(
            "baud",
            Integer(1200, 1_000_000),
            "57600",
            "speed of the serial line (CONEX-CC: 921600)",
        ),
        option("address", Integer(1, 31), "1", "the controller's address on its line"),
        INVERTED,
        ZERO,
        TRAVEL,
        TOLERANCE,
        option(
            "trust_counter",
            Flag,
            "no",
            "take the position as it is, though the controller says that it has no reference",
        ),
    ]
}

/// Newport ESP301 and ESP300.
pub(super) static ESP301: Driver = Driver {
    name: "esp301",
    kind: Kind::RotationStage,
    vendor: "Newport",
    title: "rotation stages on ESP301 and ESP300 controllers",
    tried: "our simulated controller, which pymeasure 0.16.0 drives too; no real controller yet",
    simulated: false,
    place: Place { form: "PORT", example: "esp301:/dev/ttyUSB0", optional: true },
    options: &esp_options("no"),
    // From memory.
    ids: &[UsbId {
        bus: Bus::Serial,
        vendor: 0x104d,
        product: Some(0x3001),
        name: "Newport ESP301",
    }],
    wire: Wire::Bytes,
    connect: |address, deadline| {
        let mut port = PortSettings::at(address.integer("baud").unwrap_or(921_600));
        if address.flag("rts_cts") {
            port.flow = Flow::RtsCts;
        }
        super::line::serial_with(esp::DEVICE, address, port, deadline)
    },
    open: open_esp,
};

/// The simulated ESP301.
pub(super) static SIM_ESP301: Driver = Driver {
    name: "sim-esp301",
    kind: Kind::RotationStage,
    vendor: "sunglint",
    title: "a simulated ESP301 with one axis",
    tried: "driven by pymeasure 0.16.0",
    simulated: true,
    place: Place { form: "", example: "sim-esp301", optional: true },
    options: &esp_options("yes"),
    ids: &[],
    wire: Wire::Bytes,
    connect: |_, _| Ok(Line::bytes(InMemory::new(Esp301::new(Esp301Settings::default())))),
    open: open_esp,
};

fn open_esp(line: Line, address: &Address, deadline: &Deadline) -> Result<AnyDevice, DeviceError> {
    let mut link = esp::LinkSettings::default();
    link.axis = address.integer("axis").unwrap_or(link.axis);
    link.home_mode = address.integer("home_mode");
    let mut stage = esp::open(line.into_bytes(esp::DEVICE)?, link, turning(address), deadline)?;
    if address.flag("trust_counter") {
        stage.trust_counter();
    }
    Ok(AnyDevice::RotationStage(Box::new(stage)))
}

/// Newport SMC100 and CONEX-CC.
pub(super) static SMC100: Driver = Driver {
    name: "smc100",
    kind: Kind::RotationStage,
    vendor: "Newport",
    title: "rotation stages on SMC100 and CONEX-CC controllers",
    tried: "our simulated controller, which no other program has driven; no real controller yet",
    simulated: false,
    place: Place { form: "PORT", example: "smc100:/dev/ttyUSB0", optional: false },
    options: &smc_options(),
    ids: &[],
    wire: Wire::Bytes,
    connect: |address, deadline| {
        let port = PortSettings::at(address.integer("baud").unwrap_or(57_600));
        let port = PortSettings { flow: Flow::XonXoff, ..port };
        super::line::serial_with(smc100::DEVICE, address, port, deadline)
    },
    open: open_smc,
};

/// The simulated SMC100.
pub(super) static SIM_SMC100: Driver = Driver {
    name: "sim-smc100",
    kind: Kind::RotationStage,
    vendor: "sunglint",
    title: "a simulated SMC100",
    tried: "our own driver only",
    simulated: true,
    place: Place { form: "", example: "sim-smc100", optional: true },
    options: &smc_options(),
    ids: &[],
    wire: Wire::Bytes,
    connect: |address, _| {
        let address = address.integer("address").unwrap_or(1);
        let settings = Smc100Settings { address, referenced: true, ..Default::default() };
        Ok(Line::bytes(InMemory::new(Smc100::new(settings))))
    },
    open: open_smc,
};

fn open_smc(line: Line, address: &Address, deadline: &Deadline) -> Result<AnyDevice, DeviceError> {
    let mut link = smc100::LinkSettings::default();
    link.address = address.integer("address").unwrap_or(link.address);
    let mut stage =
        smc100::open(line.into_bytes(smc100::DEVICE)?, link, turning(address), deadline)?;
    if address.flag("trust_counter") {
        stage.trust_counter();
    }
    Ok(AnyDevice::RotationStage(Box::new(stage)))
}
