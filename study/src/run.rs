//! Shards and their files.

use crate::table::{notes, write};
use crate::task::{self, Scene, sample_columns, summary_columns};
use crate::{PROGRAM, Study, StudyError, caught};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use sunglint_formats::FileError;
use sunglint_formats::atomic::{Overwrite, write_file};
use sunglint_formats::sha256;
use sunglint_numerics::progress::{Cancelled, Progress};

/// Age from which on a file that was being written is nobody's.
const ABANDONED: Duration = Duration::from_secs(3600);
/// File that says which study a folder holds.
const MARK: &str = "study.json";
/// File that lists the shards of a study that is done.
pub const MANIFEST: &str = "manifest.json";
/// Folder of the summaries: their files together are one table.
pub const SUMMARY: &str = "summary";
/// Folder of the samples.
pub const SAMPLES: &str = "samples";
/// Tasks that are under way together, for each thread, at least; shards that are smaller are made together. A thread that is done with its own waits for the
/// others' last task: of so many, that is little.
const TASKS_A_THREAD: usize = 16;
/// Times that a file is read that other nodes may be replacing, and the pause between.
const STALE: (usize, Duration) = (20, Duration::from_millis(100));

/// Part of a study's shards: every `of`-th, from the `part`-th, counted from 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Part {
    /// Which, from 1.
    pub part: usize,
    /// Number of parts.
    pub of: usize,
}

impl Part {
    /// All shards.
    pub const ALL: Self = Self { part: 1, of: 1 };

    /// Whether it is all shards.
    pub fn is_all(self) -> bool {
        self.of == 1
    }

    fn holds(self, shard: usize) -> bool {
        shard % self.of == self.part - 1
    }

    /// Refuses a part that is none.
    ///
    /// # Errors
    /// [`StudyError::NoSuchPart`].
    pub fn check(self) -> Result<Self, StudyError> {
        match (1..=self.of).contains(&self.part) {
            true => Ok(self),
            false => Err(StudyError::NoSuchPart { part: self.part, of: self.of }),
        }
    }
}

#[derive(Debug, Serialize, Deserialize)]
struct Mark {
    id: String,
}

/// A file of a shard.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ShardFile {
    /// Name in the study's folder.
    pub file: String,
    /// Size.
    pub bytes: u64,
    /// SHA-256; `None` as long as shards are missing: reading all files for each part would cost more than the parts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sha256: Option<String>,
    /// Rows.
    pub rows: u64,
}

/// Report of a run. Of a part it counts the part's own tasks, shards and files alone: with thousands of parts, each looking at all files would be more work for
/// the file system than the study.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Report {
    /// Name of the study.
    pub study: String,
    /// Identity of the study.
    pub id: String,
    /// Program that made it, and what stands for its sources.
    pub program: String,
    /// The part, `K/N`; `None` for the whole study.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub part: Option<String>,
    /// Keys that change.
    pub parameters: Vec<String>,
    /// Points.
    pub points: usize,
    /// Objects; 0 where the scene's own orbit is used.
    pub objects: usize,
    /// Tasks.
    pub tasks: usize,
    /// Tasks that failed, of the shards that are there: their rows say why.
    pub failed: u64,
    /// Shards.
    pub shards: usize,
    /// Shards that are not there yet.
    pub missing: usize,
    /// Files of the shards, in their order.
    pub files: Vec<ShardFile>,
}

/// A run of a study, or of a part of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Ran {
    /// Shards that were made now.
    pub made: usize,
    /// Shards of the part that were there before.
    pub found: usize,
    /// State of the study after it, or of the part.
    pub report: Report,
    /// Where the manifest is: of a run of all shards.
    pub manifest: Option<PathBuf>,
}

fn file(folder: &str, shard: usize) -> String {
    format!("{folder}/part-{shard:06}.parquet")
}

/// Tables that a study keeps.
fn tables(study: &Study) -> impl Iterator<Item = &'static str> {
    [SUMMARY].into_iter().chain(study.keeps_samples.then_some(SAMPLES))
}

/// Makes what is missing of a part of a study; the manifest, where the part is all of it.
///
/// A shard that is there, whole and of this study, is left alone. Every shard is written at once, under its own name: two runs that make the same one write
/// the same bytes.
///
/// # Errors
/// [`StudyError`]: the folder holds another study; a file cannot be written; the work was stopped. Tasks that fail are rows, not errors.
pub fn run(
    study: &Study,
    folder: &Path,
    part: Part,
    progress: &dyn Progress,
) -> Result<Ran, StudyError> {
    let part = part.check()?;
    prepare(study, folder)?;
    let wanted: Vec<usize> = (0..study.shards()).filter(|s| part.holds(*s)).collect();
    let missing = missing_of(study, folder, wanted.iter().copied());
    let steps: usize = missing.iter().map(|s| study.shard(*s).len()).sum();
    progress.begin("tasks", Some(steps as u64));
    let threads = rayon::current_num_threads();
    let together = match threads {
        1 => 1,
        _ => (threads * TASKS_A_THREAD).div_ceil(study.tasks_a_shard),
    };
    let last = LastScene::default();
    for group in missing.chunks(together) {
        group.par_iter().try_for_each(|shard| make(study, folder, *shard, &last, progress))?;
    }
    let report = report(study, folder, part, progress)?;
    let manifest = match report.missing {
        0 if part.is_all() => {
            clean(study, folder);
            let path = folder.join(MANIFEST);
            let text = serde_json::to_string_pretty(&report).map_err(std::io::Error::other);
            let text = text.map_err(|e| FileError::io("write", &path, e))?;
            write_file(&path, format!("{text}\n").as_bytes(), Overwrite::Allow)?;
            Some(path)
        }
        _ => None,
    };
    Ok(Ran { made: missing.len(), found: wanted.len() - missing.len(), report, manifest })
}

/// Removes what killed tasks left of files that were being written, an hour ago or more: another run may be writing now.
fn clean(study: &Study, folder: &Path) {
    for table in tables(study) {
        let Ok(entries) = std::fs::read_dir(folder.join(table)) else { continue };
        for entry in entries.flatten() {
            let name = entry.file_name();
            let name = name.as_encoded_bytes();
            let since = entry.metadata().and_then(|about| about.modified());
            let is_old = since.is_ok_and(|t| t.elapsed().is_ok_and(|age| age > ABANDONED));
            if is_old && name.starts_with(b".sunglint-") && name.ends_with(b".part") {
                // What cannot be removed does no harm: no reader takes a hidden file.
                let _ = std::fs::remove_file(entry.path());
            }
        }
    }
}

/// Makes a network's file system look at the study's folders anew. NFS remembers for up to a minute that a name was not there, and forgets that where its own
/// machine changes the folder.
pub fn refresh(study: &Study, folder: &Path) {
    for table in tables(study) {
        let probe = folder.join(table).join(format!(".sunglint-look-{}.part", std::process::id()));
        // A folder that takes no file is looked at as it is: what is there is seen later.
        if std::fs::File::create_new(&probe).is_ok() {
            let _ = std::fs::remove_file(&probe);
        }
    }
}

/// The identity in a folder's mark; `None` where there is no mark. A file that another node replaced while it was open is read again.
fn marked(mark: &Path) -> Result<Option<String>, StudyError> {
    let mut tried = 0;
    loop {
        match sunglint_formats::read::text(mark) {
            Ok(text) => {
                let id = serde_json::from_str::<Mark>(&text).map(|m| m.id);
                return Ok(Some(id.unwrap_or_default()));
            }
            Err(FileError::Io { source, .. }) if source.kind() == ErrorKind::NotFound => {
                return Ok(None);
            }
            Err(FileError::Io { source, .. })
                if source.kind() == ErrorKind::StaleNetworkFileHandle && tried < STALE.0 =>
            {
                tried += 1;
                std::thread::sleep(STALE.1);
            }
            Err(error) => return Err(error.into()),
        }
    }
}

/// Makes the folders, and marks them as this study's where they are not: thousands of tasks that begin together only read the mark.
///
/// # Errors
/// The folder holds another study, or cannot be made.
pub fn prepare(study: &Study, folder: &Path) -> Result<(), StudyError> {
    let io = |path: &Path| {
        let path = path.to_path_buf();
        move |e| FileError::io("create", &path, e)
    };
    std::fs::create_dir_all(folder).map_err(io(folder))?;
    let mark = folder.join(MARK);
    let found = marked(&mark)?;
    if let Some(found) = found.as_ref().filter(|found| **found != study.id) {
        let short = |id: &str| id.chars().take(12).collect::<String>();
        return Err(StudyError::OtherStudy {
            path: folder.to_path_buf(),
            found: if found.is_empty() { "unreadable".into() } else { short(found) },
            id: short(&study.id),
        });
    }
    for table in tables(study) {
        let table = folder.join(table);
        std::fs::create_dir_all(&table).map_err(io(&table))?;
    }
    if found.is_none() {
        let text = format!("{}\n", serde_json::json!({ "id": study.id, "study": study.name }));
        write_file(&mark, text.as_bytes(), Overwrite::Allow)?;
    }
    Ok(())
}

/// Shards that are missing.
pub fn missing(study: &Study, folder: &Path) -> Vec<usize> {
    missing_of(study, folder, 0..study.shards())
}

/// Those of some shards that are missing.
pub fn missing_of(
    study: &Study,
    folder: &Path,
    shards: impl IntoIterator<Item = usize>,
) -> Vec<usize> {
    shards.into_iter().filter(|s| done(study, folder, *s).is_none()).collect()
}

/// Failed tasks of a shard that is there, whole and of this study, and its files' rows.
fn done(study: &Study, folder: &Path, shard: usize) -> Option<(u64, Vec<(String, u64)>)> {
    let mut files = Vec::new();
    let mut failed = 0;
    for table in tables(study) {
        let name = file(table, shard);
        let (notes, rows) = notes(&folder.join(&name))?;
        let note = |key: &str| notes.iter().find(|(k, _)| k == key).map(|(_, v)| v.as_str());
        if note("study") != Some(study.id.as_str()) || note("shard") != Some(&shard.to_string()) {
            return None;
        }
        failed = note("failed")?.parse().ok()?;
        files.push((name, rows));
    }
    Some((failed, files))
}

/// A point's scene that the next shard may have, too: with a catalogue all shards have the same. It keeps the integrals that its passes share.
#[derive(Default)]
struct LastScene(Mutex<Option<(usize, SharedScene)>>);

type SharedScene = Arc<Result<Scene, String>>;

impl LastScene {
    /// The scene of a point, unless another was the last.
    fn find(&self, point: usize) -> Option<SharedScene> {
        let last = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        last.as_ref().filter(|(of, _)| *of == point).map(|(_, scene)| scene.clone())
    }

    fn keep(&self, point: usize, scene: &SharedScene) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some((point, scene.clone()));
    }
}

fn make(
    study: &Study,
    folder: &Path,
    shard: usize,
    last: &LastScene,
    progress: &dyn Progress,
) -> Result<(), StudyError> {
    let tasks = study.shard(shard);
    let first = study.task(tasks.start).0;
    let points = study.task(tasks.end - 1).0 - first + 1;
    // Before the tasks, and behind no lock: a thread that waits within a scene for others takes up other work, and must not meet a scene there that it is making itself.
    let scenes = (first..first + points)
        .into_par_iter()
        .map(|point| match progress.is_cancelled() {
            true => Err(Cancelled),
            false => Ok(last.find(point).unwrap_or_else(|| {
                Arc::new(caught(|| Scene::new(study, point)).unwrap_or_else(Err))
            })),
        })
        .collect::<Result<Vec<SharedScene>, Cancelled>>()?;
    if let Some(scene) = scenes.last() {
        last.keep(first + points - 1, scene);
    }
    let outcomes = tasks
        .into_par_iter()
        .map(|task| {
            if progress.is_cancelled() {
                return Err(Cancelled);
            }
            let point = study.task(task).0;
            let outcome = caught(|| task::run(study, task, &scenes[point - first]))
                .unwrap_or_else(|why| task::failed(study, task, why));
            progress.advance(1);
            Ok(outcome)
        })
        .collect::<Result<Vec<_>, Cancelled>>()?;
    let failed = outcomes.iter().filter(|o| o.failed).count().to_string();
    let number = shard.to_string();
    let notes = [("study", study.id.as_str()), ("shard", &number), ("failed", &failed)];
    let (mut summary, mut samples) = (Vec::new(), Vec::new());
    for outcome in outcomes {
        summary.extend(outcome.summary);
        samples.extend(outcome.samples);
    }
    if study.keeps_samples {
        write(&folder.join(file(SAMPLES, shard)), &sample_columns(study), &samples, &notes)?;
    }
    // Last: where it is, the shard is done.
    write(&folder.join(file(SUMMARY, shard)), &summary_columns(study), &summary, &notes)
}

/// State of a study in its folder, or of a part of it. The files are read whole, for their SHA-256, only where no shard of all is missing; else only their ends
/// are.
///
/// # Errors
/// A file that cannot be read; the work was stopped.
pub fn report(
    study: &Study,
    folder: &Path,
    part: Part,
    progress: &dyn Progress,
) -> Result<Report, StudyError> {
    let mut report = Report {
        study: study.name.clone(),
        id: study.id.clone(),
        program: PROGRAM.into(),
        part: (!part.is_all()).then(|| format!("{}/{}", part.part, part.of)),
        parameters: study.parameters.clone(),
        points: study.points.len(),
        objects: study.passes.as_ref().map_or(0, |p| p.objects.len()),
        tasks: 0,
        failed: 0,
        shards: 0,
        missing: 0,
        files: Vec::new(),
    };
    for shard in (0..study.shards()).filter(|s| part.holds(*s)) {
        report.shards += 1;
        report.tasks += study.shard(shard).len();
        let Some((failed, files)) = done(study, folder, shard) else {
            report.missing += 1;
            continue;
        };
        report.failed += failed;
        for (file, rows) in files {
            let path = folder.join(&file);
            let about = path.metadata().map_err(|e| FileError::io("read", &path, e))?;
            report.files.push(ShardFile { file, bytes: about.len(), sha256: None, rows });
        }
    }
    if report.missing == 0 && part.is_all() {
        for file in &mut report.files {
            if progress.is_cancelled() {
                return Err(Cancelled.into());
            }
            let bytes = sunglint_formats::read::bytes(folder.join(&file.file))?;
            file.bytes = bytes.len() as u64;
            file.sha256 = Some(sha256(&bytes));
        }
    }
    Ok(report)
}
