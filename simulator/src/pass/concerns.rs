//! Warnings to read before believing the numbers of a simulated pass.

use super::{Pass, Simulation, Totals};
use crate::attitude::Attitude;
use crate::light;
use crate::target::Shape;

impl Simulation<'_> {
    /// Returns the warnings to read before believing the numbers.
    pub fn concerns(&self) -> Vec<String> {
        self.totals().concerns()
    }
}

impl Totals<'_> {
    /// Returns the warnings to read before believing the numbers.
    pub fn concerns(&self) -> Vec<String> {
        let pass = self.pass;
        let mut concerns = self.scene.warnings.clone();
        concerns.extend(light::concerns(&self.needs));
        let round = |shape: &Shape| matches!(shape, Shape::Sphere { .. });
        let turned =
            !pass.target.parts.iter().all(|p| round(&p.shape)) || !pass.target.hinges.is_empty();
        if turned && !pass.attitude_given && matches!(pass.attitude, Attitude::Inertial(_)) {
            concerns.push("no [attitude] is given: the body stands still among the stars, its axes along those of the GCRS".into());
        }
        let outside = self.outside.as_ref();
        concerns.extend(outside.map(|o| format!("{o} ([earth_orientation] file = \"FILE\")")));
        if let (0, Some(best)) = (self.visible, self.highest) {
            concerns.push(format!(
                "{} is never above the horizon of {} in these times: at its highest, {}, it stands at {:+.2}° (the horizon there is at {:.1}°); take other times or another station",
                self.object,
                pass.station.name,
                sunglint_formats::time::format_utc(best.epoch, 1),
                best.altitude_deg,
                pass.station.horizon.elevation_deg(best.azimuth_deg),
            ));
        }
        if !self.any_sun {
            concerns.push(format!(
            "{} is in the Earth's shadow all the time: the Sun stands behind the Earth, and every rate is 0 (flag eclipsed)",
            self.object
        ));
        }
        let day = self.day;
        if day > 0 {
            concerns.push(format!(
            "in {day} of the visible samples the Sun is above -6° at {}: the sky is bright, and its light is not in the rates",
            pass.station.name
        ));
        }
        if let Some(worst) = self.smeared() {
            let samples = self.samples;
            concerns.push(format!(
            "in {} of {samples} samples the light changes while they are exposed, more than the tolerance: a sample is the middle of its exposure, not its mean, from which it is off by {} at most (sample {}, {} s; flag over_tolerance); take shorter exposures, or many short ones and their mean",
            worst.samples,
            light::percent(worst.relative),
            worst.sample + 1,
            pass.exposure_s[worst.sample],
        ));
        }
        for channel in &self.channels {
            let saturated = channel.saturated;
            if saturated > 0 {
                concerns.push(format!(
                    "{}: {saturated} samples past saturation: attenuate",
                    channel.name
                ));
            }
            let uncovered = channel.uncovered_nm;
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
