//! Surfaces of several parts: which parts there are, their numbers, and what an instrument sees of them.

use glam::DVec3;
use serde::Serialize;
use std::cell::RefCell;
use std::f64::consts::{FRAC_1_PI, PI, TAU};
use std::sync::OnceLock;
use sunglint_formats::toml::quoted;
use sunglint_numerics::gauss::legendre;
use sunglint_radiometry::spectrum::{Reflectance, Spectrum};
use sunglint_simulator::surface::{
    CompositeLobe, Diffuse, Distribution, Fresnel, Lobe, Masking, Material, MaterialError,
    MirrorTerm, Shape, conductor,
};

/// A lobe's kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Kind {
    /// Microfacets with GGX slopes, separable masking.
    Ggx,
    /// Microfacets with Gaussian slopes, separable masking.
    Beckmann,
    /// A/(B + x^g).
    Abg,
}

/// The reflectance by angle on what mirrors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Rise {
    /// The same at all angles.
    Constant,
    /// Schlick's approximation.
    Schlick,
    /// Fresnel's equations of a dielectric.
    Dielectric,
    /// The same, measured with light that was partly polarised in the plane of incidence or across it, as a laser's is. Out of that plane facets have planes of incidence of their own, so
    /// that the lobe is another than in light without polarisation; the material is the one in such light.
    Polarised,
}

/// Diffuse light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Floor {
    /// None.
    None,
    /// Lambert's.
    Lambert,
    /// (cosθ_i cosθ_o)^p.
    Falling,
}

/// The parts of a surface.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Recipe {
    /// Lobes of the surface, up to three.
    pub lobes: Vec<Kind>,
    /// Whether it mirrors coherently.
    pub mirror: bool,
    /// The Fresnel term of lobes and mirror.
    pub rise: Rise,
    /// Diffuse light of the surface.
    pub floor: Floor,
}

/// A number of a recipe.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Range {
    pub key: &'static str,
    /// The lobe that it belongs to, counted from 1; 0 of the others.
    pub lobe: usize,
    pub least: f64,
    pub most: f64,
}

/// The instrument, as far as it blurs.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Cone {
    /// Half-angle of what the detector takes in, degrees.
    pub detector_deg: f64,
    /// Half-angle of the source as the sample sees it, degrees.
    pub source_deg: f64,
}

impl Cone {
    /// The half-angle of a disc that blurs as both do, radians.
    pub fn radius_rad(&self) -> f64 {
        self.detector_deg.hypot(self.source_deg).to_radians()
    }
}

impl Recipe {
    /// Returns the name of the recipe: `ggx²+lambert+mirror, schlick`.
    pub fn name(&self) -> String {
        let mut parts: Vec<String> = Vec::new();
        for kind in [Kind::Beckmann, Kind::Ggx, Kind::Abg] {
            let count = self.lobes.iter().filter(|l| **l == kind).count();
            let name = match kind {
                Kind::Ggx => "ggx",
                Kind::Beckmann => "beckmann",
                Kind::Abg => "abg",
            };
            match count {
                0 => {}
                1 => parts.push(name.into()),
                n => parts.push(format!("{name}×{n}")),
            }
        }
        match self.floor {
            Floor::None => {}
            Floor::Lambert => parts.push("lambert".into()),
            Floor::Falling => parts.push("falling".into()),
        }
        if self.mirror {
            parts.push("mirror".into());
        }
        let rise = match self.rise {
            Rise::Constant => "",
            Rise::Schlick => ", schlick",
            Rise::Dielectric => ", dielectric",
            Rise::Polarised => ", dielectric in polarised light",
        };
        format!("{}{rise}", parts.join("+"))
    }

    /// Whether this is `whole` without one part: the number of the lobe that it lacks, from 1, or 0 for another part.
    pub(super) fn without(&self, whole: &Self) -> Option<usize> {
        let alike = self.mirror == whole.mirror && self.rise == whole.rise;
        if self.lobes == whole.lobes {
            let floors = (self.floor, whole.floor);
            let floor = self.mirror == whole.mirror
                && matches!(
                    floors,
                    (Floor::None, Floor::Lambert | Floor::Falling)
                        | (Floor::Lambert, Floor::Falling)
                );
            let mirror = !self.mirror && whole.mirror && self.floor == whole.floor;
            return (self.rise == whole.rise && (floor || mirror)).then_some(0);
        }
        let lacks = (0..whole.lobes.len()).find(|k| {
            let others = whole.lobes.iter().enumerate().filter(|(n, _)| n != k).map(|(_, l)| *l);
            others.eq(self.lobes.iter().copied())
        });
        lacks.filter(|_| alike && self.floor == whole.floor).map(|k| k + 1)
    }

    pub(super) fn ranges(&self) -> Vec<Range> {
        let mut all = Vec::new();
        let mut put = |key, lobe, least, most| all.push(Range { key, lobe, least, most });
        match self.rise {
            Rise::Constant => {}
            Rise::Schlick => put("reflectance", 0, 1e-3, 1.0),
            Rise::Dielectric => put("n", 0, 1.05, 8.0),
            Rise::Polarised => {
                put("n", 0, 1.05, 8.0);
                put("in_plane_share", 0, 0.01, 1.0);
            }
        }
        for (k, kind) in self.lobes.iter().enumerate() {
            let lobe = k + 1;
            put("share", lobe, 1e-7, 3.0);
            match kind {
                Kind::Abg => {
                    put("b", lobe, 1e-9, 3.0);
                    put("g", lobe, 0.5, 6.0);
                }
                _ => put("alpha", lobe, 1e-3, 1.5),
            }
        }
        if self.mirror {
            put("mirror_share", 0, 1e-7, 1.0);
            put("mirror_g", 0, 0.02, 6.0);
            put("mirror_alpha", 0, 4e-4, 1.3e-2);
        }
        match self.floor {
            Floor::None => {}
            Floor::Lambert => put("diffuse", 0, 1e-7, 1.0),
            Floor::Falling => {
                put("diffuse", 0, 1e-7, 1.0);
                put("diffuse_power", 0, 0.02, 3.0);
            }
        }
        all
    }

    /// The surface with these numbers.
    pub(super) fn with(&self, p: &[f64]) -> Surface {
        let mut p = p.iter().copied();
        let mut next = || p.next().unwrap_or(f64::NAN);
        let rise = match self.rise {
            Rise::Constant => Term::Constant,
            Rise::Schlick => Term::Schlick(next()),
            Rise::Dielectric | Rise::Polarised => Term::Dielectric(next()),
        };
        let across = if self.rise == Rise::Polarised { 1.0 - 2.0 * next() } else { 0.0 };
        let mut lobes = Vec::with_capacity(self.lobes.len());
        for kind in &self.lobes {
            let share = next();
            let facets = |distribution, alpha: f64| {
                let alpha = alpha.clamp(1e-5, 2.0);
                Lobe::isotropic(distribution, alpha, Masking::Separable).map(Shape::Facets)
            };
            let (shape, scale, width) = match kind {
                Kind::Abg => {
                    let (b, g) = (next(), next());
                    let shape = Shape::Abg { a_per_sr: 1.0, b, g };
                    (Ok(shape), share / abg_at_normal(b, g), b.powf(1.0 / g))
                }
                Kind::Ggx | Kind::Beckmann => {
                    let alpha = next();
                    let distribution = match kind {
                        Kind::Ggx => Distribution::Ggx,
                        _ => Distribution::Beckmann,
                    };
                    (facets(distribution, alpha), share, 2.0 * alpha)
                }
            };
            // Within the ranges every roughness is one.
            if let Ok(shape) = shape {
                lobes.push(Part { shape, share, scale, width });
            }
        }
        let mirror = self.mirror.then(|| Mirror { share: next(), g: next(), alpha: next() });
        let (diffuse, power) = match self.floor {
            Floor::None => (0.0, 0.0),
            Floor::Lambert => (next(), 0.0),
            Floor::Falling => (next(), next()),
        };
        Surface { rise, across, lobes, mirror, diffuse, power }
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Term {
    Constant,
    Schlick(f64),
    Dielectric(f64),
}

impl Term {
    fn at(self, cos: f64) -> f64 {
        match self {
            Self::Constant => 1.0,
            Self::Schlick(f0) => f0 + (1.0 - f0) * (1.0 - cos.clamp(0.0, 1.0)).powi(5),
            Self::Dielectric(n) => conductor::fresnel(n, 0.0, cos),
        }
    }
}

/// A Fresnel term in the light of the measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Seen {
    rise: Term,
    across: f64,
}

impl Seen {
    /// The reflectance of the facets that send light from `i` to `o`.
    pub fn at(&self, i: DVec3, o: DVec3) -> f64 {
        let bisector = i + o;
        let cos = 0.5 * bisector.length();
        let plain = self.rise.at(cos);
        let Term::Dielectric(n) = self.rise else { return plain };
        let (own, whole) = (i.cross(bisector), DVec3::Z.cross(i));
        let (a, b) = (own.length_squared(), whole.length_squared());
        if self.across == 0.0 || a < 1e-18 || b < 1e-18 {
            return plain;
        }
        // The angle between the facet's plane of incidence and the surface's: cos 2ψ (Malus).
        let twice = 2.0 * own.dot(whole).powi(2) / (a * b) - 1.0;
        plain + self.across * twice * conductor::difference(n, 0.0, cos)
    }
}

#[derive(Debug, Clone, Copy)]
struct Part {
    shape: Shape,
    share: f64,
    /// Before the shape.
    scale: f64,
    /// Half-width about the mirrored direction, in direction cosines.
    width: f64,
}

#[derive(Debug, Clone, Copy)]
struct Mirror {
    share: f64,
    g: f64,
    alpha: f64,
}

/// A surface with numbers.
#[derive(Debug, Clone)]
pub struct Surface {
    rise: Term,
    /// Polarisation of the measurement's light: the share that is polarised across the plane of incidence less that in it.
    across: f64,
    lobes: Vec<Part>,
    mirror: Option<Mirror>,
    diffuse: f64,
    power: f64,
}

/// Integrals that were taken last: a fit changes one number at a time, on which most of the lobes do not depend.
#[derive(Debug, Default)]
struct Known {
    values: Vec<(f64, Shape, Term, f64)>,
    next: usize,
}

/// Number of integrals that are kept: those of some twenty steps of three lobes at six incidences.
const KEPT: usize = 256;

thread_local! {
    static KNOWN: RefCell<Known> = RefCell::default();
}

impl Known {
    /// ∫ f cosθ_o dω_o of a lobe before which 1 stands.
    fn albedo(&mut self, lobe: &Part, rise: Term, cos: f64) -> f64 {
        let same = |k: &&(f64, Shape, Term, f64)| k.0 == cos && k.1 == lobe.shape && k.2 == rise;
        if let Some(found) = self.values.iter().find(same) {
            return found.3;
        }
        let value = lobe.albedo(rise, cos);
        let new = (cos, lobe.shape, rise, value);
        match self.values.get_mut(self.next) {
            Some(old) => *old = new,
            None => self.values.push(new),
        }
        self.next = (self.next + 1) % KEPT;
        value
    }
}

impl Part {
    /// ∫ f cosθ_o dω_o before which 1 stands, in rings about the mirrored direction.
    fn albedo(&self, rise: Term, cos: f64) -> f64 {
        static RULE: OnceLock<[Vec<(f64, f64)>; 2]> = OnceLock::new();
        let [radial, around] = RULE.get_or_init(|| [legendre(14), legendre(6)]);
        let sin = (1.0 - cos * cos).max(0.0).sqrt();
        let i = DVec3::new(sin, 0.0, cos);
        let knee = self.width.clamp(1e-4, 1.0);
        let mut sum = 0.0;
        for (phi, w) in around {
            let (y, x) = (0.5 * PI * (phi + 1.0)).sin_cos();
            // To the rim of the disc.
            let rim = sin * x + (sin * sin * x * x + cos * cos).sqrt();
            let end = (rim / knee).asinh();
            for (t, v) in radial {
                // The hyperbolic sine and cosine of where the node is.
                let grown = (0.5 * end * (t + 1.0)).exp();
                let (sinh, cosh) = (0.5 * (grown - grown.recip()), 0.5 * (grown + grown.recip()));
                let r = knee * sinh;
                let (ox, oy) = (-sin + r * x, r * y);
                let z2 = 1.0 - ox * ox - oy * oy;
                if z2 > 0.0 {
                    let o = DVec3::new(ox, oy, z2.sqrt());
                    let f = self.shape.value(i, o) * rise.at(0.5 * (i + o).length());
                    sum += PI * w * 0.5 * end * v * knee * cosh * r * f;
                }
            }
        }
        sum
    }
}

/// Beyond so many widths nothing of a mirror is left.
const MIRROR_REACH: f64 = 6.0;

impl Surface {
    /// Returns f as an instrument sees it, with light from `i`, at `o` \[sr⁻¹\]: the mean of f cosθ over its disc, over cosθ_o. `disc` holds the disc's directions with weights, of
    /// which the lobes are the mean; the mirror, which may be narrower than their distances, is blurred in closed form.
    pub(super) fn seen(&self, i: DVec3, o: DVec3, disc: &[(DVec3, f64)], blur2: f64) -> f64 {
        let mut sum = self.others(i, o, blur2);
        if disc.is_empty() {
            sum += self.lobes_at(i, o);
        } else {
            let seen: f64 = disc.iter().map(|(d, w)| w * d.z * self.lobes_at(i, *d)).sum();
            sum += seen / o.z;
        }
        sum
    }

    fn lobes_at(&self, i: DVec3, o: DVec3) -> f64 {
        if self.lobes.is_empty() {
            return 0.0;
        }
        let value: f64 = self.lobes.iter().map(|l| l.scale * l.shape.value(i, o)).sum();
        value * self.fresnel().at(i, o)
    }

    /// The lobes' shapes and what stands before each.
    pub(super) fn shapes(&self) -> impl Iterator<Item = (Shape, f64)> + '_ {
        self.lobes.iter().map(|l| (l.shape, l.scale))
    }

    /// The Fresnel term in the light of the measurement.
    pub(super) fn fresnel(&self) -> Seen {
        Seen { rise: self.rise, across: self.across }
    }

    /// The diffuse light and the mirror, without the lobes.
    pub(super) fn others(&self, i: DVec3, o: DVec3, blur2: f64) -> f64 {
        self.mirrored(i, o, blur2) + self.broad(i.z, o.z)
    }

    pub(super) fn broad(&self, i: f64, o: f64) -> f64 {
        if self.power == 0.0 {
            self.diffuse * FRAC_1_PI
        } else {
            self.diffuse * 0.5 * (self.power + 2.0) * FRAC_1_PI * (i * o).powf(self.power)
        }
    }

    /// The lobe of narrow Beckmann microfacets of half-width 2α in the plane of incidence and 2α cosθ_i across, blurred by a Gaussian of the same second moment as the disc.
    pub(super) fn mirrored(&self, i: DVec3, o: DVec3, blur2: f64) -> f64 {
        let Some(Mirror { share, g, alpha }) = self.mirror else { return 0.0 };
        let mirrored = DVec3::new(-i.x, -i.y, i.z);
        let away = o - mirrored;
        let w2 = 4.0 * alpha * alpha;
        if away.length_squared() > MIRROR_REACH * MIRROR_REACH * (w2 + blur2) {
            return 0.0;
        }
        let flat = DVec3::new(-i.x, -i.y, 0.0).normalize_or(DVec3::X);
        let along = flat * i.z - DVec3::Z * (1.0 - i.z * i.z).max(0.0).sqrt();
        let across = DVec3::new(-flat.y, flat.x, 0.0);
        let (u2, v2) = (w2 + blur2, w2 * i.z * i.z + blur2);
        let (u, v) = (away.dot(along), away.dot(across));
        let bell = (-u * u / u2 - v * v / v2).exp() / (PI * (u2 * v2).sqrt());
        let mirrors = self.fresnel().at(i, mirrored);
        share * mirrors * (-(g * i.z).powi(2)).exp() * bell / o.z
    }

    /// The half-width of the narrowest part about the mirrored direction, in direction cosines.
    pub(super) fn narrowest(&self) -> Option<f64> {
        let mirror = self.mirror.map(|m| 2.0 * m.alpha);
        self.lobes.iter().map(|l| l.width).chain(mirror).min_by(f64::total_cmp)
    }

    /// A bound of what it reflects that needs no integral.
    fn bound(&self) -> f64 {
        self.lobes.iter().map(|l| l.share).sum::<f64>()
            + self.mirror.map_or(0.0, |m| m.share)
            + self.diffuse
    }

    /// Whether it may reflect about as much as came: the bound does not exclude it.
    pub(super) fn is_bright(&self) -> bool {
        self.bound() > 0.999
    }

    /// The directional–hemispherical reflectance at some angles, to about 1 %; none where a bound says that it is below 1.
    pub(super) fn albedos(&self, cosines: &[f64]) -> Option<Vec<f64>> {
        if !self.is_bright() {
            return None;
        }
        Some(cosines.iter().map(|cos| self.albedo(*cos)).collect())
    }

    /// ∫ f cosθ_o dω_o.
    fn albedo(&self, cos: f64) -> f64 {
        let mut sum = self.diffuse * cos.powf(self.power);
        if let Some(m) = self.mirror {
            sum += m.share * self.rise.at(cos) * (-(m.g * cos).powi(2)).exp();
        }
        for lobe in &self.lobes {
            sum += lobe.scale * KNOWN.with_borrow_mut(|known| known.albedo(lobe, self.rise, cos));
        }
        sum
    }

    /// The material, of one reflectance for all wavelengths.
    ///
    /// # Errors
    /// More light than came up to 60° of incidence.
    pub fn material(&self, name: &str) -> Result<Material, MaterialError> {
        self.tinted(name, &Tint::grey())
    }

    /// The material with a colour for its parts.
    pub(super) fn tinted(&self, name: &str, tint: &Tint) -> Result<Material, MaterialError> {
        let spectrum = |value: &[f64]| {
            Ok::<_, MaterialError>(Spectrum::<Reflectance>::new(
                tint.wavelength_nm.clone(),
                value.to_vec(),
            )?)
        };
        let (scale, specular) = self.specular(tint);
        let (from_nm, to_nm) = tint.range_nm();
        let fresnel = match &specular {
            Specular::Constant(value) => Fresnel::constant(spectrum(value)?)?,
            Specular::Schlick(value) => Fresnel::schlick(spectrum(value)?)?,
            Specular::Dielectric(n) => Fresnel::dielectric(*n, from_nm, to_nm)?,
        };
        let lobes: Vec<CompositeLobe> = self
            .lobes
            .iter()
            .map(|l| match l.shape {
                Shape::Facets(lobe) => CompositeLobe::Facets { lobe, share: scale * l.share },
                Shape::Abg { b, g, .. } => CompositeLobe::Abg { a_per_sr: scale * l.scale, b, g },
                // No other shape is a part.
                _ => CompositeLobe::Abg { a_per_sr: 0.0, b: 1.0, g: 2.0 },
            })
            .collect();
        let mirror = self.mirror.map(|m| MirrorTerm {
            share: scale * m.share,
            g: m.g,
            alpha: m.alpha,
            wavelength_nm: tint.at_nm,
        });
        let diffuse = (self.diffuse > 0.0)
            .then(|| {
                let reflectance = spectrum(&self.diffuse_of(tint))?;
                Ok::<_, MaterialError>(Diffuse { reflectance, power: self.power })
            })
            .transpose()?;
        Material::composite(name, &lobes, mirror, &fresnel, diffuse)
    }

    /// The Fresnel term with a colour, and the factor of all shares that leaves its numbers at most 1.
    fn specular(&self, tint: &Tint) -> (f64, Specular) {
        let coloured = |normal: f64| {
            Specular::Schlick(tint.specular.iter().map(|s| (normal * s).min(1.0)).collect())
        };
        match self.rise {
            Term::Constant => {
                let most = tint.specular.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
                (most, Specular::Constant(tint.specular.iter().map(|s| s / most).collect()))
            }
            Term::Schlick(f0) => (1.0, coloured(f0)),
            Term::Dielectric(n) if tint.is_neutral() => (1.0, Specular::Dielectric(n)),
            // A dielectric of one n has no colour.
            Term::Dielectric(n) => (1.0, coloured(conductor::fresnel(n, 0.0, 1.0))),
        }
    }

    fn diffuse_of(&self, tint: &Tint) -> Vec<f64> {
        tint.diffuse.iter().map(|d| (d * self.diffuse).clamp(0.0, 1.0)).collect()
    }

    /// F at normal incidence times what lobes and mirror reflect of it.
    pub(super) fn at_normal(&self) -> f64 {
        let shares: f64 =
            self.lobes.iter().map(|l| l.share).sum::<f64>() + self.mirror.map_or(0.0, |m| m.share);
        shares * self.rise.at(1.0)
    }

    /// Whether F follows from an index alone.
    pub(super) fn index(&self) -> Option<f64> {
        match self.rise {
            Term::Dielectric(n) => Some(n),
            _ => None,
        }
    }

    /// The surface with light of another wavelength, of which g of its mirror is that many times as large.
    pub(super) fn with_coherence(&self, times: f64) -> Self {
        let mirror = self.mirror.map(|m| Mirror { g: m.g * times, ..m });
        Self { mirror, ..self.clone() }
    }

    /// Returns the parts of lobes and mirror, and of diffuse light, in f seen in a direction.
    pub(super) fn parts_at(&self, i: DVec3, o: DVec3, cone: &Cone) -> (f64, f64) {
        let radius = cone.radius_rad();
        let broad = self.broad(i.z, o.z);
        let whole = Self { across: 0.0, ..self.clone() }.seen(
            i,
            o,
            &disc(o, radius),
            0.5 * radius * radius,
        );
        ((whole - broad).max(0.0), broad)
    }

    /// The same of the directional–hemispherical reflectance.
    pub(super) fn parts_of_albedo(&self, cos: f64) -> (f64, f64) {
        let diffuse = self.diffuse * cos.powf(self.power);
        ((self.albedo(cos) - diffuse).max(0.0), diffuse)
    }

    /// The same as `[[material]]` of a scene.
    pub(super) fn toml(&self, name: &str, tint: &Tint) -> String {
        use std::fmt::Write as _;
        let table = |value: &[f64]| {
            if let ([first, ..], true) = (value, tint.is_grey()) {
                return format!("reflectance = {first:?}");
            }
            format!(
                "reflectance_table = {{ wavelength_nm = {:?}, reflectance = {value:?} }}",
                tint.wavelength_nm
            )
        };
        let mut text = format!("[[material]]\nname = {}\nmodel = \"composite\"\n", quoted(name));
        let (scale, specular) = self.specular(tint);
        let _ = match &specular {
            Specular::Constant(value) => writeln!(text, "{}", table(value)),
            Specular::Schlick(value) => {
                writeln!(text, "fresnel = \"schlick\"\n{}", table(value))
            }
            Specular::Dielectric(n) => writeln!(text, "fresnel = \"dielectric\"\nn = {n}"),
        };
        if let Some(m) = self.mirror {
            let at = tint.at_nm.map_or(String::new(), |nm| format!(", wavelength_nm = {nm}"));
            let _ = writeln!(
                text,
                "mirror = {{ share = {}, g = {}, alpha = {}{at} }}",
                scale * m.share,
                m.g,
                m.alpha
            );
        }
        if self.diffuse > 0.0 {
            let power =
                if self.power > 0.0 { format!(", power = {}", self.power) } else { String::new() };
            let _ = writeln!(text, "diffuse = {{ {}{power} }}", table(&self.diffuse_of(tint)));
        }
        for lobe in &self.lobes {
            let _ = match lobe.shape {
                Shape::Facets(l) => {
                    let distribution = match l.distribution() {
                        Distribution::Ggx => "ggx",
                        Distribution::Beckmann => "beckmann",
                    };
                    writeln!(
                        text,
                        "[[material.lobe]]\ndistribution = \"{distribution}\"\nshare = {}\nalpha = {}",
                        scale * lobe.share,
                        l.alpha().0
                    )
                }
                Shape::Abg { b, g, .. } => writeln!(
                    text,
                    "[[material.lobe]]\ndistribution = \"abg\"\na_per_sr = {}\nb = {b}\ng = {g}",
                    scale * lobe.scale
                ),
                _ => Ok(()),
            };
        }
        text
    }
}

/// Colours of the parts of a surface, over those at the wavelength of its numbers.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Tint {
    pub wavelength_nm: Vec<f64>,
    /// Colour of lobes and mirror.
    pub specular: Vec<f64>,
    pub diffuse: Vec<f64>,
    /// The wavelength of the mirror's g, where it goes as 1/λ.
    pub at_nm: Option<f64>,
}

impl Tint {
    pub fn grey() -> Self {
        let one = vec![1.0; 2];
        Self {
            wavelength_nm: vec![300.0, 1240.0],
            specular: one.clone(),
            diffuse: one,
            at_nm: None,
        }
    }

    fn is_neutral(&self) -> bool {
        self.specular.iter().all(|s| *s == 1.0)
    }

    fn is_grey(&self) -> bool {
        *self == Self::grey()
    }

    fn range_nm(&self) -> (f64, f64) {
        let last = self.wavelength_nm.last();
        (self.wavelength_nm.first().copied().unwrap_or(300.0), last.copied().unwrap_or(1240.0))
    }
}

/// A Fresnel term with its numbers.
enum Specular {
    Constant(Vec<f64>),
    Schlick(Vec<f64>),
    Dielectric(f64),
}

/// ∫ 2πx/(B + x^g) dx from 0 to 1: what A = 1 reflects at normal incidence.
fn abg_at_normal(b: f64, g: f64) -> f64 {
    static RULE: OnceLock<Vec<(f64, f64)>> = OnceLock::new();
    let rule = RULE.get_or_init(|| legendre(24));
    let knee = b.powf(1.0 / g).clamp(1e-9, 1.0);
    let end = (1.0 / knee).asinh();
    let panels = 2.0;
    let mut sum = 0.0;
    for panel in 0..2 {
        for (t, w) in rule {
            let t = end * (f64::from(panel) + 0.5 * (t + 1.0)) / panels;
            let x = knee * t.sinh();
            sum += 0.5 * end / panels * w * knee * t.cosh() * TAU * x / (b + x.powf(g));
        }
    }
    sum
}

/// The directions of a disc about `o` and their weights: Σ w = 1, exact for polynomials of degree 5 over the disc (Stroud S2: 5-1).
pub(crate) fn disc(o: DVec3, radius: f64) -> Vec<(DVec3, f64)> {
    let (x, y) = o.any_orthonormal_pair();
    let r = radius * (2.0_f64 / 3.0).sqrt();
    let mut all = vec![(o, 0.25)];
    for k in 0..6 {
        let (sin, cos) = (TAU * f64::from(k) / 6.0).sin_cos();
        all.push(((o + (x * cos + y * sin) * r).normalize(), 0.125));
    }
    all.retain(|(d, _)| d.z > 0.0);
    all
}
