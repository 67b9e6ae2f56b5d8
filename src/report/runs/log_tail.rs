//! The last rows of a `progress.csv`, read from its end: logs grow to many megabytes.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;

/// How much is read at the beginning, for the names of the columns, and at the end; a row takes some 300 bytes.
const HEAD_BYTES: u64 = 4096;
const TAIL_BYTES: u64 = 8192;

/// The last whole rows of a log.
pub(super) struct LogTail {
    columns: csv::StringRecord,
    /// At least one.
    rows: Vec<csv::StringRecord>,
}

impl LogTail {
    /// Reads them; nothing where there is no whole row.
    pub(super) fn read(path: &Path) -> io::Result<Option<Self>> {
        let mut file = File::open(path)?;
        let length = file.metadata()?.len();
        let head = lines(&mut file, 0, HEAD_BYTES)?;
        let Some(columns) = records(&head).next() else { return Ok(None) };
        let tail = lines(&mut file, length.saturating_sub(TAIL_BYTES), TAIL_BYTES)?;
        // What comes first here is the header, or a row that began before.
        let first = tail.iter().position(|&byte| byte == b'\n').map_or(tail.len(), |end| end + 1);
        let rows: Vec<csv::StringRecord> = records(&tail[first..]).filter(|row| row.len() == columns.len()).collect();
        Ok((!rows.is_empty()).then_some(Self { columns, rows }))
    }

    /// A number of the last row.
    pub(super) fn last(&self, column: &str) -> Option<f64> {
        self.number(self.rows.last()?, column)
    }

    /// Timesteps per second from the first to the last of these rows, or that of the log where there is but one.
    pub(super) fn rate(&self) -> Option<f64> {
        let (first, last) = (self.rows.first()?, self.rows.last()?);
        let passed = |column| Some(self.number(last, column)? - self.number(first, column)?);
        let seconds = passed("time/time_elapsed")?;
        if seconds > 0.0 { Some(passed("cumulative_timesteps")? / seconds) } else { self.number(last, "time/fps") }
    }

    fn number(&self, row: &csv::StringRecord, column: &str) -> Option<f64> {
        let at = self.columns.iter().position(|name| name == column)?;
        row.get(at)?.parse().ok()
    }
}

/// The bytes of the whole lines (the first may lack its beginning) from `from` on.
fn lines(file: &mut File, from: u64, most: u64) -> io::Result<Vec<u8>> {
    file.seek(SeekFrom::Start(from))?;
    let mut bytes = Vec::new();
    file.take(most).read_to_end(&mut bytes)?;
    let end = bytes.iter().rposition(|&byte| byte == b'\n').map_or(0, |last| last + 1);
    bytes.truncate(end);
    Ok(bytes)
}

/// The records that can be read.
fn records(bytes: &[u8]) -> impl Iterator<Item = csv::StringRecord> + '_ {
    let reader = csv::ReaderBuilder::new().has_headers(false).flexible(true).from_reader(bytes);
    reader.into_records().filter_map(Result::ok)
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str = "stage,level,cumulative_timesteps,time/time_elapsed,time/fps\n";

    fn tail(text: &str) -> Option<LogTail> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        LogTail::read(file.path()).unwrap()
    }

    #[test]
    fn short_logs_are_read() {
        assert!(tail("").is_none() && tail("stage,lev").is_none() && tail(HEADER).is_none());
        let one = tail(&format!("{HEADER}0,\"a,b\",64,0.5,128\n0,c,12")).unwrap();
        assert_eq!((one.last("cumulative_timesteps"), one.rate()), (Some(64.0), Some(128.0)));
        assert_eq!((one.last("level"), one.last("absent")), (None, None));
    }

    #[test]
    fn only_the_end_of_a_long_log_counts() {
        let row = |i: u64| format!("0,a,{},{}.5,9\n", 100 * i, if i < 5000 { i } else { 5000 + 2 * (i - 5000) });
        let text: String = HEADER.to_owned() + &(0..10_000).map(row).collect::<String>();
        assert!(text.len() as u64 > 5 * TAIL_BYTES);
        let tail = tail(&text).unwrap();
        assert!(tail.rows.len() < 2000);
        assert_eq!((tail.last("cumulative_timesteps"), tail.rate()), (Some(999_900.0), Some(50.0)));
    }
}
