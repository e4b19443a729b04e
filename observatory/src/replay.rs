//! A session that is observed again: the same devices by the same names, the same configuration, targets and times.

use super::night::Night;
use super::plan::{CameraPlan, CounterPlan};
use super::playback::Playback;
use super::schedule::Schedule;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use sunglint_formats::FileError;
use sunglint_formats::session::{DeviceKind, Disk, FileSum, Manifest, Session, What};
use sunglint_formats::toml::Positive;
use sunglint_radiometry::station::{RecordedError, Station};

/// Why a session cannot be played back.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReplayError {
    /// It is no session, or one of its files cannot be read.
    #[error(transparent)]
    File(#[from] FileError),
    /// A time of a device that no device can have.
    #[error("session.toml: {key} is {value_s}, expected more than 0")]
    Time {
        /// The key.
        key: &'static str,
        /// Value of the time, s.
        value_s: f64,
    },
    /// The station that it was recorded with is not known.
    #[error(transparent)]
    Station(RecordedError),
}

impl Night {
    /// Prepares a night that plays a session back: at speed, or as `fast` as the computer can.
    ///
    /// The new session goes into `root`, or beside the old one. `program` is the name and version that its manifest gets.
    ///
    /// # Errors
    /// A folder that is no session or cannot be read; a station that is not known.
    pub fn replayed(
        session: &Path,
        fast: bool,
        root: Option<&Path>,
        program: &str,
    ) -> Result<Self, ReplayError> {
        let session = Session::open(session)?;
        let playback = Playback::new(&session, fast)?;
        let old = session.manifest().clone();
        let mut ended = None;
        for event in session.events()? {
            let event = event?;
            if matches!(event.what, What::End { .. }) {
                ended = Some(event.utc);
            }
        }
        let mut files = Vec::new();
        for FileSum { path, .. } in &old.files {
            files.push((path.clone(), sunglint_formats::read::bytes(session.file(path))?));
        }
        let (cameras, counters) = devices(&old)?;
        Ok(Self {
            root: root.map_or_else(|| beside(&session), Path::to_path_buf),
            storage: Arc::new(Disk),
            station: Station::of_session(&session).map_err(ReplayError::Station)?,
            schedule: Schedule::of_session(&session)?,
            end: Some(playback.end()),
            ended,
            in_utc: false,
            live: None,
            opener: Arc::new(playback),
            manifest: Manifest { program: program.to_owned(), ..old },
            files,
            cameras,
            counters,
            wheels: vec![],
            from: None,
            ends_with_visits: false,
            resumes: false,
            mount: None,
            watchdog: None,
            rotators: vec![],
        })
    }
}

/// The devices of a session, left as they stand.
fn devices(manifest: &Manifest) -> Result<(Vec<CameraPlan>, Vec<CounterPlan>), ReplayError> {
    let (mut cameras, mut counters) = (Vec::new(), Vec::new());
    for device in &manifest.devices {
        // Where wheels and rotators stood is in the headers of the frames.
        if matches!(device.kind, DeviceKind::Wheel | DeviceKind::Rotator | DeviceKind::Mount) {
            continue;
        }
        let (name, address) = (device.name.clone(), device.address.clone());
        let wrong = || ReplayError::Time { key: "exposure_s", value_s: device.exposure_s };
        let exposure_s = Positive::new(device.exposure_s).ok_or_else(wrong)?;
        match device.kind {
            DeviceKind::Camera => cameras.push(CameraPlan::plain(name, address, exposure_s)),
            DeviceKind::Counter => {
                let mut plan = CounterPlan::plain(name, address, exposure_s);
                let inputs = device.inputs.iter().filter_map(|i| u32::try_from(*i).ok());
                plan.channels = match inputs.collect::<Vec<_>>() {
                    inputs if inputs.len() == device.channels.len() => {
                        device.channels.iter().cloned().zip(inputs).collect()
                    }
                    _ => device.channels.iter().cloned().zip(1..).collect(),
                };
                plan.raw_tags = device.raw_tags;
                counters.push(plan);
            }
            DeviceKind::Wheel | DeviceKind::Rotator | DeviceKind::Mount => {}
        }
    }
    Ok((cameras, counters))
}

/// The first free name beside a session.
fn beside(session: &Session) -> PathBuf {
    let name = session.root().file_name().unwrap_or_default().to_string_lossy();
    let beside = session.root().parent().unwrap_or(Path::new("")).to_path_buf();
    (1..)
        .map(|n| beside.join(format!("{name}_replay{n}")))
        .find(|path| !path.exists())
        .unwrap_or(beside)
}
