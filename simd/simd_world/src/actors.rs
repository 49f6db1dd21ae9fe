//! The registry of actors: what is constant about each, and counts that only ever rise.

#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

use std::collections::BTreeMap;
use std::sync::Arc;

use schema_frames::ActorKind;
use schema_frames::document::{ActorInfo, ActorList, BodyBox, Catalogue, TopicInfo};
use schema_frames::journal::FIRST_ADDED_ID;
use schema_frames::limits::{MAX_ACTOR_TEXT_BYTES, MAX_ACTORS, check_actor_texts, json_bytes};
use schema_types::{ActorId, Pose};
use serde::{Deserialize, Serialize};

use crate::errors::{ActorError, DestroyError, NoRoom};

/// Everything constant about an actor, and its place on its parent.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Actor {
    pub id: ActorId,
    pub kind: ActorKind,
    /// Index into the catalogue's entries.
    pub catalogue_idx: u32,
    pub role: String,
    pub parent: Option<ActorId>,
    /// World pose of an actor that does not move by itself; pose on the parent of an attached one.
    pub pose: Pose,
    pub attributes: BTreeMap<String, String>,
    pub topics: Vec<TopicInfo>,
}

impl Actor {
    /// The catalogue id of its type.
    pub fn type_id<'c>(&self, catalogue: &'c Catalogue) -> &'c String {
        &catalogue.entries[self.catalogue_idx as usize].type_id
    }

    fn text_bytes(&self) -> usize {
        text_bytes(&self.role, &self.attributes)
    }
}

/// Bytes of JSON that a role and attributes take in `world/actors`, about.
fn text_bytes(role: &str, attributes: &BTreeMap<String, String>) -> usize {
    let of_one = |(name, value): (&String, &String)| {
        let both = json_bytes(name).saturating_add(json_bytes(value));
        both.saturating_add(2)
    };
    let add = |sum: usize, one| sum.saturating_add(one);
    attributes.iter().map(of_one).fold(json_bytes(role), add)
}

/// All actors by rising id. A parent always has a smaller id than what is attached to it.
#[derive(Clone, Default, Serialize, Deserialize)]
pub(crate) struct Actors {
    /// Changed by `add` and `remove` alone, which keep the sum beside it.
    /// Copies of a world share what is constant about an actor.
    #[serde(with = "crate::serde_forms::shared_values")]
    pub by_id: BTreeMap<ActorId, Arc<Actor>>,
    #[serde(skip)]
    text_bytes: usize,
}

impl Actors {
    pub fn get(&self, actor: ActorId) -> Result<&Actor, ActorError> {
        let found = self.by_id.get(&actor).map(Arc::as_ref);
        found.ok_or(ActorError::Unknown(actor))
    }

    pub fn get_mut(&mut self, actor: ActorId) -> Result<&mut Actor, ActorError> {
        let found = self.by_id.get_mut(&actor).map(Arc::make_mut);
        found.ok_or(ActorError::Unknown(actor))
    }

    pub fn contains(&self, actor: ActorId) -> bool {
        self.by_id.contains_key(&actor)
    }

    pub fn add(&mut self, actor: Actor) {
        self.text_bytes = self.text_bytes.saturating_add(actor.text_bytes());
        if let Some(before) = self.by_id.insert(actor.id, Arc::new(actor)) {
            self.text_bytes = self.text_bytes.saturating_sub(before.text_bytes());
        }
    }

    pub fn remove(&mut self, actor: ActorId) {
        if let Some(gone) = self.by_id.remove(&actor) {
            self.text_bytes = self.text_bytes.saturating_sub(gone.text_bytes());
        }
    }

    /// Sums the texts up anew, after the actors were read from a checkpoint.
    pub fn recount(&mut self) {
        let texts = self.by_id.values().map(|actor| actor.text_bytes());
        self.text_bytes = texts.fold(0, usize::saturating_add);
    }

    /// Whether all of them are within the limits of a world.
    ///
    /// # Errors
    /// [`NoRoom`].
    pub fn check(&self) -> Result<(), NoRoom> {
        if self.by_id.len() > MAX_ACTORS {
            return Err(NoRoom::Actors);
        }
        match self.text_bytes > MAX_ACTOR_TEXT_BYTES {
            true => Err(NoRoom::Texts),
            false => Ok(()),
        }
    }

    /// Whether there is room for one more with this role and these attributes.
    ///
    /// # Errors
    /// [`NoRoom`].
    pub fn check_room(
        &self,
        role: &str,
        attributes: &BTreeMap<String, String>,
    ) -> Result<(), NoRoom> {
        if self.by_id.len() >= MAX_ACTORS {
            return Err(NoRoom::Actors);
        }
        let texts = attributes
            .iter()
            .map(|(name, value)| (name.as_str(), value.as_str()));
        check_actor_texts(role, texts)?;
        match self.text_bytes.saturating_add(text_bytes(role, attributes)) > MAX_ACTOR_TEXT_BYTES {
            true => Err(NoRoom::Texts),
            false => Ok(()),
        }
    }

    /// Why `actor` cannot be treated as a `needed`: it does not exist or is of another kind.
    pub fn is_no(&self, needed: &'static str, actor: ActorId, catalogue: &Catalogue) -> ActorError {
        match self.get(actor) {
            Err(unknown) => unknown,
            Ok(other) => ActorError::WrongKind {
                actor,
                type_id: other.type_id(catalogue).clone(),
                needed,
            },
        }
    }

    /// An actor that may be destroyed and everything attached to it, by rising id.
    pub fn with_attached(
        &self,
        actor: ActorId,
        catalogue: &Catalogue,
    ) -> Result<Vec<ActorId>, DestroyError> {
        let target = self.by_id.get(&actor).ok_or(DestroyError::Unknown(actor))?;
        if !matches!(
            target.kind,
            ActorKind::Vehicle
                | ActorKind::Walker
                | ActorKind::Prop
                | ActorKind::Sensor
                | ActorKind::Controller
        ) {
            let type_id = target.type_id(catalogue).clone();
            return Err(DestroyError::OfTheMap { actor, type_id });
        }
        let mut found = vec![actor];
        // Parents have smaller ids, so one pass finds whole chains.
        for other in self.by_id.range(actor..).map(|(_, other)| other) {
            if other.parent.is_some_and(|parent| found.contains(&parent)) {
                found.push(other.id);
            }
        }
        Ok(found)
    }

    /// The document `world/actors`; `trigger_boxes` are those of lights and signs.
    pub fn list(
        &self,
        catalogue: &Catalogue,
        trigger_boxes: &BTreeMap<ActorId, BodyBox>,
    ) -> ActorList {
        let info = |actor: &Actor| {
            let entry = &catalogue.entries[actor.catalogue_idx as usize];
            ActorInfo {
                id: actor.id.0,
                type_id: entry.type_id.clone(),
                kind: entry.kind.clone(),
                role: actor.role.clone(),
                parent_id: actor.parent.map_or(0, |parent| parent.0),
                mount: actor.parent.map(|_| actor.pose.into()),
                body_box: BodyBox { ..entry.body_box },
                trigger_box: trigger_boxes.get(&actor.id).copied(),
                attributes: actor.attributes.clone(),
                topics: actor.topics.clone(),
            }
        };
        ActorList {
            actors: self.by_id.values().map(|actor| info(actor)).collect(),
        }
    }
}

/// Counts that only ever rise: restoring a checkpoint does not turn them back.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(crate) struct Counts {
    next_actor: u32,
    /// Next id of the range that sensors added to an old run have.
    next_added: u32,
    /// Changes of the list of actors.
    pub actors_revision: u64,
    /// Map loads.
    pub episode: u32,
}

impl Counts {
    /// The counts of a world that has never had an actor.
    pub const START: Counts = Counts {
        next_actor: 1,
        next_added: FIRST_ADDED_ID,
        actors_revision: 0,
        episode: 0,
    };

    /// The id that the next actor gets.
    pub fn next_actor(&self) -> u32 {
        self.next_actor
    }

    /// Whether there are ids for `n` actors more.
    ///
    /// # Errors
    /// [`NoRoom::Ids`].
    pub fn check_ids(&self, n: u32) -> Result<(), NoRoom> {
        let ends = [
            (self.next_actor, FIRST_ADDED_ID),
            (self.next_added, u32::MAX),
        ];
        let is_room = |(next, end): (u32, u32)| next.checked_add(n).is_some_and(|next| next <= end);
        match ends.into_iter().all(is_room) {
            true => Ok(()),
            false => Err(NoRoom::Ids),
        }
    }

    /// An id that no actor has had before, after [`Counts::check_ids`].
    pub fn new_id(&mut self) -> ActorId {
        let id = ActorId(self.next_actor);
        self.next_actor = self.next_actor.saturating_add(1);
        id
    }

    /// An id for a sensor that is added to an old run: far from all others, so that those stay as
    /// they were without it.
    pub fn new_added_id(&mut self) -> ActorId {
        let id = ActorId(self.next_added);
        self.next_added = self.next_added.saturating_add(1);
        id
    }

    /// The counts after a restore: ids of both histories stay used, the other counts go on from
    /// `living`.
    pub fn after_restore(self, living: Counts) -> Counts {
        Counts {
            next_actor: self.next_actor.max(living.next_actor),
            ..living
        }
    }
}
