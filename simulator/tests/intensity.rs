//! Light of a body for directions that are given.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use glam::DVec3;
use std::f64::consts::PI;
use std::path::Path;
use sunglint_simulator::intensity::rows::Rows;
use sunglint_simulator::intensity::{
    Aspect, Intensities, IntensityError, IntensityOptions, IntensityPool, Span,
};
use sunglint_simulator::light::engine::Switches;
use sunglint_simulator::target::Target;

const SPHERE: &str = "[[part]]\nname = \"s\"\nshape = \"sphere\"\nradius_m = 0.5\nmaterial = \"m\"\n[[material]]\nname = \"m\"\nmodel = \"lambert\"\nreflectance = 0.2\n";

fn sphere() -> Target {
    Target::parse(Path::new("s.toml"), SPHERE).unwrap()
}

fn prepared(target: &Target, options: IntensityOptions, aspects: &[Aspect]) -> Intensities {
    let mut span = Span::default();
    aspects.iter().for_each(|a| span.add(a).unwrap());
    Intensities::new(target, options, &span).unwrap()
}

fn direct() -> IntensityOptions {
    let mut options = IntensityOptions::default();
    options.switches = Switches::OFF;
    options.derivatives = true;
    options
}

/// Truth: Russell's Lambert sphere, 2ρR²/3π (sin γ + (π − γ) cos γ) m² sr⁻¹, to 1e-9 without the Sun's disc; with it within the stated error. The light is linear in the
/// albedo, so its derivative by ln ρ is the light itself.
#[test]
fn a_lambert_sphere() {
    let target = sphere();
    for deg in [1.0, 30.0, 60.0, 90.0, 140.0_f64] {
        let gamma = deg.to_radians();
        let aspect = Aspect::new(DVec3::new(gamma.cos(), gamma.sin(), 0.0), 7.0 * DVec3::X);
        let truth = 2.0 * 0.2 * 0.25 / (3.0 * PI) * (gamma.sin() + (PI - gamma) * gamma.cos());
        let light = prepared(&target, direct(), &[aspect]).worker().light(&aspect).unwrap();
        let found = light.light[0].per_irradiance_m2_per_sr;
        assert!((found / truth - 1.0).abs() < 1e-9, "{deg}: {found} {truth}");
        assert!((light.phase_deg - deg).abs() < 1e-9);
        let by = &light.by_albedo.as_ref().unwrap()[0];
        assert!((by.derivative_m2_per_sr[0] / truth - 1.0).abs() < 1e-9, "{by:?}");
        let options = IntensityOptions::default();
        let whole = prepared(&target, options, &[aspect]).worker().light(&aspect).unwrap();
        let at = &whole.light[0];
        let off = (at.per_irradiance_m2_per_sr - truth).abs();
        assert!(off <= at.error_m2_per_sr + 1e-9 * truth, "{deg}: {off} {at:?}");
        assert_eq!(whole.met, whole.limited_by.is_none());
    }
}

/// A table of one value, f = 0.1 /sr, for incidences to 60° (synthetic). Truth: Russell's Lambert sphere of the albedo 0.1 π, since where the table ends its values are held.
/// Tolerance: 1e-3, what the table's grid leaves between directions that are all alike, and the sphere's tolerance. At a wavelength without values there is an error.
#[test]
fn a_sphere_of_a_measured_table() {
    let folder = tempfile::tempdir().unwrap();
    let mut table = "theta_i_deg,phi_i_deg,theta_o_deg,phi_o_deg,brdf_per_sr\n".to_owned();
    for theta_i in [0, 20, 40, 60] {
        for theta_o in [0, 20, 40, 60, 80] {
            for phi in [0, 45, 90, 135, 180] {
                table.push_str(&format!("{theta_i},0,{theta_o},{phi},0.1\n"));
            }
        }
    }
    std::fs::write(folder.path().join("flat.csv"), table).unwrap();
    let text = SPHERE.replace(
        "model = \"lambert\"\nreflectance = 0.2",
        "model = \"brdf_table\"\nfile = \"flat.csv\"\nwavelength_nm = 532",
    );
    let target = Target::parse(folder.path().join("s.toml"), text).unwrap();
    let gamma = 60.0_f64.to_radians();
    let aspect = Aspect::new(DVec3::new(gamma.cos(), gamma.sin(), 0.0), 7.0 * DVec3::X);
    let mut options = IntensityOptions::default();
    options.wavelength_nm = vec![532.0];
    let light = prepared(&target, options.clone(), &[aspect]).worker().light(&aspect).unwrap();
    let truth = 2.0 * 0.1 * PI * 0.25 / (3.0 * PI) * (gamma.sin() + (PI - gamma) * gamma.cos());
    let found = light.light[0].per_irradiance_m2_per_sr;
    assert!((found / truth - 1.0).abs() < 1e-3, "{found} {truth}");
    assert!(light.weights.iter().all(|w| w.material.as_deref() == Some("m")), "{light:?}");
    options.wavelength_nm = vec![550.0];
    let mut span = Span::default();
    span.add(&aspect).unwrap();
    let error = Intensities::new(&target, options, &span).unwrap_err();
    assert!(
        matches!(error, IntensityError::Wavelength { from_nm, .. } if from_nm > 500.0),
        "{error}"
    );
}

/// A worker that is kept, and has done other work before, in several threads, writes the bits of one that is new. Truth: the new one's.
#[test]
fn kept_workers_change_no_bit() {
    for name in ["box_wing", "corner", "box_with_panels"] {
        let target = Target::built_in(name).unwrap();
        let aspects: Vec<Aspect> = (0..24_u32)
            .map(|k| {
                let u = f64::from(k);
                let sun = DVec3::new((1.3 * u).cos(), (1.3 * u).sin(), (0.7 * u).cos());
                Aspect::new(sun, DVec3::new((2.1 * u).sin(), 0.3 + (0.4 * u).cos(), 0.5))
            })
            .collect();
        let mut options = IntensityOptions::default();
        options.tolerance = 0.05;
        options.budget_s = 1e-3;
        options.wavelength_nm = vec![450.0, 700.0];
        let all = prepared(&target, options, &aspects);
        let fresh: Vec<_> = aspects.iter().map(|a| all.worker().light(a).unwrap()).collect();
        let pool = IntensityPool::new(all);
        std::thread::scope(|scope| {
            for first in 0..3 {
                let (pool, aspects, fresh) = (&pool, &aspects, &fresh);
                scope.spawn(move || {
                    for k in (0..aspects.len()).map(|k| (7 * k + first) % aspects.len()) {
                        let (mut light, mut error) = ([0.0; 2], [0.0; 2]);
                        let lit = pool
                            .worker()
                            .with(|w| w.light_into(&aspects[k], &mut light, &mut error))
                            .unwrap();
                        for s in 0..2 {
                            let at = &fresh[k].light[s];
                            let found = (light[s].to_bits(), error[s].to_bits());
                            let own = (at.per_irradiance_m2_per_sr, at.error_m2_per_sr);
                            assert_eq!(found, (own.0.to_bits(), own.1.to_bits()), "{name} {k}");
                            let intensity = pool.all().intensity(s, &aspects[k], light[s]);
                            assert_eq!(intensity.to_bits(), at.intensity_w_per_sr_nm.to_bits());
                        }
                        assert_eq!((lit.met, lit.phase_deg), (fresh[k].met, fresh[k].phase_deg));
                    }
                });
            }
        });
        // Rows of another length are refused.
        let short = pool.worker().with(|w| w.light_into(&aspects[0], &mut [0.0], &mut [0.0; 2]));
        assert!(short.unwrap_err().to_string().contains("expected 2"));
    }
}

/// Truth: two spheres of radius R at the same phase angle, one under the Earth: earthshine adds at most the share of sunlight that `engine::earthshine` bounds, and more
/// than nothing.
#[test]
fn the_earth_adds_light_where_it_is_given() {
    let target = sphere();
    let alone = Aspect::new(DVec3::X, DVec3::new(0.3, 0.0, -1.0));
    let above = Aspect { earth: Some((-DVec3::X, 8e5)), ..alone };
    let light = |aspect: Aspect| {
        let options = IntensityOptions::default();
        let all = prepared(&target, options, &[aspect]);
        all.worker().light(&aspect).unwrap().light[0].clone()
    };
    let (dark, lit) = (light(alone), light(above));
    let more = lit.per_irradiance_m2_per_sr - dark.per_irradiance_m2_per_sr;
    assert!(more > 0.01 * dark.per_irradiance_m2_per_sr, "{more} {dark:?}");
    // A white disc of the sphere's radius under all of the Earth's light: ρ R² · 0.45.
    assert!(more < 0.2 * 0.25 * 0.45, "{more}");
}

/// Light between surfaces is not linear in an albedo: the error says so, and what to do.
#[test]
fn derivatives_of_a_corner_are_refused() {
    let target = Target::built_in("corner").unwrap();
    let aspect = Aspect::new(DVec3::new(1.0, 0.8, 0.9), DVec3::new(0.9, 1.0, 0.7));
    let mut span = Span::default();
    span.add(&aspect).unwrap();
    let mut options = IntensityOptions::default();
    options.derivatives = true;
    let error = Intensities::new(&target, options, &span).unwrap_err();
    assert!(matches!(error, IntensityError::NotLinear { .. }), "{error}");
    assert!(error.to_string().contains("--without inter_reflection"), "{error}");
    let mut options = IntensityOptions::default();
    options.wavelength_nm = vec![1e5];
    let error = Intensities::new(&target, options, &span).unwrap_err().to_string();
    assert!(error.contains("100000 nm"), "{error}");
    assert!(Span::default().add(&Aspect::new(DVec3::ZERO, DVec3::X)).is_err());
    let near = Aspect { range_m: Some(-1.0), ..aspect };
    assert!(Span::default().add(&near).unwrap_err().to_string().contains("-1"));
}

/// Truth: the file's own numbers; columns in any order; and each mistake with its line and field.
#[test]
fn a_table_of_aspects() {
    let rows = |text: &'static str| Rows::new(Path::new("t.csv"), text.as_bytes());
    let text = "# a note\nobserver_x,observer_y,observer_z,sun_x,sun_y,sun_z,range_km\n0,0,1, 1,0,0, 800\n\n0,1,0,1,0,0,900\n";
    let all: Vec<Aspect> = rows(text).unwrap().map(Result::unwrap).collect();
    assert_eq!(all.len(), 2);
    assert_eq!((all[0].observer, all[0].sun, all[0].range_m), (DVec3::Z, DVec3::X, Some(8e5)));
    assert_eq!((all[1].observer, all[1].sun_distance_au, all[1].earth), (DVec3::Y, 1.0, None));
    // What need not be there may be empty.
    let text = "sun_x,sun_y,sun_z,observer_x,observer_y,observer_z,range_km,earth_x,earth_y,earth_z,height_km\n1,0,0,0,1,0,,,,,\n1,0,0,0,1,0,2,0,0,1,500\n";
    let all: Vec<Aspect> = rows(text).unwrap().map(Result::unwrap).collect();
    assert_eq!((all[0].range_m, all[0].earth), (None, None));
    assert_eq!((all[1].range_m, all[1].earth), (Some(2e3), Some((DVec3::Z, 5e5))));
    let text = "sun_x,sun_y,sun_z,observer_x,observer_y,observer_z,earth_x,earth_y,earth_z,height_km\n1,0,0,0,1,0,0,0,1,\n";
    let error = rows(text).unwrap().next().unwrap().unwrap_err().to_string();
    assert!(error.contains("height_km") && error.contains("t.csv:2"), "{error}");
    for (text, part) in [
        ("", "no line"),
        ("sun_x,sun_y\n", "no column `sun_z`"),
        ("sun_x,sun_x\n", "twice"),
        ("sun_x,sunny\n", "sunny"),
    ] {
        let error = rows(text).err().unwrap().to_string();
        assert!(error.contains(part), "{error}");
    }
    for (text, part) in [
        ("sun_x,sun_y,sun_z,observer_x,observer_y,observer_z\n1,2,3\n", "3 fields"),
        ("sun_x,sun_y,sun_z,observer_x,observer_y,observer_z\n1,2,3,4,x,6\n", "observer_y"),
        ("sun_x,sun_y,sun_z,observer_x,observer_y,observer_z\n1,2,3,4,,6\n", "observer_y"),
        ("sun_x,sun_y,sun_z,observer_x,observer_y,observer_z\n1,2,3,4,nan,6\n", "t.csv:2"),
    ] {
        let error = rows(text).unwrap().next().unwrap().unwrap_err().to_string();
        assert!(error.contains(part), "{error}");
    }
}

/// Truth: by hand: 1 m from the middle of a sphere of 1.3 m, and within a box of 1 m, an observer is inside, and there is no light to give; beside them he is not, also in the corner between a ball about the box and the box.
#[test]
fn an_observer_inside_the_body_is_refused() {
    let sphere = SPHERE.replace("0.5", "1.3");
    let cube = SPHERE.replace("sphere\"\nradius_m = 0.5", "box\"\nsize_m = [1, 1, 1]");
    for (text, place, inside) in [
        (&sphere, DVec3::X, true),
        (&sphere, 1.31 * DVec3::X, false),
        (&cube, 0.49 * DVec3::Y, true),
        (&cube, DVec3::splat(0.49), true),
        (&cube, 0.51 * DVec3::Y, false),
        (&cube, DVec3::new(0.51, 0.45, 0.45), false),
    ] {
        let target = Target::parse(Path::new("s.toml"), text.as_str()).unwrap();
        let aspect = Aspect { range_m: Some(place.length()), ..Aspect::new(DVec3::X, place) };
        let light = prepared(&target, direct(), &[aspect]).worker().light(&aspect);
        match inside {
            true => {
                let error = light.unwrap_err().to_string();
                assert!(error.contains("outside of the body"), "{error}");
            }
            false => assert!(light.is_ok(), "{place}: {light:?}"),
        }
    }
}

/// Truth: Russell's Lambert sphere. A material that is known to a factor of e^0.3 in all directions (95 %) sends up to e^0.3 − 1 of its light more; the sphere beside it, whose material says
/// nothing, adds no doubt. Tolerance: the 1 % to which the doubt is worked out.
#[test]
fn what_materials_say_of_themselves_is_stated() {
    let text = "[[part]]\nname = \"a\"\nshape = \"sphere\"\nradius_m = 0.5\nmaterial = \"known\"\n[[part]]\nname = \"b\"\nshape = \"sphere\"\nradius_m = 0.5\noffset_m = [0.0, 0.0, 9.0]\nmaterial = \"fitted\"\n\
        [[material]]\nname = \"known\"\nmodel = \"lambert\"\nreflectance = 0.2\n[[material]]\nname = \"fitted\"\nmodel = \"composite\"\nfresnel = \"dielectric\"\nn = 1.5\ndiffuse = { reflectance = 0.4 }\n\
        [material.doubt]\npeak_ln = 0.3\nwings_ln = 0.3\ngrazing_ln = 0.3\n";
    let target = Target::parse(Path::new("two.toml"), text).unwrap();
    for deg in [10.0, 60.0, 110.0_f64] {
        let gamma = deg.to_radians();
        let aspect = Aspect::new(DVec3::new(gamma.cos(), gamma.sin(), 0.0), DVec3::X);
        let sphere = |albedo: f64| {
            2.0 * albedo * 0.25 / (3.0 * PI) * (gamma.sin() + (PI - gamma) * gamma.cos())
        };
        for options in [direct(), IntensityOptions::default()] {
            let all = prepared(&target, options, &[aspect]);
            let at = all.worker().light(&aspect).unwrap().light[0].clone();
            let off = (at.per_irradiance_m2_per_sr - sphere(0.6)).abs();
            assert!(off <= at.error_m2_per_sr + 1e-3 * sphere(0.6), "{at:?}");
            let (half, truth) = (at.material_m2_per_sr.unwrap(), 0.3_f64.exp_m1() * sphere(0.4));
            assert!((half / truth - 1.0).abs() < 0.01, "{half} {truth}");
        }
    }
    let plain = prepared(&sphere(), direct(), &[Aspect::new(DVec3::X, DVec3::Y)]);
    let light = plain.worker().light(&Aspect::new(DVec3::X, DVec3::Y)).unwrap();
    assert!(!plain.has_material_doubt() && light.light[0].material_m2_per_sr.is_none());
}
