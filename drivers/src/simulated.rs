//! Simulated devices: they speak the same protocols through the same transports, in memory, through a pty or a socket.
//!
//! They are ours, so that a driver that agrees with them is not yet a driver that agrees with the real thing; what they
//! were checked against is said in each.

pub mod indi;
pub mod tmcl;
