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
    stages: Mutex<Stages>,
    epochs: usize,
}

#[derive(Debug, Default)]
struct Stages {
    /// Stages that have ended, with the seconds of all their parts.
    ended: Vec<(Stage, f64)>,
    now: Option<(Stage, Instant)>,
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
        let now = Instant::now();
        match stages.now {
            Some((stage, _)) if stage == progress.stage => return,
            Some((stage, since)) => {
                let seconds = now.duration_since(since).as_secs_f64();
                match stages.ended.iter_mut().find(|(ended, _)| *ended == stage) {
                    Some((_, sum)) => *sum += seconds,
                    None => stages.ended.push((stage, seconds)),
                }
            }
            None => {}
        }
        stages.now = Some((progress.stage, now));
    }

    /// Returns the cost of the stages that have ended. What the taker of pieces does with them is no part of it.
    pub fn cost(&self) -> Cost {
        let stages = self.stages.lock().unwrap_or_else(|e| e.into_inner());
        let own = stages.ended.iter().filter(|(stage, _)| *stage != Stage::Given);
        let stages: Vec<(Stage, f64)> = own.copied().collect();
        let total_s = stages.iter().map(|(_, s)| s).sum();
        Cost { stages, total_s, epochs: self.epochs, threads: rayon::current_num_threads() }
    }
}
