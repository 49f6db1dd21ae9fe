"""Logs into the view of a domain: python join_view.py DOMAIN."""

import sys

import rerun as rr

import gantry

stream = gantry.rerun(domain=sys.argv[1], timeout=60.0)
with gantry.open("ego/front/rgb", domain=sys.argv[1]) as camera:
    for n, frame in enumerate(camera):
        stream.set_time("tick", sequence=frame.tick)
        stream.set_time("sim_time", duration=frame.sim_time)
        stream.log("world/ego/front/rgb/mine", rr.Points2D([[8.0, 6.0]]))
        if n == 4:
            break
stream.flush()
print("joined")
