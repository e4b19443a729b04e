//! Next thing that the mount has to do: the target of a visit, as a path over the site.

use super::aim::needs_mount;
use super::plan::MountPlan;
use crate::pointing::Body;
use crate::schedule::{Schedule, Slot};
use crate::telescope::{Danger, Guard, PathError, TargetPath, angles};
use crate::worker::Worker;
use hifitime::{Epoch, Unit};
use sunglint_drivers::device::MountAxes;
use sunglint_formats::session::{Target, TargetKind};
use sunglint_numerics::measured::Interval;
use sunglint_radiometry::sky::{AzimuthAltitude, Catalogue, EarthOrientation, Equatorial, Star};
use sunglint_radiometry::station::Station;

/// How long before its visit the mount goes to a target, s.
pub(super) const EARLY_S: f64 = 300.0;
/// How long before its visit a satellite is followed already, s: so that it is found when the visit begins.
const LEAD_S: f64 = 20.0;
/// Longest path at once, s.
const MOST_S: f64 = 14_400.0;
/// Step in which a path is held against horizon and Sun, s.
const STEP_S: f64 = 1.0;

/// Why a visit cannot be followed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum JobError {
    /// There is no path.
    #[error(transparent)]
    Path(#[from] PathError),
    /// No part of it is allowed.
    #[error(transparent)]
    Danger(#[from] Danger),
    /// The target has no place.
    #[error(
        "its place is not known: a star of the catalogue, `ra_deg` and `dec_deg`, or elements are needed"
    )]
    NoPlace,
}

/// A visit that the mount follows.
#[derive(Debug, Clone, PartialEq)]
pub struct Job {
    /// The visit.
    pub visit: Slot,
    /// When it ends for the mount.
    pub to: Epoch,
    /// For the sky: the visit beside which it is, the nearer one in time, and whether that one came before.
    pub beside: Option<(Slot, bool)>,
}

/// The visit that is on now, or the next one within five minutes; none where no telescope is needed.
pub fn next_job(
    schedule: &Schedule,
    now: Epoch,
    end: Option<Epoch>,
    is_barred: &dyn Fn(&Target, Epoch) -> bool,
) -> Option<Job> {
    let visits = schedule.visits();
    let at = visits.iter().position(|visit| visit.to.is_none_or(|to| to > now))?;
    let visit = visits.get(at)?.clone();
    let begins_s = (visit.from - now).to_seconds();
    let seen = needs_mount(visit.target.target_kind) && begins_s <= EARLY_S;
    if !seen || is_barred(&visit.target, visit.from) {
        return None;
    }
    let most = now + (begins_s.max(0.0) + MOST_S) * Unit::Second;
    let to = [visit.to, end].into_iter().flatten().fold(most, |a, b| if b < a { b } else { a });
    let has_place =
        |slot: &&Slot| matches!(slot.target.target_kind, TargetKind::Star | TargetKind::Satellite);
    let beside = (visit.target.target_kind == TargetKind::Sky).then(|| {
        let before = visits[..at].iter().rev().find(has_place);
        let after = visits[at..].iter().find(has_place);
        // The nearer one in time: a look at the sky before a pass is where that begins.
        let since_s = |slot: &Slot| slot.to.map_or(0.0, |to| (visit.from - to).to_seconds());
        let until_s =
            |slot: &Slot| visit.to.map_or(f64::INFINITY, |to| (slot.from - to).to_seconds());
        match (before, after) {
            (Some(before), Some(after)) if until_s(after) < since_s(before) => Some((after, false)),
            (Some(before), _) => Some((before, true)),
            (None, after) => after.map(|after| (after, false)),
        }
        .map(|(slot, came_before)| (slot.clone(), came_before))
    });
    (to > now).then(|| Job { visit, to, beside: beside.flatten() })
}

/// The star of a target, with its proper motion where the catalogue has it.
fn star_of(target: &Target) -> Option<Star> {
    let (ra_deg, dec_deg) = (target.ra_deg?, target.dec_deg?);
    if let Ok(star) = Catalogue::embedded().find(&target.name)
        && (star.icrs.ra_deg - ra_deg).abs() < 1e-6
        && (star.icrs.dec_deg - dec_deg).abs() < 1e-6
    {
        return Some(star.clone());
    }
    Star::at(&target.name, Equatorial { ra_deg, dec_deg }).ok()
}

impl Job {
    /// Whether the target gives light that a camera could see.
    pub fn is_seen(&self) -> bool {
        self.visit.target.target_kind != TargetKind::Sky
    }

    /// Whether the schedule, which was exchanged, still wants it.
    pub fn is_still(&self, worker: &Worker) -> bool {
        let next =
            next_job(&worker.schedule.for_movers(), worker.clock.utc(), worker.end, &|_, _| false);
        // One that ends earlier now is it until then.
        next.is_some_and(|next| {
            // After a pause for the focus its visit begins later, and the target is the same.
            next.visit.target == self.visit.target && next.visit.from >= self.visit.from
        })
    }

    /// The path of the target from now on, cut to what horizon, lowest altitude and the Sun allow.
    ///
    /// # Errors
    /// See [`JobError`].
    pub fn path(
        &self,
        plan: &MountPlan,
        station: &Station,
        axes: MountAxes,
        guard: &Guard,
        now: Epoch,
    ) -> Result<TargetPath, JobError> {
        let make = |from: Epoch, to: Epoch| self.whole(plan, station, axes, guard, (from, to));
        let lead = match self.visit.target.target_kind {
            TargetKind::Satellite => self.visit.from - LEAD_S * Unit::Second,
            _ => now,
        };
        let from = lead.max(now);
        let path = make(from, self.to)?;
        let [first_s, last_s] = allowed(&path, guard)?.to_array();
        if first_s <= 0.0 && last_s + STEP_S >= path.seconds() {
            return Ok(path);
        }
        make(path.epoch(first_s), path.epoch(last_s))
    }

    /// The whole path, as the mount has to show it.
    fn whole(
        &self,
        plan: &MountPlan,
        station: &Station,
        axes: MountAxes,
        guard: &Guard,
        span: (Epoch, Epoch),
    ) -> Result<TargetPath, JobError> {
        let path = self.seen(plan, station, axes, guard, span)?;
        Ok(match &plan.model {
            Some(model) => model.path(path)?,
            None => path,
        })
    }

    fn seen(
        &self,
        plan: &MountPlan,
        station: &Station,
        axes: MountAxes,
        guard: &Guard,
        (from, to): (Epoch, Epoch),
    ) -> Result<TargetPath, JobError> {
        let (site, earth) = (&station.site, EarthOrientation::embedded());
        let span = (from, (to - from).to_seconds().max(1.0));
        let refraction = plan.refraction;
        let target = match &self.beside {
            Some((slot, _)) => &slot.target,
            None => &self.visit.target,
        };
        let beside_deg = match self.visit.target.target_kind {
            TargetKind::Sky => plan.sky_beside_deg(),
            _ => 0.0,
        };
        if let Some(star) = star_of(target) {
            if beside_deg == 0.0 {
                return Ok(TargetPath::star(&star, site, earth, span, axes, refraction)?);
            }
            // Towards the equator, so that it is no nearer to a pole.
            let dec_deg = star.icrs.dec_deg - beside_deg.copysign(star.icrs.dec_deg);
            let place = Equatorial { ra_deg: star.icrs.ra_deg, dec_deg };
            let sky = Star::at(&target.name, place).map_err(|_| JobError::NoPlace)?;
            return Ok(TargetPath::star(&sky, site, earth, span, axes, refraction)?);
        }
        let Some(Body::Orbit(orbit)) = Body::of(target) else { return Err(JobError::NoPlace) };
        if let Some((slot, before)) = &self.beside {
            // Where the pass ends, or begins, as far as the telescope may follow it.
            let length_s = slot.to.map_or(1.0, |to| (to - slot.from).to_seconds());
            let of_pass = (slot.from, length_s.clamp(1.0, MOST_S));
            let pass =
                TargetPath::new(&orbit, site, earth, of_pass, MountAxes::Horizontal, refraction)?;
            let [first_s, last_s] =
                allowed(&pass, guard).map_or([0.0, pass.seconds()], Interval::to_array);
            let at_s = if *before { last_s } else { first_s };
            let at = angles(pass.at(at_s).direction);
            let horizontal =
                AzimuthAltitude { azimuth_deg: at.first, altitude_deg: at.second + beside_deg };
            return Ok(TargetPath::fixed(horizontal, site, earth, span, axes)?);
        }
        Ok(TargetPath::new(&orbit, site, earth, span, axes, refraction)?)
    }
}

/// First stretch of a path in which the telescope may point at it: its beginning and end, s.
///
/// # Errors
/// Why it may not at the path's beginning, where there is no such stretch of ten seconds.
pub fn allowed(path: &TargetPath, guard: &Guard) -> Result<Interval, Danger> {
    let count = (path.seconds() / STEP_S) as usize;
    let mut first: Option<f64> = None;
    let mut why = None;
    for i in 0..=count {
        let time_s = i as f64 * STEP_S;
        let enu = path.frame().to_enu(path.at(time_s).direction);
        match (guard.check_place(enu, path.epoch(time_s)), first) {
            (Ok(()), None) => first = Some(time_s),
            (Err(_), Some(from)) if time_s - from >= 10.0 => {
                return Ok(Interval::new(from, time_s - STEP_S));
            }
            (Err(danger), _) => {
                first = None;
                why.get_or_insert(danger);
            }
            (Ok(()), Some(_)) => {}
        }
    }
    match (first, why) {
        (Some(from), _) => Ok(Interval::new(from, path.seconds())),
        (None, Some(danger)) => Err(danger),
        (None, None) => Ok(Interval::new(0.0, path.seconds())),
    }
}
