//! ECSV (Astropy Proposal for Enhancement 6, version 1.0): tables as text that a person can open and astropy reads.
//!
//! A header of comment lines holds YAML (columns with datatype, unit and description, then metadata); the rows follow
//! as comma- or blank-separated values.
//!
//! Datatypes read: `bool`, `int8` … `uint64`, `float16` … `float64`, `string`. An integer must lie in the range of its
//! datatype, and within `i64`. A `float32` is the nearest `f32`, widened. **Missing:** an empty field, quoted or not,
//! is missing (`NaN` among floats); in a text column a quoted `""` is the empty text, an unquoted empty field is
//! missing. (astropy takes both as missing.) Lines that begin with `#` between rows are comments, blank lines are
//! skipped, as astropy does.
//!
//! Datatypes refused: `float128`, `complex`, and columns with a `subtype` (arrays and JSON inside a text), by name. The
//! attributes `format` and `meta` of a column are not kept. Classes that astropy names in the metadata
//! (`__serialized_columns__`) stay there as plain data (a time column is text), and are not written again.
//!
//! YAML is read with `serde-saphyr`.

mod reader;
mod rows;
mod writer;

pub use reader::{read, read_str};
pub use writer::{head, rows, to_string, write_file};
