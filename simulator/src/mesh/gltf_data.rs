//! The bytes behind a glTF: chunks of a GLB, buffers in and beside the file, accessors into them.

use super::gltf::{Root, wrong};
use super::read::Load;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use base64::{Engine as _, alphabet};
use glam::DVec3;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use sunglint_formats::{FileError, ParseError};

const JSON: u32 = 0x4E4F_534A;
const BIN: u32 = 0x004E_4942;

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    let four = bytes.get(at..at.checked_add(4)?)?;
    Some(u32::from_le_bytes([four[0], four[1], four[2], four[3]]))
}

/// The JSON of a GLB and its binary chunk.
pub(super) fn split_glb<'b>(
    path: &Path,
    bytes: &'b [u8],
) -> Result<(&'b [u8], Option<&'b [u8]>), ParseError> {
    let cut = || ParseError::new(path, "a GLB that is cut off", "header, JSON chunk, BIN chunk");
    let (version, length) = (word(bytes, 4).ok_or_else(cut)?, word(bytes, 8).ok_or_else(cut)?);
    if version != 2 {
        return Err(ParseError::new(path, format!("GLB version {version}"), "version 2"));
    }
    if length as usize != bytes.len() {
        let found = format!("{} bytes", bytes.len());
        return Err(ParseError::new(path, found, format!("{length} bytes, by its header")));
    }
    let chunk = |at: usize| {
        let (size, kind) = (word(bytes, at)?, word(bytes, at + 4)?);
        let end = (at + 8).checked_add(size as usize)?;
        Some((kind, bytes.get(at + 8..end)?, end))
    };
    let (kind, json, end) = chunk(12).ok_or_else(cut)?;
    if kind != JSON {
        return Err(ParseError::new(path, "another chunk", "the JSON chunk first"));
    }
    if end == bytes.len() {
        return Ok((json, None));
    }
    match chunk(end).ok_or_else(cut)? {
        (BIN, binary, _) => Ok((json, Some(binary))),
        _ => Ok((json, None)),
    }
}

/// The bytes of each buffer.
pub(super) struct Buffers {
    /// Each file once, however many buffers name it.
    bytes: Vec<Vec<u8>>,
    /// For each buffer, which of them.
    of: Vec<usize>,
}

impl Buffers {
    pub fn load(
        path: &Path,
        root: &Root,
        chunk: Option<&[u8]>,
        load: Load,
    ) -> Result<Self, FileError> {
        let mut all = Self { bytes: Vec::new(), of: Vec::new() };
        let mut files: HashMap<PathBuf, usize> = HashMap::new();
        for (i, buffer) in root.buffers.iter().enumerate() {
            let at = format!("buffers[{i}]");
            let new = all.bytes.len();
            let index = match (&buffer.uri, chunk) {
                (None, Some(chunk)) if i == 0 => {
                    all.bytes.push(chunk.to_vec());
                    new
                }
                (None, _) => return Err(wrong(path, at, "no uri", "a uri, or a GLB").into()),
                (Some(uri), _) => match uri.strip_prefix("data:") {
                    Some(data) => {
                        all.bytes.push(base64(data).ok_or_else(|| {
                            wrong(path, format!("{at}.uri"), "data that is no base64", "base64")
                        })?);
                        new
                    }
                    None => {
                        // Without the `.` that would make other names of the same file.
                        let name = path.with_file_name(beside(path, &at, uri)?);
                        let name: PathBuf = name.components().collect();
                        match files.get(&name) {
                            Some(&known) => known,
                            None => {
                                all.bytes.push(load(&name)?);
                                files.insert(name, new);
                                new
                            }
                        }
                    }
                },
            };
            let bytes = &all.bytes[index];
            // A chunk may be padded to four bytes; nothing may be missing.
            if bytes.len() < buffer.byte_length {
                let found = format!("{} bytes", bytes.len());
                let expected = format!("byteLength = {}", buffer.byte_length);
                return Err(wrong(path, at, found, expected).into());
            }
            all.of.push(index);
        }
        Ok(all)
    }

    fn get(&self, buffer: usize) -> Option<&Vec<u8>> {
        self.of.get(buffer).and_then(|&index| self.bytes.get(index))
    }
}

/// The name of a file beside the document.
fn beside(path: &Path, at: &str, uri: &str) -> Result<String, ParseError> {
    let name = percent_decode(uri).filter(|name| {
        !name.contains("://") && !Path::new(name).is_absolute() && !name.contains('\0')
    });
    name.ok_or_else(|| {
        wrong(
            path,
            format!("{at}.uri"),
            format!("`{}`", super::obj::shorten(uri)),
            "a file beside it",
        )
    })
}

fn percent_decode(uri: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.bytes();
    while let Some(byte) = rest.next() {
        if byte == b'%' {
            let mut digit = || Some((rest.next()? as char).to_digit(16)? as u8);
            bytes.push(16 * digit()? + digit()?);
        } else {
            bytes.push(byte);
        }
    }
    String::from_utf8(bytes).ok()
}

/// Decodes the text after `data:` (RFC 2397), in base64 (RFC 4648, padded or not).
fn base64(data: &str) -> Option<Vec<u8>> {
    // As readers of glTF do: padding may lack, and bits that belong to no byte are passed by.
    let config = GeneralPurposeConfig::new()
        .with_decode_allow_trailing_bits(true)
        .with_decode_padding_mode(DecodePaddingMode::RequireNone);
    let engine = GeneralPurpose::new(&alphabet::STANDARD, config);
    engine.decode(data.split_once(";base64,")?.1.trim_end_matches('=')).ok()
}

/// The elements of an accessor: `size` bytes each.
fn elements<'b>(
    path: &Path,
    root: &Root,
    buffers: &'b Buffers,
    accessor: usize,
    kind: &str,
    sizes: &[(u32, usize)],
) -> Result<(u32, impl Iterator<Item = &'b [u8]> + use<'b>), ParseError> {
    let at = format!("accessors[{accessor}]");
    let error = |found: &str, expected: &str| Err(wrong(path, at.clone(), found, expected));
    let Some(about) = root.accessors.get(accessor) else {
        return error("no such accessor", &format!("one of {}", root.accessors.len()));
    };
    if about.sparse.is_some() {
        return error("a sparse accessor", "a dense one");
    }
    let component = sizes.iter().find(|(code, _)| *code == about.component_type);
    let Some(&(code, size)) = component.filter(|_| about.kind == kind && !about.normalized) else {
        let found = format!("{} of component type {}", about.kind, about.component_type);
        let codes: Vec<String> = sizes.iter().map(|(code, _)| code.to_string()).collect();
        return error(&found, &format!("{kind} of component type {}", codes.join(", ")));
    };
    let Some(view) = about.buffer_view.and_then(|view| root.buffer_views.get(view)) else {
        return error("no such bufferView", &format!("one of {}", root.buffer_views.len()));
    };
    let Some(buffer) = buffers.get(view.buffer) else {
        return error("no such buffer", &format!("one of {}", buffers.of.len()));
    };
    let stride = view.byte_stride.unwrap_or(size);
    let reach = about.count.checked_sub(1).and_then(|last| {
        last.checked_mul(stride)?.checked_add(size)?.checked_add(about.byte_offset)
    });
    let end = view.byte_offset.checked_add(view.byte_length).filter(|end| *end <= buffer.len());
    let (Some(_), Some(_), true) = (end, reach.filter(|r| *r <= view.byte_length), stride >= size)
    else {
        let found = format!("{} elements every {stride} bytes", about.count);
        let expected = format!(
            "elements within {} bytes at {} of a buffer of {}",
            view.byte_length,
            view.byte_offset,
            buffer.len()
        );
        return error(&found, &expected);
    };
    let (start, count) = (view.byte_offset + about.byte_offset, about.count);
    Ok((code, (0..count).map(move |i| &buffer[start + i * stride..start + i * stride + size])))
}

/// Corners: three single-precision numbers each.
pub(super) fn positions(
    path: &Path,
    root: &Root,
    buffers: &Buffers,
    accessor: usize,
) -> Result<Vec<DVec3>, ParseError> {
    let (_, items) = elements(path, root, buffers, accessor, "VEC3", &[(5126, 12)])?;
    let number = |b: &[u8], k: usize| {
        f64::from(f32::from_le_bytes([b[4 * k], b[4 * k + 1], b[4 * k + 2], b[4 * k + 3]]))
    };
    items
        .enumerate()
        .map(|(i, b)| {
            let point = DVec3::new(number(b, 0), number(b, 1), number(b, 2));
            if point.is_finite() {
                Ok(point)
            } else {
                let at = format!("accessors[{accessor}] element {i}");
                Err(wrong(path, at, point.to_string(), "finite coordinates"))
            }
        })
        .collect()
}

/// Indices: bytes, 16-bit or 32-bit numbers.
pub(super) fn indices(
    path: &Path,
    root: &Root,
    buffers: &Buffers,
    accessor: usize,
) -> Result<Vec<u32>, ParseError> {
    let kinds = [(5121, 1), (5123, 2), (5125, 4)];
    let (_, items) = elements(path, root, buffers, accessor, "SCALAR", &kinds)?;
    let number = |b: &[u8]| b.iter().rev().fold(0_u32, |n, &byte| (n << 8) | u32::from(byte));
    Ok(items.map(number).collect())
}

#[cfg(test)]
mod tests {
    use super::super::read::read_with;
    use super::*;

    /// Two buffers of one file, one of them by another name, are the same bytes, read once: a triangle of corners from one, indices from
    /// the other. A short document could otherwise ask for the same file ten thousand times.
    #[test]
    fn a_file_of_two_buffers_is_read_once() {
        let text = r#"{"asset": {"version": "2.0"}, "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
            "buffers": [{"uri": "b.bin", "byteLength": 39}, {"uri": "./b.bin", "byteLength": 39}],
            "bufferViews": [{"buffer": 0, "byteLength": 36},
                {"buffer": 1, "byteOffset": 36, "byteLength": 3}],
            "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
                {"bufferView": 1, "componentType": 5121, "count": 3, "type": "SCALAR"}]}"#;
        let corners = [0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        let bytes: Vec<u8> =
            corners.iter().flat_map(|x| x.to_le_bytes()).chain([0, 1, 2]).collect();
        let mut asked = 0;
        let pieces = read_with(Path::new("models/a.gltf"), &mut |path| {
            if path.ends_with("models/a.gltf") {
                return Ok(text.into());
            }
            asked += 1;
            assert_eq!(path, Path::new("models/b.bin"));
            Ok(bytes.clone())
        });
        assert_eq!((pieces.unwrap()[0].mesh.area_m2(), asked), (0.5, 1));
    }
}
