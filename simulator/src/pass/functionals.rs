//! The integrals over wavelength that a pass needs, taken once: all that is left for an epoch are sums over k.

use super::{BANDS, Pass, PassError, SpectralQuantity};
use sunglint_radiometry::air::{AirError, AirTable, Sampling, Zenith};
use sunglint_radiometry::constants::HC_J_NM;
use sunglint_radiometry::passband::{Passband, Weighting};
use sunglint_radiometry::quadrature::{Integral, Product};
use sunglint_radiometry::spectrum::{Reflectance, Response, Spectrum};

/// A set of products p_ik of E ρ_k with something i, and their integrals with and without the air.
pub(super) struct Set {
    /// Material spectra.
    k: usize,
    /// ∫ p_ik dλ over everything, `[i * k + j]`.
    pub above: Vec<Integral>,
    /// ∫ p_ik dλ over the tables of the air.
    through: Vec<f64>,
    /// Mean transmissions; `None` where there is no air.
    air: Option<AirTable>,
    /// Where the air's uncovered width is counted too.
    pub uncovered_nm: Vec<f64>,
}

impl Set {
    fn new(pass: &Pass, k: usize, products: &[Product]) -> Result<Self, PassError> {
        let above: Vec<Integral> = products.iter().map(Product::integral).collect();
        let mut set = Self {
            k,
            through: above.iter().map(|i| i.value).collect(),
            uncovered_nm: above.iter().map(|i| i.uncovered_nm).collect(),
            above,
            air: None,
        };
        if let Some(air) = &pass.air {
            let (sampling, integrals) = Sampling::weighted(products)?;
            set.through = integrals.iter().map(|i| i.value).collect();
            set.uncovered_nm = integrals.iter().map(|i| i.uncovered_nm).collect();
            set.air = Some(AirTable::new(air, &sampling, 0.1 * pass.tolerance)?);
        }
        Ok(set)
    }

    pub fn len(&self) -> usize {
        self.above.len() / self.k.max(1)
    }

    /// Σ_k W_k ∫ p_ik dλ, no air.
    pub fn above(&self, i: usize, weights: &[f64]) -> f64 {
        let row = &self.above[i * self.k..(i + 1) * self.k];
        row.iter().zip(weights).map(|(p, w)| w * p.value).sum()
    }

    /// Fills `row` with the mean transmissions of all products; without air they are 1.
    pub fn transmissions(&self, zenith: Zenith, row: &mut Vec<f64>) -> Result<(), AirError> {
        row.clear();
        row.resize(self.through.len(), 1.0);
        match &self.air {
            Some(table) => table.transmissions_into(&[zenith], row),
            None => Ok(()),
        }
    }

    /// Σ_k W_k ∫ p_ik T dλ, with the transmissions of a zenith angle.
    pub fn below(&self, i: usize, weights: &[f64], transmissions: &[f64]) -> f64 {
        let range = i * self.k..(i + 1) * self.k;
        let row = self.through[range.clone()].iter().zip(&transmissions[range]);
        row.zip(weights).map(|((p, t), w)| w * p * t).sum()
    }

    /// By how much that may err through the interpolation over the zenith angle.
    pub fn error(&self, i: usize, weights: &[f64]) -> f64 {
        let row = &self.through[i * self.k..(i + 1) * self.k];
        let sum: f64 = row.iter().zip(weights).map(|(p, w)| w * p).sum();
        sum * self.interpolation_error()
    }

    pub fn interpolation_error(&self) -> f64 {
        self.air.as_ref().map_or(0.0, AirTable::interpolation_error)
    }

    /// Zenith angles that are tabulated.
    pub fn nodes(&self) -> usize {
        self.air.as_ref().map_or(0, AirTable::nodes)
    }

    /// The apparent zenith angle of a true one, degrees; the same without air.
    pub fn apparent_deg(&self, zenith: Zenith) -> Result<f64, AirError> {
        match (&self.air, zenith) {
            (Some(table), zenith) => table.apparent_deg(zenith),
            (None, Zenith::True(deg) | Zenith::Apparent(deg)) => straight(deg),
            (None, Zenith::Near { true_deg, .. }) => straight(true_deg),
        }
    }

    /// Width (nm) of i that no table covers, for the materials that shine.
    pub fn uncovered(&self, i: usize, weights: &[f64]) -> f64 {
        let row = &self.uncovered_nm[i * self.k..(i + 1) * self.k];
        row.iter().zip(weights).filter(|(_, w)| **w > 0.0).fold(0.0, |most, (u, _)| u.max(most))
    }
}

/// A line of sight without air.
fn straight(zenith_deg: f64) -> Result<f64, AirError> {
    match zenith_deg <= 90.0 {
        true => Ok(zenith_deg),
        false => Err(AirError::BelowHorizon { kind: "true", zenith_deg, horizon_deg: 90.0 }),
    }
}

/// All integrals of a pass.
pub(super) struct Functionals {
    /// Channels (Hz m² per weight, to be divided by r² and d²), then bands (fluxes over that of magnitude 0).
    pub sums: Set,
    /// Bin means of E ρ_k, W m⁻² nm⁻¹, `[bin * k + j]`.
    pub spectral: Vec<f64>,
    /// Bins that a table does not cover, by material spectrum.
    pub spectral_uncovered: Vec<bool>,
    /// The same through the air, where the spectra are at the telescope.
    pub at_telescope: Option<Set>,
}

impl Functionals {
    pub fn new(pass: &Pass, spectra: &[&Spectrum<Reflectance>]) -> Result<Self, PassError> {
        let (k, sun) = (spectra.len(), &pass.sun);
        let light = || spectra.iter().map(|rho| Product::of(sun).times(rho));
        let scale = pass.station.telescope.area_m2() / HC_J_NM;
        let bands = BANDS.map(Passband::named);
        let bands = bands.into_iter().collect::<Result<Vec<_>, _>>()?;
        let mut products = Vec::with_capacity((pass.station.channels.len() + bands.len()) * k);
        for channel in &pass.station.channels {
            products.extend(light().map(|product| {
                channel.times_sensitivity(product).times_wavelength().times_number(scale)
            }));
        }
        for band in &bands {
            let norm = Product::of(&band.response);
            let photons = band.weighting == Weighting::Photon;
            let weighted = |p: Product<'_>| {
                if photons { p.times_wavelength().integral() } else { p.integral() }
            };
            let norm = weighted(norm).value * band.zero_irradiance(pass.zero)?;
            products.extend(light().map(|product| {
                let product = product.times(&band.response).times_number(1.0 / norm);
                if photons { product.times_wavelength() } else { product }
            }));
        }
        let sums = Set::new(pass, k, &products)?;

        let bins = pass.bins();
        let mut spectral = vec![0.0; bins * k];
        let mut spectral_uncovered = vec![false; k];
        for (j, product) in light().enumerate() {
            let integrals = product.bins(&pass.edges_nm)?;
            for (bin, (integral, edge)) in
                integrals.iter().zip(pass.edges_nm.windows(2)).enumerate()
            {
                spectral[bin * k + j] = integral.value / (edge[1] - edge[0]);
                spectral_uncovered[j] |= !integral.is_covered();
            }
        }
        let at_telescope = match pass.spectral {
            SpectralQuantity::Intensity => None,
            SpectralQuantity::Irradiance => {
                let boxes: Vec<Spectrum<Response>> = pass
                    .edges_nm
                    .windows(2)
                    .map(|e| Spectrum::constant(1.0 / (e[1] - e[0]), e[0], e[1]))
                    .collect::<Result<_, _>>()?;
                let products: Vec<Product> =
                    boxes.iter().flat_map(|b| light().map(move |p| p.times(b))).collect();
                Some(Set::new(pass, k, &products)?)
            }
        };
        Ok(Self { sums, spectral, spectral_uncovered, at_telescope })
    }
}
