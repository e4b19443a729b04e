//! Laser returns along a pass: text, JSON, tables, figures.

mod figure;
mod range_data;

pub use range_data::{Content, RangeData, RangeDataError, range_file};

use crate::{Product, json_of, rounded};
use ndarray::Array2;
use serde::Serialize;
use serde_json::Value;
use std::fmt::Write as _;
use sunglint_formats::fits::{Header, Image, Pixels, Writer};
use sunglint_formats::time::{format_utc, format_utc_shortest};
use sunglint_formats::{Column, EncodeError, Table};
use sunglint_radiometry::constants::LIGHT_M_PER_S;
use sunglint_radiometry::station::BeamShape;
use sunglint_simulator::pass::Simulation;
use sunglint_simulator::ranging::{ALTITUDES_KM, Returns, SATURATED};

/// The lasers' returns along a pass.
#[derive(Debug, Clone, Copy)]
pub struct ActiveReport<'a> {
    /// The pass by sunlight.
    pub simulation: &'a Simulation<'a>,
    /// The returns of each laser.
    pub returns: &'a [Returns<'a>],
}

#[derive(Serialize)]
struct BouncesJson {
    traced: bool,
    bound: Option<f64>,
    largest_share: f64,
}

#[derive(Serialize)]
struct BestJson {
    time_utc: Option<String>,
    range_m: Option<f64>,
    photons_per_shot: Option<f64>,
    bounced_photons_per_shot: Option<f64>,
    bounced_error: Option<f64>,
    retro_photons_per_shot: Option<f64>,
    cross_section_m2: Option<f64>,
    aberration_rad: Option<f64>,
    speckles: Option<f64>,
    detection_probability: Option<f64>,
    rate_hz: Option<f64>,
    passive_rate_hz: Option<f64>,
    transmission: Option<f64>,
    spot_radius_m: Option<f64>,
    mean_offset_m: Option<f64>,
    first_photon_offset_m: Option<f64>,
    sun_ratio: Option<f64>,
    earth_ratio: Option<f64>,
}

#[derive(Serialize)]
struct AltitudeJson {
    altitude_km: f64,
    sun_ratio: f64,
    earth_ratio: f64,
}

#[derive(Serialize)]
struct LaserJson<'a> {
    laser: &'a str,
    wavelength_nm: f64,
    beam: &'static str,
    receiver: &'a str,
    counts_per_photon: f64,
    repetition_rate_hz: f64,
    apart: bool,
    cubes: usize,
    bounces: BouncesJson,
    best: BestJson,
    saturated_samples: usize,
    by_altitude: Vec<AltitudeJson>,
}

#[derive(Serialize)]
struct Document<'a> {
    lasers: Vec<LaserJson<'a>>,
}

/// The beam's model in words.
fn shape(beam: BeamShape) -> &'static str {
    match beam {
        BeamShape::TopHat => "top hat: the same within the radius, nothing beyond",
        BeamShape::Gaussian => "Gaussian, the radius at 1/e² of its middle",
    }
}

/// Returns the treatment of light that the body scatters more than once.
fn bounces(r: &Returns<'_>) -> String {
    let why = &r.need.why;
    if r.need.needed {
        let percent = 100.0 * r.most_bounced();
        format!("{why}: up to {percent:.2} % of the photons, by half of their whole way")
    } else {
        match r.need.bound {
            Some(bound) if bound > 0.0 => {
                format!("left out, at most {:.2} %: {why}", 100.0 * bound)
            }
            Some(_) => format!("none: {why}"),
            None => format!("left out: {why}"),
        }
    }
}

fn finite_range(values: &[f64]) -> Option<(f64, f64)> {
    let good = values.iter().copied().filter(|v| v.is_finite());
    let ends = good.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    (ends.0 <= ends.1).then_some(ends)
}

impl ActiveReport<'_> {
    fn channel(&self, returns: &Returns<'_>) -> &str {
        &self.simulation.channels[returns.channel].name
    }

    /// Corner cubes of the target, in words.
    fn cubes(&self) -> String {
        match self.simulation.pass.target.retros.cubes.len() {
            0 => "corner cubes: the target has none".into(),
            n => format!(
                "corner cubes: {n}; none hides another, and the body hides none; the polarisation is averaged"
            ),
        }
    }

    /// The text.
    pub fn text(&self) -> String {
        let mut text = String::from("\nlaser returns, per shot and in the mean\n");
        let _ = writeln!(text, "  {}", self.cubes());
        for r in self.returns {
            self.say(&mut text, r);
        }
        text
    }

    fn say(&self, text: &mut String, r: &Returns<'_>) {
        let l = r.laser;
        let _ = writeln!(
            text,
            "  {}: {} nm, {} mJ, {:.3} ns, {} Hz, line {} nm, divergence {}″",
            l.name,
            l.wavelength_nm,
            rounded(l.pulse_energy_j * 1e3),
            l.pulse_length_s * 1e9,
            l.repetition_rate_hz,
            l.linewidth_nm,
            l.divergence_arcsec
        );
        let channel = self.channel(r);
        let _ = writeln!(text, "    beam       {}; aimed at the body's origin", shape(l.beam));
        let _ = writeln!(
            text,
            "    receiver   {channel}: {:.3e} counts per photon at the telescope",
            r.efficiency
        );
        if let (Some(spot), Some(air)) = (finite_range(&r.spot_m), finite_range(&r.transmission)) {
            let _ = writeln!(
                text,
                "    spot       radius {:.2} to {:.2} m; air, one way {:.3} to {:.3}",
                spot.0, spot.1, air.0, air.1
            );
        }
        if let Some(apart) = r.apart_deg.as_deref().and_then(finite_range) {
            let _ = writeln!(
                text,
                "    apart      laser and telescope stand {:.2}° to {:.2}° apart as the target sees them",
                apart.0, apart.1
            );
        }
        let _ = writeln!(text, "    bounces    {}", bounces(r));
        let Some(best) = r.best() else {
            text.push_str("    nothing comes back\n");
            return;
        };
        let time = format_utc(self.simulation.pass.times[best], 1);
        let _ = writeln!(
            text,
            "    most       {:.3e} photons per shot at {time}: detection {:.4} of shots, {:.4e} Hz in the mean; sunlight {:.4e} Hz",
            r.photons[best], r.probability[best], r.rate_hz[best], r.passive_hz[best]
        );
        if r.cross_section_m2[best] > 0.0 {
            let _ = writeln!(
                text,
                "    cubes      {:.3} Mm² at {:.1} µrad of velocity aberration: {:.3e} of these photons; {:.2} cells of speckle",
                1e-6 * r.cross_section_m2[best],
                1e6 * r.aberration_rad[best],
                r.retro[best],
                r.speckles[best]
            );
        }
        let _ = writeln!(
            text,
            "    range      mean return {:+.4} m, first photon {:+.4} m against the body's origin at that time",
            r.mean_m[best], r.first_m[best]
        );
        let _ = writeln!(
            text,
            "    saturated  in {} of {} samples: more than {SATURATED:.1} photons per shot, 95 % of shots detected; whoever stops at the first photon sees the near side there",
            r.saturated(),
            r.photons.len()
        );
        if let (Some(sun), Some(earth)) = (finite_range(&r.sun_ratio), finite_range(&r.earth_ratio))
        {
            let _ = writeln!(
                text,
                "    over laser light within a pulse and its line, at the target: sunlight {:.2e} to {:.2e}, earthshine {:.2e} to {:.2e}",
                sun.0, sun.1, earth.0, earth.1
            );
        }
        let _ = writeln!(
            text,
            "    the same by altitude, in the zenith, Earth below a Sun in the zenith:"
        );
        let _ = writeln!(text, "      {:>10} {:>10} {:>10}", "km", "Sun", "Earth");
        for (km, (sun, earth)) in ALTITUDES_KM.iter().zip(&r.by_altitude) {
            let _ = writeln!(text, "      {km:>10} {sun:>10.2e} {earth:>10.2e}");
        }
    }

    /// Summary with its documented keys.
    pub fn json(&self) -> Value {
        let lasers = self.returns.iter().map(|r| {
            let l = r.laser;
            let best = r.best();
            let at = |values: &[f64]| best.map(|i| rounded(values[i]));
            let altitude = |(km, (sun, earth)): (&f64, &(f64, f64))| AltitudeJson {
                altitude_km: *km,
                sun_ratio: rounded(*sun),
                earth_ratio: rounded(*earth),
            };
            LaserJson {
                laser: &l.name,
                wavelength_nm: l.wavelength_nm,
                beam: match l.beam {
                    BeamShape::TopHat => "top_hat",
                    BeamShape::Gaussian => "gaussian",
                },
                receiver: self.channel(r),
                counts_per_photon: rounded(r.efficiency),
                repetition_rate_hz: l.repetition_rate_hz,
                apart: l.site.is_some(),
                cubes: self.simulation.pass.target.retros.cubes.len(),
                bounces: BouncesJson {
                    traced: r.need.needed,
                    bound: r.need.bound.map(rounded),
                    largest_share: rounded(r.most_bounced()),
                },
                best: BestJson {
                    time_utc: best.map(|i| format_utc_shortest(self.simulation.pass.times[i])),
                    range_m: best.map(|i| rounded(self.simulation.places[i].geometry.range_m)),
                    photons_per_shot: at(&r.photons),
                    bounced_photons_per_shot: at(&r.bounced),
                    bounced_error: at(&r.bounced_error),
                    retro_photons_per_shot: at(&r.retro),
                    cross_section_m2: at(&r.cross_section_m2),
                    aberration_rad: at(&r.aberration_rad),
                    speckles: at(&r.speckles),
                    detection_probability: at(&r.probability),
                    rate_hz: at(&r.rate_hz),
                    passive_rate_hz: at(&r.passive_hz),
                    transmission: at(&r.transmission),
                    spot_radius_m: at(&r.spot_m),
                    mean_offset_m: at(&r.mean_m),
                    first_photon_offset_m: at(&r.first_m),
                    sun_ratio: at(&r.sun_ratio),
                    earth_ratio: at(&r.earth_ratio),
                },
                saturated_samples: r.saturated(),
                by_altitude: ALTITUDES_KM.iter().zip(&r.by_altitude).map(altitude).collect(),
            }
        });
        json_of(&Document { lasers: lasers.collect() })
    }

    /// Tables, images and figures; `name` is that of the pass.
    ///
    /// # Errors
    /// Images or tables that FITS does not hold.
    pub fn product(&self, name: &str) -> Result<Product, EncodeError> {
        let title = format!(
            "{} as {} from {}: laser returns",
            self.simulation.pass.object(),
            self.simulation.pass.target.name,
            self.simulation.pass.station.name
        );
        let fits = self.fits()?;
        let histogram = Product {
            name: format!("{name}_ranging"),
            fits: Some(fits.clone()),
            figure: figure::ranging(self.simulation, self.returns, &title),
            ..Product::default()
        };
        let depth = Product {
            name: format!("{name}_depth"),
            table: self.depth_table(&title),
            ..Product::default()
        };
        Ok(Product {
            name: format!("{name}_active"),
            table: self.table(&title),
            figure: figure::curves(self.simulation, self.returns, &title),
            fits: Some(fits),
            others: vec![histogram, depth],
            ..Product::default()
        })
    }

    fn head(&self, title: &str) -> Table {
        let mut table = Table::default();
        table.meta.insert("title".into(), title.into());
        let provenance = self.simulation.provenance("sunglint simulate --active").to_json();
        table.meta.insert("provenance".into(), provenance);
        let beam = |r: &Returns<'_>| {
            format!("{}: beam {}; receiver {}", r.laser.name, shape(r.laser.beam), self.channel(r))
                .replace('²', "^2")
        };
        let mut notes: Vec<String> = self.returns.iter().map(beam).collect();
        notes.extend(
            self.returns.iter().map(|r| format!("{}: bounces: {}", r.laser.name, bounces(r))),
        );
        notes.push(self.cubes());
        table.meta.insert("comments".into(), notes.into());
        table
    }

    /// One row a sample.
    fn table(&self, title: &str) -> Table {
        let mut table = self.head(title);
        let places = &self.simulation.places;
        let times = self.simulation.pass.times.iter().map(|t| format_utc_shortest(*t)).collect();
        let number = |name: String, unit, what: &str, values: &[f64]| {
            Column::f64(name, unit, values.to_vec()).described(what)
        };
        let ranges: Vec<f64> = places.iter().map(|p| p.geometry.range_m).collect();
        let zenith: Vec<f64> = places.iter().map(|p| p.geometry.zenith_deg()).collect();
        table.columns = vec![
            Column::text("time_utc", times),
            number("range_m".into(), Some("m"), "from the station", &ranges),
            number("zenith_deg".into(), Some("deg"), "true", &zenith),
        ];
        for r in self.returns {
            let name = |what: &str| format!("{}_{what}", r.laser.name.replace('-', "_"));
            let sums: Vec<f64> = r.rate_hz.iter().zip(&r.passive_hz).map(|(a, b)| a + b).collect();
            table.columns.extend([
                number(
                    name("photons_per_shot"),
                    None,
                    "mean, detected; nan while hidden",
                    &r.photons,
                ),
                number(
                    name("bounced_photons"),
                    None,
                    "of them, scattered more than once",
                    &r.bounced,
                ),
                number(
                    name("bounced_error"),
                    None,
                    "what these may be off by, as claimed",
                    &r.bounced_error,
                ),
                number(
                    name("detection_probability"),
                    None,
                    "of at least one photon of a shot",
                    &r.probability,
                ),
                number(name("rate_hz"), Some("Hz"), "mean over pulses and pauses", &r.rate_hz),
                number(
                    name("passive_rate_hz"),
                    Some("Hz"),
                    "of the receiver from sunlight, without dark counts",
                    &r.passive_hz,
                ),
                number(name("total_rate_hz"), Some("Hz"), "both", &sums),
                number(
                    name("transmission"),
                    None,
                    "of the air, one way, to the telescope",
                    &r.transmission,
                ),
                number(name("spot_radius_m"), Some("m"), "at the target", &r.spot_m),
                number(
                    name("mean_offset_m"),
                    Some("m"),
                    "mean distance of returned photons beyond the body's origin",
                    &r.mean_m,
                ),
                number(
                    name("first_photon_offset_m"),
                    Some("m"),
                    "the same of the first photon of a shot",
                    &r.first_m,
                ),
                number(
                    name("sun_ratio"),
                    None,
                    "sunlight over laser light at the target, within pulse and line",
                    &r.sun_ratio,
                ),
                number(
                    name("earth_ratio"),
                    None,
                    "earthshine on a facet that faces the Earth over the same",
                    &r.earth_ratio,
                ),
            ]);
            if !self.simulation.pass.target.retros.cubes.is_empty() {
                let urad: Vec<f64> = r.aberration_rad.iter().map(|a| 1e6 * a).collect();
                table.columns.extend([
                    number(name("retro_photons"), None, "of them, from corner cubes", &r.retro),
                    number(
                        name("cross_section_m2"),
                        Some("m2"),
                        "of the corner cubes towards the telescope",
                        &r.cross_section_m2,
                    ),
                    number(
                        name("aberration_urad"),
                        Some("urad"),
                        "2v/c across the line of sight",
                        &urad,
                    ),
                    number(
                        name("speckles"),
                        None,
                        "cells of speckle that share the telescope",
                        &r.speckles,
                    ),
                ]);
            }
            if let Some(apart) = &r.apart_deg {
                table.columns.extend([
                    number(name("apart_deg"), Some("deg"), "laser, target, telescope", apart),
                    number(name("up_transmission"), None, "of the air, from the laser", &r.up),
                ]);
            }
        }
        table
    }

    /// One row a bin: sums over all samples.
    fn depth_table(&self, title: &str) -> Table {
        let mut table = self.head(&format!("{title}, summed over the samples"));
        let Some(first) = self.returns.first() else { return table };
        let middles: Vec<f64> = (0..first.bins.count).map(|k| first.middle_m(k)).collect();
        let delays: Vec<f64> = middles.iter().map(|m| 2e9 * m / LIGHT_M_PER_S).collect();
        table.columns = vec![
            Column::f64("offset_m", Some("m"), middles)
                .described("range beyond the body's origin, middle of the bin"),
            Column::f64("delay_ns", Some("ns"), delays).described("there and back"),
        ];
        for (k, r) in self.returns.iter().enumerate() {
            let name = |what: &str| format!("{}_{what}", r.laser.name.replace('-', "_"));
            let [photons, first_photons, area] = r.summed();
            if k == 0 {
                let area = Column::f64("true_depth_m2", Some("m2"), area);
                table.columns.push(area.described("area that is seen, across the line of sight"));
            }
            table.columns.extend([
                Column::f64(name("photons"), None, photons).described("one shot a sample"),
                Column::f64(name("first_photons"), None, first_photons)
                    .described("the first of each shot"),
            ]);
        }
        table
    }

    /// The range histograms: an image a laser, time along the first axis.
    fn fits(&self) -> Result<Vec<u8>, EncodeError> {
        let mut writer = Writer::new();
        for r in self.returns {
            let mut header = Header::default();
            header.set("EXTNAME", format!("RANGE_{}", r.laser.name.to_uppercase()), "");
            header.set("BUNIT", "ph", "detected photons per shot in a bin");
            header.set("WAVELEN", r.laser.wavelength_nm, "nm, vacuum");
            header.set("CTYPE1", "SAMPLE", "times: see the table TIMES");
            header.set("CTYPE2", "OFFSET", "range beyond the body's origin");
            header.set("CUNIT2", "m", "");
            header.set("CRPIX2", 1.0, "");
            header.set("CRVAL2", r.middle_m(0), "");
            header.set("CDELT2", r.bins.step_m, "");
            let values = Array2::from_shape_fn((r.bins.count, r.profiles.len()), |(bin, i)| {
                r.profiles[i].as_ref().map_or(f64::NAN, |p| p.photons[bin])
            });
            writer.image(&Image { header, pixels: Pixels::F64(values.into_dyn()) })?;
        }
        let times = self.simulation.pass.times.iter().map(|t| format_utc_shortest(*t)).collect();
        let table = Table { columns: vec![Column::text("time_utc", times)], ..Table::default() };
        writer.table(&table, "TIMES")?;
        Ok(writer.into_bytes())
    }
}
