//! The program `gantry-dataset`; what it does is in the library.

fn main() -> std::process::ExitCode {
    consumer_dataset::main()
}
