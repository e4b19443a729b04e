//! Effects that a scene needs, as people read them.

use crate::{json_of, rounded};
use serde::Serialize;
use serde_json::Value;
use std::fmt::Write as _;
use sunglint_formats::{Column, Table};
use sunglint_simulator::attitude::torques::{Sizes, TORQUES};
use sunglint_simulator::light::earth::grid::AlbedoGrid;
use sunglint_simulator::light::{EarthAlbedo, Need, engine, percent};
use sunglint_simulator::pass::{Explanation, Pass};

/// Width of the reasons.
const WIDTH: usize = 100;

/// The table of needs that heads every summary.
pub fn short(needs: &[Need], tolerance: f64) -> String {
    let mut text = format!("  what the scene needs, at a tolerance of {}\n", percent(tolerance));
    for need in needs {
        let _ = writeln!(
            text,
            "    {:<19} {:<13} {:>9}",
            need.effect,
            need.decision(),
            need.bound_text()
        );
    }
    let left = engine::left_out(needs);
    let _ = writeln!(text, "    {:<33} {:>9}", "left out, of full sunlight, up to", percent(left));
    text
}

/// The explanation as text.
pub fn text(pass: &Pass, explanation: &Explanation) -> String {
    let Explanation { needs, left_out, .. } = explanation;
    let mut text = format!(
        "{} as {} from {}: what it needs at a tolerance of {}\n\n",
        pass.object(),
        pass.target.name,
        pass.station.name,
        percent(pass.tolerance)
    );
    let _ = writeln!(text, "  effect              decision      could add      cost an epoch");
    for need in needs {
        let cost = need.cost_s.filter(|_| need.needed).map_or("-".into(), duration);
        let _ = writeln!(
            text,
            "  {:<19} {:<13} {:>9} {cost:>18}",
            need.effect,
            need.decision(),
            need.bound_text()
        );
        for line in wrapped(&need.why) {
            let _ = writeln!(text, "      {line}");
        }
    }
    let _ = writeln!(
        text,
        "\nleft out in all: up to {} of the light of the same surfaces in full sunlight. `sunglint simulate` states the error of",
        percent(*left_out)
    );
    text.push_str("each sample, channel and bin from what could be seen and lit at that moment.\n");
    text.push_str("could add: the most, as a share of the light of the same surfaces in full sunlight; -: no bound, therefore modelled.\n");
    if let Some(sizes) = &explanation.torques {
        torques(&mut text, sizes);
    }
    let aged = aged(pass);
    if !aged.is_empty() {
        text.push_str("\n  materials that have aged\n");
        for (material, how) in aged {
            let _ = writeln!(text, "  {material:<19} {how}");
        }
    }
    text
}

/// Materials that have aged, and how.
fn aged(pass: &Pass) -> Vec<(&str, &str)> {
    let materials = pass.target.materials.iter();
    materials.filter_map(|m| Some((m.name.as_str(), m.ageing()?))).collect()
}

/// Torques on the body along the pass.
fn torques(text: &mut String, sizes: &[Sizes; 5]) {
    text.push_str("\n  torque on the body     largest        mean (N m)\n");
    for (name, size) in TORQUES.iter().zip(sizes) {
        if size.modelled {
            let (most, mean) = (size.largest_n_m, size.mean_n_m);
            let _ = writeln!(text, "  {name:<19} {most:>10.2e}  {mean:>10.2e}");
        } else {
            let _ = writeln!(text, "  {name:<19} not modelled: [attitude.torques] leaves it out");
        }
    }
}

fn duration(seconds: f64) -> String {
    match seconds {
        0.0 => "0".into(),
        s if s < 1e-6 => format!("{:.0} ns", 1e9 * s),
        s if s < 1e-3 => format!("{:.1} µs", 1e6 * s),
        s => format!("{:.1} ms", 1e3 * s),
    }
}

/// Lines of at most [`WIDTH`] characters.
fn wrapped(text: &str) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split(' ') {
        let last = lines.last().map_or(0, |l| l.chars().count());
        if last > 0 && last + 1 + word.chars().count() > WIDTH {
            lines.push(String::new());
        }
        if let Some(line) = lines.last_mut() {
            if !line.is_empty() {
                line.push(' ');
            }
            line.push_str(word);
        }
    }
    lines
}

/// The needs as a table.
pub fn table(pass: &Pass, explanation: &Explanation) -> Table {
    let needs = &explanation.needs;
    let mut table = Table::default();
    table.meta.insert("title".into(), format!("{}: what it needs", pass.name).into());
    table.meta.insert("tolerance".into(), pass.tolerance.into());
    let text = |f: &dyn Fn(&Need) -> String| needs.iter().map(f).collect::<Vec<_>>();
    let number = |f: &dyn Fn(&Need) -> Option<f64>| {
        needs.iter().map(|n| f(n).unwrap_or(f64::NAN)).collect::<Vec<_>>()
    };
    table.columns = vec![
        Column::text("effect", text(&|n| n.effect.into())),
        Column::text("decision", text(&|n| n.decision().to_lowercase())),
        Column::f64("bound", None, number(&|n| n.bound)),
        Column::f64("cost_s", Some("s"), number(&|n| n.cost_s)),
        Column::text("why", text(&|n| n.why.clone())),
    ];
    table
}

/// Returns the Earth's reflection, in words.
pub fn earth(earth: &EarthAlbedo) -> String {
    format!("{}, ± {:.0} %", earth.describe(), 100.0 * earth.uncertainty())
}

/// The Earth's reflection with documented keys.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EarthJson<'a> {
    description: String,
    uncertainty: f64,
    largest_albedo: f64,
    rows: Option<usize>,
    columns: Option<usize>,
    missing_cells: Option<usize>,
    wavelength_nm: Option<&'a [f64]>,
}

impl<'a> EarthJson<'a> {
    /// Takes the Earth as a pass sees it.
    pub fn new(earth: &'a EarthAlbedo) -> Self {
        let grid = earth.grid();
        Self {
            description: earth.describe(),
            uncertainty: earth.uncertainty(),
            largest_albedo: rounded(earth.most()),
            rows: grid.map(|g| g.size().0),
            columns: grid.map(|g| g.size().1),
            missing_cells: grid.map(AlbedoGrid::missing),
            wavelength_nm: grid.map(AlbedoGrid::wavelengths_nm),
        }
    }
}

/// A need with documented keys.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct NeedJson<'a> {
    effect: &'a str,
    needed: bool,
    modelled: bool,
    bound: Option<f64>,
    why: &'a str,
    cost_s: Option<f64>,
}

/// Needs with documented keys.
pub fn json(needs: &[Need]) -> Vec<NeedJson<'_>> {
    let all = needs.iter().map(|need| NeedJson {
        effect: need.effect,
        needed: need.needed,
        modelled: need.is_modelled(),
        bound: need.bound.filter(|b| b.is_finite()).map(rounded),
        why: &need.why,
        cost_s: need.cost_s.map(rounded),
    });
    all.collect()
}

#[derive(Serialize)]
struct Document<'a> {
    pass: &'a str,
    target: TargetJson<'a>,
    tolerance: f64,
    earth: EarthJson<'a>,
    needs: Vec<NeedJson<'a>>,
    left_out: f64,
    terms: usize,
    aged: Vec<AgedJson<'a>>,
    torques: Option<Vec<TorqueJson>>,
    scene: SceneJson,
    course: CourseJson,
    warnings: Vec<&'a String>,
}

#[derive(Serialize)]
struct TargetJson<'a> {
    name: &'a str,
}

#[derive(Serialize)]
struct AgedJson<'a> {
    material: &'a str,
    ageing: &'a str,
}

#[derive(Serialize)]
struct TorqueJson {
    torque: &'static str,
    modelled: bool,
    largest_n_m: f64,
    mean_n_m: f64,
}

#[derive(Serialize)]
struct SceneJson {
    triangles: usize,
    facets: usize,
    spheres: usize,
    closed: bool,
    convex: bool,
    hides_nothing: bool,
    solids: usize,
    occluder_pairs: Option<usize>,
}

#[derive(Serialize)]
struct CourseJson {
    epochs: usize,
    geometries: usize,
    least_range_m: f64,
    least_radius_m: f64,
    largest_radius_m: f64,
    sun_radius_deg: f64,
    largest_phase_deg: f64,
    earthshine: f64,
    penumbra: usize,
    umbra: usize,
}

/// The explanation with documented keys.
pub fn document(pass: &Pass, explanation: &Explanation) -> Value {
    let Explanation { needs, left_out, course, scene, terms, torques } = explanation;
    let torque = |(name, size): (&&'static str, &Sizes)| TorqueJson {
        torque: name,
        modelled: size.modelled,
        largest_n_m: rounded(size.largest_n_m),
        mean_n_m: rounded(size.mean_n_m),
    };
    let aged = aged(pass).into_iter().map(|(material, ageing)| AgedJson { material, ageing });
    json_of(&Document {
        pass: &pass.name,
        target: TargetJson { name: &pass.target.name },
        tolerance: pass.tolerance,
        earth: EarthJson::new(&pass.earth),
        needs: json(needs),
        left_out: rounded(*left_out),
        terms: *terms,
        aged: aged.collect(),
        torques: torques.as_ref().map(|sizes| TORQUES.iter().zip(sizes).map(torque).collect()),
        scene: SceneJson {
            triangles: scene.triangles,
            facets: scene.facets,
            spheres: scene.spheres,
            closed: scene.closed,
            convex: scene.convex,
            hides_nothing: scene.no_occlusion,
            solids: scene.solids,
            occluder_pairs: scene.occluder_pairs,
        },
        course: CourseJson {
            epochs: course.epochs,
            geometries: course.geometries,
            least_range_m: rounded(course.range_m),
            least_radius_m: rounded(course.radius_m.0),
            largest_radius_m: rounded(course.radius_m.1),
            sun_radius_deg: rounded(course.sun_radius_rad.to_degrees()),
            largest_phase_deg: rounded(course.phase_rad.to_degrees()),
            earthshine: rounded(course.earthshine),
            penumbra: course.penumbra,
            umbra: course.umbra,
        },
        warnings: pass.warnings.iter().chain(&scene.warnings).collect(),
    })
}
