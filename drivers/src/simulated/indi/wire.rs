//! Vectors as a server writes them.

use crate::indi::base64;
use crate::indi::property::{Kind, Member, Place, State, Value, Vector};
use crate::indi::xml::{Element, escaped};
use std::fmt::Write as _;
use sunglint_numerics::measured::Interval;

fn text(value: &Value) -> String {
    match value {
        Value::Text(text) => escaped(text),
        Value::Number(number) => number.to_string(),
        Value::Switch(on) => if *on { "On" } else { "Off" }.to_owned(),
        Value::Light(state) => state.name().to_owned(),
        Value::Blob => String::new(),
    }
}

/// The `def…Vector` of a vector.
pub fn definition(place: &Place, vector: &Vector) -> String {
    let kind = vector.kind.name();
    let (device, name) = (escaped(&place.device), escaped(&place.name));
    let perm = if vector.writable { "rw" } else { "ro" };
    let rule = if vector.kind == Kind::Switch { " rule=\"OneOfMany\"" } else { "" };
    let mut out = format!(
        "<def{kind}Vector device=\"{device}\" name=\"{name}\" label=\"{name}\" group=\"Main\" state=\"{}\" perm=\"{perm}\"{rule} timeout=\"60\">\n",
        vector.state
    );
    for member in &vector.members {
        let name = escaped(&member.name);
        let range = member.range.map_or(String::new(), |Interval { low: least, high: most }| {
            format!(" format=\"%g\" min=\"{least}\" max=\"{most}\" step=\"1\"")
        });
        if vector.kind == Kind::Blob {
            let _ = writeln!(out, "    <defBLOB name=\"{name}\" label=\"{name}\"/>");
            continue;
        }
        let text = text(&member.value);
        let _ = writeln!(
            out,
            "    <def{kind} name=\"{name}\" label=\"{name}\"{range}>\n{text}\n    </def{kind}>"
        );
    }
    let _ = writeln!(out, "</def{kind}Vector>");
    out
}

/// The `set…Vector` of a vector.
pub fn change(place: &Place, vector: &Vector) -> String {
    let kind = vector.kind.name();
    let (device, name) = (escaped(&place.device), escaped(&place.name));
    let state = vector.state;
    let mut out = format!(
        "<set{kind}Vector device=\"{device}\" name=\"{name}\" state=\"{state}\" timeout=\"60\">\n"
    );
    for member in &vector.members {
        let (name, text) = (escaped(&member.name), text(&member.value));
        let _ = writeln!(out, "    <one{kind} name=\"{name}\">\n{text}\n    </one{kind}>");
    }
    let _ = writeln!(out, "</set{kind}Vector>");
    out
}

/// The `setBLOBVector` of a BLOB; `size` is that of the unpacked bytes.
pub fn blob(place: &Place, format: &str, size: usize, bytes: &[u8]) -> String {
    let (device, name, len) = (escaped(&place.device), escaped(&place.name), bytes.len());
    format!(
        "<setBLOBVector device=\"{device}\" name=\"{name}\" state=\"Ok\" timeout=\"60\">\n    <oneBLOB name=\"{name}\" size=\"{size}\" format=\"{format}\" len=\"{len}\">\n{}    </oneBLOB>\n</setBLOBVector>\n",
        base64::encode(bytes)
    )
}

/// A message to people.
pub fn message(device: &str, text: &str) -> String {
    format!("<message device=\"{}\" message=\"{}\"/>\n", escaped(device), escaped(text))
}

/// A vector is no more, or a whole device.
pub fn deletion(device: &str, name: Option<&str>) -> String {
    let name = name.map_or(String::new(), |name| format!(" name=\"{}\"", escaped(name)));
    format!("<delProperty device=\"{}\"{name}/>\n", escaped(device))
}

/// Numbers by name, with their ranges.
pub(crate) fn numbers(members: &[(&str, f64, [f64; 2])]) -> Vector {
    let member = |(name, number, range): &(&str, f64, [f64; 2])| Member {
        name: (*name).to_owned(),
        value: Value::Number(*number),
        range: Some((*range).into()),
    };
    Vector::new(Kind::Number, true, members.iter().map(member).collect())
}

/// Switches by name.
pub fn switches(members: &[(&str, bool)]) -> Vector {
    let member = |(name, on): &(&str, bool)| Member {
        name: (*name).to_owned(),
        value: Value::Switch(*on),
        range: None,
    };
    Vector::new(Kind::Switch, true, members.iter().map(member).collect())
}

/// Texts by name, which a client may read only.
pub fn texts(members: &[(&str, &str)]) -> Vector {
    let member = |(name, text): &(&str, &str)| Member {
        name: (*name).to_owned(),
        value: Value::Text((*text).to_owned()),
        range: None,
    };
    Vector::new(Kind::Text, false, members.iter().map(member).collect())
}

/// The vector with what a client asks for in it, if that makes sense.
pub fn asked(vector: &Vector, element: &Element) -> Option<Vector> {
    let mut after = vector.clone();
    let kind = vector.kind.name();
    if element.tag != format!("new{kind}Vector") || !vector.writable {
        return None;
    }
    for child in &element.children {
        let name = child.attribute("name")?;
        let member = after.members.iter_mut().find(|member| member.name == name)?;
        member.value = match (&member.value, child.text.as_str()) {
            (Value::Switch(_), "On") => Value::Switch(true),
            (Value::Switch(_), "Off") => Value::Switch(false),
            (Value::Text(_), text) => Value::Text(text.to_owned()),
            (Value::Number(_), text) => {
                let number = crate::indi::property::number(text)?;
                let [least, most] = member.range.map_or([f64::MIN, f64::MAX], Interval::to_array);
                Value::Number(Some(number).filter(|n| (least..=most).contains(n))?)
            }
            _ => return None,
        };
    }
    after.state = State::Ok;
    Some(after)
}
