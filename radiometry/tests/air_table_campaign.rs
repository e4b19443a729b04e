//! A campaign: the error that a table of transmissions reports covers its true error, over random airs.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use sunglint_radiometry::air::{
    Aerosol, AerosolModel, Air, AirOptions, AirTable, Profile, Sampling, Zenith,
};
use sunglint_testkit::Campaign;

/// A station and an air as they might be, and some that hardly are.
fn random_air(random: &mut Xoshiro256PlusPlus) -> Air {
    let profile = Profile::named(Profile::NAMES[random.random_range(0..6)]).unwrap();
    let mut maybe = |low: f64, high: f64| {
        let value = random.random_range(low..high);
        random.random_bool(0.5).then_some(value)
    };
    let (ozone_du, water_mm, angstrom) = (maybe(0.0, 600.0), maybe(0.0, 60.0), maybe(0.0, 1.5));
    let altitude_m = maybe(-300.0, 6000.0).unwrap_or(400.0);
    let refraction = maybe(0.0, 1.0).is_none_or(|x| x < 0.7);
    let aerosol = match angstrom {
        Some(optical_depth) => Aerosol::Angstrom {
            optical_depth,
            wavelength_nm: 550.0,
            exponent: 1.3,
            scale_height_m: 1800.0,
        },
        None if random.random_bool(0.5) => {
            Aerosol::Model(AerosolModel::ALL[random.random_range(0..6)])
        }
        None => Aerosol::None,
    };
    let options = AirOptions {
        altitude_m,
        ozone_du,
        water_mm,
        aerosol,
        refraction,
        ..AirOptions::new(profile)
    };
    Air::new(&options).unwrap()
}

/// Truth: the exact path at angles of which the table knows nothing; the promise is that the largest difference stays below what the
/// table reports, and the tolerance is therefore 1.
#[test]
fn campaign_air_table() {
    let mut campaign = Campaign::start("air_table", 2000);
    let nm: Vec<f64> = (0..=94).map(|i| 300.0 + 10.0 * f64::from(i)).collect();
    let sampling = Sampling::means(&nm, 0.5).unwrap();
    let (mut largest_ratio, mut largest_error) = (0.0_f64, 0.0_f64);
    for seed in campaign.seeds() {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        let air = random_air(&mut random);
        let table = AirTable::new(&air, &sampling, AirTable::TOLERANCE).unwrap();
        for _ in 0..60 {
            // Denser towards the horizon, where it is hard.
            let apparent = 90.0 * (1.0 - random.random_range(0.0..1.0_f64).powi(3));
            let zenith = Zenith::Apparent(apparent);
            let (exact, ours) =
                (air.transmission(zenith, &sampling).unwrap(), table.transmission(zenith).unwrap());
            for (a, b) in ours.iter().zip(&exact) {
                largest_error = largest_error.max((a - b).abs());
                largest_ratio = largest_ratio.max((a - b).abs() / table.interpolation_error());
            }
        }
        assert!(
            largest_ratio <= 1.0,
            "seed {seed}: the error is {largest_ratio} times what the table reports"
        );
    }
    campaign.largest("largest_error", largest_error);
    campaign.largest("largest_error_over_reported", largest_ratio);
    campaign.finish();
}
