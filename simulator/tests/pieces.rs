//! A pass in pieces, and one of many of the same scene, against the same pass at once and alone.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use std::num::NonZeroUsize;
use sunglint_simulator::pass::{
    Alike, Extras, Overrides, Pass, PassError, PassFile, Simulation, Totals,
};

fn pass(target: &str, times: &str) -> Pass {
    pass_of(&format!("[target]\nbuilt_in = \"{target}\"\n"), times)
}

fn pass_of(target: &str, times: &str) -> Pass {
    scene(target, "247.4627", times)
}

/// A pass whose orbit has another node, degrees.
fn pass_with(target: &str, node: &str, times: &str) -> Pass {
    scene(&format!("[target]\nbuilt_in = \"{target}\"\n"), node, times)
}

fn scene(target: &str, node: &str, times: &str) -> Pass {
    let line = format!("2 25544  51.6416 {node} 0006703 130.5360 325.0288 15.7212539156353");
    let digit = |c: char| c.to_digit(10).unwrap_or(u32::from(c == '-'));
    let line = format!("{line}{}", line.chars().map(digit).sum::<u32>() % 10);
    let text = format!(
        "{target}[orbit]\nlines = [\n\
         \"1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927\",\n\
         \"{line}\"]\n\
         [station]\nname = \"ufo\"\n[times]\n{times}\n\
         [attitude]\nlaw = \"spin\"\naxis_body = [0, 0, 1]\naxis_gcrs = [0.3, 0.5, 0.8]\nperiod_s = 60.0\nepoch_utc = 2008-09-21T18:46:00Z\n"
    );
    PassFile::parse("p.toml", &text).unwrap().resolve(Overrides::default()).unwrap()
}

/// All numbers of some epochs, as bits: NaN is equal to itself.
fn rows(simulation: &Simulation<'_>) -> Vec<Vec<u64>> {
    let row = |i: usize| {
        let place = &simulation.places[i];
        let mut row: Vec<f64> = place.sun_body.to_array().to_vec();
        row.extend(place.observer_body.to_array());
        row.extend([place.sunlit, place.geometry.range_m, simulation.pass.exposure_s[i]]);
        row.push(place.apparent_zenith_deg.unwrap_or(f64::NAN));
        for matrix in [
            &simulation.weights,
            &simulation.errors,
            &simulation.spectra,
            &simulation.magnitudes,
            &simulation.magnitude_errors,
            &simulation.ground_magnitudes,
            &simulation.hinges_deg,
        ] {
            row.extend(matrix.row(i));
        }
        row.extend(simulation.spectra_errors.row(i).iter().map(|e| f64::from(*e)));
        for c in &simulation.channels {
            row.extend([c.rate_hz[i], c.error_hz[i], c.above_air_hz[i], c.uncovered_nm[i]]);
            row.push(c.predicted[i].sigma_hz.unwrap_or(-1.0));
        }
        row.push(f64::from(simulation.flags(i).bits()));
        row.iter().map(|v| v.to_bits()).collect()
    };
    (0..simulation.places.len()).map(row).collect()
}

/// Truth: the same pass at once, to the bit, and the text of its tables. Pieces of 7 and of one, of the sphere's of all and of more; bounces and earthshine between nodes, hinges, a sphere, an entry into the Earth's shadow, times
/// that do not increase.
#[test]
fn pieces_are_the_pass_to_the_bit() {
    let dense = "from = 2008-09-21T18:49:00Z\nto = 2008-09-21T18:49:12Z\nstep_s = 0.2";
    let shadow = "from = 2008-09-21T18:48:00Z\nto = 2008-09-21T18:52:00Z\nstep_s = 5";
    for (target, times) in [
        ("box_wing", dense),
        ("box_with_panels", shadow),
        ("lambert_sphere", dense),
        ("corner", shadow),
    ] {
        let mut pass = pass(target, times);
        if target == "lambert_sphere" {
            pass.times.reverse();
        }
        let whole = pass.simulate(&|_| ()).unwrap();
        assert!(whole.has_light(), "{target}");
        let known = rows(&whole);
        let curve = whole.light_curve("c").to_table().unwrap();
        let geometry = whole.geometry_table("c");
        let all = if target == "lambert_sphere" { &[pass.times.len(), 1000][..] } else { &[] };
        for &epochs in [&[7, 1][..], all].concat().iter() {
            let (mut found, mut counted) = (Vec::new(), 0);
            let bounds = pass
                .simulate_in_pieces(NonZeroUsize::new(epochs).unwrap(), &|_| (), |piece| {
                    assert!(piece.places.len() <= epochs);
                    let times = &pass.times[counted..counted + piece.places.len()];
                    assert_eq!(piece.pass.times, times);
                    counted += times.len();
                    found.extend(rows(piece));
                    // What stands above the rows of a table is the same in all pieces.
                    for (own, all) in [
                        (piece.light_curve("c").to_table().unwrap(), &curve),
                        (piece.geometry_table("c"), &geometry),
                    ] {
                        assert_eq!(own.meta, all.meta);
                        let names = |t: &sunglint_formats::Table| {
                            t.columns.iter().map(|c| c.name.clone()).collect::<Vec<_>>()
                        };
                        assert_eq!(names(&own), names(all));
                    }
                    Ok::<(), PassError>(())
                })
                .unwrap();
            assert_eq!(found, known, "{target} {epochs}");
            assert_eq!(bounds, whole.bounds, "{target} {epochs}");
        }
    }
}

/// Truth: each pass simulated on its own, to the bit. Passes with and without the Earth's light and its shadow, so that not all have the same terms, in two orders.
#[test]
fn passes_of_one_scene_are_the_passes_alone() {
    let spans = [
        "from = 2008-09-21T18:49:00Z\nto = 2008-09-21T18:49:12Z\nstep_s = 2",
        "from = 2008-09-21T18:48:00Z\nto = 2008-09-21T18:52:00Z\nstep_s = 20",
        "from = 2008-09-21T18:46:00Z\nto = 2008-09-21T18:47:00Z\nstep_s = 20",
    ];
    for target in ["box_wing", "lambert_sphere"] {
        let mut passes = spans.map(|times| pass(target, times)).to_vec();
        let other = pass_with(target, "260.1000", spans[1]);
        passes.push(Pass { orbit: other.orbit.clone(), ..passes[1].clone() });
        let alone = |pass: &Pass| rows(&pass.simulate(&|_| ()).unwrap());
        let mut passes: Vec<_> = passes.into_iter().map(|p| (alone(&p), p)).collect();
        for _ in 0..2 {
            let alike = Alike::new(passes[0].1.clone());
            for (alone, pass) in &passes {
                let (orbit, times) = (pass.orbit.clone(), pass.times.clone());
                let found = alike.simulate(orbit, times, pass.exposure_s.clone(), &|_| (), rows);
                assert_eq!(found.unwrap(), *alone, "{target} {}", pass.times[0]);
            }
            passes.reverse();
        }
    }
}

/// Truth: doubt and polarisation of the same pass at once, to the bit; the sums over all samples, by their text.
#[test]
fn pieces_have_the_doubt_and_the_polarisation_of_the_pass() {
    let shadow = "from = 2008-09-21T18:48:00Z\nto = 2008-09-21T18:52:00Z\nstep_s = 5";
    let part = |name: &str, y: f64| {
        format!(
            "[[target.part]]\nname = \"{name}\"\nshape = \"box\"\nsize_m = [1, 2, 1]\nmaterial = \"{name}\"\noffset_m = [0, {y}, 0]\n"
        )
    };
    let material = |name: &str, ln: f64| {
        format!(
            "[[target.material]]\nname = \"{name}\"\nmodel = \"composite\"\nreflectance = 1.0\ndiffuse = {{ reflectance = 0.5 }}\n\
             [target.material.doubt]\npeak_ln = {ln}\nwings_ln = {ln}\ngrazing_ln = {ln}\n"
        )
    };
    let target = [part("a", 0.0), part("b", 3.0), material("a", 0.2), material("b", 0.4)].concat();
    let pass = pass_of(&target, shadow);
    let whole = pass.simulate(&|_| ()).unwrap();
    let known = whole.material_doubt(&|_| ()).unwrap().unwrap();
    let polarised = whole.polarisation(&|_| ()).unwrap();
    assert_eq!((known.each.len(), polarised.unknown.len()), (2, 0));
    assert!(polarised.v.iter().any(|v| v.is_finite()));
    let extras = Extras { material: true, polarisation: true };
    for epochs in [7, 1, 1000] {
        let (mut relative, mut one, mut v, mut error) = (vec![], vec![], vec![], vec![]);
        let mut totals = Totals::new(&pass);
        let epochs = NonZeroUsize::new(epochs).unwrap();
        pass.simulate_in_pieces_with(epochs, extras, &|_| (), |piece| {
            totals.add(piece);
            let (doubt, found) =
                (piece.material.as_ref().unwrap(), piece.polarisation.as_ref().unwrap());
            relative.extend(doubt.relative.clone());
            one.extend(doubt.each[1].v_relative.clone());
            v.extend(found.v.clone());
            error.extend(found.v_error.clone());
            Ok::<(), PassError>(())
        })
        .unwrap();
        let bits = |values: &[f64]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        for (found, known) in [
            (&relative, &known.relative),
            (&one, &known.each[1].v_relative),
            (&v, &polarised.v),
            (&error, &polarised.v_error),
        ] {
            assert_eq!(bits(found), bits(known));
        }
        let all = whole.totals();
        assert_eq!(totals.concerns(), all.concerns());
        assert_eq!(totals.promise(), all.promise());
        assert_eq!(totals.material_error(), known.over_the_pass());
        assert_eq!(totals.stated_error_of_bins(), all.stated_error_of_bins());
        let ends = |t: &Totals<'_>| (t.highest, t.v_above_air, t.v_after_air, t.v_standard);
        assert_eq!(ends(&totals), ends(&all));
    }
}

/// Truth: by hand. What `each` says ends the work, after the pieces before it.
#[test]
fn an_error_of_the_taker_ends_the_work() {
    let pass = pass(
        "lambert_sphere",
        "from = 2008-09-21T18:49:00Z\nto = 2008-09-21T18:49:09Z\nstep_s = 1",
    );
    let mut pieces = 0;
    let ended = pass.simulate_in_pieces(NonZeroUsize::new(4).unwrap(), &|_| (), |_| {
        pieces += 1;
        match pieces {
            2 => Err(PassError::Input { needs: "a disk", found: "a full one".into() }),
            _ => Ok(()),
        }
    });
    assert!(ended.unwrap_err().to_string().contains("a full one"));
    assert_eq!(pieces, 2);
}
