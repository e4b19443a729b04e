//! Actions of the simulated devices when they are asked, and what happens by itself afterwards.

use super::scene::Shot;
use super::{Packing, Server, devices, wire};
use crate::device::Window;
use crate::indi::property::{Place, State, Vector};
use crate::indi::xml::Element;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use hifitime::Epoch;
use std::io::Write as _;
use std::time::Duration;
use sunglint_formats::fits::{Header, Image, Pixels, Writer};
use sunglint_formats::time;

/// How often a rotator says where it is.
const TICK: Duration = Duration::from_millis(250);

/// Something that happens at its time.
#[derive(Debug, Clone, Copy)]
pub(super) enum Step {
    Frame {
        start: Duration,
        exposure_s: f64,
    },
    StreamFrame,
    Turn {
        from: f64,
        to: f64,
        since: Duration,
    },
    Slot(f64),
    Cold(f64),
    /// The driver of the camera (0), the wheel (1) or the rotator (2) ends.
    Lose(usize),
    Die,
}

impl Server {
    pub(super) fn handle(&mut self, element: &Element, now: Duration) {
        let device = element.attribute("device").map(str::to_owned);
        let name = element.attribute("name").map(str::to_owned);
        match (element.tag.as_str(), device, name) {
            ("getProperties", device, name) => self.define(device, name.as_deref(), now),
            ("enableBLOB", Some(_), _) => self.blobs = element.text != "Never",
            (tag, Some(device), Some(name)) if tag.starts_with("new") => {
                self.change(Place { device, name }, element, now);
            }
            _ => {}
        }
    }

    fn define(&mut self, device: Option<String>, name: Option<&str>, now: Duration) {
        if !self.watched.contains(&device) {
            self.watched.push(device.clone());
        }
        let asked = |place: &&Place| {
            device.as_ref().is_none_or(|device| *device == place.device)
                && name.is_none_or(|name| name == place.name)
        };
        let places: Vec<Place> = self.vectors.keys().filter(asked).cloned().collect();
        for place in places {
            let text = wire::definition(&place, &self.vectors[&place]);
            self.say(&place.device, text, now);
        }
    }

    /// A vector that is there, with its change told.
    fn update(&mut self, place: &Place, now: Duration, change: impl FnOnce(&mut Vector)) {
        let Some(vector) = self.vectors.get_mut(place) else { return };
        change(vector);
        let text = wire::change(place, vector);
        self.say(&place.device, text, now);
    }

    fn place(device: &str, name: &str) -> Place {
        Place { device: device.to_owned(), name: name.to_owned() }
    }

    fn change(&mut self, place: Place, element: &Element, now: Duration) {
        // What is not there gets no answer.
        let Some(vector) = self.vectors.get(&place) else { return };
        let alert = self.trouble.alert.clone().filter(|(name, _)| *name == place.name);
        let refusal = match (wire::asked(vector, element), alert) {
            (Some(after), None) => return self.carry_out(&place, after, now),
            (_, Some((_, message))) => message,
            (None, None) => "[ERROR] That makes no sense, or is out of bounds.".to_owned(),
        };
        self.say(&place.device, wire::message(&place.device, &refusal), now);
        self.update(&place, now, |vector| vector.state = State::Alert);
    }

    fn carry_out(&mut self, place: &Place, mut after: Vector, now: Duration) {
        let number = |name: &str| after.number(name).unwrap_or(0.0);
        match place.name.as_str() {
            "CONNECTION" => return self.connect(place, after, now),
            "CCD_EXPOSURE" => {
                let exposure_s = number("CCD_EXPOSURE_VALUE");
                let took = Duration::from_secs_f64(exposure_s);
                let readout = self.settings.camera.as_ref().map_or(Duration::ZERO, |c| c.readout);
                self.agenda.retain(|(_, step)| !matches!(step, Step::Frame { .. }));
                self.agenda.push((now + took + readout, Step::Frame { start: now, exposure_s }));
                self.plan_trouble(0, now + took / 2);
                after.state = State::Busy;
            }
            "CCD_ABORT_EXPOSURE" => {
                // CCD_EXPOSURE stays Busy, as it does with some drivers of 1.9.9.
                self.agenda.retain(|(_, step)| !matches!(step, Step::Frame { .. }));
                spring_back(&mut after, "ABORT");
            }
            "CCD_VIDEO_STREAM" => {
                self.agenda.retain(|(_, step)| !matches!(step, Step::StreamFrame));
                if after.is_on("STREAM_ON") == Some(true) {
                    after.state = State::Busy;
                    self.agenda.push((now, Step::StreamFrame));
                    self.plan_trouble(0, now + TICK);
                }
            }
            "CCD_TEMPERATURE" => {
                let wanted = number("CCD_TEMPERATURE_VALUE");
                self.agenda.push((now + Duration::from_secs(2), Step::Cold(wanted)));
                after = self.vectors[place].clone();
                after.state = State::Busy;
            }
            "ABS_ROTATOR_ANGLE" => {
                let to = number("ANGLE");
                let from = self.vectors[place].number("ANGLE").unwrap_or(0.0);
                self.agenda.retain(|(_, step)| !matches!(step, Step::Turn { .. }));
                self.agenda.push((now + TICK, Step::Turn { from, to, since: now }));
                self.plan_trouble(2, now + TICK / 2);
                after.set_number("ANGLE", from);
                after.state = State::Busy;
            }
            "ROTATOR_ABORT_MOTION" => {
                self.stop_turning(&place.device, now);
                spring_back(&mut after, "ABORT");
            }
            "ROTATOR_HOME" => {
                let angle = Self::place(&place.device, "ABS_ROTATOR_ANGLE");
                self.update(&angle, now, |vector| vector.set_number("ANGLE", 0.0));
                spring_back(&mut after, "HOME");
            }
            "SYNC_ROTATOR_ANGLE" => {
                let angle = number("ANGLE");
                let place = Self::place(&place.device, "ABS_ROTATOR_ANGLE");
                self.update(&place, now, |vector| vector.set_number("ANGLE", angle));
            }
            "FILTER_SLOT" => {
                let slot = number("FILTER_SLOT_VALUE");
                let took = self.settings.wheel.as_ref().map_or(Duration::ZERO, |w| w.change);
                self.agenda.retain(|(_, step)| !matches!(step, Step::Slot(_)));
                self.agenda.push((now + took, Step::Slot(slot)));
                self.plan_trouble(1, now + took / 2);
                after = self.vectors[place].clone();
                after.state = State::Busy;
            }
            _ => {}
        }
        self.update(place, now, |vector| *vector = after);
    }

    fn plan_trouble(&mut self, device: usize, due: Duration) {
        if std::mem::take(&mut self.trouble.lose_device) {
            self.agenda.push((due, Step::Lose(device)));
        }
        if std::mem::take(&mut self.trouble.die) {
            self.agenda.push((due, Step::Die));
        }
    }

    fn connect(&mut self, place: &Place, after: Vector, now: Duration) {
        let on = after.is_on("CONNECT") == Some(true);
        let device = place.device.clone();
        let was = self.vectors[place].is_on("CONNECT") == Some(true);
        self.update(place, now, |vector| *vector = after);
        if on == was {
            return;
        }
        let settings = &self.settings;
        let named = |name: &str| name == device;
        let camera = settings.camera.as_ref().filter(|s| named(&s.name)).map(devices::camera);
        let rotator = settings.rotator.as_ref().filter(|s| named(&s.name)).map(devices::rotator);
        let wheel = settings.wheel.as_ref().filter(|s| named(&s.name)).map(devices::wheel);
        for (place, vector) in [camera, rotator, wheel].into_iter().flatten().flatten() {
            if on {
                self.say(&device, wire::definition(&place, &vector), now);
                self.vectors.insert(place, vector);
            } else {
                self.vectors.remove(&place);
                self.say(&device, wire::deletion(&device, Some(&place.name)), now);
            }
        }
    }

    pub(super) fn happen(&mut self, step: Step, now: Duration) {
        let [camera, wheel, rotator] = self.names();
        match step {
            Step::Frame { start, exposure_s } => {
                self.finish_exposure(&camera, start, exposure_s, now)
            }
            Step::StreamFrame => self.stream_frame(&camera, now),
            Step::Turn { from, to, since } => {
                let speed = self.settings.rotator.as_ref().map_or(1.0, |spec| spec.speed_deg_s);
                let gone = speed * now.saturating_sub(since).as_secs_f64();
                let there = gone >= (to - from).abs() && !self.trouble.stuck;
                let angle =
                    if there { to } else { from + gone.min((to - from).abs()).copysign(to - from) };
                if !there {
                    self.agenda.push((now + TICK, step));
                }
                let place = Self::place(&rotator, "ABS_ROTATOR_ANGLE");
                self.update(&place, now, |vector| {
                    vector.set_number("ANGLE", angle);
                    vector.state = if there { State::Ok } else { State::Busy };
                });
            }
            Step::Slot(slot) => {
                if self.trouble.stuck {
                    return;
                }
                self.update(&Self::place(&wheel, "FILTER_SLOT"), now, |vector| {
                    vector.set_number("FILTER_SLOT_VALUE", slot);
                    vector.state = State::Ok;
                });
            }
            Step::Cold(temperature_c) => {
                self.update(&Self::place(&camera, "CCD_TEMPERATURE"), now, |vector| {
                    vector.set_number("CCD_TEMPERATURE_VALUE", temperature_c);
                    vector.state = State::Ok;
                });
            }
            Step::Lose(which) => {
                let device = &[camera, wheel, rotator][which];
                self.vectors.retain(|place, _| place.device != *device);
                self.agenda.clear();
                self.say(device, wire::deletion(device, None), now);
                let again = self.devices().into_iter().find(|(name, _)| name == device);
                for (place, vector) in
                    again.iter().flat_map(|(name, interface)| devices::always(name, *interface))
                {
                    self.vectors.insert(place, vector);
                }
            }
            Step::Die => {
                self.dead = true;
                self.said.clear();
            }
        }
    }

    fn names(&self) -> [String; 3] {
        let super::ServerSettings { camera, wheel, rotator, .. } = &self.settings;
        [
            camera.as_ref().map_or(String::new(), |spec| spec.name.clone()),
            wheel.as_ref().map_or(String::new(), |spec| spec.name.clone()),
            rotator.as_ref().map_or(String::new(), |spec| spec.name.clone()),
        ]
    }

    fn stop_turning(&mut self, device: &str, now: Duration) {
        self.advance(now);
        self.agenda.retain(|(_, step)| !matches!(step, Step::Turn { .. }));
        let place = Self::place(device, "ABS_ROTATOR_ANGLE");
        self.update(&place, now, |vector| vector.state = State::Ok);
    }

    fn number(&self, device: &str, name: &str, member: &str) -> f64 {
        self.vector(device, name).and_then(|vector| vector.number(member)).unwrap_or(0.0)
    }

    /// The window of a vector, in whole pixels by its ranges.
    fn window(&self, device: &str, name: &str, binned: bool) -> Window {
        let read = |member| self.number(device, name, member) as u32;
        let bin = |member| {
            if binned { (self.number(device, "CCD_BINNING", member) as u32).max(1) } else { 1 }
        };
        let sensor = self.settings.camera.as_ref().map_or([1, 1], |camera| camera.sensor_px);
        let origin_px = [read("X"), read("Y")];
        let within =
            |axis: usize, size: u32| size.min(sensor[axis].saturating_sub(origin_px[axis]));
        let size_px = [within(0, read("WIDTH")), within(1, read("HEIGHT"))];
        Window { origin_px, size_px, binning: [bin("HOR_BIN"), bin("VER_BIN")] }
    }

    fn finish_exposure(&mut self, camera: &str, start: Duration, exposure_s: f64, now: Duration) {
        let window = self.window(camera, "CCD_FRAME", true);
        let start = self.utc(start);
        let gain = self.number(camera, "CCD_GAIN", "GAIN");
        let shot = Shot { window, exposure_s, start, gain };
        let temperature_c = self.number(camera, "CCD_TEMPERATURE", "CCD_TEMPERATURE_VALUE");
        let pixels = self.scene.frame(&shot);
        let bytes = self.fits(&shot, pixels, temperature_c);
        if self.blobs
            && !self.trouble.no_blob
            && let Some(bytes) = bytes
        {
            let size = bytes.len();
            let packed =
                self.vector(camera, "CCD_COMPRESSION").and_then(|v| v.is_on("INDI_ENABLED"));
            let (format, bytes) = match (self.trouble.packing, packed) {
                (Packing::TileCompressed, _) => (".fits.fz", bytes),
                (Packing::Cut, _) => (".fits", bytes[..size / 2].to_vec()),
                (Packing::AsAsked, Some(true)) => (".fits.z", deflated(&bytes)),
                (Packing::AsAsked, _) => (".fits", bytes),
            };
            let place = Self::place(camera, "CCD1");
            self.say(camera, wire::blob(&place, format, size, &bytes), now);
        }
        self.update(&Self::place(camera, "CCD_EXPOSURE"), now, |vector| {
            vector.set_number("CCD_EXPOSURE_VALUE", 0.0);
            vector.state = State::Ok;
        });
    }

    /// A frame as a FITS file with the header that INDI writes.
    fn fits(
        &self,
        shot: &Shot,
        pixels: ndarray::Array2<u16>,
        temperature_c: f64,
    ) -> Option<Vec<u8>> {
        let mut header = Header::default();
        header.set("ROWORDER", "TOP-DOWN", "Row Order");
        header.set("EXPTIME", shot.exposure_s, "Total Exposure Time (s)");
        header.set("CCD-TEMP", temperature_c, "CCD Temperature (Celsius)");
        header.set("XBINNING", i64::from(shot.window.binning[0]), "Binning factor in width");
        header.set("YBINNING", i64::from(shot.window.binning[1]), "Binning factor in height");
        let types = self.settings.camera.as_ref();
        let types = types.and_then(|camera| self.vector(&camera.name, "CCD_FRAME_TYPE"));
        let is = |member| types.and_then(|types| types.is_on(member)).unwrap_or(false);
        let kinds = [("FRAME_BIAS", "Bias"), ("FRAME_DARK", "Dark"), ("FRAME_FLAT", "Flat")];
        let kind = kinds.into_iter().find(|(member, _)| is(member));
        header.set("FRAME", kind.map_or("Light", |(_, kind)| kind), "Frame Type");
        if let Some(slot) = self.filter() {
            header.set("FILTER", slot.as_str(), "Filter");
        }
        if let Some(bayer) = self.settings.camera.as_ref().and_then(|camera| camera.bayer) {
            header.set("XBAYROFF", 0_i64, "X offset of Bayer array");
            header.set("YBAYROFF", 0_i64, "Y offset of Bayer array");
            header.set("BAYERPAT", bayer.name(), "Bayer color pattern");
        }
        header.set("DATE-OBS", date_obs(shot.start).as_str(), "UTC start date of observation");
        header.set("GAIN", shot.gain, "Gain");
        let mut writer = Writer::new();
        writer.image(&Image { header, pixels: Pixels::U16(pixels.into_dyn()) }).ok()?;
        Some(writer.into_bytes())
    }

    fn filter(&self) -> Option<String> {
        let wheel = self.settings.wheel.as_ref()?;
        let slot = self.vector(&wheel.name, "FILTER_SLOT")?.number("FILTER_SLOT_VALUE")?;
        wheel.filters.get(slot as usize - 1).cloned()
    }

    fn stream_frame(&mut self, camera: &str, now: Duration) {
        let exposure_s = self.number(camera, "STREAMING_EXPOSURE", "STREAMING_EXPOSURE_VALUE");
        self.agenda.push((now + Duration::from_secs_f64(exposure_s.max(0.001)), Step::StreamFrame));
        let whole = self.settings.camera.as_ref().map_or([0, 0], |camera| camera.sensor_px);
        // As 1.9.9: with a part of the sensor for exposures, a stream gives nothing.
        if self.window(camera, "CCD_FRAME", false).size_px != whole
            || !self.blobs
            || self.trouble.no_blob
        {
            return;
        }
        let window = self.window(camera, "CCD_STREAM_FRAME", false);
        let gain = self.number(camera, "CCD_GAIN", "GAIN");
        let pixels = self.scene.frame(&Shot { window, exposure_s, start: self.utc(now), gain });
        // The upper 8 of 16 bits.
        let bytes: Vec<u8> = pixels.iter().map(|adu| (adu >> 8) as u8).collect();
        let place = Self::place(camera, "CCD1");
        self.say(camera, wire::blob(&place, ".stream", bytes.len(), &bytes), now);
    }
}

/// To the millisecond, as INDI writes it.
fn date_obs(start: Epoch) -> String {
    time::format_utc(start, 3).trim_end_matches('Z').to_owned()
}

fn spring_back(vector: &mut Vector, name: &str) {
    use crate::indi::property::Value;
    if let Some(member) = vector.members.iter_mut().find(|member| member.name == name) {
        member.value = Value::Switch(false);
    }
    vector.state = State::Ok;
}

fn deflated(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::fast());
    // Writing into memory cannot fail; a stream that is cut is what the client would find.
    let _ = encoder.write_all(bytes);
    encoder.finish().unwrap_or_default()
}
