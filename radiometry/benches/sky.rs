//! Cost of a frame, and of each direction once it is built.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use divan::{Bencher, black_box};
use glam::DVec3;
use sunglint_formats::time::parse_utc;
use sunglint_radiometry::sky::{Catalogue, EarthOrientation, Geodetic, Observer, Site, SkyFrame};

fn main() {
    divan::main();
}

fn observer() -> Observer {
    let site =
        Site::new(Geodetic { latitude_deg: 48.782389, longitude_deg: 9.196417, height_m: 399.0 })
            .unwrap();
    let epoch = parse_utc("2024-08-12T22:30:00Z").unwrap();
    Observer::at(epoch, &site, EarthOrientation::embedded()).unwrap()
}

#[divan::bench]
fn frame(bencher: Bencher) {
    let epoch = observer().frame().epoch();
    bencher.bench(|| SkyFrame::new(black_box(epoch), EarthOrientation::embedded()).unwrap());
}

#[divan::bench]
fn star_place(bencher: Bencher) {
    let observer = observer();
    let vega = Catalogue::embedded().find("Vega").unwrap();
    bencher.bench(|| observer.star(black_box(vega)).horizontal.zenith_deg());
}

#[divan::bench]
fn satellite_geometric(bencher: Bencher) {
    let observer = observer();
    let position_m = DVec3::new(4.21e6, 1.83e6, 5.32e6);
    bencher.bench(|| observer.geometric(black_box(position_m)).unwrap().horizontal.altitude_deg());
}

#[divan::bench]
fn satellite_apparent(bencher: Bencher) {
    let observer = observer();
    let (position_m, velocity_m_s) =
        (DVec3::new(4.21e6, 1.83e6, 5.32e6), DVec3::new(-6.0e3, 1.0e3, 4.4e3));
    bencher.bench(|| {
        let seen = observer.apparent(black_box(position_m), velocity_m_s).unwrap();
        seen.horizontal.altitude_deg()
    });
}

#[divan::bench]
fn sun(bencher: Bencher) {
    let observer = observer();
    bencher.bench(|| black_box(&observer).sun());
}

#[divan::bench]
fn moon(bencher: Bencher) {
    let observer = observer();
    bencher.bench(|| black_box(&observer).moon());
}

#[divan::bench]
fn find_by_name(bencher: Bencher) {
    bencher.bench(|| Catalogue::embedded().find(black_box("HIP 91262")).unwrap().hip);
}
