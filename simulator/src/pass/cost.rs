//! Cost of a simulation.

use super::{Progress, Stage};
use std::sync::Mutex;
use std::time::Instant;

/// Cost of a simulation.
#[derive(Debug, Clone)]
pub struct Cost {
    /// Stages in their order, with the seconds that each took.
    pub stages: Vec<(Stage, f64)>,
    /// Seconds of all stages.
    pub total_s: f64,
    /// Epochs.
    pub epochs: usize,
    /// Threads.
    pub threads: usize,
}

/// Measures what each stage of a simulation costs.
#[derive(Debug)]
pub struct Stopwatch {
    stages: Mutex<Vec<(Stage, Instant)>>,
    epochs: usize,
}

impl Stopwatch {
    /// Starts a measurement of a simulation of so many epochs.
    pub fn new(epochs: usize) -> Self {
        Self { stages: Mutex::default(), epochs }
    }

    /// Takes note of where the simulation is.
    pub fn tell(&self, progress: Progress) {
        // A lock that a panicking thread left holds nothing that could be wrong.
        let mut stages = self.stages.lock().unwrap_or_else(|e| e.into_inner());
        if stages.last().is_none_or(|(stage, _)| *stage != progress.stage) {
            stages.push((progress.stage, Instant::now()));
        }
    }

    /// Returns the cost of the stages that have ended.
    pub fn cost(&self) -> Cost {
        let stages = self.stages.lock().unwrap_or_else(|e| e.into_inner());
        let seconds = |pair: &[(Stage, Instant)]| {
            (pair[0].0, pair[1].1.duration_since(pair[0].1).as_secs_f64())
        };
        let stages: Vec<(Stage, f64)> = stages.windows(2).map(seconds).collect();
        let total_s = stages.iter().map(|(_, s)| s).sum();
        Cost { stages, total_s, epochs: self.epochs, threads: rayon::current_num_threads() }
    }
}
