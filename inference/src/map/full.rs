//! A body over all directions, by the light engine.

use super::MapArgs;
use super::report::{Answer, Layer, Of, Shortcut, Track};
use anyhow::{Context as _, bail};
use ndarray::Array2;
use sunglint_analysis::map::{BodyMap, Grid, longitude_latitude, phase_vector};
use sunglint_analysis::unmix::nnls::Constraint;
use sunglint_analysis::unmix::{Bands, Endmember, Light, Values, unmix};
use sunglint_inference::range::range_map;
use sunglint_radiometry::air::Zenith;
use sunglint_radiometry::light_curve::Samples;
use sunglint_radiometry::station::Channel;
use sunglint_simulator::light::{Faceted, Scene};
use sunglint_simulator::pass::{Pass, Place};
use sunglint_simulator::picture::Map;

pub fn answer(
    args: &MapArgs,
    pass: &Pass,
    endmembers: &[Endmember],
    mut warnings: Vec<String>,
) -> anyhow::Result<Answer> {
    let grid = Grid::new(args.step_deg)?;
    let scene =
        Scene::new(&pass.target).with_context(|| format!("the target {}", pass.target.name))?;
    let phase_deg = match args.phase {
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
    let map = |counts: &[f64]| -> anyhow::Result<BodyMap> {
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
        layers.push(Layer { name: channel.name.clone(), of: Of::Factor, map, agreement: None });
    }
    let of_channels: Vec<BodyMap> = layers.iter().map(|l| l.map.clone()).collect();
    // The light of each material in truth.
    for m in 0..scene.materials().len() {
        let mut counts = vec![0.0; scene.weight_count()];
        counts[scene.weights_of(m)].fill(1.0);
        let name = scene.materials()[m].name.clone();
        layers.push(Layer { name, of: Of::Weight, map: map(&counts)?, agreement: None });
    }
    if !endmembers.is_empty() {
        layers.extend(shares(pass, &channels, &of_channels, endmembers, grid)?);
    }
    if let Some(nm) = args.ranges_nm {
        let body = Faceted::new(&pass.target)?;
        let ranges = range_map(&body, grid, &body.scene().reflectances(nm)?)?;
        for (name, of, values) in
            [("surface", Of::Range, ranges.surface_m), ("light", Of::Range, ranges.light_m)]
        {
            let map = BodyMap::full(grid, values)?;
            layers.push(Layer { name: name.into(), of, map, agreement: None });
        }
        if !pass.target.hinges.is_empty() {
            warnings
                .push("range maps: hinged parts turn to the laser as if it were the Sun".into());
        }
    }
    if of_channels.iter().all(|m| m.mean.iter().all(|v| *v <= 0.0)) {
        bail!("{} sends nothing back in any direction at {phase_deg:.1}°", pass.target.name);
    }
    let (track, shortcut) = match args.along {
        true => {
            let (track, shortcut) = along(pass, &of_channels, &channels, &mut warnings)?;
            (Some(track), shortcut)
        }
        false => (None, Vec::new()),
    };
    Ok(Answer {
        title: format!("{} over all directions", pass.target.name),
        phase_deg: Some(phase_deg),
        layers,
        track,
        shortcut,
        warnings,
    })
}

/// The mean phase angle where the station sees the target, else of all.
fn mean_phase_deg(places: &[Place]) -> anyhow::Result<f64> {
    let mean =
        |all: Vec<f64>| (!all.is_empty()).then(|| all.iter().sum::<f64>() / all.len() as f64);
    let above = places.iter().filter(|p| p.geometry.zenith_deg() < 90.0);
    mean(above.map(|p| p.geometry.phase_deg()).collect())
        .or_else(|| mean(places.iter().map(|p| p.geometry.phase_deg()).collect()))
        .context("the pass has no time")
}

/// The shares that unmixing finds in the channels of each direction.
fn shares(
    pass: &Pass,
    channels: &[&Channel],
    maps: &[BodyMap],
    endmembers: &[Endmember],
    grid: Grid,
) -> anyhow::Result<Vec<Layer>> {
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
    let layer = |(m, endmember): (usize, &Endmember)| {
        let mean = Array2::from_shape_fn((rows, columns), |(r, c)| {
            found[r * columns + c].mixture.as_ref().map_or(f64::NAN, |x| x.shares[m])
        });
        let map = BodyMap::full(grid, mean)?;
        Ok(Layer { name: endmember.name.clone(), of: Of::Share, map, agreement: None })
    };
    endmembers.iter().enumerate().map(layer).collect()
}

/// The rates that the maps give along the pass, beside those of the simulation.
fn along(
    pass: &Pass,
    maps: &[BodyMap],
    channels: &[&Channel],
    warnings: &mut Vec<String>,
) -> anyhow::Result<(Track, Vec<Shortcut>)> {
    let simulation = pass.simulate(&|_| ())?;
    let one = [Endmember {
        name: "unit".into(),
        reflectance: sunglint_radiometry::spectrum::Spectrum::constant(1.0, 100.0, 1e5)?,
    }];
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
        track.columns.push((format!("{}_direct", direct.name), Of::Rate, direct.rate_hz.clone()));
        track.columns.push((format!("{}_map", direct.name), Of::Rate, found));
    }
    if empty > 0 {
        warnings.push(format!("{empty} visible samples have no value in the map"));
    }
    Ok((track, shortcuts))
}
