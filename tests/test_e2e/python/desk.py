"""What a page of gantry-desk asks, as HTTP: python desk.py URL."""

import http.client
import json
import sys
import time
from urllib.parse import parse_qs, urlsplit
from urllib.request import Request, urlopen

page = sys.argv[1]
port = urlsplit(page).port
base, token = f"http://127.0.0.1:{port}", parse_qs(urlsplit(page).query)["token"][0]


def get(path):
    with urlopen(Request(base + path, headers={"X-Gantry-Token": token}), timeout=30) as answer:
        return json.load(answer)


def post(path, body):
    request = Request(base + path, json.dumps(body).encode(), {"X-Gantry-Token": token}, method="POST")
    with urlopen(request, timeout=60) as answer:
        return json.load(answer)


def command(*commands):
    return post("/command", {"v": 1, "commands": commands})["replies"]


def until(what, found, seconds=60):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        world = get("/state")["world"]
        if world.get("map") and found(world):
            return world
        time.sleep(0.1)
    raise SystemExit(f"{what}: {world}")


def status(method, path, headers, body=None):
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30)
    connection.putrequest(method, path, skip_host="Host" in headers)
    for name, value in headers.items():
        connection.putheader(name, value)
    connection.putheader("Content-Length", str(len(body or b"")))
    connection.endheaders(body)
    answer = connection.getresponse()
    text = answer.read().decode()
    assert answer.getheader("Access-Control-Allow-Origin") is None
    connection.close()
    return answer.status, text


# Who may come in.
with urlopen(page, timeout=30) as answer:
    assert b"<title>Gantry desk" in answer.read() and "frame-ancestors 'none'" in answer.headers["Content-Security-Policy"]
known = {"X-Gantry-Token": token}
batch = b'{"v":1,"commands":[{"do":"ping"}]}'
assert status("GET", "/", {})[0] == 403
assert status("GET", "/?token=" + "0" * 32, {})[0] == 403
assert status("GET", "/state", known | {"Host": "evil.example"})[0] == 403
assert status("GET", "/state", known | {"Origin": "http://evil.example"})[0] == 403
assert status("POST", f"/command?token={token}", {}, batch)[0] == 403, "a form of another site knows no header"
assert status("OPTIONS", "/command", known)[0] == 405
assert status("GET", "/nothing", known)[0] == 404
assert status("POST", "/fly", known, b'["land"]')[0] == 400
assert status("POST", "/command", known, batch)[0] == 200
print("door passed")

# Time.
world = until("a world", lambda world: world["tick"] > 0)
assert command({"do": "configure", "mode": "stepped"})[0]["is"] == "done"
until("a pause", lambda world: world["paused"])
stands = post("/command", {"v": 1, "commands": [{"do": "ping"}]})["tick"]
still = until("the last tick", lambda world: world["tick"] == stands)
time.sleep(0.5)
assert get("/state")["world"]["tick"] == still["tick"]
assert command({"do": "step", "n": 7})[0]["last_tick"] == still["tick"] + 7
until("seven ticks", lambda world: world["tick"] == still["tick"] + 7)
assert command({"do": "set_speed", "ratio": 0.5})[0]["is"] == "done"
assert command({"do": "set_speed", "ratio": 9999})[0]["is"] == "refused"
command({"do": "configure", "mode": "free_running"})
until("time that goes on", lambda world: not world["paused"] and world["tick"] > still["tick"] + 7)
print("time passed")

# Weather and time of day.
weather = world["weather"] | {"sun_altitude_deg": -20, "fog_density": 40}
assert command({"do": "set_weather", "weather": weather})[0]["is"] == "done"
until("night", lambda world: world["weather"]["sun_altitude_deg"] == -20 and world["weather"]["fog_density"] == 40)
print("weather passed")

# A vehicle comes, is followed, and goes.
town = get("/town")
assert town["revision"] == get("/state")["world"]["revision"] and town["lanes"] and "vehicle.tesla.model3" in town["types"]
for pose in town["spawn_points"]:
    (reply,) = command({"do": "spawn", "type_id": "vehicle.tesla.model3", "pose": pose, "role": "autopilot"})
    if reply["is"] == "spawned":
        break
car = reply["actor_id"]
world = until("the car", lambda world: any(it["id"] == car for it in world["vehicles"]))
at = next(it for it in world["vehicles"] if it["id"] == car)
assert at["type"] == "vehicle.tesla.model3" and abs(at["at"][0] - pose["translation_m"][0]) < 3, (at, pose)
with urlopen(f"{base}/picture?token={token}", timeout=60) as pictures:
    post("/fly", [{"follow": car}])
    for _ in range(3):
        assert pictures.readline() == b"--gantry-picture\r\n"
        assert pictures.readline() == b"Content-Type: image/jpeg\r\n"
        n_bytes = int(pictures.readline().split()[1])
        assert pictures.readline() == b"\r\n"
        jpeg = pictures.read(n_bytes)
        assert jpeg[:3] == b"\xff\xd8\xff" and jpeg[-2:] == b"\xff\xd9" and pictures.read(2) == b"\r\n"
    end = time.monotonic() + 60
    while f"behind vehicle.tesla.model3 {car}" not in get("/state")["flight"]:
        assert time.monotonic() < end, get("/state")["flight"]
        time.sleep(0.1)
assert command({"do": "destroy", "actor_id": car})[0]["is"] == "done"
until("an empty place", lambda world: all(it["id"] != car for it in world["vehicles"]))
print("vehicle passed")
