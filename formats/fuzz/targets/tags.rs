//! Raw time tags: no panic; the bins hold no more events than there are records.

use sunglint_formats::tags::{Binning, RECORD_BYTES, Tag, Tags};

/// Tries one input.
pub fn run(bytes: &[u8]) {
    let records = bytes.as_chunks::<RECORD_BYTES>().0;
    for record in records {
        let tag = Tag::from_bytes(record);
        let _ = (tag.to_bytes(), format!("{tag:?}"));
    }
    let whole = &bytes[..records.len() * RECORD_BYTES];
    let Ok(tags) = Tags::new(whole) else { return };
    for (width_ps, from_ps, to_ps) in
        [(1_000, 0, 1_000_000), (1 << 40, -(1 << 50), 1 << 50), (7, -700, 700)]
    {
        if let Ok(binning) = Binning::new(&[1, -2, 3], width_ps, from_ps, to_ps) {
            let _ = tags.bin(&binning);
        }
    }
}
