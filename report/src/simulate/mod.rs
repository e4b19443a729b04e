//! Simulated passes: text, JSON, tables and figures.

pub mod active;
pub mod figure;

use crate::explain;
use crate::{Product, rounded};
use figure::Drawing;
use serde_json::{Value, json};
use std::fmt::Write as _;
use sunglint_ephemeris::orbit::Orbit;
use sunglint_formats::time::{format_utc, format_utc_shortest};
use sunglint_formats::{Column, EncodeError, ParseError, Table};
use sunglint_radiometry::air::Air;
use sunglint_radiometry::light_curve::tracks;
use sunglint_simulator::light::percent;
use sunglint_simulator::pass::{
    ChannelSamples, Cost, MaterialDoubt, Polarisation, Simulation, StandardMagnitude, StatedError,
};

/// The place of V among the bands.
const V: usize = 2;
const COMMAND: &str = "sunglint simulate";
/// Nothing fainter has been seen by any telescope.
const DARK_MAG: f64 = 32.0;

/// A simulation, and how it is to be shown.
#[derive(Debug, Clone)]
pub struct SimulationReport<'a> {
    /// The simulation.
    pub simulation: &'a Simulation<'a>,
    /// How far it may be off by the doubt of the materials; none where no material says how well it is known.
    pub material: Option<MaterialDoubt>,
    /// Polarisation of the light, where that was asked for.
    pub polarisation: Option<Polarisation>,
    /// Cost of the simulation.
    pub cost: Cost,
    /// Warnings that the user should read first.
    pub warnings: &'a [String],
}

/// Why the tables of a simulation cannot be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SimulationFilesError {
    /// A light curve that the schema does not hold.
    #[error(transparent)]
    Curve(#[from] ParseError),
    /// Images or tables that FITS does not hold.
    #[error(transparent)]
    Fits(#[from] EncodeError),
}

/// The highest rate of a channel, with its sample.
fn highest(channel: &ChannelSamples, hidden: impl Fn(usize) -> bool) -> Option<(usize, f64)> {
    let rates = channel.rate_hz.iter().copied().enumerate();
    let good = rates.filter(|(i, hz)| hz.is_finite() && *hz > 0.0 && !hidden(*i));
    good.max_by(|a, b| a.1.total_cmp(&b.1))
}

/// A stated error with documented keys.
fn stated(error: Option<StatedError>) -> Value {
    json!({ "median_relative": error.map(|e| rounded(e.median)), "largest_relative": error.map(|e| rounded(e.largest)) })
}

impl SimulationReport<'_> {
    fn title(&self) -> String {
        let pass = self.simulation.pass;
        format!("{} as {} from {}", pass.object(), pass.target.name, pass.station.name)
    }

    /// The light curve, with the geometry and the spectra beside it.
    ///
    /// # Errors
    /// Tables that their formats do not hold.
    pub fn product(&self) -> Result<Product, SimulationFilesError> {
        let simulation = self.simulation;
        let drawing = Drawing { simulation, title: self.title() };
        let name = |what: &str| {
            let good = |c: char| c.is_ascii_alphanumeric() || "-_".contains(c);
            format!("{}{what}", simulation.pass.name.replace(|c| !good(c), "_"))
        };
        let spectra = Product {
            name: name("_spectra"),
            fits: Some(simulation.spectral_light_curve(COMMAND).to_fits()?),
            figure: drawing.spectra(),
            ..Product::default()
        };
        let geometry =
            Product { name: name("_geometry"), table: self.geometry_table(), ..Product::default() };
        Ok(Product {
            name: name(""),
            table: simulation.light_curve(COMMAND).to_table()?,
            figure: drawing.curves(),
            fits: spectra.fits.clone(),
            json: self.json(),
            others: vec![geometry, spectra],
            ..Product::default()
        })
    }

    /// Geometry and magnitudes, with the doubt of the materials where there is one.
    fn geometry_table(&self) -> Table {
        let mut table = self.simulation.geometry_table(COMMAND);
        self.add_polarisation(&mut table);
        let Some(doubt) = &self.material else { return table };
        let channels = self.simulation.channels.iter().zip(&doubt.channels_hz);
        table.columns.extend(channels.map(|(channel, hz)| {
            Column::f64(format!("{}_material_hz", channel.name), Some("Hz"), hz.clone()).described(
                "half-width of the 95 % interval of the rate by the doubt of the materials",
            )
        }));
        let relative = Column::f64("material_relative", None, doubt.relative.clone());
        table.columns.push(relative.described(
            "the same over the rate, in the worst channel (in V where there is no channel)",
        ));
        table
    }

    fn add_polarisation(&self, table: &mut Table) {
        let Some(found) = &self.polarisation else { return };
        let mut add = |name: String, unit, values: &[f64], what| {
            table.columns.push(Column::f64(name, unit, values.to_vec()).described(what));
        };
        let degree = "degree of linear polarisation, 0 to 1";
        let error = "bound of the error of the degree; inf where no light may be left";
        add("v_polarisation".into(), None, &found.v, degree);
        add("v_polarisation_error".into(), None, &found.v_error, error);
        for (c, channel) in self.simulation.channels.iter().enumerate() {
            add(format!("{}_polarisation", channel.name), None, &found.channels[c], degree);
            let name = format!("{}_polarisation_error", channel.name);
            add(name, None, &found.channels_error[c], error);
        }
        let angle = "position angle of the electric field, from north through east (ICRS)";
        add("polarisation_angle_deg".into(), Some("deg"), &found.angle_deg, angle);
    }

    /// Least and largest degree in V over the visible samples with light, and the largest error.
    fn polarisation_in_v(&self) -> Option<[f64; 3]> {
        let found = self.polarisation.as_ref()?;
        let seen = |i: &usize| !self.simulation.places[*i].hidden && found.v[*i].is_finite();
        let rows: Vec<usize> = (0..found.v.len()).filter(seen).collect();
        let of = |values: &[f64], pick: fn(f64, f64) -> f64| {
            rows.iter().map(|i| values[*i]).reduce(pick)
        };
        Some([of(&found.v, f64::min)?, of(&found.v, f64::max)?, of(&found.v_error, f64::max)?])
    }

    /// Visible samples; in the Earth's shadow among them; below the horizon.
    fn numbers(&self) -> (usize, usize, usize) {
        let places = &self.simulation.places;
        let visible = places.iter().filter(|p| !p.hidden).count();
        let eclipsed = places.iter().filter(|p| !p.hidden && p.sunlit < 1.0).count();
        (visible, eclipsed, places.len() - visible)
    }

    /// Brightest and faintest of some magnitudes while visible: sample and magnitude.
    fn extremes(&self, magnitudes: &[f64]) -> Option<((usize, f64), (usize, f64))> {
        let hidden = |i: usize| self.simulation.places[i].hidden;
        let good = magnitudes.iter().copied().enumerate();
        let good: Vec<_> = good.filter(|(i, m)| m.is_finite() && !hidden(*i)).collect();
        let brightest = *good.iter().min_by(|a, b| a.1.total_cmp(&b.1))?;
        let faintest = *good.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
        Some((brightest, faintest))
    }

    fn time(&self, i: usize) -> String {
        format_utc(self.simulation.pass.times[i], 1)
    }

    /// The text.
    pub fn text(&self) -> String {
        let (simulation, pass) = (self.simulation, self.simulation.pass);
        let places = &simulation.places;
        let n = places.len();
        let mut text = format!("{}\n", self.title());
        let site = pass.station.site.geodetic();
        let _ = writeln!(
            text,
            "  station    {} ({:.4}°, {:.4}°, {} m)",
            pass.station.name, site.latitude_deg, site.longitude_deg, site.height_m
        );
        let air = pass.air.as_ref().map_or("none".into(), Air::describe);
        let _ = writeln!(text, "  air        {air}");
        let _ = writeln!(text, "  earth      {}", explain::earth(&pass.earth));
        let count = tracks(&pass.times).len();
        let tracks = if count > 1 { format!(" in {count} tracks") } else { String::new() };
        let _ = writeln!(
            text,
            "  samples    {n}{tracks}, {} to {}, {} s each",
            self.time(0),
            self.time(n - 1),
            pass.exposure_s[0]
        );
        let (visible, eclipsed, hidden) = self.numbers();
        let _ = writeln!(
            text,
            "  seen       {visible} above the horizon ({eclipsed} of them in the Earth's shadow or its edge), {hidden} hidden"
        );
        let by =
            |f: &dyn Fn(usize) -> f64| (0..n).max_by(|a, b| f(*a).total_cmp(&f(*b))).unwrap_or(0);
        let top = by(&|i| places[i].geometry.horizontal.altitude_deg());
        let nearest = by(&|i| -places[i].geometry.range_m);
        let _ = writeln!(
            text,
            "  highest    {:.2}° at {}; nearest {:.1} km; phase angle {:.1}° to {:.1}°",
            places[top].geometry.horizontal.altitude_deg(),
            self.time(top),
            places[nearest].geometry.range_m * 1e-3,
            self.phases().0,
            self.phases().1,
        );
        text.push('\n');
        text.push_str(&explain::short(&simulation.needs, pass.tolerance));
        text.push('\n');
        self.say_magnitudes(&mut text);
        self.say_channels(&mut text);
        self.say_cost(&mut text);
        text
    }

    fn phases(&self) -> (f64, f64) {
        let phases = self.simulation.places.iter().map(|p| p.geometry.phase_deg());
        phases.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), p| (a.min(p), b.max(p)))
    }

    fn say_magnitudes(&self, text: &mut String) {
        let simulation = self.simulation;
        let v = simulation.magnitudes.column(V).to_vec();
        let ground = simulation.ground_magnitudes.column(V).to_vec();
        let near = simulation.standard_magnitudes(StandardMagnitude::Range);
        let standard = simulation.standard_magnitudes(StandardMagnitude::IlluminatedFraction);
        let _ = writeln!(
            text,
            "  {:<44} {:>10}  {:<24} {:>9}",
            format!("V ({})", simulation.pass.zero),
            "brightest",
            "at (UTC)",
            "faintest"
        );
        for (what, magnitudes) in [
            ("above the air", v),
            ("after the air", ground),
            ("above the air, at 1,000 km", near),
            ("the same, by illuminated fraction to 90°", standard),
        ] {
            match self.extremes(&magnitudes) {
                Some(((i, bright), (_, faint))) => {
                    // The tail of a lobe may be hundreds of magnitudes fainter than anything in the sky.
                    let faint = if faint > DARK_MAG {
                        format!("> {DARK_MAG}")
                    } else {
                        format!("{faint:.3}")
                    };
                    let _ = writeln!(
                        text,
                        "    {what:<42} {bright:>10.3}  {:<24} {faint:>9}",
                        self.time(i)
                    );
                }
                None => {
                    let _ = writeln!(text, "    {what:<42} {:>10}", "no light");
                }
            }
        }
        text.push('\n');
    }

    fn say_channels(&self, text: &mut String) {
        let simulation = self.simulation;
        text.push_str("  channel      highest rate  at (UTC)                   of which the air left    S/N  saturated  stated error\n");
        for channel in &simulation.channels {
            let _ = write!(text, "  {:<10} ", channel.name);
            let Some((i, hz)) = highest(channel, |i| simulation.places[i].hidden) else {
                text.push_str("     no light\n");
                continue;
            };
            let noise = channel.predicted[i].sigma_hz.map(|sigma| hz / sigma);
            let saturated = channel.predicted.iter().filter(|p| p.saturated).count();
            let _ = writeln!(
                text,
                "{hz:>12.4e} Hz  {:<26} {:>21.1} % {:>6} {:>10} {:>13}",
                self.time(i),
                100.0 * hz / channel.above_air_hz[i],
                noise.map_or("-".into(), |r| format!("{r:.0}")),
                if saturated > 0 {
                    format!("{saturated} of {}", simulation.places.len())
                } else {
                    "no".into()
                },
                percent(channel.error_hz[i] / hz),
            );
        }
    }

    fn say_cost(&self, text: &mut String) {
        let cost = &self.cost;
        let stages: Vec<String> =
            cost.stages.iter().map(|(stage, s)| format!("{} {s:.3}", stage.name())).collect();
        let bounds = self.simulation.bounds;
        let _ = write!(
            text,
            "\ncost: {:.3} s on {} threads ({} s), {:.1} µs an epoch with {} bins and {} channels{}\nerror: ",
            cost.total_s,
            cost.threads,
            stages.join(", "),
            1e6 * cost.total_s / cost.epochs as f64,
            self.simulation.pass.bins(),
            self.simulation.channels.len(),
            self.sparse(),
        );
        if self.simulation.pass.air.is_some() {
            let _ = write!(
                text,
                "mean transmissions by their table at {} zenith angles to {:.1e}, a rate thereby to {:.1e} of itself; ",
                bounds.transmission_nodes, bounds.transmission, bounds.rate_relative
            );
        }
        text.push_str("wavelengths exactly, for tables that are linear between their points\n");
        self.say_stated(text);
        self.say_material(text);
        self.say_polarisation(text);
        text.push_str("not modelled:\n");
        for what in self.simulation.not_modelled() {
            let _ = writeln!(text, "  - {what}");
        }
    }

    /// Epochs at which indirect light was computed, where those are not all.
    fn sparse(&self) -> String {
        match (self.simulation.bounds.indirect_epochs, self.cost.epochs) {
            (some, all) if some < all => format!(
                "; light between surfaces and of the Earth computed at {some} of {all} epochs, interpolated between them (in the stated error)"
            ),
            _ => String::new(),
        }
    }

    /// Writes the stated error over the pass.
    fn say_stated(&self, text: &mut String) {
        let _ = writeln!(text, "promise: {}", self.simulation.promise().line());
        let simulation = self.simulation;
        let channels = simulation.channels.iter().filter_map(|c| simulation.stated_error(c));
        let over = |a: StatedError, b: StatedError| StatedError {
            median: a.median.max(b.median),
            largest: a.largest.max(b.largest),
        };
        match channels.reduce(over) {
            None => text.push_str("stated error: no sample has light\n"),
            Some(stated) => {
                let _ = writeln!(
                    text,
                    "stated error of rates (a bound; the worst channel): median {}, largest {} of a sample's own rate",
                    percent(stated.median),
                    percent(stated.largest)
                );
            }
        }
    }

    /// Says how far the doubt of the materials reaches.
    fn say_material(&self, text: &mut String) {
        let Some(doubt) = &self.material else { return };
        if let Some(over) = doubt.over_the_pass() {
            let _ = writeln!(
                text,
                "material: the doubt of {} changes a rate by {} in the median, {} at most (95 %; beside the stated error)",
                doubt.names(),
                percent(over.median),
                percent(over.largest)
            );
        }
    }

    fn say_polarisation(&self, text: &mut String) {
        let Some(found) = &self.polarisation else { return };
        match self.polarisation_in_v() {
            None => text.push_str("polarisation: no sample has light\n"),
            Some([least, most, error]) => {
                let _ = writeln!(
                    text,
                    "polarisation in V: {} to {}, known to {}, perpendicular to the plane of Sun, target and station",
                    percent(least),
                    percent(most),
                    percent(error)
                );
            }
        }
        if !found.unknown.is_empty() {
            let _ = writeln!(
                text,
                "  not known of {}: no refractive index (in the error, as if their light was polarised wholly)",
                found.unknown.join(", ")
            );
        }
    }

    fn json(&self) -> Value {
        let (simulation, pass) = (self.simulation, self.simulation.pass);
        let n = simulation.places.len();
        let site = pass.station.site.geodetic();
        let (visible, eclipsed, hidden) = self.numbers();
        let hidden_at = |i: usize| simulation.places[i].hidden;
        let channels: Vec<Value> = simulation
            .channels
            .iter()
            .map(|c| {
                let best = highest(c, hidden_at);
                let noise = best.and_then(|(i, hz)| Some(hz / c.predicted[i].sigma_hz?));
                json!({ "name": c.name, "highest_hz": best.map(|b| rounded(b.1)), "highest_utc": best.map(|b| self.time(b.0)),
                    "transmitted": best.map(|(i, hz)| rounded(hz / c.above_air_hz[i])), "signal_to_noise": noise.map(rounded),
                    "saturated_samples": c.predicted.iter().filter(|p| p.saturated).count(),
                    "uncovered_nm": c.uncovered_nm.iter().copied().fold(0.0, f64::max),
                    "stated_error": stated(simulation.stated_error(c)) })
            })
            .collect();
        let magnitude = |magnitudes: &[f64]| {
            let found = self.extremes(magnitudes);
            json!({ "brightest_mag": found.map(|((_, b), _)| rounded(b)), "brightest_utc": found.map(|((i, _), _)| self.time(i)),
                "faintest_mag": found.map(|(_, (_, f))| rounded(f)) })
        };
        let top = (0..n).max_by(|a, b| {
            let height = |i: usize| simulation.places[i].geometry.horizontal.altitude_deg();
            height(*a).total_cmp(&height(*b))
        });
        let ranges = simulation.places.iter().map(|p| p.geometry.range_m);
        let elements = match &pass.orbit {
            Orbit::Tle(orbit) => Some(format_utc_shortest(orbit.tle().epoch)),
            _ => None,
        };
        let parts: Vec<Value> = pass
            .target
            .parts
            .iter()
            .map(|p| json!({ "name": p.name, "material": pass.target.materials[p.material].name }))
            .collect();
        json!({
            "pass": pass.name,
            "orbit": { "name": pass.object(), "elements_epoch_utc": elements },
            "target": { "name": pass.target.name, "parts": parts, "material_spectra": simulation.weights.ncols() },
            "station": { "name": pass.station.name, "latitude_deg": site.latitude_deg, "longitude_deg": site.longitude_deg, "height_m": site.height_m },
            "air": { "description": pass.air.as_ref().map(Air::describe) },
            "earth": explain::earth_json(&pass.earth),
            "epochs": n, "from_utc": self.time(0), "to_utc": self.time(n - 1), "bins": pass.bins(),
            "quantity": pass.spectral.name(), "unit": pass.spectral.unit(),
            "visible_samples": visible, "eclipsed_samples": eclipsed, "hidden_samples": hidden,
            "highest_altitude_deg": top.map(|i| rounded(simulation.places[i].geometry.horizontal.altitude_deg())),
            "highest_altitude_utc": top.map(|i| self.time(i)),
            "nearest_range_m": rounded(ranges.fold(f64::INFINITY, f64::min)),
            "phase_from_deg": rounded(self.phases().0), "phase_to_deg": rounded(self.phases().1),
            "zero_point": pass.zero.to_string(),
            "v_above_air": magnitude(&simulation.magnitudes.column(V).to_vec()),
            "v_after_air": magnitude(&simulation.ground_magnitudes.column(V).to_vec()),
            "v_1000km": magnitude(&simulation.standard_magnitudes(StandardMagnitude::Range)),
            "v_standard": magnitude(&simulation.standard_magnitudes(StandardMagnitude::IlluminatedFraction)),
            "standard_law": StandardMagnitude::IlluminatedFraction.law(),
            "channels": channels,
            "cost": { "total_s": rounded(self.cost.total_s), "us_per_epoch": rounded(1e6 * self.cost.total_s / n as f64), "threads": self.cost.threads, "indirect_epochs": simulation.bounds.indirect_epochs,
                "stages": self.cost.stages.iter().map(|(s, t)| json!({ "stage": s.name(), "seconds": rounded(*t) })).collect::<Vec<_>>() },
            "error_bound": { "transmission": simulation.bounds.transmission, "transmission_nodes": simulation.bounds.transmission_nodes,
                "rate_relative": simulation.bounds.rate_relative, "light_relative": simulation.bounds.light_relative },
            "tolerance": pass.tolerance,
            "promise": simulation.promise(),
            "material_error": stated(self.material.as_ref().and_then(MaterialDoubt::over_the_pass)),
            "polarisation": self.polarisation.as_ref().map(|found| {
                let in_v = self.polarisation_in_v();
                let of = |i: usize| in_v.map(|v| rounded(v[i]));
                json!({ "v_least": of(0), "v_most": of(1), "v_error": of(2), "unknown": found.unknown })
            }),
            "needs": explain::json(&simulation.needs),
            "bins_stated_error": stated(simulation.stated_error_of_bins()),
            "not_modelled": simulation.not_modelled(),
            "warnings": self.warnings,
        })
    }
}
