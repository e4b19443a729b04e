//! Laser ranges in the CRD format: no panic; no more lines than the text has; what is written reads the same.

use sunglint_formats::crd;

/// Tries one input.
pub fn run(bytes: &[u8]) {
    let text = &*String::from_utf8_lossy(bytes);
    let Ok(mut read) = crd::read_str("x", text) else { return };
    assert!(read.lines.len() <= text.lines().count());
    // A name of version 1 may hold blanks, and what it says of the Moon is said otherwise in version 2.
    if let Ok(written) = crd::to_string(&read)
        && read.version == 2
    {
        // Only one header may stand in a file that has one.
        let again = crd::read_str("x", &written).expect("it was written");
        read.version = 2;
        assert_eq!(again, read);
    }
}
