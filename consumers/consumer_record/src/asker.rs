//! Asks the simulator on a thread of its own: it answers between two ticks only, and frames must be
//! taken meanwhile.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use anyhow::Context;
use crossbeam_channel::{Receiver, Sender, bounded};
use schema_bus::{Bus, BusOptions, CommandClient};
use schema_frames::{CommandBatch, ReplyBatch};

/// How long the daemon may take to answer.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(2);

/// A thread that asks one question at a time. Dropped, it gives up what is not answered yet.
#[derive(Debug)]
pub(crate) struct Asker {
    /// `None` once it ends.
    questions: Option<Sender<CommandBatch>>,
    answers: Receiver<anyhow::Result<ReplyBatch>>,
    is_out: bool,
    ends: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Asker {
    /// Starts the thread, which joins the bus as `program` with the first question.
    ///
    /// # Errors
    /// If the thread cannot be started.
    pub(crate) fn start(
        domain: &str,
        program: &str,
        options: &BusOptions,
    ) -> anyhow::Result<Asker> {
        let (questions, asked) = bounded::<CommandBatch>(1);
        let (tell, answers) = bounded(1);
        let ends = Arc::new(AtomicBool::new(false));
        let (domain, program, options) = (domain.to_owned(), program.to_owned(), options.clone());
        let ended = ends.clone();
        let thread = std::thread::Builder::new()
            .name("ask".to_string())
            .spawn(move || {
                let mut port = None;
                for question in asked {
                    let answer = Port::ready(&mut port, &domain, &program, &options)
                        .and_then(|port| port.ask(&question, &ended));
                    if tell.send(answer).is_err() {
                        return;
                    }
                }
            })
            .context("cannot start the thread that asks the simulator")?;
        Ok(Asker {
            questions: Some(questions),
            answers,
            is_out: false,
            ends,
            thread: Some(thread),
        })
    }

    /// Whether a question waits for its answer, which [`Asker::answer`] takes.
    pub(crate) fn is_out(&self) -> bool {
        self.is_out
    }

    /// Asks, unless a question is out already.
    pub(crate) fn ask(&mut self, question: CommandBatch) {
        if self.is_out {
            return;
        }
        let sent = self.questions.as_ref().map(|to| to.try_send(question));
        self.is_out = matches!(sent, Some(Ok(())));
    }

    /// The answer, if it has come.
    pub(crate) fn answer(&mut self) -> Option<anyhow::Result<ReplyBatch>> {
        let answer = self.answers.try_recv().ok()?;
        self.is_out = false;
        Some(answer)
    }

    /// Asks and waits for the answer; one that is out is waited for and thrown away before.
    pub(crate) fn ask_and_wait(&mut self, question: CommandBatch) -> anyhow::Result<ReplyBatch> {
        if self.is_out {
            drop(self.answers.recv());
            self.is_out = false;
        }
        self.ask(question);
        let answer = self.answers.recv().context("the asking thread has ended");
        self.is_out = false;
        answer?
    }
}

impl Drop for Asker {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
        self.questions = None;
        while self.answers.recv().is_ok() {}
        if let Some(thread) = self.thread.take() {
            // What it had to say was said in its answers.
            let _ = thread.join();
        }
    }
}

/// The thread's own place on the bus, whose ports cannot move between threads.
struct Port {
    // Dropped before the node that made it.
    client: CommandClient,
    _bus: Bus,
}

impl Port {
    fn ready<'a>(
        place: &'a mut Option<Port>,
        domain: &str,
        program: &str,
        options: &BusOptions,
    ) -> anyhow::Result<&'a mut Port> {
        if place.is_none() {
            let bus = Bus::open_with(domain, program, options)?;
            let client = bus.command_client(program)?;
            *place = Some(Port { client, _bus: bus });
        }
        place.as_mut().context("there is no place on the bus")
    }

    fn ask(&mut self, question: &CommandBatch, ends: &AtomicBool) -> anyhow::Result<ReplyBatch> {
        let text = serde_json::to_vec(question)?;
        let mut go_on = || !ends.load(Ordering::Relaxed);
        let answer = self
            .client
            .request_text(&text, ANSWER_TIMEOUT, &mut go_on)?;
        Ok(serde_json::from_slice(&answer)?)
    }
}
