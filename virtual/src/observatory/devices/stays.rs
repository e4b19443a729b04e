//! A virtual night of an observer's own schedule, and the files that a session keeps of it.

use super::{ObservatoryError, VirtualObservatory, light_curve, options};
use crate::observatory::mount::Driven;
use crate::observatory::options::{Options, VisitKind, VisitOptions};
use crate::observatory::plan;
use hifitime::{Epoch, Unit};
use std::path::Path;
use sunglint_formats::session::{Target, TargetKind};
use sunglint_formats::toml::Document;
use sunglint_radiometry::sky::{Catalogue, EarthOrientation};
use sunglint_radiometry::station::Station;

/// A stay of the telescope at a target, as a session names it.
#[derive(Debug, Clone, PartialEq)]
pub struct Stay {
    /// The target.
    pub target: Target,
    /// When the stay begins.
    pub from: Epoch,
    /// When it ends; `None` with the night.
    pub to: Option<Epoch>,
}

/// A virtual observatory with its schedule and its files.
#[derive(Debug, Clone)]
pub struct Scheduled {
    /// The observatory.
    pub observatory: VirtualObservatory,
    /// The schedule: the one that was given, or the night's own.
    pub stays: Vec<Stay>,
    /// Files that the night was made of and its truth: paths within a session's folder, and bytes.
    pub files: Vec<(String, Vec<u8>)>,
}

impl VirtualObservatory {
    /// Makes the night of a `virtual.toml` for a schedule. A schedule without stays becomes the night's own. Of a night that is `mounted` the mount decides where
    /// the telescope points; its clocks then have to wait for each other ([`Together`](crate::together::Together)).
    ///
    /// # Errors
    /// A file that cannot be read or holds what no night can be; a stay whose light is not known, or without end.
    pub fn scheduled(
        path: &Path,
        station: &Station,
        start: Epoch,
        mut stays: Vec<Stay>,
        mounted: bool,
    ) -> Result<Scheduled, ObservatoryError> {
        let document = Document::read(path)?;
        let mut files =
            vec![("virtual/virtual.toml".to_owned(), document.source().as_bytes().to_vec())];
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
        let visits = if stays.is_empty() {
            let mut curve = |file: &str| light_curve(&document.resolve(file));
            plan::visits(&options, station, start, earth, &mut curve)?
        } else {
            visits_of(&stays, &document, &options, station, start)?
        };
        if stays.is_empty() {
            stays.extend(visits.iter().map(|visit| stay(visit, start)));
        }
        let (mount, seed) = (options.mount.clone(), options.seed);
        let mut observatory =
            Self::new(options, station, start, visits, earth).map_err(|error| match error {
                ObservatoryError::Night(source) => {
                    ObservatoryError::NightOf { file: document.path().to_path_buf(), source }
                }
                error => error,
            })?;
        if mounted {
            // As `visits_of` and `stay` have them: flats and stays without a target are none.
            let is_visit = |stay: &&Stay| {
                !matches!(stay.target.target_kind, TargetKind::Flat | TargetKind::None)
            };
            let targets: Vec<Target> =
                stays.iter().filter(is_visit).map(|stay| stay.target.clone()).collect();
            let night = &observatory.night;
            let span = (start, start + night.length_s() * Unit::Second);
            let scale = night.pixel_scale_arcsec;
            let driven = Driven::new(&mount, &station.site, span, &targets, scale, seed)?;
            observatory.driven = Some(driven);
        }
        files.push(("virtual/truth.json".into(), observatory.truth()?.into_bytes()));
        Ok(Scheduled { observatory, stays, files })
    }
}

/// The light of the stays that an observer planned.
fn visits_of(
    stays: &[Stay],
    document: &Document,
    options: &Options,
    station: &Station,
    start: Epoch,
) -> Result<Vec<plan::Visit>, ObservatoryError> {
    let mut visits = Vec::new();
    for stay in stays {
        let name = &stay.target.name;
        let target = match stay.target.target_kind {
            TargetKind::Star => {
                let star = Catalogue::embedded().find(name).map_err(|source| {
                    ObservatoryError::NotInCatalogue { name: name.clone(), source }
                })?;
                plan::Target::Star(Box::new(star.clone()))
            }
            TargetKind::Satellite => {
                let of_it = |visit: &&VisitOptions| {
                    visit.kind == VisitKind::Satellite && visit.name == *name
                };
                let curve = options.visit.iter().find(of_it).and_then(|v| v.curve.as_ref());
                let Some(file) = curve else {
                    let (name, file) = (name.clone(), document.path().to_path_buf());
                    return Err(ObservatoryError::NoLight { name, file });
                };
                let curve = light_curve(&document.resolve(file))?;
                let curve = plan::Curve::of_light_curve(&curve, start, station);
                plan::Target::Curve(plan::Curve { name: name.clone(), ..curve })
            }
            TargetKind::Dark | TargetKind::Bias => plan::Target::Dark,
            TargetKind::Sky => plan::Target::Sky { beside: String::new() },
            _ => continue,
        };
        let Some(to) = stay.to else {
            return Err(ObservatoryError::Endless { name: name.clone() });
        };
        let [from_s, to_s] = [stay.from, to].map(|epoch| (epoch - start).to_seconds());
        visits.push(plan::Visit { from_s, to_s, target });
    }
    Ok(visits)
}

/// A stay of the night's own plan.
fn stay(visit: &plan::Visit, start: Epoch) -> Stay {
    let name = visit.target.name();
    let on = |target_kind, place: Option<[f64; 2]>| Target {
        name: name.clone(),
        target_kind,
        on: true,
        ra_deg: place.map(|place| place[0]),
        dec_deg: place.map(|place| place[1]),
        tle: None,
        omm: None,
    };
    let target = match &visit.target {
        plan::Target::Star(star) => {
            on(TargetKind::Star, Some([star.icrs.ra_deg, star.icrs.dec_deg]))
        }
        plan::Target::Curve(_) => on(TargetKind::Satellite, None),
        plan::Target::Dark => Target::off(TargetKind::Dark),
        plan::Target::Sky { .. } => Target::off(TargetKind::Sky),
    };
    let at = |s: f64| start + s * Unit::Second;
    Stay { target, from: at(visit.from_s), to: Some(at(visit.to_s)) }
}
