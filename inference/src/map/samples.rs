//! Samples of a curve on the body's frame.

use super::MapArgs;
use super::report::{Answer, Layer, Of, Track};
use crate::analyse::numbers::{Curve, Source, Surroundings, places};
use anyhow::bail;
use std::path::Path;
use sunglint_analysis::map::{BodyMap, Grid, longitude_latitude, phase_vector};
use sunglint_analysis::unmix::nnls::Constraint;
use sunglint_analysis::unmix::{Bands, Endmember, Unmixed, Values, unmix};
use sunglint_radiometry::light_curve::Flags;
use sunglint_radiometry::spectrum::Spectrum;
use sunglint_simulator::pass::{Pass, Place};

/// A curve's samples, where all stood, and what the bands say.
pub struct Taken {
    pub curve: Curve,
    pub stood: Vec<Place>,
    pub bands: Bands,
    pub found: Vec<Unmixed>,
}

impl Taken {
    /// Reads a curve in the light of a scene. Without endmembers there are reflection factors alone.
    pub fn read(
        pass: &Pass,
        path: &Path,
        endmembers: &[Endmember],
        warnings: &mut Vec<String>,
    ) -> anyhow::Result<Self> {
        let curve = Curve::read(path)?;
        let stood = places(pass, curve.samples())?;
        let around =
            Surroundings { pass: Some(pass), station: Some(&pass.station), air: pass.air.as_ref() };
        // Reflection factors need no endmember: a white one stands in.
        let unit =
            [Endmember { name: "unit".into(), reflectance: Spectrum::constant(1.0, 100.0, 1e5)? }];
        let asked = if endmembers.is_empty() { &unit[..] } else { endmembers };
        let bands = curve.bands(&around, asked)?;
        let lights = curve.lights(&around, Some(&stood), warnings)?;
        let mut numbers = curve.numbers();
        for (i, light) in lights.iter().enumerate() {
            if light.sunlight <= 0.0 {
                numbers.valid.row_mut(i).fill(false);
            }
        }
        let values = Values {
            value: numbers.value.view(),
            sigma: numbers.sigma.as_ref().map(|s| s.view()),
            valid: numbers.valid.view(),
        };
        let found = unmix(&bands, &lights, values, Constraint::Free)?;
        Ok(Self { curve, stood, bands, found })
    }
}

pub fn answer(
    args: &MapArgs,
    pass: &Pass,
    path: &Path,
    endmembers: &[Endmember],
    mut warnings: Vec<String>,
) -> anyhow::Result<Answer> {
    let grid = Grid::new(args.step_deg)?;
    let Taken { curve, stood, bands, found } = Taken::read(pass, path, endmembers, &mut warnings)?;
    let place = |p: &Place| {
        phase_vector(p.sun_body, p.observer_body).map_or((f64::NAN, f64::NAN), longitude_latitude)
    };
    let at: Vec<(f64, f64)> = stood.iter().map(place).collect();
    // A spectrum has too many bins for a map each: their mean stands for them.
    let rates = bands.names.len() <= 12;
    let mut track = Track::new(curve.samples(), &at);
    let mut layers = Vec::new();
    let mut layer = |name: String, of: Of, values: Vec<f64>| -> anyhow::Result<()> {
        let map = BodyMap::of(grid, &at, &values)?;
        let agreement = agreement(&map, &values);
        track.columns.push((name.clone(), of, values));
        layers.push(Layer { name, of, map, agreement });
        Ok(())
    };
    if rates {
        for (b, name) in bands.names.iter().enumerate() {
            let values = found.iter().map(|u| u.factors[b]).collect();
            layer(name.clone(), Of::Factor, values)?;
        }
    } else {
        let mean = |u: &Unmixed| {
            let good: Vec<f64> = u.factors.iter().copied().filter(|v| v.is_finite()).collect();
            good.iter().sum::<f64>() / good.len() as f64
        };
        layer("mean_of_bins".into(), Of::Factor, found.iter().map(mean).collect())?;
    }
    for (m, endmember) in endmembers.iter().enumerate() {
        let share = |u: &Unmixed| u.mixture.as_ref().map_or(f64::NAN, |x| x.shares[m]);
        layer(endmember.name.clone(), Of::Share, found.iter().map(share).collect())?;
    }
    if layers.iter().all(|l| l.map.coverage().filled == 0) {
        bail!("{}: no valid sample to place", path.display());
    }
    let eclipsed = match &curve.source {
        Source::Rates(c) => c
            .channels
            .first()
            .map_or(0, |c| c.flags.iter().filter(|f| f.contains(Flags::ECLIPSED)).count()),
        Source::Spectra(c) => c.flags.iter().filter(|f| f.contains(Flags::ECLIPSED)).count(),
    };
    if eclipsed > 0 {
        warnings.push(format!("{eclipsed} samples in the Earth's shadow are left out"));
    }
    Ok(Answer {
        title: format!("{} on the frame of {}", curve.target(), pass.target.name),
        phase_deg: None,
        layers,
        track: Some(track),
        shortcut: Vec::new(),
        warnings,
    })
}

/// Variance within cells over that of all samples: how well those of a cell agree. `None` where no cell has two.
fn agreement(map: &BodyMap, values: &[f64]) -> Option<f64> {
    let (mut within, mut freedom) = (0.0, 0.0);
    for (scatter, count) in map.scatter.iter().zip(&map.count).filter(|(_, c)| **c > 1) {
        within += scatter * scatter * f64::from(count - 1);
        freedom += f64::from(count - 1);
    }
    let good: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    let mean = good.iter().sum::<f64>() / good.len() as f64;
    let total = good.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (good.len() as f64 - 1.0);
    (freedom > 0.0 && total > 0.0).then(|| within / freedom / total)
}
