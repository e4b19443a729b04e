//! Samples that are means over their exposures, beside sums over many moments.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use hifitime::{Epoch, Unit};
use ndarray::{Array2, Axis, s};
use sunglint_simulator::attitude::{Attitude, AttitudeTable, Interpolation};
use sunglint_simulator::pass::{Overrides, Pass, PassFile, Study, TermRates};

/// A plate with a lobe of some degrees that flashes twice a turn: it turns about an axis across the line half-way between Sun and station.
fn scene(period_s: f64, exposure_s: f64) -> Pass {
    let text = format!(
        r#"
[target]
name = "plate"
[[target.part]]
name = "plate"
shape = "plate"
size_m = [1, 1]
material = "metal"
[[target.material]]
name = "metal"
model = "microfacet"
distribution = "beckmann"
alpha = 0.05
reflectance = 0.5
[orbit]
lines = [
  "1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927",
  "2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537",
]
[attitude]
law = "spin"
axis_body = [1, 0, 0]
axis_gcrs = [0.546, 0.836, 0]
period_s = {period_s}
epoch_utc = 2008-09-21T18:48:00Z
[station]
name = "ufo"
[times]
from = 2008-09-21T18:48:00Z
to = 2008-09-21T18:48:12Z
step_s = 0.5
exposure_s = {exposure_s}
"#
    );
    PassFile::parse("p.toml", &text).unwrap().resolve(Overrides::default()).unwrap()
}

/// Rates of the samples (samples × channels, then bands): sums over all terms.
fn light(rates: &TermRates) -> Array2<f64> {
    let all = [&rates.rates_hz, &rates.fluxes].map(|r| r.sum_axis(Axis(2)));
    ndarray::concatenate(Axis(1), &[all[0].view(), all[1].view()]).unwrap()
}

/// The mean over each exposure by the midpoint rule on so many moments, each simulated.
fn summed(pass: &Pass, moments: usize) -> Array2<f64> {
    let at = |k: usize| (k as f64 + 0.5) / moments as f64 - 0.5;
    let times = pass
        .times
        .iter()
        .zip(&pass.exposure_s)
        .flat_map(|(t, length)| (0..moments).map(move |k| *t + at(k) * *length * Unit::Second));
    let times: Vec<_> = times.collect();
    let exposure_s = vec![1e-3; times.len()];
    let fine = light(
        &Study::new(Pass { times, exposure_s, ..pass.clone() }).unwrap().term_rates().unwrap(),
    );
    let rows = (0..pass.times.len())
        .map(|i| fine.slice(s![i * moments..(i + 1) * moments, ..]).mean_axis(Axis(0)).unwrap());
    let rows: Vec<_> = rows.collect();
    ndarray::stack(Axis(0), &rows.iter().map(|r| r.view()).collect::<Vec<_>>()).unwrap()
}

/// The largest difference, of the truth or of a thousandth of the column's largest.
fn apart(found: &Array2<f64>, truth: &Array2<f64>) -> f64 {
    let mut most = 0.0_f64;
    for (found, truth) in found.columns().into_iter().zip(truth.columns()) {
        let largest = truth.iter().copied().fold(0.0, f64::max);
        for (found, truth) in found.iter().zip(truth) {
            most = most.max((found - truth).abs() / truth.max(1e-3 * largest));
        }
    }
    most
}

/// Truth: sums over 1,000 moments an exposure, simulated each for itself (the light engine has truths of its own). Tolerance: what is
/// stated, itself no more than was asked for, and the midpoint rule's own error, 2e-5, a third of its change from 500 moments. The flash
/// fills a fifth of an exposure, and a middle may miss all of it.
#[test]
fn means_are_sums_over_many_moments() {
    let pass = scene(12.0, 0.5);
    let (truth, coarser) = (summed(&pass, 1000), summed(&pass, 500));
    let rule = apart(&coarser, &truth);
    assert!(rule < 6e-5, "{rule}");
    let mut study = Study::new(pass.clone()).unwrap();
    let middles = apart(&light(&study.term_rates().unwrap()), &truth);
    assert!(middles > 0.5, "{middles}");
    for tolerance in [1e-2, 3e-4] {
        let averaged = study.average(tolerance).unwrap();
        let off = apart(&light(&study.term_rates().unwrap()), &truth);
        println!("{averaged:?}: off by {off:.1e}, middles by {middles:.1e}");
        assert_eq!(averaged.samples, pass.times.len());
        assert!(averaged.averaged > 0 && averaged.error <= tolerance, "{averaged:?}");
        assert!(off <= averaged.error + 2e-5, "{off} {averaged:?}");
    }
    // Thinned besides: light at few of the moments, which the means are then taken of.
    let before = light(&study.term_rates().unwrap());
    let thinned = study.thin(3e-4).unwrap();
    println!("{thinned:?}");
    let off = apart(&light(&study.term_rates().unwrap()), &before);
    assert!(off <= thinned.error + 1e-9, "{off} {thinned:?}");
    // Another study of the same samples takes the same moments.
    let mut other = Study::new(pass.clone()).unwrap();
    other.average_as(&study).unwrap();
    let off = apart(&light(&other.term_rates().unwrap()), &truth);
    assert!(off <= 3e-4 + 2e-5, "{off}");
    // Moments go with their samples.
    study.set_time_offset_s(0.3).unwrap();
    assert_eq!(study.places().len(), pass.times.len());
    assert_eq!(study.term_rates().unwrap().rates_hz.dim().0, pass.times.len());
}

/// Truth: by construction: a body that keeps still for an exposure needs no moments, and its light is what it was, to the last bit.
#[test]
fn what_keeps_still_has_its_middle() {
    let mut study = Study::new(scene(1e6, 0.01)).unwrap();
    let before = light(&study.term_rates().unwrap());
    let averaged = study.average(3e-4).unwrap();
    assert_eq!((averaged.averaged, averaged.moments), (0, 0), "{averaged:?}");
    assert_eq!(light(&study.term_rates().unwrap()), before);
}

/// Truth: by construction: a table of attitudes that ends with the first and the last sample's middle holds nothing of the half of their exposures; their light is that of the middle, to
/// the last bit, and all others' is what the law that the table was made of says. Tolerance: what is stated, of both.
#[test]
fn exposures_that_reach_beyond_a_table_have_their_middles() {
    let pass = scene(12.0, 0.5);
    let Attitude::Spin(spin) = &pass.attitude else { panic!("{:?}", pass.attitude) };
    let (first, last) = (pass.times[0], *pass.times.last().unwrap());
    // Light leaves some milliseconds before it is seen.
    let from = first - 20 * Unit::Millisecond;
    let steps = ((last - from).to_seconds() / 0.02).round() as i64;
    let times: Vec<Epoch> =
        (0..=steps).map(|k| (from + k * 20 * Unit::Millisecond).min(last)).collect();
    let turned = times.iter().map(|t| spin.body_to_gcrs(*t)).collect();
    let table = AttitudeTable::new(times, turned, Interpolation::Slerp).unwrap();
    let mut study = Study::new(Pass { attitude: Attitude::Table(table), ..pass.clone() }).unwrap();
    let middles = light(&study.term_rates().unwrap());
    let averaged = study.average(3e-4).unwrap();
    println!("{averaged:?}");
    assert_eq!(averaged.beyond, 2);
    let found = light(&study.term_rates().unwrap());
    let ends = [0, pass.times.len() - 1];
    for i in ends {
        assert_eq!(found.row(i), middles.row(i));
    }
    let mut other = Study::new(pass).unwrap();
    let whole = other.average(3e-4).unwrap();
    assert_eq!(whole.beyond, 0);
    let (mut truth, mut found) = (light(&other.term_rates().unwrap()), found);
    for i in ends {
        truth.row_mut(i).fill(1.0);
        found.row_mut(i).fill(1.0);
    }
    let off = apart(&found, &truth);
    assert!(off <= averaged.error + whole.error, "{off}");
}
