//! CARLA 0.9.16 on the wire: values, structures and messages as bytes, in CARLA's axes and units.
//!
//! Nothing here knows the world or a connection's client: bytes in, values out, and back.

pub mod axes;
pub mod description;
pub mod fields;
pub mod geolocation;
pub mod lenient;
pub mod navigation_mesh;
pub mod requests;
pub mod sensor_kinds;
pub mod sensor_message;
pub mod streams;
pub mod structures;
pub mod vehicle_physics;
pub mod weather;
pub mod world_message;

pub use consumer_rpc::msgpack;
