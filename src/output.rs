//! Where results go: files by their extension, folders, stdout; nothing is overwritten unless asked.

use crate::plot::Figure;
use crate::plot::gallery::Gallery;
use anyhow::Context as _;
use clap::Args;
use serde_json::Value;
use std::collections::HashSet;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use sunglint_formats::atomic::{Overwrite, write_file};
use sunglint_formats::fits::ascii_json;
use sunglint_formats::{FileError, Meta, Table, ecsv};

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

    /// Prints a result on stdout: JSON if asked for, else the text.
    pub fn result(&self, text: &str, json: &Value) -> anyhow::Result<()> {
        if self.json { self.print(&serde_json::to_string_pretty(json)?) } else { self.print(text) }
    }

    /// Says something on stderr.
    pub fn say(&self, text: &str) {
        if !self.quiet {
            eprintln!("{text}");
        }
    }

    /// Says something on stderr to whoever asked for more (`-v`).
    pub fn detail(&self, text: &str) {
        if self.verbose > 0 {
            eprintln!("{text}");
        }
    }

    /// Warns on stderr.
    pub fn warn(&self, text: &str) {
        if !self.quiet {
            eprintln!("warning: {text}");
        }
    }
}

/// What a command has to give: the same numbers as table, figure and JSON.
#[derive(Debug, Clone, Default)]
pub struct Product {
    /// The file name without extension when it goes into a folder.
    pub name: String,
    /// The numbers; without columns where there is no table.
    pub table: Table,
    /// The picture.
    pub figure: Option<Figure>,
    /// Pictures in its place.
    pub gallery: Option<Gallery>,
    /// What a FITS file holds where that is not the table: the bytes.
    pub fits: Option<Vec<u8>>,
    /// The page to read in a browser.
    pub html: Option<String>,
    /// The summary with documented keys.
    pub json: Value,
    /// What else there is: a folder gets it too, with the names of their own.
    pub others: Vec<Product>,
}

impl Product {
    /// The extensions under which it goes into a folder.
    fn extensions(&self) -> impl Iterator<Item = &'static str> {
        let table = (!self.table.columns.is_empty()).then_some(&["ecsv"][..]);
        let drawn = self.figure.is_some() || self.gallery.is_some();
        let figure = drawn.then_some(&["png", "svg"][..]);
        // Beside a table a FITS file holds something else, which has its own place among the others.
        let fits = (table.is_none() && self.fits.is_some()).then_some(&["fits"][..]);
        let html = self.html.is_some().then_some(&["html"][..]);
        [table, fits, figure, html].into_iter().flatten().flatten().copied()
    }
}

impl OutputArgs {
    /// Whether the result goes to stdout as a table.
    pub fn is_stdout(&self) -> bool {
        self.output.iter().any(|p| p.as_os_str() == "-")
    }

    /// Whether the JSON document will be wanted: building it costs time and memory.
    pub fn wants_json(&self, console: Console) -> bool {
        console.json || self.output.iter().any(|p| matches!(Format::of(p), Ok(Format::Json)))
    }

    /// The folders among the targets: what is written piece by piece goes there alone.
    pub fn folders(&self) -> Self {
        let output = self.output.iter().filter(|path| is_folder(path)).cloned().collect();
        Self { output, force: self.force }
    }

    /// Whether files of these names can be written into each folder, beside the files that are named: asked before work that takes long.
    pub fn check_names<S: AsRef<str>>(&self, names: &[S]) -> anyhow::Result<()> {
        let files = self.output.iter().filter(|p| p.as_os_str() != "-").flat_map(|target| {
            let inside = || names.iter().map(|name| target.join(name.as_ref())).collect();
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
            Format::of(path)?;
        }
        self.check_targets(files)
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
            if !self.force && path.symlink_metadata().is_ok() {
                return Err(there_already(path));
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

    /// As [`OutputArgs::finish`], with other files that are written together with the product's or not at all.
    pub fn finish_with(
        &self,
        product: &Product,
        others: Vec<(PathBuf, Vec<u8>)>,
        text: &str,
        console: Console,
    ) -> anyhow::Result<()> {
        self.check_with(console)?;
        let wanted = self.targets(product);
        let paths = wanted.iter().map(|(path, _)| path).chain(others.iter().map(|(path, _)| path));
        let written = self.check_targets(paths.map(PathBuf::as_path)).and_then(|()| {
            let mut files = self.files_of(product)?;
            files.extend(others);
            if self.is_stdout() {
                console.print(&ecsv::to_string(&product.table)?)?;
            }
            self.write_files(&files, console)
        });
        let is_quiet = console.quiet && !console.json;
        match written {
            Ok(files) if self.is_stdout() || is_quiet && !files.is_empty() => Ok(()),
            Ok(_) => console.result(text, &product.json),
            Err(error) => {
                // What was found is not lost with the file that it cannot be written to; stdout is for what was done.
                if !error.is::<Usage>() {
                    eprintln!("{}\n", text.trim_end());
                }
                Err(error)
            }
        }
    }

    /// The files that a product becomes.
    fn targets<'a>(&self, product: &'a Product) -> Vec<(PathBuf, &'a Product)> {
        let mut wanted = Vec::new();
        for target in self.output.iter().filter(|p| p.as_os_str() != "-") {
            if is_folder(target) {
                for part in std::iter::once(product).chain(&product.others) {
                    let file = |extension| target.join(format!("{}.{extension}", part.name));
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
                let bytes = contents(&path, part)?;
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
        self.check_targets(files.iter().map(|(path, _)| path.as_path()))?;
        for folder in self.output.iter().filter(|p| is_folder(p)) {
            std::fs::create_dir_all(folder)
                .with_context(|| format!("cannot create the folder {}", folder.display()))?;
        }
        let mut written = Vec::new();
        for (path, bytes) in files {
            self.write_file(path, bytes)?;
            console.say(&format!("wrote {}", path.display()));
            written.push(path.clone());
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
        write_file(path, bytes, overwrite).map_err(|error| match error {
            FileError::Exists { path } => there_already(&path),
            error => error.into(),
        })
    }
}

fn there_already(path: &Path) -> anyhow::Error {
    anyhow::anyhow!("{} is there already: nothing is overwritten without --force", path.display())
}

/// What a file holds of a product.
fn contents(path: &Path, product: &Product) -> anyhow::Result<Vec<u8>> {
    let figure = || {
        product.figure.as_ref().with_context(|| {
            format!("{}: `{}` has no figure; write it as .ecsv", path.display(), product.name)
        })
    };
    Ok(match Format::of(path)? {
        Format::Ecsv => ecsv::to_string(&product.table)?.into_bytes(),
        Format::Csv => plain_csv(&product.table)?,
        Format::Fits if product.fits.is_some() => product.fits.clone().unwrap_or_default(),
        Format::Fits => {
            let mut writer = sunglint_formats::fits::Writer::new();
            let table = Table {
                meta: flat_meta(&product.table.meta),
                columns: product.table.columns.clone(),
            };
            writer.table(&table, &product.name.to_uppercase())?;
            writer.into_bytes()
        }
        Format::Json => {
            let mut text = serde_json::to_vec_pretty(&product.json)?;
            text.push(b'\n');
            text
        }
        Format::Html => {
            let page = product.html.clone().with_context(|| {
                format!("{}: `{}` has no page; write it as .ecsv", path.display(), product.name)
            })?;
            page.into_bytes()
        }
        Format::Png => match &product.gallery {
            Some(gallery) => gallery.png()?,
            None => figure()?.png()?,
        },
        Format::Svg => match &product.gallery {
            Some(gallery) => gallery.svg()?.into_bytes(),
            None => figure()?.svg()?.into_bytes(),
        },
    })
}

enum Format {
    Ecsv,
    Csv,
    Fits,
    Json,
    Html,
    Png,
    Svg,
}

impl Format {
    fn of(path: &Path) -> anyhow::Result<Self> {
        let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
        let found = match extension.as_deref() {
            Some("ecsv") => return Ok(Format::Ecsv),
            Some("csv") => return Ok(Format::Csv),
            Some("fits" | "fit") => return Ok(Format::Fits),
            Some("json") => return Ok(Format::Json),
            Some("html" | "htm") => return Ok(Format::Html),
            Some("png") => return Ok(Format::Png),
            Some("svg") => return Ok(Format::Svg),
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

/// A number with nine significant digits, as summaries hold it: without the noise of the last bits (329.99999999999994).
pub fn rounded(value: f64) -> f64 {
    if value == 0.0 || !value.is_finite() {
        return value;
    }
    // Powers of ten up to 22 are exact, so that the quotient is the float nearest to the decimal.
    match 8 - value.abs().log10().floor() as i32 {
        places @ 0..=22 => (value * 10_f64.powi(places)).round() / 10_f64.powi(places),
        places @ -22..0 => (value / 10_f64.powi(-places)).round() * 10_f64.powi(-places),
        // A text of this form is always a number.
        _ => format!("{value:.8e}").parse().unwrap_or(value),
    }
}

/// Metadata as a FITS header holds them: what is nested becomes JSON under a keyword of eight letters (`flag_bits` is `FLAGBITS`, `provenance`
/// is `PROVENAN`, as in spectral light curves).
fn flat_meta(meta: &Meta) -> Meta {
    let flat = |(key, value): (&String, &Value)| match value {
        Value::Object(_) | Value::Array(_) => {
            let letters = key.chars().filter(char::is_ascii_alphanumeric).take(8);
            let keyword: String = letters.map(|c| c.to_ascii_uppercase()).collect();
            (keyword, Value::String(ascii_json(value)))
        }
        plain => (key.clone(), plain.clone()),
    };
    meta.iter().map(flat).collect()
}

/// The columns alone, for programs that know no ECSV.
fn plain_csv(table: &Table) -> anyhow::Result<Vec<u8>> {
    let text = ecsv::to_string(table)?;
    let body: Vec<&str> = text.lines().skip_while(|l| l.starts_with('#')).collect();
    Ok((body.join("\n") + "\n").into_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the decimal text rounded to nine digits, read back.
    #[test]
    fn numbers_are_rounded_to_what_a_decimal_text_says() {
        for (value, expected) in [
            (329.999_999_999_999_94, 330.0),
            (0.999_999_999_999_997_8, 1.0),
            (0.1 + 0.2, 0.3),
            (-12.345_678_901_23, -12.345_678_9),
            (6.02e23, 6.02e23),
            (1.234_567_891_4e-30, 1.234_567_89e-30),
            (123_456_789_012.3, 123_456_789_000.0),
            (0.0, 0.0),
        ] {
            assert_eq!(rounded(value), expected);
        }
        for i in 1..2000 {
            let value = (f64::from(i) * 0.37).exp2() * 1e-9;
            assert_eq!(rounded(value), format!("{value:.8e}").parse::<f64>().unwrap(), "{value}");
        }
        assert!(rounded(f64::NAN).is_nan());
    }
}
