//! Magnitudes written for other programs: CCSDS TDM (KVN) and ALCDEF.

use super::Photometry;
use crate::EncodeError;
use crate::time::{UtcDay, format_utc};
use std::fmt::Write as _;

/// Facts of a message that its samples do not hold.
#[derive(Debug, Clone, Default, PartialEq)]
#[non_exhaustive]
pub struct Sender {
    /// Who writes: the originator of a TDM, the contact and observer of ALCDEF.
    pub originator: String,
    /// The site or its sensor.
    pub site: String,
    /// Moment of writing, UTC.
    pub written_utc: Option<hifitime::Epoch>,
}

/// A name fit for a line of keyword = value: one line of printable ASCII, as both standards ask.
fn ascii(text: &str, otherwise: &str) -> String {
    let clean: String =
        text.trim().chars().map(|c| if (' '..='~').contains(&c) { c } else { '_' }).collect();
    if clean.is_empty() { otherwise.to_owned() } else { clean }
}

/// Rows that have a magnitude, in the order of time.
fn rows(read: &Photometry, what: &str) -> Result<Vec<usize>, EncodeError> {
    let mut rows: Vec<usize> =
        (0..read.time.len()).filter(|i| read.magnitude[*i].is_finite()).collect();
    rows.sort_by_key(|i| crate::time::tai_nanoseconds(read.time[*i]));
    if rows.is_empty() {
        return Err(EncodeError::new(what, "no magnitude", "at least one"));
    }
    if read.is_relative && what == "TDM" {
        let found = "magnitudes whose zero point is unknown";
        return Err(EncodeError::new(what, found, "apparent magnitudes"));
    }
    Ok(rows)
}

/// A tracking data message (503.0-B-2, KVN): one segment for each session and filter, epochs in the middle of the exposures.
///
/// The standard has no key for the filter and none for uncertainties: the filter and a segment's largest uncertainty stand in comments.
///
/// # Errors
/// [`EncodeError`] without any magnitude, or with magnitudes whose zero point is unknown.
pub fn tdm(read: &Photometry, sender: &Sender) -> Result<String, EncodeError> {
    let rows = rows(read, "TDM")?;
    let written = sender.written_utc.unwrap_or(read.time[rows[rows.len() - 1]]);
    let mut text = format!(
        "CCSDS_TDM_VERS = 2.0\nCREATION_DATE = {}\nORIGINATOR = {}\n",
        format_utc(written, 0).trim_end_matches('Z'),
        ascii(&sender.originator, "UNKNOWN")
    );
    let label = |i: usize| {
        let of = |column: &Option<Vec<String>>| column.as_ref().map(|c| c[i].clone());
        (of(&read.session), of(&read.filter), read.exposure_s.as_ref().map(|e| e[i].to_bits()))
    };
    let mut done = vec![false; rows.len()];
    for first in 0..rows.len() {
        if done[first] {
            continue;
        }
        let own = label(rows[first]);
        text.push_str("META_START\n");
        if let Some(filter) = own.1.as_ref().filter(|f| !f.is_empty()) {
            let _ = writeln!(text, "COMMENT filter: {}", ascii(filter, "unknown"));
        }
        let _ = write!(
            text,
            "TIME_SYSTEM = UTC\nPARTICIPANT_1 = {}\nPARTICIPANT_2 = {}\nMODE = SEQUENTIAL\nPATH = 2,1\n",
            ascii(&sender.site, "UNKNOWN"),
            ascii(&read.target, "UNKNOWN")
        );
        if let Some(bits) = own.2 {
            let _ = writeln!(text, "INTEGRATION_INTERVAL = {}", f64::from_bits(bits));
            text.push_str("INTEGRATION_REF = MIDDLE\n");
        }
        text.push_str("META_STOP\nDATA_START\n");
        let members: Vec<usize> =
            (first..rows.len()).filter(|k| !done[*k] && label(rows[*k]) == own).collect();
        let sigma = |k: &usize| read.sigma_mag.as_ref().map(|s| s[rows[*k]]);
        let largest =
            members.iter().filter_map(sigma).filter(|s| s.is_finite()).fold(f64::NAN, f64::max);
        if largest.is_finite() {
            // Comments stand at the beginning of the data alone.
            let _ = writeln!(text, "COMMENT standard uncertainties up to {largest} mag");
        }
        for k in members {
            done[k] = true;
            let i = rows[k];
            let time = format_utc(read.time[i], 6);
            let _ = writeln!(text, "MAG = {} {}", time.trim_end_matches('Z'), read.magnitude[i]);
        }
        text.push_str("DATA_STOP\n");
    }
    Ok(text)
}

/// A light curve in ALCDEF 2.1.1: one block for each session and filter, Julian dates (UT) with ten digits (10 µs) in the middle of the exposures.
///
/// # Errors
/// [`EncodeError`] without any magnitude, or with a time on a day that has a leap second after its last whole second, which a Julian date cannot say.
pub fn alcdef(read: &Photometry, sender: &Sender) -> Result<String, EncodeError> {
    let rows = rows(read, "ALCDEF")?;
    let mut julian = Vec::with_capacity(rows.len());
    for i in &rows {
        let day = UtcDay::containing(read.time[*i])
            .ok_or_else(|| EncodeError::new("ALCDEF", "a time", "a date from 1972 to 2100"))?;
        let since = crate::time::tai_nanoseconds(read.time[*i]) - day.start_tai_ns;
        if since >= 86_400_000_000_000 {
            let found = format_utc(read.time[*i], 3);
            return Err(EncodeError::new("ALCDEF", found, "a time outside a leap second"));
        }
        // Whole days apart from the rest: no digit is lost.
        let half = since + 43_200_000_000_000;
        let (days, rest) = (half / 86_400_000_000_000, half % 86_400_000_000_000);
        let part = (rest as f64 / 86_400e9 * 1e10).round() as i64;
        let day = day.mjd + super::MJD_OFFSET + i64::try_from(days).unwrap_or(0);
        julian.push((day + part / 10_000_000_000, part % 10_000_000_000));
    }
    let label = |i: usize| {
        let of = |column: &Option<Vec<String>>| column.as_ref().map(|c| c[i].clone());
        (of(&read.session), of(&read.filter))
    };
    let mut text = String::new();
    let mut done = vec![false; rows.len()];
    for first in 0..rows.len() {
        if done[first] {
            continue;
        }
        let own = label(rows[first]);
        let members: Vec<usize> =
            (first..rows.len()).filter(|k| !done[*k] && label(rows[*k]) == own).collect();
        let [begin, end] = [members[0], members[members.len() - 1]].map(|k| read.time[rows[k]]);
        let middle = format_utc(begin + 0.5 * (end - begin), 0);
        let filter = own.1.as_deref().filter(|f| !f.is_empty()).unwrap_or("C");
        let who = ascii(&sender.originator, "UNKNOWN");
        let _ = write!(
            text,
            "STARTMETADATA\nOBJECTNUMBER=0\nOBJECTNAME={}\nCONTACTNAME={who}\nCONTACTINFO={}\nOBSERVERS={who}\nSESSIONDATE={}\nSESSIONTIME={}\nFILTER={f}\nMAGBAND={f}\n\
             LTCAPP=NONE\nLTCTYPE=NONE\nREDUCEDMAGS=NONE\nDIFFERMAGS={}\nDELIMITER=PIPE\nENDMETADATA\n",
            ascii(&read.target, "UNKNOWN"),
            ascii(&sender.site, "UNKNOWN"),
            &middle[..10],
            &middle[11..19],
            if read.is_relative { "TRUE" } else { "FALSE" },
            f = ascii(filter, "C"),
        );
        for k in members {
            done[k] = true;
            let (i, (day, part)) = (rows[k], julian[k]);
            // No exponents are allowed. A delimiter stands behind the uncertainty too, as in the database's own files: programs index the fields without counting them.
            let sigma = read.sigma_mag.as_ref().map(|s| s[i]).filter(|s| s.is_finite());
            let sigma = sigma.map_or(String::new(), |s| format!("{s:.4}"));
            let _ = writeln!(text, "DATA={day}.{part:010}|{:.4}|{sigma}|", read.magnitude[i]);
        }
        text.push_str("ENDDATA\n");
    }
    Ok(text)
}
