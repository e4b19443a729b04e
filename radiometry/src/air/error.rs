//! Errors of a request to the air.

use crate::spectrum::SpectrumError;
use sunglint_formats::TableError;

/// Why the air cannot answer. The message holds the numbers, and what to do.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AirError {
    /// No profile of that name.
    #[error("there is no atmosphere `{name}`; {}the atmospheres are {}", hint(nearest), crate::air::Profile::NAMES.join(", "))]
    UnknownProfile {
        /// The name that was asked for.
        name: String,
        /// The most similar name.
        nearest: Option<&'static str>,
    },
    /// A profile's table lacks something.
    #[error("the atmosphere's profile: {0}")]
    ProfileTable(#[from] TableError),
    /// Transmissions that make no spectrum.
    #[error("the air's transmission: {0}")]
    Spectrum(#[from] SpectrumError),
    /// A profile's level is not physical.
    #[error("the atmosphere's profile, level {level}: {quantity} is {value}; expected {expected}")]
    ProfileLevel {
        /// The level, counted from 0 at the ground.
        level: usize,
        /// Name of the quantity that is wrong, with its unit.
        quantity: &'static str,
        /// Value that was given.
        value: f64,
        /// Allowed values.
        expected: &'static str,
    },
    /// A profile needs at least two levels.
    #[error("the atmosphere's profile has {levels} levels; at least 2 are needed")]
    ProfileLength {
        /// How many there are.
        levels: usize,
    },
    /// The station is outside the profile.
    #[error(
        "the station at {altitude_m} m is outside {lowest_m} m to {highest_m} m, where this profile holds"
    )]
    Altitude {
        /// The station's altitude \[m\].
        altitude_m: f64,
        /// Lowest altitude \[m\].
        lowest_m: f64,
        /// Highest altitude \[m\].
        highest_m: f64,
    },
    /// An option is not a number that makes sense.
    #[error("{option} = {value} makes no sense; expected {expected}")]
    Option {
        /// The option, with its unit as suffix.
        option: &'static str,
        /// Value that was given.
        value: f64,
        /// Values that would make sense.
        expected: &'static str,
    },
    /// A column was given for a gas that the profile does not have.
    #[error(
        "{option} = {value} cannot be reached: the profile holds none of this gas above the station"
    )]
    EmptyColumn {
        /// The option, with its unit as suffix.
        option: &'static str,
        /// Value that was given.
        value: f64,
    },
    /// The air near the ground bends a ray more strongly than the Earth's curvature.
    #[error(
        "between {bottom_m} m and {top_m} m the refractive index falls faster than the Earth curves (a duct): \
         the horizon is not defined; smooth the profile or turn refraction off"
    )]
    Duct {
        /// Bottom of the layer \[m\].
        bottom_m: f64,
        /// Top of the layer \[m\].
        top_m: f64,
    },
    /// A zenith angle is not a number of 0° or more.
    #[error("a zenith angle of {zenith_deg}° makes no sense; expected 0° to 90°")]
    ZenithAngle {
        /// The angle \[deg\].
        zenith_deg: f64,
    },
    /// The direction is below the horizon.
    #[error(
        "the {kind} zenith angle {zenith_deg}° is below the horizon, which lies at {horizon_deg:.4}° ({kind})"
    )]
    BelowHorizon {
        /// `true` or `apparent`.
        kind: &'static str,
        /// The angle \[deg\].
        zenith_deg: f64,
        /// The horizon in the same kind of angle \[deg\].
        horizon_deg: f64,
    },
    /// A range that is no distance.
    #[error(
        "a range of {range_m} m makes no sense; expected the distance to the target, in metres"
    )]
    Range {
        /// The range \[m\].
        range_m: f64,
    },
    /// A target that is not outside the air.
    #[error(
        "the target at a true zenith angle of {true_deg:.4}° and a range of {range_m:.0} m is {height_m:.0} m above the station, inside \
         the air, which ends {top_m:.0} m above it: only paths through the whole air are calculated; is the range in metres?"
    )]
    InsideAir {
        /// The zenith angle of the straight line \[deg\].
        true_deg: f64,
        /// The range \[m\].
        range_m: f64,
        /// The target's height above the station's level \[m\].
        height_m: f64,
        /// The height of the highest level of the profile above the station \[m\].
        top_m: f64,
    },
    /// A wavelength is outside the tables.
    #[error(
        "{wavelength_nm} nm is outside {lowest_nm:.3} to {highest_nm} nm, which the absorption tables cover; cut the range"
    )]
    Wavelength {
        /// The wavelength or bin edge \[nm, vacuum\].
        wavelength_nm: f64,
        /// Shortest wavelength \[nm\].
        lowest_nm: f64,
        /// Longest wavelength \[nm\].
        highest_nm: f64,
    },
    /// Bin edges do not ascend.
    #[error("a bin from {from_nm} nm to {to_nm} nm has no width; bin edges must ascend")]
    Bin {
        /// Lower edge \[nm\].
        from_nm: f64,
        /// Upper edge \[nm\].
        to_nm: f64,
    },
    /// A sampling asks for nothing.
    #[error("no wavelength was given")]
    NoWavelength,
    /// The output slice does not fit.
    #[error("the output holds {found} values; {expected} are needed (zenith angles × wavelengths)")]
    OutputLength {
        /// Length of the output.
        found: usize,
        /// The right length.
        expected: usize,
    },
    /// The table did not reach its tolerance.
    #[error(
        "{nodes} nodes leave an interpolation error of {error:.1e} in transmission; ask for more than {tolerance:.1e}"
    )]
    Tolerance {
        /// The tolerance that was asked for.
        tolerance: f64,
        /// Interpolation error that was reached.
        error: f64,
        /// With that many nodes.
        nodes: usize,
    },
}

fn hint(nearest: &Option<&'static str>) -> String {
    nearest.map(|n| format!("did you mean `{n}`? ")).unwrap_or_default()
}
