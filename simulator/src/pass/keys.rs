//! The keys of a `PASS.toml`, as serde reads them.

use super::SpectralQuantity;
use crate::attitude::file::AttitudeFile;
use crate::light::engine::{Switch, Switches};
use crate::target::file::{HingeFile, MaterialFile, PartFile};
use serde::Deserialize;
use serde::de::IgnoredAny;
use std::collections::BTreeMap;
use sunglint_formats::time::Utc;
use sunglint_formats::toml::{Finite, Fraction, NonNegative, Positive};
use sunglint_radiometry::station::LaserFile;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PassKeys {
    pub name: Option<String>,
    pub tolerance: Option<Positive>,
    pub budget_s: Option<Positive>,
    pub target: TargetKeys,
    pub orbit: Option<OrbitKeys>,
    pub ephemeris: Option<FileKey>,
    pub attitude: Option<AttitudeFile>,
    pub station: Option<StationKeys>,
    pub times: TimesKeys,
    #[serde(default)]
    pub spectrum: SpectrumKeys,
    #[serde(default)]
    pub air: AirKeys,
    pub earth_orientation: Option<FileKey>,
    #[serde(default)]
    pub earth: EarthKeys,
    #[serde(default)]
    pub illumination: IlluminationKeys,
    #[serde(default)]
    pub magnitudes: MagnitudeKeys,
    #[serde(default)]
    pub effects: EffectKeys,
    #[serde(default)]
    pub correction: CorrectionKeys,
    #[serde(default)]
    pub laser: Vec<LaserFile>,
    /// Table that `sunglint fit` reads; it has no effect here.
    #[serde(rename = "fit", default)]
    pub _fit: Option<IgnoredAny>,
    pub note: Option<String>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TargetKeys {
    pub name: Option<String>,
    #[serde(default)]
    pub description: String,
    pub file: Option<String>,
    pub built_in: Option<String>,
    pub sphere: Option<SphereKeys>,
    #[serde(default)]
    pub part: Vec<PartFile>,
    #[serde(default)]
    pub hinge: Vec<HingeFile>,
    #[serde(default)]
    pub material: Vec<MaterialFile>,
    #[serde(default)]
    pub retro: Vec<crate::ranging::cubes::RetroFile>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SphereKeys {
    pub radius_m: Positive,
    pub material: Option<String>,
    pub reflectance: Option<Fraction>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OrbitKeys {
    pub tle: Option<String>,
    pub lines: Option<Vec<String>>,
    pub norad_id: Option<u32>,
    pub name: Option<String>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FileKey {
    pub file: String,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StationKeys {
    pub name: Option<String>,
    pub file: Option<String>,
    pub folder: Option<String>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TimesKeys {
    pub from: Option<Utc>,
    pub to: Option<Utc>,
    pub step_s: Option<Positive>,
    pub exposure_s: Option<Positive>,
    pub file: Option<String>,
    pub table: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpectrumKeys {
    pub from_nm: Option<Positive>,
    pub to_nm: Option<Positive>,
    pub step_nm: Option<Positive>,
    pub edges_nm: Option<Vec<Positive>>,
    #[serde(default)]
    pub quantity: SpectralQuantity,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AirKeys {
    pub none: Option<bool>,
    pub refraction: Option<bool>,
    pub profile: Option<String>,
    pub pressure_hpa: Option<Positive>,
    pub ozone_du: Option<NonNegative>,
    pub water_mm: Option<NonNegative>,
    pub co2_ppm: Option<NonNegative>,
    pub aerosol: Option<String>,
    pub aerosol_optical_depth_550: Option<NonNegative>,
    pub aerosol_exponent: Option<Finite>,
    pub note: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EarthKeys {
    pub albedo: Option<Fraction>,
    pub file: Option<String>,
    pub missing: Option<Fraction>,
    pub uncertainty: Option<Fraction>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IlluminationKeys {
    pub irradiance_file: Option<String>,
    #[serde(default)]
    pub eclipse: EclipseWord,
    pub earth_radius_m: Option<Positive>,
}

#[derive(Debug, Default, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum EclipseWord {
    #[default]
    Sphere,
    Ellipsoid,
    None,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CorrectionKeys {
    pub time_offset_s: Option<Finite>,
    pub gain: Option<Positive>,
    pub size: Option<Positive>,
    pub extinction: Option<Finite>,
    #[serde(default)]
    pub extinction_by_channel: BTreeMap<String, Finite>,
    #[serde(default)]
    pub light: BTreeMap<String, LightKeys>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LightKeys {
    pub all: Option<NonNegative>,
    #[serde(default)]
    pub channel: BTreeMap<String, NonNegative>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MagnitudeKeys {
    pub zero_point: Option<String>,
}

#[derive(Debug, Default, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EffectKeys {
    pub solar_disc: Switch,
    pub inter_reflection: Switch,
    pub earthshine: Switch,
    pub moonshine: Switch,
    pub finite_distance: Switch,
}

impl From<EffectKeys> for Switches {
    fn from(keys: EffectKeys) -> Self {
        let EffectKeys { solar_disc, inter_reflection, earthshine, moonshine, finite_distance } =
            keys;
        let analyser = None;
        Self { solar_disc, inter_reflection, earthshine, moonshine, finite_distance, analyser }
    }
}
