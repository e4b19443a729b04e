//! Library of master calibration frames: a folder that nights share, with the mean dark, bias and flat of each setting of each camera, and its bad pixels.
//!
//! A reduction adds what its session's own frames give, and takes from it what a session lacks: masters of the same camera, window and binning, a dark of the same exposure,
//! gain and temperature, a bias frame of the same gain, a flat of the same gain behind the same filter. Of several the latest is taken. A master is a FITS file: the mean (32-bit
//! floats) and, of darks, the mask of bad pixels.

use super::sensor::Taken;
use crate::photometry::{BadPixels, MasterFrame, PixelFault};
use ndarray::{Array2, Ix2};
use std::path::{Path, PathBuf};
use sunglint_formats::atomic::Overwrite;
use sunglint_formats::fits::{Fits, Header, Image, Pixels, Writer};
use sunglint_formats::time::format_utc;
use sunglint_formats::{FileError, Frame};

/// Masters of a library at most: more are not looked at.
const MOST: usize = 4096;

/// Kind of a master frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MasterKind {
    /// Mean of dark frames, with the bad pixels.
    Dark,
    /// Mean of bias frames.
    Bias,
    /// Flat: responses, mean 1.
    Flat,
}

impl MasterKind {
    fn word(self) -> &'static str {
        match self {
            Self::Dark => "dark",
            Self::Bias => "bias",
            Self::Flat => "flat",
        }
    }

    fn of(word: &str) -> Option<Self> {
        [Self::Dark, Self::Bias, Self::Flat].into_iter().find(|kind| kind.word() == word)
    }
}

/// Master frame of a library, without its pixels.
#[derive(Debug, Clone)]
struct Master {
    path: PathBuf,
    kind: MasterKind,
    camera: String,
    taken: Taken,
    /// When its first frame began, as FITS writes it.
    date: String,
}

/// Folder of master calibration frames.
#[derive(Debug, Clone)]
pub struct Library {
    folder: PathBuf,
    masters: Vec<Master>,
    /// Files that are no masters, and why.
    pub warnings: Vec<String>,
}

/// Pixels of a master.
#[derive(Debug, Clone)]
pub(super) struct Found {
    pub name: String,
    pub frame: MasterFrame,
    pub bad: Option<BadPixels>,
}

impl Library {
    /// Looks into a folder; one that is not there is empty, and made with the first master.
    ///
    /// # Errors
    /// A folder that cannot be read.
    pub fn open(folder: impl Into<PathBuf>) -> Result<Self, FileError> {
        let folder = folder.into();
        let mut library = Self { folder, masters: Vec::new(), warnings: Vec::new() };
        let entries = match std::fs::read_dir(&library.folder) {
            Ok(entries) => entries,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(library),
            Err(source) => {
                return Err(FileError::io("read", &library.folder, source));
            }
        };
        let is_fits = |path: &PathBuf| path.extension().is_some_and(|kind| kind == "fits");
        let paths = entries.filter_map(|entry| Some(entry.ok()?.path())).filter(is_fits);
        let mut paths: Vec<PathBuf> = paths.collect();
        paths.sort();
        if paths.len() > MOST {
            let folder = library.folder.display();
            library.warnings.push(format!(
                "library {folder}: {} files, of which the first {MOST} are looked at",
                paths.len()
            ));
        }
        for path in paths.into_iter().take(MOST) {
            match described(&path) {
                Ok(master) => library.masters.push(master),
                Err(error) => library.warnings.push(format!("left out of the library: {error}")),
            }
        }
        Ok(library)
    }

    /// The latest master of a kind that fits; the error is a file that cannot be read any more, or is damaged.
    pub(super) fn find(
        &self,
        kind: MasterKind,
        camera: &str,
        fits: impl Fn(&Taken) -> bool,
    ) -> Option<Result<Found, String>> {
        let of_kind = self.masters.iter().filter(|m| m.kind == kind && m.camera == camera);
        let fitting = of_kind.filter(|master| fits(&master.taken));
        let latest = fitting.max_by(|a, b| a.date.cmp(&b.date).then(a.path.cmp(&b.path)))?;
        Some(latest.read())
    }

    /// Adds a master; `None` where there is one of that name.
    ///
    /// # Errors
    /// A folder or a file that cannot be written.
    pub(super) fn keep(
        &self,
        kind: MasterKind,
        camera: &str,
        frames: &[Frame],
        mean: &MasterFrame,
        bad: Option<&BadPixels>,
    ) -> Result<Option<String>, FileError> {
        let Some(first) = frames.iter().min_by_key(|frame| frame.start) else { return Ok(None) };
        let taken = Taken::of(first);
        let date = format_utc(first.start, 3).trim_end_matches('Z').to_owned();
        let name = file_name(kind, camera, &taken, &date);
        let path = self.folder.join(&name);
        if path.exists() {
            return Ok(None);
        }
        let mut header = Header::default();
        header.set("IMAGETYP", format!("master {}", kind.word()), "of a library");
        header.set("INSTRUME", camera, "camera");
        header.set("EXPTIME", taken.exposure_s, "s");
        for (keyword, value) in [
            ("XORGSUBF", taken.origin[0]),
            ("YORGSUBF", taken.origin[1]),
            ("XBINNING", taken.binning[0]),
            ("YBINNING", taken.binning[1]),
        ] {
            header.set(keyword, i64::from(value), "unbinned px");
        }
        if let Some(gain) = taken.gain {
            header.set("GAIN", gain, "in the camera's own steps");
        }
        if let Some(temperature_c) = taken.temperature_c {
            header.set("CCD-TEMP", temperature_c, "deg C");
        }
        if let Some(filter) = &taken.filter {
            header.set("FILTER", filter.as_str(), "");
        }
        if mean.noise_adu > 0.0 {
            header.set("NOISEADU", mean.noise_adu, "ADU, of a pixel");
        }
        header.set("NCOMBINE", i64::try_from(frames.len()).unwrap_or(i64::MAX), "frames");
        header.set("DATE-OBS", date, "UTC, start of the first frame");
        let unwritable = |error| FileError::encode(&path, error);
        let mut writer = Writer::new();
        let pixels = Pixels::F32(mean.pixels.clone().into_dyn());
        writer.image(&Image { header, pixels }).map_err(unwritable)?;
        if let Some(bad) = bad {
            let mut header = Header::default();
            header.set("EXTNAME", "FAULTS", "bits: 1 hot, 2 cold, 4 dead, ...");
            header.set("MEDIAN", bad.median_adu, "ADU, of the pixels in the dark");
            header.set("SIGMA", bad.sigma_adu, "ADU, of the pixels in the dark");
            let pixels = Pixels::U8(bad.faults.mapv(|fault| fault.bits()).into_dyn());
            writer.image(&Image { header, pixels }).map_err(unwritable)?;
        }
        std::fs::create_dir_all(&self.folder)
            .map_err(|source| FileError::io("create", &self.folder, source))?;
        match writer.write_file(&path, Overwrite::Refuse) {
            // Another program was faster.
            Err(FileError::Exists { .. }) => Ok(None),
            written => written.map(|()| Some(name)),
        }
    }
}

/// Description of a master by its file.
fn described(path: &Path) -> Result<Master, String> {
    let fits = Fits::read(path).map_err(|error| error.to_string())?;
    let header = fits.hdus().first().map(|hdu| hdu.header());
    header.and_then(|header| master(path, header)).ok_or_else(|| {
        format!(
            "{}: expected a master frame of a library: IMAGETYP, INSTRUME, EXPTIME, XORGSUBF, YORGSUBF",
            path.display()
        )
    })
}

/// Description of a master by its header.
fn master(path: &Path, header: &Header) -> Option<Master> {
    let kind = MasterKind::of(header.text("IMAGETYP")?.trim().strip_prefix("master ")?)?;
    let whole = |keyword: &str| header.integer(keyword).and_then(|n| u32::try_from(n).ok());
    let pair = |x: &str, y: &str| Some([whole(x)?, whole(y)?]);
    // The size is that of the pixels, which `find` compares when it has them.
    let size = |keyword: &str| usize::try_from(header.integer(keyword)?).ok();
    let filter = header.text("FILTER").map(|name| name.trim().to_owned());
    let taken = Taken {
        exposure_s: header.real("EXPTIME").filter(|s| s.is_finite() && *s >= 0.0)?,
        origin: pair("XORGSUBF", "YORGSUBF")?,
        binning: pair("XBINNING", "YBINNING")?,
        dim: (size("NAXIS2")?, size("NAXIS1")?),
        gain: header.real("GAIN"),
        temperature_c: header.real("CCD-TEMP"),
        filter: filter.filter(|name| !name.is_empty()),
    };
    Some(Master {
        path: path.to_path_buf(),
        kind,
        camera: header.text("INSTRUME")?.trim().to_owned(),
        taken,
        date: header.text("DATE-OBS")?.trim().to_owned(),
    })
}

impl Master {
    fn read(&self) -> Result<Found, String> {
        let fits = Fits::read(&self.path).map_err(|error| error.to_string())?;
        let wrong = |what: &str| format!("{}: expected {what}", self.path.display());
        let image = fits.image(0).map_err(|error| error.to_string())?;
        let noise_adu = image.header.real("NOISEADU").filter(|n| n.is_finite() && *n >= 0.0);
        let Pixels::F32(pixels) = image.pixels else { return Err(wrong("32-bit floats")) };
        let pixels: Array2<f32> =
            pixels.into_dimensionality::<Ix2>().map_err(|_| wrong("an image"))?;
        let Taken { origin, binning, exposure_s, dim, .. } = self.taken;
        if pixels.dim() != dim {
            return Err(wrong("as many pixels as before"));
        }
        let bad = match fits.find("FAULTS") {
            None => None,
            Some(at) => {
                let image = fits.image(at).map_err(|error| error.to_string())?;
                let number = |keyword: &str| image.header.real(keyword).filter(|n| n.is_finite());
                let (Some(median_adu), Some(sigma_adu)) = (number("MEDIAN"), number("SIGMA"))
                else {
                    return Err(wrong("MEDIAN and SIGMA beside the faults"));
                };
                let Pixels::U8(bits) = image.pixels else { return Err(wrong("faults of a byte")) };
                let bits = bits.into_dimensionality::<Ix2>().map_err(|_| wrong("an image"))?;
                if bits.dim() != dim {
                    return Err(wrong("a fault for each pixel"));
                }
                let faults = bits.mapv(PixelFault::from_bits_truncate);
                Some(BadPixels { faults, origin, binning, median_adu, sigma_adu })
            }
        };
        let name = self.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        Ok(Found {
            name,
            frame: MasterFrame {
                pixels,
                origin,
                binning,
                exposure_s,
                noise_adu: noise_adu.unwrap_or(0.0),
            },
            bad,
        })
    }
}

/// Name of a master's file: what it is, the camera and its setting, and the date.
fn file_name(kind: MasterKind, camera: &str, taken: &Taken, date: &str) -> String {
    let plain = |text: &str| -> String {
        text.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).take(40).collect()
    };
    let mut parts = vec![kind.word().to_owned(), plain(camera)];
    if kind == MasterKind::Dark {
        parts.push(format!("{}s", taken.exposure_s));
        parts.extend(taken.temperature_c.map(|c| format!("{c:.0}C")));
    }
    if kind == MasterKind::Flat {
        parts.extend(taken.filter.as_deref().map(plain));
    }
    parts.extend(taken.gain.map(|gain| format!("gain{gain}")));
    let (rows, columns) = taken.dim;
    let ([x, y], [across, down]) = (taken.origin, taken.binning);
    parts.push(format!("{columns}x{rows}+{x}+{y}"));
    if [across, down] != [1, 1] {
        parts.push(format!("bin{across}x{down}"));
    }
    let digits: String = date.chars().filter(|c| c.is_ascii_alphanumeric()).take(15).collect();
    parts.push(digits);
    format!("{}.fits", parts.join("_"))
}
