//! The crates see only whom they may see.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use std::collections::{BTreeMap, BTreeSet};
use std::process::Command;
use sunglint_testkit::repository;

type Graph = BTreeMap<String, BTreeSet<String>>;

/// The table in ARCHITECTURE.md: a crate, and those that it may depend on.
fn table() -> Graph {
    let text = std::fs::read_to_string(repository().join("ARCHITECTURE.md")).unwrap();
    let part = text.split("## Who may see whom").nth(1).unwrap().split("\n## ").next().unwrap();
    let rows = part.lines().filter_map(|line| {
        let (name, others) = line.strip_prefix("| `")?.split_once("` |")?;
        let others = others.trim_end_matches('|').split(',').map(str::trim);
        let others = others.filter(|o| !o.is_empty()).map(str::to_owned).collect();
        Some((name.to_owned(), others))
    });
    rows.collect()
}

/// The normal dependencies of our crates on one another, as cargo knows them.
fn graph() -> Graph {
    let cargo = std::env::var("CARGO").unwrap_or_else(|_| "cargo".into());
    let output = Command::new(cargo)
        .args(["metadata", "--locked", "--offline", "--no-deps", "--format-version", "1"])
        .current_dir(repository())
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let metadata: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let ours = |name: &str| name.strip_prefix("sunglint-").map(str::to_owned);
    let packages = metadata["packages"].as_array().unwrap().iter();
    let of = |package: &serde_json::Value| {
        let normal = package["dependencies"].as_array().unwrap().iter();
        let normal = normal.filter(|d| d["kind"].is_null());
        let seen = normal.filter_map(|d| ours(d["name"].as_str().unwrap())).collect();
        Some((ours(package["name"].as_str().unwrap())?, seen))
    };
    packages.filter_map(of).collect()
}

fn reach(graph: &Graph, from: &str) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    let mut open = vec![from.to_owned()];
    while let Some(name) = open.pop() {
        for next in &graph[&name] {
            if found.insert(next.clone()) {
                open.push(next.clone());
            }
        }
    }
    found
}

/// Truth: the table of ARCHITECTURE.md beside what cargo says.
#[test]
fn crates_see_only_whom_they_may_see() {
    let (table, mut graph) = (table(), graph());
    // The tests' own crate is in no program.
    assert!(graph.remove("testkit").unwrap().is_empty());
    assert!(table.len() >= 10, "{table:?}");
    assert_eq!(table.keys().collect::<Vec<_>>(), graph.keys().collect::<Vec<_>>());
    for (name, seen) in &graph {
        let beyond: Vec<&String> = seen.difference(&table[name]).collect();
        assert!(
            beyond.is_empty(),
            "{name} depends on {beyond:?}, which ARCHITECTURE.md does not allow"
        );
    }
    for (name, never) in [
        ("calibration", &["simulator"][..]),
        ("analysis", &["simulator"]),
        ("virtual", &["calibration", "materials", "inference", "observatory"]),
    ] {
        let reached = reach(&graph, name);
        let seen: Vec<_> = never.iter().filter(|other| reached.contains(**other)).collect();
        assert!(seen.is_empty(), "{name} sees {seen:?}");
    }
}

/// Packages with the features that they are built with, where `arguments` choose what is built.
fn built_with(arguments: &[&str]) -> BTreeSet<String> {
    let cargo = std::env::var("CARGO").unwrap_or_else(|_| "cargo".into());
    let output = Command::new(cargo)
        .args(["tree", "--locked", "--prefix", "none", "-f", "{p} {f}"])
        .args(arguments)
        .current_dir(repository())
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    let lines = text.lines().map(|l| l.replace(" (*)", "").trim().to_owned());
    lines.filter(|l| !l.is_empty() && !l.starts_with("sunglint v")).collect()
}

/// The program, the wheel and the tests share one build: no package has other features in one of them. Truth: cargo's own tree.
#[test]
fn what_is_built_once_serves_the_program_the_wheel_and_the_tests() {
    let tests = built_with(&["--workspace", "--features", "sunglint/opencv,sunglint/study"]);
    for package in ["sunglint", "sunglint-python"] {
        let own = built_with(&["-p", package, "-e", "no-dev"]);
        assert!(own.len() > 100, "{own:?}");
        let apart: Vec<_> = own.difference(&tests).collect();
        assert!(
            apart.is_empty(),
            "{package} builds these once more: give it the features that the tests ask of them \
             (see the build-dependencies in Cargo.toml): {apart:?}"
        );
    }
}

/// The names in a folder that end with `.rs`, without the ending.
fn sources(folder: &std::path::Path) -> BTreeSet<String> {
    let entries = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name());
    let names = entries.filter_map(|n| Some(n.to_str()?.strip_suffix(".rs")?.to_owned()));
    names.collect()
}

/// A fuzz target is one line around a function that the suite runs, too, so that it needs no build of its own here: only that line and its entry in the manifest could be missing.
#[test]
fn every_fuzz_target_is_run_by_the_suite() {
    for room in ["drivers", "ephemeris", "formats"] {
        let fuzz = repository().join(room).join("fuzz");
        let targets = sources(&fuzz.join("targets"));
        assert!(!targets.is_empty(), "{room}");
        assert_eq!(sources(&fuzz.join("fuzz_targets")), targets, "{room}");
        let manifest = std::fs::read_to_string(fuzz.join("Cargo.toml")).unwrap();
        let suite = std::fs::read_to_string(repository().join(room).join("tests/fuzz.rs")).unwrap();
        for target in targets {
            let line =
                std::fs::read_to_string(fuzz.join("fuzz_targets").join(format!("{target}.rs")));
            let line = line.unwrap();
            for part in [
                format!("#[path = \"../targets/{target}.rs\"]\nmod target;"),
                "libfuzzer_sys::fuzz_target!(|bytes: &[u8]| target::run(bytes));".to_owned(),
            ] {
                assert!(line.contains(&part), "{room}: {target}.rs lacks\n{part}");
            }
            let entry = format!("name = \"{target}\"\npath = \"fuzz_targets/{target}.rs\"");
            assert!(manifest.contains(&entry), "{room}: {target} is not in the manifest");
            assert!(suite.contains(&format!("{target}::run")), "{room}: {target} is not run");
        }
    }
}

/// Bare pairs of numbers that stay in public items, each with why: the file, what the line begins with, the reason.
const BARE_PAIRS: [(&str, &str, &str); 16] = [
    ("analysis/src/period/fit.rs", "pub harmonics:", "cosine and sine, as in sessions"),
    ("analysis/src/period/lomb_scargle.rs", "pub fn coefficients", "of a crate's own type"),
    ("analysis/src/sessions/verdict.rs", "pub harmonics:", "cosine and sine, as in period"),
    ("formats/src/session/index.rs", "pub range_hz:", "formats does not see numerics' Interval"),
    ("formats/src/wcs.rs", "pub const fn to_array", "the numbers of a named type"),
    ("materials/src/plan/mod.rs", "pub marks_deg:", "two marks of a rig: incidence, detector"),
    ("numerics/src/axes.rs", "pub const fn to_array", "the numbers of a named type"),
    ("numerics/src/measured.rs", "pub const fn to_array", "the numbers of a named type"),
    ("numerics/src/measured.rs", "pub const fn to_array", "the numbers of a named type"),
    ("observatory/src/telescope/plan.rs", "pub first_deg:", "one angle at two times, in no order"),
    ("radiometry/src/sky/angles.rs", "pub const fn to_array", "the numbers of a named type"),
    ("rehearsal/src/track.rs", "pub truth:", "rows of a table: time, distance"),
    ("report/src/track.rs", "pub fn knows", "rows of a table: time, distance"),
    (
        "simulator/src/light/earth/grid.rs",
        "pub places_deg:",
        "rows of a table: latitude, longitude",
    ),
    ("simulator/src/light/pieces.rs", "pub fn polygons", "corners as the clipping keeps them"),
    ("virtual/src/telescope.rs", "pub site_deg:", "latitude and longitude of a made-up site"),
];

/// The lines of public items in a folder's sources that hold a bare pair, each with its file. Arguments on lines of their own are not seen.
fn bare_pairs(folder: &std::path::Path, found: &mut Vec<(String, String)>) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    for path in entries.map(|entry| entry.unwrap().path()) {
        if path.is_dir() {
            bare_pairs(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            let name = path.strip_prefix(repository()).unwrap().to_str().unwrap().to_owned();
            let text = std::fs::read_to_string(&path).unwrap();
            let lines = text.lines().map(str::trim_start);
            let bare = lines.filter(|l| l.starts_with("pub ") && l.contains("[f64; 2]"));
            found.extend(bare.map(|line| (name.clone(), line.to_owned())));
        }
    }
}

/// A pair of numbers in the public API has a type that says what it is. Truth: the sources.
#[test]
fn public_items_hold_few_bare_pairs() {
    let mut found = Vec::new();
    bare_pairs(&repository().join("src"), &mut found);
    for entry in std::fs::read_dir(repository()).unwrap() {
        bare_pairs(&entry.unwrap().path().join("src"), &mut found);
    }
    let mut open = BARE_PAIRS.to_vec();
    found.retain(|(file, line)| {
        let known = open.iter().position(|(f, begin, _)| f == file && line.starts_with(begin));
        known.map(|known| open.remove(known)).is_none()
    });
    assert!(
        found.is_empty(),
        "name what these are (glam's DVec2, numerics' Interval, Measured or Axes, Equatorial, AzimuthAltitude), or say in BARE_PAIRS why not: {found:?}"
    );
    assert!(open.is_empty(), "no longer there: take them out of BARE_PAIRS: {open:?}");
    assert!(BARE_PAIRS.len() <= 20);
}
