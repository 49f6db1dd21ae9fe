#!/usr/bin/env python3
"""Compare schema_roads with the map code of the PyPI wheel carla==0.9.16 on any OpenDRIVE files.

    python -m venv /tmp/venv && /tmp/venv/bin/pip install carla==0.9.16
    cargo build --release -p schema_roads --example roads_dump
    /tmp/venv/bin/python schemas/schema_roads/tests/oracle/compare.py target/release/examples/roads_dump MAP.xodr [MAP.xodr ...]

Exit code 1 if any map disagrees by more than 1 cm, 1 degree of heading, a lane-graph edge or a signal's place.
What carla does on its own and we do not: it takes lanes on a bend to be as long as the road's middle when it works out the heading
of a lane that widens; it ignores superelevation and crossfall (such maps are marked, and 2 cm are allowed);
a lane whose road does not name its junction ends for it, and is linked to itself; objects called "Speed_.." count as signs;
lights that stand above a lane are moved aside by 25 cm.
"""

import json
import math
import subprocess
import sys

import carla


class Dump:
    """The Rust side: lanes and signals up front, then questions."""

    def __init__(self, program, path):
        self.process = subprocess.Popen([program, path], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        self.lanes, self.signals = {}, {}
        for line in self.process.stdout:
            record = json.loads(line)
            if "lane" in record:
                self.lanes[tuple(record["lane"])] = record
            elif "signal" in record:
                self.signals[record["signal"]] = record
            else:
                break

    def ask_all(self, questions):
        answers = []
        # In slices, so that neither side's pipe fills up while the other waits.
        for i in range(0, len(questions), 100):
            part = questions[i : i + 100]
            self.process.stdin.write("".join(q + "\n" for q in part))
            self.process.stdin.flush()
            answers += [json.loads(self.process.stdout.readline()) for _ in part]
        return answers

    def close(self):
        self.process.stdin.close()
        self.process.wait()


def key_of(waypoint):
    return (waypoint.road_id, waypoint.section_id, waypoint.lane_id)


def angle_between(a, b):
    return abs((a - b + math.pi) % (2 * math.pi) - math.pi)


class Report:
    def __init__(self, path):
        self.path, self.failed, self.lines = path, False, []

    def add(self, good, text):
        self.failed |= not good
        self.lines.append(("   " if good else " ! ") + text)

    def show(self):
        print(f"{'FAIL' if self.failed else 'ok  '} {self.path}")
        for line in self.lines:
            print(line)


def compare_waypoints(report, theirs, ours, superelevated):
    waypoints = theirs.generate_waypoints(2.0)
    answers = ours.ask_all(["at %d %d %d %.9f" % (*key_of(w), w.s) for w in waypoints])
    missing, places, headings, widths, changes, far, junctions = 0, [], [], [], 0, 0, 0
    for w, a in zip(waypoints, answers):
        if a is None:
            missing += 1
            continue
        lane = ours.lanes[key_of(w)]
        location, rotation = w.transform.location, w.transform.rotation
        # At a section's very end the wheel takes the next section's lane, and a lane of no width has no middle to compare.
        at_end = min(w.s - lane["start"], lane["start"] + lane["length"] - w.s) < 1e-3
        dz = 0.0 if superelevated else a["p"][2] - location.z
        distance = math.dist((a["p"][0], a["p"][1], dz), (location.x, -location.y, 0.0))
        if at_end and distance > 0.01:
            far += 1
            continue
        places.append(distance)
        headings.append(math.degrees(angle_between(a["yaw"], -math.radians(rotation.yaw))))
        widths.append(abs(a["width"] - w.lane_width))
        flags = int(w.lane_change)
        # carla: 1 right, 2 left; it does not ask whether there is a lane to change to.
        changes += (a["change"][0] and not flags & 2) or (a["change"][1] and not flags & 1)
        junctions += (lane["junction"] is not None) != w.is_junction
    n = len(places)
    report.add(missing == 0, f"{len(waypoints)} waypoints, {missing} on lanes we lack, {far} skipped at section ends")
    if n:
        report.add(max(places) < (0.02 if superelevated else 0.01), f"position: largest difference {max(places) * 1000:.3f} mm, mean {sum(places) / n * 1000:.4f} mm")
        headings.sort()
        report.add(headings[int(0.999 * (n - 1))] < 1.0, f"heading: 99.9 % below {headings[int(0.999 * (n - 1))]:.4f} deg, largest {headings[-1]:.3f} deg")
        report.add(max(widths) < 0.01, f"width: largest difference {max(widths) * 1000:.3f} mm")
        report.add(changes == 0, f"lane change allowed by us and not by carla: {changes}; junction flag differs: {junctions}")


def compare_topology(report, theirs, ours, direct):
    edges = {(key_of(a), key_of(b)) for a, b in theirs.get_topology()}
    mine = {(k, tuple(s)) for k, lane in ours.lanes.items() if lane["drivable"] for s in lane["successors"]}
    mine = {(a, b) for a, b in mine if ours.lanes[b]["drivable"]}
    edges = {(a, b) for a, b in edges if ours.lanes.get(b, {}).get("drivable")}
    ends = {a for a, b in edges if a == b}
    edges -= {(a, a) for a in ends}
    only_theirs, only_mine = sorted(edges - mine), sorted((a, b) for a, b in mine - edges if a not in ends)
    report.add(True, f"lanes that end for carla and go on for us: {len({a for a, _ in mine} & ends)}, that end for both: {len(ends - {a for a, _ in mine})}")
    # Direct junctions are newer than carla's reader, which misses some of their ways.
    report.add(not only_theirs and (direct or not only_mine), f"lane graph: {len(edges & mine)} edges agree, {len(only_theirs)} only carla {only_theirs[:3]}, {len(only_mine)} only ours {only_mine[:3]}")


def compare_signals(report, theirs, ours):
    worst, n, missing = 0.0, 0, set()
    for landmark in theirs.get_all_landmarks():
        signal = ours.signals.get(landmark.id)
        if signal is None:
            if not landmark.name.startswith("Speed_"):
                missing.add(landmark.id)
            continue
        location = landmark.transform.location
        flat = math.dist((signal["at"][0], signal["at"][1]), (location.x, -location.y))
        worst, n = max(worst, flat), n + 1
    report.add(not missing, f"landmarks: {n} agree in id, missing {sorted(missing)[:5]}")
    report.add(worst < 0.27, f"landmark position: largest difference {worst * 1000:.2f} mm")


def compare_nearest(report, theirs, ours, superelevated):
    waypoints = theirs.generate_waypoints(11.0)
    points = [(w.transform.location.x + 0.7 * math.sin(i), -w.transform.location.y + 0.7 * math.cos(i), w.transform.location.z) for i, w in enumerate(waypoints)]
    answers = ours.ask_all(["near %.6f %.6f %.6f" % p for p in points])
    same, nearer, farther = 0, 0, 0
    for p, a in zip(points, answers):
        w = theirs.get_waypoint(carla.Location(p[0], -p[1], p[2]))
        if w is None or a is None:
            farther += 1
        elif tuple(a["lane"]) == key_of(w) and abs(a["station"] - w.s) < 0.05:
            same += 1
        else:
            location = w.transform.location
            ours_away = abs(a["offset"])
            farther += ours_away > math.dist((location.x, -location.y), p[:2]) + (0.1 if superelevated else 0.02)
            nearer += 1
    report.add(farther == 0, f"nearest lane: {same} the same, {nearer} other (overlapping lanes), {farther} farther than carla's")


def main():
    program, paths = sys.argv[1], sys.argv[2:]
    failed = False
    for path in paths:
        text = open(path, encoding="utf-8", errors="replace").read()
        report = Report(path)
        superelevated = "<superelevation" in text or "<crossfall" in text
        if superelevated:
            report.add(True, "superelevated: heights not compared")
        theirs = carla.Map("map", text)
        ours = Dump(program, path)
        compare_waypoints(report, theirs, ours, superelevated)
        compare_topology(report, theirs, ours, 'type="direct"' in text)
        compare_signals(report, theirs, ours)
        compare_nearest(report, theirs, ours, superelevated)
        ours.close()
        report.show()
        failed |= report.failed
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
