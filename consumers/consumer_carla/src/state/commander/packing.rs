//! Commands on their way to the simulator: measured and checked, bounded while they wait, and packed
//! into requests that fail only those whose commands they have.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

use crossbeam_channel::Sender;
use parking_lot::{Condvar, Mutex};
use schema_frames::{Command, CommandReply};

use super::answer::{Answer, COMMAND_BYTES, CommandError};
use super::told::OnItsWay;

/// Most bytes of commands that may queue up before connections have to wait; one list of commands
/// may always.
pub const MAX_QUEUED_BYTES: usize = 64 << 20;
/// Most commands in one request to the simulator.
const BATCH: usize = 512;
/// Most bytes of several commands in one request to the simulator; a larger command goes alone.
const BATCH_BYTES: usize = 1 << 20;

/// Bytes of the commands that wait.
#[derive(Debug, Default)]
pub(super) struct Backlog {
    n_bytes: Mutex<usize>,
    freed: Condvar,
}

impl Backlog {
    /// Takes room for so many bytes; without `wait` only if there is room now.
    pub fn enter(self: &Arc<Self>, n_bytes: usize, wait: bool) -> Option<Room> {
        let mut taken = self.n_bytes.lock();
        while *taken > 0 && *taken + n_bytes > MAX_QUEUED_BYTES {
            if !wait {
                return None;
            }
            self.freed.wait(&mut taken);
        }
        *taken += n_bytes;
        Some(Room {
            backlog: self.clone(),
            n_bytes,
        })
    }
}

/// Room for commands that wait; free again when this is dropped.
#[derive(Debug)]
pub(super) struct Room {
    backlog: Arc<Backlog>,
    n_bytes: usize,
}

impl Drop for Room {
    fn drop(&mut self) {
        *self.backlog.n_bytes.lock() -= self.n_bytes;
        self.backlog.freed.notify_all();
    }
}

/// The length of a command as the simulator gets it.
pub(super) fn measure(command: &Command) -> Result<usize, CommandError> {
    let unwritable = |error: serde_json::Error| CommandError::Unwritable {
        cause: error.to_string(),
    };
    let text = serde_json::to_vec(command).map_err(unwritable)?;
    if text.len() > COMMAND_BYTES {
        let n_bytes = text.len();
        return Err(CommandError::TooLong { n_bytes });
    }
    // A number that JSON does not have would make the whole request unreadable.
    serde_json::from_slice::<Command>(&text).map_err(unwritable)?;
    Ok(text.len())
}

/// Commands of one client, in order.
pub(super) struct Ask {
    pub commands: Vec<Command>,
    /// Length of each, or why it is not sent.
    pub sizes: Vec<Result<usize, CommandError>>,
    pub reply: Option<Sender<Result<Answer, CommandError>>>,
    /// If nobody waits for the answer.
    pub _told: Option<OnItsWay>,
    pub _room: Room,
}

/// Consecutive commands of one ask, which are in one request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Part {
    pub ask: usize,
    pub commands: Range<usize>,
}

/// Requests for all commands of `asks`, given their lengths, in order: each as large as it may be.
/// Commands without a length are in none.
pub(super) fn requests(sizes: &[&[Result<usize, CommandError>]]) -> Vec<Vec<Part>> {
    let mut requests: Vec<Vec<Part>> = Vec::new();
    let (mut n_commands, mut n_bytes) = (0, 0);
    for (ask, sizes) in sizes.iter().enumerate() {
        for (idx, size) in sizes.iter().enumerate() {
            let Ok(size) = size else { continue };
            if requests.is_empty() || n_commands >= BATCH || n_bytes + size > BATCH_BYTES {
                requests.push(Vec::new());
                (n_commands, n_bytes) = (0, 0);
            }
            (n_commands, n_bytes) = (n_commands + 1, n_bytes + size);
            let Some(request) = requests.last_mut() else {
                continue;
            };
            match request.last_mut() {
                Some(part) if part.ask == ask && part.commands.end == idx => {
                    part.commands.end += 1;
                }
                _ => request.push(Part {
                    ask,
                    commands: idx..idx + 1,
                }),
            }
        }
    }
    requests
}

/// What became of one ask.
#[derive(Clone, Debug, Default)]
pub(super) struct Outcome {
    pub replies: BTreeMap<usize, CommandReply>,
    pub tick: u64,
    pub error: Option<CommandError>,
}

impl Outcome {
    /// One reply a command: those that were not run are refused, for the reason why. An ask of which
    /// nothing was run has failed as a whole.
    pub fn answer(mut self, sizes: &[Result<usize, CommandError>]) -> Result<Answer, CommandError> {
        let lost = self.error.clone().unwrap_or(CommandError::OtherLength);
        let unsent = sizes.iter().find_map(|size| size.as_ref().err());
        if self.replies.is_empty() && !sizes.is_empty() {
            return Err(self.error.or(unsent.cloned()).unwrap_or(lost));
        }
        let reply = |(idx, size): (usize, &Result<usize, CommandError>)| {
            let why = size.as_ref().err().unwrap_or(&lost);
            self.replies
                .remove(&idx)
                .unwrap_or_else(|| CommandReply::Refused {
                    error: why.to_string(),
                })
        };
        Ok(Answer {
            replies: sizes.iter().enumerate().map(reply).collect(),
            tick: self.tick,
        })
    }
}

/// Sends the commands of all asks, in order, by `request`, and says what became of each ask. A
/// request that fails fails only those whose commands it has.
pub(super) fn send_all(
    asks: &[Ask],
    mut request: impl FnMut(Vec<Command>) -> Result<Answer, CommandError>,
) -> Vec<Outcome> {
    let sizes: Vec<&[_]> = asks.iter().map(|ask| ask.sizes.as_slice()).collect();
    let mut outcomes = vec![Outcome::default(); asks.len()];
    let mut silence = None;
    for parts in requests(&sizes) {
        let commands_of = |part: &Part| asks[part.ask].commands[part.commands.clone()].iter();
        let commands: Vec<Command> = parts.iter().flat_map(commands_of).cloned().collect();
        let n_commands = commands.len();
        // Without a simulator that answers, the other requests would only take their time.
        let answer = match &silence {
            None => request(commands),
            Some(error) => Err(CommandError::clone(error)),
        };
        if let Err(error) = &answer {
            silence = Some(error.clone());
        }
        let answer = answer.and_then(|answer| {
            if answer.replies.len() == n_commands {
                return Ok(answer);
            }
            Err(match &answer.replies[..] {
                [CommandReply::Refused { error }] => CommandError::Refused(error.clone()),
                _ => CommandError::OtherLength,
            })
        });
        let replies: &[CommandReply] = answer.as_ref().map_or(&[], |answer| &answer.replies);
        let mut replies = replies.iter();
        for part in parts {
            let outcome = &mut outcomes[part.ask];
            match &answer {
                Ok(answer) => outcome.tick = answer.tick,
                Err(error) => outcome.error = Some(error.clone()),
            }
            outcome
                .replies
                .extend(part.commands.zip(replies.by_ref().cloned()));
        }
    }
    outcomes
}

#[cfg(test)]
mod tests {
    use schema_bus::qos;
    use schema_frames::CommandBatch;
    use schema_frames::document::PoseText;

    use super::*;

    fn part(ask: usize, commands: Range<usize>) -> Part {
        Part { ask, commands }
    }

    fn spawn(role: String, x_m: f64) -> Command {
        Command::Spawn {
            type_id: "vehicle.tesla.model3".into(),
            pose: PoseText {
                translation_m: [x_m, 0.0, 0.0],
                rotation_xyzw: [0.0, 0.0, 0.0, 1.0],
            },
            parent_id: None,
            role,
            attributes: BTreeMap::new(),
        }
    }

    fn ask(commands: Vec<Command>) -> Ask {
        Ask {
            sizes: commands.iter().map(measure).collect(),
            commands,
            reply: None,
            _told: None,
            _room: Arc::new(Backlog::default()).enter(0, false).unwrap(),
        }
    }

    /// A simulator that refuses what the real one does, by the length of a request and of a role,
    /// and that knows which actors it has made.
    #[derive(Default)]
    struct Simulator {
        made: Vec<u32>,
    }

    impl Simulator {
        fn request(&mut self, commands: Vec<Command>) -> Result<Answer, CommandError> {
            let batch = CommandBatch::new(commands);
            let refused = |error: &str| CommandReply::Refused {
                error: error.to_owned(),
            };
            let n_bytes = serde_json::to_vec(&batch).unwrap().len();
            if n_bytes > qos::MAX_COMMAND_BYTES {
                let replies = vec![refused("the request is too long")];
                return Ok(Answer { replies, tick: 3 });
            }
            let reply = |command: &Command| match command {
                Command::Spawn { role, .. } if role.len() <= 256 => {
                    let actor_id = 100 + self.made.len() as u32;
                    self.made.push(actor_id);
                    let topics = Vec::new();
                    CommandReply::Spawned { actor_id, topics }
                }
                _ => refused("the role is too long"),
            };
            let replies = batch.commands.iter().map(reply).collect();
            Ok(Answer { replies, tick: 3 })
        }
    }

    /// Of six clients whose commands wait together, two send megabytes that a request can hold, and
    /// one sends more than any request may have: the others get their actors, and there is none that
    /// no client knows.
    #[test]
    fn one_clients_16_mib_of_json_fail_its_own_request_only_and_leave_no_orphan() {
        let small = || spawn("hero".into(), 1.0);
        let large = |n_bytes: usize| spawn("x".repeat(n_bytes), 2.0);
        let asks = [
            ask(vec![small()]),
            ask(vec![small(), large(COMMAND_BYTES - 1024), small()]),
            ask(vec![small()]),
            ask(vec![large(10 << 20)]),
            // Each of these letters has six bytes in JSON.
            ask(vec![spawn("\u{1}".repeat(3 << 20), 2.0)]),
            ask(vec![small()]),
        ];
        let mut simulator = Simulator::default();
        let outcomes = send_all(&asks, |commands| simulator.request(commands));
        let mut told = Vec::new();
        let mut said: Vec<Vec<String>> = Vec::new();
        for (ask, outcome) in asks.iter().zip(outcomes) {
            let replies = outcome.answer(&ask.sizes).map(|answer| answer.replies);
            let replies = replies.unwrap_or_else(|error| {
                vec![CommandReply::Refused {
                    error: error.to_string(),
                }]
            });
            assert_eq!(replies.len(), ask.commands.len());
            said.push(Vec::new());
            for reply in replies {
                match reply {
                    CommandReply::Spawned { actor_id, .. } => told.push(actor_id),
                    CommandReply::Refused { error } => said.last_mut().unwrap().push(error),
                    other => panic!("{other:?}"),
                }
            }
        }
        assert_eq!(
            told, simulator.made,
            "each actor has a client that knows it"
        );
        assert_eq!(told.len(), 5);
        let none: [&str; 0] = [];
        assert_eq!(said[0], none);
        assert_eq!(said[1], ["the role is too long"]);
        assert_eq!(said[2], none);
        assert_eq!(said[3], ["the role is too long"]);
        assert!(said[4][0].contains("send less at a time"), "{said:?}");
        assert_eq!(said[5], none);
    }

    #[test]
    fn a_request_holds_what_fits_and_a_large_command_goes_alone() {
        let small = [Ok(100), Ok(100)];
        let large = [Ok(100), Ok(BATCH_BYTES + 1), Ok(100)];
        let unsent = [Ok(100), Err(CommandError::TooLong { n_bytes: 1 }), Ok(100)];
        assert_eq!(
            requests(&[&small, &large, &unsent, &[], &small]),
            [
                vec![part(0, 0..2), part(1, 0..1)],
                vec![part(1, 1..2)],
                vec![part(1, 2..3), part(2, 0..1), part(2, 2..3), part(4, 0..2)],
            ]
        );
        let many = vec![Ok(1); BATCH + 1];
        assert_eq!(
            requests(&[&many]),
            [vec![part(0, 0..BATCH)], vec![part(0, BATCH..BATCH + 1)]]
        );
    }

    /// What was run is told, so that no client has actors that it does not know.
    #[test]
    fn a_reply_is_not_lost_with_the_request_after_it() {
        let sizes = [Ok(1), Ok(1), Err(CommandError::TooLong { n_bytes: 9 })];
        let outcome = Outcome {
            replies: [(0, CommandReply::Done)].into(),
            tick: 5,
            error: Some(CommandError::NoAnswer("gone".into())),
        };
        let answer = outcome.answer(&sizes).unwrap();
        let refused = |reply: &CommandReply| match reply {
            CommandReply::Refused { error } => error.clone(),
            other => format!("{other:?}"),
        };
        assert_eq!((answer.tick, &answer.replies[0]), (5, &CommandReply::Done));
        assert_eq!(refused(&answer.replies[1]), "gone");
        assert!(refused(&answer.replies[2]).contains("9 bytes"));
        let failed = Outcome {
            error: Some(CommandError::OtherLength),
            ..Outcome::default()
        };
        assert_eq!(
            failed.answer(&sizes).unwrap_err(),
            CommandError::OtherLength
        );
        assert!(Outcome::default().answer(&[]).unwrap().replies.is_empty());
    }

    #[test]
    fn commands_that_would_spoil_a_request_of_all_are_sent_by_nobody() {
        assert!(measure(&spawn("hero".into(), 1.0)).is_ok_and(|n| n < 1000));
        let long = measure(&spawn("x".repeat(qos::MAX_COMMAND_BYTES), 1.0));
        assert!(
            matches!(long, Err(CommandError::TooLong { .. })),
            "{long:?}"
        );
        let odd = measure(&spawn(String::new(), f64::NAN));
        assert!(
            matches!(odd, Err(CommandError::Unwritable { .. })),
            "{odd:?}"
        );
    }

    #[test]
    fn what_waits_for_the_simulator_is_bounded() {
        let backlog = Arc::new(Backlog::default());
        let one = backlog.enter(2 * MAX_QUEUED_BYTES, false);
        assert!(one.is_some(), "one may always");
        assert!(backlog.enter(1, false).is_none());
        let waiting = backlog.clone();
        let waiter = std::thread::spawn(move || waiting.enter(1, true).is_some());
        drop(one);
        assert!(waiter.join().unwrap());
        assert!(backlog.enter(MAX_QUEUED_BYTES, false).is_some());
    }
}
