//! The shards of a study as a job array of Slurm.
//!
//! A task of Slurm costs about a second before it begins, so that each takes many shards: as many tasks as are asked for, each an even part. Slurm does not
//! start a batch script again that was killed; so missing shards are looked for when an array has ended, and an array of just those parts follows.

use crate::run::{Part, missing, prepare};
use crate::{Study, StudyError};
use std::path::{Path, PathBuf};
use std::process::Command;
use sunglint_formats::atomic::{Overwrite, write_file};
use sunglint_numerics::progress::{Cancelled, Progress};

/// Tasks of an array unless another number is asked for.
pub const TASKS: usize = 50;
/// Arrays that are tried before a shard is given up.
pub const ROUNDS: usize = 5;
/// Name of the batch script in the study's folder.
pub const SCRIPT: &str = "study.sbatch";

/// How the array is submitted.
#[derive(Debug, Clone)]
pub struct Array {
    /// Program that submits: `sbatch`, or a way to it.
    pub submit: PathBuf,
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
            self.array(&script, &logs, &wanted)?;
            let now = missing(study, folder);
            progress.advance(left.len().saturating_sub(now.len()) as u64);
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

    fn array(&self, script: &Path, logs: &Path, parts: &[usize]) -> Result<(), StudyError> {
        let list = parts.iter().map(ToString::to_string).collect::<Vec<_>>().join(",");
        let output = Command::new(&self.submit)
            .arg("--wait")
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
        if said.contains("Submitted batch job") {
            return Ok(());
        }
        let why = String::from_utf8_lossy(&output.stderr);
        Err(StudyError::Slurm(format!("sbatch refused: {}", why.trim())))
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
