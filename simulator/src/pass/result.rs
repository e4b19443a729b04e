//! The curves and tables of a simulation.

use super::{BANDS, Simulation, SpectralQuantity};
use sunglint_formats::time::format_utc_shortest;
use sunglint_formats::{Column, Table};
use sunglint_numerics::order::RunningMedian;
use sunglint_radiometry::light_curve::{
    ChannelCurve, Flags, LightCurve, Provenance, RateKind, Samples, SpectralLightCurve,
};

/// The distance of standard magnitudes, m.
const STANDARD_RANGE_M: f64 = 1e6;
/// The place of V in [`BANDS`].
const V: usize = 2;

/// Effect that no simulation holds by itself; [`Simulation::exposure_means`] does.
pub const WITHIN_AN_EXPOSURE: &str = "change within an exposure (values are those of its middle)";

/// Effects that no simulation holds, for whoever compares it with a measurement. They are not in the stated error.
const NEVER_MODELLED: [&str; 3] = [
    "scintillation, sky background",
    WITHIN_AN_EXPOSURE,
    "wavelengths that a material's tables do not cover (flag extrapolated)",
];

/// Summary of a simulation's stated error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StatedError {
    /// The median over the samples with light, of the value.
    pub median: f64,
    /// The largest.
    pub largest: f64,
}

impl StatedError {
    /// The summary of relative errors; `None` of none.
    pub(super) fn of(shares: &RunningMedian) -> Option<Self> {
        Some(Self { median: shares.median()?, largest: shares.largest()? })
    }
}

/// A magnitude brought to 1,000 km, by one law or another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StandardMagnitude {
    /// m − 5 lg(r/1,000 km), at the phase angle at which it was.
    Range,
    /// That, and at a phase angle of 90° by the illuminated fraction of a sphere: + 2.5 lg((1 + cos γ)/2 / ½), the law of the Mini-MegaTORTORA
    /// catalogue.
    IlluminatedFraction,
}

impl StandardMagnitude {
    /// The law in words.
    pub fn law(self) -> &'static str {
        match self {
            Self::Range => "1,000 km, at its own phase angle",
            Self::IlluminatedFraction => {
                "1,000 km, and by the illuminated fraction (1 + cos phase)/2 to 90 degrees"
            }
        }
    }

    /// A magnitude at a range (m) and a phase angle (radians), brought to the standard. At a phase angle of 180° nothing is illuminated: NaN.
    pub fn of(self, magnitude: f64, range_m: f64, phase_rad: f64) -> f64 {
        let near = magnitude - 5.0 * (range_m / STANDARD_RANGE_M).log10();
        match self {
            Self::Range => near,
            Self::IlluminatedFraction => {
                // (1 + cos γ)/2 = cos²(γ/2), without cancellation near 180°.
                let fraction = (0.5 * phase_rad).cos().powi(2);
                if fraction > 1e-30 { near + 2.5 * (2.0 * fraction).log10() } else { f64::NAN }
            }
        }
    }
}

/// Effects that are not in a simulation of these needs.
pub(super) fn not_modelled(needs: &[crate::light::Need]) -> Vec<String> {
    let missing = needs.iter().filter(|n| !n.is_modelled());
    let say = |need: &crate::light::Need| match need.bound {
        Some(bound) if bound > 0.0 => {
            Some(format!("{} (up to {:.1e}, in the stated error)", need.effect, bound))
        }
        _ => None,
    };
    let never = NEVER_MODELLED.iter().map(|s| (*s).to_owned());
    missing.filter_map(say).chain(never).collect()
}

impl Simulation<'_> {
    /// Returns the effects that are not in the simulation, for comparing it with a measurement: what this scene was not given, with the most that it could be, and
    /// what no simulation holds.
    pub fn not_modelled(&self) -> Vec<String> {
        not_modelled(&self.needs)
    }

    /// The flags that a sample has in every channel.
    pub fn flags(&self, i: usize) -> Flags {
        let place = &self.places[i];
        let mut flags = Flags::empty();
        flags.set(Flags::ECLIPSED, place.sunlit < 1.0);
        flags.set(Flags::HIDDEN, place.hidden);
        flags.set(Flags::FALLBACK, place.orientation.is_outside());
        flags.set(Flags::OVER_TOLERANCE, self.over_tolerance(i).is_some());
        flags
    }

    /// V magnitudes above the air, brought to a standard; NaN without light.
    pub fn standard_magnitudes(&self, standard: StandardMagnitude) -> Vec<f64> {
        let v = self.magnitudes.column(V);
        let places = self.places.iter().zip(v);
        places.map(|(p, m)| standard.of(*m, p.geometry.range_m, p.geometry.phase_rad)).collect()
    }

    fn samples(&self) -> Samples {
        let of = |f: &dyn Fn(&super::Place) -> f64| Some(self.places.iter().map(f).collect());
        Samples {
            time: self.pass.times.clone(),
            exposure_s: self.pass.exposure_s.clone(),
            range_m: of(&|p| p.geometry.range_m),
            phase_deg: of(&|p| p.geometry.phase_deg()),
            zenith_deg: of(&|p| p.geometry.zenith_deg()),
        }
    }

    /// Where it comes from, for tables that are made of it.
    pub fn provenance(&self, command: &str) -> Provenance {
        let pass = self.pass;
        let mut notes = pass.notes.clone();
        notes.push(format!(
            "sunlight: {}, scaled by 1/d²; attitude: {}",
            pass.sun_name,
            if pass.attitude_given {
                "as the file says"
            } else {
                "inertial, axes along the GCRS's"
            }
        ));
        notes.push("sigma: one exposure at the typical kappa: photons, dark counts and dead time of counters, photons alone of camera planes; no scintillation".into());
        notes.push(format!("not modelled: {}", self.not_modelled().join("; ")));
        notes.push("model_error: how far a value may be off by what is not modelled, and by the engine's and the tables' own errors; a bound, not a standard deviation".into());
        notes.push(format!("magnitudes count from {}", pass.zero));
        Provenance {
            program: concat!("sunglint ", env!("CARGO_PKG_VERSION")).into(),
            command: command.into(),
            station: pass.station.name.clone(),
            target: format!("{} as {}", self.object, pass.target.name),
            inputs: pass.inputs.clone(),
            notes,
            ..Provenance::default()
        }
    }

    /// The channels' rates as a predicted light curve of the schema. `command` says what made it.
    pub fn light_curve(&self, command: &str) -> LightCurve {
        let channels = self.channels.iter().map(|channel| {
            let flags = (0..self.places.len()).map(|i| {
                let mut flags = self.flags(i);
                flags.set(Flags::SATURATED, channel.predicted[i].saturated);
                flags.set(Flags::EXTRAPOLATED, channel.uncovered_nm[i] > 0.0);
                flags
            });
            let sigma =
                |p: &sunglint_radiometry::station::Predicted| p.sigma_hz.unwrap_or(f64::NAN);
            ChannelCurve {
                name: channel.name.clone(),
                rate_hz: channel.rate_hz.clone(),
                sigma_hz: channel.predicted.iter().map(sigma).collect(),
                flags: flags.collect(),
                model_error_hz: Some(channel.error_hz.clone()),
                common_sigma_hz: None,
            }
        });
        LightCurve {
            kind: RateKind::Predicted,
            samples: self.samples(),
            channels: channels.collect(),
            provenance: self.provenance(command),
            other: Default::default(),
        }
    }

    /// The spectra as a spectral light curve.
    pub fn spectral_light_curve(&self, command: &str) -> SpectralLightCurve {
        let flags = (0..self.places.len()).map(|i| {
            let mut flags = self.flags(i);
            flags.set(Flags::EXTRAPOLATED, self.spectra_uncovered[i]);
            flags
        });
        SpectralLightCurve {
            quantity: self.pass.spectral.name().into(),
            unit: self.pass.spectral.unit().into(),
            samples: self.samples(),
            edges_nm: self.pass.edges_nm.clone(),
            values: self.spectra.clone(),
            model_errors: Some(self.spectra_errors.clone()),
            flags: flags.collect(),
            provenance: self.provenance(command),
        }
    }

    /// Places, directions and magnitudes, a row an epoch.
    pub fn geometry_table(&self, command: &str) -> Table {
        let mut table = Table::default();
        let mut meta = |key: &str, value| table.meta.insert(key.into(), value);
        meta("title", format!("{}: geometry and magnitudes", self.pass.name).into());
        meta("provenance", self.provenance(command).to_json());
        meta("tolerance", self.pass.tolerance.into());
        meta("zero_point", self.pass.zero.to_string().into());
        let of = |f: &dyn Fn(&super::Place) -> f64| self.places.iter().map(f).collect::<Vec<f64>>();
        let number = |name: &str, unit: Option<&str>, what: &str, values: Vec<f64>| {
            Column::f64(name, unit, values).described(what)
        };
        let deg = Some("deg");
        let time = self.pass.times.iter().map(|t| format_utc_shortest(*t)).collect();
        let flags = (0..self.places.len()).map(|i| i64::from(self.flags(i).bits())).collect();
        table.columns = vec![
            Column::text("time_utc", time),
            number(
                "azimuth_deg",
                deg,
                "at the station, from north by east",
                of(&|p| p.geometry.horizontal.azimuth_deg()),
            ),
            number(
                "altitude_deg",
                deg,
                "true (unrefracted)",
                of(&|p| p.geometry.horizontal.altitude_deg()),
            ),
            number(
                "apparent_zenith_deg",
                deg,
                "refracted; nan below the horizon",
                of(&|p| p.apparent_zenith_deg.unwrap_or(f64::NAN)),
            ),
            number("range_m", Some("m"), "from the station", of(&|p| p.geometry.range_m)),
            number("phase_deg", deg, "Sun-target-station", of(&|p| p.geometry.phase_deg())),
            number(
                "sunlit",
                None,
                "visible part of the Sun's disc at the target",
                of(&|p| p.sunlit),
            ),
            number("sun_altitude_deg", deg, "true, at the station", of(&|p| p.sun_altitude_deg)),
            number(
                "sun_distance_au",
                Some("AU"),
                "from the target",
                of(&|p| p.geometry.sun.distance_au()),
            ),
        ];
        for (name, what, vector) in [
            (
                "sun_body",
                "unit vector to the Sun, body axes",
                &(|p: &super::Place| p.sun_body) as &dyn Fn(&super::Place) -> glam::DVec3,
            ),
            ("observer_body", "unit vector to the station, body axes", &|p| p.observer_body),
        ] {
            for (axis, pick) in ["x", "y", "z"].into_iter().enumerate() {
                let values = self.places.iter().map(|p| vector(p)[axis]).collect();
                table.columns.push(number(&format!("{name}_{pick}"), None, what, values));
            }
        }
        let stated = |i: usize| self.stated_relative(i).unwrap_or(f64::NAN);
        table.columns.push(number(
            "stated_error_relative",
            None,
            "of the rate in the worst channel; nan without light",
            (0..self.places.len()).map(stated).collect(),
        ));
        for (h, hinge) in self.pass.target.hinges.iter().enumerate() {
            let values = self.hinges_deg.column(h).to_vec();
            table.columns.push(number(
                &format!("hinge_{}_deg", hinge.name),
                deg,
                "angle of the hinge",
                values,
            ));
        }
        for (b, band) in BANDS.iter().enumerate() {
            let band = band.to_lowercase();
            table.columns.push(number(
                &format!("{band}_mag"),
                Some("mag"),
                "above the air; nan without light",
                self.magnitudes.column(b).to_vec(),
            ));
            table.columns.push(number(
                &format!("{band}_ground_mag"),
                Some("mag"),
                "after the air",
                self.ground_magnitudes.column(b).to_vec(),
            ));
            table.columns.push(number(
                &format!("{band}_model_error_mag"),
                Some("mag"),
                "by how much fainter it may be; inf where no light may be left",
                self.magnitude_errors.column(b).to_vec(),
            ));
        }
        for (name, standard) in [
            ("v_1000km_mag", StandardMagnitude::Range),
            ("v_standard_mag", StandardMagnitude::IlluminatedFraction),
        ] {
            let what = format!("V above the air at {}", standard.law());
            table.columns.push(number(
                name,
                Some("mag"),
                &what,
                self.standard_magnitudes(standard),
            ));
        }
        table.columns.push(Column::i64("flags", None, flags));
        table.meta.insert("flag_bits".into(), sunglint_formats::flag_bits::bit_names::<Flags>());
        table
    }

    /// Mean over the visible, sunlit epochs that the spectra are shown with: whether there is any light at all.
    pub fn has_light(&self) -> bool {
        self.spectra.iter().any(|v| *v > 0.0)
    }

    /// Which quantity the spectra are.
    pub fn spectral(&self) -> SpectralQuantity {
        self.pass.spectral
    }
}
