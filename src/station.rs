//! Which station a command is about: `--station`, else `$SUNGLINT_STATION`, else `./station.toml`.

use crate::output::Console;
use anyhow::{Context as _, anyhow, bail};
use clap::Args;
use std::path::Path;
use sunglint_formats::nearest_names;
use sunglint_formats::session::Session;
use sunglint_radiometry::light_curve::{Input, Provenance};
use sunglint_radiometry::station::{RecordedError, Station};

/// Variable of the environment that names the station.
pub const VARIABLE: &str = "SUNGLINT_STATION";
/// File of the station in the folder where the program runs.
const HERE: &str = "station.toml";

/// Which station.
#[derive(Debug, Clone, Default, Args)]
pub struct StationArgs {
    /// The station: a built-in name (`ufo`, `gauss6`), a station.toml, or its folder [default: $SUNGLINT_STATION, else ./station.toml]
    #[arg(long, value_name = "NAME|FILE|FOLDER")]
    pub station: Option<String>,
}

impl StationArgs {
    /// The station that was asked for, or the one that the surroundings name; `None` where neither does.
    pub fn find(&self) -> anyhow::Result<Option<Station>> {
        if let Some(name) = &self.station {
            return named(name).map(Some);
        }
        let Some(name) = Self::around() else { return Ok(None) };
        let station = named(&name);
        (if name == HERE { station } else { station.context("from $SUNGLINT_STATION") }).map(Some)
    }

    /// Name of the station that the surroundings say: that of the environment, else the file in this folder.
    pub fn around() -> Option<String> {
        let told = std::env::var(VARIABLE).ok().filter(|name| !name.is_empty());
        told.or_else(|| Path::new(HERE).is_file().then(|| HERE.to_owned()))
    }

    /// The station that took a light curve: the one that was asked for, else the one that the curve's own header names, else that of the surroundings. Says which it is where nobody asked for one.
    ///
    /// # Errors
    /// No station, or one that cannot be read; a header that names one that is neither built in nor found.
    pub fn of_curve(&self, header: &Provenance, console: Console) -> anyhow::Result<Station> {
        if self.station.is_some() || header.station.is_empty() {
            return self.get();
        }
        let name = header.station.as_str();
        let around = self.find()?;
        let station = if let Some(station) = recorded(header) {
            station
        } else if let Some(around) = around.as_ref().filter(|around| around.name == name) {
            around.clone()
        } else if Station::built_in_names().contains(&name) {
            named(name)?
        } else if let Some(around) = around {
            console.warn(&format!(
                "the curve's header names the station {name}, which is not built in; {} is taken in its place, from $SUNGLINT_STATION or ./station.toml (--station says which)",
                around.name
            ));
            return Ok(around);
        } else {
            bail!(
                "the curve's header names the station {name}, which is not built in ({}): give its file with --station",
                Station::built_in_names().join(", ")
            )
        };
        console
            .say(&format!("station {name}, as the curve's header says (--station takes another)"));
        Ok(station)
    }

    /// The station; an error that lists the names where there is none.
    pub fn get(&self) -> anyhow::Result<Station> {
        self.get_or("")
    }

    /// The same, with what else would do.
    pub fn get_or(&self, else_give: &str) -> anyhow::Result<Station> {
        self.find()?.with_context(|| {
            format!(
                "no station: give --station with a built-in name ({}), a station.toml or its folder, set SUNGLINT_STATION, or put a station.toml here {else_give}",
                Station::built_in_names().join(", ")
            )
            .trim_end()
            .to_owned()
        })
    }
}

/// The station of a curve by the file that its header names, where that is still what it was.
fn recorded(header: &Provenance) -> Option<Station> {
    let is_station =
        |input: &&Input| Path::new(&input.file).extension().is_some_and(|e| e == "toml");
    header.inputs.iter().filter(is_station).find_map(|input| {
        let bytes = sunglint_formats::read::bytes(&input.file).ok()?;
        let same = sunglint_formats::sha256(&bytes) == input.sha256;
        Station::read(&input.file).ok().filter(|station| same && station.name == header.station)
    })
}

fn named(name: &str) -> anyhow::Result<Station> {
    if let Some(station) = Station::built_in(name) {
        return Ok(station?);
    }
    let path = Path::new(name);
    if path.exists() {
        return Ok(Station::read(path)?);
    }
    let names = Station::built_in_names();
    let near = nearest_names(name, names.iter().copied(), 1);
    let hint = near.first().map_or(String::new(), |near| format!("; did you mean {near}?"));
    bail!(
        "there is no station `{name}`: it is neither a built-in name ({}) nor a file or folder{hint}",
        names.join(", ")
    )
}

/// The station that a session was recorded with, with what to do where it is not known.
pub fn of_session(session: &Session) -> anyhow::Result<Station> {
    Station::of_session(session).map_err(with_hint)
}

/// The error with the option that may help.
pub fn with_hint(error: RecordedError) -> anyhow::Error {
    match error {
        RecordedError::Unknown { .. } => anyhow!("{error}: give --station"),
        error => error.into(),
    }
}
