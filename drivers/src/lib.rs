//! Devices: transports, their recordings and their faults, and one folder per vendor behind one trait per device kind.
//! Knows no physics; stands on `sunglint-formats`. Blocking calls with deadlines, on threads.
//!
//! In the order in which bytes flow through it:
//!
//! - [`clock`]: deadlines on a clock that tests can turn by hand, and the token that ends every wait;
//! - [`transport`]: streams of bytes ([serial](transport::serial), [TCP](transport::tcp), [child process](transport::child)) and
//!   requests one by one ([USB](transport::usb), [HID](transport::hid)), one error type for all;
//! - [`recording`]: what was said, as text; [`Recorded`](recording::Recorded), [`Replay`](recording::Replay) and
//!   [`Faulty`](recording::Faulty) around any transport; [the same as fake devices](recording::umockdev) under real libraries;
//! - [`reply`]: answers as text, parsed strictly;
//! - [`device`]: photon counter, camera, power meter, rotation stage, filter wheel, focuser, mount, one small trait each;
//! - [`turning`]: the part that rotation stages of several protocols share;
//! - [`trinamic`]: a rotation stage on a TMCL motor controller;
//! - [`indi`], [`alpaca`]: cameras, rotators, filter wheels, focusers and mounts behind an INDI server, and behind one of ASCOM Alpaca;
//! - [`ophir`], [`thorlabs`]: power meters on a serial line and on USB; rotation stages on the [APT](thorlabs::apt) and
//!   [Elliptec](thorlabs::elliptec) protocols;
//! - [`zaber`], [`newport`], [`standa`]: rotation stages on Zaber's ASCII protocol, Newport's ESP301 and SMC100, Standa's 8SMC4 and 8SMC5;
//! - [`scpi`]: meters, sources and power meters that a file describes, over TCP, serial ports, GPIB adapters and [`usbtmc`];
//! - [`zwo`]: a filter wheel on HID;
//! - [`spectral_products`], [`acton`]: monochromators; [`ocean`]: spectrometers;
//! - [`swabian`]: photon counters (Time Taggers), through a bridge in the user's Python;
//! - [`simulated`]: devices that speak the same protocols: a TMCL module, an APT stage, an Elliptec mount, an INDI server, both kinds of power
//!   meter, the wheel, a Time Tagger behind its bridge;
//! - [`catalogue`]: every driver by name and address, over any transport; what is plugged in; the udev rules;
//! - [`session`]: one device opened by its address, checked, read, set, moved, recorded and replayed;
//! - [`tags`], [`ptu`]: photon time tags on disk, binned into counts.
//!
//! Frame grabbers and films through OpenCV are in a crate of their own, `sunglint-drivers-opencv`, behind a cargo feature.
//!
//! # How far it is tried
//!
//! No real instrument has been at the other end yet. Serial ports are tried on ptys, TCP on sockets, children on real
//! processes; INDI with the simulators of indi-bin 1.9.9, live; the Time Tagger's bridge with the maker's package 2.22.6 as far
//! as that goes without hardware. USB (libusb) and HID (hidraw) go through the real libraries to fake
//! devices that umockdev makes of recordings.
//!
//! # A stage, on a desk without one
//!
//! ```
//! use std::{sync::Arc, time::Duration};
//! use sunglint_drivers::clock::{Deadline, VirtualClock};
//! use sunglint_drivers::device::RotationStage as _;
//! use sunglint_drivers::simulated::InMemory;
//! use sunglint_drivers::simulated::tmcl::{Module, ModuleSettings};
//! use sunglint_drivers::trinamic::{LinkSettings, Search, Stage, StageSettings};
//!
//! let clock = Arc::new(VirtualClock::new());
//! let within = |seconds| Deadline::after(clock.clone(), Duration::from_secs(seconds));
//! // With a real module: `Serial::open("/dev/ttyACM0", 9600)?`, and deadlines on `Deadline::within`.
//! let line = InMemory::new(Module::new(ModuleSettings::default()));
//! let settings = StageSettings {
//!     search: Some(Search { mode: 1, speed: 5_000, switch_speed: 500, tolerance_deg: 0.5 }),
//!     ..StageSettings::default()
//! };
//! let mut stage = Stage::open(line, LinkSettings::default(), settings, &within(5))?;
//! assert_eq!(stage.home(&within(60))?, 0.0);
//! assert_eq!(stage.move_to(45.0, &within(60))?, 45.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod acton;
pub mod alpaca;
pub mod catalogue;
pub mod clock;
pub mod device;
pub mod indi;
pub mod newport;
pub mod ocean;
pub mod ophir;
pub mod ptu;
pub mod recording;
pub mod reply;
pub mod scpi;
pub mod session;
pub mod simulated;
pub mod spectral_products;
pub mod standa;
pub mod swabian;
pub use sunglint_formats::tags;
pub mod thorlabs;
pub mod transport;
pub mod trinamic;
pub mod turning;
mod twice;
pub mod usbtmc;
pub mod zaber;
pub mod zwo;
