//! Options of a virtual rig: the keys of a `rig.toml`, all with defaults.
//!
//! ```toml
//! seed = 1                    # all chance comes from here
//!
//! [sample]
//! kind = "ggx"                # ggx, beckmann, lambert, mirror
//! alpha = 0.1                 # of ggx and beckmann
//! reflectance = 0.8           # F0 of microfacets; of a Lambert sample and a mirror what they reflect in all
//! base_reflectance = 0.0      # a Lambert part besides
//! width_mm = 50               # in the plane of incidence; beside it is the holder
//!
//! [mount]
//! offset_deg = 0.0            # the stage's angle at normal incidence
//! holder_reflectance = 0.05   # of what the beam meets beside the sample
//!
//! [laser]
//! wavelength_nm = 632.8
//! power_mw = 2.0              # at the sample's place, at the begin
//! drift_per_h = 0.0           # relative
//! noise = 0.0                 # of each reading, relative standard deviation
//!
//! [beam]
//! diameter_mm = 1.0           # where a Gaussian beam has fallen to 1/e^2
//!
//! [stop]                      # what limits the light that reaches the meter: the plate of the beam splitter
//! width_mm = 10.0             # along the direction in which it is tilted
//! height_mm = 7.0             # or a disc: diameter_mm
//! tilt_deg = 45               # between its normal and the beam
//! distance_mm = 700           # from the sample
//!
//! [optics]
//! splitter_reflectance = 0.5
//! lens_transmission = 0.95
//! stray = 1e-7                # of the laser's power, on the meter, without a sample
//! stray_slope_per_deg = 0.0   # how that changes with the stage's angle, relative
//!
//! [meter]
//! ranges_w = [3e-8, 3e-7, 3e-6, 3e-5, 3e-4, 3e-3, 3e-2]
//! offset_w = 0.0
//! noise_of_range = 0.0        # standard deviation over the end of the range
//! steps_of_range = 1e5        # digits: the range in so many steps
//! reading_s = 0.1
//! settling_s = 0.2            # time constant after a change of range
//! settling_error = 0.2        # relative, just after it
//! spike_probability = 0.0     # of a reading that is wrong
//! spike_factor = 3.0          # by this
//!
//! [stage]
//! step_deg = 0.002
//! backlash_deg = 0.0          # play: the sample stays behind by it on the way down
//! speed_deg_per_s = 20
//! travel_deg = [-180, 180]
//!
//! [standard]
//! reflectance = 0.99          # of the Lambert standard in the sample's place
//!
//! [fault]
//! unplugged_at_reading = 100  # from this reading on the meter does not answer
//! stuck_beyond_deg = 30       # the stage does not get past this angle
//! ```

use crate::options::{ANY, OptionError, PART, POSITIVE, SIZE, section, within};
use serde::Deserialize;
use sunglint_formats::ParseError;
use sunglint_formats::toml::Document;

/// Reflection law of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SampleKind {
    /// Microfacets with GGX slopes.
    Ggx,
    /// Microfacets with Gaussian slopes.
    Beckmann,
    /// The same in every direction.
    Lambert,
    /// A mirror.
    Mirror,
}

section!(
    /// All of it; see the module.
    Options {
        /// Seed of all chance.
        seed: u64 = 1,
        /// The sample.
        sample: Sample = Sample::default(),
        /// Mount of the sample.
        mount: Mount = Mount::default(),
        /// The laser.
        laser: Laser = Laser::default(),
        /// Beam.
        beam: Beam = Beam::default(),
        /// The stop that limits the cone.
        stop: Stop = Stop::default(),
        /// Optics between sample and meter.
        optics: Optics = Optics::default(),
        /// The meter.
        meter: Meter = Meter::default(),
        /// The stage.
        stage: Stage = Stage::default(),
        /// The standard.
        standard: Standard = Standard::default(),
        /// Faults that occur.
        fault: Fault = Fault::default(),
    }
);

section!(
    /// The sample.
    Sample {
        /// Reflection law.
        kind: SampleKind = SampleKind::Ggx,
        /// Roughness of microfacets.
        alpha: f64 = 0.1,
        /// F₀, or what is reflected in all.
        reflectance: f64 = 0.8,
        /// Reflectance of a Lambert part besides.
        base_reflectance: f64 = 0.0,
        /// Width in the plane of incidence, mm.
        width_mm: f64 = 50.0,
    }
);

section!(
    /// Mount of the sample.
    Mount {
        /// The stage's angle at normal incidence, degrees.
        offset_deg: f64 = 0.0,
        /// Reflectance of what is beside the sample.
        holder_reflectance: f64 = 0.05,
    }
);

section!(
    /// The laser.
    Laser {
        /// Vacuum wavelength, nm.
        wavelength_nm: f64 = 632.8,
        /// Power at the sample's place at the begin, mW.
        power_mw: f64 = 2.0,
        /// Relative change of the power, per hour.
        drift_per_h: f64 = 0.0,
        /// Relative standard deviation of each reading.
        noise: f64 = 0.0,
    }
);

section!(
    /// The beam at the sample.
    Beam {
        /// Diameter where a Gaussian beam has fallen to 1/e², mm.
        diameter_mm: f64 = 1.0,
    }
);

section!(
    /// The stop that limits the light that reaches the meter.
    Stop {
        /// Width of a rectangle along the direction in which it is tilted, mm.
        width_mm: f64 = 10.0,
        /// Height across that, mm.
        height_mm: f64 = 7.0,
        /// Diameter of a disc in its place, mm.
        diameter_mm: Option<f64> = None,
        /// Angle between its normal and the beam, degrees.
        tilt_deg: f64 = 45.0,
        /// Distance from the sample along the beam, mm.
        distance_mm: f64 = 700.0,
    }
);

section!(
    /// Optics between sample and meter.
    Optics {
        /// Reflectance of the beam splitter at the laser's polarisation.
        splitter_reflectance: f64 = 0.5,
        /// Transmission of the lens.
        lens_transmission: f64 = 0.95,
        /// Part of the laser's power that reaches the meter without a sample.
        stray: f64 = 1e-7,
        /// Relative change of that with the stage's angle, per degree.
        stray_slope_per_deg: f64 = 0.0,
    }
);

section!(
    /// The meter.
    Meter {
        /// Ends of the ranges, W, increasing.
        ranges_w: Vec<f64> = vec![3e-8, 3e-7, 3e-6, 3e-5, 3e-4, 3e-3, 3e-2],
        /// Reading in the dark, W.
        offset_w: f64 = 0.0,
        /// Standard deviation over the end of the range.
        noise_of_range: f64 = 0.0,
        /// Steps in a range.
        steps_of_range: f64 = 1e5,
        /// Time of a reading, s.
        reading_s: f64 = 0.1,
        /// Time constant after a change of range, s.
        settling_s: f64 = 0.2,
        /// Relative error just after a change of range.
        settling_error: f64 = 0.2,
        /// Probability of a reading that is wrong.
        spike_probability: f64 = 0.0,
        /// The factor by which it is.
        spike_factor: f64 = 3.0,
    }
);

section!(
    /// The stage.
    Stage {
        /// The motor's step, degrees.
        step_deg: f64 = 0.002,
        /// Play, degrees.
        backlash_deg: f64 = 0.0,
        /// Speed, degrees per second.
        speed_deg_per_s: f64 = 20.0,
        /// Angles between which it turns, degrees.
        travel_deg: [f64; 2] = [-180.0, 180.0],
    }
);

section!(
    /// A Lambert standard.
    Standard {
        /// Reflectance.
        reflectance: f64 = 0.99,
    }
);

section!(
    /// Faults that occur.
    Fault {
        /// The reading from which on the meter does not answer, from 0.
        unplugged_at_reading: Option<u64> = None,
        /// The angle past which the stage does not get, degrees.
        stuck_beyond_deg: Option<f64> = None,
    }
);

impl Options {
    /// Reads a rig's file.
    ///
    /// # Errors
    /// Options of which no rig can be made, with line and key.
    pub fn read(document: &Document) -> Result<Self, ParseError> {
        let options: Self = document.parse()?;
        options.check().map_err(|e| document.error_at(&e.key, e.expected))?;
        Ok(options)
    }

    /// Looks whether there can be such a rig.
    ///
    /// # Errors
    /// The first key that no rig can have.
    pub fn check(&self) -> Result<(), OptionError> {
        let Self { sample, mount, laser, stop, optics, meter, stage, fault, .. } = self;
        let [from, to] = stage.travel_deg;
        let checks = [
            ("sample.alpha", sample.alpha, (1e-4, 2.0, "a roughness from 1e-4 to 2")),
            ("sample.reflectance", sample.reflectance, (0.0, 5.0, "0 to 5 (F0 may exceed 1)")),
            ("sample.base_reflectance", sample.base_reflectance, PART),
            ("sample.width_mm", sample.width_mm, POSITIVE),
            ("mount.offset_deg", mount.offset_deg, (-30.0, 30.0, "-30 to 30 degrees")),
            ("mount.holder_reflectance", mount.holder_reflectance, PART),
            ("laser.wavelength_nm", laser.wavelength_nm, (100.0, 2e4, "100 to 20000 nm")),
            ("laser.power_mw", laser.power_mw, POSITIVE),
            ("laser.drift_per_h", laser.drift_per_h, ANY),
            ("laser.noise", laser.noise, PART),
            ("beam.diameter_mm", self.beam.diameter_mm, POSITIVE),
            ("stop.width_mm", stop.width_mm, POSITIVE),
            ("stop.height_mm", stop.height_mm, POSITIVE),
            ("stop.diameter_mm", stop.diameter_mm.unwrap_or(1.0), POSITIVE),
            ("stop.tilt_deg", stop.tilt_deg, (-80.0, 80.0, "-80 to 80 degrees")),
            ("stop.distance_mm", stop.distance_mm, POSITIVE),
            ("optics.splitter_reflectance", optics.splitter_reflectance, PART),
            ("optics.lens_transmission", optics.lens_transmission, PART),
            ("optics.stray", optics.stray, PART),
            ("optics.stray_slope_per_deg", optics.stray_slope_per_deg, ANY),
            ("meter.offset_w", meter.offset_w, ANY),
            ("meter.noise_of_range", meter.noise_of_range, PART),
            ("meter.steps_of_range", meter.steps_of_range, (10.0, 1e12, "10 to 1e12 steps")),
            ("meter.reading_s", meter.reading_s, POSITIVE),
            ("meter.settling_s", meter.settling_s, SIZE),
            ("meter.settling_error", meter.settling_error, PART),
            ("meter.spike_probability", meter.spike_probability, PART),
            ("meter.spike_factor", meter.spike_factor, SIZE),
            ("stage.step_deg", stage.step_deg, POSITIVE),
            ("stage.backlash_deg", stage.backlash_deg, (0.0, 10.0, "0 to 10 degrees")),
            ("stage.speed_deg_per_s", stage.speed_deg_per_s, POSITIVE),
            ("stage.travel_deg", to, (from, 1e6, "the end of the travel after its begin")),
            ("standard.reflectance", self.standard.reflectance, PART),
            ("fault.stuck_beyond_deg", fault.stuck_beyond_deg.unwrap_or(0.0), ANY),
        ];
        for (key, value, range) in checks {
            within(key, value, range)?;
        }
        let ranges = &meter.ranges_w;
        let bad = ranges.iter().find(|end| !(end.is_finite() && **end > 0.0)).copied();
        let falls = ranges.windows(2).find(|pair| pair[1] <= pair[0]).map(|pair| pair[1]);
        let none = ranges.is_empty().then_some(f64::NAN);
        match none.or(bad).or(falls) {
            None => Ok(()),
            Some(value) => {
                let expected = "ends of ranges above 0, each above the one before";
                Err(OptionError { key: "meter.ranges_w".into(), value, expected })
            }
        }
    }
}
