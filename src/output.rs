//! Where results go: files by their extension, folders, stdout; nothing is overwritten unless asked.

use anyhow::Context as _;
use clap::Args;
use serde::Serialize;
use std::collections::HashSet;
use std::fs::File;
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use sunglint_formats::atomic::{Overwrite, Part, write_file};
use sunglint_formats::text::{file_name, printable};
use sunglint_formats::{FileError, ecsv};
use sunglint_report::{Format, Product, ProductError};

/// Where results go.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "The result")]
pub struct OutputArgs {
    /// Write the result: the extension picks the format (.ecsv, .csv, .fits, .json, .png, .svg; of `compare` and `fit` .html), `-` is ECSV on stdout, a folder (its name
    /// ends with `/`, or it is there) gets table and figure. May be given several times. The text is printed too, unless -q
    #[arg(short, long, value_name = "FILE")]
    pub output: Vec<PathBuf>,
    /// Overwrite files that are there
    #[arg(long)]
    pub force: bool,
}

/// A mistake in how the program was called: `main` exits with 2, not 1.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Usage(pub String);

/// How to speak to the person.
#[derive(Debug, Clone, Copy, Default)]
pub struct Console {
    /// One JSON document instead of text.
    pub json: bool,
    /// Errors only.
    pub quiet: bool,
    /// More on stderr.
    pub verbose: u8,
}

/// Writes a line on stderr, without what a foreign name may do to a terminal. Nobody may be there to read it any more: that ends nothing.
pub fn tell(text: &str) {
    let _ = writeln!(std::io::stderr().lock(), "{}", printable(text));
}

impl Console {
    /// Prints a result on stdout.
    pub fn print(&self, text: &str) -> anyhow::Result<()> {
        let mut out = std::io::stdout().lock();
        out.write_all(text.as_bytes())?;
        if !text.ends_with('\n') {
            out.write_all(b"\n")?;
        }
        out.flush()?;
        Ok(())
    }

    /// Prints bytes on stdout as they are.
    pub fn print_bytes(&self, bytes: &[u8]) -> anyhow::Result<()> {
        let mut out = std::io::stdout().lock();
        out.write_all(bytes)?;
        out.flush()?;
        Ok(())
    }

    /// Prints a result on stdout: JSON if asked for, else the text.
    pub fn result(&self, text: &str, json: &impl Serialize) -> anyhow::Result<()> {
        if self.json {
            self.print(&serde_json::to_string_pretty(json)?)
        } else {
            self.print(&printable(text))
        }
    }

    /// Says something on stderr.
    pub fn say(&self, text: &str) {
        if !self.quiet {
            tell(text);
        }
    }

    /// Says something on stderr to whoever asked for more (`-v`).
    pub fn detail(&self, text: &str) {
        if self.verbose > 0 {
            tell(text);
        }
    }

    /// Warns on stderr.
    pub fn warn(&self, text: &str) {
        if !self.quiet {
            tell(&format!("warning: {text}"));
        }
    }
}

impl OutputArgs {
    /// Whether the result goes to stdout as a table.
    pub fn is_stdout(&self) -> bool {
        self.output.iter().any(|p| p.as_os_str() == "-")
    }

    /// Whether the JSON document will be wanted: building it costs time and memory.
    pub fn wants_json(&self, console: Console) -> bool {
        console.json || self.output.iter().any(|p| matches!(format_of(p), Ok(Format::Json)))
    }

    /// The folders among the targets: what is written piece by piece goes there alone.
    pub fn folders(&self) -> Self {
        let output = self.output.iter().filter(|path| is_folder(path)).cloned().collect();
        Self { output, force: self.force }
    }

    /// Whether files of these names can be written into each folder, beside the files that are named: asked before work that takes long.
    pub fn check_names<S: AsRef<str>>(&self, names: &[S]) -> anyhow::Result<()> {
        let files = self.output.iter().filter(|p| p.as_os_str() != "-").flat_map(|target| {
            let inside = || names.iter().map(|name| target.join(named(name.as_ref()))).collect();
            if is_folder(target) { inside() } else { vec![target.clone()] }
        });
        let files: Vec<PathBuf> = files.collect();
        self.check_targets(files.iter().map(PathBuf::as_path))
    }

    /// Refuses before the work what could not be written after it: an unknown extension, a file that is there or named twice, a folder
    /// that is not there.
    pub fn check(&self) -> anyhow::Result<()> {
        let files = self.output.iter().filter(|p| p.as_os_str() != "-" && !is_folder(p));
        let files: Vec<&Path> = files.map(PathBuf::as_path).collect();
        for path in &files {
            format_of(path)?;
        }
        self.check_targets(files)
    }

    /// The other outputs, and those of a kind.
    pub fn parted(&self, is_it: impl Fn(&Path) -> bool) -> (Self, Self) {
        let (of_kind, others) = self.output.iter().cloned().partition(|path| is_it(path));
        let of = |output| Self { output, force: self.force };
        (of(others), of(of_kind))
    }

    /// Refuses options that do not go together.
    pub fn check_with(&self, console: Console) -> anyhow::Result<()> {
        if self.is_stdout() && console.json {
            return Err(Usage(
                "`-o -` and `--json` both want stdout: leave one of them out, or give `-o` a file"
                    .into(),
            )
            .into());
        }
        Ok(())
    }

    /// Whether all of these files can be written.
    pub fn check_targets<'a>(
        &self,
        paths: impl IntoIterator<Item = &'a Path>,
    ) -> anyhow::Result<()> {
        let mut seen = HashSet::new();
        for path in paths {
            if is_device(path) {
                continue;
            }
            let folder = folder_of(path);
            // A folder that is still to be made has no other name.
            let place = folder.canonicalize().unwrap_or_else(|_| folder.to_path_buf());
            if !seen.insert(place.join(path.file_name().unwrap_or_default())) {
                return Err(Usage(format!("{} would be written twice", path.display())).into());
            }
            if path.symlink_metadata().is_ok() {
                if !self.force {
                    return Err(there_already(path));
                }
                if is_input_too(path, &self.output) {
                    return Err(Usage(format!(
                        "{} is read by this command, too: it would be lost; give the result another name",
                        path.display()
                    ))
                    .into());
                }
            }
            let made = self.output.iter().any(|target| is_folder(target) && target == folder);
            if !folder.is_dir() && !made {
                let problem = if folder.exists() { "is no folder" } else { "does not exist" };
                let (folder, path) = (folder.display(), path.display());
                anyhow::bail!("the folder {folder} {problem}: make it before writing {path}");
            }
        }
        Ok(())
    }

    /// The one end of every command: writes a product everywhere it is wanted; prints the JSON document where it was asked for, else the
    /// text, which `-q` leaves out if there are files instead. With `-o -` the table is all there is on stdout.
    pub fn finish(&self, product: &Product, text: &str, console: Console) -> anyhow::Result<()> {
        self.finish_with(product, Vec::new(), text, console)
    }

    /// Finishes as [`OutputArgs::finish`] does, with other files that are written together with the product's or not at all.
    pub fn finish_with(
        &self,
        product: &Product,
        others: Vec<(PathBuf, Vec<u8>)>,
        text: &str,
        console: Console,
    ) -> anyhow::Result<()> {
        let mut text = printable(text).to_string();
        if !text.ends_with('\n') {
            text.push('\n');
        }
        self.finish_raw(product, others, text.as_bytes(), console)
    }

    /// Finishes as [`OutputArgs::finish_with`] does, with files of the product that were written while it was made.
    pub fn finish_made(
        &self,
        product: &Product,
        made: Made,
        others: Vec<(PathBuf, Vec<u8>)>,
        text: &str,
        console: Console,
    ) -> anyhow::Result<()> {
        let mut text = printable(text).to_string();
        if !text.ends_with('\n') {
            text.push('\n');
        }
        self.finish_all(product, made, others, text.as_bytes(), console)
    }

    /// Finishes as [`OutputArgs::finish_with`] does, with a text of any bytes, which are printed as they are: names of files need not be UTF-8.
    pub fn finish_raw(
        &self,
        product: &Product,
        others: Vec<(PathBuf, Vec<u8>)>,
        text: &[u8],
        console: Console,
    ) -> anyhow::Result<()> {
        self.finish_all(product, Made::default(), others, text, console)
    }

    fn finish_all(
        &self,
        product: &Product,
        mut made: Made,
        others: Vec<(PathBuf, Vec<u8>)>,
        text: &[u8],
        console: Console,
    ) -> anyhow::Result<()> {
        self.check_with(console)?;
        let wanted = self.targets(product);
        let paths = wanted.iter().map(|(path, _)| path).chain(others.iter().map(|(path, _)| path));
        let written = self.check_targets(paths.map(PathBuf::as_path)).and_then(|()| {
            let mut files = Vec::new();
            for (path, part) in wanted {
                let content = match made.take(&Target::File(path.clone())) {
                    Some(file) => Content::Made(file),
                    None => Content::Bytes(encoded(part, &path)?),
                };
                files.push((path, content));
            }
            files.extend(others.into_iter().map(|(path, bytes)| (path, Content::Bytes(bytes))));
            if self.is_stdout() {
                match made.take(&Target::Stdout) {
                    Some(file) => file.finish()?,
                    None => console.print(&ecsv::to_string(&product.table)?)?,
                }
            }
            self.write_contents(files, console)
        });
        if written.is_ok() {
            made.keep_folders();
        }
        let is_quiet = console.quiet && !console.json;
        match written {
            Ok(files) if self.is_stdout() || is_quiet && !files.is_empty() => Ok(()),
            Ok(_) if console.json => console.result("", &product.json),
            Ok(_) => console.print_bytes(text),
            Err(error) => {
                // What was found is not lost with the file that it cannot be written to; stdout is for what was done.
                if !error.is::<Usage>() {
                    tell(&format!("{}\n", String::from_utf8_lossy(text).trim_end()));
                }
                Err(error)
            }
        }
    }

    /// Where a product is wanted that is written while it is made: in folders in one form, under the names of files in those that it has `alone`.
    pub fn streams(
        &self,
        name: &str,
        in_folder: Format,
        alone: &[Format],
    ) -> anyhow::Result<Vec<(Target, Format)>> {
        let mut wanted = Vec::new();
        for target in &self.output {
            if target.as_os_str() == "-" {
                if alone.contains(&Format::Ecsv) {
                    wanted.push((Target::Stdout, Format::Ecsv));
                }
            } else if is_folder(target) {
                let extension = if in_folder == Format::Fits { "fits" } else { "ecsv" };
                let file = target.join(named(&format!("{name}.{extension}")));
                wanted.push((Target::File(file), in_folder));
            } else {
                let format = format_of(target)?;
                if alone.contains(&format) {
                    wanted.push((Target::File(target.clone()), format));
                }
            }
        }
        Ok(wanted)
    }

    /// Begins a file that is written while its numbers are made.
    pub fn begin(&self, target: &Target, made: &mut Made) -> anyhow::Result<MadeFile> {
        let path = match target {
            Target::File(path) if !is_device(path) => path,
            _ => {
                let spool = tempfile::tempfile().with_context(|| {
                    format!("cannot make a temporary file in {}", std::env::temp_dir().display())
                })?;
                return Ok(MadeFile::Spool(target.clone(), spool));
            }
        };
        let folder = folder_of(path);
        if self.output.iter().any(|target| is_folder(target) && target == folder) {
            made.make_folder(folder)?;
        }
        let overwrite = if self.force { Overwrite::Allow } else { Overwrite::Refuse };
        let part = Part::begin(path, overwrite).map_err(written)?;
        if let Ok(mut left) = LEFT.lock() {
            left.push(part.part_path().to_path_buf());
        }
        Ok(MadeFile::Part(part))
    }

    /// The files that a product becomes.
    fn targets<'a>(&self, product: &'a Product) -> Vec<(PathBuf, &'a Product)> {
        let mut wanted = Vec::new();
        for target in self.output.iter().filter(|p| p.as_os_str() != "-") {
            if is_folder(target) {
                for part in std::iter::once(product).chain(&product.others) {
                    let file =
                        |extension| target.join(named(&format!("{}.{extension}", part.name)));
                    wanted.extend(part.extensions().map(|extension| (file(extension), part)));
                }
            } else {
                wanted.push((target.clone(), product));
            }
        }
        wanted
    }

    /// The files that a product becomes, with their contents.
    pub fn files_of(&self, product: &Product) -> anyhow::Result<Vec<(PathBuf, Vec<u8>)>> {
        let wanted = self.targets(product);
        // A quick answer before the figures are drawn.
        self.check_targets(wanted.iter().map(|(path, _)| path.as_path()))?;
        wanted
            .into_iter()
            .map(|(path, part)| {
                let bytes = encoded(part, &path)?;
                Ok((path, bytes))
            })
            .collect()
    }

    /// Writes files after having seen that all of them can be: none if one is there, or named twice. Makes the folders of `-o`.
    pub fn write_files(
        &self,
        files: &[(PathBuf, Vec<u8>)],
        console: Console,
    ) -> anyhow::Result<Vec<PathBuf>> {
        let contents = files.iter().map(|(path, bytes)| (path.clone(), Content::Borrowed(bytes)));
        self.write_contents(contents.collect(), console)
    }

    fn write_contents(
        &self,
        files: Vec<(PathBuf, Content<'_>)>,
        console: Console,
    ) -> anyhow::Result<Vec<PathBuf>> {
        self.check_targets(files.iter().map(|(path, _)| path.as_path()))?;
        for folder in self.output.iter().filter(|p| is_folder(p)) {
            std::fs::create_dir_all(folder)
                .with_context(|| format!("cannot create the folder {}", folder.display()))?;
        }
        let mut written = Vec::new();
        for (path, content) in files {
            match content {
                Content::Bytes(bytes) => self.write_file(&path, &bytes)?,
                Content::Borrowed(bytes) => self.write_file(&path, bytes)?,
                Content::Made(file) => file.finish()?,
            }
            console.say(&format!("wrote {}", path.display()));
            written.push(path);
        }
        Ok(written)
    }

    /// Writes bytes whole or not at all, over nothing unless `--force`.
    pub fn write_file(&self, path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
        if is_device(path) {
            // A device is written to; a file moved into its place would end it.
            let device = std::fs::OpenOptions::new().write(true).open(path);
            return device
                .and_then(|mut device| device.write_all(bytes))
                .with_context(|| format!("cannot write {}", path.display()));
        }
        let overwrite = if self.force { Overwrite::Allow } else { Overwrite::Refuse };
        write_file(path, bytes, overwrite).map_err(written)
    }
}

fn written(error: FileError) -> anyhow::Error {
    match error {
        FileError::Exists { path } => there_already(&path),
        error => error.into(),
    }
}

/// Contents of a file.
enum Content<'a> {
    Bytes(Vec<u8>),
    Borrowed(&'a [u8]),
    Made(MadeFile),
}

/// Temporary files and new folders that are to be removed where a signal ends the program: the files first.
static LEFT: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Where something goes that is written while it is made.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Target {
    /// The standard output.
    Stdout,
    /// A file, or a device.
    File(PathBuf),
}

/// Something that is written while it is made: into a temporary file beside its place, or, for stdout and devices, into one without a name.
#[derive(Debug)]
pub enum MadeFile {
    /// A file that is moved into its place.
    Part(Part),
    /// Data that are copied to their place at the end, so that nothing is there if the work fails.
    Spool(Target, File),
}

impl MadeFile {
    fn is_for(&self, target: &Target) -> bool {
        match (self, target) {
            (Self::Part(part), Target::File(path)) => part.path() == path,
            (Self::Spool(own, _), target) => own == target,
            (Self::Part(_), Target::Stdout) => false,
        }
    }

    /// The place in words, for errors.
    pub fn place(&self) -> String {
        match self {
            Self::Part(part) => part.path().display().to_string(),
            Self::Spool(Target::File(path), _) => path.display().to_string(),
            Self::Spool(Target::Stdout, _) => "a temporary file for the standard output".into(),
        }
    }

    /// Ends the file: it has its name from now on.
    pub fn finish(self) -> anyhow::Result<()> {
        match self {
            Self::Part(part) => {
                let temporary = part.part_path().to_path_buf();
                part.finish().map_err(written)?;
                if let Ok(mut left) = LEFT.lock() {
                    left.retain(|path| *path != temporary);
                }
            }
            Self::Spool(target, mut spool) => {
                spool.seek(SeekFrom::Start(0))?;
                match target {
                    Target::Stdout => {
                        let mut out = std::io::stdout().lock();
                        std::io::copy(&mut spool, &mut out)?;
                        out.flush()?;
                    }
                    Target::File(path) => {
                        let device = std::fs::OpenOptions::new().write(true).open(&path);
                        device
                            .and_then(|mut device| std::io::copy(&mut spool, &mut device))
                            .with_context(|| format!("cannot write {}", path.display()))?;
                    }
                }
            }
        }
        Ok(())
    }
}

impl Write for MadeFile {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        match self {
            Self::Part(part) => part.write(bytes),
            Self::Spool(_, spool) => spool.write(bytes),
        }
    }

    fn flush(&mut self) -> std::io::Result<()> {
        match self {
            Self::Part(part) => part.flush(),
            Self::Spool(_, spool) => spool.flush(),
        }
    }
}

impl Seek for MadeFile {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        match self {
            Self::Part(part) => part.seek(to),
            Self::Spool(_, spool) => spool.seek(to),
        }
    }
}

/// Files that were written while a product was made, for [`OutputArgs::finish_made`]. What is not taken is removed, with the folders that were made for it.
#[derive(Debug, Default)]
pub struct Made {
    files: Vec<MadeFile>,
    /// New folders, each after those that it is in.
    folders: Vec<PathBuf>,
}

impl Made {
    /// Adds a file with all that belongs into it.
    pub fn add(&mut self, file: MadeFile) {
        self.files.push(file);
    }

    fn take(&mut self, target: &Target) -> Option<MadeFile> {
        let place = self.files.iter().position(|file| file.is_for(target))?;
        Some(self.files.swap_remove(place))
    }

    fn make_folder(&mut self, folder: &Path) -> anyhow::Result<()> {
        let missing = folder.ancestors().take_while(|f| !f.as_os_str().is_empty() && !f.exists());
        let mut missing: Vec<PathBuf> = missing.map(Path::to_path_buf).collect();
        std::fs::create_dir_all(folder)
            .with_context(|| format!("cannot create the folder {}", folder.display()))?;
        if let Ok(mut left) = LEFT.lock() {
            left.extend(missing.iter().cloned());
        }
        missing.reverse();
        self.folders.extend(missing);
        Ok(())
    }

    fn keep_folders(&mut self) {
        if let Ok(mut left) = LEFT.lock() {
            left.retain(|path| !self.folders.contains(path));
        }
        self.folders.clear();
    }
}

impl Drop for Made {
    fn drop(&mut self) {
        self.files.clear();
        // One that something else was put into stays.
        for folder in self.folders.iter().rev() {
            let _ = std::fs::remove_dir(folder);
        }
    }
}

/// Removes what is half made where Ctrl-C, a kill or a lost terminal ends the program, which then ends as it always did.
pub fn clean_up_on_signals() -> anyhow::Result<()> {
    crate::interrupt::listen(crate::interrupt::Hangup::Ends, || {
        if let Ok(left) = LEFT.lock() {
            let (folders, files): (Vec<_>, Vec<_>) = left.iter().partition(|path| path.is_dir());
            for file in files {
                let _ = std::fs::remove_file(file);
            }
            let mut folders = folders;
            folders.sort_by_key(|folder| std::cmp::Reverse(folder.components().count()));
            for folder in folders {
                let _ = std::fs::remove_dir(folder);
            }
        }
        let _ = signal_hook::low_level::emulate_default_handler(signal_hook::consts::SIGINT);
    })
}

/// The name of a file within its folder, whatever the name of a scene or a target holds.
fn named(name: &str) -> String {
    match name.rsplit_once('.') {
        Some((stem, extension)) => format!("{}.{extension}", file_name(stem)),
        None => file_name(name).into_owned(),
    }
}

/// Whether a file that is to be written stands on the command line as something else than an output.
fn is_input_too(file: &Path, outputs: &[PathBuf]) -> bool {
    let Ok(place) = file.canonicalize() else { return false };
    let is_it = |value: &std::ffi::OsStr| Path::new(value).canonicalize().is_ok_and(|p| p == place);
    // `--option=VALUE` and `-oVALUE` hold a value, too.
    let named = std::env::args_os().skip(1).filter(|argument| {
        let text = argument.to_str().unwrap_or_default();
        let long = text.strip_prefix("--").and_then(|text| Some(text.split_once('=')?.1));
        let value = long.or(text.strip_prefix("-o"));
        is_it(argument) || value.is_some_and(|value| is_it(value.as_ref()))
    });
    named.count() > outputs.iter().filter(|output| is_it(output.as_os_str())).count()
}

fn there_already(path: &Path) -> anyhow::Error {
    anyhow::anyhow!("{} is there already: nothing is overwritten without --force", path.display())
}

fn is_folder(path: &Path) -> bool {
    path.is_dir() || path.as_os_str().to_string_lossy().ends_with(['/', std::path::MAIN_SEPARATOR])
}

/// Whether it is there and neither file nor folder: `/dev/null`, a pipe.
fn is_device(path: &Path) -> bool {
    path.metadata().is_ok_and(|m| !m.is_file() && !m.is_dir())
}

/// The folder that a file is in.
fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// The format that a path asks for by its extension.
fn format_of(path: &Path) -> anyhow::Result<Format> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    if let Some(format) = extension.as_deref().and_then(Format::of_extension) {
        return Ok(format);
    }
    let found = match extension.as_deref() {
        // As on stdout.
        _ if is_device(path) => return Ok(Format::Ecsv),
        Some(extension) => format!("found the extension `{extension}`"),
        None => "found no extension".to_owned(),
    };
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let hint = if name.starts_with('.') && extension.is_none() {
        format!("; what begins with a dot is a name, not an extension: result{name}?")
    } else {
        " (a folder's name ends with `/`)".to_owned()
    };
    let expected = "expected .ecsv, .csv, .fits, .json, .html, .png or .svg";
    Err(Usage(format!("-o {}: {found}, {expected}{hint}", path.display())).into())
}

/// The bytes that a product has at a path.
fn encoded(product: &Product, path: &Path) -> anyhow::Result<Vec<u8>> {
    product.encode(format_of(path)?).map_err(|error| match error {
        ProductError::NoFigure { .. } | ProductError::NoPage { .. } => {
            anyhow::anyhow!("{}: {error}", path.display())
        }
        error => error.into(),
    })
}
