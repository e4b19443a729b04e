//! PLY, text and binary of both byte orders: a vertex element with x, y, z (and perhaps nx, ny, nz), a face element with a list of indices.
//!
//! Source: G. Turk, "The PLY polygon file format" (1994). Other elements and properties are read over.

use super::Mesh;
use super::obj::{polygon_error, shorten};
use super::read::NamedMesh;
use super::triangulate::{MOST_CORNERS, triangulate};
use glam::DVec3;
use std::path::Path;
use sunglint_formats::ParseError;

/// No header that makes sense is longer.
const LONGEST_HEADER: usize = 1 << 20;

#[derive(Clone, Copy, PartialEq, Eq)]
enum Format {
    Text,
    Little,
    Big,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    fn is_whole(self) -> bool {
        !matches!(self, Self::F32 | Self::F64)
    }

    /// The number in as many bytes as it has, the least significant first.
    fn decode(self, little: [u8; 8]) -> f64 {
        let [a, b, c, d, ..] = little;
        match self {
            Self::I8 => f64::from(a as i8),
            Self::U8 => f64::from(a),
            Self::I16 => f64::from(i16::from_le_bytes([a, b])),
            Self::U16 => f64::from(u16::from_le_bytes([a, b])),
            Self::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
            Self::U32 => f64::from(u32::from_le_bytes([a, b, c, d])),
            Self::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
            Self::F64 => f64::from_le_bytes(little),
        }
    }
}

struct Property {
    name: String,
    /// The type of the count where it is a list.
    list: Option<Scalar>,
    scalar: Scalar,
}

struct Element {
    name: String,
    count: u64,
    properties: Vec<Property>,
}

pub(super) fn parse(path: &Path, bytes: Vec<u8>) -> Result<Vec<NamedMesh>, ParseError> {
    let (format, elements, start, lines) = header(path, &bytes)?;
    let mut body: Box<dyn Numbers> = match format {
        Format::Text => Box::new(TextBody { bytes, at: start, line: lines + 1 }),
        _ => Box::new(BinaryBody { bytes, at: start, big: format == Format::Big }),
    };
    let mut reader =
        Reader { path, mesh: Mesh::default(), has_vertices: false, values: Vec::new() };
    for element in &elements {
        for index in 0..element.count {
            reader.record(element, index, body.as_mut())?;
        }
        reader.has_vertices |= element.name == "vertex";
    }
    if let Some(found) = body.left_over() {
        return Err(ParseError::new(path, found, "the end of the file, by its header"));
    }
    Ok(vec![NamedMesh { names: vec![], mesh: reader.mesh }])
}

/// Format, elements, where the body begins, and the line before it.
fn header(path: &Path, bytes: &[u8]) -> Result<(Format, Vec<Element>, usize, u64), ParseError> {
    let mut format = None;
    let mut elements: Vec<Element> = Vec::new();
    let (mut at, mut number) = (0, 0);
    loop {
        let window = &bytes[at..bytes.len().min(at + LONGEST_HEADER)];
        let end = window.iter().position(|&b| b == b'\n');
        let Some(end) = end.filter(|end| at + end < LONGEST_HEADER) else {
            let error = ParseError::new(path, "no end_header", "a header that ends so");
            return Err(error.at_line(number + 1));
        };
        number += 1;
        let line = String::from_utf8_lossy(&window[..end]).trim().to_owned();
        at += end + 1;
        let wrong = |expected: &str| {
            let found = format!("`{}`", shorten(&line));
            ParseError::new(path, found, expected).at_line(number)
        };
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["ply"] if number == 1 => {}
            _ if number == 1 => return Err(wrong("ply")),
            ["comment" | "obj_info", ..] | [] => {}
            ["format", name, "1.0"] if format.is_none() => {
                format = Some(match name {
                    "ascii" => Format::Text,
                    "binary_little_endian" => Format::Little,
                    "binary_big_endian" => Format::Big,
                    _ => return Err(wrong("ascii, binary_little_endian or binary_big_endian")),
                });
            }
            ["element", name, count] => {
                let count = count.parse().map_err(|_| wrong("element, name, count"))?;
                if elements.iter().any(|e| e.name == name) {
                    return Err(wrong("each element once"));
                }
                elements.push(Element { name: name.to_owned(), count, properties: vec![] });
            }
            ["property", ref about @ ..] => {
                let property = property(about).ok_or_else(|| {
                    wrong("property, type, name (or property list, two types, name)")
                })?;
                let element = elements.last_mut().ok_or_else(|| wrong("an element before"))?;
                element.properties.push(property);
            }
            ["end_header"] => {
                let format = format.ok_or_else(|| wrong("a line format before"))?;
                check(path, &elements, bytes.len() - at)?;
                return Ok((format, elements, at, number));
            }
            _ => return Err(wrong("format, element, property, comment or end_header")),
        }
    }
}

fn property(about: &[&str]) -> Option<Property> {
    let (list, scalar, name) = match about {
        ["list", count, scalar, name] => {
            (Some(Scalar::from_name(count).filter(|c| c.is_whole())?), scalar, name)
        }
        [scalar, name] => (None, scalar, name),
        _ => return None,
    };
    Some(Property { name: (*name).to_owned(), list, scalar: Scalar::from_name(scalar)? })
}

fn is_index(property: &Property) -> bool {
    property.list.is_some()
        && property.scalar.is_whole()
        && ["vertex_indices", "vertex_index"].contains(&property.name.as_str())
}

fn check(path: &Path, elements: &[Element], bytes_left: usize) -> Result<(), ParseError> {
    let find = |name: &str| elements.iter().find(|e| e.name == name);
    let has_axes = |e: &Element| {
        ["x", "y", "z"].iter().all(|axis| {
            e.properties.iter().filter(|p| p.name == *axis && p.list.is_none()).count() == 1
        })
    };
    if !find("vertex").is_some_and(has_axes) {
        let error = ParseError::new(path, "no such element", "a vertex with x, y, z");
        return Err(error.in_field("element vertex"));
    }
    let lists = |e: &Element| e.properties.iter().filter(|p| is_index(p)).count();
    if find("face").map(lists) != Some(1) {
        let expected = "a face with one list vertex_indices of whole numbers";
        let error = ParseError::new(path, "no such element", expected).in_field("element face");
        return Err(error.with_hint("strips and points alone are not read: export triangles"));
    }
    // Each number takes at least a byte, so that no count may be larger than the file.
    for element in elements {
        if element.count > bytes_left as u64 || (element.properties.is_empty() && element.count > 0)
        {
            let found = format!("{} of them in {bytes_left} bytes", element.count);
            let error = ParseError::new(path, found, "as many as the file has");
            return Err(error.in_field(format!("element {}", element.name)));
        }
    }
    Ok(())
}

/// The numbers of a body, one after the other.
trait Numbers {
    fn next(&mut self, scalar: Scalar) -> Option<f64>;
    fn line(&mut self) -> Option<u64>;
    fn left_over(&mut self) -> Option<String>;
}

struct BinaryBody {
    bytes: Vec<u8>,
    at: usize,
    big: bool,
}

impl Numbers for BinaryBody {
    fn next(&mut self, scalar: Scalar) -> Option<f64> {
        let size = scalar.bytes();
        let raw = self.bytes.get(self.at..self.at + size)?;
        let mut little = [0; 8];
        little[..size].copy_from_slice(raw);
        if self.big {
            little[..size].reverse();
        }
        self.at += size;
        Some(scalar.decode(little))
    }

    fn line(&mut self) -> Option<u64> {
        None
    }

    fn left_over(&mut self) -> Option<String> {
        let more = self.bytes.len() - self.at;
        (more > 0).then(|| format!("{more} bytes more"))
    }
}

struct TextBody {
    bytes: Vec<u8>,
    at: usize,
    line: u64,
}

impl TextBody {
    fn skip_space(&mut self) {
        while let Some(byte) = self.bytes.get(self.at).filter(|b| b.is_ascii_whitespace()) {
            self.line += u64::from(*byte == b'\n');
            self.at += 1;
        }
    }

    /// The next word, which stays there.
    fn word(&self) -> Option<&str> {
        let rest = &self.bytes[self.at..];
        let end = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        std::str::from_utf8(&rest[..end]).ok().filter(|word| !word.is_empty())
    }
}

impl Numbers for TextBody {
    fn next(&mut self, scalar: Scalar) -> Option<f64> {
        self.skip_space();
        let word = self.word()?;
        let (number, length): (f64, usize) = (word.parse().ok()?, word.len());
        // What does not fit the type is no number of it.
        if scalar.is_whole() && number.fract() != 0.0 {
            return None;
        }
        self.at += length;
        Some(number)
    }

    fn line(&mut self) -> Option<u64> {
        self.skip_space();
        Some(self.line)
    }

    fn left_over(&mut self) -> Option<String> {
        self.skip_space();
        let rest = self.at < self.bytes.len();
        rest.then(|| format!("`{}` in line {}", shorten(self.word().unwrap_or("")), self.line))
    }
}

struct Reader<'p> {
    path: &'p Path,
    mesh: Mesh,
    has_vertices: bool,
    /// The list of indices of the face at hand.
    values: Vec<f64>,
}

impl Reader<'_> {
    fn record(
        &mut self,
        element: &Element,
        index: u64,
        body: &mut dyn Numbers,
    ) -> Result<(), ParseError> {
        let line = body.line();
        let field = || format!("{} {index}", element.name);
        let wrong = |line: Option<u64>, found: String, expected: &str| {
            let error = ParseError::new(self.path, found, expected).in_field(field());
            match line {
                Some(line) => error.at_line(line),
                None => error,
            }
        };
        let cut = |body: &mut dyn Numbers| {
            let expected = "the numbers that the header promises";
            wrong(body.line(), "no such number, or the end of the file".into(), expected)
        };
        let (mut point, mut normal) = (DVec3::NAN, None::<DVec3>);
        for property in &element.properties {
            let count = match property.list {
                None => 1.0,
                Some(scalar) => body.next(scalar).ok_or_else(|| cut(body))?,
            };
            let is_face = element.name == "face" && is_index(property);
            if count < 0.0 || (is_face && count > MOST_CORNERS as f64) {
                let found = format!("a list of {count}");
                let expected = format!("0 to {MOST_CORNERS} numbers");
                return Err(wrong(line, found, &expected));
            }
            if is_face {
                self.values.clear();
            }
            for _ in 0..count as u64 {
                let value = body.next(property.scalar).ok_or_else(|| cut(body))?;
                if is_face {
                    self.values.push(value);
                } else if property.list.is_none() {
                    match property.name.as_str() {
                        "x" => point.x = value,
                        "y" => point.y = value,
                        "z" => point.z = value,
                        "nx" => normal.get_or_insert_default().x = value,
                        "ny" => normal.get_or_insert_default().y = value,
                        "nz" => normal.get_or_insert_default().z = value,
                        _ => {}
                    }
                }
            }
        }
        match element.name.as_str() {
            "vertex" if !point.is_finite() => {
                Err(wrong(line, point.to_string(), "finite coordinates"))
            }
            "vertex" => {
                if let Some(normal) = normal {
                    if !normal.is_finite() {
                        return Err(wrong(line, normal.to_string(), "a finite normal"));
                    }
                    self.mesh.normals.push(normal.normalize_or_zero());
                }
                self.mesh.vertices.push(point);
                Ok(())
            }
            "face" if !self.has_vertices => {
                Err(wrong(line, "a face".into(), "the element vertex before the element face"))
            }
            "face" => self.face().map_err(|error| {
                let error = error.in_field(field());
                line.map_or(error.clone(), |line| error.at_line(line))
            }),
            _ => Ok(()),
        }
    }

    fn face(&mut self) -> Result<(), ParseError> {
        let count = self.mesh.vertices.len();
        let good = |value: f64| value >= 0.0 && value < count as f64;
        if let Some(bad) = self.values.iter().find(|value| !good(**value)) {
            let last = count.saturating_sub(1);
            let expected = format!("a vertex from 0 to {last}");
            return Err(ParseError::new(self.path, format!("{bad}"), expected));
        }
        if self.values.len() < 3 {
            let found = format!("{} corners", self.values.len());
            return Err(ParseError::new(self.path, found, "at least three corners"));
        }
        let corners: Vec<u32> = self.values.iter().map(|&v| v as u32).collect();
        let points: Vec<DVec3> = corners.iter().map(|&i| self.mesh.vertices[i as usize]).collect();
        let triangles = triangulate(&points).map_err(|odd| polygon_error(self.path, odd))?;
        self.mesh.triangles.extend(triangles.into_iter().map(|t| t.map(|i| corners[i])));
        Ok(())
    }
}
