//! Tests of the code above OpenCV for live devices, on sources of our own; and of devices that are not there. No live device is tried here.
#![cfg(feature = "opencv")]
#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::within;
use hifitime::Epoch;
use ndarray::Array2;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::mpsc;
use std::time::Duration;
use sunglint_drivers::clock::Cancel;
use sunglint_drivers::device::{Camera as _, Device as _, DeviceError, Interrupted};
use sunglint_drivers_opencv::capture::{About, Automation, Capture, Open};
use sunglint_drivers_opencv::live::{Format, Live, Place};
use sunglint_drivers_opencv::picture::{Picture, Planes};
use sunglint_drivers_opencv::{
    Automatic, Field, FrameTimes, Grabber, GrabberSettings, Losses, Source,
};
use sunglint_formats::{Bayer, time};

#[test]
fn a_camera_that_is_not_there_is_said_to_be() {
    let live = |place| Source::Live(Live::new(place, Format::Grey8));
    let error = crate::common::open(live(Place::Number(63))).unwrap_err();
    assert!(
        error.starts_with("frame grabber: there is no camera at /dev/video63: is it plugged in"),
        "{error}"
    );
    let error = crate::common::open(live(Place::Path("/dev/v4l/by-id/none".into()))).unwrap_err();
    assert!(error.contains("there is no camera at /dev/v4l/by-id/none"), "{error}");
    // A file and a device that are there and no cameras.
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("video0");
    std::fs::write(&file, b"x").unwrap();
    for path in [file, PathBuf::from("/dev/null")] {
        let error = crate::common::open(live(Place::Path(path.clone()))).unwrap_err();
        let expected =
            format!("frame grabber: {} is there, but does not open as a camera", path.display());
        assert!(error.starts_with(&expected), "{error}");
    }
}

fn first() -> Epoch {
    time::parse_utc("2026-03-04T05:06:07Z").unwrap()
}

/// A camera of 20 frames a second whose pixels are the number of the frame. It takes exposures in steps of 0.1 ms up to 50 ms, and
/// no gain unless it has one. `gate` holds each picture back until somebody lets it go.
struct Desk {
    next: u64,
    gain: Option<f64>,
    gate: Option<mpsc::Receiver<()>>,
}

impl Capture for Desk {
    fn about(&self) -> About {
        let bayer = Some(Bayer::Gbrg);
        About {
            name: "desk".into(),
            backend: "ours".into(),
            size_px: [4, 2],
            bayer,
            ..About::default()
        }
    }

    fn next(&mut self) -> Result<Option<Picture>, DeviceError> {
        if let Some(gate) = &self.gate {
            gate.recv().map_err(|_| DeviceError::Lost {
                device: "desk",
                what: "it was unplugged".into(),
            })?;
        }
        let index = self.next;
        self.next += 1;
        let since_s = 0.05 * (index + 1) as f64;
        Ok(Some(Picture {
            planes: Planes::Mono(Array2::from_elem((2, 4), index as u16)),
            bits: 8,
            index,
            position_ms: Some(1e3 * since_s + 77.0),
            arrived: Some(first() + hifitime::Duration::from_seconds(since_s)),
            readings: [None; 2],
        }))
    }

    fn set_exposure_s(&mut self, exposure_s: f64) -> Result<f64, DeviceError> {
        if exposure_s > 0.05 {
            let (asked, got) = (exposure_s.to_string(), "0.05".into());
            return Err(DeviceError::NotTaken { device: "desk", name: "exposure, s", asked, got });
        }
        Ok((exposure_s * 1e4).round() / 1e4)
    }

    fn set_gain(&mut self, gain: f64) -> Result<f64, DeviceError> {
        let reason = "it has no gain";
        let had = self.gain.as_mut().ok_or(DeviceError::NotReady { device: "desk", reason })?;
        *had = gain.round();
        Ok(*had)
    }

    fn exposure_and_gain(&self) -> [Option<f64>; 2] {
        [None, self.gain]
    }
}

fn desk(gain: Option<f64>, gate: Option<mpsc::Receiver<()>>, held: u32) -> Grabber {
    let open: Open = Box::new(move || Ok(Box::new(Desk { next: 0, gain, gate })));
    let settings = GrabberSettings { held, ..GrabberSettings::default() };
    Grabber::over(open, FrameTimes::Host, settings, &within(5.0)).unwrap()
}

/// Truth: the source's own times. A frame that had come at t after an exposure of e began at t − e, by the host's clock; the
/// exposure is the one that the device says, not the one that was asked.
#[test]
fn a_frame_began_before_it_came_by_the_exposure_that_the_device_says() {
    let mut grabber = desk(None, None, 4);
    let frame = grabber.expose(0.012_34, &within(5.0)).unwrap();
    // Four that the driver may have held and one that had begun are thrown away.
    assert!(frame.pixels.iter().all(|&value| value == 5));
    assert_eq!(frame.exposure_s, 0.0123);
    let since_s = (frame.start - first()).to_seconds();
    assert!((since_s - (0.3 - 0.0123)).abs() < 1e-9, "{since_s}");
    assert_eq!((frame.saturation_adu, frame.bayer), (Some(255.0), Some(Bayer::Gbrg)));
    assert!((frame.header.real("GRABMSEC").unwrap() - 377.0).abs() < 1e-9);
    assert!(frame.header.commentaries("COMMENT").any(|c| c.contains("arrived at the host")));
    // A stream gives each picture that comes from now on.
    let mut seen = Vec::new();
    let mut take = |frame: sunglint_formats::Frame| {
        seen.push(frame.pixels[[0, 0]]);
        if seen.len() == 3 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    assert_eq!(grabber.stream(0.05, &mut take, &within(5.0)).unwrap(), 3);
    assert_eq!(seen, [6, 7, 8]);
}

#[test]
fn what_a_device_does_not_take_is_said() {
    let mut grabber = desk(None, None, 0);
    let error = grabber.next_frame(&within(5.0)).unwrap_err().to_string();
    assert!(error.ends_with("its exposure is not known: set one first"), "{error}");
    let error = grabber.expose(0.06, &within(5.0)).unwrap_err().to_string();
    assert_eq!(error, "desk: exposure, s was set to 0.06, the device says 0.05");
    let error = grabber.set_gain(3.0, &within(5.0)).unwrap_err().to_string();
    assert_eq!(error, "desk: it has no gain");
    assert!(grabber.set_temperature_c(-10.0, &within(5.0)).is_err());
    let mut grabber = desk(Some(1.0), None, 0);
    assert_eq!(grabber.set_gain(2.6, &within(5.0)).unwrap(), 3.0);
    let settings = grabber.settings(&within(5.0)).unwrap();
    let gain = settings.iter().find(|setting| setting.name == "gain").unwrap();
    assert_eq!(gain.value.to_string(), "3");
    assert_eq!(grabber.identity(&within(5.0)).unwrap().driver, "opencv");
}

/// A device that gives nothing ends the wait in time, not the device; what comes late is the next frame, not lost.
#[test]
fn a_device_that_hangs_does_not_hang_its_caller() {
    let (let_go, gate) = mpsc::channel();
    let mut grabber = desk(None, Some(gate), 0);
    let soon = within(0.1);
    let mut none = |_| ControlFlow::Continue(());
    let Interrupted { done, error } = grabber.stream(0.01, &mut none, &soon).unwrap_err();
    assert_eq!(done, 0);
    assert!(matches!(*error, DeviceError::TooSlow { .. }), "{error}");
    assert!(soon.elapsed() < Duration::from_secs(3));
    let cancel = Cancel::new();
    cancel.cancel();
    let cancelled = within(60.0).with_cancel(&cancel);
    let error = grabber.next_frame(&cancelled).unwrap_err();
    assert!(matches!(error, DeviceError::Cancelled { .. }), "{error}");
    for expected in 0..3 {
        let_go.send(()).unwrap();
        let frame = grabber.next_frame(&within(5.0)).unwrap().unwrap();
        assert!(frame.pixels.iter().all(|&value| value == expected));
    }
    drop(let_go);
    let error = grabber.next_frame(&within(5.0)).unwrap_err();
    assert!(matches!(error, DeviceError::Lost { .. }), "{error}");
}

#[test]
fn a_source_that_does_not_open_in_time_is_an_error() {
    let (keep, gate) = mpsc::channel::<()>();
    let open: Open = Box::new(move || {
        let _ = gate.recv();
        Ok(Box::new(Desk { next: 0, gain: None, gate: None }))
    });
    let error = Grabber::over(open, FrameTimes::Host, GrabberSettings::default(), &within(0.1))
        .unwrap_err();
    assert!(matches!(error, DeviceError::TooSlow { action: "opening the source", .. }), "{error}");
    drop(keep);
}

/// A camera that loses pictures and turns its own gain: each picture is given by when it was taken, ms by its driver's clock, and its gain.
struct Moody {
    pictures: std::vec::IntoIter<(f64, f64)>,
    next: u64,
    automation: Automation,
}

impl Capture for Moody {
    fn about(&self) -> About {
        let (name, size_px) = ("moody".into(), [4, 2]);
        About { name, size_px, interval_s: Some(0.04), ..About::default() }
    }

    fn next(&mut self) -> Result<Option<Picture>, DeviceError> {
        let Some((at_ms, gain)) = self.pictures.next() else { return Ok(None) };
        let index = self.next;
        self.next += 1;
        let pixels = Array2::from_shape_fn((2, 4), |(row, column)| {
            (10 * index as usize + 4 * row + column) as u16
        });
        // The host is late by up to 30 ms.
        let late_ms = 10.0 * (index % 4) as f64;
        Ok(Some(Picture {
            planes: Planes::Mono(pixels),
            bits: 8,
            index,
            position_ms: Some(at_ms),
            arrived: Some(first() + hifitime::Duration::from_seconds(1e-3 * (at_ms + late_ms))),
            readings: [Some(0.01), Some(gain)],
        }))
    }

    fn set_exposure_s(&mut self, exposure_s: f64) -> Result<f64, DeviceError> {
        Ok(exposure_s)
    }

    fn automation(&self) -> Automation {
        self.automation
    }
}

fn moody(
    pictures: &[(f64, f64)],
    automation: Automation,
    settings: GrabberSettings,
) -> Result<(Vec<sunglint_formats::Frame>, Grabber), String> {
    let pictures = Vec::from(pictures).into_iter();
    let open: Open = Box::new(move || Ok(Box::new(Moody { pictures, next: 0, automation })));
    let mut grabber = Grabber::over(open, FrameTimes::Host, settings, &within(5.0)).unwrap();
    let mut frames = Vec::new();
    let mut take = |frame| {
        frames.push(frame);
        ControlFlow::Continue(())
    };
    match grabber.stream(0.01, &mut take, &within(5.0)) {
        Ok(_) => Ok((frames, grabber)),
        Err(stopped) => Err(stopped.error.to_string()),
    }
}

/// Truth: the driver's times: 40 ms from picture to picture, but for three that are lacking in two gaps; the host's lateness says nothing. A break
/// of an hour is none.
#[test]
fn lost_pictures_are_counted_by_the_drivers_clock() {
    let times = [0.0, 40.0, 80.0, 160.0, 200.0, 320.0, 360.0, 3_600_360.0, 3_600_400.0];
    let pictures = times.map(|at_ms| (at_ms, 1.0));
    let found = moody(&pictures, Automation::default(), GrabberSettings::default());
    let (frames, grabber) = found.unwrap();
    assert_eq!(grabber.losses(), Losses { lost: 3, doubled: 0 });
    let lost: Vec<_> = frames.iter().map(|frame| frame.header.integer("GRABLOST")).collect();
    let (one, three) = (Some(1), Some(3));
    assert_eq!(lost, [None, None, None, one, one, three, three, three, three]);
}

/// Truth: the picture had come when the second field ended: both began half an interval apart, each before its own end by the exposure.
#[test]
fn live_fields_end_when_the_picture_has_come() {
    let settings = GrabberSettings { fields: Some(Field::Bottom), ..GrabberSettings::default() };
    let (frames, _) = moody(&[(100.0, 1.0)], Automation::default(), settings).unwrap();
    let starts: Vec<f64> = frames.iter().map(|f| (f.start - first()).to_seconds()).collect();
    assert_eq!(starts.len(), 2);
    for (start, expected) in starts.iter().zip([0.07, 0.09]) {
        assert!((start - expected).abs() < 1e-9, "{starts:?}");
    }
    assert_eq!(frames[0].pixels.as_slice().unwrap(), [4, 5, 6, 7]);
    assert_eq!(frames[1].pixels.as_slice().unwrap(), [0, 1, 2, 3]);
}

/// Automatic exposure or gain, by what the driver says or by a gain that changes, is refused, and where it is taken each frame says so.
#[test]
fn automatic_exposure_and_gain_are_refused() {
    let steady = [(0.0, 2.0), (40.0, 2.0), (80.0, 2.0)];
    let turned = [(0.0, 2.0), (40.0, 2.0), (80.0, 3.0)];
    let on = |exposure, gain| Automation { exposure, gain };
    let flag = GrabberSettings { automatic: Automatic::Flag, ..GrabberSettings::default() };
    for (pictures, says, what, cards) in [
        (steady, on(Some(true), None), "sets the exposure by itself", [Some(true), None]),
        (steady, on(None, Some(true)), "sets the gain by itself", [None, Some(true)]),
        (steady, on(Some(true), Some(true)), "sets exposure and gain by itself", [Some(true); 2]),
        (turned, on(Some(false), None), "sets the gain by itself", [None, Some(true)]),
    ] {
        let error = moody(&pictures, says, GrabberSettings::default()).unwrap_err();
        assert!(error.contains(what) && error.contains("Automatic::Flag"), "{error}");
        let (frames, _) = moody(&pictures, says, flag).unwrap();
        let found = ["AUTOEXP", "AUTOGAIN"].map(|card| frames[2].header.logical(card));
        assert_eq!((frames.len(), found), (3, cards), "{what}");
    }
    for says in [on(None, None), on(Some(false), Some(false))] {
        let (frames, _) = moody(&steady, says, GrabberSettings::default()).unwrap();
        assert!(frames.iter().all(|f| f.header.get("AUTOEXP").is_none()));
    }
    // The camera says another exposure than it was set to.
    let error = moody_at(0.02).unwrap_err();
    assert!(error.contains("sets the exposure by itself"), "{error}");
}

/// A camera that says 0.01 s whatever it was set to.
fn moody_at(exposure_s: f64) -> Result<u64, String> {
    let pictures = vec![(0.0, 1.0)].into_iter();
    let automation = Automation::default();
    let open: Open = Box::new(move || Ok(Box::new(Moody { pictures, next: 0, automation })));
    let settings = GrabberSettings::default();
    let mut grabber = Grabber::over(open, FrameTimes::Host, settings, &within(5.0)).unwrap();
    let mut take = |_| ControlFlow::Continue(());
    grabber.stream(exposure_s, &mut take, &within(5.0)).map_err(|e| e.error.to_string())
}
