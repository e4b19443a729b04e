//! Moves of a stage, a filter wheel, a focuser or a monochromator, one target after the other.

use super::{OpenDevice, Session, SessionError};
use crate::catalogue::{Address, AnyDevice, Kind};
use crate::device::{Identity, Interrupted};
use std::fmt;
use std::time::Duration;
use sunglint_numerics::progress::Progress;

/// How long a move usually takes at most.
const MOVE: Duration = Duration::from_secs(300);

/// Where a move goes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Destination {
    /// An angle, degrees.
    Angle(f64),
    /// The reference mark of a stage.
    Home,
    /// Nowhere: the motor is stopped.
    Stop,
    /// A slot, counted from 1.
    Slot(u32),
    /// A position of a focuser, steps.
    Steps(i64),
    /// A wavelength, nm.
    Wavelength(f64),
}

/// A destination with the text that named it.
#[derive(Debug, Clone, PartialEq)]
pub struct Target {
    /// The text.
    pub name: String,
    /// The destination.
    pub to: Destination,
}

impl Target {
    /// Reads a target of a device of this kind: an angle in degrees, `home` or `stop` for a stage, a slot for a wheel, steps or `stop` for a focuser, a wavelength in nm for a monochromator.
    ///
    /// # Errors
    /// The kind of device does not move, or the text names no target of it.
    pub fn parse(text: &str, kind: Kind) -> Result<Self, SessionError> {
        let to = |to| Ok(Self { name: text.to_owned(), to });
        let expected = match (kind, text) {
            (Kind::RotationStage, "home") => return to(Destination::Home),
            (Kind::RotationStage, "stop") => return to(Destination::Stop),
            (Kind::RotationStage, text) => match text.parse() {
                Ok(angle) if f64::is_finite(angle) => return to(Destination::Angle(angle)),
                _ => "an angle in degrees, `home` or `stop`",
            },
            (Kind::FilterWheel, text) => match text.parse() {
                Ok(slot) if slot > 0 => return to(Destination::Slot(slot)),
                _ => "a slot, counted from 1",
            },
            (Kind::Focuser, "stop") => return to(Destination::Stop),
            (Kind::Focuser, text) => match text.parse() {
                Ok(steps) => return to(Destination::Steps(steps)),
                _ => "a position in whole steps, or `stop`",
            },
            (Kind::Monochromator, text) => match text.parse() {
                Ok(nm) if f64::is_finite(nm) && nm >= 0.0 => {
                    return to(Destination::Wavelength(nm));
                }
                _ => "a wavelength in nm",
            },
            (kind, _) => return Err(SessionError::Immovable { kind }),
        };
        Err(SessionError::Target { found: text.to_owned(), expected })
    }
}

/// Where a device stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Position {
    /// At an angle, degrees.
    Angle(f64),
    /// At a slot, counted from 1.
    Slot(u32),
    /// At a position of a focuser, steps.
    Steps(i64),
    /// At a wavelength, nm.
    Wavelength(f64),
    /// The device does not say.
    Unknown,
}

impl Position {
    /// Returns the angle, degrees.
    pub fn angle_deg(self) -> Option<f64> {
        if let Self::Angle(deg) = self { Some(deg) } else { None }
    }

    /// Returns the slot, counted from 1.
    pub fn slot(self) -> Option<u32> {
        if let Self::Slot(slot) = self { Some(slot) } else { None }
    }
}

impl Position {
    /// Returns the position of a focuser, steps.
    pub fn steps(self) -> Option<i64> {
        if let Self::Steps(steps) = self { Some(steps) } else { None }
    }

    /// Returns the wavelength, nm.
    pub fn wavelength_nm(self) -> Option<f64> {
        if let Self::Wavelength(nm) = self { Some(nm) } else { None }
    }
}

impl fmt::Display for Position {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Angle(deg) => write!(f, "{deg:.4} deg"),
            Self::Slot(slot) => write!(f, "slot {slot}"),
            Self::Steps(steps) => write!(f, "position {steps}"),
            Self::Wavelength(nm) => write!(f, "{nm:.3} nm"),
            Self::Unknown => f.write_str("unknown"),
        }
    }
}

/// A move that was made.
#[derive(Debug, Clone, PartialEq)]
pub struct Move {
    /// Text that named the target.
    pub target: String,
    /// Where the device then stands.
    pub at: Position,
    /// Duration of the move, seconds.
    pub took_s: f64,
}

/// A move that did not reach its target.
#[derive(Debug)]
pub struct FailedMove {
    /// Text that named the target.
    pub target: String,
    /// Why it was not reached.
    pub error: SessionError,
}

/// Moves that were made, all that were asked for or those before a failure.
#[derive(Debug)]
pub struct Moves {
    /// Where the device is.
    pub address: Address,
    /// Who it says it is.
    pub identity: Identity,
    /// The moves that were made.
    pub moves: Vec<Move>,
    /// Where the device stands at the end.
    pub at: Position,
    /// The move that ended them early.
    pub failed: Option<FailedMove>,
}

impl OpenDevice {
    /// Goes to one target after the other. A failure or a cancel stops the motor; the result then says which move it was and where the
    /// device stands.
    pub fn travel(&mut self, targets: &[Target], progress: &dyn Progress) -> Moves {
        let Self { session, device, identity } = self;
        let (mut moves, mut at, mut failed) = (Vec::new(), Position::Unknown, None);
        for Target { name, to } in targets {
            let start = session.now();
            progress.begin(&format!("moving to {name}"), None);
            let gone = go(device, *to, session);
            let took_s = session.now().saturating_sub(start).as_secs_f64();
            match gone {
                Ok(place) => {
                    at = place;
                    moves.push(Move { target: name.clone(), at, took_s });
                }
                Err((place, error)) => {
                    // Some errors do not say it; whoever pressed Ctrl-C wants to know all the same.
                    at = if place == Position::Unknown { stands(device, session) } else { place };
                    failed = Some(FailedMove { target: name.clone(), error });
                    break;
                }
            }
        }
        let (address, identity) = (session.address.clone(), identity.clone());
        Moves { address, identity, moves, at, failed }
    }
}

/// Asks the device where it stands, if it can still be asked.
fn stands(device: &mut AnyDevice, session: &Session) -> Position {
    let grace = session.grace();
    match device {
        AnyDevice::RotationStage(stage) => stage.angle_deg(&grace).map(Position::Angle),
        AnyDevice::FilterWheel(wheel) => wheel.slot(&grace).map(Position::Slot),
        AnyDevice::Focuser(focuser) => focuser.position(&grace).map(Position::Steps),
        AnyDevice::Monochromator(device) => device.wavelength_nm(&grace).map(Position::Wavelength),
        _ => return Position::Unknown,
    }
    .unwrap_or(Position::Unknown)
}

/// Goes there; on failure, gives where the device stands.
fn go(
    device: &mut AnyDevice,
    target: Destination,
    session: &Session,
) -> Result<Position, (Position, SessionError)> {
    let deadline = session.within(MOVE);
    let angle = |failed: Interrupted<Option<f64>>| {
        (failed.done.map_or(Position::Unknown, Position::Angle), (*failed.error).into())
    };
    match (device, target) {
        (AnyDevice::RotationStage(stage), Destination::Angle(deg)) => {
            stage.move_to(deg, &deadline).map(Position::Angle).map_err(angle)
        }
        (AnyDevice::RotationStage(stage), Destination::Home) => {
            stage.home(&deadline).map(Position::Angle).map_err(angle)
        }
        (AnyDevice::RotationStage(stage), Destination::Stop) => {
            stage.stop(&deadline).map_err(|error| (Position::Unknown, error.into()))?;
            // A stage that was never homed stands too, somewhere.
            Ok(stage.angle_deg(&session.soon()).map_or(Position::Unknown, Position::Angle))
        }
        (AnyDevice::Monochromator(device), Destination::Wavelength(nm)) => {
            device.move_to(nm, &deadline).map(Position::Wavelength).map_err(|failed| {
                let at = failed.done.map_or(Position::Unknown, Position::Wavelength);
                (at, (*failed.error).into())
            })
        }
        (AnyDevice::FilterWheel(wheel), Destination::Slot(slot)) => {
            wheel.select(slot, &deadline).map(Position::Slot).map_err(|failed| {
                (failed.done.map_or(Position::Unknown, Position::Slot), (*failed.error).into())
            })
        }
        (AnyDevice::Focuser(focuser), Destination::Steps(steps)) => {
            focuser.move_to(steps, &deadline).map(Position::Steps).map_err(|failed| {
                (failed.done.map_or(Position::Unknown, Position::Steps), (*failed.error).into())
            })
        }
        (AnyDevice::Focuser(focuser), Destination::Stop) => {
            focuser.stop(&deadline).map_err(|error| (Position::Unknown, error.into()))?;
            Ok(focuser.position(&session.soon()).map_or(Position::Unknown, Position::Steps))
        }
        (device, _) => Err((Position::Unknown, SessionError::NoSuchPlace { kind: device.kind() })),
    }
}
