//! Lines to a simulated instrument that tests can look into while a driver has them.
#![allow(dead_code, clippy::unwrap_used, reason = "each test uses its part")]

use std::sync::{Arc, Mutex};
use sunglint_drivers::clock::Deadline;
use sunglint_drivers::scpi::Definition;
use sunglint_drivers::transport::{Bytes, TransportError};

/// A line that a driver and a test have.
#[derive(Debug)]
pub struct Shared<T>(pub Arc<Mutex<T>>);

impl<T> Clone for Shared<T> {
    fn clone(&self) -> Self {
        Self(Arc::clone(&self.0))
    }
}

impl<T> Shared<T> {
    pub fn new(line: T) -> Self {
        Self(Arc::new(Mutex::new(line)))
    }

    pub fn with<V>(&self, look: impl FnOnce(&mut T) -> V) -> V {
        look(&mut self.0.lock().unwrap())
    }
}

impl<T: Bytes> Bytes for Shared<T> {
    fn send(&mut self, bytes: &[u8], deadline: &Deadline) -> Result<(), TransportError> {
        self.with(|line| line.send(bytes, deadline))
    }

    fn receive(&mut self, buffer: &mut [u8], deadline: &Deadline) -> Result<usize, TransportError> {
        self.with(|line| line.receive(buffer, deadline))
    }

    fn discard(&mut self, deadline: &Deadline) -> Result<Vec<u8>, TransportError> {
        self.with(|line| line.discard(deadline))
    }

    fn reconnect(&mut self, deadline: &Deadline) -> Result<(), TransportError> {
        self.with(|line| line.reconnect(deadline))
    }
}

/// A template's definition.
pub fn template(name: &str) -> Definition {
    sunglint_drivers::scpi::definition(name).unwrap()
}
