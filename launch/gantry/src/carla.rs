//! What users of CARLA bring along: their maps (`gantry` [`map`]), and scripts that start a server in
//! the folder `CARLA_ROOT` (`gantry carla-root`, [`carla_root`]).

pub mod carla_root;
pub mod map;
