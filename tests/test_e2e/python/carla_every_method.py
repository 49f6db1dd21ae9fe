"""The stock `carla` 0.9.16 wheel: every method and property of its main classes, found by introspection, called once with sensible arguments.

    carla_every_method.py PORT

None may hang, none may fail with anything but the sentences listed here, and none that the wheel has may be left out. Prints "NAME passed" per class.
"""

import os
import sys
import time

import carla
from carla_kit import connect, passed, run, step_by_hand

PORT = int(sys.argv[1])
LONGEST_SECS = 30.0

HERE = carla.Location(1.0, 2.0, 3.0)
UP = carla.Vector3D(0.0, 0.0, 1.0)
# Failures that are right, with words of the sentence.
RIGHT = {
    "get_ignored_vehicles": "No to_python (by-value) converter",  # A defect of the wheel, without a call.
    "set_ignored_vehicles": "only cameras leave actors out",
    "request_file": "there is no file \"nothing\"",
}
# What is left to other tests, with the reason.
ELSEWHERE = {
    ("Client", "generate_opendrive_world"): "carla_maps.py; it loads a map",
    ("Client", "load_world"): "carla_client.py; it loads a map",
    ("Client", "load_world_if_different"): "as load_world",
    ("Client", "reload_world"): "carla_client.py; it ends the episode",
    ("Client", "replay_file"): "carla_replay.py",
    ("World", "wait_for_tick"): "waits for others in synchronous mode",
    ("World", "apply_color_texture_to_object"): "needs a texture object",
    ("World", "apply_color_texture_to_objects"): "needs a texture object",
    ("World", "apply_float_color_texture_to_object"): "needs a texture object",
    ("World", "apply_float_color_texture_to_objects"): "needs a texture object",
    ("World", "apply_textures_to_object"): "needs texture objects",
    ("World", "apply_textures_to_objects"): "needs texture objects",
    ("Actor", "destroy"): "last, by itself",
}


def arguments(world, actor):
    """Positional arguments by method; methods that are not here are called without."""
    def ignore(*_):
        return None

    library = world.get_blueprint_library()
    settings = world.get_settings()
    car = library.find("vehicle.audi.a2")
    # Of a junction that does not exist the wheel reads freed memory.
    junction = next(point.junction_id for point in world.get_map().generate_waypoints(5.0) if point.is_junction)
    far = carla.Transform(carla.Location(0.0, 0.0, 500.0))
    return {
        "Client": {
            "set_timeout": (30.0,), "start_recorder": ("every",), "show_recorder_file_info": ("every", True), "show_recorder_collisions": ("every", "a", "a"),
            "show_recorder_actors_blocked": ("every", 1.0, 1.0), "set_replayer_time_factor": (1.0,), "set_replayer_ignore_hero": (False,),
            "set_replayer_ignore_spectator": (True,), "stop_replayer": (True,), "apply_batch": ([],), "apply_batch_sync": ([], False),
            "get_trafficmanager": (0,), "set_files_base_folder": (os.getcwd(),), "get_required_files": ("", False), "request_file": ("nothing",),
        },
        "World": {
            "apply_settings": (settings,), "cast_ray": (carla.Location(0.0, 0.0, 50.0), carla.Location(0.0, 0.0, -50.0)),
            "enable_environment_objects": ([], True), "freeze_all_traffic_lights": (False,), "get_actor": (actor.id,), "get_actors": (),
            "get_environment_objects": (carla.CityObjectLabel.Buildings,), "get_level_bbs": (carla.CityObjectLabel.Buildings,),
            "get_traffic_light": (world.get_map().get_all_landmarks_of_type("1000001")[0],), "get_traffic_light_from_opendrive_id": ("nothing",), "get_traffic_sign": (world.get_map().get_all_landmarks()[0],),
            "get_traffic_lights_from_waypoint": (world.get_map().get_waypoint(HERE), 50.0), "get_traffic_lights_in_junction": (junction,),
            "ground_projection": (carla.Location(0.0, 0.0, 50.0), 100.0), "load_map_layer": (carla.MapLayer.Props,), "on_tick": (ignore,),
            "project_point": (carla.Location(0.0, 0.0, 50.0), carla.Vector3D(0.0, 0.0, -1.0), 100.0), "remove_on_tick": (0,),
            "set_pedestrians_cross_factor": (0.5,), "set_pedestrians_seed": (1,), "set_weather": (carla.WeatherParameters.ClearNoon,),
            "spawn_actor": (car, far), "try_spawn_actor": (car, carla.Transform(carla.Location(0.0, 0.0, 600.0))), "unload_map_layer": (carla.MapLayer.Props,),
            "set_annotations_traverse_translucency": (True,), "set_imui_sensor_gravity": (9.81,), "tick": (30.0,),
        },
        "Actor": {
            "add_angular_impulse": (UP,), "add_force": (UP,), "add_impulse": (UP,), "add_torque": (UP,), "enable_constant_velocity": (carla.Vector3D(),),
            "set_collisions": (True,), "set_enable_gravity": (True,), "set_location": (actor.get_location(),), "set_simulate_physics": (True,),
            "set_target_angular_velocity": (carla.Vector3D(),), "set_target_velocity": (carla.Vector3D(),), "set_transform": (actor.get_transform(),),
            "get_component_relative_transform": ("body",), "get_component_world_transform": ("body",),
            # Vehicles.
            "apply_ackermann_control": (carla.VehicleAckermannControl(),), "apply_ackermann_controller_settings": (carla.AckermannControllerSettings(),),
            "apply_control": (carla.VehicleControl(),), "enable_carsim": ("",), "use_carsim_road": (False,), "enable_chrono_physics": (10, 0.01, "", "", "", ""),
            "open_door": (carla.VehicleDoor.FL,), "close_door": (carla.VehicleDoor.FL,), "set_light_state": (carla.VehicleLightState.NONE,),
            "set_wheel_steer_direction": (carla.VehicleWheelLocation.FL_Wheel, 10.0), "get_wheel_steer_angle": (carla.VehicleWheelLocation.FL_Wheel,),
            "set_wheel_pitch_angle": (carla.VehicleWheelLocation.FL_Wheel, 10.0), "get_wheel_pitch_angle": (carla.VehicleWheelLocation.FL_Wheel,),
            "set_autopilot": (False,), "show_debug_telemetry": (False,),
            # Walkers and who leads them.
            "go_to_location": (HERE,), "set_max_speed": (1.4,),
            "blend_pose": (0.0,), "set_bones": (carla.WalkerBoneControlIn(),),
            # Lights.
            "set_state": (carla.TrafficLightState.Red,), "set_green_time": (10.0,), "set_yellow_time": (3.0,), "set_red_time": (2.0,), "freeze": (False,),
            "get_affected_lane_waypoints": (),
            # Sensors.
            "listen": (ignore,), "listen_to_gbuffer": (carla.GBufferTextureID.SceneColor, ignore), "stop_gbuffer": (carla.GBufferTextureID.SceneColor,),
            "is_listening_gbuffer": (carla.GBufferTextureID.SceneColor,), "enable_gbuffers": (False,), "set_ignored_vehicles": ([],), "send": ("text",),
        },
    }


def call(owner, name, given):
    """Calls or reads it; how long that took and what went wrong."""
    began = time.monotonic()
    error = None
    try:
        found = getattr(owner, name)
        if callable(found):
            found(*given)
    except Exception as problem:  # Whatever the wheel makes of an answer.
        error = f"{type(problem).__name__}: {problem}".splitlines()[0]
    return time.monotonic() - began, error


def check(title, owner, family, given):
    """Every public name."""
    failures, n = [], 0
    for name in sorted(name for name in dir(owner) if not name.startswith("_")):
        if (family, name) in ELSEWHERE or (title, name) in ELSEWHERE:
            continue
        own = given.get(name, ())
        if title == "Walker" and name == "apply_control":
            own = (carla.WalkerControl(),)
        if title == "Vehicle" and name == "apply_physics_control":
            own = (owner.get_physics_control(),)
        secs, error = call(owner, name, own)
        n += 1
        if secs > LONGEST_SECS:
            failures.append(f"{name} took {secs:.1f} s")
        if error is not None and RIGHT.get(name, "\0") not in error:
            failures.append(f"{name}: {error}")
    assert not failures, f"{title}:\n" + "\n".join(failures)
    print(f"{title}: {n} names called")


def main():
    client = connect(PORT)
    world = client.get_world()
    step_by_hand(world)
    library = world.get_blueprint_library()
    places = world.get_map().get_spawn_points()
    car = next(filter(None, (world.try_spawn_actor(library.find("vehicle.tesla.model3"), place) for place in places)))
    beside = carla.Transform(places[-1].location + carla.Location(z=1.0))
    walker = world.spawn_actor(library.find("walker.pedestrian.0007"), beside)
    camera = world.spawn_actor(library.find("sensor.camera.rgb"), carla.Transform(), attach_to=car)
    radio = world.spawn_actor(library.find("sensor.other.v2x_custom"), carla.Transform(), attach_to=car)
    lines = world.spawn_actor(library.find("sensor.other.lane_invasion"), carla.Transform(), attach_to=car)
    control = world.spawn_actor(library.find("controller.ai.walker"), carla.Transform(), attach_to=walker)
    world.tick()
    light = world.get_actors().filter("traffic.traffic_light")[0]
    sign = world.get_actors().filter("traffic.*")[0]
    given = arguments(world, car)
    check("World", world, "World", given["World"])
    passed("World")
    of_actors = given["Actor"]
    for title, actor in (
        ("Vehicle", car), ("Walker", walker), ("TrafficLight", light), ("TrafficSign", sign), ("Camera", camera), ("Radio", radio), ("Lines", lines),
        ("Controller", control), ("Spectator", world.get_spectator()),
    ):
        check(title, actor, "Actor", of_actors)
        print(f"{title} passed")
    world.tick()
    check("Client", client, "Client", given["Client"])
    passed("Client")
    for actor in (camera, radio, lines, control, walker, car):
        assert actor.destroy()
    world.tick()
    secs, error = call(car, "get_physics_control", ())
    assert secs < LONGEST_SECS and "destroyed" in (error or ""), (secs, error)
    passed("gone")


run(main)
