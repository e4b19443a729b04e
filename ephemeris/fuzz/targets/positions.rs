//! Tables of positions: CSV, ECSV, OEM in KVN and XML, CPF: no panic, and a state at each end.

use sunglint_ephemeris::orbit::Ephemeris;

pub fn run(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    let _ = Ephemeris::is_one(&text);
    if let Ok(table) = Ephemeris::parse("x", &text) {
        let (first, last) = table.range();
        assert!(table.rows() >= 2);
        table.state(first).expect("the first row");
        table.state(last).expect("the last row");
    }
}
