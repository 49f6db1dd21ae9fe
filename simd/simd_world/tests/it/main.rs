//! Tests of `simd_world`: one program for all of them, so that it is linked once.

mod actors;
mod catalogue;
mod checkpoint;
mod crowd;
mod crowd_cars;
mod doors;
mod drop;
mod lights;
mod motion;
mod navigation;
mod physics_actions;
mod posted_limits;
mod props;
mod repeat;
mod stability;
mod town;
mod walkers;
