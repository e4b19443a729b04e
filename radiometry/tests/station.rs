//! Stations: the built-in one against the published figures, and files that are wrong.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use std::path::{Path, PathBuf};
use sunglint_radiometry::spectrum::{Irradiance, Spectrum, Transmission};
use sunglint_radiometry::station::{Counter, DeadTime, Detector, Horizon, Station};

fn ufo() -> Station {
    Station::built_in("ufo").unwrap().unwrap()
}

/// Truth: the thesis' text and tables B.1, B.2 and C.1.
#[test]
fn the_built_in_station_is_the_published_one() {
    let ufo = ufo();
    let site = ufo.site.geodetic();
    let dms = |d: f64, m: f64, s: f64| d + m / 60.0 + s / 3600.0;
    assert!((site.latitude_deg - dms(48.0, 46.0, 56.6)).abs() < 1e-9);
    assert!((site.longitude_deg - dms(9.0, 11.0, 47.1)).abs() < 1e-9);
    assert_eq!(site.height_m, 399.0);
    // 31 % bigger without its obstruction.
    let full = std::f64::consts::PI * 0.215_f64.powi(2);
    assert!((full / ufo.telescope.area_m2() - 1.31).abs() < 0.005);
    let names: Vec<&str> = ufo.channels.iter().map(|c| c.name.as_str()).collect();
    assert_eq!(names, ["r", "g", "b", "id400", "spcm", "mppc"]);
    for (name, peak_nm, peak, first_nm, last_nm) in [
        ("b", 450.0, 0.50, 350.0, 660.0),
        ("g", 520.0, 0.56, 400.0, 650.0),
        ("r", 600.0, 0.56, 400.0, 700.0),
        ("id400", 950.0, 0.35, 880.0, 1240.0),
        ("spcm", 650.0, 0.70, 350.0, 1100.0),
        ("mppc", 420.0, 0.50, 320.0, 900.0),
    ] {
        let efficiency = &ufo.channel(name).unwrap().efficiency;
        let highest = efficiency.value().iter().copied().fold(0.0, f64::max);
        assert_eq!((efficiency.at(peak_nm), highest), (peak, peak), "{name}");
        assert_eq!(efficiency.range_nm(), (first_nm, last_nm), "{name}");
        assert_eq!(
            efficiency.at(first_nm) + efficiency.at(last_nm),
            0.0,
            "{name} has a step at its end"
        );
    }
    let counter = |name: &str| match &ufo.channel(name).unwrap().detector {
        Detector::Counter(counter) => counter.clone(),
        other => panic!("{other:?}"),
    };
    let DeadTime::NonParalysable { dead_time_s } = counter("spcm").dead_time else { panic!() };
    assert!((dead_time_s / 22e-9 - 1.0).abs() < 1e-12);
    assert_eq!(counter("id400").dark_rate_hz, 756.0);
    assert_eq!(counter("mppc").fibre.unwrap().sigma_px.to_array(), [18.213, 23.411]);
    let camera = ufo.camera.unwrap();
    assert_eq!(camera.size_px, [1391, 1039]);
    // 6.45 µm at 3 m.
    assert!((camera.pixel_scale_arcsec - 0.4435).abs() < 1e-3);
    // The sensor's area of table B.1 is that of its pixels.
    assert!((1391.0 * 1039.0 * 6.45e-3_f64.powi(2) - 60.126).abs() < 1e-3);
    assert_eq!(camera.saturation_adu(), 65535.0);
}

/// Truth: by hand. Flat light of 1e-12 W/m²/nm on a station with a box filter: A/(hc) E P (λ₂²−λ₁²)/2.
#[test]
fn a_rate_is_photons_times_area_times_sensitivity() {
    let folder = station(|toml| toml);
    let station = Station::read(folder.path()).unwrap();
    let light = Spectrum::<Irradiance>::constant(1e-12, 300.0, 1200.0).unwrap();
    let grey = Spectrum::<Transmission>::constant(0.5, 300.0, 1200.0).unwrap();
    let channel = station.channel("box").unwrap();
    let hc_j_nm = 1.986_445_857e-16;
    let expected = std::f64::consts::PI
        * (0.25 - 0.01)
        * 1e-12
        * 0.4
        * 0.9
        * (600.0_f64.powi(2) - 500.0_f64.powi(2))
        / 2.0
        / hc_j_nm;
    let found = station.rate_hz(channel, &light, None);
    assert!((found.value / expected - 1.0).abs() < 1e-9, "{} {expected}", found.value);
    assert!(found.is_covered());
    assert!((station.rate_hz(channel, &light, Some(&grey)).value / expected - 0.5).abs() < 1e-9);
    assert!((channel.bandwidth_nm() - 36.0).abs() < 1e-9);
    assert!((channel.mean_wavelength_nm() - 550.0).abs() < 1e-9);
    // Light that nobody tabulated is said.
    let short = Spectrum::<Irradiance>::constant(1e-12, 300.0, 560.0).unwrap();
    assert_eq!(station.rate_hz(channel, &short, None).uncovered_nm, 40.0);
    // A grey loss changes the height and nothing else, photons or counts.
    let grey = self::station(|toml| toml.replace("note = \"a box\"", "transmission = 0.5"));
    let grey = Station::read(grey.path()).unwrap();
    assert!((grey.channel("box").unwrap().bandwidth_nm() - 18.0).abs() < 1e-9);
    assert!((grey.channel("box").unwrap().sensitivity_at(550.0) - 0.18).abs() < 1e-12);
    // Photons leave the efficiency out.
    let photons =
        self::station(|toml| toml.replace("quantity = \"counts\"", "quantity = \"photons\""));
    let station = Station::read(photons.path().join("station.toml")).unwrap();
    let channel = station.channel("box").unwrap();
    assert!((channel.bandwidth_nm() - 0.9 * 300.0).abs() < 1e-9);
    assert_eq!(channel.range_nm(), Some((400.0, 700.0)));
    let laser = &station.lasers[0];
    assert!(
        (laser.pulse_energy_j / 0.14 - 1.0).abs() < 1e-12
            && (laser.pulse_length_s / 7e-9 - 1.0).abs() < 1e-12
    );
}

/// Truth: Poisson photons one by one, each counted unless within the dead time of the last count (of the last photon, for the paralysable law), in
/// 4,000 exposures, each linearised by its law. Tolerances: four standard deviations of the mean count; 5 % of the scatter (four standard
/// deviations of a scatter of 4,000, 1.1 % each, and the law's own small terms).
#[test]
fn counts_and_their_noise_are_those_of_single_photons() {
    use rand::{RngExt as _, SeedableRng as _};
    let mut random = rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(2);
    let (dead_time_s, exposure_s, exposures) = (22e-9, 1e-4, 4000_u32);
    for true_hz in [1e6, 1e7, 2e7] {
        let (mut now, mut blind, mut blind_longer) = (0.0_f64, 0.0, 0.0);
        let (mut simple, mut paralysed) = (Vec::new(), Vec::new());
        let (mut all, mut all_longer) = (0_u32, 0_u32);
        for _ in 0..exposures {
            let (mut counted, mut counted_longer) = (0_u32, 0_u32);
            while now < exposure_s {
                if now >= blind {
                    (counted, blind) = (counted + 1, now + dead_time_s);
                }
                counted_longer += u32::from(now >= blind_longer);
                blind_longer = now + dead_time_s;
                now -= random.random_range(f64::MIN_POSITIVE..1.0).ln() / true_hz;
            }
            (now, blind, blind_longer) =
                (now - exposure_s, blind - exposure_s, blind_longer - exposure_s);
            (all, all_longer) = (all + counted, all_longer + counted_longer);
            let m = f64::from(counted) / exposure_s;
            simple.push(m / (1.0 - m * dead_time_s));
            // m = n e^(−nτ) on its low branch, by Newton's method.
            let m = f64::from(counted_longer) / exposure_s;
            let mut n = m;
            for _ in 0..50 {
                let x = n * dead_time_s;
                n -= (n - m * x.exp()) / (1.0 - x * m / n * x.exp());
            }
            paralysed.push(n);
        }
        for (law, rates, counts) in [
            (DeadTime::NonParalysable { dead_time_s }, simple, all),
            (DeadTime::Paralysable { dead_time_s }, paralysed, all_longer),
        ] {
            let n = f64::from(exposures);
            let counted_hz = f64::from(counts) / (n * exposure_s);
            let relative = (law.counted_hz(true_hz).unwrap() / counted_hz - 1.0).abs();
            assert!(
                relative < 4.0 / f64::from(counts).sqrt(),
                "{law:?} at {true_hz:e} Hz: {relative}"
            );
            let mean = rates.iter().sum::<f64>() / n;
            let scatter =
                (rates.iter().map(|r| (r - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
            let ratio = law.sigma_hz(true_hz, exposure_s).unwrap() / scatter;
            assert!((ratio - 1.0).abs() < 0.05, "{law:?} at {true_hz:e} Hz: {ratio}");
        }
    }
}

/// Truth: by hand. A table of two lines, slopes 1 and 2: σ = dn/dm √(m/t).
#[test]
fn a_linearity_table_counts_and_errs_by_its_lines() {
    let table =
        DeadTime::Table { measured_hz: vec![0.0, 1e6, 1.5e6], true_hz: vec![0.0, 1e6, 2e6] };
    assert_eq!(table.counted_hz(1.5e6), Some(1.25e6));
    assert_eq!((table.counted_hz(2e6), table.counted_hz(2.1e6)), (Some(1.5e6), None));
    for (true_hz, slope, measured_hz) in
        [(0.5e6, 1.0, 0.5e6), (1.5e6, 2.0, 1.25e6), (2e6, 2.0, 1.5e6)]
    {
        let expected = slope * f64::sqrt(measured_hz / 0.1);
        assert!(
            (table.sigma_hz(true_hz, 0.1).unwrap() / expected - 1.0).abs() < 1e-12,
            "{true_hz:e}"
        );
    }
    assert_eq!(table.sigma_hz(2.1e6, 0.1), None);
}

/// Truth: event-level simulations by an independent program (numpy): of 100 pixels that recover with 50 ns, alone, and of 667 behind a comparator. Tolerance: their noise, 1e-3 and 2e-3.
#[test]
fn pixels_and_their_comparator_count_as_simulated() {
    for (pixels, pulse_ns, true_hz, share, within) in [
        (100, 0.0, 1e6, 0.99952, 1e-3),
        (100, 0.0, 1e7, 0.99506, 1e-3),
        (100, 0.0, 1e8, 0.95295, 1e-3),
        (1, 0.0, 1e7, 0.70900, 1e-3),
        (1, 0.0, 1e8, 0.31312, 1e-3),
        (667, 10.0, 1e6, 0.990, 2e-3),
        (667, 10.0, 1e7, 0.904, 2e-3),
        (667, 20.0, 3e6, 0.941, 2e-3),
        (667, 20.0, 1e7, 0.819, 2e-3),
        (667, 30.0, 1e7, 0.741, 2e-3),
        (667, 50.0, 1e7, 0.606, 2e-3),
    ] {
        let law = DeadTime::MultiPixel { pixels, recovery_s: 50e-9, pulse_s: pulse_ns * 1e-9 };
        let found = law.counted_hz(true_hz).unwrap() / true_hz;
        assert!((found - share).abs() < within, "{pixels} {pulse_ns} {true_hz:e}: {found}");
    }
    let law = DeadTime::MultiPixel { pixels: 400, recovery_s: 50e-9, pulse_s: 20e-9 };
    assert_eq!((law.counted_hz(0.0), law.sigma_hz(0.0, 0.1)), (Some(0.0), Some(0.0)));
    // Beyond the comparator's peak counts tell nothing.
    assert_eq!(law.sigma_hz(6e7, 0.1), None);
}

/// Truth: single events, drawn here: 400 pixels that recover with 20 µs behind a comparator of 0.2 µs at 1 MHz. The counts' mean, and their scatter over the slope of the law (differences of it) as σ. Tolerance: four sigma of the
/// mean; 5 %, the scatter's own uncertainty over 3,000 exposures being 1.3 %, and what the pulses of one pixel keep apart (they never merge: of few pixels that is more).
#[test]
fn noise_of_pixels_is_that_of_single_events() {
    use rand::{RngExt as _, SeedableRng as _};
    let (recovery_s, pulse_s, pixels, true_hz) = (20e-6, 0.2e-6, 400_usize, 1e6);
    let law = DeadTime::MultiPixel { pixels: 400, recovery_s, pulse_s };
    let (exposure_s, exposures) = (1e-3, 3000);
    let mut random = rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(8);
    let mut last = vec![f64::NEG_INFINITY; pixels];
    let (mut now, mut pulse) = (0.0, f64::NEG_INFINITY);
    let mut counts = Vec::new();
    for k in 0..exposures {
        let until = f64::from(k + 1) * exposure_s;
        let mut counted = 0.0;
        loop {
            let u: f64 = random.random_range(f64::MIN_POSITIVE..1.0);
            now -= u.ln() / true_hz;
            if now >= until {
                // No memory: the next exposure draws anew from its begin.
                now = until;
                break;
            }
            let pixel = random.random_range(0..pixels);
            let awake = -(-(now - last[pixel]) / recovery_s).exp_m1();
            if random.random_range(0.0..1.0) < awake {
                last[pixel] = now;
                counted += f64::from(u8::from(now - pulse > pulse_s));
                pulse = now;
            }
        }
        counts.push(counted / exposure_s);
    }
    let n = f64::from(exposures);
    let mean = counts.iter().sum::<f64>() / n;
    let scatter = (counts.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
    let counted = |hz: f64| law.counted_hz(hz).unwrap();
    assert!((counted(true_hz) - mean).abs() < 4.0 * scatter / n.sqrt(), "{mean}");
    let slope = (counted(1.01 * true_hz) - counted(0.99 * true_hz)) / (0.02 * true_hz);
    let ratio = law.sigma_hz(true_hz, exposure_s).unwrap() / (scatter / slope);
    assert!((ratio - 1.0).abs() < 0.05, "{ratio}");
}

/// A counter that is blinded is saturated, though it counts little or never quite its limit.
#[test]
fn a_blinded_counter_is_saturated() {
    let saturated = |dead_time: DeadTime, saturation_hz: f64, true_hz: f64| {
        let station = ufo();
        let Detector::Counter(counter) = &station.channel("spcm").unwrap().detector else {
            panic!()
        };
        Counter { dead_time, saturation_hz, ..counter.clone() }.is_saturated_by(true_hz)
    };
    let dead_time_s = 10e-6;
    for (true_hz, expected) in [(1e5, false), (8e5, false), (1e6, true), (1e10, true)] {
        assert_eq!(
            saturated(DeadTime::NonParalysable { dead_time_s }, 100e3, true_hz),
            expected,
            "{true_hz:e}"
        );
    }
    for (true_hz, expected) in [(5e4, false), (1.1e5, true), (1e10, true)] {
        assert_eq!(
            saturated(DeadTime::Paralysable { dead_time_s }, 36e3, true_hz),
            expected,
            "{true_hz:e}"
        );
    }
    let table = || DeadTime::Table { measured_hz: vec![0.0, 1e6], true_hz: vec![0.0, 2e6] };
    assert!(
        !saturated(table(), 1e6, 1.9e6)
            && saturated(table(), 1e6, 2e6)
            && saturated(table(), 1e6, 3e6)
    );
    assert!(saturated(DeadTime::None, 1e6, 1e6) && !saturated(DeadTime::None, 1e6, 9e5));
}

#[test]
fn a_curve_that_stops_high_is_noticed() {
    assert!(ufo().warnings.is_empty(), "{:?}", ufo().warnings);
    let folder = station(|toml| toml);
    // The efficiency stops at 500 and 600 nm with 0.4, the optics go on.
    let warnings = Station::read(folder.path()).unwrap().warnings;
    assert_eq!(warnings.len(), 2);
    assert!(
        warnings[0].contains("channel box: a curve of its efficiency ends at 500 nm with 0.400"),
        "{}",
        warnings[0]
    );
}

#[test]
fn a_horizon_goes_around_north() {
    let mask = Horizon::Mask(vec![(90.0, 10.0), (270.0, 30.0)]);
    for (azimuth, elevation) in [
        (90.0, 10.0),
        (180.0, 20.0),
        (270.0, 30.0),
        (0.0, 20.0),
        (360.0, 20.0),
        (-45.0, 25.0),
        (45.0, 15.0),
    ] {
        assert!((mask.elevation_deg(azimuth) - elevation).abs() < 1e-12, "{azimuth}");
    }
    assert_eq!(Horizon::Flat(10.0).elevation_deg(123.0), 10.0);
    assert_eq!(Horizon::Mask(vec![(10.0, 7.0)]).elevation_deg(200.0), 7.0);
    let folder = station(|toml| toml.replace("horizon_deg = 10", "horizon_mask = \"mask.csv\""));
    std::fs::write(folder.path().join("mask.csv"), "azimuth_deg,elevation_deg\n0,5\n180,15\n")
        .unwrap();
    let read = Station::read(folder.path()).unwrap();
    assert!((read.horizon.elevation_deg(90.0) - 10.0).abs() < 1e-12);
}

/// Checks faulty files of a station, and the message that each fault gets.
#[test]
fn wrong_files_are_refused_with_file_line_and_field() {
    for (from, to, expected) in [
        (
            "dead_time_ns = 22",
            "dead_time_ns = -22",
            "station.toml:26: channel[0].counter.dead_time_ns: found -22, expected",
        ),
        (
            "dead_time_ns = 22",
            "dead_time_us = 22",
            "station.toml:26: channel[0].counter.dead_time_us: found",
        ),
        ("dead_time_ns = 22\n", "", "dead_time_ns, which the model non_paralysable needs"),
        (
            "dead_time_ns = 22",
            "dead_time_ns = 22\nrecovery_ns = 3",
            "no recovery_ns: the model non_paralysable does not use it",
        ),
        (
            "saturation_hz = 1e6",
            "saturation_hz = 1e9",
            "at most 4.545455e7 Hz, which a dead time of 22 ns allows",
        ),
        ("quantity = \"counts\"", "quantity = \"clicks\"", "channel[0].counter.quantity"),
        (
            "latitude_deg = 48.7",
            "latitude_deg = 98.7",
            "station.toml:4: site.latitude_deg: found 98.7, expected",
        ),
        (
            "obstruction_diameter_m = 0.2",
            "obstruction_diameter_m = 1.2",
            "telescope.obstruction_diameter_m: found 1.2, expected less than primary_diameter_m = 1",
        ),
        (
            "primary_diameter_m = 1",
            "primary_diameter_m = 300",
            "telescope.primary_diameter_m: found 300, expected metres, at most 40",
        ),
        ("focal_length_m = ", "focal_length_m = 100", "0.3 to 300 times the diameter of 1 m"),
        (
            "efficiency = \"efficiency.csv\"",
            "efficiency = \"nowhere.csv\"",
            "station.toml:20: channel[0].efficiency: found \"nowhere.csv\", expected a curve that can be read",
        ),
        (
            "profile = \"tropical\"",
            "aerosol = \"smog\"",
            "air.aerosol: found \"smog\", expected rural_23km",
        ),
        ("profile = \"tropical\"", "aerosol_exponent = 1", "also aerosol_optical_depth_550"),
        ("name = \"box\"", "name = \"a box\"", "channel[0].name: found"),
        (
            "[channel.counter]",
            "camera_plane = \"R\"\n[channel.counter]",
            "either camera_plane or a table [channel.counter]",
        ),
        ("[telescope]", "[telescop]", "station.toml"),
        ("height_m = 300", "height_m = nan", "site.height_m: found nan, expected"),
        ("profile = \"tropical\"", "profil = \"tropical\"", "profile"),
        (
            "profile = \"tropical\"",
            "profile = \"tropicl\"",
            "station.toml:15: air.profile: found \"tropicl\"",
        ),
        (
            "profile = \"tropical\"",
            "pressure_hpa = 1e9",
            "station.toml:15: air.pressure_hpa: found",
        ),
        ("horizon_deg = 10", "horizon_deg = 120", "site.horizon_deg: found 120"),
        (
            "saturation_hz = 1e6",
            "saturation_hz = 1e6\nfibre_offset_px = [0, 0]\nfibre_sigma_px = [1, 1]",
            "a table [camera], in whose pixels",
        ),
        ("dark_rate_hz = 0", "dark_rate_hz = 1e6", "less than saturation_hz = 1000000"),
        ("optics = [\"optics.csv\"]\n", "transmission = 0\n", "at which they are not 0"),
        ("[[laser]]", "[[laser]]\nname = \"a b\"\n[[laser]]", "laser[0]"),
    ] {
        let folder = station(|toml| {
            assert!(toml.contains(from), "{from}");
            toml.replacen(from, to, 1)
        });
        let message = Station::read(folder.path()).unwrap_err().to_string();
        assert!(
            message.contains(expected),
            "{from} -> {to}\n  found    {message}\n  expected {expected}"
        );
    }
    for (curve, expected) in [
        (
            "wavelength_nm,efficiency\n500,0.4\n600,NaN\n",
            "efficiency.csv:3: efficiency: found `NaN`",
        ),
        (
            "wavelength_nm,efficiency\n400,0.4\n500,0.4\n450,0.4\n",
            "efficiency.csv:4: wavelength_nm",
        ),
        (
            "wavelength_nm,efficiency\n500,40\n600,40\n",
            "a column in percent is named efficiency_percent",
        ),
        ("nm,efficiency\n500,0.4\n600,0.4\n", "name it wavelength_nm"),
        (
            "wavelength_nm,efficiency\n900,0.4\n950,0.4\n",
            "optics and efficiency with wavelengths in common",
        ),
        ("", "efficiency.csv"),
        ("wavelength_nm,efficiency\n0.5,0.4\n0.6,0.4\n", "name the column wavelength_um"),
        (
            "wavelength_nm,efficiency\n5000,0.4\n6000,0.4\n",
            "found 5000 to 6000 nm, expected wavelengths in nm (if they are in ångström, name the column wavelength_angstrom",
        ),
        (
            "wavelength_nm,efficiency\n2500,0.4\n2900,0.4\n",
            "its curves run over 400 to 700 nm, 2500 to 2900 nm; a column in angstrom",
        ),
        ("wavelength_um,efficiency\n400,0.4\n1000,0.2\n", "name the column wavelength_nm"),
        ("wavelength_nm,efficiency_percent\n400,0.4\n700,0.8\n", "name it efficiency"),
        (
            "wavelength_nm,attenuation_db\n500,0.4\n600,0.4\n",
            "found `attenuation_db`, expected a column of fractions",
        ),
        ("wavelength_nm,efficiency\n500,0\n600,0\n", "at which they are not 0"),
    ] {
        let folder = station(|toml| toml);
        std::fs::write(folder.path().join("efficiency.csv"), curve).unwrap();
        let message = Station::read(folder.path()).unwrap_err().to_string();
        assert!(message.contains(expected), "{curve}\n  found    {message}\n  expected {expected}");
    }
}

/// Truth: the columns of the same numbers under other names and in another order.
#[test]
fn a_curve_may_decrease_and_name_its_columns_in_capitals() {
    let read = |curve: &str| {
        let folder = station(|toml| toml);
        std::fs::write(folder.path().join("efficiency.csv"), curve).unwrap();
        Station::read(folder.path()).unwrap().channels[0].efficiency.clone()
    };
    let plain = read("wavelength_nm,qe\n400,0.4\n700,0.8\n");
    assert_eq!(plain, read("Wavelength_nm,QE\n700,0.8\n400,0.4\n"));
}

/// The folder of a test's station, gone when dropped.
struct Folder(PathBuf);

impl Folder {
    fn path(&self) -> &Path {
        &self.0
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn station(change: impl Fn(String) -> String) -> Folder {
    use std::sync::atomic::{AtomicU32, Ordering};
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let number = COUNT.fetch_add(1, Ordering::Relaxed);
    let path =
        std::env::temp_dir().join(format!("sunglint-station-{}-{number}", std::process::id()));
    std::fs::create_dir_all(&path).unwrap();
    let toml = r#"name = "test"

[site]
latitude_deg = 48.7
longitude_deg = 9
height_m = 300
horizon_deg = 10

[telescope]
primary_diameter_m = 1
obstruction_diameter_m = 0.2
focal_length_m = 8

[air]
profile = "tropical"

[[channel]]
name = "box"
optics = ["optics.csv"]
efficiency = "efficiency.csv"
note = "a box"
[channel.counter]
quantity = "counts"
dead_time_model = "non_paralysable"
# a comment, so that the line below is 26
dead_time_ns = 22
saturation_hz = 1e6
dark_rate_hz = 0

[[laser]]
name = "Graz"
wavelength_nm = 1064
linewidth_nm = 1
pulse_energy_mj = 140
pulse_length_ns = 7
repetition_rate_hz = 10
divergence_arcsec = 5
beam_radius_m = 0.06
"#;
    std::fs::write(path.join("station.toml"), change(toml.to_owned())).unwrap();
    std::fs::write(
        path.join("efficiency.csv"),
        "# flat\nwavelength_nm,efficiency\n500,0.4\n600,0.4\n",
    )
    .unwrap();
    std::fs::write(path.join("optics.csv"), "wavelength_um,transmission_percent\n0.4,90\n0.7,90\n")
        .unwrap();
    Folder(path)
}
