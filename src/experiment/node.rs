//! A YAML file as a tree in which every part knows its place, so that whatever is wrong can be named with it.

use std::fmt::{self, Display};
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use serde::de::{Deserialize, Deserializer, MapAccess, SeqAccess, Visitor};
use serde_json::Value;
use serde_saphyr::{Location, Spanned};

use crate::config::nearest;
use crate::error::UserError;

/// The file that a tree was read from.
pub(super) struct Source<'a> {
    pub(super) path: &'a Path,
}

impl Source<'_> {
    /// An error at a place of the file.
    pub(super) fn refuse(&self, at: Location, problem: impl Display) -> UserError {
        UserError::new(format!("{}:{}:{}: {problem}", self.path.display(), at.line(), at.column()))
    }

    /// A path in the file, which is relative to it.
    pub(super) fn beside(&self, other: &str) -> PathBuf {
        self.path.parent().unwrap_or(Path::new("")).join(other)
    }

    /// Parses the file's text.
    pub(super) fn parse(&self, text: &str) -> Result<Node, UserError> {
        let root: Spanned<Content> = serde_saphyr::from_str(text).map_err(|error| {
            let problem = format!("not a study: {}", error.without_snippet());
            match error.location() {
                Some(at) => self.refuse(at, problem),
                None => UserError::new(format!("{}: {problem}", self.path.display())),
            }
        })?;
        Ok(root.into())
    }
}

/// A part of the file.
#[derive(Clone, Debug)]
pub(super) struct Node {
    pub(super) at: Location,
    pub(super) content: Content,
}

#[derive(Clone, Debug)]
pub(super) enum Content {
    Scalar(Value),
    List(Vec<Node>),
    /// Keys with their places, and values.
    Map(Vec<(String, Location, Node)>),
}

/// The entries of a mapping whose keys are known.
pub(super) struct Fields<'a> {
    at: Location,
    entries: &'a [(String, Location, Node)],
}

impl From<Spanned<Content>> for Node {
    fn from(spanned: Spanned<Content>) -> Self {
        Self { at: spanned.referenced, content: spanned.value }
    }
}

impl Node {
    /// The entries of a mapping; `what` it is, for messages.
    pub(super) fn fields(&self, source: &Source<'_>, what: &str, known: &[&str]) -> Result<Fields<'_>, UserError> {
        let entries = self.map(source, what)?;
        if let Some((key, at, _)) = entries.iter().find(|(key, ..)| !known.contains(&key.as_str())) {
            let remedy = nearest(key, known).map_or_else(
                || format!("known keys of {what} are {}", known.join(", ")),
                |nearest| format!("did you mean \"{nearest}\"?"),
            );
            return Err(source.refuse(*at, format_args!("unknown key \"{key}\" in {what}; {remedy}")));
        }
        Ok(Fields { at: self.at, entries })
    }

    /// The entries of a mapping.
    pub(super) fn map(&self, source: &Source<'_>, what: &str) -> Result<&[(String, Location, Node)], UserError> {
        match &self.content {
            Content::Map(entries) => Ok(entries),
            _ => Err(source.refuse(self.at, format_args!("{what}: expected a mapping of key: value"))),
        }
    }

    /// The entries of a list that is not empty.
    pub(super) fn list(&self, source: &Source<'_>, what: &str, remedy: &str) -> Result<&[Node], UserError> {
        match &self.content {
            Content::List(entries) if !entries.is_empty() => Ok(entries),
            Content::List(_) => Err(source.refuse(self.at, format_args!("{what}: the list is empty: {remedy}"))),
            _ => Err(source.refuse(self.at, format_args!("{what}: expected a list: {remedy}"))),
        }
    }

    pub(super) fn text(&self, source: &Source<'_>, what: &str) -> Result<&str, UserError> {
        match &self.content {
            Content::Scalar(Value::String(text)) => Ok(text),
            _ => Err(source.refuse(self.at, format_args!("{what}: expected a text"))),
        }
    }

    pub(super) fn integer(
        &self,
        source: &Source<'_>,
        what: &str,
        range: RangeInclusive<u64>,
    ) -> Result<u64, UserError> {
        let number = match &self.content {
            // 1e6 and 1000000.0 are integers, too.
            Content::Scalar(Value::Number(number)) => number.as_u64().or_else(|| {
                let number = number.as_f64()?;
                (number.fract() == 0.0 && (0.0..9.0e15).contains(&number)).then_some(number as u64)
            }),
            _ => None,
        };
        number.filter(|number| range.contains(number)).ok_or_else(|| {
            let (least, most) = (range.start(), range.end());
            source.refuse(self.at, format_args!("{what}: expected an integer from {least} to {most}, got {self}"))
        })
    }

    pub(super) fn number(&self, source: &Source<'_>, what: &str) -> Result<f64, UserError> {
        let number = match &self.content {
            Content::Scalar(value) => value.as_f64(),
            _ => None,
        };
        number.ok_or_else(|| source.refuse(self.at, format_args!("{what}: expected a number, got {self}")))
    }

    /// One of these words.
    pub(super) fn word<'w>(&self, source: &Source<'_>, what: &str, known: &[&'w str]) -> Result<&'w str, UserError> {
        let text = match &self.content {
            Content::Scalar(Value::String(text)) => text.clone(),
            _ => self.to_string(),
        };
        known.iter().find(|word| **word == text).copied().ok_or_else(|| {
            let meant = nearest(&text, known).map_or_else(String::new, |word| format!("; did you mean \"{word}\"?"));
            source.refuse(self.at, format_args!("{what}: expected {}, got {self}{meant}", known.join(" or ")))
        })
    }

    /// As JSON.
    pub(super) fn value(&self) -> Value {
        match &self.content {
            Content::Scalar(value) => value.clone(),
            Content::List(entries) => entries.iter().map(Self::value).collect(),
            Content::Map(entries) => entries.iter().map(|(key, _, node)| (key.clone(), node.value())).collect(),
        }
    }
}

impl Display for Node {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.value())
    }
}

impl<'a> Fields<'a> {
    pub(super) fn get(&self, key: &str) -> Option<&'a Node> {
        self.entries.iter().find(|(known, ..)| known == key).map(|(_, _, node)| node)
    }

    /// A value that must be there; `what` holds it.
    pub(super) fn need(&self, source: &Source<'_>, what: &str, key: &str) -> Result<&'a Node, UserError> {
        self.get(key).ok_or_else(|| source.refuse(self.at, format_args!("{what} has no \"{key}\": add it")))
    }
}

impl<'de> Deserialize<'de> for Content {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Build;
        impl<'de> Visitor<'de> for Build {
            type Value = Content;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a value, a list or a mapping")
            }

            fn visit_bool<E>(self, value: bool) -> Result<Content, E> {
                Ok(Content::Scalar(value.into()))
            }

            fn visit_i64<E>(self, value: i64) -> Result<Content, E> {
                Ok(Content::Scalar(value.into()))
            }

            fn visit_u64<E>(self, value: u64) -> Result<Content, E> {
                Ok(Content::Scalar(value.into()))
            }

            fn visit_f64<E>(self, value: f64) -> Result<Content, E> {
                Ok(Content::Scalar(value.into()))
            }

            fn visit_str<E>(self, value: &str) -> Result<Content, E> {
                Ok(Content::Scalar(value.into()))
            }

            fn visit_unit<E>(self) -> Result<Content, E> {
                Ok(Content::Scalar(Value::Null))
            }

            fn visit_none<E>(self) -> Result<Content, E> {
                Ok(Content::Scalar(Value::Null))
            }

            fn visit_some<D: Deserializer<'de>>(self, deserializer: D) -> Result<Content, D::Error> {
                Content::deserialize(deserializer)
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Content, A::Error> {
                let mut entries = Vec::new();
                while let Some(entry) = list.next_element::<Spanned<Content>>()? {
                    entries.push(entry.into());
                }
                Ok(Content::List(entries))
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Content, A::Error> {
                let mut entries = Vec::new();
                while let Some(key) = map.next_key::<Spanned<String>>()? {
                    let value = map.next_value::<Spanned<Content>>()?;
                    entries.push((key.value, key.referenced, value.into()));
                }
                Ok(Content::Map(entries))
            }
        }
        deserializer.deserialize_any(Build)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_part_knows_its_place() {
        let source = Source { path: Path::new("x.yaml") };
        let root = source.parse("a: [1, {b: 2.5}]\nlong key: [ ]\n").unwrap();
        assert_eq!(root.to_string(), r#"{"a":[1,{"b":2.5}],"long key":[]}"#);
        let [(_, a_at, a), (_, long_at, long)] = root.map(&source, "x").unwrap() else { panic!("two keys") };
        let place = |at: &Location| (at.line(), at.column());
        assert_eq!((place(a_at), place(&a.at)), ((1, 1), (1, 4)));
        assert_eq!((place(long_at), place(&long.at)), ((2, 1), (2, 11)));
        let [_, b] = a.list(&source, "a", "").unwrap() else { panic!("two entries") };
        assert_eq!((place(&b.at), place(&b.map(&source, "b").unwrap()[0].1)), ((1, 8), (1, 9)));
        let error = b.fields(&source, "b", &["c"]).map(drop).unwrap_err().to_string();
        assert_eq!(error, "x.yaml:1:9: unknown key \"b\" in b; did you mean \"c\"?");
    }
}
