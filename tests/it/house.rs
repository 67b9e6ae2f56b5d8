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
        never(folder, &["tch::", "torch_sys"]);
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

/// The module of a file: `src/agent/ppo/mod.rs` is `agent::ppo`.
fn module(path: &Path) -> String {
    let below = path.strip_prefix(Path::new(crate::ROOT).join("src")).expect("below src").with_extension("");
    let parts: Vec<String> = below.iter().map(|part| part.to_string_lossy().into_owned()).collect();
    let parts = if parts.last().is_some_and(|last| last == "mod") { &parts[..parts.len() - 1] } else { &parts[..] };
    parts.join("::")
}

/// The first two names of a module: the room, and the room within.
fn room(module: &str) -> String {
    module.split("::").take(1).collect::<Vec<_>>().join("::")
}

/// The rooms that each room imports.
fn imports() -> BTreeMap<String, BTreeSet<String>> {
    let mut imports: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for path in sources("src") {
        let from = room(&module(&path));
        if ["lib", "main", ""].contains(&from.as_str()) {
            continue;
        }
        for (at, _) in code(&path).match_indices("crate::") {
            let code = code(&path);
            let rest = &code[at + "crate::".len()..];
            let names = if let Some(list) = rest.strip_prefix('{') {
                list.split('}').next().unwrap_or_default().split(',').map(|name| name.trim().to_owned()).collect()
            } else {
                vec![rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect::<String>()]
            };
            let names = names.into_iter().map(|name| name.split("::").next().unwrap_or_default().to_owned());
            imports.entry(from.clone()).or_default().extend(names.filter(|name| *name != from && !name.is_empty()));
        }
    }
    imports
}

#[test]
fn no_rooms_import_each_other_in_a_circle() {
    let imports = imports();
    assert!(imports["cli"].contains("training") && imports["run"].contains("agent"), "imports are found");
    for start in imports.keys() {
        let (mut reached, mut next) = (BTreeSet::new(), vec![start]);
        while let Some(room) = next.pop() {
            for other in imports.get(room).into_iter().flatten() {
                assert!(other != start, "{start} imports {room}, which imports {start} again");
                if reached.insert(other) {
                    next.push(other);
                }
            }
        }
    }
}
