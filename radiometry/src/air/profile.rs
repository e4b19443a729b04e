//! The atmosphere against altitude.

use super::AirError;
use crate::constants::BOLTZMANN_J_PER_K;
use crate::tables::{self, Embedded};
use sunglint_formats::{Table, nearest_names};

/// State of the air at one altitude.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Level {
    /// Altitude above sea level \[km\].
    pub altitude_km: f64,
    /// Pressure \[hPa\].
    pub pressure_hpa: f64,
    /// Temperature \[K\].
    pub temperature_k: f64,
    /// Number density of air, water vapour included \[cm⁻³\].
    pub air_cm3: f64,
    /// Number density of water vapour \[cm⁻³\].
    pub water_cm3: f64,
    /// Number density of ozone \[cm⁻³\].
    pub ozone_cm3: f64,
    /// Number density of oxygen \[cm⁻³\].
    pub oxygen_cm3: f64,
    /// Number density of carbon dioxide \[cm⁻³\].
    pub carbon_dioxide_cm3: f64,
}

/// The atmosphere against altitude: levels from the ground up.
///
/// Between levels, pressure and number densities are exponential in altitude and temperature is linear, as in
/// LOWTRAN7; above the highest level there is nothing. Below the lowest, the lowest layer is continued by at most
/// 500 m (the shore of the Dead Sea lies at −430 m).
#[derive(Debug, Clone, PartialEq)]
pub struct Profile {
    name: String,
    levels: Vec<Level>,
}

/// Stations may lie this far below the lowest level \[m\].
const BELOW_LOWEST_M: f64 = 500.0;
/// Thicker layers are divided \[km\]. The standard atmospheres have none.
const THICKEST_KM: f64 = 5.0;

impl Profile {
    /// The names of the standard atmospheres.
    pub const NAMES: [&'static str; 6] = [
        "tropical",
        "midlatitude_summer",
        "midlatitude_winter",
        "subarctic_summer",
        "subarctic_winter",
        "us_standard",
    ];

    /// A standard atmosphere by its name: one of [`Profile::NAMES`] (Anderson et al. 1986, AFGL-TR-86-0110: 50 levels,
    /// 0–120 km).
    pub fn named(name: &str) -> Result<Self, AirError> {
        const TABLES: [&Embedded; 6] = [
            &tables::AIR_TROPICAL,
            &tables::AIR_MIDLATITUDE_SUMMER,
            &tables::AIR_MIDLATITUDE_WINTER,
            &tables::AIR_SUBARCTIC_SUMMER,
            &tables::AIR_SUBARCTIC_WINTER,
            &tables::AIR_US_STANDARD,
        ];
        let index = Self::NAMES.iter().position(|n| *n == name).ok_or_else(|| {
            let nearest = nearest_names(name, Self::NAMES, 1).first().copied();
            AirError::UnknownProfile { name: name.to_owned(), nearest }
        })?;
        Self::from_table(name, TABLES[index].table())
    }

    /// The midlatitude winter: LOWTRAN7's model 3, which the reference calculation uses.
    pub fn midlatitude_winter() -> Self {
        // A test reads every standard atmosphere, so this cannot fail in a program that passed it.
        #[expect(clippy::unwrap_used, reason = "embedded table, read by a test")]
        Self::named("midlatitude_winter").unwrap()
    }

    /// A profile from a table with the columns `altitude_km`, `pressure_hpa`, `temperature_k`, `h2o_ppmv` and
    /// `o3_ppmv`, and where they are known `air_cm3` (else p/kT), `o2_ppmv` (else 209 500) and `co2_ppmv` (else 420).
    /// Mixing ratios are by volume, in parts per million of all air.
    ///
    /// # Errors
    /// A missing column; fewer than two levels; altitudes that do not ascend; a pressure, temperature or density that
    /// is not positive, a mixing ratio that is negative or not a number.
    pub fn from_table(name: &str, table: &Table) -> Result<Self, AirError> {
        let required = |column: &str, unit: &str| table.quantity(column, unit);
        let altitude = required("altitude_km", "km")?;
        let (pressure, temperature) =
            (required("pressure_hpa", "hPa")?, required("temperature_k", "K")?);
        let (water, ozone) = (required("h2o_ppmv", "")?, required("o3_ppmv", "")?);
        let optional = |column: &str, unit: &str| match table.column(column) {
            Ok(_) => table.quantity(column, unit).map(Some),
            Err(_) => Ok(None),
        };
        let (air, oxygen) = (optional("air_cm3", "1 / cm3")?, optional("o2_ppmv", "")?);
        let carbon_dioxide = optional("co2_ppmv", "")?;
        let levels = (0..table.rows())
            .map(|i| {
                let air_cm3 = air.as_ref().map_or_else(
                    || 1e-4 * pressure[i] / (BOLTZMANN_J_PER_K * temperature[i]),
                    |column| column[i],
                );
                let of = |ppmv: f64| air_cm3 * ppmv * 1e-6;
                Level {
                    altitude_km: altitude[i],
                    pressure_hpa: pressure[i],
                    temperature_k: temperature[i],
                    air_cm3,
                    water_cm3: of(water[i]),
                    ozone_cm3: of(ozone[i]),
                    oxygen_cm3: of(oxygen.as_ref().map_or(209_500.0, |column| column[i])),
                    carbon_dioxide_cm3: of(carbon_dioxide
                        .as_ref()
                        .map_or(420.0, |column| column[i])),
                }
            })
            .collect();
        Self::from_levels(name, levels)
    }

    /// A profile from levels, from the ground up.
    ///
    /// # Errors
    /// The errors of [`Profile::from_table`].
    pub fn from_levels(name: &str, levels: Vec<Level>) -> Result<Self, AirError> {
        if levels.len() < 2 {
            return Err(AirError::ProfileLength { levels: levels.len() });
        }
        let mut below_km = f64::NEG_INFINITY;
        for (level, l) in levels.iter().enumerate() {
            let wrong = |quantity, value, expected| {
                Err(AirError::ProfileLevel { level, quantity, value, expected })
            };
            if !(l.altitude_km.is_finite() && l.altitude_km > below_km) {
                return wrong("altitude_km", l.altitude_km, "altitudes that ascend");
            }
            below_km = l.altitude_km;
            for (quantity, value) in [
                ("pressure_hpa", l.pressure_hpa),
                ("temperature_k", l.temperature_k),
                ("the air's number density per cm³", l.air_cm3),
            ] {
                if !(value.is_finite() && value > 0.0) {
                    return wrong(quantity, value, "a positive number");
                }
            }
            for (quantity, value) in [
                ("the water's number density per cm³", l.water_cm3),
                ("the ozone's number density per cm³", l.ozone_cm3),
                ("the oxygen's number density per cm³", l.oxygen_cm3),
                ("the carbon dioxide's number density per cm³", l.carbon_dioxide_cm3),
            ] {
                if !(value >= 0.0 && value <= l.air_cm3) {
                    return wrong(quantity, value, "zero up to the air's own number density");
                }
            }
        }
        Ok(Self { name: name.to_owned(), levels })
    }

    /// The profile's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The levels, from the ground up.
    pub fn levels(&self) -> &[Level] {
        &self.levels
    }

    /// Returns the state of the air at an altitude.
    ///
    /// # Errors
    /// The altitude is more than 500 m below the lowest level, or not below the highest.
    pub fn at(&self, altitude_m: f64) -> Result<Level, AirError> {
        let (first, last) = (&self.levels[0], &self.levels[self.levels.len() - 1]);
        let lowest_m = 1e3 * first.altitude_km - BELOW_LOWEST_M;
        let highest_m = 1e3 * last.altitude_km;
        if !(altitude_m >= lowest_m && altitude_m < highest_m) {
            return Err(AirError::Altitude { altitude_m, lowest_m, highest_m });
        }
        let altitude_km = 1e-3 * altitude_m;
        let upper = self.levels.partition_point(|l| l.altitude_km <= altitude_km);
        let upper = upper.clamp(1, self.levels.len() - 1);
        let (a, b) = (&self.levels[upper - 1], &self.levels[upper]);
        let f = (altitude_km - a.altitude_km) / (b.altitude_km - a.altitude_km);
        // Downwards a gas of which there is none at one of the levels must not become negative.
        let gas = |a: f64, b: f64| between(a, b, f).max(0.0);
        Ok(Level {
            altitude_km,
            pressure_hpa: between(a.pressure_hpa, b.pressure_hpa, f),
            temperature_k: a.temperature_k + (b.temperature_k - a.temperature_k) * f,
            air_cm3: between(a.air_cm3, b.air_cm3, f),
            water_cm3: gas(a.water_cm3, b.water_cm3),
            ozone_cm3: gas(a.ozone_cm3, b.ozone_cm3),
            oxygen_cm3: gas(a.oxygen_cm3, b.oxygen_cm3),
            carbon_dioxide_cm3: gas(a.carbon_dioxide_cm3, b.carbon_dioxide_cm3),
        })
    }

    /// The levels from a station upwards, the first at the station.
    pub(crate) fn above(&self, altitude_m: f64) -> Result<Vec<Level>, AirError> {
        let station = self.at(altitude_m)?;
        let mut levels = vec![station];
        // A sliver of a layer costs time and gives nothing: levels within a millimetre are the station's.
        for level in self.levels.iter().filter(|l| l.altitude_km > station.altitude_km + 1e-6) {
            // The quadrature along the path has six points per layer: enough for a few scale heights.
            let below_km = levels[levels.len() - 1].altitude_km;
            let parts = ((level.altitude_km - below_km) / THICKEST_KM - 1e-9).ceil();
            for part in 1..parts as usize {
                let f = part as f64 / parts;
                levels.push(self.at(1e3 * (below_km + f * (level.altitude_km - below_km)))?);
            }
            levels.push(*level);
        }
        Ok(levels)
    }
}

/// Exponential between two positive values, linear where one is zero.
fn between(a: f64, b: f64, f: f64) -> f64 {
    if a > 0.0 && b > 0.0 { a * (b / a).powf(f) } else { a + (b - a) * f }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_standard_atmosphere_reads() {
        for name in Profile::NAMES {
            let profile = Profile::named(name).unwrap();
            assert_eq!(profile.levels().len(), 50);
            assert_eq!(profile.at(0.0).unwrap(), profile.levels()[0]);
        }
    }

    #[test]
    fn a_misspelt_name_is_answered_with_the_nearest() {
        let error = Profile::named("midlatitude_wintr").unwrap_err();
        assert!(error.to_string().contains("did you mean `midlatitude_winter`?"), "{error}");
    }

    #[test]
    fn half_way_is_the_geometric_mean_of_the_pressure_and_the_mean_of_the_temperature() {
        let level = Profile::named("us_standard").unwrap().at(500.0).unwrap();
        assert!((level.pressure_hpa - (1013.0_f64 * 898.8).sqrt()).abs() < 1e-9);
        assert!((level.temperature_k - 284.95).abs() < 1e-9);
    }
}
