//! Meshes from files: OBJ, PLY, STL, glTF, by the extension of the name.
//!
//! Coordinates come out as they stand in the file, in double precision; glTF and this toolkit say metres, the other formats say nothing.
//! Files of a lying, cut or hostile header cost an error and no more memory than a small multiple of their own size.

use super::{Mesh, gltf, obj, ply, stl};
use std::path::Path;
use sunglint_formats::{FileError, ParseError};

/// No mesh that makes sense here is larger, bytes.
const LARGEST_FILE: u64 = 2 << 30;

/// A piece of a mesh file that has a name of its own.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct NamedMesh {
    /// Names of the piece in the file: OBJ groups, object and `usemtl`; the solid of an STL; node, mesh and material of glTF.
    pub names: Vec<String>,
    /// Triangles of the piece; none where the file opens a group and puts nothing into it.
    pub mesh: Mesh,
}

impl NamedMesh {
    /// Whether the file calls it so.
    pub fn is(&self, name: &str) -> bool {
        self.names.iter().any(|n| n == name)
    }
}

/// Reads a file: its pieces in the order of the file, with at least one triangle among them.
///
/// # Errors
/// [`FileError::Io`] where it cannot be read; [`FileError::Parse`] with the line, or the part of a binary file, where it is not what its
/// extension says, has coordinates that are not finite, or indices that lead nowhere.
pub fn read(path: impl AsRef<Path>) -> Result<Vec<NamedMesh>, FileError> {
    read_with(path.as_ref(), &mut |path| bytes(path))
}

/// The bytes of a file of a size that makes sense.
pub(crate) fn bytes(path: &Path) -> Result<Vec<u8>, FileError> {
    let about = std::fs::metadata(path);
    // A device such as /dev/zero has no length, and no end.
    if about.as_ref().is_ok_and(|about| !about.is_file() && !about.is_dir()) {
        return Err(ParseError::new(path, "a device or a pipe", "an ordinary file").into());
    }
    if let Ok(about) = about
        && about.len() > LARGEST_FILE
    {
        let found = format!("{} bytes", about.len());
        let expected = format!("at most {LARGEST_FILE} bytes");
        return Err(ParseError::new(path, found, expected).into());
    }
    sunglint_formats::read::bytes(path)
}

/// Gives the bytes of a file: the mesh itself, or a buffer beside it.
pub(crate) type Load<'a> = &'a mut dyn FnMut(&Path) -> Result<Vec<u8>, FileError>;

/// Reads a mesh like [`read()`], from wherever the bytes come.
pub(crate) fn read_with(path: &Path, load: Load) -> Result<Vec<NamedMesh>, FileError> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("").to_lowercase();
    let pieces = match extension.as_str() {
        "obj" => obj::parse(path, load(path)?)?,
        "ply" => ply::parse(path, load(path)?)?,
        "stl" => stl::parse(path, load(path)?)?,
        "gltf" | "glb" => gltf::parse(path, load)?,
        _ => {
            let found = format!("the extension `{extension}`");
            return Err(ParseError::new(path, found, "a mesh: obj, ply, stl, gltf or glb").into());
        }
    };
    if pieces.iter().all(|piece| piece.mesh.triangles.is_empty()) {
        return Err(ParseError::new(path, "no face", "at least one triangle").into());
    }
    Ok(pieces)
}
