//! Maps of range against closed forms.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use sunglint_analysis::map::Grid;
use sunglint_inference::range::range_map;
use sunglint_simulator::light::Faceted;
use sunglint_simulator::target::Target;

/// Truth: closed forms. A unit cube about its origin is seen at a depth of −½/(Σ|n_i|)·Σ n_i² … : each face of direction n shows |n_i| of area with its middle ½|n_i| towards the observer: the mean
/// over areas is −½ Σ n_i²/Σ|n_i| = −½/Σ|n_i|, that over Lambert light (weights n_i²) −½ Σ|n_i|³. Tolerance: rounding.
#[test]
fn ranges_of_a_cube_are_those_of_its_faces() {
    let text = "name = \"cube\"\n[[part]]\nname = \"a\"\nshape = \"box\"\nsize_m = [1, 1, 1]\nmaterial = \"grey80\"\n";
    let body = Faceted::new(&Target::parse("cube.toml", text).unwrap()).unwrap();
    let grid = Grid::new(15.0).unwrap();
    let map = range_map(&body, grid, &[0.8]).unwrap();
    for (cell, found) in map.surface_m.indexed_iter() {
        let n = grid.direction(cell).abs();
        let sum = n.x + n.y + n.z;
        assert!((found + 0.5 / sum).abs() < 1e-12, "{found}");
        let cubes = n.x.powi(3) + n.y.powi(3) + n.z.powi(3);
        assert!((map.light_m[cell] + 0.5 * cubes).abs() < 1e-12);
    }
}
