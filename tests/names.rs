//! Ten thousand names of others, of any characters, in figures, pages and on a terminal.

#![allow(clippy::unwrap_used, reason = "in helpers too, a failure should stop the run")]

use crate::common::Folder;
use std::collections::BTreeSet;
use sunglint_formats::text::{file_name, plain, printable};
use sunglint_report::page::{Grid, Page, Section};
use sunglint_report::plot::{Axis, Figure, Panel, Series};
use sunglint_testkit::{peer_python, run_python};

const COUNT: usize = 10_000;

/// Names of 1 to 24 characters: any of Unicode, those that do something, pieces of markup and of escape sequences.
fn names() -> Vec<String> {
    let mut state = 20_u64;
    let mut next = |below: u32| {
        // SplitMix64.
        state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = state;
        z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ z >> 31) % u64::from(below)) as u32
    };
    const PIECES: [&str; 16] = [
        "\u{1b}[31m",
        "\u{1b}]0;x\u{7}",
        "\u{9b}2J",
        "</text>",
        "</td>",
        "<!--",
        "]]>",
        "&amp;",
        "&#27;",
        "\"'",
        "\r\n",
        "../",
        "<script>",
        "\u{202e}",
        "\u{feff}",
        "%s",
    ];
    (0..COUNT)
        .map(|_| {
            let mut name = String::new();
            for _ in 0..=next(23) {
                match next(6) {
                    0 => name.push_str(PIECES[next(16) as usize]),
                    1 => name.extend(char::from_u32(next(0xa0))),
                    2 => name.extend(char::from_u32(0x2000 + next(0x70))),
                    3 => name.extend(char::from_u32(0xfd00 + next(0x300))),
                    _ => name.extend(char::from_u32(next(0x11_0000))),
                }
            }
            name
        })
        .collect()
}

/// Truth: no control of Unicode's category Cc is left, nor what turns the direction of a text; a file's name stays within its folder.
#[test]
fn names_on_a_terminal_and_on_the_disk() {
    let turns = |c: char| matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    let mut made = BTreeSet::new();
    let folder = Folder::new("names");
    for name in names() {
        let shown = plain(&name);
        assert!(!shown.contains(|c: char| c.is_control() || turns(c)), "{name:?}: {shown:?}");
        let text = printable(&name);
        assert!(
            !text.bytes().any(|b| (b < 0x20 && b != b'\n' && b != b'\t') || b == 0x7f),
            "{name:?}"
        );
        assert!(!text.contains(|c: char| matches!(c, '\u{80}'..='\u{9f}') || turns(c)), "{name:?}");
        let own = file_name(&name).into_owned();
        if made.len() < 1000 && made.insert(own.clone()) {
            std::fs::write(folder.0.join(&own), "").unwrap();
        }
    }
    // Each is one file of that folder and of no other.
    let there = std::fs::read_dir(&folder.0).unwrap().map(|f| f.unwrap().file_name());
    let there: BTreeSet<String> = there.map(|name| name.into_string().unwrap()).collect();
    assert_eq!(there, made);
}

/// Truth: Python's expat reads every SVG, and Python's HTML parser finds the page's own elements and no others: as many cells as there are names.
#[test]
fn names_in_figures_and_pages() {
    let Some(python) =
        peer_python("names_in_figures_and_pages", &["xml.etree.ElementTree", "html.parser"])
    else {
        return;
    };
    let folder = Folder::new("names-drawn");
    let names = names();
    let axis = |label: &str| Axis { label: label.into(), range: None, log: false, inverted: false };
    for (i, group) in names.chunks(18).enumerate() {
        let series = group.iter().skip(2).enumerate();
        let series = series
            .map(|(k, name)| Series::line(name.as_str(), k, vec![(0.0, 1.0), (1.0, k as f64)]));
        let label = group.get(1).map_or("", String::as_str);
        let panel = Panel::new(axis(label), axis("rate in Hz"), series.collect());
        let svg = Figure { title: group[0].clone(), panels: vec![panel] }.svg().unwrap();
        std::fs::write(folder.0.join(format!("{i}.svg")), svg).unwrap();
    }
    let page = Page {
        title: names[0].clone(),
        subtitle: names[1].clone(),
        program: names[2].clone(),
        sections: vec![Section {
            title: names[3].clone(),
            text: vec![names[4].clone()],
            grid: Grid {
                head: vec![names[5].clone()],
                rows: names.iter().map(|name| vec![name.clone()]).collect(),
                words: 1,
            },
        }],
        ..Page::default()
    };
    std::fs::write(folder.0.join("page.html"), page.html()).unwrap();
    let script = r#"
import sys, os, glob, html.parser, unicodedata
import xml.etree.ElementTree as ET
folder = sys.argv[1]
svgs = sorted(glob.glob(os.path.join(folder, "*.svg")))
for path in svgs:
    root = ET.parse(path).getroot()
    tags = {e.tag.split("}")[-1] for e in root.iter()}
    assert tags <= {"svg", "g", "rect", "text", "polyline", "polygon", "line", "path", "circle", "defs", "clipPath"}, (path, tags)
class Reader(html.parser.HTMLParser):
    def __init__(self):
        super().__init__(); self.tags = {}; self.text = []
    def handle_starttag(self, tag, attributes):
        self.tags[tag] = self.tags.get(tag, 0) + 1
    def handle_data(self, data):
        self.text.append(data)
text = open(os.path.join(folder, "page.html"), encoding="utf-8", newline="").read()
reader = Reader(); reader.feed(text); reader.close()
bad = [c for c in text if unicodedata.category(c) == "Cc" and c not in "\n\t"]
bad += [c for c in text if c in "\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069"]
print(len(svgs), reader.tags.get("td", 0) + reader.tags.get("th", 0), reader.tags.get("script", 0), len(bad))
"#;
    let said = run_python(&python, script, &[folder.0.to_str().unwrap()]);
    let scripts = page_scripts();
    assert_eq!(
        said.trim(),
        format!("{} {} {scripts} 0", names.len().div_ceil(18), names.len() + 1)
    );
}

/// Scripts of a page without any name.
fn page_scripts() -> usize {
    Page::default().html().matches("<script").count()
}
