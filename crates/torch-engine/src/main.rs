//! cpp-rl with `engine=libtorch`: the same command line, with libtorch linked in.

fn main() {
    cpp_rl::agent::engine::install(&torch_engine::LIBTORCH);
    cpp_rl::cli::main()
}
