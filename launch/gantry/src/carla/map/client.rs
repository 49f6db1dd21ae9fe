//! CARLA's client as a reader of maps. Each map has a Python process of its own, because the
//! client's parser may crash the process that calls it.

use std::io::{Read as _, Write as _};
use std::os::unix::process::ExitStatusExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use serde::Deserialize;

/// The script that runs in the Python process.
const SCRIPT: &str = include_str!("carla_map.py");
/// Longest time for one map.
const PATIENCE: Duration = Duration::from_secs(300);
/// Longest time to find out whether the wheel is there.
const LOOK: Duration = Duration::from_secs(60);
/// Longest answer that is read, bytes.
const MAX_ANSWER: u64 = 1 << 30;

/// A Python that has the wheel.
#[derive(Debug)]
pub struct Client {
    python: PathBuf,
}

/// Road, section and lane.
pub type Key = (u32, u16, i32);

/// A waypoint of `generate_waypoints`.
#[derive(Debug, Deserialize)]
pub struct Waypoint {
    pub lane: Key,
    pub s: f64,
    pub at: [f64; 3],
    pub yaw: f64,
    pub width: f64,
    pub change: u32,
    pub junction: Option<i64>,
}

/// Another lane of the same road.
#[derive(Debug, Deserialize)]
pub struct Beside {
    pub lane: Key,
    #[serde(rename = "type")]
    pub kind: String,
    pub width: f64,
    pub s: f64,
}

/// A signal.
#[derive(Debug, Deserialize)]
pub struct Landmark {
    pub id: String,
    pub at: [f64; 3],
    #[serde(rename = "type")]
    pub kind: String,
    pub value: f64,
}

/// An answer of `get_waypoint`.
#[derive(Debug, Deserialize)]
pub struct Nearest {
    pub point: [f64; 3],
    pub lane: Key,
    pub s: f64,
    pub at: [f64; 3],
}

#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
enum Line {
    Waypoint(Waypoint),
    Beside(Beside),
    Edge((Key, Key)),
    Landmark(Landmark),
    Nearest(Nearest),
    Stumble([f64; 3]),
    Lost(Key),
    Done(bool),
}

/// Everything the client makes of a map.
#[derive(Debug, Default)]
pub struct View {
    pub waypoints: Vec<Waypoint>,
    pub beside: Vec<Beside>,
    pub edges: Vec<(Key, Key)>,
    pub landmarks: Vec<Landmark>,
    pub nearest: Vec<Nearest>,
    /// Places at which the client's own search fails.
    pub stumbles: Vec<[f64; 3]>,
    /// Lanes of waypoints to which the client gives no place: its numbers are not finite.
    pub lost: Vec<Key>,
    /// Whether the last line of the answer came.
    is_whole: bool,
    /// How its process ended, if that was before the last line.
    pub ended_early: Option<String>,
}

/// Why there is no comparison with CARLA's client.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// The user does not want one.
    #[error("not asked for (--carla never)")]
    NotAsked,
    /// The client is not installed.
    #[error(
        "no Python here has the package carla; make one with `./gantry test` or `pip install carla==0.9.16`, or name it with --python"
    )]
    NoPython,
    /// Python does not start.
    #[error("cannot start {}: {error}", .python.display())]
    Start {
        /// The program.
        python: PathBuf,
        /// What the system says.
        error: std::io::Error,
    },
    /// The end of Python's process cannot be awaited.
    #[error("cannot wait for {}: {error}", .python.display())]
    Wait {
        /// The program.
        python: PathBuf,
        /// What the system says.
        error: std::io::Error,
    },
    /// A thread at one of its pipes panicked.
    #[error("a thread that talked to Python failed")]
    Pipe,
    /// The script wrote a line that is none of its own.
    #[error("the client's answer cannot be read: {error} in {line}")]
    Answer {
        /// What serde says.
        error: serde_json::Error,
        /// Where the line begins.
        line: String,
    },
}

/// A Python with the wheel: the given one, else that of `.venv`, else `python3` on `PATH`.
///
/// # Errors
/// What is missing, and what to do.
pub fn find(given: Option<&Path>) -> Result<Client, ClientError> {
    let own = PathBuf::from(".venv/bin/python");
    let path = std::env::var_os("PATH").unwrap_or_default();
    let on_path = ["python3", "python"].into_iter().flat_map(|name| {
        std::env::split_paths(&path)
            .map(move |folder| folder.join(name))
            .collect::<Vec<_>>()
    });
    let candidates: Vec<PathBuf> = match given {
        Some(python) => vec![python.to_owned()],
        None => std::iter::once(own)
            .chain(on_path)
            .filter(|python| python.exists())
            .collect(),
    };
    let has_wheel = |python: &PathBuf| {
        let answer = crate::programs::output_of(
            python,
            &["-c", "import carla; print(hasattr(carla, 'Map'))"],
            LOOK,
        );
        answer.is_ok_and(|answer| answer.trim() == "True")
    };
    let python = candidates.into_iter().find(has_wheel);
    Ok(Client {
        python: python.ok_or(ClientError::NoPython)?,
    })
}

impl Client {
    /// What the client makes of a text.
    ///
    /// # Errors
    /// When its process cannot be run, or its answer cannot be read.
    pub fn view(&self, text: &str) -> Result<View, ClientError> {
        let mut child = Command::new(&self.python)
            .args(["-c", SCRIPT])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|error| ClientError::Start {
                python: self.python.clone(),
                error,
            })?;
        let (mut stdin, stdout, stderr) = (
            child.stdin.take().expect("stdin is piped"),
            child.stdout.take().expect("stdout is piped"),
            child.stderr.take().expect("stderr is piped"),
        );
        let text = text.to_owned();
        // Each pipe has a thread, so that none fills up while another is waited for. A client that
        // ends early reads nothing more.
        let writer = std::thread::spawn(move || drop(stdin.write_all(text.as_bytes())));
        let reader = std::thread::spawn(move || read_all(stdout));
        let errors = std::thread::spawn(move || read_all(stderr));
        let started = Instant::now();
        let status = loop {
            let ended = child.try_wait().map_err(|error| ClientError::Wait {
                python: self.python.clone(),
                error,
            })?;
            match ended {
                Some(status) => break Some(status),
                None if started.elapsed() > PATIENCE => {
                    let _ = child.kill();
                    let _ = child.wait();
                    break None;
                }
                None => std::thread::sleep(Duration::from_millis(5)),
            }
        };
        let joined = (writer.join(), reader.join(), errors.join());
        let (Ok(()), Ok(answer), Ok(errors)) = joined else {
            return Err(ClientError::Pipe);
        };
        let mut view = parse(&answer)?;
        view.ended_early = match status {
            None => Some(format!("gave no answer within {} s", PATIENCE.as_secs())),
            Some(status) if status.success() && view.is_whole => None,
            Some(status) => Some(match status.signal() {
                Some(signal) => format!("ended with signal {signal}"),
                None => format!(
                    "failed: {}",
                    errors.lines().next_back().unwrap_or("it says nothing")
                ),
            }),
        };
        Ok(view)
    }
}

fn read_all(pipe: impl std::io::Read) -> String {
    let mut bytes = Vec::new();
    // Lines that came before a failure still count.
    let _ = pipe.take(MAX_ANSWER).read_to_end(&mut bytes);
    String::from_utf8_lossy(&bytes).into_owned()
}

fn parse(answer: &str) -> Result<View, ClientError> {
    let mut view = View::default();
    for line in answer.lines().filter(|line| line.starts_with('{')) {
        match serde_json::from_str(line) {
            Ok(Line::Waypoint(waypoint)) => view.waypoints.push(waypoint),
            Ok(Line::Beside(lane)) => view.beside.push(lane),
            Ok(Line::Edge(edge)) => view.edges.push(edge),
            Ok(Line::Landmark(landmark)) => view.landmarks.push(landmark),
            Ok(Line::Nearest(nearest)) => view.nearest.push(nearest),
            Ok(Line::Stumble(place)) => view.stumbles.push(place),
            Ok(Line::Lost(lane)) => view.lost.push(lane),
            Ok(Line::Done(done)) => view.is_whole = done,
            // The last line of a process that was ended may be half a line.
            Err(_) if !line.ends_with('}') => {}
            Err(error) => {
                let line = line.chars().take(200).collect();
                return Err(ClientError::Answer { error, line });
            }
        }
    }
    Ok(view)
}
