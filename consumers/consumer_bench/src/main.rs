//! The program `gantry-bench`; what it does is in the library.

fn main() -> std::process::ExitCode {
    consumer_bench::main()
}
