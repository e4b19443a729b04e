//! Materials at the nodes, and directions drawn from them.

use crate::surface::Width;
use crate::surface::{Distribution, Lobe, Material};
use glam::DVec3;
use std::f64::consts::{FRAC_1_PI, PI};
use std::sync::Arc;

/// Share of directions drawn from the lobe of a material that has one; the others are spread as over a Lambert surface.
const FROM_LOBE: f64 = 0.8;
/// The same with a Lambert base below.
const FROM_COAT: f64 = 0.5;

/// The materials of a scene at some wavelengths; its clones share them, so that each thread may have one.
#[derive(Debug, Clone)]
pub struct Optics {
    materials: Arc<[Material]>,
    /// For each material, weight and node: ρ.
    rho: Arc<[Vec<f64>]>,
    pub nodes: usize,
    weights: Vec<f64>,
}

/// A direction that was drawn.
#[derive(Debug, Clone, Copy)]
pub struct Drawn {
    /// In the surface's axes.
    pub to: DVec3,
    /// Probability density of the direction, sr⁻¹; `None` for a mirror.
    pub density: Option<f64>,
}

impl Optics {
    /// At wavelengths (vacuum nm).
    pub fn new(materials: &[Material], nm: &[f64]) -> Self {
        let of = |m: &Material| {
            m.spectra().iter().flat_map(|s| nm.iter().map(|nm| s.at(*nm))).collect::<Vec<f64>>()
        };
        let most = materials.iter().map(|m| m.spectra().len()).max().unwrap_or(0);
        Self {
            rho: materials.iter().map(of).collect(),
            materials: materials.into(),
            nodes: nm.len(),
            weights: vec![0.0; most],
        }
    }

    /// A material.
    pub fn material(&self, number: usize) -> &Material {
        &self.materials[number]
    }

    /// ρ of a material's weight at a node.
    pub fn rho(&self, material: usize, weight: usize, node: usize) -> f64 {
        self.rho[material][weight * self.nodes + node]
    }

    /// The reflectance of a Lambert material at each node; `None` of any other.
    pub fn lambert(&self, material: usize) -> Option<&[f64]> {
        let lambert = matches!(self.materials[material].width(), Width::Even);
        lambert.then(|| self.rho[material].as_slice())
    }

    /// Multiplies `light` (one number for each node) by `scale`·f_r(i, o).
    pub fn scatter(&mut self, material: usize, i: DVec3, o: DVec3, scale: f64, light: &mut [f64]) {
        if let Width::Even = self.materials[material].width() {
            let factor = if i.z > 0.0 && o.z > 0.0 { scale * FRAC_1_PI } else { 0.0 };
            light.iter_mut().zip(&self.rho[material]).for_each(|(l, rho)| *l *= factor * rho);
            return;
        }
        let count = self.materials[material].spectra().len();
        self.weights[..count].fill(0.0);
        self.materials[material].add_weights(i, o, scale, &mut self.weights[..count]);
        self.times(material, count, light);
    }

    /// Multiplies `light` by a mirror's reflectance.
    pub fn mirror(&mut self, material: usize, cos: f64, light: &mut [f64]) {
        let Width::Mirror(fresnel) = self.materials[material].width() else { return };
        let count = fresnel.spectra().len();
        self.weights[..count].fill(0.0);
        fresnel.add_weights(cos, 1.0, &mut self.weights[..count]);
        self.times(material, count, light);
    }

    fn times(&self, material: usize, count: usize, light: &mut [f64]) {
        let rho = &self.rho[material];
        for (s, light) in light.iter_mut().enumerate() {
            let f: f64 = (0..count).map(|k| self.weights[k] * rho[k * self.nodes + s]).sum();
            *light *= f;
        }
    }

    /// Draws a direction for light from `i` (surface's axes) by three numbers from 0 to 1.
    pub fn draw(&self, material: usize, i: DVec3, [a, b, c]: [f64; 3]) -> Drawn {
        let (lobe, share) = match self.materials[material].width() {
            Width::Mirror(_) => {
                return Drawn { to: DVec3::new(-i.x, -i.y, i.z), density: None };
            }
            Width::Even => return spread(a, b),
            Width::Other(_) => {
                let material = &self.materials[material];
                let Some(drawn) = material.sample(i, [a, b]) else {
                    return Drawn { to: DVec3::Z, density: Some(0.0) };
                };
                return Drawn { to: drawn.direction, density: Some(drawn.density_per_sr) };
            }
            Width::Lobe { lobe, alone } => (lobe, if alone { FROM_LOBE } else { FROM_COAT }),
        };
        let to = if c < share {
            let h = tilt(lobe, a, b);
            2.0 * i.dot(h) * h - i
        } else {
            spread(a, b).to
        };
        Drawn { to, density: Some(density(lobe, share, i, to)) }
    }

    /// The density with which [`Optics::draw`] draws `to`, sr⁻¹; `None` of a mirror.
    pub fn density(&self, material: usize, i: DVec3, to: DVec3) -> Option<f64> {
        match self.materials[material].width() {
            Width::Mirror(_) => None,
            Width::Even => Some(FRAC_1_PI * to.z.max(0.0)),
            Width::Other(_) => Some(self.materials[material].sampling_density_per_sr(i, to)),
            Width::Lobe { lobe, alone } => {
                Some(density(lobe, if alone { FROM_LOBE } else { FROM_COAT }, i, to))
            }
        }
    }
}

/// A direction by the cosine.
pub fn spread(a: f64, b: f64) -> Drawn {
    let (sin, cos) = (2.0 * PI * b).sin_cos();
    let across = a.sqrt();
    let z = (1.0 - a).max(0.0).sqrt();
    Drawn { to: DVec3::new(across * cos, across * sin, z), density: Some(FRAC_1_PI * z) }
}

/// A microfacet's normal, by D cosθ (Walter et al. 2007, eqs. 28 and 35, in slopes).
fn tilt(lobe: &Lobe, a: f64, b: f64) -> DVec3 {
    let a = a.min(1.0 - 1e-9);
    let slope = match lobe.distribution() {
        Distribution::Beckmann => (-(1.0 - a).ln()).sqrt(),
        Distribution::Ggx => (a / (1.0 - a)).sqrt(),
    };
    let (sin, cos) = (2.0 * PI * b).sin_cos();
    let (x, y) = lobe.alpha();
    DVec3::new(x * slope * cos, y * slope * sin, 1.0).normalize()
}

fn density(lobe: &Lobe, share: f64, i: DVec3, to: DVec3) -> f64 {
    if to.z <= 0.0 {
        return 0.0;
    }
    let h = (i + to).normalize_or(DVec3::Z);
    let mirrored = lobe.density(h) * h.z.max(0.0) / (4.0 * i.dot(h).abs().max(1e-300));
    share * mirrored + (1.0 - share) * FRAC_1_PI * to.z
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::{Fresnel, Masking};
    use sunglint_radiometry::spectrum::Spectrum;

    /// Truth: the material's own albedo, found by a quadrature in slopes. ∫ f cosθ dω by drawn directions: 0.5 %, of 65,536 points.
    #[test]
    fn directions_drawn_give_the_albedo() {
        let grey = || Spectrum::constant(0.7, 300.0, 1240.0).unwrap();
        for (distribution, x, y) in [
            (Distribution::Beckmann, 0.15, 0.15),
            (Distribution::Beckmann, 0.5, 0.2),
            (Distribution::Ggx, 0.3, 0.3),
            (Distribution::Ggx, 0.05, 0.05),
        ] {
            let lobe = Lobe::anisotropic(distribution, x, y, Masking::Separable).unwrap();
            let mut materials =
                vec![Material::microfacet("m", lobe, Fresnel::constant(grey()).unwrap())];
            if x == y {
                let coat = Fresnel::schlick(Spectrum::constant(0.04, 300.0, 1240.0).unwrap());
                materials.push(Material::blend("b", grey(), lobe, coat.unwrap()).unwrap());
            }
            let mut optics = Optics::new(&materials, &[500.0]);
            for (number, material) in materials.iter().enumerate() {
                for cos in [0.95_f64, 0.5, 0.1] {
                    let i = DVec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
                    let truth = material.albedo(500.0, i).unwrap();
                    let mut sum = 0.0;
                    for k in 0..1 << 16 {
                        let u = sobol_burley::sample_4d(k, 0, 7).map(f64::from);
                        let drawn = optics.draw(number, i, [u[0], u[1], u[2]]);
                        let density = drawn.density.unwrap();
                        let again = optics.density(number, i, drawn.to).unwrap();
                        assert!((again - density).abs() <= 1e-9 * density);
                        let mut light = [1.0];
                        if drawn.to.z > 0.0 {
                            let scale = drawn.to.z / density;
                            optics.scatter(number, i, drawn.to, scale, &mut light);
                            sum += light[0];
                        }
                    }
                    let found = sum / f64::from(1 << 16);
                    assert!((found / truth - 1.0).abs() < 5e-3, "{lobe:?} {cos}: {found} {truth}");
                }
            }
        }
    }
}
