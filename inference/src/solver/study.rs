//! Simulated passes as a [`Model`].

use super::{Columns, Model, ModelError};
use ndarray::{Array2, Array3};
use sunglint_radiometry::quadrature::Product;
use sunglint_radiometry::spectrum::{Factor, Spectrum, SpectrumError};
use sunglint_simulator::attitude::Attitude;
use sunglint_simulator::light::{Source, Term};
use sunglint_simulator::pass::{Averaged, Study, TermRates, Thinned, airmass};
use sunglint_simulator::target::Target;

/// Function that makes a thing from the parameters' values: called where one of those that it uses has changed.
type Make<T> = Box<dyn Fn(&[f64]) -> Result<T, String> + Send + Sync>;

/// How a part of a pass follows the parameters.
pub struct Law<T> {
    /// The parameters, by number, that it depends on.
    pub uses: Vec<usize>,
    /// The part for values of all parameters.
    pub make: Make<T>,
}

/// Light that is taken away beyond the model's air: 10^(−0.4 k X), k in magnitudes per airmass.
#[derive(Debug, Clone, PartialEq)]
pub struct Extinction {
    /// The parameter, by number.
    pub parameter: usize,
    /// In which channels of the data; all where `None`.
    pub channels: Option<Vec<usize>>,
}

/// In what unit a pass is compared.
#[derive(Debug, Clone, PartialEq)]
pub enum Unit {
    /// Rates of channels at the detector: for each channel of the data that of the station, `None` where it has none.
    Channels(Vec<Option<usize>>),
    /// Flux above the air in a band ([`sunglint_simulator::pass::BANDS`]), over that of magnitude 0: one channel.
    Band(usize),
}

/// How one pass follows the parameters.
#[derive(Default)]
pub struct Shaping {
    /// Attitude in the pass, as it follows the parameters.
    pub attitude: Option<Law<Attitude>>,
    /// Target in the pass, as it follows the parameters.
    pub target: Option<Law<Target>>,
    /// The parameter (s) that the model's times are later by than the data's.
    pub time_offset: Option<usize>,
    /// The parameter that all lengths of the body are multiplied by, as seen from afar: light goes with its square.
    pub size: Option<usize>,
    /// The parameter that all rates are multiplied by.
    pub gain: Option<usize>,
    /// Extinction.
    pub extinction: Vec<Extinction>,
    /// Errors of zero points, mag.
    pub zero_points: Vec<ZeroPoint>,
}

/// Error of the zero point of some samples of a pass: measured less true, mag.
#[derive(Debug, Clone, PartialEq)]
pub struct ZeroPoint {
    /// The parameter, by number.
    pub parameter: usize,
    /// Which samples it concerns.
    pub samples: Vec<bool>,
}

impl ZeroPoint {
    /// Factors of the light of `samples` samples, one each, at the parameters' values.
    pub fn factors(all: &[Self], values: &[f64], samples: usize) -> Vec<f64> {
        let of = |i: usize| -> f64 {
            let own = all.iter().filter(|z| z.samples.get(i).copied().unwrap_or(false));
            10_f64.powf(-0.4 * own.map(|z| values[z.parameter]).sum::<f64>())
        };
        (0..samples).map(of).collect()
    }
}

/// A pass, and the values of its laws' parameters the last time that they were followed.
struct Pass {
    study: Study,
    unit: Unit,
    shaping: Shaping,
    attitude_at: Option<Vec<f64>>,
    target_at: Option<Vec<f64>>,
    rates: Option<TermRates>,
    /// For the air at each epoch.
    airmass: Vec<f64>,
    /// Rates that are held: light that is not computed anew for each set of values.
    held: Option<Array2<f64>>,
}

/// Simulated passes whose materials are components. Light that no single material made (inter-reflection) is `fixed`.
pub struct StudyModel {
    passes: Vec<Pass>,
    components: Vec<Component>,
}

/// Light that has a coefficient of its own.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Component {
    /// The material.
    pub material: String,
    /// Which of its spectra, in the order of its model (coat before base); all where `None`.
    pub spectrum: Option<usize>,
}

impl StudyModel {
    /// From passes and what is to have a coefficient.
    pub fn new(passes: Vec<(Study, Unit, Shaping)>, components: Vec<Component>) -> Self {
        let pass = |(study, unit, shaping): (Study, Unit, Shaping)| {
            let airmass = airmasses(&study);
            Pass {
                attitude_at: None,
                target_at: None,
                rates: None,
                held: None,
                airmass,
                study,
                unit,
                shaping,
            }
        };
        Self { passes: passes.into_iter().map(pass).collect(), components }
    }

    /// The pass of a number as it stands now.
    pub fn study(&self, number: usize) -> Option<&Study> {
        self.passes.get(number).map(|p| &p.study)
    }

    /// Adds rates (epochs × channels of the data) to those of a pass that are not computed anew for other values: inter-reflection. Size, gain and extinction count for them.
    ///
    /// # Errors
    /// A pass that is not there, or rates of another shape.
    pub fn hold(&mut self, number: usize, rates: Array2<f64>) -> Result<(), ModelError> {
        let wrong = || ModelError(format!("held rates of curve {number} do not fit its samples"));
        let pass = self.passes.get_mut(number).ok_or_else(wrong)?;
        let channels = match &pass.unit {
            Unit::Channels(channels) => channels.len(),
            Unit::Band(_) => 1,
        };
        if rates.dim() != (pass.study.places().len(), channels) {
            return Err(wrong());
        }
        pass.held = Some(rates);
        Ok(())
    }

    /// Has samples averaged over their exposures where their middles would be wrong by more than a tolerance (relative, one for each pass), at the
    /// parameters' values ([`Study::average`]).
    ///
    /// # Errors
    /// Values for which there is no model.
    pub fn average(
        &mut self,
        values: &[f64],
        tolerances: &[f64],
    ) -> Result<Vec<Averaged>, ModelError> {
        let one = |(pass, tolerance): (&mut Pass, &f64)| {
            pass.follow(values)?;
            pass.rates = None;
            pass.study.average(*tolerance).map_err(|e| ModelError(e.to_string()))
        };
        self.passes.iter_mut().zip(tolerances).map(one).collect()
    }

    /// Has light computed at as few epochs of each pass as keep what is linear between them within `share` of the pass's tolerance, at the
    /// parameters' values ([`Study::thin`]).
    ///
    /// # Errors
    /// Values for which there is no model.
    pub fn thin(&mut self, values: &[f64], share: f64) -> Result<Vec<Thinned>, ModelError> {
        let one = |pass: &mut Pass| {
            pass.follow(values)?;
            pass.rates = None;
            let tolerance = share * pass.study.pass().tolerance;
            pass.study.thin(tolerance).map_err(|e| ModelError(e.to_string()))
        };
        self.passes.iter_mut().map(one).collect()
    }

    /// Returns the error of the lines between these epochs at the parameters' values; `None` for a pass whose light is computed at all of them.
    ///
    /// # Errors
    /// Values for which there is no model.
    pub fn thinned(&mut self, values: &[f64]) -> Result<Vec<Option<Thinned>>, ModelError> {
        let one = |pass: &mut Pass| {
            pass.follow(values)?;
            pass.study.thinned().map_err(|e| ModelError(e.to_string()))
        };
        self.passes.iter_mut().map(one).collect()
    }

    /// Returns the factors by which gain, size, extinction and errors of zero points multiply the light of a pass's samples (epochs × channels of the data), at the parameters' values; `None` for a pass that is not there.
    pub fn factors(&self, number: usize, values: &[f64]) -> Option<Array2<f64>> {
        self.passes.get(number).map(|pass| pass.factors(values))
    }

    /// Returns the components, each of which has a coefficient.
    pub fn components(&self) -> &[Component] {
        &self.components
    }
}

impl Model for StudyModel {
    fn columns(&mut self, values: &[f64]) -> Result<Vec<Columns>, ModelError> {
        let components = &self.components;
        self.passes.iter_mut().map(|pass| pass.columns(values, components)).collect()
    }

    fn log_derivative(&self, values: &[f64], parameter: usize) -> Option<Vec<Array2<f64>>> {
        self.passes.iter().map(|pass| pass.log_derivative(values, parameter)).collect()
    }
}

impl Pass {
    fn columns(&mut self, values: &[f64], components: &[Component]) -> Result<Columns, ModelError> {
        self.follow(values)?;
        let rates = match self.rates.take() {
            Some(rates) => rates,
            None => self.study.term_rates().map_err(|e| ModelError(e.to_string()))?,
        };
        let columns = self.summed(&rates, values, components);
        self.rates = Some(rates);
        Ok(columns)
    }

    /// Derivative of the logarithm of all rates by a parameter that does nothing but multiply them.
    fn log_derivative(&self, values: &[f64], parameter: usize) -> Option<Array2<f64>> {
        let Shaping { attitude, target, time_offset, size, gain, extinction, zero_points } =
            &self.shaping;
        let uses = |law: Option<&[usize]>| law.is_some_and(|uses| uses.contains(&parameter));
        if uses(attitude.as_ref().map(|l| &l.uses[..]))
            || uses(target.as_ref().map(|l| &l.uses[..]))
            || *time_offset == Some(parameter)
        {
            return None;
        }
        let channels = match &self.unit {
            Unit::Channels(channels) => channels.len(),
            Unit::Band(_) => 1,
        };
        let mut slope = Array2::zeros((self.study.places().len(), channels));
        for (own, power) in [(size, 2.0), (gain, 1.0)] {
            if *own == Some(parameter) {
                slope += power / values[parameter];
            }
        }
        let a_magnitude = -0.4 * std::f64::consts::LN_10;
        for ((i, c), slope) in slope.indexed_iter_mut() {
            let air = extinction.iter().filter(|e| e.parameter == parameter);
            let air = air.filter(|e| e.channels.as_ref().is_none_or(|all| all.contains(&c)));
            // Below the horizon there is no airmass, and nothing is compared.
            let airmass = if self.airmass[i].is_finite() { self.airmass[i] } else { 0.0 };
            *slope += a_magnitude * airmass * air.count() as f64;
            let own = zero_points.iter().filter(|z| z.parameter == parameter);
            let own = own.filter(|z| z.samples.get(i).copied().unwrap_or(false));
            *slope += a_magnitude * own.count() as f64;
        }
        Some(slope)
    }

    /// Brings the study to the parameters' values.
    fn follow(&mut self, values: &[f64]) -> Result<(), ModelError> {
        let wrong = |why: String| ModelError(why);
        if let Some(k) = self.shaping.time_offset {
            let before = self.study.places().first().map(|p| p.geometry.epoch);
            let moved = self.study.set_time_offset_s(values[k]);
            moved.map_err(|e| wrong(e.to_string()))?;
            if self.study.places().first().map(|p| p.geometry.epoch) != before {
                self.airmass = airmasses(&self.study);
                self.rates = None;
            }
        }
        let of = |uses: &[usize]| uses.iter().map(|k| values[*k]).collect::<Vec<f64>>();
        if let Some(law) = &self.shaping.attitude {
            let at = Some(of(&law.uses));
            if at != self.attitude_at {
                let attitude = (law.make)(values).map_err(wrong)?;
                self.study.set_attitude(attitude).map_err(|e| wrong(e.to_string()))?;
                self.attitude_at = at;
                self.rates = None;
            }
        }
        if let Some(law) = &self.shaping.target {
            let at = Some(of(&law.uses));
            if at != self.target_at {
                let target = (law.make)(values).map_err(wrong)?;
                self.study.set_target(target).map_err(|e| wrong(e.to_string()))?;
                self.target_at = at;
                self.rates = None;
            }
        }
        Ok(())
    }

    /// Factors of the light of all samples, epochs × channels of the data: whatever multiplies it alike, whichever material it comes from.
    fn factors(&self, values: &[f64]) -> Array2<f64> {
        let n = self.study.places().len();
        let channels = match &self.unit {
            Unit::Channels(channels) => channels.len(),
            Unit::Band(_) => 1,
        };
        let grey = self.shaping.gain.map_or(1.0, |k| values[k])
            * self.shaping.size.map_or(1.0, |k| values[k].powi(2));
        let zero = ZeroPoint::factors(&self.shaping.zero_points, values, n);
        let mut factors = Array2::zeros((n, channels));
        for (c, mut own) in factors.columns_mut().into_iter().enumerate() {
            let extinction: f64 = (self.shaping.extinction.iter())
                .filter(|e| e.channels.as_ref().is_none_or(|all| all.contains(&c)))
                .map(|e| values[e.parameter])
                .sum();
            for (i, own) in own.iter_mut().enumerate() {
                *own = match extinction {
                    0.0 => grey,
                    k => grey * 10_f64.powf(-0.4 * k * self.airmass[i]),
                } * zero[i];
            }
        }
        factors
    }

    fn summed(&self, rates: &TermRates, values: &[f64], components: &[Component]) -> Columns {
        let materials = &self.study.pass().target.materials;
        let owners = owners(&rates.terms, &|m| materials[m].name.as_str(), components);
        let factors = self.factors(values);
        let (n, channels) = factors.dim();
        let mut columns = Columns {
            fixed: Array2::zeros((n, channels)),
            columns: Array3::zeros((n, channels, components.len())),
        };
        for c in 0..channels {
            for i in 0..n {
                let row = match &self.unit {
                    Unit::Channels(of) => match of[c] {
                        Some(channel) => rates.rates_hz.slice(ndarray::s![i, channel, ..]),
                        None => continue,
                    },
                    Unit::Band(band) => rates.fluxes.slice(ndarray::s![i, *band, ..]),
                };
                let factor = factors[[i, c]];
                if let Some(held) = &self.held {
                    columns.fixed[[i, c]] += factor * held[[i, c]];
                }
                for (k, rate) in row.iter().enumerate() {
                    match owners[k] {
                        Some(component) => columns.columns[[i, c, component]] += factor * rate,
                        None => columns.fixed[[i, c]] += factor * rate,
                    }
                }
            }
        }
        columns
    }
}

/// The component of each term.
fn owners<'a>(
    terms: &[Term],
    name: &dyn Fn(usize) -> &'a str,
    components: &[Component],
) -> Vec<Option<usize>> {
    let of = |(k, term): (usize, &Term)| {
        let material = term.material.filter(|_| term.source != Source::Bounce)?;
        // The terms of a material come in the order of its spectra.
        let same = |t: &&Term| t.material == term.material && t.source == term.source;
        let own = terms[..k].iter().filter(same).count();
        components.iter().position(|c| {
            c.material == name(material) && c.spectrum.is_none_or(|wanted| wanted == own)
        })
    };
    terms.iter().enumerate().map(of).collect()
}

/// Relative air masses by Kasten and Young 1989, of apparent zenith angles; NaN below the horizon.
pub fn airmasses(study: &Study) -> Vec<f64> {
    study.places().iter().map(|p| p.apparent_zenith_deg.map_or(f64::NAN, airmass)).collect()
}

/// Returns the knots' weights in a channel's mean of a reflectance that is linear between knots (vacuum nm): ∫ h E T P λ dλ / ∫ E T P λ dλ = Σ_a h_a w_a, exactly, with
/// weights w_a that add up to 1. `transmission` is the air's; outside the knots the reflectance is taken as 0, so that they should span the channel.
///
/// # Errors
/// Knots that do not increase.
pub fn band_weights(
    study: &Study,
    channel: usize,
    transmission: Option<&Spectrum<sunglint_radiometry::spectrum::Transmission>>,
    knots_nm: &[f64],
) -> Result<Vec<f64>, SpectrumError> {
    let pass = study.pass();
    let mut product = Product::of(&pass.sun);
    if let Some(air) = transmission {
        product = product.times(air);
    }
    let product = pass.station.channels[channel].times_sensitivity(product).times_wavelength();
    let mut moments = product.hat_moments(knots_nm)?;
    let sum: f64 = moments.iter().sum();
    if sum > 0.0 {
        moments.iter_mut().for_each(|m| *m /= sum);
    }
    Ok(moments)
}

/// The band albedo of a spectrum: its mean with the weights of a channel.
///
/// # Errors
/// The errors of [`band_weights`].
pub fn band_mean(
    study: &Study,
    channel: usize,
    transmission: Option<&Spectrum<sunglint_radiometry::spectrum::Transmission>>,
    spectrum: &Spectrum<Factor>,
) -> Result<f64, SpectrumError> {
    let (first, last) = (200.0_f64, 2500.0);
    let mut knots = vec![first];
    knots.extend(spectrum.wavelength_nm().iter().copied().filter(|nm| first < *nm && *nm < last));
    knots.push(last);
    let weights = band_weights(study, channel, transmission, &knots)?;
    Ok(knots.iter().zip(&weights).map(|(nm, w)| spectrum.at(*nm) * w).sum())
}
