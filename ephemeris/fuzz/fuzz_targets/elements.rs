//! Elements in two lines and OMM in JSON, CSV, XML and KVN: no panic; what is read starts SGP4 or says why not, and is written so that it reads the same.
#![no_main]

use libfuzzer_sys::fuzz_target;
use sunglint_ephemeris::orbit::{TleOrbit, elements};

fuzz_target!(|text: &str| {
    let (good, bad) = elements::parse_lenient("x", text);
    assert!(!good.is_empty() || !bad.is_empty());
    for set in &good {
        assert!(set.mean_motion_rev_day > 0.0 && (0.0..1.0).contains(&set.eccentricity));
        if let Ok(orbit) = TleOrbit::new(set.clone()) {
            let _ = orbit.teme_after(10.0);
        }
        let again = elements::parse("again", &elements::text([set])).expect("what was written");
        assert_eq!(again[0].norad_id, set.norad_id);
        assert_eq!(again[0].epoch, set.epoch);
    }
});
