//! Attitudes that send the same light, or nearly: what the symmetry of geometry and body makes of one attitude.
//!
//! - **Exchange.** Reflection is reciprocal, and what is lit and seen is so by both directions alike: the light does not change if Sun and observer are exchanged, which half a turn of the body
//!   about their bisector does. It holds for every body, at one moment; over a pass the bisector moves, and the two attitudes part.
//! - **Half turns of the body** that leave it as it is.
//! - **Mirrors of the body.** A body that a plane mirrors onto itself sends the same light in the mirror image of its geometry: the attitude mirrored by the plane of Sun and observer,
//!   and by the body's own plane. The sense of the spin turns round, or its axis does.
//!
//! How nearly a body is symmetric is measured: by how much its light differs in directions all about it.

use super::AttitudeError;
use super::forward::Forward;
use super::state::{Law, State};
use glam::{DMat3, DQuat, DVec3};
use sunglint_numerics::sphere::spread;
use sunglint_simulator::light::View;

/// A body's light differs by less than this from its mirror image's for that to be called one.
pub const ALIKE: f64 = 0.3;
/// A body whose light changes by less than this with its attitude shows none.
const FEATURELESS: f64 = 1e-3;
/// Directions that a body is looked at from.
const LOOKS: usize = 400;

/// A plane or an axis of the body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Symmetry {
    /// In words.
    pub name: &'static str,
    /// The axis of the half turn, or the normal of the mirror, in the body.
    pub along: DVec3,
    /// Whether it is a mirror.
    pub mirror: bool,
    /// Mean difference of the light, of the mean light: 0 for a body that has the symmetry.
    pub unlike: f64,
}

/// Symmetry that makes one attitude of another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Twin {
    /// Whether Sun and observer are exchanged.
    pub exchanged: bool,
    /// The body's own symmetry in it.
    pub body: Option<Symmetry>,
}

impl Twin {
    /// In words.
    pub fn name(&self) -> String {
        let exchanged =
            "half a turn about the bisector of Sun and station, which exchanges the two";
        match (self.exchanged, &self.body) {
            (true, None) => exchanged.into(),
            (true, Some(body)) => format!("{exchanged}, and {}", body.name),
            (false, Some(body)) => body.name.into(),
            (false, None) => "the same".into(),
        }
    }

    /// Returns the relative difference of the light under the body's symmetry.
    pub fn unlike(&self) -> f64 {
        self.body.map_or(0.0, |b| b.unlike)
    }
}

const CANDIDATES: [(&str, DVec3, bool); 6] = [
    ("half a turn about the body's x axis", DVec3::X, false),
    ("half a turn about the body's y axis", DVec3::Y, false),
    ("half a turn about the body's z axis", DVec3::Z, false),
    ("the body mirrored along x, in the mirror of the plane of Sun and station", DVec3::X, true),
    ("the body mirrored along y, in the mirror of the plane of Sun and station", DVec3::Y, true),
    ("the body mirrored along z, in the mirror of the plane of Sun and station", DVec3::Z, true),
];

/// The reflection across a plane with this unit normal.
fn mirror(normal: DVec3) -> DMat3 {
    let outer = DMat3::from_cols(normal * normal.x, normal * normal.y, normal * normal.z);
    DMat3::IDENTITY - 2.0 * outer
}

impl Symmetry {
    fn matrix(&self) -> DMat3 {
        let mirror = mirror(self.along);
        // Half a turn about an axis is the mirror across it, and the inversion.
        if self.mirror { mirror } else { -mirror }
    }
}

/// Half turns about the body's axes and mirrors along them, with how unlike they leave the light at the middle's phase angle.
///
/// # Errors
/// A body that cannot be evaluated, or that sends the same light however it is turned.
pub fn symmetries(forward: &Forward) -> Result<Vec<Symmetry>, AttitudeError> {
    let middle = forward.moments.len() / 2;
    let Some(moment) = forward.moments.get(middle) else { return Ok(Vec::new()) };
    let unit = forward.unit_rates(middle);
    // All channels alike: each over its own sum.
    let mut value = vec![0.0; forward.weights];
    for row in unit.chunks_exact(forward.weights) {
        let sum: f64 = row.iter().sum();
        if sum > 0.0 {
            value.iter_mut().zip(row).for_each(|(v, r)| *v += r / sum);
        }
    }
    let mut evaluator = forward.scene.evaluator();
    let mut weights = vec![0.0; forward.weights];
    let mut light = |sun: DVec3, observer: DVec3| -> Result<Vec<f64>, AttitudeError> {
        evaluator.direct(sun, View::Distant(observer), &mut weights)?;
        Ok(weights.iter().zip(&value).map(|(w, v)| w * v).collect())
    };
    let angle = moment.to_sun.angle_between(moment.to_observer);
    let axes = spread(LOOKS, 0.0);
    let looks: Vec<(DVec3, DVec3)> = axes
        .iter()
        .enumerate()
        .map(|(i, sun)| {
            let across = sun.any_orthonormal_vector();
            let turned = DQuat::from_axis_angle(*sun, 2.399_963 * i as f64) * across;
            (*sun, *sun * angle.cos() + turned * angle.sin())
        })
        .collect();
    let mut found = Vec::new();
    let mut own = Vec::with_capacity(looks.len());
    for (sun, observer) in &looks {
        own.push(light(*sun, *observer)?);
    }
    let all: f64 = own.iter().flatten().sum();
    let totals: Vec<f64> = own.iter().map(|o| o.iter().sum()).collect();
    let mean = all / totals.len() as f64;
    let spread = totals.iter().map(|t| (t - mean).powi(2)).sum::<f64>() / totals.len() as f64;
    if spread.sqrt() <= FEATURELESS * mean {
        let change = if mean > 0.0 { spread.sqrt() / mean } else { 0.0 };
        return Err(AttitudeError::Featureless { change });
    }
    for (name, along, is_mirror) in CANDIDATES {
        let mut symmetry = Symmetry { name, along, mirror: is_mirror, unlike: 0.0 };
        let matrix = symmetry.matrix();
        let mut off = 0.0;
        for ((sun, observer), own) in looks.iter().zip(&own) {
            let other = light(matrix * *sun, matrix * *observer)?;
            // By spectrum: what changes its colour is not alike.
            off += own.iter().zip(&other).map(|(a, b)| (a - b).abs()).sum::<f64>();
        }
        symmetry.unlike = if all > 0.0 { off / all } else { 0.0 };
        found.push(symmetry);
    }
    Ok(found)
}

/// The attitudes that the symmetries make of one, in the middle of the data. Those that would turn about another axis of the body than the law's are none.
pub fn twins(
    forward: &Forward,
    law: &Law,
    state: &State,
    symmetries: &[Symmetry],
) -> Vec<(Twin, State)> {
    // The geometry in the middle of the data.
    let nearest = |m: &&super::forward::Moment| (m.time_s - law.middle_s).abs();
    let middle = forward.moments.iter().min_by(|a, b| nearest(a).total_cmp(&nearest(b)));
    let Some(middle) = middle else { return Vec::new() };
    let (sun, observer) = (middle.to_sun, middle.to_observer);
    let bisector = (sun + observer).try_normalize();
    let normal = sun.cross(observer).try_normalize();
    let exchange = bisector.map(|axis| DQuat::from_axis_angle(axis, std::f64::consts::PI));
    // About the moment of that geometry, not the zero of time, the exchange is a half turn.
    let spun = law.at(state, middle.time_s);
    let back = |at: DQuat, turns_per_s: f64| {
        let there = State { at_zero: at, turns_per_s };
        State { at_zero: law.at(&there, 2.0 * law.middle_s - middle.time_s), turns_per_s }
    };
    let mut all = Vec::new();
    let mut take = |body: Option<Symmetry>, at: DQuat, turns_per_s: f64| {
        if body.is_some() {
            all.push((Twin { exchanged: false, body }, back(at, turns_per_s)));
        }
        if let Some(exchange) = exchange {
            let at = (exchange * at).normalize();
            all.push((Twin { exchanged: true, body }, back(at, turns_per_s)));
        }
    };
    take(None, spun, state.turns_per_s);
    for symmetry in symmetries.iter().filter(|s| s.unlike < ALIKE) {
        let matrix = symmetry.matrix();
        let axis = law.axis_body();
        let kept = (matrix * axis).dot(axis);
        if kept.abs() < 1.0 - 1e-9 {
            continue;
        }
        let own = DMat3::from_quat(spun);
        let (turned, sense) = if symmetry.mirror {
            let Some(normal) = normal else { continue };
            (mirror(normal) * own * matrix, -kept.signum())
        } else {
            (own * matrix, kept.signum())
        };
        take(Some(*symmetry), DQuat::from_mat3(&turned).normalize(), sense * state.turns_per_s);
    }
    all
}
