//! Times of a server's frames, held against the host's clock.

use hifitime::Epoch;
use sunglint_formats::Frame;
use sunglint_formats::fits::Header;
use sunglint_formats::time::format_utc_shortest;

/// A server's time of an exposure that is farther from the host's counts as wrong, s: the frame then has the host's.
pub const CLOCKS_S: f64 = 5.0;
/// Card with the server's time of an exposure less the host's, s. Beyond [`CLOCKS_S`] the server's time is not the frame's.
pub const HOST_DIFFERENCE: &str = "HOSTDIFF";
/// Least standard deviation of a time of the host's, s.
const LEAST_SIGMA_S: f64 = 1e-3;

/// The host's times about an exposure.
#[derive(Debug, Clone, Copy)]
pub(crate) struct HostTime {
    /// When it asked.
    pub asked: Epoch,
    /// When the server had answered: it began between the two.
    pub answered: Epoch,
}

impl HostTime {
    /// Writes when the host asked.
    pub fn note(header: &mut Header, asked: Epoch) {
        let text = format_utc_shortest(asked);
        header.set("HOSTDATE", text.trim_end_matches('Z'), "UTC of the host when it asked");
    }

    /// Gives a frame its time: as the server says it where that can be, else the host's, with its standard deviation. The cards say which, and how far the two are apart. Returns the server's time
    /// less the host's, s.
    pub fn date(self, frame: &mut Frame, said: Option<Epoch>) -> Option<f64> {
        Self::note(&mut frame.header, self.asked);
        let difference_s = said.map(|said| (said - self.asked).to_seconds());
        if let Some(difference_s) = difference_s {
            let comment = "s, the server's time of the exposure less HOSTDATE";
            frame.header.set(HOST_DIFFERENCE, difference_s, comment);
        }
        match (said, difference_s) {
            (Some(said), Some(difference_s)) if difference_s.abs() <= CLOCKS_S => {
                frame.start = said;
                return Some(difference_s);
            }
            (Some(said), _) => {
                let text = format_utc_shortest(said);
                let comment = "UTC by the server's clock, which is wrong";
                frame.header.set("DATE-SRV", text.trim_end_matches('Z'), comment);
            }
            (None, _) => frame.header.comment(
                "DATE-OBS: when the host asked; the server tells no time that is fine enough",
            ),
        }
        let open_s = (self.answered - self.asked).to_seconds().max(0.0);
        frame.start = self.asked + hifitime::Duration::from_seconds(0.5 * open_s);
        // It began somewhere between the request and the answer.
        let sigma_s = (open_s / 12_f64.sqrt()).max(LEAST_SIGMA_S);
        frame.header.set(
            "TIMRDER",
            sigma_s,
            "s, standard deviation of DATE-OBS, by the host's clock",
        );
        difference_s
    }
}
