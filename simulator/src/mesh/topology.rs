//! Which triangles hang together, and whether what hangs together is closed.

use super::Mesh;
use super::weld::{join, root, weld};
use glam::DVec3;
use std::collections::{BTreeMap, HashMap};

/// With more open edges than this, edges that end within another's length are not looked for: it is a soup, not a joint.
const MOST_JOINTS: usize = 50_000;
/// Nor where they cut each other into more pieces than this: edges that lie along one line cut each other into their number's square.
const MOST_PIECES: usize = 2_000_000;

/// An edge between welded corners `low` < `high`, as one triangle has it.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct HalfEdge {
    low: u32,
    high: u32,
    triangle: u32,
    /// +1 where the triangle runs from `low` to `high`.
    sign: i32,
}

/// Rest of a component's outline on an edge: how often it runs from `low` to `high`, less how often back.
struct Rest {
    low: u32,
    high: u32,
    component: u32,
    net: i32,
}

#[derive(Default)]
pub(super) struct Topology {
    /// For each triangle its component; `None` where welding takes its area.
    pub component_of: Vec<Option<u32>>,
    /// For each component, whether it has no outline.
    pub closed: Vec<bool>,
    /// Edges of one triangle alone that no other edge covers: triangle and middle of the edge.
    pub open: Vec<(u32, DVec3)>,
    /// Edges of one triangle that meet others only within their length (T-junctions).
    pub joints: Vec<(u32, DVec3)>,
    /// Edges of three triangles and more.
    pub crowded: Vec<(u32, DVec3)>,
    /// Edges that two triangles run through in the same sense.
    pub against: Vec<(u32, DVec3)>,
    /// Triangles on the same corners and the same side as an earlier one: the triangle, and the earlier.
    pub duplicates: Vec<(u32, u32)>,
    /// How many corners are another one within the tolerance without being equal to it up to rounding.
    pub near: usize,
}

impl Topology {
    /// Finds the topology of a mesh whose indices are good and whose coordinates are finite.
    pub fn of(mesh: &Mesh, tolerance: f64) -> Self {
        let mut this = Self::default();
        let to = weld(&mesh.vertices, tolerance);
        // What rounding alone moves is the same corner.
        let rounding = 1e-5 * tolerance;
        let moved = |i: usize| mesh.vertices[i].distance(mesh.vertices[to[i] as usize]) > rounding;
        this.near = (0..to.len()).filter(|&i| moved(i)).count();
        let welded: Vec<[u32; 3]> =
            mesh.triangles.iter().map(|t| t.map(|i| to[i as usize])).collect();
        let good = |[a, b, c]: [u32; 3]| a != b && b != c && c != a;
        this.find_duplicates(&welded, good);

        let mut edges = Vec::with_capacity(3 * welded.len());
        for (t, &corners) in welded.iter().enumerate().filter(|(_, c)| good(**c)) {
            for k in 0..3 {
                let (a, b) = (corners[k], corners[(k + 1) % 3]);
                let sign = if a < b { 1 } else { -1 };
                edges.push(HalfEdge { low: a.min(b), high: a.max(b), triangle: t as u32, sign });
            }
        }
        edges.sort_unstable();
        let runs = || edges.chunk_by(|a, b| (a.low, a.high) == (b.low, b.high));

        let mut set: Vec<u32> = (0..welded.len() as u32).collect();
        for run in runs() {
            if let [a, b] = run {
                join(&mut set, a.triangle, b.triangle);
            }
        }
        let mut rests = Vec::new();
        let mut alone = Vec::new();
        for run in runs() {
            let first = run[0];
            let middle =
                0.5 * (mesh.vertices[first.low as usize] + mesh.vertices[first.high as usize]);
            let at = (first.triangle, middle);
            match run {
                [_] => alone.push((rests.len(), at)),
                [a, b] if a.sign == b.sign => this.against.push(at),
                [_, _] => continue,
                _ => this.crowded.push(at),
            }
            let mut nets: BTreeMap<u32, i32> = BTreeMap::new();
            for edge in run {
                *nets.entry(root(&mut set, edge.triangle)).or_default() += edge.sign;
            }
            let rest = nets.into_iter().filter(|(_, net)| *net != 0);
            rests.extend(rest.map(|(component, net)| Rest {
                low: first.low,
                high: first.high,
                component,
                net,
            }));
        }
        let (outline, covered) = close_joints(&mesh.vertices, &rests, &mut set, tolerance);
        for (rest, at) in alone {
            if covered[rest] { this.joints.push(at) } else { this.open.push(at) }
        }

        // Components in the order of their first triangles.
        let mut numbers: HashMap<u32, u32> = HashMap::new();
        for (t, &corners) in welded.iter().enumerate() {
            this.component_of.push(good(corners).then(|| {
                let next = numbers.len() as u32;
                *numbers.entry(root(&mut set, t as u32)).or_insert(next)
            }));
        }
        this.closed = vec![true; numbers.len()];
        for component in outline {
            if let Some(&number) = numbers.get(&root(&mut set, component)) {
                this.closed[number as usize] = false;
            }
        }
        this
    }

    fn find_duplicates(&mut self, welded: &[[u32; 3]], good: impl Fn([u32; 3]) -> bool) {
        // The same side: the same cyclic order.
        let turned = |[a, b, c]: [u32; 3]| match a.min(b).min(c) {
            least if least == a => [a, b, c],
            least if least == b => [b, c, a],
            _ => [c, a, b],
        };
        let mut all: Vec<([u32; 3], u32)> = (0_u32..)
            .zip(welded)
            .filter(|(_, c)| good(**c))
            .map(|(t, &c)| (turned(c), t))
            .collect();
        all.sort_unstable();
        for run in all.chunk_by(|a, b| a.0 == b.0) {
            self.duplicates.extend(run[1..].iter().map(|later| (later.1, run[0].1)));
        }
        self.duplicates.sort_unstable();
    }
}

/// Cuts the outlines of the components at each other's corners, joins the components whose pieces then meet, and adds the pieces up:
/// the components that keep an outline, and for each rest whether others cover all of it.
fn close_joints(
    vertices: &[DVec3],
    rests: &[Rest],
    set: &mut [u32],
    tolerance: f64,
) -> (Vec<u32>, Vec<bool>) {
    let on = Corners::of(vertices, rests);
    let cut = |joints: bool| {
        let mut pieces: Vec<(u32, u32, i32, usize)> = Vec::with_capacity(rests.len());
        for (index, rest) in rests.iter().enumerate() {
            let mut chain = vec![rest.low];
            if joints {
                chain.extend(on.within(vertices, rest, tolerance));
            }
            chain.push(rest.high);
            if joints && pieces.len() + chain.len() > MOST_PIECES {
                return None;
            }
            for pair in chain.windows(2) {
                let (low, high) = (pair[0].min(pair[1]), pair[0].max(pair[1]));
                let net = if pair[0] < pair[1] { rest.net } else { -rest.net };
                pieces.push((low, high, net, index));
            }
        }
        Some(pieces)
    };
    let joints = rests.len() <= MOST_JOINTS;
    let mut pieces = cut(joints).or_else(|| cut(false)).unwrap_or_default();
    pieces.sort_unstable();
    let runs = || pieces.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1));
    for run in runs() {
        for pair in run.windows(2) {
            join(set, rests[pair[0].3].component, rests[pair[1].3].component);
        }
    }
    let mut covered = vec![true; rests.len()];
    let mut outline = Vec::new();
    for run in runs() {
        // Whatever met on this piece is one component by now.
        if run.iter().map(|piece| piece.2).sum::<i32>() != 0 {
            outline.push(rests[run[0].3].component);
            run.iter().for_each(|piece| covered[piece.3] = false);
        }
    }
    (outline, covered)
}

/// The corners of outlines, sorted along each axis.
struct Corners {
    sorted: [Vec<(f64, u32)>; 3],
}

impl Corners {
    fn of(vertices: &[DVec3], rests: &[Rest]) -> Self {
        let mut corners: Vec<u32> = rests.iter().flat_map(|r| [r.low, r.high]).collect();
        corners.sort_unstable();
        corners.dedup();
        let along = |axis: usize| {
            let mut sorted: Vec<(f64, u32)> =
                corners.iter().map(|&i| (vertices[i as usize][axis], i)).collect();
            sorted.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            sorted
        };
        Self { sorted: [along(0), along(1), along(2)] }
    }

    /// The corners within an edge's length, in order from its low end.
    fn within(&self, vertices: &[DVec3], edge: &Rest, tolerance: f64) -> Vec<u32> {
        let (a, b) = (vertices[edge.low as usize], vertices[edge.high as usize]);
        let range = |axis: usize| {
            let sorted = &self.sorted[axis];
            let (low, high) = (a[axis].min(b[axis]), a[axis].max(b[axis]));
            let from = sorted.partition_point(|c| c.0 < low - tolerance);
            let to = sorted.partition_point(|c| c.0 <= high + tolerance);
            &sorted[from..to]
        };
        let [x, y, z] = [0, 1, 2].map(range);
        let few = if x.len() <= y.len().min(z.len()) {
            x
        } else if y.len() <= z.len() {
            y
        } else {
            z
        };
        let length = a.distance(b);
        let along = (b - a) / length;
        let mut found: Vec<(f64, u32)> = few
            .iter()
            .map(|&(_, i)| {
                let from = vertices[i as usize] - a;
                let at = from.dot(along);
                (at, (from - at * along).length(), i)
            })
            .filter(|&(at, off, i)| {
                ![edge.low, edge.high].contains(&i)
                    && off <= tolerance
                    && at > tolerance
                    && at < length - tolerance
            })
            .map(|(at, _, i)| (at, i))
            .collect();
        found.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        found.into_iter().map(|(_, i)| i).collect()
    }
}
