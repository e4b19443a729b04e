//! Tells the crate what the sources are that a study's numbers come from.
//!
//! Within a checkout the version alone does not say it: shards that two states of the physics made must not lie in one folder. A hash of the sources says more
//! than a commit, which does not know of changes that are not committed, and changes with every page of the guide. A crate from the registry has no other
//! sources beside it: there the version says all.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Folders of a crate whose files change no number.
const NOT_NUMBERS: [&str; 5] = ["tests", "benches", "examples", "fuzz", "target"];

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let own = PathBuf::from(std::env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default());
    let Some(root) = own.parent() else { return };
    let mut crates = BTreeSet::new();
    reach(root, "study", &mut crates);
    let mut files = BTreeMap::new();
    for name in &crates {
        collect(&root.join(name), name, &mut files);
    }
    if crates.len() > 1 {
        let lock = root.join("Cargo.lock");
        println!("cargo::rerun-if-changed={}", lock.display());
        files.insert("Cargo.lock".into(), std::fs::read(lock).unwrap_or_default());
    }
    // FNV-1a of 64 bits, with the length of each piece: nobody forges the sources of a program that they build.
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    let mut add = |bytes: &[u8]| {
        for byte in (bytes.len() as u64).to_le_bytes().iter().chain(bytes) {
            hash = (hash ^ u64::from(*byte)).wrapping_mul(0x100_0000_01b3);
        }
    };
    for (name, bytes) in &files {
        add(name.as_bytes());
        add(bytes);
    }
    let text = if crates.len() > 1 { format!(" (sources {hash:016x})") } else { String::new() };
    println!("cargo::rustc-env=SUNGLINT_STUDY_SOURCES={text}");
}

/// The folders of the crates of this checkout that a crate depends on, and its own.
fn reach(root: &Path, name: &str, found: &mut BTreeSet<String>) {
    let manifest = root.join(name).join("Cargo.toml");
    let Ok(text) = std::fs::read_to_string(&manifest) else { return };
    if !found.insert(name.to_owned()) {
        return;
    }
    println!("cargo::rerun-if-changed={}", manifest.display());
    let mut counts = true;
    for line in text.lines() {
        if line.starts_with('[') {
            counts = !line.contains("dev-dependencies");
        }
        let begin = line.trim_start_matches("[dependencies.");
        if let Some(rest) = begin.strip_prefix("sunglint-").filter(|_| counts) {
            let end = rest.find(|c: char| !(c.is_ascii_alphanumeric() || c == '-'));
            reach(root, &rest[..end.unwrap_or(rest.len())], found);
        }
    }
}

/// All files of a folder that may change numbers, by their names from the checkout's root.
fn collect(folder: &Path, name: &str, files: &mut BTreeMap<String, Vec<u8>>) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        let (path, own) = (entry.path(), entry.file_name());
        let own = own.to_string_lossy();
        let is_manifest =
            own.starts_with("Cargo.toml") || own == "README.md" || own.starts_with('.');
        match path.is_dir() {
            true if NOT_NUMBERS.contains(&&*own) => {}
            true => {
                // Not the crate's own folder: the corpus of its fuzz targets would be looked through.
                println!("cargo::rerun-if-changed={}", path.display());
                collect(&path, &format!("{name}/{own}"), files);
            }
            false if is_manifest => {}
            false => {
                files.insert(format!("{name}/{own}"), std::fs::read(&path).unwrap_or_default());
            }
        }
    }
}
