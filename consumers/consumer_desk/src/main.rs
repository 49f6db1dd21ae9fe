//! The program `gantry-desk`; what it does is in the library.

fn main() -> std::process::ExitCode {
    consumer_desk::main()
}
