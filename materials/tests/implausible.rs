//! Tables of values that no surface has.

use sunglint_materials::exchange::implausible;
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
