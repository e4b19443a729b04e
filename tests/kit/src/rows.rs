//! Results of each seed of a campaign that is run in shards: a table that grows seed by seed.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::ops::Range;
use std::path::PathBuf;

/// A row a seed; where it has a path, the file is written anew with each row.
#[derive(Debug, Default)]
pub(crate) struct Rows {
    path: Option<PathBuf>,
    columns: &'static [&'static str],
    rows: BTreeMap<u64, (String, Vec<f64>)>,
}

impl Rows {
    /// Rows that are kept nowhere.
    pub fn new(columns: &'static [&'static str]) -> Self {
        Self { columns, ..Self::default() }
    }

    /// The rows of a file; none where it is missing or has other columns.
    pub fn read(path: PathBuf, columns: &'static [&'static str]) -> Self {
        let text = std::fs::read_to_string(&path).unwrap_or_default();
        let mut rows = Self { path: Some(path), ..Self::new(columns) };
        let mut lines = text.lines().filter(|l| !l.starts_with('#'));
        if lines.next().is_some_and(|head| head == rows.head()) {
            rows.rows = lines.filter_map(|l| row(l, columns.len())).collect();
        }
        rows
    }

    fn head(&self) -> String {
        format!("seed\tcommit\t{}", self.columns.join("\t"))
    }

    /// Forgets seeds that are run again.
    pub fn forget(&mut self, seeds: Range<u64>) {
        self.rows.retain(|seed, _| !seeds.contains(seed));
    }

    /// Adds a row, rounded as it is written, and writes the file.
    pub fn keep(&mut self, seed: u64, commit: String, values: &[f64]) {
        assert_eq!(values.len(), self.columns.len(), "{:?}", self.columns);
        let values = values.iter().map(|v| (v * 1e4).round() / 1e4).collect();
        self.rows.insert(seed, (commit, values));
        let Some(path) = &self.path else { return };
        let mut text = format!("# Written by ./test --campaign, a row a seed\n{}\n", self.head());
        for (seed, (commit, values)) in &self.rows {
            let values: Vec<String> = values.iter().map(|v| v.to_string()).collect();
            let _ = writeln!(text, "{seed}\t{commit}\t{}", values.join("\t"));
        }
        let written = std::fs::write(path, text);
        assert!(written.is_ok(), "cannot write {}: {written:?}", path.display());
    }

    /// A column, in the order of the seeds.
    pub fn column(&self, name: &str) -> Vec<f64> {
        let Some(at) = self.columns.iter().position(|c| *c == name) else {
            panic!("no column {name} in {:?}", self.columns)
        };
        self.rows.values().map(|(_, values)| values[at]).collect()
    }

    /// Those of some seeds that have no row.
    pub fn missing(&self, seeds: Range<u64>) -> Vec<u64> {
        seeds.filter(|seed| !self.rows.contains_key(seed)).collect()
    }

    /// The commits that the rows are of, each once.
    pub fn commits(&self) -> String {
        let mut all: Vec<&str> = self.rows.values().map(|(commit, _)| commit.as_str()).collect();
        all.sort_unstable();
        all.dedup();
        all.join(" ")
    }
}

fn row(line: &str, columns: usize) -> Option<(u64, (String, Vec<f64>))> {
    let mut cells = line.split('\t');
    let seed = cells.next()?.parse().ok()?;
    let commit = cells.next()?.to_owned();
    let values: Vec<f64> = cells.map(|c| c.parse().ok()).collect::<Option<_>>()?;
    (values.len() == columns).then_some((seed, (commit, values)))
}

/// The seeds of a part `K/N` (from 1) of `n`.
pub(crate) fn shard(text: &str, n: u64) -> Range<u64> {
    let parts = text.split_once('/').and_then(|(k, of)| Some((k.parse().ok()?, of.parse().ok()?)));
    match parts {
        Some((k, of)) if (1..=of).contains(&k) && of <= n => (k - 1) * n / of..k * n / of,
        _ => panic!("SUNGLINT_SHARD={text}: expected K/N, K from 1 to N, N at most {n}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_are_the_whole() {
        let parts: Vec<u64> = (1..=7).flat_map(|k| shard(&format!("{k}/7"), 200)).collect();
        assert_eq!(parts, (0..200).collect::<Vec<_>>());
        for wrong in ["", "3", "0/4", "5/4", "1/201", "a/b"] {
            assert!(std::panic::catch_unwind(|| shard(wrong, 200)).is_err(), "{wrong}");
        }
    }

    #[test]
    fn rows_come_back_and_those_run_again_are_replaced() {
        let folder = std::env::temp_dir().join(format!("sunglint-rows-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let path = folder.join("it.tsv");
        const COLUMNS: &[&str] = &["a", "b"];
        let mut rows = Rows::read(path.clone(), COLUMNS);
        rows.keep(2, "c2".into(), &[1.5, f64::INFINITY]);
        rows.keep(0, "c1".into(), &[-0.25, f64::NAN]);
        let mut back = Rows::read(path.clone(), COLUMNS);
        assert_eq!(back.column("a"), [-0.25, 1.5]);
        assert!(back.column("b")[0].is_nan() && back.column("b")[1] == f64::INFINITY);
        assert_eq!((back.missing(0..4), back.commits()), (vec![1, 3], "c1 c2".to_owned()));
        back.forget(2..4);
        assert_eq!(back.column("a"), [-0.25]);
        // A file of other columns is begun anew.
        assert_eq!(Rows::read(path, &["a"]).missing(0..4).len(), 4);
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
