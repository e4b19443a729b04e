//! Weather by a file, as weather stations and roof controllers write it: whether the sky is fit for an open telescope.
//!
//! Two forms are read. The one line of the Boltwood Cloud Sensor II ("one-line data file", its users' manual of 2005), which other
//! makers' programs write as well, ends with the conditions of cloud, wind, rain and daylight, whether the roof should close,
//! and an alert. Any other file says it in its first word: `safe`, `open`, `ok`, `1`, `true`, or `unsafe`, `close`, `closed`, `0`, `false`.
//! A file that is old, cannot be read, or says anything else is bad weather.

use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

/// Fields of the one line, date and time among them.
const FIELDS: usize = 21;

/// A file that tells the weather.
#[derive(Debug, Clone)]
pub struct WeatherFile {
    path: PathBuf,
    most_age: Duration,
}

/// State of the weather.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Weather {
    /// Fit.
    Fit,
    /// Not fit, or not known, and why.
    Unfit(String),
}

impl WeatherFile {
    /// A file that is written anew at least every so often.
    pub fn new(path: impl AsRef<Path>, most_age: Duration) -> Self {
        Self { path: path.as_ref().to_path_buf(), most_age }
    }

    /// Looks at the file.
    pub fn look(&self, now: SystemTime) -> Weather {
        let name = self.path.display();
        let written = std::fs::metadata(&self.path).and_then(|about| about.modified());
        let written = match written {
            Ok(written) => written,
            Err(error) => return Weather::Unfit(format!("{name} cannot be read: {error}")),
        };
        // A file of the future is of a clock that is wrong: which of the two is not known.
        let age = now.duration_since(written).or_else(|_| written.duration_since(now));
        let age = age.unwrap_or(Duration::MAX);
        if age > self.most_age {
            return Weather::Unfit(format!(
                "{name} was written {:.0} s ago, and at most {:.0} s count",
                age.as_secs_f64(),
                self.most_age.as_secs_f64()
            ));
        }
        match sunglint_formats::read::text(&self.path) {
            Ok(text) => match unfit(&text) {
                None => Weather::Fit,
                Some(why) => Weather::Unfit(format!("{name}: {why}")),
            },
            Err(error) => Weather::Unfit(error.to_string()),
        }
    }
}

/// Why the weather that a text tells is not fit; `None` where it is.
fn unfit(text: &str) -> Option<String> {
    let line = text.lines().map(str::trim).find(|line| !line.is_empty()).unwrap_or_default();
    let words: Vec<&str> = line.split_whitespace().collect();
    if words.len() == FIELDS {
        return boltwood(&words);
    }
    let first = words.first().map(|word| word.trim_matches([',', ';', '"']).to_lowercase());
    match first.as_deref() {
        Some("safe" | "open" | "ok" | "1" | "true") => None,
        Some("unsafe" | "close" | "closed" | "0" | "false") => Some("it says unsafe".into()),
        _ => {
            let shown: String = line.chars().take(40).flat_map(char::escape_debug).collect();
            Some(format!("`{shown}` says neither safe nor unsafe"))
        }
    }
}

/// The one line: its last six fields are conditions.
fn boltwood(words: &[&str]) -> Option<String> {
    let [cloud, wind, rain, _daylight, close, alert] = &words[FIELDS - 6..] else {
        return Some("a line that is cut".into());
    };
    // 0 is unknown, 1 the best; the worst of each is 3 (2 for the last two, where 1 is bad).
    let condition = |word: &str, what: [&str; 4]| match word {
        "1" | "2" => None,
        "0" => Some(format!("{} unknown", what[0])),
        "3" => Some(what[3].to_owned()),
        other => Some(format!("{} is `{other}`", what[0])),
    };
    let found = [
        condition(cloud, ["the clouds", "clear", "cloudy", "very cloudy"]),
        condition(wind, ["the wind", "calm", "windy", "very windy"]),
        // Wet is as bad as rain.
        condition(if *rain == "2" { "3" } else { rain }, ["rain", "dry", "wet", "rain, or wet"]),
        (*close != "0").then(|| "the roof should close".to_owned()),
        (*alert != "0").then(|| "an alert".to_owned()),
    ];
    found.into_iter().flatten().next()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

    use super::*;

    /// The example of the manual (clear, calm, dry, dark), and what others say.
    #[test]
    fn the_line_of_a_cloud_sensor() {
        let line = "2005-06-03 02:07:23.34 C K  -28.5   18.7   22.5   45.3  75   10.3   3 0 0 00004 038506.08846 1 1 1 1 0 0";
        assert_eq!(line.split_whitespace().count(), FIELDS);
        assert_eq!(unfit(line), None);
        let with = |end: &str| unfit(&line.replace("1 1 1 1 0 0", end)).unwrap_or_default();
        for (end, expected) in [
            ("2 2 1 3 0 0", ""),
            ("3 1 1 1 0 0", "very cloudy"),
            ("0 1 1 1 0 0", "the clouds unknown"),
            ("1 3 1 1 0 0", "very windy"),
            ("1 1 2 1 0 0", "rain, or wet"),
            ("1 1 3 1 0 0", "rain, or wet"),
            ("1 1 1 1 1 0", "the roof should close"),
            ("1 1 1 1 0 1", "an alert"),
            ("1 1 1 1 0 x", "an alert"),
            ("7 1 1 1 0 0", "the clouds is `7`"),
        ] {
            assert_eq!(with(end), expected, "{end}");
        }
        for (text, fit) in [
            ("safe\n", true),
            ("OPEN since 20:15", true),
            ("unsafe", false),
            ("0", false),
            ("", false),
            ("2005-06-03 02:07:23.34 C K", false),
            ("perhaps", false),
        ] {
            assert_eq!(unfit(text).is_none(), fit, "{text}");
        }
    }

    #[test]
    fn an_old_file_is_bad_weather() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("weather.txt");
        let file = WeatherFile::new(&path, Duration::from_secs(300));
        let now = SystemTime::now();
        let why = |now| match file.look(now) {
            Weather::Fit => String::new(),
            Weather::Unfit(why) => why,
        };
        assert!(why(now).contains("cannot be read"), "{}", why(now));
        std::fs::write(&path, "safe\n").unwrap();
        let now = SystemTime::now();
        assert_eq!(file.look(now), Weather::Fit);
        assert_eq!(file.look(now + Duration::from_secs(200)), Weather::Fit);
        assert!(why(now + Duration::from_secs(400)).contains("was written 400 s ago"));
        // Of a clock that is wrong.
        assert!(why(now - Duration::from_secs(4000)).contains("at most 300 s count"));
        std::fs::write(&path, "unsafe\n").unwrap();
        assert!(why(SystemTime::now()).contains("it says unsafe"));
        std::fs::write(&path, [0xff, 0xfe]).unwrap();
        assert!(why(SystemTime::now()).contains("expected text in UTF-8"));
    }
}
