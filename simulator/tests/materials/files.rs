//! Materials in TOML: every example of the documentation, and what is refused.

use crate::materials::cases;
use sunglint_formats::toml::Document;
use sunglint_simulator::surface::Material;
use sunglint_simulator::surface::file::{MaterialFile, material};
use sunglint_testkit::repository;

#[derive(serde::Deserialize)]
struct File {
    material: Vec<MaterialFile>,
}

fn parse(folder: &std::path::Path, text: &str) -> Result<Vec<Material>, String> {
    let document = Document::new(folder.join("m.toml"), text).map_err(|e| e.to_string())?;
    let file: File = document.parse().map_err(|e| e.to_string())?;
    let made = |(k, file)| material(&document, &format!("material[{k}]"), file);
    let made = file.material.iter().enumerate().map(made);
    made.map(|m| m.map(|m| m.0).map_err(|e| e.to_string())).collect()
}

/// Every example of docs/materials.md is a material that can be made, and every model has one.
#[test]
fn the_examples_of_the_documentation_work() {
    let folder = tempfile::tempdir().unwrap();
    let (_, file) = cases::files().swap_remove(2);
    std::fs::write(folder.path().join("kapton_spec.bsdf"), file.to_bytes().unwrap()).unwrap();
    let text = std::fs::read_to_string(repository().join("docs/materials.md")).unwrap();
    let mut models = Vec::new();
    for block in text.split("```").skip(1).step_by(2) {
        let Some((kind, body)) = block.split_once('\n') else { continue };
        if let Some(name) = kind.strip_prefix("csv ") {
            std::fs::write(folder.path().join(name), body).unwrap();
        } else if kind == "toml" {
            let made = parse(folder.path(), body).unwrap_or_else(|e| panic!("{e}\n{body}"));
            assert!(!made.is_empty(), "{body}");
            models.extend(
                body.lines()
                    .filter_map(|l| l.strip_prefix("model = "))
                    .map(|l| l.split('"').nth(1).unwrap().to_owned()),
            );
        }
    }
    for model in [
        "lambert",
        "mirror",
        "microfacet",
        "blend",
        "phong",
        "ward",
        "abg",
        "maxwell_beard",
        "cook_torrance",
        "foil",
        "measured",
        "brdf_table",
    ] {
        assert!(models.iter().any(|m| m == model), "no example of {model}");
    }
}

#[test]
fn keys_that_are_missing_or_of_no_use_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |body: &str, words: &[&str]| {
        let error =
            parse(folder.path(), &format!("[[material]]\nname = \"m\"\n{body}")).unwrap_err();
        for word in words {
            assert!(error.contains(word), "{error} lacks {word}");
        }
    };
    refused("model = \"phong\"\nreflectance = 0.5", &["exponent"]);
    refused("model = \"phong\"\nexponent = 5", &["reflectance"]);
    refused("model = \"phong\"\nexponent = 5\nreflectance = 0.5\nalpha = 0.2", &["alpha", "phong"]);
    refused("model = \"ward\"\nreflectance = 0.5\nalpha_x = 0.2", &["alpha"]);
    refused("model = \"ward\"\nreflectance = 0.5\nalpha = 0.2\nform = \"new\"", &["bounded"]);
    refused("model = \"abg\"\nreflectance = 1\na_per_sr = 1\nb = 1e-4", &["g"]);
    refused(
        "model = \"abg\"\nreflectance = 1\na_per_sr = 1\nb = 1e-4\ng = 2",
        &["of the light at"],
    );
    refused("model = \"maxwell_beard\"\nbias_per_sr = 0.1", &["sigma"]);
    refused(
        "model = \"maxwell_beard\"\nbias_per_sr = 0.1\nsigma = 1\ntau_deg = 1\nomega_deg = 1",
        &["refractive_index"],
    );
    refused("model = \"cook_torrance\"\nreflectance = 0.5", &["lobe"]);
    refused("model = \"foil\"\nslope_rms = 0.2", &["of"]);
    refused(
        "model = \"foil\"\nslope_rms = 0.2\nof = { name = \"x\", model = \"lambert\" }",
        &["reflectance"],
    );
    refused("model = \"measured\"", &["file"]);
    refused("model = \"measured\"\nfile = \"none.bsdf\"", &["none.bsdf"]);
    refused("model = \"measured\"\nfile = \"x\"\nreflectance = 0.5", &["reflectance", "measured"]);
    refused("model = \"brdf_table\"\nfile = \"none.csv\"", &["none.csv"]);
    refused("model = \"velvet\"", &["velvet"]);
}
