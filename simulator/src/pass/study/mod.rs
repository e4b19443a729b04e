//! A pass that is simulated again and again with another attitude, another body or shifted times: what stays is kept. [`Study::average`] has light averaged
//! over exposures, [`Study::thin`] has it computed at few epochs.

mod average;
mod thin;

pub use average::Averaged;
pub use thin::Thinned;

use super::functionals::Functionals;
use super::simulate::first_error;
use super::{BANDS, Pass, PassError, Place};
use crate::attitude::Attitude;
use crate::light::engine::{Aspects, Switch};
use crate::light::{Course, Engine, Term};
use crate::target::Target;
use ndarray::{Array3, s};
use rayon::prelude::*;
use sunglint_radiometry::air::Zenith;

/// A pass with everything that does not change from one simulation to the next: places as long as the times stay, the engine as long as the
/// body stays, integrals over wavelength as long as the reflectances do. For fits.
pub struct Study {
    /// Pass whose times are those of the samples (their middles), then those of the moments within their exposures.
    pass: Pass,
    /// How many samples there are.
    samples: usize,
    /// Exposures over which the samples' light is averaged.
    exposures: average::Exposures,
    /// The times without an offset.
    times: Vec<hifitime::Epoch>,
    offset_s: f64,
    places: Vec<Place>,
    /// Facts about the places and the attitude that decide about the engine; `None` until they are asked for.
    course: Option<Course>,
    engine: Engine,
    functionals: Functionals,
    /// Mean transmissions of each epoch; `None` below the horizon.
    transmissions: Vec<Option<Vec<f64>>>,
    /// Where direct light is computed, and where all other; everywhere where `None`.
    nodes: [Option<thin::Nodes>; 2],
    /// The light that is not direct at its nodes, where it is known for the pass as it stands now.
    indirect: Option<Vec<thin::Row>>,
}

/// The light of each term in each channel and band: what rates are sums of.
#[derive(Debug, Clone)]
pub struct TermRates {
    /// The terms that have light.
    pub terms: Vec<Term>,
    /// Hz at the detectors, after the air: epochs × channels of the station × terms. NaN below the horizon.
    pub rates_hz: Array3<f64>,
    /// Above the air, over the flux of magnitude 0: epochs × [`BANDS`] × terms.
    pub fluxes: Array3<f64>,
}

impl Study {
    /// Makes a pass ready.
    ///
    /// # Errors
    /// The errors of [`Pass::simulate`].
    pub fn new(mut pass: Pass) -> Result<Self, PassError> {
        // Nobody asks for spectra here.
        if let (Some(first), Some(last)) = (pass.edges_nm.first(), pass.edges_nm.last()) {
            pass.edges_nm = vec![*first, *last];
        }
        pass.check()?;
        let places = pass.places(&|| ())?;
        let course = course(&pass, &places);
        let engine = pass.engine(&course)?;
        let functionals = Functionals::new(&pass, engine.terms(), engine.lit_terms())?;
        let times = pass.times.clone();
        let mut study = Self {
            samples: times.len(),
            exposures: average::Exposures::default(),
            pass,
            times,
            offset_s: 0.0,
            places,
            course: Some(course),
            engine,
            functionals,
            transmissions: Vec::new(),
            nodes: [None, None],
            indirect: None,
        };
        study.look_through_air()?;
        Ok(study)
    }

    /// The pass as it stands now. Behind the times of the samples are those of moments within their exposures ([`Study::average`]).
    pub fn pass(&self) -> &Pass {
        &self.pass
    }

    /// Where everything stands now in the middle of each sample.
    pub fn places(&self) -> &[Place] {
        &self.places[..self.samples]
    }

    /// Turns the body by another law; Sun, target and station stay where they are.
    ///
    /// # Errors
    /// [`PassError::Attitude`] at the first epoch without an attitude; the study then keeps its former law.
    pub fn set_attitude(&mut self, attitude: Attitude) -> Result<(), PassError> {
        let former = std::mem::replace(&mut self.pass.attitude, attitude);
        let turned = self.places.par_iter().map(|place| self.pass.turned(place)).collect();
        match first_error(turned) {
            Ok(places) => {
                self.places = places;
                self.course = None;
                self.indirect = None;
                Ok(())
            }
            Err(error) => {
                self.pass.attitude = former;
                Err(error)
            }
        }
    }

    /// The rates of light that went between surfaces, of the same body in other reflectances: of the terms of no single material; those of all others are 0. What does not depend on
    /// reflectances is that of the body which stands in place, also how fine patches have to be and what was claimed of their error: near that body the light is right within its
    /// tolerance, and a study that is made anew of the last body says how far. Another body is put in place as by [`Study::set_target`].
    ///
    /// # Errors
    /// The errors of [`Study::set_target`] and [`Study::term_rates`].
    pub fn bounced_of(&mut self, target: Target) -> Result<TermRates, PassError> {
        let own = &self.pass.target;
        let same = own.parts == target.parts && own.hinges == target.hinges;
        let engine = same.then(|| self.engine.bounced_of(&target.materials));
        let Some(engine) = engine.flatten() else {
            self.set_target(target)?;
            let mut rates = self.term_rates()?;
            for (k, _) in rates.terms.iter().enumerate().filter(|(_, t)| !t.is_of_several()) {
                rates.rates_hz.slice_mut(s![.., .., k]).fill(0.0);
                rates.fluxes.slice_mut(s![.., .., k]).fill(0.0);
            }
            return Ok(rates);
        };
        let lit = engine.lit_terms();
        let weights = self.indirect_by(&engine)?;
        let rows = weights.par_iter().enumerate().map(|(i, own)| self.row(i, &own[..lit]));
        Ok(self.gathered(&self.exposures.means(rows.collect())))
    }

    /// Puts another body in place. Integrals over wavelength are taken anew only where reflectances differ.
    ///
    /// # Errors
    /// [`PassError::Target`], and as [`Pass::simulate`] for its spectra; the study then keeps its former body.
    pub fn set_target(&mut self, target: Target) -> Result<(), PassError> {
        let former = std::mem::replace(&mut self.pass.target, target);
        self.indirect = None;
        let mut replace = || -> Result<(), PassError> {
            let course = self.course.get_or_insert_with(|| course(&self.pass, &self.places));
            let engine = self.pass.engine(course)?;
            if !same_spectra(&self.engine, &engine) {
                self.functionals =
                    Functionals::new(&self.pass, engine.terms(), engine.lit_terms())?;
                self.engine = engine;
                return self.look_through_air();
            }
            self.engine = engine;
            Ok(())
        };
        let replaced = replace();
        if replaced.is_err() {
            self.pass.target = former;
        }
        replaced
    }

    /// Simulates all times later by an offset, s (negative: earlier), against those that the study was made with.
    ///
    /// # Errors
    /// The errors of [`Pass::simulate`], for places.
    pub fn set_time_offset_s(&mut self, offset_s: f64) -> Result<(), PassError> {
        if offset_s == self.offset_s {
            return Ok(());
        }
        self.offset_s = offset_s;
        self.set_times()
    }

    /// Puts everything where it is at the times and their offset.
    fn set_times(&mut self) -> Result<(), PassError> {
        let offset = hifitime::Duration::from_seconds(self.offset_s);
        self.pass.times = self.times.iter().map(|t| *t + offset).collect();
        self.places = self.pass.places(&|| ())?;
        self.course = None;
        self.indirect = None;
        self.look_through_air()
    }

    /// Returns the rates that the light of each term makes in each channel and band: linear in the term's reflectance.
    ///
    /// # Errors
    /// [`PassError::Light`].
    pub fn term_rates(&self) -> Result<TermRates, PassError> {
        let lit = self.engine.lit_terms();
        let weights = self.weights()?;
        let rows = weights.par_iter().enumerate().map(|(i, (own, _))| self.row(i, &own[..lit]));
        Ok(self.gathered(&self.exposures.means(rows.collect())))
    }

    /// Returns the rates of a weight of 1 m² sr⁻¹ of each term in the middle of each sample, in full sunlight: the light of any attitude is the sum over the terms of this
    /// times the attitude's weights (and the visible part of the Sun).
    pub fn unit_rates(&self) -> TermRates {
        let unit = vec![1.0; self.engine.lit_terms()];
        let rows = (0..self.samples).into_par_iter().map(|i| self.row(i, &unit));
        self.gathered(&rows.collect::<Vec<_>>())
    }

    /// Returns the rates that the weights of all terms make at an epoch: channels, then bands, each × terms.
    fn row(&self, epoch: usize, weights: &[f64]) -> Vec<f64> {
        let (lit, channels) = (weights.len(), self.pass.station.channels.len());
        let geometry = &self.places[epoch].geometry;
        let here = geometry.sun.distance_au().powi(-2) * geometry.range_m.powi(-2);
        let scaled: Vec<f64> = weights.iter().map(|w| here * w).collect();
        let mut row = vec![0.0; (channels + BANDS.len()) * lit];
        let sums = &self.functionals.sums;
        for (i, terms) in row.chunks_exact_mut(lit.max(1)).enumerate() {
            match &self.transmissions[epoch] {
                Some(through) if i < channels => {
                    sums.add_terms_below(i, &scaled, through, terms);
                    let channel = Some(self.pass.station.channels[i].name.as_str());
                    let dim = self.pass.correction.dimming(&self.places[epoch], channel);
                    terms.iter_mut().for_each(|t| *t *= dim);
                }
                None if i < channels => terms.fill(f64::NAN),
                _ => sums.add_terms_above(i, &scaled, terms),
            }
        }
        row
    }

    fn gathered(&self, rows: &[Vec<f64>]) -> TermRates {
        let (lit, channels) = (self.engine.lit_terms(), self.pass.station.channels.len());
        let n = rows.len();
        let at = |i: usize, q: usize, k: usize| rows[i][q * lit + k];
        TermRates {
            terms: self.engine.terms()[..lit].to_vec(),
            rates_hz: Array3::from_shape_fn((n, channels, lit), |(i, c, k)| at(i, c, k)),
            fluxes: Array3::from_shape_fn((n, BANDS.len(), lit), |(i, b, k)| {
                at(i, channels + b, k)
            }),
        }
    }

    /// Apparent zenith angles and transmissions of all places.
    fn look_through_air(&mut self) -> Result<(), PassError> {
        let (pass, functionals) = (&self.pass, &self.functionals);
        self.places.par_iter_mut().try_for_each(|place| pass.refract(place, functionals))?;
        let through = self.places.par_iter().map(|place| {
            let Some(deg) = place.apparent_zenith_deg else { return Ok(None) };
            let mut row = Vec::new();
            functionals.sums.transmissions(Zenith::Apparent(deg), &mut row)?;
            Ok(Some(row))
        });
        self.transmissions = first_error(through.collect())?;
        Ok(())
    }
}

/// Facts about a pass for engines that nobody asks why. Directions decide about the Sun's disc alone, and only where it is neither switched on nor off.
fn course(pass: &Pass, places: &[Place]) -> Course {
    let mut course = pass.course(places);
    if pass.effects.solar_disc != Switch::Auto {
        course.aspects = Aspects::default();
    }
    course
}

/// Whether two engines have light of the same spectra in the same order. Terms that have errors alone do not matter here.
fn same_spectra(a: &Engine, b: &Engine) -> bool {
    let lit = a.lit_terms();
    lit == b.lit_terms()
        && a.terms().len() == b.terms().len()
        && a.terms()[..lit].iter().zip(b.terms()).all(|(a, b)| {
            a.material == b.material && a.source == b.source && a.spectrum == b.spectrum
        })
}
