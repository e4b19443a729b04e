//! A synthetic night: linear light curves of stars as `sunglint star` predicts them, over a κ, with scatter and dimmed stars put in.

use super::Folder;
use serde_json::json;
use std::fmt::Write as _;

/// Stars with types in the catalogue, and evening hours at which they stand at several airmasses above the built-in station.
pub const VISITS: [(&str, &str); 10] = [
    ("Vega", "18:00"),
    ("Deneb", "18:10"),
    ("Altair", "18:20"),
    ("Capella", "18:30"),
    ("Aldebaran", "19:30"),
    ("Alpheratz", "19:40"),
    ("Polaris", "20:00"),
    ("Algol", "20:10"),
    ("Mirfak", "20:20"),
    ("Castor", "22:00"),
];
pub const KAPPA: [(&str, f64); 2] = [("g", 0.45), ("spcm", 29.64)];

/// A number from −1 to 1 that looks like chance, the same every time.
fn chance(i: usize) -> f64 {
    2.0 * ((i as f64 + 1.0) * 0.754_877_666 % 1.0) - 1.0
}

/// A linear light curve of a visit, as `reduce` writes it, written out by hand here.
pub fn curve(folder: &Folder, date: &str, i: usize, scale: f64) {
    hazy_curve(folder, date, i, scale, 0.0);
}

/// The same behind a grey haze of that depth at the zenith, by Kasten and Young's airmass (1989).
pub fn hazy_curve(folder: &Folder, date: &str, i: usize, scale: f64, depth: f64) {
    let (star, hour) = VISITS[i];
    let at = format!("{date}T{hour}:00");
    let found = folder.json(&["star", star, "--station", "ufo", "--at", &at, "--json"]);
    let sample = &found["samples"][0];
    let zenith = sample["zenith_true_deg"].as_f64().unwrap();
    let airmass =
        1.0 / (zenith.to_radians().cos() + 0.505_72 * (96.079_95 - zenith).powf(-1.636_4));
    let scale = scale * (-depth * airmass).exp();
    let mut text = String::from("# %ECSV 1.0\n# ---\n# datatype:\n");
    for (name, kind) in [("time_utc", "string"), ("exposure_s", "float64")] {
        let _ = writeln!(text, "# - {{name: {name}, datatype: {kind}}}");
    }
    for (channel, _) in KAPPA {
        for (suffix, kind) in [("rate_hz", "float64"), ("sigma_hz", "float64"), ("flags", "int64")]
        {
            let _ = writeln!(text, "# - {{name: {channel}_{suffix}, datatype: {kind}}}");
        }
    }
    let _ = writeln!(text, "# - {{name: zenith_deg, datatype: float64}}");
    let meta = json!({"quantity": "linear", "flag_bits": {"saturated": 0}, "target": {"name": star, "kind": "star", "visit": i}});
    let _ = writeln!(text, "# meta: {meta}\n# schema: astropy-2.0");
    let names: Vec<String> =
        KAPPA.iter().map(|(c, _)| format!("{c}_rate_hz {c}_sigma_hz {c}_flags")).collect();
    let _ = writeln!(text, "time_utc exposure_s {} zenith_deg", names.join(" "));
    for second in 0..10 {
        let _ = write!(text, "{date}T{hour}:{second:02} 1.0");
        for (c, (channel, kappa)) in KAPPA.iter().enumerate() {
            let rates = &sample["rates"][channel];
            let predicted = rates["rate_hz"].as_f64().unwrap();
            let catalogue = 1.0 + 0.02 * chance(7 * i + c);
            let rate = predicted / kappa
                * scale
                * catalogue
                * (1.0 + 0.005 * chance(100 * i + 10 * c + second));
            let _ = write!(text, " {rate} {} 0", 0.004 * rate);
        }
        let _ = writeln!(text, " {zenith}");
    }
    std::fs::write(folder.path(&format!("{date}/{i:02}_{}.ecsv", star.to_lowercase())), text)
        .unwrap();
}

/// A night of them, two stars dimmed by half; `kappa_scale` multiplies κ.
pub fn night(folder: &Folder, date: &str, kappa_scale: f64) {
    std::fs::create_dir_all(folder.path(date)).unwrap();
    for i in 0..VISITS.len() {
        let dimmed = if i == 3 || i == 7 { 0.5 } else { 1.0 };
        curve(folder, date, i, dimmed / kappa_scale);
    }
}
