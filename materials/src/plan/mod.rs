//! In which directions a sample is measured: few where nothing changes, many within the lobe (Dupuy and Jakob, ACM TOG 37, 274, 2018).
//!
//! Incident elevations are drawn by the projected area σ over u = √(2θ/π), outgoing directions by the density of visible normals D (i·m)₊: each cell (u₁, u₂) of
//! the file's grid of values goes through that warp to a normal m, and the sample is seen from where m mirrors the light to. A rig that turns in one plane, to
//! marks, not closer to its lamp than a phase angle, gets the cells that it can reach.

mod check;
mod choose;
mod density;
pub(crate) mod order;
mod rig;
mod table;

pub use check::{Planned, missing, planned};
pub use choose::{Choice, LEAST};
pub use density::Densities;
pub use rig::Rig;
pub use table::to_table;

use super::ndf::Ndf;
use glam::{DVec2, DVec3};
use std::f64::consts::{FRAC_PI_2, PI};
use sunglint_numerics::progress::Cancelled;
use sunglint_simulator::surface::Blend;

/// How a plan is made.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanOptions {
    /// Incident elevations.
    pub theta_i: usize,
    /// Incident azimuths of an anisotropic sample, over half the circle (`quarter`: over a quarter), both ends in it.
    pub phi_i: usize,
    /// Whether an anisotropic sample is symmetric about its axes, so that a quarter of the circle says all.
    pub quarter: bool,
    /// Side of the grid of outgoing directions.
    pub side: usize,
    /// Nodes of the densities in elevation and azimuth.
    pub normals: usize,
    /// The share of the grid that is spread over all normals, so that a lobe's tails are resolved too; 0 as in the paper.
    pub wide: f64,
    /// The largest incident elevation, degrees.
    pub most_theta_i_deg: f64,
    /// Incident elevations in equal steps, and not by the projected area: between the last ones of a narrow lobe 25° and more are left, where a material changes most.
    pub even: bool,
    /// A rig that cannot reach all directions.
    pub rig: Option<Rig>,
}

impl Default for PlanOptions {
    fn default() -> Self {
        Self {
            theta_i: 8,
            phi_i: 9,
            quarter: false,
            side: 32,
            normals: 128,
            wide: 0.25,
            most_theta_i_deg: 89.9,
            even: false,
            rig: None,
        }
    }
}

impl PlanOptions {
    /// To choose the measurements of a budget from, up to an angle of incidence, degrees.
    #[must_use]
    pub fn to_choose_from(most_theta_i_deg: f64) -> Self {
        Self { theta_i: 16, side: 24, most_theta_i_deg, even: true, ..Self::default() }
    }

    /// For a rig: in its plane, with a grid that has the plane among its rows.
    pub fn of_rig(rig: Rig) -> Self {
        Self { side: 33, most_theta_i_deg: rig.most_theta_i_deg, rig: Some(rig), ..Self::default() }
    }
}

/// Why there is no plan.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PlanError {
    /// An option out of its range.
    #[error("{name}: found {found}, expected {expected}")]
    Option {
        /// The option.
        name: &'static str,
        /// Value of the option.
        found: f64,
        /// Allowed values.
        expected: &'static str,
    },
    /// A density of nothing.
    #[error("no microfacet is seen from {theta_i_deg:.2}°: D is 0 there")]
    Dark {
        /// The incident elevation.
        theta_i_deg: f64,
    },
    /// The rig reaches no direction.
    #[error(
        "the rig reaches none of {cells} directions: look at the least phase angle and the largest elevations"
    )]
    Unreachable {
        /// Directions in the plan.
        cells: usize,
    },
    /// A budget of fewer measurements than a material can be made of.
    #[error("a budget of {asked} measurements: a material is made of {LEAST} or more")]
    TooFew {
        /// The measurements that were asked for.
        asked: usize,
    },
    /// A budget of more measurements than there are to choose from.
    #[error(
        "a budget of {asked} measurements: {directions} directions are within reach to choose from; a finer grid (side, theta_i) has more"
    )]
    TooMany {
        /// The measurements that were asked for.
        asked: usize,
        /// Directions to choose from.
        directions: usize,
    },
    /// A budget of less time than a bench needs.
    #[error(
        "a budget of {asked_h} h: the bench measures itself (dark, beam, signature, stray light, zeros, references) for {own_h:.2} h, and with {LEAST} directions it takes {least_h:.2} h"
    )]
    TooShort {
        /// The time that was asked for, h.
        asked_h: f64,
        /// Time without any direction, h.
        own_h: f64,
        /// The least time, h.
        least_h: f64,
    },
    /// Whoever watches ended it.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// A cell of the file's grid of values.
#[derive(Debug, Clone, PartialEq)]
pub struct Cell {
    /// Which incident azimuth and elevation, row and column of the grid: the indices of the tensor.
    pub index: [usize; 4],
    /// The grid's coordinates, 0…1: along the columns, along the rows.
    pub u: DVec2,
    /// Towards the detector, unit, in the sample's axes (light from the azimuth φ_i).
    pub outgoing: DVec3,
    /// Which measurement gives it; none where the direction is below the horizon or out of the rig's reach.
    pub step: Option<usize>,
}

/// A measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    /// Which incident azimuth and elevation.
    pub incident: [usize; 2],
    /// Towards the detector, unit.
    pub outgoing: DVec3,
    /// Settings of a rig in one plane: angles of incidence and of the detector, degrees; the detector's is negative on the lamp's side.
    pub marks_deg: Option<[f64; 2]>,
}

/// Choice of a plan's measurements within a budget.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Chosen {
    /// Number of directions from which they were chosen.
    pub of: usize,
    /// Time that a bench needs for them, where one was given.
    pub times: Option<Times>,
}

/// Parts of a run on a bench, and its time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Times {
    /// Looks at the reference direction.
    pub references: usize,
    /// Measurements of the instrument itself.
    pub instrument: usize,
    /// Time without the plan's directions, s.
    pub own_s: f64,
    /// Time of the whole run, s.
    pub total_s: f64,
}

/// A plan.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Incident elevations, radians.
    pub theta_i_rad: Vec<f64>,
    /// Incident azimuths, radians: 0 of an isotropic sample, from −π of another.
    pub phi_i_rad: Vec<f64>,
    /// The options that it was made with.
    pub options: PlanOptions,
    /// All cells, by azimuth, elevation, row and column.
    pub cells: Vec<Cell>,
    /// The measurements, in the order in which they are taken.
    pub steps: Vec<Step>,
    /// The choice of these measurements, where there was a budget ([`Choice`]).
    pub chosen: Option<Chosen>,
    /// How far the detector goes in that order, degrees, the way to each incident direction left out.
    pub travel_deg: f64,
    /// How far it would go in the order of the cells.
    pub unordered_travel_deg: f64,
}

impl Plan {
    /// Unit vectors to light and detector of a measurement; with a rig at its marks.
    #[must_use]
    pub fn directions(&self, step: &Step) -> (DVec3, DVec3) {
        let [phi, theta] = [self.phi_i_rad[step.incident[0]], self.theta_i_rad[step.incident[1]]];
        let theta = step.marks_deg.map_or(theta, |marks| marks[0].to_radians());
        (density::direction(theta, phi), step.outgoing)
    }

    /// The measurements as a plan's table says them.
    #[must_use]
    pub fn planned(&self) -> Vec<Planned> {
        let one = |(k, step): (usize, &Step)| {
            let (i, o) = self.directions(step);
            Planned {
                step: k + 1,
                theta_i_deg: i.truncate().length().atan2(i.z).to_degrees(),
                phi_i_deg: self.phi_i_rad[step.incident[0]].to_degrees(),
                theta_o_deg: o.truncate().length().atan2(o.z).to_degrees(),
                phi_o_deg: o.y.atan2(o.x).to_degrees(),
            }
        };
        self.steps.iter().enumerate().map(one).collect()
    }
}

/// Makes a plan for a sample.
///
/// # Errors
/// Options out of their ranges, a density that is 0 everywhere, a rig that reaches nothing.
pub fn plan(ndf: &Ndf, options: &PlanOptions) -> Result<Plan, PlanError> {
    check(options)?;
    let densities = Densities::of(ndf, options.normals);
    let theta_i_rad = incident(&densities, options);
    let phi_i_rad = azimuths(ndf, options);
    let mut cells = Vec::new();
    let mut steps = Vec::new();
    let (mut travel_deg, mut unordered_travel_deg) = (0.0, 0.0);
    let mut stands = DVec3::Z;
    for (p, phi) in phi_i_rad.iter().enumerate() {
        for (t, theta) in theta_i_rad.iter().enumerate() {
            let first = cells.len();
            outgoing(&densities, [p, t], [*phi, *theta], options, &mut cells)?;
            let here = &mut cells[first..];
            let found = match &options.rig {
                Some(rig) => rig.steps(here, [p, t], [*phi, *theta]),
                None => everywhere(here, [p, t], ndf.is_isotropic(), *theta),
            };
            let directions: Vec<DVec3> = found.iter().map(|s| s.outgoing).collect();
            unordered_travel_deg += order::travel_deg(&directions);
            let order = match &options.rig {
                Some(rig) => rig.order(&found, stands),
                None => order::shortest(&directions, stands),
            };
            let mut place = vec![0; order.len()];
            for (new, old) in order.iter().enumerate() {
                place[*old] = new;
            }
            for cell in here.iter_mut() {
                cell.step = cell.step.map(|old| steps.len() + place[old]);
            }
            let ordered: Vec<DVec3> = order.iter().map(|k| directions[*k]).collect();
            travel_deg += order::travel_deg(&ordered);
            stands = ordered.last().copied().unwrap_or(stands);
            steps.extend(order.iter().map(|k| found[*k]));
        }
    }
    if steps.is_empty() {
        return Err(PlanError::Unreachable { cells: cells.len() });
    }
    let options = options.clone();
    Ok(Plan {
        theta_i_rad,
        phi_i_rad,
        options,
        cells,
        steps,
        chosen: None,
        travel_deg,
        unordered_travel_deg,
    })
}

fn check(options: &PlanOptions) -> Result<(), PlanError> {
    let wrong = |name, found, expected| Err(PlanError::Option { name, found, expected });
    if !(2..=256).contains(&options.theta_i) {
        return wrong("theta_i", options.theta_i as f64, "2 to 256 elevations");
    }
    if !(3..=256).contains(&options.phi_i) {
        return wrong("phi_i", options.phi_i as f64, "3 to 256 azimuths");
    }
    if !(4..=256).contains(&options.side) {
        return wrong("side", options.side as f64, "4 to 256 nodes");
    }
    if !(16..=1024).contains(&options.normals) {
        return wrong("normals", options.normals as f64, "16 to 1024 nodes");
    }
    if !(0.0..1.0).contains(&options.wide) {
        return wrong("wide", options.wide, "a share from 0 to below 1");
    }
    let most = options.most_theta_i_deg;
    if !(most > 0.0 && most < 90.0) {
        return wrong("most_theta_i_deg", most, "an angle above 0 and below 90°");
    }
    match &options.rig {
        Some(rig) => rig.check(options.side),
        None => Ok(()),
    }
}

/// Elevations in equal steps, or at equal parts of ∫ σ du, from 0 to the largest: σ is the chance that light from there meets the surface.
fn incident(densities: &Densities, options: &PlanOptions) -> Vec<f64> {
    const PIECES: usize = 2048;
    let most = options.most_theta_i_deg.to_radians();
    if options.even {
        let step = most / (options.theta_i - 1) as f64;
        return (0..options.theta_i).map(|j| step * j as f64).collect();
    }
    let end = (most / FRAC_PI_2).sqrt();
    let at = |k: usize| end * k as f64 / PIECES as f64;
    let mut sums = vec![0.0];
    for k in 0..PIECES {
        let mean = 0.5 * (densities.mean_area(at(k)) + densities.mean_area(at(k + 1)));
        sums.push(sums[k] + mean);
    }
    let last = options.theta_i - 1;
    let theta = |j: usize| {
        let wanted = sums[PIECES] * j as f64 / last as f64;
        let k = sums.partition_point(|s| *s <= wanted).clamp(1, PIECES) - 1;
        let share = (wanted - sums[k]) / (sums[k + 1] - sums[k]).max(f64::MIN_POSITIVE);
        let u = at(k) + share.clamp(0.0, 1.0) * (at(k + 1) - at(k));
        if j == last { most } else { u * u * FRAC_PI_2 }
    };
    (0..options.theta_i).map(theta).collect()
}

fn azimuths(ndf: &Ndf, options: &PlanOptions) -> Vec<f64> {
    if ndf.is_isotropic() {
        return vec![0.0];
    }
    let whole = if options.quarter { FRAC_PI_2 } else { PI };
    let at = |k: usize| -PI + whole * k as f64 / (options.phi_i - 1) as f64;
    (0..options.phi_i).map(at).collect()
}

/// The cells of one incident direction.
fn outgoing(
    densities: &Densities,
    [p, t]: [usize; 2],
    [phi, theta]: [f64; 2],
    options: &PlanOptions,
    cells: &mut Vec<Cell>,
) -> Result<(), PlanError> {
    let warp = densities
        .visible(theta, phi, options.wide)
        .ok_or(PlanError::Dark { theta_i_deg: theta.to_degrees() })?;
    let blend: Blend = [(0, 1.0), (0, 0.0), (0, 0.0), (0, 0.0)];
    let i = density::direction(theta, phi);
    let last = (options.side - 1) as f64;
    for row in 0..options.side {
        for column in 0..options.side {
            let u = DVec2::new(column as f64 / last, row as f64 / last);
            let (place, _) = warp.sample(u, &blend);
            let m = densities.normal(phi, place);
            let outgoing = (2.0 * i.dot(m) * m - i).normalize();
            cells.push(Cell { index: [p, t, row, column], u, outgoing, step: None });
        }
    }
    Ok(())
}

/// Directions closer than this are one, radians.
const SAME: f64 = 1e-5;
/// Mirror images of an isotropic sample that are closer than this are one, radians: a hundredth of a degree is nothing to a goniometer.
const SAME_IMAGE: f64 = 2e-4;

/// The direction that stands for a direction and its images: an isotropic sample is the same on both sides of the plane of incidence, and seen from the light's own
/// azimuth all around where the light comes along the normal.
pub(crate) fn representative(outgoing: DVec3, theta_i_rad: f64) -> DVec3 {
    if theta_i_rad.abs() < 1e-6 {
        return DVec3::new(-outgoing.x.hypot(outgoing.y), 0.0, outgoing.z);
    }
    DVec3::new(outgoing.x, outgoing.y.abs(), outgoing.z)
}

/// One measurement for each direction above the horizon, and of an isotropic sample for each with its images; cells get its number among them.
fn everywhere(
    cells: &mut [Cell],
    incident: [usize; 2],
    isotropic: bool,
    theta_i_rad: f64,
) -> Vec<Step> {
    let mut steps: Vec<Step> = Vec::new();
    let near = if isotropic { SAME_IMAGE } else { SAME };
    for cell in cells {
        if cell.outgoing.z <= 1e-6 {
            continue;
        }
        let outgoing =
            if isotropic { representative(cell.outgoing, theta_i_rad) } else { cell.outgoing };
        let same = |s: &Step| (s.outgoing - outgoing).length() < near;
        let at = steps.iter().position(same).unwrap_or_else(|| {
            steps.push(Step { incident, outgoing, marks_deg: None });
            steps.len() - 1
        });
        cell.step = Some(at);
    }
    steps
}
