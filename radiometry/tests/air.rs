//! The air against published values, closed forms and its own limits.

#![expect(clippy::unwrap_used, reason = "helpers of tests are tests")]

use proptest::prelude::*;
use sunglint_formats::{Column, Table};
use sunglint_radiometry::air::{
    Aerosol, AerosolModel, Air, AirError, AirOptions, AirTable, Profile, Sampling, Zenith,
};

fn us_standard() -> AirOptions {
    AirOptions::new(Profile::named("us_standard").unwrap())
}

fn visible() -> Sampling {
    Sampling::points(&[300.0, 320.0, 400.0, 550.0, 605.0, 688.0, 761.0, 940.0, 1130.0, 1205.0])
        .unwrap()
}

/// Truth: columns of the AFGL atmospheres from 0 to 120 km as published with the tables (ozone in DU, water in g/cm²). They are
/// sums of trapezia, which the test repeats: so the profile is read right. The air integrates exponentials between the
/// levels (as LOWTRAN7 does), which lie below the trapezia where the profile is hollow: up to 0.7 % of ozone and 2 % of water.
#[test]
fn columns_of_the_standard_atmospheres() {
    for (name, ozone_du, water_g_cm2) in [
        ("tropical", 283.7, 4.20),
        ("midlatitude_summer", 335.7, 2.98),
        ("midlatitude_winter", 379.8, 0.865),
        ("subarctic_summer", 349.0, 2.12),
        ("subarctic_winter", 377.1, 0.421),
        ("us_standard", 345.7, 1.44),
    ] {
        let profile = Profile::named(name).unwrap();
        let (mut ozone, mut water) = (0.0, 0.0);
        for l in profile.levels().windows(2) {
            let cm = 1e5 * (l[1].altitude_km - l[0].altitude_km);
            ozone += 0.5 * (l[0].ozone_cm3 + l[1].ozone_cm3) * cm / 2.6868e16;
            water += 0.5 * (l[0].water_cm3 + l[1].water_cm3) * cm * 18.015 / 6.022e23;
        }
        let columns = Air::new(&AirOptions::new(profile)).unwrap().columns();
        println!(
            "{name}: {ozone:.2} {:.2} DU, {water:.4} {:.4} g/cm2",
            columns.ozone_du,
            0.1 * columns.water_mm
        );
        assert!((ozone / ozone_du - 1.0).abs() < 3e-3, "{name}: {ozone} DU");
        assert!((water / water_g_cm2 - 1.0).abs() < 3e-3, "{name}: {water} g/cm²");
        assert!((-7e-3..1e-3).contains(&(columns.ozone_du / ozone - 1.0)), "{name}: {columns:?}");
        assert!(
            (-2e-2..1e-3).contains(&(0.1 * columns.water_mm / water - 1.0)),
            "{name}: {columns:?}"
        );
    }
    let options =
        AirOptions { altitude_m: 399.0, ..AirOptions::new(Profile::midlatitude_winter()) };
    let columns = Air::new(&options).unwrap().columns();
    assert!((columns.ozone_du - 376.9).abs() < 1.5, "{columns:?}");
    assert!((columns.water_mm - 7.22).abs() < 0.05, "{columns:?}");
    assert!((columns.air_cm2 / 2.0593e25 - 1.0).abs() < 1e-3, "{columns:?}");
    // LOWTRAN7's pressure at the station, which it interpolates through four levels.
    assert!((columns.pressure_hpa - 968.173).abs() < 0.2, "{columns:?}");
}

/// Truth: SOFA's refco (A tan z + B tan³ z, good to 0.05″ below 70° of zenith angle for a standard lapse rate), through sofars.
#[test]
fn refraction_is_sofas_down_to_seventy_degrees() {
    let options = us_standard();
    let level = options.profile.levels()[0];
    let vapour = level.water_cm3 / level.air_cm3 * level.pressure_hpa;
    // Saturation pressure as refco itself takes it (Gill 1982), to hand it the profile's own vapour.
    let celsius = level.temperature_k - 273.15;
    let saturation = 10_f64.powf((0.7859 + 0.03477 * celsius) / (1.0 + 0.00412 * celsius))
        * (1.0 + level.pressure_hpa * (4.5e-6 + 6e-10 * celsius * celsius));
    let (a, b) = sofars::astro::refco(level.pressure_hpa, celsius, vapour / saturation, 0.55);
    let air = Air::new(&options).unwrap();
    for z in [10.0_f64, 30.0, 45.0, 60.0, 70.0] {
        let path = air.path(Zenith::Apparent(z)).unwrap();
        let tan = z.to_radians().tan();
        let truth = (a * tan + b * tan.powi(3)).to_degrees() * 3600.0;
        let ours = path.refraction_arcsec();
        assert!((ours - truth).abs() < 0.3, "{z}°: {ours:.3}″ against {truth:.3}″");
    }
}

/// Truth: Bennett 1982 (J. Navigation 35, 255): R = cot(h + 7.31/(h + 4.4)) arcminutes at 1010 hPa and 10 °C, scaled by pressure over
/// temperature; 0.07′ by his account, for a wavelength and humidity that he does not name. The horizon depends on the lapse near the
/// ground: within 2′.
#[test]
fn refraction_is_bennetts_down_to_the_horizon() {
    let air = Air::new(&us_standard()).unwrap();
    let columns = air.columns();
    let scale = columns.pressure_hpa / 1010.0 * 283.15 / columns.temperature_k;
    for (h, within) in [(30.0_f64, 0.05), (10.0, 0.1), (5.0, 0.12), (2.0, 0.3), (0.0, 2.0)] {
        let truth = scale / (h + 7.31 / (h + 4.4)).to_radians().tan();
        let ours = air.path(Zenith::Apparent(90.0 - h)).unwrap().refraction_arcsec() / 60.0;
        assert!((ours - truth).abs() < within, "{h}°: {ours:.3}′ against {truth:.3}′");
    }
    assert!((air.horizon_deg() - 90.0) * 60.0 > 32.0);
}

/// Truth: the published relative air mass on the horizon of the US standard atmosphere (Kasten and Young 1989: 38.09). Warm
/// moist air has less; the arctic winter, with cold air under an inversion, more.
#[test]
fn forty_atmospheres_lie_on_the_horizon() {
    for name in Profile::NAMES {
        let air = Air::new(&AirOptions::new(Profile::named(name).unwrap())).unwrap();
        let mass = air.air_masses(&air.path(Zenith::Apparent(90.0)).unwrap());
        let range = if name == "us_standard" { 37.5..39.0 } else { 36.0..42.0 };
        assert!(range.contains(&mass.rayleigh), "{name}: {mass:?}");
        assert!(mass.water > mass.rayleigh && mass.ozone < 20.0, "{name}: {mass:?}");
    }
}

/// Truth: Kasten and Young 1989 (Appl. Opt. 28, 4735): 1/(cos z + 0.50572 (96.07995 − z)^−1.6364), from 0 to 85° within 0.3 %.
#[test]
fn air_mass_is_kasten_and_youngs() {
    let air = Air::new(&us_standard()).unwrap();
    for z in [0.0_f64, 30.0, 60.0, 75.0, 85.0] {
        let truth = 1.0 / (z.to_radians().cos() + 0.50572 * (96.07995 - z).powf(-1.6364));
        let ours = air.air_masses(&air.path(Zenith::Apparent(z)).unwrap()).rayleigh;
        assert!((ours / truth - 1.0).abs() < 3e-3, "{z}°: {ours} against {truth}");
    }
}

/// Truth: without refraction, plane-parallel layers: sec z, from which a sphere departs by (h/R) tan² z with h < 25 km.
#[test]
fn without_refraction_small_angles_have_the_secant() {
    let air = Air::new(&AirOptions { refraction: false, ..us_standard() }).unwrap();
    for z in [0.0_f64, 1.0, 10.0, 20.0] {
        let path = air.path(Zenith::Apparent(z)).unwrap();
        assert_eq!(path.true_deg, z);
        let mass = air.air_masses(&path);
        let (secant, tan) = (1.0 / z.to_radians().cos(), z.to_radians().tan());
        for m in [mass.rayleigh, mass.ozone, mass.water] {
            assert!((m / secant - 1.0).abs() < 25.0 / 6371.0 * tan * tan + 1e-9, "{z}°: {m}");
        }
    }
    assert_eq!(air.horizon_deg(), 90.0);
}

/// Truth: Beer and Lambert. Twice the pressure at an unchanged temperature is twice the Rayleigh optical depth; the column of
/// ozone enters its optical depth in proportion; water's bands do not.
#[test]
fn columns_scale_what_they_should() {
    // Native points, where nothing is interpolated.
    let nm = Sampling::points(&[25_000.0, 16_530.0, 10_640.0].map(|v| 1e7 / v)).unwrap();
    let z = Zenith::Apparent(30.0);
    let depth = |options: &AirOptions| {
        let c = Air::new(options).unwrap().components(z, &nm).unwrap();
        (-c.rayleigh[0].ln(), -c.ozone[1].ln(), -c.water_lines[2].ln())
    };
    let straight = AirOptions { refraction: false, ..us_standard() };
    let base = depth(&straight);
    let half = depth(&AirOptions { pressure_hpa: Some(1013.0 / 2.0), ..straight.clone() });
    assert!((base.0 / half.0 - 2.0).abs() < 1e-9);
    assert!((base.1 / half.1 - 1.0).abs() < 1e-9);
    let ozone = |du| depth(&AirOptions { ozone_du: Some(du), ..straight.clone() }).1;
    assert!((ozone(400.0) / ozone(200.0) - 2.0).abs() < 1e-9);
    let water = |mm| depth(&AirOptions { water_mm: Some(mm), ..straight.clone() }).2;
    // The exponent of the region 9620–11540 cm⁻¹.
    assert!((water(20.0) / water(10.0) - 2_f64.powf(0.5621)).abs() < 1e-9);
    let columns = Air::new(&AirOptions {
        ozone_du: Some(250.0),
        water_mm: Some(7.5),
        pressure_hpa: Some(900.0),
        ..us_standard()
    })
    .unwrap()
    .columns();
    assert!((columns.ozone_du - 250.0).abs() < 1e-9 && (columns.water_mm - 7.5).abs() < 1e-9);
    assert_eq!(columns.pressure_hpa, 900.0);
}

/// Truth: none of a gas takes nothing.
#[test]
fn without_a_gas_its_component_is_one() {
    let options = AirOptions {
        ozone_du: Some(0.0),
        water_mm: Some(0.0),
        co2_ppm: Some(0.0),
        ..us_standard()
    };
    let air = Air::new(&options).unwrap();
    for z in [0.0, 80.0, 90.0] {
        let c = air.components(Zenith::Apparent(z), &visible()).unwrap();
        for gone in [&c.ozone, &c.water_lines, &c.water_continuum, &c.carbon_dioxide, &c.aerosol] {
            assert!(gone.iter().all(|t| (*t - 1.0).abs() < 1e-15), "{z}°: {gone:?}");
        }
        assert!(c.oxygen.iter().any(|t| *t < 1.0) && c.rayleigh.iter().all(|t| *t < 1.0));
    }
}

/// Truth: the definition of a mean, by 20 000 points per bin.
#[test]
fn a_bin_is_the_mean_of_its_points() {
    let air = Air::new(&us_standard()).unwrap();
    let z = Zenith::Apparent(70.0);
    let edges = [305.0, 306.0, 684.0, 764.5, 764.51, 1229.0];
    let bins = air.transmission(z, &Sampling::bins(&edges).unwrap()).unwrap();
    for (edge, bin) in edges.windows(2).zip(&bins) {
        let n = 20_000;
        let nm: Vec<f64> = (0..n)
            .map(|i| edge[0] + (f64::from(i) + 0.5) / f64::from(n) * (edge[1] - edge[0]))
            .collect();
        let points = air.transmission(z, &Sampling::points(&nm).unwrap()).unwrap();
        let mean = points.iter().sum::<f64>() / f64::from(n);
        assert!((mean - bin).abs() < 1e-6, "{edge:?}: {bin} against {mean}");
    }
}

/// Truth: the definition of the products: a component's point value multiplies to the total at a native point (1e7/v nm).
#[test]
fn at_a_point_the_total_is_the_product() {
    let aerosol = Aerosol::Model(AerosolModel::Maritime23Km);
    let air = Air::new(&AirOptions { aerosol, ..us_standard() }).unwrap();
    let nm: Vec<f64> =
        [32_000.0, 20_000.0, 13_120.0, 10_640.0, 8_300.0].iter().map(|v| 1e7 / v).collect();
    let c = air.components(Zenith::Apparent(65.0), &Sampling::points(&nm).unwrap()).unwrap();
    for j in 0..nm.len() {
        let product: f64 = c.iter().skip(1).map(|(_, t)| t[j]).product();
        assert!((product - c.total[j]).abs() < 1e-12, "{} nm", nm[j]);
    }
}

/// Truth: the exact calculation, at angles between the nodes; every error stays below what the table reports.
#[test]
fn the_table_keeps_the_error_that_it_reports() {
    let stations = [
        us_standard(),
        AirOptions { altitude_m: 5_600.0, ..AirOptions::new(Profile::named("tropical").unwrap()) },
        AirOptions {
            aerosol: Aerosol::Model(AerosolModel::Rural5Km),
            refraction: false,
            ..AirOptions::new(Profile::named("subarctic_summer").unwrap())
        },
    ];
    let nm: Vec<f64> = (0..=470).map(|i| 300.0 + 2.0 * f64::from(i)).collect();
    for sampling in [Sampling::means(&nm, 0.5).unwrap(), Sampling::points(&nm).unwrap()] {
        for (options, tolerance) in stations.iter().zip([1e-6, 1e-4, 1e-8]) {
            let air = Air::new(options).unwrap();
            let table = AirTable::new(&air, &sampling, tolerance).unwrap();
            assert!(table.interpolation_error() <= tolerance);
            let mut worst = 0.0_f64;
            // Multiples of the golden ratio: never the table's own places, denser towards the horizon.
            for i in 0..400 {
                let u = (f64::from(i) * 0.618_033_988_75).fract();
                let apparent = 90.0 * (1.0 - (1.0 - u).powi(3));
                for zenith in [Zenith::Apparent(apparent), Zenith::True(apparent)] {
                    let exact = air.transmission(zenith, &sampling).unwrap();
                    let ours = table.transmission(zenith).unwrap();
                    for (a, b) in ours.iter().zip(&exact) {
                        worst = worst.max((a - b).abs());
                    }
                }
            }
            println!(
                "{} nodes, reported {:.2e}, found {worst:.2e}",
                table.nodes(),
                table.interpolation_error()
            );
            assert!(worst <= table.interpolation_error(), "{worst:e}");
        }
    }
}

#[test]
fn the_table_answers_many_angles_as_it_answers_one() {
    let air = Air::new(&us_standard()).unwrap();
    let table = AirTable::new(&air, &visible(), 1e-6).unwrap();
    let zeniths =
        [Zenith::True(90.5), Zenith::Apparent(0.0), Zenith::Apparent(90.0), Zenith::True(45.0)];
    let all = table.transmissions(&zeniths).unwrap();
    let mut flat = vec![0.0; zeniths.len() * table.wavelength_nm().len()];
    table.transmissions_into(&zeniths, &mut flat).unwrap();
    assert_eq!(all.as_slice().unwrap(), flat.as_slice());
    for (zenith, row) in zeniths.iter().zip(all.rows()) {
        assert_eq!(row.to_vec(), table.transmission(*zenith).unwrap());
    }
    let error = table.transmissions_into(&zeniths, &mut flat[1..]).unwrap_err();
    assert!(matches!(error, AirError::OutputLength { found: 39, expected: 40 }), "{error}");
    assert!(matches!(AirTable::new(&air, &visible(), 1e-18), Err(AirError::Tolerance { .. })));
    assert!(matches!(AirTable::new(&air, &visible(), 0.0), Err(AirError::Option { .. })));
}

/// Deep ultraviolet at the horizon: an optical depth of hundreds is a transmission of nothing, not NaN.
#[test]
fn what_is_opaque_is_zero() {
    let options = AirOptions {
        ozone_du: Some(1500.0),
        aerosol: Aerosol::Model(AerosolModel::Rural5Km),
        ..AirOptions::new(Profile::named("tropical").unwrap())
    };
    let air = Air::new(&options).unwrap();
    let sampling = Sampling::means(&[295.0, 300.0], 0.5).unwrap();
    let table = AirTable::new(&air, &sampling, 1e-6).unwrap();
    for t in table.transmission(Zenith::Apparent(90.0)).unwrap() {
        assert!((0.0..1e-150).contains(&t), "{t:e}");
    }
    assert!(air.transmission(Zenith::Apparent(90.0), &sampling).unwrap()[0] < 1e-150);
}

#[test]
fn hard_angles() {
    let air = Air::new(&us_standard()).unwrap();
    let nm = visible();
    let table = AirTable::new(&air, &nm, 1e-6).unwrap();
    let zenith = air.path(Zenith::True(0.0)).unwrap();
    assert_eq!((zenith.apparent_deg, zenith.true_deg), (0.0, 0.0));
    assert!((air.air_masses(&zenith).rayleigh - 1.0).abs() < 1e-12);
    // 30′ below the horizon and still seen, refracted up by as much.
    let set = air.path(Zenith::True(90.5)).unwrap();
    assert!(set.apparent_deg < 90.0 && (set.true_deg - 90.5).abs() < 1e-9, "{set:?}");
    assert!(air.transmission(Zenith::Apparent(90.0), &nm).unwrap().iter().all(|t| *t >= 0.0));
    for (zenith, horizon) in
        [(Zenith::True(90.7), air.horizon_deg()), (Zenith::Apparent(90.01), 90.0)]
    {
        for error in [air.path(zenith).unwrap_err(), table.transmission(zenith).unwrap_err()] {
            let AirError::BelowHorizon { horizon_deg, .. } = error else { panic!("{error}") };
            assert!((horizon_deg - horizon).abs() < 1e-6, "{error}");
        }
    }
    for bad in [-0.1, f64::NAN, f64::INFINITY] {
        for zenith in [Zenith::True(bad), Zenith::Apparent(bad)] {
            assert!(matches!(air.path(zenith), Err(AirError::ZenithAngle { .. })));
            assert!(matches!(table.transmission(zenith), Err(AirError::ZenithAngle { .. })));
        }
    }
}

#[test]
fn hard_stations() {
    let nm = visible();
    let at = |altitude_m| Air::new(&AirOptions { altitude_m, ..us_standard() });
    let green = |air: &Air| air.transmission(Zenith::Apparent(60.0), &nm).unwrap()[3];
    let (dead_sea, coast, chajnantor) =
        (at(-430.0).unwrap(), at(0.0).unwrap(), at(5_600.0).unwrap());
    assert!(green(&dead_sea) < green(&coast) && green(&coast) < green(&chajnantor));
    // The barometric formula: 1013 hPa · exp(0.43 km/8.4 km).
    assert!((dead_sea.columns().pressure_hpa - 1066.0).abs() < 2.0, "{:?}", dead_sea.columns());
    // A level of the profile exactly, and a millimetre from it.
    let (on, off) = (at(1_000.0).unwrap(), at(1_000.001).unwrap());
    assert!((green(&on) - green(&off)).abs() < 1e-7);
    for bad in [-501.0, 120_000.0, f64::NAN] {
        assert!(matches!(at(bad), Err(AirError::Altitude { .. })));
    }
}

#[test]
fn options_that_make_no_sense_are_refused_by_name() {
    let base = us_standard;
    let haze = |optical_depth| Aerosol::Angstrom {
        optical_depth,
        wavelength_nm: 550.0,
        exponent: 1.3,
        scale_height_m: 1_800.0,
    };
    let cases = [
        ("ozone_du", AirOptions { ozone_du: Some(f64::NAN), ..base() }),
        ("ozone_du", AirOptions { ozone_du: Some(-1.0), ..base() }),
        ("water_mm", AirOptions { water_mm: Some(-0.1), ..base() }),
        ("pressure_hpa", AirOptions { pressure_hpa: Some(101_325.0), ..base() }),
        // Thirty kilometres up there is next to none; fifty millimetres would be steam.
        ("water_mm", AirOptions { altitude_m: 30_000.0, water_mm: Some(50.0), ..base() }),
        ("co2_ppm", AirOptions { co2_ppm: Some(f64::INFINITY), ..base() }),
        ("refraction_nm", AirOptions { refraction_nm: 0.55, ..base() }),
        ("earth_radius_m", AirOptions { earth_radius_m: 6371.0, ..base() }),
        ("aerosol optical_depth", AirOptions { aerosol: haze(f64::NAN), ..base() }),
    ];
    for (name, options) in cases {
        let error = Air::new(&options).unwrap_err();
        assert!(error.to_string().contains(name), "{error}");
    }
}

/// Truth: Ångström's law in plane-parallel air.
#[test]
fn angstroms_law_is_what_was_measured_at_the_station() {
    let aerosol = Aerosol::Angstrom {
        optical_depth: 0.2,
        wavelength_nm: 500.0,
        exponent: 1.3,
        scale_height_m: 1_800.0,
    };
    let air = Air::new(&AirOptions { aerosol, altitude_m: 2_000.0, ..us_standard() }).unwrap();
    let c = air
        .components(Zenith::Apparent(0.0), &Sampling::points(&[500.0, 1000.0]).unwrap())
        .unwrap();
    assert!((-c.aerosol[0].ln() - 0.2).abs() < 1e-6);
    assert!((-c.aerosol[1].ln() - 0.2 * 2_f64.powf(-1.3)).abs() < 1e-6);
}

fn table(columns: &[(&str, &[f64])]) -> Table {
    let columns = columns.iter().map(|(name, v)| Column::f64(*name, None, v.to_vec())).collect();
    Table { columns, ..Table::default() }
}

/// Truth: an isothermal atmosphere without trace gases: the air's column is p/(m g) with m g = kT/H.
#[test]
fn a_profile_of_ones_own() {
    let altitude: Vec<f64> = (0..=100).map(f64::from).collect();
    let pressure: Vec<f64> = altitude.iter().map(|h| 1000.0 * (-h / 8.0).exp()).collect();
    let (cold, none) = (vec![250.0; 101], vec![0.0; 101]);
    let own = table(&[
        ("altitude_km", &altitude),
        ("pressure_hpa", &pressure),
        ("temperature_k", &cold),
        ("h2o_ppmv", &none),
        ("o3_ppmv", &none),
    ]);
    let profile = Profile::from_table("isothermal", &own).unwrap();
    let air = Air::new(&AirOptions::new(profile.clone())).unwrap();
    let truth = 1e-6 * 1e5 / (1.380_649e-23 * 250.0) * 8.0e5 * (1.0 - (-12.5_f64).exp());
    assert!((air.columns().air_cm2 / truth - 1.0).abs() < 1e-9);
    assert_eq!(air.columns().ozone_du, 0.0);
    let error =
        Air::new(&AirOptions { ozone_du: Some(300.0), ..AirOptions::new(profile) }).unwrap_err();
    assert!(matches!(error, AirError::EmptyColumn { option: "ozone_du", .. }), "{error}");

    let error = Profile::from_table("half", &table(&[("altitude_km", &altitude)])).unwrap_err();
    assert!(error.to_string().contains("pressure_hpa"), "{error}");
    let falling = table(&[
        ("altitude_km", &[0.0, 2.0, 1.0]),
        ("pressure_hpa", &[1000.0, 800.0, 900.0]),
        ("temperature_k", &[280.0; 3]),
        ("h2o_ppmv", &[0.0; 3]),
        ("o3_ppmv", &[0.0; 3]),
    ]);
    let error = Profile::from_table("falling", &falling).unwrap_err();
    assert!(matches!(error, AirError::ProfileLevel { level: 2, .. }), "{error}");
}

/// Truth: the same atmosphere on levels a kilometre apart; here they are 20 km apart, and the layers are divided within.
#[test]
fn coarse_levels_are_integrated_as_well_as_fine_ones() {
    let on = |step_km: f64| {
        let n = (100.0 / step_km).round() as usize + 1;
        let altitude: Vec<f64> = (0..n).map(|i| i as f64 * step_km).collect();
        let fall = |scale: f64| altitude.iter().map(|h| (-h / scale).exp()).collect::<Vec<_>>();
        let pressure: Vec<f64> = fall(7.0).iter().map(|p| 1000.0 * p).collect();
        let water: Vec<f64> = fall(3.0).iter().map(|w| 5000.0 * w).collect();
        let profile = table(&[
            ("altitude_km", &altitude),
            ("pressure_hpa", &pressure),
            ("temperature_k", &vec![240.0; n]),
            ("h2o_ppmv", &water),
            ("o3_ppmv", &vec![0.3; n]),
        ]);
        Air::new(&AirOptions::new(Profile::from_table("isothermal", &profile).unwrap())).unwrap()
    };
    let (coarse, fine) = (on(20.0), on(1.0));
    for z in [0.0, 70.0, 88.0, 90.0] {
        let mass = |air: &Air| air.air_masses(&air.path(Zenith::Apparent(z)).unwrap());
        let (a, b) = (mass(&coarse), mass(&fine));
        // Between levels the refractivity, a sum of two exponentials, is taken as one: the atmospheres differ a little.
        assert!((a.rayleigh / b.rayleigh - 1.0).abs() < 1e-4, "{z}°: {a:?} {b:?}");
        assert!((a.water / b.water - 1.0).abs() < 2e-3, "{z}°: {a:?} {b:?}");
    }
    let (a, b) = (coarse.columns(), fine.columns());
    assert!((a.water_mm / b.water_mm - 1.0).abs() < 1e-6, "{a:?} {b:?}");
}

/// Truth: an inversion of 0.16 K/m and more bends a horizontal ray down faster than the Earth curves.
#[test]
fn a_duct_is_refused() {
    let inversion = table(&[
        ("altitude_km", &[0.0, 0.02, 10.0, 50.0]),
        ("pressure_hpa", &[1013.0, 1010.5, 265.0, 0.8]),
        ("temperature_k", &[270.0, 278.0, 223.0, 270.0]),
        ("h2o_ppmv", &[0.0; 4]),
        ("o3_ppmv", &[0.0; 4]),
    ]);
    let profile = Profile::from_table("inversion", &inversion).unwrap();
    let options = AirOptions::new(profile);
    assert!(matches!(Air::new(&options), Err(AirError::Duct { .. })));
    assert!(Air::new(&AirOptions { refraction: false, ..options }).is_ok());
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(64) })]

    /// Deeper is darker: every species lets less through at a larger zenith angle; all are within 0…1.
    #[test]
    fn every_species_darkens_towards_the_horizon(
        name in proptest::sample::select(&Profile::NAMES[..]),
        altitude_m in -400.0..5600.0_f64,
        ozone_du in 0.0..600.0_f64,
        water_mm in 0.0..60.0_f64,
        apparent in 0.0..89.9_f64,
        more in 1e-3..1.0_f64,
    ) {
        let options = AirOptions {
            altitude_m,
            ozone_du: Some(ozone_du),
            water_mm: Some(water_mm),
            aerosol: Aerosol::Model(AerosolModel::Tropospheric50Km),
            ..AirOptions::new(Profile::named(name).unwrap())
        };
        let air = Air::new(&options).unwrap();
        let lower = (apparent + more).min(90.0);
        let high = air.components(Zenith::Apparent(apparent), &visible()).unwrap();
        let low = air.components(Zenith::Apparent(lower), &visible()).unwrap();
        for ((name, high), (_, low)) in high.iter().zip(low.iter()) {
            for (a, b) in high.iter().zip(low) {
                prop_assert!((0.0..=1.0 + 1e-12).contains(a), "{name} {a}");
                prop_assert!(b <= &(a + 1e-13), "{name}: {b} after {a}");
            }
        }
    }

    /// Whatever the air, the table's error stays below what it reports.
    #[test]
    fn the_reported_error_bounds_the_error(
        name in proptest::sample::select(&Profile::NAMES[..]),
        model in proptest::sample::select(&AerosolModel::ALL[..]),
        hazy in proptest::bool::ANY,
        refraction in proptest::bool::ANY,
        altitude_m in -400.0..6500.0_f64,
        ozone_du in 0.0..600.0_f64,
        water_mm in 0.0..30.0_f64,
        decades in 4.0..8.0_f64,
    ) {
        let options = AirOptions {
            altitude_m,
            ozone_du: Some(ozone_du),
            water_mm: Some(water_mm),
            aerosol: if hazy { Aerosol::Model(model) } else { Aerosol::None },
            refraction,
            ..AirOptions::new(Profile::named(name).unwrap())
        };
        let air = Air::new(&options).unwrap();
        let sampling = Sampling::means(&[302.0, 310.5, 325.0, 345.0, 420.0, 605.0, 687.0, 761.0, 824.0, 905.0, 940.0, 1088.0, 1131.0, 1164.0, 1205.0, 1231.0], 0.5).unwrap();
        let table = AirTable::new(&air, &sampling, 10_f64.powf(-decades)).unwrap();
        for i in 0..150 {
            let u = (f64::from(i) * 0.618_033_988_75 + decades).fract();
            let apparent = 90.0 * (1.0 - (1.0 - u).powi(3));
            for zenith in [Zenith::Apparent(apparent), Zenith::True(apparent)] {
                let exact = air.transmission(zenith, &sampling).unwrap();
                for (a, b) in table.transmission(zenith).unwrap().iter().zip(&exact) {
                    prop_assert!((a - b).abs() <= table.interpolation_error(), "{zenith:?}: {a} {b} {table:?}");
                }
            }
        }
    }

    /// True and apparent angles are each other's inverse, in the exact calculation and in the table.
    #[test]
    fn true_and_apparent_are_inverse(apparent in 0.0..=90.0_f64, altitude_m in -400.0..5600.0_f64) {
        let air = Air::new(&AirOptions { altitude_m, ..us_standard() }).unwrap();
        let there = air.path(Zenith::Apparent(apparent)).unwrap();
        let back = air.path(Zenith::True(there.true_deg)).unwrap();
        prop_assert!((back.apparent_deg - apparent).abs() < 1e-9);
    }
}
