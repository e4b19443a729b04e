//! The documentation is true: its commands run, and the JSON keys that it lists are those that the program prints.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::{Folder, VEGA, demonstration, page_toml};
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;
use sunglint_calibration::efficiency::EfficiencyFlags;
use sunglint_materials::table::RetroFlags;
use sunglint_testkit::coverage::{Coverage, Night, coverage, holm};

fn read(page: &str) -> String {
    std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(page)).unwrap()
}

/// A row: its values by the names of their columns.
type Row<'a> = &'a dyn Fn(&str) -> f64;
/// Something that is asked of a row.
type OfRow<'a, T> = dyn Fn(Row<'_>) -> T + 'a;

/// Rows of a campaign, by column.
struct Rows {
    columns: Vec<String>,
    rows: Vec<Vec<f64>>,
}

impl Rows {
    fn new(campaign: &str) -> Self {
        let text = read(&format!("tests/campaigns/{campaign}.tsv"));
        let mut lines = text.lines().filter(|l| !l.starts_with('#')).map(|l| l.split('\t'));
        let columns = lines.next().unwrap().map(str::to_owned).collect();
        // A seed's commit is no number.
        let one = |l: std::str::Split<'_, char>| l.map(|v| v.parse().unwrap_or(f64::NAN)).collect();
        Self { columns, rows: lines.map(one).collect() }
    }

    fn at(&self, row: &[f64], column: &str) -> f64 {
        row[self.columns.iter().position(|c| c == column).unwrap()]
    }

    /// Nights of rows that count: `of` intervals each, what they missed, their mean pull.
    fn nights(&self, counts: &OfRow<'_, bool>, night: &OfRow<'_, Night>) -> Vec<Night> {
        let all = self.rows.iter().filter(|row| counts(&|c| self.at(row, c)));
        all.map(|row| night(&|c| self.at(row, c))).collect()
    }

    /// Median half-width over 1.96 times the root of the mean square error, of columns of rows that count.
    fn over_scatter(&self, counts: &OfRow<'_, bool>, half: &str, square: &OfRow<'_, f64>) -> f64 {
        let all: Vec<&Vec<f64>> =
            self.rows.iter().filter(|row| counts(&|c| self.at(row, c))).collect();
        let mut halves: Vec<f64> = all.iter().map(|row| self.at(row, half)).collect();
        halves.sort_by(f64::total_cmp);
        let squares: f64 = all.iter().map(|row| square(&|c| self.at(row, c))).sum();
        halves[halves.len() / 2] / (1.96 * (squares / all.len() as f64).sqrt())
    }

    fn column(&self, name: &str) -> Vec<f64> {
        self.rows.iter().map(|row| self.at(row, name)).collect()
    }

    /// Median of σ over the root of the mean square error of its channel.
    fn channels_over_scatter(&self, channels: impl IntoIterator<Item = u8>) -> f64 {
        let mut all = Vec::new();
        for c in channels {
            let errors = self.column(&format!("error_{c}"));
            let square = errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64;
            all.extend(self.column(&format!("sigma_{c}")).iter().map(|s| s / square.sqrt()));
        }
        median(all)
    }

    /// The κ that all nights found over the one that they were made with, in the mean; 1 of a counter, which keeps no light from its aperture.
    fn kappa_found(&self, c: u8) -> f64 {
        if c > 3 {
            return 1.0;
        }
        let [found, exact] = ["", "exact_"].map(|kind| self.column(&format!("{kind}error_{c}")));
        let ratios = found.iter().zip(&exact).map(|(a, b)| (100.0 + a) / (100.0 + b));
        ratios.sum::<f64>() / found.len() as f64
    }

    /// Median of σ over the root of the mean square error, with the κ of [`Rows::kappa_found`].
    fn exact_over_scatter(&self, channels: &[u8]) -> f64 {
        let mut all = Vec::new();
        for c in channels {
            let kappa = self.kappa_found(*c);
            let errors = self.column(&format!("exact_error_{c}"));
            let errors = errors.iter().map(|e| (100.0 + e) * kappa - 100.0);
            let square = errors.map(|e| e * e).sum::<f64>() / self.rows.len() as f64;
            let sigmas = self.column(&format!("exact_sigma_{c}"));
            all.extend(sigmas.iter().map(|s| s * kappa / square.sqrt()));
        }
        median(all)
    }

    /// Median of σ with the κ of the night's stars over that with the true one.
    fn over_exact(&self, c: u8) -> f64 {
        let [own, exact] = ["", "exact_"].map(|kind| self.column(&format!("{kind}sigma_{c}")));
        median(own.iter().zip(exact).map(|(a, b)| a / b).collect())
    }
}

fn median(mut all: Vec<f64>) -> f64 {
    all.sort_by(f64::total_cmp);
    all[all.len() / 2]
}

/// The lines of the page's table of rows: what was held, night by night.
fn counted_by_nights() -> Vec<String> {
    /// Name, campaign, nights, and the median width over the scatter.
    type Counted = (&'static str, &'static str, Vec<Night>, Option<f64>);
    let several = |below: &'static str, above: &'static str, pull: &'static str| {
        move |row: Row| Night { below: row(below), above: row(above), of: 6.0, pull: row(pull) }
    };
    let one = |missed: &'static str, pull: &'static str| {
        move |row: Row| Night {
            below: f64::from(u8::from(row(missed) < 0.0)),
            above: f64::from(u8::from(row(missed) > 0.0)),
            of: 1.0,
            pull: row(pull),
        }
    };
    let campaigns = ["wandering_sphere", "wandering_sphere_from_10000"];
    let blocks = campaigns.map(Rows::new);
    let (bodies, spins) = (Rows::new("tumbling_stages"), Rows::new("attitude"));
    let faint = Rows::new("faint_pass");
    let all = |_: Row| true;
    let alone = |row: Row| row("kind") == 0.0;
    let wrong = |row: Row| row("kind") > 0.0;
    let single = |row: Row| row("answer") == 0.0;
    let period = |row: Row| {
        let (missed, off) = (row("held") == 0.0, row("relative"));
        Night {
            below: f64::from(u8::from(missed && off > 0.0)),
            above: f64::from(u8::from(missed && off <= 0.0)),
            of: 1.0,
            pull: f64::NAN,
        }
    };
    let drift = |row: Row| Night {
        below: f64::from(u8::from(row("drift_held") == 0.0)),
        above: 0.0,
        of: 1.0,
        pull: f64::NAN,
    };
    let ellipse = |row: Row| Night {
        below: 0.0,
        above: f64::from(u8::from(row("axis_chi2") > 5.991)),
        of: 1.0,
        pull: f64::NAN,
    };
    let square = |row: Row| row("square");
    let k_square = |row: Row| row("k_square");
    let mut rows: Vec<Counted> = Vec::new();
    for (wandering, campaign) in blocks.iter().zip(campaigns) {
        let quantities = [
            "six albedos of a sphere, residuals independent",
            "the same, the model wrong by 3 % for 2 to 16 samples",
            "extinction, which six channels share, residuals independent",
            "the same, the model wrong by 3 % for 2 to 16 samples",
        ];
        let counts: [&OfRow<'_, bool>; 2] = [&alone, &wrong];
        for (k, what) in quantities.into_iter().enumerate() {
            let which = counts[k % 2];
            rows.push(if k < 2 {
                (
                    what,
                    campaign,
                    wandering.nights(which, &several("below", "above", "pull")),
                    Some(wandering.over_scatter(which, "half", &square)),
                )
            } else {
                (
                    what,
                    campaign,
                    wandering.nights(which, &one("k_missed", "k_pull")),
                    Some(wandering.over_scatter(which, "k_half", &k_square)),
                )
            });
        }
    }
    let of_stars = several("below", "above", "pull");
    // One channel's intervals are 1.96 σ to both sides.
    let kappa: [f64; 6] = [1, 2, 3, 4, 5, 6].map(|c| faint.kappa_found(c));
    let exact = |channels: &'static [u8]| {
        move |row: Row| {
            let off = |c: &u8| {
                let kappa = kappa[usize::from(*c) - 1];
                let number = |of: &str| row(&format!("exact_{of}_{c}"));
                ((100.0 + number("error")) * kappa - 100.0) / (number("sigma") * kappa)
            };
            let off: Vec<f64> = channels.iter().map(off).collect();
            Night {
                below: off.iter().filter(|off| **off > 1.96).count() as f64,
                above: off.iter().filter(|off| **off < -1.96).count() as f64,
                of: off.len() as f64,
                pull: off.iter().sum::<f64>() / off.len() as f64,
            }
        }
    };
    rows.extend([
        (
            "the period of a tumbling rocket body",
            "tumbling_stages",
            bodies.nights(&single, &period),
            None,
        ),
        ("… its drift", "tumbling_stages", bodies.nights(&single, &drift), None),
        ("the axis of a spin, ellipse", "attitude", spins.nights(&all, &ellipse), None),
        (
            "six albedos of a sphere, whole nights from photons and pixels",
            "faint_pass",
            faint.nights(&all, &of_stars),
            Some(faint.channels_over_scatter(1..=6)),
        ),
    ]);
    let with_exact: [(&str, &'static [u8]); 4] = [
        (
            "the same without the doubt of κ: the camera's three, with the κ that all nights found",
            &[1, 2, 3],
        ),
        ("… `id400`, with the κ that the nights were made with", &[4]),
        ("… `spcm`", &[5]),
        ("… `mppc`", &[6]),
    ];
    for (what, channels) in with_exact {
        let width = faint.exact_over_scatter(channels);
        rows.push((what, "faint_pass", faint.nights(&all, &exact(channels)), Some(width)));
    }
    // Columns of one quantity: intervals with the truth below and above, the mean pull, how many; a night without any does not count.
    let of = |name: String| {
        move |row: Row| {
            let number = |end: &str| row(&format!("{name}{end}"));
            let [below, above, of, pull] = ["below", "above", "of", "pull"].map(number);
            Night { below, above, of, pull }
        }
    };
    let few = Rows::new("few_stars");
    let kinds = [
        "κ of six channels by three stars",
        "… four",
        "… five",
        "… seven",
        "… eight",
        "… twelve",
        "… seven of which one is dimmed",
        "κ of a channel in which three of fourteen stars were measured",
        "… four",
        "… six",
        "κ of six channels by twenty-five stars of which five are dimmed",
    ];
    for (k, what) in (1..).zip(kinds) {
        let key = |end: &str| format!("{end}_{k}");
        let night = |row: Row| {
            let [below, above, of, pull] =
                ["below", "above", "of", "pull"].map(|end| row(&key(end)));
            Night { below, above, of, pull }
        };
        let is_there = |row: Row| row(&key("of")) > 0.0;
        rows.push((what, "few_stars", few.nights(&is_there, &night), None));
    }
    let fits = Rows::new("box_wing_fits");
    let names = [
        "roughness of a spinning box-wing's cells, fitted with all that follows",
        "… right ascension of its axis",
        "… declination",
        "… period",
        "… phase",
    ];
    for (k, what) in (1..).zip(names) {
        let pass = |row: Row| {
            let [below, above, pull] = ["below", "above", "pull"].map(|n| row(&format!("{n}_{k}")));
            Night { below, above, of: 1.0, pull }
        };
        let square = |row: Row| row(&format!("error_{k}")).powi(2);
        let width = fits.over_scatter(&all, &format!("half_{k}"), &square);
        rows.push((what, "box_wing_fits", fits.nights(&all, &pass), Some(width)));
    }
    let albedos = fits.nights(&all, &of("albedo_".to_owned()));
    rows.push(("… twenty-four albedos", "box_wing_fits", albedos, None));
    let tables = Rows::new("made_up_surfaces");
    let table = |row: Row| Night {
        below: row("numbers") - row("inside") - row("nan"),
        above: 0.0,
        of: row("numbers"),
        pull: f64::NAN,
    };
    let has_numbers = |row: Row| row("numbers") > 0.0;
    rows.push((
        "numbers of laws fitted to a goniometer's tables",
        "made_up_surfaces",
        tables.nights(&has_numbers, &table),
        None,
    ));
    let frames = Rows::new("star_frames");
    let frame = |row: Row| Night {
        below: row("beyond_two_sigmas"),
        above: 0.0,
        of: row("frames") - row("without"),
        pull: f64::NAN,
    };
    rows.push((
        "magnitudes from frames of others, 2 σ",
        "star_frames",
        frames.nights(&all, &frame),
        None,
    ));
    let fibres = Rows::new("fibres");
    for (what, name) in [
        ("middles of three fibres' fields, whole nights from photons and pixels", "middle_"),
        ("… their widths", "width_"),
    ] {
        rows.push((what, "fibres", fibres.nights(&all, &of(name.to_owned())), None));
    }
    let retro = Rows::new("retro_intervals");
    for (what, name) in [
        ("F₀ of a retro-reflection run, the bound of its continuations included", "f0"),
        ("α of the same, by the law that the sample has", "alpha"),
    ] {
        let run = |row: Row| {
            let number = |end: &str| row(&format!("{name}_{end}"));
            let [below, above, pull] = ["below", "above", "pull"].map(number);
            Night { below, above, of: 1.0, pull }
        };
        let square = |row: Row| row(&format!("{name}_error")).powi(2);
        let width = retro.over_scatter(&all, &format!("{name}_half"), &square);
        rows.push((what, "retro_intervals", retro.nights(&all, &run), Some(width)));
    }
    let focus = Rows::new("focus");
    let focused = |row: Row| row("refused") == 0.0;
    let run = |row: Row| Night {
        below: row("below"),
        above: row("above"),
        of: 1.0,
        pull: row("off") / row("sigma"),
    };
    let width = focus.over_scatter(&focused, "half_width", &|row: Row| row("off").powi(2));
    rows.push(("best focus", "focus", focus.nights(&focused, &run), Some(width)));
    // One interval a seed.
    let alone =
        |row: Row| Night { below: row("below"), above: row("above"), of: 1.0, pull: row("pull") };
    let square = |row: Row| row("error").powi(2);
    let seeds: [(&str, &str, &OfRow<'_, bool>); 5] = [
        (
            "scale of a comparison, counting noise and twinkling that neighbours share",
            "scale_intervals",
            &all,
        ),
        ("periods by several sessions, where there is one answer", "session_periods", &|row| {
            row("single") > 0.0
        }),
        ("efficiency of a detector at a wavelength", "efficiency_run", &all),
        ("the same where the rig drifts", "efficiency_drift", &all),
        ("dead time by `linearity`", "linearity", &all),
    ];
    for (what, campaign, counts) in seeds {
        let seeds = Rows::new(campaign);
        let width = seeds.over_scatter(counts, "half", &square);
        rows.push((what, campaign, seeds.nights(counts, &alone), Some(width)));
    }
    let counted: Vec<Coverage> = rows.iter().map(|(.., nights, _)| coverage(nights)).collect();
    let p = holm(&counted.iter().map(|c| c.p).collect::<Vec<_>>());
    let percent = |v: f64| format!("{:.1} %", 100.0 * v);
    let line = |((what, campaign, _, width), (c, p)): (&Counted, (&Coverage, f64))| {
        let verdict = match (p < 0.05, c.held < 0.95) {
            (false, _) => "holds",
            (true, true) => "**too narrow**",
            (true, false) => "**too wide**",
        };
        let bias = match c.bias[0].is_finite() {
            true => format!("{:+.2} ± {:.2}", c.bias[0], c.bias[1]),
            false => "–".to_owned(),
        };
        format!(
            "| {what} | `{campaign}` | {} | {} ({} to {}) | {}, {} | {bias} | {} | {p:.2} | {verdict} |",
            c.nights,
            percent(c.held),
            percent(c.interval[0]),
            percent(c.interval[1]),
            c.missed[0],
            c.missed[1],
            width.map_or("–".to_owned(), |w| format!("{w:.2}")),
        )
    };
    let mut lines: Vec<String> = rows.iter().zip(counted.iter().zip(p)).map(line).collect();
    let channels = [("r", 1), ("g", 2), ("b", 3), ("id400", 4), ("spcm", 5), ("mppc", 6)];
    for (name, c) in channels {
        let wider = faint.over_exact(c);
        let errors = ["", "exact_"].map(|kind| {
            let all = faint.column(&format!("{kind}error_{c}"));
            let (n, sum) = (all.len() as f64, all.iter().sum::<f64>());
            let square = all.iter().map(|e| (e - sum / n).powi(2)).sum::<f64>() / (n - 1.0);
            let stated = median(faint.column(&format!("{kind}sigma_{c}")));
            format!("{:+.2} | {:.2} | {stated:.2}", sum / n, square.sqrt())
        });
        lines.push(format!("| `{name}` | {} | {} | {wider:.1} |", errors[0], errors[1]));
    }
    let (after, errors) = (faint.column("off_after"), faint.column("exact_error_4"));
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let slope = dot(&after, &errors) / dot(&after, &after);
    let sigma = (dot(&errors, &errors) / (errors.len() as f64 * dot(&after, &after))).sqrt();
    lines.push(format!("{slope:.3} ± {sigma:.3} % for each Hz"));
    lines
}

/// Truth: rows that the campaigns wrote (`tests/campaigns/*.tsv`), counted by `sunglint_testkit::coverage`, whose own truths are closed forms and scipy's. Where it fails the lines that belong on the page are printed.
#[test]
fn the_page_of_uncertainties_counts_nights() {
    let page = read("docs/uncertainty.md");
    let lines = counted_by_nights();
    let missing: Vec<&String> = lines.iter().filter(|l| !page.contains(l.as_str())).collect();
    assert!(
        missing.is_empty(),
        "docs/uncertainty.md lacks lines; all of them:\n{}",
        lines.join("\n")
    );
}

/// Every command of the README that begins with `sunglint` runs, in the order of the page, in a folder of its own.
#[test]
fn the_commands_of_the_readme_run() {
    let folder = Folder::new("readme");
    let readme = read("README.md");
    let commands: Vec<&str> = readme.lines().filter(|l| l.starts_with("sunglint ")).collect();
    assert!(commands.len() >= 8, "{commands:?}");
    let program = Path::new(env!("CARGO_BIN_EXE_sunglint")).parent().unwrap();
    let path = std::env::var("PATH").unwrap();
    for command in commands {
        // The first of them, in another folder.
        if command.split('#').next().unwrap().trim() == "sunglint demo" {
            let printed = demonstration(&folder);
            std::fs::rename(folder.path("sunglint-demo-2"), folder.path("sunglint-demo")).unwrap();
            let mut found = BTreeSet::new();
            keys(printed, &mut found);
            let page = read("docs/json.md");
            assert!(found.len() >= 5 && found.iter().all(|k| page.contains(&format!("`{k}`"))));
            continue;
        }
        // The completions go to the user's own folder.
        let command = command.replace("~/", "home/");
        let output = Command::new("sh")
            .args([
                "-e",
                "-c",
                &format!("mkdir -p home/.local/share/bash-completion/completions\n{command}"),
            ])
            .current_dir(&folder.0)
            .env("PATH", format!("{}:{path}", program.display()))
            .env_remove("SUNGLINT_STATION")
            .output()
            .unwrap();
        assert!(output.status.success(), "{command}: {}", String::from_utf8_lossy(&output.stderr));
    }
    assert!(folder.path("night.png").exists() && folder.path("man/sunglint-air.1").exists());
    // Those of the page of comparisons, on what the demonstration left.
    let page = read("docs/compare.md");
    let commands: Vec<&str> = page.lines().filter_map(|l| l.strip_prefix("sunglint ")).collect();
    assert!(commands.len() >= 4, "{commands:?}");
    for command in commands.into_iter().filter(|c| !c.starts_with("demo")) {
        let words: Vec<&str> = command.split(' ').collect();
        folder.done(&[&words[..], &["--force"]].concat());
    }
    assert!(folder.path("sphere.html").exists() && folder.path("counters").is_dir());
}

/// A pass of the elements that many texts print over the built-in station.
const SCENE: &str = r#"
target.built_in = "lambert_sphere"
orbit.lines = [
  "1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927",
  "2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537",
]
station.name = "ufo"
times.from = 2008-09-21T18:48:00Z
"#;

fn keys(value: &Value, found: &mut BTreeSet<String>) {
    match value {
        Value::Object(map) => {
            for (key, value) in map {
                found.insert(key.clone());
                keys(value, found);
            }
        }
        Value::Array(list) => list.iter().for_each(|value| keys(value, found)),
        _ => {}
    }
}

/// The curve of two lobes, as calibrated ones are: maps take no other.
fn predicted_turning_curve() -> String {
    crate::common::turning_curve().replace("quantity: linear", "quantity: predicted")
}

/// Keys of an archive with a file that is damaged; they are known without the feature, too.
fn archive_keys(folder: &Folder, printed: &mut BTreeSet<String>) {
    if !cfg!(feature = "study") {
        let keys =
            ["archive", "damaged", "gone", "index", "norad_id_from", "with_light", "without_phase"];
        printed.extend(keys.map(str::to_owned));
        return;
    }
    std::fs::create_dir(folder.path("nights")).unwrap();
    std::fs::write(folder.path("nights/torn.ecsv"), "# %ECSV 1.0\n").unwrap();
    std::fs::copy(folder.path("foreign.csv"), folder.path("nights/foreign.csv")).unwrap();
    keys(&folder.json(&["archive", "nights", "--json"]), printed);
}

#[test]
fn every_json_key_is_documented_and_every_documented_one_is_printed() {
    let folder = Folder::new("keys");
    let mut printed = BTreeSet::new();
    for command in [
        &["tables"][..],
        &[
            "air",
            "--station",
            "ufo",
            "-z",
            "60",
            "--components",
            "--aerosol",
            "0.1,1.3",
            "--from-nm",
            "500",
            "--to-nm",
            "600",
            "--step-nm",
            "50",
        ],
        &["star", "Vega", "--station", "ufo", "--at", "2020-11-18T18:00:00"],
    ] {
        keys(&folder.json(&[command, &["--json"]].concat()), &mut printed);
    }
    let foreign = "jd_utc,flux,filter,seeing\n2459275.5,100,V,2.1\n2459275.6,110,V,2.0\n";
    std::fs::write(folder.path("foreign.csv"), foreign).unwrap();
    keys(&folder.json(&["import", "foreign.csv", "--json"]), &mut printed);
    crate::sky::write_elements(&folder);
    keys(&folder.json(&["elements", "iss.json", "--at", "2020-07-13", "--json"]), &mut printed);
    archive_keys(&folder, &mut printed);
    crate::sky::draw(&folder, "sky.fits");
    keys(&folder.json(&["solve", "sky.fits", "--width-deg", "25", "--json"]), &mut printed);
    std::fs::write(folder.path("pass.toml"), SCENE).unwrap();
    // A pass of the same elements, followed by a virtual telescope.
    let lines = SCENE.lines().filter_map(|line| line.trim().strip_prefix('"')?.strip_suffix("\","));
    std::fs::write(folder.path("iss.tle"), lines.collect::<Vec<_>>().join("\n")).unwrap();
    let track = ["track", "iss.tle", "25544", "--mount", "virtual", "--station", "ufo"];
    let at = ["--at", "2008-09-21T18:30:00", "--json"];
    keys(&folder.json(&[&track[..], &at].concat()), &mut printed);
    let focus = ["focus", "run", "--focuser", "virtual", "--camera", "virtual", "--step", "500"];
    keys(&folder.json(&[&focus[..], &["--json"]].concat()), &mut printed);
    for (name, celsius) in [("a", 0), ("b", 1), ("c", 2)] {
        let run = format!(r#"{{"curve":{{"best":9,"sigma":1}},"temperature_c":{celsius}}}"#);
        std::fs::write(folder.path(&format!("{name}_run.json")), run).unwrap();
    }
    keys(
        &folder.json(&["focus", "drift", "a_run.json", "b_run.json", "c_run.json", "--json"]),
        &mut printed,
    );
    keys(&folder.json(&["simulate", "pass.toml", "--polarisation", "--json"]), &mut printed);
    // A comparison, with one sample left out for each of some reasons.
    let stretch =
        "times.from = 2008-09-21T18:45:00Z\ntimes.to = 2008-09-21T18:51:00Z\ntimes.step_s = 10\n";
    let scene = SCENE.replace("times.from = 2008-09-21T18:48:00Z\n", stretch);
    std::fs::write(folder.path("stretch.toml"), scene).unwrap();
    let mut rows = String::from("time_utc,magnitude,sigma\n2008-09-21T18:40:00Z,4.5,0.1\n");
    rows += "2008-09-21T18:45:00Z,4.5,0.1\n2008-09-21T18:47:50Z,,0.1\n";
    for second in 10..59 {
        rows += &format!("2008-09-21T18:48:{second}Z,4.{second},0.1\n");
    }
    std::fs::write(folder.path("many.csv"), rows).unwrap();
    let compare = ["compare", "many.csv", "stretch.toml", "--sigma-column", "sigma", "--json"];
    keys(&folder.json(&compare), &mut printed);
    keys(&folder.json(&["explain", "pass.toml", "--json"]), &mut printed);
    for picture in [
        &["pass.toml", "--size-px", "32"][..],
        &["--model", "lambert_sphere", "--map", "--step-deg", "30"],
        &["--sphere"],
    ] {
        keys(&folder.json(&[&["picture", "--json"], picture].concat()), &mut printed);
    }
    let active = read("docs/active.md");
    let mut tables = active.split("```").filter_map(|block| block.strip_prefix("toml\n"));
    let laser = tables.next().unwrap();
    let ranging = tables.find(|block| block.contains("[laser.ranging]")).unwrap();
    std::fs::write(folder.path("active.toml"), format!("{SCENE}{laser}{ranging}")).unwrap();
    let stretch = ["--to", "2008-09-21T18:48:10Z", "--step-s", "5", "-o", "active.crd"];
    let simulate = ["simulate", "active.toml", "--active", "--json"];
    keys(&folder.json(&[&simulate[..], &stretch].concat()), &mut printed);
    folder.done(&[&VEGA[..], &["--spectrum-out", "s.json"]].concat());
    folder.done(&["bench", "--scene", "corner", "--seconds", "0.02", "-o", "b.json", "-q"]);
    for file in ["s.json", "b.json"] {
        let text = std::fs::read_to_string(folder.path(file)).unwrap();
        keys(&serde_json::from_str(&text).unwrap(), &mut printed);
    }
    // A set with a wrong checksum among others, and all three kinds of brightness.
    let elements = read("fixtures/passes/satellites.tle");
    let wrong = elements.replacen("15.50000000    13", "15.50000000    14", 1);
    std::fs::write(folder.path("some.tle"), wrong).unwrap();
    let passes = ["passes", "--tle", "some.tle", "--station", "ufo", "--json", "--name", "leo"];
    let window = ["--from", "2024-08-12T18:00", "--to", "2024-08-13T04:00"];
    for law in [&[][..], &["--standard-magnitude", "4"], &["--model", "box_wing"]] {
        keys(&folder.json(&[&passes[..], &window, law].concat()), &mut printed);
    }
    let devices = read("rehearsal/demo/devices.toml");
    std::fs::write(folder.path("instruments.toml"), devices).unwrap();
    let plan =
        ["passes", "--tle", "some.tle", "--json", "--name", "leo", "--devices", "instruments.toml"];
    keys(&folder.json(&[&plan[..], &window, &["-o", "planned.toml"]].concat()), &mut printed);
    // Instruments: the simulated ones; a server that is not there.
    folder.done(&["devices", "record", "sim-wheel", "-o", "w.rec", "-q", "--", "check"]);
    for command in [
        &["list", "--drivers"][..],
        &["check", "sim-tmcl"],
        &["read", "sim-pm100"],
        &["read", "sim-camera"],
        &["read", "sim-tmcl"],
        &["read", "sim-wheel"],
        &["set", "sim-pm100", "range=AUTO"],
        &["move", "sim-wheel", "2"],
        &["replay", "w.rec"],
        &["udev"],
        &["template"],
        &["template", "keithley6485"],
    ] {
        keys(&folder.json(&[&["devices"], command, &["--json"]].concat()), &mut printed);
    }
    let listed = folder.run(&["devices", "list", "--indi", "127.0.0.1:1", "--json"]);
    keys(&serde_json::from_slice(&listed.stdout).unwrap(), &mut printed);
    // Frames of another program.
    crate::frames::made_up(&folder.path("others"));
    keys(&folder.json(&["detect", "others/light_0.fits", "--json"]), &mut printed);
    let mut reduce = vec!["reduce", "others", "--along", "3", "--json"];
    reduce.extend(["--catalogue", "others/stars.csv", "--near", "150", "0"]);
    reduce.extend(["--scale-arcsec", "3.6"]);
    let elements = sunglint_testkit::repository().join("fixtures/passes/satellites.tle");
    let elements = elements.display().to_string();
    let text = read("fixtures/passes/satellites.tle");
    let number = text.lines().find_map(|l| l.strip_prefix("1 ")).unwrap()[..5].to_owned();
    reduce.extend(["--station", "ufo", "--elements", &elements, "--object", &number]);
    keys(&folder.json(&reduce), &mut printed);
    // A sample on a goniometer: a lobe that falls by 2 % a degree squared.
    let mut retro = String::from("angle_deg,f_per_sr,sigma_f_per_sr\n");
    for k in -10_i32..60 {
        let f = (-0.002 * f64::from(k * k)).exp();
        retro += &format!("{k},{f},{}\n", 0.01 * f);
    }
    std::fs::write(folder.path("retro.csv"), retro).unwrap();
    let ndf = ["brdf", "ndf", "retro.csv", "--resamplings", "3", "--json", "-o", "ndf.ecsv"];
    keys(&folder.json(&ndf), &mut printed);
    keys(
        &folder.json(&["brdf", "plan", "ndf.ecsv", "--rig", "--side", "9", "--json"]),
        &mut printed,
    );
    // A run on the virtual rig and a detector's efficiency, by the files of their page.
    let block = |key: &str| page_toml("lab.md", key);
    let coarse = block("[scan]").replace("step_deg = 0.5", "step_deg = 3");
    for (file, text) in [
        ("run.toml", coarse.as_str()),
        ("rig.toml", &block("[mount]")),
        ("efficiency.toml", &block("[sensor]")),
        ("responsivity.csv", "wavelength_nm,responsivity_a_per_w\n400,0.4\n1100,0.4\n"),
        ("splitter_t.csv", "wavelength_nm,transmission\n400,0.7\n1100,0.7\n"),
        ("splitter_r.csv", "wavelength_nm,reflectance\n400,0.3\n1100,0.3\n"),
        (
            "visible.csv",
            "wavelength_nm,photodiode_v,counts,exposure_s\n500,0.01,100000,10\n600,0.01,90000,10\n",
        ),
    ] {
        std::fs::write(folder.path(file), text).unwrap();
    }
    keys(&folder.json(&["brdf", "retro", "run.toml", "--json", "-o", "run/"]), &mut printed);
    let few = ["brdf", "plan", "ndf.ecsv", "--measurements", "24", "--side", "9", "--json"];
    keys(&folder.json(&few), &mut printed);
    folder.done(&["brdf", "plan", "ndf.ecsv", "--side", "9", "-q", "-o", "everywhere.ecsv"]);
    std::fs::write(folder.path("bench.toml"), "virtual = \"goniometer.toml\"\n[axis.azimuth]\n")
        .unwrap();
    std::fs::write(folder.path("goniometer.toml"), "[sample]\nalpha = 0.02\n").unwrap();
    let run = ["brdf", "run", "everywhere.ecsv", "--bench", "bench.toml", "-o", "bench/", "--json"];
    keys(&folder.json(&run), &mut printed);
    let ingest = ["brdf", "ingest", "bench/", "--json", "-o", "benched.ecsv"];
    keys(&folder.json(&ingest), &mut printed);
    // The same with a spectrometer.
    let spectral = "virtual = \"goniometer.toml\"\n[axis.azimuth]\n[spectrometer]\nchannels_nm = [[550, 20], [650, 20]]\n";
    std::fs::write(folder.path("spectral.toml"), spectral).unwrap();
    folder.done(&[&few[..5], &["--side", "9", "-q", "-o", "few.ecsv"]].concat());
    let run = ["brdf", "run", "few.ecsv", "--bench", "spectral.toml", "-o", "spectral/", "--json"];
    keys(&folder.json(&run), &mut printed);
    keys(&folder.json(&["brdf", "ingest", "spectral/", "--json"]), &mut printed);
    let small = ["--side", "8", "--theta-i", "4", "--normals", "32", "--json"];
    let assemble = ["brdf", "assemble", "benched.ecsv", "ndf.ecsv", "-o", "benched.bsdf"];
    keys(&folder.json(&[&assemble[..], &small].concat()), &mut printed);
    keys(&folder.json(&["efficiency", "efficiency.toml", "--json"]), &mut printed);
    let block = |key: &str| page_toml("lab-efficiency.md", key);
    for (file, text) in [
        ("scan.toml", block("[scan]\nfrom_nm").replace("step_nm = 20", "step_nm = 100")),
        ("steps.toml", block("[[wheel.step]]")),
        ("source.toml", block("sources = {")),
    ] {
        std::fs::write(folder.path(file), text.replace("\"rig.toml\"", "\"counter.toml\""))
            .unwrap();
    }
    std::fs::write(folder.path("counter.toml"), "").unwrap();
    let scan = ["efficiency", "run", "scan.toml", "--json", "-o", "scanned/"];
    keys(&folder.json(&scan), &mut printed);
    let steps = ["efficiency", "linearity", "steps.toml", "--json", "-o", "dead/"];
    keys(&folder.json(&steps), &mut printed);
    // Values of a lobe, a law and a material of them; spectra of a detector that joins another.
    let mut values =
        String::from("theta_i_deg,phi_i_deg,theta_o_deg,phi_o_deg,brdf_550nm_per_sr\n");
    for k in 0..60_i32 {
        let f = (-0.002 * f64::from((k - 20) * (k - 20))).exp() + 0.1;
        values += &format!("20,0,{k},180,{f}\n");
    }
    std::fs::write(folder.path("values.csv"), values).unwrap();
    keys(&folder.json(&["brdf", "fit", "values.csv", "--law", "ggx", "--json"]), &mut printed);
    let assemble = ["brdf", "assemble", "values.csv", "ndf.ecsv", "-o", "made.bsdf", "--side", "8"];
    folder.done(&["brdf", "plan", "ndf.ecsv", "--rig", "--side", "9", "-o", "plan.ecsv", "-q"]);
    let small = ["--theta-i", "4", "--normals", "32", "--plan", "plan.ecsv", "--json"];
    keys(&folder.json(&[&assemble[..], &small].concat()), &mut printed);
    keys(
        &folder.json(&["brdf", "show", "made.bsdf", "--wavelength-nm", "550", "--json"]),
        &mut printed,
    );
    let compare = ["brdf", "compare", "made.bsdf", "made.toml", "--wavelength-nm", "550", "--json"];
    keys(&folder.json(&compare), &mut printed);
    let spectrum: String = (400..500).map(|nm| format!("{nm},{}\n", nm - 300)).collect();
    std::fs::write(folder.path("spectrum.csv"), format!("wavelength_nm,y\n{spectrum}")).unwrap();
    let mut ingest = String::from(
        "solid_angle_sr = 1e-3\nwavelength_nm = { from = 410, to = 490, step = 10 }\n[reference]\nkind = \"mirror\"\nreflectance = 1\n",
    );
    for name in ["a", "b"] {
        ingest += &format!(
            "[[detector]]\nname = \"{name}\"\nrange_nm = [400, 500]\nreference = \"spectrum.csv\"\n"
        );
    }
    for (i, o) in [(10, 30), (30, 10), (10, 30)] {
        ingest += &format!(
            "[[direction]]\ntheta_i_deg = {i}\nphi_i_deg = 0\ntheta_o_deg = {o}\nphi_o_deg = 180\nfiles = {{ a = \"spectrum.csv\", b = \"spectrum.csv\" }}\n"
        );
    }
    std::fs::write(folder.path("ingest.toml"), ingest).unwrap();
    keys(&folder.json(&["brdf", "ingest", "ingest.toml", "--json"]), &mut printed);
    // A composite through a table with three incidences: a lobe over Lambert light, in the plane of incidence.
    let mut table = String::from("theta_i_deg,phi_i_deg,theta_o_deg,phi_o_deg,brdf_550nm_per_sr\n");
    for theta_i in [10, 30, 50, 65] {
        for signed in (-75..=75).step_by(3) {
            let (theta_o, phi_o) = (i32::abs(signed), if signed < 0 { 0 } else { 180 });
            let half = 0.5 * f64::from(signed - theta_i);
            let value = 0.1 + 3.0 * (-(half / 8.0).powi(2)).exp();
            table += &format!("{theta_i},0,{theta_o},{phi_o},{value}\n");
        }
    }
    std::fs::write(folder.path("incidences.csv"), table).unwrap();
    let fit = ["brdf", "fit", "incidences.csv", "--most-lobes", "1", "--accept", "--json", "-q"];
    keys(&folder.json(&fit), &mut printed);
    keys(&folder.json(&["brdf", "ingest", "incidences.csv", "--json"]), &mut printed);
    let geometry = ["light", "box_wing", "--sun", "1,0,0.2", "--observer", "0.75,-0.5,0.45"];
    keys(&folder.json(&[&geometry[..], &["--json"]].concat()), &mut printed);
    let linear = ["--derivatives", "albedo", "--without", "inter_reflection", "--json", "-q"];
    keys(&folder.json(&[&geometry[..], &linear].concat()), &mut printed);
    // Sessions with a zero point each.
    let mut nights = String::from("# synthetic\ntime_utc,magnitude,session,delta_au\n");
    for (k, day) in [2, 3, 7, 9].into_iter().enumerate() {
        for i in 0..90_u32 {
            let minute = 4 * i + 17 * k as u32;
            let turn = std::f64::consts::TAU
                * (86_400.0 * f64::from(day) + 60.0 * f64::from(minute))
                / (5.3 * 3600.0);
            let m = 11.0 + 1.7 * k as f64 + 0.2 * (2.0 * turn).sin() + 0.1 * (3.0 * turn).cos();
            let ripple = 0.03 * ((f64::from(i * i) * 0.618_033_988_75).fract() - 0.5);
            let (hour, minute) = (minute / 60, minute % 60);
            nights +=
                &format!("2024-03-{day:02}T{hour:02}:{minute:02}:00Z,{:.4},{k},2.5\n", m + ripple);
        }
    }
    std::fs::write(folder.path("nights.csv"), nights).unwrap();
    keys(&folder.json(&["analyse", "period", "nights.csv", "--json", "-q"]), &mut printed);
    let names = crate::common::tumbling_stage(&folder, 3);
    let mut spin = vec![
        "analyse",
        "spin",
        "--pass",
        "stage.toml",
        "--station",
        "ufo",
        "--channel",
        "g",
        "--json",
        "-q",
    ];
    spin.extend(names.iter().map(String::as_str));
    keys(&folder.json(&spin), &mut printed);
    // Stars, and what they calibrate.
    crate::common::star_night::night(&folder, "2020-11-18", 1.0);
    crate::common::star_night::night(&folder, "2020-11-19", 1.0);
    let calibrate = ["calibrate", "2020-11-18", "2020-11-19", "--station", "ufo"];
    keys(&folder.json(&[&calibrate[..], &["--json", "-o", "k.ecsv"]].concat()), &mut printed);
    let apply = ["apply", "k.ecsv", "2020-11-18/00_vega.ecsv", "--station", "ufo", "--json"];
    keys(&folder.json(&[&apply[..], &["--magnitudes", "V"]].concat()), &mut printed);
    // A simulated curve taken apart, and put on the body's frame.
    let scene = format!(
        "{SCENE}attitude.law = \"spin\"\nattitude.axis_body = [0, 0, 1]\nattitude.axis_gcrs = [0, 0, 1]\nattitude.period_s = 20\nattitude.epoch_utc = 2008-09-21T18:45:00Z\n"
    );
    std::fs::write(folder.path("turning.toml"), scene).unwrap();
    folder.done(&["simulate", "turning.toml", "-o", "turning.ecsv", "-q"]);
    let unmix = ["analyse", "unmix", "turning.ecsv", "--endmembers", "white,mli", "--json"];
    keys(&folder.json(&[&unmix[..], &["--pass", "turning.toml"]].concat()), &mut printed);
    let confusion = ["--endmembers", "unit", "--pass", "turning.toml", "--confusion", "--json"];
    keys(&folder.json(&[&unmix[..3], &confusion[..]].concat()), &mut printed);
    let search = ["analyse", "endmembers", "turning.ecsv", "--against", "white,mli", "--json"];
    keys(&folder.json(&[&search[..], &["--pass", "turning.toml"]].concat()), &mut printed);
    let map = ["analyse", "map", "turning.toml", "--along", "--step-deg", "30", "--json"];
    keys(&folder.json(&map), &mut printed);
    std::fs::write(folder.path("curve.ecsv"), predicted_turning_curve()).unwrap();
    let quality = ["analyse", "map", "turning.toml", "--curve", "curve.ecsv", "--quality"];
    let spin = ["--period", "20", "--axes-deg", "60", "--json"];
    keys(&folder.json(&[&quality[..], &spin].concat()), &mut printed);
    // How a body spins, by a curve that was simulated.
    let scene = crate::common::page_toml("reading-attitude.md", "axis_body");
    std::fs::write(folder.path("spinning.toml"), scene.replace("step_s = 4", "step_s = 30"))
        .unwrap();
    folder.done(&["simulate", "spinning.toml", "-o", "spinning.ecsv", "-q"]);
    let attitude = ["analyse", "attitude", "spinning.ecsv", "spinning.toml", "--axes", "60"];
    let bounds = ["--period", "60..80", "--sense", "right", "--scale", "grey", "--json"];
    keys(&folder.json(&[&attitude[..], &bounds].concat()), &mut printed);
    // A light curve of two lobes a turn of 20 s, read.
    std::fs::write(folder.path("curve.ecsv"), crate::common::turning_curve()).unwrap();
    let removed = ["curve.ecsv", "--station", "ufo", "--json"];
    std::fs::write(folder.path("sphere_pass.toml"), crate::common::SPHERE_PASS).unwrap();
    let period = ["analyse", "period", "--pass", "sphere_pass.toml"];
    keys(&folder.json(&[&period[..], &removed].concat()), &mut printed);
    let fold = ["analyse", "fold", "--period", "20", "--period-sigma", "0.01"];
    let axis = ["--pass", "sphere_pass.toml", "--axis", "30,60"];
    keys(&folder.json(&[&fold[..], &axis, &removed].concat()), &mut printed);
    // Flashes of one row every 4.13 s, over light without a period.
    let curve = crate::common::turning_curve();
    let mut flashing: String =
        curve.lines().take_while(|l| !l.starts_with("2008")).flat_map(|l| [l, "\n"]).collect();
    for i in 0..2400_u32 {
        let t = 0.05 + 0.1 * f64::from(i);
        let ripple = (f64::from(i * i) * 0.618_033_988_75).fract() - 0.5;
        let flash = if (t / 4.13).fract() < 0.1 / 4.13 { 4e3 } else { 0.0 };
        let (minute, second) = (46 + (t / 60.0) as u32, t % 60.0);
        let rate = 1e4 + 500.0 * ripple + flash;
        flashing += &format!("2008-09-21T18:{minute:02}:{second:06.3} 0.1 {rate:.3} 150 0 40\n");
    }
    std::fs::write(folder.path("flashes.ecsv"), flashing).unwrap();
    let flashes = ["analyse", "period", "flashes.ecsv", "--station", "ufo", "--json", "-q"];
    let found = folder.json(&flashes);
    assert!((found["flashes"]["best"]["period_s"].as_f64().unwrap() / 4.13 - 1.0).abs() < 1e-3);
    keys(&found, &mut printed);
    // A short night with simulated devices, and what is left of it when a line is cut.
    let night = "station = \"ufo\"\nfor_s = 3\n[[camera]]\nname = \"cam\"\ndevice = \"sim-camera\"\nexposure_s = 0.1\n\
                 [[counter]]\nname = \"tagger\"\ndevice = \"sim-timetagger\"\nchannels = { g = 1 }\nbin_s = 0.1\n";
    std::fs::write(folder.path("night.toml"), night).unwrap();
    let lines = folder.done(&["observe", "night.toml", "-o", "s", "--json", "--every", "0.2"]);
    for line in lines.lines() {
        keys(&serde_json::from_str(line).unwrap(), &mut printed);
    }
    let counts = folder.path("s/counts/tagger.ecsv");
    let whole = std::fs::read_to_string(&counts).unwrap();
    std::fs::write(counts, whole + "2020-").unwrap();
    let checked = folder.run(&["session", "check", "s", "--json"]);
    keys(&serde_json::from_slice(&checked.stdout).unwrap(), &mut printed);
    // A virtual night whose telescope stands on a mount.
    let night = "station = \"ufo\"\nfrom = \"2020-11-18T18:00:00Z\"\nvirtual = \"mounted-virtual.toml\"\n[[camera]]\nname = \"cam\"\ndevice = \"virtual\"\n\
                 exposure_s = 0.5\n[mount]\ndevice = \"virtual\"\n[[visit]]\nstar = \"Vega\"\nfor_s = 15\n";
    std::fs::write(folder.path("mounted.toml"), night).unwrap();
    std::fs::write(folder.path("mounted-virtual.toml"), "").unwrap();
    let lines = folder.done(&["observe", "mounted.toml", "-o", "m", "--json", "--every", "0.05"]);
    for line in lines.lines() {
        keys(&serde_json::from_str(line).unwrap(), &mut printed);
    }
    // A virtual night of a star, reduced and aligned.
    let night = "station = \"ufo\"\nfrom = \"2020-11-18T18:00:00Z\"\nvirtual = \"virtual.toml\"\n[[camera]]\nname = \"cam\"\ndevice = \"virtual\"\n\
                 exposure_s = 0.2\nwindow_px = [595, 419, 200, 200]\n[[counter]]\nname = \"tagger\"\ndevice = \"virtual\"\n\
                 channels = { spcm = 1 }\nbin_s = 0.1\n";
    let options = "[plan]\nstars = 1\nvisit_s = 20\nsky_s = 2\nslew_s = 1\ndark_s = 2\nv_mag = [2.5, 4]\n[pointing]\njitter_px = 6\njitter_time_s = 3\n";
    std::fs::write(folder.path("made_up.toml"), night).unwrap();
    std::fs::write(folder.path("virtual.toml"), options).unwrap();
    folder.done(&["observe", "made_up.toml", "-o", "v", "-q"]);
    keys(&folder.json(&["reduce", "v", "--json"]), &mut printed);
    keys(&folder.json(&["align", "v", "--json"]), &mut printed);
    // A lamp that flashes into both.
    let night = night
        .replace("exposure_s = 0.2", "exposure_s = 0.1")
        .replace("bin_s = 0.1", "bin_s = 0.01");
    let night =
        night.replace("virtual.toml", "lamp.toml") + "[[visit]]\noff = \"sky\"\nfor_s = 20\n";
    std::fs::write(folder.path("flashing.toml"), night).unwrap();
    let options =
        "[camera]\nlatency_s = 0.1\nrow_time_s = 3e-4\n[lamp]\ne_per_px_s = 20000\nhz = 50000\n";
    std::fs::write(folder.path("lamp.toml"), options).unwrap();
    folder.done(&["observe", "flashing.toml", "-o", "flashing", "-q"]);
    keys(&folder.json(&["timing", "flashing", "--json"]), &mut printed);
    // A counter with raw tags.
    crate::common::tagged::Tagged::new(1).session(&folder.path("tagged"));
    keys(&folder.json(&["reduce", "tagged", "--json"]), &mut printed);
    // A prediction, fitted.
    let page = read("docs/fit.md");
    let scene = page.split("```toml\n").nth(1).unwrap().split("```").next().unwrap().to_owned();
    std::fs::write(folder.path("sphere.toml"), scene).unwrap();
    folder.done(&["simulate", "sphere.toml", "-o", "sphere.ecsv", "-q"]);
    keys(&folder.json(&["fit", "sphere.ecsv", "sphere.toml", "--json"]), &mut printed);
    // One whose parts light each other.
    std::fs::write(folder.path("corner.toml"), include_str!("common/corner.toml")).unwrap();
    folder.done(&["simulate", "corner.toml", "-o", "corner.ecsv", "-q"]);
    let fit = ["fit", "corner.ecsv", "corner.toml", "--free", "albedo", "--json"];
    keys(&folder.json(&fit), &mut printed);
    // Rates are by the station's own channels, devices by their names.
    for channel in ["r", "g", "b", "id400", "spcm", "mppc", "cam", "tagger"] {
        printed.remove(channel);
    }
    let page = read("docs/json.md");
    let quoted: BTreeSet<String> = page.split('`').skip(1).step_by(2).map(str::to_owned).collect();
    // Flags are by their names, some of which are keys elsewhere.
    let flags: BTreeSet<String> = sunglint_radiometry::light_curve::Flags::all()
        .iter_names()
        .map(|(flag, _)| flag.to_lowercase())
        .chain(RetroFlags::all().iter_names().map(|(flag, _)| flag.to_lowercase()))
        .chain(EfficiencyFlags::all().iter_names().map(|(flag, _)| flag.to_lowercase()))
        .collect();
    let undocumented: Vec<&String> =
        printed.difference(&quoted).filter(|key| !flags.contains(*key)).collect();
    assert!(undocumented.is_empty(), "not in docs/json.md: {undocumented:?}");
    let is_key = |word: &&String| {
        word.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_')
    };
    // An embedded station has no files.
    let titles = [
        "tables",
        "import",
        "air",
        "star",
        "passes",
        "picture",
        "simulate",
        "explain",
        "bench",
        "demo",
        "compare",
        // Printed by `demo`: see the commands of the README.
        "files",
        "pages",
        "commands",
        "track",
        "elements",
        "solve",
        "focus",
        // Values of keys.
        "up",
        "down",
        "hyperbola",
        "parabola",
        // Of a device that is served until somebody ends it.
        "tcp",
        "pty",
        "goniometer",
        "with",
        // Of a body under torques.
        "torque",
        "largest_n_m",
        "mean_n_m",
        // Of a body that has been in space for a while.
        "ageing",
        "aged",
        // Of a pass over the zenith.
        "from_s",
        "to_s",
        "first_deg",
        "asked_deg_s",
        // Values of keys.
        "assumed",
        "not_measured",
        "diffuse_may_be_stray",
        "stray_per_sr",
        "quantity",
        "equatorial",
        "horizontal",
        "calibrated",
        "not_simulated",
        "null",
        "file",
        "brdf",
        "ndf",
        "plan",
        "ingest",
        "fit",
        "assemble",
        "show",
        "compare",
        "devices",
        "calibrate",
        "apply",
        "fit",
        // Where the materials are known to so much only.
        "of_scale",
        "material_m2_per_sr",
        // Of magnitudes alone, and where samples are left out.
        "white_noise_mag",
        "mean_mag",
        "why",
        "analyse",
        "period",
        "fold",
        // Values of keys.
        "driver",
        "host",
        "one",
        "family",
        "not_enough",
        "bootstrap",
        "student",
        "check",
        "read",
        "set",
        "move",
        // Where something is plugged in, a server answers, a photon counter counts.
        "bus",
        "path",
        "usb_id",
        "access",
        "addresses",
        "missed",
        "observe",
        "reduce",
        "align",
        "timing",
        "analyse",
        "attitude",
        // Of another minimum that is one by a symmetry, and where samples are left out.
        "symmetry",
        "exchanged",
        "off_deg",
        "several",
        "undetermined",
        "unmix",
        "endmembers",
        "map",
        // Values of keys.
        "auto",
        "astm",
        "fred",
        "merl",
        "rgl",
        "utia",
        "not_decided",
        "single",
        "zemax",
        "factor",
        "weight",
        "share",
        "range",
        "status",
        "end",
        "opening",
        "running",
        "lost",
        "done",
        "stopped",
        "missing",
        "ok",
        "note",
        "failed",
        "read_back",
        "configured",
        "granted",
        "denied",
        "unknown",
        "exact",
        "icosphere",
        "pipeline",
        "stored",
        "none",
        // Values of keys; where the header has a place.
        "two",
        "detect",
        "light",
        "dark",
        "bias",
        "flat",
        "point",
        "streak",
        "latitude_deg",
        "longitude_deg",
        "height_m",
        // A real mount's alone.
        "goto",
        "camera",
        "camera_angle_deg",
        "camera_angle_pier",
        "camera_mirrored",
        "pixel_scale_arcsec",
        "off_arcsec",
        "own_arcsec",
        "synced",
        "pointing",
        "german",
        "places",
        "before_arcsec",
        "rms_arcsec",
        "terms",
        "arcsec",
        "sigma_arcsec",
        "equatorial",
        "horizontal",
        "first_zero",
        "second_zero",
        "tilt_across",
        "tilt_along",
        "cone",
        "perpendicular",
        "tube",
        "circle_sine",
        "circle_cosine",
    ];
    let gone: Vec<&String> = quoted
        .difference(&printed)
        .filter(is_key)
        .filter(|w| !titles.contains(&w.as_str()))
        .collect();
    assert!(gone.is_empty(), "in docs/json.md, but never printed: {gone:?}");
}
