//! Every method that the 0.9.16 client can call, whether this gateway serves it or not.

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

/// All methods, by area as in `docs/reference/carla-compatibility.md`.
pub const BY_AREA: &[(&str, &[&str])] = &[
    (
        "Session, map, scenery",
        &[
            "version",
            "get_available_maps",
            "get_episode_info",
            "get_episode_settings",
            "set_episode_settings",
            "tick_cue",
            "load_new_episode",
            "copy_opendrive_to_file",
            "load_map_layer",
            "unload_map_layer",
            "get_map_info",
            "get_map_data",
            "get_required_files",
            "request_file",
            "get_navigation_mesh",
            "get_actor_definitions",
            "get_names_of_all_objects",
            "get_all_level_BBs",
            "get_environment_objects",
            "enable_environment_objects",
            "set_annotations_traverse_translucency",
            "apply_color_texture_to_objects",
            "apply_float_color_texture_to_objects",
            "project_point",
            "cast_ray",
        ],
    ),
    (
        "Weather and street lights",
        &[
            "get_weather_parameters",
            "set_weather_parameters",
            "get_imui_gravity",
            "set_imui_gravity",
            "query_lights_state",
            "update_lights_state",
            "update_day_night_cycle",
        ],
    ),
    (
        "Actors",
        &[
            "get_spectator",
            "get_actors_by_id",
            "spawn_actor",
            "spawn_actor_with_parent",
            "destroy_actor",
            "set_actor_location",
            "set_actor_transform",
            "set_actor_target_velocity",
            "set_actor_target_angular_velocity",
            "enable_actor_constant_velocity",
            "disable_actor_constant_velocity",
            "add_actor_impulse",
            "add_actor_impulse_at_location",
            "add_actor_force",
            "add_actor_force_at_location",
            "add_actor_angular_impulse",
            "add_actor_torque",
            "get_actor_bounding_box",
            "get_actor_component_world_transform",
            "get_actor_component_relative_transform",
            "get_actor_bone_world_transforms",
            "get_actor_bone_relative_transforms",
            "get_actor_socket_world_transforms",
            "get_actor_socket_relative_transforms",
            "get_actor_component_names",
            "get_actor_bone_names",
            "get_actor_socket_names",
            "set_actor_simulate_physics",
            "set_actor_collisions",
            "set_actor_dead",
            "set_actor_enable_gravity",
            "set_actor_autopilot",
        ],
    ),
    (
        "Vehicles",
        &[
            "apply_control_to_vehicle",
            "apply_ackermann_control_to_vehicle",
            "get_ackermann_controller_settings",
            "apply_ackermann_controller_settings",
            "get_physics_control",
            "apply_physics_control",
            "get_telemetry_data",
            "show_vehicle_debug_telemetry",
            "get_vehicle_light_state",
            "set_vehicle_light_state",
            "get_vehicle_light_states",
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
        ],
    ),
    (
        "Walkers",
        &[
            "apply_control_to_walker",
            "get_bones_transform",
            "set_bones_transform",
            "blend_pose",
            "get_pose_from_animation",
        ],
    ),
    (
        "Traffic lights",
        &[
            "set_traffic_light_state",
            "set_traffic_light_green_time",
            "set_traffic_light_yellow_time",
            "set_traffic_light_red_time",
            "freeze_traffic_light",
            "freeze_all_traffic_lights",
            "reset_traffic_light_group",
            "reset_all_traffic_lights",
            "get_group_traffic_lights",
            "get_light_boxes",
        ],
    ),
    (
        "Streams",
        &[
            "get_sensor_token",
            "enable_sensor_for_ros",
            "disable_sensor_for_ros",
            "is_sensor_enabled_for_ros",
            "send",
            "set_ignored_vehicles",
            "enable_gbuffers",
            "are_gbuffers_enabled",
            "get_gbuffer_token",
        ],
    ),
    (
        "Recorder",
        &[
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
        ],
    ),
    (
        "Drawing and batches",
        &[
            "draw_debug_shape",
            "clear_debug_shape",
            "clear_debug_string",
            "apply_batch",
        ],
    ),
    (
        "Traffic Manager registry",
        &[
            "is_traffic_manager_running",
            "get_traffic_manager_running",
            "add_traffic_manager_running",
            "destroy_traffic_manager",
        ],
    ),
];

/// Whether the method's answer has no value.
pub fn is_void(method: &str) -> bool {
    VOID.contains(&method)
}

/// Whether a client of this version knows the method.
pub fn is_known(method: &str) -> bool {
    BY_AREA.iter().any(|(_, methods)| methods.contains(&method))
}

/// Whether the method's answer depends on the world, and not only on the gateway and its clients.
pub fn is_about_world(method: &str) -> bool {
    let registry = BY_AREA
        .iter()
        .find(|(area, _)| *area == "Traffic Manager registry");
    method != "version" && !registry.is_some_and(|(_, methods)| methods.contains(&method))
}
