//! Writes the `.bsdf` files that `benches/bsdf_truths.py` asks Mitsuba about.
//!
//! `cargo run -p sunglint-simulator --example bsdf_files -- FOLDER`
#![allow(clippy::unwrap_used, reason = "an example that cannot write should stop")]

#[path = "../tests/materials/cases.rs"]
mod cases;

fn main() {
    let folder = std::path::PathBuf::from(std::env::args().nth(1).unwrap());
    std::fs::create_dir_all(&folder).unwrap();
    for (name, file) in cases::files() {
        std::fs::write(folder.join(format!("{name}.bsdf")), file.to_bytes().unwrap()).unwrap();
    }
}
