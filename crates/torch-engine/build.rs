//! Lets the program, the tests and the benches find libtorch when they start, without `LD_LIBRARY_PATH`.

use std::{env, fs, path::PathBuf};

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    // Cargo hands what torch-sys's build script says (`libtorch_lib=…`) to its direct dependents alone, which is why
    // Cargo.toml names torch-sys beside tch.
    let Some(lib) = env::var_os("DEP_TCH_LIBTORCH_LIB").map(PathBuf::from) else {
        println!("cargo::rustc-env=TORCH_ENGINE_LIBTORCH=unknown");
        return; // Windows, where libraries are found through PATH.
    };
    let version = lib.parent().and_then(|root| fs::read_to_string(root.join("build-version")).ok());
    println!("cargo::rustc-env=TORCH_ENGINE_LIBTORCH={}", version.as_deref().map_or("unknown", str::trim));
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
