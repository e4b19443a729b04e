//! ECSV: no panic, and what is read and written again reads the same.

use sunglint_formats::{CountSeries, ecsv};

/// Tries one input.
pub fn run(bytes: &[u8]) {
    let text = &*String::from_utf8_lossy(bytes);
    if let Ok(table) = ecsv::read_str("x", text) {
        let _ = CountSeries::from_table("x", &table);
        if let Ok(written) = ecsv::to_string(&table) {
            let again = ecsv::read_str("x", &written).expect("what we write, we read");
            // NaN is not equal to itself.
            assert_eq!(format!("{again:?}"), format!("{table:?}"));
        }
    }
}
