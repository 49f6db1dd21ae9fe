"""The stock client and maps: which there are, loading one of the map folder, building a world from a text. Arguments: port, OpenDRIVE file."""

import sys

import carla
from carla_kit import connect, refused, run, run_checks


def stands(world, what):
    """A car put on every tenth spawn point comes to rest upright on its lane."""
    road_map = world.get_map()
    blueprint = world.get_blueprint_library().find("vehicle.tesla.model3")
    cars = [car for point in road_map.get_spawn_points()[::10][:12] if (car := world.try_spawn_actor(blueprint, point))]
    assert len(cars) >= 3, (what, len(cars))
    for _ in range(40):
        world.wait_for_tick(20.0)
    for car in cars:
        at = car.get_transform()
        waypoint = road_map.get_waypoint(at.location)
        assert abs(at.location.z - waypoint.transform.location.z) < 0.05, (what, at, waypoint.transform)
        assert abs(at.rotation.roll) < 2.0, (what, at.rotation)
    client.apply_batch_sync([carla.command.DestroyActor(car) for car in cars])


client = connect(sys.argv[1])
text = open(sys.argv[2], encoding="utf-8").read()

PARAMETERS = carla.OpendriveGenerationParameters(vertex_distance=2.0, wall_height=1.0, additional_width=0.6, enable_mesh_visibility=True)


def check_listing():
    names = client.get_available_maps()
    assert {"/Game/Carla/Maps/Town01", "/Game/Carla/Maps/Town10HD", "/Game/Carla/Maps/mine"} <= set(names), names


def check_folder():
    for name in ("mine", "/Game/Carla/Maps/mine", "Town01_Opt", "Town01", "/Game/Carla/Maps/Town02_Opt"):
        world = client.load_world(name)
        assert world.get_map().name == "Carla/Maps/" + name.split("/")[-1], world.get_map().name
    assert client.reload_world().get_map().name == "Carla/Maps/Town02_Opt"
    world = client.load_world("mine")
    # The gateway adds blank lines.
    assert world.get_map().to_opendrive().rstrip() == text.rstrip()
    stands(world, "mine")


def check_generating():
    world = client.generate_opendrive_world(text, PARAMETERS)
    assert world.get_map().name == "Carla/Maps/OpenDriveMap", world.get_map().name
    assert "/Game/Carla/Maps/OpenDriveMap" in client.get_available_maps()
    stands(world, "OpenDriveMap")
    # Other parameters are another world under the same name.
    world = client.generate_opendrive_world(text, carla.OpendriveGenerationParameters(wall_height=0.0, enable_mesh_visibility=False))
    stands(world, "OpenDriveMap without walls")


def check_refusals():
    refused(lambda: client.load_world("nowhere"), "not found")
    refused(lambda: client.load_world("../../secret"), "not found")
    refused(lambda: client.generate_opendrive_world("<OpenDRIVE></OpenDRIVE>", PARAMETERS), "no usable road")
    assert client.get_world().get_map().name == "Carla/Maps/OpenDriveMap"


def check_many():
    """The process lives through a day's work: after every load the client takes a new world stream, while its threads still have the old one."""
    for name in ("Town01", "Town02", "Town03", "Town04", "Town05", "Town06", "Town07", "Town10HD"):
        world = client.load_world(name)
        assert world.get_map().name == "Carla/Maps/" + name, world.get_map().name
        assert len(world.get_actors()) > 20 and world.wait_for_tick(20.0).frame > 0


def main():
    run_checks({
        "listing": check_listing,
        "folder": check_folder,
        "generating": check_generating,
        "refusals": check_refusals,
        "many": check_many,
    })


run(main)
