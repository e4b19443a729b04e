//! The bytes behind a glTF: chunks of a GLB, buffers in and beside the file, accessors into them.

use super::gltf::{Root, wrong};
use super::read::Load;
use glam::DVec3;
use std::path::Path;
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
    bytes: Vec<Vec<u8>>,
}

impl Buffers {
    pub fn load(
        path: &Path,
        root: &Root,
        chunk: Option<&[u8]>,
        load: Load,
    ) -> Result<Self, FileError> {
        let mut all = Vec::new();
        for (i, buffer) in root.buffers.iter().enumerate() {
            let at = format!("buffers[{i}]");
            let bytes = match (&buffer.uri, chunk) {
                (None, Some(chunk)) if i == 0 => chunk.to_vec(),
                (None, _) => return Err(wrong(path, at, "no uri", "a uri, or a GLB").into()),
                (Some(uri), _) => match uri.strip_prefix("data:") {
                    Some(data) => base64(data).ok_or_else(|| {
                        wrong(path, format!("{at}.uri"), "data that is no base64", "base64")
                    })?,
                    None => load(&path.with_file_name(beside(path, &at, uri)?))?,
                },
            };
            // A chunk may be padded to four bytes; nothing may be missing.
            if bytes.len() < buffer.byte_length {
                let found = format!("{} bytes", bytes.len());
                let expected = format!("byteLength = {}", buffer.byte_length);
                return Err(wrong(path, at, found, expected).into());
            }
            all.push(bytes);
        }
        Ok(Self { bytes: all })
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

/// What follows `data:` (RFC 2397), in base64 (RFC 4648, padded or not).
fn base64(data: &str) -> Option<Vec<u8>> {
    let text = data.split_once(";base64,")?.1.trim_end_matches('=');
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3 + 3);
    let (mut bits, mut count) = (0_u32, 0);
    for byte in text.bytes() {
        let value = match byte {
            b'A'..=b'Z' => byte - b'A',
            b'a'..=b'z' => byte - b'a' + 26,
            b'0'..=b'9' => byte - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            _ => return None,
        };
        bits = (bits << 6) | u32::from(value);
        count += 6;
        if count >= 8 {
            count -= 8;
            bytes.push((bits >> count) as u8);
            bits &= (1 << count) - 1;
        }
    }
    // A single digit left over holds no byte.
    (count < 6).then_some(bytes)
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
    let Some(buffer) = buffers.bytes.get(view.buffer) else {
        return error("no such buffer", &format!("one of {}", buffers.bytes.len()));
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
