//! How a process ends: exit codes as a type. An error is printed once; a broken pipe is no error.

use std::io::ErrorKind;
use std::process::ExitCode;

/// Outcome of a program that did not fail with an error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// Done, also after Ctrl-C: 0.
    Done,
    /// Failed, and the reason has been printed: 1.
    Failed,
    /// Wrong usage or launch file, and the reason has been printed: 2.
    WrongUsage,
    /// Finished, but data was lost: 3.
    DataLost,
    /// The GPU was lost or hangs, and the reason has been printed: 4. A new start may find it again.
    GpuLost,
    /// The exit code of a child process, passed on.
    Code(u8),
}

impl Exit {
    /// The exit code.
    pub fn code(self) -> u8 {
        match self {
            Exit::Done => 0,
            Exit::Failed => 1,
            Exit::WrongUsage => 2,
            Exit::DataLost => 3,
            Exit::GpuLost => 4,
            Exit::Code(code) => code,
        }
    }
}

/// An error that the caller can mend. It ends the program with 2 instead of 1.
#[derive(Debug)]
pub struct WrongUsage(pub String);

impl std::fmt::Display for WrongUsage {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for WrongUsage {}

/// An error that ends the program with 2: wrong usage, a wrong launch file, or a machine that lacks
/// what the program needs.
pub fn wrong_usage(sentence: impl std::fmt::Display) -> anyhow::Error {
    anyhow::Error::new(WrongUsage(sentence.to_string()))
}

/// The GPU ended a run. It ends the program with 4 instead of 1.
#[derive(Debug)]
pub struct GpuLost(pub String);

impl std::fmt::Display for GpuLost {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for GpuLost {}

/// Parses the command line ([`crate::parse`]) and runs `body` under [`run_main`].
pub fn run<T: clap::Parser>(body: impl FnOnce(T) -> anyhow::Result<Exit>) -> ExitCode {
    run_main(|| body(crate::parse()))
}

/// Runs `body` and turns its outcome into an exit code; an error is printed once, as one line, with
/// its whole chain.
pub fn run_main(body: impl FnOnce() -> anyhow::Result<Exit>) -> ExitCode {
    forgive_broken_pipes_of_println();
    crate::limits::heed_file_size_limit();
    match body() {
        Ok(exit) => exit.code().into(),
        Err(error) => {
            let exit = exit_of(&error);
            if exit != Exit::Done {
                eprintln!("error: {error:#}");
            }
            exit.code().into()
        }
    }
}

fn exit_of(error: &anyhow::Error) -> Exit {
    let is_broken_pipe = |cause: &(dyn std::error::Error + 'static)| {
        cause
            .downcast_ref::<std::io::Error>()
            .is_some_and(|error| error.kind() == ErrorKind::BrokenPipe)
    };
    if error.chain().any(is_broken_pipe) {
        Exit::Done
    } else if error.chain().any(|cause| cause.is::<WrongUsage>()) {
        Exit::WrongUsage
    } else if error.chain().any(|cause| cause.is::<GpuLost>()) {
        Exit::GpuLost
    } else {
        Exit::Failed
    }
}

/// Ends the program with success when `println!` panics because its reader has closed the pipe, as
/// `| head` does.
fn forgive_broken_pipes_of_println() {
    let report = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        let text = panic
            .payload()
            .downcast_ref::<String>()
            .map_or("", String::as_str);
        if text.starts_with("failed printing to stdout") && text.contains("Broken pipe") {
            std::process::exit(Exit::Done.code().into());
        }
        report(panic);
    }));
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyhow::Context as _;

    #[test]
    fn the_kind_of_error_decides_the_exit_code() {
        let failed = anyhow::anyhow!("no such thing").context("cannot do it");
        assert_eq!(exit_of(&failed).code(), 1);
        let usage = Err::<(), _>(wrong_usage("no such key"))
            .context("launch file")
            .unwrap_err();
        assert_eq!(exit_of(&usage).code(), 2);
        assert_eq!(format!("{usage:#}"), "launch file: no such key");
        let lost = Err::<(), _>(anyhow::Error::new(GpuLost("it is gone".into())))
            .context("cannot render")
            .unwrap_err();
        assert_eq!(exit_of(&lost).code(), 4);
        let pipe = anyhow::Error::from(std::io::Error::from(ErrorKind::BrokenPipe))
            .context("cannot print");
        assert_eq!(exit_of(&pipe).code(), 0);
    }
}
