//! `gantry doctor`: what this machine lacks, with the command that repairs it. Looks only; changes
//! nothing.

mod graphics;
mod machine;
mod python;

use std::io::{IsTerminal as _, Read as _};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use launch_cli::{ColorWhen, CommonArgs, Exit};

use crate::cli::DoctorArgs;

/// How bad it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Grade {
    Ok,
    /// Something is slower or missing that one can live without.
    Warn,
    /// The simulator will not run.
    Fail,
}

/// One thing that was looked at.
#[derive(Debug)]
pub struct Finding {
    pub what: &'static str,
    pub grade: Grade,
    pub text: String,
    /// What to do; empty if nothing.
    pub fix: String,
}

impl Finding {
    pub fn ok(what: &'static str, text: impl Into<String>) -> Self {
        Finding {
            what,
            grade: Grade::Ok,
            text: text.into(),
            fix: String::new(),
        }
    }

    pub fn warn(what: &'static str, text: impl Into<String>, fix: impl Into<String>) -> Self {
        Finding {
            what,
            grade: Grade::Warn,
            text: text.into(),
            fix: fix.into(),
        }
    }

    pub fn fail(what: &'static str, text: impl Into<String>, fix: impl Into<String>) -> Self {
        Finding {
            what,
            grade: Grade::Fail,
            text: text.into(),
            fix: fix.into(),
        }
    }
}

pub fn run(args: &DoctorArgs, common: &CommonArgs) -> anyhow::Result<Exit> {
    let mut findings = graphics::look();
    findings.extend(machine::look(&common.domain));
    findings.extend(python::look());
    for finding in &findings {
        if args.json {
            let grade = grade_name(finding.grade);
            println!(
                "{}",
                serde_json::json!({"what": finding.what, "grade": grade, "text": finding.text, "fix": finding.fix})
            );
        } else {
            print!("{}", as_text(finding, is_coloured(common.color)));
        }
    }
    let worst = findings
        .iter()
        .map(|finding| finding.grade)
        .max()
        .unwrap_or(Grade::Ok);
    if !args.json {
        let verdict = match worst {
            Grade::Ok => "everything is there",
            Grade::Warn => "the simulator will run; what is marked is missing or slow",
            Grade::Fail => "the simulator will not run before what is marked \"fail\" is repaired",
        };
        println!("\n{verdict}");
    }
    Ok(if worst == Grade::Fail {
        Exit::Failed
    } else {
        Exit::Done
    })
}

fn is_coloured(color: ColorWhen) -> bool {
    color == ColorWhen::Always || (color.on_stderr() && std::io::stdout().is_terminal())
}

fn grade_name(grade: Grade) -> &'static str {
    match grade {
        Grade::Ok => "ok",
        Grade::Warn => "warn",
        Grade::Fail => "fail",
    }
}

fn as_text(finding: &Finding, coloured: bool) -> String {
    let name = grade_name(finding.grade);
    let mark = match (coloured, finding.grade) {
        (false, _) => format!("{name:<4}"),
        (true, Grade::Ok) => format!("\x1b[32m{name:<4}\x1b[0m"),
        (true, Grade::Warn) => format!("\x1b[33m{name:<4}\x1b[0m"),
        (true, Grade::Fail) => format!("\x1b[31m{name:<4}\x1b[0m"),
    };
    let fix = if finding.fix.is_empty() {
        String::new()
    } else {
        format!("{:23}→ {}\n", "", finding.fix)
    };
    format!("{mark}  {:<15}  {}\n{fix}", finding.what, finding.text)
}

/// What a program prints to stdout, within a time.
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
        // What came before a failure is still worth showing.
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
    fn a_finding_has_its_remedy_below_it() {
        let text = as_text(
            &Finding::fail("shared memory", "64 MiB", "docker run --shm-size=2g"),
            false,
        );
        assert_eq!(
            text,
            "fail  shared memory    64 MiB\n                       → docker run --shm-size=2g\n"
        );
        assert_eq!(
            as_text(&Finding::ok("python", "3.11"), false)
                .lines()
                .count(),
            1
        );
    }

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
