//! Names the library by the version of its interface, so that a program built with another one is
//! refused by the loader.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rustc-cdylib-link-arg=-Wl,-soname,libgantry.so.1");
}
