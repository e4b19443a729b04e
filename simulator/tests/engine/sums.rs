//! Rates, bins, magnitudes and their errors are sums over terms: against sums of trapezoids.

use sunglint_radiometry::light;
use sunglint_radiometry::passband::{Passband, Weighting};
use sunglint_simulator::light::Source;
use sunglint_simulator::pass::{Overrides, Pass, PassFile};

const H_J_S: f64 = 6.626_070_15e-34;
const C_M_S: f64 = 299_792_458.0;

/// A pass of a box with wings, which turns, over the built-in station; without air.
const PASS: &str = r#"
tolerance = 0.002
[target]
built_in = "box_wing"
[attitude]
law = "orbit"
[orbit]
lines = [
  "1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927",
  "2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537",
]
[station]
name = "ufo"
[air]
none = true
[effects]
moonshine = "off"
[times]
from = 2008-09-21T18:46:00Z
to = 2008-09-21T18:51:00Z
step_s = 60
"#;

fn pass(text: &str) -> Pass {
    PassFile::parse("p.toml", text).unwrap().resolve(Overrides::default()).unwrap()
}

fn trapezoids(from_nm: f64, to_nm: f64, f: impl Fn(f64) -> f64) -> f64 {
    let n = ((to_nm - from_nm) / 0.02).round() as usize;
    let step = (to_nm - from_nm) / n as f64;
    let inner: f64 = (1..n).map(|i| f(from_nm + step * i as f64)).sum();
    step * (0.5 * (f(from_nm) + f(to_nm)) + inner)
}

/// Truth: ν = 1/(d² r²) Σ_k W_k (A/hc) ∫ E τ_k P λ dλ by trapezoids of 0.02 nm, its error by the same sums with the errors in place of the weights, of light
/// between surfaces, of the Earth's light between them and of that which is scattered once as squares; bins and V alike. Tolerance: 1e-4 for trapezoids over the kinks of tables; 1e-6 more for errors of bins, which are stored in 32 bits.
#[test]
fn errors_are_sums_over_terms() {
    let pass = pass(PASS);
    let simulation = pass.simulate(&|_| ()).unwrap();
    let (sun, channel) = (light::sun_at_1_au(), &pass.station.channels[1]);
    let (a, b) = channel.range_nm().unwrap();
    let (a, b) = (a.max(300.0), b.min(1240.0));
    let area = pass.station.telescope.area_m2();
    let of_terms = |f: &dyn Fn(f64) -> f64, (a, b): (f64, f64)| -> Vec<f64> {
        let tau = |k: usize| &simulation.terms[k].spectrum;
        let n = simulation.terms.len();
        (0..n).map(|k| trapezoids(a, b, |nm| sun.at(nm) * tau(k).at(nm) * f(nm))).collect()
    };
    let rates =
        of_terms(&|nm| area / (H_J_S * C_M_S) * 1e-9 * channel.sensitivity_at(nm) * nm, (a, b));
    let bin = of_terms(&|_| 0.2, (500.0, 505.0));
    let v = Passband::named("V").unwrap();
    let (va, vb) = v.response.range_nm();
    // Photons or energy, as the band's table says.
    let photon = |nm: f64| if v.weighting == Weighting::Photon { nm } else { 1.0 };
    let vega = trapezoids(va, vb, |nm| v.response.at(nm) * photon(nm));
    let vega = vega * v.zero_irradiance(pass.zero).unwrap();
    let fluxes = of_terms(&|nm| v.response.at(nm) * photon(nm) / vega, (va, vb));
    let near = |found: f64, truth: f64, what: &str| {
        assert!((found - truth).abs() <= 1e-4 * truth.abs(), "{what}: {found} is not {truth}");
    };
    let (mut lit, mut edge) = (0, false);
    for (i, place) in simulation.places.iter().enumerate() {
        let sums = |row: &[f64]| -> (f64, f64) {
            let errors = simulation.errors.row(i);
            let light = simulation.weights.row(i);
            let light = light.iter().zip(row).map(|(w, p)| w * p).sum();
            let mut by = [0.0_f64; 4];
            for ((e, p), term) in errors.iter().zip(row).zip(&simulation.terms) {
                let way = match (term.source, term.material) {
                    (Source::Bounce, _) => 1,
                    (Source::Earthshine, None) => 2,
                    (Source::Earthshine, Some(_)) => 3,
                    _ => 0,
                };
                by[way] += e * p.abs();
            }
            (light, by[0] + by[1].hypot(by[2]).hypot(by[3]))
        };
        let per_au = place.geometry.sun.distance_au().powi(-2);
        // The weights hold what the Earth's shadow leaves.
        let sunlight = per_au;
        let (here, range) = (sunlight / place.geometry.range_m.powi(2), place.geometry.range_m);
        let all = |(_, error): (f64, f64)| sunlight * error;
        let (rate, error) = sums(&rates);
        let found = &simulation.channels[1];
        near(found.rate_hz[i], here * rate, "rate");
        near(found.error_hz[i], all((rate, error)) / (range * range), "error of the rate");
        let (mean, error) = sums(&bin);
        near(simulation.spectra[[i, 40]], sunlight * mean, "bin");
        near(f64::from(simulation.spectra_errors[[i, 40]]), all((mean, error)), "error of the bin");
        let (flux, error) = sums(&fluxes);
        if flux > 0.0 && sunlight > 0.0 {
            near(simulation.magnitudes[[i, 2]], -2.5 * (here * flux).log10(), "V");
            let left = 1.0 - all((flux, error)) / (sunlight * flux);
            let fainter = if left > 0.0 { -2.5 * left.log10() } else { f64::INFINITY };
            let found = simulation.magnitude_errors[[i, 2]];
            assert!(found == fainter || (found / fainter - 1.0).abs() < 1e-2, "{found} {fainter}");
            lit += 1;
        }
        assert!(error > 0.0, "nothing is stated");
        edge |= place.sunlit_error > 0.0;
    }
    assert!(lit > 2 && edge, "{lit} {edge}");
    let needs = pass.explain().unwrap().needs;
    assert_eq!(needs, simulation.needs);
    let moon = needs.iter().find(|n| n.effect == "moonshine").unwrap();
    assert!(!moon.needed && moon.why.contains("switched off"), "{moon:?}");
}

/// Wrong switches and tolerances are refused with their place.
#[test]
fn keys_that_make_no_sense_are_refused() {
    let refuse = |from: &str, to: &str| {
        let text = PASS.replace(from, to);
        let file = PassFile::parse("p.toml", &text);
        let error = file.and_then(|f| f.resolve(Overrides::default()));
        error.map(|_| ()).unwrap_err().to_string()
    };
    let message = refuse("moonshine", "moon_shine");
    assert!(message.contains("effects.moon_shine") && message.contains("`moonshine`"), "{message}");
    assert!(refuse("\"off\"", "\"no\"").contains("effects.moonshine"));
    for bad in ["0.0", "-1.0", "2.0", "nan"] {
        let message = refuse("0.002", bad);
        assert!(message.contains("tolerance"), "{bad}: {message}");
    }
}
