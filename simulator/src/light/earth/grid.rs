//! Albedos on a regular grid of latitudes and longitudes.

use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use sunglint_radiometry::spectrum::{Reflectance, Spectrum, SpectrumError};

/// More values are more than the cap of a globe can use: 8 million are a grid of 0.1° with one layer.
pub(super) const MOST_VALUES: usize = 8_000_000;
/// More layers make more terms than an epoch is worth.
pub const MOST_LAYERS: usize = 16;
/// How far a place may be off the grid that all of them make, of a step: tables are rounded.
const OFF_GRID: f64 = 0.02;
/// Places that are nearer than this are one, degrees.
const SAME_DEG: f64 = 1e-6;

/// Cells of equal steps in latitude and longitude that cover the globe, each with one albedo, or one at each of some wavelengths. A table of zones has one column.
#[derive(Debug, Clone, PartialEq)]
pub struct AlbedoGrid {
    /// The southern edge of the first row, radians; below −π/2 where rows stand on the poles.
    south: f64,
    /// The western edge of the first column, radians.
    west: f64,
    step: [f64; 2],
    rows: usize,
    columns: usize,
    wavelength_nm: Vec<f64>,
    /// `[(row * columns + column) * layers + layer]`.
    values: Vec<f32>,
    /// `[(row * (columns + 1) + column) * layers + layer]`: the integral over solid angle south of a row and west of a column.
    sums: Vec<f64>,
    missing: usize,
}

/// Cells of a table, in any order.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Cells {
    /// Geographic latitude and longitude of their middles, degrees north and east; the longitude is 0 where a table has zones alone.
    pub places_deg: Vec<[f64; 2]>,
    /// The albedos of each, layer by layer; NaN where there is none: cells × layers.
    pub albedo: Vec<f64>,
}

/// Fault of a table: which cell of it (its number in the list), in which column, and why.
#[derive(Debug, Clone, PartialEq)]
pub struct WrongCell {
    /// Number of the cell in the list, where it is one.
    pub cell: Option<usize>,
    /// The quantity: `lat_deg`, `lon_deg`, `albedo`, `wavelength_nm`.
    pub field: &'static str,
    /// Value that was found.
    pub found: String,
    /// Value that was expected.
    pub expected: String,
    /// Advice on what to do.
    pub hint: Option<String>,
}

impl WrongCell {
    fn new(
        cell: impl Into<Option<usize>>,
        field: &'static str,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Self {
        let (cell, found, expected) = (cell.into(), found.into(), expected.into());
        Self { cell, field, found, expected, hint: None }
    }

    fn with_hint(mut self, hint: impl Into<String>) -> Self {
        self.hint = Some(hint.into());
        self
    }
}

/// Middles that are equally far apart.
#[derive(Debug, Clone, Copy)]
struct Axis {
    first: f64,
    step: f64,
}

impl Axis {
    /// Through all of some values, in any order.
    fn through(values: &[f64], field: &'static str) -> Result<Self, WrongCell> {
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        sorted.dedup_by(|a, b| (*a - *b).abs() < SAME_DEG);
        let [first, .., last] = sorted[..] else {
            let found = format!("{} of them", sorted.len());
            return Err(WrongCell::new(None, field, found, "at least two that differ"));
        };
        let least = sorted.windows(2).map(|w| w[1] - w[0]).fold(f64::INFINITY, f64::min);
        let axis = Self { first, step: (last - first) / ((last - first) / least).round() };
        for (number, value) in values.iter().enumerate() {
            let steps = (value - first) / axis.step;
            if (steps - steps.round()).abs() > OFF_GRID {
                let expected =
                    format!("equal steps: {first}° and a multiple of {}° more", axis.step);
                return Err(WrongCell::new(number, field, format!("{value}°"), expected)
                    .with_hint("bring the table onto a regular grid of latitude and longitude"));
            }
        }
        Ok(axis)
    }

    fn steps(&self, value: f64) -> i64 {
        ((value - self.first) / self.step).round() as i64
    }
}

impl AlbedoGrid {
    /// From cells in any order. Longitudes from 0° to 360° and from −180° to 180° are the same; no wavelengths mean one grey layer; `zones` that longitudes do not count.
    /// Rows may have their middles half a step from the poles or on them. What has no value (NaN, or not in the list) gets `missing`.
    ///
    /// # Errors
    /// Places that are none or on no regular grid, cells that stand twice, albedos below 0 or above 1, cells without a value where `missing` is `None`,
    /// wavelengths that do not increase, more than 16 of them, or more than 32 million values.
    pub fn new(
        cells: &Cells,
        wavelength_nm: &[f64],
        zones: bool,
        missing: Option<f64>,
    ) -> Result<Self, WrongCell> {
        let layers = layers(wavelength_nm)?;
        if cells.albedo.len() != layers * cells.places_deg.len() {
            let found = format!("{} for {} cells", cells.albedo.len(), cells.places_deg.len());
            return Err(WrongCell::new(None, "albedo", found, format!("{layers} for each cell")));
        }
        for (number, place) in cells.places_deg.iter().enumerate() {
            check(number, *place, &cells.albedo[number * layers..(number + 1) * layers])?;
        }
        let lats: Vec<f64> = cells.places_deg.iter().map(|p| p[0]).collect();
        let lat = Axis::through(&lats, "lat_deg")?;
        // Cells of the grid below and above the given ones that have a part on the globe.
        let part = |left_deg: f64| ((left_deg / lat.step - 0.5 - OFF_GRID).ceil().max(0.0)) as i64;
        let below = part(lat.first + 90.0);
        let last = lats.iter().map(|deg| lat.steps(*deg)).max().unwrap_or(0);
        let rows = below + last + 1 + part(90.0 - (lat.first + last as f64 * lat.step));
        let (west_deg, columns) = if zones {
            (-180.0, 1)
        } else {
            let lons: Vec<f64> = cells.places_deg.iter().map(|p| wrapped(p[1])).collect();
            let lon = Axis::through(&lons, "lon_deg")?;
            let columns = (360.0 / lon.step).round();
            if (columns * lon.step - 360.0).abs() > 0.5 * lon.step.min(1.0) || columns < 1.0 {
                let found = format!("a step of {}°", lon.step);
                return Err(WrongCell::new(None, "lon_deg", found, "a step that divides 360°"));
            }
            (lon.first - 180.0 / columns, columns as i64)
        };
        let (rows, columns) = (rows as usize, columns as usize);
        let count = rows.saturating_mul(columns);
        if count.saturating_mul(layers) > MOST_VALUES {
            let found = format!("{rows} × {columns} cells with {layers} values each");
            let expected = format!("at most {MOST_VALUES} values");
            return Err(WrongCell::new(None, "albedo", found, expected).with_hint(
                "take means over larger cells: an orbit sees no finer than the cap below it",
            ));
        }
        let step_deg = [lat.step, 360.0 / columns as f64];
        let mut grid = Self {
            south: (lat.first - (below as f64 + 0.5) * lat.step).to_radians(),
            west: west_deg.to_radians(),
            step: step_deg.map(f64::to_radians),
            rows,
            columns,
            wavelength_nm: wavelength_nm.to_vec(),
            values: vec![f32::NAN; count * layers],
            sums: Vec::new(),
            missing: 0,
        };
        let place = |[lat_deg, lon_deg]: [f64; 2]| {
            let row = (below + lat.steps(lat_deg)) as usize;
            let column = match zones {
                true => 0,
                false => ((wrapped(lon_deg) - west_deg) / step_deg[1]).floor() as usize % columns,
            };
            row * columns + column
        };
        grid.fill(cells, place)?;
        grid.complete(missing)?;
        grid.sums = grid.summed();
        Ok(grid)
    }

    fn fill(&mut self, cells: &Cells, place: impl Fn([f64; 2]) -> usize) -> Result<(), WrongCell> {
        let layers = self.layers();
        let albedo = |number: usize| &cells.albedo[number * layers..(number + 1) * layers];
        let mut given = vec![usize::MAX; self.rows * self.columns];
        for (number, [lat_deg, lon_deg]) in cells.places_deg.iter().enumerate() {
            let at = place([*lat_deg, *lon_deg]);
            let before = given[at];
            if before != usize::MAX {
                // A meridian that closes the map stands at both of its ends.
                let seam = ((cells.places_deg[before][1] - lon_deg).abs() - 360.0).abs() < SAME_DEG;
                let mut pairs = albedo(before).iter().zip(albedo(number));
                if seam && pairs.all(|(a, b)| a == b || a.is_nan() && b.is_nan()) {
                    continue;
                }
                let found = format!("{lat_deg}° north, {lon_deg}° east twice");
                return Err(WrongCell::new(number, "lat_deg", found, "each cell once")
                    .with_hint("longitudes that are 360° apart are one"));
            }
            given[at] = number;
            let values = &mut self.values[at * layers..(at + 1) * layers];
            values.iter_mut().zip(albedo(number)).for_each(|(to, from)| *to = *from as f32);
        }
        Ok(())
    }

    /// Gives a value to cells without one.
    fn complete(&mut self, missing: Option<f64>) -> Result<(), WrongCell> {
        let layers = self.layers();
        let bare = |cell: &&[f32]| cell.iter().any(|v| v.is_nan());
        self.missing = self.values.chunks_exact(layers).filter(bare).count();
        let Some(first) = self.values.chunks_exact(layers).position(|c| bare(&c)) else {
            return Ok(());
        };
        let Some(instead) = missing else {
            let (row, column) = (first / self.columns, first % self.columns);
            let middle =
                |edge: f64, k: usize, step: f64| (edge + (k as f64 + 0.5) * step).to_degrees();
            let lat = middle(self.south, row, self.step[0]).clamp(-90.0, 90.0);
            let mut where_ = format!("at {lat:.3}° north");
            if self.columns > 1 {
                let lon = wrapped(middle(self.west, column, self.step[1]));
                where_ = format!("{where_}, {lon:.3}° east");
            }
            let found = format!(
                "no value for {} of {} cells, the first {where_}",
                self.missing,
                self.rows * self.columns
            );
            return Err(WrongCell::new(None, "albedo", found, "albedos that cover the Earth")
                .with_hint("say what stands for those without one, such as missing = 0.3"));
        };
        self.values.iter_mut().filter(|v| v.is_nan()).for_each(|v| *v = instead as f32);
        Ok(())
    }

    /// How many layers it has.
    pub fn layers(&self) -> usize {
        self.wavelength_nm.len().max(1)
    }

    /// Rows and columns.
    pub fn size(&self) -> (usize, usize) {
        (self.rows, self.columns)
    }

    /// Cells to which a value was given that the table does not have.
    pub fn missing(&self) -> usize {
        self.missing
    }

    /// The wavelengths of the layers, nm; none where it is grey.
    pub fn wavelengths_nm(&self) -> &[f64] {
        &self.wavelength_nm
    }

    /// First and last wavelength at which it is known, nm.
    pub fn known_nm(&self) -> (f64, f64) {
        match self.wavelength_nm[..] {
            [first, .., last] => (first, last),
            _ => super::GREY_NM,
        }
    }

    /// The albedos of each layer at a place: a unit vector in the axes of the Earth (ITRS). Its latitude is that of the vertical, as if the Earth were a sphere.
    pub fn at(&self, toward: DVec3) -> &[f32] {
        let lat = toward.z.clamp(-1.0, 1.0).asin();
        let lon = toward.y.atan2(toward.x);
        let row = ((lat - self.south) / self.step[0]).max(0.0) as usize;
        let column = ((lon - self.west).rem_euclid(TAU) / self.step[1]) as usize;
        let at = row.min(self.rows - 1) * self.columns + column.min(self.columns - 1);
        &self.values[at * self.layers()..(at + 1) * self.layers()]
    }

    /// Adds to `out` the mean of each layer over a box of some side (radians) around a place: from parallel to parallel and from meridian to meridian, or, at a pole, all around it.
    pub(super) fn around(&self, toward: DVec3, side: f64, out: &mut Vec<f64>) {
        let lat = toward.z.clamp(-1.0, 1.0).asin();
        let lon = toward.y.atan2(toward.x);
        let [low, high] = [-0.5, 0.5].map(|half| (lat + half * side).clamp(-FRAC_PI_2, FRAC_PI_2));
        let pole = low == -FRAC_PI_2 || high == FRAC_PI_2;
        let half = if pole { PI } else { (0.5 * side / lat.cos()).min(PI) };
        let area = 2.0 * half * (high.sin() - low.sin());
        if area.is_nan() || area <= 0.0 {
            out.extend(self.at(toward).iter().map(|v| f64::from(*v)));
            return;
        }
        let [from, to] = [low, high].map(|lat| self.row_of(lat));
        let [west, east] = [-half, half].map(|half| (lon + half - self.west) / self.step[1]);
        for layer in 0..self.layers() {
            let sum = |row, column| self.sum_to(row, column, layer);
            out.push((sum(to, east) - sum(to, west) - sum(from, east) + sum(from, west)) / area);
        }
    }

    /// A latitude as a row, and the part of that row below it, by area.
    fn row_of(&self, lat: f64) -> (usize, f64) {
        let row = (((lat - self.south) / self.step[0]).max(0.0) as usize).min(self.rows - 1);
        let [low, high] = [row, row + 1].map(|row| self.edge(row));
        (row, ((lat.sin() - low) / (high - low)).clamp(0.0, 1.0))
    }

    /// The sine of the southern edge of a row.
    fn edge(&self, row: usize) -> f64 {
        (self.south + row as f64 * self.step[0]).clamp(-FRAC_PI_2, FRAC_PI_2).sin()
    }

    /// The integral of a layer over solid angle, south of a latitude and from the first meridian to a column (which may lie beyond the last, or before the first).
    fn sum_to(&self, (row, part): (usize, f64), column: f64, layer: usize) -> f64 {
        let turns = (column / self.columns as f64).floor();
        let column = column - turns * self.columns as f64;
        let whole = (column as usize).min(self.columns - 1);
        let rest = column - whole as f64;
        let at = |row: usize, column: usize| {
            self.sums[(row * (self.columns + 1) + column) * self.layers() + layer]
        };
        let along = |row: usize| {
            let (a, b) = (at(row, whole), at(row, whole + 1));
            turns * at(row, self.columns) + a + rest * (b - a)
        };
        let (a, b) = (along(row), along(row + 1));
        a + part * (b - a)
    }

    /// Sums over solid angle, from the south and the west.
    fn summed(&self) -> Vec<f64> {
        let (layers, across) = (self.layers(), self.columns + 1);
        let mut sums = vec![0.0; (self.rows + 1) * across * layers];
        for row in 0..self.rows {
            let area = (self.edge(row + 1) - self.edge(row)) * self.step[1];
            let mut along = vec![0.0; layers];
            for column in 0..self.columns {
                for (l, along) in along.iter_mut().enumerate() {
                    *along +=
                        area * f64::from(self.values[(row * self.columns + column) * layers + l]);
                    let below = sums[(row * across + column + 1) * layers + l];
                    sums[((row + 1) * across + column + 1) * layers + l] = below + *along;
                }
            }
        }
        sums
    }

    /// The least and the largest albedo of any layer.
    pub fn range(&self) -> (f64, f64) {
        let fold = |(least, most): (f32, f32), v: &f32| (least.min(*v), most.max(*v));
        let (least, most) = self.values.iter().fold((1.0, 0.0), fold);
        (f64::from(least), f64::from(most))
    }

    /// The mean over the globe of each layer.
    pub fn means(&self) -> Vec<f64> {
        let all = self.sums.chunks_exact(self.layers()).next_back().unwrap_or(&[]);
        all.iter().map(|sum| sum / (4.0 * PI)).collect()
    }

    /// The spectrum that stands before each layer: 1 of a grey one, else 1 at its own wavelength and 0 at all others.
    ///
    /// # Errors
    /// None, since wavelengths increase.
    pub fn spectra(&self) -> Result<Vec<Spectrum<Reflectance>>, SpectrumError> {
        let nm = &self.wavelength_nm;
        if nm.is_empty() {
            return Ok(vec![Spectrum::constant(1.0, super::GREY_NM.0, super::GREY_NM.1)?]);
        }
        let hat = |l: usize| (0..nm.len()).map(|k| if k == l { 1.0 } else { 0.0 }).collect();
        (0..nm.len()).map(|l| Spectrum::new(nm.clone(), hat(l))).collect()
    }

    /// The same at one wavelength, held beyond the first and the last.
    pub(super) fn factors(&self, nm: f64) -> Vec<f64> {
        let all = &self.wavelength_nm;
        let mut factors = vec![0.0; self.layers()];
        match all.partition_point(|w| *w <= nm) {
            0 => factors[0] = 1.0,
            k if k == all.len() => factors[k - 1] = 1.0,
            k => {
                let up = (nm - all[k - 1]) / (all[k] - all[k - 1]);
                (factors[k - 1], factors[k]) = (1.0 - up, up);
            }
        }
        factors
    }
}

/// A longitude from −180° to below 180°.
fn wrapped(lon_deg: f64) -> f64 {
    (lon_deg + 180.0).rem_euclid(360.0) - 180.0
}

/// How many layers some wavelengths make.
fn layers(wavelength_nm: &[f64]) -> Result<usize, WrongCell> {
    let wrong =
        |found: String, expected: &str| WrongCell::new(None, "wavelength_nm", found, expected);
    let bad = wavelength_nm.iter().find(|nm| !(nm.is_finite() && **nm > 0.0));
    if let Some(bad) = bad {
        return Err(wrong(format!("{bad} nm"), "a wavelength above 0"));
    }
    if let Some(pair) = wavelength_nm.windows(2).find(|w| w[0] >= w[1]) {
        let found = format!("{} nm after {} nm", pair[1], pair[0]);
        return Err(wrong(found, "wavelengths that increase"));
    }
    match wavelength_nm.len() {
        1 => Err(wrong(
            format!("{} nm alone", wavelength_nm[0]),
            "at least two wavelengths, or none",
        )
        .with_hint("one says nothing of others: call its albedo grey, or give another")),
        n if n > MOST_LAYERS => {
            let expected = format!("at most {MOST_LAYERS} wavelengths");
            Err(wrong(format!("{n} of them"), &expected))
        }
        n => Ok(n.max(1)),
    }
}

fn check(number: usize, [lat_deg, lon_deg]: [f64; 2], albedo: &[f64]) -> Result<(), WrongCell> {
    if !(-90.0..=90.0).contains(&lat_deg) {
        let expected = "a latitude from -90° to 90°";
        return Err(WrongCell::new(number, "lat_deg", format!("{lat_deg}°"), expected));
    }
    if !(-360.0..=360.0).contains(&lon_deg) {
        let expected = "a longitude from -180° to 180°, or from 0° to 360°";
        return Err(WrongCell::new(number, "lon_deg", format!("{lon_deg}°"), expected));
    }
    let wrong = |v: &&f64| !v.is_nan() && !(0.0..=1.0).contains(*v);
    if let Some(value) = albedo.iter().find(wrong) {
        let error = WrongCell::new(number, "albedo", value.to_string(), "an albedo from 0 to 1");
        let hint = match *value {
            v if (1.0..=100.0).contains(&v) => "a table in per cent is to be divided by 100",
            _ => "what stands for no value in the table has to be NaN",
        };
        return Err(error.with_hint(hint));
    }
    Ok(())
}
