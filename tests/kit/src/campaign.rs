//! Campaigns: statistical promises over many seeds, of which a tenth runs with every test.

use crate::repository;
use std::fmt::Write as _;
use std::path::PathBuf;

/// A statistical promise, judged over the seeds 0…n−1.
///
/// The test of a campaign is named `campaign_NAME`. `./test --campaign NAME` runs all of its seeds and writes `tests/campaigns/NAME.toml`
/// (seeds, figures, commit); any other run takes the first tenth of the seeds and compares its figures with that file.
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
    n: u64,
    full: bool,
    figures: Vec<(&'static str, f64)>,
}

impl Campaign {
    /// A campaign of `n` seeds (at least ten), or of the first tenth of them.
    pub fn start(name: &'static str, n: u64) -> Self {
        assert!(n >= 10, "a campaign has at least ten seeds");
        let full = std::env::var("SUNGLINT_CAMPAIGN").is_ok_and(|wanted| wanted == name);
        Self { name, n: if full { n } else { n / 10 }, full, figures: Vec::new() }
    }

    /// The seeds of this run.
    pub fn seeds(&self) -> std::ops::Range<u64> {
        0..self.n
    }

    /// The largest of something over the seeds: a tenth's cannot exceed the whole's by more than rounding.
    pub fn largest(&mut self, figure: &'static str, value: f64) {
        self.figures.push((figure, value));
    }

    /// Writes the figures of a whole campaign, or compares those of a tenth with the ones that are written.
    ///
    /// # Panics
    /// Where the file is missing or a figure of the tenth exceeds the whole's: the promise, or the file, is out of date.
    pub fn finish(self) {
        let path = self.path();
        if self.full {
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
                self.n
            );
        }
    }

    fn path(&self) -> PathBuf {
        repository().join("tests/campaigns").join(format!("{}.toml", self.name))
    }

    fn toml(&self) -> String {
        let commit = std::process::Command::new("git")
            .args(["rev-parse", "--short", "HEAD"])
            .current_dir(repository())
            .output()
            .map(|out| String::from_utf8_lossy(&out.stdout).trim().to_owned())
            .unwrap_or_default();
        let mut text = format!(
            "# Written by ./test --campaign {}\nfirst_seed = 0\nseeds = {}\ncommit = \"{commit}\"\n\n[figures]\n",
            self.name, self.n
        );
        for (figure, value) in &self.figures {
            let _ = writeln!(text, "{figure} = {value:e}");
        }
        text
    }
}
