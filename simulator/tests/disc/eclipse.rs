//! Light of the disc that the Earth leaves.

use super::kit::*;
use glam::DVec3;
use std::f64::consts::PI;
use sunglint_ephemeris::orbit::eclipse::Discs;
use sunglint_simulator::light::disc::eclipse::{fractions, globe};
use sunglint_simulator::light::disc::profile::factors;
use sunglint_simulator::light::{Lighting, Scene, SunOptions};
use sunglint_simulator::target::Target;

fn seen(discs: &Discs, nm: f64) -> f64 {
    fractions(discs).iter().zip(factors(nm)).map(|(s, l)| s * l).sum()
}

fn discs(earth_rad: f64, depth: f64) -> Discs {
    Discs { sun_rad: SUN, earth_rad, separation_rad: earth_rad + depth * SUN }
}

/// Truth: counting 1000² places of the disc with the power law, each seen or behind the Earth: low orbit, geostationary, an
/// Earth smaller than the Sun (annular). 3e-4, which is what an edge through so many places is worth; 1e-4 mostly met.
#[test]
fn fractions_are_what_counting_finds() {
    let mut worst = 0.0_f64;
    for earth_rad in [1.15, 0.152, SUN, 0.6 * SUN] {
        for depth in [-0.99, -0.8, -0.5, -0.2, 0.0, 0.3, 0.6, 0.9, 0.999] {
            let discs = discs(earth_rad, depth);
            let (sin, cos) = discs.separation_rad.sin_cos();
            let earth = DVec3::new(sin, 0.0, cos);
            for nm in [350.0, 550.0, 1000.0] {
                let truth = average(DVec3::Z, nm, 1000, |d| {
                    let seen = (d - earth).length() > 2.0 * (0.5 * earth_rad).sin();
                    if seen { d.z } else { 0.0 }
                });
                let ours = seen(&discs, nm);
                worst = worst.max((ours - truth).abs());
                assert!((ours - truth).abs() < 5e-4, "{earth_rad} {depth} {nm}: {ours} {truth}");
            }
        }
    }
    eprintln!("eclipses against counting: {worst:.1e}");
}

/// Truth: closed forms. A straight edge through the middle leaves half of every profile; whole and none are exact; the limb is redder, so what
/// is left at the last is redder than the middle; a uniform disc's fraction (of the lens formula) lies above what a darkened one has
/// while the limb alone is seen.
#[test]
fn closed_forms_and_the_red_limb() {
    let half = Discs { sun_rad: SUN, earth_rad: 0.5 * PI, separation_rad: 0.5 * PI };
    let found = fractions(&half);
    assert!(
        (found[0] - 0.5).abs() < 1e-9 && found[1..].iter().all(|s| s.abs() < 1e-9),
        "{found:?}"
    );
    assert_eq!(fractions(&discs(1.1, 1.001))[..2], [1.0, 0.0]);
    assert_eq!(fractions(&discs(1.1, -1.001)), [0.0; 5]);
    let late = discs(1.1, -0.9);
    assert!(seen(&late, 1000.0) > 1.2 * seen(&late, 400.0));
    assert!(late.visible_fraction() > seen(&late, 1000.0));
    // Into the shadow without jumps.
    let at = |depth: f64| seen(&discs(1.1, depth), 550.0);
    for k in -1100..1100 {
        let depth = 1e-3 * f64::from(k);
        assert!(at(depth + 1e-3) >= at(depth) - 1e-9, "{depth}");
        assert!(at(depth + 1e-3) - at(depth) < 1e-3);
    }
}

/// Truth: for paint square to the Sun the shadow is a factor, [`fractions`], 1e-6; for a mirror it hides the image or not.
#[test]
fn the_shadow_within_the_light_engine() {
    let options = SunOptions { eclipse: true, ..SunOptions::default() };
    let paint = Scene::with_sun(&facet(white()), options).unwrap();
    let polished = Scene::with_sun(&facet(mirror()), options).unwrap();
    for depth in [-1.2, -0.9, -0.3, 0.0, 0.5, 1.2] {
        let discs = discs(1.1, depth);
        let earth = globe(&discs, DVec3::Z, DVec3::new(0.9, 0.1, 0.3).normalize(), 7e6);
        for nm in [400.0, 550.0, 1000.0] {
            let dark = Lighting { shadow: Some(earth), ..lighting(DVec3::Z, tilted(0.3)) };
            let (ours, error) = at(&paint, &dark, nm);
            let truth = seen(&discs, nm) * 0.3_f64.cos() / PI;
            assert!((ours - truth).abs() < 1e-6, "{depth} {nm}: {ours} {truth}");
            assert!(error < 2e-5, "{error}");
        }
        // A mirror along z shows the place of the disc opposite the observer; the Earth lies towards +x.
        for x in [-0.8, 0.0, 0.8] {
            let to = tilted(-x * SUN);
            let toward = (DVec3::Z.cross(earth.toward)).cross(DVec3::Z).normalize();
            let to = DVec3::new(to.x * toward.x - to.x * 0.0, to.x * toward.y, to.z);
            let dark = Lighting { shadow: Some(earth), ..lighting(DVec3::Z, to.normalize()) };
            let (ours, _) = at(&polished, &dark, 550.0);
            // Its edge stands at +depth towards the Earth.
            assert_eq!(ours > 0.0, x < depth, "{depth} {x}: {ours}");
        }
    }
}

/// Truth: a white cylinder of 1 m and 1 m height, seen square to its axis, sends (cos e/2π)(sin γ + (π − γ) cos γ) towards an azimuth γ away from the Sun's (the integral of both cosines over the arc that is lit and seen,
/// by hand; e is the Sun's elevation), averaged over what the Earth leaves of the disc (400² places; an edge through them is worth 1e-3 of the light, and as much of how far it moves, 2e-5). The light
/// of a half-set disc comes from half a radius off its middle, which changes 1 % here.
#[test]
fn a_cylinder_at_sunset() {
    let text = "[[part]]\nname = \"c\"\nshape = \"cylinder\"\nradius_m = 1\nheight_m = 1\nmaterial = \"m\"\n[[material]]\nname = \"m\"\nmodel = \"lambert\"\nreflectance = 1\n";
    let target = Target::parse("cylinder.toml", text).unwrap();
    let options = SunOptions { eclipse: true, ..SunOptions::default() };
    let scene = Scene::with_sun(&target, options).unwrap();
    for gamma in [1.0_f64, 2.1, 2.7] {
        let to = DVec3::new(gamma.cos(), gamma.sin(), 0.0);
        let sent = |d: DVec3| {
            let azimuth = d.y.atan2(d.x);
            let apart = (gamma - azimuth).abs();
            d.x.hypot(d.y) / (2.0 * PI) * (apart.sin() + (PI - apart) * apart.cos())
        };
        for depth in [0.0, 0.6, -0.6] {
            let discs = discs(1.1, depth);
            let earth = globe(&discs, DVec3::X, DVec3::new(0.3, 0.9, 0.1).normalize(), 7e6);
            let dark = Lighting { shadow: Some(earth), ..lighting(DVec3::X, to) };
            let (found, stated) = at(&scene, &dark, 550.0);
            let left = |value: &dyn Fn(DVec3) -> f64| {
                let edge = 2.0 * (0.5 * 1.1_f64).sin();
                let sees =
                    |d: DVec3| if (d - earth.toward).length() > edge { value(d) } else { 0.0 };
                average(DVec3::X, 550.0, 400, sees)
            };
            // Against the light that is left, of which the edge's places are the same.
            let truth = left(&sent) / left(&|d| d.x);
            let found = found / seen(&discs, 550.0);
            let off = (found / truth - 1.0).abs();
            assert!(off <= stated / found + 1e-4, "{gamma} {depth}: {found} ± {stated}, {truth}");
            assert!(stated < 1e-3 * found, "{gamma} {depth}: {stated} of {found}");
        }
    }
}
