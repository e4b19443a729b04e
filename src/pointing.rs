//! `sunglint pointing`: how a mount shows directions, from frames all over the sky.

use crate::goto::{Eye, EyeOptions, LONGEST_S, Ready, stop};
use crate::mount::MountArgs;
use crate::output::{Console, OutputArgs, Usage};
use crate::station::StationArgs;
use anyhow::{Context as _, bail};
use clap::Args;
use glam::DVec3;
use hifitime::Epoch;
use std::ops::ControlFlow;
use std::path::PathBuf;
use sunglint_drivers::clock::{Cancel, DeviceClock};
use sunglint_drivers::device::MountAxes;
use sunglint_formats::text_table;
use sunglint_observatory::telescope::{
    Goto, GotoError, GotoTarget, PointingFit, PointingPlace, TrackError, fit_pointing, places_of,
};
use sunglint_radiometry::sky::{Catalogue, EarthOrientation, Observer, Star};
use sunglint_radiometry::station::Station;
use sunglint_report::pointing as report;

/// Lowest altitude, deg, where nothing is said.
const LOWEST_DEG: f64 = 20.0;
/// Most places.
const MOST_POINTS: usize = 200;
/// Places are no higher than this, deg: nearer to the zenith a mount of azimuth and altitude turns about without end.
const HIGHEST_DEG: f64 = 82.0;
/// Step from azimuth to azimuth of the spiral, deg: the golden angle.
const GOLDEN_DEG: f64 = 137.507_764;

/// Arguments of `sunglint pointing`.
#[derive(Debug, Args)]
pub struct PointingArgs {
    /// A table of places that was measured before (`-o` of this command), instead of a mount
    #[arg(value_name = "FILE", required_unless_present = "mount", conflicts_with_all = ["mount", "camera"])]
    pub table: Option<PathBuf>,
    /// The mount: `indi-telescope:HOST:PORT/NAME`, `alpaca:HOST:PORT/0` (see `sunglint devices list`)
    #[arg(long, value_name = "ADDRESS", requires = "camera")]
    pub mount: Option<String>,
    /// The camera whose frames tell where it looks: `indi-camera:HOST:PORT/NAME`, `alpaca-camera:HOST:PORT/0`
    #[arg(long, value_name = "ADDRESS", requires = "mount")]
    pub camera: Option<String>,
    /// Places over the sky, each at a bright star: 3 for the zero points and the tilt of the first axis, 14 for all terms
    #[arg(long, value_name = "N", default_value_t = 20)]
    pub points: usize,
    /// Exposure of a frame, s
    #[arg(long, value_name = "S", default_value_t = 2.0)]
    pub exposure_s: f64,
    /// Width of the frames on the sky, degrees, within 15 % [default: by the station's pixel scale]
    #[arg(long, value_name = "DEG")]
    pub width_deg: Option<f64>,
    /// A list of stars for fields narrower than 15° (CSV, ECSV, VOTable, FITS) [default: the embedded stars to V = 5]
    #[arg(long, value_name = "FILE")]
    pub catalogue: Option<PathBuf>,
    /// Ask astrometry.net's program in place of a list, as `solve --solve-field` does
    #[arg(long, value_name = "PROGRAM", num_args = 0..=1, require_equals = true, default_missing_value = "solve-field", conflicts_with = "catalogue")]
    pub solve_field: Option<PathBuf>,
    /// Which station.
    #[command(flatten)]
    pub station: StationArgs,
    /// Limits that keep the mount safe.
    #[command(flatten)]
    pub safe: MountArgs,
    /// Write the model to this file too: for `goto --pointing`, `track --pointing` and `pointing` of a plan's `[mount]`
    #[arg(long, value_name = "FILE")]
    pub model_out: Option<PathBuf>,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// Measures places, or reads them, and fits the model.
///
/// # Errors
/// A table that is none, too few places, a mount or a camera that fails.
pub fn run(args: &PointingArgs, console: Console) -> anyhow::Result<()> {
    args.out.check()?;
    let within = |name: &str, value: f64, least: f64, most: f64| match value {
        v if (least..=most).contains(&v) => Ok(()),
        v => Err(Usage(format!("--{name} is {v}, expected {least} to {most}"))),
    };
    within("points", args.points as f64, 3.0, MOST_POINTS as f64)?;
    within("exposure-s", args.exposure_s, 1e-4, LONGEST_S)?;
    within("min-elevation", args.safe.lowest_deg(LOWEST_DEG), 5.0, 70.0)?;
    args.safe.check(LOWEST_DEG)?;
    let station = args.station.get()?;
    let (axes, places) = match &args.table {
        Some(path) => {
            let text = sunglint_formats::read::text(path)?;
            let table = match text.starts_with("# %ECSV") {
                true => sunglint_formats::ecsv::read_str(path, &text)?,
                false => text_table::read_str(path, &text)?,
            };
            places_of(&table).with_context(|| format!("{}", path.display()))?
        }
        None => measured(args, &station, console)?,
    };
    let fit = fit_pointing(axes, station.site.geodetic().latitude_deg, &places)?;
    finish(args, &fit, console)
}

fn finish(args: &PointingArgs, fit: &PointingFit, console: Console) -> anyhow::Result<()> {
    let left_out = fit.used.iter().filter(|used| !**used).count();
    if left_out > 0 {
        console.warn(&format!("{left_out} of {} places are left out", fit.used.len()));
    }
    let model = args.model_out.iter();
    let others = model.map(|path| (path.clone(), fit.model.toml().into_bytes())).collect();
    args.out.finish_with(&report::product(fit), others, &report::text(fit), console)
}

/// Goes to stars all over the sky and takes a frame of each.
fn measured(
    args: &PointingArgs,
    station: &Station,
    console: Console,
) -> anyhow::Result<(MountAxes, Vec<PointingPlace>)> {
    let (Some(address), Some(camera)) = (&args.mount, &args.camera) else {
        bail!("no mount and no camera");
    };
    let options = EyeOptions {
        exposure_s: args.exposure_s,
        width_deg: args.width_deg,
        catalogue: args.catalogue.as_deref(),
        solve_field: args.solve_field.as_deref(),
    };
    let mut eye = Eye::open(camera, &options, station)?;
    let Ready { mut mount, guard, cancel, mut dog, mut options } =
        Ready::of(address, &args.safe, LOWEST_DEG, station, console)?;
    // Wherever it looks is a place.
    options.tolerance_arcsec = f64::INFINITY;
    let axes = mount.abilities().axes;
    let stars = spread(station, args.points, args.safe.lowest_deg(LOWEST_DEG), axes)?;
    let mut places = Vec::new();
    let mut ended = None;
    for (k, star) in stars.iter().enumerate() {
        if cancel.is_cancelled() {
            break;
        }
        console.say(&format!("place {} of {}: {}", k + 1, stars.len(), star.label()));
        let pulse = dog.pulse();
        let beat = || pulse.tick();
        let mut watched = true;
        let mut look = |cancel: &Cancel| eye.look(cancel, &beat, console);
        let gone = Goto {
            site: &station.site,
            guard: &guard,
            model: None,
            mount: mount.as_mut(),
            clock: DeviceClock::live(),
            options,
            beat: &beat,
        }
        .to(
            &GotoTarget::Star(Box::new(star.clone())),
            Some(&mut look),
            &cancel,
            &mut |_| {
                watched = dog.beat().is_continue();
                if watched { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
            },
        );
        match gone {
            Ok(gone) => places.extend(gone.place),
            // Clouds, the Sun, a limit: another place will do.
            Err(error @ (GotoError::Blind(_) | GotoError::Track(TrackError::Danger(_)))) => {
                console.warn(&format!("{} is left out: {error}", star.label()));
            }
            Err(error) => {
                ended = Some((error, watched));
                break;
            }
        }
        // It was unparked for the first place.
        options.track.unpark = false;
    }
    match ended {
        // A stop would end what somebody else does with it.
        Some((GotoError::Track(error @ TrackError::ByHand { .. }), _)) => {
            dog.done();
            if places.is_empty() {
                return Err(error.into());
            }
            console.warn(&format!("{error}: the model is of the places before"));
        }
        Some((error, watched)) => {
            stop(mount.as_mut(), dog)?;
            if !watched {
                bail!("the watchdog has gone: the mount was stopped");
            }
            if !cancel.is_cancelled() || places.is_empty() {
                return Err(error.into());
            }
            console.warn("stopped: the model is of the places before");
        }
        None => stop(mount.as_mut(), dog)?,
    }
    Ok((axes, places))
}

/// Bright stars near to places that are spread over the sky, in an order that takes the mount once around.
fn spread(
    station: &Station,
    count: usize,
    lowest_deg: f64,
    axes: MountAxes,
) -> anyhow::Result<Vec<Star>> {
    let now = Epoch::now().context("the system has no clock")?;
    let observer = Observer::at(now, &station.site, EarthOrientation::embedded())?;
    let up: Vec<(&Star, DVec3)> = Catalogue::embedded()
        .stars()
        .iter()
        .map(|star| (star, observer.star(star).horizontal.east_north_up()))
        .filter(|(_, at)| {
            let altitude_deg = at.z.clamp(-1.0, 1.0).asin().to_degrees();
            (lowest_deg + 1.0..HIGHEST_DEG).contains(&altitude_deg)
        })
        .collect();
    let [low, high] = [lowest_deg, HIGHEST_DEG].map(|deg| deg.to_radians().sin());
    let mut chosen: Vec<(f64, &Star)> = Vec::new();
    for k in 0..count {
        // As much sky for each.
        let z = low + (high - low) * (k as f64 + 0.5) / count as f64;
        let azimuth = (GOLDEN_DEG * k as f64).to_radians();
        let flat = (1.0 - z * z).sqrt();
        let wanted = DVec3::new(flat * azimuth.sin(), flat * azimuth.cos(), z);
        let free = up.iter().filter(|(star, _)| chosen.iter().all(|(_, own)| own.hip != star.hip));
        let nearest =
            free.min_by(|a, b| a.1.angle_between(wanted).total_cmp(&b.1.angle_between(wanted)));
        let Some((star, at)) = nearest else { break };
        let azimuth_deg = at.x.atan2(at.y).to_degrees().rem_euclid(360.0);
        chosen.push((azimuth_deg, star));
    }
    if axes == MountAxes::Equatorial {
        // A German mount turns over twice: from east to south to west, and over the pole back.
        chosen.iter_mut().for_each(|(deg, _)| *deg = (*deg - 1.0).rem_euclid(360.0));
    }
    chosen.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok(chosen.into_iter().map(|(_, star)| star.clone()).collect())
}
