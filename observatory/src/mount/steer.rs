//! Steering by hand: from clicks on a frame to orders for the tracker, and whether the mount is to follow at all.

use super::sights::Sights;
use crate::telescope::{Order, Orders};
use glam::DVec2;
use hifitime::Epoch;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// A person's wish for the mount.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Want {
    /// It follows the plan.
    #[default]
    Follow,
    /// It stands where it is.
    Stand,
    /// It is parked, and stays so.
    Park,
}

/// A person's hand on the mount of a night.
#[derive(Debug)]
pub struct Steering {
    /// Orders for the tracker.
    pub orders: Orders,
    camera: Option<String>,
    sights: Option<Arc<Sights>>,
    want: Mutex<Want>,
    again: AtomicBool,
    follows: AtomicBool,
}

impl Steering {
    /// For a mount whose camera gives these sights.
    pub fn new(camera: Option<String>, sights: Option<Arc<Sights>>) -> Self {
        let [again, follows] = [(); 2].map(|()| AtomicBool::new(false));
        let (orders, want) = (Orders::default(), Mutex::default());
        Self { orders, camera, sights, want, again, follows }
    }

    /// The wish as it stands.
    pub fn want(&self) -> Want {
        *self.want.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Wants something else.
    pub fn set_want(&self, want: Want) {
        *self.want.lock().unwrap_or_else(PoisonError::into_inner) = want;
    }

    /// Lets it follow again, also a visit in which somebody else had stopped it.
    pub fn follow(&self) {
        self.set_want(Want::Follow);
        self.again.store(true, Ordering::SeqCst);
    }

    /// Whether it was told to follow again since this was asked last.
    pub(super) fn takes_again(&self) -> bool {
        self.again.swap(false, Ordering::SeqCst)
    }

    /// Whether it follows a target now.
    pub(super) fn set_following(&self, follows: bool) {
        self.follows.store(follows, Ordering::SeqCst);
    }

    /// Middle of the exposure of the frame that began at a time, and the offset of a place in it from where targets are kept, arcsec along the growing axes. The
    /// place counts in pixels of the frame, the first pixel's middle is 0, 0.
    ///
    /// # Errors
    /// In words: another camera, a frame that is too old, a place outside.
    pub fn place(
        &self,
        camera: &str,
        start: Epoch,
        place_px: DVec2,
    ) -> Result<(Epoch, DVec2), String> {
        let Some(sights) = &self.sights else {
            return Err(
                "the plan's [mount] names no camera: pixels are no places on the sky".into()
            );
        };
        match self.camera.as_deref() {
            Some(own) if own != camera => {
                Err(format!("the mount looks through camera {own}: click on its frames"))
            }
            _ => sights.place(start, place_px),
        }
    }

    /// A way in the frames of the mount's camera, to the right and up, arcsec, along the growing axes; without a camera the axes themselves.
    pub fn along_axes(&self, way_arcsec: DVec2) -> DVec2 {
        self.sights.as_ref().map_or(way_arcsec, |sights| sights.view().along_axes(way_arcsec))
    }

    /// Hands an order over.
    ///
    /// # Errors
    /// Too many wait, or the mount does not follow.
    pub fn order(&self, order: Order) -> Result<(), String> {
        if self.want() != Want::Follow {
            return Err("the mount was told to stand: let it follow first".into());
        }
        if !self.follows.load(Ordering::SeqCst) {
            return Err("the mount follows no target at the moment".into());
        }
        match self.orders.give(order) {
            true => Ok(()),
            false => Err("too many orders wait: try again".into()),
        }
    }
}
