//! Passes that differ in orbit and times alone, as those of a catalogue: what does not depend on these is made once.

use super::functionals::Functionals;
use super::simulate::{Progress, Simulation};
use super::{Pass, PassError};
use crate::light::Term;
use hifitime::Epoch;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use sunglint_ephemeris::orbit::Orbit;

/// Sets of integrals that are kept: which terms the light has depends on what a way needs, such as the Earth's light.
const MOST_KEPT: usize = 8;

/// One scene for many orbits and times.
///
/// The integrals over wavelength and the tables of the air depend on neither. They are made for the first pass and kept: of a pass of a simple body they are most of
/// the work. Every number is that of [`Pass::simulate`], to the last bit.
pub struct Alike {
    pass: Pass,
    kept: Kept,
}

impl Alike {
    /// Makes nothing yet.
    pub fn new(pass: Pass) -> Self {
        Self { pass, kept: Kept::default() }
    }

    /// The scene that all passes have in common, with an orbit and times of its own.
    pub fn pass(&self) -> &Pass {
        &self.pass
    }

    /// Simulates the pass of an orbit at some times, and gives it to `then`.
    ///
    /// # Errors
    /// The errors of [`Pass::simulate`].
    pub fn simulate<T>(
        &self,
        orbit: Orbit,
        times: Vec<Epoch>,
        exposure_s: Vec<f64>,
        progress: &(dyn Fn(Progress) + Sync),
        then: impl FnOnce(&Simulation<'_>) -> T,
    ) -> Result<T, PassError> {
        let pass = Pass { orbit, times, exposure_s, ..self.pass.clone() };
        Ok(then(&pass.simulated(progress, true, Some(&self.kept))?))
    }
}

/// The integrals for some terms, of which the first so many are lit.
struct Made {
    terms: Vec<Term>,
    lit: usize,
    functionals: Arc<Functionals>,
}

/// The integrals of one scene by the terms of its light.
#[derive(Default)]
pub(super) struct Kept(Mutex<Vec<Made>>);

impl Kept {
    fn all(&self) -> MutexGuard<'_, Vec<Made>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The integrals for these terms: those that are kept, or new ones. Two threads that want the same at once both make them: none waits for the other.
    pub fn functionals(
        &self,
        pass: &Pass,
        terms: &[Term],
        lit: usize,
    ) -> Result<Arc<Functionals>, PassError> {
        let is_same = |made: &&Made| {
            made.lit == lit
                && made.terms.len() == terms.len()
                && made.terms.iter().zip(terms).all(same)
        };
        if let Some(made) = self.all().iter().find(is_same) {
            return Ok(made.functionals.clone());
        }
        let functionals = Arc::new(Functionals::new(pass, terms, lit)?);
        let mut all = self.all();
        if all.len() >= MOST_KEPT {
            all.remove(0);
        }
        all.push(Made { terms: terms.to_vec(), lit, functionals: functionals.clone() });
        Ok(functionals)
    }
}

/// Whether two terms are the same to the last bit.
fn same((a, b): (&Term, &Term)) -> bool {
    let equal = |a: &[f64], b: &[f64]| {
        a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits())
    };
    (a.source, a.material) == (b.source, b.material)
        && equal(a.spectrum.wavelength_nm(), b.spectrum.wavelength_nm())
        && equal(a.spectrum.value(), b.spectrum.value())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::Source;
    use sunglint_radiometry::spectrum::Spectrum;

    /// Truth: terms that are the same have the same integrals, and any other bit, number of lit terms or source is another set; no more are kept than stated.
    #[test]
    fn the_same_terms_have_one_set_of_integrals() {
        let file = super::super::PassFile::read(
            sunglint_testkit::repository().join("fixtures/scenes/box_wing_dusk.toml"),
        );
        let pass = file.unwrap().resolve(super::super::Overrides::default()).unwrap();
        let term = |source, value: f64| {
            let spectrum = Spectrum::new(vec![300.0, 1240.0], vec![value, 0.5]).unwrap();
            Term { source, material: None, spectrum }
        };
        let kept = Kept::default();
        let of = |terms: &[Term], lit| kept.functionals(&pass, terms, lit).unwrap();
        let first = of(&[term(Source::Direct, 0.5)], 1);
        assert!(Arc::ptr_eq(&first, &of(&[term(Source::Direct, 0.5)], 1)));
        for (terms, lit) in [
            (vec![term(Source::Direct, 0.5 + f64::EPSILON)], 1),
            (vec![term(Source::Bounce, 0.5)], 1),
            (vec![term(Source::Direct, 0.5)], 0),
            (vec![term(Source::Direct, 0.5), term(Source::Direct, 0.5)], 2),
        ] {
            assert!(!Arc::ptr_eq(&first, &of(&terms, lit)));
        }
        for k in 0..2 * MOST_KEPT {
            of(&[term(Source::Direct, 0.1 * k as f64)], 0);
        }
        assert_eq!(kept.all().len(), MOST_KEPT);
    }
}
