//! The virtual observatory against closed forms.
#![allow(clippy::unwrap_used, reason = "helper functions of tests")]

mod events;
mod frames;
mod night;

/// Mean and variance of numbers.
fn moments(values: &[f64]) -> (f64, f64) {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let square = |value: &f64| (value - mean).powi(2);
    (mean, values.iter().map(square).sum::<f64>() / (values.len() - 1) as f64)
}
