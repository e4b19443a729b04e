//! A diffuse cube through the simulator, whose light is known in closed form.

use ndarray::{Array2, s};
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::f64::consts::PI;
use std::fmt::Write as _;
use sunglint_analysis::unmix::nnls::Constraint;
use sunglint_analysis::unmix::{
    AtgpOptions, Bands, Confusion, Endmember, Light, Mixing, Noise, State, Unmixed, Values, atgp,
    spectral_angle_rad, unmix,
};
use sunglint_radiometry::spectrum::Spectrum;
use sunglint_radiometry::station::Channel;
use sunglint_simulator::light::engine::Switches;
use sunglint_simulator::pass::{Overrides, Pass, PassFile, Place, Simulation};
use sunglint_simulator::surface::Material;
use sunglint_simulator::target::Target;

/// The materials of the thesis (section 6.2) and a uniform one, and the faces that each covers.
const FACES: [(&str, &[&str]); 4] = [
    ("aluminium", &["+x", "+z"]),
    ("solar_cell", &["-x"]),
    ("mli", &["+y", "-z"]),
    ("grey80", &["-y"]),
];
const SIDE_M: f64 = 0.7;

fn spectrum(name: &str) -> Spectrum<sunglint_radiometry::spectrum::Reflectance> {
    Material::built_in(name).unwrap().spectra()[0].clone()
}

/// A cube whose faces have the spectra of the materials and scatter alike into all directions.
fn cube() -> Target {
    let mut text = "name = \"cube\"\n".to_owned();
    for (name, faces) in FACES {
        let spectrum = spectrum(name);
        let list = |v: &[f64]| format!("{v:?}");
        write!(
            text,
            "[[material]]\nname = \"{name} diffuse\"\nmodel = \"lambert\"\nreflectance_table = {{ wavelength_nm = {}, reflectance = {} }}\n\
             [[part]]\nname = \"{name}\"\nshape = \"box\"\nsize_m = [{SIDE_M}, {SIDE_M}, {SIDE_M}]\nfaces = {faces:?}\nmaterial = \"{name} diffuse\"\n",
            list(spectrum.wavelength_nm()),
            list(spectrum.value())
        )
        .unwrap();
    }
    Target::parse("cube.toml", text).unwrap()
}

/// Six evenly spaced normal bands, as the thesis has them (fig. G.5), behind the built-in station's telescope.
fn six_channels(pass: &mut Pass) {
    let one = pass.station.channels[0].clone();
    let band = |k: u32| {
        let centre = 400.0 + 100.0 * f64::from(k);
        let nm: Vec<f64> = (-60..=60).map(|i| centre + 2.0 * f64::from(i)).collect();
        let value = nm.iter().map(|nm| (-0.5 * ((nm - centre) / 30.0).powi(2)).exp()).collect();
        Channel {
            name: format!("c{centre}"),
            optics: vec![Spectrum::new(nm, value).unwrap()],
            efficiency: Spectrum::constant(0.5, 300.0, 1200.0).unwrap(),
            transmission: 1.0,
            ..one.clone()
        }
    };
    pass.station.channels = (0..6).map(band).collect();
}

/// The pass of the demonstration, turning once in 20 s about a tilted axis; sunlight alone, scattered once.
fn pass() -> Pass {
    let path = sunglint_testkit::repository().join("fixtures/scenes/box_wing_dusk.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    let text = text.replace("period_s = 120.0", "period_s = 20.0");
    let text = text.replace("axis_body = [0.0, 0.0, 1.0]", "axis_body = [0.3, 0.5, 0.8]");
    let text = text.replace("step_s = 0.5", "step_s = 0.7");
    let mut pass = PassFile::parse(&path, &text).unwrap().resolve(Overrides::default()).unwrap();
    pass.target = cube();
    six_channels(&mut pass);
    pass.effects = Switches::OFF;
    pass
}

/// The weights W_m of a convex Lambert body: Σ A max(0, n·s) max(0, n·o)/π over the faces of each material, m² sr⁻¹.
fn truth(place: &Place) -> Vec<f64> {
    let face = |name: &str| {
        let sign = if name.starts_with('-') { -1.0 } else { 1.0 };
        let axis = match &name[1..] {
            "x" => 0,
            "y" => 1,
            _ => 2,
        };
        let cos = |v: glam::DVec3| (sign * v.to_array()[axis]).max(0.0);
        SIDE_M * SIDE_M * cos(place.sun_body) * cos(place.observer_body) / PI
    };
    FACES.iter().map(|(_, faces)| faces.iter().map(|f| face(f)).sum()).collect()
}

fn endmembers() -> Vec<Endmember> {
    let one =
        |(name, _): &(&str, _)| Endmember { name: (*name).to_owned(), reflectance: spectrum(name) };
    FACES.iter().map(one).collect()
}

fn lights(simulation: &Simulation<'_>, range: bool) -> Vec<Light> {
    let light = |p: &Place| Light {
        zenith: p.geometry.air_zenith(),
        range_m: if range { p.geometry.range_m } else { 1.0 },
        sunlight: p.sunlit / p.geometry.sun.distance_au().powi(2),
    };
    simulation.places.iter().map(light).collect()
}

/// Shares of the samples that the station sees with light, true and found.
fn shares(simulation: &Simulation<'_>, found: &[Unmixed]) -> (Array2<f64>, Array2<f64>) {
    let (mut true_rows, mut found_rows) = (Vec::new(), Vec::new());
    for (place, unmixed) in simulation.places.iter().zip(found) {
        let weights = truth(place);
        let sum: f64 = weights.iter().sum();
        if place.hidden || sum < 1e-6 {
            continue;
        }
        true_rows.extend(weights.iter().map(|w| w / sum));
        found_rows.extend(&unmixed.mixture.as_ref().unwrap().shares);
    }
    let table = |v: Vec<f64>| Array2::from_shape_vec((v.len() / 4, 4), v).unwrap();
    (table(true_rows), table(found_rows))
}

/// Truth: the closed form of a convex Lambert body for every sample, and no number of the simulator's: its weights are found again from six channels through the air and
/// from spectra without it, in m² sr⁻¹, and the confusion matrices are above 0.94 on the diagonal (thesis fig. 8.4) by far.
/// Tolerance: 3e-5 of the largest weight: the air's tables of simulator and unmixing (1e-7 in transmission each) times the condition of six channels (below 60); bins are means of the same
/// tables, and their answer good to 1e-9.
#[test]
fn a_diffuse_cube_is_taken_apart() {
    let pass = pass();
    let simulation = pass.simulate(&|_| ()).unwrap();
    let most = simulation.places.iter().flat_map(truth).fold(0.0, f64::max);
    let air = pass.air.as_ref().map(|air| (air, 1e-7));
    let channels: Vec<&Channel> = pass.station.channels.iter().collect();
    let area_m2 = pass.station.telescope.area_m2();
    let bands = Bands::channels(&pass.sun, &channels, area_m2, &endmembers(), air).unwrap();
    let rates =
        Array2::from_shape_fn((pass.times.len(), 6), |(i, c)| simulation.channels[c].rate_hz[i]);
    let valid = rates.mapv(f64::is_finite);
    let values = Values { value: rates.view(), sigma: None, valid: valid.view() };
    let found = unmix(&bands, &lights(&simulation, true), values, Constraint::Free).unwrap();
    let mut seen = 0;
    for (place, unmixed) in simulation.places.iter().zip(&found).filter(|(p, _)| !p.hidden) {
        seen += 1;
        let weights = &unmixed.mixture.as_ref().unwrap().weights;
        for (found, truth) in weights.iter().zip(truth(place)) {
            assert!((found - truth).abs() <= 3e-5 * most, "{found} {truth} ({most})");
        }
    }
    assert!(seen > 500, "{seen}");
    let (t, f) = shares(&simulation, &found);
    let six = Confusion::of(t.view(), f.view()).unwrap();
    assert!(six.worst() > 0.999, "{:?}", six.matrix);

    let bins = Bands::bins(&pass.sun, &pass.edges_nm, &endmembers(), None).unwrap();
    let valid = Array2::from_elem(simulation.spectra.dim(), true);
    let values = Values { value: simulation.spectra.view(), sigma: None, valid: valid.view() };
    let found = unmix(&bins, &lights(&simulation, false), values, Constraint::Free).unwrap();
    for (place, unmixed) in simulation.places.iter().zip(&found) {
        let Some(mixture) = &unmixed.mixture else { panic!("{unmixed:?}") };
        for (found, truth) in mixture.weights.iter().zip(truth(place)) {
            assert!((found - truth).abs() <= 1e-9 * most, "{found} {truth}");
        }
    }
    let (t, f) = shares(&simulation, &found);
    let full = Confusion::of(t.view(), f.view()).unwrap();
    assert!(full.worst() > 0.999_999, "{:?}", full.matrix);
}

/// Truth: the closed form again, the rates with normal noise of 0.2 %: the confusion stays above 0.94, the promise. Built-in aluminium is nearly grey (0.08 rad from it in six channels): at 1 %
/// these two are taken for each other in a fifth of the light, and the others stay above 0.94. In plain light the pulls of weights, shares and χ² are what the uncertainties say.
/// Tolerance: 5 % of the root mean square of 16,000 pulls of which those of a sample go together; 0.15 on a mean χ² of 2 whose standard error is 0.03.
#[test]
fn noise_leaves_the_promise_and_the_uncertainties_true() {
    let pass = pass();
    let simulation = pass.simulate(&|_| ()).unwrap();
    let channels: Vec<&Channel> = pass.station.channels.iter().collect();
    let area_m2 = pass.station.telescope.area_m2();
    let air = pass.air.as_ref().map(|air| (air, 1e-6));
    let bands = Bands::channels(&pass.sun, &channels, area_m2, &endmembers(), air).unwrap();
    let mut random = Xoshiro256PlusPlus::seed_from_u64(9);
    let clean =
        Array2::from_shape_fn((pass.times.len(), 6), |(i, c)| simulation.channels[c].rate_hz[i]);
    let valid = clean.mapv(|v| v.is_finite() && v > 0.0);
    let mut confused = |noise: f64| {
        let sigma = clean.mapv(|v| noise * v);
        let noisy = Array2::from_shape_fn(clean.dim(), |at| {
            clean[at] + sigma[at] * random.sample::<f64, _>(rand_distr::StandardNormal)
        });
        let values = Values { value: noisy.view(), sigma: Some(sigma.view()), valid: valid.view() };
        let found = unmix(&bands, &lights(&simulation, true), values, Constraint::Free).unwrap();
        assert!(found.iter().all(|u| u.mixture.is_some() || u.state.contains(State::NO_DATA)));
        let (t, f) = shares(&simulation, &found);
        Confusion::of(t.view(), f.view()).unwrap()
    };
    let (little, more) = (confused(0.002), confused(0.01));
    println!("0.2 %: {:.3}\n1 %: {:.3}", little.matrix, more.matrix);
    assert!(little.worst() > 0.94, "{:.4}", little.matrix);
    assert!(more.matrix[(1, 1)] > 0.94 && more.matrix[(2, 2)] > 0.94, "{:.4}", more.matrix);

    // What no bound can touch: all four materials in plain light.
    let factors = bands.at(sunglint_radiometry::air::Zenith::Apparent(40.0)).unwrap();
    let mixing = Mixing::new(factors.matrix.clone(), &bands.endmembers).unwrap();
    let weights = [0.4, 0.5, 0.3, 0.6];
    let clean: Vec<f64> = factors
        .matrix
        .rows()
        .into_iter()
        .map(|r| r.iter().zip(weights).map(|(s, w)| s * w).sum())
        .collect();
    let sigma: Vec<f64> = clean.iter().map(|v| 1e-3 * v).collect();
    let (mut squares, mut shares, mut chi) = (0.0, 0.0, 0.0);
    let trials = 4000;
    for _ in 0..trials {
        let x: Vec<f64> = clean
            .iter()
            .zip(&sigma)
            .map(|(v, s)| v + s * random.sample::<f64, _>(rand_distr::StandardNormal))
            .collect();
        let mixture = mixing.solve(&x, Noise::Independent(&sigma), Constraint::Free).unwrap();
        assert!(!mixture.bounded.contains(&true));
        for m in 0..4 {
            squares += ((mixture.weights[m] - weights[m]) / mixture.sigma[m]).powi(2);
            shares += ((mixture.shares[m] - weights[m] / 1.8) / mixture.share_sigma[m]).powi(2);
        }
        chi += mixture.chi_squared.unwrap();
    }
    let n = f64::from(trials);
    for rms in [(squares / (4.0 * n)).sqrt(), (shares / (4.0 * n)).sqrt()] {
        assert!((rms - 1.0).abs() < 0.05, "{rms}");
    }
    // Two degrees of freedom are left: their mean is 2 with a standard error of 2/√n.
    assert!((chi / n - 2.0).abs() < 0.15, "{}", chi / n);
}

/// Truth: the spectra that the cube was made with, and a sum of exponentials of noise: two channels that move together by scintillation say less than two that move alone; generalised least
/// squares with the covariance has the covariance (SᵀC⁻¹S)⁻¹, here of one endmember in closed form: 1/(sᵀC⁻¹s).
#[test]
fn channels_that_move_together_count_as_such() {
    let mixing = Mixing::new(ndarray::array![[1.0], [1.0]], &["one".into()]).unwrap();
    let together = ndarray::array![[0.04, 0.03], [0.03, 0.04]];
    let found =
        mixing.solve(&[1.0, 2.0], Noise::Covariance(together.view()), Constraint::Free).unwrap();
    assert!((found.weights[0] - 1.5).abs() < 1e-14);
    // 1ᵀC⁻¹1 = 2/(0.04 + 0.03).
    assert!((found.sigma[0] - 0.035_f64.sqrt()).abs() < 1e-15);
    let alone =
        mixing.solve(&[1.0, 2.0], Noise::Independent(&[0.2, 0.2]), Constraint::Free).unwrap();
    assert!((alone.sigma[0] - 0.02_f64.sqrt()).abs() < 1e-15);
}

/// Truth: the four spectra that the cube was made with (thesis fig. K.3), by which nobody was told anything: the endmembers found from the samples differ from them in scale alone.
/// Tolerance: 1e-6 rad; rounding and nothing else.
#[test]
fn targets_are_generated_without_being_told() {
    let pass = pass();
    let simulation = pass.simulate(&|_| ()).unwrap();
    let bins = Bands::bins(&pass.sun, &pass.edges_nm, &endmembers(), None).unwrap();
    let matrix = bins.at(sunglint_radiometry::air::Zenith::Apparent(0.0)).unwrap();
    let valid = Array2::from_elem(simulation.spectra.dim(), true);
    let values = Values { value: simulation.spectra.view(), sigma: None, valid: valid.view() };
    let found = unmix(&bins, &lights(&simulation, false), values, Constraint::Free).unwrap();
    let spectra = Array2::from_shape_fn(simulation.spectra.dim(), |(i, b)| found[i].factors[b]);
    let targets = atgp(spectra.view(), &AtgpOptions::default()).unwrap();
    assert_eq!(
        targets.targets.len(),
        4,
        "{} {:?}",
        targets.stopped,
        targets.targets.iter().map(|t| t.eta).collect::<Vec<_>>()
    );
    let mut met = [false; 4];
    for target in &targets.targets {
        // A sample that shows one material alone, to find in the closed form of the light.
        let weights = truth(&simulation.places[target.sample.unwrap()]);
        let angles: Vec<f64> = (0..4)
            .map(|m| spectral_angle_rad(&target.spectrum, &matrix.matrix.slice(s![.., m]).to_vec()))
            .collect();
        let nearest = (0..4).min_by(|a, b| angles[*a].total_cmp(&angles[*b])).unwrap();
        println!(
            "rest {:.3e} eta {:.3e}, nearest {} at {:.3e} rad, truth {weights:?}",
            target.rest, target.eta, FACES[nearest].0, angles[nearest]
        );
        met[nearest] = true;
        assert!(angles[nearest] < 1e-6, "{angles:?}");
    }
    assert_eq!(met, [true; 4]);
    assert!(targets.targets.windows(2).all(|t| t[1].eta <= t[0].eta));

    // Six channels, above the air: through it a material's colour changes along the pass (0.013 rad for the foil down to 85°), and few samples of this pass show one
    // material alone.
    let channels: Vec<&Channel> = pass.station.channels.iter().collect();
    let area_m2 = pass.station.telescope.area_m2();
    let bands = Bands::channels(&pass.sun, &channels, area_m2, &endmembers(), None).unwrap();
    let rates = Array2::from_shape_fn((pass.times.len(), 6), |(i, c)| {
        simulation.channels[c].above_air_hz[i]
    });
    let valid = Array2::from_elem(rates.dim(), true);
    let values = Values { value: rates.view(), sigma: None, valid: valid.view() };
    let found = unmix(&bands, &lights(&simulation, true), values, Constraint::Free).unwrap();
    let factors = Array2::from_shape_fn(rates.dim(), |(i, c)| found[i].factors[c]);
    let targets = atgp(factors.view(), &AtgpOptions::default()).unwrap();
    let matrix = bands.at(sunglint_radiometry::air::Zenith::Apparent(0.0)).unwrap().matrix;
    let mut met = [false; 4];
    for target in &targets.targets {
        let angle = |m: &usize| spectral_angle_rad(&target.spectrum, &matrix.column(*m).to_vec());
        let nearest = (0..4).min_by(|a, b| angle(a).total_cmp(&angle(b))).unwrap();
        assert!(angle(&nearest) < 1e-6, "{} {}", FACES[nearest].0, angle(&nearest));
        met[nearest] = true;
    }
    assert_eq!((targets.targets.len(), met), (4, [true; 4]), "{}", targets.stopped);
}
