//! Whether a finder sees the axes as it is said to: a star moves through its frames against the mount, by as much.
//!
//! A camera that is turned or mirrored otherwise than it is told drives the mount away from its star, farther with each correction. Its frames show it: after a correction the light is where the mount went to, not where it came from.

use glam::DVec2;

/// Ways of the mount below which nothing is judged, arcsec: seeing and backlash are smaller.
const LEAST_ARCSEC: f64 = 12.0;
/// A light whose flux changed by more is another one.
const ALIKE: f64 = 2.0;
/// A light that went less than this part of the mount's way, or more than its inverse, did not move with it: a hot pixel, another star, play of the gears.
const RIGID: f64 = 0.6;
/// Part of the mount's way by which a light's may differ from it, where the camera is as it is told.
const FITS: f64 = 0.5;
/// Ways that went wrong, more than went right, after which the camera is not believed.
const WRONG: u32 = 3;

/// One look at a light.
#[derive(Debug, Clone, Copy)]
struct Sight {
    /// Offset of the mount from the star's prediction along the growing axes, arcsec.
    mount: DVec2,
    /// Offset of the light in the frame along the growing axes as they are told, arcsec.
    light: DVec2,
    flux: f64,
}

/// Judges by the brightest light of frames.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sense {
    before: Option<Sight>,
    right: u32,
    wrong: u32,
}

impl Sense {
    /// Takes a frame: offset of the mount from the prediction of what stands among the stars, and the frame's lights (offset and flux), all along the growing axes, arcsec. Returns whether the camera is otherwise than it is told.
    pub(super) fn misleads(
        &mut self,
        mount: [f64; 2],
        lights: impl Iterator<Item = ([f64; 2], f64)>,
    ) -> bool {
        let Some((light, flux)) = lights.max_by(|a, b| a.1.total_cmp(&b.1)) else {
            return self.is_misled();
        };
        let now = Sight { mount: mount.into(), light: light.into(), flux };
        let alike = |other: f64| flux < ALIKE * other && other < ALIKE * flux;
        let Some(before) = self.before.filter(|before| alike(before.flux)) else {
            self.before = Some(now);
            return self.is_misled();
        };
        let (way, seen) = (now.mount - before.mount, now.light - before.light);
        let least = RIGID * way.length();
        if way.length() < LEAST_ARCSEC {
            return self.is_misled();
        }
        self.before = Some(now);
        if seen.length() > least && seen.length() * RIGID < way.length() {
            match (seen + way).length() / way.length() {
                off if off < FITS => self.right += 1,
                off if off > 1.0 => self.wrong += 1,
                _ => {}
            }
        }
        self.is_misled()
    }

    fn is_misled(&self) -> bool {
        self.wrong >= WRONG + self.right
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat2;

    /// A mount that corrects what a camera tells it of a star 20″ beside its middle, one correction a frame of which it does 0.7. Truth: the matrix by which the camera is otherwise than told, with 0.5″ of noise: none, a small turn and a flexure that grows are believed; turned by 90° or 180° and mirrored ones are not, within ten
    /// frames; a hot pixel and two stars by turns say nothing.
    #[test]
    fn a_camera_that_is_turned_otherwise_is_not_believed() {
        let run = |camera: DMat2, drift: f64| -> Option<u32> {
            let (mut sense, mut mount, star) =
                (Sense::default(), DVec2::ZERO, DVec2::new(15.0, 13.0));
            (0..10).find(|&frame| {
                let noise =
                    [0.37, 0.71].map(|step: f64| ((f64::from(frame) * step * 9.7).sin()) * 0.5);
                let light = camera * (star + drift * f64::from(frame) - mount) + DVec2::from(noise);
                let misled =
                    sense.misleads(mount.to_array(), [(light.to_array(), 100.0)].into_iter());
                mount += 0.7 * light;
                misled
            })
        };
        let turn = |deg: f64| DMat2::from_angle(deg.to_radians());
        let mirror = DMat2::from_diagonal(DVec2::new(-1.0, 1.0));
        for (camera, drift) in
            [(turn(0.0), 0.0), (turn(0.0), 15.0), (turn(12.0), 15.0), (1.1 * turn(-5.0), 0.0)]
        {
            assert_eq!(run(camera, drift), None, "{camera}");
        }
        for camera in [turn(90.0), turn(180.0), turn(-100.0), mirror, mirror * turn(90.0)] {
            assert!(run(camera, 0.0).is_some(), "{camera}");
        }
        let mut sense = Sense::default();
        for frame in 0..20 {
            let mount = [20.0 * f64::from(frame), 0.0];
            assert!(!sense.misleads(mount, [([5.0, 5.0], 100.0)].into_iter()));
        }
        for frame in 0..20 {
            let (mount, flux) =
                ([20.0 * f64::from(frame), 0.0], if frame % 2 == 0 { 100.0 } else { 300.0 });
            assert!(!sense.misleads(mount, [([20.0 * f64::from(frame), 0.0], flux)].into_iter()));
        }
    }
}
