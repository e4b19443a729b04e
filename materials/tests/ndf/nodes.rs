//! Retro-reflection that is known on the nodes: what quadrature and iteration leave.

use crate::ndf::truth::{Shape, Truth, density_error};
use sunglint_materials::ndf::{Anisotropic, Hemisphere, Isotropic, NdfError, solve};

/// Truth: Beckmann and GGX in closed form. Tolerance: 5e-6, as 128 Gauss–Legendre nodes leave where the kernel has its kink.
#[test]
fn lobes_on_128_nodes() {
    let over = Isotropic::new(128);
    let theta = over.elevations.theta_rad.clone();
    for shape in [Shape::Beckmann, Shape::Ggx] {
        for alpha in [0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.45, 0.6] {
            let truth = Truth::isotropic(shape, alpha, 0.8);
            let f: Vec<f64> = theta.iter().map(|t| truth.f(*t, 0.0)).collect();
            let found = solve(&over, &f).unwrap();
            let worst = density_error(&truth, &theta, &[0.0], &found.density);
            let off = (found.f0 / 0.8 - 1.0).abs();
            eprintln!("{shape:?} {alpha}: D {worst:.1e}, F0 {off:.1e}, {:?}", found.convergence);
            assert!(worst < 5e-6 && off < 5e-6, "{shape:?} {alpha}: {worst:e} {off:e}");
            assert!(found.convergence.eigenvalue_gap > 0.5);
            assert!((over.projected(&found.density) - 1.0).abs() < 1e-12);
            // σ is cosθ/G₁; its error is that of the quadrature across the kink.
            let area = |k: usize| theta[k].cos() / truth.masking(theta[k], 0.0);
            let off = (0..128).map(|k| (found.sigma[k] - area(k)).abs()).fold(0.0, f64::max);
            assert!(off < 1e-5, "{shape:?} {alpha}: sigma {off:e}");
        }
    }
}

/// Truth: the same equation by another discretisation, midpoints in cosθ, run once in Python on 200, 400 and 800 of them and extrapolated: F₀ = 2.082098 ρ,
/// D(0) = 0.611518, D/D(0) = 0.756486, 0.520299, 0.287176 at 30°, 45°, 60°. Tolerance: 1e-5, and 6e-4 between nodes, which the test joins by straight lines.
#[test]
fn lamberts_density() {
    let over = Isotropic::new(128);
    let theta = &over.elevations.theta_rad;
    let rho = 0.6;
    let found = solve(&over, &[rho / std::f64::consts::PI; 128]).unwrap();
    assert!((found.f0 / rho - 2.082098).abs() < 1e-5, "{}", found.f0 / rho);
    assert!((found.density[0] - 0.611518).abs() < 1e-5, "{}", found.density[0]);
    for (at, expected) in [(30.0_f64, 0.756486), (45.0, 0.520299), (60.0, 0.287176)] {
        let k = theta.partition_point(|t| *t < at.to_radians());
        let share = (at.to_radians() - theta[k - 1]) / (theta[k] - theta[k - 1]);
        let d = found.density[k - 1] + share * (found.density[k] - found.density[k - 1]);
        assert!((d / found.density[0] - expected).abs() < 6e-4, "{at}: {}", d / found.density[0]);
    }
}

/// Truth: anisotropic lobes in closed form. Tolerance: 1e-3 on 32 by 64 nodes.
#[test]
fn anisotropic_lobes() {
    let over = Anisotropic::new(32, 64);
    let theta = over.elevations.theta_rad.clone();
    for (shape, alpha) in [
        (Shape::Beckmann, [0.1, 0.3]),
        (Shape::Ggx, [0.1, 0.3]),
        (Shape::Beckmann, [0.3, 0.2]),
        (Shape::Ggx, [0.5, 0.5]),
    ] {
        let truth = Truth { shape, alpha, f0: 0.7 };
        let at = |phi: &f64| theta.iter().map(|t| truth.f(*t, *phi)).collect::<Vec<_>>();
        let f: Vec<f64> = over.phi_rad.iter().flat_map(at).collect();
        let found = solve(&over, &f).unwrap();
        let worst = density_error(&truth, &theta, &over.phi_rad, &found.density);
        let off = (found.f0 / 0.7 - 1.0).abs();
        eprintln!("{shape:?} {alpha:?}: D {worst:.1e}, F0 {off:.1e}, {:?}", found.convergence);
        assert!(worst < 1e-3 && off < 1e-3, "{shape:?} {alpha:?}: {worst:e} {off:e}");
    }
}

#[test]
fn what_is_no_brdf_is_refused() {
    let over = Isotropic::new(16);
    for (f, words) in [
        (vec![0.0; 16], "0 at every node"),
        (vec![0.1; 15], "15 values for 16 nodes"),
        (vec![f64::NAN; 16], "NaN"),
        (vec![-1.0; 16], "-1 sr⁻¹ at node 0"),
    ] {
        let error = solve(&over, &f).unwrap_err();
        assert!(
            matches!(error, NdfError::Values(_)) && error.to_string().contains(words),
            "{error}"
        );
    }
    // Light from one direction alone is a lobe all the same.
    let mut single = vec![0.0; 16];
    single[3] = 1.0;
    let found = solve(&over, &single).unwrap();
    assert!(found.density.iter().enumerate().all(|(k, d)| (*d > 0.0) == (k == 3)));
}
