//! Going to a place on the sky, corrected by where the frames look.

use super::model::{PointingModel, PointingPlace};
use super::path::{PathError, TargetPath, angles, direction, wrapped};
use super::safety::Guard;
use super::steer::Orders;
use super::tracker::{
    PARKED, STOPPED, TrackError, TrackOptions, TrackStep, Tracker, off_of, shifted,
};
use glam::DVec3;
use hifitime::Epoch;
use serde::Serialize;
use std::ops::ControlFlow;
use std::time::Duration;
use sunglint_drivers::clock::{Cancel, Deadline, DeviceClock};
use sunglint_drivers::device::{
    DeviceError, Mount, MountMotion, MountPlace, MountReading, PierSide,
};
use sunglint_numerics::axes::Axes;
use sunglint_radiometry::sky::{
    AzimuthAltitude, EarthOrientation, Equatorial, Site, Star, StarError,
};

/// Length of the path towards a target, s.
const PATH_S: f64 = 900.0;
/// Length of the way upwards by which the turn of a frame is found, rad.
const UP_RAD: f64 = 1e-3;
/// A frame that looks farther from where the mount says than this is no error of pointing, deg.
const MOST_OFF_DEG: f64 = 10.0;
/// Distance by the mount's own reading beyond which it is sent again, arcsec. A mount that goes to the hour angle that the target had in the beginning is late by its way's time, 15″ a second; the
/// last slew over a few minutes of arc takes two seconds at most, and what those leave cannot be had better in this way.
pub const OWN_ARCSEC: f64 = 30.0;
/// Most times that it is sent again. Each slew is late by the time of its own way alone: after the second, which is some minutes of arc long, only a mount that does not go where it says is still off.
const AGAIN: usize = 3;
/// Time for an answer of the mount.
const SOON: Duration = Duration::from_millis(3500);
/// Time within which the rest before a frame ends.
const SETTLES: Duration = Duration::from_secs(10);

/// Somebody stopped it.
const CANCELLED: DeviceError = DeviceError::Cancelled { device: "mount", action: "going" };

/// Where to go.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum GotoTarget {
    /// A star, or any place among them.
    Star(Box<Star>),
    /// A place over the horizon.
    Horizontal(AzimuthAltitude),
}

/// How to go.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct GotoOptions {
    /// Distance from the target within which it has arrived, arcsec.
    pub tolerance_arcsec: f64,
    /// Frames at most.
    pub rounds: usize,
    /// Rest before a frame, s: the mount swings out.
    pub settle_s: f64,
    /// Whether the mount is told where it is in the end.
    pub sync: bool,
    /// Whether places are lifted by refraction.
    pub refraction: bool,
    /// How the mount is moved.
    pub track: TrackOptions,
}

impl Default for GotoOptions {
    fn default() -> Self {
        Self {
            tolerance_arcsec: 30.0,
            rounds: 5,
            settle_s: 1.0,
            sync: false,
            refraction: true,
            // No lead: what follows the stars afterwards is to stand on the target, not before it.
            track: TrackOptions { lead_s: 0.0, ..TrackOptions::default() },
        }
    }
}

/// Reason why it did not arrive.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GotoError {
    /// There is no path to the target.
    #[error(transparent)]
    Path(#[from] PathError),
    /// A place that is none.
    #[error(transparent)]
    Place(#[from] StarError),
    /// Not safe, or the mount does not do it.
    #[error(transparent)]
    Track(#[from] TrackError),
    /// The mount.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// The camera, or its frames tell nothing.
    #[error(
        "the frame after a goto tells no place: {0}; the mount stands where it went by its own reckoning"
    )]
    Blind(String),
    /// The mount is lost.
    #[error(
        "the frame looks {off_deg:.1}° beside where the mount says that it looks, which no error of pointing explains: check its time, its site and its start position, or sync it"
    )]
    Lost {
        /// How far, deg.
        off_deg: f64,
    },
    /// The star is in none of the fields.
    #[error(
        "the star is in none of {fields} fields up to {radius_deg:.2}° about where it should be{}{}: search farther, expose longer, or check focus, clouds and the mount's time", brightest_text(*.flux), forbidden_text(*.forbidden)
    )]
    Unseen {
        /// Fields that were looked at.
        fields: usize,
        /// Fields beyond a limit: the horizon, the Sun, the mount's own.
        forbidden: usize,
        /// How far was searched, deg.
        radius_deg: f64,
        /// Flux of the brightest light that was seen.
        flux: Option<f64>,
    },
    /// A search that would not end.
    #[error(
        "a search {radius_deg:.2}° far in fields of {:.1}′ takes {fields} of them, {most} at most: search less far, or use a finder", 60.0 * .field_deg
    )]
    TooManyFields {
        /// Fields.
        fields: usize,
        /// Most that are allowed.
        most: usize,
        /// Narrower side of a field, deg.
        field_deg: f64,
        /// How far was to be searched, deg.
        radius_deg: f64,
    },
    /// The light of the star was seen, and is seen no more.
    #[error(
        "the star was seen (flux {flux:.0}), and is not in the frame after a short move: clouds, or a light that is not in the sky"
    )]
    Vanished {
        /// Flux of the star, in the frames' unit.
        flux: f64,
    },
    /// The light does not move as the mount does.
    #[error(
        "the light in the frames moves by {part:.2} of what the mount does: a wrong pixel scale, a hot pixel, or a mount that does not move"
    )]
    Unmoved {
        /// Part of the mount's way.
        part: f64,
    },
    /// Another side of the pier.
    #[error(
        "the mount turned over to the other side of its pier during the search: the star is too near the meridian; take one that is farther from it, or wait some minutes"
    )]
    TurnedOver,
    /// Corrections do not bring it there.
    #[error(
        "after {rounds} frames the telescope is still {off_arcsec:.0}″ off, expected at most {tolerance_arcsec:.0}″"
    )]
    Short {
        /// Frames.
        rounds: usize,
        /// Last distance, arcsec.
        off_arcsec: f64,
        /// Largest that was allowed, arcsec.
        tolerance_arcsec: f64,
    },
}

fn brightest_text(flux: Option<f64>) -> String {
    flux.map_or_else(String::new, |flux| {
        format!(" (the brightest light there has a flux of {flux:.0})")
    })
}

fn forbidden_text(fields: usize) -> String {
    match fields {
        0 => String::new(),
        n => format!(" ({n} more are beyond a limit)"),
    }
}

/// Where a frame looks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Looks {
    /// Middle of its exposure.
    pub middle: Epoch,
    /// Right ascension and declination of its middle, ICRS.
    pub sky_deg: Equatorial,
    /// Direction of its upward rows (towards row 0), deg from north through east.
    pub up_deg: f64,
    /// Whether it is mirrored: east is to the right where north is up.
    pub is_mirrored: bool,
    /// Angle that a pixel of the sensor sees, arcsec.
    pub scale_arcsec: f64,
}

/// The axes of the mount as a camera sees them: the keys of a plan's `[mount]`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct CameraAxes {
    /// `camera_angle_deg`: turn of the camera, deg, -180 to 180.
    pub camera_angle_deg: f64,
    /// `camera_mirrored`: whether its columns run the other way.
    pub camera_mirrored: bool,
    /// `pixel_scale_arcsec`: angle that a pixel sees, arcsec.
    pub pixel_scale_arcsec: f64,
    /// `camera_angle_pier`: side of the pier of a German mount on which this holds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera_angle_pier: Option<PierSide>,
}

/// Result of a goto.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Gone {
    /// Distance from the target by the mount's own reading once its last slew had ended, arcsec.
    pub own_arcsec: f64,
    /// Distance of each frame's middle from the target, arcsec.
    pub off_arcsec: Vec<f64>,
    /// The axes as the last frame saw them.
    pub camera: Option<CameraAxes>,
    /// Reading of the mount in the middle of the last frame, beside where the frame looked: for a model of its pointing, where none is used.
    #[serde(skip)]
    pub place: Option<PointingPlace>,
}

/// Takes a frame and says where it looks.
pub type Look<'a> = dyn FnMut(&Cancel) -> Result<Looks, String> + 'a;

/// A mount that goes to places.
pub struct Goto<'a> {
    /// Site of the telescope.
    pub site: &'a Site,
    /// Limits of where it may point.
    pub guard: &'a Guard,
    /// The mount.
    pub mount: &'a mut dyn Mount,
    /// How the mount shows directions, where that was measured.
    pub model: Option<&'a PointingModel>,
    /// Clock of the mount.
    pub clock: DeviceClock,
    /// How.
    pub options: GotoOptions,
    /// Sign of life for a watchdog, between calls that take their time.
    pub beat: &'a dyn Fn(),
}

impl std::fmt::Debug for Goto<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Goto").field("options", &self.options).finish_non_exhaustive()
    }
}

/// The angles of the axes at a moment, on the line between two readings.
fn between(path: &TargetPath, readings: [&MountReading; 2], at: Epoch) -> Axes {
    let [first, last] = readings.map(|reading| path.angles_of(reading));
    let [from, to] = readings.map(|reading| reading.utc);
    let whole = (to - from).to_seconds();
    let part = if whole > 0.0 { ((at - from).to_seconds() / whole).clamp(0.0, 1.0) } else { 1.0 };
    Axes::new(
        wrapped(first.first + part * wrapped(last.first - first.first)),
        first.second + part * (last.second - first.second),
    )
}

/// Somebody else parked or stopped it while a frame was taken.
pub(super) fn check_untouched(before: MountMotion, after: MountMotion) -> Result<(), TrackError> {
    match (before, after) {
        (_, MountMotion::Parked) => Err(TrackError::ByHand { what: PARKED }),
        (_, MountMotion::Slewing) | (MountMotion::Tracking, MountMotion::Still) => {
            Err(TrackError::ByHand { what: STOPPED })
        }
        _ => Ok(()),
    }
}

impl Goto<'_> {
    pub(super) fn path(&self, target: &GotoTarget, from: Epoch) -> Result<TargetPath, PathError> {
        let (earth, axes) = (EarthOrientation::embedded(), self.mount.abilities().axes);
        let span = (from, PATH_S);
        let path = match target {
            GotoTarget::Star(star) => {
                TargetPath::star(star, self.site, earth, span, axes, self.options.refraction)
            }
            GotoTarget::Horizontal(place) => {
                TargetPath::fixed(*place, self.site, earth, span, axes)
            }
        }?;
        Ok(match self.model {
            Some(model) => model.path(path)?,
            None => path,
        })
    }

    pub(super) fn reading(&mut self, cancel: &Cancel) -> Result<MountReading, DeviceError> {
        let soon = Deadline::after(self.clock.clock.clone(), SOON).with_cancel(cancel);
        (self.beat)();
        let reading = self.mount.reading(&soon);
        (self.beat)();
        reading
    }

    /// Sends the mount to a target until it is there by its own reading, or was sent again [`AGAIN`] times. Gives the path, and the distance that is left, arcsec.
    pub(super) fn arrive(
        &mut self,
        target: &GotoTarget,
        orders: &Orders,
        cancel: &Cancel,
        each: &mut dyn FnMut(&TrackStep) -> ControlFlow<()>,
    ) -> Result<(TargetPath, f64), GotoError> {
        let mut again = 0;
        loop {
            let path = self.path(target, self.clock.utc())?;
            let (clock, options) = (self.clock.clone(), self.options.track);
            let tracker = Tracker::new(&path, self.guard, self.mount, None, clock, options);
            if !tracker.steered_by(orders).beating(self.beat).go(cancel, each)? {
                return Err(CANCELLED.into());
            }
            // What is parked or stopped from now on is somebody else's.
            self.options.track.unpark = false;
            let keep = orders.keep_arcsec().to_array().map(|arcsec| -arcsec);
            let off_arcsec = |reading: &MountReading| {
                let wanted = path.at(path.time_s(reading.utc)).direction;
                let stands = direction(path.angles_of(reading));
                stands.angle_between(shifted(wanted, keep)).to_degrees() * 3600.0
            };
            let arrived = self.reading(cancel)?;
            let mut own_arcsec = off_arcsec(&arrived);
            if own_arcsec > OWN_ARCSEC {
                // It may not have come to rest.
                self.rest(self.options.settle_s, cancel)?;
                let reading = self.reading(cancel)?;
                match (arrived.motion, reading.motion) {
                    (_, MountMotion::Parked) => {
                        return Err(TrackError::ByHand { what: PARKED }.into());
                    }
                    (MountMotion::Tracking, MountMotion::Still) => {
                        return Err(TrackError::ByHand { what: STOPPED }.into());
                    }
                    _ => {}
                }
                own_arcsec = off_arcsec(&reading);
            }
            if own_arcsec <= OWN_ARCSEC || again == AGAIN {
                return Ok((path, own_arcsec));
            }
            again += 1;
        }
    }

    /// Tells the mount where it is.
    pub(super) fn tell_place(
        &mut self,
        place: MountPlace,
        cancel: &Cancel,
    ) -> Result<(), DeviceError> {
        let soon = Deadline::after(self.clock.clock.clone(), SOON).with_cancel(cancel);
        self.mount.sync(place, &soon)?;
        (self.beat)();
        Ok(())
    }

    /// Lets the mount swing out.
    pub(super) fn rest(&self, settle_s: f64, cancel: &Cancel) -> Result<(), DeviceError> {
        let settle = Deadline::after(self.clock.clock.clone(), SETTLES).with_cancel(cancel);
        let rest = Duration::from_secs_f64(settle_s.clamp(0.0, 9.0));
        settle.sleep(rest).map_err(|_| CANCELLED)
    }

    /// The axes of a mount on this side of the pier, as a frame sees them that looks there.
    fn camera(&self, looks: &Looks, pier: Option<PierSide>) -> Result<CameraAxes, GotoError> {
        let [ra, dec] = looks.sky_deg.to_array().map(f64::to_radians);
        let middle = DVec3::new(dec.cos() * ra.cos(), dec.cos() * ra.sin(), dec.sin());
        let north = DVec3::new(-dec.sin() * ra.cos(), -dec.sin() * ra.sin(), dec.cos());
        let east = DVec3::new(-ra.sin(), ra.cos(), 0.0);
        let (sin, cos) = looks.up_deg.to_radians().sin_cos();
        let above = middle + UP_RAD * (cos * north + sin * east);
        let at = |sky: DVec3| -> Result<DVec3, GotoError> {
            let ra_deg = sky.y.atan2(sky.x).to_degrees().rem_euclid(360.0);
            let dec_deg = sky.normalize().z.clamp(-1.0, 1.0).asin().to_degrees();
            let star = Star::at("a place of the frame", Equatorial { ra_deg, dec_deg })?;
            let path = self.path(&GotoTarget::Star(Box::new(star)), looks.middle)?;
            Ok(path.at(0.0).direction)
        };
        let [first, second] = off_of(at(middle)?, at(above)?);
        Ok(CameraAxes {
            camera_angle_deg: wrapped((-first).atan2(second).to_degrees()),
            camera_mirrored: looks.is_mirrored,
            pixel_scale_arcsec: looks.scale_arcsec,
            camera_angle_pier: pier,
        })
    }

    /// Goes to a target, and again where the mount's own reading is not there. With `look`, it is corrected by where the frames look until it is near enough. A mount that follows the stars after a goto does so in the end.
    ///
    /// # Errors
    /// See [`GotoError`]. A goto that was broken off ends in a stop.
    pub fn to(
        &mut self,
        target: &GotoTarget,
        mut look: Option<&mut Look<'_>>,
        cancel: &Cancel,
        each: &mut dyn FnMut(&TrackStep) -> ControlFlow<()>,
    ) -> Result<Gone, GotoError> {
        let orders = Orders::default();
        let (mut offs, mut camera, mut place) = (Vec::new(), None, None);
        loop {
            let (path, own_arcsec) = self.arrive(target, &orders, cancel, each)?;
            let Some(look) = look.as_mut() else {
                return Ok(Gone { own_arcsec, off_arcsec: offs, camera, place });
            };
            self.rest(self.options.settle_s, cancel)?;
            let before = self.reading(cancel)?;
            let looked = look(cancel);
            let after = self.reading(cancel)?;
            check_untouched(before.motion, after.motion)?;
            let looks = looked.map_err(GotoError::Blind)?;
            let star = Star::at("the frame's middle", looks.sky_deg)?;
            let seen = self.path(&GotoTarget::Star(Box::new(star)), looks.middle)?;
            let seen_at = seen.at(0.0).direction;
            camera = Some(self.camera(&looks, after.pier)?);
            place = Some(PointingPlace {
                utc: Some(looks.middle),
                shown_deg: between(&path, [&before, &after], looks.middle),
                seen_deg: angles(seen_at),
                pier: after.pier,
            });
            let wanted = path.at(path.time_s(looks.middle)).direction;
            let off_arcsec = wanted.angle_between(seen_at).to_degrees() * 3600.0;
            offs.push(off_arcsec);
            if off_arcsec > MOST_OFF_DEG * 3600.0 {
                return Err(GotoError::Lost { off_deg: off_arcsec / 3600.0 });
            }
            if off_arcsec <= self.options.tolerance_arcsec {
                if self.options.sync {
                    self.tell_place(seen.place_of(angles(seen_at), 0.0), cancel)?;
                }
                return Ok(Gone { own_arcsec, off_arcsec: offs, camera, place });
            }
            if offs.len() >= self.options.rounds {
                let (rounds, tolerance_arcsec) = (offs.len(), self.options.tolerance_arcsec);
                return Err(GotoError::Short { rounds, off_arcsec, tolerance_arcsec });
            }
            // The mount's own places are off by so much here.
            let (keep, off) = (orders.keep_arcsec(), off_of(wanted, seen_at));
            orders.keep([0, 1].map(|i| keep[i] + off[i]).into());
        }
    }
}
