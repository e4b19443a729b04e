//! The search as such: cut off, and on any number of threads.

use super::made::{measured, pass, question};
use glam::DVec3;
use rand::SeedableRng as _;
use rand_xoshiro::Xoshiro256PlusPlus as Random;
use sunglint_inference::attitude::{Options, find};
use sunglint_simulator::attitude::Spin;
use sunglint_simulator::light::engine::Switches;

/// Checkpoints that a watch was given to keep.
struct Keeping(std::sync::Mutex<Vec<sunglint_inference::attitude::Checkpoint>>);

impl sunglint_inference::attitude::Watch for Keeping {
    fn tell(&self, _: sunglint_inference::attitude::Progress) {}
    fn keep(&self, checkpoint: &sunglint_inference::attitude::Checkpoint) {
        self.0.lock().unwrap().push(checkpoint.clone());
    }
}

/// Truth: the search that was not cut off, bit by bit; and that of one thread. Direct light alone.
#[test]
fn a_search_goes_on_where_it_was_cut_off_and_hangs_on_no_number_of_threads() {
    let mut pass =
        pass("built_in = \"box_wing\"", "2020-11-18T16:22:00", "2020-11-18T16:30:00", 12.0);
    pass.effects = Switches::OFF;
    let epoch = pass.times[0];
    let spin = Spin::along(DVec3::Z, DVec3::Y, 1.0 / 90.0, 2.0, epoch).unwrap();
    let curve = || measured(pass.clone(), spin, 0.03, &mut Random::seed_from_u64(4));
    let mut question = question(DVec3::Z, epoch, 5.0);
    question.known.turns_per_s = 1.0 / 90.0;
    question.unknowns.period = false;
    let options = Options { axes: 100, all_light: false, ..Options::default() };
    let keeping = Keeping(std::sync::Mutex::new(Vec::new()));
    let whole = find(&[curve()], &question, &options, &keeping, None).unwrap();
    let kept = keeping.0.into_inner().unwrap();
    assert!(kept.len() >= 3 && kept[0].wide.len() < kept[1].wide.len());
    let on = find(&[curve()], &question, &options, &(), Some(&kept[0])).unwrap();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let one = pool.install(|| find(&[curve()], &question, &options, &(), None).unwrap());
    for other in [&on, &one] {
        assert_eq!(whole.minima.len(), other.minima.len());
        for (a, b) in whole.minima.iter().zip(&other.minima) {
            assert_eq!((a.state, a.chi2, a.probability), (b.state, b.chi2, b.probability));
        }
    }
    let otherwise = Options { seed: 1, ..options };
    let refused = find(&[curve()], &question, &otherwise, &(), Some(&kept[0]));
    assert!(refused.unwrap_err().to_string().contains("another search"));
}
