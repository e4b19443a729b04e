//! An attitude as a table of a TOML file, usually `[attitude]` of a pass.
//!
//! ```toml
//! [attitude]
//! law = "inertial"                    # fixed among the stars
//! body_to_gcrs = [1, 0, 0, 0]         # w, x, y, z; or euler_zyx_deg = [yaw, pitch, roll]
//!
//! [attitude]
//! law = "spin"                        # about a fixed axis
//! axis_body = [0, 0, 1]               # or axis_gcrs, or axis_ra_dec_deg = [ra, dec], each with body_to_gcrs;
//! axis_ra_dec_deg = [120, 35]         # or both, in place of body_to_gcrs: the body's axis lies along the other
//! phase_deg = 0                       # with both: turned so far about the axis at the epoch
//! period_s = 5.2                      # inertial; negative turns left-handed; or rate_rpm, or rate_deg_s
//! epoch_utc = 2026-03-01T20:00:00Z    # when it stands so
//!
//! [attitude]
//! law = "tumble"                      # a rigid body without torque
//! inertia_kg_m2 = [[2, 0, 0], [0, 3, 0], [0, 0, 4]]    # or principal_moments_kg_m2 = [2, 3, 4], perhaps with principal_to_body
//! omega_body_deg_s = [0.1, 20, 0]     # against the stars; or omega_gcrs_deg_s
//! body_to_gcrs = [1, 0, 0, 0]
//! epoch_utc = 2026-03-01T20:00:00Z
//!
//! [attitude]
//! law = "torques"                     # a rigid body under torques: integrated over the times of the scene
//! inertia_kg_m2 = [[2, 0, 0], [0, 3, 0], [0, 0, 4]]    # absolute here; or principal_moments_kg_m2; or mass_kg, of uniform density
//! omega_body_deg_s = [0.1, 20, 0]
//! body_to_gcrs = [1, 0, 0, 0]
//! epoch_utc = 2026-03-01T20:00:00Z
//! [attitude.torques]                  # see TorquesFile
//! magnetic_moment_a_m2 = [0, 0, 0.1]
//!
//! [attitude]
//! law = "orbit"                       # z to nadir, y against the orbit's normal, x along the velocity
//! body_to_orbit = [1, 0, 0, 0]        # or euler_zyx_deg; the default is none
//!
//! [attitude]
//! law = "pointing"                    # one axis exactly, another as nearly as that allows
//! first_axis_body = [0, 0, 1]
//! first = "nadir"                     # sun, nadir, velocity, orbit_normal, north
//! second_axis_body = [1, 0, 0]
//! second = "sun"
//! euler_zyx_deg = [0, 0, 0]           # a constant bias of the body against that attitude; also of sun and yaw_steering
//!
//! [attitude]
//! law = "table"
//! file = "attitude.ecsv"              # time_utc, q_w, q_x, q_y, q_z: body to GCRS
//! interpolation = "slerp"             # or squad
//! ```
//!
//! `law = "sun"` is `pointing` with `first = "sun"`; `yaw_steering` is `pointing` with `first = "nadir"` and `second = "sun"`,
//! by default z to nadir and x on the Sun's side, so that panels that turn about y face the Sun.

use super::torques::{Along, Body, Conductor, Density, Driven, Skin, Start, mass};
use super::{
    Attitude, AttitudeError, AttitudeTable, Direction, Inertia, Interpolation, Pointing, Spin,
    Tumble, euler_zyx, quaternion_wxyz,
};
use glam::{DMat3, DQuat, DVec3};
use hifitime::Epoch;
use serde::Deserialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use sunglint_ephemeris::orbit::eclipse::EarthShape;
use sunglint_ephemeris::orbit::{Orbit, seconds_between};
use sunglint_formats::time::{Utc, parse_utc};
use sunglint_formats::toml::{Document, Finite, Positive, Within};
use sunglint_formats::{FileError, ParseError, Table};
use sunglint_radiometry::sky::EarthOrientation;

use crate::mesh::Mesh;
use crate::target::Target;

/// Reads a table that the file names, and says under which path it was found.
pub type Loader<'a> = &'a mut dyn FnMut(&str) -> Result<(Table, PathBuf), FileError>;

/// The `[attitude]` of a file in which other tables may stand too, a `PASS.toml` for one.
#[derive(Deserialize)]
struct AnyFile {
    attitude: AttitudeFile,
}

/// Contents of an attitude file; see the module.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AttitudeFile {
    law: Law,
    body_to_gcrs: Option<[Finite; 4]>,
    euler_zyx_deg: Option<[Finite; 3]>,
    epoch_utc: Option<Utc>,
    axis_body: Option<[Finite; 3]>,
    axis_gcrs: Option<[Finite; 3]>,
    axis_ra_dec_deg: Option<(Within<-180, 360>, Within<-90, 90>)>,
    phase_deg: Option<Finite>,
    period_s: Option<Finite>,
    rate_deg_s: Option<Finite>,
    rate_rpm: Option<Finite>,
    inertia_kg_m2: Option<[[Finite; 3]; 3]>,
    principal_moments_kg_m2: Option<[Positive; 3]>,
    principal_to_body: Option<[Finite; 4]>,
    omega_body_deg_s: Option<[Finite; 3]>,
    omega_gcrs_deg_s: Option<[Finite; 3]>,
    body_to_orbit: Option<[Finite; 4]>,
    first_axis_body: Option<[Finite; 3]>,
    first: Option<Direction>,
    second_axis_body: Option<[Finite; 3]>,
    second: Option<Direction>,
    file: Option<String>,
    interpolation: Option<Interpolation>,
    mass_kg: Option<Positive>,
    centre_of_mass_m: Option<[Finite; 3]>,
    torques: Option<TorquesFile>,
}

/// Torques of a file, all but the gravity gradient off unless given:
///
/// ```toml
/// [attitude.torques]
/// gravity_gradient = true
/// magnetic_moment_a_m2 = [0, 0, 0.1]
/// conductor = { shape = "sphere", radius_m = 0.12, conductivity_s_m = 1.5e7 }   # or "shell" with thickness_m; or coefficient_s_m4 = 2e3
/// radiation_pressure = true
/// drag = { coefficient = 2.2, density_kg_m3 = 1.5e-13, height_km = 600, scale_height_km = 72 }
/// ```
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct TorquesFile {
    gravity_gradient: Option<bool>,
    magnetic_moment_a_m2: Option<[Finite; 3]>,
    conductor: Option<ConductorFile>,
    #[serde(default)]
    radiation_pressure: bool,
    drag: Option<DragFile>,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct ConductorFile {
    shape: Option<ConductorShape>,
    radius_m: Option<Positive>,
    thickness_m: Option<Positive>,
    conductivity_s_m: Option<Positive>,
    coefficient_s_m4: Option<Positive>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum ConductorShape {
    Sphere,
    Shell,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct DragFile {
    coefficient: Positive,
    density_kg_m3: Positive,
    height_km: Option<Positive>,
    scale_height_km: Option<Positive>,
}

/// Circumstances of a scene that a motion under torques depends on.
#[derive(Debug, Clone, Copy)]
pub struct Circumstances<'a> {
    /// The body.
    pub target: &'a Target,
    /// Orbit of the body.
    pub orbit: &'a Orbit,
    /// UT1 and the pole.
    pub earth: &'a EarthOrientation,
    /// The Earth that hides the Sun; `None` for no eclipse.
    pub shadow: Option<EarthShape>,
    /// The first and the last moment at which the attitude is wanted.
    pub window: (Epoch, Epoch),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Law {
    Inertial,
    Spin,
    Tumble,
    Orbit,
    Pointing,
    Sun,
    YawSteering,
    Table,
    Torques,
}

impl Attitude {
    /// The attitude in the `[attitude]` of a file; its other tables are not looked at.
    ///
    /// # Errors
    /// A file that cannot be read, one without `[attitude]`, and what that has wrong, with line and key.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, FileError> {
        Self::read_at(path.as_ref())
    }

    fn read_at(path: &Path) -> Result<Self, FileError> {
        let document = Document::read(path)?;
        let file: AnyFile = document.parse()?;
        attitude(&document, "attitude", &file.attitude, &mut |name| {
            let path = document.resolve(name);
            let text = sunglint_formats::read::text(&path)?;
            Ok((sunglint_formats::text_table::read_str(&path, &text)?, path))
        })
    }

    /// The attitude of a law that needs nothing but its name.
    ///
    /// # Errors
    /// An unknown name; a law that needs more keys, with the first of them.
    pub fn named(law: &str) -> Result<Self, FileError> {
        let text = format!("[attitude]\nlaw = {:?}\n", law);
        let document = Document::new("(law)", text)?;
        let file: AnyFile = document.parse()?;
        attitude(&document, "attitude", &file.attitude, &mut |name| {
            Err(document.error_at("attitude.file", format!("no file {name}")).into())
        })
    }
}

impl Law {
    fn name(self) -> &'static str {
        match self {
            Law::Inertial => "inertial",
            Law::Spin => "spin",
            Law::Tumble => "tumble",
            Law::Orbit => "orbit",
            Law::Pointing => "pointing",
            Law::Sun => "sun",
            Law::YawSteering => "yaw_steering",
            Law::Table => "table",
            Law::Torques => "torques",
        }
    }

    fn keys(self) -> &'static [&'static str] {
        match self {
            Law::Inertial => &["body_to_gcrs", "euler_zyx_deg"],
            Law::Spin => &[
                "body_to_gcrs",
                "euler_zyx_deg",
                "axis_body",
                "axis_gcrs",
                "axis_ra_dec_deg",
                "phase_deg",
                "period_s",
                "rate_deg_s",
                "rate_rpm",
                "epoch_utc",
            ],
            Law::Tumble => &[
                "inertia_kg_m2",
                "principal_moments_kg_m2",
                "principal_to_body",
                "omega_body_deg_s",
                "omega_gcrs_deg_s",
                "body_to_gcrs",
                "euler_zyx_deg",
                "epoch_utc",
            ],
            Law::Orbit => &["body_to_orbit", "euler_zyx_deg"],
            Law::Pointing => {
                &["first_axis_body", "first", "second_axis_body", "second", "euler_zyx_deg"]
            }
            Law::Sun => &["first_axis_body", "second_axis_body", "second", "euler_zyx_deg"],
            Law::YawSteering => &["first_axis_body", "second_axis_body", "euler_zyx_deg"],
            Law::Table => &["file", "interpolation"],
            Law::Torques => &[
                "inertia_kg_m2",
                "principal_moments_kg_m2",
                "principal_to_body",
                "mass_kg",
                "centre_of_mass_m",
                "omega_body_deg_s",
                "omega_gcrs_deg_s",
                "body_to_gcrs",
                "euler_zyx_deg",
                "epoch_utc",
                "torques",
            ],
        }
    }
}

/// The attitude that stands at the dotted key `at` (`attitude`) of a document; `table` reads the table that it names.
///
/// # Errors
/// Keys that the law needs and are missing, or that it does not use; what is no attitude; a table that cannot be read: with
/// line and field.
pub fn attitude(
    document: &Document,
    at: &str,
    file: &AttitudeFile,
    table: Loader,
) -> Result<Attitude, FileError> {
    let place = Place { document, at };
    place.check_keys(file)?;
    Ok(match file.law {
        Law::Inertial => Attitude::Inertial(place.body_to_gcrs(file)?),
        Law::Spin => Attitude::Spin(place.spin(file)?),
        Law::Tumble => Attitude::Tumble(place.tumble(file)?),
        Law::Orbit => Attitude::Orbit(
            place.rotation("body_to_orbit", &file.body_to_orbit, file)?.unwrap_or_default(),
        ),
        Law::Pointing | Law::Sun | Law::YawSteering => Attitude::Pointing(place.pointing(file)?),
        Law::Table => Attitude::Table(place.table(file, table)?),
        Law::Torques => {
            let expected = "a law that needs no orbit: a motion under torques needs the orbit, the target and the times of a scene";
            return Err(place.error("law", expected).into());
        }
    })
}

impl AttitudeFile {
    /// Whether the law is a motion under torques, which [`under_torques`] makes.
    pub fn is_under_torques(&self) -> bool {
        self.law == Law::Torques
    }
}

/// The motion under torques that stands at the dotted key `at` of a document, followed over the window of its scene.
///
/// # Errors
/// Keys that are missing or of no use here; a body without an inertia; a motion that cannot be followed: with line and field.
pub fn under_torques(
    document: &Document,
    at: &str,
    file: &AttitudeFile,
    scene: &Circumstances<'_>,
) -> Result<Attitude, ParseError> {
    let place = Place { document, at };
    place.check_keys(file)?;
    let (body, start, density) = place.body(file, scene)?;
    let span_s = [scene.window.0, scene.window.1].map(|t| seconds_between(start.epoch, t));
    let (from_s, to_s) = (span_s[0].min(0.0), span_s[1].max(0.0));
    let along =
        Along::new(scene.orbit, start.epoch, (from_s, to_s), scene.earth, scene.shadow, density);
    let along = along.map_err(|error| {
        place.error("epoch_utc", "a motion that can be followed").with_hint(error.to_string())
    })?;
    let driven = Driven::new(&body, &start, &along, (span_s[0], span_s[1]));
    let driven = driven.map_err(|error| place.refused("omega_body_deg_s", &error))?;
    Ok(Attitude::Torques(Arc::new(driven)))
}

/// Where the file's table stands, for errors.
struct Place<'a> {
    document: &'a Document,
    at: &'a str,
}

impl Place<'_> {
    fn key(&self, key: &str) -> String {
        format!("{}.{key}", self.at)
    }

    fn error(&self, key: &str, expected: impl Into<String>) -> ParseError {
        self.document.error_at(&self.key(key), expected)
    }

    /// Returns the error for an attitude that a law refuses, at the key that is most likely wrong.
    fn refused(&self, key: &str, error: &AttitudeError) -> ParseError {
        self.error(key, "an attitude that can be").with_hint(error.to_string())
    }

    fn needs<T>(&self, key: &str, value: Option<T>) -> Result<T, ParseError> {
        value.ok_or_else(|| self.error(key, format!("{key}, which is required")))
    }

    fn check_keys(&self, file: &AttitudeFile) -> Result<(), ParseError> {
        let given = [
            ("body_to_gcrs", file.body_to_gcrs.is_some()),
            ("euler_zyx_deg", file.euler_zyx_deg.is_some()),
            ("epoch_utc", file.epoch_utc.is_some()),
            ("axis_body", file.axis_body.is_some()),
            ("axis_gcrs", file.axis_gcrs.is_some()),
            ("axis_ra_dec_deg", file.axis_ra_dec_deg.is_some()),
            ("phase_deg", file.phase_deg.is_some()),
            ("period_s", file.period_s.is_some()),
            ("rate_deg_s", file.rate_deg_s.is_some()),
            ("rate_rpm", file.rate_rpm.is_some()),
            ("inertia_kg_m2", file.inertia_kg_m2.is_some()),
            ("principal_moments_kg_m2", file.principal_moments_kg_m2.is_some()),
            ("principal_to_body", file.principal_to_body.is_some()),
            ("omega_body_deg_s", file.omega_body_deg_s.is_some()),
            ("omega_gcrs_deg_s", file.omega_gcrs_deg_s.is_some()),
            ("body_to_orbit", file.body_to_orbit.is_some()),
            ("first_axis_body", file.first_axis_body.is_some()),
            ("first", file.first.is_some()),
            ("second_axis_body", file.second_axis_body.is_some()),
            ("second", file.second.is_some()),
            ("file", file.file.is_some()),
            ("interpolation", file.interpolation.is_some()),
            ("mass_kg", file.mass_kg.is_some()),
            ("centre_of_mass_m", file.centre_of_mass_m.is_some()),
            ("torques", file.torques.is_some()),
        ];
        let known = file.law.keys();
        match given.iter().find(|(key, is_given)| *is_given && !known.contains(key)) {
            None => Ok(()),
            Some((key, _)) => {
                let law = file.law.name();
                let expected = format!("no {key}: the law {law} uses {}", known.join(", "));
                Err(self.error(key, expected))
            }
        }
    }

    /// A rotation from its quaternion or from `euler_zyx_deg`.
    fn rotation(
        &self,
        key: &str,
        wxyz: &Option<[Finite; 4]>,
        file: &AttitudeFile,
    ) -> Result<Option<DQuat>, ParseError> {
        match (wxyz, &file.euler_zyx_deg) {
            (Some(_), Some(_)) => {
                let expected = format!("either {key} or euler_zyx_deg, not both");
                Err(self.error("euler_zyx_deg", expected))
            }
            (Some(wxyz), None) => self.quaternion(key, wxyz).map(Some),
            (None, Some(angles)) => {
                let [yaw, pitch, roll] = angles.map(|a| a.get().to_radians());
                Ok(Some(euler_zyx(yaw, pitch, roll)))
            }
            (None, None) => Ok(None),
        }
    }

    fn quaternion(&self, key: &str, wxyz: &[Finite; 4]) -> Result<DQuat, ParseError> {
        quaternion_wxyz(wxyz.map(Finite::get)).map_err(|error| {
            let hint = "the order is w, x, y, z";
            self.error(key, "a quaternion of unit length").with_hint(format!("{error}; {hint}"))
        })
    }

    fn body_to_gcrs(&self, file: &AttitudeFile) -> Result<DQuat, ParseError> {
        let rotation = self.rotation("body_to_gcrs", &file.body_to_gcrs, file)?;
        rotation.ok_or_else(|| {
            self.error("body_to_gcrs", "body_to_gcrs or euler_zyx_deg, one of which is required")
        })
    }

    fn epoch(&self, file: &AttitudeFile) -> Result<Epoch, ParseError> {
        self.needs("epoch_utc", file.epoch_utc).map(|utc| utc.0)
    }

    fn spin(&self, file: &AttitudeFile) -> Result<Spin, ParseError> {
        let turns_per_s = self.turns_per_s(file)?;
        let epoch = self.epoch(file)?;
        let axis_gcrs = match (&file.axis_gcrs, file.axis_ra_dec_deg) {
            (Some(_), Some(_)) => {
                let expected = "either axis_gcrs or axis_ra_dec_deg, not both";
                return Err(self.error("axis_ra_dec_deg", expected));
            }
            (Some(axis), None) => Some(vector(axis)),
            (None, Some((ra, dec))) => {
                let place =
                    sunglint_radiometry::sky::Equatorial { ra_deg: ra.get(), dec_deg: dec.get() };
                Some(place.direction())
            }
            (None, None) => None,
        };
        let axis_body = file.axis_body.as_ref().map(vector);
        if file.phase_deg.is_some() && !(axis_body.is_some() && axis_gcrs.is_some()) {
            let expected = "phase_deg only with axis_body and an axis in the GCRS";
            return Err(self.error("phase_deg", expected));
        }
        let refused = |key: &str| {
            let key = key.to_owned();
            move |error: AttitudeError| self.refused(&key, &error)
        };
        match (axis_body, axis_gcrs) {
            (Some(body), Some(gcrs)) => {
                if file.body_to_gcrs.is_some() || file.euler_zyx_deg.is_some() {
                    let expected = "axis_body or an axis in the GCRS beside body_to_gcrs, not both axes (both stand in place of it)";
                    return Err(self.error("axis_body", expected));
                }
                let phase_rad = file.phase_deg.map_or(0.0, |p| p.get().to_radians());
                Spin::along(body, gcrs, turns_per_s, phase_rad, epoch).map_err(refused("axis_body"))
            }
            (Some(body), None) => {
                Spin::about_body_axis(body, turns_per_s, self.body_to_gcrs(file)?, epoch)
                    .map_err(refused("axis_body"))
            }
            (None, Some(gcrs)) => Spin::new(gcrs, turns_per_s, self.body_to_gcrs(file)?, epoch)
                .map_err(refused("axis_gcrs")),
            (None, None) => {
                let expected = "axis_body, axis_gcrs or axis_ra_dec_deg: the axis of the spin";
                Err(self.error("axis_body", expected))
            }
        }
    }

    fn turns_per_s(&self, file: &AttitudeFile) -> Result<f64, ParseError> {
        match (file.period_s, file.rate_deg_s, file.rate_rpm) {
            (Some(period), None, None) if period.get() != 0.0 => Ok(1.0 / period.get()),
            (Some(_), None, None) => Err(self.error("period_s", "a period other than 0 s")),
            (None, Some(rate), None) => Ok(rate.get() / 360.0),
            (None, None, Some(rate)) => Ok(rate.get() / 60.0),
            _ => Err(self.error("period_s", "exactly one of period_s, rate_deg_s and rate_rpm")),
        }
    }

    fn tumble(&self, file: &AttitudeFile) -> Result<Tumble, ParseError> {
        let inertia = self.inertia(file)?;
        let (omega, body_to_gcrs) = self.omega(file)?;
        Tumble::new(&inertia, omega, body_to_gcrs, self.epoch(file)?)
            .map_err(|error| self.refused("omega_body_deg_s", &error))
    }

    fn inertia(&self, file: &AttitudeFile) -> Result<Inertia, ParseError> {
        let (key, inertia) = match (&file.inertia_kg_m2, &file.principal_moments_kg_m2) {
            (Some(rows), None) => {
                if file.principal_to_body.is_some() {
                    let expected = "principal_to_body only beside principal_moments_kg_m2";
                    return Err(self.error("principal_to_body", expected));
                }
                let rows = rows.map(|row| vector(&row));
                let tensor = DMat3::from_cols(rows[0], rows[1], rows[2]).transpose();
                ("inertia_kg_m2", Inertia::of_tensor(tensor))
            }
            (None, Some(moments)) => {
                let axes = file.principal_to_body.as_ref();
                let axes = axes.map(|q| self.quaternion("principal_to_body", q)).transpose()?;
                let moments = DVec3::from_array(moments.map(Positive::get));
                let inertia = Inertia::of_principal(moments, axes.unwrap_or_default());
                ("principal_moments_kg_m2", inertia)
            }
            _ => {
                let expected = "either inertia_kg_m2 or principal_moments_kg_m2";
                return Err(self.error("inertia_kg_m2", expected));
            }
        };
        inertia
            .map_err(|error| self.error(key, "the inertia of a body").with_hint(error.to_string()))
    }

    /// The angular velocity in the body's axes, rad/s, and the attitude at the epoch.
    fn omega(&self, file: &AttitudeFile) -> Result<(DVec3, DQuat), ParseError> {
        let body_to_gcrs = self.body_to_gcrs(file)?;
        let radians = |v: &[Finite; 3]| vector(v) * 1_f64.to_radians();
        let omega = match (&file.omega_body_deg_s, &file.omega_gcrs_deg_s) {
            (Some(omega), None) => radians(omega),
            (None, Some(omega)) => body_to_gcrs.inverse() * radians(omega),
            _ => {
                let expected = "either omega_body_deg_s or omega_gcrs_deg_s";
                return Err(self.error("omega_body_deg_s", expected));
            }
        };
        Ok((omega, body_to_gcrs))
    }

    fn body(
        &self,
        file: &AttitudeFile,
        scene: &Circumstances<'_>,
    ) -> Result<(Body, Start, Option<Density>), ParseError> {
        let filled = file.mass_kg.map(|mass| self.filled(scene.target, mass.get())).transpose()?;
        let inertia = match &filled {
            None => self.inertia(file)?,
            Some(_) if file.inertia_kg_m2.is_some() || file.principal_moments_kg_m2.is_some() => {
                let expected = "either mass_kg (a body of uniform density) or its inertia";
                return Err(self.error("mass_kg", expected));
            }
            Some(filled) => Inertia::of_tensor(filled.inertia_kg_m2).map_err(|error| {
                self.error("mass_kg", "a body with an inertia").with_hint(error.to_string())
            })?,
        };
        let centre_m = match (&file.centre_of_mass_m, &filled) {
            (Some(centre), _) => vector(centre),
            (None, Some(filled)) => filled.centre_m,
            (None, None) => DVec3::ZERO,
        };
        let (omega_body_rad_s, body_to_gcrs) = self.omega(file)?;
        let start = Start { epoch: self.epoch(file)?, body_to_gcrs, omega_body_rad_s };
        let keys = file.torques.clone().unwrap_or_default();
        let mut body = Body::new(&inertia);
        body.gravity_gradient = keys.gravity_gradient.unwrap_or(true);
        body.moment_a_m2 = keys.magnetic_moment_a_m2.as_ref().map_or(DVec3::ZERO, vector);
        body.conductor = keys.conductor.as_ref().map(|c| self.conductor(c)).transpose()?;
        body.radiation = keys.radiation_pressure;
        body.drag = keys.drag.as_ref().map(|d| d.coefficient.get());
        if body.radiation || body.drag.is_some() {
            let skin = Skin::new(scene.target, centre_m).map_err(|error| {
                self.error("torques", "a target with a surface").with_hint(error.to_string())
            })?;
            body.skin = Some(Arc::new(skin));
        }
        let density = keys.drag.as_ref().map(|d| self.density(d)).transpose()?;
        Ok((body, start, density))
    }

    /// Mass properties of the target's closed parts, hinges at rest.
    fn filled(&self, target: &Target, mass_kg: f64) -> Result<mass::MassProperties, ParseError> {
        let meshes: Vec<Mesh> = (0..target.parts.len()).map(|p| target.part_mesh(p, &[])).collect();
        let whole = Mesh::merged(&meshes);
        let expected = "inertia_kg_m2 or principal_moments_kg_m2 in its place";
        // Parts of one closed surface close only together.
        if !whole.welded(1e-9).examine().all_closed() {
            let hint = format!("{} has surfaces that enclose no volume", target.name);
            return Err(self.error("mass_kg", expected).with_hint(hint));
        }
        mass::of_mesh(&whole, mass_kg).ok_or_else(|| {
            self.error("mass_kg", expected).with_hint(format!("{} encloses no volume", target.name))
        })
    }

    fn conductor(&self, file: &ConductorFile) -> Result<Conductor, ParseError> {
        let idle = |key: &str, given: Option<Positive>, why: &str| match given {
            Some(_) => {
                Err(self.error(&format!("torques.conductor.{key}"), format!("no {key} {why}")))
            }
            None => Ok(()),
        };
        let needs = |key: &str, given: Option<Positive>| {
            self.needs(&format!("torques.conductor.{key}"), given).map(Positive::get)
        };
        if let (Some(k), None) = (file.coefficient_s_m4, file.shape) {
            let why = "beside coefficient_s_m4";
            idle("radius_m", file.radius_m, why)?;
            idle("thickness_m", file.thickness_m, why)?;
            idle("conductivity_s_m", file.conductivity_s_m, why)?;
            return Ok(Conductor::Tensor(DMat3::from_diagonal(DVec3::splat(k.get()))));
        }
        idle("coefficient_s_m4", file.coefficient_s_m4, "beside a shape")?;
        let radius_m = needs("radius_m", file.radius_m)?;
        let conductivity_s_m = needs("conductivity_s_m", file.conductivity_s_m)?;
        match file.shape {
            Some(ConductorShape::Sphere) => {
                idle("thickness_m", file.thickness_m, "for a solid sphere")?;
                Ok(Conductor::Sphere { radius_m, conductivity_s_m })
            }
            Some(ConductorShape::Shell) => {
                let thickness_m = needs("thickness_m", file.thickness_m)?;
                Ok(Conductor::Shell { radius_m, thickness_m, conductivity_s_m })
            }
            None => {
                let expected = "shape = \"sphere\" or \"shell\", or coefficient_s_m4";
                Err(self.error("torques.conductor", expected))
            }
        }
    }

    fn density(&self, file: &DragFile) -> Result<Density, ParseError> {
        let kg_m3 = file.density_kg_m3.get();
        match (file.height_km, file.scale_height_km) {
            (None, None) => Ok(Density { kg_m3, height_m: 0.0, scale_height_m: f64::INFINITY }),
            (Some(height), Some(scale)) => Ok(Density {
                kg_m3,
                height_m: 1e3 * height.get(),
                scale_height_m: 1e3 * scale.get(),
            }),
            _ => {
                let expected =
                    "height_km and scale_height_km together, or neither (one density everywhere)";
                Err(self.error("torques.drag", expected))
            }
        }
    }

    fn pointing(&self, file: &AttitudeFile) -> Result<Pointing, ParseError> {
        let yaw_steering = file.law == Law::YawSteering;
        let axis = |key: &str, given: &Option<[Finite; 3]>, default: DVec3| match given {
            Some(axis) => Ok(vector(axis)),
            None if yaw_steering => Ok(default),
            None => Err(self.error(key, format!("{key}, which is required"))),
        };
        let first_axis = axis("first_axis_body", &file.first_axis_body, DVec3::Z)?;
        let second_axis = axis("second_axis_body", &file.second_axis_body, DVec3::X)?;
        let (first, second) = match file.law {
            Law::YawSteering => (Direction::Nadir, Direction::Sun),
            Law::Sun => (Direction::Sun, self.needs("second", file.second)?),
            _ => (self.needs("first", file.first)?, self.needs("second", file.second)?),
        };
        let pointing = Pointing::new(first_axis, first, second_axis, second).map_err(|error| {
            let key = match error {
                AttitudeError::SameDirection { .. } => "second",
                _ => "second_axis_body",
            };
            self.refused(key, &error)
        });
        match self.rotation("euler_zyx_deg", &None, file)? {
            Some(bias) => pointing.map(|pointing| pointing.with_bias(bias)),
            None => pointing,
        }
    }

    fn table(&self, file: &AttitudeFile, read: Loader) -> Result<AttitudeTable, FileError> {
        let name = self.needs("file", file.file.as_ref())?;
        let (table, path) = read(name).map_err(|error| match error {
            FileError::Io { path, source, .. } => {
                let hint = format!("{}: {source}", path.display());
                self.error("file", "a table that can be read").with_hint(hint).into()
            }
            error => error,
        })?;
        let missing = |row: usize| {
            ParseError::new(&path, "no value", "a time").in_field(format!("time_utc, row {row}"))
        };
        let texts = table.text("time_utc").map_err(|e| e.in_file(&path))?;
        let mut epochs = Vec::with_capacity(texts.len());
        for (i, text) in texts.iter().enumerate() {
            let text = text.as_ref().ok_or_else(|| missing(i + 1))?;
            let field = format!("time_utc, row {}", i + 1);
            epochs.push(parse_utc(text).map_err(|e| e.in_file(&path).in_field(field))?);
        }
        let mut columns = Vec::new();
        for name in ["q_w", "q_x", "q_y", "q_z"] {
            columns.push(table.quantity(name, "").map_err(|e| e.in_file(&path))?);
        }
        let attitudes = (0..table.rows())
            .map(|i| DQuat::from_xyzw(columns[1][i], columns[2][i], columns[3][i], columns[0][i]))
            .collect();
        AttitudeTable::new(epochs, attitudes, file.interpolation.unwrap_or_default()).map_err(
            |error| {
                let expected =
                    "attitudes (q_w, q_x, q_y, q_z: unit quaternions) at increasing times";
                ParseError::new(&path, error.to_string(), expected).into()
            },
        )
    }
}

fn vector(numbers: &[Finite; 3]) -> DVec3 {
    DVec3::from_array(numbers.map(Finite::get))
}
