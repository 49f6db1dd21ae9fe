//! The bus side of the crowd: who comes and goes with episodes, and what the simulator answers.

use std::sync::Arc;
use std::time::{Duration, Instant};

use consumer_driver::crowd::{Crowd, CrowdOptions, ROLE};
use consumer_driver::traffic::Traffic;
use consumer_kit::FollowedDocument;
use schema_bus::{Bus, BusError, names};
use schema_frames::{ActorList, Catalogue, Command, CommandReply};
use schema_roads::RoadMap;

/// How long the catalogue is waited for.
const CATALOGUE_WAIT: Duration = Duration::from_secs(2);

/// The people that a session leads.
#[derive(Debug)]
pub(crate) struct People {
    options: CrowdOptions,
    catalogue: FollowedDocument,
    /// Map and seed of an episode whose crowd is still to be made.
    next: Option<(Arc<RoadMap>, u64)>,
    crowd: Option<Crowd>,
    n_said: usize,
}

impl People {
    /// `None` where nobody is wanted.
    pub fn new(options: CrowdOptions) -> Option<People> {
        (options.walkers > 0).then(|| People {
            options,
            catalogue: FollowedDocument::new(names::WORLD_CATALOGUE),
            next: None,
            crowd: None,
            n_said: 0,
        })
    }

    /// An episode begins.
    pub fn begin(&mut self, map: Arc<RoadMap>, seed: u64) {
        (self.next, self.crowd, self.n_said) = (Some((map, seed)), None, 0);
    }

    /// Makes the crowd once the catalogue is there, and takes over people of a process that was
    /// killed.
    pub fn prepare(&mut self, bus: &Bus, actors: &ActorList) -> Result<(), BusError> {
        if self.next.is_none() {
            return Ok(());
        }
        // The simulator has sent it; who comes must not depend on when it arrives.
        let deadline = Instant::now() + CATALOGUE_WAIT;
        while self.catalogue.changed(bus)?.is_none() && self.catalogue.newest().is_none() {
            if Instant::now() >= deadline {
                return Ok(());
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        let Some(document) = self.catalogue.newest() else {
            return Ok(());
        };
        let catalogue: Catalogue = document.json()?;
        if let Some((map, seed)) = self.next.take() {
            let mut crowd = Crowd::new(&map, &catalogue, self.options, seed);
            for actor in actors.actors.iter().filter(|actor| actor.role == ROLE) {
                crowd.came(actor.id, &actor.type_id);
            }
            self.crowd = Some(crowd);
        }
        Ok(())
    }

    /// What everybody does next.
    pub fn step(&mut self, traffic: &Traffic) -> Vec<Command> {
        self.crowd
            .as_mut()
            .map_or_else(Vec::new, |crowd| crowd.step(traffic))
    }

    /// Spawns for those that are still to come; the answers go to [`People::came`].
    pub fn missing(&mut self) -> Vec<Command> {
        self.crowd.as_mut().map_or_else(Vec::new, Crowd::missing)
    }

    /// The answers to [`People::missing`].
    pub fn came(&mut self, spawns: &[Command], replies: &[CommandReply]) {
        let Some(crowd) = &mut self.crowd else { return };
        for (spawn, reply) in spawns.iter().zip(replies) {
            match (spawn, reply) {
                (Command::Spawn { type_id, .. }, CommandReply::Spawned { actor_id, .. }) => {
                    crowd.came(*actor_id, type_id);
                }
                _ => crowd.was_refused(),
            }
        }
        if crowd.len() != self.n_said {
            self.n_said = crowd.len();
            tracing::info!(
                walkers = self.n_said,
                of = self.options.walkers,
                "leading people"
            );
        }
    }

    /// Takes everybody away.
    pub fn leave(&mut self) -> Vec<Command> {
        let crowd = self.crowd.take();
        let destroy = |actor_id| Command::Destroy { actor_id };
        crowd.iter().flat_map(Crowd::ids).map(destroy).collect()
    }
}
