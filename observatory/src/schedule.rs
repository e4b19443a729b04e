//! Where the telescope looks, as a function of time: nothing waits for it.

use hifitime::Epoch;
use std::cmp::Ordering;
use sunglint_formats::FileError;
use sunglint_formats::session::{Session, Target, TargetKind, What};

/// A stay at a target, or none.
#[derive(Debug, Clone, PartialEq)]
pub struct Slot {
    /// The target.
    pub target: Target,
    /// When it begins.
    pub from: Epoch,
    /// When it ends; `None`: with the night.
    pub to: Option<Epoch>,
}

/// The targets of a night, in time.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Schedule {
    slots: Vec<Slot>,
}

impl Schedule {
    /// The stays in time; between them, and behind the last, there is no target.
    pub fn new(visits: Vec<Slot>) -> Self {
        let mut slots: Vec<Slot> = Vec::new();
        let none = |from, to| Slot { target: Target::off(TargetKind::None), from, to };
        for visit in visits {
            if let Some(gap) = slots.last().and_then(|last| last.to).filter(|to| *to < visit.from) {
                slots.push(none(gap, Some(visit.from)));
            }
            slots.push(visit);
        }
        if let Some(end) = slots.last().and_then(|last| last.to) {
            slots.push(none(end, None));
        }
        Self { slots }
    }

    /// The schedule of a session: what its log says.
    ///
    /// # Errors
    /// The errors of [`Session::events`].
    pub fn of_session(session: &Session) -> Result<Self, FileError> {
        let mut slots: Vec<Slot> = Vec::new();
        for event in session.events()? {
            let event = event?;
            if let What::Target(target) = event.what {
                if let Some(last) = slots.last_mut() {
                    last.to = Some(event.utc);
                }
                slots.push(Slot { target, from: event.utc, to: None });
            }
        }
        Ok(Self { slots })
    }

    /// The target at a time; none before the first.
    pub fn at(&self, utc: Epoch) -> Option<&Target> {
        let next = self.slots.partition_point(|slot| slot.from.cmp(&utc) != Ordering::Greater);
        self.slots[..next].last().map(|slot| &slot.target)
    }

    /// The slots, in time.
    pub fn slots(&self) -> &[Slot] {
        &self.slots
    }
}
