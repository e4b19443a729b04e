//! Scenes whose samples are single observations (`[times] table`), against the same places as an orbit or a table of positions, and closed forms.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use glam::DVec3;
use hifitime::Unit;
use std::fmt::Write as _;
use std::path::Path;
use sunglint_formats::time::{format_utc, parse_utc};
use sunglint_simulator::light::engine::Switches;
use sunglint_simulator::pass::{Overrides, Pass, PassFile, Place, Simulation};

/// The elements of the ISS that many texts print.
const ISS: [&str; 2] = [
    "1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927",
    "2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537",
];

fn scene(folder: &Path, orbit: &str, times: &str, attitude: &str) -> Result<Pass, String> {
    let text = format!(
        "tolerance = 0.001\n[target]\nbuilt_in = \"box_wing\"\n{orbit}\n[attitude]\nlaw = \"{attitude}\"\n[station]\nname = \"ufo\"\n[times]\n{times}\n"
    );
    let file = PassFile::parse(folder.join("p.toml"), &text).map_err(|e| e.to_string())?;
    let mut pass = file.resolve(Overrides::default()).map_err(|e| e.to_string())?;
    // What is tested is where things are.
    pass.effects = Switches::OFF;
    Ok(pass)
}

fn simulate(pass: &Pass) -> Simulation<'_> {
    pass.simulate(&|_| ()).unwrap()
}

/// A table of what places say: each line is made by `row`.
fn table(places: &[Place], header: &str, row: impl Fn(&Place) -> String) -> String {
    let mut text = format!("# synthetic\ntime_utc,{header}\n");
    for place in places {
        writeln!(text, "{},{}", format_utc(place.geometry.epoch, 9), row(place)).unwrap();
    }
    text
}

/// States of an orbit about the oblate Earth, GCRS, every second from `from`: Runge–Kutta in steps of 50 ms, km and km/s.
fn flight(from: &Place, seconds: usize) -> Vec<String> {
    let pull = |p: DVec3| {
        let (r2, mu, k) = (p.length_squared(), 3.986_004_418e14, 1.5 * 1.082_635_854e-3);
        let bulge = k * 6_378_137.0_f64.powi(2) / r2;
        let s2 = 5.0 * p.z * p.z / r2;
        -mu / r2 / r2.sqrt() * p * (DVec3::ONE + bulge * DVec3::new(1.0 - s2, 1.0 - s2, 3.0 - s2))
    };
    let (mut p, mut v) = (from.geometry.target.position_m, from.geometry.target.velocity_m_s);
    let mut states = Vec::new();
    for _ in 0..=seconds {
        let (r, w) = (p / 1e3, v / 1e3);
        states.push(format!(
            "{:.12},{:.12},{:.12},{:.15},{:.15},{:.15}",
            r.x, r.y, r.z, w.x, w.y, w.z
        ));
        for _ in 0..20 {
            let h = 0.05;
            let (k1, l1) = (v, pull(p));
            let (k2, l2) = (v + 0.5 * h * l1, pull(p + 0.5 * h * k1));
            let (k3, l3) = (v + 0.5 * h * l2, pull(p + 0.5 * h * k2));
            let (k4, l4) = (v + h * l3, pull(p + h * k3));
            p += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
            v += h / 6.0 * (l1 + 2.0 * l2 + 2.0 * l3 + l4);
        }
    }
    states
}

/// Relative difference of all rates above the horizon, and the largest.
fn worst(a: &Simulation<'_>, b: &Simulation<'_>) -> f64 {
    let mut worst = 0.0_f64;
    assert_eq!(a.places.len(), b.places.len());
    for (one, other) in a.channels.iter().zip(&b.channels) {
        for (x, y) in one.rate_hz.iter().zip(&other.rate_hz) {
            assert_eq!(x.is_nan(), y.is_nan());
            if *x > 0.0 {
                worst = worst.max((y / x - 1.0).abs());
            }
        }
    }
    worst
}

fn by_elements(folder: &Path, times: &str) -> Pass {
    let orbit = format!("[orbit]\nlines = [\"{}\", \"{}\"]", ISS[0], ISS[1]);
    scene(folder, &orbit, times, "orbit").unwrap()
}

const EVENING: &str = "from = 2008-09-21T18:46:00Z\nto = 2008-09-21T18:51:00Z\nstep_s = 15";

/// Truth: an ephemeris of the same places, the demand being 1e-9. Rates of a body with edges and gloss follow the geometry, and the attitude the velocity.
#[test]
fn rows_equal_an_ephemeris() {
    let folder = tempfile::tempdir().unwrap();
    // An ephemeris needs rows before the light's emission.
    let start = by_elements(folder.path(), "from = 2008-09-21T18:45:00Z");
    let states = flight(&simulate(&start).places[0], 420);
    let header = "time_utc,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s";
    let begin = parse_utc("2008-09-21T18:45:00Z").unwrap();
    let write = |name: &str, seconds: &[usize]| {
        let mut text = format!("# synthetic\n{header}\n");
        for s in seconds {
            let time = format_utc(begin + *s as f64 * Unit::Second, 0);
            writeln!(text, "{time},{}", states[*s]).unwrap();
        }
        std::fs::write(folder.path().join(name), text).unwrap();
    };
    write("eph.csv", &(0..=420).collect::<Vec<_>>());
    write("rows.csv", &(60..=360).step_by(15).collect::<Vec<_>>());
    let ephemeris = "[ephemeris]\nfile = \"eph.csv\"";
    let ephemeris = scene(folder.path(), ephemeris, EVENING, "orbit").unwrap();
    let ephemeris = simulate(&ephemeris);
    let rows = scene(folder.path(), "", "table = \"rows.csv\"", "orbit").unwrap();
    let rows = simulate(&rows);
    assert!(worst(&ephemeris, &rows) < 1e-9, "{:e}", worst(&ephemeris, &rows));
    // The exposures' means move along the orbit too: 0.1 s.
    let mean = |s: &Simulation<'_>| {
        let rates = |s: &Simulation<'_>| {
            let n = (s.places.len(), s.channels.len());
            ndarray::Array2::from_shape_fn(n, |(i, c)| s.channels[c].rate_hz[i])
        };
        s.exposure_means(&rates, &|_| ()).unwrap()
    };
    let (a, b) = (mean(&ephemeris), mean(&rows));
    assert_eq!(b.beyond, 0);
    for (x, y) in a.values.iter().zip(&b.values).filter(|(x, _)| **x > 0.0) {
        assert!((y / x - 1.0).abs() < 1e-8, "{x} {y}");
    }
}

/// Truth: the orbit by whose geometry the rows were made. Directions and ranges lead back to the same light, at the station and at another site, and so do heights.
#[test]
fn directions_lead_back_to_the_place() {
    let folder = tempfile::tempdir().unwrap();
    let pass = by_elements(folder.path(), EVENING);
    let flown = simulate(&pass);
    let velocity = |p: &Place| {
        let v = p.geometry.target.velocity_m_s / 1e3;
        format!("{:.15},{:.15},{:.15}", v.x, v.y, v.z)
    };
    let look = |p: &Place| {
        let h = p.geometry.horizontal;
        format!("{:.15},{:.15}", h.azimuth_deg(), h.altitude_deg())
    };
    let header = "azimuth_deg,altitude_deg,range_km,vx_km_s,vy_km_s,vz_km_s";
    let by_range =
        |p: &Place| format!("{},{:.15},{}", look(p), p.geometry.range_m / 1e3, velocity(p));
    std::fs::write(folder.path().join("a.csv"), table(&flown.places, header, by_range)).unwrap();
    let rows = scene(folder.path(), "", "table = \"a.csv\"", "orbit").unwrap();
    let found = simulate(&rows);
    for (a, b) in flown.places.iter().zip(&found.places) {
        let off = (a.geometry.target.position_m - b.geometry.target.position_m).length();
        assert!(off < 1e-3, "{off} m");
        // The velocity is that of the emission, 2 ms before.
        assert!((a.geometry.horizontal.separation_deg(b.geometry.horizontal)) < 1e-8);
    }
    assert!(worst(&flown, &found) < 1e-6, "{:e}", worst(&flown, &found));
    // The place over the ground is the Geometry's own (`ephemeris` tests it against SOFA's conversions).
    let frames = |p: &Place| {
        let epoch = p.geometry.epoch;
        sunglint_radiometry::sky::SkyFrame::new(epoch, pass.orientation()).unwrap()
    };
    let by_height = |p: &Place| {
        let height = p.geometry.height_m(&frames(p)).unwrap() / 1e3;
        format!("{},{height:.12},{}", look(p), velocity(p))
    };
    let header = "azimuth_deg,altitude_deg,height_km,vx_km_s,vy_km_s,vz_km_s";
    let up: Vec<Place> = flown
        .places
        .iter()
        .copied()
        .filter(|p| p.geometry.horizontal.altitude_deg() > 5.0)
        .collect();
    assert!(up.len() > 5);
    std::fs::write(folder.path().join("h.csv"), table(&up, header, by_height)).unwrap();
    let rows = scene(folder.path(), "", "table = \"h.csv\"", "orbit").unwrap();
    for (a, b) in up.iter().zip(&simulate(&rows).places) {
        // The ground turns by 1 m in the light time of 2 ms; along a line at 5° that makes a tenth of it in height and 11 m in range.
        let off = (a.geometry.range_m - b.geometry.range_m).abs();
        assert!(off < 15.0, "{off} m");
    }
}

/// Truth by hand: overhead the range is the height less the station's; and a site of the row's own takes the place of the station's.
#[test]
fn overhead_the_range_is_the_height() {
    let folder = tempfile::tempdir().unwrap();
    let text = "# synthetic\nmjd_utc,altitude_deg,azimuth_deg,height_km,site_lat_deg,site_lon_deg,site_height_m\n\
                59000.1,90,0,550,-33.5,18.25,200\n59000.1,90,10,1200,47,8,0\n58000.9,90,0,36000,0,-70,5000\n";
    std::fs::write(folder.path().join("o.csv"), text).unwrap();
    let pass = scene(folder.path(), "", "table = \"o.csv\"", "yaw_steering").unwrap();
    let simulation = simulate(&pass);
    for (place, range_m) in simulation.places.iter().zip([549_800.0, 1_200_000.0, 35_995_000.0]) {
        // Aberration by the site's 400 m/s leans the line by 0.3″: 1e-12 of the range.
        assert!((place.geometry.range_m - range_m).abs() < 1e-3, "{}", place.geometry.range_m);
        assert!(place.geometry.zenith_deg() < 1e-6);
    }
    assert!(pass.warnings.iter().any(|w| w.contains("no velocities")), "{:?}", pass.warnings);
    // Without velocities an exposure has no beginning: the middle stands for it.
    let none = |s: &Simulation<'_>| ndarray::Array2::zeros((s.places.len(), 1));
    assert_eq!(simulation.exposure_means(&none, &|_| ()).unwrap().beyond, 3);
    // Of a table 1 % where nothing is said, 0.1 % otherwise.
    let orbit = format!("[orbit]\nlines = [\"{}\", \"{}\"]", ISS[0], ISS[1]);
    let moment = "from = 2008-09-21T18:46:00Z";
    for (orbit, times, tolerance) in
        [("", "table = \"o.csv\"", 0.01), (orbit.as_str(), moment, 0.001)]
    {
        let text = format!(
            "[target]\nbuilt_in = \"cube\"\n{orbit}\n[attitude]\nlaw = \"yaw_steering\"\n[station]\nname = \"ufo\"\n[times]\n{times}\n"
        );
        let file = PassFile::parse(folder.path().join("d.toml"), &text).unwrap();
        assert_eq!(file.resolve(Overrides::default()).unwrap().tolerance, tolerance);
    }
    let along = scene(folder.path(), "", "table = \"o.csv\"", "orbit").unwrap();
    let error = along.simulate(&|_| ()).unwrap_err();
    assert!(error.to_string().contains("attitude"), "{error}");
}

/// Elements by catalogue number, in any order of rows: the same as a pass of each object.
#[test]
fn elements_by_number() {
    let folder = tempfile::tempdir().unwrap();
    let catalogue = format!(
        "{}\n{}\n1 00900U 64063C   08264.50000000  .00000100  00000-0  10000-3 0  9995\n2 00900  90.1500  30.0000 0027000 100.0000 260.0000 13.72000000200000\n",
        ISS[0], ISS[1]
    );
    let catalogue: String = catalogue.lines().map(|l| checked(l) + "\n").collect();
    std::fs::write(folder.path().join("c.tle"), catalogue).unwrap();
    let moments = ["2008-09-21T18:50:00Z", "2008-09-21T18:47:00Z", "2008-09-21T18:47:00Z"];
    let ids = [25544, 900, 25544];
    let mut text = "# synthetic\ntime_utc,norad_id\n".to_owned();
    for (time, id) in moments.iter().zip(ids) {
        writeln!(text, "{time},{id}").unwrap();
    }
    std::fs::write(folder.path().join("t.csv"), text).unwrap();
    let orbit = "[orbit]\ntle = \"c.tle\"";
    let pass = scene(folder.path(), orbit, "table = \"t.csv\"", "orbit").unwrap();
    let found = simulate(&pass);
    for (i, (time, id)) in moments.iter().zip(ids).enumerate() {
        let orbit = format!("{orbit}\nnorad_id = {id}");
        let alone = scene(folder.path(), &orbit, &format!("from = {time}"), "orbit").unwrap();
        let alone = simulate(&alone);
        let [a, b] = [&alone.places[0], &found.places[i]].map(|p| p.geometry.target.position_m);
        assert!((a - b).length() < 1e-3, "{id}");
        let [a, b] = [alone.magnitudes[[0, 2]], found.magnitudes[[i, 2]]];
        assert!(a == b || (a - b).abs() < 1e-6 || (a.is_nan() && b.is_nan()), "{a} {b}");
    }
    let missing = text_with(&folder, "time_utc,norad_id\n2008-09-21T18:50:00Z,123\n");
    let error = scene(folder.path(), orbit, &missing, "orbit").unwrap_err();
    assert!(error.contains("123: no elements") && error.contains("row 1"), "{error}");
}

/// A line of elements with its check digit.
fn checked(line: &str) -> String {
    let body = &line[..68];
    let sum: u32 =
        body.chars().map(|c| if c == '-' { 1 } else { c.to_digit(10).unwrap_or(0) }).sum();
    format!("{body}{}", sum % 10)
}

fn text_with(folder: &tempfile::TempDir, text: &str) -> String {
    let name = format!("bad{}.csv", text.len());
    std::fs::write(folder.path().join(&name), format!("# synthetic\n{text}")).unwrap();
    format!("table = \"{name}\"")
}

/// Truth: the range as the table has it. A table often holds range and height; the range is used, and it is said.
#[test]
fn ranges_come_before_heights() {
    let folder = tempfile::tempdir().unwrap();
    let text = "# synthetic\ntime_utc,azimuth_deg,altitude_deg,height_km,range_km\n2020-03-01T18:00:00Z,200,40,550,800\n";
    std::fs::write(folder.path().join("o.csv"), text).unwrap();
    let pass = scene(folder.path(), "", "table = \"o.csv\"", "yaw_steering").unwrap();
    let range_m = simulate(&pass).places[0].geometry.range_m;
    assert!((range_m - 800_000.0).abs() < 1e-3, "{range_m}");
    let said = |w: &String| w.contains("range_km is used, height_km is not");
    assert!(pass.warnings.iter().any(said), "{:?}", pass.warnings);
}

#[test]
fn tables_that_say_no_place_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let cases = [
        ("time_utc\n2020-01-01T00:00:00Z\n", "where the target is"),
        ("time_utc,altitude_deg,azimuth_deg,range_km\n", "0 rows"),
        ("time_utc,altitude_deg,azimuth_deg\n2020-01-01T00:00:00Z,40,20\n", "range_km"),
        ("time_utc,altitude_deg,range_km\n2020-01-01T00:00:00Z,40,800\n", "azimuth_deg"),
        ("jd,altitude_deg,azimuth_deg,range_km\n2459000.5,40,20,900\n", "jd_utc"),
        ("time_utc,altitude_deg,azimuth_deg,range_km\n2020-01-01T00:00:00Z,140,20,900\n", "row 1"),
        ("time_utc,altitude_deg,azimuth_deg,range_km\n2020-01-01T00:00:00Z,,20,900\n", "row 1"),
        (
            "time_utc,altitude_deg,azimuth_deg,height_km\n2020-01-01T00:00:00Z,40,20,0.1\n",
            "distance",
        ),
        ("time_utc,x_km,y_km\n2020-01-01T00:00:00Z,7000,0\n", "z_km"),
        ("time_utc,x_km,y_km,z_km\n2020-01-01T00:00:00Z,700,0,0\n", "outside the Earth"),
        ("time_utc,x_km,y_km,z_km,site_lat_deg\n2020-01-01T00:00:00Z,7000,0,0,4\n", "site_lon_deg"),
        ("time_utc,x_km,y_km,z_km,altitude_deg\n2020-01-01T00:00:00Z,7000,0,0,4\n", "one of them"),
        ("time_utc,x_km,y_km,z_km,exposure_s\n2020-01-01T00:00:00Z,7000,0,0,0\n", "exposure"),
    ];
    for (text, expected) in cases {
        let error = scene(folder.path(), "", &text_with(&folder, text), "yaw_steering").err();
        let error = error.unwrap_or_default();
        assert!(error.contains(expected), "{text}: {error}");
    }
    let good = text_with(&folder, "time_utc,x_km,y_km,z_km\n2020-01-01T00:00:00Z,7000,0,0\n");
    let both = format!("[orbit]\nlines = [\"{}\", \"{}\"]", ISS[0], ISS[1]);
    let error = scene(folder.path(), &both, &good, "yaw_steering").unwrap_err();
    assert!(error.contains("no orbit beside"), "{error}");
    let stepped = format!("{good}\nstep_s = 3");
    let error = scene(folder.path(), "", &stepped, "yaw_steering").unwrap_err();
    assert!(error.contains("either table"), "{error}");
}
