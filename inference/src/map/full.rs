//! A body over all directions, by the light engine.

use super::{BodyMaps, MapError, MapLayer, MapQuantity, Shortcut, Track};
use crate::range::range_map;
use crate::unmix::Materials;
use ndarray::Array2;
use sunglint_analysis::map::{BodyMap, Grid, longitude_latitude, phase_vector};
use sunglint_analysis::unmix::nnls::Constraint;
use sunglint_analysis::unmix::{Bands, Endmember, Light, Values, unmix};
use sunglint_radiometry::air::Zenith;
use sunglint_radiometry::light_curve::Samples;
use sunglint_radiometry::spectrum::Spectrum;
use sunglint_radiometry::station::Channel;
use sunglint_simulator::light::{Faceted, Scene};
use sunglint_simulator::pass::{Pass, Place};
use sunglint_simulator::picture::Map;

/// Options of a map over all directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapOptions {
    /// The cells.
    pub grid: Grid,
    /// The phase angle, degrees; `None` for the mean along the visible part of the pass.
    pub phase_deg: Option<f64>,
    /// Also the curve that the map gives along the pass.
    pub along: bool,
    /// Also maps of the range, as a laser of this wavelength (vacuum nm) beside the telescope finds it.
    pub ranges_nm: Option<f64>,
}

impl MapOptions {
    /// Options for a grid: nothing but the maps of channels and materials, at the mean phase angle of the pass.
    pub fn new(grid: Grid) -> Self {
        Self { grid, phase_deg: None, along: false, ranges_nm: None }
    }
}

/// Maps the scene's body over all directions: reflection factors of the station's channels, the light of each material, and the shares that unmixing finds of `materials`.
///
/// # Errors
/// A target that the light engine refuses or that is dark; a phase angle or a wavelength that cannot be; a pass that cannot be simulated.
pub fn map_directions(
    pass: &Pass,
    materials: &Materials,
    options: &MapOptions,
) -> Result<BodyMaps, MapError> {
    let grid = options.grid;
    let mut warnings = materials.warnings.clone();
    let scene = Scene::new(&pass.target)
        .map_err(|source| MapError::Target { target: pass.target.name.clone(), source })?;
    let phase_deg = match options.phase_deg {
        Some(deg) => deg,
        None => mean_phase_deg(&pass.moments()?)?,
    };
    // Every spectrum of the scene as an endmember: what it counts in each channel, above the air.
    let spectra = scene.materials().iter().flat_map(|material| {
        material.spectra().iter().map(|spectrum| Endmember {
            name: material.name.clone(),
            reflectance: spectrum.clone(),
        })
    });
    let spectra: Vec<Endmember> = spectra.collect();
    let channels: Vec<&Channel> = pass.station.channels.iter().collect();
    let area_m2 = pass.station.telescope.area_m2();
    let of_scene = Bands::channels(&pass.sun, &channels, area_m2, &spectra, None)?;
    let factors = of_scene.at(Zenith::Apparent(0.0))?;
    let map = |counts: &[f64]| -> Result<BodyMap, MapError> {
        // A hair more than the step, so that rounding makes no row more than the grid has.
        let step_deg = (grid.step_deg() * (1.0 + 1e-12)).min(90.0);
        let map = Map::of(&scene, phase_deg.to_radians(), step_deg, counts)?;
        // That one begins in the north.
        let mut values = map.intensity;
        values.invert_axis(ndarray::Axis(0));
        Ok(BodyMap::full(grid, values.as_standard_layout().into_owned())?)
    };
    let mut layers = Vec::new();
    for (c, channel) in channels.iter().enumerate() {
        let map = map(&factors.matrix.row(c).to_vec())?;
        layers.push(layer(channel.name.clone(), MapQuantity::Factor, map));
    }
    let of_channels: Vec<BodyMap> = layers.iter().map(|l| l.map.clone()).collect();
    // The light of each material in truth.
    for m in 0..scene.materials().len() {
        let mut counts = vec![0.0; scene.weight_count()];
        counts[scene.weights_of(m)].fill(1.0);
        let name = scene.materials()[m].name.clone();
        layers.push(layer(name, MapQuantity::Weight, map(&counts)?));
    }
    if !materials.endmembers.is_empty() {
        layers.extend(shares(pass, &channels, &of_channels, &materials.endmembers, grid)?);
    }
    if let Some(nm) = options.ranges_nm {
        let body = Faceted::new(&pass.target).map_err(MapError::Facets)?;
        let ranges = range_map(&body, grid, &body.scene().reflectances(nm)?)?;
        for (name, values) in [("surface", ranges.surface_m), ("light", ranges.light_m)] {
            let map = BodyMap::full(grid, values)?;
            layers.push(layer(name.into(), MapQuantity::Range, map));
        }
        if !pass.target.hinges.is_empty() {
            warnings
                .push("range maps: hinged parts turn to the laser as if it were the Sun".into());
        }
    }
    if of_channels.iter().all(|m| m.mean.iter().all(|v| *v <= 0.0)) {
        return Err(MapError::Dark { target: pass.target.name.clone(), phase_deg });
    }
    let (track, shortcut) = match options.along {
        true => {
            let (track, shortcut) = along(pass, &of_channels, &channels, &mut warnings)?;
            (Some(track), shortcut)
        }
        false => (None, Vec::new()),
    };
    Ok(BodyMaps {
        title: format!("{} over all directions", pass.target.name),
        phase_deg: Some(phase_deg),
        layers,
        track,
        shortcut,
        warnings,
    })
}

fn layer(name: String, quantity: MapQuantity, map: BodyMap) -> MapLayer {
    MapLayer { name, quantity, map, agreement: None }
}

/// The mean phase angle where the station sees the target, else of all.
fn mean_phase_deg(places: &[Place]) -> Result<f64, MapError> {
    let mean =
        |all: Vec<f64>| (!all.is_empty()).then(|| all.iter().sum::<f64>() / all.len() as f64);
    let above = places.iter().filter(|p| p.geometry.zenith_deg() < 90.0);
    mean(above.map(|p| p.geometry.phase_deg()).collect())
        .or_else(|| mean(places.iter().map(|p| p.geometry.phase_deg()).collect()))
        .ok_or(MapError::NoTime)
}

/// The shares that unmixing finds in the channels of each direction.
fn shares(
    pass: &Pass,
    channels: &[&Channel],
    maps: &[BodyMap],
    endmembers: &[Endmember],
    grid: Grid,
) -> Result<Vec<MapLayer>, MapError> {
    let bands = Bands::channels(&pass.sun, channels, 1.0, endmembers, None)?;
    let unit = bands.at(Zenith::Apparent(0.0))?.unit;
    let (rows, columns) = grid.dim();
    let cells = rows * columns;
    let value = Array2::from_shape_fn((cells, maps.len()), |(i, c)| {
        maps[c].mean[(i / columns, i % columns)] * unit[c]
    });
    let valid = Array2::from_elem(value.dim(), true);
    let light = Light { zenith: Zenith::Apparent(0.0), range_m: 1.0, sunlight: 1.0 };
    let values = Values { value: value.view(), sigma: None, valid: valid.view() };
    let found = unmix(&bands, &vec![light; cells], values, Constraint::Free)?;
    let of = |(m, endmember): (usize, &Endmember)| {
        let mean = Array2::from_shape_fn((rows, columns), |(r, c)| {
            found[r * columns + c].mixture.as_ref().map_or(f64::NAN, |x| x.shares[m])
        });
        let map = BodyMap::full(grid, mean)?;
        Ok(layer(endmember.name.clone(), MapQuantity::Share, map))
    };
    endmembers.iter().enumerate().map(of).collect()
}

/// The rates that the maps give along the pass, beside those of the simulation.
fn along(
    pass: &Pass,
    maps: &[BodyMap],
    channels: &[&Channel],
    warnings: &mut Vec<String>,
) -> Result<(Track, Vec<Shortcut>), MapError> {
    let simulation = pass.simulate(&|_| ())?;
    let one =
        [Endmember { name: "unit".into(), reflectance: Spectrum::constant(1.0, 100.0, 1e5)? }];
    let air = pass.air.as_ref().map(|air| (air, pass.air_tolerance));
    let bands = Bands::channels(&pass.sun, channels, pass.station.telescope.area_m2(), &one, air)?;
    let samples =
        Samples { exposure_s: pass.exposure_s.clone(), ..Samples::new(pass.times.clone(), 1.0) };
    let at: Vec<(f64, f64)> = simulation
        .places
        .iter()
        .map(|p| {
            phase_vector(p.sun_body, p.observer_body)
                .map_or((f64::NAN, f64::NAN), longitude_latitude)
        })
        .collect();
    let mut track = Track::new(&samples, &at);
    let mut shortcuts = Vec::new();
    let mut empty = 0;
    let units: Vec<Option<Vec<f64>>> = simulation
        .places
        .iter()
        .map(|p| bands.at(p.geometry.air_zenith()).ok().filter(|_| !p.hidden).map(|f| f.unit))
        .collect();
    for (c, map) in maps.iter().enumerate() {
        let of = |i: usize| {
            let (place, unit) = (&simulation.places[i], units[i].as_ref()?);
            let per = place.sunlit
                / place.geometry.sun.distance_au().powi(2)
                / place.geometry.range_m.powi(2);
            Some(map.at(at[i])?.value * unit[c] * per)
        };
        let found: Vec<f64> = (0..at.len()).map(|i| of(i).unwrap_or(f64::NAN)).collect();
        empty =
            empty.max(found.iter().zip(&units).filter(|(v, u)| v.is_nan() && u.is_some()).count());
        let direct = &simulation.channels[c];
        shortcuts.push(Shortcut::of(&channels[c].name, &direct.rate_hz, &found));
        let rate = MapQuantity::Rate;
        track.push(format!("{}_direct", direct.name), rate, direct.rate_hz.clone());
        track.push(format!("{}_map", direct.name), rate, found);
    }
    if empty > 0 {
        warnings.push(format!("{empty} visible samples have no value in the map"));
    }
    Ok((track, shortcuts))
}
