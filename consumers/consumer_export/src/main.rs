//! The program `gantry-export`; what it does is in the library.

fn main() -> std::process::ExitCode {
    consumer_export::main()
}
