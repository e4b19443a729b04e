//! Measured data: a calibrated light curve, or a table of magnitudes.

use super::{CompareError, Kappa};
use crate::measured::of_v;
use hifitime::Epoch;
use ndarray::Array2;
use std::path::{Path, PathBuf};
use sunglint_ephemeris::orbit::{Orbit, tle};
use sunglint_formats::Table;
use sunglint_formats::time::tai_nanoseconds;
use sunglint_radiometry::light_curve::published::{
    Brightness, CurveFile, MagnitudeKind, MagnitudeOptions, ObjectRows,
};
use sunglint_radiometry::light_curve::{Flags, Input, LightCurve, RateKind};
use sunglint_radiometry::station::Station;
use sunglint_simulator::pass::{
    ChannelSamples, MaterialDoubt, Pass, Simulation, StandardMagnitude,
};

/// The place of V among the bands.
const V: usize = 2;

/// The simulated magnitudes of a kind.
fn simulated(kind: MagnitudeKind, simulation: &Simulation<'_>) -> Vec<f64> {
    match kind {
        MagnitudeKind::Ground => simulation.ground_magnitudes.column(V).to_vec(),
        MagnitudeKind::Range => simulation.standard_magnitudes(StandardMagnitude::Range),
        MagnitudeKind::Standard => {
            simulation.standard_magnitudes(StandardMagnitude::IlluminatedFraction)
        }
        _ => simulation.magnitudes.column(V).to_vec(),
    }
}

/// Quantity of a curve's values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// Rates at the detector, Hz.
    Rate,
    /// Fluxes over that of magnitude 0, of magnitudes of this kind.
    Flux(MagnitudeKind),
}

/// A channel as it was measured; the entries of its samples.
#[derive(Debug, Clone)]
pub struct MeasuredChannel {
    /// Name of the channel.
    pub name: String,
    /// The values; NaN where there is none.
    pub value: Vec<f64>,
    /// Their standard uncertainties; NaN where none is known.
    pub sigma: Vec<f64>,
    /// Flags of each sample.
    pub flags: Vec<Flags>,
}

/// A measured pass.
#[derive(Debug, Clone)]
pub struct MeasuredPass {
    /// The file.
    pub path: PathBuf,
    /// The same with its check sum.
    pub input: Input,
    /// Quantity of the values.
    pub quantity: Quantity,
    /// When: in order.
    pub times: Vec<Epoch>,
    /// For how long, s; `None` where the file does not say.
    pub exposure_s: Option<Vec<f64>>,
    /// The channels; one of magnitudes.
    pub channels: Vec<MeasuredChannel>,
    /// Calibration of the curve, as the file says.
    pub kappa: Option<Kappa>,
    /// The target's name as the file has it; may be empty.
    pub target: String,
    /// The target's catalogue number, where the file has its elements.
    pub norad_id: Option<u32>,
    /// The station's.
    pub station: String,
    /// Input files of the pass.
    pub inputs: Vec<Input>,
    /// Notes in the file about the curve.
    pub notes: Vec<String>,
    /// Findings of the reader of magnitudes, in words: rows that were left out, samples without an uncertainty.
    pub warnings: Vec<String>,
    /// Place of each sample in its file, from 0: samples are in the order of time.
    pub file_rows: Vec<usize>,
    /// Rows of the file that said what another said, and were left out.
    pub doubled: usize,
}

impl MeasuredPass {
    /// Reads what was measured of a scene: calibrated rates of the schema, or magnitudes in V in any format of
    /// [`CurveFile`]; rows in any order. Magnitudes stay of their kind. Rows of several objects are an error, unless one is named or the scene has a place for each row.
    ///
    /// # Errors
    /// A file that is none of them, rates that are not calibrated, magnitudes without a zero point, no sample.
    pub fn read(
        path: &Path,
        magnitudes: &MagnitudeOptions,
        scene: &Pass,
    ) -> Result<Self, CompareError> {
        let bytes = sunglint_formats::read::bytes(path)?;
        let input =
            Input { file: path.display().to_string(), sha256: sunglint_formats::sha256(&bytes) };
        let mut options = MagnitudeOptions { as_written: true, ..magnitudes.clone() };
        if !scene.observations.is_empty() && options.rows == ObjectRows::One {
            options.rows = ObjectRows::All;
        }
        let mut measured = match CurveFile::read(path, bytes, &options)? {
            CurveFile::Magnitudes(read) => Self::magnitudes(path, input, *read, options.kind)?,
            CurveFile::Rates(table) => {
                let mut measured = Self::rates(path, input, &table)?;
                measured.sort();
                measured.drop_doubled();
                measured
            }
        };
        measured.exposures()?;
        measured.warnings.extend(measured.another_object(scene));
        sunglint_calibration::comparison::in_order(&measured.times).map_err(|source| {
            CompareError::Order { path: path.to_path_buf(), source: Box::new(source) }
        })?;
        Ok(measured)
    }

    /// The warning that the file and the scene name two objects, where both have a catalogue number.
    fn another_object(&self, scene: &Pass) -> Option<String> {
        let Orbit::Tle(orbit) = &scene.orbit else { return None };
        let simulated = orbit.tle().norad_id;
        let is_number = |text: &&str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
        let named = || Some(self.target.trim()).filter(is_number)?.parse::<u32>().ok();
        let measured = self.norad_id.or_else(named)?;
        (measured != simulated).then(|| {
            format!(
                "{}: the light is that of the object {measured}, the scene's orbit is that of {simulated}",
                self.path.display()
            )
        })
    }

    /// Puts the samples in the order of time; those of one moment in the order of their values, so that the order of a file's rows never matters.
    fn sort(&mut self) {
        let keys: Vec<i128> = self.times.iter().map(|t| tai_nanoseconds(*t)).collect();
        let mut order: Vec<usize> = (0..keys.len()).collect();
        order.sort_by(|a, b| {
            let differ = self.channels.iter().flat_map(|c| {
                let flags = c.flags[*a].bits().cmp(&c.flags[*b].bits());
                [c.value[*a].total_cmp(&c.value[*b]), c.sigma[*a].total_cmp(&c.sigma[*b]), flags]
            });
            let mut differ = differ.filter(|o| o.is_ne());
            keys[*a].cmp(&keys[*b]).then_with(|| differ.next().unwrap_or(std::cmp::Ordering::Equal))
        });
        if order.windows(2).all(|p| p[0] < p[1]) {
            self.file_rows = order;
            return;
        }
        let pick = |from: &[f64]| order.iter().map(|i| from[*i]).collect::<Vec<f64>>();
        self.exposure_s = self.exposure_s.as_deref().map(pick);
        for channel in &mut self.channels {
            channel.value = pick(&channel.value);
            channel.sigma = pick(&channel.sigma);
            channel.flags = order.iter().map(|i| channel.flags[*i]).collect();
        }
        self.times = order.iter().map(|i| self.times[*i]).collect();
        self.file_rows = order;
    }

    /// Takes out samples that are the same as the one before them (time, exposure, light and flags of every channel): they say nothing new.
    fn drop_doubled(&mut self) {
        let same = |a: usize, b: usize| {
            let exposures = self.exposure_s.as_ref();
            self.times[a] == self.times[b]
                && exposures.is_none_or(|e| e[a].to_bits() == e[b].to_bits())
                && self.channels.iter().all(|c| {
                    (c.value[a] == c.value[b] || c.value[a].is_nan() && c.value[b].is_nan())
                        && c.sigma[a].to_bits() == c.sigma[b].to_bits()
                        && c.flags[a] == c.flags[b]
                })
        };
        let keep: Vec<bool> = (0..self.times.len()).map(|i| i == 0 || !same(i - 1, i)).collect();
        let doubled = keep.iter().filter(|k| !**k).count();
        if doubled == 0 {
            return;
        }
        fn retain<T>(all: &mut Vec<T>, keep: &[bool]) {
            let mut keep = keep.iter();
            all.retain(|_| keep.next().is_some_and(|k| *k));
        }
        retain(&mut self.times, &keep);
        retain(&mut self.file_rows, &keep);
        if let Some(exposures) = &mut self.exposure_s {
            retain(exposures, &keep);
        }
        for channel in &mut self.channels {
            retain(&mut channel.value, &keep);
            retain(&mut channel.sigma, &keep);
            retain(&mut channel.flags, &keep);
        }
        self.doubled = doubled;
    }

    fn rates(path: &Path, input: Input, table: &Table) -> Result<Self, CompareError> {
        let curve = LightCurve::from_table(path, table)?;
        if curve.kind != RateKind::Calibrated {
            return Err(CompareError::NotCalibrated { path: path.to_path_buf(), kind: curve.kind });
        }
        let kappa = curve.other.get("kappa").and_then(Kappa::of);
        let elements = curve.other.get("target").and_then(|target| target.get("tle")?.as_array());
        let norad_id = elements.and_then(|lines| {
            let lines: Option<Vec<&str>> = lines.iter().map(|line| line.as_str()).collect();
            let sets = tle::parse("target", &lines?.join("\n")).ok()?;
            Some(sets.first()?.norad_id)
        });
        let named = || curve.other.get("target")?.get("name")?.as_str().map(str::to_owned);
        let own = Some(curve.provenance.target.clone()).filter(|t| !t.is_empty());
        Ok(Self {
            path: path.to_path_buf(),
            input,
            quantity: Quantity::Rate,
            kappa,
            target: own.or_else(named).unwrap_or_default(),
            norad_id,
            station: curve.provenance.station.clone(),
            inputs: curve.provenance.inputs.clone(),
            notes: curve.provenance.notes.clone(),
            warnings: Vec::new(),
            file_rows: Vec::new(),
            doubled: 0,
            times: curve.samples.time,
            exposure_s: Some(curve.samples.exposure_s),
            channels: curve
                .channels
                .into_iter()
                .map(|c| MeasuredChannel {
                    name: c.name,
                    value: c.rate_hz,
                    sigma: c.sigma_hz,
                    flags: c.flags,
                })
                .collect(),
        })
    }

    fn magnitudes(
        path: &Path,
        input: Input,
        read: Brightness,
        kind: MagnitudeKind,
    ) -> Result<Self, CompareError> {
        if read.is_relative {
            return Err(CompareError::Relative { path: path.to_path_buf() });
        }
        let of_v = of_v(read.labels.as_deref());
        let mut flags = vec![Flags::empty(); read.times.len()];
        for (flags, used) in flags.iter_mut().zip(&of_v.used) {
            flags.set(Flags::NOT_SAMPLED, !used);
        }
        let sigma = read.share.iter().zip(&read.flux).map(|(share, flux)| share * flux).collect();
        let warnings = read.notes.into_iter().chain(of_v.note).collect();
        Ok(Self {
            path: path.to_path_buf(),
            input,
            quantity: Quantity::Flux(kind),
            times: read.times,
            exposure_s: read.is_exposure_known.then_some(read.exposure_s),
            channels: vec![MeasuredChannel { name: read.column, value: read.flux, sigma, flags }],
            kappa: None,
            target: read.target,
            norad_id: None,
            station: String::new(),
            inputs: Vec::new(),
            notes: Vec::new(),
            warnings,
            file_rows: read.file_rows,
            // Told in the notes.
            doubled: 0,
        })
    }

    fn exposures(&self) -> Result<(), CompareError> {
        let bad = |s: &f64| !(s.is_finite() && *s > 0.0);
        match self.exposure_s.iter().flatten().position(bad) {
            Some(i) => {
                Err(CompareError::Exposure { path: self.path.clone(), row: self.file_rows[i] + 1 })
            }
            None => Ok(()),
        }
    }

    /// Keeps the channels of some names; all where none is given.
    ///
    /// # Errors
    /// A name that the curve has not, a channel that the station lacks.
    pub fn keep(&mut self, names: &[String], station: &Station) -> Result<(), CompareError> {
        let own: Vec<String> = self.channels.iter().map(|c| c.name.clone()).collect();
        if let Some(unknown) = names.iter().find(|name| !own.contains(name)) {
            return Err(CompareError::NoChannel {
                path: self.path.clone(),
                channel: unknown.clone(),
                has: own.join(", "),
            });
        }
        self.channels.retain(|c| names.is_empty() || names.contains(&c.name));
        if self.quantity != Quantity::Rate {
            return Ok(());
        }
        if let Some(lacking) = self.channels.iter().find(|c| station.channel(&c.name).is_none()) {
            let has: Vec<&str> = station.channels.iter().map(|c| c.name.as_str()).collect();
            return Err(CompareError::NotOfTheStation {
                path: self.path.clone(),
                channel: lacking.name.clone(),
                station: station.name.clone(),
                has: has.join(", "),
            });
        }
        Ok(())
    }
}

fn flux(magnitude: f64) -> f64 {
    10_f64.powf(-0.4 * magnitude)
}

/// The magnitude of a flux over that of magnitude 0; NaN of what is not above 0.
pub fn magnitude(flux: f64) -> f64 {
    if flux > 0.0 { -2.5 * flux.log10() } else { f64::NAN }
}

/// Returns the simulation's values by measured channel, samples × channels; NaN where it has no such channel.
fn by_channel(
    simulation: &Simulation<'_>,
    channels: &[MeasuredChannel],
    of: impl Fn(&ChannelSamples) -> &[f64],
) -> Array2<f64> {
    let mut values = Array2::from_elem((simulation.places.len(), channels.len()), f64::NAN);
    for (channel, mut column) in channels.iter().zip(values.columns_mut()) {
        let own = simulation.channels.iter().find(|c| c.name == channel.name);
        column.iter_mut().zip(own.map_or(&[][..], &of)).for_each(|(v, hz)| *v = *hz);
    }
    values
}

impl Quantity {
    /// Returns the simulated values of this quantity, samples × channels.
    pub fn of(self, simulation: &Simulation<'_>, channels: &[MeasuredChannel]) -> Array2<f64> {
        let n = simulation.places.len();
        match self {
            Quantity::Rate => by_channel(simulation, channels, |c| &c.rate_hz),
            Quantity::Flux(kind) => {
                let fluxes: Vec<f64> = simulated(kind, simulation).into_iter().map(flux).collect();
                Array2::from_shape_fn((n, 1), |(i, _)| fluxes[i])
            }
        }
    }

    /// The stated errors of that.
    pub fn errors(self, simulation: &Simulation<'_>, channels: &[MeasuredChannel]) -> Array2<f64> {
        let n = simulation.places.len();
        match self {
            Quantity::Rate => by_channel(simulation, channels, |c| &c.error_hz),
            Quantity::Flux(_) => {
                let fluxes = self.of(simulation, channels);
                let fainter = simulation.magnitude_errors.column(V);
                Array2::from_shape_fn((n, 1), |(i, _)| fluxes[[i, 0]] * (1.0 - flux(fainter[i])))
            }
        }
    }

    /// Half-widths of the 95 % intervals that the values have by the doubt of the materials, samples × channels.
    pub fn material(
        self,
        doubt: &MaterialDoubt,
        simulation: &Simulation<'_>,
        channels: &[MeasuredChannel],
    ) -> Array2<f64> {
        let n = simulation.places.len();
        match self {
            Quantity::Rate => {
                let own: Vec<Option<usize>> = channels
                    .iter()
                    .map(|c| simulation.channels.iter().position(|s| s.name == c.name))
                    .collect();
                Array2::from_shape_fn((n, channels.len()), |(i, c)| {
                    own[c].map_or(f64::NAN, |own| doubt.channels_hz[own][i])
                })
            }
            Quantity::Flux(_) => {
                let fluxes = self.of(simulation, channels);
                Array2::from_shape_fn((n, 1), |(i, _)| fluxes[[i, 0]] * doubt.v_relative[i])
            }
        }
    }

    /// Returns the unit for texts: Hz for rates, mag for magnitudes' fluxes.
    pub fn unit(self) -> &'static str {
        match self {
            Quantity::Rate => "Hz",
            Quantity::Flux(_) => "mag",
        }
    }
}
