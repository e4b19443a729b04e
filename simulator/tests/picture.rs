//! Pictures and maps against what the engine sums and against closed forms.

use glam::DVec3;
use std::f64::consts::PI;
use sunglint_simulator::light::{Faceted, Scene, View};
use sunglint_simulator::picture::{Camera, Map, MapError, Picture, PictureError};
use sunglint_simulator::target::Target;

fn body(name: &str) -> Faceted {
    let target = Target::built_in(name).expect("a built-in target");
    Faceted::new(&target).expect("a scene")
}

fn camera(toward: DVec3, pixel_m: f64, size_px: [usize; 2]) -> Camera {
    Camera { toward: toward.normalize(), up: DVec3::Z, pixel_m, size_px }
}

/// Truth: the engine's exact weights, held against other programs elsewhere: whatever the pixels, their sum is the intensity. Rounding of a million sums: 1e-12.
#[test]
fn the_pixels_hold_what_the_engine_sums() {
    for name in ["box_wing", "corner", "hexagon", "box_with_panels"] {
        let body = body(name);
        let scene = body.scene();
        let (mut eye, mut evaluator) = (body.eye(), scene.evaluator());
        let sun = DVec3::new(0.7, 0.3, 0.6);
        let toward = DVec3::new(0.6, -0.5, 0.7);
        let bands: Vec<Vec<f64>> =
            [450.0, 800.0].map(|nm| scene.spectra().map(|s| s.at(nm)).collect()).to_vec();
        let mut weights = vec![0.0; scene.weight_count()];
        evaluator.direct(sun, View::Distant(toward), &mut weights).unwrap();
        for (pixel_m, size_px) in [(0.05, [160, 140]), (0.7, [12, 10]), (10.0, [1, 1])] {
            let camera = camera(toward, pixel_m, size_px);
            let picture = Picture::render(&mut eye, &camera, sun, &bands).unwrap();
            for (pixels, factors) in picture.bands.iter().zip(&bands) {
                let expected: f64 = weights.iter().zip(factors).map(|(w, f)| w * f).sum();
                let found: f64 = pixels.iter().sum();
                assert!((found / expected - 1.0).abs() < 1e-12, "{name}: {found} {expected}");
                assert!(pixels.iter().all(|p| *p > -1e-12 * expected));
            }
        }
    }
}

/// Truth: the engine's weights of curved bodies, whose closed forms are elsewhere: facets stand for them, but their sum is the body's own. 1e-9: each part and weight is
/// scaled. A mirror sphere shows its one point: ρR²/4 in a single pixel's worth.
#[test]
fn pictures_of_curved_bodies_hold_what_the_engine_sums() {
    let text = "name = \"c\"\n[[part]]\nname = \"can\"\nshape = \"cylinder\"\nradius_m = 0.4\nheight_m = 1.5\nmaterial = \"gloss\"\n\
                [[part]]\nname = \"ball\"\nshape = \"sphere\"\nradius_m = 0.3\noffset_m = [0.9, 0, 0]\nmaterial = \"white\"\n\
                [[part]]\nname = \"drop\"\nshape = \"sphere\"\nradius_m = 0.2\noffset_m = [0, 0, 1.6]\nmaterial = \"polished\"\n\
                [[material]]\nname = \"white\"\nmodel = \"lambert\"\nreflectance = 1\n\
                [[material]]\nname = \"polished\"\nmodel = \"mirror\"\nreflectance = 1\n\
                [[material]]\nname = \"gloss\"\nmodel = \"microfacet\"\ndistribution = \"ggx\"\nalpha = 0.3\nreflectance = 1\n";
    let body = Faceted::new(&Target::parse("c.toml", text).unwrap()).unwrap();
    let (mut eye, mut evaluator) = (body.eye(), body.scene().evaluator());
    let sun = DVec3::new(0.9, -0.4, 0.3);
    let camera = camera(DVec3::new(0.7, -0.6, 0.2), 0.02, [250, 250]);
    let mut weights = vec![0.0; body.scene().weight_count()];
    evaluator.direct(sun, View::Distant(camera.toward), &mut weights).unwrap();
    for k in 0..weights.len() {
        let mut only = vec![0.0; weights.len()];
        only[k] = 1.0;
        let picture = Picture::render(&mut eye, &camera, sun, &[only]).unwrap();
        let found: f64 = picture.bands[0].iter().sum();
        assert!(weights[k] > 0.0);
        assert!((found / weights[k] - 1.0).abs() < 1e-9, "{k}: {found} {}", weights[k]);
        if body.scene().materials()[k].is_mirror() {
            assert!((found / 0.01 - 1.0).abs() < 1e-9, "{found}");
            assert!(picture.bands[0].iter().filter(|p| **p > 0.0).count() <= 4);
        }
    }
}

/// Truth: a box of 1 × 2 × 3 m seen along its x axis: 2 × 3 m of the face, half a metre nearer than the middle; a pixel's share worked out by hand. The
/// observer has +y at the right when z is up and x comes towards it.
#[test]
fn a_box_stands_where_it_should() {
    let text = "name = \"b\"\n[[part]]\nname = \"b\"\nshape = \"box\"\nsize_m = [1, 2, 3]\nmaterial = \"white\"\noffset_m = [0, 0.5, 0]\n\
                [[material]]\nname = \"white\"\nmodel = \"lambert\"\nreflectance = 1\n";
    let body = Faceted::new(&Target::parse("b.toml", text).unwrap()).unwrap();
    let mut eye = body.eye();
    let camera = camera(DVec3::X, 0.4, [10, 10]);
    let picture = Picture::render(&mut eye, &camera, DVec3::X, &[vec![1.0]]).unwrap();
    // y from −0.5 to 1.5 m: columns 3.75 to 8.75; z ±1.5 m: rows 1.25 to 8.75.
    for row in 0..10 {
        for column in 0..10 {
            let share = |low: f64, high: f64, k: usize| {
                (high.min(k as f64 + 1.0) - low.max(k as f64)).max(0.0)
            };
            let expected = share(3.75, 8.75, column) * share(1.25, 8.75, row);
            let k = row * 10 + column;
            assert!((picture.materials[0][k] - expected).abs() < 1e-12, "{row} {column}");
            assert!((picture.bands[0][k] - expected * 0.16 / PI).abs() < 1e-12);
            assert_eq!(picture.depth_m[k].is_nan(), expected == 0.0);
            assert!(expected == 0.0 || (picture.depth_m[k] + 0.5).abs() < 1e-9);
            assert_eq!(picture.material_of(k), (expected > 0.5).then_some(0));
        }
    }
    // The Sun behind: nothing lit, but all of it seen.
    let dark = Picture::render(&mut eye, &camera, DVec3::NEG_X, &[vec![1.0]]).unwrap();
    assert!(dark.bands[0].iter().all(|p| *p == 0.0));
    assert_eq!(dark.materials, picture.materials);
}

/// Truth: a slanted plate's depth is a plane: z = −x tan of the tilt, at pixels that it covers whole, to 1e-9.
#[test]
fn depth_follows_a_slanted_plate() {
    let text = "name = \"p\"\n[[part]]\nname = \"p\"\nshape = \"plate\"\nsize_m = [4, 4]\nfaces = [\"+z\"]\nmaterial = \"white\"\n\
                [[material]]\nname = \"white\"\nmodel = \"lambert\"\nreflectance = 1\n";
    let body = Faceted::new(&Target::parse("p.toml", text).unwrap()).unwrap();
    let mut eye = body.eye();
    let tilt = 30.0_f64.to_radians();
    let toward = DVec3::new(tilt.sin(), 0.0, tilt.cos());
    let camera = Camera { toward, up: DVec3::Y, pixel_m: 0.1, size_px: [30, 30] };
    let picture = Picture::render(&mut eye, &camera, toward, &[]).unwrap();
    for k in 0..900 {
        // Right is y × toward: the plate's x seen shortened; farther from the observer to the left, by tan 30° a metre.
        let right_m = 0.1 * ((k % 30) as f64 + 0.5 - 15.0);
        let expected = -right_m * tilt.tan();
        assert!(
            (picture.depth_m[k] - expected).abs() < 1e-9,
            "{k}: {} {expected}",
            picture.depth_m[k]
        );
    }
}

/// Truth: a normal distribution: light is kept (within the picture), and its second moment grows by σ² and a pixel's own 1/12.
#[test]
fn a_point_spread_function_keeps_the_light() {
    let body = body("lambert_sphere");
    let mut eye = body.eye();
    let camera = camera(DVec3::X, 0.05, [200, 200]);
    let sun = DVec3::new(0.5, 0.8, 0.2);
    let sharp = Picture::render(&mut eye, &camera, sun, &[vec![1.0]]).unwrap();
    let fwhm_m = 0.6;
    let soft = sharp.blurred(fwhm_m);
    let sum = |p: &Picture| p.bands[0].iter().sum::<f64>();
    assert!((sum(&soft) / sum(&sharp) - 1.0).abs() < 1e-9);
    let spread = |p: &Picture| {
        let at = |k: usize| ((k % 200) as f64, p.bands[0][k]);
        let mean = (0..40_000).map(|k| at(k).0 * at(k).1).sum::<f64>() / sum(p);
        (0..40_000).map(|k| (at(k).0 - mean).powi(2) * at(k).1).sum::<f64>() / sum(p)
    };
    let sigma_px = fwhm_m / 0.05 / 2.354_820_045;
    let expected = sigma_px * sigma_px + 1.0 / 12.0;
    assert!((spread(&soft) - spread(&sharp) - expected).abs() < 1e-3 * expected);
    assert!(sharp.blurred(0.0).bands == sharp.bands);
}

/// Truth: Russell's closed form: a Lambert sphere is the same from everywhere, 2/(3π)(sin γ + (π − γ) cos γ) R².
#[test]
fn the_map_of_a_sphere_is_even() {
    let body = body("lambert_sphere");
    let phase = 60.0_f64.to_radians();
    let map = Map::of(body.scene(), phase, 30.0, &[1.0]).unwrap();
    assert_eq!(map.intensity.dim(), (6, 12));
    let expected = 2.0 / (3.0 * PI) * (phase.sin() + (PI - phase) * phase.cos());
    assert!(map.intensity.iter().all(|i| (i / expected - 1.0).abs() < 1e-9));
    assert_eq!((map.latitude_deg[0], map.longitude_deg[0]), (75.0, -165.0));
}

/// Truth: a Lambert plate with its front along +x sends cos²/π a square metre back to the light: of 2 m² at longitude and latitude b, l.
#[test]
fn the_map_of_a_plate_shows_its_normal() {
    let text = "name = \"p\"\n[[part]]\nname = \"p\"\nshape = \"box\"\nsize_m = [0.01, 2, 1]\nfaces = [\"+x\"]\nmaterial = \"white\"\n\
                [[material]]\nname = \"white\"\nmodel = \"lambert\"\nreflectance = 1\n";
    let scene = Scene::new(&Target::parse("p.toml", text).unwrap()).unwrap();
    let map = Map::of(&scene, 0.0, 10.0, &[1.0]).unwrap();
    for (r, latitude) in map.latitude_deg.iter().enumerate() {
        for (c, longitude) in map.longitude_deg.iter().enumerate() {
            let cos = latitude.to_radians().cos() * longitude.to_radians().cos();
            let expected = 2.0 / PI * cos.max(0.0).powi(2);
            assert!((map.intensity[[r, c]] - expected).abs() < 1e-12);
        }
    }
}

#[test]
fn what_is_no_picture_or_map_is_refused() {
    let body = body("box_wing");
    let scene = body.scene();
    let mut eye = body.eye();
    let good = camera(DVec3::X, 0.1, [10, 10]);
    let mut of = |camera| Picture::render(&mut eye, &camera, DVec3::X, &[]).unwrap_err();
    for bad in [
        Camera { pixel_m: 0.0, ..good },
        Camera { pixel_m: f64::NAN, ..good },
        Camera { size_px: [0, 5], ..good },
        Camera { size_px: [1 << 40, 1 << 40], ..good },
    ] {
        assert!(matches!(of(bad), PictureError::Size { .. }));
    }
    assert!(matches!(of(Camera { up: DVec3::X, ..good }), PictureError::Up { .. }));
    assert!(matches!(
        of(Camera { toward: DVec3::ZERO, ..good }),
        PictureError::Direction(_) | PictureError::Up { .. }
    ));
    let factors = vec![1.0; scene.weight_count()];
    for (phase, step) in [(PI, 5.0), (-0.1, 5.0), (f64::NAN, 5.0)] {
        assert!(matches!(
            Map::of(scene, phase, step, &factors).unwrap_err(),
            MapError::Phase { .. }
        ));
    }
    assert!(matches!(Map::of(scene, 0.0, 0.01, &factors).unwrap_err(), MapError::Step { .. }));
}
