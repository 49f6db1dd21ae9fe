"""What a program reads, what it publishes, and the function or class that turns one into the other."""

from __future__ import annotations

import functools
import inspect
from dataclasses import dataclass
from typing import Any, Callable, Mapping, Sequence, Union

import numpy.typing as npt

from .._publish import RESULT_TYPES, BytesSchema


@dataclass(frozen=True)
class Output:
    """A topic of results that a program publishes; the fields are those of `gantry.publish`."""

    #: Name without the domain: `mine/boxes`.
    topic: str
    #: One of `gantry.RESULT_TYPES`.
    type: str
    #: Names of the classes that records number from 0; empty: CARLA's numbers.
    classes: Sequence[str] = ()
    #: Structured type of `points`; None: x, y, z, intensity.
    fields: npt.DTypeLike | None = None
    #: Pairs of key points that a line joins.
    bones: Sequence[tuple[int, int]] = ()
    #: What messages of `bytes` are.
    schema: BytesSchema | None = None
    #: A sentence for people.
    note: str = ""

    def __post_init__(self) -> None:
        if self.type not in RESULT_TYPES:
            raise ValueError(f"{self.type!r} is no type of results; it must be one of {', '.join(RESULT_TYPES)}")


#: An output as users may write it.
OutputLike = Union[Output, tuple[str, str]]


class Program:
    """A program with a state of its own. Say `inputs` and `outputs`, and write `work`:

        class Detector(gantry.bench.Program):
            inputs = {"image": "ego/front/rgb"}
            outputs = [gantry.bench.Output("mine/boxes", "boxes2d", classes=["person"])]

            def warm_up(self):
                self.network = load("weights.pt")

            def work(self, image):
                return self.network(image.rgb)

        gantry.bench.run(Detector())
    """

    #: Topics of frames or results by the name under which `work` gets them.
    inputs: Mapping[str, str] = {}
    #: Topics of results, one or several.
    outputs: OutputLike | Sequence[OutputLike] = ()
    #: Whether every frame is worked on in order, and not only the newest: for odometry, event
    #: cameras and trackers. What does not fit into the topic's buffer meanwhile is lost.
    every: bool = False

    def warm_up(self) -> None:
        """Loads what is needed, and does once what is slow the first time.

        It is called before the program counts as ready: nothing of it is measured.
        """

    def work(self, *args: Any, **frames: Any) -> Any:
        """Answers one frame of each input, all of one tick; they come by the names of `inputs`.

        Returns what `Publisher.send` of the output's type takes; with several outputs a mapping
        from topic to that; None if there is nothing to say, so that the frame stays unanswered (an
        empty list says that nothing was found). Frames are read in place: keep `frame.copy()`, not
        the frame.
        """
        raise NotImplementedError(f"{type(self).__name__} has no work(); it gets the frames and returns the result")

    def name(self) -> str:
        """Name for messages."""
        return type(self).__name__


class FunctionProgram(Program):
    """A function as a program. Called, it is still the function, so that tests need no simulator."""

    def __init__(
        self,
        function: Callable[..., Any],
        inputs: Mapping[str, str],
        outputs: Sequence[OutputLike],
        every: bool,
        warm_up: Callable[[], object] | None,
    ) -> None:
        functools.update_wrapper(self, function)
        self._function, self._warm_up = function, warm_up
        self.inputs, self.outputs, self.every = dict(inputs), outputs, every
        try:
            inspect.signature(function).bind(**dict.fromkeys(inputs))
        except TypeError as cause:
            raise ValueError(f"{self.name()} cannot be called with the inputs {', '.join(inputs)}: {cause}; name its parameters as the inputs") from cause

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        return self._function(*args, **kwargs)

    def warm_up(self) -> None:
        """Calls the function that was given as `warm_up`."""
        if self._warm_up is not None:
            self._warm_up()

    def work(self, *args: Any, **frames: Any) -> Any:
        """Calls the function."""
        return self._function(*args, **frames)

    def name(self) -> str:
        """Name of the function."""
        return getattr(self._function, "__name__", "program")


def program(
    *,
    inputs: Mapping[str, str],
    output: OutputLike | None = None,
    outputs: Sequence[OutputLike] = (),
    every: bool = False,
    warm_up: Callable[[], object] | None = None,
) -> Callable[[Callable[..., Any]], FunctionProgram]:
    """Makes a program of a function whose parameters are the keys of `inputs`.

    `inputs` are topics by name, `output` is `(topic, type)` or an `Output`, `outputs` are several.
    `every` and `warm_up` are as in `Program`. Raises `ValueError` if the function cannot be called
    with the inputs, or a type of results does not exist.
    """
    chosen = [*([] if output is None else [output]), *outputs]

    def decorate(function: Callable[..., Any]) -> FunctionProgram:
        return FunctionProgram(function, inputs, chosen, every, warm_up)

    return decorate


def outputs_of(chosen: Program) -> list[Output]:
    """Returns the outputs of a program. Raises `ValueError` if there are none, or two of one topic."""
    written = chosen.outputs
    several: Sequence[OutputLike]
    if isinstance(written, Output):
        several = [written]
    elif isinstance(written, tuple) and len(written) == 2 and all(isinstance(part, str) for part in written):
        several = [(str(written[0]), str(written[1]))]
    else:
        several = [one for one in written if not isinstance(one, str)]
    found = [one if isinstance(one, Output) else Output(*one) for one in several]
    topics = [one.topic for one in found]
    if not found or len(set(topics)) < len(topics):
        raise ValueError(f"{chosen.name()} publishes {', '.join(topics) or 'nothing'}; it needs one output or more, each on a topic of its own")
    return found
