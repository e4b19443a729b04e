//! USBTMC: text instruments by USB (Universal Serial Bus Test and Measurement Class 1.00, with its subclass USB488).
//!
//! - [`MessageIn`], [`message_out`], [`request_in`]: the messages, made and checked;
//! - [`Tmc`]: question and answer over them, with recovery (clearing the instrument's buffers) after anything that went wrong;
//! - [`find`], [`open`]: the instruments that are plugged in.

mod find;
mod message;
mod session;

pub(crate) use find::endpoints;
pub use find::{Found, find, open};
pub use message::{
    CHECK_CLEAR_STATUS, HEADER, IN, INITIATE_CLEAR, MessageError, MessageIn, OUT, STATUS_PENDING,
    STATUS_SUCCESS, message_out, next_tag, request_in,
};
pub use session::{Endpoints, Tmc, TmcSettings};
