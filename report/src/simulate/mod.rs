//! Simulated passes: text, JSON, tables and figures.

pub mod active;
pub mod figure;

use crate::explain;
use crate::{Format, Product, json_of, rounded};
use figure::Drawing;
use hifitime::Epoch;
use serde::Serialize;
use serde_json::Value;
use std::fmt::Write as _;
use sunglint_ephemeris::orbit::Orbit;
use sunglint_formats::time::{format_utc, format_utc_shortest};
use sunglint_formats::{Column, EncodeError, ParseError, Table};
use sunglint_radiometry::air::Air;
use sunglint_radiometry::light_curve::{SpectralLightCurve, tracks};
use sunglint_simulator::light::percent;
use sunglint_simulator::pass::{
    At, Bounds, ChannelTotals, Cost, Ends, HighestRate, Pass, Piece, Promise, StandardMagnitude,
    StatedError, Totals,
};

const COMMAND: &str = "sunglint simulate";
/// Nothing fainter has been seen by any telescope.
const DARK_MAG: f64 = 32.0;

/// A simulation as it is gathered, piece by piece.
#[derive(Debug, Clone)]
pub struct Gathered<'a> {
    /// Summary of all samples.
    pub totals: Totals<'a>,
    drawing: Drawing<'a>,
}

impl<'a> Gathered<'a> {
    /// Nothing of a pass yet.
    pub fn new(pass: &'a Pass) -> Self {
        Self { totals: Totals::new(pass), drawing: Drawing::new(pass) }
    }

    /// Takes the next piece in.
    pub fn add(&mut self, piece: &Piece<'_>) {
        self.totals.add(piece);
        self.drawing.add(piece.simulation);
    }
}

/// A simulation that is gathered, and how it is to be shown.
#[derive(Debug, Clone)]
pub struct SimulationReport<'a> {
    /// The simulation.
    pub gathered: &'a Gathered<'a>,
    /// Whether the polarisation was asked for.
    pub polarised: bool,
    /// Known errors of the simulation.
    pub bounds: Bounds,
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

/// Names of the products of a pass: the light curve, the geometry, the spectra.
pub fn names(pass: &Pass) -> [String; 3] {
    let good = |c: char| c.is_ascii_alphanumeric() || "-_".contains(c);
    let name = pass.name.replace(|c| !good(c), "_");
    ["", "_geometry", "_spectra"].map(|what| format!("{name}{what}"))
}

/// The light curve of a piece.
///
/// # Errors
/// A light curve that the schema does not hold.
pub fn rates(piece: &Piece<'_>) -> Result<Table, ParseError> {
    piece.simulation.light_curve(COMMAND).to_table()
}

/// The spectra of a piece.
pub fn spectra(piece: &Piece<'_>) -> SpectralLightCurve {
    piece.simulation.spectral_light_curve(COMMAND)
}

/// Geometry and magnitudes of a piece, with the doubt of the materials where there is one.
pub fn geometry(piece: &Piece<'_>) -> Table {
    let simulation = piece.simulation;
    let mut table = simulation.geometry_table(COMMAND);
    add_polarisation(piece, &mut table);
    let Some(doubt) = &piece.material else { return table };
    let channels = simulation.channels.iter().zip(&doubt.channels_hz);
    table.columns.extend(channels.map(|(channel, hz)| {
        Column::f64(format!("{}_material_hz", channel.name), Some("Hz"), hz.clone())
            .described("half-width of the 95 % interval of the rate by the doubt of the materials")
    }));
    let relative = Column::f64("material_relative", None, doubt.relative.clone());
    table.columns.push(relative.described(
        "the same over the rate, in the worst channel (in V where there is no channel)",
    ));
    table
}

fn add_polarisation(piece: &Piece<'_>, table: &mut Table) {
    let Some(found) = &piece.polarisation else { return };
    let mut add = |name: String, unit, values: &[f64], what| {
        table.columns.push(Column::f64(name, unit, values.to_vec()).described(what));
    };
    let degree = "degree of linear polarisation, 0 to 1";
    let error = "bound of the error of the degree; inf where no light may be left";
    add("v_polarisation".into(), None, &found.v, degree);
    add("v_polarisation_error".into(), None, &found.v_error, error);
    for (c, channel) in piece.simulation.channels.iter().enumerate() {
        add(format!("{}_polarisation", channel.name), None, &found.channels[c], degree);
        let name = format!("{}_polarisation_error", channel.name);
        add(name, None, &found.channels_error[c], error);
    }
    let angle = "position angle of the electric field, from north through east (ICRS)";
    for (channel, angles) in piece.simulation.channels.iter().zip(&found.channels_angle_deg) {
        add(format!("{}_polarisation_angle_deg", channel.name), Some("deg"), angles, angle);
    }
    add("polarisation_angle_deg".into(), Some("deg"), &found.angle_deg, angle);
}

fn utc(time: Epoch) -> String {
    format_utc(time, 1)
}

/// A stated error with documented keys.
#[derive(Serialize)]
struct StatedJson {
    median_relative: Option<f64>,
    largest_relative: Option<f64>,
}

fn stated(error: Option<StatedError>) -> StatedJson {
    StatedJson {
        median_relative: error.map(|e| rounded(e.median)),
        largest_relative: error.map(|e| rounded(e.largest)),
    }
}

#[derive(Serialize)]
struct OrbitJson<'a> {
    name: &'a str,
    elements_epoch_utc: Option<String>,
}

#[derive(Serialize)]
struct PartJson<'a> {
    name: &'a str,
    material: &'a str,
}

#[derive(Serialize)]
struct TargetJson<'a> {
    name: &'a str,
    parts: Vec<PartJson<'a>>,
    material_spectra: usize,
}

#[derive(Serialize)]
struct StationJson<'a> {
    name: &'a str,
    latitude_deg: f64,
    longitude_deg: f64,
    height_m: f64,
}

#[derive(Serialize)]
struct AirJson {
    description: Option<String>,
}

#[derive(Serialize)]
struct MagnitudeJson {
    brightest_mag: Option<f64>,
    brightest_utc: Option<String>,
    faintest_mag: Option<f64>,
}

fn magnitude(found: Option<&Ends>) -> MagnitudeJson {
    MagnitudeJson {
        brightest_mag: found.map(|e| rounded(e.brightest.value)),
        brightest_utc: found.map(|e| utc(e.brightest.time)),
        faintest_mag: found.map(|e| rounded(e.faintest.value)),
    }
}

#[derive(Serialize)]
struct ChannelJson<'a> {
    name: &'a str,
    highest_hz: Option<f64>,
    highest_utc: Option<String>,
    transmitted: Option<f64>,
    signal_to_noise: Option<f64>,
    saturated_samples: usize,
    uncovered_nm: f64,
    stated_error: StatedJson,
}

fn channel(c: &ChannelTotals) -> ChannelJson<'_> {
    let best = c.highest;
    let noise = best.and_then(|b| Some(b.rate_hz / b.sigma_hz?));
    ChannelJson {
        name: &c.name,
        highest_hz: best.map(|b| rounded(b.rate_hz)),
        highest_utc: best.map(|b| utc(b.time)),
        transmitted: best.map(|b| rounded(b.rate_hz / b.above_air_hz)),
        signal_to_noise: noise.map(rounded),
        saturated_samples: c.saturated,
        uncovered_nm: c.uncovered_nm,
        stated_error: stated(c.stated_error()),
    }
}

#[derive(Serialize)]
struct StageJson {
    stage: &'static str,
    seconds: f64,
}

#[derive(Serialize)]
struct CostJson {
    total_s: f64,
    us_per_epoch: f64,
    threads: usize,
    indirect_epochs: usize,
    stages: Vec<StageJson>,
}

#[derive(Serialize)]
struct ErrorBoundJson {
    transmission: f64,
    transmission_nodes: usize,
    rate_relative: f64,
    light_relative: f64,
}

#[derive(Serialize)]
struct PolarisationJson<'a> {
    v_least: Option<f64>,
    v_most: Option<f64>,
    v_error: Option<f64>,
    unknown: &'a [String],
}

#[derive(Serialize)]
struct Document<'a> {
    pass: &'a str,
    orbit: OrbitJson<'a>,
    target: TargetJson<'a>,
    station: StationJson<'a>,
    air: AirJson,
    earth: explain::EarthJson<'a>,
    epochs: usize,
    from_utc: String,
    to_utc: String,
    bins: usize,
    quantity: &'static str,
    unit: &'static str,
    visible_samples: usize,
    eclipsed_samples: usize,
    hidden_samples: usize,
    highest_altitude_deg: Option<f64>,
    highest_altitude_utc: Option<String>,
    nearest_range_m: f64,
    phase_from_deg: f64,
    phase_to_deg: f64,
    zero_point: String,
    v_above_air: MagnitudeJson,
    v_after_air: MagnitudeJson,
    v_1000km: MagnitudeJson,
    v_standard: MagnitudeJson,
    standard_law: &'static str,
    channels: Vec<ChannelJson<'a>>,
    cost: CostJson,
    error_bound: ErrorBoundJson,
    tolerance: f64,
    promise: Promise,
    material_error: StatedJson,
    polarisation: Option<PolarisationJson<'a>>,
    needs: Vec<explain::NeedJson<'a>>,
    bins_stated_error: StatedJson,
    not_modelled: Vec<String>,
    warnings: &'a [String],
}

impl SimulationReport<'_> {
    fn title(&self) -> String {
        let totals = &self.gathered.totals;
        format!(
            "{} as {} from {}",
            totals.object, totals.pass.target.name, totals.pass.station.name
        )
    }

    /// The figures and the summary; the light curve, with the geometry and the spectra beside it, is written while it is made ([`rates`], [`geometry`], [`spectra`]).
    pub fn product(&self) -> Product {
        let Gathered { totals, drawing } = self.gathered;
        let (title, [name, geometry, spectra]) = (self.title(), names(totals.pass));
        let spectra = Product {
            name: spectra,
            streamed: vec![Format::Fits],
            figure: drawing.spectra(&title),
            ..Product::default()
        };
        let geometry =
            Product { name: geometry, streamed: vec![Format::Ecsv], ..Product::default() };
        Product {
            name,
            streamed: vec![Format::Ecsv, Format::Csv, Format::Fits],
            figure: drawing.curves(&title),
            json: self.json(),
            others: vec![geometry, spectra],
            ..Product::default()
        }
    }

    /// The product with all its tables, of a pass that was simulated in one piece.
    ///
    /// # Errors
    /// Tables that their formats do not hold.
    pub fn whole_product(&self, piece: &Piece<'_>) -> Result<Product, SimulationFilesError> {
        let mut product = self.product();
        let fits = spectra(piece).to_fits()?;
        for part in std::iter::once(&mut product.streamed)
            .chain(product.others.iter_mut().map(|part| &mut part.streamed))
        {
            part.clear();
        }
        if let [beside, spectra] = &mut product.others[..] {
            beside.table = geometry(piece);
            spectra.fits = Some(fits.clone());
        }
        (product.table, product.fits) = (rates(piece)?, Some(fits));
        Ok(product)
    }

    /// The text.
    pub fn text(&self) -> String {
        let totals = &self.gathered.totals;
        let (pass, n) = (totals.pass, totals.samples);
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
            utc(pass.times[0]),
            utc(pass.times[n - 1]),
            pass.exposure_s[0]
        );
        let (visible, eclipsed) = (totals.visible, totals.eclipsed);
        let hidden = n - visible;
        let _ = writeln!(
            text,
            "  seen       {visible} above the horizon ({eclipsed} of them in the Earth's shadow or its edge), {hidden} hidden"
        );
        if let Some(top) = &totals.highest {
            let _ = writeln!(
                text,
                "  highest    {:.2}° at {}; nearest {:.1} km; phase angle {:.1}° to {:.1}°",
                top.altitude_deg,
                utc(top.time),
                totals.nearest_m * 1e-3,
                totals.phases_deg.0,
                totals.phases_deg.1,
            );
        }
        text.push('\n');
        text.push_str(&explain::short(&totals.needs, pass.tolerance));
        text.push('\n');
        self.say_magnitudes(&mut text);
        self.say_channels(&mut text);
        self.say_cost(&mut text);
        text
    }

    fn say_magnitudes(&self, text: &mut String) {
        let totals = &self.gathered.totals;
        let _ = writeln!(
            text,
            "  {:<44} {:>10}  {:<24} {:>9}",
            format!("V ({})", totals.pass.zero),
            "brightest",
            "at (UTC)",
            "faintest"
        );
        for (what, ends) in [
            ("above the air", &totals.v_above_air),
            ("after the air", &totals.v_after_air),
            ("above the air, at 1,000 km", &totals.v_1000km),
            ("the same, by illuminated fraction to 90°", &totals.v_standard),
        ] {
            match ends {
                Some(Ends { brightest, faintest: At { value: faint, .. } }) => {
                    // The tail of a lobe may be hundreds of magnitudes fainter than anything in the sky.
                    let faint = if *faint > DARK_MAG {
                        format!("> {DARK_MAG}")
                    } else {
                        format!("{faint:.3}")
                    };
                    let _ = writeln!(
                        text,
                        "    {what:<42} {:>10.3}  {:<24} {faint:>9}",
                        brightest.value,
                        utc(brightest.time)
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
        let totals = &self.gathered.totals;
        text.push_str("  channel      highest rate  at (UTC)                   of which the air left    S/N  saturated  stated error\n");
        for channel in &totals.channels {
            let _ = write!(text, "  {:<10} ", channel.name);
            let Some(HighestRate { rate_hz: hz, error_hz, above_air_hz, sigma_hz, time }) =
                channel.highest
            else {
                text.push_str("     no light\n");
                continue;
            };
            let noise = sigma_hz.map(|sigma| hz / sigma);
            let saturated = channel.saturated;
            let _ = writeln!(
                text,
                "{hz:>12.4e} Hz  {:<26} {:>21.1} % {:>6} {:>10} {:>13}",
                utc(time),
                100.0 * hz / above_air_hz,
                noise.map_or("-".into(), |r| format!("{r:.0}")),
                if saturated > 0 {
                    format!("{saturated} of {}", totals.samples)
                } else {
                    "no".into()
                },
                percent(error_hz / hz),
            );
        }
    }

    fn say_cost(&self, text: &mut String) {
        let cost = &self.cost;
        let stages: Vec<String> =
            cost.stages.iter().map(|(stage, s)| format!("{} {s:.3}", stage.name())).collect();
        let (bounds, totals) = (self.bounds, &self.gathered.totals);
        let _ = write!(
            text,
            "\ncost: {:.3} s on {} threads ({} s), {:.1} µs an epoch with {} bins and {} channels{}\nerror: ",
            cost.total_s,
            cost.threads,
            stages.join(", "),
            1e6 * cost.total_s / cost.epochs as f64,
            totals.pass.bins(),
            totals.channels.len(),
            self.sparse(),
        );
        if totals.pass.air.is_some() {
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
        for what in totals.not_modelled() {
            let _ = writeln!(text, "  - {what}");
        }
    }

    /// Epochs at which indirect light was computed, where those are not all.
    fn sparse(&self) -> String {
        match (self.bounds.indirect_epochs, self.cost.epochs) {
            (some, all) if some < all => format!(
                "; light between surfaces and of the Earth computed at {some} of {all} epochs, interpolated between them (in the stated error)"
            ),
            _ => String::new(),
        }
    }

    /// Writes the stated error over the pass.
    fn say_stated(&self, text: &mut String) {
        let _ = writeln!(text, "promise: {}", self.gathered.totals.promise().line());
        let totals = &self.gathered.totals;
        let channels = totals.channels.iter().filter_map(ChannelTotals::stated_error);
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
        let totals = &self.gathered.totals;
        if let Some(over) = totals.material_error() {
            let _ = writeln!(
                text,
                "material: the doubt of {} changes a rate by {} in the median, {} at most (95 %; beside the stated error)",
                totals.doubted,
                percent(over.median),
                percent(over.largest)
            );
        }
    }

    fn say_polarisation(&self, text: &mut String) {
        if !self.polarised {
            return;
        }
        let totals = &self.gathered.totals;
        match totals.polarisation_in_v {
            None => text.push_str("polarisation: no sample has light\n"),
            Some([least, most, error]) => {
                let _ = writeln!(
                    text,
                    "polarisation in V: {} to {}, known to {}; perpendicular to the plane of Sun, target and station but for light between surfaces",
                    percent(least),
                    percent(most),
                    percent(error)
                );
            }
        }
        if !totals.not_polarised.is_empty() {
            let _ = writeln!(
                text,
                "  not known of {}: no refractive index (in the error, as if their light was polarised wholly)",
                totals.not_polarised.join(", ")
            );
        }
    }

    fn json(&self) -> Value {
        let totals = &self.gathered.totals;
        let (pass, n) = (totals.pass, totals.samples);
        let site = pass.station.site.geodetic();
        let top = totals.highest;
        let elements_epoch_utc = match &pass.orbit {
            Orbit::Tle(orbit) => Some(format_utc_shortest(orbit.tle().epoch)),
            _ => None,
        };
        let target = &pass.target;
        let parts = target
            .parts
            .iter()
            .map(|p| PartJson { name: &p.name, material: &target.materials[p.material].name });
        let stages = self.cost.stages.iter();
        let polarisation = || {
            let in_v = totals.polarisation_in_v;
            let of = |i: usize| in_v.map(|v| rounded(v[i]));
            let [v_least, v_most, v_error] = [of(0), of(1), of(2)];
            PolarisationJson { v_least, v_most, v_error, unknown: &totals.not_polarised }
        };
        json_of(&Document {
            pass: &pass.name,
            orbit: OrbitJson { name: &totals.object, elements_epoch_utc },
            target: TargetJson {
                name: &target.name,
                parts: parts.collect(),
                material_spectra: totals.terms,
            },
            station: StationJson {
                name: &pass.station.name,
                latitude_deg: site.latitude_deg,
                longitude_deg: site.longitude_deg,
                height_m: site.height_m,
            },
            air: AirJson { description: pass.air.as_ref().map(Air::describe) },
            earth: explain::EarthJson::new(&pass.earth),
            epochs: n,
            from_utc: utc(pass.times[0]),
            to_utc: utc(pass.times[n - 1]),
            bins: pass.bins(),
            quantity: pass.spectral.name(),
            unit: pass.spectral.unit(),
            visible_samples: totals.visible,
            eclipsed_samples: totals.eclipsed,
            hidden_samples: n - totals.visible,
            highest_altitude_deg: top.map(|top| rounded(top.altitude_deg)),
            highest_altitude_utc: top.map(|top| utc(top.time)),
            nearest_range_m: rounded(totals.nearest_m),
            phase_from_deg: rounded(totals.phases_deg.0),
            phase_to_deg: rounded(totals.phases_deg.1),
            zero_point: pass.zero.to_string(),
            v_above_air: magnitude(totals.v_above_air.as_ref()),
            v_after_air: magnitude(totals.v_after_air.as_ref()),
            v_1000km: magnitude(totals.v_1000km.as_ref()),
            v_standard: magnitude(totals.v_standard.as_ref()),
            standard_law: StandardMagnitude::IlluminatedFraction.law(),
            channels: totals.channels.iter().map(channel).collect(),
            cost: CostJson {
                total_s: rounded(self.cost.total_s),
                us_per_epoch: rounded(1e6 * self.cost.total_s / n as f64),
                threads: self.cost.threads,
                indirect_epochs: self.bounds.indirect_epochs,
                stages: stages
                    .map(|(s, t)| StageJson { stage: s.name(), seconds: rounded(*t) })
                    .collect(),
            },
            error_bound: ErrorBoundJson {
                transmission: self.bounds.transmission,
                transmission_nodes: self.bounds.transmission_nodes,
                rate_relative: self.bounds.rate_relative,
                light_relative: self.bounds.light_relative,
            },
            tolerance: pass.tolerance,
            promise: totals.promise(),
            material_error: stated(totals.material_error()),
            polarisation: self.polarised.then(polarisation),
            needs: explain::json(&totals.needs),
            bins_stated_error: stated(totals.stated_error_of_bins()),
            not_modelled: totals.not_modelled(),
            warnings: self.warnings,
        })
    }
}
