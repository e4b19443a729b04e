//! Samples and the NDF as a measured material: the tensors of a `.bsdf` file (Dupuy and Jakob, ACM TOG 37, 274, 2018).
//!
//! The file has its own grid, finer than the plan's: each cell's value is what the NDF says times how the samples around differ from that, so that the lobe stays where it is
//! between them. Cells far from all samples are extrapolated: there the law of the NDF remains, which is reciprocal. They are flagged, and where a direction of incidence
//! would reflect more than came it is they that are lowered.

mod base;
mod doubt;
pub mod files;
mod near;
mod refine;

pub use base::Base;
pub(crate) use base::IMAGES;
pub use doubt::Doubt;

use super::instrument::TableInstrument;
use super::ndf::Ndf;
use super::samples::Samples;
use base::{Field, Microfacets, Trail};
use glam::DVec3;
use rayon::prelude::*;
use refine::{Filled, filled};
use serde::Serialize;
use std::f64::consts::{FRAC_1_PI, FRAC_PI_2, PI, TAU};
use sunglint_formats::bsdf::{Tensor, TensorData, TensorFile};
use sunglint_numerics::progress::{Cancelled, Progress};
use sunglint_simulator::surface::measured::Layout;
use sunglint_simulator::surface::{Blend, Grid, Warp};

/// For diffuse light the file's density gets a floor of at most so many times its peak: then it is nearly the same everywhere.
const MOST_FLOOR: f64 = 10.0;
/// The file's D and σ, of which it has one each, are finer than its warps, of which it has one for each incidence.
const FINER: usize = 8;
/// Nodes in azimuth over nodes in elevation, in the warps of an isotropic sample.
const ROWS: usize = 4;

/// How finely a material is written.
#[derive(Debug, Clone, PartialEq)]
pub struct AssembleOptions {
    /// Incident elevations, from 0 to 89.9°.
    pub theta_i: usize,
    /// Incident azimuths over half the circle, of an anisotropic sample.
    pub phi_i: usize,
    /// Side of the grid of values. Of an odd one the plane of incidence is a row.
    pub side: usize,
    /// Nodes of the warps in elevation; in azimuth as many, of an isotropic sample four times as many (light at grazing incidence needs them).
    pub normals: usize,
    /// Whether an anisotropic sample is the same on both sides of its axes, so that a quarter of the circle says all.
    pub mirrored: bool,
}

impl Default for AssembleOptions {
    fn default() -> Self {
        Self { theta_i: 72, phi_i: 17, side: 129, normals: 128, mirrored: false }
    }
}

/// Why nothing was assembled.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AssembleError {
    /// An option out of its range.
    #[error("{name}: found {found}, expected {expected}")]
    Option {
        /// The option.
        name: &'static str,
        /// Value of the option.
        found: f64,
        /// Allowed values.
        expected: &'static str,
    },
    /// Too few samples.
    #[error(
        "{used} of {rows} directions have values above 0 at every wavelength and lie above the horizon: a material needs {needed} or more"
    )]
    TooFew {
        /// Those that can be used.
        used: usize,
        /// All.
        rows: usize,
        /// The least.
        needed: usize,
    },
    /// A density of nothing.
    #[error("no microfacet is seen from {theta_i_deg:.2}°: D is 0 there")]
    Dark {
        /// The incident elevation.
        theta_i_deg: f64,
    },
    /// An anisotropic table with an isotropic NDF.
    #[error(
        "the samples have several azimuths of incidence and the NDF none: measure retro-reflection by azimuth, or turn the samples to one"
    )]
    Azimuths,
    /// Whoever watches ended it.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// Coverage of one direction of incidence by measurements.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Coverage {
    /// Angle of the light, degrees.
    pub theta_i_deg: f64,
    /// Angle of the light, degrees.
    pub phi_i_deg: f64,
    /// Cells above the horizon.
    pub cells: usize,
    /// The share of them that is extrapolated.
    pub extrapolated_cells: f64,
    /// The directional–hemispherical reflectance, mean over the wavelengths.
    pub albedo: f64,
    /// The share of it that is extrapolated.
    pub extrapolated_albedo: f64,
    /// The largest over the wavelengths.
    pub largest_albedo: f64,
    /// Possible error of the albedo by what is extrapolated, and by the scale and the stray light that all values share, as a part of it.
    pub albedo_doubt: f64,
    /// Smallest factor that extrapolated cells were multiplied by, for energy's sake: 1 where they were not lowered.
    pub lowered: f64,
}

/// A material.
#[derive(Debug, Clone, PartialEq)]
pub struct Assembled {
    /// The file.
    pub file: TensorFile,
    /// By azimuth and elevation of incidence.
    pub coverage: Vec<Coverage>,
    /// By direction, on a coarse grid.
    pub doubts: Vec<Doubt>,
    /// Specular and diffuse part by the NDF, for each wavelength.
    pub base: Vec<Base>,
    /// Samples that were used.
    pub used: usize,
    /// Samples that were not.
    pub left_out: usize,
    /// The instrument as the samples say it; none where they say nothing.
    pub instrument: Option<TableInstrument>,
    /// Warnings for the user.
    pub warnings: Vec<String>,
}

/// The grids of a file.
struct Grids {
    ndf: Grid,
    sigma: Grid,
    layout: Layout,
    /// Rows and columns of the warps.
    warp: (usize, usize),
}

/// One direction of incidence.
struct Slice {
    vndf: Vec<f32>,
    /// By row, column and wavelength.
    values: Vec<f64>,
    extrapolated: Vec<u8>,
    /// Possible error of ln f, by row and column.
    doubt: Vec<f32>,
    coverage: Coverage,
}

/// Puts samples and NDF together; `progress` hears of each direction of incidence, and may end the work between two.
///
/// # Errors
/// Options out of range, too few samples, an NDF that is 0 everywhere, azimuths that the NDF has not; the work was ended.
pub fn assemble(
    samples: &Samples,
    ndf: &Ndf,
    options: &AssembleOptions,
    progress: &dyn Progress,
) -> Result<Assembled, AssembleError> {
    check(options)?;
    if ndf.is_isotropic() && samples.has_azimuths() {
        return Err(AssembleError::Azimuths);
    }
    let microfacets = Microfacets::new(ndf);
    let (field, left_out) = Field::new(&microfacets, samples, options.mirrored);
    let needed = 8;
    if field.len() < needed {
        return Err(AssembleError::TooFew { used: field.len(), rows: samples.rows.len(), needed });
    }
    let (theta_i, phi_i) = incidences(ndf.is_isotropic(), options);
    let grids = Grids::new(&microfacets, &field.base, (&theta_i, &phi_i), options);
    let nl = samples.wavelength_nm.len();
    let places: Vec<[usize; 2]> =
        (0..phi_i.len()).flat_map(|k| (0..theta_i.len()).map(move |j| [j, k])).collect();
    progress.begin("directions of incidence", Some(places.len() as u64));
    let slices = places
        .par_iter()
        .map(|[j, k]| {
            if progress.is_cancelled() {
                return Err(Cancelled.into());
            }
            let at = ([*j, *k], (theta_i[*j], phi_i[*k]));
            let made = slice(&microfacets, &field, &grids, at, nl, options);
            progress.advance(1);
            made
        })
        .collect::<Result<Vec<_>, _>>()?;
    let mut warnings = Vec::new();
    if left_out > 0 {
        warnings.push(format!("{left_out} of {} directions were left out: at the horizon, or with a value that is not above 0", samples.rows.len()));
    }
    warnings.extend(crate::fit::saturation_note(samples));
    let said = TableInstrument::of(samples);
    let instrument = said.clone().unwrap_or_default();
    warnings.extend(instrument.missing.iter().map(|what| {
        format!(
            "the instrument was not measured whole: {what}. The material's doubt is wider for it"
        )
    }));
    for slice in &slices {
        let c = &slice.coverage;
        if c.largest_albedo > 1.0 + 1e-3 {
            warnings.push(format!(
                "the measured cells at {:.1}° of incidence reflect {:.3} of the light: they are left as they were measured",
                c.theta_i_deg, c.largest_albedo
            ));
        }
    }
    let file = file(samples, &grids, (&theta_i, &phi_i), (&slices, &instrument), options);
    // What all values share moves every albedo; stray light is f over cosθ_o, so that all of the hemisphere has it.
    let shared = (2.0 * instrument.scale_sigma).exp_m1();
    let with_shared = |c: Coverage| {
        let stray = TAU * instrument.shared_per_sr(1.0) / c.albedo.max(f64::MIN_POSITIVE);
        let i = spherical(c.theta_i_deg.to_radians(), 0.0);
        let polarised = instrument.polarised_ln(i, DVec3::new(-i.x, -i.y, i.z)).exp_m1();
        let doubt = c.albedo_doubt.hypot(shared).hypot(stray).hypot(polarised);
        Coverage { albedo_doubt: doubt, ..c }
    };
    let coverage: Vec<Coverage> = slices.iter().map(|s| with_shared(s.coverage)).collect();
    let doubts = doubt::by_direction(&field, &coverage, microfacets.is_isotropic());
    Ok(Assembled {
        file,
        coverage,
        doubts,
        base: field.base.clone(),
        used: field.len(),
        left_out,
        instrument: said,
        warnings,
    })
}

/// The tensor that names the instrument's quantities that were not measured, a line each.
const NOT_MEASURED: &str = "not_measured";

/// Quantities of the instrument that were not measured, as an assembled file names them.
#[must_use]
pub fn not_measured(file: &TensorFile) -> Vec<String> {
    let Some(Tensor { data: TensorData::U8(bytes), .. }) = file.get(NOT_MEASURED) else {
        return Vec::new();
    };
    let said = |what: &str| format!("the instrument was not measured whole: {what}");
    String::from_utf8_lossy(bytes).lines().map(said).collect()
}

fn check(options: &AssembleOptions) -> Result<(), AssembleError> {
    let wrong = |name, found, expected| Err(AssembleError::Option { name, found, expected });
    if !(4..=512).contains(&options.theta_i) {
        return wrong("theta_i", options.theta_i as f64, "4 to 512 elevations");
    }
    if !(3..=256).contains(&options.phi_i) {
        return wrong("phi_i", options.phi_i as f64, "3 to 256 azimuths");
    }
    if !(8..=512).contains(&options.side) {
        return wrong("side", options.side as f64, "8 to 512 nodes");
    }
    if !(16..=2048).contains(&options.normals) {
        return wrong("normals", options.normals as f64, "16 to 2048 nodes");
    }
    Ok(())
}

/// Elevations and azimuths (over half the circle), as the file holds them.
fn incidences(isotropic: bool, options: &AssembleOptions) -> (Vec<f64>, Vec<f64>) {
    let single = |v: f64| f64::from(v as f32);
    let phi = |k: usize| single(-PI + PI * k as f64 / (options.phi_i - 1) as f64);
    let phi_i = if isotropic { vec![0.0] } else { (0..options.phi_i).map(phi).collect() };
    (Layout::elevations(options.theta_i), phi_i)
}

fn spherical(theta: f64, phi: f64) -> DVec3 {
    DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
}

impl Grids {
    fn new(
        microfacets: &Microfacets<'_>,
        base: &[Base],
        (theta_i, phi_i): (&[f64], &[f64]),
        options: &AssembleOptions,
    ) -> Self {
        let isotropic = microfacets.is_isotropic();
        // Beside diffuse light a lobe's tail is nothing: values over D alone would rise without end.
        let ratio = |b: &Base| (b.diffuse / b.specular).clamp(1e-300, 1e300).ln();
        let ratio = (base.iter().map(ratio).sum::<f64>() / base.len() as f64).exp();
        let floor = (4.0 * FRAC_1_PI * ratio).min(MOST_FLOOR * microfacets.peak());
        let spread = |rows: usize, columns: usize, of: &(dyn Fn(DVec3) -> f64 + Sync)| {
            let at = |row: usize, column: usize| {
                let u = column as f64 / (columns - 1) as f64;
                let phi = TAU * row as f64 / (rows - 1) as f64 - PI;
                of(spherical(u * u * FRAC_PI_2, phi)) as f32
            };
            let values = if isotropic {
                (0..columns).map(|c| at(0, c)).collect::<Vec<f32>>().repeat(rows)
            } else {
                (0..rows)
                    .flat_map(|r| (0..columns).map(move |c| (r, c)))
                    .map(|(r, c)| at(r, c))
                    .collect()
            };
            Grid { rows, columns, values }
        };
        let warp = (options.normals * if isotropic { ROWS } else { 1 }, options.normals);
        let columns = FINER * options.normals;
        let rows = if isotropic { 2 } else { options.normals };
        let density = |m: DVec3| microfacets.density(m);
        Self {
            ndf: spread(rows, columns, &|m| density(m) + floor),
            sigma: spread(rows, columns, &|v| microfacets.area(v)),
            layout: Layout::new(spread(warp.0, warp.1, &density), floor, theta_i, phi_i),
            warp,
        }
    }

    fn place(&self, v: DVec3, phi_i: f64) -> [f64; 2] {
        let theta = 2.0 * (0.5 * (v - DVec3::Z).length()).min(1.0).asin();
        let turn = (v.y.atan2(v.x) - phi_i + PI) / TAU;
        [(theta / FRAC_PI_2).sqrt(), turn - turn.floor()]
    }
}

/// A slice of the material alone.
const BLEND: Blend = [(0, 1.0), (0, 0.0), (0, 0.0), (0, 0.0)];

fn slice(
    microfacets: &Microfacets<'_>,
    field: &Field<'_>,
    grids: &Grids,
    ([elevation, azimuth], (theta, phi)): ([usize; 2], (f64, f64)),
    nl: usize,
    options: &AssembleOptions,
) -> Result<Slice, AssembleError> {
    let i = spherical(theta, phi);
    // Azimuths of an isotropic sample's normals are counted from the light's.
    let from = if microfacets.is_isotropic() { phi } else { 0.0 };
    let (rows, columns) = grids.warp;
    let vndf = grids.layout.visible(elevation, azimuth);
    let warp = Warp::new(Grid { rows, columns, values: vndf.clone() })
        .ok_or(AssembleError::Dark { theta_i_deg: theta.to_degrees() })?;
    let area = grids.sigma.at(grids.place(i, from));
    let side = options.side;
    let last = (side - 1) as f64;
    let seen = |node: usize| {
        let s = [(node % side) as f64 / last, (node / side) as f64 / last];
        let (u, density) = warp.sample(s, &BLEND);
        let m = grids.layout.normal(phi, u);
        let mirrored = (2.0 * i.dot(m) * m - i).normalize();
        // dω_o = 4 (i·m) dω_m, dω_m = 2π² u sinθ du, du = ds/density; half of it at the grid's edges.
        let edge = |s: f64| if s > 0.0 && s < 1.0 { 1.0 } else { 0.5 };
        let ds = edge(s[0]) * edge(s[1]) / (last * last);
        let du = if density > 0.0 { ds / density } else { 0.0 };
        let share = if mirrored.z > 0.0 && i.dot(m) > 0.0 {
            let solid = 4.0 * i.dot(m) * 2.0 * PI * PI * u[0] * m.x.hypot(m.y) * du;
            solid * grids.ndf.at(u) / (4.0 * area)
        } else {
            0.0
        };
        (Layout::above_horizon(mirrored), share)
    };
    let (towards, share): (Vec<DVec3>, Vec<f64>) = (0..side * side).map(seen).unzip();
    let mut trail = Trail::default();
    let ask = |node: usize, into: &mut [f64]| {
        let stencil = field.stencil_after(i, towards[node], &mut trail);
        field.kept(&stencil, into);
        (field.doubt(&stencil, i, towards[node]), stencil.measured)
    };
    let Filled { ln, mut doubt, measured, .. } = filled(side, nl, ask);
    let extrapolated: Vec<u8> = measured.iter().map(|measured| u8::from(!measured)).collect();
    let mut values = vec![0.0; side * side * nl];
    for ((kept, into), o) in ln.chunks(nl).zip(values.chunks_mut(nl)).zip(&towards) {
        field.values(kept, i, *o, into);
        let scale = o.z * 4.0 * area / grids.ndf.at(grids.place((i + *o).normalize(), from));
        into.iter_mut().for_each(|v| *v *= scale);
    }
    let coverage = energy((theta, phi), nl, &mut values, (&extrapolated, &mut doubt), &share);
    let doubt = doubt.into_iter().map(|d| d as f32).collect();
    Ok(Slice { vndf, values, extrapolated, doubt, coverage })
}

/// Lowers what is extrapolated where more light would leave than came, and says what there is.
fn energy(
    (theta, phi): (f64, f64),
    nl: usize,
    values: &mut [f64],
    (extrapolated, doubt): (&[u8], &mut [f64]),
    share: &[f64],
) -> Coverage {
    let (mut mean, mut mean_beyond, mut largest, mut lowered) = (0.0, 0.0, 0.0_f64, 1.0_f64);
    for k in 0..nl {
        let (mut known, mut beyond) = (0.0, 0.0);
        for (node, share) in share.iter().enumerate() {
            let part = share * values[node * nl + k];
            if extrapolated[node] == 1 { beyond += part } else { known += part }
        }
        if known + beyond > 1.0 && beyond > 0.0 {
            let factor = ((1.0 - known) / beyond).max(0.0);
            for (node, flag) in extrapolated.iter().enumerate() {
                if *flag == 1 {
                    values[node * nl + k] *= factor;
                }
            }
            beyond *= factor;
            lowered = lowered.min(factor);
        }
        mean += (known + beyond) / nl as f64;
        mean_beyond += beyond / nl as f64;
        largest = largest.max(known + beyond);
    }
    let mut off = 0.0;
    for (node, d) in doubt.iter_mut().enumerate().filter(|(node, _)| extrapolated[*node] == 1) {
        *d += -lowered.max(1e-3).ln();
        let mean = values[node * nl..(node + 1) * nl].iter().sum::<f64>() / nl as f64;
        off += share[node] * mean * d.exp_m1();
    }
    let cells = share.iter().filter(|s| **s > 0.0).count();
    let flagged = share.iter().zip(extrapolated).filter(|(s, e)| **s > 0.0 && **e == 1).count();
    Coverage {
        theta_i_deg: theta.to_degrees(),
        phi_i_deg: phi.to_degrees(),
        cells,
        extrapolated_cells: flagged as f64 / cells.max(1) as f64,
        albedo: mean,
        extrapolated_albedo: if mean > 0.0 { mean_beyond / mean } else { 0.0 },
        largest_albedo: largest,
        albedo_doubt: if mean > 0.0 { off / mean } else { 0.0 },
        lowered,
    }
}

fn file(
    samples: &Samples,
    grids: &Grids,
    (theta_i, phi_i): (&[f64], &[f64]),
    (slices, instrument): (&[Slice], &TableInstrument),
    options: &AssembleOptions,
) -> TensorFile {
    let (np, nt, nl, side) =
        (phi_i.len(), theta_i.len(), samples.wavelength_nm.len(), options.side);
    let single = |values: &[f64]| values.iter().map(|v| *v as f32).collect::<Vec<f32>>();
    let mut spectra = Vec::with_capacity(np * nt * nl * side * side);
    let (mut luminance, mut vndf, mut extrapolated) = (Vec::new(), Vec::new(), Vec::new());
    let mut doubt = Vec::new();
    for slice in slices {
        for k in 0..nl {
            spectra.extend(slice.values.iter().skip(k).step_by(nl).map(|v| *v as f32));
        }
        luminance.extend(
            slice.values.chunks(nl).map(|v| (v.iter().sum::<f64>() / nl as f64 + 1e-9) as f32),
        );
        vndf.extend_from_slice(&slice.vndf);
        extrapolated.extend_from_slice(&slice.extrapolated);
        doubt.extend_from_slice(&slice.doubt);
    }
    let name = samples.meta.get("sample").and_then(|v| v.as_str()).unwrap_or("a sample");
    let text = format!(
        "{name}: {} directions, {nl} wavelengths, assembled by sunglint",
        samples.rows.len()
    );
    let (rows, columns) = grids.warp;
    let densities = [grids.ndf.rows, grids.ndf.columns];
    let bytes = |name: &str, shape: Vec<usize>, values: Vec<u8>| Tensor {
        name: name.to_owned(),
        shape,
        data: TensorData::U8(values),
    };
    let mut tensors = vec![
        Tensor::u8("description", text.into_bytes()),
        Tensor::f32("theta_i", &[nt], single(theta_i)),
        Tensor::f32("phi_i", &[np], single(phi_i)),
        Tensor::f32("wavelengths", &[nl], single(&samples.wavelength_nm)),
        Tensor::f32("ndf", &densities, grids.ndf.values.clone()),
        Tensor::f32("sigma", &densities, grids.sigma.values.clone()),
        Tensor::f32("vndf", &[np, nt, rows, columns], vndf),
        Tensor::f32("luminance", &[np, nt, side, side], luminance),
        Tensor::f32("spectra", &[np, nt, nl, side, side], spectra),
        bytes("jacobian", vec![1], vec![1]),
        // Readers of such files leave alone what they do not know.
        bytes("extrapolated", vec![np, nt, side, side], extrapolated),
        Tensor::f32("ln_doubt", &[np, nt, side, side], doubt),
    ];
    if !instrument.missing.is_empty() {
        let one = |what: &String| what.replace(char::is_control, " ");
        let lines: Vec<String> = instrument.missing.iter().map(one).collect();
        tensors.push(Tensor::u8(NOT_MEASURED, lines.join("\n")));
    }
    TensorFile { tensors }
}
