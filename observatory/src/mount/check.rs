//! Pre-flight of the mount: is it there, does it agree about the site, can each visit be pointed at, and is there time to get there.

use super::job::{EARLY_S, next_job};
use super::plan::MountPlan;
use crate::clock;
use crate::opener::Opener;
use crate::plan::{NightClock, Plan};
use crate::preflight::{Preflight, PreflightOptions};
use crate::telescope::{
    Certainty, Guard, PassPlan, SunCone, TargetPath, Weather, WeatherFile, angles, ripple_arcsec,
};
use hifitime::{Epoch, Unit};
use std::sync::Arc;
use std::sync::mpsc::channel;
use std::time::{Duration, SystemTime};
use sunglint_drivers::clock::Deadline;
use sunglint_drivers::device::{
    DeviceError, MountAbilities, MountAxes, MountRates, MountReading, MountSite, MountTime,
};
use sunglint_numerics::axes::Axes;

/// A mount that lifts places by itself.
pub(super) const REFRACTS: &str =
    "its own software lifts places by refraction (DoesRefraction): the night leaves that to it";

/// Rate that every mount has, deg/s: it follows the stars.
const STARS_DEG_S: f64 = 0.05;

/// Rate up to which it is said how far a mount of a few rates is beside its target, deg/s: low satellites are as fast.
const FAST_DEG_S: f64 = 1.0;

/// Answers of a mount that was asked.
struct Said {
    abilities: MountAbilities,
    site: Option<MountSite>,
    time: Option<MountTime>,
    reading: MountReading,
}

/// Opens the mount and asks it; it is let go afterwards. `None` where it does not answer in time.
fn ask(
    mount: &MountPlan,
    opener: &Arc<dyn Opener>,
    within: Duration,
) -> Option<Result<Said, DeviceError>> {
    let (sender, answer) = channel();
    let (plan, opener) = (mount.clone(), opener.clone());
    let ask = move || {
        let deadline = Deadline::within(within);
        let said = opener.mount(&plan, &deadline).and_then(|mut mount| {
            mount.know(&plan.known());
            let (site, time) = (mount.site(&deadline)?, mount.time(&deadline)?);
            let reading = mount.reading(&deadline)?;
            Ok(Said { abilities: mount.abilities().clone(), site, time, reading })
        });
        let _ = sender.send(said);
    };
    std::thread::Builder::new().name("mount".into()).spawn(ask).ok()?;
    answer.recv_timeout(within + Duration::from_millis(200)).ok()
}

/// Abilities of a mount that does not answer: those that the plan tells; what it leaves open is as of the strictest kind.
fn unheard(mount: &MountPlan) -> MountAbilities {
    let known = mount.known();
    let rates = match known.most_deg_s {
        Some(most) => MountRates::Continuous { most_deg_s: Axes::new(most, most) },
        None => MountRates::Absent,
    };
    let mut abilities = MountAbilities::new(known.axes.unwrap_or(MountAxes::Equatorial), rates);
    abilities.tells_pier_side = known.german == Some(true) || mount.camera_angle_pier.is_some();
    abilities.know(&known);
    abilities
}

/// Checks the mount of a plan. Nothing moves.
pub(crate) fn check_mount(
    plan: &Plan,
    opener: &Arc<dyn Opener>,
    options: &PreflightOptions,
    found: &mut Preflight,
) {
    let Some(mount) = &plan.mount else { return };
    let about = mount.name.as_str();
    let live = plan.clock == NightClock::Computer;
    let said = match options.open_devices && live {
        false => None,
        true => match ask(mount, opener, options.open_within) {
            None => {
                let text = format!("{} does not answer; the night tries it again", mount.device);
                found.warning(about, text);
                None
            }
            Some(Err(error @ DeviceError::WrongKind { .. })) => {
                found.error(about, format!("{}: {error}", mount.device));
                None
            }
            Some(Err(error)) => {
                let text = format!("{}: {error}; the night tries it again", mount.device);
                found.warning(about, text);
                None
            }
            Some(Ok(said)) => Some(said),
        },
    };
    let strict = unheard(mount);
    let abilities = said.as_ref().map_or(&strict, |said| &said.abilities);
    let cone = SunCone::default().with_limit_deg(mount.sun_limit_deg());
    let guard = Guard::of(&plan.station.site, abilities, cone)
        .with_horizon(plan.station.horizon.clone(), mount.min_elevation_deg());
    if let Some(said) = &said {
        match guard.check_site(said.site) {
            // Where it is told the station's site, the night holds what it says then against that.
            Err(danger) if mount.set_site => found.fine(
                about,
                format!("it is there; it is told the station's site (`set_site`), as it has another: {danger}"),
            ),
            Err(danger) => {
                found.error(about, format!("{danger} (`set_site = true` in the plan)"));
            }
            Ok(()) if said.site.is_none() => {
                found.warning(about, "it does not say at which site it believes to stand");
            }
            Ok(()) => found.fine(about, "it is there, and its site is the station's"),
        }
        if let Err(danger) = guard.check_time(said.time, said.site)
            && !mount.set_site
        {
            found.error(about, danger.to_string());
        }
        if said.abilities.refracts == Some(true) && mount.refraction {
            found.warning(about, REFRACTS);
        }
        if said.abilities.fastest_deg_s().is_none() {
            found.error(about, "it takes no rates: it follows nothing");
        }
        if let Some(ripple) =
            ripple_arcsec(&said.abilities, FAST_DEG_S, mount.track_options().period_s)
        {
            found.warning(
                about,
                format!("it takes a few rates only: up to {FAST_DEG_S}°/s it is beside its target by up to {ripple:.0}″ on each axis, for it goes to and fro between two rates"),
            );
        }
        if said.abilities.tells_pier_side
            && mount.camera.is_some()
            && mount.camera_angle_pier.is_none()
        {
            found.error(
                about,
                "it turns over at the meridian, and its camera is upside down after it: `camera_angle_pier` is missing in the plan, the side of the pier (east or west) on which `camera_angle_deg` holds; its frames would correct nothing",
            );
        }
        if said.abilities.may_turn_over() && !said.abilities.tells_pier_side {
            check_untold(about, mount, found);
        }
        if mount.park && !said.abilities.parks {
            found.warning(about, "it cannot be parked: at the end it stands where it is");
        }
    }
    if live {
        let state = clock::measured();
        let certainty = Certainty { synchronised: state.synchronised, error_s: state.error_s };
        if let Err(danger) = certainty.check()
            && !mount.trust_clock
        {
            found.error(about, format!("it will not move: {danger} (`trust_clock` in the plan)"));
        }
    }
    if let Some(path) = &mount.weather {
        match WeatherFile::new(path, mount.weather_age()).look(SystemTime::now()) {
            Weather::Unfit(why) => found.warning(about, format!("nothing would move now: {why}")),
            Weather::Fit => found.fine(about, "the weather is fit"),
        }
    }
    check_visits(plan, mount, &guard, abilities, said.as_ref(), options, found);
}

/// An equatorial mount that may turn over and does not say on which side it hangs.
fn check_untold(about: &str, mount: &MountPlan, found: &mut Preflight) {
    if mount.camera.is_some() && mount.camera_angle_pier.is_some() {
        found.error(
            about,
            "it does not say on which side of its pier it hangs, and `camera_angle_pier` holds for one of them: its frames would correct nothing; of a fork say `german = false`, and leave `camera_angle_pier` out",
        );
        return;
    }
    let camera = match mount.camera {
        Some(_) => {
            ", and the frames of its camera would lead it the wrong way after it turned over"
        }
        None => "",
    };
    found.warning(
        about,
        format!(
            "it does not say on which side of its pier it hangs: if it is a German mount, it is not turned over in time{camera}; if it is a fork, say `german = false`"
        ),
    );
}

fn check_visits(
    plan: &Plan,
    mount: &MountPlan,
    guard: &Guard,
    abilities: &MountAbilities,
    said: Option<&Said>,
    options: &PreflightOptions,
    found: &mut Preflight,
) {
    let refraction = mount.refraction && abilities.refracts != Some(true);
    let mount = &MountPlan { refraction, ..mount.clone() };
    let axes = abilities.axes;
    // Where the telescope stands when the visit before ends.
    let mut stands: Option<Axes> = None;
    // From when on it may set out for a visit: not before the night, nor while another visit is on.
    let mut may_go = match plan.clock {
        NightClock::Computer => plan.from.max(options.now),
        _ => plan.from,
    };
    for (number, visit) in plan.schedule.visits().iter().enumerate() {
        let free = may_go.max(visit.from - EARLY_S * Unit::Second);
        may_go = visit.to.map_or(may_go, |to| may_go.max(to));
        let about = format!("visit {} ({})", number + 1, visit.target.name);
        let now = match plan.clock {
            NightClock::Computer => visit.from.max(options.now),
            _ => visit.from,
        };
        let job = next_job(&plan.schedule, now, plan.to, &|_, _| false);
        let Some(job) = job.filter(|job| job.visit.target == visit.target) else { continue };
        let path = match job.path(mount, &plan.station, axes, guard, now) {
            Ok(path) => path,
            Err(error) => {
                found.error(&about, format!("the mount will not follow it: {error}"));
                continue;
            }
        };
        // Before the first visit that it follows it stands where it says.
        let from = stands.or_else(|| said.map(|said| path.angles_of(&said.reading)));
        let pass = PassPlan::new(
            &visit.target.name,
            &path,
            guard,
            abilities,
            from,
            &mount.track_options(),
        );
        if let Some(why) = &pass.refused {
            found.error(&about, format!("the mount will not follow it: {why}"));
            continue;
        }
        tell_cut(&about, &path, now, job.to, guard, found);
        tell_dawn(&about, mount, (visit.from, job.to), guard, found);
        tell_way(&about, mount, pass.slew_deg, [free, visit.from, job.to], found);
        if !pass.turns_s.is_empty() {
            let at = pass.turns_s.iter().map(|s| format!("{s:.0} s")).collect::<Vec<_>>();
            found.warning(&about, format!(
                "the mount turns over {} after it begins, {:.0}° past the meridian (`past_meridian_deg`), and loses about {:.0} s",
                at.join(" and "),
                mount.past_meridian_deg(),
                mount.farthest_s()
            ));
        }
        if let Some(keyhole) = &pass.keyhole {
            found.warning(&about, format!(
                "the mount cannot follow through the pole of its axes from {:.0} s to {:.0} s: {:.0} s are lost ({:.1} °/s would be needed)",
                keyhole.from_s, keyhole.to_s, keyhole.lost_s(), keyhole.asked_deg_s
            ));
        }
        let [a, b] = pass.fastest_deg_s.to_array();
        let sun = if pass.sun_cone_holds {
            format!(", {:.0}° from the Sun", pass.sun_deg)
        } else {
            String::new()
        };
        let fastest = format!("up to {:.2} °/s{sun}", a.max(b));
        let text = match abilities.fastest_deg_s() {
            None if a.max(b) > STARS_DEG_S => format!(
                "nothing forbids the mount to follow it, {fastest}; how fast the mount is, is not known here (`most_rate_deg_s` in the plan)"
            ),
            _ => format!("the mount can follow it: {fastest}"),
        };
        found.fine(&about, text);
        stands = Some(angles(path.at(path.seconds()).direction));
    }
}

/// Tells what a visit loses by the way to its target. Where it is not known from where the mount comes, the longest way counts. The times: from when on it may set out, the visit's beginning, and its end.
fn tell_way(
    about: &str,
    mount: &MountPlan,
    slew_deg: Option<Axes>,
    [free, from, to]: [Epoch; 3],
    found: &mut Preflight,
) {
    let way_s = slew_deg.map_or(mount.farthest_s(), |way| mount.way_s(way.to_array()));
    let (left_s, length_s) = ((from - free).to_seconds(), (to - from).to_seconds());
    let lost_s = way_s - left_s;
    if lost_s <= 1.0 {
        return;
    }
    match slew_deg {
        Some(Axes { first: a, second: b }) if lost_s >= length_s => found.error(about, format!(
            "the way there takes about {way_s:.0} s ({:.0}° and {:.0}° at {} °/s): nothing is left of its {length_s:.0} s",
            a.abs(), b.abs(), mount.slew_deg_s()
        )),
        Some(_) => found.warning(about, format!(
            "the way there takes about {way_s:.0} s, and there are {:.0} s: {lost_s:.0} s of it are lost",
            left_s.max(0.0)
        )),
        None => found.warning(about, format!(
            "where the mount stands is not known: the way there may take {way_s:.0} s, and there are {:.0} s before its {length_s:.0} s",
            left_s.max(0.0)
        )),
    }
}

/// A visit in the morning that the parking at dawn cuts.
fn tell_dawn(
    about: &str,
    mount: &MountPlan,
    (from, to): (Epoch, Epoch),
    guard: &Guard,
    found: &mut Preflight,
) {
    let sun = |epoch: Epoch| guard.sun(epoch).altitude_deg;
    let rises = sun(to + 5.0 * Unit::Minute) > sun(to);
    if mount.park && rises && sun(to) > mount.dawn_deg() {
        let lost = if sun(from) > mount.dawn_deg() { "all" } else { "the end" };
        found.warning(about, format!(
            "{lost} of it is lost: the Sun rises to {:.1}°, and the mount is parked from {:.1}° on (`dawn_deg`, `park` in the plan)",
            sun(to),
            mount.dawn_deg()
        ));
    }
}

/// Parts of a visit in which the telescope may not point at the target.
fn tell_cut(
    about: &str,
    path: &TargetPath,
    now: Epoch,
    to: Epoch,
    guard: &Guard,
    found: &mut Preflight,
) {
    let ends = path.epoch(path.seconds());
    let (late_s, early_s) = ((path.from() - now).to_seconds(), (to - ends).to_seconds());
    let why = |epoch: Epoch| {
        let time_s = path.time_s(epoch);
        let enu = path.frame().to_enu(path.at(time_s).direction);
        guard.check_place(enu, epoch).err().map(|danger| danger.to_string())
    };
    if late_s > 2.0 {
        let why = why(path.from() - 2.0 * Unit::Second).unwrap_or_default();
        found.warning(about, format!("the mount waits {late_s:.0} s for it: {why}"));
    }
    if early_s > 2.0 {
        let why = why(ends + 2.0 * Unit::Second).unwrap_or_default();
        found.warning(about, format!("the mount leaves it {early_s:.0} s before its end: {why}"));
    }
}
