//! The curves that a station's file names: how they are read, and what they must be.

use super::{Channel, DeadTime, Horizon};
use crate::spectrum::{Response, Spectrum};
use std::path::PathBuf;
use sunglint_formats::curve::Curve;
use sunglint_formats::toml::{Document, Within};
use sunglint_formats::{FileError, ParseError};

/// Elevation of an obstacle, degrees: a little below the horizontal on a mountain, never overhead.
pub(super) type Elevation = Within<-10, 89>;

/// Reads a curve that the file names, and says under which path it was found.
pub(super) type Loader<'a> = &'a mut dyn FnMut(&str) -> Result<(Curve, PathBuf), FileError>;

/// Reads a curve, or says which key names what cannot be read.
pub(super) fn load(
    document: &Document,
    key: &str,
    name: &str,
    curve: Loader,
) -> Result<(Curve, PathBuf), FileError> {
    curve(name).map_err(|error| match error {
        FileError::Io { path, source, .. } => {
            let hint = format!("{}: {source}", path.display());
            document.error_at(key, "a curve that can be read").with_hint(hint).into()
        }
        error => error,
    })
}

pub(super) fn horizon(
    document: &Document,
    horizon_deg: Option<f64>,
    horizon_mask: Option<&str>,
    curve: Loader,
) -> Result<Horizon, FileError> {
    Ok(match (horizon_deg, horizon_mask) {
        (Some(_), Some(_)) => {
            let expected = "either horizon_deg or horizon_mask, not both";
            return Err(document.error_at("site.horizon_mask", expected).into());
        }
        (Some(elevation), None) => Horizon::Flat(elevation),
        (None, None) => Horizon::Flat(0.0),
        (None, Some(name)) => {
            let (mask, path) = load(document, "site.horizon_mask", name, curve)?;
            if mask.x_name != "azimuth_deg" || mask.y_name != "elevation_deg" {
                let found = format!("{}, {}", mask.x_name, mask.y_name);
                let expected = "columns azimuth_deg, elevation_deg";
                return Err(ParseError::new(&path, found, expected).into());
            }
            let wrong = |row: usize, field: &str, value: f64, expected: &str| {
                let error = ParseError::new(&path, value.to_string(), expected);
                error.at_line(mask.line(row)).in_field(field)
            };
            for (i, (azimuth, elevation)) in mask.x.iter().zip(&mask.y).enumerate() {
                if !(0.0..=360.0).contains(azimuth) {
                    return Err(wrong(
                        i,
                        "azimuth_deg",
                        *azimuth,
                        "an azimuth from 0 to 360 degrees",
                    )
                    .into());
                }
                if Elevation::new(*elevation).is_none() {
                    return Err(wrong(
                        i,
                        "elevation_deg",
                        *elevation,
                        "an elevation from -10 to 89 degrees",
                    )
                    .into());
                }
            }
            let last = mask.x.len() - 1;
            if mask.x[last] - mask.x[0] == 360.0 && mask.y[last] != mask.y[0] {
                let expected =
                    format!("{}, as at azimuth 0, which is the same direction", mask.y[0]);
                return Err(wrong(last, "elevation_deg", mask.y[last], &expected).into());
            }
            Horizon::Mask(mask.x.iter().copied().zip(mask.y.iter().copied()).collect())
        }
    })
}

/// A curve of fractions against wavelength.
pub(super) fn fractions((curve, path): (Curve, PathBuf)) -> Result<Spectrum<Response>, ParseError> {
    if curve.x_name != "wavelength_nm" {
        let found = format!("`{}`", curve.x_name);
        let error =
            ParseError::new(&path, found, "wavelengths in the first column").in_field(curve.x_name);
        return Err(error.with_hint("name it wavelength_nm, wavelength_um or wavelength_angstrom"));
    }
    const NAMES: [&str; 8] =
        ["efficiency", "transmission", "reflectance", "throughput", "response", "qe", "pde", "pdp"];
    if !NAMES.contains(&curve.y_name.to_lowercase().as_str()) {
        let found = format!("`{}`", curve.y_name);
        let expected =
            format!("a column of fractions: {} (or one of these with _percent)", NAMES.join(", "));
        return Err(ParseError::new(&path, found, expected).in_field(curve.y_name));
    }
    // The detectors of channels see shorter waves.
    const FARTHEST_NM: f64 = 3000.0;
    if curve.x[0] > FARTHEST_NM {
        let longest = curve.x.last().copied().unwrap_or(0.0);
        let found = format!("{} to {longest} nm", curve.x[0]);
        let error = ParseError::new(&path, found, "light below 3000 nm").in_field(curve.x_name);
        return Err(error.with_hint("are they in another unit? columns may be called wavelength_nm, wavelength_um or wavelength_angstrom"));
    }
    let wrong = |row: usize, field: &str, value: f64, expected: &str| {
        let error = ParseError::new(&path, value.to_string(), expected);
        error.at_line(curve.line(row)).in_field(field)
    };
    if let Some(i) = curve.y.iter().position(|y| !(0.0..=1.0).contains(y)) {
        let error = wrong(i, &curve.y_name, curve.y[i], "a fraction from 0 to 1");
        return Err(
            error.with_hint(format!("a column in percent is named {}_percent", curve.y_name))
        );
    }
    if let Some(i) = curve.x.iter().position(|x| *x <= 0.0) {
        return Err(wrong(i, &curve.x_name, curve.x[i], "a wavelength above 0 nm"));
    }
    Spectrum::new(curve.x, curve.y)
        .map_err(|e| ParseError::new(&path, e.to_string(), "a curve against wavelength"))
}

pub(super) fn linearity((curve, path): (Curve, PathBuf)) -> Result<DeadTime, ParseError> {
    if curve.x_name != "measured_hz" || curve.y_name != "true_hz" {
        let found = format!("{}, {}", curve.x_name, curve.y_name);
        return Err(ParseError::new(&path, found, "columns measured_hz, true_hz"));
    }
    for (i, (measured, truth)) in curve.x.iter().zip(&curve.y).enumerate() {
        let wrong = |value: f64, field: &str, expected: &str| {
            let error = ParseError::new(&path, value.to_string(), expected);
            Err(error.at_line(curve.line(i)).in_field(field))
        };
        if *measured < 0.0 {
            return wrong(*measured, "measured_hz", "a rate not below 0 Hz");
        }
        if truth < measured {
            return wrong(
                *truth,
                "true_hz",
                "a rate not below measured_hz: a detector loses counts",
            );
        }
        if i > 0 && *truth <= curve.y[i - 1] {
            return wrong(*truth, "true_hz", "rates that increase");
        }
    }
    Ok(DeadTime::Table { measured_hz: curve.x, true_hz: curve.y })
}

/// A curve that stops at a high value where the channel's others go on: beyond it the channel is taken as blind, which may not be meant.
pub(super) fn curves_that_end_high(channel: &Channel) -> Vec<String> {
    const HIGH: f64 = 0.01;
    let curves: Vec<&Spectrum<Response>> = channel.factors().collect();
    let mut warnings = Vec::new();
    for (i, curve) in curves.iter().enumerate() {
        let peak = curve.value().iter().copied().fold(0.0, f64::max);
        let (first, last) = curve.range_nm();
        for (end_nm, beyond_nm) in [(first, first - 1.0), (last, last + 1.0)] {
            let others = curves.iter().enumerate().filter(|(j, _)| *j != i);
            let others: f64 = others.map(|(_, other)| other.at(beyond_nm)).product();
            if curves.len() > 1 && curve.at(end_nm) > HIGH * peak && others > HIGH {
                let name = if i + 1 == curves.len() && !channel.counts_photons() {
                    "efficiency"
                } else {
                    "optics"
                };
                warnings.push(format!(
                    "channel {}: a curve of its {name} ends at {end_nm} nm with {:.3}, where its other curves go on with {others:.3}: beyond, it is taken as 0",
                    channel.name,
                    curve.at(end_nm)
                ));
            }
        }
    }
    warnings
}
