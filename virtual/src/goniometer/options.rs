//! Options of a virtual goniometer: the keys of a `goniometer.toml`, all with defaults.

use crate::options::{ANY, OptionError, PART, POSITIVE, SIZE, section, within};
use crate::rig::options::{Meter, Options as RigOptions, Sample as RigSample, SampleKind, Stage};
use sunglint_formats::ParseError;
use sunglint_formats::toml::Document;

section!(
    /// All of it.
    Options {
        /// Seed of all chance.
        seed: u64 = 1,
        /// The sample.
        sample: Sample = Sample::default(),
        /// Where the stages stand when the arms are at 0.
        zero: Zero = Zero::default(),
        /// The lamp.
        lamp: Lamp = Lamp::default(),
        /// The beam.
        beam: Beam = Beam::default(),
        /// The stop before the detector.
        aperture: Aperture = Aperture::default(),
        /// The field that the detector sees.
        field: Field = Field::default(),
        /// Stray light.
        stray: Stray = Stray::default(),
        /// The meter.
        meter: Meter = Meter { ranges_w: vec![3e-9, 3e-8, 3e-7, 3e-6, 3e-5, 3e-4, 3e-3, 3e-2], ..Meter::default() },
        /// All stages.
        stage: Stage = Stage::default(),
        /// Where the detector's stage counts from.
        detector: Detector = Detector::default(),
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
        /// Height across that, mm.
        height_mm: f64 = 50.0,
    }
);

section!(
    /// Where the stages stand when the arms are at 0, degrees.
    Zero {
        /// Reading of the sample's stage.
        sample_deg: f64 = 0.0,
        /// Reading of the detector's stage.
        detector_deg: f64 = 0.0,
        /// Reading of the azimuth's stage.
        azimuth_deg: f64 = 0.0,
    }
);

section!(
    /// The lamp.
    Lamp {
        /// Vacuum wavelength, nm.
        wavelength_nm: f64 = 632.8,
        /// Power at the sample's place at the begin, mW.
        power_mw: f64 = 2.0,
        /// Relative change of the power, per hour.
        drift_per_h: f64 = 0.0,
        /// Amplitude of a slow wave of the power, relative.
        wave: f64 = 0.0,
        /// Period of that wave, hours.
        wave_h: f64 = 1.0,
        /// Relative standard deviation of each reading.
        noise: f64 = 0.0,
    }
);

section!(
    /// The beam.
    Beam {
        /// Diameter at the sample where it has fallen to 1/e², mm.
        diameter_mm: f64 = 2.0,
        /// Standard deviation of its directions in the plane of incidence, degrees.
        spread_in_deg: f64 = 0.05,
        /// Standard deviation of its directions across it, degrees.
        spread_out_deg: f64 = 0.05,
    }
);

section!(
    /// The stop before the detector: a disc.
    Aperture {
        /// Diameter, mm.
        diameter_mm: f64 = 10.0,
        /// Distance from the sample, mm.
        distance_mm: f64 = 500.0,
    }
);

section!(
    /// The field on the sample that the detector sees.
    Field {
        /// Diameter as seen along the detector's axis, mm.
        diameter_mm: Option<f64> = None,
    }
);

section!(
    /// Stray light.
    Stray {
        /// Light from everywhere over incident power and solid angle, sr⁻¹.
        floor_per_sr: f64 = 1e-5,
        /// How much more of it there is towards the lamp, relative.
        towards_lamp: f64 = 0.0,
    }
);

section!(
    /// The detector's arm.
    Detector {
        /// True where its stage stands on the table and counts from the lamp.
        from_lamp: bool = false,
    }
);

section!(
    /// Faults that occur.
    Fault {
        /// The reading from which on the meter does not answer, from 0.
        unplugged_at_reading: Option<u64> = None,
        /// The angle past which no stage gets, degrees.
        stuck_beyond_deg: Option<f64> = None,
    }
);

impl Options {
    /// Reads a goniometer's file.
    ///
    /// # Errors
    /// Options of which no goniometer can be made, with line and key.
    pub fn read(document: &Document) -> Result<Self, ParseError> {
        let options: Self = document.parse()?;
        options.check().map_err(|e| document.error_at(&e.key, e.expected))?;
        Ok(options)
    }

    /// Looks whether there can be such a goniometer.
    ///
    /// # Errors
    /// The first key that it cannot have.
    pub fn check(&self) -> Result<(), OptionError> {
        let Self { sample, zero, lamp, beam, aperture, field, stray, .. } = self;
        let off = (-30.0, 30.0, "-30 to 30 degrees");
        let spread = (0.0, 5.0, "0 to 5 degrees");
        for (key, value, range) in [
            ("sample.height_mm", sample.height_mm, POSITIVE),
            ("zero.sample_deg", zero.sample_deg, off),
            ("zero.detector_deg", zero.detector_deg, off),
            ("zero.azimuth_deg", zero.azimuth_deg, off),
            ("lamp.wavelength_nm", lamp.wavelength_nm, (100.0, 2e4, "100 to 20000 nm")),
            ("lamp.power_mw", lamp.power_mw, POSITIVE),
            ("lamp.drift_per_h", lamp.drift_per_h, ANY),
            ("lamp.wave", lamp.wave, PART),
            ("lamp.wave_h", lamp.wave_h, POSITIVE),
            ("lamp.noise", lamp.noise, PART),
            ("beam.diameter_mm", beam.diameter_mm, POSITIVE),
            ("beam.spread_in_deg", beam.spread_in_deg, spread),
            ("beam.spread_out_deg", beam.spread_out_deg, spread),
            ("aperture.diameter_mm", aperture.diameter_mm, POSITIVE),
            ("aperture.distance_mm", aperture.distance_mm, POSITIVE),
            ("field.diameter_mm", field.diameter_mm.unwrap_or(1.0), POSITIVE),
            ("stray.floor_per_sr", stray.floor_per_sr, SIZE),
            ("stray.towards_lamp", stray.towards_lamp, SIZE),
        ] {
            within(key, value, range)?;
        }
        self.rig().check()
    }

    /// The parts that a retro-reflection rig has too: sample, meter, stage.
    pub(super) fn rig(&self) -> RigOptions {
        let mut rig = RigOptions { seed: self.seed, ..RigOptions::default() };
        rig.sample = RigSample {
            kind: self.sample.kind,
            alpha: self.sample.alpha,
            reflectance: self.sample.reflectance,
            base_reflectance: self.sample.base_reflectance,
            width_mm: self.sample.width_mm,
        };
        rig.laser.wavelength_nm = self.lamp.wavelength_nm;
        rig.laser.noise = self.lamp.noise;
        rig.meter = self.meter.clone();
        rig.stage = self.stage.clone();
        rig.fault.stuck_beyond_deg = self.fault.stuck_beyond_deg;
        rig
    }
}
