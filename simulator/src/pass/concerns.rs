//! Warnings to read before believing the numbers of a simulated pass.

use super::{Pass, Place, Simulation};
use crate::attitude::Attitude;
use crate::light;
use crate::target::Shape;

impl Simulation<'_> {
    /// Returns the warnings to read before believing the numbers.
    pub fn concerns(&self) -> Vec<String> {
        let (pass, simulation) = (self.pass, self);
        let mut concerns = simulation.scene.warnings.clone();
        concerns.extend(light::concerns(&simulation.needs));
        let round = |shape: &Shape| matches!(shape, Shape::Sphere { .. });
        let turned =
            !pass.target.parts.iter().all(|p| round(&p.shape)) || !pass.target.hinges.is_empty();
        if turned && !pass.attitude_given && matches!(pass.attitude, Attitude::Inertial(_)) {
            concerns.push("no [attitude] is given: the body stands still among the stars, its axes along those of the GCRS".into());
        }
        let places = &simulation.places;
        let orientation = places.iter().map(|p| p.orientation).find(|o| o.is_outside());
        concerns.extend(orientation.map(|o| format!("{o} ([earth_orientation] file = \"FILE\")")));
        if places.iter().all(|p| p.hidden) {
            let height = |p: &&Place| p.geometry.horizontal.altitude_deg();
            if let Some(best) = places.iter().max_by(|a, b| height(a).total_cmp(&height(b))) {
                concerns.push(format!(
                "{} is never above the horizon of {} in these times: at its highest, {}, it stands at {:+.2}° (the horizon there is at {:.1}°); take other times or another station",
                pass.object(),
                pass.station.name,
                sunglint_formats::time::format_utc(best.geometry.epoch, 1),
                height(&best),
                pass.station.horizon.elevation_deg(best.geometry.horizontal.azimuth_deg()),
            ));
            }
        }
        if places.iter().all(|p| p.sunlit == 0.0) {
            concerns.push(format!(
            "{} is in the Earth's shadow all the time: the Sun stands behind the Earth, and every rate is 0 (flag eclipsed)",
            pass.object()
        ));
        }
        let day = places.iter().filter(|p| !p.hidden && p.sun_altitude_deg > -6.0).count();
        if day > 0 {
            concerns.push(format!(
            "in {day} of the visible samples the Sun is above -6° at {}: the sky is bright, and its light is not in the rates",
            pass.station.name
        ));
        }
        let smeared = |i: &usize| self.over_tolerance(*i) == Some(super::promise::EXPOSURE);
        let smeared: Vec<usize> = (0..places.len()).filter(smeared).collect();
        if let Some(worst) =
            smeared.iter().copied().max_by(|a, b| self.smear[*a].total_cmp(&self.smear[*b]))
        {
            concerns.push(format!(
            "in {} of {} samples the light changes while they are exposed, more than the tolerance: a sample is the middle of its exposure, not its mean, from which it is off by {} at most (sample {}, {} s; flag over_tolerance); take shorter exposures, or many short ones and their mean",
            smeared.len(),
            places.len(),
            light::percent(self.smear[worst]),
            worst + 1,
            pass.exposure_s[worst],
        ));
        }
        for channel in &simulation.channels {
            let saturated = channel.predicted.iter().filter(|p| p.saturated).count();
            if saturated > 0 {
                concerns.push(format!(
                    "{}: {saturated} samples past saturation: attenuate",
                    channel.name
                ));
            }
            let uncovered = channel.uncovered_nm.iter().copied().fold(0.0, f64::max);
            if uncovered > 0.0 {
                concerns.push(format!(
                "{}: for {uncovered:.0} nm of it sunlight, a material or the air is not tabulated (flag extrapolated)",
                channel.name
            ));
            }
        }
        concerns
    }
}

impl Pass {
    /// Times that are probably not meant so.
    pub fn concerns_of_times(&self) -> Vec<String> {
        let pass = self;
        let steps_s: Vec<f64> = pass.times.windows(2).map(|p| (p[1] - p[0]).to_seconds()).collect();
        let mut concerns = Vec::new();
        if let Some(i) = steps_s.iter().position(|s| *s <= 0.0) {
            let what =
                if steps_s[i] == 0.0 { "is that of sample" } else { "is before that of sample" };
            concerns.push(format!(
            "the times do not increase: that of sample {} ({}) {what} {}; the result keeps their order",
            i + 2,
            sunglint_formats::time::format_utc(pass.times[i + 1], 3),
            i + 1
        ));
        } else if let Some(i) =
            steps_s.iter().zip(&pass.exposure_s).position(|(s, e)| *e > s * (1.0 + 1e-6))
        {
            concerns.push(format!(
            "exposures are longer than the step between them ({} s and {:.6} s at sample {}): each sample is that of its mid-exposure, and they overlap",
            pass.exposure_s[i],
            steps_s[i],
            i + 1
        ));
        }
        concerns
    }
}
