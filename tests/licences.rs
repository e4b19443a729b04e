//! Every package that is built into the program has a licence that we may ship.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use std::process::Command;

/// Licences that we accept; of an `OR`, one side is enough. MPL-2.0 and Unicode-3.0 ask for their texts only.
const ACCEPTED: &[&str] = &[
    "MIT",
    "Apache-2.0",
    "Apache-2.0 WITH LLVM-exception",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "ISC",
    "Zlib",
    "0BSD",
    "Unlicense",
    "CC0-1.0",
    "BSL-1.0",
    "MPL-2.0",
    "Unicode-3.0",
];

/// An SPDX expression (with the old `/` for OR): AND binds closer than OR, parentheses closest.
fn accepted(expression: &str) -> bool {
    let spaced = expression.replace('/', " OR ").replace('(', " ( ").replace(')', " ) ");
    let words: Vec<&str> = spaced.split_whitespace().collect();
    let mut rest = words.as_slice();
    any(&mut rest) == Some(true) && rest.is_empty()
}

fn any(words: &mut &[&str]) -> Option<bool> {
    let mut good = all(words)?;
    while let Some(("OR", after)) = words.split_first().map(|(w, after)| (*w, after)) {
        *words = after;
        good |= all(words)?;
    }
    Some(good)
}

fn all(words: &mut &[&str]) -> Option<bool> {
    let mut good = one(words)?;
    while let Some(("AND", after)) = words.split_first().map(|(w, after)| (*w, after)) {
        *words = after;
        good &= one(words)?;
    }
    Some(good)
}

fn one(words: &mut &[&str]) -> Option<bool> {
    let (first, mut after) = words.split_first()?;
    if *first == "(" {
        let good = any(&mut after)?;
        *words = after.strip_prefix(&[")"])?;
        return Some(good);
    }
    let mut name = (*first).to_owned();
    if let [with, exception, more @ ..] = after
        && *with == "WITH"
    {
        name = format!("{name} WITH {exception}");
        after = more;
    }
    *words = after;
    Some(ACCEPTED.contains(&name.as_str()))
}

#[test]
fn every_dependency_may_be_shipped() {
    let cargo = std::env::var("CARGO").unwrap_or_else(|_| "cargo".into());
    let output = Command::new(cargo)
        .args(["tree", "--locked", "--offline", "--workspace", "--edges", "normal,build"])
        .args(["--prefix", "none", "--format", "{p}\t{l}"])
        // What `./test` builds with beyond the defaults.
        .args(std::env::var("SUNGLINT_FEATURES").map(|features| format!("--features={features}")))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    let mut packages: Vec<(&str, &str)> = text
        .lines()
        .map(|l| l.trim_end_matches(" (*)"))
        .filter_map(|l| l.split_once('\t'))
        .collect();
    packages.sort_unstable();
    packages.dedup();
    assert!(packages.len() > 30, "cargo tree lists only {} packages", packages.len());
    let refused: Vec<_> = packages.iter().filter(|(_, licence)| !accepted(licence)).collect();
    assert!(refused.is_empty(), "not accepted: {refused:?}");
}

/// Libraries in C whose source a package carries and builds in: the package, the library's licence in it, a phrase of that text.
///
/// libusb is LGPL-2.1-or-later and linked statically. That licence (section 6) asks that whoever has the program can link it
/// anew with a libusb of their own: the program's whole source and its build are open, so they can (README, "Licence").
/// hidapi's library may be taken under BSD-3-Clause; on Linux the package speaks to the kernel by itself and builds none of it.
const BUNDLED: &[(&str, &str, &str)] = &[
    ("hidapi", "etc/hidapi/LICENSE-bsd.txt", "Redistribution and use in source and binary forms"),
    ("libusb1-sys", "libusb/COPYING", "GNU LESSER GENERAL PUBLIC LICENSE"),
];

/// Truth: the licence's text in the package that carries it; and no other package of ours carries a library (`links` in its
/// manifest; rayon-core's and the like link nothing).
#[test]
fn libraries_in_c_are_known_and_told() {
    let cargo = std::env::var("CARGO").unwrap_or_else(|_| "cargo".into());
    let run = |arguments: &[&str]| {
        let mut command = Command::new(&cargo);
        let output =
            command.args(arguments).current_dir(env!("CARGO_MANIFEST_DIR")).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    let tree = run(&[
        "tree",
        "--locked",
        "--offline",
        "-p",
        "sunglint",
        "--edges",
        "normal",
        "--prefix",
        "none",
        "--format",
        "{p}",
    ]);
    let ours = |name: &str| tree.lines().any(|line| line.starts_with(&format!("{name} v")));
    // A machine that has only built the program has no packages of other platforms.
    let host = std::env::consts::ARCH;
    let platform = format!("{host}-unknown-linux-gnu");
    let metadata = run(&[
        "metadata",
        "--locked",
        "--offline",
        "--filter-platform",
        &platform,
        "--format-version",
        "1",
    ]);
    let metadata: serde_json::Value = serde_json::from_str(&metadata).unwrap();
    let mut linking = Vec::new();
    for package in metadata["packages"].as_array().unwrap() {
        let name = package["name"].as_str().unwrap();
        // What says `links` only so that it is there once.
        if package["links"].is_null() || name == "rayon-core" || !ours(name) {
            continue;
        }
        linking.push(name.to_owned());
        if let Some((_, text, phrase)) = BUNDLED.iter().find(|(known, ..)| *known == name) {
            let manifest = std::path::Path::new(package["manifest_path"].as_str().unwrap());
            let text = std::fs::read_to_string(manifest.parent().unwrap().join(text)).unwrap();
            assert!(text.contains(phrase), "{name}");
        }
    }
    let known: Vec<&str> = BUNDLED.iter().map(|(name, ..)| *name).collect();
    assert_eq!(linking, known);
    let readme =
        std::fs::read_to_string(std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("README.md"))
            .unwrap();
    assert!(readme.contains("libusb") && readme.contains("LGPL-2.1-or-later"));
}

#[test]
fn expressions_are_read() {
    assert!(accepted("MIT OR GPL-3.0"));
    assert!(accepted("Apache-2.0/MIT"));
    assert!(accepted("(MIT OR Apache-2.0) AND Unicode-3.0"));
    assert!(!accepted("GPL-3.0"));
    assert!(!accepted("MIT AND GPL-3.0"));
    assert!(!accepted("GPL-3.0 AND (MIT OR Apache-2.0)"));
    assert!(accepted("(GPL-3.0 AND MIT) OR Apache-2.0 WITH LLVM-exception"));
    assert!(!accepted("") && !accepted("MIT OR") && !accepted("(MIT"));
}
