//! What there is to say of a sample: one bit each, by name in files.

use serde_json::{Value, json};
use std::path::Path;
use sunglint_formats::{ParseError, nearest_names};

bitflags::bitflags! {
    /// Flags of a sample. In files the metadata `flag_bits` names the bits, and the names decide.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
    pub struct Flags: u32 {
        /// A detector or pixel at or past its saturation: the rate is excluded.
        const SATURATED = 1 << 0;
        /// No data here: a dropped frame, a device that was away.
        const GAP = 1 << 1;
        /// The target was outside the fibre's field.
        const OFF_AXIS = 1 << 2;
        /// A table was left: a material, a sensitivity or the air beyond its range.
        const EXTRAPOLATED = 1 << 3;
        /// A value stood in for a missing one: a black body for a spectrum, no Earth orientation.
        const FALLBACK = 1 << 4;
        /// The counter lost events: the rate is a lower bound.
        const OVERFLOW = 1 << 5;
        /// The light changed within the bin faster than it can be linearised.
        const FAST_GLINT = 1 << 6;
        /// Pixels of the aperture were masked.
        const MASKED_PIXELS = 1 << 7;
        /// Background from a stand-in (dark counts) where there was no off-target stretch.
        const NO_OFF_TARGET = 1 << 8;
        /// The target was in the Earth's penumbra or umbra.
        const ECLIPSED = 1 << 9;
        /// The target was below the station's horizon, or behind what stands there.
        const HIDDEN = 1 << 10;
    }
}

impl Flags {
    /// The names of the bits as files spell them, with their numbers: `{"saturated": 0, …}`.
    pub fn bit_names() -> Value {
        let names: serde_json::Map<String, Value> = Flags::all()
            .iter_names()
            .map(|(name, flag)| (name.to_lowercase(), json!(flag.bits().trailing_zeros())))
            .collect();
        Value::Object(names)
    }

    /// A file's numbering: at each bit its flag. No metadata means no flags at all.
    pub(crate) fn numbering(path: &Path, bits: Option<&Value>) -> Result<Vec<Flags>, ParseError> {
        let mut numbering = vec![Flags::empty(); 32];
        let Some(bits) = bits else { return Ok(numbering) };
        let wrong = |found: String, expected: &str| {
            ParseError::new(path, found, expected).in_field("flag_bits")
        };
        let Some(bits) = bits.as_object() else {
            return Err(wrong(bits.to_string(), "a map from flag to bit"));
        };
        for (name, bit) in bits {
            let Some(flag) = Flags::from_name(&name.to_uppercase()) else {
                let names: Vec<String> =
                    Flags::all().iter_names().map(|(n, _)| n.to_lowercase()).collect();
                let error = wrong(format!("the flag `{name}`"), "a flag that this version knows");
                return Err(
                    match nearest_names(name, names.iter().map(String::as_str), 1).first() {
                        Some(near) => error.with_hint(format!("did you mean `{near}`?")),
                        None => error,
                    },
                );
            };
            match bit.as_u64() {
                Some(bit @ 0..32) => numbering[bit as usize] = flag,
                _ => return Err(wrong(format!("bit {bit} of `{name}`"), "a bit from 0 to 31")),
            }
        }
        Ok(numbering)
    }

    /// The flags of a number in a file's numbering; `None` where a bit has no name.
    pub(crate) fn renumbered(value: i64, numbering: &[Flags]) -> Option<Flags> {
        let value = u32::try_from(value).ok()?;
        let mut flags = Flags::empty();
        for bit in (0..32).filter(|bit| value & (1 << bit) != 0) {
            let flag = numbering[bit];
            if flag.is_empty() {
                return None;
            }
            flags |= flag;
        }
        Some(flags)
    }
}
