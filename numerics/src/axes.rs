//! A number for each of the two axes of a mount.

use serde::{Deserialize, Serialize};

/// Angles, or rates, of the two axes of a mount, in the unit that the context names.
///
/// The first axis is azimuth or hour angle, the second one altitude or declination. It is written as a pair.
///
/// ```
/// use sunglint_numerics::axes::Axes;
///
/// let deg_s = Axes::new(0.5, -0.25);
/// assert_eq!(deg_s.map(f64::abs), Axes::new(0.5, 0.25));
/// assert_eq!((deg_s[0], deg_s[1]), (deg_s.first, deg_s.second));
/// ```
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(into = "[f64; 2]", from = "[f64; 2]")]
pub struct Axes {
    /// The first axis: azimuth, or hour angle.
    pub first: f64,
    /// The second axis: altitude, or declination.
    pub second: f64,
}

impl Axes {
    /// Joins the numbers of the first and of the second axis.
    pub const fn new(first: f64, second: f64) -> Self {
        Self { first, second }
    }

    /// Returns both numbers, the first axis first.
    pub const fn to_array(self) -> [f64; 2] {
        [self.first, self.second]
    }

    /// Returns the numbers that a function makes of these.
    pub fn map(self, function: impl FnMut(f64) -> f64) -> Self {
        self.to_array().map(function).into()
    }
}

impl From<[f64; 2]> for Axes {
    /// Takes the first axis first.
    fn from([first, second]: [f64; 2]) -> Self {
        Self { first, second }
    }
}

impl From<Axes> for [f64; 2] {
    fn from(axes: Axes) -> Self {
        axes.to_array()
    }
}

impl std::ops::Index<usize> for Axes {
    type Output = f64;

    /// Returns the number of axis 0 or 1.
    ///
    /// # Panics
    /// With another axis.
    fn index(&self, axis: usize) -> &f64 {
        [&self.first, &self.second][axis]
    }
}

impl std::ops::IndexMut<usize> for Axes {
    /// Returns the number of axis 0 or 1.
    ///
    /// # Panics
    /// With another axis.
    fn index_mut(&mut self, axis: usize) -> &mut f64 {
        let Self { first, second } = self;
        [first, second][axis]
    }
}
