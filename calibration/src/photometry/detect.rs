//! The sources of a frame, and which of them may be the target.

use super::centroid::{Centroid, FWHM_PER_SIGMA, windowed};
use super::image::{Image, Narrow};
use super::look::{Look, Setting};
use super::options::{Choice, DetectionOptions, Trail};
use super::overlap::Aperture;
use super::regions::{Region, Regions};
use super::tiles::TILE;
use super::window::{Reading, Window};
use glam::DVec2;

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
    /// Bounding box too long.
    Aspect,
    /// Narrower than a point: a cosmic ray or a hot pixel.
    Sharp,
    /// Wider than a point: a streak, a cloud; or no trail as it is known.
    Wide,
    /// At the frame's edge, less than one and a half widths from it: there a streak's end looks like a point.
    Edge,
    /// A knot of a faint streak: there is light on a line through it.
    Streak,
}

/// A source above the threshold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// Column and row of its summit in the smoothed frame, px, or of its centroid where there is one.
    pub place_px: DVec2,
    /// Height of its summit in standard deviations of the smoothed frame: its signal to noise as a point.
    pub peak_sigma: f64,
    /// Pixels above its level.
    pub area_px: usize,
    /// Fraction of its bounding box that it fills.
    pub fill: f64,
    /// The longer side of the bounding box over the shorter.
    pub aspect: f64,
    /// Signal to noise of the source as something a third as wide as a point, over that as a point: 0.55 for a point, more than 1 for what is sharp; NaN
    /// where it is so bright that its centroid tells its width.
    pub sharpness: f64,
    /// Place and widths, of those that pass the filters before.
    pub centroid: Option<Centroid>,
    /// The trail that its second moments show, px.
    pub trail_px: DVec2,
    /// Why it is not the target.
    pub rejection: Option<Rejection>,
}

/// Result of a detection.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Detection {
    /// All sources of the part of the frame that was searched, those that passed and those that did not.
    pub candidates: Vec<Candidate>,
    /// Index of the target.
    pub target: Option<usize>,
    /// Pixels (column and row) that were left out of the search, for they are sharper than a point: cosmic rays and hot pixels.
    pub cosmic_ray_px: Vec<DVec2>,
    /// Pixels of sources, column and row, each with the number of its source.
    taken_px: Vec<([f64; 2], u32)>,
    /// The numbers of the candidates.
    numbers: Vec<u32>,
}

impl Candidate {
    /// Whether its second moments are those of a line this many times as long as what a source as wide as a line of its pixels would have.
    pub fn is_long(&self, times: f64) -> bool {
        let length = self.trail_px.length();
        length > 0.0 && length * length > times * self.area_px as f64
    }
}

impl Detection {
    /// Sources that passed all filters.
    pub fn passed(&self) -> usize {
        self.candidates.iter().filter(|c| c.rejection.is_none()).count()
    }

    /// Whether a source other than the target, or a cosmic ray, has a pixel in this aperture.
    pub fn crowded(&self, aperture: &Aperture) -> bool {
        self.target.is_some_and(|target| self.others_in(aperture, Some(target)))
    }

    /// Whether a source other than this candidate, or a cosmic ray, has a pixel in this aperture.
    pub(crate) fn others_in(&self, aperture: &Aperture, own: Option<usize>) -> bool {
        let own = own.and_then(|own| self.numbers.get(own)).copied();
        let inside = |p: [f64; 2]| aperture.distance_px(p[0], p[1]) < aperture.radius_px;
        self.cosmic_ray_px.iter().any(|p| inside(p.to_array()))
            || self.taken_px.iter().any(|&(p, source)| Some(source) != own && inside(p))
    }

    /// The candidate nearest to a place, within a distance.
    pub(crate) fn nearest(&self, place_px: DVec2, within_px: f64) -> Option<usize> {
        let off =
            |i: &usize| distance(self.candidates[*i].place_px.to_array(), place_px.to_array());
        let near = (0..self.candidates.len()).filter(|i| off(i) <= within_px);
        near.min_by(|a, b| off(a).total_cmp(&off(b)))
    }
}

/// Finds sources: smooths with a point's profile, cuts at a threshold above the local background, and filters what hangs together.
#[derive(Debug, Default)]
pub struct Detector {
    window: Window,
    image: Image,
    regions: Regions,
    look: Look,
}

/// Inputs of a detection about the target.
#[derive(Clone, Copy)]
pub(crate) struct Sought<'a> {
    pub options: &'a DetectionOptions,
    pub fwhm_px: f64,
    pub trail: Trail,
    pub(crate) place_px: [f64; 2],
    pub aperture_radius_px: f64,
    /// How far from its place the nearest source probably is, px: the search looks there first.
    pub probably_px: f64,
}

impl Sought<'_> {
    /// Pixels around what is searched, so that its background, its streaks and its aperture are seen whole.
    fn margin_px(&self) -> f64 {
        let trail = match self.trail {
            Trail::Known(trail) => trail[0].hypot(trail[1]),
            _ => 0.0,
        };
        let streak = (STREAK_WIDTHS + 1.0) * self.fwhm_px;
        (TILE as f64 + 4.0 * self.fwhm_px).max(streak).max(self.aperture_radius_px + trail)
    }

    /// Distance of a source from the place, px.
    pub(crate) fn offset_px(&self, candidate: &Candidate) -> f64 {
        distance(candidate.place_px.to_array(), self.place_px)
    }

    /// How far from the place the search looks first. A source there that passes is the nearest of the whole frame, too; only where the brightest is
    /// the target must all of it be searched. One of a few steps, so that what is found hangs little on what was probable.
    fn first_px(&self) -> f64 {
        let most = self.options.max_offset_px;
        if self.options.choice == Choice::Brightest {
            return most;
        }
        let mut first = first_px(self.fwhm_px);
        while first < self.probably_px && first < most {
            first *= 1.25;
        }
        first.min(most)
    }
}

impl Detector {
    /// The sources around where the target is expected: as far as the nearest that passes the filters needs, else of the whole frame or as far as the
    /// allowed offset.
    pub(crate) fn find(
        &mut self,
        reading: &Reading<'_>,
        sought: &Sought<'_>,
        setting: &Setting,
    ) -> Detection {
        let size = [reading.frame.pixels.ncols(), reading.frame.pixels.nrows()];
        let all = (0..2).all(|axis| {
            let reach = sought.first_px() + sought.margin_px();
            sought.place_px[axis] - reach <= 0.0
                && sought.place_px[axis] + reach >= size[axis] as f64
        });
        let most = sought.options.max_offset_px;
        if !all && sought.first_px() < most {
            let near = self.search(reading, sought, setting, sought.first_px());
            if near.target.is_some() {
                return near;
            }
        }
        self.search(reading, sought, setting, most)
    }

    /// The sources within a distance of where the target is expected.
    pub(crate) fn search(
        &mut self,
        reading: &Reading<'_>,
        sought: &Sought<'_>,
        setting: &Setting,
        within_px: f64,
    ) -> Detection {
        self.window.take(reading, sought.place_px, [within_px + sought.margin_px(); 2]);
        if !self.image.take(&self.window, reading) {
            return Detection::default();
        }
        let sigma_px = sought.fwhm_px / FWHM_PER_SIGMA;
        let (size, origin) = (self.image.size, self.image.origin);
        let place = |i: usize| [origin[0] + (i % size[0]) as f64, origin[1] + (i / size[0]) as f64];
        let sharp = self.image.take_out_sharp(sigma_px);
        // Only faint sources ask for it.
        let mut narrow = None;
        let threshold = sought.options.threshold_sigma;
        let smoothed = self.image.significance(sigma_px);
        let (found, taken) = self.regions.find(smoothed, size, threshold, 0.5 * threshold);
        let mut detection = Detection {
            cosmic_ray_px: sharp.into_iter().map(|i| place(i).into()).collect(),
            taken_px: taken.into_iter().map(|(pixel, source)| (place(pixel), source)).collect(),
            ..Detection::default()
        };
        for region in &found {
            if let Some(candidate) =
                self.judge(reading, (region, &mut narrow), &detection, sought, setting, within_px)
            {
                detection.numbers.push(region.label);
                detection.candidates.push(candidate);
            }
        }
        detection.target = choose(&detection.candidates, sought);
        detection
    }

    /// A region as a candidate, with the first filter that it fails; `None` where it is allowed, and further away than is searched.
    fn judge(
        &mut self,
        reading: &Reading<'_>,
        (region, narrow): (&Region, &mut Option<Narrow>),
        detection: &Detection,
        sought: &Sought<'_>,
        setting: &Setting,
        within_px: f64,
    ) -> Option<Candidate> {
        let options = sought.options;
        let trail_px = trail_of(region);
        let drawn_out = !matches!(sought.trail, Trail::Point)
            && trail_px[0].hypot(trail_px[1]) > 0.5 * sought.fwhm_px;
        let origin = self.image.origin;
        let at = match drawn_out {
            true => [origin[0] + region.middle[0], origin[1] + region.middle[1]],
            false => [origin[0] + region.summit[0] as f64, origin[1] + region.summit[1] as f64],
        };
        let offset_px = distance(at, sought.place_px);
        if offset_px > within_px && offset_px <= options.max_offset_px {
            return None;
        }
        // Only faint ones are judged by it.
        let faint = region.peak < FAINT * options.threshold_sigma;
        let sharpness =
            if faint { self.sharpness(region, narrow, sought.fwhm_px) } else { f64::NAN };
        let mut candidate = Candidate {
            place_px: at.into(),
            peak_sigma: region.peak,
            area_px: region.area,
            fill: region.fill(),
            aspect: region.aspect(),
            sharpness,
            centroid: None,
            trail_px: trail_px.into(),
            rejection: None,
        };
        let by_box = if offset_px > options.max_offset_px {
            Some(Rejection::Offset)
        } else if near_edge(at, reading, 1.5 * sought.fwhm_px) {
            Some(Rejection::Edge)
        } else if !(options.area_px[0]..=options.area_px[1]).contains(&region.area) {
            Some(Rejection::Area)
        } else if !drawn_out && candidate.fill < options.min_fill {
            Some(Rejection::Fill)
        } else if !drawn_out && candidate.aspect > options.max_aspect {
            Some(Rejection::Aspect)
        } else if faint && sharpness > options.max_sharpness {
            Some(Rejection::Sharp)
        } else {
            None
        };
        candidate.rejection = by_box.or_else(|| {
            let aperture = Aperture::disc(at.into(), sought.aperture_radius_px);
            self.look.at(reading, &aperture, setting);
            let light = self.look.light(reading, setting, &detection.cosmic_ray_px);
            candidate.centroid =
                light.and_then(|light| windowed(&light, at, sought.fwhm_px / FWHM_PER_SIGMA));
            by_width(&candidate, drawn_out, sought)
        });
        if let Some(centroid) = candidate.centroid.filter(|_| !drawn_out) {
            candidate.place_px = centroid.place_px;
        }
        // A bright streak stays in one piece, and a bright star has light all around.
        if faint && matches!(sought.trail, Trail::Point) && candidate.rejection.is_none() {
            let (smoothed, size) = (self.image.smoothed(), self.image.size);
            if on_streak(region.summit, smoothed, size, sought.fwhm_px) {
                candidate.rejection = Some(Rejection::Streak);
            }
        }
        Some(candidate)
    }

    /// The highest value of the narrowly smoothed frame near a region's summit, over the summit.
    fn sharpness(&mut self, region: &Region, narrow: &mut Option<Narrow>, fwhm_px: f64) -> f64 {
        let reach = (0.5 * fwhm_px).round() as usize;
        let sigma_px = (NARROW * (fwhm_px / FWHM_PER_SIGMA)).max(0.5);
        let narrow = narrow.get_or_insert_with(|| self.image.narrow(sigma_px));
        self.image.highest(narrow, region.summit, reach) / region.peak
    }
}

/// Least distance to which the first search goes, px.
pub(super) fn first_px(fwhm_px: f64) -> f64 {
    (8.0 * fwhm_px).max(TILE as f64)
}

/// Sources below so many thresholds are tested for a faint cosmic ray's or a faint streak's signs; brighter ones show their shape.
const FAINT: f64 = 2.5;

/// So many widths to either side a streak is looked for.
const STREAK_WIDTHS: f64 = 10.0;

/// Width of the second, narrow filter over that of a point.
const NARROW: f64 = 0.3;

/// Whether a place is within a distance of the frame's edge.
fn near_edge(place: [f64; 2], reading: &Reading<'_>, distance_px: f64) -> bool {
    let size = [reading.frame.pixels.ncols(), reading.frame.pixels.nrows()].map(|n| n as f64);
    (0..2)
        .any(|axis| place[axis] + 0.5 < distance_px || size[axis] - 0.5 - place[axis] < distance_px)
}

/// Whether there is light along a line through a summit: samples of the smoothed frame a width apart, from two widths on to ten at most, on
/// one side or both. Each counts no more than 3 σ, so that another star on the line does not make it a streak.
fn on_streak(summit: [usize; 2], smoothed: &[f32], size: [usize; 2], fwhm_px: f64) -> bool {
    const DIRECTIONS: usize = 30;
    const SAMPLES: usize = STREAK_WIDTHS as usize;
    const SIGMA: f64 = 5.0;
    const CONTINUOUS: f64 = 1.6;
    let sample = |angle: f64, along: f64| {
        let x = (summit[0] as f64 + along * angle.cos()).round();
        let y = (summit[1] as f64 + along * angle.sin()).round();
        let inside = x >= 0.0 && y >= 0.0 && x < size[0] as f64 && y < size[1] as f64;
        if inside {
            f64::from(smoothed[y as usize * size[0] + x as usize]).clamp(-3.0, 3.0)
        } else {
            0.0
        }
    };
    (0..DIRECTIONS).any(|direction| {
        let angle = std::f64::consts::PI * direction as f64 / DIRECTIONS as f64;
        let mut sums = [0.0; 2];
        // A streak that merely crosses the line begins further out.
        let mut alive = [1.0; 2];
        (1..=SAMPLES).any(|n| {
            let along = (n as f64 + 1.0) * fwhm_px;
            sums = [sums[0] + sample(angle, along), sums[1] + sample(angle, -along)];
            if n >= 3 {
                let alone = |i: usize| if sums[i] > CONTINUOUS * n as f64 { alive[i] } else { 0.0 };
                alive = [alone(0), alone(1)];
            }
            let sides: f64 = alive.iter().sum();
            let sum = alive[0] * sums[0] + alive[1] * sums[1];
            sides * n as f64 >= 4.0 && sum > SIGMA * (sides * n as f64).sqrt()
        })
    })
}

/// The filters that need a closer look.
fn by_width(candidate: &Candidate, drawn_out: bool, sought: &Sought<'_>) -> Option<Rejection> {
    let options = sought.options;
    // A trail's centroid under a small window may run along it.
    let Some(centroid) = candidate.centroid else {
        return if drawn_out { wrong_trail(candidate, sought) } else { Some(Rejection::Wide) };
    };
    let [narrow, wide] = centroid.fwhm_px.to_array().map(|f| f / sought.fwhm_px);
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
            let off = |c: &Candidate| distance(c.place_px.to_array(), sought.place_px);
            off(a).total_cmp(&off(b))
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
