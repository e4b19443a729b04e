//! Photometry in FITS: EOSSA, and any binary table.

use super::columns::usual_time;
use super::words::is_missing;
use super::{Format, Photometry, Source};
use crate::fits::{Fits, Kind};
use crate::time::parse_utc;
use crate::{ParseError, Table, Values};
use hifitime::Duration;
use std::path::Path;

/// Value of EOSSA's columns of doubles that says nothing.
const NO_NUMBER: f64 = -9999.0;

/// The samples of an EOSSA file, else the first binary table. TIMESYS and MJDREF of the header stay in the metadata.
pub(super) fn of_fits(path: &Path, bytes: Vec<u8>) -> Result<Source, ParseError> {
    let fits = Fits::from_bytes(path, bytes)?;
    let Some(index) = fits.first(Kind::Table) else {
        let error = ParseError::new(path, "no binary table", "a FITS table of a light curve");
        return Err(error.with_hint("frames are for `sunglint reduce`"));
    };
    let mut table = fits.table(index)?;
    without_untimed_rows(&mut table);
    if column(&table, "Mag_Exo_Atm").is_some() && column(&table, "JD_Mid_Exp").is_some() {
        return Ok(Source::Samples(Format::Eossa, Box::new(eossa(path, &table)?)));
    }
    Ok(Source::Table("FITS table", Box::new(table)))
}

/// Takes out the rows that have no time: space missions write them for lost cadences, catalogues as masked values. Their number becomes the metadata `untimed_rows`.
pub(super) fn without_untimed_rows(table: &mut Table) {
    let Some(name) = usual_time(table).map(str::to_owned) else { return };
    let keep: Vec<bool> = match column(table, &name).map(|c| &c.values) {
        Some(Values::F64(times)) => times.iter().map(|t| !t.is_nan()).collect(),
        Some(Values::I64(times)) => times.iter().map(Option::is_some).collect(),
        Some(Values::Text(times)) => {
            times.iter().map(|t| t.as_deref().is_some_and(|t| !is_missing(t.trim()))).collect()
        }
        _ => return,
    };
    let lost = keep.iter().filter(|k| !**k).count();
    if lost == 0 || lost == keep.len() {
        return;
    }
    table.columns.iter_mut().for_each(|c| retain(&mut c.values, &keep, 1));
    table.meta.insert("untimed_rows".into(), lost.into());
}

/// Keeps the rows that `keep` says; a row has `width` values.
pub(super) fn retain(values: &mut Values, keep: &[bool], width: usize) {
    let mut at = 0;
    let mut kept = || {
        at += 1;
        keep.get((at - 1) / width).copied().unwrap_or(false)
    };
    match values {
        Values::F64(v) => v.retain(|_| kept()),
        Values::I64(v) => v.retain(|_| kept()),
        Values::Bool(v) => v.retain(|_| kept()),
        Values::Text(v) => v.retain(|_| kept()),
        Values::Vectors { width, flat } => retain(flat, keep, *width),
    }
}

/// A column by its name, whose case writers do not agree on.
fn column<'a>(table: &'a Table, name: &str) -> Option<&'a crate::Column> {
    table.columns.iter().find(|c| c.name.eq_ignore_ascii_case(name))
}

fn numbers(table: &Table, name: &str) -> Option<Vec<f64>> {
    let name = &column(table, name)?.name;
    let numbers = table.f64(name).ok()?;
    Some(numbers.iter().map(|v| if *v == NO_NUMBER { f64::NAN } else { *v }).collect())
}

/// EOSSA 3.1 as published writers lay it out: UTC_Begin_exp and UTC_End_exp, JD_Mid_Exp, Exp_Duration, Mag_Exo_Atm and its uncertainty, the range in metres.
fn eossa(path: &Path, table: &Table) -> Result<Photometry, ParseError> {
    let rows = table.rows();
    let texts = |name: &str| match &column(table, name)?.values {
        Values::Text(texts) => Some(texts),
        _ => None,
    };
    let magnitude = numbers(table, "Mag_Exo_Atm").unwrap_or_default();
    let exposure = numbers(table, "Exp_Duration");
    let days = numbers(table, "JD_Mid_Exp").unwrap_or_default();
    let (begins, ends) = (texts("UTC_Begin_exp"), texts("UTC_End_exp"));
    let mut read = Photometry::default();
    let mut by_date = 0;
    for i in 0..rows {
        let at = |texts: Option<&Vec<Option<String>>>| {
            let text = texts?.get(i)?.as_deref()?.trim();
            (!text.is_empty() && text != "NULLSTRING").then(|| parse_utc(text).ok())?
        };
        // A Julian date in a double is good to 40 µs: the texts are better.
        let time = match (at(begins), at(ends)) {
            (Some(begin), Some(end)) if end >= begin => begin + 0.5 * (end - begin),
            (Some(begin), _) if exposure.as_ref().is_some_and(|e| e[i] >= 0.0) => {
                begin + Duration::from_seconds(0.5 * exposure.as_ref().map_or(0.0, |e| e[i]))
            }
            _ => {
                by_date += 1;
                super::columns::of_julian(days[i], false, super::Scale::Utc).ok_or_else(|| {
                    ParseError::new(path, days[i].to_string(), "a Julian date from 1972 to 2100")
                        .in_field(format!("JD_Mid_Exp, row {}", i + 1))
                })?
            }
        };
        read.time.push(time);
    }
    if by_date > 0 {
        read.notes.push(format!("{by_date} times are Julian dates in doubles, good to 40 µs"));
    }
    read.magnitude = magnitude;
    read.exposure_s = exposure.filter(|e| e.iter().all(|s| s.is_finite() && *s > 0.0));
    read.sigma_mag = numbers(table, "Mag_Exo_Atm_Unc");
    read.range_km = numbers(table, "Tel_Obj_Range").map(|r| r.iter().map(|m| m / 1e3).collect());
    if let Ok(filters) = table.i64(column(table, "Cur_Spec_Filt_Num").map_or("", |c| &c.name)) {
        let named = |n: &Option<i64>| match n {
            Some(n) => table
                .meta_text(&format!("SPFNAM{n}"))
                .map_or_else(|| n.to_string(), |t| t.trim().to_owned()),
            None => String::new(),
        };
        read.filter = Some(filters.iter().map(named).collect());
    }
    read.target = table.meta_text("OBJECT").unwrap_or_default().trim().to_owned();
    Ok(read)
}
