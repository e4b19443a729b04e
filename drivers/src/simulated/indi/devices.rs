//! The simulated devices' properties as they are after power-on.

use super::wire::{numbers, switches, texts};
use crate::indi::property::{Kind, Member, Place, Value, Vector};
use std::time::Duration;
use sunglint_formats::Bayer;

/// A camera.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraSpec {
    /// Name of the device.
    pub name: String,
    /// Columns and rows of its sensor, px.
    pub sensor_px: [u32; 2],
    /// The colours of its sensor's first 2 × 2 pixels, if it has any. Whatever the origin, its frames' headers say these.
    pub bayer: Option<Bayer>,
    /// Whether it can be cooled; otherwise it only says its temperature.
    pub cooled: bool,
    /// How long reading takes.
    pub readout: Duration,
}

impl Default for CameraSpec {
    /// A small monochrome camera with a cooler.
    fn default() -> Self {
        Self {
            name: "Simulated Camera".into(),
            sensor_px: [160, 120],
            bayer: None,
            cooled: true,
            readout: Duration::from_millis(50),
        }
    }
}

/// A rotator.
#[derive(Debug, Clone, PartialEq)]
pub struct RotatorSpec {
    /// Name of the device.
    pub name: String,
    /// How fast it turns, deg/s.
    pub speed_deg_s: f64,
}

impl Default for RotatorSpec {
    fn default() -> Self {
        Self { name: "Simulated Rotator".into(), speed_deg_s: 10.0 }
    }
}

/// A filter wheel.
#[derive(Debug, Clone, PartialEq)]
pub struct WheelSpec {
    /// Name of the device.
    pub name: String,
    /// The names of its filters, that of slot 1 first.
    pub filters: Vec<String>,
    /// How long a change takes.
    pub change: Duration,
}

impl Default for WheelSpec {
    fn default() -> Self {
        let filters = ["Clear", "Red", "Green", "Blue", "Dark"].map(str::to_owned).to_vec();
        Self { name: "Simulated Wheel".into(), filters, change: Duration::from_millis(500) }
    }
}

/// Returns the vectors that a device has before it is connected.
pub(super) fn always(device: &str, interface: u32) -> Vec<(Place, Vector)> {
    let interface = interface.to_string();
    let info = texts(&[
        ("DRIVER_NAME", device),
        ("DRIVER_EXEC", "sunglint"),
        ("DRIVER_VERSION", env!("CARGO_PKG_VERSION")),
        ("DRIVER_INTERFACE", &interface),
    ]);
    let connection = switches(&[("CONNECT", false), ("DISCONNECT", true)]);
    place_all(device, vec![("CONNECTION", connection), ("DRIVER_INFO", info)])
}

fn place_all(device: &str, vectors: Vec<(&str, Vector)>) -> Vec<(Place, Vector)> {
    let place = |name: &str| Place { device: device.to_owned(), name: name.to_owned() };
    vectors.into_iter().map(|(name, vector)| (place(name), vector)).collect()
}

/// Returns the vectors that a camera has once it is connected.
pub(super) fn camera(spec: &CameraSpec) -> Vec<(Place, Vector)> {
    let [columns, rows] = spec.sensor_px.map(f64::from);
    let frame = numbers(&[
        ("X", 0.0, [0.0, columns - 1.0]),
        ("Y", 0.0, [0.0, rows - 1.0]),
        ("WIDTH", columns, [1.0, columns]),
        ("HEIGHT", rows, [1.0, rows]),
    ]);
    let mut info =
        numbers(&[("CCD_MAX_X", columns, [1.0, 16000.0]), ("CCD_MAX_Y", rows, [1.0, 16000.0])]);
    info.writable = false;
    let mut temperature = numbers(&[("CCD_TEMPERATURE_VALUE", 20.0, [-50.0, 50.0])]);
    temperature.writable = spec.cooled;
    let blob = Member { name: "CCD1".into(), value: Value::Blob, range: None };
    let mut vectors = vec![
        ("CCD_EXPOSURE", numbers(&[("CCD_EXPOSURE_VALUE", 1.0, [0.001, 3600.0])])),
        ("CCD_ABORT_EXPOSURE", switches(&[("ABORT", false)])),
        ("CCD_FRAME", frame.clone()),
        ("CCD_STREAM_FRAME", frame),
        ("CCD_BINNING", numbers(&[("HOR_BIN", 1.0, [1.0, 4.0]), ("VER_BIN", 1.0, [1.0, 4.0])])),
        ("CCD_INFO", info),
        ("CCD_GAIN", numbers(&[("GAIN", 90.0, [0.0, 100.0])])),
        ("CCD_TEMPERATURE", temperature),
        (
            "CCD_FRAME_TYPE",
            switches(&[
                ("FRAME_LIGHT", true),
                ("FRAME_BIAS", false),
                ("FRAME_DARK", false),
                ("FRAME_FLAT", false),
            ]),
        ),
        ("CCD_TRANSFER_FORMAT", switches(&[("FORMAT_FITS", true), ("FORMAT_NATIVE", false)])),
        ("CCD_COMPRESSION", switches(&[("INDI_ENABLED", false), ("INDI_DISABLED", true)])),
        ("CCD_VIDEO_STREAM", switches(&[("STREAM_ON", false), ("STREAM_OFF", true)])),
        ("STREAMING_EXPOSURE", numbers(&[("STREAMING_EXPOSURE_VALUE", 0.1, [0.001, 60.0])])),
        ("CCD1", Vector::new(Kind::Blob, false, vec![blob])),
    ];
    if let Some(bayer) = spec.bayer {
        let cfa = [("CFA_OFFSET_X", "0"), ("CFA_OFFSET_Y", "0"), ("CFA_TYPE", bayer.name())];
        vectors.push(("CCD_CFA", texts(&cfa)));
    }
    place_all(&spec.name, vectors)
}

/// Returns the vectors that a rotator has once it is connected.
pub(super) fn rotator(spec: &RotatorSpec) -> Vec<(Place, Vector)> {
    let angle = numbers(&[("ANGLE", 0.0, [0.0, 360.0])]);
    let vectors = vec![
        ("ABS_ROTATOR_ANGLE", angle.clone()),
        ("SYNC_ROTATOR_ANGLE", angle),
        ("ROTATOR_ABORT_MOTION", switches(&[("ABORT", false)])),
        ("ROTATOR_HOME", switches(&[("HOME", false)])),
        ("ROTATOR_REVERSE", switches(&[("INDI_ENABLED", false), ("INDI_DISABLED", true)])),
    ];
    place_all(&spec.name, vectors)
}

/// Returns the vectors that a wheel has once it is connected.
pub(super) fn wheel(spec: &WheelSpec) -> Vec<(Place, Vector)> {
    let slots = spec.filters.len() as f64;
    let names: Vec<String> =
        (1..=spec.filters.len()).map(|slot| format!("FILTER_SLOT_NAME_{slot}")).collect();
    let pairs: Vec<(&str, &str)> =
        names.iter().map(String::as_str).zip(spec.filters.iter().map(String::as_str)).collect();
    let vectors = vec![
        ("FILTER_SLOT", numbers(&[("FILTER_SLOT_VALUE", 1.0, [1.0, slots])])),
        ("FILTER_NAME", texts(&pairs)),
    ];
    place_all(&spec.name, vectors)
}
