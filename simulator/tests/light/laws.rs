//! Invariants that physics and geometry demand.

use super::scenes::*;
use glam::DVec3;
use rand::RngExt as _;
use sunglint_simulator::light::{Scene, View};
use sunglint_simulator::mesh::Mesh;
use sunglint_simulator::target::Shape;

const SCENES: u64 = 160;

/// Truth: the laws of the space we live in. Turned and moved together nothing changes: 1e-12 of the most that W could be (the sum of some
/// hundred roundings), and no more than both claimed errors together (plus 2e-15 for sums without shadows).
#[test]
fn turning_and_moving_change_nothing() {
    let (mut worst, mut claimed) = (0.0_f64, 0.0_f64);
    for seed in 0..SCENES {
        let one = scene(seed);
        let mut rng = rng(10_000 + seed);
        let (sun, to) = directions(&mut rng);
        let rotation = turn(&mut rng);
        let other = turned(&one, rotation, 0.3 * direction(&mut rng));
        let (a, ea) = total(&one, sun, View::Distant(to));
        let (b, eb) = total(&other, rotation * sun, View::Distant(rotation * to));
        let off = (a - b).abs() / most(&one);
        worst = worst.max(off);
        let claim = (ea + eb) / most(&one) + 2e-15;
        claimed = claimed.max(off / claim);
        assert!(off < 1e-12, "{seed}: {a} {b} {off:.1e}");
        assert!(off <= claim, "{seed}: {off:.1e}, claimed {claim:.1e}");
    }
    eprintln!("turning: {worst:.1e}; {claimed:.2} of the claimed error");
}

/// Each triangle falls into several: about a point inside, by a point on an edge that the neighbour does not have (a T-junction), or with
/// a sliver.
fn split(mesh: &Mesh, sliver: f64, rng: &mut Rng) -> Mesh {
    let mut out = Mesh { vertices: mesh.vertices.clone(), ..Mesh::default() };
    for (t, &[a, b, c]) in mesh.triangles.iter().enumerate() {
        let [pa, pb, pc] = mesh.corners(t);
        let new = out.vertices.len() as u32;
        match rng.random::<u32>() % 4 {
            0 => {
                let (u, v) = (rng.random::<f64>() * 0.5, rng.random::<f64>() * 0.5);
                out.vertices.push(pa + u * (pb - pa) + v * (pc - pa));
                out.triangles.extend([[a, b, new], [b, c, new], [c, a, new]]);
            }
            1 => {
                out.vertices.push(pa + rng.random::<f64>() * (pb - pa));
                out.triangles.extend([[a, new, c], [new, b, c]]);
            }
            2 => {
                out.vertices.push(pa + sliver * (pb - pa));
                out.triangles.extend([[a, new, c], [new, b, c]]);
            }
            _ => out.triangles.push([a, b, c]),
        }
    }
    out
}

/// Truth: a surface does not know its triangles. Split in several ways W stays the same to 1e-12 of its most; the order of the parts and
/// of the triangles likewise. Where faces of several bodies lie in one plane (every fourth scene), overlaps narrower than the touching
/// tolerance are left alone, and the planes of slivers are known badly: there 1e-9 (4e-10 is met). The claimed error covers both.
#[test]
fn splitting_and_order_change_nothing() {
    let (mut worst, mut claimed) = ([0.0_f64; 2], 0.0_f64);
    for seed in 0..SCENES {
        let one = scene(seed);
        let mut rng = rng(20_000 + seed);
        let (sun, to) = directions(&mut rng);
        let view = View::Distant(to);
        let (a, ea) = total(&one, sun, view);
        let mut finer = one.clone();
        let mut shuffled = one.clone();
        for part in &mut finer.parts {
            let Shape::Mesh(mesh) = &mut part.shape else { continue };
            // Slivers of slivers would be narrower than what counts as one place.
            *mesh = split(&split(mesh, 0.3, &mut rng), 1e-6, &mut rng);
        }
        shuffled.parts.reverse();
        shuffled.parts.rotate_left((seed % 5) as usize);
        for part in &mut shuffled.parts {
            let Shape::Mesh(mesh) = &mut part.shape else { continue };
            mesh.triangles.reverse();
            mesh.triangles.iter_mut().for_each(|t| t.rotate_left((seed % 3) as usize));
        }
        for (what, other) in [("split", finer), ("shuffled", shuffled)] {
            let (b, eb) = total(&other, sun, view);
            let off = (a - b).abs() / most(&one);
            let on_grid = seed % KINDS == 3;
            worst[usize::from(on_grid)] = worst[usize::from(on_grid)].max(off);
            let limit = if on_grid { 10.0 * Scene::TOUCHING } else { 1e-12 };
            let claim = (ea + eb) / most(&one) + 2e-15;
            claimed = claimed.max(off / claim);
            assert!(off < limit, "{what} {seed}: {a} {b} {off:.1e}");
            assert!(off <= claim, "{what} {seed}: {off:.1e}, claimed {claim:.1e}");
        }
    }
    eprintln!("splitting: {:.1e}, on a grid {:.1e}; {claimed:.2} of the claim", worst[0], worst[1]);
}

/// Truth: Helmholtz. What is lit and seen stays so when the light turns round: 1e-12 of the most, for each part.
#[test]
fn reciprocity() {
    let mut worst = 0.0_f64;
    for seed in 0..SCENES {
        let one = scene(seed);
        let (sun, to) = directions(&mut rng(30_000 + seed));
        let a = weights(&one, sun, View::Distant(to));
        let b = weights(&one, to, View::Distant(sun));
        for (a, b) in a.iter().zip(&b) {
            worst = worst.max((a - b).abs() / most(&one));
        }
        assert!(worst < 1e-12, "{seed}: {a:?} {b:?}");
    }
    eprintln!("reciprocity: {worst:.1e}");
}

/// Truth: the list of pairs, itself held to rays and exact sums elsewhere. The index of each direction finds the same: 1e-13 of the most.
/// And the parts sum up to the whole: 1e-14.
#[test]
fn index_and_pairs_and_parts() {
    let mut worst = 0.0_f64;
    let mut compare = |one: &sunglint_simulator::target::Target, seed: u64, views: usize| {
        let (pairs, index) = (Scene::new(one).unwrap(), Scene::with_most_pairs(one, 0).unwrap());
        assert!(pairs.report().occluder_pairs.is_some());
        assert!(index.report().occluder_pairs.is_none());
        let mut rng = rng(40_000 + seed);
        for _ in 0..views {
            let (sun, to) = directions(&mut rng);
            for view in [View::Distant(to), View::At(4.0 * to)] {
                if matches!(view, View::At(_)) && views > 2 && !seed.is_multiple_of(10) {
                    continue;
                }
                let (a, b) = (evaluate(&pairs, sun, view).0, evaluate(&index, sun, view).0);
                let by = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                worst = worst.max(by / most(one));
                // From a point a piece's shape sets the error of its quadrature.
                let limit = if matches!(view, View::At(_)) { 1e-10 } else { 1e-13 };
                assert!(by <= limit * most(one), "{seed} {view:?}: {a:?} {b:?}");
                let stride = pairs.weight_count();
                let mut each = vec![0.0; stride * pairs.part_count()];
                pairs.evaluator().direct_by_part(sun, view, &mut each).unwrap();
                for (k, a) in a.iter().enumerate() {
                    let sum: f64 = each.iter().skip(k).step_by(stride).sum();
                    assert!((sum - a).abs() <= 1e-14 * most(one), "{seed}: {sum} {a}");
                }
            }
        }
    };
    for seed in 0..200 {
        compare(&scene(seed), seed, 3);
    }
    for (seed, count) in [(1000, 90), (1001, 200)] {
        compare(&dense(count, seed), seed, 1);
    }
    eprintln!("index against pairs: {worst:.1e}");
}

/// Truth: rays (4 σ for each of the parts that 20 rays or more meet, else the floor). About 700 and 1,300 facets.
#[test]
fn dense_bodies_by_rays() {
    for (seed, count) in [(2000, 90), (2001, 180)] {
        let one = dense(count, seed);
        let (sun, to) = directions(&mut rng(seed));
        let view = View::Distant(to);
        let out = weights(&one, sun, view);
        let found = rays(&one, sun, view, 25_000, seed);
        let (w, variance) = found.iter().fold((0.0, 0.0), |(w, v), (a, s)| (w + a, v + s * s));
        let ours: f64 = out.iter().sum();
        assert!((ours - w).abs() < 4.0 * variance.sqrt(), "{seed}: {ours} {w} {variance}");
        let off = (out[0] - found[0].0).abs() / found[0].1.max(1e-3);
        eprintln!("dense {count}: {:.2} sigma, body {off:.2}", (ours - w) / variance.sqrt());
        assert!(off < 4.0);
    }
}

/// Truth: rays, 4 σ for each part of each of 12 scenes that touch nowhere (the points of touching faces lie on both).
#[test]
fn parts_by_rays() {
    for seed in [100, 101, 102, 104, 105, 106, 108, 109, 110, 112, 113, 114] {
        let (sun, to) = directions(&mut rng(50_000 + seed));
        agree_with_rays(&scene(seed), sun, View::Distant(to), 20_000, 3e-3, seed);
    }
}

/// Truth: none is needed; at 180° what is lit is never what is seen.
#[test]
fn looking_at_the_sun() {
    for seed in 0..20 {
        let sun = direction(&mut rng(seed));
        assert!(weights(&scene(seed), sun, View::Distant(-sun)).iter().all(|w| *w == 0.0));
        let one = target([(Shape::Sphere { radius_m: 1.0 }, DVec3::ZERO)]);
        assert!(weights(&one, sun, View::Distant(-sun))[0].abs() < 1e-15);
    }
}
