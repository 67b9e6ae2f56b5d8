//! What one setting is: a place in memory, the values it allows, and its form in files.

use std::ops::RangeInclusive;

use serde_json::Value;

/// One setting, borrowed from a config.
pub trait Field {
    /// Takes a value from outside.
    ///
    /// # Errors
    /// What is allowed, in words that follow "expected".
    fn set(&mut self, value: &Value) -> Result<(), String>;
    /// The value as it is written.
    fn get(&self) -> Value;
    /// What is allowed, in words that follow "expected".
    fn allowed(&self) -> String;
}

/// A setting with a closed list of values.
pub trait Choice: Copy + PartialEq + 'static {
    /// Every value with its name in files.
    const ALL: &'static [(&'static str, Self)];

    /// The value's name in files.
    fn name(self) -> &'static str {
        Self::ALL.iter().find(|(_, value)| *value == self).map_or("", |(name, _)| name)
    }
}

struct Integer<'a, T> {
    place: &'a mut T,
    range: RangeInclusive<u64>,
}

/// An integer within `range`.
pub fn integer<'a, T>(place: &'a mut T, range: RangeInclusive<u64>) -> impl Field + 'a
where
    T: Copy + TryFrom<u64> + TryInto<u64>,
{
    Integer { place, range }
}

impl<T: Copy + TryFrom<u64> + TryInto<u64>> Field for Integer<'_, T> {
    fn set(&mut self, value: &Value) -> Result<(), String> {
        let taken = whole(value).filter(|v| self.range.contains(v)).and_then(|v| T::try_from(v).ok());
        *self.place = taken.ok_or_else(|| self.allowed())?;
        Ok(())
    }

    fn get(&self) -> Value {
        (*self.place).try_into().map_or(Value::Null, Value::from)
    }

    fn allowed(&self) -> String {
        within("an integer", &self.range)
    }
}

fn within(what: &str, range: &RangeInclusive<u64>) -> String {
    format!("{what} from {} to {}", range.start(), range.end())
}

/// The integer a value stands for: `500000`, but `5e5` and `500000.0` too.
fn whole(value: &Value) -> Option<u64> {
    value.as_u64().or_else(|| {
        let number = value.as_f64()?;
        (number.fract() == 0.0 && (0.0..9.0e15).contains(&number)).then_some(number as u64)
    })
}

struct Float<'a> {
    place: &'a mut f64,
    allows: Box<dyn Fn(f64) -> bool>,
    allowed: String,
}

impl<'a> Float<'a> {
    fn new(place: &'a mut f64, allowed: impl Into<String>, allows: impl Fn(f64) -> bool + 'static) -> Self {
        Self { place, allows: Box::new(allows), allowed: allowed.into() }
    }
}

/// A finite number above 0.
pub fn positive(place: &mut f64) -> impl Field + '_ {
    Float::new(place, "a number above 0", |v| v > 0.0)
}

/// A finite number, 0 or above.
pub fn non_negative(place: &mut f64) -> impl Field + '_ {
    Float::new(place, "a number, 0 or above", |v| v >= 0.0)
}

/// A number from 0 to 1.
pub fn fraction(place: &mut f64) -> impl Field + '_ {
    Float::new(place, "a number from 0 to 1", |v| (0.0..=1.0).contains(&v))
}

/// A number from 0 to 1, but not 1 itself.
pub fn below_one(place: &mut f64) -> impl Field + '_ {
    Float::new(place, "a number from 0 to 1, but not 1", |v| (0.0..1.0).contains(&v))
}

/// A finite number of `least` or more.
pub fn at_least(place: &mut f64, least: f64) -> impl Field + '_ {
    Float::new(place, format!("a number of {least:e} or more"), move |v| v >= least)
}

impl Field for Float<'_> {
    fn set(&mut self, value: &Value) -> Result<(), String> {
        let taken = value.as_f64().filter(|&v| v.is_finite() && (self.allows)(v));
        *self.place = taken.ok_or_else(|| self.allowed())?;
        Ok(())
    }

    fn get(&self) -> Value {
        (*self.place).into()
    }

    fn allowed(&self) -> String {
        self.allowed.clone()
    }
}

struct Flag<'a>(&'a mut bool);

/// `true` or `false`.
pub fn flag(place: &mut bool) -> impl Field + '_ {
    Flag(place)
}

impl Field for Flag<'_> {
    fn set(&mut self, value: &Value) -> Result<(), String> {
        *self.0 = value.as_bool().ok_or_else(|| self.allowed())?;
        Ok(())
    }

    fn get(&self) -> Value {
        (*self.0).into()
    }

    fn allowed(&self) -> String {
        "true or false".to_owned()
    }
}

struct OneOf<'a, T> {
    place: &'a mut T,
    known: Vec<T>,
    name: fn(T) -> &'static str,
}

/// One of the names of a [`Choice`].
pub fn choice<T: Choice>(place: &mut T) -> impl Field + '_ {
    OneOf { place, known: T::ALL.iter().map(|(_, value)| *value).collect(), name: T::name }
}

/// One of `known`, by the name that `name` gives to each.
pub fn one_of<'a, T: Copy>(place: &'a mut T, known: &[T], name: fn(T) -> &'static str) -> impl Field + use<'a, T> {
    OneOf { place, known: known.to_vec(), name }
}

impl<T: Copy> Field for OneOf<'_, T> {
    fn set(&mut self, value: &Value) -> Result<(), String> {
        let named = value.as_str().and_then(|s| self.known.iter().find(|known| (self.name)(**known) == s));
        *self.place = *named.ok_or_else(|| self.allowed())?;
        Ok(())
    }

    fn get(&self) -> Value {
        (self.name)(*self.place).into()
    }

    fn allowed(&self) -> String {
        let names: Vec<&str> = self.known.iter().map(|known| (self.name)(*known)).collect();
        format!("one of {}", names.join(", "))
    }
}

struct List<'a> {
    place: &'a mut Vec<usize>,
    length: RangeInclusive<usize>,
    each: RangeInclusive<u64>,
}

/// A list of integers; `length` and `each` bound its length and its entries.
pub fn list(place: &mut Vec<usize>, length: RangeInclusive<usize>, each: RangeInclusive<u64>) -> impl Field {
    List { place, length, each }
}

impl Field for List<'_> {
    fn set(&mut self, value: &Value) -> Result<(), String> {
        let taken = value.as_array().filter(|list| self.length.contains(&list.len())).and_then(|list| {
            let entry = |v| whole(v).filter(|v| self.each.contains(v)).and_then(|v| usize::try_from(v).ok());
            list.iter().map(entry).collect::<Option<Vec<usize>>>()
        });
        *self.place = taken.ok_or_else(|| self.allowed())?;
        Ok(())
    }

    fn get(&self) -> Value {
        self.place.clone().into()
    }

    fn allowed(&self) -> String {
        let entries = within("integers", &self.each);
        format!("a list of {} to {} {entries}, such as [64, 64]", self.length.start(), self.length.end())
    }
}

struct Names<'a> {
    place: &'a mut Vec<&'static str>,
    known: Vec<&'static str>,
}

/// A list of different names out of `known`, in any order.
pub fn names<'a>(place: &'a mut Vec<&'static str>, known: Vec<&'static str>) -> impl Field + 'a {
    Names { place, known }
}

impl Field for Names<'_> {
    fn set(&mut self, value: &Value) -> Result<(), String> {
        let taken = value.as_array().and_then(|list| {
            let name = |v: &Value| v.as_str().and_then(|v| self.known.iter().copied().find(|known| *known == v));
            list.iter().map(name).collect::<Option<Vec<&'static str>>>()
        });
        let differ = |list: &Vec<&str>| list.iter().enumerate().all(|(i, name)| !list[..i].contains(name));
        *self.place =
            taken.filter(differ).ok_or_else(|| format!("{}, out of {}", self.allowed(), self.known.join(", ")))?;
        Ok(())
    }

    fn get(&self) -> Value {
        self.place.clone().into()
    }

    fn allowed(&self) -> String {
        match self.known.first() {
            Some(example) => format!("a list of different names, such as [{example}]"),
            None => "an empty list: there is nothing to name".to_owned(),
        }
    }
}
