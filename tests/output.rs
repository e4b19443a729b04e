//! Where results go: all or nothing, never twice, never over what is there; and what is on stdout meanwhile.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::Folder;

const AIR: [&str; 6] = ["air", "--station", "ufo", "--zenith", "0", "--step-nm=10"];

fn air(more: &[&'static str]) -> Vec<&'static str> {
    [&AIR[..], more].concat()
}

fn files(folder: &Folder) -> Vec<String> {
    let mut found = Vec::new();
    let mut folders = vec![folder.0.clone()];
    while let Some(inside) = folders.pop() {
        for entry in std::fs::read_dir(inside).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                found.push(path.strip_prefix(&folder.0).unwrap().display().to_string());
            }
        }
    }
    found.sort();
    found
}

#[test]
fn nothing_is_written_unless_all_can_be() {
    let folder = Folder::new("output-all");
    std::fs::create_dir(folder.path("there")).unwrap();
    std::fs::write(folder.path("there/air.svg"), "mine").unwrap();
    for (targets, code, expected) in [
        (&["-o", "there"][..], 1, "there/air.svg is there already"),
        (&["-o", "new.ecsv", "-o", "there/"], 1, "there/air.svg is there already"),
        (&["-o", "new.ecsv", "-o", "nodir/a.csv"], 1, "the folder nodir does not exist"),
        (&["-o", "new.ecsv", "-o", "there/air.svg/a.csv"], 1, "is no folder"),
        (&["-o", "new.ecsv", "-o", "new.ecsv"], 2, "new.ecsv would be written twice"),
        (&["-o", "new.ecsv", "-o", "./new.ecsv", "--force"], 2, "would be written twice"),
        (&["-o", "fresh/", "-o", "fresh/air.png"], 2, "would be written twice"),
        (&["-o", "new.ecsv", "-o", "new.xlsx"], 2, "found the extension `xlsx`"),
        (&["-o", "new.ecsv", "-o", "new"], 2, "found no extension, expected .ecsv"),
        (&["-o", "new.ecsv", "-o", ".csv"], 2, "result.csv?"),
        (&["-o", "-", "--json"], 2, "both want stdout"),
    ] {
        let message = folder.refused(code, &air(targets));
        assert!(message.contains(expected), "{targets:?}: {message}");
        assert_eq!(files(&folder), ["there/air.svg"], "{targets:?}");
    }
    // A figure that cannot be drawn keeps the table beside it from being written; the result is said.
    let said = folder.refused(1, &["tables", "bright_stars", "-o", "s.ecsv", "-o", "s.png"]);
    assert!(said.starts_with("bright_stars: Stars to V = 5.0"), "{said}");
    assert!(said.contains("`bright_stars` has no figure"), "{said}");
    assert_eq!(files(&folder), ["there/air.svg"]);
    folder.done(&air(&["-o", "there", "--force"]));
    assert_eq!(files(&folder), ["there/air.ecsv", "there/air.png", "there/air.svg"]);
    folder.done(&air(&["-o", "fresh/", "-o", "beside.ecsv"]));
    assert!(folder.path("fresh/air.png").is_file());
}

/// A table that is read is not written over, however it is named, `--force` or not; beside it the result is.
#[test]
fn what_is_read_is_not_written_over() {
    let folder = Folder::new("output-over");
    std::fs::create_dir(folder.path("there")).unwrap();
    let curve = "jd_utc,magnitude\n2460000.1,5.1\n2460000.2,5.2\n2460000.3,5.3\n";
    std::fs::write(folder.path("c.ecsv"), curve).unwrap();
    for target in [&["-o", "./c.ecsv"][..], &["-oc.ecsv"], &["--output=there/../c.ecsv"]] {
        let told = folder.refused(2, &[&["import", "c.ecsv", "--force"], target].concat());
        assert!(told.contains("is read by this command, too"), "{target:?}: {told}");
        assert_eq!(std::fs::read_to_string(folder.path("c.ecsv")).unwrap(), curve);
    }
    folder.done(&["import", "c.ecsv", "-o", "other.ecsv"]);
    folder.done(&["import", "c.ecsv", "-o", "other.ecsv", "--force"]);
}

#[test]
fn text_and_documents_are_printed_beside_files() {
    let folder = Folder::new("output-beside");
    let output = folder.run(&air(&["-o", "a.ecsv"]));
    assert!(String::from_utf8_lossy(&output.stdout).contains("transmission (mean over 10 nm"));
    assert_eq!(String::from_utf8_lossy(&output.stderr), "wrote a.ecsv\n");
    let output = folder.run(&air(&["-o", "b.ecsv", "-q"]));
    assert!(output.stdout.is_empty() && output.stderr.is_empty() && folder.path("b.ecsv").exists());
    assert_eq!(folder.json(&air(&["-o", "c.ecsv", "--json"]))["station"], "ufo");
    assert_eq!(folder.json(&air(&["-o", "d.ecsv", "--json", "-q"]))["station"], "ufo");
    // -q leaves the result where it is all there is.
    assert!(folder.done(&air(&["-q"])).contains("transmission"));
    // With `-o -` the table is all there is on stdout, also beside a file.
    assert!(folder.done(&air(&["-o", "-", "-o", "e.json"])).starts_with("# %ECSV"));
    let written = std::fs::read_to_string(folder.path("e.json")).unwrap();
    let json: serde_json::Value = serde_json::from_str(&written).unwrap();
    assert_eq!(json["zenith"][0]["transmission"].as_array().unwrap().len(), 95);
    for name in ["sun", "vega"] {
        let file = format!("{name}.ecsv");
        assert_eq!(folder.json(&["tables", name, "-o", &file, "--json"])["name"], name);
        assert!(folder.path(&file).is_file());
    }
}

#[cfg(unix)]
#[test]
fn a_device_is_written_to_and_stays() {
    use std::os::unix::fs::FileTypeExt as _;
    let folder = Folder::new("output-device");
    folder.done(&air(&["-o", "/dev/null"]));
    folder.done(&air(&["-o", "/dev/null", "--force"]));
    assert!(std::fs::metadata("/dev/null").unwrap().file_type().is_char_device());
}

#[test]
fn tables_are_shown_drawn_and_found() {
    let folder = Folder::new("output-tables");
    folder.done(&["tables", "refractive_indices", "-o", "n.svg"]);
    let svg = std::fs::read_to_string(folder.path("n.svg")).unwrap();
    assert!(svg.contains("kapton") && svg.contains("vacuum wavelength (nm)"));
    folder.done(&["tables", "sun", "-o", "sun/"]);
    assert_eq!(files(&folder), ["n.svg", "sun/sun.ecsv", "sun/sun.png", "sun/sun.svg"]);
    // The first rows of the embedded file.
    let text = folder.done(&["tables", "sun"]);
    assert!(text.contains("280               0.082") && text.contains("more rows"), "{text}");
    for (wanted, expected) in
        [("stars", "bright_stars"), ("air", "air_tropical"), ("ozone", "ozone_chappuis")]
    {
        let message = folder.refused(1, &["tables", wanted]);
        assert!(message.contains("did you mean") && message.contains(expected), "{message}");
    }
}

#[test]
fn the_help_says_what_exit_codes_mean() {
    let folder = Folder::new("output-help");
    let help = folder.done(&["--help"]);
    assert!(help.contains("1 failed") && help.contains("2 usage"), "{help}");
    assert!(help.contains("It counts for `brdf ndf`"), "{help}");
}

/// Names of others: what a terminal, a file of XML or a path would obey. Truth: none of it is left where it could be obeyed.
#[test]
fn a_name_does_no_harm() {
    let names = [
        "../../out",
        "/tmp/x",
        "a\u{1b}[31mb\u{7}",
        "<b>&amp;\"'",
        "new\nline",
        "\u{202e}cod.exe",
        "\u{9b}2J",
        "-rf",
        "ü🛰 \u{ffff}",
    ];
    for (i, name) in names.iter().enumerate() {
        let folder = Folder::new(&format!("output-names-{i}"));
        let quoted = serde_json::to_string(name).unwrap();
        let scene = crate::common::SPHERE_PASS.replacen(
            "[target]",
            &format!("name = {quoted}\n[target]\nname = {quoted}"),
            1,
        );
        std::fs::write(folder.path("pass.toml"), scene).unwrap();
        let output = folder.run(&["simulate", "pass.toml", "--step-s", "120", "-o", "out/"]);
        let said = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap());
        let obeyed = |c: char| (c.is_control() && c != '\n' && c != '\t') || c == '\u{202e}';
        assert!(!said.iter().any(|text| text.contains(obeyed)), "{name:?}: {said:?}");
        // A name that is refused with a word is as good.
        if output.status.success() {
            let written = files(&folder);
            assert!(
                written.iter().all(|f| f == "pass.toml" || f.starts_with("out/")),
                "{written:?}"
            );
            for svg in written.iter().filter(|f| f.ends_with(".svg")) {
                let text = std::fs::read_to_string(folder.path(svg)).unwrap();
                assert!(!text.contains(|c: char| obeyed(c) || c == '\u{ffff}'), "{name:?}: {svg}");
                assert!(!text.contains("<b>"), "{name:?}: {svg}");
            }
        } else {
            assert!(said[1].contains("name"), "{name:?}: {}", said[1]);
        }
    }
}

/// Truth: by construction. A table of geometries leaves its rows under the name that was asked for and nothing beside it, and is not written over; derivatives, which a table has no columns for, are refused.
#[test]
fn a_table_of_geometries_is_whole_or_not_there() {
    let folder = Folder::new("light-table");
    std::fs::write(
        folder.path("g.csv"),
        "sun_x,sun_y,sun_z,observer_x,observer_y,observer_z\n1,0,0.3,1,0.2,0.5\n0,1,0.3,1,0.2,0.5\n",
    )
    .unwrap();
    let light = ["light", "cube", "--table", "g.csv", "--wavelength-nm", "550"];
    folder.done(&[&light[..], &["-o", "made.csv"]].concat());
    let names: Vec<String> = std::fs::read_dir(&folder.0)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .filter(|name| name != "g.csv")
        .collect();
    assert_eq!(names, ["made.csv"]);
    let rows = std::fs::read_to_string(folder.path("made.csv")).unwrap();
    assert_eq!(rows.lines().filter(|line| !line.starts_with('#')).count(), 3, "{rows}");
    folder.refused(1, &[&light[..], &["-o", "made.csv"]].concat());
    let error =
        folder.refused(2, &[&light[..], &["-o", "d.csv", "--derivatives", "albedo"]].concat());
    assert!(error.contains("--derivatives"), "{error}");
    let one =
        ["light", "cube", "--sun", "1,0,0.3", "--observer", "1,0.2,0.5", "--wavelength-nm", "550"];
    folder.refused(2, &[&one[..], &["-o", "d.ecsv", "--derivatives", "albedo"]].concat());
    folder.done(&[&one[..], &["-o", "d.json", "--derivatives", "albedo"]].concat());
    // The table of terms stands within 80 columns, numbers below one another: the last columns of its head and of its rows are the same.
    let text = folder.done(&["light", "box_wing", "--sun", "1,0,0.1", "--observer", "1,0.2,0.3"]);
    let terms: Vec<&str> = text
        .lines()
        .skip_while(|l| !l.starts_with("  light of"))
        .take_while(|l| !l.is_empty())
        .collect();
    let rows: Vec<&&str> = terms.iter().filter(|l| l.contains("direct, ")).collect();
    assert_eq!(rows.len(), 4, "{text}");
    for row in rows.into_iter().chain(&terms[..1]) {
        assert_eq!(row.chars().count(), terms[0].chars().count(), "{text}");
        assert!(row.chars().count() <= 80, "{text}");
    }
}
