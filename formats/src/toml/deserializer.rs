//! serde over toml's tree with byte spans: what `toml::from_str` does, but errors keep the place and the pieces.

use super::error::{Error, Step};
use crate::error::excerpt;
use serde::de::{
    DeserializeSeed, Deserializer, EnumAccess, Error as _, MapAccess, SeqAccess, Unexpected,
    VariantAccess, Visitor, value::StrDeserializer,
};
use serde::forward_to_deserialize_any;
use std::collections::VecDeque;
use toml::Spanned;
use toml::de::{DeInteger, DeString, DeTable, DeValue};

/// One value of the tree with the byte at which it begins.
pub(super) struct Value<'s> {
    pub value: DeValue<'s>,
    pub start: usize,
}

impl<'s> Value<'s> {
    fn new(spanned: Spanned<DeValue<'s>>) -> Self {
        let start = spanned.span().start;
        Self { value: spanned.into_inner(), start }
    }

    /// Runs a visit and gives its error the place of this value.
    fn visit<T>(self, visit: impl FnOnce(DeValue<'s>) -> Result<T, Error>) -> Result<T, Error> {
        let Self { value, start } = self;
        let name = describe(&value);
        visit(value).map_err(|error| error.at(start, || name))
    }
}

/// A value as a person would call it, in one line.
pub(super) fn describe(value: &DeValue<'_>) -> String {
    match value {
        DeValue::String(text) => {
            let short = excerpt(text);
            format!("\"{}\"", short.trim_matches('`'))
        }
        DeValue::Integer(number) => number.to_string(),
        DeValue::Float(number) => number.to_string(),
        DeValue::Boolean(value) => value.to_string(),
        DeValue::Datetime(time) => time.to_string(),
        DeValue::Array(items) => format!("an array of {}", items.len()),
        DeValue::Table(_) => "a table".to_owned(),
    }
}

fn has_digits(text: &str) -> bool {
    text.bytes().any(|b| b.is_ascii_digit())
}

fn visit_integer<'de, V: Visitor<'de>>(
    number: &DeInteger<'_>,
    visitor: V,
) -> Result<V::Value, Error> {
    let (digits, radix) = (number.as_str(), number.radix());
    if let Ok(value) = i64::from_str_radix(digits, radix) {
        visitor.visit_i64(value)
    } else if let Ok(value) = u64::from_str_radix(digits, radix) {
        visitor.visit_u64(value)
    } else {
        Err(Error::invalid_value(Unexpected::Other("a number of more than 64 bits"), &visitor))
    }
}

impl<'de> Deserializer<'de> for Value<'_> {
    type Error = Error;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        self.visit(|value| match value {
            DeValue::String(text) => visitor.visit_str(&text),
            DeValue::Integer(number) => visit_integer(&number, visitor),
            DeValue::Float(number) => match number.as_str().parse() {
                // `1e999` is a number that does not fit, not an infinity.
                Ok(value) if f64::is_finite(value) || !has_digits(number.as_str()) => {
                    visitor.visit_f64(value)
                }
                _ => Err(Error::invalid_value(Unexpected::Str(number.as_str()), &visitor)),
            },
            DeValue::Boolean(value) => visitor.visit_bool(value),
            // As text, which `time::Utc` reads; the TOML grammar has checked its form.
            DeValue::Datetime(time) => visitor.visit_str(&time.to_string()),
            DeValue::Array(items) => {
                visitor.visit_seq(Items { items: items.into_iter().enumerate(), last: 0 })
            }
            DeValue::Table(table) => visitor.visit_map(Entries::new(table)),
        })
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        visitor.visit_some(self)
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        _name: &'static str,
        visitor: V,
    ) -> Result<V::Value, Error> {
        let (start, name) = (self.start, describe(&self.value));
        // A newtype's own check fails after its value was read.
        visitor.visit_newtype_struct(self).map_err(|error| error.at(start, || name))
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _name: &'static str,
        _variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Error> {
        self.visit(|value| match value {
            DeValue::String(text) => visitor.visit_enum(Variant { name: text, content: None }),
            DeValue::Table(table) if table.len() == 1 => {
                let mut entries = Entries::new(table);
                match entries.rest.pop_front() {
                    Some((key, content)) => {
                        let content = Value::new(content);
                        visitor
                            .visit_enum(Variant { name: key.into_inner(), content: Some(content) })
                    }
                    None => Err(Error::custom("an empty table")),
                }
            }
            _ => Err(Error::invalid_type(
                Unexpected::Other("another value"),
                &"the name of a variant, or a table with one key, its name",
            )),
        })
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _name: &'static str,
        _fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Error> {
        // A derived struct would also take an array, by position: that is never meant in a file.
        self.visit(|value| match value {
            DeValue::Table(table) => visitor.visit_map(Entries::new(table)),
            _ => Err(Error::invalid_type(Unexpected::Other("another value"), &visitor)),
        })
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf unit
        unit_struct seq tuple tuple_struct map identifier ignored_any
    }
}

/// The elements of an array.
struct Items<'s, I: Iterator<Item = (usize, Spanned<DeValue<'s>>)>> {
    items: I,
    last: usize,
}

impl<'de, 's, I: Iterator<Item = (usize, Spanned<DeValue<'s>>)>> SeqAccess<'de> for Items<'s, I> {
    type Error = Error;

    fn next_element_seed<T: DeserializeSeed<'de>>(
        &mut self,
        seed: T,
    ) -> Result<Option<T::Value>, Error> {
        let Some((index, item)) = self.items.next() else { return Ok(None) };
        self.last = index;
        let item = Value::new(item);
        let (start, name) = (item.start, describe(&item.value));
        seed.deserialize(item)
            .map(Some)
            .map_err(|error| error.at(start, || name).within(Step::Index(index)))
    }

    fn size_hint(&self) -> Option<usize> {
        self.items.size_hint().1
    }
}

/// The entries of a table, in the order in which they stand in the file, so that the first error is the first in the
/// file.
pub(super) struct Entries<'s> {
    rest: VecDeque<(Spanned<DeString<'s>>, Spanned<DeValue<'s>>)>,
    current: Option<(String, Value<'s>)>,
}

impl<'s> Entries<'s> {
    pub fn new(table: DeTable<'s>) -> Self {
        let mut rest: Vec<_> = table.into_iter().collect();
        rest.sort_by_key(|(key, _)| key.span().start);
        Self { rest: rest.into(), current: None }
    }
}

impl<'de> MapAccess<'de> for Entries<'_> {
    type Error = Error;

    fn next_key_seed<K: DeserializeSeed<'de>>(
        &mut self,
        seed: K,
    ) -> Result<Option<K::Value>, Error> {
        let Some((key, value)) = self.rest.pop_front() else { return Ok(None) };
        let start = key.span().start;
        let key = key.into_inner();
        let result = seed.deserialize(StrDeserializer::<Error>::new(&key));
        let result = result.map_err(|error| error.at(start, || format!("the key `{key}`")));
        self.current = Some((key.into_owned(), Value::new(value)));
        result.map(Some)
    }

    fn next_value_seed<T: DeserializeSeed<'de>>(&mut self, seed: T) -> Result<T::Value, Error> {
        let Some((key, value)) = self.current.take() else {
            return Err(Error::custom("a value was asked for before its key"));
        };
        let (start, name) = (value.start, describe(&value.value));
        seed.deserialize(value).map_err(|error| error.at(start, || name).within(Step::Key(key)))
    }
}

/// A variant of an enum: its name alone, or a table with its content.
struct Variant<'s> {
    name: DeString<'s>,
    content: Option<Value<'s>>,
}

impl<'de, 's> EnumAccess<'de> for Variant<'s> {
    type Error = Error;
    type Variant = Content<'s>;

    fn variant_seed<T: DeserializeSeed<'de>>(
        self,
        seed: T,
    ) -> Result<(T::Value, Content<'s>), Error> {
        let value = seed.deserialize(StrDeserializer::<Error>::new(&self.name))?;
        Ok((value, Content { name: self.name.into_owned(), value: self.content }))
    }
}

struct Content<'s> {
    name: String,
    value: Option<Value<'s>>,
}

impl<'s> Content<'s> {
    fn read<T>(self, read: impl FnOnce(Value<'s>) -> Result<T, Error>) -> Result<T, Error> {
        let Some(value) = self.value else {
            return Err(Error::invalid_type(
                Unexpected::Str(&self.name),
                &format!("a table `{} = …` with its content", self.name).as_str(),
            ));
        };
        let (start, name) = (value.start, describe(&value.value));
        read(value).map_err(|error| error.at(start, || name).within(Step::Key(self.name)))
    }
}

impl<'de> VariantAccess<'de> for Content<'_> {
    type Error = Error;

    fn unit_variant(self) -> Result<(), Error> {
        match self.value {
            None => Ok(()),
            Some(_) => Err(Error::invalid_type(
                Unexpected::Map,
                &format!("\"{}\" alone", self.name).as_str(),
            )),
        }
    }

    fn newtype_variant_seed<T: DeserializeSeed<'de>>(self, seed: T) -> Result<T::Value, Error> {
        self.read(|value| seed.deserialize(value))
    }

    fn tuple_variant<V: Visitor<'de>>(self, _length: usize, visitor: V) -> Result<V::Value, Error> {
        self.read(|value| value.deserialize_any(visitor))
    }

    fn struct_variant<V: Visitor<'de>>(
        self,
        _fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Error> {
        self.read(|value| value.deserialize_any(visitor))
    }
}
