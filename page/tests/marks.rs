//! Marks on a frame, asked of the source as the page asks, and held against the light that was put in.

use crate::rework::{frame_of, session_with};
use serde_json::Value;
use sunglint_page::{Recording, Request, Source as _};

/// Light of a frame above its sky, ADU at a column and row: two points 4 px wide, a streak as wide from the left to the right, a hot pixel.
fn light(column: f64, row: f64) -> f64 {
    let normal = |r2: f64| (-4.0 * 2_f64.ln() * r2 / 16.0).exp();
    let point = |x: f64, y: f64| normal((column - x).powi(2) + (row - y).powi(2));
    // Its ends are 20 px from the edges.
    let beyond = (20.0 - column).max(column - 100.0).max(0.0);
    let streak = normal((row - 95.0 - 0.1 * (column - 60.0)).powi(2) / 1.01 + beyond * beyond);
    let hot = if (column, row) == (30.0, 20.0) { 20_000.0 } else { 0.0 };
    8000.0 * point(62.0, 58.0) + 5000.0 * point(25.0, 45.0) + 3000.0 * streak + hot
}

/// Truth: what was put into the frame (synthetic): two points at their places to 0.2 px, one streak through its middle to 3 px and along its direction to 5°, one hot pixel, and nothing else; the half-flux
/// radius of a normal profile, σ √(π/2) = 0.532 widths, to 5 % (its aperture ends somewhere); the frame's middle is where the target is expected. Without the wish no source is told.
#[test]
fn all_sources_are_told_where_somebody_asks() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("night");
    session_with(&root, 1, &|number| frame_of(number, &light));
    let recording = Recording::open(&root).unwrap();
    let marks = |query: &str| -> Value {
        let request = Request::new(false, "marks/cam/0", query, Vec::new()).unwrap();
        let answer = recording.answer(&request);
        assert_eq!(answer.status, 200, "{}", String::from_utf8_lossy(&answer.body));
        serde_json::from_slice(&answer.body).unwrap()
    };
    let usual = marks("");
    assert!(usual["sources"].is_null());
    assert_eq!(usual["expected_px"], serde_json::json!([59.5, 59.5]));
    let all = marks("sources=1");
    assert_eq!(all["place_px"], usual["place_px"]);
    let sources = all["sources"].as_array().unwrap();
    let of = |kind: &str| -> Vec<[f64; 4]> {
        let of_it = sources.iter().filter(|source| source["kind"] == kind);
        let numbers = |source: &Value| {
            let [x, y] = [0, 1].map(|i| source["place_px"][i].as_f64().unwrap());
            let [dx, dy] = [0, 1].map(|i| source["trail_px"][i].as_f64().unwrap());
            [x, y, dx, dy]
        };
        of_it.map(numbers).collect()
    };
    let (points, streaks, sharp) = (of("point"), of("streak"), of("sharp"));
    assert_eq!([points.len(), streaks.len(), sharp.len(), sources.len()], [2, 1, 1, 4], "{all}");
    for truth in [[62.0, 58.0], [25.0, 45.0]] {
        let near = |p: &[f64; 4]| (p[0] - truth[0]).hypot(p[1] - truth[1]) < 0.2;
        assert!(points.iter().any(near), "{points:?}");
    }
    let [x, y, dx, dy] = streaks[0];
    assert!((y - 95.0 - 0.1 * (x - 60.0)).abs() < 3.0, "{streaks:?}");
    assert!((dy.atan2(dx).to_degrees() - 0.1_f64.atan().to_degrees()).abs() < 5.0, "{streaks:?}");
    assert_eq!(sharp[0][..2], [30.0, 20.0]);
    let radius = all["hfr_px"].as_f64().unwrap();
    let sigma = 4.0 / (8.0 * 2_f64.ln()).sqrt();
    let truth = sigma * std::f64::consts::FRAC_PI_2.sqrt();
    assert!((radius / truth - 1.0).abs() < 0.05, "{radius} for {truth}");
}
