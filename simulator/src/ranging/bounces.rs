//! Photons of a pulse that the surfaces of a body scatter to each other: they come later than their last surface says.
//!
//! Light paths of two scatterings and more, of all orders, between the laser and the telescope: those of [`crate::light::bounce`] with their
//! lengths. Half of a path's whole length is the depth at which a ranging station records it, and the fluence is that where the path meets the
//! body first. Paths are traced for each shot until the claimed error of the sum is within the tolerance. Patches and form factors, which serve sunlight, do not
//! know when light arrives.

use super::profile::{DepthError, Profile, Shot};
use crate::light::bounce::{BounceOptions, Echo, Echoes, stand_in};
use crate::light::engine::{Options, Switch};
use crate::light::{Need, Scene, SceneError};
use crate::target::Target;

/// Name of the effect in reports.
const EFFECT: &str = "inter-reflection of laser light";
/// Paths of each scramble to begin with.
const LEAST: u32 = 64;
/// Standard errors that are claimed: Student's t of 7 degrees of freedom at 99 %, since paths end where the error happens to look small.
const CLAIMED: f64 = 3.5;
/// Share of the tolerance that the claimed error may take.
const OF_TOLERANCE: f64 = 0.7;
/// Cost of a path, s, for the report.
const PATH_S: f64 = 1e-6;

/// Why there are no paths.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BouncesError {
    /// A tolerance that cannot be met or means nothing.
    #[error("the tolerance of inter-reflection is {0}, expected a number above 0 and below 1")]
    Tolerance(f64),
    /// A material without a reflectance at the laser's wavelength.
    #[error(
        "the material `{material}` has no reflectance at {wavelength_nm} nm: its tables end there; extend them"
    )]
    Wavelength {
        /// The material.
        material: String,
        /// The laser's wavelength, vacuum nm.
        wavelength_nm: f64,
    },
    /// A target that cannot be prepared.
    #[error(transparent)]
    Scene(#[from] SceneError),
}

/// A body, ready for what its surfaces do with a laser's light.
#[derive(Debug, Clone)]
pub struct Bounces {
    /// With facets for curved parts.
    scene: Scene,
    wavelength_nm: f64,
    options: BounceOptions,
    need: Need,
    /// Relative change that these facets may make.
    shape_error: f64,
}

impl Bounces {
    /// Looks at a target at a wavelength (vacuum nm). Unless switched on or off, paths are traced where its surfaces may scatter more of their light to each other
    /// than the tolerance.
    ///
    /// # Errors
    /// A tolerance that is none; tables that do not reach the wavelength; as [`Scene::new`].
    pub fn new(
        target: &Target,
        wavelength_nm: f64,
        switch: Switch,
        options: &BounceOptions,
    ) -> Result<Self, BouncesError> {
        let tolerance = options.tolerance;
        if !(tolerance > 0.0 && tolerance < 1.0) {
            return Err(BouncesError::Tolerance(tolerance));
        }
        let twin = stand_in(target);
        let (target, shape_error) = twin.as_ref().map_or((target, 0.0), |t| (&t.target, t.error));
        let scene = Scene::new(target)?;
        for material in scene.materials() {
            let covers = |(first, last): (f64, f64)| (first..=last).contains(&wavelength_nm);
            if !material.spectra().iter().all(|s| covers(s.range_nm())) {
                let material = material.name.clone();
                return Err(BouncesError::Wavelength { material, wavelength_nm });
            }
        }
        let bound = Echoes::new(&scene, wavelength_nm, options).bound();
        let needed = bound != Some(0.0)
            && match switch {
                Switch::Auto => bound.is_none_or(|b| b > tolerance),
                Switch::On => true,
                Switch::Off => false,
            };
        let what = match bound {
            Some(0.0) => "no surface stands before the front of another",
            _ if needed => "light paths for each shot",
            Some(_) => "what surfaces fill of each other's hemispheres",
            None => "surfaces that see each other, no bound is known",
        };
        let why = format!("{what}{}", Options::reason(switch));
        let cost_s = needed.then(|| PATH_S * f64::from(options.most_paths));
        let need = Need { effect: EFFECT, needed, bound, why, cost_s };
        Ok(Self { scene, wavelength_nm, options: *options, need, shape_error })
    }

    /// Whether it is needed, and why; where it is not, the bound is what is left out, of the photons that are scattered once.
    pub fn need(&self) -> &Need {
        &self.need
    }

    /// Room to trace in: one for each thread.
    pub fn eye(&self) -> BouncesEye<'_> {
        let traced = self.need.needed;
        let echoes = traced.then(|| Echoes::new(&self.scene, self.wavelength_nm, &self.options));
        BouncesEye { bounces: self, echoes }
    }
}

/// Paths of one thread.
#[derive(Debug, Clone)]
pub struct BouncesEye<'a> {
    bounces: &'a Bounces,
    echoes: Option<Echoes<'a>>,
}

/// Photons that were scattered more than once.
#[derive(Debug, Clone, PartialEq)]
pub struct Bounced {
    /// Mean number of detected photons per shot in each bin, by half of their whole way.
    pub photons: Vec<f64>,
    /// Standard errors of these.
    pub sigma: Vec<f64>,
    /// In and out of the bins.
    pub total: f64,
    /// The claimed error of that.
    pub error: f64,
    /// Photons of the total that come from beyond the first or the last bin.
    pub outside: f64,
}

impl Bounced {
    pub(super) fn times(mut self, factor: f64) -> Self {
        self.photons.iter_mut().chain(&mut self.sigma).for_each(|p| *p *= factor);
        self.total *= factor;
        self.error *= factor;
        self.outside *= factor;
        self
    }
}

impl Shot<'_> {
    /// Adds what is scattered more than once to what is scattered once ([`Shot::profile`]), if the body needs it.
    ///
    /// # Errors
    /// A range or directions that are none.
    pub fn add_bounces(
        &self,
        eye: &mut BouncesEye<'_>,
        profile: &mut Profile,
    ) -> Result<(), DepthError> {
        let shot = self.checked()?;
        let Some(echoes) = &mut eye.echoes else { return Ok(()) };
        let options = &eye.bounces.options;
        let most = Echoes::most_points(options);
        let mut tally = Tally::new(shot, profile);
        let mut missing = 0.0;
        let peak = shot.counts() * shot.fluence(shot.off_axis_m);
        let directions = [shot.laser.toward, shot.telescope.toward, shot.sun_body];
        echoes.trace(directions, &mut |echoes, points, left| {
            tally.add(echoes, points);
            missing = peak * left;
            let (total, sigma) = tally.total();
            let wanted = OF_TOLERANCE * options.tolerance * (profile.total + total);
            let enough = points > 0 && CLAIMED * sigma + missing <= wanted;
            (!enough && points < most).then(|| (2 * points).clamp(LEAST.min(most), most))
        });
        let mut bounced = tally.finish();
        bounced.error = CLAIMED * bounced.error + missing + eye.bounces.shape_error * bounced.total;
        profile.photons.iter_mut().zip(&bounced.photons).for_each(|(p, b)| *p += b);
        profile.total += bounced.total;
        profile.outside += bounced.outside;
        profile.bounced = Some(bounced);
        Ok(())
    }
}

/// Sums over the paths of one shot.
struct Tally<'a> {
    shot: Shot<'a>,
    bins: super::DepthBins,
    counts: f64,
    /// Sums of each scramble: in front, in each bin, behind.
    rows: Vec<Vec<f64>>,
    points: f64,
}

impl<'a> Tally<'a> {
    fn new(shot: Shot<'a>, profile: &Profile) -> Self {
        let rows = vec![vec![0.0; profile.bins.count + 2]; Echoes::SCRAMBLES];
        Self { shot, bins: profile.bins, counts: shot.counts(), rows, points: 0.0 }
    }

    fn add(&mut self, echoes: &[Echo], points: u32) {
        for echo in echoes {
            let depth_m = self.shot.depth_m(echo.first_m, echo.last_m) + 0.5 * echo.between_m;
            let photons = self.counts * self.shot.fluence(echo.first_m) * echo.light;
            self.rows[echo.scramble][self.bins.row(depth_m)] += photons;
        }
        self.points = f64::from(points.max(1));
    }

    /// Mean over the scrambles and its standard error.
    fn mean(&self, of: impl Fn(&[f64]) -> f64) -> (f64, f64) {
        let n = self.rows.len() as f64;
        let values: Vec<f64> = self.rows.iter().map(|r| of(r) / self.points).collect();
        let mean = values.iter().sum::<f64>() / n;
        let square: f64 = values.iter().map(|v| (v - mean) * (v - mean)).sum();
        (mean, (square / (n * (n - 1.0))).sqrt())
    }

    fn total(&self) -> (f64, f64) {
        self.mean(|row| row.iter().sum())
    }

    /// The sums, with the standard error of their total.
    fn finish(&self) -> Bounced {
        let (total, error) = self.total();
        let count = self.bins.count;
        let (outside, _) = self.mean(|row| row[0] + row[count + 1]);
        let (photons, sigma) = (1..=count).map(|k| self.mean(|row| row[k])).unzip();
        Bounced { photons, sigma, total, error, outside }
    }
}
