//! Materials as people write them.
//!
//! ```toml
//! [[material]]
//! name = "panel"
//! model = "microfacet"               # lambert, microfacet, mirror, blend; phong, ward, abg, maxwell_beard, cook_torrance,
//!                                    # composite, foil, measured, brdf_table: their keys are in docs/materials.md
//! reflectance_file = "panel.csv"     # wavelength_nm,reflectance; or reflectance = 0.8, or
//!                                    # reflectance_table = { wavelength_nm = [300, 1200], reflectance = [0.2, 0.4] }
//! distribution = "ggx"               # beckmann, ggx
//! alpha = 0.2                        # or alpha_x, alpha_y along and across the tangent
//! masking = "separable"              # (default), height_correlated
//! fresnel = "schlick"                # constant (default), schlick, dielectric (with n = 1.5),
//!                                    # conductor (with refractive_index = "gold" or "file.csv")
//! ```

mod laws;

use super::{
    Ageing, ComplexIndex, Distribution, Fresnel, Lobe, Masking, Material, MaterialError, WardForm,
};
use serde::Deserialize;
use sha2::{Digest as _, Sha256};
use std::path::PathBuf;
use sunglint_formats::toml::{Document, Finite, Fraction, Positive};
use sunglint_formats::{FileError, ParseError, curve};
use sunglint_radiometry::spectrum::{Reflectance, Spectrum};

/// Keys of a file that describe a material.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MaterialFile {
    /// Name of the material.
    pub name: String,
    /// Model of the material.
    pub model: ModelName,
    /// One reflectance for all wavelengths; of a blend, its coat's.
    pub reflectance: Option<Fraction>,
    /// A file with `wavelength_nm,reflectance`.
    pub reflectance_file: Option<String>,
    /// Wavelengths and reflectances.
    pub reflectance_table: Option<ReflectanceTable>,
    /// How its microfacets are tilted.
    pub distribution: Option<Distribution>,
    /// Their roughness.
    pub alpha: Option<Finite>,
    /// Their roughness along the tangent.
    pub alpha_x: Option<Finite>,
    /// Their roughness across the tangent.
    pub alpha_y: Option<Finite>,
    /// How they hide one another.
    pub masking: Option<Masking>,
    /// Reflectance of each microfacet against the angle of incidence.
    pub fresnel: Option<FresnelName>,
    /// A material of the table of refractive indices, or a file with `wavelength_nm,n,k`.
    pub refractive_index: Option<String>,
    /// The refractive index of a dielectric Fresnel term.
    pub n: Option<Finite>,
    /// Base below the coat of a blend: a Lambert surface.
    pub base: Option<BaseFile>,
    /// A `.bsdf` file, or a table of a BRDF.
    pub file: Option<String>,
    /// The wavelength of a table that has one column of values, vacuum nm.
    pub wavelength_nm: Option<Finite>,
    /// The value up to which a table holds no measurements, sr⁻¹.
    pub floor_per_sr: Option<Finite>,
    /// Phong's n.
    pub exponent: Option<Finite>,
    /// The denominator of Ward's model.
    pub form: Option<WardForm>,
    /// A of the ABg model, sr⁻¹.
    pub a_per_sr: Option<Finite>,
    /// B of the ABg model.
    pub b: Option<Finite>,
    /// g of the ABg model.
    pub g: Option<Finite>,
    /// B of the Maxwell–Beard model, sr⁻¹.
    pub bias_per_sr: Option<Finite>,
    /// σ of the Maxwell–Beard model.
    pub sigma: Option<Finite>,
    /// τ of the Maxwell–Beard model, degrees.
    pub tau_deg: Option<Finite>,
    /// Ω of the Maxwell–Beard model, degrees.
    pub omega_deg: Option<Finite>,
    /// Light from the volume, Maxwell–Beard: π ρ_V.
    pub volume: Option<BaseFile>,
    /// Light that a Lambert surface adds.
    pub diffuse: Option<BaseFile>,
    /// The lobes of the Cook–Torrance model and of a composite.
    pub lobe: Option<Vec<LobeFile>>,
    /// The coherent mirror of a composite.
    pub mirror: Option<MirrorFile>,
    /// How well f is known, of a material that was fitted.
    pub doubt: Option<DoubtFile>,
    /// The root mean square slope of a foil's wrinkles along each axis.
    pub slope_rms: Option<Finite>,
    /// The same along the tangent.
    pub slope_rms_x: Option<Finite>,
    /// The same across it.
    pub slope_rms_y: Option<Finite>,
    /// Material that a foil is made of.
    pub of: Option<Box<Self>>,
    /// Time in space.
    pub ageing: Option<AgeingFile>,
    /// A remark.
    pub note: Option<String>,
}

/// The coherent mirror of a composite.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MirrorFile {
    /// Share of the surface.
    pub share: Fraction,
    /// g of exp(−(g cosθ)²); 0 where it is left out.
    pub g: Option<Finite>,
    /// The roughness of what waviness is left.
    pub alpha: Finite,
    /// The wavelength of g; g is the same at all wavelengths where it is left out.
    pub wavelength_nm: Option<Positive>,
}

/// Ageing by exponential laws of a dose.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AgeingFile {
    /// The dose, in a unit of whoever measured the scales: years, equivalent sun hours.
    pub dose: Finite,
    /// Vacuum wavelengths in nm, increasing; one alone where it is left out.
    pub wavelength_nm: Option<Vec<Finite>>,
    /// The share of the light that is left in the end, at each wavelength.
    pub left: Vec<Fraction>,
    /// The dose after which 1/e of the change is still to come, at each wavelength.
    pub scale: Vec<Positive>,
    /// The roughness in the end, of a material with one `alpha`.
    pub alpha: Option<Positive>,
    /// The dose after which 1/e of the change of the roughness is still to come.
    pub alpha_scale: Option<Positive>,
}

/// Half-widths of the 95 % intervals of ln f, by region.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DoubtFile {
    /// About the mirrored direction.
    pub peak_ln: Finite,
    /// Elsewhere.
    pub wings_ln: Finite,
    /// Where light or detector graze.
    pub grazing_ln: Finite,
    /// Further doubt where the colour was divided among the parts and the division is not determined: half of what both extremes are apart.
    pub colour_ln: Option<Finite>,
    /// Further doubts, in words.
    #[serde(default)]
    pub said: Vec<String>,
}

/// Kind of a lobe.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LobeName {
    /// Microfacets with Gaussian slopes.
    Beckmann,
    /// Microfacets with long tails.
    Ggx,
    /// The ABg model, of a composite.
    Abg,
}

/// A lobe of the Cook–Torrance model or of a composite.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LobeFile {
    /// Share of the microfacets.
    pub share: Option<Finite>,
    /// How they are tilted.
    pub distribution: LobeName,
    /// A of the ABg model, sr⁻¹.
    pub a_per_sr: Option<Finite>,
    /// B of the ABg model.
    pub b: Option<Finite>,
    /// g of the ABg model.
    pub g: Option<Finite>,
    /// Their roughness.
    pub alpha: Option<Finite>,
    /// Their roughness along the tangent.
    pub alpha_x: Option<Finite>,
    /// Their roughness across the tangent.
    pub alpha_y: Option<Finite>,
    /// How they hide one another.
    pub masking: Option<LobeMasking>,
}

/// How the microfacets of a Cook–Torrance lobe hide one another.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LobeMasking {
    /// Masking by V-shaped grooves (Cook and Torrance 1982).
    #[default]
    VCavity,
    /// Smith's, as if independent.
    Separable,
    /// Smith's, at heights in common.
    HeightCorrelated,
}

/// Model of a material.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ModelName {
    /// The same in all directions.
    Lambert,
    /// A rough surface of little mirrors.
    Microfacet,
    /// A perfect mirror.
    Mirror,
    /// A coat of microfacets over a Lambert surface.
    Blend,
    /// Phong's lobe, modified to be reciprocal and to conserve energy.
    Phong,
    /// Ward's lobe.
    Ward,
    /// A/(B + x^g).
    Abg,
    /// Maxwell and Beard's first surface, diffuse and volume.
    MaxwellBeard,
    /// Lobes of microfacets.
    CookTorrance,
    /// Lobes of any kind, a coherent mirror and diffuse light.
    Composite,
    /// A wrinkled foil of another material.
    Foil,
    /// A `.bsdf` file.
    Measured,
    /// A table of directions and values.
    BrdfTable,
}

impl ModelName {
    fn name(self) -> &'static str {
        match self {
            Self::Lambert => "lambert",
            Self::Microfacet => "microfacet",
            Self::Mirror => "mirror",
            Self::Blend => "blend",
            Self::Phong => "phong",
            Self::Ward => "ward",
            Self::Abg => "abg",
            Self::MaxwellBeard => "maxwell_beard",
            Self::CookTorrance => "cook_torrance",
            Self::Composite => "composite",
            Self::Foil => "foil",
            Self::Measured => "measured",
            Self::BrdfTable => "brdf_table",
        }
    }
}

/// How reflectance depends on the angle of incidence.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FresnelName {
    /// Not at all.
    #[default]
    Constant,
    /// By Schlick's approximation from that at normal incidence.
    Schlick,
    /// By Fresnel's equations from an n that is the same at all wavelengths.
    Dielectric,
    /// By Fresnel's equations from n + ik.
    Conductor,
}

/// A reflectance by wavelength.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReflectanceTable {
    /// Vacuum wavelengths in nm, increasing.
    pub wavelength_nm: Vec<Finite>,
    /// Reflectances, one for each wavelength, from 0 to 1.
    pub reflectance: Vec<Fraction>,
}

/// The Lambert surface below a coat, or light that is added to a lobe.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BaseFile {
    /// One reflectance for all wavelengths.
    pub reflectance: Option<Fraction>,
    /// A file with `wavelength_nm,reflectance`.
    pub reflectance_file: Option<String>,
    /// Wavelengths and reflectances.
    pub reflectance_table: Option<ReflectanceTable>,
    /// p of (cosθ_i cosθ_o)^p, of a composite's diffuse light.
    pub power: Option<Finite>,
}

/// The wavelengths over which a single number is taken as known, nm.
const RANGE_NM: (f64, f64) = (300.0, 1240.0);

/// The material that `file` describes, and the files that went into it with their SHA-256. `at` is the dotted key of its table in the
/// document (`material[2]`; empty where the document is one material), for errors; files are looked for beside the document.
///
/// # Errors
/// A key that the model has no use for or that it lacks, a value that makes no sense, a file that cannot be read: with path, line and
/// field.
pub fn material(
    document: &Document,
    at: &str,
    file: &MaterialFile,
) -> Result<(Material, Vec<(PathBuf, String)>), FileError> {
    let mut reader = Reader { document, at, sources: Vec::new() };
    let mut material = match &file.ageing {
        Some(ageing) => reader.aged(file, ageing)?,
        None => reader.material(file)?,
    };
    if file.of.as_ref().is_some_and(|of| of.ageing.is_some()) {
        let expected = "ageing in the table of the foil, not of what it is made of";
        return Err(reader.error("of.ageing", expected).into());
    }
    if let Some(doubt) = &file.doubt {
        material.doubt(doubt);
    }
    Ok((material, reader.sources))
}

struct Reader<'a> {
    document: &'a Document,
    at: &'a str,
    sources: Vec<(PathBuf, String)>,
}

/// Where a reflectance may stand.
struct ReflectanceKeys<'a> {
    /// Prefix of the keys.
    prefix: &'static str,
    number: Option<Fraction>,
    file: Option<&'a str>,
    table: Option<&'a ReflectanceTable>,
}

impl Reader<'_> {
    /// The material after its time in space.
    fn aged(&mut self, file: &MaterialFile, keys: &AgeingFile) -> Result<Material, FileError> {
        let nm = keys.wavelength_nm.iter().flatten().map(|v| v.get());
        let nm: Vec<f64> = match &keys.wavelength_nm {
            Some(_) => nm.collect(),
            None => vec![0.5 * (RANGE_NM.0 + RANGE_NM.1)],
        };
        for (key, count) in [("ageing.left", keys.left.len()), ("ageing.scale", keys.scale.len())] {
            if count != nm.len() {
                let expected =
                    format!("{} numbers, one for each of ageing.wavelength_nm", nm.len());
                return Err(self.error(key, expected).into());
            }
        }
        let left = keys.left.iter().map(|v| v.get()).collect();
        let scale = keys.scale.iter().map(|v| v.get()).collect();
        let ageing = Ageing::new(keys.dose.get(), nm, left, scale)
            .map_err(|error| self.wrong("ageing", &error))?;
        // What is wrong with the material as it was made is said of it, not of what has become of it.
        let new = self.material(file)?;
        if keys.dose.get() == 0.0 {
            return Ok(new);
        }
        let mut file = file.clone();
        match (file.alpha, keys.alpha, keys.alpha_scale) {
            (_, None, None) => {}
            (Some(alpha), Some(end), Some(scale)) => {
                let alpha = ageing.roughness(alpha.get(), end.get(), scale.get());
                file.alpha = Finite::new(alpha);
            }
            (None, ..) => {
                let expected = "no roughness in the end: the material has no alpha of its own";
                let key = if keys.alpha.is_some() { "ageing.alpha" } else { "ageing.alpha_scale" };
                return Err(self.error(key, expected).into());
            }
            (_, Some(_), None) => {
                return Err(self.error("ageing.alpha_scale", "also alpha_scale").into());
            }
            (_, None, Some(_)) => return Err(self.error("ageing.alpha", "also alpha").into()),
        }
        let new = self.material(&file)?;
        new.aged(&ageing).map_err(|error| self.wrong("ageing", &error).into())
    }

    fn material(&mut self, file: &MaterialFile) -> Result<Material, FileError> {
        self.check_keys(file)?;
        Ok(match file.model {
            ModelName::Lambert => Material::lambert(&file.name, self.reflectance(&coat(file))?)
                .map_err(|e| self.wrong("reflectance", &e))?,
            ModelName::Mirror => Material::mirror(&file.name, self.fresnel(file)?),
            ModelName::Microfacet => {
                Material::microfacet(&file.name, self.lobe(file)?, self.fresnel(file)?)
            }
            ModelName::Blend => {
                let Some(base) = &file.base else {
                    let expected = "also base = { reflectance = … }: what is below the coat";
                    return Err(self.error("base", expected).into());
                };
                let keys = base.keys("base.");
                let (below, lobe) = (self.reflectance(&keys)?, self.lobe(file)?);
                if !lobe.is_isotropic() {
                    let expected = "one alpha: the coat of a blend has no tangent";
                    return Err(self.error("alpha_x", expected).into());
                }
                let fresnel = self.fresnel(file)?;
                Material::blend(&file.name, below, lobe, fresnel)
                    .map_err(|e| self.wrong("base", &e))?
            }
            _ => return self.law(file),
        })
    }

    fn key(&self, key: &str) -> String {
        if self.at.is_empty() { key.to_owned() } else { format!("{}.{key}", self.at) }
    }

    fn error(&self, key: &str, expected: impl Into<String>) -> ParseError {
        self.document.error_at(&self.key(key), expected)
    }

    /// Refuses what the model has no use for: whoever wrote it meant something.
    fn check_keys(&self, file: &MaterialFile) -> Result<(), ParseError> {
        if file.name.trim().is_empty() {
            return Err(self.error("name", "a name"));
        }
        self.check_use(file)?;
        let conductor = file.fresnel == Some(FresnelName::Conductor);
        if file.model == ModelName::MaxwellBeard {
            return Ok(());
        }
        if file.refractive_index.is_some() && !conductor {
            let expected = "fresnel = \"conductor\" where a refractive index is given";
            return Err(self.error("refractive_index", expected));
        }
        let reflectances = [
            ("reflectance", file.reflectance.is_some()),
            ("reflectance_file", file.reflectance_file.is_some()),
            ("reflectance_table", file.reflectance_table.is_some()),
        ];
        let dielectric = file.fresnel == Some(FresnelName::Dielectric);
        if file.n.is_some() != dielectric {
            let expected = "n and fresnel = \"dielectric\" together";
            let key = if dielectric { "fresnel" } else { "n" };
            return Err(self.error(key, expected));
        }
        if let (true, Some((key, _))) = (dielectric, reflectances.iter().find(|(_, given)| *given))
        {
            let expected = format!("no `{key}` with fresnel = \"dielectric\": it follows from n");
            return Err(self.error(key, expected));
        }
        if let (true, Some((key, _))) = (conductor, reflectances.iter().find(|(_, given)| *given)) {
            let expected =
                format!("no `{key}` with fresnel = \"conductor\": it follows from n + ik");
            return Err(self.error(key, expected));
        }
        Ok(())
    }

    fn lobe(&self, file: &MaterialFile) -> Result<Lobe, ParseError> {
        let Some(distribution) = file.distribution else {
            return Err(self.error("distribution", "\"beckmann\" or \"ggx\""));
        };
        let (alpha_x, alpha_y) = match (file.alpha, file.alpha_x, file.alpha_y) {
            (Some(alpha), None, None) => (("alpha", alpha.get()), ("alpha", alpha.get())),
            (None, Some(x), Some(y)) => (("alpha_x", x.get()), ("alpha_y", y.get())),
            (Some(_), Some(_), _) | (Some(_), _, Some(_)) => {
                return Err(self.error("alpha", "either alpha, or alpha_x and alpha_y"));
            }
            (None, Some(_), None) => return Err(self.error("alpha_y", "also alpha_y")),
            (None, None, Some(_)) => return Err(self.error("alpha_x", "also alpha_x")),
            (None, None, None) => {
                return Err(self.error("alpha", "a roughness alpha, or alpha_x and alpha_y"));
            }
        };
        for (key, alpha) in [alpha_x, alpha_y] {
            if alpha == 0.0 {
                let hint = "a surface without roughness is model = \"mirror\"";
                return Err(self.error(key, "a roughness from 1e-5 to 2").with_hint(hint));
            }
            if Lobe::isotropic(distribution, alpha, Masking::Separable).is_err() {
                return Err(self.error(key, "a roughness from 1e-5 to 2"));
            }
        }
        let masking = file.masking.unwrap_or_default();
        Lobe::anisotropic(distribution, alpha_x.1, alpha_y.1, masking)
            .map_err(|e| self.error("alpha", "a roughness").with_hint(e.to_string()))
    }

    fn fresnel(&mut self, file: &MaterialFile) -> Result<Fresnel, FileError> {
        let made = match file.fresnel.unwrap_or_default() {
            FresnelName::Constant => Fresnel::constant(self.reflectance(&coat(file))?),
            FresnelName::Schlick => Fresnel::schlick(self.reflectance(&coat(file))?),
            FresnelName::Dielectric => {
                let n = file.n.map_or(f64::NAN, Finite::get);
                let made = Fresnel::dielectric(n, RANGE_NM.0, RANGE_NM.1);
                return made.map_err(|e| self.wrong("n", &e).into());
            }
            FresnelName::Conductor => {
                let Some(name) = &file.refractive_index else {
                    let expected = "also refractive_index: a material's name or a file";
                    return Err(self.error("refractive_index", expected).into());
                };
                let made = Fresnel::conductor(&self.index(name)?);
                return made.map_err(|e| self.wrong("refractive_index", &e).into());
            }
        };
        made.map_err(|e| self.wrong("reflectance", &e).into())
    }

    fn wrong(&self, key: &str, error: &MaterialError) -> ParseError {
        self.error(key, "a material that can be").with_hint(error.to_string())
    }

    /// A refractive index from radiometry's table, or from a file: what has an ending is a file.
    fn index(&mut self, name: &str) -> Result<ComplexIndex, FileError> {
        if !name.contains(['.', '/', '\\']) {
            return ComplexIndex::named(name).map_err(|error| {
                let expected = "a material of the table of refractive indices, or a file";
                self.error("refractive_index", expected).with_hint(error.to_string()).into()
            });
        }
        let (path, text) = self.read("refractive_index", name)?;
        let n = curve::read_str(&path, &text, Some("n"))?;
        let k = curve::read_str(&path, &text, Some("k"))?;
        self.check_wavelengths(&path, &n)?;
        let row = (n.y.iter().position(|n| *n <= 0.0).map(|row| (row, "n", n.y[row])))
            .or_else(|| k.y.iter().position(|k| *k < 0.0).map(|row| (row, "k", k.y[row])));
        if let Some((row, column, value)) = row {
            let expected =
                if column == "n" { "a number above 0" } else { "a number of 0 or above" };
            let error = ParseError::new(&path, value.to_string(), expected);
            return Err(error.at_line(n.line(row)).in_field(column).into());
        }
        ComplexIndex::new(name, n.x, n.y, k.y)
            .map_err(|e| ParseError::new(&path, e.to_string(), "a refractive index").into())
    }

    fn reflectance(&mut self, keys: &ReflectanceKeys) -> Result<Spectrum<Reflectance>, FileError> {
        let key = |name: &str| format!("{}{name}", keys.prefix);
        match (keys.number, keys.file, keys.table) {
            (Some(value), None, None) => {
                let flat = Spectrum::constant(value.get(), RANGE_NM.0, RANGE_NM.1);
                flat.map_err(|e| self.wrong(&key("reflectance"), &e.into()).into())
            }
            (None, Some(name), None) => self.reflectance_file(&key("reflectance_file"), name),
            (None, None, Some(table)) => {
                let nm = table.wavelength_nm.iter().map(|v| v.get()).collect();
                let value = table.reflectance.iter().map(|v| v.get()).collect();
                Spectrum::new(nm, value)
                    .map_err(|e| self.wrong(&key("reflectance_table"), &e.into()).into())
            }
            (None, None, None) => {
                let expected = "a reflectance: a number, reflectance_file or reflectance_table";
                Err(self.error(&key("reflectance"), expected).into())
            }
            _ => {
                let given = if keys.number.is_some() { "reflectance" } else { "reflectance_file" };
                let expected = "only one of reflectance, reflectance_file and reflectance_table";
                Err(self.error(&key(given), expected).into())
            }
        }
    }

    fn reflectance_file(
        &mut self,
        key: &str,
        name: &str,
    ) -> Result<Spectrum<Reflectance>, FileError> {
        let (path, text) = self.read(key, name)?;
        let curve = curve::read_str(&path, &text, Some("reflectance"))?;
        self.check_wavelengths(&path, &curve)?;
        if let Some(row) = curve.y.iter().position(|y| !(0.0..=1.0).contains(y)) {
            let error = ParseError::new(&path, curve.y[row].to_string(), "a fraction from 0 to 1");
            let error = error.at_line(curve.line(row)).in_field("reflectance");
            return Err(error.with_hint("a column in percent is named reflectance_percent").into());
        }
        Spectrum::new(curve.x, curve.y)
            .map_err(|e| ParseError::new(&path, e.to_string(), "a reflectance").into())
    }

    fn check_wavelengths(
        &self,
        path: &std::path::Path,
        curve: &curve::Curve,
    ) -> Result<(), ParseError> {
        let field = &curve.x_name;
        if field != "wavelength_nm" {
            let error = ParseError::new(path, format!("`{field}`"), "`wavelength_nm`");
            return Err(error.in_field(field));
        }
        if curve.x[0] <= 0.0 {
            let error = ParseError::new(path, curve.x[0].to_string(), "a wavelength above 0 nm");
            return Err(error.at_line(curve.line(0)).in_field(field));
        }
        Ok(())
    }

    /// The text of a file that a key names.
    fn read(&mut self, key: &str, name: &str) -> Result<(PathBuf, String), FileError> {
        let (path, bytes) = self.bytes(key, name)?;
        let text = sunglint_formats::read::decode(&path, bytes)?;
        Ok((path, text))
    }

    fn bytes(&mut self, key: &str, name: &str) -> Result<(PathBuf, Vec<u8>), FileError> {
        let path = self.document.resolve(name);
        let bytes = sunglint_formats::read::bytes(&path).map_err(|error| match error {
            FileError::Io { path, source, .. } => {
                let hint = format!("{}: {source}", path.display());
                self.error(key, "a file that can be read").with_hint(hint).into()
            }
            error => error,
        })?;
        if !self.sources.iter().any(|(known, _)| *known == path) {
            let hash = Sha256::digest(&bytes);
            let hash = hash.iter().map(|byte| format!("{byte:02x}")).collect();
            self.sources.push((path.clone(), hash));
        }
        Ok((path, bytes))
    }
}

impl BaseFile {
    fn keys(&self, prefix: &'static str) -> ReflectanceKeys<'_> {
        ReflectanceKeys {
            prefix,
            number: self.reflectance,
            file: self.reflectance_file.as_deref(),
            table: self.reflectance_table.as_ref(),
        }
    }
}

fn coat(file: &MaterialFile) -> ReflectanceKeys<'_> {
    ReflectanceKeys {
        prefix: "",
        number: file.reflectance,
        file: file.reflectance_file.as_deref(),
        table: file.reflectance_table.as_ref(),
    }
}
