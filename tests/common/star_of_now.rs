//! A star for tests in real time.

use hifitime::{Epoch, Unit};
use sunglint_drivers::clock::utc_now;
use sunglint_observatory::telescope::sun;
use sunglint_radiometry::sky::{Catalogue, EarthOrientation, Observer, Star};
use sunglint_radiometry::station::Station;

/// A star that is high, far from the Sun and from the meridian now, and does not saturate a camera in a twentieth of a second.
pub fn star_of_now() -> String {
    let station = Station::built_in("ufo").unwrap().unwrap();
    let place = station.site.geodetic();
    let (now, earth) = (utc_now(), EarthOrientation::embedded());
    let sun = sun(now, place.latitude_deg, place.longitude_deg).enu;
    let fit = |epoch: Epoch| {
        let later = Observer::at(epoch, &station.site, earth).unwrap();
        move |star: &Star| {
            let enu = later.star(star).horizontal.east_north_up();
            enu.z > 0.5 && enu.x.abs() > 0.2 && enu.dot(sun) < 0.5
        }
    };
    let (now_fits, soon_fits) = (fit(now), fit(now + 5.0 * Unit::Minute));
    let stars = Catalogue::embedded().stars().iter();
    let named = stars
        .filter(|star| star.v_mag.is_some_and(|v| (2.5..4.5).contains(&v)) && star.hip.is_some());
    let found = named
        .filter(|star| now_fits(star) && soon_fits(star))
        .find(|star| Catalogue::embedded().find(&star.label()).is_ok());
    found.unwrap().label()
}
