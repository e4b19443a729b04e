//! Magnitudes of other programs: no panic; columns of one length, finite magnitudes.

use std::path::Path;
use sunglint_formats::photometry::{ColumnNames, Format, Source, column_times, open, read_str};
use sunglint_formats::text_table;

/// Tries one input.
pub fn run(bytes: &[u8]) {
    let text = &*String::from_utf8_lossy(bytes);
    if let Ok(Source::Table(_, table)) = open("x", bytes.to_vec())
        && let Ok(Some(found)) = column_times(Path::new("x"), &table, &ColumnNames::default())
    {
        assert_eq!(found.time.len(), table.rows());
    }
    for format in [Format::Mmt9, Format::Alcdef, Format::TdmKvn, Format::TdmXml] {
        if let Ok(read) = read_str("x", text, format) {
            let n = read.time.len();
            assert!(n > 0 && read.magnitude.len() == n);
            let all = [
                &read.standard,
                &read.sigma_mag,
                &read.range_km,
                &read.phase_deg,
                &read.exposure_s,
            ];
            assert!(all.iter().filter_map(|c| c.as_ref()).all(|c| c.len() == n));
            assert!(
                [&read.session, &read.filter]
                    .iter()
                    .filter_map(|c| c.as_ref())
                    .all(|c| c.len() == n)
            );
        }
    }
    if let Ok(table) = text_table::read_str(Path::new("x"), text)
        && let Ok(Some(found)) = column_times(Path::new("x"), &table, &ColumnNames::default())
    {
        assert_eq!(found.time.len(), table.rows());
    }
}
