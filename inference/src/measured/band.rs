//! Magnitudes of V among those of other filters.

use std::collections::BTreeMap;
use sunglint_calibration::field_stars::catalogue::band_letter;
use sunglint_radiometry::light_curve::published::Label;

/// Magnitudes without a filter that are given as V: AAVSO's `CV`, and the unfiltered light that surveys bring to V.
const AS_V: [&str; 8] = ["cv", "clear", "none", "no filter", "nofilter", "open", "c", ""];

/// The samples that count as magnitudes in V.
pub(crate) struct OfV {
    /// Whether each sample counts; empty where all do.
    pub used: Vec<bool>,
    /// The filters that do not, and the one that is taken for V, in words.
    pub note: Option<String>,
}

/// Tells which samples are of V: where some are, those of other filters do not count; where none is, all are taken as V, and the note says so.
pub(crate) fn of_v(labels: Option<&[Label]>) -> OfV {
    let mut others = BTreeMap::<&str, usize>::new();
    let labels = labels.unwrap_or_default();
    let is_v = |filter: &str| band_letter(filter) == Some("V");
    let is_like_v = |filter: &str| AS_V.contains(&filter.trim().to_ascii_lowercase().as_str());
    for label in labels.iter().filter(|l| !is_v(&l.filter) && !is_like_v(&l.filter)) {
        *others.entry(label.filter.as_str()).or_default() += 1;
    }
    if others.is_empty() {
        return OfV { used: Vec::new(), note: None };
    }
    let named: Vec<String> = others.iter().map(|(name, n)| format!("{n} of `{name}`")).collect();
    let (named, n) = (named.join(", "), others.values().sum::<usize>());
    if n == labels.len() {
        let note = format!("no magnitude is of V: they are taken as V all the same ({named})");
        return OfV { used: Vec::new(), note: Some(note) };
    }
    let used = labels.iter().map(|l| is_v(&l.filter) || is_like_v(&l.filter)).collect();
    OfV { used, note: Some(format!("samples of other filters than V are left out: {named}")) }
}
