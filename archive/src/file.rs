//! Contents of one file of an archive, as far as an index needs them.

use hifitime::Epoch;
use std::path::Path;
use sunglint_ephemeris::orbit::elements;
use sunglint_formats::photometry::{self, ColumnNames, Import, ImportError, ObjectRows};
use sunglint_formats::session::{Session, TargetKind};
use sunglint_formats::time::tai_nanoseconds;
use sunglint_formats::{FileError, Table, read, text_table};
use sunglint_radiometry::light_curve::LightCurve;

pub use sunglint_radiometry::light_curve::LightKind as Kind;

/// Gap that parts one pass from the next within a file, s. An object in a low orbit comes back after 90 minutes; clouds and turns of the dome are shorter.
pub const GAP_S: f64 = 1800.0;

/// Endings of the files that are looked into.
pub const ENDINGS: [&str; 8] = ["ecsv", "csv", "tdm", "kvn", "xml", "vot", "alcdef", "txt"];

/// Name of the file that makes a folder a session.
pub const SESSION: &str = "session.toml";

/// One channel of one pass.
#[derive(Debug, Clone, PartialEq)]
pub struct Light {
    /// Number of the pass in its file, from 1.
    pub pass: u32,
    /// Kind of light.
    pub kind: Kind,
    /// Name of the target; may be empty.
    pub target: String,
    /// Number in the catalogue, where the file says it.
    pub norad_id: Option<u32>,
    /// Station; may be empty.
    pub station: String,
    /// Channel or filter; of a session the instrument; may be empty.
    pub channel: String,
    /// First sample, mid-exposure; of a session the begin of the visit.
    pub from: Epoch,
    /// Last sample.
    pub to: Epoch,
    /// Samples with a rate or a magnitude.
    pub samples: u32,
    /// Smallest and largest phase angle of these, deg; `None` where the file has none.
    pub phase_deg: Option<(f64, f64)>,
    /// Smallest and largest range of these, m.
    pub range_m: Option<(f64, f64)>,
    /// Largest rate, Hz, or smallest magnitude.
    pub brightest: Option<f64>,
}

/// Contents of a file.
#[derive(Debug, Clone, PartialEq)]
pub enum Contents {
    /// Light: a row for each channel of each pass.
    Light(Vec<Light>),
    /// Another kind of file: a table of something else, a plan, text, or a curve that was itself joined out of an archive.
    Other,
    /// A light curve or a session that cannot be read, and why.
    Damaged(String),
}

/// Looks into a file: a light curve of this program, magnitudes of another, or `session.toml`, which stands for its folder.
///
/// # Errors
/// The system refuses to read it, which may pass; everything else is in the answer.
pub fn look(path: &Path) -> Result<Contents, FileError> {
    if path.file_name().is_some_and(|name| name == SESSION) {
        let folder = path.parent().unwrap_or(Path::new("."));
        return match session(folder) {
            Ok(light) => Ok(Contents::Light(light)),
            Err(error @ FileError::Io { .. }) => Err(error),
            Err(error) => Ok(Contents::Damaged(error.to_string())),
        };
    }
    let bytes = read::bytes_of_text(path)?;
    let ends = |ending: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(ending));
    let text = match read::decode(path, bytes) {
        Ok(text) => text,
        // Text by its name, and none by its bytes.
        Err(error) if ends("ecsv") => return Ok(Contents::Damaged(error.to_string())),
        Err(_) => return Ok(Contents::Other),
    };
    // A file that says what it is, and is not, is damaged; of any other table or text nothing is known.
    let is_ours = ends("ecsv") || text.starts_with("# %ECSV");
    let says = is_ours || photometry::recognise(&text).is_some();
    let fault = |error: String| if says { Contents::Damaged(error) } else { Contents::Other };
    if is_ours {
        let table = match text_table::read_str(path, &text) {
            Ok(table) => table,
            Err(error) => return Ok(Contents::Damaged(error.to_string())),
        };
        // Its samples are those of other files: they would count twice.
        if is_joined(&table) {
            return Ok(Contents::Other);
        }
        if table.meta.contains_key("quantity") {
            // Spectra have quantities of their own.
            let is_curve = table.columns.iter().any(|c| c.name.ends_with("_rate_hz"));
            return Ok(match LightCurve::from_table(path, &table) {
                Ok(curve) => Contents::Light(of_curve(&curve)),
                Err(error) if is_curve => Contents::Damaged(error.to_string()),
                Err(_) => Contents::Other,
            });
        }
        // A table without magnitudes is something else: a summary, a list of passes.
        return Ok(match import(path, text) {
            Ok(mut import) => {
                if import.samples.target.is_empty() {
                    table.meta_text("target").unwrap_or("").clone_into(&mut import.samples.target);
                }
                Contents::Light(of_photometry(&import))
            }
            // Its light is known, and whose it is stands in no index: it is named, not passed over.
            Err(error @ ImportError::Objects { .. }) => Contents::Damaged(error.to_string()),
            Err(_) => Contents::Other,
        });
    }
    Ok(match import(path, text) {
        Ok(import) => Contents::Light(of_photometry(&import)),
        Err(error @ ImportError::Objects { .. }) => Contents::Damaged(error.to_string()),
        Err(error) => fault(error.to_string()),
    })
}

/// Magnitudes of one object.
fn import(path: &Path, text: String) -> Result<Import, ImportError> {
    photometry::import(path, text.into_bytes(), &ColumnNames::default(), &ObjectRows::One)
}

/// Whether a table is what [`crate::join`] makes: it says so in its provenance, whether the program or Python wrote it.
fn is_joined(table: &Table) -> bool {
    let provenance = table.meta.get("provenance");
    let command = provenance.and_then(|p| p.get("command")).and_then(|c| c.as_str());
    command.is_some_and(|command| command.starts_with("archive "))
}

/// Filters of a file's samples; where it names none, `V` if its column of magnitudes says so.
pub fn filters(import: &Import) -> Vec<String> {
    if let Some(filters) = &import.samples.filter {
        return filters.clone();
    }
    let column = import.columns.iter().find(|(meaning, _)| *meaning == "magnitude");
    let is_v = column.is_some_and(|(_, name)| {
        ["v", "vmag", "v_mag", "mag_v"].iter().any(|v| name.eq_ignore_ascii_case(v))
    });
    vec![if is_v { "V".to_owned() } else { String::new() }; import.samples.time.len()]
}

/// The visits of a session: a row for each and each instrument.
fn session(folder: &Path) -> Result<Vec<Light>, FileError> {
    let session = Session::open(folder)?;
    let manifest = session.manifest();
    let mut instruments: Vec<String> = Vec::new();
    for device in &manifest.devices {
        match device.channels.is_empty() {
            true => instruments.push(device.name.clone()),
            false => instruments.extend(device.channels.iter().cloned()),
        }
    }
    let mut rows = Vec::new();
    let visits = session
        .visits()?
        .into_iter()
        .filter(|v| matches!(v.target.target_kind, TargetKind::Star | TargetKind::Satellite));
    for (number, visit) in visits.enumerate() {
        let norad_id = visit.target.elements().and_then(|text| of_elements(&text));
        for instrument in &instruments {
            rows.push(Light {
                pass: u32::try_from(number + 1).unwrap_or(u32::MAX),
                kind: Kind::Recorded,
                target: visit.target.name.clone(),
                norad_id,
                station: manifest.station.clone(),
                channel: instrument.clone(),
                from: visit.from,
                to: visit.to.unwrap_or(visit.from),
                samples: 0,
                phase_deg: None,
                range_m: None,
                brightest: None,
            });
        }
    }
    Ok(rows)
}

fn of_elements(text: &str) -> Option<u32> {
    let (sets, _) = elements::parse_lenient("elements", text);
    sets.first().map(|set| set.norad_id)
}

/// The catalogue's number that a name is: `25544`, `NORAD 25544`; or has, in the words of a simulation: `object 25544 as sphere`, `ISS (25544) as box_wing`.
pub fn number_in(name: &str) -> Option<u32> {
    let name = name.trim();
    if let Some((object, _)) = name.split_once(" as ") {
        let inside = object.strip_suffix(')').and_then(|o| Some(o.rsplit_once(" (")?.1));
        return inside.or_else(|| object.strip_prefix("object ")).and_then(number_in);
    }
    let head = name.get(..5).filter(|head| head.eq_ignore_ascii_case("norad"));
    let digits = match head {
        Some(head) => name[head.len()..].trim_start_matches([' ', ':', '-', '_', '#']),
        None => name,
    };
    let is_number = (1..=9).contains(&digits.len()) && digits.bytes().all(|b| b.is_ascii_digit());
    if is_number { digits.parse().ok().filter(|n| *n > 0) } else { None }
}

/// Samples in the order of time, parted where nothing is for [`GAP_S`]: the passes of a file. Numbers are places in the file.
pub fn passes(times: &[Epoch]) -> Vec<Vec<usize>> {
    let mut order: Vec<usize> = (0..times.len()).collect();
    order.sort_by_key(|i| tai_nanoseconds(times[*i]));
    let gap_ns = (GAP_S * 1e9) as i128;
    let mut parts: Vec<Vec<usize>> = Vec::new();
    for i in order {
        match parts.last_mut() {
            Some(part)
                if part.last().is_some_and(|last| {
                    tai_nanoseconds(times[i]) - tai_nanoseconds(times[*last]) <= gap_ns
                }) =>
            {
                part.push(i);
            }
            _ => parts.push(vec![i]),
        }
    }
    parts
}

/// Smallest and largest of the numbers that there are.
fn range(of: Option<&Vec<f64>>, rows: &[usize]) -> Option<(f64, f64)> {
    let values = rows.iter().filter_map(|i| of?.get(*i).copied()).filter(|v| v.is_finite());
    values.fold(None, |range: Option<(f64, f64)>, v| {
        Some(range.map_or((v, v), |(low, high)| (low.min(v), high.max(v))))
    })
}

fn of_curve(curve: &LightCurve) -> Vec<Light> {
    let kind = Kind::from(curve.kind);
    let about = curve.other.get("target");
    let text = |key: &str| about?.get(key)?.as_str().map(str::to_owned);
    let target = match (&curve.provenance.target, text("name")) {
        (own, Some(name)) if own.is_empty() => name,
        (own, _) => own.clone(),
    };
    let tle = about.and_then(|t| t.get("tle")).and_then(|t| {
        let lines: Option<Vec<&str>> = t.as_array()?.iter().map(|line| line.as_str()).collect();
        Some(lines?.join("\n"))
    });
    let elements = tle.or_else(|| text("omm"));
    let norad_id = elements.and_then(|e| of_elements(&e)).or_else(|| number_in(&target));
    let mut rows = Vec::new();
    for (number, part) in passes(&curve.samples.time).into_iter().enumerate() {
        for channel in &curve.channels {
            let own: Vec<usize> =
                part.iter().copied().filter(|i| channel.rate_hz[*i].is_finite()).collect();
            let (Some(first), Some(last)) = (own.first(), own.last()) else { continue };
            rows.push(Light {
                pass: u32::try_from(number + 1).unwrap_or(u32::MAX),
                kind,
                target: target.clone(),
                norad_id,
                station: curve.provenance.station.clone(),
                channel: channel.name.clone(),
                from: curve.samples.time[*first],
                to: curve.samples.time[*last],
                samples: u32::try_from(own.len()).unwrap_or(u32::MAX),
                phase_deg: range(curve.samples.phase_deg.as_ref(), &own),
                range_m: range(curve.samples.range_m.as_ref(), &own),
                brightest: range(Some(&channel.rate_hz), &own).map(|r| r.1),
            });
        }
    }
    rows
}

fn of_photometry(import: &Import) -> Vec<Light> {
    let read = &import.samples;
    let norad_id = number_in(&read.target);
    let filters = filters(import);
    let filter = |i: usize| filters[i].as_str();
    let mut rows = Vec::new();
    for (number, part) in passes(&read.time).into_iter().enumerate() {
        let mut names: Vec<&str> = part.iter().map(|i| filter(*i)).collect();
        names.sort_unstable();
        names.dedup();
        for name in names {
            let is_own = |i: &usize| filter(*i) == name && read.magnitude[*i].is_finite();
            let own: Vec<usize> = part.iter().copied().filter(is_own).collect();
            let (Some(first), Some(last)) = (own.first(), own.last()) else { continue };
            rows.push(Light {
                pass: u32::try_from(number + 1).unwrap_or(u32::MAX),
                kind: Kind::Magnitudes,
                target: read.target.clone(),
                norad_id,
                station: String::new(),
                channel: name.to_owned(),
                from: read.time[*first],
                to: read.time[*last],
                samples: u32::try_from(own.len()).unwrap_or(u32::MAX),
                phase_deg: range(read.phase_deg.as_ref(), &own),
                range_m: range(read.range_km.as_ref(), &own).map(|(a, b)| (1e3 * a, 1e3 * b)),
                brightest: range(Some(&read.magnitude), &own).map(|r| r.0),
            });
        }
    }
    rows
}
