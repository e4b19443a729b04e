//! Patches that exchange light with rough surfaces.

use super::scenes::*;
use super::stored::{Row, rows, target};
use sunglint_radiometry::spectrum::Spectrum;
use sunglint_simulator::light::bounce::{Bounce, BounceOptions};
use sunglint_simulator::light::{Scene, View};
use sunglint_simulator::surface::{Distribution, Fresnel, Lobe, Masking, Material};

/// Number of paths that an epoch of a pass may take.
const MOST_PATHS: u32 = 4096;

fn options(tolerance: f64) -> BounceOptions {
    BounceOptions { tolerance, seed: 4, most_paths: MOST_PATHS, ..BounceOptions::default() }
}

/// Light found and its claimed error, and the row's own.
fn compared(bounce: &Bounce, row: &Row) -> (f64, f64) {
    let (found, error) = grey_light(bounce, row.sun, View::Distant(row.to));
    ((found - row.bounced).abs(), error)
}

/// Truth: Mitsuba 3.9.1's corner of three Lambert walls, with 4 of its standard errors. A wall with a coat that reflects nothing is a Lambert wall, but nothing here
/// knows that: it is a rough surface. With one such wall all light goes by patches and the directions of that wall; with two, light goes from rough wall to
/// rough wall, and from three scatterings on by paths; with three nothing is diffuse. What is claimed covers the difference, and of one wall
/// it is 5e-3 of the signal at most (some paths would claim 3e-2).
#[test]
fn a_coat_that_reflects_nothing_is_a_lambert_wall() {
    let lobe = Lobe::isotropic(Distribution::Beckmann, 0.5, Masking::Separable).unwrap();
    let flat = |value: f64| Spectrum::constant(value, 300.0, 1240.0).unwrap();
    let coat = Fresnel::constant(flat(0.0)).unwrap();
    let coated = Material::blend("coated", flat(0.8), lobe, coat).unwrap();
    for walls in 1..=3 {
        let mut target = target("corner");
        target.materials.push(coated.clone());
        let number = target.materials.len() - 1;
        target.parts.iter_mut().take(walls).for_each(|part| part.material = number);
        let scene = Scene::new(&target).unwrap();
        // At a smaller tolerance paths do all of it where there are two.
        let (tolerance, way) =
            if walls == 1 { (2e-3, "lobes along") } else { (5e-2, "light paths between lobes") };
        let bounce = Bounce::new(&scene, &options(tolerance)).unwrap();
        for row in rows().iter().filter(|r| r.scene == "corner") {
            let all = row.direct + row.bounced;
            let (off, error) = compared(&bounce, row);
            let why = &bounce.need().why;
            eprintln!("{walls}: {:.1e} off, {:.1e} claimed; {why}", off / all, error / all);
            assert!(off <= error + 4.0 * row.sigma, "{walls}: {off} {error}");
            assert!(why.contains(way) && (walls > 1 || error < 5e-3 * all), "{error}");
        }
    }
}

/// Truth: Mitsuba 3.9.1, with 4 of its standard errors and 0.35 % of the bounced light for its fit of the masking. With as many paths as a pass may take, what is
/// claimed covers the difference and is at most a third of what paths would claim (3e-2 of the signal for the satin floor, 7e-2 for the shiny
/// wall, 1e-2 for the box-wing, all of them medians over other directions).
#[test]
fn lobes_go_by_patches_where_these_know_more() {
    for (name, most) in [("satin_floor", 1e-2), ("shiny_wall", 2.3e-2), ("box_wing", 3e-3)] {
        let scene = Scene::new(&target(name)).unwrap();
        let bounce = Bounce::new(&scene, &options(1e-3)).unwrap();
        for row in rows().iter().filter(|r| r.scene == name) {
            let all = row.direct + row.bounced;
            let (off, error) = compared(&bounce, row);
            let why = &bounce.need().why;
            eprintln!("{name}: {:.1e} off, {:.1e} claimed; {why}", off / all, error / all);
            assert!(off <= error + 4.0 * row.sigma + 3.5e-3 * row.bounced, "{name}: {off} {error}");
            assert!(error < most * all && why.contains("lobes along"), "{name}: {error}");
        }
    }
}
