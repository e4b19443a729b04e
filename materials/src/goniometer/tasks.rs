//! Everything that a run measures, in its order: the instrument, the zeros, the directions.

use super::bench::Bench;
use super::channels::Reads;
use super::pose::{Angles, Kinematics, Pose};
use crate::plan::Planned;
use crate::plan::order::shortest_by;
use serde::Serialize;
use sunglint_drivers::device::InBeam;

/// A part of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Part {
    /// The beam is blocked.
    Dark,
    /// The beam straight into the detector.
    Beam,
    /// The scan through the beam in the plane of incidence.
    SignatureIn,
    /// The scan through the beam across that plane.
    SignatureOut,
    /// Stray light: no sample, the beam in a trap.
    Floor,
    /// The scan through the sample's lobe, lit from one side.
    ZeroPlus,
    /// The scan through the sample's lobe, lit from the other side.
    ZeroMinus,
    /// The reference direction.
    Reference,
    /// A direction of the plan.
    Direction,
}

impl Part {
    const ALL: [(Self, &'static str); 9] = [
        (Self::Dark, "dark"),
        (Self::Beam, "beam"),
        (Self::SignatureIn, "signature_in"),
        (Self::SignatureOut, "signature_out"),
        (Self::Floor, "floor"),
        (Self::ZeroPlus, "zero_plus"),
        (Self::ZeroMinus, "zero_minus"),
        (Self::Reference, "reference"),
        (Self::Direction, "direction"),
    ];

    /// Name of the part in a table.
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(part, _)| *part == self).map_or("", |(_, name)| name)
    }

    /// The part of a name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.iter().find(|(_, known)| *known == name).map(|(part, _)| *part)
    }

    /// State of the beam during this part.
    #[must_use]
    pub fn place(self) -> InBeam {
        match self {
            Self::Dark => InBeam::Blocked,
            Self::Beam | Self::SignatureIn | Self::SignatureOut => InBeam::Through,
            Self::Floor => InBeam::Nothing,
            Self::ZeroPlus | Self::ZeroMinus | Self::Reference | Self::Direction => InBeam::Sample,
        }
    }
}

/// One measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Task {
    /// Which part.
    pub part: Part,
    /// Number within the part; of a direction the plan's step.
    pub number: u32,
    /// Where the stages go, degrees.
    pub stages: Angles,
}

/// Everything that a run measures.
#[derive(Debug, Clone, PartialEq)]
pub struct Tasks {
    /// In their order.
    pub tasks: Vec<Task>,
    /// Directions of the plan that the bench does not reach.
    pub unreachable: Vec<Planned>,
    /// Parts of the instrument that are not measured, in words.
    pub missing: Vec<String>,
    /// Time by settling, readings and the axes' speeds, s.
    pub estimate_s: f64,
    /// Time that the axes would move in the plan's own order, s.
    pub unordered_s: f64,
    /// Time that they move in this order, s.
    pub moving_s: f64,
}

/// References that are read when a run goes on have numbers from here.
pub const RESUMED: u32 = 1_000_000;
/// Time of a reading for the estimate, s.
const READING_S: f64 = 0.15;

fn range(from: f64, to: f64, step: f64) -> Vec<f64> {
    let count = ((to - from) / step + 1e-6).floor().max(0.0) as usize;
    (0..=count).map(|k| from + step * k as f64).collect()
}

/// Lists what a run measures.
#[must_use]
pub fn tasks(bench: &Bench, kinematics: &Kinematics, planned: &[Planned]) -> Tasks {
    let axes = bench.all_axes();
    let speed = [0, 1, 2, 3].map(|k| axes[k].as_ref().map_or(1.0, |a| a.speed_deg_per_s.get()));
    // One axis moves after the other.
    let way = |a: &Angles, b: &Angles| -> f64 {
        (0..4).map(|k| (a[k].unwrap_or(0.0) - b[k].unwrap_or(0.0)).abs() / speed[k]).sum()
    };
    let mut list = List { kinematics, tasks: Vec::new(), missing: Vec::new() };
    let straight = bench.signature.theta_i_deg.get();
    let through = |detector: f64, azimuth: f64| {
        kinematics.stages([straight, 180.0 - straight + detector, azimuth, 0.0])
    };
    let beam = through(0.0, 0.0);
    // A spectrometer's dark is one of each integration.
    let darks = darks(bench);
    for number in 0..darks {
        list.tasks.push(Task { part: Part::Dark, number, stages: beam });
    }
    list.add(Part::Beam, beam);
    if bench.signature.measure {
        let (half, step) = (bench.signature.half_width_deg.get(), bench.signature.step_deg.get());
        let scan = range(-half, half, step);
        let all = scan.iter().map(|x| through(*x, 0.0)).collect();
        list.scan(Part::SignatureIn, all, "the signature in the plane of incidence");
        if kinematics.has(2) && (straight - 90.0).abs() < 1e-6 {
            let all = scan.iter().map(|x| through(0.0, *x)).collect();
            list.scan(Part::SignatureOut, all, "the signature across the plane of incidence");
        } else {
            list.missing.push("the signature across the plane of incidence".into());
        }
    } else {
        list.missing.push("the signature".into());
    }
    if bench.floor.measure {
        let most = bench.reach.most_theta_o_deg.get();
        let poses = range(-most, most, bench.floor.step_deg.get());
        let seen = |deg: &f64| deg.abs() >= bench.reach.least_phase_deg.get();
        let poses = poses.into_iter().filter(seen).map(|deg| Pose::in_plane(0.0, deg));
        let all: Vec<Angles> = poses.filter_map(|pose| kinematics.of(&pose)).collect();
        list.scan(Part::Floor, all, "stray light");
    } else {
        list.missing.push("stray light".into());
    }
    // Once more just before the sample comes: the lamp may have changed.
    list.tasks.push(Task { part: Part::Beam, number: 1, stages: beam });
    let reference = kinematics
        .of(&Pose::in_plane(bench.reference.theta_i_deg.get(), bench.reference.theta_o_deg.get()));
    if reference.is_none() {
        list.missing.push("the reference direction (out of reach): the lamp's drift".into());
    }
    let mut looks = 0;
    let mut look = |list: &mut List<'_>| {
        if let Some(stages) = reference {
            list.tasks.push(Task { part: Part::Reference, number: looks, stages });
            looks += 1;
        }
    };
    look(&mut list);
    if bench.zero.measure {
        let theta = bench.zero.theta_i_deg.get();
        let (half, step) = (bench.zero.half_width_deg.get(), bench.zero.step_deg.get());
        let scan = range(-half, half, step);
        let plus: Vec<Angles> =
            scan.iter().map(|x| kinematics.stages([theta, theta + x, 0.0, 0.0])).collect();
        let minus: Vec<Angles> =
            scan.iter().map(|x| kinematics.stages([-theta, -theta - x, 0.0, 0.0])).collect();
        let all_there = plus.iter().chain(&minus).all(|stages| kinematics.reaches(stages));
        if all_there {
            list.scan(Part::ZeroPlus, plus, "the axes' zeros");
            list.scan(Part::ZeroMinus, minus, "the axes' zeros");
        } else {
            list.missing.push("the axes' zeros (a stage does not reach both sides)".into());
        }
    } else {
        list.missing.push("the axes' zeros".into());
    }
    let (places, unreachable) = reachable(bench, kinematics, planned);
    let unordered_s = places.windows(2).map(|pair| way(&pair[0].1, &pair[1].1)).sum();
    let mut moving_s = 0.0;
    let mut stands = reference.unwrap_or(beam);
    look(&mut list);
    let mut first = 0;
    let mut since = 0;
    while first < places.len() {
        let same = |p: &(&Planned, Angles)| {
            p.0.theta_i_deg == places[first].0.theta_i_deg
                && p.0.phi_i_deg == places[first].0.phi_i_deg
        };
        let group: Vec<&(&Planned, Angles)> =
            places[first..].iter().take_while(|p| same(p)).collect();
        let start = |k: usize| way(&group[k].1, &stands);
        let order = shortest_by(group.len(), &start, &|a, b| way(&group[a].1, &group[b].1));
        for k in order {
            if since >= bench.scan.reference_every {
                look(&mut list);
                since = 0;
            }
            let (planned, stages) = *group[k];
            moving_s += way(&stages, &stands);
            stands = stages;
            let number = u32::try_from(planned.step).unwrap_or(u32::MAX);
            list.tasks.push(Task { part: Part::Direction, number, stages });
            since += 1;
        }
        first += group.len();
    }
    look(&mut list);
    list.tasks.push(Task { part: Part::Beam, number: 2, stages: beam });
    for number in darks..2 * darks {
        list.tasks.push(Task { part: Part::Dark, number, stages: beam });
    }
    let List { tasks, missing, .. } = list;
    let all_moves: f64 = tasks.windows(2).map(|pair| way(&pair[0].stages, &pair[1].stages)).sum();
    let estimate_s = reading_s(bench) * tasks.len() as f64 + all_moves;
    Tasks { tasks, unreachable, missing, estimate_s, unordered_s, moving_s }
}

struct List<'a> {
    kinematics: &'a Kinematics,
    tasks: Vec<Task>,
    missing: Vec<String>,
}

impl List<'_> {
    fn add(&mut self, part: Part, stages: Angles) {
        self.tasks.push(Task { part, number: 0, stages });
    }

    /// A scan whose parts are all within reach, or the word that it is missing.
    fn scan(&mut self, part: Part, all: Vec<Angles>, name: &str) {
        if all.is_empty() || !all.iter().all(|stages| self.kinematics.reaches(stages)) {
            self.missing.push(format!("{name} (a stage does not reach it)"));
            return;
        }
        for (number, stages) in all.into_iter().enumerate() {
            let number = u32::try_from(number).unwrap_or(u32::MAX);
            self.tasks.push(Task { part, number, stages });
        }
    }
}

type Places<'a> = Vec<(&'a Planned, Angles)>;

fn reachable<'a>(
    bench: &Bench,
    kinematics: &Kinematics,
    planned: &'a [Planned],
) -> (Places<'a>, Vec<Planned>) {
    let (mut places, mut unreachable) = (Vec::new(), Vec::new());
    for one in planned {
        match stages(bench, kinematics, one) {
            Some(stages) => places.push((one, stages)),
            None => unreachable.push(*one),
        }
    }
    (places, unreachable)
}

/// Where the stages go for a direction of a plan; none where the bench does not reach it.
pub(super) fn stages(bench: &Bench, kinematics: &Kinematics, planned: &Planned) -> Option<Angles> {
    let reach = &bench.reach;
    let pose = Pose::from(planned);
    // An incidence at the edge of the reach is not lost to rounding.
    let within = pose.theta_i_deg <= reach.most_theta_i_deg.get() + 1e-9
        && pose.theta_o_deg <= reach.most_theta_o_deg.get() + 1e-9
        && pose.phase_deg() >= reach.least_phase_deg.get() - 1e-9;
    kinematics.of(&pose).filter(|_| within)
}

/// Measurements of the dark at each end of a run: one for each integration of a spectrometer.
#[must_use]
pub fn darks(bench: &Bench) -> u32 {
    match &bench.reads {
        Reads::Spectrometer(plan) => plan.integrations_s().len() as u32,
        _ => 1,
    }
}

/// Time of a measurement without the way to it, s.
pub(super) fn reading_s(bench: &Bench) -> f64 {
    let readings = f64::from(bench.scan.readings);
    let interval_s = bench.scan.interval_s.get();
    let by_meter = bench.meter.settle_s.get() + readings * (READING_S + interval_s);
    match &bench.reads {
        Reads::Meter => by_meter,
        Reads::Monochromator(plan) => bench.bands.len() as f64 * (plan.move_s.get() + by_meter),
        Reads::Spectrometer(plan) => {
            // One that chooses takes the middle one of its integrations. Before each spectrum the spectrometer throws one away.
            let all = plan.integrations_s();
            let spectra_s = 2.0 * all[all.len() / 2] * f64::from(plan.average);
            plan.settle_s.get() + readings * (spectra_s + interval_s)
        }
        Reads::Files(plan) => readings * (plan.each_s.get() + interval_s),
    }
}
