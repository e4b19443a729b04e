//! Calibration frames of a folder: which are used, and what is said of the others. All frames are synthetic.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use ndarray::Array2;
use rand::SeedableRng as _;
use rand_distr::{Distribution as _, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::collections::BTreeMap;
use std::path::PathBuf;
use sunglint_calibration::photometry::field::cut_flat;
use sunglint_calibration::reduction::folder::{Folder, FolderOptions, reduce_frames};
use sunglint_formats::atomic::Overwrite;
use sunglint_formats::fits::{Header, Image, Pixels, Writer};
use sunglint_numerics::progress::Silent;

struct Chance(Xoshiro256PlusPlus);

impl Chance {
    fn new(seed: u64) -> Self {
        Self(Xoshiro256PlusPlus::seed_from_u64(seed))
    }

    fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }
}

/// A folder with frames in it.
struct Frames {
    folder: tempfile::TempDir,
    files: Vec<PathBuf>,
    chance: Chance,
}

impl Frames {
    fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap(), files: Vec::new(), chance: Chance::new(11) }
    }

    /// Frames of a kind, of an even level with noise; no value is above 65,535.
    fn add(&mut self, n: usize, kind: &str, exposure_s: f64, size: usize, level: [f64; 2]) {
        self.add_with(n, kind, exposure_s, size, level, &|_, _, _| 0.0);
    }

    /// The same with light: by the frame's number, row and column.
    fn add_with(
        &mut self,
        n: usize,
        kind: &str,
        exposure_s: f64,
        size: usize,
        level: [f64; 2],
        light: &dyn Fn(usize, usize, usize) -> f64,
    ) {
        for _ in 0..n {
            let number = self.files.len();
            let chance = &mut self.chance;
            let pixels = Array2::from_shape_fn((size, size), |(row, column)| {
                let value = level[0] + level[1] * chance.normal() + light(number, row, column);
                value.round().clamp(0.0, 65_535.0) as u16
            });
            let mut header = Header::default();
            header.set("IMAGETYP", kind, "synthetic");
            header.set("FILTER", "V", "");
            header.set("EXPTIME", exposure_s, "");
            if kind == "LIGHT" {
                let time = format!("2026-03-04T20:{number:02}:00.000");
                header.set("DATE-OBS", time.as_str(), "");
            }
            let path = self.folder.path().join(format!("{number:02}.fits"));
            let mut writer = Writer::new();
            writer.image(&Image { header, pixels: Pixels::U16(pixels.into_dyn()) }).unwrap();
            writer.write_file(&path, Overwrite::Refuse).unwrap();
            self.files.push(path);
        }
    }

    fn reduced(&self) -> Folder {
        reduce_frames(&self.files, &FolderOptions::default(), &Silent).unwrap()
    }
}

fn counts(of: &[(&str, usize)]) -> BTreeMap<String, usize> {
    of.iter().map(|(words, n)| ((*words).to_owned(), *n)).collect()
}

/// Five frames with three stars that stand and a target that moves by 9 px each. Truth: where they were drawn, within half a pixel. The target that is pointed at is measured, be it the moving one or a star; where nothing is, that is
/// said.
#[test]
fn the_place_that_is_given_is_the_targets() {
    let stars = [[30.0, 20.0], [90.0, 140.0], [150.0, 60.0]];
    let moving = |k: usize| [60.0 + 9.0 * k as f64, 90.0];
    let mut frames = Frames::new();
    frames.add_with(5, "LIGHT", 1.0, 192, [500.0, 5.0], &|k, row, column| {
        let all = stars.into_iter().chain([moving(k)]);
        all.map(|[x, y]| {
            let r2 = (column as f64 - x).powi(2) + (row as f64 - y).powi(2);
            3000.0 * (-r2 / (2.0 * 1.6 * 1.6)).exp()
        })
        .sum()
    });
    let at = |place: Option<[f64; 2]>| {
        let mut options = FolderOptions::default();
        options.place_px = place.map(Into::into);
        reduce_frames(&frames.files, &options, &Silent)
    };
    for (given, there) in
        [(None, None), (Some(moving(0)), None), (Some([31.0, 22.0]), Some(stars[0]))]
    {
        let folder = at(given).unwrap();
        assert_eq!(folder.frames.len(), 5, "{given:?}");
        for (k, frame) in folder.frames.iter().enumerate() {
            let truth = there.unwrap_or_else(|| moving(k));
            let place = frame.place_px.unwrap();
            let off = (place.x - truth[0]).hypot(place.y - truth[1]);
            assert!(off < 0.5, "{given:?} {k}: {place} for {truth:?}, {}", folder.chosen_by);
        }
    }
    for nowhere in [[170.0, 170.0], [600.0, 90.0]] {
        let error = at(Some(nowhere)).unwrap_err().to_string();
        assert!(error.contains("no source within 25 px"), "{error}");
    }
}

/// Truth: the frames that were written, each kind by itself; notes count frames, not settings.
#[test]
fn frames_that_were_not_used_are_told() {
    let mut frames = Frames::new();
    frames.add(2, "LIGHT", 10.0, 96, [500.0, 7.0]);
    frames.add(3, "LIGHT", 5.0, 96, [500.0, 7.0]);
    frames.add(4, "DARK", 10.0, 64, [100.0, 7.0]);
    frames.add(3, "DARK", 20.0, 96, [100.0, 7.0]);
    frames.add(2, "BIAS", 0.0, 96, [100.0, 7.0]);
    frames.add(1, "BIAS", 0.0, 64, [100.0, 7.0]);
    frames.add(3, "FLAT", 2.0, 96, [30_000.0, 200.0]);
    // A third of its pixels is beyond the end.
    frames.add(2, "FLAT", 2.0, 96, [64_000.0, 3_500.0]);
    let folder = frames.reduced();
    let used: BTreeMap<&str, usize> = [("light", 5), ("bias", 2), ("flat", 3)].into();
    assert_eq!(folder.used, used);
    assert_eq!(
        folder.left_out,
        counts(&[
            ("dark frames of another size", 4),
            ("dark frames of another exposure", 3),
            ("bias frames of another size", 1),
            ("flats whose pixels are cut off", 2),
        ])
    );
    assert!(folder.left_out_files[0][1].contains("65535 ADU"), "{:?}", folder.left_out_files);
    let note = "no dark frame fits: bias frames were subtracted in place of it";
    assert_eq!(folder.notes.get(note), Some(&5), "{:?}", folder.notes);
}

/// Truth: the frames that were written: each setting has its darks, which were counted as left out for the other one before; bias frames serve the flats alone.
#[test]
fn each_setting_has_its_own_darks() {
    let mut frames = Frames::new();
    frames.add(2, "LIGHT", 10.0, 96, [500.0, 7.0]);
    frames.add(2, "LIGHT", 5.0, 96, [500.0, 7.0]);
    frames.add(3, "DARK", 10.0, 96, [100.0, 7.0]);
    frames.add(3, "DARK", 5.0, 96, [100.0, 7.0]);
    frames.add(2, "BIAS", 0.0, 96, [100.0, 7.0]);
    let folder = frames.reduced();
    assert_eq!(folder.used, [("light", 4), ("dark", 6)].into());
    assert_eq!(folder.left_out, counts(&[("bias frames, as dark frames fit", 2)]));
    assert!(folder.notes.keys().all(|note| !note.contains("dark")), "{:?}", folder.notes);
    frames.add(1, "FLAT", 2.0, 96, [64_000.0, 3_500.0]);
    let folder = frames.reduced();
    assert_eq!(folder.notes.get("no flat fits: the frame was divided by none"), Some(&4));
    let mut bare = Frames::new();
    bare.add(2, "LIGHT", 10.0, 96, [500.0, 7.0]);
    bare.add(2, "LIGHT", 5.0, 96, [500.0, 7.0]);
    let folder = bare.reduced();
    let note = "no dark frame fits: none was subtracted";
    assert_eq!(folder.notes.get(note), Some(&4), "{:?}", folder.notes);
}

/// Truth: the value at which the pixels were cut off when they were drawn; whole flats have none, even ones without noise and of few bits.
#[test]
fn flats_show_where_they_are_cut_off() {
    let mut chance = Chance::new(5);
    let mut drawn = |level: f64, noise: f64, end: f64| {
        Array2::from_shape_fn((300, 300), |_| {
            (level + noise * chance.normal()).round().min(end) as f32
        })
    };
    let cut = |p: &Array2<f32>, told| cut_flat(p.view(), told);
    // Half, a tenth (1.28 σ) and 2.3 % (2 σ) of the pixels beyond the end.
    for (level, noise, end) in [
        (65_535.0, 400.0, 65_535.0),
        (51_000.0, 300.0, 51_384.0),
        (4_055.0, 20.0, 4_095.0),
        (65_000.0, 260.0, 65_520.0),
        (245.0, 5.0, 255.0),
    ] {
        assert_eq!(cut(&drawn(level, noise, end), None), Some(end), "{level}");
    }
    assert_eq!(cut(&drawn(4_000.0, 50.0, 70_000.0), Some(4_000.0)), Some(4_000.0));
    for (level, noise) in [(30_000.0, 200.0), (200.0, 3.0), (200.0, 0.6), (3_000.0, 10.0)] {
        assert_eq!(cut(&drawn(level, noise, 70_000.0), None), None, "{level}");
    }
    let mut even = Array2::from_elem((300, 300), 20_000.0_f32);
    assert_eq!(cut(&even, None), None);
    even.iter_mut().step_by(1000).for_each(|v| *v = 0.0);
    assert_eq!(cut(&even, None), None);
    let vignetted = Array2::from_shape_fn((300, 300), |(y, x)| {
        let r = (y as f64 - 150.0).hypot(x as f64 - 150.0) / 212.0;
        (20_000.0 * (1.0 - 0.3 * r * r)).round() as f32
    });
    assert_eq!(cut(&vignetted, None), None);
}
