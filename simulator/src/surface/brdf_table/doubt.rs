//! Error of interpolation in a table, from leaving measured values out.

use super::{Around, Between, NOT_RESOLVED, SAME_DEG, Table};
use glam::DVec3;
use std::f64::consts::PI;

/// A direction this near the mirrored ray, in direction cosines, is on it.
const ON_RAY: f64 = 1e-4;
/// A fall of ln f from there to the next direction larger than this, a factor of 10, is too large.
const MOST_FALL_LN: f64 = 2.303;
/// Values that fall as a larger power than this of the distance from the mirrored ray do not show the peak's top.
const MOST_POWER: f64 = 1.0;
/// Part of the errors that a doubt holds.
const HELD: f64 = 0.95;
/// Light or detector farther than this from the normal graze (cosine of 75°).
const GRAZING_COS: f64 = 0.258_819;
/// Errors that a region needs for numbers of its own.
const LEAST: usize = 12;
/// Rows of an incidence that are left out and predicted, at most.
const MOST: usize = 400;
/// Beyond the last incidence ln f may change this many times as fast as before it.
const GROWTH: f64 = 2.0;
/// ln f of a table with one incidence may be off by this at another one: nobody knows.
const UNKNOWN: f64 = 2.0;

/// How errors grow, by region: about the mirrored direction, elsewhere, at grazing angles.
#[derive(Debug, Clone, Default)]
pub(super) struct Doubts {
    /// ln f per √rad from the nearest measured incidence.
    per_root: [f64; 3],
    /// Beyond the first and the last incidence: ln f per [`super::steepness`].
    per_past: [f64; 3],
    /// At a measured row: what reciprocity asks of it.
    met: [f64; 3],
    /// By row: how much it differs from what its neighbours say.
    bend: Vec<f64>,
    /// Whether incidences could be left out.
    measured: bool,
    /// By slice where its directions are too far apart for the peak.
    inner: Vec<Option<Inner>>,
}

/// Directions that miss the peak, or that are too far from the next.
#[derive(Debug, Clone, Copy)]
struct Inner {
    /// The nearest direction's distance from the mirrored ray, in direction cosines; 0 on it.
    distance: f64,
    /// The same of the next, where the fall is measured.
    next: f64,
    /// ln f may be larger by this in the mirrored direction.
    ln_more: f64,
}

impl Inner {
    /// Looks at directions with light from `i` and the logarithms of their values.
    fn of(i: DVec3, rows: impl Iterator<Item = (DVec3, f64)>) -> Option<Self> {
        let mut all: Vec<(f64, f64)> =
            rows.map(|(o, ln)| ((o.x + i.x).hypot(o.y + i.y), ln)).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (distance, ln) = *all.first()?;
        let on_ray = distance < ON_RAY;
        let least = if on_ray { ON_RAY } else { 2.0 * distance };
        let (next, ln_next) = *all.iter().find(|(r, _)| *r >= least)?;
        let fall = ln - ln_next;
        if on_ray {
            return (fall > MOST_FALL_LN).then_some(Self { distance: 0.0, next, ln_more: 0.0 });
        }
        // Of a lobe whose wings fall with the fourth power, as those of GGX do, and that reflects all light: its height over the value at this distance.
        let ln_more = (-2.0 * (PI * distance * distance * ln.exp()).ln()).max(0.0);
        let is_steep = fall > MOST_POWER * (next / distance).ln();
        is_steep.then_some(Self { distance, next, ln_more })
    }

    /// The doubt of ln f at a distance from the mirrored ray.
    fn at(&self, distance: f64) -> f64 {
        if distance >= self.distance {
            return 0.0;
        }
        self.ln_more.min(4.0 * (self.distance / distance.max(1e-9)).ln())
    }
}

impl Doubts {
    /// Measures the errors of a table.
    pub fn of(table: &Table, ln_scatter: &[f64]) -> Self {
        let n = table.theta.len();
        let mut bend = made_bends(table);
        for (bend, scatter) in bend.iter_mut().zip(ln_scatter) {
            *bend = bend.hypot(*scatter);
        }
        let inner = inner(table);
        let mut made = Self { bend, measured: n >= 2, inner, ..Self::default() };
        // The first and the last are left out only where there is no other: they are extrapolated then.
        let left_out = if n >= 3 { 1..n - 1 } else { 0..if n == 2 { 2 } else { 0 } };
        let (mut all, mut errors) = (Vec::new(), [const { Vec::new() }; 3]);
        let (mut all_past, mut errors_past) = (Vec::new(), [const { Vec::new() }; 3]);
        let mut met = [const { Vec::new() }; 3];
        let of_incidence = |j: usize| {
            let same = move |k: &usize| {
                (table.directions[*k].0.z - table.theta[j].cos()).abs()
                    < SAME_DEG.to_radians().max(1e-9)
            };
            let rows: Vec<usize> = (0..table.directions.len()).filter(same).collect();
            let step = rows.len().div_ceil(MOST).max(1);
            rows.into_iter().step_by(step)
        };
        for j in 0..n {
            for row in of_incidence(j) {
                let (i, o) = table.directions[row];
                if table.log[row * table.wavelengths] == f64::NEG_INFINITY {
                    continue;
                }
                let region = region(table, i, o);
                let error = |without| {
                    let around = table.around(i, o, without);
                    let off = |k: usize| {
                        let truth = table.log[row * table.wavelengths + k];
                        let off = (table.ln_at(&around.stencil, k) - truth).abs();
                        if off.is_finite() { off } else { 0.0 }
                    };
                    let worst = (0..table.wavelengths).map(off).fold(0.0, f64::max);
                    (worst, around)
                };
                met[region].push(error(None).0);
                if left_out.contains(&j) {
                    let (off, around) = error(Some(j));
                    let rate = off / around.distance.max(1e-3).sqrt();
                    errors[region].push(rate);
                    all.push(rate);
                }
                if n >= 2 && (j == 0 || j == n - 1) {
                    let (off, around) = error(Some(j));
                    if around.past > 1e-3 {
                        errors_past[region].push(off / around.past);
                        all_past.push(off / around.past);
                    }
                }
            }
        }
        let everywhere = quantile(&mut all);
        let past = quantile(&mut all_past);
        for (rate, errors) in made.per_past.iter_mut().zip(&mut errors_past) {
            *rate = GROWTH * if errors.len() >= LEAST { quantile(errors) } else { past };
        }
        for (region, (errors, met)) in errors.iter_mut().zip(&mut met).enumerate() {
            let enough = errors.len() >= LEAST;
            made.per_root[region] = if enough { quantile(errors) } else { everywhere };
            made.met[region] = quantile(met);
        }
        made
    }

    /// Half-width of the 95 % interval of ln f.
    pub fn at(&self, table: &Table, i: DVec3, o: DVec3) -> f64 {
        let around = table.around(i, o, None);
        let region = region(table, i, o);
        let between = if self.measured {
            (self.per_root[region] * around.distance.sqrt())
                .max(self.per_past[region] * around.past)
        } else if around.distance < SAME_DEG.to_radians() {
            0.0
        } else {
            UNKNOWN
        };
        let bend = |(row, w): &(usize, f64)| w * self.bend.get(*row).copied().unwrap_or(0.0);
        let bends: f64 = around.stencil.parts().iter().map(bend).sum();
        let outside = outside(table, i, o, &around);
        let plane = if table.flat { out_of_plane(table, i, o) } else { 0.0 };
        let interpolated = between.hypot(self.met[region]).hypot(bends).hypot(plane).hypot(outside);
        // No error that was measured: it stands beside the others.
        interpolated + self.peak(table, i, o)
    }

    /// The part of a peak between the directions that may be missed.
    fn peak(&self, table: &Table, i: DVec3, o: DVec3) -> f64 {
        if self.inner.iter().all(Option::is_none) {
            return 0.0;
        }
        let distance = (i.x + o.x).hypot(i.y + o.y);
        let one = |i: DVec3| {
            let Between { low, high, part, .. } = table.between(super::elevation(i), None);
            let (k, next, f) = table.azimuth(i);
            let mut sum = 0.0;
            for (k, around) in [(k, 1.0 - f), (next, f)] {
                for (j, up) in [(low, 1.0 - part), (high, part)] {
                    let inner = self.inner.get(k * table.theta.len() + j).copied().flatten();
                    sum += around * up * inner.map_or(0.0, |inner| inner.at(distance));
                }
            }
            sum
        };
        one(i).max(one(o))
    }

    /// The note on incidences whose peak lies between the directions.
    pub fn not_resolved(&self, table: &Table) -> Option<String> {
        let mut said: Vec<String> = Vec::new();
        let (mut at, mut apart) = (0.0_f64, 0.0_f64);
        for (k, inner) in self.inner.iter().enumerate() {
            let Some(inner) = inner else { continue };
            let theta = table.theta[k % table.theta.len()];
            let deg = |r: f64| (r / theta.cos().max(0.1)).min(1.0).asin().to_degrees();
            at = at.max(deg(inner.distance));
            apart = apart.max(deg(inner.next));
            let text = format!("{}°", (theta.to_degrees() * 1e3).round() / 1e3);
            if !said.contains(&text) {
                said.push(text);
            }
        }
        (!said.is_empty()).then(|| {
            format!(
                "{NOT_RESOLVED}: at {} of incidence the directions nearest to the mirrored ray (up to {at:.1}° from it, the next at {apart:.1}°) are farther apart than the lobe is wide. Its height and the hemispherical reflectance are those of the table's steps, and the doubt there says so",
                said.join(", ")
            )
        })
    }
}

/// By slice what its directions say of the peak.
fn inner(table: &Table) -> Vec<Option<Inner>> {
    let mut rows: Vec<Vec<usize>> = vec![Vec::new(); table.slices.len()];
    let same = |a: DVec3, b: DVec3| (a - b).length() < 4.0 * SAME_DEG.to_radians();
    for (row, (i, _)) in table.directions.iter().enumerate() {
        for (slice, rows) in table.slices.iter().zip(&mut rows) {
            if same(slice.i, *i) {
                rows.push(row);
            }
        }
    }
    let ln = |row: usize| table.log[row * table.wavelengths];
    let of = |(slice, rows): (&super::Slice, &Vec<usize>)| {
        let known = rows.iter().filter(|row| ln(**row).is_finite());
        Inner::of(slice.i, known.map(|row| (table.directions[*row].1, ln(*row))))
    };
    table.slices.iter().zip(&rows).map(of).collect()
}

/// Outside of the directions of an incidence the value at their edge stands: it may change there as much as it does on as long a way inside, towards the mirrored ray.
fn outside(table: &Table, i: DVec3, o: DVec3, around: &Around) -> f64 {
    if around.outside < 1e-6 {
        return 0.0;
    }
    let mirrored = DVec3::new(-i.x, -i.y, i.z);
    let angle = o.angle_between(mirrored);
    if angle < 1e-9 {
        return 0.0;
    }
    let part = (2.0 * around.outside / angle).min(1.0);
    let (at, rest) = ((part * angle).sin(), ((1.0 - part) * angle).sin());
    let inward = ((o * rest + mirrored * at) / angle.sin().max(1e-9)).normalize();
    let inside = table.around(i, inward, None);
    let change = |k: usize| table.ln_at(&around.stencil, k) - table.ln_at(&inside.stencil, k);
    let changes = (0..table.wavelengths).map(|k| change(k).abs());
    changes.filter(|c| c.is_finite()).fold(0.0, f64::max)
}

/// Two thirds of a lobe's logarithm change with the azimuth at the same tilt and difference as 1/(cosθ_i cosθ_o) does, or not at all: microfacets do, the ABg model and diffuse light do not.
fn out_of_plane(table: &Table, i: DVec3, o: DVec3) -> f64 {
    table
        .in_plane(i, o)
        .map_or(0.0, |(a, b, _)| ((a.z * b.z).max(1e-4) / (i.z * o.z).max(1e-4)).ln().abs())
}

fn region(table: &Table, i: DVec3, o: DVec3) -> usize {
    let h = i + o;
    let tilt = h.x.hypot(h.y).atan2(h.z);
    if tilt < table.width_rad.min(0.2) {
        0
    } else if i.z.min(o.z) < GRAZING_COS {
        2
    } else {
        1
    }
}

/// By row how far it is from the line between its neighbours, a quarter of that: of a smooth curve that is the error between two of them.
fn made_bends(table: &Table) -> Vec<f64> {
    let mut bend = vec![0.0_f64; table.log.len() / table.wavelengths];
    for slice in &table.slices {
        slice.beside(|row, before, after, part| {
            for k in 0..table.wavelengths {
                let ln = |row: usize| table.log[row * table.wavelengths + k];
                let off = (ln(row) - (1.0 - part) * ln(before) - part * ln(after)).abs();
                if off.is_finite() {
                    bend[row] = bend[row].max(0.25 * off);
                }
            }
        });
    }
    bend
}

fn quantile(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    values.sort_by(f64::total_cmp);
    values[(((values.len() - 1) as f64) * HELD).ceil() as usize]
}
