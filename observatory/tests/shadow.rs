//! The Earth's shadow on a session's satellites.

use sunglint_ephemeris::orbit::{Orbit, TleOrbit, elements};
use sunglint_formats::session::{Target, TargetKind};
use sunglint_formats::time::parse_utc;
use sunglint_observatory::Pointing;
use sunglint_radiometry::sky::{EarthOrientation, Observer};
use sunglint_radiometry::station::Station;

/// A synthetic satellite in a low orbit over a night. Truth: the shadow as a cylinder behind a sphere, by hand: it is dark where the satellite is on the night's side and nearer than the Earth's radius to the
/// line from the Sun through the Earth's middle. Penumbra and the Earth's flattening move the edges by less than 20 s.
#[test]
fn satellites_are_dark_behind_the_earth() {
    let text = std::fs::read_to_string(sunglint_testkit::fixture("passes/satellites.tle")).unwrap();
    let sets = elements::parse("satellites.tle", &text).unwrap();
    let set = sets.into_iter().find(|set| set.norad_id == 90002).unwrap();
    let station = Station::built_in("ufo").unwrap().unwrap();
    let mut target = Target::off(TargetKind::Satellite);
    (target.name, target.on) = ("polar".into(), true);
    target.tle = set.lines().map(|lines| lines.map(|line| line.to_string()));
    let orbit = Orbit::from(TleOrbit::new(set).unwrap());
    let mut pointing = Pointing::new(station.clone());
    let begin = parse_utc("2024-08-12T20:00:00Z").unwrap();
    let (mut dark, mut lit, mut edges) = (0, 0, 0);
    for i in 0..1200 {
        let utc = begin + hifitime::Duration::from_seconds(10.0 * f64::from(i));
        let found = pointing.is_lit(&target, utc).unwrap();
        let observer = Observer::at(utc, &station.site, EarthOrientation::embedded()).unwrap();
        let sun = observer.sun().place.direction_gcrs;
        let is_lit = |s: f64| {
            let then = utc + hifitime::Duration::from_seconds(s);
            let at = orbit.state(then, observer.frame()).unwrap().position_m;
            let along = at.dot(sun);
            along > 0.0 || (at - along * sun).length() > 6.371e6
        };
        let by_hand = [-20.0, 0.0, 20.0].map(is_lit);
        if by_hand[0] != by_hand[1] || by_hand[1] != by_hand[2] {
            edges += 1;
            continue;
        }
        assert_eq!(found, by_hand[1], "{utc}");
        *(if found { &mut lit } else { &mut dark }) += 1;
    }
    assert!(dark > 200 && lit > 400 && edges > 4 && edges < 60, "{dark} {lit} {edges}");
    // A star is in no shadow.
    let mut star = Target::off(TargetKind::Star);
    (star.ra_deg, star.dec_deg) = (Some(279.2), Some(38.8));
    assert_eq!(pointing.is_lit(&star, begin), None);
}
