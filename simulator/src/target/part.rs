//! The shape of a `[[part]]`.

use super::file::{PartFile, ShapeKind, key, not_there, sha256, unknown};
use super::{Curved, DishForm, Shape};
use crate::mesh::faults::FARTHEST_M;
use crate::mesh::shapes::{
    Faceting, Side, Walls, corner_radius_m, cuboid, frustum, icosphere, plate,
};
use crate::mesh::{Mesh, NamedMesh, read};
use glam::{DVec2, DVec3};
use std::path::PathBuf;
use sunglint_formats::toml::{Document, NonNegative, Positive};
use sunglint_formats::{FileError, ParseError};

/// Flat sides of a cylinder or a cone where the file does not say.
const FACETS: u32 = 64;
/// Edges sharper than this stay edges where a mesh is smoothed.
const CREASE_DEG: f64 = 30.0;
/// More flat sides than light can tell from round.
const MOST_FACETS: u32 = 100_000;
/// 20·4⁸ is 1.3 million triangles.
const MOST_SUBDIVISIONS: u32 = 8;

/// The meshes that parts have named, each read once.
#[derive(Default)]
pub(super) struct Files {
    read: Vec<(PathBuf, Vec<NamedMesh>)>,
    /// The parts taken from them, as they are used: file, group, mesh, whether its unit was given.
    taken: Vec<Taken>,
    /// Files that were read, with their SHA-256.
    pub sources: Vec<(PathBuf, String)>,
}

struct Taken {
    path: PathBuf,
    group: Option<String>,
    mesh: Mesh,
    has_unit: bool,
}

impl Files {
    fn pieces(&mut self, path: PathBuf) -> Result<&[NamedMesh], FileError> {
        let known = self.read.iter().position(|(p, _)| *p == path);
        let index = match known {
            Some(index) => index,
            None => {
                let sources = &mut self.sources;
                let pieces = read::read_with(&path, &mut |file| {
                    let bytes = read::bytes(file)?;
                    sources.push((file.to_path_buf(), sha256(&bytes)));
                    Ok(bytes)
                })?;
                self.read.push((path, pieces));
                self.read.len() - 1
            }
        };
        Ok(&self.read[index].1)
    }

    /// Returns the faults of the meshes: the parts of one file together, since its groups may close only with each other.
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        for (path, _) in &self.read {
            let mut parts: Vec<&Taken> = Vec::new();
            for taken in self.taken.iter().filter(|taken| taken.path == *path) {
                // The same piece may be used twice, in two places.
                if !parts.iter().any(|known| known.group == taken.group) {
                    parts.push(taken);
                }
            }
            let has_unit = parts.iter().all(|taken| taken.has_unit);
            let report = Mesh::merged(parts.iter().map(|taken| &taken.mesh)).examine();
            let faults = report.faults.iter().filter(|f| !(has_unit && f.is_about_size()));
            warnings.extend(faults.map(|fault| format!("{}: {fault}", path.display())));
        }
        warnings
    }
}

/// Keys that belong to shapes, whether they are given, and the shapes that use them.
fn check_keys(document: &Document, at: &str, file: &PartFile) -> Result<(), ParseError> {
    use ShapeKind::{Box, Cone, Cylinder, Dish, Mesh, Plate, Prism, Sphere};
    let given: [(&str, bool, &[ShapeKind]); 20] = [
        ("size_m", file.size_m.is_some(), &[Box, Plate]),
        ("radius_m", file.radius_m.is_some(), &[Sphere, Cylinder, Cone, Prism, Dish]),
        ("top_radius_m", file.top_radius_m.is_some(), &[Cone]),
        ("width_m", file.width_m.is_some(), &[Prism]),
        ("height_m", file.height_m.is_some(), &[Cylinder, Cone, Prism]),
        ("facets", file.facets.is_some(), &[Cylinder, Cone]),
        ("sides", file.sides.is_some(), &[Prism]),
        ("subdivisions", file.subdivisions.is_some(), &[Sphere]),
        ("faceting", file.faceting.is_some(), &[Sphere, Cylinder, Cone]),
        ("faces", file.faces.is_some(), &[Box, Plate, Cylinder, Cone, Prism, Dish]),
        ("file", file.file.is_some(), &[Mesh]),
        ("group", file.group.is_some(), &[Mesh]),
        ("unit", file.unit.is_some(), &[Mesh]),
        ("scale", file.scale.is_some(), &[Mesh]),
        ("flip", file.flip.is_some(), &[Mesh]),
        ("weld_mm", file.weld_mm.is_some(), &[Mesh]),
        ("depth_m", file.depth_m.is_some(), &[Dish]),
        ("form", file.form.is_some(), &[Dish]),
        ("smooth", file.smooth.is_some(), &[Cylinder, Cone, Sphere, Mesh]),
        ("crease_deg", file.crease_deg.is_some(), &[Mesh]),
    ];
    let stray = given.iter().find(|(_, given, shapes)| *given && !shapes.contains(&file.shape));
    let Some((name, _, shapes)) = stray else { return Ok(()) };
    let shapes: Vec<String> = shapes.iter().map(|s| format!("{s:?}").to_lowercase()).collect();
    let shape = format!("{:?}", file.shape).to_lowercase();
    let expected =
        format!("no {name}: a {shape} does not use it (it belongs to {})", shapes.join(", "));
    Err(document.error_at(&key(at, name), expected))
}

pub(super) fn shape(
    document: &Document,
    at: &str,
    file: &PartFile,
    files: &mut Files,
) -> Result<Shape, FileError> {
    check_keys(document, at, file)?;
    let this = Maker { document, at, file };
    Ok(match file.shape {
        ShapeKind::Box => {
            let size = DVec3::from_array(this.size("three edges [x, y, z]")?);
            Shape::Mesh(cuboid(size, &this.sides_of_box(&Side::ALL)?))
        }
        ShapeKind::Plate => {
            let size = DVec2::from_array(this.size("two edges [x, y]")?);
            let both = [Side { axis: 2, positive: true }, Side { axis: 2, positive: false }];
            let faces = this.sides_of_box(&both)?;
            Shape::Mesh(plate(size, faces.contains(&both[0]), faces.contains(&both[1])))
        }
        ShapeKind::Sphere => this.sphere()?,
        ShapeKind::Cylinder | ShapeKind::Cone => this.round()?,
        ShapeKind::Prism => this.prism()?,
        ShapeKind::Dish => Shape::Curved(this.dish()?),
        ShapeKind::Mesh => Shape::Mesh(this.mesh(files)?),
    })
}

struct Maker<'a> {
    document: &'a Document,
    at: &'a str,
    file: &'a PartFile,
}

impl Maker<'_> {
    fn wrong(&self, name: &str, expected: impl Into<String>) -> ParseError {
        self.document.error_at(&key(self.at, name), expected)
    }

    fn needed(&self, name: &str, value: Option<Positive>) -> Result<f64, ParseError> {
        let value = value.map(Positive::get).ok_or_else(|| {
            let shape = format!("{:?}", self.file.shape).to_lowercase();
            self.wrong(name, format!("{name}: a {shape} needs it"))
        })?;
        self.near(name, value)
    }

    /// A length whose square is still a number.
    fn near(&self, name: &str, value_m: f64) -> Result<f64, ParseError> {
        if value_m <= FARTHEST_M {
            Ok(value_m)
        } else {
            Err(self.wrong(name, format!("at most {FARTHEST_M:e} m")))
        }
    }

    fn size<const N: usize>(&self, expected: &str) -> Result<[f64; N], ParseError> {
        let sizes = self.file.size_m.iter().flatten();
        let size: Vec<f64> =
            sizes.map(|s| self.near("size_m", s.get())).collect::<Result<_, _>>()?;
        size.try_into().map_err(|_| self.wrong("size_m", expected))
    }

    /// The faces that are asked for among `known`; all of them where the file does not say.
    fn sides_of_box(&self, known: &[Side]) -> Result<Vec<Side>, ParseError> {
        let Some(faces) = &self.file.faces else { return Ok(known.to_vec()) };
        let names: Vec<&str> = known.iter().map(|side| side.name()).collect();
        let mut wanted: Vec<Side> = Vec::new();
        for (i, name) in faces.iter().enumerate() {
            let side = Side::from_name(name).filter(|side| known.contains(side));
            match side {
                Some(side) if !wanted.contains(&side) => wanted.push(side),
                Some(_) => return Err(self.wrong(&format!("faces[{i}]"), "each face once")),
                None => return Err(self.unknown_face(i, name, &names)),
            }
        }
        self.not_empty(faces)?;
        Ok(known.iter().copied().filter(|side| wanted.contains(side)).collect())
    }

    fn unknown_face(&self, i: usize, name: &str, known: &[&str]) -> ParseError {
        let key = key(self.at, &format!("faces[{i}]"));
        unknown(self.document, &key, "a face", name, known)
    }

    fn not_empty(&self, faces: &[String]) -> Result<(), ParseError> {
        if faces.is_empty() { Err(self.wrong("faces", "at least one face")) } else { Ok(()) }
    }

    fn walls(&self, count: usize) -> Result<Walls, ParseError> {
        let Some(faces) = &self.file.faces else { return Ok(Walls::default()) };
        self.not_empty(faces)?;
        let mut walls = Walls { top: false, bottom: false, sides: Some(Vec::new()) };
        for (i, name) in faces.iter().enumerate() {
            let number = name.strip_prefix("side").and_then(|n| n.parse().ok());
            match (name.as_str(), number, &mut walls.sides) {
                ("+z", ..) => walls.top = true,
                ("-z", ..) => walls.bottom = true,
                ("side", ..) => walls.sides = None,
                (_, Some(number), sides) if number < count => {
                    if let Some(sides) = sides {
                        sides.push(number);
                    }
                }
                _ => {
                    let last = format!("side{}", count - 1);
                    return Err(self.unknown_face(i, name, &["side", "side0", &last, "+z", "-z"]));
                }
            }
        }
        Ok(walls)
    }

    fn sphere(&self) -> Result<Shape, ParseError> {
        let radius_m = self.needed("radius_m", self.file.radius_m)?;
        match (self.file.subdivisions, self.file.faceting) {
            (None, None) if self.file.smooth.is_some() => {
                let expected = "also subdivisions: without them the sphere is round";
                Err(self.wrong("smooth", expected))
            }
            (None, None) => Ok(Shape::Sphere { radius_m }),
            (None, Some(_)) => {
                let expected = "also subdivisions: without them the sphere is round";
                Err(self.wrong("faceting", expected))
            }
            (Some(n), _) if n > MOST_SUBDIVISIONS => {
                let expected = format!("at most {MOST_SUBDIVISIONS} (20·4ⁿ triangles)");
                Err(self.wrong("subdivisions", expected))
            }
            (Some(n), faceting) => {
                let mesh = icosphere(radius_m, n, faceting.unwrap_or_default());
                Ok(Shape::Mesh(self.smooth(mesh, std::f64::consts::PI)))
            }
        }
    }

    fn count(&self, name: &str, value: Option<u32>, default: u32) -> Result<usize, ParseError> {
        match value.unwrap_or(default) {
            n if (3..=MOST_FACETS).contains(&n) => Ok(n as usize),
            _ => Err(self.wrong(name, format!("from 3 to {MOST_FACETS}"))),
        }
    }

    fn round(&self) -> Result<Shape, ParseError> {
        let radius_m = self.needed("radius_m", self.file.radius_m)?;
        let height_m = self.needed("height_m", self.file.height_m)?;
        let top_m = match self.file.shape {
            ShapeKind::Cone => {
                self.near("top_radius_m", self.file.top_radius_m.map_or(0.0, NonNegative::get))?
            }
            _ => radius_m,
        };
        let facets = self.count("facets", self.file.facets, FACETS)?;
        if self.file.facets.is_none() && self.is_closed(top_m) {
            if self.file.faceting.is_some() || self.file.smooth.is_some() {
                let name = if self.file.smooth.is_some() { "smooth" } else { "faceting" };
                return Err(self.wrong(name, "also facets: without them the shape is round"));
            }
            let (bottom_radius_m, top_radius_m) = (radius_m, top_m);
            return Ok(Shape::Curved(Curved::Frustum { bottom_radius_m, top_radius_m, height_m }));
        }
        let walls = self.walls(facets)?;
        let faceting = self.file.faceting.unwrap_or(Faceting::Inscribed);
        let corner = |radius_m| corner_radius_m(radius_m, facets, faceting);
        let mesh = frustum(corner(radius_m), corner(top_m), height_m, facets, &walls);
        // Sides are smooth across 2π/facets, ends meet them at the slope of the wall.
        let lean = ((radius_m - top_m) / height_m).atan().abs();
        let crease = (0.5 * (std::f64::consts::FRAC_PI_2 - lean))
            .min(3.0 / f64::from(facets as u32) * std::f64::consts::TAU);
        self.full(self.smooth(mesh, crease))
    }

    /// Whether no face is left out.
    fn is_closed(&self, top_m: f64) -> bool {
        let Some(faces) = &self.file.faces else { return true };
        let has = |name: &str| faces.iter().any(|face| face == name);
        has("side") && has("-z") && (has("+z") || top_m == 0.0) && faces.len() <= 3
    }

    /// Bent triangles where that is asked for.
    fn smooth(&self, mesh: Mesh, crease_rad: f64) -> Mesh {
        if self.file.smooth == Some(true) { mesh.smoothed(crease_rad) } else { mesh }
    }

    fn dish(&self) -> Result<Curved, ParseError> {
        let radius_m = self.needed("radius_m", self.file.radius_m)?;
        let depth_m = self.needed("depth_m", self.file.depth_m)?;
        let form = self.file.form.unwrap_or_default();
        if form == DishForm::Sphere && depth_m > radius_m {
            return Err(self.wrong("depth_m", "at most radius_m: half a sphere"));
        }
        let (mut inside, mut outside) = (true, true);
        if let Some(faces) = &self.file.faces {
            self.not_empty(faces)?;
            (inside, outside) = (false, false);
            for (i, name) in faces.iter().enumerate() {
                match name.as_str() {
                    "inside" => inside = true,
                    "outside" => outside = true,
                    _ => return Err(self.unknown_face(i, name, &["inside", "outside"])),
                }
            }
        }
        Ok(Curved::Dish { radius_m, depth_m, form, inside, outside })
    }

    fn prism(&self) -> Result<Shape, ParseError> {
        let height_m = self.needed("height_m", self.file.height_m)?;
        let sides = self.count("sides", self.file.sides, 6)?;
        let radius_m = match (self.file.radius_m, self.file.width_m) {
            (Some(radius), None) => self.near("radius_m", radius.get())?,
            // Twice the distance of a side from the axis.
            (None, Some(width)) => {
                0.5 * self.near("width_m", width.get())?
                    / (std::f64::consts::PI / sides as f64).cos()
            }
            (Some(_), Some(_)) => {
                return Err(self.wrong("width_m", "either radius_m or width_m, not both"));
            }
            (None, None) => return Err(self.wrong("radius_m", "radius_m or width_m")),
        };
        let walls = self.walls(sides)?;
        self.full(frustum(radius_m, radius_m, height_m, sides, &walls))
    }

    /// A shape that has at least one triangle: the tip of a cone is no face.
    fn full(&self, mesh: Mesh) -> Result<Shape, ParseError> {
        if mesh.triangles.is_empty() {
            return Err(self.wrong("faces", "a face that has an area"));
        }
        Ok(Shape::Mesh(mesh))
    }

    fn mesh(&self, files: &mut Files) -> Result<Mesh, FileError> {
        let Some(name) = &self.file.file else {
            return Err(self.wrong("file", "file: a mesh needs it").into());
        };
        let path = self.document.resolve(name);
        let pieces = files.pieces(path.clone()).map_err(|error| {
            let key = key(self.at, "file");
            not_there(self.document, &key, "a mesh that can be read", error)
        })?;
        let wanted: Vec<&Mesh> = match &self.file.group {
            None => pieces.iter().map(|piece| &piece.mesh).collect(),
            Some(group) => {
                let found: Vec<_> = pieces.iter().filter(|piece| piece.is(group)).collect();
                if found.is_empty() {
                    let mut names: Vec<&str> =
                        pieces.iter().flat_map(|p| &p.names).map(String::as_str).collect();
                    names.sort_unstable();
                    names.dedup();
                    let key = key(self.at, "group");
                    let what = format!("a group of {}", path.display());
                    return Err(unknown(self.document, &key, &what, group, &names).into());
                }
                found.into_iter().map(|piece| &piece.mesh).collect()
            }
        };
        let mut mesh = Mesh::merged(wanted);
        if mesh.triangles.is_empty() {
            let expected = format!("a group of {} with at least one triangle", path.display());
            return Err(self.wrong("group", expected).into());
        }
        let unit = self.file.unit.map_or(1.0, |unit| unit.metres());
        let factor = unit * self.file.scale.map_or(1.0, Positive::get);
        if factor != 1.0 {
            mesh = mesh.scaled(factor);
        }
        if !mesh.vertices.iter().all(|v| v.abs().max_element() <= FARTHEST_M) {
            let expected = format!("a mesh with coordinates below {FARTHEST_M:e} m");
            return Err(self.wrong("file", expected).into());
        }
        if self.file.flip == Some(true) {
            mesh = mesh.flipped();
        }
        if let Some(weld_mm) = self.file.weld_mm {
            let tolerance_m = 1e-3 * weld_mm.get();
            let size_m = mesh.bounds().map_or(0.0, |bounds| bounds.size_m().max_element());
            if tolerance_m > 0.01 * size_m {
                let expected = format!("at most {} mm, a hundredth of the mesh", 10.0 * size_m);
                return Err(self.wrong("weld_mm", expected).into());
            }
            mesh = mesh.welded(tolerance_m);
            if mesh.triangles.is_empty() {
                let expected = "less: no triangle is left, all corners became one";
                return Err(self.wrong("weld_mm", expected).into());
            }
        }
        mesh = self.bent(mesh)?;
        files.taken.push(Taken {
            path,
            group: self.file.group.clone(),
            mesh: mesh.clone(),
            has_unit: self.file.unit.is_some() || self.file.scale.is_some(),
        });
        Ok(mesh)
    }

    /// A mesh with the normals of its file, or with those that its triangles suggest; flat unless that is asked for.
    fn bent(&self, mesh: Mesh) -> Result<Mesh, ParseError> {
        let crease_deg = self.file.crease_deg.map(Positive::get);
        if self.file.smooth != Some(true) {
            if crease_deg.is_some() {
                return Err(self.wrong("crease_deg", "also smooth = true"));
            }
            return Ok(mesh.flat());
        }
        if crease_deg.is_some_and(|angle| angle > 180.0) {
            return Err(self.wrong("crease_deg", "at most 180"));
        }
        if crease_deg.is_none() && !mesh.normals.is_empty() {
            return Ok(mesh);
        }
        Ok(mesh.smoothed(crease_deg.unwrap_or(CREASE_DEG).to_radians()))
    }
}
