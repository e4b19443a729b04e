//! Materials that have been in space for a while: less light, by wavelength, and a duller gloss, by exponential laws of a dose.
//!
//! f of a new material is multiplied by F(λ) = e + (1 − e) exp(−D/D₀), with D the dose, e(λ) the share of its light that is left in the end and D₀(λ) the dose after which a share of 1/e of the change is still
//! to come. So it stays reciprocal, and never reflects more than before. The roughness of its lobes grows by α² = α₀² + (α_e² − α₀²)(1 − exp(−D/D_α)). Particles that leave a layer or break bonds one by one
//! give such laws: what is left to be changed decreases in proportion to itself. The numbers are those of an experiment (accelerated tests of Bengtson et al. 2018 found less light in the visible
//! of Mylar and Kapton, in the near infrared of white paint, and duller gloss).

use super::{Material, MaterialError};
use sunglint_radiometry::spectrum::Spectrum;

/// Parts of an interval between two wavelengths of either table at most: products of what is linear are not.
const PARTS: usize = 512;
/// Error of the product between its wavelengths.
const ERROR: f64 = 2e-6;

/// Ageing of a material by a dose.
#[derive(Debug, Clone, PartialEq)]
pub struct Ageing {
    dose: f64,
    wavelength_nm: Vec<f64>,
    left: Vec<f64>,
    scale: Vec<f64>,
}

impl Ageing {
    /// A dose from 0 on, and at each of some wavelengths (vacuum nm, increasing; between them what is left now is linear, beyond them it is held) the share of the light that is left in the end, 0 to 1, and the
    /// dose after which 1/e of the change is still to come, in the unit of the dose.
    ///
    /// # Errors
    /// Numbers out of range; lists that are not equally long, or empty.
    pub fn new(
        dose: f64,
        wavelength_nm: Vec<f64>,
        left: Vec<f64>,
        scale: Vec<f64>,
    ) -> Result<Self, MaterialError> {
        let wrong = |name, value, expected: &str| {
            Err(MaterialError::Parameter { name, value, expected: expected.to_owned() })
        };
        if !(0.0..f64::INFINITY).contains(&dose) {
            return wrong("the dose", dose, "from 0 on");
        }
        let count = wavelength_nm.len();
        if count == 0 || left.len() != count || scale.len() != count {
            let least = left.len().min(scale.len()).min(count);
            return wrong("the shortest list of the ageing", least as f64, "of as many values");
        }
        if let Some(pair) = wavelength_nm.windows(2).find(|pair| pair[0] >= pair[1]) {
            return wrong("a wavelength of the ageing", pair[1], "above the one before it");
        }
        if let Some(bad) = left.iter().find(|v| !(0.0..=1.0).contains(*v)) {
            return wrong("what is left of the light", *bad, "from 0 to 1");
        }
        if let Some(bad) = scale.iter().find(|v| !(**v > 0.0 && v.is_finite())) {
            return wrong("the dose of a change", *bad, "above 0");
        }
        Ok(Self { dose, wavelength_nm, left, scale })
    }

    /// The share of the light that is left now at a wavelength, vacuum nm.
    pub fn factor(&self, nm: f64) -> f64 {
        let at = |k: usize| {
            let left = self.left[k];
            left + (1.0 - left) * (-self.dose / self.scale[k]).exp()
        };
        let after = self.wavelength_nm.partition_point(|w| *w <= nm);
        if after == 0 || after == self.wavelength_nm.len() {
            return at(after.saturating_sub(1).min(self.wavelength_nm.len() - 1));
        }
        let (from, to) = (self.wavelength_nm[after - 1], self.wavelength_nm[after]);
        let along = (nm - from) / (to - from);
        at(after - 1) * (1.0 - along) + at(after) * along
    }

    /// Roughness of a lobe of `alpha` that would be `end` after any dose, with `scale` the dose after which 1/e of the change is still to come.
    pub fn roughness(&self, alpha: f64, end: f64, scale: f64) -> f64 {
        let done = -(-self.dose / scale).exp_m1();
        (alpha * alpha + (end * end - alpha * alpha) * done).sqrt()
    }

    /// Returns what it leaves, in words.
    fn describe(&self) -> String {
        let each = self.wavelength_nm.iter().map(|nm| (nm, self.factor(*nm)));
        let each: Vec<String> =
            each.map(|(nm, left)| format!("{:.1} % at {nm} nm", 100.0 * left)).collect();
        format!("aged by a dose of {}, which leaves {} of its light", self.dose, each.join(", "))
    }
}

impl Material {
    /// The material after some ageing. Its polarisation is then not known: a layer that has changed has no index of its own in the tables.
    ///
    /// # Errors
    /// Numbers that make no spectrum.
    pub fn aged(mut self, ageing: &Ageing) -> Result<Self, MaterialError> {
        for spectrum in &mut self.spectra {
            let (first, last) = spectrum.range_nm();
            if super::is_uncovered((first, last)) {
                continue;
            }
            let own = ageing.wavelength_nm.iter().filter(|nm| (first..last).contains(*nm));
            let mut knots: Vec<f64> = spectrum.wavelength_nm().iter().chain(own).copied().collect();
            knots.sort_by(f64::total_cmp);
            knots.dedup();
            let mut nm = vec![knots[0]];
            for pair in knots.windows(2) {
                let change = |f: &dyn Fn(f64) -> f64| f(pair[1]) - f(pair[0]);
                let bend = change(&|nm| spectrum.at(nm)) * change(&|nm| ageing.factor(nm));
                // The product of two lines is off its own line by a quarter of both changes' product.
                let parts = (0.25 * bend.abs() / ERROR).sqrt().ceil().clamp(1.0, PARTS as f64);
                let at = |k: usize| pair[0] + (pair[1] - pair[0]) * k as f64 / parts;
                nm.extend((1..parts as usize).map(at));
                nm.push(pair[1]);
            }
            let value = nm.iter().map(|nm| spectrum.at(*nm) * ageing.factor(*nm)).collect();
            *spectrum = Spectrum::new(nm, value)?;
        }
        self.ageing = Some(ageing.describe());
        Ok(self)
    }

    /// How the material has aged, in words; `None` of a new one.
    pub fn ageing(&self) -> Option<&str> {
        self.ageing.as_deref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::{Distribution, Fresnel, Lobe, Masking, PolarisedPart};
    use glam::DVec3;

    /// Truth: by hand: after a dose of 2 with scales of 1 and 4, and 0.2 and 0.6 left in the end: 0.2 + 0.8 e⁻² = 0.308268 at 400 nm and 0.6 + 0.4 e^(−½) = 0.842612 at 800 nm, their mean at 600 nm, held beyond; f is what it was
    /// times that, in all directions. A dose of 0 changes nothing. α of 0.1 that goes to 0.5: √(0.01 + 0.24 (1 − e^(−2/3))) = 0.356062. Tolerance: rounding of the digits, 1e-5 between wavelengths.
    #[test]
    fn light_and_gloss_decay_as_told() {
        let ageing =
            |dose| Ageing::new(dose, vec![400.0, 800.0], vec![0.2, 0.6], vec![1.0, 4.0]).unwrap();
        let aged = ageing(2.0);
        for (nm, truth) in
            [(300.0, 0.308_268), (400.0, 0.308_268), (600.0, 0.575_440), (900.0, 0.842_612)]
        {
            assert!((aged.factor(nm) - truth).abs() < 1e-6, "{nm}: {}", aged.factor(nm));
        }
        assert!((aged.roughness(0.1, 0.5, 3.0) - 0.356_062).abs() < 1e-6);
        let lobe = Lobe::isotropic(Distribution::Ggx, 0.3, Masking::Separable).unwrap();
        let rho = Spectrum::new(vec![300.0, 700.0, 1000.0], vec![0.2, 0.9, 0.5]).unwrap();
        let coat = Fresnel::dielectric(1.5, 300.0, 1000.0).unwrap();
        let new = [
            Material::lambert("l", rho.clone()).unwrap(),
            Material::blend("b", rho, lobe, coat.clone()).unwrap(),
            Material::microfacet("g", lobe, coat),
        ];
        let i = DVec3::new(0.5, 0.1, 0.8).normalize();
        let o = DVec3::new(-0.3, 0.2, 0.9).normalize();
        for new in new {
            let old = new.clone().aged(&aged).unwrap();
            for nm in [300.0, 401.0, 555.0, 640.0, 800.0, 999.0] {
                let ratio = old.brdf(nm, i, o) / new.brdf(nm, i, o);
                assert!((ratio - aged.factor(nm)).abs() < 5e-5, "{} {nm}: {ratio}", new.name);
            }
            let same = new.clone().aged(&ageing(0.0)).unwrap().brdf(640.0, i, o);
            assert!((same / new.brdf(640.0, i, o) - 1.0).abs() < 1e-12, "{same}");
            assert!(
                old.describe().contains("30.8 % at 400 nm, 84.3 % at 800 nm"),
                "{}",
                old.describe()
            );
            let diffuse = new.is_lambert();
            assert_eq!(matches!(old.polarised().unwrap(), PolarisedPart::Nothing), diffuse);
            assert_eq!(matches!(old.polarised().unwrap(), PolarisedPart::Unknown), !diffuse);
        }
    }

    #[test]
    fn numbers_that_make_no_sense_are_refused() {
        for (dose, nm, left, scale, said) in [
            (-1.0, vec![500.0], vec![0.5], vec![1.0], "dose is -1"),
            (1.0, vec![500.0, 400.0], vec![0.5; 2], vec![1.0; 2], "400"),
            (1.0, vec![500.0], vec![1.5], vec![1.0], "1.5"),
            (1.0, vec![500.0], vec![0.5], vec![0.0], "above 0"),
            (1.0, vec![500.0], vec![], vec![1.0], "as many"),
            (1.0, vec![], vec![], vec![], "as many"),
        ] {
            let error = Ageing::new(dose, nm, left, scale).unwrap_err().to_string();
            assert!(error.contains(said), "{error}");
        }
    }
}
