//! The program `gantry-record`; what it does is in the library.

fn main() -> std::process::ExitCode {
    consumer_record::main()
}
