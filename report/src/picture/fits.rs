//! A picture's numbers as FITS images.

use ndarray::{Array2, Array3};
use sunglint_formats::EncodeError;
use sunglint_formats::fits::{Header, Image, Pixels, Writer};
use sunglint_formats::time::format_utc_shortest;
use sunglint_simulator::picture::{Shot, What, arcsec};

/// One image a wavelength, the shares of the materials, the depth: those that were asked for. Rows from the bottom, as FITS programs show them.
pub(super) fn bytes(shot: &Shot<'_>) -> Result<Vec<u8>, EncodeError> {
    let mut writer = Writer::new();
    let wants = |what: What| shot.what.contains(&what);
    for band in 0..shot.bands_nm.len() {
        let asked = band < shot.asked;
        if !(if asked { wants(What::Intensity) } else { wants(What::Rgb) }) {
            continue;
        }
        let nm = shot.bands_nm[band];
        let mut header = header(shot);
        // A number in a name has no point.
        let place = if asked { "I" } else { "RGB" };
        header.set("EXTNAME", format!("{place}_{}NM", nm.to_string().replace('.', "P")), "");
        header.set("BUNIT", shot.unit(), "of a pixel; the sum is the body's");
        header.set("WAVELEN", nm, "nm, vacuum");
        header.set("SUNIRR", shot.irradiance[band], "W m-2 nm-1 that the values hold; 1: none");
        header.set("TOTAL", shot.totals[band], "sum before any blur");
        if let Some(fwhm) = shot.optics.fwhm_arcsec.get(band) {
            header.set("PSFFWHM", *fwhm, "arcsec, normal distribution");
        }
        let values = image(shot, &shot.picture.bands[band]);
        writer.image(&Image { header, pixels: Pixels::F64(values.into_dyn()) })?;
    }
    if wants(What::Material) {
        let mut header = header(shot);
        header.set("EXTNAME", "MATERIAL", "share of each pixel, one plane a material");
        for (k, material) in shot.aim.target.materials.iter().enumerate() {
            header.set(&format!("MATER{}", k + 1), material.name.as_str(), "");
        }
        let [width, height] = shot.camera.size_px;
        let all = &shot.picture.materials;
        let cube = Array3::from_shape_fn((all.len(), height, width), |(k, row, column)| {
            all[k][(height - 1 - row) * width + column] as f32
        });
        writer.image(&Image { header, pixels: Pixels::F32(cube.into_dyn()) })?;
    }
    if wants(What::Depth) {
        let mut header = header(shot);
        header.set("EXTNAME", "DEPTH", "away from the observer, 0 at the origin");
        header.set("BUNIT", "m", "");
        let values = image(shot, &shot.picture.depth_m);
        writer.image(&Image { header, pixels: Pixels::F64(values.into_dyn()) })?;
    }
    Ok(writer.into_bytes())
}

/// Rows from the bottom.
fn image(shot: &Shot<'_>, values: &[f64]) -> Array2<f64> {
    let [width, height] = shot.camera.size_px;
    Array2::from_shape_fn((height, width), |(row, column)| {
        values[(height - 1 - row) * width + column]
    })
}

fn header(shot: &Shot<'_>) -> Header {
    let mut header = Header::default();
    let aim = shot.aim;
    let [width, height] = shot.camera.size_px;
    header.set("OBJECT", aim.target.name.as_str(), "");
    for (axis, size, name) in [(1, width, "X"), (2, height, "Y")] {
        header.set(&format!("CTYPE{axis}"), name, "across the line of sight");
        header.set(&format!("CUNIT{axis}"), "m", "");
        header.set(&format!("CRPIX{axis}"), 0.5 * (size as f64 + 1.0), "the body's origin");
        header.set(&format!("CRVAL{axis}"), 0.0, "");
        header.set(&format!("CDELT{axis}"), shot.camera.pixel_m, "");
        if let Some(range_m) = aim.range_m {
            header.set(&format!("CTYPE{axis}A"), name, "the same as seen");
            header.set(&format!("CUNIT{axis}A"), "arcsec", "");
            header.set(&format!("CRPIX{axis}A"), 0.5 * (size as f64 + 1.0), "");
            header.set(&format!("CRVAL{axis}A"), 0.0, "");
            header.set(&format!("CDELT{axis}A"), shot.camera.pixel_m / range_m / arcsec(), "");
        }
    }
    header.set("UP", aim.up_name, "");
    if let Some(time) = aim.time {
        header.set("DATE-OBS", format_utc_shortest(time).trim_end_matches('Z').to_owned(), "UTC");
    }
    if let Some(range_m) = aim.range_m {
        header.set("RANGE", range_m, "m");
    }
    header.set("PHASE", aim.phase_deg(), "deg, Sun-target-observer");
    for (keyword, v) in [("SUN", aim.sun_body), ("OBS", aim.observer_body)] {
        for (axis, value) in ["X", "Y", "Z"].iter().zip(v.to_array()) {
            header.set(&format!("{keyword}_{axis}"), value, "unit vector, body axes");
        }
    }
    header.set("SCATTER", 1_i64, "orders of scattering");
    header.set("CREATOR", concat!("sunglint ", env!("CARGO_PKG_VERSION")), "");
    header
}
