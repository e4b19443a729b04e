//! Campaigns: statistical promises over many seeds, of which a twentieth runs with every test.

use crate::repository;
use crate::rows::{Rows, shard};
use std::fmt::Write as _;
use std::ops::Range;
use std::path::PathBuf;

/// A statistical promise, judged over the seeds 0…n−1.
///
/// The test of a campaign is named `campaign_NAME`. `./test --campaign NAME` runs all of its seeds and writes `tests/campaigns/NAME.toml`
/// (seeds, figures, commit); any other run takes the first twentieth of the seeds and compares its figures with that file.
///
/// ```no_run
/// let mut campaign = sunglint_testkit::Campaign::start("coin", 1000);
/// let mut largest = 0.0_f64;
/// for seed in campaign.seeds() {
///     largest = largest.max(seed as f64);
/// }
/// campaign.largest("largest_error", largest);
/// campaign.finish();
/// ```
#[derive(Debug)]
pub struct Campaign {
    name: &'static str,
    /// All of the seeds, and those of this run.
    all: Range<u64>,
    seeds: Range<u64>,
    full: bool,
    rows: Option<Rows>,
    figures: Vec<(&'static str, f64)>,
}

impl Campaign {
    /// A campaign of `n` seeds (at least ten), or of the first twentieth of them, at least one.
    pub fn start(name: &'static str, n: u64) -> Self {
        Self::with_part(name, n, (n / 20).max(1))
    }

    /// A campaign of `n` seeds (at least ten), or of the first `few`.
    pub fn with_part(name: &'static str, n: u64, few: u64) -> Self {
        assert!(n >= 10, "a campaign has at least ten seeds");
        let full = wanted(name);
        assert!(!full || from() == 0, "{name} keeps no rows: it has no other block of seeds");
        let seeds = 0..if full { n } else { few };
        Self { name, all: 0..n, seeds, full, rows: None, figures: Vec::new() }
    }

    /// A campaign of `n` seeds that cost so much that it is run in shards: what came of each seed is a row of `tests/campaigns/NAME.tsv`, kept as soon as it is known, and the whole is
    /// judged by all rows. `./test --campaign NAME --shard K/N` runs the K-th of N parts of the seeds; any other run takes the first `few`. With `--from FIRST` the seeds are another block,
    /// FIRST…FIRST+n−1, whose files are `NAME_from_FIRST`.
    pub fn in_shards(
        name: &'static str,
        n: u64,
        few: u64,
        columns: &'static [&'static str],
    ) -> Self {
        let full = wanted(name);
        let first = if full { from() } else { 0 };
        let part = match (full, std::env::var("SUNGLINT_SHARD")) {
            (true, Ok(text)) => shard(&text, n),
            (true, Err(_)) => 0..n,
            (false, _) => 0..few,
        };
        let (all, seeds) = (first..first + n, first + part.start..first + part.end);
        let path = path(name, first, "tsv");
        let mut rows = if full { Rows::read(path, columns) } else { Rows::new(columns) };
        rows.forget(seeds.clone());
        Self { name, all, seeds, full, rows: Some(rows), figures: Vec::new() }
    }

    /// The seeds of this run.
    pub fn seeds(&self) -> Range<u64> {
        self.seeds.clone()
    }

    /// Whether this run is the campaign itself, not its part in every run.
    pub fn is_asked_for(&self) -> bool {
        self.full
    }

    /// Keeps what came of a seed, in the order of the columns.
    ///
    /// # Panics
    /// Where the campaign is not one in shards, the columns are more or fewer, or the file cannot be written.
    pub fn keep(&mut self, seed: u64, values: &[f64]) {
        let Some(rows) = &mut self.rows else { panic!("{} keeps no rows", self.name) };
        rows.keep(seed, commit(), values);
    }

    /// A column of all rows that are kept: those of this run, and in a whole campaign those of earlier shards.
    pub fn column(&self, name: &str) -> Vec<f64> {
        self.rows.as_ref().map_or_else(Vec::new, |rows| rows.column(name))
    }

    /// Whether every seed of the whole campaign has been run, here or in shards before.
    pub fn is_whole(&self) -> bool {
        self.full && self.rows.as_ref().is_none_or(|rows| rows.missing(self.all.clone()).is_empty())
    }

    /// The largest of something over the seeds: a part's cannot exceed the whole's by more than rounding.
    pub fn largest(&mut self, figure: &'static str, value: f64) {
        self.figures.push((figure, value));
    }

    /// Writes the figures of a whole campaign (of one in shards those of all seeds that were run so far), or compares those of a part with the ones that are written.
    ///
    /// # Panics
    /// Where the file is missing or a figure of the part exceeds the whole's: the promise, or the file, is out of date.
    pub fn finish(self) {
        let path = self.path();
        if self.full {
            let (missing, n) = (self.missing(), self.all.end - self.all.start);
            if missing > 0 {
                println!("{}: {missing} of {n} seeds are still to be run", self.name);
            }
            let written = std::fs::write(&path, self.toml());
            assert!(written.is_ok(), "cannot write {}: {written:?}", path.display());
            return;
        }
        let advice = format!("run ./test --campaign {} and commit {}", self.name, path.display());
        let Ok(text) = std::fs::read_to_string(&path) else {
            panic!("there are no figures of the campaign {}: {advice}", self.name)
        };
        for (figure, value) in &self.figures {
            let line =
                text.lines().find_map(|l| l.strip_prefix(figure)?.trim_start().strip_prefix('='));
            let Some(whole) = line.and_then(|v| v.trim().parse::<f64>().ok()) else {
                panic!("{} holds no {figure}: {advice}", path.display())
            };
            assert!(
                *value <= whole * (1.0 + 1e-6),
                "{figure} of the first {} seeds is {value:e}, of the whole campaign {whole:e}: {advice}",
                self.seeds.end
            );
        }
    }

    fn path(&self) -> PathBuf {
        path(self.name, self.all.start, "toml")
    }

    /// Seeds without a row.
    fn missing(&self) -> u64 {
        self.rows.as_ref().map_or(0, |rows| rows.missing(self.all.clone()).len() as u64)
    }

    fn toml(&self) -> String {
        let commits = self.rows.as_ref().map_or_else(commit, Rows::commits);
        let (first, n) = (self.all.start, self.all.end - self.all.start);
        let block = if first == 0 { String::new() } else { format!(" --from {first}") };
        let seeds = match self.missing() {
            0 => format!("first_seed = {first}\nseeds = {n}"),
            missing => {
                let rows = path(self.name, first, "tsv");
                let rows = rows.file_name().unwrap_or_default().display().to_string();
                format!("# those in {rows}\nseeds = {}\nstill_to_be_run = {missing}", n - missing)
            }
        };
        let mut text = format!(
            "# Written by ./test --campaign {}{block}\n{seeds}\ncommit = \"{commits}\"\n\n[figures]\n",
            self.name
        );
        for (figure, value) in &self.figures {
            let _ = writeln!(text, "{figure} = {value:e}");
        }
        text
    }
}

/// A file of a campaign, of the block that begins with the seed `first`.
fn path(name: &str, first: u64, ending: &str) -> PathBuf {
    let block = if first == 0 { String::new() } else { format!("_from_{first}") };
    repository().join("tests/campaigns").join(format!("{name}{block}.{ending}"))
}

/// The first seed of the block that is asked for.
fn from() -> u64 {
    let Ok(text) = std::env::var("SUNGLINT_FROM") else { return 0 };
    let Ok(first) = text.parse() else { panic!("SUNGLINT_FROM={text}: expected a seed") };
    first
}

/// Whether this run is the whole campaign of that name.
fn wanted(name: &str) -> bool {
    std::env::var("SUNGLINT_CAMPAIGN").is_ok_and(|wanted| wanted == name)
}

/// The commit that is checked out; empty where there is none.
fn commit() -> String {
    std::process::Command::new("git")
        .args(["rev-parse", "--short", "HEAD"])
        .current_dir(repository())
        .output()
        .map(|out| String::from_utf8_lossy(&out.stdout).trim().to_owned())
        .unwrap_or_default()
}
