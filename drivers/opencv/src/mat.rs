//! OpenCV's matrices, in and out.

use crate::picture::Planes;
use ndarray::Array2;
use opencv::core::{CV_8U, CV_16U, DataType, Mat, Vec3b, Vec3w};
use opencv::prelude::*;

/// The pixels of a matrix and their bits.
pub(crate) fn planes(mat: &Mat) -> Result<(Planes, u8), String> {
    let (rows, columns) = (mat.rows(), mat.cols());
    if mat.dims() != 2 || rows <= 0 || columns <= 0 {
        return Err(format!("a picture of {columns} × {rows} pixels, {} axes", mat.dims()));
    }
    let shape = (rows as usize, columns as usize);
    match (mat.depth(), mat.channels()) {
        (CV_8U, 1) => Ok((Planes::Mono(plane::<u8>(mat, shape, |v| (*v).into())?), 8)),
        (CV_16U, 1) => Ok((Planes::Mono(plane::<u16>(mat, shape, |v| *v)?), 16)),
        (CV_8U, 3) => {
            Ok((Planes::Bgr(three(|c| plane::<Vec3b>(mat, shape, |v| v.0[c].into()))?), 8))
        }
        (CV_16U, 3) => Ok((Planes::Bgr(three(|c| plane::<Vec3w>(mat, shape, |v| v.0[c]))?), 16)),
        (depth, channels) => Err(format!(
            "pixels of OpenCV's depth {depth} in {channels} channels, expected 8 or 16 bits unsigned in 1 or 3"
        )),
    }
}

/// One of two interleaved channels of 8 bits: the brightness of YUYV (0) or UYVY (1).
pub(crate) fn brightness(mat: &Mat, channel: usize) -> Result<(Planes, u8), String> {
    if (mat.depth(), mat.channels()) != (CV_8U, 2) || mat.rows() <= 0 {
        let (depth, channels) = (mat.depth(), mat.channels());
        return Err(format!(
            "pixels of OpenCV's depth {depth} in {channels} channels, expected 8 bits in 2 (YUYV, UYVY)"
        ));
    }
    let shape = (mat.rows() as usize, mat.cols() as usize);
    let pixels = plane::<opencv::core::Vec2b>(mat, shape, |v| v.0[channel].into())?;
    Ok((Planes::Mono(pixels), 8))
}

fn three(
    mut one: impl FnMut(usize) -> Result<Array2<u16>, String>,
) -> Result<[Array2<u16>; 3], String> {
    Ok([one(0)?, one(1)?, one(2)?])
}

fn plane<T: DataType>(
    mat: &Mat,
    (rows, columns): (usize, usize),
    value: impl Fn(&T) -> u16,
) -> Result<Array2<u16>, String> {
    let mut pixels = Vec::with_capacity(rows * columns);
    for row in 0..mat.rows() {
        // Row by row: a matrix may have gaps between its rows.
        let row = mat.at_row::<T>(row).map_err(|error| error.message)?;
        pixels.extend(row.iter().map(&value));
    }
    let found = pixels.len();
    Array2::from_shape_vec((rows, columns), pixels)
        .map_err(|_| format!("{found} pixels, expected {columns} × {rows}"))
}
