//! A scene with other values at some of its keys.

use crate::design::Value;

/// Why a value has no place in a scene.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum KeyError {
    /// A key that is none.
    #[error(
        "`{key}` is no key: expected names with dots, such as target.sphere.radius_m, or target.part[0].material"
    )]
    Malformed {
        /// Key as it was given.
        key: String,
    },
    /// The scene has no such list, or it is shorter.
    #[error(
        "`{key}`: the scene has {found} at `{at}`, expected a list with a place {index} (counted from 0)"
    )]
    NoPlace {
        /// Key as it was given.
        key: String,
        /// Where it leads nowhere.
        at: String,
        /// Place that was asked for.
        index: usize,
        /// Value that stands there.
        found: String,
    },
    /// A value stands where a table should.
    #[error("`{key}`: the scene has {found} at `{at}`, expected a table")]
    NoTable {
        /// Key as it was given.
        key: String,
        /// Where it leads nowhere.
        at: String,
        /// Value that stands there.
        found: String,
    },
}

/// A step of a dotted key: a name, and the places in lists after it.
struct Step<'k> {
    name: &'k str,
    places: Vec<usize>,
}

fn steps(key: &str) -> Result<Vec<Step<'_>>, KeyError> {
    let malformed = || KeyError::Malformed { key: key.to_owned() };
    key.split('.')
        .map(|step| {
            let (name, rest) = match step.find('[') {
                Some(at) => step.split_at(at),
                None => (step, ""),
            };
            let is_name = |c: char| c.is_alphanumeric() || c == '_' || c == '-';
            if name.is_empty() || !name.chars().all(is_name) {
                return Err(malformed());
            }
            let mut places = Vec::new();
            let mut rest = rest;
            while !rest.is_empty() {
                let (place, after) =
                    rest.strip_prefix('[').and_then(|r| r.split_once(']')).ok_or_else(malformed)?;
                places.push(place.parse().map_err(|_| malformed())?);
                rest = after;
            }
            Ok(Step { name, places })
        })
        .collect()
}

fn kind(value: Option<&toml::Value>) -> String {
    match value {
        None => "nothing".into(),
        Some(toml::Value::Array(list)) => format!("a list of {}", list.len()),
        Some(other) => format!("a {}", other.type_str()),
    }
}

/// Puts a value at a dotted key: `target.sphere.radius_m`, `target.part[1].material`, places counted from 0. Tables on the way that are not there are made.
///
/// # Errors
/// [`KeyError`]: a key that is none, or that leads through something that is no table or no list.
///
/// ```
/// use sunglint_study::{design::Value, scene::set};
///
/// let mut scene: toml::Table = "[target]\nsphere = { radius_m = 1.0 }".parse().unwrap();
/// set(&mut scene, "target.sphere.radius_m", &Value::Number(2.0)).unwrap();
/// assert_eq!(scene["target"]["sphere"]["radius_m"].as_float(), Some(2.0));
/// ```
pub fn set(scene: &mut toml::Table, key: &str, value: &Value) -> Result<(), KeyError> {
    let steps = steps(key)?;
    let mut at = String::new();
    let mut table = scene;
    let last = steps.len() - 1;
    for (i, step) in steps.iter().enumerate() {
        if !at.is_empty() {
            at.push('.');
        }
        at.push_str(step.name);
        if i == last && step.places.is_empty() {
            table.insert(step.name.to_owned(), value.toml());
            return Ok(());
        }
        if step.places.is_empty() && !table.contains_key(step.name) {
            table.insert(step.name.to_owned(), toml::Table::new().into());
        }
        let mut here = table.get_mut(step.name);
        for place in &step.places {
            let found = kind(here.as_deref());
            let inner = match here {
                Some(toml::Value::Array(list)) => list.get_mut(*place),
                _ => None,
            };
            if inner.is_none() {
                return Err(KeyError::NoPlace { key: key.into(), at, index: *place, found });
            }
            here = inner;
            at.push_str(&format!("[{place}]"));
        }
        let found = kind(here.as_deref());
        match here {
            Some(slot) if i == last => {
                *slot = value.toml();
                return Ok(());
            }
            Some(toml::Value::Table(inner)) => table = inner,
            _ => return Err(KeyError::NoTable { key: key.into(), at, found }),
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCENE: &str = "
tolerance = 0.01
[[target.part]]
material = 'gold'
centre_m = [0.0, 1.0, 2.0]
[[target.part]]
material = 'white'
";

    fn scene() -> toml::Table {
        SCENE.parse().expect("TOML")
    }

    /// Truth: the same scene, written by hand.
    #[test]
    fn values_land_where_the_key_says() {
        let mut changed = scene();
        set(&mut changed, "target.part[1].material", &Value::Text("black".into())).expect("set");
        set(&mut changed, "target.part[0].centre_m[2]", &Value::Number(-3.5)).expect("set");
        set(&mut changed, "attitude.law", &Value::Text("orbit".into())).expect("set");
        set(&mut changed, "tolerance", &Value::Number(0.1)).expect("set");
        let wanted: toml::Table = "
tolerance = 0.1
attitude = { law = 'orbit' }
[[target.part]]
material = 'gold'
centre_m = [0.0, 1.0, -3.5]
[[target.part]]
material = 'black'
"
        .parse()
        .expect("TOML");
        assert_eq!(changed, wanted);
    }

    #[test]
    fn a_key_that_leads_nowhere_is_named() {
        let one = Value::Integer(1);
        let error = |key| set(&mut scene(), key, &one).expect_err("no place").to_string();
        assert!(error("target.part[2].material").contains("a list of 2 at `target.part`"));
        assert!(error("tolerance.deep").contains("a float at `tolerance`"));
        assert!(error("target.part.material").contains("a list of 2 at `target.part`"));
        for bad in ["", "a..b", "a[", "a[x]", "a[1]b", "[0]", "a b"] {
            assert!(error(bad).contains("is no key"), "{bad}");
        }
    }
}
