//! Keys of a `station.toml`, and how the file becomes a [`Station`].

use super::air_file::{AirFile, air_error};
use super::curves::{Elevation, Loader, curves_that_end_high, fractions, horizon, linearity, load};
use super::{
    AirDefaults, Camera, Channel, Counter, CounterQuantity, DeadTime, Detector, Fibre, LaserFile,
    Mount, Plane, Station, Telescope,
};
use crate::air::Air;
use crate::sky::{Geodetic, Site};
use serde::Deserialize;
use sunglint_formats::frame::Bayer;
use sunglint_formats::toml::{
    Document, Finite, Fraction, LatitudeDeg, LongitudeDeg, NonNegative, Positive,
};
use sunglint_formats::{FileError, ParseError};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct StationFile {
    name: String,
    #[serde(default)]
    description: String,
    site: SiteFile,
    telescope: TelescopeFile,
    #[serde(default)]
    air: AirFile,
    channel: Vec<ChannelFile>,
    camera: Option<CameraFile>,
    #[serde(default)]
    laser: Vec<LaserFile>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SiteFile {
    latitude_deg: LatitudeDeg,
    longitude_deg: LongitudeDeg,
    height_m: Finite,
    horizon_deg: Option<Elevation>,
    horizon_mask: Option<String>,
    note: Option<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TelescopeFile {
    primary_diameter_m: Positive,
    obstruction_diameter_m: NonNegative,
    focal_length_m: Positive,
    #[serde(default)]
    mount: Mount,
    note: Option<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ChannelFile {
    name: String,
    #[serde(default)]
    optics: Vec<String>,
    transmission: Option<Fraction>,
    efficiency: String,
    camera_plane: Option<Plane>,
    filter: Option<String>,
    counter: Option<CounterFile>,
    typical_kappa: Option<Positive>,
    note: Option<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CounterFile {
    #[serde(default)]
    quantity: CounterQuantity,
    dead_time_model: DeadTimeModel,
    dead_time_ns: Option<NonNegative>,
    recovery_ns: Option<Positive>,
    pixels: Option<u32>,
    pulse_ns: Option<NonNegative>,
    linearity: Option<String>,
    saturation_hz: Positive,
    dark_rate_hz: NonNegative,
    area_mm2: Option<Positive>,
    fibre_offset_px: Option<[Finite; 2]>,
    fibre_sigma_px: Option<[Positive; 2]>,
}

#[derive(Deserialize, Clone, Copy, PartialEq, Eq)]
#[serde(rename_all = "snake_case")]
enum DeadTimeModel {
    None,
    NonParalysable,
    Paralysable,
    ExponentialRecovery,
    MultiPixel,
    Table,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraFile {
    name: String,
    width_px: u32,
    height_px: u32,
    pixel_size_um: Option<Positive>,
    pixel_scale_arcsec: Option<Positive>,
    bayer: Option<String>,
    gain_e_per_adu: Positive,
    read_noise_e: NonNegative,
    full_well_e: Positive,
    adc_bits: u8,
    dark_e_per_s: Option<NonNegative>,
    note: Option<String>,
}

/// The station of a document; `curve` reads the files that it names.
pub(super) fn station(document: &Document, curve: Loader) -> Result<Station, FileError> {
    let file: StationFile = document.parse()?;
    let mut notes = Vec::new();
    let mut note =
        |table: String, text: Option<String>| notes.extend(text.map(|text| (table, text)));
    check_name(document, "name", &file.name, "_-")?;
    let site = site(document, &file.site)?;
    let horizon_deg = file.site.horizon_deg.map(Elevation::get);
    let horizon = horizon(document, horizon_deg, file.site.horizon_mask.as_deref(), curve)?;
    note("site".into(), file.site.note);
    let telescope = telescope(document, &file.telescope)?;
    note("telescope".into(), file.telescope.note);
    note("air".into(), file.air.note.clone());
    let camera = file.camera.as_ref().map(|c| camera(document, c, &telescope)).transpose()?;
    note("camera".into(), file.camera.and_then(|c| c.note));
    if file.channel.is_empty() {
        return Err(document.error_at("channel", "at least one [[channel]]").into());
    }
    let mut channels: Vec<Channel> = Vec::new();
    for (i, channel_file) in file.channel.into_iter().enumerate() {
        let at = format!("channel[{i}]");
        let channel = channel(document, &at, &channel_file, camera.as_ref(), curve)?;
        if channels.iter().any(|c| c.name == channel.name) {
            let expected = "a name that no other channel has";
            return Err(document.error_at(&format!("{at}.name"), expected).into());
        }
        note(format!("channel {}", channel.name), channel_file.note);
        channels.push(channel);
    }
    for laser in &file.laser {
        note(format!("laser {}", laser.name), laser.note.clone());
    }
    let known = |name: &str| channels.iter().any(|c| c.name == name);
    let lasers = super::laser_file::lasers(document, &file.laser, &[], &known)?;
    let profile = AirDefaults { profile: "midlatitude_winter".into(), ..AirDefaults::default() };
    let air = file.air.over(document, "air", &profile)?;
    let (name, description) = (file.name, file.description);
    let warnings = channels.iter().flat_map(curves_that_end_high).collect();
    let station = Station {
        name,
        description,
        site,
        horizon,
        telescope,
        air,
        channels,
        camera,
        lasers,
        notes,
        warnings,
        sources: Vec::new(),
    };
    let made = station.air.options(station.site.geodetic().height_m).and_then(|o| Air::new(&o));
    made.map_err(|error| air_error(document, "air", "site.height_m", &error))?;
    Ok(station)
}

pub(super) fn check_name(
    document: &Document,
    key: &str,
    name: &str,
    extra: &str,
) -> Result<(), ParseError> {
    let good = |c: char| c.is_ascii_alphanumeric() || extra.contains(c);
    if !name.is_empty() && name.chars().all(good) {
        return Ok(());
    }
    let extra: Vec<String> = extra.chars().map(|c| c.to_string()).collect();
    Err(document.error_at(key, format!("a name of letters, digits and {}", extra.join(" "))))
}

fn site(document: &Document, file: &SiteFile) -> Result<Site, ParseError> {
    let geodetic = Geodetic {
        latitude_deg: file.latitude_deg.get(),
        longitude_deg: file.longitude_deg.get(),
        height_m: file.height_m.get(),
    };
    Site::new(geodetic).map_err(|e| document.error_at("site.height_m", e.to_string()))
}

/// Diameter of the largest telescope that is being built, m: ESO's ELT.
const LARGEST_M: f64 = 40.0;
/// Ratios of focal length to diameter that a telescope may have.
const FOCAL_RATIOS: std::ops::RangeInclusive<f64> = 0.3..=300.0;

fn telescope(document: &Document, file: &TelescopeFile) -> Result<Telescope, ParseError> {
    let telescope = Telescope {
        primary_diameter_m: file.primary_diameter_m.get(),
        obstruction_diameter_m: file.obstruction_diameter_m.get(),
        focal_length_m: file.focal_length_m.get(),
        mount: file.mount,
    };
    if telescope.obstruction_diameter_m >= telescope.primary_diameter_m {
        let expected = format!("less than primary_diameter_m = {}", telescope.primary_diameter_m);
        return Err(document.error_at("telescope.obstruction_diameter_m", expected));
    }
    // Millimetres for metres would multiply the light by a million, without a word.
    if telescope.primary_diameter_m > LARGEST_M {
        let expected = format!("metres, at most {LARGEST_M}: 0.3 for 300 mm");
        return Err(document.error_at("telescope.primary_diameter_m", expected));
    }
    let ratio = telescope.focal_length_m / telescope.primary_diameter_m;
    if !FOCAL_RATIOS.contains(&ratio) {
        let expected =
            format!("metres, 0.3 to 300 times the diameter of {} m", telescope.primary_diameter_m);
        return Err(document.error_at("telescope.focal_length_m", expected));
    }
    Ok(telescope)
}

fn camera(
    document: &Document,
    file: &CameraFile,
    telescope: &Telescope,
) -> Result<Camera, ParseError> {
    const ARCSEC_PER_RADIAN: f64 = 648_000.0 / std::f64::consts::PI;
    let pixel_scale_arcsec = match (&file.pixel_scale_arcsec, &file.pixel_size_um) {
        (Some(_), Some(_)) => {
            let expected = "either pixel_scale_arcsec or pixel_size_um, not both";
            return Err(document.error_at("camera.pixel_scale_arcsec", expected));
        }
        (Some(scale), None) => scale.get(),
        (None, Some(size)) => {
            (size.get() * 1e-6 / telescope.focal_length_m).atan() * ARCSEC_PER_RADIAN
        }
        (None, None) => {
            return Err(document.error_at("camera", "pixel_scale_arcsec or pixel_size_um"));
        }
    };
    // A pixel smaller than light's wavelength, or a centimetre wide: another unit.
    if let Some(size) = file.pixel_size_um.filter(|size| !(0.3..=1000.0).contains(&size.get())) {
        let expected = format!("micrometres, 0.3 to 1000, not {}", size.get());
        return Err(document.error_at("camera.pixel_size_um", expected));
    }
    for (key, value) in [("camera.width_px", file.width_px), ("camera.height_px", file.height_px)] {
        if value == 0 {
            return Err(document.error_at(key, "at least 1 pixel"));
        }
    }
    if !(1..=32).contains(&file.adc_bits) {
        return Err(document.error_at("camera.adc_bits", "1 to 32 bits"));
    }
    let bayer = match file.bayer.as_deref() {
        None => None,
        Some(name) => Some(Bayer::from_name(name).ok_or_else(|| {
            let expected = "RGGB, BGGR, GRBG or GBRG (none for a monochrome camera)";
            document.error_at("camera.bayer", expected)
        })?),
    };
    Ok(Camera {
        name: file.name.clone(),
        size_px: [file.width_px, file.height_px],
        pixel_scale_arcsec,
        bayer,
        gain_e_per_adu: file.gain_e_per_adu.get(),
        read_noise_e: file.read_noise_e.get(),
        full_well_e: file.full_well_e.get(),
        adc_bits: file.adc_bits,
        dark_e_per_s: file.dark_e_per_s.map_or(0.0, NonNegative::get),
    })
}

fn channel(
    document: &Document,
    at: &str,
    file: &ChannelFile,
    camera: Option<&Camera>,
    curve: Loader,
) -> Result<Channel, FileError> {
    check_name(document, &format!("{at}.name"), &file.name, "_")?;
    let efficiency =
        fractions(load(document, &format!("{at}.efficiency"), &file.efficiency, curve)?)?;
    let mut optics = Vec::new();
    for (i, name) in file.optics.iter().enumerate() {
        optics.push(fractions(load(document, &format!("{at}.optics[{i}]"), name, curve)?)?);
    }
    let detector = match (&file.camera_plane, &file.counter) {
        (Some(plane), None) => camera_plane(document, at, *plane, camera)?,
        (None, Some(file)) => Detector::Counter(counter(document, at, file, camera, curve)?),
        _ => {
            let expected = "either camera_plane or a table [channel.counter]";
            return Err(document.error_at(at, expected).into());
        }
    };
    if file.filter.is_some() && file.camera_plane.is_none() {
        let expected = "a camera_plane beside it: it names the filter before the camera";
        return Err(document.error_at(&format!("{at}.filter"), expected).into());
    }
    let typical_kappa = file.typical_kappa.map(Positive::get);
    let transmission = file.transmission.map_or(1.0, Fraction::get);
    let name = file.name.clone();
    let filter = file.filter.clone();
    let channel =
        Channel { name, optics, transmission, efficiency, detector, filter, typical_kappa };
    if channel.counts_photons() && channel.optics.is_empty() {
        let expected = "at least one curve: the efficiency is left out of photons, so that optics alone bound the channel";
        return Err(document.error_at(&format!("{at}.optics"), expected).into());
    }
    if channel.range_nm().is_none() || channel.bandwidth_nm() <= 0.0 {
        let expected = "optics and efficiency with wavelengths in common, at which they are not 0";
        let ranges: Vec<String> = channel
            .factors()
            .map(|c| format!("{} to {} nm", c.range_nm().0, c.range_nm().1))
            .collect();
        let hint = format!(
            "its curves run over {}; a column in angstrom is named wavelength_angstrom",
            ranges.join(", ")
        );
        return Err(document
            .error_at(&format!("{at}.efficiency"), expected)
            .with_hint(hint)
            .into());
    }
    Ok(channel)
}

fn camera_plane(
    document: &Document,
    at: &str,
    plane: Plane,
    camera: Option<&Camera>,
) -> Result<Detector, ParseError> {
    let wrong = |expected: &str| Err(document.error_at(&format!("{at}.camera_plane"), expected));
    let Some(camera) = camera else {
        return wrong("a table [camera] that this plane belongs to");
    };
    match (plane, camera.bayer.is_some()) {
        (Plane::L, true) => wrong("R, G or B: the camera has a Bayer pattern"),
        (Plane::R | Plane::G | Plane::B, false) => wrong("L: the camera has no Bayer pattern"),
        _ => Ok(Detector::CameraPlane(plane)),
    }
}

fn counter(
    document: &Document,
    at: &str,
    file: &CounterFile,
    camera: Option<&Camera>,
    curve: Loader,
) -> Result<Counter, FileError> {
    let key = |name: &str| format!("{at}.counter.{name}");
    let given = [
        ("dead_time_ns", file.dead_time_ns.is_some()),
        ("recovery_ns", file.recovery_ns.is_some()),
        ("pixels", file.pixels.is_some()),
        ("pulse_ns", file.pulse_ns.is_some()),
        ("linearity", file.linearity.is_some()),
    ];
    let (model, wanted): (&str, &[&str]) = match file.dead_time_model {
        DeadTimeModel::None => ("none", &[]),
        DeadTimeModel::NonParalysable => ("non_paralysable", &["dead_time_ns"]),
        DeadTimeModel::Paralysable => ("paralysable", &["dead_time_ns"]),
        DeadTimeModel::ExponentialRecovery => {
            ("exponential_recovery", &["dead_time_ns", "recovery_ns"])
        }
        DeadTimeModel::MultiPixel => ("multi_pixel", &["pixels", "recovery_ns", "pulse_ns"]),
        DeadTimeModel::Table => ("table", &["linearity"]),
    };
    for (name, is_given) in given {
        if wanted.contains(&name) && !is_given {
            let expected = format!("{name}, which the model {model} needs");
            return Err(document.error_at(&key("dead_time_model"), expected).into());
        }
        if !wanted.contains(&name) && is_given {
            let expected = format!("no {name}: the model {model} does not use it");
            return Err(document.error_at(&key(name), expected).into());
        }
    }
    let seconds = |ns: Option<f64>| ns.unwrap_or(0.0) * 1e-9;
    let dead_time_s = seconds(file.dead_time_ns.map(NonNegative::get));
    let dead_time = match file.dead_time_model {
        DeadTimeModel::None => DeadTime::None,
        DeadTimeModel::NonParalysable => DeadTime::NonParalysable { dead_time_s },
        DeadTimeModel::Paralysable => DeadTime::Paralysable { dead_time_s },
        DeadTimeModel::ExponentialRecovery => {
            let recovery_s = seconds(file.recovery_ns.map(Positive::get));
            DeadTime::ExponentialRecovery { dead_time_s, recovery_s }
        }
        DeadTimeModel::MultiPixel => {
            let pixels = file.pixels.unwrap_or_default();
            if pixels == 0 {
                return Err(document.error_at(&key("pixels"), "at least 1 pixel").into());
            }
            DeadTime::MultiPixel {
                pixels,
                recovery_s: seconds(file.recovery_ns.map(Positive::get)),
                pulse_s: seconds(file.pulse_ns.map(NonNegative::get)),
            }
        }
        DeadTimeModel::Table => linearity(load(
            document,
            &key("linearity"),
            file.linearity.as_deref().unwrap_or_default(),
            curve,
        )?)?,
    };
    // The most that the model can give: a saturation above it can never be reached.
    let limit_hz = match dead_time {
        DeadTime::NonParalysable { dead_time_s } => 1.0 / dead_time_s,
        DeadTime::Paralysable { dead_time_s } => 1.0 / (std::f64::consts::E * dead_time_s),
        // Its recovery only slows it further.
        DeadTime::ExponentialRecovery { dead_time_s, .. } => 1.0 / dead_time_s,
        // Pixels alone count more and more slowly, but without an end.
        DeadTime::MultiPixel { pulse_s, .. } => 1.0 / (std::f64::consts::E * pulse_s),
        DeadTime::None | DeadTime::Table { .. } => f64::INFINITY,
    };
    // A saturation at the limit itself is meant, whatever the last digit of its reciprocal.
    if file.saturation_hz.get() > limit_hz * (1.0 + 1e-9) {
        let ns = file.dead_time_ns.as_ref().or(file.pulse_ns.as_ref()).map_or(0.0, |ns| ns.get());
        let what = if file.pulse_ns.is_some() { "pulses" } else { "a dead time" };
        let expected = format!("at most {limit_hz:.6e} Hz, which {what} of {ns} ns allows");
        return Err(document.error_at(&key("saturation_hz"), expected).into());
    }
    if let DeadTime::Table { measured_hz, .. } = &dead_time {
        let last = measured_hz.last().copied().unwrap_or(0.0);
        if last < file.saturation_hz.get() {
            let expected = format!("at most {last} Hz, where the linearity curve ends");
            return Err(document.error_at(&key("saturation_hz"), expected).into());
        }
    }
    if file.dark_rate_hz.get() >= file.saturation_hz.get() {
        let expected = format!("less than saturation_hz = {}", file.saturation_hz.get());
        return Err(document.error_at(&key("dark_rate_hz"), expected).into());
    }
    let fibre = match (file.fibre_offset_px, file.fibre_sigma_px) {
        (Some(_), Some(_)) if camera.is_none() => {
            let expected = "a table [camera], in whose pixels the fibre's field is given";
            return Err(document.error_at(&key("fibre_offset_px"), expected).into());
        }
        (Some(offset), Some(sigma)) => Some(Fibre {
            offset_px: offset.map(Finite::get).into(),
            sigma_px: sigma.map(Positive::get).into(),
        }),
        (None, None) => None,
        _ => {
            let expected = "fibre_offset_px and fibre_sigma_px, or neither";
            return Err(document.error_at(&format!("{at}.counter"), expected).into());
        }
    };
    Ok(Counter {
        quantity: file.quantity,
        dead_time,
        saturation_hz: file.saturation_hz.get(),
        dark_rate_hz: file.dark_rate_hz.get(),
        area_mm2: file.area_mm2.map(Positive::get),
        fibre,
    })
}
