//! `sunglint picture`, the whole program.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::{Folder, SPHERE_PASS};
use std::f64::consts::PI;
use sunglint_formats::fits::Fits;

fn fits(folder: &Folder, name: &str) -> Fits {
    Fits::read(folder.path(name)).unwrap()
}

/// Truth: Russell's Lambert sphere, 2ρR²/3π (sin γ + (π − γ) cos γ) m² sr⁻¹ with ρ = 0.2, R = 0.5 m; the picture's pixels sum to it (1e-9 before the blur and in the
/// file). The sphere's outline across the line of sight is πR² (its 20,480 facets: 2e-3).
#[test]
fn the_pixels_of_a_sphere_sum_to_its_intensity() {
    let folder = Folder::new("picture-sphere");
    let target = "[[part]]\nname = \"s\"\nshape = \"sphere\"\nradius_m = 0.5\nmaterial = \"m\"\n[[material]]\nname = \"m\"\nmodel = \"lambert\"\nreflectance = 0.2\n";
    std::fs::write(folder.path("s.toml"), target).unwrap();
    let command = "picture --model s.toml --phase 60 --per-irradiance --size-px 64 -o s.fits -o s.png -o s.svg -o s.json --what intensity,material,depth,rgb -q";
    folder.done(&command.split(' ').collect::<Vec<_>>());
    let json: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.path("s.json")).unwrap()).unwrap();
    let phase = PI / 3.0;
    let truth = 2.0 * 0.2 * 0.25 / (3.0 * PI) * (phase.sin() + (PI - phase) * phase.cos());
    let total = json["bands"][0]["total"].as_f64().unwrap();
    assert!((total / truth - 1.0).abs() < 1e-8, "{total} {truth}");
    assert_eq!(json["unit"], "m2 / sr");
    let seen = json["materials"][0]["seen_m2"].as_f64().unwrap();
    assert!((seen / (PI * 0.25) - 1.0).abs() < 2e-3, "{seen}");
    let fits = fits(&folder, "s.fits");
    let image = fits.image(fits.find("I_550NM").unwrap()).unwrap();
    let sum: f64 = image.pixels.to_f64().iter().sum();
    assert!((sum / truth - 1.0).abs() < 1e-9, "{sum}");
    assert_eq!(image.header.text("BUNIT"), Some("m2 / sr"));
    // The nearest point stands 0.5 m in front of the origin's plane.
    let depth = fits.image(fits.find("DEPTH").unwrap()).unwrap().pixels.to_f64();
    let nearest = depth.iter().copied().filter(|d| d.is_finite()).fold(f64::INFINITY, f64::min);
    assert!((nearest + 0.5).abs() < 2e-3, "{nearest}");
    assert_eq!(fits.image(fits.find("MATERIAL").unwrap()).unwrap().pixels.shape(), [1, 64, 64]);
}

/// Truth: where the body's parts are: seen from +x with z up, y is to the right. A sphere at y = 0.5 m, z = 1 m has its outline's middle there by the file's own
/// coordinates (a tenth of a pixel).
#[test]
fn up_and_right_are_where_the_coordinates_say() {
    let folder = Folder::new("picture-up");
    let target = "[[part]]\nname = \"s\"\nshape = \"sphere\"\nradius_m = 0.2\noffset_m = [0.3, 0.5, 1.0]\nmaterial = \"white\"\n";
    std::fs::write(folder.path("s.toml"), target).unwrap();
    let command = "picture --model s.toml --observer 1,0,0 --phase 0 --size-px 100 --what material -o s.fits -q";
    folder.done(&command.split(' ').collect::<Vec<_>>());
    let fits = fits(&folder, "s.fits");
    let image = fits.image(0).unwrap();
    let header = |key: &str| image.header.real(key).unwrap();
    let shares = image.pixels.to_f64();
    let (mut sum, mut x, mut y) = (0.0, 0.0, 0.0);
    for (at, share) in shares.indexed_iter() {
        let place = |index: usize, axis: u32| {
            (index as f64 + 1.0 - header(&format!("CRPIX{axis}"))) * header(&format!("CDELT{axis}"))
        };
        sum += share;
        x += share * place(at[2], 1);
        y += share * place(at[1], 2);
    }
    let tenth = 0.1 * header("CDELT1");
    assert!((x / sum - 0.5).abs() < tenth && (y / sum - 1.0).abs() < tenth, "{x} {y} {sum}");
}

/// Truth: by hand. 6.45 µm pixels behind 3 m see 206265″·6.45e-6/3 = 0.44347″; 2″ of seeing and 1.029·550 nm/0.43 m = 0.27148″ make 2.01834″. The picture is
/// that of the moment at which the target stands highest.
#[test]
fn the_stations_camera() {
    let folder = Folder::new("picture-optics");
    std::fs::write(folder.path("pass.toml"), SPHERE_PASS).unwrap();
    let command = "picture pass.toml --station-optics --what intensity -o p.fits --json -q";
    let json = folder.json(&command.split(' ').collect::<Vec<_>>());
    let fwhm = json["bands"][0]["fwhm_arcsec"].as_f64().unwrap();
    assert!((fwhm - 2.01834).abs() < 1e-5, "{fwhm}");
    assert!(json["bands"][0]["outside"].as_f64().unwrap() < 0.01, "{json}");
    let fits = fits(&folder, "p.fits");
    let image = fits.image(0).unwrap();
    let scale = image.header.real("CDELT1A").unwrap();
    assert!((scale - 0.44347).abs() < 1e-5, "{scale}");
    assert!(image.header.text("DATE-OBS").unwrap().starts_with("2008-09-21T18:"));
    assert_eq!(image.header.text("BUNIT"), Some("W / (sr nm)"));
    // Blurred, the brightest pixel is in the middle.
    let values = image.pixels.to_f64();
    let best = values.indexed_iter().max_by(|a, b| a.1.total_cmp(b.1)).unwrap().0;
    let middle = values.shape()[0] / 2;
    assert!(best[0].abs_diff(middle) <= 1 && best[1].abs_diff(middle) <= 1, "{best:?} {middle}");
}

/// Truth: a Lambert sphere sends 2ρR²/3 back in every direction at phase angle 0 (1e-9), an orthogonal mirror plate nothing but along its normal.
#[test]
fn maps() {
    let folder = Folder::new("picture-map");
    let target = "[[part]]\nname = \"s\"\nshape = \"sphere\"\nradius_m = 1.5\nmaterial = \"m\"\n[[material]]\nname = \"m\"\nmodel = \"lambert\"\nreflectance = 0.4\n";
    std::fs::write(folder.path("s.toml"), target).unwrap();
    let command =
        "picture --model s.toml --map --step-deg 20 --per-irradiance -o m.fits -o m.png --json -q";
    let json = folder.json(&command.split(' ').collect::<Vec<_>>());
    let truth = 2.0 / 3.0 * 0.4 * 2.25;
    let brightest = json["bands"][0]["brightest"].as_f64().unwrap();
    assert!((brightest / truth - 1.0).abs() < 1e-8, "{brightest}");
    let fits = fits(&folder, "m.fits");
    let image = fits.image(0).unwrap();
    assert_eq!(image.pixels.shape(), [9, 18]);
    assert!(image.pixels.to_f64().iter().all(|v| (v / truth - 1.0).abs() < 1e-9));
    assert_eq!(
        (image.header.real("CRVAL1"), image.header.real("CRVAL2")),
        (Some(-170.0), Some(-80.0))
    );
    // A plate's map has its peak where its normal points.
    let plate = "[[part]]\nname = \"p\"\nshape = \"plate\"\nsize_m = [1, 1]\nfaces = [\"+z\"]\nmaterial = \"m\"\n[[material]]\nname = \"m\"\nmodel = \"lambert\"\nreflectance = 0.4\n";
    std::fs::write(folder.path("p.toml"), plate).unwrap();
    let json =
        folder.json(&["picture", "--model", "p.toml", "--map", "--step-deg", "10", "--json"]);
    assert_eq!(json["bands"][0]["latitude_deg"], 85.0);
}

/// Truth: closed forms over πR²: Lambert 2/3π at 0° and 2/3π² at 90°; a mirror 1/4π. Nine digits.
#[test]
fn spheres_against_phase_angle() {
    let folder = Folder::new("picture-spheres");
    let json = folder.json(&[
        "picture", "--sphere", "--alpha", "0.01,0.5", "--json", "-o", "s.ecsv", "-o", "s.png",
    ]);
    let at = |i: usize, key: &str| json["spheres"][i][key].as_f64().unwrap();
    let close = |a: f64, b: f64| (a / b - 1.0).abs() < 1e-8;
    assert!(
        close(at(0, "at_0_deg"), 2.0 / (3.0 * PI))
            && close(at(0, "at_90_deg"), 2.0 / (3.0 * PI * PI))
    );
    assert!(close(at(1, "at_0_deg"), 0.25 / PI) && close(at(1, "at_90_deg"), 0.25 / PI));
    // α → 0 is the mirror, to order α².
    assert!((at(2, "at_90_deg") * 4.0 * PI - 1.0).abs() < 1e-3);
    let text = std::fs::read_to_string(folder.path("s.ecsv")).unwrap();
    assert!(text.contains("alpha_0_01") && text.contains("1 / sr"), "{text}");
}

#[test]
fn what_cannot_be_drawn_is_said() {
    let folder = Folder::new("picture-errors");
    std::fs::write(folder.path("pass.toml"), SPHERE_PASS).unwrap();
    for (code, command, says) in [
        (2, "picture", "a picture of what?"),
        (2, "picture pass.toml --model box_wing", "not both"),
        (1, "picture --model box_wong", "did you mean box_wing?"),
        (
            1,
            "picture pass.toml --at 2008-09-21T20:00:00",
            "outside the pass, which runs from 2008-09-21T18:45:00Z",
        ),
        (2, "picture pass.toml --phase 30", "--phase goes with --model"),
        (2, "picture --model box_wing --at now", "a model alone has no time"),
        (2, "picture --model box_wing --up north", "--up body-z"),
        (
            1,
            "picture --model box_wing --observer 0,0,1 --up body-z --wavelength-nm 9999",
            "tabulated from",
        ),
        (2, "picture --model box_wing --psf-arcsec 1", "--range-km"),
        (2, "picture --model box_wing --phase 200", "expected 0 to 180"),
        (2, "picture --model box_wing --sun 0,0,0", "not all 0"),
        (2, "picture --model box_wing --pixel-m -1", "expected metres above 0"),
        (1, "picture --model box_wing --pixel-m 1e-9", "at most 10000"),
        (2, "picture --model box_wing --size-px 0", "--size-px is 0"),
        (2, "picture --model box_wing -o p.ecsv", "a picture is no table"),
        (1, "picture --model box_wing --map --step-deg 0.001", "0.1° to 90°"),
        (2, "picture --sphere --alpha 7", "1e-5 to 2"),
    ] {
        let message = folder.refused(code, &command.split(' ').collect::<Vec<_>>());
        assert!(message.contains(says), "{command}: {message}");
    }
    std::fs::write(folder.path("there.png"), "mine").unwrap();
    let message = folder.refused(1, &["picture", "--sphere", "-o", "there.png"]);
    assert!(message.contains("--force"), "{message}");
    assert_eq!(std::fs::read_to_string(folder.path("there.png")).unwrap(), "mine");
}

/// The commands of docs/picture.md run, in their order.
#[test]
fn the_commands_of_the_page_run() {
    let folder = Folder::new("picture-page");
    let page = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/picture.md");
    let page = std::fs::read_to_string(page).unwrap();
    let commands: Vec<&str> = page.lines().filter_map(|l| l.strip_prefix("sunglint ")).collect();
    assert!(commands.len() >= 6);
    // What the demonstration leaves of it is enough.
    std::fs::create_dir(folder.path("sunglint-demo")).unwrap();
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/rehearsal/demo/pass.toml");
    std::fs::copy(scene, folder.path("sunglint-demo/pass.toml")).unwrap();
    for command in commands.into_iter().filter(|c| !c.starts_with("demo")) {
        folder.done(&command.split(' ').collect::<Vec<_>>());
    }
    assert!(folder.path("camera.png").exists() && folder.path("map.fits").exists());
}
