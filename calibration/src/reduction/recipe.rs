//! Recipe of a reduction: what a person chose in place of the usual options, under a name, so that it can be repeated.
//!
//! The page writes it into a session's folder (`reductions/NAME.toml`), `sunglint reduce --recipe` reads it, and both call [`reduce`](super::reduce) with the
//! options that it gives: the same recipe of the same session gives the same bytes.

use super::counts::gate;
use super::frames::FrameOptions;
use super::night::ReduceOptions;
use crate::photometry::{Choice, PhotometryError, PhotometryOptions, Trail};
use glam::DVec2;
use serde::{Deserialize, Serialize};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use sunglint_formats::FileError;
use sunglint_formats::session::{Session, is_name};
use sunglint_formats::toml::Document;
use sunglint_numerics::measured::{Interval, pair};

/// Folder of a session that holds its recipes.
const FOLDER: &str = "reductions";
/// Places and frames of one recipe at most.
const MOST: usize = 100_000;

/// Choices in place of the usual options of a reduction. What is absent is as usual.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Recipe {
    /// Only the visits of this target.
    pub target: Option<String>,
    /// Only this one of them, from 1.
    pub visit: Option<u32>,
    /// Radius of the aperture, px.
    pub aperture_px: Option<f64>,
    /// Inner and outer radius of the annulus for the background, px.
    #[serde(with = "pair")]
    pub annulus_px: Option<Interval>,
    /// Full width at half maximum of a point, px.
    pub fwhm_px: Option<f64>,
    /// Standard deviations by which a target stands out of the background.
    pub detect_sigma: Option<f64>,
    /// Fewest and most pixels of a target.
    pub area_px: Option<[usize; 2]>,
    /// Least fraction of its bounding box that a target fills.
    pub min_fill: Option<f64>,
    /// Largest ratio of the bounding box's sides.
    pub max_aspect: Option<f64>,
    /// Furthest from where the target is expected, px.
    pub max_offset_px: Option<f64>,
    /// Whether the brightest of several sources is taken, not the nearest.
    pub brightest: bool,
    /// Whether targets are drawn out by their motion.
    pub trailed: bool,
    /// Largest q of the fibre's field at which a sample counts.
    pub gate: Option<f64>,
    /// Whether samples count wherever the target stood.
    pub no_gate: bool,
    /// Whether rates are left as they are, not divided by the fibre's coupling.
    pub no_coupling: bool,
    /// Places at which a person saw the target: it is followed from there.
    #[serde(rename = "place")]
    pub places: Vec<PointedPlace>,
    /// Frames that a person refused.
    pub refused: Vec<RefusedFrames>,
}

/// Place of the target in a frame, as a person pointed at it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PointedPlace {
    /// Name of the camera in the session.
    pub camera: String,
    /// Number of the frame.
    pub frame: u64,
    /// Column and row, px: the middle of the first pixel is 0, 0.
    #[serde(with = "pair")]
    pub place_px: DVec2,
}

/// Frames of a camera that a person refused: they have no rate, and no place of the target.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RefusedFrames {
    /// Name of the camera in the session.
    pub camera: String,
    /// Numbers of the frames.
    pub frames: Vec<u64>,
}

/// A choice that cannot be.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{key} is {found}, expected {expected}")]
pub struct RecipeError {
    /// Key in the recipe.
    pub key: &'static str,
    /// Value that was found.
    pub found: String,
    /// Values that it may have.
    pub expected: &'static str,
}

impl RecipeError {
    /// An option of the photometry that is out of its range, by its key in a recipe.
    fn of(error: PhotometryError) -> Self {
        let PhotometryError::Option { name, value, expected } = error else {
            let (key, found) = ("aperture_px", error.to_string());
            return Self { key, found, expected: "an aperture that can be measured in" };
        };
        let key = match name {
            "aperture_radius_px" => "aperture_px",
            "annulus_px (inner)" | "annulus_px (outer)" => "annulus_px",
            "threshold_sigma" => "detect_sigma",
            name => name,
        };
        Self { key, found: format!("{value}"), expected }
    }
}

impl Recipe {
    /// Path of a session's recipe of that name; `None` for a text that is no name: letters, digits, `_` and `-`, at most 64.
    pub fn path(session: &Session, name: &str) -> Option<PathBuf> {
        is_name(name).then(|| session.root().join(FOLDER).join(format!("{name}.toml")))
    }

    /// Names of a session's recipes, in their order.
    pub fn names(session: &Session) -> Vec<String> {
        let Ok(entries) = std::fs::read_dir(session.root().join(FOLDER)) else { return Vec::new() };
        let name = |entry: std::io::Result<std::fs::DirEntry>| {
            let name = entry.ok()?.file_name().into_string().ok()?;
            name.strip_suffix(".toml").filter(|name| is_name(name)).map(str::to_owned)
        };
        let mut names: Vec<String> = entries.filter_map(name).collect();
        names.sort();
        names
    }

    /// Reads a recipe.
    ///
    /// # Errors
    /// A file that cannot be read, or holds something else; a number out of its range.
    pub fn read(path: &Path) -> Result<Self, FileError> {
        let document = Document::read(path)?;
        let recipe: Self = document.parse()?;
        recipe.check().map_err(|error| document.error_at(error.key, error.expected))?;
        Ok(recipe)
    }

    /// Refuses numbers that no reduction can have.
    ///
    /// # Errors
    /// The first of them.
    pub fn check(&self) -> Result<(), RecipeError> {
        let within = |key, value: Option<f64>, [least, most]: [f64; 2], expected| match value {
            Some(value) if !(least..=most).contains(&value) => {
                Err(RecipeError { key, found: format!("{value}"), expected })
            }
            _ => Ok(()),
        };
        within("gate", self.gate, [1e-6, 1e6], "a number above 0, to 1000000")?;
        // What the measurement itself refuses, with the recipe's names.
        let mut options = FrameOptions::new(PhotometryOptions::new([1, 1], 0.0));
        self.apply_to_frames(&mut options);
        options.photometry.check().map_err(RecipeError::of)?;
        if let Some([least, most]) = self.area_px
            && least > most
        {
            let expected = "the fewest pixels, then the most";
            return Err(RecipeError {
                key: "area_px",
                found: format!("{least}, {most}"),
                expected,
            });
        }
        if self.visit.is_some() && self.target.is_none() {
            let found = self.visit.map_or(String::new(), |number| number.to_string());
            return Err(RecipeError { key: "visit", found, expected: "a target beside it" });
        }
        let far = |place: &f64| place.is_nan() || place.abs() > 1e6;
        if let Some(place) =
            self.places.iter().find(|place| place.place_px.to_array().iter().any(far))
        {
            let [x, y] = place.place_px.to_array();
            let expected = "a column and a row in each place_px";
            return Err(RecipeError { key: "place", found: format!("{x}, {y}"), expected });
        }
        let refused: usize = self.refused.iter().map(|refused| refused.frames.len()).sum();
        if self.places.len() > MOST || refused > MOST {
            let found = format!("{} places, {refused} refused frames", self.places.len());
            return Err(RecipeError { key: "refused", found, expected: "at most 100000 of each" });
        }
        Ok(())
    }

    /// Sets the options that it chooses; `options` are the station's usual ones.
    pub fn apply(&self, options: &mut ReduceOptions) {
        options.target.clone_from(&self.target);
        options.visit = self.visit;
        let most_q = (!self.no_gate).then_some(self.gate.unwrap_or(1.0));
        options.counts.bins.gate = gate(most_q, !self.no_coupling);
        if let Some(frames) = &mut options.frames {
            self.apply_to_frames(frames);
        }
    }

    /// Sets the options of the frames alone.
    pub fn apply_to_frames(&self, options: &mut FrameOptions) {
        options.fwhm_from_frames = self.fwhm_px.is_none();
        options.aperture_from_frames = self.aperture_px.is_none() && self.annulus_px.is_none();
        if let Some(radius_px) = self.aperture_px {
            options.set_aperture(radius_px);
        }
        let photometry = &mut options.photometry;
        photometry.annulus_px = self.annulus_px.unwrap_or(photometry.annulus_px);
        photometry.fwhm_px = self.fwhm_px.unwrap_or(photometry.fwhm_px);
        photometry.trail = if self.trailed { Trail::Estimated } else { Trail::Point };
        let detection = &mut photometry.detection;
        detection.threshold_sigma = self.detect_sigma.unwrap_or(detection.threshold_sigma);
        detection.area_px = self.area_px.unwrap_or(detection.area_px);
        detection.min_fill = self.min_fill.unwrap_or(detection.min_fill);
        detection.max_aspect = self.max_aspect.unwrap_or(detection.max_aspect);
        detection.max_offset_px = self.max_offset_px.unwrap_or(f64::INFINITY);
        detection.choice = if self.brightest { Choice::Brightest } else { Choice::Nearest };
        options.places.clone_from(&self.places);
        options.refused.clone_from(&self.refused);
    }

    /// Text of its file: TOML.
    pub fn toml(&self) -> String {
        let mut text = String::from(
            "# A reduction of this session, chosen by hand: `sunglint reduce SESSION --recipe NAME -o OUT/` repeats it.\n",
        );
        let mut line = |key: &str, value: Option<String>| {
            if let Some(value) = value {
                let _ = writeln!(text, "{key} = {value}");
            }
        };
        let number = |value: Option<f64>| value.map(|value| format!("{value:?}"));
        let pair = |value: Option<Interval>| {
            value.map(|Interval { low: a, high: b }| format!("[{a:?}, {b:?}]"))
        };
        let yes = |value: bool| value.then(|| "true".to_owned());
        line("target", self.target.as_deref().map(quoted));
        line("visit", self.visit.map(|number| number.to_string()));
        line("aperture_px", number(self.aperture_px));
        line("annulus_px", pair(self.annulus_px));
        line("fwhm_px", number(self.fwhm_px));
        line("detect_sigma", number(self.detect_sigma));
        line("area_px", self.area_px.map(|[a, b]| format!("[{a}, {b}]")));
        line("min_fill", number(self.min_fill));
        line("max_aspect", number(self.max_aspect));
        line("max_offset_px", number(self.max_offset_px));
        line("brightest", yes(self.brightest));
        line("trailed", yes(self.trailed));
        line("gate", number(self.gate));
        line("no_gate", yes(self.no_gate));
        line("no_coupling", yes(self.no_coupling));
        for PointedPlace { camera, frame, place_px: DVec2 { x, y } } in &self.places {
            let camera = quoted(camera);
            let _ = write!(
                text,
                "\n[[place]]\ncamera = {camera}\nframe = {frame}\nplace_px = [{x:?}, {y:?}]\n"
            );
        }
        for RefusedFrames { camera, frames } in &self.refused {
            let _ =
                write!(text, "\n[[refused]]\ncamera = {}\nframes = {frames:?}\n", quoted(camera));
        }
        text
    }

    /// A sentence for the provenance of what it made; `None` where nothing was chosen for the frames.
    pub(super) fn note(frames: &FrameOptions) -> Option<String> {
        let refused: usize = frames.refused.iter().map(|refused| refused.frames.len()).sum();
        let mut parts = Vec::new();
        if !frames.places.is_empty() {
            parts.push(format!("target followed from {} places", frames.places.len()));
        }
        if refused > 0 {
            parts.push(format!("{refused} frames refused (flag gap)"));
        }
        (!parts.is_empty()).then(|| format!("by hand: {}", parts.join(", ")))
    }
}

/// A text as TOML writes it.
pub(crate) fn quoted(text: &str) -> String {
    let mut quoted = String::from("\"");
    for c in text.chars() {
        match c {
            '"' => quoted.push_str("\\\""),
            '\\' => quoted.push_str("\\\\"),
            c if c.is_control() => {
                let _ = write!(quoted, "\\u{:04X}", u32::from(c));
            }
            c => quoted.push(c),
        }
    }
    quoted.push('"');
    quoted
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Truth: what was written is read again, whatever is in a name; a file as a person writes it; each mistake is named with its line.
    #[test]
    fn a_recipe_is_read_as_it_was_written() {
        let folder = std::env::temp_dir().join(format!("sunglint-recipe-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let path = folder.join("recipe.toml");
        let place = |frame, place_px| PointedPlace { camera: "cam".into(), frame, place_px };
        let recipe = Recipe {
            target: Some("a \"b\" \\ \u{1b}\u{7f}é".into()),
            visit: Some(2),
            aperture_px: Some(6.0),
            annulus_px: Some([9.0, 15.1].into()),
            area_px: Some([3, 900]),
            min_fill: Some(0.1 + 0.2),
            brightest: true,
            gate: Some(1.5),
            places: vec![place(7, DVec2::new(10.25, 3.0)), place(9, DVec2::new(1.0 / 3.0, 1e-7))],
            refused: vec![RefusedFrames { camera: "cam".into(), frames: vec![3, 4, 5] }],
            ..Recipe::default()
        };
        std::fs::write(&path, recipe.toml()).unwrap();
        assert_eq!(Recipe::read(&path).unwrap(), recipe);
        std::fs::write(&path, Recipe::default().toml()).unwrap();
        assert_eq!(Recipe::read(&path).unwrap(), Recipe::default());
        let by_hand = "aperture_px = 5\ndetect_sigma = 4\n[[place]]\ncamera = \"c\"\nframe = 1\nplace_px = [2, 3]\n";
        std::fs::write(&path, by_hand).unwrap();
        let read = Recipe::read(&path).unwrap();
        assert_eq!((read.aperture_px, read.detect_sigma), (Some(5.0), Some(4.0)));
        assert_eq!(read.places[0].place_px, DVec2::new(2.0, 3.0));
        for (text, line, key) in [
            ("aperture_px = 0\n", ":1", "aperture_px"),
            ("gate = 1\naperture_px = nan\n", ":2", "aperture_px"),
            ("aperture_px = 8\nannulus_px = [7, 12]\n", ":2", "annulus_px"),
            // Beside the usual aperture of 8 px.
            ("annulus_px = [7, 12]\n", ":1", "annulus_px"),
            ("detect_sigma = 0\n", ":1", "detect_sigma"),
            ("area_px = [9, 3]\n", ":1", "area_px"),
            ("visit = 1\n", ":1", "visit"),
            ("apertur_px = 8\n", ":1", "apertur_px"),
            ("[[refused]]\ncamera = \"c\"\nframes = [-1]\n", ":3", "frames"),
        ] {
            std::fs::write(&path, text).unwrap();
            let error = Recipe::read(&path).unwrap_err().to_string();
            assert!(error.contains(line) && error.contains(key), "{text}: {error}");
        }
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
