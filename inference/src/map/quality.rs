//! How well samples agree on the frame of a spin: axes all over the sky, for a body of unknown shape.

use super::plane;
use super::samples::Taken;
use crate::output::{Console, Usage};
use anyhow::bail;
use clap::Args;
use indicatif::{ProgressBar, ProgressDrawTarget};
use ndarray::Array2;
use serde_json::{Value, json};
use std::fmt::Write as _;
use sunglint_analysis::map::{BodyMap, Grid, Quality, Sighting, Spin, scan};
use sunglint_formats::fits::{Image, Pixels, Writer};
use sunglint_report::plot::{Axis, Figure, Heat, Panel};
use sunglint_report::{Product, rounded};

/// Arguments of the measure.
#[derive(Debug, Args)]
#[command(next_help_heading = "A spin of a body of unknown shape")]
pub struct QualityArgs {
    /// How well the samples of --curve agree from turn to turn on the body's frame, for axes all over the sky and periods about --period. The scene says where Sun and station stand; its
    /// target and attitude are not looked at
    #[arg(long, requires = "curve", requires = "period")]
    pub quality: bool,
    /// The sidereal period about which the measure looks, s (`analyse period` finds it)
    #[arg(long, value_name = "S", allow_negative_numbers = true, requires = "quality")]
    pub period: Option<f64>,
    /// Periods up to so much longer and shorter, percent
    #[arg(long, value_name = "PERCENT", default_value_t = 1.0, allow_negative_numbers = true)]
    pub within_percent: f64,
    /// Step of the axes, degrees
    #[arg(long, value_name = "DEG", default_value_t = 10.0, allow_negative_numbers = true)]
    pub axes_deg: f64,
}

/// Axes whose measure is within this factor of the smallest are told: under the Sun place alone does not make the light, and the smallest need not be the true one.
const ALIKE: f64 = 2.0;
/// Cells that two turns visit: with fewer the measure says nothing.
const LEAST_CELLS: usize = 10;
/// Periods at most.
const MOST_PERIODS: usize = 4000;

/// The measure over the sky.
pub struct Answer {
    title: String,
    samples: usize,
    step_deg: f64,
    periods: usize,
    /// The smallest measure of all periods, by axis; NaN where too few cells are visited twice.
    theta: BodyMap,
    /// The period of that, s.
    period_s: Array2<f64>,
    best: (Spin, Quality),
    /// The part of the sky whose axes fit as well, and their periods from … to, s.
    alike: f64,
    alike_s: (f64, f64),
    warnings: Vec<String>,
}

impl QualityArgs {
    /// The period and the part of it by which others may differ.
    ///
    /// # Errors
    /// What is none.
    pub fn check(&self) -> anyhow::Result<(f64, f64)> {
        let period = self.period.unwrap_or(f64::NAN);
        if !(period.is_finite() && period > 0.0) {
            return Err(Usage(format!("--period is {period}, expected seconds above 0")).into());
        }
        let within = self.within_percent;
        if !(0.0..=50.0).contains(&within) {
            return Err(Usage(format!("--within-percent is {within}, expected 0 to 50")).into());
        }
        Ok((period, 0.01 * within))
    }
}

/// Looks.
pub fn answer(
    args: &QualityArgs,
    taken: &Taken,
    step_deg: f64,
    mut warnings: Vec<String>,
    console: Console,
) -> anyhow::Result<Answer> {
    let (period_s, within) = args.check()?;
    let (cells, sky) = (Grid::new(step_deg)?, Grid::new(args.axes_deg)?);
    let sightings = sightings(taken);
    let times = || sightings.iter().map(|s| s.time_s);
    let span_s = times().fold(f64::NEG_INFINITY, f64::max) - times().fold(f64::INFINITY, f64::min);
    if sightings.len() < 3 {
        bail!("{} with light among the samples: at least 3 are needed", sightings.len());
    }
    // Between neighbours the frame turns by half of a cell from the first sample to the last.
    let part = 0.5 * cells.step_deg() / 360.0 * period_s / span_s.max(period_s);
    let side = (within / part).ceil();
    if 2.0 * side > MOST_PERIODS as f64 {
        bail!(
            "{:.0} periods within {} % of {period_s} s over {span_s:.0} s, at most {MOST_PERIODS}: give a smaller --within-percent or larger cells (--step-deg)",
            2.0 * side + 1.0,
            100.0 * within
        );
    }
    let side = side as i32;
    let periods: Vec<f64> =
        (-side..=side).map(|k| period_s / (1.0 - f64::from(k) * part.min(within))).collect();
    let mut theta = Array2::from_elem(sky.dim(), f64::NAN);
    let mut best_period = theta.clone();
    let mut best: Option<(Spin, Quality)> = None;
    let axes: Vec<_> = theta.indexed_iter().map(|(cell, _)| cell).collect();
    let bar = ProgressBar::new(axes.len() as u64);
    if console.quiet {
        bar.set_draw_target(ProgressDrawTarget::hidden());
    }
    for cell in axes {
        bar.inc(1);
        let axis = sky.direction(cell);
        let spins: Vec<Spin> = periods.iter().map(|p| Spin { axis, period_s: *p }).collect();
        let found = scan(&sightings, &spins, cells)?;
        let good = spins.into_iter().zip(found);
        let good = good.filter(|(_, q)| q.theta.is_finite() && q.cells >= LEAST_CELLS);
        let Some(here) = good.min_by(|a, b| a.1.theta.total_cmp(&b.1.theta)) else { continue };
        theta[cell] = here.1.theta;
        best_period[cell] = here.0.period_s;
        if best.is_none_or(|(_, q)| here.1.theta < q.theta) {
            best = Some(here);
        }
    }
    bar.finish_and_clear();
    let Some(best) = best else {
        bail!(
            "no cell of {}° is visited by two turns of {period_s} s often enough ({LEAST_CELLS} cells at least): longer data, a shorter period or larger cells (--step-deg) are needed",
            cells.step_deg()
        );
    };
    let theta = BodyMap::full(sky, theta)?;
    let (mut alike, mut alike_s) = (0.0, (f64::INFINITY, 0.0_f64));
    for (cell, value) in theta.mean.indexed_iter() {
        if *value <= ALIKE * best.1.theta {
            alike += sky.share(cell.0);
            let p = best_period[cell];
            alike_s = (alike_s.0.min(p), alike_s.1.max(p));
        }
    }
    let ends = [periods[0], periods[periods.len() - 1]];
    if within > 0.0 && ends.contains(&best.0.period_s) {
        warnings.push(format!(
            "the best period, {:.5} s, is the {} that was tried: give a larger --within-percent",
            best.0.period_s,
            if best.0.period_s < period_s { "shortest" } else { "longest" }
        ));
    }
    Ok(Answer {
        title: format!("How well samples of {} agree on a spin's frame", taken.curve.target()),
        samples: sightings.len(),
        step_deg: cells.step_deg(),
        periods: periods.len(),
        theta,
        period_s: best_period,
        best,
        alike,
        alike_s,
        warnings,
    })
}

/// The samples with light: the mean over the bands of the root of the reflection factor, each over its own mean. A root, so that glints do not decide alone.
fn sightings(taken: &Taken) -> Vec<Sighting> {
    let bands = taken.bands.names.len();
    let root = |i: usize, b: usize| {
        let value = taken.found[i].factors[b];
        value.abs().sqrt().copysign(value)
    };
    let mean = |values: &mut dyn Iterator<Item = f64>| {
        let (mut sum, mut n) = (0.0, 0.0);
        for value in values.filter(|v| v.is_finite()) {
            sum += value;
            n += 1.0;
        }
        sum / n
    };
    let n = taken.found.len();
    let means: Vec<f64> = (0..bands).map(|b| mean(&mut (0..n).map(|i| root(i, b)))).collect();
    let first = taken.stood.first().map(|p| p.geometry.emitted);
    let sighting = |i: usize| {
        let place = &taken.stood[i];
        // A band that has no light on the whole says nothing.
        let of = |b: &usize| means[*b] > 0.0;
        let value = mean(&mut (0..bands).filter(of).map(|b| root(i, b) / means[b]));
        value.is_finite().then(|| Sighting {
            time_s: first.map_or(0.0, |f| (place.geometry.emitted - f).to_seconds()),
            to_sun: place.geometry.sun.direction_gcrs,
            to_observer: place.geometry.to_observer,
            value,
        })
    };
    (0..n).filter_map(sighting).collect()
}

impl Answer {
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    pub fn product(&self) -> anyhow::Result<Product> {
        Ok(Product {
            name: "spin_quality".into(),
            figure: self.figure(),
            fits: Some(self.fits()?),
            json: self.json(),
            ..Product::default()
        })
    }

    /// Right ascension (0 to 360°) and declination of the best axis.
    fn axis_deg(&self) -> (f64, f64) {
        let (longitude, latitude) = sunglint_analysis::map::longitude_latitude(self.best.0.axis);
        (longitude.rem_euclid(360.0), latitude)
    }

    pub fn text(&self) -> String {
        let (spin, quality) = self.best;
        let (ra, dec) = self.axis_deg();
        let mut text = format!("{}\n", self.title);
        let _ = writeln!(
            text,
            "  {} samples in cells of {}°; {} axes {}° apart, {} periods each",
            self.samples,
            rounded(self.step_deg),
            self.theta.mean.len(),
            rounded(self.theta.grid.step_deg()),
            self.periods
        );
        let _ = writeln!(
            text,
            "  best      theta {:.4}: axis at RA {ra:.1}°, Dec {dec:+.1}°, {:.5} s; {} cells are visited in two turns or more, {} visits",
            quality.theta, spin.period_s, quality.cells, quality.visits
        );
        let _ = writeln!(
            text,
            "  alike     axes with a theta of at most {ALIKE} times that: {:.1} % of the sky, periods from {:.5} s to {:.5} s",
            100.0 * self.alike,
            self.alike_s.0,
            self.alike_s.1
        );
        text.push_str("  theta: how visits of a cell differ from turn to turn, over how all visits differ; near 0 where a place always looks the same, near 1 where place says nothing. Under the Sun light is not made by place alone: the true axis need not be the best\n");
        text
    }

    fn json(&self) -> Value {
        let (spin, quality) = self.best;
        let (ra, dec) = self.axis_deg();
        json!({
            "title": self.title,
            "samples": self.samples,
            "step_deg": rounded(self.step_deg),
            "axes": self.theta.mean.len(),
            "periods": self.periods,
            "best": {
                "ra_deg": rounded(ra), "dec_deg": rounded(dec), "period_s": rounded(spin.period_s),
                "theta": rounded(quality.theta), "cells": quality.cells, "visits": quality.visits,
            },
            "alike": { "sky_share": rounded(self.alike), "period_s": [rounded(self.alike_s.0), rounded(self.alike_s.1)] },
            "warnings": self.warnings,
        })
    }

    fn fits(&self) -> anyhow::Result<Vec<u8>> {
        let mut writer = Writer::new();
        let planes = [("THETA", &self.theta.mean, None), ("PERIOD", &self.period_s, Some("s"))];
        for (name, values, unit) in planes {
            let of = "of the spin axis, GCRS";
            let header = plane::header(name, unit, self.theta.grid, ["RA", "DEC"], of);
            writer.image(&Image { header, pixels: Pixels::F64(values.clone().into_dyn()) })?;
        }
        Ok(writer.into_bytes())
    }

    fn figure(&self) -> Option<Figure> {
        let (rows, columns) = self.theta.grid.dim();
        let edges = |n: usize, half: f64| -> Vec<f64> {
            (0..=n).map(|i| half * (2.0 * i as f64 / n as f64 - 1.0)).collect()
        };
        let values = (0..columns).flat_map(|c| (0..rows).map(move |r| (r, c)));
        let heat = Heat {
            x_edges: edges(columns, 180.0),
            y_edges: edges(rows, 90.0),
            values: values.map(|cell| self.theta.mean[cell]).collect(),
            label: vec!["theta".into(), "0: a place".into(), "looks alike".into()],
            decades: None,
        };
        let x = Axis::linear("right ascension of the axis (°)");
        let y = Axis::linear("declination (°)");
        heat.has_light().then(|| Figure {
            title: self.title.clone(),
            panels: vec![Panel { heat: Some(heat), ..Panel::new(x, y, vec![]) }],
        })
    }
}
