//! The integrals over wavelength that a pass needs, taken once: all that is left for an epoch are sums over the terms of its light.

use super::{BANDS, Pass, PassError, SpectralQuantity};
use crate::light::{Source, Stated, Term, Way};
use rayon::prelude::*;
use std::ops::Range;
use sunglint_radiometry::air::{AirError, AirTable, Sampling, Zenith};
use sunglint_radiometry::constants::HC_J_NM;
use sunglint_radiometry::passband::{Passband, Weighting};
use sunglint_radiometry::quadrature::{Integral, Product};
use sunglint_radiometry::spectrum::{Factor, Response, Spectrum, SpectrumError};

/// The terms of the light, made ready for sums. A mean transmission wants a weight that is nowhere negative: a spectrum that changes its sign
/// becomes two columns.
pub(super) struct Columns<'a> {
    terms: &'a [Term],
    /// How many terms have light; those after them have errors alone.
    lit: usize,
    spectra: Vec<Spectrum<Factor>>,
    /// The term of each column, and its sign.
    of: Vec<(usize, f64)>,
}

impl<'a> Columns<'a> {
    pub fn new(terms: &'a [Term], lit: usize) -> Result<Self, SpectrumError> {
        let (mut spectra, mut of) = (Vec::new(), Vec::new());
        for (number, term) in terms[..lit].iter().enumerate() {
            let some = |sign: f64| term.spectrum.value().iter().any(|v| sign * v > 0.0);
            match (some(1.0), some(-1.0)) {
                (_, false) => {
                    spectra.push(term.spectrum.clone());
                    of.push((number, 1.0));
                }
                (positive, true) => {
                    if positive {
                        spectra.push(one_sign(&term.spectrum, 1.0)?);
                        of.push((number, 1.0));
                    }
                    spectra.push(one_sign(&term.spectrum, -1.0)?);
                    of.push((number, -1.0));
                }
            }
        }
        Ok(Self { terms, lit, spectra, of })
    }

    /// The spectra of terms that have errors alone.
    fn unlit(&self) -> impl Iterator<Item = &Spectrum<Factor>> {
        self.terms[self.lit..].iter().map(|t| &t.spectrum)
    }
}

/// max(0, ±f), with its zeros as points: exact for what is linear between its points.
fn one_sign(spectrum: &Spectrum<Factor>, sign: f64) -> Result<Spectrum<Factor>, SpectrumError> {
    let (x, y) = (spectrum.wavelength_nm(), spectrum.value());
    let (mut nm, mut value) = (Vec::with_capacity(x.len()), Vec::with_capacity(x.len()));
    for k in 0..x.len() {
        if k > 0 && y[k - 1] * y[k] < 0.0 {
            let zero = x[k - 1] + (x[k] - x[k - 1]) * (y[k - 1] / (y[k - 1] - y[k]));
            if zero > x[k - 1] && zero < x[k] {
                nm.push(zero);
                value.push(0.0);
            }
        }
        nm.push(x[k]);
        value.push((sign * y[k]).max(0.0));
    }
    Spectrum::new(nm, value)
}

/// Function that multiplies the light by something.
type With<'b> = Box<dyn Fn(Product<'b>) -> Product<'b> + 'b>;

/// A set of products p_ik of E τ_k with something i, and their integrals with and without the air: those that have any light, which of many narrow terms are few.
pub(super) struct Set {
    /// Where the products of each i end, of those that are kept.
    ends: Vec<usize>,
    /// The term of each product, and its sign.
    of: Vec<(usize, f64)>,
    /// Terms that have light.
    lit: usize,
    /// Ways of the errors of these into that of all light.
    ways: Vec<Way>,
    /// Terms that have errors alone.
    unlit: usize,
    /// ∫ p_ik dλ over everything.
    above: Vec<f64>,
    /// The same of the terms that have errors alone, `[i * unlit + j]`.
    unknown: Vec<f64>,
    /// ∫ p_ik dλ over the tables of the air.
    through: Vec<f64>,
    /// Mean transmissions; `None` where there is no air.
    air: Option<AirTable>,
    /// Widths that are not covered, the air counted too.
    uncovered_nm: Vec<f64>,
}

impl Set {
    fn new<'b>(
        pass: &'b Pass,
        columns: &'b Columns<'b>,
        with: &[With<'b>],
    ) -> Result<Self, PassError> {
        let sun = &pass.sun;
        let mut products = Vec::with_capacity(with.len() * columns.spectra.len());
        let mut unknown = Vec::new();
        for with in with {
            products.extend(columns.spectra.iter().map(|tau| with(Product::of(sun).times(tau))));
            let value = |tau: &'b Spectrum<Factor>| {
                with(Product::of(sun).times(tau)).integral().value.abs()
            };
            unknown.extend(columns.unlit().map(value));
        }
        let all: Vec<Integral> = products.par_iter().map(Product::integral).collect();
        let has_light = |i: &Integral| i.value != 0.0 || i.uncovered_nm != 0.0;
        // The air is asked for zenith angles even where nothing shines.
        let none = !all.iter().any(has_light);
        let (mut ends, mut of, mut above, mut kept) =
            <(Vec<usize>, Vec<_>, Vec<_>, Vec<_>)>::default();
        for (k, (product, integral)) in products.into_iter().zip(all).enumerate() {
            if has_light(&integral) || (none && k == 0) {
                of.push(columns.of[k % columns.spectra.len()]);
                above.push(integral);
                kept.push(product);
            }
            if (k + 1).is_multiple_of(columns.spectra.len()) {
                ends.push(kept.len());
            }
        }
        ends.resize(with.len(), kept.len());
        let mut set = Self {
            ends,
            of,
            lit: columns.lit,
            ways: columns.terms[..columns.lit].iter().map(Term::way).collect(),
            unlit: columns.terms.len() - columns.lit,
            through: above.iter().map(|i| i.value).collect(),
            uncovered_nm: above.iter().map(|i| i.uncovered_nm).collect(),
            above: above.iter().map(|i| i.value).collect(),
            unknown,
            air: None,
        };
        if let (Some(air), false) = (&pass.air, kept.is_empty()) {
            let (sampling, integrals) = Sampling::weighted(&kept)?;
            set.through = integrals.iter().map(|i| i.value).collect();
            set.uncovered_nm = integrals.iter().map(|i| i.uncovered_nm).collect();
            set.air = Some(AirTable::new(air, &sampling, pass.air_tolerance)?);
        }
        Ok(set)
    }

    /// Multiplies what each term has in `i`.
    fn scale(&mut self, factor: &dyn Fn(usize, usize) -> f64) {
        for i in 0..self.len() {
            for j in self.range(i) {
                let by = factor(i, self.of[j].0);
                self.above[j] *= by;
                self.through[j] *= by;
            }
            for j in 0..self.unlit {
                self.unknown[i * self.unlit + j] *= factor(i, self.lit + j);
            }
        }
    }

    pub fn len(&self) -> usize {
        self.ends.len()
    }

    /// The products of `i`.
    fn range(&self, i: usize) -> Range<usize> {
        let first = if i == 0 { 0 } else { self.ends[i - 1] };
        first..self.ends[i]
    }

    /// Numbers of the products of `i`, each with its term and sign.
    fn row<'a>(
        &'a self,
        table: &'a [f64],
        i: usize,
    ) -> impl Iterator<Item = (&'a f64, &'a (usize, f64))> {
        let range = self.range(i);
        table[range.clone()].iter().zip(&self.of[range])
    }

    /// The same of what goes through the air, with the transmissions of a zenith angle.
    fn row_below<'a>(
        &'a self,
        transmissions: &'a [f64],
        i: usize,
    ) -> impl Iterator<Item = ((&'a f64, &'a f64), &'a (usize, f64))> {
        let range = self.range(i);
        let row = self.through[range.clone()].iter().zip(&transmissions[range.clone()]);
        row.zip(&self.of[range])
    }

    /// Σ_k W_k ∫ p_ik dλ, no air.
    pub fn above(&self, i: usize, weights: &[f64]) -> f64 {
        self.row(&self.above, i).map(|(p, (k, sign))| sign * weights[*k] * p).sum()
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
        let row = self.row_below(transmissions, i);
        row.map(|((p, t), (k, sign))| sign * weights[*k] * p * t).sum()
    }

    /// Adds to each term's number what it has in [`Set::below`].
    pub fn add_terms_below(
        &self,
        i: usize,
        weights: &[f64],
        transmissions: &[f64],
        terms: &mut [f64],
    ) {
        let row = self.row_below(transmissions, i);
        row.for_each(|((p, t), (k, sign))| terms[*k] += sign * weights[*k] * p * t);
    }

    /// Adds to each term's number what it has in [`Set::above`].
    pub fn add_terms_above(&self, i: usize, weights: &[f64], terms: &mut [f64]) {
        let row = self.row(&self.above, i);
        row.for_each(|(p, (k, sign))| terms[*k] += sign * weights[*k] * p);
    }

    /// Returns the error of [`Set::below`] through the interpolation over the zenith angle.
    pub fn air_error(&self, i: usize, weights: &[f64]) -> f64 {
        let row = self.row(&self.through, i);
        let sum: f64 = row.map(|(p, (k, _))| (weights[*k] * p).abs()).sum();
        sum * self.interpolation_error()
    }

    /// Returns the error of [`Set::above`] through the errors of the weights.
    pub fn error_above(&self, i: usize, errors: &[f64]) -> f64 {
        let mut stated = Stated::default();
        let row = self.row(&self.above, i);
        row.for_each(|(p, (k, _))| stated.add(self.ways[*k], errors[*k] * p.abs()));
        stated.total() + self.unknown(i, errors)
    }

    /// Returns the error of [`Set::below`] through the errors of the weights. What is unknown goes through the air as the light does:
    /// `transmitted` of it.
    pub fn error_below(
        &self,
        i: usize,
        errors: &[f64],
        transmissions: &[f64],
        transmitted: f64,
    ) -> f64 {
        let mut stated = Stated::default();
        let row = self.row_below(transmissions, i);
        row.for_each(|((p, t), (k, _))| stated.add(self.ways[*k], errors[*k] * (p * t).abs()));
        stated.total() + transmitted * self.unknown(i, errors)
    }

    fn unknown(&self, i: usize, errors: &[f64]) -> f64 {
        let row = &self.unknown[i * self.unlit..(i + 1) * self.unlit];
        row.iter().zip(&errors[self.lit..]).map(|(p, e)| p * e).sum()
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

    /// Width (nm) of i that no table covers, for the terms that shine.
    pub fn uncovered(&self, i: usize, weights: &[f64]) -> f64 {
        let row = self.row(&self.uncovered_nm, i);
        row.filter(|(_, (k, _))| weights[*k] != 0.0).fold(0.0, |most, (u, _)| u.max(most))
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
    /// Bin means of E τ_k, W m⁻² nm⁻¹: for each bin those of the terms that have light there, by their numbers.
    pub spectral: Vec<Vec<(usize, f64)>>,
    /// Bins that a table does not cover, by term.
    pub spectral_uncovered: Vec<bool>,
    /// The same through the air, where the spectra are at the telescope.
    pub at_telescope: Option<Set>,
    /// Which way the light of each term came.
    sources: Vec<Source>,
    /// Way of each term's error into that of all light.
    pub ways: Vec<Way>,
}

impl Functionals {
    pub fn new(pass: &Pass, terms: &[Term], lit: usize) -> Result<Self, PassError> {
        let columns = Columns::new(terms, lit)?;
        let scale = pass.station.telescope.area_m2() / HC_J_NM;
        let bands = BANDS.map(Passband::named);
        let bands = bands.into_iter().collect::<Result<Vec<_>, _>>()?;
        let mut with: Vec<With> = Vec::with_capacity(pass.station.channels.len() + bands.len());
        for channel in &pass.station.channels {
            with.push(Box::new(move |product| {
                channel.times_sensitivity(product).times_wavelength().times_number(scale)
            }));
        }
        for band in &bands {
            let photons = band.weighting == Weighting::Photon;
            let weighted = move |p: Product<'_>| {
                if photons { p.times_wavelength().integral() } else { p.integral() }
            };
            let norm = weighted(Product::of(&band.response)).value;
            let norm = norm * band.zero_irradiance(pass.zero)?;
            with.push(Box::new(move |product| {
                let product = product.times(&band.response).times_number(1.0 / norm);
                if photons { product.times_wavelength() } else { product }
            }));
        }
        let mut sums = Set::new(pass, &columns, &with)?;

        let (bins, k) = (pass.bins(), terms.len());
        let mut spectral = vec![Vec::new(); bins];
        let mut spectral_uncovered = vec![false; k];
        for (j, term) in terms.iter().enumerate() {
            let integrals = Product::of(&pass.sun).times(&term.spectrum).bins(&pass.edges_nm)?;
            for (bin, (integral, edge)) in
                integrals.iter().zip(pass.edges_nm.windows(2)).enumerate()
            {
                if integral.value != 0.0 {
                    spectral[bin].push((j, integral.value / (edge[1] - edge[0])));
                }
                spectral_uncovered[j] |= !integral.is_covered();
            }
        }
        let mut at_telescope = match pass.spectral {
            SpectralQuantity::Intensity => None,
            SpectralQuantity::Irradiance => {
                let boxes: Vec<Spectrum<Response>> = pass
                    .edges_nm
                    .windows(2)
                    .map(|e| Spectrum::constant(1.0 / (e[1] - e[0]), e[0], e[1]))
                    .collect::<Result<_, _>>()?;
                let mut with: Vec<With> = Vec::with_capacity(boxes.len());
                for mean in &boxes {
                    with.push(Box::new(move |product| product.times(mean)));
                }
                Some(Set::new(pass, &columns, &with)?)
            }
        };
        let correction = &pass.correction;
        if !correction.is_none() {
            let channels = &pass.station.channels;
            let named = |i: usize| channels.get(i).map(|c| c.name.as_str());
            sums.scale(&|i, k| correction.factor(&terms[k], &pass.target, named(i)));
            let grey: Vec<f64> =
                terms.iter().map(|t| correction.factor(t, &pass.target, None)).collect();
            spectral.iter_mut().flatten().for_each(|(k, mean)| *mean *= grey[*k]);
            if let Some(set) = &mut at_telescope {
                set.scale(&|_, k| grey[k]);
            }
        }
        let sources = terms.iter().map(|t| t.source).collect();
        let ways = terms.iter().map(Term::way).collect();
        Ok(Self { sums, spectral, spectral_uncovered, at_telescope, sources, ways })
    }

    /// The way of the light that has most of the error of channel (or band) `i`; none without errors.
    pub fn limit(&self, i: usize, errors: &[f64]) -> Option<Source> {
        let mut all: Vec<(Source, f64)> = Vec::new();
        let mut add = |source: Source, error: f64| match all.iter_mut().find(|s| s.0 == source) {
            Some((_, sum)) => *sum += error,
            None => all.push((source, error)),
        };
        let set = &self.sums;
        for (p, (k, _)) in set.row(&set.above, i) {
            add(self.sources[*k], errors[*k] * p.abs());
        }
        add(Source::Unknown, set.unknown(i, errors));
        let most = all.into_iter().filter(|(_, error)| *error > 0.0);
        most.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(source, _)| source)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: the function itself at points between its points, zeros between them included: its parts add up to it and never go below 0.
    #[test]
    fn a_spectrum_that_changes_its_sign_is_the_difference_of_two_that_do_not() {
        let nm = vec![400.0, 500.0, 600.0, 650.0, 700.0];
        let value = vec![1.0, -3.0, -1.0, 0.0, 2.0];
        let spectrum = Spectrum::<Factor>::new(nm, value).unwrap();
        let [above, below] = [1.0, -1.0].map(|sign| one_sign(&spectrum, sign).unwrap());
        for k in 0..=3000 {
            let nm = 400.0 + 0.1 * f64::from(k);
            let (a, b, truth) = (above.at(nm), below.at(nm), spectrum.at(nm));
            assert!(a >= 0.0 && b >= 0.0 && a.min(b) < 1e-12, "{nm}: {a} {b}");
            assert!((a - b - truth).abs() < 1e-12, "{nm}: {a} - {b} is not {truth}");
        }
    }

    /// Truth: integrals are linear: a term a − b with the weight 2 and the error 0.1 has the light of a and b with the weights 2 and −2,
    /// whatever the air, and at most the error of both. Tolerance: rounding, and what the tables over the zenith angle may err by (1e-7).
    #[test]
    fn a_term_that_changes_its_sign_goes_through_the_air() {
        use crate::light::Source;
        let file = super::super::PassFile::read(
            sunglint_testkit::repository().join("fixtures/scenes/box_wing_dusk.toml"),
        );
        let pass = file.unwrap().resolve(super::super::Overrides::default()).unwrap();
        let term = |value: [f64; 3]| {
            let spectrum = Spectrum::new(vec![300.0, 600.0, 1240.0], value.to_vec()).unwrap();
            Term { source: Source::Bounce, material: None, spectrum }
        };
        let one = Functionals::new(&pass, &[term([0.9, -0.3, 0.2])], 1).unwrap();
        let two =
            Functionals::new(&pass, &[term([0.9, 0.1, 0.5]), term([0.0, 0.4, 0.3])], 2).unwrap();
        let (mut first, mut second) = (Vec::new(), Vec::new());
        for zenith in [0.0, 60.0, 85.0] {
            one.sums.transmissions(Zenith::Apparent(zenith), &mut first).unwrap();
            two.sums.transmissions(Zenith::Apparent(zenith), &mut second).unwrap();
            for i in 0..one.sums.len() {
                let (a, b) = (one.sums.above(i, &[2.0]), two.sums.above(i, &[2.0, -2.0]));
                let scale = two.sums.above(i, &[2.0, 2.0]);
                assert!((a - b).abs() <= 1e-12 * scale, "{i}: {a} {b}");
                let (a, b) =
                    (one.sums.below(i, &[2.0], &first), two.sums.below(i, &[2.0, -2.0], &second));
                assert!((a - b).abs() <= 4e-7 * scale, "{i} at {zenith}: {a} {b}");
                let (a, b) = (
                    one.sums.error_below(i, &[0.1], &first, 1.0),
                    two.sums.error_below(i, &[0.1, 0.1], &second, 1.0),
                );
                assert!(a > 0.0 && a <= b + 1e-7 * scale, "{i} at {zenith}: {a} {b}");
            }
        }
    }
}
