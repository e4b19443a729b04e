//! How a mount shows directions: text, JSON, table, figure.

use crate::plot::{Axis, Figure, Panel, Series};
use crate::{Product, json_of, rounded};
use serde::Serialize;
use std::fmt::Write as _;
use sunglint_drivers::device::MountAxes;
use sunglint_formats::{Column, Table};
use sunglint_numerics::axes::Axes;
use sunglint_observatory::telescope::{PointingFit, PointingTerm, places_table};

/// Words for a term.
fn words(term: PointingTerm, axes: MountAxes) -> &'static str {
    let equatorial = axes == MountAxes::Equatorial;
    match term {
        PointingTerm::FirstZero if equatorial => "zero point of the hour angle",
        PointingTerm::FirstZero => "zero point of the azimuth",
        PointingTerm::SecondZero if equatorial => "zero point of the declination",
        PointingTerm::SecondZero => "zero point of the altitude",
        PointingTerm::TiltAcross if equatorial => "polar axis too low or too high",
        PointingTerm::TiltAcross => "azimuth axis tilted north-south",
        PointingTerm::TiltAlong if equatorial => "polar axis too far east or west",
        PointingTerm::TiltAlong => "azimuth axis tilted east-west",
        PointingTerm::Cone => "tube not perpendicular to its axis",
        PointingTerm::Perpendicular => "axes not perpendicular",
        PointingTerm::Tube => "tube bends towards the ground",
        PointingTerm::CircleSine => "circle off its middle (sine)",
        PointingTerm::CircleCosine => "circle off its middle (cosine)",
        _ => term.name(),
    }
}

/// Names of the axes' angles.
fn names(axes: MountAxes) -> [&'static str; 2] {
    match axes {
        MountAxes::Equatorial => ["hour angle", "declination"],
        MountAxes::Horizontal => ["azimuth", "altitude"],
    }
}

/// The model as text.
pub fn text(fit: &PointingFit) -> String {
    let model = &fit.model;
    let mut text = format!(
        "pointing of a mount of {} and {}, from {} places\n\n  {:<38} {:>10}\n",
        names(model.axes)[0],
        names(model.axes)[1],
        model.points,
        "term",
        "arcsec"
    );
    for (term, known) in &model.terms_arcsec {
        let _ = writeln!(
            text,
            "  {:<38} {:>10.1} ± {:.1}",
            words(*term, model.axes),
            known.value,
            known.sigma
        );
    }
    let _ = writeln!(
        text,
        "\nroot of the mean squared distance: {:.0}″ without the model, {:.1}″ with it",
        fit.before_arcsec, model.rms_arcsec
    );
    if model.german {
        text.push_str("both sides of the pier were seen: zero point of the declination, cone and perpendicular change their signs with the side\n");
    }
    for (k, place) in fit.places.iter().enumerate().filter(|(k, _)| !fit.used[*k]) {
        let Axes { first, second } = model.off_arcsec(place);
        let _ = writeln!(
            text,
            "place {} is left out: it lies {:.0}″ beside the model",
            k + 1,
            first.hypot(second)
        );
    }
    text
}

#[derive(Serialize)]
struct TermJson<'a> {
    name: &'a str,
    arcsec: f64,
    sigma_arcsec: f64,
}

#[derive(Serialize)]
struct PointingJson<'a> {
    axes: &'a str,
    german: bool,
    places: usize,
    used: usize,
    before_arcsec: f64,
    rms_arcsec: f64,
    terms: Vec<TermJson<'a>>,
}

/// All forms of the result.
pub fn product(fit: &PointingFit) -> Product {
    let model = &fit.model;
    let off: Vec<Axes> = fit.places.iter().map(|place| model.off_arcsec(place)).collect();
    let mut columns = places_table(model.axes, &fit.places);
    let arcsec = |k: usize| off.iter().map(|off| (off[k] * 1e3).round() / 1e3).collect();
    columns.push(Column::f64("off_first_arcsec", Some("arcsec"), arcsec(0)));
    columns.push(Column::f64("off_second_arcsec", Some("arcsec"), arcsec(1)));
    columns.push(Column::i64("used", None, fit.used.iter().map(|used| i64::from(*used)).collect()));
    let term = |(term, known): &(PointingTerm, sunglint_numerics::measured::Measured)| TermJson {
        name: term.name(),
        arcsec: rounded(known.value),
        sigma_arcsec: rounded(known.sigma),
    };
    let json = json_of(&PointingJson {
        axes: if model.axes == MountAxes::Equatorial { "equatorial" } else { "horizontal" },
        german: model.german,
        places: fit.places.len(),
        used: model.points,
        before_arcsec: rounded(fit.before_arcsec),
        rms_arcsec: rounded(model.rms_arcsec),
        terms: model.terms_arcsec.iter().map(term).collect(),
    });
    Product {
        name: "pointing".into(),
        table: Table { columns, ..Table::default() },
        figure: Some(figure(fit, &off)),
        json,
        ..Product::default()
    }
}

/// Figure of the residuals over both angles, and over one another.
fn figure(fit: &PointingFit, off: &[Axes]) -> Figure {
    let [first, second] = names(fit.model.axes);
    let used = || fit.places.iter().zip(off).zip(&fit.used).filter(|(_, used)| **used);
    let over = |angle: usize, part: usize| {
        used().map(|((place, off), _)| (place.seen_deg[angle], off[part])).collect()
    };
    let panel = |name: &str, angle: usize| {
        Panel::new(
            Axis::linear(format!("{name} (deg)")),
            Axis::linear("left over (arcsec)"),
            vec![
                Series::dots(format!("along {first}, on the sky"), 0, over(angle, 0)),
                Series::dots(format!("along {second}"), 1, over(angle, 1)),
            ],
        )
    };
    let around = used().map(|((_, off), _)| (off.first, off.second)).collect();
    let target = Panel::new(
        Axis::linear(format!("along {first}, on the sky (arcsec)")),
        Axis::linear(format!("along {second} (arcsec)")),
        vec![Series::dots(String::new(), 0, around)],
    );
    let rms = fit.model.rms_arcsec;
    Figure {
        title: format!("Pointing, {:.0}″ before and {rms:.1}″ after", fit.before_arcsec),
        panels: vec![panel(first, 0), panel(second, 1), target],
    }
}
