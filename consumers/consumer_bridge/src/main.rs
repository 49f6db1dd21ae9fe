//! The program `gantry-bridge`; what it does is in the library.

fn main() -> std::process::ExitCode {
    consumer_bridge::main()
}
