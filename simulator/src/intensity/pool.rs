//! Workers that are kept between calls.

use super::{Intensities, IntensityWorker};
use self_cell::self_cell;
use std::sync::{Arc, Mutex, PoisonError};

self_cell!(
    /// A worker with what it borrows from.
    struct Kept {
        owner: Arc<Intensities>,
        #[not_covariant]
        dependent: IntensityWorker,
    }
);

/// A prepared target that keeps its workers between calls, for programs that ask from many threads and for few aspects at once.
///
/// A worker's room grows with the body: to make it anew costs as much as the light of several aspects. There are as many workers as were ever wanted at the
/// same time. What a worker did before changes no bit of its results.
pub struct IntensityPool {
    all: Arc<Intensities>,
    free: Mutex<Vec<Kept>>,
}

/// A worker from a pool, which has it back in the end. One that was at work in a panic does not go back.
pub struct Held<'a> {
    pool: &'a IntensityPool,
    kept: Option<Kept>,
}

impl std::fmt::Debug for IntensityPool {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("IntensityPool").field("free", &self.free().len()).finish_non_exhaustive()
    }
}

impl IntensityPool {
    /// A pool without workers yet.
    pub fn new(all: Intensities) -> Self {
        Self { all: Arc::new(all), free: Mutex::default() }
    }

    /// The prepared target.
    pub fn all(&self) -> &Intensities {
        &self.all
    }

    fn free(&self) -> std::sync::MutexGuard<'_, Vec<Kept>> {
        // Pushing and popping leaves nothing half done.
        self.free.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes a worker for a while: a free one, or a new one.
    pub fn worker(&self) -> Held<'_> {
        let free = self.free().pop();
        let kept = free.unwrap_or_else(|| Kept::new(Arc::clone(&self.all), |all| all.worker()));
        Held { pool: self, kept: Some(kept) }
    }
}

impl Held<'_> {
    /// Does work with the worker.
    pub fn with<T>(&mut self, work: impl FnOnce(&mut IntensityWorker<'_>) -> T) -> T {
        let pool = self.pool;
        let make = || Kept::new(Arc::clone(&pool.all), |all| all.worker());
        self.kept.get_or_insert_with(make).with_dependent_mut(|_, worker| work(worker))
    }
}

impl Drop for Held<'_> {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            self.pool.free().extend(self.kept.take());
        }
    }
}
