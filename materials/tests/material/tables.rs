//! Tables as laboratories and databases give them: read, evaluated, written.

use super::fit::{beckmann, ggx};
use glam::DVec3;
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::path::Path;
use sunglint_formats::merl::MerlBrdf;
use sunglint_formats::utia::{self, UtiaBrdf};
use sunglint_materials::exchange::{self, Exchange};
use sunglint_materials::ingest::spectra;
use sunglint_materials::look;
use sunglint_materials::samples::direction;
use sunglint_radiometry::spectrum::Spectrum;
use sunglint_simulator::surface::brdf_table::{self, Row};
use sunglint_simulator::surface::{Distribution, Fresnel, Lobe, Masking, Material, measured};
use sunglint_testkit::{fixture, shared, skip};

/// Light and detector up to `most_deg` from the normal, in any azimuth; half of them within about 10° of the mirrored direction.
fn geometries(count: usize, most_deg: f64, seed: u64) -> Vec<(DVec3, DVec3)> {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut all = Vec::new();
    while all.len() < count {
        let mut angle = |most: f64| most * rng.random::<f64>();
        let (theta_i, theta_o, azimuth) = (angle(most_deg), angle(most_deg), angle(360.0));
        let (off, turn) = (angle(20.0) - 10.0, angle(40.0) + 160.0);
        let i = direction(theta_i, 25.0);
        let o = if all.len() % 2 == 0 {
            direction(theta_o, azimuth)
        } else {
            direction((theta_i + off).abs().min(most_deg), 25.0 + turn)
        };
        all.push((i, o));
    }
    all
}

fn row(theta_i: f64, theta_o: f64, azimuth: f64, values: Vec<f64>) -> Row {
    Row {
        theta_i_deg: theta_i,
        phi_i_deg: 0.0,
        theta_o_deg: theta_o,
        phi_o_deg: azimuth,
        brdf_per_sr: values,
    }
}

/// Truth: the table of two wavelengths with the same values, which is evaluated through lists of rows; of one wavelength it is summed at once, in the plane of incidence by two angles. Tolerance 1e-9: rounding.
#[test]
fn a_table_of_one_wavelength_is_that_of_two() {
    let f = ggx(0.8, 0.2, 0.2, true, 0.05);
    for azimuths in [vec![0.0, 180.0], (0..13).map(|k| 15.0 * f64::from(k)).collect()] {
        let rows = |wavelengths: usize| -> Vec<Row> {
            let mut all = Vec::new();
            for theta_i in [5.0, 25.0, 45.0, 65.0] {
                for azimuth in &azimuths {
                    for k in 0..=16 {
                        let theta_o = 5.0 * f64::from(k);
                        if k == 0 && *azimuth > 0.0 {
                            continue;
                        }
                        let value = f(direction(theta_i, 0.0), direction(theta_o, *azimuth));
                        all.push(row(theta_i, theta_o, *azimuth, vec![value; wavelengths]));
                    }
                }
            }
            all
        };
        let one = brdf_table::material("one", &[500.0], &rows(1), None).unwrap();
        let two = brdf_table::material("two", &[500.0, 600.0], &rows(2), None).unwrap();
        for (i, o) in geometries(3000, 85.0, 7) {
            let (a, b) = (one.brdf(500.0, i, o), two.brdf(500.0, i, o));
            assert!((a / b - 1.0).abs() < 1e-9, "{i} {o}: {a} {b}");
            assert_eq!(one.covers(i, o), two.covers(i, o));
        }
    }
}

/// Truth: the laws that were fitted to the same measurements (`materials/gallery`), off the plane of incidence of those that have only it. Tolerance: both state 95 % intervals, which need not be independent:
/// 95 % inside both together. All seven real tables load as they come, and are reciprocal to rounding.
#[test]
fn real_tables_agree_with_their_laws() {
    let tables = [
        ("starlink_chassis_brdf_532nm.csv", 532.0, Some("starlink_chassis.toml")),
        ("starlink_solar_array_brdf_532nm.csv", 532.0, Some("starlink_solar_array.toml")),
        ("fred_zemax/AnoBlackEC1onAlum.fred.txt", 650.0, Some("anoblack_ec1.toml")),
        ("fred_zemax/AnoBlackEC1onAlum_fullAz.fred.txt", 650.0, Some("anoblack_ec1.toml")),
        ("fred_zemax/AnoBlackEC1onAlum.zemax.bsdf", 650.0, Some("anoblack_ec1.toml")),
        ("fred_zemax/BrownVinyl.zemax.bsdf", 550.0, None),
    ];
    let gallery = Path::new(env!("CARGO_MANIFEST_DIR")).join("gallery");
    for (file, nm, law) in tables {
        let Some(path) = shared(&format!("real/{file}")) else {
            return skip("real_tables_agree_with_their_laws", "no shared/real beside the checkout");
        };
        let content = std::fs::read(&path).unwrap();
        let (wavelengths, rows) = brdf_table::read(&path, content, Some(nm)).unwrap();
        let table = brdf_table::material(file, &wavelengths, &rows, None).unwrap();
        let law = law.map(|law| look::read(gallery.join(law).to_str().unwrap(), nm).unwrap());
        let (mut inside, mut all, mut halves) = (0, 0, Vec::new());
        for (i, o) in geometries(1500, 70.0, 11) {
            let (there, back) = (table.brdf(nm, i, o), table.brdf(nm, o, i));
            assert!(there > 0.0 && (there / back - 1.0).abs() < 1e-9, "{file}: {there} {back}");
            let Some(law) = &law else { continue };
            let half = table.ln_doubt(i, o).unwrap().hypot(law.ln_doubt(i, o).unwrap());
            halves.push(half);
            all += 1;
            inside += i32::from((there / law.brdf(nm, i, o)).ln().abs() <= half);
        }
        halves.sort_by(f64::total_cmp);
        if all > 0 {
            println!(
                "{file}: {inside} of {all} inside, half-width {:.2}",
                halves[all as usize / 2]
            );
            assert!(100 * inside >= 95 * all, "{file}: {inside} of {all}");
        }
    }
}

/// Truth: a Beckmann lobe's closed form, put into the cells of a MERL file as the database's own reader looks them up (synthetic): its middle stands for a cell. Tolerance 3 %, at a roughness of 0.3: the file's cells, and
/// the table between the directions that it is read at.
#[test]
fn a_merl_file_is_a_table() {
    let f = beckmann(1.0, 0.3, 0.05);
    let cells = [90, 90, 180];
    let mut stored = Vec::with_capacity(3 * 90 * 90 * 180);
    for colour in 0..3 {
        for h in 0..90 {
            for d in 0..90 {
                for p in 0..180 {
                    let tilt = ((f64::from(h) + 0.5) / 90.0).powi(2) * 90.0;
                    let [angle, azimuth] = [d, p].map(|k| f64::from(k) + 0.5);
                    // The light about the bisector, turned with it by its tilt about y.
                    let about = direction(angle, azimuth);
                    let bisector = direction(tilt, 0.0);
                    let along = DVec3::new(bisector.z, 0.0, -bisector.x);
                    let i = about.x * along + about.y * DVec3::Y + about.z * bisector;
                    let o = 2.0 * i.dot(bisector) * bisector - i;
                    let scale = [1500.0, 1500.0 / 1.15, 1500.0 / 1.66][colour];
                    let above = i.z > 0.0 && o.z > 0.0;
                    stored.push(if above { scale * (1.0 + colour as f64) * f(i, o) } else { -1.0 });
                }
            }
        }
    }
    let bytes = MerlBrdf { cells, stored }.to_bytes();
    assert_eq!(Exchange::of(&bytes), Some(Exchange::Merl));
    let path = Path::new("made.binary");
    let samples = exchange::read_bytes(path, &bytes, Exchange::Merl, None).unwrap();
    assert_eq!(samples.wavelength_nm, [464.0, 549.0, 611.0]);
    assert!(samples.meta["wavelengths_are"].as_str().unwrap().contains("colours"));
    let mut worst = 0.0_f64;
    for row in &samples.rows {
        let (i, o) = row.directions();
        if o.z > 0.2 && f(i, o) > 1e-3 {
            for (k, value) in row.brdf_per_sr.iter().enumerate() {
                worst = worst.max((value / ((3.0 - k as f64) * f(i, o)) - 1.0).abs());
            }
        }
    }
    assert!(worst < 0.03 && samples.rows.len() > 1000, "{worst} of {}", samples.rows.len());
    // One of the colours, or none of that wavelength.
    let green = exchange::read_bytes(path, &bytes, Exchange::Merl, Some(549.0)).unwrap();
    assert_eq!(green.rows[5].brdf_per_sr, [samples.rows[5].brdf_per_sr[1]]);
    let error = exchange::read_bytes(path, &bytes, Exchange::Merl, Some(500.0)).unwrap_err();
    assert!(error.to_string().contains("464 nm, 549 nm, 611 nm"), "{error}");
    // Its directions are a grid about the mirrored ray, as Zemax wants it.
    exchange::to_zemax(&green, 0).unwrap();
}

/// Truth: a Lambert surface that is brighter in one azimuth of the light, by hand (synthetic).
#[test]
fn a_utia_file_is_a_table() {
    let mut value_per_sr = Vec::new();
    for colour in 0..3 {
        for light in 0..utia::ELEVATIONS * utia::AZIMUTHS {
            for _ in 0..utia::ELEVATIONS * utia::AZIMUTHS {
                let bright = if light / utia::AZIMUTHS == 3 && light % utia::AZIMUTHS == 12 {
                    2.0
                } else {
                    1.0
                };
                value_per_sr.push(0.1 * bright * (1.0 + f64::from(colour)));
            }
        }
    }
    let bytes = UtiaBrdf { value_per_sr }.to_bytes();
    assert_eq!(Exchange::of(&bytes), Some(Exchange::Utia));
    let samples = exchange::read_bytes(Path::new("m.bin"), &bytes, Exchange::Utia, None).unwrap();
    assert_eq!(samples.rows.len(), (1 + 5 * 48) * (1 + 5 * 48));
    for row in &samples.rows {
        let bright = if row.theta_i_deg == 45.0 && row.phi_i_deg == 90.0 { 2.0 } else { 1.0 };
        for (value, blue_first) in row.brdf_per_sr.iter().zip([3.0, 2.0, 1.0]) {
            assert!((value - 0.1 * bright * blue_first).abs() < 1e-15, "{row:?}");
        }
    }
}

/// Truth: what was written: a metal's closed form at the nodes of the file. Tolerance 1e-6 relative, as promised for what is written: values stand as f32, and so do the densities by which the directions are found.
#[test]
fn rgl_files_hold_what_was_written() {
    let lobe = Lobe::isotropic(Distribution::Ggx, 0.3, Masking::Separable).unwrap();
    let grey = Spectrum::constant(0.9, 300.0, 1240.0).unwrap();
    let metal = Material::microfacet("metal", lobe, Fresnel::constant(grey).unwrap());
    let options = measured::WriteOptions::at(vec![500.0, 700.0]);
    let bytes = measured::write(&metal, &options).unwrap().to_bytes().unwrap();
    assert_eq!(Exchange::of(&bytes), Some(Exchange::Rgl));
    let path = Path::new("made.bsdf");
    let samples = exchange::read_bytes(path, &bytes, Exchange::Rgl, None).unwrap();
    assert_eq!(samples.wavelength_nm, [500.0, 700.0]);
    let mut off: Vec<f64> = Vec::new();
    for row in samples.rows.iter().filter(|r| r.theta_i_deg < 80.0 && r.theta_o_deg < 80.0) {
        let (i, o) = row.directions();
        off.push((row.brdf_per_sr[1] / metal.brdf(700.0, i, o) - 1.0).abs());
    }
    off.sort_by(f64::total_cmp);
    let (median, most) = (off[off.len() / 2], off[off.len() - 1]);
    println!("{} nodes: median {median:.1e}, largest {most:.1e}", off.len());
    assert!(off.len() > 10_000 && median < 1e-6 && most < 1e-5, "{median:.1e} {most:.1e}");
}

/// Truth: the values in the file, which brukeropus 1.4.3 (J. Duran) reads from it as well; made after the layout (synthetic).
#[test]
fn spectra_of_opus_are_read() {
    let path = fixture("fuzz/opus/two.0");
    let spectrum = spectra::read(&path).unwrap();
    // 12,000 to 7,000 cm⁻¹ in steps of 1,000.
    for (k, nm) in spectrum.nm.iter().enumerate() {
        assert!((nm - 1e7 / (12_000.0 - 1_000.0 * k as f64)).abs() < 1e-9, "{nm}");
    }
    let truth = [0.1, 0.2, 0.3, 0.3, 0.2, 0.1];
    assert!(spectrum.y.iter().zip(truth).all(|(y, t): (&f64, f64)| (y - t).abs() < 1e-7));
    let error = sunglint_materials::read::samples(&path, None).unwrap_err().to_string();
    assert!(error.contains("ingest.toml"), "{error}");
}
