//! Photometry in XML: tracking data messages and VOTables.

use super::votable_binary::Form;
use super::{Message, Photometry, shortened};
use crate::{Column, ParseError, Table, Values};
use roxmltree::{Document, Node, ParsingOptions};
use std::borrow::Cow;
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

/// Returns true for XML of any kind.
pub(super) fn is_xml(text: &str) -> bool {
    let mut head = head(text).chars();
    head.next() == Some('<')
        && head.next().is_some_and(|c| c.is_ascii_alphabetic() || "?!".contains(c))
}

/// The text with blanks in place of a document type that defines nothing of its own (`<!DOCTYPE tdm>`): what it names elsewhere is never fetched.
fn without_doctype(text: &str) -> Cow<'_, str> {
    const START: &str = "<!DOCTYPE";
    let end = text.char_indices().nth(4096).map_or(text.len(), |(at, _)| at);
    let Some(from) = text[..end].find(START) else { return Cow::Borrowed(text) };
    let mut quote = None;
    for (at, c) in text[from..end].char_indices() {
        match (quote, c) {
            (Some(q), c) if q == c => quote = None,
            (Some(_), _) => {}
            (None, '"' | '\'') => quote = Some(c),
            // Its own definitions stay, and are refused.
            (None, '[') => return Cow::Borrowed(text),
            (None, '>') => {
                let blank = |c: char| if c == '\n' { '\n' } else { ' ' };
                let blanks: String = text[from..=from + at].chars().map(blank).collect();
                return Cow::Owned(format!("{}{blanks}{}", &text[..from], &text[from + at + 1..]));
            }
            (None, _) => {}
        }
    }
    Cow::Borrowed(text)
}

fn parsed<'a>(path: &Path, text: &'a str) -> Result<Document<'a>, ParseError> {
    // A DTD may define entities that grow without end; VOTables of old name one and do not need it.
    let options =
        ParsingOptions { allow_dtd: false, nodes_limit: MOST_NODES, ..ParsingOptions::default() };
    Document::parse_with_options(text, options).map_err(|error| {
        let line = u64::from(error.pos().row);
        ParseError::new(path, error.to_string(), "well-formed XML without definitions of a DTD")
            .at_line(line)
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
    let text = without_doctype(text);
    let document = parsed(path, &text)?;
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

/// The first table of a VOTable (1.1 to 1.5) whose data stand as TABLEDATA, BINARY or BINARY2.
///
/// A TIMESYS becomes metadata: `timesys_of` with an entry for each column that refers to one; `timesys`, `timeorigin` and `refposition` where the document has a single one.
pub(super) fn votable(path: &Path, text: &str) -> Result<Table, ParseError> {
    let text = without_doctype(text);
    let document = parsed(path, &text)?;
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
    let element = data.children().find(Node::is_element);
    let values = match element.map(|n| (n.tag_name().name(), n)) {
        Some(("TABLEDATA", rows)) => of_rows(path, &fields, rows)?,
        Some((kind @ ("BINARY" | "BINARY2"), block)) => {
            let stream = block.children().find(named("STREAM"));
            let stream = stream.filter(|s| {
                s.attribute("href").is_none() && s.attribute("encoding") == Some("base64")
            });
            let Some(stream) = stream else {
                let error = ParseError::new(
                    path,
                    format!("{kind} without a STREAM in base64"),
                    "data within the file",
                );
                return Err(error.at_line(line(block)));
            };
            let forms: Vec<Form> = fields.iter().map(|f| form_of(*f)).collect();
            let text = stream.text().unwrap_or_default();
            super::votable_binary::decode(&forms, text, kind == "BINARY2").map_err(
                |(found, expected)| ParseError::new(path, found, expected).at_line(line(stream)),
            )?
        }
        other => {
            let kind = other.map_or("nothing", |(name, _)| name);
            let expected = "data as TABLEDATA, BINARY or BINARY2";
            let error = ParseError::new(path, format!("data as {kind}"), expected);
            return Err(error.at_line(line(data)).with_hint(
                "write it again with tabledata_format=\"tabledata\" (astropy), or as ECSV or FITS",
            ));
        }
    };
    let column = |(field, values): (&Node<'_, '_>, Values)| Column {
        name: name_of(*field).to_owned(),
        unit: field.attribute("unit").map(str::to_owned),
        description: None,
        values,
    };
    let columns = fields.iter().zip(values).map(column).collect();
    let mut read = Table { columns, ..Table::default() };
    let systems: Vec<Node<'_, '_>> = document.descendants().filter(named("TIMESYS")).collect();
    let said = |system: Node<'_, '_>| {
        let keys = [
            ("timesys", "timescale"),
            ("timeorigin", "timeorigin"),
            ("refposition", "refposition"),
        ];
        let pairs = keys
            .map(|(key, attribute)| Some((key.to_owned(), system.attribute(attribute)?.into())));
        pairs.into_iter().flatten().collect::<serde_json::Map<_, _>>()
    };
    if let [system] = systems[..] {
        read.meta.extend(said(system));
    }
    let mut of_columns = serde_json::Map::new();
    for field in &fields {
        let asked = field.attribute("ref");
        let system = asked.and_then(|id| systems.iter().find(|s| s.attribute("ID") == Some(id)));
        if let Some(system) = system {
            of_columns.insert(name_of(*field).to_owned(), said(*system).into());
        }
    }
    if !of_columns.is_empty() {
        read.meta.insert("timesys_of".into(), of_columns.into());
    }
    Ok(read)
}

fn name_of<'a>(field: Node<'a, '_>) -> &'a str {
    field.attribute("name").or(field.attribute("ID")).unwrap_or_default()
}

fn null_of<'a>(field: Node<'a, '_>) -> Option<&'a str> {
    let values = field.children().find(|n| n.tag_name().name() == "VALUES");
    values.and_then(|v| v.attribute("null"))
}

fn form_of<'a>(field: Node<'a, '_>) -> Form<'a> {
    Form {
        name: name_of(field),
        kind: field.attribute("datatype").unwrap_or_default(),
        array: field.attribute("arraysize"),
        null: null_of(field),
    }
}

/// Values of the columns of TABLEDATA.
fn of_rows(
    path: &Path,
    fields: &[Node<'_, '_>],
    rows: Node<'_, '_>,
) -> Result<Vec<Values>, ParseError> {
    let named = |name: &'static str| move |n: &Node<'_, '_>| n.tag_name().name() == name;
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
        let Form { name, kind, array, null } = form_of(*field);
        // Arrays, complex numbers and bits are no columns of numbers: they stay texts.
        let is_number =
            matches!(kind, "unsignedByte" | "short" | "int" | "long" | "float" | "double" | "");
        if matches!(kind, "boolean" | "bit") && array.is_none() {
            let truth = |text: Option<String>| match text?.to_ascii_lowercase().as_str() {
                "t" | "1" | "true" => Some(true),
                "f" | "0" | "false" => Some(false),
                _ => None,
            };
            made.push(Values::Bool(texts.into_iter().map(truth).collect()));
            continue;
        }
        if array.is_some_and(|a| a != "1") || !is_number {
            made.push(Values::Text(texts));
            continue;
        }
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
        made.push(Values::F64(numbers));
    }
    Ok(made)
}
