//! Contents of files of elements: object by object, how old, how far several sets are apart.

use crate::{Product, rounded};
use hifitime::Epoch;
use serde::Serialize;
use std::fmt::Write as _;
use sunglint_ephemeris::orbit::elements::{Apart, Held};
use sunglint_formats::time::format_utc;
use sunglint_formats::{Column, Table};

/// Objects that the text lists.
const LISTED: usize = 40;

/// Distance of one set's prediction from another's.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Distance {
    /// Time by which it is ahead, s.
    pub along_s: f64,
    /// Distance along the track, km.
    pub along_km: f64,
    /// Distance across the track, km.
    pub across_km: f64,
}

/// One object.
#[derive(Debug, Clone, Serialize)]
pub struct Object {
    /// Number in the catalogue.
    pub norad_id: u32,
    /// Name, where the file has one.
    pub name: Option<String>,
    /// International designator.
    pub designator: Option<String>,
    /// Number of sets.
    pub sets: usize,
    /// Epoch of the set nearest to the time.
    pub epoch_utc: String,
    /// Age of that set, days; below 0 where its epoch is later.
    pub age_days: f64,
    /// First and last epoch.
    pub epochs_utc: [String; 2],
    /// Period, minutes.
    pub period_min: f64,
    /// Inclination, deg.
    pub inclination_deg: f64,
    /// Eccentricity.
    pub eccentricity: f64,
    /// Distance of the set next in age from the nearest.
    pub next: Option<Distance>,
    /// The largest distance of any set from the nearest.
    pub furthest: Option<Distance>,
}

/// Contents of files.
#[derive(Debug, Clone, Serialize)]
pub struct Contents {
    /// The time of ages and distances.
    pub at_utc: String,
    /// Sets that cannot be read.
    pub bad_sets: usize,
    /// The objects, by number.
    pub objects: Vec<Object>,
}

impl Contents {
    /// Puts them together.
    pub fn new(held: &[Held<'_>], at: Epoch, bad_sets: usize) -> Self {
        let distance = |apart: Apart| Distance {
            along_s: rounded(apart.along_s),
            along_km: rounded(apart.along_m / 1e3),
            across_km: rounded(apart.across_m / 1e3),
        };
        let object = |held: &Held<'_>| Object {
            norad_id: held.nearest.norad_id,
            name: held.nearest.name.clone(),
            designator: held.nearest.international_designator.clone(),
            sets: held.sets,
            epoch_utc: format_utc(held.nearest.epoch, 3),
            age_days: rounded(held.age_days),
            epochs_utc: [format_utc(held.epochs.0, 3), format_utc(held.epochs.1, 3)],
            period_min: rounded(held.nearest.period_s() / 60.0),
            inclination_deg: held.nearest.inclination_deg,
            eccentricity: held.nearest.eccentricity,
            next: held.next.map(distance),
            furthest: held.furthest.map(distance),
        };
        let objects = held.iter().map(object).collect();
        Self { at_utc: format_utc(at, 0), bad_sets, objects }
    }

    /// Table and JSON.
    ///
    /// # Errors
    /// None: numbers that JSON cannot hold are `null`.
    pub fn product(&self) -> Result<Product, serde_json::Error> {
        let of = |value: fn(&Object) -> f64| self.objects.iter().map(value).collect::<Vec<f64>>();
        let far = |value: fn(&Distance) -> f64| {
            let of_one = |o: &Object| o.furthest.as_ref().map_or(f64::NAN, value);
            self.objects.iter().map(of_one).collect::<Vec<f64>>()
        };
        let names = self.objects.iter().map(|o| o.name.clone().unwrap_or_default());
        let table = Table {
            columns: vec![
                Column::i64(
                    "norad_id",
                    None,
                    self.objects.iter().map(|o| i64::from(o.norad_id)).collect(),
                ),
                Column::text("name", names.collect()),
                Column::text(
                    "epoch_utc",
                    self.objects.iter().map(|o| o.epoch_utc.clone()).collect(),
                ),
                Column::i64("sets", None, self.objects.iter().map(|o| o.sets as i64).collect()),
                Column::f64("age_days", Some("d"), of(|o| o.age_days)),
                Column::f64("period_min", Some("min"), of(|o| o.period_min)),
                Column::f64("inclination_deg", Some("deg"), of(|o| o.inclination_deg)),
                Column::f64("eccentricity", None, of(|o| o.eccentricity)),
                Column::f64("furthest_along_s", Some("s"), far(|d| d.along_s)),
                Column::f64("furthest_along_km", Some("km"), far(|d| d.along_km)),
                Column::f64("furthest_across_km", Some("km"), far(|d| d.across_km)),
            ],
            ..Table::default()
        };
        let json = serde_json::to_value(self)?;
        Ok(Product { name: "elements".into(), table, json, ..Product::default() })
    }

    /// Text for a person.
    pub fn text(&self) -> String {
        let mut text = String::new();
        let several = self.objects.iter().map(|o| o.sets).sum::<usize>();
        let _ = writeln!(
            text,
            "{} objects, {several} sets; ages at {}",
            self.objects.len(),
            self.at_utc
        );
        let _ = writeln!(
            text,
            "{:>9}  {:<24} {:<19}  {:>9}  {:>8}  {:>8}  {:>4}  spread",
            "number", "name", "epoch (UTC)", "age", "period", "incl.", "sets"
        );
        for object in self.objects.iter().take(LISTED) {
            let name: String = object.name.as_deref().unwrap_or("-").chars().take(24).collect();
            let spread = match object.furthest {
                Some(d) => format!("{:+.2} s along, {:.1} km across", d.along_s, d.across_km),
                None => "-".into(),
            };
            let _ = writeln!(
                text,
                "{:>9}  {name:<24} {}  {:>7.2} d  {:>6.1} m  {:>6.2}°  {:>4}  {spread}",
                object.norad_id,
                &object.epoch_utc[..19.min(object.epoch_utc.len())],
                object.age_days,
                object.period_min,
                object.inclination_deg,
                object.sets,
            );
        }
        if self.objects.len() > LISTED {
            let more = self.objects.len() - LISTED;
            let _ = writeln!(text, "… and {more} more: -o FILE.ecsv has all");
        }
        text
    }
}
