//! The pass pipeline against sums done by hand: closed forms for the bodies, trapezoids on a fine grid for the wavelengths.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use glam::DVec3;
use hifitime::Unit;
use std::f64::consts::PI;
use sunglint_ephemeris::orbit::{Ephemeris, EphemerisRow};
use sunglint_formats::time::{format_utc_shortest, parse_utc};
use sunglint_radiometry::air::Zenith;
use sunglint_radiometry::light;
use sunglint_radiometry::light_curve::Flags;
use sunglint_radiometry::passband::{Passband, Weighting};
use sunglint_radiometry::sky::{EarthOrientation, Observer};
use sunglint_radiometry::spectrum::Spectrum;
use sunglint_radiometry::station::Station;
use sunglint_simulator::light::engine::{Switch, Switches};
use sunglint_simulator::pass::{Overrides, Pass, PassFile, Place, Simulation, StandardMagnitude};

const HC_J_NM: f64 = 6.626_070_15e-34 * 299_792_458.0 * 1e9;
const LIGHT_M_S: f64 = 299_792_458.0;

/// The elements of the ISS that many texts print, and a pass of it over the built-in station on the evening after.
const ISS: &str = r#"lines = [
  "1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927",
  "2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537",
]"#;
const EVENING: &str = "from = 2008-09-21T18:46:00Z\nto = 2008-09-21T18:51:00Z\nstep_s = 15";

fn toml(target: &str, rest: &str, times: &str) -> String {
    format!(
        "[target]\n{target}\n[orbit]\n{ISS}\n[station]\nname = \"ufo\"\n[times]\n{times}\n{rest}\n"
    )
}

fn pass(target: &str, rest: &str, times: &str) -> Pass {
    let file = PassFile::parse("p.toml", &toml(target, rest, times)).unwrap();
    sunlight_alone(file.resolve(Overrides::default()).unwrap())
}

/// The formulas here are those of a collimated Sun, scattered once.
fn sunlight_alone(mut pass: Pass) -> Pass {
    pass.effects = Switches::OFF;
    pass
}

const SPHERE: &str = "sphere = { radius_m = 0.7, reflectance = 0.31 }";

fn simulate(pass: &Pass) -> Simulation<'_> {
    pass.simulate(&|_| ()).unwrap()
}

fn near(found: f64, expected: f64, relative: f64, what: &str) {
    assert!(
        (found - expected).abs() <= relative * expected.abs(),
        "{what}: {found} is not {expected}"
    );
}

/// Phase angle in the rest frame of the target, by hand.
fn phase_rad(place: &Place) -> f64 {
    let g = &place.geometry;
    let seen = (g.to_observer - g.target.velocity_m_s / LIGHT_M_S).normalize();
    g.sun.direction_gcrs.cross(seen).length().atan2(g.sun.direction_gcrs.dot(seen))
}

/// R² ρ-less weight of a diffuse sphere: its radiant intensity over E ρ.
fn sphere_weight(radius_m: f64, phase: f64) -> f64 {
    radius_m * radius_m * 2.0 / (3.0 * PI) * (phase.sin() + (PI - phase) * phase.cos())
}

/// ∫ f dλ by trapezoids of 0.01 nm.
fn trapezoids(from_nm: f64, to_nm: f64, f: impl Fn(f64) -> f64) -> f64 {
    let n = ((to_nm - from_nm) / 0.01).round() as usize;
    let h = (to_nm - from_nm) / n as f64;
    let inner: f64 = (1..n).map(|i| f(from_nm + h * i as f64)).sum();
    h * (inner + 0.5 * (f(from_nm) + f(to_nm)))
}

/// Truth: Φ = E ρ R² f(γ)/r² of a diffuse sphere (van de Hulst), every integral over wavelength as a sum of trapezoids of 0.01 nm through the exact
/// transmission at the epoch's zenith angle. Tolerance: 1e-5 for the trapezoids over kinks of tables with points every 0.05 to 0.7 nm, 1e-4 mag.
#[test]
fn a_diffuse_sphere_has_the_rates_and_magnitudes_of_its_formula() {
    let pass = pass(SPHERE, "", EVENING);
    let simulation = simulate(&pass);
    let (station, sun) = (&pass.station, light::sun_at_1_au());
    let air = pass.air.as_ref().unwrap();
    let area = PI / 4.0
        * (station.telescope.primary_diameter_m.powi(2)
            - station.telescope.obstruction_diameter_m.powi(2));
    let seen: Vec<usize> = (0..pass.times.len())
        .filter(|i| simulation.places[*i].apparent_zenith_deg.is_some())
        .collect();
    assert!(seen.len() > 10);
    let mut sunlit = 0;
    for &i in seen.iter().step_by(4) {
        let place = &simulation.places[i];
        let g = &place.geometry;
        let d = g.sun.distance_m / 149_597_870_700.0;
        let flux = place.sunlit * 0.31 * sphere_weight(0.7, phase_rad(place))
            / (d * d * g.range_m.powi(2));
        if place.sunlit == 0.0 {
            continue;
        }
        sunlit += 1;
        let zenith = Zenith::Near { true_deg: g.zenith_deg(), range_m: g.range_m };
        let t = air.spectrum(zenith, (294.2, 1249.9)).unwrap();
        for (c, channel) in station.channels.iter().enumerate() {
            let (a, b) = channel.range_nm().unwrap();
            let (a, b) = (a.max(295.0), b.min(1249.0));
            let integrand = |nm: f64| sun.at(nm) * t.at(nm) * channel.sensitivity_at(nm) * nm;
            let expected = flux * area / HC_J_NM * trapezoids(a, b, integrand);
            let what = format!("{} at {i}", channel.name);
            near(simulation.channels[c].rate_hz[i], expected, 1e-5, &what);
            let above = trapezoids(a, b, |nm| sun.at(nm) * channel.sensitivity_at(nm) * nm);
            near(
                simulation.channels[c].above_air_hz[i],
                flux * area / HC_J_NM * above,
                1e-5,
                &what,
            );
        }
        for (b, name) in ["U", "B", "V", "R", "I"].iter().enumerate() {
            let band = Passband::named(name).unwrap();
            let power = if band.weighting == Weighting::Photon { 1 } else { 0 };
            let (from, to) = band.response.range_nm();
            let mean = |f: &dyn Fn(f64) -> f64| {
                let weight = |nm: f64| band.response.at(nm) * nm.powi(power);
                trapezoids(from, to, |nm| f(nm) * weight(nm)) / trapezoids(from, to, weight)
            };
            // Vega has 0.03 in every band.
            let vega = mean(&|nm| light::vega().at(nm));
            let above = 0.03 - 2.5 * (flux * mean(&|nm| sun.at(nm)) / vega).log10();
            let ground = 0.03 - 2.5 * (flux * mean(&|nm| sun.at(nm) * t.at(nm)) / vega).log10();
            assert!((simulation.magnitudes[[i, b]] - above).abs() < 1e-4, "{name} at {i}");
            assert!((simulation.ground_magnitudes[[i, b]] - ground).abs() < 1e-4, "{name} at {i}");
        }
        let v = simulation.magnitudes[[i, 2]];
        let reduced = v - 5.0 * (g.range_m / 1e6).log10();
        let full = reduced + 2.5 * ((1.0 + g.phase_rad.cos()) / 2.0 / 0.5).log10();
        near(
            simulation.standard_magnitudes(StandardMagnitude::Range)[i],
            reduced,
            1e-12,
            "1000 km",
        );
        near(
            simulation.standard_magnitudes(StandardMagnitude::IlluminatedFraction)[i],
            full,
            1e-12,
            "90°",
        );
        // Bins: E ρ W/d², bin means.
        for bin in [0, 40, 187] {
            let (a, b) = (pass.edges_nm[bin], pass.edges_nm[bin + 1]);
            let expected = flux * g.range_m.powi(2) * trapezoids(a, b, |nm| sun.at(nm)) / (b - a);
            near(simulation.spectra[[i, bin]], expected, 1e-5, "bin");
        }
    }
    assert!(sunlit > 2);
    assert_eq!(pass.bins(), 188);
    assert!(simulation.bounds.rate_relative < 1e-5, "{:?}", simulation.bounds);
}

/// Truth: as above, for the spectrum at the telescope: the mean over a bin of E ρ T, with T resolved within it. Tolerance: trapezoids.
#[test]
fn spectra_at_the_telescope_go_through_the_air_within_the_bins() {
    let rest =
        "[spectrum]\nedges_nm = [300, 310, 680, 700, 755, 770, 1240]\nquantity = \"irradiance\"";
    let pass = pass(SPHERE, rest, "from = 2008-09-21T18:48:47Z");
    let simulation = simulate(&pass);
    let place = &simulation.places[0];
    let g = &place.geometry;
    let d = g.sun.distance_au();
    let flux =
        place.sunlit * 0.31 * sphere_weight(0.7, phase_rad(place)) / (d * d * g.range_m.powi(2));
    let zenith = Zenith::Near { true_deg: g.zenith_deg(), range_m: g.range_m };
    let t = pass.air.as_ref().unwrap().spectrum(zenith, (294.2, 1249.9)).unwrap();
    for (bin, e) in pass.edges_nm.windows(2).enumerate() {
        let mean =
            trapezoids(e[0], e[1], |nm| light::sun_at_1_au().at(nm) * t.at(nm)) / (e[1] - e[0]);
        near(simulation.spectra[[0, bin]], flux * mean, 1e-5, "bin");
    }
    assert_eq!(simulation.spectral_light_curve("test").unit, "W / (m2 nm)");
}

/// Truth: a convex box of a Lambert surface by hand: W = Σ_faces A cosθ_i cosθ_o/π, in a body turned by the matrix of the
/// quaternion [w, x, y, z] (written out). Tolerance: rounding.
#[test]
fn a_box_has_the_weight_of_its_faces() {
    let target = "part = [{ name = \"box\", shape = \"box\", size_m = [1.0, 2.0, 3.0], material = \"grey80\" }]";
    let q = [0.5, 0.1, -0.7, 0.5];
    let attitude = "[attitude]\nlaw = \"inertial\"\nbody_to_gcrs = [0.5, 0.1, -0.7, 0.5]";
    let pass = pass(target, attitude, EVENING);
    let simulation = simulate(&pass);
    let [w, x, y, z] = q;
    let body_axes = [
        DVec3::new(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)),
        DVec3::new(2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)),
        DVec3::new(2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)),
    ];
    let areas = [6.0, 3.0, 2.0];
    let mut lit = 0;
    for (i, place) in simulation.places.iter().enumerate() {
        let g = &place.geometry;
        let seen = (g.to_observer - g.target.velocity_m_s / LIGHT_M_S).normalize();
        let mut expected = 0.0;
        for (axis, area) in body_axes.iter().zip(areas) {
            for n in [*axis, -*axis] {
                expected += area * n.dot(g.sun.direction_gcrs).max(0.0) * n.dot(seen).max(0.0) / PI;
            }
        }
        lit += usize::from(expected > 0.0);
        // Of a disc that is partly hidden the light comes from another place by up to its radius: 5e-3 in a cosine.
        let tolerance = if place.discs.is_some() { 1e-2 * expected } else { 1e-12 };
        let found = simulation.weights[[i, 0]];
        assert!((found - expected * place.sunlit).abs() <= tolerance, "{i}: {found}");
    }
    assert!(lit > 10);
}

/// Truth: by hand, from the sun and the shadow: 20:24 on that evening the station of the ISS is in the umbra (skyfield 1.55), at 18:46 it is lit.
#[test]
fn in_the_shadow_nothing_is_counted_and_it_is_said() {
    let night = simulate_flags("from = 2008-09-21T20:24:05Z", "");
    assert_eq!(night.0, [0.0; 6]);
    assert_eq!(night.1, Flags::ECLIPSED);
    let never = simulate_flags("from = 2008-09-21T20:24:05Z", "[illumination]\neclipse = \"none\"");
    assert!(never.0.iter().all(|hz| *hz > 0.0) && never.1.is_empty());
    // Into the shadow: the visible part of the disc falls from 1 to 0, and the rates with it.
    let times = "from = 2008-09-21T18:49:00Z\nto = 2008-09-21T18:53:00Z\nstep_s = 0.5";
    let pass = pass(SPHERE, "", times);
    let simulation = simulate(&pass);
    let sunlit: Vec<f64> = simulation.places.iter().map(|p| p.sunlit).collect();
    assert!(
        sunlit.windows(2).all(|p| p[1] <= p[0]) && sunlit.contains(&0.0) && sunlit.contains(&1.0)
    );
    let part = sunlit.iter().position(|s| *s < 1.0).unwrap();
    assert!(sunlit[part] > 0.0 && simulation.flags(part).contains(Flags::ECLIPSED));
    assert!(!simulation.flags(part - 1).contains(Flags::ECLIPSED));
    simulation.light_curve("test").to_table().unwrap();
    simulation.spectral_light_curve("test").to_fits().unwrap();
}

fn simulate_flags(times: &str, rest: &str) -> ([f64; 6], Flags) {
    let pass = pass(SPHERE, rest, times);
    let simulation = simulate(&pass);
    (std::array::from_fn(|c| simulation.channels[c].rate_hz[0]), simulation.flags(0))
}

/// Truth: twelve hours before and after, the ISS is on the other side of the Earth.
#[test]
fn below_the_horizon_there_is_no_number_but_a_flag() {
    let (rates, flags) = simulate_flags("from = 2008-09-21T19:30:00Z", "");
    assert!(rates.iter().all(|hz| hz.is_nan()) && flags.contains(Flags::HIDDEN));
    let pass = pass(SPHERE, "", "from = 2008-09-21T19:30:00Z");
    let simulation = simulate(&pass);
    let table = simulation.light_curve("test").to_table().unwrap();
    assert!(table.rows() == 1);
    assert!(simulation.ground_magnitudes[[0, 2]].is_nan());
    assert!(simulation.spectra[[0, 50]].is_finite());
}

fn by_hand(rows: &[EphemerisRow], times: &str) -> Pass {
    let mut pass = pass(SPHERE, "", times);
    pass.orbit = Ephemeris::new("by hand", rows).unwrap().into();
    pass
}

/// Truth: a diffuse sphere before the Sun shows its dark side: f(π) = 0. All numbers stay numbers, or are NaN where there is no light.
#[test]
fn a_target_before_the_sun_is_dark_and_finite() {
    let noon = parse_utc("2020-06-21T11:00:00Z").unwrap();
    let station = Station::built_in("ufo").unwrap().unwrap();
    let rows: Vec<EphemerisRow> = (-3..=3)
        .map(|i| {
            let epoch = noon + f64::from(i) * Unit::Second;
            let observer =
                Observer::at(epoch, &station.site, EarthOrientation::embedded()).unwrap();
            let to_sun = observer.frame().sun().direction_gcrs;
            EphemerisRow {
                epoch,
                position_m: observer.position_gcrs_m() + 1e6 * to_sun,
                velocity_m_s: None,
            }
        })
        .collect();
    let pass = by_hand(&rows, "from = 2020-06-21T11:00:00Z");
    let simulation = simulate(&pass);
    let place = &simulation.places[0];
    assert!(place.geometry.phase_deg() > 179.98, "{}", place.geometry.phase_deg());
    for channel in &simulation.channels {
        // f(π − δ) ≈ 2δ³/(9π): with δ below 3e-4 less than 1e-10 of the full sphere.
        assert!(channel.rate_hz[0] >= 0.0 && channel.rate_hz[0] < 1e-3, "{}", channel.rate_hz[0]);
        assert!(channel.predicted[0].sigma_hz.is_some_and(f64::is_finite));
    }
    assert!(simulation.weights[[0, 0]] >= 0.0 && simulation.weights[[0, 0]] < 1e-9);
    simulation.light_curve("test").to_table().unwrap();
    assert!(StandardMagnitude::IlluminatedFraction.of(9.0, 1e6, PI).is_nan());
    assert!(simulation.geometry_table("test").columns.len() > 20);
}

/// Truth: 2016-12-31 had 86,401 s: eleven half seconds from 23:59:58 to 00:00:02.5 less one; the target moves as far in each of them.
#[test]
fn a_leap_second_is_a_second() {
    let start = parse_utc("2016-12-31T23:59:50Z").unwrap();
    let station = Station::built_in("ufo").unwrap().unwrap();
    let observer = Observer::at(start, &station.site, EarthOrientation::embedded()).unwrap();
    let up = observer.position_gcrs_m().normalize();
    let (first, way) =
        (observer.position_gcrs_m() + 8e5 * up, 7500.0 * up.any_orthonormal_vector());
    let rows: Vec<EphemerisRow> = (0..30)
        .map(|i| EphemerisRow {
            epoch: start + f64::from(i) * Unit::Second,
            position_m: first + way * f64::from(i),
            velocity_m_s: Some(way),
        })
        .collect();
    let times = "from = \"2016-12-31T23:59:58Z\"\nto = \"2017-01-01T00:00:02Z\"\nstep_s = 0.5";
    let pass = by_hand(&rows, times);
    let simulation = simulate(&pass);
    let texts: Vec<String> = pass.times.iter().map(|t| format_utc_shortest(*t)).collect();
    assert_eq!(texts.len(), 11);
    assert!(texts.contains(&"2016-12-31T23:59:60.5Z".to_owned()), "{texts:?}");
    let steps: Vec<f64> = simulation
        .places
        .windows(2)
        .map(|p| (p[1].geometry.target.position_m - p[0].geometry.target.position_m).length())
        .collect();
    for step in steps {
        // Half a second of 7.5 km/s, less the change of light time (below 1e-5 of it), on a nanosecond's grid of epochs.
        assert!((step - 3750.0).abs() < 0.1, "{step}");
    }
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let pass = pass("built_in = \"box_wing\"", "[attitude]\nlaw = \"orbit\"", EVENING);
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let simulation = pool.install(|| simulate(&pass));
        let rates: Vec<u64> = simulation
            .channels
            .iter()
            .flat_map(|c| c.rate_hz.iter().map(|v| v.to_bits()))
            .collect();
        let spectra: Vec<u64> = simulation.spectra.iter().map(|v| v.to_bits()).collect();
        (rates, spectra)
    };
    assert_eq!(run(1), run(3));
}

/// Truth: two materials whose reflectances add up to a third's reflect together what it reflects: rates are linear in ρ, whatever the grids of the
/// tables. Tolerance: rounding.
#[test]
fn rates_are_linear_in_reflectance() {
    let rates = |reflectance: f64| {
        let target = format!("sphere = {{ radius_m = 1.0, reflectance = {reflectance} }}");
        let pass = pass(&target, "", "from = 2008-09-21T18:48:00Z");
        let simulation = simulate(&pass);
        simulation.channels.iter().map(|c| c.rate_hz[0]).collect::<Vec<_>>()
    };
    let (a, b, c) = (rates(0.125), rates(0.5), rates(0.625));
    for i in 0..c.len() {
        near(a[i] + b[i], c[i], 1e-13, "sum");
    }
}

/// Truth: without air the rate at the detector is that above it; and a coarser tolerance is kept and said.
#[test]
fn air_can_be_left_out() {
    let pass = pass(SPHERE, "[air]\nnone = true", EVENING);
    let simulation = simulate(&pass);
    for channel in &simulation.channels {
        for (i, place) in simulation.places.iter().enumerate() {
            if place.apparent_zenith_deg.is_some() {
                assert_eq!(channel.rate_hz[i].to_bits(), channel.above_air_hz[i].to_bits());
            }
        }
    }
    assert_eq!(simulation.bounds.transmission_nodes, 0);
}

#[test]
fn what_is_asked_for_instead_takes_the_place_of_the_file() {
    let file = PassFile::parse("p.toml", &toml(SPHERE, "", EVENING)).unwrap();
    assert!(file.names_station());
    let mut station = Station::built_in("ufo").unwrap().unwrap();
    station.name = "elsewhere".into();
    station.channels.truncate(2);
    let overrides = Overrides {
        station: Some(station),
        from: Some(parse_utc("2008-09-21T18:48:00Z").unwrap()),
        to: Some(parse_utc("2008-09-21T18:48:10Z").unwrap()),
        step_s: Some(2.5),
        ..Overrides::default()
    };
    let pass = file.resolve(overrides).unwrap();
    assert_eq!(
        (pass.times.len(), pass.station.name.as_str(), pass.station.channels.len()),
        (5, "elsewhere", 2)
    );
    let grey = Spectrum::<sunglint_radiometry::spectrum::Reflectance>::constant(0.3, 300.0, 400.0);
    assert!(grey.is_ok() && simulate(&pass).channels.len() == 2);
}

/// Every message names the file, the line and the key, and says what to do.
#[test]
fn what_makes_no_sense_is_refused_with_its_place() {
    let refuse = |text: &str| {
        let read = PassFile::parse("p.toml", text).and_then(|f| f.resolve(Overrides::default()));
        read.map(|_| ()).unwrap_err().to_string()
    };
    let with = |target: &str, rest: &str, times: &str| refuse(&toml(target, rest, times));
    for (message, parts) in [
        (
            with(SPHERE, "[atitude]\nlaw = \"orbit\"", EVENING),
            &["p.toml:", "atitude", "did you mean", "attitude"][..],
        ),
        (
            with("built_in = \"box_wings\"", "", EVENING),
            &["p.toml:2: target.built_in", "did you mean \"box_wing\""],
        ),
        (
            with("sphere = { radius_m = 1.0, material = \"whit\" }", "", EVENING),
            &["target.sphere.material", "did you mean \"white\""],
        ),
        (with("sphere = { radius_m = 1.0 }", "", EVENING), &["target.sphere", "either material"]),
        (
            with("file = \"none.toml\"", "", EVENING),
            &["p.toml:2: target.file", "none.toml", "No such file"],
        ),
        (
            with(
                "part = [{ name = \"b\", shape = \"box\", size_m = [1.0, 1.0, 1.0], material = \"gold_foil\" }]",
                "",
                EVENING,
            ),
            &["target.part[0].material", "gold"],
        ),
        (with(SPHERE, "[ephemeris]\nfile = \"e.csv\"", EVENING), &["ephemeris", "not both"]),
        (
            with(SPHERE, "", "from = 2008-09-21T18:46:00Z\nto = 2008-09-21T18:40:00Z\nstep_s = 1"),
            &["times.to", "a time after from"],
        ),
        (
            with(
                SPHERE,
                "",
                "from = 2008-09-21T18:46:00Z\nto = 2008-09-22T18:40:00Z\nstep_s = 1e-3",
            ),
            &["times.step_s", "at most 1000000 samples"],
        ),
        (
            with(SPHERE, "", "from = 2008-09-21T18:46:00Z\nto = 2008-09-22T18:40:00Z"),
            &["times.step_s", "seconds between samples"],
        ),
        (with(SPHERE, "", "to = 2008-09-22T18:40:00Z"), &["times.from", "a time, or file"]),
        (with(SPHERE, "[air]\nprofile = \"martian\"", EVENING), &["air.profile", "martian"]),
        (
            with(SPHERE, "[air]\nnone = true\nozone_du = 300", EVENING),
            &["air.ozone_du", "no other key"],
        ),
        (with(SPHERE, "[spectrum]\nstep_nm = 7", EVENING), &["spectrum.step_nm", "divides 940 nm"]),
        (
            with(SPHERE, "[spectrum]\nedges_nm = [500, 400]", EVENING),
            &["spectrum.edges_nm", "increasing"],
        ),
        (
            with(SPHERE, "[magnitudes]\nzero_point = \"sirius\"", EVENING),
            &["magnitudes.zero_point", "vega"],
        ),
        (
            with(SPHERE, "[illumination]\neclipse = \"none\"\nearth_radius_m = 6378137", EVENING),
            &["illumination.earth_radius_m"],
        ),
        (
            with(SPHERE, "[illumination]\nearth_radius_m = 6378", EVENING),
            &["earth_radius_m", "metres"],
        ),
        (
            refuse(
                "[target]\nbuilt_in = \"box_wing\"\n[station]\nname = \"ufo\"\n[times]\nfrom = 2008-09-21T18:46:00Z\n",
            ),
            &["orbit", "[ephemeris]"],
        ),
        (
            refuse(&toml(SPHERE, "", EVENING).replace("name = \"ufo\"", "name = \"uvo\"")),
            &["station.name", "ufo"],
        ),
        (refuse(&toml(SPHERE, "", EVENING).replace("2927", "2928")), &["orbit.lines", "checksum"]),
        (
            refuse(&toml(SPHERE, "", EVENING).replace("lines = [", "norad_id = 5\nlines = [")),
            &["orbit.norad_id", "`5`"],
        ),
        (
            refuse(&format!("tolerance = 1\n{}", toml(SPHERE, "", EVENING))),
            &["p.toml:1: tolerance", "1e-9 to 0.1"],
        ),
    ] {
        for part in parts {
            assert!(message.contains(part), "`{part}` is not in: {message}");
        }
        assert!(message.starts_with("p.toml"), "{message}");
    }
}

/// Truth: day 356.78 of the year less the 264.52 of the elements; the physics of the messages is that of SGP4, whose orbit is long down in 2012.
#[test]
fn elements_that_are_old_are_warned_of_or_fail() {
    let later = pass(SPHERE, "", "from = 2008-12-21T18:46:00Z");
    assert!(later.warnings.iter().any(|w| w.contains("92.3 days old")), "{:?}", later.warnings);
    // The same orbit (synthetic) with a drag that brings it down within months.
    let text = toml(SPHERE, "", "from = 2009-09-21T18:46:00Z")
        .replace("-11606-4 0  2927", " 11606-2 0  2924");
    let file = PassFile::parse("p.toml", &text).unwrap();
    let decayed = file.resolve(Overrides::default()).unwrap();
    let message = decayed.simulate(&|_| ()).map(|_| ()).unwrap_err().to_string();
    for part in ["2009-09-21T18:46:00Z", "decayed", "take elements nearer to"] {
        assert!(message.contains(part), "{message}");
    }
    let large = pass("sphere = { radius_m = 700.0, reflectance = 0.3 }", "", EVENING);
    assert!(large.warnings.iter().any(|w| w.contains("millimetres")), "{:?}", large.warnings);
}

/// Checks the error stated for rates from the air's table over the zenith angle, where it matters most: at the horizon, where blue light is weak.
/// Truth: the mean transmission of each channel through the exact air at the epoch's zenith angle, by trapezoids (good to 1e-5), with tables of
/// three tolerances: no sample errs by more than is said. What is said is a bound, 70 to 280 times what is found here: the table's error is one
/// number for all zenith angles, the largest, and the bound sets it against the weakest rate. A bound ten times looser would be none.
#[test]
fn the_said_error_of_rates_holds_at_the_horizon() {
    let mut station = Station::built_in("ufo").unwrap().unwrap();
    station.horizon = sunglint_radiometry::station::Horizon::Flat(0.0);
    let mut rests = Vec::new();
    for tolerance in [1e-3, 1e-4, 1e-5] {
        let times = "from = 2008-09-21T18:43:30Z\nto = 2008-09-21T18:45:00Z\nstep_s = 2";
        let text = toml(SPHERE, "", times);
        let overrides = Overrides { station: Some(station.clone()), ..Overrides::default() };
        let mut pass = PassFile::parse("p.toml", &text).unwrap().resolve(overrides).unwrap();
        pass.air_tolerance = tolerance;
        let simulation = simulate(&pass);
        let sun = light::sun_at_1_au();
        let (mut worst, mut lowest) = (0.0_f64, 0.0_f64);
        let low = |p: &Place| p.apparent_zenith_deg.is_some_and(|z| z > 86.0);
        for (i, place) in simulation.places.iter().enumerate().filter(|(_, p)| low(p)) {
            lowest = lowest.max(place.apparent_zenith_deg.unwrap());
            let g = &place.geometry;
            let zenith = Zenith::Near { true_deg: g.zenith_deg(), range_m: g.range_m };
            let t = pass.air.as_ref().unwrap().spectrum(zenith, (294.2, 1249.9)).unwrap();
            for (channel, found) in station.channels.iter().zip(&simulation.channels) {
                let (a, b) = channel.range_nm().unwrap();
                let (a, b) = (a.max(295.0), b.min(1249.0));
                let photons = |nm: f64| sun.at(nm) * channel.sensitivity_at(nm) * nm;
                let mean =
                    trapezoids(a, b, |nm| photons(nm) * t.at(nm)) / trapezoids(a, b, photons);
                let said = found.rate_hz[i] / found.above_air_hz[i];
                worst = worst.max((said / mean - 1.0).abs());
            }
        }
        assert!(lowest > 89.0, "{lowest}");
        let bound = simulation.bounds.rate_relative;
        assert!(worst < bound + 1e-5, "{tolerance}: {worst:e} of {bound:e}");
        rests.push((worst, bound));
    }
    assert!(rests[0].0 > 2e-5, "the coarsest table is too good for this test: {rests:?}");
    assert!(rests[0].1 < 1000.0 * rests[0].0, "the said error says too much: {rests:?}");
}

/// A box with wings that turns once in 40 s, exposed for 1 s: what a detector sees is not the middle of the exposure. Truth: the mean of 2,000 moments
/// of the same light. Tolerance: 1e-3, the scene's own; a moment in 2,000 errs by the steps at edges and shadows, 1/2,000 of the largest value at most each.
#[test]
fn exposures_of_a_body_that_turns_are_averaged() {
    let spin = "[attitude]\nlaw = \"spin\"\naxis_body = [0.0, 0.0, 1.0]\naxis_gcrs = [-0.30, 0.10, 0.95]\nperiod_s = 40.0\nepoch_utc = \"2008-09-21T18:46:00\"\n";
    let times =
        "from = 2008-09-21T18:48:00Z\nto = 2008-09-21T18:48:09.1Z\nstep_s = 1.3\nexposure_s = 1.0";
    let pass = pass("built_in = \"box_wing\"", spin, times);
    let rates = |s: &Simulation<'_>| {
        let n = s.places.len();
        ndarray::Array2::from_shape_fn((n, 2), |(i, c)| s.channels[3 + c].rate_hz[i])
    };
    let simulation = simulate(&pass);
    let means = simulation.exposure_means(&rates, &|_| ()).unwrap();
    assert_eq!(means.coarse, 0);
    assert!(means.pieces.iter().all(|p| *p >= 16), "{:?}", means.pieces);
    assert!(means.largest_change > 2e-3, "{}", means.largest_change);
    let middle = rates(&simulation);
    const MOMENTS: u32 = 2000;
    let largest = middle.iter().copied().fold(0.0, f64::max);
    for (i, time) in pass.times.iter().enumerate() {
        let offset = |k: u32| (f64::from(k) + 0.5) / f64::from(MOMENTS) - 0.5;
        let times: Vec<_> = (0..MOMENTS).map(|k| *time + offset(k) * Unit::Second).collect();
        let exposure_s = vec![1.0; times.len()];
        let fine = Pass { times, exposure_s, edges_nm: vec![300.0, 1240.0], ..pass.clone() };
        let fine = rates(&simulate(&fine));
        for c in 0..2 {
            let truth = fine.column(c).mean().unwrap();
            let error = (means.values[[i, c]] - truth).abs();
            assert!(error < 1e-3 * truth.max(largest), "{i}: {} {truth}", means.values[[i, c]]);
        }
    }
    // A body that turns too fast for what an exposure is cut into is said to.
    let fast = PassFile::parse(
        "p.toml",
        &toml("built_in = \"box_wing\"", &spin.replace("40.0", "4.0"), times),
    );
    let fast = sunlight_alone(fast.unwrap().resolve(Overrides::default()).unwrap());
    let means = simulate(&fast).exposure_means(&rates, &|_| ()).unwrap();
    assert!(means.coarse > 0, "{means:?}");
    // A sphere that changes slowly needs no pieces, and its mean is that of three points: T² f″/24 off the middle.
    let slow = self::pass(
        SPHERE,
        "",
        "from = 2008-09-21T18:47:30Z\nto = 2008-09-21T18:48:30Z\nstep_s = 20\nexposure_s = 0.1",
    );
    let slow_simulation = simulate(&slow);
    let means = slow_simulation.exposure_means(&rates, &|_| ()).unwrap();
    assert!(means.pieces.iter().all(|p| *p == 1) && means.largest_change < 1e-4);
}

/// A cube of paint that turns once in 40 s. Truth: the mean of 1000 moments over each exposure of 4 s, over the moment in its middle. Tolerance: where two rules agree to a quarter, or to the tolerance of 1e-3, the finer one stands: a third of the difference, and 2e-3. The samples that are off by more
/// than the tolerance say so, with a warning and in the promise; with exposures of 10 ms none does.
#[test]
fn the_middle_of_an_exposure_that_is_not_its_mean_is_said() {
    let spin = "[attitude]\nlaw = \"spin\"\naxis_body = [0.0, 0.0, 1.0]\naxis_gcrs = [-0.30, 0.10, 0.95]\nperiod_s = 40.0\nepoch_utc = \"2008-09-21T18:46:00\"\n";
    let times =
        "from = 2008-09-21T18:48:00Z\nto = 2008-09-21T18:48:35Z\nstep_s = 7\nexposure_s = 4.0";
    let made = |times: &str| {
        let text = toml("built_in = \"cube\"", spin, times);
        PassFile::parse("p.toml", &text).unwrap().resolve(Overrides::default()).unwrap()
    };
    let pass = made(times);
    let simulation = simulate(&pass);
    let mut over = 0;
    for (i, time) in pass.times.iter().enumerate() {
        let offset = |k: u32| 4.0 * ((f64::from(k) + 0.5) / 1000.0 - 0.5) * Unit::Second;
        let times: Vec<_> = (0..1000).map(|k| *time + offset(k)).collect();
        let exposure_s = vec![1e-3; times.len()];
        let fine = Pass { times, exposure_s, edges_nm: vec![300.0, 1240.0], ..pass.clone() };
        let fine = simulate(&fine);
        // The sides of the cube have colours of their own: the worst channel counts.
        let one = |c: usize| {
            let mean = fine.channels[c].above_air_hz.iter().sum::<f64>() / 1000.0;
            let middle = simulation.channels[c].above_air_hz[i];
            (mean - middle).abs() / mean.max(middle)
        };
        let truth = (0..pass.station.channels.len()).map(one).fold(0.0, f64::max);
        let found = simulation.smear[i];
        assert!((found - truth).abs() < 2e-3 + truth / 3.0, "{i}: {found} {truth}");
        let stated = simulation.stated_relative(i).unwrap();
        let said = simulation.over_tolerance(i) == Some("the exposure");
        assert_eq!(said, found > pass.tolerance.max(stated), "{i}: {found} {stated}");
        over += usize::from(said);
    }
    assert!(over >= 3, "{:?}", simulation.smear);
    let promise = simulation.totals().promise();
    assert!(!promise.is_met() && promise.samples - promise.met >= over, "{promise:?}");
    assert!(promise.limited_by.iter().any(|l| l.light == "the exposure"), "{promise:?}");
    let concerns = simulation.concerns();
    assert!(concerns.iter().any(|c| c.contains("while they are exposed")), "{concerns:?}");
    let short = made(&times.replace("4.0", "0.01"));
    let simulation = simulate(&short);
    let said = |i: usize| simulation.over_tolerance(i) == Some("the exposure");
    assert!((0..short.times.len()).all(|i| !said(i)), "{:?}", simulation.smear);
    let concerns = simulation.concerns();
    assert!(!concerns.iter().any(|c| c.contains("while they are exposed")), "{concerns:?}");
}

/// A plate with a lobe of α 0.003 beside a sphere of paint, in an inertial attitude in which it glints: the direction half-way between Sun and station turns by less than 0.25° in an exposure of 0.5 s, and yet the middle is not the mean; in
/// 6 s the glint passes between the points of a coarse rule. Truth: the mean of many moments over each exposure. Tolerance: as where a cube turns, a third of the difference and 2e-3, and in 6 s the steps of the moments.
#[test]
fn a_narrow_glint_within_an_exposure_is_said() {
    let text = |times: &str| {
        format!(
            r#"
[[target.part]]
name = "a"
shape = "plate"
size_m = [1, 1]
material = "m"
[[target.material]]
name = "m"
model = "microfacet"
distribution = "beckmann"
alpha = 0.003
reflectance = 0.6
[[target.part]]
name = "s"
shape = "sphere"
radius_m = 0.5
offset_m = [50, 0, 0]
material = "grey80"
[orbit]
lines = [
  "SYNTHETIC DUSK",
  "1 99004U 20001A   20323.50000000  .00000000  00000-0  10000-4 0    19",
  "2 99004  98.6000 318.0000 0010000  90.0000  90.0000 14.27000000    13",
]
[attitude]
law = "inertial"
euler_zyx_deg = [-172.908223508, 154.005558963, 0]
[station]
name = "ufo"
[times]
{times}
"#
        )
    };
    for (times, exposure_s, moments) in [
        ("from = \"2020-11-18T16:26:26\"\nto = \"2020-11-18T16:26:34\"\nstep_s = 0.5", 0.5, 100),
        ("from = \"2020-11-18T16:26:25\"\nto = \"2020-11-18T16:26:35\"\nstep_s = 1", 6.0, 600),
    ] {
        let times = format!("{times}\nexposure_s = {exposure_s:?}");
        let file = PassFile::parse("p.toml", &text(&times)).unwrap();
        let mut pass = file.resolve(Overrides::default()).unwrap();
        pass.effects = Switches { solar_disc: Switch::On, ..Switches::OFF };
        let simulation = simulate(&pass);
        let mut over = 0;
        for (i, time) in pass.times.iter().enumerate() {
            let offset = |k: u32| (f64::from(k) + 0.5) / f64::from(moments) - 0.5;
            let times: Vec<_> =
                (0..moments).map(|k| *time + offset(k) * exposure_s * Unit::Second).collect();
            let exposure_s = vec![1e-3; times.len()];
            let fine = Pass { times, exposure_s, edges_nm: vec![300.0, 1240.0], ..pass.clone() };
            let fine = simulate(&fine);
            let one = |c: usize| {
                let rates = &fine.channels[c].above_air_hz;
                let mean = rates.iter().sum::<f64>() / rates.len() as f64;
                let middle = simulation.channels[c].above_air_hz[i];
                (mean - middle).abs() / mean.max(middle)
            };
            let truth = (0..pass.station.channels.len()).map(one).fold(0.0, f64::max);
            let found = simulation.smear[i];
            assert!((found - truth).abs() < 2e-3 + truth / 3.0, "{time} {i}: {found} {truth}");
            let stated = simulation.stated_relative(i).unwrap();
            let said = simulation.over_tolerance(i) == Some("the exposure");
            assert_eq!(said, found > pass.tolerance.max(stated), "{i}: {found} {stated}");
            over += usize::from(truth > 0.1 && said);
        }
        assert!(over >= 2, "{:?}", simulation.smear);
    }
}
