//! The `[[laser]]` tables of a station, and of a scene that brings its own.

use super::{BeamShape, Laser, Ranging};
use crate::sky::{Geodetic, Site};
use serde::Deserialize;
use sunglint_formats::ParseError;
use sunglint_formats::toml::{Document, Finite, LatitudeDeg, LongitudeDeg, NonNegative, Positive};

/// A `[[laser]]` table as serde reads it.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LaserFile {
    pub(super) name: String,
    wavelength_nm: Positive,
    linewidth_nm: Positive,
    pulse_energy_mj: Positive,
    pulse_length_ns: Positive,
    repetition_rate_hz: Positive,
    divergence_arcsec: Positive,
    beam_radius_m: Positive,
    #[serde(default)]
    beam: BeamShape,
    receiver: Option<String>,
    site: Option<LaserSite>,
    ranging: Option<RangingFile>,
    pub(super) note: Option<String>,
}

/// Where a laser stands that is not beside the telescope.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct LaserSite {
    latitude_deg: LatitudeDeg,
    longitude_deg: LongitudeDeg,
    height_m: Finite,
}

/// Range data that a laser delivers.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct RangingFile {
    station: String,
    pad: u32,
    system: u32,
    occupancy: u32,
    network: Option<String>,
    ilrs_id: Option<u32>,
    sic: Option<u32>,
    normal_point_s: Positive,
    gate_ns: Option<Positive>,
    jitter_ps: Option<NonNegative>,
}

impl RangingFile {
    /// Gate where none is given, ns.
    const GATE_NS: f64 = 100.0;

    fn ranging(&self, document: &Document, key: &str) -> Result<Ranging, ParseError> {
        for (name, text) in [("station", Some(&self.station)), ("network", self.network.as_ref())] {
            let letter = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-');
            if text.is_some_and(|t| !(1..=10).contains(&t.len()) || !t.chars().all(letter)) {
                let expected = "1 to 10 letters, digits, _ and -, as range data have them";
                return Err(document.error_at(&format!("{key}.{name}"), expected));
            }
        }
        let numbers = [
            ("pad", self.pad, 9999),
            ("system", self.system, 99),
            ("occupancy", self.occupancy, 99),
        ];
        for (name, number, most) in numbers {
            if number > most {
                return Err(document.error_at(&format!("{key}.{name}"), format!("0 to {most}")));
            }
        }
        if self.normal_point_s.get() > 3600.0 {
            let expected = "the length of a normal point, at most 3600 s";
            return Err(document.error_at(&format!("{key}.normal_point_s"), expected));
        }
        Ok(Ranging {
            station: self.station.clone(),
            numbers: numbers.map(|(_, number, _)| number),
            network: self.network.clone(),
            target: [self.ilrs_id, self.sic],
            normal_point_s: self.normal_point_s.get(),
            gate_s: self.gate_ns.map_or(Self::GATE_NS, Positive::get) * 1e-9,
            jitter_s: self.jitter_ps.map_or(0.0, NonNegative::get) * 1e-12,
        })
    }
}

impl LaserSite {
    fn site(&self, document: &Document, key: &str) -> Result<Site, ParseError> {
        let geodetic = Geodetic {
            latitude_deg: self.latitude_deg.get(),
            longitude_deg: self.longitude_deg.get(),
            height_m: self.height_m.get(),
        };
        Site::new(geodetic).map_err(|e| document.error_at(key, e.to_string()))
    }
}

/// The lasers of a document's `laser` tables, beside others that are there already; `is_channel` knows the station's channels.
///
/// # Errors
/// A name that is none or taken; a receiver that is no channel; a divergence of a degree and more; a site that is none.
pub fn lasers(
    document: &Document,
    files: &[LaserFile],
    others: &[Laser],
    is_channel: &dyn Fn(&str) -> bool,
) -> Result<Vec<Laser>, ParseError> {
    let mut lasers: Vec<Laser> = Vec::new();
    for (i, file) in files.iter().enumerate() {
        let key = |name: &str| format!("laser[{i}].{name}");
        super::file::check_name(document, &key("name"), &file.name, "_-")?;
        if lasers.iter().chain(others).any(|l| l.name == file.name) {
            return Err(document.error_at(&key("name"), "a name that no other laser has"));
        }
        if let Some(receiver) = &file.receiver
            && !is_channel(receiver)
        {
            return Err(document.error_at(&key("receiver"), "a channel of the station"));
        }
        if file.divergence_arcsec.get() > 3600.0 {
            let expected = "the full angle of a beam, below 3600 arcsec";
            return Err(document.error_at(&key("divergence_arcsec"), expected));
        }
        let site = |site: &LaserSite| site.site(document, &key("site.height_m"));
        let ranging = |ranging: &RangingFile| ranging.ranging(document, &key("ranging"));
        lasers.push(Laser {
            name: file.name.clone(),
            wavelength_nm: file.wavelength_nm.get(),
            linewidth_nm: file.linewidth_nm.get(),
            pulse_energy_j: file.pulse_energy_mj.get() * 1e-3,
            pulse_length_s: file.pulse_length_ns.get() * 1e-9,
            repetition_rate_hz: file.repetition_rate_hz.get(),
            divergence_arcsec: file.divergence_arcsec.get(),
            beam_radius_m: file.beam_radius_m.get(),
            beam: file.beam,
            receiver: file.receiver.clone(),
            site: file.site.as_ref().map(site).transpose()?,
            ranging: file.ranging.as_ref().map(ranging).transpose()?,
        });
    }
    Ok(lasers)
}
