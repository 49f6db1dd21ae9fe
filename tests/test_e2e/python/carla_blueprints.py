"""The stock `carla` 0.9.16 wheel: the blueprint library against CARLA's own.

    carla_blueprints.py PORT COMPATIBILITY_PAGE

Ids, attributes, types, defaults and recommended values are typed in here from CARLA's published reference. Ids may be missing only if the
compatibility page names them. Prints "NAME passed" per theme.
"""

import re
import sys

import carla
from carla_kit import connect, run, run_checks

PORT, PAGE = int(sys.argv[1]), sys.argv[2]
BOOL, INT, FLOAT, TEXT, COLOR = (
    carla.ActorAttributeType.Bool,
    carla.ActorAttributeType.Int,
    carla.ActorAttributeType.Float,
    carla.ActorAttributeType.String,
    carla.ActorAttributeType.RGBColor,
)

VEHICLES = """
audi.a2 car 1 4|audi.etron car 1 4|audi.tt car 1 4|bmw.grandtourer car 1 4|chevrolet.impala car 1 4|citroen.c3 car 1 4|dodge.charger_2020 car 2 4
dodge.charger_police car 1 4|dodge.charger_police_2020 car 2 4|ford.crown car 2 4|ford.mustang car 1 4|jeep.wrangler_rubicon car 1 4
lincoln.mkz_2017 car 1 4|lincoln.mkz_2020 car 2 4|mercedes.coupe car 1 4|mercedes.coupe_2020 car 2 4|micro.microlino car 1 4|mini.cooper_s car 1 4
mini.cooper_s_2021 car 2 4|nissan.micra car 1 4|nissan.patrol car 1 4|nissan.patrol_2021 car 2 4|seat.leon car 1 4|tesla.model3 car 1 4
toyota.prius car 1 4|tesla.cybertruck truck 2 4|carlamotors.carlacola truck 1 4|carlamotors.european_hgv truck 2 6|carlamotors.firetruck truck 2 4
mitsubishi.fusorosa bus 2 4|ford.ambulance van 2 4|mercedes.sprinter van 2 4|volkswagen.t2 van 1 4|volkswagen.t2_2021 van 2 4
harley-davidson.low_rider motorcycle 1 2|kawasaki.ninja motorcycle 1 2|vespa.zx125 motorcycle 1 2|yamaha.yzf motorcycle 1 2
bh.crossbike bicycle 1 2|diamondback.century bicycle 1 2|gazelle.omafiets bicycle 1 2
"""
SPECIAL = {
    "dodge.charger_police": "emergency",
    "dodge.charger_police_2020": "emergency",
    "ford.crown": "taxi",
    "carlamotors.firetruck": "emergency",
    "ford.ambulance": "emergency",
}
PROPS = """
advertisement atm barbeque barrel bench01 bench02 bench03 bin box01 box02 box03 briefcase brokentile01 brokentile02 brokentile03 brokentile04 busstop
busstoplb calibrator chainbarrier chainbarrierend clothcontainer clothesline colacan constructioncone container creasedbox01 creasedbox02
creasedbox03 dirtdebris01 dirtdebris02 dirtdebris03 doghouse fountain foodcart garbage01 garbage02 garbage03 garbage04 garbage05 garbage06 gardenlamp
glasscontainer gnome guitarcase haybale haybalelb ironplank kiosk_01 mailbox maptable mesh mobile motorhelmet pergola plantpot01 plantpot02 plantpot03
plantpot04 plantpot05 plantpot06 plantpot07 plantpot08 plasticbag plasticchair plastictable platformgarbage01 purse shoppingbag shoppingcart
shoppingtrolley slide streetbarrier streetfountain streetsign streetsign01 streetsign04 swing swingcouch table trafficcone01 trafficcone02
trafficwarning trampoline trashbag trashcan01 trashcan02 trashcan03 trashcan04 trashcan05 travelcase vendingmachine warningaccident
warningconstruction wateringcan
"""

TICK = {"sensor_tick": (FLOAT, 0.0)}
CAMERA = {
    "image_size_x": (INT, 800), "image_size_y": (INT, 600), "fov": (FLOAT, 90.0), "lens_circle_falloff": (FLOAT, 5.0),
    "lens_circle_multiplier": (FLOAT, 0.0), "lens_k": (FLOAT, -1.0), "lens_kcube": (FLOAT, 0.0), "lens_x_size": (FLOAT, 0.08),
    "lens_y_size": (FLOAT, 0.08),
}
COLOUR = {
    "enable_postprocess_effects": (BOOL, True), "gamma": (FLOAT, 2.2), "exposure_mode": (TEXT, "histogram"), "exposure_compensation": (FLOAT, 0.0),
    "shutter_speed": (FLOAT, 200.0), "iso": (FLOAT, 100.0), "fstop": (FLOAT, 1.4), "exposure_min_bright": (FLOAT, 10.0),
    "exposure_max_bright": (FLOAT, 12.0), "exposure_speed_up": (FLOAT, 3.0), "exposure_speed_down": (FLOAT, 1.0), "calibration_constant": (FLOAT, 16.0),
    "motion_blur_intensity": (FLOAT, 0.45), "motion_blur_max_distortion": (FLOAT, 0.35), "motion_blur_min_object_screen_size": (FLOAT, 0.1),
    "bloom_intensity": (FLOAT, 0.675), "lens_flare_intensity": (FLOAT, 0.1), "focal_distance": (FLOAT, 1000.0), "blur_amount": (FLOAT, 1.0),
    "blur_radius": (FLOAT, 0.0), "min_fstop": (FLOAT, 1.2), "blade_count": (INT, 5), "slope": (FLOAT, 0.88), "toe": (FLOAT, 0.55),
    "shoulder": (FLOAT, 0.26), "black_clip": (FLOAT, 0.0), "white_clip": (FLOAT, 0.04), "temp": (FLOAT, 6500.0), "tint": (FLOAT, 0.0),
    "chromatic_aberration_intensity": (FLOAT, 0.0), "chromatic_aberration_offset": (FLOAT, 0.0),
}
DVS = {
    "positive_threshold": (FLOAT, 0.3), "negative_threshold": (FLOAT, 0.3), "sigma_positive_threshold": (FLOAT, 0.0),
    "sigma_negative_threshold": (FLOAT, 0.0), "refractory_period_ns": (INT, 0), "use_log": (BOOL, True), "log_eps": (FLOAT, 0.001),
    # Gantry's own.
    "gantry_mode": (TEXT, "motion"),
}
LIDAR = {
    "channels": (INT, 32), "range": (FLOAT, 10.0), "points_per_second": (INT, 56000), "rotation_frequency": (FLOAT, 10.0),
    "upper_fov": (FLOAT, 10.0), "lower_fov": (FLOAT, -30.0), "horizontal_fov": (FLOAT, 360.0),
}
LIDAR_NOISE = {
    "atmosphere_attenuation_rate": (FLOAT, 0.004), "dropoff_general_rate": (FLOAT, 0.45), "dropoff_intensity_limit": (FLOAT, 0.8),
    "dropoff_zero_intensity": (FLOAT, 0.4), "noise_stddev": (FLOAT, 0.0), "noise_seed": (INT, 0),
}
RADAR = {
    "horizontal_fov": (FLOAT, 30.0), "vertical_fov": (FLOAT, 30.0), "points_per_second": (INT, 1500), "range": (FLOAT, 100.0), "noise_seed": (INT, 0),
}
IMU = {"noise_seed": (INT, 0)} | {
    f"noise_{kind}_{axis}": (FLOAT, 0.0) for kind in ("accel_stddev", "gyro_stddev", "gyro_bias") for axis in "xyz"
}
GNSS = {"noise_seed": (INT, 0)} | {f"noise_{of}_{kind}": (FLOAT, 0.0) for of in ("lat", "lon", "alt") for kind in ("bias", "stddev")}
OBSTACLE = {"distance": (FLOAT, 5.0), "hit_radius": (FLOAT, 0.5), "only_dynamics": (BOOL, False), "debug_linetrace": (BOOL, False)}
RADIO = {
    "noise_seed": (INT, 0), "transmit_power": (FLOAT, 21.5), "receiver_sensitivity": (FLOAT, -99.0), "frequency_ghz": (FLOAT, 5.9),
    "combined_antenna_gain": (FLOAT, 10.0), "scenario": (TEXT, "highway"), "path_loss_model": (TEXT, "geometric"),
    "path_loss_exponent": (FLOAT, 2.7), "d_ref": (FLOAT, 1.0), "filter_distance": (FLOAT, 500.0), "use_etsi_fading": (BOOL, True),
    "custom_fading_stddev": (FLOAT, 0.0),
}
AWARENESS = {
    "gen_cam_min": (FLOAT, 0.1), "gen_cam_max": (FLOAT, 1.0), "fixed_rate": (BOOL, False), "noise_vel_stddev_x": (FLOAT, 0.0),
    "noise_yawrate_stddev": (FLOAT, 0.0), "noise_yawrate_bias": (FLOAT, 0.0),
} | {f"noise_accel_stddev_{axis}": (FLOAT, 0.0) for axis in "xyz"} | {
    f"noise_{of}_{kind}": (FLOAT, 0.0) for of in ("lat", "lon", "alt", "head") for kind in ("bias", "stddev")
}
SENSORS = {
    "camera.rgb": TICK | CAMERA | COLOUR,
    "camera.depth": TICK | CAMERA,
    "camera.semantic_segmentation": TICK | CAMERA,
    "camera.instance_segmentation": TICK | CAMERA,
    "camera.normals": TICK | CAMERA,
    "camera.optical_flow": TICK | CAMERA,
    "camera.cosmos_visualization": TICK | CAMERA,
    "camera.dvs": TICK | CAMERA | COLOUR | DVS,
    "lidar.ray_cast": TICK | LIDAR | LIDAR_NOISE,
    "lidar.ray_cast_semantic": TICK | LIDAR,
    "other.radar": TICK | RADAR,
    "other.imu": TICK | IMU,
    "other.gnss": TICK | GNSS,
    "other.collision": {},
    "other.lane_invasion": {},
    "other.obstacle": TICK | OBSTACLE,
    "other.v2x": TICK | RADIO | AWARENESS,
    "other.v2x_custom": TICK | RADIO,
}


def value_of(attribute):
    """The default as the wheel converts it."""
    if attribute.type == BOOL:
        return attribute.as_bool()
    if attribute.type == INT:
        return attribute.as_int()
    if attribute.type == FLOAT:
        return attribute.as_float()
    return attribute.as_str()


def missing(library, page, wanted):
    """Ids that are not there; each must be named by the page."""
    there = {blueprint.id for blueprint in library}
    absent = sorted(set(wanted) - there)
    unsaid = [type_id for type_id in absent if f"`{type_id}`" not in page]
    assert not unsaid, f"missing, and the page does not say so: {unsaid}"
    return absent


def check_sensors(library, page):
    listed = {blueprint.id for blueprint in library.filter("sensor.*")}
    assert listed == {"sensor." + name for name in SENSORS}, listed.symmetric_difference("sensor." + name for name in SENSORS)
    for name, attributes in SENSORS.items():
        blueprint = library.find("sensor." + name)
        wanted = attributes | {"role_name": (TEXT, "default"), "ros_name": (TEXT, name.rsplit(".", maxsplit=1)[-1])}
        found = {attribute.id: attribute for attribute in blueprint}
        assert set(found) == set(wanted), (name, set(found).symmetric_difference(wanted))
        for attribute, (kind, default) in wanted.items():
            assert found[attribute].type == kind and found[attribute].is_modifiable, (name, attribute, found[attribute].type)
            value = value_of(found[attribute])
            assert value == default or isinstance(default, float) and abs(value - default) < 1e-6, (name, attribute, value, default)
        roles = ["front", "back", "left", "right", "front_left", "front_right", "back_left", "back_right"]
        assert list(found["role_name"].recommended_values) == roles, list(found["role_name"].recommended_values)
        assert blueprint.has_tag("sensor") and blueprint.has_tag(name.split(".", maxsplit=1)[0])
    rgb = library.find("sensor.camera.rgb")
    assert sorted(rgb.get_attribute("exposure_mode").recommended_values) == ["histogram", "manual"]
    radio = library.find("sensor.other.v2x")
    assert sorted(radio.get_attribute("scenario").recommended_values) == ["highway", "rural", "urban"]
    assert sorted(radio.get_attribute("path_loss_model").recommended_values) == ["geometric", "winner"]


def check_recommended(library, _):
    """CARLA's defaults are the first of the recommended values; scripts take that one."""
    for blueprint in library:
        for attribute in blueprint:
            values = list(attribute.recommended_values)
            assert values or attribute.type == TEXT and attribute.as_str() == "", (blueprint.id, attribute.id)


def check_vehicles(library, page):
    rows = [row.split() for row in VEHICLES.replace("\n", "|").split("|") if row.strip()]
    assert len(rows) == 41
    absent = missing(library, page, ["vehicle." + row[0] for row in rows])
    print("vehicles that are not there:", absent)
    assert len(absent) <= 5
    others = {blueprint.id for blueprint in library.filter("vehicle.*")} - {"vehicle." + row[0] for row in rows}
    assert not others, others
    for name, base, generation, wheels in rows:
        if "vehicle." + name in absent:
            continue
        blueprint = library.find("vehicle." + name)
        found = {attribute.id: attribute for attribute in blueprint}
        fixed = {
            "base_type": (TEXT, base), "special_type": (TEXT, None), "generation": (INT, int(generation)), "number_of_wheels": (INT, int(wheels)),
            "has_lights": (BOOL, None), "has_dynamic_doors": (BOOL, None), "object_type": (TEXT, None),
        }
        free = {"role_name": (TEXT, "autopilot"), "color": (COLOR, None), "sticky_control": (BOOL, True), "terramechanics": (BOOL, False)}
        if int(wheels) == 2:
            free["driver_id"] = (INT, None)
        assert set(found) == set(fixed) | set(free), (name, set(found).symmetric_difference(set(fixed) | set(free)))
        for attribute, (kind, value) in (fixed | free).items():
            assert found[attribute].type == kind and found[attribute].is_modifiable == (attribute in free), (name, attribute)
            if value is not None and name != "carlamotors.firetruck":
                assert value_of(found[attribute]) == value, (name, attribute, value_of(found[attribute]))
        if name in SPECIAL:
            assert found["special_type"].as_str() == SPECIAL[name], (name, found["special_type"].as_str())
        # Scripts choose one of them for every bicycle and motorcycle.
        assert int(wheels) != 2 or list(found["driver_id"].recommended_values), name
        assert list(found["role_name"].recommended_values) == ["autopilot", "scenario", "ego_vehicle"], name
        colors = list(found["color"].recommended_values)
        assert colors and all(re.fullmatch(r"\d{1,3},\d{1,3},\d{1,3}", color) for color in colors), (name, colors)
        # What a script may not set is refused by the wheel itself.
        try:
            blueprint.set_attribute("number_of_wheels", "3")
        except ValueError:
            pass
        else:
            raise AssertionError(name)
    cars = [one for one in library.filter("vehicle.*") if one.get_attribute("base_type") == "car" and int(one.get_attribute("number_of_wheels")) == 4]
    assert len(cars) >= 20
    second = [one for one in library.filter("vehicle.*") if int(one.get_attribute("generation")) == 2]
    assert len(second) >= 8


def check_walkers(library, page):
    ids = [f"walker.pedestrian.{number:04}" for number in range(1, 53)]
    assert not missing(library, page, ids) and len(library.filter("walker.*")) == 52
    for type_id in ids:
        blueprint = library.find(type_id)
        found = {attribute.id: attribute for attribute in blueprint}
        kinds = {
            "gender": (TEXT, False), "age": (TEXT, False), "generation": (INT, False), "speed": (FLOAT, True), "is_invincible": (BOOL, True),
            "role_name": (TEXT, True),
        }
        # The page says: where they apply.
        if blueprint.has_attribute("can_use_wheelchair"):
            kinds |= {"can_use_wheelchair": (BOOL, False), "use_wheelchair": (BOOL, True)}
        assert set(found) == set(kinds), (type_id, set(found).symmetric_difference(kinds))
        for attribute, (kind, modifiable) in kinds.items():
            assert found[attribute].type == kind and found[attribute].is_modifiable == modifiable, (type_id, attribute)
        assert found["gender"].as_str() in ("female", "male", "other") and found["age"].as_str() in ("child", "teenager", "adult", "elderly")
        assert found["role_name"].as_str() == "pedestrian" and found["is_invincible"].as_bool()
        standing, walk, run = (float(speed) for speed in found["speed"].recommended_values)
        assert standing == 0.0 and 0.5 < walk < 2.5 and walk < run < 6.0, (type_id, standing, walk, run)


def check_props(library, page):
    absent = missing(library, page, ["static.prop." + name for name in PROPS.split()] + ["static.trigger.friction", "util.actor.empty"])
    print("props that are not there:", absent)
    for blueprint in library.filter("static.prop.*"):
        assert blueprint.get_attribute("size").as_str() in ("tiny", "small", "medium", "big", "huge", "unknown"), blueprint.id
        assert blueprint.get_attribute("role_name").as_str() == "prop"
    friction = library.find("static.trigger.friction")
    assert abs(friction.get_attribute("friction").as_float() - 3.5) < 1e-6
    assert all(friction.has_attribute(f"extent_{axis}") for axis in "xyz")
    assert library.find("controller.ai.walker").has_attribute("role_name")
    assert not library.filter("traffic.*") and not library.filter("spectator")


def main():
    client = connect(PORT)
    library = client.get_world().get_blueprint_library()
    with open(PAGE, encoding="utf-8") as file:
        page = file.read()
    checks = {"sensors": check_sensors, "vehicles": check_vehicles, "walkers": check_walkers, "props": check_props, "recommended": check_recommended}
    run_checks(checks, library, page)


run(main)
