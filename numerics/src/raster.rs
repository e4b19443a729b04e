//! Pictures as rows of bytes.

/// A picture of half the width and height, each pixel the rounded mean of four. `pixels` holds rows of `width` pixels of `channels` bytes each; an odd last row or column is left out.
///
/// It is here and not where pictures are drawn because that is compiled to be small, and this loop goes over megabytes.
///
/// ```
/// // Two by two pixels of two channels.
/// let pixels = [0, 10, 2, 20, 4, 30, 7, 41];
/// assert_eq!(sunglint_numerics::raster::halved(&pixels, 2, 2), [3, 25]);
/// ```
pub fn halved(pixels: &[u8], width: usize, channels: usize) -> Vec<u8> {
    let row = width * channels;
    let kept = width / 2;
    if kept == 0 || channels == 0 {
        return Vec::new();
    }
    let mut out = Vec::with_capacity(pixels.len() / 4);
    for pair in pixels.chunks_exact(2 * row) {
        let (upper, lower) = pair.split_at(row);
        let squares = upper.chunks_exact(2 * channels).zip(lower.chunks_exact(2 * channels));
        for (above, below) in squares.take(kept) {
            for channel in 0..channels {
                let sum = [above[channel], above[channel + channels]]
                    .into_iter()
                    .chain([below[channel], below[channel + channels]])
                    .map(u16::from)
                    .sum::<u16>();
                out.push(((sum + 2) / 4) as u8);
            }
        }
    }
    out
}
