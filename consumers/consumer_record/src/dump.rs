//! Asks a recorder that keeps a ring to write it: a socket per recorder in a folder that only its
//! user can enter, one line of JSON each way.

use std::io::{BufRead as _, BufReader, ErrorKind, Write as _};
use std::os::unix::fs::{DirBuilderExt as _, MetadataExt as _};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context as _, ensure};
use crossbeam_channel::{Receiver, Sender, bounded};
use launch_cli::accept::AcceptPause;
use serde::{Deserialize, Serialize};

/// How long a dump may take.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(300);
/// How long a program may take to say what it wants.
const ASK_TIMEOUT: Duration = Duration::from_secs(2);
/// Longest note.
const MAX_NOTE_BYTES: u64 = 4096;

/// Somebody wants the ring written.
#[derive(Debug)]
pub struct DumpRequest {
    /// Why; kept in the file's metadata `dump`.
    pub note: String,
    answer: Sender<Result<Dumped, NotDumped>>,
}

impl DumpRequest {
    /// A request, and where its answer comes.
    pub fn new(note: &str) -> (DumpRequest, Receiver<Result<Dumped, NotDumped>>) {
        let (answer, answers) = bounded(1);
        let note = note.to_string();
        (DumpRequest { note, answer }, answers)
    }

    /// Answers it.
    pub fn answer(&self, said: Result<Dumped, NotDumped>) {
        // Whoever asked may have gone.
        let _ = self.answer.try_send(said);
    }
}

/// Why nothing was written, as the recorder says it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
#[error("{0}")]
#[serde(transparent)]
pub struct NotDumped(pub String);

/// What was written.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Dumped {
    /// The file.
    pub file: String,
    /// Messages in it.
    pub n_messages: u64,
    /// Its size.
    pub file_bytes: u64,
    /// Simulated seconds that it covers.
    pub secs: f64,
    /// Simulated seconds that the ring was to keep.
    pub keep_secs: f64,
}

#[derive(Serialize, Deserialize)]
struct Question {
    note: String,
}

/// The folder of the sockets.
fn folder() -> anyhow::Result<PathBuf> {
    let user = nix::unistd::getuid().as_raw();
    let folder = std::env::temp_dir().join(format!("gantry-record-{user}"));
    let made = std::fs::DirBuilder::new().mode(0o700).create(&folder);
    if let Err(error) = made
        && error.kind() != ErrorKind::AlreadyExists
    {
        return Err(error).with_context(|| format!("cannot make {}", folder.display()));
    }
    let about = std::fs::symlink_metadata(&folder)
        .with_context(|| format!("cannot look at {}", folder.display()))?;
    ensure!(
        about.is_dir() && about.uid() == user && about.mode() & 0o077 == 0,
        "{} does not belong to this user alone; remove it",
        folder.display()
    );
    Ok(folder)
}

/// Where a recorder is asked; gone with it.
#[derive(Debug)]
pub struct Server {
    path: PathBuf,
    /// The requests.
    pub requests: Receiver<DumpRequest>,
    sender: Sender<DumpRequest>,
}

impl Server {
    /// Listens for requests to dump recordings of `domain`.
    ///
    /// # Errors
    /// If the socket cannot be made.
    pub fn start(domain: &str) -> anyhow::Result<Server> {
        let path = folder()?.join(format!("{domain}.{}.sock", std::process::id()));
        let _ = std::fs::remove_file(&path);
        let listener = UnixListener::bind(&path)
            .with_context(|| format!("cannot listen on {}", path.display()))?;
        let (sender, requests) = bounded(4);
        let to_writer = sender.clone();
        std::thread::Builder::new()
            .name("dump-requests".to_string())
            .spawn(move || {
                let mut pause = AcceptPause::new("requests to dump");
                loop {
                    match listener.accept() {
                        Ok((stream, _)) => {
                            pause.over();
                            if let Err(error) = serve(stream, &to_writer) {
                                let error = format!("{error:#}");
                                tracing::warn!(error, "a request to dump failed");
                            }
                        }
                        Err(error) => pause.wait(&error),
                    }
                }
            })
            .context("cannot start the thread that takes requests to dump")?;
        Ok(Server {
            path,
            requests,
            sender,
        })
    }

    /// Asks from within the process, as a signal does.
    pub fn ask(&self, note: &str) {
        let _ = self.sender.try_send(DumpRequest::new(note).0);
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.path);
    }
}

fn serve(stream: UnixStream, to_writer: &Sender<DumpRequest>) -> anyhow::Result<()> {
    stream.set_read_timeout(Some(ASK_TIMEOUT))?;
    let mut line = String::new();
    let limited = std::io::Read::take(&stream, MAX_NOTE_BYTES);
    BufReader::new(limited).read_line(&mut line)?;
    let question: Question = serde_json::from_str(&line).context("this is no request")?;
    let (request, answers) = DumpRequest::new(&question.note);
    to_writer
        .send(request)
        .map_err(|_| anyhow::anyhow!("the recorder has ended"))?;
    let answer = answers
        .recv_timeout(ANSWER_TIMEOUT)
        .unwrap_or_else(|_| Err(NotDumped("the recorder ended before the dump".to_owned())));
    let mut stream = stream;
    writeln!(stream, "{}", serde_json::to_string(&answer)?)?;
    Ok(())
}

/// Asks every recorder of `domain` that keeps a ring to write it; the answers.
///
/// # Errors
/// If there is none.
pub fn ask_all(domain: &str, note: &str) -> anyhow::Result<Vec<Result<Dumped, NotDumped>>> {
    let folder = folder()?;
    let mut answers = Vec::new();
    let mut names: Vec<PathBuf> = std::fs::read_dir(&folder)
        .with_context(|| format!("cannot list {}", folder.display()))?
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| is_of(path, domain))
        .collect();
    names.sort();
    for path in names {
        match UnixStream::connect(&path) {
            Ok(stream) => {
                answers.push(ask(stream, note).unwrap_or_else(|e| Err(NotDumped(format!("{e:#}")))))
            }
            // Its recorder was killed.
            Err(error) if error.kind() == ErrorKind::ConnectionRefused => {
                let _ = std::fs::remove_file(&path);
            }
            Err(error) => answers.push(Err(NotDumped(format!("{}: {error}", path.display())))),
        }
    }
    ensure!(
        !answers.is_empty(),
        "no recorder of the domain {domain:?} keeps a ring; start one with `gantry record --keep 30s --out FILE`"
    );
    Ok(answers)
}

fn is_of(path: &Path, domain: &str) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let parts = name
        .strip_suffix(".sock")
        .and_then(|it| it.rsplit_once('.'));
    parts.is_some_and(|(of, _)| of == domain)
}

fn ask(mut stream: UnixStream, note: &str) -> anyhow::Result<Result<Dumped, NotDumped>> {
    stream.set_read_timeout(Some(ANSWER_TIMEOUT))?;
    let question = Question {
        note: note.to_string(),
    };
    writeln!(stream, "{}", serde_json::to_string(&question)?)?;
    let mut line = String::new();
    BufReader::new(stream).read_line(&mut line)?;
    serde_json::from_str(&line).context("the recorder ended before it answered")
}
