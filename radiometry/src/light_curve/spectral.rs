//! Spectral light curves: time × wavelength, as FITS.

use super::samples::Reader;
use super::{Flags, Provenance, Samples};
use hifitime::Epoch;
use ndarray::{Array2, Ix2};
use serde_json::Value;
use std::io::{Cursor, Seek, Write};
use std::path::Path;
use sunglint_formats::error::EncodeError;
use sunglint_formats::fits::{
    Filling, FillingError, Fits, Header, Image, Kind, Layout, Pixels, ascii_json,
};
use sunglint_formats::flag_bits::{Numbering, bit_names};
use sunglint_formats::time::format_utc_shortest;
use sunglint_formats::{Column, ParseError, Table, Values};

/// Quantity that a spectral light curve of a simulation gives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SpectralQuantity {
    /// Spectral radiant intensity of the target towards the station, W sr⁻¹ nm⁻¹: no air, no distance.
    #[default]
    Intensity,
    /// Spectral irradiance at the telescope, after the air, W m⁻² nm⁻¹.
    Irradiance,
}

impl SpectralQuantity {
    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::Intensity => "spectral radiant intensity",
            Self::Irradiance => "spectral irradiance at the telescope, after the air",
        }
    }

    /// The unit as astropy spells it.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Intensity => "W / (sr nm)",
            Self::Irradiance => "W / (m2 nm)",
        }
    }
}

/// A light curve in wavelength bins.
///
/// In FITS: an image (`NAXIS1` = bins, `NAXIS2` = times, `BUNIT`), a table `BINS` (`lower_nm`, `upper_nm`) and a table `SAMPLES` with the
/// times, the flags and the geometry, in the columns of the channel light curve. Where a simulation says how far its values may be off, an image
/// `MODEL_ERROR` of 32-bit floats, of the same shape and unit.
#[derive(Debug, Clone, PartialEq)]
pub struct SpectralLightCurve {
    /// Name of the quantity, in words (`spectral radiant intensity`).
    pub quantity: String,
    /// Unit of the quantity as astropy spells it (`W / (sr nm)`).
    pub unit: String,
    /// When, for how long, and from where.
    pub samples: Samples,
    /// Edges of the bins, vacuum nm, increasing: one more than bins.
    pub edges_nm: Vec<f64>,
    /// The values, times × bins; `NaN` only where the time's flag says why.
    pub values: Array2<f64>,
    /// How far off they may be by what a simulation does not model, same unit and shape; `None` where nothing is said of it.
    pub model_errors: Option<Array2<f32>>,
    /// Flags of each time.
    pub flags: Vec<Flags>,
    /// Where the curve came from.
    pub provenance: Provenance,
}

impl SpectralLightCurve {
    /// The curve as the bytes of a FITS file.
    ///
    /// # Errors
    /// Anything that could not be read back: edges that do not increase, arrays that do not match, numbers that are none and not flagged.
    pub fn to_fits(&self) -> Result<Vec<u8>, EncodeError> {
        let written = SpectralFile::begin(self, &self.samples.time, Cursor::new(Vec::new()))
            .and_then(|mut file| {
                file.push(self)?;
                file.finish()
            });
        match written {
            Ok(file) => Ok(file.into_inner()),
            Err(FillingError::Encode(error)) => Err(error),
            Err(error) => Err(EncodeError::new("file", error.to_string(), "room in memory")),
        }
    }

    fn checked(&self) -> Result<(), EncodeError> {
        self.check(Path::new("spectral light curve")).map_err(|e| {
            EncodeError::new(
                e.field.clone().unwrap_or_default(),
                e.found.clone(),
                e.expected.clone(),
            )
        })
    }

    fn image(&self) -> Image {
        let mut header = Header::default();
        header.set("BUNIT", self.unit.as_str(), "unit of the values");
        header.set("QUANTITY", self.quantity.as_str(), "what the values are");
        header.set(
            "PROVENAN",
            ascii_json(&self.provenance.to_json()).as_str(),
            "where they come from",
        );
        header.set("FLAGBITS", ascii_json(&bit_names::<Flags>()).as_str(), "bits of SAMPLES.flags");
        Image { header, pixels: Pixels::F64(self.values.clone().into_dyn()) }
    }

    fn error_image(&self) -> Option<Image> {
        let errors = self.model_errors.as_ref()?;
        let mut header = Header::default();
        header.set("EXTNAME", "MODEL_ERROR", "");
        header.set("BUNIT", self.unit.as_str(), "unit of the values");
        Some(Image { header, pixels: Pixels::F32(errors.clone().into_dyn()) })
    }

    fn bins_table(&self) -> Table {
        let edges = |from: usize| {
            self.edges_nm.iter().skip(from).take(self.values.ncols()).copied().collect()
        };
        let bins = [("lower_nm", 0), ("upper_nm", 1)]
            .map(|(name, from)| Column::f64(name, Some("nm"), edges(from)));
        Table { columns: bins.to_vec(), ..Table::default() }
    }

    fn samples_table(&self) -> Table {
        let (mut columns, last) = self.samples.columns();
        columns.push(Flags::column("flags", &self.flags));
        columns.extend(last);
        Table { columns, ..Table::default() }
    }

    /// A curve from the bytes of a FITS file; `path` names it in errors.
    pub fn from_fits(path: impl AsRef<Path>, bytes: Vec<u8>) -> Result<Self, ParseError> {
        Self::from_fits_at(path.as_ref(), bytes)
    }

    fn from_fits_at(path: &Path, bytes: Vec<u8>) -> Result<Self, ParseError> {
        let fits = Fits::from_bytes(path, bytes)?;
        let missing = |what: &str| {
            ParseError::new(path, "none", what)
                .with_hint("is this a spectral light curve of sunglint?")
        };
        let index =
            fits.first(Kind::Image).ok_or_else(|| missing("an image of times x wavelengths"))?;
        let image = fits.image(index)?;
        let values = image.pixels.to_f64().into_dimensionality::<Ix2>().map_err(|_| {
            ParseError::new(
                path,
                format!("{} axes", image.pixels.shape().len()),
                "2: wavelength, time",
            )
            .in_field("NAXIS")
        })?;
        let model_errors = match fits.find("MODEL_ERROR") {
            None => None,
            Some(index) => {
                let errors = fits.image(index)?.pixels.to_f64().into_dimensionality::<Ix2>();
                let errors = errors.map_err(|_| missing("2 axes").in_field("MODEL_ERROR"))?;
                // Written as 32-bit floats; wider ones lose what nobody needs of an error.
                Some(errors.mapv(|e| e as f32))
            }
        };
        let table = |name: &str| {
            let index = fits.find(name).ok_or_else(|| missing(&format!("a table {name}")))?;
            fits.table(index)
        };
        let (bins, samples) = (table("BINS")?, table("SAMPLES")?);
        let bins = Reader { path, table: &bins };
        let (lower, upper) = (bins.numbers("lower_nm", "nm")?, bins.numbers("upper_nm", "nm")?);
        if lower.iter().skip(1).zip(&upper).any(|(l, u)| l != u) {
            return Err(ParseError::new(
                path,
                "bins with gaps or overlaps",
                "each upper_nm to be the next lower_nm",
            )
            .in_field("BINS"));
        }
        let edges_nm = lower.first().copied().into_iter().chain(upper).collect();
        let text = |key: &str| {
            let value = image.header.text(key).ok_or_else(|| missing("a text").in_field(key))?;
            Ok::<_, ParseError>(value.trim_end().to_owned())
        };
        let json = |key: &str| {
            let text = text(key)?;
            serde_json::from_str::<Value>(&text)
                .map_err(|error| ParseError::new(path, error.to_string(), "JSON").in_field(key))
        };
        let reader = Reader { path, table: &samples };
        let numbering = Numbering::read(path, Some(&json("FLAGBITS")?))?;
        let mut known = Samples::COLUMNS.map(str::to_owned).to_vec();
        known.push("flags".into());
        reader.refuse_unknown(&known)?;
        let curve = Self {
            quantity: text("QUANTITY")?,
            unit: text("BUNIT")?,
            samples: Samples::read(&reader)?,
            edges_nm,
            values,
            model_errors,
            flags: reader.flags("flags", &numbering)?,
            provenance: Provenance::from_json(path, Some(&json("PROVENAN")?))?,
        };
        curve.check(path)?;
        Ok(curve)
    }

    fn check(&self, path: &Path) -> Result<(), ParseError> {
        self.samples.check(path)?;
        let wrong = |field: &str, found: String, expected: String| {
            Err(ParseError::new(path, found, expected).in_field(field))
        };
        let (times, bins) = (self.samples.time.len(), self.edges_nm.len().saturating_sub(1));
        if bins == 0 || !self.edges_nm.windows(2).all(|e| e[0] < e[1] && e[0] > 0.0) {
            return wrong(
                "BINS",
                format!("{} edges", self.edges_nm.len()),
                "at least 2 edges, increasing and above 0 nm".into(),
            );
        }
        if self.values.dim() != (times, bins) {
            let (rows, columns) = self.values.dim();
            return wrong(
                "values",
                format!("{rows} x {columns}"),
                format!("{times} times x {bins} bins"),
            );
        }
        if let Some(errors) = &self.model_errors {
            if errors.dim() != self.values.dim() {
                let found = format!("{} x {}", errors.nrows(), errors.ncols());
                return wrong("MODEL_ERROR", found, format!("{times} times x {bins} bins"));
            }
            let good = |e: f32, flags: &Flags| {
                e >= 0.0 && e.is_finite() || !flags.is_empty() && e.is_nan()
            };
            let mut all = errors.rows().into_iter().zip(&self.flags);
            if !all.all(|(row, flags)| row.iter().all(|e| good(*e, flags))) {
                let expected = "numbers not below 0 (nan only where a flag says why)".into();
                return wrong("MODEL_ERROR", "another number".into(), expected);
            }
        }
        if self.flags.len() != times {
            return wrong(
                "flags",
                format!("{} values", self.flags.len()),
                format!("{times}, as many as time_utc"),
            );
        }
        for ((time, bin), value) in self.values.indexed_iter() {
            if !value.is_finite() && (self.flags[time].is_empty() || !value.is_nan()) {
                let found = format!("{value} at time {}, bin {}", time + 1, bin + 1);
                return wrong("values", found, "a number (nan only where a flag says why)".into());
            }
        }
        Ok(())
    }
}

/// FITS file of a spectral light curve that is written piece by piece: the same bytes as [`SpectralLightCurve::to_fits`] has for all of it.
#[derive(Debug)]
pub struct SpectralFile<W> {
    filling: Filling<W>,
    has_errors: bool,
}

impl<W: Write + Seek> SpectralFile<W> {
    /// Begins the file of a curve with these times, of which `like` is a piece: all others have the same bins, unit and provenance.
    ///
    /// # Errors
    /// A piece that could not be read back; the system's refusal.
    pub fn begin(like: &SpectralLightCurve, times: &[Epoch], out: W) -> Result<Self, FillingError> {
        like.checked()?;
        let mut layout = Layout::default();
        layout.image(&like.image(), times.len())?;
        let errors = like.error_image();
        if let Some(errors) = &errors {
            layout.image(errors, times.len())?;
        }
        let bins = like.bins_table();
        layout.table(&bins, "BINS", bins.rows(), 0)?;
        let width = times.iter().map(|t| format_utc_shortest(*t).len()).max().unwrap_or(0);
        layout.table(&like.samples_table(), "SAMPLES", times.len(), width)?;
        let mut filling = layout.begin(out)?;
        let has_errors = errors.is_some();
        filling.table(1 + usize::from(has_errors), &bins)?;
        Ok(Self { filling, has_errors })
    }

    /// Adds the next piece.
    ///
    /// # Errors
    /// The errors of [`SpectralFile::begin`]; a piece of other bins.
    pub fn push(&mut self, piece: &SpectralLightCurve) -> Result<(), FillingError> {
        piece.checked()?;
        self.filling.pixels(0, &piece.image().pixels)?;
        if let (Some(errors), true) = (piece.error_image(), self.has_errors) {
            self.filling.pixels(1, &errors.pixels)?;
        }
        self.filling.table(2 + usize::from(self.has_errors), &piece.samples_table())
    }

    /// Ends the file.
    ///
    /// # Errors
    /// Samples that are missing; the system's refusal.
    pub fn finish(self) -> Result<W, FillingError> {
        self.filling.finish()
    }
}

impl Flags {
    /// Flags as a column of whole numbers.
    pub(super) fn column(name: impl Into<String>, flags: &[Flags]) -> Column {
        let bits = flags.iter().map(|f| Some(i64::from(f.bits()))).collect();
        Column { name: name.into(), unit: None, description: None, values: Values::I64(bits) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;
    use sunglint_formats::time::parse_utc;

    fn curve() -> SpectralLightCurve {
        let time = ["2026-11-20T18:30:00", "2026-11-20T18:30:00.1"].map(|t| parse_utc(t).unwrap());
        SpectralLightCurve {
            quantity: "spectral radiant intensity".into(),
            unit: "W / (sr nm)".into(),
            samples: Samples { zenith_deg: Some(vec![40.0, 41.0]), ..Samples::new(time.to_vec(), 0.1) },
            edges_nm: vec![300.0, 305.0, 310.0, 400.0],
            values: array![[1.0, 2.0, 3.0], [4.0, f64::NAN, 6.5e-12]],
            model_errors: Some(array![[0.1, 0.0, 3e-4], [1e-3, f32::NAN, 6.5e-15]]),
            flags: vec![Flags::empty(), Flags::EXTRAPOLATED],
            provenance: Provenance { target: "α Lyr from Uhlandshöhe 🛰".into(), notes: vec!["a note that is long enough to need more than one card of a FITS header, of which each holds no more than 68 characters".into()], ..Provenance::default() },
        }
    }

    #[test]
    fn a_spectral_curve_survives_its_file() {
        let back = SpectralLightCurve::from_fits("c.fits", curve().to_fits().unwrap()).unwrap();
        assert_eq!(format!("{back:?}"), format!("{:?}", curve()));
    }

    /// Truth: astropy reads the same numbers, units and names.
    #[test]
    fn astropy_opens_it() {
        let Some(python) = sunglint_testkit::peer_python("spectral_curve_in_astropy", &["astropy"])
        else {
            return;
        };
        let file =
            std::env::temp_dir().join(format!("sunglint-spectral-{}.fits", std::process::id()));
        std::fs::write(&file, curve().to_fits().unwrap()).unwrap();
        let script = "import sys\nfrom astropy.io import fits\nfrom astropy.table import Table\nf=fits.open(sys.argv[1])\nf.verify('exception')\n\
            print(f[0].data.shape, f[0].data[1,2], f[0].header['BUNIT'])\nt=Table.read(sys.argv[1],hdu='SAMPLES')\n\
            print(t['time_utc'][1].strip(), t['flags'][1], t['zenith_deg'].unit)\nprint(Table.read(sys.argv[1],hdu='BINS')['upper_nm'][2])";
        let out = sunglint_testkit::run_python(&python, script, &[file.to_str().unwrap()]);
        std::fs::remove_file(&file).unwrap();
        assert_eq!(out, "(2, 3) 6.5e-12 W / (sr nm)\n2026-11-20T18:30:00.1Z 8 deg\n400.0\n");
    }

    #[test]
    fn what_cannot_be_right_is_refused() {
        let refuse = |change: &dyn Fn(&mut SpectralLightCurve)| {
            let mut curve = curve();
            change(&mut curve);
            curve.to_fits().unwrap_err().to_string()
        };
        assert!(refuse(&|c| c.edges_nm[1] = 300.0).contains("increasing"));
        assert!(
            refuse(&|c| {
                c.edges_nm.pop();
            })
            .contains("found 2 x 3, expected 2 times x 2 bins")
        );
        assert!(refuse(&|c| c.model_errors = Some(array![[0.0]])).contains("found 1 x 1"));
        assert!(
            refuse(&|c| c.model_errors.as_mut().unwrap()[[0, 0]] = -1.0).contains("MODEL_ERROR")
        );
        assert!(refuse(&|c| c.values[[0, 0]] = f64::NAN).contains("NaN at time 1, bin 1"));
        assert!(
            refuse(&|c| {
                c.flags.pop();
            })
            .contains("flags")
        );
        let mut cut = curve().to_fits().unwrap();
        cut.truncate(3000);
        assert!(
            SpectralLightCurve::from_fits("c.fits", cut)
                .unwrap_err()
                .to_string()
                .starts_with("c.fits")
        );
    }
}
