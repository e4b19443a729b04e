//! `sunglint calibrate`: the coefficient of every channel and night from visits to stars.

mod figure;
mod report;
mod visits;

pub(crate) use figure::colours;
pub(crate) use visits::night_of;
pub use visits::{StarVisit, visits_of};

use crate::air::{AirModelArgs, implausible};
use crate::output::{Console, OutputArgs};
use crate::station::StationArgs;
use anyhow::bail;
use clap::Args;
use report::{NightResult, Report};
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::path::PathBuf;
use sunglint_calibration::stars::scintillation::{Aperture, USUAL_COEFFICIENT};
use sunglint_calibration::stars::{Aerosol as FittedAerosol, Night, NightFile, Nights, Options};
use sunglint_calibration::stars::{StarsError, Visit, calibrate};
use sunglint_formats::time::format_utc_shortest;
use sunglint_radiometry::air::{Aerosol, Air, AirOptions};
use sunglint_radiometry::light_curve::{Input, Provenance};
use sunglint_radiometry::passband::ZeroPoint;
use sunglint_radiometry::sky::EarthOrientation;
use sunglint_radiometry::station::Station;
use visits::Prepared;

/// Arguments of `sunglint calibrate`.
#[derive(Debug, Args)]
pub struct CalibrateArgs {
    /// Linear light curves of stars (ECSV), or folders of them
    #[arg(required = true, value_name = "INPUT")]
    pub inputs: Vec<PathBuf>,
    /// Relative scatter of catalogued magnitudes and types at least
    #[arg(long, value_name = "FRACTION", default_value_t = 0.02, allow_negative_numbers = true)]
    pub floor: f64,
    /// Standard deviations beyond which a visit is an outlier
    #[arg(long, value_name = "K", default_value_t = 4.0, allow_negative_numbers = true)]
    pub clip_sigma: f64,
    /// Coverage of the intervals
    #[arg(long, value_name = "P", default_value_t = 0.95, allow_negative_numbers = true)]
    pub confidence: f64,
    /// Fit an aerosol's optical depth with kappa, where the range of airmass allows it
    #[arg(long)]
    pub fit_aerosol: bool,
    /// Young's coefficient of the scintillation
    #[arg(long, value_name = "C", default_value_t = USUAL_COEFFICIENT, allow_negative_numbers = true)]
    pub scintillation: f64,
    /// Magnitude of Vega that V counts from, or `ab`
    #[arg(long, value_name = "ZERO", default_value = "vega=0.03")]
    pub zero_point: ZeroPoint,
    /// Which station.
    #[command(flatten)]
    pub station: StationArgs,
    /// What is known of the air.
    #[command(flatten)]
    pub model: AirModelArgs,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// Calibrates; `seed` is the bootstrap's.
pub fn run(args: &CalibrateArgs, seed: u64, console: Console) -> anyhow::Result<()> {
    args.out.check_with(console)?;
    args.out.check()?;
    args.out.check_names(&["calibration.ecsv"])?;
    if !(0.0..=10.0).contains(&args.scintillation) {
        bail!("--scintillation is {}, expected 0 to 10", args.scintillation);
    }
    let station = args.station.get()?;
    let air = args.model.air(station.site.geodetic().height_m, Some(&station))?;
    let mut warnings = [station.warnings.clone(), implausible(&air)].concat();
    let mut read = Vec::new();
    for path in &args.inputs {
        let (visits, left_out) = visits_of(path)?;
        read.extend(visits);
        warnings.extend(left_out);
    }
    once_each(&mut read, &mut warnings);
    if read.is_empty() {
        bail!(
            "no visit to a star in {}: wanted are linear light curves whose `target` is a star",
            shown(&args.inputs)
        );
    }
    let aperture = Aperture {
        diameter_m: station.telescope.primary_diameter_m,
        height_m: station.site.geodetic().height_m,
        coefficient: args.scintillation,
    };
    let mut visits = Vec::new();
    for visit in &read {
        match Prepared::new(visit, &station, &air, &aperture, args.zero_point) {
            Ok(visit) => visits.push(visit),
            Err(error) => warnings.push(format!("{} is left out: {error:#}", visit.file)),
        }
    }
    visits.sort_by(|a, b| a.night.cmp(&b.night).then(a.middle.total_cmp_utc(&b.middle)));
    let work = Work { args, seed, station: &station, air: &air };
    let mut nights = Vec::new();
    let mut failures = Vec::new();
    for group in visits.chunk_by(|a, b| a.night == b.night) {
        match work.night(group) {
            Ok(night) => nights.push(night),
            Err(error) => failures.push(format!("the night of {}: {error:#}", group[0].night)),
        }
    }
    if nights.is_empty() {
        for warning in &warnings {
            console.warn(warning);
        }
        bail!(
            "{}",
            if failures.is_empty() { "no visit is left".to_owned() } else { failures.join("\n") }
        );
    }
    warnings.extend(failures);
    warnings.extend(nights.iter().flat_map(NightResult::warnings));
    for warning in &warnings {
        console.warn(warning);
    }
    let report = Report { file: work.file(&nights, &read), nights, station: &station, warnings };
    args.out.finish(&report.product(), &report.text(), console)
}

/// Drops files that came twice, by themselves and in their folder perhaps: a visit counts once. Visits of a session share its check sum, and are told apart
/// by their targets.
fn once_each(read: &mut Vec<StarVisit>, warnings: &mut Vec<String>) {
    let mut seen: HashMap<(String, String), String> = HashMap::new();
    let key = |visit: &StarVisit| (visit.sha256.clone(), visit.target.to_string());
    read.retain(|visit| match seen.entry(key(visit)) {
        Entry::Occupied(first) => {
            warnings.push(format!("{} is left out: the same as {}", visit.file, first.get()));
            false
        }
        Entry::Vacant(place) => {
            place.insert(visit.file.clone());
            true
        }
    });
}

fn shown(paths: &[PathBuf]) -> String {
    paths.iter().map(|p| p.display().to_string()).collect::<Vec<_>>().join(", ")
}

/// A night's result, what went in, and the aerosol's depth with its uncertainty where it was fitted.
type Fit = (Night, Vec<Visit>, Option<(f64, f64)>);

/// What is the same for all nights.
struct Work<'a> {
    args: &'a CalibrateArgs,
    seed: u64,
    station: &'a Station,
    air: &'a Air,
}

/// Ångström's exponent where nothing is said.
pub(crate) const USUAL_EXPONENT: f64 = 1.3;
/// A step of the aerosol's depth by which its effect is found.
const DEPTH_STEP: f64 = 0.02;
/// Rounds of the aerosol's fit: the effect of a depth on a wide channel bends a little.
const AEROSOL_ROUNDS: usize = 6;

impl Work<'_> {
    fn options(&self) -> Options {
        Options {
            floor: self.args.floor,
            clip_sigma: self.args.clip_sigma,
            confidence: self.args.confidence,
            fit_aerosol: self.args.fit_aerosol,
            seed: self.seed,
            ..Options::default()
        }
    }

    fn night(&self, visits: &[Prepared]) -> anyhow::Result<NightResult> {
        let (found, input, depth) = if self.args.fit_aerosol {
            self.with_aerosol(visits)?
        } else {
            let input = visits
                .iter()
                .map(|v| v.visit(self.station, self.air, None))
                .collect::<anyhow::Result<Vec<_>>>()?;
            (calibrate(&input, &self.options())?, input, None)
        };
        let names: Vec<String> = self.station.channels.iter().map(|c| c.name.clone()).collect();
        let mut file = NightFile::new(&visits[0].night, &names, &found);
        if let Some((depth, sigma)) = depth {
            file.facts.aerosol_depth = Some([depth, sigma]);
            file.facts.aerosol_exponent = Some(self.exponent());
        }
        Ok(NightResult { file, found, input, visits: visits.to_vec() })
    }

    /// Predicts with a depth, fits what is missing of it, and predicts again until nothing is.
    fn with_aerosol(&self, visits: &[Prepared]) -> anyhow::Result<Fit> {
        let mut depth = self.air.columns().aerosol_550;
        let mut last = None;
        for _ in 0..AEROSOL_ROUNDS {
            let air = self.air_with(depth)?;
            let thicker = self.air_with(depth + DEPTH_STEP)?;
            let input = visits
                .iter()
                .map(|v| v.visit(self.station, &air, Some((&thicker, DEPTH_STEP))))
                .collect::<anyhow::Result<Vec<_>>>()?;
            let found = calibrate(&input, &self.options())?;
            let Some(FittedAerosol { depth: more, sigma }) = found.aerosol else { break };
            if depth + more < 0.0 {
                let why =
                    format!("it would be {:.3} ± {sigma:.3}, below none at all", depth + more);
                return Err(StarsError::Aerosol { why }.into());
            }
            depth += more;
            last = Some((found, input, Some((depth, sigma))));
            if more.abs() < 0.01 * sigma {
                break;
            }
        }
        last.ok_or_else(|| anyhow::anyhow!("the aerosol's depth was not fitted"))
    }

    /// The exponent of Ångström's law that a fitted aerosol has.
    fn exponent(&self) -> f64 {
        match self.air.options().aerosol {
            Aerosol::Angstrom { exponent, .. } => exponent,
            _ => USUAL_EXPONENT,
        }
    }

    /// The air with an aerosol of that depth at 550 nm.
    fn air_with(&self, depth: f64) -> anyhow::Result<Air> {
        let options = self.air.options();
        let aerosol = match options.aerosol {
            Aerosol::Angstrom { wavelength_nm, exponent, scale_height_m, .. } => {
                Aerosol::Angstrom {
                    optical_depth: depth * (wavelength_nm / 550.0).powf(-exponent),
                    wavelength_nm,
                    exponent,
                    scale_height_m,
                }
            }
            Aerosol::Model(model) => bail!(
                "--fit-aerosol fits Ångström's law: give --aerosol none or TAU,ALPHA instead of the model {model}"
            ),
            _ => Aerosol::Angstrom {
                optical_depth: depth,
                wavelength_nm: 550.0,
                exponent: USUAL_EXPONENT,
                scale_height_m: 1800.0,
            },
        };
        Ok(Air::new(&AirOptions { aerosol, ..options.clone() })?)
    }

    fn file(&self, nights: &[NightResult], read: &[StarVisit]) -> Nights {
        let input = |v: &StarVisit| Input { file: v.file.clone(), sha256: v.sha256.clone() };
        let station_files = self.station.sources.iter().map(|(path, sha256)| Input {
            file: path.display().to_string(),
            sha256: sha256.clone(),
        });
        Nights {
            nights: nights.iter().map(|n| n.file.clone()).collect(),
            station: self.station.name.clone(),
            station_files: station_files.collect(),
            air: self.air.describe(),
            zero_point: self.args.zero_point.to_string(),
            confidence: self.args.confidence,
            provenance: Provenance {
                program: concat!("sunglint ", env!("CARGO_PKG_VERSION")).into(),
                command: "sunglint calibrate".into(),
                station: self.station.name.clone(),
                target: "stars".into(),
                inputs: read.iter().map(input).collect(),
                notes: vec![format!(
                    "floor {}, outliers beyond {} sigma, scintillation by Young's law with C = {}, seed {}",
                    self.args.floor, self.args.clip_sigma, self.args.scintillation, self.seed
                )],
                ..Provenance::default()
            },
        }
    }
}

/// Times in the order of time.
trait Ordered {
    fn total_cmp_utc(&self, other: &Self) -> std::cmp::Ordering;
}

impl Ordered for hifitime::Epoch {
    fn total_cmp_utc(&self, other: &Self) -> std::cmp::Ordering {
        self.partial_cmp(other).unwrap_or(std::cmp::Ordering::Equal)
    }
}

/// A visit in words.
fn label(visit: &Prepared) -> String {
    format!("{} at {}", visit.star, format_utc_shortest(visit.middle))
}

/// The orientation of the Earth that places of stars are computed with.
fn orientation() -> &'static EarthOrientation {
    EarthOrientation::embedded()
}
