//! The rooms of ARCHITECTURE.md hold: what each may not import, and no circles.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// The source files below a folder of the repository.
fn sources(folder: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut folders = vec![Path::new(crate::ROOT).join(folder)];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display())) {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                found.push(path);
            }
        }
    }
    assert!(!found.is_empty(), "{folder} has sources");
    found
}

/// What a file has before its tests, without comments.
fn code(path: &Path) -> String {
    let text = fs::read_to_string(path).expect("a source file");
    let before_tests = text.split("#[cfg(test)]\nmod tests").next().unwrap_or_default();
    before_tests.lines().filter(|line| !line.trim_start().starts_with("//")).map(|line| format!("{line}\n")).collect()
}

/// Fails for every file below `folder` that has one of these words.
fn never(folder: &str, words: &[&str]) {
    for path in sources(folder) {
        let code = code(&path);
        for word in words {
            assert!(!code.contains(word), "{} has {word:?}, which ARCHITECTURE.md rules out", path.display());
        }
    }
}

#[test]
fn rooms_keep_to_themselves() {
    never("src/report", &["crate::agent"]);
    never("src/agent", &["std::fs", "println!", "std::io", "tracing::", "crate::run", "crate::training", "crate::cli"]);
    never("src/config", &["crate::agent", "Ppo", "Dqn", "redo", "l2_coef"]);
    never("src/agent/mitigation", &["FusedEngine", "bit_mlp::forward", "Workspace"]);
    never("src/measure", &["crate::run", "crate::training", "crate::report"]);
    for folder in ["src", "crates/coverage-env/src", "crates/bit-mlp/src", "crates/rl-stats/src", "crates/charts/src"] {
        never(folder, &["use tch", " tch::", "(tch::", "torch_sys"]);
    }
    never("crates/coverage-env/src", &["bit_mlp", "cpp_rl"]);
    never("crates/bit-mlp/src", &["coverage_env", "cpp_rl"]);
}

#[test]
fn only_torch_engine_depends_on_libtorch() {
    let manifests = ["Cargo.toml", "python/Cargo.toml"].map(|name| Path::new(crate::ROOT).join(name));
    let crates = fs::read_dir(Path::new(crate::ROOT).join("crates")).expect("the crates");
    let of_crates = crates.map(|entry| entry.expect("a crate").path().join("Cargo.toml"));
    for manifest in manifests.into_iter().chain(of_crates.filter(|path| path.is_file())) {
        let text = fs::read_to_string(&manifest).expect("a manifest");
        let links = text.lines().any(|line| line.starts_with("tch") || line.starts_with("torch-"));
        assert_eq!(links, manifest.to_string_lossy().contains("torch-engine"), "{}", manifest.display());
    }
}

/// The module of a file: `src/agent/ppo/mod.rs` is `agent::ppo`; `lib.rs` is nothing.
fn module(root: &Path, path: &Path) -> Vec<String> {
    let below = path.strip_prefix(root).expect("below the root").with_extension("");
    let mut parts: Vec<String> = below.iter().map(|part| part.to_string_lossy().into_owned()).collect();
    if parts.last().is_some_and(|last| ["mod", "lib"].contains(&last.as_str())) {
        parts.pop();
    }
    parts
}

/// The paths in the `use` items of some code, lists written out: `a::{b, c::d}` is `a::b` and `a::c::d`.
fn used(code: &str) -> Vec<Vec<String>> {
    let item = |text: &str| {
        text.split_once(';').map(|(item, _)| {
            item.split_whitespace().collect::<Vec<_>>().join(" ").replace(" as ", "@").replace(' ', "")
        })
    };
    let starts = code.match_indices("use ").filter(|(at, _)| {
        let line = code[..*at].rsplit('\n').next().unwrap_or_default();
        // `pub use` hands a name on to those above; it is no dependency.
        line.trim().is_empty()
    });
    starts.filter_map(|(at, _)| item(&code[at + 4..])).flat_map(|item| written_out(&item)).collect()
}

fn written_out(path: &str) -> Vec<Vec<String>> {
    let Some((before, list)) = path.split_once('{') else {
        return vec![path.split("::").map(|part| part.split('@').next().unwrap_or(part).to_owned()).collect()];
    };
    let (mut depth, mut entries) = (0, vec![String::new()]);
    for c in list.strip_suffix('}').expect("a closed list").chars() {
        depth += i32::from(c == '{') - i32::from(c == '}');
        match (c, depth) {
            (',', 0) => entries.push(String::new()),
            _ => entries.last_mut().expect("one at least").push(c),
        }
    }
    let before: Vec<String> = before.trim_end_matches("::").split("::").map(str::to_owned).collect();
    let entries = entries.iter().filter(|entry| !entry.is_empty());
    entries.flat_map(|entry| written_out(entry)).map(|rest| [before.clone(), rest].concat()).collect()
}

/// Which modules of a crate each module names in its `use` items; a parent that only declares its children names none.
fn imports(root: &Path) -> BTreeMap<Vec<String>, BTreeSet<Vec<String>>> {
    let files = sources(&root.strip_prefix(crate::ROOT).expect("in the repository").to_string_lossy());
    let modules: BTreeSet<Vec<String>> = files.iter().map(|path| module(root, path)).collect();
    let of_file = |path: &PathBuf| {
        let from = module(root, path);
        let absolute = |path: Vec<String>| match path[0].as_str() {
            "crate" => Some(path[1..].to_vec()),
            "self" => Some([from.clone(), path[1..].to_vec()].concat()),
            "super" => {
                let ups = path.iter().take_while(|part| *part == "super").count();
                let kept = from.len().checked_sub(ups)?;
                Some([from[..kept].to_vec(), path[ups..].to_vec()].concat())
            }
            first => {
                let child = [from.clone(), vec![first.to_owned()]].concat();
                modules.contains(&child).then(|| [from.clone(), path.clone()].concat())
            }
        };
        let file_of = |path: Vec<String>| {
            let lengths = (0..=path.len()).rev();
            lengths.map(|length| path[..length].to_vec()).find(|module| modules.contains(module))
        };
        let to = used(&code(path)).into_iter().filter_map(absolute).filter_map(file_of);
        // A module and what is declared in it are one room.
        let to = to.filter(|to| !to.starts_with(&from) && !from.starts_with(to)).collect();
        (from, to)
    };
    files.iter().map(of_file).collect()
}

#[test]
fn no_modules_import_each_other_in_a_circle() {
    for root in ["src", "crates/coverage-env/src", "crates/bit-mlp/src", "crates/rl-stats/src", "crates/charts/src"] {
        let imports = imports(&Path::new(crate::ROOT).join(root));
        let arrows: usize = imports.values().map(BTreeSet::len).sum();
        assert!(arrows >= imports.len() / 2, "{root}: imports are found");
        for start in imports.keys() {
            let mut next = vec![vec![start]];
            let mut reached = BTreeSet::new();
            while let Some(way) = next.pop() {
                for other in imports.get(way[way.len() - 1]).into_iter().flatten() {
                    let way = [way.clone(), vec![other]].concat();
                    let names = || way.iter().map(|module| module.join("::")).collect::<Vec<_>>().join(" → ");
                    assert!(other != start, "{root}: a circle: {}", names());
                    if reached.insert(other) {
                        next.push(way);
                    }
                }
            }
        }
    }
}

#[test]
fn lists_of_imports_are_written_out() {
    let code = "use a::b;\nuse c::{d, e::{f, g as h}};\n    use super::i::{self};\npub use j::k;\n";
    let paths: Vec<String> = used(code).into_iter().map(|path| path.join("::")).collect();
    assert_eq!(paths, ["a::b", "c::d", "c::e::f", "c::e::g", "super::i::self"]);
}
