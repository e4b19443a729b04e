//! The parts of shadows' edges that bound what is open of a facet: within its outline and in no other shadow.

use crate::light::clip::{self, P2, Polygons};

/// Lines nearer than this to one another, of the numbers that they were made of, are one line.
const COINCIDENT: f64 = 1e-13;

/// Rule for edges along the border of a convex polygon: which of them count as within it.
#[derive(Clone, Copy)]
struct Border {
    /// Whether one that runs the same way does.
    same: bool,
    /// Whether one that runs the other way does.
    opposite: bool,
}

/// Room for the work of [`exposed`].
#[derive(Debug, Default)]
pub(super) struct Room {
    bounds: Vec<[f64; 4]>,
    open: Vec<(f64, f64)>,
    next: Vec<(f64, f64)>,
}

/// Calls `take` with the shadow's number, the edge's number (from corner to the next) and where on it, from 0 to 1, for each part that is
/// exposed. Where edges of two shadows coincide and run the same way the first shadow's counts; where they run opposite ways, nothing is
/// open between, and none does.
pub(super) fn exposed(
    outline: &[P2],
    shadows: &Polygons,
    room: &mut Room,
    take: &mut dyn FnMut(usize, usize, (f64, f64)),
) {
    room.bounds.clear();
    room.bounds.extend(shadows.iter().map(clip::bounds));
    let size = |b: &[f64; 4]| b.iter().fold(0.0_f64, |a, x| a.max(x.abs()));
    let facet = size(&clip::bounds(outline));
    for (j, shadow) in shadows.iter().enumerate() {
        let reach = facet + size(&room.bounds[j]);
        for e in 0..shadow.len() {
            let edge = (shadow[e], shadow[(e + 1) % shadow.len()]);
            let flush = Border { same: true, opposite: false };
            let Some(within) = within(outline, edge, COINCIDENT * reach, flush) else { continue };
            room.open.clear();
            room.open.push(within);
            for (k, other) in shadows.iter().enumerate() {
                if k == j || !clip::overlap(&closed(&room.bounds[k]), &closed(&of_edge(edge))) {
                    continue;
                }
                let near = COINCIDENT * (reach + size(&room.bounds[k]));
                let hidden = Border { same: k < j, opposite: true };
                if let Some(hole) = self::within(other, edge, near, hidden) {
                    subtract(hole, &mut room.open, &mut room.next);
                    if room.open.is_empty() {
                        break;
                    }
                }
            }
            room.open.iter().for_each(|part| take(j, e, *part));
        }
    }
}

/// A box that shares more than an edge with whatever touches it.
fn closed(b: &[f64; 4]) -> [f64; 4] {
    let pad = 1e-9 * (b[2] - b[0] + b[3] - b[1]) + f64::MIN_POSITIVE;
    [b[0] - pad, b[1] - pad, b[2] + pad, b[3] + pad]
}

fn of_edge((p, q): (P2, P2)) -> [f64; 4] {
    [p[0].min(q[0]), p[1].min(q[1]), p[0].max(q[0]), p[1].max(q[1])]
}

/// The part of an edge, from 0 to 1, within a convex counter-clockwise polygon.
fn within(polygon: &[P2], (p, q): (P2, P2), near: f64, border: Border) -> Option<(f64, f64)> {
    let (mut from, mut to) = (0.0_f64, 1.0_f64);
    for k in 0..polygon.len() {
        let (a, b) = (polygon[k], polygon[(k + 1) % polygon.len()]);
        let (x, y) = (b[0] - a[0], b[1] - a[1]);
        let length = x.hypot(y);
        if length <= near {
            continue;
        }
        let inside = |c: P2| (x * (c[1] - a[1]) - y * (c[0] - a[0])) / length;
        let (at_p, at_q) = (inside(p), inside(q));
        if at_p.abs() <= near && at_q.abs() <= near {
            let same = (q[0] - p[0]) * x + (q[1] - p[1]) * y > 0.0;
            if if same { border.same } else { border.opposite } {
                continue;
            }
            return None;
        }
        if at_p <= 0.0 && at_q <= 0.0 {
            return None;
        }
        if at_p < 0.0 {
            from = from.max(at_p / (at_p - at_q));
        } else if at_q < 0.0 {
            to = to.min(at_p / (at_p - at_q));
        }
    }
    (from < to).then_some((from, to))
}

/// Takes one interval from others.
fn subtract(hole: (f64, f64), open: &mut Vec<(f64, f64)>, next: &mut Vec<(f64, f64)>) {
    next.clear();
    for &(from, to) in open.iter() {
        for part in [(from, to.min(hole.0)), (from.max(hole.1), to)] {
            if part.0 < part.1 {
                next.push(part);
            }
        }
    }
    std::mem::swap(open, next);
}
