//! Common parts of tables of options: defaults of every key, and ranges out of which a value is refused.

/// A table of options: a struct whose fields all have a default, read from TOML, unknown keys refused.
macro_rules! section {
    ($(#[$doc:meta])* $name:ident { $($(#[$field_doc:meta])* $field:ident: $kind:ty = $value:expr),+ $(,)? }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, PartialEq, serde::Deserialize)]
        #[serde(default, deny_unknown_fields)]
        pub struct $name { $($(#[$field_doc])* pub $field: $kind),+ }

        impl Default for $name {
            fn default() -> Self {
                Self { $($field: $value),+ }
            }
        }
    };
}
pub(crate) use section;

/// A value that what is described cannot have.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{key} = {value}, expected {expected}")]
pub struct OptionError {
    /// The dotted key.
    pub key: String,
    /// Value that it has.
    pub value: f64,
    /// Values that it may have.
    pub expected: &'static str,
}

/// Least, largest, and both in words.
pub(crate) type Range = (f64, f64, &'static str);

pub(crate) const POSITIVE: Range = (f64::MIN_POSITIVE, 1e9, "a number above 0, up to 1e9");
pub(crate) const SIZE: Range = (0.0, 1e9, "a number from 0 to 1e9");
pub(crate) const PART: Range = (0.0, 1.0, "a fraction from 0 to 1");
pub(crate) const ANY: Range = (-1e9, 1e9, "a number from -1e9 to 1e9");

/// Refuses what is out of its range; NaN is out of every one.
pub(crate) fn within(key: &str, value: f64, range: Range) -> Result<(), OptionError> {
    let (low, high, expected) = range;
    if (low..=high).contains(&value) {
        return Ok(());
    }
    Err(OptionError { key: key.to_owned(), value, expected })
}
