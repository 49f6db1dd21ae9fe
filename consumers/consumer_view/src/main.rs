//! The program `gantry-view`; what it does is in the library.

fn main() -> std::process::ExitCode {
    consumer_view::main()
}
