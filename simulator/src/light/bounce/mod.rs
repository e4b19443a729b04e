//! Inter-reflection: light that is scattered twice or more, all orders.
//!
//! [`Bounce::new`] looks at a scene: which surfaces can exchange light at all, the most that this can add ([`Need::bound`]), and, where
//! that exceeds the tolerance, what it does add for some directions. Where that is too much to be left out, it chooses a way:
//!
//! - **Patches**, where the surfaces that exchange light are flat and do not move against each other. Everything that depends on the
//!   body alone is done once: form factors by rays, all orders for each node of wavelengths. An epoch takes the exact lit and
//!   seen shares of the patches and one product. What two diffuse surfaces scatter one after the other, with nothing that could stand between, is exact (`clear`). What a rough surface sends from the Sun to others, or from others to the observer, is found along
//!   directions whose ends are known (`chords`); light that two rough surfaces scatter one after the other before or after a third surface
//!   is left to paths.
//! - **Paths** otherwise (spheres, hinges, mirrors), or where they state a smaller error: light paths for each epoch, as many as the tolerance asks for.
//!
//! Both use one geometry for all wavelengths; terms are hat functions between a few nodes. What hides what is as in single scattering: sheets
//! reflect with their front and hide with both sides, insides of closed bodies are dark. The Sun is a point here.
//!
//! Cylinders, cones, dishes and bent triangles are not met as such: [`stand_in`] gives a target of facets for them and what these may change.
//!
//! Not found: light that a perfect mirror gets from the Sun and another perfect mirror sends to the observer, whatever is between.

mod bound;
mod cast;
mod chords;
mod claim;
mod clear;
mod draft;
mod earthlit;
mod echo;
mod form_factor;
mod nodes;
mod optics;
mod orders;
mod patches;
mod paths;
mod pilot;
mod spectral;
mod split;
mod still;
mod stokes;
mod surfaces;
mod thread;
mod tracing;
mod transport;
mod twin;
mod views;

pub(in crate::light) use earthlit::{Earthlit, EarthlitLight};
pub(crate) use echo::{Echo, Echoes};
pub use twin::{StandIn, stand_in};

use super::{DirectionError, Effect, Lighting, Need, Scene, Source, Term, View};
use crate::light::occlude::Toward;
use bound::Bound;
use glam::DVec3;
use nodes::Nodes;
use pilot::Pilot;
use std::sync::Arc;
use still::{Effort, Still, StillLight};
use sunglint_radiometry::spectrum::SpectrumError;
use surfaces::Surfaces;
use tracing::{Plan, Tracing};

/// Nodes of a first look, relative error between them.
const ROUGH: f64 = 0.1;
/// Share of the tolerance that the wavelengths between nodes may take.
const BETWEEN_NODES: f64 = 0.1;

/// Options for computing inter-reflected light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BounceOptions {
    /// The relative error of the whole signal that inter-reflection may bring: above 0, below 1.
    pub tolerance: f64,
    /// Seed of all random points.
    pub seed: u32,
    /// Light paths of an epoch at most, where there are paths: what is then left of the tolerance is in the errors.
    pub most_paths: u32,
    /// Polariser before the observer; with one, all light is that of paths.
    pub analyser: Option<Analyser>,
}

/// Polariser that the observer looks through at light between surfaces.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Analyser {
    /// Nothing: all light, by light paths, without regard to its polarisation on the way.
    Open,
    /// An ideal polariser that lets light through whose electric field is perpendicular to the plane of Sun, body and observer.
    Across,
    /// The same, turned by 60° counter-clockwise as the observer sees it.
    Left,
    /// The same, turned by 120°.
    Right,
}

impl Analyser {
    /// Angle of the polariser, radians; `None` without one.
    pub(crate) fn angle_rad(self) -> Option<f64> {
        let third = std::f64::consts::FRAC_PI_3;
        match self {
            Self::Open => None,
            Self::Across => Some(0.0),
            Self::Left => Some(third),
            Self::Right => Some(2.0 * third),
        }
    }
}

impl Default for BounceOptions {
    fn default() -> Self {
        Self { tolerance: 1e-3, seed: 0, most_paths: 1 << 17, analyser: None }
    }
}

/// Why nothing was prepared.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BounceError {
    /// A tolerance that cannot be met or means nothing.
    #[error("the tolerance of inter-reflection is {0}, expected a number above 0 and below 1")]
    Tolerance(f64),
    /// Materials without common wavelengths.
    #[error(
        "materials that exchange light have no wavelengths in common: one begins at {from_nm} nm, another ends at {to_nm} nm; extend their tables"
    )]
    Disjoint {
        /// Where the last begins.
        from_nm: f64,
        /// Where the first ends.
        to_nm: f64,
    },
    /// Numbers that make no spectrum.
    #[error(transparent)]
    Spectrum(#[from] SpectrumError),
    /// Directions of the first look: none of them can be wrong but for the scene.
    #[error(transparent)]
    Direction(#[from] DirectionError),
}

/// A scene, ready for its inter-reflected light.
#[derive(Debug, Clone)]
pub struct Bounce<'a> {
    scene: &'a Scene,
    need: Need,
    nodes: Option<Nodes>,
    terms: Vec<Term>,
    way: Way,
    shape_error: f64,
}

#[derive(Debug, Clone)]
enum Way {
    /// Nothing is added.
    Nothing,
    Still(Arc<Still>),
    Paths(Arc<Plan>),
}

/// Prepared inter-reflection of a scene.
#[derive(Debug, Clone)]
pub(in crate::light) struct Prepared {
    way: Way,
    terms: usize,
    shape_error: f64,
}

impl Prepared {
    /// For the same body in other reflectances, with the same terms; `None` where these do not do, or light is never lost.
    pub fn recoloured(&self, scene: &Scene) -> Option<Self> {
        let way = match &self.way {
            Way::Nothing => Way::Nothing,
            Way::Still(still) => Way::Still(Arc::new(still.recoloured(scene)?)),
            Way::Paths(plan) => Way::Paths(Arc::new(plan.recoloured(scene)?)),
        };
        Some(Self { way, ..*self })
    }

    /// Room to evaluate in, of the scene that it was prepared for.
    pub fn light<'a>(&self, scene: &'a Scene) -> BounceLight<'a> {
        let way = match &self.way {
            Way::Nothing => Room::Nothing,
            Way::Still(still) => Room::Still(Box::new(StillLight::new(scene, still.clone()))),
            Way::Paths(plan) => Room::Paths(Box::new(Tracing::new(scene, plan.clone()))),
        };
        BounceLight { way, terms: self.terms, shape_error: self.shape_error }
    }
}

impl<'a> Bounce<'a> {
    /// Looks at a scene and prepares what it needs.
    ///
    /// # Errors
    /// A tolerance that is none; materials without common wavelengths.
    pub fn new(scene: &'a Scene, options: &BounceOptions) -> Result<Self, BounceError> {
        Self::with_effort(scene, options, &Effort::of_sun(options.most_paths))
    }

    /// The same, with patches that cost as much as `effort` says.
    fn with_effort(
        scene: &'a Scene,
        options: &BounceOptions,
        effort: &Effort,
    ) -> Result<Self, BounceError> {
        let tolerance = options.tolerance;
        if !(tolerance > 0.0 && tolerance < 1.0) {
            return Err(BounceError::Tolerance(tolerance));
        }
        let surfaces = Surfaces::new(scene);
        let bound = Bound::new(scene, &surfaces.list);
        let nothing = |bound: Option<f64>, why: String| {
            let need = Need { effect: EFFECT, needed: false, bound, why, cost_s: None };
            Ok(Self {
                scene,
                need,
                nodes: None,
                terms: Vec::new(),
                way: Way::Nothing,
                shape_error: 0.0,
            })
        };
        if bound.active.is_empty() {
            return nothing(Some(0.0), "no surface stands before the front of another".into());
        }
        let (filled, reflectance) = (100.0 * bound.filled, bound.reflectance);
        if let Some(share) = bound.share().filter(|s| *s <= tolerance) {
            let why = format!(
                "surfaces of reflectance {reflectance:.2} fill at most {filled:.3} % of another's hemisphere"
            );
            return nothing(Some(share), why);
        }
        let among = surfaces.materials(bound.active.iter().copied());
        let rough = Nodes::new(scene.materials(), &among, ROUGH)?;
        let pilot = Pilot::new(scene, &surfaces, &bound.active, &rough, options);
        let measured = format!(
            "{:.2e} of the light in the mean of {} pairs of directions, up to {:.2e}",
            pilot.mean,
            pilot.pairs.len(),
            pilot.largest
        );
        if pilot.largest <= tolerance {
            let bound = bound.share().map_or(pilot.largest, |share| share.min(pilot.largest));
            return nothing(Some(bound), measured);
        }
        let between = BETWEEN_NODES * tolerance / pilot.typical().max(1e-3);
        let between = between.clamp(effort.between, ROUGH);
        let nodes = Nodes::new(scene.materials(), &among, between)?;
        let terms = nodes
            .spectra()?
            .into_iter()
            .map(|spectrum| Term { source: Source::Bounce, material: None, spectrum })
            .collect();
        let wanted = (options, effort);
        let still = match options.analyser {
            None => Still::new(scene, &surfaces, &bound, &nodes, &pilot, wanted),
            Some(_) => None,
        };
        let (way, how, cost_s) = match still {
            Some(still) => {
                let (how, cost_s) = (still.describe(), still.cost_s(&pilot));
                (Way::Still(Arc::new(still)), how, cost_s)
            }
            None => {
                let plan = Plan::new(surfaces, bound.active.clone(), &nodes, options);
                let (how, cost_s) = (plan.describe(), plan.cost_s(&pilot));
                (Way::Paths(Arc::new(plan)), how, cost_s)
            }
        };
        let need = Need {
            effect: EFFECT,
            needed: true,
            bound: bound.share(),
            why: format!("{measured}; {how}, {} wavelengths", nodes.nm.len()),
            cost_s: Some(cost_s),
        };
        Ok(Self { scene, need, nodes: Some(nodes), terms, way, shape_error: 0.0 })
    }

    /// Adds a relative error to all that is claimed: that of the facets of a [`StandIn`].
    #[must_use]
    pub fn with_shape_error(mut self, relative: f64) -> Self {
        self.shape_error = relative;
        if relative > 0.0 {
            let percent = 100.0 * relative;
            self.need.why += &format!("; facets for curved parts may change {percent:.1} % of it");
        }
        self
    }

    /// Returns the need, with its reason. The bound is over the light in all directions, relative to what is scattered once; where it was left out after measuring, the
    /// largest share of the signal that was met.
    pub fn need(&self) -> &Need {
        &self.need
    }

    /// The terms: none where nothing is needed.
    pub fn terms(&self) -> &[Term] {
        &self.terms
    }

    /// The nodes' wavelengths, vacuum nm; none where nothing is needed.
    pub fn nodes_nm(&self) -> &[f64] {
        self.nodes.as_ref().map_or(&[], |n| &n.nm)
    }

    /// Room to evaluate in: one for each thread.
    pub fn light(&self) -> BounceLight<'a> {
        self.prepared().light(self.scene)
    }

    /// Returns the preparation, for a caller that keeps the scene elsewhere.
    pub(in crate::light) fn prepared(&self) -> Prepared {
        Prepared { way: self.way.clone(), terms: self.terms.len(), shape_error: self.shape_error }
    }
}

/// Name of the effect in the list of needs.
const EFFECT: &str = "inter-reflection";

/// Inter-reflected light of a scene, for one thread.
#[derive(Debug)]
pub struct BounceLight<'a> {
    way: Room<'a>,
    terms: usize,
    shape_error: f64,
}

#[derive(Debug)]
enum Room<'a> {
    Nothing,
    Still(Box<StillLight<'a>>),
    Paths(Box<Tracing<'a>>),
}

impl Effect for BounceLight<'_> {
    fn add(
        &mut self,
        lighting: &Lighting,
        weights: &mut [f64],
        errors: &mut [f64],
    ) -> Result<(), DirectionError> {
        for found in [weights.len(), errors.len()] {
            if found != self.terms {
                return Err(DirectionError::Room { found, expected: self.terms });
            }
        }
        let (sun, eye) = directions(lighting.sun_body, lighting.view)?;
        // What was there before is not this light's.
        let shapes = self.shape_error;
        errors.iter_mut().zip(&*weights).for_each(|(e, w)| *e -= shapes * w);
        match &mut self.way {
            Room::Nothing => {}
            Room::Still(light) => light.add(sun, eye, weights, errors),
            Room::Paths(light) => light.add((sun, eye), None, weights, errors),
        }
        errors.iter_mut().zip(&*weights).for_each(|(e, w)| *e += shapes * w);
        Ok(())
    }
}

/// Unit vectors of what was given.
fn directions(sun: DVec3, view: View) -> Result<(DVec3, Toward), DirectionError> {
    let unit = |what, value: DVec3| {
        value.try_normalize().ok_or(DirectionError::NoDirection { what, value })
    };
    let sun = unit("the direction of the Sun", sun)?;
    let eye = match view {
        View::Distant(d) => Toward::Far(unit("the direction of the observer", d)?),
        View::At(q) => {
            unit("the place of the observer", q)?;
            Toward::Near(q)
        }
    };
    Ok((sun, eye))
}
