//! The target's light in a frame, and along its streak.

use super::masters::Masters;
use super::target::{Seen, Which};
use super::{FolderOptions, Part, Shape, TargetFrame};
use crate::photometry::field::{Along, along, green_light};
use crate::reduction::ReduceError;
use hifitime::Unit;
use sunglint_formats::image_frame::ImageFrame;
use sunglint_radiometry::light_curve::Flags;

/// The target of one frame, measured.
pub(super) fn measured(
    seen: &Seen<'_>,
    which: Option<Which>,
    speed: Option<f64>,
    motion: Option<[f64; 2]>,
    masters: &Masters,
    options: &FolderOptions,
) -> Result<TargetFrame, ReduceError> {
    let exposure_s = seen.header.exposure_s.unwrap_or(0.0);
    let mut out = TargetFrame {
        file: seen.header.path.display().to_string(),
        filter: seen.header.filter.clone().unwrap_or_else(|| "none".into()),
        time: seen.time,
        exposure_s,
        dwell_s: None,
        shape: None,
        place_px: which.map(|w| seen.place(w).into()),
        length_px: 0.0,
        rate_adu_per_s: None,
        sigma_adu_per_s: None,
        significance: 0.0,
        instrumental_mag: None,
        instrumental_sigma_mag: None,
        sky_deg: None,
        zero_point: None,
        magnitude: None,
        sigma_mag: None,
        sight: None,
        magnitude_1000km: None,
        remark: String::new(),
        flags: Flags::empty(),
        along: Vec::new(),
    };
    let mut remarks: Vec<&str> = Vec::new();
    let (flux, sigma, is_saturated) = match which {
        None => {
            out.flags |= Flags::UNDETECTED;
            out.remark = "no target found".into();
            return Ok(out);
        }
        Some(Which::Point(i)) => {
            let point = &seen.field.points[i];
            (out.shape, out.dwell_s, out.significance) =
                (Some(Shape::Point), Some(exposure_s), point.significance);
            let [flux, sigma] = seen.field.whole_point_adu(point).to_array();
            (flux, sigma, point.is_saturated)
        }
        Some(Which::Streak(i)) => {
            let streak = &seen.field.streaks[i];
            (out.shape, out.length_px, out.significance) =
                (Some(Shape::Streak), streak.length_px, streak.significance);
            out.flags |= Flags::TRAILED;
            if streak.is_cut {
                remarks.push("cut by the edge: length over the rate of motion counts as its time");
                // When it was in the frame is not known from one frame: the middle of the exposure stands.
                out.dwell_s = speed.map(|speed| (streak.length_px / speed).min(exposure_s));
                out.flags |= Flags::EDGE;
            } else {
                out.dwell_s = Some(exposure_s);
            }
            if streak.is_end_hidden {
                remarks.push("an end is hidden: the light may be more");
                out.flags |= Flags::CROWDED;
            }
            if options.parts > 1 && !streak.is_cut && !streak.is_saturated {
                out.along = parts(seen, i, motion, masters, options)?;
                if out.along.is_empty() {
                    remarks.push(
                        "the direction of motion is not known: no light curve along the streak",
                    );
                }
            }
            let [flux, sigma] = seen.field.whole_streak_adu(streak).to_array();
            (flux, sigma, streak.is_saturated)
        }
    };
    if is_saturated {
        remarks.push("saturated");
        out.flags |= Flags::SATURATED;
    } else if let Some(dwell) = out.dwell_s.filter(|s| *s > 0.0) {
        let (rate, sigma) = (flux / dwell, sigma / dwell);
        out.rate_adu_per_s = Some(rate);
        out.sigma_adu_per_s = Some(sigma);
        if rate > 0.0 {
            out.instrumental_mag = Some(-2.5 * rate.log10());
            out.instrumental_sigma_mag = Some(2.5 / std::f64::consts::LN_10 * sigma / rate);
        }
    } else {
        remarks.push("its time in the frame is not known: no rate");
    }
    out.remark = remarks.join("; ");
    Ok(out)
}

/// Standard deviation of sums of green light over what the median of its pixels' distances says: √2 of a green pixel's own, and half of the pixels are means of four, so that
/// the median says 0.685 of it.
const GREEN_NOISE: f64 = std::f64::consts::SQRT_2 / 0.685;

/// The light along a streak in the order of time; empty where the direction of motion is not known.
pub(super) fn parts(
    seen: &Seen<'_>,
    streak: usize,
    motion: Option<[f64; 2]>,
    masters: &Masters,
    options: &FolderOptions,
) -> Result<Vec<Part>, ReduceError> {
    let streak = &seen.field.streaks[streak];
    let Some(motion) = motion else { return Ok(Vec::new()) };
    let mut frame = ImageFrame::read_as(&seen.header.path, &options.reading)?;
    masters.apply(&mut frame.pixels);
    let mut gain = frame.header.gain_e_per_adu.or(options.field.gain_e_per_adu);
    let mut noise = 1.0;
    if let Some(pattern) = frame.header.bayer {
        frame.pixels = green_light(frame.pixels.view(), pattern);
        gain = gain.map(|gain| 0.5 * gain);
        // The scatter of pixels that are means of others is below that of their sums.
        noise = GREEN_NOISE;
    }
    let mut parts: Vec<Along> = along(frame.pixels.view(), streak, options.parts, gain)?;
    parts.iter_mut().for_each(|part| part.sigma_adu *= noise);
    let [a, b] = streak.ends_px;
    let is_forward = (b[0] - a[0]) * motion[0] + (b[1] - a[1]) * motion[1] >= 0.0;
    let exposure = seen.header.exposure_s.unwrap_or(0.0);
    let mut out: Vec<Part> = parts
        .iter()
        .map(|part| {
            let at = if is_forward { part.at } else { 1.0 - part.at };
            let length = part.width * exposure;
            Part {
                time: seen.time + (at - 0.5) * exposure * Unit::Second,
                exposure_s: length,
                rate_adu_per_s: part.flux_adu / length,
                sigma_adu_per_s: part.sigma_adu / length,
                magnitude: None,
                sigma_mag: None,
                sight: None,
                magnitude_1000km: None,
            }
        })
        .collect();
    out.sort_by_key(|part| part.time);
    Ok(out)
}
