//! A run in the lab on the page: readings as they come, the curve as it grows, how long it will take; it can be paused and stopped.

use crate::request::{Answer, Request, Source};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};

/// Places of the curve that are kept; what is older is in the run's folder.
const PLACES: usize = 100_000;
/// Places in one answer at most.
const ANSWER: usize = 5000;
/// Messages that are kept.
const MESSAGES: usize = 200;

/// Reading of the meter at a place.
#[derive(Debug, Clone, PartialEq)]
pub struct LabReading {
    /// The part of the run.
    pub part: String,
    /// Angle of the curve, deg.
    pub angle_deg: f64,
    /// All angles, as a person reads them.
    pub place: String,
    /// Power, W; not a number where there is none.
    pub power_w: f64,
    /// The meter's range.
    pub range: String,
    /// Meaning of the line.
    pub state: LabState,
}

/// Meaning of a line of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LabState {
    /// A reading with a power.
    Read,
    /// A reading over the range.
    Over,
    /// The readings of this place count.
    Kept,
    /// They do not.
    Again,
}

/// Place that was measured.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Place {
    number: u64,
    part: String,
    angle_deg: f64,
    place: String,
    /// Mean power, W; `None` over the range.
    mean_w: Option<f64>,
    /// Standard deviation of the readings over their mean; `None` of fewer than two.
    scatter: Option<f64>,
    readings: usize,
}

#[derive(Debug, Default)]
struct Inner {
    parts: Vec<String>,
    places: VecDeque<Place>,
    last_number: u64,
    /// Readings of the present place, W.
    now: Vec<f64>,
    reading: Option<(String, String, Option<f64>, String)>,
    readings: u64,
    messages: VecDeque<String>,
    paused: bool,
    stopped: bool,
    ended: Option<String>,
    /// Time that the run was at work, without its pauses, s.
    worked: Duration,
    since: Option<Instant>,
}

/// Action that ends a run at once, as Ctrl-C does.
struct Stop(Box<dyn Fn() + Send + Sync>);

impl std::fmt::Debug for Stop {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Stop")
    }
}

/// A run in the lab as a source of the page. Whoever measures tells it of each line, and waits while it is paused.
#[derive(Debug)]
pub struct LabRun {
    /// Number of this start of the program: a page that saw another one begins anew.
    run: u64,
    name: String,
    program: String,
    angle: String,
    places: u64,
    before: u64,
    inner: Mutex<Inner>,
    changed: Condvar,
    stop: OnceLock<Stop>,
}

#[derive(Serialize)]
struct AboutView<'a> {
    mode: &'static str,
    name: &'a str,
    station: &'static str,
    program: &'a str,
    start_unix_ms: f64,
    length_s: Option<f64>,
    /// Name of the curve's angle.
    angle: &'a str,
    warnings: [(); 0],
    devices: [(); 0],
    visits: [(); 0],
}

#[derive(Serialize)]
struct NowView<'a> {
    part: &'a str,
    place: &'a str,
    power_w: Option<f64>,
    range: &'a str,
    /// Readings of this place so far.
    readings: usize,
    scatter: Option<f64>,
}

#[derive(Serialize)]
struct View<'a> {
    run: u64,
    places: Vec<&'a Place>,
    /// Places since that are not kept any more.
    missed: u64,
    /// Number of the last place that is in this answer, or was seen.
    last: u64,
    /// Whether there are more.
    more: bool,
    done: u64,
    of: u64,
    readings: u64,
    now: Option<NowView<'a>>,
    worked_s: f64,
    left_s: Option<f64>,
    paused: bool,
    ended: Option<&'a str>,
    messages: &'a VecDeque<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Asked {
    action: String,
    #[serde(default)]
    text: String,
}

#[derive(Serialize)]
struct Done {
    done: &'static str,
}

/// Mean and relative standard deviation of readings.
fn moments(readings: &[f64]) -> (Option<f64>, Option<f64>) {
    let n = readings.len() as f64;
    let mean = readings.iter().sum::<f64>() / n;
    if readings.is_empty() || !mean.is_finite() {
        return (None, None);
    }
    let square = readings.iter().map(|power| (power - mean).powi(2)).sum::<f64>() / (n - 1.0);
    let scatter = square.sqrt() / mean.abs();
    (Some(mean), (readings.len() > 1 && scatter.is_finite()).then_some(scatter))
}

impl Inner {
    /// Counts no time until it goes on.
    fn rest(&mut self) {
        if let Some(since) = self.since.take() {
            self.worked += since.elapsed();
        }
    }
}

impl LabRun {
    /// A run of so many places, of which some were measured before; `angle` names the curve's axis.
    pub fn new(name: &str, program: &str, angle: &str, places: u64, before: u64) -> Self {
        let inner = Inner { since: Some(Instant::now()), ..Inner::default() };
        let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
        Self {
            run: now.map_or(0, |now| u64::try_from(now.as_micros()).unwrap_or(0)),
            name: name.to_owned(),
            program: program.to_owned(),
            angle: angle.to_owned(),
            places,
            before,
            inner: Mutex::new(inner),
            changed: Condvar::new(),
            stop: OnceLock::new(),
        }
    }

    /// Takes what ends the run at once when somebody stops it on the page, such as a token that is set. The first one holds.
    pub fn on_stop(&self, stop: impl Fn() + Send + Sync + 'static) {
        let _ = self.stop.set(Stop(Box::new(stop)));
    }

    fn inner(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes a line of the run.
    pub fn line(&self, reading: LabReading) {
        let mut inner = self.inner();
        let LabReading { part, angle_deg, place, power_w, range, state } = reading;
        if !inner.parts.contains(&part) {
            inner.parts.push(part.clone());
        }
        match state {
            LabState::Read | LabState::Over => {
                let power = if state == LabState::Over { f64::INFINITY } else { power_w };
                inner.now.push(power);
                inner.readings += 1;
                inner.reading = Some((part, place, power.is_finite().then_some(power), range));
            }
            LabState::Again => inner.now.clear(),
            LabState::Kept => {
                let readings = std::mem::take(&mut inner.now);
                let (mean_w, scatter) = moments(&readings);
                inner.last_number += 1;
                let number = inner.last_number;
                let readings = readings.len();
                let place = Place { number, part, angle_deg, place, mean_w, scatter, readings };
                inner.places.push_back(place);
                if inner.places.len() > PLACES {
                    inner.places.pop_front();
                }
            }
        }
    }

    /// Takes a message.
    pub fn say(&self, text: &str) {
        let mut inner = self.inner();
        inner.messages.push_back(text.to_owned());
        if inner.messages.len() > MESSAGES {
            inner.messages.pop_front();
        }
    }

    /// Waits while the run is paused. Returns true where somebody has stopped it; `is_over` is asked now and then.
    pub fn wait(&self, is_over: impl Fn() -> bool) -> bool {
        let mut inner = self.inner();
        while inner.paused && !inner.stopped && !is_over() {
            let waited = self.changed.wait_timeout(inner, Duration::from_millis(50));
            inner = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
        inner.stopped
    }

    /// Takes how the run ended.
    pub fn end(&self, how: &str) {
        let mut inner = self.inner();
        inner.rest();
        inner.ended = Some(how.to_owned());
    }

    fn view(&self, request: &Request) -> Answer {
        let inner = self.inner();
        let seen = request.whole("seen").filter(|_| request.whole("run") == Some(self.run));
        let seen = seen.unwrap_or(0).min(inner.last_number);
        // The oldest first: a page that was loaded again asks until it has all that is kept.
        let gone = inner.last_number - inner.places.len() as u64;
        let from = seen.max(gone);
        let skip = usize::try_from(from - gone).unwrap_or(usize::MAX);
        let given = inner.places.iter().skip(skip).take(ANSWER);
        let last = given.clone().next_back().map_or(from, |place| place.number);
        let worked = inner.worked + inner.since.map_or(Duration::ZERO, |since| since.elapsed());
        let done = self.before + inner.last_number;
        let left = self.places.saturating_sub(done);
        let each_s = worked.as_secs_f64() / inner.last_number.max(1) as f64;
        let now = inner.reading.as_ref().map(|(part, place, power_w, range)| NowView {
            part,
            place,
            power_w: *power_w,
            range,
            readings: inner.now.len(),
            scatter: moments(&inner.now).1,
        });
        Answer::json(&View {
            run: self.run,
            places: given.collect(),
            missed: from - seen,
            last,
            more: last < inner.last_number,
            done,
            of: self.places,
            readings: inner.readings,
            now,
            worked_s: worked.as_secs_f64(),
            left_s: (inner.last_number > 0).then_some(each_s * left as f64),
            paused: inner.paused,
            ended: inner.ended.as_deref(),
            messages: &inner.messages,
        })
    }

    fn control(&self, request: &Request) -> Result<Answer, Answer> {
        let asked: Asked = serde_json::from_slice(&request.body)
            .map_err(|error| Answer::error(400, &format!("no command: {error}")))?;
        let mut inner = self.inner();
        if inner.ended.is_some() {
            return Err(Answer::error(409, "the run has ended"));
        }
        let _ = asked.text;
        let done = match (asked.action.as_str(), inner.paused) {
            ("pause", false) => {
                inner.paused = true;
                inner.rest();
                "paused before the next place"
            }
            ("resume", true) => {
                inner.paused = false;
                inner.since = Some(Instant::now());
                "the run goes on"
            }
            ("pause", true) => return Err(Answer::error(409, "it is paused already")),
            ("resume", false) => return Err(Answer::error(409, "it is not paused")),
            ("stop", _) => {
                inner.stopped = true;
                "the run stops: go on with it by --resume"
            }
            _ => return Err(Answer::error(400, "expected the action pause, resume or stop")),
        };
        let stopped = inner.stopped;
        drop(inner);
        self.changed.notify_all();
        if stopped && let Some(stop) = self.stop.get() {
            (stop.0)();
        }
        Ok(Answer::json(&Done { done }))
    }
}

impl Source for LabRun {
    fn answer(&self, request: &Request) -> Answer {
        let parts = request.parts();
        let answer = match (request.post, parts.as_slice()) {
            (true, ["control"]) => self.control(request),
            (true, _) => Err(Answer::error(405, "only `control` takes a POST")),
            (false, ["about"]) => Ok(Answer::json(&AboutView {
                mode: "lab",
                name: &self.name,
                station: "",
                program: &self.program,
                start_unix_ms: 0.0,
                length_s: None,
                angle: &self.angle,
                warnings: [],
                devices: [],
                visits: [],
            })),
            (false, ["lab"]) => Ok(self.view(request)),
            (false, ["tracks"]) => Ok(Answer::json(&[(); 0])),
            _ => Err(Answer::missing()),
        };
        answer.unwrap_or_else(|answer| answer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reading(angle_deg: f64, power_w: f64, state: LabState) -> LabReading {
        let (part, place) = ("sample".to_owned(), format!("{angle_deg}°"));
        LabReading { part, angle_deg, place, power_w, range: "auto".into(), state }
    }

    fn asked(
        run: &LabRun,
        post: bool,
        path: &str,
        query: &str,
        body: &str,
    ) -> (u16, serde_json::Value) {
        let request = Request::new(post, path, query, body.as_bytes().to_vec()).unwrap();
        let answer = run.answer(&request);
        (answer.status, serde_json::from_slice(&answer.body).unwrap())
    }

    /// Truth: by hand: readings 1, 2 and 3 W have the mean 2 W and a standard deviation of 1 W; those before `again` do not count, and one over the range leaves no mean.
    #[test]
    fn readings_become_places() {
        let run = LabRun::new("run", "a test", "angle", 4, 1);
        for power in [9.0, 9.0] {
            run.line(reading(5.0, power, LabState::Read));
        }
        run.line(reading(5.0, f64::NAN, LabState::Again));
        for power in [1.0, 2.0, 3.0] {
            run.line(reading(5.0, power, LabState::Read));
        }
        run.line(reading(5.0, f64::NAN, LabState::Kept));
        run.line(reading(6.0, f64::NAN, LabState::Over));
        run.line(reading(6.0, f64::NAN, LabState::Kept));
        let (status, view) = asked(&run, false, "lab", "", "");
        assert_eq!(status, 200);
        let place = &view["places"][0];
        assert_eq!(
            (&place["mean_w"], &place["scatter"], &place["readings"]),
            (&2.0.into(), &0.5.into(), &3.into())
        );
        assert!(view["places"][1]["mean_w"].is_null());
        assert_eq!(
            (&view["done"], &view["of"], &view["missed"]),
            (&3.into(), &4.into(), &0.into())
        );
        assert_eq!(
            asked(&run, false, "lab", &format!("seen=1&run={}", run.run), "").1["places"]
                .as_array()
                .unwrap()
                .len(),
            1
        );
        // More than one answer holds: all come, the oldest first.
        for number in 2..12_002 {
            run.line(reading(f64::from(number), 1.0, LabState::Read));
            run.line(reading(f64::from(number), f64::NAN, LabState::Kept));
        }
        let (mut seen, mut found) = (0, 0);
        for more in [true, true, false] {
            let query = format!("seen={seen}&run={}", run.run);
            let (_, view) = asked(&run, false, "lab", &query, "");
            assert_eq!((&view["more"], &view["missed"]), (&more.into(), &0.into()));
            (seen, found) =
                (view["last"].as_u64().unwrap(), found + view["places"].as_array().unwrap().len());
        }
        assert_eq!((seen, found), (12_002, 12_002));
        // Whoever saw another run has seen nothing of this one, however many places that had.
        for query in ["seen=12000", "seen=12000&run=1"] {
            let view = asked(&run, false, "lab", query, "").1;
            assert_eq!((&view["places"][0]["number"], &view["missed"]), (&1.into(), &0.into()));
        }
    }

    /// Truth: by hand: a paused run waits until it is resumed or stopped, or is over by itself.
    #[test]
    fn a_paused_run_waits() {
        let run = std::sync::Arc::new(LabRun::new("run", "a test", "angle", 4, 0));
        assert!(!run.wait(|| false));
        let post = |action: &str| {
            asked(&run, true, "control", "", &format!("{{\"action\": \"{action}\"}}")).0
        };
        assert_eq!(
            (post("resume"), post("pause"), post("pause"), post("jump")),
            (409, 200, 409, 400)
        );
        assert!(!run.wait(|| true));
        let other = run.clone();
        let waiting = std::thread::spawn(move || other.wait(|| false));
        assert_eq!(post("resume"), 200);
        assert!(!waiting.join().unwrap());
        assert_eq!((post("pause"), post("stop")), (200, 200));
        assert!(run.wait(|| false));
        run.end("stopped");
        assert_eq!(post("pause"), 409);
        assert_eq!(asked(&run, false, "lab", "", "").1["ended"], "stopped");
    }
}
