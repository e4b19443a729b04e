//! FITS in and out: images and cubes with their headers, and binary tables. Standard: FITS 4.0 (IAU FITS Working Group
//! 2018).
//!
//! [`Fits`] holds the bytes of a file and knows where each HDU lies; [`Fits::image`] and [`Fits::table`] decode one.
//! [`Writer`] puts images and tables into a new file; [`Layout`] one that is filled row by row, for more than memory holds.
//!
//! ```
//! use ndarray::array;
//! use sunglint_formats::fits::{Fits, Header, Image, Pixels, Writer};
//!
//! let mut header = Header::default();
//! header.set("EXPTIME", 0.5, "exposure, s");
//! let image = Image { header, pixels: Pixels::U16(array![[1, 2, 3], [4, 5, 65535]].into_dyn()) };
//! let mut writer = Writer::new();
//! writer.image(&image)?;
//! let bytes = writer.into_bytes();
//!
//! let fits = Fits::from_bytes("frame.fits", bytes)?;
//! assert_eq!(fits.image(0)?, image);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! **Images**: BITPIX 8, 16, 32, 64, −32 and −64, any number of axes; the shape is in the order of numpy (NAXISn …
//! NAXIS1). BZERO as the standard uses it for unsigned integers (and signed bytes) gives those, exactly; any other
//! BSCALE or BZERO, and a BLANK that occurs, gives `f64` with `NaN`.
//!
//! **Tables**: columns L, B, I, J, K, E, D and A, single or vectors, with TSCAL, TZERO, TNULL and TUNIT. Vectors are
//! flat (TDIM counts for texts only), columns of no values are left out. Refused by name: bits (X),
//! complex numbers (C, M), variable length (P, Q), random groups. **Tile-compressed images** (`.fits.fz`) are unpacked
//! by [`Fits::compressed_image`].
//!
//! **Texts** in a header are printable ASCII by the standard. Others are written with `\uXXXX` for each UTF-16 unit that
//! is not, and a card `UESCAPED` names the keywords of these texts; this reader undoes it (and hides that card), other
//! programs show the escapes. A text that looks like an escape in a header without that card stays as it is. Keywords,
//! names of columns, units and the texts *in* columns are not escaped but refused if they are not ASCII. JSON in a header
//! is best written by [`ascii_json`], which every reader of JSON understands.
//!
//! **Hostile files**: nothing is allocated before the bytes that it should hold are seen to be there, so memory is
//! bounded by the size of the file; what is wrong is a [`ParseError`](crate::ParseError) with the keyword.
//!
//! *Why not the crate `fitsrs` (0.4.1)?* Tried on files of astropy: it reads cards, images and tables, and 20,000
//! mutated files gave no panic. But it gives raw integers (no BZERO, TZERO, TSCAL, TNULL: an unsigned 16-bit frame
//! comes out as negative numbers), it ends silently where the data are cut off (10,000 pixels promised, 1,440 there:
//! 1,440 pixels and no error), and sizes that overflow (`NAXIS1` × `NAXIS2`, a TFORM repeat) panic in a checked build
//! and wrap around in another. What would be left of it is smaller than the work around it.

mod card;
mod escape;
mod file;
mod filling;
mod header;
mod image;
mod table;
mod table_out;
mod tiles;
mod writer;

pub use card::{Card, CardValue};
pub use escape::ascii_json;
pub use file::{Fits, Hdu, Kind, inflate};
pub use filling::{Filling, FillingError, Layout};
pub use header::Header;
pub use image::{Image, Pixels};
pub use writer::Writer;

/// Files come in blocks of so many bytes.
const BLOCK: usize = 2880;
/// A card has so many.
const CARD: usize = 80;
