//! `gantry doctor`: finds out what this machine lacks and prints the command that repairs it. It
//! changes nothing.

mod disk;
mod display;
mod finding;
mod graphics;
mod install;
mod limits;
mod machine;
mod processor;
mod python;

use std::io::IsTerminal as _;

use launch_cli::{ColorWhen, CommonArgs, Exit};

use crate::cli::DoctorArgs;
use finding::{Colour, Grade};

/// Runs `gantry doctor`; `need_bytes` is the shared memory of the quickstart.
pub fn run(args: &DoctorArgs, common: &CommonArgs, need_bytes: u64) -> anyhow::Result<Exit> {
    let mut findings = graphics::look();
    findings.extend(machine::look(&common.domain, need_bytes));
    findings.extend(limits::look(need_bytes));
    findings.extend(processor::look());
    findings.extend(display::look());
    findings.extend(disk::look(launch_cli::data_dir(None)));
    findings.extend(python::look());
    for finding in &findings {
        if args.json {
            let grade = finding.grade.name();
            println!(
                "{}",
                serde_json::json!({"what": finding.what, "grade": grade, "text": finding.text, "fix": finding.fix})
            );
        } else {
            print!("{}", finding.as_text(colour_of_stdout(common.color)));
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

fn colour_of_stdout(color: ColorWhen) -> Colour {
    if color == ColorWhen::Always || (color.on_stderr() && std::io::stdout().is_terminal()) {
        Colour::Ansi
    } else {
        Colour::Plain
    }
}
