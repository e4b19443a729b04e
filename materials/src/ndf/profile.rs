//! One plane of incidence, from readings to ln f on the nodes.

use super::cone::{Cone, Fitted, fit_through};
use super::diffuse::{self, DiffuseLight, DiffuseOrigin};
use super::scan::Scan;
use super::shape::{EVERY_ALPHA, Reading, ShapeFit, fit, ln_shape};
use super::spline::{EvenSpline, Knots, knots_of};
use super::tail::{self, PLAUSIBLE, Tail};
use super::zero::{self, Zero, ZeroOrigin};
use super::{NdfError, NdfFlags, NdfOptions, Note, Profile};
use crate::table::StatedZero;
use std::ops::Range;
use sunglint_simulator::surface::Distribution;

/// A gap is this many times as wide as readings are apart elsewhere.
pub(super) const GAP_STEPS: f64 = 3.0;

/// Statements of a run about its rig.
#[derive(Debug, Clone, Default)]
pub(super) struct Stated {
    /// The cone of light into the meter.
    pub cone: Option<Cone>,
    /// The symmetry point, of a run of one plane.
    pub zero: Option<StatedZero>,
}

/// A plane of incidence on the nodes.
#[derive(Debug, Clone)]
pub(super) struct Traced {
    pub profile: Profile,
    /// Whether the symmetry point is found from these readings, and so again from others.
    finds_zero: bool,
    /// The law that says what the cone took, where that is known.
    cleared: Option<Distribution>,
    reference: Reference,
    /// ln f on the nodes: as found, then with other continuations and across gaps otherwise.
    pub ln_f: Vec<Vec<f64>>,
    pub flags: Vec<NdfFlags>,
}

/// A lobe that ln f is counted from before it is interpolated: what it leaves is smoother. None where no lobe is near, or only one that is narrower than a step.
#[derive(Debug, Clone, Copy)]
struct Reference(Option<(Distribution, f64)>);

/// A lobe that leaves more than this of ln f is no reference.
const NEAR: f64 = 0.2;

impl Reference {
    fn of(beckmann: ShapeFit, ggx: ShapeFit, step_deg: f64) -> Self {
        let both = [(Distribution::Beckmann, beckmann), (Distribution::Ggx, ggx)];
        let best = both.into_iter().min_by(|a, b| a.1.misfit.total_cmp(&b.1.misfit));
        let is_near =
            |f: &ShapeFit| f.misfit < NEAR && f.alpha.to_degrees() > step_deg && f.alpha < 1.0;
        Self(best.filter(|(_, f)| is_near(f)).map(|(d, f)| (d, f.alpha)))
    }

    fn at(self, theta: f64) -> f64 {
        self.0.map_or(0.0, |(distribution, alpha)| ln_shape(distribution, alpha, theta))
    }
}

/// ln f between readings.
struct Curve<'a> {
    spline: EvenSpline<'a>,
    reference: Reference,
}

impl<'a> Curve<'a> {
    fn through(knots: &'a Knots, reference: Reference, readings: &[Reading]) -> Option<Self> {
        let left: Vec<Reading> =
            readings.iter().map(|(x, y, w)| (*x, y - reference.at(*x), *w)).collect();
        Some(Self { spline: knots.through(&left)?, reference })
    }

    fn at(&self, theta: f64) -> f64 {
        self.spline.at(theta) + self.reference.at(theta)
    }
}

impl Traced {
    /// From a scan to nodes at `theta` (radians). Where the readings do not decide the symmetry point, that which the run states is taken.
    ///
    /// # Errors
    /// Angles that are missing amid the peak, or beside it so that the symmetry point is not decided.
    pub fn new(
        scan: &Scan,
        azimuth_deg: f64,
        theta: &[f64],
        (options, stated): (&NdfOptions, &Stated),
        notes: &mut Vec<Note>,
    ) -> Result<Self, NdfError> {
        let smoothed = options.median.map(|width| scan.smoothed(width));
        let scan = smoothed.as_ref().unwrap_or(scan);
        let zero = match options.zero_deg {
            Some(angle_deg) => Zero { angle_deg, sigma_deg: 0.0, origin: ZeroOrigin::Given },
            None => zero::find(scan, options.most_offset_deg)?,
        };
        let (zero, finds_zero) = match (zero.origin, stated.zero) {
            (ZeroOrigin::Assumed, Some(StatedZero { angle_deg, sigma_deg, origin })) => {
                (Zero { angle_deg, sigma_deg, origin }, false)
            }
            (origin, _) => (zero, origin == ZeroOrigin::Fitted),
        };
        if zero.origin == ZeroOrigin::Assumed {
            notes.push(Note::ZeroAssumed);
        }
        let too_few = || NdfError::TooFew { found: scan.f.len(), least: 8 };
        let all = off_normal(scan, zero.angle_deg);
        if let Some(f_per_sr) = diffuse::rising(&all) {
            let top = scan.f.iter().copied().fold(0.0, f64::max);
            let (part, zero_deg) = (f_per_sr / top, zero.angle_deg);
            notes.push(Note::Floor { f_per_sr, part, zero_deg });
        }
        let (readings, diffuse) = lobe_of(&all, scan.knows_sigma(), options, notes);
        let cone = stated.cone.as_ref();
        let near = near_normal(&readings, scan.knows_sigma());
        let shape = |d: Distribution| fit_through(cone, d, &near, EVERY_ALPHA, None);
        let (beckmann, ggx) = (shape(Distribution::Beckmann), shape(Distribution::Ggx));
        let laws = [(Distribution::Beckmann, beckmann), (Distribution::Ggx, ggx)];
        let (is_ggx, least_misfit) =
            (ggx.misfit < beckmann.misfit, beckmann.misfit.min(ggx.misfit));
        let most_misfit = PLAUSIBLE.max(3.0 * least_misfit);
        let both_follow = beckmann.misfit.max(ggx.misfit) <= most_misfit;
        let (law, other) = if is_ggx { (laws[1], laws[0]) } else { (laws[0], laws[1]) };
        let (law, other) = (Fitted::of(law.0, law.1), Fitted::of(other.0, other.1));
        let readings = match cone {
            Some(cone) => cone.cleared(&law, &readings),
            None => readings,
        };
        let reference = Reference::of(beckmann, ggx, scan.step_deg());
        let knots = Knots::new(knots_of(&places(&readings))).ok_or_else(too_few)?;
        let spline = Curve::through(&knots, reference, &readings).ok_or_else(too_few)?;
        let gaps = gaps(&readings, &spline, scan.step_deg(), notes)?;
        let end = knots.end();
        let joint = (end, spline.at(end));
        let best = tail::chosen(&readings, joint, options.tail).ok_or_else(too_few)?;
        let others = tail::others(&readings, joint, &best);
        let profile = Profile {
            azimuth_deg,
            zero,
            measured_to_deg: end.to_degrees(),
            step_deg: scan.step_deg(),
            tail: best.kind,
            beckmann,
            ggx,
            diffuse,
        };
        let along = |theta: f64, tail: &Tail| {
            if theta > end { tail.at(theta) } else { spline.at(theta) }
        };
        let tails = std::iter::once(&best).chain(&others);
        let mut ln_f: Vec<Vec<f64>> =
            tails.map(|tail| theta.iter().map(|t| along(*t, tail)).collect()).collect();
        if !gaps.is_empty() {
            let straight = |t: f64| match gaps.iter().find(|g| g.contains(&t)) {
                Some(g) => {
                    let share = (t - g.start) / (g.end - g.start);
                    (1.0 - share) * spline.at(g.start) + share * spline.at(g.end)
                }
                None => along(t, &best),
            };
            ln_f.push(theta.iter().map(|t| straight(*t)).collect());
        }
        // What the cone takes is not the same of both laws; beyond the last angle the continuations say more than that.
        if let Some(cone) = cone.filter(|_| both_follow) {
            let more = |t: f64| cone.ln_blur_of(&law, t) - cone.ln_blur_of(&other, t);
            let at = |t: &f64| along(*t, &best) + more(t.min(end));
            ln_f.push(theta.iter().map(at).collect());
        }
        let flag = |t: &f64| {
            if *t > end {
                NdfFlags::EXTRAPOLATED
            } else if gaps.iter().any(|g| g.contains(t)) {
                NdfFlags::GAP
            } else {
                NdfFlags::empty()
            }
        };
        let flags = theta.iter().map(flag).collect();
        let better = if is_ggx { Distribution::Ggx } else { Distribution::Beckmann };
        let cleared = cone.map(|_| better);
        Ok(Self { profile, finds_zero, cleared, reference, ln_f, flags })
    }

    /// ln f on the nodes and the two roughnesses of the same scan with other readings: the kind of continuation is kept, the symmetry point is fitted again if these readings gave it;
    /// else it is drawn with its uncertainty (`normal` is a standard normal number), and the cosine in f with it.
    pub fn again(
        &self,
        scan: &Scan,
        theta: &[f64],
        (options, stated): (&NdfOptions, &Stated),
        normal: f64,
    ) -> Option<Self> {
        let mut profile = self.profile.clone();
        let mut turned = None;
        if !self.finds_zero && profile.zero.sigma_deg > 0.0 {
            profile.zero.angle_deg += normal * profile.zero.sigma_deg;
            turned =
                stated.zero.map(|zero| scan.with_cosine(zero.angle_deg, profile.zero.angle_deg));
        }
        let scan = turned.as_ref().unwrap_or(scan);
        let smoothed = options.median.map(|width| scan.smoothed(width));
        let scan = smoothed.as_ref().unwrap_or(scan);
        if self.finds_zero {
            profile.zero.angle_deg = zero::refined(scan, profile.zero.angle_deg)?;
        }
        let all = off_normal(scan, profile.zero.angle_deg);
        let shapes = [(Distribution::Beckmann, profile.beckmann), (Distribution::Ggx, profile.ggx)];
        let near = shapes.into_iter().min_by(|a, b| a.1.misfit.total_cmp(&b.1.misfit))?;
        profile.diffuse = diffuse::again(&profile.diffuse, &all, seen_as(near));
        let seen = diffuse::taken_off(&all, &profile.diffuse, scan.knows_sigma());
        let near = near_normal(&seen, scan.knows_sigma());
        let close =
            |alpha: f64| ((0.5 * alpha).max(EVERY_ALPHA.0), (1.7 * alpha).min(EVERY_ALPHA.1));
        let cone = stated.cone.as_ref();
        let shape =
            |d: Distribution, found: f64| fit_through(cone, d, &near, close(found), Some(found));
        profile.beckmann = shape(Distribution::Beckmann, profile.beckmann.alpha);
        profile.ggx = shape(Distribution::Ggx, profile.ggx.alpha);
        let readings = match (cone, self.cleared) {
            (Some(cone), Some(distribution)) => {
                let is_ggx = distribution == Distribution::Ggx;
                let fit = if is_ggx { profile.ggx } else { profile.beckmann };
                cone.cleared(&Fitted::of(distribution, fit), &seen)
            }
            _ => seen,
        };
        let knots = Knots::new(knots_of(&places(&readings)))?;
        let spline = Curve::through(&knots, self.reference, &readings)?;
        let end = knots.end();
        let best = tail::chosen(&readings, (end, spline.at(end)), Some(profile.tail))?;
        let along = |t: &f64| if *t > end { best.at(*t) } else { spline.at(*t) };
        let ln_f = vec![theta.iter().map(along).collect()];
        Some(Self { profile, ln_f, flags: Vec::new(), ..*self })
    }
}

/// A law with the roughness of the lobe as it is seen.
fn seen_as((distribution, fit): (Distribution, ShapeFit)) -> (Distribution, f64) {
    (distribution, fit.seen_alpha.unwrap_or(fit.alpha))
}

/// The readings of the lobe, and the diffuse light that was taken off them.
fn lobe_of(
    all: &[Reading],
    knows_sigma: bool,
    options: &NdfOptions,
    notes: &mut Vec<Note>,
) -> (Vec<Reading>, DiffuseLight) {
    if !options.diffuse {
        return (all.to_vec(), DiffuseLight::default());
    }
    let alone = |d: Distribution| fit(d, all, EVERY_ALPHA).misfit;
    let mut found = diffuse::find(all, alone(Distribution::Beckmann).min(alone(Distribution::Ggx)));
    if found.origin == DiffuseOrigin::Fitted {
        let readings = diffuse::taken_off(all, &found, knows_sigma);
        let ends = [readings.first(), readings.last()].into_iter().flatten();
        let followed_to = ends.fold(0.0_f64, |a, r| a.max(r.0.abs()));
        if readings.len() >= LEAST_OF_LOBE {
            notes.push(Note::Diffuse {
                reflectance: found.reflectance(),
                bound: std::f64::consts::PI * found.bound_per_sr,
                followed_to_deg: followed_to.to_degrees(),
            });
            return (readings, found);
        }
        found.origin = DiffuseOrigin::Unknown;
    }
    if found.origin == DiffuseOrigin::Unknown {
        notes.push(Note::DiffuseUnknown { most: found.reflectance() });
    }
    (all.to_vec(), found)
}

/// Readings that a lobe needs beside diffuse light.
const LEAST_OF_LOBE: usize = 8;

/// Angle off the normal (radians), ln f, weight, in the order of the angles.
fn off_normal(scan: &Scan, zero_deg: f64) -> Vec<Reading> {
    let nodes = scan.angle_deg.iter().zip(&scan.f).zip(scan.weights());
    nodes.map(|((angle, f), weight)| ((angle - zero_deg).to_radians(), f.ln(), weight)).collect()
}

fn places(readings: &[Reading]) -> Vec<f64> {
    readings.iter().map(|r| r.0).collect()
}

/// Returns the readings that a parametric lobe is fitted to: where f is above a thousandth of its largest, which the normal's neighbourhood decides. `known` says whether weights are 1/σ² of
/// ln f.
fn near_normal(readings: &[Reading], known: bool) -> Vec<Reading> {
    let top = readings.iter().fold(f64::NEG_INFINITY, |a, r| a.max(r.1));
    let near = readings.iter().filter(|r| r.1 >= top - 1000_f64.ln()).copied();
    // Equal weights, since a real lobe differs from both by more than noise; but less of readings whose noise is more than that, which in ln f also is no longer even.
    let weight = |w: f64| if known { 1.0 / (1.0 + 1.0 / (w * DIFFERS * DIFFERS)) } else { 1.0 };
    near.map(|(x, y, w)| (x, y, weight(w))).collect()
}

/// Difference of a real lobe from a law, in ln f: noise that is larger makes a reading count less.
const DIFFERS: f64 = 0.02;

/// Where neighbouring readings off the normal are far apart, radians.
fn gaps(
    readings: &[Reading],
    spline: &Curve<'_>,
    step_deg: f64,
    notes: &mut Vec<Note>,
) -> Result<Vec<Range<f64>>, NdfError> {
    let mut off: Vec<f64> = readings.iter().map(|r| r.0.abs()).collect();
    off.push(0.0);
    off.sort_by(f64::total_cmp);
    let least = GAP_STEPS * step_deg.to_radians();
    let wide = off.windows(2).filter(|pair| pair[1] - pair[0] > least);
    let gaps: Vec<Range<f64>> = wide.map(|pair| pair[0]..pair[1]).collect();
    if gaps.is_empty() {
        return Ok(gaps);
    }
    let peak = readings.iter().fold(f64::NEG_INFINITY, |a, r| a.max(r.1)).max(spline.at(off[1]));
    let half = off.iter().find(|x| spline.at(**x) < peak - 2_f64.ln());
    let half_width = half.copied().unwrap_or(f64::INFINITY);
    for gap in &gaps {
        let (from_deg, to_deg) = (gap.start.to_degrees(), gap.end.to_degrees());
        // A lobe that never falls to half has no peak to miss.
        if gap.start == 0.0 || (gap.start < half_width && half_width.is_finite()) {
            let half_width_deg = half_width.to_degrees();
            return Err(NdfError::GapInPeak { from_deg, to_deg, half_width_deg });
        }
        notes.push(Note::Gap { from_deg, to_deg });
    }
    Ok(gaps)
}
