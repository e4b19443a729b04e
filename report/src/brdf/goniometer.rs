//! A goniometer's run, and the values of its folder: text, summary, figure.

use crate::Product;
use crate::plot::{Axis, Figure, Panel, Series};
use serde::Serialize;
use std::fmt::Write as _;
use sunglint_formats::EncodeError;
use sunglint_formats::text::counted;
use sunglint_materials::goniometer::reduce::{Instrument, Reduced};
use sunglint_materials::samples::direction;
use sunglint_radiometry::light_curve::Input;

/// A run that ended.
#[derive(Debug, Clone, Serialize)]
pub struct RunSummary {
    /// The run's folder.
    pub run: String,
    /// Directions that the bench reaches.
    pub directions: usize,
    /// Directions that are measured.
    pub measured: usize,
    /// Directions of the plan that it does not reach.
    pub unreachable: usize,
    /// Measurements in all, the instrument's among them.
    pub measurements: usize,
    /// Readings of the meter.
    pub readings: usize,
    /// Time that this part of the run took, s.
    pub took_s: f64,
    /// Time that the whole run was expected to take, s.
    pub estimate_s: f64,
    /// Time in which the axes move between directions, s.
    pub moving_s: f64,
    /// The same in the plan's own order, s.
    pub unordered_moving_s: f64,
    /// Parts of the instrument that are not measured.
    pub missing: Vec<String>,
}

/// A time as hours and minutes.
#[must_use]
pub fn hours(s: f64) -> String {
    let minutes = (s / 60.0).round().max(0.0) as u64;
    match (minutes / 60, minutes % 60) {
        (0, 0) => format!("{s:.0} s"),
        (0, m) => format!("{m} min"),
        (h, m) => format!("{h} h {m:02} min"),
    }
}

/// The text of a run.
#[must_use]
pub fn run_text(run: &RunSummary) -> String {
    let mut text = String::new();
    let _ = writeln!(
        text,
        "{} of {} directions are measured, {} out of reach; {}, {} in {}",
        run.measured,
        run.directions,
        run.unreachable,
        counted(run.measurements, "measurement"),
        counted(run.readings, "reading"),
        hours(run.took_s)
    );
    let _ = writeln!(
        text,
        "the axes move for {} between the directions (in the plan's order {})",
        hours(run.moving_s),
        hours(run.unordered_moving_s)
    );
    let _ =
        writeln!(text, "next: sunglint brdf ingest {}/ -o values/", run.run.trim_end_matches('/'));
    text
}

/// The summary of a run's values.
#[derive(Debug, Serialize)]
struct Summary<'a> {
    directions: usize,
    unreachable: usize,
    left: usize,
    over_range: usize,
    refused: usize,
    scale_sigma: f64,
    instrument: &'a Instrument,
    warnings: &'a [String],
    inputs: &'a [Input],
}

/// All forms of the values of a run.
///
/// # Errors
/// Tables that FITS does not hold.
pub fn product(found: &Reduced, inputs: &[Input]) -> Result<Product, EncodeError> {
    let summary = Summary {
        directions: found.samples.rows.len(),
        unreachable: found.unreachable,
        left: found.left,
        over_range: found.over,
        refused: found.refused,
        scale_sigma: found.scale_sigma,
        instrument: &found.instrument,
        warnings: &found.warnings,
        inputs,
    };
    Ok(Product {
        name: "samples".into(),
        figure: Some(figure(found)),
        json: serde_json::to_value(summary).unwrap_or_default(),
        fits: Some(found.samples.to_fits()?),
        table: found.samples.to_table(),
        ..Product::default()
    })
}

/// The text of the values of a run.
#[must_use]
pub fn text(found: &Reduced) -> String {
    let it = &found.instrument;
    let mut text = format!(
        "{} at {}; {} not measured yet, {} out of reach, {} over range, {} refused\n",
        counted(found.samples.rows.len(), "direction"),
        wavelengths(found),
        found.left,
        found.unreachable,
        found.over,
        found.refused
    );
    let _ = writeln!(text, "scale     ± {:.2} % of all f", 100.0 * found.scale_sigma);
    let (incident, dark, unit) = match it.channels.get(found.channel) {
        Some(channel) => {
            let unit = channel.unit.map_or(String::new(), |unit| format!(" {unit}"));
            (channel.incident, channel.dark, unit)
        }
        None => (it.incident_w, it.dark_w, " W".to_owned()),
    };
    let _ = writeln!(
        text,
        "beam      {:.4e} ± {:.1e}{unit}; dark {:.2e} ± {:.1e}{unit}{}",
        incident.value,
        incident.sigma,
        dark.value,
        dark.sigma,
        if it.channels.len() > 1 {
            format!(" (at {} nm)", it.wavelength_nm)
        } else {
            String::new()
        }
    );
    let _ =
        writeln!(text, "detector  {:.4e} sr, ± {:.4}°", it.solid_angle_sr, it.cone_half_angle_deg);
    if let Some(s) = &it.signature {
        let across = s.fwhm_out_deg.map_or("not measured".to_owned(), |w| format!("{w:.3}°"));
        let _ = writeln!(
            text,
            "signature {:.3}° in the plane of incidence, {across} across (full widths); beam σ {:.3}° and {:.3}°, {:.2} % of it in the detector",
            s.fwhm_in_deg,
            s.sigma_in_deg,
            s.sigma_out_deg,
            100.0 * s.captured
        );
    }
    if let Some(f) = &it.floor {
        let _ = writeln!(
            text,
            "floor     {:.2e} /sr ({:.2e} to {:.2e})",
            f.mean_per_sr, f.least_per_sr, f.largest_per_sr
        );
    }
    let zero =
        |z: &sunglint_numerics::measured::Measured| format!("{:.4}° ± {:.4}°", z.value, z.sigma);
    let azimuth = it.zeros.azimuth_deg.as_ref().map_or("none".to_owned(), zero);
    let _ = writeln!(
        text,
        "zeros     sample {}, detector {}, azimuth {azimuth}{}",
        zero(&it.zeros.sample_deg),
        zero(&it.zeros.detector_deg),
        if it.zeros.measured { "" } else { " (not measured)" }
    );
    let [source, detector] =
        it.polarisation.each_ref().map(|p| p.as_deref().unwrap_or("not said (taken as none)"));
    let share = match it.polarised {
        Some(share) => format!("{share:+.3} of the light across the plane of incidence"),
        None => "not known".to_owned(),
    };
    let _ = writeln!(text, "polarised beam {source}, detector {detector}: {share}");
    if let Some(last) = it.drift.last() {
        let spread = it.drift.iter().map(|l| (l.relative - 1.0).abs()).fold(0.0, f64::max);
        let _ = writeln!(
            text,
            "lamp      {} looks, at most {:.2} % from the first, {:+.2} % at the end",
            it.drift.len(),
            100.0 * spread,
            100.0 * (last.relative - 1.0)
        );
    }
    if let Some(m) = &it.mirrored {
        let own = m.sample_fwhm_deg.map_or("below the instrument".to_owned(), |w| {
            format!("{:.3}° ± {:.3}° of the sample's own", w.value, w.sigma)
        });
        let _ = writeln!(
            text,
            "lobe      {:.3}° wide at {:.0}° of incidence, the instrument {:.3}°: {own}",
            m.seen_fwhm_deg, m.theta_i_deg, m.instrument_fwhm_deg
        );
    }
    text
}

/// Wavelengths of the values, in words.
fn wavelengths(found: &Reduced) -> String {
    match found.samples.wavelength_nm.as_slice() {
        [one] => format!("{one} nm"),
        all => {
            let ends = [all.first(), all.last()].map(|nm| nm.copied().unwrap_or(f64::NAN));
            format!("{} wavelengths from {} to {} nm", all.len(), ends[0], ends[1])
        }
    }
}

/// Values against the tilt of the facet that mirrors light to detector; the signature; the lamp.
fn figure(found: &Reduced) -> Figure {
    const MOST: usize = 8;
    let rows = &found.samples.rows;
    let mut incidences: Vec<f64> = rows.iter().map(|r| r.theta_i_deg).collect();
    incidences.sort_by(f64::total_cmp);
    incidences.dedup_by(|a, b| (*a - *b).abs() < 0.05);
    let count = incidences.len().min(MOST);
    let series = |j: usize| {
        let theta = incidences[j * incidences.len() / count];
        let points = rows.iter().filter(|r| (r.theta_i_deg - theta).abs() < 0.05).map(|r| {
            let i = direction(r.theta_i_deg, r.phi_i_deg);
            let h = (i + direction(r.theta_o_deg, r.phi_o_deg)).normalize();
            (h.truncate().length().atan2(h.z).to_degrees(), r.brdf_per_sr[found.channel])
        });
        Series::dots(format!("θᵢ {theta:.1}°"), j, points.collect())
    };
    let values = Panel::new(
        Axis::linear("tilt of the mirroring facet (deg)"),
        Axis::log("f (sr⁻¹)"),
        (0..count).map(series).collect(),
    );
    let mut panels = vec![values];
    let incident = found.incident;
    let scan = |label: &str, j: usize| {
        let points = found.scans[j].iter().map(|p| (p.offset_deg, p.power_w / incident));
        Series::line(label, j, points.collect())
    };
    let mut scans = Vec::new();
    for (j, label) in ["in the plane of incidence", "across it"].into_iter().enumerate() {
        if !found.scans[j].is_empty() {
            scans.push(scan(label, j));
        }
    }
    if !scans.is_empty() {
        panels.push(Panel::new(
            Axis::linear("detector off the straight beam (deg)"),
            Axis::linear("part of the beam in the detector"),
            scans,
        ));
    }
    let drift = &found.instrument.drift;
    if drift.len() > 1 {
        let points = drift.iter().map(|l| (l.time_s / 3600.0, 100.0 * (l.relative - 1.0)));
        panels.push(Panel::new(
            Axis::linear("time (h)"),
            Axis::linear("reference direction (%)"),
            vec![Series::line("against the first look", 0, points.collect())],
        ));
    }
    let at = match found.samples.wavelength_nm.as_slice() {
        [_] => String::new(),
        all => format!(" at {} nm", all[found.channel]),
    };
    Figure { title: format!("BRDF in {} directions{at}", rows.len()), panels }
}
