//! The program `gantry-rerun`; what it does is in the library.

fn main() -> std::process::ExitCode {
    consumer_rerun::main()
}
