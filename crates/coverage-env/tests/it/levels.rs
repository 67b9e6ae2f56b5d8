//! Reading levels, and what is said about those that cannot be read.

use std::path::Path;

use coverage_env::level::MAX_FILE_BYTES;
use coverage_env::{Action, BUILTIN_IDS, Cell, Level, LevelDefect};
use proptest::prelude::*;

use crate::support::levels;

#[test]
fn the_built_in_levels_are_the_papers() {
    let counts = |id: &str| {
        let level = Level::builtin(id).expect("a valid level");
        assert_eq!((level.name(), level.height(), level.width()), (id, 8, 8));
        (level.targets().len(), level.starts().len())
    };
    assert_eq!(BUILTIN_IDS.map(counts), [(8, 55), (9, 50), (7, 48), (7, 46), (6, 41)]);
    assert!(Level::builtin("5").is_none());
}

#[test]
fn a_file_may_name_its_level() {
    let read = |yaml: &[u8]| Level::from_yaml("maps/two rooms.yaml", yaml).unwrap();
    let plain = read(b"map: |\n  .T\n  ##\n");
    assert_eq!(plain.name(), "two rooms");
    assert_eq!(plain.to_map(), ".T\n##\n");
    assert_eq!(read(b"# a comment\nname: 7\nmap: |\n  .T\n").name(), "7");
    // Editors on other systems: CRLF, a byte order mark, no final line break, blank lines.
    let other = read(b"\xEF\xBB\xBFname: two rooms\r\nmap: |\r\n\r\n  .T\r\n  ##\r\n\r\n");
    assert_eq!(other, plain);
    assert_eq!(read(b"map: |\n  .T\n  ##"), plain);
}

#[test]
fn moves_stop_at_walls_and_edges() {
    let level = Level::from_map("room", "..#\nT..").unwrap();
    let moves = |cell: usize| Action::ALL.map(|action| level.neighbor(cell, action));
    assert_eq!(moves(0), [3, 0, 1, 0]);
    assert_eq!(moves(1), [4, 1, 1, 0]);
    assert_eq!(moves(2), [2; 4]);
    assert_eq!(moves(5), [5, 5, 5, 4]);
    assert_eq!(level.index(1, 2), Some(5));
    assert_eq!((level.index(2, 0), level.index(0, 3)), (None, None));
    assert_eq!(level.cell(2), Cell::Wall);
}

/// The whole message, since it is what the user gets: place and remedy.
#[test]
fn map_errors_say_where_and_what_to_do() {
    let error = |map: &str| Level::from_map("m", map).unwrap_err().to_string();
    assert_eq!(
        error("..T\n.x.\n"),
        "m: row 2, column 2: unknown character 'x'; use '.' (free), '#' (wall) or 'T' (target)"
    );
    assert_eq!(
        error("..T\n.. \n"),
        "m: row 2, column 3: unknown character ' '; use '.' (free), '#' (wall) or 'T' (target)"
    );
    assert_eq!(
        error("..T\n..\n"),
        "m: row 2, column 3: the row has 2 cells and the first row has 3; make all rows equally long"
    );
    assert_eq!(
        error("..T\n\n..T\n"),
        "m: row 2, column 1: the row has 0 cells and the first row has 3; make all rows equally long"
    );
    assert_eq!(error("\n"), "m: the map is empty; write rows of '.' (free), '#' (wall) and 'T' (target)");
    assert_eq!(error("..#"), "m: the map has no target; mark the cells to visit with 'T'");
    assert_eq!(error("T#"), "m: the map has no start cell; leave at least one cell free ('.')");
    assert_eq!(
        error("..T#\n####\n...T\n###.\nTT#."),
        "m: row 5, column 1: no start cell can reach this target; open a way to it, or make it a wall ('#')"
    );
    assert_eq!(
        error(".#.T\n##.T"),
        "m: row 1, column 1: this free cell is a start that cannot reach the target at row 1, column 4; \
         make it a wall ('#'), or open a way"
    );
    assert_eq!(
        error(&".".repeat(1 << 15)),
        "m: the map has more than 16384 cells (height times width); make it smaller"
    );
}

#[test]
fn names_are_fit_for_paths() {
    for name in ["", "  ", "a/b", "..\\c", "tab\t", &"long".repeat(26)] {
        let error = Level::from_map(name, ".T").unwrap_err().to_string();
        assert!(error.contains("choose another"), "{error}");
    }
}

#[test]
fn file_errors_say_where_and_what_to_do() {
    let error = |bytes: &[u8]| Level::from_yaml("a.yaml", bytes).unwrap_err().to_string();
    let no_map = "a.yaml: no map; add a `map: |` block with indented rows of '.', '#' and 'T'";
    assert_eq!(error(b""), no_map);
    assert_eq!(error(b"# only a comment\n"), no_map);
    assert_eq!(error(b"name: x\n"), no_map);
    assert_eq!(error(b"map:\n"), no_map);
    let not_utf8 = "a.yaml: line 2: not UTF-8 text; save the file in the encoding UTF-8";
    assert_eq!(error(b"map: |\n  .\xE4T\n"), not_utf8);
    assert_eq!(error(b"map: |\n  .\0T\n"), not_utf8);
    let form = "; a level is a `map: |` block of '.', '#' and 'T', and optionally a `name:`";
    for (bytes, says) in [
        (&b"mapp: |\n  .T\n"[..], "mapp"),
        (b"map: [1, 2]\n", "line 1"),
        (b"map: |\n  .T\nmap: |\n  .T\n", "line 3"),
        (b"map: |\n  .T\n oops\n", "line 3"),
        (b"- .T\n", "line 1"),
        (b".T\n..\n", "line 1"),
    ] {
        let error = error(bytes);
        assert!(error.starts_with("a.yaml: ") && error.ends_with(form), "{error}");
        assert!(error.contains(says) && !error.contains('\n'), "{error}");
    }
    let large = vec![b'#'; MAX_FILE_BYTES as usize + 1];
    assert!(error(&large).contains("larger than"));
}

#[test]
fn a_level_is_an_id_or_a_path() {
    let levels = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../levels");
    let path = levels.join("3.yaml");
    let level = Level::from_path(&path).unwrap();
    assert_eq!(Some(&level), Level::builtin("3").as_ref());
    assert_eq!(Level::resolve(&path.to_string_lossy()).unwrap(), level);
    assert_eq!(Level::resolve("3").unwrap(), level);
    assert_eq!(
        Level::resolve("no such level").unwrap_err().to_string(),
        "no such level: neither a built-in level (0, 1, 2, 3, 4) nor an existing file; give one of these ids or \
         the path of a level's YAML file"
    );
    let folder = Level::resolve(&levels.to_string_lossy()).unwrap_err().to_string();
    assert!(folder.contains("cannot be read"), "{folder}");
}

proptest! {
    #[test]
    fn levels_survive_being_written(level in levels(5), name in "\\PC{1,20}|[a-z \"':#-]{1,9}|[0-4]") {
        let map = level.to_map();
        prop_assert_eq!(&Level::from_map(level.name(), &map)?, &*level);
        if let Ok(named) = Level::from_map(name, &map) {
            let read = Level::from_yaml("x.yaml", named.to_yaml().as_bytes());
            if Level::builtin(named.name()).is_some() {
                let error = read.expect_err("no built-in level is as small");
                prop_assert!(matches!(error.defect(), LevelDefect::TakenName { .. }), "{}", error);
            } else {
                prop_assert_eq!(&read?, &named);
            }
        }
    }

    #[test]
    fn any_bytes_are_a_level_or_an_error(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        let _ = Level::from_yaml("a.yaml", &bytes);
    }

    /// Nearly valid files reach deeper than arbitrary bytes do.
    #[test]
    fn any_text_is_a_level_or_an_error(map in "[.#T\n x\u{e9}:|-]{0,60}", key in "(map|name|m)?") {
        let _ = Level::from_map("m", &map);
        let indented = map.replace('\n', "\n  ");
        for yaml in [format!("{key}: |\n  {indented}"), format!("{key}: {map}"), format!("map: {map:?}")] {
            if let Err(error) = Level::from_yaml("a.yaml", yaml.as_bytes()) {
                prop_assert!(error.to_string().starts_with("a.yaml: "));
            }
        }
    }
}

#[test]
fn the_names_of_built_in_levels_are_taken() {
    let error = Level::from_yaml("mine/3.yaml", b"map: |\n  T.\n").expect_err("another map");
    assert!(matches!(error.defect(), LevelDefect::TakenName { name } if name == "3"), "{error}");
    assert!(error.to_string().contains("mine/3.yaml") && error.to_string().contains("`name:`"), "{error}");
    let builtin = Level::builtin("3").expect("a built-in level");
    assert_eq!(Level::from_yaml("elsewhere/3.yaml", builtin.to_yaml().as_bytes()).expect("the same map"), builtin);
    assert!(Level::from_yaml("mine/3.yaml", b"name: mine\nmap: |\n  T.\n").is_ok());
}
