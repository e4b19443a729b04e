//! The mount in a plan: `[mount]` of NIGHT.toml.

use crate::plan::VIRTUAL_ADDRESS;
use crate::telescope::{PointingModel, TrackOptions};
use glam::DVec2;
use serde::Deserialize;
use std::path::PathBuf;
use std::time::Duration;
use sunglint_drivers::catalogue::{Address, Kind};
use sunglint_drivers::device::{MountAxes, MountKnown, PierSide};
use sunglint_formats::ParseError;
use sunglint_formats::session::Session;
use sunglint_formats::toml::{Document, Finite, Positive, Within};
use sunglint_radiometry::station::{Detector, Station};

/// Option of a recorded mount that tells where the file of the weather lies.
const WEATHER: &str = "weather=";
/// The same of the model of its pointing.
const POINTING: &str = "pointing=";
/// Time that a mount needs beside its motion: to begin, to brake, and to be found on its target, s.
const SETTLE_S: f64 = 10.0;

fn yes() -> bool {
    true
}

fn name() -> String {
    "mount".to_owned()
}

/// Axes of a mount, as a plan names them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PlanAxes {
    /// Hour angle and declination.
    Equatorial,
    /// Azimuth and altitude.
    Altaz,
}

/// A mount that points the telescope in a night.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct MountPlan {
    /// Name of the mount in the session.
    #[serde(default = "name")]
    pub name: String,
    /// Address of the device in the catalogue of drivers.
    pub device: String,
    /// Options for its driver, `NAME=VALUE` each.
    #[serde(default)]
    pub with: Vec<String>,
    /// The camera whose frames correct the pointing; the prediction alone without.
    #[serde(default)]
    pub camera: Option<String>,
    /// Turn of that camera, deg: 0 where columns grow with the first axis (hour angle, azimuth) and rows against the second (declination, altitude); counter-clockwise in
    /// the frame.
    #[serde(default)]
    pub camera_angle_deg: Option<Within<-360, 360>>,
    /// Whether its columns run the other way.
    #[serde(default)]
    pub camera_mirrored: bool,
    /// Side of the pier of a German mount on which `camera_angle_deg` holds: on the other side the camera is upside down.
    #[serde(default)]
    pub camera_angle_pier: Option<PierSide>,
    /// Hour angle past the meridian up to which a German mount follows before it turns over, deg.
    #[serde(default)]
    pub past_meridian_deg: Option<Within<0, 85>>,
    /// Whether it is a German mount; false of a fork, also of one that tells a side of a pier. Without it, an equatorial mount may turn over, and one that tells its side is turned over.
    #[serde(default)]
    pub german: Option<bool>,
    /// Axes about which it really turns.
    #[serde(default)]
    pub axes: Option<PlanAxes>,
    /// Fastest rate that its motors do, deg/s, where its driver publishes more.
    #[serde(default)]
    pub most_rate_deg_s: Option<Positive>,
    /// Slowest rate other than none that it takes, arcsec/s.
    #[serde(default)]
    pub least_rate_arcsec_s: Option<Within<0, 60>>,
    /// Angle that a pixel sees, arcsec; the station's without.
    #[serde(default)]
    pub pixel_scale_arcsec: Option<Positive>,
    /// Where the target is kept, px from the middle of the sensor; without it the middle of the station's fibres.
    #[serde(default)]
    pub aim_px: Option<[Finite; 2]>,
    /// How far from its prediction a star is looked for in the frames, arcsec; half of the sensor without.
    #[serde(default)]
    pub reach_arcsec: Option<Positive>,
    /// Whether cameras wait until the telescope is on its target.
    #[serde(default = "yes")]
    pub wait: bool,
    /// How long they wait from a visit's begin on, s.
    #[serde(default)]
    pub acquire_s: Option<Positive>,
    /// Distance from the target at which the telescope is on it, arcsec.
    #[serde(default)]
    pub on_target_arcsec: Option<Positive>,
    /// Lowest altitude, deg.
    #[serde(default)]
    pub min_elevation_deg: Option<Within<0, 89>>,
    /// Least distance from the Sun, deg.
    #[serde(default)]
    pub sun_limit_deg: Option<Within<10, 90>>,
    /// Time from a command to the mount's doing it, s.
    #[serde(default)]
    pub latency_s: Option<Within<0, 5>>,
    /// Speed of a slew, deg/s: for the time between two visits.
    #[serde(default)]
    pub slew_deg_s: Option<Positive>,
    /// Whether places are lifted by refraction; not where the mount's own software does it.
    #[serde(default = "yes")]
    pub refraction: bool,
    /// How far beside its neighbour a visit of the sky looks, arcmin.
    #[serde(default)]
    pub sky_beside_arcmin: Option<Positive>,
    /// Whether somebody knows that the computer's clock is right, though nothing says so.
    #[serde(default)]
    pub trust_clock: bool,
    /// Whether the mount is told the station's site, and UTC.
    #[serde(default)]
    pub set_site: bool,
    /// Whether it is parked at the end, at dawn and in bad weather.
    #[serde(default = "yes")]
    pub park: bool,
    /// Altitude of the rising Sun's centre at which it is parked, deg.
    #[serde(default)]
    pub dawn_deg: Option<Within<-18, -2>>,
    /// File that tells the weather.
    #[serde(default)]
    pub weather: Option<PathBuf>,
    /// Age at which that file counts as bad weather, s.
    #[serde(default)]
    pub weather_age_s: Option<Positive>,
    /// File of a model of its pointing.
    #[serde(default)]
    pub pointing: Option<PathBuf>,
    /// The model of that file.
    #[serde(skip)]
    pub model: Option<PointingModel>,
}

impl MountPlan {
    /// Time that cameras wait for the target, s.
    pub fn acquire_s(&self) -> f64 {
        self.acquire_s.map_or(60.0, Positive::get)
    }

    /// Distance from the target at which the telescope is on it, arcsec.
    pub fn on_target_arcsec(&self) -> f64 {
        self.on_target_arcsec.map_or(30.0, Positive::get)
    }

    /// Lowest altitude, deg.
    pub fn min_elevation_deg(&self) -> f64 {
        self.min_elevation_deg.map_or(10.0, Within::get)
    }

    /// Least distance from the Sun, deg.
    pub fn sun_limit_deg(&self) -> f64 {
        self.sun_limit_deg.map_or(30.0, Within::get)
    }

    /// Hour angle past the meridian up to which a German mount follows before it turns over, deg.
    pub fn past_meridian_deg(&self) -> f64 {
        self.past_meridian_deg.map_or(0.0, Within::get)
    }

    /// Facts that the plan knows better than the mount's driver.
    pub fn known(&self) -> MountKnown {
        MountKnown {
            axes: self.axes.map(|axes| match axes {
                PlanAxes::Equatorial => MountAxes::Equatorial,
                PlanAxes::Altaz => MountAxes::Horizontal,
            }),
            german: self.german,
            most_deg_s: self.most_rate_deg_s.map(Positive::get),
            least_deg_s: self.least_rate_arcsec_s.map(|rate| rate.get() / 3600.0),
        }
    }

    /// How the mount is moved, whatever the target is.
    pub fn track_options(&self) -> TrackOptions {
        TrackOptions {
            slew_within_s: self.slew_within_s(),
            slew_deg_s: self.slew_deg_s.map(Positive::get),
            past_meridian_deg: self.past_meridian_deg(),
            german: self.german != Some(false),
            unpark: false,
            ..TrackOptions::default()
        }
    }

    /// Speed of a slew, deg/s.
    pub fn slew_deg_s(&self) -> f64 {
        self.slew_deg_s.map_or(2.0, Positive::get)
    }

    /// Time for the way from a place to another, s: the axes' ways, deg, at the speed of a slew, and what it needs beside its motion.
    pub(crate) fn way_s(&self, [first, second]: [f64; 2]) -> f64 {
        first.abs().max(second.abs()) / self.slew_deg_s() + SETTLE_S
    }

    /// Time for the longest way that it may have to go, s: an axis turns by half a circle.
    pub(crate) fn farthest_s(&self) -> f64 {
        self.way_s([180.0; 2])
    }

    /// Distance of the sky from its star, deg.
    pub(crate) fn sky_beside_deg(&self) -> f64 {
        self.sky_beside_arcmin.map_or(10.0, Positive::get) / 60.0
    }

    /// Time for the way from a star to the sky beside it, s.
    pub(crate) fn beside_s(&self) -> f64 {
        self.way_s([self.sky_beside_deg(); 2])
    }

    /// Altitude of the rising Sun's centre at which it is parked, deg.
    pub fn dawn_deg(&self) -> f64 {
        self.dawn_deg.map_or(-2.0, Within::get)
    }

    /// Longest time that a slew may take, s: a whole turn, and a minute for its beginning and end.
    pub fn slew_within_s(&self) -> f64 {
        (360.0 / self.slew_deg_s() + 60.0).clamp(240.0, 3600.0)
    }

    /// Age at which the file of the weather counts as bad weather. One that no clock can hold never comes.
    pub fn weather_age(&self) -> Duration {
        let age_s = self.weather_age_s.map_or(300.0, Positive::get);
        Duration::try_from_secs_f64(age_s).unwrap_or(Duration::MAX)
    }

    /// Where the target is kept, px from the middle of the sensor: columns, rows.
    pub fn aim_px(&self, station: &Station) -> DVec2 {
        if let Some(aim) = self.aim_px {
            return aim.map(Finite::get).into();
        }
        let fibres: Vec<DVec2> = station
            .channels
            .iter()
            .filter_map(|channel| match &channel.detector {
                Detector::Counter(counter) => counter.fibre.map(|fibre| fibre.offset_px),
                _ => None,
            })
            .collect();
        let count = fibres.len().max(1) as f64;
        [0, 1].map(|axis| fibres.iter().map(|offset| offset[axis]).sum::<f64>() / count).into()
    }

    /// How the camera sees the mount's axes; `None` without a camera.
    pub fn view(&self, station: &Station) -> Option<View> {
        self.camera.as_ref()?;
        let own = self.pixel_scale_arcsec.map(Positive::get);
        let scale_arcsec =
            own.or(station.camera.as_ref().map(|camera| camera.pixel_scale_arcsec))?;
        Some(View {
            scale_arcsec,
            angle_deg: self.camera_angle_deg.map_or(0.0, Within::get),
            mirrored: self.camera_mirrored,
            side: self.camera_angle_pier.filter(|_| self.german != Some(false)),
            aim_px: self.aim_px(station),
        })
    }

    /// Checks what no night can have, with its line.
    ///
    /// # Errors
    /// The key that is wrong.
    pub(crate) fn check(
        &self,
        document: &Document,
        cameras: &[String],
        virtual_night: bool,
        station_scale: bool,
    ) -> Result<(), ParseError> {
        let wrong =
            |key: &str, expected: &str| document.error_at(&format!("mount.{key}"), expected);
        if !sunglint_formats::session::is_name(&self.name) || cameras.contains(&self.name) {
            return Err(wrong("name", "a name of its own out of letters, digits, - and _"));
        }
        if virtual_night {
            if self.device != VIRTUAL_ADDRESS {
                return Err(wrong("device", &format!("{VIRTUAL_ADDRESS}, as the night is")));
            }
        } else {
            let parsed = Address::parse(&self.device, &self.with).map_err(|error| {
                let field = if error.field.starts_with("option") { "with" } else { "device" };
                wrong(field, &error.expected)
            })?;
            if parsed.driver.kind != Kind::Mount {
                let expected = format!("a {}; this is a {}", Kind::Mount, parsed.driver.kind);
                return Err(wrong("device", &expected));
            }
        }
        if self.german == Some(true) && self.axes == Some(PlanAxes::Altaz) {
            return Err(wrong("axes", "equatorial, as a German mount is"));
        }
        if self.german == Some(false) && self.camera_angle_pier.is_some() {
            let expected = "nothing: with `german = false` the camera is never upside down";
            return Err(wrong("camera_angle_pier", expected));
        }
        if let Some(camera) = &self.camera {
            if !cameras.contains(camera) {
                return Err(wrong("camera", "the name of a [[camera]] of the plan"));
            }
            if self.pixel_scale_arcsec.is_none() && !station_scale {
                let expected =
                    "the angle of a pixel, arcsec: the station has no camera that says it";
                return Err(wrong("pixel_scale_arcsec", expected));
            }
        } else if self.camera_angle_deg.is_some()
            || self.camera_mirrored
            || self.camera_angle_pier.is_some()
        {
            return Err(wrong("camera", "the name of the camera that these keys are about"));
        }
        Ok(())
    }

    /// Finds the files of the weather and of the pointing, beside the plan or where they were when the session that goes on began, and reads the latter.
    ///
    /// # Errors
    /// The session does not say where one was; a file of the pointing that is none.
    pub(crate) fn find_files(
        &mut self,
        document: &Document,
        session: Option<&Session>,
    ) -> Result<(), ParseError> {
        let find = |path: PathBuf, key: &str, option: &str| {
            let found = match session.filter(|_| path.is_relative()) {
                None => document.resolve(path),
                Some(session) => {
                    let devices = session.manifest().devices.iter();
                    let mut of_mount = devices.filter(|device| device.name == self.name);
                    let recorded = of_mount.find_map(|device| {
                        device.options.iter().find_map(|own| own.strip_prefix(option))
                    });
                    let expected = "a whole path: the session does not say in which folder this file lies; write it into its night.toml";
                    PathBuf::from(recorded.ok_or_else(|| document.error_at(key, expected))?)
                }
            };
            Ok(std::path::absolute(&found).unwrap_or(found))
        };
        let weather = self.weather.clone().map(|path| find(path, "mount.weather", WEATHER));
        let pointing = self.pointing.clone().map(|path| find(path, "mount.pointing", POINTING));
        (self.weather, self.pointing) = (weather.transpose()?, pointing.transpose()?);
        if let Some(path) = &self.pointing {
            let model = PointingModel::read(path).map_err(|error| {
                let expected = format!("a file of `sunglint pointing` ({error})");
                document.error_at("mount.pointing", expected)
            })?;
            self.model = Some(model);
        }
        Ok(())
    }

    /// Options for the session: those of the driver, and where the files of the weather and of the pointing lie.
    pub(crate) fn recorded(&self) -> Vec<String> {
        let files = [(WEATHER, &self.weather), (POINTING, &self.pointing)];
        let files = files.into_iter().filter_map(|(option, path)| {
            path.as_ref().map(|path| format!("{option}{}", path.display()))
        });
        self.with.iter().cloned().chain(files).collect()
    }
}

/// How a camera sees a mount's axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// Angle that a pixel sees, arcsec.
    pub scale_arcsec: f64,
    /// Turn of the camera, deg.
    pub angle_deg: f64,
    /// Whether columns run the other way.
    pub mirrored: bool,
    /// Side of the pier on which this holds.
    pub side: Option<PierSide>,
    /// Where the target is kept, px from the middle of the sensor.
    pub aim_px: DVec2,
}

impl View {
    /// Offset along the growing axes of a light at a place of the sensor from where the target is kept, arcsec. The place counts from the middle of the sensor: columns, rows.
    pub fn offset_arcsec(&self, from_middle_px: DVec2) -> DVec2 {
        let [column, row] = [0, 1].map(|i| from_middle_px[i] - self.aim_px[i]);
        self.along_axes(DVec2::new(self.scale_arcsec * column, -self.scale_arcsec * row))
    }

    /// A way along the growing axes of a way in the frame: to the right and up.
    pub fn along_axes(&self, DVec2 { x: right, y: up }: DVec2) -> DVec2 {
        let right = if self.mirrored { -right } else { right };
        let (sin, cos) = self.angle_deg.to_radians().sin_cos();
        DVec2::new(cos * right - sin * up, sin * right + cos * up)
    }
}

/// Word for the axes of a mount.
pub(crate) fn axes_word(axes: MountAxes) -> &'static str {
    match axes {
        MountAxes::Equatorial => "equatorial",
        MountAxes::Horizontal => "horizontal",
    }
}
