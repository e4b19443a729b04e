//! An index beside the files themselves, read by plain text: what is found, what is read again, what is damaged.

use std::fmt::Write as _;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use sunglint_archive::file::{Kind, number_in};
use sunglint_archive::index::{FOLDER, Index, Known};
use sunglint_archive::{ArchiveError, Found, Query, join};
use sunglint_formats::ecsv;
use sunglint_numerics::progress::{Progress, Silent};

const LINES: [&str; 2] = [
    "1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927",
    "2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537",
];

/// A calibrated curve (synthetic): samples each 10 s from a time of 2020-11-DAY, phase angles from `phase` up by 2° each, in channels of constant rates.
fn curve(
    day: u32,
    hour: u32,
    n: u32,
    phase: f64,
    channels: &[(&str, f64)],
    target: &str,
) -> String {
    let mut text = String::from(
        "# %ECSV 1.0\n# ---\n# datatype:\n# - {name: time_utc, datatype: string}\n# - {name: exposure_s, unit: s, datatype: float64}\n",
    );
    for (name, _) in channels {
        for (column, unit) in [("rate_hz", ", unit: Hz"), ("sigma_hz", ", unit: Hz")] {
            let _ = writeln!(text, "# - {{name: {name}_{column}{unit}, datatype: float64}}");
        }
        let _ = writeln!(text, "# - {{name: {name}_flags, datatype: int64}}");
    }
    text += "# - {name: range_m, unit: m, datatype: float64}\n# - {name: phase_deg, unit: deg, datatype: float64}\n";
    let _ = writeln!(
        text,
        "# meta: {{quantity: calibrated, flag_bits: {{}}, provenance: {{station: ufo, target: \"{target}\"}}{}}}\n# schema: astropy-2.0",
        if target == "iss" {
            format!(
                ", target: {{name: iss, kind: satellite, tle: [\"{}\", \"{}\"]}}",
                LINES[0], LINES[1]
            )
        } else {
            String::new()
        }
    );
    text += "time_utc exposure_s";
    for (name, _) in channels {
        let _ = write!(text, " {name}_rate_hz {name}_sigma_hz {name}_flags");
    }
    text += " range_m phase_deg\n";
    for i in 0..n {
        let _ = write!(text, "2020-11-{day:02}T{hour:02}:{:02}:{:02}Z 0.1", i / 6, i % 6 * 10);
        for (_, rate) in channels {
            let _ = write!(text, " {} 1.5 0", rate + f64::from(i));
        }
        let _ = writeln!(text, " {} {}", 1e6 + f64::from(i), phase + 2.0 * f64::from(i));
    }
    text
}

fn write(root: &Path, name: &str, text: &str) {
    let path = root.join(name);
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, text).unwrap();
}

/// Three nights (synthetic): two of the ISS, one of another object, magnitudes, what is no light, and what is damaged.
fn archive() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    write(root, "n1/iss.ecsv", &curve(18, 17, 20, 30.0, &[("V", 100.0), ("B", 50.0)], "iss"));
    write(root, "n2/deep/iss.ecsv", &curve(20, 4, 10, 70.0, &[("V", 200.0)], "iss"));
    write(root, "n2/other.ecsv", &curve(20, 5, 10, 20.0, &[("V", 900.0)], "other"));
    let mut magnitudes = String::from("time_utc,magnitude,phase_deg,filter\n");
    for i in 0..6 {
        let _ = writeln!(
            magnitudes,
            "2020-11-21T18:00:0{i}Z,{}.5,{},{}",
            5 + i,
            40 + i,
            ["V", "R"][i % 2]
        );
    }
    write(root, "n3/25544.csv", &magnitudes);
    write(root, "n3/list.csv", "object,comment\niss,bright\n");
    write(
        root,
        "n3/summary.ecsv",
        "# %ECSV 1.0\n# ---\n# datatype:\n# - {name: a, datatype: float64}\n# schema: astropy-2.0\na\n1\n",
    );
    write(root, "n1/torn.ecsv", &curve(18, 17, 20, 30.0, &[("V", 1.0)], "iss")[..900]);
    write(root, ".hidden/iss.ecsv", &curve(18, 17, 20, 30.0, &[("V", 1.0)], "iss"));
    folder
}

fn ask(root: &Path, query: &Query) -> Found {
    let mut index = Index::open(root, None).unwrap();
    index.update(false, &Silent).unwrap();
    query.ask(&index)
}

fn of(object: &str, channel: &str) -> Query {
    Query { object: Some(object.into()), channels: vec![channel.into()], ..Query::default() }
}

fn files(found: &Found) -> Vec<(&str, &str, u32)> {
    found.passes.iter().map(|p| (p.file.as_str(), p.channel.as_str(), p.samples)).collect()
}

/// Truth: the files as they were written above.
#[test]
fn passes_are_found_by_object_channel_and_phase() {
    let folder = archive();
    let root = folder.path();
    let all = ask(root, &Query::default());
    assert_eq!(
        files(&all),
        [
            ("n1/iss.ecsv", "V", 20),
            ("n1/iss.ecsv", "B", 20),
            ("n2/deep/iss.ecsv", "V", 10),
            ("n2/other.ecsv", "V", 10),
            ("n3/25544.csv", "V", 3),
            ("n3/25544.csv", "R", 3),
        ]
    );
    let iss = ask(root, &of("25544", "V"));
    assert_eq!(files(&iss), [("n1/iss.ecsv", "V", 20), ("n2/deep/iss.ecsv", "V", 10)]);
    let first = &iss.passes[0];
    assert_eq!((first.norad_id, first.norad_id_from), (Some(25544), Known::File));
    assert_eq!((first.phase_deg, first.range_m), (Some((30.0, 68.0)), Some((1e6, 1_000_019.0))));
    assert_eq!(first.brightest, Some(119.0));
    assert_eq!(
        (first.from_utc.as_str(), first.to_utc.as_str()),
        ("2020-11-18T17:00:00.000Z", "2020-11-18T17:03:10.000Z")
    );
    // The second of the ISS begins at 70°, the first ends at 68°.
    let below = Query { phase_below_deg: Some(60.0), ..of("25544", "V") };
    assert_eq!(files(&ask(root, &below)), [("n1/iss.ecsv", "V", 20)]);
    let above = Query { phase_above_deg: Some(68.0), ..of("25544", "V") };
    assert_eq!(files(&ask(root, &above)), [("n2/deep/iss.ecsv", "V", 10)]);
    let kinds = Query { kinds: vec![Kind::Magnitudes], ..Query::default() };
    assert_eq!(ask(root, &kinds).passes.len(), 2);
    let night = Query {
        from: sunglint_formats::time::parse_utc("2020-11-20T04:30:00Z").ok(),
        to: sunglint_formats::time::parse_utc("2020-11-20T05:30:00Z").ok(),
        ..Query::default()
    };
    assert_eq!(files(&ask(root, &night)), [("n2/other.ecsv", "V", 10)]);
    assert_eq!(all.damaged.len(), 1);
    assert_eq!(all.damaged[0].file, "n1/torn.ecsv");
    let near = ask(root, &of("25544", "W"));
    assert!(near.passes.is_empty() && near.warnings[0].contains("channel `W`"), "{near:?}");
}

#[test]
fn only_what_changed_is_read_again() {
    let folder = archive();
    let root = folder.path();
    let first = ask(root, &Query::default()).index;
    assert_eq!((first.files, first.read, first.gone), (7, 7, 0));
    let again = ask(root, &Query::default());
    assert_eq!((again.index.files, again.index.read, again.index.gone), (7, 0, 0));
    assert_eq!(again.damaged.len(), 1, "the fault is remembered");
    write(root, "n2/other.ecsv", &curve(20, 5, 12, 20.0, &[("V", 900.0)], "other"));
    std::fs::remove_file(root.join("n3/25544.csv")).unwrap();
    let third = ask(root, &Query::default());
    assert_eq!((third.index.read, third.index.gone), (1, 1));
    assert!(files(&third).contains(&("n2/other.ecsv", "V", 12)));
    // The answer is that of an index that is made from nothing.
    let elsewhere = tempfile::tempdir().unwrap();
    let mut fresh = Index::open(root, Some(elsewhere.path())).unwrap();
    fresh.update(true, &Silent).unwrap();
    assert_eq!(Query::default().ask(&fresh).passes, third.passes);
}

/// Any byte of the index that is wrong makes it anew: the answer stays.
#[test]
fn a_damaged_index_is_made_anew() {
    let folder = archive();
    let root = folder.path();
    let truth = ask(root, &Query::default()).passes;
    for name in ["passes.parquet", "files.parquet", "manifest.json"] {
        let path = root.join(FOLDER).join(name);
        let good = std::fs::read(&path).unwrap();
        for at in [0, good.len() / 3, good.len() / 2, good.len() - 1] {
            let mut bad = good.clone();
            bad[at] ^= 0x55;
            std::fs::write(&path, &bad).unwrap();
            let found = ask(root, &Query::default());
            assert_eq!(found.passes, truth, "{name}, byte {at}");
        }
        std::fs::write(&path, &good[..good.len() / 2]).unwrap();
        let found = ask(root, &Query::default());
        assert_eq!(found.passes, truth);
        assert!(found.warnings.iter().any(|w| w.contains("made anew")), "{:?}", found.warnings);
    }
}

/// Truth: the rows that were written, cut and put in order by hand.
#[test]
fn passes_become_one_curve() {
    let folder = archive();
    let root = folder.path();
    let query = Query {
        phase_below_deg: Some(80.0),
        kinds: vec![Kind::Calibrated],
        object: Some("iss".into()),
        ..Query::default()
    };
    let found = ask(root, &query);
    let joined = join::join(&found, &query, root).unwrap();
    assert!(joined.warnings.is_empty());
    let table = joined.table;
    // 20 samples from 30° to 68°; of the other pass those at 70° to 78°.
    assert_eq!(table.rows(), 25);
    let v = table.f64("V_rate_hz").unwrap();
    assert_eq!((v[0], v[19], v[20], v[24]), (100.0, 119.0, 200.0, 204.0));
    let b = table.f64("B_rate_hz").unwrap();
    assert!(b[19] == 69.0 && b[20].is_nan());
    let phase = table.f64("phase_deg").unwrap();
    assert!(phase.iter().all(|p| *p < 80.0));
    // It is a light curve that can be read again, and it names its inputs.
    let text = ecsv::to_string(&table).unwrap();
    let path = root.join("joined.ecsv");
    std::fs::write(&path, text).unwrap();
    let read = ecsv::read(&path).unwrap();
    let curve = sunglint_radiometry::light_curve::LightCurve::from_table(&path, &read).unwrap();
    assert_eq!(curve.provenance.inputs.len(), 2);
    assert_eq!(curve.provenance.target, "iss");
    // Kept in the archive it is no further light.
    assert_eq!(ask(root, &query).passes, found.passes);
    // Different objects, kinds: refused in words.
    for (query, word) in [
        (Query { kinds: vec![Kind::Calibrated], ..Query::default() }, "objects"),
        (Query { channels: vec!["V".into()], ..Query::default() }, "kinds"),
        (of("nothing", "V"), "no pass"),
    ] {
        let error = join::join(&ask(root, &query), &query, root).unwrap_err().to_string();
        assert!(error.contains(word), "{error}");
    }
    let query =
        Query { kinds: vec![Kind::Magnitudes], channels: vec!["V".into()], ..Query::default() };
    let table = join::join(&ask(root, &query), &query, root).unwrap().table;
    assert_eq!(*table.f64("magnitude").unwrap(), [5.5, 7.5, 9.5]);
    assert_eq!(*table.f64("phase_deg").unwrap(), [40.0, 42.0, 44.0]);
}

/// A table of magnitudes that is kept in the archive after it was joined is no further light.
#[test]
fn joined_magnitudes_do_not_count_twice() {
    let folder = archive();
    let root = folder.path();
    let query =
        Query { kinds: vec![Kind::Magnitudes], channels: vec!["V".into()], ..Query::default() };
    let found = ask(root, &query);
    let table = join::join(&found, &query, root).unwrap().table;
    write(root, "joined.ecsv", &ecsv::to_string(&table).unwrap());
    assert_eq!(ask(root, &query).passes, found.passes);
}

/// Two files with the same samples (a copy): they count once, with a warning. With others: refused, both are named. Truth: the files as they were written.
#[test]
fn samples_of_two_files_count_once() {
    let folder = archive();
    let root = folder.path();
    let v = Query { kinds: vec![Kind::Calibrated], ..of("25544", "V") };
    let once = join::join(&ask(root, &v), &v, root).unwrap().table;
    let own = std::fs::read_to_string(root.join("n1/iss.ecsv")).unwrap();
    write(root, "copies/iss.ecsv", &own);
    let joined = join::join(&ask(root, &v), &v, root).unwrap();
    assert_eq!(joined.table.columns, once.columns);
    assert_eq!(joined.warnings.len(), 1);
    let warning = &joined.warnings[0];
    for word in ["n1/iss.ecsv", "copies/iss.ecsv", "20 samples"] {
        assert!(warning.contains(word), "{warning}");
    }
    // One more channel of the same exposures is light of its own.
    write(root, "copies/iss.ecsv", &own.replace("B_", "R_"));
    let all = Query { channels: vec!["V".into(), "R".into()], ..v.clone() };
    let joined = join::join(&ask(root, &all), &all, root).unwrap();
    let (of_v, of_r) =
        (joined.table.f64("V_rate_hz").unwrap(), joined.table.f64("R_rate_hz").unwrap());
    let there = |values: &[f64]| values.iter().filter(|v| v.is_finite()).count();
    assert_eq!((there(&of_v), there(&of_r)), (30, 20));
    // One number that differs in its last digit.
    write(root, "copies/iss.ecsv", &own.replace(" 119 ", " 119.5 "));
    let error = join::join(&ask(root, &v), &v, root).unwrap_err().to_string();
    for word in ["n1/iss.ecsv", "copies/iss.ecsv", "2020-11-18T17:03:10", "count twice"] {
        assert!(error.contains(word), "{error}");
    }
    // Magnitudes.
    let magnitudes = Query { kinds: vec![Kind::Magnitudes], ..Query::default() };
    let own = std::fs::read_to_string(root.join("n3/25544.csv")).unwrap();
    write(root, "copies/25544.csv", &own);
    let joined = join::join(&ask(root, &magnitudes), &magnitudes, root).unwrap();
    assert_eq!((joined.table.rows(), joined.warnings.len()), (6, 1));
    write(root, "copies/25544.csv", &own.replace("5.5", "5.6"));
    let error = join::join(&ask(root, &magnitudes), &magnitudes, root).unwrap_err().to_string();
    assert!(error.contains("copies/25544.csv"), "{error}");
}

/// Passes with the number and passes with the name alone are one object where the name has one number.
#[test]
fn a_name_stands_for_its_only_number() {
    let folder = archive();
    let root = folder.path();
    let by_name = Query { kinds: vec![Kind::Calibrated], ..of("ISS", "V") };
    let named = curve(23, 4, 10, 50.0, &[("V", 300.0)], "other").replace("\"other\"", "\"ISS\"");
    write(root, "n4/named.ecsv", &named);
    let found = ask(root, &by_name);
    let numbers: Vec<_> = found.passes.iter().map(|p| p.norad_id).collect();
    assert_eq!(numbers, [Some(25544), Some(25544), None]);
    assert_eq!(join::join(&found, &by_name, root).unwrap().table.rows(), 40);
    // Another object of the same name.
    let other = curve(24, 4, 10, 50.0, &[("V", 400.0)], "iss")
        .replace("1 25544U", "1 25545U")
        .replace("-11606-4 0  2927", "-11606-4 0  2928")
        .replace("2 25544 ", "2 25545 ")
        .replace("15.72125391563537", "15.72125391563538");
    write(root, "n4/other.ecsv", &other);
    let found = ask(root, &by_name);
    assert_eq!(found.passes[3].norad_id, Some(25545));
    let error = join::join(&found, &by_name, root).unwrap_err().to_string();
    assert!(error.contains("25544, 25545") && error.contains("by its number"), "{error}");
    let by_number = Query { kinds: vec![Kind::Calibrated], ..of("25545", "V") };
    assert_eq!(join::join(&ask(root, &by_number), &by_number, root).unwrap().table.rows(), 10);
}

#[test]
fn angles_that_are_none_are_refused() {
    for deg in [f64::NAN, 400.0, -1.0] {
        for query in [
            Query { phase_below_deg: Some(deg), ..Query::default() },
            Query { phase_above_deg: Some(deg), ..Query::default() },
        ] {
            assert!(matches!(query.check(), Err(ArchiveError::Phase { .. })), "{deg}");
        }
    }
    let widest =
        Query { phase_below_deg: Some(180.0), phase_above_deg: Some(0.0), ..Query::default() };
    widest.check().unwrap();
}

/// A file that the system refuses is tried again, though it is as it was; what cannot be looked at is said. Truth: a file with a hole of 600 MiB, more than a text
/// may have, and a link to itself.
#[cfg(unix)]
#[test]
fn what_the_system_refuses_is_tried_again() {
    let folder = archive();
    let root = folder.path();
    let first = ask(root, &Query::default());
    assert_eq!(first.index.read, 7);
    std::fs::File::create(root.join("n3/large.csv")).unwrap().set_len(600 << 20).unwrap();
    std::os::unix::fs::symlink("round.csv", root.join("n3/round.csv")).unwrap();
    for _ in 0..2 {
        let found = ask(root, &Query::default());
        assert_eq!((found.index.read, found.damaged.len()), (1, 2));
        assert!(found.damaged[1].why.contains("629145600 bytes"), "{:?}", found.damaged);
        assert!(found.warnings.iter().any(|w| w.contains("round.csv is left out")), "{found:?}");
        assert_eq!(found.passes, first.passes);
    }
}

/// Where the index cannot be written (its folder would lie in a file), the answer is given, with a warning.
#[test]
fn an_index_that_cannot_be_written_is_a_warning() {
    let folder = archive();
    let root = folder.path();
    let truth = ask(root, &Query::default());
    let mut index = Index::open(root, Some(&root.join("n3/list.csv/index"))).unwrap();
    index.update(false, &Silent).unwrap();
    let found = Query::default().ask(&index);
    assert_eq!(found.passes, truth.passes);
    assert_eq!(found.warnings.len(), 1);
    assert!(found.warnings[0].contains("list.csv"), "{:?}", found.warnings);
}

/// Is stopped at the second look.
struct Stops(AtomicUsize);

impl Progress for Stops {
    fn is_cancelled(&self) -> bool {
        self.0.fetch_add(1, Ordering::Relaxed) > 0
    }
}

/// Work that was stopped keeps what it read: the rest is read by the next.
#[test]
fn a_stopped_index_is_gone_on_with() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    for i in 0..70 {
        write(root, &format!("{i}.csv"), "object,comment\niss,bright\n");
    }
    let mut index = Index::open(root, None).unwrap();
    let error = index.update(false, &Stops(AtomicUsize::new(0))).unwrap_err();
    assert!(matches!(error, ArchiveError::Cancelled(_)), "{error}");
    let found = ask(root, &Query::default());
    assert_eq!((found.index.files, found.index.read), (70, 6));
    assert!(found.warnings.is_empty(), "{:?}", found.warnings);
}

/// A session's visits, and a curve that has its number by them. Truth: the log's lines.
#[test]
fn a_session_names_the_object_of_a_curve() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    let night =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures/nights/2020-11-18_synthetic");
    let mut log = String::new();
    for line in std::fs::read_to_string(night.join("events.jsonl")).unwrap().lines() {
        if line.contains("\"mu And\"") && line.contains("\"target\"") {
            let _ = writeln!(
                log,
                r#"{{"utc":"2020-11-18T16:20:18Z","kind":"target","name":"other","target_kind":"satellite","on":true,"tle":["{}","{}"]}}"#,
                LINES[0], LINES[1]
            );
        } else {
            log += line;
            log.push('\n');
        }
    }
    std::fs::create_dir_all(root.join("night")).unwrap();
    std::fs::copy(night.join("session.toml"), root.join("night/session.toml")).unwrap();
    write(root, "night/events.jsonl", &log);
    // One at the time of the visit, one of another day.
    write(
        root,
        "curves/a.ecsv",
        &curve(18, 16, 20, 10.0, &[("V", 1.0)], "other").replace("T16:0", "T16:2"),
    );
    write(root, "curves/b.ecsv", &curve(25, 16, 20, 10.0, &[("V", 1.0)], "other"));
    let found = ask(root, &Query { object: Some("25544".into()), ..Query::default() });
    assert_eq!(
        found.passes.iter().map(|p| p.file.as_str()).collect::<Vec<_>>(),
        ["curves/a.ecsv"],
        "{found:?}"
    );
    assert_eq!(found.passes[0].norad_id_from, Known::Session);
    let visits = ask(root, &Query { kinds: vec![Kind::Recorded], ..of("25544", "cam") });
    assert_eq!(visits.passes.len(), 1, "{visits:?}");
    assert_eq!(visits.passes[0].from_utc, "2020-11-18T16:20:18.000Z");
    assert_eq!(visits.passes[0].to_utc, "2020-11-18T16:20:38.000Z");
}

#[test]
fn names_that_are_numbers() {
    for (name, number) in [
        ("25544", Some(25544)),
        ("NORAD 25544", Some(25544)),
        ("norad:5", Some(5)),
        ("object 25544 as sphere of 0.5 m", Some(25544)),
        ("ISS (25544) as box_wing", Some(25544)),
        ("ISS (Zarya) as box_wing", None),
        ("box (3) of paint", None),
        ("0", None),
        ("ISS", None),
        ("", None),
        ("1998-067A", None),
        ("ä25544", None),
        ("12345678901", None),
    ] {
        assert_eq!(number_in(name), number, "{name}");
    }
}
