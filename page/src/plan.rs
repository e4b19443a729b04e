//! A night that is planned by hand: passes and stars, picked on the sky, become a NIGHT.toml.

use crate::recorded::unix_ms;
use crate::request::{Answer, Request, Source};
use crate::sky::Sky;
use hifitime::{Duration, Epoch};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use sunglint_formats::atomic::{Overwrite, write_file};
use sunglint_formats::time::format_utc;
use sunglint_observatory::planner::{
    NightPlan, PassOffer, Pick, PlannerOptions, Surroundings, plan_night, plan_picks,
};
use sunglint_observatory::{Catalogue, Level, Plan, Preflight, PreflightOptions, preflight};
use sunglint_radiometry::air::Air;
use sunglint_radiometry::passband::ZeroPoint;
use sunglint_radiometry::sky::{AzimuthAltitude, EarthOrientation};

/// Picks of a plan at most.
const MOST: usize = 500;

/// Place of a pass at a moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanPoint {
    /// When.
    pub at: Epoch,
    /// Azimuth and altitude, deg, true.
    pub at_deg: AzimuthAltitude,
    /// Whether the Sun shines on it.
    pub lit: bool,
    /// Whether the sky is dark.
    pub dark: bool,
    /// Speed over the sky, deg/s; `None` where it has no place a moment before or after.
    pub speed_deg_per_s: Option<f64>,
    /// V magnitude at the station, after the air; `None` where no light comes.
    pub v_mag: Option<f64>,
}

/// Predicted light of a pass in a channel along its course: a value for each point of the track.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PlanCurve {
    /// Channel.
    pub channel: String,
    /// Unit of the rates that arrive: `Hz` or `ADU/s`.
    pub unit: &'static str,
    /// Rates that arrive; `None` where no light comes or the station has no coefficient for it.
    pub arriving: Vec<Option<f64>>,
    /// Rates that a counter reports, Hz.
    pub counted_hz: Vec<Option<f64>>,
    /// Where it is saturated.
    pub saturated: Vec<bool>,
}

/// Predicted light of a pass in a channel, at its brightest.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PlanRate {
    /// Channel.
    pub channel: String,
    /// Unit of the rates: `Hz` or `ADU/s`.
    pub unit: &'static str,
    /// Rate that arrives; `None` where the station has no coefficient for it.
    pub arriving: Option<f64>,
    /// Rate that a counter reports.
    pub counted_hz: Option<f64>,
    /// Whether it is saturated.
    pub saturated: bool,
}

/// A pass that may be picked.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanPass {
    /// Description of it for the planner.
    pub offer: PassOffer,
    /// Course over the sky, in the order of time.
    pub track: Vec<PlanPoint>,
    /// Predicted light at its brightest.
    pub rates: Vec<PlanRate>,
    /// Predicted light along its course.
    pub curves: Vec<PlanCurve>,
}

/// Surroundings of a plan that is made by hand.
#[derive(Debug)]
pub struct PlanSurroundings {
    /// Devices and station, without visits.
    pub devices: Plan,
    /// Text of the devices' file.
    pub text: String,
    /// The air.
    pub air: Air,
    /// The Earth's orientation.
    pub orientation: EarthOrientation,
    /// Zero of the magnitudes.
    pub zero: ZeroPoint,
    /// The dark hours, each from its beginning to its end.
    pub dark: Vec<(Epoch, Epoch)>,
    /// How long visits take.
    pub options: PlannerOptions,
    /// The plan to be written; the elements go beside it.
    pub path: PathBuf,
    /// The elements' file and its text.
    pub elements: (PathBuf, String),
    /// Whether files that are there already may be replaced.
    pub overwrite: Overwrite,
    /// Name and version of the program.
    pub program: String,
    /// Warnings for the person who plans.
    pub warnings: Vec<String>,
}

/// A night that is planned, as a source of the page.
#[derive(Debug)]
pub struct PlanDesk {
    passes: Vec<PlanPass>,
    around: PlanSurroundings,
    start: Epoch,
    end: Epoch,
    /// Texts that were written last, of the elements and the plan: only files that still have them are our own.
    written: Mutex<Option<[String; 2]>>,
}

/// Something picked, as the page names it.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Picked {
    Pass(usize),
    Star(String),
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Asked {
    picks: Vec<Picked>,
}

#[derive(Serialize)]
struct PassView<'a> {
    label: &'a str,
    from_s: f64,
    to_s: f64,
    from_utc: String,
    v_mag: f64,
    highest_deg: f64,
    at_s: Vec<f64>,
    at_deg: Vec<AzimuthAltitude>,
    lit: Vec<bool>,
    dark: Vec<bool>,
    v_at_mag: Vec<Option<f64>>,
    speed_deg_per_s: Vec<Option<f64>>,
    rates: &'a [PlanRate],
}

#[derive(Serialize)]
struct AboutView<'a> {
    mode: &'static str,
    name: String,
    station: &'a str,
    program: &'a str,
    start_utc: String,
    start_unix_ms: f64,
    length_s: f64,
    passes: Vec<PassView<'a>>,
    warnings: &'a [String],
    devices: [(); 0],
    visits: [(); 0],
}

#[derive(Serialize)]
struct SavedView {
    plan: NightPlan,
    files: Vec<String>,
    check: Preflight,
    errors: usize,
}

impl PlanDesk {
    /// A desk for these passes; `None` where there is no dark hour.
    pub fn new(passes: Vec<PlanPass>, mut around: PlanSurroundings) -> Option<Self> {
        let hour = Duration::from_hours(1.0);
        // The night of the brightest pass; without passes the first.
        let by_light = |a: &&PlanPass, b: &&PlanPass| a.offer.v_mag.total_cmp(&b.offer.v_mag);
        let brightest = passes.iter().min_by(by_light).map(|pass| pass.offer.span.0);
        let holds =
            |night: &&(Epoch, Epoch)| brightest.is_none_or(|at| night.0 <= at && at <= night.1);
        let (from, to) = *around.dark.iter().find(holds).or(around.dark.first())?;
        let in_night = |pass: &PlanPass| pass.offer.span.1 > from && pass.offer.span.0 < to;
        let all = passes.len();
        let passes: Vec<PlanPass> = passes.into_iter().filter(in_night).collect();
        let left_out = all - passes.len();
        if left_out > 0 {
            let text = format!(
                "passes of other nights are not shown: {left_out}; narrow --from and --to for one of them"
            );
            around.warnings.insert(0, text);
        }
        // What is planned belongs to the night that is shown, also where only stars are chosen.
        around.dark = vec![(from, to)];
        let written = Mutex::default();
        Some(Self { passes, around, start: from - hour, end: to + hour, written })
    }

    fn seconds(&self, epoch: Epoch) -> f64 {
        (epoch - self.start).to_seconds()
    }

    fn view<'a>(&self, pass: &'a PlanPass) -> PassView<'a> {
        let PlanPass { offer, track, rates, curves: _ } = pass;
        PassView {
            label: &offer.label,
            from_s: self.seconds(offer.span.0),
            to_s: self.seconds(offer.span.1),
            from_utc: format_utc(offer.span.0, 0),
            v_mag: offer.v_mag,
            highest_deg: offer.highest_deg,
            at_s: track.iter().map(|point| self.seconds(point.at)).collect(),
            at_deg: track.iter().map(|point| point.at_deg).collect(),
            lit: track.iter().map(|point| point.lit).collect(),
            dark: track.iter().map(|point| point.dark).collect(),
            v_at_mag: track.iter().map(|point| point.v_mag).collect(),
            speed_deg_per_s: track.iter().map(|point| point.speed_deg_per_s).collect(),
            rates,
        }
    }

    fn about(&self) -> Answer {
        let name = self.around.path.file_name().unwrap_or_default().to_string_lossy();
        Answer::json(&AboutView {
            mode: "plan",
            name: name.into_owned(),
            station: &self.around.devices.station.name,
            program: &self.around.program,
            start_utc: format_utc(self.start, 3),
            start_unix_ms: unix_ms(self.start),
            length_s: self.seconds(self.end),
            passes: self.passes.iter().map(|pass| self.view(pass)).collect(),
            warnings: &self.around.warnings,
            devices: [],
            visits: [],
        })
    }

    fn sky(&self, request: &Request) -> Result<Answer, Answer> {
        let at_s = request.number("at_s").unwrap_or(0.0).clamp(-1e9, 1e9);
        let utc = self.start + Duration::from_seconds(at_s);
        Sky::at(&self.around.devices.station, self.start, utc, None)
            .map(|sky| Answer::json(&sky))
            .ok_or_else(|| Answer::error(422, "no sky is known for that time"))
    }

    /// The light of a pass along its course.
    fn curves(&self, request: &Request) -> Result<Answer, Answer> {
        let number = request.whole("pass").and_then(|number| usize::try_from(number).ok());
        let found = number.and_then(|number| self.passes.get(number));
        let none = || Answer::error(404, "there is no such pass");
        Ok(Answer::json(&found.ok_or_else(none)?.curves))
    }

    /// The night of the picks; without picks the one that the program would choose.
    fn planned(&self, body: &[u8]) -> Result<NightPlan, Answer> {
        let asked: Asked = serde_json::from_slice(body)
            .map_err(|error| Answer::error(400, &format!("no plan: {error}")))?;
        if asked.picks.len() > MOST {
            let text = format!("a plan has at most {MOST} passes and stars");
            return Err(Answer::error(422, &text));
        }
        let around = &self.around;
        let name = around.elements.0.file_name().unwrap_or_default().to_string_lossy();
        let surroundings = Surroundings {
            devices: &around.devices,
            air: &around.air,
            orientation: &around.orientation,
            zero: around.zero,
            dark: &around.dark,
            elements: &name,
        };
        let offers: Vec<PassOffer> = self.passes.iter().map(|pass| pass.offer.clone()).collect();
        let picks: Vec<Pick> = asked
            .picks
            .into_iter()
            .map(|pick| match pick {
                Picked::Pass(number) => Pick::Pass(number),
                Picked::Star(name) => Pick::Star(name),
            })
            .collect();
        let made = match picks.is_empty() {
            true => plan_night(&offers, surroundings, &around.options),
            false => plan_picks(&picks, &offers, surroundings, &around.options),
        };
        made.map_err(|error| Answer::error(422, &error.to_string()))
    }

    /// Refuses to replace a file that is not as it was written from here.
    fn may_write(&self, path: &Path, ours: Option<&str>) -> Result<(), Answer> {
        let found = match std::fs::read(path) {
            Ok(found) => found,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(()),
            Err(error) => {
                let text = format!("cannot read {}: {error}", path.display());
                return Err(Answer::error(409, &text));
            }
        };
        let path = path.display();
        match ours {
            Some(ours) if found == ours.as_bytes() => Ok(()),
            Some(_) => Err(Answer::error(
                409,
                &format!(
                    "{path} was changed since it was saved here: nothing is written; move it away or give it another name, then save again"
                ),
            )),
            None if self.around.overwrite == Overwrite::Allow => Ok(()),
            None => Err(Answer::error(
                409,
                &format!(
                    "{path} is there already: nothing is written; move it away, or start with --force"
                ),
            )),
        }
    }

    /// Writes the plan and its elements, and checks it as `observe --check` does, without the devices.
    fn save(&self, body: &[u8]) -> Result<Answer, Answer> {
        let plan = self.planned(body)?;
        let (elements, sets) = &self.around.elements;
        let mut written = self.written.lock().unwrap_or_else(PoisonError::into_inner);
        let path = &self.around.path;
        let text = plan.toml(&self.around.text);
        // Both are looked at before one is written.
        for (i, path) in [elements, path].into_iter().enumerate() {
            self.may_write(path, written.as_ref().map(|texts| texts[i].as_str()))?;
        }
        let beside = [(elements.clone(), sets.clone().into_bytes())];
        let read = Plan::of_text(path, &text, &beside)
            .map_err(|error| Answer::error(422, &format!("nothing is written: {error}")))?;
        for (path, text) in [(elements, sets), (path, &text)] {
            write_file(path, text.as_bytes(), Overwrite::Allow)
                .map_err(|error| Answer::error(409, &error.to_string()))?;
        }
        *written = Some([sets.clone(), text]);
        let mut options = PreflightOptions::default();
        options.open_devices = false;
        options.now = options.now.min(read.from);
        let check = preflight(&read, &Catalogue::of(&read), &options);
        let files = [elements, path].map(|path| path.display().to_string()).to_vec();
        let errors = check.of(Level::Error).count();
        Ok(Answer::json(&SavedView { plan, files, check, errors }))
    }
}

impl Source for PlanDesk {
    fn answer(&self, request: &Request) -> Answer {
        let parts = request.parts();
        let answer = match (request.post, parts.as_slice()) {
            (true, ["plan"]) => self.planned(&request.body).map(|plan| Answer::json(&plan)),
            (true, ["save"]) => self.save(&request.body),
            (true, _) => Err(Answer::error(405, "only `plan` and `save` take a POST")),
            (false, ["about"]) => Ok(self.about()),
            (false, ["sky"]) => self.sky(request),
            (false, ["curves"]) => self.curves(request),
            (false, ["tracks"]) => Ok(Answer::json(&[(); 0])),
            _ => Err(Answer::missing()),
        };
        answer.unwrap_or_else(|answer| answer)
    }
}
