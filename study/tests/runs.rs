//! Shards: what they hold, and that they are the same bytes however they were made.

use crate::{folder, read};
use parquet::file::reader::{FileReader as _, SerializedFileReader};
use parquet::record::Field;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use sunglint_numerics::progress::{Progress, Silent};
use sunglint_study::run::{Part, run};
use sunglint_study::{Study, StudyError};

const SPHERES: &str = r#"
[study]
scene = "pass.toml"
keep = ["summary", "samples"]
tasks_a_shard = 2
[[parameter]]
key = "target.sphere.radius_m"
values = [0.5, 1.0, 2.0, 0.0625, 3.0]
"#;

/// All files of a folder, by name.
pub fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![folder.to_path_buf()];
    while let Some(next) = folders.pop() {
        for entry in std::fs::read_dir(next).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let name = path.strip_prefix(folder).expect("below").to_path_buf();
                found.insert(name, std::fs::read(&path).expect("a file"));
            }
        }
    }
    found
}

/// Rows of a table of a study, by column.
fn rows(folder: &Path, table: &str) -> Vec<BTreeMap<String, Field>> {
    let names = files(&folder.join(table));
    let read = |name: &PathBuf| {
        let file = std::fs::File::open(folder.join(table).join(name)).expect("a file");
        let reader = SerializedFileReader::new(file).expect("Parquet");
        let rows = reader.get_row_iter(None).expect("rows");
        rows.map(|row| row.expect("a row").into_columns().into_iter().collect())
            .collect::<Vec<BTreeMap<String, Field>>>()
    };
    names.keys().flat_map(read).collect()
}

fn number(row: &BTreeMap<String, Field>, name: &str) -> f64 {
    match &row[name] {
        Field::Double(v) => *v,
        Field::Long(v) => *v as f64,
        other => panic!("{name} is {other:?}"),
    }
}

/// Truth: light goes with the sphere's area, so that a sphere k times as large is 5 lg k mag brighter, and its rates k² times as high, to rounding (1e-9).
#[test]
fn larger_spheres_are_brighter_by_their_areas() {
    let (dir, path) = folder(SPHERES);
    let study = read(&path).expect("a study");
    let out = dir.path().join("out");
    let ran = run(&study, &out, Part::ALL, &Silent).expect("done");
    assert_eq!((ran.made, ran.report.missing, ran.report.failed), (3, 0, 0));
    let summary = rows(&out, "summary");
    assert_eq!(summary.len(), 5);
    let unit = &summary[1];
    let channel = &study.channels[0];
    for row in &summary {
        let k = number(row, "target.sphere.radius_m");
        let brighter = number(unit, "brightest_v_mag") - number(row, "brightest_v_mag");
        assert!((brighter - 5.0 * k.log10()).abs() < 1e-9, "{k}: {brighter}");
        let most = format!("{channel}_most_hz");
        let ratio = number(row, &most) / number(unit, &most);
        assert!((ratio / (k * k) - 1.0).abs() < 1e-9, "{k}: {ratio}");
        assert_eq!(number(row, "samples"), 7.0);
    }
    // The samples are those of the summary.
    let samples = rows(&out, "samples");
    assert_eq!(samples.len(), 5 * 7);
    for (task, row) in summary.iter().enumerate() {
        let own = || samples.iter().filter(|s| number(s, "task") == task as f64);
        let least = |name: &str| own().map(|s| number(s, name)).fold(f64::INFINITY, f64::min);
        assert_eq!(least("v_mag"), number(row, "brightest_v_mag"));
        assert_eq!(least("range_m"), number(row, "nearest_m"));
    }
    // 18:47 UTC on 2008-09-21 is 1,222,022,820 s after 1970 (date -u).
    assert_eq!(summary[0]["from_utc"], Field::Long(1_222_022_820_000_000_000));
}

/// Stops after so many tasks.
struct Stops {
    after: u64,
    done: AtomicU64,
}

impl Progress for Stops {
    fn advance(&self, steps: u64) {
        self.done.fetch_add(steps, Ordering::Relaxed);
    }
    fn is_cancelled(&self) -> bool {
        self.done.load(Ordering::Relaxed) >= self.after
    }
}

fn made(study: &Study, out: &Path, threads: usize) -> BTreeMap<PathBuf, Vec<u8>> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    pool.install(|| run(study, out, Part::ALL, &Silent)).expect("done");
    files(out)
}

#[test]
fn one_core_eight_threads_parts_and_stops_give_the_same_bytes() {
    let (dir, path) = folder(SPHERES);
    let study = read(&path).expect("a study");
    let alone = made(&study, &dir.path().join("alone"), 1);
    assert_eq!(alone.len(), 3 + 3 + 2, "{:?}", alone.keys());
    assert_eq!(alone, made(&study, &dir.path().join("eight"), 8));

    // The last part first; then one that is stopped in its middle; then all.
    let parts = dir.path().join("parts");
    let ran = run(&study, &parts, Part { part: 2, of: 2 }, &Silent).expect("done");
    assert_eq!((ran.made, ran.report.missing, ran.manifest), (1, 0, None));
    assert_eq!((ran.report.shards, ran.report.tasks, ran.report.files.len()), (1, 2, 2));
    assert_eq!(ran.report.part.as_deref(), Some("2/2"));
    let stops = Stops { after: 1, done: AtomicU64::new(0) };
    let error = run(&study, &parts, Part::ALL, &stops).expect_err("stopped");
    assert!(matches!(error, StudyError::Cancelled(_)), "{error}");
    // A file that was cut, one of no sense, one of another shard.
    let cut = parts.join("summary/part-000001.parquet");
    std::fs::write(&cut, &alone[Path::new("summary/part-000001.parquet")][..200]).expect("cut");
    assert_eq!(alone, made(&study, &parts, 2));
    std::fs::write(&cut, b"PAR1 no").expect("written");
    std::fs::write(
        parts.join("samples/part-000000.parquet"),
        &alone[Path::new("samples/part-000002.parquet")],
    )
    .expect("written");
    std::fs::remove_file(parts.join("samples/part-000002.parquet")).expect("removed");
    let ran = run(&study, &parts, Part::ALL, &Silent).expect("done");
    assert_eq!((ran.made, ran.found), (3, 0));
    assert_eq!(alone, files(&parts));
    let ran = run(&study, &parts, Part::ALL, &Silent).expect("done");
    assert_eq!((ran.made, ran.found), (0, 3));
    // What a kill leaves of a file that was being written goes with the manifest.
    let left = parts.join("summary/.sunglint-x7Yz.part");
    std::fs::write(&left, b"half").expect("written");
    run(&study, &parts, Part { part: 1, of: 2 }, &Silent).expect("done");
    assert!(left.exists(), "somebody may be writing it");
    run(&study, &parts, Part::ALL, &Silent).expect("done");
    assert!(left.exists(), "another run may be writing it");
    let long_ago = std::time::SystemTime::now() - std::time::Duration::from_secs(7200);
    let file = std::fs::File::options().write(true).open(&left).expect("opened");
    file.set_modified(long_ago).expect("set");
    drop(file);
    run(&study, &parts, Part::ALL, &Silent).expect("done");
    assert_eq!(alone, files(&parts));
}

/// Thousands of tasks begin together: none writes the mark that is there.
#[cfg(unix)]
#[test]
fn the_mark_is_written_once() {
    use std::os::unix::fs::MetadataExt as _;
    let (dir, path) = folder(SPHERES);
    let study = read(&path).expect("a study");
    let out = dir.path().join("out");
    sunglint_study::run::prepare(&study, &out).expect("marked");
    // A file that is replaced is another one.
    let file = || std::fs::metadata(out.join("study.json")).expect("a mark").ino();
    let first = file();
    run(&study, &out, Part { part: 1, of: 2 }, &Silent).expect("done");
    run(&study, &out, Part::ALL, &Silent).expect("done");
    assert_eq!(first, file());
}

/// Waits in the first two tasks until both are under way.
#[derive(Default)]
struct Meets {
    here: std::sync::Mutex<u32>,
    both: std::sync::Condvar,
}

impl Progress for Meets {
    fn advance(&self, _: u64) {
        let mut here = self.here.lock().expect("a number");
        *here += 1;
        self.both.notify_all();
        let patience = std::time::Duration::from_secs(60);
        let met = self.both.wait_timeout_while(here, patience, |here| *here < 2).expect("a number");
        assert!(!met.1.timed_out(), "one shard at a time");
    }
}

/// Shards of one task each are made by all threads. Truth: with one after the other, the first would wait for ever for the second.
#[test]
fn small_shards_are_made_together() {
    let (dir, path) = folder(&SPHERES.replace("tasks_a_shard = 2", "tasks_a_shard = 1"));
    let study = read(&path).expect("a study");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("threads");
    let out = dir.path().join("out");
    let ran = pool.install(|| run(&study, &out, Part::ALL, &Meets::default())).expect("done");
    assert_eq!((ran.made, ran.report.failed), (5, 0));
    assert_eq!(files(&out), made(&study, &dir.path().join("alone"), 1));
}

/// The sources of the physics are in the identity, and it says so of itself; not those of a crate alone.
#[test]
fn the_sources_are_part_of_the_programs_name() {
    let (name, sources) = sunglint_study::PROGRAM.split_once(" (sources ").expect("sources");
    assert_eq!(name, concat!("sunglint ", env!("CARGO_PKG_VERSION")));
    let sources = sources.strip_suffix(')').expect("a bracket");
    assert!(sources.len() == 16 && sources.bytes().all(|b| b.is_ascii_hexdigit()), "{sources}");
}

#[test]
fn a_folder_of_another_study_is_left_alone() {
    let (dir, path) = folder(SPHERES);
    let out = dir.path().join("out");
    let before = made(&read(&path).expect("a study"), &out, 2);
    std::fs::write(&path, SPHERES.replace("0.0625", "0.125")).expect("written");
    let other = read(&path).expect("a study");
    let error = run(&other, &out, Part::ALL, &Silent).expect_err("another study").to_string();
    assert!(error.contains("holds another study"), "{error}");
    assert_eq!(before, files(&out));
    let error = run(&other, &dir.path().join("new"), Part { part: 3, of: 2 }, &Silent);
    assert!(matches!(error, Err(StudyError::NoSuchPart { part: 3, of: 2 })));
}

/// Tasks that fail are rows that say why; the others are there.
#[test]
fn a_task_that_fails_ends_nothing() {
    let (dir, path) = folder(&SPHERES.replace("2.0, 0.0625", "-1.0, 0.0625"));
    let out = dir.path().join("out");
    let ran = run(&read(&path).expect("a study"), &out, Part::ALL, &Silent).expect("done");
    assert_eq!((ran.report.failed, ran.report.missing), (1, 0));
    let summary = rows(&out, "summary");
    let status: Vec<String> = summary.iter().map(|r| r["status"].to_string()).collect();
    assert_eq!(status, ["\"done\"", "\"done\"", "\"failed\"", "\"done\"", "\"done\""]);
    assert!(summary[2]["message"].to_string().contains("radius_m"), "{}", summary[2]["message"]);
}

/// Passes of two objects: as many rows as passes that can be seen, whose highest places and nearest ranges are those of a search with a finer step.
/// Truth: the search alone, whose passes other programs have checked; at 5 s a sample the top of a pass is missed by at most 0.25° and 1 km of range.
#[test]
fn passes_of_objects_are_found_and_simulated() {
    let (dir, path) = folder(
        r#"
[study]
scene = "pass.toml"
[passes]
elements = ["elements.tle"]
from = 2008-09-21T17:00:00Z
to = 2008-09-22T05:00:00Z
step_s = 5.0
min_altitude_deg = 5.0
"#,
    );
    let study = read(&path).expect("a study");
    let out = dir.path().join("out");
    run(&study, &out, Part::ALL, &Silent).expect("done");
    let summary = rows(&out, "summary");
    let passes = study.passes.as_ref().expect("passes");
    let station = study.pass(0).expect("a scene").station;
    let search = sunglint_ephemeris::passes::Search::new(
        &station.site,
        &station.horizon,
        passes.window,
        passes.conditions,
        sunglint_radiometry::sky::EarthOrientation::embedded(),
    )
    .expect("a search");
    let mut expected = 0;
    for object in &passes.objects {
        let orbit: sunglint_ephemeris::orbit::Orbit = object.orbit().expect("an orbit").into();
        for pass in search.passes(&orbit).passes.iter().filter(|p| !p.visible.is_empty()) {
            let row =
                summary.iter().filter(|r| r["norad_id"] == Field::Long(object.norad_id.into()));
            let top = pass
                .visible
                .iter()
                .map(|span| {
                    let at = search.highest(*span, 0.5, |t| {
                        search.look(&orbit, t).expect("a place").horizontal.altitude_deg()
                    });
                    search.look(&orbit, at).expect("a place").horizontal.altitude_deg()
                })
                .fold(f64::NEG_INFINITY, f64::max);
            let near = row
                .filter(|r| r["samples"] != Field::Null)
                .filter(|r| (number(r, "highest_deg") - top).abs() < 0.25)
                .count();
            assert_eq!(near, 1, "{top}");
            expected += 1;
        }
    }
    assert!(expected > 1, "{expected} passes");
    let done = summary.iter().filter(|r| r["status"].to_string() == "\"done\"").count();
    assert_eq!(done, expected);
}

#[test]
fn a_panic_is_an_error_with_its_message() {
    type Work = fn() -> u32;
    let texts: [(Work, &str); 3] = [
        (|| panic!("fixed"), "(fixed)"),
        (|| panic!("number {}", std::hint::black_box(3)), "(number 3)"),
        (|| std::panic::resume_unwind(Box::new(1_u8)), "(without a message)"),
    ];
    for (work, text) in texts {
        let error = sunglint_study::caught(work).expect_err("it panics");
        assert!(error.contains(text), "{error}");
    }
    assert_eq!(sunglint_study::caught(|| 2), Ok(2));
}

/// A part reads the ends of the files alone; the hashes come with the last one. Truth: the hash of the file's bytes, read here.
#[test]
fn files_are_hashed_once_all_are_there() {
    let (dir, path) = folder(SPHERES);
    let study = read(&path).expect("a study");
    let out = dir.path().join("out");
    let first = run(&study, &out, Part { part: 1, of: 2 }, &Silent).expect("done");
    assert!(first.report.missing == 0 && first.manifest.is_none());
    assert!(first.report.files.iter().all(|f| f.sha256.is_none() && f.bytes > 0 && f.rows > 0));
    run(&study, &out, Part { part: 2, of: 2 }, &Silent).expect("done");
    let last = run(&study, &out, Part::ALL, &Silent).expect("done");
    assert_eq!((last.made, last.report.missing), (0, 0));
    for file in &last.report.files {
        let bytes = std::fs::read(out.join(&file.file)).expect("a file");
        assert_eq!(file.sha256.as_deref(), Some(sunglint_formats::sha256(&bytes).as_str()));
        assert_eq!(file.bytes, bytes.len() as u64);
    }
}
