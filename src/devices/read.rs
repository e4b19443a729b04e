//! `sunglint devices read`: what a device measures.

use super::Outcome;
use super::session::{Desk, Session, TalkArgs, Waiting, advised, seconds, utc_now};
use crate::output::{Console, OutputArgs, Usage};
use anyhow::Context as _;
use clap::Args;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::time::Duration;
use sunglint_drivers::catalogue::AnyDevice;
use sunglint_drivers::device::Power;
use sunglint_formats::fits::Writer;
use sunglint_formats::time::format_utc;
use sunglint_formats::{Column, CountRecord, CountSeries, Frame, Meta, Table, Values};
use sunglint_report::Product;

/// How much longer than its exposure a frame may take, and than its bin a count.
const FRAME: Duration = Duration::from_secs(30);

/// Arguments of `sunglint devices read`.
#[derive(Debug, Args)]
pub struct ReadArgs {
    /// The device.
    #[command(flatten)]
    pub talk: TalkArgs,
    /// How many readings
    #[arg(short = 'n', long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    pub count: u32,
    /// Time from the beginning of one reading to that of the next, s [default: none]
    #[arg(long, value_name = "S")]
    pub every: Option<f64>,
    /// Exposure of a camera's frames, or length of a photon counter's bins, s
    #[arg(long, value_name = "S", default_value_t = 0.1)]
    pub exposure_s: f64,
    /// Where the result goes; frames go into a .fits file, several of them into a folder.
    #[command(flatten)]
    pub out: OutputArgs,
}

/// What a device measured, with when: UTC when the answer was there, or as the device says.
pub(super) enum Reading {
    Power { time_utc: String, power: Power },
    Angle { time_utc: String, angle_deg: f64 },
    Slot { time_utc: String, slot: u32 },
    Frame(Box<Frame>),
    Counts { channels: Vec<String>, record: CountRecord },
}

impl Reading {
    /// Whether there was more light than the device holds.
    pub fn is_over(&self) -> bool {
        match self {
            Self::Power { power, .. } => !matches!(power, Power::Watts(_)),
            Self::Frame(frame) => {
                Some(f64::from(stats(frame).1)) >= frame.saturation_adu
                    && frame.saturation_adu.is_some()
            }
            _ => false,
        }
    }

    /// In a line.
    pub fn text(&self) -> String {
        match self {
            Self::Power { time_utc, power: Power::Watts(watts) } => {
                format!("{time_utc}  {watts:.6e} W")
            }
            Self::Power { time_utc, power: Power::Over { range_w: Some(range) } } => {
                format!("{time_utc}  more than its range of {range:e} W")
            }
            Self::Power { time_utc, .. } => format!("{time_utc}  more than its range"),
            Self::Angle { time_utc, angle_deg } => format!("{time_utc}  {angle_deg:.4} deg"),
            Self::Slot { time_utc, slot } => format!("{time_utc}  slot {slot}"),
            Self::Frame(frame) => {
                let (mean, most) = stats(frame);
                let (rows, columns) = frame.pixels.dim();
                let temperature = frame.temperature_c.map(|t| format!(", {t:.1} °C"));
                format!(
                    "{}  {columns} x {rows} px, {} s, mean {mean:.1} ADU, at most {most} ADU{}",
                    format_utc(frame.start, 3),
                    frame.exposure_s,
                    temperature.unwrap_or_default()
                )
            }
            Self::Counts { channels, record } => {
                let mut text = format_utc(record.start, 3);
                for (channel, counts) in channels.iter().zip(&record.counts) {
                    let _ = write!(text, "  {channel} {counts}");
                }
                if !record.flags.is_empty() {
                    let names: Vec<String> =
                        record.flags.iter_names().map(|(name, _)| name.to_lowercase()).collect();
                    let _ = write!(text, "  ({})", names.join(", "));
                }
                text
            }
        }
    }

    fn json(&self) -> Value {
        match self {
            Self::Power { time_utc, power } => {
                let watts = if let Power::Watts(watts) = power { Some(*watts) } else { None };
                json!({ "time_utc": time_utc, "power_w": watts, "over": watts.is_none() })
            }
            Self::Angle { time_utc, angle_deg } => {
                json!({ "time_utc": time_utc, "angle_deg": angle_deg })
            }
            Self::Slot { time_utc, slot } => json!({ "time_utc": time_utc, "slot": slot }),
            Self::Frame(frame) => {
                let (mean, most) = stats(frame);
                let (rows, columns) = frame.pixels.dim();
                json!({
                    "time_utc": format_utc(frame.start, 6),
                    "exposure_s": frame.exposure_s,
                    "columns_px": columns,
                    "rows_px": rows,
                    "mean_adu": mean,
                    "most_adu": most,
                    "temperature_c": frame.temperature_c,
                })
            }
            Self::Counts { channels, record } => {
                let of = |values: &[u64]| -> Value {
                    channels.iter().cloned().zip(values.iter().map(|n| json!(n))).collect()
                };
                json!({
                    "time_utc": format_utc(record.start, 6),
                    "exposure_s": record.length_ps as f64 * 1e-12,
                    "counts": of(&record.counts),
                    "missed": of(&record.missed),
                })
            }
        }
    }
}

/// Mean and largest value of a frame, ADU.
fn stats(frame: &Frame) -> (f64, u16) {
    let sum: u64 = frame.pixels.iter().map(|&pixel| u64::from(pixel)).sum();
    let most = frame.pixels.iter().copied().max().unwrap_or(0);
    (sum as f64 / frame.pixels.len().max(1) as f64, most)
}

pub(super) fn speak(args: &ReadArgs, desk: &Desk, console: Console) -> anyhow::Result<Outcome> {
    let every = args.every.map(|s| seconds("--every", s)).transpose()?.unwrap_or_default();
    let exposure_s = seconds("--exposure-s", args.exposure_s)?.as_secs_f64();
    let mut words = args.talk.words("read");
    words.extend(["--count".to_owned(), args.count.to_string()]);
    words.extend(["--exposure-s".to_owned(), args.exposure_s.to_string()]);
    words.extend(args.every.map(|s| ["--every".to_owned(), s.to_string()]).into_iter().flatten());
    let (session, mut device, identity) = Session::start(desk, &args.talk, &words, args.out.force)?;
    check_files(args, &device)?;
    let (mut readings, mut error) = (Vec::new(), None);
    let start = session.now();
    {
        let _waiting = Waiting::for_what(format!("{} readings", args.count), desk, console);
        let counter = Counter::start(&session, &mut device, exposure_s)?;
        for i in 0..args.count {
            let next = session
                .wait_until(start, every.saturating_mul(i))
                .and_then(|()| counter.next(&session, &mut device, exposure_s));
            match next {
                Ok(reading) => readings.push(reading),
                Err(failed) => {
                    error = Some(failed);
                    break;
                }
            }
        }
        counter.stop(&session, &mut device);
    }
    if readings.is_empty()
        && let Some(error) = error
    {
        return Err(error);
    }
    let mut json = session.document(Some(&identity));
    json.insert("readings".into(), readings.iter().map(Reading::json).collect());
    json.insert("complete".into(), json!(error.is_none()));
    json.insert("error".into(), json!(error.as_ref().map(ToString::to_string)));
    let mut text = session.title(&identity) + "\n";
    for reading in &readings {
        let _ = writeln!(text, "  {}", reading.text());
    }
    if error.is_some() {
        let _ = writeln!(text, "  {} of {} readings, then it failed", readings.len(), args.count);
    }
    let mut product = product(&readings)?;
    product.table.meta.insert("device".into(), json!(session.title(&identity)));
    product.json = Value::Object(json);
    Ok(Outcome { product, text, error })
}

/// One reading, as the self-test takes it.
pub(super) fn one(
    session: &Session,
    device: &mut AnyDevice,
    exposure_s: f64,
) -> anyhow::Result<Reading> {
    let counter = Counter::start(session, device, exposure_s)?;
    let reading = counter.next(session, device, exposure_s);
    counter.stop(session, device);
    reading
}

/// A photon counter that counts meanwhile, or any other device.
struct Counter {
    channels: Vec<String>,
}

impl Counter {
    fn start(session: &Session, device: &mut AnyDevice, bin_s: f64) -> anyhow::Result<Self> {
        let AnyDevice::PhotonCounter(counter) = device else {
            return Ok(Self { channels: vec![] });
        };
        // At most a day: it fits.
        counter.start((bin_s * 1e12).round() as i64, &session.soon()).map_err(advised)?;
        Ok(Self { channels: counter.channels().to_vec() })
    }

    fn next(
        &self,
        session: &Session,
        device: &mut AnyDevice,
        exposure_s: f64,
    ) -> anyhow::Result<Reading> {
        let soon = session.soon();
        let long = session.within(FRAME + Duration::from_secs_f64(exposure_s));
        Ok(match device {
            AnyDevice::PowerMeter(meter) => {
                let power = meter.power(&soon).map_err(advised)?;
                Reading::Power { time_utc: utc_now()?, power }
            }
            AnyDevice::RotationStage(stage) => {
                let angle_deg = stage.angle_deg(&soon).map_err(advised)?;
                Reading::Angle { time_utc: utc_now()?, angle_deg }
            }
            AnyDevice::FilterWheel(wheel) => {
                let slot = wheel.slot(&soon).map_err(advised)?;
                Reading::Slot { time_utc: utc_now()?, slot }
            }
            AnyDevice::Camera(camera) => {
                Reading::Frame(Box::new(camera.expose(exposure_s, &long).map_err(advised)?))
            }
            AnyDevice::PhotonCounter(counter) => {
                let read = counter.read(1, &long).map_err(|failed| advised(*failed.error))?;
                let record = read.into_iter().next().context("the counter gave no bin")?;
                Reading::Counts { channels: self.channels.clone(), record }
            }
        })
    }

    /// A counter that cannot be stopped is left counting: what it gave is good all the same.
    fn stop(&self, session: &Session, device: &mut AnyDevice) {
        if let AnyDevice::PhotonCounter(counter) = device {
            let _ = counter.stop(&session.soon());
        }
    }
}

/// Frames go into FITS files: what cannot be written is refused before the light is lost.
fn check_files(args: &ReadArgs, device: &AnyDevice) -> anyhow::Result<()> {
    let is_fits = |path: &std::path::PathBuf| {
        path.extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("fits") || e.eq_ignore_ascii_case("fit"))
    };
    let frames = matches!(device, AnyDevice::Camera(_)) && args.count > 1;
    match args.out.output.iter().find(|path| is_fits(path)) {
        Some(path) if frames => {
            let what = format!("{} frames do not fit into {}", args.count, path.display());
            Err(Usage(format!("{what}: give `-o` a folder (its name ends with `/`)")).into())
        }
        _ => Ok(()),
    }
}

/// The readings as a table, and frames as FITS.
fn product(readings: &[Reading]) -> anyhow::Result<Product> {
    let mut product = Product { name: "readings".into(), ..Product::default() };
    let time = |time: Vec<String>| Column::text("time_utc", time);
    let texts = readings.iter().map(|reading| match reading {
        Reading::Power { time_utc, .. }
        | Reading::Angle { time_utc, .. }
        | Reading::Slot { time_utc, .. } => time_utc.clone(),
        Reading::Frame(frame) => format_utc(frame.start, 6),
        Reading::Counts { record, .. } => format_utc(record.start, 6),
    });
    let mut columns = vec![time(texts.collect())];
    let numbers = |of: fn(&Reading) -> f64| readings.iter().map(of).collect::<Vec<f64>>();
    match readings.first() {
        Some(Reading::Power { .. }) => {
            columns.push(Column::f64(
                "power_w",
                Some("W"),
                numbers(|reading| match reading {
                    Reading::Power { power: Power::Watts(watts), .. } => *watts,
                    _ => f64::NAN,
                }),
            ));
            let over = readings.iter().map(|reading| Some(reading.is_over())).collect();
            let over = Column { values: Values::Bool(over), ..Column::text("over", Vec::new()) };
            columns.push(over.described("more than the range: no number"));
        }
        Some(Reading::Angle { .. }) => {
            columns.push(Column::f64(
                "angle_deg",
                Some("deg"),
                numbers(|reading| match reading {
                    Reading::Angle { angle_deg, .. } => *angle_deg,
                    _ => f64::NAN,
                }),
            ));
        }
        Some(Reading::Slot { .. }) => {
            let slot = |reading: &Reading| match reading {
                Reading::Slot { slot, .. } => i64::from(*slot),
                _ => 0,
            };
            columns.push(Column::i64("slot", None, readings.iter().map(slot).collect()));
        }
        Some(Reading::Frame(_)) => frames(readings, &mut columns, &mut product)?,
        Some(Reading::Counts { channels, .. }) => {
            let records = readings.iter().filter_map(|reading| match reading {
                Reading::Counts { record, .. } => Some(record.clone()),
                _ => None,
            });
            let (channels, records) = (channels.clone(), records.collect());
            product.table = CountSeries { channels, records, meta: Meta::default() }.to_table()?;
            return Ok(product);
        }
        None => {}
    }
    product.table = Table { columns, ..Table::default() };
    Ok(product)
}

fn frames(
    readings: &[Reading],
    columns: &mut Vec<Column>,
    product: &mut Product,
) -> anyhow::Result<()> {
    let of = |reading: &Reading, of: fn(&Frame) -> f64| match reading {
        Reading::Frame(frame) => of(frame),
        _ => f64::NAN,
    };
    type Of = fn(&Frame) -> f64;
    let values: [(&str, &str, Of); 4] = [
        ("exposure_s", "s", |frame| frame.exposure_s),
        ("mean_adu", "adu", |frame| stats(frame).0),
        ("most_adu", "adu", |frame| f64::from(stats(frame).1)),
        ("temperature_c", "deg_C", |frame| frame.temperature_c.unwrap_or(f64::NAN)),
    ];
    for (name, unit, value) in values {
        let numbers = readings.iter().map(|reading| of(reading, value)).collect();
        columns.push(Column::f64(name, Some(unit), numbers));
    }
    for (i, reading) in readings.iter().enumerate() {
        let Reading::Frame(frame) = reading else { continue };
        let mut writer = Writer::new();
        writer.image(&frame.to_image()?)?;
        let fits = Some(writer.into_bytes());
        if readings.len() == 1 {
            product.fits.clone_from(&fits);
        }
        let name = format!("frame_{:04}", i + 1);
        product.others.push(Product { name, fits, ..Product::default() });
    }
    Ok(())
}
