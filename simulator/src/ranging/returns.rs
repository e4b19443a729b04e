//! The returns of one laser along a pass.

use super::cubes::{none_of_speckled, velocity_aberration};
use super::{
    Beam, Bounces, BouncesError, BouncesEye, DepthBins, DepthError, Profile, Receiver, Shot, Stand,
};
use crate::light::bounce::BounceOptions;
use crate::light::{
    EarthAlbedo, Faceted, FacetedEye, Globe, Need, SceneError, UncoveredError, shine,
};
use crate::pass::{Elsewhere, Pass, PassError, Place, Simulation};
use rayon::prelude::*;
use std::f64::consts::SQRT_2;
use sunglint_radiometry::air::{AirError, Sampling, Zenith};
use sunglint_radiometry::light::sun_at_1_au;
use sunglint_radiometry::station::{Channel, Detector, Laser};

/// Why there are no returns of a laser.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReturnsError {
    /// The laser names a channel that the station lacks.
    #[error("there is no channel {name}")]
    NoChannel {
        /// The channel.
        name: String,
    },
    /// The channel that the laser names does not see its wavelength.
    #[error(
        "laser {laser}: the channel {channel} counts nothing at {wavelength_nm} nm (laser.receiver)"
    )]
    Deaf {
        /// The laser.
        laser: String,
        /// The channel.
        channel: String,
        /// The laser's wavelength.
        wavelength_nm: f64,
    },
    /// No counter of the station sees the wavelength.
    #[error(
        "laser {laser}: no counter of {station} counts at {wavelength_nm} nm; name a channel with laser.receiver, or give one that does"
    )]
    NoReceiver {
        /// The laser.
        laser: String,
        /// The station.
        station: String,
        /// The laser's wavelength.
        wavelength_nm: f64,
    },
    /// A target that is none.
    #[error("the target {name}")]
    Target {
        /// Name of the target.
        name: String,
        /// Why.
        source: SceneError,
    },
    /// A surface without reflectance at the laser's wavelength.
    #[error("laser {laser}")]
    Uncovered {
        /// The laser.
        laser: String,
        /// Why.
        source: UncoveredError,
    },
    /// Light between the body's surfaces that cannot be traced.
    #[error("laser {laser}")]
    Bounces {
        /// The laser.
        laser: String,
        /// Why.
        source: BouncesError,
    },
    /// A site of its own from which the target cannot be placed.
    #[error("laser {laser}")]
    Site {
        /// The laser.
        laser: String,
        /// Why.
        source: PassError,
    },
    /// Air that is not tabulated at the laser's wavelength.
    #[error("laser {laser}: the air at {wavelength_nm} nm")]
    Air {
        /// The laser.
        laser: String,
        /// Wavelength of the laser.
        wavelength_nm: f64,
        /// Why.
        source: AirError,
    },
    /// A shot that cannot be computed.
    #[error(transparent)]
    Depth(#[from] DepthError),
}

/// Bins of range over the body.
const BINS: usize = 200;
/// With so many photons per shot in the mean 95 % of the shots yield at least one: −ln 0.05.
pub const SATURATED: f64 = 2.995_732_273_553_991;
/// Light paths of a shot at most: about 10 ms. What they leave open is in the stated error.
const BOUNCES: BounceOptions =
    BounceOptions { tolerance: 1e-3, seed: 0, most_paths: 4096, analyser: None };
/// Points along each side of a panel of the Earth's cap.
const CAP_ORDER: usize = 8;
/// Altitudes of the table of sunlight over laser light, km (thesis fig. 3.5).
pub const ALTITUDES_KM: [f64; 9] =
    [300.0, 550.0, 1000.0, 2000.0, 5000.0, 10_000.0, 20_000.0, 36_000.0, 40_000.0];

/// The returns of one laser along a pass; everything is NaN while the target is hidden.
#[derive(Debug, Clone)]
pub struct Returns<'a> {
    /// The laser.
    pub laser: &'a Laser,
    /// Number of the channel that catches them, in the station and the simulation.
    pub channel: usize,
    /// Counts per photon at the telescope, at the laser's wavelength.
    pub efficiency: f64,
    /// Whether photons are traced that the body scatters more than once.
    pub need: Need,
    /// Bins of range against the body's origin.
    pub bins: DepthBins,
    /// Mean number of detected photons per shot.
    pub photons: Vec<f64>,
    /// Probability of at least one detected photon of a shot.
    pub probability: Vec<f64>,
    /// Mean rate over pulses and pauses, Hz.
    pub rate_hz: Vec<f64>,
    /// The channel's rate from sunlight, Hz.
    pub passive_hz: Vec<f64>,
    /// Transmission of the air, one way, to the telescope.
    pub transmission: Vec<f64>,
    /// Angle between laser, target and telescope, degrees; of a laser that has a site of its own.
    pub apart_deg: Option<Vec<f64>>,
    /// Transmission of the air, one way, from the laser.
    pub up: Vec<f64>,
    /// Photons per shot that were scattered more than once; 0 where they are not traced.
    pub bounced: Vec<f64>,
    /// Claimed error of these.
    pub bounced_error: Vec<f64>,
    /// Photons per shot that corner cubes returned; 0 without them.
    pub retro: Vec<f64>,
    /// Cross-section of the corner cubes towards the telescope, m².
    pub cross_section_m2: Vec<f64>,
    /// Angle of the telescope from the middle of the beam that they return, radians: velocity aberration.
    pub aberration_rad: Vec<f64>,
    /// Cells of speckle that share the telescope: 1 where it sees one.
    pub speckles: Vec<f64>,
    /// Radius of the spot at the target, m.
    pub spot_m: Vec<f64>,
    /// Sunlight over laser light at the target, within the line and a pulse.
    pub sun_ratio: Vec<f64>,
    /// Earthshine onto a facet that faces the Earth, over the same.
    pub earth_ratio: Vec<f64>,
    /// Mean distance of the returned photons against the body's origin, m.
    pub mean_m: Vec<f64>,
    /// Mean distance of the first photon of each shot against the body's origin, m.
    pub first_m: Vec<f64>,
    /// For each sample the photons per shot in each bin; nothing while it is hidden.
    pub profiles: Vec<Option<Profile>>,
    /// Sunlight over laser light by [`ALTITUDES_KM`], target in the zenith: Sun, and Earth below a Sun in the zenith.
    pub by_altitude: Vec<(f64, f64)>,
}

/// The channel that catches a laser's light: the one that it names, else the counter that is most sensitive to it.
fn channel(pass: &Pass, laser: &Laser) -> Result<usize, ReturnsError> {
    let station = &pass.station;
    let at = |c: &Channel| c.sensitivity_at(laser.wavelength_nm);
    if let Some(name) = &laser.receiver {
        let found = station.channels.iter().position(|c| c.name == *name);
        let found = found.ok_or_else(|| ReturnsError::NoChannel { name: name.clone() })?;
        if at(&station.channels[found]) <= 0.0 {
            return Err(ReturnsError::Deaf {
                laser: laser.name.clone(),
                channel: name.clone(),
                wavelength_nm: laser.wavelength_nm,
            });
        }
        return Ok(found);
    }
    let counters = station.channels.iter().enumerate();
    let counters = counters.filter(|(_, c)| matches!(c.detector, Detector::Counter(_)));
    let best = counters.max_by(|a, b| at(a.1).total_cmp(&at(b.1)));
    match best {
        Some((number, c)) if at(c) > 0.0 => Ok(number),
        _ => Err(ReturnsError::NoReceiver {
            laser: laser.name.clone(),
            station: station.name.clone(),
            wavelength_nm: laser.wavelength_nm,
        }),
    }
}

/// One-way transmission at the laser's wavelength; 1 without air, NaN below the horizon.
fn transmission(pass: &Pass, zenith: Zenith, sampling: &Sampling) -> f64 {
    match &pass.air {
        None => 1.0,
        Some(air) => air.transmission(zenith, sampling).map_or(f64::NAN, |t| t[0]),
    }
}

/// Earthshine at a wavelength on a facet that faces the Earth's middle, of the Sun's irradiance; NaN where the Earth's albedo is not known.
fn earthshine(earth: &EarthAlbedo, globe: &Globe, nm: f64) -> f64 {
    if !knows(earth, nm) {
        return f64::NAN;
    }
    let nodes = earth.shines(globe, CAP_ORDER, nm);
    nodes.iter().map(|(d, e)| e * d.dot(globe.toward).max(0.0)).sum()
}

fn knows(earth: &EarthAlbedo, nm: f64) -> bool {
    let (first, last) = earth.known_nm();
    (first..=last).contains(&nm)
}

/// Inputs that are the same for all shots of a laser.
struct Aim<'a> {
    pass: &'a Pass,
    beam: Beam,
    receiver: Receiver,
    rho: Vec<f64>,
    bins: DepthBins,
    sampling: Sampling,
}

/// One shot's return.
struct Return {
    profile: Profile,
    /// Transmissions of the air up and down.
    air: [f64; 2],
    laser_range_m: f64,
    cross_section_m2: f64,
    aberration_rad: f64,
    speckles: f64,
}

impl Aim<'_> {
    /// The return at a place; `None` while station or laser do not see the target.
    fn shot(
        &self,
        eyes: &mut (FacetedEye<'_>, BouncesEye<'_>),
        place: &Place,
        elsewhere: Option<&Elsewhere>,
    ) -> Result<Option<Return>, ReturnsError> {
        if place.hidden || elsewhere.is_some_and(|e| e.zenith_deg > 90.0) {
            return Ok(None);
        }
        let geometry = &place.geometry;
        let air = |zenith_deg, range_m| {
            transmission(self.pass, Zenith::Near { true_deg: zenith_deg, range_m }, &self.sampling)
        };
        let telescope = Stand { toward: place.observer_body, range_m: geometry.range_m };
        let down = air(geometry.zenith_deg(), geometry.range_m);
        let (laser, up) = elsewhere.map_or((telescope, down), |e| {
            (Stand { toward: e.toward_body, range_m: e.range_m }, air(e.zenith_deg, e.range_m))
        });
        let shot = Shot {
            beam: &self.beam,
            receiver: &self.receiver,
            laser,
            telescope,
            off_axis_m: glam::DVec3::ZERO,
            sun_body: place.sun_body,
        };
        let mut profile = shot.profile(&mut eyes.0, &self.rho, self.bins)?;
        shot.add_bounces(&mut eyes.1, &mut profile)?;
        let array = &self.pass.target.retros;
        let velocity = place.body_to_gcrs.conjugate() * geometry.target.velocity_m_s;
        let cross_section_m2 = shot.add_cubes(array, velocity, &mut profile)?;
        let nm = self.beam.wavelength_nm;
        // The array is as wide as a cell of speckle is narrow: λr/D.
        let across_m = if array.cubes.is_empty() { 0.0 } else { array.across_m(nm, laser.toward) };
        let cell_m2 = (nm * 1e-9 * telescope.range_m / across_m).powi(2);
        let profile = profile.through(up, down);
        Ok(Some(Return {
            profile,
            air: [up, down],
            laser_range_m: laser.range_m,
            cross_section_m2,
            aberration_rad: velocity_aberration(velocity, laser.toward).length(),
            speckles: 1.0 + self.receiver.area_m2 / cell_m2,
        }))
    }
}

/// Prepares the inter-reflection of the laser's light between the body's surfaces, to the tolerance of the pass.
fn bounces(pass: &Pass, nm: f64) -> Result<Bounces, BouncesError> {
    let options = BounceOptions { tolerance: pass.tolerance, ..BOUNCES };
    Bounces::new(&pass.target, nm, pass.effects.inter_reflection, &options)
}

impl<'a> Returns<'a> {
    /// Computes the returns along a simulated pass.
    ///
    /// # Errors
    /// No channel that counts the laser's light, a target or surface that is none, air or site without an answer.
    pub fn new(simulation: &Simulation<'a>, laser: &'a Laser) -> Result<Self, ReturnsError> {
        let pass = simulation.pass;
        let channel = channel(pass, laser)?;
        let nm = laser.wavelength_nm;
        let efficiency = pass.station.channels[channel].sensitivity_at(nm);
        let body = Faceted::new(&pass.target).map_err(|source| {
            let name = pass.target.name.clone();
            ReturnsError::Target { name, source }
        })?;
        let name = || laser.name.clone();
        let rho = body
            .scene()
            .reflectances(nm)
            .map_err(|source| ReturnsError::Uncovered { laser: name(), source })?;
        let bounces =
            bounces(pass, nm).map_err(|source| ReturnsError::Bounces { laser: name(), source })?;
        let half_m = 1.02 * body.radius_m().max(pass.target.retros.reach_m()).max(1e-6);
        // Light from one side of a ball to the other is late by up to √2 of its radius.
        let far_m = if bounces.need().needed { SQRT_2 * half_m } else { half_m };
        let aim = Aim {
            pass,
            beam: Beam::of(laser),
            receiver: Receiver { area_m2: pass.station.telescope.area_m2(), efficiency },
            rho,
            bins: DepthBins {
                from_m: -half_m,
                step_m: (half_m + far_m) / BINS as f64,
                count: BINS,
            },
            sampling: Sampling::points(&[nm]).map_err(|source| ReturnsError::Air {
                laser: name(),
                wavelength_nm: nm,
                source,
            })?,
        };
        let places = &simulation.places;
        let elsewhere = laser
            .site
            .map(|site| pass.elsewhere(&site, places))
            .transpose()
            .map_err(|source| ReturnsError::Site { laser: name(), source })?;
        let found: Vec<Option<Return>> = (0..places.len())
            .into_par_iter()
            .map_init(
                || (body.eye(), bounces.eye()),
                |eyes, i| aim.shot(eyes, &places[i], elsewhere.as_ref().map(|e| &e[i])),
            )
            .collect::<Vec<_>>()
            .into_iter()
            .collect::<Result<_, ReturnsError>>()?;
        let mut returns = Self::empty(simulation, laser, channel, &aim, bounces.need().clone());
        returns.apart_deg = elsewhere.map(|all| all.iter().map(|e| e.apart_deg).collect());
        for (i, found) in found.into_iter().enumerate() {
            match found {
                Some(one) => returns.set(i, one, &aim, &places[i]),
                None => returns.profiles.push(None),
            }
        }
        Ok(returns)
    }

    fn empty(
        simulation: &Simulation<'a>,
        laser: &'a Laser,
        channel: usize,
        aim: &Aim<'_>,
        need: Need,
    ) -> Self {
        let unknown = vec![f64::NAN; simulation.places.len()];
        Self {
            laser,
            channel,
            efficiency: aim.receiver.efficiency,
            need,
            bins: aim.bins,
            photons: unknown.clone(),
            probability: unknown.clone(),
            rate_hz: unknown.clone(),
            passive_hz: simulation.channels[channel].rate_hz.clone(),
            transmission: unknown.clone(),
            apart_deg: None,
            up: unknown.clone(),
            bounced: unknown.clone(),
            bounced_error: unknown.clone(),
            retro: unknown.clone(),
            cross_section_m2: unknown.clone(),
            aberration_rad: unknown.clone(),
            speckles: unknown.clone(),
            spot_m: unknown.clone(),
            sun_ratio: unknown.clone(),
            earth_ratio: unknown.clone(),
            mean_m: unknown.clone(),
            first_m: unknown,
            profiles: Vec::with_capacity(simulation.places.len()),
            by_altitude: by_altitude(aim.pass, &aim.beam, &aim.sampling),
        }
    }

    fn set(&mut self, i: usize, found: Return, aim: &Aim<'_>, place: &Place) {
        let Return { profile, air, laser_range_m, cross_section_m2, aberration_rad, speckles } =
            found;
        let [up, down] = air;
        let (pass, nm) = (aim.pass, self.laser.wavelength_nm);
        let (first_nm, last_nm) = pass.sun.range_nm();
        let sun = if (first_nm..=last_nm).contains(&nm) { pass.sun.at(nm) } else { f64::NAN };
        let laser_light = up * aim.beam.peak_spectral_irradiance(laser_range_m);
        let au = place.geometry.sun.distance_au();
        self.photons[i] = profile.total;
        // What surfaces send is shared by many cells of speckle, what few cubes return by few.
        let scattered = profile.total - profile.retro;
        let none = none_of_speckled(profile.retro, speckles, 0.0).ln() - scattered;
        self.probability[i] = -none.exp_m1();
        self.retro[i] = profile.retro;
        self.cross_section_m2[i] = cross_section_m2;
        self.aberration_rad[i] = aberration_rad;
        self.speckles[i] = speckles;
        self.rate_hz[i] = profile.total * aim.beam.repetition_rate_hz;
        self.transmission[i] = down;
        self.up[i] = up;
        self.bounced[i] = profile.bounced.as_ref().map_or(0.0, |b| b.total);
        self.bounced_error[i] = profile.bounced.as_ref().map_or(0.0, |b| b.error);
        self.spot_m[i] = aim.beam.spot_radius_m(laser_range_m);
        self.sun_ratio[i] = place.sunlit * sun / (au * au) / laser_light;
        let earth =
            place.lighting().earth.map_or(0.0, |globe| earthshine(&aim.pass.earth, &globe, nm));
        self.earth_ratio[i] = earth * sun / (au * au) / laser_light;
        self.mean_m[i] = profile.mean_depth_m();
        self.first_m[i] = mean(&profile.first_photon(), aim.bins);
        self.profiles.push(Some(profile));
    }

    /// The largest share of photons that were scattered more than once.
    pub fn most_bounced(&self) -> f64 {
        let shares = self.bounced.iter().zip(&self.photons).map(|(b, n)| b / n);
        shares.filter(|s| s.is_finite()).fold(0.0, f64::max)
    }

    /// Sums of all samples' photons per shot, of their first photons and of the true depth of what is seen, m², in each bin.
    pub fn summed(&self) -> [Vec<f64>; 3] {
        let mut sums = [0; 3].map(|_| vec![0.0; self.bins.count]);
        for profile in self.profiles.iter().flatten() {
            let add = |sum: &mut Vec<f64>, with: &[f64]| {
                sum.iter_mut().zip(with).for_each(|(s, w)| *s += w);
            };
            add(&mut sums[0], &profile.photons);
            add(&mut sums[1], &profile.first_photon());
            add(&mut sums[2], &profile.area_m2);
        }
        sums
    }

    /// The middle of a bin, m.
    pub fn middle_m(&self, bin: usize) -> f64 {
        self.bins.from_m + (bin as f64 + 0.5) * self.bins.step_m
    }

    /// Samples in which at least 95 % of the shots are detected: their first photons are mostly from the near side.
    pub fn saturated(&self) -> usize {
        self.photons.iter().filter(|n| **n > SATURATED).count()
    }

    /// The sample with the most photons per shot.
    pub fn best(&self) -> Option<usize> {
        let good = (0..self.photons.len()).filter(|i| self.photons[*i] > 0.0);
        good.max_by(|a, b| self.photons[*a].total_cmp(&self.photons[*b]))
    }

    /// Returns the warnings to read before believing the numbers.
    pub fn concerns(&self) -> Vec<String> {
        let mut concerns = Vec::new();
        let name = &self.laser.name;
        if self.best().is_none() {
            concerns.push(format!("laser {name}: nothing comes back in any sample"));
        }
        let small = self.profiles.iter().zip(&self.spot_m);
        let small = small.filter(|(p, spot)| p.is_some() && **spot < -self.bins.from_m).count();
        if small > 0 {
            concerns.push(format!(
                "laser {name}: in {small} samples the spot is smaller than the body: the beam is aimed at the body's origin"
            ));
        }
        concerns
    }
}

/// The mean of bins' middles by weights, m; NaN where all are 0.
fn mean(weights: &[f64], bins: DepthBins) -> f64 {
    let middle = |k: usize| bins.from_m + (k as f64 + 0.5) * bins.step_m;
    let sum: f64 = weights.iter().enumerate().map(|(k, w)| w * middle(k)).sum();
    sum / weights.iter().sum::<f64>()
}

/// Sunlight over laser light in the zenith, by altitude: of the Sun at 1 au, and of the Earth below a Sun in the zenith.
fn by_altitude(pass: &Pass, beam: &Beam, sampling: &Sampling) -> Vec<(f64, f64)> {
    let air = transmission(pass, Zenith::True(0.0), sampling);
    let sun = sun_at_1_au();
    let (first, last) = sun.range_nm();
    let known = (first..=last).contains(&beam.wavelength_nm);
    let sun = if known { sun.at(beam.wavelength_nm) } else { f64::NAN };
    let radius_m = sunglint_ephemeris::orbit::eclipse::EARTH_EQUATORIAL_RADIUS_M;
    // Above no place in particular.
    let nm = beam.wavelength_nm;
    let albedo = if knows(&pass.earth, nm) { pass.earth.mean_at(nm) } else { f64::NAN };
    let ratio = |km: &f64| {
        let range_m = km * 1e3;
        let laser = air * beam.peak_spectral_irradiance(range_m);
        let globe = Globe {
            toward: glam::DVec3::NEG_Z,
            distance_m: radius_m + range_m,
            radius_m,
            sun: glam::DVec3::Z,
            to_ground: glam::DQuat::IDENTITY,
        };
        let even = shine::cap(&globe, CAP_ORDER);
        let even: f64 = even.iter().map(|(d, e)| e * d.dot(globe.toward).max(0.0)).sum();
        (sun / laser, albedo * even * sun / laser)
    };
    ALTITUDES_KM.iter().map(ratio).collect()
}
