//! Numbered images as one recording.
//!
//! OpenCV's own reader of sequences has traps: found by `CAP_ANY`, FFmpeg makes 8 bits of 16; by `CAP_IMAGES`, the sequence ends
//! without a word at the first number that is missing or the first image that is damaged, and does not begin above 1. Here the
//! numbers are listed first, and each image is read by its name (`imread`, unchanged, as `CAP_IMAGES` does).

use crate::capture::{About, Capture};
use crate::error::{said, wrong};
use crate::mat;
use crate::picture::{Picture, Planes};
use opencv::imgcodecs;
use opencv::prelude::*;
use std::path::{Path, PathBuf};
use sunglint_drivers::device::DeviceError;

/// Kinds of images that keep every pixel. (A TIFF may hide a JPEG; the check sums of a sidecar find it.)
const LOSSLESS: [&str; 6] = ["png", "tif", "tiff", "pgm", "ppm", "pnm"];

/// The names of numbered images: `night_%05d.png`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pattern {
    folder: PathBuf,
    before: String,
    digits: usize,
    after: String,
}

impl Pattern {
    /// A path whose file name holds one `%d`, `%5d` or `%05d`; the number has at least so many digits, zeros before it.
    ///
    /// # Errors
    /// A text that says what is wrong with the path.
    pub fn new(path: &Path) -> Result<Self, String> {
        let shown = path.display();
        let bad = || {
            format!(
                "{shown}: found no single %05d in the file's name, expected e.g. night_%05d.png"
            )
        };
        let name = path.file_name().and_then(|name| name.to_str()).ok_or_else(bad)?;
        let (before, rest) = name.split_once('%').ok_or_else(bad)?;
        let (digits, after) = rest.split_once('d').ok_or_else(bad)?;
        let count = digits.trim_start_matches('0');
        let count: usize = if count.is_empty() { 1 } else { count.parse().map_err(|_| bad())? };
        if after.contains('%') || digits.len() > 2 || !digits.bytes().all(|b| b.is_ascii_digit()) {
            return Err(bad());
        }
        let folder = match path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder.to_owned(),
            _ => PathBuf::from("."),
        };
        Ok(Self { folder, before: before.into(), digits: count, after: after.into() })
    }

    /// The path of an image.
    pub fn path(&self, number: u64) -> PathBuf {
        let Self { folder, before, digits, after } = self;
        folder.join(format!("{before}{number:0digits$}{after}"))
    }

    /// The numbers that there are, in order.
    ///
    /// # Errors
    /// The folder cannot be listed.
    pub fn numbers(&self) -> Result<Vec<u64>, std::io::Error> {
        let mut numbers = Vec::new();
        for entry in self.folder.read_dir()? {
            let name = entry?.file_name();
            let number = name
                .to_str()
                .and_then(|name| name.strip_prefix(&self.before)?.strip_suffix(&self.after))
                .filter(|digits| digits.bytes().all(|b| b.is_ascii_digit()))
                .and_then(|digits| digits.parse().ok());
            // `7` is no name where `00007` is.
            numbers.extend(number.filter(|&n| self.path(n).file_name() == Some(&name)));
        }
        numbers.sort_unstable();
        Ok(numbers)
    }
}

/// Numbered images without a gap.
#[derive(Debug)]
pub struct Sequence {
    pattern: Pattern,
    first: u64,
    count: u64,
    next: u64,
    about: About,
    bits: u8,
}

impl Sequence {
    /// Lists the images and looks at the first.
    ///
    /// # Errors
    /// No image; a number that is missing; an image of another kind.
    pub fn open(path: &Path) -> Result<Self, DeviceError> {
        let shown = path.display();
        let pattern = Pattern::new(path).map_err(wrong)?;
        let kind = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_lowercase();
        let numbers = pattern
            .numbers()
            .map_err(|error| wrong(format!("cannot list {}: {error}", pattern.folder.display())))?;
        let (Some(&first), Some(&last)) = (numbers.first(), numbers.last()) else {
            return Err(wrong(format!("there is no image {shown}")));
        };
        if let Some((missing, _)) = (first..).zip(&numbers).find(|(wanted, found)| wanted != *found)
        {
            let count = numbers.len();
            return Err(wrong(format!(
                "{} is missing: {count} images from {first} to {last}; give the parts names of their own, or look for it",
                pattern.path(missing).display()
            )));
        }
        let lossy = (!LOSSLESS.contains(&kind.as_str())).then(|| {
            format!("`{kind}` is not known to keep each pixel ({} do)", LOSSLESS.join(", "))
        });
        let (planes, bits) = read(&pattern.path(first))?;
        let (rows, columns) = match &planes {
            Planes::Mono(pixels) | Planes::Bgr([pixels, ..]) => pixels.dim(),
        };
        let about = About {
            name: shown.to_string(),
            backend: "imread".into(),
            size_px: [columns as u32, rows as u32],
            codec: Some(kind),
            pictures: Some(numbers.len() as u64),
            bayer: None,
            lossy,
            interval_s: None,
        };
        Ok(Self { pattern, first, count: numbers.len() as u64, next: 0, about, bits })
    }
}

fn read(path: &Path) -> Result<(Planes, u8), DeviceError> {
    let doing = format!("reading {}", path.display());
    let mat = imgcodecs::imread(path, imgcodecs::IMREAD_UNCHANGED)
        .map_err(|error| said(&doing, &error))?;
    if mat.empty() {
        return Err(wrong(format!("{} is no image that OpenCV reads, or damaged", path.display())));
    }
    mat::planes(&mat).map_err(|found| wrong(format!("{doing}: {found}")))
}

impl Capture for Sequence {
    fn about(&self) -> About {
        self.about.clone()
    }

    fn next(&mut self) -> Result<Option<Picture>, DeviceError> {
        if self.next == self.count {
            return Ok(None);
        }
        let path = self.pattern.path(self.first + self.next);
        let (planes, bits) = read(&path)?;
        if bits != self.bits {
            let shown = path.display();
            return Err(wrong(format!("{shown} has {bits} bits, the first image {}", self.bits)));
        }
        let index = self.next;
        self.next += 1;
        Ok(Some(Picture {
            planes,
            bits,
            index,
            position_ms: None,
            arrived: None,
            readings: [None; 2],
        }))
    }
}
