//! The recordings of `fixtures/efw` through the real hidapi, on a hidraw device that umockdev makes of them.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use std::path::Path;
use std::sync::Arc;
use sunglint_drivers::clock::{Clock, SystemClock};
use sunglint_drivers::recording::umockdev::HidRaw;
use sunglint_drivers::recording::{Header, Recorded, Recording};
use sunglint_drivers::zwo;
use sunglint_formats::atomic::Overwrite;
use sunglint_testkit::fixture;

/// The device as the kernel would show it; the descriptor has feature reports 1 and 3 of 15 bytes. Synthetic.
fn device() -> HidRaw {
    let report_descriptor = [
        0x06, 0x00, 0xff, 0x09, 0x01, 0xa1, 0x01, 0x15, 0x00, 0x26, 0xff, 0x00, 0x75, 0x08, 0x95,
        0x0f, 0x85, 0x01, 0x09, 0x01, 0xb1, 0x02, 0x85, 0x03, 0x09, 0x02, 0xb1, 0x02, 0xc0,
    ];
    HidRaw {
        vendor: zwo::VENDOR,
        product: zwo::PRODUCT,
        name: "ZWO EFW".into(),
        report_descriptor: report_descriptor.into(),
    }
}

/// The host's part, in a program of its own: finds the wheel by its numbers, writes down what is said.
#[test]
fn efw_host_under_umockdev() {
    crate::common::umockdev::play_if_asked(|record| {
        let clock: Arc<dyn Clock> = Arc::new(SystemClock);
        let hid = match zwo::open(None) {
            Ok(hid) => hid,
            Err(error) => return format!("not opened: {error}"),
        };
        let header = Header {
            device: "EFW".into(),
            source: "umockdev".into(),
            host: None,
            recorded: None,
            synthetic: true,
        };
        let hid = Recorded::create(hid, Path::new(record), &header, Overwrite::Allow).unwrap();
        crate::common::efw::session(hid, &clock)
    });
}

/// Truth: the ends that the recordings have in memory, and their bytes: umockdev does not compare written reports, so
/// what the host said is compared here.
#[test]
fn recordings_end_the_same_through_hidapi() {
    if !crate::common::umockdev::is_there("recordings_end_the_same_through_hidapi") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let device = device();
    let description =
        crate::common::umockdev::write(folder.path(), "efw.umockdev", device.description());
    let mut played = 0;
    for case in
        crate::common::efw::cases().into_iter().filter(crate::common::efw::Case::is_for_umockdev)
    {
        let recording = Recording::read(fixture(&format!("efw/{}.rec", case.name))).unwrap();
        let ioctl = crate::common::umockdev::write(
            folder.path(),
            case.name,
            device.ioctl(&recording).unwrap(),
        );
        let heard = folder.path().join("heard.rec");
        let options = ["-d".to_owned(), description.clone(), "-i".to_owned()];
        let options = [&options[..], &[format!("{}={ioctl}", HidRaw::NODE)]].concat();
        assert_eq!(
            crate::common::umockdev::run(
                "efw_host_under_umockdev",
                &heard.display().to_string(),
                &options
            ),
            case.end,
            "{}",
            case.name
        );
        let heard = Recording::read(&heard).unwrap();
        assert_eq!(
            crate::common::umockdev::said(&heard),
            crate::common::umockdev::said(&recording),
            "{}",
            case.name
        );
        played += 1;
    }
    assert_eq!(played, 5);
}

/// Checks that an error tells what a fake device cannot do, with the line.
#[test]
fn silence_and_hang_ups_are_not_converted() {
    let recording = |name: &str| Recording::read(fixture(&format!("efw/{name}.rec"))).unwrap();
    for name in ["silence", "disconnect"] {
        let error = device().ioctl(&recording(name)).unwrap_err();
        assert!(error.line > 5 && error.event.starts_with('!'), "{error}");
    }
    let reports = "# device=d\n# source=s\n# synthetic=yes\n> [report-out] 00 5e 41\n> [report-in length=4]\n< 20 7f\n";
    let reports = Recording::parse("x", reports).unwrap();
    // The escapes of umockdev's manual: ^@ for 0, ^` for the caret, ^` raised by 64 for control characters.
    assert_eq!(HidRaw::script(&reports).unwrap(), b"w 0 ^@^`A\nr 0 ^`\x7f\n");
    assert!(device().ioctl(&reports).is_err());
}
