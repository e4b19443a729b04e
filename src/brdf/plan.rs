//! `sunglint brdf plan`: where to measure a sample.

use crate::output::{Console, OutputArgs, Usage};
use anyhow::Context as _;
use clap::Args;
use std::path::PathBuf;
use sunglint_materials::plan::{PlanOptions, Rig, plan};
use sunglint_materials::read;
use sunglint_report::brdf::plan::{product, text};

/// Arguments of `sunglint brdf plan`.
#[derive(Debug, Args)]
pub struct PlanArgs {
    /// The sample's NDF, as `sunglint brdf ndf` writes it
    #[arg(value_name = "NDF")]
    pub ndf: PathBuf,
    /// Number of incident elevations
    #[arg(long, value_name = "N", default_value_t = 8)]
    pub theta_i: usize,
    /// Number of incident azimuths of an anisotropic sample, both ends included
    #[arg(long, value_name = "N", default_value_t = 9)]
    pub phi_i: usize,
    /// The sample is symmetric about its axes: a quarter of the circle says all
    #[arg(long)]
    pub quarter: bool,
    /// Side of the grid of outgoing directions [default: 32; 33 with --rig]
    #[arg(long, value_name = "N")]
    pub side: Option<usize>,
    /// Nodes of the densities in elevation and azimuth
    #[arg(long, value_name = "N", default_value_t = 128)]
    pub normals: usize,
    /// Share of the directions that is spread over all tilts, for the lobe's tails; 0 as in the paper
    #[arg(long, value_name = "SHARE", default_value_t = 0.25)]
    pub wide: f64,
    /// Largest angle of incidence [default: 89.9; 55 with --rig]
    #[arg(long, value_name = "DEG")]
    pub most_theta_i_deg: Option<f64>,
    /// A rig that turns in the plane of incidence, by hand to marks, and shades itself at small phase angles
    #[arg(long)]
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
    fn options(&self) -> PlanOptions {
        let mut options = PlanOptions::default();
        if self.rig {
            let usual = Rig::default();
            options = PlanOptions::of_rig(Rig {
                least_phase_deg: self.least_phase_deg.unwrap_or(usual.least_phase_deg),
                most_theta_i_deg: self.most_theta_i_deg.unwrap_or(usual.most_theta_i_deg),
                most_theta_o_deg: self.most_theta_o_deg.unwrap_or(usual.most_theta_o_deg),
                mark_deg: self.mark_deg.unwrap_or(usual.mark_deg),
            });
        }
        options.side = self.side.unwrap_or(options.side);
        options.most_theta_i_deg = self.most_theta_i_deg.unwrap_or(options.most_theta_i_deg);
        PlanOptions {
            theta_i: self.theta_i,
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
    let (ndf, inputs) = read::density(&args.ndf)?;
    if args.quarter && ndf.is_isotropic() {
        return Err(Usage("--quarter: the sample is isotropic, it has no azimuths".into()).into());
    }
    let made = plan(&ndf, &args.options()).with_context(|| args.ndf.display().to_string())?;
    args.out.finish(&product(&made, &inputs), &text(&made), console)
}
