//! Job arrays, with a stand-in for `sbatch` that loses tasks (synthetic); a real Slurm runs in a campaign of the program.

use crate::{folder, read};
use sunglint_numerics::progress::Silent;
use sunglint_study::StudyError;
use sunglint_study::slurm::{Array, part};

#[test]
fn the_script_is_one_that_a_shell_reads_alike() {
    let (_dir, path) = folder("[study]\nname = \"it's\"\nscene = \"pass.toml\"\n");
    let study = read(&path).expect("a study");
    let array = Array {
        submit: "sbatch".into(),
        queue: None,
        command: vec!["/opt/my tools/sunglint".into(), "study".into(), "a'b.toml".into()],
        tasks: 50,
        options: vec!["--partition=long".into()],
    };
    let script = array.script(&study).expect("a script");
    assert_eq!(
        script,
        "#!/bin/sh\n#SBATCH --job-name='it'\\''s'\n#SBATCH --partition=long\n# What is done is left alone: a task may be started again at any time.\nexec '/opt/my tools/sunglint' study 'a'\\''b.toml' --part \"$SLURM_ARRAY_TASK_ID/1\"\n"
    );
    let bad = Array { options: vec!["--a\nrm".into()], ..array };
    assert!(matches!(bad.script(&study), Err(StudyError::Slurm(_))));
}

#[test]
fn parts_are_read() {
    assert_eq!(part("3/50").map(|p| (p.part, p.of)), Ok((3, 50)));
    for bad in ["", "3", "0/5", "6/5", "1/0", "a/b", "-1/5", "1/5/2"] {
        assert!(part(bad).is_err(), "{bad}");
    }
}

#[test]
fn without_slurm_it_is_said() {
    let (dir, path) = folder("[study]\nscene = \"pass.toml\"\n");
    let study = read(&path).expect("a study");
    let array = Array {
        submit: dir.path().join("sbatch"),
        queue: None,
        command: vec!["true".into()],
        tasks: 2,
        options: Vec::new(),
    };
    let error = array.submit(&study, &dir.path().join("out"), &Silent).expect_err("no sbatch");
    assert!(error.to_string().contains("cannot start"), "{error}");
    assert!(dir.path().join("out/study.sbatch").exists());
}

/// A scheduler that loses every task of the first array and one of the second: what is missing is submitted again, and nothing that is there. Where all are
/// lost again and again it is said.
#[test]
fn lost_tasks_are_submitted_again() {
    let (dir, path) = folder(
        "[study]\nscene = \"pass.toml\"\ntasks_a_shard = 1\n[[parameter]]\nkey = \"target.sphere.radius_m\"\nvalues = [1.0, 2.0, 3.0]\n",
    );
    let study = read(&path).expect("a study");
    // The shards, made elsewhere: the stand-in copies the one that a task would make.
    let made = dir.path().join("made");
    sunglint_study::run::run(&study, &made, sunglint_study::run::Part::ALL, &Silent).expect("done");
    let out = dir.path().join("out");
    let script = format!(
        r#"#!/bin/sh
array=$(echo "$2" | sed 's/--array=//')
echo "$array" >> {log}
echo "Submitted batch job 7"
for part in $(echo "$array" | tr , ' '); do
  [ "$(wc -l < {log})" = 1 ] && continue
  [ "$(wc -l < {log}) $part" = "2 2" ] && continue
  cp "{made}/summary/part-00000$((part - 1)).parquet" "{out}/summary/"
done
exit 1
"#,
        log = dir.path().join("log").display(),
        made = made.display(),
        out = out.display(),
    );
    let sbatch = dir.path().join("sbatch");
    std::fs::write(&sbatch, script).expect("written");
    let mode = std::os::unix::fs::PermissionsExt::from_mode(0o755);
    std::fs::set_permissions(&sbatch, mode).expect("executable");
    let array = Array {
        submit: sbatch,
        queue: None,
        command: vec!["true".into()],
        tasks: 50,
        options: Vec::new(),
    };
    array.submit(&study, &out, &Silent).expect("all there");
    let log = std::fs::read_to_string(dir.path().join("log")).expect("a log");
    assert_eq!(log, "1,2,3\n1,2,3\n2\n");

    let loses = dir.path().join("loses");
    std::fs::write(&loses, "#!/bin/sh\necho Submitted batch job 8\n").expect("written");
    std::fs::set_permissions(&loses, std::os::unix::fs::PermissionsExt::from_mode(0o755))
        .expect("executable");
    let array = Array { submit: loses, ..array };
    let error = array.submit(&study, &dir.path().join("none"), &Silent).expect_err("lost");
    assert!(error.to_string().contains("3 of 3 shards are missing"), "{error}");
}

/// An array that goes on behind `sbatch` (synthetic: a stand-in for `squeue` that lists it for a while, then forgets it, and makes the shards): it is waited
/// for by the queue, and no longer than there is something missing.
#[test]
fn an_array_is_waited_for_by_the_queue() {
    let (dir, path) = folder(
        "[study]\nscene = \"pass.toml\"\ntasks_a_shard = 1\n[[parameter]]\nkey = \"target.sphere.radius_m\"\nvalues = [1.0, 2.0]\n",
    );
    let study = read(&path).expect("a study");
    let made = dir.path().join("made");
    sunglint_study::run::run(&study, &made, sunglint_study::run::Part::ALL, &Silent).expect("done");
    let out = dir.path().join("out");
    let executable = |name: &str, text: String| {
        let path = dir.path().join(name);
        std::fs::write(&path, text).expect("written");
        let mode = std::os::unix::fs::PermissionsExt::from_mode(0o755);
        std::fs::set_permissions(&path, mode).expect("executable");
        path
    };
    let log = dir.path().join("log");
    let sbatch = executable(
        "sbatch",
        format!("#!/bin/sh\necho \"$1\" >> {}\necho Submitted batch job 71\n", log.display()),
    );
    // The first array makes the first shard and is gone; the second goes on for ever, and its shard is there at the third look.
    let squeue = executable(
        "squeue",
        format!(
            r#"#!/bin/sh
[ "$3" = 71 ] || exit 9
echo look >> {log}
case $(grep -c look {log}) in
  1) echo 71_1 R ;;
  2) cp {made}/summary/part-000000.parquet {out}/summary/; echo "slurm_load_jobs error: Invalid job id specified" >&2; exit 1 ;;
  3) echo 71_2 R ;;
  *) cp {made}/summary/part-000001.parquet {out}/summary/; echo 71_2 R ;;
esac
"#,
            log = log.display(),
            made = made.display(),
            out = out.display(),
        ),
    );
    let array = Array {
        submit: sbatch,
        queue: Some(squeue),
        command: vec!["true".into()],
        tasks: 50,
        options: Vec::new(),
    };
    array.submit(&study, &out, &Silent).expect("all there");
    let log = std::fs::read_to_string(log).expect("a log");
    assert_eq!(log, "--array=1,2\nlook\nlook\n--array=2\nlook\nlook\n");
    let error = Array { queue: Some(dir.path().join("none")), ..array }
        .submit(&study, &dir.path().join("other"), &Silent)
        .expect_err("no squeue");
    assert!(error.to_string().contains("cannot start"), "{error}");
}
