//! The older USB protocol of Ocean Optics, which has no name of its own; seabreeze calls it OOI.
//!
//! - [`Model`]: the models, the USB2000, USB4000 and Flame, HR4000, QE65000, NIRQuest, Maya and others;
//! - [`command`], [`slot_text`], [`status`], [`spectrum`]: commands and answers as bytes, read strictly;
//! - [`Ooi`]: a [`Spectrometer`](crate::device::Spectrometer) on it.
//!
//! # The protocol
//! A command is a byte and its data, on a bulk endpoint. Answers to questions come on a second one, spectra on a third; the USB4000 and HR4000 send the first 2048 bytes of a
//! spectrum on a fourth. At full speed (12 Mbit/s) models that tell their speed send all on the second.
//!
//! No answer has a number or a checksum. A spectrum has a length and, but for the Jaz, a mark (69) at its end. So the driver
//! - reads what is in the endpoints before each question, and asks for the serial number where something was;
//! - reads each slot of the memory until two readings agree;
//! - takes no spectrum of another length, without its mark, with a value above its converter's, or equal to the one before, value by value.
//!
//! # Undetected faults
//! USB has a checksum in each packet, so that bytes are not altered on the way. A fault of the instrument's own is not seen where it leaves length and mark as they are: counts that
//! are altered, or a packet that is lost in the spectrum in which another came twice.
//!
//! # Which light is in a spectrum
//! Like in [`ocean`](super), the first spectrum of each call is thrown away. It was under way before the call, or was held ready since the last one; after a change of the time
//! of integration it is of the old time. What comes sooner after the call than its integration lasts is thrown away, too. Models that tell their status are asked for the time of
//! integration before each spectrum.
//!
//! # Counts
//! They are the converter's own. seabreeze multiplies those of some models by [`Model::saturation`] over what slot 17 says; here that value is
//! [`Spectrum::saturation_counts`](crate::device::Spectrum::saturation_counts). Nonlinearity and stray light are read and told ([`Calibration`]), and nothing is corrected: both need the dark first.
//! Values of a frame that are no pixels of the detector are left out.
//!
//! # Sources
//! seabreeze 2.11.0 (MIT), its pure Python backend, for commands, layouts and models; the maker's libseabreeze 3.0 (MIT) for the mark and the detectors' pixels; the maker's data sheet of the Apex for the status.
//! That command 01 begins a session and 0A 0000 waits for no trigger are in all of them. That command 09 is answered with a spectrum that was under way is in the discussion of seabreeze's
//! issues 18 and 110.
//!
//! # Tried with
//! Nothing real. [Our simulated instruments](crate::simulated::ooi) are driven by seabreeze 2.11.0 (`pyseabreeze`, pyusb 1.3.1 on pipes in place of a bus), each of the models,
//! which gets the same values.

mod frame;
mod line;
mod models;
mod spectrometer;

pub use frame::{
    Layout, MARK, SLOT_LENGTH, STATUS_LENGTH, Saturation, Speed, Status, command, firmware,
    saturation, set_integration, slot, slot_bytes, slot_number, slot_order, slot_text, spectrum,
    status,
};
pub use models::{Endpoints, Model};
pub use spectrometer::{Calibration, Ooi, OoiSettings};
