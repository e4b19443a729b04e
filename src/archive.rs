//! `sunglint archive`: which passes lie in the files of many nights, and several of them as one curve.

use crate::output::{Console, OutputArgs, Usage};
use clap::builder::PossibleValue;
use clap::{Args, ValueEnum};
use std::path::PathBuf;
use sunglint_radiometry::light_curve::LightKind;

/// Arguments of `sunglint archive`.
#[derive(Debug, Args)]
pub struct ArchiveArgs {
    /// The folder with the nights: sessions, light curves, magnitudes of other programs, in folders of any depth
    #[arg(value_name = "FOLDER")]
    pub folder: PathBuf,
    /// Only this object: number in the catalogue, or the target's name
    #[arg(long, value_name = "OBJECT")]
    pub object: Option<String>,
    /// Only this channel or filter; may be given several times
    #[arg(long, value_name = "NAME")]
    pub channel: Vec<String>,
    /// Only this kind of light; may be given several times [default: all that is measured]
    #[arg(long, value_enum, value_name = "KIND")]
    pub kind: Vec<KindArg>,
    /// Only of this station, by its name
    #[arg(long, value_name = "NAME")]
    pub of_station: Option<String>,
    /// Only passes that end after this time, UTC
    #[arg(long, value_name = "UTC")]
    pub from: Option<String>,
    /// Only passes that begin before this time, UTC
    #[arg(long, value_name = "UTC")]
    pub to: Option<String>,
    /// Only passes with a sample whose phase angle is below this
    #[arg(long, value_name = "DEG")]
    pub phase_below: Option<f64>,
    /// Only passes with a sample whose phase angle is above this
    #[arg(long, value_name = "DEG")]
    pub phase_above: Option<f64>,
    /// Only channels of passes with as many samples
    #[arg(long, value_name = "N")]
    pub min_samples: Option<u32>,
    /// Print the files of the passes alone, a line each
    #[arg(long, conflicts_with = "curve_out")]
    pub paths: bool,
    /// Write the light of the passes as one curve (.ecsv), which `fit`, `compare` and `analyse` read
    #[arg(long, value_name = "FILE.ecsv")]
    pub curve_out: Option<PathBuf>,
    /// Folder of the index [default: sunglint-archive in FOLDER]
    #[arg(long, value_name = "FOLDER")]
    pub index: Option<PathBuf>,
    /// Read all files again, whether they changed or not
    #[arg(long)]
    pub fresh: bool,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// Kind of light as an option's value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct KindArg(pub LightKind);

impl KindArg {
    const ALL: [Self; LightKind::ALL.len()] = {
        let mut all = [Self(LightKind::Recorded); LightKind::ALL.len()];
        let mut i = 0;
        while i < all.len() {
            all[i] = Self(LightKind::ALL[i]);
            i += 1;
        }
        all
    };
}

impl ValueEnum for KindArg {
    fn value_variants<'a>() -> &'a [Self] {
        &Self::ALL
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        Some(PossibleValue::new(self.0.name()).help(self.0.help()))
    }
}

/// Says how to get a program with archives.
#[cfg(not(feature = "study"))]
pub fn run(_: &ArchiveArgs, _: Console) -> anyhow::Result<()> {
    Err(Usage(
        "this program was built without archives: cargo build --release --features study".into(),
    )
    .into())
}

#[cfg(feature = "study")]
pub use with::run;

#[cfg(feature = "study")]
mod with {
    use super::{ArchiveArgs, Console, Usage};
    use crate::progress::Watched;
    use sunglint_archive::{ArchiveError, Index, Query, join};
    use sunglint_formats::ecsv;
    use sunglint_formats::time::parse_utc;
    use sunglint_report::Product;

    /// Damaged files that are named on stderr at most.
    const NAMED: usize = 10;

    impl ArchiveArgs {
        fn query(&self) -> anyhow::Result<Query> {
            let moment = |option: &str, text: &Option<String>| {
                text.as_deref()
                    .map(|text| parse_utc(text).map_err(|e| Usage(format!("{option}: {e}"))))
                    .transpose()
            };
            let query = Query {
                object: self.object.clone(),
                channels: self.channel.clone(),
                kinds: self.kind.iter().map(|kind| kind.0).collect(),
                station: self.of_station.clone(),
                from: moment("--from", &self.from)?,
                to: moment("--to", &self.to)?,
                phase_below_deg: self.phase_below,
                phase_above_deg: self.phase_above,
                min_samples: self.min_samples,
            };
            query.check().map_err(|error| match error {
                ArchiveError::Phase { field, .. } => {
                    let option = field.trim_end_matches("_deg").replace('_', "-");
                    Usage(format!("--{option}: {error}")).into()
                }
                error => anyhow::Error::from(error),
            })?;
            Ok(query)
        }
    }

    /// Brings the index up to date, and answers.
    pub fn run(args: &ArchiveArgs, console: Console) -> anyhow::Result<()> {
        args.out.check()?;
        if let Some(path) = &args.curve_out {
            if path.extension().is_none_or(|e| !e.eq_ignore_ascii_case("ecsv")) {
                let path = path.display();
                return Err(Usage(format!(
                    "--curve-out {path}: expected a name that ends with .ecsv"
                ))
                .into());
            }
            args.out.check_targets([path.as_path()])?;
        }
        if args.paths && console.json {
            return Err(Usage(
                "--paths and --json both want stdout: the document has the files, too".into(),
            )
            .into());
        }
        let query = args.query()?;
        let mut index = Index::open(&args.folder, args.index.as_deref())?;
        let watched = Watched::new(console)?;
        let updated = index.update(args.fresh, &watched);
        watched.bar.end();
        updated?;
        let found = query.ask(&index);
        for warning in &found.warnings {
            console.warn(warning);
        }
        for damaged in found.damaged.iter().take(NAMED) {
            console.warn(&format!("{} is damaged and left out: {}", damaged.file, damaged.why));
        }
        if let Some(more) = found.damaged.len().checked_sub(NAMED).filter(|more| *more > 0) {
            console
                .warn(&format!("{more} more files are damaged and left out (--json names them)"));
        }
        let mut others = Vec::new();
        if let Some(path) = &args.curve_out {
            let joined = join::join(&found, &query, index.root())?;
            joined.warnings.iter().for_each(|warning| console.warn(warning));
            others.push((path.clone(), ecsv::to_string(&joined.table)?.into_bytes()));
        }
        let product = Product {
            name: "archive".into(),
            table: found.table(),
            json: serde_json::to_value(&found)?,
            ..Product::default()
        };
        if !args.paths {
            return args.out.finish_with(&product, others, &found.text(), console);
        }
        // As bytes: a folder's name need not be UTF-8, and whoever opens the files needs it as it is.
        let mut lines = Vec::new();
        for file in found.files() {
            lines.extend(index.root().join(file).into_os_string().into_encoded_bytes());
            lines.push(b'\n');
        }
        args.out.finish_raw(&product, others, &lines, console)
    }
}
