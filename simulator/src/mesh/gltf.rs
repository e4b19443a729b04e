//! glTF 2.0, as JSON with buffers in it or beside it, and as GLB. Its unit is the metre; its axes are left as they stand in the file
//! (+y is up by its rules).
//!
//! Source: Khronos Group, "glTF 2.0 Specification". Read are the nodes of the scene with their transformations and the triangles and
//! normals of their meshes. Skins, sparse accessors and compressed meshes are refused.

use super::read::{Load, NamedMesh};
use super::{Mesh, gltf_data};
use glam::{DMat3, DMat4, DQuat, DVec3};
use gltf_data::{Buffers, indices, positions};
use serde::Deserialize;
use std::path::Path;
use sunglint_formats::{FileError, ParseError};

/// A file may name the same mesh from many nodes; this is more than makes sense, triangles or corners.
const MOST_TRIANGLES: usize = 20_000_000;

#[derive(Deserialize, Default)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Root {
    asset: Asset,
    extensions_required: Vec<String>,
    scene: Option<usize>,
    scenes: Vec<Scene>,
    nodes: Vec<Node>,
    meshes: Vec<MeshJson>,
    materials: Vec<Named>,
    pub accessors: Vec<Accessor>,
    pub buffer_views: Vec<BufferView>,
    pub buffers: Vec<Buffer>,
}

#[derive(Deserialize, Default)]
#[serde(default)]
struct Asset {
    version: String,
}

#[derive(Deserialize, Default)]
#[serde(default)]
struct Scene {
    nodes: Vec<usize>,
}

#[derive(Deserialize, Default)]
#[serde(default)]
struct Named {
    name: Option<String>,
}

#[derive(Deserialize, Default)]
#[serde(default)]
struct Node {
    name: Option<String>,
    children: Vec<usize>,
    mesh: Option<usize>,
    skin: Option<usize>,
    matrix: Option<[f64; 16]>,
    translation: Option<[f64; 3]>,
    rotation: Option<[f64; 4]>,
    scale: Option<[f64; 3]>,
}

#[derive(Deserialize, Default)]
#[serde(default)]
struct MeshJson {
    name: Option<String>,
    primitives: Vec<Primitive>,
}

#[derive(Deserialize, Default)]
#[serde(default)]
struct Primitive {
    attributes: Attributes,
    indices: Option<usize>,
    material: Option<usize>,
    mode: Option<u32>,
}

#[derive(Deserialize, Default)]
#[serde(default)]
struct Attributes {
    #[serde(rename = "POSITION")]
    position: Option<usize>,
    #[serde(rename = "NORMAL")]
    normal: Option<usize>,
}

#[derive(Deserialize, Default)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Accessor {
    pub buffer_view: Option<usize>,
    pub byte_offset: usize,
    pub component_type: u32,
    pub normalized: bool,
    pub count: usize,
    #[serde(rename = "type")]
    pub kind: String,
    pub sparse: Option<serde::de::IgnoredAny>,
}

#[derive(Deserialize, Default)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct BufferView {
    pub buffer: usize,
    pub byte_offset: usize,
    pub byte_length: usize,
    pub byte_stride: Option<usize>,
}

#[derive(Deserialize, Default)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Buffer {
    pub uri: Option<String>,
    pub byte_length: usize,
}

/// An error at a place of the document, as `nodes[3].mesh`.
pub(super) fn wrong(
    path: &Path,
    at: impl Into<String>,
    found: impl Into<String>,
    expected: impl Into<String>,
) -> ParseError {
    ParseError::new(path, found, expected).in_field(at)
}

pub(super) fn parse(path: &Path, load: Load) -> Result<Vec<NamedMesh>, FileError> {
    let bytes = load(path)?;
    let (json, chunk) = if bytes.starts_with(b"glTF") {
        gltf_data::split_glb(path, &bytes)?
    } else {
        (&bytes[..], None)
    };
    let root: Root = serde_json::from_slice(json).map_err(|error| {
        ParseError::new(path, "what is no glTF", "glTF 2.0")
            .at_line(error.line() as u64)
            .with_hint(error.to_string())
    })?;
    check(path, &root)?;
    let buffers = Buffers::load(path, &root, chunk, load)?;
    let mut reader = Reader { path, root: &root, buffers, pieces: Vec::new(), triangles: 0 };
    reader.walk()?;
    Ok(reader.pieces)
}

fn check(path: &Path, root: &Root) -> Result<(), ParseError> {
    let version = &root.asset.version;
    if version != "2" && !version.starts_with("2.") {
        return Err(wrong(path, "asset.version", format!("`{version}`"), "2.0"));
    }
    // Materials, textures and lamps are not read; everything else may change the shape.
    let harmless = ["KHR_materials_", "KHR_texture_", "KHR_lights_", "EXT_texture_"];
    let foreign = root
        .extensions_required
        .iter()
        .find(|name| !harmless.iter().any(|start| name.starts_with(start)));
    match foreign {
        Some(name) => {
            let found = format!("`{name}`");
            let error = wrong(path, "extensionsRequired", found, "no extension of the shape");
            Err(error.with_hint("export without compression"))
        }
        None => Ok(()),
    }
}

struct Reader<'r> {
    path: &'r Path,
    root: &'r Root,
    buffers: Buffers,
    pieces: Vec<NamedMesh>,
    triangles: usize,
}

impl Reader<'_> {
    /// All nodes of the scene. Without a scene, all nodes that are nobody's child.
    fn walk(&mut self) -> Result<(), ParseError> {
        let root = self.root;
        let starts: Vec<usize> = match root.scenes.get(root.scene.unwrap_or(0)) {
            Some(scene) => scene.nodes.clone(),
            None if root.scene.is_some() => {
                let found = format!("{}", root.scene.unwrap_or(0));
                let expected = format!("one of {} scenes", root.scenes.len());
                return Err(wrong(self.path, "scene", found, expected));
            }
            None => {
                let mut is_child = vec![false; root.nodes.len()];
                for &child in root.nodes.iter().flat_map(|node| &node.children) {
                    if let Some(flag) = is_child.get_mut(child) {
                        *flag = true;
                    }
                }
                (0..root.nodes.len()).filter(|&n| !is_child[n]).collect()
            }
        };
        let mut seen = vec![false; root.nodes.len()];
        let mut open: Vec<(usize, DMat4)> =
            starts.into_iter().rev().map(|node| (node, DMat4::IDENTITY)).collect();
        while let Some((index, above)) = open.pop() {
            let at = format!("nodes[{index}]");
            let Some(node) = root.nodes.get(index) else {
                let expected = format!("one of {} nodes", root.nodes.len());
                return Err(wrong(self.path, at, "no such node", expected));
            };
            if std::mem::replace(&mut seen[index], true) {
                let expected = "a tree, in which every node has one parent";
                return Err(wrong(self.path, at, "a node that is there twice", expected));
            }
            let here = above * self.transform(&at, node)?;
            if let Some(mesh) = node.mesh {
                if node.skin.is_some() {
                    return Err(wrong(self.path, at, "a skin", "a rigid mesh"));
                }
                self.mesh(&at, node, mesh, here)?;
            }
            open.extend(node.children.iter().rev().map(|&child| (child, here)));
        }
        Ok(())
    }

    fn transform(&self, at: &str, node: &Node) -> Result<DMat4, ParseError> {
        let matrix = match node.matrix {
            Some(columns) => DMat4::from_cols_array(&columns),
            None => {
                let rotation = DQuat::from_array(node.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]));
                // Single precision leaves 1e-7; far from 1 it is no rotation.
                if (rotation.length() - 1.0).abs() > 1e-3 {
                    let found = format!("a quaternion of length {}", rotation.length());
                    return Err(wrong(self.path, format!("{at}.rotation"), found, "length 1"));
                }
                DMat4::from_scale_rotation_translation(
                    DVec3::from_array(node.scale.unwrap_or([1.0; 3])),
                    rotation.normalize(),
                    DVec3::from_array(node.translation.unwrap_or([0.0; 3])),
                )
            }
        };
        if !matrix.is_finite() || matrix.row(3) != glam::DVec4::W {
            return Err(wrong(
                self.path,
                at,
                "a transformation that is not affine",
                "an affine one",
            ));
        }
        Ok(matrix)
    }

    fn mesh(&mut self, at: &str, node: &Node, mesh: usize, to: DMat4) -> Result<(), ParseError> {
        let Some(json) = self.root.meshes.get(mesh) else {
            let expected = format!("one of {} meshes", self.root.meshes.len());
            return Err(wrong(self.path, format!("{at}.mesh"), mesh.to_string(), expected));
        };
        for (p, primitive) in json.primitives.iter().enumerate() {
            let at = format!("meshes[{mesh}].primitives[{p}]");
            let mode = primitive.mode.unwrap_or(4);
            if mode < 4 {
                // Points and lines have no area.
                continue;
            }
            let mut piece = self.primitive(&at, primitive, mode)?;
            for vertex in &mut piece.vertices {
                *vertex = to.transform_point3(*vertex);
            }
            if piece.vertices.iter().any(|v| !v.is_finite()) {
                return Err(wrong(self.path, at, "coordinates out of range", "finite ones"));
            }
            // Normals are planes' and go by the cofactors, which need no inverse and mirror as triangles do.
            let matrix = DMat3::from_mat4(to);
            let cofactors = DMat3::from_cols(
                matrix.y_axis.cross(matrix.z_axis),
                matrix.z_axis.cross(matrix.x_axis),
                matrix.x_axis.cross(matrix.y_axis),
            );
            let side = matrix.determinant().signum();
            for normal in &mut piece.normals {
                *normal = (side * (cofactors * *normal)).normalize_or_zero();
            }
            // A mirroring transformation turns the triangles over.
            if DMat3::from_mat4(to).determinant() < 0.0 {
                piece = Mesh { normals: std::mem::take(&mut piece.normals), ..piece.flipped() };
            }
            self.triangles += piece.triangles.len().max(piece.vertices.len());
            if self.triangles > MOST_TRIANGLES {
                let found = format!("{} triangles or corners", self.triangles);
                return Err(wrong(self.path, at, found, format!("at most {MOST_TRIANGLES}")));
            }
            let material = primitive.material.and_then(|m| self.root.materials.get(m));
            let names = [&node.name, &json.name, &material.and_then(|m| m.name.clone())];
            let names = names.into_iter().flatten().cloned().collect();
            self.pieces.push(NamedMesh { names, mesh: piece });
        }
        Ok(())
    }

    fn primitive(&self, at: &str, primitive: &Primitive, mode: u32) -> Result<Mesh, ParseError> {
        let Some(position) = primitive.attributes.position else {
            return Err(wrong(self.path, at, "no attribute POSITION", "corners"));
        };
        let vertices = positions(self.path, self.root, &self.buffers, position)?;
        let normals = match primitive.attributes.normal {
            Some(accessor) => positions(self.path, self.root, &self.buffers, accessor)?,
            None => Vec::new(),
        };
        if !normals.is_empty() && normals.len() != vertices.len() {
            let found = format!("{} normals", normals.len());
            return Err(wrong(self.path, at, found, format!("one for each of {}", vertices.len())));
        }
        let normals = normals.into_iter().map(DVec3::normalize_or_zero).collect();
        let order: Vec<u32> = match primitive.indices {
            Some(accessor) => indices(self.path, self.root, &self.buffers, accessor)?,
            None => (0..vertices.len() as u32).collect(),
        };
        if let Some(bad) = order.iter().find(|i| **i as usize >= vertices.len()) {
            let expected = format!("one of {} corners", vertices.len());
            return Err(wrong(self.path, format!("{at}.indices"), bad.to_string(), expected));
        }
        let triangles: Vec<[u32; 3]> = match mode {
            4 if !order.len().is_multiple_of(3) => {
                let found = format!("{} indices", order.len());
                return Err(wrong(self.path, at, found, "three for each triangle"));
            }
            4 => order.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
            // A strip: every other triangle is turned over.
            5 => order
                .windows(3)
                .enumerate()
                .map(|(i, t)| if i % 2 == 0 { [t[0], t[1], t[2]] } else { [t[1], t[0], t[2]] })
                .collect(),
            6 => order.windows(2).skip(1).map(|pair| [order[0], pair[0], pair[1]]).collect(),
            _ => return Err(wrong(self.path, format!("{at}.mode"), mode.to_string(), "0 to 6")),
        };
        Ok(Mesh { vertices, triangles, normals })
    }
}
