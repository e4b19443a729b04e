//! Pictures, reflection maps and spheres: text, JSON, figure, FITS.

mod fits;
pub mod map;
pub mod sphere;
mod tiles;

use crate::{Product, json_of, rounded};
use serde::Serialize;
use serde_json::Value;
use std::fmt::Write as _;
use sunglint_formats::EncodeError;
use sunglint_formats::time::format_utc_shortest;
use sunglint_simulator::picture::{Shot, What, arcsec};
use tiles::{depths, gallery, length};

/// A picture in words and files.
#[derive(Debug, Clone, Copy)]
pub struct PictureReport<'a> {
    /// The picture.
    pub shot: &'a Shot<'a>,
}

#[derive(Serialize)]
struct BandJson {
    wavelength_nm: f64,
    total: f64,
    brightest_pixel: f64,
    outside: f64,
    fwhm_arcsec: Option<f64>,
}

#[derive(Serialize)]
struct MaterialJson<'a> {
    name: &'a str,
    seen_m2: f64,
}

#[derive(Serialize)]
struct PictureJson<'a> {
    title: &'a str,
    target: &'a str,
    time_utc: Option<String>,
    range_m: Option<f64>,
    phase_deg: f64,
    sun_body: [f64; 3],
    observer_body: [f64; 3],
    up: &'a str,
    size_px: [usize; 2],
    pixel_m: f64,
    unit: &'a str,
    bands: Vec<BandJson>,
    materials: Vec<MaterialJson<'a>>,
    depth_m: DepthJson,
    warnings: &'a [String],
}

#[derive(Serialize)]
struct DepthJson {
    from: Option<f64>,
    to: Option<f64>,
}

impl PictureReport<'_> {
    /// Pictures, FITS images and summary.
    ///
    /// # Errors
    /// Images that FITS does not hold.
    pub fn product(&self) -> Result<Product, EncodeError> {
        Ok(Product {
            name: "picture".into(),
            gallery: Some(gallery(self.shot)),
            fits: Some(fits::bytes(self.shot)?),
            json: self.json(),
            ..Product::default()
        })
    }

    fn bands(&self) -> std::ops::Range<usize> {
        let wants = self.shot.what.contains(&What::Intensity);
        0..if wants { self.shot.asked } else { 0 }
    }

    fn most(&self, band: usize) -> f64 {
        self.shot.picture.bands[band].iter().copied().fold(0.0, f64::max)
    }

    fn seen_m2(&self, material: usize) -> f64 {
        let share: f64 = self.shot.picture.materials[material].iter().sum();
        share * self.shot.camera.pixel_m * self.shot.camera.pixel_m
    }

    /// The text.
    pub fn text(&self) -> String {
        let (shot, aim) = (self.shot, self.shot.aim);
        let mut text = format!("{}\n", aim.title);
        let [w, h] = shot.camera.size_px;
        let _ = write!(text, "  picture    {w} × {h} pixels of {}", length(shot.camera.pixel_m));
        if let Some(range_m) = aim.range_m {
            let _ = write!(text, " ({:.4}″)", shot.camera.pixel_m / range_m / arcsec());
        }
        let _ = writeln!(text, ", {}, orthographic", aim.up_name);
        if let Some(words) = &shot.optics.words {
            let _ = writeln!(text, "  optics     {words}");
        }
        let _ = writeln!(
            text,
            "  light      sunlight scattered once, from the middle of the Sun's disc; no air in between"
        );
        for band in self.bands() {
            let _ = writeln!(
                text,
                "  {:>6} nm  {:.6e} {} in all; brightest pixel {:.3e}{}",
                shot.bands_nm[band],
                shot.totals[band],
                shot.unit(),
                self.most(band),
                if shot.lost(band) > 5e-5 {
                    format!("; {:.2} % of it outside the picture", 100.0 * shot.lost(band))
                } else {
                    String::new()
                }
            );
        }
        if shot.what.contains(&What::Rgb) {
            text.push_str("  eye        640, 550 and 450 nm over the Sun's irradiance as red, green and blue, by the sRGB curve; the brightest 0.5 % of lit pixels are saturated\n");
        }
        text.push_str("  seen       ");
        let seen: Vec<String> = (0..aim.target.materials.len())
            .map(|k| (k, self.seen_m2(k)))
            .filter(|(_, m2)| *m2 > 0.0)
            .map(|(k, m2)| format!("{} {m2:.4} m²", aim.target.materials[k].name))
            .collect();
        let _ =
            writeln!(text, "{}", if seen.is_empty() { "nothing".into() } else { seen.join(", ") });
        if let Some(depths) = depths(shot) {
            let _ = writeln!(
                text,
                "  depth      {:.3} to {:.3} m behind the plane through the body's origin",
                depths.start, depths.end
            );
        }
        text
    }

    fn json(&self) -> Value {
        let (shot, aim) = (self.shot, self.shot.aim);
        let bands: Vec<_> = self
            .bands()
            .map(|band| BandJson {
                wavelength_nm: shot.bands_nm[band],
                total: rounded(shot.totals[band]),
                brightest_pixel: rounded(self.most(band)),
                outside: rounded(shot.lost(band)),
                fwhm_arcsec: shot.optics.fwhm_arcsec.get(band).map(|f| rounded(*f)),
            })
            .collect();
        let materials: Vec<_> = aim
            .target
            .materials
            .iter()
            .enumerate()
            .map(|(k, m)| MaterialJson { name: &m.name, seen_m2: rounded(self.seen_m2(k)) })
            .collect();
        let depths = depths(shot);
        json_of(&PictureJson {
            title: &aim.title,
            target: &aim.target.name,
            time_utc: aim.time.map(format_utc_shortest),
            range_m: aim.range_m.map(rounded),
            phase_deg: rounded(aim.phase_deg()),
            sun_body: aim.sun_body.to_array().map(rounded),
            observer_body: aim.observer_body.to_array().map(rounded),
            up: aim.up_name,
            size_px: shot.camera.size_px,
            pixel_m: rounded(shot.camera.pixel_m),
            unit: shot.unit(),
            bands,
            materials,
            depth_m: DepthJson {
                from: depths.clone().map(|d| rounded(d.start)),
                to: depths.map(|d| rounded(d.end)),
            },
            warnings: &aim.warnings,
        })
    }
}
