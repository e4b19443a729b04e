//! Reflection by a sphere against phase angle, rough mirrors beside Lambert's law and a mirror (thesis fig. G.4).

use crate::surface::{Distribution, Fresnel, Lobe, Masking, Material, MaterialError};
use std::f64::consts::PI;
use sunglint_radiometry::spectrum::Spectrum;

/// Step of the phase angle, degrees.
pub const STEP_DEG: f64 = 1.0;

/// Intensity over irradiance and cross-section of a sphere of reflectance 1, I/(E πR²), sr⁻¹.
#[derive(Debug, Clone)]
pub struct SphereRatio {
    /// A name for tables: letters, digits and `_`.
    pub column: String,
    /// A name for people.
    pub name: String,
    /// Whether it is smooth or diffuse, not a rough mirror.
    pub is_ideal: bool,
    /// The ratio at each phase angle from 0° to 180° by [`STEP_DEG`]. A mirror's at 180° is no limit.
    pub ratio: Vec<f64>,
}

/// Spheres by Lambert's law, of a mirror, and of rough mirrors (Beckmann, with separable masking of Smith) of some roughnesses α.
///
/// # Errors
/// A roughness that a lobe does not take.
pub fn sphere_ratios(alpha: &[f64]) -> Result<Vec<SphereRatio>, MaterialError> {
    let (from, to) = (300.0, 1240.0);
    let white = || Spectrum::constant(1.0, from, to);
    let mut spheres = vec![
        ("lambert".to_owned(), "Lambert".to_owned(), Material::lambert("Lambert", white()?)?),
        (
            "mirror".to_owned(),
            "mirror".to_owned(),
            Material::mirror("mirror", Fresnel::constant(white()?)?),
        ),
    ];
    for alpha in alpha {
        let lobe = Lobe::isotropic(Distribution::Beckmann, *alpha, Masking::default())?;
        let name = format!("α = {alpha}");
        let column = format!("alpha_{alpha}").replace(['.', '-'], "_");
        spheres.push((
            column,
            name.clone(),
            Material::microfacet(name, lobe, Fresnel::constant(white()?)?),
        ));
    }
    let one = |(i, (column, name, material)): (usize, (String, String, Material))| {
        let mut ratio = Vec::new();
        for step in 0..=(180.0 / STEP_DEG) as usize {
            let phase = step as f64 * STEP_DEG;
            let mut weights = vec![0.0; material.spectra().len()];
            material.add_sphere_weights(phase.to_radians().min(PI), 1.0, &mut weights)?;
            ratio.push(weights.iter().sum::<f64>() / PI);
        }
        Ok(SphereRatio { column, name, is_ideal: i < 2, ratio })
    };
    spheres.into_iter().enumerate().map(one).collect()
}
