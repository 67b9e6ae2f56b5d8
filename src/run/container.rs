//! The files that hold tensors: safetensors with a header of our own and a checksum over every byte.

use std::collections::{BTreeSet, HashMap};
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::Path;

use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::Serialize;
use serde_json::Value;

use crate::agent::buffers::{Buffer, Data};
use crate::agent::network::TensorPlace;

/// The format's version; a file with another one is refused by name.
pub const FORMAT: u32 = 1;
/// What a header has for its checksum until that is known.
pub(super) const NO_CRC: &str = "00000000";
/// The one key of the safetensors metadata.
const HEADER_KEY: &str = "cpp-rl";
/// Larger files are none of ours.
const MAX_BYTES: u64 = 4 << 30;
/// Longer headers are no headers of ours: some kilobytes, or some hundred for each environment of a snapshot.
const MAX_HEADER_BYTES: u64 = 1 << 26;
/// What stands before the checksum's digits: the header is JSON within JSON, so that its quotes are escaped.
const CRC_FIELD: &[u8] = br#"\"crc32\":\""#;
const CRC_DIGITS: usize = NO_CRC.len();

/// Why a file is not taken.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// Its bytes are not those that were written.
    #[error("{0}")]
    Damaged(String),
    /// It cannot be read, and may well be whole.
    #[error("cannot read the checkpoint: {0}")]
    Unreadable(io::Error),
    /// It is whole, but not what is wanted here.
    #[error("{0}")]
    Foreign(String),
}

/// A tensor to be written: its bytes row-major, little-endian.
pub(super) struct Tensor {
    pub name: String,
    pub dtype: Dtype,
    pub shape: Vec<usize>,
    pub bytes: Vec<u8>,
}

impl Tensor {
    /// A tensor of floats.
    pub(super) fn floats(name: impl Into<String>, shape: &[usize], values: &[f32]) -> Self {
        let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        Self { name: name.into(), dtype: Dtype::F32, shape: shape.to_vec(), bytes }
    }

    /// An array of an algorithm.
    pub(super) fn buffer(name: impl Into<String>, Buffer { shape, data }: &Buffer) -> Self {
        let (dtype, bytes) = match data {
            Data::U8(values) => (Dtype::U8, values.clone()),
            Data::U16(values) => (Dtype::U16, values.iter().flat_map(|v| v.to_le_bytes()).collect()),
            Data::U64(values) => (Dtype::U64, values.iter().flat_map(|v| v.to_le_bytes()).collect()),
            Data::F32(values) => (Dtype::F32, values.iter().flat_map(|v| v.to_le_bytes()).collect()),
        };
        Self { name: name.into(), dtype, shape: shape.clone(), bytes }
    }

    /// The tensors of a network whose values lie in one flat slice.
    pub(super) fn network<'a>(
        prefix: &'a str,
        places: &'a [TensorPlace],
        flat: &'a [f32],
    ) -> impl Iterator<Item = Self> + 'a {
        let tensor = move |place: &TensorPlace| {
            Self::floats(format!("{prefix}{}", place.name), &place.shape, &flat[place.range.clone()])
        };
        places.iter().map(tensor)
    }
}

/// The bytes of a file. The first field of `header` is `crc32`, which is [`NO_CRC`].
pub(super) fn to_bytes(header: &impl Serialize, tensors: &[Tensor]) -> Vec<u8> {
    let views = tensors.iter().map(|tensor| {
        let view = TensorView::new(tensor.dtype, tensor.shape.clone(), &tensor.bytes);
        (tensor.name.as_str(), view.expect("a shape holds its bytes"))
    });
    let text = serde_json::to_string(header).expect("a header of plain values");
    let metadata = HashMap::from([(HEADER_KEY.to_owned(), text)]);
    let mut bytes = safetensors::serialize(views, Some(metadata)).expect("names and shapes of our own");
    let at = crc_position(&bytes).expect("the header was just written");
    let crc = format!("{:08x}", crc32fast::hash(&bytes));
    bytes[at..at + CRC_DIGITS].copy_from_slice(crc.as_bytes());
    bytes
}

/// The bytes of a file, of which nothing is read or allocated that none of ours can have.
///
/// # Errors
/// Without the file's name.
pub(super) fn read(path: &Path) -> Result<Vec<u8>, FileError> {
    // Looked at before it is opened, which would wait where it is a pipe.
    let metadata = fs::metadata(path).map_err(FileError::Unreadable)?;
    let size = metadata.len();
    if !metadata.is_file() {
        return Err(FileError::Unreadable(io::Error::other("it is not a file")));
    }
    if size > MAX_BYTES {
        let message = format!("{size} bytes are too many for a checkpoint (at most {MAX_BYTES})");
        return Err(FileError::Foreign(message));
    }
    let mut file = File::open(path).map_err(FileError::Unreadable)?;
    let mut bytes = Vec::new();
    (&mut file).take(8).read_to_end(&mut bytes).map_err(FileError::Unreadable)?;
    if let Ok(length) = <[u8; 8]>::try_from(bytes.as_slice()).map(u64::from_le_bytes)
        && length > MAX_HEADER_BYTES
    {
        let message = format!("not a checkpoint of cpp-rl: its header is said to have {length} bytes");
        return Err(FileError::Damaged(format!("{message} (at most {MAX_HEADER_BYTES} are possible)")));
    }
    // A file that grows meanwhile is read no further.
    file.take(size.saturating_sub(8)).read_to_end(&mut bytes).map_err(FileError::Unreadable)?;
    Ok(bytes)
}

/// An opened file; each tensor is taken out of it once.
pub(super) struct Container<'a> {
    /// The header, as JSON.
    pub header: String,
    tensors: SafeTensors<'a>,
    taken: BTreeSet<String>,
}

/// What is said of a file that is no file of ours, or none any more.
fn damaged(what: impl std::fmt::Display) -> FileError {
    FileError::Damaged(format!("not a checkpoint of cpp-rl ({what}): the file was cut short or changed"))
}

/// What is said of a file that fits its checksum, and yet is not one of ours.
pub(super) fn not_ours(what: impl std::fmt::Display) -> String {
    format!("not a checkpoint that this version of cpp-rl writes ({what})")
}

impl<'a> Container<'a> {
    /// Opens a file and checks checksum, format and kind, before anything else of it is believed.
    ///
    /// The checksum comes first: a file that fits it is as it was written, whatever else is wrong with it.
    pub(super) fn open(bytes: &'a [u8], kind: &str) -> Result<Self, FileError> {
        let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(damaged)?;
        let text = metadata.metadata().as_ref().and_then(|m| m.get(HEADER_KEY)).ok_or_else(|| {
            let message = "a safetensors file without a cpp-rl header: convert models of other tools with \
                           `python -m cpp_rl_gym.sb3 import`";
            FileError::Damaged(message.to_owned())
        })?;
        check_crc(bytes).map_err(FileError::Damaged)?;
        check_format(text, kind).map_err(FileError::Foreign)?;
        let tensors = SafeTensors::deserialize(bytes).map_err(|error| FileError::Foreign(not_ours(error)))?;
        Ok(Self { header: text.clone(), tensors, taken: BTreeSet::new() })
    }

    /// The shape of a tensor, where there is one of this name.
    pub(super) fn shape(&self, name: &str) -> Option<Vec<usize>> {
        self.tensors.tensor(name).ok().map(|tensor| tensor.shape().to_vec())
    }

    /// The names of the tensors that nobody has taken yet.
    pub(super) fn left(&self) -> impl Iterator<Item = String> {
        let names = self.tensors.names().into_iter().map(str::to_owned);
        names.filter(|name| !self.taken.contains(name)).collect::<BTreeSet<_>>().into_iter()
    }

    /// What stands before `name` in the names of tensors that nobody has taken yet.
    pub(super) fn prefixes_of(&self, name: &str) -> Vec<String> {
        let prefix = |left: String| left.strip_suffix(name).filter(|prefix| prefix.ends_with('/')).map(str::to_owned);
        self.left().filter_map(prefix).collect()
    }

    /// The type of a tensor's elements, where there is one of this name.
    pub(super) fn dtype(&self, name: &str) -> Option<Dtype> {
        self.tensors.tensor(name).ok().map(|tensor| tensor.dtype())
    }

    /// The bytes of a tensor, or nothing where there is none of this name.
    pub(super) fn take(&mut self, name: &str, dtype: Dtype, shape: &[usize]) -> Result<Option<&'a [u8]>, String> {
        let Ok(tensor) = self.tensors.tensor(name) else { return Ok(None) };
        if tensor.dtype() != dtype || tensor.shape() != shape {
            return Err(format!("tensor {name} is not {dtype:?} of shape {shape:?}"));
        }
        self.taken.insert(name.to_owned());
        Ok(Some(tensor.data()))
    }

    /// An array of an algorithm, or nothing where there is none of this name; whether it makes sense is for the algorithm.
    pub(super) fn buffer(&mut self, name: &str) -> Result<Option<Buffer>, String> {
        let (Some(shape), Some(dtype)) = (self.shape(name), self.dtype(name)) else { return Ok(None) };
        let Some(bytes) = self.take(name, dtype, &shape)? else { return Ok(None) };
        let data = match dtype {
            Dtype::U8 => Data::U8(bytes.to_vec()),
            Dtype::U16 => Data::U16(bytes.as_chunks().0.iter().map(|&v| u16::from_le_bytes(v)).collect()),
            Dtype::U64 => Data::U64(bytes.as_chunks().0.iter().map(|&v| u64::from_le_bytes(v)).collect()),
            Dtype::F32 => Data::F32(floats(bytes).collect()),
            other => return Err(not_ours(format_args!("tensor {name} is of {other:?}"))),
        };
        Ok(Some(Buffer { shape, data }))
    }

    /// The flat slice of a network's tensors with this prefix, or nothing where there are none.
    pub(super) fn network(&mut self, prefix: &str, places: &[TensorPlace]) -> Result<Option<Vec<f32>>, String> {
        let mut flat = Vec::new();
        for (i, place) in places.iter().enumerate() {
            let name = format!("{prefix}{}", place.name);
            match self.take(&name, Dtype::F32, &place.shape)? {
                Some(bytes) => flat.extend(floats(bytes)),
                None if i == 0 => return Ok(None),
                None => return Err(format!("tensor {name} is missing")),
            }
        }
        Ok(Some(flat))
    }

    /// Refuses tensors that nobody has taken.
    pub(super) fn finish(self) -> Result<(), String> {
        if self.left().next().is_none() {
            return Ok(());
        }
        Err(not_ours("it holds tensors that its header does not name"))
    }
}

/// Little-endian floats.
pub(super) fn floats(bytes: &[u8]) -> impl Iterator<Item = f32> {
    let (values, _) = bytes.as_chunks();
    values.iter().map(|&value| f32::from_le_bytes(value))
}

/// Refuses other versions and kinds by name.
fn check_format(text: &str, kind: &str) -> Result<(), String> {
    let header: Value = serde_json::from_str(text).map_err(not_ours)?;
    match header.get("format").and_then(Value::as_u64) {
        Some(format) if format == u64::from(FORMAT) => {}
        Some(format) => {
            return Err(format!("checkpoint format {format}; this version of cpp-rl reads format {FORMAT}"));
        }
        None => return Err(not_ours("its header names no format")),
    }
    match header.get("kind").and_then(Value::as_str) {
        Some(found) if found == kind => Ok(()),
        Some("snapshot") => Err("a snapshot from the midst of a stage, for --resume alone".to_owned()),
        found => Err(format!("a checkpoint of kind {}, where {kind} is wanted", found.unwrap_or("unknown"))),
    }
}

/// Compares the checksum with the bytes.
fn check_crc(bytes: &[u8]) -> Result<(), String> {
    let damaged = || "its checksum does not fit its content: the file was damaged or edited".to_owned();
    let at = crc_position(bytes).ok_or_else(damaged)?;
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(&bytes[..at]);
    hasher.update(&[b'0'; CRC_DIGITS]);
    hasher.update(&bytes[at + CRC_DIGITS..]);
    if format!("{:08x}", hasher.finalize()).as_bytes() == &bytes[at..at + CRC_DIGITS] { Ok(()) } else { Err(damaged()) }
}

/// Where the checksum's digits stand, if they stand exactly once within the safetensors header.
fn crc_position(bytes: &[u8]) -> Option<usize> {
    let length = u64::from_le_bytes(bytes.get(..8)?.try_into().ok()?);
    let header = bytes.get(8..usize::try_from(length).ok()?.checked_add(8)?)?;
    let mut found = header.windows(CRC_FIELD.len()).enumerate().filter(|(_, window)| *window == CRC_FIELD);
    let (at, _) = found.next()?;
    let digits = at + CRC_FIELD.len();
    (found.next().is_none() && digits + CRC_DIGITS <= header.len()).then_some(8 + digits)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn another_format_or_kind_is_refused_by_name() {
        let refused = |header: &str| check_format(header, "stage").unwrap_err();
        assert!(check_format(r#"{"format":1,"kind":"stage"}"#, "stage").is_ok());
        assert_eq!(refused(r#"{"format":2}"#), "checkpoint format 2; this version of cpp-rl reads format 1");
        assert!(refused(r#"{"format":1,"kind":"snapshot"}"#).contains("from the midst of a stage"));
        assert!(refused(r#"{"format":1,"kind":"x"}"#).contains("of kind x"));
        assert!(refused(r#"{"kind":"stage"}"#).contains("names no format"));
    }
}
