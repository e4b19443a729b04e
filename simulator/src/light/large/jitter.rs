//! Where in its cell a point lies.

/// Cells along each side of a tile.
const TILE: usize = 16;
/// Tiles along each side of the table.
const TILES: usize = 8;
const SIDE: usize = TILE * TILES;

/// Places in cells: multi-jittered (Chiu, Shirley and Wang 1994), so that in each tile no two points share a column or a row of its 256.
#[derive(Debug, Clone)]
pub(super) struct Jitter(Vec<[f32; 2]>);

impl Jitter {
    pub(super) fn new() -> Self {
        let mut state = 0x5eed_u64;
        let mut places = vec![[0.0; 2]; SIDE * SIDE];
        for tile in 0..TILES * TILES {
            let (left, low) = (TILE * (tile % TILES), TILE * (tile / TILES));
            let shuffled = |state: &mut u64| -> Vec<[usize; TILE]> {
                (0..TILE).map(|_| permutation(state)).collect()
            };
            // In column i the rows' places across are a permutation, and the other way round.
            let (across, along) = (shuffled(&mut state), shuffled(&mut state));
            for j in 0..TILE {
                for i in 0..TILE {
                    let place =
                        |k: usize, state: &mut u64| (k as f64 + unit(state)) as f32 / TILE as f32;
                    places[(low + j) * SIDE + left + i] =
                        [place(across[i][j], &mut state), place(along[j][i], &mut state)];
                }
            }
        }
        Self(places)
    }

    /// The place of a cell's point, in cells from the cell's corner.
    pub(super) fn at(&self, column: usize, row: usize) -> [f64; 2] {
        self.0[(row % SIDE) * SIDE + column % SIDE].map(f64::from)
    }
}

/// SplitMix64 (Steele, Lea and Flood 2014).
fn next(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Below 1 also as f32.
fn unit(state: &mut u64) -> f64 {
    (next(state) >> 44) as f64 / (1_u64 << 20) as f64
}

fn permutation(state: &mut u64) -> [usize; TILE] {
    let mut order: [usize; TILE] = std::array::from_fn(|k| k);
    for k in (1..TILE).rev() {
        order.swap(k, (next(state) % (k as u64 + 1)) as usize);
    }
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: what multi-jittered means. Of each tile's points every column and every row of a 256th of its width holds one.
    #[test]
    fn each_strip_of_a_tile_holds_one_point() {
        let jitter = Jitter::new();
        for tile in 0..TILES * TILES {
            let mut strips = [[0; TILE * TILE]; 2];
            for k in 0..TILE * TILE {
                let cell = [TILE * (tile % TILES) + k % TILE, TILE * (tile / TILES) + k / TILE];
                let place = jitter.at(cell[0], cell[1]);
                for axis in 0..2 {
                    assert!((0.0..1.0).contains(&place[axis]));
                    let along = (cell[axis] % TILE) as f64 + place[axis];
                    strips[axis][(along * TILE as f64) as usize] += 1;
                }
            }
            assert!(strips.iter().flatten().all(|n| *n == 1), "{tile}");
        }
    }
}
