//! Many worlds with tasks, in this process: `simd_worlds` for `gantry.envs`, which is the interface.
//!
//! Results go straight into arrays of the caller. A call lets go of the global lock while it copies,
//! resets and steps.

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process;
use std::sync::{Arc, Weak};

use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyReadwriteArray1, PyReadwriteArray2};
use parking_lot::Mutex;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use simd_worlds::{
    ACTION_NAMES, Autoreset, Course, INFO_NAMES, Outputs, STATE_NAMES, Task, WorldsError,
};

use crate::errors;

/// Courses that some worlds still use, by the text of the task and the seed of the routes: worlds of
/// one task share their town.
static COURSES: Mutex<BTreeMap<(String, u64), Weak<Course>>> = Mutex::new(BTreeMap::new());

/// Arrays that a call fills, a row per world: state, reward, terminated, truncated, info, last state
/// of the episode that ended, and whether there is one.
type Arrays<'py> = (
    PyReadwriteArray2<'py, f32>,
    PyReadwriteArray1<'py, f32>,
    PyReadwriteArray1<'py, bool>,
    PyReadwriteArray1<'py, bool>,
    PyReadwriteArray2<'py, f32>,
    PyReadwriteArray2<'py, f32>,
    PyReadwriteArray1<'py, bool>,
);

/// Their memory.
struct Rows<'a> {
    numbers: [&'a mut [f32]; 4],
    flags: [&'a mut [bool]; 3],
}

impl<'a> Rows<'a> {
    fn of(arrays: &'a mut Arrays<'_>) -> PyResult<Rows<'a>> {
        let (state, reward, terminated, truncated, info, final_state, has_final) = arrays;
        Ok(Rows {
            numbers: [
                state.as_slice_mut()?,
                reward.as_slice_mut()?,
                info.as_slice_mut()?,
                final_state.as_slice_mut()?,
            ],
            flags: [
                terminated.as_slice_mut()?,
                truncated.as_slice_mut()?,
                has_final.as_slice_mut()?,
            ],
        })
    }

    /// Whether they have the lengths of `out`.
    fn fit(&self, out: &Outputs) -> bool {
        let numbers = [&out.state, &out.reward, &out.info, &out.final_state];
        let flags = [&out.terminated, &out.truncated, &out.has_final];
        let mut lengths = self.numbers.iter().zip(numbers);
        let mut others = self.flags.iter().zip(flags);
        lengths.all(|(to, from)| to.len() == from.len())
            && others.all(|(to, from)| to.len() == from.len())
    }

    fn fill(self, out: &Outputs) {
        let numbers = [&out.state, &out.reward, &out.info, &out.final_state];
        let flags = [&out.terminated, &out.truncated, &out.has_final];
        for (to, from) in self.numbers.into_iter().zip(numbers) {
            to.copy_from_slice(from);
        }
        for (to, from) in self.flags.into_iter().zip(flags) {
            to.copy_from_slice(from);
        }
    }
}

/// Why a call failed, without Python's lock.
enum Failure {
    Refused(WorldsError),
    Closed,
    Forked,
    Arrays,
}

impl From<WorldsError> for Failure {
    fn from(cause: WorldsError) -> Self {
        Failure::Refused(cause)
    }
}

impl From<Failure> for PyErr {
    fn from(failure: Failure) -> PyErr {
        match failure {
            Failure::Refused(cause) => match &cause {
                WorldsError::Count { .. }
                | WorldsError::Length { .. }
                | WorldsError::Action { .. }
                | WorldsError::NoWorld { .. } => PyValueError::new_err(cause.to_string()),
                _ => errors::gantry(cause.to_string()),
            },
            Failure::Closed => errors::gantry("these worlds were closed; make new ones"),
            Failure::Forked => errors::gantry(
                "these worlds step on threads, which a forked child does not have; make them in the child, with threads=1, or by multiprocessing's \"spawn\"",
            ),
            Failure::Arrays => {
                PyValueError::new_err("the arrays for the results have other lengths than these")
            }
        }
    }
}

/// N worlds of a task.
#[pyclass(frozen, module = "gantry._native")]
pub struct Worlds {
    worlds: Mutex<Option<simd_worlds::Worlds>>,
    course: Arc<Course>,
    /// The process that has their threads; `None` without threads.
    process: Option<u32>,
}

impl Worlds {
    /// Does something with the worlds and fills the arrays with what came of it.
    fn with(
        &self,
        py: Python<'_>,
        arrays: &mut Arrays<'_>,
        act: impl FnOnce(&mut simd_worlds::Worlds) -> Result<(), WorldsError> + Send,
    ) -> PyResult<()> {
        let rows = Rows::of(arrays)?;
        if self.process.is_some_and(|process| process != process::id()) {
            return Err(Failure::Forked.into());
        }
        py.detach(|| {
            let mut held = self.worlds.lock();
            let worlds = held.as_mut().ok_or(Failure::Closed)?;
            if !rows.fit(worlds.outputs()) {
                return Err(Failure::Arrays);
            }
            act(worlds)?;
            rows.fill(worlds.outputs());
            Ok(())
        })
        .map_err(PyErr::from)
    }
}

#[pymethods]
impl Worlds {
    /// Worlds of a task, given as the text of its file; `seed` is that of the routes.
    #[new]
    fn make(
        py: Python<'_>,
        task: &str,
        n_worlds: usize,
        n_threads: usize,
        autoreset: &str,
        seed: u64,
    ) -> PyResult<Self> {
        let autoreset = match autoreset {
            "SameStep" => Autoreset::SameStep,
            "NextStep" => Autoreset::NextStep,
            "Disabled" => Autoreset::Disabled,
            other => {
                return Err(PyValueError::new_err(format!(
                    "autoreset is {other:?}; allowed are \"SameStep\", \"NextStep\" and \"Disabled\""
                )));
            }
        };
        py.detach(|| {
            let course = course(task, seed)?;
            let worlds = simd_worlds::Worlds::new(course.clone(), n_worlds, n_threads, autoreset)
                .map_err(Failure::from)?;
            Ok(Worlds {
                worlds: Mutex::new(Some(worlds)),
                course,
                process: (n_threads > 1).then(process::id),
            })
        })
    }

    /// Begins those worlds anew that `mask` names, each with its seed.
    fn reset(
        &self,
        py: Python<'_>,
        mask: PyReadonlyArray1<'_, bool>,
        seeds: PyReadonlyArray1<'_, u64>,
        mut arrays: Arrays<'_>,
    ) -> PyResult<()> {
        let (mask, seeds) = (mask.as_slice()?, seeds.as_slice()?);
        self.with(py, &mut arrays, |worlds| worlds.reset(mask, seeds))
    }

    /// Begins the next episode of those worlds that `mask` names.
    fn begin_next(
        &self,
        py: Python<'_>,
        mask: PyReadonlyArray1<'_, bool>,
        mut arrays: Arrays<'_>,
    ) -> PyResult<()> {
        let mask = mask.as_slice()?;
        self.with(py, &mut arrays, |worlds| worlds.begin_next(mask))
    }

    /// Steps every world.
    fn step(
        &self,
        py: Python<'_>,
        actions: PyReadonlyArray2<'_, f32>,
        mut arrays: Arrays<'_>,
    ) -> PyResult<()> {
        let actions = actions.as_slice()?;
        self.with(py, &mut arrays, |worlds| worlds.step(actions))
    }

    /// Makes worlds futures of another.
    fn fork(
        &self,
        py: Python<'_>,
        source: usize,
        into: Vec<usize>,
        mut arrays: Arrays<'_>,
    ) -> PyResult<()> {
        self.with(py, &mut arrays, |worlds| worlds.fork(source, &into))
    }

    /// Lets go of the worlds.
    fn close(&self, py: Python<'_>) {
        // Threads that a forked child does not have cannot be joined.
        let is_ours = self.process.is_none_or(|process| process == process::id());
        py.detach(|| {
            let worlds = self.worlds.lock().take();
            if !is_ours {
                std::mem::forget(worlds);
            }
        });
    }

    /// Name of the task, limit of steps of an episode, and length of a step in seconds.
    fn task(&self) -> (String, u32, f64) {
        let task = self.course.task();
        (task.name.clone(), task.limit_steps, task.step_secs())
    }

    /// When the task is solved: episodes, least mean of (return / limit of steps), greatest shares
    /// of contacts and lanes left, and of needless stops.
    fn solved(&self) -> (u32, f64, f64, f64) {
        let solved = &self.course.task().solved;
        (
            solved.episodes,
            solved.min_mean_return_ratio,
            solved.max_contact_share,
            solved.max_needless_share,
        )
    }
}

impl Drop for Worlds {
    fn drop(&mut self) {
        if self.process.is_some_and(|process| process != process::id()) {
            std::mem::forget(self.worlds.get_mut().take());
        }
    }
}

/// The course of a task, of those in use or prepared now.
fn course(text: &str, seed: u64) -> PyResult<Arc<Course>> {
    let mut courses = COURSES.lock();
    courses.retain(|_, course| course.strong_count() > 0);
    let key = (text.to_owned(), seed);
    if let Some(course) = courses.get(&key).and_then(Weak::upgrade) {
        return Ok(course);
    }
    let task = Task::from_toml(text).map_err(|error| PyValueError::new_err(error.to_string()))?;
    let name = task.name.clone();
    let made = catch_unwind(AssertUnwindSafe(|| Course::new(task, seed)));
    let course = made.map_err(|_| {
        errors::gantry(format!(
            "the simulator broke down while it prepared task {name:?}; please report this with the task"
        ))
    })?;
    let course = Arc::new(course.map_err(|error| PyValueError::new_err(error.to_string()))?);
    courses.insert(key, Arc::downgrade(&course));
    Ok(course)
}

/// The built-in tasks and the texts of their files.
#[pyfunction]
pub fn tasks() -> Vec<(&'static str, &'static str)> {
    let texts = Task::names().map(|name| Some((name, Task::text(name).ok()?)));
    texts.flatten().collect()
}

/// Names of the actions, of the state's columns and of the figures of a step.
#[pyfunction]
pub fn columns() -> (Vec<&'static str>, Vec<&'static str>, Vec<&'static str>) {
    (
        ACTION_NAMES.to_vec(),
        STATE_NAMES.to_vec(),
        INFO_NAMES.to_vec(),
    )
}
