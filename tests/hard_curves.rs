//! Curves that are hard to read, given to every `sunglint analyse` command that reads one: a right answer, or a refusal with the reason. Nothing is lost in silence, and nothing panics.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::{Folder, SPHERE_PASS, same_light};

/// A curve and, command by command, a part of what it has to be answered.
struct Case {
    name: &'static str,
    rows: Vec<String>,
    /// Expectation of `period`: its verdict, and words of the reason.
    period: (&'static str, &'static str),
    /// Expectation of the other commands: their exit code, and words on stderr where that is 1.
    others: (i32, &'static str),
}

fn cases() -> (String, Vec<Case>) {
    let text = crate::common::turning_curve().replace("quantity: linear", "quantity: predicted");
    let (head, rows): (Vec<&str>, Vec<&str>) =
        text.lines().partition(|l| l.starts_with('#') || l.starts_with("time_utc"));
    let rows: Vec<String> = rows.into_iter().map(str::to_owned).collect();
    let column = |row: &String, at: usize, value: &str| {
        let mut all: Vec<&str> = row.split(' ').collect();
        all[at] = value;
        all.join(" ")
    };
    let every = |at: usize, value: &str, n: usize| -> Vec<String> {
        let change = |(i, row): (usize, &String)| match i % n {
            0 => column(row, at, value),
            _ => row.clone(),
        };
        rows.iter().enumerate().map(change).collect()
    };
    let mut shuffled: Vec<(usize, String)> =
        rows.iter().cloned().enumerate().map(|(i, row)| ((i * 7919) % 600, row)).collect();
    shuffled.sort();
    let case = |name, rows, period, others| Case { name, rows, period, others };
    let cases = vec![
        case("none", Vec::new(), ("", ""), (1, "the light curve has no sample")),
        case("three", rows[..3].to_vec(), ("not_enough", "3 samples that count"), (0, "")),
        case("constant", every(2, "5000", 1), ("not_enough", "the light is constant"), (0, "")),
        case(
            "gap of 90 %",
            [&rows[..30], &rows[570..]].concat(),
            ("not_enough", "no period stands out"),
            (0, ""),
        ),
        case("same times", [&rows[..], &rows[100..140]].concat(), ("one", ""), (0, "")),
        case("unsorted", shuffled.into_iter().map(|s| s.1).collect(), ("one", ""), (0, "")),
        case("rates nan", every(2, "nan", 7), ("", ""), (1, "spcm_rate_hz, row 1: found NaN")),
        case("sigmas nan", every(3, "nan", 7), ("", ""), (1, "spcm_sigma_hz, row 1: found NaN")),
        case("period longer than the data", rows[..30].to_vec(), ("not_enough", "turns"), (0, "")),
    ];
    (head.join("\n"), cases)
}

/// Truth: what was done to the curve, whose period is 20 s in one channel. Tolerance of the period where one is given: 0.1 %, and
/// 2 % of the spin's own along a pass: by so much the bisector's turn may change it, about an axis that nobody knows.
#[test]
fn hard_curves_get_an_answer_or_a_reason() {
    let folder = Folder::new("hard-curves");
    let scene = format!(
        "{SPHERE_PASS}[attitude]\nlaw = \"spin\"\naxis_body = [0, 0, 1]\naxis_gcrs = [0, 0, 1]\nperiod_s = 20\nepoch_utc = 2008-09-21T18:45:00Z\n"
    );
    std::fs::write(folder.path("pass.toml"), scene).unwrap();
    let (head, cases) = cases();
    for case in cases {
        let text = format!("{head}\n{}\n", case.rows.join("\n"));
        std::fs::write(folder.path("c.ecsv"), text.trim_end().to_owned() + "\n").unwrap();
        let asked = |args: &[&str]| {
            let out = folder.run(&[&["analyse"], args].concat());
            let words = String::from_utf8_lossy(&out.stderr).into_owned();
            assert!(!words.contains("panicked"), "{}: {args:?}: {words}", case.name);
            (out, words)
        };
        let (code, reason) = case.others;
        for args in [
            &["fold", "c.ecsv", "--period", "20", "--station", "ufo"][..],
            &["unmix", "c.ecsv", "--endmembers", "white", "--station", "ufo"],
            &["endmembers", "c.ecsv", "--station", "ufo"],
            &["map", "pass.toml", "--curve", "c.ecsv"],
        ] {
            let (out, words) = asked(args);
            assert_eq!(out.status.code(), Some(code), "{}: {args:?}: {words}", case.name);
            assert!(words.contains(reason), "{}: {args:?}: {words}", case.name);
        }
        // One sphere shows one face: all that a spin's measure can say is why not, or that cells are visited.
        let quality = ["map", "pass.toml", "--curve", "c.ecsv", "--quality", "--period", "20"];
        let (out, words) = asked(&[&quality[..], &["--axes-deg", "90"]].concat());
        let told = matches!(out.status.code(), Some(0))
            || ["no cell of", "at least 3 are needed", reason].iter().any(|w| words.contains(w));
        assert!(told, "{}: {words}", case.name);
        for options in [&["--station", "ufo"][..], &["--pass", "pass.toml"]] {
            let (out, words) = asked(&[&["period", "c.ecsv", "--json"], options].concat());
            let (verdict, why) = case.period;
            if verdict.is_empty() {
                assert_eq!(out.status.code(), Some(1), "{}: {words}", case.name);
                assert!(words.contains(reason), "{}: {words}", case.name);
                continue;
            }
            let found: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
            assert_eq!(found["verdict"], verdict, "{}: {found}", case.name);
            match found["reason"].as_str() {
                Some(reason) => assert!(reason.contains(why), "{}: {reason}", case.name),
                None => {
                    let period = found["periods"][0]["period_s"].as_f64().unwrap();
                    let off = if options[0] == "--pass" { 0.02 } else { 1e-3 };
                    assert!((period / 20.0 - 1.0).abs() < off, "{}: {period}", case.name);
                }
            }
        }
        if case.name == "period longer than the data" {
            let (_, words) = asked(&["fold", "c.ecsv", "--period", "20", "--station", "ufo"]);
            assert!(words.contains("turns of 20 s"), "{words}");
        }
    }
}

/// The contents of another program's table are shown and written again.
/// Truth: the numbers of the table; a Julian date of 2459275.5 is 2021-03-02T00:00 (Meeus, table 7.A: 2451545.0 is 2000-01-01T12:00).
#[test]
fn a_foreign_table_is_imported() {
    let folder = Folder::new("import");
    let table = "# synthetic\nJD,Vmag,Mag_Err,Filter,seeing\n2459275.5,5.25,0.05,V,2.1\n2459275.75,6.5,0.1,V,2.0\n";
    std::fs::write(folder.path("night.csv"), table).unwrap();
    let refused = folder.refused(1, &["import", "night.csv"]);
    assert!(refused.contains("--time-scale") && refused.contains("JD"), "{refused}");
    let said = ["import", "night.csv", "--time-scale", "utc", "--target", "COSMOS 1"];
    let text = folder
        .done(&[&said[..], &["-o", "n.ecsv", "--tdm", "n.tdm", "--alcdef", "n.txt"]].concat());
    for part in [
        "`Vmag` is the magnitude",
        "`Mag_Err` is the standard uncertainty",
        "not used    seeing",
        "2021-03-02T00:00:00.000Z to 2021-03-02T06:00:00.000Z",
    ] {
        assert!(text.contains(part), "`{part}` is not in {text}");
    }
    let tdm = std::fs::read_to_string(folder.path("n.tdm")).unwrap();
    assert!(
        tdm.contains("PARTICIPANT_2 = COSMOS 1\n")
            && tdm.contains("MAG = 2021-03-02T06:00:00.000000 6.5\n"),
        "{tdm}"
    );
    // Each of the files that were written says the same again.
    for file in ["n.ecsv", "n.tdm", "n.txt"] {
        let again = folder.json(&["import", file, "--json"]);
        assert_eq!(
            (&again["rows"], &again["from_utc"]),
            (&2.into(), &"2021-03-02T00:00:00.000Z".into()),
            "{file}"
        );
        assert_eq!(again["magnitudes"], serde_json::json!([5.25, 6.5]), "{file}");
    }
    folder.refused(1, &[&said[..], &["--tdm", "n.tdm"]].concat());
    std::fs::write(folder.path("flux.csv"), "mjd_utc,flux\n59275.0,100\n59275.1,10\n").unwrap();
    let none = folder.refused(1, &["import", "flux.csv", "--tdm", "f.tdm"]);
    assert!(none.contains("zero point"), "{none}");
}

/// Truth: the same rows sorted by time, every fifteenth moment measured twice with unlike values, and a gap of a tenth. Every command that reads curves answers the same with the rows in any order, to the last bit.
#[test]
fn every_command_reads_rows_in_any_order() {
    let folder = Folder::new("any-order");
    let scene = format!(
        "{SPHERE_PASS}[attitude]\nlaw = \"spin\"\naxis_body = [0, 0, 1]\naxis_gcrs = [0, 0, 1]\nperiod_s = 20\nepoch_utc = 2008-09-21T18:45:00Z\n[fit]\nfree = [\"albedo\"]\n"
    );
    std::fs::write(folder.path("pass.toml"), scene).unwrap();
    let text = crate::common::turning_curve();
    let (head, rows): (Vec<&str>, Vec<&str>) =
        text.lines().partition(|l| l.starts_with('#') || l.starts_with("time_utc"));
    let mut sorted: Vec<String> = Vec::new();
    // Every second row: a search of a period takes a quarter of the time.
    let rows = rows.iter().step_by(2).enumerate();
    for (i, row) in rows.filter(|(i, _)| !(100..130).contains(i)) {
        if i % 15 == 0 {
            let mut other: Vec<&str> = row.split(' ').collect();
            (other[2], other[3]) = ("9000.5", "140");
            sorted.push(other.join(" "));
        }
        sorted.push((*row).to_owned());
    }
    let n = sorted.len();
    // 7919 is a prime that is no part of the number of rows: it visits all.
    assert!(!n.is_multiple_of(7919));
    let shuffled: Vec<String> = (0..n).map(|i| sorted[(i * 7919 + 13) % n].clone()).collect();
    let reversed: Vec<String> = sorted.iter().rev().cloned().collect();
    assert_ne!(sorted, shuffled);
    let magnitudes = |rows: &[String]| -> String {
        let line = |row: &String| {
            let all: Vec<&str> = row.split(' ').collect();
            let rate: f64 = all[2].parse().unwrap();
            format!("{},{:.6},0.02\n", all[0], 18.0 - 2.5 * rate.log10())
        };
        format!(
            "# synthetic\ntime_utc,mag_v,sigma_mag\n{}",
            rows.iter().map(line).collect::<String>()
        )
    };
    let write = |rows: &[String]| {
        for (file, quantity) in [
            ("linear.ecsv", "linear"),
            ("calibrated.ecsv", "calibrated"),
            ("predicted.ecsv", "predicted"),
        ] {
            let head =
                head.join("\n").replace("quantity: linear", &format!("quantity: {quantity}"));
            std::fs::write(folder.path(file), format!("{head}\n{}\n", rows.join("\n"))).unwrap();
        }
        std::fs::write(folder.path("v.csv"), magnitudes(rows)).unwrap();
    };
    let commands: [&[&str]; 13] = [
        &["analyse", "period", "linear.ecsv", "--station", "ufo"],
        &["analyse", "period", "predicted.ecsv", "--pass", "pass.toml"],
        &["analyse", "period", "v.csv", "--sessions", "joined"],
        &["analyse", "period", "v.csv", "--magnitudes-as", "apparent"],
        &["analyse", "fold", "linear.ecsv", "--period", "20", "--station", "ufo"],
        &["analyse", "unmix", "calibrated.ecsv", "--endmembers", "white", "--station", "ufo"],
        &["analyse", "endmembers", "calibrated.ecsv", "--station", "ufo"],
        &["analyse", "map", "pass.toml", "--curve", "calibrated.ecsv"],
        &["compare", "calibrated.ecsv", "pass.toml"],
        &["compare", "v.csv", "pass.toml", "--as", "apparent"],
        &["fit", "calibrated.ecsv", "pass.toml"],
        &["fit", "v.csv", "pass.toml", "--magnitudes-as", "apparent"],
        &["import", "v.csv"],
    ];
    let answers = || -> Vec<(Option<i32>, serde_json::Value, String)> {
        let one = |args: &&[&str]| {
            let out = folder.run(&[*args, &["--json"][..]].concat());
            let said = String::from_utf8_lossy(&out.stderr).into_owned();
            let json = serde_json::from_slice(&out.stdout).unwrap_or_default();
            (out.status.code(), same_light(json), said)
        };
        commands.iter().map(one).collect()
    };
    write(&sorted);
    let known = answers();
    for (command, (code, json, said)) in commands.iter().zip(&known) {
        assert_eq!(*code, Some(0), "{command:?}: {said}");
        assert!(json.is_object(), "{command:?}: {json}");
    }
    for rows in [&shuffled, &reversed] {
        write(rows);
        for ((command, (_, known, _)), (code, json, said)) in
            commands.iter().zip(&known).zip(answers())
        {
            assert_eq!(code, Some(0), "{command:?}: {said}");
            assert_eq!(json, *known, "{command:?}");
        }
    }
}

/// A table of two objects in turn, whose every fifth row has an uncertainty of 0, and one a flux of 0 (synthetic). Truth: places in the file. Asked for one of them, warnings count its rows alone and name them as they stand in
/// the file.
#[test]
fn rows_in_warnings_are_those_of_the_file() {
    let folder = Folder::new("rows-of-one");
    for (name, of_dark) in [("magnitude,sigma_mag", "9.5"), ("flux,flux_err", "0")] {
        let row = |i: usize| {
            let object = ["A", "B"][i % 2];
            let light =
                if i == 7 { of_dark.to_owned() } else { format!("{}", 9.0 + 0.1 * (i % 7) as f64) };
            let sigma = if i % 5 == 1 { "0" } else { "0.02" };
            format!("2024-02-28T16:56:{i:02}Z,{light},{sigma},{object}\n")
        };
        let text = (0..40).map(row).collect::<String>();
        std::fs::write(folder.path("two.csv"), format!("time_utc,{name},object\n{text}")).unwrap();
        // Rows 2, 12, 22 and 32 of the file are of B, and so is row 8.
        for command in [&["import", "two.csv"][..], &["analyse", "period", "two.csv"]] {
            let out = folder.run(&[command, &["--object", "B"]].concat());
            let said = String::from_utf8([out.stdout, out.stderr].concat()).unwrap();
            assert!(said.contains("4 of 20 (the first: 0 in row 2)"), "{command:?}: {said}");
            if of_dark == "0" && command[0] == "import" {
                assert!(said.contains("1 of 20 (the first: 0 in row 8)"), "{said}");
            }
        }
    }
}

/// Fluxes of 0 and below and uncertainties that are none (synthetic). Truth: the numbers of the table. All fluxes come back as they were, through tables that are imported again, without magnitudes; where magnitudes are written they are those of fluxes above 0
/// alone (−2.5 lg 100 = −5, and 2.5/ln 10 · 5/100 = 0.0543 mag); no infinite or negative number is written anywhere; the first bad row of each kind is named.
#[test]
fn fluxes_of_0_and_below_are_data() {
    let folder = Folder::new("dark-fluxes");
    let flux = |i: usize| match i {
        3 => 0.0,
        4 => -7.5,
        _ => 100.0 + 10.0 * (i % 5) as f64,
    };
    let sigma = |i: usize| match i {
        5 => "0",
        6 => "-1",
        7 => "inf",
        _ => "5",
    };
    let row = |i: usize| format!("2024-02-28T16:56:{i:02}Z,{},{}\n", flux(i), sigma(i));
    let text = (0..40).map(row).collect::<String>();
    std::fs::write(folder.path("f.csv"), format!("time_utc,flux,flux_err\n{text}")).unwrap();
    let out = folder.run(&["import", "f.csv", "-o", "i.ecsv", "-o", "i.csv", "--alcdef", "i.txt"]);
    let said = String::from_utf8(out.stderr).unwrap();
    assert!(out.status.success(), "{said}");
    for words in [
        "fluxes that are not above 0: 2 of 40 (the first: 0 in row 4)",
        "uncertainties that are not above 0 and finite: 3 of 40 (the first: 0 in row 6)",
    ] {
        assert!(said.contains(words), "{said}");
    }
    for file in ["i.ecsv", "i.csv", "i.txt"] {
        let text = std::fs::read_to_string(folder.path(file)).unwrap();
        let bad = |word: &str| word.contains("inf") || word == "-1" || word.starts_with("-0.0");
        let bad =
            |line: &&str| line.starts_with(['2', 'D']) && line.split([',', ' ', '|']).any(bad);
        assert_eq!(text.lines().find(bad), None, "{file}");
        assert_eq!(
            text.lines().filter(|l| l.starts_with("DATA=")).count(),
            if file == "i.txt" { 38 } else { 0 }
        );
    }
    let table = sunglint_formats::ecsv::read(folder.path("i.ecsv")).unwrap();
    let column = |name: &str| table.f64(name).unwrap().into_owned();
    assert!(column("flux").iter().enumerate().all(|(i, f)| *f == flux(i)));
    assert!(table.f64("magnitude").is_err() && table.f64("sigma_mag").is_err());
    assert!(column("sigma_flux")[5..8].iter().all(|s| s.is_nan()));
    // Where magnitudes are asked for, they are those of fluxes above 0.
    let alcdef = std::fs::read_to_string(folder.path("i.txt")).unwrap();
    let first = alcdef.lines().find(|line| line.starts_with("DATA=")).unwrap();
    let numbers: Vec<f64> = first.split('|').skip(1).take(2).map(|n| n.parse().unwrap()).collect();
    assert!((numbers[0] + 5.0).abs() < 1e-3 && (numbers[1] - 0.0543).abs() < 1e-3, "{first}");
    // What is written is read as fluxes again, and every one of the 40 counts.
    for file in ["f.csv", "i.ecsv", "i.csv"] {
        let folded =
            folder.json(&["analyse", "fold", file, "--period", "5", "--bins", "5", "--json"]);
        assert_eq!(folded["channels"][0]["samples"], 40, "{file}: {folded}");
        let told = folded["warnings"].to_string().contains("the first: 0 in row 6");
        // In what was imported they are no numbers any more.
        assert_eq!(told, file == "f.csv", "{file}: {folded}");
    }
    let again = folder.json(&["import", "i.ecsv", "--json"]);
    assert_eq!((&again["with_magnitude"], &again["is_relative"]), (&38.into(), &true.into()));
    // No flux above 0 and no uncertainty: that is what is said.
    std::fs::write(
        folder.path("d.csv"),
        "time_utc,flux\n2024-02-28T16:56:00Z,-1\n2024-02-28T16:56:01Z,-2\n",
    )
    .unwrap();
    let dark = folder.refused(1, &["analyse", "fold", "d.csv", "--period", "5"]);
    assert!(dark.contains("flux above 0"), "{dark}");
    std::fs::write(
        folder.path("n.csv"),
        "time_utc,mag\n2024-02-28T16:56:00Z,nan\n2024-02-28T16:56:01Z,nan\n",
    )
    .unwrap();
    let none = folder.refused(1, &["analyse", "fold", "n.csv", "--period", "5"]);
    assert!(none.contains("the column mag has no number in any of 2 rows"), "{none}");
}

/// Files of another kind than a command takes. Truth: the kind of each, as it was written here. The message names both kinds and what takes the file.
#[test]
fn a_file_of_another_kind_is_named() {
    let folder = Folder::new("other-kinds");
    std::fs::write(folder.path("scene.toml"), SPHERE_PASS).unwrap();
    std::fs::write(
        folder.path("material.toml"),
        "[[material]]\nname = \"x\"\nmodel = \"lambert\"\nreflectance = 0.5\n",
    )
    .unwrap();
    std::fs::write(folder.path("curve.ecsv"), crate::common::turning_curve()).unwrap();
    std::fs::write(folder.path("b.bin"), [1_u8, 0, 0, 7].repeat(500)).unwrap();
    std::fs::write(folder.path("packed.toml"), [0x1f_u8, 0x8b, 8, 0, 0, 0, 0, 0]).unwrap();
    std::fs::write(folder.path("page.html"), "<!DOCTYPE html><html><body>log in</body></html>\n")
        .unwrap();
    crate::sky::draw(&folder, "frame.fits");
    let fold = |file| vec!["analyse", "fold", file, "--period", "5"];
    for (arguments, found, wanted, advice) in [
        (fold("scene.toml"), "found a scene", "a light curve", "`simulate`"),
        (fold("frame.fits"), "found a frame", "a light curve", "`detect`"),
        (fold("b.bin"), "found a binary file", "a light curve", "no text"),
        (fold("page.html"), "found a web page", "a light curve", "login"),
        (vec!["import", "material.toml"], "found materials", "a light curve", "`brdf show`"),
        (vec!["simulate", "material.toml"], "found materials", "expected a scene", "`brdf show`"),
        (vec!["simulate", "curve.ecsv"], "found a light curve", "TOML", "`analyse`"),
        (vec!["simulate", "packed.toml"], "packed with gzip", "text", "gunzip"),
        (vec!["observe", "scene.toml", "--check"], "found a scene", "a night's plan", "`simulate`"),
        (vec!["detect", "curve.ecsv"], "found a light curve", "FITS", "`analyse`"),
        (vec!["detect", "scene.toml"], "found a scene", "FITS", "`simulate`"),
    ] {
        let error = folder.refused(1, &arguments);
        for words in [found, wanted, advice] {
            assert!(error.contains(words), "{arguments:?}: `{words}` is not in {error}");
        }
    }
}

/// A period that is no longer than the exposure. Truth: both numbers, of the curve (0.1 s) and of the command. A longer one says nothing of it.
#[test]
fn a_period_within_an_exposure_is_told() {
    let folder = Folder::new("short-period");
    std::fs::write(folder.path("c.ecsv"), crate::common::turning_curve()).unwrap();
    let said = |period: &str| {
        let out = folder.run(&["analyse", "fold", "c.ecsv", "--period", period, "--keep", "air"]);
        assert!(out.status.success());
        String::from_utf8(out.stderr).unwrap()
    };
    let short = said("0.04");
    assert!(short.contains("period of 0.04 s") && short.contains("exposure of 0.1 s"), "{short}");
    assert!(!said("20").contains("exposure of"));
}

/// Rates of which a few have no uncertainty (synthetic): a straight line of 300 with three bright ones whose σ is 0. Truth: what the warning says, that all samples then weigh alike: the fold is that of the same
/// rates without a σ anywhere. A slip in a scene's [fit] is told with its line, not as another kind of file.
#[test]
fn uncertainties_of_0_weigh_no_more_and_slips_keep_their_line() {
    let folder = Folder::new("sigma-of-0");
    let rows = |sigma: &dyn Fn(usize) -> f64| -> String {
        let rate = |i: usize| if i % 100 == 50 { 9e4 } else { 5e4 + 100.0 * (i % 7) as f64 };
        let head = "# %ECSV 1.0\n# ---\n# datatype:\n# - {name: time_utc, datatype: string}\n# - {name: exposure_s, datatype: float64, unit: s}\n# - {name: a_rate_hz, datatype: float64, unit: Hz}\n# - {name: a_sigma_hz, datatype: float64, unit: Hz}\n# - {name: a_flags, datatype: int64}\n# meta: {quantity: linear, flag_bits: {}}\n# schema: astropy-2.0\ntime_utc exposure_s a_rate_hz a_sigma_hz a_flags\n";
        let row = |i: usize| {
            format!("2024-02-28T16:{:02}:{:02}Z 0.1 {} {} 0\n", i / 60, i % 60, rate(i), sigma(i))
        };
        head.to_owned() + &(0..300).map(row).collect::<String>()
    };
    let few = rows(&|i| if i % 100 == 50 { 0.0 } else { 3e3 });
    let none = rows(&|_| 0.0);
    std::fs::write(folder.path("few.ecsv"), few).unwrap();
    std::fs::write(folder.path("none.ecsv"), none).unwrap();
    let of = |file: &str| {
        folder.done(&["analyse", "fold", file, "--period", "7", "--bins", "7", "-q", "-o", "-"])
    };
    let equal = of("none.ecsv");
    let profile = |text: &str| -> Vec<String> {
        text.lines().filter(|line| !line.starts_with('#')).map(str::to_owned).collect()
    };
    assert!(profile(&equal).len() > 7, "{equal}");
    assert_eq!(profile(&of("few.ecsv")), profile(&equal));
    std::fs::write(folder.path("s.toml"), format!("{SPHERE_PASS}\n[fit]\nplaces = \"x\"\n"))
        .unwrap();
    let row = |i: usize| format!("2024-02-28T16:56:{i:02}Z,7.{i:02}\n");
    let text = format!("time_utc,magnitude\n{}", (0..40).map(row).collect::<String>());
    std::fs::write(folder.path("c.csv"), text).unwrap();
    let said = folder.refused(1, &["fit", "c.csv", "s.toml"]);
    assert!(said.contains("places") && !said.contains("a TOML file with the keys"), "{said}");
}
