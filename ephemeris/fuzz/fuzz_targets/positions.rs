//! Tables of positions: CSV, ECSV, OEM in KVN and XML, CPF: no panic, and a state at each end.
#![no_main]

use libfuzzer_sys::fuzz_target;
use sunglint_ephemeris::orbit::Ephemeris;

fuzz_target!(|text: &str| {
    let _ = Ephemeris::is_one(text);
    if let Ok(table) = Ephemeris::parse("x", text) {
        let (first, last) = table.range();
        assert!(table.rows() >= 2);
        table.state(first).expect("the first row");
        table.state(last).expect("the last row");
    }
});
