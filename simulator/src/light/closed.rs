//! Which triangles hang together, and whether they enclose a volume.

use glam::DVec3;
use std::collections::HashMap;

/// More unpaired edges than this are not looked at for T-junctions: the triangles count as open, which is never wrong, only slower.
const MOST_UNPAIRED: usize = 4000;

/// Triangles in connected components.
#[derive(Debug)]
pub struct Components {
    /// The component of each triangle.
    pub of: Vec<u32>,
    /// Whether each is closed: along every line its edges run as often there as back.
    pub closed: Vec<bool>,
}

struct Unpaired {
    triangle: u32,
    from: DVec3,
    to: DVec3,
}

/// Joins triangles over their edges. An edge may be met by several shorter ones from the other side (T-junctions).
pub fn components(places: &[DVec3], triangles: &[[u32; 3]], tolerance_m: f64) -> Components {
    let mut joined = Disjoint::new(triangles.len());
    let mut edges: HashMap<(u32, u32), Vec<(u32, bool)>> =
        HashMap::with_capacity(triangles.len() * 3 / 2);
    for (t, corners) in triangles.iter().enumerate() {
        for k in 0..3 {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            if a != b {
                edges.entry((a.min(b), a.max(b))).or_default().push((t as u32, a < b));
            }
        }
    }
    let mut unpaired = Vec::new();
    for (&(a, b), users) in &edges {
        let forward = users.iter().filter(|u| u.1).count();
        if 2 * forward == users.len() {
            users.windows(2).for_each(|pair| joined.join(pair[0].0, pair[1].0));
        } else {
            let (pa, pb) = (places[a as usize], places[b as usize]);
            unpaired.extend(users.iter().map(|&(triangle, forward)| {
                let (from, to) = if forward { (pa, pb) } else { (pb, pa) };
                Unpaired { triangle, from, to }
            }));
        }
    }
    let open = open_triangles(unpaired, &mut joined, tolerance_m);
    let mut number = HashMap::new();
    let of: Vec<u32> = (0..triangles.len())
        .map(|t| {
            let next = number.len() as u32;
            *number.entry(joined.root(t as u32)).or_insert(next)
        })
        .collect();
    let mut closed = vec![true; number.len()];
    for t in open {
        closed[of[t as usize] as usize] = false;
    }
    Components { of, closed }
}

/// Returns the triangles of edges that neither a single other edge nor a row of others on the same line matches. Joins those that do match.
fn open_triangles(
    mut unpaired: Vec<Unpaired>,
    joined: &mut Disjoint,
    tolerance_m: f64,
) -> Vec<u32> {
    if unpaired.len() > MOST_UNPAIRED {
        return unpaired.iter().map(|e| e.triangle).collect();
    }
    // The longest edge of a line gives its direction best; the triangle's number makes the order one.
    unpaired.sort_by(|a, b| {
        let (la, lb) = (a.from.distance(a.to), b.from.distance(b.to));
        lb.total_cmp(&la).then(a.triangle.cmp(&b.triangle))
    });
    let mut open = Vec::new();
    let mut left = unpaired;
    while let Some(first) = left.first() {
        let (origin, along) = (first.from, (first.to - first.from).normalize_or_zero());
        let off_line = |p: DVec3| (p - origin).cross(along).length() > 4.0 * tolerance_m;
        let (line, rest): (Vec<_>, Vec<_>) =
            left.into_iter().partition(|e| !off_line(e.from) && !off_line(e.to));
        left = rest;
        // Where each begins and ends on the line, and which way it runs.
        let spans: Vec<(f64, f64, i32, u32)> = line
            .iter()
            .map(|e| {
                let (a, b) = ((e.from - origin).dot(along), (e.to - origin).dot(along));
                (a.min(b), a.max(b), if a < b { 1 } else { -1 }, e.triangle)
            })
            .collect();
        let mut stops: Vec<f64> = spans.iter().flat_map(|s| [s.0, s.1]).collect();
        stops.sort_by(f64::total_cmp);
        for stop in stops.windows(2).filter(|s| s[1] - s[0] > tolerance_m) {
            let middle = 0.5 * (stop[0] + stop[1]);
            let here = || spans.iter().filter(|s| s.0 < middle && middle < s.1);
            let mut users = here();
            let Some(first) = users.next() else { continue };
            if here().map(|s| s.2).sum::<i32>() == 0 {
                users.for_each(|s| joined.join(first.3, s.3));
            } else {
                open.extend(here().map(|s| s.3));
            }
        }
    }
    open
}

/// Sets that grow together.
#[derive(Debug)]
pub struct Disjoint(Vec<u32>);

impl Disjoint {
    /// Each on its own.
    pub fn new(count: usize) -> Self {
        Self((0..count as u32).collect())
    }

    /// The member that stands for the set of this one.
    pub fn root(&mut self, mut k: u32) -> u32 {
        while self.0[k as usize] != k {
            self.0[k as usize] = self.0[self.0[k as usize] as usize];
            k = self.0[k as usize];
        }
        k
    }

    /// Makes two sets one; the smaller number stands for it, so that the order of joining does not matter.
    pub fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b) as usize] = a.min(b);
    }
}
