//! A frame of a camera, and its FITS file.

use crate::atomic::Overwrite;
use crate::error::{EncodeError, FileError, ParseError};
use crate::fits::{CardValue, Fits, Header, Image, Kind, Pixels, Writer};
use crate::time::{format_utc_shortest, parse_utc};
use hifitime::Epoch;
use ndarray::Array2;
use std::path::Path;

/// A frame of a camera: the pixels, and what is needed to make sense of them.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// The pixels in ADU, `[row, column]`, in the order of the file (the first row is `ROWORDER`'s first). 16 bits hold
    /// what every camera here delivers; 8-bit streams fit in.
    pub pixels: Array2<u16>,
    /// Column and row of the sensor of the frame's first pixel, in unbinned pixels. Multiples of the binning.
    pub origin: [u32; 2],
    /// Sensor columns and rows in one pixel.
    pub binning: [u32; 2],
    /// The colours of the frame's own first 2 × 2 pixels; `None` for a monochrome or a binned frame. See
    /// [`Bayer::of_frame`].
    pub bayer: Option<Bayer>,
    /// Start of the exposure.
    pub start: Epoch,
    /// Length of the exposure, s.
    pub exposure_s: f64,
    /// Electrons for one ADU.
    pub gain_e_per_adu: Option<f64>,
    /// Temperature of the sensor, °C.
    pub temperature_c: Option<f64>,
    /// ADU from which a pixel counts as saturated.
    pub saturation_adu: Option<f64>,
    /// All other cards.
    pub header: Header,
}

/// The colours of a colour sensor's pixels: first row, then second.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Bayer {
    /// Red, green / green, blue.
    Rggb,
    /// Green, red / blue, green.
    Grbg,
    /// Green, blue / red, green.
    Gbrg,
    /// Blue, green / green, red.
    Bggr,
}

impl Bayer {
    /// The name in FITS (`RGGB`).
    pub fn name(self) -> &'static str {
        match self {
            Self::Rggb => "RGGB",
            Self::Grbg => "GRBG",
            Self::Gbrg => "GBRG",
            Self::Bggr => "BGGR",
        }
    }

    /// The pattern of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        [Self::Rggb, Self::Grbg, Self::Gbrg, Self::Bggr].into_iter().find(|b| b.name() == name)
    }

    /// The pattern as seen from a pixel so many columns and rows further.
    #[must_use]
    pub fn shifted(self, columns: u32, rows: u32) -> Self {
        let column = match self {
            _ if columns.is_multiple_of(2) => self,
            Self::Rggb => Self::Grbg,
            Self::Grbg => Self::Rggb,
            Self::Gbrg => Self::Bggr,
            Self::Bggr => Self::Gbrg,
        };
        match column {
            _ if rows.is_multiple_of(2) => column,
            Self::Rggb => Self::Gbrg,
            Self::Gbrg => Self::Rggb,
            Self::Grbg => Self::Bggr,
            Self::Bggr => Self::Grbg,
        }
    }

    /// The pattern at the first pixel of a frame of a sensor with the pattern `self`: an odd origin shifts it, binning
    /// leaves none.
    ///
    /// For drivers: cameras (INDI's among them) say the pattern of the sensor whatever the origin is.
    pub fn of_frame(self, origin: [u32; 2], binning: [u32; 2]) -> Option<Self> {
        (binning == [1, 1]).then(|| self.shifted(origin[0], origin[1]))
    }
}

/// Cards that have a place of their own in [`Frame`].
const OWN: [&str; 15] = [
    "DATE-OBS", "TIMESYS", "EXPTIME", "EXPOSURE", "EGAIN", "CCD-TEMP", "SATURATE", "XBINNING",
    "YBINNING", "XORGSUBF", "YORGSUBF", "BAYERPAT", "XBAYROFF", "YBAYROFF", "COLORTYP",
];

impl Frame {
    /// Reads the first image of a FITS file as a frame; see [`Frame::from_fits`].
    pub fn read(path: impl AsRef<Path>) -> Result<Self, FileError> {
        Ok(Self::from_fits(&Fits::read(path)?)?)
    }

    /// The frame in a FITS file (its first image).
    ///
    /// `DATE-OBS` (UTC) and `EXPTIME` (or `EXPOSURE`), s, must be there. Optional: `EGAIN`, e⁻/ADU (a `GAIN` is the
    /// setting of the camera, in its own units, and stays among the other cards unless its comment says e-/ADU);
    /// `CCD-TEMP`, °C; `SATURATE`, ADU; `XBINNING`, `YBINNING`; `XORGSUBF`, `YORGSUBF`, in binned pixels as SBFITSEXT
    /// has them; `BAYERPAT` with `XBAYROFF` and `YBAYROFF`, which are applied.
    ///
    /// A camera may say the sensor's pattern beside an odd origin: a driver that knows the origin sets
    /// [`Bayer::of_frame`] itself.
    ///
    /// # Errors
    /// A [`ParseError`] with the keyword: no 2-d image, values that do not fit 16 bits unsigned, a card missing or out
    /// of range.
    pub fn from_fits(fits: &Fits) -> Result<Self, ParseError> {
        let path = fits.path();
        let index = fits
            .first(Kind::Image)
            .ok_or_else(|| ParseError::new(path, "no image", "a FITS file with a frame"))?;
        let Image { header, pixels } = fits.image(index)?;
        let cards = Cards { path, header: &header };
        let start = cards.start()?;
        let exposure_s = match cards.number("EXPTIME", 0.0)? {
            Some(value) => value,
            None => cards.number("EXPOSURE", 0.0)?.ok_or_else(|| cards.missing("EXPTIME"))?,
        };
        let binning = [cards.whole("XBINNING", 1, 1)?, cards.whole("YBINNING", 1, 1)?];
        let origin = [cards.origin("XORGSUBF", binning[0])?, cards.origin("YORGSUBF", binning[1])?];
        let bayer = cards.bayer()?.filter(|_| binning == [1, 1]);
        let gain_e_per_adu = match cards.number("EGAIN", 0.0)? {
            Some(gain) => Some(gain),
            None if cards.gain_is_in_electrons() => cards.number("GAIN", 0.0)?,
            None => None,
        };
        let temperature_c = cards.number("CCD-TEMP", -273.15)?;
        let saturation_adu = cards.number("SATURATE", 0.0)?;
        let pixels = pixels_u16(path, pixels)?;
        let mut header = header;
        header.cards.retain(|card| !OWN.contains(&card.keyword.as_str()));
        Ok(Self {
            pixels,
            origin,
            binning,
            bayer,
            start,
            exposure_s,
            gain_e_per_adu,
            temperature_c,
            saturation_adu,
            header,
        })
    }

    /// Returns the mean of the pixels, ADU; 0 without pixels.
    pub fn mean_adu(&self) -> f64 {
        let sum: u64 = self.pixels.iter().map(|&pixel| u64::from(pixel)).sum();
        sum as f64 / self.pixels.len().max(1) as f64
    }

    /// Returns the median of the pixels, ADU, the upper one of two; `None` without pixels.
    pub fn median_adu(&self) -> Option<f64> {
        let mut pixels: Vec<u16> = self.pixels.iter().copied().collect();
        let middle = pixels.len() / 2;
        (middle < pixels.len()).then(|| f64::from(*pixels.select_nth_unstable(middle).1))
    }

    /// Returns the largest pixel, ADU; 0 without pixels.
    pub fn most_adu(&self) -> u16 {
        self.pixels.iter().copied().max().unwrap_or(0)
    }

    /// The frame as an image for FITS.
    ///
    /// # Errors
    /// An origin that is no multiple of the binning (SBFITSEXT counts it in binned pixels); a number that is not
    /// finite.
    pub fn to_image(&self) -> Result<Image, EncodeError> {
        let mut header = Header::default();
        let start = format_utc_shortest(self.start);
        header.set("DATE-OBS", start.trim_end_matches('Z'), "start of the exposure, UTC");
        header.set("TIMESYS", "UTC", "");
        header.set("EXPTIME", self.exposure_s, "s");
        for (keyword, binning) in ["XBINNING", "YBINNING"].into_iter().zip(self.binning) {
            if binning == 0 {
                return Err(EncodeError::new(keyword, "0", "1 or more"));
            }
            header.set(keyword, i64::from(binning), "");
        }
        for (keyword, (origin, binning)) in
            ["XORGSUBF", "YORGSUBF"].into_iter().zip(self.origin.into_iter().zip(self.binning))
        {
            if origin % binning != 0 {
                let expected = format!("a multiple of the binning, {binning}");
                return Err(EncodeError::new(keyword, origin.to_string(), expected));
            }
            header.set(keyword, i64::from(origin / binning), "origin on the sensor, binned pixels");
        }
        if let Some(bayer) = self.bayer {
            header.set("BAYERPAT", bayer.name(), "at the first pixel of this frame");
            header.set("XBAYROFF", 0_i64, "");
            header.set("YBAYROFF", 0_i64, "");
        }
        for (keyword, value, comment) in [
            ("EGAIN", self.gain_e_per_adu, "e-/ADU"),
            ("CCD-TEMP", self.temperature_c, "degrees Celsius"),
            ("SATURATE", self.saturation_adu, "ADU"),
        ] {
            if let Some(value) = value {
                header.set(keyword, value, comment);
            }
        }
        let own = |keyword: &str| OWN.contains(&keyword);
        header.cards.extend(self.header.cards.iter().filter(|c| !own(&c.keyword)).cloned());
        Ok(Image { header, pixels: Pixels::U16(self.pixels.clone().into_dyn()) })
    }

    /// Writes the frame as a FITS file, whole or not at all.
    pub fn write_file(
        &self,
        path: impl AsRef<Path>,
        overwrite: Overwrite,
    ) -> Result<(), FileError> {
        self.write_file_at(path.as_ref(), overwrite)
    }

    fn write_file_at(&self, path: &Path, overwrite: Overwrite) -> Result<(), FileError> {
        let mut writer = Writer::new();
        self.to_image()
            .and_then(|image| writer.image(&image))
            .map_err(|source| FileError::encode(path, source))?;
        writer.write_file(path, overwrite)
    }
}

fn pixels_u16(path: &Path, pixels: Pixels) -> Result<Array2<u16>, ParseError> {
    let bad = |field: &str, found: String, expected: &str| {
        ParseError::new(path, found, expected).in_field(field)
    };
    let axes = pixels.shape().len();
    let plane = pixels.rows_and_columns();
    let array = match pixels {
        Pixels::U16(array) => array,
        Pixels::U8(array) => array.mapv(u16::from),
        // Some writers leave BZERO out; what they mean is only clear without negative values.
        Pixels::I16(array) => match array.iter().find(|&&value| value < 0) {
            None => array.mapv(|value| value as u16),
            Some(value) => {
                return Err(bad("BZERO", format!("the value {value}"), "0 to 65535 (BZERO 32768)"));
            }
        },
        _ => return Err(bad("BITPIX", "another type".into(), "8 or 16 bits without a scale")),
    };
    let plane = plane.and_then(|plane| array.into_shape_with_order(plane).ok());
    plane.ok_or_else(|| bad("NAXIS", format!("{axes} axes"), "2 axes (one plane)"))
}

/// Typed access with errors that name the keyword.
struct Cards<'a> {
    path: &'a Path,
    header: &'a Header,
}

impl Cards<'_> {
    fn bad(
        &self,
        keyword: &str,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> ParseError {
        ParseError::new(self.path, found, expected).in_field(keyword)
    }

    fn missing(&self, keyword: &str) -> ParseError {
        self.bad(keyword, "no such card", "a value for it")
    }

    fn start(&self) -> Result<Epoch, ParseError> {
        match self.header.get("TIMESYS") {
            None => {}
            Some(CardValue::Text(system)) if system == "UTC" => {}
            Some(other) => return Err(self.bad("TIMESYS", other.to_string(), "`UTC`")),
        }
        match self.header.get("DATE-OBS") {
            None => Err(self.missing("DATE-OBS")),
            Some(CardValue::Text(text)) => {
                parse_utc(text).map_err(|error| error.in_file(self.path).in_field("DATE-OBS"))
            }
            Some(other) => Err(self.bad("DATE-OBS", other.to_string(), "a text")),
        }
    }

    /// A number of at least `least`.
    fn number(&self, keyword: &str, least: f64) -> Result<Option<f64>, ParseError> {
        let Some(value) = self.header.get(keyword) else { return Ok(None) };
        match value.real().filter(|&number| number >= least) {
            Some(number) => Ok(Some(number)),
            None => {
                Err(self.bad(keyword, value.to_string(), format!("a number of {least} or above")))
            }
        }
    }

    /// A whole number of at least `least`.
    fn whole(&self, keyword: &str, default: u32, least: u32) -> Result<u32, ParseError> {
        let Some(value) = self.header.get(keyword) else { return Ok(default) };
        let number = value.integer().and_then(|number| u32::try_from(number).ok());
        number.filter(|&number| number >= least).ok_or_else(|| {
            self.bad(keyword, value.to_string(), format!("a whole number of {least} or above"))
        })
    }

    fn origin(&self, keyword: &str, binning: u32) -> Result<u32, ParseError> {
        let binned = self.whole(keyword, 0, 0)?;
        binned
            .checked_mul(binning)
            .ok_or_else(|| self.bad(keyword, binned.to_string(), "a place on the sensor"))
    }

    fn bayer(&self) -> Result<Option<Bayer>, ParseError> {
        let Some(value) = self.header.get("BAYERPAT") else { return Ok(None) };
        let Some(pattern) = value.text().map(str::trim).and_then(Bayer::from_name) else {
            return Err(self.bad("BAYERPAT", value.to_string(), "RGGB, GRBG, GBRG or BGGR"));
        };
        if let Some(order) = self.header.text("ROWORDER").filter(|&order| order != "TOP-DOWN") {
            let error = self.bad("ROWORDER", order, "TOP-DOWN beside a BAYERPAT");
            return Err(
                error.with_hint("bottom up it is not clear to which row the pattern belongs")
            );
        }
        let columns = self.whole("XBAYROFF", 0, 0)?;
        let rows = self.whole("YBAYROFF", 0, 0)?;
        Ok(Some(pattern.shifted(columns, rows)))
    }

    fn gain_is_in_electrons(&self) -> bool {
        self.header.cards.iter().any(|card| {
            let comment = card.comment.to_lowercase();
            card.keyword == "GAIN" && (comment.contains("e-/adu") || comment.contains("electron"))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::array;

    fn frame() -> Frame {
        let mut header = Header::default();
        header.set("INSTRUME", "CCD", "");
        header.set("GAIN", 120_i64, "setting");
        header.history("made here");
        Frame {
            pixels: array![[0, 1, 2], [3, 4, u16::MAX]],
            origin: [501, 402],
            binning: [1, 1],
            bayer: Bayer::Rggb.of_frame([501, 402], [1, 1]),
            start: parse_utc("2016-12-31T23:59:60.123456789").unwrap(),
            exposure_s: 0.1,
            gain_e_per_adu: Some(0.27),
            temperature_c: Some(-10.0),
            saturation_adu: Some(65535.0),
            header,
        }
    }

    fn bytes(frame: &Frame) -> Vec<u8> {
        let mut writer = Writer::new();
        writer.image(&frame.to_image().unwrap()).unwrap();
        writer.into_bytes()
    }

    fn back(bytes: Vec<u8>) -> Result<Frame, ParseError> {
        Frame::from_fits(&Fits::from_bytes("f.fits", bytes)?)
    }

    #[test]
    fn a_frame_comes_back_from_fits() {
        assert_eq!(back(bytes(&frame())).unwrap(), frame());
        let binned = Frame { origin: [8, 4], binning: [4, 2], bayer: None, ..frame() };
        let header = binned.to_image().unwrap().header;
        assert_eq!((header.integer("XORGSUBF"), header.integer("YORGSUBF")), (Some(2), Some(2)));
        assert_eq!(back(bytes(&binned)).unwrap(), binned);
    }

    #[test]
    fn an_odd_origin_shifts_the_pattern() {
        // Truth: the mosaic itself, pixel by pixel.
        let mosaic = |b: Bayer, x: u32, y: u32| b.name().as_bytes()[(y % 2 * 2 + x % 2) as usize];
        for sensor in [Bayer::Rggb, Bayer::Grbg, Bayer::Gbrg, Bayer::Bggr] {
            for origin in [[0, 0], [501, 402], [502, 401], [501, 401]] {
                let seen = sensor.of_frame(origin, [1, 1]).unwrap();
                for (x, y) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    assert_eq!(mosaic(seen, x, y), mosaic(sensor, x + origin[0], y + origin[1]));
                }
            }
        }
        assert_eq!(Bayer::Rggb.of_frame([0, 0], [2, 2]), None);
        // XBAYROFF in a foreign file says the same.
        let mut image = frame().to_image().unwrap();
        image.header.set("BAYERPAT", "RGGB", "");
        image.header.set("XBAYROFF", 1_i64, "");
        let mut writer = Writer::new();
        writer.image(&image).unwrap();
        assert_eq!(back(writer.into_bytes()).unwrap().bayer, Some(Bayer::Grbg));
    }

    #[track_caller]
    fn refused(change: impl FnOnce(&mut Image), message: &str) {
        let mut image = frame().to_image().unwrap();
        change(&mut image);
        let mut writer = Writer::new();
        writer.image(&image).unwrap();
        assert_eq!(back(writer.into_bytes()).unwrap_err().to_string(), message);
    }

    #[test]
    fn what_is_wrong_is_named_with_its_keyword() {
        refused(
            |image| image.header.remove("EXPTIME"),
            "f.fits: EXPTIME: found no such card, expected a value for it",
        );
        refused(
            |image| image.header.set("EXPTIME", -1.0, ""),
            "f.fits: EXPTIME: found -1.0, expected a number of 0 or above",
        );
        refused(
            |image| image.header.set("DATE-OBS", "04/03/26", ""),
            "f.fits: DATE-OBS: found `04/03/26`, expected UTC as 2026-03-04T05:06:07.89Z",
        );
        refused(
            |image| image.header.set("TIMESYS", "TAI", ""),
            "f.fits: TIMESYS: found the text `TAI`, expected `UTC`",
        );
        refused(
            |image| image.header.set("XBINNING", 0_i64, ""),
            "f.fits: XBINNING: found 0, expected a whole number of 1 or above",
        );
        refused(
            |image| image.header.set("BAYERPAT", "XYZ", ""),
            "f.fits: BAYERPAT: found the text `XYZ`, expected RGGB, GRBG, GBRG or BGGR",
        );
        refused(
            |image| image.pixels = Pixels::I16(array![[1_i16, -2]].into_dyn()),
            "f.fits: BZERO: found the value -2, expected 0 to 65535 (BZERO 32768)",
        );
        refused(
            |image| image.pixels = Pixels::F32(array![[1_f32, -2.0]].into_dyn()),
            "f.fits: BITPIX: found another type, expected 8 or 16 bits without a scale",
        );
        refused(
            |image| {
                image.pixels =
                    Pixels::U16(array![[[1_u16, 2], [3, 4]], [[5, 6], [7, 8]]].into_dyn())
            },
            "f.fits: NAXIS: found 3 axes, expected 2 axes (one plane)",
        );
    }

    #[test]
    fn an_origin_between_binned_pixels_is_not_written() {
        let frame = Frame { origin: [3, 0], binning: [2, 2], ..frame() };
        assert_eq!(
            frame.to_image().unwrap_err().to_string(),
            "XORGSUBF: found 3, expected a multiple of the binning, 2"
        );
    }
}
