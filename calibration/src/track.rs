//! Where the target stood on the camera's frame, and when: what the photometry of frames finds, and what the gating of counts needs.

use glam::DVec2;
use hifitime::Epoch;
use sunglint_numerics::order;

/// The target in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackPoint {
    /// The middle of the exposure.
    pub time: Epoch,
    /// Length of the exposure, s.
    pub exposure_s: f64,
    /// Where the target was found; `None` where it was not.
    pub place: Option<Place>,
}

/// A place on a frame, with its uncertainty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Columns and rows from the middle of the camera's sensor, unbinned pixels: the origin of a fibre's
    /// [`offset_px`](sunglint_radiometry::station::Fibre::offset_px). Rows grow in the order of the file.
    pub offset_px: DVec2,
    /// Variances of column and row and their covariance, px².
    pub covariance_px2: [f64; 3],
}

/// The target in the frames of a stretch of time, in the order of time.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Track {
    /// One point a frame.
    pub points: Vec<TrackPoint>,
}

/// Where the target stood between two frames that both show it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interpolated {
    /// The place, with what the frames and the way between them leave open.
    pub place: Place,
    /// Drift of the target, px/s.
    pub drift_px_per_s: DVec2,
}

/// Median of χ² with one degree of freedom.
pub(crate) const MEDIAN_CHI2: f64 = 0.454_936;

/// The frames on both sides of a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Around {
    /// Number of the frame before.
    pub before: usize,
    /// Part of the way from it to the next.
    pub part: f64,
    /// Time between the two, s.
    pub span_s: f64,
    /// Covariances of the places in both, px².
    pub covariances_px2: [[f64; 3]; 2],
}

/// Why there is no place at a time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoPlace {
    /// Before the first frame, or after the last.
    Outside,
    /// The frame before or the frame after does not show the target.
    Undetected,
    /// The frames before and after are further apart than was allowed.
    Apart,
}

impl Track {
    /// Whether the points are in the order of time, as the other methods need them.
    pub fn is_in_order(&self) -> bool {
        self.points.windows(2).all(|pair| pair[0].time < pair[1].time)
    }

    /// The target's place at a time, linear between the frames on either side, which both must show it and be at most `apart_s` apart. Its covariance is
    /// that of the interpolation, (1−w)² C₁ + w² C₂, and the wander of a Brownian bridge between the frames,
    /// w(1−w)Δt times `wander_px2_per_s` ([`Track::wander_px2_per_s`]).
    ///
    /// # Errors
    /// No frames on either side, one that does not show the target, frames too far apart.
    pub fn at(
        &self,
        time: Epoch,
        apart_s: f64,
        wander_px2_per_s: f64,
    ) -> Result<Interpolated, NoPlace> {
        let Around { before, part: w, span_s, covariances_px2: [first, last] } =
            self.around(time, apart_s)?;
        let offset = |number: usize| self.points[number].place.map(|place| place.offset_px);
        let (Some(from), Some(to)) = (offset(before), offset(before + 1)) else {
            return Err(NoPlace::Undetected);
        };
        let [dx, dy] = [0, 1].map(|i| to[i] - from[i]);
        let wander = wander_px2_per_s * w * (1.0 - w) * span_s;
        let between = |i: usize| (1.0 - w).powi(2) * first[i] + w * w * last[i];
        let place = Place {
            offset_px: DVec2::new(from[0] + w * dx, from[1] + w * dy),
            covariance_px2: [between(0) + wander, between(1) + wander, between(2)],
        };
        Ok(Interpolated { place, drift_px_per_s: DVec2::new(dx / span_s, dy / span_s) })
    }

    /// The frames on both sides of a time, as [`Track::at`] takes them.
    pub(crate) fn around(&self, time: Epoch, apart_s: f64) -> Result<Around, NoPlace> {
        let next = self.points.partition_point(|point| point.time <= time);
        // On the last frame itself the pair before it serves.
        let at_end = self.points.last().is_some_and(|last| last.time == time);
        let next = if at_end { next - 1 } else { next };
        if next == 0 || next == self.points.len() {
            return Err(NoPlace::Outside);
        }
        let (before, after) = (&self.points[next - 1], &self.points[next]);
        let (Some(from), Some(to)) = (before.place, after.place) else {
            return Err(NoPlace::Undetected);
        };
        let span_s = (after.time - before.time).to_seconds();
        if span_s > apart_s {
            return Err(NoPlace::Apart);
        }
        let part = (time - before.time).to_seconds() / span_s;
        let covariances_px2 = [from.covariance_px2, to.covariance_px2];
        Ok(Around { before: next - 1, part, span_s, covariances_px2 })
    }

    /// How much the target wanders off its straight way, px²/s per axis, as a random walk: from the distances of detected places from the line between
    /// their neighbours, less what the places' own covariances explain; the median over the frames (scaled to a normal distribution's variance), so that single
    /// wrong detections do not count. 0 with fewer than five such frames, or where nothing is left.
    pub fn wander_px2_per_s(&self) -> f64 {
        wander_px2_per_s([self])
    }
}

/// Wander of targets off their straight ways, px²/s per axis, as [`Track::wander_px2_per_s`] has it, from the tracks of all of them together: a visit of
/// a few frames does not tell for itself.
pub fn wander_px2_per_s<'a>(tracks: impl IntoIterator<Item = &'a Track>) -> f64 {
    let mut found = Vec::new();
    for track in tracks {
        for three in track.points.windows(3) {
            let [Some(a), Some(b), Some(c)] = [three[0].place, three[1].place, three[2].place]
            else {
                continue;
            };
            let span_s = (three[2].time - three[0].time).to_seconds();
            let w = (three[1].time - three[0].time).to_seconds() / span_s;
            for i in 0..2 {
                let line = (1.0 - w) * a.offset_px[i] + w * c.offset_px[i];
                let noise = b.covariance_px2[i]
                    + (1.0 - w).powi(2) * a.covariance_px2[i]
                    + w * w * c.covariance_px2[i];
                let bridge_s = w * (1.0 - w) * span_s;
                found.push(((b.offset_px[i] - line).powi(2), noise, bridge_s));
            }
        }
    }
    if found.len() < 10 {
        return 0.0;
    }
    // The wander w at which the median of d²/(noise + w·bridge) is that of χ² with one degree: it falls as w grows.
    let median = |wander: f64| {
        let ratio =
            |(d2, noise, bridge): &(f64, f64, f64)| d2 / (noise + wander * bridge).max(1e-300);
        order::median(found.iter().map(ratio)).unwrap_or(0.0)
    };
    if median(0.0) <= MEDIAN_CHI2 {
        return 0.0;
    }
    let (mut low, mut high) = (0.0, 1e-6);
    while median(high) > MEDIAN_CHI2 && high < 1e12 {
        high *= 4.0;
    }
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if median(middle) > MEDIAN_CHI2 { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}
