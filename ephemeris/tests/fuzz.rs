//! Readers of elements and positions, with seeds that are changed at random: the targets of `fuzz/` without its compiler.

use sunglint_testkit::Fuzz;

#[path = "../fuzz/targets/elements.rs"]
mod elements;
#[path = "../fuzz/targets/positions.rs"]
mod positions;

/// Truth: what each target itself holds. In a run of the suite a fixed number of inputs, in the campaign for a time.
#[test]
fn campaign_fuzz() {
    Fuzz::of("elements").run(elements::run);
    Fuzz::of("ephemeris").run(positions::run);
}
