//! Lights that the camera of a mount sees, on their way from the thread of the camera to that of the mount.

use super::plan::View;
use crate::spots::lights;
use glam::DVec2;
use hifitime::{Epoch, Unit};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use sunglint_drivers::clock::Deadline;
use sunglint_drivers::device::{DeviceError, Finder, FinderFrame, PierSide, Spot};
use sunglint_formats::Frame;

/// Frames that wait at most: the newest count.
const MOST: usize = 8;
/// Frames of which it is known where their pixels lie: of so many seconds, and so many at most.
const KNOWN: (f64, usize) = (60.0, 6000);

/// Where a frame lies on its sensor, and when it was taken.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Placed {
    start: Epoch,
    exposure_s: f64,
    origin: [u32; 2],
    binning: [u32; 2],
    size: [usize; 2],
}

impl Placed {
    fn of(frame: &Frame) -> Self {
        let (rows, columns) = frame.pixels.dim();
        Self {
            start: frame.start,
            exposure_s: frame.exposure_s,
            origin: frame.origin,
            binning: frame.binning,
            size: [columns, rows],
        }
    }

    fn middle(&self) -> Epoch {
        self.start + 0.5 * self.exposure_s * Unit::Second
    }

    /// Place on the sensor from its middle, px, of a place in the frame, whose first pixel's middle is 0, 0.
    fn beside_middle(&self, at_px: DVec2, sensor_px: DVec2) -> DVec2 {
        [0, 1]
            .map(|i| {
                // The first pixel's middle lies half a pixel from the edge.
                let at = f64::from(self.origin[i]) + (at_px[i] + 0.5) * f64::from(self.binning[i]);
                at - 0.5 * sensor_px[i]
            })
            .into()
    }
}

/// The lights of the last frames.
#[derive(Debug)]
pub struct Sights {
    view: View,
    frames: Mutex<VecDeque<FinderFrame>>,
    known: Mutex<VecDeque<Placed>>,
    /// Columns and rows of the sensor.
    sensor_px: Mutex<DVec2>,
}

impl Sights {
    /// For a camera that sees the axes so.
    pub fn new(view: View) -> Self {
        Self {
            view,
            frames: Mutex::default(),
            known: Mutex::default(),
            sensor_px: Mutex::default(),
        }
    }

    fn frames(&self) -> MutexGuard<'_, VecDeque<FinderFrame>> {
        self.frames.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The camera's sensor, px.
    pub fn sensor(&self, size_px: [u32; 2]) {
        *self.sensor_px.lock().unwrap_or_else(PoisonError::into_inner) =
            size_px.map(f64::from).into();
    }

    /// Columns and rows of the sensor, px; 0 before the camera is open.
    pub fn sensor_px(&self) -> DVec2 {
        *self.sensor_px.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// How the camera sees the axes.
    pub fn view(&self) -> View {
        self.view
    }

    /// Half of the sensor's smaller side on the sky, arcsec.
    pub fn half_arcsec(&self) -> f64 {
        let DVec2 { x: columns, y: rows } = self.sensor_px();
        0.5 * self.view.scale_arcsec * columns.min(rows)
    }

    /// Takes a frame of a sensor of this size.
    pub fn see(&self, frame: &Frame, sensor_px: [u32; 2]) {
        let (placed, sensor) = (Placed::of(frame), sensor_px.map(f64::from).into());
        let spots = lights(frame.pixels.view()).into_iter().map(|light| Spot {
            offset_arcsec: self
                .view
                .offset_arcsec(placed.beside_middle(light.at_px.into(), sensor)),
            flux: light.flux_adu / frame.exposure_s.max(1e-6),
        });
        let seen = FinderFrame { middle: placed.middle(), spots: spots.collect() };
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        known.push_back(placed);
        let is_old = |old: &Placed| (placed.start - old.start).to_seconds() > KNOWN.0;
        while known.len() > KNOWN.1 || known.front().is_some_and(is_old) {
            known.pop_front();
        }
        drop(known);
        let mut frames = self.frames();
        frames.push_back(seen);
        while frames.len() > MOST {
            frames.pop_front();
        }
    }

    /// Middle of the exposure of the frame that began at a time, and the offset of a place in it from where targets are kept, arcsec along the growing axes. The
    /// place counts in pixels of the frame, the first pixel's middle is 0, 0.
    ///
    /// # Errors
    /// In words: a frame that is too old, a place outside.
    pub fn place(&self, start: Epoch, place_px: DVec2) -> Result<(Epoch, DVec2), String> {
        let known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        // Start times travel in seconds.
        let is_it = |placed: &&Placed| (placed.start - start).to_seconds().abs() < 5e-4;
        let Some(placed) = known.iter().rev().find(is_it) else {
            return Err("that frame is too old, or no frame of the sky: take a newer one".into());
        };
        let inside = |i: usize| (-0.5..=placed.size[i] as f64 - 0.5).contains(&place_px[i]);
        if !(inside(0) && inside(1)) {
            return Err("that place lies outside of the frame".into());
        }
        let from_middle = placed.beside_middle(place_px, self.sensor_px());
        Ok((placed.middle(), self.view.offset_arcsec(from_middle)))
    }

    /// Forgets what was seen of another target.
    pub fn clear(&self) {
        self.frames().clear();
    }
}

/// The camera as the mount's finder.
#[derive(Debug)]
pub struct CameraFinder(pub Arc<Sights>);

impl Finder for CameraFinder {
    fn half_width_deg(&self) -> f64 {
        (self.0.half_arcsec() / 3600.0).max(1.0 / 60.0)
    }

    fn side(&self) -> Option<PierSide> {
        self.0.view.side
    }

    fn frame(&mut self, _: &Deadline) -> Result<Option<FinderFrame>, DeviceError> {
        Ok(self.0.frames().pop_front())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Array2;
    use sunglint_formats::fits::Header;
    use sunglint_formats::time::parse_utc;

    /// Truth: by hand: a light 10 columns right of the aim and 20 rows above it, at 2″ a pixel; the same light in a window and in bins; turned by 90°, mirrored.
    #[test]
    fn pixels_become_offsets_of_the_axes() {
        let view = |angle_deg, mirrored| View {
            scale_arcsec: 2.0,
            angle_deg,
            mirrored,
            side: None,
            aim_px: DVec2::new(5.0, -3.0),
        };
        let place = DVec2::new(15.0, -23.0);
        let near = |found: DVec2, expected: [f64; 2]| {
            let off = (found[0] - expected[0]).hypot(found[1] - expected[1]);
            assert!(off < 1e-9, "{found:?} {expected:?}");
        };
        near(view(0.0, false).offset_arcsec(place), [20.0, 40.0]);
        near(view(0.0, true).offset_arcsec(place), [-20.0, 40.0]);
        near(view(90.0, false).offset_arcsec(place), [-40.0, 20.0]);

        let sensor_px = [100, 80];
        let seen = |origin: [u32; 2], size: [usize; 2], bins: u32, at: [f64; 2]| {
            let pixels = Array2::from_shape_fn((size[1], size[0]), |(row, column)| {
                let (dx, dy) = (column as f64 - at[0], row as f64 - at[1]);
                (100.0 + 9000.0 * (-(dx * dx + dy * dy) / 4.5).exp()) as u16
            });
            let frame = Frame {
                pixels,
                origin,
                binning: [bins; 2],
                bayer: None,
                start: parse_utc("2026-11-21T18:00:00Z").unwrap(),
                exposure_s: 2.0,
                gain_e_per_adu: None,
                temperature_c: None,
                saturation_adu: None,
                header: Header::default(),
            };
            let sights = Arc::new(Sights::new(view(0.0, false)));
            sights.sensor(sensor_px);
            sights.see(&frame, sensor_px);
            let mut finder = CameraFinder(sights);
            let deadline = Deadline::within(std::time::Duration::from_secs(1));
            let found = finder.frame(&deadline).unwrap().unwrap();
            assert!(finder.frame(&deadline).unwrap().is_none());
            assert_eq!(found.middle, parse_utc("2026-11-21T18:00:01Z").unwrap());
            found.spots[0].offset_arcsec
        };
        // The middle of a sensor of 100 by 80 lies at column 49.5, row 39.5.
        let close = |found: DVec2| {
            let off = (found[0] - 20.0).hypot(found[1] - 40.0);
            assert!(off < 0.3, "{found:?}");
        };
        close(seen([0, 0], [100, 80], 1, [64.5, 16.5]));
        close(seen([40, 4], [50, 40], 1, [24.5, 12.5]));
        // In bins of two, the middle of sensor pixel 64.5 is that of bin 32.
        close(seen([0, 0], [50, 40], 2, [32.0, 8.0]));
    }
}
