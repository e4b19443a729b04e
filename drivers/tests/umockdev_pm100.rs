//! The recordings of `fixtures/pm100` through the real libusb, on a USB device that umockdev makes of them.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use std::sync::Arc;
use sunglint_drivers::clock::{Clock, SystemClock};
use sunglint_drivers::recording::Recording;
use sunglint_drivers::recording::umockdev::UsbDevice;
use sunglint_drivers::thorlabs;
use sunglint_testkit::fixture;

fn device() -> UsbDevice {
    UsbDevice {
        vendor: thorlabs::VENDOR,
        product: 0x8078,
        manufacturer: "Thorlabs".into(),
        name: "PM100D".into(),
        serial: "P0000001".into(),
        class: [0xfe, 3, 1],
        bulk_in: 0x82,
        bulk_out: 0x02,
    }
}

/// The host's part, in a program of its own: finds the meter by its numbers and its interface by its class.
#[test]
fn pm100_host_under_umockdev() {
    crate::common::umockdev::play_if_asked(|name| {
        let clock: Arc<dyn Clock> = Arc::new(SystemClock);
        let clear_first = crate::common::pm100::cases()
            .iter()
            .find(|case| case.name == name)
            .unwrap()
            .clear_first;
        match thorlabs::open(None) {
            Ok((usb, endpoints)) => {
                assert_eq!(endpoints, thorlabs::TmcSettings::default().endpoints);
                crate::common::pm100::session(usb, clear_first, &clock)
            }
            Err(error) => format!("not opened: {error}"),
        }
    });
}

/// Bulk transfers alone, as an `.ioctl` file. Truth: the end that the recording has in memory; umockdev compares what the
/// host sends. A byte changed in the recording is an error.
#[test]
fn bulk_transfers_end_the_same_through_libusb() {
    if !crate::common::umockdev::is_there("bulk_transfers_end_the_same_through_libusb") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let device = device();
    let recording = Recording::read(fixture("pm100/good_not_cleared.rec")).unwrap();
    let text = device.ioctl(&recording).unwrap();
    let run = |text: &str| {
        let description =
            crate::common::umockdev::write(folder.path(), "pm100.umockdev", device.description());
        let ioctl = crate::common::umockdev::write(folder.path(), "pm100.ioctl", text);
        let ioctl = format!("{}={ioctl}", UsbDevice::NODE);
        crate::common::umockdev::run(
            "pm100_host_under_umockdev",
            "good_not_cleared",
            &["-d".into(), description, "-i".into(), ioctl],
        )
    };
    assert_eq!(run(&text), "1.3e-3 W at 532 nm, range 5e-3W");
    // `*IDN?` becomes `*IDM?`.
    let changed = text.replacen("2A49444E3F", "2A49444D3F", 1);
    assert_ne!(changed, text);
    assert!(run(&changed).starts_with("open: "), "{}", run(&changed));
}

/// Control transfers too, as a capture of usbmon. Truth: the ends that the recordings have in memory.
#[test]
fn captures_end_the_same_through_libusb() {
    if !crate::common::umockdev::is_there("captures_end_the_same_through_libusb") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let device = device();
    let description =
        crate::common::umockdev::write(folder.path(), "pm100.umockdev", device.description());
    let cases = crate::common::pm100::cases();
    let shown: Vec<_> = cases.iter().filter(|case| case.is_for_umockdev()).collect();
    assert_eq!(shown.len(), 13);
    std::thread::scope(|scope| {
        for part in shown.chunks(3) {
            let (folder, device, description) = (folder.path(), &device, &description);
            scope.spawn(move || {
                for case in part {
                    let path = fixture(&format!("pm100/{}.rec", case.name));
                    let pcap = device.pcap(&Recording::read(path).unwrap()).unwrap();
                    let pcap = crate::common::umockdev::write(folder, case.name, pcap);
                    let pcap = format!("{}={pcap}", UsbDevice::SYSFS);
                    let options = ["-d".to_owned(), description.clone(), "-p".to_owned(), pcap];
                    assert_eq!(
                        crate::common::umockdev::run(
                            "pm100_host_under_umockdev",
                            case.name,
                            &options
                        ),
                        case.end,
                        "{}",
                        case.name
                    );
                }
            });
        }
    });
}
