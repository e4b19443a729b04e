//! A table of single observations: one row a moment, with its target's place and perhaps its site.

use super::{EXPOSURE_S, MOST_SAMPLES, Reader};
use crate::pass::Observation;
use crate::pass::keys::{PassKeys, TimesKeys};
use glam::DVec3;
use hifitime::Epoch;
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use sunglint_ephemeris::orbit::{Orbit, Snapshot, Tle, TleOrbit, elements, seconds_between};
use sunglint_formats::photometry::{self, ColumnNames, ColumnTimes};
use sunglint_formats::{FileError, ParseError, Table, Values};
use sunglint_radiometry::constants::LIGHT_M_PER_S;
use sunglint_radiometry::sky::{EarthOrientation, Geodetic, Horizontal, Observer, Site, SkyFrames};

/// Columns of directions from the site.
const DIRECTION: [&str; 2] = ["azimuth_deg", "altitude_deg"];
/// Columns of how far along that direction, and what makes metres of them.
const FAR: [(&str, f64); 4] =
    [("range_km", 1e3), ("range_m", 1.0), ("height_km", 1e3), ("height_m", 1.0)];
/// Columns of places in the GCRS.
const POSITION: [&str; 3] = ["x_km", "y_km", "z_km"];
/// Columns of velocities in the GCRS.
const VELOCITY: [&str; 3] = ["vx_km_s", "vy_km_s", "vz_km_s"];
/// Columns of places over the ground.
const OVER: [&str; 3] = ["sat_lat_deg", "sat_lon_deg", "sat_height_km"];
/// Columns of the site.
const SITE: [&str; 3] = ["site_lat_deg", "site_lon_deg", "site_height_m"];
/// Distances of what is observed from the Earth, m.
const RANGE_M: std::ops::RangeInclusive<f64> = 1e3..=1e9;

/// A table of observations whose places are still to be worked out.
pub(super) struct Rows {
    path: PathBuf,
    table: Table,
    pub times: Vec<Epoch>,
    pub exposure_s: Vec<f64>,
    pub notes: Vec<String>,
}

/// Kind of place that the columns give.
enum Kind {
    /// Azimuth, altitude, and a range (m) or a height (m).
    Direction { azimuth: Vec<f64>, altitude: Vec<f64>, far_m: Vec<f64>, is_height: bool },
    /// GCRS, m.
    Position(Vec<DVec3>),
    /// Over the ground.
    Over(Vec<DVec3>),
    /// Elements, by catalogue number.
    Elements(Vec<Arc<TleOrbit>>),
}

impl Reader<'_> {
    /// Reads the table that `[times] table` names.
    pub(super) fn rows(&mut self, keys: &TimesKeys, file: &str) -> Result<Rows, FileError> {
        if keys.file.is_some() || keys.from.is_some() || keys.to.is_some() || keys.step_s.is_some()
        {
            let expected = "either table, or file, or from, to and step_s";
            return Err(self.error("times.table", expected).into());
        }
        let (table, path) = self.any_table("times.table", file)?;
        // Columns without rows are of no kind: this comes first.
        if !(1..=MOST_SAMPLES).contains(&table.rows()) {
            let found = format!("{} rows", table.rows());
            let expected = format!("1 to {MOST_SAMPLES} observations");
            return Err(ParseError::new(path, found, expected).into());
        }
        let Some(ColumnTimes { time: times, notes }) =
            photometry::column_times(&path, &table, &ColumnNames::default())?
        else {
            let names: Vec<&str> = table.columns.iter().map(|c| c.name.as_str()).collect();
            let found = format!("the columns {}", names.join(", "));
            let expected = format!("a column of times: {}", photometry::TIME_COLUMNS);
            return Err(ParseError::new(path, found, expected).into());
        };
        let exposure_s = match (keys.exposure_s, table.column("exposure_s").is_ok()) {
            (Some(exposure), _) => vec![exposure.get(); times.len()],
            (None, false) => vec![EXPOSURE_S; times.len()],
            (None, true) => {
                let own = |s: f64| s > 0.0;
                numbers(&path, &table, "exposure_s", "s", "an exposure above 0 s", own)?
            }
        };
        Ok(Rows { path, table, times, exposure_s, notes })
    }

    /// Works out where the targets are.
    pub(super) fn observations(
        &mut self,
        rows: &Rows,
        keys: &PassKeys,
        station: &Site,
        orientation: &EarthOrientation,
    ) -> Result<(Vec<Arc<Observation>>, Vec<String>), FileError> {
        let (path, table, n) = (&rows.path, &rows.table, rows.times.len());
        let has = |name: &str| table.column(name).is_ok();
        let all = |names: &[&str]| names.iter().all(|c| has(c));
        if let Some(missing) = SITE.iter().find(|c| !has(c)).filter(|_| SITE.iter().any(|c| has(c)))
        {
            return Err(lacks(path, missing, &SITE).into());
        }
        let sites: Vec<Option<Site>> = match all(&SITE) {
            true => sites(path, table)?.into_iter().map(Some).collect(),
            false => vec![None; n],
        };
        let velocities = match VELOCITY.iter().any(|c| has(c)) {
            true => Some(vectors(path, table, VELOCITY, "km/s", 1e3)?),
            false => None,
        };
        let kind = self.kind(rows, keys)?;
        if let (Kind::Elements(_), Some(_)) = (&kind, &velocities) {
            let found = "velocities beside elements";
            return Err(ParseError::new(path, found, "no vx_km_s").in_field("vx_km_s").into());
        }
        let names = names(table, n);
        let sky = |e: &dyn std::fmt::Display, i: usize| {
            ParseError::new(path, e.to_string(), "a place of the target")
                .in_field(format!("row {}", i + 1))
        };
        let frames = SkyFrames::among(&rows.times, orientation).map_err(|e| sky(&e, 0))?;
        let one = |i: usize| -> Result<Arc<Observation>, ParseError> {
            let velocity = velocities.as_ref().map(|v| v[i]);
            let snapshot = |position: DVec3| {
                Snapshot::new(names[i].clone(), rows.times[i], position, velocity)
                    .map(Orbit::from)
                    .map_err(|e| sky(&e, i))
            };
            let observer = || {
                let frame = frames.at(rows.times[i]).map_err(|e| sky(&e, i))?;
                Ok::<_, ParseError>(Observer::new(frame, sites[i].as_ref().unwrap_or(station)))
            };
            let orbit = match &kind {
                Kind::Elements(orbits) => Orbit::from(TleOrbit::clone(&orbits[i])),
                Kind::Position(places) => snapshot(places[i])?,
                Kind::Over(places) => {
                    let [latitude_deg, longitude_deg, height_m] = places[i].to_array();
                    let over = Geodetic { latitude_deg, longitude_deg, height_m };
                    let itrs = over.to_itrs_m().map_err(|e| sky(&e, i))?;
                    snapshot(observer()?.frame().itrs_to_gcrs() * itrs)?
                }
                Kind::Direction { azimuth, altitude, far_m, is_height } => {
                    let observer = observer()?;
                    let line = sight(&observer, Horizontal::new(azimuth[i], altitude[i]));
                    let range_m = match is_height {
                        false => far_m[i],
                        true => range_to(&observer, line, far_m[i]).ok_or_else(|| {
                            let found = format!("a height of {} km", far_m[i] / 1e3);
                            let expected = format!(
                                "a height that the line of sight at an altitude of {}° meets",
                                altitude[i]
                            );
                            ParseError::new(path, found, expected)
                                .in_field(format!("row {}", i + 1))
                        })?,
                    };
                    let place = observer.position_gcrs_m() + range_m * line;
                    // The place is where the light left: with a velocity it is moved to when the light arrived.
                    let later = velocity.map_or(DVec3::ZERO, |v| range_m / LIGHT_M_PER_S * v);
                    snapshot(place + later)?
                }
            };
            Ok(Arc::new(Observation { object: names[i].clone(), orbit, site: sites[i] }))
        };
        let places: Vec<Result<_, ParseError>> = (0..n).into_par_iter().map(one).collect();
        let places = places.into_iter().collect::<Result<Vec<_>, _>>()?;
        let mut warnings = rows.notes.clone();
        let far = FAR.iter().map(|(name, _)| *name).filter(|name| rows.table.column(name).is_ok());
        let far: Vec<&str> = far.collect();
        if let (Kind::Direction { .. }, [used, rest @ ..]) = (&kind, &far[..])
            && !rest.is_empty()
        {
            let rest = rest.join(" and ");
            warnings.push(format!("the table of observations says in several columns how far the target is: {used} is used, {rest} is not"));
        }
        if velocities.is_none() && !matches!(kind, Kind::Elements(_)) {
            warnings.push("the table of observations has no velocities (vx_km_s, vy_km_s, vz_km_s): places are where the light left, nothing moves within an exposure, and an attitude along the velocity is not known".into());
        }
        Ok((places, warnings))
    }

    fn kind(&mut self, rows: &Rows, keys: &PassKeys) -> Result<Kind, FileError> {
        let (path, table) = (&rows.path, &rows.table);
        let has = |name: &str| table.column(name).is_ok();
        let given = [
            ("azimuth_deg and altitude_deg", DIRECTION.iter().any(|c| has(c))),
            ("x_km, y_km, z_km", POSITION.iter().any(|c| has(c))),
            ("sat_lat_deg, sat_lon_deg, sat_height_km", OVER.iter().any(|c| has(c))),
        ];
        let mut kinds = given.iter().filter(|(_, given)| *given).map(|(name, _)| *name);
        let (kind, other) = (kinds.next(), kinds.next());
        if let (Some(kind), Some(other)) = (kind, other) {
            let found = format!("{kind} and also {other}");
            return Err(ParseError::new(path, found, "one of them").into());
        }
        if kind.is_some() && (keys.orbit.is_some() || keys.ephemeris.is_some()) {
            let key = if keys.orbit.is_some() { "orbit" } else { "ephemeris" };
            let expected = "no orbit beside the places of [times] table";
            return Err(self.error(key, expected).into());
        }
        if given[1].1 {
            return Ok(Kind::Position(vectors(path, table, POSITION, "km", 1e3)?));
        }
        if given[2].1 {
            let missing = OVER.iter().find(|c| !has(c));
            if let Some(missing) = missing {
                return Err(lacks(path, missing, &OVER).into());
            }
            let latitude =
                numbers(path, table, OVER[0], "deg", "from -90 to 90", |v| v.abs() <= 90.0)?;
            let longitude = numbers(path, table, OVER[1], "deg", "from -180 to 360", |v| {
                (-180.0..=360.0).contains(&v)
            })?;
            let height = numbers(path, table, OVER[2], "km", "from 1 to 1000000 km", |v| {
                RANGE_M.contains(&(1e3 * v))
            })?;
            let place = |i: usize| DVec3::new(latitude[i], longitude[i], 1e3 * height[i]);
            return Ok(Kind::Over((0..height.len()).map(place).collect()));
        }
        if given[0].1 {
            if let Some(missing) = DIRECTION.iter().find(|c| !has(c)) {
                return Err(lacks(path, missing, &DIRECTION).into());
            }
            // Ranges before heights: those are what was observed.
            let Some((name, metres)) = FAR.iter().find(|(name, _)| has(name)) else {
                let found = "no distance of the target";
                let expected = "a column range_km, range_m, height_km or height_m";
                return Err(ParseError::new(path, found, expected).into());
            };
            let unit = name.rsplit('_').next().unwrap_or_default();
            let far_m = |v: f64| RANGE_M.contains(&(metres * v));
            let far = numbers(path, table, name, unit, "a distance from 1 to 1000000 km", far_m)?;
            return Ok(Kind::Direction {
                azimuth: numbers(path, table, DIRECTION[0], "deg", "from -360 to 360", |v| {
                    v.abs() <= 360.0
                })?,
                altitude: numbers(path, table, DIRECTION[1], "deg", "from -90 to 90", |v| {
                    v.abs() <= 90.0
                })?,
                far_m: far.iter().map(|v| metres * v).collect(),
                is_height: name.starts_with("height"),
            });
        }
        if has("norad_id") && keys.orbit.as_ref().is_some_and(|o| o.tle.is_some()) {
            return self.elements(rows, keys).map(Kind::Elements);
        }
        let names: Vec<&str> = table.columns.iter().map(|c| c.name.as_str()).collect();
        let found = format!("the columns {}", names.join(", "));
        let expected = "where the target is: azimuth_deg, altitude_deg and range_km or height_km; or x_km, y_km, z_km (GCRS); or sat_lat_deg, sat_lon_deg, sat_height_km; \
                        or norad_id beside [orbit] tle";
        Err(ParseError::new(path, found, expected).into())
    }

    /// Elements of each row's object, those nearest in time.
    fn elements(&mut self, rows: &Rows, keys: &PassKeys) -> Result<Vec<Arc<TleOrbit>>, FileError> {
        let Some(orbit) = &keys.orbit else { return Ok(Vec::new()) };
        let Some(file) = &orbit.tle else { return Ok(Vec::new()) };
        if orbit.norad_id.is_some() || orbit.name.is_some() {
            let expected = "no norad_id or name where the table has norad_id";
            return Err(self.error("orbit", expected).into());
        }
        let (text, path) = self.text("orbit.tle", file)?;
        let (good, mut bad) = elements::parse_lenient(&path, &text);
        if good.is_empty() && !bad.is_empty() {
            return Err(bad.swap_remove(0).into());
        }
        let mut sets = std::collections::HashMap::<u32, Vec<&Tle>>::new();
        good.iter().for_each(|t| sets.entry(t.norad_id).or_default().push(t));
        let ids = numbers(&rows.path, &rows.table, "norad_id", "", "a catalogue number", |v| {
            v >= 0.0 && v < f64::from(u32::MAX) && v.fract() == 0.0
        })?;
        let mut made = std::collections::HashMap::<*const Tle, Arc<TleOrbit>>::new();
        let mut orbits = Vec::with_capacity(ids.len());
        for (i, id) in ids.iter().enumerate() {
            let near = rows.times[i];
            let age = |t: &&&Tle| seconds_between(t.epoch, near).abs();
            // Checked above.
            let nearest = sets
                .get(&(*id as u32))
                .and_then(|own| own.iter().min_by(|a, b| age(a).total_cmp(&age(b))));
            let Some(nearest) = nearest else {
                let found = format!("{id}: no elements in {}", path.display());
                let error = ParseError::new(&rows.path, found, "an object with elements");
                return Err(error.in_field(format!("norad_id, row {}", i + 1)).into());
            };
            let orbit = match made.entry(std::ptr::from_ref::<Tle>(nearest)) {
                std::collections::hash_map::Entry::Occupied(known) => known.get().clone(),
                std::collections::hash_map::Entry::Vacant(new) => {
                    let orbit = TleOrbit::new((*nearest).clone()).map_err(|e| {
                        self.error("orbit", "elements of an orbit").with_hint(e.to_string())
                    })?;
                    new.insert(Arc::new(orbit)).clone()
                }
            };
            orbits.push(orbit);
        }
        Ok(orbits)
    }
}

/// The straight line, GCRS, along which light comes from where a target is seen: aberration by the observer's own velocity taken off.
fn sight(observer: &Observer, seen: Horizontal) -> DVec3 {
    let (s, beta) =
        (observer.gcrs_direction_of(seen), observer.velocity_gcrs_m_s() / LIGHT_M_PER_S);
    let along = s.dot(beta);
    let length = along + (1.0 - beta.length_squared() + along * along).sqrt();
    (length * s - beta).normalize()
}

/// Distance (m) along a line of sight (GCRS) at which it leaves a height (m) above the ellipsoid; `None` where it never does.
fn range_to(observer: &Observer, line: DVec3, height_m: f64) -> Option<f64> {
    let gcrs_to_itrs = observer.frame().gcrs_to_itrs();
    let (from, along) = (observer.site().itrs_m(), gcrs_to_itrs * line);
    let height = |range_m: f64| {
        Geodetic::from_itrs_m(from + range_m * along).ok().map(|g| g.height_m - height_m)
    };
    // Far out the height grows with the range; the last crossing is bracketed from there.
    let (mut low, mut high) = (0.0, 2.0 * (height_m + 2.0 * from.length()));
    if height(0.0)? >= 0.0 || height(high)? <= 0.0 {
        return None;
    }
    // From 6e8 m to a tenth of a millimetre is a factor of 2^43.
    for _ in 0..64 {
        let middle = 0.5 * (low + high);
        if height(middle)? > 0.0 { high = middle } else { low = middle }
    }
    Some(0.5 * (low + high))
}

fn lacks(path: &Path, missing: &str, of: &[&str]) -> ParseError {
    let expected = format!("all of {}", of.join(", "));
    ParseError::new(path, "no such column", expected).in_field(missing)
}

/// A column of numbers that all are as they should be.
fn numbers(
    path: &Path,
    table: &Table,
    name: &str,
    unit: &str,
    expected: &str,
    good: impl Fn(f64) -> bool,
) -> Result<Vec<f64>, ParseError> {
    let values = table.quantity(name, unit).map_err(|e| e.in_file(path))?;
    match values.iter().position(|v| !v.is_finite() || !good(*v)) {
        None => Ok(values.into_owned()),
        Some(i) => Err(ParseError::new(path, values[i].to_string(), expected)
            .in_field(format!("{name}, row {}", i + 1))),
    }
}

fn vectors(
    path: &Path,
    table: &Table,
    names: [&str; 3],
    unit: &str,
    scale: f64,
) -> Result<Vec<DVec3>, ParseError> {
    if let Some(missing) = names.iter().find(|c| table.column(c).is_err()) {
        return Err(lacks(path, missing, &names));
    }
    let finite = |_| true;
    let [x, y, z] = [0, 1, 2].map(|k| numbers(path, table, names[k], unit, "a number", finite));
    let (x, y, z) = (x?, y?, z?);
    let inside = |v: &DVec3| unit == "km" && v.length() < 6.2e6;
    let made: Vec<DVec3> = (0..x.len()).map(|i| scale * DVec3::new(x[i], y[i], z[i])).collect();
    match made.iter().position(inside) {
        None => Ok(made),
        Some(i) => {
            let found = format!("{:.3} km from the Earth's centre", made[i].length() / 1e3);
            let error = ParseError::new(path, found, "a place outside the Earth, km");
            Err(error.in_field(format!("{}, row {}", names[0], i + 1)))
        }
    }
}

fn sites(path: &Path, table: &Table) -> Result<Vec<Site>, ParseError> {
    let read = |k: usize, unit: &str| numbers(path, table, SITE[k], unit, "a number", |_| true);
    let (latitude, longitude, height) = (read(0, "deg")?, read(1, "deg")?, read(2, "m")?);
    let site = |i: usize| {
        let geodetic = Geodetic {
            latitude_deg: latitude[i],
            longitude_deg: longitude[i],
            height_m: height[i],
        };
        Site::new(geodetic).map_err(|e| {
            ParseError::new(path, e.to_string(), "a site on the Earth").in_field(format!(
                "{}, row {}",
                SITE[0],
                i + 1
            ))
        })
    };
    (0..latitude.len()).map(site).collect()
}

/// Names of the objects, row by row.
fn names(table: &Table, rows: usize) -> Vec<String> {
    for name in ["object", "satellite", "norad_id", "name"] {
        match table.column(name).map(|c| &c.values) {
            Ok(Values::Text(texts)) => {
                return texts.iter().map(|t| t.clone().unwrap_or_default()).collect();
            }
            Ok(Values::I64(numbers)) => {
                let text = |n: &Option<i64>| n.map(|n| n.to_string()).unwrap_or_default();
                return numbers.iter().map(text).collect();
            }
            _ => {}
        }
    }
    vec!["target".to_owned(); rows]
}
