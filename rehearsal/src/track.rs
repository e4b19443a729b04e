//! A rehearsal of following a satellite: the telescope is a virtual one, the target comes 1 s late and 20″ beside its track, and time passes as fast as it can.

use hifitime::{Epoch, Unit};
use std::ops::ControlFlow;
use std::sync::Arc;
use sunglint_drivers::clock::{Cancel, DeviceClock, VirtualClock};
use sunglint_drivers::device::{Finder, Mount as _, MountAxes, MountKnown};
use sunglint_ephemeris::geometry::Geometry;
use sunglint_ephemeris::orbit::{Orbit, OrbitError};
use sunglint_ephemeris::passes::{Conditions, Search, SearchError};
use sunglint_observatory::telescope::{
    Guard, PassPlan, PathError, SunCone, TargetPath, TrackError, TrackOptions, TrackStep,
    TrackSummary, Tracker,
};
use sunglint_radiometry::sky::{EarthOrientation, Observer, SkyError, SkyFrames};
use sunglint_radiometry::station::Station;
use sunglint_virtual::telescope::{Telescope, TelescopeOptions};

/// How much later than predicted the target of a rehearsal comes, s.
const LATE_S: f64 = 1.0;
/// How far beside its track it flies, radians.
const BESIDE_RAD: f64 = 20.0 / 206_264.8;
/// Begin of a rehearsal before the pass, s.
const BEFORE_S: f64 = 60.0;
/// Longest pass that is followed: a target that stays is followed until then, s.
const MOST_S: f64 = 14_400.0;

/// A virtual telescope's mount.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VirtualMount {
    /// Name.
    pub name: &'static str,
    /// Axes.
    pub axes: MountAxes,
    /// Hour angle past the meridian at which a German mount stands still, degrees.
    pub past_meridian_deg: Option<f64>,
}

/// The virtual mounts.
pub const MOUNTS: [VirtualMount; 3] = [
    VirtualMount { name: "virtual", axes: MountAxes::Horizontal, past_meridian_deg: None },
    VirtualMount {
        name: "virtual-equatorial",
        axes: MountAxes::Equatorial,
        past_meridian_deg: None,
    },
    VirtualMount {
        name: "virtual-german",
        axes: MountAxes::Equatorial,
        past_meridian_deg: Some(10.0),
    },
];

impl VirtualMount {
    /// The virtual mount of a name.
    pub fn named(name: &str) -> Option<Self> {
        MOUNTS.into_iter().find(|mount| mount.name == name)
    }
}

/// Limits of where a mount may look.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Lowest altitude at which the target is followed, degrees.
    pub min_altitude_deg: f64,
    /// Least distance from the Sun while it is up, degrees.
    pub sun_limit_deg: f64,
}

/// A pass that is to be rehearsed.
#[derive(Debug, Clone)]
pub struct Rehearsal {
    /// Limits of where the mount may look.
    pub limits: Limits,
    /// How late the target comes as a first guess, s.
    pub late_s: f64,
    /// Facts that are known of the mount.
    pub known: MountKnown,
    /// How it is followed.
    pub options: TrackOptions,
    /// Whether it is only planned.
    pub only_plan: bool,
}

/// A rehearsed pass.
#[derive(Debug)]
pub struct Rehearsed {
    /// The plan.
    pub plan: PassPlan,
    /// How it ended; `None` where the plan alone was asked for, or refuses.
    pub ended: Option<Result<TrackSummary, TrackError>>,
    /// Steps of the tracker.
    pub steps: Vec<TrackStep>,
    /// Distances of the target from the telescope's axis: seconds of the path, arcsec.
    pub truth: Vec<[f64; 2]>,
}

/// Why there is nothing to rehearse.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RehearsalError {
    /// Passes cannot be looked for.
    #[error(transparent)]
    Search(#[from] SearchError),
    /// The orbit gives no path.
    #[error(transparent)]
    Path(#[from] PathError),
    /// Times beyond the tables of the sky.
    #[error(transparent)]
    Sky(#[from] SkyError),
    /// The orbit ends before the first pass.
    #[error("there is nothing to follow: {0}")]
    Ended(OrbitError),
    /// No pass within a day.
    #[error(
        "{object} is not above {min_altitude_deg:.0}° at {station} within a day: look for its passes with `sunglint passes`"
    )]
    NoPass {
        /// The object.
        object: String,
        /// The station.
        station: String,
        /// The lowest altitude, degrees.
        min_altitude_deg: f64,
    },
}

/// Begin and length, s, of the pass that is on at a time or the first after it, within a day; cut to `most_s`.
///
/// # Errors
/// [`RehearsalError::NoPass`], [`RehearsalError::Ended`] of elements that have decayed by then, or times that cannot be searched.
pub fn next_pass(
    orbit: &Orbit,
    station: &Station,
    at: Epoch,
    min_altitude_deg: f64,
    most_s: Option<f64>,
) -> Result<(Epoch, f64), RehearsalError> {
    let conditions = Conditions { min_altitude_deg: min_altitude_deg + 0.2, sun_below_deg: 90.0 };
    let window = (at, at + 1.0 * Unit::Day);
    let earth = EarthOrientation::embedded();
    let search = Search::new(&station.site, &station.horizon, window, conditions, earth)?;
    let found = search.passes(orbit);
    let Some(pass) = found.passes.first() else {
        if let Some((_, why)) = found.ended {
            return Err(RehearsalError::Ended(why));
        }
        let (object, station) = (orbit.name(), station.name.clone());
        return Err(RehearsalError::NoPass { object, station, min_altitude_deg });
    };
    Ok((pass.span.from, pass.span.seconds().min(most_s.unwrap_or(MOST_S))))
}

/// Follows a target with a virtual telescope, or only plans.
///
/// # Errors
/// An orbit or times that give no path. What the telescope meets is [`Rehearsed::ended`].
pub fn rehearse(
    orbit: &Orbit,
    station: &Station,
    span: (Epoch, f64),
    made: VirtualMount,
    wanted: &Rehearsal,
    cancel: &Cancel,
) -> Result<Rehearsed, RehearsalError> {
    let earth = EarthOrientation::embedded();
    let seconds = span.1;
    let path =
        TargetPath::new(orbit, &station.site, earth, span, made.axes, false)?.later(wanted.late_s);
    let from = path.from();
    let start = from - BEFORE_S * Unit::Second;
    let clock = DeviceClock { clock: Arc::new(VirtualClock::new()), zero_utc: Some(start) };
    let frames =
        SkyFrames::over(start - 1.0 * Unit::Minute, from + (seconds + 60.0) * Unit::Second, earth)?;
    let (site, sky_orbit) = (station.site, orbit.clone());
    let sky = move |epoch: Epoch| {
        let at = |epoch: Epoch| {
            let observer = Observer::new(frames.at(epoch).ok()?, &site);
            Some(Geometry::at(&sky_orbit, &observer).ok()?.horizontal.east_north_up())
        };
        let late = epoch - LATE_S * Unit::Second;
        let (here, soon) = (at(late)?, at(late + 0.1 * Unit::Second)?);
        let across = here.cross(soon).try_normalize()?;
        (here + across * BESIDE_RAD).try_normalize()
    };
    let place = station.site.geodetic();
    let telescope = TelescopeOptions::default().with(|o| {
        o.axes = made.axes;
        o.past_meridian_deg = made.past_meridian_deg;
        o.site_deg = [place.latitude_deg, place.longitude_deg];
    });
    let telescope = Telescope::new(telescope, clock.clone(), Arc::new(sky));
    let (mut mount, mut finder) = (telescope.mount(), telescope.finder());
    mount.know(&wanted.known);
    let cone = SunCone::default().with_limit_deg(wanted.limits.sun_limit_deg);
    let guard = Guard::of(&station.site, mount.abilities(), cone)
        .with_horizon(station.horizon.clone(), wanted.limits.min_altitude_deg);
    let mut options = wanted.options;
    let plan = PassPlan::new(&orbit.name(), &path, &guard, mount.abilities(), None, &options);
    let mut rehearsed = Rehearsed { plan, ended: None, steps: Vec::new(), truth: Vec::new() };
    if wanted.only_plan || rehearsed.plan.refused.is_some() {
        return Ok(rehearsed);
    }
    options.watch_clock = false;
    let finder: Option<&mut dyn Finder> = Some(&mut finder);
    let mut tracker = Tracker::new(&path, &guard, &mut mount, finder, clock, options);
    let steps = &mut rehearsed.steps;
    let ended = tracker.run(cancel, &mut |step| {
        steps.push(*step);
        ControlFlow::Continue(())
    });
    rehearsed.ended = Some(ended);
    let off = |row: &sunglint_virtual::telescope::TruthRow| [row.time_s - BEFORE_S, row.off_arcsec];
    rehearsed.truth = telescope.truth().iter().map(off).collect();
    Ok(rehearsed)
}
