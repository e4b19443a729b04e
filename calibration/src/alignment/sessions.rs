//! Fields of a station's fibres from the stars of recorded sessions.

use super::{FieldFit, FieldMap, FieldPoint, FitOptions, Stand, fit_field};
use crate::counts::{CountChannel, Sample};
use crate::reduction::counts::{CountOptions, Fibres, gate};
use crate::reduction::frames::FrameOptions;
use crate::reduction::{ReduceError, ReduceOptions, Stay, reduce_with};
use crate::track::wander_px2_per_s;
use hifitime::Epoch;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use sunglint_formats::FileError;
use sunglint_formats::session::{Session, TargetKind};
use sunglint_numerics::progress::Progress;
use sunglint_radiometry::station::Station;

/// How fields are found.
#[derive(Debug, Clone)]
pub struct AlignOptions {
    /// How frames are measured; `None` for a station without a camera.
    pub frames: Option<FrameOptions>,
    /// Side of a cell of the measured map, px.
    pub cell_px: f64,
    /// Whether the field may be turned against the frame.
    pub rotation: bool,
}

impl AlignOptions {
    /// The usual options for a station.
    pub fn for_station(station: &Station) -> Self {
        Self { frames: FrameOptions::for_station(station), cell_px: CELL_PX, rotation: false }
    }
}

/// Side of a cell of the measured map, px, where nothing is said.
pub const CELL_PX: f64 = 4.0;

/// Why no field is found.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AlignError {
    /// A session that cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
    /// A session that cannot be reduced.
    #[error("session {}", path.display())]
    Session {
        /// Folder of the session.
        path: PathBuf,
        /// The reason.
        #[source]
        source: Box<ReduceError>,
    },
    /// No channel has a field that could be fitted.
    #[error(
        "no field could be fitted from {stars} stars: stars must be seen by a camera and a counter at once, at places that differ by the field's width"
    )]
    NoField {
        /// Visits to stars.
        stars: usize,
        /// Warnings for the user, the reason of each channel among them.
        warnings: Vec<String>,
    },
}

/// Field of a channel's fibre.
#[derive(Debug, Clone)]
pub struct Field {
    /// The channel.
    pub channel: String,
    /// The fit.
    pub fit: FieldFit,
    /// Measured field, cell by cell.
    pub map: FieldMap,
    /// Visits to stars.
    pub stars: usize,
    /// Rates.
    pub points: usize,
}

/// Fields of a station's fibres.
#[derive(Debug, Clone)]
pub struct Alignment {
    /// By channel.
    pub fields: Vec<Field>,
    /// Warnings for the user.
    pub warnings: Vec<String>,
}

/// Fits the fields of a station's fibres to the stars of sessions.
///
/// # Errors
/// Sessions that cannot be reduced; no channel whose field could be fitted.
pub fn align(
    sessions: &[PathBuf],
    station: &Station,
    options: &AlignOptions,
    progress: &dyn Progress,
) -> Result<Alignment, AlignError> {
    let mut stars = Stars::default();
    let reduce = ReduceOptions {
        frames: options.frames.clone(),
        counts: ungated(),
        fibres: Fibres::new(),
        // A star beside the fibre is what shows the field's rim.
        off_sigmas: None,
        target: None,
        visit: None,
    };
    for path in sessions {
        stars.add(path, station, &reduce, progress)?;
    }
    let Stars { points, names, mut warnings } = stars;
    let mut fields = Vec::new();
    let fit_options =
        FitOptions { rotation: options.rotation, background: true, ..FitOptions::default() };
    for (channel, points) in points {
        match fit_field(&points, &fit_options) {
            Ok(fit) => {
                let map = FieldMap::new(&points, &fit, options.cell_px);
                fields.push(Field {
                    channel,
                    stars: fit.amplitudes_hz.len(),
                    points: points.len(),
                    fit,
                    map,
                });
            }
            Err(error) => warnings.push(format!("channel {channel}: {error}")),
        }
    }
    if fields.is_empty() {
        return Err(AlignError::NoField { stars: names.len(), warnings });
    }
    Ok(Alignment { fields, warnings })
}

fn ungated() -> CountOptions {
    let mut counts = CountOptions::default();
    counts.bins.gate = gate(None, false);
    counts
}

/// A rate of a star, whose place is not looked up yet.
struct Rate {
    channel: String,
    star: usize,
    stay: usize,
    time: Epoch,
    exposure_s: f64,
    rate_hz: f64,
    sigma_hz: f64,
}

/// Rates of stars by channel, the stars' names, and warnings.
#[derive(Default)]
struct Stars {
    points: BTreeMap<String, Vec<FieldPoint>>,
    names: Vec<String>,
    warnings: Vec<String>,
}

impl Stars {
    /// Adds a session.
    fn add(
        &mut self,
        path: &Path,
        station: &Station,
        options: &ReduceOptions,
        progress: &dyn Progress,
    ) -> Result<(), AlignError> {
        let session = Session::open(path)?;
        let night = session.manifest().start_utc;
        let Self { points, names, .. } = self;
        let mut rates = Vec::new();
        let mut each = |channels: &[CountChannel], stay: &Stay, sample: &Sample| {
            if stay.target.target_kind != TargetKind::Star {
                return;
            }
            // Air and clouds change between visits: each has an amplitude of its own.
            let name = format!("{} {} {night}", stay.target.name, stay.number);
            let star = names.iter().position(|known| *known == name).unwrap_or_else(|| {
                names.push(name);
                names.len() - 1
            });
            for (channel, found) in channels.iter().zip(&sample.channels) {
                if channel.fibre.is_some() && found.rate_hz.is_finite() && found.sigma_hz > 0.0 {
                    rates.push(Rate {
                        channel: channel.name.clone(),
                        star,
                        stay: sample.visit,
                        time: sample.time,
                        exposure_s: sample.exposure_s,
                        rate_hz: found.rate_hz,
                        sigma_hz: found.sigma_hz,
                    });
                }
            }
        };
        let reduced = reduce_with(&session, station, options, progress, &mut each)
            .map_err(|e| AlignError::Session { path: path.to_path_buf(), source: Box::new(e) })?;
        let tracks = reduced.tracks();
        let of_star = reduced.stays.iter().zip(tracks);
        let of_star = of_star.filter(|(stay, _)| stay.target.target_kind == TargetKind::Star);
        // A visit of a few frames does not tell how the telescope wanders; those of a night do.
        let wander = wander_px2_per_s(of_star.map(|(_, track)| track));
        let apart_s = options.counts.bins.gate.apart_s;
        for rate in rates {
            let Rate { channel, star, stay, time, exposure_s, rate_hz, sigma_hz } = rate;
            let Some(track) = tracks.get(stay) else { continue };
            let Ok(stand) = Stand::on(track, time, exposure_s, apart_s, wander) else { continue };
            let Stand { offset_px, covariance_px2, between } = stand;
            points.entry(channel).or_default().push(FieldPoint {
                offset_px,
                covariance_px2,
                rate_hz,
                sigma_hz,
                star,
                between,
            });
        }
        self.warnings.extend(reduced.warnings);
        Ok(())
    }
}
