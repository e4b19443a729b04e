//! Style of channels in figures.

use crate::plot::{Series, colour_of_wavelength_nm};
use sunglint_radiometry::station::{Channel, Detector};

/// A line in the colour of the channel's band; the counters' are dashed, since a camera's band may be alike.
pub fn channel_line(channel: &Channel, points: Vec<(f64, f64)>) -> Series {
    let colour = colour_of_wavelength_nm(channel.mean_wavelength_nm());
    let dash = usize::from(matches!(channel.detector, Detector::Counter(_)));
    Series::line(&channel.name, 0, points).with_colour_and_dash(colour, dash)
}
