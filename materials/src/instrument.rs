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

/// Half-width of a 95 % interval over the standard deviation.
pub(crate) const HALF: f64 = 1.96;
/// Largest part of a value that is taken to be stray light.
const MOST_STRAY: f64 = 0.95;

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
        Some(Self {
            cone_half_angle_deg,
            source_half_angle_deg,
            scale_sigma: scale_sigma.unwrap_or(0.0),
            additive_per_sr: additive.unwrap_or(0.0),
            common_additive_per_sr: shared.unwrap_or(0.0),
            stray_bound_per_sr: stray,
            zero_sigma_deg,
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

    /// The same of ln f where f is a value, sr⁻¹. Where all of a value may be stray light the surface may have nearly nothing.
    #[must_use]
    pub fn shared_ln(&self, value_per_sr: f64, cos_o: f64) -> f64 {
        let part = self.shared_per_sr(cos_o) / value_per_sr;
        (-(-part.min(MOST_STRAY)).ln_1p()).max(part.ln_1p())
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
        let bad = samples(json!({ "instrument": { "cone_half_angle_deg": "wide" } }));
        let bad = TableInstrument::of(&bad).unwrap();
        assert!(bad.cone_half_angle_deg.is_none() && bad.is_source_unknown());
        assert!(bad.missing[0].contains("\"wide\""), "{:?}", bad.missing);
    }
}
