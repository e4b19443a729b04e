//! What `sunglint compare` says: text, JSON, tables.

use super::compared::{Compared, Pairs};
use super::measured::magnitude;
use super::{Quantity, figure, page};
use serde_json::{Value, json};
use std::fmt::Write as _;
use sunglint_calibration::comparison::{Axis, Bin, Numbers, Ratio};
use sunglint_formats::flag_bits::bit_names;
use sunglint_formats::time::{format_utc, format_utc_shortest};
use sunglint_formats::{Column, Table};
use sunglint_radiometry::light_curve::{Flags, Input};
use sunglint_report::explain;
use sunglint_report::{Product, rounded};
use sunglint_simulator::light::percent;
use sunglint_simulator::pass::WITHIN_AN_EXPOSURE;

pub(super) const COMMAND: &str = "sunglint compare";

/// What a value and its uncertainty look like: digits of the value down to the second of the uncertainty.
pub(super) fn with_error(value: f64, sigma: Option<f64>) -> String {
    match sigma.filter(|s| *s > 0.0 && s.is_finite()) {
        None => format!("{value:.4}"),
        Some(sigma) => {
            let places = (1.0 - sigma.log10().floor()).clamp(0.0, 9.0) as usize;
            format!("{value:.places$} ± {sigma:.places$}")
        }
    }
}

fn or_dash(value: Option<f64>, write: impl Fn(f64) -> String) -> String {
    value.map_or("-".into(), write)
}

impl Compared<'_> {
    /// Table, figures, page and summary.
    pub fn product(&self) -> anyhow::Result<Product> {
        let good = |c: char| c.is_ascii_alphanumeric() || "-_".contains(c);
        let name = format!("{}_compared", self.simulation.pass.name.replace(|c| !good(c), "_"));
        let residuals = Product {
            name: format!("{name}_residuals"),
            figure: figure::residuals(self),
            ..Product::default()
        };
        let others = residuals.figure.is_some().then_some(residuals);
        Ok(Product {
            name,
            table: self.table(),
            figure: Some(figure::curves(self)),
            html: Some(page::report(self).html()),
            json: self.json(),
            others: others.into_iter().collect(),
            ..Product::default()
        })
    }

    /// The files that went in: the measurement, what that was made of, the scene and its files.
    pub fn inputs(&self) -> Vec<Input> {
        let mut inputs = vec![self.measured.input.clone()];
        for input in self.measured.inputs.iter().chain(&self.simulation.pass.inputs) {
            if !inputs.contains(input) {
                inputs.push(input.clone());
            }
        }
        inputs
    }

    /// What is not in the simulation; change within an exposure is, here.
    pub fn not_modelled(&self) -> Vec<String> {
        let all = self.simulation.not_modelled();
        all.into_iter().filter(|what| what != WITHIN_AN_EXPOSURE).collect()
    }

    /// How exposures were averaged, in words.
    pub fn averaging(&self) -> String {
        let cut = self.means.pieces.iter().filter(|p| **p > 1).count();
        format!(
            "means over the exposures, {cut} of {} cut into pieces; the middle would be off by up to {}{}",
            self.means.pieces.len(),
            percent(self.means.largest_change),
            if self.measured.exposure_s.is_none() {
                " (the file names no exposures: the scene's were taken)"
            } else {
                ""
            }
        )
    }

    /// The summary.
    pub fn text(&self) -> String {
        let mut text = format!("{}\n", self.title());
        let times = &self.measured.times;
        let (first, last) = (times[self.rows[0]], times[self.rows[self.rows.len() - 1]]);
        let (used, all) = self.numbers();
        let _ = writeln!(text, "  measured   {}", self.measured.path.display());
        let _ = writeln!(
            text,
            "  compared   {used} of {all} samples, {} to {}",
            format_utc(first, 1),
            format_utc(last, 1)
        );
        if let Quantity::Flux(kind) = self.measured.quantity {
            let _ = writeln!(text, "  magnitudes {}", kind.name());
        }
        let _ = writeln!(text, "  exposures  {}\n", self.averaging());
        self.say_channels(&mut text);
        self.say_left_out(&mut text);
        self.say_budget(&mut text);
        self.say_ratios(&mut text);
        let _ = writeln!(
            text,
            "cost: {:.3} s on {} threads for {} epochs, {:.3} s for the means over their exposures ({} moments more)",
            self.effort.middles.total_s,
            self.effort.middles.threads,
            self.rows.len(),
            self.effort.means.total_s,
            self.means.moments,
        );
        text.push_str("nothing was fitted but the scales: size, materials and attitude are as the scene gives them\n");
        text
    }

    fn say_channels(&self, text: &mut String) {
        let _ = writeln!(
            text,
            "  {:<10} {:>7}  {:<22} {:>9} {:>9} {:>9} {:>10} {:>11} {:>11}",
            "channel",
            "samples",
            "measured/simulated",
            "median",
            "scatter",
            "noise",
            "red. chi2",
            "w. twinkl.",
            "past stated"
        );
        for pair in &self.pairs {
            let Some(n) = &pair.channel.numbers else {
                let _ = writeln!(text, "  {:<10} {:>7}", pair.channel.name, "none");
                continue;
            };
            let chi2 = |f: &dyn Fn(&sunglint_calibration::comparison::Chi2) -> Option<f64>| {
                or_dash(n.chi2.as_ref().and_then(f), |v| format!("{v:.2}"))
            };
            let _ = writeln!(
                text,
                "  {:<10} {:>7}  {:<22} {:>9.4} {:>9} {:>9} {:>10} {:>11} {:>11}",
                pair.channel.name,
                n.samples,
                with_error(n.scale, n.scale_total()),
                n.median,
                percent(n.scatter),
                or_dash(n.noise, percent),
                chi2(&|c| Some(c.data)),
                chi2(&|c| c.with_twinkling),
                chi2(&|c| Some(c.past_stated)),
            );
            if let Some([mean, rms, about]) = n.magnitudes.filter(|_| !self.is_rate()) {
                let _ = writeln!(
                    text,
                    "  {:<10} measured less simulated: mean {mean:+.3} mag, rms {rms:.3} mag, scatter about the mean {about:.3} mag",
                    ""
                );
            }
        }
    }

    fn say_left_out(&self, text: &mut String) {
        for pair in self.pairs.iter().filter(|p| p.channel.left_out.samples > 0) {
            let _ = writeln!(text, "  {:<10} {}", pair.channel.name, pair.channel.left_out);
        }
        text.push('\n');
    }

    fn say_budget(&self, text: &mut String) {
        text.push_str("  what is claimed   data's noise   twinkling   common to all (kappa)   simulation, median / largest\n");
        for pair in &self.pairs {
            let Some(n) = &pair.channel.numbers else { continue };
            let _ = writeln!(
                text,
                "  {:<17} {:>12} {:>11} {:>23} {:>13} / {}",
                pair.channel.name,
                or_dash(n.noise, percent),
                or_dash(n.twinkling, percent),
                or_dash(n.common_sigma, percent),
                percent(n.stated.0),
                percent(n.stated.1),
            );
        }
        text.push('\n');
    }

    fn say_ratios(&self, text: &mut String) {
        if self.ratios.is_empty() {
            return;
        }
        text.push_str("  ratios of channels, measured over simulated\n");
        for ratio in &self.ratios {
            let own = ratio.sigma_blocks.into_iter().chain(ratio.sigma).reduce(f64::max);
            let _ = writeln!(
                text,
                "  {:<17} {:<22} kappa {}",
                format!("{}/{}", ratio.channel, ratio.reference),
                with_error(ratio.scale, own),
                or_dash(ratio.common_sigma, |s| format!("± {}", percent(s))),
            );
        }
        text.push('\n');
    }

    /// A row a measured one.
    fn table(&self) -> Table {
        let mut table = Table::default();
        let mut meta = |key: &str, value: Value| table.meta.insert(key.into(), value);
        meta("title", json!(self.title()));
        meta("flag_bits", bit_names::<Flags>());
        let mut provenance = self.simulation.provenance(COMMAND);
        provenance.inputs = self.inputs();
        meta("provenance", provenance.to_json());
        meta("channels", self.json_channels());
        let times = self.measured.times.iter().map(|t| format_utc_shortest(*t)).collect();
        table.columns.push(Column::text("time_utc", times));
        let mut number = |name: String, unit: Option<&str>, what: &str, values: Vec<f64>| {
            table.columns.push(Column::f64(name, unit, values).described(what));
        };
        number("exposure_s".into(), Some("s"), "", self.exposure_s.clone());
        let as_read = |values: &[f64]| match self.measured.quantity {
            Quantity::Rate => values.to_vec(),
            Quantity::Flux(_) => values.iter().map(|v| magnitude(*v)).collect(),
        };
        let relative = |errors: &[f64], values: &[f64]| match self.measured.quantity {
            Quantity::Rate => errors.to_vec(),
            Quantity::Flux(_) => {
                let to_mag = 2.5 / std::f64::consts::LN_10;
                errors.iter().zip(values).map(|(e, v)| to_mag * e / v).collect()
            }
        };
        let (end, unit) = match self.measured.quantity {
            Quantity::Rate => ("hz", "Hz"),
            Quantity::Flux(_) => ("mag", "mag"),
        };
        let mut flags = Vec::new();
        for Pairs { measured, simulated, model_error, channel, .. } in &self.pairs {
            let name = &measured.name;
            number(
                format!("{name}_measured_{end}"),
                Some(unit),
                "as the file has it",
                as_read(&measured.value),
            );
            number(
                format!("{name}_sigma_{end}"),
                Some(unit),
                "its standard uncertainty",
                relative(&measured.sigma, &measured.value),
            );
            number(
                format!("{name}_simulated_{end}"),
                Some(unit),
                "mean over the exposure, not scaled",
                as_read(simulated),
            );
            number(
                format!("{name}_model_error_{end}"),
                Some(unit),
                "its stated error, a bound",
                relative(model_error, simulated),
            );
            flags.push((name.clone(), &measured.flags, &channel.used));
        }
        for (name, unit, values) in [
            ("range_m", "m", &self.course.range_m),
            ("phase_deg", "deg", &self.course.phase_deg),
            ("zenith_deg", "deg", &self.course.zenith_deg),
        ] {
            number(name.into(), Some(unit), "", values.clone());
        }
        number("airmass".into(), None, "", self.course.airmass.clone());
        for (name, flags, used) in flags {
            let bits = flags.iter().map(|f| i64::from(f.bits())).collect();
            table.columns.push(Column::i64(format!("{name}_flags"), None, bits));
            let used = used.iter().map(|u| i64::from(*u)).collect();
            let column = Column::i64(format!("{name}_used"), None, used);
            table.columns.push(column.described("1: the sample counts"));
        }
        for column in &mut table.columns {
            column.description = column.description.take().filter(|text| !text.is_empty());
        }
        table
    }

    fn json_channels(&self) -> Value {
        self.pairs.iter().map(json_channel).collect()
    }

    fn json(&self) -> Value {
        let pass = self.simulation.pass;
        let times = &self.measured.times;
        let (first, last) = (times[self.rows[0]], times[self.rows[self.rows.len() - 1]]);
        let (used, all) = self.numbers();
        let inputs = self.inputs();
        json!({
            "measured": self.measured.path.display().to_string(),
            "quantity": match self.measured.quantity {
                Quantity::Rate => "calibrated",
                Quantity::Flux(kind) => kind.name(),
            },
            "pass": pass.name,
            "target": { "name": self.measured.target, "simulated_as": pass.target.name },
            "station": { "name": pass.station.name },
            "night": self.measured.kappa.as_ref().map(|k| &k.night),
            "from_utc": format_utc(first, 3), "to_utc": format_utc(last, 3),
            "samples": all, "used": used,
            "channels": self.json_channels(),
            "ratios": self.ratios.iter().map(json_ratio).collect::<Vec<_>>(),
            "exposures": { "cut": self.means.pieces.iter().filter(|p| **p > 1).count(), "coarse": self.means.coarse,
                "largest_change": rounded(self.means.largest_change), "moments": self.means.moments },
            "tolerance": pass.tolerance,
            "needs": explain::json(&self.simulation.needs),
            "not_modelled": self.not_modelled(),
            "cost": { "total_s": rounded(self.effort.middles.total_s + self.effort.means.total_s),
                "threads": self.effort.middles.threads },
            "inputs": inputs.iter().map(|i| json!({ "file": i.file, "sha256": i.sha256 })).collect::<Vec<_>>(),
            "warnings": self.warnings,
        })
    }
}

fn json_channel(pair: &Pairs) -> Value {
    let channel = &pair.channel;
    let left_out = &channel.left_out;
    let reasons: serde_json::Map<String, Value> =
        left_out.reasons.iter().map(|(reason, n)| (reason.name(), json!(n))).collect();
    let bins = |axis: Axis| {
        let own = pair.bins.iter().find(|(a, _)| *a == axis);
        own.map(|(_, bins)| bins.iter().map(json_bin).collect::<Vec<_>>())
    };
    json!({
        "name": channel.name, "samples": channel.samples, "used": channel.samples - left_out.samples,
        "left_out": reasons, "numbers": channel.numbers.as_ref().map(json_numbers),
        "by_phase": bins(Axis::Phase), "by_airmass": bins(Axis::Airmass),
    })
}

fn json_numbers(n: &Numbers) -> Value {
    let number = |v: Option<f64>| v.filter(|v| v.is_finite()).map(rounded);
    json!({
        "scale": rounded(n.scale), "scale_sigma": number(n.scale_sigma), "scale_sigma_blocks": number(n.scale_sigma_blocks),
        "kappa_sigma": number(n.common_sigma), "scale_interval": n.scale_interval().map(|(a, b)| [rounded(a), rounded(b)]),
        "median": number(Some(n.median)), "scatter": number(Some(n.scatter)), "rms": number(Some(n.rms)),
        "noise": number(n.noise), "twinkling": number(n.twinkling),
        "stated_error": { "median_relative": number(Some(n.stated.0)), "largest_relative": number(Some(n.stated.1)) },
        "mean_mag": n.magnitudes.map(|m| rounded(m[0])), "rms_mag": n.magnitudes.map(|m| rounded(m[1])),
        "scatter_mag": n.magnitudes.map(|m| rounded(m[2])),
        "chi2": n.chi2.map(|c| json!({ "data": rounded(c.data), "with_twinkling": number(c.with_twinkling),
            "past_stated": rounded(c.past_stated), "unscaled": rounded(c.unscaled) })),
    })
}

fn json_bin(bin: &Bin) -> Value {
    json!({ "from": rounded(bin.from), "to": rounded(bin.to), "samples": bin.samples,
        "ratio": rounded(bin.ratio), "sigma": bin.sigma.map(rounded) })
}

fn json_ratio(ratio: &Ratio) -> Value {
    json!({ "channel": ratio.channel, "reference": ratio.reference, "scale": rounded(ratio.scale),
        "scale_sigma": ratio.sigma.map(rounded), "scale_sigma_blocks": ratio.sigma_blocks.map(rounded),
        "kappa_sigma": ratio.common_sigma.map(rounded) })
}
