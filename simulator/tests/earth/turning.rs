//! A table turns with the Earth.

use super::truth;
use glam::DVec3;
use std::f64::consts::PI;
use sunglint_simulator::pass::{Overrides, PassFile};

/// The Earth of the scene is a sphere of this radius.
const RADIUS_M: f64 = 6_378_137.0;

/// Truth: the double loop (cells of 0.5°) in axes turned by the sidereal time of 1982, at every second hour of a day over which a body stands still in the GCRS, 20,000 km from the middle of the Earth, over a table
/// whose only bright cell is 30° wide on the equator. Tolerance: 1 % of the largest (the rule over the cap 0.6 %; the pole's precession since J2000, 0.05°, 0.1 %). The light is largest where the longitude of
/// the point below the body is that of the cell: to half of the two hours.
#[test]
fn a_bright_cell_follows_the_earths_rotation() {
    let folder = tempfile::tempdir().unwrap();
    let mut table = String::from("# synthetic: one bright cell\nlat_deg,lon_deg,albedo\n");
    for row in 0..6 {
        for column in 0..12 {
            let (lat, lon) = (-75 + 30 * row, 15 + 30 * column);
            let albedo = if (lat, lon) == (15, 105) { 0.8 } else { 0.0 };
            table.push_str(&format!("{lat},{lon},{albedo}\n"));
        }
    }
    std::fs::write(folder.path().join("cell.csv"), table).unwrap();
    // Toward the Sun of 21 September: near −x of the GCRS.
    let position = 2e7 * DVec3::new(-0.9, 0.3, 0.25).normalize();
    let mut places = String::from("time_utc,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s\n");
    let mut times = String::from("time_utc\n");
    for hour in 0..26 {
        let time = format!("2008-09-{:02}T{:02}:00:00Z", 21 + hour / 24, hour % 24);
        let [x, y, z] = (1e-3 * position).to_array();
        places.push_str(&format!("{time},{x},{y},{z},0,0,0\n"));
        if hour % 2 == 1 {
            times.push_str(&format!("{time}\n"));
        }
    }
    std::fs::write(folder.path().join("still.csv"), places).unwrap();
    std::fs::write(folder.path().join("times.csv"), times).unwrap();
    let text = "target.built_in = \"lambert_sphere\"\nephemeris.file = \"still.csv\"\nstation.name = \"ufo\"\ntimes.file = \"times.csv\"\nair.none = true\n\
        earth = { file = \"cell.csv\", uncertainty = 0.1 }\n";
    let pass = PassFile::parse(folder.path().join("pass.toml"), text).unwrap();
    let pass = pass.resolve(Overrides::default()).unwrap();
    assert_eq!((pass.earth.uncertainty(), pass.earth.grid().unwrap().size()), (0.1, (6, 12)));
    assert!(pass.inputs.iter().any(|input| input.file.ends_with("cell.csv")));
    let simulation = pass.simulate(&|_| ()).unwrap();
    let albedo = |lat: f64, lon: f64| {
        let (lat, lon) = (lat.to_degrees(), lon.to_degrees());
        if (0.0..30.0).contains(&lat) && (90.0..120.0).contains(&lon) { 0.8 } else { 0.0 }
    };
    let (mut found, mut expected, mut away) = (Vec::new(), Vec::new(), Vec::new());
    for (k, place) in simulation.places.iter().enumerate() {
        let globe = place.lighting().earth.unwrap();
        let facing = |(d, e): &(DVec3, f64)| e * d.dot(globe.toward).max(0.0);
        found.push(pass.earth.shines(&globe, 21, 550.0).iter().map(facing).sum::<f64>());
        // 2008-09-21T01:00 is 3185.5417 days after J2000 (JD 2451545.0).
        let days = 2_454_730.5 - 2_451_545.0 + (2 * k + 1) as f64 / 24.0;
        let fixed = truth::fixed_from_gcrs(days);
        let at = fixed * place.geometry.target.position_m;
        let sun = fixed * place.geometry.sun.direction_gcrs;
        let nadir = |d: DVec3| d.dot(-at.normalize()).max(0.0);
        expected.push(truth::shine(at, RADIUS_M, sun, 0.5, &albedo, &nadir));
        let lon = at.y.atan2(at.x) - 105.0_f64.to_radians();
        away.push(((lon + PI).rem_euclid(2.0 * PI) - PI).abs());
    }
    let most = expected.iter().copied().fold(0.0, f64::max);
    assert!(found.len() == 13 && most > 1e-3, "{expected:?}");
    for (found, expected) in found.iter().zip(&expected) {
        assert!((found - expected).abs() < 0.01 * most, "{found} {expected} of {most}");
    }
    let by = |list: &[f64], sign: f64| {
        (0..list.len()).min_by(|a, b| (sign * list[*a]).total_cmp(&(sign * list[*b]))).unwrap()
    };
    // The Sun is not overhead, so the brightest may be the one beside the nearest.
    assert!(by(&found, -1.0).abs_diff(by(&away, 1.0)) <= 1, "{found:?} {away:?}");
    assert!(found.contains(&0.0));
}
