//! The way through a pass: places, light, counts.

use super::alike::Kept;
use super::along::{Along, Sketch};
use super::counts::{Counts, Light};
use super::functionals::Functionals;
use super::{BANDS, Pass, PassError, Ready, shadow};
use crate::attitude::Moment;
use crate::light::disc::eclipse as fractions;
use crate::light::engine::Switch;
use crate::light::{Globe, Need, SceneReport, Source, Term};
use glam::{DQuat, DVec3};
use hifitime::Epoch;
use ndarray::Array2;
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};
use sunglint_ephemeris::geometry::Geometry;
use sunglint_ephemeris::orbit::Orbit;
use sunglint_ephemeris::orbit::eclipse::Discs;
use sunglint_formats::time::format_utc_shortest;
use sunglint_radiometry::air::{AirError, Zenith};
use sunglint_radiometry::sky::{LUNAR_RADIUS_M, Observer, OrientationOrigin, Site, SkyFrames};
use sunglint_radiometry::station::Predicted;

/// Epochs that are done between two reports of progress.
pub(super) const REPORT_EVERY: usize = 256;

/// Stage of the work.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Stage {
    /// Orbit, frames, Sun, attitude: for every epoch.
    Places,
    /// The integrals over wavelength, and their tables over the zenith angle: once.
    Tables,
    /// The weights of the material spectra: for every epoch.
    Light,
    /// Spectra, rates, magnitudes: for every epoch.
    Counts,
    /// A piece is with whoever takes it ([`Pass::simulate_in_pieces`]).
    Given,
    /// All is done.
    Done,
}

impl Stage {
    /// The stage in a word.
    pub fn name(self) -> &'static str {
        match self {
            Self::Places => "places",
            Self::Tables => "tables",
            Self::Light => "light",
            Self::Counts => "counts",
            Self::Given => "results",
            Self::Done => "done",
        }
    }
}

/// How far a simulation is: told at the start of every stage, and within it now and then.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// Stage of the work.
    pub stage: Stage,
    /// Epochs that are done.
    pub done: usize,
    /// Number of all epochs.
    pub of: usize,
}

/// Where everything stands at one epoch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Target, Sun and station.
    pub geometry: Geometry,
    /// The visible part of the Sun's light, of its limb-darkened disc; 1 where eclipses are switched off.
    pub sunlit: f64,
    /// The discs of Sun and Earth where the one hides a part of the other.
    pub discs: Option<Discs>,
    /// The Moon as the body sees it, GCRS axes; `None` where its light is not wanted.
    pub moon: Option<Globe>,
    /// How far off the visible part may be: the Earth's air at the edge of the shadow.
    pub sunlit_error: f64,
    /// How the body is turned.
    pub body_to_gcrs: DQuat,
    /// How the Earth is: from the axes of the GCRS to those of the ITRS.
    pub gcrs_to_itrs: DQuat,
    /// Unit vector to the Sun, body axes.
    pub sun_body: DVec3,
    /// Unit vector to the station, body axes, in the rest frame of the body.
    pub observer_body: DVec3,
    /// True altitude of the Sun at the station, degrees.
    pub sun_altitude_deg: f64,
    /// Apparent zenith angle of the target, degrees; `None` below the refracted horizon.
    pub apparent_zenith_deg: Option<f64>,
    /// Whether it is below the horizon or behind what stands there.
    pub hidden: bool,
    /// Where the Earth's orientation was from.
    pub orientation: OrientationOrigin,
}

/// Samples of a channel along the pass.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelSamples {
    /// The channel.
    pub name: String,
    /// Predicted rate at the detector, after the air, Hz; NaN below the horizon.
    pub rate_hz: Vec<f64>,
    /// How far off that may be by the simulation's stated error, Hz; NaN where the rate is.
    pub error_hz: Vec<f64>,
    /// Rate without the air, Hz.
    pub above_air_hz: Vec<f64>,
    /// Response of the detector to the rate.
    pub predicted: Vec<Predicted>,
    /// Width of the channel for which light, material or air was not tabulated, nm.
    pub uncovered_nm: Vec<f64>,
}

/// Known errors of a simulation, apart from those of its models and tables.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Bounds {
    /// Largest error of a mean transmission by its table over the zenith angle: measured between its nodes.
    pub transmission: f64,
    /// Zenith angles in that table.
    pub transmission_nodes: usize,
    /// The largest share of a rate after the air, over visible samples with light, that this makes.
    pub rate_relative: f64,
    /// The largest relative error of ΣW that the light engine estimates of itself.
    pub light_relative: f64,
    /// Epochs at which light between surfaces, of the Earth and of the Moon was computed; it is interpolated in time between them.
    pub indirect_epochs: usize,
}

/// A simulated pass.
#[derive(Debug, Clone)]
pub struct Simulation<'a> {
    /// Pass that was simulated.
    pub pass: &'a Pass,
    /// Name of what is observed: in the whole pass, where this is a piece of one.
    pub object: String,
    /// Where everything stood.
    pub places: Vec<Place>,
    /// W_k, m² sr⁻¹: epochs × [`Simulation::terms`] that have light.
    pub weights: Array2<f64>,
    /// Their errors, absolute, m² sr⁻¹: epochs × all terms.
    pub errors: Array2<f64>,
    /// The terms of the light: those that have weights, then those that have errors alone.
    pub terms: Vec<Term>,
    /// The material of each term that has light; the way the light came where it is of none.
    pub weight_materials: Vec<String>,
    /// Spectra, epochs × bins, in the unit of [`Pass::spectral`]; NaN below the horizon where they are after the air.
    pub spectra: Array2<f64>,
    /// The stated errors of the spectra, same unit.
    pub spectra_errors: Array2<f32>,
    /// Whether a spectrum has bins that a table does not cover.
    pub spectra_uncovered: Vec<bool>,
    /// The channels of the station.
    pub channels: Vec<ChannelSamples>,
    /// Magnitudes above the air in [`BANDS`], epochs × bands; NaN without light.
    pub magnitudes: Array2<f64>,
    /// The stated errors of both, mag: by how much less light there may be (infinite where there may be none).
    pub magnitude_errors: Array2<f64>,
    /// The same after the air; NaN below the horizon too.
    pub ground_magnitudes: Array2<f64>,
    /// Angles of the target's hinges, epochs × hinges, degrees.
    pub hinges_deg: Array2<f64>,
    /// Known errors of the simulation.
    pub bounds: Bounds,
    /// For each epoch, which way of the light has most of the stated error of the worst channel (of V without any channel).
    pub limits: Vec<Option<Source>>,
    /// By how much the mean over each exposure differs from its middle, which stands for it: relative, in the channel in which it is most (in V without any channel), by three points of Gauss's
    /// rule for each 10° that the body turns (four widths of its narrowest glint, where that is less), and more where two such rules differ (192 at most). 0 where the body turns by less than [`TURN_DEG`](super::exposure::TURN_DEG) in an exposure, or, where
    /// that is less, by √tolerance of the width of its narrowest glint: there nothing was looked at.
    pub smear: Vec<f64>,
    /// Report of the light engine on the target.
    pub scene: SceneReport,
    /// Needs of the scene, effect by effect.
    pub needs: Vec<Need>,
}

impl Pass {
    /// Simulates the pass: epochs side by side, each of them on its own, so that no result depends on the number of threads.
    ///
    /// # Errors
    /// [`PassError`]: the first epoch (in the order of the times) at which target, Sun or attitude have no place; a target, an air or a spectrum that
    /// is none.
    pub fn simulate(
        &self,
        progress: &(dyn Fn(Progress) + Sync),
    ) -> Result<Simulation<'_>, PassError> {
        self.simulated(progress, true, None)
    }

    /// The same where nothing is asked about exposures: [`Simulation::smear`] is 0.
    pub(super) fn simulate_moments(
        &self,
        progress: &(dyn Fn(Progress) + Sync),
    ) -> Result<Simulation<'_>, PassError> {
        self.simulated(progress, false, None)
    }

    pub(super) fn simulated(
        &self,
        progress: &(dyn Fn(Progress) + Sync),
        exposures: bool,
        kept: Option<&Kept>,
    ) -> Result<Simulation<'_>, PassError> {
        self.check()?;
        let of = self.times.len();
        let begin = |stage| progress(Progress { stage, done: 0, of });
        let counter = AtomicUsize::new(0);
        let tick = |stage| {
            let done = counter.fetch_add(1, Ordering::Relaxed) + 1;
            if done.is_multiple_of(REPORT_EVERY) {
                progress(Progress { stage, done: done.min(of), of });
            }
        };

        begin(Stage::Places);
        let mut places = self.places(&|| tick(Stage::Places))?;

        begin(Stage::Tables);
        let ready = self.ready_with(&self.course(&places), kept)?;
        let functionals = &ready.functionals;
        places.par_iter_mut().try_for_each(|place| self.refract(place, functionals))?;

        begin(Stage::Light);
        counter.store(0, Ordering::Relaxed);
        let sketches: Vec<Sketch> = places.iter().map(Sketch::of).collect();
        let along = Along::new(&ready, &sketches, &|i| Ok(places[i]), &|| tick(Stage::Light))?;
        drop(sketches);
        let lit = ready.lit(&places, along.as_ref(), 0, &|| tick(Stage::Light))?;

        begin(Stage::Counts);
        counter.store(0, Ordering::Relaxed);
        let counts = ready.counted(&places, &lit, &self.exposure_s, &|| tick(Stage::Counts))?;
        let bounds = ready.bounds(along.as_ref(), of, &lit, &counts);
        let smear = match exposures {
            true => ready.smear(&self.way_around()?, &places, &lit, &counts, 0),
            false => vec![0.0; of],
        };
        let simulation = Simulation {
            smear,
            ..self.gathered(self.object(), places, &lit, counts, bounds, &ready)
        };
        begin(Stage::Done);
        Ok(simulation)
    }

    /// The Moon, where its light could matter.
    fn moon(&self, geometry: &Geometry, observer: &Observer) -> Result<Option<Globe>, PassError> {
        let wanted = match self.effects.moonshine {
            Switch::On => true,
            Switch::Off => false,
            Switch::Auto => self.tolerance < 1e-5,
        };
        if !wanted {
            return Ok(None);
        }
        let state = &geometry.target;
        let moon = observer.frame().moon_from(state.position_m, state.velocity_m_s)?;
        let place = moon.distance_m * moon.direction_gcrs;
        let sun = geometry.sun.distance_m * geometry.sun.direction_gcrs;
        Ok(Some(Globe {
            toward: moon.direction_gcrs,
            distance_m: moon.distance_m,
            radius_m: LUNAR_RADIUS_M,
            sun: (sun - place).normalize_or_zero(),
            to_ground: DQuat::IDENTITY,
        }))
    }

    pub(super) fn check(&self) -> Result<(), PassError> {
        let wrong = |needs, found| Err(PassError::Input { needs, found });
        if self.times.is_empty() {
            return wrong("at least one time", "none".into());
        }
        if self.exposure_s.len() != self.times.len() {
            let found = format!("{} for {} times", self.exposure_s.len(), self.times.len());
            return wrong("an exposure for each time", found);
        }
        if !self.observations.is_empty() && self.observations.len() != self.times.len() {
            let found = format!("{} for {} times", self.observations.len(), self.times.len());
            return wrong("an observation for each time", found);
        }
        if let Some(bad) = self.exposure_s.iter().find(|s| !(s.is_finite() && **s > 0.0)) {
            return wrong("exposures above 0 s", format!("{bad} s"));
        }
        if self.bins() == 0 {
            return wrong("at least one spectral bin", "none".into());
        }
        Ok(())
    }

    /// The earliest and the latest of the times, which may stand in any order.
    pub(super) fn ends(&self) -> (Epoch, Epoch) {
        let first = self.times[0];
        self.times.iter().fold((first, first), |(a, b), t| (a.min(*t), b.max(*t)))
    }

    /// Frames at times, and around each of them; the earliest and the latest, `around_s` before and after, are among them.
    pub(super) fn frames(
        &self,
        times: impl Iterator<Item = Epoch>,
        around_s: f64,
    ) -> Result<SkyFrames<'_>, PassError> {
        let mut all: Vec<Epoch> = times.collect();
        let around = hifitime::Duration::from_seconds(around_s);
        let ends = all.iter().copied().min().zip(all.iter().copied().max());
        if let Some((first, last)) = ends.filter(|_| around_s > 0.0) {
            all.extend([first - around, last + around]);
        }
        Ok(SkyFrames::among(&all, self.orientation())?)
    }

    /// Frames and orbit for all epochs, whichever of them are asked for.
    pub(super) fn way(&self) -> Result<Way<'_>, PassError> {
        let later = hifitime::Duration::from_seconds(self.correction.time_offset_s);
        let (first, last) = self.ends();
        let frames = self.frames(self.times.iter().map(|time| *time + later), 0.0)?;
        let orbit = self.orbit.near(first + later, last + later);
        Ok(Way { pass: self, later, frames, orbit })
    }

    /// The same to the ends of all exposures.
    pub(super) fn way_around(&self) -> Result<Way<'_>, PassError> {
        let later = hifitime::Duration::from_seconds(self.correction.time_offset_s);
        let longest = self.exposure_s.iter().copied().fold(0.0, f64::max);
        let half = hifitime::Duration::from_seconds(0.5 * longest);
        let (first, last) = self.ends();
        let frames = self.frames(self.times.iter().map(|time| *time + later), 0.5 * longest)?;
        let orbit = self.orbit.near(first + later - half, last + later + half);
        Ok(Way { pass: self, later, frames, orbit })
    }

    /// Where everything stands at all epochs, before any air.
    pub(super) fn places(&self, tick: &(dyn Fn() + Sync)) -> Result<Vec<Place>, PassError> {
        self.way()?.places(0..self.times.len(), tick)
    }

    /// Where everything stands at an epoch; nothing is said of air and horizon yet.
    pub(super) fn place(
        &self,
        epoch: Epoch,
        orbit: &Orbit,
        frames: &SkyFrames<'_>,
    ) -> Result<Place, PassError> {
        self.place_from(&self.station.site, epoch, orbit, frames)
    }

    /// The same as seen from another site.
    pub(super) fn place_from(
        &self,
        site: &Site,
        epoch: Epoch,
        orbit: &Orbit,
        frames: &SkyFrames<'_>,
    ) -> Result<Place, PassError> {
        let observer = Observer::new(frames.at(epoch)?, site);
        let shape = self.shadow.unwrap_or_default();
        let geometry = Geometry::over(orbit, &observer, shape).map_err(|source| {
            PassError::Geometry { epoch_utc: format_utc_shortest(epoch), source: Box::new(source) }
        })?;
        let (body_to_gcrs, sun_body, observer_body) = self.turn(&geometry)?;
        let partly = self.shadow.is_some() && geometry.sunlit > 0.0 && geometry.sunlit < 1.0;
        let discs = partly.then(|| Discs::at(geometry.target.position_m, &geometry.sun, shape));
        let sunlit = match (&discs, self.shadow) {
            (Some(discs), _) => fractions::fractions(discs)[0],
            (None, Some(_)) => geometry.sunlit,
            (None, None) => 1.0,
        };
        Ok(Place {
            sunlit,
            discs,
            moon: self.moon(&geometry, &observer)?,
            sunlit_error: self.shadow.map_or(0.0, |_| shadow::error(&geometry)),
            body_to_gcrs,
            gcrs_to_itrs: DQuat::from_mat3(&observer.frame().gcrs_to_itrs()),
            sun_body,
            observer_body,
            sun_altitude_deg: geometry.sun_altitude_deg(&observer),
            apparent_zenith_deg: None,
            hidden: true,
            orientation: observer.frame().orientation().origin,
            geometry,
        })
    }

    /// How the body is turned at a geometry, and where it then sees Sun and station.
    fn turn(&self, geometry: &Geometry) -> Result<(DQuat, DVec3, DVec3), PassError> {
        let moment = Moment {
            epoch: geometry.emitted,
            target: geometry.target,
            to_sun: geometry.sun.direction_gcrs,
        };
        let body_to_gcrs = self.attitude.body_to_gcrs(&moment).map_err(|source| {
            let epoch_utc = format_utc_shortest(geometry.epoch);
            PassError::Attitude { epoch_utc, source: Box::new(source) }
        })?;
        let (to_sun, to_observer) = geometry.rest_frame_directions();
        let gcrs_to_body = body_to_gcrs.conjugate();
        let [sun, observer] = [to_sun, to_observer].map(|d| (gcrs_to_body * d).normalize());
        Ok((body_to_gcrs, sun, observer))
    }

    /// A place with the body turned as the pass's attitude has it now.
    pub(super) fn turned(&self, place: &Place) -> Result<Place, PassError> {
        let (body_to_gcrs, sun_body, observer_body) = self.turn(&place.geometry)?;
        Ok(Place { body_to_gcrs, sun_body, observer_body, ..*place })
    }

    /// Adds what the air makes of a place: the apparent zenith angle, and whether the station sees it.
    pub(super) fn refract(
        &self,
        place: &mut Place,
        functionals: &Functionals,
    ) -> Result<(), PassError> {
        let geometry = &place.geometry;
        let zenith = Zenith::Near { true_deg: geometry.zenith_deg(), range_m: geometry.range_m };
        place.apparent_zenith_deg = match functionals.sums.apparent_deg(zenith) {
            Ok(deg) => Some(deg),
            Err(AirError::BelowHorizon { .. }) => None,
            Err(error) => return Err(error.into()),
        };
        let azimuth_deg = geometry.horizontal.azimuth_deg();
        let sees = |z: f64| self.station.sees(90.0 - z, azimuth_deg);
        place.hidden = !place.apparent_zenith_deg.is_some_and(sees);
        Ok(())
    }

    pub(super) fn gathered(
        &self,
        object: String,
        places: Vec<Place>,
        lit: &[Lit],
        mut counts: Vec<Counts>,
        bounds: Bounds,
        ready: &Ready<'_>,
    ) -> Simulation<'_> {
        let n = places.len();
        // The largest of all: each row is given back as soon as it stands among the others.
        let mut spectra = Array2::zeros((n, self.bins()));
        let mut spectra_errors = Array2::zeros((n, self.bins()));
        for (i, counts) in counts.iter_mut().enumerate() {
            let spectrum = std::mem::take(&mut counts.spectrum);
            spectra.row_mut(i).iter_mut().zip(spectrum).for_each(|(to, from)| *to = from);
            let errors = std::mem::take(&mut counts.spectrum_errors);
            spectra_errors.row_mut(i).iter_mut().zip(errors).for_each(|(to, from)| *to = from);
        }
        let (engine, terms) = (&ready.engine, ready.engine.terms());
        let materials = |m: usize| self.target.materials[m].name.clone();
        let name = |t: &Term| t.material.map_or_else(|| t.source.name().to_owned(), materials);
        let channel = |c: usize| ChannelSamples {
            name: self.station.channels[c].name.clone(),
            rate_hz: counts.iter().map(|x| x.channels[c].rate_hz).collect(),
            error_hz: counts.iter().map(|x| x.channels[c].error_hz).collect(),
            above_air_hz: counts.iter().map(|x| x.channels[c].above_air_hz).collect(),
            predicted: counts.iter().map(|x| x.channels[c].predicted).collect(),
            uncovered_nm: counts.iter().map(|x| x.channels[c].uncovered_nm).collect(),
        };
        let channels = (0..self.station.channels.len()).map(channel).collect();
        let hinges = self.target.hinges.len();
        let hinges_deg = Array2::from_shape_fn((n, hinges), |(i, h)| {
            self.target.hinges[h].angle_rad(places[i].sun_body).to_degrees()
        });
        Simulation {
            pass: self,
            object,
            weights: Array2::from_shape_fn((n, engine.lit_terms()), |(i, k)| lit[i].0[k]),
            errors: Array2::from_shape_fn((n, terms.len()), |(i, k)| lit[i].1[k]),
            weight_materials: terms[..engine.lit_terms()].iter().map(name).collect(),
            terms: terms.to_vec(),
            spectra,
            spectra_errors,
            spectra_uncovered: counts.iter().map(|c| c.uncovered).collect(),
            channels,
            magnitudes: Array2::from_shape_fn((n, BANDS.len()), |(i, b)| counts[i].magnitudes[b]),
            magnitude_errors: Array2::from_shape_fn((n, BANDS.len()), |(i, b)| {
                counts[i].magnitude_errors[b]
            }),
            ground_magnitudes: Array2::from_shape_fn((n, BANDS.len()), |(i, b)| {
                counts[i].ground[b]
            }),
            hinges_deg,
            places,
            bounds,
            limits: counts.iter().map(|c| c.limit).collect(),
            smear: vec![0.0; n],
            scene: ready.report().clone(),
            needs: engine.needs().to_vec(),
        }
    }
}

/// The weights of an epoch, m² sr⁻¹, and their errors.
pub(super) type Lit = (Vec<f64>, Vec<f64>);

/// Frames and orbit for all epochs of a pass: the same for any part of them.
pub(super) struct Way<'a> {
    pass: &'a Pass,
    later: hifitime::Duration,
    frames: SkyFrames<'a>,
    orbit: Orbit,
}

impl Way<'_> {
    /// Frames, orbit, and how much later than the pass's times both are asked.
    pub fn parts(&self) -> (&SkyFrames<'_>, &Orbit, hifitime::Duration) {
        (&self.frames, &self.orbit, self.later)
    }

    /// Where everything stands at an epoch, before any air.
    pub fn place(&self, i: usize) -> Result<Place, PassError> {
        self.beside(i, 0.0)
    }

    /// The same at an offset from it, s.
    pub fn beside(&self, i: usize, offset_s: f64) -> Result<Place, PassError> {
        let (orbit, site) = self.pass.of_sample(i, &self.orbit);
        let at = self.pass.times[i] + offset_s * hifitime::Unit::Second;
        self.pass.place_from(site, at + self.later, orbit, &self.frames)
    }

    /// The same of several epochs, side by side.
    pub fn places(
        &self,
        of: std::ops::Range<usize>,
        tick: &(dyn Fn() + Sync),
    ) -> Result<Vec<Place>, PassError> {
        let place = |i: usize| {
            let place = self.place(i);
            tick();
            place
        };
        first_error(of.into_par_iter().map(place).collect())
    }
}

impl Ready<'_> {
    /// The light at places that follow one another in the pass, the first of them at an epoch.
    pub(super) fn lit(
        &self,
        places: &[Place],
        along: Option<&Along>,
        first: usize,
        tick: &(dyn Fn() + Sync),
    ) -> Result<Vec<Lit>, PassError> {
        let lit = places.par_iter().enumerate().map_init(
            || self.eye(),
            |eye, (i, place)| {
                let lit = match along {
                    None => eye.weigh(place),
                    Some(along) => eye.weigh_beside(place, &|w, e| along.add(first + i, w, e)),
                };
                let lit = lit.map(|(w, e)| (w.to_vec(), e.to_vec()));
                tick();
                lit
            },
        );
        first_error(lit.collect())
    }

    /// Spectra, rates and magnitudes of places with their light and exposures (s).
    pub(super) fn counted(
        &self,
        places: &[Place],
        lit: &[Lit],
        exposure_s: &[f64],
        tick: &(dyn Fn() + Sync),
    ) -> Result<Vec<Counts>, PassError> {
        let counts = places.par_iter().zip(lit).zip(exposure_s).map(
            |((place, (weights, errors)), exposure_s)| {
                let light = Light { weights, errors };
                let counts = self.pass.counts(place, *exposure_s, light, &self.functionals);
                tick();
                counts
            },
        );
        first_error(counts.collect())
    }

    /// The known errors of epochs, of a pass of so many.
    pub(super) fn bounds(
        &self,
        along: Option<&Along>,
        of: usize,
        lit: &[Lit],
        counts: &[Counts],
    ) -> Bounds {
        Bounds {
            transmission: self.functionals.sums.interpolation_error(),
            transmission_nodes: self.functionals.sums.nodes(),
            rate_relative: counts.iter().fold(0.0, |most, c| c.relative.max(most)),
            indirect_epochs: along.map_or(of, Along::computed),
            light_relative: lit.iter().fold(0.0, |most, (w, e)| most.max(self.relative(w, e))),
        }
    }
}

/// All of them, or the first error: which one that is must not depend on the threads.
pub(super) fn first_error<T>(results: Vec<Result<T, PassError>>) -> Result<Vec<T>, PassError> {
    results.into_iter().collect()
}
