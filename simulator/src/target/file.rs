//! Keys of a `target.toml`, and how the file becomes a [`Target`].
//!
//! ```
//! let text = r#"
//! name = "box_and_wing"
//!
//! [[part]]                      # one or more
//! name = "body"
//! shape = "box"                 # box, plate, sphere, cylinder, cone, dish, prism, mesh
//! size_m = [1, 1, 2]
//! material = "white"            # a [[material]] of this file, or a built-in one
//!
//! [[part]]
//! name = "wing"
//! shape = "plate"               # in its own xy-plane, two faces back to back
//! size_m = [2, 1.2]
//! faces = ["+z"]                # all of them where it does not say
//! material = "cells"
//! euler_zyx_deg = [90, 0, 90]   # or quaternion = [w, x, y, z]: from the part's axes to the body's
//! offset_m = [0, 1.6, 0]        # after the rotation
//! hinge = "boom"
//!
//! [[hinge]]
//! name = "boom"
//! point_m = [0, 0, 0]           # body axes
//! axis = [0, 1, 0]
//! face = [1, 0, 0]              # turned to the Sun; perpendicular to the axis
//! range_deg = [-180, 180]       # left out where it turns freely
//! ## offset_deg = 5              # turned past the Sun by so much: a lag or a bias; 180 for a wing that shows its back
//! ## parked_deg = 30             # stands at this angle and follows nothing
//!
//! [[material]]                  # see surface::file
//! name = "cells"
//! model = "lambert"
//! reflectance = 0.1
//! "#;
//! use glam::DVec3;
//! use sunglint_simulator::target::Target;
//!
//! let target = Target::parse("target.toml", text)?;
//! assert_eq!((target.parts.len(), target.materials[1].name.as_str()), (2, "cells"));
//! // The Sun below: the hinge turns the wing's face from +x by a quarter about +y.
//! let angles = target.hinge_angles_rad(DVec3::NEG_Z);
//! assert!((angles[0].to_degrees() - 90.0).abs() < 1e-12);
//! let wing = target.part_mesh(1, &angles);
//! assert!(wing.normal(0).is_some_and(|n| n.distance(DVec3::NEG_Z) < 1e-15));
//! # Ok::<(), sunglint_formats::FileError>(())
//! ```
//!
//! | shape | needs | may have |
//! |---|---|---|
//! | box | `size_m = [x, y, z]` | `faces` of `"+x"` … `"-z"` |
//! | plate | `size_m = [x, y]` | `faces` of `"+z"`, `"-z"` |
//! | sphere | `radius_m` | `subdivisions` (then it is a mesh of 20·4ⁿ triangles), `faceting`, `smooth` |
//! | cylinder | `radius_m`, `height_m` | `facets`, `faceting`, `smooth`, `faces` of `"side"`, `"side0"` …, `"+z"`, `"-z"` |
//! | cone | the same | also `top_radius_m` (0) |
//! | dish | `radius_m`, `depth_m` | `form`: `"paraboloid"`, `"sphere"`; `faces` of `"inside"`, `"outside"` |
//! | prism | `height_m`, and `radius_m` (to the corners) or `width_m` (between opposite sides) | `sides` (6), `faces` |
//! | mesh | `file` | `group`, `unit`, `scale`, `flip`, `weld_mm`, `smooth`, `crease_deg` (30) |
//!
//! Spheres, cylinders, cones and dishes are round ([`Curved`]): their outline and their normals are exact. `facets` makes a cylinder or
//! a cone of flat sides; so do faces that are left out (an open tube), 64 unless it says. A dish has its lowest point at the part's origin
//! and opens towards +z. `smooth = true` takes triangles for what they stand for: a bent surface through their corners with the file's
//! normals, or, without those or with `crease_deg`, with normals made from the triangles around each corner that lean by less.
//!
//! Cylinders, cones and prisms stand along z about their middle; side 0 faces +x, the others follow towards +y. `faceting` is `"inscribed"`
//! (default) or `"same_area"` ([`Faceting`]). `euler_zyx_deg = [a, b, c]` turns the part by a about its z, then by b about its new y, then
//! by c about its newest x (intrinsic z-y'-x''): R = Rz(a) Ry(b) Rx(c). Every part may have a `tangent` (its own axes, default x),
//! from which anisotropic materials take their direction, and a `note`.

#[cfg(doc)]
use super::Curved;
use super::materials::Shelf;
use super::part::{self, Files};
use super::{DishForm, Hinge, Part, Placement, Target};
use crate::attitude::{euler_zyx, quaternion_wxyz};
use crate::mesh::faults::FARTHEST_M;
use crate::mesh::shapes::Faceting;
use crate::ranging::cubes::RetroFile;
use glam::{DQuat, DVec3};
use serde::Deserialize;
use sha2::{Digest as _, Sha256};
use sunglint_formats::toml::{Document, Finite, NonNegative, Positive};
use sunglint_formats::{FileError, ParseError, nearest_names};

pub use crate::surface::file::MaterialFile;

/// A target as it stands in a file: parts, or the name of a file or of a built-in target.
#[derive(Debug, Clone, Deserialize, Default)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "the keys of the file, described in the module")]
pub struct TargetFile {
    pub name: Option<String>,
    #[serde(default)]
    pub description: String,
    /// Another target.toml in place of parts (only where a target stands within another file).
    pub file: Option<String>,
    /// A built-in target in place of parts.
    pub built_in: Option<String>,
    #[serde(default)]
    pub part: Vec<PartFile>,
    #[serde(default)]
    pub hinge: Vec<HingeFile>,
    #[serde(default)]
    pub material: Vec<MaterialFile>,
    /// Rings of corner cubes.
    #[serde(default)]
    pub retro: Vec<RetroFile>,
}

/// The shapes that a part can have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs, reason = "the words of the file, described in the module")]
pub enum ShapeKind {
    Box,
    Plate,
    Sphere,
    Cylinder,
    Cone,
    Dish,
    Prism,
    Mesh,
}

/// The units in which a mesh may have been drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs, reason = "the words of the file")]
pub enum LengthUnit {
    M,
    Cm,
    Mm,
    Inch,
}

impl LengthUnit {
    /// Returns the length of the unit, m.
    pub fn metres(self) -> f64 {
        match self {
            Self::M => 1.0,
            Self::Cm => 1e-2,
            Self::Mm => 1e-3,
            Self::Inch => 0.0254,
        }
    }
}

/// One `[[part]]`.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "the keys of the file, described in the module")]
pub struct PartFile {
    pub name: String,
    pub shape: ShapeKind,
    pub material: String,
    pub size_m: Option<Vec<Positive>>,
    pub radius_m: Option<Positive>,
    pub top_radius_m: Option<NonNegative>,
    pub width_m: Option<Positive>,
    pub height_m: Option<Positive>,
    pub facets: Option<u32>,
    pub sides: Option<u32>,
    pub subdivisions: Option<u32>,
    pub faceting: Option<Faceting>,
    pub faces: Option<Vec<String>>,
    pub file: Option<String>,
    pub group: Option<String>,
    pub unit: Option<LengthUnit>,
    pub scale: Option<Positive>,
    pub flip: Option<bool>,
    pub weld_mm: Option<Positive>,
    pub depth_m: Option<Positive>,
    pub form: Option<DishForm>,
    pub smooth: Option<bool>,
    pub crease_deg: Option<Positive>,
    pub offset_m: Option<[Finite; 3]>,
    pub quaternion: Option<[Finite; 4]>,
    pub euler_zyx_deg: Option<[Finite; 3]>,
    pub tangent: Option<[Finite; 3]>,
    pub hinge: Option<String>,
    #[serde(default)]
    pub note: String,
}

/// One `[[hinge]]`.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs, reason = "the keys of the file, described in the module")]
pub struct HingeFile {
    pub name: String,
    pub point_m: [Finite; 3],
    pub axis: [Finite; 3],
    pub face: [Finite; 3],
    pub range_deg: Option<[Finite; 2]>,
    pub offset_deg: Option<Finite>,
    pub parked_deg: Option<Finite>,
    #[serde(default)]
    pub note: String,
}

/// Builds the target of a table at a dotted key of a document (`""` for the whole document, `"target"` for `[target]`).
///
/// # Errors
/// [`FileError`] with file, line and key: keys that a shape does not use or lacks, names that are unknown or there twice, a mesh or
/// a spectrum that cannot be read.
pub fn target(document: &Document, at: &str, file: &TargetFile) -> Result<Target, FileError> {
    let parts_too = !file.part.is_empty()
        || !file.hinge.is_empty()
        || !file.material.is_empty()
        || !file.retro.is_empty();
    match (&file.file, &file.built_in) {
        (None, None) => {}
        (Some(_), None) if at.is_empty() => {
            let expected = "[[part]] tables: a target's file does not stand for another one";
            return Err(document.error_at("file", expected).into());
        }
        (Some(_), Some(_)) => {
            let expected = "either file or built_in, not both";
            return Err(document.error_at(&key(at, "file"), expected).into());
        }
        (other, _) => {
            let word = if other.is_some() { "file" } else { "built_in" };
            if parts_too {
                let expected = format!("either {word}, or [[part]], [[hinge]] and [[material]]");
                return Err(document.error_at(&key(at, word), expected).into());
            }
            let mut target = elsewhere(document, at, file)?;
            target.name = file.name.clone().unwrap_or(target.name);
            return Ok(target);
        }
    }
    if file.part.is_empty() {
        let expected = if at.is_empty() {
            "at least one [[part]]"
        } else {
            "file, built_in, or at least one part"
        };
        return Err(document.error_at(&key(at, "part"), expected).into());
    }
    build(document, at, file)
}

fn elsewhere(document: &Document, at: &str, file: &TargetFile) -> Result<Target, FileError> {
    if let Some(name) = &file.file {
        return Target::read(document.resolve(name)).map_err(|error| {
            not_there(document, &key(at, "file"), "a target.toml that can be read", error)
        });
    }
    let name = file.built_in.as_deref().unwrap_or_default();
    Target::built_in(name).ok_or_else(|| {
        let names = Target::built_in_names();
        unknown(document, &key(at, "built_in"), "a built-in target", name, &names).into()
    })
}

fn build(document: &Document, at: &str, file: &TargetFile) -> Result<Target, FileError> {
    let stem = || document.path().file_stem().map(|s| s.to_string_lossy().into_owned());
    let name = file.name.clone().or_else(stem).unwrap_or_default();
    let mut target = Target { name, ..Target::default() };
    for (i, hinge_file) in file.hinge.iter().enumerate() {
        let at = key(at, &format!("hinge[{i}]"));
        let hinge = hinge(document, &at, hinge_file)?;
        check_name(document, &at, &hinge.name, target.hinges.iter().map(|h| h.name.as_str()))?;
        target.hinges.push(hinge);
    }
    for (i, ring) in file.retro.iter().enumerate() {
        let at = key(at, &format!("retro[{i}]"));
        target.retros.cubes.extend(ring.cubes(document, &at)?);
    }
    let mut shelf = Shelf::new(document, at, &file.material)?;
    let mut files = Files::default();
    for (i, part_file) in file.part.iter().enumerate() {
        let at = key(at, &format!("part[{i}]"));
        let names = target.parts.iter().map(|p| p.name.as_str());
        check_name(document, &at, &part_file.name, names)?;
        let part = Part {
            name: part_file.name.clone(),
            shape: part::shape(document, &at, part_file, &mut files)?,
            material: shelf.index(&key(&at, "material"), &part_file.material)?,
            placement: placement(document, &at, part_file)?,
            hinge: hinge_of(document, &at, part_file, &target.hinges)?,
            tangent: tangent(document, &at, part_file)?,
        };
        target.parts.push(part);
    }
    target.warnings = files.warnings();
    // Those of files are examined with their file.
    let inline = target.parts.iter().zip(&file.part).filter(|(_, file)| file.file.is_none());
    target.warnings.extend(inline.filter_map(|(part, _)| part.size_warning()).collect::<Vec<_>>());
    target.sources = files.sources;
    let (materials, idle, sources) = shelf.finish();
    target.materials = materials;
    target.sources.extend(sources);
    target
        .warnings
        .extend(idle.iter().map(|name| format!("no part is made of the material {name}")));
    for (i, hinge) in target.hinges.iter().enumerate() {
        if !target.parts.iter().any(|part| part.hinge == Some(i)) {
            target.warnings.push(format!("the hinge {} moves no part", hinge.name));
        }
    }
    Ok(target)
}

/// The dotted key of a name within a table.
pub(super) fn key(at: &str, name: &str) -> String {
    if at.is_empty() { name.to_owned() } else { format!("{at}.{name}") }
}

/// A name that nothing has, with the ones that there are and the nearest of them.
pub(super) fn unknown(
    document: &Document,
    key: &str,
    what: &str,
    name: &str,
    known: &[&str],
) -> ParseError {
    let error = if known.is_empty() {
        document.error_at(key, format!("{what}: there is none"))
    } else {
        document.error_at(key, format!("{what}: {}", known.join(", ")))
    };
    match nearest_names(name, known.iter().copied(), 1).first() {
        Some(near) => error.with_hint(format!("did you mean \"{near}\"?")),
        None => error,
    }
}

/// A file that cannot be read at all, at the key that names it.
pub(super) fn not_there(
    document: &Document,
    key: &str,
    expected: &str,
    error: FileError,
) -> FileError {
    match error {
        FileError::Io { path, source, .. } => {
            let hint = format!("{}: {source}", path.display());
            document.error_at(key, expected).with_hint(hint).into()
        }
        error => error,
    }
}

/// SHA-256 as hexadecimal digits.
pub(super) fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

fn check_name<'a>(
    document: &Document,
    at: &str,
    name: &str,
    mut others: impl Iterator<Item = &'a str>,
) -> Result<(), ParseError> {
    let key = key(at, "name");
    if name.trim().is_empty() || name.chars().any(char::is_control) {
        return Err(document.error_at(&key, "a name"));
    }
    if others.any(|other| other == name) {
        return Err(document.error_at(&key, "a name that no other has"));
    }
    Ok(())
}

fn vector(values: [Finite; 3]) -> DVec3 {
    DVec3::from_array(values.map(Finite::get))
}

/// A place whose squared distance from others is still a number.
fn near(document: &Document, key: &str, place_m: DVec3) -> Result<DVec3, ParseError> {
    if place_m.abs().max_element() <= FARTHEST_M {
        Ok(place_m)
    } else {
        Err(document.error_at(key, format!("coordinates of at most {FARTHEST_M:e} m")))
    }
}

/// A direction, made a unit vector.
fn direction(document: &Document, key: &str, values: [Finite; 3]) -> Result<DVec3, ParseError> {
    vector(values)
        .try_normalize()
        .ok_or_else(|| document.error_at(key, "a direction: not all three 0"))
}

fn hinge(document: &Document, at: &str, file: &HingeFile) -> Result<Hinge, ParseError> {
    let axis = direction(document, &key(at, "axis"), file.axis)?;
    let face = direction(document, &key(at, "face"), file.face)?;
    let lean = axis.dot(face);
    if lean.abs() > 1e-6 {
        let expected = "a direction perpendicular to the axis (within 1e-6 rad)";
        let angle_deg = lean.clamp(-1.0, 1.0).acos().to_degrees();
        let hint = format!("it stands at {angle_deg:.6} degrees to the axis");
        return Err(document.error_at(&key(at, "face"), expected).with_hint(hint));
    }
    // What is left of the lean is rounding of the file's digits.
    let face = (face - lean * axis).normalize();
    let turns = |name: &str, angle: Option<Finite>| match angle.map(Finite::get) {
        Some(deg) if !(-360.0..=360.0).contains(&deg) => {
            let hint = format!("it is {deg}");
            Err(document.error_at(&key(at, name), "-360 to 360 degrees").with_hint(hint))
        }
        deg => Ok(deg.map(f64::to_radians)),
    };
    let offset = turns("offset_deg", file.offset_deg)?;
    let parked = turns("parked_deg", file.parked_deg)?;
    if parked.is_some() && (offset.is_some() || file.range_deg.is_some()) {
        let expected = "parked_deg alone: a hinge that stands follows nothing, so that it has neither offset_deg nor range_deg";
        return Err(document.error_at(&key(at, "parked_deg"), expected));
    }
    // The direction that is turned to the Sun lies before the face by the offset.
    let face = match offset {
        Some(offset) => DQuat::from_axis_angle(axis, -offset) * face,
        None => face,
    };
    let range_rad = match file.range_deg.map(|range| range.map(Finite::get)) {
        None => None,
        Some([least, most]) if -360.0 <= least && least <= most && most <= 360.0 => {
            Some((least.to_radians(), most.to_radians()))
        }
        Some(_) => {
            let expected = "[least, most] with -360 <= least <= most <= 360";
            return Err(document.error_at(&key(at, "range_deg"), expected));
        }
    };
    let point_m = near(document, &key(at, "point_m"), vector(file.point_m))?;
    let range_rad = parked.map(|angle| (angle, angle)).or(range_rad);
    Ok(Hinge { name: file.name.clone(), point_m, axis, face, range_rad })
}

fn hinge_of(
    document: &Document,
    at: &str,
    file: &PartFile,
    hinges: &[Hinge],
) -> Result<Option<usize>, ParseError> {
    let Some(name) = &file.hinge else { return Ok(None) };
    let found = hinges.iter().position(|hinge| hinge.name == *name);
    found.map(Some).ok_or_else(|| {
        let known: Vec<&str> = hinges.iter().map(|h| h.name.as_str()).collect();
        unknown(document, &key(at, "hinge"), "the name of a [[hinge]]", name, &known)
    })
}

fn placement(document: &Document, at: &str, file: &PartFile) -> Result<Placement, ParseError> {
    let rotation = match (file.quaternion, file.euler_zyx_deg) {
        (Some(_), Some(_)) => {
            let expected = "either quaternion or euler_zyx_deg, not both";
            return Err(document.error_at(&key(at, "quaternion"), expected));
        }
        (Some(q), None) => {
            let expected = "a unit quaternion [w, x, y, z]";
            quaternion_wxyz(q.map(Finite::get)).map_err(|error| {
                document.error_at(&key(at, "quaternion"), expected).with_hint(error.to_string())
            })?
        }
        (None, Some(angles)) => {
            let [z, y, x] = angles.map(|a| a.get().to_radians());
            euler_zyx(z, y, x)
        }
        (None, None) => DQuat::IDENTITY,
    };
    let offset_m = file.offset_m.map_or(DVec3::ZERO, vector);
    Ok(Placement { rotation, offset_m: near(document, &key(at, "offset_m"), offset_m)? })
}

fn tangent(document: &Document, at: &str, file: &PartFile) -> Result<DVec3, ParseError> {
    file.tangent.map_or(Ok(DVec3::X), |t| direction(document, &key(at, "tangent"), t))
}
