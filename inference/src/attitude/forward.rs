//! The forward model of the search: rates of a body whose turn is tried, at epochs whose geometry is known.
//!
//! Everything that does not depend on the trial is computed once: the directions to Sun and observer at the moment at which the light left (light time, aberration), and the rate that
//! a weight of each spectrum makes in each channel there (air, range, the Sun's distance, integrals over wavelength). A trial is then two rotated directions, the light
//! engine's exact sum over facets with all shadows ([`Scene`]), and a product with a small matrix. It is the direct light under a collimated Sun, and, where a search by
//! that alone has failed, the Earth's ([`Forward::with_earth`]); what else the scene needs is added at the end ([`super::search`]).

use super::AttitudeError;
use crate::solver::{Data, Unit};
use glam::{DQuat, DVec3};
use hifitime::Epoch;
use std::sync::Arc;
use sunglint_ephemeris::orbit::eclipse::EARTH_EQUATORIAL_RADIUS_M;
use sunglint_simulator::light::engine::Switches;
use sunglint_simulator::light::{EarthAlbedo, Evaluator, Globe, Parameter, Scene, View};
use sunglint_simulator::pass::{Pass, Study};

/// Where the Earth's albedo is taken, whatever the channel: what is found by it is only where the search goes on with all light. Vacuum nm.
const EARTH_NM: f64 = 550.0;
/// Turn by which the Earth's light is differentiated, radians.
const EARTH_STEP: f64 = 1e-3;

/// A measured curve beside the scene that it is of.
pub struct Measured {
    /// The scene at the curve's times; its attitude is not looked at.
    pub pass: Pass,
    /// Unit of the curve's channels.
    pub unit: Unit,
    /// Measured data.
    pub data: Data,
}

/// One epoch that has a sample.
#[derive(Debug, Clone)]
pub struct Moment {
    /// Which curve, from 0.
    pub curve: usize,
    /// Which of its samples, from 0.
    pub sample: usize,
    /// When the light left the body, s after [`Forward::zero`].
    pub time_s: f64,
    /// Unit vector to the Sun, GCRS axes.
    pub to_sun: DVec3,
    /// Unit vector to the observer, GCRS axes, in the body's frame of rest.
    pub to_observer: DVec3,
    /// From the middle of the Earth to the body, GCRS axes, m.
    pub position_m: DVec3,
    /// From the axes of the GCRS to those of the ITRS.
    pub gcrs_to_itrs: DQuat,
    /// Exposure, s.
    pub exposure_s: f64,
}

/// Measured passes of one body, ready for any number of trials.
#[derive(Debug, Clone)]
pub struct Forward {
    /// The body.
    pub scene: Scene,
    /// The moment from which seconds count: the middle between first and last sample.
    pub zero: Epoch,
    /// The epochs that have a sample, curve by curve.
    pub moments: Vec<Moment>,
    /// Channels.
    pub channels: usize,
    /// Weights of the body's spectra.
    pub weights: usize,
    /// Rates of a unit weight: `[(moment * channels + channel) * weights + k]`; 0 where the channel has no sample.
    unit: Vec<f64>,
    /// Measured rates, `[moment * channels + channel]`; NaN where none counts.
    pub rate: Vec<f64>,
    /// Their stated standard uncertainties.
    pub sigma: Vec<f64>,
    /// Light that the Earth reflects, curve by curve.
    earths: Vec<Arc<EarthAlbedo>>,
    /// Directions of the Earth's light at each moment, where that is part of a trial's.
    shine: Vec<Vec<(DVec3, f64)>>,
}

/// Room to try in: one for each thread.
pub struct Eye<'a> {
    forward: &'a Forward,
    evaluator: Evaluator<'a>,
    weights: Vec<f64>,
    slopes: Vec<f64>,
    /// The weights for one direction of light.
    one: Vec<f64>,
}

impl Forward {
    /// Makes passes ready. Samples in the Earth's shadow and below the horizon must not be marked as used.
    ///
    /// # Errors
    /// No curve; curves with different numbers of channels; a scene that cannot be simulated; a body that has no direct light under a collimated Sun (flat mirrors).
    pub fn new(curves: &[Measured]) -> Result<Self, AttitudeError> {
        let Some(first) = curves.first() else {
            return Err(AttitudeError::Few { samples: 0, epochs: 0, least: super::LEAST_EPOCHS });
        };
        let channels = first.data.channels();
        let scene = Scene::new(&first.pass.target)
            .map_err(|source| AttitudeError::Body { source: Box::new(source) })?;
        let weights = scene.weight_count();
        let mut forward = Self {
            scene,
            zero: first.pass.times.first().copied().unwrap_or_default(),
            moments: Vec::new(),
            channels,
            weights,
            unit: Vec::new(),
            rate: Vec::new(),
            sigma: Vec::new(),
            earths: curves.iter().map(|c| c.pass.earth.clone()).collect(),
            shine: Vec::new(),
        };
        let mut emitted: Vec<Epoch> = Vec::new();
        for (c, curve) in curves.iter().enumerate() {
            forward.add(c, curve, &mut emitted)?;
        }
        let ends = (emitted.iter().min().copied(), emitted.iter().max().copied());
        let (Some(from), Some(to)) = ends else {
            return Err(AttitudeError::Few { samples: 0, epochs: 0, least: super::LEAST_EPOCHS });
        };
        forward.zero = from + 0.5 * (to - from);
        for (moment, epoch) in forward.moments.iter_mut().zip(&emitted) {
            moment.time_s = (*epoch - forward.zero).to_seconds();
        }
        Ok(forward)
    }

    fn add(
        &mut self,
        number: usize,
        curve: &Measured,
        emitted: &mut Vec<Epoch>,
    ) -> Result<(), AttitudeError> {
        let data = &curve.data;
        let places = |found: usize, expected: usize, what: &'static str| {
            let name = data.name.clone();
            AttitudeError::Shape { name, what, found, expected }
        };
        if data.channels() != self.channels {
            return Err(places(data.channels(), self.channels, "channels"));
        }
        if data.epochs() != curve.pass.times.len() {
            return Err(places(data.epochs(), curve.pass.times.len(), "samples"));
        }
        let mut pass = curve.pass.clone();
        pass.effects = Switches::OFF;
        // Samples in the shadow do not count, and the colours of a Sun that is half hidden would be spectra of their own.
        pass.shadow = None;
        let study = Study::new(pass).map_err(|source| AttitudeError::Pass {
            name: data.name.clone(),
            source: Box::new(source),
        })?;
        let all = study.unit_rates();
        if all.terms.len() != self.weights {
            return Err(places(all.terms.len(), self.weights, "spectra of the body"));
        }
        for (i, place) in study.places().iter().enumerate() {
            if !data.used.row(i).iter().any(|u| *u) {
                continue;
            }
            let (to_sun, to_observer) = place.geometry.rest_frame_directions();
            emitted.push(place.geometry.emitted);
            self.moments.push(Moment {
                curve: number,
                sample: i,
                time_s: 0.0,
                to_sun,
                to_observer,
                position_m: place.geometry.target.position_m,
                gcrs_to_itrs: place.gcrs_to_itrs,
                exposure_s: curve.pass.exposure_s[i],
            });
            for c in 0..self.channels {
                let row = match &curve.unit {
                    Unit::Channels(own) => own
                        .get(c)
                        .copied()
                        .flatten()
                        .map(|own| all.rates_hz.slice(ndarray::s![i, own, ..])),
                    Unit::Band(band) => Some(all.fluxes.slice(ndarray::s![i, *band, ..])),
                };
                let good = data.used[[i, c]]
                    && row.as_ref().is_some_and(|r| r.iter().all(|v| v.is_finite()));
                match row.filter(|_| good) {
                    Some(row) => self.unit.extend(row.iter()),
                    None => self.unit.extend(std::iter::repeat_n(0.0, self.weights)),
                }
                self.rate.push(if good { data.rate[[i, c]] } else { f64::NAN });
                self.sigma.push(if good { data.sigma[[i, c]] } else { f64::NAN });
            }
        }
        Ok(())
    }

    /// Directions (GCRS axes) from which the lit Earth shines on the body at a moment, and from each the irradiance, of the Sun's, with the scene's albedo of it at 550 nm: `order` points along each
    /// side of a panel of it.
    fn earth(&self, moment: usize, order: usize) -> Vec<(DVec3, f64)> {
        let at = &self.moments[moment];
        let earth = Globe {
            toward: -at.position_m.normalize_or_zero(),
            distance_m: at.position_m.length(),
            radius_m: EARTH_EQUATORIAL_RADIUS_M,
            sun: at.to_sun,
            to_ground: at.gcrs_to_itrs,
        };
        self.earths[at.curve].shines(&earth, order, EARTH_NM)
    }

    /// The same with the Earth's light in every trial's, of `order` points along each side of a panel of it. A trial then costs several times as much.
    pub fn with_earth(mut self, order: usize) -> Self {
        self.shine = (0..self.moments.len()).map(|m| self.earth(m, order)).collect();
        self
    }

    /// Whether it is.
    pub fn has_earth(&self) -> bool {
        !self.shine.is_empty()
    }

    /// Samples that count.
    pub fn samples(&self) -> usize {
        self.rate.iter().filter(|r| r.is_finite()).count()
    }

    /// First and last moment, s.
    pub fn ends_s(&self) -> (f64, f64) {
        let times = self.moments.iter().map(|m| m.time_s);
        times.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), t| (a.min(t), b.max(t)))
    }

    /// Rates of a unit weight of each spectrum at a moment: channels × weights.
    pub fn unit_rates(&self, moment: usize) -> &[f64] {
        let size = self.channels * self.weights;
        &self.unit[moment * size..(moment + 1) * size]
    }

    /// Measured rates of a moment.
    pub fn rates(&self, moment: usize) -> &[f64] {
        &self.rate[moment * self.channels..(moment + 1) * self.channels]
    }

    /// Room to try in.
    pub fn eye(&self) -> Eye<'_> {
        Eye {
            forward: self,
            evaluator: self.scene.evaluator(),
            weights: vec![0.0; self.weights],
            slopes: vec![0.0; 3 * self.weights],
            one: vec![0.0; self.weights],
        }
    }
}

impl Eye<'_> {
    /// The weights W_k of a body that stands as `body_to_gcrs` at a moment, m² sr⁻¹.
    ///
    /// # Errors
    /// A rotation that is none.
    pub fn weights(&mut self, moment: usize, body_to_gcrs: DQuat) -> Result<&[f64], AttitudeError> {
        let at = &self.forward.moments[moment];
        let to_body = body_to_gcrs.conjugate();
        let (sun, observer) = (to_body * at.to_sun, to_body * at.to_observer);
        self.evaluator.direct(sun, View::Distant(observer), &mut self.weights)?;
        if let Some(nodes) = self.forward.shine.get(moment) {
            let mut sum = std::mem::take(&mut self.weights);
            self.add_earth(moment, body_to_gcrs, nodes, 1.0, &mut sum)?;
            self.weights = sum;
        }
        Ok(&self.weights)
    }

    /// Adds to `sum` a part of the weights for light from some directions of the lit Earth ([`Forward::earth`]).
    fn add_earth(
        &mut self,
        moment: usize,
        body_to_gcrs: DQuat,
        nodes: &[(DVec3, f64)],
        part: f64,
        sum: &mut [f64],
    ) -> Result<(), AttitudeError> {
        let at = &self.forward.moments[moment];
        let to_body = body_to_gcrs.conjugate();
        let sun = to_body * at.to_sun;
        let view = View::Distant(to_body * at.to_observer);
        for (toward, irradiance) in nodes {
            self.evaluator.direct_from(to_body * *toward, sun, view, &mut self.one)?;
            let factor = part * irradiance;
            sum.iter_mut().zip(&self.one).for_each(|(s, w)| *s += factor * w);
        }
        Ok(())
    }

    /// The weights for light from the lit Earth alone, of `order` points along each side of a panel of it.
    ///
    /// # Errors
    /// The errors of [`Eye::weights`].
    pub fn earth(
        &mut self,
        moment: usize,
        body_to_gcrs: DQuat,
        order: usize,
    ) -> Result<Vec<f64>, AttitudeError> {
        let mut sum = vec![0.0; self.forward.weights];
        let nodes = self.forward.earth(moment, order);
        self.add_earth(moment, body_to_gcrs, &nodes, 1.0, &mut sum)?;
        Ok(sum)
    }

    /// Fills `out` (one number a channel) with the rates there; 0 in channels without a sample.
    ///
    /// # Errors
    /// The errors of [`Eye::weights`].
    pub fn rates(
        &mut self,
        moment: usize,
        body_to_gcrs: DQuat,
        out: &mut [f64],
    ) -> Result<(), AttitudeError> {
        self.weights(moment, body_to_gcrs)?;
        let forward = self.forward;
        let rows = forward.unit_rates(moment).chunks_exact(forward.weights);
        for (out, row) in out.iter_mut().zip(rows) {
            *out = row.iter().zip(&self.weights).map(|(k, w)| k * w).sum();
        }
        Ok(())
    }

    /// The weights and their derivatives by three turns of the body, about the x, y and z axes of the GCRS, per radian: `slopes[axis * weights + k]`.
    ///
    /// # Errors
    /// The errors of [`Eye::weights`].
    pub fn weights_and_slopes(
        &mut self,
        moment: usize,
        body_to_gcrs: DQuat,
    ) -> Result<(&[f64], &[f64]), AttitudeError> {
        let at = &self.forward.moments[moment];
        let to_body = body_to_gcrs.conjugate();
        let turns = [DVec3::X, DVec3::Y, DVec3::Z].map(|a| Parameter::Attitude(to_body * a));
        self.evaluator.direct_derivatives(
            to_body * at.to_sun,
            View::Distant(to_body * at.to_observer),
            &turns,
            &mut self.weights,
            &mut self.slopes,
        )?;
        if let Some(nodes) = self.forward.shine.get(moment) {
            self.add_earth_and_slopes(moment, body_to_gcrs, nodes)?;
        }
        Ok((&self.weights, &self.slopes))
    }

    /// Light of an extended source changes smoothly: differences do for its slopes.
    fn add_earth_and_slopes(
        &mut self,
        moment: usize,
        body_to_gcrs: DQuat,
        nodes: &[(DVec3, f64)],
    ) -> Result<(), AttitudeError> {
        let count = self.weights.len();
        let mut own = vec![0.0; count];
        self.add_earth(moment, body_to_gcrs, nodes, 1.0, &mut own)?;
        let mut slopes = std::mem::take(&mut self.slopes);
        for (row, axis) in slopes.chunks_exact_mut(count.max(1)).zip(DVec3::AXES) {
            let turned = DQuat::from_axis_angle(axis, EARTH_STEP) * body_to_gcrs;
            self.add_earth(moment, turned, nodes, 1.0 / EARTH_STEP, row)?;
            row.iter_mut().zip(&own).for_each(|(r, w)| *r -= w / EARTH_STEP);
        }
        self.slopes = slopes;
        self.weights.iter_mut().zip(&own).for_each(|(w, o)| *w += o);
        Ok(())
    }
}
