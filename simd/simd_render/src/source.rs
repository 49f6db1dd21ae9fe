//! What is asked of the simulator.

use std::cell::Cell;
use std::time::Duration;

use anyhow::Context as _;
use launch_cli::{Shutdown, wrong_usage};
use schema_bus::{Bus, RenderClient};
use simd_frames::share::{CameraList, Joined, Question, SceneryCopy, answer_of};

use crate::inbox::Inbox;

/// Longest wait for one answer. A simulator that loads a map answers late.
const ANSWER_WITHIN: Duration = Duration::from_secs(300);

/// The simulator is gone, or this program is asked to end.
#[derive(Debug, thiserror::Error)]
#[error("the simulator does not answer")]
pub struct NoAnswer;

/// The asking end.
pub struct Source<'a> {
    pub bus: &'a Bus,
    pub inbox: &'a Inbox,
    pub shutdown: &'a Shutdown,
    client: RenderClient,
}

impl<'a> Source<'a> {
    pub fn open(bus: &'a Bus, inbox: &'a Inbox, shutdown: &'a Shutdown) -> anyhow::Result<Self> {
        Ok(Source {
            client: bus.render_client()?,
            bus,
            inbox,
            shutdown,
        })
    }

    /// Asks for a share; `None` if nobody answers.
    pub fn join(&mut self, asked: &Question) -> anyhow::Result<Option<Joined>> {
        if !self.client.has_server() || !self.inbox.has_source(self.bus) {
            return Ok(None);
        }
        match self.ask(asked) {
            Ok(answer) => Ok(Some(
                serde_json::from_slice(&answer).context("the simulator's answer cannot be read")?,
            )),
            Err(error) if error.is::<NoAnswer>() => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// The newest list of a worker's cameras.
    pub fn cameras(&mut self, worker: u32) -> anyhow::Result<CameraList> {
        CameraList::from_bytes(&self.ask(&Question::Cameras { worker })?)
    }

    /// Brings the scenery up to date. Returns whether other objects are shown.
    pub fn scenery(&mut self, copy: &mut SceneryCopy) -> anyhow::Result<bool> {
        let mut list = copy.begin(&self.ask(&Question::Scenery)?)?;
        loop {
            let missing = list.missing();
            if missing.is_empty() {
                return Ok(copy.finish(list));
            }
            if list.add(&self.ask(&Question::Meshes { keys: missing })?)? == 0 {
                // What was listed has gone since.
                list = copy.begin(&self.ask(&Question::Scenery)?)?;
            }
        }
    }

    fn ask(&mut self, asked: &Question) -> anyhow::Result<Vec<u8>> {
        let text = serde_json::to_vec(asked)?;
        let (bus, inbox, shutdown) = (self.bus, self.inbox, self.shutdown);
        let n_looks = Cell::new(0u32);
        let mut go_on = || {
            n_looks.set(n_looks.get() + 1);
            !shutdown.requested() && (!n_looks.get().is_multiple_of(4) || inbox.has_source(bus))
        };
        let answer = self.client.ask(&text, ANSWER_WITHIN, &mut go_on)?;
        let answer = answer.ok_or(NoAnswer)?;
        match answer_of(&answer) {
            Ok(bytes) => Ok(bytes.to_vec()),
            Err(error) => Err(wrong_usage(error)),
        }
    }
}
