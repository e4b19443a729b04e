//! Where the telescope looked, and when.

use crate::track::Track;
use glam::DVec2;
use hifitime::{Duration, Epoch};

/// View of the telescope: a target, the sky or nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum View {
    /// A target, by the number of its visit.
    Target(usize),
    /// Sky beside it, without a target.
    Sky,
    /// Nothing: a closed shutter.
    Dark,
}

/// A stretch of time with one view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Span {
    /// Start of the span.
    pub from: Epoch,
    /// End of the span, which is not in it.
    pub to: Epoch,
    /// View of the telescope in the span.
    pub view: View,
}

/// How a bin lies in the spans.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Seen {
    /// Wholly within a span.
    Whole(View, usize),
    /// Partly within this target's visit, partly off it.
    Partly(usize),
    /// In no span, or partly in the sky's or the dark's.
    Nothing,
}

/// Spans of a night: visits, and off-target spans, which win where both are.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Spans {
    visits: Vec<Span>,
    off: Vec<Span>,
}

impl Spans {
    /// Spans in any order; empty ones are left out. Where two of a kind overlap, the earlier ends as the later begins.
    pub fn new(spans: impl IntoIterator<Item = Span>) -> Self {
        let (mut visits, mut off) = (Vec::new(), Vec::new());
        for span in spans {
            let list = if matches!(span.view, View::Target(_)) { &mut visits } else { &mut off };
            list.push(span);
        }
        for list in [&mut visits, &mut off] {
            list.sort_by_key(|span| span.from);
            for i in 1..list.len() {
                list[i - 1].to = list[i - 1].to.min(list[i].from);
            }
            list.retain(|span| span.from < span.to);
        }
        Self { visits, off }
    }

    /// The spans, visits first.
    pub fn iter(&self) -> impl Iterator<Item = &Span> {
        self.visits.iter().chain(&self.off)
    }

    /// How a bin lies in them.
    pub fn seen(&self, from: Epoch, to: Epoch) -> Seen {
        // The first span that ends after the start.
        let touched = |list: &[Span]| {
            let i = list.partition_point(|span| span.to <= from);
            list.get(i).filter(|span| span.from < to).map(|span| (i, *span))
        };
        let whole = |span: Span| span.from <= from && to <= span.to;
        match (touched(&self.visits), touched(&self.off)) {
            (_, Some((i, off))) if whole(off) => Seen::Whole(off.view, i),
            (Some((i, visit)), None) if whole(visit) => Seen::Whole(visit.view, i),
            (Some((_, Span { view: View::Target(visit), .. })), _) => Seen::Partly(visit),
            _ => Seen::Nothing,
        }
    }

    /// The visit that a time lies in, whether or not an off-target span does too.
    pub fn visit_at(&self, time: Epoch) -> Option<usize> {
        let span = self.visits.get(self.visits.partition_point(|span| span.to <= time))?;
        match span.view {
            View::Target(visit) if span.from <= time => Some(visit),
            _ => None,
        }
    }
}

/// Conditions under which a stretch of frames is off the target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Away {
    /// The target is away where it stands further than this from the place that counts, px: far enough that no light of it is coupled.
    pub distance_px: f64,
    /// That place, from the frame's centre, px: the fibre's.
    pub from_px: DVec2,
    /// Whether frames that do not show the target count as away. A target that is only faint, or behind a cloud, then spoils the background.
    pub undetected: bool,
    /// The shortest stretch, s, between the middles of its first and last frames.
    pub least_s: f64,
}

/// Off-target spans from the frames of a visit: between the first and the last of successive frames in which the target was away, so
/// that half a frame's time on either side is left out.
pub fn away(track: &Track, away: &Away) -> Vec<Span> {
    let off = |i: &usize| match track.points[*i].place {
        None => away.undetected,
        Some(place) => {
            let [x, y] = [0, 1].map(|i| place.offset_px[i] - away.from_px[i]);
            x.hypot(y) > away.distance_px
        }
    };
    let numbers: Vec<usize> = (0..track.points.len()).collect();
    let stretches = numbers.chunk_by(|a, b| off(a) == off(b)).filter(|stretch| off(&stretch[0]));
    let spans = stretches.filter_map(|stretch| {
        let (from, to) = (track.points[stretch[0]].time, track.points[*stretch.last()?].time);
        let long = to > from && to - from >= Duration::from_seconds(away.least_s);
        long.then_some(Span { from, to, view: View::Sky })
    });
    spans.collect()
}
