//! Targets at a finite range through the air. (The ray itself is held against an independent integration beside its code.)

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use sunglint_radiometry::air::{
    Aerosol, AerosolModel, Air, AirError, AirOptions, AirTable, Profile, Sampling, Zenith,
};

fn air() -> Air {
    let mut options = AirOptions::new(Profile::named("midlatitude_summer").unwrap());
    options.altitude_m = 399.0;
    options.aerosol = Aerosol::Model(AerosolModel::Rural23Km);
    Air::new(&options).unwrap()
}

fn near(true_deg: f64, range_m: f64) -> Zenith {
    Zenith::Near { true_deg, range_m }
}

/// Truth: geometry. What the air shifts a ray sideways, n₀r₀ sin z − r₀ sin z∞, is 16 m at 70° and 2 km at the horizon; seen
/// over 1000 km that is 3″ at 70°, over 2000 km 3.5′ on the horizon (nearer there is only air), by which a satellite stands
/// nearer to its apparent place than a star. It falls as the range grows.
#[test]
fn a_satellite_is_lifted_less_than_a_star() {
    let air = air();
    let less_arcsec = |true_deg: f64, range_m: f64| {
        let star = air.path(Zenith::True(true_deg)).unwrap().apparent_deg;
        3600.0 * (air.path(near(true_deg, range_m)).unwrap().apparent_deg - star)
    };
    let at_70 = less_arcsec(70.0, 1e6);
    assert!((at_70 - 3.3).abs() < 0.4, "{at_70}″");
    let horizon = 3600.0
        * (air.horizon_deg() - {
            // The lowest near target that is seen: the message says where it is.
            let error = air.path(near(92.0, 2e6)).unwrap_err();
            match error {
                AirError::BelowHorizon { horizon_deg, .. } => horizon_deg,
                other => panic!("{other}"),
            }
        });
    assert!((horizon / 60.0 - 3.5).abs() < 0.5, "{horizon}″");
    // The shift is the same 16 m: at twice the range half the angle, at infinity none.
    assert!((less_arcsec(70.0, 2e6) / at_70 - 0.5).abs() < 0.01);
    assert!(less_arcsec(70.0, 1e15).abs() < 1e-6);
    assert!(less_arcsec(0.0, 1e6).abs() < 1e-9);
}

/// A satellite a quarter of a degree below the geometric horizon is seen, and one at half a degree is not, where a star still is.
#[test]
fn the_horizon_of_a_satellite_lies_between_that_of_no_air_and_that_of_a_star() {
    let air = air();
    let table = AirTable::new(&air, &Sampling::points(&[550.0]).unwrap(), 1e-6).unwrap();
    let seen = air.path(near(90.25, 2e6)).unwrap().apparent_deg;
    assert!((89.0..90.0).contains(&seen), "{seen}");
    let lost = air.horizon_deg() - 1e-3;
    assert!(air.path(Zenith::True(lost)).is_ok());
    for error in
        [air.path(near(lost, 2e6)).unwrap_err(), table.transmission(near(lost, 2e6)).unwrap_err()]
    {
        let AirError::BelowHorizon { kind, horizon_deg, .. } = error else { panic!("{error}") };
        assert_eq!(kind, "true");
        assert!((90.3..lost).contains(&horizon_deg), "{horizon_deg}");
    }
}

/// Truth: the exact calculation, itself held against LOWTRAN7. The table errs by what it reports (1e-6) for near targets too.
#[test]
fn the_table_agrees_for_near_targets() {
    let air = air();
    let sampling =
        Sampling::points(&[310.0, 350.0, 450.0, 550.0, 700.0, 761.0, 940.0, 1130.0]).unwrap();
    let table = AirTable::new(&air, &sampling, AirTable::TOLERANCE).unwrap();
    let mut worst = 0.0_f64;
    for range_m in [2.5e5, 6e5, 1e6, 2.2e6, 3.6e7, 4e8] {
        for step in 0..=1810 {
            let zenith = near(0.05 * f64::from(step), range_m);
            match (air.transmission(zenith, &sampling), table.transmission(zenith)) {
                (Ok(exact), Ok(ours)) => {
                    for (a, b) in exact.iter().zip(&ours) {
                        worst = worst.max((a - b).abs());
                    }
                }
                (Err(_), Err(_)) => {}
                (a, b) => panic!("{zenith:?}: {a:?}, {b:?}"),
            }
        }
    }
    println!("at most {worst:.1e}, reported {:.1e}", table.interpolation_error());
    assert!(worst <= table.interpolation_error());
}

/// Without refraction the straight line is the ray, whatever the range.
#[test]
fn without_refraction_near_is_true() {
    let mut options = AirOptions::new(Profile::named("us_standard").unwrap());
    options.refraction = false;
    let air = Air::new(&options).unwrap();
    for true_deg in [0.0, 1e-3, 30.0, 75.0, 89.9, 90.0] {
        let seen = air.path(near(true_deg, 1.3e6)).unwrap().apparent_deg;
        assert!((seen - true_deg).abs() < 1e-10, "{true_deg}: {seen}");
    }
}

#[test]
fn what_makes_no_sense_is_refused() {
    let air = air();
    let table = AirTable::new(&air, &Sampling::points(&[550.0]).unwrap(), 1e-4).unwrap();
    let both = |zenith| {
        let error = air.path(zenith).unwrap_err();
        assert_eq!(error.to_string(), table.transmission(zenith).unwrap_err().to_string());
        error.to_string()
    };
    let inside = both(near(30.0, 550.0));
    assert!(inside.contains("476 m above the station, inside the air"), "{inside}");
    assert!(inside.contains("is the range in metres?"), "{inside}");
    assert!(both(near(30.0, f64::NAN)).contains("range of NaN m"));
    assert!(both(near(30.0, -1e6)).contains("range of -1000000 m"));
    assert!(both(near(-0.1, 1e6)).contains("zenith angle of -0.1°"));
    assert!(both(near(f64::NAN, 1e6)).contains("zenith angle of NaN°"));
    assert!(both(near(120.0, 2e7)).contains("below the horizon"));
}
