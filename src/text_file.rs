//! Text files from outside: read up to a size, whatever stands in their place.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// Why a text file was not read.
#[derive(Debug, thiserror::Error)]
pub enum TextError {
    /// It cannot be opened or read.
    #[error(transparent)]
    Unreadable(#[from] io::Error),
    /// It is larger than it may be.
    #[error("it is larger than {most} bytes")]
    TooLarge {
        /// The most bytes it may have.
        most: u64,
    },
    /// It is no text.
    #[error("it is not UTF-8 text: was it saved in another encoding, or damaged?")]
    NotUtf8,
}

/// The text of a file of `most` bytes at most.
///
/// # Errors
/// What [`TextError`] lists.
pub fn read(path: &Path, most: u64) -> Result<String, TextError> {
    let mut bytes = Vec::new();
    // A device or a pipe does not tell its size, and may have no end.
    File::open(path)?.take(most.saturating_add(1)).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most {
        return Err(TextError::TooLarge { most });
    }
    String::from_utf8(bytes).map_err(|_| TextError::NotUtf8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_may_have_so_many_bytes_and_no_more() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("file");
        std::fs::write(&path, "täxt").unwrap();
        assert_eq!(read(&path, 5).unwrap(), "täxt");
        assert!(matches!(read(&path, 4), Err(TextError::TooLarge { most: 4 })));
        std::fs::write(&path, b"t\xE4xt").unwrap();
        assert!(matches!(read(&path, 5), Err(TextError::NotUtf8)));
        assert!(matches!(read(&directory.path().join("absent"), 5), Err(TextError::Unreadable(_))));
    }
}
