//! The program `gantry-carla`; what it does is in the library.

fn main() -> std::process::ExitCode {
    consumer_carla::main()
}
