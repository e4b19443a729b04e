//! A body made of parts: each a shape with a material, in its place, perhaps on a hinge.
//!
//! A target comes from a `target.toml` ([`Target::read`]; its keys are described in [`mod@file`]), from the tables of a larger file
//! ([`file::target`]), or is built in ([`Target::built_in`]).

mod built_in;
mod curved;
pub mod file;
mod materials;
mod part;
mod placed;

pub(crate) use curved::cap_radius_m;
pub use curved::{Curved, DishForm};
pub use file::TargetFile;

use crate::mesh::Mesh;
use crate::mesh::faults::LARGE_M;
use crate::ranging::cubes::Array;
use crate::surface::Material;
use glam::{DQuat, DVec3};
use std::path::Path;
use sunglint_formats::FileError;
use sunglint_formats::toml::Document;

/// Reflecting body: parts, their materials and hinges, in the body's own axes, metres.
#[derive(Debug, Clone, Default)]
pub struct Target {
    /// Name in files and reports.
    pub name: String,
    /// Parts of the target.
    pub parts: Vec<Part>,
    /// The materials that the parts name.
    pub materials: Vec<Material>,
    /// The hinges that the parts name.
    pub hinges: Vec<Hinge>,
    /// Corner cubes, which answer lasers alone.
    pub retros: Array,
    /// Warnings for the user: faults of meshes, sizes that look like millimetres.
    pub warnings: Vec<String>,
    /// The files that went in, with their SHA-256.
    pub sources: Vec<(std::path::PathBuf, String)>,
}

impl Target {
    /// Reads a `target.toml`, the meshes and the spectra that it names.
    ///
    /// # Errors
    /// [`FileError`] with file, line and key.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, FileError> {
        Self::read_at(path.as_ref())
    }

    fn read_at(path: &Path) -> Result<Self, FileError> {
        let bytes = sunglint_formats::read::bytes(path)?;
        let hash = file::sha256(&bytes);
        let mut target = Self::parse(path, sunglint_formats::read::decode(path, bytes)?)?;
        target.sources.insert(0, (path.to_path_buf(), hash));
        Ok(target)
    }

    /// A target from the text of its file; `path` names it in errors, and meshes are found relative to it.
    ///
    /// # Errors
    /// [`FileError`] with file, line and key.
    pub fn parse(path: impl AsRef<Path>, text: impl Into<String>) -> Result<Self, FileError> {
        Self::of_document(&Document::new(path, text)?)
    }

    fn of_document(document: &Document) -> Result<Self, FileError> {
        let file: TargetFile = document.parse()?;
        file::target(document, "", &file)
    }
}

/// One part of a target.
#[derive(Debug, Clone, PartialEq)]
pub struct Part {
    /// Name of the part, unique in the target.
    pub name: String,
    /// Shape of the part, in its own axes.
    pub shape: Shape,
    /// Index into [`Target::materials`].
    pub material: usize,
    /// Where it sits in the body (with every hinge at angle 0).
    pub placement: Placement,
    /// Index into [`Target::hinges`] where it moves.
    pub hinge: Option<usize>,
    /// The direction, in the part's axes, that each facet takes its x axis from: projected on the facet. For materials that reflect
    /// differently along and across. A facet that it stands on (within 1e-6) takes the next of the part's axes x, y, z instead.
    pub tangent: DVec3,
}

impl Part {
    /// Returns a warning about a part that is larger than anything in orbit: somebody may have written millimetres.
    pub fn size_warning(&self) -> Option<String> {
        let size_m = match &self.shape {
            Shape::Mesh(mesh) => mesh.bounds()?.size_m().max_element(),
            Shape::Sphere { radius_m } => 2.0 * radius_m,
            Shape::Curved(curved) => curved.size_m().max_element(),
        };
        (size_m > LARGE_M).then(|| {
            format!("the part {} measures {size_m:.1} m: are its sizes millimetres?", self.name)
        })
    }
}

/// A shape.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// Triangles: flat, or bent by their normals.
    Mesh(Mesh),
    /// A sphere about the part's origin.
    Sphere {
        /// Radius, m.
        radius_m: f64,
    },
    /// A cylinder, a cone or a dish.
    Curved(Curved),
}

/// Where a part sits: turned, then moved.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// Rotation from the part's axes to the body's.
    pub rotation: DQuat,
    /// The part's origin in the body's axes, m.
    pub offset_m: DVec3,
}

impl Default for Placement {
    fn default() -> Self {
        Self { rotation: DQuat::IDENTITY, offset_m: DVec3::ZERO }
    }
}

impl Placement {
    /// A point of the part in the body's axes.
    pub fn point(&self, point_m: DVec3) -> DVec3 {
        self.rotation * point_m + self.offset_m
    }
}

/// An axis about which parts turn towards the Sun.
#[derive(Debug, Clone, PartialEq)]
pub struct Hinge {
    /// Name in files and reports.
    pub name: String,
    /// A point of the axis in the body's axes, m.
    pub point_m: DVec3,
    /// Unit vector along the axis, body axes.
    pub axis: DVec3,
    /// Unit vector perpendicular to the axis, body axes: the direction at angle 0 that is turned to the Sun.
    pub face: DVec3,
    /// The angles that it reaches, radians; `None` where it turns freely.
    pub range_rad: Option<(f64, f64)>,
}

impl Hinge {
    /// The angle (radians, −π to π, right-handed about the axis) that brings `face` nearest to the Sun within the hinge's range.
    /// Where the Sun stands on the axis every angle is as good: 0, or the nearest of the range.
    pub fn angle_rad(&self, sun_body: DVec3) -> f64 {
        let across = self.axis.cross(self.face);
        let (x, y) = (sun_body.dot(self.face), sun_body.dot(across));
        let free = if x.hypot(y) < 1e-12 { 0.0 } else { y.atan2(x) };
        let Some((least, most)) = self.range_rad else { return free };
        // Of the range's two ends and the free angle (in any turn), the one that faces the Sun best.
        let turns = [0.0, -1.0, 1.0].map(|turn| free + turn * std::f64::consts::TAU);
        if let Some(angle) = turns.into_iter().find(|a| (least..=most).contains(a)) {
            return angle;
        }
        if (least - free).cos() > (most - free).cos() { least } else { most }
    }

    /// Where a point of the body (at angle 0) is at an angle.
    pub fn point(&self, angle_rad: f64, point_m: DVec3) -> DVec3 {
        self.point_m + DQuat::from_axis_angle(self.axis, angle_rad) * (point_m - self.point_m)
    }
}
