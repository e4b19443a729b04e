//! From the period that is seen to the period of the spin.
//!
//! What is seen repeats when the body shows the same face to the bisector of Sun and observer (the phase-angle bisector). While the bisector moves by dφ about the spin axis,
//! the body turns by a whole turn ± dφ: 1/P_sidereal = 1/P_synodic ± φ̇/2π. The bisector's angular speed bounds φ̇ as long as it keeps away from the axis: about
//! an axis from which it stands β away, φ̇ ≤ speed/sin β.

use glam::DVec3;

/// What the geometry of a pass lets the sidereal period be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sidereal {
    /// The fastest the bisector moves, degrees per second.
    pub fastest_deg_s: f64,
    /// The angle from its first to its last direction, degrees.
    pub moved_deg: f64,
    /// The shortest and the longest period that the spin may have, s, for an axis across the bisector; the longest is infinite where the bisector turns as
    /// fast as the body.
    pub from_to_s: (f64, f64),
}

/// The bounds for a synodic period, from moments (s, increasing) and the unit vectors from the target to Sun and observer in a frame that does not turn (GCRS). `None` with
/// fewer than two moments, or where Sun and observer stand opposite one another.
pub fn sidereal(period_s: f64, moments: &[(f64, DVec3, DVec3)]) -> Option<Sidereal> {
    let bisectors = moments
        .iter()
        .map(|(t, sun, observer)| {
            let sum = *sun + *observer;
            // Opposite but for rounding: no direction is left.
            (sum.length() > 1e-9).then(|| (*t, sum.normalize()))
        })
        .collect::<Option<Vec<_>>>()?;
    let angle = |a: DVec3, b: DVec3| a.cross(b).length().atan2(a.dot(b));
    let speeds = bisectors.windows(2).filter(|w| w[1].0 > w[0].0);
    let fastest = speeds.map(|w| angle(w[0].1, w[1].1) / (w[1].0 - w[0].0)).reduce(f64::max)?;
    let (first, last) = (bisectors.first()?, bisectors.last()?);
    let frequency = 1.0 / period_s;
    let by = fastest / std::f64::consts::TAU;
    let longest = if frequency > by { 1.0 / (frequency - by) } else { f64::INFINITY };
    Some(Sidereal {
        fastest_deg_s: fastest.to_degrees(),
        moved_deg: angle(first.1, last.1).to_degrees(),
        from_to_s: (1.0 / (frequency + by), longest),
    })
}
