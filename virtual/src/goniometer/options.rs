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
        /// How sample and lamp change with the wavelength, where a spectrometer or a monochromator looks.
        spectrum: SpectrumOptions = SpectrumOptions::default(),
        /// The spectrometer in the meter's place.
        spectrometer: SpectrometerOptions = SpectrometerOptions::default(),
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
    /// How the light changes with the wavelength λ. At one wavelength, without spectrometer and monochromator, none of it counts.
    SpectrumOptions {
        /// Temperature of the lamp's filament, K: its power goes with Planck's law, and is that of `[lamp]` at `[lamp] wavelength_nm`.
        lamp_k: f64 = 3000.0,
        /// Middle of a band in which the sample's lobe is weaker, nm.
        band_nm: f64 = 550.0,
        /// Standard deviation of the band, nm.
        band_width_nm: f64 = 40.0,
        /// Part by which the lobe is weaker in the middle of the band.
        band_depth: f64 = 0.0,
        /// Exponent of the Lambert part's reflectance: it goes as (λ/`[lamp] wavelength_nm`) to this.
        base_exponent: f64 = 0.0,
    }
);

section!(
    /// The spectrometer.
    SpectrometerOptions {
        /// Wavelength of the first pixel, nm.
        from_nm: f64 = 400.0,
        /// Wavelength of the last pixel, nm.
        to_nm: f64 = 900.0,
        /// Number of pixels.
        pixels: u64 = 1024,
        /// Counts of a pixel at `[lamp] wavelength_nm` per second and W of the lamp at the start, with all of the beam in the detector.
        counts_per_s_per_w: f64 = 1e9,
        /// Wavelength to which the detector is most sensitive, nm.
        peak_nm: f64 = 600.0,
        /// Standard deviation of its sensitivity, nm.
        sensitive_nm: f64 = 200.0,
        /// Counts without light, at once.
        bias_counts: f64 = 1500.0,
        /// Counts per second without light.
        dark_counts_per_s: f64 = 20.0,
        /// Standard deviation of a value besides that of its electrons, counts.
        read_noise_counts: f64 = 8.0,
        /// Electrons of a count.
        electrons_per_count: f64 = 4.0,
        /// Value at which the converter ends.
        saturation_counts: f64 = 65_535.0,
        /// Shortest and longest integration, s.
        integration_s: [f64; 2] = [1e-5, 60.0],
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
        /// The reading from which on meter or spectrometer do not answer, from 0. Of a meter on a line its own readings count, which it takes all the time.
        unplugged_at_reading: Option<u64> = None,
        /// The spectrum, from 0, that lacks its second half.
        short_at_reading: Option<u64> = None,
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
        let (spectrum, device) = (&self.spectrum, &self.spectrometer);
        let nm = (100.0, 2e4, "100 to 20000 nm");
        let from_pixel = device.from_nm + 1.0;
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
            ("spectrum.lamp_k", spectrum.lamp_k, (300.0, 1e5, "300 to 100000 K")),
            ("spectrum.band_nm", spectrum.band_nm, nm),
            ("spectrum.band_width_nm", spectrum.band_width_nm, POSITIVE),
            ("spectrum.band_depth", spectrum.band_depth, PART),
            ("spectrum.base_exponent", spectrum.base_exponent, (-20.0, 20.0, "-20 to 20")),
            ("spectrometer.from_nm", device.from_nm, nm),
            (
                "spectrometer.to_nm",
                device.to_nm,
                (from_pixel, 2e4, "at least 1 nm more than from_nm, up to 20000"),
            ),
            ("spectrometer.pixels", device.pixels as f64, (2.0, 1e5, "2 to 100000")),
            (
                "spectrometer.counts_per_s_per_w",
                device.counts_per_s_per_w,
                (1e-9, 1e18, "1e-9 to 1e18"),
            ),
            ("spectrometer.peak_nm", device.peak_nm, nm),
            ("spectrometer.sensitive_nm", device.sensitive_nm, POSITIVE),
            ("spectrometer.bias_counts", device.bias_counts, SIZE),
            ("spectrometer.dark_counts_per_s", device.dark_counts_per_s, SIZE),
            ("spectrometer.read_noise_counts", device.read_noise_counts, SIZE),
            ("spectrometer.electrons_per_count", device.electrons_per_count, POSITIVE),
            ("spectrometer.saturation_counts", device.saturation_counts, (2.0, 1e12, "2 to 1e12")),
            (
                "spectrometer.integration_s[0]",
                device.integration_s[0],
                (1e-6, 3600.0, "1e-6 to 3600 s"),
            ),
            (
                "spectrometer.integration_s[1]",
                device.integration_s[1],
                (device.integration_s[0], 3600.0, "at least the shortest, up to 3600 s"),
            ),
            ("meter.reading_s", self.meter.reading_s, (1e-3, 100.0, "0.001 to 100 s")),
            ("stage.step_deg", self.stage.step_deg, POSITIVE),
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
