//! The light on the detector, for what is in the beam and where the arms stand.

use super::options::Options;
use crate::options::OptionError;
use crate::rig::options::{Sample, SampleKind};
use glam::DVec3;
use std::f64::consts::{PI, TAU};
use sunglint_drivers::device::InBeam;
use sunglint_numerics::gauss::legendre;

/// Where the arms stand, degrees: the angles that nobody reads.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arms {
    /// Angle of incidence.
    pub incidence_deg: f64,
    /// Angle of the detector from the normal, above 0 away from the lamp.
    pub detector_deg: f64,
    /// Angle of the detector's plane about the normal, from the plane of incidence.
    pub azimuth_deg: f64,
    /// Angle of the sample about its normal.
    pub turn_deg: f64,
}

/// Strengths of a sample's parts at a wavelength, over those of the options.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SampleParts {
    /// Strength of the lobe.
    pub lobe: f64,
    /// Strength of the Lambert part.
    pub base: f64,
}

/// A goniometer without its chance: what light there is.
#[derive(Debug, Clone)]
pub struct Bench {
    options: Options,
    sample: Sample,
    /// Points of the detector's disc: offsets from its axis as tangents, and the solid angle of each, sr.
    disc: Vec<(f64, f64, f64)>,
    /// Rays of the beam: deviations in both planes, rad, and their parts.
    rays: Vec<(f64, f64, f64)>,
    /// Places in the beam's cross-section, mm, and their parts.
    places: Vec<(f64, f64, f64)>,
}

/// Rings and points around of the detector's disc.
const RINGS: usize = 6;
const AROUND: usize = 16;
/// Rays across the beam in each plane, and places in its cross-section.
const RAYS: usize = 11;
const PLACES: usize = 121;
/// Gaussians end here, in standard deviations.
const END: f64 = 3.5;

/// Middles of equal steps over ± [`END`] standard deviations, with their parts of a Gaussian.
fn gaussian(steps: usize) -> Vec<(f64, f64)> {
    let at = |k: usize| ((k as f64 + 0.5) / steps as f64 * 2.0 - 1.0) * END;
    let all: Vec<(f64, f64)> = (0..steps).map(|k| (at(k), (-0.5 * at(k) * at(k)).exp())).collect();
    let total: f64 = all.iter().map(|p| p.1).sum();
    all.into_iter().map(|(x, w)| (x, w / total)).collect()
}

fn rays(spread: [f64; 2], steps: usize) -> Vec<(f64, f64, f64)> {
    let along = if spread[0] > 0.0 { gaussian(steps) } else { vec![(0.0, 1.0)] };
    let across = if spread[1] > 0.0 { gaussian(steps) } else { vec![(0.0, 1.0)] };
    let each = |(x, w): &(f64, f64)| {
        let (x, w) = (*x, *w);
        across.iter().map(move |(y, v)| (x * spread[0], y * spread[1], w * v)).collect::<Vec<_>>()
    };
    along.iter().flat_map(each).collect()
}

/// The detector's disc of a tangent radius: rings and points around, with dΩ = r dr dφ/(1 + r²)^(3/2).
fn disc(radius: f64, rings: usize, around: usize) -> Vec<(f64, f64, f64)> {
    let mut points = Vec::new();
    for (x, w) in legendre(rings) {
        let r = 0.5 * radius * (1.0 + x);
        let sr = 0.5 * radius * w * r * TAU / around as f64 / (1.0 + r * r).powf(1.5);
        for k in 0..around {
            let (s, c) = (TAU * (k as f64 + 0.5) / around as f64).sin_cos();
            points.push((r * c, r * s, sr));
        }
    }
    points
}

impl Bench {
    /// A goniometer.
    ///
    /// # Errors
    /// Options of which none can be made.
    pub fn new(options: Options) -> Result<Self, OptionError> {
        options.check()?;
        let radius = 0.5 * options.aperture.diameter_mm / options.aperture.distance_mm;
        let spread = [options.beam.spread_in_deg, options.beam.spread_out_deg].map(f64::to_radians);
        let sigma = 0.25 * options.beam.diameter_mm;
        Ok(Self {
            sample: options.rig().sample,
            disc: disc(radius, RINGS, AROUND),
            rays: rays(spread, RAYS),
            places: rays([sigma; 2], PLACES),
            options,
        })
    }

    /// Returns the options that it is made of.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// The lamp's power at the sample's place, W, at a time, s.
    pub fn lamp_w(&self, at_s: f64) -> f64 {
        let lamp = &self.options.lamp;
        let hours = at_s / 3600.0;
        let wave = lamp.wave * (TAU * hours / lamp.wave_h).sin();
        1e-3 * lamp.power_mw * (1.0 + lamp.drift_per_h * hours + wave).max(0.0)
    }

    /// f·cosθ_o of the sample, sr⁻¹, for unit vectors in its axes.
    pub fn radiance(&self, i: DVec3, o: DVec3) -> f64 {
        self.sample.radiance(i, o)
    }

    /// The lamp's power at a wavelength, nm, over that at its own: Planck's law.
    pub fn lamp_part(&self, nm: f64) -> f64 {
        // h c / k in nm K (CODATA 2018).
        const C2_NM_K: f64 = 1.438_776_877e7;
        let of = |nm: f64| nm.powi(-5) / (C2_NM_K / (nm * self.options.spectrum.lamp_k)).exp_m1();
        of(nm) / of(self.options.lamp.wavelength_nm)
    }

    /// The lobe's and the Lambert part's strength at a wavelength, nm, over the options' reflectances.
    pub fn sample_parts(&self, nm: f64) -> SampleParts {
        let spectrum = &self.options.spectrum;
        let away = (nm - spectrum.band_nm) / spectrum.band_width_nm;
        let lobe = 1.0 - spectrum.band_depth * (-0.5 * away * away).exp();
        let base = (nm / self.options.lamp.wavelength_nm).powf(spectrum.base_exponent);
        SampleParts { lobe, base }
    }

    /// f·cosθ_o of the sample at a wavelength, nm, sr⁻¹, for unit vectors in its axes.
    pub fn radiance_at(&self, i: DVec3, o: DVec3, nm: f64) -> f64 {
        let SampleParts { lobe, base } = self.sample_parts(nm);
        let [own, under] = self.parts_of_sample();
        lobe * own.radiance(i, o) + base * under.radiance(i, o)
    }

    /// The sample's lobe alone, and its Lambert part alone. A Lambert sample is all lobe but for its base.
    fn parts_of_sample(&self) -> [Sample; 2] {
        let own = Sample { base_reflectance: 0.0, ..self.sample.clone() };
        let under = Sample {
            kind: SampleKind::Lambert,
            reflectance: self.sample.base_reflectance,
            base_reflectance: 0.0,
            ..self.sample.clone()
        };
        [own, under]
    }

    /// The light on the detector over the lamp's power: what is the same at all wavelengths, what the sample's lobe sends and what its Lambert part sends.
    pub fn parts(&self, place: InBeam, arms: &Arms) -> [f64; 3] {
        if place != InBeam::Sample {
            return [self.part(place, arms), 0.0, 0.0];
        }
        // Stray light is there without a sample, too.
        let around = self.part(InBeam::Nothing, arms);
        let [own, under] = self.parts_of_sample();
        [around, self.sample_light(&own, arms), self.sample_light(&under, arms)]
    }

    /// Unit vectors from the sample to lamp and detector.
    pub fn directions(arms: &Arms) -> (DVec3, DVec3) {
        let (si, ci) = arms.incidence_deg.to_radians().sin_cos();
        let (so, co) = arms.detector_deg.to_radians().sin_cos();
        let (sa, ca) = arms.azimuth_deg.to_radians().sin_cos();
        (DVec3::new(-si, 0.0, ci), DVec3::new(so * ca, so * sa, co))
    }

    /// The part of the beam that lies on the sample and in the detector's field, counted place by place of its cross-section.
    fn on_both(&self, arms: &Arms) -> f64 {
        let (i, o) = Self::directions(arms);
        if i.z <= 1e-9 {
            return 0.0;
        }
        // Axes of the beam's cross-section: in the plane of incidence, and across it.
        let (u, v) = (DVec3::new(i.z, 0.0, -i.x), DVec3::Y);
        let (sin, cos) = arms.turn_deg.to_radians().sin_cos();
        let sample = &self.options.sample;
        let (half_width, half_height) = (0.5 * sample.width_mm, 0.5 * sample.height_mm);
        let radius = self.options.field.diameter_mm.map(|d| 0.5 * d);
        let lands = |(x, y, w): &(f64, f64, f64)| {
            let from = *x * u + *y * v;
            // Along the ray down to the sample's plane.
            let p = from - i * (from.z / i.z);
            let (a, b) = (p.x * cos + p.y * sin, p.y * cos - p.x * sin);
            let on = a.abs() < half_width && b.abs() < half_height;
            let seen = radius.is_none_or(|r| p.cross(o).length() < r);
            if on && seen { *w } else { 0.0 }
        };
        self.places.iter().map(lands).sum()
    }

    /// The part of the beam's power that the sample sends into the detector.
    fn sample_light(&self, sample: &Sample, arms: &Arms) -> f64 {
        let (i, o) = Self::directions(arms);
        if sample.kind == SampleKind::Mirror {
            // The mirrored beam, straight into the detector.
            let mirrored = DVec3::new(-i.x, -i.y, i.z);
            return self.on_both(arms) * sample.reflectance * self.disc_light(mirrored, o);
        }
        let part = self.on_both(arms);
        if part == 0.0 || o.z <= 0.0 || i.z <= 0.0 {
            return 0.0;
        }
        let (iu, iv) = (DVec3::new(i.z, 0.0, -i.x), DVec3::Y);
        let ou = DVec3::Y.cross(o).try_normalize().unwrap_or(DVec3::X);
        let ov = o.cross(ou);
        let mut sum = 0.0;
        for (a, b, w) in &self.rays {
            let ray = (i + a.tan() * iu + b.tan() * iv).normalize();
            for (x, y, sr) in &self.disc {
                sum += w * sr * sample.radiance(ray, (o + *x * ou + *y * ov).normalize());
            }
        }
        part * sum
    }

    /// The part of a beam along a unit vector that a detector on the axis `o` takes in: the beam's Gaussian over the detector's disc, the beam's own width in it.
    fn disc_light(&self, beam: DVec3, o: DVec3) -> f64 {
        if beam.dot(o) <= 0.0 {
            return 0.0;
        }
        let aperture = &self.options.aperture;
        // Across the plane of incidence is y; in it, what is left.
        let across = DVec3::Y - DVec3::Y.dot(beam) * beam;
        let across = across.try_normalize().unwrap_or(DVec3::X);
        let along = across.cross(beam);
        let (x, y) = (o.dot(along) / o.dot(beam), o.dot(across) / o.dot(beam));
        let width = 0.25 * self.options.beam.diameter_mm / aperture.distance_mm;
        let sigma = [self.options.beam.spread_in_deg, self.options.beam.spread_out_deg]
            .map(|deg| deg.to_radians().tan().hypot(width));
        let radius = 0.5 * aperture.diameter_mm / aperture.distance_mm;
        // Cells of the disc, counted one by one.
        let n = 160;
        let step = 2.0 * radius / f64::from(n);
        let mut sum = 0.0;
        for k in 0..n {
            for l in 0..n {
                let [u, v] = [k, l].map(|m| (f64::from(m) + 0.5) * step - radius);
                if u * u + v * v < radius * radius {
                    let (p, q) = ((u + x) / sigma[0], (v + y) / sigma[1]);
                    sum += (-0.5 * (p * p + q * q)).exp();
                }
            }
        }
        sum * step * step / (TAU * sigma[0] * sigma[1])
    }

    /// The light on the detector over the lamp's power, for what is in the beam; before any noise.
    pub fn part(&self, place: InBeam, arms: &Arms) -> f64 {
        let (i, o) = Self::directions(arms);
        let stray = &self.options.stray;
        let radius = 0.5 * self.options.aperture.diameter_mm / self.options.aperture.distance_mm;
        let sr = TAU * (1.0 - (1.0 + radius * radius).sqrt().recip());
        let around = stray.floor_per_sr * sr * (1.0 + stray.towards_lamp * (0.5 + 0.5 * i.dot(o)));
        match place {
            InBeam::Blocked => 0.0,
            InBeam::Head => 1.0,
            InBeam::Nothing => around,
            InBeam::Through => around + self.disc_light(-i, o),
            InBeam::Sample => around + self.sample_light(&self.sample, arms),
            InBeam::Standard => {
                let lambert = o.z.max(0.0) / PI * sr;
                around + 0.99 * lambert * self.on_both(arms)
            }
        }
    }
}
