//! The light curves that are asked about, and the scene that they are of.

use crate::air::AirModelArgs;
use crate::curve_file::{Magnitudes, with_hint};
use crate::simulate;
use crate::station::StationArgs;
use anyhow::{Context as _, anyhow};
use clap::{Args, ValueEnum};
use hifitime::Epoch;
use std::path::{Path, PathBuf};
use sunglint_analysis::curves::{Curves, CurvesError, Trends};
use sunglint_analysis::series::Series;
use sunglint_analysis::synodic::Bisectors;
use sunglint_inference::bisector;
use sunglint_simulator::pass::Overrides;

/// Which curves, and which channels of them.
#[derive(Debug, Args)]
pub struct CurveArgs {
    /// Light curves (ECSV, as `simulate`, `reduce` and `apply` write them), or tables of magnitudes (MMT-9's text format, CSV with `time_utc` and `magnitude`).
    /// Several are taken together: each with brightnesses of its own, one period for all
    #[arg(required = true, value_name = "CURVE")]
    pub curves: Vec<PathBuf>,
    /// Only this channel; may be given several times [default: all]
    #[arg(long, value_name = "NAME")]
    pub channel: Vec<String>,
    /// Do not remove this from the light: `air`, `range`, `phase` (the slow change with phase angle); may be given several times [default: all is removed that the
    /// curve has columns for; the air if there is a station too]
    #[arg(long, value_name = "WHAT")]
    pub keep: Vec<Keep>,
    /// How a table of magnitudes is read.
    #[command(flatten)]
    pub magnitudes: Magnitudes,
    /// Which station: its channels and its air.
    #[command(flatten)]
    pub station: StationArgs,
    /// Known properties of the air.
    #[command(flatten)]
    pub model: AirModelArgs,
}

/// Effect that may stay in the light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Keep {
    /// The air's extinction
    Air,
    /// The square of the range
    Range,
    /// The slow change with phase angle
    Phase,
}

impl CurveArgs {
    /// Reads the curves, and removes from their light what is not to be kept.
    ///
    /// # Errors
    /// A file that is no light curve, or has no sample; a channel that none of them has; a station or an air that cannot be.
    pub fn read(&self) -> anyhow::Result<Curves> {
        self.read_and(|_| false)
    }

    /// The same; the phase trend stays in the light where `joins` says that sessions are joined, whose zero points are free.
    ///
    /// # Errors
    /// The errors of [`CurveArgs::read`].
    pub fn read_and(&self, joins: impl Fn(&Curves) -> bool) -> anyhow::Result<Curves> {
        let read = Curves::read(&self.curves, &self.magnitudes.options(), &self.channel);
        let mut curves = read.map_err(worded)?;
        let joined = joins(&curves);
        let keeps = |what| self.keep.contains(&what);
        let station = if keeps(Keep::Air) { None } else { self.station.find()? };
        if !keeps(Keep::Air) && station.is_none() && curves.has_rates() {
            curves.warnings.push("the air is not removed: no station says through which air and with which channels (--station; --keep air to say nothing)".into());
        }
        let air = match &station {
            Some(s) => Some(self.model.air(s.site.geodetic().height_m, Some(s))?),
            None => None,
        };
        curves.remove(&Trends {
            air: station.as_ref().zip(air.as_ref()),
            range: !keeps(Keep::Range),
            phase: !keeps(Keep::Phase) && !joined,
        });
        Ok(curves)
    }

    /// The bisector of Sun and station of a scene at the times of some series, which count seconds from `zero`.
    ///
    /// # Errors
    /// A scene that cannot be read; a time outside its orbit or the tables of the sky.
    pub fn bisectors(
        &self,
        scene: &Path,
        zero: Epoch,
        series: &[Series],
    ) -> anyhow::Result<Option<Bisectors>> {
        let pass = simulate::read(scene, &self.station, Overrides::default())?;
        bisector::bisectors(&pass, zero, series).with_context(|| scene.display().to_string())
    }
}

/// The error with the option that may help.
fn worded(error: CurvesError) -> anyhow::Error {
    match error {
        CurvesError::Published(error) => with_hint(error),
        CurvesError::Channel { wanted, nearest } => {
            anyhow!("--channel {wanted}: no curve has it; the nearest are {}", nearest.join(", "))
        }
        error => error.into(),
    }
}
