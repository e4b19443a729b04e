//! Files of databases of measured materials as rows: MERL's on a grid about the mirrored ray, UTIA's and RGL's at their own directions.

use super::{Exchange, ForeignRows, about_mirrored};
use crate::surface::brdf_table::Row;
use crate::surface::measured;
use glam::DVec3;
use std::path::Path;
use sunglint_formats::ParseError;
use sunglint_formats::bsdf::TensorFile;
use sunglint_formats::merl::MerlBrdf;
use sunglint_formats::utia::{self, UtiaBrdf};

/// Dominant wavelengths of sRGB's primaries with white D65, nm: blue, green, red. Neither database says more of its colours than that they are such.
const COLOURS_NM: [f64; 3] = [464.0, 549.0, 611.0];
/// Wavelengths closer than this are the same, nm.
const SAME_NM: f64 = 0.5;
/// Where a MERL file is read: incidences, and about the mirrored ray angles (as fine as the file's own cells of the bisector, up to some 5°) and azimuths; degrees.
const INCIDENCES_DEG: [f64; 9] = [0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0];
const RADIALS_DEG: [f64; 29] = [
    0.0, 0.1, 0.25, 0.5, 0.8, 1.2, 1.7, 2.3, 3.0, 4.0, 5.0, 6.5, 8.0, 10.0, 12.5, 15.0, 18.0, 22.0,
    27.0, 33.0, 40.0, 48.0, 57.0, 67.0, 80.0, 95.0, 115.0, 140.0, 165.0,
];
const AZIMUTH_STEP_DEG: f64 = 15.0;

pub(super) fn read(
    format: Exchange,
    path: &Path,
    content: &[u8],
) -> Result<ForeignRows, ParseError> {
    match format {
        Exchange::Merl => Ok(from_merl(&MerlBrdf::from_bytes(path, content)?)),
        Exchange::Utia => Ok(from_utia(&UtiaBrdf::from_bytes(path, content)?)),
        _ => {
            let file = TensorFile::from_bytes(path, content)?;
            let (wavelength_nm, rows) = measured::nodes(path, &file)?;
            Ok(ForeignRows {
                wavelength_nm,
                colours: false,
                rows,
                missing: 0,
                tis: Vec::new(),
                remarks: Vec::new(),
            })
        }
    }
}

/// One wavelength of several, where one is asked for.
pub(super) fn picked(
    path: &Path,
    mut found: ForeignRows,
    wavelength_nm: Option<f64>,
) -> Result<ForeignRows, ParseError> {
    let Some(nm) = wavelength_nm else { return Ok(found) };
    let Some(k) = found.wavelength_nm.iter().position(|own| (own - nm).abs() < SAME_NM) else {
        let expected = match found.wavelength_nm.as_slice() {
            [] => "no wavelength".to_owned(),
            all if all.len() < 8 => {
                all.iter().map(|nm| format!("{nm} nm")).collect::<Vec<_>>().join(", ")
            }
            all => format!(
                "one of its {} wavelengths from {} to {} nm",
                all.len(),
                all[0],
                all[all.len() - 1]
            ),
        };
        return Err(ParseError::new(path, format!("{nm} nm"), expected));
    };
    found.wavelength_nm = vec![found.wavelength_nm[k]];
    for row in &mut found.rows {
        row.brdf_per_sr = vec![row.brdf_per_sr[k]];
    }
    Ok(found)
}

/// Blue, green and red of a function of a file's colours red, green and blue; `None` where one is missing.
fn colours(of: impl Fn(usize) -> Option<f64>) -> Option<Vec<f64>> {
    [2, 1, 0].into_iter().map(of).collect()
}

fn from_merl(file: &MerlBrdf) -> ForeignRows {
    let (mut rows, mut missing) = (Vec::new(), 0);
    let azimuths = (180.0 / AZIMUTH_STEP_DEG) as u32;
    for theta_i_deg in INCIDENCES_DEG {
        let (sin, cos) = theta_i_deg.to_radians().sin_cos();
        let i = DVec3::new(-sin, 0.0, cos);
        for k in 0..=azimuths {
            for radial in RADIALS_DEG {
                // On the mirrored ray all azimuths are one direction.
                if radial == 0.0 && k > 0 {
                    continue;
                }
                let o = about_mirrored(theta_i_deg, AZIMUTH_STEP_DEG * f64::from(k), radial);
                if o.z < 0.01 {
                    continue;
                }
                let [tilt, angle, azimuth] = half_and_difference(i, o);
                match colours(|colour| file.at(tilt, angle, azimuth, colour)) {
                    Some(brdf_per_sr) => rows.push(Row {
                        theta_i_deg,
                        phi_i_deg: 180.0,
                        theta_o_deg: o.x.hypot(o.y).atan2(o.z).to_degrees(),
                        phi_o_deg: o.y.atan2(o.x).to_degrees(),
                        brdf_per_sr,
                    }),
                    None => missing += 1,
                }
            }
        }
    }
    ForeignRows {
        wavelength_nm: COLOURS_NM.to_vec(),
        colours: true,
        rows,
        missing,
        tis: Vec::new(),
        remarks: Vec::new(),
    }
}

/// Tilt of the bisector, angle to it, azimuth about it from the plane of the bisector and the normal (Rusinkiewicz 1998, *A new change of variables for efficient BRDF representation*), radians.
fn half_and_difference(i: DVec3, o: DVec3) -> [f64; 3] {
    let h = (i + o).normalize();
    let across = h.x.hypot(h.y);
    let (x, y) = if across > 1e-12 { (h.x / across, h.y / across) } else { (1.0, 0.0) };
    // Away from the normal, and across.
    let along = DVec3::new(x * h.z, y * h.z, -across);
    let aside = DVec3::new(-y, x, 0.0);
    let (u, v) = (i.dot(along), i.dot(aside));
    [across.atan2(h.z), u.hypot(v).atan2(i.dot(h)), v.atan2(u)]
}

fn from_utia(file: &UtiaBrdf) -> ForeignRows {
    let (mut rows, mut missing) = (Vec::new(), 0);
    // At the normal all azimuths are one direction.
    let around = |elevation: usize| if elevation == 0 { 1 } else { utia::AZIMUTHS };
    let theta = |k: usize| utia::ELEVATION_STEP_DEG * k as f64;
    let phi = |k: usize| utia::AZIMUTH_STEP_DEG * k as f64;
    for ti in 0..utia::ELEVATIONS {
        for pi in 0..around(ti) {
            for tv in 0..utia::ELEVATIONS {
                for pv in 0..around(tv) {
                    match colours(|colour| file.value([ti, pi], [tv, pv], colour)) {
                        Some(brdf_per_sr) => rows.push(Row {
                            theta_i_deg: theta(ti),
                            phi_i_deg: phi(pi),
                            theta_o_deg: theta(tv),
                            phi_o_deg: phi(pv),
                            brdf_per_sr,
                        }),
                        None => missing += 1,
                    }
                }
            }
        }
    }
    ForeignRows {
        wavelength_nm: COLOURS_NM.to_vec(),
        colours: true,
        rows,
        missing,
        tis: Vec::new(),
        remarks: Vec::new(),
    }
}
