//! Units as suffixes of keys: which two keys differ only in their unit, and by what factor.

/// A suffix, the family of units that it belongs to, and its power of ten in that family where there is a plain one.
struct Unit {
    suffix: &'static str,
    quantity: Quantity,
    power_of_ten: Option<i32>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Quantity {
    Time,
    Length,
    Angle,
    ArcAngle,
    Frequency,
    Power,
    Voltage,
    Mass,
    Temperature,
    Ratio,
}

const UNITS: &[Unit] = {
    use Quantity::*;
    const fn unit(suffix: &'static str, quantity: Quantity, power: i32) -> Unit {
        Unit { suffix, quantity, power_of_ten: Some(power) }
    }
    const fn odd(suffix: &'static str, quantity: Quantity) -> Unit {
        Unit { suffix, quantity, power_of_ten: None }
    }
    &[
        unit("ps", Time, -12),
        unit("ns", Time, -9),
        unit("us", Time, -6),
        unit("ms", Time, -3),
        unit("s", Time, 0),
        odd("min", Time),
        odd("h", Time),
        odd("d", Time),
        odd("days", Time),
        unit("pm", Length, -12),
        unit("angstrom", Length, -10),
        unit("nm", Length, -9),
        unit("um", Length, -6),
        unit("mm", Length, -3),
        unit("cm", Length, -2),
        unit("m", Length, 0),
        unit("km", Length, 3),
        unit("rad", Angle, 0),
        unit("mrad", Angle, -3),
        unit("urad", Angle, -6),
        odd("deg", Angle),
        odd("arcmin", Angle),
        unit("arcsec", ArcAngle, 0),
        unit("mas", ArcAngle, -3),
        unit("uas", ArcAngle, -6),
        unit("hz", Frequency, 0),
        unit("khz", Frequency, 3),
        unit("mhz", Frequency, 6),
        unit("ghz", Frequency, 9),
        unit("pw", Power, -12),
        unit("nw", Power, -9),
        unit("uw", Power, -6),
        unit("mw", Power, -3),
        unit("w", Power, 0),
        unit("uv", Voltage, -6),
        unit("mv", Voltage, -3),
        unit("v", Voltage, 0),
        unit("g", Mass, -3),
        unit("kg", Mass, 0),
        odd("c", Temperature),
        odd("k", Temperature),
        unit("percent", Ratio, -2),
        unit("fraction", Ratio, 0),
    ]
};

impl Quantity {
    /// Whether values of the two can be converted at all.
    fn like(self, other: Self) -> bool {
        use Quantity::{Angle, ArcAngle};
        self == other || matches!((self, other), (Angle, ArcAngle) | (ArcAngle, Angle))
    }
}

/// The known key that is `unknown` with another unit, and the hint that says so.
pub(super) fn other_unit<'a>(unknown: &str, known: &[&'a str]) -> Option<(&'a str, String)> {
    let (stem, unit) = split(unknown)?;
    known.iter().find_map(|&name| {
        let (other_stem, other) = split(name)?;
        if other_stem != stem || !unit.quantity.like(other.quantity) || unit.suffix == other.suffix
        {
            return None;
        }
        let factor = match (unit.power_of_ten, other.power_of_ten) {
            (Some(from), Some(to)) if unit.quantity == other.quantity => {
                let factor = power_of_ten(from - to);
                format!(
                    "1 {} is {factor} {}: multiply the value by {factor}",
                    unit.suffix, other.suffix
                )
            }
            _ => format!("convert the value from {} to {}", unit.suffix, other.suffix),
        };
        Some((name, format!("did you mean `{name}`? {factor}")))
    })
}

fn split(key: &str) -> Option<(&str, &'static Unit)> {
    let (stem, suffix) = key.rsplit_once('_')?;
    let suffix = suffix.to_lowercase();
    UNITS.iter().find(|unit| unit.suffix == suffix).map(|unit| (stem, unit))
}

/// 1000, 0.001, or 1e-12: short for people, and valid TOML.
fn power_of_ten(power: i32) -> String {
    match power {
        0..=6 => format!("{}", 10_u64.pow(power.unsigned_abs())),
        -6..0 => format!("0.{}1", "0".repeat(power.unsigned_abs() as usize - 1)),
        _ => format!("1e{power}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_are_those_of_the_si_prefixes() {
        let hint = |unknown, known| other_unit(unknown, &[known]).map(|(_, hint)| hint);
        assert_eq!(
            hint("obstruction_m", "obstruction_mm").unwrap(),
            "did you mean `obstruction_mm`? 1 m is 1000 mm: multiply the value by 1000"
        );
        assert_eq!(
            hint("dead_time_ns", "dead_time_us").unwrap(),
            "did you mean `dead_time_us`? 1 ns is 0.001 us: multiply the value by 0.001"
        );
        assert_eq!(
            hint("bin_s", "bin_ps").unwrap(),
            "did you mean `bin_ps`? 1 s is 1e12 ps: multiply the value by 1e12"
        );
        assert_eq!(
            hint("tilt_deg", "tilt_rad").unwrap(),
            "did you mean `tilt_rad`? convert the value from deg to rad"
        );
        assert_eq!(
            hint("loss_percent", "loss_fraction").unwrap(),
            "did you mean `loss_fraction`? 1 percent is 0.01 fraction: multiply the value by 0.01"
        );
        assert_eq!(hint("gap_m", "gap_s"), None);
        assert_eq!(hint("gap_mm", "slit_m"), None);
        assert_eq!(hint("gap", "gap_m"), None);
    }
}
