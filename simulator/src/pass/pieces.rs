//! A pass in pieces: more epochs than memory holds results of.
//!
//! What the epochs of a pass share is found first, in one walk over all of them: frames, the scene's needs, the tables, the light between surfaces and from the Earth. Of each
//! epoch some hundred bytes are kept for that. Then piece after piece is computed and given away. Where everything stands is computed twice, which costs microseconds an epoch.

use super::along::{Along, Sketch};
use super::explain::Survey;
use super::simulate::{Bounds, Progress, Simulation, Stage};
use super::{Pass, PassError};
use rayon::prelude::*;
use std::num::NonZeroUsize;

impl Pass {
    /// Simulates the pass in pieces of so many epochs (the last may have fewer), in the order of its times, and gives each of them to `each`: to the bit what [`Pass::simulate`] has for
    /// these epochs, whatever the size of the pieces. The memory that it takes grows by about 130 bytes an epoch, beside one piece (some 10 kB an epoch) and the light at the nodes.
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
        self.check()?;
        let of = self.times.len();
        let tell = |stage, done| progress(Progress { stage, done, of });
        let pieces = || {
            let step = epochs.get();
            (0..of).step_by(step).map(move |first| first..of.min(first.saturating_add(step)))
        };

        tell(Stage::Places, 0);
        let way = self.way()?;
        let mut survey = Survey::new(self);
        let mut sketches = Vec::with_capacity(of);
        for piece in pieces() {
            tell(Stage::Places, piece.start);
            for place in way.places(piece, &|| ())? {
                survey.add(&place);
                sketches.push(Sketch::of(&place));
            }
        }
        tell(Stage::Tables, 0);
        let ready = self.ready_for(&survey.course())?;
        tell(Stage::Light, 0);
        let along = Along::new(&ready, &sketches, &|i| way.place(i), &|| ())?;
        drop(sketches);

        let around = self.way_around()?;
        let mut part = self.clone();
        let mut all: Option<Bounds> = None;
        for piece in pieces() {
            tell(Stage::Counts, piece.start);
            part.times = self.times[piece.clone()].to_vec();
            part.exposure_s = self.exposure_s[piece.clone()].to_vec();
            part.observations =
                self.observations.get(piece.clone()).map(<[_]>::to_vec).unwrap_or_default();
            let mut places = way.places(piece.clone(), &|| ())?;
            places.par_iter_mut().try_for_each(|place| self.refract(place, &ready.functionals))?;
            let lit = ready.lit(&places, along.as_ref(), piece.start, &|| ())?;
            let counts = ready.counted(&places, &lit, &part.exposure_s, &|| ())?;
            let bounds = ready.bounds(along.as_ref(), of, &lit, &counts);
            all = Some(all.map_or(bounds, |all| Bounds {
                rate_relative: all.rate_relative.max(bounds.rate_relative),
                light_relative: all.light_relative.max(bounds.light_relative),
                ..bounds
            }));
            let smear = ready.smear(&around, &places, &counts, piece.start);
            let found = part.gathered(places, &lit, counts, bounds, &ready);
            each(&Simulation { smear, ..found })?;
        }
        tell(Stage::Done, 0);
        Ok(all.unwrap_or_default())
    }
}
