//! Man pages of a program: one for itself and one for each of its subcommands.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use clap_mangen::Man;

/// Subcommands that every program has; their pages would say nothing new.
const EVERYWHERE: [&str; 2] = ["completions", "help"];

/// Writes `gantry.1`, `gantry-topic.1`, `gantry-topic-list.1` and so on into `folder`, which is made
/// if it is not there; existing pages are replaced. Returns the files, sorted.
///
/// # Errors
/// If the folder cannot be made or a file cannot be written.
pub fn write(mut command: clap::Command, folder: &Path) -> io::Result<Vec<PathBuf>> {
    fs::create_dir_all(folder)?;
    command.build();
    let mut written = Vec::new();
    write_below(&command, folder, &mut written)?;
    written.sort();
    Ok(written)
}

fn write_below(
    command: &clap::Command,
    folder: &Path,
    written: &mut Vec<PathBuf>,
) -> io::Result<()> {
    written.push(Man::new(command.clone()).generate_to(folder)?);
    for below in command.get_subcommands() {
        if !below.is_hide_set() && !EVERYWHERE.contains(&below.get_name()) {
            write_below(below, folder, written)?;
        }
    }
    Ok(())
}

/// The program's own page as troff.
pub(crate) fn page(command: clap::Command) -> Vec<u8> {
    let mut page = Vec::new();
    Man::new(command)
        .render(&mut page)
        .expect("writing to memory does not fail");
    page
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_subcommand_has_a_page_of_its_own() {
        let list = clap::Command::new("list").about("Names and types");
        let command = clap::Command::new("probe")
            .about("Looks at things")
            .subcommand(clap::Command::new("topic").subcommand(list))
            .subcommand(clap::Command::new("secret").hide(true))
            .subcommand(clap::Command::new("completions"));
        let folder = tempfile::tempdir().unwrap();
        let into = folder.path().join("man1");
        let names: Vec<String> = write(command, &into)
            .unwrap()
            .iter()
            .map(|path| path.file_name().unwrap().to_string_lossy().into_owned())
            .collect();
        assert_eq!(names, ["probe-topic-list.1", "probe-topic.1", "probe.1"]);
        let text = fs::read_to_string(into.join("probe-topic-list.1")).unwrap();
        assert!(text.contains("Names and types"), "{text}");
        assert!(text.contains("probe topic list"), "{text}");
    }
}
