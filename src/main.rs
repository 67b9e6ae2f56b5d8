//! The command-line tool.

fn main() {
    cpp_rl::cli::main()
}
