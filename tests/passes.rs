//! `sunglint passes` as a person runs it.

#![allow(clippy::unwrap_used, reason = "a test says what it expects")]

use crate::common::Folder;
use sunglint_testkit::fixture;

fn elements() -> String {
    fixture("passes/satellites.tle").display().to_string()
}

/// The arguments of a night, with others behind them.
fn night<'a>(tle: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let mut all = vec![
        "passes",
        "--tle",
        tle,
        "--station",
        "ufo",
        "--from",
        "2024-08-12T18:00",
        "--to",
        "2024-08-13T04:00",
    ];
    all.extend(more);
    all
}

/// Truth: the magnitude by hand from the geometry that the program prints: a diffuse sphere of 1 m, ρ = 0.2, V☉ = −26.75 ± 0.05 at 1 au (Willmer
/// 2018 has −26.76); and the definition of the visible part: within the stay, sunlit, the Sun below −6°.
#[test]
fn a_night_in_text_table_and_json() {
    let folder = Folder::new("passes-night");
    let tle = elements();
    let one = ["--norad", "90002,90004", "-o", "night.ecsv", "-o", "sky.svg", "-o", "sky.png"];
    let text = folder.done(&night(&tle, &one));
    // The list itself is readable in 110 columns.
    let list = text.lines().skip_while(|l| !l.starts_with("number")).take_while(|l| !l.is_empty());
    assert!(list.clone().count() > 5 && list.clone().all(|l| l.chars().count() <= 110), "{text}");
    assert!(text.contains("visible passes of 2 objects") && text.contains("SYNTHETIC POLAR"));
    let svg = std::fs::read_to_string(folder.path("sky.svg")).unwrap();
    assert!(svg.contains("SYNTHETIC HIGH LEO") && svg.contains("highest"));
    assert!(folder.path("sky.png").metadata().unwrap().len() > 10_000);
    let table = sunglint_formats::ecsv::read(folder.path("night.ecsv")).unwrap();
    let json = folder.json(&night(&tle, &["--norad", "90002,90004", "--json"]));
    let passes = json["passes"].as_array().unwrap();
    assert_eq!(passes.len(), table.rows());
    assert!(passes.len() >= 4);
    let v = table.f64("brightest_v_mag").unwrap();
    for (i, pass) in passes.iter().enumerate() {
        let b = &pass["brightest"];
        let number = |key: &str| b[key].as_f64().unwrap();
        let (phase, range) = (number("phase_deg").to_radians(), number("range_m"));
        let f = 2.0 / (3.0 * std::f64::consts::PI)
            * (phase.sin() + (std::f64::consts::PI - phase) * phase.cos());
        let ratio = 0.2 * (0.5 / range).powi(2) * f * number("sunlit");
        let by_hand = -26.75 - 2.5 * ratio.log10();
        // The Sun is 1.013 au away in August: 0.03 mag.
        assert!((number("v_mag") - by_hand - 0.028).abs() < 0.06, "{by_hand} {pass}");
        assert!((v[i] - number("v_mag")).abs() < 1e-6);
        let extinction = pass["v_station_mag"].as_f64().unwrap() - number("v_mag");
        assert!((0.05..2.5).contains(&extinction), "{extinction}");
        assert!(number("sun_altitude_deg") < -6.0 && number("altitude_deg") >= 9.99);
        assert!(pass["start"]["time_utc"].as_str() <= pass["end"]["time_utc"].as_str());
        for channel in pass["rates"].as_object().unwrap().values() {
            assert!(channel["rate_hz"].as_f64().unwrap() > 0.0);
        }
    }
}

#[test]
fn the_result_does_not_depend_on_threads() {
    let folder = Folder::new("passes-threads");
    let tle = elements();
    let of = |threads: &str| {
        folder.done(&night(
            &tle,
            &["--norad", "90001,90002,90004,90005", "--threads", threads, "-o", "-", "-q"],
        ))
    };
    assert_eq!(of("1"), of("3"));
}

#[test]
fn no_visible_pass_is_said_with_its_reasons() {
    let folder = Folder::new("passes-none");
    let tle = elements();
    let text = folder.done(&night(&tle, &["--norad", "90008"]));
    assert!(text.contains("no visible pass of 1 object between 2024-08-12T18:00:00Z"), "{text}");
    assert!(text.contains("1 object never rose above 10°"), "{text}");
    let day = [
        "passes",
        "--tle",
        &tle,
        "--station",
        "ufo",
        "--norad",
        "90001",
        "--from",
        "2024-08-12T12:00",
        "--to",
        "2024-08-12T13:00",
    ];
    let text = folder.done(&day);
    assert!(text.contains("the Sun never stands below -6° in that time"), "{text}");
    assert!(text.contains("of 1 pass above 10° 1 under a bright sky"), "{text}");
    let text = folder.done(&night(&tle, &["--norad", "90002", "--brighter-than", "-9"]));
    assert!(text.contains("left out by"), "{text}");
}

#[test]
fn bad_input_is_said_clearly_and_hides_nothing_else() {
    let folder = Folder::new("passes-bad");
    let tle = elements();
    let good = std::fs::read_to_string(&tle).unwrap();
    // A satellite that decays within hours, and a set with a wrong checksum.
    let wrong = good.replacen("15.50000000    13", "15.50000000    14", 1);
    std::fs::write(folder.path("bad.tle"), wrong).unwrap();
    let json = folder.json(&night("bad.tle", &["--name", "polar", "--json", "-q"]));
    assert_eq!(json["failures"].as_array().unwrap().len(), 1, "{}", json["failures"]);
    assert!(json["failures"][0]["why"].as_str().unwrap().contains("bad.tle:3"), "{json}");
    assert!(!json["passes"].as_array().unwrap().is_empty());
    for (code, more, expected) in [
        (2, vec!["--norad", "12345"], "--norad: `12345` is not among"),
        (2, vec!["--name", "nothing"], "--name nothing"),
        (1, vec!["--diameter-m", "0"], "--diameter-m is 0"),
        (1, vec!["--reflectance", "1.5"], "--reflectance is 1.5"),
        (1, vec!["--exposure-s", "-1"], "--exposure-s is -1"),
        (1, vec!["--min-elevation", "95"], "the lowest altitude is 95°"),
        (1, vec!["--min-duration-s", "nan"], "--min-duration-s is NaN"),
        (1, vec!["--brighter-than", "inf"], "--brighter-than is inf"),
        (2, vec!["-o", "sky.txt"], "found the extension `txt`"),
        (2, vec!["--standard-magnitude", "4", "--diameter-m", "2"], "cannot be used with"),
    ] {
        let message = folder.refused(code, &night(&tle, &more));
        assert!(message.contains(expected), "{more:?}: {message}");
    }
    let backwards =
        ["passes", "--tle", &tle, "--station", "ufo", "--from", "2024-08-12", "--to", "2024-08-11"];
    assert!(folder.refused(1, &backwards).contains("--to must be later than --from"));
    std::fs::write(folder.path("empty.tle"), "").unwrap();
    assert!(folder.refused(1, &night("empty.tle", &[])).contains("no elements"));
    assert!(folder.refused(1, &night("missing.tle", &[])).contains("missing.tle"));
}

/// Truth: the closed form of a diffuse sphere, which `--diameter-m` has and the light engine of `--model` has not, for every moment, rate and
/// magnitude of a night; to 0.002 mag and 0.3 %, since rates of the closed form are interpolated over the height to 0.1 %; brighter the model may be by 0.01 mag and
/// 1 %, for it alone has the Earth's light (0.4 % here). Moments in penumbra or at phase angles above 70° are left out.
#[test]
fn a_sphere_as_a_model_is_as_bright_as_its_formula() {
    let folder = Folder::new("passes-sphere");
    let tle = elements();
    let of = |more: &[&str]| {
        let objects = ["--norad", "90002,90004,90005", "--json", "-q"];
        folder.json(&night(&tle, &[&objects, more].concat()))
    };
    let model = of(&["--model", "lambert_sphere"]);
    let sphere = of(&["--diameter-m", "2", "--reflectance", "1"]);
    assert_eq!(model["brightness"]["law"], "model");
    assert_eq!(model["brightness"]["attitude"], "orbit");
    let (models, spheres) = (model["passes"].as_array().unwrap(), sphere["passes"].as_array());
    let spheres = spheres.unwrap();
    assert!(models.len() == spheres.len() && models.len() >= 4);
    let mut compared = 0;
    for (a, b) in models.iter().zip(spheres) {
        for moment in ["start", "culmination", "brightest", "end"] {
            let number = |key: &str| a[moment][key].as_f64().unwrap_or(f64::NAN);
            if number("sunlit") < 1.0 || number("phase_deg") > 70.0 {
                // A thin crescent, or a target in penumbra, is seen by the Earth's light as much.
                continue;
            }
            compared += 1;
            let (a, b) = (&a[moment]["v_mag"], &b[moment]["v_mag"]);
            match (a.as_f64(), b.as_f64()) {
                (Some(a), Some(b)) => {
                    assert!((-0.01..0.002).contains(&(a - b)), "{moment}: {a} {b}");
                }
                (a, b) => assert_eq!(a, b),
            }
        }
        let v = |p: &serde_json::Value| p["v_station_mag"].as_f64().unwrap();
        assert!((-0.012..0.004).contains(&(v(a) - v(b))), "{} {}", v(a), v(b));
        for (name, channel) in a["rates"].as_object().unwrap() {
            let rate = |c: &serde_json::Value| c["rate_hz"].as_f64().unwrap();
            let (a, b) = (rate(channel), rate(&b["rates"][name]));
            assert!((-3e-3..1e-2).contains(&(a / b - 1.0)), "{name}: {a} {b}");
        }
    }
    assert!(compared >= 4, "{compared}");
}

/// Truth: `simulate`, whose own tests have theirs, at the brightest moment of a model that flashes, and its neighbours: the rates are the same,
/// and no sample of the pass's visible part, every second, is brighter by more than what happens between them.
#[test]
fn a_model_has_the_rates_that_simulate_gives_it() {
    let folder = Folder::new("passes-model");
    let tle = elements();
    let turned = "[attitude]\nlaw = \"orbit\"\neuler_zyx_deg = [10, 20, 30]\n";
    std::fs::write(folder.path("turned.toml"), turned).unwrap();
    let model = ["--norad", "90002", "--model", "box_wing", "--attitude", "turned.toml"];
    let json = folder.json(&night(&tle, &[&model[..], &["--json", "-q"]].concat()));
    let pass = &json["passes"][0];
    let scene = |times: &str| {
        format!(
            "[target]\nbuilt_in = \"box_wing\"\n[orbit]\ntle = {tle:?}\nnorad_id = 90002\n{turned}[station]\nname = \"ufo\"\n[times]\n{times}\n"
        )
    };
    let text = |value: &serde_json::Value| value.as_str().unwrap().to_owned();
    let brightest = &pass["brightest"];
    std::fs::write(
        folder.path("one.toml"),
        scene(&format!("from = {}", text(&brightest["time_utc"]))),
    )
    .unwrap();
    let one = folder.json(&["simulate", "one.toml", "--json", "-q"]);
    let v = one["v_above_air"]["brightest_mag"].as_f64().unwrap();
    // What each knows of the way decides what it models, and light paths scatter: they agree within what `simulate` states and what `passes` leaves out, 1 %.
    let mut most = 0.0_f64;
    for channel in one["channels"].as_array().unwrap() {
        let rate = pass["rates"][channel["name"].as_str().unwrap()]["rate_hz"].as_f64().unwrap();
        let simulated = channel["highest_hz"].as_f64().unwrap();
        let stated = channel["stated_error"]["largest_relative"].as_f64().unwrap();
        assert!((rate / simulated - 1.0).abs() < stated + 0.01, "{rate} {channel}");
        most = most.max(stated);
    }
    assert!(most < 0.05, "{most}");
    let apart = (v - brightest["v_mag"].as_f64().unwrap()).abs();
    assert!(apart < 1.1 * (most + 0.01), "{v} {brightest}");
    let visible = &pass["visible"][0];
    let (from, to) = (text(&visible["from_utc"]), text(&visible["to_utc"]));
    let times = format!("from = {from}\nto = {to}\nstep_s = 1");
    std::fs::write(folder.path("all.toml"), scene(&times)).unwrap();
    let all = folder.json(&["simulate", "all.toml", "--json", "-q"]);
    let best = all["v_above_air"]["brightest_mag"].as_f64().unwrap();
    assert!(best > v - 0.02, "{best} {v}");
    // A law that the help names needs nothing else.
    let yaw = ["--norad", "90002", "--model", "box_wing_diffuse", "--attitude", "yaw_steering"];
    folder.done(&night(&tle, &[&yaw[..], &["--tolerance", "5%", "-q"]].concat()));
    for (code, more, expected) in [
        (1, vec!["--model", "box_wing", "--attitude", "sun"], "a file with [attitude]"),
        (1, vec!["--model", "box_wings"], "did you mean box_wing?"),
        (1, vec!["--model", "box_wing", "--attitude", "orbits"], "did you mean orbit?"),
        (1, vec!["--model", "box_wing", "--attitude", "spin"], "a file with [attitude]"),
        (2, vec!["--attitude", "orbit"], "--model"),
        (2, vec!["--model", "box_wing", "--diameter-m", "2"], "cannot be used with"),
    ] {
        let message = folder.refused(code, &night(&tle, &more));
        assert!(message.contains(expected), "{more:?}: {message}");
    }
}

/// The commands of docs/planning.md, on what the demonstration leaves. Truth: none but that each does its work; what they calculate has its tests.
#[test]
fn the_commands_of_the_page_run() {
    let folder = Folder::new("planning-page");
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let page = std::fs::read_to_string(root.join("docs/planning.md")).unwrap();
    std::fs::create_dir_all(folder.path("sunglint-demo/simulated")).unwrap();
    for entry in std::fs::read_dir(root.join("rehearsal/demo")).unwrap().flatten() {
        if entry.path().is_dir() {
            continue;
        }
        let name = entry.file_name().into_string().unwrap();
        std::fs::copy(entry.path(), folder.path(&format!("sunglint-demo/{name}"))).unwrap();
    }
    for [scene, curve] in [["pass", "box_wing_pass"], ["sphere", "sphere_pass"]] {
        let scene = format!("sunglint-demo/{scene}.toml");
        let curve = format!("sunglint-demo/simulated/{curve}.ecsv");
        folder.done(&[
            "simulate",
            &scene,
            "--step-s",
            "20",
            "--tolerance",
            "1%",
            "-o",
            &curve,
            "-q",
        ]);
    }
    let commands: Vec<&str> = page.lines().filter_map(|l| l.strip_prefix("sunglint ")).collect();
    assert!(commands.len() >= 10, "{commands:?}");
    for command in commands {
        folder.done(&command.split(' ').collect::<Vec<_>>());
    }
    assert!(folder.path("rehearsal-kappa.ecsv").exists() && folder.path("expected.png").exists());
}
