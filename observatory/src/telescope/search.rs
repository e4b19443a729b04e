//! Search for a bright star with a camera whose field is too narrow to be found by its stars: fields in rings about where the star should be, until it is seen; then it is brought into the middle.
//!
//! Nothing has to be known of the camera but how much it sees. Two short moves show how its rows and columns lie to the axes of the mount.

use super::goto::{CameraAxes, Gone, Goto, GotoError, GotoTarget, check_untouched};
use super::path::{angles, wrapped};
use super::steer::Orders;
use super::tracker::{TrackError, TrackStep, shifted};
use glam::{DMat2, DVec2};
use hifitime::Epoch;
use std::ops::ControlFlow;
use sunglint_drivers::clock::Cancel;
use sunglint_drivers::device::{MountMotion, PierSide};

/// Distance of the fields' middles as a part of a field's sides, where the camera's turn is known: a degree or two of it may be wrong, and the mount stops some arcsec beside.
const SPACING: f64 = 0.94;
/// The same as a part of the narrower side, where it is not known: the circle that fits into a field covers the square between four of them (half of its diagonal is 0.5 at 0.707).
const SPACING_UNKNOWN: f64 = 0.69;
/// A light whose flux changed by more is another one.
const ALIKE: f64 = 2.0;
/// Length of the moves by which the camera's axes are found, as a part of the narrower side of a field.
const NUDGE: f64 = 0.15;
/// A light that went less than this part of such a move, or more than its inverse, did not move with the mount.
const RIGID: f64 = 0.5;
/// Fields at most: a wider search, or a narrower field, takes a quarter of an hour and more.
const MOST_FIELDS: usize = 1000;

/// Light in a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Light {
    /// Place from the frame's middle, px: to the right, and up (towards row 0).
    pub place_px: DVec2,
    /// Brightness, in the frames' unit.
    pub flux: f64,
}

/// Lights of a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Lights {
    /// Middle of the exposure.
    pub middle: Epoch,
    /// Width and height of the frame, px.
    pub size_px: DVec2,
    /// The lights.
    pub lights: Vec<Light>,
}

/// Takes a frame and says which lights it sees.
pub type Glance<'a> = dyn FnMut(&Cancel) -> Result<Lights, String> + 'a;

/// How a star is searched for.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct SearchOptions {
    /// Farthest that the mount may be off, deg.
    pub radius_deg: f64,
    /// Angle that a pixel sees, arcsec, within a third.
    pub scale_arcsec: f64,
    /// Flux from which on a light is taken for the star as soon as it is seen. Without it all fields are looked at, and the brightest light of all is the star.
    pub least_flux: Option<f64>,
    /// Turn of the camera, deg ([`CameraAxes::camera_angle_deg`]), where it is known: then half as many fields do.
    pub camera_angle_deg: Option<f64>,
    /// Rest before a frame of the search, s.
    pub settle_s: f64,
}

impl SearchOptions {
    /// A search half a degree far, for frames of this scale, arcsec a pixel.
    pub fn new(scale_arcsec: f64) -> Self {
        Self {
            radius_deg: 0.5,
            scale_arcsec,
            least_flux: None,
            camera_angle_deg: None,
            settle_s: 0.1,
        }
    }
}

/// Number of fields about as large as [`fields`] makes.
fn count(radius: f64, spacing: DVec2) -> usize {
    let places = 2.0 * (radius / spacing).ceil() + 1.0;
    (places.x * places.y).min(1e9) as usize
}

/// Offsets of fields from where the star should be: a lattice of these spacings, turned, that covers a circle; ring by ring about the middle, each once round, so that the ways are short.
fn fields(radius: f64, spacing: DVec2, turn_deg: f64) -> Vec<DVec2> {
    let reach = (radius / spacing).ceil();
    let [columns, rows] = [reach.x as i32, reach.y as i32];
    let mut places: Vec<DVec2> = (-columns..=columns)
        .flat_map(|i| (-rows..=rows).map(move |k| DVec2::new(f64::from(i), f64::from(k))))
        // A field at the rim is needed where the nearest corner of its rectangle is inside.
        .filter(|place| ((place.abs() - 0.5).max(DVec2::ZERO) * spacing).length() <= radius)
        .collect();
    let ring = |place: &DVec2| place.abs().max_element().round() as i64;
    let angle = |place: &DVec2| place.y.atan2(place.x);
    places.sort_by(|a, b| ring(a).cmp(&ring(b)).then(angle(a).total_cmp(&angle(b))));
    let turn = DVec2::from_angle(turn_deg.to_radians());
    places.into_iter().map(|place| turn.rotate(place * spacing)).collect()
}

/// The brightest light.
fn brightest(lights: &Lights) -> Option<Light> {
    lights.lights.iter().copied().max_by(|a, b| a.flux.total_cmp(&b.flux))
}

/// The light of this brightness, the nearest to its flux.
fn same(lights: &Lights, flux: f64) -> Option<Light> {
    let off = |light: &Light| (light.flux / flux).ln().abs();
    let alike = lights.lights.iter().copied().filter(|light| off(light) < ALIKE.ln());
    alike.min_by(|a, b| off(a).total_cmp(&off(b)))
}

impl Goto<'_> {
    /// Goes to a bright star, looks for it in fields about where it should be, and brings it into the frame's middle. With [`GotoOptions::sync`](super::GotoOptions::sync) the mount is told that it
    /// points at the star then.
    ///
    /// # Errors
    /// A star that is not seen ([`GotoError::Unseen`]), and see [`GotoError`]. A goto that was broken off ends in a stop.
    pub fn search(
        &mut self,
        target: &GotoTarget,
        glance: &mut Glance<'_>,
        options: &SearchOptions,
        cancel: &Cancel,
        each: &mut dyn FnMut(&TrackStep) -> ControlFlow<()>,
    ) -> Result<Gone, GotoError> {
        let orders = Orders::default();
        // What the first frame says of the field's size.
        let settle_s = self.options.settle_s;
        let first = self.glance(target, &orders, (glance, settle_s), None, cancel, each)?;
        let size_arcsec = first.lights.size_px * options.scale_arcsec;
        let side_arcsec = size_arcsec.min_element();
        let (spacing, turn_deg) = match options.camera_angle_deg {
            Some(angle_deg) => (SPACING * size_arcsec, angle_deg),
            None => (DVec2::splat(SPACING_UNKNOWN * side_arcsec), 0.0),
        };
        let radius_arcsec = options.radius_deg * 3600.0;
        // The lattice is a square about the circle.
        let all = count(radius_arcsec, spacing);
        if all > 2 * MOST_FIELDS {
            return Err(GotoError::TooManyFields {
                fields: all,
                most: MOST_FIELDS,
                field_deg: side_arcsec / 3600.0,
                radius_deg: options.radius_deg,
            });
        }
        let fields = fields(radius_arcsec, spacing, turn_deg);
        if fields.len() > MOST_FIELDS {
            return Err(GotoError::TooManyFields {
                fields: fields.len(),
                most: MOST_FIELDS,
                field_deg: side_arcsec / 3600.0,
                radius_deg: options.radius_deg,
            });
        }
        let mut found: Option<(DVec2, Light)> = None;
        let mut seen = first.clone();
        let mut forbidden = 0;
        for (i, place) in fields.iter().enumerate() {
            if i > 0 {
                orders.keep(*place);
                let rest = (&mut *glance, options.settle_s);
                let next = self.glance(target, &orders, rest, Some(&seen), cancel, each);
                // A field beyond a limit is left out: the star may be in another one. The refusal may have stopped the mount.
                if let Err(GotoError::Track(TrackError::Danger(_))) = next {
                    forbidden += 1;
                    seen.motion = self.reading(cancel)?.motion;
                    continue;
                }
                seen = next?;
            }
            let Some(light) = brightest(&seen.lights) else { continue };
            if found.is_none_or(|(_, best)| light.flux > best.flux) {
                found = Some((*place, light));
            }
            if options.least_flux.is_some_and(|least| light.flux >= least) {
                break;
            }
        }
        let enough = |light: &Light| options.least_flux.is_none_or(|least| light.flux >= least);
        let Some((place, light)) = found.filter(|(_, light)| enough(light)) else {
            let (fields, radius_deg) = (fields.len() - forbidden, options.radius_deg);
            let flux = found.map(|(_, light)| light.flux);
            return Err(GotoError::Unseen { fields, forbidden, radius_deg, flux });
        };
        if orders.keep_arcsec() != place {
            orders.keep(place);
            let rest = (&mut *glance, options.settle_s);
            seen = self.glance(target, &orders, rest, Some(&seen), cancel, each)?;
        }
        let nudge = NUDGE * side_arcsec;
        let (matrix, seen) = self.axes_seen(
            (target, &orders),
            (glance, nudge, options.scale_arcsec),
            (seen, light.flux),
            cancel,
            each,
        )?;
        self.centre((target, &orders), glance, (matrix, seen, light.flux), cancel, each)
    }

    /// Sends the mount to where the target is to be kept, and takes a frame there. `last` is the frame before: who stopped the mount since then has ended the search, and a mount that turned over shows other places.
    fn glance(
        &mut self,
        target: &GotoTarget,
        orders: &Orders,
        (glance, settle_s): (&mut Glance<'_>, f64),
        last: Option<&Glanced>,
        cancel: &Cancel,
        each: &mut dyn FnMut(&TrackStep) -> ControlFlow<()>,
    ) -> Result<Glanced, GotoError> {
        if let Some(last) = last {
            let now = self.reading(cancel)?;
            check_untouched(last.motion, now.motion)?;
        }
        let (_, own_arcsec) = self.arrive(target, orders, cancel, each)?;
        self.rest(settle_s, cancel)?;
        let before = self.reading(cancel)?;
        if let Some(last) = last {
            check_untouched(last.motion, before.motion)?;
        }
        let lights = glance(cancel);
        let after = self.reading(cancel)?;
        check_untouched(before.motion, after.motion)?;
        let lights = lights.map_err(GotoError::Blind)?;
        match (last.and_then(|last| last.pier), after.pier) {
            (Some(last), Some(now)) if last != now => Err(GotoError::TurnedOver),
            _ => Ok(Glanced { own_arcsec, lights, pier: after.pier, motion: after.motion }),
        }
    }

    /// Two short moves along the axes: by how many px a light moves to the right and up, for each arcsec by which it is kept elsewhere along the growing axes.
    fn axes_seen(
        &mut self,
        (target, orders): (&GotoTarget, &Orders),
        (glance, nudge, scale_arcsec): (&mut Glance<'_>, f64, f64),
        (mut seen, flux): (Glanced, f64),
        cancel: &Cancel,
        each: &mut dyn FnMut(&TrackStep) -> ControlFlow<()>,
    ) -> Result<(DMat2, Glanced), GotoError> {
        let settle_s = self.options.settle_s;
        let mut columns: [Option<DVec2>; 2] = [None; 2];
        // A light in a corner may leave the frame either way along an axis: then the other axis comes first, which takes it inwards.
        for axis in [0, 1, 0] {
            if columns[axis].is_some() {
                continue;
            }
            let from = same(&seen.lights, flux).ok_or(GotoError::Vanished { flux })?;
            let keep = orders.keep_arcsec();
            // Farther inwards than the first axis takes it to the side.
            let nudge = if axis == 1 && columns[0].is_none() { 2.0 * nudge } else { nudge };
            for by in [nudge, -nudge] {
                let mut there = keep;
                there[axis] += by;
                orders.keep(there);
                let rest = (&mut *glance, settle_s);
                let moved = self.glance(target, orders, rest, Some(&seen), cancel, each)?;
                if let Some(light) = same(&moved.lights, flux) {
                    let per_arcsec = (light.place_px - from.place_px) / by;
                    let part = per_arcsec.length() * scale_arcsec;
                    if !(RIGID..RIGID.recip()).contains(&part) {
                        return Err(GotoError::Unmoved { part });
                    }
                    columns[axis] = Some(per_arcsec);
                    seen = moved;
                    break;
                }
                orders.keep(keep);
            }
        }
        let [Some(first), Some(second)] = columns else {
            return Err(GotoError::Vanished { flux });
        };
        let columns = [first, second];
        let matrix = DMat2::from_cols(columns[0], columns[1]);
        let skew = matrix.determinant().abs() / (columns[0].length() * columns[1].length());
        match skew > RIGID {
            true => Ok((matrix, seen)),
            false => Err(GotoError::Unmoved { part: skew }),
        }
    }

    /// Brings the light into the frame's middle.
    fn centre(
        &mut self,
        (target, orders): (&GotoTarget, &Orders),
        glance: &mut Glance<'_>,
        (matrix, mut seen, flux): (DMat2, Glanced, f64),
        cancel: &Cancel,
        each: &mut dyn FnMut(&TrackStep) -> ControlFlow<()>,
    ) -> Result<Gone, GotoError> {
        let scale_arcsec = matrix.determinant().abs().sqrt().recip();
        let sky = matrix.inverse();
        let mut offs = Vec::new();
        let left = loop {
            let light = same(&seen.lights, flux).ok_or(GotoError::Vanished { flux })?;
            let off = sky * light.place_px;
            let off_arcsec = off.length();
            offs.push(off_arcsec);
            if off_arcsec <= self.options.tolerance_arcsec {
                break off;
            }
            if offs.len() >= self.options.rounds {
                let (rounds, tolerance_arcsec) = (offs.len(), self.options.tolerance_arcsec);
                return Err(GotoError::Short { rounds, off_arcsec, tolerance_arcsec });
            }
            orders.keep(orders.keep_arcsec() - off);
            let settle_s = self.options.settle_s;
            let rest = (&mut *glance, settle_s);
            seen = self.glance(target, orders, rest, Some(&seen), cancel, each)?;
        };
        let up = sky.y_axis;
        let camera = CameraAxes {
            camera_angle_deg: wrapped((-up.x).atan2(up.y).to_degrees()),
            camera_mirrored: matrix.determinant() < 0.0,
            pixel_scale_arcsec: scale_arcsec,
            camera_angle_pier: seen.pier,
        };
        if self.options.sync {
            let path = self.path(target, self.clock.utc())?;
            // The frame's middle looks beside the star by what is left.
            let looks = shifted(path.at(0.0).direction, (-left).to_array());
            self.tell_place(path.place_of(angles(looks), 0.0), cancel)?;
        }
        let own_arcsec = seen.own_arcsec;
        Ok(Gone { own_arcsec, off_arcsec: offs, camera: Some(camera), place: None })
    }
}

/// A frame, and how the mount stood.
#[derive(Debug, Clone)]
struct Glanced {
    own_arcsec: f64,
    lights: Lights,
    pier: Option<PierSide>,
    motion: MountMotion,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: geometry. However a camera is turned, every point of the circle lies in a field: within the circle that fits into it where the turn is not known, in its rectangle where it is. The first field is the middle.
    #[test]
    fn fields_cover_a_circle() {
        let (radius, sides) = (1800.0, DVec2::new(600.0, 480.0));
        let points = (0..2000).map(|i| {
            let far = radius * (f64::from(i) / 1999.0).sqrt();
            far * DVec2::from_angle(2.399_963 * f64::from(i))
        });
        let square = fields(radius, DVec2::splat(SPACING_UNKNOWN * sides.y), 0.0);
        let along = fields(radius, SPACING * sides, 33.0);
        assert!(square[0] == DVec2::ZERO && along[0] == DVec2::ZERO);
        assert!(square.len() < 120 && along.len() < 60, "{} {}", square.len(), along.len());
        let back = DVec2::from_angle(-33_f64.to_radians());
        for point in points {
            assert!(square.iter().any(|field| field.distance(point) <= 0.5 * sides.y), "{point}");
            let is_inside =
                |field: &DVec2| back.rotate(point - *field).abs().cmple(0.5 * sides).all();
            assert!(along.iter().any(is_inside), "{point}");
        }
    }
}
