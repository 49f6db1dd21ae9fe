//! The processes of a launch file, under `gantry up` as a child of this process.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitStatus;
use std::time::Duration;

use launch_cli::programs::find;
use toml::Table;

use crate::error::RunError;
use crate::notes::{Note, NoteReader};
use crate::process::{Ending, Process};
use crate::program::{Output, Program};
use crate::watch::Watched;

/// The launcher in sentences.
pub const LAUNCHER: &str = "gantry up";
/// How much of the launcher's log is quoted when something fails.
const QUOTED_LINES: usize = 8;
/// Time in which the launcher ends with all its processes, after which it is asked to kill them, and
/// time in which it does.
const END_WITHIN: Duration = Duration::from_secs(30);

/// The launcher as a program that starts the processes of a launch file in `domain`. The file, the
/// folders of its runs and its log go to `folder`; the second value is the path of the log.
///
/// # Errors
/// If the folder cannot be written or there is no launcher.
pub fn launcher(
    domain: &str,
    launch: &Table,
    folder: &Path,
) -> Result<(Program, PathBuf), RunError> {
    fs::create_dir_all(folder).map_err(|source| RunError::Folder {
        path: folder.to_owned(),
        source,
    })?;
    let file = folder.join("launch.toml");
    let text = toml::to_string(launch)?;
    fs::write(&file, text).map_err(|source| RunError::Write {
        path: file.clone(),
        source,
    })?;
    let program = find("gantry").map_err(RunError::NoProgram)?;
    let program = Program::new(LAUNCHER, &program)
        .words(["--domain", domain, "--color", "never", "up"])
        .words([&*file, "--view".as_ref(), "none".as_ref()])
        .words(["--data".as_ref(), folder])
        .with_parent()
        .in_own_group()
        .quotes_lines(QUOTED_LINES)
        .ends_by(Ending::interrupt_twice(END_WITHIN));
    Ok((program, folder.join("up.log")))
}

/// The processes of a launch file; ended when dropped.
#[derive(Debug)]
pub struct Launched {
    launcher: Process,
    /// The folder of the launcher's run.
    run: PathBuf,
    notes: NoteReader,
}

impl Launched {
    /// Starts the processes of a launch file in `domain`. Logs and the file go to `folder`.
    ///
    /// # Errors
    /// As [`launcher`], or if it cannot be started.
    pub fn start(domain: &str, launch: &Table, folder: &Path) -> Result<Launched, RunError> {
        let (program, log) = launcher(domain, launch, folder)?;
        let run = folder.join("runs/latest");
        // Until the launcher has made its own, an earlier run would be taken for this one.
        let _ = fs::remove_file(&run);
        Ok(Launched {
            launcher: program.start(Output::Log(&log))?,
            run,
            notes: NoteReader::default(),
        })
    }

    /// What became of the processes since the last look.
    ///
    /// # Errors
    /// If the launcher's notes cannot be read.
    pub fn look(&mut self) -> Result<Vec<Note>, RunError> {
        Ok(self.notes.look(&self.run)?)
    }

    /// Process ids by name, of those that run.
    pub fn pids(&self) -> &std::collections::BTreeMap<String, u32> {
        &self.notes.pids
    }

    /// How the launcher ended, if it did.
    ///
    /// # Errors
    /// If that cannot be told.
    pub fn ended(&mut self) -> Result<Option<ExitStatus>, RunError> {
        self.launcher.ended()
    }

    /// The last lines of the launcher's log, which has those of all processes.
    pub fn last_words(&self) -> String {
        self.launcher.last_words()
    }

    /// Ends all processes in order, and waits for it.
    ///
    /// # Errors
    /// If the launcher cannot be waited for.
    pub fn stop(&mut self) -> Result<(), RunError> {
        self.launcher.end().map(drop)
    }
}

impl Watched for Launched {
    fn must_run(&mut self) -> Result<(), RunError> {
        self.launcher.must_run()
    }

    fn hint(&self) -> String {
        self.launcher.hint()
    }
}
