//! Frames of any program: what the headers of N.I.N.A., Ekos and INDI, MaximDL, SharpCap, APT, SGP, ZWO's ASIAIR and Seestar say, in one form.
//!
//! [`ImageFrame`] holds the pixels of the first image of a FITS file (packed with gzip too) and a [`FrameHeader`]: when the light fell, how long, through what, at which
//! gain and temperature, where. What the header leaves open is `None`; what it contradicts, or what had to be assumed, stands in [`FrameHeader::notes`].
//!
//! **Time.** `DATE-AVG`, `DATE-MID`, `MJD-AVG` or `MJD-MID` is the middle. Else it is `DATE-BEG` or `DATE-OBS` plus half of the exposure (minus half of it where the card's comment says that it is the
//! end, as SharpCap's "Frame Grabbed" does), else `DATE-END`, `MJD-OBS`, `JD`, or a date with `TIME-OBS`, `UTC-OBS`, `TIME-BEG` or `UT` beside it. `TIMESYS` counts; without one times are UTC.
//! `DATE-LOC` is local and not read, and a card whose comment says local time is refused. Two cards that differ by more than a millisecond are noted.
//!
//! **Several images.** Of a file with several the one called `SCI` is read, else the first that is neither a mask nor an uncertainty; [`ReadOptions::extension`] names another.
//!
//! Headers were taken from the real ones that the project PhotonFinder keeps as its tests (SGP, MaximDL, APT, SharpCap, N.I.N.A., Dwarf, Seestar), and from the documents of
//! INDI and SBFITSEXT.

mod time;

use crate::error::{FileError, ParseError};
use crate::fits::{CardValue, Fits, Hdu, Header, Image, Kind, Pixels};
use crate::frame::Bayer;
use crate::wcs::Equatorial;
use hifitime::Epoch;
use ndarray::Array2;
use std::path::{Path, PathBuf};

/// Role of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FrameKind {
    /// A frame of the sky.
    Light,
    /// A frame without light, as long as those that it is subtracted from.
    Dark,
    /// A frame without light and without time.
    Bias,
    /// A frame of an even light.
    Flat,
}

impl FrameKind {
    /// The name in messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Light => "light",
            Self::Dark => "dark",
            Self::Bias => "bias",
            Self::Flat => "flat",
        }
    }

    /// The kind that words such as `Light Frame`, `FLAT`, `masterDark` or `flat-dark` mean; `None` of others.
    ///
    /// ```
    /// use sunglint_formats::image_frame::FrameKind;
    ///
    /// assert_eq!(FrameKind::from_words("Light Frame"), Some(FrameKind::Light));
    /// assert_eq!(FrameKind::from_words("DARKFLAT"), Some(FrameKind::Dark));
    /// assert_eq!(FrameKind::from_words("Sky Flat"), Some(FrameKind::Flat));
    /// assert_eq!(FrameKind::from_words("focus"), None);
    /// ```
    pub fn from_words(words: &str) -> Option<Self> {
        let words = words.to_ascii_lowercase();
        let has = |word: &str| words.contains(word);
        // `OBJECT zero-point field` is one of the sky.
        let first = words.split(|c: char| !c.is_ascii_alphabetic()).find(|w| !w.is_empty());
        if let Some("object" | "science") = first {
            return Some(Self::Light);
        }
        // A dark of flats is a dark.
        if has("dark") {
            return Some(Self::Dark);
        }
        if has("bias") || has("offset") || has("zero") {
            return Some(Self::Bias);
        }
        if has("flat") {
            return Some(Self::Flat);
        }
        (has("light") || has("object") || has("science")).then_some(Self::Light)
    }
}

/// Time of a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameTime {
    /// Middle of the exposure.
    pub middle: Epoch,
    /// The cards that it was taken from, in words.
    pub source: String,
    /// The step in which the card counts, s: 1 where it has whole seconds only.
    pub step_s: f64,
}

/// Place of the telescope, as the header says it.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct FrameSite {
    /// Geodetic latitude, deg, north positive.
    pub latitude_deg: f64,
    /// Longitude, deg, east positive.
    pub longitude_deg: f64,
    /// Height, m.
    pub height_m: Option<f64>,
}

/// Meaning of a frame's header.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameHeader {
    /// The file.
    pub path: PathBuf,
    /// Columns and rows.
    pub size: [usize; 2],
    /// Role of the frame, where the header or the file's name says it.
    pub kind: Option<FrameKind>,
    /// The program that wrote it.
    pub program: Option<String>,
    /// When the light fell.
    pub time: Option<FrameTime>,
    /// Length of the exposure, s.
    pub exposure_s: Option<f64>,
    /// Name of the filter.
    pub filter: Option<String>,
    /// The camera's gain in its own units.
    pub gain_setting: Option<f64>,
    /// The camera's offset in its own units.
    pub offset_setting: Option<f64>,
    /// Electrons for one ADU.
    pub gain_e_per_adu: Option<f64>,
    /// Temperature of the sensor, °C.
    pub temperature_c: Option<f64>,
    /// Sensor columns and rows in a pixel.
    pub binning: [u32; 2],
    /// First column and row on the sensor, in unbinned pixels.
    pub origin: [u32; 2],
    /// Colours of the first 2 × 2 pixels, where it is a colour sensor's.
    pub bayer: Option<Bayer>,
    /// ADU from which a pixel is saturated.
    pub saturation_adu: Option<f64>,
    /// ADU to be added to each pixel (MaximDL's PEDESTAL).
    pub pedestal_adu: f64,
    /// Steps of the reduction that the file has behind it (CALSTAT): B, D, F.
    pub reduced: String,
    /// Frames that were added up in this one; more than 1 for a stack.
    pub stacked: u32,
    /// Name of the object.
    pub object: Option<String>,
    /// Name of the camera.
    pub camera: Option<String>,
    /// Place of the telescope.
    pub site: Option<FrameSite>,
    /// Right ascension and declination that the telescope pointed at, deg, as the mount or the user said them; of date or of J2000.
    pub pointing_deg: Option<Equatorial>,
    /// Width of a pixel, arcsec, from the focal length or as a program wrote it.
    pub scale_arcsec: Option<f64>,
    /// Whether the first row is at the top (ROWORDER is TOP-DOWN); by the FITS standard it is at the bottom.
    pub is_top_down: bool,
    /// Assumptions and contradictions.
    pub notes: Vec<String>,
    /// All cards.
    pub cards: Header,
}

/// A frame of any program.
#[derive(Debug, Clone, PartialEq)]
pub struct ImageFrame {
    /// Meaning of the header.
    pub header: FrameHeader,
    /// Values, ADU, `[row, column]`; NaN where the file has none.
    pub pixels: Array2<f32>,
}

/// Image of a file that holds several.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Extension {
    /// The one with this EXTNAME, letter case aside.
    Named(String),
    /// The place among the file's parts; 0 is the first.
    Number(usize),
}

impl Extension {
    /// The extension of a text: digits are its place, all else its name.
    ///
    /// ```
    /// use sunglint_formats::image_frame::Extension;
    ///
    /// assert_eq!(Extension::of("2"), Extension::Number(2));
    /// assert_eq!(Extension::of("sci"), Extension::Named("sci".into()));
    /// ```
    pub fn of(text: &str) -> Self {
        match text.trim().parse() {
            Ok(number) => Self::Number(number),
            Err(_) => Self::Named(text.trim().to_owned()),
        }
    }
}

/// Colours of the pixels, said by the user.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mosaic {
    /// A monochrome camera, whatever the header says.
    Monochrome,
    /// A colour camera whose first 2 × 2 pixels have this pattern, whatever the header says.
    Pattern(Bayer),
}

/// How a file of a frame is read.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct ReadOptions {
    /// Image of a file that holds several; `None` takes the usual one.
    pub extension: Option<Extension>,
    /// Colours of the pixels; `None` believes the header.
    pub mosaic: Option<Mosaic>,
    /// Whether a time that cannot be understood is a note and not an error.
    pub without_time: bool,
}

/// Whether an image's name says that it is a mask, an uncertainty or a weight, not light.
fn is_beside(name: &str) -> bool {
    const BESIDE: [&str; 22] = [
        "MASK",
        "BPM",
        "DQ",
        "FLAGS",
        "FLAG",
        "QUALITY",
        "ERR",
        "ERROR",
        "ERRORS",
        "STDDEV",
        "SIGMA",
        "UNCERT",
        "UNCERTAINTY",
        "VAR",
        "VARIANCE",
        "IVAR",
        "WHT",
        "WEIGHT",
        "WEIGHTS",
        "EXPMAP",
        "BACKGROUND",
        "BKG",
    ];
    let upper = name.to_ascii_uppercase();
    upper.split(|c: char| !c.is_ascii_alphabetic()).any(|word| BESIDE.contains(&word))
}

/// The index of the image to read, and a note where there were others.
fn chosen(fits: &Fits, asked: Option<&Extension>) -> Result<(usize, Option<String>), ParseError> {
    let path = fits.path();
    let is_image = |hdu: &Hdu| matches!(hdu.kind(), Kind::Image | Kind::CompressedImage);
    // Lists of numbers and images of a few cells stand before the frame in some files, or after tables.
    let has_planes = |hdu: &Hdu| {
        let axes = |stem: &str| {
            let count = hdu.header().integer(stem).unwrap_or(0).clamp(0, 9);
            (1..=count).filter(|i| hdu.header().integer(&format!("{stem}{i}")) > Some(1)).count()
        };
        axes(if hdu.kind() == Kind::Image { "NAXIS" } else { "ZNAXIS" }) >= 2
    };
    let all: Vec<usize> = (0..fits.hdus().len()).filter(|&i| is_image(&fits.hdus()[i])).collect();
    let name = |i: usize| fits.hdus()[i].name().map(str::trim).filter(|n| !n.is_empty());
    let shown = |i: usize| match name(i) {
        Some(name) => format!("{i} ({})", crate::text::plain(name)),
        None => i.to_string(),
    };
    if let Some(asked) = asked {
        let found = all.iter().copied().find(|&i| match asked {
            Extension::Number(number) => i == *number,
            Extension::Named(asked) => name(i).is_some_and(|n| n.eq_ignore_ascii_case(asked)),
        });
        return found.map(|i| (i, None)).ok_or_else(|| {
            let there: Vec<String> = all.iter().map(|&i| shown(i)).collect();
            let wanted = match asked {
                Extension::Number(number) => format!("an image as part {number}"),
                Extension::Named(name) => format!("an image called {name}"),
            };
            ParseError::new(path, format!("images as parts {}", there.join(", ")), wanted)
                .in_field("--extension")
        });
    }
    let planes: Vec<usize> = all.iter().copied().filter(|&i| has_planes(&fits.hdus()[i])).collect();
    let named = |word: &str| {
        let is = |i: &usize| name(*i).is_some_and(|n| n.to_ascii_uppercase().starts_with(word));
        planes.iter().copied().find(is)
    };
    let light = || planes.iter().copied().find(|&i| !name(i).is_some_and(is_beside));
    let index = named("SCI").or_else(light).or(planes.first().copied()).or(all.first().copied());
    let Some(index) = index else {
        return Err(ParseError::new(path, "no image", "a FITS file with a frame"));
    };
    let note = (planes.len() > 1).then(|| {
        let place = planes.iter().position(|&i| i == index).map_or(1, |p| p + 1);
        let others: Vec<String> =
            planes.iter().filter(|i| **i != index).map(|&i| shown(i)).collect();
        format!(
            "image {place} of {} in the file is read, part {}; --extension takes another: {}",
            planes.len(),
            shown(index),
            others.join(", ")
        )
    });
    Ok((index, note))
}

impl ImageFrame {
    /// Reads the image of a FITS file, packed with gzip or not.
    ///
    /// # Errors
    /// A file that cannot be read; no plane of pixels; a card that is there and makes no sense.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, FileError> {
        Self::read_as(path, &ReadOptions::default())
    }

    /// Reads a FITS file as options say.
    ///
    /// # Errors
    /// The errors of [`read`](Self::read); an image that the options name and that is not there.
    pub fn read_as(path: impl AsRef<Path>, options: &ReadOptions) -> Result<Self, FileError> {
        Ok(Self::of_fits(&Fits::read(path)?, options)?)
    }

    /// The image of a FITS file in memory.
    ///
    /// # Errors
    /// A [`ParseError`] with the keyword. A cube is refused by name.
    pub fn from_fits(fits: &Fits) -> Result<Self, ParseError> {
        Self::of_fits(fits, &ReadOptions::default())
    }

    /// Reads a file for a purpose to which the time does not matter: where the header's time cannot be understood, a note says why, and there is none.
    ///
    /// # Errors
    /// The errors of [`read`](Self::read), but for those of the time.
    pub fn read_whenever(path: impl AsRef<Path>) -> Result<Self, FileError> {
        Self::read_as(path, &ReadOptions { without_time: true, ..ReadOptions::default() })
    }

    fn of_fits(fits: &Fits, options: &ReadOptions) -> Result<Self, ParseError> {
        let path = fits.path();
        let (index, note) = chosen(fits, options.extension.as_ref())?;
        let is_packed = fits.hdus().get(index).is_some_and(|h| h.kind() == Kind::CompressedImage);
        let image = if is_packed { fits.compressed_image(index) } else { fits.image(index) };
        let Image { header, pixels } = image?;
        // The primary header holds what an image in an extension leaves out.
        let mut cards = header;
        if let Some(primary) = fits.hdus().first().filter(|_| index > 0) {
            let more: Vec<_> = primary
                .header()
                .cards
                .iter()
                .filter(|card| cards.get(&card.keyword).is_none() && card.keyword != "EXTEND")
                .cloned()
                .collect();
            cards.cards.extend(more);
        }
        let is_whole = !matches!(pixels, Pixels::F32(_) | Pixels::F64(_));
        let (pixels, full) = plane(path, pixels)?;
        let size = [pixels.ncols(), pixels.nrows()];
        let mut header = FrameHeader::understood(path, cards, size, !options.without_time)?;
        header.notes.extend(note);
        match options.mosaic {
            None => {}
            Some(Mosaic::Monochrome) => header.bayer = None,
            Some(Mosaic::Pattern(pattern)) => header.bayer = Some(pattern),
        }
        header.saturation_adu = header.saturation_adu.or(full);
        header.forget_gain_of_scaled(&pixels, is_whole);
        let mut pixels = pixels;
        if header.pedestal_adu != 0.0 {
            let add = header.pedestal_adu as f32;
            pixels.mapv_inplace(|value| value + add);
        }
        Ok(Self { header, pixels })
    }
}

/// Pixels of one plane, and the highest value that their type holds.
fn plane(path: &Path, pixels: Pixels) -> Result<(Array2<f32>, Option<f64>), ParseError> {
    let full = match &pixels {
        Pixels::U8(_) => Some(255.0),
        Pixels::U16(_) => Some(65_535.0),
        Pixels::I16(_) => Some(32_767.0),
        _ => None,
    };
    let shape = pixels.shape().to_vec();
    let bad = |found: String| ParseError::new(path, found, "one plane of pixels").in_field("NAXIS");
    let Some([rows, columns]) = pixels.rows_and_columns() else {
        return Err(match shape.as_slice() {
            [.., 3, _, _] | [_, _, 3] => bad("a colour cube (three planes)".into())
                .with_hint("write raw frames; debayered or stacked colours are no measurement"),
            [planes, _, _] => bad(format!("a cube of {planes} planes")).with_hint(
                "write each plane into a file of its own with its own DATE-OBS and EXPTIME: docs/frames-of-others.md has the lines of Python for it",
            ),
            _ => bad(format!("{} axes of lengths {shape:?}", shape.len())),
        });
    };
    if rows == 0 || columns == 0 {
        return Err(bad("an image without pixels".into()));
    }
    macro_rules! flat {
        ($($variant:ident),*) => {
            match pixels {
                $(Pixels::$variant(array) => array.mapv(|value| value as f32),)*
            }
        };
    }
    let array = flat!(U8, I8, I16, U16, I32, U32, I64, U64, F32, F64);
    let array = array.into_shape_with_order([rows, columns]);
    Ok((array.map_err(|_| bad(format!("axes of lengths {shape:?}")))?, full))
}

impl FrameHeader {
    /// Understands the cards of a frame.
    ///
    /// # Errors
    /// A [`ParseError`] with the keyword for a number out of its range, a time that is none, a `TIMESYS` that is not known.
    pub fn of(path: &Path, cards: Header, size: [usize; 2]) -> Result<Self, ParseError> {
        Self::understood(path, cards, size, true)
    }

    fn understood(
        path: &Path,
        cards: Header,
        size: [usize; 2],
        needs_time: bool,
    ) -> Result<Self, ParseError> {
        let mut reading = Reading { path, cards: &cards, notes: Vec::new() };
        let exposure_s = reading.exposure()?;
        let time = match reading.time(exposure_s) {
            Err(error) if !needs_time => {
                let field = error.field.as_deref().unwrap_or("the time");
                let words = format!(
                    "{field} is not read: found {}, expected {}",
                    error.found, error.expected
                );
                reading.notes.push(words);
                None
            }
            time => time?,
        };
        let kind = reading.kind();
        let program = ["SWCREATE", "CREATOR", "PROGRAM", "SOFTWARE", "ORIGIN"]
            .into_iter()
            .find_map(|keyword| reading.words(keyword));
        let binning = reading.binning()?;
        let origin = [reading.whole("XORGSUBF", 0)?, reading.whole("YORGSUBF", 0)?];
        let origin = [0, 1].map(|axis| origin[axis].saturating_mul(binning[axis]));
        let (gain_setting, gain_e_per_adu) = reading.gain()?;
        let bayer = reading.bayer(binning)?;
        let temperature_c =
            reading.first(&["CCD-TEMP", "CCDTEMP", "DET-TEMP", "TEMPERAT"], -273.15)?;
        let stacked = reading.stacked();
        let header = Self {
            path: path.to_path_buf(),
            size,
            kind,
            program,
            time,
            exposure_s,
            filter: reading.words("FILTER").or_else(|| reading.words("FILTER1")),
            gain_setting,
            offset_setting: reading.number("OFFSET", f64::NEG_INFINITY)?,
            gain_e_per_adu,
            temperature_c,
            binning,
            origin,
            bayer,
            saturation_adu: reading.first(&["SATURATE", "DATAMAX"], 0.0)?.filter(|adu| *adu > 0.0),
            pedestal_adu: reading.number("PEDESTAL", f64::NEG_INFINITY)?.unwrap_or(0.0),
            reduced: reading.words("CALSTAT").unwrap_or_default(),
            stacked,
            object: reading.words("OBJECT"),
            camera: reading.words("INSTRUME"),
            site: reading.site(),
            pointing_deg: reading.pointing(),
            scale_arcsec: reading.scale_arcsec(),
            is_top_down: reading
                .words("ROWORDER")
                .is_some_and(|order| order.eq_ignore_ascii_case("TOP-DOWN")),
            notes: std::mem::take(&mut reading.notes),
            cards: Header::default(),
        };
        Ok(Self { cards, ..header })
    }

    /// Takes out the electrons for an ADU of a frame whose values a program has scaled to 0…1 (Siril, PixInsight): they are of the camera's ADU.
    fn forget_gain_of_scaled(&mut self, pixels: &Array2<f32>, is_whole: bool) {
        let Some(gain) = self.gain_e_per_adu.filter(|_| !is_whole) else { return };
        let most = pixels.iter().copied().filter(|v| v.is_finite()).fold(0.0_f32, f32::max);
        if most > 0.0 && most <= 1.0 {
            self.gain_e_per_adu = None;
            self.notes.push(format!(
                "no value is above 1: the gain of {gain} e/ADU is that of the camera's ADU and does not count"
            ));
        }
    }

    /// Whether the dark was taken off before the file was written.
    pub fn is_without_dark(&self) -> bool {
        self.reduced.contains('D')
    }
}

/// Cards of a frame as they are understood.
struct Reading<'a> {
    path: &'a Path,
    cards: &'a Header,
    notes: Vec<String>,
}

impl Reading<'_> {
    fn bad(&self, keyword: &str, found: impl Into<String>, expected: &str) -> ParseError {
        ParseError::new(self.path, found, expected).in_field(keyword)
    }

    /// A text that says something.
    fn words(&self, keyword: &str) -> Option<String> {
        let text = self.cards.text(keyword)?.trim();
        (!text.is_empty()).then(|| text.to_owned())
    }

    /// A number, or a text that is one (some programs quote them).
    fn number(&self, keyword: &str, least: f64) -> Result<Option<f64>, ParseError> {
        let value = match self.cards.get(keyword) {
            None | Some(CardValue::Undefined) => return Ok(None),
            Some(CardValue::Text(text)) if text.trim().is_empty() => return Ok(None),
            Some(value) => value,
        };
        let number = match value {
            CardValue::Text(text) => text.trim().parse().ok(),
            other => other.real(),
        };
        match number.filter(|n: &f64| n.is_finite() && *n >= least) {
            Some(number) => Ok(Some(number)),
            None if least.is_finite() => {
                Err(self.bad(keyword, value.to_string(), &format!("a number of {least} or above")))
            }
            // A card that is beside the point (OFFSET, PEDESTAL) may hold anything.
            None => Ok(None),
        }
    }

    fn first(&self, keywords: &[&str], least: f64) -> Result<Option<f64>, ParseError> {
        for keyword in keywords {
            if let Some(number) = self.number(keyword, least)? {
                return Ok(Some(number));
            }
        }
        Ok(None)
    }

    fn whole(&self, keyword: &str, default: u32) -> Result<u32, ParseError> {
        let Some(number) = self.number(keyword, 0.0)? else { return Ok(default) };
        if number.fract() != 0.0 || number > 1e6 {
            return Err(self.bad(keyword, number.to_string(), "a whole number"));
        }
        Ok(number as u32)
    }

    /// Kind of frame: by the header, else by the names of file and folder.
    fn kind(&mut self) -> Option<FrameKind> {
        let said = ["IMAGETYP", "FRAME", "OBSTYPE", "IMGTYPE", "FRAMETYP"]
            .into_iter()
            .find_map(|keyword| self.words(keyword));
        if let Some(kind) = said.as_deref().and_then(FrameKind::from_words) {
            return Some(kind);
        }
        if let Some(said) = said {
            self.notes.push(format!("the frame's type is `{said}`, which is not known"));
            return None;
        }
        let file = self.path.file_stem().map(|s| s.to_string_lossy().into_owned());
        let folder = self.path.parent().and_then(Path::file_name);
        let folder = folder.map(|s| s.to_string_lossy().into_owned());
        for name in [file, folder].into_iter().flatten() {
            // Words of a name: `Dark_001`, `darks`, `2026-flat`.
            let words = name.split(|c: char| !c.is_ascii_alphabetic());
            let whole = words.filter(|w| {
                let w = w.to_ascii_lowercase();
                // `bias` ends in s, and is no plural.
                ["dark", "flat", "bias", "light"]
                    .iter()
                    .any(|k| w == *k || w.strip_suffix('s') == Some(k))
            });
            if let Some(kind) = whole.filter_map(FrameKind::from_words).next() {
                self.notes.push(format!("no IMAGETYP: a {} by the name {name}", kind.name()));
                return Some(kind);
            }
        }
        None
    }

    fn binning(&self) -> Result<[u32; 2], ParseError> {
        if let Some(text) = self.words("BINNING") {
            let mut parts = text.split(['*', 'x', 'X', ' ']).filter(|p| !p.is_empty());
            if let (Some(Ok(x)), Some(Ok(y))) =
                (parts.next().map(str::parse::<u32>), parts.next().map(str::parse::<u32>))
                && x > 0
                && y > 0
            {
                return Ok([x, y]);
            }
        }
        let mut binning = [1; 2];
        for (axis, keywords) in
            [["XBINNING", "CCDXBIN"], ["YBINNING", "CCDYBIN"]].iter().enumerate()
        {
            for keyword in keywords.iter().rev() {
                binning[axis] = self.whole(keyword, binning[axis])?;
            }
            if binning[axis] == 0 {
                return Err(self.bad(keywords[0], "0", "1 or more"));
            }
        }
        Ok(binning)
    }

    /// The gain's setting and the electrons for an ADU.
    fn gain(&self) -> Result<(Option<f64>, Option<f64>), ParseError> {
        let electrons = self.number("EGAIN", 0.0)?.filter(|gain| *gain > 0.0);
        let Some(gain) = self.number("GAIN", f64::NEG_INFINITY)? else {
            return Ok((None, electrons));
        };
        let is_electrons = self.cards.cards.iter().any(|card| {
            let comment = card.comment.to_ascii_lowercase();
            card.keyword == "GAIN" && (comment.contains("e-/adu") || comment.contains("electron"))
        });
        if is_electrons && electrons.is_none() && gain > 0.0 {
            return Ok((None, Some(gain)));
        }
        Ok((Some(gain), electrons))
    }

    fn bayer(&mut self, binning: [u32; 2]) -> Result<Option<Bayer>, ParseError> {
        let Some(name) = self.words("BAYERPAT").or_else(|| self.words("COLORTYP")) else {
            return Ok(None);
        };
        let Some(pattern) = Bayer::from_name(&name.to_ascii_uppercase()) else {
            self.notes
                .push(format!("the pattern of colours `{name}` is not known: taken as monochrome"));
            return Ok(None);
        };
        if binning != [1, 1] {
            return Ok(None);
        }
        let shift = [self.whole("XBAYROFF", 0)?, self.whole("YBAYROFF", 0)?];
        if self.words("ROWORDER").is_some_and(|order| order.eq_ignore_ascii_case("BOTTOM-UP")) {
            self.notes.push(
                "BAYERPAT beside ROWORDER BOTTOM-UP: it is not clear to which row the pattern belongs".into(),
            );
        }
        Ok(Some(pattern.shifted(shift[0], shift[1])))
    }

    fn stacked(&mut self) -> u32 {
        let count = ["STACKCNT", "NCOMBINE", "SNAPSHOT", "COADDS"]
            .into_iter()
            .find_map(|k| self.cards.real(k));
        let count = count.filter(|n| *n >= 1.0 && *n < 1e9).map_or(1, |n| n as u32);
        if count > 1 {
            self.notes
                .push(format!("a stack of {count} frames: its time is not that of its light"));
        }
        count
    }

    fn site(&mut self) -> Option<FrameSite> {
        const PAIRS: [[&str; 3]; 4] = [
            ["LAT-OBS", "LONG-OBS", "ALT-OBS"],
            ["SITELAT", "SITELONG", "SITEELEV"],
            ["OBSGEO-B", "OBSGEO-L", "OBSGEO-H"],
            ["LATITUDE", "LONGITUD", "ALTITUDE"],
        ];
        let mut found: Vec<(FrameSite, &str)> = Vec::new();
        for [latitude, longitude, height] in PAIRS {
            let angle = |keyword: &str, most: f64| {
                let value = self.cards.get(keyword)?;
                let angle = value.real().or_else(|| sexagesimal(value.text()?))?;
                (angle.abs() <= most).then_some(angle)
            };
            if let (Some(latitude_deg), Some(longitude_deg)) =
                (angle(latitude, 90.0), angle(longitude, 360.0))
            {
                let longitude_deg =
                    if longitude_deg > 180.0 { longitude_deg - 360.0 } else { longitude_deg };
                let height_m = self.cards.real(height).filter(|h| h.is_finite());
                found.push((FrameSite { latitude_deg, longitude_deg, height_m }, longitude));
            }
        }
        let (site, name) = *found.first()?;
        for (other, other_name) in &found[1..] {
            if (other.longitude_deg - site.longitude_deg).abs() > 0.01 {
                self.notes.push(format!(
                    "{name} is {}° and {other_name} {}°; the first is taken, east positive",
                    site.longitude_deg, other.longitude_deg
                ));
            }
        }
        Some(site)
    }
}

impl Reading<'_> {
    /// Where the telescope pointed: texts of right ascension are hours, numbers degrees.
    fn pointing(&self) -> Option<Equatorial> {
        const PAIRS: [[&str; 2]; 4] =
            [["OBJCTRA", "OBJCTDEC"], ["RA", "DEC"], ["CRVAL1", "CRVAL2"], ["TELRA", "TELDEC"]];
        PAIRS.into_iter().find_map(|[ra, dec]| {
            let angle = |keyword: &str, hours: f64| {
                let value = self.cards.get(keyword)?;
                match value.text() {
                    Some(text) if text.trim().parse::<f64>().is_err() => {
                        Some(hours * sexagesimal(text)?)
                    }
                    Some(text) => text.trim().parse().ok(),
                    None => value.real(),
                }
            };
            let place = [angle(ra, 15.0)?, angle(dec, 1.0)?];
            let good = (-360.0..=360.0).contains(&place[0]) && place[1].abs() <= 90.0;
            good.then(|| place.into())
        })
    }

    /// Width of a pixel: as a program wrote it, or its size (after binning) over the focal length.
    fn scale_arcsec(&self) -> Option<f64> {
        let real = |keyword: &str| self.cards.real(keyword).filter(|v| v.is_finite() && *v > 0.0);
        let of_focus = || {
            let (pixel_um, focus_mm) =
                (real("XPIXSZ").or_else(|| real("PIXSIZE1"))?, real("FOCALLEN")?);
            Some((pixel_um * 1e-3 / focus_mm).to_degrees() * 3600.0)
        };
        let scale = ["PIXSCALE", "SECPIX", "SCALE"].into_iter().find_map(real).or_else(of_focus)?;
        (1e-3..1e4).contains(&scale).then_some(scale)
    }
}

/// Degrees of a text as `-31 16 24`, `51:03:00.0`, `+03d41m00s` or `12.5`.
///
/// ```
/// use sunglint_formats::image_frame::sexagesimal;
///
/// assert_eq!(sexagesimal("-00 30 00"), Some(-0.5));
/// assert_eq!(sexagesimal("149:03:36"), Some(149.06));
/// assert_eq!(sexagesimal("12.25"), Some(12.25));
/// assert_eq!(sexagesimal("north"), None);
/// ```
pub fn sexagesimal(text: &str) -> Option<f64> {
    let text = text.trim();
    let (sign, body) = match text.strip_prefix('-') {
        Some(body) => (-1.0, body),
        None => (1.0, text.strip_prefix('+').unwrap_or(text)),
    };
    let parts = body.split(|c: char| !(c.is_ascii_digit() || c == '.')).filter(|p| !p.is_empty());
    let parts: Vec<f64> = parts.map(|p| p.parse().ok()).collect::<Option<_>>()?;
    // Only what stands between numbers of an angle.
    let plain = body.chars().all(|c| c.is_ascii_digit() || ".: dhms'\"°".contains(c));
    match (plain, parts.as_slice()) {
        (true, [d]) => Some(sign * d),
        (true, [d, m]) if *m < 60.0 => Some(sign * (d + m / 60.0)),
        (true, [d, m, s]) if *m < 60.0 && *s < 60.0 => Some(sign * (d + m / 60.0 + s / 3600.0)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fits::Writer;
    use crate::time::format_utc;
    use ndarray::{ArrayD, IxDyn};

    fn header(cards: &str, path: &str) -> FrameHeader {
        try_header(cards, path).unwrap()
    }

    /// Cards as a real program wrote them, one a line, in a FITS file.
    fn try_header(cards: &str, path: &str) -> Result<FrameHeader, ParseError> {
        let mut image =
            Image { header: Header::default(), pixels: Pixels::U16(ArrayD::zeros(IxDyn(&[4, 6]))) };
        image.header.set("XXMARK", 1_i64, "");
        let mut writer = Writer::new();
        writer.image(&image).unwrap();
        let mut bytes = writer.into_bytes();
        let text: String = cards.lines().map(|line| format!("{line:<80}")).collect();
        let mark = bytes.windows(6).position(|w| w == b"XXMARK").unwrap();
        let data = bytes.len() - 2880;
        let mut whole = bytes[..mark].to_vec();
        whole.extend_from_slice(text.as_bytes());
        whole.extend_from_slice(format!("{:<80}", "END").as_bytes());
        whole.resize(whole.len().next_multiple_of(2880), b' ');
        whole.extend(bytes.drain(data..));
        Ok(ImageFrame::from_fits(&Fits::from_bytes(path, whole)?)?.header)
    }

    fn middle(header: &FrameHeader) -> String {
        format_utc(header.time.as_ref().unwrap().middle, 4)
    }

    /// Cards of real headers (PhotonFinder's tests/sample_headers.py). Truth: by hand, DATE-OBS and half of the exposure.
    #[test]
    fn headers_of_programs_are_understood() {
        let sgp = header(
            "DATE-LOC= '2020-05-30T02:22:49.0968820' / Local observation date\n\
             DATE-OBS= '2020-05-30T00:22:49.0968820' / UTC observation date\n\
             IMAGETYP= 'LIGHT   '           / Type of frame\n\
             CREATOR = 'Sequence Generator Pro v3.1.0.479' / Capture software\n\
             SITEELEV=                   10 / Elevation\n\
             SITELAT = '51 3 0.000'         / Latitude\n\
             SITELONG= '3 43 0.000'         / Longitude\n\
             FILTER  = 'HaOIII  '           / Filter name\n\
             EXPOSURE=                   30 / Exposure time in seconds\n\
             CCD-TEMP=                -17.5 / Camera cooler temperature\n\
             GAIN    =                  120 / Camera gain\n\
             EGAIN   =     3.99000000953674 / Electrons Per ADU\n\
             OFFSET  =                   30 / Camera offset",
            "sgp.fits",
        );
        assert_eq!(middle(&sgp), "2020-05-30T00:23:04.0969Z");
        assert_eq!((sgp.kind, sgp.gain_setting), (Some(FrameKind::Light), Some(120.0)));
        assert_eq!(sgp.gain_e_per_adu, Some(3.990_000_009_536_74));
        let site = sgp.site.unwrap();
        assert!(
            (site.latitude_deg - 51.05).abs() < 1e-12
                && (site.longitude_deg - (3.0 + 43.0 / 60.0)).abs() < 1e-12
        );
        assert_eq!(
            (site.height_m, sgp.temperature_c, sgp.filter.as_deref()),
            (Some(10.0), Some(-17.5), Some("HaOIII"))
        );

        // The standard's own cards of exposures; both ends of one; a scale that is the camera's.
        for (cards, seconds) in [
            ("XPOSURE = 4.0", Some(4.0)),
            ("TELAPSE = 4.0", Some(4.0)),
            ("EXP_TIME= 4.0", Some(4.0)),
            ("EXPMSEC = 4000", Some(4.0)),
            ("DATE-END= '2026-03-04T05:06:11.5'", Some(3.5)),
            ("DATE-END= '2026-03-04T05:06:07'", None),
        ] {
            let of = header(&format!("DATE-BEG= '2026-03-04T05:06:08'\n{cards}"), "a.fits");
            assert_eq!(of.exposure_s, seconds, "{cards}");
        }
        let both = "DATE-BEG= '2026-03-04T05:06:08'\nDATE-END= '2026-03-04T05:06:11.5'";
        assert_eq!(middle(&header(both, "a.fits")), "2026-03-04T05:06:09.7500Z");

        let maxim = header(
            "DATE-OBS= '2018-07-04T14:03:03' / [ISO 8601] UTC date/time of exposure start\n\
             EXPTIME =   3.00000000000E+002 / [sec] Duration of exposure\n\
             EXPOSURE=   3.00000000000E+002 / [sec] Duration of exposure\n\
             IMAGETYP= 'Light Frame' /       Type of image\n\
             SITELAT = '-31 16 24' /         Latitude of the imaging location\n\
             SITELONG= '149 03 52' /         Longitude of the imaging location\n\
             JD      =   2458304.0854513887 /Julian Date at start of exposure\n\
             PEDESTAL=                 -100 /Correction to add for zero-based ADU\n\
             SWCREATE= 'MaxIm DL Version 5.24 140126 0KJR5' /Name of software that created\n\
             CALSTAT = 'BDF     '\n\
             DATE    = '04/07/18'           / [old format] UTC date of exposure start\n\
             TIME-OBS= '14:03:03'           / [old format] UTC time of exposure start\n\
             TIMESYS = 'UTC     '           / Default time system\n\
             LAT-OBS =  -3.12736111111E+001 / [deg +N WGS84] Geodetic latitude\n\
             LONG-OBS=   1.49064444444E+002 / [deg +E WGS84] Geodetic longitude\n\
             ALT-OBS =   1.16500000000E+003 / [metres] Altitude above mean sea level",
            "maxim.fit",
        );
        assert_eq!(middle(&maxim), "2018-07-04T14:05:33.0000Z");
        assert!(maxim.is_without_dark());
        assert_eq!(
            (maxim.pedestal_adu, maxim.site.unwrap().longitude_deg),
            (-100.0, 149.064_444_444)
        );
        // JD agrees to its digits, so only the whole seconds are noted.
        assert_eq!(maxim.notes.len(), 1, "{:?}", maxim.notes);

        let sharpcap = header(
            "SWCREATE= 'SharpCap'           /\n\
             CCD-TEMP=                 12.7 /\n\
             EXPTIME =                    2 /\n\
             DATE-OBS= '2019-04-29T20:25:29.8219583' / System Clock-Frame Grabbed\n\
             INSTRUME= 'ZWO ASI290MM Mini'  /",
            "sharpcap.fits",
        );
        assert_eq!(middle(&sharpcap), "2019-04-29T20:25:28.8220Z");
        assert_eq!((sharpcap.kind, sharpcap.gain_e_per_adu), (None, None));

        let apt = header(
            "DATE-OBS= '2018-09-17T21:04:46' / The UTC date and time at the start of the expo\n\
             EXPTIME =                 240. / The total exposure time in seconds\n\
             EGAIN   =     1.00224268436432 / Electronic gain in e-/ADU\n\
             JD      =     2458379.38114583 / Julian Date\n\
             SNAPSHOT=                    1 / Number of images combined\n\
             IMAGETYP= 'Light Frame'        / The type of image\n\
             SITELAT = '+51 03 00.000'      / The site Latitude\n\
             SITELONG= '+03 41 00.000'      / The site Longitude\n\
             GAIN    =                  120 / The gain set (if supported)",
            "apt.fits",
        );
        assert_eq!(middle(&apt), "2018-09-17T21:06:46.0000Z");
        assert_eq!(apt.stacked, 1);
    }

    /// Truth: by hand. INDI's and N.I.N.A.'s newer cards as their documents have them.
    #[test]
    fn times_that_mislead_are_told_apart() {
        let nina = header(
            "IMAGETYP= 'LIGHT'\n\
             EXPTIME = 10.0\n\
             DATE-OBS= '2024-02-29T23:59:58.500'\n\
             DATE-AVG= '2024-03-01T00:00:03.600'\n\
             SWCREATE= 'N.I.N.A. 3.1.2'",
            "n.fits",
        );
        assert_eq!(middle(&nina), "2024-03-01T00:00:03.6000Z");
        // 0.1 s apart: said.
        assert!(nina.notes[0].contains("-0.1000 s"), "{:?}", nina.notes);
        let tt =
            header("TIMESYS = 'TT'\nEXPTIME = 0\nDATE-OBS= '2024-01-01T00:01:09.184'", "t.fits");
        assert_eq!(middle(&tt), "2024-01-01T00:00:00.0000Z");
        let mjd = header("EXPTIME = 4\nMJD-OBS = 60310.5", "m.fits");
        assert_eq!(middle(&mjd), "2024-01-01T12:00:02.0000Z");
        let old = header("EXPTIME = 2\nDATE-OBS= '31/12/98'\nUT      = '23:59:59'", "o.fits");
        // A leap second ended that day.
        assert_eq!(middle(&old), "1998-12-31T23:59:60.0000Z");
        let error = try_header("EXPTIME = 1\nDATE-OBS= '2024-01-01'", "d.fits").unwrap_err();
        assert!(error.to_string().contains("a date without a time of day"), "{error}");
        let error =
            try_header("TIMESYS = 'LOCAL'\nDATE-OBS= '2024-01-01T00:00:00'", "d.fits").unwrap_err();
        assert_eq!(
            error.to_string(),
            "d.fits: TIMESYS: found LOCAL, expected UTC, UT, UT1, TAI, TT, TDB or GPS"
        );
        assert_eq!(header("EXPTIME = 1", "none.fits").time, None);
        let stack = header("EXPTIME = 10\nSTACKCNT= 187\nTOTALEXP= 1870", "Seestar.fit");
        assert_eq!(stack.stacked, 187);
        let named = header("EXPTIME = 10", "night/darks/0001.fits");
        assert_eq!(named.kind, Some(FrameKind::Dark));
        assert_eq!(header("EXPTIME = 10", "darkness/flatiron_1.fits").kind, None);
    }

    /// Headers in the ways of NOAO, ESO, EMCCD programs and old files (synthetic). Truth: by hand, 2024-03-05T18:00:00 and 2 s of exposure, so that the middle is at 18:00:01.
    #[test]
    fn times_of_other_observatories_are_read() {
        let at = |cards: &str| {
            let cards = format!("EXPTIME = 2.0\n{cards}");
            try_header(&cards, "x.fits").map(|h| (middle(&h), h.notes.join("; ")))
        };
        let date = "DATE-OBS= '2024-03-05'";
        let whole = "DATE-OBS= '2024-03-05T18:00:00.000'";
        for cards in [
            format!("{whole}\nTIMESYS = 'UT'"),
            format!("{whole}\nTIMESYS = 'UTC approximate'"),
            format!("{whole}\nTIMESYS = 'UTC(GPS)'"),
            "DATE-OBS= '2024-03-05T18:00:18.000'\nTIMESYS = 'GPS'".into(),
            format!("{date}\nUTC-OBS = '18:00:00.000'"),
            format!("{date}\nUTC     = '18:00:00.000'"),
            format!("{date}\nTIME-BEG= '18:00:00.000'"),
            format!("{date}\nUT      = 18.0"),
            format!("{date}\nUTC     = 64800.0 / [s] 18:00:00.000 UTC"),
            "JD-OBS  = 2460375.25".into(),
            "MJD-MID = 60374.750011574074".into(),
            "DATE-MID= '2024-03-05T18:00:01.000'".into(),
            "DATE-OBS= '2024-03-05T18:00:00.000+00:00'".into(),
            "DATE-OBS= '2024-03-05T20:00:00.000+02:00'".into(),
            "DATE-OBS= '2024-03-05T13:30:00.000-0430'".into(),
            "DATE-OBS= '2024/03/05T18:00:00.000'".into(),
            "DATE-OBS= '2024-03-05T18:00:02.000' / end of exposure (UTC)".into(),
            "DATE-OBS= '2024-03-05T18:00:01.000' / UTC mid-exposure".into(),
        ] {
            let (found, notes) = at(&cards).unwrap();
            assert_eq!(found, "2024-03-05T18:00:01.0000Z", "{cards}: {notes}");
        }
        assert!(at(&format!("{whole}\nTIMESYS = 'UTC approximate'")).unwrap().1.contains("vouch"));
        assert!(at(&format!("{whole}\nTIMESYS = 'UT1'")).unwrap().1.contains("0.9 s"));
        for (cards, words) in [
            ("DATE-OBS= '2024-03-05T19:00:00' / local time of observation", "local time"),
            ("DATE-OBS= '05/03/2024T18:00:00'", "05/03/2024"),
            ("DATE-OBS= '2024-03-05'\nUT      = 64800.0", "names the unit"),
            ("DATE-OBS= '2024-03-05T18:00:00+02:00'\nTIMESYS = 'TT'", "offset"),
        ] {
            let error = at(cards).unwrap_err().to_string();
            assert!(error.contains(words), "{cards}: {error}");
        }
    }

    /// Truth: by hand.
    #[test]
    fn exposures_have_units() {
        let seconds = |cards: &str| try_header(cards, "x.fits").map(|h| h.exposure_s);
        assert_eq!(seconds("EXPTIME = 2000 / [ms] exposure").unwrap(), Some(2.0));
        assert_eq!(seconds("EXPTIME = 2000 / exposure in milliseconds").unwrap(), Some(2.0));
        assert_eq!(seconds("EXPTIME = '2.0 s'").unwrap(), Some(2.0));
        assert_eq!(seconds("EXPTIME = '2000 ms'").unwrap(), Some(2.0));
        assert_eq!(seconds("EXPTIME = '2.0E+00'").unwrap(), Some(2.0));
        assert_eq!(seconds("ITIME   = 2.0").unwrap(), Some(2.0));
        assert_eq!(seconds("EXPTIME = 3.0 / [sec] Duration of exposure").unwrap(), Some(3.0));
        let error = seconds("EXPTIME = '2 moments'").unwrap_err().to_string();
        assert!(error.contains("`2000 ms`"), "{error}");
        let noted = header("EXPTIME = 2000 / [ms] exposure", "x.fits");
        assert!(noted.notes[0].contains("0.001 s"), "{:?}", noted.notes);
    }

    /// A file with a mask before its image, and one with two chips. Truth: the values that were put in.
    #[test]
    fn the_image_of_several_is_the_light() {
        let image = |name: &str, value: u16, side: usize| {
            let pixels = Pixels::U16(ArrayD::from_elem(IxDyn(&[side, side]), value));
            let mut image = Image { header: Header::default(), pixels };
            image.header.set("EXTNAME", name, "");
            image
        };
        let read = |images: &[Image], extension: Option<&str>| {
            let mut writer = Writer::new();
            for image in images {
                writer.image(image).unwrap();
            }
            let fits = Fits::from_bytes("m.fits", writer.into_bytes()).unwrap();
            let extension = extension.map(Extension::of);
            ImageFrame::of_fits(&fits, &ReadOptions { extension, ..ReadOptions::default() })
        };
        let masked = [image("MASK", 0, 5), image("ERR", 1, 5), image("SCI", 7, 5)];
        let frame = read(&masked, None).unwrap();
        assert_eq!(frame.pixels[[0, 0]], 7.0);
        assert!(
            frame.header.notes.iter().any(|n| n.starts_with("image 3 of 3")),
            "{:?}",
            frame.header.notes
        );
        let chips = [image("DQ", 0, 5), image("CHIP1", 1, 5), image("CHIP2", 2, 5)];
        assert_eq!(read(&chips, None).unwrap().pixels[[0, 0]], 1.0);
        assert_eq!(read(&chips, Some("chip2")).unwrap().pixels[[0, 0]], 2.0);
        assert_eq!(read(&chips, Some("2")).unwrap().pixels[[0, 0]], 2.0);
        let error = read(&chips, Some("CHIP3")).unwrap_err().to_string();
        assert!(error.contains("1 (CHIP1)") && error.contains("called CHIP3"), "{error}");
        let alone = read(&chips[1..2], None).unwrap();
        assert!(alone.header.notes.is_empty(), "{:?}", alone.header.notes);
    }

    #[test]
    fn cubes_and_lines_are_refused() {
        for shape in [&[3_usize, 4, 4][..], &[5], &[2, 4, 4]] {
            let image = Image {
                header: Header::default(),
                pixels: Pixels::U16(ArrayD::zeros(IxDyn(shape))),
            };
            let mut writer = Writer::new();
            writer.image(&image).unwrap();
            let fits = Fits::from_bytes("c.fits", writer.into_bytes()).unwrap();
            let error = ImageFrame::from_fits(&fits).unwrap_err().to_string();
            assert!(error.contains("expected one plane of pixels"), "{error}");
        }
    }

    /// A frame of a program that writes `N/A` for its time: its pixels are as good as any.
    #[test]
    fn a_time_that_is_none_matters_only_where_time_does() {
        let cards = "DATE-OBS= 'N/A'\nEXPTIME = 2".lines();
        let mut bytes = Vec::new();
        let head = [
            "SIMPLE  =                    T",
            "BITPIX  =                    8",
            "NAXIS   =                    2",
            "NAXIS1  =                    3",
            "NAXIS2  =                    2",
        ];
        for card in head.into_iter().chain(cards).chain(["END"]) {
            bytes.extend(format!("{card:<80}").into_bytes());
        }
        bytes.resize(2880, b' ');
        bytes.extend([7_u8; 6]);
        bytes.resize(5760, 0);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("n.fits");
        std::fs::write(&path, bytes).unwrap();
        assert!(ImageFrame::read(&path).unwrap_err().to_string().contains("DATE-OBS"));
        let read = ImageFrame::read_whenever(&path).unwrap();
        assert_eq!((read.header.time, read.pixels.dim()), (None, (2, 3)));
        assert!(
            read.header.notes[0].starts_with("DATE-OBS is not read: found N/A"),
            "{:?}",
            read.header.notes
        );
    }

    /// Truth: 1.5 e/ADU is that of the camera's ADU: values that a program has scaled to 0…1 are not these, values of 100 are.
    #[test]
    fn a_gain_is_of_the_cameras_adu() {
        for (most, gain) in [(0.087_f32, None), (100.0, Some(1.5))] {
            let mut header = Header::default();
            header.set("EGAIN", 1.5, "");
            header.set("EXPTIME", 1.0, "");
            header.set("DATE-OBS", "2026-03-04T05:06:07", "");
            let pixels = Pixels::F32(ArrayD::from_elem(IxDyn(&[4, 6]), most));
            let mut writer = Writer::new();
            writer.image(&Image { header, pixels }).unwrap();
            let fits = Fits::from_bytes("a.fits", writer.into_bytes()).unwrap();
            let frame = ImageFrame::from_fits(&fits).unwrap();
            assert_eq!(frame.header.gain_e_per_adu, gain, "{:?}", frame.header.notes);
            let is_told = frame.header.notes.iter().any(|n| n.contains("1.5 e/ADU"));
            assert_eq!(is_told, gain.is_none());
        }
    }
}
