//! The program `simd`; what it does is in the library.

fn main() -> std::process::ExitCode {
    simd::main()
}
