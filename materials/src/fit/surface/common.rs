//! Errors that all values of a table share. They do not show in residuals, nor at incidences that are left out, and no number of samples makes them smaller.

use super::judge::{Incidence, Region};
use super::model::{Cone, Surface, disc};
use super::{Doubt, Flaw, Number};
use crate::instrument::{HALF, TableInstrument};
use glam::DVec3;
use std::f64::consts::PI;
use sunglint_numerics::order::quantile;

/// Numbers that all light of their part is in proportion to.
const STRENGTHS: [&str; 3] = ["share", "mirror_share", "diffuse"];

/// Instrument, law, and where it was measured.
pub(super) struct Common<'a> {
    pub instrument: &'a TableInstrument,
    pub surface: &'a Surface,
    pub cone: Cone,
    pub incidences: &'a [Incidence],
}

impl Common<'_> {
    /// The law through a disc of a half-angle, radians.
    fn seen(&self, i: DVec3, o: DVec3, radius: f64) -> f64 {
        self.surface.seen(i, o, &disc(o, radius), 0.5 * radius * radius).max(f64::MIN_POSITIVE)
    }

    /// Half-width of the 95 % interval of ln f by what all samples of a region share; of a region without a sample that of all.
    fn of_region(&self, region: Region) -> f64 {
        let all = || {
            let each =
                |i: &Incidence| i.o.iter().copied().zip(i.region.clone()).collect::<Vec<_>>();
            self.incidences
                .iter()
                .flat_map(move |at| each(at).into_iter().map(|(o, r)| (at.i, o, r)))
        };
        let is_seen = all().any(|(_, _, r)| r == region);
        let rows = || all().filter(|(_, _, r)| *r == region || !is_seen);
        let radius = self.cone.radius_rad();
        // The interval is to hold nearly all samples of the region: what is darkest decides.
        let part = |(i, o, _): (DVec3, DVec3, Region)| {
            self.instrument.shared_ln(self.seen(i, o, radius), i, o)
        };
        let dark = rows().map(part);
        let mut dark: Vec<f64> = dark.collect();
        dark.sort_by(f64::total_cmp);
        let additive = if dark.is_empty() { 0.0 } else { quantile(&dark, 0.95) };
        let zero = super::rms(rows().map(|(i, o, _)| {
            let seen = self.seen(i, o, radius);
            let off = |aside| (self.seen(i, aside, radius) / seen).ln().abs();
            self.instrument.aside(i, o).map(off).fold(0.0, f64::max)
        }));
        // A source that nobody has seen may be as wide as the detector's cone.
        let wider = std::f64::consts::SQRT_2 * radius;
        let blur = super::rms(rows().map(|(i, o, _)| {
            if !self.instrument.is_source_unknown() || radius == 0.0 {
                return 0.0;
            }
            (self.seen(i, o, wider) / self.seen(i, o, radius)).ln()
        }));
        (HALF * self.instrument.scale_sigma)
            .hypot(additive)
            .hypot(HALF * zero.unwrap_or(0.0))
            .hypot(blur.unwrap_or(0.0))
    }

    /// The doubt with what all values share.
    pub fn widened(&self, doubt: Doubt) -> Doubt {
        Doubt {
            peak_ln: doubt.peak_ln.hypot(self.of_region(Region::Peak)),
            wings_ln: doubt.wings_ln.hypot(self.of_region(Region::Wings)),
            grazing_ln: doubt.grazing_ln.hypot(self.of_region(Region::Grazing)),
        }
    }

    /// Returns the standard deviation of a number's logarithm with what all values share.
    pub fn sigma(&self, name: &str, value: f64, own: f64) -> f64 {
        if !STRENGTHS.contains(&name) {
            return own;
        }
        let is_diffuse = name == "diffuse";
        let part = if is_diffuse {
            self.instrument.diffuse_sigma_ln(value)
        } else {
            let all = self.incidences.iter().flat_map(|at| at.o.iter().map(|o| (at.i, *o)));
            self.instrument.strength_sigma_ln(all)
        };
        own.hypot(self.instrument.scale_sigma).hypot(part)
    }

    /// Quantities that were not measured, and diffuse light that may be stray light.
    pub fn flaws(&self, numbers: &[Number]) -> Vec<Flaw> {
        let diffuse = numbers.iter().find(|n| n.name == "diffuse").map(|n| n.value);
        of_instrument(self.instrument, diffuse)
    }
}

/// A flaw for each quantity that was not measured, and one for a diffuse part (its reflectance) that may be stray light.
pub(in crate::fit) fn of_instrument(
    instrument: &TableInstrument,
    diffuse: Option<f64>,
) -> Vec<Flaw> {
    let one = |quantity: &String| Flaw::NotMeasured { quantity: quantity.clone() };
    let mut flaws: Vec<Flaw> = instrument.missing.iter().map(one).collect();
    // Stray light over cosθ_o, as it is left in f at 60°.
    let stray_per_sr = instrument.shared_per_sr(0.5);
    if let Some(diffuse) = diffuse.filter(|d| *d <= PI * stray_per_sr) {
        flaws.push(Flaw::DiffuseMayBeStray { diffuse, stray_per_sr });
    }
    flaws
}
