//! The udev rules that let a user at the computer reach the devices without being root.
//!
//! They are made of the numbers in the catalogue; `udev/70-sunglint.rules` is held against them by a test.

use super::{Bus, DRIVERS, UsbId};

/// The file's name. It must sort before `73-seat-late.rules`, which acts on the tag `uaccess`.
pub const FILE: &str = "70-sunglint.rules";

/// The folder in which a system's own rules stand.
pub const FOLDER: &str = "/etc/udev/rules.d";

/// Every number that the rules name.
pub fn ids() -> impl Iterator<Item = UsbId> {
    DRIVERS.into_iter().flat_map(|driver| driver.ids).copied()
}

/// The text of the file.
pub fn rules() -> String {
    let mut text = String::from(
        "# Instruments that sunglint drives, for whoever sits at the computer (tag uaccess), and for the group plugdev
# (dialout on serial ports) from elsewhere. Made by `sunglint devices udev`; install it as root:
#
#   sunglint devices udev | sudo tee /etc/udev/rules.d/70-sunglint.rules
#   sudo udevadm control --reload
#
# then plug the devices in again. The number 70 matters: uaccess is acted on at 73.

ACTION==\"remove\", GOTO=\"sunglint_end\"
",
    );
    for id in ids() {
        text.push_str(&format!("\n# {}\n{}\n", id.name, rule(id)));
    }
    text.push_str("\nLABEL=\"sunglint_end\"\n");
    text
}

fn rule(id: UsbId) -> String {
    let numbers = |attribute: &str| {
        let vendor = format!("{attribute}{{idVendor}}==\"{:04x}\"", id.vendor);
        match id.product {
            Some(product) => format!("{vendor}, {attribute}{{idProduct}}==\"{product:04x}\""),
            None => vendor,
        }
    };
    match id.bus {
        Bus::Usb => format!(
            "SUBSYSTEM==\"usb\", ENV{{DEVTYPE}}==\"usb_device\", {}, MODE=\"0660\", GROUP=\"plugdev\", TAG+=\"uaccess\"",
            numbers("ATTR")
        ),
        Bus::Hid => format!(
            "SUBSYSTEM==\"hidraw\", {}, MODE=\"0660\", GROUP=\"plugdev\", TAG+=\"uaccess\"",
            numbers("ATTRS")
        ),
        // No modem: ModemManager would speak to a motor.
        Bus::Serial => format!(
            "SUBSYSTEM==\"tty\", {}, MODE=\"0660\", TAG+=\"uaccess\", ENV{{ID_MM_DEVICE_IGNORE}}=\"1\"",
            numbers("ATTRS")
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the file that users install; `SUNGLINT_UPDATE=1` writes it anew.
    #[test]
    fn the_file_is_what_the_catalogue_says() {
        let path = sunglint_testkit::repository().join("udev").join(FILE);
        if std::env::var_os("SUNGLINT_UPDATE").is_some() {
            std::fs::write(&path, rules()).unwrap();
        }
        assert_eq!(std::fs::read_to_string(&path).unwrap(), rules());
        assert!(!rules().contains("0666"));
    }
}
