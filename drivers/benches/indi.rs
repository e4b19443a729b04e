//! A frame of an Atik 414EX (1391 × 1039 px of 16 bits) from the bytes of an INDI stream to pixels, and the parts of the way.
//!
//! `cargo bench -p sunglint-drivers --bench indi`
//!
//! All lines count the 2.9 MB of the FITS file, so that they can be compared.

#![expect(clippy::unwrap_used, reason = "a benchmark that cannot run should stop")]

use divan::counter::BytesCount;
use divan::{Bencher, black_box};
use ndarray::Array2;
use std::sync::{Arc, LazyLock};
use std::time::Duration;
use sunglint_drivers::clock::{Deadline, VirtualClock};
use sunglint_drivers::device::Camera as _;
use sunglint_drivers::indi::base64::{self, Decoder};
use sunglint_drivers::indi::xml::{Limits, Parser};
use sunglint_drivers::indi::{CameraSettings, open_camera};
use sunglint_drivers::simulated::indi::{CameraSpec, Server, ServerSettings, Shot, Simulated};
use sunglint_formats::Frame;
use sunglint_formats::fits::{Fits, Header, Image, Pixels, Writer};

const SENSOR: [u32; 2] = [1391, 1039];

fn main() {
    divan::main();
}

fn pixels() -> Array2<u16> {
    Array2::from_shape_fn((1039, 1391), |(y, x)| (x * 31 + y * 257) as u16)
}

static FITS: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let mut header = Header::default();
    header.set("DATE-OBS", "2026-01-01T00:00:00.000", "");
    header.set("EXPTIME", 0.5, "");
    let mut writer = Writer::new();
    writer.image(&Image { header, pixels: Pixels::U16(pixels().into_dyn()) }).unwrap();
    writer.into_bytes()
});

static TEXT: LazyLock<String> = LazyLock::new(|| base64::encode(&FITS));

static STREAM: LazyLock<String> = LazyLock::new(|| {
    let length = FITS.len();
    format!(
        "<setBLOBVector device=\"c\" name=\"CCD1\" state=\"Ok\"><oneBLOB name=\"CCD1\" size=\"{length}\" format=\".fits\" len=\"{length}\">\n{}</oneBLOB></setBLOBVector>",
        *TEXT
    )
});

fn bytes() -> BytesCount {
    BytesCount::new(FITS.len())
}

#[divan::bench]
fn copy(bencher: Bencher) {
    bencher.counter(bytes()).bench_local(|| black_box(&*FITS).clone());
}

#[divan::bench]
fn base64_decoded(bencher: Bencher) {
    bencher.counter(bytes()).bench_local(|| {
        let mut decoder = Decoder::default();
        decoder.feed(black_box(TEXT.as_bytes())).unwrap();
        decoder.finish().unwrap()
    });
}

#[divan::bench]
fn fits_to_frame(bencher: Bencher) {
    bencher.counter(bytes()).with_inputs(|| FITS.clone()).bench_local_values(|bytes| {
        Frame::from_fits(&Fits::from_bytes("f", bytes).unwrap()).unwrap()
    });
}

/// XML and base64, in pieces as a socket gives them.
#[divan::bench]
fn stream_to_blob(bencher: Bencher) {
    bencher.counter(bytes()).bench_local(|| {
        let mut parser = Parser::new(Limits::default());
        let mut element = None;
        for piece in STREAM.as_bytes().chunks(64 << 10) {
            parser.feed(black_box(piece));
            element = parser.element().unwrap();
        }
        element.unwrap()
    });
}

/// An exposure on the simulated server, its own work (making, writing and encoding the frame) included.
#[divan::bench]
fn exposure_with_its_server(bencher: Bencher) {
    let clock = Arc::new(VirtualClock::new());
    let within = |s| Deadline::after(clock.clone(), Duration::from_secs(s));
    let camera = CameraSpec { sensor_px: SENSOR, ..CameraSpec::default() };
    let settings = ServerSettings { camera: Some(camera), ..ServerSettings::default() };
    let frame = pixels();
    let line = Simulated::new(Server::new(settings, move |_: &Shot| frame.clone()));
    let mut camera =
        open_camera(line, "Simulated Camera", CameraSettings::default(), &within(9)).unwrap();
    bencher.counter(bytes()).bench_local(|| camera.expose(0.5, &within(9)).unwrap());
}
