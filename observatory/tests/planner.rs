//! Plans out of passes, as they are read again.

#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use std::path::Path;
use sunglint_formats::time::parse_utc;
use sunglint_observatory::Plan;
use sunglint_observatory::planner::{
    PassOffer, Pick, PlannerError, PlannerOptions, Surroundings, plan_night, plan_picks,
};
use sunglint_radiometry::air::Air;
use sunglint_radiometry::passband::ZeroPoint;
use sunglint_radiometry::sky::EarthOrientation;

const ISS: &str = "1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927\n\
                   2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537\n";
const DEVICES: &str =
    "station = \"ufo\"\n[[camera]]\nname = \"cam\"\ndevice = \"sim-camera\"\nexposure_s = 0.3\n";

/// Truth: by hand: a pass of 0.4 s within one second of UTC has no whole second, one of 9.5 s has nine; both are left out with their length, one of two minutes is planned, and the plan is read before any of its files is
/// there. Alone, or picked by hand, a short one is refused by name.
#[test]
fn a_plan_has_no_pass_that_is_no_visit() {
    let path = Path::new("/nowhere/night.toml");
    let devices = Plan::of_text(path, DEVICES, &[]).unwrap();
    let air = Air::new(&devices.station.air_options().unwrap()).unwrap();
    let at =
        |s: f64| parse_utc("2026-11-23T20:00:00.3Z").unwrap() + hifitime::Duration::from_seconds(s);
    let offer = |label: &str, from: f64, length: f64, v_mag: f64| PassOffer {
        label: label.into(),
        norad_id: 25_544,
        span: (at(from), at(from + length)),
        v_mag,
        standard_magnitude: None,
        highest_deg: 40.0,
    };
    let offers = [
        offer("FLASH", 600.0, 0.4, -2.0),
        offer("BRIEF", 900.0, 9.5, -1.0),
        offer("LONG", 1800.0, 120.0, 3.0),
    ];
    let dark = [(at(0.0), at(7200.0))];
    let around = Surroundings {
        devices: &devices,
        air: &air,
        orientation: EarthOrientation::embedded(),
        zero: ZeroPoint::default(),
        dark: &dark,
        elements: "night.tle",
    };
    let mut options = PlannerOptions::default();
    (options.stars, options.dark_s) = (0, 0.0);
    let night = plan_night(&offers, around, &options).unwrap();
    let visits: Vec<&str> = night.visits.iter().map(|visit| visit.name.as_str()).collect();
    assert_eq!(visits, ["LONG"]);
    assert_eq!(night.left_out.len(), 2, "{:?}", night.left_out);
    assert!(night.left_out[0].contains("FLASH") && night.left_out[0].contains("0.4 s"));
    let beside = [("/nowhere/night.tle".into(), ISS.as_bytes().to_vec())];
    let plan = Plan::of_text(path, &night.toml(DEVICES), &beside).unwrap();
    assert_eq!(plan.schedule.visits()[0].to, Some(at(1919.7)));
    let short = |made: Result<_, PlannerError>| matches!(made, Err(PlannerError::Short { label, .. }) if label == "FLASH");
    assert!(short(plan_night(&offers[..1], around, &options)));
    assert!(short(plan_picks(&[Pick::Pass(0)], &offers, around, &options)));
}
