//! Where results go: files by their extension, folders, stdout; nothing is overwritten unless asked.

use crate::plot::Figure;
use anyhow::{Context as _, bail};
use clap::Args;
use serde_json::Value;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use sunglint_formats::atomic::{Overwrite, write_file};
use sunglint_formats::{FileError, Table, ecsv};

/// Where results go.
#[derive(Debug, Clone, Default, Args)]
pub struct OutputArgs {
    /// Write the result: the extension picks the format (.ecsv, .csv, .fits, .json, .png, .svg), `-` is ECSV on stdout, a folder gets table and
    /// figure. May be given several times
    #[arg(short, long, value_name = "FILE")]
    pub output: Vec<PathBuf>,
    /// Overwrite files that are there
    #[arg(long)]
    pub force: bool,
}

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

    /// Warns on stderr.
    pub fn warn(&self, text: &str) {
        if !self.quiet {
            eprintln!("warning: {text}");
        }
    }
}

/// What a command has to give: the same numbers as table, figure and JSON.
#[derive(Debug, Clone)]
pub struct Product {
    /// The file name without extension when it goes into a folder.
    pub name: String,
    /// The numbers.
    pub table: Table,
    /// The picture.
    pub figure: Option<Figure>,
    /// The summary with documented keys.
    pub json: Value,
}

impl OutputArgs {
    /// Whether the result goes to stdout as a table.
    pub fn is_stdout(&self) -> bool {
        self.output.iter().any(|p| p.as_os_str() == "-")
    }

    /// Refuses before the work what could not be written after it: an unknown extension, a file that is there.
    pub fn check(&self) -> anyhow::Result<()> {
        for path in self.output.iter().filter(|p| p.as_os_str() != "-" && !is_folder(p)) {
            Format::of(path)?;
            if !self.force && path.symlink_metadata().is_ok() {
                return Err(there_already(path));
            }
        }
        Ok(())
    }

    /// Writes a product everywhere it is wanted, and gives the files written.
    pub fn deliver(&self, product: &Product, console: Console) -> anyhow::Result<Vec<PathBuf>> {
        let mut written = Vec::new();
        for path in &self.output {
            if path.as_os_str() == "-" {
                console.print(&ecsv::to_string(&product.table)?)?;
            } else if is_folder(path) {
                std::fs::create_dir_all(path)
                    .with_context(|| format!("cannot create the folder {}", path.display()))?;
                let extensions: &[&str] =
                    if product.figure.is_some() { &["ecsv", "png", "svg"] } else { &["ecsv"] };
                for extension in extensions {
                    let file = path.join(format!("{}.{extension}", product.name));
                    self.write_product(&file, product)?;
                    written.push(file);
                }
            } else {
                self.write_product(path, product)?;
                written.push(path.clone());
            }
        }
        for path in &written {
            console.say(&format!("wrote {}", path.display()));
        }
        Ok(written)
    }

    fn write_product(&self, path: &Path, product: &Product) -> anyhow::Result<()> {
        let figure = || {
            product.figure.as_ref().with_context(|| {
                format!("{}: `{}` has no figure; write it as .ecsv", path.display(), product.name)
            })
        };
        let bytes = match Format::of(path)? {
            Format::Ecsv => ecsv::to_string(&product.table)?.into_bytes(),
            Format::Csv => plain_csv(&product.table)?,
            Format::Fits => {
                let mut writer = sunglint_formats::fits::Writer::new();
                writer.table(&product.table, &product.name.to_uppercase())?;
                writer.into_bytes()
            }
            Format::Json => {
                let mut text = serde_json::to_vec_pretty(&product.json)?;
                text.push(b'\n');
                text
            }
            Format::Png => figure()?.png()?,
            Format::Svg => figure()?.svg()?.into_bytes(),
        };
        self.write_file(path, &bytes)
    }

    /// Writes bytes whole or not at all, over nothing unless `--force`.
    pub fn write_file(&self, path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
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

enum Format {
    Ecsv,
    Csv,
    Fits,
    Json,
    Png,
    Svg,
}

impl Format {
    fn of(path: &Path) -> anyhow::Result<Self> {
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("");
        Ok(match extension.to_ascii_lowercase().as_str() {
            "ecsv" => Format::Ecsv,
            "csv" => Format::Csv,
            "fits" | "fit" => Format::Fits,
            "json" => Format::Json,
            "png" => Format::Png,
            "svg" => Format::Svg,
            _ => bail!(
                "{}: found the extension `{extension}`, expected .ecsv, .csv, .fits, .json, .png or .svg (a folder ends with `/`)",
                path.display()
            ),
        })
    }
}

fn is_folder(path: &Path) -> bool {
    path.is_dir() || path.as_os_str().to_string_lossy().ends_with(['/', std::path::MAIN_SEPARATOR])
}

/// The columns alone, for programs that know no ECSV.
fn plain_csv(table: &Table) -> anyhow::Result<Vec<u8>> {
    let text = ecsv::to_string(table)?;
    let body: Vec<&str> = text.lines().skip_while(|l| l.starts_with('#')).collect();
    Ok((body.join("\n") + "\n").into_bytes())
}
