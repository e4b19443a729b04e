//! File of cameras' times: what the measurement writes and the reduction reads.

use super::{CameraTiming, FrameClock, Timings};
use crate::reduction::recipe::quoted;
use serde::Deserialize;
use std::fmt::Write as _;
use std::path::Path;
use sunglint_formats::FileError;
use sunglint_formats::toml::{Document, Finite, NonNegative};
use sunglint_numerics::measured::Measured;

/// Version of the file.
const FORMAT: u32 = 1;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TimingFile {
    format: u32,
    camera: Vec<Camera>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Camera {
    name: String,
    #[serde(default)]
    instrument: Option<String>,
    #[serde(default = "unbinned")]
    binning: [u32; 2],
    #[serde(default)]
    window_px: Option<[usize; 2]>,
    clock: FrameClock,
    latency_s: Finite,
    latency_sigma_s: NonNegative,
    #[serde(default)]
    jitter_s: Option<NonNegative>,
    #[serde(default)]
    row_time_s: Option<Finite>,
    #[serde(default)]
    row_time_sigma_s: Option<NonNegative>,
    #[serde(default)]
    frames: usize,
}

fn unbinned() -> [u32; 2] {
    [1, 1]
}

/// Reads a file.
pub(super) fn read(path: &Path) -> Result<Timings, FileError> {
    let document = Document::new(path, sunglint_formats::read::text(path)?)?;
    let file: TimingFile = document.parse()?;
    if file.format != FORMAT {
        let expected = format!("{FORMAT}: another version of sunglint wrote it");
        return Err(document.error_at("format", expected).into());
    }
    let mut cameras: Vec<CameraTiming> = Vec::new();
    for camera in file.camera {
        let row_sigma_s = camera.row_time_sigma_s.map_or(0.0, NonNegative::get);
        let timing = CameraTiming {
            camera: camera.name,
            instrument: camera.instrument,
            binning: camera.binning,
            window_px: camera.window_px,
            clock: camera.clock,
            latency_s: Measured::new(camera.latency_s.get(), camera.latency_sigma_s.get()),
            jitter_s: camera.jitter_s.map_or(0.0, NonNegative::get),
            row_time_s: camera.row_time_s.map(|time| Measured::new(time.get(), row_sigma_s)),
            frames: camera.frames,
        };
        let key = |t: &CameraTiming| {
            (t.camera.clone(), t.instrument.clone(), t.binning, t.window_px, t.clock)
        };
        if cameras.iter().any(|known| key(known) == key(&timing)) {
            let expected =
                format!("camera {} once in each binning, window and clock", timing.camera);
            return Err(document.error_at("camera", expected).into());
        }
        cameras.push(timing);
    }
    Ok(Timings { path: path.to_path_buf(), cameras })
}

/// File of times for the reduction: TOML.
pub fn timing_file(cameras: &[&CameraTiming]) -> String {
    let mut text = format!(
        "# When cameras expose, as `sunglint timing` measured it: for `sunglint reduce --timing`.\n# latency_s: by how much the first row's exposure begins later than the frame says; jitter_s: its standard deviation from frame to frame.\nformat = {FORMAT}\n"
    );
    for timing in cameras {
        let _ = write!(text, "\n[[camera]]\nname = {}\n", quoted(&timing.camera));
        if let Some(instrument) = &timing.instrument {
            let _ = writeln!(text, "instrument = {}", quoted(instrument));
        }
        let [x, y] = timing.binning;
        let _ = writeln!(text, "binning = [{x}, {y}]");
        if let Some([columns, rows]) = timing.window_px {
            let _ = writeln!(text, "window_px = [{columns}, {rows}]");
        }
        let _ = write!(
            text,
            "clock = \"{}\"\nlatency_s = {:.6}\nlatency_sigma_s = {:.6}\njitter_s = {:.6}\n",
            timing.clock.name(),
            timing.latency_s.value,
            timing.latency_s.sigma,
            timing.jitter_s
        );
        if let Some(time) = timing.row_time_s {
            let _ = write!(
                text,
                "row_time_s = {:.9}\nrow_time_sigma_s = {:.9}\n",
                time.value, time.sigma
            );
        }
        let _ = writeln!(text, "frames = {}", timing.frames);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::timing::{SYSTEMATIC, read_timings};
    use hifitime::Epoch;
    use ndarray::Array2;
    use sunglint_formats::Frame;
    use sunglint_formats::fits::Header;

    fn timing() -> CameraTiming {
        CameraTiming {
            camera: "the \"wide\" one".into(),
            instrument: Some("QHY 174".into()),
            binning: [2, 2],
            window_px: Some([2, 2]),
            clock: FrameClock::Driver,
            latency_s: Measured::new(0.231, 0.0015),
            jitter_s: 0.02,
            row_time_s: Some(Measured::new(1.5e-5, 1e-7)),
            frames: 800,
        }
    }

    fn frame() -> Frame {
        let mut header = Header::default();
        header.set("INSTRUME", "QHY 174", "");
        Frame {
            pixels: Array2::zeros((2, 2)),
            origin: [0, 0],
            binning: [2, 2],
            bayer: None,
            start: Epoch::from_gregorian_utc_at_midnight(2026, 11, 28),
            exposure_s: 0.1,
            gain_e_per_adu: None,
            temperature_c: None,
            saturation_adu: None,
            header,
        }
    }

    /// Truth: the numbers that were written, to their last written digit; by hand: 0.231 s later, √(1.5² + 20²) ms.
    #[test]
    fn times_are_kept_and_taken_off() {
        let folder = std::env::temp_dir().join(format!("sunglint-timing-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let path = folder.join("timing.toml");
        let text = timing_file(&[&timing()]);
        std::fs::write(&path, &text).unwrap();
        let timings = read_timings(&path).unwrap();
        assert_eq!(timings.cameras, [timing()]);

        let (mut before, mut taken) = (frame(), frame());
        let found = timings.correct("the \"wide\" one", &mut taken).unwrap();
        assert!(((taken.start - before.start).to_seconds() - 0.231).abs() < 1e-9);
        assert!((found.sigma_s() - 0.02006).abs() < 1e-5);
        assert_eq!(taken.header.real(SYSTEMATIC), Some(0.0015));
        // Another camera, binning, clock or instrument was not measured.
        assert!(timings.of("other", &before).is_none());
        let mut other = frame();
        other.binning = [1, 1];
        assert!(timings.of("the \"wide\" one", &other).is_none());
        let mut other = frame();
        other.pixels = Array2::zeros((2, 3));
        assert!(timings.of("the \"wide\" one", &other).is_none());
        before.header.set("TIMRDER", 0.001, "");
        assert!(timings.of("the \"wide\" one", &before).is_none());
        let mut other = frame();
        other.header.set("INSTRUME", "another", "");
        assert!(timings.of("the \"wide\" one", &other).is_none());

        for (from, to, named) in [
            ("format = 1", "format = 7", "timing.toml:3"),
            ("latency_s = 0.231000", "latency_s = nan", "latency_s"),
            ("jitter_s = 0.020000", "jitter_s = -1", "jitter_s"),
            ("clock = \"driver\"", "clock = \"sundial\"", "clock"),
            ("frames = 800", "frame = 800", "frame"),
        ] {
            assert!(text.contains(from), "{from}");
            std::fs::write(&path, text.replace(from, to)).unwrap();
            let error = read_timings(&path).unwrap_err().to_string();
            assert!(error.contains(named), "{error}");
        }
        std::fs::write(&path, format!("{text}{}", &text[text.find("\n[[").unwrap()..])).unwrap();
        let error = read_timings(&path).unwrap_err().to_string();
        assert!(error.contains("once"), "{error}");
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
