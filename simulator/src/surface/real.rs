//! Numbers that carry their derivatives, so that one formula serves both.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// Operations that a formula needs of its numbers.
pub(crate) trait Real:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// A number that does not change.
    fn constant(value: f64) -> Self;
    /// Without its derivatives.
    fn value(self) -> f64;
    /// The square root; its derivatives at 0 are given as 0.
    fn sqrt(self) -> Self;
    /// e to the power of it.
    fn exp(self) -> Self;
    /// The error function.
    fn erf(self) -> Self;
    /// 1 minus it.
    fn erfc(self) -> Self;
}

impl Real for f64 {
    fn constant(value: f64) -> Self {
        value
    }
    fn value(self) -> f64 {
        self
    }
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }
    fn exp(self) -> Self {
        f64::exp(self)
    }
    fn erf(self) -> Self {
        libm::erf(self)
    }
    fn erfc(self) -> Self {
        libm::erfc(self)
    }
}

/// A dual number: a value and its derivatives in `N` directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Dual<const N: usize> {
    /// The value.
    pub value: f64,
    /// The derivatives.
    pub slope: [f64; N],
}

impl<const N: usize> Dual<N> {
    /// The variable of direction `k`.
    pub fn variable(value: f64, k: usize) -> Self {
        let mut slope = [0.0; N];
        slope[k] = 1.0;
        Self { value, slope }
    }

    /// A function of it, by the function's value and derivative.
    fn chain(self, value: f64, rate: f64) -> Self {
        Self { value, slope: self.slope.map(|s| rate * s) }
    }

    fn join(self, other: Self, value: f64, a: f64, b: f64) -> Self {
        Self { value, slope: std::array::from_fn(|k| a * self.slope[k] + b * other.slope[k]) }
    }
}

impl<const N: usize> Add for Dual<N> {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        self.join(o, self.value + o.value, 1.0, 1.0)
    }
}

impl<const N: usize> Sub for Dual<N> {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        self.join(o, self.value - o.value, 1.0, -1.0)
    }
}

impl<const N: usize> Mul for Dual<N> {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        self.join(o, self.value * o.value, o.value, self.value)
    }
}

impl<const N: usize> Div for Dual<N> {
    type Output = Self;
    fn div(self, o: Self) -> Self {
        let quotient = self.value / o.value;
        self.join(o, quotient, 1.0 / o.value, -quotient / o.value)
    }
}

impl<const N: usize> Neg for Dual<N> {
    type Output = Self;
    fn neg(self) -> Self {
        self.chain(-self.value, -1.0)
    }
}

impl<const N: usize> Real for Dual<N> {
    fn constant(value: f64) -> Self {
        Self { value, slope: [0.0; N] }
    }
    fn value(self) -> f64 {
        self.value
    }
    fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        self.chain(root, if root > 0.0 { 0.5 / root } else { 0.0 })
    }
    fn exp(self) -> Self {
        let power = self.value.exp();
        self.chain(power, power)
    }
    fn erf(self) -> Self {
        self.chain(libm::erf(self.value), bell(self.value))
    }
    fn erfc(self) -> Self {
        self.chain(libm::erfc(self.value), -bell(self.value))
    }
}

/// d erf(x)/dx.
fn bell(x: f64) -> f64 {
    std::f64::consts::FRAC_2_SQRT_PI * (-x * x).exp()
}
