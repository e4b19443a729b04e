//! Faults of a mesh: named and counted, never repaired unasked.

use super::overlap::overlaps;
use super::topology::Topology;
use super::{Bounds, Mesh, area_vector, cone_volume};
use glam::DVec3;
use std::fmt;

/// Corners count as one within this fraction of the largest coordinate (and at most 10⁻⁴ of the size): single precision (STL, most PLY
/// and glTF) rounds each coordinate by up to 6·10⁻⁸ of it, and two corners and the edge between them may all be off.
pub const WELD_FRACTION: f64 = 5e-7;
/// A triangle's longest edge over its height, above which it is called a needle.
pub const NEEDLE_RATIO: f64 = 1e4;
/// The same ratio above which it has no area.
pub const FLAT_RATIO: f64 = 1e12;
/// A body larger than this was probably drawn in millimetres, m. (The largest that was ever in orbit measures 109 m.)
pub const LARGE_M: f64 = 200.0;
/// Beyond this nothing is a body, and squares of lengths would no longer tell distances apart, m.
pub const FARTHEST_M: f64 = 1e15;
/// A body smaller than this was probably drawn in another unit, m.
pub const SMALL_M: f64 = 1e-3;

/// How many of something, and where the first one is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Found {
    /// How many.
    pub count: usize,
    /// The first triangle that it concerns, from 0.
    pub triangle: usize,
    /// Where, m.
    pub place_m: DVec3,
}

impl fmt::Display for Found {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let DVec3 { x, y, z } = self.place_m;
        write!(f, "first: triangle {} at {x:.6}, {y:.6}, {z:.6} m", self.triangle)
    }
}

/// One kind of fault.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Fault {
    /// No triangle.
    #[error("it has no triangle")]
    Empty,
    /// Indices that lead nowhere. Nothing else is examined then.
    #[error("{count} triangles name corners that are not there (first: triangle {triangle})")]
    BadIndex {
        /// How many triangles.
        count: usize,
        /// The first.
        triangle: usize,
    },
    /// Coordinates that are not finite, or larger than [`FARTHEST_M`]. Nothing else is examined then.
    #[error(
        "{count} triangles have coordinates that are not finite or beyond {FARTHEST_M:e} m (first: triangle {triangle})"
    )]
    NotFinite {
        /// How many triangles.
        count: usize,
        /// The first.
        triangle: usize,
    },
    /// Triangles whose height is less than 10⁻¹² of their longest edge, or with two corners in one place. They reflect nothing.
    #[error("{} triangles without area ({found})", found.count)]
    NoArea {
        /// Which.
        found: Found,
    },
    /// Triangles more than 10⁴ times as long as high. Their normals are poor.
    #[error("{} triangles are needles, the worst {worst:.1e} times as long as high ({found})", found.count)]
    Needle {
        /// Which.
        found: Found,
        /// The largest ratio.
        worst: f64,
    },
    /// Triangles on the same corners and the same side as another. They would reflect twice.
    #[error("{} triangles are there twice ({found}, the same as triangle {earlier}): delete them", found.count)]
    Duplicate {
        /// Which.
        found: Found,
        /// The triangle that the first of them repeats.
        earlier: usize,
    },
    /// Triangles that cover a part of another in the same plane and on the same side. They would reflect twice. Looked for in meshes of up
    /// to 20,000 triangles.
    #[error("{} pairs of triangles cover each other in one plane ({found}, and triangle {other}): both would reflect", found.count)]
    Overlap {
        /// Which; the count is that of pairs.
        found: Found,
        /// The other triangle of the first pair.
        other: usize,
    },
    /// Corners that are one within the tolerance, but not equal.
    #[error(
        "{count} corners lie within {tolerance_m:.1e} m of another without being equal to it: `weld_mm` makes them one"
    )]
    NearCorners {
        /// How many.
        count: usize,
        /// The tolerance, m.
        tolerance_m: f64,
    },
    /// The surface has a border.
    #[error("it is open: {} edges have a triangle on one side only ({found}), {length_m:.4} m in all", found.count)]
    Open {
        /// Which.
        found: Found,
        /// The length of all of them, m.
        length_m: f64,
    },
    /// Edges that other edges meet within their length.
    #[error("{} edges meet others only within their length (T-junctions; {found}): harmless for light", found.count)]
    Joints {
        /// Which.
        found: Found,
    },
    /// Edges of three triangles or more: surfaces that touch.
    #[error("{} edges belong to three triangles or more ({found}): surfaces touch there", found.count)]
    NonManifold {
        /// Which.
        found: Found,
    },
    /// Neighbours that face opposite ways.
    #[error("{} edges have neighbours that face opposite ways ({found}): let the modelling program make normals consistent", found.count)]
    InconsistentWinding {
        /// Which.
        found: Found,
    },
    /// Closed pieces with a negative volume that no other piece surrounds.
    #[error("{} closed pieces face inwards ({found}): `flip = true` turns a part", found.count)]
    Inward {
        /// Which; the count is that of pieces.
        found: Found,
    },
    /// Larger than anything in orbit.
    #[error(
        "it measures {size_m:.1} m, which looks like millimetres: give unit = \"mm\" (or unit = \"m\" if it is right)"
    )]
    LooksLikeMillimetres {
        /// The longest edge of its box, m.
        size_m: f64,
    },
    /// Smaller than anything that is watched.
    #[error("it measures {size_m:.2e} m: give its unit (unit = \"m\" if it is right)")]
    Tiny {
        /// The longest edge of its box, m.
        size_m: f64,
    },
}

impl Fault {
    /// Whether it is about the size alone, which an explicit unit settles.
    pub fn is_about_size(&self) -> bool {
        matches!(self, Self::LooksLikeMillimetres { .. } | Self::Tiny { .. })
    }
}

/// A piece of a mesh that hangs together.
#[derive(Debug, Clone, PartialEq)]
pub struct Component {
    /// How many triangles.
    pub triangles: usize,
    /// Whether it has no border: every edge's uses cancel, T-junctions added up. Light that enters a closed piece from behind a face
    /// has passed another face before; an open sheet shades from both sides.
    pub closed: bool,
    /// Area, m².
    pub area_m2: f64,
    /// Volume, m³; negative where it faces inwards, without meaning where it is open.
    pub signed_volume_m3: f64,
    /// The box around it, m.
    pub bounds: Bounds,
}

/// The outcome of an examination.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Report {
    /// Faults of the mesh, in the order of [`Fault`]'s variants.
    pub faults: Vec<Fault>,
    /// The pieces that hang together, in the order of their first triangles.
    pub components: Vec<Component>,
    /// Corners count as one within this distance, m.
    pub tolerance_m: f64,
    component_of: Vec<Option<u32>>,
}

impl Report {
    /// Examines a mesh.
    pub fn of(mesh: &Mesh) -> Self {
        let mut report = Self::default();
        let Some(bounds) = report.check_numbers(mesh) else { return report };
        let largest = bounds.least.abs().max(bounds.most.abs()).max_element();
        // A small body far from the origin must not become one corner.
        let size_m = bounds.size_m().max_element();
        report.tolerance_m = (WELD_FRACTION * largest).min(1e-4 * size_m);
        let topology = Topology::of(mesh, report.tolerance_m);
        report.component_of = topology.component_of.clone();
        report.components = components(mesh, &topology);
        report.check_triangles(mesh, &topology);
        report.check_edges(mesh, &topology);
        report.check_sides(mesh);
        if size_m > LARGE_M {
            report.faults.push(Fault::LooksLikeMillimetres { size_m });
        } else if size_m < SMALL_M {
            report.faults.push(Fault::Tiny { size_m });
        }
        report
    }

    /// The piece of a triangle, as an index into [`Report::components`]; `None` for a triangle without area that hangs on nothing.
    pub fn component_of(&self, triangle: usize) -> Option<usize> {
        self.component_of.get(triangle).copied().flatten().map(|c| c as usize)
    }

    /// Whether a triangle belongs to a closed piece.
    pub fn closed(&self, triangle: usize) -> bool {
        self.component_of(triangle).is_some_and(|c| self.components[c].closed)
    }

    /// Whether every piece is closed.
    pub fn all_closed(&self) -> bool {
        !self.components.is_empty() && self.components.iter().all(|c| c.closed)
    }

    fn check_numbers(&mut self, mesh: &Mesh) -> Option<Bounds> {
        let count = mesh.vertices.len();
        let mut bad = (0..mesh.triangles.len())
            .filter(|&t| mesh.triangles[t].iter().any(|&i| i as usize >= count));
        if let Some(triangle) = bad.next() {
            self.faults.push(Fault::BadIndex { count: 1 + bad.count(), triangle });
            return None;
        }
        let good = |corner: &DVec3| corner.abs().max_element() <= FARTHEST_M && !corner.is_nan();
        let mut bad = (0..mesh.triangles.len()).filter(|&t| !mesh.corners(t).iter().all(good));
        if let Some(triangle) = bad.next() {
            self.faults.push(Fault::NotFinite { count: 1 + bad.count(), triangle });
            return None;
        }
        let bounds = mesh.bounds();
        if bounds.is_none() {
            self.faults.push(Fault::Empty);
        }
        bounds
    }

    fn check_triangles(&mut self, mesh: &Mesh, topology: &Topology) {
        let (mut flat, mut needles, mut worst) = (Vec::new(), Vec::new(), 0.0_f64);
        for (t, corners) in mesh.faces().enumerate() {
            let ratio = slenderness(corners);
            if topology.component_of[t].is_none() || ratio > FLAT_RATIO {
                flat.push((t, corners[0]));
            } else if ratio > NEEDLE_RATIO {
                needles.push((t, corners[0]));
                worst = worst.max(ratio);
            }
        }
        let twice: Vec<(usize, DVec3)> = topology
            .duplicates
            .iter()
            .map(|&(t, _)| (t as usize, middle(mesh.corners(t as usize))))
            .collect();
        self.faults.extend(found(&flat).map(|found| Fault::NoArea { found }));
        self.faults.extend(found(&needles).map(|found| Fault::Needle { found, worst }));
        if let (Some(found), Some((_, earlier))) = (found(&twice), topology.duplicates.first()) {
            self.faults.push(Fault::Duplicate { found, earlier: *earlier as usize });
        }
        let known: Vec<usize> = twice.iter().map(|known| known.0).collect();
        let (count, first) = overlaps(mesh, self.tolerance_m, &known);
        if let Some((triangle, other)) = first {
            let place_m = middle(mesh.corners(triangle));
            let found = Found { count, triangle, place_m };
            self.faults.push(Fault::Overlap { found, other });
        }
        if topology.near > 0 {
            let (count, tolerance_m) = (topology.near, self.tolerance_m);
            self.faults.push(Fault::NearCorners { count, tolerance_m });
        }
    }

    fn check_edges(&mut self, mesh: &Mesh, topology: &Topology) {
        let at = |edges: &[(u32, DVec3)]| {
            let mut edges: Vec<_> = edges.iter().map(|&(t, p)| (t as usize, p)).collect();
            edges.sort_by_key(|e| e.0);
            found(&edges)
        };
        if let Some(found) = at(&topology.open) {
            let length_m = topology.open.iter().map(|e| edge_length(mesh, e)).sum();
            self.faults.push(Fault::Open { found, length_m });
        }
        self.faults.extend(at(&topology.joints).map(|found| Fault::Joints { found }));
        self.faults.extend(at(&topology.crowded).map(|found| Fault::NonManifold { found }));
        self.faults.extend(at(&topology.against).map(|found| Fault::InconsistentWinding { found }));
    }

    fn check_sides(&mut self, mesh: &Mesh) {
        // Only what is closed and faces outwards can surround; a soup has as many pieces as triangles, and none of those.
        let outward: Vec<&Component> =
            self.components.iter().filter(|c| c.closed && c.signed_volume_m3 > 0.0).collect();
        let surrounded = |piece: &Component| {
            outward.iter().any(|around| {
                around.signed_volume_m3 > -piece.signed_volume_m3
                    && around.bounds.holds(&piece.bounds)
            })
        };
        let inward = |(_, piece): &(usize, &Component)| {
            // Sheets of no thickness have no volume, up to rounding.
            let thick = piece.signed_volume_m3
                < -1e-12 * piece.area_m2 * piece.bounds.size_m().max_element();
            piece.closed && thick && !surrounded(piece)
        };
        let pieces: Vec<usize> =
            self.components.iter().enumerate().filter(inward).map(|p| p.0).collect();
        let Some(&first) = pieces.first() else { return };
        let triangle = self.component_of.iter().position(|c| *c == Some(first as u32)).unwrap_or(0);
        let place_m = middle(mesh.corners(triangle));
        let found = Found { count: pieces.len(), triangle, place_m };
        self.faults.push(Fault::Inward { found });
    }
}

/// Longest edge over height; infinite without area.
fn slenderness([a, b, c]: [DVec3; 3]) -> f64 {
    let longest2 = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a));
    let double_area = 2.0 * area_vector([a, b, c]).length();
    if double_area > 0.0 { longest2 / double_area } else { f64::INFINITY }
}

fn middle(corners: [DVec3; 3]) -> DVec3 {
    corners.iter().sum::<DVec3>() / 3.0
}

fn found(all: &[(usize, DVec3)]) -> Option<Found> {
    let &(triangle, place_m) = all.first()?;
    Some(Found { count: all.len(), triangle, place_m })
}

/// The length of the edge of a triangle whose middle is nearest to a point.
fn edge_length(mesh: &Mesh, &(triangle, place): &(u32, DVec3)) -> f64 {
    let [a, b, c] = mesh.corners(triangle as usize);
    let edges = [(a, b), (b, c), (c, a)];
    let off = |(p, q): (DVec3, DVec3)| (0.5 * (p + q)).distance_squared(place);
    let nearest = edges.into_iter().min_by(|e, f| off(*e).total_cmp(&off(*f)));
    nearest.map_or(0.0, |(p, q)| p.distance(q))
}

fn components(mesh: &Mesh, topology: &Topology) -> Vec<Component> {
    let mut bounds: Vec<Option<Bounds>> = vec![None; topology.closed.len()];
    let of = |t: usize| topology.component_of[t].map(|c| c as usize);
    for (t, corners) in mesh.faces().enumerate() {
        let Some(c) = of(t) else { continue };
        bounds[c] = Bounds::of(
            corners.into_iter().chain(bounds[c].into_iter().flat_map(|b| [b.least, b.most])),
        );
    }
    let mut pieces: Vec<Component> = bounds
        .into_iter()
        .flatten()
        .zip(&topology.closed)
        .map(|(bounds, &closed)| Component {
            triangles: 0,
            closed,
            area_m2: 0.0,
            signed_volume_m3: 0.0,
            bounds,
        })
        .collect();
    for (t, corners) in mesh.faces().enumerate() {
        let Some(piece) = of(t).and_then(|c| pieces.get_mut(c)) else { continue };
        piece.triangles += 1;
        piece.area_m2 += area_vector(corners).length();
        piece.signed_volume_m3 += cone_volume(corners, piece.bounds.centre());
    }
    pieces
}
