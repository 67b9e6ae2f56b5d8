//! Arrays by name: what an algorithm keeps beside the parameters, in the midst of a stage or after it.

use std::collections::BTreeMap;

/// Arrays by name, which only the algorithm that put them there understands.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Buffers(BTreeMap<String, Buffer>);

/// One array, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct Buffer {
    /// Its dimensions.
    pub shape: Vec<usize>,
    /// Its elements.
    pub data: Data,
}

/// The elements of a [`Buffer`].
#[derive(Clone, Debug, PartialEq)]
pub enum Data {
    /// Bytes.
    U8(Vec<u8>),
    /// 16-bit integers.
    U16(Vec<u16>),
    /// 64-bit integers.
    U64(Vec<u64>),
    /// Floats.
    F32(Vec<f32>),
}

impl Buffers {
    /// Adds an array, or replaces the one of this name.
    pub fn add(&mut self, name: &str, shape: &[usize], data: Data) {
        self.insert(name, Buffer { shape: shape.to_vec(), data });
    }

    /// Adds an array, or replaces the one of this name.
    pub fn insert(&mut self, name: &str, buffer: Buffer) {
        self.0.insert(name.to_owned(), buffer);
    }

    /// The array of this name.
    pub fn get(&self, name: &str) -> Option<&Buffer> {
        self.0.get(name)
    }

    /// The elements of the array of this name, if they are bytes.
    pub fn u8s(&self, name: &str) -> Option<&[u8]> {
        self.get(name).and_then(|buffer| if let Data::U8(values) = &buffer.data { Some(&values[..]) } else { None })
    }

    /// The elements of the array of this name, if they are 16-bit integers.
    pub fn u16s(&self, name: &str) -> Option<&[u16]> {
        self.get(name).and_then(|buffer| if let Data::U16(values) = &buffer.data { Some(&values[..]) } else { None })
    }

    /// The elements of the array of this name, if they are 64-bit integers.
    pub fn u64s(&self, name: &str) -> Option<&[u64]> {
        self.get(name).and_then(|buffer| if let Data::U64(values) = &buffer.data { Some(&values[..]) } else { None })
    }

    /// The elements of the array of this name, if they are floats.
    pub fn f32s(&self, name: &str) -> Option<&[f32]> {
        self.get(name).and_then(|buffer| if let Data::F32(values) = &buffer.data { Some(&values[..]) } else { None })
    }

    /// All arrays, by name.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &Buffer)> {
        self.0.iter().map(|(name, buffer)| (name.as_str(), buffer))
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}
