//! Writes the assembled materials that `benches/assembled_truths.py` asks Mitsuba about.
//!
//! `cargo run -p sunglint-calibration --example assembled_files -- FOLDER`
#![allow(clippy::unwrap_used, reason = "an example that cannot write should stop")]
#![allow(dead_code, reason = "the tests use the rest")]

#[path = "../tests/material/cases.rs"]
mod cases;

fn main() {
    let folder = std::path::PathBuf::from(std::env::args().nth(1).unwrap());
    std::fs::create_dir_all(&folder).unwrap();
    let names = cases::MATERIALS.map(|m| m.0);
    for name in names.into_iter().chain(["glossy"]) {
        let made = if name == "glossy" { cases::glossy_whole() } else { cases::whole(name) };
        std::fs::write(folder.join(format!("{name}.bsdf")), made.file.to_bytes().unwrap()).unwrap();
    }
}
