//! Photometry in XML: tracking data messages and VOTables.

use super::{Message, Photometry, shortened};
use crate::{Column, ParseError, Table, Values};
use roxmltree::{Document, Node, ParsingOptions};
use std::path::Path;

/// Nodes of a document at most: a hundred million would fill most memories.
const MOST_NODES: u32 = 50_000_000;

/// First kilobyte without the declaration.
fn head(text: &str) -> &str {
    let end = text.char_indices().nth(4096).map_or(text.len(), |(at, _)| at);
    text[..end].trim_start_matches('\u{feff}').trim_start()
}

/// Returns true for a tracking data message in XML, alone or in an NDM.
pub(super) fn is_tdm(text: &str) -> bool {
    let head = head(text);
    head.starts_with('<') && (head.contains("<tdm") || head.contains(":tdm"))
}

/// Returns true for a VOTable.
pub(super) fn is_votable(text: &str) -> bool {
    let head = head(text);
    head.starts_with('<') && (head.contains("<VOTABLE") || head.contains(":VOTABLE"))
}

fn parsed<'a>(path: &Path, text: &'a str) -> Result<Document<'a>, ParseError> {
    // A DTD may define entities that grow without end; VOTables of old name one and do not need it.
    let options =
        ParsingOptions { allow_dtd: false, nodes_limit: MOST_NODES, ..ParsingOptions::default() };
    Document::parse_with_options(text, options).map_err(|error| {
        let line = u64::from(error.pos().row);
        ParseError::new(path, error.to_string(), "well-formed XML without a DTD").at_line(line)
    })
}

fn line(node: Node<'_, '_>) -> u64 {
    u64::from(node.document().text_pos_at(node.range().start).row)
}

fn text_of<'a>(node: Node<'a, '_>) -> &'a str {
    node.text().unwrap_or_default().trim()
}

/// Magnitudes of a tracking data message (CCSDS 503.0-B-2, section 4).
pub(super) fn tdm(path: &Path, text: &str) -> Result<Photometry, ParseError> {
    let document = parsed(path, text)?;
    let named = |name: &'static str| move |n: &Node<'_, '_>| n.tag_name().name() == name;
    let mut message = Message::default();
    for segment in document.descendants().filter(named("segment")) {
        message.meta.clear();
        for block in segment.children().filter(named("metadata")) {
            for entry in block.children().filter(Node::is_element) {
                message.meta.insert(entry.tag_name().name().to_owned(), text_of(entry).to_owned());
            }
        }
        let data = segment.children().filter(named("data"));
        for observation in data.flat_map(|d| d.children().filter(named("observation"))) {
            let mut epoch = "";
            for entry in observation.children().filter(Node::is_element) {
                let key = entry.tag_name().name();
                if key == "EPOCH" {
                    epoch = text_of(entry);
                    continue;
                }
                message.datum(key, epoch, text_of(entry)).map_err(|(found, expected)| {
                    ParseError::new(path, found, expected).at_line(line(entry))
                })?;
            }
        }
    }
    Ok(message.finish())
}

/// The first table of a VOTable (1.1 to 1.5) whose data stand as TABLEDATA. Its TIMESYS, where there is one, becomes the metadata `timesys`.
pub(super) fn votable(path: &Path, text: &str) -> Result<Table, ParseError> {
    let document = parsed(path, text)?;
    let named = |name: &'static str| move |n: &Node<'_, '_>| n.tag_name().name() == name;
    let Some(table) = document.descendants().find(named("TABLE")) else {
        return Err(ParseError::new(path, "no TABLE", "a VOTable with a table"));
    };
    let fields: Vec<Node<'_, '_>> = table.children().filter(named("FIELD")).collect();
    if fields.is_empty() {
        return Err(ParseError::new(path, "no FIELD", "names of columns").at_line(line(table)));
    }
    let Some(data) = table.children().find(named("DATA")) else {
        return Err(ParseError::new(path, "no DATA", "rows").at_line(line(table)));
    };
    let Some(rows) = data.children().find(named("TABLEDATA")) else {
        let kind =
            data.children().find(Node::is_element).map_or("nothing", |n| n.tag_name().name());
        let error = ParseError::new(path, format!("data as {kind}"), "data as TABLEDATA");
        return Err(error.at_line(line(data)).with_hint(
            "write it again with tabledata_format=\"tabledata\" (astropy), or as ECSV or FITS",
        ));
    };
    let mut columns: Vec<Vec<Option<String>>> = vec![Vec::new(); fields.len()];
    for row in rows.children().filter(named("TR")) {
        let cells: Vec<Node<'_, '_>> = row.children().filter(named("TD")).collect();
        if cells.len() != fields.len() {
            let found = format!("{} cells", cells.len());
            let expected = format!("{}, as many as fields", fields.len());
            return Err(ParseError::new(path, found, expected).at_line(line(row)));
        }
        for (column, cell) in columns.iter_mut().zip(cells) {
            let text = text_of(cell);
            column.push((!text.is_empty()).then(|| text.to_owned()));
        }
    }
    let mut made = Vec::new();
    for (field, texts) in fields.iter().zip(columns) {
        let name = field.attribute("name").or(field.attribute("ID")).unwrap_or_default();
        let null = field.children().find(named("VALUES")).and_then(|v| v.attribute("null"));
        let kind = field.attribute("datatype").unwrap_or_default();
        let is_text =
            matches!(kind, "char" | "unicodeChar") || field.attribute("arraysize").is_some();
        let values = if is_text {
            Values::Text(texts)
        } else {
            let mut numbers = Vec::with_capacity(texts.len());
            for (i, text) in texts.iter().enumerate() {
                let number = match text.as_deref().filter(|t| Some(*t) != null) {
                    None => f64::NAN,
                    Some(text) => text.parse().map_err(|_| {
                        ParseError::new(path, format!("`{}`", shortened(text)), "a number")
                            .in_field(format!("{name}, row {}", i + 1))
                    })?,
                };
                numbers.push(number);
            }
            Values::F64(numbers)
        };
        made.push(Column {
            name: name.to_owned(),
            unit: field.attribute("unit").map(str::to_owned),
            description: None,
            values,
        });
    }
    let mut read = Table { columns: made, ..Table::default() };
    if let Some(system) = document.descendants().find(named("TIMESYS")) {
        let mut note = |key: &str, attribute: &str| {
            if let Some(value) = system.attribute(attribute) {
                read.meta.insert(key.into(), value.into());
            }
        };
        note("timesys", "timescale");
        note("timeorigin", "timeorigin");
        note("refposition", "refposition");
    }
    Ok(read)
}
