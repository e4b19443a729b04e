//! How bodies turn, against the equations of motion integrated here, closed forms, and hand-made cases.

#![allow(clippy::unwrap_used, reason = "a test says what it expects")]

use glam::{DMat3, DQuat, DVec3};
use hifitime::{Duration, Epoch};
use proptest::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use sunglint_ephemeris::orbit::State;
use sunglint_formats::time::parse_utc;
use sunglint_simulator::attitude::{
    Attitude, AttitudeError, AttitudeTable, Direction, Inertia, Interpolation, Moment, Pointing,
    Spin, Tumble, euler_zyx, orbit_to_gcrs, quaternion_wxyz,
};

fn start() -> Epoch {
    parse_utc("2026-03-01T20:00:00Z").unwrap()
}

fn after(seconds: f64) -> Epoch {
    start() + Duration::from_total_nanoseconds((seconds * 1e9).round() as i128)
}

fn angle_rad(a: DQuat, b: DQuat) -> f64 {
    let d = a.inverse() * b;
    2.0 * DVec3::new(d.x, d.y, d.z).length().atan2(d.w.abs())
}

fn some_attitude() -> DQuat {
    euler_zyx(0.4, -0.9, 2.2)
}

/// Attitude and angular velocity of a rigid body.
type Rigid = (DQuat, DVec3);

/// Euler's equations and the kinematics of the quaternion; tensor and angular velocity in the body's axes.
struct Equations {
    tensor: DMat3,
    inverse: DMat3,
}

impl Equations {
    fn new(tensor: DMat3) -> Self {
        Self { tensor, inverse: tensor.inverse() }
    }

    fn rate(&self, (q, w): Rigid) -> Rigid {
        (q * DQuat::from_xyzw(w.x, w.y, w.z, 0.0) * 0.5, self.inverse * (self.tensor * w).cross(w))
    }

    /// One step of Gragg, Bulirsch and Stoer: modified midpoints of 2, 4 … 16 substeps, extrapolated to none: 16th order.
    fn step(&self, from: Rigid, step: f64) -> Rigid {
        let add = |a: Rigid, b: Rigid, h: f64| (a.0 + b.0 * h, a.1 + b.1 * h);
        let mut old: Vec<Rigid> = Vec::new();
        for j in 0..8 {
            let n = 2 * (j + 1);
            let h = step / n as f64;
            let (mut before, mut now) = (from, add(from, self.rate(from), h));
            for _ in 1..n {
                (before, now) = (now, add(before, self.rate(now), 2.0 * h));
            }
            let end = add(now, self.rate(now), h);
            let mut new = vec![((before.0 + end.0) * 0.5, (before.1 + end.1) * 0.5)];
            for k in 1..=j {
                let ratio = ((j + 1) as f64 / (j + 1 - k) as f64).powi(2) - 1.0;
                let difference = add(new[k - 1], old[k - 1], -1.0);
                new.push(add(new[k - 1], difference, 1.0 / ratio));
            }
            old = new;
        }
        let (q, w) = old[7];
        (q.normalize(), w)
    }

    /// From the start to `seconds` later.
    fn integrate(&self, from: Rigid, seconds: f64) -> Rigid {
        let steps = (seconds * from.1.length() / TAU * 8.0).ceil().max(1.0);
        (0..steps as usize).fold(from, |state, _| self.step(state, seconds / steps))
    }
}

/// A tensor with these principal moments about axes that are turned in the body.
fn tensor(moments: [f64; 3], turned: DQuat) -> DMat3 {
    let axes = DMat3::from_quat(turned);
    axes * DMat3::from_diagonal(DVec3::from_array(moments)) * axes.transpose()
}

fn tumble(tensor: DMat3, omega: DVec3) -> Tumble {
    Tumble::new(&Inertia::of_tensor(tensor).unwrap(), omega, some_attitude(), start()).unwrap()
}

/// Truth: the attitudes of `fixtures/attitude/hour.csv`, integrated in 80-bit floating point, whose own error is below 1e-10 rad
/// (its README). Tolerance 1e-9 rad after an hour at one turn a second, 22,600 rad; bodies that turn over about their
/// intermediate axis amplify the rounding of what they start from by the inverse square of their tilt there.
#[test]
fn an_hour_of_tumbling_is_the_integral_of_eulers_equations() {
    let text = std::fs::read_to_string(sunglint_testkit::fixture("attitude/hour.csv")).unwrap();
    let mut bodies = 0;
    for line in text.lines().skip(1) {
        let n: Vec<f64> = line.split(',').map(|v| v.parse().unwrap()).collect();
        let omega = DVec3::new(n[3], n[4], n[5]);
        let truth = DQuat::from_xyzw(n[7], n[8], n[9], n[6]);
        let inertia = Inertia::of_principal(DVec3::new(n[0], n[1], n[2]), DQuat::IDENTITY).unwrap();
        let tumble = Tumble::new(&inertia, omega, DQuat::IDENTITY, start()).unwrap();
        let error = angle_rad(tumble.body_to_gcrs(after(3600.0)), truth);
        let tilt = (omega.x.hypot(omega.z) / TAU).min(1.0);
        let tolerance = if tilt < 0.1 { 1e-12 / (tilt * tilt) } else { 1e-9 };
        assert!(error < tolerance, "{line}: {error:e} rad");
        bodies += 1;
    }
    assert_eq!(bodies, 10);
}

/// Truth: the equations integrated here in double precision, whose own rounding is some 1e-10 after five minutes; the tensor has
/// axes of its own, the moments come in no order. Tolerance 2e-9 rad, angular velocities 2e-9 of their size.
#[test]
fn minutes_of_tumbling_about_axes_of_ones_own() {
    let turned = euler_zyx(0.3, 0.8, -1.1);
    for (moments, direction) in [
        ([400.0, 90.0, 350.0], DVec3::new(0.5, 0.6, 0.62)),
        ([4.0, 3.9, 0.2], DVec3::new(-0.1, 0.9, 0.3)),
        ([1.0, 2.5, 3.5], DVec3::new(0.2, 0.3, -0.9)),
    ] {
        let tensor = tensor(moments, turned);
        let omega = direction.normalize() * TAU;
        let tumble = tumble(tensor, omega);
        let (q, w) = Equations::new(tensor).integrate((some_attitude(), omega), 300.0);
        let error = angle_rad(tumble.body_to_gcrs(after(300.0)), q);
        assert!(error < 2e-9, "{moments:?} {direction}: {error:e} rad");
        let error = (tumble.omega_body_rad_s(after(300.0)) - w).length();
        assert!(error < 2e-9 * TAU, "{moments:?} {direction}: {error:e} rad/s");
    }
}

/// Truth: angular momentum in the GCRS and kinetic energy of free rotation are constant. The angular velocity is taken from the
/// attitude alone, by central differences of the eighth order over 10 ms (truncated at 1e-12), whose rounding is some 3e-10.
#[test]
fn momentum_and_energy_are_conserved_over_an_hour() {
    let moments = DVec3::new(2.0, 3.0, 4.0);
    for direction in [DVec3::new(0.3, -0.4, 1.0), DVec3::new(1.0, 0.4, -0.2)] {
        let tensor = DMat3::from_diagonal(moments);
        let omega = direction.normalize() * TAU;
        let tumble = tumble(tensor, omega);
        let momentum = some_attitude() * (tensor * omega);
        let energy = 0.5 * omega.dot(tensor * omega);
        for i in 0..600 {
            let t = 6.0 * f64::from(i) + 0.013 * f64::from(i % 7);
            let now = tumble.body_to_gcrs(after(t));
            let half_turn =
                |h: f64| (now.inverse() * tumble.body_to_gcrs(after(t + h))).to_scaled_axis();
            let h = 0.01;
            let weights = [4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0];
            let mut w = DVec3::ZERO;
            for (k, weight) in (1..).zip(weights) {
                let k = f64::from(k) * h;
                w += weight * (half_turn(k) - half_turn(-k)) / h;
            }
            let now_momentum = now * (tensor * w);
            let off = (now_momentum - momentum).length() / momentum.length();
            assert!(off < 1e-9, "L at {t} s: {off:e}");
            let off = (0.5 * w.dot(tensor * w) / energy - 1.0).abs();
            assert!(off < 1e-9, "T at {t} s: {off:e}");
            assert!((w - tumble.omega_body_rad_s(after(t))).length() < 1e-9 * TAU, "ω at {t} s");
        }
    }
}

/// Truth: the integration, for a body that turns over again and again about its intermediate axis (Dzhanibekov). The motion itself
/// amplifies what it starts from, the integration's rounding by the inverse square of the tilt: tolerance 1e-8 rad over a minute for a
/// tilt of 1e-2, 1e-6 rad over ten seconds for one of 1e-4. It does turn over, to the other side and back.
#[test]
fn a_spin_about_the_intermediate_axis_turns_over() {
    for (small, tolerance, seconds) in [(1e-2, 1e-8, 60), (1e-4, 1e-6, 10)] {
        let tensor = tensor([2.0, 3.0, 4.0], euler_zyx(0.1, 0.2, 0.3));
        let inertia = Inertia::of_tensor(tensor).unwrap();
        let axes = DMat3::from_quat(euler_zyx(0.1, 0.2, 0.3));
        let omega = axes * (DVec3::new(small, 1.0, 0.5 * small) * TAU);
        let tumble = Tumble::new(&inertia, omega, some_attitude(), start()).unwrap();
        let equations = Equations::new(tensor);
        let mut state = (some_attitude(), omega);
        let (mut least, mut most) = (1.0_f64, -1.0_f64);
        for second in 1..=seconds {
            state = equations.integrate(state, 1.0);
            let error = angle_rad(tumble.body_to_gcrs(after(f64::from(second))), state.0);
            assert!(error < tolerance, "{small} after {second} s: {error:e}");
        }
        for i in 0..1200 {
            let w = tumble.omega_body_rad_s(after(0.1 * f64::from(i)));
            let along = w.normalize().dot(axes.y_axis);
            (least, most) = (least.min(along), most.max(along));
        }
        assert!(least < -0.999 && most > 0.999, "{least} {most}");
    }
}

/// Truth: a symmetric top precesses about L at L/I⊥ and spins about its axis at (1 − I₃/I⊥) ω₃ (Landau and Lifshitz, §33):
/// A(t) = R(L, Lt/I⊥) A(0) R(e₃, (1 − I₃/I⊥) ω₃ t). Oblate and prolate, its axis in each place; 1e-10 rad after ten minutes.
#[test]
fn symmetric_tops_are_the_closed_form() {
    for (axial, across) in [(4.0, 2.5), (1.0, 3.0), (3.0, 3.0 + 1e-15)] {
        for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
            let moments = DVec3::splat(across) + (axial - across) * axis;
            let inertia = Inertia::of_principal(moments, DQuat::IDENTITY).unwrap();
            for omega in [
                DVec3::new(1.0, -2.0, 5.0),
                DVec3::new(-4.0, 0.3, -0.2),
                DVec3::new(axis.y, axis.z, axis.x) * 3.0,
            ] {
                let tumble = Tumble::new(&inertia, omega, some_attitude(), start()).unwrap();
                let momentum = moments * omega;
                let t = 600.0;
                let spin = (1.0 - axial / across) * omega.dot(axis) * t;
                let precession = momentum.length() / across * t;
                let truth = DQuat::from_axis_angle(
                    (some_attitude() * momentum).normalize(),
                    precession % TAU,
                ) * some_attitude()
                    * DQuat::from_axis_angle(axis, spin % TAU);
                let error = angle_rad(tumble.body_to_gcrs(after(t)), truth);
                assert!(error < 1e-10, "{axial}/{across} {axis} {omega}: {error:e}");
            }
        }
    }
}

/// Truth: a spin about a principal axis, the intermediate one included, stays a spin: the law of a fixed axis. So does any spin of a
/// sphere, and a body at rest. 1e-10 rad after an hour.
#[test]
fn principal_axes_and_spheres_spin_steadily() {
    let turned = euler_zyx(1.0, 0.5, -0.2);
    let mut cases = Vec::new();
    for axis in [DVec3::X, DVec3::Y, DVec3::Z, -DVec3::Y] {
        cases.push((tensor([2.0, 3.0, 4.0], turned), turned * axis * TAU));
    }
    cases.push((tensor([3.0, 3.0, 3.0], turned), DVec3::new(1.0, 2.0, -3.0)));
    cases.push((tensor([2.0, 3.0, 4.0], turned), DVec3::ZERO));
    for (tensor, omega) in cases {
        let tumble = tumble(tensor, omega);
        let axis = omega.try_normalize().unwrap_or(DVec3::X);
        let spin =
            Spin::about_body_axis(axis, omega.length() / TAU, some_attitude(), start()).unwrap();
        for t in [0.0, 17.3, -250.0, 3600.0] {
            let error = angle_rad(tumble.body_to_gcrs(after(t)), spin.body_to_gcrs(after(t)));
            assert!(error < 1e-10, "{omega} after {t} s: {error:e}");
        }
    }
}

/// Truth: motion depends continuously on inertia and spin. A change of 1e-9 in them moves the attitude after 20 s of 1 rad/s by at most
/// some 1e-8, away from the separatrix and across every degenerate case.
#[test]
fn degenerate_bodies_are_limits_of_others() {
    let nudge = 1e-9;
    for (moments, omega) in [
        ([2.0, 3.0, 3.0], DVec3::new(1.0, 0.3, 0.4)),
        ([2.0, 2.0, 3.0], DVec3::new(0.1, 0.3, 0.9)),
        ([2.0, 3.0, 3.0], DVec3::new(0.0, 0.8, 0.4)),
        ([2.0, 2.0, 3.0], DVec3::new(0.8, 0.3, 0.0)),
        ([3.0, 3.0, 3.0], DVec3::new(0.8, 0.3, 0.1)),
        ([2.0, 3.0, 4.0], DVec3::new(0.0, 0.0, 1.0)),
        ([2.0, 3.0, 4.0], DVec3::new(-1.0, 0.0, 0.0)),
    ] {
        let exact = tumble(tensor(moments, DQuat::IDENTITY), omega);
        for (i, sign) in [(0, 1.0), (1, 1.0), (1, -1.0), (2, 1.0), (2, -1.0)] {
            let mut nudged = moments;
            nudged[i] += sign * nudge;
            let mut nudged_omega = omega;
            nudged_omega[(i + 1) % 3] += sign * nudge;
            let other = tumble(tensor(nudged, DQuat::IDENTITY), nudged_omega);
            for t in [0.0, 5.0, 20.0] {
                let error = angle_rad(exact.body_to_gcrs(after(t)), other.body_to_gcrs(after(t)));
                assert!(error < 5e-8, "{moments:?} {omega} nudged {i}: {error:e} after {t} s");
            }
        }
    }
}

/// Truth: on the separatrix, L² = 2TI₂, ω₂ = (L/I₂) tanh τ and the others go with sech τ, τ = t √((I₃−I₂)(I₂−I₁)/(I₁I₃)) L/I₂
/// (Landau and Lifshitz, §37, problem 2): the body turns over once and comes to rest on its intermediate axis. Followed until τ = 15,
/// where the rounding of the start, 1e-16 e^τ, has grown to 3e-10; tolerance 1e-8.
#[test]
fn the_separatrix_is_hyperbolic() {
    let [x, y, z]: [f64; 3] = [2.0, 3.0, 4.0];
    let momentum = y; // L/I₂ = 1 rad/s
    let (two_t, l2) = (y, y * y);
    let a = ((two_t * z - l2) / (x * (z - x))).sqrt();
    let c = ((l2 - two_t * x) / (z * (z - x))).sqrt();
    let rate = ((z - y) * (y - x) / (x * z)).sqrt() * momentum / y;
    let tumble = tumble(DMat3::from_diagonal(DVec3::new(x, y, z)), DVec3::new(a, 0.0, c));
    for i in -60..=60 {
        let tau = f64::from(i) * 0.25;
        let truth = DVec3::new(a / tau.cosh(), tau.tanh(), c / tau.cosh());
        let error = (tumble.omega_body_rad_s(after(tau / rate)) - truth).length();
        assert!(error < 1e-8, "τ = {tau}: {error:e}");
    }
}

/// Truth: naming the body's axes otherwise changes no motion. 1e-10 rad after 100 s.
#[test]
fn the_order_of_the_axes_does_not_matter() {
    let (moments, omega) = (DVec3::new(2.0, 4.0, 3.1), DVec3::new(0.7, -1.2, 2.0));
    let plain = tumble(DMat3::from_diagonal(moments), omega);
    // New axes are (y, z, x): a body-to-body rotation; and two that swap axes and reverse one.
    let maps = [
        DMat3::from_cols(DVec3::Y, DVec3::Z, DVec3::X),
        DMat3::from_cols(DVec3::Y, DVec3::X, -DVec3::Z),
        DMat3::from_cols(-DVec3::X, DVec3::Z, DVec3::Y),
    ];
    for new_to_old in maps {
        let old_to_new = new_to_old.transpose();
        let turn = DQuat::from_mat3(&new_to_old);
        let tensor = old_to_new * DMat3::from_diagonal(moments) * new_to_old;
        let inertia = Inertia::of_tensor(tensor).unwrap();
        let other =
            Tumble::new(&inertia, old_to_new * omega, some_attitude() * turn, start()).unwrap();
        let q = other.body_to_gcrs(after(100.0)) * turn.inverse();
        let error = angle_rad(q, plain.body_to_gcrs(after(100.0)));
        assert!(error < 1e-10, "{new_to_old}: {error:e}");
    }
}

#[test]
fn what_no_body_has_is_refused_with_its_numbers() {
    let tensor = |rows: [[f64; 3]; 3]| {
        Inertia::of_tensor(DMat3::from_cols_array_2d(&rows).transpose()).unwrap_err().to_string()
    };
    let text = tensor([[2.0, 0.5, 0.0], [0.1, 3.0, 0.0], [0.0, 0.0, 4.0]]);
    assert_eq!(
        text,
        "no body has this inertia: it is not symmetric: row 1, column 2 is 0.5 and row 2, column 1 is 0.1"
    );
    let text = tensor([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 3.0]]);
    assert!(text.contains("the largest is more than the sum of the others, 2,"), "{text}");
    let text = tensor([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 3.0]]);
    assert!(text.contains("all must be above 0"), "{text}");
    let text = tensor([[f64::NAN, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 3.0]]);
    assert!(text.contains("not finite"), "{text}");
    assert!(Inertia::of_principal(DVec3::new(1.0, 0.0, 1.0), DQuat::IDENTITY).is_err());
}

/// Truth: R_z(90°) takes x to y: the body's x axis lies along the GCRS's y. Yaw, then pitch about the new y, then roll about the newest
/// x, in steps done by hand. glam keeps (x, y, z, w), files (w, x, y, z).
#[test]
fn the_convention_of_rotations() {
    let close = |a: DVec3, b: DVec3| assert!((a - b).length() < 1e-15, "{a} {b}");
    let yaw = euler_zyx(FRAC_PI_2, 0.0, 0.0);
    close(yaw * DVec3::X, DVec3::Y);
    close(euler_zyx(0.0, FRAC_PI_2, 0.0) * DVec3::X, -DVec3::Z);
    close(euler_zyx(0.0, 0.0, FRAC_PI_2) * DVec3::Y, DVec3::Z);
    // Yaw 90° lays the body's y along −x; pitch 90° about that takes the body's x from y to −z; roll 90° about that
    // takes the body's y from −x to −y: right-handed about −z, −x goes to y's opposite.
    let all = euler_zyx(FRAC_PI_2, FRAC_PI_2, FRAC_PI_2);
    close(all * DVec3::X, -DVec3::Z);
    close(all * DVec3::Y, DVec3::Y);
    let h = 0.5_f64.sqrt();
    let q = quaternion_wxyz([h, 0.0, 0.0, h]).unwrap();
    close(q * DVec3::X, DVec3::Y);
    assert_eq!(quaternion_wxyz([1.0 + 5e-7, 0.0, 0.0, 0.0]).unwrap(), DQuat::IDENTITY);
    let error = quaternion_wxyz([1.0, 0.01, 0.0, 0.0]).unwrap_err();
    assert!(error.to_string().starts_with("the quaternion has the length 1.00004"), "{error}");
    assert!(quaternion_wxyz([0.0; 4]).is_err() && quaternion_wxyz([f64::NAN; 4]).is_err());
}

/// Truth: a quarter of the period turns by 90°, right-handed about the axis; a whole one, and a million, by nothing (their rounding is
/// 1e-10 turns at 1e6); a negative rate the other way.
#[test]
fn spins_turn_right_handed_and_return() {
    let spin = Spin::new(DVec3::Z * 7.0, 0.25, DQuat::IDENTITY, start()).unwrap();
    let x = spin.body_to_gcrs(after(1.0)) * DVec3::X;
    assert!((x - DVec3::Y).length() < 1e-15, "{x}");
    let left = Spin::new(DVec3::Z, -0.25, DQuat::IDENTITY, start()).unwrap();
    assert!((left.body_to_gcrs(after(1.0)) * DVec3::X + DVec3::Y).length() < 1e-15);
    for (t, tolerance) in [(4.0, 1e-15), (4e6, 1e-9), (-4e6, 1e-9)] {
        assert!(angle_rad(spin.body_to_gcrs(after(t)), DQuat::IDENTITY) < tolerance, "{t}");
    }
    // An axis of the body that lies along another of the GCRS.
    for axis in [DVec3::new(1.0, 2.0, -0.5), DVec3::Y, -DVec3::Y, DVec3::Z, -DVec3::Z] {
        for body in [DVec3::Z, DVec3::Y] {
            let spin = Spin::along(body, axis, 0.1, 0.3, start()).unwrap();
            for t in [0.0, 3.3] {
                let off = spin.body_to_gcrs(after(t)) * body - axis.normalize();
                assert!(off.length() < 1e-15, "{axis} {off}");
            }
        }
    }
    assert!(Spin::new(DVec3::ZERO, 1.0, DQuat::IDENTITY, start()).is_err());
    assert!(Spin::new(DVec3::X, f64::INFINITY, DQuat::IDENTITY, start()).is_err());
}

fn moment(position: DVec3, velocity: DVec3, to_sun: DVec3) -> Moment {
    let target = State { position_m: position, velocity_m_s: velocity };
    Moment { epoch: start(), target, to_sun: to_sun.normalize() }
}

/// Truth: by hand. Over the equator at x, flying towards +y: nadir is −x, the orbit's normal +z. The body's z is nadir, its y the opposite
/// of the normal, its x the velocity, also where that climbs.
#[test]
fn the_orbits_axes() {
    for climb in [0.0, 900.0, -900.0] {
        let m = moment(DVec3::X * 7e6, DVec3::new(climb, 7.5e3, 0.0), DVec3::Z);
        let q = orbit_to_gcrs(&m).unwrap();
        for (axis, truth) in [(DVec3::X, DVec3::Y), (DVec3::Y, -DVec3::Z), (DVec3::Z, -DVec3::X)] {
            assert!((q * axis - truth).length() < 1e-15, "{axis}: {}", q * axis);
        }
        // A roll of 90° about x points the body's y at nadir.
        let rolled = Attitude::Orbit(euler_zyx(0.0, 0.0, FRAC_PI_2)).body_to_gcrs(&m).unwrap();
        assert!((rolled * DVec3::Y + DVec3::X).length() < 1e-15);
    }
    let error = orbit_to_gcrs(&moment(DVec3::X * 7e6, DVec3::X, DVec3::Z)).unwrap_err();
    assert!(matches!(error, AttitudeError::Undefined { .. }), "{error}");
}

/// Truth: by hand, with the target at x, flying towards y, the Sun at 45° between z and the zenith.
#[test]
fn bodies_that_point() {
    let m = moment(DVec3::X * 7e6, DVec3::Y * 7.5e3, DVec3::new(1.0, 0.0, 1.0));
    let h = 0.5_f64.sqrt();
    // The panel's normal z exactly at the Sun, x as near to nadir as it can.
    let pointing = Pointing::new(DVec3::Z, Direction::Sun, DVec3::X, Direction::Nadir).unwrap();
    let q = Attitude::Pointing(pointing).body_to_gcrs(&m).unwrap();
    assert!((q * DVec3::Z - DVec3::new(h, 0.0, h)).length() < 1e-15);
    assert!((q * DVec3::X - DVec3::new(-h, 0.0, h)).length() < 1e-15);
    // Yaw steering: z exactly at nadir, x on the Sun's side, so that y is perpendicular to the Sun.
    let pointing = Pointing::new(DVec3::Z, Direction::Nadir, DVec3::X, Direction::Sun).unwrap();
    let q = Attitude::Pointing(pointing).body_to_gcrs(&m).unwrap();
    assert!((q * DVec3::Z + DVec3::X).length() < 1e-15);
    assert!((q * DVec3::X - DVec3::Z).length() < 1e-15);
    assert!((q * DVec3::Y).dot(m.to_sun).abs() < 1e-15);
    for (second, truth) in [
        (Direction::OrbitNormal, DVec3::Z),
        (Direction::North, DVec3::Z),
        (Direction::Velocity, DVec3::Y),
    ] {
        let pointing = Pointing::new(DVec3::Z, Direction::Nadir, DVec3::X, second).unwrap();
        let q = pointing.body_to_gcrs(&m).unwrap();
        assert!((q * DVec3::X - truth).length() < 1e-15, "{second:?}");
    }
    let noon = moment(DVec3::X * 7e6, DVec3::Y * 7.5e3, DVec3::X);
    let error = pointing.body_to_gcrs(&noon).unwrap_err().to_string();
    assert!(error.contains("the Sun and nadir"), "{error}");
    assert!(Pointing::new(DVec3::Z, Direction::Sun, DVec3::X, Direction::Sun).is_err());
    assert!(Pointing::new(DVec3::Z, Direction::Sun, -DVec3::Z, Direction::Nadir).is_err());
}

/// Truth: a steady spin, of which slerp and squad both keep every moment (rounding); rows of either sign of the quaternion. A tumbling body,
/// against its own law: squad's error falls with the cube of the step or faster, slerp's with its square.
#[test]
fn tables_between_and_beyond_their_rows() {
    let spin = Spin::new(DVec3::new(1.0, 2.0, 3.0), 0.05, some_attitude(), start()).unwrap();
    let rows: Vec<f64> = (0..=10).map(f64::from).collect();
    let table = |interpolation| {
        let attitudes = rows.iter().enumerate().map(|(i, t)| {
            let q = spin.body_to_gcrs(after(*t));
            if i % 3 == 0 { -q } else { q }
        });
        let epochs = rows.iter().map(|t| after(*t)).collect();
        AttitudeTable::new(epochs, attitudes.collect(), interpolation).unwrap()
    };
    for interpolation in [Interpolation::Slerp, Interpolation::Squad] {
        let table = table(interpolation);
        assert!((table.largest_step_deg() - 18.0).abs() < 1e-6);
        for i in 0..=100 {
            let t = 0.1 * f64::from(i);
            let error =
                angle_rad(table.body_to_gcrs(after(t)).unwrap(), spin.body_to_gcrs(after(t)));
            assert!(error < 1e-14, "{interpolation:?} {t}: {error:e}");
        }
        for t in [-1e-9, 10.000000001] {
            let error = table.body_to_gcrs(after(t)).unwrap_err();
            assert!(matches!(error, AttitudeError::OutsideTable { .. }), "{error}");
        }
    }
    let tumble = tumble(tensor([2.0, 3.0, 4.0], DQuat::IDENTITY), DVec3::new(0.3, -0.4, 1.0));
    let worst = |interpolation, step: f64| {
        let times: Vec<f64> = (0..=(20.0 / step) as usize).map(|i| i as f64 * step).collect();
        let attitudes = times.iter().map(|t| tumble.body_to_gcrs(after(*t))).collect();
        let epochs = times.iter().map(|t| after(*t)).collect();
        let table = AttitudeTable::new(epochs, attitudes, interpolation).unwrap();
        (20..180)
            .map(|i| after(0.1 * f64::from(i)))
            .map(|e| angle_rad(table.body_to_gcrs(e).unwrap(), tumble.body_to_gcrs(e)))
            .fold(0.0, f64::max)
    };
    let ratio = worst(Interpolation::Slerp, 0.5) / worst(Interpolation::Slerp, 0.25);
    assert!((3.5..4.5).contains(&ratio), "{ratio}");
    assert!(worst(Interpolation::Squad, 0.25) < 0.2 * worst(Interpolation::Slerp, 0.25));
    let twice = AttitudeTable::new(
        vec![after(0.0), after(1.0), after(1.0)],
        vec![DQuat::IDENTITY; 3],
        Interpolation::Slerp,
    );
    let error = twice.unwrap_err().to_string();
    assert_eq!(error, "row 3 of the table, 2026-03-01T20:00:01Z, is not after the row before it");
    let none = AttitudeTable::new(Vec::new(), Vec::new(), Interpolation::Slerp);
    assert!(none.is_err());
    let fast = AttitudeTable::new(
        vec![after(0.0), after(1.0)],
        vec![DQuat::IDENTITY, DQuat::from_rotation_z(2.0)],
        Interpolation::Slerp,
    );
    assert_eq!(Attitude::Table(fast.unwrap()).warnings().len(), 1);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    /// Any body, any spin, any time in any order: a unit quaternion, the start at the epoch, and the angular momentum kept in
    /// space to 1e-10 (rounding of up to 1e4 turns).
    #[test]
    fn any_tumble_keeps_its_momentum(
        moments in prop::array::uniform3(0.5..1.0_f64),
        angles in prop::array::uniform3(-PI..PI),
        omega in prop::array::uniform3(-7.0..7.0_f64),
        t in -3600.0..3600.0_f64,
    ) {
        let tensor = tensor(moments, euler_zyx(angles[0], 0.5 * angles[1], angles[2]));
        let omega = DVec3::from_array(omega);
        let tumble = tumble(tensor, omega);
        prop_assert!(angle_rad(tumble.body_to_gcrs(start()), some_attitude()) < 1e-13);
        prop_assert!((tumble.omega_body_rad_s(start()) - omega).length() < 1e-13 * omega.length());
        let q = tumble.body_to_gcrs(after(t));
        prop_assert!((q.length() - 1.0).abs() < 1e-15);
        let before = some_attitude() * (tensor * omega);
        let now = q * (tensor * tumble.omega_body_rad_s(after(t)));
        prop_assert!((now - before).length() < 1e-10 * before.length());
    }
}

/// Truth: only the ratios of the moments matter, however large they are: the same motion to the last digits. Rates that would leave no
/// phase, and whose squares are no numbers, are refused.
#[test]
fn extreme_numbers_make_no_attitude_that_is_no_number() {
    let omega = DVec3::new(0.3, 0.2, 0.1);
    let plain = tumble(tensor([2.0, 3.0, 4.0], some_attitude()), omega);
    let heavy = tumble(tensor([2e200, 3e200, 4e200], some_attitude()), omega);
    let epoch = after(60.0);
    assert!(angle_rad(plain.body_to_gcrs(epoch), heavy.body_to_gcrs(epoch)) < 1e-11);
    let inertia = Inertia::of_tensor(tensor([2.0, 3.0, 4.0], some_attitude())).unwrap();
    for size in [1e8, 1e200] {
        let refused = Tumble::new(&inertia, size * omega, some_attitude(), start());
        assert!(matches!(refused, Err(AttitudeError::TooFast { .. })), "{size}");
        let refused = Spin::new(DVec3::Z, size, some_attitude(), start());
        assert!(matches!(refused, Err(AttitudeError::TooFast { .. })), "{size}");
    }
}
