//! Simulated devices: they speak the same protocols through the same transports, in memory, through a pty or a socket.
//!
//! They are ours, so that a driver that agrees with them is not yet a driver that agrees with the real thing; what they
//! were checked against is said in each.
//!
//! The caller gives the values that they measure ([`PowerSource`]: a power at a time); their faults come from a
//! [`Script`](script::Script).

pub mod apt;
pub mod cm110;
pub mod efw;
pub mod elliptec;
pub mod esp301;
pub mod indi;
pub mod line;
mod motor;
pub mod ocean;
pub mod ooi;
pub mod ophir;
pub mod pm100;
pub mod power;
pub mod scpi;
pub mod script;
pub mod served;
pub mod smc100;
pub mod sp2150;
pub mod standa;
pub mod swabian;
pub mod tmcl;
pub mod zaber;

pub use line::{InMemory, Speaker, Turns, bridge, serve};
pub use power::{PowerSource, Steady};
