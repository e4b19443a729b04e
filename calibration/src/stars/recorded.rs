//! Visits to stars as they were recorded: read, measured, predicted.

use super::nights::{NightsError, VisitError};
use super::scintillation::Aperture;
use super::visit::{Mean, mean};
use super::{Measured, Visit};
use crate::reduction::light_curves;
use hifitime::{Epoch, Unit};
use serde_json::Value;
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::path::{Path, PathBuf};
use sunglint_formats::FileError;
use sunglint_formats::time::format_utc;
use sunglint_numerics::progress::Silent;
use sunglint_radiometry::air::{Air, AirError, Zenith};
use sunglint_radiometry::light_curve::{LightCurve, RateKind};
use sunglint_radiometry::passband::ZeroPoint;
use sunglint_radiometry::sky::{Catalogue, EarthOrientation, Equatorial, Observer, Star};
use sunglint_radiometry::spectrum::{Spectrum, Transmission};
use sunglint_radiometry::star_light::{self, StarColours, StarLight};
use sunglint_radiometry::station::Station;

/// A visit to a star as it was read.
#[derive(Debug, Clone)]
pub struct StarVisit {
    /// The file that it is in.
    pub file: String,
    /// SHA-256 of its bytes.
    pub sha256: String,
    /// The light curve.
    pub curve: LightCurve,
    /// Target of the visit, as the file describes it.
    pub target: Value,
}

/// Reads the visits of paths, each once, and says what was left out: of linear light curves, of all that lie in folders, or of sessions as they were
/// recorded, which are reduced.
///
/// # Errors
/// A path that cannot be read, a file that is no linear light curve of a star, a session that cannot be reduced, no visit at all.
pub fn read_visits(paths: &[PathBuf]) -> Result<(Vec<StarVisit>, Vec<String>), NightsError> {
    let (mut read, mut warnings) = (Vec::new(), Vec::new());
    for path in paths {
        let (visits, left_out) = visits_of(path)?;
        read.extend(visits);
        warnings.extend(left_out);
    }
    once_each(&mut read, &mut warnings);
    if read.is_empty() {
        return Err(NightsError::NoVisit { inputs: paths.to_vec() });
    }
    Ok((read, warnings))
}

/// Drops files that came twice, by themselves and in their folder perhaps: a visit counts once. Visits of a session share its check sum, and are told apart
/// by their targets.
fn once_each(read: &mut Vec<StarVisit>, warnings: &mut Vec<String>) {
    let mut seen: HashMap<(String, String), String> = HashMap::new();
    let key = |visit: &StarVisit| (visit.sha256.clone(), visit.target.to_string());
    read.retain(|visit| match seen.entry(key(visit)) {
        Entry::Occupied(first) => {
            warnings.push(format!("{} is left out: the same as {}", visit.file, first.get()));
            false
        }
        Entry::Vacant(place) => {
            place.insert(visit.file.clone());
            true
        }
    });
}

/// The visits of a path: of a linear light curve, of all that lie in a folder, or of a session as it was recorded, which is
/// reduced; and what was left out there.
///
/// # Errors
/// A path that cannot be read, a file that is no linear light curve of a star, a session that cannot be reduced.
fn visits_of(path: &Path) -> Result<(Vec<StarVisit>, Vec<String>), NightsError> {
    if !path.is_dir() {
        return match read(path)? {
            Ok(visit) => Ok((vec![visit], Vec::new())),
            Err(why) => Err(NightsError::NotOfAStar { path: path.to_path_buf(), why }),
        };
    }
    if path.join("session.toml").is_file() {
        return reduced(path);
    }
    let entries = std::fs::read_dir(path).map_err(|e| FileError::io("read", path, e))?;
    let mut files: Vec<_> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|file| file.extension().is_some_and(|e| e.eq_ignore_ascii_case("ecsv")))
        .collect();
    files.sort();
    let (mut visits, mut left_out) = (Vec::new(), Vec::new());
    for file in files {
        match read(&file)? {
            Ok(visit) => visits.push(visit),
            // A night has satellites too: nothing to warn of.
            Err(why) if why.starts_with(NOT_A_STAR) => {}
            Err(why) => left_out.push(format!("{} is left out: {why}", file.display())),
        }
    }
    Ok((visits, left_out))
}

/// The visits of a session as it was recorded: what `sunglint reduce` makes of it when it is told nothing.
fn reduced(folder: &Path) -> Result<(Vec<StarVisit>, Vec<String>), NightsError> {
    let manifest = sunglint_formats::read::bytes(folder.join("session.toml"))?;
    let sha256 = sunglint_formats::sha256(&manifest);
    let (curves, warnings) = light_curves(folder, &Silent)?;
    let visit = |curve: LightCurve| {
        let target = curve.other.get("target").cloned().unwrap_or(Value::Null);
        let file = format!("{} ({})", folder.display(), curve.provenance.target);
        StarVisit { file, sha256: sha256.clone(), curve, target }
    };
    let curves = curves.into_iter().map(|(_, curve)| curve);
    let visits = curves.map(visit).filter(|visit| visit.target["kind"] == "star");
    Ok((visits.collect(), warnings))
}

const NOT_A_STAR: &str = "its target is no star";

/// A file's visit, or why it has none.
fn read(path: &Path) -> Result<Result<StarVisit, String>, FileError> {
    let bytes = sunglint_formats::read::bytes(path)?;
    let sha256 = sunglint_formats::sha256(&bytes);
    let text = sunglint_formats::read::decode(path, bytes)?;
    let table = sunglint_formats::ecsv::read_str(path, &text)?;
    if table.meta_text("quantity").is_none() {
        return Ok(Err("no light curve: it has no `quantity`".into()));
    }
    let curve = LightCurve::from_table(path, &table)?;
    let target = curve.other.get("target").cloned().unwrap_or(Value::Null);
    if let Some(kind) = target["kind"].as_str().filter(|kind| *kind != "star") {
        return Ok(Err(format!("{NOT_A_STAR} but of the kind `{kind}`")));
    }
    if curve.kind != RateKind::Linear {
        return Ok(Err(format!("its rates are {}, expected linear", curve.kind)));
    }
    if target["name"].as_str().is_none() {
        return Ok(Err("its metadata say no `target` with a `name`".into()));
    }
    if curve.is_empty() {
        return Ok(Err("it has no sample".into()));
    }
    let file = path.display().to_string();
    Ok(Ok(StarVisit { file, sha256, curve, target }))
}

/// A visit that is measured, and whose star is known.
#[derive(Debug, Clone)]
pub struct MeasuredVisit {
    /// The star's name.
    pub star: String,
    /// The night's date.
    pub night: String,
    /// Middle of its samples.
    pub middle: Epoch,
    /// Mean true zenith angle, degrees.
    pub zenith_deg: f64,
    /// Mean relative air mass (Rayleigh).
    pub airmass: f64,
    /// B−V, mag, where it is known.
    pub b_minus_v_mag: Option<f64>,
    /// The star's light above the air.
    pub light: StarLight,
    /// Relative standard deviation of the visit's mean by scintillation.
    pub scintillation: f64,
    /// Mean rates, by channel of the station.
    pub means: Vec<Option<Mean>>,
}

impl MeasuredVisit {
    /// Takes the means of a visit's channels, and finds its star.
    ///
    /// # Errors
    /// A star that is not known, or without a magnitude; an angle that has no way through the air; a channel that the station has not; no valid sample.
    pub fn new(
        visit: &StarVisit,
        station: &Station,
        air: &Air,
        aperture: &Aperture,
        zero: ZeroPoint,
    ) -> Result<Self, VisitError> {
        let star = star_of(&visit.target)?;
        let light = light_of(&star, zero)?;
        let curve = &visit.curve;
        let zenith = zenith_angles(curve, &star, station)?;
        let airmass = zenith
            .iter()
            .map(|z| Ok(air.air_masses(&air.path(Zenith::True(*z))?).rayleigh))
            .collect::<Result<Vec<f64>, AirError>>()
            .map_err(VisitError::Path)?;
        if let Some(unknown) = curve.channels.iter().find(|c| station.channel(&c.name).is_none()) {
            return Err(VisitError::UnknownChannel {
                channel: unknown.name.clone(),
                station: station.name.clone(),
            });
        }
        let of = |name: &str| mean(curve, curve.channel(name)?, &zenith, &airmass, aperture);
        let means: Vec<Option<Mean>> = station.channels.iter().map(|c| of(&c.name)).collect();
        let measured: Vec<&Mean> = means.iter().flatten().collect();
        if measured.is_empty() {
            return Err(VisitError::NothingValid);
        }
        let exposed_s = measured.iter().map(|m| m.exposed_s).fold(0.0, f64::max);
        // Over the samples that the rates are of, not over all: a gap would shift the angle against the rates.
        let over = |value: &dyn Fn(&Mean) -> f64| {
            measured.iter().map(|m| value(m)).sum::<f64>() / measured.len() as f64
        };
        let mean_airmass = over(&|m| m.airmass);
        let middle = curve.samples.time[0] + over(&|m| m.middle_s) * Unit::Second;
        Ok(Self {
            star: star.label(),
            night: night_of(middle, station.site.geodetic().longitude_deg),
            middle,
            zenith_deg: over(&|m| m.zenith_deg),
            airmass: mean_airmass,
            b_minus_v_mag: star.bv_mag.filter(|c| c.is_finite()),
            scintillation: aperture.variance(exposed_s, mean_airmass).sqrt(),
            light,
            means,
        })
    }

    /// Predicted beside measured; with an air that is thicker by a depth, how the prediction depends on it.
    ///
    /// # Errors
    /// An angle that has no way through the air.
    pub fn visit(
        &self,
        station: &Station,
        air: &Air,
        thicker: Option<(&Air, f64)>,
    ) -> Result<Visit, AirError> {
        let light = &self.light.irradiance;
        // Channels whose samples are valid at the same times see the star through the same air.
        let mut ways: Vec<(f64, Way)> = Vec::new();
        for mean in self.means.iter().flatten() {
            if ways.iter().all(|(zenith_deg, _)| *zenith_deg != mean.zenith_deg) {
                let through =
                    |air: &Air| air.spectrum(Zenith::True(mean.zenith_deg), light.range_nm());
                let hazy = thicker
                    .map(|(air, step)| Ok::<_, AirError>((through(air)?, step)))
                    .transpose()?;
                ways.push((mean.zenith_deg, Way { clear: through(air)?, hazy }));
            }
        }
        let channels = station.channels.iter().zip(&self.means).map(|(channel, mean)| {
            let mean = (*mean)?;
            let (_, way) = ways.iter().find(|(zenith_deg, _)| *zenith_deg == mean.zenith_deg)?;
            let predicted_hz = station.rate_hz(channel, light, Some(&way.clear)).value;
            let per_aerosol_depth = way.hazy.as_ref().map(|(hazy, step)| {
                (station.rate_hz(channel, light, Some(hazy)).value / predicted_hz).ln() / step
            });
            let usable = predicted_hz > 0.0 && mean.sigma_hz > 0.0;
            usable.then_some(Measured {
                predicted_hz,
                measured_hz: mean.rate_hz,
                sigma_hz: mean.sigma_hz,
                per_aerosol_depth,
            })
        });
        Ok(Visit {
            star: self.star.clone(),
            airmass: self.airmass,
            b_minus_v_mag: self.b_minus_v_mag,
            scintillation: self.scintillation,
            decides: !self.light.origin.is_fallback(),
            channels: channels.collect(),
        })
    }
}

/// Transmission of the air on the way of a star's light; with a thicker air, and how much thicker it is.
struct Way {
    clear: Spectrum<Transmission>,
    hazy: Option<(Spectrum<Transmission>, f64)>,
}

/// The date at which a night began at a longitude: it changes at mean noon there.
pub fn night_of(epoch: Epoch, longitude_deg: f64) -> String {
    let noon = epoch + (longitude_deg / 15.0 - 12.0) * Unit::Hour;
    format_utc(noon, 0).chars().take(10).collect()
}

/// The star of the catalogue, or the one that the file describes (`ra_deg`, `dec_deg`, `v_mag`, `b_minus_v_mag`, `spectral_type`).
fn star_of(target: &Value) -> Result<Star, VisitError> {
    let name = target["name"].as_str().unwrap_or_default();
    let number = |key: &str| target[key].as_f64();
    let place = number("ra_deg").zip(number("dec_deg"));
    let place = place.map(|(ra_deg, dec_deg)| Equatorial { ra_deg, dec_deg });
    let known = match place {
        Some(place) => Catalogue::embedded().find_at(name, place),
        None => Catalogue::embedded().find(name),
    };
    let mut star = match (known, place, number("v_mag")) {
        (Ok(star), ..) => star.clone(),
        (Err(_), Some(place), Some(_)) => Star::at(name, place)?,
        (Err(error), ..) => return Err(VisitError::UnknownStar(error)),
    };
    star.v_mag = number("v_mag").or(star.v_mag);
    star.bv_mag = number("b_minus_v_mag").or(star.bv_mag);
    star.spectral_type = target["spectral_type"].as_str().map(str::to_owned).or(star.spectral_type);
    Ok(star)
}

fn light_of(star: &Star, zero: ZeroPoint) -> Result<StarLight, VisitError> {
    let Some(v_mag) = star.v_mag else {
        return Err(VisitError::NoMagnitude { star: star.to_string() });
    };
    let colours = StarColours {
        v_mag,
        b_minus_v_mag: star.bv_mag,
        spectral_type: star.spectral_type.as_deref(),
        zero,
    };
    let light = match star.hip {
        Some(star_light::VEGA_HIP) => star_light::vega(colours),
        _ => star_light::of(colours),
    };
    Ok(light?)
}

/// True zenith angles of the samples: the file's, else the star's.
fn zenith_angles(
    curve: &LightCurve,
    star: &Star,
    station: &Station,
) -> Result<Vec<f64>, VisitError> {
    if let Some(known) = &curve.samples.zenith_deg {
        return Ok(known.clone());
    }
    let zenith = |t: &Epoch| {
        let observer = Observer::at(*t, &station.site, EarthOrientation::embedded())?;
        Ok(observer.star(star).horizontal.zenith_deg())
    };
    curve.samples.time.iter().map(zenith).collect()
}
