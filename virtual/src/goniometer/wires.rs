//! The virtual goniometer on lines: each of its devices behind the protocol of a maker, for programs at the other end.
//!
//! All stand on one bench: the meter sees the light of where the stages stand, whoever turned them. A program that is killed finds all as it left it. The stages are the drivers' simulated
//! ones, with their counts, their references and their times; the light is the bench's, in real time.

use super::devices::VirtualGoniometer;
use super::options::Options;
use crate::options::OptionError;
use crate::rig::meter::Shown;
use crate::rig::options::Stage;
use std::fmt::Write as _;
use std::time::Duration;
use sunglint_drivers::device::InBeam;
use sunglint_drivers::simulated::apt::{Apt, AptSettings};
use sunglint_drivers::simulated::elliptec::{Elliptec, ElliptecSettings};
use sunglint_drivers::simulated::ophir::{HeadWavelengths, Ophir, OphirSettings};
use sunglint_drivers::simulated::tmcl::{Module, ModuleSettings};
use sunglint_drivers::simulated::zaber::{Zaber, ZaberSettings};
use sunglint_drivers::simulated::{InMemory, Speaker, Turns};
use sunglint_drivers::transport::Bytes;
use sunglint_formats::toml::quoted;

/// Microsteps of the sample's stage for a degree: 200 full steps of 256 microsteps, and a gear of 10.
const TMCL_PER_DEG: f64 = 51_200.0 * 10.0 / 360.0;
/// Counts of a K10CR1 for a degree.
const APT_PER_DEG: f64 = 49_152_000.0 / 360.0;
/// Microsteps of the azimuth's stage for a degree.
const ZABER_PER_DEG: f64 = 1_000.0;
/// Pulses of an ELL14 for a degree.
const ELLIPTEC_PER_DEG: f64 = 143_360.0 / 360.0;
/// Time between two looks at where a stage is on its way: its play shows where it turned back.
const LOOK: Duration = Duration::from_millis(5);
/// Longest time that the meter takes to answer: a Vega's.
const ANSWERS: Duration = Duration::from_millis(20);

/// A device of the bench, and its line.
pub struct Wire {
    /// Name: `sample`, `detector`, `azimuth`, `turn`, `meter`, `hands`.
    pub name: &'static str,
    /// The driver that speaks to it; none speaks to the hands.
    pub driver: Option<&'static str>,
    /// Options that the driver has to be given.
    pub with: Vec<String>,
    /// The end of the line.
    pub line: Box<dyn Bytes>,
}

impl std::fmt::Debug for Wire {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Wire").field("name", &self.name).finish_non_exhaustive()
    }
}

/// A stage on the bench.
struct OnBench<D> {
    device: D,
    axis: usize,
    counts_per_deg: f64,
    bench: VirtualGoniometer,
    looked: Duration,
}

impl<D: Turns> OnBench<D> {
    fn look(&mut self, now: Duration) {
        self.looked = now;
        self.bench.stand(self.axis, self.device.place_at(now) as f64 / self.counts_per_deg);
    }
}

impl<D: Turns> Speaker for OnBench<D> {
    fn hear(&mut self, bytes: &[u8], now: Duration) -> Vec<(Duration, Vec<u8>)> {
        self.look(now);
        self.device.hear(bytes, now)
    }

    fn due(&self) -> Option<Duration> {
        let look = self.looked + LOOK;
        Some(self.device.due().map_or(look, |due| due.min(look)))
    }

    fn speak(&mut self, now: Duration) -> Vec<(Duration, Vec<u8>)> {
        self.look(now);
        if self.device.due().is_some_and(|due| due <= now) {
            self.device.speak(now)
        } else {
            vec![]
        }
    }
}

/// The meter, until its cable is out. It measures whether somebody asks or not: its range follows the light.
struct Head {
    meter: Ophir,
    bench: VirtualGoniometer,
    period: Duration,
    measured: Duration,
}

impl Speaker for Head {
    fn hear(&mut self, bytes: &[u8], now: Duration) -> Vec<(Duration, Vec<u8>)> {
        if self.bench.is_unplugged() { vec![] } else { self.meter.hear(bytes, now) }
    }

    fn due(&self) -> Option<Duration> {
        Some(self.measured + self.period)
    }

    fn speak(&mut self, now: Duration) -> Vec<(Duration, Vec<u8>)> {
        self.measured = now;
        let _ = self.meter.shown_w(now);
        vec![]
    }
}

/// Somebody who puts things into the beam: a line with a name of [`InBeam`] is done and said again; an empty line asks what is there.
struct Robot {
    bench: VirtualGoniometer,
    heard: Vec<u8>,
}

impl Robot {
    fn answer(&self, line: &str) -> String {
        let known = || InBeam::ALL.into_iter();
        match known().find(|place| place.name() == line) {
            Some(place) => self.bench.place(place),
            None if line.is_empty() => {}
            None => {
                return format!("? {}", known().map(InBeam::name).collect::<Vec<_>>().join(" "));
            }
        }
        self.bench.placed().name().to_owned()
    }
}

impl Speaker for Robot {
    fn hear(&mut self, bytes: &[u8], now: Duration) -> Vec<(Duration, Vec<u8>)> {
        /// Most bytes of a line that it remembers.
        const MOST: usize = 80;
        let mut said = Vec::new();
        for byte in bytes {
            if *byte == b'\n' {
                let line = std::mem::take(&mut self.heard);
                let answer = self.answer(String::from_utf8_lossy(&line).trim());
                said.push((now, format!("{answer}\n").into_bytes()));
            } else {
                self.heard.truncate(MOST);
                self.heard.push(*byte);
            }
        }
        said
    }
}

/// The devices of a goniometer, each at the end of a line: sample on a Trinamic module, detector on a K10CR1, azimuth on a Zaber (not where the detector's arm stands on the table), turn on an
/// Elliptec, the power on an Ophir, and the hands. Spectrometer and monochromator are not among them.
///
/// # Errors
/// Options of which no goniometer can be made.
pub fn wires(options: &Options) -> Result<Vec<Wire>, OptionError> {
    let bench = VirtualGoniometer::new(options.clone(), 0)?;
    let stage = &options.stage;
    if stage.step_deg != Stage::default().step_deg {
        return Err(OptionError {
            key: "stage.step_deg".into(),
            value: stage.step_deg,
            expected: "no such key for devices on lines: each stage has the steps of its own model",
        });
    }
    let [least, most] = stage.travel_deg;
    let counts = |deg: f64, per_deg: f64| (deg * per_deg).round() as i64;
    let stuck = |per_deg| options.fault.stuck_beyond_deg.map(|deg| counts(deg, per_deg));
    let travel = format!("travel_deg={least},{most}");
    let mut wires = Vec::new();
    let mut add = |name, driver, with: &[&str], line| {
        let with = with.iter().map(|option| (*option).to_owned()).collect();
        wires.push(Wire { name, driver, with, line });
    };

    let speed = counts(stage.speed_deg_per_s, TMCL_PER_DEG).clamp(1, i64::from(i32::MAX));
    let mut module = Module::new(ModuleSettings {
        // At most what it holds: see above.
        speed: speed as i32,
        switches: [counts(least, TMCL_PER_DEG), counts(most, TMCL_PER_DEG)],
        latency: Duration::from_millis(3),
        ..ModuleSettings::default()
    });
    module.trouble.obstacle = stuck(TMCL_PER_DEG);
    let with = ["gear=10", "trust_counter=yes", &travel];
    add("sample", Some("tmcl"), &with, on_bench(module, 0, TMCL_PER_DEG, &bench));

    let mut apt = Apt::new(AptSettings {
        speed: counts(stage.speed_deg_per_s, APT_PER_DEG).max(1),
        reference: 0,
        ..AptSettings::default()
    });
    apt.trouble.obstacle = stuck(APT_PER_DEG);
    add("detector", Some("apt"), &[&travel], on_bench(apt, 1, APT_PER_DEG, &bench));

    if !options.detector.from_lamp {
        let mut zaber = Zaber::new(ZaberSettings {
            speed: counts(stage.speed_deg_per_s, ZABER_PER_DEG).max(1),
            reference: 0,
            referenced: true,
            ..ZaberSettings::default()
        });
        zaber.set_obstacle(stuck(ZABER_PER_DEG));
        let with = ["counts_per_deg=1000", &travel];
        add("azimuth", Some("zaber"), &with, on_bench(zaber, 2, ZABER_PER_DEG, &bench));
    }

    let mut elliptec = Elliptec::new(ElliptecSettings {
        speed: counts(stage.speed_deg_per_s, ELLIPTEC_PER_DEG).max(1),
        reference: 0,
        ..ElliptecSettings::default()
    });
    elliptec.set_obstacle(stuck(ELLIPTEC_PER_DEG));
    add("turn", Some("elliptec"), &[&travel], on_bench(elliptec, 3, ELLIPTEC_PER_DEG, &bench));

    let period = Duration::from_secs_f64(options.meter.reading_s.max(1e-3));
    let nm = options.lamp.wavelength_nm;
    let light = bench.clone();
    let meter = Ophir::new(
        OphirSettings {
            update: period,
            latency: ANSWERS.min(period / 2),
            wavelengths: HeadWavelengths::Continuous {
                // Every lamp's: whole numbers of at most 20,000.
                range_nm: [nm.floor().min(350.0) as u32, nm.ceil().max(1100.0) as u32],
                slots: vec![Some(633), None],
            },
            ..OphirSettings::default()
        },
        move |at| match light.shown(at) {
            Some(Shown::Watts(power_w)) => power_w,
            // Out of every range.
            Some(Shown::Over(_)) => f64::INFINITY,
            None => 0.0,
        },
    );
    let update = format!("update_hz={}", 1.0 / period.as_secs_f64());
    let head = Head { meter, bench: bench.clone(), period, measured: Duration::ZERO };
    add("meter", Some("ophir"), &[&update], Box::new(InMemory::new(head)));
    add("hands", None, &[], Box::new(InMemory::new(Robot { bench, heard: Vec::new() })));
    Ok(wires)
}

fn on_bench<D: Turns + 'static>(
    device: D,
    axis: usize,
    counts_per_deg: f64,
    bench: &VirtualGoniometer,
) -> Box<dyn Bytes> {
    let (bench, looked) = (bench.clone(), Duration::ZERO);
    Box::new(InMemory::new(OnBench { device, axis, counts_per_deg, bench, looked }))
}

/// The file that describes the bench to a run: its devices at their addresses (name, driver's address, options), and what is known of its optics beforehand.
pub fn bench_toml(options: &Options, devices: &[(&str, String, &[String])]) -> String {
    let mut text = String::from("# A virtual goniometer on lines, by `sunglint devices serve`.\n");
    for (name, address, with) in devices {
        let table = if *name == "meter" { "meter".into() } else { format!("axis.{name}") };
        let with: Vec<String> = with.iter().map(|option| quoted(option)).collect();
        let _ = writeln!(
            text,
            "\n[{table}]\ndevice = {}\nwith = [{}]",
            quoted(address),
            with.join(", ")
        );
        if *name == "meter" {
            // The meter behind the port chooses its range by itself, which no host sees: until 3e-4 of that is left.
            let settle_s = options.meter.reading_s + 8.0 * options.meter.settling_s;
            let _ = writeln!(text, "settle_s = {settle_s:.4}");
            continue;
        }
        let _ = writeln!(text, "speed_deg_per_s = {}", options.stage.speed_deg_per_s);
        // Those that count from where they were switched on, and do not say so.
        if matches!(*name, "detector" | "turn") {
            text += "home = true\n";
        }
        if *name == "detector" && options.detector.from_lamp {
            text += "from = \"lamp\"\n";
        }
        if *name == "turn" {
            // An ELL14 rests within 0.1 degrees.
            text += "tolerance_deg = 0.1\n";
        }
    }
    let Options { lamp, beam, aperture, sample, field, .. } = options;
    let _ = write!(
        text,
        "\n[laser]\nwavelength_nm = {}\n\n[beam]\ndiameter_mm = {}\npolarised = 0\n\n[aperture]\ndiameter_mm = {}\ndistance_mm = {}\n\n[sample]\nwidth_mm = {}\nheight_mm = {}\n",
        lamp.wavelength_nm,
        beam.diameter_mm,
        aperture.diameter_mm,
        aperture.distance_mm,
        sample.width_mm,
        sample.height_mm
    );
    if let Some(diameter_mm) = field.diameter_mm {
        let _ = writeln!(text, "\n[field]\ndiameter_mm = {diameter_mm}");
    }
    text
}
