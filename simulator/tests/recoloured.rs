//! Light between the parts of a body whose reflectances alone change, beside the same of a study that is made anew.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use ndarray::Array2;
use sunglint_simulator::pass::{Overrides, Pass, PassFile, Study, TermRates};

/// A white box beside a panel, in one orbit: `lobes` has materials with lobes, else all scatter evenly.
fn scene(lobes: bool, white: [f64; 2], panel: f64, wide_m: f64) -> Pass {
    let lobe = "model = \"microfacet\"\ndistribution = \"ggx\"\nalpha = 0.25";
    let of = |lobed: bool| if lobed { lobe } else { "model = \"lambert\"" };
    let text = format!(
        r#"
[target]
name = "box and panel"
[[target.part]]
name = "bus"
shape = "box"
size_m = [1, 1, 1.3]
material = "white"
[[target.part]]
name = "panel"
shape = "plate"
size_m = [{wide_m}, 1.7]
faces = ["+z"]
material = "panel"
offset_m = [0, 1.6, 0]
[[target.part]]
name = "back"
shape = "box"
size_m = [0.2, 1.5, 0.2]
material = "white"
offset_m = [0.4, 1.6, 0.2]
[[target.material]]
name = "white"
model = "lambert"
reflectance_table = {{ wavelength_nm = [300, 600, 1240], reflectance = [{0}, {1}, {1}] }}
[[target.material]]
name = "panel"
{2}
reflectance = {panel}
[orbit]
lines = [
  "1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927",
  "2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537",
]
[attitude]
law = "orbit"
[station]
name = "ufo"
[times]
from = 2008-09-21T18:48:00Z
to = 2008-09-21T18:48:30Z
step_s = 3
"#,
        white[0],
        white[1],
        of(lobes)
    );
    PassFile::parse("p.toml", &text).unwrap().resolve(Overrides::default()).unwrap()
}

/// Light of several materials, and all light, in channels and bands.
fn sums(rates: &TermRates) -> [Array2<f64>; 2] {
    let mut sums = [0, 1].map(|_| Array2::zeros((rates.rates_hz.dim().0, 0)));
    for table in [&rates.rates_hz, &rates.fluxes] {
        let all = table.sum_axis(ndarray::Axis(2));
        let mut several = Array2::zeros(all.raw_dim());
        for (k, _) in rates.terms.iter().enumerate().filter(|(_, t)| t.is_of_several()) {
            several += &table.index_axis(ndarray::Axis(2), k);
        }
        for (sum, own) in sums.iter_mut().zip([several, all]) {
            sum.append(ndarray::Axis(1), own.view()).unwrap();
        }
    }
    sums
}

/// Truth: the light of a study that is made anew of each body (whose own truths are those of inter-reflection, beside light paths and Mitsuba). Tolerance: 2e-3 of all light, which each of both may err by
/// 1e-3 of, and a tenth of this light; the body that the study was made of has its own light again (where another was put in place meanwhile, within the same). A body of another shape is put in place, and has its own light to the last bit.
#[test]
fn other_reflectances_have_their_own_light() {
    for lobes in [false, true] {
        let first = scene(lobes, [0.8, 0.7], 0.5, 1.0);
        let mut study = Study::new(first.clone()).unwrap();
        let [own, _] = sums(&study.term_rates().unwrap());
        for (white, panel) in [([0.65, 0.6], 0.55), ([0.9, 0.85], 0.3), ([0.4, 0.75], 0.8)] {
            let other = scene(lobes, white, panel, 1.0);
            let [found, _] = sums(&study.bounced_of(other.target.clone()).unwrap());
            let [truth, all] = sums(&Study::new(other).unwrap().term_rates().unwrap());
            let off = (&found - &truth) / &all;
            let most = off.iter().fold(0.0_f64, |most, off| most.max(off.abs()));
            let share = (&truth / &all).iter().copied().fold(0.0, f64::max);
            println!("lobes {lobes} {white:?} {panel}: off by {most:.1e}, of {share:.3}");
            assert!(share > 1e-3, "{share}");
            assert!(most < 0.1 * share && most < 2e-3, "{most}");
        }
        let [again, _] = sums(&study.bounced_of(first.target).unwrap());
        let off = (&again / &own).iter().fold(0.0_f64, |most, ratio| most.max((ratio - 1.0).abs()));
        assert!(off < 2e-3, "{off}");
        let wide = scene(lobes, [0.8, 0.7], 0.5, 1.2);
        let [found, _] = sums(&study.bounced_of(wide.target.clone()).unwrap());
        let [truth, _] = sums(&Study::new(wide).unwrap().term_rates().unwrap());
        assert_eq!(found, truth);
    }
}
