//! What `analyse unmix` says: text, JSON, table, figure.

use super::super::numbers::Curve;
use super::confusion::Told;
use super::endmembers::column_name;
use serde_json::{Value, json};
use std::fmt::Write as _;
use sunglint_analysis::unmix::{Bands, Mixing, Mixture, State, Unmixed};
use sunglint_formats::flag_bits::bit_names;
use sunglint_formats::time::format_utc_shortest;
use sunglint_formats::{Column, Table};
use sunglint_radiometry::light_curve::Input;
use sunglint_report::plot::{Axis, Figure, Panel, Series, Style};
use sunglint_report::{Product, rounded};

pub struct Report<'a> {
    pub curve: &'a Curve,
    pub bands: &'a Bands,
    pub mixing: &'a Mixing,
    pub found: &'a [Unmixed],
    pub warnings: &'a [String],
    pub inputs: Vec<Input>,
    /// Whether weights are in m² sr⁻¹.
    pub is_absolute: bool,
    /// How the materials are taken for one another, where that was asked.
    pub told: Option<&'a Told>,
}

/// Why samples have no weights, with their numbers.
pub fn reasons(found: &[Unmixed]) -> String {
    let reasons = [
        (State::NO_DATA, "without a valid value in any band"),
        (State::BELOW_HORIZON, "below the horizon"),
        (State::ALIKE, "with bands in which endmembers are black or alike"),
        (State::NOT_UNIQUE, "where many answers fit alike"),
    ];
    let counted = reasons.iter().filter_map(|(state, words)| {
        let n = found.iter().filter(|u| u.mixture.is_none() && u.state.contains(*state)).count();
        (n > 0).then(|| format!("{n} {words}"))
    });
    counted.collect::<Vec<_>>().join(", ")
}

fn median(mut values: Vec<f64>) -> f64 {
    values.retain(|v| v.is_finite());
    values.sort_by(f64::total_cmp);
    if values.is_empty() { f64::NAN } else { values[values.len() / 2] }
}

impl Report<'_> {
    fn mixtures(&self) -> impl Iterator<Item = &Mixture> {
        self.found.iter().filter_map(|u| u.mixture.as_ref())
    }

    fn title(&self) -> String {
        format!("Materials in the light of {}", self.curve.target())
    }

    fn unit(&self) -> &'static str {
        if self.is_absolute { "m2 / sr" } else { "1 / sr" }
    }

    pub fn product(&self) -> anyhow::Result<Product> {
        Ok(Product {
            name: "materials".into(),
            table: self.table(),
            figure: self.figure(),
            json: self.json(),
            ..Product::default()
        })
    }

    fn table(&self) -> Table {
        let mut table = Table::default();
        let samples = self.curve.samples();
        table.meta.insert("title".into(), json!(self.title()));
        table.meta.insert("endmembers".into(), json!(self.bands.endmembers));
        table.meta.insert("state_bits".into(), bit_names::<State>());
        table.meta.insert(
            "provenance".into(),
            json!({"program": concat!("sunglint ", env!("CARGO_PKG_VERSION")), "command": "sunglint analyse unmix", "target": self.curve.target(), "inputs": self.inputs}),
        );
        let times = samples.time.iter().map(|t| format_utc_shortest(*t)).collect();
        table.columns.push(Column::text("time_utc", times));
        let number = |of: &dyn Fn(&Unmixed) -> f64| self.found.iter().map(of).collect::<Vec<_>>();
        for (m, name) in self.bands.endmembers.iter().enumerate() {
            let name = column_name(name);
            let of = |pick: fn(&Mixture) -> &Vec<f64>| {
                number(&|u| u.mixture.as_ref().map_or(f64::NAN, |x| pick(x)[m]))
            };
            let unit = Some(self.unit());
            let columns = [
                Column::f64(format!("{name}_weight"), unit, of(|x| &x.weights))
                    .described("its part of the reflection factor; exactly 0 at its bound"),
                Column::f64(format!("{name}_weight_sigma"), unit, of(|x| &x.sigma))
                    .described("standard uncertainty as if no bound held"),
                Column::f64(format!("{name}_share"), None, of(|x| &x.shares))
                    .described("weight over the sum of weights"),
                Column::f64(format!("{name}_share_sigma"), None, of(|x| &x.share_sigma)),
                Column::f64(format!("{name}_projected"), unit, of(|x| &x.projected))
                    .described("weight by orthogonal subspace projection: without bounds"),
            ];
            table.columns.extend(columns);
        }
        let of = |pick: fn(&Mixture) -> f64| number(&|u| u.mixture.as_ref().map_or(f64::NAN, pick));
        table.columns.extend([
            Column::f64("residual_relative", None, of(|x| x.residual_relative))
                .described("length of what is left over of the reflection factors, over theirs"),
            Column::f64("chi_squared", None, of(|x| x.chi_squared.unwrap_or(f64::NAN)))
                .described("nan where uncertainties are not known"),
            Column::f64("condition", None, number(&|u| u.condition)),
            Column::i64("bands", None, self.found.iter().map(|u| u.bands as i64).collect()),
            Column::i64(
                "state",
                None,
                self.found.iter().map(|u| i64::from(u.state.bits())).collect(),
            ),
        ]);
        table
    }

    /// Shares above one another, weights and what is left over; nothing where there is no light.
    fn figure(&self) -> Option<Figure> {
        let samples = self.curve.samples();
        let first = samples.time.first()?;
        let seconds: Vec<f64> = samples.time.iter().map(|t| (*t - *first).to_seconds()).collect();
        let x = || Axis::linear(format!("s since {}", format_utc_shortest(*first)));
        let points = |of: &dyn Fn(&Mixture) -> f64| -> Vec<(f64, f64)> {
            let all = seconds.iter().zip(self.found);
            all.map(|(s, u)| (*s, u.mixture.as_ref().map_or(f64::NAN, of))).collect()
        };
        let names = &self.bands.endmembers;
        // From the top of the pile down: each hides what of the ones above it lies below.
        let piled = (0..names.len()).rev().map(|m| {
            let line = Series::line(
                names[m].clone(),
                m,
                points(&|x| x.shares[..=m].iter().sum::<f64>().min(1.0)),
            );
            Series { style: Style::Area, ..line }
        });
        let weights =
            (0..names.len()).map(|m| Series::dots(names[m].clone(), m, points(&|x| x.weights[m])));
        let left = vec![Series::dots("", 6, points(&|x| x.residual_relative))];
        let words = if self.is_absolute { "weight (m² sr⁻¹)" } else { "weight (sr⁻¹)" };
        let shares = Axis::linear("share, piled").from_to(0.0, 1.0);
        let some = |points: &dyn Fn(&Mixture) -> bool| self.mixtures().any(points);
        let mut panels = Vec::new();
        if some(&|x| x.shares[0].is_finite()) {
            panels.push(Panel::new(x(), shares, piled.collect()));
            panels.push(Panel::new(x(), Axis::log(words), weights.collect()));
        }
        if some(&|x| x.residual_relative > 0.0) {
            panels.push(Panel::new(x(), Axis::log("left over, of the light"), left));
        }
        panels.extend(self.told.map(Told::panel));
        (!panels.is_empty()).then(|| Figure { title: self.title(), panels })
    }

    /// Mean and median over the samples that have shares.
    fn summary(&self, m: usize) -> (f64, f64, f64, usize) {
        let shares: Vec<f64> =
            self.mixtures().map(|x| x.shares[m]).filter(|v| v.is_finite()).collect();
        let mean = shares.iter().sum::<f64>() / shares.len() as f64;
        let sigma = median(self.mixtures().map(|x| x.share_sigma[m]).collect());
        let most = self.mixtures().map(|x| x.weights[m]).fold(0.0, f64::max);
        (mean, sigma, most, self.mixtures().filter(|x| x.bounded[m]).count())
    }

    pub fn text(&self) -> String {
        let unmixed = self.mixtures().count();
        let mut text = format!(
            "{}: {} of {} samples, {} bands, {} endmembers\n",
            self.title(),
            unmixed,
            self.found.len(),
            self.bands.names.len(),
            self.bands.endmembers.len()
        );
        let _ = writeln!(
            text,
            "  endmember            mean share   usual sigma   largest weight   at its bound"
        );
        for (m, name) in self.bands.endmembers.iter().enumerate() {
            let (mean, sigma, most, bounded) = self.summary(m);
            let sigma = if sigma.is_finite() { format!("{sigma:.4}") } else { "-".into() };
            let _ = writeln!(
                text,
                "  {name:<20} {mean:>10.4} {sigma:>13} {most:>12.4e} {:<8} {bounded:>6}",
                self.unit().replace(' ', "")
            );
        }
        let left = median(self.mixtures().map(|x| x.residual_relative).collect());
        let _ = writeln!(
            text,
            "  condition number {:.1}; usually {:.2e} of the light is left over",
            self.mixing.condition, left
        );
        if let Some(twins) = &self.mixing.nearest {
            let [a, b] = twins.pair.map(|k| self.bands.endmembers[k].as_str());
            let _ = writeln!(
                text,
                "  nearest to each other: {a} and {b}, {:.2}° apart",
                twins.angle_rad.to_degrees()
            );
        }
        text.extend(self.told.map(Told::text));
        let without = reasons(self.found);
        if !without.is_empty() {
            let _ = writeln!(text, "  no weights: {without}");
        }
        text
    }

    fn json(&self) -> Value {
        let number = |v: f64| if v.is_finite() { json!(rounded(v)) } else { Value::Null };
        let endmember = |(m, name): (usize, &String)| {
            let (mean, sigma, most, bounded) = self.summary(m);
            json!({
                "name": name, "mean_share": number(mean), "median_share_sigma": number(sigma),
                "largest_weight": number(most), "bounded_samples": bounded,
            })
        };
        let endmembers: Vec<Value> =
            self.bands.endmembers.iter().enumerate().map(endmember).collect();
        let count = |state: State| {
            self.found.iter().filter(|u| u.mixture.is_none() && u.state.contains(state)).count()
        };
        json!({
            "target": self.curve.target(),
            "samples": self.found.len(),
            "unmixed_samples": self.mixtures().count(),
            "bands": self.bands.names.len(),
            "weight_unit": self.unit(),
            "endmembers": endmembers,
            "condition": number(self.mixing.condition),
            "rank": self.mixing.rank,
            "nearest": self.mixing.nearest.as_ref().map(|t| json!({
                "pair": t.pair.map(|k| self.bands.endmembers[k].clone()), "angle_deg": rounded(t.angle_rad.to_degrees()),
            })),
            "median_residual_relative": number(median(self.mixtures().map(|x| x.residual_relative).collect())),
            "without_weights": {
                "no_data": count(State::NO_DATA),
                "below_horizon": count(State::BELOW_HORIZON),
                "alike": count(State::ALIKE),
                "not_unique": count(State::NOT_UNIQUE),
            },
            "confusion": self.told.map(Told::json),
            "warnings": self.warnings,
        })
    }
}
