//! Results: tables as arrays, the summary as JSON, figures as bytes.

use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyList};
use sunglint_formats::{Table, Values};
use sunglint_report::{Format, Product};

/// A result in all its forms.
#[pyclass(frozen, module = "sunglint._core")]
pub struct Outcome {
    product: Product,
    text: String,
    warnings: Vec<String>,
    files: Vec<(String, String)>,
    /// Pictures that are no figure of panels: their forms and bytes.
    pictures: Vec<(String, Vec<u8>)>,
}

impl Outcome {
    /// A result with its text and warnings.
    pub fn new(product: Product, text: String, warnings: Vec<String>) -> Self {
        Self { product, text, warnings, files: Vec::new(), pictures: Vec::new() }
    }

    /// The same with files that belong to it: names and contents.
    pub fn with_files(mut self, files: Vec<(String, String)>) -> Self {
        self.files = files;
        self
    }

    /// The same with pictures in place of a figure.
    pub fn with_pictures(mut self, pictures: Vec<(String, Vec<u8>)>) -> Self {
        self.pictures = pictures;
        self
    }
}

#[pymethods]
impl Outcome {
    /// Name of the result.
    #[getter]
    fn name(&self) -> &str {
        &self.product.name
    }

    /// The summary that the program prints.
    #[getter]
    fn text(&self) -> &str {
        &self.text
    }

    /// Warnings that a person should read first.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.warnings.clone()
    }

    /// Other files of the result: a dict of names and texts.
    #[getter]
    fn files(&self) -> Vec<(String, String)> {
        self.files.clone()
    }

    /// The summary as JSON text, that of `--json`.
    fn json(&self) -> PyResult<String> {
        serde_json::to_string(&self.product.json)
            .map_err(|e| super::watch::Error::new_err(e.to_string()))
    }

    /// Tables: names, and of each its columns (name, unit, description, values) and metadata as JSON.
    fn tables<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let all = std::iter::once(&self.product).chain(&self.product.others);
        let list = PyList::empty(py);
        for product in all.filter(|p| !p.table.columns.is_empty()) {
            list.append((
                &product.name,
                columns(py, &product.table)?,
                serde_json::to_string(&product.table.meta)
                    .map_err(|e| super::watch::Error::new_err(e.to_string()))?,
            ))?;
        }
        Ok(list)
    }

    /// Whether there is a figure.
    #[getter]
    fn has_figure(&self) -> bool {
        self.product.figure.is_some() || self.product.gallery.is_some() || !self.pictures.is_empty()
    }

    /// The bytes of a form: `ecsv`, `csv`, `fits`, `json`, `html`, `png` or `svg`.
    fn encode<'py>(&self, py: Python<'py>, format: &str) -> PyResult<Bound<'py, PyBytes>> {
        if let Some((_, bytes)) = self.pictures.iter().find(|(form, _)| form == format) {
            return Ok(PyBytes::new(py, bytes));
        }
        let known = Format::of_extension(format).ok_or_else(|| {
            super::watch::Error::new_err(format!(
                "the form `{format}` is not known: ecsv, csv, fits, json, html, png, svg"
            ))
        })?;
        let bytes = py
            .detach(|| self.product.encode(known))
            .map_err(|error| super::watch::exception(py, &error))?;
        Ok(PyBytes::new(py, &bytes))
    }
}

/// Columns as arrays: numbers as float64 or int64 (with NaN or as objects where values lack), texts as lists.
pub fn columns<'py>(py: Python<'py>, table: &Table) -> PyResult<Bound<'py, PyList>> {
    let list = PyList::empty(py);
    for column in &table.columns {
        let values: Bound<'py, PyAny> = match &column.values {
            Values::Text(texts) => PyList::new(py, texts)?.into_any(),
            Values::Bool(values) => PyList::new(py, values)?.into_any(),
            Values::I64(values) => {
                let whole: Option<Vec<i64>> = values.iter().copied().collect();
                match whole {
                    Some(whole) => PyArray1::from_vec(py, whole).into_any(),
                    None => PyList::new(py, values)?.into_any(),
                }
            }
            _ => match (table.f64(&column.name), table.f64_vectors(&column.name)) {
                (Ok(values), _) => PyArray1::from_slice(py, &values).into_any(),
                (_, Ok((width, values))) if width > 0 => {
                    let rows = values.len() / width;
                    let flat = PyArray1::from_slice(py, values);
                    let shaped: Bound<'py, PyArray2<f64>> = flat.reshape([rows, width])?;
                    shaped.into_any()
                }
                _ => continue,
            },
        };
        let one = PyDict::new(py);
        one.set_item("name", &column.name)?;
        one.set_item("unit", &column.unit)?;
        one.set_item("description", &column.description)?;
        one.set_item("values", values)?;
        list.append(one)?;
    }
    Ok(list)
}
