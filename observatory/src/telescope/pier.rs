//! The side of the pier on which a German mount hangs, and when it has to turn over.
//!
//! The counterweight stays below the telescope: hanging east of the pier it looks west of the meridian (hour angles of 0° to 180°), hanging west it looks east
//! (−180° to 0°). How far past these ends it may go depends on the tube and the pier.

use super::path::{TargetPath, angles, wrapped};
use sunglint_drivers::device::{MountAxes, PierSide};

/// Step in which a path is looked at, s.
const STEP_S: f64 = 0.5;

/// Side on which a mount hangs after it was sent to an hour angle, deg.
pub(super) fn side_for(hour_angle_deg: f64) -> PierSide {
    if wrapped(hour_angle_deg) < 0.0 { PierSide::West } else { PierSide::East }
}

/// Distance of an hour angle past the end of a side, deg; not above 0 where the mount can stay on that side.
pub(super) fn past_deg(side: PierSide, hour_angle_deg: f64) -> f64 {
    let middle = match side {
        PierSide::East => 90.0,
        PierSide::West => -90.0,
    };
    wrapped(hour_angle_deg - middle).abs() - 90.0
}

/// The other side.
pub(super) fn other(side: PierSide) -> PierSide {
    match side {
        PierSide::East => PierSide::West,
        PierSide::West => PierSide::East,
    }
}

/// A margin of hour angle at a declination, deg: near the pole a small error on the sky is a large one of hour angle. At most 20 times as wide.
pub(super) fn margin_deg(on_the_sky_deg: f64, declination_deg: f64) -> f64 {
    on_the_sky_deg / declination_deg.to_radians().cos().max(0.05)
}

/// Times of a path of hour angles at which a mount turns over, s, where it hangs on the side of its first place and stays there up to `most_past_deg` past the end.
/// Nothing for other axes.
pub(super) fn turns_s(path: &TargetPath, most_past_deg: f64) -> Vec<f64> {
    if path.frame().axes != MountAxes::Equatorial {
        return Vec::new();
    }
    let hour_angle = |time_s: f64| angles(path.at(time_s).direction)[0];
    let mut side = side_for(hour_angle(0.0));
    let mut turns = Vec::new();
    let count = (path.seconds() / STEP_S) as usize;
    for time_s in (0..=count).map(|i| i as f64 * STEP_S) {
        let angle = hour_angle(time_s);
        if past_deg(side, angle) > most_past_deg {
            turns.push(time_s);
            side = side_for(angle);
        }
    }
    turns
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the cosine: 0.5° on the sky is 1° of hour angle at a declination of 60°.
    #[test]
    fn margins_grow_towards_the_pole() {
        assert!((margin_deg(0.5, 60.0) - 1.0).abs() < 1e-9);
        assert!((margin_deg(0.5, -90.0) - 10.0).abs() < 1e-9);
        assert_eq!(other(other(PierSide::East)), PierSide::East);
    }

    /// Truth: in words: what culminates is past the end on both sides by 0°, above the pole and below it.
    #[test]
    fn the_meridian_ends_both_sides() {
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-9, "{a} {b}");
        near(past_deg(PierSide::West, 3.0), 3.0);
        near(past_deg(PierSide::West, -3.0), -3.0);
        near(past_deg(PierSide::East, -3.0), 3.0);
        near(past_deg(PierSide::East, 90.0), -90.0);
        // Below the pole: 12 h.
        near(past_deg(PierSide::East, -178.0), 2.0);
        near(past_deg(PierSide::West, 178.0), 2.0);
        near(past_deg(PierSide::West, 181.0), -1.0);
        assert_eq!((side_for(-1.0), side_for(1.0)), (PierSide::West, PierSide::East));
        assert_eq!(side_for(359.0), PierSide::West);
    }
}
