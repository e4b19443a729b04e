//! A lamp that flashes into camera and counters alike: by it the camera's times are held against the counter's.

use super::options::LampOptions;
use std::ops::Range;

/// Flashes of equal length whose gaps repeat in turn.
#[derive(Debug, Clone, PartialEq)]
pub struct Lamp {
    /// Length of a flash, s.
    on_s: f64,
    /// Begins of the flashes of a round, s after it began.
    begins_s: Vec<f64>,
    /// Length of a round, s.
    round_s: f64,
}

impl Lamp {
    /// The lamp of a night; `None` where none is on.
    pub fn new(options: &LampOptions) -> Option<Self> {
        if options.e_per_px_s <= 0.0 && options.hz <= 0.0 {
            return None;
        }
        let mut round_s = 0.0;
        let mut begins_s = Vec::with_capacity(options.gaps_s.len());
        for gap_s in &options.gaps_s {
            begins_s.push(round_s);
            round_s += gap_s;
        }
        (round_s > 0.0).then_some(Self { on_s: options.on_s, begins_s, round_s })
    }

    /// Time for which the lamp is on within a span, s; both s from the night's begin, where the first round begins.
    ///
    /// ```
    /// use sunglint_virtual::observatory::lamp::Lamp;
    /// use sunglint_virtual::observatory::options::LampOptions;
    ///
    /// let options = LampOptions { e_per_px_s: 1.0, on_s: 0.1, gaps_s: vec![0.5, 0.7], ..LampOptions::default() };
    /// let lamp = Lamp::new(&options).ok_or("no lamp")?;
    /// // Flashes at 0, 0.5, 1.2, 1.7 s, …
    /// assert!((lamp.on_within_s(0.05..0.55) - 0.1).abs() < 1e-12);
    /// assert_eq!(lamp.on_within_s(0.61..1.2), 0.0);
    /// # Ok::<(), &str>(())
    /// ```
    pub fn on_within_s(&self, span_s: Range<f64>) -> f64 {
        self.on_until_s(span_s.end) - self.on_until_s(span_s.start)
    }

    /// Time for which it was on since the night's begin; negative before it.
    fn on_until_s(&self, time_s: f64) -> f64 {
        let rounds = (time_s / self.round_s).floor();
        let within = time_s - rounds * self.round_s;
        let on = |begin: &f64| (within - begin).clamp(0.0, self.on_s);
        rounds * self.on_s * self.begins_s.len() as f64 + self.begins_s.iter().map(on).sum::<f64>()
    }
}
