//! A target, prepared for evaluation.

use super::builder::{Builder, check};
use super::clip;
use super::curved::{Round, bent::Patch, phase::PhaseCurve};
use super::evaluate::Evaluator;
use super::geometry::Geometry;
use super::large::{Large, Sampling};
use super::occlude::Occluder;
use crate::surface::Material;
use crate::target::{Hinge, Target};
use glam::DVec3;
use std::f64::consts::PI;
use std::ops::Range;

/// A target prepared for the light engine: facets, what may hide them, and where each material's weights stand.
///
/// ```
/// use glam::DVec3;
/// use sunglint_simulator::light::{Scene, View};
/// use sunglint_simulator::target::Target;
///
/// let cube = Target::parse("cube.toml", r#"
/// [[part]]
/// name = "cube"
/// shape = "box"
/// size_m = [1, 1, 1]
/// material = "white"
/// [[material]]
/// name = "white"
/// model = "lambert"
/// reflectance = 1.0
/// "#)?;
/// let scene = Scene::new(&cube)?;
/// let mut weight = vec![0.0; scene.weight_count()];
/// // Lit and seen at 45° on one face of 1 m²: cos²45°/π.
/// let at = DVec3::new(0.0, 1.0, 1.0).normalize();
/// scene.evaluator().direct(DVec3::Z, View::Distant(at), &mut weight)?;
/// assert!((weight[0] - 0.5f64.sqrt() / std::f64::consts::PI).abs() < 1e-12);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct Scene {
    pub(super) materials: Vec<Material>,
    pub(super) hinges: Vec<Hinge>,
    pub(super) parts: usize,
    pub(super) weights: Vec<Range<usize>>,
    pub(super) facets: Vec<Facet>,
    pub(super) outlines: clip::Polygons,
    pub(super) rounds: Vec<Round>,
    pub(super) patches: Vec<Patch>,
    pub(super) occluders: Vec<Occluder>,
    pub(super) geometry: Geometry,
    /// For each facet a range of `candidates`; `None` where an index is made for each direction instead.
    pub(super) pairs: Option<(Vec<Range<usize>>, Vec<u32>)>,
    pub(super) touching_m: f64,
    /// Whether faces cover others in their plane.
    pub(super) covers: bool,
    /// The Sun's disc, where it is modelled.
    pub(super) sun: Option<super::disc::Sun>,
    /// For each material its light on spheres by phase angle; empty where integrals are taken anew each time.
    pub(super) phases: Vec<PhaseCurve>,
    /// The same once more, where it is sampled.
    pub(super) large: Option<Box<Large>>,
    pub(super) report: SceneReport,
}

/// A facet; its place is in [`Geometry`].
#[derive(Debug, Clone)]
pub(super) struct Facet {
    pub area: f64,
    pub radius: f64,
    pub material: u32,
    pub part: u32,
    pub component: u32,
    pub group: u32,
    /// The bent triangle over it, if any.
    pub patch: Option<u32>,
    /// Whether its component is convex, and hides nothing of itself.
    pub convex: bool,
}

/// How a target is prepared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SceneOptions {
    /// Facets times occluders up to which every pair is looked at once and for all: with fewer the scene takes less memory and looks for what hides what
    /// anew in each direction.
    pub most_pairs: usize,
    /// Error allowed in sums, as a share of ΣW: big meshes that hide parts of themselves are then sampled for distant observers
    /// ([`SceneReport::sampling`]); all else stays exact ([`SceneReport::why_exact`]), and with 0 all.
    pub tolerance: f64,
    /// The Sun's disc; `None` for a collimated Sun.
    pub sun: Option<super::SunOptions>,
}

impl Default for SceneOptions {
    fn default() -> Self {
        Self { most_pairs: Scene::MOST_PAIRS, tolerance: 0.0, sun: None }
    }
}

/// Why a target cannot be prepared.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// A perfect mirror that is flat.
    #[error(
        "part `{part}` is a flat mirror (`{material}`): under a Sun without extent it sends nothing or an infinite intensity; model the Sun's disc, give it a roughness, or make it a sphere"
    )]
    FlatMirror {
        /// The part.
        part: String,
        /// Name of the material.
        material: String,
    },
    /// A perfect mirror that is curved one way only, or a bowl.
    #[error(
        "part `{part}` is a cylinder, a cone or a dish that is a mirror (`{material}`): under a Sun without extent it sends nothing or an infinite intensity; give it a roughness, or make it a sphere"
    )]
    CurvedMirror {
        /// The part.
        part: String,
        /// Name of the material.
        material: String,
    },
    /// A part names what is not there.
    #[error("part `{part}` names {what} number {number}, there are {count}")]
    Missing {
        /// The part.
        part: String,
        /// A material or a hinge.
        what: &'static str,
        /// The number, from 0.
        number: usize,
        /// How many there are.
        count: usize,
    },
    /// A place that is not a number.
    #[error("part `{part}` has a corner, a radius or a place that is not a finite number")]
    NotFinite {
        /// The part.
        part: String,
    },
    /// A triangle of corners that are not there.
    #[error("part `{part}`: triangle {triangle} names corner {corner}, there are {count}")]
    Corner {
        /// The part.
        part: String,
        /// The triangle, from 0.
        triangle: usize,
        /// The corner, from 0.
        corner: u32,
        /// How many there are.
        count: usize,
    },
    /// A sphere whose material has a tangent.
    #[error(
        "part `{part}` is a sphere of `{material}`, which reflects by its tangent: a sphere has none; make it a mesh"
    )]
    Tangent {
        /// The part.
        part: String,
        /// Name of the material.
        material: String,
    },
    /// A tolerance that is none.
    #[error("the tolerance is {tolerance}, expected a number from 0 to 1, a part of the whole")]
    Tolerance {
        /// Given tolerance.
        tolerance: f64,
    },
    /// A material whose reflectance cannot be summed.
    #[error(transparent)]
    Material(#[from] crate::surface::MaterialError),
    /// A sphere without a radius.
    #[error("part `{part}` is a sphere of radius {radius_m} m, expected more than 0")]
    Radius {
        /// The part.
        part: String,
        /// Radius of the sphere, m.
        radius_m: f64,
    },
    /// A cylinder, a cone or a dish without a size.
    #[error("part `{part}`: {what} is {value_m} m, expected {expected}")]
    Size {
        /// The part.
        part: String,
        /// Name of the size.
        what: &'static str,
        /// Given value, m.
        value_m: f64,
        /// Values that are allowed.
        expected: &'static str,
    },
    /// Normals that do not belong to the vertices.
    #[error("part `{part}` has {found} normals for {expected} vertices")]
    Normals {
        /// The part.
        part: String,
        /// How many there are.
        found: usize,
        /// How many vertices.
        expected: usize,
    },
}

/// Report on a prepared scene.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SceneReport {
    /// Triangles that came in.
    pub triangles: usize,
    /// Facets after merging triangles of one plane and part.
    pub facets: usize,
    /// Facets among them that are triangles bent by their normals.
    pub bent: usize,
    /// Facets left out because they lie inside a convex body that moves with them.
    pub buried: usize,
    /// Spheres, in closed form wherever nothing interferes with them.
    pub spheres: usize,
    /// Cylinders, cones and dishes.
    pub curved: usize,
    /// Whether every surface is part of a closed body.
    pub closed: bool,
    /// Whether the whole target is one convex closed body.
    pub convex: bool,
    /// Whether nothing can ever hide anything.
    pub no_occlusion: bool,
    /// Convex bodies that hide by their outline.
    pub solids: usize,
    /// Pairs of a facet and what may hide it, where a list is kept; `None` where an index is made for each direction.
    pub occluder_pairs: Option<usize>,
    /// Corners nearer to a plane than this lie in it, m.
    pub touching_m: f64,
    /// How a big mesh is sampled; `None` where all sums are exact.
    pub sampling: Option<Sampling>,
    /// Why the sums are exact although a tolerance was given.
    pub why_exact: Option<String>,
    /// Warnings for the user.
    pub warnings: Vec<String>,
}

impl Scene {
    /// A corner nearer to a facet's plane than this times the scene's size (half the diagonal of its bounding box) lies in that plane.
    pub const TOUCHING: f64 = 1e-10;
    /// Triangles merge where their corners lie in one plane within this times the scene's size.
    pub const FLAT: f64 = 1e-13;
    /// A curved part that something shades or hides is divided until its error is below this times what it would send alone.
    pub const CURVED_TOLERANCE: f64 = 1e-4;
    /// Facets times occluders up to which every pair is looked at once and for all.
    pub const MOST_PAIRS: usize = 4_000_000;

    /// Prepares a target.
    ///
    /// # Errors
    /// A flat perfect mirror, indices without their thing, corners that are no numbers.
    pub fn new(target: &Target) -> Result<Self, SceneError> {
        Self::with_most_pairs(target, Self::MOST_PAIRS)
    }

    /// Prepares a target with another limit than [`Scene::MOST_PAIRS`]: with fewer the scene takes less memory and looks for what hides
    /// what anew in each direction. The weights are the same but for the rounding of sums in another order.
    ///
    /// # Errors
    /// The errors of [`Scene::new`].
    pub fn with_most_pairs(target: &Target, most_pairs: usize) -> Result<Self, SceneError> {
        Self::with_options(target, SceneOptions { most_pairs, ..SceneOptions::default() })
    }

    /// Prepares a target as [`SceneOptions`] say.
    ///
    /// # Errors
    /// The errors of [`Scene::new`] (flat mirrors are welcome under the Sun's disc), and a tolerance that is no number from 0 to 1.
    pub fn with_options(target: &Target, options: SceneOptions) -> Result<Self, SceneError> {
        let SceneOptions { most_pairs, tolerance, sun } = options;
        if !(0.0..=1.0).contains(&tolerance) {
            return Err(SceneError::Tolerance { tolerance });
        }
        for part in &target.parts {
            check(target, part, sun.is_some())?;
        }
        let mut scene = Builder::new(target).finish(most_pairs);
        scene.sun = sun.map(|options| super::disc::Sun::new(target, options));
        if tolerance > 0.0 {
            scene.sample(tolerance);
        }
        Ok(scene)
    }

    /// Takes what spheres send from tables by phase angle ([`PhaseCurve`]), which are made where they are needed: for many directions.
    pub(super) fn tabulate_spheres(&mut self) {
        if self.rounds.iter().any(|r| r.sphere.is_some()) {
            self.phases = vec![PhaseCurve::default(); self.materials.len()];
        }
    }

    /// Adds `scale` times the weights of a sphere of 1 m at a phase angle; gives the relative error.
    pub(super) fn add_sphere(&self, material: u32, phase: f64, scale: f64, sum: &mut [f64]) -> f64 {
        let of = &self.materials[material as usize];
        match self.phases.get(material as usize) {
            Some(curve) => curve.add(of, phase, scale, sum),
            // Neither a tangent nor an angle out of range is left to refuse: the scene was checked, the angle was made.
            None => of.add_sphere_weights(phase, scale, sum).unwrap_or(f64::INFINITY),
        }
    }

    /// Whether a place, body axes, lies within a sphere or a closed surface that stands still in the body: one that is seen all around it.
    pub(crate) fn encloses(&self, place: DVec3) -> bool {
        let now = &self.geometry;
        let mut balls = self.rounds.iter().zip(&now.place).filter(|(round, _)| round.group == 0);
        let ball = balls.any(|(round, at)| {
            round.sphere.is_some_and(|radius| at.point(round.middle).distance(place) < radius)
        });
        let mut around = std::collections::BTreeMap::<u32, f64>::new();
        for (i, facet) in self.facets.iter().enumerate().filter(|(_, f)| f.group == 0) {
            let outline = self.outlines.get(i);
            let corner = |p: &clip::P2| {
                now.origin[i] + p[0] * now.tangent[i] + p[1] * now.bitangent[i] - place
            };
            let Some((first, rest)) = outline.split_first() else { continue };
            let sum: f64 = rest
                .windows(2)
                .map(|two| solid_angle([corner(first), corner(&two[0]), corner(&two[1])]))
                .sum();
            *around.entry(facet.component).or_default() += sum;
        }
        ball || around.values().any(|all| *all > 0.99 * 4.0 * PI)
    }

    /// Room to evaluate in: one for each thread.
    pub fn evaluator(&self) -> Evaluator<'_> {
        Evaluator::new(self)
    }

    /// The same body in other reflectances; `None` where the materials differ in more than these.
    pub(crate) fn recoloured(&self, materials: &[Material]) -> Option<Self> {
        let same = self.materials.len() == materials.len()
            && self.materials.iter().zip(materials).all(|(a, b)| a.has_weights_of(b));
        same.then(|| Self { materials: materials.to_vec(), ..self.clone() })
    }

    /// The materials, in the target's order.
    pub fn materials(&self) -> &[Material] {
        &self.materials
    }

    /// All spectra ρ_k in the order of the weights.
    pub fn spectra(
        &self,
    ) -> impl Iterator<
        Item = &sunglint_radiometry::spectrum::Spectrum<sunglint_radiometry::spectrum::Reflectance>,
    > {
        self.materials.iter().flat_map(|m| m.spectra())
    }

    /// Where a material's weights stand.
    pub fn weights_of(&self, material: usize) -> Range<usize> {
        self.weights[material].clone()
    }

    /// How many weights there are.
    pub fn weight_count(&self) -> usize {
        self.weights.last().map_or(0, |w| w.end)
    }

    /// How many parts there are.
    pub fn part_count(&self) -> usize {
        self.parts
    }

    /// Returns the report on the scene.
    pub fn report(&self) -> &SceneReport {
        &self.report
    }
}

/// The solid angle of a triangle as seen from the origin, positive from behind its normal (Van Oosterom and Strackee 1983).
fn solid_angle([a, b, c]: [DVec3; 3]) -> f64 {
    let (x, y, z) = (a.length(), b.length(), c.length());
    let below = x * y * z + a.dot(b) * z + b.dot(c) * x + c.dot(a) * y;
    2.0 * a.dot(b.cross(c)).atan2(below)
}
