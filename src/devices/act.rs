//! `sunglint devices set` and `move`: what changes a device.

use super::Outcome;
use super::check::setting_json;
use super::session::{Desk, Session, TalkArgs, Waiting, advised};
use crate::output::{Console, OutputArgs, Usage};
use clap::Args;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::time::Duration;
use sunglint_drivers::catalogue::{AnyDevice, Kind};
use sunglint_drivers::device::Interrupted;
use sunglint_formats::{Column, Table};
use sunglint_report::Product;

/// How long a setting and a move usually take at most.
const SET: Duration = Duration::from_secs(60);
const MOVE: Duration = Duration::from_secs(300);

/// Arguments of `sunglint devices set`.
#[derive(Debug, Args)]
pub struct SetArgs {
    /// The device.
    #[command(flatten)]
    pub talk: TalkArgs,
    /// What to set, in this order, such as wavelength_nm=532; without any, what can be set is listed
    #[arg(value_name = "NAME=VALUE")]
    pub settings: Vec<String>,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// Arguments of `sunglint devices move`.
#[derive(Debug, Args)]
pub struct MoveArgs {
    /// The device.
    #[command(flatten)]
    pub talk: TalkArgs,
    /// Where to, one after the other: angles in degrees (or home, stop) for a stage, slots from 1 for a wheel
    #[arg(value_name = "TARGET", required = true, allow_negative_numbers = true)]
    pub targets: Vec<String>,
    /// Where the result goes.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// Sets, reads back, and says what the device then has.
pub(super) fn set(args: &SetArgs, desk: &Desk) -> anyhow::Result<Outcome> {
    let mut pairs = Vec::new();
    for text in &args.settings {
        let pair = text.split_once('=').map(|(name, value)| (name.trim(), value.trim()));
        let wrong = || Usage(format!("found `{text}`, expected NAME=VALUE"));
        pairs.push(pair.ok_or_else(wrong)?);
    }
    let mut words = args.talk.words("set");
    words.extend(args.settings.iter().cloned());
    let (session, mut device, identity) = Session::start(desk, &args.talk, &words, args.out.force)?;
    let mut text = session.title(&identity) + "\n";
    let (mut done, mut error) = (Vec::new(), None);
    for (name, asked) in pairs {
        match device.set(name, asked, &session.within(SET)) {
            Ok(value) => {
                let _ = writeln!(text, "  {name:<24} {value}");
                done.push((name.to_owned(), asked.to_owned(), value));
            }
            Err(failed) => {
                error = Some(advised(failed));
                break;
            }
        }
    }
    let settable = device.settable();
    if args.settings.is_empty() {
        for (name, takes) in &settable {
            let _ = writeln!(text, "  {name:<24} {takes}");
        }
        if settable.is_empty() {
            let _ = writeln!(text, "  it has no settings to change");
        }
    }
    if done.is_empty()
        && let Some(error) = error
    {
        return Err(error);
    }
    let mut json = session.document(Some(&identity));
    let set = done.iter().map(|(name, asked, value)| {
        json!({ "name": name, "asked": asked, "value": setting_json(value) })
    });
    json.insert("settings".into(), set.collect());
    let takes = settable.iter().map(|(name, takes)| json!({ "name": name, "takes": takes }));
    json.insert("settable".into(), takes.collect());
    let columns = vec![
        Column::text("name", done.iter().map(|(name, ..)| name.clone()).collect()),
        Column::text("asked", done.iter().map(|(_, asked, _)| asked.clone()).collect()),
        Column::text("value", done.iter().map(|(.., value)| value.to_string()).collect()),
    ];
    Ok(outcome("settings", columns, json, text, error))
}

/// Where a move goes.
enum Target {
    Angle(f64),
    Home,
    Stop,
    Slot(u32),
}

impl Target {
    fn parse(text: &str, kind: Kind) -> anyhow::Result<Self> {
        let expected = match (kind, text) {
            (Kind::RotationStage, "home") => return Ok(Self::Home),
            (Kind::RotationStage, "stop") => return Ok(Self::Stop),
            (Kind::RotationStage, text) => match text.parse() {
                Ok(angle) if f64::is_finite(angle) => return Ok(Self::Angle(angle)),
                _ => "an angle in degrees, `home` or `stop`",
            },
            (Kind::FilterWheel, text) => match text.parse() {
                Ok(slot) if slot > 0 => return Ok(Self::Slot(slot)),
                _ => "a slot, counted from 1",
            },
            (kind, _) => anyhow::bail!("a {kind} does not move; stages and filter wheels do"),
        };
        anyhow::bail!("target: found `{text}`, expected {expected}")
    }
}

/// Where a device stands.
#[derive(Clone, Copy)]
enum Place {
    Angle(f64),
    Slot(u32),
    Unknown,
}

impl Place {
    fn text(self) -> String {
        match self {
            Self::Angle(deg) => format!("{deg:.4} deg"),
            Self::Slot(slot) => format!("slot {slot}"),
            Self::Unknown => "unknown".into(),
        }
    }

    fn angle_deg(self) -> Option<f64> {
        if let Self::Angle(deg) = self { Some(deg) } else { None }
    }

    fn slot(self) -> Option<u32> {
        if let Self::Slot(slot) = self { Some(slot) } else { None }
    }
}

/// Goes there, one target after the other; a failure or Ctrl-C stops the motor, and what was reached is said.
pub(super) fn move_to(args: &MoveArgs, desk: &Desk, console: Console) -> anyhow::Result<Outcome> {
    let mut words = args.talk.words("move");
    words.extend(args.targets.iter().cloned());
    // Nothing is said to a device that cannot go there.
    let kind = sunglint_drivers::catalogue::Address::parse(&args.talk.address, &args.talk.options)?;
    let kind = kind.driver.kind;
    let targets: Vec<Target> =
        args.targets.iter().map(|text| Target::parse(text, kind)).collect::<anyhow::Result<_>>()?;
    let (session, mut device, identity) = Session::start(desk, &args.talk, &words, args.out.force)?;
    let mut text = session.title(&identity) + "\n";
    let (mut moves, mut at, mut error) = (Vec::new(), Place::Unknown, None);
    for (name, target) in args.targets.iter().zip(&targets) {
        let start = session.now();
        let waiting = Waiting::for_what(format!("moving to {name}"), desk, console);
        let gone = go(&mut device, target, &session);
        drop(waiting);
        let took_s = session.now().saturating_sub(start).as_secs_f64();
        match gone {
            Ok(place) => {
                at = place;
                let _ = writeln!(text, "  {name:<8} -> {} after {took_s:.1} s", place.text());
                moves.push((name, place, took_s));
            }
            Err((place, failed)) => {
                // Some errors do not say it; whoever pressed Ctrl-C wants to know all the same.
                at = if let Place::Unknown = place { stands(&mut device, &session) } else { place };
                let place = at;
                let _ = writeln!(text, "  {name:<8} -> not reached; it stands at {}", place.text());
                let message = format!("{failed}; it stands at {}", place.text());
                error = Some(failed.context(message));
                break;
            }
        }
    }
    let mut json = session.document(Some(&identity));
    let reached = moves.iter().map(|(name, place, took_s)| {
        json!({ "target": name, "angle_deg": place.angle_deg(), "slot": place.slot(), "took_s": took_s })
    });
    json.insert("moves".into(), reached.collect());
    json.insert("at".into(), json!({ "angle_deg": at.angle_deg(), "slot": at.slot() }));
    let number = |of: fn(&(&String, Place, f64)) -> f64| moves.iter().map(of).collect();
    let columns = vec![
        Column::text("target", moves.iter().map(|(name, ..)| (*name).clone()).collect()),
        Column::f64(
            "angle_deg",
            Some("deg"),
            number(|(_, at, _)| at.angle_deg().unwrap_or(f64::NAN)),
        ),
        Column::f64("slot", None, number(|(_, at, _)| at.slot().map_or(f64::NAN, f64::from))),
        Column::f64("took_s", Some("s"), number(|(.., took_s)| *took_s)),
    ];
    Ok(outcome("moves", columns, json, text, error))
}

/// Where it stands, if it can still be asked.
fn stands(device: &mut AnyDevice, session: &Session) -> Place {
    let grace = session.grace();
    match device {
        AnyDevice::RotationStage(stage) => stage.angle_deg(&grace).map(Place::Angle),
        AnyDevice::FilterWheel(wheel) => wheel.slot(&grace).map(Place::Slot),
        _ => return Place::Unknown,
    }
    .unwrap_or(Place::Unknown)
}

/// Goes there; on failure, where it stands.
fn go(
    device: &mut AnyDevice,
    target: &Target,
    session: &Session,
) -> Result<Place, (Place, anyhow::Error)> {
    let deadline = session.within(MOVE);
    let angle = |failed: Interrupted<Option<f64>>| {
        (failed.done.map_or(Place::Unknown, Place::Angle), advised(*failed.error))
    };
    match (device, target) {
        (AnyDevice::RotationStage(stage), Target::Angle(deg)) => {
            stage.move_to(*deg, &deadline).map(Place::Angle).map_err(angle)
        }
        (AnyDevice::RotationStage(stage), Target::Home) => {
            stage.home(&deadline).map(Place::Angle).map_err(angle)
        }
        (AnyDevice::RotationStage(stage), Target::Stop) => {
            stage.stop(&deadline).map_err(|error| (Place::Unknown, advised(error)))?;
            // A stage that was never homed stands too, somewhere.
            Ok(stage.angle_deg(&session.soon()).map_or(Place::Unknown, Place::Angle))
        }
        (AnyDevice::FilterWheel(wheel), Target::Slot(slot)) => {
            wheel.select(*slot, &deadline).map(Place::Slot).map_err(|failed| {
                (failed.done.map_or(Place::Unknown, Place::Slot), advised(*failed.error))
            })
        }
        (device, _) => {
            Err((Place::Unknown, anyhow::anyhow!("a {} does not go there", device.kind())))
        }
    }
}

fn outcome(
    name: &str,
    columns: Vec<Column>,
    mut json: serde_json::Map<String, Value>,
    text: String,
    error: Option<anyhow::Error>,
) -> Outcome {
    json.insert("complete".into(), json!(error.is_none()));
    json.insert("error".into(), json!(error.as_ref().map(ToString::to_string)));
    let table = Table { columns, ..Table::default() };
    let json = Value::Object(json);
    let product = Product { name: name.into(), table, json, ..Product::default() };
    Outcome { product, text, error }
}
