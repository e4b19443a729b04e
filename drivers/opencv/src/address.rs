//! The grabber behind an address of the catalogue: `opencv:/dev/video0`, `opencv:night.avi`, `opencv:night_%05d.png`.

use crate::error::wrong;
use crate::gamma::Gamma;
use crate::grabber::{Automatic, Doubled, Grabber, GrabberSettings, Lossy, Said, Source};
use crate::interlace::Field;
use crate::live::{ExposureControl, Format, Live, Place};
use crate::picture::Plane;
use std::path::PathBuf;
use sunglint_drivers::catalogue::{Address, opencv};
use sunglint_drivers::clock::Deadline;
use sunglint_drivers::device::{Camera, DeviceError};
use sunglint_formats::Bayer;
use sunglint_formats::time::parse_utc;

/// Gives the catalogue's driver `opencv` to this program.
pub fn provide() {
    opencv::provide(open);
}

/// Opens the camera that an address names. A recording gives its frames whatever exposure it is asked for: each says its own.
///
/// # Errors
/// Options that do not go together; the errors of [`Grabber::open`].
pub fn open(address: &Address, deadline: &Deadline) -> Result<Box<dyn Camera>, DeviceError> {
    let settings = GrabberSettings {
        plane: match address.text("plane") {
            Some("blue") => Plane::Blue,
            Some("green") => Plane::Green,
            Some("red") => Plane::Red,
            _ => Plane::Same,
        },
        bayer: address.text("bayer").and_then(Bayer::from_name),
        lossy: if address.flag("lossy") { Lossy::Flag } else { Lossy::Refuse },
        fields: match address.text("fields") {
            Some("top") => Some(Field::Top),
            Some("bottom") => Some(Field::Bottom),
            _ => None,
        },
        gamma: address.number("gamma").map(Gamma::new).transpose()?,
        doubled: match address.text("doubled") {
            Some("keep") => Doubled::Flag,
            _ => Doubled::LeaveOut,
        },
        automatic: if address.flag("auto") { Automatic::Flag } else { Automatic::Refuse },
        any_exposure: true,
        ..GrabberSettings::default()
    };
    let source = source(address, settings.bayer)?;
    Ok(Box::new(Grabber::open(source, settings, deadline)?))
}

/// The options of live devices, and those of recordings.
const LIVE: [&str; 6] = ["format", "columns", "rows", "rate_hz", "fixed_exposure_s", "auto"];
const RECORDED: [&str; 3] = ["first_utc", "exposure_s", "interval_s"];

fn source(address: &Address, bayer: Option<Bayer>) -> Result<Source, DeviceError> {
    let place = address.place.clone().unwrap_or_default();
    let (other, what) = match address.is_recording() {
        true => (&LIVE[..], "a live grabber"),
        false => (&RECORDED[..], "a recording"),
    };
    let given = address.given_options();
    let is = |option: &String| other.iter().any(|name| option.split('=').next() == Some(name));
    if let Some(option) = given.iter().find(|option| is(option)) {
        return Err(wrong(format!("{address}: {option} is an option of {what}")));
    }
    if address.is_recording() {
        let images = place.contains('%');
        let path = PathBuf::from(place);
        let first = address.text("first_utc").and_then(|text| parse_utc(text).ok());
        return Ok(match (first, address.number("exposure_s")) {
            (Some(first_start), Some(exposure_s)) => {
                let interval_s = address.number("interval_s");
                let said = Said { first_start, interval_s, exposure_s };
                match images {
                    true => Source::SequenceAt(path, said),
                    false => Source::RecordingAt(path, said),
                }
            }
            (None, None) if address.number("interval_s").is_none() => match images {
                true => Source::Sequence(path),
                false => Source::Recording(path),
            },
            _ => {
                let expected = "first_utc and exposure_s together, or none of them where a table lies beside it";
                return Err(wrong(format!("{address}: give {expected}")));
            }
        });
    }
    let format = match (address.text("format"), bayer) {
        (Some("grey16"), None) => Format::Grey16,
        (Some("yuyv"), None) => Format::Yuyv,
        (Some("uyvy"), None) => Format::Uyvy,
        (Some("bgr"), None) => Format::Bgr,
        (Some("bayer8"), Some(bayer)) => Format::Bayer8(bayer),
        (Some("bayer8"), None) => return Err(wrong(format!("{address}: give its bayer=PATTERN"))),
        (_, None) => Format::Grey8,
        (_, Some(_)) => {
            return Err(wrong(format!("{address}: bayer=PATTERN goes with format=bayer8")));
        }
    };
    let place = match place.parse() {
        Ok(number) => Place::Number(number),
        Err(_) => Place::Path(place.into()),
    };
    let mut live = Live::new(place, format);
    live.size_px = match (address.integer("columns"), address.integer("rows")) {
        (Some(columns), Some(rows)) => Some([columns, rows]),
        (None, None) => None,
        _ => return Err(wrong(format!("{address}: give columns and rows, or none of them"))),
    };
    live.rate_hz = address.number("rate_hz");
    if let Some(fixed_s) = address.number("fixed_exposure_s") {
        live.exposure = ExposureControl::Fixed(fixed_s);
    }
    Ok(Source::Live(live))
}
