//! The fibre's field: whether the target stood in it, and how much of its light was coupled.

use crate::track::{NoPlace, Place, Track};
use glam::DVec2;
use hifitime::{Duration, Epoch};
use sunglint_radiometry::station::Fibre;

/// How samples are gated by the target's place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gate {
    /// Samples are kept where q = ((x−x₀)/σ_x)² + ((y−y₀)/σ_y)² is at most this; `None` keeps all.
    pub most_q: Option<f64>,
    /// Whether rates are divided by the coupling, so that they are those of a target at the fibre's centre.
    pub divide: bool,
    /// How far apart two frames may be for a place between them, s.
    pub apart_s: f64,
    /// How much the target wanders between frames, px²/s; `None` for what each visit's own frames say.
    pub wander_px2_per_s: Option<f64>,
}

impl Default for Gate {
    fn default() -> Self {
        Self { most_q: Some(1.0), divide: true, apart_s: 10.0, wander_px2_per_s: None }
    }
}

/// Coupling of a target's light into a fibre, relative to the fibre's centre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coupling {
    /// Mean coupling over the bin and over the uncertainty of the place.
    pub mean: f64,
    /// Standard uncertainty of the coupling from the place.
    pub sigma: f64,
}

/// Coupling exp(−q/2) at a place that is known to a normal distribution of covariance C: with S = diag(σ_x², σ_y²) its mean is
/// √(|S|/|S+C|) exp(−½ dᵀ(S+C)⁻¹d), the mean of its square the same with S/2 for S.
pub fn coupling(fibre: &Fibre, place: &Place) -> Coupling {
    let d = [0, 1].map(|i| place.offset_px[i] - fibre.offset_px[i]);
    let [cxx, cyy, cxy] = place.covariance_px2;
    let moment = |part: f64| {
        let [sxx, syy] = fibre.sigma_px.to_array().map(|sigma| part * sigma * sigma);
        let (xx, yy) = (sxx + cxx, syy + cyy);
        let det = xx * yy - cxy * cxy;
        let q = (yy * d[0] * d[0] - 2.0 * cxy * d[0] * d[1] + xx * d[1] * d[1]) / det;
        (sxx * syy / det).sqrt() * (-0.5 * q).exp()
    };
    let mean = moment(1.0);
    Coupling { mean, sigma: (moment(0.5) - mean * mean).max(0.0).sqrt() }
}

/// q of a place.
pub(super) fn q(fibre: &Fibre, offset_px: DVec2) -> f64 {
    (0..2).map(|i| ((offset_px[i] - fibre.offset_px[i]) / fibre.sigma_px[i]).powi(2)).sum()
}

/// Nodes and weights of Gauss and Legendre on 0…1.
const NODES: [(f64, f64); 3] = [
    (0.112_701_665_379_258_3, 5.0 / 18.0),
    (0.5, 8.0 / 18.0),
    (0.887_298_334_620_741_7, 5.0 / 18.0),
];

/// The mean coupling over a bin in which the target moves from frame to frame.
pub(super) fn over_bin(
    fibre: &Fibre,
    track: &Track,
    from: Epoch,
    exposure_s: f64,
    gate: &Gate,
    wander: f64,
) -> Result<Coupling, NoPlace> {
    let to = from + Duration::from_seconds(exposure_s);
    let first = track.points.partition_point(|p| p.time <= from);
    let frames = track.points[first..].iter().map(|p| p.time).take_while(|time| *time < to);
    let (mut mean, mut sigma, mut start) = (0.0, 0.0, from);
    for end in frames.chain([to]) {
        let length_s = (end - start).to_seconds();
        for (node, weight) in NODES {
            let time = start + Duration::from_seconds(node * length_s);
            let at = coupling(fibre, &track.at(time, gate.apart_s, wander)?.place);
            mean += weight * at.mean * length_s / exposure_s;
            sigma += weight * at.sigma * length_s / exposure_s;
        }
        start = end;
    }
    Ok(Coupling { mean, sigma })
}
