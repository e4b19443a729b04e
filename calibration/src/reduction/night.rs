//! A whole session: its stays at targets, each as one linear light curve of all channels.

use super::counts::{CountOptions, CounterNight, Fibres, counter_night, gate, of_kind, spans};
use super::error::Within as _;
use super::frames::{APERTURE_FWHM, CameraNight, FrameOptions, Shown, camera_night};
use super::join::join;
use super::recipe::Recipe;
use super::sky::Body;
use super::{ReduceError, Stay};
use crate::counts::{Away, CountChannel, NotCarried, Sample, SkyLevels, SkyTally, Span, away};
use crate::track::Track;
use hifitime::Unit;
use serde_json::json;
use std::collections::BTreeMap;
use sunglint_formats::session::{Session, Target, TargetKind, Visit};
use sunglint_formats::text::counted;
use sunglint_numerics::progress::Progress;
use sunglint_radiometry::light_curve::{Input, LightCurve, Provenance, RateKind};
use sunglint_radiometry::station::{Detector, Station};

/// How a session is reduced.
#[derive(Debug, Clone)]
pub struct ReduceOptions {
    /// How targets are found and measured on frames; `None` for a station without a camera.
    pub frames: Option<FrameOptions>,
    /// How counts become rates.
    pub counts: CountOptions,
    /// Fields of the fibres in place of the station's.
    pub fibres: Fibres,
    /// Standard deviations of the widest fibre's field beyond which a target that is seen beside it counts as sky; `None` takes the log alone.
    pub off_sigmas: Option<f64>,
    /// Only this target.
    pub target: Option<String>,
    /// Only this one of the target's visits, from 1.
    pub visit: Option<u32>,
}

/// Standard deviations of the widest fibre's field beyond which a target counts as sky, where nothing is said.
pub const OFF_SIGMAS: f64 = 5.0;

impl ReduceOptions {
    /// The usual options for a station.
    pub fn for_station(station: &Station) -> Self {
        let mut counts = CountOptions::default();
        counts.bins.gate = gate(Some(1.0), true);
        Self {
            frames: FrameOptions::for_station(station),
            counts,
            fibres: Fibres::new(),
            off_sigmas: Some(OFF_SIGMAS),
            target: None,
            visit: None,
        }
    }
}

/// A stay at a target, reduced.
#[derive(Debug)]
pub struct Visited {
    /// The stay.
    pub stay: Stay,
    /// The linear curve of all channels.
    pub linear: LightCurve,
    /// The counters' rates as they were counted.
    pub raw: Option<LightCurve>,
    /// Where the target stood.
    pub track: Track,
    /// Where the counters' sky came from, by channel.
    pub skies: BTreeMap<String, SkyTally>,
    /// Frames for figures, each with its camera's name.
    pub shown: Vec<(String, Shown)>,
}

/// A session, reduced: [`Reduced::take`] gives its visits one after the other.
#[derive(Debug)]
pub struct Reduced {
    /// All stays, at targets and beside them.
    pub stays: Vec<Stay>,
    /// Track of the target for each stay.
    tracks: Vec<Track>,
    /// The stay to be taken next.
    next: usize,
    /// Results of the cameras, with what their rules removed.
    pub cameras: Vec<CameraNight>,
    /// Results of the counters, with what their rules did.
    pub counters: Vec<CounterNight>,
    /// Warnings for the user.
    pub warnings: Vec<String>,
    /// A sentence about what was chosen by hand, for the provenance.
    by_hand: Option<String>,
}

/// A stay that the log does not end lasts at most so long, hours: longer than any night.
const LONGEST_H: f64 = 24.0;
/// Stretches beside the fibre shorter than this are the target's own wandering, s.
const LEAST_AWAY_S: f64 = 5.0;
/// Uncertainty of a sky on a line, as a part of the rate, from which on it is warned of.
const MOST_DOUBT: f64 = 0.01;

/// The stays of a session, each with an end.
///
/// # Errors
/// A log that cannot be read.
pub fn stays(session: &Session) -> Result<Vec<Stay>, ReduceError> {
    let stay = |Visit { target, number, from, to }: Visit| Stay {
        target,
        number,
        from,
        to: to.unwrap_or(from + LONGEST_H * Unit::Hour),
    };
    Ok(session.visits()?.into_iter().map(stay).collect())
}

/// Reduces a session.
///
/// # Errors
/// A session without targets or instruments, a station that is not its own, a file that cannot be read, a stop.
pub fn reduce(
    session: &Session,
    station: &Station,
    options: &ReduceOptions,
    progress: &dyn Progress,
) -> Result<Reduced, ReduceError> {
    reduce_with(session, station, options, progress, &mut |_, _, _| {})
}

/// Reduces a session like [`reduce`]; `each` sees every sample of every counter as it comes, with its stay.
///
/// # Errors
/// The errors of [`reduce`].
pub fn reduce_with(
    session: &Session,
    station: &Station,
    options: &ReduceOptions,
    progress: &dyn Progress,
    each: &mut dyn FnMut(&[CountChannel], &Stay, &Sample),
) -> Result<Reduced, ReduceError> {
    let root = session.root().display();
    let all = stays(session)?;
    // Calibration frames alone fill a library.
    let fills = options.target.is_none()
        && options.frames.as_ref().is_some_and(|frames| frames.library.is_some())
        && !all.iter().any(|stay| stay.target.on);
    let stays = match fills {
        true => all,
        false => chosen(all, options.target.as_deref(), options.visit)
            .within(|| format!("session {root}"))?,
    };
    let mut warnings = Vec::new();
    if session.manifest().station != station.name {
        warnings.push(format!(
            "session {root} was recorded at station {}, and is reduced with station {}",
            session.manifest().station,
            station.name
        ));
    }
    let mut cameras = Vec::new();
    for camera in session.cameras() {
        let frames = options.frames.as_ref().ok_or_else(|| ReduceError::NoCamera {
            station: station.name.clone(),
            session: root.to_string(),
        })?;
        let night = camera_night(session, camera, station, &stays, frames, progress)
            .within(|| format!("camera {camera} of session {root}"))?;
        for (file, error) in &night.failed {
            warnings.push(format!("{} is left out: {error}", file.path.display()));
        }
        warnings.extend(night.warnings.iter().cloned());
        cameras.push(night);
    }
    let calibrates =
        |night: &CameraNight| night.sensor.darks[0] + night.sensor.bias + night.sensor.flats[0] > 0;
    if fills && !cameras.iter().any(calibrates) {
        return Err(ReduceError::NoTarget).within(|| format!("session {root}"));
    }
    let tracks = tracks(&cameras, stays.len());
    let seen_off = seen_off(&tracks, station, options);
    let spans = spans(&stays, &seen_off);
    let mut counts = options.counts;
    if cameras.is_empty() && (counts.bins.gate.most_q.is_some() || counts.bins.gate.divide) {
        counts.bins.gate = gate(None, false);
        warnings.push(format!(
            "session {root} has no camera: where its targets stood in the fibres is not known, rates are neither gated nor divided by a coupling"
        ));
    }
    // The camera with the most of it.
    let sky = cameras.iter().max_by_key(|camera| camera.sky.len());
    let sky = SkyLevels::new(sky.into_iter().flat_map(|camera| camera.sky.iter().copied()));
    let mut counters = Vec::new();
    for counter in session.counters() {
        let night = counter_night(
            session,
            counter,
            station,
            &options.fibres,
            &spans,
            (&tracks, &sky),
            &counts,
            progress,
            &mut |channels, sample| {
                if let Some(stay) = stays.get(sample.visit) {
                    each(channels, stay, sample);
                }
            },
        )
        .within(|| format!("counter {counter} of session {root}"))?;
        if !night.unknown.is_empty() {
            warnings.push(format!(
                "counter {counter}: station {} has no counter {}: not reduced",
                station.name,
                night.unknown.join(", ")
            ));
        }
        if night.torn_bytes > 0 {
            warnings.push(format!(
                "counter {counter}: {} bytes of a last line without its end are left out",
                night.torn_bytes
            ));
        }
        warnings.extend(night.warnings.iter().cloned());
        counters.push(night);
    }
    if cameras.is_empty() && counters.is_empty() {
        return Err(ReduceError::NoInstrument { session: root.to_string() });
    }
    let by_hand = options.frames.as_ref().and_then(Recipe::note);
    Ok(Reduced { stays, tracks, next: 0, cameras, counters, warnings, by_hand })
}

/// The stays of one target, or one of them, with all that is off it; all stays without a name.
fn chosen(
    stays: Vec<Stay>,
    target: Option<&str>,
    visit: Option<u32>,
) -> Result<Vec<Stay>, ReduceError> {
    let names: Vec<&str> =
        stays.iter().filter(|stay| stay.target.on).map(|stay| stay.target.name.as_str()).collect();
    if names.is_empty() {
        return Err(ReduceError::NoTarget);
    }
    let Some(wanted) = target else { return Ok(stays) };
    if !names.contains(&wanted) {
        let mut known: Vec<&str> = names.clone();
        known.dedup();
        let known = known.into_iter().map(str::to_owned).collect();
        return Err(ReduceError::UnknownTarget { wanted: wanted.to_owned(), known });
    }
    let is_wanted =
        |stay: &Stay| stay.target.name == wanted && visit.is_none_or(|visit| visit == stay.number);
    if !stays.iter().any(|stay| stay.target.on && is_wanted(stay)) {
        let wanted = format!("{wanted}, visit {}", visit.unwrap_or(0));
        let known = stays.iter().filter(|stay| stay.target.on);
        let known =
            known.map(|stay| format!("{}, visit {}", stay.target.name, stay.number)).collect();
        return Err(ReduceError::UnknownTarget { wanted, known });
    }
    Ok(stays.into_iter().filter(|stay| !stay.target.on || is_wanted(stay)).collect())
}

/// Returns for each stay the track of the camera that saw the target in most of its frames.
fn tracks(cameras: &[CameraNight], stays: usize) -> Vec<Track> {
    let detected = |track: &&Track| track.points.iter().filter(|p| p.place.is_some()).count();
    (0..stays)
        .map(|stay| {
            let tracks = cameras.iter().map(|camera| &camera.tracks[stay]);
            tracks.max_by_key(detected).cloned().unwrap_or_default()
        })
        .collect()
}

/// Stretches in which the frames show the target beside all fibres.
fn seen_off(tracks: &[Track], station: &Station, options: &ReduceOptions) -> Vec<Span> {
    let fibres: Vec<_> = station
        .channels
        .iter()
        .filter_map(|channel| match &channel.detector {
            Detector::Counter(counter) => {
                options.fibres.get(&channel.name).copied().or(counter.fibre)
            }
            Detector::CameraPlane(_) => None,
        })
        .collect();
    let (Some(sigmas), Some(widest)) = (
        options.off_sigmas,
        fibres.iter().max_by(|a, b| {
            let width = |f: &sunglint_radiometry::station::Fibre| f.sigma_px[0].max(f.sigma_px[1]);
            width(a).total_cmp(&width(b))
        }),
    ) else {
        return Vec::new();
    };
    let away_from = Away {
        distance_px: sigmas * widest.sigma_px[0].max(widest.sigma_px[1]),
        from_px: widest.offset_px,
        undetected: false,
        least_s: LEAST_AWAY_S,
    };
    tracks.iter().flat_map(|track| away(track, &away_from)).collect()
}

impl Reduced {
    /// Tracks of the target for each stay; empty for one that [`Reduced::take`] has taken.
    pub fn tracks(&self) -> &[Track] {
        &self.tracks
    }

    /// The next stay at a target that gave a curve, which leaves memory with it; `None` behind the last. A stay without frames and bins becomes a warning.
    ///
    /// # Errors
    /// A target whose place cannot be computed, two instruments with a channel of one name.
    pub fn take(
        &mut self,
        session: &Session,
        station: &Station,
    ) -> Result<Option<Visited>, ReduceError> {
        while self.next < self.stays.len() {
            let number = self.next;
            self.next += 1;
            let stay = self.stays[number].clone();
            if !stay.target.on {
                continue;
            }
            let track = std::mem::take(&mut self.tracks[number]);
            match self.visited(number, &stay, track, session, station)? {
                Some(visited) => return Ok(Some(visited)),
                None => self.warnings.push(format!(
                    "{} (visit {}): no frames or bins of a channel of the station: nothing was recorded, or behind other filters or in other colours than its channels have",
                    stay.target.name, stay.number
                )),
            }
        }
        Ok(None)
    }

    /// Joins what the instruments gave of a stay.
    fn visited(
        &mut self,
        number: usize,
        stay: &Stay,
        track: Track,
        session: &Session,
        station: &Station,
    ) -> Result<Option<Visited>, ReduceError> {
        let (mut linear, mut raw, mut shown) = (Vec::new(), Vec::new(), Vec::new());
        for counter in &mut self.counters {
            if let Some(curves) = counter.curves[number].take() {
                raw.push(of_kind(curves.clone(), RateKind::Raw));
                linear.push(of_kind(curves, RateKind::Linear));
            }
        }
        for camera in &mut self.cameras {
            linear.extend(camera.curves[number].take());
            let frames = std::mem::take(&mut camera.shown[number]);
            shown.extend(frames.into_iter().map(|frame| (camera.camera.clone(), frame)));
        }
        linear.retain(|curve| !curve.channels.is_empty());
        if linear.is_empty() {
            return Ok(None);
        }
        let skies = self.skies(number);
        self.warnings.extend(sky_warnings(stay, &skies));
        let body = Body::of(&stay.target)?;
        let wings = self.cameras.iter().flat_map(|camera| &camera.wings[number]);
        let mut notes: Vec<String> = wings.map(super::wings::Wings::note).collect();
        for camera in self.cameras.iter().filter(|camera| !camera.from_library.is_empty()) {
            let (name, masters) = (&camera.camera, camera.from_library.join(", "));
            notes.push(format!("camera {name}: calibrated by masters of the library: {masters}"));
        }
        let seen = || self.cameras.iter().filter(|camera| !camera.looks[number].is_empty());
        let follow = seen().filter(|camera| camera.apertures_follow);
        notes.extend(follow.map(|camera| {
            format!(
                "camera {}: apertures are {APERTURE_FWHM} widths of a point on each frame",
                camera.camera
            )
        }));
        notes.extend(seen().filter_map(|camera| camera.times[number].note(&camera.camera)));
        notes.extend(skies.iter().filter_map(|(channel, sky)| sky_note(channel, sky)));
        let complete = |curves: &[LightCurve]| {
            let mut curve =
                join(curves).map_err(|channel| ReduceError::TwoInstruments { channel })?;
            if let Some(body) = &body {
                body.locate(&mut curve.samples, &station.site)?;
            }
            curve.provenance = provenance(&stay.target, session, station);
            curve.provenance.notes.extend(self.by_hand.clone());
            curve.provenance.notes.extend(notes.iter().cloned());
            curve.other.insert("target".into(), target_json(stay));
            Ok::<_, ReduceError>(curve)
        };
        let linear = complete(&linear)?;
        let raw = if raw.is_empty() { None } else { Some(complete(&raw)?) };
        Ok(Some(Visited { stay: stay.clone(), linear, raw, track, skies, shown }))
    }

    /// Where the counters' sky of a stay came from, by channel.
    fn skies(&self, number: usize) -> BTreeMap<String, SkyTally> {
        let of = |counter: &CounterNight| {
            let names = counter.summary.channels.iter().map(|channel| channel.name.clone());
            let skies = counter.skies.get(number).into_iter().flatten().cloned();
            names.zip(skies).collect::<Vec<_>>()
        };
        self.counters.iter().flat_map(of).collect()
    }
}

/// Sentence for the curve about a channel's sky between the looks at it; `None` where it hardly changed.
fn sky_note(channel: &str, sky: &SkyTally) -> Option<String> {
    let SkyTally { carried, .. } = sky;
    let line = sky.on_line();
    (carried + line > 0).then(|| {
        format!(
            "sky of {channel} between the looks at it: as it went in the camera's frames for {}, on a line for {line}",
            counted(*carried as usize, "sample")
        )
    })
}

/// Warnings about skies that changed and are on a line in time: one for each reason.
fn sky_warnings(stay: &Stay, skies: &BTreeMap<String, SkyTally>) -> Vec<String> {
    let mut by_reason: BTreeMap<NotCarried, (Vec<&str>, f64)> = BTreeMap::new();
    for (channel, sky) in skies {
        let (Some(why), Some(doubt)) = (sky.reason(), sky.doubt()) else { continue };
        if doubt > MOST_DOUBT {
            let (channels, most) = by_reason.entry(why).or_default();
            channels.push(channel);
            *most = most.max(doubt);
        }
    }
    let of = |(why, (channels, most)): (NotCarried, (Vec<&str>, f64))| {
        let part = match most {
            most if most <= 1.0 => format!("{:.1} % of the rate", 100.0 * most),
            _ => "more than the rate".to_owned(),
        };
        let why = match why {
            NotCarried::NoFrames => {
                "there are too few frames of a camera at the target and in both looks to tell"
            }
            NotCarried::OtherSettings => {
                "the camera's frames at the target and in the looks have other settings (exposure, gain, binning, window, filter): with the same ones in all three they would tell; automatic exposure does not keep them"
            }
            NotCarried::OtherChange => "the sky in the camera's frames changed otherwise",
            NotCarried::NoBetter => "the camera's frames tell it no better",
        };
        format!(
            "{} (visit {}): the sky of {} changed between the looks before and after, and is taken on a line in time, uncertain by {part}: {why}",
            stay.target.name,
            stay.number,
            channels.join(", ")
        )
    };
    by_reason.into_iter().map(of).collect()
}

/// Returns the description of the target for the metadata of light curves.
fn target_json(stay: &Stay) -> serde_json::Value {
    let Target { name, target_kind, ra_deg, dec_deg, tle, omm, .. } = &stay.target;
    let kind = if *target_kind == TargetKind::Star { "star" } else { "satellite" };
    let mut target = json!({"name": name, "kind": kind, "visit": stay.number});
    for (key, value) in [("ra_deg", ra_deg), ("dec_deg", dec_deg)] {
        if let Some(value) = value {
            target[key] = json!(value);
        }
    }
    if let Some(tle) = tle {
        target["tle"] = json!(tle);
    }
    if let Some(omm) = omm {
        target["omm"] = json!(omm);
    }
    target
}

fn provenance(target: &Target, session: &Session, station: &Station) -> Provenance {
    let mut inputs: Vec<Input> = session
        .manifest()
        .files
        .iter()
        .map(|file| Input {
            file: session.file(&file.path).display().to_string(),
            sha256: file.sha256.clone(),
        })
        .collect();
    inputs.extend(
        station.sources.iter().map(|(path, sha256)| Input {
            file: path.display().to_string(),
            sha256: sha256.clone(),
        }),
    );
    Provenance {
        program: format!("sunglint {}", env!("CARGO_PKG_VERSION")),
        command: format!("reduce {}", session.root().display()),
        station: station.name.clone(),
        target: target.name.clone(),
        inputs,
        notes: vec![
            "sigma: photons, detector, background, place in the fibre; without scintillation, which is common to the channels".into(),
            "camera channels in ADU/s, standing for all pixels of the aperture (a mosaic's red and blue times 4, green times 2)".into(),
        ],
        ..Provenance::default()
    }
}
