//! PicoQuant files: no panic, bounded memory; as many records as the file says.

use sunglint_drivers::ptu::PtuFile;

/// Tries one input.
pub fn run(bytes: &[u8]) {
    let Ok(file) = PtuFile::from_bytes("x", bytes.to_vec()) else { return };
    assert!(file.len() <= bytes.len() as u64 / 4);
    assert!(file.records().take_while(Result::is_ok).count() as u64 <= file.len());
    let mut last = None;
    for tag in file.tags() {
        let Ok(tag) = tag else { break };
        last = Some(tag);
    }
    let _ = format!("{last:?} {:?}", file.record_type());
}
