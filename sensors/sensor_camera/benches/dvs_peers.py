"""Events of the same rendered frames by ESIM's formula, by v2e's emulator and by Gantry, in number, place, time and CPU time.

    cargo run --release -p sensor_camera --example dvs_peers -- FOLDER 640 480
    python dvs_peers.py FOLDER WIDTH HEIGHT [V2E]

V2E is a checkout of https://github.com/SensorsINI/v2e; without it v2e is left out. Levels are ln(luminance + 0.001), thresholds 0.3, no noise.
The reference is ESIM's formula on frames of 1 kHz: levels go in straight lines from frame to frame, and every passing of a multiple of the
threshold from the last event is an event. A pixel's times are compared where it has the reference's events, in number and polarity.
"""

import pathlib
import sys
import time

import numpy as np

THRESHOLD, EPS, STEP_SECS = 0.3, 0.001, 1e-3
RECORD = np.dtype([("nanos", "<u4"), ("x", "<u2"), ("y", "<u2"), ("id", "<u4"), ("on", "u1"), ("class", "u1"), ("reserved", "<u2"), ("window", "<u8")])


def esim(levels, secs):
    """(pixel, seconds, on) of every event, sorted by pixel and time."""
    reference, found = levels[0].copy(), []
    for i, (before, now) in enumerate(zip(levels[:-1], levels[1:])):
        for on, sign in ((True, 1.0), (False, -1.0)):
            steps = np.floor(np.maximum(sign * (now - reference), 0.0) / THRESHOLD + 1e-6).astype(int)
            for k in range(1, steps.max() + 1):
                pixel = np.flatnonzero(steps >= k)
                level = reference[pixel] + sign * k * THRESHOLD
                change = now[pixel] - before[pixel]
                share = np.clip(np.divide(level - before[pixel], change, out=np.ones_like(level), where=change != 0), 0, 1)
                found.append((pixel, (i + share) * secs, np.full(len(pixel), on)))
            reference += sign * steps * THRESHOLD
    return in_order(*(np.concatenate(part) for part in zip(*found)))


def in_order(pixel, secs, on):
    order = np.lexsort((secs, pixel))
    return pixel[order], secs[order], on[order]


def ours(path, width, window_secs):
    events = np.fromfile(path, RECORD)
    pixel = events["y"].astype(int) * width + events["x"]
    return in_order(pixel, events["window"] * window_secs + events["nanos"] * 1e-9, events["on"] == 1)


def v2e(levels, secs, shape):
    from v2ecore.emulator import EventEmulator

    emulator = EventEmulator(pos_thres=THRESHOLD, neg_thres=THRESHOLD, sigma_thres=0.0, cutoff_hz=0, leak_rate_hz=0, shot_noise_rate_hz=0,
                             refractory_period_s=0, seed=1, hdr=True, device="cpu")
    found = []
    for i, level in enumerate(levels):
        events = emulator.generate_events(level.reshape(shape).astype(np.float32), i * secs)
        if events is not None:
            found.append(events)
    all_of_them = np.concatenate(found)
    pixel = all_of_them[:, 2].astype(int) * shape[1] + all_of_them[:, 1].astype(int)
    return in_order(pixel, all_of_them[:, 0], all_of_them[:, 3] > 0)


def compare(name, events, reference, n_pixels, cpu):
    counts, theirs = (np.bincount(of[0], minlength=n_pixels) for of in (events, reference))
    starts, their_starts = (np.concatenate(([0], np.cumsum(count))) for count in (counts, theirs))
    errors = []
    for pixel in np.flatnonzero((counts == theirs) & (counts > 0)):
        a, b = slice(starts[pixel], starts[pixel + 1]), slice(their_starts[pixel], their_starts[pixel + 1])
        if (events[2][a] == reference[2][b]).all():
            errors.append(np.abs(events[1][a] - reference[1][b]))
    errors = np.concatenate(errors) * 1e3 if errors else np.array([np.nan])
    print(f"{name:24} {len(events[0]):8} events ({len(events[0]) / len(reference[0]):.2f}), {events[2].mean():.3f} ON, "
          f"counts' correlation {np.corrcoef(counts, theirs)[0, 1]:.3f}, "
          f"{len(errors) / len(reference[0]):.2f} of the events compared: time off by p50 {np.percentile(errors, 50):.2f} ms, "
          f"p90 {np.percentile(errors, 90):.2f} ms, CPU {cpu:.2f} s a simulated second", flush=True)


def timed(make, simulated_secs):
    began = time.process_time()
    events = make()
    return events, (time.process_time() - began) / simulated_secs


def main():
    folder, width, height = pathlib.Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    luminance = np.fromfile(folder / "luminance.f32", "<f4").reshape(-1, height * width)
    levels = np.log(luminance.astype(np.float64) + EPS)
    simulated = (len(levels) - 1) * STEP_SECS
    cpu_of = dict(line.split() for line in (folder / "cpu.txt").read_text().splitlines())
    n_pixels = width * height
    reference, cpu = timed(lambda: esim(levels, STEP_SECS), simulated)
    compare("ESIM, 1 kHz (reference)", reference, reference, n_pixels, cpu)
    events, cpu = timed(lambda: esim(levels[::50], 50 * STEP_SECS), simulated)
    compare("ESIM, 20 Hz", events, reference, n_pixels, cpu)
    for name, label in (("motion", "Gantry, 20 Hz"), ("motion_4px", "Gantry, 20 Hz, 4 px")):
        compare(label, ours(folder / f"{name}.events", width, 50 * STEP_SECS), reference, n_pixels, float(cpu_of[name]))
    # CARLA's plain mode works on the encoded picture: its own reference.
    encoded = np.where(luminance <= 0.0031308, 12.92 * luminance, 1.055 * luminance.astype(np.float64) ** (1 / 2.4) - 0.055)
    plain = esim(np.log(encoded + EPS), STEP_SECS)
    events = ours(folder / "two_frame_1khz.events", width, STEP_SECS)
    compare("two_frame, 1 kHz, of its", events, plain, n_pixels, float(cpu_of["two_frame_1khz"]))
    if len(sys.argv) > 4:
        sys.path.insert(0, sys.argv[4])
        for step, label in ((1, "v2e, 1 kHz"), (50, "v2e, 20 Hz")):
            events, cpu = timed(lambda: v2e(levels[::step], step * STEP_SECS, (height, width)), simulated)
            compare(label, events, reference, n_pixels, cpu)


main()
