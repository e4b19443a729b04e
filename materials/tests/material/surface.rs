//! Real surfaces: several parts through a table of several incidences.

use sunglint_materials::fit::surface::{SurfaceFit, SurfaceOptions, fit_surface};
use sunglint_materials::samples::{Sample, Samples};
use sunglint_numerics::progress::Silent;
use sunglint_testkit::{shared, skip};

fn lumos(path: &std::path::Path) -> Samples {
    let text = std::fs::read_to_string(path).unwrap();
    let rows = text.lines().filter(|l| !l.trim().is_empty() && !l.starts_with('#'));
    let row = |line: &str| {
        let v: Vec<f64> = line.split_whitespace().map(|v| v.parse().unwrap()).collect();
        Sample {
            theta_i_deg: v[0],
            phi_i_deg: v[1],
            theta_o_deg: v[2],
            phi_o_deg: v[3],
            brdf_per_sr: vec![v[4]],
            sigma_per_sr: vec![],
        }
    };
    Samples { wavelength_nm: vec![532.0], rows: rows.map(row).collect(), ..Samples::default() }
}

fn fred(path: &std::path::Path) -> Samples {
    let text = std::fs::read_to_string(path).unwrap();
    let mut at = 0.0;
    let mut rows = Vec::new();
    for line in text.lines() {
        let Ok(v) = line.split_whitespace().map(str::parse).collect::<Result<Vec<f64>, _>>() else {
            continue;
        };
        match v[..] {
            [i, _] => at = i,
            [o, phi, f] => rows.push(Sample {
                theta_i_deg: at,
                phi_i_deg: 180.0,
                theta_o_deg: o,
                phi_o_deg: phi,
                brdf_per_sr: vec![f],
                sigma_per_sr: vec![],
            }),
            _ => {}
        }
    }
    Samples { wavelength_nm: vec![650.0], rows, ..Samples::default() }
}

fn show(name: &str, fit: &SurfaceFit) {
    eprintln!(
        "== {name}: {} rms {:?} outliers {} indep {:.0} doubt {:?}",
        fit.name, fit.rms_ln, fit.outliers, fit.independent_values, fit.doubt
    );
    for i in &fit.incidences {
        eprintln!(
            "  {:5.1}: n {} rms {:.3} H {:.4} cov {:.2} E {:.3} P {:?} albedo {:.3} | {:?}",
            i.theta_i_deg,
            i.values,
            i.rms_ln,
            i.hemispherical_table,
            i.coverage,
            i.hemispherical_ratio,
            i.peak.map(|p| (p.table_per_sr, (p.ratio * 1e3).round() / 1e3)),
            i.albedo,
            i.unseen
        );
    }
    for n in &fit.numbers {
        eprintln!("  {} {:?} {:.4e} {:?} {}", n.name, n.lobe, n.value, n.interval, n.at_bound);
    }
    for t in fit.tried.iter().take(30) {
        eprintln!(
            "    {:40} {:2} rms {:.4} cost {:.4} left {:?}",
            t.recipe, t.parameters, t.rms_ln, t.cost, t.left_out
        );
    }
    eprintln!("  albedo {:?}", fit.albedo);
    for f in &fit.flaws {
        eprintln!("  ! {f}");
    }
    eprintln!("{}", fit.to_toml(name));
}

#[test]
fn dev_real() {
    for (name, path) in [
        ("array", "real/starlink_solar_array_brdf_532nm.csv"),
        ("chassis", "real/starlink_chassis_brdf_532nm.csv"),
        ("ec1", "real/fred_zemax/AnoBlackEC1onAlum.fred.txt"),
        ("aluminium", "real/aluminium_brdf_in_plane.csv"),
    ] {
        if let Ok(only) = std::env::var("ONLY")
            && !only.contains(name)
        {
            continue;
        }
        let Some(path) = shared(path).or_else(|| {
            std::env::var("DEV_SHARED").ok().map(|d| std::path::Path::new(&d).join(path))
        }) else {
            skip("dev_real", "no shared/real beside the checkout");
            return;
        };
        let samples = if name == "ec1" { fred(&path) } else { lumos(&path) };
        let start = std::time::Instant::now();
        let mut options = SurfaceOptions::default();
        options.floor_per_sr = Some(1e-4);
        match fit_surface(&samples, &options, &Silent) {
            Ok(fit) => show(name, &fit),
            Err(e) => eprintln!("{name}: {e}"),
        }
        eprintln!("{name}: {:?}", start.elapsed());
    }
}
