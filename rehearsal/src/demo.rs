//! The demonstration's night: an hour with two satellites that are made up, and with stars to calibrate by.

/// The files, names and texts. `virtual.toml` wants the simulated light curves of both scenes, as `simulated/NAME.ecsv`.
pub const FILES: [(&str, &str); 6] = [
    ("pass.toml", include_str!("../demo/pass.toml")),
    ("sphere.toml", include_str!("../demo/sphere.toml")),
    ("night.toml", include_str!("../demo/night.toml")),
    ("devices.toml", include_str!("../demo/devices.toml")),
    ("virtual.toml", include_str!("../demo/virtual.toml")),
    ("satellites.tle", include_str!("../demo/satellites.tle")),
];

/// The files with another seed of the night: `seed` is added to the file's own.
pub fn files(seed: u64) -> Vec<(&'static str, String)> {
    let own = format!("seed = {}\n", seed.wrapping_add(1));
    FILES.iter().map(|(name, text)| (*name, text.replace("seed = 1\n", &own))).collect()
}
