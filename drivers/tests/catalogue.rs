//! Drivers by name, on whatever line: with faults, and as udev sees their devices.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::time::Duration;
use sunglint_drivers::catalogue::{Address, AnyDevice, Bus, DRIVERS, UsbId, udev};
use sunglint_drivers::clock::{Clock as _, Deadline, VirtualClock};
use sunglint_drivers::device::DeviceError;
use sunglint_drivers::recording::Faults;
use sunglint_testkit::skip;

/// Opens a simulated device and asks it for all that it says, on a line with faults.
fn ask(name: &str, faults: Faults, seed: u64) -> (Result<usize, DeviceError>, Duration) {
    let clock = Arc::new(VirtualClock::new());
    let within = |seconds| Deadline::after(clock.clone(), Duration::from_secs(seconds));
    let mut address = Address::parse(name, &[]).unwrap();
    let line = address.connect(&within(1)).unwrap().faulty(faults, seed);
    let go = || -> Result<usize, DeviceError> {
        let mut device = address.open(line, &within(60))?;
        device.device().identity(&within(10))?;
        let settings = device.device().settings(&within(10))?;
        match &mut device {
            AnyDevice::PowerMeter(meter) => {
                meter.power(&within(10))?;
            }
            AnyDevice::Meter(meter) => {
                meter.read(&within(10))?;
            }
            AnyDevice::Source(source) => {
                source.is_on(&within(10))?;
            }
            AnyDevice::RotationStage(stage) => {
                stage.angle_deg(&within(10))?;
            }
            AnyDevice::FilterWheel(wheel) => {
                wheel.slot(&within(10))?;
            }
            AnyDevice::Camera(camera) => {
                camera.expose(0.1, &within(10))?;
            }
            AnyDevice::Focuser(focuser) => {
                focuser.position(&within(10))?;
            }
            AnyDevice::Mount(mount) => {
                mount.reading(&within(10))?;
            }
            AnyDevice::Monochromator(monochromator) => {
                monochromator.wavelength_nm(&within(10))?;
            }
            AnyDevice::Spectrometer(spectrometer) => {
                spectrometer.expose(0.1, &within(10))?;
            }
            _ => {}
        }
        Ok(settings.len())
    };
    (go(), clock.now())
}

/// Truth: the deadlines add up to 91 s, and a call ends at most 3 s after its own; without faults every simulated device
/// answers, and with some of 40 seeds each still does, and each fails.
#[test]
fn every_simulated_device_ends_in_time_on_a_bad_line() {
    let bad = Faults {
        delay: 0.05,
        longest_delay: Duration::from_millis(500),
        drop: 2e-6,
        flip: 2e-6,
        silence: 0.01,
        disconnect: 0.002,
        ..Faults::NONE
    };
    for driver in DRIVERS.into_iter().filter(|driver| driver.simulated) {
        let (good, _) = ask(driver.name, Faults::NONE, 0);
        let settings = good.unwrap_or_else(|error| panic!("{}: {error}", driver.name));
        assert!(settings > 1, "{}", driver.name);
        let mut failed = 0;
        for seed in 0..40 {
            let (end, took) = ask(driver.name, bad, seed);
            failed += u32::from(end.is_err());
            assert!(took < Duration::from_secs(100), "{} seed {seed}: {took:?}", driver.name);
        }
        // A Time Tagger and a spectrometer say too little here for a fault to hit them; a thousand seeds of each are in `swabian_faults` and `ocean_obp`.
        let least = u32::from(!["sim-timetagger", "sim-ocean"].contains(&driver.name));
        assert!((least..40).contains(&failed), "{}: {failed} of 40 failed", driver.name);
    }
}

/// A device as the kernel would show it, for umockdev, and its place in /sys.
fn fake(bus: Bus, vendor: u16, product: u16) -> (String, String) {
    let usb = "/devices/pci0000:00/0000:00:14.0/usb1/1-3";
    let mut text = format!(
        "P: {usb}\nN: bus/usb/001/007\nE: DEVNAME=/dev/bus/usb/001/007\nE: DEVTYPE=usb_device\nE: MAJOR=189\nE: MINOR=6\n\
         E: SUBSYSTEM=usb\nE: BUSNUM=001\nE: DEVNUM=007\nE: PRODUCT={vendor:x}/{product:x}/100\nA: idVendor={vendor:04x}\\n\n\
         A: idProduct={product:04x}\\n\n\n"
    );
    let interface = format!("{usb}/1-3:1.0");
    let (path, node) = match bus {
        Bus::Usb => return (text, usb.to_owned()),
        Bus::Hid => {
            let hid = format!("{interface}/0003:{vendor:04X}:{product:04X}.0001");
            let about = format!("E: HID_ID=0003:{vendor:08X}:{product:08X}");
            let _ = writeln!(text, "P: {hid}\nE: DRIVER=hid-generic\n{about}\nE: SUBSYSTEM=hid\n");
            (
                format!("{hid}/hidraw/hidraw7"),
                "hidraw7\nE: SUBSYSTEM=hidraw\nE: MAJOR=241\nE: MINOR=7",
            )
        }
        Bus::Serial => (
            format!("{interface}/tty/ttyACM7"),
            "ttyACM7\nE: SUBSYSTEM=tty\nE: MAJOR=166\nE: MINOR=7",
        ),
    };
    let name = node.lines().next().unwrap();
    let _ = writeln!(text, "P: {interface}\nE: DEVTYPE=usb_interface\nE: SUBSYSTEM=usb\n");
    let _ = writeln!(text, "P: {path}\nN: {node}\nE: DEVNAME=/dev/{name}\n");
    (text, path)
}

/// Returns what `udevadm test` says of each device under these rules, in a /run of its own.
fn udevadm(folder: &Path, rules: &str, devices: &[UsbId]) -> Vec<String> {
    std::fs::write(folder.join(udev::FILE), rules).unwrap();
    let mut script = String::from("mount -t tmpfs tmpfs /run && mkdir -p /run/udev/rules.d && ");
    let _ = writeln!(script, "cp {} /run/udev/rules.d/ || exit 9", udev::FILE);
    for (i, id) in devices.iter().enumerate() {
        let (description, path) = fake(id.bus, id.vendor, id.product.unwrap_or(0x0100));
        std::fs::write(folder.join(format!("{i}.umockdev")), description).unwrap();
        let _ = writeln!(
            script,
            "timeout 20 umockdev-run -d {i}.umockdev -- udevadm test /sys{path} >{i}.out 2>&1 || exit 8"
        );
    }
    std::fs::write(folder.join("go.sh"), script).unwrap();
    let output = Command::new("unshare").args(["-rm", "sh", "go.sh"]).current_dir(folder).output();
    let output = output.unwrap();
    assert!(output.status.success(), "{output:?}");
    let said = |i| std::fs::read_to_string(folder.join(format!("{i}.out"))).unwrap();
    (0..devices.len()).map(said).collect()
}

/// Whether this machine can be asked.
fn udevadm_is_there(test: &str) -> bool {
    let works = |program: &str, arguments: &[&str]| {
        Command::new(program).args(arguments).output().is_ok_and(|output| output.status.success())
    };
    let missing = if !works("umockdev-run", &["--version"]) {
        "no umockdev-run (Debian package umockdev)"
    } else if !works("udevadm", &["--version"]) {
        "no udevadm (Debian package udev)"
    } else if !works("unshare", &["-rm", "sh", "-c", "mount -t tmpfs tmpfs /run"]) {
        "no mount namespace of one's own (unshare -rm)"
    } else {
        return true;
    };
    skip(test, missing);
    false
}

/// Truth: udev's own reading of the rules (`udevadm test`): the mode and the tag that it would give each device that is
/// named, and nothing to one that is not.
#[test]
fn udev_gives_our_devices_to_the_user_and_no_others() {
    if !udevadm_is_there("udev_gives_our_devices_to_the_user_and_no_others") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let ours: Vec<UsbId> = udev::ids().collect();
    assert!(ours.len() >= 12, "{ours:?}");
    let ours_said = udevadm(folder.path(), &udev::rules(), &ours);
    for (id, said) in ours.iter().zip(&ours_said) {
        let lines: Vec<&str> = said.lines().filter(|line| line.contains(udev::FILE)).collect();
        assert!(lines.iter().any(|line| line.ends_with(" MODE 0660")), "{id:?}: {said}");
        let wrong = |line: &&&str| ["nvalid", "nknown", "gnoring"].iter().any(|w| line.contains(w));
        assert!(!lines.iter().any(|line| wrong(&line)), "{id:?}: {lines:?}");
        let tags = said.lines().find(|line| line.starts_with("TAGS=")).unwrap_or("");
        assert!(tags.contains(":uaccess:"), "{id:?}: {said}");
        assert!(
            said.contains("run: 'uaccess'"),
            "the rules come too late for 73-seat-late: {said}"
        );
    }
    // A hub's number, and our products' numbers under a vendor that is not theirs.
    let hub = |bus| UsbId { bus, vendor: 0x1d6b, product: Some(0x0002), name: "hub" };
    let strange = ours.iter().map(|id| UsbId { vendor: 0x1d6b, ..*id });
    let strange: Vec<UsbId> =
        [Bus::Usb, Bus::Hid, Bus::Serial].map(hub).into_iter().chain(strange).collect();
    for (id, said) in strange.iter().zip(udevadm(folder.path(), &udev::rules(), &strange)) {
        assert!(!said.contains(&format!("{}:", udev::FILE)), "{id:?}: {said}");
    }
}

/// Truth: a key that udev does not know is told with its line, so that the test above would see one.
#[test]
fn udev_would_tell_a_wrong_key() {
    if !udevadm_is_there("udev_would_tell_a_wrong_key") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let rules = udev::rules().replacen("SUBSYSTEM==", "BOGUS==\"1\", SUBSYSTEM==", 1);
    let said = udevadm(folder.path(), &rules, &[udev::ids().next().unwrap()]);
    assert!(said[0].contains(udev::FILE) && said[0].contains("Invalid key 'BOGUS'"), "{}", said[0]);
    assert!(!said[0].lines().any(|line| line.contains(udev::FILE) && line.contains("MODE 0660")));
}
