//! The shards of a study as a job array of Slurm.
//!
//! A task of Slurm costs about a second before it begins, so that each takes many shards: as many tasks as are asked for, each an even part. Slurm does not
//! start a batch script again that was killed; so missing shards are looked for when an array has ended, and an array of just those parts follows.

use crate::run::{Part, missing, prepare};
use crate::{Study, StudyError};
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
/// Times that a queue that does not answer is asked.
const ASKED: usize = 30;
/// Name of the batch script in the study's folder.
pub const SCRIPT: &str = "study.sbatch";

/// How the array is submitted.
#[derive(Debug, Clone)]
pub struct Array {
    /// Program that submits: `sbatch`, or a way to it.
    pub submit: PathBuf,
    /// Program that lists waiting and running jobs: `squeue`. Without one `sbatch --wait` waits, which looks every 30 s or so.
    pub queue: Option<PathBuf>,
    /// Command that makes a part: the program and its arguments up to `--part`.
    pub command: Vec<String>,
    /// Tasks of the array at most.
    pub tasks: usize,
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
        text.push_str(&format!(
            "exec {} --part \"$SLURM_ARRAY_TASK_ID/{}\"\n",
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

    /// Submits arrays of the parts with missing shards until there are none, and waits for them.
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
        let parts = self.parts(study);
        let mut left = missing(study, folder);
        progress.begin("shards", Some(left.len() as u64));
        let mut idle = 0;
        for round in 1..=ROUNDS {
            if left.is_empty() {
                return Ok(());
            }
            if progress.is_cancelled() {
                return Err(Cancelled.into());
            }
            let wanted: Vec<usize> =
                (1..=parts).filter(|part| left.iter().any(|s| s % parts == part - 1)).collect();
            progress.status(&format!("array {round}: {} parts", wanted.len()));
            let job = self.array(&script, &logs, &wanted)?;
            let mut told = left.len();
            if let Some(queue) = &self.queue {
                // Looked for more and more seldom: an array takes seconds or days.
                let mut pause = SOONEST;
                loop {
                    let is_queued = is_queued(queue, &job)?;
                    let now = missing(study, folder).len();
                    progress.advance(told.saturating_sub(now) as u64);
                    told = told.min(now);
                    if now == 0 || !is_queued {
                        break;
                    }
                    let until = Instant::now() + pause;
                    while Instant::now() < until {
                        if progress.is_cancelled() {
                            progress.warn(&format!(
                                "job {job} goes on in Slurm; `scancel {job}` ends it"
                            ));
                            return Err(Cancelled.into());
                        }
                        std::thread::sleep(BLINK.min(until - Instant::now().min(until)));
                    }
                    pause = (pause + pause / 4).min(LATEST);
                }
            }
            let now = missing(study, folder);
            progress.advance(told.saturating_sub(now.len()) as u64);
            idle = if now.len() == left.len() { idle + 1 } else { 0 };
            left = now;
            if idle == 2 {
                break;
            }
        }
        match left.len() {
            0 => Ok(()),
            count => Err(StudyError::Slurm(format!(
                "{count} of {} shards are missing after {ROUNDS} arrays at most; the tasks' output is in {}",
                study.shards(),
                logs.display()
            ))),
        }
    }

    /// Submits an array; its job's number.
    fn array(&self, script: &Path, logs: &Path, parts: &[usize]) -> Result<String, StudyError> {
        let list = parts.iter().map(ToString::to_string).collect::<Vec<_>>().join(",");
        let mut command = Command::new(&self.submit);
        if self.queue.is_none() {
            command.arg("--wait");
        }
        let output = command
            .arg(format!("--array={list}"))
            .arg(format!("--output={}/%A_%a.txt", logs.display()))
            .arg(script)
            .output()
            .map_err(|e| {
                StudyError::Slurm(format!(
                    "cannot start {}: {e}; --slurm-script writes the script alone",
                    self.submit.display()
                ))
            })?;
        // A task that fails gives sbatch its own exit code: whether shards are missing is seen in the folder. No job at all is an error.
        let said = String::from_utf8_lossy(&output.stdout);
        if let Some((_, job)) = said.split_once("Submitted batch job ") {
            return Ok(job.chars().take_while(char::is_ascii_digit).collect());
        }
        let why = String::from_utf8_lossy(&output.stderr);
        Err(StudyError::Slurm(format!("sbatch refused: {}", why.trim())))
    }
}

/// Whether Slurm still has tasks of a job that wait, run or end. Slurm's controller may be busy for a while: it is asked again.
fn is_queued(queue: &Path, job: &str) -> Result<bool, StudyError> {
    let mut why = String::new();
    for _ in 0..ASKED {
        let output = Command::new(queue).args(["--noheader", "--jobs", job]).output();
        let output = output.map_err(|e| {
            let queue = queue.display();
            StudyError::Slurm(format!("cannot start {queue}: {e}; job {job} goes on without it"))
        })?;
        if output.status.success() {
            return Ok(!output.stdout.trim_ascii().is_empty());
        }
        why = String::from_utf8_lossy(&output.stderr).trim().to_owned();
        // What has ended is forgotten after some minutes.
        if why.contains("Invalid job id") {
            return Ok(false);
        }
        std::thread::sleep(LATEST);
    }
    Err(StudyError::Slurm(format!("squeue does not tell of job {job}, which goes on: {why}")))
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
