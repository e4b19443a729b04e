//! Tables of values that no surface has.

use sunglint_materials::exchange::{implausible, warnings};
use sunglint_materials::samples::{Sample, Samples};

/// Truth: by hand: a table of a white surface has nothing to say of, and each mistake that people make with one is named: percent, radians, values below 0, none at all.
#[test]
fn tables_that_no_surface_has_are_named() {
    let table = |angle: f64, value: f64| {
        let row = |k: i32| Sample {
            theta_i_deg: 30.0 * angle,
            phi_i_deg: 0.0,
            theta_o_deg: f64::from(k - 6) * 10.0 * angle,
            phi_o_deg: 180.0,
            brdf_per_sr: vec![value],
            sigma_per_sr: Vec::new(),
        };
        let rows = (0..13).map(row).collect();
        Samples { wavelength_nm: vec![550.0], rows, ..Samples::default() }
    };
    assert_eq!(implausible(&table(1.0, 0.3)), Vec::<String>::new());
    for (angle, value, word) in [
        (1.0, 30.0, "percent"),
        (1.0_f64.to_radians(), 0.3, "radians"),
        (1.0, -0.01, "below 0"),
        (1.0, 0.0, "no light"),
    ] {
        let said = implausible(&table(angle, value));
        assert!(said.len() == 1 && said[0].contains(word), "{angle} {value}: {said:?}");
    }
}

/// Whether a value is of light at 30° and this detector.
fn at(row: &Sample, theta_o: f64, phi: f64) -> bool {
    row.theta_i_deg == 30.0 && row.theta_o_deg == theta_o && row.phi_o_deg == phi
}

/// Truth: by hand: a white surface (0.1 everywhere) and a rough gloss (1 in the mirrored direction, falling by e every 8°) have nothing to say of. One value 10 times as much, one a tenth, the normal with two values, and mirrored directions left out are each named, and nothing else.
#[test]
fn single_slips_are_named() {
    type Change = dyn Fn(&mut Vec<Sample>);
    let table = |gloss: bool, change: &Change| {
        let mut rows = Vec::new();
        for theta_i_deg in [15.0, 30.0, 45.0] {
            for theta_o in (0..80).step_by(5) {
                for phi_o_deg in [0.0, 45.0, 90.0, 135.0, 180.0] {
                    let theta_o_deg = f64::from(theta_o);
                    let mut row = Sample {
                        theta_i_deg,
                        phi_i_deg: 0.0,
                        theta_o_deg,
                        phi_o_deg,
                        brdf_per_sr: vec![0.1],
                        sigma_per_sr: Vec::new(),
                    };
                    let (i, o) = row.directions();
                    let mirror = glam::DVec3::new(-i.x, -i.y, i.z);
                    let off = mirror.angle_between(o).to_degrees();
                    row.brdf_per_sr[0] += if gloss { (-off / 8.0).exp() } else { 0.0 };
                    if theta_o > 0 || phi_o_deg == 0.0 {
                        rows.push(row);
                    }
                }
            }
        }
        change(&mut rows);
        warnings(&Samples { wavelength_nm: vec![550.0], rows, ..Samples::default() })
    };
    for gloss in [false, true] {
        assert_eq!(table(gloss, &|_| ()), Vec::<String>::new());
    }
    let scale = |factor: f64| {
        move |rows: &mut Vec<Sample>| {
            rows.iter_mut().filter(|r| at(r, 50.0, 90.0)).for_each(|r| r.brdf_per_sr[0] *= factor);
        }
    };
    for (change, word) in [
        (
            &scale(10.0) as &Change,
            "10.000 times as much (incidence 30.0°, detector 50.0°, azimuth 90°",
        ),
        (&scale(0.1), "0.100 times"),
        (
            &|rows| {
                let mut second = rows.iter().find(|r| at(r, 0.0, 0.0)).unwrap().clone();
                second.phi_o_deg = 90.0;
                second.brdf_per_sr[0] *= 2.0;
                rows.push(second);
            },
            "1 direction stands there with values that differ",
        ),
        (
            &|rows| rows.retain(|r| r.phi_o_deg < 180.0 || r.theta_o_deg < 10.0),
            "mirrored direction",
        ),
    ] {
        let said = table(false, change);
        assert!(said.len() == 1 && said[0].contains(word), "{word}: {said:?}");
    }
}
