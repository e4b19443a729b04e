//! A page that a person can mail: one HTML file that asks nothing of any network and reads without a script, too.
//!
//! [`Page`] is what it says; [`Page::html`] writes it. Each chart stands in it twice: as an SVG drawn here, for paper and for browsers
//! without scripts, and as numbers, from which the page's own script draws one that can be zoomed and read. Whatever comes from files is escaped (`escape`), and the
//! page's content security policy lets no other script run than the one that is built in.

mod chart;
mod escape;
mod svg;

pub use chart::{Chart, Group, Kind, Line, Scale};

use crate::json_of;
use crate::plot::base64;
use chart::GroupData;
use escape::{Text, data_block};
use serde::Serialize;
use sha2::{Digest as _, Sha256};
use std::fmt::Write as _;

const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("page.js");

/// A value with an interval: a scale, or what a fit found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Parameter {
    /// Name of the parameter.
    pub name: String,
    /// Value.
    pub value: f64,
    /// Unit; empty of a pure number.
    pub unit: String,
    /// Standard uncertainty, where that is known.
    pub sigma: Option<f64>,
    /// 95 % interval, where that is known.
    pub interval: Option<(f64, f64)>,
}

/// A table with a line of names.
#[derive(Debug, Clone, Default)]
pub struct Grid {
    /// Names of the columns.
    pub head: Vec<String>,
    /// Rows, as long as the head.
    pub rows: Vec<Vec<String>>,
    /// How many columns from the left are words; the others are numbers, set to the right.
    pub words: usize,
}

/// A part of the page.
#[derive(Debug, Clone, Default)]
pub struct Section {
    /// Title.
    pub title: String,
    /// Text before its table.
    pub text: Vec<String>,
    /// Table; without rows there is none.
    pub grid: Grid,
}

/// A channel for the script.
#[derive(Serialize)]
struct ChannelData<'a> {
    name: &'a str,
    hue: usize,
}

/// The numbers of the charts, for the script.
#[derive(Serialize)]
struct Data<'a> {
    channels: Vec<ChannelData<'a>>,
    groups: Vec<GroupData<'a>>,
    pool: Vec<String>,
}

/// Contents of a page.
#[derive(Debug, Clone, Default)]
pub struct Page {
    /// Title of the page.
    pub title: String,
    /// When, from where, of what: in a line.
    pub subtitle: String,
    /// The verdict, in sentences with numbers.
    pub verdict: String,
    /// Most telling numbers: name, value, a remark.
    pub figures: Vec<[String; 3]>,
    /// Parameters that have an interval, under a title with a note.
    pub parameters: (String, String, Vec<Parameter>),
    /// Channels, each with its place in the palette.
    pub channels: Vec<(String, usize)>,
    /// The title of the charts against time.
    pub curves_title: String,
    /// Note on the dots and lines in the curves.
    pub curves_note: String,
    /// Charts against time, a group a track.
    pub groups: Vec<Group>,
    /// Title of the charts against something else; they stand under that of the curves where it is empty.
    pub others_title: String,
    /// Note on these charts.
    pub others_note: String,
    /// These charts.
    pub others: Vec<Chart>,
    /// Sections that follow.
    pub sections: Vec<Section>,
    /// The program and its version.
    pub program: String,
}

impl Page {
    /// The page.
    pub fn html(&self) -> String {
        let hash = base64(&Sha256::digest(SCRIPT.as_bytes()));
        let mut page = format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'; script-src 'sha256-{hash}'; img-src data:\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<meta name=\"color-scheme\" content=\"light dark\">\n\
             <title>{}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<main>\n",
            Text(&self.title)
        );
        self.head(&mut page);
        self.charts(&mut page);
        self.parameters(&mut page);
        for section in &self.sections {
            section.write(&mut page);
        }
        let _ = write!(
            page,
            "<footer><p>Made by {}. This file is whole: it asks nothing of any network.</p></footer>\n</main>\n",
            Text(&self.program)
        );
        let _ = writeln!(
            page,
            "<script type=\"application/json\" id=\"data\">{}</script>\n<script>{SCRIPT}</script>\n</body>\n</html>",
            data_block(&self.data())
        );
        page
    }

    fn head(&self, page: &mut String) {
        let _ = write!(
            page,
            "<header>\n<h1>{}</h1>\n<p class=\"sub\">{}</p>\n<p class=\"verdict\">{}</p>\n<dl class=\"figures\">\n",
            Text(&self.title),
            Text(&self.subtitle),
            Text(&self.verdict)
        );
        for [name, value, remark] in &self.figures {
            let _ = writeln!(
                page,
                "<div><dt>{}</dt><dd>{}<small>{}</small></dd></div>",
                Text(name),
                Text(value),
                Text(remark)
            );
        }
        page.push_str("</dl>\n</header>\n");
    }

    fn charts(&self, page: &mut String) {
        let title = Text(&self.curves_title);
        let _ = writeln!(page, "<section id=\"curves\">\n<h2>{title}</h2>");
        page.push_str("<p class=\"legend\" aria-label=\"Channels\">");
        for (c, (name, hue)) in self.channels.iter().enumerate() {
            let _ = write!(
                page,
                "<label class=\"key h{hue}\"><input type=\"checkbox\" data-channel=\"{c}\" checked disabled><span class=\"swatch\"></span>{}</label>",
                Text(name)
            );
        }
        let _ = write!(
            page,
            "</p>\n<p class=\"how\">{} <span class=\"live\" hidden>Drag to zoom, or turn the wheel over a chart that was clicked; double-click or <kbd>0</kbd> shows all again. Arrow keys move the read-out of a chart in focus, <kbd>+</kbd> and <kbd>−</kbd> zoom.</span></p>\n",
            Text(&self.curves_note)
        );
        for (g, group) in self.groups.iter().enumerate() {
            let _ = writeln!(page, "<div class=\"group\" data-group=\"{g}\">");
            if self.groups.len() > 1 {
                let _ = writeln!(page, "<h3>{}</h3>", Text(&group.title));
            }
            page.push_str("<div class=\"bar live\" hidden><button type=\"button\" class=\"reset\">Show all</button><div class=\"readout\" role=\"status\" aria-live=\"polite\"></div></div>\n");
            for chart in &group.charts {
                chart.write(page, Some(&group.x_label), (group.from, group.to));
            }
            page.push_str("</div>\n");
        }
        page.push_str("</section>\n");
        if !self.others.is_empty() {
            page.push_str("<section class=\"pair\">\n");
            if !self.others_title.is_empty() {
                let (title, note) = (Text(&self.others_title), Text(&self.others_note));
                let _ = writeln!(page, "<h2>{title}</h2>\n<p class=\"how\">{note}</p>");
            }
            page.push_str("<div class=\"two\">\n");
            for chart in &self.others {
                chart.write(page, None, chart.extent());
            }
            page.push_str("</div>\n</section>\n");
        }
    }

    fn parameters(&self, page: &mut String) {
        let (title, note, rows) = &self.parameters;
        if rows.is_empty() {
            return;
        }
        let number = |v: f64| format!("{v:.4}");
        let row = |p: &Parameter| {
            vec![
                p.name.clone(),
                format!("{} {}", number(p.value), p.unit).trim_end().to_owned(),
                p.sigma.map_or("–".into(), number),
                p.interval.map_or("–".into(), |(a, b)| format!("{} to {}", number(a), number(b))),
            ]
        };
        let head = ["", "value", "standard uncertainty", "95 % interval"];
        Section {
            title: title.clone(),
            text: vec![note.clone()],
            grid: Grid {
                head: head.map(str::to_owned).to_vec(),
                rows: rows.iter().map(row).collect(),
                words: 1,
            },
        }
        .write(page);
    }

    /// The numbers of the charts, for the script.
    fn data(&self) -> serde_json::Value {
        let mut pool: Vec<String> = Vec::new();
        let groups = self.groups.iter().map(|group| group.data(&mut pool)).collect();
        let channels = self.channels.iter().map(|(name, hue)| ChannelData { name, hue: *hue });
        json_of(&Data { channels: channels.collect(), groups, pool })
    }
}

impl Section {
    fn write(&self, page: &mut String) {
        let _ = writeln!(page, "<section>\n<h2>{}</h2>", Text(&self.title));
        for text in &self.text {
            let _ = writeln!(page, "<p>{}</p>", Text(text));
        }
        if !self.grid.rows.is_empty() {
            self.grid.write(page);
        }
        page.push_str("</section>\n");
    }
}

impl Grid {
    fn write(&self, page: &mut String) {
        let class = |i: usize| if i < self.words { "w" } else { "n" };
        page.push_str("<div class=\"scroll\" tabindex=\"0\"><table>\n<thead><tr>");
        for (i, name) in self.head.iter().enumerate() {
            let _ = write!(page, "<th scope=\"col\" class=\"{}\">{}</th>", class(i), Text(name));
        }
        page.push_str("</tr></thead>\n<tbody>\n");
        for row in &self.rows {
            page.push_str("<tr>");
            for (i, cell) in row.iter().enumerate() {
                let _ = if i == 0 {
                    write!(page, "<th scope=\"row\" class=\"w\">{}</th>", Text(cell))
                } else {
                    write!(page, "<td class=\"{}\">{}</td>", class(i), Text(cell))
                };
            }
            page.push_str("</tr>\n");
        }
        page.push_str("</tbody></table></div>\n");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hostile() -> Page {
        let bad = "</script><img src=x onerror=alert(1)>\"'&<b>\u{2028}";
        let line = Line::dots(bad, Some(0), vec![0.0, 1.0, 2.0], vec![1.0, 2.0, f64::NAN]);
        let chart = |title: &str| Chart::new("c", title, bad, Scale::Log, vec![line.clone()]);
        Page {
            title: bad.into(),
            subtitle: bad.into(),
            verdict: bad.into(),
            figures: vec![[bad.into(), bad.into(), bad.into()]],
            channels: vec![(bad.into(), 0)],
            curves_title: bad.into(),
            curves_note: bad.into(),
            groups: vec![Group {
                title: bad.into(),
                x_label: bad.into(),
                start_ms: 0.0,
                from: 0.0,
                to: 2.0,
                charts: vec![chart(bad)],
            }],
            others_title: bad.into(),
            others_note: bad.into(),
            others: vec![chart(bad)],
            sections: vec![Section {
                title: bad.into(),
                text: vec![bad.into()],
                grid: Grid {
                    head: vec![bad.into(), bad.into()],
                    rows: vec![vec![bad.into(), bad.into()]],
                    words: 1,
                },
            }],
            parameters: (bad.into(), bad.into(), vec![]),
            program: bad.into(),
        }
    }

    /// Truth: HTML's own rule that a `<` in text, attributes and script elements begins markup: after the page's own markup is taken away none is left, in
    /// whatever place the name of a file stands.
    #[test]
    fn nothing_from_a_file_becomes_markup() {
        let page = hostile().html();
        assert!(!page.contains("<img") && !page.contains("<b>"), "markup from a name");
        assert_eq!(page.matches("</script>").count(), 2);
        assert!(!page.contains("onerror=alert(1)>"));
        // The block of data reads back as what went in.
        let from = page.find("id=\"data\">").unwrap() + "id=\"data\">".len();
        let to = page[from..].find("</script>").unwrap();
        let data: serde_json::Value = serde_json::from_str(&page[from..from + to]).unwrap();
        let name = data["channels"][0]["name"].as_str().unwrap();
        assert!(name.starts_with("</script><img") && name.ends_with('\u{2028}'));
    }

    /// Truth: the policy that the page states, and that it names no address.
    #[test]
    fn the_page_asks_for_nothing() {
        let page = hostile().html();
        for asked in ["http:", "https:", "src=\"", "@import", "url(", "href="] {
            let own = page.replace("http-equiv", "");
            assert!(!own.contains(asked), "{asked}");
        }
        assert!(page.contains("default-src 'none'"));
    }
}
