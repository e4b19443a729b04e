//! Properties that a reflection law must tell of itself, and what follows numerically from them: albedo, spheres, and whether it loses energy.

use super::sampling::Mixture;
use super::{Facets, Material, MaterialError, Model, PolarisedPart, cubature};
use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, PI};

/// When a numerical integral is taken as converged, and when it ends without.
#[derive(Debug, Clone, Copy)]
pub(super) struct Effort {
    /// The relative error.
    pub tolerance: f64,
    /// The most evaluations.
    pub most: usize,
}

/// Effort of the look at energy.
const LOOK: Effort = Effort { tolerance: 1e-3, most: 6_000 };
/// The error above which an integral is no result.
const REFUSED: f64 = 2e-2;
/// The albedo above which a material is said to reflect more than came.
const GAIN: f64 = 1e-3;
/// Up to this angle of incidence a law that reflects more than came is refused, degrees; beyond, it is said.
const STRICT_DEG: f64 = 60.0;
/// The angles of incidence at which energy is looked at, degrees.
const LOOKED_DEG: [f64; 13] =
    [0.0, 15.0, 30.0, 45.0, 60.0, 70.0, 75.0, 80.0, 83.0, 85.0, 87.0, 88.0, 89.0];

/// A law of reflection with as many weights as its material has spectra.
pub(super) trait Scatter: std::fmt::Debug + Send + Sync {
    /// Adds `scale` times the weights \[sr⁻¹\] for unit vectors above the horizon.
    fn add_weights(&self, i: DVec3, o: DVec3, scale: f64, sum: &mut [f64]);
    /// Adds the weights as [`Self::add_weights`] does, and gives what [`Self::covers`] does.
    fn add_and_cover(&self, i: DVec3, o: DVec3, scale: f64, sum: &mut [f64]) -> bool {
        self.add_weights(i, o, scale, sum);
        !self.has_gaps() || self.covers(i, o)
    }
    /// Half-width of the 95 % interval of ln f, where it is known.
    fn ln_doubt(&self, _i: DVec3, _o: DVec3) -> Option<f64> {
        None
    }
    /// The polarised part of its light once unpolarised light was reflected ([`Material::polarised`]).
    ///
    /// # Errors
    /// The errors of that.
    fn polarised(&self, _name: &str) -> Result<PolarisedPart, MaterialError> {
        Ok(PolarisedPart::Unknown)
    }
    /// Facets, with their index at some wavelengths (vacuum nm).
    fn facets(&self, _nm: &[f64]) -> Facets {
        Facets::Unknown
    }
    /// Whether it is the same for every tangent.
    fn is_isotropic(&self) -> bool;
    /// In a few words.
    fn describe(&self) -> String;
    /// The narrowest half-width of its lobes, radians of the outgoing direction.
    fn lobe_width_rad(&self) -> f64;
    /// Returns the effort that the law's integrals are worth.
    fn effort(&self) -> Effort {
        Effort { tolerance: 1e-5, most: 60_000 }
    }
    /// The relative error at which an average over nearby directions is good enough. Between measured values there are kinks, which no refinement resolves.
    fn grain(&self) -> f64 {
        0.0
    }
    /// Whether there are geometries without data: the last spectrum is then [`super::uncovered`].
    fn has_gaps(&self) -> bool {
        false
    }
    /// Whether a geometry was measured, or lies between such.
    fn covers(&self, _i: DVec3, _o: DVec3) -> bool {
        true
    }
}

/// Doubt of ln f that a fitted material's file states: half-widths of 95 % intervals by region.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Stated {
    /// Up to 3° from the mirrored direction.
    pub peak_ln: f64,
    /// Elsewhere.
    pub wings_ln: f64,
    /// Where light or detector are more than 75° from the normal.
    pub grazing_ln: f64,
}

impl Stated {
    fn at(self, i: DVec3, o: DVec3) -> f64 {
        let mirrored = DVec3::new(-i.x, -i.y, i.z);
        if (o - mirrored).length() <= 2.0 * (0.5 * PEAK_RAD).sin() {
            self.peak_ln
        } else if i.z.min(o.z) < GRAZING_COS {
            self.grazing_ln
        } else {
            self.wings_ln
        }
    }
}

/// The regions of `brdf fit`: 3° about the mirrored direction, and beyond 75° from the normal.
const PEAK_RAD: f64 = 0.052_36;
const GRAZING_COS: f64 = 0.258_819;

/// The largest albedo that was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LargestAlbedo {
    /// ∫ f_r cosθ_o dω_o.
    pub value: f64,
    /// How far it may be off (absolute).
    pub error: f64,
    /// The angle of incidence, degrees.
    pub theta_deg: f64,
    /// The wavelength, nm.
    pub wavelength_nm: f64,
}

impl LargestAlbedo {
    /// A bound that was not computed.
    pub(super) fn bound(value: f64) -> Self {
        Self { value, error: 0.0, theta_deg: 0.0, wavelength_nm: 0.0 }
    }
}

impl Material {
    /// Whether light from `i` to `o` was measured or follows from a law; false of what is extrapolated from a table. Where it is false a weight before a spectrum that
    /// covers no wavelength grows, so that integrals over wavelength say that they have no data.
    pub fn covers(&self, i: DVec3, o: DVec3) -> bool {
        match &self.model {
            Model::Law(law) => law.covers(i, o),
            _ => true,
        }
    }

    /// Half-width of the 95 % interval of ln f for light from `i` to `o`. Of a table it was measured by leaving values out, of a fitted material it is what its file says; `None` of a
    /// law whose numbers somebody chose, and at or below the horizon.
    pub fn ln_doubt(&self, i: DVec3, o: DVec3) -> Option<f64> {
        if !(i.z > 0.0 && o.z > 0.0) {
            return None;
        }
        let of_law = match &self.model {
            Model::Law(law) => law.ln_doubt(i, o),
            _ => None,
        };
        self.stated.map(|stated| stated.at(i, o)).or(of_law)
    }

    /// [`Material::add_weights`] above the horizon, but for the weight that says that there are no data.
    fn add_reflected(&self, i: DVec3, o: DVec3, scale: f64, sum: &mut [f64]) {
        match &self.model {
            Model::Law(law) => law.add_weights(i, o, scale, sum),
            _ => self.add_weights(i, o, scale, sum),
        }
    }

    /// ∫ w_k cosθ_o dω_o, and how far it may be off (absolute, of the worst weight), through the material's own importance sampling: where f cosθ/density is smooth, few
    /// points do.
    fn numerical_albedo(&self, i: DVec3, effort: Effort) -> (Vec<f64>, f64) {
        let edges = self.proposals.edges();
        // In φ there is a kink at 0 and π of what is symmetric about the plane of incidence.
        let cells: Vec<cubature::Cell> = edges
            .windows(2)
            .flat_map(|u| [[(u[0], u[1]), (0.0, 0.5)], [(u[0], u[1]), (0.5, 1.0)]])
            .collect();
        let (sum, error) =
            cubature::integrate(&cells, self.spectra.len(), effort, |u, scale, sum| {
                if let Some(o) = self.proposals.sample(i, u.into()) {
                    let density = self.proposals.density(i, o);
                    if density > 0.0 {
                        self.add_reflected(i, o, scale * o.z / density, sum);
                    }
                }
            });
        (sum, error)
    }

    /// [`Self::numerical_albedo`] with the effort that the law asks for.
    pub(super) fn albedo_of_law(
        &self,
        law: &dyn Scatter,
        i: DVec3,
    ) -> Result<Vec<f64>, MaterialError> {
        let (sum, error) = self.numerical_albedo(i, law.effort());
        let size = sum.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
        // Of a doubt the first digit is enough.
        if error > REFUSED.max(10.0 * law.grain()) * size {
            return Err(MaterialError::Albedo {
                theta_deg: i.z.acos().to_degrees(),
                error: error / size,
            });
        }
        Ok(sum)
    }

    /// ∫ w_k cosθ_i cosθ_o dA of a sphere of 1 m radius, and its relative error.
    pub(super) fn numerical_sphere(
        &self,
        law: &dyn Scatter,
        phase: f64,
        scale: f64,
        sum: &mut [f64],
    ) -> f64 {
        let half = 0.5 * (PI - phase);
        // The directions in the plane of longitudes, the bisector at longitude 0.
        let (i, o) = (
            DVec3::new((0.5 * phase).cos(), (0.5 * phase).sin(), 0.0),
            DVec3::new((0.5 * phase).cos(), -(0.5 * phase).sin(), 0.0),
        );
        // Normals turn by half of what a reflected direction turns by.
        let width = (0.25 * law.lobe_width_rad()).clamp(1e-7, 10.0);
        let stretch = |t: f64, end: f64| {
            let span = (end / width).asinh();
            (width * (t * span).sinh(), width * span * (t * span).cosh())
        };
        let cells = [
            [(-1.0, 0.0), (-1.0, 0.0)],
            [(-1.0, 0.0), (0.0, 1.0)],
            [(0.0, 1.0), (-1.0, 0.0)],
            [(0.0, 1.0), (0.0, 1.0)],
        ];
        let (count, effort) = (self.spectra.len(), law.effort());
        let (found, error) = cubature::integrate(&cells, count, effort, |t, w, sum| {
            let (longitude, along) = stretch(t[0], half);
            let (latitude, across) = stretch(t[1], FRAC_PI_2);
            let (cos, sin) = (latitude.cos(), latitude.sin());
            let north = DVec3::new(-sin * longitude.cos(), -sin * longitude.sin(), cos);
            let east = DVec3::new(-longitude.sin(), longitude.cos(), 0.0);
            // The heights of Sun and observer without cancellation at the terminators.
            let height_i = cos * (half + longitude).sin();
            let height_o = cos * (half - longitude).sin();
            if height_i > 0.0 && height_o > 0.0 {
                let local = |d: DVec3, z: f64| DVec3::new(d.dot(east), d.dot(north), z);
                let area = w * along * across * cos;
                let weight = area * height_i * height_o;
                law.add_weights(local(i, height_i), local(o, height_o), weight, sum);
            }
        });
        let size = found.iter().fold(f64::MIN_POSITIVE, |a, b| a.max(b.abs()));
        sum.iter_mut().zip(&found).for_each(|(sum, w)| *sum += scale * w);
        error / size
    }

    /// A material of a law of its own; refused where it reflects more than came at moderate incidence, unless it was `measured`.
    pub(super) fn of_law(
        name: String,
        spectra: Vec<sunglint_radiometry::spectrum::Spectrum<super::Reflectance>>,
        law: std::sync::Arc<dyn Scatter>,
        proposals: Mixture,
        measured: bool,
    ) -> Result<Self, MaterialError> {
        let mut made = Self {
            name,
            spectra,
            model: Model::Law(law),
            proposals,
            largest: None,
            notes: vec![],
            stated: None,
            ageing: None,
        };
        let (largest, gain_from) = made.look_at_energy();
        if let Some((theta_deg, wavelength_nm, albedo)) = gain_from {
            if !measured && theta_deg <= STRICT_DEG {
                return Err(MaterialError::Gain { theta_deg, wavelength_nm, albedo });
            }
            made.notes.push(format!(
                "it reflects more than came from {theta_deg}° of incidence on: {:.3} at {}° and {:.0} nm",
                largest.value, largest.theta_deg, largest.wavelength_nm
            ));
        }
        made.largest = Some(largest);
        Ok(made)
    }

    /// The largest albedo, and the first angle at which it is above 1 with wavelength and albedo there.
    fn look_at_energy(&self) -> (LargestAlbedo, Option<(f64, f64, f64)>) {
        let azimuths: &[f64] = if self.is_isotropic() { &[0.0] } else { &[0.0, 45.0, 90.0] };
        let mut grid: Vec<f64> =
            self.spectra.iter().flat_map(|s| s.wavelength_nm()).copied().collect();
        grid.retain(|nm| *nm > super::UNCOVERED_NM);
        grid.sort_by(f64::total_cmp);
        grid.dedup();
        let mut largest =
            LargestAlbedo { value: 0.0, error: 0.0, theta_deg: 0.0, wavelength_nm: 0.0 };
        let mut gain_from = None;
        for theta_deg in LOOKED_DEG {
            for azimuth in azimuths {
                let (sin, cos) = theta_deg.to_radians().sin_cos();
                let (y, x) = azimuth.to_radians().sin_cos();
                let (weights, error) =
                    self.numerical_albedo(DVec3::new(sin * x, sin * y, cos), LOOK);
                for &nm in &grid {
                    let albedo = self.times_spectra(nm, &weights);
                    if albedo > largest.value {
                        largest =
                            LargestAlbedo { value: albedo, error, theta_deg, wavelength_nm: nm };
                    }
                    if albedo > 1.0 + GAIN + error && gain_from.is_none() {
                        gain_from = Some((theta_deg, nm, albedo));
                    }
                }
            }
        }
        (largest, gain_from)
    }

    /// The most that it reflects of the light from any one direction at any wavelength: a bound of the laws that are built in, the largest value found (to 89°
    /// of incidence) plus its error of the others.
    pub fn albedo_bound(&self) -> f64 {
        let most = |s: &sunglint_radiometry::spectrum::Spectrum<_>| {
            s.value().iter().copied().fold(0.0, f64::max)
        };
        match (&self.largest, &self.model) {
            (Some(largest), _) => largest.value + largest.error,
            (None, Model::Lambert) => most(&self.spectra[0]),
            (None, Model::Mirror { fresnel } | Model::Microfacet { fresnel, .. })
                if fresnel.is_constant() =>
            {
                most(&self.spectra[0])
            }
            _ => 1.0,
        }
    }

    /// Returns notes for whoever uses the material: light that it would make, data that are not reciprocal, geometries without data.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// The material with one more note.
    #[must_use]
    pub fn with_note(mut self, note: impl Into<String>) -> Self {
        self.notes.push(note.into());
        self
    }

    /// The narrowest half-width (at 1/e, at normal incidence) of what it reflects of a ray, radians: 0 of a mirror, π/2 of a Lambert surface. At grazing incidence a
    /// lobe is narrower across the plane of incidence by cosθ_i.
    pub fn lobe_width_rad(&self) -> f64 {
        match &self.model {
            Model::Lambert => FRAC_PI_2,
            Model::Mirror { .. } => 0.0,
            Model::Microfacet { lobe, .. } | Model::Blend { lobe, .. } => lobe.width_rad(),
            Model::Law(law) => law.lobe_width_rad(),
        }
    }
}
