//! Plan of a pass: what the mount will have to do, before it moves.

use super::path::{TargetPath, angles, direction, wrapped};
use super::pier;
use super::safety::{Danger, Guard};
use super::tracker::TrackOptions;
use serde::Serialize;
use sunglint_drivers::device::{MountAbilities, MountAxes};
use sunglint_formats::time::format_utc;
use sunglint_numerics::axes::Axes;

/// Step in which a path is looked at, s.
const STEP_S: f64 = 0.5;

/// Stretch of a pass in which the first axis cannot follow, near the pole of the axes: it runs ahead at its largest rate from before, and meets the target after.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Keyhole {
    /// Beginning of the stretch, seconds of the path.
    pub from_s: f64,
    /// End of the stretch, seconds of the path.
    pub to_s: f64,
    /// Angle of the first axis at both ends, deg; the second within 180° of the first.
    pub first_deg: [f64; 2],
    /// Fastest that the target asks of the first axis, deg/s.
    pub asked_deg_s: f64,
}

impl Keyhole {
    /// The keyhole of a path for an axis of this speed, deg/s; `None` where it can follow all the way.
    pub fn of(path: &TargetPath, most_deg_s: f64) -> Option<Self> {
        // A part of the speed is kept to correct with.
        let speed = 0.95 * most_deg_s;
        let count = (path.seconds() / STEP_S) as usize;
        let mut first: Vec<f64> = Vec::with_capacity(count + 1);
        for i in 0..=count {
            let angle = angles(path.at(i as f64 * STEP_S).direction)[0];
            let last = first.last().copied().unwrap_or(angle);
            first.push(last + wrapped(angle - last));
        }
        let rate = |i: usize| (first[i + 1] - first[i]) / STEP_S;
        let fastest = (0..count).max_by(|a, b| rate(*a).abs().total_cmp(&rate(*b).abs()))?;
        // In half a second a pass over the zenith itself turns by half a circle.
        let asked_deg_s = {
            let middle_s = (fastest as f64 + 0.5) * STEP_S;
            let at = |s: f64| angles(path.at(middle_s + s).direction)[0];
            (wrapped(at(0.01) - at(-0.01)) / 0.02).abs().max(rate(fastest).abs())
        };
        if asked_deg_s <= speed {
            return None;
        }
        for half in 1..=count {
            let low = fastest.saturating_sub(half);
            let high = (fastest + 1 + half).min(count);
            let asked = (first[high] - first[low]).abs() / ((high - low) as f64 * STEP_S);
            if asked <= speed || (low == 0 && high == count) {
                return Some(Self {
                    from_s: low as f64 * STEP_S,
                    to_s: high as f64 * STEP_S,
                    first_deg: [first[low], first[high]],
                    asked_deg_s,
                });
            }
        }
        None
    }

    /// Length of the stretch in which the target is lost, s.
    pub fn lost_s(&self) -> f64 {
        self.to_s - self.from_s
    }

    /// The angle of the first axis at a time within the stretch, deg.
    pub fn first_deg(&self, time_s: f64) -> Option<f64> {
        let part = (time_s - self.from_s) / (self.to_s - self.from_s);
        let [a, b] = self.first_deg;
        (0.0..=1.0).contains(&part).then_some(a + part * (b - a))
    }
}

/// Largest distance from its target, arcsec on each axis, of a mount that takes a few rates only and is switched each `period_s` between the two that are next to what a target of up to this rate asks for: half of the way that
/// the widest gap between them makes in that time. `None` of other mounts.
pub(crate) fn ripple_arcsec(
    abilities: &MountAbilities,
    up_to_deg_s: f64,
    period_s: f64,
) -> Option<f64> {
    Some(0.5 * abilities.step_deg_s(up_to_deg_s)? * period_s * 3600.0)
}

/// Plan of a pass.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct PassPlan {
    /// Name of the target.
    pub target: String,
    /// First moment of the path, UTC.
    pub from_utc: String,
    /// Last moment of the path, UTC.
    pub to_utc: String,
    /// Kind of the axes: `equatorial` (hour angle, declination) or `horizontal` (azimuth, altitude).
    pub axes: &'static str,
    /// Angles at the beginning, deg.
    pub begin_deg: Axes,
    /// Angles at the end, deg.
    pub end_deg: Axes,
    /// Highest altitude, deg.
    pub highest_deg: f64,
    /// Fastest rates that the path asks of the two axes, deg/s.
    pub fastest_deg_s: Axes,
    /// Largest rates of the mount, deg/s, where it takes rates.
    pub mount_deg_s: Option<Axes>,
    /// Largest distance from the target of a mount that takes a few rates only, arcsec on each axis: it goes to and fro between two of them.
    pub ripple_arcsec: Option<f64>,
    /// Way of the two axes from where the mount stands to the beginning, deg.
    pub slew_deg: Option<Axes>,
    /// Whether the way to the beginning goes over another place, to keep off the Sun.
    pub detour: bool,
    /// Times of the path at which the target crosses the meridian above the pole: a German mount turns over there, s.
    pub meridian_s: Vec<f64>,
    /// Whether this mount turns over at the meridian.
    pub turns_over: bool,
    /// Times of the path at which it does, s.
    pub turns_s: Vec<f64>,
    /// Stretch in which the first axis cannot follow.
    pub keyhole: Option<Keyhole>,
    /// Least distance of the path from the Sun, deg.
    pub sun_deg: f64,
    /// Altitude of the Sun at the beginning, deg.
    pub sun_altitude_deg: f64,
    /// Whether the Sun's cone holds at the beginning.
    pub sun_cone_holds: bool,
    /// Reason for which it will not be followed, if there is one.
    pub refused: Option<String>,
}

impl PassPlan {
    /// Plans a path for a mount that stands at these angles now, deg, where that is known, and that is moved with these options.
    pub fn new(
        target: &str,
        path: &TargetPath,
        guard: &Guard,
        abilities: &MountAbilities,
        stands_deg: Option<Axes>,
        options: &TrackOptions,
    ) -> Self {
        let frame = path.frame();
        let count = (path.seconds() / STEP_S) as usize;
        let (mut highest, mut fastest, mut sun_deg) = (-90.0_f64, [0.0_f64; 2], 180.0_f64);
        let mut meridian_s = Vec::new();
        let mut last_hour_angle: Option<f64> = None;
        let mut refused: Option<Danger> = None;
        for i in 0..=count {
            let time_s = i as f64 * STEP_S;
            let place = path.at(time_s);
            let enu = frame.to_enu(place.direction);
            let motion = sunglint_ephemeris::motion::AxisMotion::of(place.direction, place.per_s);
            for (most, rate) in fastest.iter_mut().zip(motion.deg_s.to_array()) {
                *most = most.max(rate.abs());
            }
            highest = highest.max(path.altitude_deg(time_s));
            let utc = path.epoch(time_s);
            sun_deg = sun_deg.min(guard.sun_distance_deg(enu, utc));
            if refused.is_none() {
                refused = guard.check_place(enu, utc).err();
            }
            let equatorial = sunglint_ephemeris::motion::equatorial_axes(enu, frame.latitude_deg);
            let hour_angle = angles(equatorial)[0];
            if let Some(last) = last_hour_angle
                && last * hour_angle <= 0.0
                && (last - hour_angle).abs() < 90.0
            {
                meridian_s.push(time_s);
            }
            last_hour_angle = Some(hour_angle);
        }
        let begin_deg = angles(path.at(0.0).direction);
        let utc = path.from();
        let sun = guard.sun(utc);
        let mut detour = false;
        if let Some(stands) = stands_deg
            && refused.is_none()
        {
            let [from, to] = [stands, begin_deg].map(|angle| frame.to_enu(direction(angle)));
            match guard.way(from, to, utc, options.slew_within_s) {
                Ok(way) => detour = way.len() > 1,
                Err(danger) => refused = Some(danger),
            }
        }
        let mount_deg_s = abilities.fastest_deg_s();
        let horizontal = frame.axes == MountAxes::Horizontal;
        let keyhole = mount_deg_s.and_then(|most| Keyhole::of(path, most[0]));
        Self {
            target: target.to_owned(),
            from_utc: format_utc(utc, 1),
            to_utc: format_utc(path.epoch(path.seconds()), 1),
            axes: if horizontal { "horizontal" } else { "equatorial" },
            begin_deg,
            end_deg: angles(path.at(path.seconds()).direction),
            highest_deg: highest,
            fastest_deg_s: fastest.into(),
            mount_deg_s,
            ripple_arcsec: ripple_arcsec(abilities, fastest[0].max(fastest[1]), options.period_s),
            slew_deg: stands_deg
                .map(|stands| [wrapped(begin_deg[0] - stands[0]), begin_deg[1] - stands[1]].into()),
            detour,
            meridian_s,
            turns_over: abilities.tells_pier_side,
            turns_s: match abilities.tells_pier_side {
                true => pier::turns_s(path, options.past_meridian_deg),
                false => Vec::new(),
            },
            keyhole,
            sun_deg,
            sun_altitude_deg: sun.altitude_deg,
            sun_cone_holds: guard.cone_holds(&sun),
            refused: refused.map(|danger| danger.to_string()),
        }
    }
}
