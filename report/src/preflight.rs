//! Pre-flight of a night as a table.

use std::fmt::Write as _;
use sunglint_formats::text::plain;
use sunglint_observatory::{Level, Preflight};

/// Returns the findings, one a line, the worst first, and how many there are of each kind.
pub fn text(found: &Preflight) -> String {
    let width = found.findings.iter().map(|f| f.about.chars().count()).max().unwrap_or(0);
    let mut text = String::new();
    let mut counts = Vec::new();
    for (level, word) in
        [(Level::Error, "ERROR"), (Level::Warning, "warning"), (Level::Fine, "fine")]
    {
        for finding in found.of(level) {
            let (about, said) = (plain(&finding.about), plain(&finding.text));
            let _ = writeln!(text, "{word:<8}{about:<width$}  {said}");
        }
        counts.push(format!("{} {}", found.of(level).count(), word.to_lowercase()));
    }
    text + &counts.join(", ")
}
