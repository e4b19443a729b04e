//! The directions of a plan on hemispheres seen from above: one for each incident direction.

use crate::plot::gallery::{Gallery, Key, Tile};
use glam::DVec3;
use image::{Rgba, RgbaImage};
use sunglint_materials::plan::Plan;

const SIZE: u32 = 640;
const RADIUS: f64 = 296.0;
/// More hemispheres than these are left out, evenly.
const MOST: usize = 12;
const PAPER: [u8; 3] = [255, 255, 255];
const GROUND: [u8; 3] = [246, 247, 250];
const LINE: [u8; 3] = [205, 208, 214];
const DIRECTION: [u8; 3] = [0, 114, 178];
const LIGHT: [u8; 3] = [213, 94, 0];
const MIRROR: [u8; 3] = [90, 90, 90];

/// A picture for each incident direction.
pub(super) fn gallery(plan: &Plan) -> Gallery {
    let nt = plan.theta_i_rad.len();
    let count = plan.phi_i_rad.len() * nt;
    let shown = count.min(MOST);
    let tiles = (0..shown).map(|k| tile(plan, k * count / shown, nt)).collect();
    let mut subtitle = vec![
        "Outgoing directions, elevation as distance from the middle; the light comes from the orange dot, a mirror sends it to the grey one"
            .to_owned(),
    ];
    if shown < count {
        subtitle.push(format!("{shown} of {count} incident directions"));
    }
    let title = format!("Plan of {} measurements", plan.steps.len());
    Gallery { title, subtitle, tiles }
}

fn tile(plan: &Plan, which: usize, nt: usize) -> Tile {
    let incident = [which / nt, which % nt];
    let (phi, theta) = (plan.phi_i_rad[incident[0]], plan.theta_i_rad[incident[1]]);
    let mut image = RgbaImage::from_pixel(SIZE, SIZE, rgba(PAPER));
    disc(&mut image, (0.0, 0.0), RADIUS, GROUND);
    for ring in [1.0, 2.0, 3.0] {
        circle(&mut image, RADIUS * ring / 3.0);
    }
    let mut count = 0;
    for step in plan.steps.iter().filter(|s| s.incident == incident) {
        disc(&mut image, place(step.outgoing), 3.2, DIRECTION);
        count += 1;
    }
    let light = DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
    disc(&mut image, place(DVec3::new(-light.x, -light.y, light.z)), 5.5, MIRROR);
    disc(&mut image, place(light), 6.5, LIGHT);
    let azimuth = match plan.phi_i_rad.len() {
        1 => String::new(),
        _ => format!(", φᵢ = {:.1}°", phi.to_degrees()),
    };
    let words = vec![format!("{count} directions"), "rings: 30°, 60°, 90°".to_owned()];
    Tile {
        title: format!("θᵢ = {:.1}°{azimuth}", theta.to_degrees()),
        image,
        is_dark: false,
        key: Key::Words(words),
        arrows: Vec::new(),
        scale_bar: None,
    }
}

/// Pixels from the middle: azimuthal equidistant, x to the right, y upwards.
fn place(direction: DVec3) -> (f64, f64) {
    let across = direction.truncate();
    let length = across.length();
    if length == 0.0 {
        return (0.0, 0.0);
    }
    let r = RADIUS * length.atan2(direction.z) / std::f64::consts::FRAC_PI_2;
    (r * across.x / length, -r * across.y / length)
}

fn rgba([r, g, b]: [u8; 3]) -> Rgba<u8> {
    Rgba([r, g, b, 255])
}

/// Mixes a colour into a pixel.
fn mix(image: &mut RgbaImage, x: u32, y: u32, colour: [u8; 3], share: f64) {
    let pixel = image.get_pixel_mut(x, y);
    for (to, from) in pixel.0.iter_mut().zip(colour) {
        *to = (f64::from(*to) * (1.0 - share) + f64::from(from) * share).round() as u8;
    }
}

/// A disc with smooth edges.
fn disc(image: &mut RgbaImage, (x, y): (f64, f64), radius: f64, colour: [u8; 3]) {
    let middle = 0.5 * f64::from(SIZE);
    let (x, y) = (x + middle, y + middle);
    let range = |c: f64| {
        let from = (c - radius - 1.0).max(0.0) as u32;
        from..((c + radius + 2.0).max(0.0) as u32).min(SIZE)
    };
    for row in range(y) {
        for column in range(x) {
            let far = (f64::from(column) + 0.5 - x).hypot(f64::from(row) + 0.5 - y);
            let share = (radius + 0.5 - far).clamp(0.0, 1.0);
            if share > 0.0 {
                mix(image, column, row, colour, share);
            }
        }
    }
}

/// A thin circle about the middle.
fn circle(image: &mut RgbaImage, radius: f64) {
    let middle = 0.5 * f64::from(SIZE);
    for row in 0..SIZE {
        for column in 0..SIZE {
            let far = (f64::from(column) + 0.5 - middle).hypot(f64::from(row) + 0.5 - middle);
            let share = (1.2 - (far - radius).abs()).clamp(0.0, 1.0);
            if share > 0.0 {
                mix(image, column, row, LINE, share);
            }
        }
    }
}
