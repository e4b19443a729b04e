//! Coordinates and zero points of the frames from the stars of a list.

use super::target::Seen;
use super::{BandUse, Folder, Shape, StarsOptions, StarsUse, TargetFrame};
use crate::field_stars::blind::{EMBEDDED_DEG, Patterns, narrowest_deg};
use crate::field_stars::{
    self, Approximate, Catalogue, ColourTerm, Coordinates, InFrame, StarMeasurement, ZeroPoint,
};
use crate::reduction::{ReduceError, step};
use hifitime::Epoch;
use sunglint_formats::wcs::Wcs;
use sunglint_numerics::measured::{Interval, Measured};
use sunglint_numerics::order::median;
use sunglint_numerics::progress::Progress;

/// Standard deviation of a target's colour that is not known, mag: satellites are sunlight, reddened by some of their materials.
const TARGET_COLOUR_SIGMA: f64 = 0.2;
/// Part by which the scale of a header may be wrong (focal lengths are nominal), and one that the user told.
const SCALE_TOLERANCE: [f64; 2] = [0.1, 0.04];
/// Part by which the width of a frame may be wrong where a header tells its scale.
const WIDTH_TOLERANCE: f64 = 0.15;

/// Julian year of a moment.
pub(super) fn year_of(time: Epoch) -> f64 {
    2000.0 + (time.to_jde_tt_days() - 2_451_545.0) / 365.25
}

impl Folder {
    /// Coordinates and zero points of the frames, places and magnitudes of the target.
    pub(super) fn put_on_stars(
        &mut self,
        fields: &[Seen<'_>],
        list: &Catalogue,
        options: &StarsOptions,
        progress: &dyn Progress,
    ) -> Result<(), ReduceError> {
        let mut filters: Vec<String> = self.frames.iter().map(|f| f.filter.clone()).collect();
        filters.sort_unstable();
        filters.dedup();
        let mut bands = Vec::new();
        let mut before: Option<Wcs> = None;
        let anywhere = Anywhere::default();
        for filter in filters {
            let band = list
                .band(&filter, &options.list)
                .map_err(sunglint_formats::error::FileError::from)?;
            let of_it: Vec<usize> =
                (0..fields.len()).filter(|&i| self.frames[i].filter == filter).collect();
            let mut found: Vec<Result<InFrame, String>> = Vec::new();
            for &i in &of_it {
                step(progress, 0)?;
                let seen = &fields[i];
                let in_it = seen.stars(list, &band, options, before.as_ref(), &anywhere);
                if let Ok(in_it) = &in_it {
                    before = Some(in_it.wcs.clone());
                }
                found.push(in_it);
            }
            let term = band.colour.as_ref().map(|_| {
                let target = options
                    .target_colour
                    .or(band.sun_colour.map(|sun| Measured::new(sun, TARGET_COLOUR_SIGMA)))
                    .unwrap_or_else(|| Measured::new(middle_colour(&found), 0.3));
                match options.colour_term {
                    Some(value) => ColourTerm {
                        value,
                        sigma: 0.0,
                        target_colour: target.value,
                        target_sigma: target.sigma,
                    },
                    None => {
                        let frames: Vec<Vec<StarMeasurement>> =
                            found.iter().flatten().map(|f| f.stars.clone()).collect();
                        field_stars::colour_term(&frames, target)
                    }
                }
            });
            let mut with_zero = 0;
            for (&i, in_it) in of_it.iter().zip(&found) {
                let frame = &mut self.frames[i];
                match in_it {
                    Ok(in_it) => {
                        frame.sky_deg = frame.place_px.and_then(|place| in_it.wcs.sky(place));
                        match field_stars::of_stars(&in_it.stars, term.as_ref()) {
                            Some(mut zero) => {
                                with_zero += 1;
                                // A streak among points, or a point among trails, loses another part of its light.
                                let is_trailed = fields[i].field.star_trails.is_some();
                                if frame.shape.is_some_and(|s| (s == Shape::Streak) != is_trailed) {
                                    let profile = fields[i].field.profile_sigma_mag();
                                    zero.sigma_mag = zero.sigma_mag.hypot(profile);
                                }
                                frame.calibrate(zero);
                            }
                            None => frame.note(&format!(
                                "no zero point: {} of {} stars can be measured",
                                in_it.stars.len(),
                                in_it.found
                            )),
                        }
                    }
                    Err(why) => frame.note(&format!("no zero point: {why}")),
                }
            }
            bands.push(BandUse {
                filter,
                column: band.column.clone(),
                system: band.system,
                colour: band.colour.as_ref().map(|(name, _)| name.clone()),
                term,
                frames: with_zero,
            });
        }
        self.stars = Some(StarsUse {
            list: options.list.path.display().to_string(),
            stars: list.len(),
            bands,
        });
        Ok(())
    }
}

/// Middle of the stars' colours; 0 where none has one.
pub(super) fn middle_colour(found: &[Result<InFrame, String>]) -> f64 {
    let stars = found.iter().flatten().flat_map(|f| &f.stars);
    median(stars.filter_map(|s| s.colour).filter(|c| c.is_finite())).unwrap_or(0.0)
}

/// Magnitude and its standard deviation of a rate.
pub(super) fn magnitude_of(rate: f64, sigma: f64, zero: &ZeroPoint) -> Option<(f64, f64)> {
    (rate > 0.0 && sigma.is_finite()).then(|| {
        let own = 2.5 / std::f64::consts::LN_10 * sigma / rate;
        (zero.mag - 2.5 * rate.log10(), own.hypot(zero.sigma_mag))
    })
}

impl TargetFrame {
    pub(super) fn note(&mut self, words: &str) {
        if !self.remark.is_empty() {
            self.remark.push_str("; ");
        }
        self.remark.push_str(words);
    }

    pub(super) fn calibrate(&mut self, zero: ZeroPoint) {
        self.zero_point = Some(zero);
        if let (Some(rate), Some(sigma)) = (self.rate_adu_per_s, self.sigma_adu_per_s)
            && let Some((magnitude, sigma)) = magnitude_of(rate, sigma, &zero)
        {
            (self.magnitude, self.sigma_mag) = (Some(magnitude), Some(sigma));
        }
        for part in &mut self.along {
            if let Some((magnitude, sigma)) =
                magnitude_of(part.rate_adu_per_s, part.sigma_adu_per_s, &zero)
            {
                (part.magnitude, part.sigma_mag) = (Some(magnitude), Some(sigma));
            }
        }
    }
}

/// Patterns of the whole sky's stars for frames whose place nobody knows, made when the first of them comes.
#[derive(Default)]
pub(super) struct Anywhere {
    patterns: std::cell::OnceCell<Option<Patterns>>,
}

impl Anywhere {
    /// Coordinates of a frame; of a scale that is known with the part by which it may be wrong.
    pub(super) fn solve(
        &self,
        seen: &Seen<'_>,
        list: &Catalogue,
        options: &StarsOptions,
        scale: Option<(f64, f64)>,
    ) -> Option<Wcs> {
        let columns = seen.field.size_px[0] as f64;
        let width = scale.map(|(arcsec, tolerance)| {
            let half = 0.5 * columns * (arcsec / 3600.0).to_radians();
            (2.0 * half.atan().to_degrees(), tolerance.max(WIDTH_TOLERANCE))
        });
        let make = || {
            let widths = width.map_or(EMBEDDED_DEG, |(width, tolerance)| {
                Interval::new(width * (1.0 - tolerance), width * (1.0 + tolerance))
            });
            let embedded = Catalogue::embedded().ok()?;
            // A list of a part of the sky has too few stars for it.
            let whole = narrowest_deg(list.len()) <= widths.low && width.is_some();
            let (stars, column) = match whole {
                true => (list, options.list.magnitude.as_deref()),
                false => (&embedded, None),
            };
            let brightness = stars.brightness(column).ok()?;
            Patterns::new(stars, &brightness, year_of(seen.time), widths).ok()
        };
        let patterns = self.patterns.get_or_init(make).as_ref()?;
        let is_trailed = seen.field.star_trails.is_some();
        Some(patterns.solve(&seen.field, is_trailed, width)?.wcs)
    }
}

impl Seen<'_> {
    /// Stars of a list in the frame: by its header's coordinates, by those of the frame before, or by the pattern of its stars.
    pub(super) fn stars(
        &self,
        list: &Catalogue,
        band: &field_stars::BandColumns,
        options: &StarsOptions,
        before: Option<&Wcs>,
        anywhere: &Anywhere,
    ) -> Result<InFrame, String> {
        let mut ways = Vec::new();
        let mut why = match Wcs::from_header(&self.header.cards) {
            Ok(Some(wcs)) => {
                ways.push(Coordinates::Known(Box::new(wcs)));
                String::new()
            }
            Ok(None) => String::new(),
            Err(why) => format!("coordinates of the header are not used: {why}; "),
        };
        ways.extend(before.map(|wcs| Coordinates::Known(Box::new(wcs.clone()))));
        let centre = options.near_deg.or(self.header.pointing_deg);
        let scale = match (options.scale_arcsec, self.header.scale_arcsec) {
            (Some(scale), _) => Some((scale, SCALE_TOLERANCE[1])),
            (None, scale) => scale.map(|scale| (scale, SCALE_TOLERANCE[0])),
        };
        if let (Some(centre_deg), Some((scale_arcsec, scale_tolerance))) = (centre, scale) {
            let near = Approximate { centre_deg, scale_arcsec, scale_tolerance };
            ways.push(Coordinates::Near(near));
        } else if ways.is_empty()
            && let Some(wcs) = anywhere.solve(self, list, options, scale)
        {
            ways.push(Coordinates::Known(Box::new(wcs)));
        } else if ways.is_empty() {
            let missing = match (centre, scale) {
                (None, None) => "neither place on the sky nor scale (--near, --scale-arcsec)",
                (None, _) => "no place on the sky (--near)",
                _ => "no scale (--scale-arcsec)",
            };
            return Err(format!(
                "{why}its header has no coordinates, and {missing}; nor is its pattern of stars found on the whole sky, which fields from 15° (of a list of the whole sky, from less) allow"
            ));
        }
        let exposure = self.header.exposure_s.unwrap_or(0.0);
        let is_trailed = self.field.star_trails.is_some();
        let year = year_of(self.time);
        for way in &ways {
            match field_stars::in_frame(&self.field, is_trailed, exposure, year, way, list, band) {
                Ok(in_it) => return Ok(in_it),
                Err(reason) if why.ends_with(&reason) => {}
                Err(reason) => why = reason,
            }
        }
        Err(why)
    }
}
