//! A stretch of a recorded session as a film: frames with one stretch, as an animated PNG.

use crate::frame::{Part, binned};
use crate::request::Answer;
use png::{BitDepth, ColorType, Encoder, EncodingError};
use serde::Deserialize;
use sunglint_formats::Frame;

/// Frames of a clip at most.
const FRAMES: usize = 2000;
/// Pixels of all its frames at most: it has a byte for each before it is packed, and is held in memory once.
const PIXELS: usize = 100_000_000;
/// Sides of its frames at most, px.
const SIDE: usize = 1280;
/// Time for which a frame is shown, ms.
const SHOWN_MS: std::ops::RangeInclusive<u16> = 10..=10_000;

/// Clip that is asked for.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ClipWish {
    /// Name of the camera.
    pub camera: String,
    /// Numbers of the first and the last frame.
    pub from: u64,
    pub to: u64,
    /// Every so-and-so-many-th frame of them.
    #[serde(default = "one")]
    pub every: usize,
    /// First column and row, columns and rows of the part that is shown; without it the whole frame.
    pub part_px: Option<[usize; 4]>,
    /// Darkest and brightest value, ADU.
    pub(crate) range_adu: [f64; 2],
    /// Part of the range below which the stretch is a line and above which it is a logarithm; without it all is a line.
    pub soft: Option<f64>,
    /// Whether it is shown in red light.
    #[serde(default)]
    pub red: bool,
    /// Time for which each frame is shown, ms.
    pub shown_ms: u16,
}

fn one() -> usize {
    1
}

fn wrong(text: &str) -> Answer {
    Answer::error(422, text)
}

impl ClipWish {
    /// Checks what can be checked without the frames.
    pub fn check(&self) -> Result<(), Answer> {
        let [low, high] = self.range_adu;
        if !(low.is_finite() && high.is_finite() && low < high) {
            return Err(wrong("`range_adu` is a darkest and a brighter value, ADU"));
        }
        if self.soft.is_some_and(|soft| !(soft > 0.0 && soft.is_finite())) {
            return Err(wrong("`soft` is a number above 0"));
        }
        if self.every == 0 {
            return Err(wrong("`every` is a whole number from 1 on"));
        }
        if !SHOWN_MS.contains(&self.shown_ms) {
            let (least, most) = (SHOWN_MS.start(), SHOWN_MS.end());
            return Err(wrong(&format!("`shown_ms` is {least} to {most} ms")));
        }
        Ok(())
    }

    /// The clip's frames among all of a camera, by their numbers.
    pub fn chosen(&self, numbers: impl Iterator<Item = u64>) -> Result<Vec<usize>, Answer> {
        let within = numbers.enumerate().filter(|(_, n)| (self.from..=self.to).contains(n));
        let chosen: Vec<usize> = within.step_by(self.every).map(|(index, _)| index).collect();
        if chosen.is_empty() {
            return Err(wrong(&format!(
                "camera {} has no frame from number {} to {}",
                self.camera, self.from, self.to
            )));
        }
        if chosen.len() > FRAMES {
            return Err(wrong(&format!(
                "this clip has {} frames, at most {FRAMES} can be: take every {}th",
                chosen.len(),
                self.every * chosen.len().div_ceil(FRAMES)
            )));
        }
        Ok(chosen)
    }

    /// Brightness of each value of a pixel.
    fn table(&self) -> Vec<u8> {
        let [low, high] = self.range_adu;
        let of = |value: u32| {
            let part = ((f64::from(value) - low) / (high - low)).clamp(0.0, 1.0);
            let bright = match self.soft {
                Some(soft) => (part / soft).asinh() / (1.0 / soft).asinh(),
                None => part,
            };
            (255.0 * bright).round() as u8
        };
        (0..=u32::from(u16::MAX)).map(of).collect()
    }

    /// Makes the clip. `read` gives the number and the pixels of the frames that were [chosen](Self::chosen).
    pub fn made(
        &self,
        chosen: &[usize],
        mut read: impl FnMut(usize) -> Result<(u64, Frame), Answer>,
    ) -> Result<Answer, Answer> {
        let said = |error: EncodingError| {
            Answer::error(500, &format!("the clip cannot be written as PNG: {error}"))
        };
        let (first_number, first) = read(chosen[0])?;
        let (rows, columns) = first.pixels.dim();
        if rows == 0 || columns == 0 {
            return Err(wrong(&format!("frame {first_number} has no pixels")));
        }
        let part = Part::within(self.part_px, SIDE, [columns, rows]);
        let [width, height] = part.shape();
        let pixels = width * height * chosen.len();
        if pixels > PIXELS {
            return Err(wrong(&format!(
                "{} frames of {width} × {height} px are {} million pixels, at most {} can be: take every {}th frame, or zoom in",
                chosen.len(),
                pixels / 1_000_000,
                PIXELS / 1_000_000,
                self.every * pixels.div_ceil(PIXELS)
            )));
        }
        let table = self.table();
        let mut body = Vec::new();
        // Both are below 1281 and 2001.
        let mut encoder = Encoder::new(&mut body, width as u32, height as u32);
        encoder.set_depth(BitDepth::Eight);
        if self.red {
            encoder.set_color(ColorType::Indexed);
            let palette: Vec<u8> = (0..=u8::MAX).flat_map(|bright| [bright, 0, 0]).collect();
            encoder.set_palette(palette);
        } else {
            encoder.set_color(ColorType::Grayscale);
        }
        encoder.set_animated(chosen.len() as u32, 0).map_err(said)?;
        encoder.set_frame_delay(self.shown_ms, 1000).map_err(said)?;
        let mut writer = encoder.write_header().map_err(said)?;
        for index in chosen {
            let (number, frame) = read(*index)?;
            if frame.pixels.dim() != (rows, columns) {
                let (now_rows, now_columns) = frame.pixels.dim();
                return Err(wrong(&format!(
                    "frame {number} has {now_columns} × {now_rows} px, frame {first_number} {columns} × {rows}: end the clip before it"
                )));
            }
            let shown: Vec<u8> =
                binned(&frame, part).map(|value| table[usize::from(value)]).collect();
            writer.write_image_data(&shown).map_err(said)?;
        }
        writer.finish().map_err(said)?;
        Ok(Answer { status: 200, kind: "image/png", body })
    }
}
