//! Options of the virtual rig of a counting detector: the keys of its file, all with defaults.
//!
//! ```toml
//! seed = 1                      # all chance comes from here
//!
//! [lamp]
//! temperature_k = 3000          # a black body behind quartz
//! shortest_nm = 330             # below it the quartz and the air pass nothing
//! intensity_w_per_sr_nm = 3e-6  # at its peak, behind the exit slit
//! drift_per_h = 0.0             # relative
//! flicker = 0.0                 # of each reading and exposure, relative standard deviation
//! reignites_at_s = 1800         # it goes out and comes back at once, at another place; never by default
//! reignites_power = 1.0         # its power then, over that before
//! reignites_aim = 1.0           # its light on the detector over that on the photodiode then, over that before
//!
//! [monochromator]
//! bandwidth_nm = 4              # full width at half maximum of a triangle
//! second_order = 0.1            # light of half the wavelength that passes, relative to the first order
//! offset_nm = 0.0               # the light's wavelength less the one that it shows
//! step_nm = 0.01
//! speed_nm_per_s = 50
//! range_nm = [200, 1300]
//!
//! [[wheel]]                     # slots, from 1
//! cut_on_nm = 0                 # passes light above it
//! transmission = 1.0            # 0: opaque
//!
//! [photodiode]
//! wavelength_nm = [350, 400, 500, 600, 700, 800, 900, 1000, 1100]
//! responsivity_a_per_w = [0.10, 0.17, 0.28, 0.36, 0.44, 0.51, 0.56, 0.50, 0.15]
//! scale = 1.0                   # what it really is, over this table
//! settles_relative = 0.0        # its responsivity ends so much above that of the begin, relative,
//! settles_h = 1.0               # and goes there exponentially, with this time constant
//! load_ohm = 1e9
//! noise_v = 1e-4
//! zero_v = 2e-3
//! zero_drift_v_per_h = 0.0
//! reading_s = 0.1
//! most_v = 10
//! area_mm2 = 13
//! distance_mm = 150
//!
//! [sensor]
//! efficiency = 0.3              # at its peak, at the begin
//! drift_per_h = 0.0             # of that, relative
//! peak_nm = 650
//! width_nm = 180                # of a Gaussian
//! kind = "non_paralysable"      # perfect, non_paralysable, paralysable, recovery, pixels, mppc
//! dead_time_ns = 1000
//! pixels = 667                  # of "pixels" and "mppc"
//! recovery_ns = 50              # time constant, of a pixel; of "recovery" after the dead time
//! pulse_ns = 20                 # at the comparator: width of a pulse, of "mppc" time constant of its decay
//! level = 0.5                   # of the comparator of "mppc", in pulses of a full pixel
//! crosstalk = 0.0               # of "mppc": chance that an avalanche fires another pixel at once
//! afterpulse = 0.0              # chance that it leaves a charge in its own,
//! afterpulse_ns = 50            # which comes after this time constant
//! dark_hz = 300
//! transmission = 1e-2           # of what stands before it
//! area_mm2 = 0.005
//! distance_mm = 160
//!
//! [sources]                     # for the detector alone: rates that it would count without loss
//! a_hz = 0
//! b_hz = 0
//!
//! [fault]
//! unplugged_at_reading = 100    # from this reading on nothing answers
//! ```

use crate::options::{ANY, OptionError, PART, POSITIVE, SIZE, section, within};
use serde::Deserialize;
use sunglint_formats::ParseError;
use sunglint_formats::toml::Document;

/// Behaviour of a detector after an event.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Counts all.
    Perfect,
    /// Deaf after each count.
    NonParalysable,
    /// Deaf after each event.
    Paralysable,
    /// Deaf after each count, then recovering exponentially.
    Recovery,
    /// Many pixels behind one comparator, their pulses all of one width and height.
    Pixels,
    /// Many pixels whose pulses, decaying and as high as the pixel was charged, add up before one comparator.
    Mppc,
}

section!(
    /// All of it; see the module.
    Options {
        /// Seed of all chance.
        seed: u64 = 1,
        /// The lamp.
        lamp: Lamp = Lamp::default(),
        /// The monochromator.
        monochromator: Grating = Grating::default(),
        /// Slots of the filter wheel.
        wheel: Vec<Slot> = vec![
            Slot::default(),
            Slot { cut_on_nm: 550.0, transmission: 0.9 },
            Slot { cut_on_nm: 0.0, transmission: 0.0 },
        ],
        /// The photodiode.
        photodiode: Diode = Diode::default(),
        /// The detector.
        sensor: Sensor = Sensor::default(),
        /// Sources for the detector alone.
        sources: Sources = Sources::default(),
        /// Faults that occur.
        fault: Fault = Fault::default(),
    }
);

section!(
    /// The lamp.
    Lamp {
        /// Temperature of the black body, K.
        temperature_k: f64 = 3000.0,
        /// Shortest wavelength that leaves the lamp, nm.
        shortest_nm: f64 = 330.0,
        /// Radiant intensity at the black body's peak, W sr⁻¹ nm⁻¹.
        intensity_w_per_sr_nm: f64 = 3e-6,
        /// Relative change, per hour.
        drift_per_h: f64 = 0.0,
        /// Relative standard deviation of each reading and exposure.
        flicker: f64 = 0.0,
        /// When it goes out and comes back at once, s.
        reignites_at_s: Option<f64> = None,
        /// Power when it is back, over that before.
        reignites_power: f64 = 1.0,
        /// Light on the detector over that on the photodiode when it is back, over that before.
        reignites_aim: f64 = 1.0,
    }
);

section!(
    /// The monochromator.
    Grating {
        /// Full width at half maximum, nm.
        bandwidth_nm: f64 = 4.0,
        /// Second order over first order.
        second_order: f64 = 0.1,
        /// The light's wavelength less the one that is shown, nm.
        offset_nm: f64 = 0.0,
        /// Step of its motor, nm.
        step_nm: f64 = 0.01,
        /// Speed, nm s⁻¹.
        speed_nm_per_s: f64 = 50.0,
        /// Wavelengths that it reaches, nm.
        range_nm: [f64; 2] = [200.0, 1300.0],
    }
);

section!(
    /// A slot of the wheel.
    Slot {
        /// Passes light above this, nm.
        cut_on_nm: f64 = 0.0,
        /// Transmission there.
        transmission: f64 = 1.0,
    }
);

section!(
    /// The photodiode.
    Diode {
        /// Wavelengths of its responsivity, nm, increasing.
        wavelength_nm: Vec<f64> = vec![350.0, 400.0, 500.0, 600.0, 700.0, 800.0, 900.0, 1000.0, 1100.0],
        /// Responsivity, A W⁻¹.
        responsivity_a_per_w: Vec<f64> = vec![0.10, 0.17, 0.28, 0.36, 0.44, 0.51, 0.56, 0.50, 0.15],
        /// Real responsivity over that of this table.
        scale: f64 = 1.0,
        /// Responsivity long after the begin over that at the begin, less 1.
        settles_relative: f64 = 0.0,
        /// Time constant with which it goes there, h.
        settles_h: f64 = 1.0,
        /// Amplifier, V A⁻¹.
        load_ohm: f64 = 1e9,
        /// Standard deviation of a reading, V.
        noise_v: f64 = 1e-4,
        /// Reading in the dark, V.
        zero_v: f64 = 2e-3,
        /// Change of that, V h⁻¹.
        zero_drift_v_per_h: f64 = 0.0,
        /// Time of a reading, s.
        reading_s: f64 = 0.1,
        /// End of its range, V.
        most_v: f64 = 10.0,
        /// Area, mm².
        area_mm2: f64 = 13.0,
        /// Distance from the exit slit, mm.
        distance_mm: f64 = 150.0,
    }
);

section!(
    /// The detector.
    Sensor {
        /// Efficiency at its peak, at the begin.
        efficiency: f64 = 0.3,
        /// Relative change of the efficiency, per hour.
        drift_per_h: f64 = 0.0,
        /// Wavelength of the peak, nm.
        peak_nm: f64 = 650.0,
        /// Width of the Gaussian, nm.
        width_nm: f64 = 180.0,
        /// Behaviour after an event.
        kind: Kind = Kind::NonParalysable,
        /// Dead time, ns.
        dead_time_ns: f64 = 1000.0,
        /// Number of pixels.
        pixels: u32 = 667,
        /// Time constant of a pixel's recovery, ns.
        recovery_ns: f64 = 50.0,
        /// Width of a pulse at the comparator, ns; of an MPPC the time constant of its decay.
        pulse_ns: f64 = 20.0,
        /// Level of an MPPC's comparator, pulses of a full pixel.
        level: f64 = 0.5,
        /// Chance that an avalanche of an MPPC fires another pixel.
        crosstalk: f64 = 0.0,
        /// Chance that it leaves a charge that comes later.
        afterpulse: f64 = 0.0,
        /// Time constant after which that comes, ns.
        afterpulse_ns: f64 = 50.0,
        /// Events in the dark, Hz.
        dark_hz: f64 = 300.0,
        /// Transmission of what stands before it.
        transmission: f64 = 1e-2,
        /// Area, mm².
        area_mm2: f64 = 0.005,
        /// Distance from the exit slit, mm.
        distance_mm: f64 = 160.0,
    }
);

section!(
    /// Sources for the detector alone.
    Sources {
        /// Rate of source A without loss, Hz.
        a_hz: f64 = 0.0,
        /// Rate of source B without loss, Hz.
        b_hz: f64 = 0.0,
    }
);

section!(
    /// Faults.
    Fault {
        /// The first reading that is not answered.
        unplugged_at_reading: Option<u64> = None,
    }
);

impl Options {
    /// Reads the options of a document.
    ///
    /// # Errors
    /// A key that there is not, or a value that no rig can have.
    pub fn read(document: &Document) -> Result<Self, ParseError> {
        let options: Self = document.parse()?;
        options.check().map_err(|error| {
            let OptionError { key, expected, .. } = error;
            document.error_at(&key, expected)
        })?;
        Ok(options)
    }

    /// Refuses what no rig can have.
    ///
    /// # Errors
    /// The key, its value and what it may be.
    pub fn check(&self) -> Result<(), OptionError> {
        let Self { lamp, monochromator: grating, photodiode: diode, sensor, sources, .. } = self;
        for (key, value, range) in [
            ("lamp.temperature_k", lamp.temperature_k, POSITIVE),
            ("lamp.shortest_nm", lamp.shortest_nm, SIZE),
            ("lamp.intensity_w_per_sr_nm", lamp.intensity_w_per_sr_nm, SIZE),
            ("lamp.drift_per_h", lamp.drift_per_h, ANY),
            ("lamp.flicker", lamp.flicker, PART),
            ("lamp.reignites_at_s", lamp.reignites_at_s.unwrap_or(0.0), SIZE),
            ("lamp.reignites_power", lamp.reignites_power, SIZE),
            ("lamp.reignites_aim", lamp.reignites_aim, SIZE),
            ("monochromator.bandwidth_nm", grating.bandwidth_nm, POSITIVE),
            ("monochromator.second_order", grating.second_order, PART),
            ("monochromator.offset_nm", grating.offset_nm, ANY),
            ("monochromator.step_nm", grating.step_nm, POSITIVE),
            ("monochromator.speed_nm_per_s", grating.speed_nm_per_s, POSITIVE),
            ("monochromator.range_nm", grating.range_nm[0], SIZE),
            ("monochromator.range_nm", grating.range_nm[1] - grating.range_nm[0], POSITIVE),
            ("photodiode.scale", diode.scale, POSITIVE),
            (
                "photodiode.settles_relative",
                diode.settles_relative,
                (-1.0, 1e3, "a number from -1 to 1000"),
            ),
            ("photodiode.settles_h", diode.settles_h, POSITIVE),
            ("photodiode.load_ohm", diode.load_ohm, (f64::MIN_POSITIVE, 1e15, "a number above 0")),
            ("photodiode.noise_v", diode.noise_v, SIZE),
            ("photodiode.zero_v", diode.zero_v, ANY),
            ("photodiode.zero_drift_v_per_h", diode.zero_drift_v_per_h, ANY),
            ("photodiode.reading_s", diode.reading_s, POSITIVE),
            ("photodiode.most_v", diode.most_v, POSITIVE),
            ("photodiode.area_mm2", diode.area_mm2, POSITIVE),
            ("photodiode.distance_mm", diode.distance_mm, POSITIVE),
            ("sensor.efficiency", sensor.efficiency, PART),
            ("sensor.drift_per_h", sensor.drift_per_h, ANY),
            ("sensor.peak_nm", sensor.peak_nm, POSITIVE),
            ("sensor.width_nm", sensor.width_nm, POSITIVE),
            ("sensor.dead_time_ns", sensor.dead_time_ns, SIZE),
            ("sensor.pixels", f64::from(sensor.pixels), POSITIVE),
            ("sensor.recovery_ns", sensor.recovery_ns, POSITIVE),
            ("sensor.pulse_ns", sensor.pulse_ns, SIZE),
            ("sensor.level", sensor.level, POSITIVE),
            ("sensor.crosstalk", sensor.crosstalk, (0.0, 0.9, "a chance from 0 to 0.9")),
            ("sensor.afterpulse", sensor.afterpulse, (0.0, 0.9, "a chance from 0 to 0.9")),
            ("sensor.afterpulse_ns", sensor.afterpulse_ns, POSITIVE),
            ("sensor.dark_hz", sensor.dark_hz, SIZE),
            ("sensor.transmission", sensor.transmission, PART),
            ("sensor.area_mm2", sensor.area_mm2, POSITIVE),
            ("sensor.distance_mm", sensor.distance_mm, POSITIVE),
            ("sources.a_hz", sources.a_hz, SIZE),
            ("sources.b_hz", sources.b_hz, SIZE),
        ] {
            within(key, value, range)?;
        }
        for slot in &self.wheel {
            within("wheel.cut_on_nm", slot.cut_on_nm, SIZE)?;
            within("wheel.transmission", slot.transmission, PART)?;
        }
        let nm = &diode.wavelength_nm;
        let rising = nm.windows(2).all(|w| w[1] > w[0]) && !nm.is_empty();
        let good = diode.responsivity_a_per_w.iter().all(|v| (0.0..=10.0).contains(v));
        if !rising || nm.len() != diode.responsivity_a_per_w.len() || !good {
            let expected = "as many values from 0 to 10 A/W as increasing wavelengths";
            let value = nm.len() as f64;
            return Err(OptionError {
                key: "photodiode.responsivity_a_per_w".into(),
                value,
                expected,
            });
        }
        Ok(())
    }
}
