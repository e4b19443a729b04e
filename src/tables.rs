//! `sunglint tables`: what the program carries with it, and where it is from.

use crate::output::{Console, OutputArgs};
use anyhow::bail;
use clap::Args;
use sunglint_radiometry::tables;
use sunglint_report::tables::{Description, list, list_text, product, text};

/// Arguments of `sunglint tables`.
#[derive(Debug, Args)]
pub struct TablesArgs {
    /// The table to show or write; all are listed without it
    pub name: Option<String>,
    /// Where the table goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// Lists the tables, or shows or writes one.
pub fn run(args: &TablesArgs, console: Console) -> anyhow::Result<()> {
    args.out.check()?;
    let Some(name) = &args.name else {
        let rows: Vec<Description> = tables::all().iter().map(|t| Description::of(t)).collect();
        return args.out.finish(&list(&rows), &list_text(&rows), console);
    };
    let Some(embedded) = tables::get(name) else {
        let near = tables::similar_names(name);
        if near.is_empty() {
            let names: Vec<&str> = tables::all().iter().map(|t| t.name).collect();
            bail!("there is no table `{name}`; the tables are {}", names.join(", "));
        }
        bail!(
            "there is no table `{name}`; did you mean {}? (`sunglint tables` lists all)",
            near.join(", ")
        );
    };
    args.out.finish(&product(embedded), &text(embedded), console)
}
