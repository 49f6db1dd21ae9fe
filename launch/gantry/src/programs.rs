//! What other programs answer.

use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::Context as _;

pub use launch_cli::programs::{
    Search, find, find_from, in_source_tree, is_ours, is_program, takes_domain,
};

/// The folder in which this program and those beside it lie.
pub fn own_folder() -> std::io::Result<PathBuf> {
    let own = std::env::current_exe()?;
    Ok(own.parent().unwrap_or(&own).to_owned())
}

/// What a program prints to stdout; an error if it does not end `within` the time.
pub fn output_of(program: &Path, args: &[&str], within: Duration) -> anyhow::Result<String> {
    let mut child = Command::new(program)
        .args(args)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .with_context(|| format!("cannot start {}", program.display()))?;
    let mut pipe = child.stdout.take().expect("stdout is piped");
    let reader = std::thread::spawn(move || {
        let mut text = Vec::new();
        // Output that came before a read error is still worth showing.
        let _ = pipe.read_to_end(&mut text);
        String::from_utf8_lossy(&text).into_owned()
    });
    let start = Instant::now();
    while child
        .try_wait()
        .context("cannot wait for a program")?
        .is_none()
    {
        if start.elapsed() > within {
            let _ = child.kill();
            let _ = child.wait();
            anyhow::bail!(
                "{} gave no answer within {} s",
                program.display(),
                within.as_secs()
            );
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    reader
        .join()
        .map_err(|_| anyhow::anyhow!("the thread that read from {} failed", program.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn programs_that_hang_are_given_up() {
        assert_eq!(
            output_of(
                Path::new("/bin/sh"),
                &["-c", "echo yes"],
                Duration::from_secs(60)
            )
            .unwrap(),
            "yes\n"
        );
        assert!(
            output_of(
                Path::new("/bin/sh"),
                &["-c", "exec sleep 1000"],
                Duration::from_millis(50)
            )
            .is_err()
        );
    }
}
