//! Files that appear whole or not at all.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::Path;

/// What is appended to the name of a file while it is written aside.
const PARTIAL: &str = ".partial";

/// Replaces `path` by `bytes`: written aside, synced, renamed, and the directory synced.
///
/// Whatever the moment of a crash, the old content or the new one is there.
///
/// # Errors
/// Those of the file system; the old content then still stands.
pub fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    // The parent of a bare file name is the empty path.
    let directory = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(PARTIAL);
    let aside = directory.join(name);
    let written = File::create(&aside).and_then(|mut file| {
        file.write_all(bytes)?;
        file.sync_all()
    });
    if let Err(error) = written.and_then(|()| fs::rename(&aside, path)) {
        // Only space is at stake here, and the error below is the one to report.
        let _ = fs::remove_file(&aside);
        return Err(error);
    }
    sync_directory(directory)
}

/// Removes what a killed process left aside in a directory.
///
/// # Errors
/// Those of the file system.
pub(super) fn sweep(directory: &Path) -> io::Result<()> {
    for entry in fs::read_dir(directory)? {
        let path = entry?.path();
        if path.is_file() && path.as_os_str().as_encoded_bytes().ends_with(PARTIAL.as_bytes()) {
            fs::remove_file(path)?;
        }
    }
    Ok(())
}

/// Makes renames in a directory durable, where the platform can.
pub(super) fn sync_directory(directory: &Path) -> io::Result<()> {
    if cfg!(unix) { File::open(directory)?.sync_all() } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_content() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("file");
        write(&path, b"old").unwrap();
        // A directory in the place of the file aside makes its creation fail.
        fs::create_dir(directory.path().join("file.partial")).unwrap();
        assert!(write(&path, b"new").is_err());
        assert_eq!(fs::read(&path).unwrap(), b"old");
        fs::remove_dir(directory.path().join("file.partial")).unwrap();
        write(&path, b"new").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 1);
    }
}
