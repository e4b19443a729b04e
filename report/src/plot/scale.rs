//! Scale of an axis: places of values, ticks and their labels.

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use std::ops::Range;

/// An axis with its ends and ticks fixed: what is labelled is chosen here, not by the drawing library, whose labels repeat.
#[derive(Debug, Clone)]
pub(super) struct Scale {
    lo: f64,
    hi: f64,
    log: bool,
    inverted: bool,
    ticks: Vec<f64>,
}

/// So many characters of labels stand beside one another under a panel without touching.
const CHARACTERS: usize = 80;

impl Scale {
    /// An axis along the bottom: as many labels as there is room for.
    pub(super) fn horizontal((lo, hi): (f64, f64), log: bool) -> Self {
        let fits = |ticks: &Vec<f64>| {
            labels(ticks).iter().map(|l| l.chars().count() + 2).sum::<usize>() <= CHARACTERS
        };
        let choices = [10, 8, 6, 5, 4, 3];
        let ticks = choices.iter().map(|most| ticks(lo, hi, log, *most)).find(fits);
        Self { lo, hi, log, inverted: false, ticks: ticks.unwrap_or_else(|| vec![lo]) }
    }

    /// An axis along the side.
    pub(super) fn vertical((lo, hi): (f64, f64), log: bool) -> Self {
        Self { lo, hi, log, inverted: false, ticks: ticks(lo, hi, log, 10) }
    }

    /// The same axis, the other way round where that is asked for.
    pub(super) fn turned(mut self, inverted: bool) -> Self {
        self.inverted = inverted;
        self
    }

    /// The values that are labelled.
    pub(super) fn ticks(&self) -> &[f64] {
        &self.ticks
    }

    /// The label of one of the ticks, in the form that all of them have.
    pub(super) fn label(&self, value: f64) -> String {
        label(value, Form::of(&self.ticks))
    }

    /// First and last value.
    pub(super) fn ends(&self) -> (f64, f64) {
        (self.lo, self.hi)
    }

    /// Returns the place of a value: 0 at the first end, 1 at the last.
    pub(super) fn fraction(&self, value: f64) -> f64 {
        let place = |v: f64| if self.log { v.ln() } else { v };
        let fraction = (place(value) - place(self.lo)) / (place(self.hi) - place(self.lo));
        if self.inverted { 1.0 - fraction } else { fraction }
    }
}

impl Ranged for Scale {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, (from, to): (i32, i32)) -> i32 {
        // A cast of a float saturates, and what is drawn lies within.
        from + (f64::from(to - from) * self.fraction(*value)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, _: Hint) -> Vec<f64> {
        self.ticks.clone()
    }

    fn range(&self) -> Range<f64> {
        self.lo..self.hi
    }
}

// The axes are drawn with [`Scale::label`]: the drawing library asks for this one, too.
impl ValueFormatter<f64> for Scale {
    fn format(value: &f64) -> String {
        label(*value, Form::of(&[*value]))
    }
}

/// Round numbers from `lo` to `hi`, at most about `most`, each the float nearest to a short decimal.
///
/// ```
/// use sunglint_report::plot::{labels, ticks};
///
/// let ticks = ticks(0.0, 1.0, false, 6);
/// assert!(ticks.windows(2).all(|pair| pair[1] > pair[0]));
/// assert!(labels(&ticks).iter().all(|label| label.len() <= 4));
/// ```
pub fn ticks(lo: f64, hi: f64, log: bool, most: usize) -> Vec<f64> {
    if log {
        let inside = |v: &f64| (lo..=hi).contains(v);
        // Powers of ten run over less than 700, from the smallest float to the largest.
        let (first, last) = (lo.log10().floor() as i32, hi.log10().ceil() as i32);
        for mantissas in [&[1, 2, 3, 4, 5, 6, 7, 8, 9][..], &[1, 2, 5], &[1, 3], &[1]] {
            let all = (first..=last).flat_map(|k| mantissas.iter().map(move |m| decimal(*m, k)));
            let ticks: Vec<f64> = all.filter(inside).collect();
            if (3..=most).contains(&ticks.len()) {
                return ticks;
            }
        }
        let stride = (last - first) as usize / most + 1;
        let ticks: Vec<f64> =
            (first..=last).step_by(stride).map(|k| decimal(1, k)).filter(inside).collect();
        if ticks.len() >= 3 {
            return ticks;
        }
        // Less than a decade, between its round numbers: as on a linear axis.
    }
    let raw = (hi - lo) / most as f64;
    let mut exponent = raw.log10().floor() as i32;
    let mut mantissa = 1;
    for wanted in [1, 2, 5, 10] {
        mantissa = wanted;
        if decimal(wanted, exponent) >= raw * (1.0 - 1e-9) {
            break;
        }
    }
    if mantissa == 10 {
        (mantissa, exponent) = (1, exponent + 1);
    }
    let step = decimal(mantissa, exponent);
    // An axis' span is never below 1e-12 of its ends (`Axis::extent`), so the counts are exact.
    let (first, last) = ((lo / step - 1e-6).ceil() as i64, (hi / step + 1e-6).floor() as i64);
    (first..=last).map(|n| decimal(n * mantissa, exponent)).collect()
}

/// The float nearest to a decimal: what its shortest text gives back.
fn decimal(mantissa: i64, exponent: i32) -> f64 {
    // A text of this form is always a number.
    format!("{mantissa}e{exponent}").parse().unwrap_or(f64::NAN)
}

/// Form of the labels of an axis: one for all of them.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Form {
    /// 0.001, 1000.
    Plain,
    /// 1e-3, 1e3.
    Powers,
}

impl Form {
    /// Plain where all values are short that way.
    fn of(ticks: &[f64]) -> Self {
        let is_short = |v: &f64| *v == 0.0 || (1e-4..1e6).contains(&v.abs());
        if ticks.iter().all(is_short) { Self::Plain } else { Self::Powers }
    }
}

/// The labels of an axis: each the shortest text of the axis' form that gives its value back. Either all have powers of ten, or none has.
///
/// ```
/// use sunglint_report::plot::labels;
///
/// assert_eq!(labels(&[1e-5, 1e-3, 0.1]), ["1e-5", "1e-3", "1e-1"]);
/// assert_eq!(labels(&[0.0, 0.5]), ["0", "0.5"]);
/// ```
pub fn labels(ticks: &[f64]) -> Vec<String> {
    let form = Form::of(ticks);
    ticks.iter().map(|tick| label(*tick, form)).collect()
}

fn label(value: f64, form: Form) -> String {
    match form {
        _ if value == 0.0 => "0".into(),
        Form::Plain => value.to_string(),
        Form::Powers => format!("{value:e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    /// Truth: a label read back is its tick. The ranges go over all sizes, spans and offsets that a figure can have.
    #[test]
    fn labels_differ_and_are_true() {
        for exponent in [-30, -12, -11, -5, -3, -1, 0, 1, 3, 4, 5, 6, 8, 12, 30] {
            for (from, to) in [(0.48, 3.1), (-1.0, 1.0), (0.0, 7.3), (-0.31, -0.302), (1.0, 40.0)] {
                for log in [false, true] {
                    let power = 10_f64.powi(exponent);
                    let (lo, hi) = (from * power, to * power);
                    if log && lo <= 0.0 {
                        continue;
                    }
                    for scale in [Scale::horizontal((lo, hi), log), Scale::vertical((lo, hi), log)]
                    {
                        let labels = labels(&scale.ticks);
                        let case = format!("{lo} to {hi}, log {log}: {labels:?}");
                        assert!((3..=12).contains(&labels.len()), "{case}");
                        let different: HashSet<&String> = labels.iter().collect();
                        assert_eq!(different.len(), labels.len(), "{case}");
                        for (text, tick) in labels.iter().zip(&scale.ticks) {
                            let read: f64 = text.parse().unwrap();
                            assert!((read - tick).abs() <= 1e-6 * tick.abs(), "{case}");
                            assert!(text.len() < 11, "{case}");
                            let place = scale.fraction(*tick);
                            assert!((-1e-6..=1.0 + 1e-6).contains(&place), "{case}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn ticks_are_where_people_want_them() {
        let of = |lo, hi, log| -> Vec<String> { labels(&Scale::vertical((lo, hi), log).ticks) };
        assert_eq!(
            of(4e-12, 3.1e-11, false),
            ["5e-12", "1e-11", "1.5e-11", "2e-11", "2.5e-11", "3e-11"]
        );
        let log = of(4.8e7, 7e8, true);
        assert!(log.contains(&"1e8".to_owned()) && log.contains(&"5e8".to_owned()), "{log:?}");
        assert_eq!(of(1e-3, 1e3, true), ["0.001", "0.01", "0.1", "1", "10", "100", "1000"]);
        assert_eq!(of(1.0, 1.1, true)[..2], ["1", "1.01"]);
        assert_eq!(of(1e-300, 1e300, true).len(), 10);
        assert_eq!(labels(&[0.25, -0.0]), ["0.25", "0"]);
        // One axis has one form, whichever way its ends lie.
        assert_eq!(
            of(1e-6, 1e2, true),
            ["1e-6", "1e-5", "1e-4", "1e-3", "1e-2", "1e-1", "1e0", "1e1", "1e2"]
        );
        assert_eq!(of(0.0, 1.2e6, false)[..3], ["0", "2e5", "4e5"]);
    }
}
