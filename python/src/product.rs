//! Results: tables as arrays, the summary as JSON, figures as bytes.

use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyList};
use sunglint_formats::{Table, Values};
use sunglint_report::plot::Style;
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

    /// The panels of the figure, top to bottom: axes, series as arrays, shaded spans, a field of values.
    fn panels<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let list = PyList::empty(py);
        let figure = self.product.figure.as_ref();
        for panel in figure.map_or(&[][..], |figure| &figure.panels) {
            let one = PyDict::new(py);
            for (name, axis) in [("x", &panel.x), ("y", &panel.y)] {
                let own = PyDict::new(py);
                own.set_item("label", &axis.label)?;
                own.set_item("range", axis.range)?;
                own.set_item("log", axis.log)?;
                own.set_item("inverted", axis.inverted)?;
                one.set_item(name, own)?;
            }
            let all = PyList::empty(py);
            for series in &panel.series {
                let own = PyDict::new(py);
                let column = |of: fn(&(f64, f64)) -> f64| {
                    PyArray1::from_vec(py, series.points.iter().map(of).collect::<Vec<f64>>())
                };
                own.set_item("label", &series.label)?;
                own.set_item("x", column(|point| point.0))?;
                own.set_item("y", column(|point| point.1))?;
                own.set_item(
                    "style",
                    match series.style {
                        Style::Line => "line",
                        Style::Dots => "dots",
                        Style::Area => "area",
                    },
                )?;
                let colour = series.colour;
                own.set_item("colour", (colour.0, colour.1, colour.2))?;
                own.set_item("dash", series.dash)?;
                all.append(own)?;
            }
            one.set_item("series", all)?;
            let spans = PyList::empty(py);
            for span in &panel.spans {
                let colour = (span.colour.0, span.colour.1, span.colour.2);
                spans.append((&span.label, span.range.0, span.range.1, colour))?;
            }
            one.set_item("spans", spans)?;
            if let Some(heat) = &panel.heat {
                let own = PyDict::new(py);
                own.set_item("x_edges", PyArray1::from_slice(py, &heat.x_edges))?;
                own.set_item("y_edges", PyArray1::from_slice(py, &heat.y_edges))?;
                own.set_item("values", PyArray1::from_slice(py, &heat.values))?;
                own.set_item("label", heat.label.join("\n"))?;
                own.set_item("decades", heat.decades)?;
                one.set_item("heat", own)?;
            }
            list.append(one)?;
        }
        Ok(list)
    }

    /// Title of the figure; `None` where there is none.
    #[getter]
    fn title(&self) -> Option<&str> {
        self.product.figure.as_ref().map(|figure| figure.title.as_str())
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
