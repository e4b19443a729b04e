//! Cases of the benchmark: engines on scenes.

use super::timing::{self, Timing};
use super::{BenchRow, CaseError};
use crate::light::{DirectionError, Evaluator, Scene, View};
use crate::mesh::shapes::{Faceting, icosphere};
use crate::pass::Pass;
use crate::scenes::{self, BenchScene};
use crate::target::{Shape, Target};
use glam::{DQuat, DVec3};
use std::time::{Duration, Instant};
use sunglint_radiometry::quadrature::Product;
use sunglint_radiometry::spectrum::{Reflectance, Spectrum, SpectrumError};

/// Subdivisions of the icosahedra that stand for the sphere: 20 × 4ⁿ triangles.
const LADDER: [u32; 6] = [1, 2, 3, 4, 5, 6];
/// Tolerances at which big meshes are measured too, with the engines' names.
const TOLERANCES: [(f64, &str); 4] = [
    (5e-2, "tolerance 5e-2"),
    (3e-2, "tolerance 3e-2"),
    (1e-2, "tolerance 1e-2"),
    (3e-3, "tolerance 3e-3"),
];
/// The scene that is sampled.
const SAMPLED: &str = "dense_satellite";
/// Bins that each engine is measured with: grey, and a spectrum.
const GRIDS: [usize; 2] = [1, scenes::BINS];
/// Directions that are evaluated in turn.
const DIRECTIONS: usize = 61;
/// How far Sun and observer are turned from those of the scene, radians: little enough for the same facets, enough to leave nothing to remember.
const TURN_RAD: f64 = 1e-3;
/// Rows of a scene file.
pub(super) const PASS_ROWS: usize = 2;

/// Where rows go as they are measured.
type Done<'a> = &'a mut dyn FnMut(BenchRow) -> Result<(), CaseError>;

/// The rows of a built-in scene.
pub(super) fn count(name: &str) -> usize {
    GRIDS.len()
        * match name {
            "lambert_sphere" => 1 + LADDER.len(),
            SAMPLED => 1 + TOLERANCES.len(),
            _ => 1,
        }
}

/// Measures a built-in scene.
pub(super) fn built_in(name: &str, budget: Duration, done: Done) -> Result<(), CaseError> {
    let scene = BenchScene::new(name)?;
    engine("exact", &scene, &scene.target, 0.0, budget, done)?;
    if name == SAMPLED {
        for (tolerance, name) in TOLERANCES {
            engine(name, &scene, &scene.target, tolerance, budget, done)?;
        }
    }
    if name == "lambert_sphere" {
        for subdivisions in LADDER {
            let mut target = scene.target.clone();
            for part in &mut target.parts {
                if let Shape::Sphere { radius_m } = part.shape {
                    part.shape = Shape::Mesh(icosphere(radius_m, subdivisions, Faceting::SameArea));
                }
            }
            engine("icosphere", &scene, &target, 0.0, budget, done)?;
        }
    }
    Ok(())
}

/// Measures one target, grey and with a spectrum, in the place of the scene's.
fn engine(
    engine: &'static str,
    scene: &BenchScene,
    target: &Target,
    tolerance: f64,
    budget: Duration,
    done: Done,
) -> Result<(), CaseError> {
    let start = Instant::now();
    let prepared = Scene::with_tolerance(target, tolerance)?;
    let prepare_s = start.elapsed().as_secs_f64();
    let directions = directions(scene.sun_body, scene.view_body);
    for bins in GRIDS {
        let spectral = bins > 1;
        let factors = prepared
            .spectra()
            .map(|rho| if spectral { scenes::bin_means(rho) } else { Ok(vec![scenes::grey(rho)?]) })
            .collect::<Result<Vec<_>, SpectrumError>>()?;
        let mut epochs = Epochs::new(&prepared, &factors, bins);
        let (estimate, values) = epochs.at(scene.sun_body, scene.view_body)?;
        let error = scene.truth.as_ref().map(|truth| {
            let grey = [truth.grey_m2_sr];
            relative_error(values, if spectral { &truth.bins_w_sr_nm } else { &grey })
        });
        let timing = timing::time(budget, |number| epochs.one(&directions, number))?;
        done(BenchRow {
            scene: scene.name.to_owned(),
            engine,
            bins,
            facets: prepared.report().facets,
            timing,
            prepare_s: Some(prepare_s),
            error,
            error_source: scene.truth.as_ref().map_or("none", |truth| truth.source.name()),
            estimate: Some(estimate),
        })?;
    }
    Ok(())
}

/// Σ|E − Ê|/ΣÊ.
fn relative_error(found: &[f64], truth: &[f64]) -> f64 {
    let apart: f64 = found.iter().zip(truth).map(|(a, b)| (a - b).abs()).sum();
    apart / truth.iter().sum::<f64>()
}

/// A prepared scene with what turns its weights into a spectrum.
struct Epochs<'a> {
    evaluator: Evaluator<'a>,
    weights: Vec<f64>,
    /// For each weight what it adds to each bin.
    factors: &'a [Vec<f64>],
    bins: Vec<f64>,
}

impl<'a> Epochs<'a> {
    fn new(scene: &'a Scene, factors: &'a [Vec<f64>], bins: usize) -> Self {
        let weights = vec![0.0; scene.weight_count()];
        Self { evaluator: scene.evaluator(), weights, factors, bins: vec![0.0; bins] }
    }

    /// The engine's own estimate of its error, and the value of every bin.
    fn at(&mut self, sun: DVec3, view: DVec3) -> Result<(f64, &[f64]), DirectionError> {
        let done = self.evaluator.direct(sun, View::Distant(view), &mut self.weights)?;
        self.bins.fill(0.0);
        for (weight, factors) in self.weights.iter().zip(self.factors) {
            for (bin, factor) in self.bins.iter_mut().zip(factors) {
                *bin += weight * factor;
            }
        }
        Ok((done.error, &self.bins))
    }

    /// One epoch of many, at one of the directions.
    fn one(&mut self, directions: &[(DVec3, DVec3)], number: usize) -> Result<f64, DirectionError> {
        let (sun, view) = directions[number % directions.len()];
        self.at(sun, view)?;
        // All bins are wanted: a sum of one of them would let the others be left out.
        let bins = std::hint::black_box(&self.bins);
        Ok(bins[number % bins.len()])
    }
}

/// Directions about those of a scene: axes in a golden spiral, so that they come near no pattern.
fn directions(sun: DVec3, view: DVec3) -> Vec<(DVec3, DVec3)> {
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let axis = |k: usize, start: f64| {
        let z: f64 = 1.0 - (2.0 * k as f64 + 1.0) / DIRECTIONS as f64;
        let (sin, cos) = (start + golden * k as f64).sin_cos();
        let across = (1.0 - z * z).sqrt();
        DVec3::new(across * cos, across * sin, z)
    };
    (0..DIRECTIONS)
        .map(|k| {
            let other = k * 7 % DIRECTIONS;
            let turn = |v: DVec3, axis: DVec3| DQuat::from_axis_angle(axis, TURN_RAD) * v;
            (turn(sun, axis(k, 0.0)), turn(view, axis(other, 1.0)))
        })
        .collect()
}

/// Measures a scene file: the whole way from orbit to counts, and the light engine with its spectra alone, over the epochs of the file.
pub(super) fn pass(pass: &Pass, budget: Duration, done: Done) -> Result<(), CaseError> {
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    let simulate = || one_thread.install(|| pass.simulate(&|_| {}));
    let simulation = simulate()?;
    let epochs = pass.times.len();
    let whole = timing::time(budget, |_| simulate().map(|s| s.weights.sum()))?;
    let per_epoch = |timing: Timing| Timing {
        median_s: timing.median_s / epochs as f64,
        fastest_s: timing.fastest_s / epochs as f64,
        epochs: timing.epochs * epochs,
        ..timing
    };
    let row = |engine, facets, timing, prepare_s, estimate| BenchRow {
        scene: pass.name.clone(),
        engine,
        bins: pass.bins(),
        facets,
        timing,
        prepare_s,
        error: None,
        error_source: "none",
        estimate: Some(estimate),
    };
    let estimate = simulation.bounds.light_relative;
    let facets = simulation.scene.facets;
    done(row("pipeline", facets, per_epoch(whole), None, estimate))?;

    let start = Instant::now();
    let scene = Scene::new(&pass.target)?;
    let prepare_s = start.elapsed().as_secs_f64();
    let factors =
        scene.spectra().map(|rho| means(pass, rho)).collect::<Result<Vec<_>, SpectrumError>>()?;
    let directions: Vec<(DVec3, DVec3)> =
        simulation.places.iter().map(|place| (place.sun_body, place.observer_body)).collect();
    let mut epochs = Epochs::new(&scene, &factors, pass.bins());
    let alone = timing::time(budget, |number| epochs.one(&directions, number))?;
    done(row("exact", facets, alone, Some(prepare_s), estimate))
}

/// Means of E·ρ over the bins of a pass, at 1 au.
fn means(pass: &Pass, rho: &Spectrum<Reflectance>) -> Result<Vec<f64>, SpectrumError> {
    let integrals = Product::of(&pass.sun).times(rho).bins(&pass.edges_nm)?;
    let widths = pass.edges_nm.windows(2).map(|e| e[1] - e[0]);
    Ok(integrals.iter().zip(widths).map(|(i, width)| i.value / width).collect())
}
