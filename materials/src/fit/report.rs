//! Results of fits, and notes on them.

use super::law::Law;
use super::surface::Flaw;
use serde::Serialize;
use std::fmt;
use sunglint_simulator::surface::MaterialError;

/// Why nothing was fitted.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FitError {
    /// Several wavelengths, or one that is not there.
    #[error("the table has {known}: say one of them{}", asked.map_or(String::new(), |nm| format!(" (it has no {nm} nm)")))]
    Wavelength {
        /// Wavelengths of the table.
        known: String,
        /// Requested wavelength.
        asked: Option<f64>,
    },
    /// Too few values.
    #[error(
        "{used} values of {rows} can be used ({left_out}): {law} has {parameters} parameters and needs {needed} values or more"
    )]
    TooFew {
        /// Values above 0.
        used: usize,
        /// All.
        rows: usize,
        /// Why the others are not.
        left_out: String,
        /// The law with the fewest parameters.
        law: String,
        /// Number of the law's parameters.
        parameters: usize,
        /// The least number of values.
        needed: usize,
    },
    /// A law that needs what the table has not.
    #[error("{law}: {reason}")]
    Law {
        /// The law.
        law: String,
        /// Why not.
        reason: &'static str,
    },
    /// The refractive index.
    #[error(transparent)]
    Material(#[from] MaterialError),
}

/// Rows that were not used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct LeftOut {
    /// No number.
    pub missing: usize,
    /// 0 or below.
    pub not_above_zero: usize,
    /// Up to the floor that was given.
    pub at_floor: usize,
    /// At the horizon, on either side.
    pub horizon: usize,
    /// At the largest value that the detector could show.
    pub saturated: usize,
    /// At incidences with fewer than five values.
    pub few: usize,
}

impl fmt::Display for LeftOut {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { missing, not_above_zero, at_floor, horizon, saturated, few } = self;
        write!(
            f,
            "left out: {missing} without a number, {not_above_zero} not above 0, {at_floor} up to the floor, {horizon} at the horizon, {saturated} saturated, {few} at incidences with fewer than five values"
        )
    }
}

/// One parameter of a fit.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Parameter {
    /// Key of the parameter in a material's file; `diffuse` and `volume` are reflectances.
    pub name: &'static str,
    /// Value of the parameter.
    pub value: f64,
    /// The standard deviation of its logarithm; none where it lies at a bound or the values do not decide it.
    pub sigma_ln: Option<f64>,
    /// The interval that holds it with 95 %.
    pub interval: Option<(f64, f64)>,
    /// Whether it lies at the end of its range.
    pub at_bound: bool,
}

/// A law through the values.
#[derive(Debug, Clone, PartialEq)]
pub struct LawFit {
    /// Which.
    pub law: Law,
    /// Parameters of the law.
    pub parameters: Vec<Parameter>,
    /// The width of the residuals of ln f (Student's, or the standard deviation).
    pub width: f64,
    /// The root mean square of the residuals of ln f.
    pub rms: f64,
    /// The correlation of neighbours' residuals.
    pub correlation: f64,
    /// ln of the likelihood, all values taken as independent.
    pub ln_likelihood: f64,
    /// Akaike's criterion for small samples, with the number of independent values.
    pub aicc: f64,
    /// Schwarz's criterion, likewise.
    pub bic: f64,
    /// Akaike's weight among the laws that were fitted.
    pub weight: f64,
    /// Directional–hemispherical reflectance by angle of incidence, degrees.
    pub albedo: Vec<(f64, f64)>,
    /// Up to which angle of incidence energy was held, degrees.
    pub energy_to_deg: f64,
    /// Whether energy held the parameters back.
    pub energy_held: bool,
    /// The largest ratio of what the law says to what was measured, where that was 0 or less but has an uncertainty: beyond 3 σ of it.
    pub above_zeros: Option<f64>,
    /// Whether it keeps the table's hemispherical reflectance and peak at every incidence.
    pub is_faithful: bool,
    /// Whether the search ended in a minimum.
    pub converged: bool,
    /// ln f measured − ln f of the law, by used row.
    pub residual: Vec<f64>,
}

impl LawFit {
    /// The values of its parameters.
    pub fn values(&self) -> Vec<f64> {
        self.parameters.iter().map(|p| p.value).collect()
    }

    /// Whether at no angle that was looked at it reflects more than came.
    pub fn conserves_energy(&self) -> bool {
        self.albedo.iter().all(|(_, e)| *e <= 1.0 + 1e-4)
    }
}

/// Note on the fits, for the user.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Note {
    /// Rows that were not used.
    LeftOut(LeftOut),
    /// Only one angle of incidence.
    OneIncidence {
        /// Which, degrees.
        theta_i_deg: f64,
    },
    /// Values without light in such number that those with light are a choice.
    ManyDark {
        /// Their share of all.
        share: f64,
    },
    /// Neighbours' residuals are alike.
    Correlated {
        /// The correlation.
        correlation: f64,
        /// Number of independent values that they count for.
        independent: f64,
        /// How many there are.
        values: usize,
    },
    /// No law describes the table.
    NoLawFits {
        /// The typical factor between law and measurement.
        factor: f64,
    },
    /// The best law reflects more than came at grazing incidence.
    Gains {
        /// Which law.
        law: String,
        /// At which angle, degrees.
        theta_deg: f64,
        /// How much.
        albedo: f64,
    },
    /// A law that the table or the options do not allow.
    NotTried {
        /// Which.
        law: &'static str,
        /// Why.
        reason: &'static str,
    },
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::LeftOut(rows) => write!(f, "{rows}; the logarithm of 0 or less is none"),
            Self::OneIncidence { theta_i_deg } => write!(
                f,
                "all light came from {theta_i_deg}°: how the lobe changes with the angle of incidence is the laws' own word"
            ),
            Self::ManyDark { share } => write!(
                f,
                "{:.0} % of the values are not above 0: those that are used are too bright on the average",
                100.0 * share
            ),
            Self::Correlated { correlation, independent, values } => write!(
                f,
                "neighbours' residuals are alike (correlation {correlation:.2}): {values} values count as {independent:.0} in intervals and criteria"
            ),
            Self::NoLawFits { factor } => write!(
                f,
                "no law describes the table: the best is off by a factor of {factor:.2} (rms), and not by noise"
            ),
            Self::Gains { law, theta_deg, albedo } => write!(
                f,
                "{law} reflects {albedo:.3} of the light at {theta_deg}° of incidence: it is not chosen"
            ),
            Self::NotTried { law, reason } => write!(f, "{law} was not tried: {reason}"),
        }
    }
}

/// Laws through a table.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// At which wavelength, vacuum nm.
    pub wavelength_nm: f64,
    /// Rows of the table that were used, in their order.
    pub used: Vec<usize>,
    /// The others.
    pub left_out: LeftOut,
    /// The laws, the most likely first; those that reflect more than came at the end.
    pub laws: Vec<LawFit>,
    /// Number of independent values that those of the table count for.
    pub independent: f64,
    /// Faults of the most likely law.
    pub flaws: Vec<Flaw>,
    /// Notes for the user.
    pub notes: Vec<Note>,
}

impl Fit {
    /// Whether the most likely law has the table's peak and hemispherical reflectance at every incidence.
    pub fn is_faithful(&self) -> bool {
        !self.flaws.iter().any(Flaw::needs_consent)
    }
}
