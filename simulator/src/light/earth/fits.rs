//! Albedos of the Earth as a FITS image on plain latitudes and longitudes.
//!
//! The first image of the file: NAXIS1 longitude, NAXIS2 latitude, perhaps NAXIS3 wavelength, each linear by CRVAL, CRPIX and CDELT (the standard's defaults where one
//! is left out, but for CDELT1 and CDELT2, which must be there), in degrees and nanometres (CUNIT3 `nm`, `um` or `m`). CTYPE, where it is given, is `LON`, `EALN` (Earth
//! longitude; Marmo et al. 2018, Earth and Space Science 5) or either with `-CAR`, likewise `LAT`, `EALT`, and `WAVE`; coordinates of the sky are refused. NaN and
//! BLANK are cells without a value.

use super::EarthAlbedo;
use super::csv::at;
use super::grid::{AlbedoGrid, Cells, MOST_VALUES};
use std::path::Path;
use sunglint_formats::ParseError;
use sunglint_formats::fits::{Fits, Header, Kind};

/// Whether some bytes are a FITS file.
pub fn is_fits(bytes: &[u8]) -> bool {
    bytes.starts_with(b"SIMPLE  =")
}

/// Reads a table; `missing` is the albedo of cells without a value. `path` names the file in errors.
///
/// # Errors
/// A [`ParseError`] with the keyword: no image, other axes, a rotation, and what [`AlbedoGrid::new`] refuses.
pub fn parse(path: &Path, bytes: Vec<u8>, missing: Option<f64>) -> Result<EarthAlbedo, ParseError> {
    let fits = Fits::from_bytes(path, bytes)?;
    let Some(first) = fits.first(Kind::Image) else {
        return Err(ParseError::new(path, "no image", "an image of latitude and longitude"));
    };
    let image = fits.image(first)?;
    let wrong = |key: &str, found: String, expected: &str| {
        ParseError::new(path, found, expected).in_field(key)
    };
    let (layers, rows, columns) = match *image.pixels.shape() {
        [rows, columns] => (1, rows, columns),
        [layers, rows, columns] => (layers, rows, columns),
        ref other => {
            let expected = "2 axes (longitude, latitude), or 3 (and wavelength)";
            return Err(wrong("NAXIS", other.len().to_string(), expected));
        }
    };
    if image.pixels.to_f64().len() > MOST_VALUES {
        let found = format!("{columns} × {rows} × {layers} values");
        return Err(wrong("NAXIS", found, "at most 8000000 values: take means over larger cells"));
    }
    let header = &image.header;
    for key in ["PC1_2", "PC2_1", "CD1_2", "CD2_1", "CD1_1", "CD2_2", "CROTA2"] {
        if let Some(value) = header.real(key).filter(|v| *v != 0.0) {
            let expected = "axes along longitude and latitude, with CDELT and no rotation";
            return Err(wrong(key, value.to_string(), expected));
        }
    }
    for key in ["PC1_1", "PC2_2", "PC3_3"] {
        if let Some(value) = header.real(key).filter(|v| *v != 1.0) {
            return Err(wrong(key, value.to_string(), "1, with the step in CDELT"));
        }
    }
    let axis = |number: usize, kinds: &[&str]| Axis::of(path, header, number, kinds);
    let lon = axis(1, &["LON", "EALN", "LON--CAR", "EALN-CAR", "LONGITUDE"])?;
    let lat = axis(2, &["LAT", "EALT", "LAT--CAR", "EALT-CAR", "LATITUDE"])?;
    let mut wavelength_nm = Vec::new();
    // A third axis of one value is none.
    if layers > 1 {
        let wave = axis(3, &["WAVE"])?;
        let unit = header.text("CUNIT3").unwrap_or("nm");
        let nm = match unit {
            "nm" => 1.0,
            "um" => 1e3,
            "m" => 1e9,
            other => return Err(wrong("CUNIT3", other.to_owned(), "nm, um or m")),
        };
        wavelength_nm = (0..layers).map(|l| nm * wave.at(l)).collect();
    }
    let values = image.pixels.to_f64();
    let values: Vec<f64> = values.iter().copied().collect();
    let mut cells = Cells::default();
    for row in 0..rows {
        for column in 0..columns {
            cells.places_deg.push([lat.at(row), lon.at(column)]);
            let value = |layer: usize| values[(layer * rows + row) * columns + column];
            cells.albedo.extend((0..layers).map(value));
        }
    }
    // Layers may stand in either order.
    if wavelength_nm.windows(2).all(|w| w[0] > w[1]) && layers > 1 {
        wavelength_nm.reverse();
        cells.albedo.chunks_exact_mut(layers).for_each(<[f64]>::reverse);
    }
    let grid = AlbedoGrid::new(&cells, &wavelength_nm, columns == 1, missing).map_err(|wrong| {
        let pixel = wrong.cell.map(|n| format!("pixel ({}, {})", n % columns + 1, n / columns + 1));
        let field = wrong.field;
        let error = at(path, wrong);
        match pixel {
            Some(pixel) => error.in_field(format!("{field} at {pixel}")),
            None => error,
        }
    })?;
    Ok(EarthAlbedo::tabulated(path.display().to_string(), grid))
}

/// A linear axis.
struct Axis {
    reference: f64,
    pixel: f64,
    step: f64,
}

impl Axis {
    fn of(path: &Path, header: &Header, number: usize, kinds: &[&str]) -> Result<Self, ParseError> {
        let key = |name: &str| format!("{name}{number}");
        let wrong = |name: &str, found: String, expected: String| {
            ParseError::new(path, found, expected).in_field(key(name))
        };
        if let Some(kind) = header.text(&key("CTYPE")).map(str::trim)
            && !kinds.contains(&kind)
        {
            let expected = format!("{} (geographic, not of the sky)", kinds.join(", "));
            return Err(wrong("CTYPE", kind.to_owned(), expected));
        }
        if number < 3
            && let Some(unit) = header.text(&key("CUNIT")).map(str::trim)
            && !["deg", ""].contains(&unit)
        {
            return Err(wrong("CUNIT", unit.to_owned(), "deg".into()));
        }
        let real = |name: &str, usual: Option<f64>| {
            let found = header.real(&key(name)).or(usual).filter(|v| v.is_finite());
            found.ok_or_else(|| wrong(name, "nothing".into(), "a number".into()))
        };
        let step = real("CDELT", None)?;
        if step == 0.0 {
            return Err(wrong("CDELT", "0".into(), "a step other than 0".into()));
        }
        Ok(Self { reference: real("CRVAL", Some(0.0))?, pixel: real("CRPIX", Some(0.0))?, step })
    }

    /// The middle of a pixel, counted from 0.
    fn at(&self, pixel: usize) -> f64 {
        self.reference + (pixel as f64 + 1.0 - self.pixel) * self.step
    }
}
