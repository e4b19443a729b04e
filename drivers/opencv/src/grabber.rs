//! Any source of pictures as a camera.

use crate::cadence::{self, Cadence, Losses};
use crate::capture::{About, Automation, Capture, Open};
use crate::error::{DEVICE, wrong};
use crate::gamma::Gamma;
use crate::interlace::{Field, Interlace};
use crate::live::{self, Live};
use crate::picture::{Picture, Plane};
use crate::recording::Recording;
use crate::sequence::Sequence;
use crate::sidecar::{self, Row, Sidecar};
use crate::worker::Worker;
use hifitime::{Duration, Epoch};
use ndarray::{Array2, s};
use std::ops::ControlFlow;
use std::path::PathBuf;
use sunglint_drivers::clock::Deadline;
use sunglint_drivers::device::{
    Camera, Device, DeviceError, Identity, Interrupted, Origin, Setting, Value, Window,
};
use sunglint_formats::fits::Header;
use sunglint_formats::{Bayer, Frame};

/// Source of the pictures that are grabbed.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum Source {
    /// A device, now.
    Live(Live),
    /// A recorded file, whose table lies beside it.
    Recording(PathBuf),
    /// A recorded file without a table, whose times and exposures the user says.
    RecordingAt(PathBuf, Said),
    /// Numbered images (`night_%05d.png`), whose table lies beside them.
    Sequence(PathBuf),
    /// Numbered images without a table, whose times and exposures the user says.
    SequenceAt(PathBuf, Said),
}

/// Statements of the user about the frames of a recording that has no table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Said {
    /// When the exposure of the first frame began.
    pub first_start: Epoch,
    /// From the start of a frame to the start of the next, s. `None`: as the file's positions have it, which images have not,
    /// and which film files count from their nominal rate, not from a clock.
    pub interval_s: Option<f64>,
    /// Length of an exposure, s.
    pub exposure_s: f64,
}

/// How the time of a frame is known.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum FrameTimes {
    /// When it had come, by the host's clock, less the exposure: of live sources.
    Host,
    /// From the table beside the recording.
    Table(Sidecar),
    /// The user said so.
    Said(Said),
}

/// Treatment of pixels that are not those that the sensor delivered.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Lossy {
    /// They are refused.
    #[default]
    Refuse,
    /// They are taken, and each frame says so (the card `LOSSY`).
    Flag,
}

/// Treatment of frames whose pixels are those of the one before: a copy that stands where a frame was lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Doubled {
    /// They are taken, and say so (the card `DOUBLED`).
    #[default]
    Flag,
    /// They are left out, and counted.
    LeaveOut,
}

/// Treatment of live sources that change exposure or gain by themselves: magnitudes of their frames do not hold together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Automatic {
    /// They are refused.
    #[default]
    Refuse,
    /// They are taken, and each frame says so (the cards `AUTOEXP`, `AUTOGAIN`).
    Flag,
}

/// How pictures become frames.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct GrabberSettings {
    /// Which plane of a colour picture is taken.
    pub plane: Plane,
    /// The pattern at the first pixel of a whole picture, where the source does not say it.
    pub bayer: Option<Bayer>,
    /// Treatment of lossy sources.
    pub lossy: Lossy,
    /// The field that was exposed first, where frames are interlaced: each becomes two.
    pub fields: Option<Field>,
    /// The gamma that is undone.
    pub gamma: Option<Gamma>,
    /// Treatment of doubled frames.
    pub doubled: Doubled,
    /// Treatment of live sources that set exposure or gain by themselves.
    pub automatic: Automatic,
    /// Frames of a recording are taken whatever exposure was asked for: each says its own. Else another one is refused.
    pub any_exposure: bool,
    /// How many pictures are thrown away before a single exposure, as they may have begun before it was asked for. A live
    /// source has its own number.
    pub held: u32,
}

/// A source of pictures as a [`Camera`].
///
/// Frames begin and are as long as [`FrameTimes`] says; a comment on `DATE-OBS` says how that is known. Pixels are those of the
/// source, unless its gamma is undone ([`Gamma`]). An interlaced frame becomes two, each with its own start ([`Field`]).
pub struct Grabber {
    worker: Worker,
    about: About,
    times: FrameTimes,
    settings: GrabberSettings,
    window: Window,
    /// Columns and rows of a frame or, where frames are split, of a field.
    sensor_px: [u32; 2],
    /// Columns and rows of a picture, less what makes a film's sides even.
    picture_px: [u32; 2],
    /// Exposure that a live source reported last, s.
    exposure_s: Option<f64>,
    /// How many pictures have become frames, or would have.
    taken: u64,
    interlace: Option<Interlace>,
    /// The field of a frame whose first was given last.
    second: Option<Frame>,
    cadence: Cadence,
    /// The gain that a live source said last.
    gain: Option<f64>,
    automation: Automation,
}

impl std::fmt::Debug for Grabber {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Grabber").field("about", &self.about).field("times", &self.times).finish()
    }
}

impl Grabber {
    /// Opens a source.
    ///
    /// # Errors
    /// A device that is not there or does not do what it is asked; a file that is none; a recording without its table; a lossy
    /// one unless [`Lossy::Flag`] takes it. See [`DeviceError`].
    pub fn open(
        source: Source,
        mut settings: GrabberSettings,
        deadline: &Deadline,
    ) -> Result<Self, DeviceError> {
        let table = |path: &PathBuf| match Sidecar::read(path)? {
            Some(sidecar) => Ok(FrameTimes::Table(sidecar)),
            None => Err(wrong(format!(
                "{} is not there: without it nobody knows when the frames of {} began; say it (first start, interval, exposure)",
                sidecar::path_of(path).display(),
                path.display()
            ))),
        };
        let (times, open): (_, Open) = match source {
            Source::Live(live) => {
                settings.held = live.held;
                (FrameTimes::Host, Box::new(|| Ok(Box::new(live::Device::open(live)?))))
            }
            // The file first: that it is not there is the better answer.
            Source::Recording(path) => match path.exists() {
                true => (table(&path)?, recording(path)),
                false => (FrameTimes::Host, recording(path)),
            },
            Source::RecordingAt(path, said) => (FrameTimes::Said(said), recording(path)),
            Source::Sequence(path) => (table(&path)?, sequence(path)),
            Source::SequenceAt(path, said) => (FrameTimes::Said(said), sequence(path)),
        };
        Self::over(open, times, settings, deadline)
    }

    /// Opens a source of the caller's own.
    ///
    /// # Errors
    /// The errors of [`open`](Self::open).
    pub fn over(
        open: Open,
        times: FrameTimes,
        settings: GrabberSettings,
        deadline: &Deadline,
    ) -> Result<Self, DeviceError> {
        let (worker, about) = Worker::start(open, deadline)?;
        if let (Some(lossy), Lossy::Refuse) = (&about.lossy, settings.lossy) {
            return Err(wrong(format!(
                "{}: {lossy}; take it all the same with Lossy::Flag",
                about.name
            )));
        }
        let sensor_px = match &times {
            FrameTimes::Table(table) => table.size_px,
            _ => about.size_px,
        };
        if sensor_px.contains(&0) || (0..2).any(|axis| sensor_px[axis] > about.size_px[axis]) {
            return Err(wrong(format!(
                "{} has pictures of {:?} px, expected {sensor_px:?}",
                about.name, about.size_px
            )));
        }
        let interval_s = match &times {
            FrameTimes::Table(table) => cadence::interval_s(table),
            FrameTimes::Said(said) => said.interval_s.or(about.interval_s),
            FrameTimes::Host => about.interval_s,
        };
        let mut pixels_px = sensor_px;
        let interlace = match (settings.fields, interval_s.or(about.interval_s)) {
            (None, _) => None,
            (Some(first), Some(interval_s)) => {
                pixels_px[1] /= 2;
                Some(Interlace { first, interval_s })
            }
            (Some(_), None) => {
                return Err(wrong(format!(
                    "{} has fields, and nobody knows the interval between its frames: say it",
                    about.name
                )));
            }
        };
        if interlace.is_some() && !sensor_px[1].is_multiple_of(2) {
            return Err(wrong(format!(
                "{} has {} rows, expected an even number where frames have two fields",
                about.name, sensor_px[1]
            )));
        }
        let (picture_px, sensor_px) = (sensor_px, pixels_px);
        let cadence = Cadence::new(interval_s);
        let window = Window { origin_px: [0, 0], size_px: sensor_px, binning: [1, 1] };
        let exposure_s = None;
        Ok(Self {
            worker,
            about,
            times,
            settings,
            window,
            sensor_px,
            picture_px,
            exposure_s,
            taken: 0,
            interlace,
            second: None,
            cadence,
            gain: None,
            automation: Automation::default(),
        })
    }

    /// Counts of frames that were lost or doubled so far, among those that the source delivered.
    pub fn losses(&self) -> Losses {
        self.cadence.losses
    }

    /// Returns the source's description of itself.
    pub fn about(&self) -> &About {
        &self.about
    }

    /// The next frame or field, whatever its exposure; `None` at the end of a recording.
    ///
    /// # Errors
    /// A recording that ends before its last frame, or is damaged; see [`DeviceError`].
    pub fn next_frame(&mut self, deadline: &Deadline) -> Result<Option<Frame>, DeviceError> {
        if let Some(second) = self.second.take() {
            return Ok(Some(second));
        }
        loop {
            let Some(picture) = self.next_picture(deadline)? else {
                let promised = match &self.times {
                    FrameTimes::Table(table) => Some(table.rows.len() as u64),
                    _ => self.about.pictures,
                };
                return match promised.filter(|&promised| promised > self.taken) {
                    None => Ok(None),
                    Some(promised) => Err(wrong(format!(
                        "{} ends after {} of {promised} frames: it is cut off or damaged",
                        self.about.name, self.taken
                    ))),
                };
            };
            let bits = picture.bits;
            let mut frame = self.frame(picture)?;
            if let FrameTimes::Table(_) | FrameTimes::Said(_) = self.times {
                self.cadence.came(frame.start.to_tai_seconds());
            }
            if self.cadence.is_doubled(&frame.pixels) {
                if self.settings.doubled == Doubled::LeaveOut {
                    continue;
                }
                frame.header.set("DOUBLED", true, "pixels are those of the frame before");
            }
            return self.finished(frame, bits).map(Some);
        }
    }

    /// The next picture. Times of live ones are watched here, for those that are thrown away count, too.
    fn next_picture(&mut self, deadline: &Deadline) -> Result<Option<Picture>, DeviceError> {
        let Some(picture) = self.worker.next(deadline)? else { return Ok(None) };
        self.taken = picture.index + 1;
        if let (FrameTimes::Host, Some(arrived)) = (&self.times, picture.arrived) {
            // The driver's clock knows nothing of how late the host was.
            let at_s = picture.position_ms.map(|ms| 1e-3 * ms);
            self.cadence.came(at_s.unwrap_or_else(|| arrived.to_tai_seconds()));
        }
        Ok(Some(picture))
    }

    /// A whole frame as it is given: its light, its part, its first field.
    fn finished(&mut self, mut frame: Frame, bits: u8) -> Result<Frame, DeviceError> {
        let Losses { lost, doubled } = self.cadence.losses;
        for (card, count, comment) in [
            ("GRABLOST", lost, "frames that were lost so far, by the times"),
            ("GRABDUBL", doubled, "frames so far that repeat the one before"),
        ] {
            if let (1.., Ok(count)) = (count, i64::try_from(count)) {
                frame.header.set(card, count, comment);
            }
        }
        if let Some(gamma) = self.settings.gamma {
            gamma.undo(&mut frame, bits);
        }
        let Some(interlace) = self.interlace else {
            self.cut(&mut frame);
            return Ok(frame);
        };
        let [mut first, mut second] = interlace.split(&frame)?;
        self.cut(&mut first);
        self.cut(&mut second);
        self.second = Some(second);
        Ok(first)
    }

    /// Checks that a live source leaves exposure and gain as they were set.
    fn watch(&mut self, readings: [Option<f64>; 2]) -> Result<(), DeviceError> {
        let [exposure_s, gain] = readings;
        let changed = |before: Option<f64>, now: Option<f64>| match (before, now) {
            (Some(before), Some(now)) => (before - now).abs() > 1e-6 * before.abs(),
            _ => false,
        };
        if changed(self.exposure_s, exposure_s) {
            self.automation.exposure = Some(true);
        }
        if changed(self.gain, gain) {
            self.automation.gain = Some(true);
        }
        self.gain = gain;
        let what = match (self.automation.exposure, self.automation.gain) {
            (Some(true), Some(true)) => "exposure and gain",
            (Some(true), _) => "the exposure",
            (_, Some(true)) => "the gain",
            _ => return Ok(()),
        };
        if self.settings.automatic == Automatic::Flag {
            return Ok(());
        }
        Err(wrong(format!(
            "{} sets {what} by itself, and magnitudes of its frames do not hold together: turn that off (`v4l2-ctl --list-ctrls` names it), or take them all the same (`auto=yes`, Automatic::Flag)",
            self.about.name
        )))
    }

    /// How long the next frame of a recording was exposed, s; `None` for a live source and at the end.
    pub fn next_exposure_s(&self) -> Option<f64> {
        match &self.times {
            FrameTimes::Host => None,
            _ if self.second.is_some() => self.second.as_ref().map(|field| field.exposure_s),
            FrameTimes::Table(table) => {
                table.rows.get(self.taken as usize).map(|row| self.given_s(row.exposure_s))
            }
            FrameTimes::Said(said) => Some(self.given_s(said.exposure_s)),
        }
    }

    /// Exposure of what is given of a frame that was exposed so long, s.
    fn given_s(&self, frame_s: f64) -> f64 {
        self.interlace.map_or(frame_s, |interlace| interlace.exposure_s(frame_s))
    }

    fn frame(&mut self, picture: Picture) -> Result<Frame, DeviceError> {
        if self.times == FrameTimes::Host {
            self.watch(picture.readings)?;
        }
        let index = picture.index;
        let here = |what: String| wrong(format!("{}, frame {index}: {what}", self.about.name));
        let Picture { planes, bits, position_ms, arrived, .. } = picture;
        let pixels = self.settings.plane.of(planes).map_err(here)?;
        let pixels = self.unpadded(pixels).map_err(here)?;
        let saturation = Some(if bits == 8 { 255.0 } else { 65535.0 });
        let mut frame = match &self.times {
            FrameTimes::Table(table) => {
                let row = table.rows.get(index as usize).ok_or_else(|| {
                    here(format!("it has no row in the table, which has {}", table.rows.len()))
                })?;
                checked(pixels, table, row).map_err(here)?
            }
            FrameTimes::Said(said) => {
                let mut frame =
                    self.plain(pixels, said.start(index, position_ms)?, said.exposure_s);
                frame.header.comment("DATE-OBS: the first frame's and EXPTIME as the user said");
                frame
            }
            FrameTimes::Host => {
                let arrived = arrived.ok_or_else(|| here("it has no time".into()))?;
                let exposure_s = self
                    .exposure_s
                    .ok_or_else(|| here("its exposure is not known: set one first".into()))?;
                // The second field ended then.
                let took_s = self.interlace.map_or(exposure_s, |interlace| {
                    0.5 * interlace.interval_s + interlace.exposure_s(exposure_s)
                });
                let start = arrived - Duration::from_seconds(took_s);
                let mut frame = self.plain(pixels, start, exposure_s);
                frame.header.comment("DATE-OBS: when the frame arrived at the host, less EXPTIME");
                for (card, is) in
                    [("AUTOEXP", self.automation.exposure), ("AUTOGAIN", self.automation.gain)]
                {
                    if is == Some(true) {
                        frame.header.set(card, true, "the device changes it by itself");
                    }
                }
                if let Some(ms) = position_ms {
                    frame.header.set("GRABMSEC", ms, "ms, the driver's own clock");
                }
                frame
            }
        };
        frame.saturation_adu = frame.saturation_adu.or(saturation);
        if let Some(lossy) = &self.about.lossy {
            frame.header.set("LOSSY", true, "pixels are not the sensor's own");
            frame.header.comment(&format!("LOSSY: {lossy}"));
        }
        Ok(frame)
    }

    /// A frame of which nothing else is known.
    fn plain(&self, pixels: Array2<u16>, start: Epoch, exposure_s: f64) -> Frame {
        Frame {
            pixels,
            origin: [0, 0],
            binning: [1, 1],
            bayer: self.about.bayer.or(self.settings.bayer),
            start,
            exposure_s,
            gain_e_per_adu: None,
            temperature_c: None,
            saturation_adu: None,
            header: Header::default(),
        }
    }

    /// Without the row and column that make a film's sides even.
    fn unpadded(&self, pixels: Array2<u16>) -> Result<Array2<u16>, String> {
        let (rows, columns) = pixels.dim();
        if [columns, rows] != self.about.size_px.map(|side| side as usize) {
            let expected = self.about.size_px;
            return Err(format!(
                "{columns} × {rows} pixels, expected {} × {} as before",
                expected[0], expected[1]
            ));
        }
        let [columns, rows] = self.picture_px.map(|side| side as usize);
        Ok(if pixels.dim() == (rows, columns) {
            pixels
        } else {
            pixels.slice(s![..rows, ..columns]).to_owned()
        })
    }

    fn cut(&self, frame: &mut Frame) {
        let Window { origin_px: [x, y], size_px: [width, height], .. } = self.window;
        if self.window.size_px == self.sensor_px {
            return;
        }
        let part = s![y as usize..(y + height) as usize, x as usize..(x + width) as usize];
        frame.pixels = frame.pixels.slice(part).to_owned();
        frame.bayer = frame.bayer.map(|bayer| bayer.shifted(x, y));
        frame.origin[0] += x * frame.binning[0];
        frame.origin[1] += y * frame.binning[1];
    }

    /// Makes the next frames as long as asked, or says that they are not.
    fn prepare(&mut self, exposure_s: f64, deadline: &Deadline) -> Result<(), DeviceError> {
        const NAME: &str = "exposure, s";
        if !(exposure_s.is_finite() && exposure_s > 0.0) {
            let (asked, least, most) = (exposure_s, 0.0, f64::MAX);
            return Err(DeviceError::OutOfRange { name: NAME, asked, least, most });
        }
        match (&self.times, self.next_exposure_s()) {
            (FrameTimes::Host, _) => {
                let set = move |capture: &mut dyn Capture| capture.set_exposure_s(exposure_s);
                self.exposure_s =
                    Some(self.worker.call("setting the exposure", deadline, set)??);
                let ask = |capture: &mut dyn Capture| capture.automation();
                let says = self.worker.call("asking what is automatic", deadline, ask)?;
                // A gain that was seen to change is not told by every driver.
                self.automation = Automation { gain: says.gain.or(self.automation.gain), ..says };
                self.watch([None; 2])
            }
            (_, Some(recorded)) if !self.settings.any_exposure => {
                same_exposure(exposure_s, recorded)
            }
            _ => Ok(()),
        }
    }

    fn next_of(
        &mut self,
        exposure_s: f64,
        deadline: &Deadline,
    ) -> Result<Option<Frame>, DeviceError> {
        let frame = self.next_frame(deadline)?;
        let any = self.settings.any_exposure || self.times == FrameTimes::Host;
        if let (Some(frame), false) = (&frame, any) {
            same_exposure(exposure_s, frame.exposure_s)?;
        }
        Ok(frame)
    }
}

fn recording(path: PathBuf) -> Open {
    Box::new(move || Ok(Box::new(Recording::open(&path)?)))
}

fn sequence(path: PathBuf) -> Open {
    Box::new(move || Ok(Box::new(Sequence::open(&path)?)))
}

fn same_exposure(asked_s: f64, recorded_s: f64) -> Result<(), DeviceError> {
    if (asked_s - recorded_s).abs() <= 1e-6 * recorded_s {
        return Ok(());
    }
    let (asked, got) = (asked_s.to_string(), format!("{recorded_s} (as recorded)"));
    Err(DeviceError::NotTaken { device: DEVICE, name: "exposure, s", asked, got })
}

impl Said {
    fn start(&self, index: u64, position_ms: Option<f64>) -> Result<Epoch, DeviceError> {
        let since_s = match (self.interval_s, position_ms) {
            (Some(interval_s), _) => index as f64 * interval_s,
            (None, Some(ms)) => 1e-3 * ms,
            (None, None) => {
                let reason =
                    "these pictures have no positions in time: give the interval between them";
                return Err(DeviceError::NotReady { device: DEVICE, reason });
            }
        };
        Ok(self.first_start + Duration::from_seconds(since_s))
    }
}

/// The frame of a row, if the pixels are those that were written.
fn checked(pixels: Array2<u16>, table: &Sidecar, row: &Row) -> Result<Frame, String> {
    let found = sidecar::crc32(&pixels);
    if found != row.crc32 {
        return Err(format!(
            "its pixels are not those that were recorded (check sum {found:08x}, expected {:08x}): it is damaged, or was converted",
            row.crc32
        ));
    }
    Ok(Frame {
        pixels,
        origin: table.origin,
        binning: table.binning,
        bayer: table.bayer,
        start: row.start,
        exposure_s: row.exposure_s,
        gain_e_per_adu: row.gain_e_per_adu,
        temperature_c: row.temperature_c,
        saturation_adu: row.saturation_adu,
        header: row.header.clone(),
    })
}

impl Device for Grabber {
    fn identity(&mut self, _: &Deadline) -> Result<Identity, DeviceError> {
        Ok(Identity {
            vendor: format!("OpenCV ({})", self.about.backend),
            model: self.about.name.clone(),
            serial: None,
            firmware: opencv::core::get_version_string().ok(),
            driver: "opencv",
        })
    }

    fn settings(&mut self, deadline: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let mut settings = Vec::new();
        let mut add = |name, value, origin| settings.push(Setting { name, value, origin });
        let Window { origin_px, size_px, .. } = self.window;
        // Cut out here, not by the source.
        for (name, pixels) in [
            ("origin_x_px", origin_px[0]),
            ("origin_y_px", origin_px[1]),
            ("columns_px", size_px[0]),
            ("rows_px", size_px[1]),
        ] {
            add(name, Value::Integer(pixels.into()), Origin::Configured);
        }
        let Losses { lost, doubled } = self.cadence.losses;
        for (name, count) in [("lost_frames", lost), ("doubled_frames", doubled)] {
            if let (1.., Ok(count)) = (count, i64::try_from(count)) {
                add(name, Value::Integer(count), Origin::ReadBack);
            }
        }
        if let Some(codec) = &self.about.codec {
            add("codec", Value::Text(codec.clone()), Origin::ReadBack);
        }
        let ask = |capture: &mut dyn Capture| capture.exposure_and_gain();
        let [exposure_s, gain] = self.worker.call("asking for exposure and gain", deadline, ask)?;
        if let Some(exposure_s) = exposure_s {
            add("exposure_s", Value::Number(exposure_s), Origin::ReadBack);
        }
        if let Some(gain) = gain {
            add("gain", Value::Number(gain), Origin::ReadBack);
        }
        Ok(settings)
    }
}

impl Camera for Grabber {
    fn sensor_px(&self) -> [u32; 2] {
        self.sensor_px
    }

    /// The part is cut out of each picture here; OpenCV knows no windows and no binning.
    fn set_window(&mut self, window: Window, _: &Deadline) -> Result<Window, DeviceError> {
        const NAMES: [[&str; 2]; 2] =
            [["first column, px", "columns, px"], ["first row, px", "rows, px"]];
        if window.binning != [1, 1] {
            let (asked, known) = (format!("{:?}", window.binning), "[1, 1]".into());
            return Err(DeviceError::Unknown { name: "binning", asked, known });
        }
        for (axis, [origin_name, size_name]) in NAMES.into_iter().enumerate() {
            let (origin, size) = (window.origin_px[axis], window.size_px[axis]);
            let side = self.sensor_px[axis];
            check(origin_name, origin, 0, side - 1)?;
            check(size_name, size, 1, side - origin)?;
        }
        self.window = window;
        Ok(window)
    }

    fn set_gain(&mut self, gain: f64, deadline: &Deadline) -> Result<f64, DeviceError> {
        let set = move |capture: &mut dyn Capture| capture.set_gain(gain);
        let got = self.worker.call("setting the gain", deadline, set)??;
        self.gain = None;
        Ok(got)
    }

    fn set_temperature_c(&mut self, _: f64, _: &Deadline) -> Result<f64, DeviceError> {
        let reason = "OpenCV knows no cooling";
        Err(DeviceError::NotReady { device: DEVICE, reason })
    }

    /// The next frame. Of a live source, one that began after this was asked for.
    fn expose(&mut self, exposure_s: f64, deadline: &Deadline) -> Result<Frame, DeviceError> {
        self.prepare(exposure_s, deadline)?;
        if self.times == FrameTimes::Host {
            // Those that the driver holds, and the one that is being exposed.
            for _ in 0..=self.settings.held {
                self.next_picture(deadline)?;
            }
            self.second = None;
        }
        self.next_of(exposure_s, deadline)?.ok_or(DeviceError::NotReady {
            device: DEVICE,
            reason: "the recording is at its end: open it again",
        })
    }

    /// Frames until `take` breaks, or to the end of a recording.
    fn stream(
        &mut self,
        exposure_s: f64,
        take: &mut dyn FnMut(Frame) -> ControlFlow<()>,
        deadline: &Deadline,
    ) -> Result<u64, Interrupted<u64>> {
        self.prepare(exposure_s, deadline).map_err(|error| Interrupted::new(0, error))?;
        let mut count = 0;
        loop {
            match self.next_of(exposure_s, deadline) {
                Ok(None) => return Ok(count),
                Ok(Some(frame)) => {
                    count += 1;
                    if take(frame).is_break() {
                        return Ok(count);
                    }
                }
                Err(error) => return Err(Interrupted::new(count, error)),
            }
        }
    }
}

fn check(name: &'static str, asked: u32, least: u32, most: u32) -> Result<(), DeviceError> {
    if (least..=most).contains(&asked) {
        return Ok(());
    }
    let [asked, least, most] = [asked, least, most].map(f64::from);
    Err(DeviceError::OutOfRange { name, asked, least, most })
}
