//! The instrument that values were measured with, as their table carries it: what laws and materials take from there.
//!
//! `sunglint brdf ingest` of a run writes it into the metadata `instrument` and `scale_sigma`. In a FITS file their names are cut to eight letters. Tables of other
//! programs have none of it, or an instrument's name as text, which says nothing here.

use crate::samples::Samples;
use glam::{DQuat, DVec3};
use serde::Serialize;
use serde_json::Value;
use std::f64::consts::PI;
use sunglint_formats::Meta;
use sunglint_simulator::surface::conductor;

/// Half-width of a 95 % interval over the standard deviation.
pub(crate) const HALF: f64 = 1.96;
/// Largest part of a value that is taken to be stray light, or to be missing by its polarisation.
const MOST_STRAY: f64 = 0.95;
/// Refractive index of facets that nobody told of: of those that shine few polarise more.
const GLASS: Index = Index { n: 1.5, k: 0.0 };

/// Refractive index n + ik.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Index {
    /// Real part.
    pub n: f64,
    /// Imaginary part.
    pub k: f64,
}

/// Polarisation of a measurement: the share that is polarised across the plane of incidence less that in it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Polarised {
    /// The table says nothing of it, as those of other programs.
    #[default]
    Unsaid,
    /// The run did not know it: any share is as likely.
    Unknown,
    /// The share, −1 to 1.
    Known(f64),
}

impl Serialize for Polarised {
    /// Writes the share; nothing where it is not known.
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let share = if let Self::Known(share) = self { Some(share) } else { None };
        share.serialize(serializer)
    }
}

/// An instrument as a table says it.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct TableInstrument {
    /// Half-angle of what the detector takes in, degrees.
    pub cone_half_angle_deg: Option<f64>,
    /// Half-angle of the disc whose directions scatter as the source's do, degrees: from the signature.
    pub source_half_angle_deg: Option<f64>,
    /// Relative standard uncertainty that all values share.
    pub scale_sigma: f64,
    /// Standard uncertainty of a value that does not grow with it, sr⁻¹: noise in the dark, and the stray light that was taken off.
    pub additive_per_sr: f64,
    /// The part of that which all values share, sr⁻¹.
    pub common_additive_per_sr: f64,
    /// Stray light that may be in all values, sr⁻¹ times cosθ_o; none where it was measured and taken off.
    pub stray_bound_per_sr: Option<f64>,
    /// Standard uncertainty of the angles that all directions share, degrees.
    pub zero_sigma_deg: f64,
    /// Polarisation of the measurement.
    pub polarised: Polarised,
    /// Whether the detector tells polarisations apart.
    #[serde(skip)]
    pub is_detector_polarised: bool,
    /// Refractive index n + ik of the sample's facets, where the run knew it.
    pub index: Option<Index>,
    /// Quantities that were not measured, and what is assumed instead.
    pub missing: Vec<String>,
}

/// A value under a key, or under what a FITS header makes of it.
fn value(meta: &Meta, key: &str, keyword: &str) -> Option<Value> {
    let found = meta.get(key).or_else(|| meta.get(keyword))?;
    match found.as_str() {
        // A text that is none of JSON is told as what it is where a number is wanted.
        Some(text) => Some(serde_json::from_str(text).unwrap_or_else(|_| Value::from(text))),
        None => Some(found.clone()),
    }
}

impl TableInstrument {
    /// Reads the instrument of a table; none where the table has none.
    #[must_use]
    pub fn of(samples: &Samples) -> Option<Self> {
        let it = value(&samples.meta, "instrument", "INSTRUME").filter(Value::is_object)?;
        let scale = value(&samples.meta, "scale_sigma", "SCALESIG");
        let mut missing: Vec<String> = it["missing"]
            .as_array()
            .into_iter()
            .flatten()
            .filter_map(|text| Some(text.as_str()?.to_owned()))
            .chain(it["missing"].as_str().map(str::to_owned))
            .collect();
        // A number that is none is as good as one that is not there, and is named as that.
        let mut number = |name: &str, found: Option<&Value>, most: f64| {
            let found = found.filter(|v| !v.is_null())?;
            let good = found.as_f64().filter(|v| (0.0..=most).contains(v));
            if good.is_none() {
                missing.push(format!(
                    "{name} (the table has {found}, expected a number from 0 to {most})"
                ));
            }
            good
        };
        let cone_half_angle_deg = number(
            "the detector's cone, instrument.cone_half_angle_deg",
            it.get("cone_half_angle_deg"),
            MOST_DEG,
        );
        let source = it.get("signature").and_then(|s| s.get("source_half_angle_deg"));
        let source_half_angle_deg =
            number("the source, instrument.signature.source_half_angle_deg", source, MOST_DEG);
        let scale_sigma = number("the scale's uncertainty, scale_sigma", scale.as_ref(), 10.0);
        let additive = it.get("additive_per_sr");
        let additive = number("the noise in the dark, instrument.additive_per_sr", additive, 1e9);
        let shared = it.get("common_additive_per_sr");
        let shared = number("the dark, instrument.common_additive_per_sr", shared, 1e9);
        let stray = it.get("stray_bound_per_sr");
        let stray = number("stray light, instrument.stray_bound_per_sr", stray, 1e9);
        let mut axis = |name: &str| {
            let of = format!("the axes' zeros, instrument.zeros.{name}");
            number(&of, it["zeros"][name].get(1), MOST_DEG).unwrap_or(0.0)
        };
        let zero_sigma_deg = axis("sample_deg").hypot(axis("detector_deg"));
        let polarised = match it.get("polarised") {
            None => Polarised::Unsaid,
            Some(share) => match share.as_f64().filter(|share| (-1.0..=1.0).contains(share)) {
                Some(share) => Polarised::Known(share),
                None => Polarised::Unknown,
            },
        };
        let part = |key: &str, least: f64| {
            it["sample_index"].get(key)?.as_f64().filter(|v| (least..=100.0).contains(v))
        };
        let index = part("n", 0.01).zip(part("k", 0.0)).map(|(n, k)| Index { n, k });
        Some(Self {
            cone_half_angle_deg,
            source_half_angle_deg,
            scale_sigma: scale_sigma.unwrap_or(0.0),
            additive_per_sr: additive.unwrap_or(0.0),
            common_additive_per_sr: shared.unwrap_or(0.0),
            stray_bound_per_sr: stray,
            zero_sigma_deg,
            polarised,
            is_detector_polarised: it["detector_polarised"].as_f64().is_some_and(|r| r != 0.0),
            index,
            missing,
        })
    }

    /// The half-angle of a disc that blurs as detector and source do, radians; of what is not known nothing.
    #[must_use]
    pub fn blur_rad(&self) -> f64 {
        let [cone, source] = [self.cone_half_angle_deg, self.source_half_angle_deg];
        cone.unwrap_or(0.0).hypot(source.unwrap_or(0.0)).to_radians()
    }

    /// Half-width of the 95 % interval of light that all values towards a direction have too much or too little, sr⁻¹: the dark level, and stray light, which f has over cosθ_o.
    #[must_use]
    pub fn shared_per_sr(&self, cos_o: f64) -> f64 {
        let stray = self.stray_bound_per_sr.unwrap_or(0.0) / cos_o.max(1e-3);
        (HALF * self.common_additive_per_sr).hypot(stray)
    }

    /// The same of ln f from `i` to `o` where f is a value, sr⁻¹, and of the light's polarisation. Where all of a value may be stray light the surface may have nearly nothing.
    #[must_use]
    pub fn shared_ln(&self, value_per_sr: f64, i: DVec3, o: DVec3) -> f64 {
        let part = self.shared_per_sr(o.z) / value_per_sr;
        let light = (-(-part.min(MOST_STRAY)).ln_1p()).max(part.ln_1p());
        light.hypot(self.polarised_ln(i, o))
    }

    /// Half-width of the 95 % interval of ln f by the polarisation of the measurement's light, where f is that of light without. A facet from `i` to `o` polarises such light to D = (R_s − R_p)/(R_s + R_p) (Born and Wolf, Principles of
    /// Optics, §1.5.3), across its own plane of `i` and `o`. It is measured as 1 + P D cos 2ψ with a share P across the plane of incidence, and ψ between both planes. Light from below the surface has lost its polarisation, and a lobe may be of both: all up to D is allowed for. Where the detector is
    /// polarised too, its axes turn with it, and out of the plane the worse sign counts. An unknown P is as likely anywhere from −1 to 1: below −0.9 it is once in twenty.
    #[must_use]
    pub fn polarised_ln(&self, i: DVec3, o: DVec3) -> f64 {
        let Index { n, k } = self.index.unwrap_or(GLASS);
        let cos = i.dot((i + o).normalize_or(DVec3::Z)).clamp(0.0, 1.0);
        let degree = || {
            let whole = conductor::fresnel(n, k, cos);
            if whole > 0.0 { (conductor::difference(n, k, cos) / whole).min(1.0) } else { 0.0 }
        };
        let seen = |part: f64| part.max(-MOST_STRAY).ln_1p().abs();
        match self.polarised {
            Polarised::Unsaid => 0.0,
            Polarised::Unknown => seen(-0.9 * degree()),
            Polarised::Known(0.0) => 0.0,
            Polarised::Known(share) => {
                let planes = DVec3::Z.cross(i).try_normalize().zip(i.cross(o).try_normalize());
                // Light along the normal has no plane of its own.
                let twice = planes.map(|(bench, facet)| 2.0 * bench.dot(facet).powi(2) - 1.0);
                match twice.filter(|twice| !self.is_detector_polarised || *twice > 1.0 - 1e-6) {
                    Some(twice) => seen(share * twice * degree()),
                    None => seen(-share.abs() * degree()),
                }
            }
        }
    }

    /// Standard deviation of the logarithm of a lobe's strength by the same, from values in some directions.
    pub fn strength_sigma_ln(&self, directions: impl Iterator<Item = (DVec3, DVec3)>) -> f64 {
        let (sum, n) = directions
            .fold((0.0, 0.0), |(sum, n), (i, o)| (sum + self.polarised_ln(i, o).powi(2), n + 1.0));
        if n > 0.0 { (sum / n).sqrt() / HALF } else { 0.0 }
    }

    /// Standard deviation of the logarithm of a diffuse reflectance by that light.
    #[must_use]
    pub fn diffuse_sigma_ln(&self, reflectance: f64) -> f64 {
        PI * self.shared_per_sr(1.0) / HALF / reflectance
    }

    /// Directions of the observer as far aside in the plane of incidence as the axes' zeros are uncertain (one standard deviation), above the horizon.
    pub fn aside(&self, i: DVec3, o: DVec3) -> impl Iterator<Item = DVec3> {
        let across = DVec3::Z.cross(i).try_normalize().unwrap_or(DVec3::Y);
        let angle = self.zero_sigma_deg.to_radians();
        let turned = [angle, -angle].map(|angle| DQuat::from_axis_angle(across, angle) * o);
        turned.into_iter().filter(move |o| angle > 0.0 && o.z > 1e-3)
    }

    /// Whether the width of the source was not measured, so that the blur may be more than [`Self::blur_rad`].
    #[must_use]
    pub fn is_source_unknown(&self) -> bool {
        self.source_half_angle_deg.is_none()
    }
}

/// Angles of a cone that is one, degrees.
const MOST_DEG: f64 = 10.0;

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn samples(meta: Value) -> Samples {
        let meta = meta.as_object().cloned().unwrap_or_default().into_iter().collect();
        Samples { meta, ..Samples::default() }
    }

    /// Truth: the numbers in the metadata. A name of an instrument is no instrument, and a number that is none is named.
    #[test]
    fn an_instrument_is_read_from_metadata() {
        let it = json!({
            "cone_half_angle_deg": 0.57, "signature": { "source_half_angle_deg": 0.1 },
            "additive_per_sr": 2e-5, "stray_bound_per_sr": null,
            "zeros": { "sample_deg": [0.1, 0.03], "detector_deg": [0.2, 0.04] }, "missing": ["stray light"],
        });
        let found = samples(json!({ "instrument": it, "scale_sigma": 0.01 }));
        let found = TableInstrument::of(&found).unwrap();
        assert_eq!(found.cone_half_angle_deg, Some(0.57));
        assert_eq!((found.scale_sigma, found.additive_per_sr), (0.01, 2e-5));
        assert!((found.zero_sigma_deg - 0.05).abs() < 1e-12);
        assert!((found.blur_rad().to_degrees() - 0.57_f64.hypot(0.1)).abs() < 1e-12);
        assert_eq!(found.missing, ["stray light"]);
        let fits = samples(json!({ "INSTRUME": it.to_string(), "SCALESIG": 0.01 }));
        assert_eq!(TableInstrument::of(&fits), Some(found));
        assert_eq!(TableInstrument::of(&samples(json!({ "instrument": "Reflet 180" }))), None);
        assert_eq!(
            TableInstrument::of(&samples(json!({ "instrument": it }))).unwrap().polarised,
            Polarised::Unsaid
        );
        let bad = samples(json!({ "instrument": { "cone_half_angle_deg": "wide" } }));
        let bad = TableInstrument::of(&bad).unwrap();
        assert!(bad.cone_half_angle_deg.is_none() && bad.is_source_unknown());
        assert!(bad.missing[0].contains("\"wide\""), "{:?}", bad.missing);
    }

    /// Truth: Hecht, Optics (4th ed.), fig. 4.41 and eqs. 4.34 and 4.40, glass of 1.5: at 45° R_s = 9.20 % and R_p = 0.85 %, at Brewster's angle (arctan 1.5) R_p = 0. What is measured in light of which a share P is across the plane of incidence is
    /// ((1 + P) R_s + (1 − P) R_p)/2, and the doubt holds ln of that over the light without polarisation. Tolerance: the digits of the figures; at Brewster's angle P = −1 measures nothing, and the doubt is the ln 20 that is the most.
    #[test]
    fn a_polarised_beam_widens_by_what_glass_reflects_of_it() {
        let at = |deg: f64| {
            let (sin, cos) = deg.to_radians().sin_cos();
            (DVec3::new(sin, 0.0, cos), DVec3::new(-sin, 0.0, cos))
        };
        let half = |polarised, deg| {
            let (i, o) = at(deg);
            TableInstrument { polarised, ..Default::default() }.polarised_ln(i, o)
        };
        for (share, deg, s, p) in [(1.0, 45.0, 9.20, 0.85), (-0.6, 45.0, 9.20, 0.85)] {
            let measured: f64 = 0.5 * ((1.0 + share) * s + (1.0 - share) * p);
            let truth = (measured / (0.5 * (s + p))).ln().abs();
            let found = half(Polarised::Known(share), deg);
            assert!((found - truth).abs() < 2e-3, "{share}: {found} {truth}");
        }
        let brewster = 1.5_f64.atan().to_degrees();
        assert!((half(Polarised::Known(1.0), brewster) - 2.0_f64.ln()).abs() < 1e-12);
        assert!((half(Polarised::Known(-1.0), brewster) - 20.0_f64.ln()).abs() < 1e-9);
        // Every share from −1 to 1 alike: 95 of 100 lie within the half-width.
        for deg in [30.0, 45.0, brewster, 80.0] {
            let known = |k: i32| half(Polarised::Known(f64::from(k) / 1000.0 - 0.9995), deg);
            let unknown = half(Polarised::Unknown, deg);
            let held = (0..2000).filter(|k| known(*k) <= unknown).count();
            assert!((1898..=1902).contains(&held), "{deg}: {held}");
        }
        // Out of the plane a facet has another: by hand, the components of light across the plane of incidence along and across that of the facet, θ_i 10°, θ_o 80°, φ 90°, glass: 0.31 of what light without polarisation gives.
        let direction = |theta: f64, phi: f64| {
            let ((s, c), (sp, cp)) = (theta.to_radians().sin_cos(), phi.to_radians().sin_cos());
            DVec3::new(s * cp, s * sp, c)
        };
        let (i, o) = (direction(10.0, 0.0), direction(80.0, 90.0));
        let across = TableInstrument { polarised: Polarised::Known(1.0), ..Default::default() };
        assert!((across.polarised_ln(i, o) - 1.17).abs() < 0.01, "{}", across.polarised_ln(i, o));
        let both = TableInstrument { is_detector_polarised: true, ..across.clone() };
        assert!(both.polarised_ln(i, o) >= across.polarised_ln(i, o));
        assert!(half(Polarised::Known(-1.0), 0.0) < 1e-12);
        assert_eq!(half(Polarised::Unsaid, brewster) + half(Polarised::Known(0.0), 60.0), 0.0);
        // Aluminium at 633 nm (n = 1.37, k = 7.62): R_s and R_p at 60° by Python's complex numbers (Born and Wolf, §1.5.2, with a complex index).
        let metal = TableInstrument {
            polarised: Polarised::Known(1.0),
            index: Some(Index { n: 1.37, k: 7.62 }),
            ..Default::default()
        };
        let (i, o) = at(60.0);
        let truth = (2.0_f64 * 0.956_261_3 / (0.956_261_3 + 0.839_632_5)).ln();
        assert!((metal.polarised_ln(i, o) - truth).abs() < 1e-6, "{}", metal.polarised_ln(i, o));
    }
}
