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

/// The files of a shorter night, names and texts: one satellite, `demo-sat`, a cube that turns, and stars to calibrate by. `virtual.toml` wants the simulated light
/// curve of `pass.toml`, as `simulated/demo-sat.ecsv`.
pub const SHORT: [(&str, &str); 4] = [
    ("pass.toml", include_str!("../demo/short/pass.toml")),
    ("night.toml", include_str!("../demo/short/night.toml")),
    ("virtual.toml", include_str!("../demo/short/virtual.toml")),
    ("satellites.tle", include_str!("../demo/satellites.tle")),
];

/// The files of the shorter night with another seed: `seed` is added to the file's own.
pub fn short_files(seed: u64) -> Vec<(&'static str, String)> {
    let own = format!("seed = {}\n", seed.wrapping_add(1));
    SHORT.iter().map(|(name, text)| (*name, text.replace("seed = 1\n", &own))).collect()
}
