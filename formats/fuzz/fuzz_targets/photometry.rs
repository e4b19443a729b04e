//! Magnitudes of other programs: no panic; columns of one length, finite magnitudes.
#![no_main]

use libfuzzer_sys::fuzz_target;
use std::path::Path;
use sunglint_formats::photometry::{ColumnNames, Format, Source, column_times, open, read_str};
use sunglint_formats::text_table;

fuzz_target!(|text: &str| {
    if let Ok(Source::Table(_, table)) = open("x", text.as_bytes().to_vec())
        && let Ok(Some(found)) = column_times(Path::new("x"), &table, &ColumnNames::default())
    {
        assert_eq!(found.time.len(), table.rows());
    }
    for format in [Format::Mmt9, Format::Alcdef, Format::TdmKvn, Format::TdmXml] {
        if let Ok(read) = read_str("x", text, format) {
            let n = read.time.len();
            assert!(n > 0 && read.magnitude.len() == n);
            let all = [&read.standard, &read.sigma_mag, &read.range_km, &read.phase_deg, &read.exposure_s];
            assert!(all.iter().filter_map(|c| c.as_ref()).all(|c| c.len() == n));
            assert!([&read.session, &read.filter].iter().filter_map(|c| c.as_ref()).all(|c| c.len() == n));
        }
    }
    if let Ok(table) = text_table::read_str(Path::new("x"), text)
        && let Ok(Some(found)) = column_times(Path::new("x"), &table, &ColumnNames::default())
    {
        assert_eq!(found.time.len(), table.rows());
    }
});
