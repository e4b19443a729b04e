//! Linear polarisation of a body's light.
//!
//! Unpolarised sunlight that microfacets or mirrors reflect once is polarised perpendicular to the plane of Sun, body and observer ([`crate::surface::PolarisedPart`]). Its
//! polarised part is simulated as a pass of its own, with all that shades and hides. Light between surfaces is followed along light paths with its Stokes vectors, to an observer behind an ideal
//! polariser at three angles. What is not known, or not modelled, may be polarised in any way: it is in the error.

use super::{Pass, PassError, Progress, Simulation};
use crate::light::engine::{Switch, Switches};
use crate::light::{Analyser, Source, Term};
use crate::surface::{Facets, Material, MaterialError, PolarisedPart};
use crate::target::Target;
use glam::DVec3;

/// The place of V among the bands.
const V: usize = 2;
/// Wavelengths at which facets of several indices are told from those of one, vacuum nm.
const FACETS_NM: [f64; 4] = [350.0, 550.0, 750.0, 1000.0];

/// Linear polarisation of a body's light along a pass.
#[derive(Debug, Clone, PartialEq)]
pub struct Polarisation {
    /// Degree of linear polarisation, 0 to 1, after the air, by channel of the station and sample; NaN without light and below the horizon.
    pub channels: Vec<Vec<f64>>,
    /// Bound of the error of the degree, by channel and sample. Light from the Earth and the Moon, the light of materials whose polarisation is not known, and
    /// what the simulation's stated error leaves open may each be polarised wholly, in either direction. Above 1 nothing is known of the degree; infinite where no light
    /// may be left, NaN where the degree is.
    pub channels_error: Vec<Vec<f64>>,
    /// Degree of linear polarisation in V, 0 to 1, before the air, by sample; NaN without light.
    pub v: Vec<f64>,
    /// Bound of the error of the degree in V, by sample, as [`Polarisation::channels_error`] but with the stated error of V.
    pub v_error: Vec<f64>,
    /// Position angle of the electric field of the light in V, from north through east (ICRS), 0 to 180 deg, as the IAU counts it, by sample: perpendicular to the plane of Sun, body and observer, but for
    /// light between surfaces.
    pub angle_deg: Vec<f64>,
    /// The same in each channel, by channel and sample.
    pub channels_angle_deg: Vec<Vec<f64>>,
    /// Materials whose polarisation is not known: they have no refractive index.
    pub unknown: Vec<String>,
}

fn material(error: &MaterialError) -> PassError {
    PassError::Input { needs: "the polarised part of a material", found: error.to_string() }
}

/// Bound of the error of a degree of polarisation, by the light whose polarisation is not known and by the stated error of all light, both of that light.
///
/// Let Q̂ be the polarised part that was found and d = Q̂/Î its degree. The light of unknown polarisation, U, changes Q by U at most. The light is I = Î + e with |e| ≤ E. What is
/// more or less of it may itself be polarised wholly, in either direction: that changes Q by E at most. So Q/I − Q̂/Î = (Q − Q̂ − d e)/I is within (U + (1 + d) E)/(Î − E).
fn bound(degree: f64, unknown: f64, stated: f64) -> f64 {
    let left = 1.0 - stated;
    if left <= 0.0 { f64::INFINITY } else { (unknown + (1.0 + degree) * stated) / left }
}

/// Position angle of the direction perpendicular to the plane of Sun, body and observer, where the body is seen in a direction, deg.
fn angle_deg(seen: DVec3, sun: DVec3) -> f64 {
    let north = DVec3::Z - seen * seen.z;
    let east = DVec3::Z.cross(seen);
    let towards_sun = sun.dot(east).atan2(sun.dot(north)).to_degrees();
    (towards_sun + 90.0).rem_euclid(180.0)
}

/// Passes by sunlight alone that the polarisation of a pass is found from.
pub(super) struct Parts {
    /// The polarised part of the light that is scattered once.
    pub polarised: Pass,
    /// All such light but that of materials whose polarisation is not known.
    pub diffuse_and_known: Pass,
    /// Light between surfaces; none where it is switched off.
    pub between: Option<Between<Pass>>,
    /// Names of these materials.
    pub unknown: Vec<String>,
}

/// Passes of a body whose materials of unknown polarisation are black, or what is made of them.
pub(super) struct Between<T> {
    /// Light that is scattered once.
    pub direct: T,
    /// The same and the light between surfaces, without regard to polarisation.
    pub all: T,
    /// The same behind polarisers at 0, 60 and 120° from the direction perpendicular to the plane of Sun, body and observer; none where all is diffuse.
    pub behind: Option<[T; 3]>,
}

impl<T> Between<T> {
    /// Makes the same of something else; none where `all` has no light between surfaces.
    pub fn map<'a, U, E>(
        &'a self,
        make: impl Fn(&'a T) -> Result<U, E>,
        terms: impl Fn(&U) -> &[Term],
    ) -> Result<Option<Between<U>>, E> {
        let all = make(&self.all)?;
        if terms(&all).iter().all(|term| term.source != Source::Bounce) {
            return Ok(None);
        }
        let behind = match &self.behind {
            None => None,
            Some([across, left, right]) => Some([make(across)?, make(left)?, make(right)?]),
        };
        Ok(Some(Between { direct: make(&self.direct)?, all, behind }))
    }
}

/// Some light and its stated error, over all light of the body.
#[derive(Debug, Clone, Copy)]
struct Share {
    light: f64,
    error: f64,
}

/// Polarisation of one sample of a channel.
#[derive(Debug, Clone, Copy)]
struct Degree {
    degree: f64,
    error: f64,
    /// Counter-clockwise from the direction perpendicular to the plane of Sun, body and observer, deg.
    turned_deg: f64,
}

impl Degree {
    const NONE: Self = Self { degree: f64::NAN, error: f64::NAN, turned_deg: 0.0 };
}

/// Returns what the three passes behind polarisers tell of I, Q and U of the light between surfaces, and how far off Q and I may be.
///
/// Behind a polariser at the angle a is ½(I + Q cos 2a + U sin 2a).
fn stokes(behind: [Share; 3], direct: Share) -> ([f64; 3], [f64; 2]) {
    // The light that is scattered once is in all of them as it is.
    let [b, c, d] = behind.map(|b| b.light - direct.light);
    let [eb, ec, ed] = behind.map(|b| (b.error - direct.error).max(0.0));
    let u = (c - d) * 2.0 / 3.0_f64.sqrt();
    let iqu = [2.0 / 3.0 * (b + c + d), 2.0 / 3.0 * (2.0 * b - c - d), u];
    (iqu, [2.0 / 3.0 * (2.0 * eb + ec + ed), 2.0 / 3.0 * (eb + ec + ed)])
}

impl Degree {
    /// By the polarised part of what is scattered once, all such light of known polarisation, the light between surfaces, and the relative stated error of all light.
    fn new(polarised: f64, known: f64, between: Option<&Between<Share>>, stated: f64) -> Self {
        let Some(between) = between else {
            let error = bound(polarised, (1.0 - known).abs(), stated);
            return Self { degree: polarised, error, turned_deg: 0.0 };
        };
        // Without regard to polarisation light between surfaces is another amount of light: what is polarised at one surface is reflected otherwise at the next.
        let plain = between.all.light - between.direct.light;
        let ([i, q, u], [error, error_of_all]) = match between.behind {
            Some(behind) => stokes(behind, between.direct),
            None => ([plain, 0.0, 0.0], [0.0; 2]),
        };
        let all = 1.0 - plain + i;
        let (q, u) = (polarised + q, u);
        let degree = q.hypot(u) / all;
        let unknown = (1.0 - known - plain).abs() + error + degree * error_of_all;
        Self {
            degree,
            error: bound(degree, unknown / all, stated / all),
            turned_deg: 0.5 * u.atan2(q).to_degrees(),
        }
    }
}

impl Pass {
    /// The passes that the polarisation is found from.
    pub(super) fn polarised(&self) -> Result<Parts, PassError> {
        let target = &self.target;
        let used = |k: usize| target.parts.iter().any(|part| part.material == k);
        let black = |of: &Material| Material::black(&of.name).map_err(|e| material(&e));
        let mut polarised = self.direct(target.clone());
        let mut diffuse_and_known = self.direct(target.clone());
        let (mut followed, mut facets) = (target.clone(), false);
        let mut unknown = Vec::new();
        for (k, of) in target.materials.iter().enumerate() {
            let part = match used(k) {
                true => of.polarised().map_err(|e| material(&e))?,
                false => PolarisedPart::Nothing,
            };
            match of.facets(&FACETS_NM) {
                Facets::Unknown => followed.materials[k] = black(of)?,
                Facets::Of { .. } => facets |= used(k),
                Facets::None => {}
            }
            if matches!(part, PolarisedPart::Unknown) {
                unknown.push(of.name.clone());
                diffuse_and_known.target.materials[k] = black(of)?;
            }
            polarised.target.materials[k] = match part {
                PolarisedPart::Of(material) => *material,
                PolarisedPart::Nothing | PolarisedPart::Unknown => black(of)?,
            };
        }
        let followed = || followed.clone();
        let between = (self.effects.inter_reflection != Switch::Off).then(|| Between {
            direct: self.alone(followed()),
            all: self.behind(followed(), Analyser::Open),
            behind: facets.then(|| {
                [Analyser::Across, Analyser::Left, Analyser::Right]
                    .map(|analyser| self.behind(followed(), analyser))
            }),
        });
        Ok(Parts { polarised, diffuse_and_known, between, unknown })
    }

    /// The same pass by direct sunlight alone, of another target.
    fn direct(&self, target: Target) -> Pass {
        let effects = Switches {
            solar_disc: self.effects.solar_disc,
            finite_distance: self.effects.finite_distance,
            ..Switches::OFF
        };
        Pass { target, effects, ..self.clone() }
    }

    /// The same, whose errors are those of this light alone.
    fn alone(&self, target: Target) -> Pass {
        let mut pass = self.direct(target);
        pass.effects.analyser = Some(Analyser::Open);
        pass
    }

    /// The same with light between surfaces, of which the observer sees what an analyser lets through.
    fn behind(&self, target: Target, analyser: Analyser) -> Pass {
        let mut pass = self.direct(target);
        pass.effects.inter_reflection = self.effects.inter_reflection;
        pass.effects.analyser = Some(analyser);
        pass
    }
}

impl Simulation<'_> {
    /// Linear polarisation of the light: one direct simulation of its polarised part, one for what bounds the error, and, where light goes between surfaces, five more.
    ///
    /// # Errors
    /// [`PassError`], as of a simulation; a refractive index between whose angles no interpolation holds.
    pub fn polarisation(
        &self,
        progress: &(dyn Fn(Progress) + Sync),
    ) -> Result<Polarisation, PassError> {
        let parts = self.pass.polarised()?;
        let (polarised, known) =
            (parts.polarised.simulate(progress)?, parts.diffuse_and_known.simulate(progress)?);
        let between = match &parts.between {
            None => None,
            Some(between) => between.map(|pass| pass.simulate(progress), |made| &made.terms[..])?,
        };
        Ok(self.polarised_by(&polarised, &known, between.as_ref(), parts.unknown.clone()))
    }

    /// The polarisation, by the polarised part of the light that is scattered once, by such light of the materials whose polarisation is known, and by light between surfaces.
    pub(super) fn polarised_by(
        &self,
        polarised: &Simulation<'_>,
        known: &Simulation<'_>,
        between: Option<&Between<Simulation<'_>>>,
        unknown: Vec<String>,
    ) -> Polarisation {
        let samples = self.places.len();
        let made = |share: &dyn Fn(&Simulation<'_>) -> Share| {
            let between = between.map(|b| Between {
                direct: share(&b.direct),
                all: share(&b.all),
                behind: b.behind.as_ref().map(|b| [share(&b[0]), share(&b[1]), share(&b[2])]),
            });
            let (part, known) = (share(polarised).light, share(known).light);
            Degree::new(part, known, between.as_ref(), share(self).error)
        };
        let in_channel = |c: usize, row: usize| {
            let all = self.channels[c].rate_hz[row];
            let share = |of: &Simulation<'_>| Share {
                light: of.channels[c].rate_hz[row] / all,
                error: of.channels[c].error_hz[row] / all,
            };
            if all > 0.0 { made(&share) } else { Degree::NONE }
        };
        let in_v = |row: usize| {
            let own = self.magnitudes[[row, V]];
            let share = |of: &Simulation<'_>| {
                let fainter = of.magnitudes[[row, V]] - own;
                // Without light there is no magnitude.
                let light = if fainter.is_nan() { 0.0 } else { 10_f64.powf(-0.4 * fainter) };
                // The magnitude's error is by how much fainter the light may be: of the light that is 1 − 10^(−0.4 Δm).
                let stated = 1.0 - 10_f64.powf(-0.4 * of.magnitude_errors[[row, V]]);
                Share { light, error: if light > 0.0 { light * stated } else { 0.0 } }
            };
            if own.is_finite() { made(&share) } else { Degree::NONE }
        };
        let perpendicular_deg: Vec<f64> = self
            .places
            .iter()
            .map(|place| angle_deg(-place.geometry.to_observer, place.geometry.sun.direction_gcrs))
            .collect();
        let angles = |found: &[Degree]| -> Vec<f64> {
            let each = perpendicular_deg.iter().zip(found);
            each.map(|(angle, found)| (angle + found.turned_deg).rem_euclid(180.0)).collect()
        };
        let channels: Vec<Vec<Degree>> = (0..self.channels.len())
            .map(|c| (0..samples).map(|row| in_channel(c, row)).collect())
            .collect();
        let v: Vec<Degree> = (0..samples).map(in_v).collect();
        let degrees = |of: &[Degree]| of.iter().map(|d| d.degree).collect::<Vec<f64>>();
        let errors = |of: &[Degree]| of.iter().map(|d| d.error).collect::<Vec<f64>>();
        Polarisation {
            channels: channels.iter().map(|all| degrees(all)).collect(),
            channels_error: channels.iter().map(|all| errors(all)).collect(),
            channels_angle_deg: channels.iter().map(|all| angles(all)).collect(),
            v: degrees(&v),
            v_error: errors(&v),
            angle_deg: angles(&v),
            unknown,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn direction(ra_deg: f64, dec_deg: f64) -> DVec3 {
        let ((sin, cos), (sin_dec, cos_dec)) =
            (ra_deg.to_radians().sin_cos(), dec_deg.to_radians().sin_cos());
        DVec3::new(cos_dec * cos, cos_dec * sin, sin_dec)
    }

    /// Truth: by hand: light of I 2, Q 0.3 and U −0.8 has ½(2 + 0.3 cos 2a − 0.8 sin 2a) behind a polariser at the angle a. Tolerance: rounding.
    #[test]
    fn three_polarisers_tell_the_stokes_vector() {
        let behind = [0.0_f64, 60.0, 120.0].map(|deg| {
            let (sin, cos) = (2.0 * deg.to_radians()).sin_cos();
            Share { light: 5.0 + 0.5 * (2.0 + 0.3 * cos - 0.8 * sin), error: 0.1 }
        });
        let (found, _) = stokes(behind, Share { light: 5.0, error: 0.1 });
        for (found, truth) in found.into_iter().zip([2.0, 0.3, -0.8]) {
            assert!((found - truth).abs() < 1e-12, "{found} {truth}");
        }
    }

    /// Truth: tan q = cos δ' sin(α' − α)/(sin δ' cos δ − cos δ' sin δ cos(α' − α)) for the position angle of a place (α', δ') seen from (α, δ) (Meeus 1998, Astronomical
    /// Algorithms, chapter 17), and a right angle more.
    #[test]
    fn the_field_is_perpendicular_to_the_direction_of_the_sun() {
        for (at, sun) in [
            ([10.0, 20.0], [100.0, -5.0]),
            ([200.0, -40.0], [350.0, 60.0]),
            ([0.0, 0.0], [90.0, 0.0]),
        ] {
            let ra = f64::to_radians(sun[0] - at[0]);
            let (sin, cos) = f64::to_radians(at[1]).sin_cos();
            let (sin_sun, cos_sun) = f64::to_radians(sun[1]).sin_cos();
            let q = (cos_sun * ra.sin()).atan2(sin_sun * cos - cos_sun * sin * ra.cos());
            let expected = (q.to_degrees() + 90.0).rem_euclid(180.0);
            let found = angle_deg(direction(at[0], at[1]), direction(sun[0], sun[1]));
            let off = (found - expected + 90.0).rem_euclid(180.0) - 90.0;
            assert!(off.abs() < 1e-9, "{found} {expected}");
        }
    }
}
