//! The program `gantry-drive`; what it does is in the library.

fn main() -> std::process::ExitCode {
    consumer_drive::main()
}
