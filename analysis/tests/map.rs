//! Maps on the body's frame against closed forms and simulated spins.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use glam::DVec3;
use ndarray::Array2;
use std::f64::consts::PI;
use sunglint_analysis::map::{
    BodyMap, Grid, QualityError, Sighting, Spin, longitude_latitude, phase_vector, quality, scan,
};
use sunglint_simulator::light::engine::Switches;
use sunglint_simulator::pass::{Overrides, PassFile};

/// Truth: the axes themselves, and that the bisector of two directions has the same angle to both; opposite directions have none.
#[test]
fn phase_vectors_are_bisectors() {
    assert_eq!(longitude_latitude(DVec3::Y), (90.0, 0.0));
    assert_eq!(longitude_latitude(-DVec3::Z), (0.0, -90.0));
    let (sun, observer) = (DVec3::new(1.0, 2.0, -0.5), DVec3::new(-0.3, 0.8, 2.0));
    let middle = phase_vector(sun, observer).unwrap();
    assert!((middle.angle_between(sun) - middle.angle_between(observer)).abs() < 1e-15);
    assert!((sun.cross(observer).dot(middle)).abs() < 1e-15);
    assert!(
        phase_vector(DVec3::X, -DVec3::X).is_none()
            && phase_vector(DVec3::ZERO, DVec3::X).is_none()
    );
}

/// Truth: areas on the sphere add up to all of it; every middle lies in its own cell; edges belong to one cell each.
#[test]
fn a_grid_covers_the_sphere_once() {
    for step in [0.7, 1.0, 7.5, 90.0, 180.0 / 7.0] {
        let grid = Grid::new(step).unwrap();
        let (rows, columns) = grid.dim();
        assert!(
            grid.step_deg() <= step * (1.0 + 1e-9) && (rows as f64 - 1.0) * step < 180.0,
            "{step}"
        );
        let sum: f64 = (0..rows).map(|r| grid.share(r) * columns as f64).sum();
        assert!((sum - 1.0).abs() < 1e-13);
        for cell in [(0, 0), (rows / 2, columns / 3), (rows - 1, columns - 1)] {
            assert_eq!(grid.cell(grid.middle(cell)), Some(cell));
            let (longitude, latitude) = longitude_latitude(grid.direction(cell));
            let (l, b) = grid.middle(cell);
            assert!((longitude - l).abs() < 1e-12 && (latitude - b).abs() < 1e-12);
        }
        assert_eq!(grid.cell((180.0, 90.0)), Some((rows - 1, 0)));
        assert_eq!(grid.cell((-900.0, -90.0)), Some((0, 0)));
        assert_eq!(grid.cell((f64::NAN, 0.0)), None);
    }
    assert!(Grid::new(0.0).is_err() && Grid::new(f64::NAN).is_err());
}

/// Truth: done by hand: means, deviations and counts of a handful of samples; a cell without any is NaN and counted as empty.
#[test]
fn cells_hold_what_fell_into_them() {
    let grid = Grid::new(90.0).unwrap();
    let places =
        [(10.0, 20.0), (40.0, 60.0), (-100.0, 5.0), (0.0, -1.0), (f64::NAN, 0.0), (1.0, 1.0)];
    let values = [1e9 + 1.0, 1e9 + 3.0, 7.0, f64::NAN, 1.0, 1e9 + 5.0];
    let map = BodyMap::of(grid, &places, &values).unwrap();
    assert_eq!((map.mean[(1, 2)], map.scatter[(1, 2)], map.count[(1, 2)]), (1e9 + 3.0, 2.0, 3));
    assert_eq!((map.mean[(1, 0)], map.count[(1, 0)]), (7.0, 1));
    assert!(map.scatter[(1, 0)].is_nan() && map.mean[(0, 2)].is_nan());
    let coverage = map.coverage();
    assert_eq!((coverage.filled, coverage.empty, coverage.left_out), (2, 6, 2));
    assert!((coverage.share - 0.25).abs() < 1e-15);
    assert!(BodyMap::of(grid, &places, &[1.0]).is_err());
    assert!(BodyMap::full(grid, Array2::zeros((3, 3))).is_err());
}

/// Truth: a smooth function on the sphere: linear interpolation errs by at most h²/8 times its second derivatives (two directions), also across the date line and the poles; a linear
/// function of longitude and latitude between middles is met exactly.
#[test]
fn between_the_middles_a_map_is_linear() {
    let grid = Grid::new(2.0).unwrap();
    let f = |d: DVec3| 2.0 + d.x * d.y + d.z;
    let map =
        BodyMap::full(grid, Array2::from_shape_fn(grid.dim(), |c| f(grid.direction(c)))).unwrap();
    let h = 2.0_f64.to_radians();
    for k in 0..4000 {
        let z = 2.0 * (f64::from(k) + 0.5) / 4000.0 - 1.0;
        let angle = 2.399_963_229_728_653 * f64::from(k);
        let r = (1.0 - z * z).sqrt();
        let direction = DVec3::new(r * angle.cos(), r * angle.sin(), z);
        let found = map.at(longitude_latitude(direction)).unwrap();
        // |∂²f/∂b²| ≤ 3, |∂²f/∂l²| ≤ 2.
        assert!((found.value - f(direction)).abs() <= 5.0 * h * h / 8.0 * 1.01, "{k}");
    }
    let mut holed = map.clone();
    holed.mean[(45, 90)] = f64::NAN;
    let (l, b) = grid.middle((45, 90));
    assert!(holed.at((l + 0.5, b)).is_none() && holed.at((l + 2.0, b)).is_some());
    assert!(map.at((0.0, 91.0)).is_none());
}

fn sightings(step_s: f64, period_s: f64) -> (Vec<Sighting>, DVec3) {
    let path = sunglint_testkit::repository().join("fixtures/scenes/box_wing_dusk.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    let text = text.replace("period_s = 120.0", &format!("period_s = {period_s:?}"));
    let text = text.replace("step_s = 0.5", &format!("step_s = {step_s:?}"));
    let mut pass = PassFile::parse(&path, &text).unwrap().resolve(Overrides::default()).unwrap();
    // Sunlight alone: the spin shows in it, and it is quick.
    pass.effects = Switches::OFF;
    let simulation = pass.simulate(&|_| ()).unwrap();
    let first = pass.times[0];
    let mut all = Vec::new();
    for (i, place) in simulation.places.iter().enumerate() {
        let light: f64 = simulation.weights.row(i).sum();
        if light > 0.0 {
            all.push(Sighting {
                time_s: (place.geometry.emitted - first).to_seconds(),
                to_sun: place.geometry.sun.direction_gcrs,
                to_observer: place.geometry.to_observer,
                value: light.sqrt(),
            });
        }
    }
    (all, DVec3::new(-0.30, 0.10, 0.95).normalize())
}

/// Truth: the spin with which the box-wing satellite was simulated (5 s about a known axis, a pass with phase angles from 89° to 114°). The measure is small near it. Under the Sun light is no function of
/// the phase vector alone, so that a frame that drifts a little absorbs a part of that: the period is found to a part in some hundreds, the axis hardly at all from one pass.
/// Tolerance: the period within 0.25 % (the drift of a cell of 3° in three turns) among ±10 %; the measure at the truth within a quarter of the smallest of all periods, and of all axes within
/// 60°, of which most are far above it.
#[test]
fn samples_agree_best_near_the_true_spin() {
    let (all, axis) = sightings(0.05, 5.0);
    let grid = Grid::new(3.0).unwrap();
    let periods: Vec<Spin> =
        (-200..=200).map(|k| Spin { axis, period_s: 5.0 + 0.0025 * f64::from(k) }).collect();
    let found = scan(&all, &periods, grid).unwrap();
    let best = (0..found.len()).min_by(|a, b| found[*a].theta.total_cmp(&found[*b].theta)).unwrap();
    println!("period {} {:?}; at the truth {:?}", periods[best].period_s, found[best], found[200]);
    assert!((periods[best].period_s - 5.0).abs() <= 0.0126, "{}", periods[best].period_s);
    assert!(found[200].theta < 1.2 * found[best].theta && found[0].theta > 0.3);

    let (ra, _) = longitude_latitude(axis);
    let mut axes = Vec::new();
    for a in -6..=6 {
        for d in -6..=6 {
            // On great circles about the true axis.
            let (x, y) = (f64::from(a) * 10.0, f64::from(d) * 10.0);
            let east = Spin::of(ra + 90.0, 0.0, 1.0).axis;
            let north = axis.cross(east);
            let way = (x.to_radians(), y.to_radians());
            let far = way.0.hypot(way.1);
            let tangent = if far > 0.0 { (way.0 * east + way.1 * north) / far } else { east };
            axes.push(Spin { axis: far.cos() * axis + far.sin() * tangent, period_s: 5.0 });
        }
    }
    let found = scan(&all, &axes, grid).unwrap();
    let best = (0..found.len()).min_by(|a, b| found[*a].theta.total_cmp(&found[*b].theta)).unwrap();
    let off = axes[best].axis.angle_between(axis).to_degrees();
    println!(
        "axis off by {off:.1}° theta {:.4}, at the truth {:.4}",
        found[best].theta, found[84].theta
    );
    let mut all: Vec<f64> = found.iter().map(|q| q.theta).collect();
    all.sort_by(f64::total_cmp);
    println!("a quarter of the axes lies below {:.4}, half below {:.4}", all[42], all[84]);
    assert!(found[84].theta < 1.25 * all[0] && all[42] > 1.25 * all[0]);
}

/// Truth: what is random on every frame has a measure of 1 on the average; what depends on the body alone one near 0; too little or constant data are refused.
#[test]
fn agreement_is_one_for_noise_and_zero_for_a_map() {
    let spin = Spin::of(30.0, 40.0, 7.0);
    let mut state = 1_u64;
    let mut random = || {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    let mut all = Vec::new();
    for k in 0..4000 {
        let (z, l) = (2.0 * random() - 1.0, 2.0 * PI * random());
        let r = (1.0 - z * z).sqrt();
        let to_sun = DVec3::new(r * l.cos(), r * l.sin(), z);
        let value = random();
        all.push(Sighting { time_s: f64::from(k) * 0.37, to_sun, to_observer: to_sun, value });
    }
    let grid = Grid::new(10.0).unwrap();
    let noise = quality(&all, spin, grid).unwrap();
    // 4,000 samples in 648 cells: a standard error of about 0.03.
    assert!((noise.theta - 1.0).abs() < 0.1, "{noise:?}");
    assert!(noise.visits > 3500);
    for s in &mut all {
        s.value = s.to_sun.dot(spin.axis);
    }
    assert!(quality(&all, spin, grid).unwrap().theta < 0.02);
    let refused = |all: &[Sighting], spin: Spin| quality(all, spin, grid).unwrap_err();
    assert!(matches!(refused(&all[..2], spin), QualityError::Few { samples: 2 }));
    assert!(matches!(refused(&all, Spin { period_s: 0.0, ..spin }), QualityError::Spin { .. }));
    for s in &mut all {
        s.value = 3.0;
    }
    assert!(matches!(refused(&all, spin), QualityError::Constant { .. }));
}
