"""Runs CARLA's own smoke tests (`PythonAPI/test/smoke` of its repository) and prints what becomes of each file.

They ask for port 3654. Start a Gantry there first:

    gantry up launch/carla.toml --view none --set 'process.carla.cmd=["gantry-carla", "--port", "3654"]'
    python tests/foreign/carla_smoke.py carla/PythonAPI/test

Options: names of files to run instead of all, such as `test_lidar`.
Some files name coordinates of CARLA's own towns: `gantry map import` takes those roads over (docs/how-to/carla-migration.md), which leads them further.
"""

import argparse
import pathlib
import re
import subprocess
import sys

PATIENCE_SECS = 3600


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path, help="PythonAPI/test of CARLA's repository")
    parser.add_argument("files", nargs="*", help="names of files without .py")
    given = parser.parse_args()
    if not (given.folder / "smoke" / "__init__.py").is_file():
        parser.error(f"{given.folder} has no folder smoke; give PythonAPI/test of CARLA's repository")
    return given


def main():
    given = arguments()
    files = given.files or sorted(file.stem for file in (given.folder / "smoke").glob("test_*.py"))
    n_failed = 0
    for name in files:
        command = [sys.executable, "-m", "unittest", "-v", f"smoke.{name}"]
        try:
            ran = subprocess.run(command, cwd=given.folder, capture_output=True, text=True, timeout=PATIENCE_SECS)
            said, code = ran.stdout + ran.stderr, ran.returncode
        except subprocess.TimeoutExpired:
            said, code = "", f"stopped after {PATIENCE_SECS} s"
        n_failed += code != 0
        print(f"{name}: {'passed' if code == 0 else f'failed ({code})'}", flush=True)
        for line in said.splitlines():
            if re.match(r"(FAIL|ERROR): |\w*(Error|Exception): ", line):
                print(f"    {line[:300]}", flush=True)
    print(f"{len(files) - n_failed} of {len(files)} files passed")
    sys.exit(1 if n_failed else 0)


if __name__ == "__main__":
    main()
