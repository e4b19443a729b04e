//! The air above one station, and its transmission for one zenith angle.

use super::aerosol::Aerosol;
use super::math::exp_minus_in_place;
use super::path::{Outside, Path, Shells, Zenith};
use super::profile::{Level, Profile};
use super::spectra::{self, CARBON_DIOXIDE, OXYGEN, Species, Term, WATER_REGIONS};
use super::{AirError, LOSCHMIDT_CM3, Sampling};
use crate::spectrum::{Spectrum, Transmission};

/// Where the path integrals stand in [`Amounts`].
pub(crate) mod amount {
    /// Molecules of air \[cm⁻²\].
    pub(crate) const AIR: usize = 0;
    /// Ozone \[atm·cm\].
    pub(crate) const OZONE: usize = 1;
    /// Scaled water of the six band regions.
    pub(crate) const WATER_LINES: usize = 2;
    /// Scaled oxygen.
    pub(crate) const OXYGEN: usize = 8;
    /// Scaled carbon dioxide.
    pub(crate) const CARBON_DIOXIDE: usize = 9;
    /// Water continuum, self-broadened (W₅).
    pub(crate) const WATER_SELF: usize = 10;
    /// Water continuum, foreign-broadened (W₁₀).
    pub(crate) const WATER_FOREIGN: usize = 11;
    /// Water \[kg/m² = mm\].
    pub(crate) const WATER: usize = 12;
    /// Low aerosol, in units of its vertical column.
    pub(crate) const AEROSOL: usize = 13;
    /// Background aerosol, in units of its vertical column.
    pub(crate) const BACKGROUND: usize = 14;
    /// How many of them are exponential in altitude between levels; the rest follow from these and the temperature.
    pub(crate) const INTERPOLATED: usize = 15;
    /// Ozone times its temperature \[atm·cm·°C\].
    pub(crate) const OZONE_T: usize = 15;
    /// Ozone times its temperature squared.
    pub(crate) const OZONE_T2: usize = 16;
    /// W₅ times its coldness (W₉).
    pub(crate) const WATER_SELF_COLD: usize = 17;
    /// How many there are.
    pub(crate) const COUNT: usize = 18;
}

/// Path integrals.
pub(crate) type Amounts = [f64; amount::COUNT];

/// Description of the air over a station. A column that was not measured is the profile's own.
#[derive(Debug, Clone, PartialEq)]
pub struct AirOptions {
    /// The atmosphere.
    pub profile: Profile,
    /// The station's altitude above sea level \[m\].
    pub altitude_m: f64,
    /// Pressure at the station (not reduced to sea level) \[hPa\]: scales air, oxygen, CO₂ and every pressure.
    pub pressure_hpa: Option<f64>,
    /// Ozone column above the station \[DU\].
    pub ozone_du: Option<f64>,
    /// Precipitable water above the station \[mm = kg/m²\].
    pub water_mm: Option<f64>,
    /// CO₂ \[ppm by volume\]; the standard profiles hold 330 ppm (1986). Between 330 and 425 ppm the transmission at
    /// 1205 nm falls by 0.0023 at the zenith and 0.006 at 80°; Rayleigh scattering grows by 1.4e−4 of itself.
    pub co2_ppm: Option<f64>,
    /// The aerosol; none by default.
    pub aerosol: Aerosol,
    /// Whether the path is refracted.
    pub refraction: bool,
    /// The one wavelength \[nm\] for which the path is refracted. The refractivity at 300 nm is 5 % above and at 1240 nm
    /// 1.5 % below that at 550 nm: at 85° the refraction there is off by 29″ and 9″ and the transmission by at most 3e−4,
    /// on the horizon by 107″, 33″ and 2.5e−3.
    pub refraction_nm: f64,
    /// The Earth's radius of curvature at the station \[m\]. LOWTRAN7 has 6 371 230 m.
    pub earth_radius_m: f64,
}

impl AirOptions {
    /// This profile as it is, at sea level, without aerosol, refracted at 550 nm.
    pub fn new(profile: Profile) -> Self {
        Self {
            profile,
            altitude_m: 0.0,
            pressure_hpa: None,
            ozone_du: None,
            water_mm: None,
            co2_ppm: None,
            aerosol: Aerosol::None,
            refraction: true,
            refraction_nm: 550.0,
            earth_radius_m: 6_371_230.0,
        }
    }

    fn check(&self) -> Result<(), AirError> {
        let require = |value: f64, low: f64, high: f64, option, expected| {
            if (low..=high).contains(&value) {
                Ok(())
            } else {
                Err(AirError::Option { option, value, expected })
            }
        };
        if let Some(p) = self.pressure_hpa {
            require(
                p,
                0.1,
                1200.0,
                "pressure_hpa",
                "0.1 to 1200 hPa, at the station's own altitude",
            )?;
        }
        if let Some(ozone) = self.ozone_du {
            require(ozone, 0.0, 1500.0, "ozone_du", "0 to 1500 DU (300 is usual)")?;
        }
        if let Some(water) = self.water_mm {
            require(water, 0.0, 150.0, "water_mm", "0 to 150 mm (5 to 40 is usual)")?;
        }
        if let Some(co2) = self.co2_ppm {
            require(co2, 0.0, 10_000.0, "co2_ppm", "0 to 10 000 ppm (425 is usual)")?;
        }
        require(self.refraction_nm, 200.0, 10_000.0, "refraction_nm", "200 to 10 000 nm")?;
        require(self.earth_radius_m, 1e6, 1e8, "earth_radius_m", "metres, about 6.371e6")?;
        self.aerosol.check()
    }
}

/// Vertical columns above the station.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Columns {
    /// Pressure at the station \[hPa\].
    pub pressure_hpa: f64,
    /// Temperature at the station \[K\].
    pub temperature_k: f64,
    /// Molecules of air \[cm⁻²\].
    pub air_cm2: f64,
    /// Ozone \[DU = 1e−3 atm·cm\].
    pub ozone_du: f64,
    /// Precipitable water \[mm = kg/m²\].
    pub water_mm: f64,
    /// Carbon dioxide \[ppm by volume\], at the station.
    pub co2_ppm: f64,
    /// Aerosol optical depth at 550 nm.
    pub aerosol_550: f64,
}

/// Slant column over vertical column.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AirMasses {
    /// Air mass of air: the relative air mass for Rayleigh scattering.
    pub rayleigh: f64,
    /// Air mass of ozone (1 where there is none).
    pub ozone: f64,
    /// Air mass of water vapour (1 where there is none).
    pub water: f64,
    /// Air mass of the low aerosol (1 where there is none).
    pub aerosol: f64,
}

/// One-way transmissions of a sampling, by species: one value per wavelength or bin, in the sampling's order. In a bin each
/// is the mean of that species alone, so that their product is not quite `total`.
#[derive(Debug, Clone, PartialEq)]
pub struct Components {
    /// All together.
    pub total: Vec<f64>,
    /// Scattering by molecules.
    pub rayleigh: Vec<f64>,
    /// Ozone.
    pub ozone: Vec<f64>,
    /// Bands of water.
    pub water_lines: Vec<f64>,
    /// Continuum of water.
    pub water_continuum: Vec<f64>,
    /// Bands of oxygen.
    pub oxygen: Vec<f64>,
    /// Bands of carbon dioxide.
    pub carbon_dioxide: Vec<f64>,
    /// Aerosol.
    pub aerosol: Vec<f64>,
}

impl Components {
    /// Name and values of each, the total first.
    pub fn iter(&self) -> impl Iterator<Item = (&'static str, &[f64])> {
        [
            ("total", &self.total),
            ("rayleigh", &self.rayleigh),
            ("ozone", &self.ozone),
            ("water_lines", &self.water_lines),
            ("water_continuum", &self.water_continuum),
            ("oxygen", &self.oxygen),
            ("carbon_dioxide", &self.carbon_dioxide),
            ("aerosol", &self.aerosol),
        ]
        .into_iter()
        .map(|(name, values)| (name, values.as_slice()))
    }
}

/// One layer between two levels.
#[derive(Debug, Clone)]
struct Layer {
    bottom: [f64; amount::INTERPOLATED],
    /// Exponential: ln(top/bottom). Linear where one end is zero: top − bottom, and `linear` says so.
    change: [f64; amount::INTERPOLATED],
    linear: [bool; amount::INTERPOLATED],
    bottom_c: f64,
    rise_c: f64,
    bottom_cold: f64,
    rise_cold: f64,
}

/// The air above one station.
#[derive(Debug, Clone)]
pub struct Air {
    options: AirOptions,
    shells: Shells,
    layers: Vec<Layer>,
    vertical: Amounts,
    columns: Columns,
    terms: Vec<Term>,
}

impl Air {
    /// The air over a station.
    ///
    /// # Errors
    /// An option that makes no sense ([`AirError::Option`], [`AirError::Altitude`]); a column of a gas that the profile
    /// does not have; a profile with a duct, if refraction is on.
    pub fn new(options: &AirOptions) -> Result<Self, AirError> {
        options.check()?;
        let mut levels = options.profile.above(options.altitude_m)?;
        let station_km = levels[0].altitude_km;
        let earth_km = 1e-3 * options.earth_radius_m;
        let heights: Vec<f64> = levels.iter().map(|l| l.altitude_km - station_km).collect();
        scale_pressure_and_co2(&mut levels, options);

        // Water enters W₅ squared, so the columns are scaled in the levels, not in the amounts.
        let straight = Shells::new(earth_km + station_km, &heights, &vec![0.0; heights.len()])?;
        let raw = integrate(&straight, &layers(&levels, &options.aerosol), 0.0).0;
        let factor = |wanted: Option<f64>, have: f64, option| match wanted {
            None => Ok(1.0),
            Some(wanted) if have > 0.0 => Ok(wanted / have),
            Some(0.0) => Ok(1.0),
            Some(value) => Err(AirError::EmptyColumn { option, value }),
        };
        let water = factor(options.water_mm, raw[amount::WATER], "water_mm")?;
        let ozone = factor(options.ozone_du, 1e3 * raw[amount::OZONE], "ozone_du")?;
        for level in &mut levels {
            level.water_cm3 *= water;
            level.ozone_cm3 *= ozone;
            if level.water_cm3 > 0.5 * level.air_cm3 {
                return Err(AirError::Option {
                    option: "water_mm",
                    value: options.water_mm.unwrap_or(f64::NAN),
                    expected: "less: scaled to this column, the profile would be more water than air; choose a moister one",
                });
            }
        }

        let mut layers = layers(&levels, &options.aerosol);
        let vertical = integrate(&straight, &layers, 0.0).0;
        for k in [amount::AEROSOL, amount::BACKGROUND] {
            if vertical[k] > 0.0 {
                for layer in &mut layers {
                    layer.bottom[k] /= vertical[k];
                    if layer.linear[k] {
                        layer.change[k] /= vertical[k];
                    }
                }
            }
        }
        let vertical = integrate(&straight, &layers, 0.0).0;
        let shells = if options.refraction {
            let n: Vec<f64> =
                levels.iter().map(|l| refractivity(l, options.refraction_nm)).collect();
            Shells::new(earth_km + station_km, &heights, &n)?
        } else {
            straight
        };
        let co2_ppm = 1e6 * levels[0].carbon_dioxide_cm3 / levels[0].air_cm3;
        let mut terms = vec![spectra::rayleigh(co2_ppm)];
        terms.extend(spectra::gases().iter().cloned());
        terms.extend(spectra::aerosol(&options.aerosol, station_km));
        let (low, high) = options.aerosol.optical_depths(550.0, station_km);
        let columns = Columns {
            pressure_hpa: levels[0].pressure_hpa,
            temperature_k: levels[0].temperature_k,
            air_cm2: vertical[amount::AIR],
            ozone_du: 1e3 * vertical[amount::OZONE],
            water_mm: vertical[amount::WATER],
            co2_ppm,
            aerosol_550: low + high,
        };
        let options = options.clone();
        Ok(Self { options, shells, layers, vertical, columns, terms })
    }

    /// Returns the options that the air was made from.
    pub fn options(&self) -> &AirOptions {
        &self.options
    }

    /// Vertical columns above the station.
    pub fn columns(&self) -> Columns {
        self.columns
    }

    /// The ray of a zenith angle: its other angle, its refraction, and what it meets.
    ///
    /// # Errors
    /// A zenith angle that is negative or not a number, or below the horizon (apparent 90°); a near target inside the air.
    pub fn path(&self, zenith: Zenith) -> Result<Path, AirError> {
        let apparent_deg = self.shells.apparent_deg(zenith)?;
        Ok(self.path_at(apparent_deg))
    }

    /// The same for an apparent zenith angle that is known to be 0° to 90°.
    pub(crate) fn path_at(&self, apparent_deg: f64) -> Path {
        let (amounts, bending) = integrate(&self.shells, &self.layers, apparent_deg);
        Path { apparent_deg, true_deg: apparent_deg + bending.to_degrees(), amounts }
    }

    /// True zenith angle \[deg\] of a target at infinity that is seen on the horizon, at 90°. A near target is lost some
    /// minutes of arc earlier ([`Zenith::Near`] knows).
    pub fn horizon_deg(&self) -> f64 {
        self.shells.true_deg(90.0)
    }

    /// Returns the geometry of the shells that near targets need.
    pub(crate) fn outside(&self) -> Outside {
        self.shells.outside()
    }

    /// Relative air masses along a path of this air.
    pub fn air_masses(&self, path: &Path) -> AirMasses {
        let ratio = |k: usize| {
            if self.vertical[k] > 0.0 { path.amounts[k] / self.vertical[k] } else { 1.0 }
        };
        AirMasses {
            rayleigh: ratio(amount::AIR),
            ozone: ratio(amount::OZONE),
            water: ratio(amount::WATER),
            aerosol: ratio(amount::AEROSOL),
        }
    }

    /// One-way transmission for one zenith angle: one value per wavelength or bin, in the sampling's order.
    ///
    /// # Errors
    /// The errors of [`Air::path`].
    pub fn transmission(&self, zenith: Zenith, sampling: &Sampling) -> Result<Vec<f64>, AirError> {
        let path = self.path(zenith)?;
        Ok(self.sampled(&path, sampling, |_| true))
    }

    /// One-way transmission for one zenith angle as a spectrum over a range in nm, on the model's own points: what goes into the
    /// integrals of [`crate::quadrature`]. Beyond the tables (294–1250 nm) it is missing, and the integrals say so.
    ///
    /// # Errors
    /// The errors of [`Air::path`]; a range outside the tables.
    pub fn spectrum(
        &self,
        zenith: Zenith,
        range_nm: (f64, f64),
    ) -> Result<Spectrum<Transmission>, AirError> {
        let sampling = Sampling::native(range_nm.0, range_nm.1)?;
        let values = self.transmission(zenith, &sampling)?;
        Ok(Spectrum::new(sampling.wavelength_nm().to_vec(), values)?)
    }

    /// The same by species.
    ///
    /// # Errors
    /// The errors of [`Air::path`].
    pub fn components(&self, zenith: Zenith, sampling: &Sampling) -> Result<Components, AirError> {
        let path = self.path(zenith)?;
        let of = |species| self.sampled(&path, sampling, |s| s == species);
        Ok(Components {
            total: self.sampled(&path, sampling, |_| true),
            rayleigh: of(Species::Rayleigh),
            ozone: of(Species::Ozone),
            water_lines: of(Species::WaterLines),
            water_continuum: of(Species::WaterContinuum),
            oxygen: of(Species::Oxygen),
            carbon_dioxide: of(Species::CarbonDioxide),
            aerosol: of(Species::Aerosol),
        })
    }

    fn sampled(
        &self,
        path: &Path,
        sampling: &Sampling,
        wanted: impl Fn(Species) -> bool,
    ) -> Vec<f64> {
        let mut curve = vec![0.0; sampling.native.len()];
        for term in self.terms.iter().filter(|t| wanted(t.species)) {
            term.pick(&sampling.native).add(&path.amounts, &mut curve);
        }
        exp_minus_in_place(&mut curve);
        let mut out = vec![0.0; sampling.len()];
        sampling.apply(&curve, &mut out);
        out
    }

    /// The terms on the native points of a sampling, for many paths.
    pub(crate) fn terms_on(&self, sampling: &Sampling) -> Vec<Term> {
        self.terms.iter().map(|t| t.pick(&sampling.native)).collect()
    }
}

fn scale_pressure_and_co2(levels: &mut [Level], options: &AirOptions) {
    let pressure = options.pressure_hpa.map_or(1.0, |p| p / levels[0].pressure_hpa);
    for level in levels {
        level.pressure_hpa *= pressure;
        level.air_cm3 *= pressure;
        level.oxygen_cm3 *= pressure;
        level.carbon_dioxide_cm3 *= pressure;
        if let Some(ppm) = options.co2_ppm {
            level.carbon_dioxide_cm3 = 1e-6 * ppm * level.air_cm3;
        }
    }
}

/// Densities at one level, per kilometre of path; the scalings are those of LOWTRAN7 (header of `molecular_bands` and
/// `water_continuum`), to which its coefficients belong.
fn densities(level: &Level, station_km: f64, aerosol: &Aerosol) -> [f64; amount::INTERPOLATED] {
    const CM_PER_KM: f64 = 1e5;
    /// Molecules of water per cm³ at 1 g/m³.
    const WATER_PER_GRAM: f64 = 3.3429e16;
    /// Density of air at 296 K, in units of Loschmidt's number.
    const AIR_296: f64 = 0.922_804;
    let pressure = level.pressure_hpa / 1013.25;
    let warmth = 273.15 / level.temperature_k;
    let scaled = |n: f64, m: f64| pressure.powf(n) * warmth.powf(m);
    let water_g_m3 = level.water_cm3 / WATER_PER_GRAM;
    let atm_cm = |number_cm3: f64| number_cm3 / LOSCHMIDT_CM3 * CM_PER_KM;
    let water = level.water_cm3 / LOSCHMIDT_CM3;
    let foreign = (pressure * warmth - water).max(0.0);
    let (low, high) = aerosol.shapes(level.altitude_km, station_km);

    let mut d = [0.0; amount::INTERPOLATED];
    d[amount::AIR] = level.air_cm3 * CM_PER_KM;
    d[amount::OZONE] = atm_cm(level.ozone_cm3);
    for (i, region) in WATER_REGIONS.iter().enumerate() {
        d[amount::WATER_LINES + i] = 0.1 * water_g_m3 * scaled(region.n, region.m);
    }
    d[amount::OXYGEN] = atm_cm(level.oxygen_cm3) * scaled(OXYGEN.1, OXYGEN.2);
    d[amount::CARBON_DIOXIDE] =
        atm_cm(level.carbon_dioxide_cm3) * scaled(CARBON_DIOXIDE.1, CARBON_DIOXIDE.2);
    d[amount::WATER_SELF] = LOSCHMIDT_CM3 * CM_PER_KM * water * water / AIR_296;
    d[amount::WATER_FOREIGN] = LOSCHMIDT_CM3 * CM_PER_KM * water * foreign / AIR_296;
    d[amount::WATER] = water_g_m3;
    d[amount::AEROSOL] = low;
    d[amount::BACKGROUND] = high;
    d
}

/// Where between 296 K (0) and 260 K (1) the self-broadened continuum is; it is not extrapolated, as in LOWTRAN7. Taken at
/// the levels: a limit that is met inside a layer would be a kink there, and the path integrals no longer smooth in z.
fn coldness(level: &Level) -> f64 {
    ((296.0 - level.temperature_k) / 36.0).clamp(0.0, 1.0)
}

fn layers(levels: &[Level], aerosol: &Aerosol) -> Vec<Layer> {
    let station_km = levels[0].altitude_km;
    let at: Vec<_> = levels.iter().map(|l| densities(l, station_km, aerosol)).collect();
    levels
        .windows(2)
        .zip(at.windows(2))
        .map(|(level, density)| {
            let mut layer = Layer {
                bottom: density[0],
                change: [0.0; amount::INTERPOLATED],
                linear: [false; amount::INTERPOLATED],
                bottom_c: level[0].temperature_k - 273.15,
                rise_c: level[1].temperature_k - level[0].temperature_k,
                bottom_cold: coldness(&level[0]),
                rise_cold: coldness(&level[1]) - coldness(&level[0]),
            };
            for (k, (a, b)) in density[0].iter().zip(&density[1]).enumerate() {
                layer.linear[k] = !(*a > 0.0 && *b > 0.0);
                layer.change[k] = if layer.linear[k] { b - a } else { (b / a).ln() };
            }
            layer
        })
        .collect()
}

/// The amounts along the ray, and its bending \[rad\].
fn integrate(shells: &Shells, layers: &[Layer], apparent_deg: f64) -> (Amounts, f64) {
    let mut sum: Amounts = [0.0; amount::COUNT];
    let bending = shells.trace(apparent_deg, |index, fraction, ds| {
        let layer = &layers[index];
        let mut at = [0.0; amount::INTERPOLATED];
        for (k, at) in at.iter_mut().enumerate() {
            let change = layer.change[k] * fraction;
            *at = if layer.linear[k] {
                layer.bottom[k] + change
            } else {
                layer.bottom[k] * change.exp()
            };
            sum[k] += *at * ds;
        }
        let celsius = layer.bottom_c + layer.rise_c * fraction;
        let ozone = at[amount::OZONE] * ds;
        sum[amount::OZONE_T] += ozone * celsius;
        sum[amount::OZONE_T2] += ozone * celsius * celsius;
        let cold = layer.bottom_cold + layer.rise_cold * fraction;
        sum[amount::WATER_SELF_COLD] += at[amount::WATER_SELF] * ds * cold;
    });
    (sum, bending)
}

/// n − 1 of moist air: the dispersion of Ciddor 1996 (Appl. Opt. 35, 1566) with densities of ideal gases (his
/// compressibility moves n − 1 by less than 5e−4 of itself).
fn refractivity(level: &Level, wavelength_nm: f64) -> f64 {
    let s2 = (1e3 / wavelength_nm).powi(2);
    let dry = 1e-8 * (5_792_105.0 / (238.0185 - s2) + 167_917.0 / (57.362 - s2));
    let wet = 1e-8 * 1.022 * (295.235 + s2 * (2.6422 + s2 * (-0.032_380 + s2 * 0.004_028)));
    let number_cm3 =
        |pa: f64, kelvin: f64| 1e-6 * pa / (crate::constants::BOLTZMANN_J_PER_K * kelvin);
    dry * (level.air_cm3 - level.water_cm3) / number_cm3(101_325.0, 288.15)
        + wet * level.water_cm3 / number_cm3(1333.0, 293.15)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: Ciddor 1996: dry air of 450 ppm CO₂, 633 nm, 20 °C: 21458.0e-8 at 80 kPa, 26824.4e-8 at 100 kPa.
    #[test]
    fn refractivity_is_ciddors() {
        let mut level = *Profile::named("us_standard").unwrap().levels().first().unwrap();
        for (pa, truth) in [(80e3, 21_458.0e-8), (100e3, 26_824.4e-8)] {
            level.air_cm3 = 1e-6 * pa / (1.380_649e-23 * 293.15);
            level.water_cm3 = 0.0;
            let ours = refractivity(&level, 633.0);
            assert!((ours / truth - 1.0).abs() < 5e-4, "{ours:e} against {truth:e}");
        }
    }
}
