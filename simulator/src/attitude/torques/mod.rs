//! Rigid bodies under torques: gravity gradient, magnetic moment, eddy currents, sunlight and air.
//!
//! The state is the attitude q (body → GCRS) and the angular momentum L in the GCRS: q̇ = ½ q ω with ω = I⁻¹ q⁻¹ L q, and L̇ the torque. So L changes by the
//! torque alone. It is integrated by Gauss' collocation with eight stages (order 16; Hairer, Nørsett, Wanner, Solving Ordinary Differential
//! Equations I, II.7), which keeps |q| by itself; the polynomial of a step gives the attitude at any moment of it to 1e-10. A step is
//! 0.7 rad of the fastest turn that the momentum allows.
//!
//! - [`laws`]: each torque as a formula;
//! - [`skin`]: pressure on the facets of a body, shadows included;
//! - [`field`]: the Earth's magnetic field;
//! - [`around`]: surroundings along an orbit;
//! - [`mass`]: inertia of a body of uniform density.

pub mod around;
pub mod field;
pub mod laws;
pub mod mass;
pub mod skin;

pub use around::{Along, Around, Density, Surroundings};
pub use laws::Conductor;
pub use skin::{Push, Skin};

use super::{AttitudeError, Inertia, seconds_between};
use crate::light::Evaluator;
use glam::{DMat3, DQuat, DVec3};
use hifitime::Epoch;
use std::sync::{Arc, OnceLock};
use sunglint_formats::time::format_utc_shortest;
use sunglint_numerics::gauss;

/// Stages of a step.
const STAGES: usize = 8;
/// A step turns the body by at most this, radians.
const STEP_RAD: f64 = 0.7;
/// The longest step, s: the Earth's shadow must not be stepped over.
const LONGEST_S: f64 = 20.0;
/// Rounds in which pressure on the surface is computed anew: the attitude is then right to 1e-6, and its torque is small.
const SURFACE_ROUNDS: usize = 3;
/// Nodes of the rule by which the momentum of pressure on the surface is summed up once more over halves of a step.
const FINER: usize = 4;
/// How far both sums may be apart, as a share of the momentum.
const SURFACE_ERROR: f64 = 1e-12;
/// How often a step is halved at a kink: the momentum that one adds shrinks with the square of the length.
const HALVINGS: u32 = 12;
/// More rounds mean that a step does not converge.
const MOST_ROUNDS: usize = 60;
/// More steps than this (200,000 turns) are not integrated.
pub const MOST_STEPS: f64 = 2e6;
/// More steps than this are not kept in memory (100 MB).
pub const MOST_KEPT: f64 = 2e5;

/// Names of the torques, in the order of [`Sizes`].
pub const TORQUES: [&str; 5] =
    ["gravity gradient", "magnetic moment", "eddy currents", "radiation pressure", "drag"];

/// A rigid body and the torques that act on it.
#[derive(Debug, Clone)]
pub struct Body {
    tensor: DMat3,
    inverse: DMat3,
    least_moment: f64,
    /// Whether the Earth's gravity gradient acts.
    pub gravity_gradient: bool,
    /// Magnetic moment, A m², body axes.
    pub moment_a_m2: DVec3,
    /// Body that eddy currents flow in.
    pub conductor: Option<Conductor>,
    /// Surface on which sunlight and air press.
    pub skin: Option<Arc<Skin>>,
    /// Whether sunlight presses.
    pub radiation: bool,
    /// Drag coefficient, where the air presses.
    pub drag: Option<f64>,
}

/// State of the motion at a moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// Body → GCRS.
    pub body_to_gcrs: DQuat,
    /// Angular momentum, kg m² rad/s, GCRS.
    pub momentum: DVec3,
}

/// Sizes of a torque along the motion.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Sizes {
    /// Whether it is modelled.
    pub modelled: bool,
    /// The largest, N m.
    pub largest_n_m: f64,
    /// The mean of its size, N m.
    pub mean_n_m: f64,
}

impl Body {
    /// Creates a body that no torque acts on yet. The moments of inertia are absolute here, kg m².
    pub fn new(inertia: &Inertia) -> Self {
        let tensor = inertia.tensor();
        Self {
            tensor,
            inverse: tensor.inverse(),
            least_moment: inertia.moments().x,
            gravity_gradient: false,
            moment_a_m2: DVec3::ZERO,
            conductor: None,
            skin: None,
            radiation: false,
            drag: None,
        }
    }

    /// The tensor in the body's axes, kg m².
    pub fn tensor(&self) -> DMat3 {
        self.tensor
    }

    /// Angular velocity in the body's axes, rad/s.
    pub fn omega_body_rad_s(&self, motion: &Motion) -> DVec3 {
        self.inverse * (motion.body_to_gcrs.conjugate() * motion.momentum)
    }

    /// Each of the [`TORQUES`] in a state, N m, body axes.
    ///
    /// # Errors
    /// A direction without length, as of a Sun that is nowhere.
    pub fn torques(&self, motion: &Motion, around: &Around) -> Result<[DVec3; 5], AttitudeError> {
        let mut evaluator = self.skin.as_ref().map(|s| s.evaluator());
        let [gravity, moment, eddy] = self.of_fields(motion, around);
        let [light, air] = self.of_surface(motion.body_to_gcrs, around, evaluator.as_mut())?;
        Ok([gravity, moment, eddy, light, air])
    }

    fn of_fields(&self, motion: &Motion, around: &Around) -> [DVec3; 3] {
        let to_body = motion.body_to_gcrs.conjugate();
        let mut torques = [DVec3::ZERO; 3];
        if self.gravity_gradient {
            torques[0] = laws::gravity_gradient(self.tensor, to_body * around.position_m);
        }
        if self.moment_a_m2 != DVec3::ZERO {
            torques[1] = laws::dipole(self.moment_a_m2, to_body * around.field_t);
        }
        if let Some(conductor) = &self.conductor {
            let omega = self.inverse * (to_body * motion.momentum);
            torques[2] =
                conductor.torque(omega, to_body * around.field_t, to_body * around.field_rate_t_s);
        }
        torques
    }

    fn of_surface(
        &self,
        body_to_gcrs: DQuat,
        around: &Around,
        evaluator: Option<&mut Evaluator<'_>>,
    ) -> Result<[DVec3; 2], AttitudeError> {
        let mut torques = [DVec3::ZERO; 2];
        let (Some(skin), Some(evaluator)) = (&self.skin, evaluator) else { return Ok(torques) };
        let to_body = body_to_gcrs.conjugate();
        let sun = to_body * around.to_sun;
        let fault = |e: crate::light::DirectionError| AttitudeError::Torques { why: e.to_string() };
        if self.radiation && around.pressure_pa > 0.0 {
            let push = skin.sunlight_in(evaluator, sun, around.pressure_pa).map_err(fault)?;
            torques[0] = push.torque_n_m;
        }
        if let Some(coefficient) = self.drag
            && around.air_kg_m3 > 0.0
        {
            let through = to_body * around.through_air_m_s;
            let push = skin
                .air_in(evaluator, through, sun, around.air_kg_m3 * coefficient)
                .map_err(fault)?;
            torques[1] = push.torque_n_m;
        }
        Ok(torques)
    }

    fn has_surface(&self) -> bool {
        self.skin.is_some() && (self.radiation || self.drag.is_some())
    }

    /// A bound of the rate at which the state changes, rad/s.
    fn rate_rad_s(&self, momentum: DVec3, around: &Around) -> f64 {
        let r = around.position_m.length();
        let swing =
            if self.gravity_gradient && r > 0.0 { 3.0 * laws::EARTH_GM / (r * r * r) } else { 0.0 };
        let needle = self.moment_a_m2.length() * around.field_t.length() / self.least_moment;
        let brake = self
            .conductor
            .map_or(0.0, |c| c.slow_s_m4() * around.field_t.length_squared() / self.least_moment);
        momentum.length() / self.least_moment + (swing + needle).sqrt() + brake
    }
}

/// Motion of a body under torques between two moments.
#[derive(Debug, Clone, PartialEq)]
pub struct Driven {
    epoch: Epoch,
    span_s: (f64, f64),
    /// In the order of time.
    steps: Vec<Step>,
    inverse: DMat3,
    sizes: [Sizes; 5],
}

/// A step with the slopes at its stages.
#[derive(Debug, Clone, PartialEq)]
struct Step {
    from_s: f64,
    /// Negative before the epoch.
    length_s: f64,
    attitude: DQuat,
    momentum: DVec3,
    slopes: [(DQuat, DVec3); STAGES],
    /// Momentum that pressure on the surface adds beside the slopes: edges of shadows are kinks, which the stages do not see.
    kick: DVec3,
}

/// Nodes, weights and integrals of the collocation.
struct Rule {
    nodes: [f64; STAGES],
    weights: [f64; STAGES],
    /// ∫₀^{c_i} ℓ_j.
    integrals: [[f64; STAGES]; STAGES],
    /// ℓ_j(1 + c_i): a step's slopes carried into the next.
    onward: [[f64; STAGES]; STAGES],
    /// Nodes in −1…1 and weights of the rule for halves.
    finer: Vec<(f64, f64)>,
}

impl Rule {
    fn get() -> &'static Self {
        static RULE: OnceLock<Rule> = OnceLock::new();
        RULE.get_or_init(|| {
            let gauss = gauss::legendre(STAGES);
            let nodes: [f64; STAGES] = std::array::from_fn(|i| 0.5 * (1.0 + gauss[i].0));
            let weights = std::array::from_fn(|i| 0.5 * gauss[i].1);
            let mut rule = Self {
                nodes,
                weights,
                integrals: [[0.0; STAGES]; STAGES],
                onward: [[0.0; STAGES]; STAGES],
                finer: gauss::legendre(FINER),
            };
            for (i, node) in nodes.iter().enumerate() {
                let (integrals, onward) = (rule.integrals_to(*node), rule.cardinal(1.0 + node));
                rule.integrals[i] = integrals;
                rule.onward[i] = onward;
            }
            rule
        })
    }

    /// Lagrange's polynomials of the nodes.
    fn cardinal(&self, x: f64) -> [f64; STAGES] {
        std::array::from_fn(|j| {
            (0..STAGES)
                .filter(|m| *m != j)
                .map(|m| (x - self.nodes[m]) / (self.nodes[j] - self.nodes[m]))
                .product()
        })
    }

    /// ∫₀ˣ ℓ_j, exact by the rule itself.
    fn integrals_to(&self, x: f64) -> [f64; STAGES] {
        let mut sum = [0.0; STAGES];
        for (node, weight) in self.nodes.iter().zip(&self.weights) {
            let values = self.cardinal(x * node);
            sum.iter_mut().zip(values).for_each(|(s, v)| *s += x * weight * v);
        }
        sum
    }
}

/// Start of a motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Start {
    /// When.
    pub epoch: Epoch,
    /// Body → GCRS then.
    pub body_to_gcrs: DQuat,
    /// Angular velocity against the GCRS then, rad/s, body axes.
    pub omega_body_rad_s: DVec3,
}

impl Driven {
    /// Integrates the motion from its start over a span of time, s after the epoch of the start, which may lie before, in or after it. What
    /// lies outside the span is integrated but not kept.
    ///
    /// # Errors
    /// An angular velocity that is not finite or too fast; more steps than [`MOST_STEPS`] or [`MOST_KEPT`]; a step that does not converge.
    pub fn new(
        body: &Body,
        start: &Start,
        surroundings: &dyn Surroundings,
        span_s: (f64, f64),
    ) -> Result<Self, AttitudeError> {
        if !start.omega_body_rad_s.is_finite() {
            return Err(AttitudeError::NotFinite { what: "the angular velocity" });
        }
        let turns_per_s = start.omega_body_rad_s.length() / std::f64::consts::TAU;
        // Written so that a length that overflows is refused too.
        if turns_per_s.is_nan() || turns_per_s > super::MOST_TURNS_PER_S {
            return Err(AttitudeError::TooFast { what: "the angular velocity", turns_per_s });
        }
        if !(span_s.0.is_finite() && span_s.1.is_finite() && span_s.0 <= span_s.1) {
            return Err(AttitudeError::NotFinite { what: "the span of the motion" });
        }
        let motion = Motion {
            body_to_gcrs: start.body_to_gcrs.normalize(),
            momentum: start.body_to_gcrs.normalize() * (body.tensor * start.omega_body_rad_s),
        };
        let mut way = Way::new(body, surroundings, span_s);
        let mut steps = way.follow(motion, span_s.0.min(0.0))?;
        steps.reverse();
        steps.extend(way.follow(motion, span_s.1.max(0.0))?);
        Ok(Self { epoch: start.epoch, span_s, steps, inverse: body.inverse, sizes: way.sizes() })
    }

    /// Time span that is known, s after the epoch.
    pub fn span_s(&self) -> (f64, f64) {
        self.span_s
    }

    /// The epoch that times count from.
    pub fn epoch(&self) -> Epoch {
        self.epoch
    }

    /// Sizes of the [`TORQUES`] along the span.
    pub fn sizes(&self) -> &[Sizes; 5] {
        &self.sizes
    }

    /// Number of steps that are kept.
    pub fn steps(&self) -> usize {
        self.steps.len()
    }

    /// The state so many seconds after the epoch; `None` outside the span.
    pub fn motion(&self, after_s: f64) -> Option<Motion> {
        // Rounding of a time that was turned into an epoch and back.
        const SLACK_S: f64 = 1e-6;
        // Written so that NaN is outside too.
        if !(after_s >= self.span_s.0 - SLACK_S && after_s <= self.span_s.1 + SLACK_S) {
            return None;
        }
        let low = |s: &Step| s.from_s.min(s.from_s + s.length_s);
        let after = self.steps.partition_point(|s| low(s) <= after_s);
        let step = self.steps.get(after.max(1) - 1)?;
        let x = (after_s - step.from_s) / step.length_s;
        let (mut attitude, mut momentum) = (step.attitude, step.momentum);
        for (w, (q, l)) in Rule::get().integrals_to(x).iter().zip(&step.slopes) {
            attitude += *q * (w * step.length_s);
            momentum += *l * (w * step.length_s);
        }
        Some(Motion { body_to_gcrs: attitude.normalize(), momentum: momentum + x * step.kick })
    }

    /// Angular velocity in the body's axes, rad/s; `None` outside the span.
    pub fn omega_body_rad_s(&self, after_s: f64) -> Option<DVec3> {
        let motion = self.motion(after_s)?;
        Some(self.inverse * (motion.body_to_gcrs.conjugate() * motion.momentum))
    }

    /// The rotation from body axes to the GCRS.
    ///
    /// # Errors
    /// [`AttitudeError::NotFollowed`] outside the span.
    pub fn body_to_gcrs(&self, epoch: Epoch) -> Result<DQuat, AttitudeError> {
        let motion = self.motion(seconds_between(self.epoch, epoch));
        motion.map(|m| m.body_to_gcrs).ok_or_else(|| {
            let at = |s: f64| format_utc_shortest(self.epoch + hifitime::Duration::from_seconds(s));
            AttitudeError::NotFollowed {
                epoch: format_utc_shortest(epoch),
                first: at(self.span_s.0),
                last: at(self.span_s.1),
            }
        })
    }
}

/// An integration under way.
struct Way<'a> {
    body: &'a Body,
    surroundings: &'a dyn Surroundings,
    evaluator: Option<Evaluator<'a>>,
    span_s: (f64, f64),
    taken: f64,
    kept: f64,
    /// Sums of sizes times seconds, and the largest.
    sums: [(f64, f64); 5],
    seconds: f64,
}

impl<'a> Way<'a> {
    fn new(body: &'a Body, surroundings: &'a dyn Surroundings, span_s: (f64, f64)) -> Self {
        let skin = if body.has_surface() { body.skin.as_deref() } else { None };
        Self {
            body,
            surroundings,
            evaluator: skin.map(|s| s.evaluator()),
            span_s,
            taken: 0.0,
            kept: 0.0,
            sums: [(0.0, 0.0); 5],
            seconds: 0.0,
        }
    }

    fn sizes(&self) -> [Sizes; 5] {
        let b = self.body;
        let modelled = [
            b.gravity_gradient,
            b.moment_a_m2 != DVec3::ZERO,
            b.conductor.is_some(),
            b.radiation && b.skin.is_some(),
            b.drag.is_some() && b.skin.is_some(),
        ];
        std::array::from_fn(|i| Sizes {
            modelled: modelled[i],
            largest_n_m: self.sums[i].1,
            mean_n_m: if self.seconds > 0.0 { self.sums[i].0 / self.seconds } else { 0.0 },
        })
    }

    /// From the epoch to a time; the steps that touch the span, from the epoch on.
    fn follow(&mut self, mut motion: Motion, to_s: f64) -> Result<Vec<Step>, AttitudeError> {
        let mut steps: Vec<Step> = Vec::new();
        let (mut at_s, mut length_s) = (0.0_f64, 0.0_f64);
        let mut before: Option<Step> = None;
        while at_s != to_s {
            let around = self.surroundings.at(at_s);
            let rate = self.body.rate_rad_s(motion.momentum, &around)
                + 2.0 * self.surroundings.rate_rad_s();
            let wanted = (STEP_RAD / rate).min(LONGEST_S);
            let left = to_s - at_s;
            let more = left.abs() / wanted;
            if self.taken + more > MOST_STEPS {
                return Err(AttitudeError::Torques {
                    why: format!(
                        "{:.0} s of motion take {:.1e} steps, at most {MOST_STEPS:.0e} are integrated: give an attitude whose epoch is nearer to the pass, or leave slow torques out (law = \"tumble\")",
                        left.abs(),
                        self.taken + more
                    ),
                });
            }
            // A step that stays as it is lets the next one start from the last one's slopes.
            if length_s == 0.0 || !(0.8..=1.0).contains(&(length_s.abs() / wanted)) {
                length_s = (0.9 * wanted).copysign(left);
            }
            if length_s.abs() >= left.abs() {
                length_s = left;
            }
            let step = self.step(at_s, length_s, &motion, &around, before.as_ref())?;
            motion = step.end();
            self.measure(&step, &around)?;
            // The last step ends where it should, to the bit.
            at_s = if length_s == left { to_s } else { at_s + length_s };
            self.taken += 1.0;
            let (low, high) = (step.from_s.min(at_s), step.from_s.max(at_s));
            if high >= self.span_s.0 && low <= self.span_s.1 {
                self.kept += 1.0;
                if self.kept > MOST_KEPT {
                    return Err(AttitudeError::Torques {
                        why: format!(
                            "more than {MOST_KEPT:.0e} steps lie between the first and the last moment that is asked for: simulate a shorter stretch"
                        ),
                    });
                }
                steps.push(step.clone());
            }
            before = Some(step);
        }
        // A span that is the epoch alone still has a step to be read from.
        if steps.is_empty() && to_s == 0.0 && self.span_s == (0.0, 0.0) {
            let around = self.surroundings.at(0.0);
            steps.push(self.step(0.0, 1e-3, &motion, &around, None)?);
        }
        Ok(steps)
    }

    /// Momentum from pressure on the surface over a part of a step, N m s: Gauss's rule of [`FINER`] nodes in halves of halves, until they agree with what the whole has.
    fn surface(
        &mut self,
        step: &Step,
        (a, b): (f64, f64),
        whole: DVec3,
        most: f64,
        halvings: u32,
    ) -> Result<DVec3, AttitudeError> {
        let rule = Rule::get();
        let middle = 0.5 * (a + b);
        let mut halves = [DVec3::ZERO; 2];
        for (sum, (a, b)) in halves.iter_mut().zip([(a, middle), (middle, b)]) {
            for (node, weight) in &rule.finer {
                let x = 0.5 * (a + b + node * (b - a));
                let weights = rule.integrals_to(x);
                let turn = (step.attitude + combined(&weights, &step.slopes).0 * step.length_s)
                    .normalize();
                let around = self.surroundings.at(step.from_s + x * step.length_s);
                let [light, air] = self.body.of_surface(turn, &around, self.evaluator.as_mut())?;
                *sum += turn * (light + air) * (0.5 * weight * (b - a) * step.length_s);
            }
        }
        let [left, right] = halves;
        if (left + right - whole).length() <= most || halvings == 0 {
            return Ok(left + right);
        }
        // A kink lies in one of them: the other one needs no less.
        Ok(self.surface(step, (a, middle), left, most, halvings - 1)?
            + self.surface(step, (middle, b), right, most, halvings - 1)?)
    }

    /// Adds up the sizes of torques, where they count.
    fn measure(&mut self, step: &Step, around: &Around) -> Result<(), AttitudeError> {
        let end_s = step.from_s + step.length_s;
        if end_s.max(step.from_s) < self.span_s.0 || end_s.min(step.from_s) > self.span_s.1 {
            return Ok(());
        }
        let motion = Motion { body_to_gcrs: step.attitude, momentum: step.momentum };
        let [a, b, c] = self.body.of_fields(&motion, around);
        let [d, e] = self.body.of_surface(step.attitude, around, self.evaluator.as_mut())?;
        for (sum, torque) in self.sums.iter_mut().zip([a, b, c, d, e]) {
            let size = torque.length();
            sum.0 += size * step.length_s.abs();
            sum.1 = sum.1.max(size);
        }
        self.seconds += step.length_s.abs();
        Ok(())
    }

    fn step(
        &mut self,
        from_s: f64,
        length_s: f64,
        motion: &Motion,
        around: &Around,
        before: Option<&Step>,
    ) -> Result<Step, AttitudeError> {
        let rule = Rule::get();
        let around_at: [Around; STAGES] =
            std::array::from_fn(|i| self.surroundings.at(from_s + rule.nodes[i] * length_s));
        let mut step = Step {
            from_s,
            length_s,
            attitude: motion.body_to_gcrs,
            momentum: motion.momentum,
            slopes: [(DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0), DVec3::ZERO); STAGES],
            kick: DVec3::ZERO,
        };
        match before {
            // As the last step went on.
            Some(last) if last.length_s == length_s => {
                for i in 0..STAGES {
                    step.slopes[i] = combined(&rule.onward[i], &last.slopes);
                }
            }
            _ => {
                let omega = self.body.omega_body_rad_s(motion);
                let slope = rate_of(motion.body_to_gcrs, omega);
                let torque: DVec3 = self.body.of_fields(motion, around).into_iter().sum();
                step.slopes = [(slope, motion.body_to_gcrs * torque); STAGES];
            }
        }
        let size = motion.momentum.length();
        let mut surface = [DVec3::ZERO; STAGES];
        let mut last = f64::INFINITY;
        for round in 0..MOST_ROUNDS {
            let mut slopes = step.slopes;
            let mut change = 0.0_f64;
            for i in 0..STAGES {
                let (dq, dl) = combined(&rule.integrals[i], &step.slopes);
                let q = step.attitude + dq * length_s;
                let turn = q.normalize();
                let stage = Motion { body_to_gcrs: turn, momentum: step.momentum + dl * length_s };
                let omega = self.body.omega_body_rad_s(&stage);
                let fields: DVec3 = self.body.of_fields(&stage, &around_at[i]).into_iter().sum();
                if round < SURFACE_ROUNDS && self.evaluator.is_some() {
                    let [light, air] =
                        self.body.of_surface(turn, &around_at[i], self.evaluator.as_mut())?;
                    surface[i] = turn * (light + air);
                }
                slopes[i] = (rate_of(q, omega), turn * fields + surface[i]);
                let moved = (slopes[i].0 - step.slopes[i].0).length() * length_s.abs();
                let pushed = (slopes[i].1 - step.slopes[i].1).length() * length_s.abs();
                change = change.max(moved);
                if pushed > 0.0 {
                    change = change.max(pushed / size.max(pushed));
                }
            }
            step.slopes = slopes;
            let settled = round >= SURFACE_ROUNDS || self.evaluator.is_none();
            // Rounding is reached where it no longer shrinks.
            if settled && (change < 3e-16 || change < 1e-13 && change >= last) {
                if self.evaluator.is_some() {
                    let sum: DVec3 = surface.iter().zip(rule.weights).map(|(s, w)| *s * w).sum();
                    let whole = sum * length_s;
                    let most = SURFACE_ERROR * size.max(whole.length());
                    step.kick = self.surface(&step, (0.0, 1.0), whole, most, HALVINGS)? - whole;
                }
                return Ok(step);
            }
            if !change.is_finite() {
                break;
            }
            last = change;
        }
        Err(AttitudeError::Torques {
            why: format!(
                "a step of {length_s:e} s at {from_s} s after the epoch does not converge: a torque is far too large for this inertia"
            ),
        })
    }
}

impl Step {
    fn end(&self) -> Motion {
        let (dq, dl) = combined(&Rule::get().weights, &self.slopes);
        // |q| is kept by the method; what is taken away is rounding.
        let body_to_gcrs = (self.attitude + dq * self.length_s).normalize();
        Motion { body_to_gcrs, momentum: self.momentum + dl * self.length_s + self.kick }
    }
}

/// q̇ = ½ q ω.
fn rate_of(q: DQuat, omega: DVec3) -> DQuat {
    product(q, DQuat::from_xyzw(omega.x, omega.y, omega.z, 0.0)) * 0.5
}

/// The quaternion product, in the order of its terms (no normalisation).
fn product(a: DQuat, b: DQuat) -> DQuat {
    DQuat::from_xyzw(
        a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
        a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
        a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w,
        a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z,
    )
}

fn combined(weights: &[f64; STAGES], slopes: &[(DQuat, DVec3); STAGES]) -> (DQuat, DVec3) {
    let mut sum = (DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0), DVec3::ZERO);
    for (w, (q, l)) in weights.iter().zip(slopes) {
        sum.0 += *q * *w;
        sum.1 += *l * *w;
    }
    sum
}
