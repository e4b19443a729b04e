//! Recordings: no panic; what is read is written as the same; umockdev's files are made or refused.

use sunglint_drivers::recording::Recording;
use sunglint_drivers::recording::umockdev::{HidRaw, UsbDevice};

/// Tries one input.
pub fn run(bytes: &[u8]) {
    let text = &*String::from_utf8_lossy(bytes);
    let Ok(recording) = Recording::parse("x", text) else { return };
    if let Ok(written) = recording.to_text() {
        let again = Recording::parse("x", &written).expect("what was written is read");
        assert_eq!(again.header, recording.header);
        assert!(again.events.iter().map(|(_, e)| e).eq(recording.events.iter().map(|(_, e)| e)));
    }
    let usb = UsbDevice {
        vendor: 1,
        product: 2,
        manufacturer: "m".into(),
        name: "n".into(),
        serial: "s".into(),
        class: [0xfe, 3, 1],
        bulk_in: 0x82,
        bulk_out: 2,
    };
    let _ = (usb.ioctl(&recording), usb.pcap(&recording), HidRaw::script(&recording));
}
