//! The lamp's light on photodiode and detector.

use super::options::Options;

/// Planck's constant times the speed of light, J nm.
const PLANCK_LIGHT_J_NM: f64 = 6.626_070_15e-34 * 299_792_458.0 * 1e9;
/// hc/k, nm K.
const SECOND_RADIATION_NM_K: f64 = 1.438_776_877e7;
/// Points across the slit's triangle on each side of its middle.
const POINTS: i32 = 12;
/// Width over which an order-sorting filter and the quartz begin to pass, nm.
const EDGE_NM: f64 = 2.0;

/// Light that reaches the two detectors.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Light {
    /// Current of the photodiode, A.
    pub photodiode_a: f64,
    /// Photons that the detector would count without loss, Hz.
    pub detected_hz: f64,
}

/// Whether light passes an edge at `edge_nm`, 0 to 1.
fn edge(nm: f64, edge_nm: f64) -> f64 {
    if edge_nm <= 0.0 { 1.0 } else { 1.0 / (1.0 + (-(nm - edge_nm) / EDGE_NM).exp()) }
}

impl Options {
    /// The lamp's radiant intensity, W sr⁻¹ nm⁻¹.
    fn lamp(&self, nm: f64) -> f64 {
        let planck = |nm: f64| {
            let x = SECOND_RADIATION_NM_K / (nm * self.lamp.temperature_k);
            nm.powi(-5) / x.exp_m1()
        };
        // Wien's displacement: the peak is where hc/λkT = 4.965.
        let peak_nm = SECOND_RADIATION_NM_K / (4.965_114 * self.lamp.temperature_k);
        let shape = planck(nm) / planck(peak_nm);
        self.lamp.intensity_w_per_sr_nm * shape * edge(nm, self.lamp.shortest_nm)
    }

    /// The photodiode's real responsivity, A W⁻¹. Beyond its table it has the electrons per photon of the end.
    #[must_use]
    pub fn responsivity(&self, nm: f64) -> f64 {
        let diode = &self.photodiode;
        let (x, y) = (&diode.wavelength_nm, &diode.responsivity_a_per_w);
        let k = x.partition_point(|x| *x < nm);
        let value = if k == 0 {
            y[0] * nm / x[0]
        } else if k == x.len() {
            y[k - 1] * nm / x[k - 1]
        } else {
            let part = (nm - x[k - 1]) / (x[k] - x[k - 1]);
            (1.0 - part) * y[k - 1] + part * y[k]
        };
        diode.scale * value
    }

    /// The detector's real efficiency.
    #[must_use]
    pub fn efficiency(&self, nm: f64) -> f64 {
        let sensor = &self.sensor;
        sensor.efficiency * (-((nm - sensor.peak_nm) / sensor.width_nm).powi(2)).exp()
    }

    /// The light with the monochromator's grating at `grating_nm` (what it really passes in first order) and a slot of the wheel, at the begin.
    #[must_use]
    pub fn light(&self, grating_nm: f64, slot: u32) -> Light {
        let number = (slot as usize).saturating_sub(1);
        let (cut_on_nm, transmission) = match self.wheel.get(number) {
            Some(slot) => (slot.cut_on_nm, slot.transmission),
            None => (0.0, 1.0),
        };
        let (diode, sensor) = (&self.photodiode, &self.sensor);
        let diode_sr = diode.area_mm2 / diode.distance_mm.powi(2);
        let sensor_sr = sensor.area_mm2 / sensor.distance_mm.powi(2);
        let bandwidth_nm = self.monochromator.bandwidth_nm;
        let step_nm = bandwidth_nm / f64::from(POINTS);
        let mut light = Light::default();
        // The grating sends the wavelength λ/2 the same way in its second order, half as wide.
        for (order, strength) in [(1.0, 1.0), (2.0, self.monochromator.second_order)] {
            for k in -POINTS..=POINTS {
                let off_nm = f64::from(k) * step_nm;
                let slit = 1.0 - (off_nm / bandwidth_nm).abs();
                let nm = (grating_nm + off_nm) / order;
                if nm <= 0.0 {
                    continue;
                }
                let passed = transmission * edge(nm, cut_on_nm) * strength * slit;
                let w_per_sr = self.lamp(nm) * passed * step_nm / order;
                light.photodiode_a += w_per_sr * diode_sr * self.responsivity(nm);
                let photons_hz =
                    w_per_sr * sensor_sr * sensor.transmission * nm / PLANCK_LIGHT_J_NM;
                light.detected_hz += photons_hz * self.efficiency(nm);
            }
        }
        light
    }

    /// The lamp's power at a time, s, over that at the begin, as a photodiode sees it that does not change.
    #[must_use]
    pub fn lamp_drift(&self, at_s: f64) -> f64 {
        let again = if self.is_reignited(at_s) { self.lamp.reignites_power } else { 1.0 };
        again * (1.0 + self.lamp.drift_per_h * at_s / 3600.0).max(0.0)
    }

    /// Counts of the detector for the light that an unchanged photodiode sees, at a time, s, over that at the begin: its own efficiency, and where the lamp stands.
    #[must_use]
    pub fn sensor_drift(&self, at_s: f64) -> f64 {
        let aim = if self.is_reignited(at_s) { self.lamp.reignites_aim } else { 1.0 };
        aim * (1.0 + self.sensor.drift_per_h * at_s / 3600.0).max(0.0)
    }

    /// The photodiode's responsivity at a time, s, over that at the begin.
    #[must_use]
    pub fn photodiode_drift(&self, at_s: f64) -> f64 {
        let diode = &self.photodiode;
        1.0 - diode.settles_relative * (-at_s / 3600.0 / diode.settles_h).exp_m1()
    }

    fn is_reignited(&self, at_s: f64) -> bool {
        self.lamp.reignites_at_s.is_some_and(|again_s| at_s >= again_s)
    }
}
