//! The independent truth: a double loop over latitude and longitude, and sidereal time by the formula of 1982.

use glam::{DMat3, DVec3};
use std::f64::consts::{FRAC_1_PI, PI, TAU};

/// A unit vector from latitude and longitude, radians.
pub fn vertical(lat: f64, lon: f64) -> DVec3 {
    DVec3::new(lat.cos() * lon.cos(), lat.cos() * lon.sin(), lat.sin())
}

/// Returns light from a sphere of `radius_m` with some albedo (of latitude and longitude, radians) at a body at `position_m` under a distant Sun, of its irradiance: the sum of
/// ρ/π cosθ☉ cosθ dA/d² times what the body makes of the direction, over cells of `step_deg`. All vectors are in Earth-fixed axes.
pub fn shine(
    position_m: DVec3,
    radius_m: f64,
    sun: DVec3,
    step_deg: f64,
    albedo: &dyn Fn(f64, f64) -> f64,
    answer: &dyn Fn(DVec3) -> f64,
) -> f64 {
    let rows = (180.0 / step_deg).round() as usize;
    let (step, mut sum) = (PI / rows as f64, 0.0);
    for row in 0..rows {
        let lat = (row as f64 + 0.5) * step - 0.5 * PI;
        let area = radius_m * radius_m * step * 2.0 * (0.5 * step).sin() * lat.cos();
        for column in 0..2 * rows {
            let lon = (column as f64 + 0.5) * step - PI;
            let up = vertical(lat, lon);
            let way = position_m - radius_m * up;
            let (cos_sun, along) = (up.dot(sun), up.dot(way));
            if cos_sun > 0.0 && along > 0.0 {
                let d = way.length();
                let light = FRAC_1_PI * cos_sun * (along / d) * area / (d * d);
                sum += albedo(lat, lon) * light * answer(-way / d);
            }
        }
    }
    sum
}

/// GCRS to Earth-fixed axes by the Greenwich mean sidereal time of 1982 (Aoki et al. 1982, A&A 105, 359: 67310.54841 s + (876600 h + 8640184.812866 s) T + …) less what
/// precession in right ascension (Lieske et al. 1977: 4612.4″ a century in all) has moved the equinox since J2000; UT1 is taken as UTC, the pole as that of the GCRS. Good to the
/// precession of the pole, 20″ a year.
pub fn fixed_from_gcrs(days_since_j2000: f64) -> DMat3 {
    let t = days_since_j2000 / 36525.0;
    let seconds = 67310.54841 + (876_600.0 * 3600.0 + 8_640_184.812_866) * t + 0.093_104 * t * t;
    let precession = (4612.4 / 3600.0 * t).to_radians();
    let angle = (seconds / 86400.0).rem_euclid(1.0) * TAU - precession;
    DMat3::from_rotation_z(-angle)
}
