//! Tests of `launch_spec`: one program for all of them, so that it is linked once.

mod batch_sections;
mod launch_files;
mod page;
mod profiles;
mod schema;
mod several_files;
