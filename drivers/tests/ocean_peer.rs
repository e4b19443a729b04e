//! Our simulated HDX over a real socket, under our driver and under a host that we did not write: seabreeze 2.11.0, its pure Python backend, by its transport for networks and by that for USB.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

use std::net::SocketAddr;
use std::time::Duration;
use sunglint_drivers::catalogue::Address;
use sunglint_drivers::clock::{Cancel, Deadline};
use sunglint_drivers::device::{Device as _, Spectrometer as _};
use sunglint_drivers::ocean::{Bulk, ENDPOINTS, LinkSettings, Obp, ObpSettings};
use sunglint_drivers::simulated::ocean::{Ocean, OceanSettings};
use sunglint_drivers::simulated::served::{Port, Served};
use sunglint_drivers::transport::tcp::Tcp;
use sunglint_drivers::transport::{Bytes as _, Transfer, Transfers, TransportError};
use sunglint_testkit::{peer_python, run_python};

/// Serves `sim-ocean` at a port of the system's choice while `with` runs.
fn served<V>(options: &[&str], with: impl FnOnce(SocketAddr) -> V) -> V {
    let options: Vec<String> = options.iter().map(|&option| option.to_owned()).collect();
    let mut device = Served::new(Address::parse("sim-ocean", &options).unwrap()).unwrap();
    let port = Port::listen("127.0.0.1:0").unwrap();
    let at = port.at();
    let cancel = Cancel::new();
    let stop = cancel.clone();
    let server = std::thread::spawn(move || device.at_port(&port, &stop, |_| {}).unwrap());
    let done = with(at);
    cancel.cancel();
    server.join().unwrap();
    done
}

fn numbers(line: &str) -> Vec<f64> {
    line.split(' ').map(|number| number.parse().unwrap()).collect()
}

const SCRIPT: &str = r#"
import sys, seabreeze
seabreeze.use("pyseabreeze")
from seabreeze.pyseabreeze import devices, transport
host, port = sys.argv[1], int(sys.argv[2])
transport.IPv4Transport.register_model("HDX", ipv4_address=host, ipv4_port=port)
device = devices.SeaBreezeDevice(transport.IPv4TransportHandle(host, port))
device.open()
print(device.model, device.serial_number)
spectrometer = device.f.spectrometer
print(*spectrometer.get_wavelengths())
for micros in 20000, 60000:
    spectrometer.set_integration_time_micros(micros)
    for _ in range(2):
        print(*spectrometer.get_intensities())
print(*device.f.nonlinearity_coefficients.get_nonlinearity_coefficients())
try: spectrometer.protocol.query(0x00180101, 9)
except Exception as error: print(error.__context__ or error)
device.close()
"#;

/// Truth: what seabreeze's own parsers make of the answers: the serial number, our wavelengths to the last bit of a double, and spectra of the light
/// that was put in. The first one after a change of the time is of the old time, which is the trap of these instruments; our driver's is not.
/// A wavelength of both is the same sum of powers in another order: 1e-9.
#[test]
fn seabreeze_reads_the_values_that_our_driver_reads() {
    let name = "seabreeze_reads_the_values_that_our_driver_reads";
    let Some(python) = peer_python(name, &["seabreeze.pyseabreeze"]) else { return };
    // The lamp of `OceanSettings`, from which the truth comes.
    for options in [&["lamp=1"][..], &["lamp=1", "checksum=yes"]] {
        let printed = served(options, |at| {
            run_python(&python, SCRIPT, &[&at.ip().to_string(), &at.port().to_string()])
        });
        let lines: Vec<&str> = printed.lines().collect();
        assert_eq!(lines.len(), 8, "{printed}");
        assert_eq!(lines[0], "HDX HDX01042");
        assert_eq!((lines[6], lines[7]), ("", "Payload data invalid"));
        let truth = Ocean::new(OceanSettings::default());
        let ours = served(options, |at| {
            let within = || Deadline::within(Duration::from_secs(20));
            let line = Tcp::connect(&at.to_string(), &within()).unwrap();
            let (link, settings) = (LinkSettings::default(), ObpSettings::default());
            let mut device = Obp::open(line, link, settings, &within()).unwrap();
            assert_eq!(device.identity(&within()).unwrap().serial.unwrap(), "HDX01042");
            [0.02, 0.06].map(|seconds| device.expose(seconds, &within()).unwrap())
        });
        let wavelengths = numbers(lines[1]);
        assert_eq!(wavelengths.len(), 2068);
        for (theirs, own) in wavelengths.iter().zip(&ours[0].wavelength_nm) {
            assert!((theirs - own).abs() < 1e-9, "{theirs} {own}");
        }
        // Of 10 ms, as it was switched on, 20 ms twice, and 60 ms.
        let spectra: Vec<Vec<f64>> = lines[2..6].iter().map(|line| numbers(line)).collect();
        for (spectrum, us) in spectra.iter().zip([10_000, 20_000, 20_000, 60_000]) {
            assert!(agrees(&truth, spectrum, us), "seabreeze's spectrum of {us} µs");
        }
        assert!(!agrees(&truth, &spectra[0], 20_000), "the trap is there");
        for (spectrum, us) in ours.iter().zip([20_000, 60_000]) {
            assert!(agrees(&truth, &spectrum.counts, us), "our spectrum of {us} µs");
        }
    }
}

/// Truth: what seabreeze's own USB transport (its endpoints and reads of an HDX, pyusb 1.3.1) makes of the answers, beside what our driver reads over bulk transfers. There is no bus: pyusb's backend carries
/// the transfers over a socket, and so do our own. Tolerances as above.
#[test]
fn seabreeze_reads_over_usb_what_our_driver_reads_over_usb() {
    let name = "seabreeze_reads_over_usb_what_our_driver_reads_over_usb";
    let Some(python) = peer_python(name, &["seabreeze.pyseabreeze", "usb.backend"]) else { return };
    let script = include_str!("../../tests/peers/ocean_usb.py");
    let options = ["lamp=1"];
    let printed = served(&options, |at| {
        run_python(&python, script, &[&at.ip().to_string(), &at.port().to_string()])
    });
    let lines: Vec<&str> = printed.lines().collect();
    assert_eq!(lines.len(), 7, "{printed}");
    assert_eq!(lines[0], "HDX HDX01042");
    let truth = Ocean::new(OceanSettings::default());
    let ours = served(&options, |at| {
        let within = || Deadline::within(Duration::from_secs(20));
        let bus = Bus(Tcp::connect(&at.to_string(), &within()).unwrap());
        let line = Bulk::new(bus, ENDPOINTS);
        let (link, settings) = (LinkSettings::default(), ObpSettings::default());
        let mut device = Obp::open(line, link, settings, &within()).unwrap();
        assert_eq!(device.identity(&within()).unwrap().serial.unwrap(), "HDX01042");
        [0.02, 0.06].map(|seconds| device.expose(seconds, &within()).unwrap())
    });
    let wavelengths = numbers(lines[1]);
    assert_eq!((wavelengths.len(), ours[0].wavelength_nm.len()), (2068, 2068));
    for (theirs, own) in wavelengths.iter().zip(&ours[0].wavelength_nm) {
        assert!((theirs - own).abs() < 1e-9, "{theirs} {own}");
    }
    let spectra: Vec<Vec<f64>> = lines[2..6].iter().map(|line| numbers(line)).collect();
    for (spectrum, us) in spectra.iter().zip([10_000, 20_000, 20_000, 60_000]) {
        assert!(agrees(&truth, spectrum, us), "seabreeze's spectrum of {us} µs");
    }
    for (spectrum, us) in ours.iter().zip([20_000, 60_000]) {
        assert!(agrees(&truth, &spectrum.counts, us), "our spectrum of {us} µs");
    }
}

/// Bulk transfers over a socket.
struct Bus(Tcp);

impl Transfers for Bus {
    fn transfer(
        &mut self,
        transfer: &Transfer,
        deadline: &Deadline,
    ) -> Result<Vec<u8>, TransportError> {
        match transfer {
            Transfer::BulkOut { endpoint: 0x01, data } => {
                self.0.send(data, deadline).map(|()| Vec::new())
            }
            Transfer::BulkIn { endpoint: 0x81, length } => {
                let mut buffer = vec![0; *length];
                let count = self.0.receive(&mut buffer, deadline)?;
                buffer.truncate(count);
                Ok(buffer)
            }
            other => panic!("no transfer of an HDX: {other:?}"),
        }
    }
}

/// Whether a spectrum is of the light of that integration: each pixel within six sigma of the noise that was put in.
fn agrees(truth: &Ocean, spectrum: &[f64], us: u32) -> bool {
    spectrum.len() == 2068
        && spectrum.iter().enumerate().all(|(pixel, counts)| {
            let expected = truth.expected(pixel, us).min(65_535.0);
            let sigma = (144.0 + (expected - 1500.0).max(0.0) / 10.0).sqrt();
            (counts - expected).abs() <= 6.0 * sigma + 1.0
        })
}

/// The simulated instrument goes away within a spectrum. Truth: by construction.
#[test]
fn a_connection_that_ends_is_an_error() {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let at = listener.local_addr().unwrap();
    let server = std::thread::spawn(move || {
        let (stream, _) = listener.accept().unwrap();
        let mut stream = Tcp::from_stream(stream).unwrap();
        let cancel = Cancel::new();
        let deadline = Deadline::within(Duration::from_secs(20)).with_cancel(&cancel);
        // It hangs up once it has seen the question for a spectrum.
        let device = Hangs { inner: Ocean::new(OceanSettings::default()), cancel: cancel.clone() };
        sunglint_drivers::simulated::serve(device, &mut stream, &deadline).unwrap();
    });
    let within = || Deadline::within(Duration::from_secs(20));
    let line = Tcp::connect(&at.to_string(), &within()).unwrap();
    let (link, settings) = (LinkSettings::default(), ObpSettings::default());
    let mut device = Obp::open(line, link, settings, &within()).unwrap();
    let error = device.expose(0.1, &within()).unwrap_err();
    assert!(error.to_string().contains("is gone"), "{error}");
    server.join().unwrap();
}

struct Hangs {
    inner: Ocean,
    cancel: Cancel,
}

impl sunglint_drivers::simulated::Speaker for Hangs {
    fn hear(&mut self, bytes: &[u8], now: Duration) -> Vec<(Duration, Vec<u8>)> {
        let before = self.inner.taken();
        let said = self.inner.hear(bytes, now);
        if self.inner.taken() > before {
            self.cancel.cancel();
        }
        said
    }
}
