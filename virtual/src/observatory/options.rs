//! Options of a virtual night: the keys of a `virtual.toml`, all with defaults.
//!
//! ```toml
//! seed = 1                            # all chance comes from here
//!
//! [plan]                              # without [[visit]]: stars one after the other, sky beside each, dark at both ends
//! stars = 25
//! visit_s = 240                       # on a star
//! sky_s = 40                          # beside it
//! slew_s = 20                         # on the way to it
//! dark_s = 120                        # shutter closed, at the begin and at the end
//! v_mag = [0.0, 4.5]
//! altitude_deg = [25, 80]
//!
//! [stars]
//! scatter = 0.03                      # how far their true light is off the catalogue's, standard deviation of ln, all channels alike
//! channel_scatter = 0.0               # the same, each channel for itself
//! dimmed = 5                          # so many of them are fainter,
//! dimmed_to = [0.2, 0.7]              # by factors in this range
//!
//! [air]
//! aerosol_depth = 0.0                 # at 550 nm, which the reduction is not told of
//! aerosol_exponent = 1.3
//!
//! [sky]
//! v_mag_per_arcsec2 = 20.5            # at the night's begin
//! gradient_per_px = [0.0002, -0.0001]
//! change_mag_per_h = 0.0              # evenly, in magnitudes: below 0 it grows brighter; twilight has 15 and more
//! change_of_colour_per_h = 0.0        # of the exponent of λ/550 nm by which its light differs from the Sun's
//! scatter = 0.0                       # standard deviation of ln of its brightness about that: thin clouds
//! time_s = 60                         # and their correlation time
//!
//! [seeing]
//! fwhm_arcsec = 2.5                   # at the zenith; grows with airmass^0.6
//! moffat_beta = 3.0                   # without it a normal distribution
//! scatter = 0.1                       # standard deviation of its logarithm
//! time_s = 60
//!
//! [scintillation]
//! strength = 1.5                      # C_Y of Young's law as revised by Osborn et al. 2015; 0 for none
//! time_s = 0.03                       # correlation time
//!
//! [pointing]
//! jitter_px = 2.0                     # in each axis
//! jitter_time_s = 20
//! aim_px = [-2.0, 8.0]                # from the middle of the sensor; without it the middle of the fibres
//! aim_scatter_px = 2.0                # of each visit
//!
//! [clouds]
//! depth = 0.0                         # mean and scatter of their optical depth; below 0 the sky is clear
//! scatter = 0.0
//! time_s = 600
//!
//! [camera]
//! bias_adu = 300
//! response_scatter = 0.005
//! hot_fraction = 0.002
//! hot_e_per_s = 300
//! cold_fraction = 0.0005
//! dead_fraction = 0.0002
//! temperature_c = -10
//! latency_s = 0.0                     # from the time that it says to the exposure's begin
//! latency_jitter_s = 0.0              # standard deviation of that, of each frame
//! readout_s = 0.0                     # from the exposure's end to the frame
//! row_time_s = 0.0                    # rolling shutter: each row begins so much after the one before
//!
//! [lamp]                              # flashes over the whole sensor and on every counter, whatever the shutter of a visit
//! e_per_px_s = 0                      # electrons in each pixel
//! hz = 0                              # counts
//! on_s = 0.05                         # length of a flash
//! gaps_s = [0.7, 1.1, 0.5, 1.3]       # from begin to begin, in turn; unequal, so that no shift fits but one
//!
//! [passing]
//! streaks_per_h = 2.0                 # over the whole frame
//! streak_e_per_px = 300
//! cosmic_rays_per_mpx_s = 0.01
//! cosmic_ray_e_per_px = 1500
//!
//! [kappa]                             # true coefficients; without them the station's typical ones
//! spcm = 29.64
//!
//! [counter.mppc]                      # in place of the station's
//! dead_time_model = "multi_pixel"     # none, non_paralysable, paralysable, exponential_recovery
//! pixels = 1000
//! dead_time_ns = 100
//! afterpulse_probability = 0.01
//! afterpulse_time_ns = 50
//!
//! [mount]                             # where the plan has a [mount]: then it decides where the target stands, and not [pointing]
//! equatorial = false                  # azimuth and altitude without
//! past_meridian_deg = 10.0            # a German mount, which stands still so far past the meridian; a fork without
//! fastest_deg_s = 10.0
//! acceleration_deg_s2 = 10.0
//! backlash_arcsec = 10.0
//! periodic_arcsec = 2.0               # amplitude of the worm's error, which repeats each
//! worm_deg = 2.0
//! encoder_arcsec = 0.3                # noise of its readings
//! tilt_arcsec = 60.0                  # of the first axis
//! wind_arcsec = 0.6
//! latency_s = 0.2                     # from a command to its effect
//! latency_jitter_s = 0.02
//! dropped = 0.0                       # part of the commands that are lost
//! camera_angle_deg = 0.0              # turn of the camera, as the plan's `camera_angle_deg`
//! camera_mirrored = false
//! late_s = 0.0                        # satellites come so much later than their elements say,
//! across_arcsec = 0.0                 # and so far beside their track
//!
//! [[visit]]                           # in place of [plan]
//! kind = "star"                       # star, satellite, sky, dark
//! name = "Vega"
//! from_s = 60                         # from the night's begin
//! to_s = 300
//! ```

use super::events::{Afterpulsing, DeadTime};
use crate::options::{ANY, OptionError, PART, POSITIVE, SIZE, section, within};
use serde::Deserialize;
use std::collections::BTreeMap;

section!(
    /// All of it; see the module.
    Options {
        /// Seed of all chance.
        seed: u64 = 1,
        /// Stars of the plan, and the time on each.
        plan: PlanOptions = PlanOptions::default(),
        /// Differences of stars from their catalogue.
        stars: StarOptions = StarOptions::default(),
        /// Properties of the air that the station's file does not say.
        air: AirOptions = AirOptions::default(),
        /// The sky's own light.
        sky: SkyOptions = SkyOptions::default(),
        /// Point spread.
        seeing: SeeingOptions = SeeingOptions::default(),
        /// Scintillation of stars.
        scintillation: ScintillationOptions = ScintillationOptions::default(),
        /// Jitter of the telescope.
        pointing: PointingOptions = PointingOptions::default(),
        /// Clouds, which dim everything.
        clouds: CloudOptions = CloudOptions::default(),
        /// The camera's faults.
        camera: CameraOptions = CameraOptions::default(),
        /// A lamp for the camera's times.
        lamp: LampOptions = LampOptions::default(),
        /// Objects and particles that pass by.
        passing: PassingOptions = PassingOptions::default(),
        /// True coefficients by channel: predicted = κ × arriving. The station's typical ones for those that are missing, else 1.
        kappa: BTreeMap<String, f64> = BTreeMap::new(),
        /// Counters by channel, in place of the station's.
        counter: BTreeMap<String, CounterOptions> = BTreeMap::new(),
        /// The mount, where a plan has one.
        mount: MountOptions = MountOptions::default(),
        /// Visits in place of the plan.
        visit: Vec<VisitOptions> = Vec::new(),
    }
);

section!(
    /// Stars one after the other, each with the sky beside it.
    PlanOptions {
        /// Number of stars.
        stars: usize = 25,
        /// On a star, s.
        visit_s: f64 = 240.0,
        /// Beside it, s.
        sky_s: f64 = 40.0,
        /// On the way to it, s.
        slew_s: f64 = 20.0,
        /// In the dark at the begin and at the end, s.
        dark_s: f64 = 120.0,
        /// Range of Johnson V, mag.
        v_mag: [f64; 2] = [0.0, 4.5],
        /// Range of altitudes, degrees.
        altitude_deg: [f64; 2] = [25.0, 80.0],
    }
);

section!(
    /// Differences of stars from their catalogue.
    StarOptions {
        /// Standard deviation of ln(true/catalogue), the same for all channels of a star.
        scatter: f64 = 0.03,
        /// The same for each channel of a star on its own.
        channel_scatter: f64 = 0.0,
        /// Number of stars that are dimmed.
        dimmed: usize = 5,
        /// The range of the factors by which they are.
        dimmed_to: [f64; 2] = [0.2, 0.7],
    }
);

section!(
    /// Properties of the air that the station's file does not say.
    AirOptions {
        /// Vertical optical depth of the aerosol at 550 nm.
        aerosol_depth: f64 = 0.0,
        /// Ångström exponent.
        aerosol_exponent: f64 = 1.3,
    }
);

section!(
    /// The sky's own light, of the Sun's colour.
    SkyOptions {
        /// Johnson V of a square arcsecond, mag.
        v_mag_per_arcsec2: f64 = 20.5,
        /// Relative gradient of brightness a pixel to the right and a pixel down, as fractions.
        gradient_per_px: [f64; 2] = [2e-4, -1e-4],
        /// Change of its brightness, mag/h; below 0 it grows brighter.
        change_mag_per_h: f64 = 0.0,
        /// Change of the exponent of λ/550 nm by which its light differs from the Sun's, 1/h.
        change_of_colour_per_h: f64 = 0.0,
        /// Standard deviation of the logarithm of its brightness about that.
        scatter: f64 = 0.0,
        /// Correlation time of that, s.
        time_s: f64 = 60.0,
    }
);

section!(
    /// Point spread.
    SeeingOptions {
        /// Full width at half maximum at the zenith, arcsec; it grows with airmass^0.6.
        fwhm_arcsec: f64 = 2.5,
        /// β of a Moffat profile; a normal distribution without it.
        moffat_beta: Option<f64> = Some(3.0),
        /// Standard deviation of the logarithm of the width.
        scatter: f64 = 0.1,
        /// Correlation time, s.
        time_s: f64 = 60.0,
    }
);

section!(
    /// How stars twinkle: σ²(1 s) = 1e−5 C² D^(−4/3) X³ e^(−2h/8000 m) (Young 1967; Osborn et al. 2015), log-normal.
    ScintillationOptions {
        /// C, m^(2/3) s^(1/2); 0 for none.
        strength: f64 = 1.5,
        /// Correlation time, s.
        time_s: f64 = 0.03,
    }
);

section!(
    /// Jitter of the telescope.
    PointingOptions {
        /// Standard deviation in each axis, px.
        jitter_px: f64 = 2.0,
        /// Correlation time, s.
        jitter_time_s: f64 = 20.0,
        /// Where targets are meant to stand, px from the middle of the sensor; without it the middle of the fibres.
        aim_px: Option<[f64; 2]> = None,
        /// Standard deviation of the aim of a visit in each axis, px.
        aim_scatter_px: f64 = 2.0,
    }
);

section!(
    /// Clouds: transmission e^(−τ), τ = depth + scatter × a wandering number, at least 0.
    CloudOptions {
        /// Mean optical depth.
        depth: f64 = 0.0,
        /// Standard deviation.
        scatter: f64 = 0.0,
        /// Correlation time, s.
        time_s: f64 = 600.0,
    }
);

section!(
    /// The camera's faults.
    CameraOptions {
        /// Bias of the converter (its value without a signal), ADU.
        bias_adu: f64 = 300.0,
        /// Relative standard deviation of the pixels' response.
        response_scatter: f64 = 0.005,
        /// The part of the pixels that are hot.
        hot_fraction: f64 = 0.002,
        /// Mean dark current of a hot pixel, e/s.
        hot_e_per_s: f64 = 300.0,
        /// The part of the pixels that answer half.
        cold_fraction: f64 = 5e-4,
        /// The part of the pixels that answer nothing.
        dead_fraction: f64 = 2e-4,
        /// Temperature of the sensor, °C.
        temperature_c: f64 = -10.0,
        /// Mean time from the begin that it says to the exposure's own, s.
        latency_s: f64 = 0.0,
        /// Standard deviation of that time from frame to frame, s. It is never below 0.
        latency_jitter_s: f64 = 0.0,
        /// Time from the exposure's end to the frame, s.
        readout_s: f64 = 0.0,
        /// Time by which each row of the frame begins after the one before, s.
        row_time_s: f64 = 0.0,
    }
);

section!(
    /// A lamp that flashes over the whole sensor and on every counter.
    LampOptions {
        /// Electrons in each pixel while it is on, 1/s.
        e_per_px_s: f64 = 0.0,
        /// Photons that every counter would count without dead time while it is on, Hz.
        hz: f64 = 0.0,
        /// Length of a flash, s.
        on_s: f64 = 0.05,
        /// Times from a flash's begin to the next one's, s, in turn.
        gaps_s: Vec<f64> = vec![0.7, 1.1, 0.5, 1.3],
    }
);

section!(
    /// Objects and particles that pass by.
    PassingOptions {
        /// Streaks over the whole frame in an hour.
        streaks_per_h: f64 = 2.0,
        /// Median electrons on a pixel's length of a streak.
        streak_e_per_px: f64 = 300.0,
        /// Cosmic rays per second on a million pixels.
        cosmic_rays_per_mpx_s: f64 = 0.01,
        /// Median electrons on a pixel's length of a track.
        cosmic_ray_e_per_px: f64 = 1500.0,
    }
);

section!(
    /// A counter in place of the station's; what is not given is the station's.
    CounterOptions {
        /// Dead time.
        dead_time_model: Option<DeadTimeModel> = None,
        /// τ, ns.
        dead_time_ns: f64 = 0.0,
        /// τ_r of the exponential recovery, ns.
        recovery_ns: f64 = 0.0,
        /// Pixels of a counter of many.
        pixels: u32 = 1,
        /// Dark events, Hz.
        dark_rate_hz: Option<f64> = None,
        /// Probability of an afterpulse.
        afterpulse_probability: f64 = 0.0,
        /// Mean time after the count at which it comes, ns.
        afterpulse_time_ns: f64 = 50.0,
    }
);

/// The name of a dead time's kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs)]
pub enum DeadTimeModel {
    None,
    NonParalysable,
    Paralysable,
    ExponentialRecovery,
    MultiPixel,
}

/// Kind of a visit's target.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum VisitKind {
    /// A star of the catalogue.
    Star,
    /// A target with a rate curve of its own.
    Satellite,
    /// The sky without a target.
    Sky,
    /// Nothing: the shutter is closed.
    Dark,
}

/// A visit as a file has it.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VisitOptions {
    /// Kind of the target.
    pub kind: VisitKind,
    /// Name: a star's as the catalogue finds it.
    #[serde(default)]
    pub name: String,
    /// From when on, s from the night's begin.
    pub from_s: f64,
    /// Until when, s from the night's begin.
    pub to_s: f64,
    /// A predicted light curve of a satellite, ECSV.
    pub curve: Option<String>,
}

impl CounterOptions {
    /// The dead time that it names.
    pub fn dead_time(&self) -> Option<DeadTime> {
        let dead_time_s = self.dead_time_ns * 1e-9;
        Some(match self.dead_time_model? {
            DeadTimeModel::None => DeadTime::None,
            DeadTimeModel::NonParalysable => DeadTime::NonParalysable { dead_time_s },
            DeadTimeModel::Paralysable => DeadTime::Paralysable { dead_time_s },
            DeadTimeModel::ExponentialRecovery => {
                DeadTime::ExponentialRecovery { dead_time_s, recovery_s: self.recovery_ns * 1e-9 }
            }
            DeadTimeModel::MultiPixel => DeadTime::MultiPixel { pixels: self.pixels, dead_time_s },
        })
    }

    /// The afterpulses that it names.
    pub fn afterpulsing(&self) -> Option<Afterpulsing> {
        let Self { afterpulse_probability: probability, afterpulse_time_ns, .. } = *self;
        (probability > 0.0)
            .then_some(Afterpulsing { probability, time_constant_s: afterpulse_time_ns * 1e-9 })
    }
}

section!(
    /// The mount.
    MountOptions {
        /// Whether its axes are those of the sky; azimuth and altitude else.
        equatorial: bool = false,
        /// A German mount, which stands still so far past the meridian, deg of hour angle.
        past_meridian_deg: Option<f64> = None,
        /// Fastest rate of both axes, deg/s.
        fastest_deg_s: f64 = 10.0,
        /// Strongest acceleration, deg/s².
        acceleration_deg_s2: f64 = 10.0,
        /// Backlash of each gear, arcsec.
        backlash_arcsec: f64 = 10.0,
        /// Amplitude of the worm's error, arcsec.
        periodic_arcsec: f64 = 2.0,
        /// Turn of an axis in which that error repeats, deg.
        worm_deg: f64 = 2.0,
        /// Noise of an encoder's reading, arcsec.
        encoder_arcsec: f64 = 0.3,
        /// Tilt of the first axis, arcsec.
        tilt_arcsec: f64 = 60.0,
        /// Shaking by the wind, arcsec rms on each axis.
        wind_arcsec: f64 = 0.6,
        /// Time from a command to its effect, s.
        latency_s: f64 = 0.2,
        /// Jitter of that time (1 σ), s.
        latency_jitter_s: f64 = 0.02,
        /// Part of the commands that are lost.
        dropped: f64 = 0.0,
        /// Turn of the camera, deg.
        camera_angle_deg: f64 = 0.0,
        /// Whether the camera's columns run the other way.
        camera_mirrored: bool = false,
        /// Time by which satellites come later than their elements say, s.
        late_s: f64 = 0.0,
        /// Distance of satellites from their track, arcsec.
        across_arcsec: f64 = 0.0,
    }
);

impl Options {
    /// Refuses what no night can be.
    ///
    /// # Errors
    /// The first key with a value that is not finite or out of its range.
    pub fn check(&self) -> Result<(), OptionError> {
        let Self { plan, stars, air, sky, seeing, scintillation, pointing, clouds, .. } = self;
        let (camera, passing) = (&self.camera, &self.passing);
        let aim = pointing.aim_px.unwrap_or([0.0; 2]);
        let checks = [
            ("plan.visit_s", plan.visit_s, POSITIVE),
            ("plan.sky_s", plan.sky_s, SIZE),
            ("plan.slew_s", plan.slew_s, SIZE),
            ("plan.dark_s", plan.dark_s, SIZE),
            ("plan.v_mag", plan.v_mag[0], ANY),
            ("plan.v_mag", plan.v_mag[1], ANY),
            ("plan.altitude_deg", plan.altitude_deg[0], ANY),
            ("plan.altitude_deg", plan.altitude_deg[1], ANY),
            ("stars.scatter", stars.scatter, PART),
            ("stars.channel_scatter", stars.channel_scatter, PART),
            ("stars.dimmed_to", stars.dimmed_to[0], PART),
            (
                "stars.dimmed_to",
                stars.dimmed_to[1],
                (stars.dimmed_to[0], 1.0, "at least the first, at most 1"),
            ),
            ("air.aerosol_depth", air.aerosol_depth, SIZE),
            ("air.aerosol_exponent", air.aerosol_exponent, ANY),
            ("sky.v_mag_per_arcsec2", sky.v_mag_per_arcsec2, (0.0, 60.0, "0 to 60 mag")),
            ("sky.gradient_per_px", sky.gradient_per_px[0], ANY),
            ("sky.gradient_per_px", sky.gradient_per_px[1], ANY),
            ("sky.change_mag_per_h", sky.change_mag_per_h, (-60.0, 60.0, "-60 to 60 mag/h")),
            (
                "sky.change_of_colour_per_h",
                sky.change_of_colour_per_h,
                (-60.0, 60.0, "-60 to 60 per hour"),
            ),
            ("sky.scatter", sky.scatter, PART),
            ("sky.time_s", sky.time_s, POSITIVE),
            ("seeing.fwhm_arcsec", seeing.fwhm_arcsec, POSITIVE),
            ("seeing.moffat_beta", seeing.moffat_beta.unwrap_or(2.0), (1.1, 100.0, "1.1 to 100")),
            ("seeing.scatter", seeing.scatter, PART),
            ("seeing.time_s", seeing.time_s, POSITIVE),
            ("scintillation.strength", scintillation.strength, SIZE),
            ("scintillation.time_s", scintillation.time_s, POSITIVE),
            ("pointing.jitter_px", pointing.jitter_px, SIZE),
            ("pointing.jitter_time_s", pointing.jitter_time_s, POSITIVE),
            ("pointing.aim_px", aim[0], ANY),
            ("pointing.aim_px", aim[1], ANY),
            ("pointing.aim_scatter_px", pointing.aim_scatter_px, SIZE),
            ("clouds.depth", clouds.depth, ANY),
            ("clouds.scatter", clouds.scatter, SIZE),
            ("clouds.time_s", clouds.time_s, POSITIVE),
            ("camera.bias_adu", camera.bias_adu, SIZE),
            ("camera.response_scatter", camera.response_scatter, PART),
            ("camera.hot_fraction", camera.hot_fraction, PART),
            ("camera.hot_e_per_s", camera.hot_e_per_s, SIZE),
            ("camera.cold_fraction", camera.cold_fraction, PART),
            ("camera.dead_fraction", camera.dead_fraction, PART),
            ("camera.temperature_c", camera.temperature_c, (-273.15, 100.0, "-273.15 to 100 °C")),
            ("camera.latency_s", camera.latency_s, (0.0, 10.0, "0 to 10 s")),
            ("camera.latency_jitter_s", camera.latency_jitter_s, (0.0, 1.0, "0 to 1 s")),
            ("camera.readout_s", camera.readout_s, (0.0, 60.0, "0 to 60 s")),
            ("camera.row_time_s", camera.row_time_s, (0.0, 0.1, "0 to 0.1 s")),
            ("lamp.e_per_px_s", self.lamp.e_per_px_s, SIZE),
            ("lamp.hz", self.lamp.hz, SIZE),
            ("lamp.on_s", self.lamp.on_s, (1e-6, 1e6, "1e-6 to 1e6 s")),
            ("passing.streaks_per_h", passing.streaks_per_h, SIZE),
            ("passing.streak_e_per_px", passing.streak_e_per_px, SIZE),
            ("passing.cosmic_rays_per_mpx_s", passing.cosmic_rays_per_mpx_s, SIZE),
            ("passing.cosmic_ray_e_per_px", passing.cosmic_ray_e_per_px, SIZE),
        ];
        let mount = &self.mount;
        let speed = (0.001, 100.0, "0.001 to 100");
        let mount_checks = [
            (
                "mount.past_meridian_deg",
                mount.past_meridian_deg.unwrap_or(0.0),
                (0.0, 85.0, "0 to 85"),
            ),
            ("mount.fastest_deg_s", mount.fastest_deg_s, speed),
            ("mount.acceleration_deg_s2", mount.acceleration_deg_s2, speed),
            ("mount.backlash_arcsec", mount.backlash_arcsec, SIZE),
            ("mount.periodic_arcsec", mount.periodic_arcsec, SIZE),
            ("mount.worm_deg", mount.worm_deg, POSITIVE),
            ("mount.encoder_arcsec", mount.encoder_arcsec, SIZE),
            ("mount.tilt_arcsec", mount.tilt_arcsec, SIZE),
            ("mount.wind_arcsec", mount.wind_arcsec, SIZE),
            ("mount.latency_s", mount.latency_s, (0.0, 5.0, "0 to 5 s")),
            ("mount.latency_jitter_s", mount.latency_jitter_s, (0.0, 1.0, "0 to 1 s")),
            ("mount.dropped", mount.dropped, PART),
            ("mount.camera_angle_deg", mount.camera_angle_deg, (-360.0, 360.0, "-360 to 360")),
            ("mount.late_s", mount.late_s, (-60.0, 60.0, "-60 to 60 s")),
            ("mount.across_arcsec", mount.across_arcsec, (-3600.0, 3600.0, "-3600 to 3600")),
        ];
        for (key, value, range) in checks.into_iter().chain(mount_checks) {
            within(key, value, range)?;
        }
        for (channel, kappa) in &self.kappa {
            within(&format!("kappa.{channel}"), *kappa, POSITIVE)?;
        }
        for (channel, counter) in &self.counter {
            let key = |name: &str| format!("counter.{channel}.{name}");
            within(&key("dead_time_ns"), counter.dead_time_ns, SIZE)?;
            let recovers = counter.dead_time_model == Some(DeadTimeModel::ExponentialRecovery);
            let recovery = if recovers { POSITIVE } else { SIZE };
            within(&key("recovery_ns"), counter.recovery_ns, recovery)?;
            let pixels = (1.0, 1e7, "1 to 10 million");
            within(&key("pixels"), f64::from(counter.pixels), pixels)?;
            within(&key("dark_rate_hz"), counter.dark_rate_hz.unwrap_or(0.0), SIZE)?;
            let probability = (0.0, 0.9, "a fraction from 0 to 0.9");
            within(&key("afterpulse_probability"), counter.afterpulse_probability, probability)?;
            within(&key("afterpulse_time_ns"), counter.afterpulse_time_ns, POSITIVE)?;
        }
        if self.lamp.e_per_px_s > 0.0 || self.lamp.hz > 0.0 {
            let gaps = (1.0, 1e4, "1 to 10,000 gaps");
            within("lamp.gaps_s", self.lamp.gaps_s.len() as f64, gaps)?;
        }
        for gap_s in &self.lamp.gaps_s {
            let longer = (self.lamp.on_s, 1e6, "at least a flash's length, up to 1e6 s");
            within("lamp.gaps_s", *gap_s, longer)?;
        }
        for (i, visit) in self.visit.iter().enumerate() {
            within(&format!("visit[{i}].from_s"), visit.from_s, ANY)?;
            let after = (visit.from_s, 1e9, "a time after from_s");
            within(&format!("visit[{i}].to_s"), visit.to_s, after)?;
        }
        Ok(())
    }
}
