//! What the gateway knows and whom it asks: the known world, its actors and blueprints, the
//! commander that talks to the simulator, and what clients have set.

pub mod actors;
pub mod blueprints;
pub mod commander;
pub mod known_world;
pub mod navigation_file;
pub mod served_manager;
pub mod settings;
pub mod traffic_managers;
