//! The program `gantry`; what it does is in the library.

fn main() -> std::process::ExitCode {
    gantry::main()
}
