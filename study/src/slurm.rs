//! The shards of a study as a job array of Slurm.
//!
//! A task of Slurm costs about a second before it begins, so that each takes many shards: as many tasks as are asked for, each an even part. Slurm does not
//! start a batch script again that was killed; so missing shards are looked for when an array has ended, and an array of just those parts follows.
//!
//! The job's number is kept in the study's folder, and the job's comment names study and folder: who starts the command again waits for the array that is
//! there. Slurm's texts are those of its sources (`sbatch.c`, `squeue.c`, `slurm_errno.c`, `slurm_protocol_defs.c` of 23.11).

use crate::run::{Part, missing, missing_of, prepare, refresh};
use crate::{Study, StudyError};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::{Duration, Instant};
use sunglint_formats::atomic::{Overwrite, write_file};
use sunglint_formats::sha256;
use sunglint_numerics::progress::{Cancelled, Progress};

/// Tasks of an array unless another number is asked for.
pub const TASKS: usize = 50;
/// Arrays one after the other that make no shard, before the rest is given up. Arrays that make some may be as many as it takes.
const IDLE: usize = 2;
/// First pause between two looks at the queue, and the longest.
const SOONEST: Duration = Duration::from_millis(500);
const LATEST: Duration = Duration::from_secs(10);
/// Pause between two looks for Ctrl-C.
const BLINK: Duration = Duration::from_millis(50);
/// Times that a controller that does not answer is asked.
const ASKED: usize = 30;
/// Looks at the queue for an array of which `sbatch` did not say whether it is there.
const LOOKED: usize = 5;
/// The longest pause between two looks, as a share of the time since the array was submitted.
const PAUSE_SHARE: u32 = 50;
/// Time that a network's file system may take to show what other nodes wrote: NFS keeps a folder's names for up to a minute (`acdirmax`).
pub const GRACE: Duration = Duration::from_secs(65);
/// Name of the batch script in the study's folder.
pub const SCRIPT: &str = "study.sbatch";
/// Name of the file with the number of the job that was submitted last, and its cluster where Slurm names one.
pub const JOB: &str = "study.job";

/// How the array is submitted.
#[derive(Debug, Clone)]
pub struct Array {
    /// Program that submits: `sbatch`, or a way to it.
    pub submit: PathBuf,
    /// Program that lists waiting and running jobs: `squeue`.
    pub queue: PathBuf,
    /// Command that makes a part: the program and its arguments up to `--part`.
    pub command: Vec<String>,
    /// Threads of a task, as `--threads`; as many as Slurm gives the task unless given.
    pub threads: Option<u16>,
    /// Tasks of the array at most.
    pub tasks: usize,
    /// Tasks of the array that run at the same time, at most.
    pub at_once: Option<usize>,
    /// Pause before shards of an array that has ended count as missing: [`GRACE`].
    pub grace: Duration,
    /// Options of `sbatch`, each a line of the script: `--partition=long`.
    pub options: Vec<String>,
}

/// Options of `sbatch` that the study gives itself, or that would keep it from waiting: long and short name, and why they are refused.
const OWN_OPTIONS: [(&str, &str, &str); 4] = [
    (
        "--array",
        "-a",
        "the study numbers the array's tasks itself; --slurm-tasks says how many there are, --slurm-at-once how many run at a time",
    ),
    ("--output", "-o", "the study keeps its tasks' output in the folder `log` of its results"),
    ("--wait", "-W", "the study waits for the array itself"),
    ("--test-only", "\0", "it submits nothing; --slurm-script writes the script alone"),
];

/// Value of an option of `sbatch` out of its line, where the line is this option: `--time=5`, `--time 5`, `-t5`, `-t 5`.
fn value<'o>(option: &'o str, long: &str, short: &str) -> Option<&'o str> {
    if let Some(rest) = option.strip_prefix(long) {
        return (rest.is_empty() || rest.starts_with(['=', ' ', '\t']))
            .then(|| rest[rest.len().min(1)..].trim());
    }
    option.strip_prefix(short).map(|rest| rest.trim_start_matches('=').trim())
}

/// Quotes an argument for `sh`.
fn quoted(argument: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./=:,+@%".contains(c);
    match !argument.is_empty() && argument.chars().all(plain) {
        true => argument.to_owned(),
        false => format!("'{}'", argument.replace('\'', r"'\''")),
    }
}

impl Array {
    /// Number of parts of a study.
    pub fn parts(&self, study: &Study) -> usize {
        self.tasks.clamp(1, study.shards().max(1))
    }

    /// Text of the batch script: one task of the array makes one part. It is the same for every try; which parts run is an option of `sbatch`.
    ///
    /// # Errors
    /// An option with a line break, which would be a line of its own; one that the study gives itself.
    pub fn script(&self, study: &Study) -> Result<String, StudyError> {
        let mut text = String::from("#!/bin/sh\n");
        let name: String = study.name.chars().filter(|c| !c.is_control()).collect();
        text.push_str(&format!("#SBATCH --job-name={}\n", quoted(&name)));
        for option in &self.options {
            if option.contains(['\n', '\r']) {
                return Err(StudyError::Slurm(format!("the option {option:?} has a line break")));
            }
            for (long, short, why) in OWN_OPTIONS {
                if value(option.trim(), long, short).is_some() {
                    return Err(StudyError::Slurm(format!(
                        "the option `{option}` is not taken: {why}"
                    )));
                }
            }
            text.push_str(&format!("#SBATCH {option}\n"));
        }
        let command: Vec<String> = self.command.iter().map(|a| quoted(a)).collect();
        text.push_str("# What is done is left alone: a task may be started again at any time.\n");
        // Slurm need not keep a task from cores that are not its own: it says how many are, where more than one was asked for.
        let threads = match self.threads {
            Some(threads) => threads.to_string(),
            None => "\"${SLURM_CPUS_PER_TASK:-1}\"".to_owned(),
        };
        text.push_str(&format!(
            "exec {} --threads {threads} --part \"$SLURM_ARRAY_TASK_ID/{}\"\n",
            command.join(" "),
            self.parts(study)
        ));
        Ok(text)
    }

    /// Writes the script into the study's folder.
    ///
    /// # Errors
    /// [`StudyError`]: the folder holds another study, or cannot be written.
    pub fn write(&self, study: &Study, folder: &Path) -> Result<PathBuf, StudyError> {
        prepare(study, folder)?;
        let path = folder.join(SCRIPT);
        write_file(&path, self.script(study)?.as_bytes(), Overwrite::Allow)?;
        Ok(path)
    }

    /// Submits arrays of the parts with missing shards until there are none, and waits for them. An array of this study that Slurm still lists is waited for
    /// first, whoever submitted it.
    ///
    /// # Errors
    /// [`StudyError::Slurm`]: `sbatch` is not there or refuses; nobody knows whether it submitted the array; two arrays one after the other made no shard.
    pub fn submit(
        &self,
        study: &Study,
        folder: &Path,
        progress: &dyn Progress,
    ) -> Result<(), StudyError> {
        let script = self.write(study, folder)?;
        let logs = folder.join("log");
        std::fs::create_dir_all(&logs)
            .map_err(|e| sunglint_formats::FileError::io("create", &logs, e))?;
        let kept = folder.join(JOB);
        let parts = self.parts(study);
        let mut shards =
            Shards { study, folder, left: missing(study, folder), warned: BTreeSet::new() };
        progress.begin("shards", Some(shards.left.len() as u64));
        let mark = mark(study, folder)?;
        let mut known = Job::read(&kept);
        let (mut idle, mut arrays) = (0, 0);
        while !shards.left.is_empty() && idle < IDLE {
            if progress.is_cancelled() {
                return Err(Cancelled.into());
            }
            let before = shards.left.len();
            // Two arrays would make the same shards: one that is there comes first.
            let there = match known.take() {
                Some(job) => Some(job),
                None => self.find(&mark, progress)?,
            };
            if let Some(job) = there {
                self.wait(&job, &format!("job {} of before", job.id), &mut shards, progress)?;
                continue;
            }
            arrays += 1;
            let wanted: BTreeSet<usize> = shards.left.iter().map(|s| s % parts + 1).collect();
            let stage = format!("array {arrays}: {} parts", wanted.len());
            progress.status(&stage);
            let job = self.array(&script, &logs, &mark, &wanted, progress)?;
            if let Err(error) = job.write(&kept) {
                progress.warn(&format!("{error}: a new start will not know of job {}", job.id));
            }
            self.wait(&job, &stage, &mut shards, progress)?;
            idle = if shards.left.len() == before { idle + 1 } else { 0 };
        }
        match shards.left.len() {
            0 => {
                // A number that nobody waits for any more; Slurm gives it to another job in the end.
                let _ = std::fs::remove_file(&kept);
                Ok(())
            }
            count => Err(StudyError::Slurm(format!(
                "{count} of {} shards are missing after {arrays} arrays, the last {IDLE} of which made none; the tasks' output is in {}",
                study.shards(),
                logs.display()
            ))),
        }
    }

    /// Waits until no shard is missing, or until Slurm no longer lists the job.
    fn wait(
        &self,
        job: &Job,
        stage: &str,
        shards: &mut Shards<'_>,
        progress: &dyn Progress,
    ) -> Result<(), StudyError> {
        let begun = Instant::now();
        loop {
            let state = job.state(&self.queue, progress)?;
            shards.look(progress);
            if shards.left.is_empty() {
                return Ok(());
            }
            let Some(state) = state else { return self.settle(shards, progress) };
            progress.status(&format!("{stage}, {}", state.text));
            for reason in state.reasons {
                let Some(hint) = stuck(&reason) else { continue };
                if shards.warned.insert(reason.clone()) {
                    let (id, cluster) = (&job.id, job.clusters());
                    progress.warn(&format!(
                        "tasks of job {id} wait, and may wait for ever: {reason}; {hint}; `scancel{cluster} {id}` ends the job"
                    ));
                }
            }
            // Looked for more and more seldom: an array takes seconds or days.
            job.pause((begun.elapsed() / PAUSE_SHARE).clamp(SOONEST, LATEST), progress)?;
        }
    }

    /// Gives the file system some time to show the last shards of an array that has ended.
    fn settle(&self, shards: &mut Shards<'_>, progress: &dyn Progress) -> Result<(), StudyError> {
        let until = Instant::now() + self.grace;
        loop {
            shards.look(progress);
            let now = Instant::now();
            if shards.left.is_empty() || now >= until {
                return Ok(());
            }
            pause(SOONEST.min(until - now), progress)?;
        }
    }

    /// Looks for an array of this study and folder that Slurm still lists.
    fn find(&self, mark: &str, progress: &dyn Progress) -> Result<Option<Job>, StudyError> {
        let mut arguments = vec!["--noheader", "--all", "--me", "--format", "%F %k"];
        if let Some(clusters) = self.given("--clusters", "-M") {
            arguments.extend(["--clusters", clusters]);
        }
        let text = ask(
            &self.queue,
            &arguments,
            "of this person's jobs",
            &|time| pause(time, progress).map_err(Into::into),
            progress,
        )?;
        Ok(text.as_deref().and_then(|text| marked(text, mark)))
    }

    /// Value of an option that was given for `sbatch`.
    fn given(&self, long: &str, short: &str) -> Option<&str> {
        self.options.iter().find_map(|option| value(option.trim(), long, short))
    }

    /// Calls `sbatch`.
    fn call(
        &self,
        script: &Path,
        logs: &Path,
        mark: &str,
        parts: &BTreeSet<usize>,
    ) -> Result<Output, StudyError> {
        // Slurm takes `%` in a name for the begin of a pattern.
        let logs = logs.display().to_string().replace('%', "%%");
        let at_once = self.at_once.map_or(String::new(), |n| format!("%{n}"));
        // The person's own comment is kept: some sites count by it.
        let comment = match self.given("--comment", "\0") {
            Some(own) => format!("{mark} {}", own.trim_matches(['"', '\''])),
            None => mark.to_owned(),
        };
        let mut command = Command::new(&self.submit);
        command
            .arg("--parsable")
            .arg(format!("--array={}{at_once}", ranges(parts)))
            .arg(format!("--output={logs}/%A_%a.txt"))
            .arg(format!("--comment={comment}"))
            .arg(script);
        // A group of its own: Ctrl-C on the terminal goes to all of this program's group, and would end it after the controller has taken the job and before its
        // number is known.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        command.output().map_err(|e| {
            StudyError::Slurm(format!(
                "cannot start {}: {e}; --slurm-script writes the script alone",
                self.submit.display()
            ))
        })
    }

    /// Submits an array; its job. A controller that does not answer is asked again, unless it may have taken the job.
    fn array(
        &self,
        script: &Path,
        logs: &Path,
        mark: &str,
        parts: &BTreeSet<usize>,
        progress: &dyn Progress,
    ) -> Result<Job, StudyError> {
        let mut why = String::new();
        let mut wait = SOONEST;
        for _ in 0..ASKED {
            let output = self.call(script, logs, mark, parts)?;
            if let Some(job) = Job::submitted(&String::from_utf8_lossy(&output.stdout)) {
                return Ok(job);
            }
            why = String::from_utf8_lossy(&output.stderr).trim().to_owned();
            if output.status.success() || why.contains("timed out") {
                return self.submitted_or_not(mark, &why, progress);
            }
            if !["Unable to contact", "temporarily"].iter().any(|word| why.contains(word)) {
                break;
            }
            progress.status(&format!("sbatch is tried again: {why}"));
            pause(wait, progress)?;
            wait = (wait * 2).min(LATEST);
        }
        let most = parts.last().copied().unwrap_or(0);
        let hint = if why.contains("Invalid job array specification") {
            format!(
                "; the array's largest number is {most}, and Slurm takes less than MaxArraySize (`scontrol show config | grep MaxArraySize`; 1001 unless set): give fewer --slurm-tasks"
            )
        } else if why.contains("job submit limit") {
            format!("; the array has {} tasks: give fewer --slurm-tasks", parts.len())
        } else {
            String::new()
        };
        Err(StudyError::Slurm(format!("sbatch refused: {why}{hint}")))
    }

    /// The job of an array of which `sbatch` did not say the number: found in the queue.
    fn submitted_or_not(
        &self,
        mark: &str,
        why: &str,
        progress: &dyn Progress,
    ) -> Result<Job, StudyError> {
        for _ in 0..LOOKED {
            if let Some(job) = self.find(mark, progress)? {
                return Ok(job);
            }
            pause(SOONEST, progress)?;
        }
        let why = if why.is_empty() { "it said nothing" } else { why };
        Err(StudyError::Slurm(format!(
            "sbatch gave no job number ({why}), and the array may have been submitted all the same: look by `squeue --me`, and start again when no array of this study is there"
        )))
    }
}

/// Comment that tells the arrays of a study in a folder from all others.
fn mark(study: &Study, folder: &Path) -> Result<String, StudyError> {
    let whole = std::fs::canonicalize(folder)
        .map_err(|e| sunglint_formats::FileError::io("read", folder, e))?;
    let key = [study.id.as_bytes(), whole.as_os_str().as_encoded_bytes()].join(&b'\n');
    Ok(format!("sunglint:{}", &sha256(&key)[..24]))
}

/// The job whose comment has a mark, out of lines `NUMBER COMMENT`.
fn marked(text: &str, mark: &str) -> Option<Job> {
    let mut cluster = None;
    for line in text.lines().map(str::trim) {
        if let Some(name) = line.strip_prefix("CLUSTER:") {
            cluster = Some(name.trim().to_owned());
        } else if line.split_ascii_whitespace().skip(1).any(|word| word == mark) {
            return Job::of(line).map(|job| Job { cluster, ..job });
        }
    }
    None
}

/// Asks `squeue`; `None` where it no longer knows the job. Slurm's controller may be busy for a while: it is asked again.
fn ask(
    queue: &Path,
    arguments: &[&str],
    what: &str,
    rest: &dyn Fn(Duration) -> Result<(), StudyError>,
    progress: &dyn Progress,
) -> Result<Option<String>, StudyError> {
    let mut why = String::new();
    let mut wait = SOONEST;
    for _ in 0..ASKED {
        let mut command = Command::new(queue);
        command.args(arguments);
        // A person's own choice of what squeue lists must not hide the job.
        for (name, _) in std::env::vars_os() {
            if name.as_encoded_bytes().starts_with(b"SQUEUE_") {
                command.env_remove(name);
            }
        }
        let output = command
            .output()
            .map_err(|e| StudyError::Slurm(format!("cannot start {}: {e}", queue.display())))?;
        if output.status.success() {
            return Ok(Some(String::from_utf8_lossy(&output.stdout).into_owned()));
        }
        why = String::from_utf8_lossy(&output.stderr).trim().to_owned();
        // What has ended is forgotten after some minutes.
        if why.contains("Invalid job id") {
            return Ok(None);
        }
        progress.status(&format!("squeue is asked again: {why}"));
        rest(wait)?;
        wait = (wait * 2).min(LATEST);
    }
    Err(StudyError::Slurm(format!("squeue does not tell {what}: {why}")))
}

/// Advice on a reason for which a task waits until a person does something; `None` for reasons that end by themselves.
fn stuck(reason: &str) -> Option<&'static str> {
    let reason: String = reason
        .chars()
        .filter(|c| c.is_ascii_alphanumeric())
        .map(|c| c.to_ascii_lowercase())
        .collect();
    Some(match reason.as_str() {
        "jobhelduser" => {
            "somebody holds them: `scontrol release` with the job's number lets them go"
        }
        "jobheldadmin" => "an administrator holds them: ask why",
        "jobholdmaxrequeue" => "they were started again too often: see the tasks' output",
        text if text.contains("launchfailed") => {
            "a node could not start them, and they are held: `scontrol release` with the job's number tries again"
        }
        "dependencyneversatisfied" => "a job that they depend on has failed",
        "partitiontimelimit" => {
            "they ask for more time than the partition gives: --slurm-option --time=…"
        }
        "partitionnodelimit" => "they ask for more nodes than the partition gives",
        "partitiondown" | "partitioninactive" => {
            "the partition starts no jobs: --slurm-option --partition=… names another"
        }
        "badconstraints" => {
            "no node has what they ask for (--constraint, --mem, --cpus-per-task …)"
        }
        "invalidaccount" | "accountnotallowed" => {
            "the account is not taken: --slurm-option --account=…"
        }
        "invalidqos" | "qosnotallowed" => {
            "the quality of service is not taken: --slurm-option --qos=…"
        }
        "reservationdeleted" => "their reservation is no longer there",
        _ => return None,
    })
}

/// The shards of a study that are still missing.
struct Shards<'a> {
    study: &'a Study,
    folder: &'a Path,
    left: Vec<usize>,
    /// Reasons to wait that the person was warned of.
    warned: BTreeSet<String>,
}

impl Shards<'_> {
    /// Looks at those that were missing.
    fn look(&mut self, progress: &dyn Progress) {
        let before = self.left.len();
        let left = std::mem::take(&mut self.left);
        refresh(self.study, self.folder);
        self.left = missing_of(self.study, self.folder, left);
        progress.advance((before - self.left.len()) as u64);
    }
}

/// Waits, and listens for Ctrl-C.
fn pause(time: Duration, progress: &dyn Progress) -> Result<(), Cancelled> {
    let until = Instant::now() + time;
    loop {
        if progress.is_cancelled() {
            return Err(Cancelled);
        }
        let now = Instant::now();
        if now >= until {
            return Ok(());
        }
        std::thread::sleep(BLINK.min(until - now));
    }
}

/// Numbers as Slurm's list of ranges: `1-3,7`.
fn ranges(numbers: &BTreeSet<usize>) -> String {
    let mut ranges: Vec<(usize, usize)> = Vec::new();
    for number in numbers {
        match ranges.last_mut() {
            Some((_, last)) if *last + 1 == *number => *last = *number,
            _ => ranges.push((*number, *number)),
        }
    }
    let text = |(first, last): (usize, usize)| match first == last {
        true => first.to_string(),
        false => format!("{first}-{last}"),
    };
    ranges.into_iter().map(text).collect::<Vec<_>>().join(",")
}

/// A job of Slurm.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Job {
    /// Number.
    id: String,
    /// Cluster, where it is another than this machine's.
    cluster: Option<String>,
}

impl Job {
    /// Reads what `sbatch --parsable` says, `7` or `7;far`; or, of a program that stands for it, `Submitted batch job 7 on cluster far`.
    fn submitted(text: &str) -> Option<Self> {
        text.lines().find_map(|line| {
            let line = line.trim();
            let line = line.strip_prefix("Submitted batch job ").unwrap_or(line);
            let line = line.replacen(" on cluster ", " ", 1).replacen(';', " ", 1);
            Self::of(&line).filter(|_| line.split_ascii_whitespace().count() <= 2)
        })
    }

    fn of(line: &str) -> Option<Self> {
        let mut words = line.split_ascii_whitespace();
        let id = words.next().filter(|id| id.bytes().all(|b| b.is_ascii_digit()))?;
        Some(Self { id: id.to_owned(), cluster: words.next().map(str::to_owned) })
    }

    /// Reads the file [`JOB`]; `None` where there is none, or one that makes no sense.
    fn read(path: &Path) -> Option<Self> {
        Self::of(&sunglint_formats::read::text(path).ok()?)
    }

    fn write(&self, path: &Path) -> Result<(), StudyError> {
        let cluster = self.cluster.as_ref().map_or(String::new(), |name| format!(" {name}"));
        let text = format!("{}{cluster}\n", self.id);
        write_file(path, text.as_bytes(), Overwrite::Allow)?;
        Ok(())
    }

    /// Option that names the cluster, with a blank before it; empty for this machine's.
    fn clusters(&self) -> String {
        self.cluster.as_ref().map_or(String::new(), |cluster| format!(" -M {cluster}"))
    }

    /// Waits; at Ctrl-C the person is told that the job goes on.
    fn pause(&self, time: Duration, progress: &dyn Progress) -> Result<(), StudyError> {
        pause(time, progress).map_err(|cancelled| {
            let (id, cluster) = (&self.id, self.clusters());
            progress.warn(&format!(
                "job {id} goes on in Slurm; `scancel{cluster} {id}` ends it, the same command as now waits for it"
            ));
            cancelled.into()
        })
    }

    /// States of the job's tasks that wait, run or end; `None` where Slurm lists none.
    fn state(&self, queue: &Path, progress: &dyn Progress) -> Result<Option<States>, StudyError> {
        let mut arguments = vec!["--noheader", "--all", "--jobs", &self.id, "--format", "%T %r"];
        if let Some(cluster) = &self.cluster {
            arguments.extend(["--clusters", cluster]);
        }
        let what = format!("of job {}, which goes on", self.id);
        let text = ask(queue, &arguments, &what, &|time| self.pause(time, progress), progress)?;
        Ok(text.as_deref().and_then(States::of))
    }
}

/// States of a job's tasks.
#[derive(Debug, PartialEq, Eq)]
struct States {
    /// Each once, with the reasons of those that wait: `PENDING (Priority), RUNNING`.
    text: String,
    /// Reasons of those that wait.
    reasons: BTreeSet<String>,
}

impl States {
    /// Reads lines `STATE REASON`; `None` where there are none.
    fn of(text: &str) -> Option<Self> {
        let (mut found, mut reasons) = (BTreeSet::new(), BTreeSet::new());
        // With --clusters some versions write the cluster's name above, header or not.
        let lines = text.lines().map(str::trim);
        for line in lines.filter(|line| !line.is_empty() && !line.starts_with("CLUSTER:")) {
            let (state, reason) = line.split_once(' ').unwrap_or((line, "None"));
            let reason = reason.trim();
            found.insert(match (state, reason) {
                ("PENDING", reason) if reason != "None" => {
                    reasons.insert(reason.to_owned());
                    format!("PENDING ({reason})")
                }
                _ => state.to_owned(),
            });
        }
        let text = found.into_iter().collect::<Vec<_>>().join(", ");
        (!text.is_empty()).then_some(Self { text, reasons })
    }
}

/// Reads `K/N`.
///
/// # Errors
/// The fault, in words.
pub fn part(text: &str) -> Result<Part, String> {
    let numbers = text.split_once('/').and_then(|(k, n)| Some((k.parse().ok()?, n.parse().ok()?)));
    let Some((part, of)) = numbers else {
        return Err(format!("`{text}` is no part, expected K/N, the K-th of N: 3/50"));
    };
    Part { part, of }.check().map_err(|e| e.to_string())
}
