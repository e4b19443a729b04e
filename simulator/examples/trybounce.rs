#![allow(clippy::unwrap_used)]
use glam::DVec3;
use std::time::Instant;
use sunglint_formats::ecsv;
use sunglint_radiometry::spectrum::Spectrum;
use sunglint_simulator::light::bounce::*;
use sunglint_simulator::light::*;
use sunglint_simulator::surface::*;
use sunglint_simulator::target::Target;
fn grey(name: &str, rho: f64) -> Material {
    Material::lambert(name, Spectrum::constant(rho, 300.0, 1240.0).unwrap()).unwrap()
}
fn lobe(name: &str, a: f64, rho: f64) -> Material {
    let l = Lobe::isotropic(Distribution::Beckmann, a, Masking::Separable).unwrap();
    Material::microfacet(
        name,
        l,
        Fresnel::constant(Spectrum::constant(rho, 300.0, 1240.0).unwrap()).unwrap(),
    )
}
fn target(name: &str) -> Target {
    let g = |n: &str| match n {
        "dark" => grey(n, 0.1),
        "red" => grey(n, 0.3),
        "half" => grey(n, 0.5),
        "bright" => grey(n, 0.9),
        "grey80" => grey(n, 0.8),
        "satin" => lobe(n, 0.4, 0.9),
        "shiny" => lobe(n, 0.15, 0.8),
        _ => panic!(),
    };
    let m: [&str; 3] = match name {
        "colours_1" => ["bright", "red", "half"],
        "colours_2" => ["red", "bright", "dark"],
        "colours_3" => ["half", "half", "bright"],
        "satin_floor" => ["satin", "grey80", "grey80"],
        "shiny_wall" => ["half", "shiny", "bright"],
        "all_satin" => ["satin"; 3],
        _ => {
            let mut t = Target::built_in(name).unwrap();
            for k in 0..t.materials.len() {
                let m = &t.materials[k];
                let rho = sunglint_simulator::scenes::grey(&m.spectra()[0]).unwrap();
                let n = m.name.clone();
                let n = n.trim_end_matches("_cell");
                t.materials[k] = match n {
                    "aluminium" => lobe(n, 0.4, rho),
                    "mli" => lobe(n, 0.3, rho),
                    "solar" => lobe(n, 0.15, rho),
                    _ => grey(n, rho),
                };
            }
            return t;
        }
    };
    let mut t = Target::built_in("corner").unwrap();
    for (k, m) in m.iter().enumerate() {
        t.materials.push(g(m));
        t.parts[k].material = t.materials.len() - 1;
    }
    t
}
fn main() {
    let tol: f64 = std::env::args().nth(1).map_or(2e-3, |s| s.parse().unwrap());
    let table =
        ecsv::read_str("b", &std::fs::read_to_string("simulator/scenes/bounce.ecsv").unwrap())
            .unwrap();
    let names = table.text("scene").unwrap();
    let col = |n: &str| table.f64(n).unwrap().to_vec();
    let (s, v) = (["sun_x", "sun_y", "sun_z"].map(col), ["view_x", "view_y", "view_z"].map(col));
    let q = |n: &str| table.quantity(n, "m2 / sr").unwrap().to_vec();
    let (d, b, sg) = (q("direct_m2_sr"), q("bounce_m2_sr"), q("sigma_m2_sr"));
    let mut last = String::new();
    let mut t = Target::default();
    let _ = &t;
    for i in 0..b.len() {
        let name = names[i].clone().unwrap();
        if name != last {
            t = target(&name);
        }
        let scene = Scene::new(&t).unwrap();
        let start = Instant::now();
        let bounce = Bounce::new(&scene, &BounceOptions { tolerance: tol, seed: 1 }).unwrap();
        if name != last {
            println!("{name}: prepare {:.3} s  {:?}", start.elapsed().as_secs_f64(), bounce.need());
        }
        last = name;
        let sun = DVec3::new(s[0][i], s[1][i], s[2][i]);
        let to = DVec3::new(v[0][i], v[1][i], v[2][i]);
        let l = Lighting {
            sun_body: sun,
            sun_radius_rad: 0.0,
            earth: None,
            moon: None,
            view: View::Distant(to),
        };
        let n = bounce.terms().len();
        if n == 0 {
            continue;
        }
        let mut light = bounce.light();
        let (mut w, mut e) = (vec![0.0; n], vec![0.0; n]);
        let mut t0 = f64::MAX;
        for _ in 0..20 {
            w.fill(0.0);
            e.fill(0.0);
            let s = Instant::now();
            light.add(&l, &mut w, &mut e).unwrap();
            t0 = t0.min(s.elapsed().as_secs_f64());
        }
        println!(
            "   {:.6} truth {:.6} off {:+.2e} claimed {:.2e} (of bounce)  off {:+.2e} claimed {:.2e} (of all) sigma {:.1e}  {:.1} us",
            w[0],
            b[i],
            w[0] / b[i] - 1.0,
            e[0] / b[i],
            (w[0] - b[i]) / (d[i] + b[i]),
            e[0] / (d[i] + b[i]),
            sg[i] / (d[i] + b[i]),
            t0 * 1e6
        );
    }
}
