//! ECSV: no panic, and what is read and written again reads the same.
#![no_main]

use libfuzzer_sys::fuzz_target;
use sunglint_formats::{CountSeries, ecsv};

fuzz_target!(|text: &str| {
    if let Ok(table) = ecsv::read_str("x", text) {
        let _ = CountSeries::from_table("x", &table);
        if let Ok(written) = ecsv::to_string(&table) {
            let again = ecsv::read_str("x", &written).expect("what we write, we read");
            // NaN is not equal to itself.
            assert_eq!(format!("{again:?}"), format!("{table:?}"));
        }
    }
});
