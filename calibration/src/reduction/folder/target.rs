//! The target among the sources of the frames: chosen by its motion, never by its brightness.

use crate::photometry::field::Field;
use hifitime::Epoch;
use std::collections::BTreeMap;
use sunglint_formats::image_frame::FrameHeader;
use sunglint_numerics::order::median;

/// A frame with its sources.
pub(super) struct Seen<'a> {
    pub(super) time: Epoch,
    pub(super) header: &'a FrameHeader,
    pub(super) field: Field,
    /// Number of its dark and flat.
    pub(super) masters: usize,
}

/// A source that may be the target.
#[derive(Debug, Clone, Copy)]
pub(super) enum Which {
    Streak(usize),
    Point(usize),
}

/// The target in each frame, and why.
pub(super) struct Chosen {
    pub(super) of: Vec<Option<Which>>,
    pub(super) by: String,
    pub(super) motion: Option<[f64; 2]>,
}

impl Seen<'_> {
    pub(super) fn place(&self, which: Which) -> [f64; 2] {
        match which {
            Which::Point(i) => self.field.points[i].place_px.to_array(),
            Which::Streak(i) => {
                let [a, b] = self.field.streaks[i].ends_px;
                [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])]
            }
        }
    }

    pub(super) fn streaks(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.field.streaks.len()).filter(|&i| !self.field.streaks[i].is_star_trail)
    }
}

/// Frames are this near to a straight even motion, px.
const REACH_PX: f64 = 4.0;
/// The same of a target that the telescope follows: it is moved by what the following misses.
const FOLLOWED_REACH_PX: f64 = 15.0;
/// A target is this near to the place that was given for it, px.
pub(super) const PLACE_PX: f64 = 25.0;
/// Sources of a frame that are tried as the target at most.
const MOST_CANDIDATES: usize = 400;

/// Chooses the target in all frames.
pub(super) fn choose(fields: &[Seen<'_>], place: Option<[f64; 2]>) -> Chosen {
    let trailed = fields.iter().filter(|f| f.field.star_trails.is_some()).count();
    let streaks = fields.iter().filter(|f| f.streaks().next().is_some()).count();
    let n = fields.len();
    let (kind, candidates): (&str, Vec<Vec<Which>>) = if 2 * trailed > n {
        let of = |f: &Seen<'_>| {
            let points = (0..f.field.points.len()).filter(|&i| !f.field.points[i].is_cut);
            f.streaks()
                .map(Which::Streak)
                .chain(points.map(Which::Point))
                .take(MOST_CANDIDATES)
                .collect()
        };
        ("among trailed stars", fields.iter().map(of).collect())
    } else if 2 * streaks > n || streaks > 0 && n < 3 {
        (
            "a streak among point-like stars",
            fields.iter().map(|f| f.streaks().map(Which::Streak).collect()).collect(),
        )
    } else {
        ("a point that moves against the stars", moving(fields))
    };
    let is_trailed = 2 * trailed > n;
    let reach_px = if is_trailed { FOLLOWED_REACH_PX } else { REACH_PX };
    // Trails that merge have another length and stay with the stars: a point that is there counts more.
    if is_trailed && n >= 3 {
        let points: Vec<Vec<Which>> = candidates
            .iter()
            .map(|all| all.iter().copied().filter(|w| matches!(w, Which::Point(_))).collect())
            .collect();
        if let Some((of, motion)) = linked(fields, &points, place, reach_px) {
            let count = of.iter().flatten().count();
            let by = format!("even motion in {count} of {n} frames: a point {kind}");
            return Chosen { of, by, motion: Some(motion) };
        }
    }
    if n >= 3
        && place.is_none()
        && let Some((of, motion)) = linked(fields, &candidates, None, reach_px)
    {
        let count = of.iter().flatten().count();
        let by = format!("even motion in {count} of {n} frames: {kind}");
        return Chosen { of, by, motion: Some(motion) };
    }
    if let Some(place) = place {
        if n >= 3
            && let Some((of, motion)) = linked(fields, &candidates, Some(place), reach_px)
        {
            let by = format!("the place that was given and even motion: {kind}");
            return Chosen { of, by, motion: Some(motion) };
        }
        let near = |f: &Seen<'_>, sources: &[Which], most_px: f64| {
            let away = |w: &Which| {
                let at = f.place(*w);
                (at[0] - place[0]).hypot(at[1] - place[1])
            };
            let nearest = sources.iter().copied().min_by(|a, b| away(a).total_cmp(&away(b)));
            nearest.filter(|w| away(w) <= most_px)
        };
        let everything = |f: &Seen<'_>| -> Vec<Which> {
            let points = (0..f.field.points.len()).map(Which::Point);
            f.streaks().map(Which::Streak).chain(points).collect()
        };
        let moves = fields.first().zip(candidates.first());
        let moves = moves.is_some_and(|(f, c)| near(f, c, PLACE_PX).is_some());
        let standing: Vec<Option<Which>> =
            fields.iter().map(|f| near(f, &everything(f), PLACE_PX)).collect();
        let stands = 2 * standing.iter().flatten().count() >= n;
        return if stands && (n >= 3 || !moves) {
            let by = "the place that was given: a source that stays there".to_owned();
            Chosen { of: standing, by, motion: None }
        } else if moves {
            let each = |(f, c): (&Seen<'_>, &Vec<Which>)| near(f, c, f64::INFINITY);
            let of = fields.iter().zip(&candidates).map(each).collect();
            Chosen { of, by: format!("nearest to the place that was given: {kind}"), motion: None }
        } else {
            let by = "the place that was given".to_owned();
            Chosen { of: vec![None; n], by, motion: None }
        };
    }
    // One or two frames: the longest streak, or the point nearest to the middle where the stars are trailed.
    let single = |(f, c): (&Seen<'_>, &Vec<Which>)| {
        let middle = f.field.size_px.map(|n| 0.5 * n as f64);
        let rank = |w: &Which| match w {
            Which::Streak(i) => -1e6 - f.field.streaks[*i].length_px,
            Which::Point(_) => {
                let at = f.place(*w);
                (at[0] - middle[0]).hypot(at[1] - middle[1])
            }
        };
        c.iter().copied().min_by(|a, b| rank(a).total_cmp(&rank(b)))
    };
    let of: Vec<Option<Which>> = match kind {
        "a point that moves against the stars" => vec![None; n],
        _ => fields.iter().zip(&candidates).map(single).collect(),
    };
    let by = match of.iter().flatten().count() {
        0 => format!("no target found ({kind} was looked for)"),
        _ => format!(
            "the longest streak, or the point nearest to the middle, frame by frame ({kind}; no even motion links the frames)"
        ),
    };
    Chosen { of, by, motion: None }
}

/// Points that do not stay with the stars, frame by frame.
pub(super) fn moving(fields: &[Seen<'_>]) -> Vec<Vec<Which>> {
    let mut shift = [0.0; 2];
    let mut shifts = Vec::new();
    for (i, seen) in fields.iter().enumerate() {
        if i > 0 {
            let step = shift_between(&fields[i - 1].field, &seen.field);
            shift = [shift[0] + step[0], shift[1] + step[1]];
        }
        shifts.push(shift);
    }
    // A grid of places on the sky, with the number of frames that have a point there.
    const CELL: f64 = 3.0;
    let cell = |p: [f64; 2], s: [f64; 2]| [0, 1].map(|k| ((p[k] - s[k]) / CELL).floor() as i64);
    let mut seen_at: BTreeMap<[i64; 2], Vec<usize>> = BTreeMap::new();
    for (i, (seen, shift)) in fields.iter().zip(&shifts).enumerate() {
        for point in &seen.field.points {
            let at = seen_at.entry(cell(point.place_px.to_array(), *shift)).or_default();
            if at.last() != Some(&i) {
                at.push(i);
            }
        }
    }
    let stays = |p: [f64; 2], s: [f64; 2]| {
        let [x, y] = cell(p, s);
        let mut frames: Vec<usize> = Vec::new();
        for dx in -1..=1 {
            for dy in -1..=1 {
                frames.extend(seen_at.get(&[x + dx, y + dy]).into_iter().flatten());
            }
        }
        frames.sort_unstable();
        frames.dedup();
        2 * frames.len() >= fields.len().max(3)
    };
    let of = |(seen, shift): (&Seen<'_>, &[f64; 2])| {
        let points = seen.field.points.iter().enumerate();
        let free = points.filter(|(_, p)| !p.is_cut && !stays(p.place_px.to_array(), *shift));
        let streaks = seen.streaks().map(Which::Streak);
        streaks.chain(free.map(|(i, _)| Which::Point(i))).take(MOST_CANDIDATES).collect()
    };
    fields.iter().zip(&shifts).map(of).collect()
}

/// Displacement of the stars from one frame to the next, px: the most frequent difference of places of the brightest points.
pub(super) fn shift_between(a: &Field, b: &Field) -> [f64; 2] {
    const BRIGHT: usize = 60;
    const CELL: f64 = 4.0;
    let mut votes: BTreeMap<[i64; 2], Vec<[f64; 2]>> = BTreeMap::new();
    for p in a.points.iter().take(BRIGHT) {
        for q in b.points.iter().take(BRIGHT) {
            let d = [0, 1].map(|k| q.place_px[k] - p.place_px[k]);
            let [x, y] = d.map(|v| (v / CELL).round() as i64);
            for dx in -1..=1 {
                for dy in -1..=1 {
                    votes.entry([x + dx, y + dy]).or_default().push(d);
                }
            }
        }
    }
    // Of equal numbers the smallest displacement.
    let best = votes
        .iter()
        .max_by_key(|(cell, all)| (all.len(), -(cell[0] * cell[0] + cell[1] * cell[1])));
    match best {
        Some((_, all)) if all.len() >= 3 => {
            [0, 1].map(|k| median(all.iter().map(|d| d[k])).unwrap_or(0.0))
        }
        _ => [0.0; 2],
    }
}

/// Candidates that move evenly, if at least three frames and half of all have one: the motion that links most.
pub(super) fn linked(
    fields: &[Seen<'_>],
    candidates: &[Vec<Which>],
    place: Option<[f64; 2]>,
    reach_px: f64,
) -> Option<(Vec<Option<Which>>, [f64; 2])> {
    let n = fields.len();
    let first = fields.first()?.time;
    let time = |i: usize| (fields[i].time - first).to_seconds();
    let mut best: Option<(usize, f64, [f64; 2], [f64; 2])> = None;
    let mut tried = 0_u64;
    // Pairs of frames that are not far apart in number, so that one is in both.
    for i in 0..n {
        for j in [i + 1, i + 2, i + n / 2] {
            if j >= n || j == i || time(j) <= time(i) {
                continue;
            }
            for a in &candidates[i] {
                for b in &candidates[j] {
                    tried += 1;
                    if tried > 400_000 {
                        break;
                    }
                    let (p, q) = (fields[i].place(*a), fields[j].place(*b));
                    let motion = [0, 1].map(|k| (q[k] - p[k]) / (time(j) - time(i)));
                    let start = [0, 1].map(|k| p[k] - motion[k] * time(i));
                    if let Some(place) = place
                        && (start[0] - place[0]).hypot(start[1] - place[1]) > PLACE_PX
                    {
                        continue;
                    }
                    let (mut count, mut miss) = (0, 0.0);
                    for (k, seen) in fields.iter().enumerate() {
                        if let Some(d) =
                            nearest(seen, &candidates[k], start, motion, time(k)).map(|(_, d)| d)
                            && d < reach_px
                        {
                            count += 1;
                            miss += d;
                        }
                    }
                    let better =
                        best.is_none_or(|(c, m, _, _)| count > c || count == c && miss < m);
                    if better {
                        best = Some((count, miss, start, motion));
                    }
                }
            }
        }
    }
    let (count, _, start, motion) = best?;
    // Frames in which it should be seen at all.
    let inside = (0..n)
        .filter(|&k| {
            let [x, y] = [0, 1].map(|i| start[i] + motion[i] * time(k));
            let [w, h] = fields[k].field.size_px;
            x > 0.0 && y > 0.0 && x < w as f64 && y < h as f64
        })
        .count();
    if count < 3 || 2 * count < inside {
        return None;
    }
    let of = (0..n).map(|k| {
        let (which, d) = nearest(&fields[k], &candidates[k], start, motion, time(k))?;
        (d < reach_px).then_some(which)
    });
    Some((of.collect(), motion))
}

pub(super) fn nearest(
    seen: &Seen<'_>,
    candidates: &[Which],
    start: [f64; 2],
    motion: [f64; 2],
    time: f64,
) -> Option<(Which, f64)> {
    let at = [0, 1].map(|k| start[k] + motion[k] * time);
    let away = |w: &Which| {
        let p = seen.place(*w);
        (p[0] - at[0]).hypot(p[1] - at[1])
    };
    candidates.iter().map(|w| (*w, away(w))).min_by(|a, b| a.1.total_cmp(&b.1))
}

/// Speed of the streaks whose both ends are inside, px/s: the middle of length over exposure.
pub(super) fn speed_px_per_s(fields: &[Seen<'_>], of: &[Option<Which>]) -> Option<f64> {
    median(fields.iter().zip(of).filter_map(|(seen, which)| {
        let Some(Which::Streak(i)) = which else { return None };
        let streak = &seen.field.streaks[*i];
        let exposure = seen.header.exposure_s.filter(|s| *s > 0.0)?;
        (!streak.is_cut && !streak.is_end_hidden).then(|| streak.length_px / exposure)
    }))
}
