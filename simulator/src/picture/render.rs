//! The body as the observer sees it.

use super::cover::Cover;
use crate::light::{DirectionError, Faceted, FacetedEye, Piece, View};
use glam::DVec3;

/// The most pixels of a picture.
const MOST_PIXELS: usize = 100_000_000;

/// A distant camera: square pixels across the line of sight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Unit vector from the body to the observer, body axes.
    pub toward: DVec3,
    /// Upward direction in the picture, body axes; its part along the line of sight does not count.
    pub up: DVec3,
    /// Width of a pixel at the body, m.
    pub pixel_m: f64,
    /// Columns and rows.
    pub size_px: [usize; 2],
}

/// Why there is no picture.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PictureError {
    /// Pixels that are none, or too many.
    #[error(
        "a picture of {} x {} pixels of {pixel_m} m: expected 1 to 100,000,000 pixels of a width above 0", size_px[0], size_px[1]
    )]
    Size {
        /// Columns and rows.
        size_px: [usize; 2],
        /// Width of a pixel, m.
        pixel_m: f64,
    },
    /// Up along the line of sight.
    #[error("up is ({}, {}, {}), along the line of sight: expected a direction across it", up.x, up.y, up.z)]
    Up {
        /// Given direction.
        up: DVec3,
    },
    /// Directions that are none.
    #[error(transparent)]
    Direction(#[from] DirectionError),
}

/// A picture: rows from the top, columns from the left, as the observer sees them.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Columns and rows.
    pub size_px: [usize; 2],
    /// Width of a pixel at the body, m.
    pub pixel_m: f64,
    /// For each band the intensity of each pixel, in the unit of the factors that were given, times m² sr⁻¹.
    pub bands: Vec<Vec<f64>>,
    /// For each material the share of each pixel that it covers, lit or not.
    pub materials: Vec<Vec<f64>>,
    /// Distance from the observer of what is seen, against that of the body's origin, m; NaN where nothing is.
    pub depth_m: Vec<f64>,
}

impl Camera {
    /// A camera that sees all of a body: `size_px` pixels along the longer side of its outline's box, 5 % of margin.
    pub fn around(body: &Faceted, toward: DVec3, up: DVec3, size_px: usize) -> Self {
        let radius = body.radius_m();
        let pixel_m = 2.1 * radius / size_px.max(1) as f64;
        Self { toward, up, pixel_m, size_px: [size_px, size_px] }
    }

    /// Right and up.
    fn axes(&self) -> Result<(DVec3, DVec3), PictureError> {
        let along = self.toward.normalize_or_zero();
        let up = self.up - self.up.dot(along) * along;
        let up = (up.length() > 1e-9 * self.up.length())
            .then(|| up.try_normalize())
            .flatten()
            .ok_or(PictureError::Up { up: self.up })?;
        Ok((up.cross(along), up))
    }
}

impl Picture {
    /// A picture under collimated light from `sun_body`. `bands[b][k]` is what weight k counts in band b.
    ///
    /// # Errors
    /// A camera or directions that are none.
    pub fn render(
        eye: &mut FacetedEye<'_>,
        camera: &Camera,
        sun_body: DVec3,
        bands: &[Vec<f64>],
    ) -> Result<Self, PictureError> {
        let [width, height] = camera.size_px;
        let pixel_m = camera.pixel_m;
        let pixels = width.saturating_mul(height);
        if !(pixel_m > 0.0 && pixel_m.is_finite() && (1..=MOST_PIXELS).contains(&pixels)) {
            return Err(PictureError::Size { size_px: camera.size_px, pixel_m });
        }
        let (right, up) = camera.axes()?;
        let place = |p: DVec3| {
            [0.5 * width as f64 + p.dot(right) / pixel_m, 0.5 * height as f64 - p.dot(up) / pixel_m]
        };
        let view = View::Distant(camera.toward);
        let scene = eye.body().scene();
        let mut light = vec![Cover::new(width, height); bands.len()];
        let mut outline = Vec::new();
        eye.pieces(sun_body, sun_body, view, &mut |piece, weights| {
            let range = scene.weights_of(piece.material);
            // A square metre across the line of sight holds 1/cosθ_o of the surface.
            let scale = pixel_m * pixel_m / piece.to_observer.z;
            each(piece, &place, &mut outline, |outline| {
                for (cover, factors) in light.iter_mut().zip(bands) {
                    let pairs = weights[range.clone()].iter().zip(&factors[range.clone()]);
                    cover.add(outline, scale * pairs.map(|(w, f)| w * f).sum::<f64>());
                }
            });
        })?;
        for glint in eye.glints(sun_body, sun_body, camera.toward)? {
            let range = scene.weights_of(glint.material);
            let [x, y] = place(glint.point_m);
            let square = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)];
            let square = square.map(|(dx, dy)| [x + dx, y + dy]);
            for (cover, factors) in light.iter_mut().zip(bands) {
                let pairs = glint.weights.iter().zip(&factors[range.clone()]);
                cover.add(&square, pairs.map(|(w, f)| w * f).sum());
            }
        }
        // What is seen, lit or not, is what is lit from where the observer is.
        let mut materials = vec![Cover::new(width, height); scene.materials().len()];
        let mut planes = [0, 1, 2].map(|_| Cover::new(width, height));
        // Nothing of a pixel is farther or nearer than the polygons that reach it: a plane that is seen at a grazing angle says nothing at the pixel's middle
        // where it covers only a part of it.
        let mut reach = vec![[f64::INFINITY, f64::NEG_INFINITY]; pixels];
        let along = camera.toward.normalize_or_zero();
        eye.pieces(camera.toward, sun_body, view, &mut |piece, _| {
            // Depth over the picture is a plane: its values at the origin and one pixel to the right and down.
            let normal = piece.axes[2];
            let slope = |axis: DVec3| normal.dot(axis) / normal.dot(along) * pixel_m;
            let (x, y) = (slope(right), -slope(up));
            let [px, py] = place(piece.origin);
            let at_zero = -piece.origin.dot(along) - px * x - py * y;
            each(piece, &place, &mut outline, |outline| {
                materials[piece.material].add(outline, 1.0);
                for (plane, value) in planes.iter_mut().zip([at_zero, x, y]) {
                    plane.add(outline, value);
                }
                widen(&mut reach, camera.size_px, outline, |[px, py]| at_zero + px * x + py * y);
            });
        })?;
        let materials: Vec<Vec<f64>> = materials.iter().map(Cover::finish).collect();
        let [at_zero, x, y] = planes.map(|p| p.finish());
        let depth = |k: usize| {
            let seen: f64 = materials.iter().map(|m| m[k]).sum();
            let (column, row) = ((k % width) as f64 + 0.5, (k / width) as f64 + 0.5);
            let depth = (at_zero[k] + column * x[k] + row * y[k]) / seen;
            let [least, most] = reach[k];
            if seen > 1e-9 && least <= most { depth.clamp(least, most) } else { f64::NAN }
        };
        Ok(Self {
            size_px: camera.size_px,
            pixel_m,
            bands: light.iter().map(Cover::finish).collect(),
            depth_m: (0..pixels).map(depth).collect(),
            materials,
        })
    }

    /// The bands as they look through a point spread function: a normal distribution of this full width at half maximum, m at the body. Light that leaves the
    /// picture is lost.
    #[must_use]
    pub fn blurred(&self, fwhm_m: f64) -> Self {
        let sigma_px = fwhm_m / self.pixel_m / (8.0 * std::f64::consts::LN_2).sqrt();
        if sigma_px.is_nan() || sigma_px <= 0.0 {
            return self.clone();
        }
        let [width, height] = self.size_px;
        // The share of a pixel's light that falls into one so many pixels away, from its middle.
        let edge = |d: f64| 0.5 * libm::erf(d / (sigma_px * std::f64::consts::SQRT_2));
        let reach = ((8.0 * sigma_px).ceil() as usize).min(width.max(height));
        let shares: Vec<f64> =
            (0..=reach).map(|apart| edge(apart as f64 + 0.5) - edge(apart as f64 - 0.5)).collect();
        let along = |from: &[f64], stride: usize, length: usize, lines: usize, step: usize| {
            let mut out = vec![0.0; from.len()];
            for line in 0..lines {
                for to in 0..length {
                    let near = to.saturating_sub(reach)..(to + reach + 1).min(length);
                    out[line * step + to * stride] =
                        near.map(|k| shares[k.abs_diff(to)] * from[line * step + k * stride]).sum();
                }
            }
            out
        };
        let blur = |band: &Vec<f64>| {
            let rows = along(band, 1, width, height, width);
            along(&rows, width, height, width, 1)
        };
        Self { bands: self.bands.iter().map(blur).collect(), ..self.clone() }
    }

    /// The material that covers most of each pixel; `None` where less than half of it is covered.
    pub fn material_of(&self, pixel: usize) -> Option<usize> {
        let seen: f64 = self.materials.iter().map(|m| m[pixel]).sum();
        let most =
            self.materials.iter().enumerate().max_by(|a, b| a.1[pixel].total_cmp(&b.1[pixel]));
        most.filter(|_| seen > 0.5).map(|(k, _)| k)
    }
}

/// Widens the depths that pixels may have by those of a polygon's corners, in its box.
fn widen(
    reach: &mut [[f64; 2]],
    [width, height]: [usize; 2],
    outline: &[[f64; 2]],
    depth: impl Fn([f64; 2]) -> f64,
) {
    let empty = [f64::INFINITY, f64::NEG_INFINITY];
    let span = |of: &dyn Fn([f64; 2]) -> f64| {
        outline.iter().fold(empty, |[a, b], p| [a.min(of(*p)), b.max(of(*p))])
    };
    let (x, y, z) = (span(&|p| p[0]), span(&|p| p[1]), span(&depth));
    // A float becomes 0 below 0.
    let cells = |[from, to]: [f64; 2], count: usize| {
        from.floor() as usize..((to.ceil().max(0.0)) as usize).min(count)
    };
    for row in cells(y, height) {
        for column in cells(x, width) {
            let own = &mut reach[row * width + column];
            *own = [own[0].min(z[0]), own[1].max(z[1])];
        }
    }
}

/// The outlines of a piece in pixels.
fn each(
    piece: &Piece<'_>,
    place: &impl Fn(DVec3) -> [f64; 2],
    outline: &mut Vec<[f64; 2]>,
    mut take: impl FnMut(&[[f64; 2]]),
) {
    for polygon in piece.polygons() {
        outline.clear();
        // Pixels count downwards, which turns the outline over.
        outline.extend(polygon.iter().rev().map(|p| place(piece.point(*p))));
        take(outline);
    }
}
