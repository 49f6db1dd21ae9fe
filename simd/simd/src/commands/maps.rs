//! Another map while the daemon runs.

use schema_frames::{CommandReply, JournalFile};

use crate::clock::Clock;
use crate::files::ReadMap;
use crate::history::History;
use crate::participants::Participants;
use crate::ports::Ports;
use crate::sensing::Sensing;
use crate::world::LiveWorld;

/// What another map touches.
pub struct Context<'a> {
    pub world: &'a mut LiveWorld,
    pub sensing: &'a mut Sensing,
    pub ports: &'a mut Ports,
    pub clock: &'a Clock,
    pub participants: &'a Participants,
    pub history: &'a mut History,
}

/// Begins a new episode on another map or the same one. The launch file's actors are made anew and
/// its topics stay; sensors that commands made end.
///
/// The new world is built beside the old one and takes its place when nothing can fail any more, so
/// that a map that cannot be used leaves the old world as it is.
pub fn load(context: Context<'_>, map: &str, read: ReadMap) -> anyhow::Result<CommandReply> {
    let Context {
        world,
        sensing,
        ports,
        clock,
        participants,
        history,
    } = context;
    sensing.finish_all()?;
    let (start, is_owed) = (clock.now(), participants.are_there());
    let ReadMap { loaded, text } = read;
    if let Some(text) = text {
        history.note_file(JournalFile::Map, map, &loaded.data.name, text.as_bytes());
    }
    let next = world.prepare(&loaded, start, sensing.staying())?;
    sensing.load_next(next.episode().assets(), world.episode().assets())?;
    let actors = world.begin(next);
    sensing.begin_episode(actors, start, clock, is_owed)?;
    world.mark_start();
    ports.touch_info();
    // The map before was as large as this one.
    launch_cli::heap::give_back();
    let episode = world.episode().stamp().episode;
    tracing::info!(map, episode, "map loaded");
    Ok(CommandReply::Done)
}
