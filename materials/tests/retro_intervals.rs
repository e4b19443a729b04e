//! Intervals of F₀ and α of whole retro-reflection runs.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::sync::Arc;
use sunglint_drivers::clock::{Cancel, DeviceClock, VirtualClock};
use sunglint_drivers::device::InBeam;
use sunglint_formats::toml::Document;
use sunglint_materials::ndf::{NdfOptions, extract};
use sunglint_materials::retro::measure::{
    Hands, HandsError, InMemory, Line, Rig, measure, measured,
};
use sunglint_materials::retro::plan::RunPlan;
use sunglint_materials::retro::{Reference, reduce, to_table};
use sunglint_materials::table::RetroTable;
use sunglint_testkit::{Campaign, repository};
use sunglint_virtual::rig::devices::VirtualRig;
use sunglint_virtual::rig::options::{Options, SampleKind};

/// The file on docs/lab.md that has a key.
fn page(key: &str) -> String {
    let text = std::fs::read_to_string(repository().join("docs/lab.md")).unwrap();
    let mut blocks = text.split("```toml\n").skip(1).map(|b| b.split("```").next().unwrap());
    blocks.find(|block| block.contains(key)).unwrap().to_owned()
}

struct Robot(VirtualRig);

impl Hands for Robot {
    fn put(&mut self, place: InBeam) -> Result<(), HandsError> {
        self.0.place(place);
        Ok(())
    }
}

/// A whole run in memory, on a clock that takes no time.
fn in_memory(plan: &RunPlan, options: &Options) -> InMemory<Line> {
    let virtual_rig = VirtualRig::new(options.clone(), 0).unwrap();
    let (mut stage, mut meter) = (virtual_rig.stage(), virtual_rig.meter());
    let mut hands = Robot(virtual_rig);
    let zero_utc = Some(hifitime::Epoch::from_gregorian_utc_at_midnight(2026, 1, 1));
    let clock = DeviceClock { clock: Arc::new(VirtualClock::new()), zero_utc };
    let cancel = Cancel::new();
    let mut rig = Rig { stage: &mut stage, meter: &mut meter, hands: &mut hands, clock, cancel };
    let mut record = InMemory::default();
    measure(&mut rig, &plan.measuring, &[], false, 0.0, &mut record).unwrap();
    record
}

/// Columns that are kept of a run: its kind (0 Beckmann, 1 GGX), α, then for F₀ and α of the law whether the truth lay below or above the interval, (found − truth)/σ, the error and the half-width, relative.
const RETRO_COLUMNS: &[&str] = &[
    "kind",
    "roughness",
    "f0_below",
    "f0_above",
    "f0_pull",
    "f0_error",
    "f0_half",
    "alpha_below",
    "alpha_above",
    "alpha_pull",
    "alpha_error",
    "alpha_half",
];

/// A normal number by Box and Muller.
fn normal(random: &mut Xoshiro256PlusPlus) -> f64 {
    let (u, v): (f64, f64) = (1.0 - random.random::<f64>(), random.random());
    (-2.0 * u.ln()).sqrt() * (2.0 * std::f64::consts::PI * v).cos()
}

/// Whole retro-reflection runs on rigs of chance, whose splitter, lens and stop are off from what the run's file says by as much as it says of them (synthetic). Truth: the rig's α and F₀.
/// 95 % intervals: 1.96 σ, and of F₀ the bound of the continuations beyond the last angle. docs/uncertainty.md counts them.
#[test]
fn campaign_retro_intervals() {
    let mut campaign = Campaign::in_shards("retro_intervals", 300, 4, RETRO_COLUMNS);
    let document = Document::new("run.toml", page("[scan]")).unwrap();
    let plan = RunPlan::new(&document, Some(&page("[mount]"))).unwrap();
    for seed in campaign.seeds() {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        let mut options = Options::read(plan.rig.as_ref().unwrap()).unwrap();
        options.seed = seed;
        let kind = if seed % 2 == 0 { SampleKind::Beckmann } else { SampleKind::Ggx };
        options.sample.kind = kind;
        options.sample.alpha = 0.03 * 20_f64.powf(random.random::<f64>());
        options.mount.offset_deg = 2.0 * (2.0 * random.random::<f64>() - 1.0);
        options.laser.drift_per_h = 0.04 * (2.0 * random.random::<f64>() - 1.0);
        options.laser.noise = 0.01;
        let Reference::Power { splitter, lens, .. } = &plan.setup.reference else {
            panic!("the page's run has no standard")
        };
        options.optics.splitter_reflectance *= 1.0 + splitter.relative_sigma * normal(&mut random);
        options.optics.lens_transmission *= 1.0 + lens.relative_sigma * normal(&mut random);
        // The solid angle goes with the inverse square.
        options.stop.distance_mm *= 1.0 - 0.5 * plan.setup.stop.1 * normal(&mut random);
        let record = in_memory(&plan, &options);
        let retro = reduce(&measured(&record.0), &plan.setup).unwrap();
        let table = RetroTable::from_table("run", &to_table(&retro)).unwrap();
        let ndf_options = NdfOptions { resamplings: 60, seed, ..NdfOptions::default() };
        let found = extract(&table, &ndf_options).unwrap();
        let profile = &found.profiles[0];
        let fit = if kind == SampleKind::Beckmann { profile.beckmann } else { profile.ggx };
        let sample = &options.sample;
        let judged = |value: f64, sigma: f64, bound: f64, truth: f64| {
            let (off, half) = (value - truth, 1.96 * sigma + bound);
            let [below, above] = [off > half, off < -half].map(|is| f64::from(u8::from(is)));
            [below, above, off / sigma, off / truth, half / truth]
        };
        let f0 = judged(found.f0, found.f0_sigma.unwrap(), found.f0_bound, sample.reflectance);
        let alpha = judged(fit.alpha, fit.sigma.unwrap(), 0.0, sample.alpha);
        let row = [&[(seed % 2) as f64, sample.alpha][..], &f0[..], &alpha[..]].concat();
        println!("{seed}: {row:.4?}");
        campaign.keep(seed, &row);
    }
    for what in ["f0", "alpha"] {
        let sum = |end: &str| campaign.column(&format!("{what}_{end}")).iter().sum::<f64>();
        let n = campaign.column("kind").len() as f64;
        let missed = (sum("below") + sum("above")) / n;
        println!("{what}: missed {missed:.3} (below {}, above {})", sum("below"), sum("above"));
        campaign.largest(if what == "f0" { "f0_missed" } else { "alpha_missed" }, missed);
        assert!(!campaign.is_whole() || missed < 0.1, "{what} {missed}");
    }
    campaign.finish();
}
