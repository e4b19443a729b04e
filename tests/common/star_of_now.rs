//! A star for tests in real time.

use hifitime::{Epoch, Unit};
use std::ops::Range;
use std::path::Path;
use sunglint_drivers::clock::utc_now;
use sunglint_radiometry::sky::{Catalogue, EarthOrientation, Observer, Star};
use sunglint_radiometry::station::Station;

/// Writes the station `ufo` into a folder, turned to where it is midnight now, so that a test needs no hour of the day; gives a star of these magnitudes V and colours B−V that is
/// high and far from the meridian. Where the Sun is up, a mount may find no way around it.
pub fn night_of_now(folder: &Path, v_mag: Range<f64>, b_minus_v: Range<f64>) -> String {
    let from = sunglint_testkit::repository().join("radiometry/stations/ufo");
    std::fs::create_dir_all(folder).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        std::fs::copy(&path, folder.join(path.file_name().unwrap())).unwrap();
    }
    let file = folder.join("station.toml");
    let text = std::fs::read_to_string(&file).unwrap();
    let hours = utc_now().to_unix_seconds().rem_euclid(86_400.0) / 3600.0;
    let longitude_deg = (-15.0 * hours + 180.0).rem_euclid(360.0) - 180.0;
    let here = "longitude_deg = 9.196416666666667";
    assert!(text.contains(here));
    std::fs::write(&file, text.replace(here, &format!("longitude_deg = {longitude_deg}"))).unwrap();
    let station = Station::read(folder).unwrap();
    let (now, earth) = (utc_now(), EarthOrientation::embedded());
    let fit = |epoch: Epoch| {
        let later = Observer::at(epoch, &station.site, earth).unwrap();
        move |star: &Star| {
            let enu = later.star(star).horizontal.east_north_up();
            enu.z > 0.5 && enu.x.abs() > 0.2
        }
    };
    let (now_fits, soon_fits) = (fit(now), fit(now + 5.0 * Unit::Minute));
    let stars = Catalogue::embedded().stars().iter();
    let named = stars
        .filter(|star| star.v_mag.is_some_and(|v| v_mag.contains(&v)) && star.hip.is_some())
        .filter(|star| star.bv_mag.is_some_and(|colour| b_minus_v.contains(&colour)));
    let found = named
        .filter(|star| now_fits(star) && soon_fits(star))
        .find(|star| Catalogue::embedded().find(&star.label()).is_ok());
    found.unwrap().label()
}
