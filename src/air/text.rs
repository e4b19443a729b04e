//! What `sunglint air` says to a person.

use super::grid::Grid;
use super::{AirArgs, Answer, ChannelAir, Row, constituents, magnitudes};
use std::fmt::Write as _;
use sunglint_radiometry::air::{Aerosol, Air};
use sunglint_radiometry::station::Station;

/// What the text shows where no wavelengths are asked for.
const USUAL_NM: [f64; 9] = [320.0, 400.0, 500.0, 550.0, 650.0, 762.0, 850.0, 940.0, 1064.0];
/// So many wavelengths stand beside one another.
const MOST_SHOWN: usize = 12;

/// The wavelengths that the text shows, and the air at them, one row an angle.
pub(super) struct Shown {
    pub(super) heading: String,
    pub(super) nm: Vec<f64>,
    pub(super) rows: Vec<Row>,
}

impl Shown {
    /// Some of what was computed where wavelengths were asked for, else the usual ones.
    pub(super) fn of(args: &AirArgs, air: &Air, grid: &Grid, rows: &[Row]) -> anyhow::Result<Self> {
        if args.asks_for_wavelengths() {
            let picked = grid.some(MOST_SHOWN);
            let of = if picked.len() < grid.nm.len() {
                format!("; {} of the {} wavelengths (-o FILE has all)", picked.len(), grid.nm.len())
            } else {
                String::new()
            };
            let rows = rows.iter().map(|row| row.at(&picked)).collect();
            let nm = picked.iter().map(|i| grid.nm[*i]).collect();
            return Ok(Self { heading: grid.kind() + &of, nm, rows });
        }
        let usual = Grid { nm: USUAL_NM.to_vec(), mean_nm: grid.mean_nm };
        let rows = args.rows(air, &usual.sampling()?, None)?;
        let heading = format!("{}; some wavelengths (-o FILE has all)", usual.kind());
        Ok(Self { heading, nm: usual.nm, rows })
    }
}

impl AirArgs {
    pub(super) fn text(&self, answer: &Answer) -> anyhow::Result<String> {
        let Answer { title, air, grid, rows, station } = *answer;
        let shown = Shown::of(self, air, grid, rows)?;
        let mut text = format!("{title}\n");
        if matches!(air.options().aerosol, Aerosol::None) {
            text.push_str("clean air (no aerosol): real extinction is larger (--aerosol)\n");
        }
        text.push_str(
            "\n  zenith angle       refraction  air mass\n  true      apparent     arcsec  Rayleigh     ozone     water\n",
        );
        for row in rows {
            let masses = air.air_masses(&row.path);
            let _ = writeln!(
                text,
                "{:8.4}{:12.4}{:11.1}{:10.4}{:10.4}{:10.4}",
                row.path.true_deg,
                row.path.apparent_deg,
                row.path.refraction_arcsec(),
                masses.rayleigh,
                masses.ozone,
                masses.water
            );
        }
        let _ = writeln!(text, "\ntransmission ({}), vacuum wavelength in nm", shown.heading);
        let nm: Vec<String> =
            shown.nm.iter().map(|nm| format!("{}", (nm * 1e4).round() / 1e4)).collect();
        heading(&mut text, &nm);
        for row in &shown.rows {
            line(&mut text, &self.label(&row.path), &row.total, 4);
            for (name, values) in row.components.iter().flat_map(constituents) {
                line(&mut text, &format!("  {}", name.replace('_', " ")), values, 4);
            }
        }
        text.push_str("\nextinction of the total, magnitudes\n");
        heading(&mut text, &nm);
        for row in &shown.rows {
            let magnitudes: Vec<f64> = row.total.iter().map(|t| magnitudes(*t)).collect();
            line(&mut text, &self.label(&row.path), &magnitudes, 3);
        }
        if let (Some(station), true) = (station, rows.iter().any(|row| !row.channels.is_empty())) {
            self.channels_text(&mut text, station, rows);
        }
        let oxygen = if grid.touches(560.0, 640.0) || grid.touches(1040.0, 1090.0) {
            "O2-O2 absorption near 577, 630 and 1064 nm (1064 nm too high by 0.015 at the zenith), "
        } else {
            ""
        };
        let _ = writeln!(
            text,
            "\nnot in the model: {oxygen}scattered light, lines narrower than 20 cm-1.\n`-o FILE` writes the spectra (.ecsv, .csv, .fits, .json) or draws them (.png, .svg)."
        );
        Ok(text)
    }

    fn channels_text(&self, text: &mut String, station: &Station, rows: &[Row]) {
        let names: Vec<String> = station.channels.iter().map(|c| c.name.clone()).collect();
        let _ = writeln!(
            text,
            "\nthrough the channels of {}, for light flat in photons per nm: transmission",
            station.name
        );
        heading(text, &names);
        let values = |row: &Row, get: fn(&ChannelAir) -> f64| -> Vec<f64> {
            row.channels.iter().map(get).collect()
        };
        for row in rows {
            line(text, &self.label(&row.path), &values(row, |c| c.transmission), 4);
        }
        text.push_str("and extinction, magnitudes\n");
        heading(text, &names);
        for row in rows {
            line(text, &self.label(&row.path), &values(row, |c| magnitudes(c.transmission)), 3);
        }
        let uncovered = rows.first().into_iter().flat_map(|row| &row.channels);
        for channel in uncovered.filter(|c| c.uncovered_nm > 0.0) {
            let _ = writeln!(
                text,
                "  {}: {:.0} nm of it are outside the tables of the air and count as dark",
                channel.name, channel.uncovered_nm
            );
        }
    }
}

fn heading(text: &mut String, names: &[String]) {
    let _ = write!(text, "  {:<20}", "zenith angle");
    for name in names {
        let _ = write!(text, "{name:>10}");
    }
    text.push('\n');
}

fn line(text: &mut String, label: &str, values: &[f64], digits: usize) {
    let _ = write!(text, "  {label:<20}");
    for value in values {
        let _ = write!(text, "{value:>10.digits$}");
    }
    text.push('\n');
}
