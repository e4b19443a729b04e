//! The extension module `sunglint._core`: workflows of the libraries for Python. The package's Python side (`sunglint/__init__.py`) gives them their names and classes.
//!
//! Long work runs in a thread of its own without the interpreter's lock, while the caller's thread listens for Ctrl-C: a signal ends the work at its next step.

mod archive;
mod body;
mod devices;
mod lab;
mod night;
mod product;
mod reading;
mod sky;
mod track;
mod watch;
mod workflows;

use pyo3::prelude::*;

/// Fills the module.
#[pymodule]
fn _core(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("Error", module.py().get_type::<watch::Error>())?;
    module.add_class::<product::Outcome>()?;
    module.add_class::<body::Body>()?;
    module.add_class::<body::Brdf>()?;
    module.add_class::<body::LightEngine>()?;
    archive::add(module)?;
    devices::add(module)?;
    lab::add(module)?;
    night::add(module)?;
    reading::add(module)?;
    sky::add(module)?;
    track::add(module)?;
    workflows::add(module)
}
