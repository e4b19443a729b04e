//! Calibration of a curve, as its metadata state it.

use serde::Deserialize;
use serde_json::Value;
use sunglint_numerics::measured::{Interval, pair};

/// κ of the night, as a calibrated curve's metadata hold it.
#[derive(Debug, Clone, Deserialize)]
pub struct Kappa {
    /// File that `sunglint calibrate` wrote.
    pub file: String,
    /// Check sum of that file.
    pub sha256: String,
    /// The night whose κ it is.
    pub night: String,
    /// The air that it was found with.
    pub air: String,
    /// Coverage of the intervals.
    pub confidence: f64,
    /// By channel.
    pub channels: Vec<KappaRow>,
    /// Covariance of ln κ, in the order of the channels.
    pub covariance_ln_kappa: Vec<Vec<f64>>,
}

/// κ of a channel.
#[derive(Debug, Clone, Deserialize)]
pub struct KappaRow {
    /// The channel.
    pub channel: String,
    /// Predicted = κ · measured.
    pub kappa: f64,
    /// Standard uncertainty of ln κ.
    pub relative_sigma: f64,
    /// Interval of κ.
    #[serde(with = "pair")]
    pub interval: Interval,
}

impl Kappa {
    /// Reads κ from a file's metadata; `None` where they are of another kind: a curve from elsewhere may have a note of its own under this key.
    pub(super) fn of(value: &Value) -> Option<Self> {
        let kappa: Self = serde_json::from_value(value.clone()).ok()?;
        let n = kappa.channels.len();
        let square = kappa.covariance_ln_kappa.len() == n
            && kappa.covariance_ln_kappa.iter().all(|row| row.len() == n);
        square.then_some(kappa)
    }

    /// κ of a channel.
    pub fn row(&self, channel: &str) -> Option<&KappaRow> {
        self.channels.iter().find(|row| row.channel == channel)
    }

    /// The relative uncertainty of the quotient of two channels' κ.
    pub fn ratio_sigma(&self, channel: &str, other: &str) -> Option<f64> {
        let place = |name: &str| self.channels.iter().position(|row| row.channel == name);
        let (a, b) = (place(channel)?, place(other)?);
        let c = &self.covariance_ln_kappa;
        Some((c[a][a] + c[b][b] - c[a][b] - c[b][a]).max(0.0).sqrt())
    }
}
