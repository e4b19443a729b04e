//! Channels of a run: the bands of a spectrometer, the wavelengths of a monochromator, the bands in the files of an instrument that cannot be driven.
//!
//! A place of the run has one value for each channel. The incident beam is measured in the same channels, so that a channel's responsivity cancels; what does not cancel is a response
//! that is not linear.

use crate::retro::plan::VIRTUAL;
use serde::Deserialize;
use std::path::PathBuf;
use sunglint_formats::ParseError;
use sunglint_formats::toml::{Document, NonNegative, Positive};
use sunglint_numerics::measured::Interval;

/// Most channels of a run.
pub const MOST: usize = 2000;
/// Integration times of a spectrometer that chooses by itself, s.
pub const LADDER_S: [f64; 4] = [0.01, 0.05, 0.25, 1.25];

/// A channel.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(from = "[f64; 2]")]
pub struct Band {
    /// Middle, nm.
    pub nm: f64,
    /// Width, nm; 0 of a monochromator's wavelength.
    pub width_nm: f64,
}

impl From<[f64; 2]> for Band {
    fn from([nm, width_nm]: [f64; 2]) -> Self {
        Self { nm, width_nm }
    }
}

impl Band {
    /// Both ends, nm.
    #[must_use]
    pub fn ends_nm(&self) -> Interval {
        Interval::new(self.nm - 0.5 * self.width_nm, self.nm + 0.5 * self.width_nm)
    }
}

/// Bands side by side in the file.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Even {
    /// Middle of the first band, nm.
    pub from_nm: Positive,
    /// Middle of the last band, nm.
    pub to_nm: Positive,
    /// Step from one to the next, and their width, nm.
    pub step_nm: Positive,
}

impl Even {
    fn bands(&self) -> Option<Vec<Band>> {
        let (from, to, step) = (self.from_nm.get(), self.to_nm.get(), self.step_nm.get());
        let steps = ((to - from) / step).round();
        // A last band elsewhere than at to_nm is none that was asked for.
        let is_whole = (from + step * steps - to).abs() <= 1e-3 * step;
        if !(0.0..MOST as f64).contains(&steps) || !is_whole {
            return None;
        }
        let band = |k: usize| Band { nm: from + step * k as f64, width_nm: step };
        Some((0..=steps as usize).map(band).collect())
    }
}

/// Integration of a spectrometer in the file.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum Integration {
    /// Always the same, s.
    One(f64),
    /// Times to choose from, s.
    Several(Vec<f64>),
    /// The word `auto`.
    Word(String),
}

/// The spectrometer in the file.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SpectrometerPlan {
    /// Address of the device in the catalogue of drivers.
    pub device: String,
    /// Options for its driver, `NAME=VALUE` each.
    pub with: Vec<String>,
    /// Middle and width of each channel, nm.
    pub channels_nm: Vec<Band>,
    /// Channels side by side.
    pub bands: Option<Even>,
    /// Integration, s.
    pub integration_s: Integration,
    /// Spectra that are averaged for a reading.
    pub average: u32,
    /// Value at which the converter ends, where the spectrometer does not tell.
    pub saturation_counts: Option<Positive>,
    /// Wait after a move, s.
    pub settle_s: NonNegative,
    /// How long a spectrum may take beyond its integration and the one that is thrown away before it, s.
    pub timeout_s: Positive,
}

/// Numbers that are written here are good ones.
fn good<T>(number: Option<T>) -> T {
    match number {
        Some(number) => number,
        None => unreachable!("a default is in its range"),
    }
}

impl Default for SpectrometerPlan {
    fn default() -> Self {
        Self {
            device: VIRTUAL.into(),
            with: vec![],
            channels_nm: vec![],
            bands: None,
            integration_s: Integration::Word("auto".into()),
            average: 1,
            saturation_counts: None,
            settle_s: good(NonNegative::new(0.5)),
            timeout_s: good(Positive::new(10.0)),
        }
    }
}

impl SpectrometerPlan {
    /// Integrations from the shortest to the longest, s.
    #[must_use]
    pub fn integrations_s(&self) -> Vec<f64> {
        match &self.integration_s {
            Integration::One(s) => vec![*s],
            Integration::Several(all) => all.clone(),
            Integration::Word(_) => LADDER_S.to_vec(),
        }
    }
}

/// The monochromator in the file.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MonochromatorPlan {
    /// Address of the device in the catalogue of drivers.
    pub device: String,
    /// Options for its driver, `NAME=VALUE` each.
    pub with: Vec<String>,
    /// Wavelengths at each place, in turn, nm.
    pub wavelengths_nm: Vec<f64>,
    /// How far from the wavelength that was asked for it may stand, nm.
    pub tolerance_nm: Positive,
    /// How long a move may take, s.
    pub timeout_s: Positive,
    /// Time of a move for the estimate, s.
    pub move_s: NonNegative,
}

impl Default for MonochromatorPlan {
    fn default() -> Self {
        Self {
            device: VIRTUAL.into(),
            with: vec![],
            wavelengths_nm: vec![],
            tolerance_nm: good(Positive::new(0.5)),
            timeout_s: good(Positive::new(60.0)),
            move_s: good(NonNegative::new(1.0)),
        }
    }
}

/// The folder into which an instrument that cannot be driven writes its files.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FilesPlan {
    /// The folder.
    pub folder: PathBuf,
    /// Names of the files: `*` stands for any letters, `?` for one.
    #[serde(default = "pattern")]
    pub pattern: String,
    /// Middle and width of each channel, nm.
    #[serde(default)]
    pub channels_nm: Vec<Band>,
    /// Channels side by side.
    #[serde(default)]
    pub bands: Option<Even>,
    /// Files at a place.
    #[serde(default = "one")]
    pub readings: u32,
    /// How long a file must not have changed before it is read, s.
    #[serde(default = "complete")]
    pub complete_s: Positive,
    /// Time of a file for the estimate, s.
    #[serde(default = "each")]
    pub each_s: NonNegative,
}

fn pattern() -> String {
    "*.csv".into()
}

fn one() -> u32 {
    1
}

fn complete() -> Positive {
    good(Positive::new(2.0))
}

fn each() -> NonNegative {
    good(NonNegative::new(60.0))
}

/// Detector of a bench.
#[derive(Debug, Clone, PartialEq)]
pub enum Reads {
    /// The power meter, at one wavelength.
    Meter,
    /// A spectrometer.
    Spectrometer(SpectrometerPlan),
    /// The power meter behind a monochromator.
    Monochromator(MonochromatorPlan),
    /// Files that somebody else writes.
    Files(FilesPlan),
}

impl Reads {
    /// Unit of a channel's values, as a table has it; none of files, which do not say it.
    #[must_use]
    pub fn unit(&self) -> Option<&'static str> {
        match self {
            Self::Meter | Self::Monochromator(_) => Some("W"),
            Self::Spectrometer(_) => Some("ct / s"),
            Self::Files(_) => None,
        }
    }

    /// Whether a line of the run holds all channels at once.
    #[must_use]
    pub fn is_at_once(&self) -> bool {
        matches!(self, Self::Spectrometer(_) | Self::Files(_))
    }
}

/// The channels that the keys of a table say, increasing.
pub(super) fn bands(
    document: &Document,
    table: &str,
    channels_nm: &[Band],
    even: Option<&Even>,
) -> Result<Vec<Band>, ParseError> {
    let list = format!("{table}.channels_nm");
    let found = match (channels_nm, even) {
        ([], None) => {
            let expected = "channels as [[middle, width], …] in nm, or bands = { from_nm = 450, to_nm = 650, step_nm = 10 }";
            return Err(document.error_at(&list, expected));
        }
        ([], Some(even)) => even.bands().ok_or_else(|| {
            let expected = "from_nm up to to_nm, a whole number of steps of step_nm, at most 2000";
            document.error_at(&format!("{table}.bands"), expected)
        })?,
        (listed, None) => listed.to_vec(),

        (_, Some(_)) => {
            let expected = "channels_nm or bands, not both";
            return Err(document.error_at(&format!("{table}.bands"), expected));
        }
    };
    let good = |band: &Band| {
        band.nm.is_finite()
            && band.width_nm.is_finite()
            && band.width_nm > 0.0
            && band.ends_nm().low > 0.0
    };
    let is_rising = found.windows(2).all(|w| w[0].nm < w[1].nm);
    if found.len() > MOST || !found.iter().all(good) || !is_rising {
        let expected =
            "at most 2000 channels with rising middles, each wider than 0 and above 0 nm";
        let key = if channels_nm.is_empty() { format!("{table}.bands") } else { list };
        return Err(document.error_at(&key, expected));
    }
    Ok(found)
}

/// Looks at the keys of a spectrometer.
pub(super) fn check_spectrometer(
    document: &Document,
    plan: &SpectrometerPlan,
) -> Result<(), ParseError> {
    let key = "spectrometer.integration_s";
    if let Integration::Word(word) = &plan.integration_s
        && word != "auto"
    {
        return Err(document.error_at(key, "seconds, a list of seconds, or \"auto\""));
    }
    let all = plan.integrations_s();
    let good = all.iter().all(|s| (1e-6..=3600.0).contains(s));
    if all.is_empty() || all.len() > 20 || !good || !all.windows(2).all(|w| w[0] < w[1]) {
        let expected = "1e-6 to 3600 s; of a list at most 20 times, rising";
        return Err(document.error_at(key, expected));
    }
    if !(1..=10_000).contains(&plan.average) {
        return Err(document.error_at("spectrometer.average", "1 to 10000 spectra"));
    }
    Ok(())
}

/// The wavelengths of a monochromator.
pub(super) fn wavelengths(
    document: &Document,
    plan: &MonochromatorPlan,
) -> Result<Vec<Band>, ParseError> {
    let all = &plan.wavelengths_nm;
    let good = all.iter().all(|nm| (1.0..=1e6).contains(nm));
    if all.is_empty() || all.len() > MOST || !good || !all.windows(2).all(|w| w[0] < w[1]) {
        let expected = "1 to 2000 rising wavelengths in nm, such as [450, 550, 650]";
        return Err(document.error_at("monochromator.wavelengths_nm", expected));
    }
    Ok(all.iter().map(|nm| Band { nm: *nm, width_nm: 0.0 }).collect())
}

/// Whether a name is one of a pattern: `*` stands for any letters, `?` for one; capital letters are as small ones.
#[must_use]
pub fn is_of(pattern: &str, name: &str) -> bool {
    let letters = |text: &str| text.to_lowercase().chars().collect::<Vec<char>>();
    let (pattern, name) = (letters(pattern), letters(name));
    // Where the name goes on if what stands for any letters takes one more.
    let (mut p, mut n, mut again) = (0, 0, None);
    while n < name.len() {
        match pattern.get(p) {
            Some('*') => {
                again = Some((p + 1, n));
                p += 1;
            }
            Some(letter) if *letter == '?' || *letter == name[n] => (p, n) = (p + 1, n + 1),
            _ => {
                let Some((from, taken)) = again else { return false };
                again = Some((from, taken + 1));
                (p, n) = (from, taken + 1);
            }
        }
    }
    pattern[p..].iter().all(|letter| *letter == '*')
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: what shells say of these patterns.
    #[test]
    fn names_of_patterns() {
        for (pattern, name, is) in [
            ("*.csv", "a.csv", true),
            ("*.csv", "A.CSV", true),
            ("*.csv", "a.csv.part", false),
            ("panel.????", "panel.0003", true),
            ("panel.????", "panel.003", false),
            ("*a*b*", "xxaxxaxb", true),
            ("*a*b*", "xxbxx", false),
            ("", "", true),
            ("*", "", true),
        ] {
            assert_eq!(is_of(pattern, name), is, "{pattern} {name}");
        }
    }
}
