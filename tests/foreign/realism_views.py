"""Draws street views of Gantry for realism.py: colour, and beside it the class of each pixel.

    python tests/foreign/realism_views.py FOLDER [--quality low|high] [--maps Town10HD,Town03,Town02] [--pictures 15]

For each map and each of three conditions (noon, dusk, rain at noon) the ego is driven through a town with 70 vehicles and 140 people, and every four
simulated seconds a picture of 800 x 600 is kept: `MAP_CONDITION_NN.png`, `MAP_CONDITION_NN_s.png` (one byte a pixel, CARLA's classes). Everything
runs in lockstep, so the same build and graphics driver draw the same pictures. `--maps` also takes names of maps that were imported.
Needs the Python package `gantry`.
"""

import argparse
import pathlib
import sys

import numpy as np
from PIL import Image

import gantry
from gantry.testing import Simulator

PROGRAMS = pathlib.Path(__file__).resolve().parents[2] / "target/release"
CONDITIONS = {
    "noon": {"sun_altitude_deg": 65.0, "sun_azimuth_deg": -90.0},
    "dusk": {"sun_altitude_deg": 8.0, "sun_azimuth_deg": 170.0},
    "rain": {
        "sun_altitude_deg": 65.0,
        "sun_azimuth_deg": -90.0,
        "cloudiness": 80.0,
        "precipitation": 55.0,
        "precipitation_deposits": 60.0,
        "wetness": 80.0,
        "fog_density": 5.0,
        "wind_intensity": 40.0,
    },
}
TICK_HZ = 10
SECONDS_APART = 4
WARM_UP_TICKS = 5 * TICK_HZ
LAUNCH = f"""version = 1
[scenario]
seed = 7
tick_hz = {TICK_HZ}
vehicles = 70
walkers = 140
[ego]
type_id = "vehicle.tesla.model3"
[sensor.front]
kind = "camera"
modalities = ["rgb", "semantic"]
rate_hz = {1 / SECONDS_APART}
width_px = 800
height_px = 600
fov_deg = 60
mount.position_m = [0.6, 0.0, 1.6]
"""


def draw(folder, town, condition, options):
    """Keeps the pictures of one map in one condition."""
    settings = {"scenario.map": town, "scenario.weather": CONDITIONS[condition]}
    with Simulator(text=LAUNCH, set=settings, args=["--quality", options.quality], gantry_bin=options.programs) as simulator:
        simulator.run(options.programs / "gantry-drive", "--lockstep", "--seed", "7").wait_line("lockstep")
        simulator.step(WARM_UP_TICKS)
        with gantry.open("ego/front/rgb", domain=simulator.domain) as colours, gantry.open("ego/front/semantic", domain=simulator.domain) as classes:
            for n in range(options.pictures):
                simulator.step(SECONDS_APART * TICK_HZ)
                colour, labels = colours.next(), classes.next()
                if colour.tick != labels.tick:
                    sys.exit(f"{town}, {condition}: colour of tick {colour.tick}, classes of tick {labels.tick}")
                name = f"{town}_{condition}_{n:02}"
                Image.fromarray(np.ascontiguousarray(colour.rgb)).save(folder / f"{name}.png")
                Image.fromarray(np.ascontiguousarray(labels.array)).save(folder / f"{name}_s.png")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--quality", choices=("low", "high"), default="low")
    parser.add_argument("--maps", default="Town10HD,Town03,Town02")
    parser.add_argument("--pictures", type=int, default=15, help="of each map in each condition")
    parser.add_argument("--programs", type=pathlib.Path, default=PROGRAMS, help="folder of Gantry's programs [default: target/release]")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    for town in options.maps.split(","):
        for condition in CONDITIONS:
            draw(options.folder, town, condition, options)
            print(town, condition, flush=True)


if __name__ == "__main__":
    sys.exit(main())
