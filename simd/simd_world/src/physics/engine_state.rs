//! The physics engine's state, copied and written into checkpoints.
//!
//! In a checkpoint's bytes, colliders of the map travel with a stand-in for their shape and take
//! the shape back from the living world.

#![cfg_attr(not(test), warn(clippy::arithmetic_side_effects))]

use std::collections::BTreeSet;

use rapier3d::prelude::*;
use serde::{Deserialize as _, Deserializer, Serialize as _, Serializer};

/// A copy of the engine's state. Pipelines and solvers hold no state between steps and are made
/// anew.
pub(crate) fn copy(engine: &PhysicsWorld) -> PhysicsWorld {
    PhysicsWorld {
        gravity: engine.gravity,
        integration_parameters: engine.integration_parameters,
        physics_pipeline: PhysicsPipeline::new(),
        collision_pipeline: CollisionPipeline::new(),
        islands: engine.islands.clone(),
        broad_phase: engine.broad_phase.clone(),
        narrow_phase: engine.narrow_phase.clone(),
        bodies: engine.bodies.clone(),
        colliders: engine.colliders.clone(),
        impulse_joints: engine.impulse_joints.clone(),
        multibody_joints: engine.multibody_joints.clone(),
        soft_bodies: engine.soft_bodies.clone(),
        ccd_solver: CCDSolver::new(),
    }
}

/// Makes an engine a copy of another. Its pipelines and solvers stay, so that their memory is used
/// again.
pub(crate) fn copy_into(engine: &mut PhysicsWorld, other: &PhysicsWorld) {
    let PhysicsWorld {
        gravity,
        integration_parameters,
        physics_pipeline: _,
        collision_pipeline: _,
        islands,
        broad_phase,
        narrow_phase,
        bodies,
        colliders,
        impulse_joints,
        multibody_joints,
        soft_bodies,
        ccd_solver: _,
    } = other;
    engine.gravity = *gravity;
    engine.integration_parameters = *integration_parameters;
    engine.islands.clone_from(islands);
    engine.broad_phase.clone_from(broad_phase);
    engine.narrow_phase.clone_from(narrow_phase);
    engine.bodies.clone_from(bodies);
    engine.colliders.clone_from(colliders);
    engine.impulse_joints.clone_from(impulse_joints);
    engine.multibody_joints.clone_from(multibody_joints);
    engine.soft_bodies.clone_from(soft_bodies);
}

/// Colliders whose shape comes with the map: only they are triangle meshes.
fn geometry(engine: &PhysicsWorld) -> impl Iterator<Item = ColliderHandle> + '_ {
    engine
        .colliders
        .iter()
        .filter(|(_, collider)| collider.shape().as_trimesh().is_some())
        .map(|(handle, _)| handle)
}

/// Radius of a stand-in shape; no real shape is that small.
const STAND_IN_M: f32 = f32::MIN_POSITIVE;

pub(crate) fn serialize<S: Serializer>(
    engine: &PhysicsWorld,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    let mut light = copy(engine);
    for handle in geometry(engine) {
        if let Some(collider) = light.colliders.get_mut(handle) {
            collider.set_shape(SharedShape::ball(STAND_IN_M));
        }
    }
    light.serialize(serializer)
}

pub(crate) fn deserialize<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<PhysicsWorld, D::Error> {
    PhysicsWorld::deserialize(deserializer)
}

/// A checkpoint's engine holds colliders of a map that the living world does not have.
#[derive(Clone, Copy, Debug, thiserror::Error)]
#[error("it has solid geometry that the loaded map lacks")]
pub(crate) struct LackingGeometry;

/// Replaces the stand-ins by the living world's colliders. They are copied whole: with them comes
/// their "unchanged" mark, so the engine keeps what it knows of their contacts.
pub(crate) fn take_geometry(
    engine: &mut PhysicsWorld,
    living: &PhysicsWorld,
) -> Result<(), LackingGeometry> {
    for handle in geometry(living) {
        let Some(original) = living.colliders.get(handle) else {
            continue;
        };
        if let Some(stand_in) = engine.colliders.get_mut(handle) {
            let is_enabled = stand_in.is_enabled();
            *stand_in = original.clone();
            if stand_in.is_enabled() != is_enabled {
                stand_in.set_enabled(is_enabled);
            }
        }
    }
    let is_stand_in = |collider: &Collider| {
        collider
            .shape()
            .as_ball()
            .is_some_and(|ball| ball.radius == STAND_IN_M)
    };
    match engine
        .colliders
        .iter()
        .any(|(_, collider)| is_stand_in(collider))
    {
        true => Err(LackingGeometry),
        false => Ok(()),
    }
}

/// Takes over what never changes, and what this world has none of.
pub(crate) fn take_constants(engine: &mut PhysicsWorld, living: &PhysicsWorld) {
    engine.gravity = living.gravity;
    engine.integration_parameters = living.integration_parameters;
    engine.impulse_joints = living.impulse_joints.clone();
    engine.multibody_joints = living.multibody_joints.clone();
    engine.soft_bodies = living.soft_bodies.clone();
}

/// The bodies that carry the map's geometry.
pub(crate) fn map_bodies(engine: &PhysicsWorld) -> impl Iterator<Item = RigidBodyHandle> + '_ {
    geometry(engine).filter_map(|handle| engine.colliders.get(handle)?.parent())
}

/// What an engine that was read from a checkpoint cannot be.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum WrongEngine {
    #[error("a collider is neither a box nor geometry of the map")]
    Shape,
    #[error("a collider belongs to no body")]
    Parent,
    #[error("the tree of its colliders is no tree")]
    Tree,
}

/// Checks what the engine believes without looking: it walks over its tree of colliders until the
/// end, wherever the links lead, and its shapes would be read again when they touch something.
///
/// # Errors
/// The first thing that cannot be.
pub(crate) fn check<'l>(
    engine: &PhysicsWorld,
    of_map: impl Fn(ColliderHandle) -> Option<&'l Collider>,
) -> Result<(), WrongEngine> {
    for (handle, collider) in engine.colliders.iter() {
        let shape = collider.shape();
        // Geometry was taken from the living world, so it is of the map exactly where that has it.
        let is_of_map = || of_map(handle).is_some_and(|it| it.shape().as_trimesh().is_some());
        if shape.as_cuboid().is_none() && !(shape.as_trimesh().is_some() && is_of_map()) {
            return Err(WrongEngine::Shape);
        }
        let parent = collider.parent().and_then(|body| engine.bodies.get(body));
        if parent.is_none_or(|body| !body.colliders().contains(&handle)) {
            return Err(WrongEngine::Parent);
        }
    }
    let colliders = &engine.colliders;
    let mut ends = engine.bodies.iter().flat_map(|(_, body)| body.colliders());
    if ends.any(|handle| colliders.get(*handle).is_none()) {
        return Err(WrongEngine::Parent);
    }
    match Tree::of(&engine.broad_phase).is_some_and(|tree| tree.is_sound()) {
        true => Ok(()),
        false => Err(WrongEngine::Tree),
    }
}

/// The engine's tree of colliders as it is written: the type keeps its fields to itself.
#[derive(Debug, serde::Deserialize)]
struct Tree {
    /// Two children each; the first node is the root.
    nodes: Vec<[Child; 2]>,
    /// Where each node hangs: twice the number of the node above, and 1 on its right side.
    parents: Vec<usize>,
    leaves: Leaves,
    /// Which node is optimised next, and where that goes on.
    _optimised: [u32; 2],
    /// Nodes that nothing hangs on, to be used again.
    free: Vec<u32>,
}

/// Where the leaf of each collider's number hangs, as `parents` says it of nodes.
#[derive(Debug, serde::Deserialize)]
struct Leaves {
    n: usize,
    by_number: Vec<Option<usize>>,
}

/// One side of a node.
#[derive(Debug, serde::Deserialize)]
struct Child {
    _low: [f32; 3],
    /// Another node, or a collider's number if this is a leaf.
    below: u32,
    _high: [f32; 3],
    /// Number of leaves below in the low 30 bits; 1 for a leaf.
    data: u32,
}

impl Child {
    fn n_leaves(&self) -> u32 {
        self.data & 0x3fff_ffff
    }
}

impl Tree {
    fn of(broad_phase: &BroadPhaseBvh) -> Option<Tree> {
        let bytes = postcard::to_allocvec(broad_phase).ok()?;
        postcard::take_from_bytes(&bytes).ok().map(|(tree, _)| tree)
    }

    /// Whether every node is reached once from the root, says where it hangs, and counts the leaves
    /// below it; whether each leaf is where the list of them says, and no free node is in use.
    fn is_sound(&self) -> bool {
        let n_listed = self.leaves.by_number.iter().flatten().count();
        let is_listed = |child: &Child, place: usize| {
            self.leaves.by_number.get(child.below as usize) == Some(&Some(place))
        };
        let Some(root) = self.nodes.first() else {
            return n_listed == 0 && self.leaves.n == 0 && self.free.is_empty();
        };
        // A tree of one collider has a root with an empty right side, one of none has two.
        if root[1].n_leaves() == 0 {
            let n = root[0].n_leaves() as usize;
            let is_there = n == 0 || is_listed(&root[0], 0);
            let free = BTreeSet::from_iter(&self.free);
            return n <= 1
                && is_there
                && (n_listed, self.leaves.n) == (n, n)
                && free.len() == self.free.len()
                && free
                    .iter()
                    .all(|id| (1..self.nodes.len()).contains(&(**id as usize)));
        }
        let mut n_found = 0;
        let mut reached = vec![false; self.nodes.len()];
        reached[0] = true;
        let mut open = vec![0usize];
        while let Some(at) = open.pop() {
            for (side, child) in self.nodes[at].iter().enumerate() {
                if child.n_leaves() == 1 {
                    if !is_listed(child, at << 1 | side) {
                        return false;
                    }
                    n_found = usize::saturating_add(n_found, 1);
                    continue;
                }
                let below = child.below as usize;
                let Some(node) = self.nodes.get(below) else {
                    return false;
                };
                let [left, right] = [node[0].n_leaves(), node[1].n_leaves()];
                let is_new = !std::mem::replace(&mut reached[below], true);
                let hangs = self.parents.get(below) == Some(&(at << 1 | side));
                let counts =
                    left > 0 && right > 0 && left.checked_add(right) == Some(child.n_leaves());
                if !(is_new && hangs && counts) {
                    return false;
                }
                open.push(below);
            }
        }
        // Whoever is marked here is free twice, or in use.
        let mut is_free = |id: &u32| {
            let found = reached.get_mut(*id as usize);
            found.is_some_and(|it| !std::mem::replace(it, true))
        };
        (n_listed, self.leaves.n) == (n_found, n_found) && self.free.iter().all(&mut is_free)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An engine with some boxes in it.
    fn boxes(n: usize) -> PhysicsWorld {
        let mut engine = PhysicsWorld::new();
        for idx in 0..n {
            let place = Vector::new(3.0 * idx as f32, 0.0, 0.0);
            engine.insert(
                RigidBodyBuilder::dynamic().translation(place),
                ColliderBuilder::cuboid(1.0, 1.0, 1.0),
            );
        }
        engine.step();
        engine
    }

    #[test]
    fn trees_of_every_size_are_read_as_the_engine_keeps_them() {
        for n in [0, 1, 2, 3, 40] {
            let engine = boxes(n);
            let tree = Tree::of(&engine.broad_phase).expect("its layout is known");
            let leaves: u32 = tree
                .nodes
                .first()
                .map_or(0, |root| root.iter().map(Child::n_leaves).sum());
            assert_eq!(leaves as usize, n);
            assert_eq!(check(&engine, |_| None), Ok(()), "{n}");
        }
    }

    #[test]
    fn a_tree_with_a_circle_is_refused() {
        let mut tree = Tree::of(&boxes(40).broad_phase).expect("its layout is known");
        assert!(tree.is_sound());
        let inner = tree.nodes[0].iter_mut().find(|side| side.n_leaves() > 1);
        inner.expect("one side of forty leaves is a node").below = 0;
        assert!(!tree.is_sound());
    }

    #[test]
    fn leaves_that_the_list_does_not_know_and_free_nodes_in_use_are_refused() {
        let tree = || {
            let mut engine = boxes(40);
            let first = engine.bodies.iter().next().expect("forty bodies").0;
            engine.remove_body(first);
            engine.step();
            Tree::of(&engine.broad_phase).expect("its layout is known")
        };
        assert!(tree().is_sound());
        let spoil: [fn(&mut Tree); 5] = [
            |tree| tree.leaves.by_number[7] = None,
            |tree| tree.leaves.by_number.swap(7, 8),
            |tree| tree.leaves.by_number.truncate(20),
            |tree| tree.leaves.n += 1,
            |tree| tree.free.push(0),
        ];
        for (n, spoil) in spoil.iter().enumerate() {
            let mut tree = tree();
            spoil(&mut tree);
            assert!(!tree.is_sound(), "{n}");
        }
    }

    #[test]
    fn shapes_that_no_actor_has_are_refused() {
        let mut engine = boxes(2);
        engine.insert(
            RigidBodyBuilder::dynamic(),
            ColliderBuilder::capsule_z(1.0, 1.0),
        );
        assert_eq!(check(&engine, |_| None), Err(WrongEngine::Shape));
    }
}
