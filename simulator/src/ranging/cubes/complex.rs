//! Complex numbers, as many operations as the fields of a cube need.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// A complex number.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Complex {
    pub re: f64,
    pub im: f64,
}

pub(super) fn real(re: f64) -> Complex {
    Complex { re, im: 0.0 }
}

impl Complex {
    pub fn new(re: f64, im: f64) -> Self {
        Self { re, im }
    }

    /// e^(iφ).
    pub fn turn(phase_rad: f64) -> Self {
        let (im, re) = phase_rad.sin_cos();
        Self { re, im }
    }

    pub fn norm_sqr(self) -> f64 {
        self.re * self.re + self.im * self.im
    }

    /// The root whose imaginary part is not below 0: a wave e^(−iωt) that fades behind a surface.
    pub fn root(self) -> Self {
        let size = self.re.hypot(self.im);
        let im = (0.5 * (size - self.re)).max(0.0).sqrt();
        let re = (0.5 * (size + self.re)).max(0.0).sqrt();
        Self { re: if self.im < 0.0 { -re } else { re }, im }
    }
}

impl Add for Complex {
    type Output = Self;
    fn add(self, b: Self) -> Self {
        Self { re: self.re + b.re, im: self.im + b.im }
    }
}

impl Sub for Complex {
    type Output = Self;
    fn sub(self, b: Self) -> Self {
        Self { re: self.re - b.re, im: self.im - b.im }
    }
}

impl Neg for Complex {
    type Output = Self;
    fn neg(self) -> Self {
        Self { re: -self.re, im: -self.im }
    }
}

impl Mul for Complex {
    type Output = Self;
    fn mul(self, b: Self) -> Self {
        Self { re: self.re * b.re - self.im * b.im, im: self.re * b.im + self.im * b.re }
    }
}

impl Mul<f64> for Complex {
    type Output = Self;
    fn mul(self, b: f64) -> Self {
        Self { re: self.re * b, im: self.im * b }
    }
}

impl Div for Complex {
    type Output = Self;
    fn div(self, b: Self) -> Self {
        self * Self { re: b.re, im: -b.im } * b.norm_sqr().recip()
    }
}
