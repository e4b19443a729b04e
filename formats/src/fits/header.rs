//! The cards of an HDU, in their order.

use super::card::{Card, CardValue, is_standard_keyword};
use super::{BLOCK, CARD, escape};
use crate::error::EncodeError;

/// The cards of an HDU, in their order, long texts joined.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Header {
    /// The cards.
    pub cards: Vec<Card>,
}

impl Header {
    /// The value of a keyword (the first card, if it stands there twice).
    pub fn get(&self, keyword: &str) -> Option<&CardValue> {
        self.cards
            .iter()
            .find(|card| card.keyword == keyword && !matches!(card.value, CardValue::Commentary(_)))
            .map(|card| &card.value)
    }

    /// A number.
    pub fn real(&self, keyword: &str) -> Option<f64> {
        self.get(keyword)?.real()
    }

    /// A whole number.
    pub fn integer(&self, keyword: &str) -> Option<i64> {
        self.get(keyword)?.integer()
    }

    /// A text.
    pub fn text(&self, keyword: &str) -> Option<&str> {
        self.get(keyword)?.text()
    }

    /// A truth value.
    pub fn logical(&self, keyword: &str) -> Option<bool> {
        self.get(keyword)?.logical()
    }

    /// Sets a keyword: in its place if it is there, else at the end.
    pub fn set(&mut self, keyword: &str, value: impl Into<CardValue>, comment: &str) {
        let card =
            Card { keyword: keyword.to_owned(), value: value.into(), comment: comment.to_owned() };
        match self.cards.iter_mut().find(|card| card.keyword == keyword) {
            Some(place) => *place = card,
            None => self.cards.push(card),
        }
    }

    /// Takes a keyword out.
    pub fn remove(&mut self, keyword: &str) {
        self.cards.retain(|card| card.keyword != keyword);
    }

    /// Adds a HISTORY card.
    pub fn history(&mut self, text: &str) {
        self.commentary("HISTORY", text);
    }

    /// Adds a COMMENT card.
    pub fn comment(&mut self, text: &str) {
        self.commentary("COMMENT", text);
    }

    fn commentary(&mut self, keyword: &str, text: &str) {
        let value = CardValue::Commentary(text.to_owned());
        self.cards.push(Card { keyword: keyword.to_owned(), value, comment: String::new() });
    }

    /// The texts of the COMMENT or HISTORY cards.
    pub fn commentaries<'a>(&'a self, keyword: &'a str) -> impl Iterator<Item = &'a str> {
        self.cards.iter().filter_map(move |card| match &card.value {
            CardValue::Commentary(text) if card.keyword == keyword => Some(text.as_str()),
            _ => None,
        })
    }

    /// The cards that do not describe the layout of the data: what a person wrote.
    pub(super) fn without_structure(&self) -> Self {
        let cards =
            self.cards.iter().filter(|card| !is_structural(&card.keyword)).cloned().collect();
        Self { cards }
    }

    /// Reads cards from `bytes` up to END. The header and its length in bytes, padding included; `None` if there is no
    /// END.
    pub(super) fn parse(bytes: &[u8]) -> Option<(Self, usize)> {
        let mut header = Self::default();
        for (i, raw) in bytes.chunks_exact(CARD).enumerate() {
            if raw.starts_with(b"END") && raw[3..8].iter().all(|&b| b == b' ') {
                escape::undo(&mut header);
                let length = ((i + 1) * CARD).next_multiple_of(BLOCK);
                return Some((header, length));
            }
            header.push(Card::parse(raw));
        }
        None
    }

    /// Adds a card; a CONTINUE goes on with the text of the card before, if that ends with `&`.
    fn push(&mut self, card: Card) {
        if card.keyword != "CONTINUE" {
            let blank =
                card.keyword.is_empty() && card.value == CardValue::Commentary(String::new());
            if !blank {
                self.cards.push(card);
            }
            return;
        }
        if let (Some(Card { value: CardValue::Text(text), comment, .. }), CardValue::Text(more)) =
            (self.cards.last_mut(), &card.value)
            && text.ends_with('&')
        {
            text.pop();
            text.push_str(more);
            if !card.comment.is_empty() {
                if !comment.is_empty() {
                    comment.push(' ');
                }
                comment.push_str(&card.comment);
            }
            return;
        }
        // Without a text to go on with it is commentary (standard, section 4.2.1.2).
        let text = match card.value {
            CardValue::Text(text) | CardValue::Other(text) => text,
            _ => String::new(),
        };
        self.commentary("COMMENT", &format!("CONTINUE {text}"));
    }

    /// The bytes of the header, END and padding included; texts that are not ASCII escaped.
    pub(super) fn encode(&self) -> Result<Vec<u8>, EncodeError> {
        let mut out = Vec::with_capacity(BLOCK);
        // At the end: the cards of the layout must come first, in their order.
        let marker = escape::card_for(self)?;
        let escaped = escape::keywords(marker.as_ref());
        for card in self.cards.iter().chain(&marker) {
            card.encode(escaped.contains(card.keyword.as_str()), &mut out)?;
        }
        out.extend_from_slice(format!("{:<CARD$}", "END").as_bytes());
        out.resize(out.len().next_multiple_of(BLOCK), b' ');
        Ok(out)
    }
}

/// Whether a keyword describes the layout of the data (or sums them up) or how texts are written, so that the writer sets it anew.
pub(super) fn is_structural(keyword: &str) -> bool {
    const WHOLE: [&str; 17] = [
        "SIMPLE",
        "XTENSION",
        "BITPIX",
        "NAXIS",
        "EXTEND",
        "PCOUNT",
        "GCOUNT",
        "GROUPS",
        "TFIELDS",
        "THEAP",
        "BSCALE",
        "BZERO",
        "BLANK",
        "CHECKSUM",
        "DATASUM",
        "END",
        escape::KEYWORD,
    ];
    const NUMBERED: [&str; 10] =
        ["NAXIS", "TTYPE", "TFORM", "TUNIT", "TSCAL", "TZERO", "TNULL", "TDISP", "TDIM", "TCOMM"];
    WHOLE.contains(&keyword)
        || is_standard_keyword(keyword)
            && NUMBERED.iter().any(|stem| {
                keyword
                    .strip_prefix(stem)
                    .is_some_and(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit()))
            })
}
