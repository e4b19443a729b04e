//! Streaks on synthetic frames: stars, cosmic rays and a gradient beside them. The frames share no formula with the search but the normal profile of a point.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use glam::DVec2;
use ndarray::Array2;
use rand::{RngExt as _, SeedableRng as _};
use rand_distr::{Distribution as _, Normal};
use rand_xoshiro::Xoshiro256PlusPlus;
use sunglint_calibration::photometry::field::{Field, FieldOptions, Streak, find};
use sunglint_testkit::Campaign;

const SIDE: usize = 512;
const NOISE: f64 = 8.0;

/// A drawn line of even light.
#[derive(Debug, Clone, Copy)]
struct Truth {
    ends: [[f64; 2]; 2],
    length: f64,
    flux: f64,
    /// Light over the noise that a filter of its own shape has.
    significance: f64,
    stars: usize,
}

/// Adds a point by its mean over each pixel at the resolution of a fifth.
fn add_point(frame: &mut Array2<f64>, [x, y]: [f64; 2], flux: f64, sigma: f64) {
    let (rows, columns) = frame.dim();
    let reach = 6.0 * sigma + 1.0;
    let range = |at: f64, n: usize| {
        (at - reach).max(0.0) as usize..((at + reach + 1.0).max(0.0) as usize).min(n)
    };
    let norm = flux / (std::f64::consts::TAU * sigma * sigma);
    for row in range(y, rows) {
        for column in range(x, columns) {
            let r2 = (column as f64 - x).powi(2) + (row as f64 - y).powi(2);
            frame[[row, column]] += norm * (-0.5 * r2 / (sigma * sigma)).exp();
        }
    }
}

/// Adds a line as points a fifth of a pixel apart.
fn add_line(frame: &mut Array2<f64>, [a, b]: [[f64; 2]; 2], flux: f64, sigma: f64) {
    let n = ((b[0] - a[0]).hypot(b[1] - a[1]) * 5.0).ceil().max(1.0) as usize;
    for i in 0..n {
        let t = (i as f64 + 0.5) / n as f64;
        let place = [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])];
        add_point(frame, place, flux / n as f64, sigma);
    }
}

/// A frame of the campaign, and the streak in it.
fn frame(seed: u64) -> (Array2<f32>, Option<Truth>) {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(0x57EC_0000 + seed);
    let sigma = rng.random_range(1.0..1.8);
    let mut light = Array2::from_elem((SIDE, SIDE), 300.0);
    let slope = [rng.random_range(-0.2..0.2), rng.random_range(-0.2..0.2)];
    for ((row, column), value) in light.indexed_iter_mut() {
        *value += slope[0] * column as f64 + slope[1] * row as f64;
    }
    let stars = [0, 20, 100, 250, 500][rng.random_range(0..5_usize)];
    for _ in 0..stars {
        let place = [rng.random_range(0.0..512.0), rng.random_range(0.0..512.0)];
        // Numbers as flux^-1, from 3 to 3,000 standard deviations.
        let flux = 3.0 * 1000_f64.powf(rng.random_range(0.0..1.0)) * NOISE * 3.54 * sigma;
        add_point(&mut light, place, flux, sigma);
    }
    let truth = rng.random_bool(0.8).then(|| {
        let length: f64 = 10.0 * 50_f64.powf(rng.random_range(0.0..1.0));
        let a_pixel: f64 = 0.3 * (10.0_f64 / 0.3).powf(rng.random_range(0.0..1.0));
        let ends = loop {
            let angle = rng.random_range(0.0..std::f64::consts::TAU);
            let a: [f64; 2] = [rng.random_range(5.0..507.0), rng.random_range(5.0..507.0)];
            let b = [a[0] + length * angle.cos(), a[1] + length * angle.sin()];
            if b.iter().all(|v| (5.0..507.0).contains(v)) {
                break [a, b];
            }
        };
        // The crest of a long line is flux / (length √(2π) σ).
        let flux = a_pixel * NOISE * length * (std::f64::consts::TAU).sqrt() * sigma;
        let mut own = Array2::zeros((SIDE, SIDE));
        add_line(&mut own, ends, flux, sigma);
        let significance = own.iter().map(|v| v * v).sum::<f64>().sqrt() / NOISE;
        light += &own;
        Truth { ends, length, flux, significance, stars }
    });
    let normal = Normal::new(0.0, NOISE).unwrap();
    for value in &mut light {
        *value += normal.sample(&mut rng);
    }
    // Cosmic rays: single pixels and tracks one pixel wide.
    for _ in 0..rng.random_range(0..15_usize) {
        let (mut x, mut y) = (rng.random_range(2.0..510.0), rng.random_range(2.0..510.0_f64));
        let angle: f64 = rng.random_range(0.0..std::f64::consts::TAU);
        let bright = rng.random_range(20.0..200.0) * NOISE;
        for _ in 0..rng.random_range(1..8_usize) {
            let (column, row) = (x as usize, y as usize);
            if column < SIDE && row < SIDE {
                light[[row, column]] += bright;
            }
            x += angle.cos();
            y += angle.sin();
            if x < 0.0 || y < 0.0 {
                break;
            }
        }
    }
    (light.mapv(|v| v.round().clamp(0.0, 65_535.0) as f32), truth)
}

/// Whether a streak is the drawn one.
fn is_it(streak: &Streak, truth: &Truth) -> bool {
    lies_on(streak.ends_px, truth)
}

/// Whether a line is the drawn one: its middle lies on it, and its direction is that.
fn lies_on(ends_px: [DVec2; 2], truth: &Truth) -> bool {
    let [a, b] = truth.ends;
    let along = [(b[0] - a[0]) / truth.length, (b[1] - a[1]) / truth.length];
    let of = |p: DVec2| {
        let d = [p[0] - a[0], p[1] - a[1]];
        [d[0] * along[0] + d[1] * along[1], d[1] * along[0] - d[0] * along[1]]
    };
    let [p, q] = ends_px.map(of);
    p[1].abs() < 4.0
        && q[1].abs() < 4.0
        && 0.5 * (p[0] + q[0]) > 0.0
        && 0.5 * (p[0] + q[0]) < truth.length
}

fn found(pixels: &Array2<f32>) -> Field {
    find(pixels.view(), &FieldOptions::default()).unwrap()
}

/// Columns: whether the streak of a frame was asked for, missed, and so on; `pull` is the light's distance from the truth in its standard deviations.
const FRAME: [&str; 12] = [
    "asked",
    "missed",
    "false_frames",
    "light_off",
    "missed_10_to_15_sigmas",
    "missed_below_20_px",
    "missed_short_and_crowded",
    "pull",
    "missed_by_sep",
    "false_frames_by_sep",
    "missed_by_hough",
    "false_frames_by_hough",
];

/// Other programs' searches: `tests/peers/streaks_sep.py`, a frame after the other.
struct Peers {
    process: std::process::Child,
    answers: std::io::Lines<std::io::BufReader<std::process::ChildStdout>>,
}

impl Peers {
    fn new(python: &std::path::Path) -> Self {
        use std::io::BufRead as _;
        use std::process::{Command, Stdio};
        let script = sunglint_testkit::repository().join("tests/peers/streaks_sep.py");
        let mut process = Command::new(python)
            .arg(script)
            .arg(SIDE.to_string())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let answers = std::io::BufReader::new(process.stdout.take().unwrap()).lines();
        Self { process, answers }
    }

    /// The streaks of SEP and of the Hough transform.
    fn find(&mut self, pixels: &Array2<f32>) -> [Vec<[DVec2; 2]>; 2] {
        use std::io::Write as _;
        let bytes: Vec<u8> = pixels.iter().flat_map(|v| v.to_le_bytes()).collect();
        let input = self.process.stdin.as_mut().unwrap();
        input.write_all(&bytes).unwrap();
        input.flush().unwrap();
        let mut found = [Vec::new(), Vec::new()];
        loop {
            let line = self.answers.next().unwrap().unwrap();
            let Some((name, numbers)) = line.split_once(' ') else { return found };
            let v: Vec<f64> = numbers.split(' ').map(|v| v.parse().unwrap()).collect();
            found[usize::from(name == "hough")]
                .push([DVec2::new(v[0], v[1]), DVec2::new(v[2], v[3])]);
        }
    }
}

impl Drop for Peers {
    fn drop(&mut self) {
        drop(self.process.stdin.take());
        let _ = self.process.wait();
    }
}

/// Truth: the line that was drawn. What is asked: at least 95 % of those of at least 20 px with a total significance of at least 15 found, short
/// ones (below 40 px) in crowded fields (250 stars and more in 512²) left out, as two stars are one such streak; a false one in at most 1 % of the frames; light within 5 %
/// besides its own noise (3 σ). Beside it SEP and a Hough transform search the same frames.
#[test]
fn campaign_streaks() {
    let mut campaign = Campaign::in_shards("streaks", 1000, 20, &FRAME);
    let mut peers = sunglint_testkit::peer_python("campaign_streaks", &["numpy", "sep"])
        .map(|python| Peers::new(&python));
    let is = |holds: bool| f64::from(u8::from(holds));
    for seed in campaign.seeds() {
        let (pixels, truth) = frame(seed);
        let field = found(&pixels);
        let by_peers = peers.as_mut().map(|peers| peers.find(&pixels)).unwrap_or_default();
        let mut row = [0.0; FRAME.len()];
        let on = |ends: &[DVec2; 2]| truth.as_ref().is_some_and(|t| lies_on(*ends, t));
        let hits: Vec<&Streak> = field.streaks.iter().filter(|s| on(&s.ends_px)).collect();
        if field.streaks.len() > hits.len() {
            row[2] = 1.0;
            println!("{seed}: false {:?} beside {truth:?}", field.streaks);
        }
        let of_peers = by_peers.map(|found| {
            let own = found.iter().filter(|ends| on(ends)).count();
            [is(own == 0), is(own < found.len())]
        });
        (row[9], row[11]) = (of_peers[0][1], of_peers[1][1]);
        if let Some(truth) = &truth {
            let is_lost = is(hits.is_empty());
            match (truth.length >= 20.0, truth.significance) {
                (true, s) if s >= 15.0 && truth.length < 40.0 && truth.stars >= 250 => {
                    row[6] = is_lost;
                }
                (true, s) if s >= 15.0 => {
                    (row[0], row[1]) = (1.0, is_lost);
                    (row[8], row[10]) = (of_peers[0][0], of_peers[1][0]);
                }
                (true, s) if s >= 10.0 => row[4] = is_lost,
                (false, s) if s >= 15.0 => row[5] = is_lost,
                _ => {}
            }
            if truth.length >= 20.0 && truth.significance >= 15.0 {
                match hits.first() {
                    None => println!("{seed}: missed {truth:?}"),
                    Some(hit) => {
                        let error = hit.flux_adu - truth.flux;
                        row[7] = error / hit.sigma_adu;
                        row[3] = is(error.abs() > 0.05 * truth.flux + 3.0 * hit.sigma_adu);
                        if row[3] == 1.0 {
                            let (share, pull) = (error / truth.flux, row[7]);
                            println!("{seed}: light {share:+.3} ({pull:+.1} σ) {hit:?} {truth:?}");
                        }
                    }
                }
            }
        }
        campaign.keep(seed, &row);
    }
    let frames = campaign.column("asked").len() as f64;
    let sum = |campaign: &Campaign, name: &str| campaign.column(name).iter().sum::<f64>();
    let (asked, missed) = (sum(&campaign, "asked"), sum(&campaign, "missed"));
    let false_frames = sum(&campaign, "false_frames");
    for name in FRAME {
        // Of other programs there is nothing where they are missing.
        if name == "pull" || (name.contains("_by_") && peers.is_none()) {
            continue;
        }
        let value = sum(&campaign, name);
        println!("{name}: {value} of {frames}");
        campaign.largest(name, value);
    }
    campaign.finish();
    // The demand is 95 % found and 1 % of the frames with a false one. Of few frames more may be so by chance: three standard deviations of a binomial are granted.
    let most = |rate: f64, n: f64| rate * n + 3.0 * (rate * (1.0 - rate) * n).sqrt();
    assert!(missed <= most(0.05, asked), "{missed} of {asked} missed");
    assert!(false_frames <= most(0.01, frames), "{false_frames} of {frames} with a false one");
}

/// A normal variate's frame of what was drawn, in whole counts.
fn noisy(light: &Array2<f64>, noise: f64, rng: &mut Xoshiro256PlusPlus) -> Array2<f32> {
    let normal = Normal::new(0.0, noise).unwrap();
    light.mapv(|v| (v + normal.sample(rng)).round().clamp(0.0, 65_535.0) as f32)
}

/// A colour camera's frames (synthetic): red sees half and blue 0.4 of the light and of the sky that green sees, on 1,000 ADU of bias. Truth: the line and the stars that were drawn, in green light, to
/// 5 and 8 % (between green pixels a point looks narrower than it is, so that its aperture is small); the scatter of the line's light over four frames is what is stated (a χ of 3 lies within 0.15 and 2.1 in 99 %). Searched as a monochrome camera's, the streak is lost or its light is an eighth of it.
#[test]
fn colour_cameras_are_measured_in_green() {
    use sunglint_calibration::photometry::field::looks_like_mosaic;
    use sunglint_formats::frame::Bayer;
    let mut pulls: Vec<f64> = Vec::new();
    for seed in 0..4 {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(0xBA7E + seed);
        let mut light = Array2::from_elem((400, 400), 300.0);
        let stars: Vec<[f64; 2]> =
            (0..8).map(|i| [40.0 + 45.0 * f64::from(i), 300.0 + 7.3 * f64::from(i)]).collect();
        for star in &stars {
            add_point(&mut light, *star, 20_000.0, 1.6);
        }
        let ends = [[60.0, 80.3 + seed as f64], [84.0, 94.3 + seed as f64]];
        add_line(&mut light, ends, 40_000.0, 1.6);
        for ((row, column), value) in light.indexed_iter_mut() {
            *value = 1000.0 + *value * [[0.5, 1.0], [1.0, 0.4]][row % 2][column % 2];
        }
        let pixels = noisy(&light, 17.0, &mut rng);
        let mut options = FieldOptions::default();
        options.bayer = Some(Bayer::Rggb);
        let field = find(pixels.view(), &options).unwrap();
        assert_eq!(field.streaks.len(), 1, "{:?}", field.streaks);
        let streak = field.streaks[0];
        assert!((streak.length_px - 24_f64.hypot(14.0)).abs() < 1.5, "{streak:?}");
        assert!((streak.flux_adu / 40_000.0 - 1.0).abs() < 0.05, "{streak:?}");
        pulls.push((streak.flux_adu - 40_000.0) / streak.sigma_adu);
        for star in &stars {
            let away = |p: &DVec2| (p[0] - star[0]).hypot(p[1] - star[1]);
            let near = field.points.iter().find(|p| away(&p.place_px) < 0.5).unwrap();
            assert!((near.flux_adu / 20_000.0 - 1.0).abs() < 0.08, "{near:?}");
        }
        assert!(field.remarks.iter().any(|r| r.contains("green pixels")), "{:?}", field.remarks);
        options.bayer = None;
        let blind = find(pixels.view(), &options).unwrap();
        assert!(blind.remarks.iter().any(|r| r.contains("--bayer")), "{:?}", blind.remarks);
        // A monochrome camera, one with offsets of its columns, and a mosaic with a dark sky.
        let plain = noisy(&Array2::from_elem((128, 128), 1300.0), 17.0, &mut rng);
        assert_eq!(looks_like_mosaic(plain.view()), None);
        let columns = Array2::from_shape_fn((128, 128), |(_, x)| 1300.0 + 40.0 * (x % 2) as f64);
        assert_eq!(looks_like_mosaic(noisy(&columns, 17.0, &mut rng).view()), None);
    }
    let n = pulls.len() as f64;
    let mean = pulls.iter().sum::<f64>() / n;
    let scatter = (pulls.iter().map(|p| (p - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
    assert!((0.15..2.1).contains(&scatter), "{scatter}: {pulls:?}");
}

/// Frames clipped at 1,500 ADU by a program (synthetic). Truth: a source is saturated if the drawn light of one of its pixels, noise aside, is beyond that.
#[test]
fn clipped_pixels_are_saturation() {
    use sunglint_calibration::photometry::field::plateau;
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(0xC119);
    let mut light = Array2::from_elem((300, 300), 1000.0);
    let stars: Vec<([f64; 2], f64)> = (0..10)
        .map(|i| {
            ([25.0 + 27.0 * f64::from(i), 60.0 + 11.0 * f64::from(i % 3)], 2000.0 * 1.5_f64.powi(i))
        })
        .collect();
    for (place, flux) in &stars {
        add_point(&mut light, *place, *flux, 1.6);
    }
    add_line(&mut light, [[60.0, 200.0], [110.0, 220.0]], 150_000.0, 1.6);
    add_line(&mut light, [[160.0, 200.0], [210.0, 220.0]], 30_000.0, 1.6);
    let whole = noisy(&light, 8.0, &mut rng);
    assert_eq!(plateau(whole.view()), None);
    assert!(find(whole.view(), &FieldOptions::default()).unwrap().remarks.is_empty());
    let clipped = whole.mapv(|v| v.min(1500.0));
    let found = plateau(clipped.view()).unwrap();
    assert_eq!(found.adu, 1500.0);
    assert_eq!(found.pixels, clipped.iter().filter(|v| **v == 1500.0).count());
    let field = find(clipped.view(), &FieldOptions::default()).unwrap();
    assert!(field.remarks[0].contains("1500 ADU"), "{:?}", field.remarks);
    assert_eq!(field.streaks.len(), 2, "{:?}", field.streaks);
    for streak in &field.streaks {
        assert_eq!(streak.is_saturated, streak.ends_px[0][0] < 130.0, "{streak:?}");
    }
    for (place, flux) in &stars {
        let away = |p: &DVec2| (p[0] - place[0]).hypot(p[1] - place[1]);
        let point = field.points.iter().find(|p| away(&p.place_px) < 1.5).unwrap();
        let summit = 1000.0 + flux / (std::f64::consts::TAU * 1.6 * 1.6);
        if (summit - 1500.0).abs() > 60.0 {
            assert_eq!(point.is_saturated, summit > 1500.0, "{summit} {point:?}");
        }
    }
}

/// Skies without noise: constant frames hold nothing, whatever rounding leaves. A frame of 8 bits whose sky lies below the converter's 0 (synthetic) holds the drawn stars and nothing else,
/// with their light over the converter's own noise (a step over √12; a Gaussian profile of σ 1.5 px has 4π σ² pixels of it) as significance: within a factor of 2, as the wings are cut off.
#[test]
fn skies_without_noise_hold_only_what_is_in_them() {
    for level in [0.0_f32, 1890.0, 0.37] {
        let frame = Array2::from_elem((100, 120), level);
        let field = found(&frame);
        assert!(field.points.is_empty() && field.streaks.is_empty(), "{level}: {field:?}");
    }
    let mut light = Array2::from_elem((240, 320), -12.0);
    let stars: Vec<([f64; 2], f64)> = (0..24)
        .map(|i| {
            let place = [30.3 + 50.0 * f64::from(i % 6), 30.7 + 58.0 * f64::from(i / 6)];
            (place, 900.0 + 60.0 * f64::from(i))
        })
        .collect();
    for (place, flux) in &stars {
        add_point(&mut light, *place, *flux, 1.5);
    }
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(0x0C11);
    let frame = noisy(&light, 2.0, &mut rng).mapv(|v| v.round().clamp(0.0, 255.0));
    let field = found(&frame);
    assert!(field.streaks.is_empty(), "{:?}", field.streaks);
    assert_eq!(field.points.len(), stars.len(), "{:?}", field.points);
    let step_noise = 12_f64.sqrt().recip() * (4.0 * std::f64::consts::PI * 1.5 * 1.5).sqrt();
    for (place, _) in &stars {
        let away = |p: &DVec2| (p[0] - place[0]).hypot(p[1] - place[1]);
        let point = field.points.iter().find(|p| away(&p.place_px) < 0.5).unwrap();
        let ratio = point.significance / (point.flux_adu / step_noise);
        assert!((0.5..2.0).contains(&ratio), "{ratio}: {point:?}");
    }
}

/// Streaks of frames whose light is drawn with noise.
fn streaks_of(light: &Array2<f64>, rng: &mut Xoshiro256PlusPlus) -> Field {
    found(&noisy(light, NOISE, rng))
}

/// Rows of faint stars in halos of bright ones (synthetic: wings as (1 + r²/α²)^−1.5, stars of 1 to 7 standard deviations). Truth: nothing was drawn that is no point. In each of the two frames a
/// streak was seen before lines were held against those beside them; one is still seen in one of them, which is a known weakness.
#[test]
fn halos_and_rows_of_faint_stars_are_no_streaks() {
    let mut false_ones = 0;
    for seed in [3, 5] {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(0x4A10 + seed);
        let mut light = Array2::from_elem((256, 256), 300.0);
        for _ in 0..4 {
            let [x, y] = [rng.random_range(20.0..236.0), rng.random_range(20.0..236.0_f64)];
            let summit = 150.0 * 20_f64.powf(rng.random_range(0.0..1.0));
            for ((row, column), value) in light.indexed_iter_mut() {
                let r2 = (column as f64 - x).powi(2) + (row as f64 - y).powi(2);
                *value += summit * (1.0 + r2 / 6.0).powf(-1.5);
            }
        }
        for _ in 0..350 {
            let place = [rng.random_range(0.0..256.0), rng.random_range(0.0..256.0)];
            let height = 7_f64.powf(rng.random_range(0.0..1.0));
            add_point(&mut light, place, height * NOISE * 3.54, 1.0);
        }
        let field = streaks_of(&light, &mut rng);
        false_ones += field.streaks.len();
    }
    assert!(false_ones <= 1, "{false_ones}");
}

/// A sensor's edge that is 0.45 standard deviations brighter along four rows, beside an overscan of 16 and 8 columns and 8 rows that is 12 below the sky (synthetic, after a frame of a real camera). Truth: nothing was
/// drawn but that, and, in the second frame, a trail away from the border.
#[test]
fn edges_of_the_sensor_are_no_streaks() {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(0xED6E);
    let exposed = |row: usize, column: usize| row < 312 && (16..392).contains(&column);
    let mut light = Array2::from_shape_fn((320, 400), |(row, column)| {
        let edge = if (1..5).contains(&row) { 0.45 * NOISE } else { 0.0 };
        if exposed(row, column) { 300.0 + edge } else { 204.0 }
    });
    let field = streaks_of(&light, &mut rng);
    assert!(field.streaks.is_empty(), "{:?}", field.streaks);
    let says = |field: &Field, what: &str| field.remarks.iter().any(|r| r.contains(what));
    assert!(says(&field, "columns 16 to 391 and rows 0 to 311"), "{:?}", field.remarks);
    assert!(says(&field, "along the border"), "{:?}", field.remarks);
    add_line(&mut light, [[60.0, 40.0], [200.0, 47.0]], 8000.0, 1.5);
    let field = streaks_of(&light, &mut rng);
    assert_eq!(field.streaks.len(), 1, "{:?}", field.streaks);
    assert!((field.streaks[0].length_px - 140.2).abs() < 4.0, "{:?}", field.streaks);
    // A gradient is no border, a frame without overscan has no note.
    let slope = Array2::from_shape_fn((320, 400), |(row, column)| {
        300.0 + 0.4 * row as f64 + 0.2 * column as f64
    });
    let field = streaks_of(&slope, &mut rng);
    assert!(field.remarks.is_empty() && field.streaks.is_empty(), "{field:?}");
}

/// Light along a trail against the distance from its beginning, px.
type Shape<'a> = &'a dyn Fn(f64) -> f64;

/// Light along trails that is not even (synthetic): truth: the drawn line of 200 px with a total significance of about 30. Each shape is found in all of four frames.
#[test]
fn trails_of_tumblers_are_found() {
    let wave = |t: f64| 1.0 + (std::f64::consts::TAU * t / 25.0).sin();
    let dashes =
        |t: f64, period: f64, part: f64| f64::from(u8::from(t.rem_euclid(period) < part * period));
    let shapes: [(&str, Shape<'_>, usize); 7] = [
        ("even", &|_| 1.0, 4),
        ("wave of 25 px", &wave, 4),
        ("half of 16 px", &|t| dashes(t, 16.0, 0.5), 4),
        ("half of 60 px", &|t| dashes(t, 60.0, 0.5), 4),
        ("0.7 of 30 px", &|t| dashes(t, 30.0, 0.7), 4),
        ("flashes each 20 px", &|t| dashes(t, 20.0, 0.1), 0),
        ("cloud", &|t| if (70.0..130.0).contains(&t) { 0.3 } else { 1.0 }, 4),
    ];
    let mut lost = Vec::new();
    for (name, shape, least) in shapes {
        let mut hits = 0;
        for seed in 0..4 {
            let mut rng = Xoshiro256PlusPlus::seed_from_u64(0x70B1 + seed);
            let mut light = Array2::from_elem((300, 300), 300.0);
            for _ in 0..60 {
                let place = [rng.random_range(0.0..300.0), rng.random_range(0.0..300.0)];
                let flux = 3.0 * 300_f64.powf(rng.random_range(0.0..1.0)) * NOISE * 3.54 * 1.4;
                add_point(&mut light, place, flux, 1.4);
            }
            let angle: f64 = rng.random_range(0.0..std::f64::consts::TAU);
            let along = [angle.cos(), angle.sin()];
            let at = |t: f64| along.map(|u| 150.0 + (t - 100.0) * u);
            let (mut own, mut n) = (Array2::zeros((300, 300)), 0.0);
            for step in 0..800 {
                let t = 0.25 * f64::from(step);
                add_point(&mut own, at(t), shape(t), 1.4);
                n += shape(t);
            }
            let square: f64 = own.iter().map(|v: &f64| v * v).sum();
            let flux = 30.0 * NOISE / square.sqrt();
            light += &(own * flux);
            let truth = Truth {
                ends: [at(0.0), at(200.0)],
                length: 200.0,
                flux: flux * n,
                significance: 30.0,
                stars: 60,
            };
            let field = streaks_of(&light, &mut rng);
            hits += usize::from(field.streaks.iter().any(|s| is_it(s, &truth)));
            for s in &field.streaks {
                println!(
                    "{name} {seed}: {:.0} px, S/N {:.1}, {}",
                    s.length_px,
                    s.significance,
                    is_it(s, &truth)
                );
            }
        }
        println!("{name}: {hits} of 4");
        if hits < least {
            lost.push(name);
        }
    }
    assert!(lost.is_empty(), "{lost:?}");
}
