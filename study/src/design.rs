//! How the values of parameters are combined into points.

use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;
use serde::Deserialize;

/// More points are a slip of a number; so many fit into any memory.
pub const MOST_POINTS: usize = 1_000_000;
/// Points of a Sobol sequence at most: its generator has no more.
pub const MOST_SOBOL_POINTS: usize = 1 << 16;
/// Parameters of a Sobol sequence at most.
pub const MOST_SOBOL_PARAMETERS: usize = sobol_burley::NUM_DIMENSIONS as usize;

/// Value of a scene's key.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum Value {
    /// A truth value.
    Truth(bool),
    /// A whole number.
    Integer(i64),
    /// A number.
    Number(f64),
    /// A text: a name, a file, a time.
    Text(String),
    /// Several numbers: an axis, a colour.
    Numbers(Vec<f64>),
}

impl Value {
    /// The value as TOML.
    pub fn toml(&self) -> toml::Value {
        match self {
            Self::Truth(truth) => (*truth).into(),
            Self::Integer(integer) => (*integer).into(),
            Self::Number(number) => (*number).into(),
            Self::Text(text) => text.as_str().into(),
            Self::Numbers(numbers) => numbers.clone().into(),
        }
    }

    /// The value as a number, where it is one.
    pub fn number(&self) -> Option<f64> {
        match self {
            // Whole numbers of a scene are small: counts and catalogue numbers.
            Self::Integer(integer) => Some(*integer as f64),
            Self::Number(number) => Some(*number),
            Self::Truth(_) | Self::Text(_) | Self::Numbers(_) => None,
        }
    }
}

impl std::fmt::Display for Value {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Text(text) => f.write_str(text),
            other => write!(f, "{}", other.toml()),
        }
    }
}

/// How a range of numbers is divided.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Scale {
    /// Equal steps.
    #[default]
    Linear,
    /// Equal factors.
    Log,
}

/// Numbers from one to another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Range {
    /// The least.
    pub from: f64,
    /// The largest.
    pub to: f64,
    /// How it is divided.
    pub scale: Scale,
}

impl Range {
    /// The number at a share from 0 to 1 of the range.
    pub fn at(&self, share: f64) -> f64 {
        match self.scale {
            Scale::Linear => self.from + (self.to - self.from) * share,
            Scale::Log => (self.from.ln() + (self.to / self.from).ln() * share).exp(),
        }
    }

    /// Numbers from the first to the last, both of them exactly, divided evenly; the first alone for one.
    pub fn steps(&self, count: usize) -> Vec<f64> {
        let last = count.saturating_sub(1);
        (0..count)
            .map(|i| match i {
                0 => self.from,
                i if i == last => self.to,
                i => self.at(i as f64 / last as f64),
            })
            .collect()
    }
}

/// Every combination of the values, the last parameter's changing fastest; `None` where there are more than [`MOST_POINTS`].
///
/// ```
/// use sunglint_study::design::{Value, grid};
///
/// let points = grid(&[vec![Value::Integer(1), Value::Integer(2)], vec![Value::Truth(true), Value::Truth(false)]]).unwrap();
/// assert_eq!(points[1], [Value::Integer(1), Value::Truth(false)]);
/// ```
pub fn grid(values: &[Vec<Value>]) -> Option<Vec<Vec<Value>>> {
    let of = values.iter().try_fold(1_usize, |n, v| n.checked_mul(v.len()))?;
    if of > MOST_POINTS {
        return None;
    }
    let point = |mut i: usize| {
        let mut point: Vec<Value> = values
            .iter()
            .rev()
            .map(|values| {
                let value = values[i % values.len()].clone();
                i /= values.len();
                value
            })
            .collect();
        point.reverse();
        point
    };
    Some((0..of).map(point).collect())
}

/// A Latin hypercube: of `count` equal strata of each range, every one is met once (McKay, Beckman, Conover 1979, Technometrics 21, 239).
///
/// The same seed gives the same points, whatever the machine.
pub fn latin(ranges: &[Range], count: usize, seed: u64) -> Vec<Vec<Value>> {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut points = vec![Vec::with_capacity(ranges.len()); count];
    for range in ranges {
        let mut strata: Vec<usize> = (0..count).collect();
        // Fisher and Yates, written out: a library's shuffle may change with its version.
        for i in (1..count).rev() {
            let other = (random.random::<f64>() * (i + 1) as f64) as usize;
            strata.swap(i, other.min(i));
        }
        for (point, stratum) in points.iter_mut().zip(strata) {
            let share = (stratum as f64 + random.random::<f64>()) / count as f64;
            point.push(Value::Number(range.at(share)));
        }
    }
    points
}

/// Sobol's sequence, Owen-scrambled (Burley 2020, JCGT 9(4), 1), with numbers good to 2⁻²⁴ of the range.
///
/// At most [`MOST_SOBOL_POINTS`] points of [`MOST_SOBOL_PARAMETERS`] ranges: beyond these the caller has refused.
pub fn sobol(ranges: &[Range], count: usize, seed: u64) -> Vec<Vec<Value>> {
    // Both halves of the seed take part.
    let seed = (seed ^ (seed >> 32)) as u32;
    (0..count as u32)
        .map(|i| {
            let share = |dimension: u32| f64::from(sobol_burley::sample(i, dimension, seed));
            ranges.iter().zip(0..).map(|(range, d)| Value::Number(range.at(share(d)))).collect()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const RANGES: [Range; 2] = [
        Range { from: 2.0, to: 4.0, scale: Scale::Linear },
        Range { from: 1e-3, to: 1.0, scale: Scale::Log },
    ];

    fn share(range: &Range, value: &Value) -> f64 {
        let value = value.number().expect("a number");
        match range.scale {
            Scale::Linear => (value - range.from) / (range.to - range.from),
            Scale::Log => (value / range.from).ln() / (range.to / range.from).ln(),
        }
    }

    /// Truth: the definition. Each of the 64 strata of each range has exactly one point.
    #[test]
    fn a_latin_hypercube_meets_every_stratum_once() {
        let points = latin(&RANGES, 64, 7);
        for (p, range) in RANGES.iter().enumerate() {
            let mut met: Vec<usize> =
                points.iter().map(|point| (share(range, &point[p]) * 64.0) as usize).collect();
            met.sort_unstable();
            assert_eq!(met, (0..64).collect::<Vec<_>>());
        }
        assert_eq!(points, latin(&RANGES, 64, 7));
        assert_ne!(points, latin(&RANGES, 64, 8));
        // The two columns are not the same order: |correlation| of 64 random pairs is below 0.5 but for one in 30,000.
        let mean = |f: &dyn Fn(&Vec<Value>) -> f64| points.iter().map(f).sum::<f64>() / 64.0;
        let both = mean(&|p| share(&RANGES[0], &p[0]) * share(&RANGES[1], &p[1]));
        assert!((12.0 * (both - 0.25)).abs() < 0.5, "{both}");
    }

    /// Truth: a (0, m, 2) net in base 2 has one of 2^m points in each of 2^m boxes of equal area, whatever their shape (Niederreiter 1992, definition 4.1).
    #[test]
    fn sobols_points_are_a_net() {
        let points = sobol(&RANGES, 64, 3);
        for (across, down) in [(64, 1), (32, 2), (16, 4), (8, 8), (4, 16), (2, 32), (1, 64)] {
            let mut met: Vec<usize> = points
                .iter()
                .map(|p| {
                    let [x, y] = [share(&RANGES[0], &p[0]), share(&RANGES[1], &p[1])];
                    (x * across as f64 + 1e-9) as usize * down + (y * down as f64 + 1e-9) as usize
                })
                .collect();
            met.sort_unstable();
            assert_eq!(met, (0..64).collect::<Vec<_>>(), "{across} by {down}");
        }
    }

    #[test]
    fn steps_end_exactly() {
        let range = Range { from: 0.1, to: 0.7, scale: Scale::Linear };
        let steps = range.steps(4);
        assert_eq!((steps[0], steps[3]), (0.1, 0.7));
        assert!((steps[1] - 0.3).abs() < 1e-15);
        assert_eq!(range.steps(1), [0.1]);
        let log = Range { from: 1.0, to: 1000.0, scale: Scale::Log }.steps(4);
        assert!((log[1] - 10.0).abs() < 1e-12 && log[3] == 1000.0);
    }

    #[test]
    fn too_many_combinations_are_no_grid() {
        let values: Vec<Value> = (0..3000).map(Value::Integer).collect();
        assert!(grid(&[values.clone(), values.clone(), values]).is_none());
    }
}
