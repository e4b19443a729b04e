//! The INDI client on our own simulated server (synthetic): what frames hold, to the pixel, and how a server fails.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use hifitime::Epoch;
use std::ops::ControlFlow;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use sunglint_drivers::catalogue::Address;
use sunglint_drivers::clock::{Cancel, Clock as _, Deadline, VirtualClock, utc_now};
use sunglint_drivers::device::{
    Camera as _, Device as _, DeviceError, FilterWheel as _, RotationStage as _, Window,
};
use sunglint_drivers::indi::{
    Camera, CameraSettings, RotatorSettings, SessionSettings, devices, open_camera, open_rotator,
    open_wheel,
};
use sunglint_drivers::simulated::indi::{
    CameraSpec, OneColour, Packing, Ramp, Scene, Server, ServerSettings, Simulated, Trouble, serve,
};
use sunglint_drivers::transport::tcp::Tcp;
use sunglint_drivers::transport::{Bytes, TransportError};
use sunglint_formats::{Bayer, Frame};

const CAMERA: &str = "Simulated Camera";
const ROTATOR: &str = "Simulated Rotator";
const WHEEL: &str = "Simulated Wheel";

struct Desk {
    clock: Arc<VirtualClock>,
    /// UTC of the server at the clock's zero: the host's, as its virtual time is short.
    epoch: Epoch,
}

impl Desk {
    fn new() -> Self {
        Self { clock: Arc::new(VirtualClock::new()), epoch: utc_now() }
    }

    fn within(&self, seconds: f64) -> Deadline {
        Deadline::after(self.clock.clone(), Duration::from_secs_f64(seconds))
    }

    fn camera(
        &self,
        spec: CameraSpec,
        scene: impl Scene + 'static,
        trouble: Trouble,
    ) -> Camera<Simulated> {
        let epoch = self.epoch;
        let settings = ServerSettings { camera: Some(spec), epoch, ..ServerSettings::default() };
        let mut server = Server::new(settings, scene);
        server.trouble = trouble;
        open_camera(Simulated::new(server), CAMERA, CameraSettings::default(), &self.within(10.0))
            .unwrap()
    }
}

fn window(x: u32, y: u32, columns: u32, rows: u32) -> Window {
    Window { origin_px: [x, y], size_px: [columns, rows], binning: [1, 1] }
}

/// The lit pixels of a frame are exactly those which its own pattern says have that colour.
fn assert_only(frame: &Frame, colour: char, adu: u16) {
    let pattern = frame.bayer.unwrap().name().as_bytes();
    for ((row, column), &pixel) in frame.pixels.indexed_iter() {
        let here = char::from(pattern[row % 2 * 2 + column % 2]);
        assert_eq!(pixel, if here == colour { adu } else { 0 }, "{here} at {column}, {row}");
    }
}

/// Truth: the mosaic of the scene, pixel by pixel on the sensor, which knows nothing of frames. All patterns, all phases.
#[test]
fn the_pattern_of_a_frame_is_that_of_its_pixels() {
    let desk = Desk::new();
    for pattern in [Bayer::Rggb, Bayer::Grbg, Bayer::Gbrg, Bayer::Bggr] {
        for colour in ['R', 'G', 'B'] {
            let spec = CameraSpec { bayer: Some(pattern), ..CameraSpec::default() };
            let mut camera =
                desk.camera(spec, OneColour { pattern, colour, adu: 5_000 }, Trouble::default());
            assert_eq!(camera.bayer(), Some(pattern));
            for (x, y) in [(0, 0), (51, 40), (50, 41), (51, 41)] {
                camera.set_window(window(x, y, 20, 10), &desk.within(5.0)).unwrap();
                let frame = camera.expose(0.1, &desk.within(5.0)).unwrap();
                assert_eq!(frame.origin, [x, y]);
                assert_only(&frame, colour, 5_000);
                let mut streamed = Vec::new();
                let mut take = |frame| {
                    streamed.push(frame);
                    if streamed.len() == 2 {
                        ControlFlow::Break(())
                    } else {
                        ControlFlow::Continue(())
                    }
                };
                assert_eq!(camera.stream(0.02, &mut take, &desk.within(5.0)).unwrap(), 2);
                streamed.iter().for_each(|frame| assert_only(frame, colour, 5_000 >> 8));
            }
            let binned = Window { origin_px: [2, 4], size_px: [20, 10], binning: [2, 2] };
            camera.set_window(binned, &desk.within(5.0)).unwrap();
            assert_eq!(camera.expose(0.1, &desk.within(5.0)).unwrap().bayer, None);
        }
    }
}

/// Truth: the scene's own formula; the server's clock, which began with the test; what was set.
#[test]
fn a_frame_is_the_right_part_of_the_right_exposure() {
    let desk = Desk::new();
    let mut camera = desk.camera(CameraSpec::default(), Ramp, Trouble::default());
    camera.set_gain(12.5, &desk.within(5.0)).unwrap();
    assert_eq!(camera.set_temperature_c(-20.0, &desk.within(5.0)).unwrap(), 20.0);
    for (exposure_s, part) in [
        (0.25, window(0, 0, 160, 120)),
        (1.5, window(51, 33, 7, 9)),
        (0.001, Window { origin_px: [4, 2], size_px: [21, 9], binning: [4, 2] }),
    ] {
        camera.set_window(part, &desk.within(5.0)).unwrap();
        let asked = desk.clock.now();
        let frame = camera.expose(exposure_s, &desk.within(5.0)).unwrap();
        let (rows, columns) =
            (part.size_px[1] / part.binning[1], part.size_px[0] / part.binning[0]);
        assert_eq!(frame.pixels.dim(), (rows as usize, columns as usize));
        for ((row, column), &pixel) in frame.pixels.indexed_iter() {
            let x = part.origin_px[0] + column as u32 * part.binning[0];
            let y = part.origin_px[1] + row as u32 * part.binning[1];
            assert_eq!(pixel, Ramp::adu(x, y, exposure_s), "at {column}, {row}");
        }
        let start_s = (frame.start - desk.epoch).to_seconds();
        // DATE-OBS is cut to the millisecond; before it the camera looks for 2 ms whether another program's frame came.
        let late_s = start_s - asked.as_secs_f64();
        assert!((-0.001..=0.003).contains(&late_s), "{start_s}, {asked:?}");
        assert_eq!(
            (frame.exposure_s, frame.origin, frame.binning),
            (exposure_s, part.origin_px, part.binning)
        );
        assert_eq!(frame.header.real("GAIN"), Some(12.5));
        assert_eq!(frame.header.text("FILTER"), None);
        assert!(frame.header.text("HOSTDATE").is_some() && frame.header.real("HOSTDIFF").is_some());
    }
    desk.clock.sleep(Duration::from_secs(3));
    assert_eq!(camera.expose(0.1, &desk.within(5.0)).unwrap().temperature_c, Some(-20.0));
    let settings = camera.settings(&desk.within(5.0)).unwrap();
    assert!(settings.iter().any(|s| s.name == "temperature_c" && s.value.to_string() == "-20"));
}

/// Truth: the same frame, packed with zlib by the server.
#[test]
fn packed_frames() {
    let desk = Desk::new();
    let server = Server::new(ServerSettings::default(), Ramp);
    let settings = CameraSettings { packed: true, ..CameraSettings::default() };
    let mut camera =
        open_camera(Simulated::new(server), CAMERA, settings, &desk.within(10.0)).unwrap();
    let frame = camera.expose(0.1, &desk.within(5.0)).unwrap();
    assert_eq!(frame.pixels[[119, 159]], Ramp::adu(159, 119, 0.1));
    assert_eq!(frame.pixels.dim(), (120, 160));
}

/// Truth: what the server was told to do wrong; the deadlines. After each the camera takes a good frame, if need be after it
/// was opened again.
#[test]
fn a_camera_whose_server_fails() {
    let cases = [
        (
            Trouble {
                alert: Some(("CCD_EXPOSURE".into(), "[ERROR] the shutter is stuck".into())),
                ..Trouble::default()
            },
            "INDI camera refused an exposure of 1 s: [ERROR] the shutter is stuck",
        ),
        (
            Trouble { no_blob: true, ..Trouble::default() },
            "INDI camera: the frame of an exposure of 1 s did not come within 5.000 s; meanwhile: 2 things, at last CCD_EXPOSURE Busy, CCD_EXPOSURE Ok",
        ),
        (
            Trouble { packing: Packing::TileCompressed, ..Trouble::default() },
            "INDI camera: the frame came tile-compressed (.fits.fz), which is not read: turn the camera's compression off (CCD_COMPRESSION)",
        ),
        (
            Trouble { packing: Packing::Cut, ..Trouble::default() },
            "INDI camera: the camera's BLOB: NAXIS1: found 0 bytes of data, expected 1200 bytes, as the header says (the file is cut off, or its header is wrong)",
        ),
        (
            Trouble { lose_device: true, ..Trouble::default() },
            "INDI camera: the driver of `Simulated Camera` has ended (delProperty); connect again once it is back",
        ),
        (
            Trouble { die: true, ..Trouble::default() },
            "INDI camera: the simulated INDI server is gone: check cable and power, then connect again",
        ),
    ];
    for (trouble, words) in cases {
        let desk = Desk::new();
        let mut camera = desk.camera(CameraSpec::default(), Ramp, trouble.clone());
        camera.set_window(window(3, 5, 30, 20), &desk.within(5.0)).unwrap();
        let begun = desk.clock.now();
        let error = camera.expose(1.0, &desk.within(5.0)).unwrap_err();
        // A sixth second for the abort.
        assert!(desk.clock.now() - begun <= Duration::from_secs(6), "{error}");
        assert_eq!(error.to_string(), words);
        let mut line = camera.into_line();
        line.server.trouble = Trouble::default();
        line.server.hang_up();
        if trouble.die {
            line.server.restart();
        }
        let mut camera =
            open_camera(line, CAMERA, CameraSettings::default(), &desk.within(10.0)).unwrap();
        let frame = camera.expose(0.2, &desk.within(5.0)).unwrap();
        let [x, y] = frame.origin;
        assert_eq!(frame.pixels[[0, 0]], Ramp::adu(x, y, 0.2));
    }
}

/// Truth: the token is set before the call; the server's camera stands still afterwards.
#[test]
fn a_cancelled_exposure_is_aborted_in_the_camera() {
    let desk = Desk::new();
    let mut camera = desk.camera(CameraSpec::default(), Ramp, Trouble::default());
    let cancel = Cancel::new();
    let deadline = desk.within(100.0).with_cancel(&cancel);
    let other = {
        let cancel = cancel.clone();
        std::thread::spawn(move || cancel.cancel())
    };
    other.join().unwrap();
    let error = camera.expose(30.0, &deadline).unwrap_err();
    assert!(matches!(error, DeviceError::Cancelled { .. }), "{error}");
    let frame = camera.expose(0.5, &desk.within(5.0)).unwrap();
    assert_eq!(frame.pixels[[0, 0]], Ramp::adu(0, 0, 0.5));
}

/// A line on which another client of the same server says something: after a request of ours that names `after`, or, where that is empty, before the next
/// answer is read.
struct Meddling {
    line: Simulated,
    after: &'static str,
    says: Arc<Mutex<Option<String>>>,
}

impl Meddling {
    fn new(server: Server, after: &'static str) -> (Self, Arc<Mutex<Option<String>>>) {
        let says = Arc::new(Mutex::new(None));
        (Self { line: Simulated::new(server), after, says: says.clone() }, says)
    }

    fn meddle(&mut self, deadline: &Deadline) -> Result<(), TransportError> {
        match self.says.lock().unwrap().take() {
            Some(text) => self.line.send(text.as_bytes(), deadline),
            None => Ok(()),
        }
    }
}

impl Bytes for Meddling {
    fn send(&mut self, bytes: &[u8], deadline: &Deadline) -> Result<(), TransportError> {
        self.line.send(bytes, deadline)?;
        match !self.after.is_empty() && String::from_utf8_lossy(bytes).contains(self.after) {
            true => self.meddle(deadline),
            false => Ok(()),
        }
    }
    fn receive(&mut self, buffer: &mut [u8], d: &Deadline) -> Result<usize, TransportError> {
        if self.after.is_empty() {
            self.meddle(d)?;
        }
        self.line.receive(buffer, d)
    }
    fn discard(&mut self, deadline: &Deadline) -> Result<Vec<u8>, TransportError> {
        self.line.discard(deadline)
    }
}

/// What a client says to set a number.
fn set_number(device: &str, name: &str, member: &str, value: f64) -> Option<String> {
    Some(format!(
        "<newNumberVector device=\"{device}\" name=\"{name}\"><oneNumber name=\"{member}\">{value}</oneNumber></newNumberVector>"
    ))
}

/// A camera's computer whose clock is wrong. Truth: the host's own clock: by 12 s the frame's time is the host's, between request and frame, and the header has both; by 2 s the server's
/// own is kept, which knows better when it began.
#[test]
fn the_time_of_a_server_whose_clock_is_wrong_is_not_taken() {
    for (ahead_s, kept) in [(12.0, false), (-3600.0, false), (2.0, true)] {
        let mut desk = Desk::new();
        desk.epoch += hifitime::Duration::from_seconds(ahead_s);
        let mut camera = desk.camera(CameraSpec::default(), Ramp, Trouble::default());
        let before = utc_now();
        let frame = camera.expose(0.25, &desk.within(5.0)).unwrap();
        let after = utc_now();
        let off_s = (frame.start - before).to_seconds();
        assert_eq!(before <= frame.start && frame.start <= after, !kept, "{ahead_s}: {off_s}");
        let said = frame.header.real("HOSTDIFF").unwrap();
        assert!((said - ahead_s).abs() < 2.0, "{ahead_s}: {said}");
        let cards = ["DATE-SRV", "TIMRDER"].map(|key| frame.header.get(key).is_some());
        assert_eq!(cards, [!kept; 2], "{ahead_s}");
        if kept {
            assert!((off_s - ahead_s).abs() < 2.0, "{off_s}");
        } else {
            let sigma_s = frame.header.real("TIMRDER").unwrap();
            assert!(sigma_s > 0.0 && sigma_s <= (after - before).to_seconds().max(1e-3));
        }
    }
}

/// Another client that asks for the same exposure a moment after us. Truth: what it was told to do: the frame that came then may be its own and says so; those before and after are ours alone.
#[test]
fn another_client_that_wants_the_same_exposure_is_noticed() {
    let desk = Desk::new();
    let server =
        Server::new(ServerSettings { epoch: desk.epoch, ..ServerSettings::default() }, Ramp);
    let (line, says) = Meddling::new(server, "CCD_EXPOSURE_VALUE");
    let mut camera =
        open_camera(line, CAMERA, CameraSettings::default(), &desk.within(10.0)).unwrap();
    let mut shared = |meddles: bool| {
        if meddles {
            *says.lock().unwrap() = set_number(CAMERA, "CCD_EXPOSURE", "CCD_EXPOSURE_VALUE", 0.5);
        }
        let frame = camera.expose(0.5, &desk.within(5.0)).unwrap();
        frame.header.get("SHARED").is_some()
    };
    assert_eq!([false, true, false].map(&mut shared), [false, true, false]);
}

/// Another client that turns the wheel. Truth: what it was told to do: the wheel turned, then slot 3 stood in the beam; each is given once, without a question.
#[test]
fn a_wheel_that_another_client_turns_says_so() {
    let desk = Desk::new();
    let (line, says) = Meddling::new(Server::new(ServerSettings::default(), Ramp), "");
    let mut wheel =
        open_wheel(line, WHEEL, SessionSettings::default(), &desk.within(10.0)).unwrap();
    assert_eq!(wheel.look(&desk.within(1.0)).unwrap(), [Some(1)]);
    assert_eq!(wheel.heard(&desk.within(1.0)).unwrap(), []);
    let turn =
        || *says.lock().unwrap() = set_number(WHEEL, "FILTER_SLOT", "FILTER_SLOT_VALUE", 3.0);
    turn();
    let mut heard = wheel.heard(&desk.within(1.0)).unwrap();
    desk.clock.sleep(Duration::from_secs(1));
    heard.extend(wheel.heard(&desk.within(1.0)).unwrap());
    assert_eq!(heard, [None, Some(3)]);
    assert_eq!(wheel.look(&desk.within(1.0)).unwrap(), [Some(3)]);
    // While it turns a look is no failure.
    *says.lock().unwrap() = set_number(WHEEL, "FILTER_SLOT", "FILTER_SLOT_VALUE", 2.0);
    assert_eq!(wheel.look(&desk.within(1.0)).unwrap().last(), Some(&None));
    desk.clock.sleep(Duration::from_secs(1));
    assert_eq!(wheel.look(&desk.within(1.0)).unwrap(), [Some(2), Some(2)]);
}

/// Another client of the same server, in the middle of our exposure. Truth: what it was told to do; a frame of the same size
/// at another origin must not be taken for ours.
#[test]
fn a_window_that_another_client_moves() {
    let desk = Desk::new();
    let server = Server::new(ServerSettings::default(), Ramp);
    let (line, says) = Meddling::new(server, "CCD_EXPOSURE_VALUE");
    let mut camera =
        open_camera(line, CAMERA, CameraSettings::default(), &desk.within(10.0)).unwrap();
    *says.lock().unwrap() = set_number(CAMERA, "CCD_FRAME", "X", 4.0);
    camera.set_window(window(3, 5, 30, 20), &desk.within(5.0)).unwrap();
    let error = camera.expose(0.5, &desk.within(5.0)).unwrap_err().to_string();
    assert!(error.contains("another program has changed its window"), "{error}");
    camera.set_window(window(3, 5, 30, 20), &desk.within(5.0)).unwrap();
    let frame = camera.expose(0.5, &desk.within(5.0)).unwrap();
    assert_eq!((frame.origin, frame.pixels[[0, 0]]), ([3, 5], Ramp::adu(3, 5, 0.5)));
}

/// A camera that only shows its temperature, and values out of range. Truth: the definitions of the server.
#[test]
fn what_a_camera_cannot_do_is_said_before_it_is_tried() {
    let desk = Desk::new();
    let spec = CameraSpec { cooled: false, ..CameraSpec::default() };
    let mut camera = desk.camera(spec, Ramp, Trouble::default());
    let d = desk.within(60.0);
    assert!(matches!(camera.set_temperature_c(0.0, &d), Err(DeviceError::NotReady { .. })));
    for bad in [0.0, -1.0, 3601.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(camera.expose(bad, &d), Err(DeviceError::OutOfRange { .. })), "{bad}");
    }
    for bad in [
        window(0, 0, 161, 120),
        window(160, 0, 1, 1),
        window(0, 0, 0, 1),
        window(u32::MAX, 0, u32::MAX, 1),
        Window { binning: [5, 1], ..window(0, 0, 100, 100) },
        Window { binning: [0, 1], ..window(0, 0, 100, 100) },
    ] {
        assert!(
            matches!(camera.set_window(bad, &d), Err(DeviceError::OutOfRange { .. })),
            "{bad:?}"
        );
    }
    let odd = Window { binning: [2, 2], ..window(1, 0, 100, 100) };
    assert!(matches!(camera.set_window(odd, &d), Err(DeviceError::Unknown { .. })));
    let frame = camera.expose(0.1, &d).unwrap();
    assert_eq!((frame.pixels.dim(), frame.temperature_c), ((120, 160), Some(20.0)));
}

/// Truth: the server's own rotator and wheel, by what it says of them; its speeds.
#[test]
fn rotator_and_wheel_and_how_they_fail() {
    let desk = Desk::new();
    let line = || Simulated::new(Server::new(ServerSettings::default(), Ramp));
    let mut rotator =
        open_rotator(line(), ROTATOR, RotatorSettings::default(), &desk.within(10.0)).unwrap();
    assert_eq!(rotator.move_to(45.25, &desk.within(10.0)).unwrap(), 45.25);
    assert_eq!(rotator.home(&desk.within(10.0)).unwrap(), 0.0);
    assert_eq!(rotator.sync(359.0, &desk.within(10.0)).unwrap(), 359.0);
    assert_eq!(rotator.angle_deg(&desk.within(10.0)).unwrap(), 359.0);
    // 359° to 180° at 10°/s take 17.9 s.
    let late = rotator.move_to(180.0, &desk.within(5.0)).unwrap_err();
    let truth = rotator.line().server.vector(ROTATOR, "ABS_ROTATOR_ANGLE").unwrap().number("ANGLE");
    assert!(matches!(*late.error, DeviceError::Awaited { .. }), "{late}");
    assert_eq!(late.done, truth);
    assert!(rotator.line().server.is_at_rest(), "it was stopped");

    let mut wheel =
        open_wheel(line(), WHEEL, SessionSettings::default(), &desk.within(10.0)).unwrap();
    assert_eq!((wheel.slots(), wheel.names().len()), (5, 5));
    assert_eq!(wheel.select(4, &desk.within(10.0)).unwrap(), 4);
    assert_eq!(wheel.slot(&desk.within(10.0)).unwrap(), 4);

    let mut server = Server::new(ServerSettings::default(), Ramp);
    server.trouble.alert = Some(("FILTER_SLOT".into(), "[ERROR] jammed".into()));
    let mut wheel =
        open_wheel(Simulated::new(server), WHEEL, SessionSettings::default(), &desk.within(10.0))
            .unwrap();
    let jammed = wheel.select(2, &desk.within(10.0)).unwrap_err();
    assert_eq!(
        jammed.to_string(),
        "INDI filter wheel refused FILTER_SLOT FILTER_SLOT_VALUE=2: [ERROR] jammed"
    );
    assert_eq!(jammed.done, Some(1));

    let mut server = Server::new(ServerSettings::default(), Ramp);
    server.trouble.stuck = true;
    let mut wheel =
        open_wheel(Simulated::new(server), WHEEL, SessionSettings::default(), &desk.within(10.0))
            .unwrap();
    let begun = desk.clock.now();
    let stuck = wheel.select(2, &desk.within(10.0)).unwrap_err();
    assert_eq!((desk.clock.now() - begun, stuck.done), (Duration::from_secs(10), None));
}

/// A device whose name is misspelt. Truth: the server's own devices, which it tells only on another connection.
#[test]
fn a_server_without_the_device_is_asked_what_it_has() {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let place = listener.local_addr().unwrap();
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let mut line = Tcp::from_stream(stream.unwrap()).unwrap();
            let server = Server::new(ServerSettings::default(), Ramp);
            std::thread::spawn(move || {
                // The client's going away is the usual end.
                let _ = serve(server, &mut line, &crate::common::within(60.0));
            });
        }
    });
    let mut address = Address::parse(&format!("indi-camera:{place}/Simulated Camra"), &[]).unwrap();
    let deadline = crate::common::within(10.0);
    let line = address.connect(&deadline).unwrap();
    let error = address.open(line, &deadline).err().unwrap();
    assert!(error.is_not_served() && error.is_permanent_setting());
    let text = error.to_string();
    for name in ["Simulated Camra", "Simulated Camera", "Simulated Rotator", "Simulated Wheel"] {
        assert!(text.contains(name), "{name}: {text}");
    }
}

/// The same server through a real socket: the client connects, the server dies in an exposure, comes back, and the client goes
/// on. Truth: the scene's formula.
#[test]
fn through_a_socket_that_breaks() {
    let (host, mut device) = crate::common::tcp();
    let mut server = Server::new(ServerSettings::default(), Ramp);
    server.trouble.die = true;
    let other = std::thread::spawn(move || {
        serve(server, &mut device, &crate::common::within(30.0)).unwrap()
    });
    let mut camera =
        open_camera(host, CAMERA, CameraSettings::default(), &crate::common::within(20.0)).unwrap();
    camera.set_window(window(7, 9, 40, 30), &crate::common::within(5.0)).unwrap();
    let error = camera.expose(0.4, &crate::common::within(20.0)).unwrap_err();
    let gone =
        matches!(error, DeviceError::Transport { source: TransportError::Disconnected { .. }, .. });
    assert!(gone, "{error}");
    let mut server = other.join().unwrap();
    assert!(server.is_dead());
    server.restart();
    let (host, mut device) = crate::common::tcp();
    let other = std::thread::spawn(move || {
        serve(server, &mut device, &crate::common::within(30.0)).unwrap()
    });
    camera.reconnect(host, &crate::common::within(20.0)).unwrap();
    let frame = camera.expose(0.05, &crate::common::within(20.0)).unwrap();
    assert_eq!((frame.origin, frame.pixels.dim()), ([7, 9], (30, 40)));
    assert_eq!(frame.pixels[[29, 39]], Ramp::adu(46, 38, 0.05));
    drop(camera);
    other.join().unwrap();
}

/// Truth: the server's own devices: they are listed also where less than a second is left, as in the check of a night; and one of another kind is told as that, which no other try changes.
#[test]
fn devices_are_named_in_little_time() {
    let desk = Desk::new();
    let line = || {
        let camera = Some(CameraSpec::default());
        let settings = ServerSettings { camera, epoch: desk.epoch, ..ServerSettings::default() };
        Simulated::new(Server::new(settings, Ramp))
    };
    let listed = devices(line(), SessionSettings::default(), &desk.within(0.6)).unwrap();
    let names: Vec<_> = listed.iter().map(|device| device.name.as_str()).collect();
    assert!(names.contains(&CAMERA) && names.contains(&ROTATOR), "{names:?}");
    let wrong = open_rotator(line(), CAMERA, RotatorSettings::default(), &desk.within(10.0));
    let wrong = wrong.unwrap_err();
    assert!(matches!(wrong, DeviceError::WrongKind { .. }), "{wrong}");
    assert!(wrong.is_permanent_setting() && wrong.to_string().contains("is no rotator"), "{wrong}");
}
