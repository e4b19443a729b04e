//! State of the telescope for the cameras: whether it is on its target.

use hifitime::Epoch;
use std::sync::{Mutex, MutexGuard, PoisonError};
use sunglint_formats::session::{Target, TargetKind};

/// State of the telescope.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum AimState {
    /// Not open yet, or on its way.
    #[default]
    Away,
    /// Stands, and will not go to the present visit: parked, stopped, or the visit was given up.
    Standing,
    /// Follows the prediction of a target, and has not found it.
    Looking(Target),
    /// On a target.
    On(Target),
    /// The mount was lost or given up: nobody waits for it.
    Lost,
}

/// Decision of a camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ready {
    /// It records.
    Record,
    /// It takes a frame for the mount, which is not recorded.
    Look,
    /// It waits.
    Wait,
}

/// State of the telescope, for all cameras.
#[derive(Debug)]
pub struct Aim {
    state: Mutex<AimState>,
    /// The camera whose frames the mount takes.
    camera: Option<String>,
    wait: bool,
    acquire_s: f64,
}

impl Aim {
    /// Makes the state of a mount that has a camera, or none.
    pub fn new(camera: Option<String>, wait: bool, acquire_s: f64) -> Self {
        Self { state: Mutex::default(), camera, wait, acquire_s }
    }

    fn state(&self) -> MutexGuard<'_, AimState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether the telescope follows a target, found or not.
    pub fn follows(&self) -> bool {
        matches!(*self.state(), AimState::Looking(_) | AimState::On(_))
    }

    /// The telescope's state changes.
    pub fn set(&self, state: AimState) {
        *self.state() = state;
    }
}

/// A camera's memory of the visit that it waits for.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Waiting {
    visit: Option<(Target, Epoch)>,
    since: Option<Epoch>,
    was_on: bool,
}

impl Waiting {
    /// Decides how a camera goes on at a target, in the visit that began then. A visit that was on its target once goes on while the mount looks for it again: a cloud costs no frames.
    pub fn decide(
        &mut self,
        aim: &Aim,
        camera: &str,
        target: Option<(&Target, Epoch)>,
        now: Epoch,
    ) -> Ready {
        let Some((target, begun)) = target.filter(|(target, _)| needs_mount(target.target_kind))
        else {
            *self = Self::default();
            return Ready::Record;
        };
        let is_it = |(known, at): &(Target, Epoch)| known == target && *at == begun;
        if !self.visit.as_ref().is_some_and(is_it) {
            let visit = Some((target.clone(), begun));
            *self = Self { visit, since: Some(now), was_on: false };
        }
        let state = aim.state().clone();
        let waited_s = self.since.map_or(0.0, |since| (now - since).to_seconds());
        let late = !aim.wait || waited_s >= aim.acquire_s;
        match state {
            AimState::On(on) if on == *target => {
                self.was_on = true;
                Ready::Record
            }
            AimState::Looking(at) if at == *target => match self.was_on || late {
                true => Ready::Record,
                false if aim.camera.as_deref() == Some(camera) => Ready::Look,
                false => Ready::Wait,
            },
            AimState::Lost => Ready::Record,
            // What comes would not be the target, however long it is waited.
            AimState::Standing if aim.wait => Ready::Wait,
            _ if late => Ready::Record,
            _ => Ready::Wait,
        }
    }
}

/// Whether the telescope has to point somewhere.
pub fn needs_mount(kind: TargetKind) -> bool {
    matches!(kind, TargetKind::Star | TargetKind::Satellite | TargetKind::Sky)
}

#[cfg(test)]
mod tests {
    use super::*;
    use sunglint_formats::time::parse_utc;

    /// Truth: the rules in words.
    #[test]
    fn cameras_wait_for_their_target_only() {
        let at = |s: f64| {
            parse_utc("2026-11-21T18:00:00Z").unwrap() + hifitime::Duration::from_seconds(s)
        };
        let star =
            |name: &str| Target { name: name.into(), on: true, ..Target::off(TargetKind::Star) };
        let (vega, deneb, dark) = (star("Vega"), star("Deneb"), Target::off(TargetKind::Dark));
        let aim = Aim::new(Some("cam".into()), true, 60.0);
        let (mut cam, mut other) = (Waiting::default(), Waiting::default());
        // Dark frames need no telescope, and neither does a time without a visit.
        assert_eq!(cam.decide(&aim, "cam", Some((&dark, at(0.0))), at(0.0)), Ready::Record);
        assert_eq!(cam.decide(&aim, "cam", None, at(0.0)), Ready::Record);
        assert_eq!(cam.decide(&aim, "cam", Some((&vega, at(0.0))), at(1.0)), Ready::Wait);
        aim.set(AimState::Looking(vega.clone()));
        assert_eq!(cam.decide(&aim, "cam", Some((&vega, at(0.0))), at(2.0)), Ready::Look);
        assert_eq!(other.decide(&aim, "other", Some((&vega, at(0.0))), at(2.0)), Ready::Wait);
        aim.set(AimState::On(vega.clone()));
        assert_eq!(cam.decide(&aim, "cam", Some((&vega, at(0.0))), at(3.0)), Ready::Record);
        // A cloud.
        aim.set(AimState::Looking(vega.clone()));
        assert_eq!(cam.decide(&aim, "cam", Some((&vega, at(0.0))), at(4.0)), Ready::Record);
        // The next target: the telescope is still on the old one.
        aim.set(AimState::On(vega.clone()));
        assert_eq!(cam.decide(&aim, "cam", Some((&deneb, at(0.0))), at(5.0)), Ready::Wait);
        aim.set(AimState::Looking(deneb.clone()));
        assert_eq!(cam.decide(&aim, "cam", Some((&deneb, at(0.0))), at(64.0)), Ready::Look);
        assert_eq!(cam.decide(&aim, "cam", Some((&deneb, at(0.0))), at(65.0)), Ready::Record);
        // A telescope that stands elsewhere gives no frames of the target, however late it is; one that nobody waits for does, and dark frames are taken.
        aim.set(AimState::Standing);
        assert_eq!(cam.decide(&aim, "cam", Some((&deneb, at(0.0))), at(900.0)), Ready::Wait);
        assert_eq!(cam.decide(&aim, "cam", Some((&dark, at(0.0))), at(901.0)), Ready::Record);
        let unwaited = Aim::new(None, false, 60.0);
        unwaited.set(AimState::Standing);
        let mut eager = Waiting::default();
        assert_eq!(
            eager.decide(&unwaited, "cam", Some((&vega, at(0.0))), at(902.0)),
            Ready::Record
        );
        // A mount that is lost holds up nobody, and neither does one that nobody waits for.
        aim.set(AimState::Lost);
        assert_eq!(other.decide(&aim, "other", Some((&deneb, at(0.0))), at(6.0)), Ready::Record);
        let free = Aim::new(None, false, 60.0);
        let mut camera = Waiting::default();
        assert_eq!(camera.decide(&free, "cam", Some((&vega, at(0.0))), at(0.0)), Ready::Record);
    }
}
