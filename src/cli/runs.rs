//! `cpp-rl runs`.

use std::io::{IsTerminal, stdout};
use std::path::PathBuf;
use std::thread::sleep;
use std::time::Duration;

use anyhow::Result;
use clap::Args;
use console::Term;

use super::output::{Reader, offer_stdout, write_stdout};
use crate::report::Format;
use crate::report::runs::Listing;

/// Lines of the screen that are not rows: head, rule, summary, and the cursor's.
const LINES_BESIDE: usize = 4;

/// List runs: status, progress and return.
#[derive(Debug, Args)]
pub struct RunsArgs {
    /// A run's directory, or a folder with runs in it, at most four folders deep.
    #[arg(value_name = "DIR", default_value = "runs")]
    directory: PathBuf,
    /// List again every SECONDS [default: 2] until interrupted, running ones first.
    #[arg(long, value_name = "SECONDS", num_args = 0..=1, default_missing_value = "2",
          value_parser = clap::value_parser!(u32).range(1..=86_400))]
    watch: Option<u32>,
    /// How the list is printed.
    #[arg(long, value_enum, default_value_t = Format::Table)]
    format: Format,
}

impl RunsArgs {
    /// Prints the list, once or again and again.
    ///
    /// # Errors
    /// A folder that cannot be read, and a stdout that cannot be written.
    pub fn run(&self) -> Result<()> {
        let Some(seconds) = self.watch else {
            return write_stdout(&self.render(&Listing::read(&self.directory)?)?);
        };
        // Output that is not a screen is a log: it keeps every list, and all of each.
        let screen = stdout().is_terminal() && self.format == Format::Table;
        loop {
            let mut listing = Listing::read(&self.directory)?;
            listing.live_first();
            let text = if screen { on_screen(&listing) } else { self.render(&listing)? };
            if offer_stdout(&text)? == Reader::Gone {
                return Ok(());
            }
            sleep(Duration::from_secs(seconds.into()));
        }
    }

    fn render(&self, listing: &Listing) -> Result<String> {
        Ok(match self.format {
            Format::Json => serde_json::to_string(listing)? + "\n",
            Format::Csv => listing.full_table().render(Format::Csv),
            format => listing.table(usize::MAX).render(format),
        })
    }
}

/// As much of the list as the screen holds, in place of what it shows.
fn on_screen(listing: &Listing) -> String {
    let (height, width) = Term::stdout().size();
    let table = listing.table(usize::from(height).saturating_sub(LINES_BESIDE)).render(Format::Table);
    let cut = |line: &str| line.chars().take(width.into()).chain(['\n']).collect::<String>();
    // One write that begins with: clear the screen, go to its upper left corner.
    ["\x1b[2J\x1b[H".to_owned()].into_iter().chain(table.lines().map(cut)).collect()
}
