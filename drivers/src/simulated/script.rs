//! Faults of simulated devices that happen when they are told to.

use std::collections::{BTreeSet, HashMap};

/// One fault: what goes wrong at a command.
#[derive(Debug, Clone, PartialEq)]
pub struct Fault<K> {
    /// How the command begins (`$SP`, `MEAS:POW?`).
    pub on: String,
    /// At which of them, counted from 1; 0 is each.
    pub nth: u32,
    /// Kind of the fault.
    pub kind: K,
}

impl<K> Fault<K> {
    /// `kind` at the `nth` command that begins with `on`.
    pub fn new(on: &str, nth: u32, kind: K) -> Self {
        Self { on: on.to_owned(), nth, kind }
    }
}

/// Faults, and how often what they wait for has happened.
#[derive(Debug, Clone)]
pub struct Script<K> {
    faults: Vec<Fault<K>>,
    heard: HashMap<String, u32>,
}

impl<K> Default for Script<K> {
    fn default() -> Self {
        Self { faults: Vec::new(), heard: HashMap::new() }
    }
}

impl<K: Clone> Script<K> {
    /// These faults.
    pub fn new(faults: Vec<Fault<K>>) -> Self {
        Self { faults, heard: HashMap::new() }
    }

    /// Counts a command and gives what goes wrong with it.
    pub(super) fn at(&mut self, command: &str) -> Option<K> {
        let waiting = |fault: &&Fault<K>| command.starts_with(&fault.on);
        // Each beginning is counted once, however many faults wait for it.
        let counted: BTreeSet<&String> =
            self.faults.iter().filter(waiting).map(|fault| &fault.on).collect();
        for on in counted {
            *self.heard.entry(on.clone()).or_default() += 1;
        }
        let heard = |fault: &Fault<K>| self.heard.get(&fault.on).copied();
        let mut due = self.faults.iter().filter(waiting);
        let due = due.find(|fault| fault.nth == 0 || heard(fault) == Some(fault.nth))?;
        Some(due.kind.clone())
    }
}
