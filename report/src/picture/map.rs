//! The reflection map: what a body sends back over the directions of the phase vector.

use crate::plot::{Axis, Figure, Heat, Panel};
use crate::{Product, json_of, rounded};
use serde::Serialize;
use sunglint_formats::EncodeError;
use sunglint_formats::fits::{Header, Image, Pixels, Writer};
use sunglint_simulator::picture::{Aim, Map, ReflectionMaps};

/// Colours reach so many decades below the largest value.
const DECADES: f64 = 4.0;

#[derive(Serialize)]
struct BandJson {
    wavelength_nm: f64,
    brightest: f64,
    longitude_deg: f64,
    latitude_deg: f64,
}

#[derive(Serialize)]
struct MapJson<'a> {
    title: String,
    target: &'a str,
    phase_deg: f64,
    step_deg: f64,
    unit: &'a str,
    bands: Vec<BandJson>,
    warnings: &'a [String],
}

/// All forms of maps, and the text.
///
/// # Errors
/// Images that FITS does not hold.
pub fn product(found: &ReflectionMaps<'_>) -> Result<(Product, String), EncodeError> {
    let ReflectionMaps { aim, phase_deg, maps, .. } = found;
    let unit = if found.per_irradiance { "m2 / sr" } else { "W / (sr nm)" };
    let words = if found.per_irradiance { "m² sr⁻¹" } else { "W sr⁻¹ nm⁻¹" };
    let title = format!("{}: reflection map at a phase angle of {phase_deg}°", aim.target.name);
    let panels = maps.iter().filter_map(|(nm, map)| panel(*nm, map, words)).collect();
    let mut text = format!(
        "{title}\n  directions of the bisector of Sun and observer, body axes, in steps of {:.4}°; Sun and observer stand in the plane through it and the body's z axis, the Sun on the side of +z\n  direct light alone: scattered once\n",
        step(&maps[0].1)
    );
    let mut bands = Vec::new();
    for (nm, map) in maps {
        let ((row, column), most) = brightest(map);
        let (longitude, latitude) = (map.longitude_deg[column], map.latitude_deg[row]);
        text.push_str(&format!(
            "  {nm:>6} nm  brightest {most:.6e} {unit} at longitude {longitude:.2}°, latitude {latitude:.2}°\n"
        ));
        bands.push(BandJson {
            wavelength_nm: *nm,
            brightest: rounded(most),
            longitude_deg: rounded(longitude),
            latitude_deg: rounded(latitude),
        });
    }
    let product = Product {
        name: "reflection_map".into(),
        figure: Some(Figure { title: title.clone(), panels }),
        fits: Some(bytes(aim, maps, unit)?),
        json: json_of(&MapJson {
            title,
            target: &aim.target.name,
            phase_deg: *phase_deg,
            step_deg: rounded(step(&maps[0].1)),
            unit,
            bands,
            warnings: &aim.warnings,
        }),
        ..Product::default()
    };
    Ok((product, text))
}

/// The step between its columns, degrees.
fn step(map: &Map) -> f64 {
    360.0 / map.longitude_deg.len() as f64
}

fn brightest(map: &Map) -> ((usize, usize), f64) {
    let all = map.intensity.indexed_iter();
    all.fold(((0, 0), 0.0), |best, (at, v)| if *v > best.1 { (at, *v) } else { best })
}

fn panel(nm: f64, map: &Map, unit: &str) -> Option<Panel> {
    let (rows, columns) = map.intensity.dim();
    let edges = |n: usize, from: f64, to: f64| -> Vec<f64> {
        (0..=n).map(|i| from + (to - from) * i as f64 / n as f64).collect()
    };
    // Columns first, rows from below; what is dark is left white.
    let mut values = Vec::with_capacity(rows * columns);
    for column in 0..columns {
        for row in (0..rows).rev() {
            let value = map.intensity[(row, column)];
            values.push(if value > 0.0 { value } else { f64::NAN });
        }
    }
    let heat = Heat {
        x_edges: edges(columns, -180.0, 180.0),
        y_edges: edges(rows, -90.0, 90.0),
        values,
        label: vec![unit.to_owned(), format!("at {nm} nm")],
        decades: Some(DECADES),
    };
    let x = Axis::linear("longitude of the phase vector from the body's x axis (°)");
    let y = Axis::linear("latitude above its xy-plane (°)");
    heat.has_light().then(|| Panel { heat: Some(heat), ..Panel::new(x, y, vec![]) })
}

/// One image a wavelength, rows from the south.
fn bytes(aim: &Aim, maps: &[(f64, Map)], unit: &str) -> Result<Vec<u8>, EncodeError> {
    let mut writer = Writer::new();
    for (nm, map) in maps {
        let step = step(map);
        let mut header = Header::default();
        header.set("EXTNAME", format!("MAP_{}NM", nm.to_string().replace('.', "P")), "");
        header.set("OBJECT", aim.target.name.as_str(), "");
        header.set("BUNIT", unit, "");
        header.set("WAVELEN", *nm, "nm, vacuum");
        header.set("PHASE", map.phase_rad.to_degrees(), "deg");
        for (axis, name, first) in [(1, "LON", -180.0 + 0.5 * step), (2, "LAT", -90.0 + 0.5 * step)]
        {
            header.set(&format!("CTYPE{axis}"), name, "of the phase vector, body axes");
            header.set(&format!("CUNIT{axis}"), "deg", "");
            header.set(&format!("CRPIX{axis}"), 1.0, "");
            header.set(&format!("CRVAL{axis}"), first, "");
            header.set(&format!("CDELT{axis}"), step, "");
        }
        let mut values = map.intensity.clone();
        values.invert_axis(ndarray::Axis(0));
        let values = values.as_standard_layout().into_owned();
        writer.image(&Image { header, pixels: Pixels::F64(values.into_dyn()) })?;
    }
    Ok(writer.into_bytes())
}
