//! Telescope mounts, and cameras that say where a mount's target stands.

use super::{Device, DeviceError, Origin, Setting, Value};
use crate::clock::Deadline;
use glam::DVec2;
use hifitime::Epoch;
use sunglint_numerics::axes::Axes;
use sunglint_numerics::measured::Interval;

/// Pair of axes about which a mount turns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MountAxes {
    /// Hour angle, growing towards the west, and declination.
    Equatorial,
    /// Azimuth, growing from north towards east, and altitude.
    Horizontal,
}

/// Rates at which a mount can be told to move.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum MountRates {
    /// Any rate of both axes at once.
    Continuous {
        /// Largest rate of each axis, deg/s.
        most_deg_s: Axes,
    },
    /// A few rates only, the same of both axes, and none.
    Discrete {
        /// The rates other than none, deg/s, from the slowest; each in both directions.
        deg_s: Vec<f64>,
    },
    /// None: the mount is only sent to places.
    Absent,
}

/// Side of the pier on which the telescope hangs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PierSide {
    /// East of the pier: it looks west.
    East,
    /// West of the pier: it looks east.
    West,
}

impl PierSide {
    /// The word for it in files.
    pub fn word(self) -> &'static str {
        match self {
            Self::East => "east",
            Self::West => "west",
        }
    }
}

/// Abilities of a mount.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct MountAbilities {
    /// The axes in which places and rates are given.
    pub axes: MountAxes,
    /// Axes about which it really turns; `None` where nobody says. A mount of azimuth and altitude may take right ascension and declination.
    pub turns_about: Option<MountAxes>,
    /// The rates that it takes.
    pub rates: MountRates,
    /// Slowest rate of each axis other than none, deg/s: a slower one is sent as the nearer of the two.
    pub least_deg_s: Axes,
    /// Whether it can be parked.
    pub parks: bool,
    /// Whether it can be told where it points.
    pub syncs: bool,
    /// Whether it says on which side of the pier it hangs: such a mount turns over at the meridian.
    pub tells_pier_side: bool,
    /// Whether it is known that it never turns over: a fork.
    pub is_fork: bool,
    /// Whether it says after a goto to an equatorial place that it follows the stars. One that then stands still was stopped.
    pub tells_tracking: bool,
    /// Whether its own software lifts places by refraction; `None` if it does not say.
    pub refracts: Option<bool>,
    /// Lowest and highest altitude to which it goes, deg, where it says so.
    pub altitude_deg: Option<Interval>,
}

impl MountAbilities {
    /// Abilities of a mount with these axes and rates that does nothing else.
    pub fn new(axes: MountAxes, rates: MountRates) -> Self {
        Self {
            axes,
            turns_about: Some(axes),
            rates,
            least_deg_s: Axes::default(),
            parks: false,
            syncs: false,
            tells_pier_side: false,
            is_fork: false,
            tells_tracking: false,
            refracts: None,
            altitude_deg: None,
        }
    }

    /// Whether it may turn over at the meridian: every equatorial mount of which the contrary is not known.
    pub fn may_turn_over(&self) -> bool {
        let upright = self.turns_about == Some(MountAxes::Horizontal);
        self.axes == MountAxes::Equatorial && !upright && !self.is_fork
    }

    /// Takes over what a person knows better than the driver.
    pub fn know(&mut self, known: &MountKnown) {
        self.turns_about = known.axes.or(self.turns_about);
        match known.german {
            Some(german) => self.is_fork = !german,
            None => self.is_fork |= known.axes == Some(MountAxes::Horizontal),
        }
        self.tells_pier_side &= !self.is_fork;
        match (known.most_deg_s, &mut self.rates) {
            (Some(limit), MountRates::Continuous { most_deg_s }) => {
                *most_deg_s = most_deg_s.map(|most| most.min(limit));
            }
            (Some(limit), MountRates::Discrete { deg_s }) => deg_s.retain(|rate| *rate <= limit),
            _ => {}
        }
        if let Some(least) = known.least_deg_s {
            self.least_deg_s = self.least_deg_s.map(|own| own.max(least));
        }
    }

    /// A rate of an axis as the mount takes it, deg/s: the nearest of those that it has; one that is slower than its slowest is the nearer of that and none.
    pub fn taken_deg_s(&self, axis: usize, deg_s: f64) -> f64 {
        let (size, least) = (deg_s.abs(), self.least_deg_s[axis]);
        if let MountRates::Discrete { deg_s: steps } = &self.rates {
            let off = |rate: &f64| (rate - size).abs();
            let nearest = steps.iter().copied().min_by(|a, b| off(a).total_cmp(&off(b)));
            return nearest.filter(|rate| off(rate) < size).unwrap_or(0.0).copysign(deg_s);
        }
        match size {
            size if size >= least => deg_s,
            size if size >= 0.5 * least => least.copysign(deg_s),
            _ => 0.0,
        }
    }

    /// The largest rates of the two axes, deg/s; `None` without continuous rates.
    pub fn continuous_deg_s(&self) -> Option<Axes> {
        match self.rates {
            MountRates::Continuous { most_deg_s } => Some(most_deg_s),
            _ => None,
        }
    }

    /// The fastest rates of the two axes, deg/s; `None` of a mount that takes no rates.
    pub fn fastest_deg_s(&self) -> Option<Axes> {
        match &self.rates {
            MountRates::Continuous { most_deg_s } => Some(*most_deg_s),
            MountRates::Discrete { deg_s } => deg_s.last().map(|most| [*most, *most].into()),
            MountRates::Absent => None,
        }
    }

    /// Widest gap between neighbouring rates up to one, deg/s; `None` without gaps.
    pub fn step_deg_s(&self, up_to_deg_s: f64) -> Option<f64> {
        let MountRates::Discrete { deg_s } = &self.rates else { return None };
        let mut last = 0.0;
        let mut widest = 0.0_f64;
        for rate in deg_s {
            widest = widest.max(rate - last);
            if *rate >= up_to_deg_s {
                break;
            }
            last = *rate;
        }
        Some(widest)
    }
}

/// Facts about a mount that a person knows better than its driver.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MountKnown {
    /// Axes about which it really turns.
    pub axes: Option<MountAxes>,
    /// Whether it is a German mount; false of a fork.
    pub german: Option<bool>,
    /// Fastest rate that its motors do, deg/s: some drivers publish more.
    pub most_deg_s: Option<f64>,
    /// Slowest rate other than none that it takes, deg/s.
    pub least_deg_s: Option<f64>,
}

/// Time that a mount reckons with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MountTime {
    /// When it said so.
    pub utc: Epoch,
    /// The clock.
    pub clock: MountClock,
}

/// Clock of a mount.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MountClock {
    /// Local sidereal time, deg.
    SiderealDeg(f64),
    /// UTC that it was told or began with: it may be old, but never ahead.
    SetTo(Epoch),
}

/// Place on the sky, as mounts are told and tell it. Both are true (unrefracted) or not as the mount takes it: it is told what it should show.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MountPlace {
    /// Equator and equinox of date, topocentric.
    Equatorial {
        /// Right ascension, deg, 0 to 360.
        ra_deg: f64,
        /// Declination, deg.
        dec_deg: f64,
    },
    /// At the site.
    Horizontal {
        /// Azimuth, deg, north 0, east 90.
        azimuth_deg: f64,
        /// Altitude, deg.
        altitude_deg: f64,
    },
}

/// State of a mount's motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MountMotion {
    /// Parked: it takes no command but to unpark.
    Parked,
    /// Stands still on the ground.
    Still,
    /// On its way to a place.
    Slewing,
    /// Follows the stars, or rates that it was given.
    Tracking,
}

/// Reading of a mount.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MountReading {
    /// Time at which it stood there, as well as that is known: when its answer came.
    pub utc: Epoch,
    /// Where it points.
    pub place: MountPlace,
    /// Side of the pier, where it says it: the last one that it said.
    pub pier: Option<PierSide>,
    /// Motion.
    pub motion: MountMotion,
}

impl MountReading {
    /// The reading as settings of the device, with the fastest rate that both axes have.
    pub fn settings(&self, abilities: &MountAbilities) -> Vec<Setting> {
        let origin = Origin::ReadBack;
        let mut settings = Vec::new();
        let mut add = |name, value| settings.push(Setting { name, value, origin });
        match self.place {
            MountPlace::Equatorial { ra_deg, dec_deg } => {
                add("ra_deg", Value::Number(ra_deg));
                add("dec_deg", Value::Number(dec_deg));
            }
            MountPlace::Horizontal { azimuth_deg, altitude_deg } => {
                add("azimuth_deg", Value::Number(azimuth_deg));
                add("altitude_deg", Value::Number(altitude_deg));
            }
        }
        add("motion", Value::Text(format!("{:?}", self.motion).to_lowercase()));
        if let Some(pier) = self.pier {
            add("pier_side", Value::Text(pier.word().into()));
        }
        if let Some(Axes { first: primary, second: secondary }) = abilities.fastest_deg_s() {
            add("most_rate_deg_s", Value::Number(primary.min(secondary)));
        }
        settings
    }
}

/// Site that a mount believes to stand at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MountSite {
    /// Geodetic latitude, deg.
    pub latitude_deg: f64,
    /// Longitude, deg, positive in the east, −180 to 180.
    pub longitude_deg: f64,
    /// Height, m.
    pub height_m: f64,
}

/// A telescope mount. No call waits for a motion to end: what it does is in its [`reading`](Self::reading), so that whoever moves it can watch it.
///
/// A call that sets something in motion is not safe by itself: it knows nothing of the Sun or of the horizon. `sunglint_observatory::telescope`
/// asks before it calls.
pub trait Mount: Device {
    /// Abilities of the mount.
    fn abilities(&self) -> &MountAbilities;

    /// Takes over what a person knows better than the driver; before the first motion.
    fn know(&mut self, known: &MountKnown);

    /// Reads where it points. The call may wait for the mount's next report, so that the time is that of the place.
    ///
    /// # Errors
    /// See [`DeviceError`].
    fn reading(&mut self, deadline: &Deadline) -> Result<MountReading, DeviceError>;

    /// Sends it to a place, on which it then follows the stars (equatorial places) or stands (horizontal ones).
    ///
    /// # Errors
    /// It refuses, or see [`DeviceError`].
    fn begin_goto(&mut self, place: MountPlace, deadline: &Deadline) -> Result<(), DeviceError>;

    /// Tells it that it points there now.
    ///
    /// # Errors
    /// It cannot, or see [`DeviceError`].
    fn sync(&mut self, place: MountPlace, deadline: &Deadline) -> Result<(), DeviceError>;

    /// Switches the following of the stars on or off.
    ///
    /// # Errors
    /// See [`DeviceError`].
    fn set_tracking(&mut self, on: bool, deadline: &Deadline) -> Result<(), DeviceError>;

    /// Finds out which way the axes turn, by a short move where this has to be tried. To be called after each goto and before the first
    /// [`set_rates`](Self::set_rates); it ends with rates of zero. `beat` is called between its steps: it takes seconds, and a watchdog wants a sign of life.
    ///
    /// # Errors
    /// The mount does not move as it is told, or see [`DeviceError`].
    fn learn_senses(&mut self, beat: &dyn Fn(), deadline: &Deadline) -> Result<(), DeviceError>;

    /// Moves both axes at these rates from now on, deg/s: hour angle and declination, or azimuth and altitude, as the place grows. On another side of the pier than that on
    /// which the senses were learnt, rates other than zero are refused ([`DeviceError::NotReady`]).
    ///
    /// # Errors
    /// Rates that it does not take, senses that are not known, or see [`DeviceError`].
    fn set_rates(&mut self, deg_s: [f64; 2], deadline: &Deadline) -> Result<(), DeviceError>;

    /// Stops every motion, the following of the stars among it.
    ///
    /// # Errors
    /// See [`DeviceError`]; it may still be moving.
    fn stop(&mut self, deadline: &Deadline) -> Result<(), DeviceError>;

    /// Sends it to its park position, or frees it from there.
    ///
    /// # Errors
    /// It cannot, or see [`DeviceError`].
    fn set_parked(&mut self, parked: bool, deadline: &Deadline) -> Result<(), DeviceError>;

    /// Site that it believes to stand at; `None` if it says none.
    ///
    /// # Errors
    /// See [`DeviceError`].
    fn site(&mut self, deadline: &Deadline) -> Result<Option<MountSite>, DeviceError>;

    /// Time that it reckons with; `None` if it says none.
    ///
    /// # Errors
    /// See [`DeviceError`].
    fn time(&mut self, deadline: &Deadline) -> Result<Option<MountTime>, DeviceError>;

    /// Tells it site and time.
    ///
    /// # Errors
    /// See [`DeviceError`].
    fn set_site(
        &mut self,
        site: MountSite,
        utc: Epoch,
        deadline: &Deadline,
    ) -> Result<(), DeviceError>;
}

/// Spot of light in a frame of a [`Finder`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spot {
    /// Offset from the telescope's axis, arcsec, in the tangent plane: towards growing first axis (hour angle or azimuth), and towards growing second axis
    /// (declination or altitude).
    pub offset_arcsec: DVec2,
    /// Brightness, in any unit.
    pub flux: f64,
}

/// Frame of a [`Finder`].
#[derive(Debug, Clone, PartialEq)]
pub struct FinderFrame {
    /// Middle of the exposure.
    pub middle: Epoch,
    /// The spots in it, the brightest first.
    pub spots: Vec<Spot>,
}

/// A camera on a mount that says where the lights stand that it sees.
pub trait Finder: Send {
    /// Half the width of its field, deg.
    fn half_width_deg(&self) -> f64;

    /// Side of the pier on which its offsets grow with the mount's axes; on the other side, where a German mount looks with the camera upside down, they grow against
    /// them. `None` where they always grow with the axes.
    fn side(&self) -> Option<PierSide> {
        None
    }

    /// The last frame that is finished, if it was not given yet. The call does not wait.
    ///
    /// # Errors
    /// See [`DeviceError`].
    fn frame(&mut self, deadline: &Deadline) -> Result<Option<FinderFrame>, DeviceError>;
}
