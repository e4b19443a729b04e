//! Elements: no panic; what is read starts SGP4 or says why not, a place that is found is finite, and what is written reads the same.

use sunglint_ephemeris::orbit::{TleOrbit, elements, tle};

pub fn run(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    let _ = tle::parse("x", &text);
    let (good, bad) = elements::parse_lenient("x", &text);
    assert!(!good.is_empty() || !bad.is_empty());
    for set in &good {
        assert!(set.mean_motion_rev_day > 0.0 && (0.0..1.0).contains(&set.eccentricity));
        if let Ok(orbit) = TleOrbit::new(set.clone()) {
            for minutes in [0.0, 10.0, 90.0, -1440.0, 1e6] {
                if let Ok(state) = orbit.teme_after(minutes) {
                    assert!(state.position_m.is_finite(), "{state:?}");
                }
            }
        }
        let again = elements::parse("again", &elements::text([set])).expect("what was written");
        assert_eq!(again[0].norad_id, set.norad_id);
        assert_eq!(again[0].epoch, set.epoch);
    }
}
