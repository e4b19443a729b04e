//! Stars by name: what is found, what is refused and how.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use sunglint_formats::time::parse_utc;
use sunglint_radiometry::sky::{
    Catalogue, EarthOrientation, Equatorial, Geodetic, Observer, Site, Star, StarError, StarNote,
};

fn hip(asked: &str) -> Option<i64> {
    Catalogue::embedded().find(asked).unwrap_or_else(|error| panic!("{asked}: {error}")).hip
}

#[test]
fn a_star_is_found_by_every_name_it_has() {
    for asked in [
        "Vega",
        "vega",
        " VEGA ",
        "alp Lyr",
        "alpha Lyr",
        "Alpha lyr",
        "α Lyr",
        "HIP 91262",
        "HIP91262",
        "hip:91262",
        "HD 172167",
        "hd172167",
    ] {
        assert_eq!(hip(asked), Some(91262), "{asked}");
    }
    for asked in ["Rigil Kentaurus", " rigil  kentaurus ", "alp1 Cen", "α¹ Cen"] {
        assert_eq!(hip(asked), Some(71683), "{asked}");
    }
    assert_eq!(hip("gam Vel"), hip("gam2 Vel"), "the only gamma of Vela in the table");
    assert_eq!(hip("eps Ind"), Some(108870));
    // Truth: the IAU's list of star names. The table has `Shedar`, and gives the other two to two stars each.
    for (asked, bayer) in [("Schedar", "alp Cas"), ("menkar", "alp Cet"), ("Alnair", "alp Gru")] {
        assert_eq!(hip(asked), hip(bayer), "{asked}");
    }
    assert_ne!(hip("nu Pav"), hip("NU Pav"), "a Greek letter and a variable star");
    // The whole catalogue by each of its sure names.
    for star in Catalogue::embedded().stars() {
        if let Some(number) = star.hip {
            assert_eq!(hip(&format!("HIP {number}")), Some(number));
        }
        if let Some(bayer) = &star.bayer {
            assert_eq!(hip(bayer), star.hip, "{bayer}");
        }
    }
    assert_eq!(Catalogue::embedded().stars().len(), 1627);
}

#[test]
fn what_is_not_sure_is_refused_with_what_to_write() {
    let refused = |asked: &str| Catalogue::embedded().find(asked).unwrap_err();
    let message = refused("Vegga").to_string();
    assert!(message.contains("nearest: Vega") && message.contains("`HIP 91262`"), "{message}");
    let message = refused("alp Lyx").to_string();
    assert!(message.contains("alp Lyn") || message.contains("alp Lyr"), "{message}");
    let error = refused("HIP 91263");
    assert!(matches!(error, StarError::NotInCatalogue { .. }));
    let message = error.to_string();
    assert!(message.contains("V = 5") && message.contains("by hand"), "{message}");
    assert!(message.contains("HIP 91262"), "{message}");
    assert!(matches!(refused("HD 1"), StarError::NotInCatalogue { .. }));
    assert_eq!(
        refused("91262").to_string(),
        "`91262` is only a number: write `HIP 91262` or `HD 91262`"
    );
    let message = refused("Grafias").to_string();
    assert!(message.contains("zet2 Sco") && message.contains(" or "), "{message}");
    let message = refused("alp Cen").to_string();
    assert!(message.contains("alp1 Cen") && message.contains("alp2 Cen"), "{message}");
    for asked in ["", "  ", "?", "HIP", "\u{1F31F}"] {
        assert!(matches!(refused(asked), StarError::Unknown { .. }), "{asked:?}");
    }
}

/// Truth: the catalogue's own places. κ Cyg and δ Cyg were both called Fawaris; 0.05° is more than δ Cyg moved since 1000 and less than the 7° between them.
#[test]
fn a_place_says_which_star_of_a_name() {
    let catalogue = Catalogue::embedded();
    assert!(matches!(catalogue.find("Grafias"), Err(StarError::Ambiguous { .. })));
    for bayer in ["del Cyg", "kap Cyg"] {
        let star = catalogue.find(bayer).unwrap();
        let place = Equatorial { ra_deg: star.icrs.ra_deg, dec_deg: star.icrs.dec_deg - 0.05 };
        assert_eq!(catalogue.find_at("fawaris", place).unwrap(), star);
    }
    let elsewhere = Equatorial { ra_deg: 180.0, dec_deg: 0.0 };
    let error = catalogue.find_at("Vega", elsewhere).unwrap_err();
    let StarError::Elsewhere { off_deg, .. } = error else { panic!("{error}") };
    // Vega stands at 279.23°, +38.78°: cos of the angle is cos(38.78°) cos(99.23°).
    assert!((off_deg - 97.186).abs() < 0.002, "{off_deg}");
    assert!(error.to_string().contains("mend the name or the place"), "{error}");
}

#[test]
fn a_calibrator_hears_what_is_known_against_a_star() {
    let notes = |asked: &str| Catalogue::embedded().find(asked).unwrap().notes();
    assert_eq!(notes("Vega"), [StarNote::Variable]);
    assert_eq!(notes("Algol"), [StarNote::Variable, StarNote::Eclipsing]);
    assert_eq!(notes("Capella"), [StarNote::Double]);
    assert_eq!(notes("Sirius"), [StarNote::SpectroscopicBinary]);
    assert_eq!(
        notes("Deneb"),
        [StarNote::UnknownType, StarNote::NoProperMotion, StarNote::NoParallax]
    );
    assert_eq!(notes("Canopus"), []);
    let altair = Catalogue::embedded().find("Altair").unwrap();
    assert_eq!(altair.to_string(), "Altair (HIP 97649)");
    assert_eq!(altair.spectral_type.as_deref(), Some("A7V"));
    assert_eq!((altair.v_mag, altair.bv_mag, altair.ub_mag), (Some(0.76), Some(0.221), None));
}

/// By hand: the same star as the table's, from another epoch too. Moving Arcturus to 2016.0 by its proper motion by hand and
/// naming that epoch gives the same place to 0.003″ (the second order of 16 years of 2.3″: 36″² is 0.006″).
#[test]
fn a_star_by_hand_stands_where_the_table_puts_it() {
    let site = Geodetic { latitude_deg: -24.6272, longitude_deg: -70.4048, height_m: 2635.0 };
    let epoch = parse_utc("2026-03-14T04:20:30Z").unwrap();
    let observer =
        Observer::at(epoch, &Site::new(site).unwrap(), EarthOrientation::embedded()).unwrap();
    let arcturus = Catalogue::embedded().find("Arcturus").unwrap();
    let mut by_hand = Star::at("mine", arcturus.icrs).unwrap();
    assert_eq!(by_hand.notes().len(), 3);
    by_hand.pm_ra_mas_yr = arcturus.pm_ra_mas_yr;
    by_hand.pm_dec_mas_yr = arcturus.pm_dec_mas_yr;
    by_hand.parallax_mas = arcturus.parallax_mas;
    assert_eq!(observer.star(&by_hand), observer.star(arcturus));

    let years = 16.0;
    let Equatorial { ra_deg, dec_deg } = arcturus.icrs;
    let mas_deg = 1.0 / 3.6e6;
    by_hand.icrs = Equatorial {
        ra_deg: ra_deg
            + years * arcturus.pm_ra_mas_yr.unwrap() * mas_deg / dec_deg.to_radians().cos(),
        dec_deg: dec_deg + years * arcturus.pm_dec_mas_yr.unwrap() * mas_deg,
    };
    by_hand.epoch_year = 2000.0 + years;
    let moved = observer.star(&by_hand).horizontal;
    let error_arcsec = moved.separation_deg(observer.star(arcturus).horizontal) * 3600.0;
    assert!(error_arcsec < 0.003, "{error_arcsec}″");

    for (ra_deg, dec_deg) in [(0.0, 91.0), (400.0, 0.0), (f64::NAN, 0.0), (0.0, f64::NAN)] {
        let error = Star::at("nowhere", Equatorial { ra_deg, dec_deg }).unwrap_err();
        assert!(matches!(error, StarError::ImpossiblePlace { .. }));
    }
}
