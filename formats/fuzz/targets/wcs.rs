//! Coordinates in FITS headers: no panic; a place on the sky that is found is finite.

use sunglint_formats::fits::Fits;
use sunglint_formats::wcs::Wcs;

/// Tries one input.
pub fn run(bytes: &[u8]) {
    let Ok(fits) = Fits::from_bytes("x", bytes.to_vec()) else { return };
    for hdu in fits.hdus() {
        let Ok(Some(wcs)) = Wcs::from_header(hdu.header()) else { continue };
        let _ = wcs.scale_arcsec();
        for place in [[0.5, 0.5], [-1e6, 3.0], [512.0, 1e300], [f64::NAN, 0.0]] {
            if let Some(sky) = wcs.sky(place.into()) {
                let _ = wcs.pixel(sky);
            }
        }
        let _ = wcs.pixel([0.0, 90.0].into());
    }
}
