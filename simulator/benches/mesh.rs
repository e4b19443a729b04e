//! Benchmark of a mesh of 1.3 million triangles: to read from each format, to examine, to export.

use std::path::PathBuf;
use sunglint_simulator::mesh::shapes::{Faceting, icosphere};
use sunglint_simulator::mesh::{Mesh, read, write_obj};

fn main() {
    divan::main();
}

fn sphere() -> Mesh {
    icosphere(1.0, 8, Faceting::Inscribed)
}

/// The sphere as a file in a folder that is deleted afterwards.
fn file(name: &str, bytes: impl AsRef<[u8]>) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder for the mesh");
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).expect("room for the mesh");
    (folder, path)
}

fn bench_read(bencher: divan::Bencher, name: &str, bytes: impl AsRef<[u8]>) {
    let (_folder, path) = file(name, bytes);
    bencher.bench(|| read(&path).expect("a mesh"));
}

#[divan::bench(sample_count = 3, sample_size = 1)]
fn read_stl(bencher: divan::Bencher) {
    let mesh = sphere();
    let mut bytes = vec![0; 80];
    bytes.extend((mesh.triangles.len() as u32).to_le_bytes());
    for corners in mesh.faces() {
        bytes.extend([0; 12]);
        for x in corners.iter().flat_map(|c| c.to_array()) {
            bytes.extend((x as f32).to_le_bytes());
        }
        bytes.extend([0; 2]);
    }
    bench_read(bencher, "a.stl", bytes);
}

#[divan::bench(sample_count = 3, sample_size = 1)]
fn read_ply(bencher: divan::Bencher) {
    let mesh = sphere();
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\nelement face {}\nproperty list uchar uint vertex_indices\nend_header\n",
        mesh.vertices.len(),
        mesh.triangles.len()
    )
    .into_bytes();
    bytes.extend(mesh.vertices.iter().flat_map(|v| v.to_array()).flat_map(f64::to_le_bytes));
    for triangle in &mesh.triangles {
        bytes.push(3);
        bytes.extend(triangle.iter().flat_map(|i| i.to_le_bytes()));
    }
    bench_read(bencher, "a.ply", bytes);
}

#[divan::bench(sample_count = 3, sample_size = 1)]
fn read_obj(bencher: divan::Bencher) {
    bench_read(bencher, "a.obj", write_obj("", [("sphere", "white", &sphere())]));
}

#[divan::bench(sample_count = 3, sample_size = 1)]
fn examine(bencher: divan::Bencher) {
    let mesh = sphere();
    bencher.bench(|| mesh.examine());
}

#[divan::bench(sample_count = 3, sample_size = 1)]
fn export(bencher: divan::Bencher) {
    let mesh = sphere();
    bencher.bench(|| write_obj("", [("sphere", "white", &mesh)]));
}
