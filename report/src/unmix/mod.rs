//! Materials in the light of a curve: text, JSON, table and figure.

mod confusion;

use crate::plot::{Axis, Figure, Panel, Series, Style};
use crate::{Product, json_of, rounded};
use serde::Serialize;
use serde_json::Value;
use std::fmt::Write as _;
use sunglint_analysis::unmix::{Mixture, State, Unmixed, column_name, reasons};
use sunglint_formats::flag_bits::bit_names;
use sunglint_formats::text::counted;
use sunglint_formats::time::format_utc_shortest;
use sunglint_formats::{Column, Table};
use sunglint_inference::unmix::UnmixedCurve;
use sunglint_numerics::order;
use sunglint_radiometry::light_curve::Input;

/// The median of what is finite; NaN of nothing.
fn median(values: impl Iterator<Item = f64>) -> f64 {
    order::median(values.filter(|v| v.is_finite())).unwrap_or(f64::NAN)
}

fn mixtures(unmixed: &UnmixedCurve) -> impl Iterator<Item = &Mixture> {
    unmixed.found.iter().filter_map(|u| u.mixture.as_ref())
}

fn title(unmixed: &UnmixedCurve) -> String {
    format!("Materials in the light of {}", unmixed.target)
}

fn unit(unmixed: &UnmixedCurve) -> &'static str {
    if unmixed.is_absolute { "m2 / sr" } else { "1 / sr" }
}

/// All forms of the result.
pub fn product(unmixed: &UnmixedCurve) -> Product {
    Product {
        name: "materials".into(),
        table: table(unmixed),
        figure: figure(unmixed),
        json: json(unmixed),
        ..Product::default()
    }
}

#[derive(Serialize)]
struct Provenance<'a> {
    program: &'a str,
    command: &'a str,
    target: &'a str,
    inputs: &'a [Input],
}

/// Table with a row for each sample.
pub fn table(unmixed: &UnmixedCurve) -> Table {
    let mut table = Table::default();
    table.meta.insert("title".into(), title(unmixed).into());
    table.meta.insert("endmembers".into(), json_of(&unmixed.bands.endmembers));
    table.meta.insert("state_bits".into(), bit_names::<State>());
    table.meta.insert(
        "provenance".into(),
        json_of(&Provenance {
            program: concat!("sunglint ", env!("CARGO_PKG_VERSION")),
            command: "sunglint analyse unmix",
            target: &unmixed.target,
            inputs: &unmixed.inputs,
        }),
    );
    let times = unmixed.time.iter().map(|t| format_utc_shortest(*t)).collect();
    table.columns.push(Column::text("time_utc", times));
    let number = |of: &dyn Fn(&Unmixed) -> f64| unmixed.found.iter().map(of).collect::<Vec<_>>();
    for (m, name) in unmixed.bands.endmembers.iter().enumerate() {
        let name = column_name(name);
        let of = |pick: fn(&Mixture) -> &Vec<f64>| {
            number(&|u| u.mixture.as_ref().map_or(f64::NAN, |x| pick(x)[m]))
        };
        let unit = Some(unit(unmixed));
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
        Column::i64("bands", None, unmixed.found.iter().map(|u| u.bands as i64).collect()),
        Column::i64(
            "state",
            None,
            unmixed.found.iter().map(|u| i64::from(u.state.bits())).collect(),
        ),
    ]);
    table
}

/// Figure of the shares above one another, the weights and what is left over; `None` where there is no light.
pub fn figure(unmixed: &UnmixedCurve) -> Option<Figure> {
    let first = unmixed.time.first()?;
    let seconds: Vec<f64> = unmixed.time.iter().map(|t| (*t - *first).to_seconds()).collect();
    let x = || Axis::linear(format!("s since {}", format_utc_shortest(*first)));
    let points = |of: &dyn Fn(&Mixture) -> f64| -> Vec<(f64, f64)> {
        let all = seconds.iter().zip(&unmixed.found);
        all.map(|(s, u)| (*s, u.mixture.as_ref().map_or(f64::NAN, of))).collect()
    };
    let names = &unmixed.bands.endmembers;
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
    let words = if unmixed.is_absolute { "weight (m² sr⁻¹)" } else { "weight (sr⁻¹)" };
    let shares = Axis::linear("share, piled").from_to(0.0, 1.0);
    let some = |points: &dyn Fn(&Mixture) -> bool| mixtures(unmixed).any(points);
    let mut panels = Vec::new();
    if some(&|x| x.shares[0].is_finite()) {
        panels.push(Panel::new(x(), shares, piled.collect()));
        panels.push(Panel::new(x(), Axis::log(words), weights.collect()));
    }
    if some(&|x| x.residual_relative > 0.0) {
        panels.push(Panel::new(x(), Axis::log("left over, of the light"), left));
    }
    panels.extend(unmixed.confusion.as_ref().map(confusion::panel));
    (!panels.is_empty()).then(|| Figure { title: title(unmixed), panels })
}

/// Mean and median over the samples that have shares.
fn summary(unmixed: &UnmixedCurve, m: usize) -> (f64, f64, f64, usize) {
    let shares: Vec<f64> =
        mixtures(unmixed).map(|x| x.shares[m]).filter(|v| v.is_finite()).collect();
    let mean = shares.iter().sum::<f64>() / shares.len() as f64;
    let sigma = median(mixtures(unmixed).map(|x| x.share_sigma[m]));
    let most = mixtures(unmixed).map(|x| x.weights[m]).fold(0.0, f64::max);
    (mean, sigma, most, mixtures(unmixed).filter(|x| x.bounded[m]).count())
}

/// Text of the means.
pub fn text(unmixed: &UnmixedCurve) -> String {
    let count = mixtures(unmixed).count();
    let mut text = format!(
        "{}: {} of {}, {}, {}\n",
        title(unmixed),
        count,
        counted(unmixed.found.len(), "sample"),
        counted(unmixed.bands.names.len(), "band"),
        counted(unmixed.bands.endmembers.len(), "endmember")
    );
    let _ = writeln!(
        text,
        "  endmember            mean share   usual sigma   largest weight   at its bound"
    );
    for (m, name) in unmixed.bands.endmembers.iter().enumerate() {
        let (mean, sigma, most, bounded) = summary(unmixed, m);
        let sigma = if sigma.is_finite() { format!("{sigma:.4}") } else { "-".into() };
        let _ = writeln!(
            text,
            "  {name:<20} {mean:>10.4} {sigma:>13} {most:>12.4e} {:<8} {bounded:>6}",
            unit(unmixed).replace(' ', "")
        );
    }
    let left = median(mixtures(unmixed).map(|x| x.residual_relative));
    let _ = writeln!(
        text,
        "  condition number {:.1}; usually {:.2e} of the light is left over",
        unmixed.mixing.condition, left
    );
    if let Some(twins) = &unmixed.mixing.nearest {
        let [a, b] = twins.pair.map(|k| unmixed.bands.endmembers[k].as_str());
        let _ = writeln!(
            text,
            "  nearest to each other: {a} and {b}, {:.2}° apart",
            twins.angle_rad.to_degrees()
        );
    }
    text.extend(unmixed.confusion.as_ref().map(confusion::text));
    let without = reasons(&unmixed.found);
    if !without.is_empty() {
        let _ = writeln!(text, "  no weights: {without}");
    }
    text
}

#[derive(Serialize)]
struct EndmemberJson<'a> {
    name: &'a str,
    mean_share: f64,
    median_share_sigma: f64,
    largest_weight: f64,
    bounded_samples: usize,
}

#[derive(Serialize)]
struct UnmixedJson<'a> {
    target: &'a str,
    samples: usize,
    unmixed_samples: usize,
    bands: usize,
    weight_unit: &'a str,
    endmembers: Vec<EndmemberJson<'a>>,
    condition: f64,
    rank: usize,
    nearest: Option<NearestPair>,
    median_residual_relative: f64,
    without_weights: WithoutWeights,
    confusion: Option<Value>,
    warnings: &'a [String],
}

#[derive(Serialize)]
struct NearestPair {
    pair: [String; 2],
    angle_deg: f64,
}

#[derive(Serialize)]
struct WithoutWeights {
    no_data: usize,
    below_horizon: usize,
    alike: usize,
    not_unique: usize,
}

/// Summary with its documented keys.
pub fn json(unmixed: &UnmixedCurve) -> Value {
    let endmembers = unmixed.bands.endmembers.iter().enumerate().map(|(m, name)| {
        let (mean, sigma, most, bounded) = summary(unmixed, m);
        EndmemberJson {
            name,
            mean_share: rounded(mean),
            median_share_sigma: rounded(sigma),
            largest_weight: rounded(most),
            bounded_samples: bounded,
        }
    });
    let count = |state: State| {
        unmixed.found.iter().filter(|u| u.mixture.is_none() && u.state.contains(state)).count()
    };
    json_of(&UnmixedJson {
        target: &unmixed.target,
        samples: unmixed.found.len(),
        unmixed_samples: mixtures(unmixed).count(),
        bands: unmixed.bands.names.len(),
        weight_unit: unit(unmixed),
        endmembers: endmembers.collect(),
        condition: rounded(unmixed.mixing.condition),
        rank: unmixed.mixing.rank,
        nearest: unmixed.mixing.nearest.as_ref().map(|t| NearestPair {
            pair: t.pair.map(|k| unmixed.bands.endmembers[k].clone()),
            angle_deg: rounded(t.angle_rad.to_degrees()),
        }),
        median_residual_relative: rounded(median(mixtures(unmixed).map(|x| x.residual_relative))),
        without_weights: WithoutWeights {
            no_data: count(State::NO_DATA),
            below_horizon: count(State::BELOW_HORIZON),
            alike: count(State::ALIKE),
            not_unique: count(State::NOT_UNIQUE),
        },
        confusion: unmixed.confusion.as_ref().map(confusion::json),
        warnings: &unmixed.warnings,
    })
}
