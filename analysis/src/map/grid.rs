//! Cells on a sphere, and what samples have in them.

use glam::DVec3;
use ndarray::Array2;

/// Why there is no map.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GridError {
    /// A step that is none.
    #[error("steps of {step_deg}°: expected from 0.1° to 90°")]
    Step {
        /// Step that was given.
        step_deg: f64,
    },
    /// Lists that do not match.
    #[error("{values} values at {places} places: expected as many")]
    Length {
        /// Values.
        values: usize,
        /// Places.
        places: usize,
    },
    /// A table that has not the shape of the grid.
    #[error("{rows} x {columns} values on a grid of {grid_rows} x {grid_columns} cells")]
    Shape {
        /// Rows given.
        rows: usize,
        /// Columns given.
        columns: usize,
        /// Rows of the grid.
        grid_rows: usize,
        /// Columns of the grid.
        grid_columns: usize,
    },
}

/// The bisector of two directions; `None` where they are opposite, and every direction across them would be one.
pub fn phase_vector(sun: DVec3, observer: DVec3) -> Option<DVec3> {
    let sum = sun.try_normalize()? + observer.try_normalize()?;
    (sum.length() > 1e-9).then(|| sum.normalize())
}

/// Longitude east of the x axis, −180 to 180, and latitude above the xy-plane of a direction, degrees. At the poles the longitude is 0.
///
/// ```
/// use glam::DVec3;
/// use sunglint_analysis::map::longitude_latitude;
///
/// assert_eq!(longitude_latitude(DVec3::Y), (90.0, 0.0));
/// assert_eq!(longitude_latitude(DVec3::NEG_Z), (0.0, -90.0));
/// ```
pub fn longitude_latitude(direction: DVec3) -> (f64, f64) {
    let across = direction.x.hypot(direction.y);
    let longitude = if across > 0.0 { direction.y.atan2(direction.x).to_degrees() } else { 0.0 };
    (longitude, direction.z.atan2(across).to_degrees())
}

/// Cells of equal steps in longitude and latitude: rows from the south pole, columns from −180°.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Grid {
    rows: usize,
}

impl Grid {
    /// Steps of `step_deg` or a little less.
    ///
    /// # Errors
    /// Less than 0.1° or more than 90°.
    pub fn new(step_deg: f64) -> Result<Self, GridError> {
        if !(0.1..=90.0).contains(&step_deg) {
            return Err(GridError::Step { step_deg });
        }
        // At most 1,800; what 180/step exceeds a whole number by rounding is none.
        Ok(Self { rows: (180.0 / step_deg - 1e-9).ceil() as usize })
    }

    /// Rows and columns.
    pub fn dim(&self) -> (usize, usize) {
        (self.rows, 2 * self.rows)
    }

    /// The step that it has, degrees.
    pub fn step_deg(&self) -> f64 {
        180.0 / self.rows as f64
    }

    /// Longitude and latitude of the middle of a cell, degrees.
    pub fn middle(&self, (row, column): (usize, usize)) -> (f64, f64) {
        let step = self.step_deg();
        ((column as f64 + 0.5) * step - 180.0, (row as f64 + 0.5) * step - 90.0)
    }

    /// The unit vector there.
    pub fn direction(&self, cell: (usize, usize)) -> DVec3 {
        let (longitude, latitude) = self.middle(cell);
        let (sin_l, cos_l) = longitude.to_radians().sin_cos();
        let (sin_b, cos_b) = latitude.to_radians().sin_cos();
        DVec3::new(cos_b * cos_l, cos_b * sin_l, sin_b)
    }

    /// The cell of a place (any longitude, latitude from −90 to 90); `None` where it is no number.
    pub fn cell(&self, (longitude_deg, latitude_deg): (f64, f64)) -> Option<(usize, usize)> {
        if !(longitude_deg.is_finite() && (-90.0..=90.0).contains(&latitude_deg)) {
            return None;
        }
        let step = self.step_deg();
        let (rows, columns) = self.dim();
        // Both are in range but for the last edge, which belongs to the last cell.
        let row = (((latitude_deg + 90.0) / step) as usize).min(rows - 1);
        let column = (((longitude_deg + 180.0).rem_euclid(360.0) / step) as usize).min(columns - 1);
        Some((row, column))
    }

    /// The part of the sphere that a cell of a row covers.
    pub fn share(&self, row: usize) -> f64 {
        let edge = |k: usize| (k as f64 * self.step_deg() - 90.0).to_radians().sin();
        0.5 * (edge(row + 1) - edge(row)) / (2 * self.rows) as f64
    }
}

/// Coverage of a map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coverage {
    /// Cells with a value.
    pub filled: usize,
    /// Cells without one.
    pub empty: usize,
    /// The part of the sphere that the filled ones cover.
    pub share: f64,
    /// Samples that are in no cell: no number, or no place.
    pub left_out: usize,
}

/// A value between the middles of cells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interpolated {
    /// The value.
    pub value: f64,
    /// The largest difference among the values that it lies between: what the grid is too coarse for.
    pub spread: f64,
}

/// Map of a body: statistics of the samples in each cell.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyMap {
    /// Cells.
    pub grid: Grid,
    /// Mean value; NaN in an empty cell.
    pub mean: Array2<f64>,
    /// Standard deviation of the samples about it; NaN with fewer than two.
    pub scatter: Array2<f64>,
    /// Number of samples.
    pub count: Array2<u32>,
    /// Samples that are in no cell.
    pub left_out: usize,
}

impl BodyMap {
    /// Samples at places (longitude, latitude; degrees). What is no number, or has no place, is counted and left out.
    ///
    /// # Errors
    /// More or fewer values than places.
    pub fn of(grid: Grid, places: &[(f64, f64)], values: &[f64]) -> Result<Self, GridError> {
        if places.len() != values.len() {
            return Err(GridError::Length { values: values.len(), places: places.len() });
        }
        let dim = grid.dim();
        let mut map = Self {
            grid,
            mean: Array2::zeros(dim),
            scatter: Array2::zeros(dim),
            count: Array2::zeros(dim),
            left_out: 0,
        };
        for (place, value) in places.iter().zip(values) {
            let Some(cell) = grid.cell(*place).filter(|_| value.is_finite()) else {
                map.left_out += 1;
                continue;
            };
            // Welford's running mean: no sum of squares that cancels.
            map.count[cell] += 1;
            let before = value - map.mean[cell];
            map.mean[cell] += before / f64::from(map.count[cell]);
            map.scatter[cell] += before * (value - map.mean[cell]);
        }
        for (cell, count) in map.count.indexed_iter() {
            if *count == 0 {
                map.mean[cell] = f64::NAN;
            }
            map.scatter[cell] = match count {
                0 | 1 => f64::NAN,
                n => (map.scatter[cell] / f64::from(n - 1)).sqrt(),
            };
        }
        Ok(map)
    }

    /// A map whose cells are known, one value each; NaN where there is none.
    ///
    /// # Errors
    /// Another shape than the grid's.
    pub fn full(grid: Grid, mean: Array2<f64>) -> Result<Self, GridError> {
        let (grid_rows, grid_columns) = grid.dim();
        let (rows, columns) = mean.dim();
        if (rows, columns) != (grid_rows, grid_columns) {
            return Err(GridError::Shape { rows, columns, grid_rows, grid_columns });
        }
        let count = mean.mapv(|v| u32::from(v.is_finite()));
        let scatter = Array2::from_elem(mean.dim(), f64::NAN);
        Ok(Self { grid, mean, scatter, count, left_out: 0 })
    }

    /// Returns its coverage.
    pub fn coverage(&self) -> Coverage {
        let filled = self.count.iter().filter(|c| **c > 0).count();
        let rows = self.count.rows().into_iter().enumerate();
        let share = rows.map(|(row, counts)| {
            counts.iter().filter(|c| **c > 0).count() as f64 * self.grid.share(row)
        });
        Coverage {
            filled,
            empty: self.count.len() - filled,
            share: share.sum(),
            left_out: self.left_out,
        }
    }

    /// The value at a place, linear in longitude and latitude between the middles of the four cells about it, around the date line and across the poles; `None` where
    /// one of those that count is empty.
    pub fn at(&self, (longitude_deg, latitude_deg): (f64, f64)) -> Option<Interpolated> {
        self.grid.cell((longitude_deg, latitude_deg))?;
        let step = self.grid.step_deg();
        let (rows, columns) = self.grid.dim();
        let y = (latitude_deg + 90.0) / step - 0.5;
        let x = (longitude_deg + 180.0).rem_euclid(360.0) / step - 0.5;
        let (below, left) = (y.floor(), x.floor());
        let (mut value, mut low, mut high) = (0.0, f64::INFINITY, f64::NEG_INFINITY);
        for (up, wy) in [(0.0, 1.0 - (y - below)), (1.0, y - below)] {
            for (right, wx) in [(0.0, 1.0 - (x - left)), (1.0, x - left)] {
                if wx * wy == 0.0 {
                    continue;
                }
                let row = below + up;
                // Beyond a pole the first row goes on, half around.
                let over = row < 0.0 || row >= rows as f64;
                let row = row.clamp(0.0, (rows - 1) as f64) as usize;
                let turn = if over { rows as f64 } else { 0.0 };
                let column = (left + right + turn).rem_euclid(columns as f64) as usize;
                let here = self.mean[(row, column.min(columns - 1))];
                if !here.is_finite() {
                    return None;
                }
                value += wx * wy * here;
                (low, high) = (low.min(here), high.max(here));
            }
        }
        Some(Interpolated { value, spread: high - low })
    }
}
