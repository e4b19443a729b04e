//! Every reader of this crate, with seeds that are changed at random: the targets of `fuzz/` without its compiler.

use sunglint_testkit::Fuzz;

#[path = "../fuzz/targets/alpaca.rs"]
mod alpaca;
#[path = "../fuzz/targets/apt.rs"]
mod apt;
#[path = "../fuzz/targets/elliptec.rs"]
mod elliptec;
#[path = "../fuzz/targets/indi.rs"]
mod indi;
#[path = "../fuzz/targets/newport.rs"]
mod newport;
#[path = "../fuzz/targets/ophir.rs"]
mod ophir;
#[path = "../fuzz/targets/ptu.rs"]
mod ptu;
#[path = "../fuzz/targets/recording.rs"]
mod recording;
#[path = "../fuzz/targets/scpi.rs"]
mod scpi;
#[path = "../fuzz/targets/spectra.rs"]
mod spectra;
#[path = "../fuzz/targets/standa.rs"]
mod standa;
#[path = "../fuzz/targets/swabian.rs"]
mod swabian;
#[path = "../fuzz/targets/thorlabs.rs"]
mod thorlabs;
#[path = "../fuzz/targets/zaber.rs"]
mod zaber;
#[path = "../fuzz/targets/zmtp.rs"]
mod zmtp;
#[path = "../fuzz/targets/zwo.rs"]
mod zwo;

/// Name of a target, further folders of seeds, and the target.
type Target = (&'static str, &'static [&'static str], fn(&[u8]));

/// Truth: what each target itself holds: no panic, and what is written reads the same. In a run of the suite a fixed number of inputs, in the campaign for a time.
#[test]
fn campaign_fuzz() {
    let targets: [Target; 16] = [
        ("alpaca", &[], alpaca::run),
        ("apt", &[], apt::run),
        ("elliptec", &["fixtures/elliptec"], elliptec::run),
        ("indi", &[], indi::run),
        ("newport", &["fixtures/esp301", "fixtures/smc100"], newport::run),
        ("ophir", &[], ophir::run),
        ("ptu", &[], ptu::run),
        ("recording", &["fixtures/indi", "fixtures/ophir", "fixtures/swabian"], recording::run),
        ("spectra", &[], spectra::run),
        ("scpi", &[], scpi::run),
        ("standa", &[], standa::run),
        ("swabian", &[], swabian::run),
        ("thorlabs", &[], thorlabs::run),
        ("zaber", &["fixtures/zaber"], zaber::run),
        ("zmtp", &[], zmtp::run),
        ("zwo", &[], zwo::run),
    ];
    for (name, folders, target) in targets {
        let fuzz = folders.iter().fold(Fuzz::of(name), |fuzz, folder| fuzz.with(folder));
        fuzz.run(target);
    }
}
