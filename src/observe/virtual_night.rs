//! A night of the virtual observatory in place of devices: as fast as it can, its truth in the session.

use super::opener::{DeviceClock, Opener};
use super::plan::{CameraPlan, CounterPlan};
use super::schedule::Slot;
use crate::virtual_observatory::{VirtualObservatory, light_curve, options};
use anyhow::{Context as _, bail};
use hifitime::{Epoch, Unit};
use std::collections::HashMap;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use sunglint_drivers::clock::{Deadline, VirtualClock};
use sunglint_drivers::device::{Camera, DeviceError, PhotonCounter};
use sunglint_formats::session::{Target, TargetKind};
use sunglint_formats::toml::Document;
use sunglint_radiometry::sky::{Catalogue, EarthOrientation};
use sunglint_radiometry::station::Station;
use sunglint_virtual::observatory::options::{Options, VisitKind};
use sunglint_virtual::observatory::plan as light;

/// The address of its devices in NIGHT.toml.
pub const ADDRESS: &str = "virtual";

/// The devices of a virtual night, each on a clock of its own.
#[derive(Debug, Clone)]
pub struct VirtualNight {
    observatory: VirtualObservatory,
    clocks: Arc<Mutex<HashMap<String, Arc<VirtualClock>>>>,
}

impl VirtualNight {
    /// A night of a `virtual.toml` with the visits of a schedule, or, where that has none, with its own, which the schedule then becomes.
    /// What it was made of, and its truth, come with the configuration's files.
    ///
    /// # Errors
    /// A file that cannot be read or holds what no night can be; a visit whose light is not known.
    pub(super) fn read(
        path: &Path,
        station: &Station,
        start: Epoch,
        slots: &mut Vec<Slot>,
        files: &mut Vec<(String, Vec<u8>)>,
    ) -> anyhow::Result<Self> {
        let document = Document::read(path)?;
        files.push(("virtual/virtual.toml".into(), document.source().as_bytes().to_vec()));
        let options = options(&document)?;
        for file in options.visit.iter().filter_map(|visit| visit.curve.as_ref()) {
            let path = document.resolve(file);
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let file = (format!("virtual/{name}"), sunglint_formats::read::bytes(&path)?);
            if !files.contains(&file) {
                files.push(file);
            }
        }
        let earth = EarthOrientation::embedded();
        let visits = if slots.is_empty() {
            let mut curve = |file: &str| light_curve(&document.resolve(file));
            light::visits(&options, station, start, earth, &mut curve)?
        } else {
            visits_of(slots, &document, &options, station, start)?
        };
        if slots.is_empty() {
            slots.extend(visits.iter().map(|visit| slot(visit, start)));
        }
        let observatory = VirtualObservatory::new(options, station, start, visits, earth)
            .with_context(|| document.path().display().to_string())?;
        files.push(("virtual/truth.json".into(), observatory.truth()?.into_bytes()));
        Ok(Self { observatory, clocks: Arc::default() })
    }

    /// The night behind the devices.
    pub fn observatory(&self) -> &VirtualObservatory {
        &self.observatory
    }
}

/// The light of the stays that an observer planned.
fn visits_of(
    slots: &[Slot],
    document: &Document,
    options: &Options,
    station: &Station,
    start: Epoch,
) -> anyhow::Result<Vec<light::Visit>> {
    let mut visits = Vec::new();
    for slot in slots {
        let name = &slot.target.name;
        let target = match slot.target.target_kind {
            TargetKind::Star => {
                let star = Catalogue::embedded().find(name).with_context(|| {
                    format!("visit of {name}: a virtual night needs a star of the catalogue")
                })?;
                light::Target::Star(Box::new(star.clone()))
            }
            TargetKind::Satellite => {
                let of_it = |visit: &&sunglint_virtual::observatory::options::VisitOptions| {
                    visit.kind == VisitKind::Satellite && visit.name == *name
                };
                let curve = options.visit.iter().find(of_it).and_then(|v| v.curve.as_ref());
                let Some(file) = curve else {
                    bail!(
                        "visit of {name}: its light is not known: {} needs a [[visit]] of kind \"satellite\" with this name and a `curve`",
                        document.path().display()
                    );
                };
                let curve = light_curve(&document.resolve(file))?;
                let curve = light::Curve::of_light_curve(&curve, start, station);
                light::Target::Curve(light::Curve { name: name.clone(), ..curve })
            }
            TargetKind::Dark => light::Target::Dark,
            TargetKind::Sky => light::Target::Sky { beside: String::new() },
            _ => continue,
        };
        let Some(to) = slot.to else {
            bail!("visit of {name}: in a virtual night each visit ends (`to`, `for_s`)");
        };
        let [from_s, to_s] = [slot.from, to].map(|epoch| (epoch - start).to_seconds());
        visits.push(light::Visit { from_s, to_s, target });
    }
    Ok(visits)
}

/// A stay of the night's own plan.
fn slot(visit: &light::Visit, start: Epoch) -> Slot {
    let name = visit.target.name();
    let on = |target_kind, place: Option<[f64; 2]>| Target {
        name: name.clone(),
        target_kind,
        on: true,
        ra_deg: place.map(|place| place[0]),
        dec_deg: place.map(|place| place[1]),
        tle: None,
    };
    let target = match &visit.target {
        light::Target::Star(star) => {
            on(TargetKind::Star, Some([star.icrs.ra_deg, star.icrs.dec_deg]))
        }
        light::Target::Curve(_) => on(TargetKind::Satellite, None),
        light::Target::Dark => Target::off(TargetKind::Dark),
        _ => Target::off(TargetKind::Sky),
    };
    let at = |s: f64| start + s * Unit::Second;
    Slot { target, from: at(visit.from_s), to: Some(at(visit.to_s)) }
}

impl Opener for VirtualNight {
    fn clock(&self, device: &str) -> DeviceClock {
        let mut clocks = self.clocks.lock().unwrap_or_else(PoisonError::into_inner);
        let clock = clocks.entry(device.to_owned()).or_default().clone();
        DeviceClock { clock, zero_utc: Some(self.observatory.night().start) }
    }

    fn camera(&self, _: &CameraPlan, _: &Deadline) -> Result<Box<dyn Camera>, DeviceError> {
        match self.observatory.camera() {
            Some(camera) => Ok(Box::new(camera)),
            None => Err(DeviceError::NotReady {
                device: "virtual camera",
                reason: "the station of this night has no camera",
            }),
        }
    }

    fn counter(
        &self,
        plan: &CounterPlan,
        _: &Deadline,
    ) -> Result<Box<dyn PhotonCounter>, DeviceError> {
        Ok(Box::new(self.observatory.counter(&plan.channel_names())?))
    }
}
