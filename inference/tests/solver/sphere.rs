//! Spheres: albedos, and the roughness of one.

use crate::solver::binomial;
use crate::solver::night::{Weather, measured, orbit, over, scene, visible};
use ndarray::Array2;
use std::f64::consts::PI;
use std::sync::OnceLock;
use sunglint_inference::solver::{
    Component, Data, Fit, Free, Law, Linear, Loss, Options, Shaping, StudyModel, Unit, fit,
};
use sunglint_radiometry::air::Zenith;
use sunglint_radiometry::spectrum::Spectrum;
use sunglint_simulator::pass::{Pass, Study};
use sunglint_simulator::surface::{Distribution, Fresnel, Lobe, Masking, Material};
use sunglint_simulator::target::Target;
use sunglint_testkit::Campaign;

/// Table 7.2 of the thesis: r, g, b, id400, spcm, mppc. It has no ID400 of CalSphere 4A.
const CALSPHERE_4A: [f64; 6] = [0.75, 0.73, 0.70, 0.75, 0.76, 0.86];
const LCS_1: [f64; 6] = [0.67, 0.73, 0.66, 0.72, 0.73, 0.63];
const LCS_1_ALPHA: f64 = 0.12;

/// Rates of a channel from sunlight as it is, at the distance of the Sun, through the air, by the station's own integral: no light engine, no table of
/// the air. Hz per unit of irradiance reflected towards the station, that is at 1 m per m² sr⁻¹.
fn sunlight(pass: &Pass, study: &Study) -> Array2<f64> {
    let air = pass.air.as_ref().unwrap();
    let mut rates = Array2::zeros((study.places().len(), pass.station.channels.len()));
    for (place, mut row) in study.places().iter().zip(rates.rows_mut()) {
        let zenith = Zenith::Apparent(place.apparent_zenith_deg.unwrap());
        let through = air.spectrum(zenith, (300.0, 1240.0)).unwrap();
        let here = place.geometry.sun.distance_au().powi(-2) * place.geometry.range_m.powi(-2);
        for (channel, rate) in pass.station.channels.iter().zip(&mut row) {
            *rate = here * pass.station.rate_hz(channel, &pass.sun, Some(&through)).value;
        }
    }
    rates
}

/// Radiant intensity of a Lambert sphere of reflectance 1 in unit irradiance: physics as of Lambert 1760.
fn diffuse(radius_m: f64, phase: f64) -> f64 {
    radius_m.powi(2) * 2.0 / (3.0 * PI) * (phase.sin() + (PI - phase) * phase.cos())
}

/// The same of a sphere of Beckmann microfacets that reflect all: f cosθ_i cosθ_o over what is lit and seen, f = D G₁G₁/(4 cosθ_i cosθ_o), by the midpoint
/// rule in the plane of Sun and observer's longitude and sine of latitude.
fn beckmann(radius_m: f64, alpha: f64, phase: f64) -> f64 {
    let g1 = |cos: f64| {
        let tan = (1.0 - cos * cos).sqrt() / cos;
        let a = 1.0 / (alpha * tan);
        // erf by its series in closed form of Abramowitz and Stegun 7.1.26 is too coarse: libm's.
        2.0 / (1.0 + libm::erf(a) + (-a * a).exp() / (a * PI.sqrt()))
    };
    let (n_long, n_sine) = (800, 400);
    let mut sum = 0.0;
    let half = 0.5 * phase;
    for k in 0..n_sine {
        let sine = (f64::from(k) + 0.5) / f64::from(n_sine);
        let cos = (1.0 - sine * sine).sqrt();
        // Lit and seen: longitudes from −π/2 + γ/2 to π/2 − γ/2 about the bisector.
        let most = 0.5 * PI - half;
        for j in 0..n_long {
            let longitude = most * (2.0 * (f64::from(j) + 0.5) / f64::from(n_long) - 1.0);
            let (i, o) = (cos * (longitude - half).cos(), cos * (longitude + half).cos());
            // The half-vector is the bisector.
            let m = cos * longitude.cos();
            if i <= 0.0 || o <= 0.0 {
                continue;
            }
            let tan2 = (1.0 - m * m) / (m * m);
            let d = (-tan2 / alpha.powi(2)).exp() / (PI * alpha.powi(2) * m.powi(4));
            sum += 0.25 * d * g1(i) * g1(o);
        }
    }
    // Both hemispheres of latitude.
    2.0 * radius_m.powi(2) * sum * (2.0 * (0.5 * PI - half) / f64::from(n_long)) / f64::from(n_sine)
}

fn sphere_of(radius_m: f64, material: Material) -> Target {
    let text = format!(
        "[[part]]\nname = \"sphere\"\nshape = \"sphere\"\nradius_m = {radius_m}\nmaterial = \"unit\"\n"
    );
    let mut target = Target::parse("sphere.toml", text).unwrap();
    target.materials[0] = material;
    target
}

fn grey(value: f64) -> Spectrum<sunglint_radiometry::spectrum::Reflectance> {
    Spectrum::constant(value, 290.0, 1300.0).unwrap()
}

fn polished(alpha: f64) -> Material {
    let lobe = Lobe::isotropic(Distribution::Beckmann, alpha, Masking::Separable).unwrap();
    Material::microfacet("surface", lobe, Fresnel::constant(grey(1.0)).unwrap())
}

fn albedos(channels: &[usize]) -> Vec<Linear> {
    let one = |c: &usize| Linear {
        name: format!("albedo {c}"),
        component: 0,
        channels: vec![*c],
        curves: None,
        unit: 1.0,
        most: Some(1.0),
        prior: None,
    };
    channels.iter().map(one).collect()
}

fn model(passes: &[Pass], polish: bool, radius_m: f64) -> StudyModel {
    let one = |pass: &Pass| {
        let study = Study::new(pass.clone()).unwrap();
        let target = polish.then(|| Law {
            uses: vec![0],
            make: Box::new(move |v: &[f64]| Ok(sphere_of(radius_m, polished(v[0]))))
                as Box<dyn Fn(&[f64]) -> Result<Target, String> + Send + Sync>,
        });
        let unit = Unit::Channels((0..pass.station.channels.len()).map(Some).collect());
        (study, unit, Shaping { target, ..Shaping::default() })
    };
    let component = Component { material: "surface".into(), spectrum: None };
    StudyModel::new(passes.iter().map(one).collect(), vec![component])
}

/// A sphere's passes with what closed forms say of them.
struct Sphere {
    passes: Vec<Pass>,
    truths: Vec<Array2<f64>>,
    radius_m: f64,
}

impl Sphere {
    /// Made once for all tests, as the other.
    fn calsphere() -> &'static Self {
        static MADE: OnceLock<Sphere> = OnceLock::new();
        MADE.get_or_init(Self::white)
    }

    fn lcs() -> &'static Self {
        static MADE: OnceLock<Sphere> = OnceLock::new();
        MADE.get_or_init(Self::polished)
    }

    fn white() -> Self {
        let radius_m = 0.18;
        let mut pass = scene("built_in = \"lambert_sphere\"", orbit(13.37, 90.0, 160.0));
        pass.target = sphere_of(radius_m, Material::lambert("surface", grey(1.0)).unwrap());
        Self::new(pass, radius_m, &CALSPHERE_4A, &|g| diffuse(radius_m, g))
    }

    fn polished() -> Self {
        let radius_m = 0.565;
        let mut pass = scene("built_in = \"lambert_sphere\"", orbit(9.893, 32.1, 240.0));
        pass.target = sphere_of(radius_m, polished(0.2));
        // The lobe as a smooth function of the phase angle: exact at knots of 1°, parabolas between.
        let knots: Vec<f64> = (0..=180)
            .map(|d| match d {
                180 => 0.0,
                d => beckmann(radius_m, LCS_1_ALPHA, f64::from(d).to_radians()),
            })
            .collect();
        let lobe = move |g: f64| {
            let x = g.to_degrees();
            let k = (x.round() as usize).clamp(1, 178);
            let t = x - k as f64;
            let (a, b, c) = (knots[k - 1], knots[k], knots[k + 1]);
            b + 0.5 * t * (c - a) + 0.5 * t * t * (a - 2.0 * b + c)
        };
        Self::new(pass, radius_m, &LCS_1, &lobe)
    }

    fn new(pass: Pass, radius_m: f64, albedo: &[f64], lobe: &dyn Fn(f64) -> f64) -> Self {
        let mut found = visible(&pass);
        assert!(found.len() >= 3, "{found:?}");
        // The three longest.
        found.sort_by(|a, b| b.1.total_cmp(&a.1));
        let mut passes = Vec::new();
        let mut truths = Vec::new();
        for (from, length_s) in found.into_iter().take(3) {
            let samples = 60;
            let own = over(&pass, from, samples, length_s / samples as f64, 1.0);
            let study = Study::new(own.clone()).unwrap();
            let sun = sunlight(&own, &study);
            let truth = Array2::from_shape_fn(sun.raw_dim(), |(i, c)| {
                albedo[c] * sun[[i, c]] * lobe(study.places()[i].geometry.phase_rad)
            });
            let phases = study.places().iter().map(|p| p.geometry.phase_rad.to_degrees());
            let (low, high) = phases.fold((180.0_f64, 0.0_f64), |(a, b), g| (a.min(g), b.max(g)));
            println!("{from}, {length_s} s: phase {low:.0}° to {high:.0}°");
            passes.push(own);
            truths.push(truth);
        }
        Self { passes, truths, radius_m }
    }

    fn night(&self, seed: u64, count: usize, weather: Weather) -> Vec<Data> {
        let one = |p: usize| {
            let study = Study::new(self.passes[p].clone()).unwrap();
            measured(
                100 * seed + p as u64,
                &self.passes[p],
                study.places(),
                &self.truths[p],
                weather,
            )
        };
        (0..count).map(one).collect()
    }
}

/// Truth: closed forms (Lambert's sphere; a sphere of microfacets integrated here) times sunlight through the air by the station's own integral;
/// without noise the fit gives the albedos that were put in. Tolerance: 2e-4, the air's tables, the engine at a tolerance of 1 % for what it may leave
/// out (earthshine is switched by it) and the quadrature of the lobe.
#[test]
fn albedos_of_closed_forms_come_back() {
    for (sphere, albedo, polish) in
        [(Sphere::calsphere(), CALSPHERE_4A, false), (Sphere::lcs(), LCS_1, true)]
    {
        let clean = |p: usize| {
            let truth = &sphere.truths[p];
            Data::new("clean", truth.clone(), truth.map(|v| 0.01 * v))
        };
        let data: Vec<Data> = (0..3).map(clean).collect();
        let mut model = model(&sphere.passes, polish, sphere.radius_m);
        let free = match polish {
            true => vec![Free::new("alpha", 0.2, 0.03, 0.6)],
            false => Vec::new(),
        };
        let linear = albedos(&[0, 1, 2, 3, 4, 5]);
        let options =
            Options { loss: Loss::Squares, places: 8, starts: 1, seed: 0, ..Options::default() };
        let found = fit(&data, &mut model, &free, &linear, &options, &mut |_| ()).unwrap();
        assert!(found.converged, "{:?}", found.warnings);
        for (c, albedo) in albedo.iter().enumerate() {
            let value = found.parameter(&format!("albedo {c}")).unwrap().value;
            assert!((value / albedo - 1.0).abs() < 5e-4, "{polish} {c}: {value} {albedo}");
        }
        if polish {
            let alpha = found.parameter("alpha").unwrap().value;
            assert!((alpha / LCS_1_ALPHA - 1.0).abs() < 1e-3, "{alpha}");
        }
    }
}

/// How a fit stands against the truth: hits of 95 % intervals, squares of errors and of the bound by photons and scintillation, relative.
#[derive(Default, Clone, Copy)]
struct Tally {
    hits: u64,
    of: u64,
    error2: f64,
    stated2: f64,
    largest: f64,
}

impl Tally {
    fn add(&mut self, found: &Fit, name: &str, truth: f64) {
        let p = found.parameter(name).unwrap();
        self.of += 1;
        self.hits += u64::from(p.covers(truth));
        let error = p.value / truth - 1.0;
        self.error2 += error * error;
        // None at a bound.
        self.stated2 += p.sigma.map_or(0.0, |sigma| (sigma / truth).powi(2));
        self.largest = self.largest.max(error.abs());
    }
}

/// Truth: albedos and roughness that were put in (thesis, table 7.2); rates by closed forms; noise drawn by the observatory's laws. 95 % intervals
/// cover by the binomial, pooled over channels (whose errors scintillation ties, so that the pool counts as a third of its number: p > 0.01 of those).
/// Errors beside the bound of the white sphere: the uncertainties of plain least squares with the stated noise, which no unbiased estimate beats (Cramér and
/// Rao). Of the polished sphere the roughness is hardly determined where it is small (all that a mirror ball sends is the same into all directions): its
/// interval is gone through, and intervals may be wide but must cover.
#[test]
fn campaign_sphere_fits() {
    let mut campaign = Campaign::with_part("sphere_fits", 100, 2);
    let spheres = [(Sphere::calsphere(), CALSPHERE_4A, false), (Sphere::lcs(), LCS_1, true)];
    let start = std::time::Instant::now();
    let mut fits = 0;
    let mut largest = 0.0_f64;
    for (number, (sphere, albedo, polish)) in spheres.iter().enumerate() {
        let channels: &[usize] = if *polish { &[0, 1, 2, 3, 4, 5] } else { &[0, 1, 2, 4, 5] };
        for (count, weather, loss) in [
            (1, Weather::default(), Loss::Squares),
            (3, Weather { gap: true, cloud: true }, Loss::Tukey),
        ] {
            let (mut tally, mut of_alpha, mut bound2) = (Tally::default(), Tally::default(), 0.0);
            let mut model = model(&sphere.passes[..count], *polish, sphere.radius_m);
            let linear = albedos(channels);
            let free = match polish {
                true => vec![Free::new("alpha", 0.2, 0.03, 0.6)],
                false => Vec::new(),
            };
            for seed in campaign.seeds() {
                let mut data = sphere.night(1000 * number as u64 + seed, count, weather);
                if !polish {
                    data.iter_mut().for_each(|d| d.used.column_mut(3).fill(false));
                }
                let options = Options { loss, places: 0, starts: 0, seed, ..Options::default() };
                let found = fit(&data, &mut model, &free, &linear, &options, &mut |_| ()).unwrap();
                assert!(found.converged, "{seed}: {:?}", found.warnings);
                fits += 1;
                for c in channels {
                    tally.add(&found, &format!("albedo {c}"), albedo[*c]);
                }
                if *polish {
                    of_alpha.add(&found, "alpha", LCS_1_ALPHA);
                }
                // What squares would state of the same night without clouds and gaps, by the covariance of the stated noise alone.
                bound2 += channels
                    .iter()
                    .map(|c| {
                        let p = found.parameter(&format!("albedo {c}")).unwrap();
                        let sigma = p.sigma.unwrap_or_else(|| {
                            panic!("{seed}: {:?} {:?}", found.parameters, found.warnings)
                        });
                        (sigma / albedo[*c]).powi(2) / found.scaled_by
                    })
                    .sum::<f64>();
            }
            largest = largest.max(tally.largest);
            let n = tally.of as f64;
            println!(
                "{} passes, {loss:?}: {} of {} intervals cover; errors {:.3} % rms, bound {:.3} %, stated {:.3} %, largest {:.2} %{}",
                count,
                tally.hits,
                tally.of,
                100.0 * (tally.error2 / n).sqrt(),
                100.0 * (bound2 / n).sqrt(),
                100.0 * (tally.stated2 / n).sqrt(),
                100.0 * tally.largest,
                match polish {
                    true => format!(
                        "; alpha: {} of {} cover, {:.3} % rms",
                        of_alpha.hits,
                        of_alpha.of,
                        100.0 * (of_alpha.error2 / of_alpha.of as f64).sqrt()
                    ),
                    false => String::new(),
                }
            );
            let third = (tally.of / 3, (tally.hits as f64 / 3.0).round() as u64);
            let (below, above) = binomial(third.1, third.0);
            assert!(below > 0.01, "{} of {} cover", tally.hits, tally.of);
            assert!(*polish || above > 0.002, "intervals too wide: {} of {}", tally.hits, tally.of);
            if *polish {
                let (below, _) = binomial(of_alpha.hits, of_alpha.of);
                assert!(below > 0.01, "alpha: {} of {}", of_alpha.hits, of_alpha.of);
            }
            // Gaps and Tukey's weights cost some of what there is.
            assert!(tally.error2 < 1.5_f64.powi(2) * bound2, "{} {bound2}", tally.error2);
        }
    }
    println!("{fits} fits, {:.1} ms each", start.elapsed().as_secs_f64() * 1e3 / f64::from(fits));
    campaign.largest("largest_error", largest);
    campaign.finish();
}
