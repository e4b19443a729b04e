//! Pictures as a backend delivers them.

use ndarray::Array2;

/// The pixels of a picture, `[row, column]`, in ADU.
#[derive(Debug, Clone, PartialEq)]
pub enum Planes {
    /// One number a pixel: a monochrome sensor, or a mosaic.
    Mono(Array2<u16>),
    /// Blue, green and red, in OpenCV's order.
    Bgr([Array2<u16>; 3]),
}

/// A picture as a backend delivers it.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// The pixels.
    pub planes: Planes,
    /// Bits of a pixel: 8 or 16.
    pub bits: u8,
    /// Number of the picture, from 0, among all that the source has delivered.
    pub index: u64,
    /// Where it lies in the recording, or when the device's driver says that it was taken (on a clock of its own), ms.
    pub position_ms: Option<f64>,
    /// When it had come, UTC of the host: of live sources only.
    pub arrived: Option<hifitime::Epoch>,
    /// Exposure, s, and gain as the driver said them when it came, where it does.
    pub readings: [Option<f64>; 2],
}

/// Which plane of a colour picture becomes the frame. Monochrome pictures are taken as they are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Plane {
    /// All three are one, as a decoder delivers a monochrome recording; refused where they differ.
    #[default]
    Same,
    /// The blue one.
    Blue,
    /// The green one.
    Green,
    /// The red one.
    Red,
}

impl Plane {
    /// The plane.
    ///
    /// # Errors
    /// The first pixel in which the planes of a picture differ that should be monochrome.
    pub(crate) fn of(self, planes: Planes) -> Result<Array2<u16>, String> {
        let [blue, green, red] = match planes {
            Planes::Mono(pixels) => return Ok(pixels),
            Planes::Bgr(planes) => planes,
        };
        match self {
            Self::Blue => Ok(blue),
            Self::Green => Ok(green),
            Self::Red => Ok(red),
            Self::Same => {
                let other = blue
                    .indexed_iter()
                    .find(|(place, value)| green[*place] != **value || red[*place] != **value);
                match other {
                    None => Ok(green),
                    Some((place, value)) => Err(format!(
                        "it is in colour (row {}, column {}: blue {value}, green {}, red {}): choose one of the planes",
                        place.0, place.1, green[place], red[place]
                    )),
                }
            }
        }
    }
}
