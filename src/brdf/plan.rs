//! `sunglint brdf plan`: where to measure a sample.

use crate::output::{Console, OutputArgs, Usage};
use crate::progress::Bar;
use anyhow::Context as _;
use clap::Args;
use std::path::PathBuf;
use sunglint_formats::toml::Document;
use sunglint_materials::goniometer::bench::{Bench, USUAL_BENCH};
use sunglint_materials::goniometer::budget::{Budget, within_budget};
use sunglint_materials::plan::{PlanOptions, Rig, plan};
use sunglint_materials::read;
use sunglint_report::brdf::plan::{product, text};

/// Arguments of `sunglint brdf plan`.
#[derive(Debug, Args)]
pub struct PlanArgs {
    /// The sample's NDF, as `sunglint brdf ndf` writes it
    #[arg(value_name = "NDF")]
    pub ndf: PathBuf,
    /// Measure so many directions: those that lower the doubt of the material most, among those that the bench reaches
    #[arg(long, value_name = "N", conflicts_with = "hours")]
    pub measurements: Option<usize>,
    /// Measure as many directions as the bench does in this time, its own signature, zeros, stray light and references among it
    #[arg(long, value_name = "H")]
    pub hours: Option<f64>,
    /// The bench of --measurements and --hours: its reach and its speeds (docs/lab-run.md) [default: a bench as usual]
    #[arg(long, value_name = "BENCH.toml")]
    pub bench: Option<PathBuf>,
    /// Number of incident elevations [default: 8; 16 to choose from with --measurements or --hours]
    #[arg(long, value_name = "N")]
    pub theta_i: Option<usize>,
    /// Number of incident azimuths of an anisotropic sample, both ends included
    #[arg(long, value_name = "N", default_value_t = 9)]
    pub phi_i: usize,
    /// The sample is symmetric about its axes: a quarter of the circle says all
    #[arg(long)]
    pub quarter: bool,
    /// Side of the grid of outgoing directions [default: 32; 33 with --rig; 24 with --measurements or --hours]
    #[arg(long, value_name = "N")]
    pub side: Option<usize>,
    /// Nodes of the densities in elevation and azimuth
    #[arg(long, value_name = "N", default_value_t = 128)]
    pub normals: usize,
    /// Share of the directions that is spread over all tilts, for the lobe's tails; 0 as in the paper
    #[arg(long, value_name = "SHARE", default_value_t = 0.25)]
    pub wide: f64,
    /// Largest angle of incidence [default: 89.9; 55 with --rig; what the bench reaches with --measurements or --hours]
    #[arg(long, value_name = "DEG")]
    pub most_theta_i_deg: Option<f64>,
    /// A rig that turns in the plane of incidence, by hand to marks, and shades itself at small phase angles
    #[arg(long, conflicts_with_all = ["measurements", "hours"])]
    pub rig: bool,
    /// The rig's least angle between lamp and detector [default: 30]
    #[arg(long, value_name = "DEG", requires = "rig")]
    pub least_phase_deg: Option<f64>,
    /// The rig's largest angle of the detector from the normal [default: 89]
    #[arg(long, value_name = "DEG", requires = "rig")]
    pub most_theta_o_deg: Option<f64>,
    /// Distance of the rig's marks [default: 1]
    #[arg(long, value_name = "DEG", requires = "rig")]
    pub mark_deg: Option<f64>,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

impl PlanArgs {
    fn budget(&self) -> anyhow::Result<Option<Budget>> {
        let budget = match (self.measurements, self.hours) {
            (Some(count), _) => Some(Budget::Directions(count)),
            (None, Some(hours)) if hours.is_finite() && hours > 0.0 => Some(Budget::Hours(hours)),
            (None, Some(hours)) => {
                let text = format!("--hours: found {hours}, expected a time above 0");
                return Err(Usage(text).into());
            }
            (None, None) => None,
        };
        if budget.is_none() && self.bench.is_some() {
            let text = "--bench goes with --measurements or --hours";
            return Err(Usage(text.into()).into());
        }
        Ok(budget)
    }

    fn options(&self, bench: Option<&Bench>) -> PlanOptions {
        let mut options = match bench {
            Some(bench) => {
                PlanOptions::to_choose_from(bench.reach.most_theta_i_deg.get().min(89.9))
            }
            None => PlanOptions::default(),
        };
        if self.rig {
            let usual = Rig::default();
            options = PlanOptions::of_rig(Rig {
                least_phase_deg: self.least_phase_deg.unwrap_or(usual.least_phase_deg),
                most_theta_i_deg: self.most_theta_i_deg.unwrap_or(usual.most_theta_i_deg),
                most_theta_o_deg: self.most_theta_o_deg.unwrap_or(usual.most_theta_o_deg),
                mark_deg: self.mark_deg.unwrap_or(usual.mark_deg),
            });
        }
        options.theta_i = self.theta_i.unwrap_or(options.theta_i);
        options.side = self.side.unwrap_or(options.side);
        options.most_theta_i_deg = self.most_theta_i_deg.unwrap_or(options.most_theta_i_deg);
        PlanOptions {
            phi_i: self.phi_i,
            quarter: self.quarter,
            normals: self.normals,
            wide: self.wide,
            ..options
        }
    }
}

pub(super) fn run(args: &PlanArgs, console: Console) -> anyhow::Result<()> {
    args.out.check()?;
    let budget = args.budget()?;
    let (ndf, mut inputs) = read::density(&args.ndf)?;
    if args.quarter && ndf.is_isotropic() {
        return Err(Usage("--quarter: the sample is isotropic, it has no azimuths".into()).into());
    }
    let bench = match (budget, &args.bench) {
        (None, _) => None,
        (Some(_), Some(path)) => {
            let (document, others) = read::document(path)?;
            inputs.extend(others);
            // Of a virtual bench only its name is in the file, and a plan needs no more.
            Some(Bench::new(&document, Some(""))?)
        }
        (Some(_), None) => Some(Bench::new(&Document::new("bench", USUAL_BENCH)?, Some(""))?),
    };
    let sample = || args.ndf.display().to_string();
    let mut made = plan(&ndf, &args.options(bench.as_ref())).with_context(sample)?;
    if let (Some(budget), Some(bench)) = (budget, &bench) {
        let bar = Bar::new(console);
        let chosen = within_budget(&made, &ndf, bench, budget, &bar);
        drop(bar);
        made = chosen.with_context(sample)?;
    }
    args.out.finish(&product(&made, &inputs), &text(&made), console)
}
