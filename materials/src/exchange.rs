//! Measured values as other programs and laboratories write them: FRED, Zemax, ASTM, the columns of *Scatterworks* tables as Fankhauser et al. (2023) published them, and the files of the MERL, UTIA and RGL databases.
//!
//! Which it is follows from the content, never from the ending: Zemax's `.bsdf` is text, ours and Mitsuba's is a tensor file.

use crate::fit::surface::hemisphere::Hemisphere;
use crate::samples::{Sample, Samples, direction, turned};
use glam::DVec3;
use serde_json::json;
use std::collections::BTreeSet;
use std::path::Path;
use sunglint_formats::bsdf::TensorFile;
use sunglint_formats::fred::{FredIncidence, FredRow, FredScatter};
use sunglint_formats::zemax::ZemaxBsdf;
use sunglint_formats::{Meta, ParseError};
use sunglint_numerics::order::{median, quantile};
use sunglint_simulator::surface::MaterialError;
use sunglint_simulator::surface::brdf_table::{self, Row};
use sunglint_simulator::surface::measured::{self, WriteOptions};

pub use sunglint_simulator::surface::brdf_table::Exchange;

/// Reads measured values from a file in one of these formats. `wavelength_nm` is that of a file that does not say it, or which of several.
///
/// # Errors
/// The errors of the format's reader; light that was transmitted; a wavelength that neither file nor caller gives.
pub fn read_bytes(
    path: &Path,
    content: &[u8],
    format: Exchange,
    wavelength_nm: Option<f64>,
) -> Result<Samples, ParseError> {
    let found = format.read(path, content, wavelength_nm)?;
    let mut meta = Meta::new();
    meta.insert("read_from".into(), json!(format.name()));
    if found.missing > 0 {
        meta.insert("without_value".into(), json!(found.missing));
    }
    if !found.tis.is_empty() {
        meta.insert("tis".into(), json!(found.tis));
    }
    if !found.remarks.is_empty() {
        meta.insert("remarks".into(), json!(found.remarks));
    }
    if found.colours {
        let what = "colours, not wavelengths: red, green and blue stand at the dominant wavelengths of sRGB's primaries";
        meta.insert("wavelengths_are".into(), json!(what));
    }
    let rows = found.rows.into_iter().map(sample).collect();
    Ok(Samples { wavelength_nm: found.wavelength_nm, rows, meta })
}

fn sample(row: Row) -> Sample {
    Sample {
        theta_i_deg: row.theta_i_deg,
        phi_i_deg: row.phi_i_deg,
        theta_o_deg: row.theta_o_deg,
        phi_o_deg: row.phi_o_deg,
        brdf_per_sr: row.brdf_per_sr,
        sigma_per_sr: Vec::new(),
    }
}

/// Values of one wavelength as FRED reads them. Values that are no numbers or negative are left out.
pub fn to_fred(samples: &Samples, column: usize) -> FredScatter {
    let mut file = FredScatter::default();
    for row in &samples.rows {
        let Some(value) =
            row.brdf_per_sr.get(column).copied().filter(|v| v.is_finite() && *v >= 0.0)
        else {
            continue;
        };
        let (theta_deg, phi_deg) = (row.theta_i_deg, row.phi_i_deg - 180.0);
        let same = |i: &&mut FredIncidence| {
            (i.theta_deg - theta_deg).abs() < 1e-9 && (i.phi_deg - phi_deg).abs() < 1e-9
        };
        let scattered =
            FredRow { theta_deg: row.theta_o_deg, phi_deg: row.phi_o_deg, bsdf_per_sr: value };
        match file.incidences.iter_mut().find(same) {
            Some(incidence) => incidence.rows.push(scattered),
            None => {
                file.incidences.push(FredIncidence { theta_deg, phi_deg, rows: vec![scattered] });
            }
        }
    }
    file
}

/// Part by which a stated reflectance and that of the values may differ.
const MOST_OFF_LN: f64 = 0.1;

/// Warnings on values that were read: changes that were made to them, a reflectance that is not the file's own, a convention of azimuths that seems to be another one.
pub fn warnings(samples: &Samples) -> Vec<String> {
    let remarks = samples.meta.get("remarks").and_then(|r| r.as_array());
    let remarks = remarks.into_iter().flatten().filter_map(|r| r.as_str());
    let mut all: Vec<String> = remarks.map(str::to_owned).collect();
    all.extend(other_than_stated(samples));
    let values = samples.rows.iter().map(|row| {
        let (i, o) = row.directions();
        (i, o, row.brdf_per_sr[0])
    });
    all.extend(brdf_table::mirrored_side(values));
    all.extend(implausible(samples));
    all.extend(slips(samples));
    all
}

/// Median of the values beyond which they are taken for percent: a white Lambert surface has 1/π everywhere, and peaks are few.
const PERCENT_PER_SR: f64 = 1.5;
/// Angles of a whole table below this are taken for radians: π/2.
const RADIANS_DEG: f64 = 1.6;

/// Warnings on values that no surface has: none at all, negative ones, percent, angles in radians.
pub fn implausible(samples: &Samples) -> Vec<String> {
    let values = || {
        let rows = samples.rows.iter();
        rows.flat_map(|row| row.brdf_per_sr.iter().copied()).filter(|v| v.is_finite())
    };
    let mut all = Vec::new();
    let count = values().count();
    let negative = values().filter(|v| *v < 0.0).count();
    if count > 0 && values().all(|v| v == 0.0) {
        all.push("all values are 0: there is no light in them".to_owned());
    }
    if negative > 0 {
        all.push(format!(
            "{negative} of {count} values are below 0, which no surface has: dark readings that were too high, or a wrong offset"
        ));
    }
    if let Some(middle) = median(values()).filter(|m| *m > PERCENT_PER_SR) {
        all.push(format!(
            "half of the values are above {middle:.1} sr⁻¹, and a white sample has 0.32: are they percent, or counts?"
        ));
    }
    let angles = || samples.rows.iter().flat_map(|r| [r.theta_i_deg.abs(), r.theta_o_deg.abs()]);
    let widest = angles().fold(0.0, f64::max);
    if samples.rows.len() > 8 && widest > 0.0 && widest < RADIANS_DEG {
        all.push(format!("all angles from the normal are below {widest:.3}°: are they radians?"));
    }
    all
}

/// Neighbours of a value, how far they may lie, and the factor within which they agree.
const NEIGHBOURS: usize = 4;
/// Nearest others that are looked at: the neighbours, and some more values of the same direction.
const NEAREST: usize = 12;
const NEAR_DEG: f64 = 20.0;
const ALIKE: f64 = 2.0;
/// A value that is this many times as much as all of its neighbours, or as little, is none of theirs; and values of one direction that differ by this factor are two.
const APART: f64 = 5.0;
const DIFFER: f64 = 1.5;
/// Values at an incidence that are searched one by one.
const MOST_SEARCHED: usize = 3000;
/// The mirrored direction is seen within this, or within three of the usual distances of neighbours.
const MIRROR_DEG: f64 = 5.0;

/// Warnings on single values that their neighbours contradict, on directions that stand there with different values (the normal has every azimuth), and on incidences whose mirrored direction was not measured. By the first wavelength.
fn slips(samples: &Samples) -> Vec<String> {
    let mut by_incidence: std::collections::BTreeMap<[i64; 3], Vec<(DVec3, f64)>> =
        std::collections::BTreeMap::new();
    for row in &samples.rows {
        let (i, o) = row.directions();
        let value = row.brdf_per_sr[0];
        if value.is_finite() && value > 0.0 && o.z > 0.0 {
            let key = (i * 1e7).to_array().map(|x| x.round() as i64);
            by_incidence.entry(key).or_default().push((o, value));
        }
    }
    let (mut lone, mut twice, mut blind) = (Vec::new(), Vec::new(), Vec::new());
    let incidences = by_incidence.len();
    for (key, values) in by_incidence {
        let i = DVec3::from_array(key.map(|x| x as f64 * 1e-7)).normalize();
        if values.len() < 2 * NEIGHBOURS || values.len() > MOST_SEARCHED {
            continue;
        }
        let mirror = DVec3::new(-i.x, -i.y, i.z);
        let mut steps = Vec::new();
        for (k, (o, value)) in values.iter().enumerate() {
            let others = values.iter().enumerate().filter(|(j, _)| *j != k);
            // The nearest few, by the chord; their angles after.
            let mut others: Vec<(f64, f64)> =
                others.map(|(_, (at, v))| (at.distance_squared(*o), *v)).collect();
            if others.len() > NEAREST {
                others.select_nth_unstable_by(NEAREST, |a, b| a.0.total_cmp(&b.0));
                others.truncate(NEAREST);
            }
            others.sort_by(|a, b| a.0.total_cmp(&b.0));
            for other in &mut others {
                other.0 = (2.0 * (0.5 * other.0.sqrt()).min(1.0).asin()).to_degrees();
            }
            let same = others.iter().take_while(|v| v.0 < 1e-4).map(|v| v.1);
            if let Some(other) =
                same.fold(None, |a: Option<f64>, b| Some(a.map_or(b, |a| a.max(b))))
                && other > DIFFER * value
            {
                twice.push((i, *o, other / value));
            }
            others.retain(|v| v.0 >= 1e-4);
            let Some(next) = others.first() else { continue };
            steps.push(next.0);
            let Some(near) = others.get(..NEIGHBOURS).filter(|n| n[NEIGHBOURS - 1].0 < NEAR_DEG)
            else {
                continue;
            };
            let least = near.iter().map(|v| v.1).fold(f64::INFINITY, f64::min);
            let most = near.iter().map(|v| v.1).fold(0.0, f64::max);
            // Peaks are about the mirrored direction and about the light's own.
            let reach = 2.0 * near[NEIGHBOURS - 1].0;
            let off = |d: DVec3| d.angle_between(*o).to_degrees();
            let is_peak = off(mirror) < reach || off(i) < reach;
            let is_high = *value > APART * most && !is_peak;
            if most <= ALIKE * least && (is_high || *value < least / APART) {
                lone.push((i, *o, value / (least * most).sqrt()));
            }
        }
        let to_mirror = values.iter().map(|v| v.0.angle_between(mirror).to_degrees());
        let nearest = to_mirror.fold(f64::INFINITY, f64::min);
        let step = median(steps.iter().copied()).unwrap_or(0.0);
        if nearest > MIRROR_DEG.max(3.0 * step) {
            blind.push((i.z.clamp(-1.0, 1.0).acos().to_degrees(), nearest));
        }
    }
    let place = |i: DVec3, o: DVec3| {
        let (_, o) = crate::samples::turned(i, o);
        let deg = |d: DVec3| d.z.clamp(-1.0, 1.0).acos().to_degrees();
        let azimuth = o.y.atan2(o.x).to_degrees().rem_euclid(360.0);
        format!(
            "incidence {:.1}°, detector {:.1}°, azimuth {azimuth:.0}° from the light's",
            deg(i),
            deg(o)
        )
    };
    let mut all = Vec::new();
    let farthest = |list: &[(DVec3, DVec3, f64)]| {
        list.iter().copied().max_by(|a, b| a.2.ln().abs().total_cmp(&b.2.ln().abs()))
    };
    if let Some((i, o, factor)) = farthest(&lone) {
        all.push(format!(
            "{} other than all of their neighbours by a factor of {APART} or more, though these agree: the farthest is {factor:.3} times as much ({}). A slip, or a stray reflection: look at them",
            sunglint_formats::text::counted(lone.len(), "value") + if lone.len() == 1 { " is" } else { " are" },
            place(i, o)
        ));
    }
    if let Some((i, o, factor)) = farthest(&twice) {
        all.push(format!(
            "{} with values that differ by {DIFFER} times or more, the farthest by {factor:.3} ({})",
            sunglint_formats::text::counted(twice.len(), "direction") + if twice.len() == 1 { " stands there" } else { " stand there" },
            place(i, o)
        ));
    }
    if let Some((theta_deg, nearest)) = blind.first() {
        all.push(format!(
            "at {} of {incidences} incidences nothing was measured near the mirrored direction (at {theta_deg:.1}° the nearest value is {nearest:.1}° off): a peak there is not in the table",
            blind.len()
        ));
    }
    all
}

/// Warnings where values reflect more or less than the hemispherical reflectance that their file states (Zemax's TIS), by more than 10 % and what lies between the directions.
pub fn other_than_stated(samples: &Samples) -> Vec<String> {
    let mut by_incidence: std::collections::BTreeMap<i64, Vec<&Sample>> =
        std::collections::BTreeMap::new();
    for row in &samples.rows {
        let theta = (row.theta_i_deg.abs() * 1e6).round() as i64;
        by_incidence.entry(theta).or_default().push(row);
    }
    let mut said = Vec::new();
    for (theta, rows) in by_incidence {
        let theta_deg = theta as f64 / 1e6;
        let Some(tis) = samples.tis(theta_deg) else { continue };
        let (i, _) = rows[0].directions();
        let known = rows.iter().filter(|r| r.brdf_per_sr[0].is_finite());
        let (o, value): (Vec<DVec3>, Vec<f64>) =
            known.map(|r| (r.directions().1, r.brdf_per_sr[0])).unzip();
        let hemisphere = Hemisphere::new(i, &o, &value);
        let found = hemisphere.of(&value);
        if (found / tis).ln().abs() > MOST_OFF_LN + hemisphere.ln_doubt {
            said.push(format!(
                "at {theta_deg}° of incidence the values reflect {found:.3} and the file's own TIS is {tis:.3}: look at the units and the scale of the values"
            ));
        }
    }
    said
}

/// The direction at a radial angle and an azimuth about the mirrored ray of light with the azimuth 180°: 0 towards the normal.
fn about_mirrored(theta_i_deg: f64, azimuth_deg: f64, radial_deg: f64) -> DVec3 {
    let (sin_i, cos_i) = theta_i_deg.to_radians().sin_cos();
    let (sin_r, cos_r) = radial_deg.to_radians().sin_cos();
    let (sin_a, cos_a) = azimuth_deg.to_radians().sin_cos();
    let mirrored = DVec3::new(sin_i, 0.0, cos_i);
    let to_normal = DVec3::new(-cos_i, 0.0, sin_i);
    mirrored * cos_r + (to_normal * cos_a + DVec3::Y * sin_a) * sin_r
}

/// Azimuth and radial angle about the mirrored ray, degrees.
fn of_mirrored(theta_i_deg: f64, o: DVec3) -> (f64, f64) {
    let (sin_i, cos_i) = theta_i_deg.to_radians().sin_cos();
    let mirrored = DVec3::new(sin_i, 0.0, cos_i);
    let to_normal = DVec3::new(-cos_i, 0.0, sin_i);
    let (x, y, z) = (o.dot(to_normal), o.y, o.dot(mirrored));
    (y.atan2(x).to_degrees(), x.hypot(y).atan2(z).to_degrees())
}

/// Why values cannot be written for Zemax.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum WriteError {
    /// Directions that are no grid about the mirrored ray.
    #[error(
        "the directions are no grid about the mirrored ray ({azimuths} azimuths × {radials} angles for {values} values at {theta_i_deg}° of incidence), as Zemax's format needs: write FRED's, which takes any directions"
    )]
    NoGrid {
        /// Angle of incidence, degrees.
        theta_i_deg: f64,
        /// Azimuths that there are.
        azimuths: usize,
        /// Angles that there are.
        radials: usize,
        /// Values that there are.
        values: usize,
    },
    /// Samples that are too far apart for their peak.
    #[error(
        "at {theta_i_deg}° of incidence the directions are too far apart for the peak, so the TIS that Zemax's format needs is not known: measure nearer to the mirrored ray, or write FRED's"
    )]
    NotResolved {
        /// Angle of incidence, degrees.
        theta_i_deg: f64,
    },
    /// A table with several azimuths of incidence.
    #[error("the table has several azimuths of incidence, and Zemax's format is written for one")]
    Azimuths,
}

/// A value about the mirrored ray.
struct Placed {
    /// Angle of incidence, 1e-6 degrees.
    theta: i64,
    /// Azimuth and radial angle, degrees.
    azimuth_deg: f64,
    radial_deg: f64,
    value: f64,
}

/// The nearest number with few decimals to a group's middle, which is known to half its width, or to `doubt`.
fn shortest(least: f64, most: f64, doubt: f64) -> f64 {
    let (middle, half) = (0.5 * (least + most), (0.5 * (most - least)).max(doubt));
    let rounded = |decimals: i32| {
        let unit = 10.0_f64.powi(decimals);
        (middle * unit).round() / unit
    };
    (0..6).map(rounded).find(|r| (r - middle).abs() <= half).unwrap_or_else(|| rounded(6))
}

/// Values by incidence and by the numbers of azimuth and radial angle; the azimuth of the mirrored ray itself, and of all light along the normal, is none.
type Cells = std::collections::BTreeMap<(i64, Option<usize>, usize), f64>;

/// A grid about the mirrored ray, for angles that are the same within a tolerance.
struct Grid {
    azimuth_deg: Vec<f64>,
    radial_deg: Vec<f64>,
    cells: Cells,
}

impl Grid {
    fn new(placed: &[Placed], tolerance_deg: f64) -> Self {
        let mut radials: Vec<f64> = placed.iter().map(|p| p.radial_deg).collect();
        radials.sort_by(f64::total_cmp);
        let mut ends: Vec<(f64, f64)> = Vec::new();
        for radial in radials {
            match ends.last_mut() {
                Some((first, last)) if radial - *first <= tolerance_deg => *last = radial,
                _ => ends.push((radial, radial)),
            }
        }
        // Rounding moves the mirrored ray to one side only.
        if let Some(first) = ends.first_mut().filter(|(_, last)| *last <= tolerance_deg) {
            first.0 = -first.1;
        }
        let radial_deg: Vec<f64> = ends.iter().map(|(a, b)| shortest(*a, *b, 5e-7)).collect();
        let radial_of = |r: f64| ends.partition_point(|(_, last)| *last < r);
        // Far from the mirrored ray an azimuth is known best: those there say which there are.
        let mut order: Vec<&Placed> = placed.iter().collect();
        order.sort_by(|a, b| b.radial_deg.total_cmp(&a.radial_deg));
        let mut azimuths: Vec<(f64, f64)> = Vec::new();
        // They are kept in order.
        let middle = |(a, b): &(f64, f64)| 0.5 * (a + b);
        let after =
            |azimuths: &[(f64, f64)], deg: f64| azimuths.partition_point(|a| middle(a) < deg);
        let nearest = |azimuths: &[(f64, f64)], p: &Placed| {
            let next = after(azimuths, p.azimuth_deg);
            let off = |k: &usize| (middle(&azimuths[*k]) - p.azimuth_deg).abs();
            let beside = next.saturating_sub(1)..(next + 1).min(azimuths.len());
            let best = beside.min_by(|j, k| off(j).total_cmp(&off(k)));
            best.map(|k| (k, off(&k) * p.radial_deg.to_radians().sin().abs()))
        };
        let has_azimuth = |p: &&&Placed| p.theta != 0 && radial_deg[radial_of(p.radial_deg)] != 0.0;
        for p in order.iter().filter(has_azimuth) {
            match nearest(&azimuths, p) {
                Some((k, off)) if off <= tolerance_deg => {
                    // Only those as far out say where it is.
                    let is_as_far = p.radial_deg > 0.5 * order[0].radial_deg;
                    if is_as_far {
                        azimuths[k].0 = azimuths[k].0.min(p.azimuth_deg);
                        azimuths[k].1 = azimuths[k].1.max(p.azimuth_deg);
                    }
                }
                _ => {
                    let at = after(&azimuths, p.azimuth_deg);
                    azimuths.insert(at, (p.azimuth_deg, p.azimuth_deg));
                }
            }
        }
        if azimuths.is_empty() {
            azimuths.push((0.0, 0.0));
        }
        let mut sums: std::collections::BTreeMap<_, (f64, f64)> = std::collections::BTreeMap::new();
        for p in placed {
            let radial = radial_of(p.radial_deg);
            let azimuth = Some(p).filter(|p| has_azimuth(&p)).and_then(|p| nearest(&azimuths, p));
            let sum = sums.entry((p.theta, azimuth.map(|a| a.0), radial)).or_default();
            *sum = (sum.0 + p.value, sum.1 + 1.0);
        }
        let cells = sums.into_iter().map(|(key, (sum, count))| (key, sum / count)).collect();
        let doubt = tolerance_deg.max(2e-6);
        let azimuth_deg = azimuths.iter().map(|(a, b)| shortest(*a, *b, doubt)).collect();
        Self { azimuth_deg, radial_deg, cells }
    }

    /// Measure of how values and places go together: more where a grid has fewer places, and less where values fall together.
    fn fit(&self) -> f64 {
        let places = (self.azimuth_deg.len() * self.radial_deg.len()) as f64;
        (self.cells.len() as f64).powi(2) / places
    }
}

/// Angle across which values are interpolated at most.
const MOST_GAP_DEG: f64 = 15.0;

/// The value at a place of an azimuth that has none, from its neighbours on both sides: ln f is straight over the angle. None at the ends, across wide gaps and beside zeros.
fn interpolated(radial_deg: &[f64], along: &[Option<f64>], at: usize) -> Option<f64> {
    let beside = |k: &usize| along[*k].map(|v| (radial_deg[*k], v.ln()));
    let before = (0..at).rev().find_map(|k| beside(&k))?;
    let after = (at + 1..along.len()).find_map(|k| beside(&k))?;
    if after.0 - before.0 > MOST_GAP_DEG || !(before.1 + after.1).is_finite() {
        return None;
    }
    let part = (radial_deg[at] - before.0) / (after.0 - before.0);
    Some((before.1 + part * (after.1 - before.1)).exp())
}

/// Values as Zemax reads them, from directions on a grid about the mirrored ray, such as a file of Zemax's gives. Angles may be rounded, to 0.01°. A TIS that was read is kept. A place between measured ones of its azimuth that has no value
/// gets one by interpolation, and a comment counts these; beyond the last one the value is 0, as such files write what was not measured.
///
/// # Errors
/// Directions that are no such grid, several azimuths of incidence, samples too far apart for a TIS where none was read.
pub fn to_zemax(samples: &Samples, column: usize) -> Result<ZemaxBsdf, WriteError> {
    if samples.has_azimuths() {
        return Err(WriteError::Azimuths);
    }
    let mut placed = Vec::new();
    for row in &samples.rows {
        // What was measured as 0 or below is a value, and is written as 0.
        let Some(value) = row.brdf_per_sr.get(column).copied().filter(|v| v.is_finite()) else {
            continue;
        };
        let value = value.max(0.0);
        let (i, o) = row.directions();
        let o = turned(i, o).1;
        // Light at the azimuth 180°.
        let (azimuth_deg, radial_deg) =
            of_mirrored(row.theta_i_deg.abs(), DVec3::new(-o.x, o.y.abs(), o.z));
        let theta = (row.theta_i_deg.abs() * 1e6).round() as i64;
        placed.push(Placed { theta, azimuth_deg, radial_deg, value });
    }
    // The finest that does: a grid's own steps may be small, and its angles rounded.
    let mut grid = Grid::new(&placed, 1e-6);
    for tolerance_deg in [1e-5, 1e-4, 1e-3, 1e-2] {
        let coarser = Grid::new(&placed, tolerance_deg);
        if coarser.fit() > grid.fit() {
            grid = coarser;
        }
    }
    let incidences: BTreeSet<i64> = placed.iter().map(|p| p.theta).collect();
    let (mut tis, mut value_per_sr, mut filled) = (Vec::new(), Vec::new(), 0);
    for theta in &incidences {
        let theta_deg = *theta as f64 / 1e6;
        // At normal incidence all azimuths are alike of a table with one azimuth of incidence.
        let of_azimuth = |azimuth: usize, radial: usize| {
            let of = |azimuth| grid.cells.get(&(*theta, azimuth, radial)).copied();
            of(Some(azimuth)).or_else(|| of(None))
        };
        let values = grid.cells.range((*theta, None, 0)..(*theta + 1, None, 0)).count();
        let azimuths = if *theta == 0 { 1 } else { grid.azimuth_deg.len() };
        let radials = grid.radial_deg.len();
        // A quarter of a grid's places may lie below the horizon or have no value; what fills less is none.
        if values * 4 < azimuths * radials {
            return Err(WriteError::NoGrid { theta_i_deg: theta_deg, azimuths, radials, values });
        }
        let (mut o, mut known) = (Vec::new(), Vec::new());
        for (a, azimuth_deg) in grid.azimuth_deg.iter().enumerate() {
            let along: Vec<Option<f64>> = (0..radials).map(|r| of_azimuth(a, r)).collect();
            for (r, radial_deg) in grid.radial_deg.iter().enumerate() {
                // A zero between values would be a hole in the light.
                let between = || interpolated(&grid.radial_deg, &along, r);
                let value = along[r].or_else(between);
                filled += usize::from(along[r].is_none() && value.is_some());
                value_per_sr.push(value.unwrap_or(0.0));
                // On the mirrored ray all azimuths are one direction.
                if let Some(value) = along[r].filter(|_| a == 0 || *radial_deg != 0.0) {
                    o.push(about_mirrored(theta_deg, *azimuth_deg, *radial_deg));
                    known.push(value);
                }
            }
        }
        let hemisphere = Hemisphere::new(direction(theta_deg, 180.0), &o, &known);
        tis.push(match samples.tis(theta_deg) {
            Some(read) => read,
            None if hemisphere.is_known() => hemisphere.of(&known),
            None => return Err(WriteError::NotResolved { theta_i_deg: theta_deg }),
        });
    }
    let mut comments = vec![format!("{} nm, written by sunglint", samples.wavelength_nm[column])];
    if filled > 0 {
        let all = value_per_sr.iter().filter(|v| **v > 0.0).count();
        comments.push(format!(
            "{filled} of {all} values were not measured: each is interpolated (ln f, straight over the angle) between its neighbours along an azimuth"
        ));
    }
    Ok(ZemaxBsdf {
        comments,
        source: "Measured".into(),
        plane_symmetrical: true,
        transmitted: false,
        incidence_deg: incidences.iter().map(|theta| *theta as f64 / 1e6).collect(),
        azimuth_deg: grid.azimuth_deg,
        radial_deg: grid.radial_deg,
        tis,
        value_per_sr,
    })
}

/// A tensor file of the RGL kind, and how it gives the values from which it was made.
#[derive(Debug, Clone, PartialEq)]
pub struct Rgl {
    /// The file.
    pub file: TensorFile,
    /// Values of the samples that are compared: those above a thousandth of their incidence's largest.
    pub compared: usize,
    /// Median of |ln(file / sample)| over them.
    pub median_ln: f64,
    /// The 95 % point of it.
    pub most_ln: f64,
}

/// The 95 % point of ln f at which a file is fine enough.
const FINE_LN: f64 = 0.01;
/// A finer file is as much better at least, or not worth its size.
const GAIN: f64 = 0.8;
/// Wavelengths beside which a file is made finer: more make it too large.
const MOST_FINE: usize = 8;
/// Elevations, nodes of the densities and side of the grid, coarse to fine (5, 16 and 47 MB of one wavelength, 0.4, 3 and 12 MB for each more): the first that is fine enough is taken.
const FINENESS: [(usize, usize, usize); 3] = [(24, 128, 64), (48, 192, 128), (90, 256, 180)];

/// Values as a tensor file of the RGL kind, which Mitsuba 3 reads: interpolated as a table is ([`sunglint_simulator::surface::brdf_table`]), at the file's own directions. It is made as fine as the samples need, and says how well it gives them.
///
/// # Errors
/// Values that make no table; a tangent that the file's quarter of the azimuths does not hold.
pub fn to_rgl(samples: &Samples) -> Result<Rgl, MaterialError> {
    let row = |s: &Sample| Row {
        theta_i_deg: s.theta_i_deg,
        phi_i_deg: s.phi_i_deg,
        theta_o_deg: s.theta_o_deg,
        phi_o_deg: s.phi_o_deg,
        brdf_per_sr: s.brdf_per_sr.clone(),
    };
    let known = |s: &&Sample| s.brdf_per_sr.iter().all(|v| v.is_finite() && *v >= 0.0);
    let rows: Vec<Row> = samples.rows.iter().filter(known).map(row).collect();
    let table = brdf_table::material("table", &samples.wavelength_nm, &rows, None)?;
    // An anisotropic file has nine azimuths, each as large.
    let is_large = samples.has_azimuths() || samples.wavelength_nm.len() > MOST_FINE;
    let finest = if is_large { 1 } else { FINENESS.len() };
    let made = |(elevations, normals, side): (usize, usize, usize)| {
        let at = WriteOptions::at(samples.wavelength_nm.clone());
        let file = measured::write(&table, &WriteOptions { elevations, normals, side, ..at })?;
        compared(samples, file)
    };
    let mut best = made(FINENESS[0])?;
    for finer in &FINENESS[1..finest] {
        if best.most_ln <= FINE_LN {
            break;
        }
        let found = made(*finer)?;
        if found.most_ln > GAIN * best.most_ln {
            break;
        }
        best = found;
    }
    Ok(best)
}

/// Compares what a file gives with the samples.
fn compared(samples: &Samples, file: TensorFile) -> Result<Rgl, MaterialError> {
    let read = measured::material("written", "the file that was made", &file).map_err(|e| {
        let expected = "a file that can be read".to_owned();
        MaterialError::Data { what: "the RGL file".to_owned(), found: e.to_string(), expected }
    })?;
    let mut largest: std::collections::BTreeMap<(i64, usize), f64> =
        std::collections::BTreeMap::new();
    let key = |s: &Sample, k: usize| ((s.theta_i_deg.abs() * 1e6).round() as i64, k);
    for row in &samples.rows {
        for (k, value) in row.brdf_per_sr.iter().enumerate().filter(|v| v.1.is_finite()) {
            let most = largest.entry(key(row, k)).or_default();
            *most = most.max(*value);
        }
    }
    let mut off = Vec::new();
    for row in &samples.rows {
        let (i, o) = row.directions();
        for (k, value) in row.brdf_per_sr.iter().enumerate().filter(|v| v.1.is_finite()) {
            if *value > 1e-3 * largest[&key(row, k)] {
                let found = read.brdf(samples.wavelength_nm[k], i, o);
                off.push((found.max(1e-3 * value) / value).ln().abs());
            }
        }
    }
    off.sort_by(f64::total_cmp);
    let point = |part: f64| if off.is_empty() { 0.0 } else { quantile(&off, part) };
    Ok(Rgl { compared: off.len(), median_ln: point(0.5), most_ln: point(0.95), file })
}
