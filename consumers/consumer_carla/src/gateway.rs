//! The calls: which method does what. Each arm is one line; the work is in the modules beside this one.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::commander::Commander;
use crate::fields::Fields;
use crate::list;
use crate::msgpack::Value;
use crate::rpc::Request;
use crate::session::Settings;
use crate::stream::{self, WORLD_STREAM};
use crate::world::World;

/// The version this gateway speaks; clients compare it with theirs.
pub const CARLA_VERSION: &str = "0.9.16";

/// What a call gives back.
#[derive(Clone, Debug, PartialEq)]
pub enum Answer {
    /// A value in a response record.
    Value(Value),
    /// Success without a value.
    Void,
    /// A value without a record round it.
    Bare(Value),
}

/// Why a call failed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Failure {
    /// A sentence for the script.
    Refused(String),
    /// There is no such method.
    Unknown(String),
}

impl From<String> for Failure {
    fn from(error: String) -> Self {
        Failure::Refused(error)
    }
}

/// Result of a call.
pub type Outcome = Result<Answer, Failure>;

/// Methods whose answer has no value, among those whose answer the client reads.
const VOID: &[&str] = &[
    "load_new_episode",
    "copy_opendrive_to_file",
    "load_map_layer",
    "unload_map_layer",
    "apply_color_texture_to_objects",
    "apply_float_color_texture_to_objects",
    "set_actor_simulate_physics",
    "set_actor_collisions",
    "reset_all_traffic_lights",
    "set_ignored_vehicles",
    "enable_gbuffers",
];

/// Methods of the client that this gateway knows and cannot serve.
const NOT_THERE: &[&str] = &[
    "copy_opendrive_to_file",
    "load_map_layer",
    "unload_map_layer",
    "request_file",
    "get_navigation_mesh",
    "get_names_of_all_objects",
    "get_all_level_BBs",
    "get_environment_objects",
    "enable_environment_objects",
    "set_annotations_traverse_translucency",
    "apply_color_texture_to_objects",
    "apply_float_color_texture_to_objects",
    "project_point",
    "cast_ray",
    "get_imui_gravity",
    "set_imui_gravity",
    "update_lights_state",
    "update_day_night_cycle",
    "set_actor_target_angular_velocity",
    "enable_actor_constant_velocity",
    "disable_actor_constant_velocity",
    "add_actor_impulse",
    "add_actor_impulse_at_location",
    "add_actor_force",
    "add_actor_force_at_location",
    "add_actor_angular_impulse",
    "add_actor_torque",
    "get_actor_component_world_transform",
    "get_actor_component_relative_transform",
    "get_actor_bone_world_transforms",
    "get_actor_bone_relative_transforms",
    "get_actor_socket_world_transforms",
    "get_actor_socket_relative_transforms",
    "get_actor_component_names",
    "get_actor_bone_names",
    "get_actor_socket_names",
    "set_actor_collisions",
    "set_actor_dead",
    "set_actor_enable_gravity",
    "apply_ackermann_control_to_vehicle",
    "get_ackermann_controller_settings",
    "apply_ackermann_controller_settings",
    "get_physics_control",
    "apply_physics_control",
    "get_telemetry_data",
    "show_vehicle_debug_telemetry",
    "open_vehicle_door",
    "close_vehicle_door",
    "set_wheel_steer_direction",
    "get_wheel_steer_angle",
    "set_wheel_pitch_angle",
    "get_wheel_pitch_angle",
    "get_vehicle_bone_world_transforms",
    "enable_carsim",
    "use_carsim_road",
    "enable_chrono_physics",
    "restore_physx_physics",
    "apply_control_to_walker",
    "get_bones_transform",
    "set_bones_transform",
    "blend_pose",
    "get_pose_from_animation",
    "set_traffic_light_green_time",
    "set_traffic_light_yellow_time",
    "set_traffic_light_red_time",
    "reset_traffic_light_group",
    "get_light_boxes",
    "enable_sensor_for_ros",
    "disable_sensor_for_ros",
    "is_sensor_enabled_for_ros",
    "send",
    "set_ignored_vehicles",
    "enable_gbuffers",
    "are_gbuffers_enabled",
    "get_gbuffer_token",
    "start_recorder",
    "stop_recorder",
    "show_recorder_file_info",
    "show_recorder_collisions",
    "show_recorder_actors_blocked",
    "replay_file",
    "stop_replayer",
    "set_replayer_time_factor",
    "set_replayer_ignore_hero",
    "set_replayer_ignore_spectator",
    "draw_debug_shape",
    "clear_debug_shape",
    "clear_debug_string",
];

/// Methods that do something, for tests that call them all.
pub const METHODS: &[&str] = &[
    "version",
    "get_available_maps",
    "get_episode_info",
    "get_sensor_token",
    "get_episode_settings",
    "set_episode_settings",
    "tick_cue",
    "load_new_episode",
    "get_map_info",
    "get_map_data",
    "get_required_files",
    "query_lights_state",
    "get_actor_definitions",
    "get_weather_parameters",
    "set_weather_parameters",
    "get_spectator",
    "get_actors_by_id",
    "spawn_actor",
    "spawn_actor_with_parent",
    "destroy_actor",
    "set_actor_location",
    "set_actor_transform",
    "set_actor_target_velocity",
    "get_actor_bounding_box",
    "set_actor_simulate_physics",
    "set_actor_autopilot",
    "apply_control_to_vehicle",
    "get_vehicle_light_state",
    "set_vehicle_light_state",
    "get_vehicle_light_states",
    "set_traffic_light_state",
    "freeze_traffic_light",
    "freeze_all_traffic_lights",
    "reset_all_traffic_lights",
    "get_group_traffic_lights",
    "apply_batch",
    "is_traffic_manager_running",
    "get_traffic_manager_running",
    "add_traffic_manager_running",
    "destroy_traffic_manager",
];

/// Whether the method's answer has no value.
pub fn is_void(method: &str) -> bool {
    VOID.contains(&method)
}

/// A Traffic Manager that a client runs.
#[derive(Clone, Debug)]
struct TrafficManager {
    host: String,
    connection: u64,
}

/// Everything that calls need.
#[derive(Debug)]
pub struct Gateway {
    pub(crate) world: Arc<World>,
    pub(crate) commander: Commander,
    pub(crate) settings: Mutex<Settings>,
    /// Scattering, Mie and Rayleigh scale, dust: weather that the simulator does not have.
    pub(crate) weather_extras: Mutex<[f32; 4]>,
    stream_port: u16,
    traffic_managers: Mutex<BTreeMap<u16, TrafficManager>>,
    said: Mutex<BTreeSet<String>>,
}

pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Gateway {
    /// A gateway that tells clients to fetch streams at `stream_port`.
    pub fn new(world: Arc<World>, commander: Commander, stream_port: u16) -> Gateway {
        Gateway {
            world,
            commander,
            settings: Mutex::default(),
            weather_extras: Mutex::new([1.0, 0.03, 0.0331, 0.0]),
            stream_port,
            traffic_managers: Mutex::default(),
            said: Mutex::default(),
        }
    }

    /// Forgets what a connection registered: a Traffic Manager whose process has ended would make later clients wait for it.
    pub fn closed(&self, connection: u64) {
        lock(&self.traffic_managers).retain(|_, manager| manager.connection != connection);
    }

    /// Says once per run that a call is accepted and does nothing.
    pub(crate) fn no_effect(&self, what: &str) {
        if lock(&self.said).insert(what.to_owned()) {
            tracing::warn!("{what} is accepted and has no effect; see docs/carla-compatibility.md");
        }
    }

    /// Runs one call.
    ///
    /// # Errors
    /// [`Failure`].
    pub fn call(&self, connection: u64, request: &Request) -> Outcome {
        let mut args = Fields::new("the arguments", &request.args);
        let method = request.method.as_str();
        let outcome = match self.session_call(method, &mut args) {
            Some(outcome) => outcome,
            None => match self.actor_call(method, &mut args) {
                Some(outcome) => outcome,
                None => self.other_call(connection, method, &mut args, request.args.len()),
            },
        };
        outcome.map_err(|failure| match failure {
            Failure::Refused(error) => Failure::Refused(format!("{method}: {error}")),
            unknown => unknown,
        })
    }

    fn other_call(&self, connection: u64, method: &str, args: &mut Fields<'_>, n_args: usize) -> Outcome {
        match method {
            "apply_batch" => self.apply_batch(args),
            "is_traffic_manager_running" => {
                let port = args.uint(u16::MAX.into())? as u16;
                Ok(Answer::Value(lock(&self.traffic_managers).contains_key(&port).into()))
            }
            "get_traffic_manager_running" => {
                let port = args.uint(u16::MAX.into())? as u16;
                let found = lock(&self.traffic_managers).get(&port).map(|manager| list![manager.host.as_str(), port]);
                Ok(Answer::Value(found.unwrap_or_else(|| list!["", 0u16])))
            }
            "add_traffic_manager_running" => self.add_traffic_manager(connection, args),
            "destroy_traffic_manager" => {
                let port = args.uint(u16::MAX.into())? as u16;
                Ok(Answer::Value(lock(&self.traffic_managers).remove(&port).is_some().into()))
            }
            _ if NOT_THERE.contains(&method) => {
                Err(Failure::Refused("gantry-carla cannot do this; docs/carla-compatibility.md lists what works".to_owned()))
            }
            _ => Err(Failure::Unknown(format!("rpclib: server could not find function '{method}' with argument count {}.", n_args + 1))),
        }
    }

    fn add_traffic_manager(&self, connection: u64, args: &mut Fields<'_>) -> Outcome {
        let mut pair = args.fields("a Traffic Manager's place")?;
        let (host, port) = (pair.text()?.to_owned(), pair.uint(u16::MAX.into())? as u16);
        let mut managers = lock(&self.traffic_managers);
        if managers.contains_key(&port) {
            return Ok(Answer::Value(false.into()));
        }
        tracing::info!(host, port, "a client runs a Traffic Manager");
        managers.insert(port, TrafficManager { host, connection });
        Ok(Answer::Value(true.into()))
    }

    /// Where a stream is.
    pub(crate) fn token(&self, stream: u32) -> Value {
        list![Value::Bin(stream::token(stream, self.stream_port))]
    }

    /// Where the world stream is.
    pub(crate) fn world_token(&self) -> Value {
        self.token(WORLD_STREAM)
    }
}
