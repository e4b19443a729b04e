//! Visits to stars: read, measured, predicted.

use super::orientation;
use anyhow::{Context as _, bail};
use hifitime::{Epoch, Unit};
use serde_json::Value;
use std::path::Path;
use sunglint_calibration::reduction::light_curves;
use sunglint_calibration::stars::scintillation::Aperture;
use sunglint_calibration::stars::visit::{Mean, mean};
use sunglint_calibration::stars::{Measured, Visit};
use sunglint_formats::time::format_utc;
use sunglint_numerics::progress::Silent;
use sunglint_radiometry::air::{Air, Zenith};
use sunglint_radiometry::light_curve::{LightCurve, RateKind};
use sunglint_radiometry::passband::ZeroPoint;
use sunglint_radiometry::sky::{Catalogue, Equatorial, Observer, Star};
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
    /// Its target, as the file says.
    pub target: Value,
}

/// The visits of a path: of a linear light curve, of all that lie in a folder, or of a session as it was recorded, which is
/// reduced; and what was left out there.
///
/// # Errors
/// A path that cannot be read, a file that is no linear light curve of a star, a session that cannot be reduced.
pub fn visits_of(path: &Path) -> anyhow::Result<(Vec<StarVisit>, Vec<String>)> {
    if !path.is_dir() {
        return match read(path)? {
            Ok(visit) => Ok((vec![visit], Vec::new())),
            Err(why) => bail!("{}: {why}", path.display()),
        };
    }
    if path.join("session.toml").is_file() {
        return reduced(path);
    }
    let entries =
        std::fs::read_dir(path).map_err(|e| sunglint_formats::FileError::io("read", path, e))?;
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
fn reduced(folder: &Path) -> anyhow::Result<(Vec<StarVisit>, Vec<String>)> {
    let manifest = sunglint_formats::read::bytes(folder.join("session.toml"))?;
    let sha256 = sunglint_formats::sha256(&manifest);
    let (curves, warnings) = light_curves(folder, &Silent).map_err(crate::reduce::hint)?;
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
fn read(path: &Path) -> anyhow::Result<Result<StarVisit, String>> {
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
pub(super) struct Prepared {
    /// The star's name.
    pub star: String,
    /// The night's date.
    pub night: String,
    /// Middle of its samples.
    pub middle: Epoch,
    /// Mean true zenith angle, degrees.
    pub zenith_deg: f64,
    pub airmass: f64,
    pub b_minus_v_mag: Option<f64>,
    pub light: StarLight,
    pub scintillation: f64,
    /// By channel of the station.
    pub means: Vec<Option<Mean>>,
}

impl Prepared {
    pub fn new(
        visit: &StarVisit,
        station: &Station,
        air: &Air,
        aperture: &Aperture,
        zero: ZeroPoint,
    ) -> anyhow::Result<Self> {
        let star = star_of(&visit.target)?;
        let light = light_of(&star, zero)?;
        let curve = &visit.curve;
        let zenith = zenith_angles(curve, &star, station)?;
        let airmass = zenith
            .iter()
            .map(|z| Ok(air.air_masses(&air.path(Zenith::True(*z))?).rayleigh))
            .collect::<anyhow::Result<Vec<f64>>>()
            .context("the way of the star's light through the air")?;
        if let Some(unknown) = curve.channels.iter().find(|c| station.channel(&c.name).is_none()) {
            bail!("its channel `{}` is none of the station {}", unknown.name, station.name);
        }
        let of = |name: &str| mean(curve, curve.channel(name)?, &airmass, aperture);
        let means: Vec<Option<Mean>> = station.channels.iter().map(|c| of(&c.name)).collect();
        let measured: Vec<&Mean> = means.iter().flatten().collect();
        if measured.is_empty() {
            bail!("no sample of any channel is valid");
        }
        let exposed_s = measured.iter().map(|m| m.exposed_s).fold(0.0, f64::max);
        let total: f64 = curve.samples.exposure_s.iter().sum();
        let weighted = |values: &[f64]| {
            let pairs = values.iter().zip(&curve.samples.exposure_s);
            pairs.map(|(v, t)| v * t).sum::<f64>() / total
        };
        let mean_airmass = measured.iter().map(|m| m.airmass).sum::<f64>() / measured.len() as f64;
        let first = curve.samples.time[0];
        let offsets: Vec<f64> =
            curve.samples.time.iter().map(|t| (*t - first).to_seconds()).collect();
        let middle = first + weighted(&offsets) * Unit::Second;
        Ok(Self {
            star: star.label(),
            night: night_of(middle, station.site.geodetic().longitude_deg),
            middle,
            zenith_deg: weighted(&zenith),
            airmass: mean_airmass,
            b_minus_v_mag: star.bv_mag.filter(|c| c.is_finite()),
            scintillation: aperture.variance(exposed_s, mean_airmass).sqrt(),
            light,
            means,
        })
    }

    /// Predicted beside measured; with an air that is thicker by a depth, how the prediction depends on it.
    pub fn visit(
        &self,
        station: &Station,
        air: &Air,
        thicker: Option<(&Air, f64)>,
    ) -> anyhow::Result<Visit> {
        let light = &self.light.irradiance;
        let through = |air: &Air| air.spectrum(Zenith::True(self.zenith_deg), light.range_nm());
        let clear = through(air)?;
        let hazy =
            thicker.map(|(air, step)| Ok::<_, anyhow::Error>((through(air)?, step))).transpose()?;
        let channels = station.channels.iter().zip(&self.means).map(|(channel, mean)| {
            let mean = (*mean)?;
            let predicted = station.rate_hz(channel, light, Some(&clear));
            let predicted_hz = predicted.value;
            let per_aerosol_depth = hazy.as_ref().map(|(hazy, step)| {
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

/// The date at which a night began at a longitude: it changes at mean noon there.
pub(crate) fn night_of(epoch: Epoch, longitude_deg: f64) -> String {
    let noon = epoch + (longitude_deg / 15.0 - 12.0) * Unit::Hour;
    format_utc(noon, 0).chars().take(10).collect()
}

/// The star of the catalogue, or the one that the file describes (`ra_deg`, `dec_deg`, `v_mag`, `b_minus_v_mag`, `spectral_type`).
fn star_of(target: &Value) -> anyhow::Result<Star> {
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
        (Err(error), ..) => {
            bail!(
                "{error}. A star that the catalogue lacks needs ra_deg, dec_deg and v_mag in the file's target"
            )
        }
    };
    star.v_mag = number("v_mag").or(star.v_mag);
    star.bv_mag = number("b_minus_v_mag").or(star.bv_mag);
    star.spectral_type = target["spectral_type"].as_str().map(str::to_owned).or(star.spectral_type);
    Ok(star)
}

fn light_of(star: &Star, zero: ZeroPoint) -> anyhow::Result<StarLight> {
    let Some(v_mag) = star.v_mag else { bail!("no magnitude of {star} is known") };
    let colours = StarColours {
        v_mag,
        b_minus_v_mag: star.bv_mag,
        spectral_type: star.spectral_type.as_deref(),
        zero,
    };
    let light = match star.hip {
        Some(crate::star::VEGA_HIP) => star_light::vega(colours),
        _ => star_light::of(colours),
    };
    Ok(light?)
}

/// True zenith angles of the samples: the file's, else the star's.
fn zenith_angles(curve: &LightCurve, star: &Star, station: &Station) -> anyhow::Result<Vec<f64>> {
    if let Some(known) = &curve.samples.zenith_deg {
        return Ok(known.clone());
    }
    let zenith = |t: &Epoch| {
        let observer = Observer::at(*t, &station.site, orientation())?;
        Ok(observer.star(star).horizontal.zenith_deg())
    };
    curve.samples.time.iter().map(zenith).collect()
}
