//! `sunglint goto`: the telescope at a place on the sky, corrected by where its frames look.

use crate::interrupt::{Hangup, listen};
use crate::mount::{MountArgs, OPEN};
use crate::output::{Console, OutputArgs, Usage};
use crate::station::StationArgs;
use anyhow::{Context as _, anyhow, bail};
use clap::Args;
use glam::DVec2;
use hifitime::Epoch;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::time::Duration;
use sunglint_calibration::field_stars::solve_field::SolveField;
use sunglint_calibration::field_stars::solver::{Hint, Solver};
use sunglint_calibration::photometry::field::{FieldOptions, find};
use sunglint_drivers::catalogue::{Address, AnyDevice};
use sunglint_drivers::clock::{Cancel, Deadline, DeviceClock};
use sunglint_drivers::device::{Camera, Mount, MountMotion};
use sunglint_formats::Frame;
use sunglint_formats::text::counted;
use sunglint_numerics::progress::Progress;
use sunglint_observatory::clock;
use sunglint_observatory::telescope::watchdog::Process;
use sunglint_observatory::telescope::{
    Certainty, Gone, Goto, GotoError, GotoOptions, GotoTarget, Guard, Light, Lights, Looks,
    PointingModel, SearchOptions, TargetPath, TrackError, TrackStep, direction,
};
use sunglint_radiometry::sky::{Catalogue, EarthOrientation, Equatorial, Star};
use sunglint_radiometry::station::Station;
use sunglint_report::goto::GotoReport;
use sunglint_report::track::step_text;

/// Time between two signs of life to the watchdog.
const BEAT: Duration = Duration::from_millis(100);
/// Corrections after a search at most.
const SEARCH_ROUNDS: usize = 8;
/// Lowest altitude, deg, where nothing is said.
const LOWEST_DEG: f64 = 10.0;
/// Longest exposure, s.
pub(crate) const LONGEST_S: f64 = 120.0;

/// Arguments of `sunglint goto`.
#[derive(Debug, Args)]
pub struct GotoArgs {
    /// A star's name (`Vega`, `HIP 91262`)
    #[arg(value_name = "STAR", required_unless_present_any = ["radec", "altaz"], conflicts_with_all = ["radec", "altaz"])]
    pub star: Option<String>,
    /// Right ascension and declination instead, degrees, ICRS
    #[arg(long, value_names = ["RA", "DEC"], num_args = 2, allow_negative_numbers = true, conflicts_with = "altaz")]
    pub radec: Option<Vec<f64>>,
    /// Altitude and azimuth (from north by east) instead, degrees
    #[arg(long, value_names = ["ALT", "AZ"], num_args = 2, allow_negative_numbers = true)]
    pub altaz: Option<Vec<f64>>,
    /// The mount: `indi-telescope:HOST:PORT/NAME`, `alpaca:HOST:PORT/0` (see `sunglint devices list`)
    #[arg(long, value_name = "ADDRESS")]
    pub mount: String,
    /// Take frames, find where they look by their stars, and go on until the target is in their middle
    #[arg(long, requires = "camera")]
    pub solve: bool,
    /// Look for the star in fields about where it should be, at most so far from there, degrees, and bring it into the middle: for a camera whose field is too narrow to be found by its stars
    #[arg(long, value_name = "DEG", requires = "camera", conflicts_with_all = ["solve", "altaz"])]
    pub search: Option<f64>,
    /// Light from which on the star is found, ADU, as `detect` measures it [default: all fields are looked at, and the brightest light of all is the star]
    #[arg(long, value_name = "ADU", requires = "search")]
    pub least_flux: Option<f64>,
    /// Turn of the camera, degrees, where it is known within 2° (`camera_angle_deg` of `goto --solve`): half as many fields do then
    #[arg(long, value_name = "DEG", requires = "search", allow_negative_numbers = true)]
    pub camera_angle: Option<f64>,
    /// The camera of `--solve` and `--search`: `indi-camera:HOST:PORT/NAME`, `alpaca-camera:HOST:PORT/0`
    #[arg(long, value_name = "ADDRESS")]
    pub camera: Option<String>,
    /// Exposure of its frames, s
    #[arg(long, value_name = "S", default_value_t = 2.0, requires = "camera")]
    pub exposure_s: f64,
    /// Width of the frames on the sky, degrees, within 15 % [default: by the station's pixel scale]
    #[arg(long, value_name = "DEG", requires = "camera")]
    pub width_deg: Option<f64>,
    /// A list of stars for fields narrower than 15° (CSV, ECSV, VOTable, FITS) [default: the embedded stars to V = 5]
    #[arg(long, value_name = "FILE", requires = "solve")]
    pub catalogue: Option<PathBuf>,
    /// Ask astrometry.net's program in place of a list, as `solve --solve-field` does
    #[arg(long, value_name = "PROGRAM", num_args = 0..=1, require_equals = true, default_missing_value = "solve-field", requires = "solve", conflicts_with = "catalogue")]
    pub solve_field: Option<PathBuf>,
    /// Distance from the frame's middle at which it is good, arcsec
    #[arg(long, value_name = "ARCSEC", default_value_t = 30.0, requires = "camera")]
    pub within: f64,
    /// Tell the mount where it is in the end
    #[arg(long, requires = "camera")]
    pub sync: bool,
    /// How the mount shows directions: a file of `sunglint pointing`
    #[arg(long, value_name = "FILE")]
    pub pointing: Option<PathBuf>,
    /// End once it is there, and leave the mount as it is. Nothing then keeps a mount that follows the stars off the Sun
    #[arg(long)]
    pub leave: bool,
    /// Which station.
    #[command(flatten)]
    pub station: StationArgs,
    /// Limits that keep the mount safe.
    #[command(flatten)]
    pub safe: MountArgs,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

impl GotoArgs {
    fn check(&self) -> anyhow::Result<()> {
        self.out.check()?;
        let within = |name: &str, value: f64, least: f64, most: f64| match value {
            v if (least..=most).contains(&v) => Ok(()),
            v => Err(Usage(format!("--{name} is {v}, expected {least} to {most}"))),
        };
        within("exposure-s", self.exposure_s, 1e-4, LONGEST_S)?;
        within("within", self.within, 1.0, 36_000.0)?;
        within("search", self.search.unwrap_or(0.5), 0.001, 5.0)?;
        within("least-flux", self.least_flux.unwrap_or(1.0), 1e-3, 1e12)?;
        within("camera-angle", self.camera_angle.unwrap_or(0.0), -360.0, 360.0)?;
        within("width-deg", self.width_deg.unwrap_or(1.0), 1e-3, 180.0)?;
        if self.sync && self.search.is_some() && self.least_flux.is_none() {
            let text = "--sync after a search needs --least-flux: else the mount is told that it points at the star, whichever light was the brightest";
            return Err(Usage(text.into()).into());
        }
        if self.camera.is_some() && !self.solve && self.search.is_none() {
            let text = "--camera: its frames are taken with --solve or --search DEG";
            return Err(Usage(text.into()).into());
        }
        self.safe.check(LOWEST_DEG)?;
        Ok(())
    }

    fn eye(&self) -> EyeOptions<'_> {
        EyeOptions {
            exposure_s: self.exposure_s,
            width_deg: self.width_deg,
            catalogue: self.catalogue.as_deref(),
            solve_field: self.solve_field.as_deref(),
        }
    }

    fn target(&self) -> anyhow::Result<(GotoTarget, String)> {
        if let Some([ra_deg, dec_deg]) = self.radec.as_deref() {
            let (ra_deg, dec_deg) = (*ra_deg, *dec_deg);
            let name = format!("RA {ra_deg}°, Dec {dec_deg}°");
            let star = Star::at(&name, Equatorial { ra_deg, dec_deg })
                .map_err(|error| Usage(format!("--radec: {error}")))?;
            return Ok((GotoTarget::Star(Box::new(star)), name));
        }
        if let Some([altitude, azimuth]) = self.altaz.as_deref() {
            let is_place = (0.0..=90.0).contains(altitude) && (-360.0..=360.0).contains(azimuth);
            if !is_place {
                let text = format!(
                    "--altaz is {altitude} {azimuth}, expected an altitude of 0 to 90 and an azimuth of -360 to 360 degrees"
                );
                return Err(Usage(text).into());
            }
            let name = format!("altitude {altitude}°, azimuth {azimuth}°");
            return Ok((GotoTarget::Horizontal([*azimuth, *altitude].into()), name));
        }
        let star = self.star.as_deref().context("no target")?;
        let star = Catalogue::embedded().find(star)?;
        Ok((GotoTarget::Star(Box::new(star.clone())), star.label()))
    }
}

/// A mount that may be moved, with what watches over it.
pub(crate) struct Ready {
    pub mount: Box<dyn Mount>,
    pub guard: Guard,
    pub cancel: Cancel,
    pub dog: Process,
    pub options: GotoOptions,
}

impl Ready {
    /// Opens a mount, checks what is known of it, the site and the clock; starts the watchdog and listens for Ctrl-C. `lowest_deg` is the command's lowest altitude where none is given.
    pub fn of(
        address: &str,
        safe: &MountArgs,
        lowest_deg: f64,
        station: &Station,
        console: Console,
    ) -> anyhow::Result<Self> {
        let mut mount = safe.open(address)?;
        let guard = safe.guard(lowest_deg, station, mount.abilities());
        safe.tell_site(mount.as_mut(), station)?;
        let soon = Deadline::within(Duration::from_secs(5));
        if let Some(doubt) = guard.doubt(mount.as_mut(), &soon)? {
            return Err(doubt.into());
        }
        if !safe.trust_clock {
            let state = clock::measured();
            Certainty { synchronised: state.synchronised, error_s: state.error_s }.check()?;
        }
        let cancel = Cancel::new();
        let token = cancel.clone();
        listen(Hangup::Ends, move || token.cancel())?;
        let program = std::env::current_exe().context("cannot find this program")?;
        let dog = Process::start(&program, address)?;
        let mut options = GotoOptions::default();
        options.refraction = safe.refracts(mount.as_ref(), console);
        options.track.german = !safe.fork;
        Ok(Self { mount, guard, cancel, dog, options })
    }
}

/// Goes there.
///
/// # Errors
/// A way that is not safe, a mount that does not do what it is told, frames that tell no place.
pub fn run(args: &GotoArgs, console: Console) -> anyhow::Result<()> {
    args.check()?;
    let station = args.station.get()?;
    let (target, name) = args.target()?;
    let model = args.pointing.as_deref().map(PointingModel::read).transpose()?;
    let mut eye = match &args.camera {
        Some(address) if args.solve => Some(Eye::open(address, &args.eye(), &station)?),
        _ => None,
    };
    let mut sight = match (&args.camera, args.search) {
        (Some(address), Some(radius_deg)) => {
            Some((Sight::open(address, args.exposure_s, &station)?, radius_deg))
        }
        _ => None,
    };
    if sight
        .as_ref()
        .is_some_and(|(sight, _)| sight.scale_arcsec.is_none() && args.width_deg.is_none())
    {
        let text = "--search: how much the camera sees is not known: --width-deg, or pixel_scale_arcsec of the station's [camera]";
        return Err(Usage(text.into()).into());
    }
    let Ready { mut mount, guard, cancel, mut dog, mut options } =
        Ready::of(&args.mount, &args.safe, LOWEST_DEG, &station, console)?;
    options.tolerance_arcsec = args.within;
    options.sync = args.sync;
    if args.search.is_some() {
        // Its first corrections know the camera's axes by two short moves only.
        options.rounds = options.rounds.max(SEARCH_ROUNDS);
    }
    let clock = DeviceClock::live();
    let pulse = dog.pulse();
    let beat = || pulse.tick();
    let mut going = Goto {
        site: &station.site,
        guard: &guard,
        model: model.as_ref(),
        mount: mount.as_mut(),
        clock,
        options,
        beat: &beat,
    };
    let mut look = eye.as_mut().map(|eye| |cancel: &Cancel| eye.look(cancel, &beat, console));
    let look = look.as_mut().map(|look| look as &mut sunglint_observatory::telescope::Look<'_>);
    let mut shown = 0_u32;
    let mut watched = true;
    let mut each = |step: &TrackStep| {
        watched = dog.beat().is_continue();
        if shown.is_multiple_of(10) {
            console.say(&step_text(step));
        }
        shown += 1;
        if watched { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    };
    let went = match &mut sight {
        Some((sight, radius_deg)) => {
            // Places and scale in arcsec: the frames' own pixels are known once there is one.
            let mut search = SearchOptions::new(1.0);
            search.radius_deg = *radius_deg;
            search.least_flux = args.least_flux;
            search.camera_angle_deg = args.camera_angle;
            let mut glance = |cancel: &Cancel| sight.glance(args.width_deg, cancel, &beat, console);
            let went = going.search(&target, &mut glance, &search, &cancel, &mut each);
            // Turn and scale by two short moves are too rough for a plan.
            went.map(|gone| Gone { camera: None, ..gone })
        }
        None => going.to(&target, look, &cancel, &mut each),
    };
    let went = went.map_err(|error| match error {
        GotoError::Track(error) => GotoError::Track(dog.explain(error)),
        error => error,
    });
    let gone = match went {
        Ok(gone) => gone,
        // A stop would end what somebody else does with it.
        Err(error @ GotoError::Track(TrackError::ByHand { .. })) => {
            dog.done();
            return Err(error.into());
        }
        Err(error) => {
            // What follows the stars goes on doing so: it is stopped.
            let silent = dog.was_silent();
            stop(mount.as_mut(), dog)?;
            if silent {
                return Err(TrackError::Silent.into());
            }
            if !watched {
                bail!("the watchdog has gone: the mount was stopped");
            }
            return Err(error.into());
        }
    };
    let report = GotoReport { target: name, mount: args.mount.clone(), gone, synced: args.sync };
    if let Some(warning) = report.warning() {
        console.warn(&warning);
    }
    args.out.finish(&report.product()?, &report.text(), console)?;
    if args.leave {
        dog.done();
        return Ok(());
    }
    console.say("there; Ctrl-C stops the mount");
    match hold(mount.as_mut(), &guard, &station, &cancel, &mut dog) {
        Ok(Held::ByHand) => {
            dog.done();
            console.warn("somebody else moves the mount: it is left to them");
            Ok(())
        }
        held => {
            stop(mount.as_mut(), dog)?;
            held.map(|_| ())
        }
    }
}

/// Why a mount is held no more.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Held {
    /// The person ended it.
    Ended,
    /// Somebody else parks or moves it.
    ByHand,
}

/// Stops the mount, and where that fails leaves it to the watchdog.
pub(crate) fn stop(mount: &mut dyn Mount, dog: Process) -> anyhow::Result<()> {
    match mount.stop(&Deadline::within(Duration::from_secs(5))) {
        Ok(()) => dog.done(),
        Err(error) => {
            drop(dog);
            return Err(anyhow!("the mount could not be stopped over this connection: {error}"));
        }
    }
    Ok(())
}

/// Watches over a mount that follows the stars, until somebody ends it.
fn hold(
    mount: &mut dyn Mount,
    guard: &Guard,
    station: &Station,
    cancel: &Cancel,
    dog: &mut Process,
) -> anyhow::Result<Held> {
    let earth = EarthOrientation::embedded();
    while !cancel.is_cancelled() {
        let reading = mount.reading(&Deadline::within(Duration::from_secs(2)))?;
        if !matches!(reading.motion, MountMotion::Tracking | MountMotion::Still) {
            return Ok(Held::ByHand);
        }
        let axes = mount.abilities().axes;
        let span = (reading.utc, 10.0);
        let path = TargetPath::fixed([180.0, 45.0].into(), &station.site, earth, span, axes)?;
        let here = path.frame().to_enu(direction(path.angles_of(&reading)));
        guard.check_place(here, reading.utc)?;
        for _ in 0..10 {
            if cancel.is_cancelled() {
                break;
            }
            if dog.beat().is_break() {
                if dog.was_silent() {
                    return Err(TrackError::Silent.into());
                }
                bail!("the watchdog has gone: the mount is stopped");
            }
            std::thread::sleep(BEAT);
        }
    }
    Ok(Held::Ended)
}

/// How frames are taken and found.
pub(crate) struct EyeOptions<'a> {
    pub exposure_s: f64,
    pub width_deg: Option<f64>,
    pub catalogue: Option<&'a std::path::Path>,
    pub solve_field: Option<&'a std::path::Path>,
}

/// Does something that may take long, with a sign of life now and then.
fn awaited<T: Send>(
    beat: &dyn Fn(),
    work: impl FnOnce() -> Result<T, String> + Send,
) -> Result<T, String> {
    std::thread::scope(|scope| {
        let working = scope.spawn(work);
        while !working.is_finished() {
            beat();
            std::thread::sleep(BEAT);
        }
        working.join().unwrap_or_else(|_| Err("the search has crashed".to_owned()))
    })
}

/// The middle of a frame's exposure.
fn middle_of(frame: &Frame) -> Epoch {
    frame.start + hifitime::Duration::from_seconds(0.5 * frame.exposure_s)
}

/// A camera that is open.
struct Sight {
    camera: Box<dyn Camera>,
    exposure_s: f64,
    /// Angle that a pixel of the sensor sees, where the station says it.
    scale_arcsec: Option<f64>,
}

impl Sight {
    fn open(address: &str, exposure_s: f64, station: &Station) -> anyhow::Result<Self> {
        let mut address =
            Address::parse(address, &[]).map_err(|error| anyhow!("--camera: {error}"))?;
        let deadline = Deadline::within(OPEN);
        let line = address.connect(&deadline)?;
        let camera = match address.open(line, &deadline)? {
            AnyDevice::Camera(camera) => camera,
            other => bail!("--camera: this is a {}, no camera", other.kind()),
        };
        let scale_arcsec = station.camera.as_ref().map(|camera| camera.pixel_scale_arcsec);
        Ok(Self { camera, exposure_s, scale_arcsec })
    }

    /// Takes a frame; what is known of its pixels.
    fn expose(&mut self, cancel: &Cancel) -> Result<(Frame, FieldOptions), String> {
        let most = Duration::from_secs_f64(self.exposure_s + 60.0);
        let deadline = Deadline::within(most).with_cancel(cancel);
        let frame =
            self.camera.expose(self.exposure_s, &deadline).map_err(|error| error.to_string())?;
        let mut options = FieldOptions::default();
        options.saturation_adu = frame.saturation_adu;
        options.gain_e_per_adu = frame.gain_e_per_adu;
        options.bayer = frame.bayer;
        Ok((frame, options))
    }

    /// Takes a frame and lists its lights, in arcsec from the middle by the station's scale or the frame's width.
    fn glance(
        &mut self,
        width_deg: Option<f64>,
        cancel: &Cancel,
        beat: &dyn Fn(),
        console: Console,
    ) -> Result<Lights, String> {
        let found = awaited(beat, || {
            let (frame, options) = self.expose(cancel)?;
            let pixels = frame.pixels.mapv(f32::from);
            let field = find(pixels.view(), &options).map_err(|error| error.to_string())?;
            Ok((middle_of(&frame), field, f64::from(frame.binning[0])))
        });
        let (middle, field, binning) = found?;
        let [columns, rows] = field.size_px.map(|n| n as f64);
        let scale = match (width_deg, self.scale_arcsec) {
            (Some(width), _) => 3600.0 * width / columns,
            (None, Some(scale)) => scale * binning,
            (None, None) => return Err("how much the camera sees is not known".into()),
        };
        let from_middle = |place: DVec2| {
            scale * DVec2::new(place.x - 0.5 * (columns - 1.0), 0.5 * (rows - 1.0) - place.y)
        };
        let lights: Vec<Light> = field
            .points
            .iter()
            .map(|p| Light { place_px: from_middle(p.place_px), flux: p.flux_adu })
            .filter(|light| light.flux > 0.0)
            .collect();
        console.say(&match field.points.first() {
            Some(first) => format!(
                "{}, the brightest of {:.0} ADU{}",
                counted(lights.len(), "light"),
                first.flux_adu,
                if first.is_saturated { ", saturated" } else { "" }
            ),
            None => "no light".to_owned(),
        });
        let size_px = scale * DVec2::new(columns, rows);
        Ok(Lights { middle, size_px, lights })
    }
}

/// Work that ends where a token is set.
struct Until<'a>(&'a Cancel);

impl Progress for Until<'_> {
    fn is_cancelled(&self) -> bool {
        self.0.is_cancelled()
    }
}

/// A camera whose frames say where they look.
pub(crate) struct Eye {
    sight: Sight,
    solver: Solver,
}

impl Eye {
    pub fn open(
        address: &str,
        options: &EyeOptions<'_>,
        station: &Station,
    ) -> anyhow::Result<Self> {
        let sight = Sight::open(address, options.exposure_s, station)?;
        let solver = match options.solve_field {
            Some(program) => Solver::by_program(SolveField::new(program), options.width_deg),
            None => Solver::new(options.catalogue, None, options.width_deg)?,
        };
        Ok(Self { sight, solver })
    }

    /// Takes a frame and finds it, with a sign of life now and then: finding a frame takes seconds.
    pub fn look(
        &mut self,
        cancel: &Cancel,
        beat: &dyn Fn(),
        console: Console,
    ) -> Result<Looks, String> {
        let found = awaited(beat, || self.looked(cancel));
        if let Ok(looks) = &found {
            let [ra, dec] = looks.sky_deg.to_array();
            console.say(&format!("the frame looks at RA {ra:.4}°, Dec {dec:+.4}°"));
        }
        found
    }

    fn looked(&mut self, cancel: &Cancel) -> Result<Looks, String> {
        let (frame, options) = self.sight.expose(cancel)?;
        let (middle, binning) = (middle_of(&frame), f64::from(frame.binning[0]));
        let pixels = frame.pixels.mapv(f32::from);
        let scale_arcsec = self.sight.scale_arcsec.map(|scale| scale * binning);
        let hint = Hint { middle, scale_arcsec };
        let looked = self.solver.solve_watched(pixels.view(), &hint, &options, &Until(cancel));
        let looked = looked.map_err(|error| error.to_string())?;
        let Some(solved) = looked.solved else {
            return Err(format!(
                "its {} sources are no pattern of the list: a longer exposure, a deeper list (--catalogue), another program (--solve-field) or the right width (--width-deg) may help",
                looked.sources
            ));
        };
        Ok(Looks {
            middle,
            sky_deg: solved.centre_deg,
            up_deg: solved.up_deg,
            is_mirrored: solved.is_mirrored,
            scale_arcsec: solved.scale_arcsec / binning,
        })
    }
}
