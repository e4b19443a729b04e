//! Fits of passes whose truth is known.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

mod box_wing;
mod linear;
mod minima;
mod night;
mod sphere;
mod thinned;
mod wandering;

/// P(at most `hits` of n at 0.95 each), and P(at least).
fn binomial(hits: u64, n: u64) -> (f64, f64) {
    let log = |k: u64| (1..=k).map(|i| (i as f64).ln()).sum::<f64>();
    let term = |k: u64| {
        let ways = log(n) - log(k) - log(n - k);
        (ways + k as f64 * 0.95_f64.ln() + (n - k) as f64 * 0.05_f64.ln()).exp()
    };
    ((0..=hits).map(term).sum(), (hits..=n).map(term).sum())
}
