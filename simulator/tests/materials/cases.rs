//! The `.bsdf` files whose values Mitsuba was asked for: `cargo run -p sunglint-simulator --example bsdf_files -- FOLDER` writes them.

use sunglint_formats::bsdf::{Tensor, TensorFile};
use sunglint_radiometry::spectrum::Spectrum;
use sunglint_simulator::surface::measured::{WriteOptions, write};
use sunglint_simulator::surface::{
    Distribution, Fresnel, Gloss, Lobe, Masking, Material, WardForm,
};

pub const WAVELENGTHS_NM: [f64; 3] = [400.0, 550.0, 800.0];

pub fn materials() -> Vec<(&'static str, Material)> {
    let slope = || Spectrum::new(vec![300.0, 1000.0], vec![0.2, 0.9]).unwrap();
    let lobe =
        |distribution, alpha| Lobe::isotropic(distribution, alpha, Masking::Separable).unwrap();
    let rough = |name, lobe| Material::microfacet(name, lobe, Fresnel::constant(slope()).unwrap());
    let ward = Gloss::Ward { alpha_x: 0.2, alpha_y: 0.4, form: WardForm::Bounded };
    vec![
        ("lambert", Material::lambert("lambert", slope()).unwrap()),
        ("beckmann", rough("beckmann", lobe(Distribution::Beckmann, 0.3))),
        ("ggx", rough("ggx", lobe(Distribution::Ggx, 0.2))),
        ("ward", Material::glossy("ward", ward, slope(), None).unwrap()),
    ]
}

pub fn files() -> Vec<(&'static str, TensorFile)> {
    let mut made = Vec::new();
    for (name, material) in materials() {
        let options = WriteOptions {
            elevations: 20,
            azimuths: 5,
            normals: 64,
            side: 32,
            ..WriteOptions::at(WAVELENGTHS_NM.to_vec())
        };
        made.push((name, write(&material, &options).unwrap()));
    }
    made.push(("two_fold", two_fold()));
    made
}

/// A file of no material: numbers that only show how a file is to be read, with half of the circle and grids that are not square.
pub fn two_fold() -> TensorFile {
    let mut state = 12345_u32;
    let mut random = |count: usize| -> Vec<f32> {
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            0.3 + (state >> 8) as f32 / (1 << 24) as f32
        };
        (0..count).map(|_| next()).collect()
    };
    let pi = std::f32::consts::PI;
    let phi = [-pi, -0.8 * pi, -0.5 * pi, -0.2 * pi, 0.0];
    let nm = WAVELENGTHS_NM.map(|nm| nm as f32);
    TensorFile {
        tensors: vec![
            Tensor::u8("description", "numbers"),
            Tensor::f32("theta_i", &[4], vec![0.0, 0.4, 1.0, 1.5]),
            Tensor::f32("phi_i", &[5], phi.to_vec()),
            Tensor::f32("wavelengths", &[3], nm.to_vec()),
            Tensor::f32("ndf", &[7, 9], random(7 * 9)),
            Tensor::f32("sigma", &[7, 9], random(7 * 9)),
            Tensor::f32("vndf", &[5, 4, 8, 6], random(5 * 4 * 8 * 6)),
            Tensor::f32("luminance", &[5, 4, 6, 6], random(5 * 4 * 6 * 6)),
            Tensor::f32("spectra", &[5, 4, 3, 6, 6], random(5 * 4 * 3 * 6 * 6)),
            Tensor::u8("jacobian", vec![1]),
        ],
    }
}
