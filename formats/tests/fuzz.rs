//! Every reader of this crate, with seeds that are changed at random: the targets of `fuzz/` without its compiler.

use sunglint_testkit::Fuzz;

#[path = "../fuzz/targets/astm.rs"]
mod astm;
#[path = "../fuzz/targets/bsdf.rs"]
mod bsdf;
#[path = "../fuzz/targets/crd.rs"]
mod crd;
#[path = "../fuzz/targets/curve.rs"]
mod curve;
#[path = "../fuzz/targets/ecsv.rs"]
mod ecsv;
#[path = "../fuzz/targets/events.rs"]
mod events;
#[path = "../fuzz/targets/fits.rs"]
mod fits;
#[path = "../fuzz/targets/fred.rs"]
mod fred;
#[path = "../fuzz/targets/jcamp.rs"]
mod jcamp;
#[path = "../fuzz/targets/merl.rs"]
mod merl;
#[path = "../fuzz/targets/opus.rs"]
mod opus;
#[path = "../fuzz/targets/photometry.rs"]
mod photometry;
#[path = "../fuzz/targets/tags.rs"]
mod tags;
#[path = "../fuzz/targets/toml.rs"]
mod toml;
#[path = "../fuzz/targets/utc.rs"]
mod utc;
#[path = "../fuzz/targets/utia.rs"]
mod utia;
#[path = "../fuzz/targets/wcs.rs"]
mod wcs;
#[path = "../fuzz/targets/zemax.rs"]
mod zemax;

/// Name of a target, further folders of seeds, and the target.
type Target = (&'static str, &'static [&'static str], fn(&[u8]));

/// Truth: what each target itself holds: no panic, and what is written reads the same. In a run of the suite a fixed number of inputs, in the campaign for a time.
#[test]
fn campaign_fuzz() {
    let targets: [Target; 18] = [
        ("astm", &[], astm::run),
        ("bsdf", &["fixtures/formats/hostile"], bsdf::run),
        ("crd", &["fixtures/formats/hostile"], crd::run),
        ("curve", &["fixtures/formats/hostile"], curve::run),
        ("ecsv", &["fixtures/formats/hostile"], ecsv::run),
        ("events", &[], events::run),
        ("fits", &["fixtures/formats/hostile"], fits::run),
        ("fred", &[], fred::run),
        ("jcamp", &[], jcamp::run),
        ("merl", &[], merl::run),
        ("opus", &[], opus::run),
        ("photometry", &[], photometry::run),
        ("tags", &["fixtures/tags"], tags::run),
        ("toml", &["fixtures/formats/hostile"], toml::run),
        ("utc", &[], utc::run),
        ("utia", &[], utia::run),
        ("wcs", &[], wcs::run),
        ("zemax", &[], zemax::run),
    ];
    for (name, folders, target) in targets {
        let fuzz = folders.iter().fold(Fuzz::of(name), |fuzz, folder| fuzz.with(folder));
        fuzz.run(target);
    }
}

/// Truth: what stands in the seeds. A seed that its reader refuses reaches nothing behind the refusal.
#[test]
fn seeds_reach_the_readers_of_other_layouts() {
    use sunglint_formats::photometry::{ColumnNames, ObjectRows, Scale, import};
    let seed = |name: &str| {
        let path = sunglint_testkit::repository().join("fixtures/fuzz").join(name);
        std::fs::read(path).expect("a seed")
    };
    for name in ["index_nk.yml", "index_two.yml", "index_export.csv", "index_old.csv"] {
        let text = String::from_utf8(seed(&format!("curve/{name}"))).expect("text");
        for (column, values) in [("n", [0.5, 0.75]), ("k", [3.5, 4.0])] {
            let curve = sunglint_formats::curve::read_str(name, &text, Some(column));
            assert_eq!(curve.expect("a curve").y, values, "{name}");
        }
    }
    let text = String::from_utf8(seed("curve/ecostress.txt")).expect("text");
    let curve = sunglint_formats::curve::read_str("x", &text, Some("reflectance"));
    assert_eq!(curve.expect("a curve").x, [300.0, 14_000.0]);
    let mut names = ColumnNames::default();
    names.scale = Some(Scale::Utc);
    for (name, of_flux) in [
        ("day_first.csv", false),
        ("atlas.txt", false),
        ("objects.csv", false),
        ("fluxes.csv", true),
        ("astroimagej.tbl", true),
    ] {
        let bytes = seed(&format!("photometry/{name}"));
        let read = import(name, bytes, &names, &ObjectRows::All);
        let read = read.unwrap_or_else(|error| panic!("{error}"));
        assert_eq!((read.samples.time.len(), read.of_flux), (2, of_flux), "{name}");
    }
}
