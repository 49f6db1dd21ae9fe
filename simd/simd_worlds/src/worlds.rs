//! All worlds: they step side by side, and their rows are put together in order.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use simd_world::World;

use crate::course::Course;
use crate::error::WorldsError;
use crate::member::{ACTION_NAMES, Member};

/// Most worlds.
pub const MAX_WORLDS: usize = 65_536;
/// Most threads.
const MAX_THREADS: usize = 1024;
/// Slots that a thread takes at a time.
const CHUNK: usize = 4;

/// What happens to a world whose episode has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Autoreset {
    /// It begins anew in the same step: its state is the new one, and the last one is in
    /// [`Outputs::final_state`].
    SameStep,
    /// It begins anew in the next step, whose action counts for nothing.
    NextStep,
    /// It waits for [`Worlds::reset`].
    Disabled,
}

/// What came of the last call: flat arrays, a row per world.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outputs {
    /// Columns are [`crate::STATE_NAMES`].
    pub state: Vec<f32>,
    /// Reward of the step.
    pub reward: Vec<f32>,
    /// Whether the episode has ended by the rules.
    pub terminated: Vec<bool>,
    /// Whether it was cut off.
    pub truncated: Vec<bool>,
    /// Columns are [`crate::INFO_NAMES`].
    pub info: Vec<f32>,
    /// Last states of the episodes that ended in this step; rows count where `has_final` says so.
    pub final_state: Vec<f32>,
    /// Which rows of `final_state` count.
    pub has_final: Vec<bool>,
}

/// N worlds of a course.
pub struct Worlds {
    members: Vec<Member>,
    threads: Option<ThreadPool>,
    autoreset: Autoreset,
    outputs: Outputs,
    /// A member was left in the middle of a call, so that nothing may be asked of it any more.
    is_broken: bool,
}

impl Worlds {
    /// `n` worlds of a course, which must be reset before the first step.
    ///
    /// # Errors
    /// [`WorldsError::Count`], [`WorldsError::Threads`].
    pub fn new(
        course: Arc<Course>,
        n: usize,
        n_threads: usize,
        autoreset: Autoreset,
    ) -> Result<Worlds, WorldsError> {
        for (what, value, most) in [
            ("the number of worlds", n, MAX_WORLDS),
            ("the number of threads", n_threads, MAX_THREADS),
        ] {
            if !(1..=most).contains(&value) {
                let allowed = format!("1 to {most}");
                return Err(WorldsError::Count {
                    what,
                    value,
                    allowed,
                });
            }
        }
        let threads = match n_threads {
            1 => None,
            n => Some(ThreadPoolBuilder::new().num_threads(n).build()?),
        };
        let mut worlds = Worlds {
            members: (0..n).map(|_| Member::new(&course)).collect(),
            threads,
            autoreset,
            outputs: Outputs::default(),
            is_broken: false,
        };
        worlds.collect();
        Ok(worlds)
    }

    /// Number of worlds.
    pub fn n_worlds(&self) -> usize {
        self.members.len()
    }

    /// What came of the last call.
    pub fn outputs(&self) -> &Outputs {
        &self.outputs
    }

    /// A world, to look at.
    pub fn world(&self, world: usize) -> Option<&World> {
        self.members.get(world).map(|member| &member.world)
    }

    /// Begins all worlds anew: world k with the seed `seed + k`.
    ///
    /// # Errors
    /// [`WorldsError::Broken`], [`WorldsError::Lost`].
    pub fn reset_all(&mut self, seed: u64) -> Result<(), WorldsError> {
        let seeds: Vec<u64> = (0..self.members.len() as u64)
            .map(|k| seed.wrapping_add(k))
            .collect();
        self.each(&seeds, |member, seed| member.reset(*seed))?;
        self.collect();
        Ok(())
    }

    /// Begins those worlds anew that `mask` names, each with its own seed; the others stay as they
    /// are, with a reward of 0 and without an end.
    ///
    /// # Errors
    /// [`WorldsError::Length`], [`WorldsError::Broken`], [`WorldsError::Lost`].
    pub fn reset(&mut self, mask: &[bool], seeds: &[u64]) -> Result<(), WorldsError> {
        self.check_length("the mask", mask.len(), 1)?;
        self.check_length("the seeds", seeds.len(), 1)?;
        let both: Vec<(bool, u64)> = mask.iter().copied().zip(seeds.iter().copied()).collect();
        self.each(&both, |member, (is_named, seed)| match is_named {
            true => member.reset(*seed),
            false => member.pass_over(),
        })?;
        self.collect();
        Ok(())
    }

    /// Begins the next episode of those worlds that `mask` names, as an episode that has ended is
    /// followed by the next one; the others stay as they are, as in [`Worlds::reset`].
    ///
    /// # Errors
    /// [`WorldsError::Length`], [`WorldsError::NotReset`], [`WorldsError::Broken`],
    /// [`WorldsError::Lost`].
    pub fn begin_next(&mut self, mask: &[bool]) -> Result<(), WorldsError> {
        self.check_length("the mask", mask.len(), 1)?;
        let named = self.members.iter().zip(mask);
        let is_new = |(member, is_named): (&Member, &bool)| *is_named && !member.has_begun;
        if let Some(world) = named.map(is_new).position(|is_new| is_new) {
            return Err(WorldsError::NotReset { world });
        }
        self.each(mask, |member, is_named| {
            member.pass_over();
            if *is_named {
                member.outcome = Default::default();
                member.begin_next();
            }
        })?;
        self.collect();
        Ok(())
    }

    /// Steps every world; `actions` has [`ACTION_NAMES`] for each.
    ///
    /// # Errors
    /// [`WorldsError`]; no world has taken a step then.
    pub fn step(&mut self, actions: &[f32]) -> Result<(), WorldsError> {
        let (rows, _) = actions.as_chunks::<{ ACTION_NAMES.len() }>();
        self.check_length("the actions", actions.len(), ACTION_NAMES.len())?;
        for (world, row) in rows.iter().enumerate() {
            if let Some(index) = row.iter().position(|value| !value.is_finite()) {
                return Err(WorldsError::Action {
                    world,
                    index,
                    name: ACTION_NAMES[index],
                    value: row[index],
                });
            }
        }
        let members = self.members.iter();
        if let Some(world) = members.clone().position(|member| !member.has_begun) {
            return Err(WorldsError::NotReset { world });
        }
        let autoreset = self.autoreset;
        if autoreset == Autoreset::Disabled
            && let Some(world) = members.clone().position(|member| member.has_ended)
        {
            return Err(WorldsError::Ended { world });
        }
        self.each(rows, |member, action| {
            member.has_final = false;
            if member.has_ended {
                member.begin_next();
                member.outcome = Default::default();
                return;
            }
            member.step(*action);
            if member.has_ended && autoreset == Autoreset::SameStep {
                (member.final_state, member.has_final) = (member.state, true);
                member.begin_next();
            }
        })?;
        self.collect();
        Ok(())
    }

    /// Makes worlds futures of another: they go on from its present moment. Their seeds for later
    /// episodes stay their own.
    ///
    /// # Errors
    /// [`WorldsError::NoWorld`], [`WorldsError::NotReset`], [`WorldsError::Lost`].
    pub fn fork(&mut self, source: usize, into: &[usize]) -> Result<(), WorldsError> {
        let last = self.members.len() - 1;
        if self.is_broken {
            return Err(WorldsError::Lost);
        }
        if let Some(&world) = std::iter::once(&source).chain(into).find(|k| **k > last) {
            return Err(WorldsError::NoWorld { world, last });
        }
        if !self.members[source].has_begun {
            return Err(WorldsError::NotReset { world: source });
        }
        let checkpoint = self.members[source].world.checkpoint(0);
        for &world in into.iter().filter(|k| **k != source) {
            let [of, member] = self
                .members
                .get_disjoint_mut([source, world])
                .expect("both are there, and they differ");
            member.become_fork(of, &checkpoint);
        }
        self.collect();
        Ok(())
    }

    fn check_length(
        &self,
        what: &'static str,
        found: usize,
        each: usize,
    ) -> Result<(), WorldsError> {
        let n_worlds = self.members.len();
        match found == each * n_worlds {
            true => Ok(()),
            false => Err(WorldsError::Length {
                what,
                found,
                needed: each * n_worlds,
                each,
                n_worlds,
            }),
        }
    }

    /// Does something to every member with its own argument; members know nothing of each other.
    /// A panic is an error that names the first world of those that had one.
    fn each<T: Sync>(
        &mut self,
        arguments: &[T],
        act: impl Fn(&mut Member, &T) + Sync,
    ) -> Result<(), WorldsError> {
        if self.is_broken {
            return Err(WorldsError::Lost);
        }
        // Whoever was left half-way is not used again: these worlds refuse everything from now on.
        let guarded = |(world, (member, argument)): (usize, (&mut Member, &T))| {
            let done = catch_unwind(AssertUnwindSafe(|| act(member, argument)));
            done.err().map(|payload| (world, cause(&*payload)))
        };
        let members = &mut self.members;
        let broken = match &self.threads {
            None => members
                .iter_mut()
                .zip(arguments)
                .enumerate()
                .find_map(guarded),
            Some(threads) => threads.install(|| {
                members
                    .par_iter_mut()
                    .zip(arguments)
                    .enumerate()
                    .with_min_len(CHUNK)
                    .filter_map(guarded)
                    .min_by_key(|(world, _)| *world)
            }),
        };
        match broken {
            None => Ok(()),
            Some((world, cause)) => {
                self.is_broken = true;
                Err(WorldsError::Broken { world, cause })
            }
        }
    }

    fn collect(&mut self) {
        let out = &mut self.outputs;
        out.state.clear();
        out.reward.clear();
        out.terminated.clear();
        out.truncated.clear();
        out.info.clear();
        out.final_state.clear();
        out.has_final.clear();
        for member in &self.members {
            out.state.extend(member.state);
            out.reward.push(member.outcome.reward);
            out.terminated.push(member.outcome.terminated);
            out.truncated.push(member.outcome.truncated);
            out.info.extend(member.outcome.info);
            out.final_state.extend(member.final_state);
            out.has_final.push(member.has_final);
        }
    }
}

/// What a panic said.
fn cause(payload: &(dyn Any + Send)) -> String {
    let text = payload
        .downcast_ref::<&str>()
        .map(|text| (*text).to_owned());
    text.or_else(|| payload.downcast_ref::<String>().cloned())
        .unwrap_or_else(|| "it said nothing".to_owned())
}
