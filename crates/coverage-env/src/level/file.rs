//! Levels as YAML files, and those that are built in.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

use serde::Deserialize;

use super::{Level, LevelDefect, LevelError};

/// The ids of the built-in levels, the paper's five; its Table 1 calls them 1 to 5.
pub const BUILTIN_IDS: [&str; 5] = ["0", "1", "2", "3", "4"];

/// The largest level file that is read; a map of the most cells, one per indented row, fits.
pub const MAX_FILE_BYTES: u64 = 1 << 20;

const BUILTIN_FILES: [&[u8]; BUILTIN_IDS.len()] = [
    include_bytes!("../../../../levels/0.yaml"),
    include_bytes!("../../../../levels/1.yaml"),
    include_bytes!("../../../../levels/2.yaml"),
    include_bytes!("../../../../levels/3.yaml"),
    include_bytes!("../../../../levels/4.yaml"),
];

/// A level file, key by key.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct LevelFile {
    name: Option<String>,
    map: Option<String>,
}

impl Level {
    /// The built-in level called `id`, one of [`BUILTIN_IDS`].
    pub fn builtin(id: &str) -> Option<Level> {
        let index = BUILTIN_IDS.iter().position(|&builtin| builtin == id)?;
        parse_file(id, BUILTIN_FILES[index]).ok()
    }

    /// The built-in level of that id, or else the level in the file at that path.
    ///
    /// A file that is called like a built-in id is reached as `./0`.
    ///
    /// # Errors
    /// [`LevelError`] as for [`from_path`](Level::from_path), and [`LevelDefect::Unknown`] if there
    /// is neither.
    pub fn resolve(id_or_path: &str) -> Result<Level, LevelError> {
        if let Some(level) = Level::builtin(id_or_path) {
            return Ok(level);
        }
        Level::from_path(Path::new(id_or_path)).map_err(|error| match error.defect() {
            LevelDefect::Unreadable { error: cause } if cause.kind() == io::ErrorKind::NotFound => {
                LevelError::new(id_or_path, LevelDefect::Unknown)
            }
            _ => error,
        })
    }

    /// The level in the YAML file at `path`, called as its `name` says or else as the file's stem.
    ///
    /// # Errors
    /// [`LevelError`] if the file cannot be read or is larger than [`MAX_FILE_BYTES`], and as for
    /// [`from_yaml`](Level::from_yaml).
    pub fn from_path(path: &Path) -> Result<Level, LevelError> {
        let source = path.display().to_string();
        let fail = |defect| Err(LevelError::new(source.clone(), defect));
        let mut bytes = Vec::new();
        // Reads no more than one byte too many of a file that may have no end.
        let read = File::open(path).and_then(|file| file.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes));
        match read {
            Err(error) => fail(LevelDefect::Unreadable { error }),
            Ok(length) if length as u64 > MAX_FILE_BYTES => fail(LevelDefect::FileTooLarge),
            Ok(_) => Level::from_yaml(&source, &bytes),
        }
    }

    /// The level in the text of a YAML file: a `map: |` block and, optionally, a `name`.
    ///
    /// `source` is the file's name, for errors; without a `name`, its stem names the level. Lines
    /// may end in LF or CRLF, and a byte order mark may come first.
    ///
    /// # Errors
    /// [`LevelError`] with `source` as its origin if the bytes are too many, not UTF-8, not YAML or
    /// not of this form, if the map breaks a level's [guarantees](Level#guarantees), or if the name is a
    /// built-in level's and the map is not.
    pub fn from_yaml(source: &str, bytes: &[u8]) -> Result<Level, LevelError> {
        parse_file(source, bytes).and_then(refuse_taken_name).map_err(|defect| LevelError::new(source, defect))
    }

    /// The text of a file from which [`from_yaml`](Level::from_yaml) reads an equal level.
    pub fn to_yaml(&self) -> String {
        // Of what double quotes give a meaning to, a name can have but the quotes themselves.
        let name = self.name().replace('"', "\\\"");
        let rows: String = self.to_map().lines().map(|row| format!("  {row}\n")).collect();
        format!("name: \"{name}\"\nmap: |\n{rows}")
    }
}

fn parse_file(source: &str, bytes: &[u8]) -> Result<Level, LevelDefect> {
    if bytes.len() as u64 > MAX_FILE_BYTES {
        return Err(LevelDefect::FileTooLarge);
    }
    let text = utf8(bytes)?;
    let options = serde_saphyr::options! { with_snippet: false };
    let file: Option<LevelFile> = serde_saphyr::from_str_with_options(text, options).map_err(|error| {
        LevelDefect::Yaml { message: error.render_with_formatter(&serde_saphyr::UserMessageFormatter) }
    })?;
    let file = file.unwrap_or(LevelFile { name: None, map: None });
    let map = file.map.ok_or(LevelDefect::NoMap)?;
    let stem = || Path::new(source).file_stem().unwrap_or_default().to_string_lossy().into_owned();
    Level::parse(&file.name.unwrap_or_else(stem), &map)
}

/// Refuses a level that could be taken for a built-in one.
fn refuse_taken_name(level: Level) -> Result<Level, LevelDefect> {
    match Level::builtin(level.name()) {
        Some(builtin) if builtin != level => Err(LevelDefect::TakenName { name: level.name().to_owned() }),
        _ => Ok(level),
    }
}

/// The text of `bytes` without its byte order mark. NUL is valid UTF-8, yet in a file it means
/// UTF-16 or no text at all.
fn utf8(bytes: &[u8]) -> Result<&str, LevelDefect> {
    let bytes = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
    let first_bad = match std::str::from_utf8(bytes) {
        Ok(text) => match text.find('\0') {
            None => return Ok(text),
            Some(nul) => nul,
        },
        Err(error) => error.valid_up_to(),
    };
    let line = bytes[..first_bad].iter().filter(|&&byte| byte == b'\n').count();
    Err(LevelDefect::NotUtf8 { line })
}
