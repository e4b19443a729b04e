//! A rotation stage on an APT controller: its settings, its angles, and its traits. How it moves is in `motion`.

use super::DEVICE;
use super::link::{Link, LinkSettings, protocol};
use super::message::Id;
use crate::clock::Deadline;
use crate::device::{
    Device, DeviceError, Identity, Interrupted, Origin, RotationStage, Scale, Setting, Value,
};
use crate::transport::Bytes;
use std::time::Duration;
use sunglint_numerics::measured::Interval;

/// Model of a stage: what turns, and how its controller counts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Model {
    /// K10CR1: a stepper with its controller, 409,600 microsteps for 3°.
    K10cr1,
    /// K10CR2: the same, its successor; its name and scale are from memory, not from a document.
    K10cr2,
    /// PRM1Z8 (PRM1/MZ8) on a KDC101 or TDC001: a servo of 1919.6418578623391 counts a degree.
    Prm1z8,
    /// HDR50 on a BSC201: a stepper, 409,600 microsteps a turn behind a gear of 66.
    Hdr50,
    /// NR360 on a KST101 or BSC201: a stepper, 409,600 microsteps a turn behind a gear of 66.
    Nr360,
    /// NR360 on a BSC001, BSC101 or TST001, which divide steps less: 25,600 microsteps a turn behind a gear of 66.
    Nr360Coarse,
    /// DDR100 on a KBD101 or BBD controller: a servo of 3,276,800 counts a turn.
    Ddr100,
    /// DDR05: a servo of 2,000,000 counts a turn.
    Ddr05,
    /// DDR25: a servo of 1,440,000 counts a turn.
    Ddr25,
    /// Another stage.
    Other {
        /// Counts of a degree.
        counts_per_deg: f64,
        /// Whether its controller is one for servo motors; `None`: as the controller's name says.
        servo: Option<bool>,
    },
}

impl Model {
    /// All stages that have names.
    pub const NAMED: [Self; 9] = [
        Self::K10cr1,
        Self::K10cr2,
        Self::Prm1z8,
        Self::Hdr50,
        Self::Nr360,
        Self::Nr360Coarse,
        Self::Ddr100,
        Self::Ddr05,
        Self::Ddr25,
    ];

    /// Name of the model in options (`prm1z8`).
    pub fn name(self) -> &'static str {
        match self {
            Self::K10cr1 => "k10cr1",
            Self::K10cr2 => "k10cr2",
            Self::Prm1z8 => "prm1z8",
            Self::Hdr50 => "hdr50",
            Self::Nr360 => "nr360",
            Self::Nr360Coarse => "nr360-coarse",
            Self::Ddr100 => "ddr100",
            Self::Ddr05 => "ddr05",
            Self::Ddr25 => "ddr25",
            Self::Other { .. } => "other",
        }
    }

    /// The model of that name.
    pub fn named(name: &str) -> Option<Self> {
        Self::NAMED.into_iter().find(|model| model.name() == name)
    }

    /// The stage that is its own controller and gives this name; others' controllers do not know what they turn.
    fn of_controller(name: &str) -> Option<Self> {
        match name {
            "K10CR1" => Some(Self::K10cr1),
            "K10CR2" => Some(Self::K10cr2),
            _ => None,
        }
    }

    /// Counts of a degree.
    pub fn counts_per_deg(self) -> f64 {
        match self {
            Self::K10cr1 | Self::K10cr2 => 409_600.0 / 3.0,
            Self::Prm1z8 => 1_919.641_857_862_339,
            Self::Hdr50 | Self::Nr360 => 409_600.0 * 66.0 / 360.0,
            Self::Nr360Coarse => 25_600.0 * 66.0 / 360.0,
            Self::Ddr100 => 3_276_800.0 / 360.0,
            Self::Ddr05 => 2_000_000.0 / 360.0,
            Self::Ddr25 => 1_440_000.0 / 360.0,
            Self::Other { counts_per_deg, .. } => counts_per_deg,
        }
    }

    /// Whether its controller, which gives this name, is one for servo motors.
    pub fn is_servo(self, controller: &str) -> bool {
        match self {
            Self::Prm1z8 | Self::Ddr100 | Self::Ddr05 | Self::Ddr25 => true,
            Self::Other { servo, .. } => servo.unwrap_or_else(|| {
                ["KDC", "TDC", "ODC", "BDC", "KBD", "TBD", "BBD"]
                    .iter()
                    .any(|family| controller.starts_with(family))
            }),
            _ => false,
        }
    }
}

/// How far from its target a servo that stands may be, deg, unless the settings say otherwise. A servo hunts; the
/// bidirectional repeatability of a PRM1Z8 is given as 0.1°.
const SERVO_TOLERANCE_DEG: f64 = 0.005;

/// Settings that the driver needs for a stage.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StageSettings {
    /// Model of the stage: what turns; `None` if the stage names itself (K10CR1, K10CR2).
    pub model: Option<Model>,
    /// How far from its target a stage that stands may be, deg; `None`: 0 for steppers, 0.005° for servos.
    pub tolerance_deg: Option<f64>,
    /// Whether angles grow while the counter falls.
    pub inverted: bool,
    /// The angle at which the counter is 0, deg.
    pub zero_deg: f64,
    /// Angles between which it may stand, deg; `None` if it turns freely.
    pub travel_deg: Option<Interval>,
    /// How often a moving stage is asked where it is.
    pub poll: Duration,
    /// How long it may stand still on its way, or before a search begins.
    pub stall_after: Duration,
    /// How long stopping may take after a failed move: a call ends at most this long after its deadline.
    pub stop_within: Duration,
}

impl Default for StageSettings {
    /// A stage that names itself and turns freely.
    fn default() -> Self {
        Self {
            model: None,
            tolerance_deg: None,
            inverted: false,
            zero_deg: 0.0,
            travel_deg: None,
            poll: Duration::from_millis(100),
            stall_after: Duration::from_secs(1),
            stop_within: Duration::from_secs(3),
        }
    }
}

/// A rotation stage. Angles are rounded once, from the angle to the counter, and never added up.
#[derive(Debug)]
pub struct Stage<T> {
    pub(super) link: Link<T>,
    pub(super) settings: StageSettings,
    model: Model,
    pub(super) servo: bool,
    /// How far from its target it may stand, counts.
    pub(super) tolerance: u32,
    /// Take the counter as it is, homed or not.
    pub(super) trusted: bool,
}

impl<T: Bytes> Stage<T> {
    /// Asks the controller who it is, quietens what it would say by itself, and switches the channel on. Nothing moves.
    ///
    /// # Errors
    /// Settings without sense ([`DeviceError::OutOfRange`]); another model than the settings' one; a controller that does not
    /// answer, or see [`DeviceError`].
    pub fn open(
        line: T,
        link: LinkSettings,
        settings: StageSettings,
        deadline: &Deadline,
    ) -> Result<Self, DeviceError> {
        let mut link = Link::new(line, link);
        let info = link.info(deadline)?;
        let model = model(settings.model, &info.model)?;
        let scale = model.counts_per_deg();
        if !(scale.is_finite() && scale > 0.0) {
            let (least, most) = (f64::MIN_POSITIVE, f64::MAX);
            let name = "counts_per_deg";
            return Err(DeviceError::OutOfRange { name, asked: scale, least, most });
        }
        let servo = model.is_servo(&info.model);
        let tolerance_deg =
            settings.tolerance_deg.unwrap_or(if servo { SERVO_TOLERANCE_DEG } else { 0.0 });
        if !(0.0..=360.0).contains(&tolerance_deg) {
            let (name, asked) = ("tolerance_deg", tolerance_deg);
            return Err(DeviceError::OutOfRange { name, asked, least: 0.0, most: 360.0 });
        }
        // A cast of a number that is too large gives the largest.
        let tolerance = (tolerance_deg * scale).ceil() as u32;
        let quiet = [link.short(Id::NoFlashProgramming, 0), link.short(Id::StopUpdates, 0)];
        for message in &quiet {
            link.tell(message, deadline)?;
        }
        let mut stage = Self { link, settings, model, servo, tolerance, trusted: false };
        stage.enable(deadline)?;
        Ok(stage)
    }

    fn enable(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        for _ in 0..2 {
            let answer = self.link.ask(Id::RequestEnabled, Id::Enabled, deadline)?;
            if answer.emit().get(3) == Some(&1) {
                return Ok(());
            }
            let on = self.link.short(Id::SetEnabled, 1);
            self.link.tell(&on, deadline)?;
        }
        let answer = self.link.ask(Id::RequestEnabled, Id::Enabled, deadline)?;
        match answer.emit().get(3) {
            Some(1) => Ok(()),
            got => {
                let (asked, got) = ("1".to_owned(), format!("{got:?}"));
                Err(DeviceError::NotTaken { device: DEVICE, name: "channel_enabled", asked, got })
            }
        }
    }

    /// Takes the counter as it is: for a stage that cannot be homed.
    pub fn trust_counter(&mut self) {
        self.trusted = true;
    }

    /// The line to the controller.
    pub fn line(&self) -> &T {
        self.link.line()
    }

    /// The line to the controller; what is said on it behind the stage's back, the stage does not know.
    pub fn line_mut(&mut self) -> &mut T {
        self.link.line_mut()
    }

    /// The line to the controller.
    pub fn into_line(self) -> T {
        self.link.into_line()
    }

    pub(super) fn scale(&self) -> Scale {
        let StageSettings { inverted, zero_deg, travel_deg, .. } = self.settings;
        Scale { counts_per_deg: self.model.counts_per_deg(), inverted, zero_deg, travel_deg }
    }
}

/// The model of a stage whose controller gives this name. A wrong scale is a wrong angle: nothing is guessed.
fn model(told: Option<Model>, controller: &str) -> Result<Model, DeviceError> {
    let itself = Model::of_controller(controller);
    let (asked, known) = match (told, itself) {
        (Some(told @ Model::Other { .. }), _) => return Ok(told),
        (None, Some(model)) => return Ok(model),
        (Some(told), Some(model)) if told == model => return Ok(model),
        (Some(told), None) if !matches!(told, Model::K10cr1 | Model::K10cr2) => return Ok(told),
        (Some(told), Some(model)) => (told.name().to_owned(), model.name().to_owned()),
        (told, None) => {
            let on_it = Model::NAMED
                .into_iter()
                .filter(|model| !matches!(model, Model::K10cr1 | Model::K10cr2));
            let on_it: Vec<&str> = on_it.map(Model::name).collect();
            let asked =
                told.map_or_else(|| format!("a {controller}"), |told| told.name().to_owned());
            (asked, on_it.join(", "))
        }
    };
    let known = format!(
        "{known}: the stage that is there, on a {controller}; of another stage give counts_per_deg=NUMBER, its counts of a degree"
    );
    Err(DeviceError::Unknown { name: "model", asked, known })
}

impl<T: Bytes> Device for Stage<T> {
    fn identity(&mut self, deadline: &Deadline) -> Result<Identity, DeviceError> {
        let info = self.link.info(deadline)?;
        Ok(Identity {
            vendor: "Thorlabs".into(),
            model: info.model,
            serial: Some(info.serial.to_string()),
            firmware: Some(info.firmware),
            driver: "apt",
        })
    }

    fn settings(&mut self, deadline: &Deadline) -> Result<Vec<Setting>, DeviceError> {
        let scale = self.scale();
        let value = Value::Number(scale.counts_per_deg);
        let counts = Setting { name: "counts_per_deg", value, origin: Origin::Configured };
        let model = Setting {
            name: "model",
            value: Value::Text(self.model.name().to_owned()),
            origin: Origin::Configured,
        };
        let tolerance = Setting {
            name: "tolerance_counts",
            value: Value::Integer(self.tolerance.into()),
            origin: Origin::Configured,
        };
        let mut settings = [vec![counts, model, tolerance], scale.settings()].concat();
        let speeds = self.twice(Id::RequestSpeeds, Id::Speeds, deadline)?;
        let homing = self.twice(Id::RequestHoming, Id::Homing, deadline)?;
        for (name, message, at) in [
            ("acceleration_units", &speeds, 6),
            ("max_speed_units", &speeds, 10),
            ("homing_speed_units", &homing, 6),
            ("homing_offset_counts", &homing, 10),
        ] {
            let number = message.long_at(at).ok_or_else(|| protocol(format!("no {name}")))?;
            let value = Value::Integer(number.into());
            settings.push(Setting { name, value, origin: Origin::ReadBack });
        }
        Ok(settings)
    }
}

impl<T: Bytes> RotationStage for Stage<T> {
    fn travel_deg(&self) -> Option<Interval> {
        self.settings.travel_deg
    }

    fn angle_deg(&mut self, deadline: &Deadline) -> Result<f64, DeviceError> {
        let state = self.steady(deadline)?;
        self.require_reference(state)?;
        Ok(self.scale().angle(state.counter))
    }

    fn home(&mut self, deadline: &Deadline) -> Result<f64, Interrupted<Option<f64>>> {
        match self.search(deadline) {
            Ok(counter) => Ok(self.scale().angle(counter)),
            Err(error) => Err(self.stopped_by(error, deadline)),
        }
    }

    fn move_to(
        &mut self,
        angle_deg: f64,
        deadline: &Deadline,
    ) -> Result<f64, Interrupted<Option<f64>>> {
        // Nothing moves before this, and nothing has to be stopped.
        let target = self.target(angle_deg, deadline).map_err(|e| Interrupted::new(None, e))?;
        match self.go(target, deadline) {
            Ok(counter) => Ok(self.scale().angle(counter)),
            Err(error) => Err(self.stopped_by(error, deadline)),
        }
    }

    fn stop(&mut self, deadline: &Deadline) -> Result<(), DeviceError> {
        self.halt(deadline).map(|_| ())
    }
}
