//! Measured quantities at each incidence, and the misfit of a surface to them.

use super::hemisphere::{self, Hemisphere};
use super::model::{Cone, Recipe, Seen, Surface, disc};
use glam::DVec3;
use nalgebra::{DMatrix, DVector};
use std::cell::RefCell;
use std::convert::Infallible;
use std::rc::Rc;
use sunglint_numerics::least_squares::{
    Bounded, Differences, Limits, Minimum, Residuals, minimise_residuals,
};
use sunglint_numerics::order::robust_sigma;
use sunglint_simulator::surface::Shape;

/// Weights of ln(hemispherical) and ln(peak) of an incidence beside the mean square of ln f, as their square roots, in units of the typical misfit of ln f: a surface that can be
/// described to 10 % is not bent for the sake of a peak as one that can be described to 25 % is.
const HEMISPHERICAL: f64 = 4.0;
const PEAK: f64 = 2.0;
/// Their part where the table reflects more than a surface can, or where nothing is known of its peak.
const DOUBTED: f64 = 0.5;
/// A table that reflects more than this is doubted.
pub(super) const MOST_OF_TABLE: f64 = 0.95;
/// The weight of ln(albedo) where it exceeds 1.
const ENERGY: f64 = 10.0;
/// Cosines of the incidences at which energy is looked at.
const COSINES: [f64; 8] = [1.0, 0.9, 0.75, 0.5, 0.26, 0.14, 0.05, 0.015];
/// An albedo above this costs.
const MOST_ALBEDO: f64 = 0.998;
/// Within this of the mirrored direction an instrument's disc is summed over, in its radii.
const BLURRED: f64 = 12.0;
/// Residuals on one side of the mirrored direction that differ from those on the other by more than this, in standard deviations, count less.
const OUTLYING: f64 = 3.0;
/// Direction cosine from which a direction is well out of a plane.
const OUT_OF_PLANE: f64 = 0.1;
/// Least, which no logarithm is taken of.
const LEAST: f64 = 1e-300;

/// Where a direction lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Region {
    /// About the mirrored direction.
    Peak,
    /// Elsewhere.
    Wings,
    /// Where light or detector graze.
    Grazing,
}

/// Angle from the mirrored direction up to which it is the peak, radians (3°).
const PEAK_RAD: f64 = 0.052_36;
/// Cosine below which a direction grazes (75°).
const GRAZING: f64 = 0.258_9;

impl Region {
    /// The region of light from `i` to `o`.
    pub fn of(i: DVec3, o: DVec3) -> Self {
        if o.angle_between(DVec3::new(-i.x, -i.y, i.z)) <= PEAK_RAD {
            Self::Peak
        } else if o.z < GRAZING || i.z < GRAZING {
            Self::Grazing
        } else {
            Self::Wings
        }
    }
}

/// A row of the table, its direction, its value, and the uncertainty of ln f over the typical one.
pub(super) type Row = (usize, DVec3, f64, f64);

/// An incidence with its samples.
#[derive(Debug, Clone)]
pub(super) struct Incidence {
    pub theta_i_deg: f64,
    pub i: DVec3,
    pub o: Vec<DVec3>,
    /// Rows of the table.
    pub row: Vec<usize>,
    pub value: Vec<f64>,
    /// ln f, or where errors do not grow with the value, arsinh(f/b).
    pub ln: Vec<f64>,
    /// b: the value, sr⁻¹, at which the error that is the same everywhere equals that in proportion; 0 where there is none.
    pub equal_per_sr: f64,
    /// Uncertainties of ln f over the typical one.
    pub unit: Vec<f64>,
    pub region: Vec<Region>,
    pub hemisphere: Hemisphere,
    /// Hemispherical reflectance of the table.
    pub hemispherical: f64,
    /// Weight of the hemispherical reflectance and the peak: less where the table reflects more than a surface can, or where nothing is known of its peak.
    trust: f64,
    /// The samples at the peak.
    pub peak: Vec<usize>,
    /// The sample on the other side of the mirrored direction.
    partner: Vec<Option<usize>>,
    disc: Vec<Vec<(DVec3, f64)>>,
}

impl Incidence {
    pub fn new(theta_i_deg: f64, i: DVec3, rows: Vec<Row>, cone: &Cone, equal_per_sr: f64) -> Self {
        let o: Vec<DVec3> = rows.iter().map(|r| r.1).collect();
        let value: Vec<f64> = rows.iter().map(|r| r.2).collect();
        let hemisphere = Hemisphere::new(i, &o, &value);
        let radius = cone.radius_rad();
        let mirrored = DVec3::new(-i.x, -i.y, i.z);
        let near = (BLURRED * radius).max(1e-9);
        let disc = o
            .iter()
            .map(|o| if o.angle_between(mirrored) < near { disc(*o, radius) } else { vec![] })
            .collect();
        let mut peak = hemisphere::peak(i, &o, radius, 0.1);
        peak.retain(|k| value[*k] > equal_per_sr);
        let hemispherical = hemisphere.of(&value);
        let doubted = hemispherical > MOST_OF_TABLE || !hemisphere.is_known();
        Self {
            theta_i_deg,
            i,
            trust: if doubted { DOUBTED } else { 1.0 },
            hemispherical,
            row: rows.iter().map(|r| r.0).collect(),
            ln: value.iter().map(|v| scaled(*v, equal_per_sr)).collect(),
            equal_per_sr,
            unit: rows.iter().map(|r| r.3).collect(),
            region: o.iter().map(|o| Region::of(i, *o)).collect(),
            partner: partners(i, &o),
            hemisphere,
            peak,
            disc,
            o,
            value,
        }
    }

    /// The distance from the sample at the peak to the nearest other one, degrees.
    pub fn step_at_peak_deg(&self) -> Option<f64> {
        let peak = *self.peak.first()?;
        let others = self.o.iter().enumerate().filter(|(k, _)| *k != peak);
        let least =
            others.map(|(_, o)| o.angle_between(self.o[peak])).fold(f64::INFINITY, f64::min);
        Some(least.to_degrees()).filter(|deg| deg.is_finite())
    }

    /// With fewer samples: those about the mirrored direction, and of the others so many that about `most` are left.
    pub fn thinned(&self, most: usize, cone: &Cone) -> Self {
        let stride = self.o.len().div_ceil(most).max(1);
        // In the order along the plane of incidence neighbours go, in whatever order the table has them.
        let mut order: Vec<usize> = (0..self.o.len()).collect();
        let key = |k: &usize| (self.o[*k].x, self.o[*k].y);
        order.sort_by(|a, b| key(a).partial_cmp(&key(b)).unwrap_or(std::cmp::Ordering::Equal));
        let kept = order.into_iter().enumerate().filter(|(n, k)| {
            n % stride == stride / 2 || (stride > 1 && self.region[*k] == Region::Peak)
        });
        let rows = kept.map(|(_, k)| (self.row[k], self.o[k], self.value[k], self.unit[k]));
        Self::new(self.theta_i_deg, self.i, rows.collect(), cone, self.equal_per_sr)
    }

    /// Whether a tenth of its samples lies well out of the plane of incidence, of which there is one.
    pub fn is_out_of_plane(&self) -> bool {
        let out = self.o.iter().filter(|o| o.y.abs() > OUT_OF_PLANE).count();
        self.i.x.abs() > OUT_OF_PLANE && 10 * out >= self.o.len()
    }

    pub fn seen(&self, surface: &Surface, blur2: f64) -> Vec<f64> {
        let at = |k: usize| surface.seen(self.i, self.o[k], &self.disc[k], blur2);
        (0..self.o.len()).map(at).collect()
    }

    /// Model over table: hemispherical reflectance, and the peak (geometric mean of its samples).
    pub fn ratios(&self, seen: &[f64]) -> (f64, Option<f64>) {
        let sum = self.hemisphere.of(seen);
        let ln: f64 = self.peak.iter().map(|k| self.scaled(seen[*k]) - self.ln[*k]).sum();
        let peak = (!self.peak.is_empty()).then(|| (ln / self.peak.len() as f64).exp());
        (sum / self.hemispherical.max(LEAST), peak)
    }

    /// A value on the scale on which errors are alike.
    fn scaled(&self, value: f64) -> f64 {
        scaled(value, self.equal_per_sr)
    }

    /// How much ln f of a sample moves for an error of 1 on that scale.
    fn relative_error(&self, k: usize) -> f64 {
        self.value[k].hypot(self.equal_per_sr)
    }
}

/// ∫ df/√(f² + b²): the logarithm where errors grow with the value, and linear where they do not, so that values below 0 count as what they are.
fn scaled(value: f64, equal: f64) -> f64 {
    if equal > 0.0 { (value / equal).asinh() } else { value.max(LEAST).ln() }
}

/// For each direction the one on the other side of the mirrored direction, in direction cosines.
fn partners(i: DVec3, o: &[DVec3]) -> Vec<Option<usize>> {
    let of = |o: &DVec3| (o.x + i.x, o.y + i.y);
    let all: Vec<(f64, f64)> = o.iter().map(of).collect();
    all.iter()
        .map(|(x, y)| {
            let far = x.hypot(*y);
            let mut best = (0.25 * far + 1e-3, None);
            for (k, (u, v)) in all.iter().enumerate() {
                // An isotropic surface is the same on both sides of the plane of incidence.
                let d = (u + x).hypot((v + y).abs().min((v - y).abs()));
                if d < best.0 {
                    best = (d, Some(k));
                }
            }
            best.1
        })
        .collect()
}

/// Samples, and how a recipe is judged by them.
pub(super) struct Judge<'a> {
    pub recipe: &'a Recipe,
    pub incidences: Vec<&'a Incidence>,
    /// Weight of each sample, incidence by incidence: 1 except for outliers.
    pub weight: Vec<f64>,
    /// 2 × the variance of the instrument's disc along one axis.
    pub blur2: f64,
    /// The typical misfit of ln f.
    pub misfit: f64,
    cosines: Vec<f64>,
    rays: Rays,
    /// The numbers that were asked for last, and what was seen at them.
    last: RefCell<(Vec<f64>, Vec<f64>)>,
}

/// A direction of light, one of the detector, and how much the light between them counts in a sample.
#[derive(Debug, Clone, Copy)]
struct Ray {
    i: DVec3,
    o: DVec3,
    weight: f64,
}

/// All rays, and what was last evaluated for them: a fit changes one number at a time, on which most of the parts do not depend.
struct Rays {
    all: Vec<Ray>,
    /// The rays of each sample: from its number to the next.
    from: Vec<usize>,
    known: RefCell<Vec<(Factor, Rc<Vec<f64>>)>>,
}

/// A factor of f that depends on directions.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Factor {
    Lobe(Shape),
    Fresnel(Seen),
}

/// Factors that are kept: those of a surface of three lobes and of a number beside each.
const KEPT: usize = 8;

impl Rays {
    fn new(incidences: &[&Incidence]) -> Self {
        let (mut all, mut from) = (Vec::new(), vec![0]);
        for incidence in incidences {
            let i = incidence.i;
            for (o, disc) in incidence.o.iter().zip(&incidence.disc) {
                if disc.is_empty() {
                    all.push(Ray { i, o: *o, weight: 1.0 });
                }
                let through = disc.iter().map(|(d, w)| Ray { i, o: *d, weight: w * d.z / o.z });
                all.extend(through);
                from.push(all.len());
            }
        }
        Self { all, from, known: RefCell::default() }
    }

    fn values(&self, factor: Factor) -> Rc<Vec<f64>> {
        let mut known = self.known.borrow_mut();
        if let Some(at) = known.iter().position(|k| k.0 == factor) {
            // The one that was used last stands first.
            known[..=at].rotate_right(1);
            return Rc::clone(&known[0].1);
        }
        let values = self.all.iter().map(|ray| match factor {
            Factor::Lobe(shape) => ray.weight * shape.value(ray.i, ray.o),
            Factor::Fresnel(seen) => seen.at(ray.i, ray.o),
        });
        let values = Rc::new(values.collect());
        known.truncate(KEPT - 1);
        known.insert(0, (factor, Rc::clone(&values)));
        values
    }

    /// Returns the light of the lobes in each sample, through the instrument's disc; of one of them alone where it is said which.
    fn lobes(&self, surface: &Surface, alone: Option<usize>) -> Vec<f64> {
        let mut sum = vec![0.0; self.all.len()];
        let lobes = surface.shapes().enumerate().filter(|(k, _)| alone.is_none_or(|a| a == *k));
        for (_, (shape, scale)) in lobes {
            let values = self.values(Factor::Lobe(shape));
            sum.iter_mut().zip(values.iter()).for_each(|(s, v)| *s += scale * v);
        }
        if !sum.is_empty() && surface.shapes().next().is_some() {
            let fresnel = self.values(Factor::Fresnel(surface.fresnel()));
            sum.iter_mut().zip(fresnel.iter()).for_each(|(s, f)| *s *= f);
        }
        self.from.windows(2).map(|w| sum[w[0]..w[1]].iter().sum()).collect()
    }
}

/// Where a search ended.
#[derive(Debug, Clone)]
pub(super) struct Found {
    /// ln of the numbers.
    pub x: Vec<f64>,
    /// The cost over the number of samples.
    pub cost: f64,
}

impl<'a> Judge<'a> {
    pub fn new(
        recipe: &'a Recipe,
        incidences: Vec<&'a Incidence>,
        cone: &Cone,
        misfit: f64,
    ) -> Self {
        let count = incidences.iter().map(|i| i.ln.len()).sum();
        let radius = cone.radius_rad();
        let mut cosines = COSINES.to_vec();
        cosines.extend(incidences.iter().map(|i| i.i.z));
        Self {
            rays: Rays::new(&incidences),
            last: RefCell::default(),
            recipe,
            incidences,
            weight: vec![1.0; count],
            blur2: 0.5 * radius * radius,
            misfit,
            cosines,
        }
    }

    pub fn count(&self) -> usize {
        self.weight.len()
    }

    pub fn surface(&self, x: &[f64]) -> Surface {
        let p: Vec<f64> = x.iter().map(|x| x.exp()).collect();
        self.recipe.with(&p)
    }

    pub fn bounds(&self) -> Vec<Bounded> {
        let ranges = self.recipe.ranges();
        let bounded = |r: &super::model::Range| Bounded {
            low: r.least.ln(),
            high: r.most.ln(),
            step: 1e-6,
            fixed: false,
        };
        ranges.iter().map(bounded).collect()
    }

    /// f as the instrument sees it, of all samples: as [`Incidence::seen`].
    fn seen(&self, surface: &Surface) -> Vec<f64> {
        let mut seen = self.rays.lobes(surface, None);
        let directions = self.incidences.iter().flat_map(|i| i.o.iter().map(|o| (i.i, *o)));
        for (seen, (i, o)) in seen.iter_mut().zip(directions) {
            *seen += surface.others(i, o, self.blur2);
        }
        seen
    }

    /// ln f measured − ln f seen, over its unit, of all samples.
    pub fn samples(&self, surface: &Surface) -> Vec<f64> {
        let mut all = Vec::with_capacity(self.count());
        let seen = self.seen(surface);
        let mut seen = seen.as_slice();
        for incidence in &self.incidences {
            let (here, rest) = seen.split_at(incidence.ln.len());
            seen = rest;
            for (k, seen) in here.iter().enumerate() {
                all.push((incidence.ln[k] - incidence.scaled(*seen)) / incidence.unit[k]);
            }
        }
        all
    }

    fn rows(&self, x: &[f64]) -> DVector<f64> {
        let surface = self.surface(x);
        let count = self.count() as f64;
        let mut rows = Vec::with_capacity(self.count() + 3 * self.incidences.len() + 16);
        let mut at = 0;
        let mut figures = Vec::new();
        let all_seen = self.seen(&surface);
        for incidence in &self.incidences {
            let seen = &all_seen[at..at + incidence.ln.len()];
            for (k, seen) in seen.iter().enumerate() {
                let r = (incidence.ln[k] - incidence.scaled(*seen)) / incidence.unit[k];
                rows.push(r * self.weight[at].sqrt());
                at += 1;
            }
            let (hemispherical, peak) = incidence.ratios(seen);
            let weight = count.sqrt() * self.misfit * incidence.trust;
            figures.push(-HEMISPHERICAL * weight * hemispherical.max(LEAST).ln());
            if let Some(peak) = peak {
                figures.push(-PEAK * weight * peak.max(LEAST).ln());
            }
        }
        rows.extend(figures);
        let energy = ENERGY * count.sqrt();
        match surface.albedos(&self.cosines) {
            None => rows.extend(std::iter::repeat_n(0.0, self.cosines.len())),
            Some(all) => {
                rows.extend(all.iter().map(|a| energy * (a / MOST_ALBEDO).max(1.0).ln()));
            }
        }
        self.last.replace((x.to_vec(), all_seen));
        DVector::from_vec(rows)
    }

    /// Returns the derivative of [`Self::rows`] by the logarithm of what stands before a part: the part's own light in what is seen. None of other numbers, and where energy holds.
    fn by_strength(&self, x: &[f64], number: usize) -> Option<DVector<f64>> {
        let surface = self.surface(x);
        let range = *self.recipe.ranges().get(number)?;
        if !matches!(range.key, "share" | "mirror_share" | "diffuse") || surface.is_bright() {
            return None;
        }
        if self.last.borrow().0 != x {
            let seen = self.seen(&surface);
            self.last.replace((x.to_vec(), seen));
        }
        let last = self.last.borrow();
        let directions = || self.incidences.iter().flat_map(|i| i.o.iter().map(|o| (i.i, *o)));
        let part: Vec<f64> = match range.key {
            "share" => self.rays.lobes(&surface, range.lobe.checked_sub(1)),
            "diffuse" => directions().map(|(i, o)| surface.broad(i.z, o.z)).collect(),
            _ => directions().map(|(i, o)| surface.mirrored(i, o, self.blur2)).collect(),
        };
        let count = self.count() as f64;
        let (mut rows, mut figures, mut at) = (Vec::new(), Vec::new(), 0);
        for incidence in &self.incidences {
            let n = incidence.ln.len();
            let (seen, part) = (&last.1[at..at + n], &part[at..at + n]);
            let moved = |k: usize| part[k] / seen[k].hypot(incidence.equal_per_sr).max(LEAST);
            for k in 0..n {
                rows.push(-moved(k) / incidence.unit[k] * self.weight[at + k].sqrt());
            }
            let weight = count.sqrt() * self.misfit * incidence.trust;
            let of = |values: &[f64]| incidence.hemisphere.of(values);
            figures.push(-HEMISPHERICAL * weight * of(part) / of(seen).max(LEAST));
            if !incidence.peak.is_empty() {
                let sum: f64 = incidence.peak.iter().map(|k| moved(*k)).sum();
                figures.push(-PEAK * weight * sum / incidence.peak.len() as f64);
            }
            at += n;
        }
        rows.extend(figures);
        rows.extend(std::iter::repeat_n(0.0, self.cosines.len()));
        Some(DVector::from_vec(rows))
    }

    /// Returns the cost of an incidence's hemispherical reflectance and peak, to be added to the mean square of ln f.
    pub fn figures(&self, incidence: &Incidence, hemispherical: f64, peak: Option<f64>) -> f64 {
        const MOST_LN: f64 = 4.0;
        let ln = |ratio: f64| ratio.max(1e-9).ln().clamp(-MOST_LN, MOST_LN);
        let weight = self.misfit * incidence.trust;
        (HEMISPHERICAL * weight * ln(hemispherical)).powi(2)
            + peak.map_or(0.0, |p| (PEAK * weight * ln(p)).powi(2))
    }

    /// Goes down from a start, in so many steps or until one gains less than that part of the cost.
    pub fn solve(&mut self, start: &[f64], (steps, gain): (usize, f64)) -> Found {
        let bounds = self.bounds();
        let limits = Limits { steps, gain, step: 1e-8 };
        let count = self.count() as f64;
        let Ok(Minimum { place, .. }) =
            minimise_residuals(self, &bounds, start, Differences::OneSided, &limits);
        Found { cost: place.chi2() / count, x: place.at }
    }

    /// Gives less weight to what lies apart on one side of the mirrored direction alone.
    pub fn weigh(&mut self, x: &[f64]) {
        let r = self.samples(&self.surface(x));
        let mut differences = Vec::new();
        let mut from = 0;
        for incidence in &self.incidences {
            for (k, partner) in incidence.partner.iter().enumerate() {
                let other = partner.map(|p| r[from + p]);
                differences.push(other.map(|other| r[from + k] - other));
            }
            from += incidence.ln.len();
        }
        let apart: Vec<f64> = differences.iter().flatten().copied().filter(|d| *d != 0.0).collect();
        let Some(width) = robust_sigma(apart).filter(|w| *w > 0.0) else { return };
        let width = width.max(1e-6);
        for (k, difference) in differences.iter().enumerate() {
            let Some(d) = difference else { continue };
            // Of the two the one that lies farther off: r and r − d.
            let is_it = r[k].abs() > (r[k] - d).abs();
            let far = d.abs() / width;
            self.weight[k] = if is_it && far > OUTLYING { OUTLYING / far } else { 1.0 };
        }
    }

    /// Standard deviations of the variables for independent errors of ln f, from the curvature and from how each sample's error moves the minimum (sandwich), where the
    /// peak's and the hemispherical figures move with the samples that they are made of. `independent` is as how many samples they count.
    pub fn sigmas(&mut self, x: &[f64], independent: f64) -> Vec<Option<f64>> {
        let bounds = self.bounds();
        let edge = 1e-6;
        let free: Vec<usize> = (0..x.len())
            .filter(|j| x[*j] > bounds[*j].low + edge && x[*j] < bounds[*j].high - edge)
            .collect();
        let mut sigma = vec![None; x.len()];
        let base = self.rows(x);
        let n = self.count();
        let step = 1e-5;
        let mut jacobian = DMatrix::zeros(base.len(), free.len());
        for (a, j) in free.iter().enumerate() {
            let beside = |step: f64| {
                let mut x = x.to_vec();
                x[*j] += step;
                self.rows(&x)
            };
            jacobian.set_column(a, &((beside(step) - beside(-step)) / (2.0 * step)));
        }
        // How rows move with each sample's error ε of ln f (in units): their own √w, the hemispherical share, the peak.
        let surface = self.surface(x);
        let mut moved = DMatrix::zeros(n, free.len());
        let (mut at, mut figure) = (0, n);
        for incidence in &self.incidences {
            let count = incidence.ln.len();
            let root = (n as f64).sqrt() * self.misfit * incidence.trust;
            for k in 0..count {
                let own = jacobian.row(at + k) * self.weight[at + k].sqrt();
                let share = incidence.hemisphere.weights[k] * incidence.relative_error(k)
                    / incidence.hemispherical;
                let of_all =
                    jacobian.row(figure) * (HEMISPHERICAL * root * share * incidence.unit[k]);
                moved.set_row(at + k, &(own + of_all));
            }
            figure += 1;
            for k in &incidence.peak {
                let share = incidence.unit[*k] / incidence.peak.len() as f64;
                let of_peak = jacobian.row(figure) * (PEAK * root * share);
                let row = moved.row(at + k) + of_peak;
                moved.set_row(at + k, &row);
            }
            figure += usize::from(!incidence.peak.is_empty());
            at += count;
        }
        let residual = self.samples(&surface);
        let weighed: f64 = self.weight.iter().sum();
        let squares: f64 = residual.iter().zip(&self.weight).map(|(r, w)| w * r * r).sum();
        let variance = squares / (weighed - free.len() as f64).max(1.0);
        let hessian = jacobian.tr_mul(&jacobian);
        let scale: Vec<f64> = (0..free.len()).map(|a| hessian[(a, a)].sqrt()).collect();
        if scale.iter().any(|s| s.is_nan() || *s <= 0.0) {
            return sigma;
        }
        let unit =
            DMatrix::from_fn(free.len(), free.len(), |a, b| hessian[(a, b)] / scale[a] / scale[b]);
        let Some(inverse) = unit.cholesky().map(|c| c.inverse()) else { return sigma };
        let inverse =
            DMatrix::from_fn(free.len(), free.len(), |a, b| inverse[(a, b)] / scale[a] / scale[b]);
        let covariance = &inverse
            * moved.tr_mul(&moved)
            * &inverse
            * (variance * n as f64 / independent.max(1.0));
        for (a, j) in free.iter().enumerate() {
            let s = covariance[(a, a)].sqrt();
            // Beyond a factor of e⁵ either way nothing is known.
            sigma[*j] = Some(s).filter(|s| s.is_finite() && *s < 5.0);
        }
        sigma
    }
}

impl Residuals for Judge<'_> {
    type Error = Infallible;

    fn residuals(&mut self, at: &[f64]) -> Result<DVector<f64>, Infallible> {
        Ok(self.rows(at))
    }

    fn derivative(
        &mut self,
        at: &[f64],
        number: usize,
    ) -> Result<Option<DVector<f64>>, Infallible> {
        Ok(self.by_strength(at, number))
    }
}
