//! The sources of a frame, and which of them may be the target.

use super::background::{Clipping, clipped_median};
use super::centroid::{Centroid, FWHM_PER_SIGMA, windowed};
use super::look::{Look, Setting};
use super::options::{Choice, DetectionOptions, Trail};
use super::overlap::Aperture;
use super::regions::{Region, regions};
use super::window::{Reading, Window};

/// Why a source is not the target: the first of the filters that it fails.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Rejection {
    /// Further from the expected place than allowed.
    Offset,
    /// Too few or too many pixels.
    Area,
    /// It does not fill its bounding box.
    Fill,
    /// Its bounding box is long.
    Aspect,
    /// Narrower than a point: a cosmic ray or a hot pixel.
    Sharp,
    /// Wider than a point: a streak, a cloud; or no trail as it is known.
    Wide,
}

/// A source above the threshold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// Column and row of its summit in the smoothed frame, px, or of its centroid where there is one.
    pub place_px: [f64; 2],
    /// Height of its summit in standard deviations of the smoothed frame: its signal to noise as a point.
    pub peak_sigma: f64,
    /// Pixels above its level.
    pub area_px: usize,
    /// Fraction of its bounding box that it fills.
    pub fill: f64,
    /// The longer side of the bounding box over the shorter.
    pub aspect: f64,
    /// Place and widths, of those that pass the filters before.
    pub centroid: Option<Centroid>,
    /// The trail that its second moments show, px.
    pub trail_px: [f64; 2],
    /// Why it is not the target.
    pub rejection: Option<Rejection>,
}

/// What a detection found.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Detection {
    /// All sources, those that passed and those that did not.
    pub candidates: Vec<Candidate>,
    /// Index of the target.
    pub target: Option<usize>,
    labels: Labels,
}

/// Which source each pixel of the smoothed frame belongs to.
#[derive(Debug, Clone, PartialEq, Default)]
struct Labels {
    of_pixel: Vec<u32>,
    size: [usize; 2],
    /// Where its first pixel is in the frame.
    origin: [f64; 2],
}

impl Detection {
    /// Sources that passed all filters.
    pub fn passed(&self) -> usize {
        self.candidates.iter().filter(|c| c.rejection.is_none()).count()
    }

    /// Whether a source other than the target has a pixel above the threshold in this aperture.
    pub fn crowded(&self, aperture: &Aperture) -> bool {
        let Some(target) = self.target else { return false };
        let own = target as u32 + 1;
        self.labels.of_pixel.iter().enumerate().any(|(i, &label)| {
            label != 0 && label != own && {
                let place = self.labels.place([i % self.labels.size[0], i / self.labels.size[0]]);
                aperture.distance_px(place[0], place[1]) < aperture.radius_px
            }
        })
    }
}

impl Labels {
    fn place(&self, [x, y]: [usize; 2]) -> [f64; 2] {
        [self.origin[0] + x as f64, self.origin[1] + y as f64]
    }
}

/// Finds sources: smooths with a point's profile, cuts at a threshold above the local background, and filters what hangs together.
#[derive(Debug, Default)]
pub struct Detector {
    window: Window,
    look: Look,
}

/// What a detection needs to know of the target.
#[derive(Clone, Copy)]
pub(crate) struct Sought<'a> {
    pub options: &'a DetectionOptions,
    pub fwhm_px: f64,
    pub trail: Trail,
    pub place_px: [f64; 2],
    pub aperture_radius_px: f64,
}

impl Detector {
    /// The sources around where the target is expected; of the whole frame where the allowed offset is infinite.
    pub(crate) fn find(
        &mut self,
        reading: &Reading<'_>,
        sought: &Sought<'_>,
        setting: &Setting,
    ) -> Detection {
        let around = sought.options.max_offset_px + TILE as f64 + 4.0 * sought.fwhm_px;
        self.window.take(reading, sought.place_px, [around; 2]);
        let Some(image) = Image::of(&self.window, reading) else { return Detection::default() };
        let smoothed = image.significance(sought.fwhm_px / FWHM_PER_SIGMA);
        let (found, labels) = regions(&smoothed, image.size, sought.options.threshold_sigma);
        let labels = Labels { of_pixel: labels, size: image.size, origin: image.origin };
        let candidates: Vec<Candidate> = found
            .iter()
            .map(|region| self.judge(reading, region, &labels, sought, setting))
            .collect();
        let target = choose(&candidates, sought);
        Detection { candidates, target, labels }
    }

    /// A region as a candidate, with the first filter that it fails.
    fn judge(
        &mut self,
        reading: &Reading<'_>,
        region: &Region,
        labels: &Labels,
        sought: &Sought<'_>,
        setting: &Setting,
    ) -> Candidate {
        let options = sought.options;
        let trail_px = trail_of(region);
        let drawn_out = !matches!(sought.trail, Trail::Point)
            && trail_px[0].hypot(trail_px[1]) > 0.5 * sought.fwhm_px;
        let at = match drawn_out {
            true => [labels.origin[0] + region.middle[0], labels.origin[1] + region.middle[1]],
            false => labels.place(region.summit),
        };
        let mut candidate = Candidate {
            place_px: at,
            peak_sigma: region.peak,
            area_px: region.area,
            fill: region.fill(),
            aspect: region.aspect(),
            centroid: None,
            trail_px,
            rejection: None,
        };
        let by_box = if distance(at, sought.place_px) > options.max_offset_px {
            Some(Rejection::Offset)
        } else if !(options.area_px[0]..=options.area_px[1]).contains(&region.area) {
            Some(Rejection::Area)
        } else if !drawn_out && candidate.fill < options.min_fill {
            Some(Rejection::Fill)
        } else if !drawn_out && candidate.aspect > options.max_aspect {
            Some(Rejection::Aspect)
        } else {
            None
        };
        candidate.rejection = by_box.or_else(|| {
            let aperture = Aperture::disc(at, sought.aperture_radius_px);
            self.look.at(reading, &aperture, setting);
            let light = self.look.light(reading, setting);
            candidate.centroid =
                light.and_then(|light| windowed(&light, at, sought.fwhm_px / FWHM_PER_SIGMA));
            by_width(&candidate, drawn_out, sought)
        });
        if let Some(centroid) = candidate.centroid.filter(|_| !drawn_out) {
            candidate.place_px = centroid.place_px;
        }
        candidate
    }
}

/// The filters that need a closer look.
fn by_width(candidate: &Candidate, drawn_out: bool, sought: &Sought<'_>) -> Option<Rejection> {
    let options = sought.options;
    // A trail's centroid under a small window may run along it.
    let Some(centroid) = candidate.centroid else {
        return if drawn_out { wrong_trail(candidate, sought) } else { Some(Rejection::Wide) };
    };
    let [narrow, wide] = centroid.fwhm_px.map(|f| f / sought.fwhm_px);
    if narrow < options.min_width {
        return Some(Rejection::Sharp);
    }
    if drawn_out {
        return wrong_trail(candidate, sought);
    }
    (wide > options.max_width).then_some(Rejection::Wide)
}

/// A known trail must be met to half its length and three widths, and to a third of a right angle.
fn wrong_trail(candidate: &Candidate, sought: &Sought<'_>) -> Option<Rejection> {
    let Trail::Known(known) = sought.trail else { return None };
    let seen = candidate.trail_px;
    let (length, seen_length) = (known[0].hypot(known[1]), seen[0].hypot(seen[1]));
    let cosine = (known[0] * seen[0] + known[1] * seen[1]).abs() / (length * seen_length);
    let fits = (seen_length - length).abs() <= 0.5 * length + 3.0 * sought.fwhm_px;
    let aligned = length < 2.0 * sought.fwhm_px || cosine > 0.866;
    (!(fits && aligned)).then_some(Rejection::Wide)
}

fn choose(candidates: &[Candidate], sought: &Sought<'_>) -> Option<usize> {
    let passed = candidates.iter().enumerate().filter(|(_, c)| c.rejection.is_none());
    let chosen = match sought.options.choice {
        Choice::Nearest => passed.min_by(|(_, a), (_, b)| {
            distance(a.place_px, sought.place_px).total_cmp(&distance(b.place_px, sought.place_px))
        }),
        Choice::Brightest => passed.max_by(|(_, a), (_, b)| a.peak_sigma.total_cmp(&b.peak_sigma)),
    };
    chosen.map(|(index, _)| index)
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// The trail whose second moments a region has: those of a line of length L are L²/12 along it.
fn trail_of(region: &Region) -> [f64; 2] {
    let [xx, yy, xy] = region.moments;
    let half = (0.25 * (xx - yy).powi(2) + xy * xy).sqrt();
    let length = (24.0 * half).sqrt();
    let angle = 0.5 * (2.0 * xy).atan2(xx - yy);
    [length * angle.cos(), length * angle.sin()]
}

/// Pixels across a tile of the local background.
const TILE: usize = 32;

/// A window as one image: the values of a monochrome frame, or the means of the 2 × 2 squares of a mosaic (each of which holds all colours).
struct Image {
    values: Vec<f32>,
    size: [usize; 2],
    /// Where its first pixel is in the frame.
    origin: [f64; 2],
}

impl Image {
    /// `None` of an empty window.
    fn of(window: &Window, reading: &Reading<'_>) -> Option<Self> {
        let full = reading.saturation_adu as f32;
        let [width, height] = window.size;
        let value = |v: f32| if v == f32::INFINITY { full } else { v };
        let origin = window.origin.map(|o| o as f64);
        if reading.frame.bayer.is_none() {
            let values: Vec<f32> = window.values.iter().map(|&v| value(v)).collect();
            return (!values.is_empty()).then_some(Self { values, size: window.size, origin });
        }
        let size = [width.checked_sub(1)?, height.checked_sub(1)?];
        let mut values = Vec::with_capacity(size[0] * size[1]);
        for y in 0..size[1] {
            let (upper, lower) =
                (&window.values[y * width..][..width], &window.values[(y + 1) * width..][..width]);
            for x in 0..size[0] {
                let square = [upper[x], upper[x + 1], lower[x], lower[x + 1]];
                values.push(square.into_iter().map(value).sum::<f32>() / 4.0);
            }
        }
        (!values.is_empty()).then_some(Self { values, size, origin: origin.map(|o| o + 0.5) })
    }

    /// The image above its local background, smoothed with a normal profile, in standard deviations of that. Masked pixels count nothing.
    fn significance(&self, sigma_px: f64) -> Vec<f64> {
        let tiles = Tiles::of(self);
        let [width, height] = self.size;
        let mut image: Vec<f64> = Vec::with_capacity(self.values.len());
        for y in 0..height {
            for x in 0..width {
                let value = f64::from(self.values[y * width + x]);
                let (level, sigma) = tiles.at(x, y);
                image.push(if value.is_nan() { 0.0 } else { (value - level) / sigma });
            }
        }
        let smoothed = smooth(&image, self.size, sigma_px);
        // Squares of a mosaic share pixels, so the noise of the smoothed frame is measured, not derived.
        let mut sorted: Vec<f32> = smoothed.iter().map(|&v| v as f32).collect();
        let scatter = clipped_median(&mut sorted, &CLIPPING)
            .map_or(1.0, |b| b.pixel_sigma_adu)
            .max(f64::MIN_POSITIVE);
        let middle = clipped_median(&mut sorted, &CLIPPING).map_or(0.0, |b| b.level_adu);
        smoothed.iter().map(|v| (v - middle) / scatter).collect()
    }
}

/// Clipping for levels of tiles and of the smoothed frame.
const CLIPPING: Clipping =
    Clipping { sigma: 3.0, rounds: 8, gain_and_read_noise: None, step_adu: 0.0 };

/// Levels and scatters of the tiles of an image, each the median of its neighbourhood.
struct Tiles {
    count: [usize; 2],
    size: [f64; 2],
    level: Vec<f64>,
    sigma: Vec<f64>,
}

impl Tiles {
    fn of(image: &Image) -> Self {
        let count = image.size.map(|n| (n / TILE).max(1));
        let size = [0, 1].map(|axis| image.size[axis] as f64 / count[axis] as f64);
        let (mut level, mut sigma) = (Vec::new(), Vec::new());
        let mut values = Vec::new();
        let edge = |axis: usize, i: usize| (i as f64 * size[axis]).round() as usize;
        for row in 0..count[1] {
            for column in 0..count[0] {
                values.clear();
                for y in edge(1, row)..edge(1, row + 1).min(image.size[1]) {
                    let from = y * image.size[0];
                    let line = &image.values
                        [from + edge(0, column)..from + edge(0, column + 1).min(image.size[0])];
                    values.extend(line.iter().copied().filter(|v| v.is_finite()));
                }
                let found = clipped_median(&mut values, &CLIPPING);
                level.push(found.map_or(f64::NAN, |b| b.level_adu));
                sigma.push(found.map_or(f64::NAN, |b| b.pixel_sigma_adu));
            }
        }
        // Whole counts scatter by 1/√12 at least.
        let least = 12f64.sqrt().recip();
        Self {
            count,
            size,
            level: around(&level, count, 0.0),
            sigma: around(&sigma, count, least).iter().map(|s| s.max(least)).collect(),
        }
    }

    /// Level between the tiles' middles, and the scatter of the tile.
    fn at(&self, x: usize, y: usize) -> (f64, f64) {
        let [columns, rows] = self.count;
        let axis = |at: usize, axis: usize| {
            let place = ((at as f64 + 0.5) / self.size[axis] - 0.5)
                .clamp(0.0, (self.count[axis] - 1) as f64);
            (place as usize, (place as usize + 1).min(self.count[axis] - 1), place.fract())
        };
        let (x0, x1, u) = axis(x, 0);
        let (y0, y1, v) = axis(y, 1);
        let level = |column: usize, row: usize| self.level[row * columns + column];
        let upper = level(x0, y0) * (1.0 - u) + level(x1, y0) * u;
        let lower = level(x0, y1) * (1.0 - u) + level(x1, y1) * u;
        let nearest =
            |at: usize, axis: usize, n: usize| ((at as f64 / self.size[axis]) as usize).min(n - 1);
        let sigma = self.sigma[nearest(y, 1, rows) * columns + nearest(x, 0, columns)];
        (upper * (1.0 - v) + lower * v, sigma)
    }
}

/// The median of each tile and its neighbours; `otherwise` where there is none.
fn around(values: &[f64], [columns, rows]: [usize; 2], otherwise: f64) -> Vec<f64> {
    let mut out = Vec::with_capacity(values.len());
    for row in 0..rows {
        for column in 0..columns {
            let mut near: Vec<f64> = (row.saturating_sub(1)..(row + 2).min(rows))
                .flat_map(|r| {
                    (column.saturating_sub(1)..(column + 2).min(columns))
                        .map(move |c| r * columns + c)
                })
                .map(|i| values[i])
                .filter(|v| v.is_finite())
                .collect();
            near.sort_by(f64::total_cmp);
            let n = near.len();
            out.push(if n == 0 { otherwise } else { 0.5 * (near[(n - 1) / 2] + near[n / 2]) });
        }
    }
    out
}

/// Convolution with a normal profile of sum of squares 1 in both directions; what is beyond the edge counts nothing.
fn smooth(image: &[f64], [width, height]: [usize; 2], sigma_px: f64) -> Vec<f64> {
    let reach = (4.0 * sigma_px).ceil() as usize;
    let profile: Vec<f64> =
        (0..=reach).map(|i| (-0.5 * (i as f64 / sigma_px).powi(2)).exp()).collect();
    let norm = (2.0 * profile.iter().skip(1).map(|p| p * p).sum::<f64>() + 1.0).sqrt();
    let profile: Vec<f64> = profile.iter().map(|p| p / norm).collect();
    let mut rows = vec![0.0; image.len()];
    for (line, out) in image.chunks_exact(width).zip(rows.chunks_exact_mut(width)) {
        for (x, out) in out.iter_mut().enumerate() {
            let from = x.saturating_sub(reach);
            let part = &line[from..(x + reach + 1).min(width)];
            *out = part.iter().enumerate().map(|(i, v)| v * profile[(from + i).abs_diff(x)]).sum();
        }
    }
    let mut out = vec![0.0; image.len()];
    for y in 0..height {
        for other in y.saturating_sub(reach)..(y + reach + 1).min(height) {
            let weight = profile[other.abs_diff(y)];
            let (to, from) = (&mut out[y * width..][..width], &rows[other * width..][..width]);
            for (to, from) in to.iter_mut().zip(from) {
                *to += weight * from;
            }
        }
    }
    out
}
