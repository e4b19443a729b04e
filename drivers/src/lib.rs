//! Devices: transports (serial, USB, HID, TCP, child process), their recordings and their faults, and one
//! folder per vendor behind one trait per device kind. Knows no physics; stands on `sunglint-formats`.
//!
//! Nothing is here yet. What will stand here, in the order in which bytes flow through it:
//!
//! - `transport`: bytes or messages with a deadline and a clock; `Recorded`, `Replay` and `Faulty` around any of them;
//! - `device`: photon counter, camera, power meter, rotation stage, filter wheel, one small trait each;
//! - one folder per vendor: Swabian (photon counter), INDI (camera, wheel, rotator), OpenCV (frame grabber, its own
//!   cargo feature), Ophir and Thorlabs (power meter), Trinamic and Thorlabs (stage), ZWO (wheel);
//! - `simulated`: each kind again, speaking the same protocols, fed by a source that the caller plugs in.

pub mod clock;
pub mod device;
pub mod recording;
pub mod simulated;
pub mod transport;
pub mod trinamic;
