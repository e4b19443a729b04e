//! Questions that are asked once more when their answer did not come, or came spoilt.

use crate::clock::Deadline;
use crate::device::DeviceError;
use crate::transport::TransportError;

/// Why a question has no answer.
#[derive(Debug)]
pub(crate) enum Trouble {
    /// The transport failed. A time that ran out, a line without an end and a refused transfer may pass; a line that is gone does not come back.
    Transport(TransportError),
    /// The question may be repeated.
    Again(DeviceError),
    /// It may not.
    Final(DeviceError),
}

impl From<TransportError> for Trouble {
    fn from(error: TransportError) -> Self {
        Self::Transport(error)
    }
}

/// Tries, and once more where that may help.
///
/// # Errors
/// That of the last attempt; where not even the first had time, that the deadline is over.
pub(crate) fn twice<V>(
    device: &'static str,
    deadline: &Deadline,
    mut attempt: impl FnMut() -> Result<V, Trouble>,
) -> Result<V, DeviceError> {
    let mut first = None;
    loop {
        if let Err(expired) = deadline.remaining() {
            // What went wrong before tells more than that the time is over.
            return Err(first.unwrap_or_else(|| DeviceError::transport(device, expired.into())));
        }
        let (error, again) = match attempt() {
            Ok(value) => return Ok(value),
            Err(Trouble::Again(error)) => (error, true),
            Err(Trouble::Final(error)) => (error, false),
            Err(Trouble::Transport(error)) => {
                let passing = matches!(
                    error,
                    TransportError::TooLong { .. } | TransportError::Stalled { .. }
                );
                let again = passing || error.is_timeout();
                (DeviceError::transport(device, error), again)
            }
        };
        if !again || first.is_some() {
            return Err(error);
        }
        first = Some(error);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    fn again(reason: &str) -> Trouble {
        Trouble::Again(DeviceError::Protocol { device: "meter", reason: reason.into() })
    }

    /// Truth: by construction: two attempts, the second only where the first may be repeated, and the last one's error.
    #[test]
    fn there_are_two_attempts_at_most() {
        let deadline = Deadline::within(Duration::from_secs(60));
        let tried = |answers: Vec<Result<u8, Trouble>>| {
            let mut answers = answers.into_iter();
            let mut count = 0;
            let found = twice("meter", &deadline, || {
                count += 1;
                answers.next().unwrap()
            });
            (found.map_err(|e| e.to_string()), count)
        };
        assert_eq!(tried(vec![Ok(1)]), (Ok(1), 1));
        assert_eq!(tried(vec![Err(again("spoilt")), Ok(2)]), (Ok(2), 2));
        let (last, count) = tried(vec![Err(again("spoilt")), Err(again("worse"))]);
        assert!(last.unwrap_err().contains("worse") && count == 2);
        let refused = DeviceError::Protocol { device: "meter", reason: "refused".into() };
        let (last, count) = tried(vec![Err(Trouble::Final(refused))]);
        assert!(last.unwrap_err().contains("refused") && count == 1);
        let gone = TransportError::Disconnected { what: "cable".into(), got_so_far: Vec::new() };
        assert_eq!(tried(vec![Err(gone.into())]).1, 1);
        let late =
            TransportError::Timeout { after: Duration::from_secs(1), got_so_far: Vec::new() };
        assert_eq!(tried(vec![Err(late.into()), Ok(3)]), (Ok(3), 2));
    }

    /// Truth: by construction: a deadline that is over lets nothing be asked; one that ends with the first attempt leaves that attempt's error.
    #[test]
    fn a_deadline_that_is_over_is_said() {
        let over = Deadline::within(Duration::ZERO);
        let found: Result<u8, _> = twice("meter", &over, || panic!("asked"));
        assert!(found.is_err());
        let soon = Deadline::within(Duration::from_millis(5));
        let found: Result<u8, _> = twice("meter", &soon, || {
            std::thread::sleep(Duration::from_millis(10));
            Err(again("spoilt"))
        });
        assert!(found.unwrap_err().to_string().contains("spoilt"));
    }
}
