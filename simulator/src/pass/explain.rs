//! Needs of a pass, found before it is simulated.

use super::simulate::Place;
use super::{Pass, PassError};
use crate::attitude::Attitude;
use crate::attitude::torques::Sizes;
use crate::light::disc::eclipse as fractions;
use crate::light::engine::left_out;
use crate::light::{Course, Globe, Lighting, Need, SceneReport, View};
use glam::DVec3;
use std::collections::HashSet;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use sunglint_ephemeris::orbit::eclipse::EARTH_EQUATORIAL_RADIUS_M;

/// Needs of a pass.
#[derive(Debug, Clone)]
pub struct Explanation {
    /// Effect by effect.
    pub needs: Vec<Need>,
    /// The sum of the bounds of what is not modelled, of the light of the same surfaces in full sunlight.
    pub left_out: f64,
    /// Known facts about the target's trajectory.
    pub course: Course,
    /// Report of the light engine on the target.
    pub scene: SceneReport,
    /// Terms that the light is a sum of.
    pub terms: usize,
    /// Sizes of the torques ([`TORQUES`](crate::attitude::torques::TORQUES)), where the attitude is a motion under torques.
    pub torques: Option<[Sizes; 5]>,
}

impl Pass {
    /// Finds the needs of the pass, effect by effect, without its light.
    ///
    /// # Errors
    /// The errors of [`Pass::simulate`], for places and target.
    pub fn explain(&self) -> Result<Explanation, PassError> {
        self.check()?;
        let course = self.course(&self.places(&|| ())?);
        let engine = self.engine(&course)?;
        let needs = engine.needs().to_vec();
        Ok(Explanation {
            left_out: left_out(&needs),
            needs,
            course,
            scene: engine.scene().report().clone(),
            terms: engine.lit_terms(),
            torques: match &self.attitude {
                Attitude::Torques(driven) => Some(*driven.sizes()),
                _ => None,
            },
        })
    }

    /// Returns the known facts about the trajectory that the target takes.
    pub(super) fn course(&self, places: &[Place]) -> Course {
        let mut survey = Survey::new(self);
        places.iter().for_each(|place| survey.add(place));
        survey.course()
    }
}

/// The trajectory as far as it is known, found epoch by epoch.
pub(super) struct Survey<'a> {
    pass: &'a Pass,
    course: Course,
    /// A number of each geometry: a million of them are held in 20 MB.
    geometries: HashSet<u64>,
    most: f64,
}

impl<'a> Survey<'a> {
    pub fn new(pass: &'a Pass) -> Self {
        let course = Course {
            range_m: f64::INFINITY,
            radius_m: (f64::INFINITY, 0.0),
            sun_radius_rad: 0.0,
            phase_rad: 0.0,
            earthshine: 0.0,
            shadow: pass.shadow.is_some(),
            ..Course::default()
        };
        Self { pass, course, geometries: HashSet::new(), most: pass.earth.most() }
    }

    /// Takes one more epoch in.
    pub fn add(&mut self, place: &Place) {
        let course = &mut self.course;
        let lighting = place.lighting();
        let radius_m = place.geometry.target.position_m.length();
        course.epochs += 1;
        course.range_m = course.range_m.min(place.geometry.range_m);
        course.radius_m = (course.radius_m.0.min(radius_m), course.radius_m.1.max(radius_m));
        course.sun_radius_rad = course.sun_radius_rad.max(lighting.sun_radius_rad);
        course.phase_rad = course.phase_rad.max(place.geometry.phase_rad);
        let bound = |earth| crate::light::engine::earthshine(&earth, self.most);
        let earthshine = lighting.earth.map_or(0.0, bound);
        course.earthshine = course.earthshine.max(earthshine);
        course.aspects.add(place.sun_body, place.observer_body);
        let shaded = self.pass.shadow.is_some() && place.sunlit < 1.0;
        course.umbra += usize::from(shaded && place.sunlit == 0.0);
        course.penumbra += usize::from(shaded && place.sunlit > 0.0);
        // A microradian apart is another geometry.
        let cell = |d: DVec3| (d * 1e6).round().to_array().map(|x| x as i64);
        // With the same keys in every run, so that the number of geometries is the same.
        let mut hasher = DefaultHasher::new();
        (cell(place.sun_body), cell(place.observer_body)).hash(&mut hasher);
        self.geometries.insert(hasher.finish());
    }

    /// Facts of all epochs.
    pub fn course(self) -> Course {
        Course { geometries: self.geometries.len(), ..self.course }
    }
}

impl Place {
    /// The light of the place, in the body's axes.
    pub fn lighting(&self) -> Lighting {
        let gcrs_to_body = self.body_to_gcrs.conjugate();
        let down = -(gcrs_to_body * self.geometry.target.position_m);
        Lighting {
            sun_body: self.sun_body,
            sun_radius_rad: self.geometry.sun.angular_radius_rad(),
            earth: Some(Globe {
                toward: down.normalize_or_zero(),
                distance_m: down.length(),
                radius_m: EARTH_EQUATORIAL_RADIUS_M,
                sun: self.sun_body,
                to_ground: self.gcrs_to_itrs * self.body_to_gcrs,
            }),
            moon: self.moon.map(|moon| Globe {
                toward: gcrs_to_body * moon.toward,
                sun: gcrs_to_body * moon.sun,
                ..moon
            }),
            shadow: self.discs.map(|discs| {
                fractions::globe(&discs, self.sun_body, down.normalize_or_zero(), down.length())
            }),
            sunlit: self.sunlit,
            sunlit_error: self.sunlit_error,
            view: View::At(self.geometry.range_m * self.observer_body),
        }
    }
}
