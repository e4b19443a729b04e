//! Factors and an offset that a fit found beside the scene, and that no other key of a scene can say: `[correction]` of a `PASS.toml`.

use super::Place;
use crate::light::{Source, Term};
use crate::target::Target;
use std::collections::BTreeMap;

/// Corrections of a pass. The default changes nothing.
#[derive(Debug, Clone, PartialEq)]
pub struct Correction {
    /// Seconds by which everything (geometry, attitude, light) is later than the times of the samples.
    pub time_offset_s: f64,
    /// Factor of all light.
    pub gain: f64,
    /// Factor of all lengths of the body, as seen from afar: light goes with its square.
    pub size: f64,
    /// Extinction beyond the air's, magnitudes per airmass, in all channels and in magnitudes below the air.
    pub extinction: f64,
    /// The same of single channels, added to it.
    pub extinction_by_channel: BTreeMap<String, f64>,
    /// Factors of the light that single materials reflect, by their names.
    pub light: BTreeMap<String, LightFactor>,
}

/// Factor of a material's light, in all channels and bands and of single channels.
#[derive(Debug, Clone, PartialEq)]
pub struct LightFactor {
    /// Factor in all channels and bands.
    pub all: f64,
    /// Further factors of single channels, by their names.
    pub channel: BTreeMap<String, f64>,
}

impl Default for Correction {
    fn default() -> Self {
        Self {
            time_offset_s: 0.0,
            gain: 1.0,
            size: 1.0,
            extinction: 0.0,
            extinction_by_channel: BTreeMap::new(),
            light: BTreeMap::new(),
        }
    }
}

impl Default for LightFactor {
    fn default() -> Self {
        Self { all: 1.0, channel: BTreeMap::new() }
    }
}

impl Correction {
    /// Returns true where nothing is corrected.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// Factor of a term's light, in a channel, or in a band where there is none. Light that was on several materials follows none of them.
    pub(super) fn factor(&self, term: &Term, target: &Target, channel: Option<&str>) -> f64 {
        let grey = self.gain * self.size * self.size;
        let material = term.material.filter(|_| term.source != Source::Bounce);
        let name = material.and_then(|m| target.materials.get(m)).map(|m| m.name.as_str());
        let own = name.and_then(|name| self.light.get(name)).map_or(1.0, |light| {
            let one = channel.and_then(|c| light.channel.get(c)).copied();
            light.all * one.unwrap_or(1.0)
        });
        grey * own
    }

    /// Transmission of the extinction at a place, in a channel, or in a band where there is none; 1 below the horizon.
    pub(super) fn dimming(&self, place: &Place, channel: Option<&str>) -> f64 {
        let own = channel.and_then(|c| self.extinction_by_channel.get(c)).copied();
        let k = self.extinction + own.unwrap_or(0.0);
        match place.apparent_zenith_deg {
            Some(deg) if k != 0.0 => 10_f64.powf(-0.4 * k * airmass(deg)),
            _ => 1.0,
        }
    }
}

/// Relative air mass of an apparent zenith angle in degrees (Kasten and Young 1989).
pub fn airmass(apparent_zenith_deg: f64) -> f64 {
    let below = (96.079_95 - apparent_zenith_deg).powf(-1.636_4);
    1.0 / (apparent_zenith_deg.to_radians().cos() + 0.505_72 * below)
}
