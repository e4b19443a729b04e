//! Where a stream of time tags goes.

use crate::tags::RECORD_BYTES;
use std::fmt;

/// Takes the records of a stream (see [`tags`](crate::tags)) as they come. It is called on the device's thread and must not wait.
pub struct TagSink(Box<dyn FnMut(Vec<[u8; RECORD_BYTES]>) + Send>);

impl TagSink {
    /// Makes a sink that calls `take` with each block of records.
    pub fn new(take: impl FnMut(Vec<[u8; RECORD_BYTES]>) + Send + 'static) -> Self {
        Self(Box::new(take))
    }

    /// Hands over records.
    pub fn take(&mut self, records: Vec<[u8; RECORD_BYTES]>) {
        if !records.is_empty() {
            (self.0)(records);
        }
    }
}

impl fmt::Debug for TagSink {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("TagSink")
    }
}
