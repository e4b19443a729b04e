//! The line on the terminal that follows a run.

use crate::output::Console;
use indicatif::ProgressBar;
use std::io::IsTerminal as _;
use sunglint_materials::log::Watch;
use sunglint_materials::retro::measure::{Line, Phase, State};
use sunglint_report::brdf::retro::curve;

/// Angles that the curve on the terminal shows.
const CURVE: usize = 40;

/// A line on the terminal that follows a run, with the curve so far; nothing where there is no terminal.
#[derive(Debug)]
pub struct Live {
    bar: Option<ProgressBar>,
    console: Console,
    phase: Option<Phase>,
    now: Vec<f64>,
    curve: Vec<f64>,
}

impl Live {
    /// Shows a run with so many angles in all, of which some are done.
    pub fn new(angles: u64, done: u64, console: Console) -> Self {
        let terminal = std::io::stderr().is_terminal() && !console.json && !console.quiet;
        let bar = terminal.then(|| {
            let bar = ProgressBar::new(angles).with_position(done);
            let template = "{wide_bar} {pos}/{len} {eta}\n{msg}";
            match indicatif::ProgressStyle::with_template(template) {
                Ok(style) => bar.with_style(style),
                Err(_) => bar,
            }
        });
        Self { bar, console, phase: None, now: vec![], curve: vec![] }
    }
}

impl Watch<Line> for Live {
    fn line(&mut self, line: &Line) {
        if self.phase != Some(line.phase) {
            (self.phase, self.curve) = (Some(line.phase), vec![]);
        }
        match line.state {
            State::Read => self.now.push(line.power_w),
            State::Over => self.now.push(f64::INFINITY),
            State::Again => self.now.clear(),
            State::Kept => {
                let mean = self.now.iter().sum::<f64>() / self.now.len().max(1) as f64;
                self.now.clear();
                self.curve.push(mean);
                let name = match line.phase {
                    Phase::Incident(_) => "incident",
                    Phase::Signature => "no sample",
                    Phase::Sample => "sample",
                };
                if let Some(bar) = &self.bar {
                    bar.inc(1);
                    let from = self.curve.len().saturating_sub(CURVE);
                    let curve = curve(&self.curve[from..]);
                    bar.set_message(format!(
                        "{name} {:8.3}° {mean:.3e} W  {curve}",
                        line.angle_deg
                    ));
                }
            }
        }
    }

    /// Says something above the line.
    fn say(&self, text: &str) {
        match &self.bar {
            Some(bar) => bar.println(text),
            None => self.console.say(text),
        }
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}
