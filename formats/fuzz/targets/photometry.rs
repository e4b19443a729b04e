//! Magnitudes of other programs: no panic; columns of one length, finite magnitudes.

use std::path::Path;
use sunglint_formats::photometry::{
    ColumnNames, Format, ObjectRows, Photometry, Scale, Source, column_times, import, open,
    read_str,
};
use sunglint_formats::text_table;

/// Tries one input.
pub fn run(bytes: &[u8]) {
    let text = &*String::from_utf8_lossy(bytes);
    if let Ok(Source::Table(_, table)) = open("x", bytes.to_vec())
        && let Ok(Some(found)) = column_times(Path::new("x"), &table, &ColumnNames::default())
    {
        assert_eq!(found.time.len(), table.rows());
    }
    // The guess of what is which column.
    let mut names = ColumnNames::default();
    for rows in [ObjectRows::One, ObjectRows::All, ObjectRows::Of("a".into())] {
        let read = import("x", bytes.to_vec(), &names, &rows);
        // Most tables of others do not name the scale of their times.
        names.scale = Some(Scale::Utc);
        if let Ok(read) = read {
            whole(&read.samples);
            let mut taken = read.columns.iter().map(|(_, column)| column);
            assert!(taken.all(|column| !read.unused.contains(column)), "{read:?}");
        }
    }
    for format in [Format::Mmt9, Format::Alcdef, Format::TdmKvn, Format::TdmXml] {
        if let Ok(read) = read_str("x", text, format) {
            assert!(!read.time.is_empty());
            whole(&read);
        }
    }
    if let Ok(table) = text_table::read_str(Path::new("x"), text)
        && let Ok(Some(found)) = column_times(Path::new("x"), &table, &ColumnNames::default())
    {
        assert_eq!(found.time.len(), table.rows());
    }
}

/// Columns of one length.
fn whole(read: &Photometry) {
    let n = read.time.len();
    assert_eq!(read.magnitude.len(), n);
    let numbers =
        [&read.standard, &read.sigma_mag, &read.range_km, &read.phase_deg, &read.exposure_s];
    assert!(numbers.iter().filter_map(|c| c.as_ref()).all(|c| c.len() == n));
    let texts = [&read.session, &read.filter, &read.camera];
    assert!(texts.iter().filter_map(|c| c.as_ref()).all(|c| c.len() == n));
    assert!(read.eclipsed.as_ref().is_none_or(|c| c.len() == n));
}
