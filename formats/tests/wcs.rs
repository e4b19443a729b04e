//! World coordinates against astropy's (wcslib), which shares no code with ours.

use sunglint_formats::fits::{Fits, Kind};
use sunglint_formats::wcs::{Equatorial, Wcs};
use sunglint_testkit::{peer_python, run_python};

const SCRIPT: &str = "
import sys, json, warnings
import numpy as np
from astropy.io import fits
from astropy.wcs import WCS
warnings.simplefilter('ignore')
folder = sys.argv[1]
rng = np.random.default_rng(20261123)
out = []
for n in range(120):
    code = ['TAN', 'SIN', 'ARC', 'STG', 'TAN-SIP', 'TPV'][n % 6]
    dec = [0.0, 45.0, -89.9, 89.99, -30.0, 90.0, -90.0, 12.0][n % 8]
    ra = rng.uniform(0, 360)
    scale = 10**rng.uniform(-0.5, 1.8) / 3600
    turn = rng.uniform(0, 2*np.pi)
    flip = rng.choice([-1, 1])
    h = fits.Header()
    names = ['RA---', 'DEC--']
    crval = [ra, dec]
    swap = code in ('TAN', 'ARC') and n % 5 == 0 and n % 3 < 2
    cd = scale * np.array([[flip*np.cos(turn), -np.sin(turn)], [flip*np.sin(turn), np.cos(turn)]])
    if swap: names, crval, cd = names[::-1], crval[::-1], cd[::-1]
    for i in (0, 1):
        h[f'CTYPE{i+1}'] = names[i] + code
        h[f'CRVAL{i+1}'] = crval[i]
        h[f'CRPIX{i+1}'] = rng.uniform(-200, 1200)
    form = n % 3
    if code == 'TAN-SIP' or code == 'TPV': form = 0
    if form == 0:
        for i in (0, 1):
            for j in (0, 1): h[f'CD{i+1}_{j+1}'] = cd[i][j]
    elif form == 1:
        h['CDELT1'], h['CDELT2'] = scale, -2*scale
        for i in (0, 1):
            for j in (0, 1): h[f'PC{i+1}_{j+1}'] = cd[i][j] / scale
    else:
        h['CDELT1'], h['CDELT2'], h['CROTA2'] = -scale, scale, np.degrees(turn)
    if n % 7 == 3: h['LONPOLE'] = rng.uniform(0, 360)
    if code == 'TAN-SIP':
        for k in 'AB':
            h[k + '_ORDER'] = 3
            for p in range(4):
                for q in range(4 - p):
                    if p + q >= 2: h[f'{k}_{p}_{q}'] = rng.normal() * (2e-6 if p + q == 2 else 1e-9)
    if code == 'TPV':
        for i in (1, 2):
            h[f'PV{i}_0'] = 1e-4 * rng.normal()
            h[f'PV{i}_1'] = 1 + 1e-3 * rng.normal()
            for k in range(2, 11): h[f'PV{i}_{k}'] = 1e-4 * rng.normal()
    h['RADESYS'] = 'ICRS'
    wcs = WCS(h)
    pixels = rng.uniform(0, 1000, (40, 2))
    sky = wcs.all_pix2world(pixels, 0)
    if swap: sky = sky[:, ::-1]
    fits.PrimaryHDU(np.zeros((4, 4), 'u2'), h).writeto(f'{folder}/{n}.fits')
    out.append({'pixels': pixels.tolist(), 'sky': sky.tolist()})
print(json.dumps(out))
";

#[derive(serde::Deserialize)]
struct Case {
    pixels: Vec<[f64; 2]>,
    sky: Vec<[f64; 2]>,
}

/// Tolerance: 1e-9° (4 µas) and 1e-5 px: rounding of both, through an arc sine near the pole and a distortion undone by steps.
#[test]
fn places_are_those_of_astropy() {
    let Some(python) = peer_python("places_are_those_of_astropy", &["astropy"]) else { return };
    let folder = tempfile::tempdir().unwrap();
    let out = run_python(&python, SCRIPT, &[folder.path().to_str().unwrap()]);
    let cases: Vec<Case> = serde_json::from_str(&out).unwrap();
    assert_eq!(cases.len(), 120);
    for (n, case) in cases.iter().enumerate() {
        let fits = Fits::read(folder.path().join(format!("{n}.fits"))).unwrap();
        let header = fits.image(fits.first(Kind::Image).unwrap()).unwrap().header;
        let wcs = Wcs::from_header(&header).unwrap().unwrap();
        for (pixel, truth) in case.pixels.iter().zip(&case.sky) {
            let sky = wcs.sky((*pixel).into()).unwrap().to_array();
            let off = (sky[0] - truth[0] + 180.0).rem_euclid(360.0) - 180.0;
            let off = off * truth[1].to_radians().cos();
            assert!(
                off.abs() < 1e-9 && (sky[1] - truth[1]).abs() < 1e-9,
                "{n}: {pixel:?} is {sky:?}, astropy says {truth:?}"
            );
            let back = wcs.pixel((*truth).into()).unwrap();
            let away = (back[0] - pixel[0]).hypot(back[1] - pixel[1]);
            assert!(away < 1e-5, "{n}: {pixel:?} comes back as {back:?}");
        }
    }
}

/// What cannot be used is said in words, and what is no world coordinate at all is none.
#[test]
fn coordinates_that_cannot_be_used_say_why() {
    let header = |cards: &[(&str, &str)]| {
        let mut header = sunglint_formats::fits::Header::default();
        for (keyword, value) in [
            ("CTYPE1", "RA---TAN"),
            ("CTYPE2", "DEC--TAN"),
            ("CRVAL1", "10"),
            ("CRVAL2", "20"),
            ("CRPIX1", "1"),
            ("CRPIX2", "1"),
            ("CDELT1", "-0.001"),
            ("CDELT2", "0.001"),
        ]
        .iter()
        .chain(cards)
        {
            match value.parse::<f64>() {
                Ok(number) => header.set(keyword, number, ""),
                Err(_) => header.set(keyword, *value, ""),
            }
        }
        header
    };
    assert!(Wcs::from_header(&header(&[])).unwrap().is_some());
    assert_eq!(Wcs::from_header(&header(&[("CTYPE1", "GLON-TAN")])), Ok(None));
    for (cards, words) in [
        (vec![("CTYPE1", "RA---AIT"), ("CTYPE2", "DEC--AIT")], "RA---AIT is not known"),
        (vec![("CTYPE2", "DEC--SIN")], "do not belong together"),
        (vec![("RADESYS", "FK4")], "FK4, expected ICRS or FK5"),
        (vec![("EQUINOX", "2026.9")], "2026.9, expected 2000"),
        (vec![("CDELT1", "0")], "cannot be inverted"),
        (vec![("CRVAL2", "91")], "beyond 90"),
        (vec![("CRPIX1", "x")], "CRPIX1 is missing"),
        (vec![("CTYPE1", "RA---TAN-SIP"), ("A_ORDER", "77")], "A_ORDER"),
    ] {
        let error = Wcs::from_header(&header(&cards)).unwrap_err();
        assert!(error.contains(words), "{cards:?}: {error}");
    }
    // Behind the tangential plane there is no pixel.
    let wcs = Wcs::from_header(&header(&[])).unwrap().unwrap();
    assert_eq!(wcs.pixel(Equatorial { ra_deg: 190.0, dec_deg: -20.0 }), None);
    assert!((wcs.scale_arcsec() - 3.6).abs() < 1e-12);
}
