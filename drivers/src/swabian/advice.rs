//! Advice for the person at the desk on the bridge's errors.

use super::DEVICE;
use crate::device::DeviceError;

/// Returns advice on what to do, by the bridge's code.
fn advice(code: &str) -> Option<&'static str> {
    Some(match code {
        "no_module" => {
            "install the maker's package for this Python (pip install Swabian-TimeTagger), or name the Python that has it"
        }
        "statistics" => "this version of the maker's package is not known: use 2.22 or newer",
        "no_device" => {
            "plug it in, close other programs that have it open (Time Tagger Lab, a second sunglint), and check \
             udev/70-sunglint.rules"
        }
        "no_licence" => {
            "the maker's virtual Time Tagger needs a licence that is fetched once, over the internet, with a Time Tagger \
             plugged in; for a try without one use the simulated counter"
        }
        "no_server" => {
            "start its server on the computer that has it (startServer), and check the address, the port (41101 unless \
             another was given) and the firewall"
        }
        "bad_file" => {
            "is it a whole .ttbin file? Of a sequence, give the one without number, with the others beside it"
        }
        "wrong_version" => "bridge and program have to be of one version: do not mix them",
        _ => return None,
    })
}

/// The bridge's error as ours.
pub(super) fn declined(request: &str, code: &str, text: &str) -> DeviceError {
    const MOST: usize = 400;
    let mut message: String = text.chars().take(MOST).collect();
    if let Some(advice) = advice(code) {
        message = format!("{}; {advice}", message.trim_end_matches('.'));
    }
    DeviceError::Declined { device: DEVICE, request: request.to_owned(), message }
}
