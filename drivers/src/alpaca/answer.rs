//! Answers in JSON, and ASCOM's errors.

use super::http::Response;
use crate::device::DeviceError;
use serde::Deserialize;
use serde_json::Value;

/// The most that an answer in JSON may have, bytes.
pub const MOST_JSON: usize = 256 << 10;

/// ASCOM's code of a member that a device does not have.
pub(super) const NOT_IMPLEMENTED: i64 = 0x400;
const ACTION_NOT_IMPLEMENTED: i64 = 0x40C;
/// ASCOM's code of a request while the mount is parked.
pub(super) const PARKED: i64 = 0x408;

/// Frame of every answer.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct Envelope<V> {
    /// The value; absent after a `PUT`, and where there is an error.
    #[serde(rename = "Value")]
    pub value: Option<V>,
    /// Zero, or ASCOM's code of the error.
    #[serde(rename = "ErrorNumber", default)]
    pub error_number: i64,
    /// The error in words.
    #[serde(rename = "ErrorMessage", default)]
    pub error_message: Option<String>,
    /// Number of the request that is answered; zero where the server does not say.
    #[serde(rename = "ClientTransactionID", default)]
    pub client_transaction: i64,
    /// Whether the answer says at all how it went.
    #[serde(rename = "ServerTransactionID")]
    pub server_transaction: Option<i64>,
}

impl<V: serde::de::DeserializeOwned> Envelope<V> {
    /// Reads an answer.
    ///
    /// # Errors
    /// Description of what is no answer of Alpaca.
    pub fn parse(body: &[u8]) -> Result<Self, String> {
        let envelope: Self = serde_json::from_slice(body).map_err(|error| {
            format!("the answer is no JSON of Alpaca ({error}): {}", excerpt(body))
        })?;
        if envelope.value.is_none()
            && envelope.server_transaction.is_none()
            && envelope.error_number == 0
        {
            return Err(format!("the answer is no envelope of Alpaca: {}", excerpt(body)));
        }
        Ok(envelope)
    }
}

/// At most so many characters of a text from outside, fit for a terminal.
pub(super) fn clean(text: &str, most: usize) -> String {
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).take(most).collect()
}

/// Begin of a body, for a message.
pub(super) fn excerpt(body: &[u8]) -> String {
    let text = String::from_utf8_lossy(&body[..body.len().min(600)]).into_owned();
    format!("`{}`", clean(&text, 200).trim())
}

/// Meaning of ASCOM's codes.
fn meaning(code: i64) -> &'static str {
    match code {
        0x400 => "it cannot do that",
        0x401 => "the value is not valid",
        0x402 => "the value was never set",
        0x407 => "it is not connected",
        0x408 => "it is parked: unpark it first",
        0x409 => "it is slaved",
        0x40B => "it cannot do that now",
        0x40C => "it has no such action",
        0x40D => "it has not measured that yet",
        0x40E => "the operation was cancelled",
        0x500..=0xFFF => "its driver reports an error",
        _ => "it reports an error",
    }
}

/// Why there is no value.
#[derive(Debug)]
pub(super) enum Fail {
    /// The server said no.
    Said {
        /// ASCOM's code, or the HTTP status.
        code: i64,
        /// Message of the server.
        message: String,
        /// Whether it was a HTTP status and no code of ASCOM.
        is_status: bool,
    },
    /// Anything else.
    Device(DeviceError),
}

impl Fail {
    /// Whether the device does not have this member.
    pub fn is_absent(&self) -> bool {
        match self {
            Self::Said { code, is_status: false, .. } => {
                matches!(*code, NOT_IMPLEMENTED | ACTION_NOT_IMPLEMENTED)
            }
            Self::Said { code, is_status: true, .. } => matches!(*code, 400 | 404 | 405 | 501),
            Self::Device(_) => false,
        }
    }

    /// Whether the device has the member and no value of it yet.
    pub fn is_not_yet(&self) -> bool {
        matches!(self, Self::Said { code: 0x402 | 0x40B | 0x40D, is_status: false, .. })
    }

    /// Whether the device said no with this code of ASCOM.
    pub fn has_code(&self, wanted: i64) -> bool {
        matches!(self, Self::Said { code, is_status: false, .. } if *code == wanted)
    }

    /// The error, with the request that it answers.
    pub fn error(self, device: &'static str, request: &str) -> DeviceError {
        match self {
            Self::Device(error) => error,
            Self::Said { code, message, is_status } => {
                let request = request.to_owned();
                let message = if is_status {
                    format!("the server answers with HTTP status {code}: {message}")
                } else {
                    format!("{} (ASCOM error {code:#x}): {message}", meaning(code))
                };
                DeviceError::Declined { device, request, message }
            }
        }
    }
}

/// The value of an answer; `Null` after a `PUT`.
pub(super) fn value_of(
    device: &'static str,
    response: &Response,
    transaction: u32,
) -> Result<Value, Fail> {
    let protocol = |reason| Fail::Device(DeviceError::Protocol { device, reason });
    if response.status != 200 {
        let message = excerpt(&response.body);
        return Err(Fail::Said { code: response.status.into(), message, is_status: true });
    }
    let envelope: Envelope<Value> = Envelope::parse(&response.body).map_err(protocol)?;
    check(&envelope, transaction).map_err(protocol)?;
    if envelope.error_number != 0 {
        return Err(said(envelope.error_number, envelope.error_message.as_deref()));
    }
    Ok(envelope.value.unwrap_or(Value::Null))
}

/// Whether an answer is that of the request.
pub(super) fn check<V>(envelope: &Envelope<V>, transaction: u32) -> Result<(), String> {
    let got = envelope.client_transaction;
    if got != 0 && got != i64::from(transaction) {
        return Err(format!("the answer is that of request {got}, expected {transaction}"));
    }
    Ok(())
}

pub(super) fn said(code: i64, message: Option<&str>) -> Fail {
    let message = excerpt(message.unwrap_or_default().as_bytes());
    Fail::Said { code, message, is_status: false }
}
