//! Frame grabbers, films and numbered images, through OpenCV. The driver is a crate of its own, because OpenCV is a large library that not every build has: a
//! program that has it hands the driver over ([`provide`]).

use super::{Address, AnyDevice, Driver, Kind, Line, OptionKind, OptionSpec, Place, Wire};
use crate::clock::Deadline;
use crate::device::{Camera, DeviceError};
use std::sync::OnceLock;

/// Opens the camera that an address names.
pub type Open = fn(&Address, &Deadline) -> Result<Box<dyn Camera>, DeviceError>;

static OPEN: OnceLock<Open> = OnceLock::new();

/// Hands the driver over. The first one stays.
pub fn provide(open: Open) {
    let _ = OPEN.set(open);
}

/// Whether a program has handed the driver over.
pub fn is_provided() -> bool {
    OPEN.get().is_some()
}

/// Whether an address names pictures that were recorded: a film, or numbered images.
pub(super) fn is_recording(place: &str) -> bool {
    !place.starts_with("/dev/") && place.parse::<u32>().is_err()
}

const fn option(
    name: &'static str,
    kind: OptionKind,
    default: &'static str,
    about: &'static str,
) -> OptionSpec {
    OptionSpec { name, kind, default, about }
}

const PATTERNS: &[&str] = &["RGGB", "GRBG", "GBRG", "BGGR"];
const FORMATS: &[&str] = &["grey8", "grey16", "yuyv", "uyvy", "bgr", "bayer8"];
const PLANES: &[&str] = &["same", "blue", "green", "red"];
const FIELDS: &[&str] = &["none", "top", "bottom"];
const DOUBLED: &[&str] = &["leave-out", "keep"];

pub(super) static OPENCV: Driver = Driver {
    name: "opencv",
    kind: Kind::Camera,
    vendor: "OpenCV",
    title: "frame grabbers (Video4Linux), films and numbered images, in programs built with OpenCV",
    tried: "films and numbered images, through OpenCV 4.6; no live grabber yet",
    simulated: false,
    place: Place { form: "SOURCE", example: "opencv:/dev/video0", optional: false },
    options: &[
        option("format", OptionKind::Word(FORMATS), "grey8", "live: pixels asked of the grabber"),
        option("columns", OptionKind::Integer(1, 65_535), "", "live: columns, with rows"),
        option("rows", OptionKind::Integer(1, 65_535), "", "live: rows, with columns"),
        option("rate_hz", OptionKind::Number(1e-3, 1e5), "", "live: pictures a second"),
        option(
            "fixed_exposure_s",
            OptionKind::Number(1e-6, 1e4),
            "",
            "live: exposure of a grabber that cannot set it",
        ),
        option("plane", OptionKind::Word(PLANES), "same", "plane of a colour picture"),
        option("bayer", OptionKind::Word(PATTERNS), "", "mosaic at the first pixel"),
        option("lossy", OptionKind::Flag, "no", "takes lossy films, and says so in each frame"),
        option(
            "auto",
            OptionKind::Flag,
            "no",
            "live: takes automatic exposure and gain, and says so in each frame",
        ),
        option(
            "fields",
            OptionKind::Word(FIELDS),
            "none",
            "splits interlaced frames: which field was exposed first",
        ),
        option(
            "gamma",
            OptionKind::Number(0.1, 1.0),
            "",
            "undoes this gamma: recorded = light^gamma of full scale",
        ),
        option(
            "doubled",
            OptionKind::Word(DOUBLED),
            "leave-out",
            "frames that repeat the one before, all counted",
        ),
        option(
            "first_utc",
            OptionKind::Utc,
            "",
            "recording without a table: start of the first exposure",
        ),
        option(
            "exposure_s",
            OptionKind::Number(1e-9, 1e6),
            "",
            "recording without a table: length of the exposures",
        ),
        option(
            "interval_s",
            OptionKind::Number(1e-9, 1e6),
            "",
            "recording without a table: from one start to the next",
        ),
    ],
    ids: &[],
    wire: Wire::Library,
    connect: |_, _| Ok(Line::Library),
    open: |_, address, deadline| match OPEN.get() {
        Some(open) => open(address, deadline).map(AnyDevice::Camera),
        None => Err(DeviceError::Unavailable {
            device: "OpenCV",
            reason: "this program was built without it: build it with --features opencv (docs/devices-opencv.md)",
        }),
    },
};
