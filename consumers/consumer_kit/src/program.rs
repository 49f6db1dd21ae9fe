//! The base of a program that answers frames and results: it takes the newest ones, or every one in
//! lockstep if it was told so, and ends when it is asked to.

use std::ops::Index;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, Instant};

use schema_bus::{
    Answerable, Bus, BusError, Frame, ResultSample, ResultTopic, names::default_domain,
};
use schema_frames::{About, ResultRecord, ResultType};
use serde::de::DeserializeOwned;

use crate::lockstep::LockstepError;
use crate::{Follower, MAX_WAIT, Publisher, Steps, Take, TopicId};

/// How long a program waits for its inputs and for a place in lockstep.
const START_TIMEOUT: Duration = Duration::from_secs(60);
/// How long a tick in lockstep is held for the results of other participants.
const RESULT_TIMEOUT: Duration = Duration::from_secs(1);
/// Between two looks for topics that are missing.
const LOOK_EVERY: Duration = Duration::from_millis(20);

/// Why a program cannot begin or go on.
#[derive(Debug, thiserror::Error)]
pub enum ProgramError {
    /// The bus failed.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// Lockstep failed.
    #[error(transparent)]
    Lockstep(#[from] LockstepError),
    /// The last argument begins as JSON and is none, or not what the program expects.
    #[error(
        "the settings in the last argument cannot be read: {0}; they are a JSON object, `params` in a launch file"
    )]
    Params(#[from] serde_json::Error),
    /// `lockstep` in the settings is no text.
    #[error("params.lockstep is {0}; it is the name under which this program joins, a text")]
    LockstepName(String),
    /// An input did not appear.
    #[error("no topic {0:?} within a minute; does anything publish it on this domain?")]
    NoInput(String),
    /// There is nothing to answer.
    #[error("a program needs at least one input; call Program::input before")]
    NoInputs,
}

/// A program that answers frames and others' results, on the domain of `GANTRY_DOMAIN`.
///
/// It runs unchanged in all modes of the benchmark: by default it takes the newest frames and skips
/// those that came while it was busy. If the JSON object in its last argument (`params` in a launch
/// file) has `"lockstep": NAME`, it joins the lockstep under this name and takes every frame.
/// Load and warm up before [`Program::output`]: a topic that has a writer is the sign of readiness.
///
/// ```no_run
/// use consumer_kit::{Program, Take};
/// use schema_frames::{Box3d, LidarPoint};
///
/// let mut program = Program::open("clusters", Take::Newest)?;
/// let lidar = program.input("ego/roof/lidar");
/// let boxes = program.output::<Box3d>("clusters/boxes", &["car", "person"])?;
/// while let Some(frames) = program.next()? {
///     let points = frames[lidar].elements::<LidarPoint>().unwrap_or_default();
///     let found: Vec<Box3d> = Vec::new(); // what a detector sees in `points`
///     boxes.send(&found, &frames.all())?;
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Program {
    // Ports go before their node.
    steps: Option<Steps>,
    heads: Vec<Option<Head>>,
    follower: Follower,
    inputs: Vec<Followed>,
    /// Until when the tick in lockstep is held for results.
    held_until: Instant,
    take: Take,
    params: serde_json::Map<String, serde_json::Value>,
    lockstep: Option<String>,
    stop: Arc<AtomicBool>,
}

/// Number of an input of a [`Program`] that has frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InputId(usize);

/// Number of an input of a [`Program`] that has results.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ResultId(usize);

/// An input, and what it carries.
#[derive(Clone, Copy, Debug)]
enum Followed {
    Frames(TopicId),
    Results(TopicId),
}

impl Followed {
    fn id(self) -> TopicId {
        match self {
            Followed::Frames(id) | Followed::Results(id) => id,
        }
    }
}

/// The oldest sample of an input that was not answered yet.
#[derive(Debug)]
enum Head {
    Frame(Frame),
    Result(ResultSample),
}

impl Head {
    fn tick(&self) -> u64 {
        match self {
            Head::Frame(frame) => frame.header().tick,
            Head::Result(result) => result.header().tick,
        }
    }

    /// Of the simulator; 0 for a result that answers no frame.
    fn epoch(&self) -> u64 {
        match self {
            Head::Frame(frame) => frame.header().epoch,
            Head::Result(result) => result.header().epoch,
        }
    }

    fn published_mono_nanos(&self) -> u64 {
        match self {
            Head::Frame(frame) => frame.header().published_mono_nanos,
            Head::Result(result) => result.header().published_mono_nanos,
        }
    }
}

/// One frame or result of each input, all of one tick.
#[derive(Debug)]
pub struct Frames(Vec<Head>);

impl Frames {
    /// What a result answers that was computed from all of them, in the order of the inputs.
    pub fn all(&self) -> Vec<&dyn Answerable> {
        let heads = self.0.iter();
        heads
            .map(|head| match head {
                Head::Frame(frame) => frame as &dyn Answerable,
                Head::Result(result) => result as &dyn Answerable,
            })
            .collect()
    }

    /// Their tick.
    pub fn tick(&self) -> u64 {
        self.0.first().map_or(0, Head::tick)
    }
}

impl Index<InputId> for Frames {
    type Output = Frame;
    fn index(&self, input: InputId) -> &Frame {
        match &self.0[input.0] {
            Head::Frame(frame) => frame,
            Head::Result(_) => panic!("input {} of this program has results", input.0),
        }
    }
}

impl Index<ResultId> for Frames {
    type Output = ResultSample;
    fn index(&self, input: ResultId) -> &ResultSample {
        match &self.0[input.0] {
            Head::Result(result) => result,
            Head::Frame(_) => panic!("input {} of this program has frames", input.0),
        }
    }
}

impl Program {
    /// Joins the domain as `name`, with the settings of the command line. INT and TERM end
    /// [`Program::next`]. `take` holds outside of lockstep, where every frame is taken.
    ///
    /// # Errors
    /// [`ProgramError::Params`], [`ProgramError::LockstepName`], and as [`Bus::open`].
    pub fn open(name: &str, take: Take) -> Result<Program, ProgramError> {
        let settings = std::env::args().skip(1).last();
        let settings = settings.filter(|text| text.trim_start().starts_with('{'));
        let bus = Bus::open(&default_domain(), name)?;
        let program = Program::on(bus, take, settings.as_deref().unwrap_or("{}"))?;
        for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
            // Without the flag the signal ends the process, and others clean up after it.
            let _ = signal_hook::flag::register(signal, program.stop.clone());
        }
        Ok(program)
    }

    /// As [`Program::open`] on a bus that is already open, with settings as JSON; signals are the
    /// caller's.
    ///
    /// # Errors
    /// [`ProgramError::Params`], [`ProgramError::LockstepName`].
    pub fn on(bus: Bus, take: Take, settings: &str) -> Result<Program, ProgramError> {
        let params: serde_json::Map<String, serde_json::Value> = serde_json::from_str(settings)?;
        let lockstep = match params.get("lockstep") {
            None | Some(serde_json::Value::Null) => None,
            Some(serde_json::Value::String(name)) => Some(name.clone()),
            Some(other) => return Err(ProgramError::LockstepName(other.to_string())),
        };
        Ok(Program {
            steps: None,
            heads: Vec::new(),
            follower: Follower::on(bus),
            inputs: Vec::new(),
            held_until: Instant::now(),
            take: if lockstep.is_some() { Take::All } else { take },
            params,
            lockstep,
            stop: Arc::new(AtomicBool::new(false)),
        })
    }

    /// The program's own settings: all keys of the last argument but `lockstep`.
    ///
    /// # Errors
    /// [`ProgramError::Params`] if they are not a `T`.
    pub fn params<T: DeserializeOwned>(&self) -> Result<T, ProgramError> {
        let mut own = self.params.clone();
        own.remove("lockstep");
        Ok(serde_json::from_value(serde_json::Value::Object(own))?)
    }

    /// Adds an input (`ego/front/rgb`, without the domain), which need not exist yet. Several
    /// inputs are taken tick by tick: frames of a tick of which one input has none are passed over.
    pub fn input(&mut self, topic: &str) -> InputId {
        let id = self.follower.follow(topic, self.take_of_frames());
        self.inputs.push(Followed::Frames(id));
        self.heads.push(None);
        InputId(self.inputs.len() - 1)
    }

    /// Adds results of another program (`detector/boxes`) as an input. With frames beside them the
    /// program gets a frame together with what was said about its tick: in lockstep it waits for
    /// that, up to a second. Otherwise every frame is taken, because the result comes later than
    /// its frame, and a frame that is no longer kept by then is passed over.
    pub fn results(&mut self, topic: &str) -> ResultId {
        let id = self.follower.follow_results(topic, self.take);
        self.inputs.push(Followed::Results(id));
        self.heads.push(None);
        for input in &self.inputs {
            self.follower.set_take(input.id(), self.take_of_frames());
        }
        ResultId(self.inputs.len() - 1)
    }

    fn take_of_frames(&self) -> Take {
        let is_result = |input: &Followed| matches!(input, Followed::Results(_));
        match self.inputs.iter().any(is_result) {
            true => Take::All,
            false => self.take,
        }
    }

    /// Opens a topic of results that are lists of `T`, whose classes have these names (empty:
    /// CARLA's). It waits for all inputs before, so that the program is ready once the topic is there.
    ///
    /// # Errors
    /// [`ProgramError::NoInput`], and as [`Bus::result_publisher`].
    pub fn output<T: ResultRecord>(
        &mut self,
        topic: &str,
        classes: &[&str],
    ) -> Result<Publisher<T>, ProgramError> {
        let about = About {
            classes: classes.iter().map(|name| (*name).into()).collect(),
            ..About::default()
        };
        self.wait_for_inputs()?;
        let topic_of = ResultTopic {
            about,
            ..ResultTopic::new(T::TYPE)
        };
        Ok(Publisher::open_with(self.follower.bus(), topic, topic_of)?)
    }

    /// As [`Program::output`] for other types: images, tensors, bytes.
    ///
    /// # Errors
    /// As [`Program::output`].
    pub fn output_of(
        &mut self,
        topic: &str,
        kind: ResultType,
    ) -> Result<schema_bus::ResultPublisher, ProgramError> {
        self.wait_for_inputs()?;
        let bus = self.follower.bus();
        Ok(bus.result_publisher(topic, &ResultTopic::new(kind))?)
    }

    fn wait_for_inputs(&mut self) -> Result<(), ProgramError> {
        let deadline = Instant::now() + START_TIMEOUT;
        loop {
            self.follower.wait(Duration::ZERO)?;
            let mut inputs = self.inputs.iter().map(|input| input.id());
            let Some(missing) = inputs.find(|id| !self.follower.found(*id)) else {
                return Ok(());
            };
            if self.stop.load(Relaxed) {
                return Ok(());
            }
            if Instant::now() >= deadline {
                return Err(ProgramError::NoInput(self.follower.name(missing).into()));
            }
            std::thread::sleep(LOOK_EVERY);
        }
    }

    /// Waits for the next frames to answer; `None` when the program was asked to end. In lockstep
    /// the call says that the last frames are done with.
    ///
    /// # Errors
    /// [`ProgramError`].
    #[expect(clippy::should_implement_trait, reason = "it can fail")]
    pub fn next(&mut self) -> Result<Option<Frames>, ProgramError> {
        if self.inputs.is_empty() {
            return Err(ProgramError::NoInputs);
        }
        if let (Some(name), None) = (&self.lockstep, &self.steps) {
            self.steps = Some(Steps::join(&mut self.follower, name, START_TIMEOUT)?);
        }
        while !self.stop.load(Relaxed) {
            if let Some(frames) = self.joined()? {
                return Ok(Some(frames));
            }
            let is_held = self.lacks_a_result() && Instant::now() < self.held_until;
            match &mut self.steps {
                Some(_) if is_held => {
                    // Another participant may still work on it.
                    self.follower.wait(MAX_WAIT)?;
                }
                Some(steps) => {
                    self.follower.wait(Duration::ZERO)?;
                    if steps.next(self.follower.bus(), MAX_WAIT)?.is_some() {
                        self.held_until = Instant::now() + RESULT_TIMEOUT;
                    }
                }
                None => {
                    self.follower.wait(MAX_WAIT)?;
                }
            }
        }
        Ok(None)
    }

    /// Whether results are all that is missing, from somebody who still lives.
    fn lacks_a_result(&self) -> bool {
        let mut lacks = false;
        for (head, input) in self.heads.iter().zip(&self.inputs) {
            match (head, input) {
                (Some(_), _) => {}
                (None, Followed::Frames(_)) => return false,
                (None, Followed::Results(id)) => lacks |= self.follower.results(*id).has_writer(),
            }
        }
        lacks
    }

    /// Samples of one tick, if all inputs have one. What waits for its partners is kept.
    fn joined(&mut self) -> Result<Option<Frames>, BusError> {
        loop {
            for (head, input) in self.heads.iter_mut().zip(&self.inputs) {
                if head.is_none() {
                    *head = match input {
                        Followed::Frames(id) => self.follower.take(*id)?.map(Head::Frame),
                        Followed::Results(id) => self.follower.take_result(*id)?.map(Head::Result),
                    };
                }
            }
            let heads: Vec<_> = self.heads.iter().flatten().collect();
            if heads.len() < self.heads.len() {
                return Ok(None);
            }
            // A simulator that was restarted counts from 1 again: the run that sent last holds. A
            // result that answers no frame is of every run.
            let of_runs = heads.iter().filter(|head| head.epoch() != 0);
            let newest = of_runs.max_by_key(|head| head.published_mono_nanos());
            let epoch = newest.map_or(0, |head| head.epoch());
            let of_run = |head: &Head| matches!(head.epoch(), of if of == epoch || of == 0);
            let ticks = heads.iter().filter(|head| of_run(head));
            let tick = ticks.map(|head| head.tick()).max().unwrap_or_default();
            let mut is_whole = true;
            for head in &mut self.heads {
                if !head
                    .as_ref()
                    .is_some_and(|it| of_run(it) && it.tick() == tick)
                {
                    (*head, is_whole) = (None, false);
                }
            }
            if is_whole {
                let frames = self.heads.iter_mut().filter_map(Option::take);
                return Ok(Some(Frames(frames.collect())));
            }
        }
    }
}
