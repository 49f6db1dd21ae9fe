//! `gantry carla-root`: makes a folder that programs which start CARLA themselves can be given as
//! `CARLA_ROOT`.
//!
//! Three processes make a server. The script `CarlaUE4.sh` becomes the [`front`], which is named as
//! CARLA's program is and has its arguments, so that whoever looks for those finds it. The front
//! starts a launcher (`server`) in a session of its own, out of reach of a signal to the front's
//! process group, and keeps a socket to it. Once the front is gone, however it ended, the launcher
//! ends everything in order.

mod arguments;
mod front;
mod place;
mod server;

pub use front::{is_front, run as run_front};
pub use server::run as run_server;

use std::io::Write as _;
use std::net::IpAddr;
use std::os::unix::fs::{OpenOptionsExt as _, symlink};
use std::path::Path;

use anyhow::{Context as _, ensure};
use launch_cli::files::{MAX_SETTINGS_BYTES, read_text};
use launch_cli::{Exit, wrong_usage};

use crate::cli::CarlaRootArgs;
use place::{LAUNCH_FILE, PROGRAM, PROGRAM_FOLDER};

const SCRIPT: &str = "CarlaUE4.sh";
/// Release that the gateway speaks for; scripts read it from the file `VERSION`.
const VERSION: &str = "0.9.16\n";
/// A line of the script that tells a folder made here from an installed CARLA.
const MARK: &str = "# Made by `gantry carla-root`.";

/// Runs the word.
///
/// # Errors
/// A sentence if the folder is in use by something else, or cannot be written.
pub fn run(args: &CarlaRootArgs) -> anyhow::Result<Exit> {
    let dir = std::path::absolute(&args.dir)?;
    let again = check_place(&dir)?;
    if let Some(api) = &args.python_api {
        ensure!(
            api.is_dir(),
            wrong_usage(format!(
                "--python-api is {}, but there is no such folder",
                api.display()
            ))
        );
    }
    let programs = dir.join(PROGRAM_FOLDER);
    std::fs::create_dir_all(&programs)
        .with_context(|| format!("cannot make the folder {}", programs.display()))?;
    let own = std::env::current_exe().context("cannot tell where this program is")?;
    link(&own, &programs.join(PROGRAM))?;
    if let Some(api) = &args.python_api {
        link(&std::path::absolute(api)?, &dir.join("PythonAPI"))?;
    }
    write(&dir.join("VERSION"), VERSION, 0o644)?;
    let launch = dir.join(LAUNCH_FILE);
    if !launch.exists() {
        write(&launch, &launch_text(args)?, 0o644)?;
    }
    write(&dir.join(SCRIPT), &script_text(), 0o755)?;
    println!(
        "{} {}; its servers are as {} says",
        if again { "made again" } else { "made" },
        dir.display(),
        launch.display()
    );
    println!("  export CARLA_ROOT={}", dir.display());
    println!(
        "  {}/{SCRIPT} -RenderOffScreen -nosound -carla-rpc-port=2000",
        dir.display()
    );
    Ok(Exit::Done)
}

/// Whether the folder is one that this word made; else it is new or empty.
fn check_place(dir: &Path) -> anyhow::Result<bool> {
    let shown = dir.display();
    if let Ok(script) = read_text(&dir.join(SCRIPT), MAX_SETTINGS_BYTES) {
        ensure!(
            script.contains(MARK),
            wrong_usage(format!(
                "{shown} has a {SCRIPT} of another maker, perhaps an installed CARLA; give a folder that does not exist yet"
            ))
        );
        return Ok(true);
    }
    ensure!(
        !dir.exists() || dir.is_dir(),
        wrong_usage(format!(
            "{shown} is a file; give a folder that does not exist yet"
        ))
    );
    let is_used = dir.is_dir()
        && dir
            .read_dir()
            .with_context(|| format!("cannot read {shown}"))?
            .next()
            .is_some();
    ensure!(
        !is_used,
        wrong_usage(format!(
            "the folder {shown} is not empty; give a folder that does not exist yet"
        ))
    );
    Ok(false)
}

/// Makes `at` a link to `target`, in place of a link that is there.
fn link(target: &Path, at: &Path) -> anyhow::Result<()> {
    if at.is_symlink() {
        std::fs::remove_file(at).with_context(|| format!("cannot replace {}", at.display()))?;
    }
    symlink(target, at).with_context(|| format!("cannot make the link {}", at.display()))
}

fn write(path: &Path, text: &str, mode: u32) -> anyhow::Result<()> {
    let mut options = std::fs::OpenOptions::new();
    options.write(true).create(true).truncate(true).mode(mode);
    options
        .open(path)
        .and_then(|mut file| file.write_all(text.as_bytes()))
        .with_context(|| format!("cannot write {}", path.display()))
}

/// What servers are, for people to change.
fn launch_text(args: &CarlaRootArgs) -> anyhow::Result<String> {
    let mut simd = vec!["simd".to_owned()];
    let mut gateway = vec!["gantry-carla".to_owned()];
    if let Some(data) = &args.data {
        let data = std::path::absolute(data)?.display().to_string();
        for cmd in [&mut simd, &mut gateway] {
            cmd.extend(["--data".to_owned(), data.clone()]);
        }
    }
    if args.bind != IpAddr::from([127, 0, 0, 1]) {
        gateway.extend(["--bind".to_owned(), args.bind.to_string()]);
    }
    if args.any_user {
        gateway.push("--any-user".to_owned());
    }
    let list = |cmd: &[String]| {
        let words: Vec<String> = cmd.iter().map(|word| format!("{word:?}")).collect();
        words.join(", ")
    };
    Ok(format!(
        "# A server of {SCRIPT}: an empty town and the gateway, as CARLA is after its start. Arguments of
# {SCRIPT} (ports, map, step, adapter, quality) win over what this file says. As with CARLA, each client runs its own
# Traffic Manager; a process `gantry-drive --serve 8000` before the gateway makes it one for all.
version = 1

[scenario]
map = \"Town10HD\"

[ego]
type_id = \"none\"

[process.simd]
cmd = [{}]
required = true
ready = {{ service = \"world/snapshot\" }}

[process.carla]
cmd = [{}]
after = [\"simd\"]
required = true
",
        list(&simd),
        list(&gateway)
    ))
}

fn script_text() -> String {
    format!(
        "#!/bin/sh
{MARK} It takes the arguments of CARLA's script of this name.
root=$(dirname \"$(readlink -f \"$0\")\")
program=\"$root/{PROGRAM_FOLDER}/{PROGRAM}\"
if [ ! -x \"$program\" ]; then
    echo \"error: $program leads to no program; run \\`gantry carla-root $root\\` again\" >&2
    exit 1
fi
exec \"$program\" CarlaUE4 \"$@\"
"
    )
}

#[cfg(test)]
mod tests {
    use super::place::root_of;
    use super::*;
    use launch_spec::Launch;

    fn args(dir: &Path) -> CarlaRootArgs {
        CarlaRootArgs {
            dir: dir.to_owned(),
            data: None,
            python_api: None,
            bind: IpAddr::from([127, 0, 0, 1]),
            any_user: false,
        }
    }

    #[test]
    fn a_folder_is_made_again_without_losing_its_launch_file() {
        let place = tempfile::tempdir().unwrap();
        let dir = place.path().join("root");
        run(&args(&dir)).unwrap();
        let launch = dir.join(LAUNCH_FILE);
        let text = std::fs::read_to_string(&launch).unwrap() + "# mine\n";
        std::fs::write(&launch, &text).unwrap();
        run(&args(&dir)).unwrap();
        assert_eq!(std::fs::read_to_string(&launch).unwrap(), text);
        let front = dir.join(PROGRAM_FOLDER).join(PROGRAM);
        assert_eq!(root_of(&front).unwrap(), dir);
        assert_eq!(
            front.canonicalize().unwrap(),
            std::env::current_exe().unwrap().canonicalize().unwrap()
        );
    }

    #[test]
    fn folders_of_others_are_left_alone() {
        let place = tempfile::tempdir().unwrap();
        std::fs::write(place.path().join("thesis.tex"), "").unwrap();
        let message = run(&args(place.path())).unwrap_err().to_string();
        assert!(message.contains("is not empty"), "{message}");
        std::fs::write(place.path().join(SCRIPT), "#!/bin/sh\n").unwrap();
        let message = run(&args(place.path())).unwrap_err().to_string();
        assert!(message.contains("of another maker"), "{message}");
    }

    #[test]
    fn the_launch_file_is_read_with_every_option() {
        let folder = "/a \"folder\"";
        let text = launch_text(&CarlaRootArgs {
            data: Some(folder.into()),
            bind: IpAddr::from([0, 0, 0, 0]),
            any_user: true,
            ..args(Path::new("x"))
        })
        .unwrap();
        let launch = Launch::parse(&text, "x").unwrap();
        assert_eq!(
            launch.process("simd").unwrap().cmd,
            ["simd", "--data", folder]
        );
        assert_eq!(
            launch.process("carla").unwrap().cmd,
            [
                "gantry-carla",
                "--data",
                folder,
                "--bind",
                "0.0.0.0",
                "--any-user"
            ]
        );
    }
}
