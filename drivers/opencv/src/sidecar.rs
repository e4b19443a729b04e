//! The table beside a recording: when each frame began, how long it was exposed, and a check sum of its pixels.
//!
//! ECSV, `NAME.ecsv` beside `NAME`. Metadata: `quantity` `frames`, the frames' columns and rows, origin, binning and pattern, and
//! `cards`, all other cards of the first frame. A row per frame, in order.

use crate::error::wrong;
use ndarray::Array2;
use serde_json::{Value, json};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use sunglint_drivers::device::DeviceError;
use sunglint_formats::fits::{Card, CardValue, Header};
use sunglint_formats::{Bayer, Column, Frame, Meta, Table, ecsv, time};

/// Value that the metadata key `quantity` must have for a table to be one of these.
const QUANTITY: &str = "frames";

/// Information about the frames of a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Sidecar {
    /// Columns and rows of a frame, px. The recording may have one more of each, of zeros.
    pub size_px: [u32; 2],
    /// Origin of the frames on the sensor, as [`Frame::origin`].
    pub origin: [u32; 2],
    /// Binning of the frames, as [`Frame::binning`].
    pub binning: [u32; 2],
    /// Colour pattern of the frames, as [`Frame::bayer`].
    pub bayer: Option<Bayer>,
    /// A row per frame.
    pub rows: Vec<Row>,
}

/// Information about one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// Start of the exposure.
    pub start: hifitime::Epoch,
    /// Length of the exposure, s.
    pub exposure_s: f64,
    /// CRC-32 (IEEE 802.3) of the pixels, row by row, each as two bytes, the lower first.
    pub crc32: u32,
    /// Gain in electrons per ADU, as [`Frame::gain_e_per_adu`].
    pub gain_e_per_adu: Option<f64>,
    /// Temperature, °C, as [`Frame::temperature_c`].
    pub temperature_c: Option<f64>,
    /// Saturation, ADU, as [`Frame::saturation_adu`].
    pub saturation_adu: Option<f64>,
    /// Other cards of the frame, as [`Frame::header`].
    pub header: Header,
}

/// Where the table of a recording lies: the same path with `.ecsv` after it.
pub fn path_of(recording: &Path) -> PathBuf {
    let mut path = OsString::from(recording);
    path.push(".ecsv");
    path.into()
}

/// The check sum of [`Row::crc32`].
pub fn crc32(pixels: &Array2<u16>) -> u32 {
    let mut crc = flate2::Crc::new();
    let mut bytes = Vec::with_capacity(2 * pixels.ncols());
    for row in pixels.rows() {
        bytes.clear();
        bytes.extend(row.iter().flat_map(|value| value.to_le_bytes()));
        crc.update(&bytes);
    }
    crc.sum()
}

impl Row {
    pub(crate) fn of(frame: &Frame) -> Self {
        Self {
            start: frame.start,
            exposure_s: frame.exposure_s,
            crc32: crc32(&frame.pixels),
            gain_e_per_adu: frame.gain_e_per_adu,
            temperature_c: frame.temperature_c,
            saturation_adu: frame.saturation_adu,
            header: frame.header.clone(),
        }
    }
}

impl Sidecar {
    /// Makes the sidecar, without rows, for frames that are like this one.
    pub(crate) fn like(frame: &Frame) -> Self {
        let (rows, columns) = frame.pixels.dim();
        Self {
            size_px: [columns as u32, rows as u32],
            origin: frame.origin,
            binning: frame.binning,
            bayer: frame.bayer,
            rows: Vec::new(),
        }
    }

    /// The table. Frames whose other cards are those of the first have an empty `cards`.
    pub fn table(&self) -> Table {
        let first = self.rows.first().map(|row| row.header.clone()).unwrap_or_default();
        self.table_after(&first)
    }

    /// The table of frames of a recording whose first has these cards.
    pub(crate) fn table_after(&self, first: &Header) -> Table {
        let mut meta = Meta::new();
        meta.insert("quantity".into(), QUANTITY.into());
        for (name, value) in [
            ("columns_px", self.size_px[0]),
            ("rows_px", self.size_px[1]),
            ("origin_x_px", self.origin[0]),
            ("origin_y_px", self.origin[1]),
            ("binning_x", self.binning[0]),
            ("binning_y", self.binning[1]),
        ] {
            meta.insert(name.into(), value.into());
        }
        if let Some(bayer) = self.bayer {
            meta.insert("bayer".into(), bayer.name().into());
        }
        meta.insert("cards".into(), cards_to_json(first));
        let number = |name: &str, unit, value: fn(&Row) -> Option<f64>| {
            let values = self.rows.iter().map(|row| value(row).unwrap_or(f64::NAN)).collect();
            Column::f64(name, Some(unit), values)
        };
        let text = |name: &str, value: &dyn Fn(&Row) -> String| {
            Column::text(name, self.rows.iter().map(value).collect())
        };
        let cards = |row: &Row| match &row.header {
            header if header == first => String::new(),
            header => cards_to_json(header).to_string(),
        };
        let columns = vec![
            text("time_utc", &|row| time::format_utc_shortest(row.start))
                .described("start of the exposure"),
            number("exposure_s", "s", |row| Some(row.exposure_s)),
            number("gain_e_per_adu", "electron / adu", |row| row.gain_e_per_adu),
            number("temperature_c", "deg_C", |row| row.temperature_c),
            number("saturation_adu", "adu", |row| row.saturation_adu),
            text("crc32", &|row| format!("{:08x}", row.crc32))
                .described("of the pixels, row by row, two bytes each, the lower first"),
            text("cards", &cards)
                .described("other cards, where they are not those of the first frame"),
        ];
        Table { meta, columns }
    }

    /// Reads the table of a recording; `None` if it has none.
    ///
    /// # Errors
    /// A table that is not one of these, with what is wrong.
    pub fn read(recording: &Path) -> Result<Option<Self>, DeviceError> {
        let path = path_of(recording);
        if !path.exists() {
            return Ok(None);
        }
        let table = ecsv::read(&path).map_err(|error| wrong(error.to_string()))?;
        Self::from_table(&table)
            .map(Some)
            .map_err(|what| wrong(format!("{}: {what}", path.display())))
    }

    /// Reads the sidecar from a table.
    ///
    /// # Errors
    /// A text that says what is wrong with the table.
    pub fn from_table(table: &Table) -> Result<Self, String> {
        if table.meta_text("quantity") != Some(QUANTITY) {
            return Err(format!(
                "found no `quantity: {QUANTITY}` in the metadata: is it of another kind?"
            ));
        }
        let whole = |name: &str, least: u32| {
            let value = table.meta.get(name).and_then(Value::as_u64);
            let value = value.and_then(|value| u32::try_from(value).ok());
            value.filter(|&value| value >= least).ok_or_else(|| {
                let found = table.meta.get(name).map_or("nothing".into(), Value::to_string);
                format!("{name}: found {found}, expected a whole number of {least} or above")
            })
        };
        let bayer = match table.meta.get("bayer") {
            None => None,
            Some(name) => Some(name.as_str().and_then(Bayer::from_name).ok_or_else(|| {
                format!("bayer: found {name}, expected RGGB, GRBG, GBRG or BGGR")
            })?),
        };
        Ok(Self {
            size_px: [whole("columns_px", 1)?, whole("rows_px", 1)?],
            origin: [whole("origin_x_px", 0)?, whole("origin_y_px", 0)?],
            binning: [whole("binning_x", 1)?, whole("binning_y", 1)?],
            bayer,
            rows: rows_of(table)?,
        })
    }
}

fn rows_of(table: &Table) -> Result<Vec<Row>, String> {
    let first = cards_from_json(table.meta.get("cards").unwrap_or(&Value::Array(Vec::new())))?;
    let numbers = |name: &str, unit| table.quantity(name, unit).map_err(|error| error.to_string());
    let texts = |name: &str| table.text(name).map_err(|error| error.to_string());
    let (times, sums, cards) = (texts("time_utc")?, texts("crc32")?, texts("cards")?);
    let exposures = numbers("exposure_s", "s")?;
    let gains = numbers("gain_e_per_adu", "electron / adu")?;
    let temperatures = numbers("temperature_c", "deg_C")?;
    let saturations = numbers("saturation_adu", "adu")?;
    let row = |i: usize| -> Result<Row, String> {
        let time = times[i].as_deref().unwrap_or_default();
        let sum = sums[i].as_deref().unwrap_or_default();
        let exposure_s = exposures[i];
        if !(exposure_s.is_finite() && exposure_s >= 0.0) {
            return Err(format!("exposure_s: found {exposure_s}, expected 0 or above"));
        }
        let header = match cards[i].as_deref().unwrap_or_default() {
            "" => first.clone(),
            text => {
                let value = serde_json::from_str(text).map_err(|e| format!("cards: {e}"))?;
                cards_from_json(&value)?
            }
        };
        let known = |value: f64| Some(value).filter(|value| !value.is_nan());
        Ok(Row {
            start: time::parse_utc(time).map_err(|e| format!("time_utc: {e}"))?,
            exposure_s,
            crc32: u32::from_str_radix(sum, 16)
                .map_err(|_| format!("crc32: found `{sum}`, expected 8 hexadecimal digits"))?,
            gain_e_per_adu: known(gains[i]),
            temperature_c: known(temperatures[i]),
            saturation_adu: known(saturations[i]),
            header,
        })
    };
    (0..table.rows()).map(|i| row(i).map_err(|what| format!("row {i}: {what}"))).collect()
}

/// Each card as `[keyword, kind, value, comment]`.
fn cards_to_json(header: &Header) -> Value {
    let card = |card: &Card| {
        let (kind, value) = match &card.value {
            CardValue::Undefined => ("undefined", Value::Null),
            CardValue::Logical(value) => ("logical", (*value).into()),
            CardValue::Integer(value) => ("integer", (*value).into()),
            // As text: a number that is not finite is none in JSON.
            CardValue::Real(value) => ("real", format!("{value:?}").into()),
            CardValue::Text(value) => ("text", value.as_str().into()),
            CardValue::Commentary(value) => ("commentary", value.as_str().into()),
            other => ("other", other_text(other).into()),
        };
        json!([card.keyword, kind, value, card.comment])
    };
    Value::Array(header.cards.iter().map(card).collect())
}

fn other_text(value: &CardValue) -> String {
    match value {
        CardValue::Other(text) => text.clone(),
        value => value.to_string(),
    }
}

fn cards_from_json(value: &Value) -> Result<Header, String> {
    let bad =
        |found: &Value| format!("cards: found {found}, expected [keyword, kind, value, comment]");
    let card = |entry: &Value| -> Option<Card> {
        let [keyword, kind, value, comment] = entry.as_array()?.as_slice() else { return None };
        let text = |value: &Value| value.as_str().map(str::to_owned);
        let value = match kind.as_str()? {
            "undefined" => CardValue::Undefined,
            "logical" => CardValue::Logical(value.as_bool()?),
            "integer" => CardValue::Integer(value.as_i64()?),
            "real" => CardValue::Real(value.as_str()?.parse().ok()?),
            "text" => CardValue::Text(text(value)?),
            "commentary" => CardValue::Commentary(text(value)?),
            "other" => CardValue::Other(text(value)?),
            _ => return None,
        };
        Some(Card { keyword: text(keyword)?, value, comment: text(comment)? })
    };
    let entries = value.as_array().ok_or_else(|| bad(value))?;
    let cards: Result<_, String> =
        entries.iter().map(|entry| card(entry).ok_or_else(|| bad(entry))).collect();
    Ok(Header { cards: cards? })
}
