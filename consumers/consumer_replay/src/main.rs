//! The program `gantry-replay`; what it does is in the library.

fn main() -> std::process::ExitCode {
    consumer_replay::main()
}
