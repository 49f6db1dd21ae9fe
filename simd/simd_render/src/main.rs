//! The program `gantry-render`; what it does is in the library.

fn main() -> std::process::ExitCode {
    simd_render::main()
}
