//! `sunglint analyse endmembers`: the spectra that a curve is made of, nobody having said which.

use super::unmix::{Given, GivenArgs, column_name, endmembers};
use crate::output::{Console, OutputArgs};
use anyhow::{Context as _, bail};
use clap::Args;
use ndarray::Array2;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::path::PathBuf;
use sunglint_analysis::unmix::nnls::Constraint;
use sunglint_analysis::unmix::{
    AtgpOptions, Endmember, Targets, Values, atgp, spectral_angle_rad, unmix,
};
use sunglint_formats::time::format_utc_shortest;
use sunglint_formats::{Column, Table};
use sunglint_radiometry::air::Zenith;
use sunglint_report::plot::{Axis, Figure, Panel, Series};
use sunglint_report::{Product, rounded};
use sunglint_simulator::surface::Material;

/// What noise leaves of a sample is this much longer than its own standard uncertainty now and then, among thousands of samples.
const NOISE: f64 = 1.5;

/// Samples with less light than this of the brightest have no colour to speak of.
const FAINT: f64 = 1e-3;
/// Nor have those that are so many times as noisy as most.
const NOISIER: f64 = 2.0;

/// Arguments of `sunglint analyse endmembers`.
#[derive(Debug, Args)]
pub struct EndmembersArgs {
    /// The curve: calibrated or predicted rates (ECSV), or spectra of `simulate` (FITS)
    pub curve: PathBuf,
    /// As many at most
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..))]
    pub most: u32,
    /// What of a sample is taken for noise, as a share of it [default: by the curve's own uncertainties]
    #[arg(long, value_name = "SHARE", allow_negative_numbers = true)]
    pub noise: Option<f64>,
    /// Known materials to hold them against: built-in ones, all of a target, or the columns of a file, as in `unmix`
    #[arg(long, value_name = "NAME|FILE", value_delimiter = ',')]
    pub against: Vec<String>,
    /// Under what light it was taken.
    #[command(flatten)]
    pub given: GivenArgs,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// What was found.
struct Found<'a> {
    given: &'a Given,
    /// Middle of each band, nm; bands in their order.
    middles_nm: Vec<f64>,
    bands: Vec<String>,
    targets: Targets,
    /// Of the rows that were searched: which sample each is.
    samples: Vec<usize>,
    noise: f64,
    known: Vec<String>,
    /// Reflection factors of the known ones, bands × known.
    factors: Array2<f64>,
    warnings: Vec<String>,
}

/// Finds them.
pub fn run(args: &EndmembersArgs, console: Console) -> anyhow::Result<()> {
    args.out.check_with(console)?;
    args.out.check()?;
    if let Some(noise) = args.noise
        && !(0.0..1.0).contains(&noise)
    {
        bail!("--noise is {noise}, expected a share from 0 to below 1");
    }
    let mut warnings = Vec::new();
    let (known, _) = match args.against.is_empty() {
        true => Default::default(),
        false => endmembers(&args.against, &mut warnings)?,
    };
    let given = Given::read(&args.curve, &args.given)?;
    // A white one alone gives the reflection factors; known ones are only compared with.
    let white = Material::built_in("white").context("the built-in material white")?;
    let white = Endmember { name: white.name.clone(), reflectance: white.normal_colour()?.0 };
    let all: Vec<Endmember> = std::iter::once(white).chain(known).collect();
    let bands = given.bands(&all)?;
    let (lights, numbers) = given.samples(&mut warnings)?;
    let values = Values {
        value: numbers.value.view(),
        sigma: numbers.sigma.as_ref().map(|s| s.view()),
        valid: numbers.valid.view(),
    };
    let only_white = given.bands(&all[..1])?;
    let found = unmix(&only_white, &lights, values, Constraint::Free)?;
    let count = bands.names.len();
    let whole = |k: &usize| found[*k].factors.iter().all(|f| f.is_finite());
    let samples: Vec<usize> = (0..found.len()).filter(whole).collect();
    if samples.is_empty() {
        bail!(
            "{}: no sample has a valid value in each of its {count} bands: nothing to search",
            args.curve.display()
        );
    }
    if samples.len() < found.len() {
        let left = found.len() - samples.len();
        warnings.push(format!("{left} samples without a valid value in each band are left out"));
    }
    let length = |values: &[f64]| values.iter().map(|v| v * v).sum::<f64>().sqrt();
    let brightest = samples.iter().map(|k| length(&found[*k].factors)).fold(0.0, f64::max);
    // The part of a sample that is noise. Of samples that are much noisier than most, as of faint ones, the colour is not known well enough.
    let noise_of = |k: usize| length(&found[k].factor_sigma) / length(&found[k].factors);
    let mut parts: Vec<f64> =
        samples.iter().map(|k| noise_of(*k)).filter(|n| n.is_finite()).collect();
    parts.sort_by(f64::total_cmp);
    let usual = parts.get(parts.len() / 2).copied().unwrap_or(0.0);
    let before = samples.len();
    let samples: Vec<usize> = samples
        .into_iter()
        .filter(|k| length(&found[*k].factors) > FAINT * brightest)
        .filter(|k| usual == 0.0 || noise_of(*k) <= NOISIER * usual)
        .collect();
    if samples.len() < before {
        warnings.push(format!(
            "{} samples are left out, fainter than {FAINT} of the brightest or more than {NOISIER} times as noisy as most",
            before - samples.len()
        ));
    }
    let by_sigmas =
        NOISE * samples.iter().map(|k| noise_of(*k)).filter(|n| n.is_finite()).fold(0.0, f64::max);
    let noise = args.noise.unwrap_or(by_sigmas);
    if samples.is_empty() || noise >= 1.0 {
        bail!(
            "{}: the samples' own uncertainties are as large as their light: nothing stands out (--noise takes another level)",
            args.curve.display()
        );
    }
    // Each made as bright as any other: then all are means of the materials' own colours, with weights that add up to one, and the ones at the ends are pure if any are. As bright as it
    // was, a sample that shows much of several materials would come first.
    let sum = |k: usize| found[k].factors.iter().sum::<f64>();
    let searched = Array2::from_shape_fn((samples.len(), count), |(i, b)| {
        found[samples[i]].factors[b] / sum(samples[i])
    });
    let options = AtgpOptions { most: args.most as usize, noise, ..AtgpOptions::default() };
    let targets =
        atgp(searched.view(), &options).with_context(|| args.curve.display().to_string())?;
    if by_sigmas == 0.0 && args.noise.is_none() {
        warnings.push(
            "the curve has no uncertainties: every ripple counts as a material of its own; --noise SHARE says what does not".into(),
        );
    }
    let zenith = lights.iter().map(|l| l.zenith).find(|z| bands.at(*z).is_ok());
    let factors = bands.at(zenith.unwrap_or(Zenith::Apparent(0.0)))?.matrix;
    for warning in &warnings {
        console.warn(warning);
    }
    let found = Found {
        middles_nm: given.middles_nm()?,
        bands: bands.names.clone(),
        known: bands.endmembers[1..].to_vec(),
        factors: factors.slice(ndarray::s![.., 1..]).to_owned(),
        given: &given,
        targets,
        samples,
        noise,
        warnings,
    };
    args.out.finish(&found.product(), &found.text(), console)
}

impl Found<'_> {
    /// The spectrum of an endmember, its largest value 1: how much of a sample it was, one curve cannot say.
    fn spectrum(&self, k: usize) -> Vec<f64> {
        let spectrum = &self.targets.targets[k].spectrum;
        let most = spectrum.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        spectrum.iter().map(|v| v / most).collect()
    }

    /// The known one that is nearest in colour, and by which angle.
    fn nearest(&self, k: usize) -> Option<(&str, f64)> {
        let own = &self.targets.targets[k].spectrum;
        let angles =
            self.factors.columns().into_iter().map(|c| spectral_angle_rad(own, &c.to_vec()));
        let named = self.known.iter().zip(angles);
        named.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(name, angle)| (name.as_str(), angle))
    }

    fn time(&self, k: usize) -> String {
        let sample = self.targets.targets[k].sample.map(|row| self.samples[row]);
        sample.map_or(String::new(), |s| format_utc_shortest(self.given.curve.samples().time[s]))
    }

    fn count(&self) -> usize {
        self.targets.targets.len()
    }

    /// The bands by wavelength.
    fn order(&self) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.middles_nm.len()).collect();
        order.sort_by(|a, b| self.middles_nm[*a].total_cmp(&self.middles_nm[*b]));
        order
    }

    fn title(&self) -> String {
        format!("Endmembers in the light of {}", self.given.curve.target())
    }

    fn product(&self) -> Product {
        Product {
            name: "endmembers".into(),
            table: self.table(),
            figure: self.figure(),
            json: self.json(),
            ..Product::default()
        }
    }

    fn table(&self) -> Table {
        let order = self.order();
        let mut table = Table::default();
        table.meta.insert("title".into(), json!(self.title()));
        table.meta.insert(
            "bands".into(),
            json!(order.iter().map(|b| &self.bands[*b]).collect::<Vec<_>>()),
        );
        table.meta.insert(
            "provenance".into(),
            json!({"program": concat!("sunglint ", env!("CARGO_PKG_VERSION")), "command": "sunglint analyse endmembers", "target": self.given.curve.target(), "inputs": [&self.given.curve.input]}),
        );
        let middles = order.iter().map(|b| self.middles_nm[*b]).collect();
        table.columns.push(Column::f64("wavelength_nm", Some("nm"), middles));
        for k in 0..self.count() {
            let spectrum = self.spectrum(k);
            let near = self.nearest(k).map_or(String::new(), |(name, angle)| {
                format!("; {:.2}° from {name}", angle.to_degrees())
            });
            let said =
                format!("reflection factor, largest 1, of the sample of {}{near}", self.time(k));
            let values = order.iter().map(|b| spectrum[*b].max(0.0)).collect();
            table.columns.push(
                Column::f64(format!("found_{}_reflectance", k + 1), None, values).described(&said),
            );
        }
        table
    }

    /// Each endmember, with the known one that is nearest beside it.
    fn figure(&self) -> Option<Figure> {
        let order = self.order();
        let points = |values: &[f64]| -> Vec<(f64, f64)> {
            order.iter().map(|b| (self.middles_nm[*b], values[*b])).collect()
        };
        let x = || Axis::linear("wavelength (nm)");
        let panels = (0..self.count()).map(|k| {
            let own = self.spectrum(k);
            let mut series = vec![Series::dots(format!("found {}", k + 1), k, points(&own))];
            if let Some((name, angle)) = self.nearest(k) {
                let m = self.known.iter().position(|n| n == name).unwrap_or(0);
                let known = self.factors.column(m).to_vec();
                // Least squares in scale.
                let scale = known.iter().zip(&own).map(|(a, b)| a * b).sum::<f64>()
                    / known.iter().map(|a| a * a).sum::<f64>();
                let scaled: Vec<f64> = known.iter().map(|v| scale * v).collect();
                let label = format!("{name}, {:.2}° away", angle.to_degrees());
                series.push(Series::line(label, k, points(&scaled)));
            }
            Panel::new(x(), Axis::linear("of its largest").from_to(0.0, 1.1), series)
        });
        let panels: Vec<Panel> = panels.collect();
        (!panels.is_empty()).then(|| Figure { title: self.title(), panels })
    }

    fn text(&self) -> String {
        let mut text = format!(
            "{}: {} found in {} samples of {} bands ({})\n",
            self.title(),
            self.count(),
            self.samples.len(),
            self.bands.len(),
            self.targets.stopped
        );
        let _ = writeln!(text, "  number  new in it  sample                    nearest known");
        for (k, target) in self.targets.targets.iter().enumerate() {
            let near = self.nearest(k).map_or("-".into(), |(name, angle)| {
                format!("{name}, {:.2}° away", angle.to_degrees())
            });
            let _ = writeln!(
                text,
                "  {:>6}  {:>9.2e}  {:<24}  {near}",
                k + 1,
                target.rest,
                self.time(k)
            );
        }
        let _ = writeln!(
            text,
            "  they leave {:.1e} of a sample at most; {:.1e} is taken for noise",
            self.targets.left, self.noise
        );
        text += "  Each is a sample: a pure material only if that sample shows one alone.\n";
        text
    }

    fn json(&self) -> Value {
        let number = |v: f64| if v.is_finite() { json!(rounded(v)) } else { Value::Null };
        let found = (0..self.count()).map(|k| {
            let target = &self.targets.targets[k];
            let nearest = self.nearest(k).map(
                |(name, angle)| json!({ "name": column_name(name), "angle_deg": number(angle.to_degrees()) }),
            );
            json!({
                "time_utc": self.time(k), "rest": number(target.rest), "eta": number(target.eta),
                "spectrum": self.spectrum(k).iter().map(|v| number(*v)).collect::<Vec<_>>(), "nearest": nearest,
            })
        });
        json!({
            "target": self.given.curve.target(),
            "samples": self.samples.len(),
            "bands": self.bands.len(),
            "wavelengths_nm": self.middles_nm.iter().map(|v| number(*v)).collect::<Vec<_>>(),
            "endmembers": found.collect::<Vec<_>>(),
            "stopped": self.targets.stopped,
            "left": number(self.targets.left),
            "noise": number(self.noise),
            "warnings": self.warnings,
        })
    }
}
