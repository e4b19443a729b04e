//! Images whose further axes have the length 1 are images (synthetic).

use sunglint_formats::fits::Fits;
use sunglint_formats::{Frame, image_frame::ImageFrame};

/// A file of 8-bit pixels 0, 1, 2 …, made here by FITS 4.0, sections 4.4.1 and 3.3.
fn file(axes: &[usize], cards: &[&str]) -> Fits {
    let mut head = vec![
        "SIMPLE  =                    T".to_owned(),
        "BITPIX  =                    8".to_owned(),
        format!("NAXIS   = {:>20}", axes.len()),
    ];
    head.extend(axes.iter().enumerate().map(|(i, n)| format!("NAXIS{}  = {n:>20}", i + 1)));
    head.push("DATE-OBS= '2026-03-04T05:06:07'".to_owned());
    head.push("EXPTIME =                  2.0".to_owned());
    head.extend(cards.iter().map(|card| (*card).to_owned()));
    head.push("END".to_owned());
    let mut bytes: Vec<u8> = head.iter().flat_map(|c| format!("{c:<80}").into_bytes()).collect();
    bytes.resize(2880, b' ');
    bytes.extend((0..axes.iter().product::<usize>()).map(|i| i as u8));
    bytes.resize(bytes.len().next_multiple_of(2880), 0);
    Fits::from_bytes("a.fits", bytes).expect("the file above")
}

/// Truth: NAXIS1 is the axis that runs fastest (FITS 4.0, section 3.3.2): row 1, column 0 of 3 columns is the pixel 3.
#[test]
fn axes_of_one_are_no_planes() {
    // As radio images have them: a frequency and a Stokes axis behind the two of the sky.
    let radio = [
        "CTYPE1  = 'RA---SIN'",
        "CTYPE2  = 'DEC--SIN'",
        "CTYPE3  = 'FREQ    '",
        "CTYPE4  = 'STOKES  '",
        "CRPIX1  =                  2.0",
        "CRPIX2  =                  1.0",
        "CRVAL1  =                 10.0",
        "CRVAL2  =                 20.0",
        "CDELT1  =               -0.001",
        "CDELT2  =                0.001",
    ];
    for (axes, cards, rows, columns) in [
        (&[3, 2][..], &[][..], 2, 3),
        (&[3, 2, 1], &[], 2, 3),
        (&[3, 2, 1, 1], &radio, 2, 3),
        (&[6, 1, 1, 1], &[], 1, 6),
        (&[1, 6, 1], &[], 6, 1),
        (&[1, 1, 1, 1], &[], 1, 1),
    ] {
        let fits = file(axes, cards);
        let image =
            ImageFrame::from_fits(&fits).unwrap_or_else(|error| panic!("{axes:?}: {error}"));
        assert_eq!(image.pixels.dim(), (rows, columns), "{axes:?}");
        assert!(image.pixels.iter().enumerate().all(|(i, p)| *p == i as f32), "{axes:?}");
        let frame = Frame::from_fits(&fits).unwrap_or_else(|error| panic!("{axes:?}: {error}"));
        assert_eq!(frame.pixels.dim(), (rows, columns), "{axes:?}");
        assert!(frame.pixels.iter().enumerate().all(|(i, p)| usize::from(*p) == i), "{axes:?}");
    }
    for axes in [&[3, 2, 2][..], &[3, 2, 1, 2], &[6]] {
        let fits = file(axes, &[]);
        for error in [
            ImageFrame::from_fits(&fits).unwrap_err().to_string(),
            Frame::from_fits(&fits).unwrap_err().to_string(),
        ] {
            assert!(error.contains("NAXIS"), "{axes:?}: {error}");
        }
    }
}
