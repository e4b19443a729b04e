//! Data that the instruments get of a night: counts, tags, frames, each of them a function of its time alone.

use super::events::{Detector, PS};
use super::frame::{
    CosmicRays, Exposure, Pattern, PointSpread, Scene, Sensor, Sky, Source, Streak, streak,
};
use super::lamp::Lamp;
use super::mount::Driven;
use super::night::{Instrument, Night, VisitTruth};
use super::plan::Target;
use super::random::{Purpose, seed_of, stream};
use super::wander::Wander;
use glam::DVec2;
use ndarray::Array2;
use std::ops::Range;
use std::sync::Arc;

/// The longest time for which light and pointing are taken as steady, s.
const STEADY_S: f64 = 0.005;
/// Time over which the lamp's light at a moment is a mean, s.
const LAMP_S: f64 = 1e-6;
/// Most such times in a bin or an exposure.
const MOST_STEPS: f64 = 400.0;
/// Places of a target in a frame along which its light is drawn out.
const MOST_PLACES: f64 = 8.0;

/// Truth at a moment, the same for all instruments.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    /// The visit, by its number; none on the way between two.
    pub visit: Option<usize>,
    /// True where the shutter is closed.
    pub dark: bool,
    /// Where the target stands, px from the middle of the sensor.
    pub offset_px: DVec2,
    /// Factor of twinkling on the light: 1 on average.
    pub scintillation: f64,
    /// Share of the light that clouds let through.
    pub clouds: f64,
    /// Natural logarithm of the sky's brightness over that at the night's begin.
    pub sky_ln: f64,
    /// Exponent of λ/550 nm by which the sky's light differs from the Sun's.
    pub sky_colour: f64,
}

/// Truth of a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameTruth {
    /// The target's mean place, px from the middle of the sensor; none without a target.
    pub offset_px: Option<DVec2>,
    /// Electrons of the whole target for each colour as if every pixel had it.
    pub electrons: [f64; 3],
    /// Full width at half maximum of a point, px.
    pub fwhm_px: f64,
    /// True where something crossed the frame.
    pub streaked: bool,
    /// True where the shutter was closed.
    pub dark: bool,
    /// When the exposure of the first row began, s from the night's begin.
    pub start_s: f64,
}

/// A look at a night: an instrument's own, for it keeps what it used last.
#[derive(Debug, Clone)]
pub struct Watch {
    night: Arc<Night>,
    scintillation: Wander,
    pointing: [Wander; 2],
    clouds: Wander,
    seeing: Wander,
    sky: Wander,
    pattern: Option<Pattern>,
    rates_hz: Vec<Vec<f64>>,
    driven: Option<Driven>,
    lamp: Option<Lamp>,
}

impl Watch {
    /// A look at a night.
    pub fn new(night: Arc<Night>) -> Self {
        let options = &night.options;
        let wander = |number: u64, time_s: f64| {
            Wander::new(seed_of(options.seed, Purpose::Part, 3000 + number), time_s)
        };
        let (scintillation, clouds) =
            (wander(0, options.scintillation.time_s), wander(3, options.clouds.time_s));
        let pointing = [1, 2].map(|axis| wander(axis, options.pointing.jitter_time_s));
        let seeing = wander(4, options.seeing.time_s);
        let sky = wander(5, options.sky.time_s);
        let (pattern, rates_hz, driven) = (None, Vec::new(), None);
        let lamp = Lamp::new(&night.options.lamp);
        Self {
            scintillation,
            pointing,
            clouds,
            seeing,
            sky,
            night,
            pattern,
            rates_hz,
            driven,
            lamp,
        }
    }

    /// The look at a night whose telescope is on a mount: that decides where the target stands.
    #[must_use]
    pub fn driven_by(mut self, mount: Option<Driven>) -> Self {
        self.driven = mount;
        self
    }

    /// The night.
    pub fn night(&self) -> &Arc<Night> {
        &self.night
    }

    /// Returns the truth at a moment, s from the night's begin.
    pub fn moment(&mut self, time_s: f64) -> Moment {
        let visit = self.night.visit_at(time_s);
        self.moment_of(visit, time_s)
    }

    fn moment_of(&mut self, visit: Option<usize>, time_s: f64) -> Moment {
        let night = &self.night;
        let options = &night.options;
        let truth = visit.map(|visit| &night.visits[visit]);
        let airmass = truth.map_or(1.0, |truth| truth.airmass(time_s));
        let variance = night.scintillation * airmass.powi(3);
        let scintillation = if variance > 0.0 {
            (variance.sqrt() * self.scintillation.at(time_s) - 0.5 * variance).exp()
        } else {
            1.0
        };
        let cloudy = &options.clouds;
        let clouds = if cloudy.depth > 0.0 || cloudy.scatter > 0.0 {
            (-(cloudy.depth + cloudy.scatter * self.clouds.at(time_s)).max(0.0)).exp()
        } else {
            1.0
        };
        let mut offset_px = truth.map_or([0.0; 2], |truth| truth.aim_px.to_array());
        let mount = self.driven.as_mut().zip(visit);
        match mount.and_then(|(driven, visit)| driven.offset_px(visit, time_s)) {
            Some(offset) => offset_px = offset.to_array(),
            None => {
                for (offset, wander) in offset_px.iter_mut().zip(&mut self.pointing) {
                    *offset += options.pointing.jitter_px * wander.at(time_s);
                }
            }
        }
        let dark = truth.is_some_and(|truth| truth.visit.target == Target::Dark);
        let (sky_ln, sky_colour) = self.sky_at(time_s);
        let offset_px = offset_px.into();
        Moment { visit, dark, offset_px, scintillation, clouds, sky_ln, sky_colour }
    }

    /// Natural logarithm of the sky's brightness over that at the night's begin, and the exponent of its colour.
    fn sky_at(&mut self, time_s: f64) -> (f64, f64) {
        let sky = &self.night.options.sky;
        let hours = time_s / 3600.0;
        // A magnitude is ln(100)/5.
        let even = -0.2 * 100_f64.ln() * sky.change_mag_per_h * hours;
        let patchy = if sky.scatter > 0.0 { sky.scatter * self.sky.at(time_s) } else { 0.0 };
        (even + patchy, sky.change_of_colour_per_h * hours)
    }

    /// The light on a counter at a moment, Hz, its dark rate not among it; `None` if the channel is no counter.
    pub fn light_hz(&mut self, channel: usize, time_s: f64) -> Option<f64> {
        let moment = self.moment(time_s);
        let lamp_hz = self.lamp_hz(&moment, time_s..time_s + LAMP_S);
        Some(light_hz(&self.night, channel, &moment, time_s)? + lamp_hz)
    }

    /// Mean light of the lamp on each counter within a span, Hz.
    fn lamp_hz(&self, moment: &Moment, span_s: Range<f64>) -> f64 {
        let Some(lamp) = self.lamp.as_ref().filter(|_| !moment.dark) else { return 0.0 };
        let length_s = span_s.end - span_s.start;
        self.night.options.lamp.hz * lamp.on_within_s(span_s) / length_s
    }

    /// The counters of the night, as numbers of its channels.
    pub fn counters(&self) -> Vec<usize> {
        let is_counter =
            |i: &usize| matches!(self.night.channels[*i].instrument, Instrument::Counter { .. });
        (0..self.night.channels.len()).filter(is_counter).collect()
    }

    fn detector(&self, channel: usize) -> Option<(Detector, u64)> {
        match self.night.channels.get(channel)?.instrument {
            Instrument::Counter { detector, seed, .. } => Some((detector, seed)),
            Instrument::Plane { .. } => None,
        }
    }

    /// Rate that a counter's detector is given for its light, Hz: where it has a table, what that says is counted.
    fn given_hz(&self, channel: usize, light_hz: f64) -> f64 {
        match self.night.channels.get(channel).map(|channel| &channel.instrument) {
            Some(Instrument::Counter { table: Some(table), .. }) => table.counted_hz(light_hz),
            _ => light_hz,
        }
    }

    /// The counts of counters in a bin, ps from the night's begin; 0 of a channel that is no counter.
    pub fn counts(&mut self, channels: &[usize], span_ps: Range<i64>) -> Vec<u64> {
        let (from_s, to_s) = (span_ps.start as f64 / PS, span_ps.end as f64 / PS);
        let steps = ((to_s - from_s) / STEADY_S).ceil().clamp(1.0, MOST_STEPS);
        let mut rates_hz = std::mem::take(&mut self.rates_hz);
        rates_hz.resize_with(channels.len(), Vec::new);
        rates_hz.iter_mut().for_each(Vec::clear);
        for step in 0..steps as u32 {
            let time_s = from_s + (to_s - from_s) * (f64::from(step) + 0.5) / steps;
            let moment = self.moment(time_s);
            let half_s = 0.5 * (to_s - from_s) / steps;
            let lamp_hz = self.lamp_hz(&moment, time_s - half_s..time_s + half_s);
            for (channel, rates_hz) in channels.iter().zip(&mut rates_hz) {
                let light_hz = light_hz(&self.night, *channel, &moment, time_s);
                rates_hz
                    .push(light_hz.map_or(0.0, |light| self.given_hz(*channel, light + lamp_hz)));
            }
        }
        let counts = channels.iter().zip(&rates_hz).map(|(channel, rates_hz)| {
            self.detector(*channel).map_or(0, |(detector, seed)| {
                detector.counts(seed, span_ps.start, span_ps.clone(), rates_hz)
            })
        });
        let counts = counts.collect();
        self.rates_hz = rates_hz;
        counts
    }

    /// The counts' own times of a counter in a span, ps from the night's begin; light is steady for `step_ps`. They are not those that
    /// [`counts`](Self::counts) tells, but other draws of the same light.
    pub fn tags(&mut self, channel: usize, span_ps: Range<i64>, step_ps: i64) -> Vec<i64> {
        let Some((detector, seed)) = self.detector(channel) else { return Vec::new() };
        detector.tags(seed, span_ps, step_ps, |time_s| {
            let light_hz = self.light_hz(channel, time_s).unwrap_or(0.0);
            self.given_hz(channel, light_hz)
        })
    }

    /// The frame of an exposure that begins `start_s` after the night's begin, and its truth; `None` without a camera.
    pub fn frame(
        &mut self,
        exposure: &Exposure,
        start_s: f64,
    ) -> Option<(Array2<u16>, FrameTruth)> {
        let sensor = self.night.sensor?;
        let night = self.night.clone();
        let options = &night.options;
        let seed = seed_of(options.seed, Purpose::Part, 4000);
        // A microsecond names a frame.
        let number = (start_s * 1e6).round() as i64 as u64;
        let middle_s = start_s + 0.5 * exposure.exposure_s;
        let visit = self.night.visit_at(middle_s);
        let spread = self.spread(visit, middle_s);
        let (mut target, mut offset_px, dark) =
            self.target(&sensor, visit, exposure, start_s, spread.fwhm_px());
        let row_time_s = options.camera.row_time_s;
        if let Some(offset) = offset_px.filter(|_| row_time_s > 0.0) {
            // Its own row begins later than the first one.
            let row_px = sensor.middle_px().y + offset.y - f64::from(exposure.origin_px[1]);
            let later_s = row_time_s * (row_px / f64::from(exposure.binning[1].max(1))).max(0.0);
            (target, offset_px, _) =
                self.target(&sensor, visit, exposure, start_s + later_s, spread.fwhm_px());
        }
        let lamp_e = if dark { Vec::new() } else { self.lamp_e(exposure, start_s) };
        let electrons = target.electrons;
        let mut sources = vec![target];
        let mut random = stream(seed, Purpose::Passing, number ^ 1 << 63);
        let passing = &options.passing;
        let streaks =
            Streak { per_s: passing.streaks_per_h / 3600.0, e_per_px: passing.streak_e_per_px };
        let crossing = streak(&streaks, exposure, &spread, &mut random).filter(|_| !dark);
        let streaked = crossing.is_some();
        sources.extend(crossing);
        let cosmic_rays = CosmicRays {
            per_mpx_s: passing.cosmic_rays_per_mpx_s,
            length_px: 3.0,
            e_per_px: passing.cosmic_ray_e_per_px,
        };
        let sky = if dark { Sky::default() } else { self.sky(middle_s) };
        let scene = Scene { sky, lamp_e: &lamp_e, sources: &sources, spread, cosmic_rays };
        let pattern = match self.pattern.take().filter(|pattern| pattern.fits(exposure)) {
            Some(pattern) => pattern,
            None => sensor.pattern(exposure),
        };
        let frame = sensor.render_with(&pattern, exposure, &scene, seed, number);
        self.pattern = Some(pattern);
        let fwhm_px = spread.fwhm_px();
        Some((frame, FrameTruth { offset_px, electrons, fwhm_px, streaked, dark, start_s }))
    }

    /// Electrons of the lamp in the pixels of each unbinned row of an exposure; empty without a lamp.
    fn lamp_e(&self, exposure: &Exposure, start_s: f64) -> Vec<f64> {
        let Some(lamp) = &self.lamp else { return Vec::new() };
        let options = &self.night.options;
        let of_row = |row: u32| {
            let row = row / exposure.binning[1].max(1);
            let from_s = start_s + options.camera.row_time_s * f64::from(row);
            options.lamp.e_per_px_s * lamp.on_within_s(from_s..from_s + exposure.exposure_s)
        };
        (0..exposure.size_px[1]).map(of_row).collect()
    }

    fn sky(&mut self, time_s: f64) -> Sky {
        let mut e_per_s = [0.0; 3];
        let (ln, exponent) = self.sky_at(time_s);
        for channel in &self.night.channels {
            if let Instrument::Plane { colours, sky_e_per_s, sky_colour } = channel.instrument {
                let here = sky_e_per_s * (ln + sky_colour * exponent).exp();
                colours.iter().for_each(|colour| e_per_s[*colour] = here);
            }
        }
        Sky { e_per_s, gradient_per_px: self.night.options.sky.gradient_per_px.into() }
    }

    fn spread(&mut self, visit: Option<usize>, time_s: f64) -> PointSpread {
        let seeing = &self.night.options.seeing;
        let airmass = visit.map_or(1.0, |visit| self.night.visits[visit].airmass(time_s));
        let width = (seeing.scatter * self.seeing.at(time_s)).exp() * airmass.powf(0.6);
        let fwhm_px = seeing.fwhm_arcsec * width / self.night.pixel_scale_arcsec;
        match seeing.moffat_beta {
            Some(beta) => PointSpread::Moffat { fwhm_px, beta },
            None => PointSpread::Gaussian { fwhm_px },
        }
    }

    /// The target in an exposure: its light and its path. The path is even in time; how the light changes along it is left out.
    fn target(
        &mut self,
        sensor: &Sensor,
        visit: Option<usize>,
        exposure: &Exposure,
        start_s: f64,
        fwhm_px: f64,
    ) -> (Source, Option<DVec2>, bool) {
        let steps = (exposure.exposure_s / STEADY_S).ceil().clamp(1.0, MOST_STEPS) as u32;
        let step_s = exposure.exposure_s / f64::from(steps);
        let night = self.night.clone();
        let truth = visit.map(|visit| &night.visits[visit]);
        let dark = truth.is_some_and(|truth| truth.visit.target == Target::Dark);
        let mut electrons = [0.0; 3];
        let Some(truth) = truth.filter(|truth| !truth.time_s.is_empty()) else {
            return (Source::default(), None, dark);
        };
        let mut places = Vec::with_capacity(steps as usize);
        for step in 0..steps {
            let time_s = start_s + step_s * (f64::from(step) + 0.5);
            let moment = self.moment_of(visit, time_s);
            let light = moment.scintillation * moment.clouds * step_s * sensor.gain_e_per_adu;
            add_light(&night, truth, time_s, light, &mut electrons);
            places.push(moment.offset_px);
        }
        let mean = mean_place(&places);
        let middle = sensor.middle_px();
        let reach = places
            .iter()
            .map(|place| (place.x - mean[0]).hypot(place.y - mean[1]))
            .fold(0.0, f64::max);
        // A place for each eighth of a point's width.
        let parts = (16.0 * reach / fwhm_px).ceil().clamp(1.0, MOST_PLACES) as usize;
        let chunk = places.len().div_ceil(parts);
        let on_sensor = |places: &[DVec2]| {
            let [x, y] = mean_place(places);
            DVec2::new(middle[0] + x, middle[1] + y)
        };
        let path_px = places.chunks(chunk).map(on_sensor).collect();
        (Source { electrons, path_px }, Some(mean.into()), dark)
    }
}

fn add_light(night: &Night, truth: &VisitTruth, time_s: f64, light: f64, electrons: &mut [f64; 3]) {
    for (i, channel) in night.channels.iter().enumerate() {
        if let Instrument::Plane { colours, .. } = channel.instrument {
            let arriving = truth.arriving_hz(i, time_s) * light;
            colours.iter().for_each(|colour| electrons[*colour] += arriving);
        }
    }
}

fn mean_place(places: &[DVec2]) -> [f64; 2] {
    [0, 1].map(|axis| places.iter().map(|place| place[axis]).sum::<f64>() / places.len() as f64)
}

fn light_hz(night: &Night, channel: usize, moment: &Moment, time_s: f64) -> Option<f64> {
    let Instrument::Counter { fibre, sky_hz, sky_colour, .. } =
        &night.channels.get(channel)?.instrument
    else {
        return None;
    };
    if moment.dark {
        return Some(0.0);
    }
    let sky_hz = sky_hz * (moment.sky_ln + sky_colour * moment.sky_colour).exp();
    let Some(truth) = moment.visit.map(|visit| &night.visits[visit]) else { return Some(sky_hz) };
    let coupling = fibre.map_or(1.0, |fibre| {
        let [x, y] = moment.offset_px.to_array();
        let q = ((x - fibre.offset_px[0]) / fibre.sigma_px[0]).powi(2)
            + ((y - fibre.offset_px[1]) / fibre.sigma_px[1]).powi(2);
        (-0.5 * q).exp()
    });
    let target = truth.arriving_hz(channel, time_s);
    Some(sky_hz + target * coupling * moment.scintillation * moment.clouds)
}
