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

/// Where a value stands and how a person would call it, for its errors.
struct Place {
    start: usize,
    name: String,
}

// What follows is made anew for every type that is read, and inlined wherever a field of it is: small pieces that are called keep programs small, and their build quick.
impl Place {
    #[cold]
    #[inline(never)]
    fn mark(self, error: Error) -> Error {
        error.at(self.start, self.name)
    }

    #[cold]
    #[inline(never)]
    fn mark_within(self, error: Error, step: Step) -> Error {
        error.at(self.start, self.name).within(step)
    }
}

impl<'s> Value<'s> {
    fn new(spanned: Spanned<DeValue<'s>>) -> Self {
        let start = spanned.span().start;
        Self { value: spanned.into_inner(), start }
    }

    #[inline(never)]
    fn place(&self) -> Place {
        Place { start: self.start, name: describe(&self.value) }
    }
}

/// A value as a person would call it, in one line.
#[inline(never)]
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

    #[inline(never)]
    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        let place = self.place();
        let read = match self.value {
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
                visitor.visit_seq(Items { items: items.into_iter().enumerate() })
            }
            DeValue::Table(table) => visitor.visit_map(Entries::new(table)),
        };
        read.map_err(|error| place.mark(error))
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Error> {
        visitor.visit_some(self)
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        _name: &'static str,
        visitor: V,
    ) -> Result<V::Value, Error> {
        let place = self.place();
        // A newtype's own check fails after its value was read.
        visitor.visit_newtype_struct(self).map_err(|error| place.mark(error))
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _name: &'static str,
        _variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Error> {
        let place = self.place();
        let read = match self.value {
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
        };
        read.map_err(|error| place.mark(error))
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _name: &'static str,
        _fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Error> {
        // A derived struct would also take an array, by position: that is never meant in a file.
        let place = self.place();
        let read = match self.value {
            DeValue::Table(table) => visitor.visit_map(Entries::new(table)),
            _ => Err(Error::invalid_type(Unexpected::Other("another value"), &visitor)),
        };
        read.map_err(|error| place.mark(error))
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf unit
        unit_struct seq tuple tuple_struct map identifier ignored_any
    }
}

/// The elements of an array.
struct Items<'s> {
    items: std::iter::Enumerate<std::vec::IntoIter<Spanned<DeValue<'s>>>>,
}

impl<'de> SeqAccess<'de> for Items<'_> {
    type Error = Error;

    #[inline(never)]
    fn next_element_seed<T: DeserializeSeed<'de>>(
        &mut self,
        seed: T,
    ) -> Result<Option<T::Value>, Error> {
        let Some((index, item)) = self.items.next() else { return Ok(None) };
        let item = Value::new(item);
        let place = item.place();
        seed.deserialize(item)
            .map(Some)
            .map_err(|error| place.mark_within(error, Step::Index(index)))
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
    #[inline(never)]
    pub fn new(table: DeTable<'s>) -> Self {
        let mut rest: Vec<_> = table.into_iter().collect();
        rest.sort_by_key(|(key, _)| key.span().start);
        Self { rest: rest.into(), current: None }
    }

    /// Makes the next entry the current one: its key, and the byte at which that begins.
    #[inline(never)]
    fn advance(&mut self) -> Option<(&str, usize)> {
        let (key, value) = self.rest.pop_front()?;
        let start = key.span().start;
        let (key, _) = self.current.insert((key.into_inner().into_owned(), Value::new(value)));
        Some((key, start))
    }
}

impl<'de> MapAccess<'de> for Entries<'_> {
    type Error = Error;

    #[inline(never)]
    fn next_key_seed<K: DeserializeSeed<'de>>(
        &mut self,
        seed: K,
    ) -> Result<Option<K::Value>, Error> {
        let Some((key, start)) = self.advance() else { return Ok(None) };
        let read = seed.deserialize(StrDeserializer::<Error>::new(key));
        read.map(Some).map_err(|error| {
            let name = format!("the key `{key}`");
            Place { start, name }.mark(error)
        })
    }

    #[inline(never)]
    fn next_value_seed<T: DeserializeSeed<'de>>(&mut self, seed: T) -> Result<T::Value, Error> {
        let Some((key, value)) = self.current.take() else {
            return Err(Error::custom("a value was asked for before its key"));
        };
        let place = value.place();
        seed.deserialize(value).map_err(|error| place.mark_within(error, Step::Key(key)))
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
        let place = value.place();
        read(value).map_err(|error| place.mark_within(error, Step::Key(self.name)))
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
