//! A self-test that moves and changes nothing.

use super::read::one;
use super::{Reading, Session, SessionError};
use crate::catalogue::{Address, Kind};
use crate::device::{Identity, Setting};

/// Verdict on a step of a self-test.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// In order.
    Ok,
    /// It is as it may be, and worth knowing.
    Note,
    /// The test ended here.
    Failed,
}

impl Verdict {
    /// Returns the word of reports.
    pub fn word(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Note => "note",
            Self::Failed => "failed",
        }
    }
}

/// Finding of a step of a self-test.
#[derive(Debug)]
#[non_exhaustive]
pub enum Finding {
    /// The device answers as one of this kind.
    Opened(Kind),
    /// The device says who it is.
    Identity(Identity),
    /// The device told its settings.
    Settings(Vec<Setting>),
    /// The device measures.
    Reading(Reading),
    /// The device has to be prepared before it measures, and is in order.
    NotReady(SessionError),
    /// The step failed; the test's [`error`](Check::error) says why.
    Failed,
}

/// A step of a self-test.
#[derive(Debug)]
pub struct CheckStep {
    /// Name of the step: `open`, `identity`, `settings` or `reading`.
    pub name: &'static str,
    /// Finding of the step.
    pub finding: Finding,
}

impl CheckStep {
    /// Returns the verdict.
    pub fn verdict(&self) -> Verdict {
        match &self.finding {
            Finding::Reading(reading) if reading.is_over() => Verdict::Note,
            Finding::NotReady(_) => Verdict::Note,
            Finding::Failed => Verdict::Failed,
            _ => Verdict::Ok,
        }
    }
}

/// Result of a self-test.
#[derive(Debug)]
pub struct Check {
    /// Where the device is.
    pub address: Address,
    /// The steps, until one failed.
    pub steps: Vec<CheckStep>,
    /// Why the last step failed, if it did.
    pub error: Option<SessionError>,
}

impl Check {
    /// Returns who the device says it is, if it did.
    pub fn identity(&self) -> Option<&Identity> {
        self.steps.iter().find_map(|step| match &step.finding {
            Finding::Identity(identity) => Some(identity),
            _ => None,
        })
    }

    /// Returns the device's settings; none where it did not tell them.
    pub fn settings(&self) -> &[Setting] {
        let settings = self.steps.iter().find_map(|step| match &step.finding {
            Finding::Settings(settings) => Some(settings.as_slice()),
            _ => None,
        });
        settings.unwrap_or_default()
    }
}

/// Tests the device on a session's line: opens it, asks who it is and how it is set, and takes one reading, with this exposure or bin in
/// seconds. Nothing moves and no setting changes. The first failure ends the test and is in the result.
pub fn check(session: &mut Session, exposure_s: f64) -> Check {
    let mut steps = Vec::new();
    let error = run(session, exposure_s, &mut steps).err().map(|(name, error)| {
        steps.push(CheckStep { name, finding: Finding::Failed });
        error
    });
    Check { address: session.address.clone(), steps, error }
}

/// Runs the steps until one fails, and gives its name with the error.
fn run(
    session: &mut Session,
    exposure_s: f64,
    steps: &mut Vec<CheckStep>,
) -> Result<(), (&'static str, SessionError)> {
    let mut found = |name, finding| steps.push(CheckStep { name, finding });
    let mut device = session.open().map_err(|error| ("open", error))?;
    found("open", Finding::Opened(device.kind()));
    let identity = device.device().identity(&session.soon());
    found("identity", Finding::Identity(identity.map_err(|error| ("identity", error.into()))?));
    let settings = device.device().settings(&session.soon());
    found("settings", Finding::Settings(settings.map_err(|error| ("settings", error.into()))?));
    match one(session, &mut device, exposure_s) {
        // A stage that does not know its angle yet is in order.
        Err(error) if device.kind() == Kind::RotationStage && error.is_not_ready() => {
            found("reading", Finding::NotReady(error));
        }
        reading => found("reading", Finding::Reading(reading.map_err(|error| ("reading", error))?)),
    }
    Ok(())
}
