//! Estimator of where a target is beside its prediction, and the choice of the target among spots.

use super::path::Place;
use glam::DVec3;

/// One radian in arcsec.
pub(super) const ARCSEC: f64 = 206_264.806_247_096_36;

/// Time in which a rate that nothing renews falls to 1/e, s. The wind or the worm that drives it turns round within seconds: a target that hides behind a star or a cloud is not to be
/// looked for ever farther away. (At ten frames a second the rate is renewed long before.)
const RATE_S: f64 = 2.0;

/// A number and its rate, with covariance: a Kalman filter with a rate that wanders and, by itself, dies away (an Ornstein–Uhlenbeck process).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Drift {
    pub value: f64,
    pub rate: f64,
    covariance: [f64; 3],
    /// Largest variance of the rate: what it wanders by does not grow without end.
    most: f64,
}

impl Drift {
    /// Nothing known but the spread of value and rate.
    pub fn new(sigma: f64, rate_sigma: f64) -> Self {
        let most = rate_sigma * rate_sigma;
        Self { value: 0.0, rate: 0.0, covariance: [sigma * sigma, 0.0, most], most }
    }

    /// This one, known anew with these standard deviations.
    pub fn known(self, value: f64, sigma: f64, rate_sigma: f64) -> Self {
        let known = Self::new(sigma, rate_sigma);
        Self { value, most: self.most.max(known.most), ..known }
    }

    pub fn sigma(&self) -> f64 {
        self.covariance[0].max(0.0).sqrt()
    }

    pub fn after(&self, dt_s: f64) -> f64 {
        self.value + self.rate * lasting_s(dt_s)
    }

    /// Goes on by a time; `noise` is what the rate wanders by, in a second.
    pub fn advance(&mut self, dt_s: f64, noise: f64) {
        let [vv, vr, rr] = self.covariance;
        let q = noise * noise;
        let (lasting_s, keeps) = (lasting_s(dt_s), (-dt_s / RATE_S).exp());
        self.value += self.rate * lasting_s;
        self.rate *= keeps;
        // The noise of the interval as if the rate stood: an upper bound.
        self.covariance = [
            vv + 2.0 * lasting_s * vr + lasting_s * lasting_s * rr + q * dt_s.powi(3) / 3.0,
            keeps * (vr + lasting_s * rr) + q * dt_s * dt_s / 2.0,
            keeps * keeps * rr + q * dt_s,
        ];
        let [vv, vr, rr] = &mut self.covariance;
        if *rr > self.most {
            *rr = self.most;
            let most = (*vv * *rr).sqrt();
            *vr = vr.clamp(-most, most);
        }
    }

    /// Learns from a measurement of the value's error.
    pub fn learn(&mut self, innovation: f64, sigma: f64) {
        let [vv, vr, rr] = self.covariance;
        let total = vv + sigma * sigma;
        let (kv, kr) = (vv / total, vr / total);
        self.value += kv * innovation;
        self.rate += kr * innovation;
        self.covariance = [vv * (1.0 - kv), vr * (1.0 - kv), rr - kr * vr];
    }
}

/// A target slower than this is not displaced along its track by asking for another time alone, arcsec/s: one that stands over a place of the Earth is where it is at any time.
const SLOWEST_ARCSEC_S: f64 = 1.0;

/// Time, s, in which a steady rate would go as far as one that dies away does in `dt_s`.
fn lasting_s(dt_s: f64) -> f64 {
    -RATE_S * (-dt_s / RATE_S).exp_m1()
}

/// Errors of a person's click in those of a measurement.
const CLICK_SIGMAS: f64 = 5.0;
/// Doubt of the rate of the error after a click, arcsec/s.
const CLICK_RATE_ARCSEC_S: f64 = 1.0;
/// How long a person's choice holds before the light is seen again, s.
const CHOSEN_S: f64 = 10.0;

/// How the estimator works.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct EstimatorOptions {
    /// Doubt of the elements along the track at the start, s (1 σ).
    pub along_s: f64,
    /// Doubt of elements and pointing across the track and along it, arcsec (1 σ).
    pub across_arcsec: f64,
    /// Error of one measurement of the place, arcsec per axis.
    pub measured_arcsec: f64,
    /// What the rate of the error wanders by, arcsec/s in a second.
    pub wander_arcsec_s: f64,
    /// Gate of a measurement, in σ, once locked.
    pub gate: f64,
    /// How much brighter or fainter a spot may become from one frame to the next and still be the target: a star that it crosses is not.
    pub flux_ratio: f64,
    /// How long a lock is kept without the target, s.
    pub coast_s: f64,
    /// Longest time between two frames, s.
    pub frame_s: f64,
}

impl Default for EstimatorOptions {
    fn default() -> Self {
        Self {
            along_s: 2.0,
            across_arcsec: 40.0,
            measured_arcsec: 0.6,
            wander_arcsec_s: 5.0,
            gate: 5.0,
            flux_ratio: 2.0,
            coast_s: 60.0,
            frame_s: 0.1,
        }
    }
}

/// Error of a target along its track (as time) and across it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Offset {
    /// By how much later the prediction is asked, s; for a target slower than 1″/s, the distance along its track, arcsec.
    pub along: Drift,
    /// To the left of the track, arcsec.
    pub across: Drift,
}

/// A spot that may be the target: where it was against the prediction when it was first seen, and last.
#[derive(Debug, Clone, Copy)]
struct Trail {
    first_s: f64,
    first: [f64; 2],
    last: [f64; 2],
    last_s: f64,
    flux: f64,
    seen: u32,
}

/// What became of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Found {
    /// The target, and the offset has learnt from it.
    Target,
    /// Locked just now.
    Locked,
    /// Nothing that can be the target.
    Nothing,
}

/// Distance along the track for each second by which an offset along it is counted, arcsec/s, at a speed.
fn pace(speed_rad_s: f64) -> f64 {
    (speed_rad_s * ARCSEC).max(SLOWEST_ARCSEC_S)
}

/// Follows one target through frames.
#[derive(Debug, Clone)]
pub(super) struct Estimator {
    pub offset: Offset,
    options: EstimatorOptions,
    at_s: Option<f64>,
    trails: Vec<Trail>,
    flux: Option<f64>,
    pub locked: bool,
    pub seen_s: Option<f64>,
    /// Since when spots are passed over for their brightness, s.
    odd_since: Option<f64>,
    /// Until when a person's choice needs no trail among the stars, s.
    chosen_until_s: f64,
}

impl Estimator {
    pub fn new(options: EstimatorOptions) -> Self {
        let offset = Offset {
            along: Drift::new(options.along_s, 0.01 * options.along_s),
            across: Drift::new(options.across_arcsec, 0.1 * options.across_arcsec),
        };
        let (trails, flux, seen_s, odd_since) = (Vec::new(), None, None, None);
        let chosen_until_s = f64::NEG_INFINITY;
        Self {
            offset,
            options,
            at_s: None,
            trails,
            flux,
            locked: false,
            seen_s,
            odd_since,
            chosen_until_s,
        }
    }

    /// Where a direction lies from the path's place without what is known across the track: along it and to its left, arcsec.
    fn from_place(place: &Place, seen: DVec3) -> [f64; 2] {
        let off = seen - place.direction * seen.dot(place.direction);
        place.track().map(|axis| off.dot(axis) * ARCSEC)
    }

    /// A person said which light is the target: its direction in the mount's axes, in a frame at a time of the path; `place` is the path's place at that time and
    /// the known offset. `now_s` is the time of the path when it was said.
    pub fn lock(&mut self, seen: DVec3, time_s: f64, place: &Place, now_s: f64) {
        let (speed, pace) = (place.speed_rad_s() * ARCSEC, pace(place.speed_rad_s()));
        let [along, left] = Self::from_place(place, seen);
        // A click hits the light's middle by some pixels only, and its rate is not known.
        let (sigma, rate) = (CLICK_SIGMAS * self.options.measured_arcsec, CLICK_RATE_ARCSEC_S);
        let later_s = (self.offset.along.value * speed + along) / pace;
        self.offset.along = self.offset.along.known(later_s, sigma / pace, rate / pace);
        self.offset.across = self.offset.across.known(left, sigma, rate);
        self.at_s = Some(time_s);
        self.locked = true;
        self.trails.clear();
        (self.flux, self.odd_since, self.seen_s) = (None, None, Some(now_s));
        self.chosen_until_s = now_s + CHOSEN_S;
    }

    /// A person said that the target is believed to be elsewhere by so much, a vector in the mount's axes at a place of the path.
    pub fn shift(&mut self, by: DVec3, place: &Place) {
        let [along, left] = place.track().map(|axis| by.dot(axis) * ARCSEC);
        self.offset.along.value += along / pace(place.speed_rad_s());
        self.offset.across.value += left;
        self.trails.clear();
    }

    /// The telescope looks away for longer than a rate that was learnt from frames holds: the offset stays what it is.
    pub fn rest(&mut self) {
        (self.offset.along.rate, self.offset.across.rate) = (0.0, 0.0);
    }

    /// Time since the offset was carried on last, s, at a time of the path.
    pub fn since_s(&self, time_s: f64) -> f64 {
        self.at_s.map_or(0.0, |at| time_s - at)
    }

    /// Goes on to a time of the path, with the target's speed, rad/s.
    pub fn advance(&mut self, time_s: f64, speed_rad_s: f64) {
        let dt = self.at_s.map_or(0.0, |at| time_s - at);
        self.at_s = Some(time_s);
        if dt <= 0.0 {
            return;
        }
        let noise = self.options.wander_arcsec_s;
        // Before the lock nothing is learnt: the doubt stays what it was.
        if self.locked {
            self.offset.along.advance(dt, noise / pace(speed_rad_s));
            self.offset.across.advance(dt, noise);
        }
        if self.seen_s.is_some_and(|seen| time_s - seen > self.options.coast_s) && self.locked {
            self.locked = false;
            self.trails.clear();
            self.flux = None;
        }
    }

    /// The predicted direction at a path's place at the known time, displaced by what is known across the track, and along it where the target is too slow for
    /// another time to do that, `ahead_s` after the last frame.
    pub fn displaced(&self, place: &Place, ahead_s: f64) -> DVec3 {
        let [along, left] = place.track();
        let speed_rad_s = place.speed_rad_s();
        let short = pace(speed_rad_s) - speed_rad_s * ARCSEC;
        let by = along * (self.offset.along.after(ahead_s) * short)
            + left * self.offset.across.after(ahead_s);
        (place.direction + by / ARCSEC).normalize()
    }

    /// Learns from a frame: directions in the mount's axes with their brightness, at a time of the path. `place` is the path's place at that time and the known
    /// offset, `stars_rad_s` the speed of the target against the stars, `blur_arcsec` by how much it is not known where the mount stood (1 σ).
    pub fn learn(
        &mut self,
        spots: &[(DVec3, f64)],
        time_s: f64,
        place: &Place,
        stars_rad_s: f64,
        blur_arcsec: f64,
    ) -> Found {
        let speed = pace(place.speed_rad_s());
        let [along, left] = place.track();
        let here = self.displaced(place, 0.0);
        let beside = |x: DVec3| {
            let off = x - here * x.dot(here);
            [off.dot(along) * ARCSEC, off.dot(left) * ARCSEC]
        };
        let options = self.options;
        let measured_arcsec = options.measured_arcsec.hypot(blur_arcsec);
        let sigma = [
            (self.offset.along.sigma() * speed).hypot(if self.locked {
                0.0
            } else {
                options.across_arcsec
            }),
            self.offset.across.sigma(),
        ]
        .map(|sigma| sigma.hypot(measured_arcsec));
        let gate = sigma.map(|sigma| options.gate * sigma);
        let inside = |off: [f64; 2]| off[0].abs() < gate[0] && off[1].abs() < gate[1];
        let seen: Vec<([f64; 2], f64)> = spots
            .iter()
            .map(|(x, flux)| (beside(*x), *flux))
            .filter(|(off, _)| inside(*off))
            .collect();
        let fresh = self.seen_s.is_some_and(|seen| time_s - seen < self.kept_s())
            || time_s < self.chosen_until_s;
        if self.locked && fresh {
            let distance = |off: &[f64; 2]| (off[0] / sigma[0]).hypot(off[1] / sigma[1]);
            let nearest = seen.iter().min_by(|a, b| distance(&a.0).total_cmp(&distance(&b.0)));
            let Some((off, flux)) = nearest else { return Found::Nothing };
            // Two lights in the gate, or one that is too bright: a star passes.
            let odd = self.flux.is_some_and(|usual| {
                let ratio = flux / usual;
                ratio > options.flux_ratio || ratio < 1.0 / options.flux_ratio
            });
            let crossing = odd || seen.len() > 1;
            if crossing && time_s - *self.odd_since.get_or_insert(time_s) < self.kept_s() {
                return Found::Nothing;
            }
            if !crossing {
                self.odd_since = None;
            }
            self.take(*off, *flux, time_s, speed, measured_arcsec);
            return Found::Target;
        }
        self.trails(&seen, time_s, stars_rad_s * ARCSEC).map_or(Found::Nothing, |(off, flux)| {
            // The first frames of a lock come after many without: what was known is old.
            self.locked = true;
            self.odd_since = None;
            self.flux = Some(flux);
            self.take(off, flux, time_s, speed, measured_arcsec);
            Found::Locked
        })
    }

    /// How long a light may be missing and still be the one that was followed, s: three frames, a second at least.
    fn kept_s(&self) -> f64 {
        (3.0 * self.options.frame_s).max(1.0)
    }

    fn take(&mut self, off: [f64; 2], flux: f64, time_s: f64, speed: f64, sigma: f64) {
        self.offset.along.learn(off[0] / speed, sigma / speed);
        self.offset.across.learn(off[1], sigma);
        self.seen_s = Some(time_s);
        self.chosen_until_s = f64::NEG_INFINITY;
        self.flux = Some(self.flux.map_or(flux, |usual| usual + 0.2 * (flux - usual)));
        self.trails.clear();
    }

    /// Goes on with the trails of all spots, and gives the one that stands still against the prediction while the stars went by.
    fn trails(
        &mut self,
        seen: &[([f64; 2], f64)],
        time_s: f64,
        stars_arcsec_s: f64,
    ) -> Option<([f64; 2], f64)> {
        // Spots of noise make trails too: those that nobody saw for a second go.
        const MOST: usize = 500;
        let kept_s = self.kept_s();
        self.trails.retain(|trail| time_s - trail.last_s < kept_s);
        let mut found = None;
        let mut fresh = Vec::new();
        for (off, flux) in seen.iter().take(MOST) {
            let near = |trail: &&mut Trail| {
                let step = (off[0] - trail.last[0]).hypot(off[1] - trail.last[1]);
                let dt = time_s - trail.last_s;
                dt > 0.0 && step < 4.0 + 0.25 * stars_arcsec_s * dt
            };
            match self.trails.iter_mut().find(near) {
                Some(trail) => {
                    trail.last = *off;
                    trail.last_s = time_s;
                    trail.flux = *flux;
                    trail.seen += 1;
                    let dt = time_s - trail.first_s;
                    let moved = (off[0] - trail.first[0]).hypot(off[1] - trail.first[1]);
                    let stars = stars_arcsec_s * dt;
                    if trail.seen >= 3 && stars > 25.0 && moved < 0.2 * stars + 3.0 {
                        let better = |(_, least): &([f64; 2], f64)| moved < *least;
                        if found.as_ref().is_none_or(better) {
                            found = Some((*off, moved));
                        }
                    }
                }
                None => fresh.push(Trail {
                    first_s: time_s,
                    first: *off,
                    last: *off,
                    last_s: time_s,
                    flux: *flux,
                    seen: 1,
                }),
            }
        }
        fresh.truncate(MOST.saturating_sub(self.trails.len()));
        self.trails.extend(fresh);
        let (off, _) = found?;
        let flux = self.trails.iter().find(|trail| trail.last == off).map(|trail| trail.flux)?;
        Some((off, flux))
    }
}
