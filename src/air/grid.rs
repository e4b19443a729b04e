//! Which wavelengths are asked for, checked before anything is allocated.

use super::AirArgs;
use anyhow::bail;
use sunglint_radiometry::air::survey::{AirGrid, TABLES_NM};

/// So many values are held at once at most: 160 MB, three times that with a figure and a JSON document.
const MOST_VALUES: f64 = 2e7;

impl AirArgs {
    /// The ends and the step, nm. Ends that were not given are drawn in to whole nm that wide means leave room for.
    fn range_nm(&self) -> (f64, f64, f64) {
        let step = self.step_nm.unwrap_or(1.0);
        let half = if self.points { 0.0 } else { step / 2.0 };
        let (first, last) = (TABLES_NM.0 + half, TABLES_NM.1 - half);
        let whole = |nm: f64| if (first..=last).contains(&nm) { nm } else { (first + last) / 2.0 };
        let from = self.from_nm.unwrap_or_else(|| whole(first.ceil().max(300.0)));
        let to = self.to_nm.unwrap_or_else(|| whole(last.floor().min(1240.0)));
        (from, to, step)
    }

    /// Whether the wavelengths are the person's own, not the usual ones.
    pub(super) fn asks_for_wavelengths(&self) -> bool {
        self.from_nm.is_some() || self.to_nm.is_some() || self.step_nm.is_some()
    }

    /// The wavelengths that were asked for; says which option is wrong, and within what it would be right.
    pub(super) fn grid(&self) -> anyhow::Result<AirGrid> {
        let (from, to, step) = self.range_nm();
        for (option, value) in [("--from-nm", from), ("--to-nm", to), ("--step-nm", step)] {
            if !value.is_finite() {
                bail!("{option} {value} is no wavelength; expected a number of nm");
            }
        }
        let (lowest, highest) = TABLES_NM;
        let half = if self.points { 0.0 } else { step / 2.0 };
        if step <= 0.0 || half > (highest - lowest) / 2.0 {
            bail!("--step-nm {step}: expected more than 0 and at most {:.3} nm", highest - lowest);
        }
        let (first, last) = (lowest + half, highest - half);
        let outside = |option: &str, value: f64| {
            let means = if self.points {
                String::new()
            } else {
                format!(
                    " for means over {step} nm (the tables cover {lowest:.3} to {highest} nm, and a mean needs half a step on both sides; \
                     --points gives values instead)"
                )
            };
            let hint = if value > 0.0 && value < 5.0 { "; is it in micrometres?" } else { "" };
            anyhow::anyhow!(
                "{option} {value} nm is outside {first:.3} to {last:.3} nm, which can be had{means}{hint}"
            )
        };
        // A bound is met where its three printed digits are.
        let inside = |nm: f64| nm >= first - 5e-4 && nm <= last + 5e-4;
        if !inside(from) {
            return Err(outside("--from-nm", from));
        }
        if to < 5.0 {
            return Err(outside("--to-nm", to));
        }
        if from > to {
            bail!("--from-nm {from} is above --to-nm {to}: no wavelength lies between them");
        }
        let steps = ((to - from) / step + 1e-9).floor();
        if !inside(from + steps * step) {
            return Err(outside("--to-nm", to));
        }
        // Each value that is held: the total, and with --components seven parts.
        let columns = if self.components { 8.0 } else { 1.0 };
        let values = (steps + 1.0) * self.zenith.len() as f64 * columns;
        if values > MOST_VALUES {
            bail!(
                "{:.0} wavelengths at {} zenith angles{} are {values:.3e} values, more than {MOST_VALUES:.0e}: take a larger --step-nm \
                 (the model resolves no more than 20 cm-1, 0.5 nm at 500 nm) or fewer angles at once",
                steps + 1.0,
                self.zenith.len(),
                if self.components { " with 7 constituents each" } else { "" },
            );
        }
        // The count is bounded above; the rounding takes the noise of the multiplication away, as in 300.40000000000003.
        let nm = |i: u32| ((from + f64::from(i) * step).clamp(first, last) * 1e9).round() / 1e9;
        let nm = (0..=steps as u32).map(nm).map(|nm| nm.clamp(first, last)).collect();
        Ok(AirGrid { nm, mean_nm: (!self.points).then_some(step) })
    }
}
