//! `sunglint study`: the page's commands, parts, kills, refusals. Numbers are tested in the crate `study`.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::{Folder, page_toml};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Elements of the scene's object (the example of Spacetrack Report 3).
const ELEMENTS: &str = "ISS
1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927
2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537
";

/// Folder with the files of docs/study.md.
fn guide(name: &str) -> Folder {
    let folder = Folder::new(name);
    let grey = crate::common::SPHERE_PASS.replace("material = \"white\"", "reflectance = 0.3");
    std::fs::write(folder.path("sphere.toml"), grey).unwrap();
    std::fs::write(folder.path("catalogue.tle"), ELEMENTS).unwrap();
    std::fs::write(folder.path("spheres.toml"), page_toml("study.md", "design = \"sobol\""))
        .unwrap();
    std::fs::write(folder.path("night.toml"), page_toml("study.md", "[passes]")).unwrap();
    folder
}

fn tables(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut found = Vec::new();
    for table in ["summary", "samples"] {
        let Ok(entries) = std::fs::read_dir(folder.join(table)) else { continue };
        for entry in entries {
            let path = entry.unwrap().path();
            // What a kill left of a file that was being written has a hidden name, which no reader of a table's folder takes.
            if path.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b".")) {
                continue;
            }
            let name = Path::new(table).join(path.file_name().unwrap());
            found.push((name, std::fs::read(path).unwrap()));
        }
    }
    found.sort();
    found
}

#[test]
fn the_commands_of_the_page_run() {
    let folder = guide("study-page");
    let page = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/study.md");
    let page = std::fs::read_to_string(page).unwrap();
    let mut ran = 0;
    for command in page.lines().filter_map(|l| l.strip_prefix("sunglint ")) {
        folder.done(&command.split(' ').collect::<Vec<_>>());
        ran += 1;
    }
    assert_eq!(ran, 5);
    let manifest = std::fs::read_to_string(folder.path("spheres/manifest.json")).unwrap();
    let manifest: serde_json::Value = serde_json::from_str(&manifest).unwrap();
    assert_eq!(
        (&manifest["tasks"], &manifest["missing"], &manifest["failed"]),
        (&64.into(), &0.into(), &0.into())
    );
    assert_eq!(tables(&folder.path("night")), tables(&folder.path("parts")));
    assert!(!tables(&folder.path("night")).is_empty());
}

/// A run that is killed at any moment loses nothing that it had made, and the next gives the bytes of one that was left alone.
#[cfg(unix)]
#[test]
fn killed_runs_are_gone_on_with() {
    let folder = guide("study-kill");
    folder.done(&["study", "spheres.toml", "-o", "alone", "--threads", "1"]);
    for wait_ms in [30, 90, 150, 250, 400] {
        let mut child = Command::new(env!("CARGO_BIN_EXE_sunglint"))
            .args(["study", "spheres.toml", "-o", "killed"])
            .current_dir(&folder.0)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(std::time::Duration::from_millis(wait_ms));
        child.kill().unwrap();
        child.wait().unwrap();
    }
    folder.done(&["study", "spheres.toml", "-o", "killed"]);
    let (alone, killed) = (tables(&folder.path("alone")), tables(&folder.path("killed")));
    let names = |tables: &[(PathBuf, Vec<u8>)]| -> Vec<PathBuf> {
        tables.iter().map(|(name, _)| name.clone()).collect()
    };
    assert_eq!(names(&alone), names(&killed));
    for ((name, one), (_, other)) in alone.iter().zip(&killed) {
        assert!(one == other, "{} differs", name.display());
    }
    // What kills left of files that were being written goes once it is an hour old: younger ones may be another run's.
    let summary = folder.path("killed/summary");
    let parts = || -> Vec<PathBuf> {
        let all = std::fs::read_dir(&summary).unwrap().map(|e| e.unwrap().path());
        all.filter(|p| p.file_name().unwrap().as_encoded_bytes().starts_with(b".")).collect()
    };
    std::fs::write(summary.join(".sunglint-left.part"), "half").unwrap();
    let long_ago = std::time::SystemTime::now() - std::time::Duration::from_secs(7200);
    for part in parts() {
        let part = std::fs::File::options().write(true).open(part).unwrap();
        part.set_modified(long_ago).unwrap();
    }
    let young = summary.join(".sunglint-young.part");
    std::fs::write(&young, "half").unwrap();
    folder.done(&["study", "spheres.toml", "-o", "killed"]);
    assert_eq!(parts(), [young]);
}

#[test]
fn the_batch_script_names_what_every_node_finds() {
    let folder = guide("study-slurm");
    let told = folder.done(&[
        "study",
        "spheres.toml",
        "-o",
        "out",
        "--slurm-script",
        "--slurm-tasks",
        "7",
        "--slurm-option",
        "--mem=2G",
    ]);
    assert!(told.contains("--array=1-7"), "{told}");
    let script = std::fs::read_to_string(folder.path("out/study.sbatch")).unwrap();
    assert!(script.contains("#SBATCH --mem=2G\n"), "{script}");
    assert!(script.contains(" --threads \"${SLURM_CPUS_PER_TASK:-1}\" --part "), "{script}");
    let root = std::fs::canonicalize(&folder.0).unwrap();
    assert!(script.contains(&format!("{}/spheres.toml", root.display())), "{script}");
    // It is a script: a shell that plays the array makes the study.
    for task in 1..=7 {
        let run = Command::new("sh")
            .arg(folder.path("out/study.sbatch"))
            .env("SLURM_ARRAY_TASK_ID", task.to_string())
            .output()
            .unwrap();
        assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    }
    // Parts look at their own files alone: the manifest is the last run's.
    assert!(!folder.path("out/manifest.json").exists());
    let told = folder.done(&["study", "spheres.toml", "-o", "out"]);
    assert!(told.contains("0 shards made"), "{told}");
    assert!(folder.path("out/manifest.json").exists());
}

/// `--slurm` with stand-ins for Slurm's programs (synthetic): `sbatch` plays the whole array, `squeue` lists nothing and keeps what it was asked, and with which
/// filters of the person's.
#[cfg(unix)]
#[test]
fn an_array_of_slurm_makes_the_study() {
    use std::os::unix::fs::PermissionsExt as _;
    let folder = guide("study-array");
    let tools = folder.path("tools");
    std::fs::create_dir_all(&tools).unwrap();
    let tool = |name: &str, text: String| {
        std::fs::write(tools.join(name), text).unwrap();
        let mode = std::fs::Permissions::from_mode(0o755);
        std::fs::set_permissions(tools.join(name), mode).unwrap();
    };
    let log = folder.path("log");
    tool(
        "sbatch",
        format!(
            "#!/bin/sh\necho \"$1 $2\" >> {}\nfor k in 1 2 3; do SLURM_ARRAY_TASK_ID=$k sh \"$5\" >&2; done\necho 5\n",
            log.display()
        ),
    );
    tool("squeue", format!("#!/bin/sh\necho \"$*;$SQUEUE_STATES;\" >> {}\n", log.display()));
    let path = format!("{}:{}", tools.display(), std::env::var("PATH").unwrap());
    let output = Command::new(env!("CARGO_BIN_EXE_sunglint"))
        .args(["study", "spheres.toml", "-o", "out", "--slurm", "--slurm-tasks", "3"])
        .args(["--threads", "2"])
        .current_dir(&folder.0)
        .env("PATH", path)
        .env("SQUEUE_STATES", "FAILED")
        .env("SUNGLINT_STATION", "ufo")
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    let log = std::fs::read_to_string(log).unwrap();
    let (looked, log) = log.split_once('\n').unwrap();
    assert_eq!(looked, "--noheader --all --me --format %F %k;;");
    assert_eq!(log, "--parsable --array=1-3\n--noheader --all --jobs 5 --format %T %r;;\n");
    let script = std::fs::read_to_string(folder.path("out/study.sbatch")).unwrap();
    assert!(script.contains(" --threads 2 --part "), "{script}");
    // The tasks' shells need not know what this one's says.
    assert!(script.contains("\nexec env SUNGLINT_STATION=ufo /"), "{script}");
    assert!(folder.path("out/manifest.json").exists() && !folder.path("out/study.job").exists());
}

#[test]
fn mistakes_are_refused() {
    let folder = guide("study-refused");
    for part in ["0/3", "4/3", "x", "1"] {
        let error = folder.refused(2, &["study", "spheres.toml", "--part", part]);
        assert!(error.contains("--part"), "{error}");
    }
    folder.refused(2, &["study", "spheres.toml", "--part", "1/2", "--slurm"]);
    let error = folder.refused(1, &["study", "missing.toml"]);
    assert!(error.contains("missing.toml"), "{error}");
    folder.done(&["study", "spheres.toml", "-o", "out", "--part", "1/8"]);
    let text = std::fs::read_to_string(folder.path("spheres.toml")).unwrap();
    std::fs::write(folder.path("spheres.toml"), text.replace("seed = 1", "seed = 2")).unwrap();
    let error = folder.refused(1, &["study", "spheres.toml", "-o", "out"]);
    assert!(error.contains("holds another study"), "{error}");
}
