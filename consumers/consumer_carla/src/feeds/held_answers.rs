//! Answers that wait for a client's own Traffic Manager.
//!
//! The manager of the 0.9.16 client runs on a thread beside the script, over the same connection.
//! Each of its passes asks `get_episode_settings`, reads the newest snapshot that the client has,
//! and goes on only if it has not worked on that frame yet; the pass then asks
//! `get_vehicle_light_states`. The gateway sees only these calls, and three things must not happen
//! between them:
//!
//! - The script registers a vehicle that was born after the frame that the pass looks at: the
//!   manager takes it for destroyed and never drives it. In a stepped world the answer that lets
//!   the script go on (to the new manager's registration, to the spawn) therefore waits until the
//!   manager has worked on the newest frame.
//! - The script destroys a vehicle that the pass works on: the manager's thread ends its process. In
//!   a stepped world the answer waits until the pass is over; the next one sees no such vehicle.
//! - The script loads a world: the client has no episode between the answer to `load_new_episode`
//!   and its connection to the next world stream, and a pass in between ends its process. The
//!   answer therefore waits until the manager has asked `get_episode_settings`, and that call is
//!   answered when the client has connected.
//!
//! The script holds the newest frame when it spawns or destroys, so the first call of
//! `get_episode_settings` that is answered after that begins a pass on this frame or finds it worked
//! on, and the second call ends it.
//!
//! A manager in synchronous mode makes its passes within the script's own ticks and asks nothing
//! between them. It is told apart by its calls: one that runs freely asks again and again without a
//! pass, begins one without a cue, or works while the script cues a step. Every wait has an end, and
//! one that ends by itself is the last until the manager is seen to run freely.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use consumer_rpc::budget::{Account, Holding};
use consumer_rpc::server::Later;
use parking_lot::{Mutex, MutexGuard};

/// Longest wait for the first pass of a new Traffic Manager.
const FIRST_PASS: Duration = Duration::from_secs(1);
/// Longest wait for a manager that may have been switched to synchronous mode.
const PASS: Duration = Duration::from_millis(250);
/// Longest wait for a manager that has just been seen to run freely, on a busy machine.
const FREE_PASS: Duration = Duration::from_millis(1500);
/// For how long a manager that was seen to run freely is taken to do so.
const PROOF: Duration = Duration::from_secs(2);
/// A manager that asks so often without a pass runs freely; scripts ask, too.
const MANY_IDLE: u32 = 5;
/// A manager that asked nothing for so long is not between two passes.
const SILENT: Duration = Duration::from_millis(400);
/// Longest wait of a manager for the client's next world stream.
const JOIN: Duration = Duration::from_secs(3);

/// What a call did, as far as Traffic Managers care.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Did {
    /// A Traffic Manager was registered.
    Manager,
    /// A vehicle was born.
    Birth,
    /// An actor was destroyed.
    Death,
    /// A world was loaded.
    Load,
    /// A pass begins: `get_episode_settings`.
    Settings,
    /// A pass has looked at its frame: `get_vehicle_light_states`.
    Pass,
    /// A batch, with which most passes end.
    Batch,
    /// The script cued a step.
    Cue,
    /// Anything else.
    Other,
}

/// The world at a call.
#[derive(Clone, Copy, Debug, Default)]
pub struct Moment {
    /// Traffic Managers that this connection registered.
    pub n_managers: usize,
    /// Whether the world steps on cues.
    pub is_stepped: bool,
}

/// What an answer to the script waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Need {
    /// A pass has looked at its frame.
    AnyLook,
    /// A pass that began since has looked at its frame.
    Look,
    /// The pass is over.
    End,
}

/// An answer that waits.
#[derive(Debug)]
struct Held {
    answer: Vec<u8>,
    until: Instant,
    need: Need,
    /// What it costs its connection; a connection that cannot pay is closed.
    _cost: Option<Holding>,
}

impl Held {
    fn new(account: &Account, need: Need, answer: Vec<u8>, longest: Duration) -> Held {
        Held {
            _cost: account.hold(answer.len() + size_of::<Held>()).ok(),
            answer,
            until: Instant::now() + longest,
            need,
        }
    }
}

/// Where a client is in changing over to another world.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Change {
    #[default]
    None,
    /// The answer to its load is held until its managers pause.
    Leaving,
    /// It may have no episode.
    Joining,
}

#[derive(Debug)]
struct Client {
    account: Account,
    later: Later,
    /// Answers to the script.
    script: Vec<Held>,
    /// Answers to `get_episode_settings` while the client changes worlds.
    managers: Vec<Held>,
    change: Change,
    /// Calls of `get_episode_settings` since the script began to wait.
    n_settings: usize,
    /// When `get_episode_settings` was called last.
    asked: Option<Instant>,
    /// Whether the manager seems to run freely.
    is_free: bool,
    /// When it was last seen to do so.
    proven: Option<Instant>,
    /// Whether a pass has looked at its frame and sent no batch yet.
    is_working: bool,
    /// Whether the script cued a step since the last `get_episode_settings`.
    was_cued: bool,
    /// Calls of `get_episode_settings` in turn without a pass.
    n_idle: u32,
}

impl Client {
    fn new(account: Account, later: Later) -> Client {
        Client {
            account,
            later,
            script: Vec::new(),
            managers: Vec::new(),
            change: Change::None,
            n_settings: 0,
            asked: None,
            is_free: true,
            proven: None,
            is_working: false,
            was_cued: false,
            n_idle: 0,
        }
    }

    fn hold(&mut self, need: Need, answer: Vec<u8>, longest: Duration) -> Vec<u8> {
        self.n_settings = 0;
        let held = Held::new(&self.account, need, answer, longest);
        self.script.push(held);
        Vec::new()
    }

    /// Whether a manager may be about to work on the newest frame.
    fn is_behind(&self) -> bool {
        self.is_free && self.asked.is_some_and(|at| at.elapsed() < SILENT)
    }

    fn runs_freely(&mut self) {
        (self.is_free, self.proven) = (true, Some(Instant::now()));
    }

    /// How long to wait for a pass.
    fn patience(&self) -> Duration {
        let is_sure = self.proven.is_some_and(|at| at.elapsed() < PROOF);
        if is_sure { FREE_PASS } else { PASS }
    }

    /// A pass has looked at its frame.
    fn look(&mut self, answer: Vec<u8>) -> Vec<u8> {
        (self.is_working, self.n_idle) = (true, 0);
        if !self.was_cued {
            self.runs_freely();
        }
        let began_since = self.n_settings > 0;
        let (ready, waiting): (Vec<Held>, Vec<Held>) = std::mem::take(&mut self.script)
            .into_iter()
            .partition(|held| held.need == Need::AnyLook || held.need == Need::Look && began_since);
        self.script = waiting;
        joined(ready.into_iter(), answer)
    }

    /// All answers to the script, then `answer`.
    fn release(&mut self, answer: Vec<u8>) -> Vec<u8> {
        joined(self.script.drain(..), answer)
    }

    fn settings(&mut self, moment: Moment, answer: Vec<u8>) -> Vec<u8> {
        self.asked = Some(Instant::now());
        self.n_settings += 1;
        self.n_idle = self.n_idle.saturating_add(1);
        if self.n_idle >= MANY_IDLE && !self.was_cued {
            self.runs_freely();
        }
        (self.is_working, self.was_cued) = (false, false);
        match self.change {
            // The second call since then comes after a whole pass.
            Change::None if self.n_settings > moment.n_managers => self.release(answer),
            Change::None => answer,
            Change::Leaving | Change::Joining => {
                let held = Held::new(&self.account, Need::End, answer, JOIN);
                self.managers.push(held);
                if self.change == Change::Leaving && self.managers.len() >= moment.n_managers {
                    self.change = Change::Joining;
                    return self.release(Vec::new());
                }
                Vec::new()
            }
        }
    }

    /// Answers that have waited long enough.
    fn overdue(&mut self, now: Instant) -> Vec<u8> {
        let is_due = |held: &Vec<Held>| held.iter().any(|held| held.until <= now);
        let mut answers = Vec::new();
        if is_due(&self.script) {
            answers = self.release(answers);
            // The manager was silent: it waits for the script's next tick.
            (self.is_free, self.proven) = (false, None);
            if self.change == Change::Leaving {
                self.change = Change::Joining;
            }
        }
        if is_due(&self.managers) {
            self.change = Change::None;
            answers = joined(self.managers.drain(..), answers);
        }
        answers
    }
}

fn joined(held: impl Iterator<Item = Held>, last: Vec<u8>) -> Vec<u8> {
    let mut all: Vec<u8> = held.flat_map(|held| held.answer).collect();
    all.extend(last);
    all
}

/// Answers that wait, by connection.
#[derive(Debug, Default)]
pub struct HeldAnswers(Mutex<BTreeMap<u64, Client>>);

impl HeldAnswers {
    fn clients(&self) -> MutexGuard<'_, BTreeMap<u64, Client>> {
        self.0.lock()
    }

    /// Takes the answer to a call and returns what is to be sent now: nothing, or the answer, or
    /// others before it.
    pub fn pass(
        &self,
        account: &Account,
        later: &Later,
        did: Did,
        moment: Moment,
        answer: Vec<u8>,
    ) -> Vec<u8> {
        let connection = account.number();
        let mut clients = self.clients();
        if moment.n_managers == 0 {
            // The last manager may just have gone while answers waited for it.
            return match clients.remove(&connection) {
                Some(mut client) => {
                    let answer = client.release(answer);
                    joined(client.managers.drain(..), answer)
                }
                None => answer,
            };
        }
        let client = clients
            .entry(connection)
            .or_insert_with(|| Client::new(account.clone(), later.clone()));
        let is_behind = moment.is_stepped && client.is_behind();
        match did {
            Did::Manager if moment.is_stepped => {
                client.runs_freely();
                client.hold(Need::AnyLook, answer, FIRST_PASS)
            }
            Did::Birth if is_behind => client.hold(Need::Look, answer, client.patience()),
            Did::Death if is_behind => client.hold(Need::End, answer, client.patience()),
            Did::Load => {
                client.change = Change::Leaving;
                client.hold(Need::End, answer, PASS)
            }
            Did::Settings => client.settings(moment, answer),
            Did::Pass => client.look(answer),
            Did::Batch => {
                client.is_working = false;
                answer
            }
            Did::Cue => {
                client.was_cued = true;
                if client.is_working {
                    client.runs_freely();
                }
                answer
            }
            _ => answer,
        }
    }

    /// The client has connected to its world stream: it has an episode again.
    pub fn joined(&self, connection: u64) {
        let freed = self.clients().get_mut(&connection).and_then(|client| {
            if client.change != Change::Joining {
                return None;
            }
            client.change = Change::None;
            let answers = joined(client.managers.drain(..), Vec::new());
            Some((client.later.clone(), answers))
        });
        if let Some((later, answers)) = freed {
            // A connection that has ended needs no answers.
            let _ = later.send(&answers);
        }
    }

    /// Sends what has waited long enough.
    pub fn sweep(&self) {
        let now = Instant::now();
        for client in self.clients().values_mut() {
            let answers = client.overdue(now);
            if answers.is_empty() {
                continue;
            }
            let later = client.later.clone();
            // A client that does not read must not keep the others waiting.
            let spawned = std::thread::Builder::new()
                .name("answers".into())
                .spawn(move || drop(later.send(&answers)));
            if let Err(error) = spawned {
                tracing::warn!(%error, "cannot start a thread for an answer");
            }
        }
    }

    /// Forgets a connection that has ended.
    pub fn forget(&self, connection: u64) {
        self.clients().remove(&connection);
    }
}

#[cfg(test)]
mod tests {
    use std::net::{TcpListener, TcpStream};

    use super::*;

    /// A client with one manager on connection 1, and the other end of that connection.
    struct Case {
        account: Account,
        held: HeldAnswers,
        later: Later,
        other_end: TcpStream,
    }

    impl Case {
        fn new() -> Case {
            let listener = TcpListener::bind("127.0.0.1:0").unwrap();
            let other_end = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
            let (here, _) = listener.accept().unwrap();
            Case {
                account: Account::of(1),
                held: HeldAnswers::default(),
                later: Later::new(here),
                other_end,
            }
        }

        /// Which answers go out when a call with this answer was served.
        fn call(&self, did: Did, answer: &str) -> String {
            let moment = Moment {
                n_managers: 1,
                is_stepped: true,
            };
            let sent = self.held.pass(
                &self.account,
                &self.later,
                did,
                moment,
                answer.as_bytes().to_vec(),
            );
            String::from_utf8(sent).unwrap()
        }

        /// What came over the connection out of turn.
        fn arrived(&mut self, n_bytes: usize) -> String {
            use std::io::Read as _;
            self.other_end
                .set_read_timeout(Some(Duration::from_secs(20)))
                .unwrap();
            let mut bytes = vec![0; n_bytes];
            self.other_end.read_exact(&mut bytes).unwrap();
            String::from_utf8(bytes).unwrap()
        }
    }

    #[test]
    fn a_script_goes_on_once_its_new_manager_has_seen_the_frame() {
        let case = Case::new();
        assert_eq!(case.call(Did::Manager, "m"), "");
        assert_eq!(case.call(Did::Settings, "s"), "s");
        assert_eq!(case.call(Did::Other, "o"), "o");
        assert_eq!(case.call(Did::Pass, "p"), "mp");
        let late = Case::new();
        assert_eq!(late.call(Did::Manager, "m"), "");
        assert_eq!(late.call(Did::Settings, "s"), "s");
        assert_eq!(late.call(Did::Settings, "t"), "mt", "its pass was over");
    }

    #[test]
    fn a_birth_waits_for_a_look_at_the_newest_frame_and_a_death_for_the_end_of_the_pass() {
        let case = Case::new();
        assert_eq!(case.call(Did::Birth, "b"), "b", "no manager has asked");
        assert_eq!(case.call(Did::Settings, "s"), "s");
        assert_eq!(case.call(Did::Birth, "b"), "");
        assert_eq!(case.call(Did::Pass, "p"), "p", "it looked at another frame");
        assert_eq!(case.call(Did::Settings, "t"), "t");
        assert_eq!(case.call(Did::Pass, "q"), "bq");
        assert_eq!(case.call(Did::Death, "d"), "");
        assert_eq!(case.call(Did::Settings, "u"), "u");
        assert_eq!(case.call(Did::Pass, "r"), "r");
        assert_eq!(case.call(Did::Settings, "v"), "dv");
        let moment = Moment {
            n_managers: 1,
            is_stepped: false,
        };
        let sent = case.held.pass(
            &case.account,
            &case.later,
            Did::Birth,
            moment,
            b"b".to_vec(),
        );
        assert_eq!(sent, b"b", "a free world waits for its births elsewhere");
    }

    #[test]
    fn a_wait_for_a_manager_that_steps_with_the_script_is_the_last() {
        let mut case = Case::new();
        let cycle = |case: &Case| {
            case.call(Did::Settings, "s");
            case.call(Did::Cue, "c");
            case.call(Did::Pass, "p");
            case.call(Did::Batch, "b");
        };
        cycle(&case);
        assert_eq!(case.call(Did::Settings, "s"), "s");
        assert_eq!(case.call(Did::Birth, "b"), "");
        std::thread::sleep(PASS + Duration::from_millis(20));
        case.held.sweep();
        assert_eq!(case.arrived(1), "b");
        cycle(&case);
        case.call(Did::Settings, "s");
        assert_eq!(case.call(Did::Birth, "b"), "b");
        for _ in 0..MANY_IDLE {
            case.call(Did::Settings, "s");
        }
        assert_eq!(case.call(Did::Birth, "b"), "", "it runs freely now");
    }

    #[test]
    fn a_manager_that_works_while_the_script_cues_runs_freely() {
        let case = Case::new();
        case.call(Did::Settings, "s");
        case.held
            .0
            .lock()
            .values_mut()
            .for_each(|client| client.is_free = false);
        case.call(Did::Cue, "c");
        case.call(Did::Pass, "p");
        case.call(Did::Cue, "c");
        assert_eq!(case.call(Did::Death, "d"), "");
    }

    #[test]
    fn a_manager_pauses_while_its_client_has_no_episode() {
        let mut case = Case::new();
        assert_eq!(case.call(Did::Load, "l"), "");
        assert_eq!(case.call(Did::Pass, "p"), "p", "a pass goes on");
        assert_eq!(case.call(Did::Settings, "s"), "l", "the client may leave");
        assert_eq!(case.call(Did::Other, "i"), "i", "get_episode_info");
        assert_eq!(case.call(Did::Settings, "t"), "", "the script's own call");
        case.held.joined(1);
        assert_eq!(case.arrived(2), "st");
        assert_eq!(case.call(Did::Settings, "u"), "u");
    }

    #[test]
    fn every_wait_has_an_end() {
        let mut case = Case::new();
        assert_eq!(case.call(Did::Load, "l"), "");
        std::thread::sleep(PASS + Duration::from_millis(20));
        case.held.sweep();
        assert_eq!(case.arrived(1), "l", "its manager is in synchronous mode");
        assert_eq!(case.call(Did::Settings, "s"), "");
        let gone = Moment {
            n_managers: 0,
            is_stepped: true,
        };
        let sent = case
            .held
            .pass(&case.account, &case.later, Did::Other, gone, b"d".to_vec());
        assert_eq!(sent, b"sd", "the manager was shut down");
    }
}
