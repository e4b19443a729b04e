//! Attitudes as people write them.

#![allow(clippy::unwrap_used, reason = "a test says what it expects")]

use glam::{DQuat, DVec3};
use hifitime::Unit;
use serde::Deserialize;
use std::path::PathBuf;
use sunglint_ephemeris::orbit::State;
use sunglint_formats::time::parse_utc;
use sunglint_formats::toml::Document;
use sunglint_formats::{FileError, Table, ecsv};
use sunglint_simulator::attitude::file::{AttitudeFile, attitude};
use sunglint_simulator::attitude::{Attitude, Moment};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Pass {
    attitude: AttitudeFile,
}

const TABLE: &str = "# %ECSV 1.0\n# ---\n# datatype:\n# - {name: time_utc, datatype: string}\n# - {name: q_w, datatype: float64}\n# - {name: q_x, datatype: float64}\n# - {name: q_y, datatype: float64}\n# - {name: q_z, datatype: float64}\n# schema: astropy-2.0\ntime_utc q_w q_x q_y q_z\n2026-03-01T20:00:00Z 1 0 0 0\n2026-03-01T20:00:10Z 0.7071068 0 0 0.7071068\n";

fn table(name: &str) -> Result<(Table, PathBuf), FileError> {
    let path = PathBuf::from(name);
    match name {
        "good.ecsv" => Ok((ecsv::read_str(&path, TABLE)?, path)),
        "bad.ecsv" => Ok((ecsv::read_str(&path, &TABLE.replace("20:00:10", "19:00:10"))?, path)),
        "late.ecsv" => Ok((ecsv::read_str(&path, &TABLE.replace("20:00:10", "20:00:99"))?, path)),
        _ => Err(FileError::io("read", &path, std::io::ErrorKind::NotFound.into())),
    }
}

fn read(text: &str) -> Result<Attitude, FileError> {
    let document = Document::new("pass.toml", format!("[attitude]\n{text}"))?;
    let pass: Pass = document.parse()?;
    attitude(&document, "attitude", &pass.attitude, &mut table)
}

/// Over the equator at x, flying towards y, the Sun at z; so many seconds after the epoch of the examples.
fn moment(seconds: f64) -> Moment {
    let target = State { position_m: DVec3::X * 7e6, velocity_m_s: DVec3::Y * 7.5e3 };
    let epoch = parse_utc("2026-03-01T20:00:00Z").unwrap() + seconds * Unit::Second;
    Moment { epoch, target, to_sun: DVec3::Z }
}

/// Truth: by hand: where an axis of the body points in each law of the module's example.
#[test]
fn every_law_is_read() {
    let epoch = "epoch_utc = 2026-03-01T20:00:00Z";
    let h = 0.5_f64.sqrt();
    for (text, seconds, axis, points_at) in [
        ("law = \"inertial\"\nbody_to_gcrs = [1, 0, 0, 0]".to_owned(), 9.0, DVec3::X, DVec3::X),
        ("law = \"inertial\"\neuler_zyx_deg = [90, 0, 0]".to_owned(), 9.0, DVec3::X, DVec3::Y),
        // w first: half a turn about z.
        ("law = \"inertial\"\nbody_to_gcrs = [0, 0, 0, 1]".to_owned(), 9.0, DVec3::X, -DVec3::X),
        (
            format!("law = \"spin\"\naxis_gcrs = [0, 0, 1]\nbody_to_gcrs = [1, 0, 0, 0]\nperiod_s = 4\n{epoch}"),
            1.0, DVec3::X, DVec3::Y,
        ),
        (
            format!("law = \"spin\"\naxis_body = [0, 0, 1]\nbody_to_gcrs = [1, 0, 0, 0]\nrate_rpm = -15\n{epoch}"),
            1.0, DVec3::X, -DVec3::Y,
        ),
        (
            format!("law = \"spin\"\naxis_body = [0, 0, 1]\naxis_ra_dec_deg = [90, 0]\nphase_deg = 30\nrate_deg_s = 3\n{epoch}"),
            7.0, DVec3::Z, DVec3::Y,
        ),
        (
            format!("law = \"tumble\"\ninertia_kg_m2 = [[2, 0, 0], [0, 3, 0], [0, 0, 4]]\nomega_body_deg_s = [0, 0, 90]\nbody_to_gcrs = [1, 0, 0, 0]\n{epoch}"),
            1.0, DVec3::X, DVec3::Y,
        ),
        (
            format!("law = \"tumble\"\nprincipal_moments_kg_m2 = [2, 3, 4]\nprincipal_to_body = [1, 0, 0, 0]\nomega_gcrs_deg_s = [0, 0, 90]\neuler_zyx_deg = [90, 0, 0]\n{epoch}"),
            1.0, DVec3::X, -DVec3::X,
        ),
        ("law = \"orbit\"".to_owned(), 0.0, DVec3::Z, -DVec3::X),
        ("law = \"orbit\"\neuler_zyx_deg = [0, 0, 90]".to_owned(), 0.0, DVec3::Y, -DVec3::X),
        (
            "law = \"pointing\"\nfirst_axis_body = [1, 0, 0]\nfirst = \"velocity\"\nsecond_axis_body = [0, 0, 1]\nsecond = \"north\"".to_owned(),
            0.0, DVec3::Z, DVec3::Z,
        ),
        (
            "law = \"sun\"\nfirst_axis_body = [0, 1, 0]\nsecond_axis_body = [0, 1, 1]\nsecond = \"nadir\"".to_owned(),
            0.0, DVec3::new(0.0, h, h), DVec3::new(-h, 0.0, h),
        ),
        ("law = \"yaw_steering\"".to_owned(), 0.0, DVec3::X, DVec3::Z),
        ("law = \"table\"\nfile = \"good.ecsv\"".to_owned(), 5.0, DVec3::X, DVec3::new(h, h, 0.0)),
        ("law = \"table\"\nfile = \"good.ecsv\"\ninterpolation = \"squad\"".to_owned(), 5.0, DVec3::X, DVec3::new(h, h, 0.0)),
    ] {
        let q: DQuat = read(&text).unwrap().body_to_gcrs(&moment(seconds)).unwrap();
        assert!((q * axis - points_at).length() < 1e-7, "{text}: {}", q * axis);
    }
}

/// Each message: the file, the line, the key, what stands there and what should.
/// Truth: by hand. Without a bias z points to the Earth (−x of the GCRS) and x to the Sun (z). Rolled by 30° about its own x, the body has its z 30° off nadir, turned
/// right-handed about the direction to the Sun, from −x towards −y. Tolerance: rounding.
#[test]
fn a_body_that_points_has_a_bias() {
    for law in ["yaw_steering", "pointing"] {
        let axes = match law {
            "pointing" => {
                "first_axis_body = [0, 0, 1]\nfirst = \"nadir\"\nsecond_axis_body = [1, 0, 0]\nsecond = \"sun\"\n"
            }
            _ => "",
        };
        let text = format!("law = \"{law}\"\n{axes}euler_zyx_deg = [0, 0, 30]");
        let at = read(&text).unwrap().body_to_gcrs(&moment(0.0)).unwrap();
        let (x, z) = (at * DVec3::X, at * DVec3::Z);
        assert!(x.distance(DVec3::Z) < 1e-12, "{x}");
        // The right-handed turn about x (the Sun's z) takes −x towards −y.
        let truth = DVec3::new(-(30_f64.to_radians().cos()), -0.5, 0.0);
        assert!(z.distance(truth) < 1e-12, "{z}");
    }
}

#[test]
fn mistakes_are_named() {
    let epoch = "epoch_utc = 2026-03-01T20:00:00Z";
    for (text, expected) in [
        ("law = \"inertial\"".to_owned(), "attitude.body_to_gcrs: found no such key, expected body_to_gcrs or euler_zyx_deg"),
        ("law = \"inertial\"\nbody_to_gcrs = [1, 0, 0, 0.1]".to_owned(), "pass.toml:3: attitude.body_to_gcrs"),
        ("law = \"inertial\"\nbody_to_gcrs = [1, 0, 0, 0]\nperiod_s = 3".to_owned(), "pass.toml:4: attitude.period_s: found 3, expected no period_s: the law inertial uses body_to_gcrs, euler_zyx_deg"),
        ("law = \"inertial\"\nbody_to_gcrs = [1, 0, 0, 0]\neuler_zyx_deg = [0, 0, 0]".to_owned(), "not both"),
        ("law = \"inertal\"".to_owned(), "inertial"),
        ("law = \"spin\"\nperiod = 3".to_owned(), "period_s"),
        (format!("law = \"spin\"\naxis_gcrs = [0, 0, 1]\nbody_to_gcrs = [1, 0, 0, 0]\n{epoch}"), "exactly one of period_s, rate_deg_s and rate_rpm"),
        (format!("law = \"spin\"\naxis_gcrs = [0, 0, 0]\nbody_to_gcrs = [1, 0, 0, 0]\nperiod_s = 3\n{epoch}"), "the spin axis is not finite, or zero"),
        ("law = \"spin\"\naxis_gcrs = [0, 0, 1]\nbody_to_gcrs = [1, 0, 0, 0]\nperiod_s = 3".to_owned(), "epoch_utc, which is required"),
        (format!("law = \"tumble\"\ninertia_kg_m2 = [[1, 0, 0], [0, 1, 0], [0, 0, 3]]\nomega_body_deg_s = [0, 0, 90]\nbody_to_gcrs = [1, 0, 0, 0]\n{epoch}"), "the largest is more than the sum of the others, 2"),
        (format!("law = \"tumble\"\ninertia_kg_m2 = [[2, 0.5, 0], [0, 2, 0], [0, 0, 3]]\nomega_body_deg_s = [0, 0, 90]\nbody_to_gcrs = [1, 0, 0, 0]\n{epoch}"), "not symmetric: row 1, column 2 is 0.5"),
        ("law = \"sun\"\nfirst_axis_body = [0, 0, 1]\nsecond_axis_body = [0, 0, 2]\nsecond = \"nadir\"".to_owned(), "the two axes of the body are parallel"),
        ("law = \"pointing\"\nfirst_axis_body = [0, 0, 1]\nfirst = \"sun\"\nsecond_axis_body = [1, 0, 0]\nsecond = \"sun\"".to_owned(), "both axes point at the Sun"),
        ("law = \"table\"\nfile = \"none.ecsv\"".to_owned(), "pass.toml:3: attitude.file"),
        ("law = \"table\"\nfile = \"bad.ecsv\"".to_owned(), "row 2 of the table, 2026-03-01T19:00:10Z, is not after the row before it"),
        ("law = \"table\"\nfile = \"late.ecsv\"".to_owned(), "late.ecsv: time_utc, row 2"),
    ] {
        let error = read(&text).unwrap_err().to_string();
        assert!(error.contains(expected), "{text}\n{error}");
    }
    let table = read("law = \"table\"\nfile = \"good.ecsv\"").unwrap();
    let error = table.body_to_gcrs(&moment(11.0)).unwrap_err().to_string();
    assert!(error.contains("its table runs from 2026-03-01T20:00:00Z to 2026-03-01T20:00:10Z"));
}

/// Truth: the same table as ECSV, which `every_law_is_read` holds against numbers by hand: half-way between its rows the body has turned by 45° about z.
#[test]
fn a_table_may_be_comma_separated() {
    let folder = std::env::temp_dir().join(format!("sunglint-attitude-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let rows = "# by hand\ntime_utc,q_w,q_x,q_y,q_z\n2026-03-01T20:00:00Z,1,0,0,0\n2026-03-01T20:00:10Z,0.7071068,0,0,0.7071068\n";
    std::fs::write(folder.join("a.csv"), rows).unwrap();
    std::fs::write(folder.join("a.ecsv"), TABLE).unwrap();
    for name in ["a.csv", "a.ecsv"] {
        let law = format!("[attitude]\nlaw = \"table\"\nfile = \"{name}\"\n");
        std::fs::write(folder.join("law.toml"), law).unwrap();
        let attitude = Attitude::read(folder.join("law.toml")).unwrap();
        let turned = attitude.body_to_gcrs(&moment(5.0)).unwrap();
        let truth = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_4);
        assert!(turned.angle_between(truth) < 1e-6, "{name}: {turned}");
    }
    std::fs::remove_dir_all(&folder).unwrap();
}
