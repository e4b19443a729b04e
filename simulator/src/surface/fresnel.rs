//! How much a mirror reflects, by wavelength and angle of incidence, as a few spectra times a few weights.

use super::{MaterialError, conductor};
use sunglint_radiometry::spectrum::{Reflectance, Spectrum};

/// The Fresnel term: F(λ, θ) = Σ_k ρ_k(λ) F_k(cosθ), with θ the angle of incidence on the (micro)mirror.
#[derive(Debug, Clone)]
pub struct Fresnel {
    pub(super) spectra: Vec<Spectrum<Reflectance>>,
    pub(super) law: Law,
    /// g of what stays coherent, exp(−(g cosθ)²); 0 where all does.
    coherence: f64,
    /// cos²θ at which the spectra hold what stays coherent, where g goes as 1/λ; else empty.
    nodes: Vec<f64>,
    /// Whether it is F(θ)/F(0): its spectra are then no reflectances.
    is_relative: bool,
}

/// Values of cos²θ between which what stays coherent is interpolated: over a factor of 2.5 in wavelength 0.5 % of itself for g = 2.
const COHERENT_NODES: usize = 25;
/// Step of its spectra, nm.
const COHERENT_STEP_NM: f64 = 10.0;

#[derive(Debug, Clone)]
pub(super) enum Law {
    Constant,
    Schlick,
    /// A refractive index without absorption, the same at all wavelengths.
    Dielectric(f64),
    /// (R_s − R_p)/2 of such an index.
    DielectricDifference(f64),
    Conductor(conductor::Conductor),
}

impl Fresnel {
    /// A reflectance that is the same at all angles.
    ///
    /// # Errors
    /// A reflectance above 1.
    pub fn constant(reflectance: Spectrum<Reflectance>) -> Result<Self, MaterialError> {
        super::check_reflectance(&reflectance)?;
        Ok(Self {
            spectra: vec![reflectance],
            law: Law::Constant,
            coherence: 0.0,
            nodes: Vec::new(),
            is_relative: false,
        })
    }

    /// Schlick's approximation F = R₀ + (1 − R₀)(1 − cosθ)⁵ (Schlick 1994, eq. 15) from a reflectance that was measured at normal incidence.
    ///
    /// # Errors
    /// A reflectance above 1.
    pub fn schlick(normal: Spectrum<Reflectance>) -> Result<Self, MaterialError> {
        super::check_reflectance(&normal)?;
        let (from_nm, to_nm) = normal.range_nm();
        let one = Spectrum::constant(1.0, from_nm, to_nm)?;
        Ok(Self {
            spectra: vec![normal, one],
            law: Law::Schlick,
            coherence: 0.0,
            nodes: Vec::new(),
            is_relative: false,
        })
    }

    /// Fresnel's equations for unpolarised light and the refractive index n + ik of a bulk material in vacuum.
    /// The spectra are the reflectances at some angles, and the weights interpolate between them: see
    /// [`super::conductor`] for the error.
    ///
    /// # Errors
    /// An index whose reflectance is not smooth enough in angle (n < 1 with k near 0).
    pub fn conductor(index: &conductor::ComplexIndex) -> Result<Self, MaterialError> {
        let (conductor, spectra) = conductor::Conductor::new(index)?;
        Ok(Self {
            spectra,
            law: Law::Conductor(conductor),
            coherence: 0.0,
            nodes: Vec::new(),
            is_relative: false,
        })
    }

    /// Fresnel's equations for unpolarised light and a refractive index n without absorption, the same from `from_nm` to `to_nm`.
    ///
    /// # Errors
    /// n is not from 1.01 to 10.
    pub fn dielectric(n: f64, from_nm: f64, to_nm: f64) -> Result<Self, MaterialError> {
        if !(1.01..=10.0).contains(&n) {
            let expected = "from 1.01 to 10".to_owned();
            return Err(MaterialError::Parameter { name: "n", value: n, expected });
        }
        let spectra = vec![Spectrum::constant(1.0, from_nm, to_nm)?];
        Ok(Self {
            spectra,
            law: Law::Dielectric(n),
            coherence: 0.0,
            nodes: Vec::new(),
            is_relative: false,
        })
    }

    /// The part of it that a surface with a random height reflects coherently: times exp(−(g cosθ)²), with g = 4πσ/λ of the heights' root mean square σ
    /// (Bennett and Porteus 1961, J. Opt. Soc. Am. 51, 123; Beckmann and Spizzichino 1963). One g for all wavelengths.
    pub fn coherent(mut self, g: f64) -> Self {
        self.coherence = g;
        self
    }

    /// The same with g at one wavelength \[nm\] and as 1/λ at others, as 4πσ/λ has it: the spectra then hold exp(−(g λ₀/λ)² cos²θ) at some cos²θ, between which the weights interpolate. Of a
    /// [`Fresnel::conductor`] one g holds for all wavelengths.
    ///
    /// # Errors
    /// Numbers that make no spectrum.
    pub fn coherent_at(self, g: f64, at_nm: f64) -> Result<Self, MaterialError> {
        if g == 0.0 || matches!(self.law, Law::Conductor(_)) {
            return Ok(self.coherent(g));
        }
        let last = (COHERENT_NODES - 1) as f64;
        let nodes: Vec<f64> = (0..COHERENT_NODES).map(|k| k as f64 / last).collect();
        let mut spectra = Vec::with_capacity(nodes.len() * self.spectra.len());
        for x in &nodes {
            for spectrum in &self.spectra {
                let mut nm: Vec<f64> = Vec::new();
                for pair in spectrum.wavelength_nm().windows(2) {
                    let steps = ((pair[1] - pair[0]) / COHERENT_STEP_NM).ceil().clamp(1.0, 1e4);
                    nm.extend(
                        (0..steps as usize)
                            .map(|k| pair[0] + (pair[1] - pair[0]) * k as f64 / steps),
                    );
                }
                nm.push(spectrum.range_nm().1);
                let value = nm
                    .iter()
                    .map(|nm| spectrum.at(*nm) * (-(g * at_nm / nm).powi(2) * x).exp())
                    .collect();
                spectra.push(Spectrum::new(nm, value)?);
            }
        }
        Ok(Self { spectra, law: self.law, coherence: g, nodes, is_relative: self.is_relative })
    }

    /// The spectra ρ_k, all from 0 to 1.
    pub fn spectra(&self) -> &[Spectrum<Reflectance>] {
        &self.spectra
    }

    /// Adds `scale`·F_k(cosθ) to `sum`, one per spectrum.
    pub fn add_weights(&self, cos: f64, scale: f64, sum: &mut [f64]) {
        if !self.nodes.is_empty() {
            let own = self.spectra.len() / self.nodes.len();
            for (k, weight, _) in self.beside(cos) {
                self.add_of_law(cos, scale * weight, &mut sum[k * own..(k + 1) * own]);
            }
            return;
        }
        let scale = if self.coherence == 0.0 { scale } else { scale * self.kept(cos).0 };
        self.add_of_law(cos, scale, sum);
    }

    /// The two nodes of cos²θ beside an angle, their weights and the weights' derivatives by cosθ: hat functions times what stays coherent at λ₀ here over there.
    fn beside(&self, cos: f64) -> [(usize, f64, f64); 2] {
        let last = self.nodes.len() - 1;
        let x = (cos * cos).clamp(0.0, 1.0);
        let k = ((x * last as f64) as usize).min(last - 1);
        let t = x * last as f64 - k as f64;
        let g2 = self.coherence * self.coherence;
        [(k, 1.0 - t, -1.0), (k + 1, t, 1.0)].map(|(k, hat, sign)| {
            let over = (g2 * (self.nodes[k] - x)).exp();
            let rate = 2.0 * cos * over * (sign * last as f64 - g2 * hat);
            (k, hat * over, rate)
        })
    }

    fn add_of_law(&self, cos: f64, scale: f64, sum: &mut [f64]) {
        match &self.law {
            Law::Constant => sum[0] += scale,
            Law::Dielectric(n) => sum[0] += scale * conductor::fresnel(*n, 0.0, cos),
            Law::DielectricDifference(n) => {
                sum[0] += scale * conductor::difference(*n, 0.0, cos);
            }
            Law::Schlick => {
                let rise = (1.0 - cos.clamp(0.0, 1.0)).powi(5);
                sum[0] += scale * (1.0 - rise);
                sum[1] += scale * rise;
            }
            Law::Conductor(conductor) => conductor.add_weights(cos, scale, sum),
        }
    }

    /// F_k(cosθ) and their derivatives by cosθ.
    pub(super) fn slopes(&self, cos: f64) -> Vec<(f64, f64)> {
        if !self.nodes.is_empty() {
            let of_law = self.slopes_of_law(cos);
            let mut slopes = vec![(0.0, 0.0); self.spectra.len()];
            for (k, weight, rate) in self.beside(cos) {
                for (j, (f, s)) in of_law.iter().enumerate() {
                    slopes[k * of_law.len() + j] = (f * weight, s * weight + f * rate);
                }
            }
            return slopes;
        }
        let mut slopes = self.slopes_of_law(cos);
        let (kept, rate) = self.kept(cos);
        slopes.iter_mut().for_each(|(f, s)| (*f, *s) = (*f * kept, *s * kept + *f * rate));
        slopes
    }

    /// The coherent part and its derivative by cosθ.
    fn kept(&self, cos: f64) -> (f64, f64) {
        let g2 = self.coherence * self.coherence;
        let kept = (-g2 * cos * cos).exp();
        (kept, -2.0 * g2 * cos * kept)
    }

    fn slopes_of_law(&self, cos: f64) -> Vec<(f64, f64)> {
        match &self.law {
            Law::Constant => vec![(1.0, 0.0)],
            Law::Dielectric(n) | Law::DielectricDifference(n) => {
                let of = match &self.law {
                    Law::Dielectric(_) => conductor::fresnel,
                    _ => conductor::difference,
                };
                let at = |cos: f64| of(*n, 0.0, cos.clamp(0.0, 1.0));
                // Smooth on a scale of 1/n; one side at the ends.
                let (below, above) = ((cos - 1e-6).max(0.0), (cos + 1e-6).min(1.0));
                vec![(at(cos), (at(above) - at(below)) / (above - below).max(1e-12))]
            }
            Law::Schlick => {
                let left = 1.0 - cos.clamp(0.0, 1.0);
                let (rise, rate) = (left.powi(5), -5.0 * left.powi(4));
                vec![(1.0 - rise, -rate), (rise, rate)]
            }
            Law::Conductor(conductor) => conductor.slopes(cos),
        }
    }

    /// (R_s − R_p)/2 in place of (R_s + R_p)/2: what is polarised perpendicular to the plane of incidence after one reflection of unpolarised light. `None` where the
    /// refractive index is not known.
    ///
    /// # Errors
    /// The errors of [`Fresnel::conductor`].
    pub fn difference(&self) -> Result<Option<Self>, MaterialError> {
        let (law, spectra) = match &self.law {
            Law::Dielectric(n) => (Law::DielectricDifference(*n), self.spectra.clone()),
            Law::Conductor(conductor) if !self.is_relative => {
                let (conductor, spectra) = conductor.difference()?;
                (Law::Conductor(conductor), spectra)
            }
            _ => return Ok(None),
        };
        let (coherence, nodes) = (self.coherence, self.nodes.clone());
        Ok(Some(Self { spectra, law, coherence, nodes, is_relative: false }))
    }

    /// The refractive index (n, k) at some wavelengths (vacuum nm) of which this is Fresnel's term for unpolarised light; `None` where it is not known, and of what is coherent in part.
    pub(super) fn indices(&self, nm: &[f64]) -> Option<Vec<[f64; 2]>> {
        if self.is_relative || self.coherence != 0.0 {
            return None;
        }
        match &self.law {
            Law::Dielectric(n) => Some(vec![[*n, 0.0]; nm.len()]),
            Law::Conductor(conductor) => {
                Some(nm.iter().map(|nm| conductor.index_at(*nm)).collect())
            }
            _ => None,
        }
    }

    /// Key of its weights, which are those of every other term with the same key; `None` where they depend on more than two numbers.
    pub(super) fn key(&self) -> Option<(u8, u64)> {
        if self.coherence != 0.0 || !self.nodes.is_empty() {
            return None;
        }
        match &self.law {
            Law::Constant => Some((0, 0)),
            Law::Schlick => Some((1, 0)),
            Law::Dielectric(n) => Some((2, n.to_bits())),
            Law::DielectricDifference(n) => Some((3, n.to_bits())),
            Law::Conductor(_) => None,
        }
    }

    /// Whether it is the same at all angles.
    pub(super) fn is_constant(&self) -> bool {
        matches!(self.law, Law::Constant) && self.coherence == 0.0
    }

    /// F(θ)/F(0) of each wavelength as a term whose spectra are at most 1, and the number that its weights are to be multiplied by.
    pub(super) fn relative(&self) -> Result<(Self, f64), MaterialError> {
        let mut at_normal = vec![0.0; self.spectra.len()];
        self.add_weights(1.0, 1.0, &mut at_normal);
        let mut divided = Vec::new();
        for spectrum in &self.spectra {
            let ratio = |nm: &f64| {
                let normal: f64 =
                    self.spectra.iter().zip(&at_normal).map(|(s, w)| s.at(*nm) * w).sum();
                spectrum.at(*nm) / normal.max(1e-9)
            };
            divided.push(spectrum.wavelength_nm().iter().map(ratio).collect::<Vec<f64>>());
        }
        let scale = divided.iter().flatten().copied().fold(f64::MIN_POSITIVE, f64::max);
        let spectra = self.spectra.iter().zip(divided).map(|(spectrum, ratio)| {
            let value = ratio.iter().map(|v| v / scale).collect();
            Ok(Spectrum::new(spectrum.wavelength_nm().to_vec(), value)?)
        });
        let spectra = spectra.collect::<Result<_, MaterialError>>()?;
        let (law, nodes) = (self.law.clone(), self.nodes.clone());
        Ok((Self { spectra, law, coherence: self.coherence, nodes, is_relative: true }, scale))
    }

    /// The largest error of F over all angles and the tabulated wavelengths, against the law that it stands for.
    pub fn error(&self) -> f64 {
        match &self.law {
            Law::Conductor(conductor) => conductor.error(),
            _ => 0.0,
        }
    }

    pub(super) fn describe(&self) -> String {
        let law = self.describe_law();
        match self.coherence {
            0.0 => law,
            g if self.nodes.is_empty() => format!("{law}, coherent with g {}", super::short(g)),
            g => format!("{law}, coherent with g {} that goes as 1/λ", super::short(g)),
        }
    }

    fn describe_law(&self) -> String {
        match &self.law {
            Law::Dielectric(n) => format!("Fresnel term of n {}", super::short(*n)),
            Law::DielectricDifference(n) => {
                format!("polarised part of the Fresnel term of n {}", super::short(*n))
            }
            Law::Constant => format!("reflectance {}", super::range_of(&self.spectra[0])),
            Law::Schlick => {
                format!("Schlick's Fresnel term from {}", super::range_of(&self.spectra[0]))
            }
            Law::Conductor(conductor) => format!("Fresnel term of {}", conductor.name()),
        }
    }
}
