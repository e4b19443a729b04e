//! Numbers that stand for a missing magnitude, and uncertainties that are none.

/// Magnitudes beyond it are words for a missing one (99.99, 999).
const MOST_MAG: f64 = 90.0;
/// Numbers that some programs write for a missing magnitude, where no true one lies within [`LONE_MAG`].
const WORDS_FOR_NONE: [f64; 4] = [0.0, -9.99, -9.999, -9.9999];
/// Distance of such a number from the nearest true magnitude, mag.
const LONE_MAG: f64 = 1.0;

/// Makes NaN of the numbers that stand for a missing magnitude, and returns the note on how many there were. Give it magnitudes with a zero point alone: any difference may be a true one.
pub fn without_words_for_none(magnitudes: &mut [f64]) -> Option<String> {
    let is_word = |m: f64| WORDS_FOR_NONE.iter().any(|w| (m - w).abs() < 1e-9);
    let far = |m: f64| m.abs() > MOST_MAG;
    let lone: Vec<f64> = WORDS_FOR_NONE
        .into_iter()
        .filter(|w| {
            let own = || magnitudes.iter().filter(|m| m.is_finite() && !far(**m));
            let mut true_ones = own().filter(|m| !is_word(**m)).peekable();
            true_ones.peek().is_some() && true_ones.all(|m| (m - w).abs() > LONE_MAG)
        })
        .collect();
    let mut lost = 0;
    for m in magnitudes.iter_mut() {
        if far(*m) || lone.iter().any(|w| (*m - w).abs() < 1e-9) {
            *m = f64::NAN;
            lost += 1;
        }
    }
    (lost > 0).then(|| {
        format!(
            "{lost} magnitudes are words for a missing one (beyond ±90, or -9.99 or 0 far from all others): left out"
        )
    })
}

/// Makes NaN of uncertainties that are none (0, below 0 or infinite), and returns the warning that names the first of their rows, counted from 1. NaN stands for "not stated" already. Give it all rows of
/// the file, and which of them are taken (`None`: all): the others stay as they are and do not count.
pub fn without_false_uncertainties(sigma: &mut [f64], taken: Option<&[bool]>) -> Option<String> {
    let is_taken = |row: usize| taken.is_none_or(|t| t.get(row).copied().unwrap_or(false));
    let of = (0..sigma.len()).filter(|row| is_taken(*row)).count();
    let mut found = None;
    let mut lost = 0;
    for (row, s) in sigma.iter_mut().enumerate() {
        if is_taken(row) && (*s <= 0.0 || s.is_infinite()) {
            found.get_or_insert((row, *s));
            *s = f64::NAN;
            lost += 1;
        }
    }
    let (first, value) = found?;
    Some(format!(
        "uncertainties that are not above 0 and finite: {lost} of {} (the first: {value} in row {}); these rows count as rows without one",
        of,
        first + 1
    ))
}
