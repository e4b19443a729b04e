//! The INDI client against the simulators of indi-bin (1.9.9 in Debian 12), live.
//!
//! The simulator's pixels are sky glow and noise without a star catalogue, the same everywhere: what they are is checked on
//! our own server (`indi_simulated.rs`), here it is their number, the headers and how the server behaves.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use crate::common::indi::{CAMERA, ROTATOR, Server, WHEEL, live, within};
use hifitime::Epoch;
use std::ops::ControlFlow;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};
use sunglint_drivers::device::{
    Camera as _, Device as _, DeviceError, FilterWheel as _, RotationStage as _, Value, Window,
};
use sunglint_drivers::indi::{
    CameraSettings, FrameType, RotatorSettings, SessionSettings, Wanted, devices, open_camera,
    open_rotator, open_wheel,
};
use sunglint_drivers::transport::TransportError;
use sunglint_formats::Bayer;

fn window(x: u32, y: u32, columns: u32, rows: u32) -> Window {
    Window { origin_px: [x, y], size_px: [columns, rows], binning: [1, 1] }
}

/// UTC of this machine, s since 1970, without leap seconds.
fn unix_s() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_secs_f64()
}

fn epoch_unix_s(epoch: Epoch) -> f64 {
    epoch.to_unix_seconds()
}

/// Truth: the sizes that were asked; the start that this machine's clock saw (the same clock as the server's): after the
/// request and before the frame was there less the exposure. `DATE-OBS` has milliseconds, so 1 ms either way.
#[test]
fn frames_windows_gain_and_temperature() {
    live("frames_windows_gain_and_temperature", || {
        let server = Server::start(&["ccd"]);
        let mut camera =
            open_camera(server.connect(), CAMERA, CameraSettings::default(), &within(20.0))
                .unwrap();
        let identity = camera.identity(&within(1.0)).unwrap();
        assert_eq!(identity.model, "CCD Simulator");
        assert_eq!(camera.sensor_px(), [1280, 1024]);
        for (exposure_s, part) in [
            (0.5, window(0, 0, 1280, 1024)),
            (0.1, window(500, 400, 200, 200)),
            (0.01, window(1270, 1000, 10, 24)),
        ] {
            assert_eq!(camera.set_window(part, &within(5.0)).unwrap(), part);
            let asked = unix_s();
            let frame = camera.expose(exposure_s, &within(10.0)).unwrap();
            let came = unix_s();
            assert_eq!(frame.pixels.dim(), (part.size_px[1] as usize, part.size_px[0] as usize));
            assert_eq!(frame.origin, part.origin_px);
            assert_eq!(frame.exposure_s, exposure_s);
            let start = epoch_unix_s(frame.start);
            eprintln!(
                "{exposure_s} s: began {:.4} s after it was asked for, came {:.4} s after its end",
                start - asked,
                came - start - exposure_s
            );
            assert!(start >= asked - 0.001 && start + exposure_s <= came + 0.001);
            assert!(start - asked < 0.5, "the start is not that of the exposure");
            // The host's own time in the header is that of the same clock. On a busy machine the two times are taken some ms apart.
            let later = frame.header.real("HOSTDIFF").unwrap();
            assert!((later - (start - asked)).abs() < 0.2, "{later}");
            // Sky glow and noise: neither nothing nor full.
            let mean =
                frame.pixels.iter().map(|&p| f64::from(p)).sum::<f64>() / frame.pixels.len() as f64;
            assert!(mean > 0.0 && mean < 65_000.0, "{mean}");
        }

        assert_eq!(camera.set_gain(50.0, &within(5.0)).unwrap(), 50.0);
        let out = camera.set_gain(1e9, &within(5.0)).unwrap_err();
        assert!(matches!(out, DeviceError::OutOfRange { name: "gain", .. }), "{out}");
        let binned = Window { origin_px: [100, 200], size_px: [201, 100], binning: [2, 2] };
        assert_eq!(camera.set_window(binned, &within(5.0)).unwrap(), binned);
        let frame = camera.expose(0.05, &within(10.0)).unwrap();
        assert_eq!((frame.pixels.dim(), frame.binning), ((50, 100), [2, 2]));
        assert_eq!(frame.header.real("GAIN"), Some(50.0));
        assert_eq!(frame.temperature_c, Some(0.0));

        // The simulator cools by 0.5 °C in half a second, from 0 °C.
        assert_eq!(camera.set_temperature_c(-10.0, &within(5.0)).unwrap(), 0.0);
        let out = camera.set_temperature_c(200.0, &within(5.0)).unwrap_err();
        assert!(matches!(out, DeviceError::OutOfRange { .. }), "{out}");
        std::thread::sleep(Duration::from_secs(2));
        let settings = camera.settings(&within(5.0)).unwrap();
        let value = |name: &str| settings.iter().find(|s| s.name == name).unwrap().value.clone();
        let Value::Number(cold) = value("temperature_c") else { panic!("a number") };
        assert!((-8.0..=-0.5).contains(&cold), "{cold}");
        assert_eq!(value("gain"), Value::Number(50.0));
        let frame = camera.expose(0.05, &within(10.0)).unwrap();
        assert!(frame.temperature_c.unwrap() <= cold, "it cools on");
        camera.set_frame_type(FrameType::Dark, &within(5.0)).unwrap();
        let frame = camera.expose(0.05, &within(10.0)).unwrap();
        assert_eq!(frame.header.text("FRAME"), Some("Dark"));
    });
}

/// Truth: the calls' own deadlines; the simulator's 1280 × 1024 pixels of one byte.
#[test]
fn aborts_and_streams() {
    live("aborts_and_streams", || {
        let server = Server::start(&["ccd"]);
        let mut camera =
            open_camera(server.connect(), CAMERA, CameraSettings::default(), &within(20.0))
                .unwrap();
        let begun = Instant::now();
        let error = camera.expose(60.0, &within(1.5)).unwrap_err();
        eprintln!("{error}");
        assert!(matches!(error, DeviceError::Awaited { .. }), "{error}");
        assert!(error.to_string().contains("CCD_EXPOSURE Busy"), "{error}");
        assert!(begun.elapsed() < Duration::from_secs(4), "{:?}", begun.elapsed());
        // The next frame is the next exposure's.
        let frame = camera.expose(0.2, &within(10.0)).unwrap();
        assert_eq!((frame.exposure_s, frame.pixels.dim()), (0.2, (1024, 1280)));

        let mut frames = Vec::new();
        let mut take = |frame: sunglint_formats::Frame| {
            frames.push(frame);
            if frames.len() == 5 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        assert_eq!(camera.stream(0.05, &mut take, &within(15.0)).unwrap(), 5);
        assert!(frames.iter().all(|frame| frame.pixels.dim() == (1024, 1280)));
        assert!(frames.windows(2).all(|pair| pair[0].start < pair[1].start));

        // A part of the sensor, which an exposure before and after has too.
        camera.set_window(window(501, 401, 200, 100), &within(5.0)).unwrap();
        assert_eq!(camera.expose(0.05, &within(10.0)).unwrap().pixels.dim(), (100, 200));
        let mut count = 0;
        let mut take = |frame: sunglint_formats::Frame| {
            assert_eq!((frame.pixels.dim(), frame.origin), ((100, 200), [501, 401]));
            count += 1;
            if count == 3 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        assert_eq!(camera.stream(0.05, &mut take, &within(15.0)).unwrap(), 3);
        let frame = camera.expose(0.05, &within(10.0)).unwrap();
        assert_eq!((frame.pixels.dim(), frame.origin), ((100, 200), [501, 401]));
        // A deadline ends a stream with what it had, and the camera is free again.
        let interrupted =
            camera.stream(0.05, &mut |_| ControlFlow::Continue(()), &within(2.0)).unwrap_err();
        assert!(interrupted.done > 0, "{interrupted}");
        assert!(camera.expose(0.05, &within(10.0)).is_ok());
    });
}

/// Truth: what was done to the server; a dead socket is noticed at once, not at the deadline.
#[test]
fn a_server_that_is_killed_and_comes_back() {
    live("a_server_that_is_killed_and_comes_back", || {
        let mut server = Server::start(&["ccd"]);
        let mut camera =
            open_camera(server.connect(), CAMERA, CameraSettings::default(), &within(20.0))
                .unwrap();
        let part = window(501, 400, 64, 32);
        camera.set_window(part, &within(5.0)).unwrap();
        camera.set_gain(33.0, &within(5.0)).unwrap();
        std::thread::scope(|scope| {
            scope.spawn(|| {
                std::thread::sleep(Duration::from_millis(700));
                server.kill();
            });
            let begun = Instant::now();
            let error = camera.expose(20.0, &within(30.0)).unwrap_err();
            eprintln!("{error}");
            let gone = matches!(
                error,
                DeviceError::Transport { source: TransportError::Disconnected { .. }, .. }
            );
            assert!(gone, "{error}");
            assert!(begun.elapsed() < Duration::from_secs(5));
        });
        assert!(camera.expose(0.1, &within(5.0)).is_err());
        server.restart();
        camera.reconnect(server.connect(), &within(20.0)).unwrap();
        assert_eq!(camera.window(), part);
        let frame = camera.expose(0.1, &within(10.0)).unwrap();
        assert_eq!((frame.pixels.dim(), frame.origin), ((32, 64), [501, 400]));
        assert_eq!(frame.header.real("GAIN"), Some(33.0));
    });
}

/// Truth: the simulator's own crash switch: its driver ends, the server stays and says `delProperty`.
#[test]
fn a_driver_that_ends_and_is_started_again() {
    live("a_driver_that_ends_and_is_started_again", || {
        let server = Server::start(&["ccd"]);
        let mut camera =
            open_camera(server.connect(), CAMERA, CameraSettings::default(), &within(20.0))
                .unwrap();
        let crash = Wanted::Switches(&[("CRASH", true)]);
        let error = camera.configure("CCD_SIMULATE_CRASH", crash, &within(10.0)).unwrap_err();
        eprintln!("{error}");
        assert!(matches!(error, DeviceError::Lost { .. }), "{error}");
        let error = camera.expose(0.1, &within(5.0)).unwrap_err();
        assert!(matches!(error, DeviceError::Lost { .. }), "{error}");
        camera.reopen(&within(20.0)).unwrap();
        assert!(camera.expose(0.1, &within(10.0)).is_ok());
    });
}

/// Truth: the sensor of the Atik 414EX (Sony ICX825: 1391 × 1039 px of 6.45 µm, as Atik gives it), which the simulator is told
/// to be; its mosaic is RGGB, so that an odd column begins with green, an odd row too. The server's own header says
/// RGGB with offsets of 0 everywhere.
#[test]
fn an_atik_414ex_and_its_mosaic() {
    live("an_atik_414ex_and_its_mosaic", || {
        let server = Server::start(&["ccd"]);
        let mut camera =
            open_camera(server.connect(), CAMERA, CameraSettings::default(), &within(20.0))
                .unwrap();
        let sensor =
            [("SIM_XRES", 1391.0), ("SIM_YRES", 1039.0), ("SIM_XSIZE", 6.45), ("SIM_YSIZE", 6.45)];
        camera.configure("SIMULATOR_SETTINGS", Wanted::Numbers(&sensor), &within(10.0)).unwrap();
        assert_eq!(camera.sensor_px(), [1391, 1039]);
        let on = Wanted::Switches(&[("INDI_ENABLED", true), ("INDI_DISABLED", false)]);
        camera.configure("SIMULATE_BAYER", on, &within(10.0)).unwrap();
        for (x, y, pattern) in [
            (0, 0, Bayer::Rggb),
            (501, 400, Bayer::Grbg),
            (500, 401, Bayer::Gbrg),
            (501, 401, Bayer::Bggr),
        ] {
            let part =
                if (x, y) == (0, 0) { window(0, 0, 1391, 1039) } else { window(x, y, 100, 80) };
            camera.set_window(part, &within(5.0)).unwrap();
            let frame = camera.expose(0.05, &within(10.0)).unwrap();
            let size = part.size_px.map(|n| n as usize);
            assert_eq!(frame.pixels.dim(), (size[1], size[0]));
            assert_eq!(frame.bayer, Some(pattern), "at {x}, {y}");
            assert_eq!(frame.header.real("PIXSIZE1"), Some(6.45));
        }
        let binned = Window { origin_px: [0, 0], size_px: [1391, 1039], binning: [2, 2] };
        camera.set_window(binned, &within(5.0)).unwrap();
        let frame = camera.expose(0.05, &within(10.0)).unwrap();
        assert_eq!((frame.bayer, frame.pixels.dim()), (None, (519, 695)));
    });
}

/// Truth: the simulators' own numbers: 8 filters by name; a rotator of 10° a second that says where it stands each second.
#[test]
fn a_rotator_and_a_wheel() {
    live("a_rotator_and_a_wheel", || {
        let server = Server::start(&["rotator", "wheel"]);
        let mut rotator =
            open_rotator(server.connect(), ROTATOR, RotatorSettings::default(), &within(20.0))
                .unwrap();
        assert_eq!(rotator.travel_deg(), Some([0.0, 360.0].into()));
        assert_eq!(rotator.move_to(10.5, &within(15.0)).unwrap(), 10.5);
        assert_eq!(rotator.angle_deg(&within(5.0)).unwrap(), 10.5);
        let out = rotator.move_to(400.0, &within(5.0)).unwrap_err();
        assert!(matches!(*out.error, DeviceError::OutOfRange { .. }), "{out}");
        // 90° take 9 s.
        let late = rotator.move_to(100.0, &within(2.5)).unwrap_err();
        assert!(late.to_string().contains("at last ABS_ROTATOR_ANGLE Busy"), "{late}");
        let stopped = late.done.unwrap();
        assert!((20.0..70.0).contains(&stopped), "{stopped}");
        std::thread::sleep(Duration::from_millis(1500));
        assert_eq!(rotator.angle_deg(&within(5.0)).unwrap(), stopped, "it stands");
        // The simulator says Ok to a new angle and keeps the old one all the same.
        let kept = rotator.sync(33.0, &within(5.0)).unwrap_err();
        assert!(matches!(kept, DeviceError::NotTaken { .. }), "{kept}");
        let home = rotator.home(&within(5.0)).unwrap_err();
        assert!(matches!(*home.error, DeviceError::NotReady { .. }), "{home}");

        let mut wheel =
            open_wheel(server.connect(), WHEEL, SessionSettings::default(), &within(20.0)).unwrap();
        assert_eq!(wheel.slots(), 8);
        let names = ["Red", "Green", "Blue", "H_Alpha", "SII", "OIII", "LPR", "Luminance"];
        assert_eq!(wheel.names(), names);
        assert_eq!(wheel.select(3, &within(10.0)).unwrap(), 3);
        assert_eq!(wheel.slot(&within(5.0)).unwrap(), 3);
        assert_eq!(wheel.select(3, &within(10.0)).unwrap(), 3);
        assert_eq!(wheel.select(8, &within(10.0)).unwrap(), 8);
        assert!(matches!(
            *wheel.select(9, &within(5.0)).unwrap_err().error,
            DeviceError::OutOfRange { .. }
        ));
        let filter = wheel.settings(&within(5.0)).unwrap();
        assert_eq!(filter[1].value, Value::Text("Luminance".into()));

        let error =
            open_camera(server.connect(), "Atik 414EX", CameraSettings::default(), &within(20.0));
        let error = error.unwrap_err().to_string();
        assert!(error.contains("INDI device: found Atik 414EX"), "{error}");
        let listed = devices(server.connect(), SessionSettings::default(), &within(20.0)).unwrap();
        let listed: Vec<_> = listed.iter().map(|d| (d.name.as_str(), d.is)).collect();
        assert_eq!(
            listed,
            [
                (WHEEL, [false, true, false, false, false]),
                (ROTATOR, [false, false, true, false, false])
            ]
        );
        let error =
            open_camera(server.connect(), ROTATOR, CameraSettings::default(), &within(20.0));
        let error = error.unwrap_err().to_string();
        assert!(error.contains("is no camera (DRIVER_INTERFACE 4096)"), "{error}");
    });
}
