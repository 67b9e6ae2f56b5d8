//! Lets the binary, the tests and the benches find libtorch when they start, without `LD_LIBRARY_PATH`.

use std::{env, fs, path::PathBuf, process::Command};

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    // Manifests record the commit, and whether the sources differ from it.
    for path in ["src", "crates", "configs", "levels", "Cargo.toml", "Cargo.lock"] {
        println!("cargo::rerun-if-changed={path}");
    }
    if let Some(log) = git(&["rev-parse", "--git-path", "logs/HEAD"]) {
        println!("cargo::rerun-if-changed={log}");
    }
    let commit = git(&["describe", "--always", "--dirty", "--abbrev=12"]);
    println!("cargo::rustc-env=CPP_RL_GIT={}", commit.as_deref().unwrap_or("unknown"));
    // Cargo hands what torch-sys's build script says (`libtorch_lib=…`) to its direct dependents alone, which is why
    // Cargo.toml names torch-sys beside tch.
    let Some(lib) = env::var_os("DEP_TCH_LIBTORCH_LIB").map(PathBuf::from) else {
        println!("cargo::rustc-env=CPP_RL_LIBTORCH=unknown");
        return; // Windows, where libraries are found through PATH.
    };
    let version = lib.parent().and_then(|root| fs::read_to_string(root.join("build-version")).ok());
    println!("cargo::rustc-env=CPP_RL_LIBTORCH={}", version.as_deref().map_or("unknown", str::trim));
    // Two `-Xlinker` rather than one `-Wl,-rpath,…`: a comma in the path stays part of it.
    link_args(&["-Xlinker", "-rpath", "-Xlinker", lib.to_str().expect("libtorch's path is UTF-8")]);
    // The code calls nothing in libtorch_cuda: it registers itself when it is loaded, and a linker that drops libraries
    // without a called symbol (`--as-needed`, rustc's default) would leave a build that sees no GPU.
    for name in ["torch_cuda", "torch_hip"] {
        if lib.join(format!("lib{name}.so")).exists() {
            link_args(&["-Wl,--push-state,--no-as-needed", &format!("-l{name}"), "-Wl,--pop-state"]);
        }
    }
}

fn link_args(args: &[&str]) {
    for arg in args {
        println!("cargo::rustc-link-arg={arg}");
    }
}

/// What git prints, or nothing where there is no git or no repository.
fn git(args: &[&str]) -> Option<String> {
    let output = Command::new("git").args(args).output().ok().filter(|output| output.status.success())?;
    Some(String::from_utf8(output.stdout).ok()?.trim().to_owned())
}
