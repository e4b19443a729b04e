//! SGP4 for one set of elements, and the way from its frame to the GCRS.

use super::{DecayCause, OrbitError, State, Tle, seconds_between};
use glam::{DMat3, DVec3};
use hifitime::Epoch;
use sgp4::MinutesSinceEpoch;
use sunglint_formats::time::format_utc;
use sunglint_radiometry::sky::SkyFrame;

/// The Earth's equatorial radius of WGS 72, which SGP4 keeps, km.
const WGS72_RADIUS_KM: f64 = 6378.135;
/// Elements older than this are warned of, days.
const OLD_DAYS: f64 = 3.0;
/// Elements older than this are no longer an orbit, days.
const STALE_DAYS: f64 = 30.0;
/// Minutes from the epoch beyond which SGP4 is not asked: 1900 years. (Resonant orbits are integrated in steps of 720 min.)
const FURTHEST_MIN: f64 = 1e9;

/// SGP4 (SDP4 for periods of 225 min and more) for one set of elements, as Vallado et al. published it in 2006
/// (AIAA 2006-6753): WGS 72, with the sidereal time and the choices that the elements were fitted with ("AFSPC-compatible").
#[derive(Debug, Clone, PartialEq)]
pub struct TleOrbit {
    tle: Box<Tle>,
    constants: Box<sgp4::Constants>,
    /// Where the integration of a resonance begins, if not at the elements' epoch.
    start: Option<Start>,
}

/// A state of the integrator of resonances.
#[derive(Clone, Copy, PartialEq)]
struct Start(sgp4::ResonanceState);

impl std::fmt::Debug for Start {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Start({} min)", self.0.t())
    }
}

impl Start {
    /// Whether the integrator, which only goes on from where it is, comes to a time from here.
    fn leads_to(&self, minutes: f64) -> bool {
        let at = self.0.t();
        at * minutes > 0.0 && at.abs() <= minutes.abs()
    }
}

impl TleOrbit {
    /// The orbit of a set of elements.
    ///
    /// # Errors
    /// [`OrbitError::Elements`] for elements from which SGP4 cannot start: an eccentricity of 1 and above, a mean motion that
    /// has no orbit.
    pub fn new(tle: Tle) -> Result<Self, OrbitError> {
        match sgp4::Constants::from_elements_afspc_compatibility_mode(&tle.elements) {
            Ok(constants) => {
                Ok(Self { tle: Box::new(tle), constants: Box::new(constants), start: None })
            }
            Err(error) => {
                Err(OrbitError::Elements { name: tle.label(), reason: error.to_string() })
            }
        }
    }

    /// The same orbit, ready to be asked for many states from `from` to `to`: to the bit the same states everywhere.
    ///
    /// SDP4 integrates resonances (periods of about 12 h and 24 h) from the elements' epoch on in steps of 12 h, for every state
    /// anew: 0.2 ms a year. Here the steps that all states of the stretch share are taken once.
    #[must_use]
    pub fn near(&self, from: Epoch, to: Epoch) -> Self {
        let minutes = |epoch| seconds_between(self.tle.epoch, epoch) / 60.0;
        let (a, b) = (minutes(from), minutes(to));
        // The end that is nearer to the elements' epoch, and the light time before it.
        let nearest = if a.abs() < b.abs() { a } else { b };
        let first = nearest - nearest.signum() * 1.0;
        let mut near = Self { start: None, ..self.clone() };
        let reachable = a * b > 0.0 && first * nearest > 0.0 && first.abs() < FURTHEST_MIN;
        let Some(mut state) = near.constants.initial_state().filter(|_| reachable) else {
            return near;
        };
        // The steps depend on the resonance alone, and are taken whatever else SDP4 finds wrong then.
        let _ =
            near.constants.propagate_from_state(MinutesSinceEpoch(first), Some(&mut state), true);
        near.start = Some(Start(state));
        near
    }

    /// The elements.
    pub fn tle(&self) -> &Tle {
        &self.tle
    }

    /// The state in TEME (true equator, mean equinox) of date, m and m/s: what SGP4 itself gives.
    ///
    /// The time since the elements' epoch is elapsed time: a leap second between them counts. (Programs that subtract calendar
    /// dates are off by 7 km along the track after one.)
    ///
    /// # Errors
    /// [`OrbitError::Decayed`].
    pub fn teme(&self, epoch: Epoch) -> Result<State, OrbitError> {
        self.teme_after(seconds_between(self.tle.epoch, epoch) / 60.0)
            .map_err(|cause| self.decayed(epoch, cause))
    }

    /// The same for minutes after the elements' epoch.
    ///
    /// # Errors
    /// Why SGP4 has no place then; [`DecayCause::NotFinite`] also for minutes that are no number, or more than 1e9.
    ///
    /// ```
    /// use sunglint_ephemeris::orbit::{TleOrbit, tle};
    ///
    /// # const ISS: &str = "ISS (ZARYA)
    /// # 1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927
    /// # 2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537
    /// # ";
    /// let orbit = TleOrbit::new(tle::parse("iss.tle", ISS)?.remove(0))?;
    /// let state = orbit.teme_after(90.0)?;
    /// // A low orbit: 350 km high, 7.7 km/s.
    /// assert!((state.position_m.length() - 6.73e6).abs() < 3e4);
    /// assert!((state.velocity_m_s.length() - 7.7e3).abs() < 60.0);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn teme_after(&self, minutes: f64) -> Result<State, DecayCause> {
        if !(-FURTHEST_MIN..=FURTHEST_MIN).contains(&minutes) {
            return Err(DecayCause::NotFinite);
        }
        let start = self.start.filter(|start| start.leads_to(minutes)).map(|start| start.0);
        let mut resonance = start.or_else(|| self.constants.initial_state());
        let found = self
            .constants
            .propagate_from_state(MinutesSinceEpoch(minutes), resonance.as_mut(), true)
            .map_err(|error| match error {
                sgp4::Error::OutOfRangeEccentricity { eccentricity, .. } => {
                    DecayCause::MeanEccentricity(eccentricity)
                }
                sgp4::Error::OutOfRangePerturbedEccentricity { eccentricity, .. } => {
                    DecayCause::PerturbedEccentricity(eccentricity)
                }
                sgp4::Error::NegativeSemiLatusRectum { .. } => DecayCause::SemiLatusRectum,
            })?;
        let (position_km, velocity_km_s) =
            (DVec3::from_array(found.position), DVec3::from_array(found.velocity));
        if !position_km.is_finite() || !velocity_km_s.is_finite() {
            return Err(DecayCause::NotFinite);
        }
        if position_km.length() < WGS72_RADIUS_KM {
            return Err(DecayCause::BelowSurface(position_km.length()));
        }
        Ok(State { position_m: position_km * 1e3, velocity_m_s: velocity_km_s * 1e3 })
    }

    /// The state in the GCRS; see [`Orbit::state`](super::Orbit::state) about the frame's epoch.
    ///
    /// # Errors
    /// [`OrbitError::Decayed`] where SGP4 has no place, or has it inside the Earth.
    ///
    /// ```
    /// use sunglint_ephemeris::orbit::{TleOrbit, tle};
    /// use sunglint_radiometry::sky::{EarthOrientation, SkyFrame};
    ///
    /// # const ISS: &str = "ISS (ZARYA)
    /// # 1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927
    /// # 2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537
    /// # ";
    /// let elements = tle::parse("iss.tle", ISS)?.remove(0);
    /// let epoch = elements.epoch;
    /// let orbit = TleOrbit::new(elements)?;
    /// let state = orbit.state(epoch, &SkyFrame::new(epoch, &EarthOrientation::zero())?)?;
    /// // Turning the axes leaves lengths as they are.
    /// let teme = orbit.teme(epoch)?;
    /// assert!((state.position_m.length() - teme.position_m.length()).abs() < 1e-3);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn state(&self, epoch: Epoch, frame: &SkyFrame) -> Result<State, OrbitError> {
        let teme = self.teme(epoch)?;
        let rotation = teme_to_gcrs(frame);
        // TEME does not turn with the Earth: what the Earth's rotation adds to a velocity on the way to the ITRS it takes
        // away again on the way to the GCRS.
        Ok(State {
            position_m: rotation * teme.position_m,
            velocity_m_s: rotation * teme.velocity_m_s,
        })
    }

    /// Returns a warning about the age of the elements between two epochs.
    pub fn warnings(&self, from: Epoch, to: Epoch) -> Vec<String> {
        let days = |epoch| seconds_between(self.tle.epoch, epoch) / 86_400.0;
        let (first, last) = (days(from), days(to));
        let worst = if first.abs() > last.abs() { first } else { last };
        let age = worst.abs();
        if age <= OLD_DAYS {
            return Vec::new();
        }
        let side = if worst > 0.0 { "old" } else { "ahead of their epoch" };
        let what = format!(
            "{}: the elements of {} are {age:.1} days {side}",
            self.tle.label(),
            format_utc(self.tle.epoch, 0)
        );
        vec![if age > STALE_DAYS {
            format!(
                "{what}: after more than {STALE_DAYS:.0} days SGP4 is no prediction, the place along the track may be anywhere (1 to 3 km a \
                 day in low orbit and faster than that with time, minutes after a month); take elements of that day"
            )
        } else {
            format!(
                "{what}: expect an error of the order of 1 to 3 km a day along the track in low orbit; take elements of that day"
            )
        }]
    }

    fn decayed(&self, epoch: Epoch, cause: DecayCause) -> OrbitError {
        OrbitError::Decayed {
            name: self.tle.label(),
            epoch_utc: format_utc(epoch, 0),
            elements_epoch_utc: format_utc(self.tle.epoch, 0),
            hours_after_epoch: seconds_between(self.tle.epoch, epoch) / 3600.0,
            cause,
        }
    }
}

/// The rotation from TEME of date to the GCRS.
///
/// Rotation from TEME to the GCRS. TEME is turned, as Vallado et al. (2006) define it, to the ITRS by the Greenwich mean sidereal time of 1982 and polar
/// motion; from there the frame's own rotation leads to the GCRS. Polar motion cancels, and of UT1 only the difference of
/// the two angles remains, GMST82 − ERA, which 1 s of UT1 changes by 8e−12 rad: written so, the rotation does not feel
/// whether UT1 and the pole are known. (Celestial pole offsets are left out, below 1 mas.)
pub(super) fn teme_to_gcrs(frame: &SkyFrame) -> DMat3 {
    let ut1 = frame.times().ut1;
    let sidereal = sofars::erst::gmst82(ut1.midnight, ut1.fraction);
    let angle = sidereal - frame.earth_rotation_angle_rad();
    // A vector turns by −angle about the pole where its axes turn by +angle: R₃(angle) of the papers.
    frame.gcrs_to_cirs().transpose() * DMat3::from_rotation_z(-angle)
}
