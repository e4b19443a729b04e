//! Orders of a person to a tracker while it follows.

use glam::DVec2;
use hifitime::Epoch;
use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Orders that wait at most.
const MOST: usize = 16;

/// Order to a tracker. Offsets on the sky are in arcsec along the growing axes of the mount.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Order {
    /// A light of the finder's frame with this middle of the exposure, at this offset from the finder's middle, is the target.
    Lock {
        /// Middle of the frame's exposure.
        middle: Epoch,
        /// Offset of the light.
        offset_arcsec: DVec2,
    },
    /// The target is kept at this offset from the finder's middle from now on, in later visits, too.
    Keep {
        /// Offset of the target.
        offset_arcsec: DVec2,
    },
    /// The telescope looks by so much beside where it looks now: at a target that is followed by its light the light is kept elsewhere in the frame; without light
    /// the target is believed to be there.
    Jog {
        /// Way on the sky.
        arcsec: DVec2,
    },
}

#[derive(Debug, Default)]
struct Inner {
    waiting: VecDeque<Order>,
    refused: Vec<String>,
    keep_arcsec: DVec2,
}

/// Orders on their way to a tracker, and what became of them.
#[derive(Debug, Default)]
pub struct Orders {
    inner: Mutex<Inner>,
}

impl Orders {
    fn inner(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Hands one over; false where too many wait.
    #[must_use]
    pub fn give(&self, order: Order) -> bool {
        let mut inner = self.inner();
        let room = inner.waiting.len() < MOST;
        if room {
            inner.waiting.push_back(order);
        }
        room
    }

    /// Where the target is kept from the finder's middle, arcsec.
    pub fn keep_arcsec(&self) -> DVec2 {
        self.inner().keep_arcsec
    }

    /// Why orders were not followed, since this was asked last.
    pub fn refusals(&self) -> Vec<String> {
        std::mem::take(&mut self.inner().refused)
    }

    /// Forgets what waits: it was about another target.
    pub fn clear(&self) {
        self.inner().waiting.clear();
    }

    pub(super) fn next(&self) -> Option<Order> {
        self.inner().waiting.pop_front()
    }

    pub(super) fn keep(&self, offset_arcsec: DVec2) {
        self.inner().keep_arcsec = offset_arcsec;
    }

    pub(super) fn refuse(&self, why: String) {
        self.inner().refused.push(why);
    }
}
