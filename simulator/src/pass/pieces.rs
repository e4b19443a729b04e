//! A pass in pieces: more epochs than memory holds results of.
//!
//! What the epochs of a pass share is found first, in one walk over all of them: frames, the scene's needs, the tables, the light between surfaces and from the Earth. Of each
//! epoch some hundred bytes are kept for that. Then piece after piece is computed and given away. Where everything stands is kept of passes of one piece and of no more than [`MOST_KEPT`] epochs; of longer ones it is computed again where it is asked for, some 15 µs an epoch.

use super::along::{Along, Sketch};
use super::explain::Survey;
use super::material::Light;
use super::simulate::{Bounds, Place, Progress, REPORT_EVERY, Simulation, Stage};
use super::{MaterialDoubt, Pass, PassError, Polarisation, Ready};
use rayon::prelude::*;
use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Passes of no more epochs keep where everything stands, 10 MB at most.
const MOST_KEPT: usize = 1 << 14;

/// A piece of a pass, simulated, and what was asked for beside it.
#[derive(Debug, Clone)]
pub struct Piece<'a> {
    /// The piece.
    pub simulation: &'a Simulation<'a>,
    /// Doubt of the light by that of the materials ([`Simulation::material_doubt`]).
    pub material: Option<MaterialDoubt>,
    /// Polarisation of the light ([`Simulation::polarisation`]).
    pub polarisation: Option<Polarisation>,
}

/// The quantities that are wanted beside the light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Extras {
    /// The doubt of the materials.
    pub material: bool,
    /// The polarisation.
    pub polarisation: bool,
}

impl Pass {
    /// Simulates the pass in pieces of so many epochs (the last may have fewer), in the order of its times, and gives each of them to `each`: to the bit what [`Pass::simulate`] has for
    /// these epochs, whatever the size of the pieces. The memory that it takes grows by about 130 bytes an epoch (600 in passes of 16,384 epochs and fewer), beside one piece (some 10 kB an epoch) and the light at the nodes.
    ///
    /// The pass of a piece ([`Simulation::pass`]) has the times, exposures and observations of the piece. Its [`Simulation::bounds`] are those of the piece, but for the air's
    /// table and the number of nodes. Returns the bounds of all pieces.
    ///
    /// ```no_run
    /// # use std::num::NonZeroUsize;
    /// # use sunglint_simulator::pass::{Overrides, PassError, PassFile};
    /// # let text = String::new();
    /// let pass = PassFile::parse("pass.toml", &text)?.resolve(Overrides::default())?;
    /// let mut brightest = f64::NAN;
    /// pass.simulate_in_pieces(NonZeroUsize::MIN.saturating_add(4095), &|_| (), |piece| {
    ///     brightest = piece.magnitudes.column(2).iter().copied().fold(brightest, f64::min);
    ///     Ok::<(), PassError>(())
    /// })?;
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// The errors of [`Pass::simulate`], for some of them after pieces were given away; those of `each`, which end the work.
    pub fn simulate_in_pieces<E: From<PassError>>(
        &self,
        epochs: NonZeroUsize,
        progress: &(dyn Fn(Progress) + Sync),
        mut each: impl FnMut(&Simulation<'_>) -> Result<(), E>,
    ) -> Result<Bounds, E> {
        let each = |piece: &Piece<'_>| each(piece.simulation);
        self.simulate_in_pieces_with(epochs, Extras::default(), progress, each)
    }

    /// Simulates the pass as [`Pass::simulate_in_pieces`] does, with what is wanted beside the light: to the bit what the whole simulation has for these epochs.
    ///
    /// # Errors
    /// The same; those of [`Simulation::material_doubt`] and [`Simulation::polarisation`].
    pub fn simulate_in_pieces_with<E: From<PassError>>(
        &self,
        epochs: NonZeroUsize,
        extras: Extras,
        progress: &(dyn Fn(Progress) + Sync),
        mut each: impl FnMut(&Piece<'_>) -> Result<(), E>,
    ) -> Result<Bounds, E> {
        self.check()?;
        let of = self.times.len();
        let tell = |stage, done| progress(Progress { stage, done, of });
        let counters: [AtomicUsize; 4] = Default::default();
        let tick = |counter: usize, stage| {
            let done = counters[counter].fetch_add(1, Ordering::Relaxed) + 1;
            if done.is_multiple_of(REPORT_EVERY) {
                tell(stage, done.min(of));
            }
        };
        let pieces = || {
            let step = epochs.get();
            (0..of).step_by(step).map(move |first| first..of.min(first.saturating_add(step)))
        };

        tell(Stage::Places, 0);
        let way = self.way()?;
        let mut survey = Survey::new(self);
        let mut sketches = Vec::with_capacity(of);
        let mut kept = Vec::new();
        for piece in pieces() {
            let places = way.places(piece, &|| tick(0, Stage::Places))?;
            places.iter().for_each(|place| survey.add(place));
            sketches.extend(places.iter().map(Sketch::of));
            if of <= MOST_KEPT || places.len() == of {
                kept.extend(places);
            }
        }
        let place = |i: usize| kept.get(i).map_or_else(|| way.place(i), |place| Ok(*place));
        tell(Stage::Tables, 0);
        let course = survey.course();
        let ready = self.ready_for(&course)?;
        let doubted = if extras.material { self.without_times().doubted()? } else { Vec::new() };
        let doubted: Vec<(&str, Ready<'_>)> = doubted
            .iter()
            .map(|(name, pass)| Ok((name.as_str(), pass.ready_for(&course)?)))
            .collect::<Result<_, PassError>>()?;
        let parts = extras.polarisation.then(|| self.without_times().polarised()).transpose()?;
        let parts = match &parts {
            None => None,
            Some(parts) => {
                let (part, known) = (&parts.polarised, &parts.diffuse_and_known);
                let ready = |pass| Pass::ready_for(pass, &course);
                let between = match &parts.between {
                    None => None,
                    Some(between) => between
                        .map(ready, |ready| &ready.engine.terms()[..ready.engine.lit_terms()])?,
                };
                Some((ready(part)?, ready(known)?, between, &parts.unknown))
            }
        };
        tell(Stage::Light, 0);
        let along = Along::new(&ready, &sketches, &place, &|| tick(1, Stage::Light))?;
        let between = match parts.as_ref().and_then(|(_, _, between, _)| between.as_ref()) {
            None => None,
            Some(between) => between.map(
                |ready| {
                    let along = Along::new(ready, &sketches, &place, &|| ())?;
                    Ok::<_, PassError>((ready, along))
                },
                |(ready, _)| ready.engine.terms(),
            )?,
        };
        drop(sketches);

        let around = self.way_around()?;
        let object = self.object();
        let mut part = self.without_times();
        let mut all: Option<Bounds> = None;
        for piece in pieces() {
            part.times = self.times[piece.clone()].to_vec();
            part.exposure_s = self.exposure_s[piece.clone()].to_vec();
            part.observations =
                self.observations.get(piece.clone()).map(<[_]>::to_vec).unwrap_or_default();
            tell(Stage::Light, piece.start);
            let mut places = match kept.get(piece.clone()) {
                Some(places) => places.to_vec(),
                None => way.places(piece.clone(), &|| ())?,
            };
            let doubt = doubted.iter().map(|(name, ready)| {
                ready.light_alone(&places, &part.exposure_s).map(|made| Light::of(name, made))
            });
            let doubt = doubt.collect::<Result<Vec<Light>, PassError>>()?;
            let polarised = match &parts {
                None => None,
                Some((polarised, known, _, unknown)) => {
                    let of_between = match &between {
                        None => None,
                        Some(between) => between.map(
                            |(ready, along)| {
                                let along = along.as_ref();
                                ready.light_along(&places, &part.exposure_s, along, piece.start)
                            },
                            |made: &Simulation<'_>| &made.terms[..],
                        )?,
                    };
                    Some((
                        polarised.light_alone(&places, &part.exposure_s)?,
                        known.light_alone(&places, &part.exposure_s)?,
                        of_between,
                        *unknown,
                    ))
                }
            };
            places.par_iter_mut().try_for_each(|place| self.refract(place, &ready.functionals))?;
            let tick_light = || tick(2, Stage::Light);
            let lit = ready.lit(&places, along.as_ref(), piece.start, &tick_light)?;
            tell(Stage::Counts, piece.start);
            let tick_counts = || tick(3, Stage::Counts);
            let counts = ready.counted(&places, &lit, &part.exposure_s, &tick_counts)?;
            let bounds = ready.bounds(along.as_ref(), of, &lit, &counts);
            all = Some(all.map_or(bounds, |all| Bounds {
                rate_relative: all.rate_relative.max(bounds.rate_relative),
                light_relative: all.light_relative.max(bounds.light_relative),
                ..bounds
            }));
            let smear = ready.smear(&around, &places, &lit, &counts, piece.start);
            let simulation = part.gathered(object.clone(), places, &lit, counts, bounds, &ready);
            let simulation = Simulation { smear, ..simulation };
            drop(lit);
            let material = (!doubt.is_empty()).then(|| simulation.doubt_by(doubt));
            let polarisation = polarised.map(|(part, known, between, unknown)| {
                simulation.polarised_by(&part, &known, between.as_ref(), unknown.clone())
            });
            tell(Stage::Given, piece.end);
            each(&Piece { simulation: &simulation, material, polarisation })?;
        }
        tell(Stage::Done, 0);
        Ok(all.unwrap_or_default())
    }

    /// The data that all pieces have in common.
    fn without_times(&self) -> Self {
        let mut pass = self.clone();
        (pass.times, pass.exposure_s, pass.observations) = (Vec::new(), Vec::new(), Vec::new());
        pass
    }
}

impl Ready<'_> {
    /// The light of a pass of direct sunlight alone, at the places of another that is turned in the same way.
    fn light_alone(
        &self,
        places: &[Place],
        exposure_s: &[f64],
    ) -> Result<Simulation<'_>, PassError> {
        self.light_along(places, exposure_s, None, 0)
    }

    /// The same of a pass by sunlight with the light of `along`, in which these places begin with the epoch `first`.
    fn light_along(
        &self,
        places: &[Place],
        exposure_s: &[f64],
        along: Option<&Along>,
        first: usize,
    ) -> Result<Simulation<'_>, PassError> {
        let mut places: Vec<Place> = places.iter().map(|p| Place { moon: None, ..*p }).collect();
        places.par_iter_mut().try_for_each(|place| self.pass.refract(place, &self.functionals))?;
        let lit = self.lit(&places, along, first, &|| ())?;
        let counts = self.counted(&places, &lit, exposure_s, &|| ())?;
        Ok(self.pass.gathered(String::new(), places, &lit, counts, Bounds::default(), self))
    }
}
