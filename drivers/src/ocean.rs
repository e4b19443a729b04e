//! Spectrometers of Ocean Optics (Ocean Insight): those that speak the Ocean Binary Protocol (HDX and FX by network, STS, HDX and
//! Ventana by USB), and those of the older USB protocol (USB2000, USB4000, HR4000, QE65000, Maya, NIRQuest and others: [`ooi`]).
//!
//! - [`obp`]: frames as bytes, read strictly, and the numbers of messages and errors;
//! - [`Link`]: question and answer, brought into step by the serial number where one got lost;
//! - [`Obp`]: a [`Spectrometer`](crate::device::Spectrometer) on it;
//! - [`ooi`]: the older protocol, its models, and a spectrometer on it.
//!
//! # The protocol
//! Frames of 44 bytes of head, perhaps data, and 20 bytes of tail: the message's number, a number that the answer repeats, flags, an error, up to 16
//! bytes of data in the head or more behind it, a checksum (MD5) where one is said. By TCP (the HDX listens at port 57357) and on USB's bulk
//! endpoints the same. Both have checksums of their own, so frames without are taken; a checksum that is there is checked.
//!
//! # Which light is in a spectrum
//! The instrument integrates all the time. A spectrum that is asked for within an integration is of that one: it began before it was asked
//! for, and after the time of integration was changed it is of the old time. So the first spectrum of each call is thrown away: the second began after it. What
//! comes sooner after the call than its integration lasts is thrown away, too. Before each spectrum the time
//! of integration is read back, where the instrument can tell it. A spectrum takes up to twice its integration.
//!
//! # Sources
//! Layout, flags, errors and numbers of messages are those of seabreeze 2.11.0 (MIT), its pure Python backend, of which the product numbers, pixels and limits of the
//! models are, too. That an answer repeats the number of its question, and the question for the time of integration (00110000), are from memory of the maker's data sheets:
//! an instrument that does neither is taken as well.
//!
//! # Tried with
//! Nothing real. [Our simulated HDX](crate::simulated::ocean) is driven over TCP by seabreeze 2.11.0 (`pyseabreeze`), which gets the same values.

mod fresh;
mod link;
mod md5;
pub mod obp;
pub mod ooi;
mod spectrometer;
mod usb;

pub use link::{Link, LinkSettings};
pub use md5::md5;
pub use spectrometer::{Model, Obp, ObpSettings};
pub(crate) use usb::endpoints;
pub use usb::{Bulk, ENDPOINTS, PRODUCTS, VENDOR, open, open_product};

/// The device, in messages.
pub(crate) const DEVICE: &str = "Ocean spectrometer";
