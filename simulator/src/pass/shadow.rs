//! Error by the edge of the Earth's shadow.
//!
//! The visible part of the Sun's limb-darkened disc is found behind a sharp limb. The Earth's air dims and bends the light that passes within some
//! tens of kilometres of the ground (a ray at 15 km is already spread to half its brightness as far as a low orbit lies behind the limb;
//! refraction also brings light into the umbra): the limb may effectively stand anywhere between.

use sunglint_ephemeris::geometry::Geometry;
use sunglint_ephemeris::orbit::eclipse::{Discs, EARTH_EQUATORIAL_RADIUS_M, EarthShape};

/// Limbs between which the effective one may lie, m above and below the Earth's radius.
const AIR_M: f64 = 25e3;

/// How far off the visible part of the Sun's disc may be.
pub(super) fn error(geometry: &Geometry) -> f64 {
    let visible = |limb_m: f64| {
        let earth = EarthShape::Sphere { radius_m: EARTH_EQUATORIAL_RADIUS_M + limb_m };
        Discs::at(geometry.target.position_m, &geometry.sun, earth).visible_fraction()
    };
    let least = visible(AIR_M);
    if least == 1.0 {
        return 0.0;
    }
    let most = visible(-AIR_M);
    if most == 0.0 {
        return 0.0;
    }
    let here = geometry.sunlit;
    (here - least).abs().max((most - here).abs())
}
