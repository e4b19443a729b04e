//! Job arrays, with a stand-in for `sbatch` that loses tasks (synthetic); a real Slurm runs in a campaign of the program.

use crate::{folder, read};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;
use sunglint_numerics::progress::{Progress, Silent};
use sunglint_study::StudyError;
use sunglint_study::slurm::{Array, JOB, part};

/// An array of two stand-ins, without grace; a queue that lists nothing where none is given.
fn array(submit: PathBuf, queue: Option<PathBuf>) -> Array {
    Array {
        submit,
        queue: queue.unwrap_or_else(|| "true".into()),
        command: vec!["true".into()],
        threads: None,
        tasks: 50,
        at_once: None,
        grace: Duration::ZERO,
        options: Vec::new(),
    }
}

/// A script that can be called.
fn executable(path: &Path, text: &str) -> PathBuf {
    std::fs::write(path, text).expect("written");
    let mode = std::os::unix::fs::PermissionsExt::from_mode(0o755);
    std::fs::set_permissions(path, mode).expect("executable");
    path.to_path_buf()
}

/// Progress that keeps what it is told, and is stopped at the n-th question.
#[derive(Default)]
struct Heard {
    said: Mutex<Vec<String>>,
    asked: AtomicUsize,
    stop_at: Option<usize>,
}

impl Heard {
    fn said(&self) -> Vec<String> {
        self.said.lock().expect("a list").clone()
    }
}

impl Progress for Heard {
    fn status(&self, text: &str) {
        self.said.lock().expect("a list").push(text.to_owned());
    }

    fn warn(&self, text: &str) {
        self.status(&format!("warning: {text}"));
    }

    fn is_cancelled(&self) -> bool {
        let asked = self.asked.fetch_add(1, Ordering::Relaxed);
        self.stop_at.is_some_and(|at| asked >= at)
    }
}

#[test]
fn the_script_is_one_that_a_shell_reads_alike() {
    let (_dir, path) = folder("[study]\nname = \"it's\"\nscene = \"pass.toml\"\n");
    let study = read(&path).expect("a study");
    let array = Array {
        submit: "sbatch".into(),
        command: vec!["/opt/my tools/sunglint".into(), "study".into(), "a'b.toml".into()],
        options: vec!["--partition=long".into()],
        ..array(PathBuf::new(), None)
    };
    let script = array.script(&study).expect("a script");
    assert_eq!(
        script,
        "#!/bin/sh\n#SBATCH --job-name='it'\\''s'\n#SBATCH --partition=long\n# What is done is left alone: a task may be started again at any time.\nexec '/opt/my tools/sunglint' study 'a'\\''b.toml' --threads \"${SLURM_CPUS_PER_TASK:-1}\" --part \"$SLURM_ARRAY_TASK_ID/1\"\n"
    );
    let four = Array { threads: Some(4), ..array.clone() }.script(&study).expect("a script");
    assert!(four.contains(" --threads 4 --part "), "{four}");
    let refused = |option: &str| {
        let bad = Array { options: vec![option.into()], ..array.clone() };
        match bad.script(&study) {
            Err(StudyError::Slurm(why)) => why,
            other => panic!("{option}: {other:?}"),
        }
    };
    assert!(refused("--a\nrm").contains("line break"));
    // What would be overruled, or would overrule, is refused with the reason.
    for (option, why) in [
        ("--array=1-5", "--slurm-tasks"),
        ("--array 1-5", "--slurm-tasks"),
        ("-a1-5", "--slurm-at-once"),
        ("--output=x.txt", "`log`"),
        ("-o x.txt", "`log`"),
        ("--wait", "itself"),
        ("--test-only", "--slurm-script"),
    ] {
        assert!(refused(option).contains(why), "{option}");
    }
    let near = Array { options: vec!["--wait-all-nodes=1".into(), "--account=a".into()], ..array };
    assert!(near.script(&study).is_ok());
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
    let array = array(dir.path().join("sbatch"), None);
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
for part in $(echo "$array" | sed 's/1-3/1 2 3/'); do
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
    let array = array(executable(&dir.path().join("sbatch"), &script), None);
    array.submit(&study, &out, &Silent).expect("all there");
    let log = std::fs::read_to_string(dir.path().join("log")).expect("a log");
    assert_eq!(log, "1-3\n1-3\n2\n");

    let loses = "#!/bin/sh\necho Submitted batch job 8\n";
    let array = Array { submit: executable(&dir.path().join("loses"), loses), ..array };
    let error = array.submit(&study, &dir.path().join("none"), &Silent).expect_err("lost");
    assert!(error.to_string().contains("3 of 3 shards are missing after 2 arrays"), "{error}");
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
    let log = dir.path().join("log");
    let sbatch = executable(
        &dir.path().join("sbatch"),
        &format!("#!/bin/sh\necho \"$2\" >> {}\necho 71\n", log.display()),
    );
    // The first array makes the first shard and is gone; the second goes on for ever, and its shard is there at the third look.
    let squeue = executable(
        &dir.path().join("squeue"),
        &format!(
            r#"#!/bin/sh
[ "$3" = --me ] && exit
[ "$4" = 71 ] || exit 9
echo look >> {log}
case $(grep -c look {log}) in
  1) echo "PENDING Priority"; echo "RUNNING None" ;;
  2) cp {made}/summary/part-000000.parquet {out}/summary/; echo "slurm_load_jobs error: Invalid job id specified" >&2; exit 1 ;;
  3) echo "RUNNING None" ;;
  *) cp {made}/summary/part-000001.parquet {out}/summary/; echo "RUNNING None" ;;
esac
"#,
            log = log.display(),
            made = made.display(),
            out = out.display(),
        ),
    );
    let array = array(sbatch, Some(squeue));
    let heard = Heard::default();
    array.submit(&study, &out, &heard).expect("all there");
    let said = heard.said();
    assert!(said.contains(&"array 1: 2 parts, PENDING (Priority), RUNNING".to_owned()), "{said:?}");
    assert!(!out.join(JOB).exists(), "nobody waits for it any more");
    let log = std::fs::read_to_string(log).expect("a log");
    assert_eq!(log, "--array=1-2\nlook\nlook\n--array=2\nlook\nlook\n");
    let error = Array { queue: dir.path().join("none"), ..array }
        .submit(&study, &dir.path().join("other"), &Silent)
        .expect_err("no squeue");
    assert!(error.to_string().contains("cannot start"), "{error}");
}

/// One shard, made elsewhere, and the command that puts it in its place.
fn one_shard() -> (tempfile::TempDir, sunglint_study::Study, PathBuf, String) {
    let (dir, path) = folder("[study]\nscene = \"pass.toml\"\n");
    let study = read(&path).expect("a study");
    let made = dir.path().join("made");
    sunglint_study::run::run(&study, &made, sunglint_study::run::Part::ALL, &Silent).expect("done");
    let out = dir.path().join("50%done");
    let copy =
        format!("cp {}/summary/part-000000.parquet {}/summary/", made.display(), out.display());
    (dir, study, out, copy)
}

/// A controller that is away for a moment (synthetic; the texts are Slurm's own): what is refused for now is asked again, an unknown partition is not, and an
/// answer that did not come is not either, as the array may be there.
#[test]
fn a_controller_that_is_away_is_asked_again() {
    let (dir, study, out, copy) = one_shard();
    let log = dir.path().join("log");
    let away = |error: &str, name: &str| {
        executable(
            &dir.path().join(name),
            &format!(
                r#"#!/bin/sh
echo "$@" >> {log}
if [ "$(wc -l < {log})" -lt 3 ]; then echo "sbatch: error: Batch job submission failed: {error}" >&2; exit 1; fi
{copy}
echo Submitted batch job 9
"#,
                log = log.display()
            ),
        )
    };
    for (error, asked, word) in [
        ("Invalid partition name specified", 1, "sbatch refused: "),
        ("Socket timed out on send/recv operation", 1, "may have been submitted all the same"),
        ("Unable to contact slurm controller (connect failure)", 3, ""),
        ("Resource temporarily unavailable", 3, ""),
    ] {
        let _ = std::fs::remove_file(&log);
        let _ = std::fs::remove_dir_all(&out);
        let done = array(away(error, "sbatch"), None).submit(&study, &out, &Silent);
        let told = std::fs::read_to_string(&log).expect("a log");
        assert_eq!(told.lines().count(), asked, "{error}");
        // Slurm makes one percent sign of two.
        assert!(told.contains("50%%done/log/%A_%a.txt"), "{told}");
        match done {
            Ok(()) => assert!(word.is_empty(), "{error}"),
            Err(why) => assert!(!word.is_empty() && why.to_string().contains(word), "{why}"),
        }
    }
}

/// A job on another cluster, and a person's own filters of `squeue` (synthetic): the queue is asked with that cluster and without these.
#[test]
fn a_job_on_another_cluster_is_waited_for_there() {
    let (dir, study, out, copy) = one_shard();
    let log = dir.path().join("log");
    let sbatch = executable(&dir.path().join("sbatch"), "#!/bin/sh\necho '7;far'\n");
    let squeue = executable(
        &dir.path().join("squeue"),
        &format!(
            "#!/bin/sh\necho \"$*;$(env | grep -c ^SQUEUE_)\" >> {}\n[ \"$3\" = --me ] && exit\necho CLUSTER: far\n[ -e {}/summary/part-000000.parquet ] || echo RUNNING None\n{copy}\n",
            log.display(),
            out.display()
        ),
    );
    // Another process than this one: its environment is not that of the tests beside this one.
    let asked = array(sbatch, Some(squeue));
    let asked = Array { options: vec!["--clusters=near,far".into()], ..asked };
    asked.submit(&study, &out, &Silent).expect("all there");
    let log = std::fs::read_to_string(&log).expect("a log");
    assert_eq!(
        log,
        "--noheader --all --me --format %F %k --clusters near,far;0\n--noheader --all --jobs 7 --format %T %r --clusters far;0\n"
    );
}

/// Ctrl-C while `squeue` fails ends the waiting and keeps the job's number; the next call waits for that job, and submits no other (synthetic).
#[test]
fn a_job_is_gone_on_with_after_ctrl_c() {
    let (dir, study, out, copy) = one_shard();
    let log = dir.path().join("log");
    let sbatch = executable(
        &dir.path().join("sbatch"),
        &format!("#!/bin/sh\necho submitted >> {}\necho Submitted batch job 12\n", log.display()),
    );
    let fails = executable(
        &dir.path().join("fails"),
        "#!/bin/sh\n[ \"$3\" = --me ] && exit\necho busy >&2\nexit 1\n",
    );
    let stopped = Heard { stop_at: Some(3), ..Heard::default() };
    let error = array(sbatch.clone(), Some(fails)).submit(&study, &out, &stopped);
    assert!(matches!(error, Err(StudyError::Cancelled(_))), "{error:?}");
    let said = stopped.said().join("\n");
    assert!(said.contains("warning: job 12 goes on in Slurm; `scancel 12` ends it"), "{said}");
    assert_eq!(std::fs::read_to_string(out.join(JOB)).expect("a number"), "12\n");

    let squeue = executable(
        &dir.path().join("squeue"),
        &format!("#!/bin/sh\n[ \"$4\" = 12 ] || exit 9\n{copy}\necho RUNNING None\n"),
    );
    array(sbatch.clone(), Some(squeue)).submit(&study, &out, &Silent).expect("all there");
    assert_eq!(std::fs::read_to_string(&log).expect("a log"), "submitted\n");
    assert!(!out.join(JOB).exists());
}

/// `sbatch` that ends well and says no number (synthetic: as with `--quiet`), or is ended by a signal on its way: the array is found in the queue by its comment,
/// and no other is submitted. One that nobody knows of is not submitted again, either. It is in a group of its own, which Ctrl-C on the terminal does not reach.
#[test]
fn an_array_without_a_number_is_found_by_its_comment() {
    let (dir, study, out, copy) = one_shard();
    let (log, comment) = (dir.path().join("log"), dir.path().join("comment"));
    let sbatch = executable(
        &dir.path().join("sbatch"),
        &format!(
            "#!/bin/sh\nread -r _ _ _ _ group _ < /proc/$$/stat\n[ \"$group\" = $$ ] && echo own >> {}\necho \"$4\" | sed s/--comment=// > {}\n",
            log.display(),
            comment.display()
        ),
    );
    let queue = |name: &str, shown: &str| {
        executable(
            &dir.path().join(name),
            &format!(
                "#!/bin/sh\nif [ \"$3\" = --me ]; then {shown}; exit 0; fi\n[ \"$4\" = 44 ] || exit 9\n{copy}\necho RUNNING None\n"
            ),
        )
    };
    let told =
        format!("echo 43 of another; [ -e {0} ] && echo \"44 $(cat {0})\"", comment.display());
    let options = vec!["--comment=\"paid by us\"".to_owned()];
    let found = Array { options, ..array(sbatch.clone(), Some(queue("squeue", &told))) };
    found.submit(&study, &out, &Silent).expect("all there");
    assert_eq!(std::fs::read_to_string(&log).expect("a log"), "own\n");
    let text = std::fs::read_to_string(&comment).expect("a comment");
    assert!(text.starts_with("sunglint:") && text.ends_with(" paid by us\n"), "{text}");

    // Submitted by somebody whose program ended: no file tells its number.
    std::fs::remove_file(out.join("summary/part-000000.parquet")).expect("removed");
    assert!(!out.join(JOB).exists());
    found.submit(&study, &out, &Silent).expect("all there");
    assert_eq!(std::fs::read_to_string(&log).expect("a log"), "own\n");

    // The array of another folder is another one, and one that is not listed may be there.
    let other = dir.path().join("other");
    let nobody = array(sbatch, Some(queue("nobody", &format!("echo \"44 {}\"", text.trim()))));
    let error = nobody.submit(&study, &other, &Silent).expect_err("not known").to_string();
    assert!(error.contains("may have been submitted all the same"), "{error}");
    assert_eq!(std::fs::read_to_string(&log).expect("a log"), "own\nown\n");
}

/// Tasks that a person must let go (synthetic): told once for each reason, with what to do; other reasons are not.
#[test]
fn tasks_that_wait_for_ever_are_told_once() {
    let (dir, study, out, copy) = one_shard();
    let (log, sbatch) = (dir.path().join("log"), dir.path().join("sbatch"));
    let sbatch = executable(&sbatch, "#!/bin/sh\necho 6\n");
    let squeue = executable(
        &dir.path().join("squeue"),
        &format!(
            r#"#!/bin/sh
[ "$3" = --me ] && exit
echo look >> {log}
echo "PENDING Priority"
echo "PENDING JobHeldUser"
echo "PENDING launch_failed_requeued_held"
[ "$(wc -l < {log})" -lt 3 ] || {copy}
"#,
            log = log.display()
        ),
    );
    let heard = Heard::default();
    array(sbatch, Some(squeue)).submit(&study, &out, &heard).expect("all there");
    let said = heard.said();
    let warned: Vec<&String> = said.iter().filter(|text| text.starts_with("warning")).collect();
    assert_eq!(warned.len(), 2, "{said:?}");
    for (reason, what) in
        [("JobHeldUser", "scontrol release"), ("launch_failed_requeued_held", "tries again")]
    {
        assert!(
            warned
                .iter()
                .any(|w| w.contains(reason) && w.contains(what) && w.contains("scancel 6")),
            "{warned:?}"
        );
    }
}

/// Slurm's own text for an array beyond its MaxArraySize: told with the number and what to do. Tasks at a time are Slurm's `%`.
#[test]
fn an_array_that_is_too_large_is_told_with_what_to_do() {
    let (dir, path) = folder(
        "[study]\nscene = \"pass.toml\"\ntasks_a_shard = 1\n[[parameter]]\nkey = \"target.sphere.radius_m\"\nvalues = [1.0, 2.0]\n",
    );
    let study = read(&path).expect("a study");
    let log = dir.path().join("log");
    let sbatch = executable(
        &dir.path().join("sbatch"),
        &format!(
            "#!/bin/sh\necho \"$2\" >> {}\necho 'sbatch: error: Batch job submission failed: Invalid job array specification' >&2\nexit 1\n",
            log.display()
        ),
    );
    let array = Array { at_once: Some(1), ..array(sbatch, None) };
    let error = array.submit(&study, &dir.path().join("out"), &Silent).expect_err("refused");
    let error = error.to_string();
    for part in ["largest number is 2", "MaxArraySize", "--slurm-tasks"] {
        assert!(error.contains(part), "{error}");
    }
    assert_eq!(std::fs::read_to_string(&log).expect("a log"), "--array=1-2%1\n");
}

/// A cluster that loses all but one task of each array (synthetic): as long as arrays make shards, others follow.
#[test]
fn arrays_go_on_as_long_as_they_make_something() {
    let (dir, path) = folder(
        "[study]\nscene = \"pass.toml\"\ntasks_a_shard = 1\n[[parameter]]\nkey = \"target.sphere.radius_m\"\nvalues = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]\n",
    );
    let study = read(&path).expect("a study");
    let made = dir.path().join("made");
    sunglint_study::run::run(&study, &made, sunglint_study::run::Part::ALL, &Silent).expect("done");
    let (out, log) = (dir.path().join("out"), dir.path().join("log"));
    let script = format!(
        r#"#!/bin/sh
echo "$2" >> {log}
first=$(echo "$2" | sed 's/--array=//; s/[-,].*//')
cp "{made}/summary/part-00000$((first - 1)).parquet" "{out}/summary/"
echo 5
"#,
        log = log.display(),
        made = made.display(),
        out = out.display(),
    );
    let array = array(executable(&dir.path().join("sbatch"), &script), None);
    array.submit(&study, &out, &Silent).expect("all there");
    assert_eq!(std::fs::read_to_string(&log).expect("a log").lines().count(), 7);
}
