//! Maps of a body, and the samples that stand on them.

use hifitime::Epoch;
use sunglint_analysis::map::BodyMap;
use sunglint_radiometry::light_curve::Samples;

/// Quantity of a map or of a column of a track.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MapQuantity {
    /// Reflection factor of a channel, m² sr⁻¹.
    Factor,
    /// Light of a material in truth, m² sr⁻¹ at a reflectance of 1.
    Weight,
    /// Share of a material as unmixing finds it.
    Share,
    /// Metres away from the observer against the body's origin.
    Range,
    /// Hz at the detector.
    Rate,
}

/// One map.
#[derive(Debug, Clone)]
pub struct MapLayer {
    /// The channel, material or range that it is of.
    pub name: String,
    /// The quantity of its values.
    pub quantity: MapQuantity,
    /// The values.
    pub map: BodyMap,
    /// Variance within cells over that of all samples.
    pub agreement: Option<f64>,
}

/// Values of a track, one for each sample.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackColumn {
    /// The channel or material.
    pub name: String,
    /// The quantity.
    pub quantity: MapQuantity,
    /// The values.
    pub values: Vec<f64>,
}

/// Where samples stand, and what they have.
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    /// Times of the samples.
    pub time: Vec<Epoch>,
    /// Longitude and latitude of the phase vector in the body's frame, degrees.
    pub at: Vec<(f64, f64)>,
    /// Their values.
    pub columns: Vec<TrackColumn>,
}

impl Track {
    /// A track without values.
    pub fn new(samples: &Samples, at: &[(f64, f64)]) -> Self {
        Self { time: samples.time.clone(), at: at.to_vec(), columns: Vec::new() }
    }

    /// Adds a column.
    pub fn push(&mut self, name: impl Into<String>, quantity: MapQuantity, values: Vec<f64>) {
        self.columns.push(TrackColumn { name: name.into(), quantity, values });
    }
}

/// A curve from a map against the direct one.
#[derive(Debug, Clone, PartialEq)]
pub struct Shortcut {
    /// The channel.
    pub channel: String,
    /// Samples that both have.
    pub samples: usize,
    /// Σ|found − direct|/Σ direct.
    pub relative_error: f64,
    /// Median of |found/direct − 1|.
    pub median: f64,
    /// 95th percentile of |found/direct − 1|.
    pub worst_of_twenty: f64,
}

impl Shortcut {
    /// Holds the rates of a map against the direct ones.
    pub fn of(channel: &str, direct: &[f64], found: &[f64]) -> Self {
        let pairs = direct.iter().zip(found);
        let pairs: Vec<(f64, f64)> = pairs
            .filter(|(d, f)| d.is_finite() && f.is_finite() && **d > 0.0)
            .map(|(d, f)| (*d, *f))
            .collect();
        let sum: f64 = pairs.iter().map(|(d, _)| d).sum();
        let off: f64 = pairs.iter().map(|(d, f)| (f - d).abs()).sum();
        let mut each: Vec<f64> = pairs.iter().map(|(d, f)| (f / d - 1.0).abs()).collect();
        each.sort_by(f64::total_cmp);
        let at = |part: f64| {
            let last = each.len().saturating_sub(1) as f64;
            each.get((part * last).round() as usize).copied().unwrap_or(f64::NAN)
        };
        Self {
            channel: channel.to_owned(),
            samples: pairs.len(),
            relative_error: off / sum,
            median: at(0.5),
            worst_of_twenty: at(0.95),
        }
    }
}

/// Maps on the frame of a body.
#[derive(Debug, Clone)]
pub struct BodyMaps {
    /// Subject of the maps, for titles.
    pub title: String,
    /// The phase angle of a map over all directions, degrees.
    pub phase_deg: Option<f64>,
    /// The maps.
    pub layers: Vec<MapLayer>,
    /// The samples on them, where there are any.
    pub track: Option<Track>,
    /// The error of maps in place of the light engine along the pass, channel by channel.
    pub shortcut: Vec<Shortcut>,
    /// Warnings about the result, for the user.
    pub warnings: Vec<String>,
}
