//! `sunglint devices check`: a self-test that moves and changes nothing.

use super::Outcome;
use super::read::one;
use super::session::{Desk, Session, TalkArgs, advised};
use crate::output::OutputArgs;
use clap::Args;
use serde_json::{Value, json};
use std::fmt::Write as _;
use sunglint_drivers::catalogue::Kind;
use sunglint_drivers::device::{DeviceError, Identity, Origin, Setting, Value as SettingValue};
use sunglint_formats::{Column, Table};
use sunglint_report::Product;

/// Arguments of `sunglint devices check`.
#[derive(Debug, Args)]
pub struct CheckArgs {
    /// The device.
    #[command(flatten)]
    pub talk: TalkArgs,
    /// Exposure of a camera's frame, s
    #[arg(long, value_name = "S", default_value_t = 0.1)]
    pub exposure_s: f64,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// One step with its verdict: `ok`, `note` (it is as it may be, and worth knowing), `failed`.
struct Step {
    step: &'static str,
    verdict: &'static str,
    detail: String,
}

/// What was found.
#[derive(Default)]
struct Report {
    steps: Vec<Step>,
    identity: Option<Identity>,
    settings: Vec<Setting>,
    error: Option<anyhow::Error>,
}

impl Report {
    fn say(&mut self, step: &'static str, verdict: &'static str, detail: impl Into<String>) {
        self.steps.push(Step { step, verdict, detail: detail.into() });
    }

    /// Notes what a step gave; a failure ends the test.
    fn take<V>(&mut self, step: &'static str, result: anyhow::Result<V>) -> Option<V> {
        match result {
            Ok(value) => Some(value),
            Err(error) => {
                self.say(step, "failed", error.to_string());
                self.error = Some(error);
                None
            }
        }
    }
}

pub(super) fn speak(args: &CheckArgs, desk: &Desk) -> anyhow::Result<Outcome> {
    let exposure = super::session::seconds("--exposure-s", args.exposure_s)?;
    let mut words = args.talk.words("check");
    words.extend(["--exposure-s".to_owned(), args.exposure_s.to_string()]);
    let mut session = Session::connect(desk, &args.talk, &words, args.out.force)?;
    let mut report = Report::default();
    run(&mut session, exposure.as_secs_f64(), &mut report);
    let mut text = format!("{} ({})\n", session.address, session.address.driver.title);
    for Step { step, verdict, detail } in &report.steps {
        let _ = writeln!(text, "  {verdict:<7} {step:<9} {detail}");
    }
    for setting in &report.settings {
        let origin = match setting.origin {
            Origin::ReadBack => "read back",
            Origin::Configured => "as told",
        };
        let _ = writeln!(text, "          {:<24} {} ({origin})", setting.name, setting.value);
    }
    Ok(Outcome { product: product(&session, &report), text, error: report.error })
}

/// The steps, until one fails.
fn run(session: &mut Session, exposure_s: f64, report: &mut Report) -> Option<()> {
    let opened = session.open();
    let mut device = report.take("open", opened)?;
    report.say("open", "ok", format!("it answers as a {}", device.kind()));
    let identity = device.device().identity(&session.soon()).map_err(advised);
    let identity = report.take("identity", identity)?;
    report.say("identity", "ok", session.title(&identity));
    report.identity = Some(identity);
    let settings = device.device().settings(&session.soon()).map_err(advised);
    let settings = report.take("settings", settings)?;
    report.say("settings", "ok", format!("{} read", settings.len()));
    report.settings = settings;
    match one(session, &mut device, exposure_s) {
        // A stage that does not know its angle yet is in order.
        Err(error) if device.kind() == Kind::RotationStage && is_not_ready(&error) => {
            report.say("reading", "note", error.to_string());
        }
        reading => {
            let reading = report.take("reading", reading)?;
            report.say("reading", if reading.is_over() { "note" } else { "ok" }, reading.text());
        }
    }
    Some(())
}

fn is_not_ready(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| {
        matches!(cause.downcast_ref::<DeviceError>(), Some(DeviceError::NotReady { .. }))
    })
}

/// A setting's value for a document.
pub(super) fn setting_json(value: &SettingValue) -> Value {
    match value {
        SettingValue::Number(number) => json!(number),
        SettingValue::Integer(number) => json!(number),
        SettingValue::Flag(flag) => json!(flag),
        other => json!(other.to_string()),
    }
}

fn product(session: &Session, report: &Report) -> Product {
    let steps = &report.steps;
    let column = |name, of: fn(&Step) -> &str| {
        Column::text(name, steps.iter().map(|step| of(step).to_owned()).collect())
    };
    let columns = vec![
        column("step", |step| step.step),
        column("verdict", |step| step.verdict),
        column("detail", |step| &step.detail),
    ];
    let mut json = session.document(report.identity.as_ref());
    let settings = report.settings.iter().map(|setting| {
        let origin = match setting.origin {
            Origin::ReadBack => "read_back",
            Origin::Configured => "configured",
        };
        json!({ "name": setting.name, "value": setting_json(&setting.value), "origin": origin })
    });
    json.insert("settings".into(), settings.collect());
    let steps = steps.iter().map(|Step { step, verdict, detail }| {
        json!({ "step": step, "verdict": verdict, "detail": detail })
    });
    json.insert("steps".into(), steps.collect());
    json.insert("error".into(), json!(report.error.as_ref().map(ToString::to_string)));
    let table = Table { columns, ..Table::default() };
    Product { name: "check".into(), table, json: Value::Object(json), ..Product::default() }
}
