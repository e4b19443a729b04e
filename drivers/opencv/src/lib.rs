//! Frame grabbers, recordings and image sequences, through OpenCV. Only with the cargo feature `opencv`, which needs OpenCV
//! and libclang; without it this crate is empty, and nothing else of the toolkit needs them (`README.md` says how to build).
//!
//! In the order in which light flows through it:
//!
//! - `picture`: what a backend delivers (one plane, or blue, green and red), and its way into a `Frame`'s 16 bits;
//! - `capture`: a source of pictures, whatever it is: a live device (`live`), a recorded file (`recording`), numbered images
//!   (`sequence`), or one of the caller's own;
//! - `worker`: the thread on which OpenCV blocks, so that a deadline ends the caller's wait all the same;
//! - `cadence`: frames that were lost or doubled; `gamma`: light out of bent numbers; `interlace`: the two fields of a frame;
//! - `grabber`: any of them as a [`device::Camera`](sunglint_drivers::device::Camera), with an honest time for each frame;
//! - `recorder`: frames into a lossless recording, with their times, exposures and check sums in a table beside it (`sidecar`);
//! - `bayer`: colours out of a mosaic;
//! - `address`: all of it by an address of the catalogue, for programs.
//!
//! # How far it is tried
//!
//! Recordings and sequences are tried with real files through OpenCV 4.6, against FFmpeg's own program and another reader of PNG.
//! **No live device has been at the other end**: what is above OpenCV is tried with sources of our own, what lies between OpenCV
//! and Video4Linux is not tried but for a device that is not there.

#[cfg(feature = "opencv")]
mod address;
#[cfg(feature = "opencv")]
pub mod bayer;
#[cfg(feature = "opencv")]
mod cadence;
#[cfg(feature = "opencv")]
pub mod capture;
#[cfg(feature = "opencv")]
mod error;
#[cfg(feature = "opencv")]
mod gamma;
#[cfg(feature = "opencv")]
pub mod grabber;
#[cfg(feature = "opencv")]
mod interlace;
#[cfg(feature = "opencv")]
pub mod live;
#[cfg(feature = "opencv")]
mod mat;
#[cfg(feature = "opencv")]
pub mod picture;
#[cfg(feature = "opencv")]
pub mod recorder;
#[cfg(feature = "opencv")]
pub mod recording;
#[cfg(feature = "opencv")]
pub mod sequence;
#[cfg(feature = "opencv")]
pub mod sidecar;
#[cfg(feature = "opencv")]
mod worker;

#[cfg(feature = "opencv")]
pub use address::{open, provide};
#[cfg(feature = "opencv")]
pub use cadence::Losses;
#[cfg(feature = "opencv")]
pub use gamma::Gamma;
#[cfg(feature = "opencv")]
pub use grabber::{Automatic, Doubled, FrameTimes, Grabber, GrabberSettings, Lossy, Source};
#[cfg(feature = "opencv")]
pub use interlace::Field;
#[cfg(feature = "opencv")]
pub use recorder::{RecordError, Recorded, Recorder};
