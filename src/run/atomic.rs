//! Files that appear whole or not at all.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::Path;

/// What is appended to the name of a file while it is written aside.
const PARTIAL: &str = ".partial";

/// Replaces `path` by `bytes`: written aside, synced, renamed, and the directory synced.
///
/// Whatever the moment of a crash, the old content or the new one is there.
///
/// # Errors
/// Those of the file system. The old content then still stands, unless all that failed was to make the new one durable.
pub fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    write_with(path, |file| file.write_all(bytes))
}

/// The same of what `content` writes, so that a large file need not be in memory as a whole.
///
/// # Errors
/// Those of the file system, and of `content`.
pub fn write_with(path: &Path, content: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>) -> io::Result<()> {
    let directory = parent(path);
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(PARTIAL);
    let aside = directory.join(name);
    let written = File::create(&aside).and_then(|file| {
        let mut file = BufWriter::new(file);
        content(&mut file)?;
        file.into_inner()?.sync_all()
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

/// Makes a directory, and those above it that are missing, each of them durable.
///
/// # Errors
/// Those of the file system.
pub(super) fn create_directories(path: &Path) -> io::Result<()> {
    // A relative path's last ancestor is the empty path.
    let absent = |ancestor: &&Path| !ancestor.as_os_str().is_empty() && !ancestor.exists();
    let missing: Vec<&Path> = path.ancestors().take_while(absent).collect();
    fs::create_dir_all(path)?;
    missing.into_iter().try_for_each(|made| sync_directory(parent(made)))
}

/// The directory that a path is in.
fn parent(path: &Path) -> &Path {
    // That of a bare name is the empty path.
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Makes renames in a directory durable, where the platform can.
pub(super) fn sync_directory(directory: &Path) -> io::Result<()> {
    if cfg!(unix) { File::open(directory)?.sync_all() } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directories_are_made_where_they_are_missing() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a/b/c");
        for _ in 0..2 {
            create_directories(&path).unwrap();
            assert!(path.is_dir());
        }
        fs::write(directory.path().join("file"), "").unwrap();
        assert!(create_directories(&directory.path().join("file/a")).is_err());
    }

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
