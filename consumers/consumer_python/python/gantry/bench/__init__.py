"""Programs for the perception benchmark: frames in, results out, and the same file runs everywhere.

    import gantry, gantry.bench

    @gantry.bench.program(inputs={"image": "ego/front/rgb"}, output=("mine/boxes", "boxes2d"))
    def detect(image):                                  # a gantry.Frame
        corners, scores = my_network(image.rgb)
        return gantry.boxes2d(xyxy=corners, score=scores)

    if __name__ == "__main__":
        gantry.bench.run(detect)

`run` opens inputs and outputs, takes the newest frames and skips those that came while the function
was busy, names in every result which frames it answers, and ends on INT and TERM. The simulator, a
replay and `gantry bench perception` all drive it; docs/how-to/perception-benchmark.md explains the last.
`run_file` runs it over a recording and keeps its results in a file beside it.
With state, or with something to load and warm up, write a class: see `Program`.
"""

from ._program import FunctionProgram, Output, Program, program
from ._run import RunCounts, params, run, run_file

__all__ = ["FunctionProgram", "Output", "Program", "RunCounts", "params", "program", "run", "run_file"]
