//! Readings of a device, as text, tables, FITS and JSON.

use super::{AboutJson, about, title};
use crate::{Product, json_of};
use hifitime::Epoch;
use serde::Serialize;
use serde_json::{Map, Value};
use std::fmt::Write as _;
use sunglint_drivers::device::{Level, MountPlace, Power, Spectrum};
use sunglint_drivers::session::{Reading, Readings};
use sunglint_formats::fits::Writer;
use sunglint_formats::time::format_utc;
use sunglint_formats::{Column, CountSeries, EncodeError, Frame, Meta, Table, Values};

/// Returns a time as UTC, to the millisecond.
fn utc(time: Epoch) -> String {
    format_utc(time, 3)
}

/// Returns readings as text; a line says so where they are not all.
pub fn readings_text(done: &Readings) -> String {
    let mut text = title(&done.address, &done.identity) + "\n";
    for reading in &done.readings {
        let _ = writeln!(text, "  {}", reading_text(reading));
    }
    if done.error.is_some() {
        let _ =
            writeln!(text, "  {} of {} readings, then it failed", done.readings.len(), done.asked);
    }
    text
}

#[derive(Serialize)]
struct ReadingsJson<'a> {
    #[serde(flatten)]
    about: AboutJson<'a>,
    readings: Vec<ReadingJson<'a>>,
    complete: bool,
    error: Option<&'a str>,
}

/// Returns readings as a table and as JSON, and frames as FITS; `error` says why they are not all.
///
/// # Errors
/// Counts or a frame that cannot be written.
pub fn readings(done: &Readings, error: Option<&str>) -> Result<Product, EncodeError> {
    let mut product = product(&done.readings)?;
    product.table.meta.insert("device".into(), title(&done.address, &done.identity).into());
    product.json = json_of(&ReadingsJson {
        about: about(&done.address, Some(&done.identity)),
        readings: done.readings.iter().map(reading_json).collect(),
        complete: error.is_none(),
        error,
    });
    Ok(product)
}

/// Returns a reading in a line.
pub fn reading_text(reading: &Reading) -> String {
    match reading {
        Reading::Power { time, power: Power::Watts(watts) } => {
            format!("{}  {watts:.6e} W", utc(*time))
        }
        Reading::Power { time, power: Power::Over { range_w: Some(range) } } => {
            format!("{}  more than its range of {range:e} W", utc(*time))
        }
        Reading::Power { time, .. } => format!("{}  more than its range", utc(*time)),
        Reading::Angle { time, angle_deg } => format!("{}  {angle_deg:.4} deg", utc(*time)),
        Reading::Slot { time, slot } => format!("{}  slot {slot}", utc(*time)),
        Reading::Steps { time, steps, temperature_c } => {
            let temperature = temperature_c.map(|c| format!(", {c:.1} °C")).unwrap_or_default();
            format!("{}  position {steps}{temperature}", utc(*time))
        }
        Reading::Place { time, place } => {
            let text = match place {
                MountPlace::Equatorial { ra_deg, dec_deg } => {
                    format!("RA {ra_deg:.5} deg, declination {dec_deg:+.5} deg (of date)")
                }
                MountPlace::Horizontal { azimuth_deg, altitude_deg } => {
                    format!("azimuth {azimuth_deg:.5} deg, altitude {altitude_deg:+.5} deg")
                }
            };
            format!("{}  {text}", utc(*time))
        }
        Reading::Level { time, level: Level::Value(value), unit } => {
            format!("{}  {value:.6e} {unit}", utc(*time))
        }
        Reading::Level { time, .. } => format!("{}  more than its range", utc(*time)),
        Reading::Wavelength { time, wavelength_nm } => {
            format!("{}  {wavelength_nm:.3} nm", utc(*time))
        }
        Reading::Spectrum(spectrum) => spectrum_text(spectrum),
        Reading::Frame(frame) => {
            let (mean, most) = (frame.mean_adu(), frame.most_adu());
            let (rows, columns) = frame.pixels.dim();
            let temperature = frame.temperature_c.map(|t| format!(", {t:.1} °C"));
            format!(
                "{}  {columns} x {rows} px, {} s, mean {mean:.1} ADU, at most {most} ADU{}",
                format_utc(frame.start, 3),
                frame.exposure_s,
                temperature.unwrap_or_default()
            )
        }
        Reading::Counts { channels, record } => {
            let mut text = format_utc(record.start, 3);
            for (channel, counts) in channels.iter().zip(&record.counts) {
                let _ = write!(text, "  {channel} {counts}");
            }
            if !record.flags.is_empty() {
                let names: Vec<String> =
                    record.flags.iter_names().map(|(name, _)| name.to_lowercase()).collect();
                let _ = write!(text, "  ({})", names.join(", "));
            }
            text
        }
    }
}

/// Returns a spectrum in a line: its ends and its highest value.
fn spectrum_text(spectrum: &Spectrum) -> String {
    let Spectrum { wavelength_nm, counts, integration_s, .. } = spectrum;
    let mut text = format!("{}  {} values, {integration_s} s", utc(spectrum.start), counts.len());
    if let (Some(from), Some(to)) = (wavelength_nm.first(), wavelength_nm.last()) {
        let _ = write!(text, ", {from:.1} to {to:.1} nm");
    }
    let most = wavelength_nm.iter().zip(counts).max_by(|a, b| a.1.total_cmp(b.1));
    if let Some((nm, most)) = most {
        let _ = write!(text, ", at most {most} counts at {nm:.1} nm");
    }
    text + if spectrum.is_saturated() { " (saturated)" } else { "" }
}

/// Returns spectra as a table, one row a value.
fn spectra_table<'a>(spectra: impl Iterator<Item = &'a Spectrum>) -> Table {
    let (mut time, mut exposure, mut nm, mut counts) = (vec![], vec![], vec![], vec![]);
    for spectrum in spectra {
        for (wavelength, value) in spectrum.wavelength_nm.iter().zip(&spectrum.counts) {
            time.push(utc(spectrum.start));
            exposure.push(spectrum.integration_s);
            nm.push(*wavelength);
            counts.push(*value);
        }
    }
    let columns = vec![
        Column::text("time_utc", time),
        Column::f64("exposure_s", Some("s"), exposure),
        Column::f64("wavelength_nm", Some("nm"), nm),
        Column::f64("counts", Some("ct"), counts),
    ];
    Table { columns, ..Table::default() }
}

/// A reading's keys.
#[derive(Serialize)]
#[serde(untagged)]
enum ReadingJson<'a> {
    Power {
        time_utc: String,
        power_w: Option<f64>,
        over: bool,
    },
    Angle {
        time_utc: String,
        angle_deg: f64,
    },
    Slot {
        time_utc: String,
        slot: u32,
    },
    Steps {
        time_utc: String,
        position_steps: i64,
        temperature_c: Option<f64>,
    },
    Equatorial {
        time_utc: String,
        ra_deg: f64,
        dec_deg: f64,
    },
    Horizontal {
        time_utc: String,
        azimuth_deg: f64,
        altitude_deg: f64,
    },
    Level {
        time_utc: String,
        level: Option<f64>,
        unit: &'a str,
        over: bool,
    },
    Wavelength {
        time_utc: String,
        wavelength_nm: f64,
    },
    Spectrum {
        time_utc: String,
        exposure_s: f64,
        wavelength_nm: &'a [f64],
        counts: &'a [f64],
        over: bool,
    },
    Frame {
        time_utc: String,
        exposure_s: f64,
        columns_px: usize,
        rows_px: usize,
        mean_adu: f64,
        most_adu: u16,
        temperature_c: Option<f64>,
    },
    Counts {
        time_utc: String,
        exposure_s: f64,
        counts: Map<String, Value>,
        missed: Map<String, Value>,
    },
}

fn reading_json(reading: &Reading) -> ReadingJson<'_> {
    use ReadingJson as Keys;
    match reading {
        Reading::Power { time, power } => {
            let power_w = if let Power::Watts(watts) = power { Some(*watts) } else { None };
            Keys::Power { time_utc: utc(*time), power_w, over: power_w.is_none() }
        }
        Reading::Angle { time, angle_deg } => {
            Keys::Angle { time_utc: utc(*time), angle_deg: *angle_deg }
        }
        Reading::Slot { time, slot } => Keys::Slot { time_utc: utc(*time), slot: *slot },
        Reading::Steps { time, steps, temperature_c } => Keys::Steps {
            time_utc: utc(*time),
            position_steps: *steps,
            temperature_c: *temperature_c,
        },
        Reading::Place { time, place } => match *place {
            MountPlace::Equatorial { ra_deg, dec_deg } => {
                Keys::Equatorial { time_utc: utc(*time), ra_deg, dec_deg }
            }
            MountPlace::Horizontal { azimuth_deg, altitude_deg } => {
                Keys::Horizontal { time_utc: utc(*time), azimuth_deg, altitude_deg }
            }
        },
        Reading::Level { time, level, unit } => {
            let level = if let Level::Value(value) = level { Some(*value) } else { None };
            Keys::Level { time_utc: utc(*time), level, unit, over: level.is_none() }
        }
        Reading::Wavelength { time, wavelength_nm } => {
            Keys::Wavelength { time_utc: utc(*time), wavelength_nm: *wavelength_nm }
        }
        Reading::Spectrum(spectrum) => Keys::Spectrum {
            time_utc: utc(spectrum.start),
            exposure_s: spectrum.integration_s,
            wavelength_nm: &spectrum.wavelength_nm,
            counts: &spectrum.counts,
            over: spectrum.is_saturated(),
        },
        Reading::Frame(frame) => {
            let (rows_px, columns_px) = frame.pixels.dim();
            Keys::Frame {
                time_utc: format_utc(frame.start, 6),
                exposure_s: frame.exposure_s,
                columns_px,
                rows_px,
                mean_adu: frame.mean_adu(),
                most_adu: frame.most_adu(),
                temperature_c: frame.temperature_c,
            }
        }
        Reading::Counts { channels, record } => {
            let of = |values: &[u64]| {
                channels.iter().cloned().zip(values.iter().map(|n| Value::from(*n))).collect()
            };
            Keys::Counts {
                time_utc: format_utc(record.start, 6),
                exposure_s: record.length_ps as f64 * 1e-12,
                counts: of(&record.counts),
                missed: of(&record.missed),
            }
        }
    }
}

/// Returns the readings as a table, and frames as FITS.
fn product(readings: &[Reading]) -> Result<Product, EncodeError> {
    let mut product = Product { name: "readings".into(), ..Product::default() };
    let time = |time: Vec<String>| Column::text("time_utc", time);
    let texts = readings.iter().map(|reading| match reading {
        Reading::Power { time, .. }
        | Reading::Angle { time, .. }
        | Reading::Slot { time, .. }
        | Reading::Steps { time, .. }
        | Reading::Place { time, .. }
        | Reading::Level { time, .. }
        | Reading::Wavelength { time, .. } => utc(*time),
        Reading::Spectrum(spectrum) => utc(spectrum.start),
        Reading::Frame(frame) => format_utc(frame.start, 6),
        Reading::Counts { record, .. } => format_utc(record.start, 6),
    });
    let mut columns = vec![time(texts.collect())];
    let numbers = |of: fn(&Reading) -> f64| readings.iter().map(of).collect::<Vec<f64>>();
    match readings.first() {
        Some(Reading::Power { .. }) => {
            columns.push(Column::f64(
                "power_w",
                Some("W"),
                numbers(|reading| match reading {
                    Reading::Power { power: Power::Watts(watts), .. } => *watts,
                    _ => f64::NAN,
                }),
            ));
            let over = readings.iter().map(|reading| Some(reading.is_over())).collect();
            let over = Column { values: Values::Bool(over), ..Column::text("over", Vec::new()) };
            columns.push(over.described("more than the range: no number"));
        }
        Some(Reading::Angle { .. }) => {
            columns.push(Column::f64(
                "angle_deg",
                Some("deg"),
                numbers(|reading| match reading {
                    Reading::Angle { angle_deg, .. } => *angle_deg,
                    _ => f64::NAN,
                }),
            ));
        }
        Some(Reading::Slot { .. }) => {
            let slot = |reading: &Reading| match reading {
                Reading::Slot { slot, .. } => i64::from(*slot),
                _ => 0,
            };
            columns.push(Column::i64("slot", None, readings.iter().map(slot).collect()));
        }
        Some(Reading::Steps { .. }) => {
            let of = |reading: &Reading| match reading {
                Reading::Steps { steps, temperature_c, .. } => (*steps, *temperature_c),
                _ => (0, None),
            };
            let all = || readings.iter().map(of);
            columns.push(Column::i64("position_steps", None, all().map(|one| one.0).collect()));
            let temperature = all().map(|one| one.1.unwrap_or(f64::NAN)).collect();
            columns.push(Column::f64("temperature_c", Some("deg_C"), temperature));
        }
        Some(Reading::Place { place, .. }) => {
            let names = match place {
                MountPlace::Equatorial { .. } => ["ra_deg", "dec_deg"],
                MountPlace::Horizontal { .. } => ["azimuth_deg", "altitude_deg"],
            };
            let angle = |reading: &Reading, axis: usize| match reading {
                Reading::Place { place: MountPlace::Equatorial { ra_deg, dec_deg }, .. } => {
                    [*ra_deg, *dec_deg][axis]
                }
                Reading::Place {
                    place: MountPlace::Horizontal { azimuth_deg, altitude_deg },
                    ..
                } => [*azimuth_deg, *altitude_deg][axis],
                _ => f64::NAN,
            };
            for (axis, name) in names.into_iter().enumerate() {
                let angles = readings.iter().map(|reading| angle(reading, axis)).collect();
                columns.push(Column::f64(name, Some("deg"), angles));
            }
        }
        Some(Reading::Level { unit, .. }) => {
            let value = numbers(|reading| match reading {
                Reading::Level { level: Level::Value(value), .. } => *value,
                _ => f64::NAN,
            });
            columns.push(Column::f64("level", Some(unit), value));
            let over = readings.iter().map(|reading| Some(reading.is_over())).collect();
            let over = Column { values: Values::Bool(over), ..Column::text("over", Vec::new()) };
            columns.push(over.described("more than the range: no number"));
        }
        Some(Reading::Wavelength { .. }) => {
            let value = numbers(|reading| match reading {
                Reading::Wavelength { wavelength_nm, .. } => *wavelength_nm,
                _ => f64::NAN,
            });
            columns.push(Column::f64("wavelength_nm", Some("nm"), value));
        }
        Some(Reading::Spectrum(_)) => {
            let spectra = readings.iter().filter_map(|reading| match reading {
                Reading::Spectrum(spectrum) => Some(spectrum.as_ref()),
                _ => None,
            });
            product.table = spectra_table(spectra);
            return Ok(product);
        }
        Some(Reading::Frame(_)) => frames(readings, &mut columns, &mut product)?,
        Some(Reading::Counts { channels, .. }) => {
            let records = readings.iter().filter_map(|reading| match reading {
                Reading::Counts { record, .. } => Some(record.clone()),
                _ => None,
            });
            let (channels, records) = (channels.clone(), records.collect());
            product.table = CountSeries { channels, records, meta: Meta::default() }.to_table()?;
            return Ok(product);
        }
        None => {}
    }
    product.table = Table { columns, ..Table::default() };
    Ok(product)
}

fn frames(
    readings: &[Reading],
    columns: &mut Vec<Column>,
    product: &mut Product,
) -> Result<(), EncodeError> {
    let of = |reading: &Reading, of: fn(&Frame) -> f64| match reading {
        Reading::Frame(frame) => of(frame),
        _ => f64::NAN,
    };
    type Of = fn(&Frame) -> f64;
    let values: [(&str, &str, Of); 4] = [
        ("exposure_s", "s", |frame| frame.exposure_s),
        ("mean_adu", "adu", |frame| frame.mean_adu()),
        ("most_adu", "adu", |frame| f64::from(frame.most_adu())),
        ("temperature_c", "deg_C", |frame| frame.temperature_c.unwrap_or(f64::NAN)),
    ];
    for (name, unit, value) in values {
        let numbers = readings.iter().map(|reading| of(reading, value)).collect();
        columns.push(Column::f64(name, Some(unit), numbers));
    }
    for (i, reading) in readings.iter().enumerate() {
        let Reading::Frame(frame) = reading else { continue };
        let mut writer = Writer::new();
        writer.image(&frame.to_image()?)?;
        let fits = Some(writer.into_bytes());
        if readings.len() == 1 {
            product.fits.clone_from(&fits);
        }
        let name = format!("frame_{:04}", i + 1);
        product.others.push(Product { name, fits, ..Product::default() });
    }
    Ok(())
}
