//! The moments of a pass: stepped, or from a table.

use super::{EXPOSURE_S, MOST_SAMPLES, Overrides, Reader};
use crate::pass::keys::TimesKeys;
use hifitime::{Epoch, Unit};
use std::path::PathBuf;
use sunglint_formats::time::{format_utc, parse_utc};
use sunglint_formats::toml::Positive;
use sunglint_formats::{FileError, ParseError, Table, Values};

impl Reader<'_> {
    pub(super) fn times(
        &mut self,
        keys: &TimesKeys,
        overrides: &Overrides,
    ) -> Result<(Vec<Epoch>, Vec<f64>), FileError> {
        let exposure_s = keys.exposure_s.map_or(EXPOSURE_S, Positive::get);
        let overridden = overrides.from.is_some() || overrides.to.is_some();
        if let Some(file) = &keys.file {
            if keys.from.is_some() || keys.to.is_some() || keys.step_s.is_some() {
                let expected = "either file, or from, to and step_s";
                return Err(self.error("times.file", expected).into());
            }
            if overrides.step_s.is_some() {
                let expected = "from and to in place of file, where a step is asked for";
                return Err(self.error("times.file", expected).into());
            }
            let (mut times, mut exposures) = self.times_of_table(file, keys.exposure_s)?;
            if overridden {
                let within = |t: &Epoch| {
                    overrides.from.is_none_or(|from| *t >= from)
                        && overrides.to.is_none_or(|to| *t <= to)
                };
                let kept: Vec<usize> = (0..times.len()).filter(|i| within(&times[*i])).collect();
                if kept.is_empty() {
                    let expected = "times between those that were asked for instead";
                    return Err(self.error("times.file", expected).into());
                }
                exposures = kept.iter().map(|i| exposures[*i]).collect();
                times = kept.iter().map(|i| times[*i]).collect();
            }
            return Ok((times, exposures));
        }
        let from = overrides.from.or(keys.from.map(|t| t.0));
        let from = from.ok_or_else(|| self.error("times.from", "a time, or file"))?;
        let Some(to) = overrides.to.or(keys.to.map(|t| t.0)) else {
            if keys.step_s.is_some() || overrides.step_s.is_some() {
                return Err(self.error("times.to", "the last time, where there is a step").into());
            }
            return Ok((vec![from], vec![exposure_s]));
        };
        let step_s = overrides.step_s.or(keys.step_s.map(Positive::get));
        let step_s = step_s.ok_or_else(|| self.error("times.step_s", "seconds between samples"))?;
        let length_s = sunglint_ephemeris::orbit::seconds_between(from, to);
        let steps = (length_s / step_s + 1e-9).floor();
        if steps.is_nan() || steps < 0.0 {
            let hint = format!("from {} to {}", format_utc(from, 0), format_utc(to, 0));
            return Err(self.error("times.to", "a time after from").with_hint(hint).into());
        }
        if steps >= MOST_SAMPLES as f64 {
            let hint = format!(
                "every {step_s} s from {} to {} there would be {steps:.0}",
                format_utc(from, 0),
                format_utc(to, 0)
            );
            let expected = format!("a step that makes at most {MOST_SAMPLES} samples");
            return Err(self.error("times.step_s", expected).with_hint(hint).into());
        }
        // The count is bounded above. Epochs are counted in TAI, where every second is one.
        let times: Vec<Epoch> =
            (0..=steps as u32).map(|i| from + f64::from(i) * step_s * Unit::Second).collect();
        let n = times.len();
        Ok((times, vec![exposure_s; n]))
    }

    /// The rows of a table of observations that lie between the times that were asked for instead.
    pub(super) fn kept(
        &self,
        times: &[Epoch],
        overrides: &Overrides,
    ) -> Result<Vec<usize>, FileError> {
        if overrides.step_s.is_some() {
            let expected = "no step, where a table has the moments";
            return Err(self.error("times.table", expected).into());
        }
        let within = |t: &Epoch| {
            overrides.from.is_none_or(|from| *t >= from) && overrides.to.is_none_or(|to| *t <= to)
        };
        let kept: Vec<usize> = (0..times.len()).filter(|i| within(&times[*i])).collect();
        if kept.is_empty() {
            let expected = "times between those that were asked for instead";
            return Err(self.error("times.table", expected).into());
        }
        Ok(kept)
    }

    /// The column `time_utc` of any table, and its `exposure_s` where it has one and the file does not say otherwise.
    fn times_of_table(
        &mut self,
        file: &str,
        exposure_s: Option<Positive>,
    ) -> Result<(Vec<Epoch>, Vec<f64>), FileError> {
        let (table, path) = self.any_table("times.file", file)?;
        let texts = match table.column("time_utc").map(|c| &c.values) {
            Ok(Values::Text(texts)) => texts,
            _ => {
                let names: Vec<&str> = table.columns.iter().map(|c| c.name.as_str()).collect();
                let found = format!("the columns {}", names.join(", "));
                let error = ParseError::new(path, found, "a column `time_utc` of times");
                return Err(error.in_field("time_utc").into());
            }
        };
        let mut times = Vec::with_capacity(texts.len());
        for (i, text) in texts.iter().enumerate() {
            let text = text.as_deref().unwrap_or("");
            times.push(parse_utc(text).map_err(|error| {
                error.in_file(&path).in_field(format!("time_utc, row {}", i + 1))
            })?);
        }
        if times.is_empty() || times.len() > MOST_SAMPLES {
            let found = format!("{} rows", times.len());
            let expected = format!("1 to {MOST_SAMPLES} times");
            return Err(ParseError::new(path, found, expected).in_field("time_utc").into());
        }
        let n = times.len();
        let exposures = match (exposure_s, table.quantity("exposure_s", "s")) {
            (Some(exposure), _) => vec![exposure.get(); n],
            (None, Ok(column)) => column.into_owned(),
            (None, Err(_)) => vec![EXPOSURE_S; n],
        };
        if let Some(i) = exposures.iter().position(|s| !(s.is_finite() && *s > 0.0)) {
            let error = ParseError::new(path, exposures[i].to_string(), "an exposure above 0 s");
            return Err(error.in_field(format!("exposure_s, row {}", i + 1)).into());
        }
        Ok((times, exposures))
    }

    /// ECSV, or CSV with names in its first line.
    pub(super) fn any_table(
        &mut self,
        key: &str,
        name: &str,
    ) -> Result<(Table, PathBuf), FileError> {
        let (text, path) = self.text(key, name)?;
        Ok((sunglint_formats::text_table::read_str(&path, &text)?, path))
    }
}
