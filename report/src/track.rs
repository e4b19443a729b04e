//! A telescope that follows: its plan, its lines while it does, its result.

use crate::Product;
use serde::Serialize;
use std::fmt::Write as _;
use sunglint_formats::{Column, Table};
use sunglint_numerics::axes::Axes;
use sunglint_numerics::measured::{Interval, pair};
use sunglint_observatory::telescope::{PassPlan, TrackState, TrackStep, TrackSummary};

/// Result of following one target.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct TrackReport {
    /// The plan.
    pub plan: PassPlan,
    /// Mount that was used.
    pub mount: String,
    /// How it went; nothing of a plan alone.
    pub went: Option<TrackSummary>,
    /// Spans in which a German mount was turned over: when it left the target and when it had it again, seconds of the path.
    #[serde(with = "pair")]
    pub turned_s: Vec<Interval>,
    /// Root mean square distance of the mount from where the target was believed to be, arcsec, from 5 s after the begin on, without the turns.
    pub rms_error_arcsec: Option<f64>,
    /// Root mean square distance of the target from the telescope's axis, arcsec, from 5 s after the lock on, without the turns: a virtual telescope knows it.
    pub true_rms_arcsec: Option<f64>,
    /// Why it ended before the target had passed.
    pub ended: Option<String>,
}

impl TrackReport {
    /// A plan alone.
    pub fn planned(plan: PassPlan, mount: String) -> Self {
        let (went, ended, turned_s) = (None, None, Vec::new());
        Self { plan, mount, went, turned_s, rms_error_arcsec: None, true_rms_arcsec: None, ended }
    }

    /// Takes over how it went.
    pub fn went(&mut self, summary: TrackSummary, steps: &[TrackStep]) {
        self.turned_s = turned_s(steps, summary.began_s);
        let late = |step: &&TrackStep| {
            !matches!(step.state, TrackState::Slewing | TrackState::Waiting)
                && step.time_s > summary.began_s + 5.0
                && !is_within(&self.turned_s, step.time_s)
        };
        let squares: Vec<f64> =
            steps.iter().filter(late).map(|step| step.error_arcsec.powi(2)).collect();
        if !squares.is_empty() {
            let mean = squares.iter().sum::<f64>() / squares.len() as f64;
            self.rms_error_arcsec = Some(mean.sqrt());
        }
        self.went = Some(summary);
    }

    /// Takes over what a virtual telescope knows: distances of the target from its axis, as seconds of the path and arcsec.
    pub fn knows(&mut self, steps: &[TrackStep], truth: &[[f64; 2]]) {
        let Some((summary, locked_s)) =
            self.went.as_ref().and_then(|went| Some((went, went.locked_s?)))
        else {
            return;
        };
        let turned_s = turned_s(steps, summary.began_s);
        let late = |row: &&[f64; 2]| row[0] > locked_s + 5.0 && !is_within(&turned_s, row[0]);
        let squares: Vec<f64> = truth.iter().filter(late).map(|row| row[1].powi(2)).collect();
        if !squares.is_empty() {
            self.true_rms_arcsec =
                Some((squares.iter().sum::<f64>() / squares.len() as f64).sqrt());
        }
    }

    /// The result in all its forms.
    ///
    /// # Errors
    /// It cannot be written as JSON.
    pub fn product(&self, steps: &[TrackStep]) -> Result<Product, serde_json::Error> {
        let number = |of: fn(&TrackStep) -> f64| steps.iter().map(of).collect::<Vec<f64>>();
        let mut columns = Vec::new();
        if !steps.is_empty() {
            let mut add = |name: &str, unit: &str, of: fn(&TrackStep) -> f64| {
                columns.push(Column::f64(name, Some(unit), number(of)));
            };
            add("time_s", "s", |step| step.time_s);
            add("target_first_deg", "deg", |step| step.target_deg[0]);
            add("target_second_deg", "deg", |step| step.target_deg[1]);
            add("mount_first_deg", "deg", |step| step.mount_deg[0]);
            add("mount_second_deg", "deg", |step| step.mount_deg[1]);
            add("commanded_first_deg_s", "deg / s", |step| step.commanded_deg_s[0]);
            add("commanded_second_deg_s", "deg / s", |step| step.commanded_deg_s[1]);
            add("error_arcsec", "arcsec", |step| step.error_arcsec);
            add("ahead_s", "s", |step| step.ahead_s);
            add("left_arcsec", "arcsec", |step| step.left_arcsec);
            add("sun_deg", "deg", |step| step.sun_deg);
            add("altitude_deg", "deg", |step| step.altitude_deg);
            let states = steps.iter().map(|step| state(step.state).to_owned()).collect();
            columns.push(Column::text("state", states));
        }
        Ok(Product {
            name: "track".into(),
            table: Table { columns, ..Table::default() },
            json: serde_json::to_value(self)?,
            ..Product::default()
        })
    }

    /// The result as text.
    pub fn text(&self) -> String {
        let mut text = plan_text(&self.plan, &self.mount);
        if let Some(went) = &self.went {
            let _ =
                writeln!(text, "followed from {:.1} s on, {} commands", went.began_s, went.steps);
            if let Some(locked_s) = went.locked_s {
                let _ =
                    writeln!(text, "target found at {locked_s:.1} s, seen in {} frames", went.seen);
            }
        }
        for turn in &self.turned_s {
            let (from_s, lost_s) = (turn.low, turn.width());
            let _ = writeln!(
                text,
                "turned over at {from_s:.0} s, on the target again after {lost_s:.0} s"
            );
        }
        if let Some(rms) = self.rms_error_arcsec {
            let _ = writeln!(
                text,
                "mount against where the target was believed to be: {rms:.1} arcsec rms"
            );
        }
        if let Some(rms) = self.true_rms_arcsec {
            let _ = writeln!(
                text,
                "target against the telescope's axis (truth of the virtual telescope): {rms:.2} arcsec rms"
            );
        }
        if let Some(ended) = &self.ended {
            let _ = writeln!(text, "ended early: {ended}");
        }
        text
    }
}

/// A target that is nearer than this is had again, arcsec.
const HAD_ARCSEC: f64 = 30.0;

/// Spans in which a mount that follows since `began_s` was turned over: until the target is locked again, or the mount is on the prediction.
pub fn turned_s(steps: &[TrackStep], began_s: f64) -> Vec<Interval> {
    let mut turns: Vec<Interval> = Vec::new();
    let mut is_open = false;
    for step in steps.iter().filter(|step| step.time_s >= began_s) {
        let has = matches!(step.state, TrackState::Locked | TrackState::Predicted)
            && step.error_arcsec < HAD_ARCSEC;
        if step.state == TrackState::Slewing && !is_open {
            turns.push(Interval::new(step.time_s, step.time_s));
            is_open = true;
        }
        if let (true, Some(turn)) = (is_open, turns.last_mut()) {
            turn.high = step.time_s;
            is_open = !has;
        }
    }
    turns
}

/// Whether a time lies within a span.
pub fn is_within(spans_s: &[Interval], time_s: f64) -> bool {
    spans_s.iter().any(|span| span.contains(time_s))
}

fn state(state: TrackState) -> &'static str {
    match state {
        TrackState::Slewing => "slewing",
        TrackState::Waiting => "waiting",
        TrackState::Predicted => "predicted",
        TrackState::Searching => "searching",
        TrackState::Locked => "locked",
        TrackState::Coasting => "coasting",
    }
}

/// A plan as text.
pub fn plan_text(plan: &PassPlan, mount: &str) -> String {
    let names = match plan.axes {
        "horizontal" => ["azimuth", "altitude"],
        _ => ["hour angle", "declination"],
    };
    let mut text = format!("{} with {mount}\n", plan.target);
    let pair =
        |angle: Axes| format!("{} {:.2}°, {} {:+.2}°", names[0], angle[0], names[1], angle[1]);
    let _ = writeln!(text, "  from {}  {}", plan.from_utc, pair(plan.begin_deg));
    let _ = writeln!(text, "  to   {}  {}", plan.to_utc, pair(plan.end_deg));
    let _ = writeln!(text, "  highest {:.1}°", plan.highest_deg);
    let [first, second] = plan.fastest_deg_s.to_array();
    let _ = write!(text, "  fastest {} {first:.3} °/s, {} {second:.3} °/s", names[0], names[1]);
    match plan.mount_deg_s {
        Some(Axes { first: a, second: b }) => {
            let _ = writeln!(text, "; the mount does {a:.2} and {b:.2} °/s");
        }
        None => text.push_str("; the mount takes no rates: it cannot follow\n"),
    }
    if let Some(ripple) = plan.ripple_arcsec {
        let _ = writeln!(
            text,
            "  the mount takes a few rates only: up to {ripple:.0} arcsec beside the target on each axis"
        );
    }
    if let Some(Axes { first: a, second: b }) = plan.slew_deg {
        let over = if plan.detour { ", over another place to keep off the Sun" } else { "" };
        let _ = writeln!(text, "  slew by {} {a:.1}°, {} {b:.1}°{over}", names[0], names[1]);
    }
    if plan.axes == "equatorial" {
        match plan.meridian_s.as_slice() {
            [] => text.push_str("  does not cross the meridian: no flip\n"),
            times => {
                let times: Vec<String> = times.iter().map(|s| format!("{s:.0} s")).collect();
                let at: Vec<String> = plan.turns_s.iter().map(|s| format!("{s:.0} s")).collect();
                let what = match (plan.turns_over, at.as_slice()) {
                    (false, _) => "the mount says nothing of its pier side".to_owned(),
                    (true, []) => "the mount can stay on its side of the pier".to_owned(),
                    (true, at) => format!("the mount turns over at {}", at.join(", ")),
                };
                let _ = writeln!(text, "  crosses the meridian at {}: {what}", times.join(", "));
            }
        }
    }
    match &plan.keyhole {
        Some(keyhole) => {
            let _ = writeln!(
                text,
                "  keyhole: {} would need {:.1} °/s; the mount runs ahead from {:.1} s and meets the target at {:.1} s ({:.1} s lost)",
                names[0],
                keyhole.asked_deg_s,
                keyhole.from_s,
                keyhole.to_s,
                keyhole.lost_s()
            );
        }
        None => text.push_str("  no keyhole\n"),
    }
    let holds = if plan.sun_cone_holds { "up: its cone holds" } else { "down: its cone is off" };
    let _ = writeln!(
        text,
        "  Sun: never nearer than {:.1}°, at {:.1}° altitude when it begins ({holds})",
        plan.sun_deg, plan.sun_altitude_deg
    );
    if let Some(why) = &plan.refused {
        let _ = writeln!(text, "  REFUSED: {why}");
    }
    text
}

/// A step as a line.
pub fn step_text(step: &TrackStep) -> String {
    let mut text = format!(
        "{:8.1} s  {:9}  target {:9.4}° {:+9.4}°  mount {:9.4}° {:+9.4}°  rates {:+8.4} {:+8.4} °/s  error {:8.1}″",
        step.time_s,
        state(step.state),
        step.target_deg[0],
        step.target_deg[1],
        step.mount_deg[0],
        step.mount_deg[1],
        step.commanded_deg_s[0],
        step.commanded_deg_s[1],
        step.error_arcsec,
    );
    if step.ahead_s != 0.0 || step.left_arcsec != 0.0 {
        let _ = write!(text, "  ahead {:+.3} s, left {:+.1}″", step.ahead_s, step.left_arcsec);
    }
    text
}
