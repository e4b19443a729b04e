//! The planes of a map's FITS file.

use sunglint_analysis::map::Grid;
use sunglint_formats::fits::Header;

/// The header of a plane over a sphere: its name and unit, and which longitude and latitude (`axes`, of what) its pixels have.
pub(super) fn header(
    name: &str,
    unit: Option<&str>,
    grid: Grid,
    axes: [&str; 2],
    of: &str,
) -> Header {
    let mut header = Header::default();
    header.set("EXTNAME", name, "");
    if let Some(unit) = unit {
        header.set("BUNIT", unit, "");
    }
    let step = grid.step_deg();
    for (axis, name, edge) in [(1, axes[0], -180.0), (2, axes[1], -90.0)] {
        header.set(&format!("CTYPE{axis}"), name, of);
        header.set(&format!("CUNIT{axis}"), "deg", "");
        header.set(&format!("CRPIX{axis}"), 1.0, "");
        header.set(&format!("CRVAL{axis}"), edge + 0.5 * step, "");
        header.set(&format!("CDELT{axis}"), step, "");
    }
    header.set("CREATOR", concat!("sunglint ", env!("CARGO_PKG_VERSION")), "");
    header
}
