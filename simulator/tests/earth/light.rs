//! Bodies in the light of tables.

use super::cap::{EARTH_M, direction, grid, rotation};
use super::truth;
use glam::{DQuat, DVec3};
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus as Rng;
use std::f64::consts::FRAC_1_PI;
use std::sync::Arc;
use sunglint_simulator::light::disc::SunOptions;
use sunglint_simulator::light::earth::grid::{AlbedoGrid, Cells};
use sunglint_simulator::light::shine::{self, Earthshine};
use sunglint_simulator::light::{
    Course, EarthAlbedo, Effect as _, Engine, Globe, Lighting, Options, Scene, Source, View, engine,
};
use sunglint_simulator::target::Target;

fn plate() -> Target {
    let text = "name = \"plate\"\n[[part]]\nname = \"plate\"\nshape = \"plate\"\nsize_m = [1, 1]\nfaces = [\"+z\"]\nmaterial = \"white\"\n\
         [[material]]\nname = \"white\"\nmodel = \"lambert\"\nreflectance = 1.0\n";
    Target::parse("plate.toml", text).unwrap()
}

fn lighting(globe: Globe, to: DVec3) -> Lighting {
    Lighting {
        sun_body: globe.sun,
        sun_radius_rad: 0.0,
        earth: Some(globe),
        moon: None,
        shadow: None,
        sunlit: 1.0,
        sunlit_error: 0.0,
        view: View::Distant(to),
    }
}

/// Truth: the double loop over cells of 0.5° for a white Lambert plate that stands anyhow over a table of random albedos (cells of 30°, 10° and 2°, each 0 to 0.9 or 0 with every other
/// one bright), at 300 to 30,000 km: W = A cosθ_o/π Σ ρ/π cosθ☉ cosθ cosθ_i dA/d². What is stated covers the difference in 95 % of 240 cases (binomial, 1 %); the loop is known to 1e-3 of the light of an even Earth
/// of 0.9 (its own cells). What is stated is small: 3 % of that light in the mean at a tolerance of 1 %.
#[test]
fn a_plate_over_a_random_table() {
    let scene = Scene::new(&plate()).unwrap();
    let mut rng = Rng::seed_from_u64(3);
    let (mut missed, mut stated, mut off, mut cases) = (0, 0.0, 0.0, 0);
    for step in [30.0, 10.0, 2.0] {
        for _ in 0..16 {
            let black_or_white: bool = rng.random();
            let values: Vec<f64> = (0..2 * (180.0 / step) as usize * (180.0 / step) as usize)
                .map(|_| {
                    let value: f64 = rng.random();
                    0.9 * if black_or_white { value.round() } else { value }
                })
                .collect();
            let columns = (360.0 / step) as usize;
            let at = |row: usize, column: usize| values[row * columns + column];
            let earth = Arc::new(EarthAlbedo::tabulated("random", grid(step, &mut { at })));
            let mut effect = Earthshine::new(scene.evaluator(), 1e-2).of(earth);
            let albedo = |lat: f64, lon: f64| {
                let cell = |deg: f64| (deg / step) as usize;
                at(cell(lat.to_degrees() + 90.0), cell(lon.to_degrees() + 180.0).min(columns - 1))
            };
            for _ in 0..5 {
                let turn = rotation(&mut rng);
                // Earth-fixed axes are `turn` times those of the body.
                let (up, sun) = (direction(&mut rng), direction(&mut rng));
                let distance_m = EARTH_M + 3e5 * 100.0_f64.powf(rng.random());
                let globe =
                    Globe { toward: -up, distance_m, radius_m: EARTH_M, sun, to_ground: turn };
                let (mut weights, mut errors) = (vec![0.0], vec![0.0]);
                let to = DVec3::new(0.6, 0.0, 0.8);
                effect.add(&lighting(globe, to), &mut weights, &mut errors).unwrap();
                let normal = turn * DVec3::Z;
                let answer = |d: DVec3| d.dot(normal).max(0.0) * 0.8 * FRAC_1_PI;
                let loop_ = |albedo: &dyn Fn(f64, f64) -> f64| {
                    truth::shine(
                        distance_m * (turn * up),
                        EARTH_M,
                        turn * sun,
                        0.5,
                        albedo,
                        &answer,
                    )
                };
                let (expected, even) = (loop_(&albedo), loop_(&|_, _| 0.9));
                // What a plate would get that faces the Earth.
                let facing = 0.9 * 0.8 * FRAC_1_PI * (EARTH_M / distance_m).powi(2);
                if even < 1e-3 * facing {
                    continue;
                }
                cases += 1;
                let apart = (weights[0] - expected).abs();
                missed += u64::from(apart > errors[0] + 1e-3 * even);
                stated += errors[0] / even;
                off += apart / even;
            }
        }
    }
    let n = cases as f64;
    println!("{cases} cases, {missed} missed, stated {:.2e}, off {:.2e}", stated / n, off / n);
    assert!(
        cases > 120 && sunglint_testkit::chance_of_misses(cases, missed, 0.05) > 0.01,
        "{missed} of {cases}"
    );
    assert!(stated / n < 0.03, "{}", stated / n);
}

/// Truth: geometry, by the test's own rays: a mirror has the radiance of the place that it mirrors, with the albedo of that place's cell; a Beckmann lobe the mean of that over its slopes, times
/// (h·o)/(h·n), by 200 by 200 of them. A table of two halves, and one of cells of 5° at random: what is stated, 1e-6 for the table's own numbers, and 1 % where
/// edges of cells cross a lobe.
#[test]
fn a_glossy_plate_over_a_table() {
    let mut random = Rng::seed_from_u64(3);
    let values: Vec<f64> = (0..36 * 72).map(|_| random.random_range(0.05..0.95)).collect();
    let tables: [&dyn Fn(usize, usize) -> f64; 2] =
        [&|row, _| if row >= 18 { 0.9 } else { 0.2 }, &|row, column| values[row * 72 + column]];
    let n = DVec3::NEG_Z;
    // A plate that faces the Earth's middle, near the equator.
    let to_body = DQuat::from_rotation_arc(DVec3::new(-0.9, 0.3, 0.1).normalize(), n);
    let globe = Globe {
        toward: n,
        distance_m: EARTH_M + 790e3,
        radius_m: EARTH_M,
        sun: to_body * DVec3::new(0.8, 0.1, 0.5).normalize(),
        to_ground: to_body.inverse(),
    };
    for ((number, table), tilt) in
        tables.iter().enumerate().flat_map(|t| [-0.3, 0.0, 0.2_f64].map(|tilt| (t, tilt)))
    {
        let view = (n + tilt * DVec3::X).normalize();
        let radiance = |ray: DVec3| {
            let middle = globe.toward * globe.distance_m;
            let along = ray.dot(middle);
            let root = along * along - middle.length_squared() + EARTH_M * EARTH_M;
            if root <= 0.0 || along <= 0.0 {
                return 0.0;
            }
            let ground = (ray * (along - root.sqrt()) - middle) / EARTH_M;
            let place = globe.to_ground * ground;
            let row = ((place.z.asin().to_degrees() + 90.0) / 5.0) as usize;
            let column = ((place.y.atan2(place.x).to_degrees() + 180.0) / 5.0) as usize;
            table(row.min(35), column.min(71)) * ground.dot(globe.sun).max(0.0) * FRAC_1_PI
        };
        for alpha in [0.0, 1e-5, 1e-3, 2e-2] {
            let model = match alpha {
                0.0 => "model = \"mirror\"".to_owned(),
                _ => {
                    format!("model = \"microfacet\"\ndistribution = \"beckmann\"\nalpha = {alpha}")
                }
            };
            let text = format!(
                "name = \"plate\"\n[[part]]\nname = \"plate\"\nshape = \"plate\"\nsize_m = [1, 1]\nfaces = [\"-z\"]\nmaterial = \"gloss\"\n\
                 [[material]]\nname = \"gloss\"\nreflectance = 0.9\n{model}\n"
            );
            let target = Target::parse("plate.toml", text).unwrap();
            let scene = Scene::with_sun(&target, SunOptions::default()).unwrap();
            let steps = if alpha == 0.0 { 1 } else { 200 };
            let (mut truth, mut shares) = (0.0, 0.0);
            for (i, k) in (0..steps).flat_map(|i| (0..steps).map(move |k| (i, k))) {
                let at = |i: i32| 4.0 * alpha * (f64::from(2 * i + 1) / f64::from(steps) - 1.0);
                let (x, y) = (at(i), at(k));
                let share = (-(x * x + y * y) / f64::max(alpha * alpha, 1e-300)).exp();
                let h = DVec3::new(x, y, -1.0).normalize();
                shares += share;
                truth += share * radiance(2.0 * h.dot(view) * h - view) * h.dot(view) / -h.z;
            }
            let truth = truth / shares;
            let earth =
                EarthAlbedo::tabulated("t", grid(5.0, &mut |row, column| table(row, column)));
            let mut earthshine = Earthshine::new(scene.evaluator(), 1e-3).of(Arc::new(earth));
            let (mut weights, mut errors) = (vec![0.0], vec![0.0]);
            let lighting = Lighting { sun_body: DVec3::Z, ..lighting(globe, view) };
            earthshine.add(&lighting, &mut weights, &mut errors).unwrap();
            let (found, stated) = (weights[0], errors[0]);
            let text = format!("table {number}, {tilt}, α {alpha}: {found} ± {stated}, {truth}");
            let own = if alpha == 0.0 { 1e-6 } else { 1e-2 };
            assert!((found - truth).abs() <= stated + own * truth && truth > 0.0, "{text}");
        }
    }
}

/// Truth: arithmetic. A table at two wavelengths has for each the light of a grey table of that layer, and between them the light on the line between the two; beyond them nothing is said, in
/// the terms' spectra. To rounding (1e-12) for the directions of one rule; on a body, where each Earth has its cap divided where its own light asks for it, within what is stated of both.
#[test]
fn layers_are_tables_of_their_own() {
    let mut rng = Rng::seed_from_u64(4);
    let places_deg: Vec<[f64; 2]> = (0..18 * 36)
        .map(|k| [(k / 36) as f64 * 10.0 - 85.0, (k % 36) as f64 * 10.0 - 175.0])
        .collect();
    let albedo: Vec<f64> = (0..2 * places_deg.len()).map(|_| rng.random::<f32>().into()).collect();
    let layer = |l: usize| albedo.iter().skip(l).step_by(2).copied().collect::<Vec<_>>();
    let make = |albedo: Vec<f64>, nm: &[f64]| {
        let cells = Cells { places_deg: places_deg.clone(), albedo };
        let grid = AlbedoGrid::new(&cells, nm, false, None).unwrap();
        Arc::new(EarthAlbedo::tabulated("t", grid))
    };
    let up = DVec3::new(0.2, -0.4, -0.9).normalize();
    let globe = Globe {
        toward: -up,
        distance_m: 7e6,
        radius_m: EARTH_M,
        sun: DVec3::new(0.6, 0.1, -0.4).normalize(),
        to_ground: rotation(&mut rng),
    };
    let light = |target: &Target, earth: Arc<EarthAlbedo>, nm: f64| {
        let scene = Scene::new(target).unwrap();
        let terms = shine::terms_of(&earth, &target.materials).unwrap();
        let mut weights = vec![0.0; terms.len()];
        let mut errors = weights.clone();
        let mut effect = Earthshine::new(scene.evaluator(), 1e-3).of(earth);
        effect.add(&lighting(globe, DVec3::new(0.0, 0.6, 0.8)), &mut weights, &mut errors).unwrap();
        let sum = |values: &[f64]| -> f64 {
            terms.iter().zip(values).map(|(t, w)| t.spectrum.at(nm) * w).sum()
        };
        (sum(&weights), sum(&errors), terms)
    };
    let both = make(albedo.clone(), &[450.0, 650.0]);
    let of = |earth: &EarthAlbedo, nm: f64| earth.shines(&globe, 8, nm);
    let (blue, red) = (of(&make(layer(0), &[]), 500.0), of(&make(layer(1), &[]), 500.0));
    let at = [450.0, 550.0, 650.0].map(|nm| of(&both, nm));
    for (i, ((_, b), (_, r))) in blue.iter().zip(&red).enumerate() {
        for (found, expected) in at.iter().zip([*b, 0.5 * (b + r), *r]) {
            assert!((found[i].1 - expected).abs() < 1e-12 * (b.abs() + r.abs()), "{i}");
        }
    }
    let near = |(a, da): (f64, f64), (b, db): (f64, f64)| {
        assert!(a > 0.0 && (a - b).abs() <= da + db, "{a} ± {da}, {b} ± {db}");
        assert!(da + db < 0.05 * a, "{a} ± {da}, ± {db}");
    };
    for target in [plate(), Target::built_in("box_wing").unwrap()] {
        let blue = light(&target, make(layer(0), &[]), 450.0);
        let red = light(&target, make(layer(1), &[]), 450.0);
        // At 450 nm the second layer is 0: its terms are compared where the materials are the same, at 450 nm by exchanging the layers.
        let first = light(&target, both.clone(), 450.0);
        near((first.0, first.1), (blue.0, blue.1));
        let mut exchanged = albedo.clone();
        exchanged.chunks_exact_mut(2).for_each(<[f64]>::reverse);
        let second = light(&target, make(exchanged, &[450.0, 650.0]), 450.0);
        near((second.0, second.1), (red.0, red.1));
        assert!(first.2.iter().all(|t| t.spectrum.range_nm() == (450.0, 650.0)));
        let middle = |earth| light(&target, earth, 550.0);
        let (mean, b, r) =
            (middle(both.clone()), middle(make(layer(0), &[])), middle(make(layer(1), &[])));
        near((mean.0, mean.1), (0.5 * (b.0 + r.0), 0.5 * (b.1 + r.1)));
    }
}

/// Truth: proportion. What an engine has of a table of one value is what it has over an even Earth of that value: bounced light by the same points and paths to 1e-6 (the table's numbers), light that is
/// scattered once by a rule of another order, to what is asked of it (a fifth of the tolerance at most; 1e-3 here, with tolerances of 0.3 % and, where light paths are, 1 %, for the sake of time). A table of twice the value in all that is in sight of the body has twice the light, whatever it has elsewhere; one that is dark there none (to the
/// rounding of sums; by patches). Of a corner, which exchanges light by patches, and of a sphere beside a plate, by light paths.
#[test]
fn bounced_earthshine_follows_the_table() {
    let sphere = "[[part]]\nname = \"sphere\"\nshape = \"sphere\"\nradius_m = 0.4\noffset_m = [0, 0, 0.5]\nmaterial = \"white\"\n\
        [[part]]\nname = \"plate\"\nshape = \"box\"\nsize_m = [1, 1, 0.02]\nmaterial = \"white\"\n\
        [[material]]\nname = \"white\"\nmodel = \"lambert\"\nreflectance = 0.9\n";
    let sphere = Target::parse("sphere.toml", sphere).unwrap();
    for (target, way, tolerance) in
        [(Target::built_in("corner").unwrap(), "patches", 3e-3), (sphere, "light paths", 1e-2)]
    {
        let sent = |earth| sent(&target, (way, tolerance), earth);
        let [direct, bounced] = sent(EarthAlbedo::default());
        assert!(bounced > 0.03 * direct && direct > 0.0, "{direct} {bounced}");
        let table = |north: f64, south: f64| {
            let value = move |row: usize, _: usize| if row >= 18 { north } else { south };
            sent(EarthAlbedo::tabulated("t", grid(5.0, &mut { value })))
        };
        let [same, also] = table(0.30, 0.30);
        assert!((same / direct - 1.0).abs() < 1e-3, "{same} {direct}");
        assert!((also / bounced - 1.0).abs() < 1e-6, "{also} {bounced}");
        let [double, twice] = table(0.60, 0.90);
        assert!((double / same - 2.0).abs() < 1e-6 && (twice / also - 2.0).abs() < 1e-6);
        if way == "patches" {
            let [dark, darker] = table(0.0, 0.9);
            assert!(dark < 1e-12 * direct && darker < 1e-12 * direct, "{dark} {darker}");
        }
    }
}

/// Returns the light that the Earth below the north pole of its axes sends by a body: scattered once, and more often; bounces are found in some way.
fn sent(target: &Target, (way, tolerance): (&str, f64), earth: EarthAlbedo) -> [f64; 2] {
    let sun = DVec3::new(-0.9, -0.3, -0.4).normalize();
    let toward = DVec3::ONE.normalize();
    let to_ground = DQuat::from_rotation_arc(-toward, DVec3::Z);
    let globe = Globe { toward, distance_m: 6.9e6, radius_m: EARTH_M, sun, to_ground };
    let options = Options { tolerance, ..Options::default() };
    let course = Course { earthshine: engine::earthshine(&globe, 0.45), ..Course::default() };
    let engine = Engine::over(target, &options, &course, &Arc::new(earth)).unwrap();
    let need = engine.needs().iter().find(|n| n.effect == "bounced earthshine").unwrap();
    assert!(need.is_modelled() && need.why.contains(way), "{need:?}");
    let mut weights = vec![0.0; engine.terms().len()];
    let mut errors = weights.clone();
    let lighting = lighting(globe, DVec3::new(0.6, 0.8, 0.5).normalize());
    engine.worker().light(&lighting, &mut weights, &mut errors).unwrap();
    let of = |once: bool| {
        let own = engine.terms().iter().zip(&weights);
        let own =
            own.filter(|(t, _)| t.source == Source::Earthshine && t.material.is_some() == once);
        own.map(|(t, w)| t.spectrum.at(550.0) * w).sum::<f64>()
    };
    [of(true), of(false)]
}
