//! The way through a pass: places, light, counts.

use super::functionals::Functionals;
use super::{BANDS, Pass, PassError, SpectralQuantity};
use crate::attitude::Moment;
use crate::geometry::Geometry;
use crate::light::SceneReport;
use crate::orbit::Orbit;
use glam::{DQuat, DVec3};
use hifitime::Epoch;
use ndarray::Array2;
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};
use sunglint_formats::time::format_utc_shortest;
use sunglint_radiometry::air::{AirError, Zenith};
use sunglint_radiometry::sky::{Observer, OrientationOrigin, SkyFrames};
use sunglint_radiometry::station::Predicted;

/// Epochs that are done between two reports of progress.
const REPORT_EVERY: usize = 256;

/// What is being done.
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
            Self::Done => "done",
        }
    }
}

/// How far a simulation is: told at the start of every stage, and within it now and then.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// What is being done.
    pub stage: Stage,
    /// Epochs that are done.
    pub done: usize,
    /// Of so many.
    pub of: usize,
}

/// Where everything stands at one epoch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Target, Sun and station.
    pub geometry: Geometry,
    /// The visible part of the Sun's disc; 1 where eclipses are switched off.
    pub sunlit: f64,
    /// How the body is turned.
    pub body_to_gcrs: DQuat,
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

/// What a channel does along the pass.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelSamples {
    /// The channel.
    pub name: String,
    /// Predicted rate at the detector, after the air, Hz; NaN below the horizon.
    pub rate_hz: Vec<f64>,
    /// Rate without the air, Hz.
    pub above_air_hz: Vec<f64>,
    /// What the detector makes of it.
    pub predicted: Vec<Predicted>,
    /// Width of the channel for which light, material or air was not tabulated, nm.
    pub uncovered_nm: Vec<f64>,
}

/// What is known of the errors of a simulation, apart from those of its models and tables.
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
}

/// A simulated pass.
#[derive(Debug, Clone)]
pub struct Simulation<'a> {
    /// What was simulated.
    pub pass: &'a Pass,
    /// Where everything stood.
    pub places: Vec<Place>,
    /// W_k, m² sr⁻¹: epochs × material spectra.
    pub weights: Array2<f64>,
    /// The material of each spectrum.
    pub weight_materials: Vec<String>,
    /// Spectra, epochs × bins, in the unit of [`Pass::spectral`]; NaN below the horizon where they are after the air.
    pub spectra: Array2<f64>,
    /// Whether a spectrum has bins that a table does not cover.
    pub spectra_uncovered: Vec<bool>,
    /// The channels of the station.
    pub channels: Vec<ChannelSamples>,
    /// Magnitudes above the air in [`BANDS`], epochs × bands; NaN without light.
    pub magnitudes: Array2<f64>,
    /// The same after the air; NaN below the horizon too.
    pub ground_magnitudes: Array2<f64>,
    /// Angles of the target's hinges, epochs × hinges, degrees.
    pub hinges_deg: Array2<f64>,
    /// What is known of the errors.
    pub bounds: Bounds,
    /// What the light engine made of the target.
    pub scene: SceneReport,
}

/// What an epoch yields.
pub(super) struct Counts {
    spectrum: Vec<f64>,
    uncovered: bool,
    pub(super) channels: Vec<(f64, f64, Predicted, f64)>,
    pub(super) magnitudes: [f64; BANDS.len()],
    pub(super) ground: [f64; BANDS.len()],
    relative: f64,
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

        begin(Stage::Tables);
        let ready = self.ready()?;
        let functionals = &ready.functionals;

        begin(Stage::Places);
        let (first, last) = self.ends();
        let frames = self.frames(first, last)?;
        let orbit = self.orbit.near(first, last);
        let places = first_error(
            self.times
                .par_iter()
                .map(|epoch| {
                    let place = self.place(*epoch, &orbit, &frames, functionals);
                    tick(Stage::Places);
                    place
                })
                .collect(),
        )?;

        begin(Stage::Light);
        counter.store(0, Ordering::Relaxed);
        let lit = places.par_iter().map_init(
            || ready.eye(),
            |eye, place| {
                let lit = eye.weigh(place).map(|(weights, error)| (weights.to_vec(), error));
                tick(Stage::Light);
                lit
            },
        );
        let (weights, light_errors): (Vec<_>, Vec<f64>) =
            first_error(lit.collect())?.into_iter().unzip();

        begin(Stage::Counts);
        counter.store(0, Ordering::Relaxed);
        let counts = first_error(
            places
                .par_iter()
                .zip(&weights)
                .enumerate()
                .map(|(i, (place, weights))| {
                    let counts = self.counts(place, self.exposure_s[i], weights, functionals);
                    tick(Stage::Counts);
                    counts
                })
                .collect(),
        )?;
        let bounds = Bounds {
            transmission: functionals.sums.interpolation_error(),
            transmission_nodes: functionals.sums.nodes(),
            rate_relative: counts.iter().fold(0.0, |most, c| c.relative.max(most)),
            light_relative: light_errors.iter().fold(0.0, |most, e| e.max(most)),
        };
        let simulation =
            self.gathered(places, weights, counts, bounds, ready.scene.report().clone());
        begin(Stage::Done);
        Ok(simulation)
    }

    fn check(&self) -> Result<(), PassError> {
        let wrong = |needs, found| Err(PassError::Input { needs, found });
        if self.times.is_empty() {
            return wrong("at least one time", "none".into());
        }
        if self.exposure_s.len() != self.times.len() {
            let found = format!("{} for {} times", self.exposure_s.len(), self.times.len());
            return wrong("an exposure for each time", found);
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
    fn ends(&self) -> (Epoch, Epoch) {
        let first = self.times[0];
        self.times.iter().fold((first, first), |(a, b), t| (a.min(*t), b.max(*t)))
    }

    fn frames(&self, first: Epoch, mut last: Epoch) -> Result<SkyFrames<'_>, PassError> {
        // Few times far apart are cheaper each on its own.
        let hours = crate::orbit::seconds_between(first, last) / 3600.0;
        if hours > self.times.len() as f64 {
            last = first;
        }
        Ok(SkyFrames::over(first, last, self.orientation())?)
    }

    pub(super) fn place(
        &self,
        epoch: Epoch,
        orbit: &Orbit,
        frames: &SkyFrames<'_>,
        functionals: &Functionals,
    ) -> Result<Place, PassError> {
        let observer = Observer::new(frames.at(epoch)?, &self.station.site);
        let shape = self.shadow.unwrap_or_default();
        let geometry = Geometry::over(orbit, &observer, shape).map_err(|source| {
            PassError::Geometry { epoch_utc: format_utc_shortest(epoch), source: Box::new(source) }
        })?;
        let moment = Moment {
            epoch: geometry.emitted,
            target: geometry.target,
            to_sun: geometry.sun.direction_gcrs,
        };
        let body_to_gcrs = self.attitude.body_to_gcrs(&moment).map_err(|source| {
            PassError::Attitude { epoch_utc: format_utc_shortest(epoch), source: Box::new(source) }
        })?;
        let (to_sun, to_observer) = geometry.rest_frame_directions();
        let gcrs_to_body = body_to_gcrs.conjugate();
        let zenith = Zenith::Near { true_deg: geometry.zenith_deg(), range_m: geometry.range_m };
        let apparent_zenith_deg = match functionals.sums.apparent_deg(zenith) {
            Ok(deg) => Some(deg),
            Err(AirError::BelowHorizon { .. }) => None,
            Err(error) => return Err(error.into()),
        };
        let azimuth_deg = geometry.horizontal.azimuth_deg();
        let seen = apparent_zenith_deg.is_some_and(|z| self.station.sees(90.0 - z, azimuth_deg));
        Ok(Place {
            sunlit: if self.shadow.is_some() { geometry.sunlit } else { 1.0 },
            body_to_gcrs,
            sun_body: (gcrs_to_body * to_sun).normalize(),
            observer_body: (gcrs_to_body * to_observer).normalize(),
            sun_altitude_deg: geometry.sun_altitude_deg(&observer),
            apparent_zenith_deg,
            hidden: !seen,
            orientation: observer.frame().orientation().origin,
            geometry,
        })
    }

    pub(super) fn counts(
        &self,
        place: &Place,
        exposure_s: f64,
        weights: &[f64],
        functionals: &Functionals,
    ) -> Result<Counts, PassError> {
        let k = weights.len();
        let sums = &functionals.sums;
        let sun = place.sunlit / place.geometry.sun.distance_au().powi(2);
        let here = sun / place.geometry.range_m.powi(2);
        let visible = place.apparent_zenith_deg.map(Zenith::Apparent);
        let mut transmissions = Vec::new();
        if let Some(zenith) = visible {
            sums.transmissions(zenith, &mut transmissions)?;
        }
        let below = |i: usize| match visible {
            Some(_) => here * sums.below(i, weights, &transmissions),
            None => f64::NAN,
        };
        let magnitude = |flux: f64| if flux > 0.0 { -2.5 * flux.log10() } else { f64::NAN };
        let mut relative = 0.0_f64;
        let channels = self.station.channels.iter().enumerate().map(|(c, channel)| {
            let rate_hz = below(c);
            if rate_hz > 0.0 && !place.hidden {
                relative = relative.max(here * sums.error(c, weights) / rate_hz);
            }
            let predicted = match visible {
                Some(_) => self.station.predict(channel, rate_hz, exposure_s),
                None => Predicted::default(),
            };
            (rate_hz, here * sums.above(c, weights), predicted, sums.uncovered(c, weights))
        });
        let channels: Vec<_> = channels.collect();
        let first = self.station.channels.len();
        let magnitudes = std::array::from_fn(|b| magnitude(here * sums.above(first + b, weights)));
        let ground = std::array::from_fn(|b| magnitude(below(first + b)));
        let spectrum: Vec<f64> = match (&functionals.at_telescope, visible) {
            (None, _) => (functionals.spectral.chunks_exact(k.max(1)))
                .map(|row| sun * row.iter().zip(weights).map(|(m, w)| m * w).sum::<f64>())
                .collect(),
            (Some(set), Some(zenith)) => {
                set.transmissions(zenith, &mut transmissions)?;
                (0..set.len()).map(|bin| here * set.below(bin, weights, &transmissions)).collect()
            }
            (Some(set), None) => vec![f64::NAN; set.len()],
        };
        let uncovered = match &functionals.at_telescope {
            None => {
                (functionals.spectral_uncovered.iter().zip(weights)).any(|(u, w)| *u && *w > 0.0)
            }
            Some(set) => (0..set.len()).any(|bin| set.uncovered(bin, weights) > 0.0),
        };
        Ok(Counts { spectrum, uncovered, channels, magnitudes, ground, relative })
    }

    fn gathered(
        &self,
        places: Vec<Place>,
        weights: Vec<Vec<f64>>,
        mut counts: Vec<Counts>,
        bounds: Bounds,
        scene: SceneReport,
    ) -> Simulation<'_> {
        let n = places.len();
        // The largest of all: each row is given back as soon as it stands among the others.
        let mut spectra = Array2::zeros((n, self.bins()));
        for (mut row, counts) in spectra.rows_mut().into_iter().zip(&mut counts) {
            let spectrum = std::mem::take(&mut counts.spectrum);
            row.iter_mut().zip(spectrum).for_each(|(to, from)| *to = from);
        }
        let k = weights.first().map_or(0, Vec::len);
        let channel = |c: usize| ChannelSamples {
            name: self.station.channels[c].name.clone(),
            rate_hz: counts.iter().map(|x| x.channels[c].0).collect(),
            above_air_hz: counts.iter().map(|x| x.channels[c].1).collect(),
            predicted: counts.iter().map(|x| x.channels[c].2).collect(),
            uncovered_nm: counts.iter().map(|x| x.channels[c].3).collect(),
        };
        let channels = (0..self.station.channels.len()).map(channel).collect();
        let of_materials = self.target.materials.iter();
        let weight_materials = of_materials
            .flat_map(|m| std::iter::repeat_n(m.name.clone(), m.spectra().len()))
            .collect();
        let hinges = self.target.hinges.len();
        let hinges_deg = Array2::from_shape_fn((n, hinges), |(i, h)| {
            self.target.hinges[h].angle_rad(places[i].sun_body).to_degrees()
        });
        Simulation {
            pass: self,
            weights: Array2::from_shape_fn((n, k), |(i, j)| weights[i][j]),
            weight_materials,
            spectra,
            spectra_uncovered: counts.iter().map(|c| c.uncovered).collect(),
            channels,
            magnitudes: Array2::from_shape_fn((n, BANDS.len()), |(i, b)| counts[i].magnitudes[b]),
            ground_magnitudes: Array2::from_shape_fn((n, BANDS.len()), |(i, b)| {
                counts[i].ground[b]
            }),
            hinges_deg,
            places,
            bounds,
            scene,
        }
    }
}

/// All of them, or the first error: which one that is must not depend on the threads.
fn first_error<T>(results: Vec<Result<T, PassError>>) -> Result<Vec<T>, PassError> {
    results.into_iter().collect()
}

impl SpectralQuantity {
    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::Intensity => "spectral radiant intensity",
            Self::Irradiance => "spectral irradiance at the telescope, after the air",
        }
    }

    /// The unit as astropy spells it.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Intensity => "W / (sr nm)",
            Self::Irradiance => "W / (m2 nm)",
        }
    }
}
