//! What the gateway knows and whom it asks: the world, its actors and blueprints, the way to the
//! simulator, and what clients set.

pub mod actors;
pub mod blueprints;
pub mod commander;
pub mod known_world;
pub mod navigation_file;
pub mod settings;
pub mod traffic_managers;
