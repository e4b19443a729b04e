//! ASCOM Alpaca: telescopes, cameras, filter wheels, rotators and focusers behind a server that speaks HTTP.
//!
//! - [`http`]: one request after the other on one kept connection, with a time limit and bounded answers;
//! - [`answer`], [`image`]: the envelope in JSON with ASCOM's errors, and frames as ImageBytes or JSON;
//! - [`Mount`], [`Camera`], [`Wheel`], [`Rotator`], [`Focuser`]: the devices, each on a connection of its own;
//! - [`discover`], [`configured`]: servers in the network, and the devices of a server.
//!
//! After anything that went wrong (a time that ran out, a broken answer) the connection is made anew, so that no answer is taken for that of a later request.
//! A request that must not be done twice (an exposure) is never repeated.
//!
//! # Tried with
//! `alpaca-simulators` 1.3.2 (PyPI), live and recorded. No real device yet.

pub mod answer;
mod camera;
mod discovery;
mod focuser;
pub mod http;
pub mod image;
mod mount;
mod rotator;
mod session;
mod wheel;

pub use camera::Camera;
pub use discovery::{Configured, DISCOVERY_PORT, configured, discover, is_safe, server_of};
pub use focuser::Focuser;
pub use mount::{Mount, MountSettings};
pub use rotator::Rotator;
pub use session::{Place, SessionSettings};
pub use wheel::Wheel;

/// The usual port of Alpaca servers.
pub const PORT: u16 = 11_111;
