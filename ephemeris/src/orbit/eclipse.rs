//! Eclipse by the Earth: the part of the Sun's disc that is visible at a target, and when it changes.
//!
//! Sun and Earth are circular discs on the target's sky, with the angular radii asin(R/d) that spheres have, and what is
//! visible is the part of the Sun's solid angle outside the Earth's disc, weighted by nothing else
//! (limb-darkened: `sunglint_simulator::light::disc::eclipse`). The
//! overlap is exact on the sphere, for discs of any size: the Earth fills nearly half the sky in low orbit. What it
//! leaves out is the air, which bends sunlight into the umbra and dims the last tens of kilometres above the limb: in low orbit
//! entry and exit are blurred by some seconds.

use super::{Orbit, OrbitError, in_tai, seconds_between};
use crate::geometry::GeometryError;
use glam::DVec3;
use hifitime::{Duration, Epoch};
use std::f64::consts::{FRAC_PI_2, PI};
use sunglint_radiometry::sky::{EarthOrientation, SkyFrames, SunPlace, separation_rad};

/// The equatorial radius of WGS 84, m.
pub const EARTH_EQUATORIAL_RADIUS_M: f64 = 6_378_137.0;
/// Equatorial over polar radius of WGS 84.
const EQUATOR_OVER_POLE: f64 = 1.0 / (1.0 - 1.0 / 298.257_223_563);
/// To which contacts are found.
const CONTACT_S: f64 = 5e-4;

/// The body that casts the shadow.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum EarthShape {
    /// A sphere of that radius, m.
    Sphere {
        /// Radius, m.
        radius_m: f64,
    },
    /// The ellipsoid of WGS 84 about the GCRS's z axis (the pole itself is within 0.15° of it until 2026, 0.56° in 2100: 50 m and
    /// 200 m on the limb at most).
    ///
    /// Space is stretched along the axis until the Earth is a sphere. The Sun's disc, which this makes higher by up to 0.34 %, is
    /// kept circular: the visible fraction errs by 1e-3 at most, where the oblateness moves contacts by up to some seconds.
    Ellipsoid,
}

impl Default for EarthShape {
    fn default() -> Self {
        Self::Sphere { radius_m: EARTH_EQUATORIAL_RADIUS_M }
    }
}

/// The discs of Sun and Earth on a target's sky.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Discs {
    /// Angular radius of the Sun, radians.
    pub sun_rad: f64,
    /// Angular radius of the Earth, radians.
    pub earth_rad: f64,
    /// Angle between their centres, radians.
    pub separation_rad: f64,
}

/// Depth of a target in the shadow.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Shadow {
    /// The whole Sun is visible.
    None,
    /// A part of it.
    Penumbra,
    /// A ring of it, around the whole Earth.
    Annular,
    /// Nothing of it.
    Umbra,
}

impl Discs {
    /// The discs at a GCRS position, m, with the Sun as it is seen from there by someone at rest in the GCRS
    /// ([`SkyFrame::sun_from`](sunglint_radiometry::sky::SkyFrame::sun_from) with velocity zero), since the Earth's limb is
    /// taken at rest there too. (With the target's own velocity both would be aberrated, by up to 5″, and no contact would
    /// change.)
    ///
    /// A target inside the sphere (of the equatorial radius, over a pole) sees what one on its surface sees.
    pub fn at(position_m: DVec3, sun: &SunPlace, earth: EarthShape) -> Self {
        let (position, to_sun, distance_m, radius_m) = match earth {
            EarthShape::Sphere { radius_m } => {
                (position_m, sun.direction_gcrs, sun.distance_m, radius_m)
            }
            EarthShape::Ellipsoid => {
                let stretch = |v: DVec3| DVec3::new(v.x, v.y, v.z * EQUATOR_OVER_POLE);
                let to_sun = stretch(sun.direction_gcrs);
                // The Sun stays as large as it is: the size is taken from the true distance.
                (stretch(position_m), to_sun, sun.distance_m, EARTH_EQUATORIAL_RADIUS_M)
            }
        };
        let range_m = position.length();
        let earth_rad = if range_m > radius_m { (radius_m / range_m).asin() } else { FRAC_PI_2 };
        let of_sun = SunPlace { direction_gcrs: to_sun, distance_m };
        Self {
            sun_rad: of_sun.angular_radius_rad(),
            earth_rad,
            separation_rad: separation_rad(to_sun, -position),
        }
    }

    /// Returns the shadow.
    ///
    /// ```
    /// use glam::DVec3;
    /// use sunglint_ephemeris::orbit::eclipse::{Discs, EarthShape, Shadow};
    /// use sunglint_radiometry::constants::AU_M;
    /// use sunglint_radiometry::sky::SunPlace;
    ///
    /// let sun = SunPlace { direction_gcrs: DVec3::X, distance_m: AU_M };
    /// // Beyond the tip of the umbra, 1.4 million km behind the Earth, a ring of the Sun is seen.
    /// let discs = Discs::at(DVec3::new(-2e9, 0.0, 0.0), &sun, EarthShape::default());
    /// assert_eq!(discs.shadow(), Shadow::Annular);
    /// ```
    pub fn shadow(&self) -> Shadow {
        let Self { sun_rad: a, earth_rad: b, separation_rad: c } = *self;
        if c >= a + b {
            Shadow::None
        } else if c <= b - a {
            Shadow::Umbra
        } else if c <= a - b {
            Shadow::Annular
        } else {
            Shadow::Penumbra
        }
    }

    /// The visible part of the Sun's solid angle, 0 to 1.
    ///
    /// Where the discs' edges cross, the hidden part is a lens: two sectors of small circles less the two spherical triangles
    /// between the centres and the crossings, 2α(1−cos a) + 2β(1−cos b) − 2E. The angles come from the half-angle formulae
    /// and the excess from L'Huilier's theorem, all of them without the cancellation that arc cosines have at tangency; what
    /// is left is a rounding of 1e-13, and 1e-9 within 1e-9 rad of tangency.
    pub fn visible_fraction(&self) -> f64 {
        let Self { sun_rad: a, earth_rad: b, separation_rad: c } = *self;
        match self.shadow() {
            Shadow::None => 1.0,
            Shadow::Umbra => 0.0,
            Shadow::Annular => 1.0 - (cap(b) / cap(a)).min(1.0),
            Shadow::Penumbra => {
                let s = 0.5 * (a + b + c);
                // s−a and so on from the sides, each once rounded.
                let (sa, sb, sc) = (0.5 * (b + c - a), 0.5 * (a + c - b), 0.5 * (a + b - c));
                let angle = |opposite: f64, one: f64, other: f64| {
                    2.0 * (one.sin() * other.sin()).sqrt().atan2((s.sin() * opposite.sin()).sqrt())
                };
                let at_sun = angle(sb, sa, sc);
                let at_earth = angle(sa, sb, sc);
                let product =
                    (0.5 * s).tan() * (0.5 * sa).tan() * (0.5 * sb).tan() * (0.5 * sc).tan();
                let excess = 4.0 * product.max(0.0).sqrt().atan();
                let hidden = at_sun * cap(a) / PI + at_earth * cap(b) / PI - 2.0 * excess;
                (1.0 - hidden / cap(a)).clamp(0.0, 1.0)
            }
        }
    }
}

/// Solid angle of a cap, sr.
fn cap(radius_rad: f64) -> f64 {
    4.0 * PI * (0.5 * radius_rad).sin().powi(2)
}

/// The visible part of the Sun's disc at a GCRS position: [`Discs::at`] and [`Discs::visible_fraction`].
///
/// ```
/// use glam::DVec3;
/// use sunglint_ephemeris::orbit::eclipse::{EarthShape, visible_fraction};
/// use sunglint_radiometry::constants::AU_M;
/// use sunglint_radiometry::sky::SunPlace;
///
/// let sun = SunPlace { direction_gcrs: DVec3::X, distance_m: AU_M };
/// let behind = DVec3::new(-7e6, 0.0, 0.0);
/// let before = DVec3::new(7e6, 0.0, 0.0);
/// assert_eq!(visible_fraction(behind, &sun, EarthShape::default()), 0.0);
/// assert_eq!(visible_fraction(before, &sun, EarthShape::default()), 1.0);
/// ```
pub fn visible_fraction(position_m: DVec3, sun: &SunPlace, earth: EarthShape) -> f64 {
    Discs::at(position_m, sun, earth).visible_fraction()
}

/// A contact with the shadow.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ContactKind {
    /// The Earth begins to cover the Sun.
    PenumbraEntry,
    /// The Sun is gone, or (far behind the Earth) the Earth stands wholly before it.
    UmbraEntry,
    /// The Sun comes back, or the Earth touches its other edge.
    UmbraExit,
    /// The Sun is whole again.
    PenumbraExit,
}

/// Contact of a target with the shadow.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// Epoch by the target's own time, to 1 ms.
    pub epoch: Epoch,
    /// Kind of the contact.
    pub kind: ContactKind,
}

/// The contacts of a target with the shadow between two epochs, in the order of time.
///
/// The two conditions are followed in steps of a hundredth of a revolution (5 s to 10 min) and their zeros bisected to
/// 0.5 ms. An eclipse that lies between two steps is found by the minimum between them.
///
/// # Errors
/// The errors of [`Orbit::state`] and [`SkyFrames::over`].
pub fn contacts(
    orbit: &Orbit,
    from: Epoch,
    to: Epoch,
    orientation: &EarthOrientation,
    earth: EarthShape,
) -> Result<Vec<Contact>, GeometryError> {
    let frames = SkyFrames::over(from, to, orientation)?;
    let clearance = |epoch: Epoch| -> Result<([f64; 2], f64), GeometryError> {
        let frame = frames.at(epoch)?;
        let state = orbit.state(epoch, &frame)?;
        let sun = frame.sun_from(state.position_m, DVec3::ZERO)?;
        let Discs { sun_rad, earth_rad, separation_rad } = Discs::at(state.position_m, &sun, earth);
        let speed = state.velocity_m_s.length();
        let revolution_s = 2.0 * PI * state.position_m.length() / speed.max(1.0);
        let penumbra = separation_rad - (earth_rad + sun_rad);
        Ok(([penumbra, separation_rad - (earth_rad - sun_rad).abs()], revolution_s))
    };
    let from = in_tai(from);
    let length_s = seconds_between(from, to);
    let at =
        |seconds: f64| from + Duration::from_total_nanoseconds((seconds * 1e9).round() as i128);
    let mut found = Vec::new();
    let (mut before, mut revolution_s) = clearance(from)?;
    let (mut time_s, mut earlier): (f64, Option<(f64, [f64; 2])>) = (0.0, None);
    while time_s < length_s {
        let step_s = (revolution_s / 100.0).clamp(5.0, 600.0);
        let next_s = (time_s + step_s).min(length_s);
        let (after, next_revolution_s) = clearance(at(next_s))?;
        for which in 0..2 {
            let value = |seconds: f64| clearance(at(seconds)).map(|(both, _)| both[which]);
            let kinds = match which {
                0 => (ContactKind::PenumbraEntry, ContactKind::PenumbraExit),
                _ => (ContactKind::UmbraEntry, ContactKind::UmbraExit),
            };
            let mut cross =
                |low_s: f64, high_s: f64, entering: bool| -> Result<(), GeometryError> {
                    let seconds = bisect(low_s, high_s, entering, value)?;
                    let kind = if entering { kinds.0 } else { kinds.1 };
                    found.push(Contact { epoch: at(seconds), kind });
                    Ok(())
                };
            match (before[which] > 0.0, after[which] > 0.0) {
                (true, false) => cross(time_s, next_s, true)?,
                (false, true) => cross(time_s, next_s, false)?,
                (true, true) => {
                    // Three points that fall and rise hold a minimum, perhaps below zero.
                    if let Some((earlier_s, earlier)) = earlier
                        && earlier[which] > before[which]
                        && before[which] <= after[which]
                        && earlier[which] > 0.0
                    {
                        let (lowest_s, lowest) = minimum(earlier_s, next_s, value)?;
                        if lowest <= 0.0 {
                            cross(earlier_s, lowest_s, true)?;
                            cross(lowest_s, next_s, false)?;
                        }
                    }
                }
                (false, false) => {}
            }
        }
        earlier = Some((time_s, before));
        (time_s, before, revolution_s) = (next_s, after, next_revolution_s);
    }
    found.sort_by(|a, b| seconds_between(b.epoch, a.epoch).total_cmp(&0.0));
    Ok(found)
}

/// Where a value that falls (or rises) through zero does so.
fn bisect<E>(
    mut low_s: f64,
    mut high_s: f64,
    falling: bool,
    value: impl Fn(f64) -> Result<f64, E>,
) -> Result<f64, E> {
    while high_s - low_s > CONTACT_S {
        let middle = 0.5 * (low_s + high_s);
        if (value(middle)? > 0.0) == falling {
            low_s = middle;
        } else {
            high_s = middle;
        }
    }
    Ok(0.5 * (low_s + high_s))
}

/// The place and value of a minimum by golden sections, to 10 ms.
fn minimum<E>(
    mut low_s: f64,
    mut high_s: f64,
    value: impl Fn(f64) -> Result<f64, E>,
) -> Result<(f64, f64), E> {
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    let mut inner = [high_s - GOLDEN * (high_s - low_s), low_s + GOLDEN * (high_s - low_s)];
    let mut values = [value(inner[0])?, value(inner[1])?];
    while high_s - low_s > 0.01 {
        if values[0] < values[1] {
            high_s = inner[1];
            inner = [high_s - GOLDEN * (high_s - low_s), inner[0]];
            values = [value(inner[0])?, values[0]];
        } else {
            low_s = inner[0];
            inner = [inner[1], low_s + GOLDEN * (high_s - low_s)];
            values = [values[1], value(inner[1])?];
        }
    }
    Ok(if values[0] < values[1] { (inner[0], values[0]) } else { (inner[1], values[1]) })
}

impl From<OrbitError> for GeometryError {
    fn from(error: OrbitError) -> Self {
        Self::Orbit(error)
    }
}
