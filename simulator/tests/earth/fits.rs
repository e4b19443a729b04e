//! Tables as FITS images.

use ndarray::{ArrayD, Dimension as _, IxDyn};
use std::path::Path;
use sunglint_formats::fits::{Header, Image, Writer};
use sunglint_simulator::light::EarthAlbedo;
use sunglint_simulator::light::earth::{csv, fits};

/// An image of 4 × 3 cells of 90° × 60° (layers first), its first pixel in the south-west; `cards` on top of the axes.
fn image(
    layers: usize,
    value: impl Fn(usize, usize, usize) -> f64,
    cards: &[(&str, f64)],
) -> Image {
    let shape = if layers > 1 { vec![layers, 3, 4] } else { vec![3, 4] };
    let pixels = ArrayD::from_shape_fn(IxDyn(&shape), |index| {
        let n = index.ndim();
        value(if n == 3 { index[0] } else { 0 }, index[n - 2], index[n - 1])
    });
    let mut header = Header::default();
    for (key, value) in [
        ("CRPIX1", 1.0),
        ("CRVAL1", -135.0),
        ("CDELT1", 90.0),
        ("CRPIX2", 1.0),
        ("CRVAL2", -60.0),
        ("CDELT2", 60.0),
    ]
    .iter()
    .chain(cards)
    {
        header.set(key, *value, "");
    }
    Image { header, pixels: pixels.into() }
}

fn read(image: &Image, missing: Option<f64>) -> Result<EarthAlbedo, String> {
    let mut writer = Writer::new();
    writer.image(image).unwrap();
    let bytes = writer.into_bytes();
    assert!(fits::is_fits(&bytes));
    fits::parse(Path::new("e.fits"), bytes, missing).map_err(|e| e.to_string())
}

fn value(layer: usize, row: usize, column: usize) -> f64 {
    0.1 * (layer + 1) as f64 + 0.05 * row as f64 + 0.01 * column as f64
}

/// Truth: the same table as CSV. North up or south up, longitudes from −180° or from 0°, layers in either order.
#[test]
fn an_image_is_the_same_table() {
    let mut text = String::from("lat_deg,lon_deg,albedo\n");
    for row in 0..3 {
        for column in 0..4 {
            let (lat, lon) = (60 * row as i32 - 60, 90 * column as i32 - 135);
            text.push_str(&format!("{lat},{lon},{}\n", value(0, row, column)));
        }
    }
    let truth = csv::parse(Path::new("e.csv"), &text, None).unwrap();
    let mut plain = image(1, value, &[]);
    plain.header.set("CTYPE1", "EALN-CAR", "");
    plain.header.set("CTYPE2", "EALT-CAR", "");
    plain.header.set("CUNIT1", "deg", "");
    assert_eq!(read(&plain, None).unwrap().grid(), truth.grid());
    let north_up = |l, row: usize, column| value(l, 2 - row, column);
    let north_up = image(1, north_up, &[("CRVAL2", 60.0), ("CDELT2", -60.0)]);
    assert_eq!(read(&north_up, None).unwrap().grid(), truth.grid());
    let from_0 = |l, row, column: usize| value(l, row, (column + 2) % 4);
    let from_0 = image(1, from_0, &[("CRVAL1", 45.0)]);
    assert_eq!(read(&from_0, None).unwrap().grid(), truth.grid());
    let wave = [("CRPIX3", 1.0), ("CRVAL3", 0.45), ("CDELT3", 0.1)];
    let mut layered = image(2, value, &wave);
    layered.header.set("CTYPE3", "WAVE", "");
    layered.header.set("CUNIT3", "um", "");
    let layered = read(&layered, None).unwrap();
    let nm = layered.grid().unwrap().wavelengths_nm();
    assert!((nm[0] - 450.0).abs() < 1e-9 && (nm[1] - 550.0).abs() < 1e-9, "{nm:?}");
    let reversed = [("CRPIX3", 1.0), ("CRVAL3", 550.0), ("CDELT3", -100.0)];
    let reversed = image(2, |l, row, column| value(1 - l, row, column), &reversed);
    let reversed = read(&reversed, None).unwrap();
    assert_eq!(reversed.grid().unwrap().means(), layered.grid().unwrap().means());
}

/// Truth: the faults that were put in.
#[test]
fn what_is_no_map_is_refused() {
    let plain = |cards: &[(&str, f64)]| image(1, value, cards);
    let typed = |key: &str, text: &str| {
        let mut image = plain(&[]);
        image.header.set(key, text, "");
        image
    };
    let holes =
        image(1, |l, row, column| if row == 2 { f64::NAN } else { value(l, row, column) }, &[]);
    assert_eq!(read(&holes, Some(0.3)).unwrap().grid().unwrap().missing(), 4);
    let mut no_step = plain(&[]);
    no_step.header.remove("CDELT1");
    let line =
        Image { header: Header::default(), pixels: ArrayD::<f64>::zeros(IxDyn(&[5])).into() };
    for (image, parts) in [
        (typed("CTYPE1", "RA---CAR"), &["e.fits", "CTYPE1", "RA---CAR", "geographic"][..]),
        (typed("CTYPE1", "GLON-CAR"), &["CTYPE1", "GLON-CAR"]),
        (typed("CTYPE2", "LON"), &["CTYPE2", "LON", "LAT"]),
        (typed("CUNIT2", "rad"), &["CUNIT2", "rad", "deg"]),
        (plain(&[("PC1_2", 0.1)]), &["PC1_2", "0.1", "no rotation"]),
        (plain(&[("CD1_1", 90.0)]), &["CD1_1", "CDELT"]),
        (plain(&[("CDELT2", 0.0)]), &["CDELT2"]),
        (plain(&[("CRVAL2", 0.0)]), &["lat_deg at pixel (1, 3)", "120°"]),
        (no_step, &["CDELT1", "nothing"]),
        (line, &["NAXIS", "1", "2 axes"]),
        (holes, &["no value for 4 of 12 cells", "missing = 0.3"]),
        (image(1, |l, r, c| 10.0 * value(l, r, c), &[]), &["albedo at pixel (2, 1)", "per cent"]),
        (image(2, value, &[]), &["CDELT3"]),
    ] {
        let error = read(&image, None).expect_err(parts[0]);
        assert!(parts.iter().all(|part| error.contains(part)), "{error}, expected {parts:?}");
    }
}
