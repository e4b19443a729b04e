//! The shards of a study as a job array of Slurm.
//!
//! A task of Slurm costs about a second before it begins, so that each takes many shards: as many tasks as are asked for, each an even part. Slurm does not
//! start a batch script again that was killed; so missing shards are looked for when an array has ended, and an array of just those parts follows.
//!
//! The job's number is kept in the study's folder: who starts the command again waits for the array that is there. Slurm's texts are those of its sources
//! (`sbatch.c`, `squeue.c`, `slurm_errno.c` of 23.11).

use crate::run::{Part, missing, missing_of, prepare};
use crate::{Study, StudyError};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};
use sunglint_formats::atomic::{Overwrite, write_file};
use sunglint_numerics::progress::{Cancelled, Progress};

/// Tasks of an array unless another number is asked for.
pub const TASKS: usize = 50;
/// Arrays that are tried before a shard is given up.
pub const ROUNDS: usize = 5;
/// First pause between two looks at the queue, and the longest.
const SOONEST: Duration = Duration::from_millis(500);
const LATEST: Duration = Duration::from_secs(10);
/// Pause between two looks for Ctrl-C.
const BLINK: Duration = Duration::from_millis(50);
/// Times that a controller that does not answer is asked.
const ASKED: usize = 30;
/// Time that a network's file system may take to show what other nodes wrote.
pub const GRACE: Duration = Duration::from_secs(5);
/// Name of the batch script in the study's folder.
pub const SCRIPT: &str = "study.sbatch";
/// Name of the file with the number of the job that was submitted last, and its cluster where Slurm names one.
pub const JOB: &str = "study.job";

/// How the array is submitted.
#[derive(Debug, Clone)]
pub struct Array {
    /// Program that submits: `sbatch`, or a way to it.
    pub submit: PathBuf,
    /// Program that lists waiting and running jobs: `squeue`. Without one `sbatch --wait` waits, which looks every 30 s or so.
    pub queue: Option<PathBuf>,
    /// Command that makes a part: the program and its arguments up to `--part`.
    pub command: Vec<String>,
    /// Threads of a task, as `--threads`; as many as Slurm gives the task unless given.
    pub threads: Option<u16>,
    /// Tasks of the array at most.
    pub tasks: usize,
    /// Pause before shards of an array that has ended count as missing: [`GRACE`].
    pub grace: Duration,
    /// Options of `sbatch`, each a line of the script: `--partition=long`.
    pub options: Vec<String>,
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
    /// An option with a line break: it would be a line of its own.
    pub fn script(&self, study: &Study) -> Result<String, StudyError> {
        let mut text = String::from("#!/bin/sh\n");
        let name: String = study.name.chars().filter(|c| !c.is_control()).collect();
        text.push_str(&format!("#SBATCH --job-name={}\n", quoted(&name)));
        for option in &self.options {
            if option.contains(['\n', '\r']) {
                return Err(StudyError::Slurm(format!("the option {option:?} has a line break")));
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

    /// Submits arrays of the parts with missing shards until there are none, and waits for them. An array of an earlier call that Slurm still lists is waited
    /// for first.
    ///
    /// # Errors
    /// [`StudyError::Slurm`]: `sbatch` is not there or refuses; two arrays one after the other made no shard; shards are still missing after [`ROUNDS`] arrays.
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
        let mut shards = Shards { study, folder, left: missing(study, folder) };
        progress.begin("shards", Some(shards.left.len() as u64));
        if let (Some(job), Some(queue), false) =
            (Job::read(&kept), &self.queue, shards.left.is_empty())
        {
            self.wait(queue, &job, &format!("job {} of before", job.id), &mut shards, progress)?;
        }
        let (mut idle, mut arrays) = (0, 0);
        while !shards.left.is_empty() && idle < 2 && arrays < ROUNDS {
            if progress.is_cancelled() {
                return Err(Cancelled.into());
            }
            arrays += 1;
            let before = shards.left.len();
            let wanted: BTreeSet<usize> = shards.left.iter().map(|s| s % parts + 1).collect();
            let stage = format!("array {arrays}: {} parts", wanted.len());
            progress.status(&stage);
            let job = self.array(&script, &logs, &wanted, progress)?;
            if let Err(error) = job.write(&kept) {
                progress.warn(&format!("{error}: a new start will not know of job {}", job.id));
            }
            match &self.queue {
                Some(queue) => self.wait(queue, &job, &stage, &mut shards, progress)?,
                None => self.settle(&mut shards, progress)?,
            }
            idle = if shards.left.len() == before { idle + 1 } else { 0 };
        }
        match shards.left.len() {
            0 => {
                // A number that nobody waits for any more; Slurm gives it to another job in the end.
                let _ = std::fs::remove_file(&kept);
                Ok(())
            }
            count => Err(StudyError::Slurm(format!(
                "{count} of {} shards are missing after {arrays} arrays, the last of which made {}; the tasks' output is in {}",
                study.shards(),
                if idle > 0 { "none" } else { "some" },
                logs.display()
            ))),
        }
    }

    /// Waits until no shard is missing, or until Slurm no longer lists the job.
    fn wait(
        &self,
        queue: &Path,
        job: &Job,
        stage: &str,
        shards: &mut Shards<'_>,
        progress: &dyn Progress,
    ) -> Result<(), StudyError> {
        // Looked for more and more seldom: an array takes seconds or days.
        let mut pause = SOONEST;
        loop {
            let state = job.state(queue, progress)?;
            shards.look(progress);
            if shards.left.is_empty() {
                return Ok(());
            }
            let Some(state) = state else { return self.settle(shards, progress) };
            progress.status(&format!("{stage}, {state}"));
            job.pause(pause, progress)?;
            pause = (pause + pause / 4).min(LATEST);
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

    /// Submits an array; its job. A controller that does not answer is asked again.
    fn array(
        &self,
        script: &Path,
        logs: &Path,
        parts: &BTreeSet<usize>,
        progress: &dyn Progress,
    ) -> Result<Job, StudyError> {
        // Slurm takes `%` in a name for the begin of a pattern.
        let logs = logs.display().to_string().replace('%', "%%");
        let mut why = String::new();
        let mut wait = SOONEST;
        for _ in 0..ASKED {
            let mut command = Command::new(&self.submit);
            if self.queue.is_none() {
                command.arg("--wait");
            }
            let output = command
                .arg(format!("--array={}", ranges(parts)))
                .arg(format!("--output={logs}/%A_%a.txt"))
                .arg(script)
                .output()
                .map_err(|e| {
                    StudyError::Slurm(format!(
                        "cannot start {}: {e}; --slurm-script writes the script alone",
                        self.submit.display()
                    ))
                })?;
            // A task that fails gives sbatch its own exit code: whether shards are missing is seen in the folder. No job at all is an error.
            if let Some(job) = Job::submitted(&String::from_utf8_lossy(&output.stdout)) {
                return Ok(job);
            }
            why = String::from_utf8_lossy(&output.stderr).trim().to_owned();
            if why.contains("timed out") {
                return Err(StudyError::Slurm(format!(
                    "sbatch had no answer, and the array may be submitted all the same: look by `squeue --me`, and start again when no array of this study is there; {why}"
                )));
            }
            if !["Unable to contact", "temporarily"].iter().any(|word| why.contains(word)) {
                break;
            }
            progress.status(&format!("sbatch is tried again: {why}"));
            pause(wait, progress)?;
            wait = (wait * 2).min(LATEST);
        }
        Err(StudyError::Slurm(format!("sbatch refused: {why}")))
    }
}

/// The shards of a study that are still missing.
struct Shards<'a> {
    study: &'a Study,
    folder: &'a Path,
    left: Vec<usize>,
}

impl Shards<'_> {
    /// Looks at those that were missing.
    fn look(&mut self, progress: &dyn Progress) {
        let before = self.left.len();
        let left = std::mem::take(&mut self.left);
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
    /// Reads what `sbatch` says: `Submitted batch job 7`, or `Submitted batch job 7 on cluster far`.
    fn submitted(text: &str) -> Option<Self> {
        let (_, rest) = text.split_once("Submitted batch job ")?;
        Self::of(rest.lines().next()?.replacen(" on cluster ", " ", 1).as_str())
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

    /// Waits; at Ctrl-C the person is told that the job goes on.
    fn pause(&self, time: Duration, progress: &dyn Progress) -> Result<(), StudyError> {
        pause(time, progress).map_err(|cancelled| {
            let cluster = self.cluster.as_ref().map_or(String::new(), |c| format!(" -M {c}"));
            let id = &self.id;
            progress.warn(&format!(
                "job {id} goes on in Slurm; `scancel{cluster} {id}` ends it, the same command as now waits for it"
            ));
            cancelled.into()
        })
    }

    /// States of the job's tasks that wait, run or end, with the reasons of those that wait: `PENDING (Priority), RUNNING`. `None` where Slurm lists none.
    /// Slurm's controller may be busy for a while: it is asked again.
    fn state(&self, queue: &Path, progress: &dyn Progress) -> Result<Option<String>, StudyError> {
        let mut why = String::new();
        let mut wait = SOONEST;
        for _ in 0..ASKED {
            let mut command = Command::new(queue);
            command.args(["--noheader", "--jobs", &self.id, "--format", "%T %r"]);
            if let Some(cluster) = &self.cluster {
                command.args(["--clusters", cluster]);
            }
            // A person's own choice of what squeue lists must not hide the job.
            for (name, _) in std::env::vars_os() {
                if name.as_encoded_bytes().starts_with(b"SQUEUE_") {
                    command.env_remove(name);
                }
            }
            let output = command.output().map_err(|e| {
                let (queue, id) = (queue.display(), &self.id);
                StudyError::Slurm(format!("cannot start {queue}: {e}; job {id} goes on without it"))
            })?;
            if output.status.success() {
                return Ok(states(&String::from_utf8_lossy(&output.stdout)));
            }
            why = String::from_utf8_lossy(&output.stderr).trim().to_owned();
            // What has ended is forgotten after some minutes.
            if why.contains("Invalid job id") {
                return Ok(None);
            }
            progress.status(&format!("squeue is asked again: {why}"));
            self.pause(wait, progress)?;
            wait = (wait * 2).min(LATEST);
        }
        let id = &self.id;
        Err(StudyError::Slurm(format!("squeue does not tell of job {id}, which goes on: {why}")))
    }
}

/// States out of lines `STATE REASON`, each once.
fn states(text: &str) -> Option<String> {
    let mut found: BTreeSet<String> = BTreeSet::new();
    // With --clusters some versions write the cluster's name above, header or not.
    let lines = text.lines().map(str::trim);
    for line in lines.filter(|line| !line.is_empty() && !line.starts_with("CLUSTER:")) {
        found.insert(match line.split_once(' ') {
            Some(("PENDING", reason)) if reason.trim() != "None" => {
                format!("PENDING ({})", reason.trim())
            }
            Some((state, _)) => state.to_owned(),
            None => line.to_owned(),
        });
    }
    (!found.is_empty()).then(|| found.into_iter().collect::<Vec<_>>().join(", "))
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
