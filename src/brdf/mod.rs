//! `sunglint brdf`: a sample on a goniometer, from retro-reflection to a measured material.

mod assemble;
mod fit;
mod ingest;
mod lab;
mod ndf;
mod page;
mod plan;
pub mod retro;
pub(crate) mod rig;
mod run;
mod show;

pub use assemble::AssembleArgs;
pub use fit::FitArgs;
pub use ingest::IngestArgs;
pub use ndf::NdfArgs;
pub use page::PageArgs;
pub use plan::PlanArgs;
pub use retro::RetroArgs;
pub use run::RunArgs;
pub use show::{CompareArgs, ShowArgs};

use crate::output::{Console, OutputArgs};
use clap::Subcommand;

/// The steps of a measurement, each with a table that the next one reads.
#[derive(Debug, Subcommand)]
pub enum BrdfCommand {
    /// Retro-reflection against angle, from a stage and a power meter (real ones, or a virtual rig)
    Retro(RetroArgs),
    /// The density of microfacet normals from retro-reflection against angle, with F0 and the best Beckmann and GGX roughness
    Ndf(NdfArgs),
    /// Where to measure a sample: incident elevations and outgoing directions by its microfacets
    Plan(PlanArgs),
    /// Drive a goniometer through a plan, beginning with the instrument itself; a virtual one to try it
    Run(RunArgs),
    /// A run's folder, or a spectrometer's files direction by direction, as BRDF values
    Ingest(IngestArgs),
    /// Laws with few parameters through measured values: Lambert, Phong, ABg, Ward, Cook–Torrance, Maxwell–Beard
    Fit(FitArgs),
    /// Measured values and NDF as a material: a .bsdf file, what of it is extrapolated, and the TOML that a scene takes
    Assemble(AssembleArgs),
    /// Show what a material does: slices, lobes, hemispherical reflectance, reciprocity
    Show(ShowArgs),
    /// How two materials differ, by direction
    Compare(CompareArgs),
    /// A material as a page: lobes, cuts, spectra, hemispherical reflectance, a ball, a box with a wing
    Page(PageArgs),
}

impl BrdfCommand {
    /// Where its result goes, for what has the usual choice.
    pub fn output(&self) -> Option<&OutputArgs> {
        match self {
            Self::Retro(args) => Some(&args.out),
            Self::Ndf(args) => Some(&args.out),
            Self::Plan(args) => Some(&args.out),
            Self::Run(args) => Some(&args.out),
            Self::Ingest(args) => Some(&args.out),
            Self::Fit(args) => Some(&args.out),
            Self::Show(args) => Some(&args.out),
            Self::Compare(args) => Some(&args.out),
            Self::Assemble(_) | Self::Page(_) => None,
        }
    }
}

/// Does what is asked.
///
/// # Errors
/// A table that is not what it should be, and what the step refuses, with the reason.
pub fn run(command: &BrdfCommand, console: Console, seed: u64) -> anyhow::Result<()> {
    match command {
        BrdfCommand::Retro(args) => retro::run(args, console),
        BrdfCommand::Ndf(args) => ndf::run(args, console, seed),
        BrdfCommand::Plan(args) => plan::run(args, console),
        BrdfCommand::Run(args) => run::run(args, console),
        BrdfCommand::Ingest(args) => ingest::run(args, console),
        BrdfCommand::Fit(args) => fit::run(args, console),
        BrdfCommand::Assemble(args) => assemble::run(args, console),
        BrdfCommand::Show(args) => show::show(args, console),
        BrdfCommand::Compare(args) => show::compare(args, console),
        BrdfCommand::Page(args) => page::run(args, console),
    }
}
