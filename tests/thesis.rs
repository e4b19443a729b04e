//! The page on the thesis (docs/thesis.md): each row's number found again, and the page as the rows say.
//!
//! `tests/thesis/rows.toml` holds the statements, our numbers and the commands. A row whose `command` begins with `sunglint` is run, and its number read from the JSON document; the others are calls of the
//! library, written here. `SUNGLINT_THESIS=write` (with `SUNGLINT_CAMPAIGN=thesis` for the long ones) records what is found and writes the page's tables.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::Folder;
use glam::{DQuat, DVec3};
use serde_json::Value;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::fmt::Write as _;
use std::path::PathBuf;
use sunglint_calibration::counts::coupling;
use sunglint_calibration::detector::Linearity;
use sunglint_calibration::stars::variation;
use sunglint_calibration::track::Place;
use sunglint_formats::ecsv;
use sunglint_radiometry::air::{Air, Sampling, Zenith};
use sunglint_radiometry::constants::{AU_M, SUN_RADIUS_M};
use sunglint_radiometry::light::sun_at_1_au;
use sunglint_radiometry::passband::ZeroPoint;
use sunglint_radiometry::quadrature::Product;
use sunglint_radiometry::spectrum::{Irradiance, Spectrum};
use sunglint_radiometry::star_light::{self, StarColours};
use sunglint_radiometry::station::{BeamShape, Counter, DeadTime, Detector, Station};
use sunglint_simulator::intensity::{Aspect, Intensities, IntensityOptions, Span};
use sunglint_simulator::light::{Globe, shine};
use sunglint_simulator::picture::spheres::sphere_ratios;
use sunglint_simulator::ranging::Beam;
use sunglint_simulator::scenes;
use sunglint_simulator::surface::Material;
use sunglint_simulator::target::Target;
use sunglint_testkit::{Campaign, fixture, repository};

/// A row of the page.
#[derive(Debug, Clone)]
struct Row {
    id: String,
    /// Place in the thesis.
    at: String,
    says: String,
    /// Value of the thesis as text.
    thesis: String,
    ours: Option<f64>,
    unit: String,
    command: String,
    /// Where the number stands in the document of the command: a JSON pointer; `[name=x]` picks from a list.
    read: String,
    /// Relative change that is let pass.
    within: f64,
    /// An independent value, and how near ours is.
    truth: Option<(f64, f64)>,
    heavy: bool,
    verdict: String,
    why: String,
}

struct Page {
    prepare: Vec<(String, bool)>,
    rows: Vec<Row>,
    words: Vec<[String; 3]>,
}

fn rows_file() -> PathBuf {
    repository().join("tests/thesis/rows.toml")
}

fn page() -> Page {
    let text = std::fs::read_to_string(rows_file()).unwrap();
    let table: toml::Table = text.parse().unwrap();
    let list = |key: &str| table[key].as_array().unwrap().iter().map(|v| v.as_table().unwrap());
    let text = |row: &toml::Table, key: &str| {
        row.get(key).map_or_else(String::new, |v| v.as_str().unwrap().to_owned())
    };
    let number = |row: &toml::Table, key: &str| row.get(key).map(|v| v.as_float().unwrap());
    let flag = |row: &toml::Table| row.get("heavy").is_some_and(|v| v.as_bool().unwrap());
    let rows = list("row").map(|row| Row {
        id: text(row, "id"),
        at: text(row, "at"),
        says: text(row, "says"),
        thesis: text(row, "thesis"),
        ours: number(row, "ours"),
        unit: text(row, "unit"),
        command: text(row, "command"),
        read: text(row, "read"),
        within: number(row, "within").unwrap_or(1e-6),
        truth: number(row, "truth").map(|truth| (truth, number(row, "near").unwrap())),
        heavy: flag(row),
        verdict: text(row, "verdict"),
        why: text(row, "why"),
    });
    Page {
        rows: rows.collect(),
        prepare: list("prepare").map(|row| (text(row, "command"), flag(row))).collect(),
        words: list("word").map(|row| ["at", "says", "why"].map(|key| text(row, key))).collect(),
    }
}

/// A folder with the scenes in which commands run, each once.
struct Work {
    folder: Folder,
    documents: RefCell<BTreeMap<String, Value>>,
}

impl Work {
    fn new(page: &Page, heavy: bool) -> Self {
        let folder = Folder::new("thesis");
        for file in std::fs::read_dir(fixture("thesis")).unwrap() {
            let file = file.unwrap();
            std::fs::copy(file.path(), folder.path(file.file_name().to_str().unwrap())).unwrap();
        }
        let work = Self { folder, documents: RefCell::default() };
        for (command, _) in page.prepare.iter().filter(|(_, only)| heavy || !only) {
            work.done(command);
        }
        work
    }

    fn done(&self, command: &str) -> String {
        let words: Vec<&str> = command.split_whitespace().skip(1).collect();
        self.folder.done(&[&words[..], &["-q"]].concat())
    }

    /// The document of a command; of one that prints lines the last.
    fn json(&self, command: &str) -> Value {
        if let Some(known) = self.documents.borrow().get(command) {
            return known.clone();
        }
        let words: Vec<&str> = command.split_whitespace().skip(1).collect();
        let text = self.folder.done(&[&words[..], &["--json"]].concat());
        let whole = serde_json::from_str(&text);
        let found: Value = whole.unwrap_or_else(|_| {
            Value::Array(text.lines().map(|line| serde_json::from_str(line).unwrap()).collect())
        });
        self.documents.borrow_mut().insert(command.to_owned(), found.clone());
        found
    }
}

/// A number of a document: `/a/0/b`; a part `[key=value]` picks from a list, `1/` at the begin takes the reciprocal.
fn read(document: &Value, pointer: &str) -> Option<f64> {
    if let Some(rest) = pointer.strip_prefix('1') {
        return read(document, rest).map(f64::recip);
    }
    let mut at = document;
    for part in pointer.split('/').skip(1) {
        at = match part.strip_prefix('[').and_then(|p| p.strip_suffix(']')) {
            Some(pick) => {
                let (key, wanted) = pick.split_once('=')?;
                at.as_array()?.iter().find(|one| one[key].as_str() == Some(wanted))?
            }
            None => match part.parse::<usize>() {
                Ok(i) if at.is_array() => at.get(i)?,
                _ => at.get(part)?,
            },
        };
    }
    at.as_f64()
}

fn found(row: &Row, work: &Work) -> Result<f64, String> {
    let value = if row.read.is_empty() {
        library(row, work).ok_or_else(|| format!("{}: no such call", row.id))?
    } else {
        let document = work.json(&row.command);
        read(&document, &row.read)
            .ok_or_else(|| format!("{}: no {} in {document}", row.id, row.read))?
    };
    if value.is_finite() { Ok(value) } else { Err(format!("{}: {value}", row.id)) }
}

fn counter(name: &str) -> Counter {
    let ufo = Station::built_in("ufo").unwrap().unwrap();
    match &ufo.channel(name).unwrap().detector {
        Detector::Counter(counter) => counter.clone(),
        other => panic!("{name}: {other:?}"),
    }
}

fn dead_time_s(name: &str) -> f64 {
    match counter(name).dead_time {
        DeadTime::NonParalysable { dead_time_s } => dead_time_s,
        other => panic!("{name}: {other:?}"),
    }
}

/// The laser of table A.1.
fn graz() -> Beam {
    Beam {
        wavelength_nm: 1064.0,
        linewidth_nm: 1.0,
        pulse_energy_j: 0.140,
        pulse_length_s: 7e-9,
        repetition_rate_hz: 200.0,
        divergence_rad: (5.0_f64 / 3600.0).to_radians(),
        radius_m: 0.06,
        shape: BeamShape::TopHat,
    }
}

/// Sunlight over laser light at a height, km, by the two numbers of appendix A.1.
fn sun_over_laser(km: f64) -> f64 {
    0.66 / (0.97 * graz().peak_spectral_irradiance(km * 1e3))
}

fn air() -> Air {
    let ufo = Station::built_in("ufo").unwrap().unwrap();
    Air::new(&ufo.air_options().unwrap()).unwrap()
}

fn transmission(nm: f64, zenith_deg: f64) -> f64 {
    air().transmission(Zenith::True(zenith_deg), &Sampling::points(&[nm]).unwrap()).unwrap()[0]
}

/// The darkest 5 nm between two wavelengths, nm.
fn darkest_nm(from: f64, to: f64) -> f64 {
    let centres: Vec<f64> =
        (0..).map(|i| from + 0.5 * f64::from(i)).take_while(|nm| *nm <= to).collect();
    let means = Sampling::means(&centres, 2.5).unwrap();
    let found = air().transmission(Zenith::True(0.0), &means).unwrap();
    let least = (0..centres.len()).min_by(|a, b| found[*a].total_cmp(&found[*b])).unwrap();
    centres[least]
}

/// Black body over library for a K2III star from 900 to 1000 nm, photons.
fn black_body_of_k2iii() -> f64 {
    let colours = StarColours {
        v_mag: 5.0,
        b_minus_v_mag: Some(1.127),
        spectral_type: Some("K2III"),
        zero: ZeroPoint::default(),
    };
    let photons = |s: &Spectrum<Irradiance>| {
        Product::of(s).times_wavelength().over(900.0, 1000.0).unwrap().value
    };
    let body = star_light::black_body(colours).unwrap().irradiance;
    photons(&body) / photons(&star_light::of(colours).unwrap().irradiance)
}

/// A foil's mean reflectance in a channel as eq. 7.3 has it, over the one that the channel's rates tell (with sunlight and the air at 45°).
fn upsampling(name: &str) -> f64 {
    let ufo = Station::built_in("ufo").unwrap().unwrap();
    let channel = ufo.channel(name).unwrap();
    let foil = Material::built_in("mli").unwrap().spectra()[0].clone();
    let air = air().spectrum(Zenith::True(45.0), (300.0, 1240.0)).unwrap();
    let mean = |over: Product<'_>, under: Product<'_>| {
        let of =
            |p| channel.times_sensitivity(p).times_wavelength().over(300.0, 1240.0).unwrap().value;
        of(over) / of(under)
    };
    let sun = sun_at_1_au();
    let printed = mean(Product::of(&foil), Product::default());
    let right = mean(Product::of(sun).times(&air).times(&foil), Product::of(sun).times(&air));
    printed / right - 1.0
}

/// Phase curves of a rough sphere of another α, scaled to that of 0.12 between 40 and 95°: the scale less 1, and the relative scatter that is left.
fn lcs_alpha(alpha: f64) -> [f64; 2] {
    let spheres = sphere_ratios(&[0.12, alpha]).unwrap();
    let ratio = |k: usize| spheres[2 + k].ratio[40..=95].to_vec();
    let quotients: Vec<f64> = ratio(0).iter().zip(ratio(1)).map(|(a, b)| a / b).collect();
    let n = quotients.len() as f64;
    let scale = quotients.iter().sum::<f64>() / n;
    let square = quotients.iter().map(|q| (q / scale - 1.0).powi(2)).sum::<f64>() / n;
    [scale - 1.0, square.sqrt()]
}

/// Coupling into the SPCM's fibre at a share q of the gate's area, of that at its centre.
fn coupled(q: f64) -> f64 {
    let fibre = counter("spcm").fibre.unwrap();
    let offset_px = [fibre.offset_px[0] + q.sqrt() * fibre.sigma_px[0], fibre.offset_px[1]].into();
    coupling(&fibre, &Place { offset_px, covariance_px2: [0.0; 3] }).mean
}

/// How often in a turn Ajisai glints: a bisector of 5° latitude, a phase angle of 60°.
fn glints_of_ajisai() -> f64 {
    let target = Target::built_in("ajisai").unwrap();
    let aspects: Vec<Aspect> = (0..720)
        .map(|k| {
            let turn = DQuat::from_rotation_z(f64::from(k) * PI / 360.0);
            let bisector = DVec3::new(5.0_f64.to_radians().cos(), 0.0, 5.0_f64.to_radians().sin());
            let across = DQuat::from_axis_angle(bisector, 0.4) * DVec3::Y;
            let side = |sign: f64| {
                let half = 30.0_f64.to_radians();
                turn * (bisector * half.cos() + across * (sign * half.sin()))
            };
            Aspect::new(side(1.0), side(-1.0))
        })
        .collect();
    let mut span = Span::default();
    aspects.iter().for_each(|a| span.add(a).unwrap());
    let all = Intensities::new(&target, IntensityOptions::default(), &span).unwrap();
    let light: Vec<f64> = all
        .many(&aspects)
        .unwrap()
        .iter()
        .map(|one| one.light[0].per_irradiance_m2_per_sr)
        .collect();
    let bright = light.iter().copied().fold(0.0, f64::max) / 4.0;
    let n = light.len();
    let peak = |k: usize| {
        light[k] > bright && light[k] >= light[(k + n - 1) % n] && light[k] > light[(k + 1) % n]
    };
    (0..n).filter(|k| peak(*k)).count() as f64
}

/// Rates of a simulated CalSphere 4A over those of eq. 7.1, the mean of a channel over the pass.
fn sphere_of_7_1(work: &Work, name: &str) -> f64 {
    let text = std::fs::read_to_string(work.folder.path("calsphere_4a.ecsv")).unwrap();
    let table = ecsv::read_str("calsphere_4a.ecsv", &text).unwrap();
    let column = |name: &str| table.f64(name).unwrap().into_owned();
    let (range_m, phase, zenith) = (column("range_m"), column("phase_deg"), column("zenith_deg"));
    let rate = column(&format!("{name}_rate_hz"));
    let ufo = Station::built_in("ufo").unwrap().unwrap();
    let (channel, air) = (ufo.channel(name).unwrap(), air());
    // The Earth's distance from the Sun on 18 November 2020: the Astronomical Almanac's 0.98846 au.
    let sun: Spectrum<Irradiance> = sun_at_1_au().clone();
    let mut quotients = Vec::new();
    for k in (0..rate.len()).filter(|k| rate[*k].is_finite() && zenith[*k] < 75.0) {
        let through = air
            .spectrum(Zenith::Near { true_deg: zenith[k], range_m: range_m[k] }, (300.0, 1240.0))
            .unwrap();
        let sunlight = ufo.rate_hz(channel, &sun, Some(&through)).value / 0.98846_f64.powi(2);
        let gamma = phase[k].to_radians();
        let f = 2.0 / (3.0 * PI) * (gamma.sin() + (PI - gamma) * gamma.cos());
        quotients.push(rate[k] / ((0.18 / range_m[k]).powi(2) * 0.735 * f * sunlight));
    }
    quotients.iter().sum::<f64>() / quotients.len() as f64
}

/// Mean depth of the light that comes back less that of what is seen, m: the two histograms of figure 5.6.
fn histograms(work: &Work) -> f64 {
    let folder = work.folder.path("ranging");
    let file = std::fs::read_dir(&folder).unwrap().map(|f| f.unwrap().path());
    let file = file.into_iter().find(|f| f.to_str().unwrap().ends_with("_depth.ecsv")).unwrap();
    let table = ecsv::read_str("depth", &std::fs::read_to_string(file).unwrap()).unwrap();
    let names: Vec<&str> = table.columns.iter().map(|c| c.name.as_str()).collect();
    let column = |end: &str| {
        let name = names.iter().find(|n| n.ends_with(end)).unwrap_or_else(|| panic!("{names:?}"));
        table.f64(name).unwrap().into_owned()
    };
    let depth = table.f64(names[0]).unwrap().into_owned();
    let mean = |weights: &[f64]| {
        depth.iter().zip(weights).map(|(d, w)| d * w).sum::<f64>() / weights.iter().sum::<f64>()
    };
    mean(&column("debris_photons")) - mean(&column("true_depth_m2"))
}

/// Calls of the library, by the row's id.
fn library(row: &Row, work: &Work) -> Option<f64> {
    let ufo = || Station::built_in("ufo").unwrap().unwrap();
    let tables: [(&str, [f64; 6]); 6] = [
        ("id400", [940.05, 574.83, 533.22, 487.61, 351.00, 392.34]),
        ("spcm", [31.91, 23.36, 36.59, 26.46, 28.12, 31.41]),
        ("mppc", [12.23, 7.55, 9.80, 8.04, 10.20, 9.96]),
        ("r", [0.43, 0.38, 0.40, 0.39, 0.42, 0.41]),
        ("g", [0.44, 0.42, 0.44, 0.43, 0.48, 0.50]),
        ("b", [0.49, 0.54, 0.47, 0.51, 0.54, 0.52]),
    ];
    let kappa = |name: &str| {
        let (_, nights) = tables.iter().find(|(channel, _)| *channel == name).unwrap();
        variation(nights).unwrap()
    };
    let (call, argument) = row.id.split_once(' ').unwrap_or((&row.id, ""));
    Some(match (call, argument) {
        ("sun_diameter_deg", "") => 2.0 * (SUN_RADIUS_M / AU_M).asin().to_degrees(),
        ("sun_over_laser", km) => sun_over_laser(km.parse().ok()?),
        ("earth_over_laser", km) => {
            let height_m = 1e3 * km.parse::<f64>().ok()?;
            let radius_m = 6_371_000.0;
            let globe = Globe {
                toward: DVec3::NEG_Z,
                distance_m: radius_m + height_m,
                radius_m,
                sun: DVec3::Z,
                to_ground: DQuat::IDENTITY,
            };
            let nodes = shine::cap(&globe, 8);
            let even: f64 = nodes.iter().map(|(d, e)| e * d.dot(globe.toward).max(0.0)).sum();
            1.5 * 0.43 * even * sun_over_laser(height_m / 1e3)
        }
        ("spot_radius_m", km) => graz().spot_radius_m(1e3 * km.parse::<f64>().ok()?),
        ("peak_irradiance", km) => {
            0.97 * graz().peak_spectral_irradiance(1e3 * km.parse::<f64>().ok()?)
        }
        ("pixel_arcsec", "") => ufo().camera?.pixel_scale_arcsec,
        ("area_lost", "") => PI / 4.0 * 0.43_f64.powi(2) / ufo().telescope.area_m2() - 1.0,
        ("sensor_mm2", "") => {
            let (ufo, arcsec) = (ufo(), (1.0_f64 / 3600.0).to_radians());
            let camera = ufo.camera?;
            let pitch_mm =
                1e3 * (camera.pixel_scale_arcsec * arcsec).tan() * ufo.telescope.focal_length_m;
            f64::from(camera.size_px[0]) * f64::from(camera.size_px[1]) * pitch_mm * pitch_mm
        }
        ("most_hz", name) => 1.0 / dead_time_s(name),
        ("true_hz_at_37_mhz", "") => {
            let law = DeadTime::NonParalysable { dead_time_s: dead_time_s("spcm") };
            Linearity::new(&law).ok()?.linearise(37_000_000, 1.0).ok()?.rate_hz
        }
        ("linearised_1_mhz", "") => {
            let law = DeadTime::NonParalysable { dead_time_s: dead_time_s("spcm") };
            Linearity::new(&law).ok()?.linearise(1_000_000, 1.0).ok()?.rate_hz
        }
        ("mppc_counted", hz) => {
            let hz: f64 = hz.parse().ok()?;
            counter("mppc").dead_time.counted_hz(hz)? / hz
        }
        ("pixels_lose", hz) => {
            let DeadTime::MultiPixel { pixels, recovery_s, .. } = counter("mppc").dead_time else {
                return None;
            };
            let hz: f64 = hz.parse().ok()?;
            let alone = DeadTime::MultiPixel { pixels, recovery_s, pulse_s: 0.0 };
            1.0 - alone.counted_hz(hz)? / hz
        }
        ("area_mm2", name) => counter(name).area_mm2?,
        ("colour_temperature", bv) => star_light::colour_temperature_k(bv.parse().ok()?),
        ("black_body", "K2III") => black_body_of_k2iii() - 1.0,
        ("kappa_mean", name) => kappa(name).mean,
        ("kappa_variation", name) => 100.0 * kappa(name).coefficient,
        ("gate", "edge") => coupled(1.0),
        ("gate", "mean") => {
            (0..1000).map(|k| coupled((f64::from(k) + 0.5) / 1000.0)).sum::<f64>() / 1000.0
        }
        ("darkest", window) => {
            let (from, to) = window.split_once(' ')?;
            darkest_nm(from.parse().ok()?, to.parse().ok()?)
        }
        ("transmission", place) => {
            let (nm, zenith) = place.split_once(' ')?;
            transmission(nm.parse().ok()?, zenith.parse().ok()?)
        }
        ("sunlight", nm) => sun_at_1_au().at(nm.parse().ok()?),
        ("rays", "") => scenes::BINS as f64 * 3600.0 * 80.0 / 4.0,
        ("vega_at_0", "") => {
            let star = "sunglint star Altair --station ufo --at 2020-11-18T18:00:00";
            let rate = |more: &str| {
                read(&work.json(&format!("{star}{more}")), "/channels/[name=g]/above_air_hz")
            };
            rate(" --zero-point vega=0")? / rate("")? - 1.0
        }
        ("sphere_7_1", name) => sphere_of_7_1(work, name),
        ("lcs_rms", alpha) => lcs_alpha(alpha.parse().ok()?)[1],
        ("lcs_scale", alpha) => lcs_alpha(alpha.parse().ok()?)[0],
        ("upsampling", name) => upsampling(name),
        ("ajisai_period_s", "") => {
            1.9028 * (0.014_859 * (2020.0 + 318.8 / 366.0 - 2003.0_f64)).exp()
        }
        ("ajisai_glints", "") => glints_of_ajisai(),
        ("histograms_m", "") => histograms(work),
        ("bench", scene) => {
            let lines = work.json(&format!("sunglint bench --scene {scene} --seconds 0.05"));
            let rows = lines.as_array()?;
            let row = rows.iter().find(|r| r["bins"] == 188 && r["engine"] == "exact")?;
            row["relative_error"].as_f64()?
        }
        _ => return None,
    })
}

/// A number as the page shows it.
fn shown(value: f64) -> String {
    let size = value.abs();
    if value == 0.0 {
        "0".into()
    } else if value.fract() == 0.0 && size < 1e6 {
        format!("{value:.0}")
    } else if !(1e-3..1e6).contains(&size) {
        format!("{value:.3e}")
    } else {
        let before = size.log10().floor() as i32 + 1;
        let text = format!("{value:.*}", usize::try_from(5 - before).unwrap_or(0).min(6));
        let whole = text.contains('.');
        if whole { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
    }
}

/// The page's tables, from the rows alone.
fn tables(page: &Page) -> String {
    let mut text = String::from(
        "| where | what the thesis says | its value | ours | verdict | how, and why |\n|---|---|---|---|---|---|\n",
    );
    for row in &page.rows {
        let ours = row.ours.map_or_else(|| "—".to_owned(), shown);
        let unit = if row.unit.is_empty() { String::new() } else { format!(" {}", row.unit) };
        let _ = writeln!(
            text,
            "| {} | {} | {} | {ours}{unit} | {} | `{}`{} {} |",
            row.at,
            row.says,
            row.thesis,
            row.verdict,
            row.command,
            if row.heavy { " (long)." } else { "." },
            row.why
        );
    }
    text.push_str("\n## Statements without a number\n\n| where | what it says | what is right |\n|---|---|---|\n");
    for [at, says, why] in &page.words {
        let _ = writeln!(text, "| {at} | {says} | {why} |");
    }
    text
}

const MARKS: [&str; 2] = ["<!-- made by tests/thesis.rs -->\n", "<!-- end -->"];

fn guide() -> PathBuf {
    repository().join("docs/thesis.md")
}

/// Writes what was found into the rows' file, and the tables into the page.
fn write(found: &[(String, f64)]) {
    let text = std::fs::read_to_string(rows_file()).unwrap();
    let mut lines: Vec<String> = Vec::new();
    let mut id = String::new();
    for line in text.lines() {
        if let Some(name) = line.strip_prefix("id = ") {
            id = name.trim_matches('"').to_owned();
        }
        let new = found.iter().find(|(known, _)| *known == id);
        match (line.starts_with("ours = "), new) {
            (true, Some((_, value))) => lines.push(format!("ours = {value:?}")),
            _ => lines.push(line.to_owned()),
        }
    }
    std::fs::write(rows_file(), lines.join("\n") + "\n").unwrap();
    let text = std::fs::read_to_string(guide()).unwrap();
    let (before, rest) = text.split_once(MARKS[0]).unwrap();
    let (_, after) = rest.split_once(MARKS[1]).unwrap();
    let made = format!("{before}{}{}{}{after}", MARKS[0], tables(&page()), MARKS[1]);
    std::fs::write(guide(), made).unwrap();
}

/// Truth: the numbers of the thesis, closed forms by hand and other programs' figures, as `truth` in tests/thesis/rows.toml, each within its `near`; and what was recorded there before, within 1e-6 unless a row says
/// more: a number that has changed fails. Long rows run with `./test --campaign thesis` alone.
#[test]
fn campaign_thesis() {
    let page = page();
    let mut campaign = Campaign::start("thesis", page.rows.len() as u64);
    let whole = campaign.seeds().end == page.rows.len() as u64;
    let recording = std::env::var("SUNGLINT_THESIS").is_ok_and(|v| v == "write");
    let work = Work::new(&page, whole);
    let (mut changed, mut values) = (Vec::new(), Vec::new());
    for row in page.rows.iter().filter(|row| whole || !row.heavy) {
        let value = match found(row, &work) {
            Ok(value) => value,
            Err(why) => {
                changed.push(why);
                continue;
            }
        };
        values.push((row.id.clone(), value));
        if let Some((truth, near)) =
            row.truth.filter(|(truth, near)| (value - truth).abs() > near * truth.abs())
        {
            changed
                .push(format!("{}: {value}, and the truth {truth} is not within {near}", row.id));
        }
        let recorded = row.ours.unwrap_or(f64::NAN);
        let close = (value - recorded).abs() <= row.within * recorded.abs();
        if !recording && !close {
            changed.push(format!("{}: {value}, recorded was {recorded}", row.id));
        }
    }
    if recording {
        write(&values);
    }
    assert!(changed.is_empty(), "{}", changed.join("\n"));
    campaign.largest("rows_that_differ", changed.len() as f64);
    campaign.finish();
}

/// The page holds what the rows say, at least 40 of them; every name is there once, every command is one of the program or names a library's call.
#[test]
fn the_page_on_the_thesis_is_that_of_its_rows() {
    let page = page();
    let text = std::fs::read_to_string(guide()).unwrap();
    assert!(text.contains(&tables(&page)), "SUNGLINT_THESIS=write cargo test --test suite thesis");
    assert!(page.rows.len() >= 40, "{}", page.rows.len());
    let mut names: Vec<&str> = page.rows.iter().map(|row| row.id.as_str()).collect();
    names.sort_unstable();
    assert!(names.windows(2).all(|pair| pair[0] != pair[1]), "{names:?}");
    for (command, _) in &page.prepare {
        assert!(text.contains(command), "{command}");
    }
    for row in &page.rows {
        assert!(row.read.is_empty() || row.command.starts_with("sunglint "), "{}", row.id);
        assert!(
            ["agrees", "wrong", "not told", "its own data"].contains(&row.verdict.as_str()),
            "{}: {}",
            row.id,
            row.verdict
        );
        assert!(!row.why.contains('|') && !row.says.contains('|'), "{}", row.id);
        assert!(row.ours.is_some_and(f64::is_finite), "{}", row.id);
    }
}
