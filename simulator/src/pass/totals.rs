//! Summary of all samples of a pass, found piece by piece: counts, extremes, medians.

use super::promise::{Promises, Smeared};
use super::result::not_modelled;
use super::{Pass, Piece, Place, Promise, Simulation, StandardMagnitude, StatedError};
use crate::light::{Need, SceneReport};
use hifitime::Epoch;
use sunglint_numerics::order::RunningMedian;
use sunglint_radiometry::sky::OrientationOrigin;

/// The place of V among the bands.
const V: usize = 2;

/// A value of one sample, and its time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct At {
    /// The value.
    pub value: f64,
    /// Time of the sample.
    pub time: Epoch,
}

/// Brightest and faintest of magnitudes while the body is visible.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ends {
    /// The brightest, the first of several.
    pub brightest: At,
    /// The faintest.
    pub faintest: At,
}

/// Where the body stands highest, the last of several such samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Highest {
    /// True altitude, degrees.
    pub altitude_deg: f64,
    /// Azimuth there, degrees.
    pub azimuth_deg: f64,
    /// Time of the sample.
    pub time: Epoch,
    /// The moment that its place is of, which a time offset of a fit parts from the time.
    pub epoch: Epoch,
}

/// The sample of a channel that has the highest rate, the last of several.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HighestRate {
    /// The rate, Hz.
    pub rate_hz: f64,
    /// The stated error, Hz.
    pub error_hz: f64,
    /// The rate without the air, Hz.
    pub above_air_hz: f64,
    /// The uncertainty in an exposure, Hz; none where the detector says nothing of it.
    pub sigma_hz: Option<f64>,
    /// Time of the sample.
    pub time: Epoch,
}

/// Summary of all samples of a channel.
#[derive(Debug, Clone)]
pub struct ChannelTotals {
    /// The channel.
    pub name: String,
    /// Highest rate while the body is visible; none without light.
    pub highest: Option<HighestRate>,
    /// Samples past saturation.
    pub saturated: usize,
    /// The largest width for which light, material or air was not tabulated, nm.
    pub uncovered_nm: f64,
    stated: RunningMedian,
}

impl ChannelTotals {
    /// The stated errors of the rates, of themselves, over the visible samples with light; `None` without any.
    pub fn stated_error(&self) -> Option<StatedError> {
        StatedError::of(&self.stated)
    }
}

/// Summary of all samples of a pass, in little memory: some megabytes and no more, however many samples there are.
///
/// Counts and extremes are exact, whatever the pieces. Medians are exact up to [`RunningMedian::EXACT`] values, and to a part in 8192 of themselves beyond.
#[derive(Debug, Clone)]
pub struct Totals<'a> {
    /// The whole pass.
    pub pass: &'a Pass,
    /// Name of what is observed.
    pub object: String,
    /// Needs of the scene, effect by effect.
    pub needs: Vec<Need>,
    /// Terms of the light that have weights.
    pub terms: usize,
    /// Samples.
    pub samples: usize,
    /// Samples that are not hidden.
    pub visible: usize,
    /// Those of them in the Earth's shadow, or its edge.
    pub eclipsed: usize,
    /// Visible samples in which the Sun stands above −6° at the station.
    pub day: usize,
    /// Where the body stands highest.
    pub highest: Option<Highest>,
    /// The least range, m.
    pub nearest_m: f64,
    /// The least and the largest phase angle, degrees.
    pub phases_deg: (f64, f64),
    /// V above the air.
    pub v_above_air: Option<Ends>,
    /// V after the air.
    pub v_after_air: Option<Ends>,
    /// V above the air, brought to 1,000 km.
    pub v_1000km: Option<Ends>,
    /// V above the air, brought to 1,000 km and a phase angle of 90°.
    pub v_standard: Option<Ends>,
    /// The channels of the station.
    pub channels: Vec<ChannelTotals>,
    /// Whether any sample has light.
    pub has_light: bool,
    /// Materials whose doubt is known, with commas.
    pub doubted: String,
    /// Least and largest degree of polarisation in V over the visible samples with light, and the largest error.
    pub polarisation_in_v: Option<[f64; 3]>,
    /// Materials whose polarisation is not known.
    pub not_polarised: Vec<String>,
    /// Where the Earth's orientation of the first sample was from.
    pub orientation: Option<OrientationOrigin>,
    /// The first that is outside of the table.
    pub(super) outside: Option<OrientationOrigin>,
    /// Whether the Sun lights the body in any sample.
    pub(super) any_sun: bool,
    pub(super) scene: SceneReport,
    bins: RunningMedian,
    material: RunningMedian,
    promises: Promises,
}

impl Simulation<'_> {
    /// Summary of all samples.
    pub fn totals(&self) -> Totals<'_> {
        let mut totals = Totals::new(self.pass);
        totals.add(&Piece { simulation: self, material: None, polarisation: None });
        totals
    }
}

impl<'a> Totals<'a> {
    /// Summary of no sample of a pass yet.
    pub fn new(pass: &'a Pass) -> Self {
        Self {
            pass,
            object: String::new(),
            needs: Vec::new(),
            terms: 0,
            samples: 0,
            visible: 0,
            eclipsed: 0,
            day: 0,
            highest: None,
            nearest_m: f64::INFINITY,
            phases_deg: (f64::INFINITY, f64::NEG_INFINITY),
            v_above_air: None,
            v_after_air: None,
            v_1000km: None,
            v_standard: None,
            channels: Vec::new(),
            has_light: false,
            doubted: String::new(),
            polarisation_in_v: None,
            not_polarised: Vec::new(),
            orientation: None,
            outside: None,
            any_sun: false,
            scene: SceneReport::default(),
            bins: RunningMedian::default(),
            material: RunningMedian::default(),
            promises: Promises::default(),
        }
    }

    /// Takes the next piece in.
    pub fn add(&mut self, piece: &Piece<'_>) {
        let simulation = piece.simulation;
        if self.samples == 0 {
            self.begin(piece);
        }
        let times = &simulation.pass.times;
        for (place, time) in simulation.places.iter().zip(times) {
            self.add_place(place, *time);
        }
        let hidden = |i: usize| simulation.places[i].hidden;
        let standard = |law| simulation.standard_magnitudes(law);
        for (ends, magnitudes) in [
            (&mut self.v_above_air, simulation.magnitudes.column(V).to_vec()),
            (&mut self.v_after_air, simulation.ground_magnitudes.column(V).to_vec()),
            (&mut self.v_1000km, standard(StandardMagnitude::Range)),
            (&mut self.v_standard, standard(StandardMagnitude::IlluminatedFraction)),
        ] {
            let all = magnitudes.into_iter().zip(times).enumerate();
            for (_, (value, time)) in all.filter(|(i, (m, _))| m.is_finite() && !hidden(*i)) {
                widen(ends, At { value, time: *time });
            }
        }
        for (total, channel) in self.channels.iter_mut().zip(&simulation.channels) {
            for (i, time) in times.iter().enumerate() {
                let (rate_hz, error_hz) = (channel.rate_hz[i], channel.error_hz[i]);
                total.saturated += usize::from(channel.predicted[i].saturated);
                total.uncovered_nm = total.uncovered_nm.max(channel.uncovered_nm[i]);
                if hidden(i) || rate_hz.is_nan() || rate_hz <= 0.0 {
                    continue;
                }
                if error_hz.is_finite() {
                    total.stated.add(error_hz / rate_hz);
                }
                let more = total.highest.is_none_or(|most| rate_hz >= most.rate_hz);
                if rate_hz.is_finite() && more {
                    let above_air_hz = channel.above_air_hz[i];
                    let (sigma_hz, time) = (channel.predicted[i].sigma_hz, *time);
                    total.highest =
                        Some(HighestRate { rate_hz, error_hz, above_air_hz, sigma_hz, time });
                }
            }
        }
        let rows = simulation.spectra.rows().into_iter().zip(simulation.spectra_errors.rows());
        for (i, (values, errors)) in rows.enumerate() {
            self.has_light |= values.iter().any(|v| *v > 0.0);
            let mean = values.mean().unwrap_or(0.0);
            if !hidden(i) && mean > 0.0 {
                let good = errors.iter().map(|e| f64::from(*e)).filter(|e| e.is_finite());
                good.for_each(|error| self.bins.add(error / mean));
            }
        }
        self.promises.add(simulation);
        self.add_extras(piece);
    }

    fn begin(&mut self, piece: &Piece<'_>) {
        let simulation = piece.simulation;
        self.object = simulation.object.clone();
        self.needs = simulation.needs.clone();
        self.scene = simulation.scene.clone();
        self.terms = simulation.weights.ncols();
        self.orientation = simulation.places.first().map(|place| place.orientation);
        let channel = |channel: &super::ChannelSamples| ChannelTotals {
            name: channel.name.clone(),
            highest: None,
            saturated: 0,
            uncovered_nm: 0.0,
            stated: RunningMedian::default(),
        };
        self.channels = simulation.channels.iter().map(channel).collect();
        self.doubted = piece.material.as_ref().map(|m| m.names()).unwrap_or_default();
        let unknown = piece.polarisation.as_ref().map(|p| p.unknown.clone());
        self.not_polarised = unknown.unwrap_or_default();
    }

    fn add_place(&mut self, place: &Place, time: Epoch) {
        self.samples += 1;
        if !place.hidden {
            self.visible += 1;
            self.eclipsed += usize::from(place.sunlit < 1.0);
            self.day += usize::from(place.sun_altitude_deg > -6.0);
        }
        self.any_sun |= place.sunlit != 0.0;
        if self.outside.is_none() && place.orientation.is_outside() {
            self.outside = Some(place.orientation);
        }
        let geometry = &place.geometry;
        let altitude_deg = geometry.horizontal.altitude_deg();
        if self.highest.is_none_or(|most| altitude_deg.total_cmp(&most.altitude_deg).is_ge()) {
            let azimuth_deg = geometry.horizontal.azimuth_deg();
            self.highest = Some(Highest { altitude_deg, azimuth_deg, time, epoch: geometry.epoch });
        }
        self.nearest_m = self.nearest_m.min(geometry.range_m);
        let phase_deg = geometry.phase_deg();
        let (least, most) = self.phases_deg;
        self.phases_deg = (least.min(phase_deg), most.max(phase_deg));
    }

    fn add_extras(&mut self, piece: &Piece<'_>) {
        if let Some(doubt) = &piece.material {
            let known = doubt.relative.iter().copied().filter(|r| r.is_finite());
            known.for_each(|r| self.material.add(r));
        }
        let Some(found) = &piece.polarisation else { return };
        for (i, place) in piece.simulation.places.iter().enumerate() {
            let (degree, error) = (found.v[i], found.v_error[i]);
            if place.hidden || !degree.is_finite() {
                continue;
            }
            self.polarisation_in_v = Some(match self.polarisation_in_v {
                None => [degree, degree, error],
                Some([least, most, worst]) => {
                    [least.min(degree), most.max(degree), worst.max(error)]
                }
            });
        }
    }

    /// The promise of all samples together.
    pub fn promise(&self) -> Promise {
        self.promises.promise(self.pass, &self.needs)
    }

    /// Samples whose light changes too much while they are exposed; `None` without any.
    pub(super) fn smeared(&self) -> Option<Smeared> {
        self.promises.smeared()
    }

    /// Returns the effects that are not in the simulation ([`Simulation::not_modelled`]).
    pub fn not_modelled(&self) -> Vec<String> {
        not_modelled(&self.needs)
    }

    /// The stated errors of all bins of the visible samples, of the sample's mean over the bins; `None` without light.
    pub fn stated_error_of_bins(&self) -> Option<StatedError> {
        StatedError::of(&self.bins)
    }

    /// Median and largest of the relative half-widths by the doubt of the materials, over the samples with light.
    pub fn material_error(&self) -> Option<StatedError> {
        StatedError::of(&self.material)
    }
}

/// Takes a magnitude between the ends: of equal ones the first is the brightest and the last the faintest.
fn widen(ends: &mut Option<Ends>, at: At) {
    let Some(ends) = ends else {
        *ends = Some(Ends { brightest: at, faintest: at });
        return;
    };
    if at.value.total_cmp(&ends.brightest.value).is_lt() {
        ends.brightest = at;
    }
    if at.value.total_cmp(&ends.faintest.value).is_ge() {
        ends.faintest = at;
    }
}
