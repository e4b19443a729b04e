//! Tables of measured BRDF values: directions in degrees, values in sr⁻¹, as a goniometer gives them.
//!
//! Between the measured directions of incidence the values are taken at the same bisector: that of light and outgoing direction, which keeps a lobe where it
//! is; and their logarithms are interpolated, so that nine decades do no harm (where a value is 0, the values). For each incidence the outgoing directions may
//! lie in the plane of incidence, on a grid about the normal or the mirrored ray, or anywhere. Light and detector are swapped, too, and of the two ways the one counts more whose
//! incidence was measured nearer by: so reciprocity tells what was not measured, a measured value stays, and what was measured both ways is averaged
//! (geometrically). How far the two differ is in [`Material::notes`]. A table that knows but one azimuth of incidence is taken as isotropic.
//!
//! Geometries outside what was measured are extrapolated from the nearest, and said to be ([`Material::covers`]). For a table in the plane of incidence that is
//! all of what is out of that plane: there, the value is that in the plane with the same tilt of the bisector and the same angle between light and bisector.
//! For a table with a tangent whose light came from a half of the azimuths, the other half is taken to be the same turned by 180°; of one quarter, the next is taken to be its mirror image;
//! wider gaps between azimuths are extrapolated. Directions with several values count once, with the median.
//!
//! The error of interpolation is measured ([`Material::ln_doubt`]): each incidence but the first and the last is left out in turn, and so is each value between its neighbours; that of extrapolation
//! beyond the first and the last by leaving these out, and taking it to grow with the angle and with the logarithm of its cosine, as masking and Fresnel's reflectance do. A lobe that is narrower
//! than the directions are apart is missed by all of them: where values still rise as a power of the distance at the direction nearest to the mirrored ray, the doubt there is that of a lobe that
//! reflects all light.

mod doubt;
mod foreign;
mod read;
mod rows;
mod slice;

pub use foreign::{Exchange, ForeignRows};
pub use read::read;

use super::measured::hats;
use super::sampling::{Mixture, Proposal};
use super::scatter::{Effort, Scatter};
use super::{Distribution, Lobe, Masking, Material, MaterialError, uncovered};
use doubt::Doubts;
use glam::DVec3;
use slice::{Sink, Slice, Stencil, Sum};
use std::f64::consts::{FRAC_PI_2, TAU};
use std::sync::Arc;

/// Directions closer than this are the same, degrees.
const SAME_DEG: f64 = 1e-4;

/// One row of a table.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// The light's angle from the normal, degrees; where it is negative, on the other side.
    pub theta_i_deg: f64,
    /// Azimuth of the incident direction, degrees.
    pub phi_i_deg: f64,
    /// The outgoing direction's angle from the normal, degrees.
    pub theta_o_deg: f64,
    /// Azimuth of the outgoing direction, degrees: that of the mirrored light is φ_i + 180°.
    pub phi_o_deg: f64,
    /// The BRDF, sr⁻¹, one value for each wavelength.
    pub brdf_per_sr: Vec<f64>,
}

/// The material of a table. Values at or below `floor_per_sr` are no measurements (a detector's floor, a stand-in) and left out; so are directions at the horizon.
///
/// # Errors
/// Values that are no number or negative, angles out of range, rows of different lengths, too few rows, azimuths of incidence that are not the same for all
/// elevations.
pub fn material(
    name: impl Into<String>,
    wavelength_nm: &[f64],
    rows: &[Row],
    floor_per_sr: Option<f64>,
) -> Result<Material, MaterialError> {
    let name = name.into();
    let (table, mut notes) = Table::new(&name, wavelength_nm.len(), rows, floor_per_sr)?;
    if !(wavelength_nm.windows(2).all(|w| w[0] < w[1]) && wavelength_nm.iter().all(|w| *w > 1.0)) {
        let (what, found) = (name, format!("the wavelengths {wavelength_nm:?} nm"));
        let expected = "wavelengths that increase".to_owned();
        return Err(MaterialError::Data { what, found, expected });
    }
    notes.push(table.reproduction());
    let mut spectra = hats(wavelength_nm)?;
    spectra.push(uncovered()?);
    let alpha = (0.5 * table.width_rad).tan().clamp(1e-4, 1.0);
    let lobe = Lobe::isotropic(Distribution::Ggx, alpha, Masking::Separable)?;
    let ways = vec![(0.6, Proposal::Facets(lobe)), (0.4, Proposal::Cosine)];
    let mut made = Material::of_law(name, spectra, Arc::new(table), Mixture::new(ways), true)?;
    made.notes.splice(0..0, notes);
    Ok(made)
}

/// The begin of a note on a table whose directions are too far apart for its peak.
pub const NOT_RESOLVED: &str = "peak not resolved";
/// Gaps between azimuths of incidence wider than this many usual ones were not measured.
const WIDE: f64 = 1.5;
/// A geometry this near a measured incidence was measured, radians.
const MEASURED_RAD: f64 = 1.75e-3;
/// An incidence beyond the last measured one is this many times as far as one between two.
const BEYOND_ENDS: f64 = 2.0;
/// Largest angle from the normal that stands for what lies beyond, radians (89.5°).
const GRAZING_RAD: f64 = 1.562;

#[derive(Debug)]
struct Table {
    wavelengths: usize,
    isotropic: bool,
    /// Elevations of incidence, radians, and azimuths (one where isotropic).
    theta: Vec<f64>,
    phi: Vec<f64>,
    /// By azimuth, then elevation.
    slices: Vec<Slice>,
    /// By row, then wavelength.
    value: Vec<f64>,
    log: Vec<f64>,
    width_rad: f64,
    /// Whether all of it lies in the plane of incidence.
    flat: bool,
    /// The directions of each row.
    directions: Vec<(DVec3, DVec3)>,
    /// Rows that were measured: symmetry gave the others.
    measured: usize,
    /// The usual distance of azimuths of incidence, radians.
    phi_step: f64,
    doubts: Doubts,
}

/// The rows around a geometry.
struct Around {
    stencil: Stencil,
    /// Whether it lies between rows.
    covered: bool,
    /// How far it is from a measured incidence, radians: 0 at one.
    distance: f64,
    /// The distance beyond the first or the last of them, in [`steepness`]; 0 between them.
    past: f64,
    /// The detector's distance from the directions that were measured there, radians.
    outside: f64,
}

/// A way through the table: how far its incidence is from measured ones, radians, and whether it lies between rows.
#[derive(Debug, Clone, Copy)]
struct Way {
    distance: f64,
    covered: bool,
    /// The distance of its incidence beyond the first or the last, in [`steepness`].
    past: f64,
    /// The detector's distance from the directions that were measured, radians.
    outside: f64,
}

impl Way {
    /// Adds a slice with its share, by how far it was gone beyond its rows.
    fn add(&mut self, share: f64, beyond: f64) {
        self.covered &= beyond < 1e-6;
        self.distance += share * beyond;
        self.outside += share * beyond;
    }
}

/// The coordinate in which an extrapolated ln f changes evenly with the light's angle from the normal, radians: masking and Fresnel's reflectance change with powers of the cosine, lobes with
/// the angle.
fn steepness(theta: f64) -> f64 {
    theta - theta.min(GRAZING_RAD).cos().ln()
}

/// Measured elevations around one, and the part of the way between them.
struct Between {
    low: usize,
    high: usize,
    part: f64,
    way: Way,
}

/// Shares of the way from the light and of that from the detector.
fn shares(there: Way, back: Way) -> [f64; 2] {
    let weight = |distance: f64| 1.0 / (MEASURED_RAD * MEASURED_RAD + distance * distance);
    let (a, b) = (weight(there.distance), weight(back.distance));
    // What was not measured says nothing against what was.
    let (a, b) = match [there.covered, back.covered] {
        [true, false] => (a, 1e-3 * b),
        [false, true] => (1e-3 * a, b),
        _ => (a, b),
    };
    [a / (a + b), b / (a + b)]
}

/// Tilt of the bisector and half the angle between light and detector, radians, and whether they lie in one plane with the normal.
fn bisected(i: DVec3, o: DVec3) -> Option<(f64, f64, bool)> {
    let h = i + o;
    let (length, apart) = (h.length(), (i - o).length());
    if length < 1e-9 {
        return None;
    }
    let tilt = (h.x * h.x + h.y * h.y).sqrt().atan2(h.z);
    let half = apart.atan2(length);
    let across = i.x * o.y - i.y * o.x;
    Some((tilt, half, across.abs() < 2e-3 * i.z.max(o.z).max(0.1)))
}

/// A row with angles that are none negative, radians.
struct Placed {
    theta_i: f64,
    phi_i: f64,
    theta_o: f64,
    phi_o: f64,
}

impl Table {
    fn new(
        name: &str,
        wavelengths: usize,
        rows: &[Row],
        floor: Option<f64>,
    ) -> Result<(Self, Vec<String>), MaterialError> {
        let data = |found: String, expected: &str| MaterialError::Data {
            what: name.to_owned(),
            found,
            expected: expected.to_owned(),
        };
        let (mut placed, mut value) = (Vec::new(), Vec::new());
        let (mut below, mut horizon) = (0, 0);
        for (k, row) in rows.iter().enumerate() {
            if row.brdf_per_sr.len() != wavelengths || wavelengths == 0 {
                let found = format!("{} values in row {}", row.brdf_per_sr.len(), k + 1);
                return Err(data(found, "one for each wavelength"));
            }
            let angles = [row.theta_i_deg, row.phi_i_deg, row.theta_o_deg, row.phi_o_deg];
            let thetas = [row.theta_i_deg, row.theta_o_deg];
            if angles.iter().any(|a| !a.is_finite()) || thetas.iter().any(|t| t.abs() > 90.0) {
                let found = format!("the angles {angles:?}° in row {}", k + 1);
                return Err(data(found, "angles from the normal up to 90°"));
            }
            if row.brdf_per_sr.iter().any(|v| floor.is_some_and(|f| *v <= f)) {
                below += 1;
                continue;
            }
            if let Some(v) = row.brdf_per_sr.iter().find(|v| !(v.is_finite() && **v >= 0.0)) {
                let found = format!("{v} sr⁻¹ in row {}", k + 1);
                return Err(data(found, "0 or above, or a floor_per_sr below which it is noise"));
            }
            if thetas.iter().any(|t| t.abs() >= 90.0 - SAME_DEG) {
                horizon += 1;
                continue;
            }
            placed.push(Placed::of(row));
            value.extend_from_slice(&row.brdf_per_sr);
        }
        let mut notes = Vec::new();
        if below + horizon > 0 {
            notes.push(format!(
                "{below} rows at or below the floor and {horizon} at the horizon are left out, of {}",
                rows.len()
            ));
        }
        let distinct = |values: Vec<f64>| {
            let mut values = values;
            values.sort_by(f64::total_cmp);
            values.dedup_by(|a, b| (*a - *b).abs() < SAME_DEG.to_radians());
            values
        };
        let theta = distinct(placed.iter().map(|p| p.theta_i).collect());
        let tilted = placed.iter().filter(|p| p.theta_i > SAME_DEG.to_radians());
        let mut phi = distinct(tilted.map(|p| p.phi_i).collect());
        let isotropic = phi.len() <= 1;
        if isotropic {
            phi = vec![0.0];
        }
        let (mut rows, several) = rows::once(placed, &value, wavelengths, isotropic);
        notes.extend(several);
        let measured = rows.placed.len();
        if let Some(assumed) = rows::complete(&mut rows, &phi, wavelengths) {
            notes.push(assumed);
            let tilted = rows.placed.iter().filter(|p| p.theta_i > SAME_DEG.to_radians());
            phi = distinct(tilted.map(|p| p.phi_i).collect());
        }
        let rows::Rows { placed, mut value, ln_scatter } = rows;
        let mut mixed = slice::Mixed::new();
        let slices = slices(&placed, &theta, &phi, isotropic, &mut mixed)
            .ok_or_else(|| data("too few rows".to_owned(), "3 or more for each direction of incidence, and for each elevation of incidence the same azimuths"))?;
        let directions = placed.iter().map(|p| p.directions(isotropic)).collect();
        let mut log: Vec<f64> = value.iter().map(|v: &f64| v.ln()).collect();
        // Values at nodes stand behind the rows'.
        for stencil in &mixed {
            for k in 0..wavelengths {
                let (ln, plain) = mean(stencil, &log, &value, wavelengths, k);
                log.push(ln);
                value.push(plain);
            }
        }
        let mut made = Self {
            wavelengths,
            isotropic,
            theta,
            flat: isotropic && slices.iter().all(Slice::is_plane),
            slices,
            value,
            log,
            width_rad: FRAC_PI_2,
            directions,
            measured,
            phi_step: rows::step(&phi),
            phi,
            doubts: Doubts::default(),
        };
        made.width_rad = made.width();
        made.doubts = Doubts::of(&made, &ln_scatter);
        notes.extend(made.doubts.not_resolved(&made));
        if made.flat {
            let note = "all directions lie in the plane of incidence: values out of it are extrapolated, and with them the hemispherical reflectance, which may be a third too large";
            notes.push(note.to_owned());
        }
        notes.extend(mirrored_side(
            made.directions
                .iter()
                .enumerate()
                .map(|(k, (i, o))| (*i, *o, made.value[k * wavelengths])),
        ));
        Ok((made, notes))
    }

    /// The angle from the largest value of a direction of incidence to the nearest that is less than 1/e of it, the least of all.
    fn width(&self) -> f64 {
        let mut least = FRAC_PI_2;
        let of = |k: usize| self.value[k * self.wavelengths];
        for theta in &self.theta {
            let same = |k: &usize| (self.directions[*k].0.z - theta.cos()).abs() < 1e-6;
            let rows: Vec<usize> = (0..self.directions.len()).filter(same).collect();
            let Some(peak) = rows.iter().copied().max_by(|a, b| of(*a).total_cmp(&of(*b))) else {
                continue;
            };
            for k in rows {
                if of(k) < of(peak) / std::f64::consts::E {
                    least = least.min(self.directions[k].1.angle_between(self.directions[peak].1));
                }
            }
        }
        least
    }

    /// The rows around a geometry, from the slices but one elevation that is left out.
    fn around(&self, i: DVec3, o: DVec3, without: Option<usize>) -> Around {
        let in_plane = if self.flat { self.in_plane(i, o) } else { None };
        let (i, o) = in_plane.map_or((i, o), |(i, o, _)| (i, o));
        let h = (i + o).normalize();
        let mut stencil = Stencil::new();
        let there = self.one_way(i, h, without, &mut stencil);
        let first = stencil.len();
        let back = self.one_way(o, h, without, &mut stencil);
        let shares = shares(there, back);
        let mut both = Stencil::new();
        for (k, (row, w)) in stencil.parts().iter().enumerate() {
            both.push(*row, w * shares[usize::from(k >= first)]);
        }
        let covered = (there.covered || back.covered) && in_plane.is_none_or(|(.., flat)| flat);
        let near = if there.distance <= back.distance { there } else { back };
        Around {
            stencil: both,
            covered,
            distance: near.distance,
            past: near.past,
            outside: near.outside,
        }
    }

    /// ln f of a table of one wavelength, and whether it lies between rows: as [`Self::around`] has it, without a list of rows. `None` where a value is 0.
    fn quick(&self, i: DVec3, o: DVec3) -> Option<(f64, bool)> {
        let new = || Sum { of: &self.log, sum: 0.0 };
        let (mut a, mut b) = (new(), new());
        let (there, back, flat) = if self.flat {
            let (tilt, half, flat) = bisected(i, o)?;
            // In the plane: signed angles from the normal, and the tilt towards whichever is the light.
            let [light, seen] =
                [tilt - half, tilt + half].map(|a| a.clamp(-GRAZING_RAD, GRAZING_RAD));
            let tilt = 0.5 * (light + seen);
            let there = self.one_flat_way(light.abs(), tilt.copysign(tilt * light), &mut a);
            let back = self.one_flat_way(seen.abs(), tilt.copysign(tilt * seen), &mut b);
            (there, back, flat)
        } else {
            let h = (i + o).normalize();
            (self.one_way(i, h, None, &mut a), self.one_way(o, h, None, &mut b), true)
        };
        let [x, y] = shares(there, back);
        // A share may be 0 where the other way is as near as can be.
        let ln = x * a.sum + y * b.sum;
        ln.is_finite().then_some((ln, (there.covered || back.covered) && flat))
    }

    /// Light and detector in the plane of incidence with the same tilt of the bisector and the same angle to it, and whether they were there before.
    fn in_plane(&self, i: DVec3, o: DVec3) -> Option<(DVec3, DVec3, bool)> {
        let (tilt, half, flat) = bisected(i, o)?;
        // Out of the plane light or detector would be below the horizon of the plane's.
        let place = |a: f64| {
            let (sin, cos) = a.clamp(-GRAZING_RAD, GRAZING_RAD).sin_cos();
            DVec3::new(sin, 0.0, cos)
        };
        Some((place(tilt - half), place(tilt + half), flat))
    }

    /// Adds the rows for light from `i` with the bisector `h`.
    fn one_way(&self, i: DVec3, h: DVec3, without: Option<usize>, sink: &mut impl Sink) -> Way {
        let (i, h) = if self.isotropic { turned(i, h) } else { (i, h) };
        let theta = elevation(i);
        let rows = self.theta.len();
        let Between { low, high, part, mut way } = self.between(theta, without);
        let (k, next, f) = self.azimuth(i);
        if self.phi.len() > 1 {
            let gap = (self.phi[next] - self.phi[k]).rem_euclid(TAU);
            let apart = f.min(1.0 - f) * gap * i.x.hypot(i.y);
            way.covered &= gap <= WIDE * self.phi_step || apart < SAME_DEG.to_radians();
            way.distance = way.distance.hypot(apart);
        }
        for (k, around) in [(k, 1.0 - f), (next, f)] {
            for (j, up) in [(low, 1.0 - part), (high, part)] {
                let share = around * up;
                if share > 1e-12 {
                    way.add(share, self.slices[k * rows + j].add(h, share, sink));
                }
            }
        }
        way
    }

    /// [`Self::one_way`] of a table in the plane of incidence: by the light's angle from the normal and the bisector's tilt towards it, radians.
    fn one_flat_way(&self, theta: f64, tilt: f64, sink: &mut impl Sink) -> Way {
        let Between { low, high, part, mut way } = self.between(theta, None);
        for (j, share) in [(low, 1.0 - part), (high, part)] {
            if share > 1e-12 {
                way.add(share, self.slices[j].add_at_tilt(tilt, share, sink));
            }
        }
        way
    }

    /// Between which measured elevations one lies.
    fn between(&self, theta: f64, without: Option<usize>) -> Between {
        let (low, high) = self.beside(theta, without);
        let (part, distance) = if low == high {
            (0.0, (theta - self.theta[low]).abs())
        } else {
            let part = (theta - self.theta[low]) / (self.theta[high] - self.theta[low]);
            let apart = (theta - self.theta[low]).abs().min((theta - self.theta[high]).abs());
            (part.clamp(0.0, 1.0), apart)
        };
        let covered = distance < SAME_DEG.to_radians()
            || (theta >= self.theta[low] && theta <= self.theta[high] && low != high);
        let distance = if covered { distance } else { BEYOND_ENDS * distance };
        let past =
            if covered { 0.0 } else { (steepness(theta) - steepness(self.theta[low])).abs() };
        Between { low, high, part, way: Way { distance, covered, past, outside: 0.0 } }
    }

    /// The elevations below and above one, but that left out; the same twice beyond the ends.
    fn beside(&self, theta: f64, without: Option<usize>) -> (usize, usize) {
        let last = self.theta.len() - 1;
        let up = self.theta.partition_point(|v| *v <= theta);
        let keep = |k: &usize| Some(*k) != without;
        let low = (0..up).rev().find(keep);
        let high = (up..=last).find(keep);
        match (low, high) {
            (Some(low), Some(high)) => (low, high),
            (Some(one), None) | (None, Some(one)) => (one, one),
            (None, None) => (last, last),
        }
    }

    /// The azimuth before that of `i`, the one after, and how far it is between.
    fn azimuth(&self, i: DVec3) -> (usize, usize, f64) {
        let last = self.phi.len() - 1;
        if last == 0 {
            return (0, 0, 0.0);
        }
        let phi = (i.y.atan2(i.x) - self.phi[0]).rem_euclid(TAU) + self.phi[0];
        if phi > self.phi[last] {
            let gap = TAU - (self.phi[last] - self.phi[0]);
            return (last, 0, (phi - self.phi[last]) / gap);
        }
        let k = self.phi.partition_point(|v| *v <= phi).clamp(1, last) - 1;
        (k, k + 1, (phi - self.phi[k]) / (self.phi[k + 1] - self.phi[k]))
    }

    /// ln f at a stencil.
    fn ln_at(&self, stencil: &Stencil, wavelength: usize) -> f64 {
        mean(stencil, &self.log, &self.value, self.wavelengths, wavelength).0
    }

    /// How well the table is met at its own rows.
    fn reproduction(&self) -> String {
        let (mut square, mut most, mut count) = (0.0_f64, 0.0_f64, 0.0_f64);
        for (row, (i, o)) in self.directions.iter().enumerate() {
            let truth = self.value[row * self.wavelengths];
            let mut sum = vec![0.0; self.wavelengths];
            self.add_weights(*i, *o, 1.0, &mut sum);
            if truth > 0.0 && sum[0] > 0.0 {
                let ratio = (sum[0] / truth).ln().abs();
                square += ratio * ratio;
                most = most.max(ratio);
                count += 1.0;
            }
        }
        let typical = if count > 0.0 { (square / count).sqrt() } else { 0.0 };
        // Beside values of next to nothing a factor says no more than that.
        let most = match most.exp() {
            factor if factor < MOST_FACTOR => format!("at most by a factor of {factor:.2}"),
            _ => format!(
                "and where a value is next to nothing beside that of the swapped direction by a factor of more than {MOST_FACTOR:.0e}: leave such values out, or write 0"
            ),
        };
        match 100.0 * typical.exp_m1() {
            percent if percent < MOST_FACTOR => {
                format!("made reciprocal, its values change by {percent:.1} % (rms), {most}")
            }
            _ => format!("made reciprocal, its values change by orders of magnitude, {most}"),
        }
    }
}

/// A factor beyond which only that is said.
const MOST_FACTOR: f64 = 1e6;

/// Mean of ln f and of f over a stencil; where a value is 0 the logarithm is that of the mean.
fn mean(
    stencil: &Stencil,
    log: &[f64],
    value: &[f64],
    wavelengths: usize,
    wavelength: usize,
) -> (f64, f64) {
    let of = |list: &[f64]| -> f64 {
        stencil.parts().iter().map(|(k, w)| w * list[k * wavelengths + wavelength]).sum()
    };
    let ln = of(log);
    if ln == f64::NEG_INFINITY {
        let plain = of(value);
        (plain.ln(), plain)
    } else {
        (ln, ln.exp())
    }
}

impl Scatter for Table {
    fn add_weights(&self, i: DVec3, o: DVec3, scale: f64, sum: &mut [f64]) {
        self.add_and_cover(i, o, scale, sum);
    }

    fn add_and_cover(&self, i: DVec3, o: DVec3, scale: f64, sum: &mut [f64]) -> bool {
        if self.wavelengths == 1
            && let Some((ln, covered)) = self.quick(i, o)
        {
            sum[0] += scale * ln.exp();
            return covered;
        }
        let around = self.around(i, o, None);
        for (k, sum) in sum[..self.wavelengths].iter_mut().enumerate() {
            *sum += scale * self.ln_at(&around.stencil, k).exp();
        }
        around.covered
    }

    fn ln_doubt(&self, i: DVec3, o: DVec3) -> Option<f64> {
        Some(self.doubts.at(self, i, o))
    }

    fn is_isotropic(&self) -> bool {
        self.isotropic
    }

    fn describe(&self) -> String {
        format!(
            "table of {} geometries, {} directions of incidence, {} wavelength{}",
            self.measured,
            self.slices.len(),
            self.wavelengths,
            if self.wavelengths == 1 { "" } else { "s" }
        )
    }

    fn lobe_width_rad(&self) -> f64 {
        self.width_rad
    }

    fn effort(&self) -> Effort {
        // Pieces that are linear or bilinear have kinks everywhere, and a real peak may be a degree wide at nine decades.
        Effort { tolerance: 1e-3, most: 60_000 }
    }

    fn grain(&self) -> f64 {
        1e-3
    }

    fn has_gaps(&self) -> bool {
        true
    }

    fn covers(&self, i: DVec3, o: DVec3) -> bool {
        self.around(i, o, None).covered
    }
}

impl Placed {
    fn of(row: &Row) -> Self {
        let side = |theta: f64, phi: f64| {
            let phi = if theta < 0.0 { phi + 180.0 } else { phi };
            (theta.abs().to_radians(), phi.to_radians().rem_euclid(TAU))
        };
        let (theta_i, phi_i) = side(row.theta_i_deg, row.phi_i_deg);
        let (theta_o, phi_o) = side(row.theta_o_deg, row.phi_o_deg);
        Self { theta_i, phi_i, theta_o, phi_o }
    }

    /// Incident and outgoing azimuth within the table.
    fn azimuths(&self, isotropic: bool) -> (f64, f64) {
        if !isotropic {
            return (self.phi_i, self.phi_o);
        }
        let turn = (self.phi_o - self.phi_i).rem_euclid(TAU);
        (0.0, turn.min(TAU - turn))
    }

    fn directions(&self, isotropic: bool) -> (DVec3, DVec3) {
        let (phi_i, phi_o) = self.azimuths(isotropic);
        (spherical(self.theta_i, phi_i), spherical(self.theta_o, phi_o))
    }
}

/// For each azimuth and elevation of incidence; `None` where one lacks rows.
fn slices(
    placed: &[Placed],
    theta: &[f64],
    phi: &[f64],
    isotropic: bool,
    mixed: &mut slice::Mixed,
) -> Option<Vec<Slice>> {
    let same = |a: f64, b: f64| (a - b).abs() < 2.0 * SAME_DEG.to_radians();
    let mut made = Vec::new();
    for phi in phi {
        for theta in theta {
            let rows: Vec<(usize, f64, f64)> = placed
                .iter()
                .enumerate()
                .filter(|(_, p)| {
                    let upright = *theta < SAME_DEG.to_radians();
                    same(p.theta_i, *theta) && (isotropic || upright || same(p.phi_i, *phi))
                })
                .map(|(k, p)| (k, p.theta_o, p.azimuths(isotropic).1))
                .collect();
            if rows.len() < 3 {
                return None;
            }
            let i = spherical(*theta, *phi);
            made.push(Slice::new(i, &rows, isotropic, placed.len(), mixed));
        }
    }
    (!made.is_empty()).then_some(made)
}

/// Light farther from the normal than this has two sides (sine of 10°), and a lobe this near the light is on its side (cosine of 5°).
const SIDED: f64 = 0.173;
const ON_LIGHTS_SIDE: f64 = 0.996;
/// A lobe is more than this many times what is seen on the other side.
const LOBE: f64 = 3.0;

/// Says where the largest values of most incidences lie about the light itself, in place of the mirrored ray: in a file with another convention of azimuths they do. Takes directions
/// of light and detector with their value.
pub fn mirrored_side(values: impl Iterator<Item = (DVec3, DVec3, f64)>) -> Option<String> {
    // By incidence: the largest value, whether it lies about the light, and the largest about the mirrored ray.
    let mut found: std::collections::BTreeMap<[i64; 2], (f64, bool, f64)> =
        std::collections::BTreeMap::new();
    for (i, o, value) in values.filter(|v| v.0.x.hypot(v.0.y) > SIDED && v.2.is_finite()) {
        let key = [i.x, i.y].map(|v| (v * 1e5).round() as i64);
        let entry = found.entry(key).or_insert((0.0, false, 0.0));
        if value > entry.0 {
            (entry.0, entry.1) = (value, i.dot(o) > ON_LIGHTS_SIDE);
        }
        if o.dot(DVec3::new(-i.x, -i.y, i.z)) > ON_LIGHTS_SIDE {
            entry.2 = entry.2.max(value);
        }
    }
    let wrong = found.values().filter(|v| v.1 && v.0 > LOBE * v.2).count();
    (wrong >= 2 && 2 * wrong > found.len()).then(|| {
        "the largest values lie about the light itself: either the sample sends light back to where it came from, or the file has the mirrored ray at the light's azimuth. Here the mirrored ray is at phi_i_deg + 180: add 180 to phi_o_deg then".to_owned()
    })
}

/// Both turned so that `i` has the azimuth 0.
fn turned(i: DVec3, o: DVec3) -> (DVec3, DVec3) {
    let across = (i.x * i.x + i.y * i.y).sqrt();
    if across < 1e-15 {
        // No azimuth of its own: that of the other decides nothing.
        return (i, o);
    }
    let (cos, sin) = (i.x / across, i.y / across);
    (DVec3::new(across, 0.0, i.z), DVec3::new(o.x * cos + o.y * sin, o.y * cos - o.x * sin, o.z))
}

fn elevation(d: DVec3) -> f64 {
    super::tensor::elevation(d)
}

fn spherical(theta: f64, phi: f64) -> DVec3 {
    DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
}
