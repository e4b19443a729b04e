//! Our simulated spectrometers on the older USB protocol (OOI), each model, under our driver and under a host that we did not write: seabreeze 2.11.0, its pure Python backend, whose pyusb 1.3.1 speaks over pipes in place of a bus.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use std::io::{BufRead as _, BufReader, Write as _};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;
use sunglint_drivers::clock::Deadline;
use sunglint_drivers::device::{Device as _, Spectrometer as _};
use sunglint_drivers::ocean::VENDOR;
use sunglint_drivers::ocean::ooi::{Model, Ooi, OoiSettings, Speed};
use sunglint_drivers::simulated::ooi as sim;
use sunglint_drivers::transport::{Transfer, Transfers as _};
use sunglint_testkit::{peer_python, run_python};

const SCRIPT: &str = include_str!("../../tests/peers/ocean_ooi.py");
const NEEDS: [&str; 2] = ["seabreeze.pyseabreeze", "usb.backend"];

fn numbers(line: &str) -> Vec<f64> {
    line.split_whitespace().map(|number| number.parse().unwrap()).collect()
}

fn bytes_of(hex: &str) -> Vec<u8> {
    (0..hex.len() / 2).map(|i| u8::from_str_radix(&hex[2 * i..2 * i + 2], 16).unwrap()).collect()
}

/// Truth: seabreeze's own table of models: each that speaks the protocol is driven, and each of its numbers is ours.
#[test]
fn the_table_of_models_is_seabreezes() {
    let name = "the_table_of_models_is_seabreezes";
    let Some(python) = peer_python(name, &NEEDS) else { return };
    let printed = run_python(&python, SCRIPT, &[]);
    let rows: Vec<&str> = printed.lines().collect();
    assert_eq!(rows.len(), Model::ALL.len(), "{printed}");
    for row in rows {
        let (name, rest) = row.split_once(' ').unwrap();
        let row: Vec<u32> = rest.split(' ').map(|number| number.parse().unwrap()).collect();
        let model = Model::of_product(u16::try_from(row[1]).unwrap()).unwrap();
        assert_eq!(model.option, name.to_ascii_lowercase());
        let ends = model.endpoints;
        assert_eq!(row[0], u32::from(VENDOR), "{name}");
        let endpoints = [ends.commands, ends.answers, ends.spectra].map(u32::from);
        assert_eq!(row[2..5], endpoints, "{name}");
        // seabreeze names the fourth endpoint of all new models, and reads from it where a spectrum begins there.
        let beginnings = ends.beginnings.map_or(row[5], u32::from);
        assert_eq!(row[5], beginnings, "{name}");
        assert_eq!(row[6..8], model.integration_us, "{name}");
        assert_eq!(row[8], model.unit_us, "{name}");
        assert_eq!(row[9], model.values as u32, "{name}");
        assert_eq!(row[10], model.frame_length() as u32, "{name}");
        assert_eq!(row[11], u32::from(model.saturation), "{name}");
        let dark = model.dark.iter().flat_map(|[first, end]| *first..*end);
        let dark: Vec<u32> = dark.map(|pixel| pixel as u32).collect();
        assert_eq!(row[12..], dark, "{name}");
    }
}

/// Carries out what seabreeze wants of the instruments, and gives what it made of each, and each at its end.
fn driven(python: &Path, instruments: &[sim::OoiSettings]) -> Vec<(Vec<String>, sim::Ooi)> {
    let mut arguments = Vec::new();
    for settings in instruments {
        arguments.push(settings.model.product.to_string());
        arguments.push(if settings.high_speed { "high" } else { "full" }.to_owned());
    }
    let mut host = Command::new(python)
        .args(["-W", "ignore", "-c", SCRIPT])
        .args(&arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut answers = host.stdin.take().unwrap();
    let mut next = instruments.iter();
    let mut done: Vec<(Vec<String>, sim::Ooi)> = Vec::new();
    for line in BufReader::new(host.stdout.take().unwrap()).lines() {
        let line = line.unwrap();
        let words: Vec<&str> = line.split(' ').collect();
        let number = |i: usize| words[i].parse::<u64>().unwrap();
        let endpoint = |i: usize| u8::try_from(number(i)).unwrap();
        let (transfer, ms) = match words[0] {
            "said" => {
                done.last_mut().unwrap().0.push(words[1..].join(" "));
                continue;
            }
            "model" => {
                let settings = next.next().unwrap().clone();
                assert_eq!(number(1), u64::from(settings.model.product));
                done.push((Vec::new(), sim::Ooi::new(settings)));
                writeln!(answers, "ok").unwrap();
                continue;
            }
            "out" => {
                let data = bytes_of(words[2]);
                (Transfer::BulkOut { endpoint: endpoint(1), data }, 1000)
            }
            "in" => {
                let length = usize::try_from(number(2)).unwrap();
                (Transfer::BulkIn { endpoint: endpoint(1), length }, number(3))
            }
            other => panic!("{other}"),
        };
        let within = Deadline::within(Duration::from_millis(ms));
        let instrument = &mut done.last_mut().unwrap().1;
        match instrument.transfer(&transfer, &within) {
            Ok(bytes) => {
                let hex: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
                writeln!(answers, "ok {hex}").unwrap();
            }
            Err(error) if error.is_timeout() => writeln!(answers, "timeout").unwrap(),
            Err(error) => panic!("{line}: {error}"),
        }
    }
    drop(answers);
    assert!(host.wait().unwrap().success());
    done
}

/// Truth: what seabreeze's own code makes of the answers, of each model and at each speed of the bus that it knows: serial number, wavelengths (ours are the same sum of powers in another order: 1e-9 nm) and counts, each
/// equal to one that was put in. seabreeze scales those of some models; by how much is in its own words for the most (`get_maximum_intensity`) and slot 17, which is the converter's end here. Its first spectrum after a change
/// of the time of integration is of the old time, which is the trap of these instruments; our driver's is not. The values behind the detector's pixels are the filler that was put in.
#[test]
fn seabreeze_reads_of_each_model_what_our_driver_reads() {
    let name = "seabreeze_reads_of_each_model_what_our_driver_reads";
    let Some(python) = peer_python(name, &NEEDS) else { return };
    let mut instruments: Vec<sim::OoiSettings> = Vec::new();
    for model in Model::ALL {
        // It integrates once ahead, so that which spectrum is of which time does not hang on how fast this computer is.
        let of = sim::OoiSettings::of(model);
        let settings = sim::OoiSettings { runs: sim::Runs::Ahead, ..of };
        if model.tells_status {
            instruments.push(sim::OoiSettings { high_speed: false, ..settings.clone() });
        }
        instruments.push(settings);
    }
    // Slot 17 was never written, and a Flame-S in place of a USB2000+.
    let mut flame = sim::OoiSettings::of(Model::named("usb2000plus").unwrap());
    flame.saturation = Some(0);
    flame.firmware = 0x3015;
    flame.runs = sim::Runs::Ahead;
    instruments.push(flame);
    let done = driven(&python, &instruments);
    assert_eq!(done.len(), instruments.len());
    for ((said, instrument), settings) in done.iter().zip(&instruments) {
        let model = settings.model;
        let name = format!("{} high_speed={}", model.name, settings.high_speed);
        let (named, serial) = said[0].split_once(' ').unwrap();
        let is_flame = settings.firmware >> 12 == 3;
        let expected = if is_flame { "flames" } else { model.option };
        assert_eq!(named.to_ascii_lowercase(), expected);
        assert_eq!(serial, settings.texts[&0], "{name}");

        let within = || Deadline::within(Duration::from_secs(20));
        let own = sim::Ooi::new(settings.clone());
        let mut device = Ooi::open(own, model, OoiSettings::default(), &within()).unwrap();
        let identity = device.identity(&within()).unwrap();
        assert_eq!(identity.serial.as_deref(), Some(serial), "{name}");
        assert_eq!(device.speed() == Speed::High, settings.high_speed, "{name}");

        let wavelengths = numbers(&said[1]);
        assert_eq!(wavelengths.len(), model.values, "{name}");
        assert_eq!(device.wavelength_nm().len(), model.pixels, "{name}");
        for (theirs, own) in wavelengths.iter().zip(device.wavelength_nm()) {
            assert!((theirs - own).abs() < 1e-9, "{name}: {theirs} {own}");
        }

        let most: f64 = said[6].parse().unwrap();
        let end = settings.saturation.filter(|end| *end > 0).map_or(most, f64::from);
        let given = instrument.given();
        let times: Vec<u32> = given.iter().take(4).map(|one| one.us).collect();
        let first = settings.integration_at_first_us;
        assert_eq!(times, [first, 20_000, 20_000, 60_000], "{name}: the trap is there");
        for (line, one) in said[2..6].iter().zip(given) {
            let theirs = numbers(line);
            assert_eq!(theirs.len(), model.values, "{name}");
            for (pixel, (theirs, own)) in theirs.iter().zip(&one.counts).enumerate() {
                let expected = f64::from(*own) * most / end;
                assert!((theirs - expected).abs() < 1e-9, "{name} {pixel}: {theirs} {expected}");
            }
            assert!(theirs[model.pixels..].iter().all(|filler| *filler == 0.0), "{name}");
        }
        for seconds in [0.02, 0.06] {
            let spectrum = device.expose(seconds, &within()).unwrap();
            assert_eq!(spectrum.saturation_counts, Some(end), "{name}");
            let one = device.line().given().back().unwrap();
            assert_eq!(f64::from(one.us), seconds * 1e6, "{name}");
            let own: Vec<f64> = one.counts.iter().map(|count| f64::from(*count)).collect();
            assert_eq!(spectrum.counts, own, "{name}");
        }
        if model.option == "usb2000plus" {
            assert_eq!(identity.firmware, Some(said[7].replace(' ', ".")));
            check_nonlinearity(&said[8..], instrument, &device, most / end);
        } else {
            assert_eq!(said.len(), 8, "{name}");
        }
        assert_eq!(said.last().unwrap(), "end");
    }
}

/// The coefficients of the nonlinearity, and a spectrum that seabreeze freed of its dark and its nonlinearity.
fn check_nonlinearity(said: &[String], instrument: &sim::Ooi, device: &Ooi<sim::Ooi>, scale: f64) {
    let calibration = device.calibration();
    assert_eq!(numbers(&said[0]), *calibration.nonlinearity.as_ref().unwrap());
    let counts: Vec<f64> =
        instrument.given().back().unwrap().counts.iter().map(|c| f64::from(*c) * scale).collect();
    let dark: Vec<f64> =
        device.model().dark.iter().flat_map(|[first, end]| counts[*first..*end].to_vec()).collect();
    let dark = dark.iter().sum::<f64>() / dark.len() as f64;
    let theirs = numbers(&said[1]);
    assert_eq!(theirs.len(), counts.len());
    for (theirs, counts) in theirs.iter().zip(&counts) {
        let own = calibration.linear(counts - dark).unwrap();
        assert!((theirs - own).abs() < 1e-6, "{theirs} {own}");
    }
}
