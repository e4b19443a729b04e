//! Finished bins of a photon counter, and the table that holds a night of them.

use crate::error::{EncodeError, ParseError};
use crate::flag_bits::{Numbering, bit_names};
use crate::table::{Column, Meta, Table};
use crate::time::{format_utc_shortest, parse_utc};
use hifitime::Epoch;
use serde_json::json;
use std::path::Path;

bitflags::bitflags! {
    /// Faults that a bin is known to have. In files the metadata `flag_bits` names the bits (see
    /// [`flag_bits`](crate::flag_bits)).
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
    pub struct CountFlags: u32 {
        /// The counter's buffer overflowed: the counts are lower bounds.
        const OVERFLOW = 1;
        /// The counter said how many events it missed (see [`CountRecord::missed`]): the counts are lower bounds.
        const MISSED = 1 << 1;
        /// Bins are missing between this one and the one before.
        const GAP = 1 << 2;
        /// The bin was cut short: it ended before its length.
        const PARTIAL = 1 << 3;
        /// The start in UTC comes from the clock of the computer, not from a time signal.
        const CLOCK_FREE = 1 << 4;
        /// The rate was so high that the detector does not follow.
        const SATURATED = 1 << 5;
        /// The counter reported an error: its clock may have jumped, so that times before and after it do not belong together.
        const ERROR = 1 << 6;
    }
}

/// One finished bin of all channels.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CountRecord {
    /// Start of the bin in UTC, as the driver places it.
    pub start: Epoch,
    /// Start of the bin on the counter's own clock, ps: exact, and without steps.
    pub start_ps: i64,
    /// Length of the bin, ps.
    pub length_ps: i64,
    /// Events of each channel, in the order of [`CountSeries::channels`].
    pub counts: Vec<u64>,
    /// Events of each channel that the counter says it missed.
    pub missed: Vec<u64>,
    /// Faults that the bin is known to have.
    pub flags: CountFlags,
}

/// The bins of a night.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CountSeries {
    /// Names of the channels, as the instrument calls them (`g`, `r`): the prefix of their columns.
    pub channels: Vec<String>,
    /// The bins, in time.
    pub records: Vec<CountRecord>,
    /// Metadata of the series (device, serial number, session …).
    pub meta: Meta,
}

/// The metadata keys that the table keeps for itself.
const CHANNELS: &str = "channels";
const FLAG_BITS: &str = "flag_bits";
const KIND: &str = "kind";

impl CountSeries {
    /// The series as a table, which loses nothing: `start_utc` (to the nanosecond), `start_ps`, `length_ps`, `flags`, and
    /// for each channel `<channel>_counts` and `<channel>_missed`. The metadata `flag_bits` names the bits of the flags.
    ///
    /// # Errors
    /// A record with another number of channels; a count beyond 63 bits; a channel name twice.
    pub fn to_table(&self) -> Result<Table, EncodeError> {
        let mut meta = self.meta.clone();
        meta.insert(KIND.into(), "counts".into());
        meta.insert(CHANNELS.into(), json!(self.channels));
        meta.insert(FLAG_BITS.into(), bit_names::<CountFlags>());
        for (i, channel) in self.channels.iter().enumerate() {
            if self.channels[..i].contains(channel) {
                return Err(EncodeError::new(channel, "the channel twice", "each channel once"));
            }
        }
        for record in &self.records {
            let found = record.counts.len().min(record.missed.len());
            if found != self.channels.len() || found != record.counts.len().max(record.missed.len())
            {
                return Err(EncodeError::new(
                    format_utc_shortest(record.start),
                    format!("{} counts and {} missed", record.counts.len(), record.missed.len()),
                    format!("{} of each, one for each channel", self.channels.len()),
                ));
            }
        }
        let integers =
            |value: &dyn Fn(&CountRecord) -> i64| self.records.iter().map(value).collect();
        let starts = self.records.iter().map(|record| format_utc_shortest(record.start)).collect();
        let mut columns = vec![
            Column::text("start_utc", starts).described("start of the bin, UTC"),
            Column::i64("start_ps", Some("ps"), integers(&|record| record.start_ps))
                .described("start of the bin on the counter's clock"),
            Column::i64("length_ps", Some("ps"), integers(&|record| record.length_ps)),
            Column::i64("flags", None, integers(&|record| record.flags.bits().into())),
        ];
        for (i, channel) in self.channels.iter().enumerate() {
            for (what, values) in [
                ("counts", self.column(channel, |record| record.counts[i])?),
                ("missed", self.column(channel, |record| record.missed[i])?),
            ] {
                columns.push(Column::i64(format!("{channel}_{what}"), Some("ct"), values));
            }
        }
        Ok(Table { meta, columns })
    }

    fn column(
        &self,
        channel: &str,
        value: impl Fn(&CountRecord) -> u64,
    ) -> Result<Vec<i64>, EncodeError> {
        let whole = |value: u64| {
            i64::try_from(value).map_err(|_| {
                EncodeError::new(channel, value.to_string(), format!("at most {}", i64::MAX))
            })
        };
        self.records.iter().map(|record| whole(value(record))).collect()
    }

    /// The series in a table; `path` names the file that it came from in errors.
    ///
    /// # Errors
    /// A [`ParseError`] with the column: one that is missing or of another kind, a missing or negative value, a time
    /// that is not UTC, flags that are not known, a bit that has no name.
    pub fn from_table(path: impl AsRef<Path>, table: &Table) -> Result<Self, ParseError> {
        Self::from_table_at(path.as_ref(), table)
    }

    fn from_table_at(path: &Path, table: &Table) -> Result<Self, ParseError> {
        let bad = |field: &str, found: String, expected: &str| {
            ParseError::new(path, found, expected).in_field(field)
        };
        if table.meta_text(KIND) != Some("counts") {
            let found = table.meta_text(KIND).unwrap_or("no such key").to_owned();
            return Err(bad("meta.kind", found, "`counts`"));
        }
        let names = table.meta.get(CHANNELS).and_then(|names| names.as_array());
        let names =
            names.map(|names| names.iter().map(|n| n.as_str().map(str::to_owned)).collect());
        let Some(Some(channels)): Option<Option<Vec<String>>> = names else {
            return Err(bad("meta.channels", "something else".into(), "a list of names"));
        };
        let numbering = Numbering::<CountFlags>::read(path, table.meta.get(FLAG_BITS))
            .map_err(|error| error.in_field("meta.flag_bits"))?;
        let columns = Columns { path, table };
        let starts = columns.texts("start_utc")?;
        let start_ps = columns.integers("start_ps", i64::MIN)?;
        let length_ps = columns.integers("length_ps", 0)?;
        let flags = columns.integers("flags", 0)?;
        let per_channel = |what: &str| {
            let column = |channel: &String| columns.integers(&format!("{channel}_{what}"), 0);
            channels.iter().map(column).collect::<Result<Vec<_>, _>>()
        };
        let (counts, missed) = (per_channel("counts")?, per_channel("missed")?);
        let mut records = Vec::with_capacity(table.rows());
        for row in 0..table.rows() {
            let at_row = |error: ParseError| error.with_hint(format!("in row {}", row + 1));
            let start = parse_utc(&starts[row])
                .map_err(|error| at_row(error.in_file(path).in_field("start_utc")))?;
            let flags = numbering.flags(flags[row]).ok_or_else(|| {
                at_row(bad("flags", flags[row].to_string(), "bits that meta.flag_bits names"))
            })?;
            let of_row =
                |columns: &[Vec<i64>]| columns.iter().map(|c| c[row].unsigned_abs()).collect();
            records.push(CountRecord {
                start,
                start_ps: start_ps[row],
                length_ps: length_ps[row],
                counts: of_row(&counts),
                missed: of_row(&missed),
                flags,
            });
        }
        let mut meta = table.meta.clone();
        meta.retain(|key, _| ![KIND, CHANNELS, FLAG_BITS].contains(&key.as_str()));
        Ok(Self { channels, records, meta })
    }
}

/// Typed access with errors that name the column.
struct Columns<'a> {
    path: &'a Path,
    table: &'a Table,
}

impl Columns<'_> {
    fn complete<T>(&self, name: &str, values: Option<Vec<T>>) -> Result<Vec<T>, ParseError> {
        let values = values.ok_or_else(|| {
            ParseError::new(self.path, "a missing value", "a value in each row").in_field(name)
        })?;
        if values.len() == self.table.rows() {
            return Ok(values);
        }
        let found = format!("{} rows", values.len());
        let expected = format!("{} rows", self.table.rows());
        Err(ParseError::new(self.path, found, expected).in_field(name))
    }

    fn texts(&self, name: &str) -> Result<Vec<String>, ParseError> {
        let values = self.table.text(name).map_err(|error| error.in_file(self.path))?;
        self.complete(name, values.iter().cloned().collect())
    }

    /// Whole numbers of at least `least`.
    fn integers(&self, name: &str, least: i64) -> Result<Vec<i64>, ParseError> {
        let values = self.table.i64(name).map_err(|error| error.in_file(self.path))?;
        let values: Vec<i64> = self.complete(name, values.iter().copied().collect())?;
        match values.iter().find(|&&value| value < least) {
            None => Ok(values),
            Some(value) => {
                let expected = format!("a number of {least} or above");
                Err(ParseError::new(self.path, value.to_string(), expected).in_field(name))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ecsv;

    fn series() -> CountSeries {
        let record = |start: &str, start_ps, counts: [u64; 2], flags| CountRecord {
            start: parse_utc(start).unwrap(),
            start_ps,
            length_ps: 100_000_000_000,
            counts: counts.to_vec(),
            missed: vec![0, 3],
            flags,
        };
        let mut meta = Meta::new();
        meta.insert("device".into(), "time tagger".into());
        CountSeries {
            channels: vec!["g".into(), "r".into()],
            records: vec![
                record("2016-12-31T23:59:59.987654321", -1, [0, 1], CountFlags::empty()),
                record(
                    "2016-12-31T23:59:60.087654321",
                    i64::MAX,
                    [i64::MAX as u64, 7],
                    CountFlags::all(),
                ),
                record(
                    "2016-12-31T23:59:60.187654321",
                    9_007_199_254_740_993,
                    [1, 2],
                    CountFlags::GAP,
                ),
            ],
            meta,
        }
    }

    #[test]
    fn a_series_comes_back_from_ecsv_to_the_picosecond() {
        let text = ecsv::to_string(&series().to_table().unwrap()).unwrap();
        let table = ecsv::read_str("counts.ecsv", &text).unwrap();
        assert_eq!(CountSeries::from_table("counts.ecsv", &table).unwrap(), series());
        let empty = CountSeries { records: vec![], ..series() };
        let text = ecsv::to_string(&empty.to_table().unwrap()).unwrap();
        let table = ecsv::read_str("counts.ecsv", &text).unwrap();
        assert_eq!(CountSeries::from_table("counts.ecsv", &table).unwrap(), empty);
    }

    #[test]
    fn the_names_of_the_bits_decide() {
        let mut table = series().to_table().unwrap();
        assert_eq!(table.meta["flag_bits"]["overflow"], 0);
        assert_eq!(table.meta["flag_bits"]["saturated"], 5);
        let other = json!({
            "saturated": 0, "clock_free": 1, "partial": 2, "gap": 3, "missed": 4, "overflow": 5, "error": 6
        });
        table.meta.insert("flag_bits".into(), other);
        let read = CountSeries::from_table("c.ecsv", &table).unwrap();
        let flags: Vec<_> = read.records.iter().map(|record| record.flags).collect();
        // The third bin's number is 1 << 2.
        assert_eq!(flags, [CountFlags::empty(), CountFlags::all(), CountFlags::PARTIAL]);
        // A numbering by masks has a bit 32, and one that lacks a flag has a bit without name.
        let masks = json!({
            "overflow": 1, "missed": 2, "gap": 4, "partial": 8, "clock_free": 16, "saturated": 32, "error": 64
        });
        for (bits, message) in [
            (
                masks,
                "c.ecsv: meta.flag_bits: found bit 32 of `saturated`, expected a bit from 0 to 31",
            ),
            (
                json!({"gap": 2}),
                "c.ecsv: flags: found 127, expected bits that meta.flag_bits names (in row 2)",
            ),
        ] {
            table.meta.insert("flag_bits".into(), bits);
            let error = CountSeries::from_table("c.ecsv", &table).unwrap_err();
            assert_eq!(error.to_string(), message);
        }
        table.meta.remove("flag_bits");
        assert!(CountSeries::from_table("c.ecsv", &table).is_err());
        table.columns[3] = Column::i64("flags", None, vec![0; 3]);
        assert!(CountSeries::from_table("c.ecsv", &table).is_ok());
    }

    #[track_caller]
    fn refused(from: &str, to: &str, message: &str) {
        let text = ecsv::to_string(&series().to_table().unwrap()).unwrap();
        assert!(text.contains(from), "{text}");
        let table = ecsv::read_str("c.ecsv", &text.replace(from, to)).unwrap();
        let error = CountSeries::from_table("c.ecsv", &table).unwrap_err();
        assert_eq!(error.to_string(), message);
    }

    #[test]
    fn what_is_wrong_is_named_with_its_column() {
        refused(
            "23:59:59.987654321",
            "23:59:61",
            "c.ecsv: start_utc: found `2016-12-31T23:59:61Z`, expected a time of day from 00:00:00 to 23:59:59 (in row 1)",
        );
        refused(
            ",127,",
            ",128,",
            "c.ecsv: flags: found 128, expected bits that meta.flag_bits names (in row 2)",
        );
        refused(
            ",4,1,0,2,3",
            ",4,-1,0,2,3",
            "c.ecsv: g_counts: found -1, expected a number of 0 or above",
        );
        refused(
            ",4,1,0,2,3",
            ",4,,0,2,3",
            "c.ecsv: g_counts: found a missing value, expected a value in each row",
        );
        refused(
            "g_counts",
            "g_count",
            "c.ecsv: g_counts: found no such column, expected it beside start_utc, start_ps, length_ps, flags, g_count, \
             g_missed, r_counts, r_missed (did you mean `g_count`?)",
        );
        refused("\"counts\"", "\"rates\"", "c.ecsv: meta.kind: found rates, expected `counts`");
    }

    #[test]
    fn a_record_of_other_channels_is_not_written() {
        let mut series = series();
        series.records[1].missed.pop();
        assert_eq!(
            series.to_table().unwrap_err().to_string(),
            "2016-12-31T23:59:60.087654321Z: found 2 counts and 1 missed, expected 2 of each, one for each channel"
        );
    }
}
