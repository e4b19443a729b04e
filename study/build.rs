//! Tells the crate what the sources are that a study's numbers come from.
//!
//! Within a checkout the version alone does not say it: shards that two states of the physics made must not lie in one folder. A hash of the sources says more
//! than a commit, which does not know of changes that are not committed, and changes with every page of the guide. A crate from the registry has no other
//! sources beside it: there the version says all.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Folders of a crate that change no number, and are not packed.
const NOT_NUMBERS: [&str; 5] = ["tests", "benches", "examples", "fuzz", "target"];

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let own = PathBuf::from(std::env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default());
    let Some(root) = own.parent() else { return };
    let mut crates = BTreeMap::new();
    reach(root, "study", &mut crates);
    let mut files = BTreeMap::new();
    for (name, folders) in &crates {
        for folder in folders {
            collect(&root.join(name).join(folder), &format!("{name}/{folder}"), &mut files);
        }
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

/// The crates of this checkout that a crate depends on, and its own, with the folders that are packed with each: what is not packed is in no program, and a
/// source distribution, which has nothing else, has the same sources.
fn reach(root: &Path, name: &str, found: &mut BTreeMap<String, Vec<String>>) {
    let manifest = root.join(name).join("Cargo.toml");
    let Ok(text) = std::fs::read_to_string(&manifest) else { return };
    if found.contains_key(name) {
        return;
    }
    println!("cargo::rerun-if-changed={}", manifest.display());
    let packed = text.split_once("\ninclude = [").and_then(|(_, rest)| rest.split_once(']'));
    let folders = match packed {
        Some((list, _)) => {
            let patterns = list.split('"').filter_map(|pattern| pattern.strip_suffix("/**"));
            patterns.map(str::to_owned).collect()
        }
        None => folders(&root.join(name)),
    };
    found.insert(name.to_owned(), folders);
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

/// Folders of a crate that packs all of them but those of its tests.
fn folders(of: &Path) -> Vec<String> {
    let Ok(entries) = std::fs::read_dir(of) else { return Vec::new() };
    let folders = entries.flatten().filter(|entry| entry.path().is_dir());
    let names = folders.map(|entry| entry.file_name().to_string_lossy().into_owned());
    names.filter(|name| !NOT_NUMBERS.contains(&name.as_str())).collect()
}

/// All files of a folder, by their names from the checkout's root.
fn collect(folder: &Path, name: &str, files: &mut BTreeMap<String, Vec<u8>>) {
    println!("cargo::rerun-if-changed={}", folder.display());
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        let (path, own) = (entry.path(), entry.file_name());
        let name = format!("{name}/{}", own.to_string_lossy());
        if path.is_dir() {
            collect(&path, &name, files);
        } else if !own.as_encoded_bytes().starts_with(b".") {
            files.insert(name, std::fs::read(&path).unwrap_or_default());
        }
    }
}
