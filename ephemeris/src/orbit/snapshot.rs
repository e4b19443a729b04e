//! Place of a target at one moment: what a table of single observations says.

use super::{OrbitError, State, seconds_between};
use glam::DVec3;
use hifitime::Epoch;
use sunglint_formats::time::format_utc_shortest;

/// Geocentric gravitational constant, m³ s⁻² (IERS Conventions 2010, table 1.1, TCB-compatible value rounded to TT's).
const GM_M3_S2: f64 = 3.986_004_418e14;
/// The Earth's oblateness J2 (EGM2008, tide-free).
const J2: f64 = 1.082_635_854e-3;
/// Equatorial radius that J2 goes with, m.
const RADIUS_M: f64 = 6_378_137.0;
/// A state with a velocity is carried no further than this, s: a fourth-order series errs by 4 mm at 10 s in a low orbit, by 10 cm at 30 s.
const REACH_S: f64 = 30.0;
/// Light takes no longer than this from a target of the Earth's, s: from beyond the Moon.
const LIGHT_S: f64 = 2.0;

/// A target's place at one moment, perhaps with its velocity.
///
/// With a velocity the state moves on under the oblate Earth's gravity for up to 30 s. Without one the place is where the light left, and there is no state for
/// any other light than that.
#[derive(Debug, Clone, PartialEq)]
pub struct Snapshot {
    name: String,
    epoch: Epoch,
    position_m: DVec3,
    velocity_m_s: Option<DVec3>,
}

impl Snapshot {
    /// A place in the GCRS (m) at an epoch.
    ///
    /// Without a velocity, `epoch` is when the light arrives, and the place is where it left.
    ///
    /// # Errors
    /// [`OrbitError::Row`] for numbers that are not finite.
    pub fn new(
        name: impl Into<String>,
        epoch: Epoch,
        position_m: DVec3,
        velocity_m_s: Option<DVec3>,
    ) -> Result<Self, OrbitError> {
        let name = name.into();
        let wrong = |quantity, value: DVec3| OrbitError::Row {
            name: name.clone(),
            row: 0,
            quantity,
            value: format!("{value}"),
            expected: "three finite numbers",
        };
        if !position_m.is_finite() {
            return Err(wrong("the position, m,", position_m));
        }
        if let Some(velocity) = velocity_m_s.filter(|v| !v.is_finite()) {
            return Err(wrong("the velocity, m/s,", velocity));
        }
        Ok(Self { name, epoch, position_m, velocity_m_s })
    }

    /// Name of the target.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns whether the velocity is known.
    pub fn has_velocity(&self) -> bool {
        self.velocity_m_s.is_some()
    }

    /// State at an epoch near the snapshot's own.
    ///
    /// # Errors
    /// [`OrbitError::OutsideEphemeris`] too far from it.
    pub fn state(&self, epoch: Epoch) -> Result<State, OrbitError> {
        let dt = seconds_between(self.epoch, epoch);
        let outside = || OrbitError::OutsideEphemeris {
            name: self.name.clone(),
            epoch_utc: format_utc_shortest(epoch),
            first_utc: format_utc_shortest(self.epoch),
            last_utc: format_utc_shortest(self.epoch),
        };
        let r = self.position_m;
        let Some(v) = self.velocity_m_s else {
            // A nanosecond, as epochs are counted.
            return match (-LIGHT_S..=1e-9).contains(&dt) {
                true => Ok(State { position_m: r, velocity_m_s: DVec3::ZERO }),
                false => Err(outside()),
            };
        };
        if dt.abs() > REACH_S {
            return Err(outside());
        }
        // Taylor's series of two-body motion: a = −μ r/r³, and its first and second derivative.
        let u = GM_M3_S2 / r.length().powi(3);
        let rv = r.dot(v) / r.length_squared();
        // J2 about the GCRS's pole, which the Earth's leaves by 0.15°; its change within 30 s is left out.
        let s2 = (r.z / r.length()).powi(2);
        let oblate = 1.5 * J2 * (RADIUS_M / r.length()).powi(2);
        let a =
            -u * r + u * oblate * DVec3::new(5.0 * s2 - 1.0, 5.0 * s2 - 1.0, 5.0 * s2 - 3.0) * r;
        let jerk = u * (3.0 * rv * r - v);
        let w = v.length_squared() / r.length_squared();
        let snap = u * ((u + 3.0 * w - 15.0 * rv * rv - 3.0 * u) * r + 6.0 * rv * v);
        let position_m = r + dt * (v + dt / 2.0 * (a + dt / 3.0 * (jerk + dt / 4.0 * snap)));
        let velocity_m_s = v + dt * (a + dt / 2.0 * (jerk + dt / 3.0 * snap));
        Ok(State { position_m, velocity_m_s })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: a fourth-order Runge–Kutta integration in steps of 10 ms in the potential of the oblate Earth, differentiated numerically; a low orbit and an ellipse.
    #[test]
    fn the_state_moves_as_an_integration_does() -> Result<(), OrbitError> {
        let potential = |p: DVec3| {
            let r = p.length();
            let legendre = 1.5 * (p.z / r).powi(2) - 0.5;
            GM_M3_S2 / r * (1.0 - 1.082_635_854e-3 * (6_378_137.0 / r).powi(2) * legendre)
        };
        let pull = |p: DVec3| {
            let slope = |d: DVec3| (potential(p + 50.0 * d) - potential(p - 50.0 * d)) / 100.0;
            DVec3::new(slope(DVec3::X), slope(DVec3::Y), slope(DVec3::Z))
        };
        let epoch = Epoch::from_mjd_utc(60_000.0);
        let starts = [
            (DVec3::new(5.0e6, 2.0e6, 4.3e6), DVec3::new(-4.1e3, 5.3e3, 2.9e3)),
            (DVec3::new(-9.0e6, 1.0e6, -7.0e6), DVec3::new(2.0e3, -4.6e3, -3.3e3)),
        ];
        for (from, speed) in starts {
            let snapshot = Snapshot::new("moving", epoch, from, Some(speed))?;
            // What is left out: J2's pull of 0.01 m/s² turns by 2e-3 rad/s.
            for to_s in [-10.0_f64, 1.0, 10.0, 29.0] {
                let (mut p, mut v) = (from, speed);
                let steps = 1000;
                let h = to_s / f64::from(steps);
                for _ in 0..steps {
                    let (k1, l1) = (v, pull(p));
                    let (k2, l2) = (v + 0.5 * h * l1, pull(p + 0.5 * h * k1));
                    let (k3, l3) = (v + 0.5 * h * l2, pull(p + 0.5 * h * k2));
                    let (k4, l4) = (v + h * l3, pull(p + h * k3));
                    p += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
                    v += h / 6.0 * (l1 + 2.0 * l2 + 2.0 * l3 + l4);
                }
                let state = snapshot.state(epoch + hifitime::Duration::from_seconds(to_s))?;
                let off = (state.position_m - p).length();
                assert!(off < 5e-6 * to_s.abs().powi(3), "{to_s} s: {off} m");
                assert!((state.velocity_m_s - v).length() < 3e-5 * to_s * to_s, "{to_s} s");
            }
            assert!(snapshot.state(epoch + hifitime::Duration::from_seconds(31.0)).is_err());
        }
        Ok(())
    }

    #[test]
    fn without_a_velocity_there_is_one_moment() -> Result<(), OrbitError> {
        let epoch = Epoch::from_mjd_utc(60_000.0);
        let snapshot = Snapshot::new("still", epoch, DVec3::new(7e6, 0.0, 0.0), None)?;
        let early = epoch - hifitime::Duration::from_seconds(0.004);
        assert_eq!(snapshot.state(early)?.position_m, DVec3::new(7e6, 0.0, 0.0));
        let late = epoch + hifitime::Duration::from_seconds(0.05);
        assert!(snapshot.state(late).is_err());
        assert!(Snapshot::new("bad", epoch, DVec3::NAN, None).is_err());
        Ok(())
    }
}
