//! Common types of the engine's parts: light that is described once, terms that are summed, and what a scene needs.
//!
//! A simulation knows a list of [`Term`]s: each a spectrum, fixed for the whole pass, before a weight, found for each epoch. The radiant
//! intensity is I(λ) = E(λ)/d² Σ_k τ_k(λ) W_k, with τ_k the term's spectrum; so rates, magnitudes and bins are sums over k, whatever
//! the light went through. Singly scattered light has the materials' ρ_k as terms; what does not separate (many bounces, the tint of
//! an eclipse) takes spectra of its own: products of ρ_k, or hat functions over a grid of wavelengths.
//!
//! Every part says with each weight how far it may be off, as an absolute error of the same unit. Each channel and bin has an error of its own: those of one way of the light
//! add up over terms just as weights do, and ways that err for reasons of their own add as squares ([`Stated`]).

use super::View;
use crate::surface::MaterialError;
use glam::{DQuat, DVec3};
use sunglint_radiometry::spectrum::{Factor, Spectrum};

/// Where light comes from and where it goes, at one moment, in the body's axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lighting {
    /// Unit vector to the middle of the Sun's disc.
    pub sun_body: DVec3,
    /// Angular radius of the Sun's disc, radians; 0 for a collimated Sun.
    pub sun_radius_rad: f64,
    /// Globe that stands before a part of the Sun's disc: the Earth as its shadow has it; `None` in full light and in full shadow.
    pub shadow: Option<Globe>,
    /// The visible part of the Sun's light (of a grey, limb-darkened disc): 1 in full light.
    pub sunlit: f64,
    /// How far off that may be.
    pub sunlit_error: f64,
    /// The Earth as the body sees it, for its light; `None` where it is not wanted.
    pub earth: Option<Globe>,
    /// The Moon as the body sees it; `None` where it is not wanted.
    pub moon: Option<Globe>,
    /// The observer.
    pub view: View,
}

/// A globe lit by the Sun, as the body sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Globe {
    /// Unit vector to its middle, body axes.
    pub toward: DVec3,
    /// Distance of its middle, m.
    pub distance_m: f64,
    /// Radius of the globe, m.
    pub radius_m: f64,
    /// Unit vector from its middle to the Sun, body axes.
    pub sun: DVec3,
    /// From the body's axes to those fixed to it (of the Earth the ITRS): where on its ground a place is. It matters where the ground is not the same everywhere.
    pub to_ground: DQuat,
}

/// Which way light came.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Source {
    /// From the Sun, scattered once.
    Direct,
    /// From the Sun, scattered more than once.
    Bounce,
    /// From the Sun by the Earth.
    Earthshine,
    /// From the Sun by the Moon.
    Moonshine,
    /// Whatever way: a term that has errors alone, before the whole reflectance of its material.
    Unknown,
}

/// A spectrum that stands before a weight.
#[derive(Debug, Clone)]
pub struct Term {
    /// Which way the light came.
    pub source: Source,
    /// The material that sent it to the observer (index in the target), where it is one.
    pub material: Option<usize>,
    /// Product of all that has multiplied the light since it left the Sun, but for geometry. Known where it is tabulated: where it is known to be 0, it
    /// says so.
    pub spectrum: Spectrum<Factor>,
}

impl Term {
    /// Whether the light has been on several materials, the Sun's or the Earth's: it belongs to no single one.
    pub fn is_of_several(&self) -> bool {
        self.source == Source::Bounce || self.material.is_none()
    }
}

/// Stated error of light that came by several ways.
///
/// Errors of the terms of one way are added: they err alike. The errors of direct light, and what is left out, are limits, and are added to all else. Light of the Sun between surfaces, light of
/// the Earth between surfaces and light of the Earth that is scattered once are found apart: by patches and rays, by other patches under a few directions, by a
/// rule over the Earth's lit cap. For errors that know nothing of each other, each within its bound in as many cases as that promises, the root of the sum of squares holds as often; the
/// sum would be reached only where all are at their bounds and have one sign.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Stated {
    limits: f64,
    ways: [f64; 3],
}

impl Stated {
    /// Adds the error of a term, not below 0.
    pub fn add(&mut self, way: Way, error: f64) {
        match way {
            Way::Limit => self.limits += error,
            Way::Between => self.ways[0] += error,
            Way::EarthBetween => self.ways[1] += error,
            Way::Earthshine => self.ways[2] += error,
        }
    }

    /// Returns the error of all of it.
    pub fn total(&self) -> f64 {
        self.limits + self.ways.iter().map(|e| e * e).sum::<f64>().sqrt()
    }
}

/// Way of a term's error into [`Stated`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Way {
    /// Added to all others.
    Limit,
    /// Light of the Sun between surfaces.
    Between,
    /// Light of the Earth between surfaces.
    EarthBetween,
    /// Light of the Earth that is scattered once.
    Earthshine,
}

impl Term {
    /// Way of the error into that of all light.
    pub fn way(&self) -> Way {
        match (self.source, self.material) {
            (Source::Bounce, _) => Way::Between,
            (Source::Earthshine, None) => Way::EarthBetween,
            (Source::Earthshine, Some(_)) => Way::Earthshine,
            (Source::Direct | Source::Moonshine | Source::Unknown, _) => Way::Limit,
        }
    }
}

/// A part of the engine, ready for one scene: made once, it adds light for each epoch. One for each thread.
pub trait Effect: Send {
    /// Adds its weights W_k \[m² sr⁻¹\] and their errors (absolute, same unit, never negative) to two rows of as many numbers as it has terms.
    ///
    /// # Errors
    /// Directions that are none.
    fn add(
        &mut self,
        lighting: &Lighting,
        weights: &mut [f64],
        errors: &mut [f64],
    ) -> Result<(), super::DirectionError>;
}

/// Need for one effect: what it could add to a scene, found before it is simulated.
#[derive(Debug, Clone, PartialEq)]
pub struct Need {
    /// The effect in a word or two (`shadows`, `solar disc`).
    pub effect: &'static str,
    /// Whether it is asked for, or its bound exceeds the tolerance. What is needed and costs nothing that is known
    /// (`cost_s` is `None`) is not modelled, and its bound enters the stated error.
    pub needed: bool,
    /// The most that it could change the result by, as a share of the light of the same surfaces in full sunlight; `None` where nothing is
    /// known of it and it is therefore modelled.
    pub bound: Option<f64>,
    /// Why, in words, with the numbers that decide.
    pub why: String,
    /// Estimated cost per epoch, s; `None` where the effect is not modelled.
    pub cost_s: Option<f64>,
}

impl Need {
    /// Whether it is in the result.
    pub fn is_modelled(&self) -> bool {
        self.needed && self.cost_s.is_some()
    }

    /// Returns the decision on the effect, in a word or two.
    pub fn decision(&self) -> &'static str {
        match (self.needed, self.cost_s.is_some()) {
            (true, true) => "modelled",
            (true, false) => "NOT MODELLED",
            (false, _) if self.bound == Some(0.0) => "none",
            (false, _) => "not needed",
        }
    }

    /// Returns the bound as people read it; `-` where nothing is known of it.
    pub fn bound_text(&self) -> String {
        self.bound.map_or("-".into(), percent)
    }
}

/// Writes a share as people read it: `0.25 %`.
pub fn percent(share: f64) -> String {
    let percent = 100.0 * share;
    match percent {
        0.0 => "0 %".into(),
        p if !p.is_finite() || p > 1e4 => "no limit".into(),
        p if p < 0.01 => format!("{p:.0e} %"),
        p if p < 1.0 => format!("{p:.2} %"),
        p if p < 10.0 => format!("{p:.1} %"),
        p => format!("{p:.0} %"),
    }
}

/// Returns warnings about effects that are needed and not modelled.
pub fn concerns(needs: &[Need]) -> Vec<String> {
    let missing = needs.iter().filter(|n| n.needed && !n.is_modelled());
    let say = |need: &Need| {
        format!(
            "{} may change the light by up to {} and is not modelled: its bound is in the stated error ({})",
            need.effect,
            need.bound_text(),
            need.why
        )
    };
    missing.map(say).collect()
}

impl Source {
    /// In a word or two.
    pub fn name(self) -> &'static str {
        match self {
            Self::Direct => "direct",
            Self::Bounce => "inter-reflection",
            Self::Earthshine => "earthshine",
            Self::Moonshine => "moonshine",
            Self::Unknown => "unknown",
        }
    }
}

impl Term {
    /// The terms of the light that a material scatters once: its spectra.
    ///
    /// # Errors
    /// A spectrum that is none.
    pub fn of_material(
        source: Source,
        number: usize,
        material: &crate::surface::Material,
    ) -> Result<Vec<Self>, MaterialError> {
        let term = |rho: &Spectrum<_>| {
            let (wavelength_nm, value) = (rho.wavelength_nm().to_vec(), rho.value().to_vec());
            let spectrum = Spectrum::new(wavelength_nm, value)?;
            Ok(Self { source, material: Some(number), spectrum })
        };
        material.spectra().iter().map(term).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: by hand. Limits are added, errors of one way are added, those of three ways as squares: 1 + 0.5 + √((1 + 1)² + 3² + 6²) = 8.5.
    #[test]
    fn ways_that_err_apart_are_added_as_squares() {
        let mut stated = Stated::default();
        let all = [
            (Source::Direct, Some(0), 1.0),
            (Source::Bounce, None, 1.0),
            (Source::Bounce, None, 1.0),
            (Source::Earthshine, None, 3.0),
            (Source::Earthshine, Some(0), 6.0),
            (Source::Unknown, Some(0), 0.5),
        ];
        for (source, material, error) in all {
            let spectrum = Spectrum::constant(1.0, 300.0, 900.0).unwrap();
            stated.add(Term { source, material, spectrum }.way(), error);
        }
        assert!((stated.total() - 8.5).abs() < 1e-15, "{stated:?}");
    }
}
