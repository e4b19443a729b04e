//! Samples of a curve on the body's frame.

use super::{BodyMaps, MapError, MapLayer, MapQuantity, Track};
use crate::lit_curve::{LitCurve, views};
use crate::unmix::Materials;
use std::path::Path;
use sunglint_analysis::map::{BodyMap, Grid, longitude_latitude, phase_vector};
use sunglint_analysis::samples::{CurveSource, SampledCurve};
use sunglint_analysis::unmix::nnls::Constraint;
use sunglint_analysis::unmix::{Bands, Endmember, Unmixed, unmix};
use sunglint_radiometry::light_curve::Flags;
use sunglint_radiometry::spectrum::Spectrum;
use sunglint_simulator::pass::{Pass, Place};

/// With more bands a mean stands for them, in place of a map each.
const MOST_BANDS: usize = 12;

/// Samples of a curve in the light of a scene: where all stood, and what the bands say.
#[derive(Debug, Clone)]
pub struct PlacedCurve {
    /// The curve.
    pub lit: LitCurve,
    /// Bands of the curve with the endmembers.
    pub bands: Bands,
    /// Reflection factors and weights, sample by sample.
    pub found: Vec<Unmixed>,
    /// Warnings about the curve and the materials, for the user.
    pub warnings: Vec<String>,
}

impl PlacedCurve {
    /// Reads a curve in the light of a scene. Without materials there are reflection factors alone.
    ///
    /// # Errors
    /// A curve that cannot be read or has other channels than the scene's station; a time at which something has no place.
    pub fn read(pass: &Pass, path: &Path, materials: &Materials) -> Result<Self, MapError> {
        let curve = SampledCurve::read(path)?;
        let lit = LitCurve::of_scene(curve, pass.clone(), false)?;
        // Reflection factors need no endmember: a white one stands in.
        let unit =
            [Endmember { name: "unit".into(), reflectance: Spectrum::constant(1.0, 100.0, 1e5)? }];
        let endmembers = &materials.endmembers;
        let asked = if endmembers.is_empty() { &unit[..] } else { endmembers };
        let bands = lit.bands(asked)?;
        let mut warnings = materials.warnings.clone();
        let (lights, values) = lit.samples(&mut warnings)?;
        let found = unmix(&bands, &lights, views(&values), Constraint::Free)?;
        Ok(Self { lit, bands, found, warnings })
    }

    /// Where Sun, target and station stood.
    pub fn places(&self) -> &[Place] {
        self.lit.places().unwrap_or_default()
    }
}

/// Maps the samples of a curve on the frame of the scene's body: reflection factors of its bands, and shares of `materials`.
///
/// # Errors
/// The errors of [`PlacedCurve::read`]; no sample that counts.
pub fn map_samples(
    pass: &Pass,
    path: &Path,
    materials: &Materials,
    grid: Grid,
) -> Result<BodyMaps, MapError> {
    let placed = PlacedCurve::read(pass, path, materials)?;
    let (curve, stood) = (placed.lit.curve(), placed.places());
    let PlacedCurve { bands, found, .. } = &placed;
    let mut warnings = placed.warnings.clone();
    let place = |p: &Place| {
        phase_vector(p.sun_body, p.observer_body).map_or((f64::NAN, f64::NAN), longitude_latitude)
    };
    let at: Vec<(f64, f64)> = stood.iter().map(place).collect();
    // A spectrum has too many bins for a map each: their mean stands for them.
    let few = bands.names.len() <= MOST_BANDS;
    let mut track = Track::new(curve.samples(), &at);
    let mut layers = Vec::new();
    let mut layer = |name: String, quantity: MapQuantity, values: Vec<f64>| {
        let map = BodyMap::of(grid, &at, &values)?;
        let agreement = agreement(&map, &values);
        track.push(name.clone(), quantity, values);
        layers.push(MapLayer { name, quantity, map, agreement });
        Ok::<(), MapError>(())
    };
    if few {
        for (b, name) in bands.names.iter().enumerate() {
            let values = found.iter().map(|u| u.factors[b]).collect();
            layer(name.clone(), MapQuantity::Factor, values)?;
        }
    } else {
        let mean = |u: &Unmixed| {
            let good: Vec<f64> = u.factors.iter().copied().filter(|v| v.is_finite()).collect();
            good.iter().sum::<f64>() / good.len() as f64
        };
        layer("mean_of_bins".into(), MapQuantity::Factor, found.iter().map(mean).collect())?;
    }
    for (m, endmember) in materials.endmembers.iter().enumerate() {
        let share = |u: &Unmixed| u.mixture.as_ref().map_or(f64::NAN, |x| x.shares[m]);
        layer(endmember.name.clone(), MapQuantity::Share, found.iter().map(share).collect())?;
    }
    if layers.iter().all(|l| l.map.coverage().filled == 0) {
        return Err(MapError::NoSample { file: path.display().to_string() });
    }
    let eclipsed = match &curve.source {
        CurveSource::Rates(c) => c
            .channels
            .first()
            .map_or(0, |c| c.flags.iter().filter(|f| f.contains(Flags::ECLIPSED)).count()),
        CurveSource::Spectra(c) => c.flags.iter().filter(|f| f.contains(Flags::ECLIPSED)).count(),
    };
    if eclipsed > 0 {
        warnings.push(format!("{eclipsed} samples in the Earth's shadow are left out"));
    }
    Ok(BodyMaps {
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
