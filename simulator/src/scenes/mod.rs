//! The scenes of the bench: bodies, directions and a Sun on which light engines are compared, with truths that are not ours.
//!
//! Names, dimensions, directions and attitudes are those of the scenes on which Mitsuba 3 was measured, so that both programs can be asked the same
//! question. The question is the radiant intensity of singly scattered sunlight under a collimated Sun: as a grey number I/E \[m² sr⁻¹\] with one
//! reflectance for each material (its mean over 300 to 1240 nm), and as 188 means over bins of 5 nm \[W sr⁻¹ nm⁻¹\] under a black-body Sun.
//!
//! Truths are closed forms, or sums that another program made (stored, with how they were made, in `simulator/scenes`).

mod bodies;

use crate::target::Target;
use glam::{DQuat, DVec3};
use std::f64::consts::PI;
use sunglint_formats::{Table, ecsv};
use sunglint_radiometry::constants::{
    AU_M, BOLTZMANN_J_PER_K, LIGHT_M_PER_S, PLANCK_J_S, SUN_RADIUS_M,
};
use sunglint_radiometry::quadrature::Product;
use sunglint_radiometry::spectrum::{Irradiance, Reflectance, Spectrum, SpectrumError};

/// The scenes, in the order of the bench.
pub const NAMES: [&str; 6] =
    ["lambert_sphere", "box_wing", "box_wing_diffuse", "corner", "dense_sphere", "dense_satellite"];

/// Bins of the spectra.
pub const BINS: usize = 188;
/// First and last edge of the bins, nm.
pub const RANGE_NM: (f64, f64) = (300.0, 1240.0);
/// Temperature of the black body that stands for the Sun, K.
const SUN_K: f64 = 5772.0;

/// A body, the Sun and an observer.
#[derive(Debug, Clone)]
pub struct BenchScene {
    /// One of [`NAMES`].
    pub name: &'static str,
    /// Description of the scene.
    pub description: &'static str,
    /// The body.
    pub target: Target,
    /// Unit vector to the Sun, body axes.
    pub sun_body: DVec3,
    /// Unit vector to the observer, body axes.
    pub view_body: DVec3,
    /// Rotation from the body's axes to those of the world, in which the other program is asked.
    pub body_to_world: DQuat,
    /// The truth, where there is one.
    pub truth: Option<Truth>,
}

/// Where a truth is from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum TruthSource {
    /// A formula.
    ClosedForm,
    /// Sums of another program, stored.
    Stored,
}

impl TruthSource {
    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::ClosedForm => "closed form",
            Self::Stored => "stored",
        }
    }
}

/// Light that a scene sends to its observer, found by another way than ours.
#[derive(Debug, Clone, PartialEq)]
pub struct Truth {
    /// Where it is from.
    pub source: TruthSource,
    /// I/E with grey materials, m² sr⁻¹.
    pub grey_m2_sr: f64,
    /// Means of I over [`BINS`] bins, W sr⁻¹ nm⁻¹.
    pub bins_w_sr_nm: Vec<f64>,
}

/// Why a scene could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BenchSceneError {
    /// No scene of that name.
    #[error("there is no bench scene `{0}`; there are {list}", list = NAMES.join(", "))]
    Unknown(String),
    /// An embedded table that does not hold what it should.
    #[error("the embedded truths of the bench scenes: {0}")]
    Embedded(String),
}

impl BenchScene {
    /// A scene by its name.
    ///
    /// # Errors
    /// A name that is none of [`NAMES`].
    pub fn new(name: &str) -> Result<Self, BenchSceneError> {
        let unknown = || BenchSceneError::Unknown(name.to_owned());
        let &name = NAMES.iter().find(|known| **known == name).ok_or_else(unknown)?;
        // The phase angle in degrees, in the half-plane of `toward`.
        let (description, sun, toward, phase_deg) = match name {
            "lambert_sphere" => (
                "a Lambert sphere of 1 m, reflectance 1",
                DVec3::X,
                DVec3::new(0.0, 1.0, 0.3),
                60.0_f64,
            ),
            "dense_sphere" => {
                ("the sphere as 114,688 flat triangles", DVec3::X, DVec3::new(0.0, 1.0, 0.3), 60.0)
            }
            "corner" => (
                "two plates at a right angle and a box in the fold, grey and diffuse",
                DVec3::new(0.7, 0.3, 0.6),
                DVec3::new(0.6, -0.5, 0.7),
                40.0,
            ),
            _ => (
                match name {
                    "box_wing" => {
                        "a box with two canted wings; four materials, three of them rough metals"
                    }
                    "box_wing_diffuse" => "the box-wing satellite, grey and diffuse",
                    _ => "the box-wing satellite with 2,400 small domes: 115,244 triangles",
                },
                DVec3::new(0.70, 0.60, 0.25),
                DVec3::new(0.8, 0.05, -0.5),
                60.0,
            ),
        };
        let sun_body = sun.normalize();
        let across = (toward - sun_body * toward.dot(sun_body)).normalize();
        let phase = phase_deg.to_radians();
        let body_to_world = if name.ends_with("sphere") {
            DQuat::IDENTITY
        } else {
            // w = 0.9 first, as files have it.
            DQuat::from_xyzw(0.2, -0.3, 0.25, 0.9).normalize()
        };
        let target = bodies::target(name).ok_or_else(unknown)?;
        let truth = if name == "lambert_sphere" {
            Some(sphere_truth(phase))
        } else {
            stored_truth(name).map_err(BenchSceneError::Embedded)?
        };
        Ok(Self {
            name,
            description,
            target,
            sun_body,
            view_body: phase.cos() * sun_body + phase.sin() * across,
            body_to_world,
            truth,
        })
    }
}

/// The edges of the bins, nm.
pub fn edges_nm() -> Vec<f64> {
    let (first, last) = RANGE_NM;
    (0..=BINS).map(|k| first + (last - first) * k as f64 / BINS as f64).collect()
}

/// π B_λ(5772 K) (R☉/au)² at the edges of the bins, linear between them, W m⁻² nm⁻¹.
pub fn sun() -> Result<Spectrum<Irradiance>, SpectrumError> {
    let edges = edges_nm();
    let value = edges.iter().map(|nm| black_body_sun(*nm)).collect();
    Spectrum::new(edges, value)
}

/// Planck's law for the Sun at 1 au, W m⁻² nm⁻¹.
fn black_body_sun(nm: f64) -> f64 {
    let m = nm * 1e-9;
    let x = PLANCK_J_S * LIGHT_M_PER_S / (m * BOLTZMANN_J_PER_K * SUN_K);
    let radiance = 2.0 * PLANCK_J_S * LIGHT_M_PER_S.powi(2) / m.powi(5) / x.exp_m1();
    PI * radiance * (SUN_RADIUS_M / AU_M).powi(2) * 1e-9
}

/// The mean of a material's spectrum over [`RANGE_NM`]: its reflectance where all is grey.
///
/// # Errors
/// None with spectra that cover the range.
pub fn grey(spectrum: &Spectrum<Reflectance>) -> Result<f64, SpectrumError> {
    let (first, last) = RANGE_NM;
    Ok(Product::of(spectrum).over(first, last)?.value / (last - first))
}

/// Means of E·ρ over the bins, W m⁻² nm⁻¹.
///
/// # Errors
/// None with spectra that cover the range.
pub fn bin_means(spectrum: &Spectrum<Reflectance>) -> Result<Vec<f64>, SpectrumError> {
    let (edges, sun) = (edges_nm(), sun()?);
    let integrals = Product::of(&sun).times(spectrum).bins(&edges)?;
    Ok(integrals.iter().zip(edges.windows(2)).map(|(i, e)| i.value / (e[1] - e[0])).collect())
}

/// I/E of a Lambert sphere of radius 1 m and reflectance 1: 2/(3π) (sin γ + (π − γ) cos γ) (Russell 1916); the mean of a linear piece is that of
/// its ends.
fn sphere_truth(phase_rad: f64) -> Truth {
    let intensity = 2.0 / (3.0 * PI) * (phase_rad.sin() + (PI - phase_rad) * phase_rad.cos());
    let sun: Vec<f64> = edges_nm().into_iter().map(black_body_sun).collect();
    Truth {
        source: TruthSource::ClosedForm,
        grey_m2_sr: intensity,
        bins_w_sr_nm: sun.windows(2).map(|e| 0.5 * (e[0] + e[1]) * intensity).collect(),
    }
}

/// The sums of another program for a scene; `None` where it made none.
fn stored_truth(name: &str) -> Result<Option<Truth>, String> {
    let table = |file: &str, text: &str| -> Result<Table, String> {
        ecsv::read_str(format!("embedded:{file}"), text).map_err(|e| e.to_string())
    };
    let sums = table("exact", include_str!("../../scenes/exact.ecsv"))?;
    let spectra = table("spectra", include_str!("../../scenes/spectra.ecsv"))?;
    if !spectra.columns.iter().any(|c| c.name == name) {
        return Ok(None);
    }
    let words = |e: sunglint_formats::TableError| e.to_string();
    let scenes = sums.text("scene").map_err(words)?;
    let weights = sums.quantity("weight_m2_sr", "m2 / sr").map_err(words)?;
    let grey = sums.f64("grey_reflectance").map_err(words)?;
    let rows = scenes.iter().enumerate().filter(|(_, scene)| scene.as_deref() == Some(name));
    let bins = spectra.quantity(name, "W / (sr nm)").map_err(words)?;
    Ok(Some(Truth {
        source: TruthSource::Stored,
        grey_m2_sr: rows.map(|(i, _)| weights[i] * grey[i]).sum(),
        bins_w_sr_nm: bins.into_owned(),
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::target::Shape;

    fn triangles(scene: &BenchScene) -> usize {
        let of = |shape: &Shape| match shape {
            Shape::Mesh(mesh) => mesh.triangles.len(),
            _ => 0,
        };
        scene.target.parts.iter().map(|part| of(&part.shape)).sum()
    }

    /// Truth: `tri_count` of the comparison script. Each scene has a truth, and directions of length 1.
    #[test]
    fn the_scenes_are_those_of_the_other_program() {
        let counts = [0, 44, 44, 36, 114_688, 115_244];
        for (name, count) in NAMES.into_iter().zip(counts) {
            let scene = BenchScene::new(name).unwrap();
            assert_eq!(triangles(&scene), count, "{name}");
            for direction in [scene.sun_body, scene.view_body] {
                assert!((direction.length() - 1.0).abs() < 1e-15, "{name}");
            }
            let truth = scene.truth.unwrap();
            assert!(truth.grey_m2_sr > 0.0 && truth.bins_w_sr_nm.len() == BINS, "{name}");
        }
        let error = BenchScene::new("box").unwrap_err().to_string();
        assert!(
            error.contains("there is no bench scene `box`; there are lambert_sphere, box_wing")
        );
    }

    /// Truth: the volume of a polyhedron inscribed in a sphere is below 4π/3 by little; of 2,400 octagonal domes the sum, outward everywhere.
    #[test]
    fn dense_bodies_face_outward() {
        let mesh = |name: &str, part: usize| match BenchScene::new(name).unwrap().target.parts[part]
            .shape
        {
            Shape::Mesh(ref mesh) => mesh.clone(),
            ref other => panic!("{name} is {other:?}"),
        };
        let sphere = mesh("dense_sphere", 0).signed_volume_m3() / (4.0 * PI / 3.0);
        assert!((0.9997..1.0).contains(&sphere), "{sphere}");
        // Rings at 45° steps of polar angle with corners at 45° steps of azimuth: two cones and two frusta over octagons of area 2√2 r².
        let r = 0.015_f64;
        let area = |r: f64| 2.0 * 2.0_f64.sqrt() * r * r;
        let half = 0.5_f64.sqrt();
        let (big, small) = (area(r), area(r * half));
        let cap = small * r * (1.0 - half) / 3.0;
        let belt = r * half * (big + small + (big * small).sqrt()) / 3.0;
        let domes = mesh("dense_satellite", 9).signed_volume_m3();
        assert!((domes / (2400.0 * 2.0 * (cap + belt)) - 1.0).abs() < 1e-9, "{domes}");
    }

    /// Truth: σT⁴(R☉/au)² = 1361.16 W/m² at 5772 K, of which the series of Planck's fractional function gives 0.785145 between 300 and 1240 nm.
    /// Tolerance 1e-4: chords of 5 nm under or over a curve.
    #[test]
    fn the_sun_is_as_bright_as_it_should_be() {
        let total = Product::of(&sun().unwrap()).integral().value;
        assert!((total / (1361.163 * 0.785_145_4) - 1.0).abs() < 1e-4, "{total}");
    }
}
