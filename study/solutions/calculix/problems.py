"""All problems that CalculiX solves for the study."""

from study.solutions.calculix.cylinder import CYLINDERS, CylinderOnRubber
from study.solutions.calculix.decks import (
    Block,
    BlockWithPrintedContactPressure,
    HalfBeam,
    TwoTriangles,
)
from study.solutions.calculix.die import DIES, DieOnBlock
from study.solutions.calculix.hertz_line import HERTZ_LINES, HertzLineProblem
from study.solutions.calculix.standard_decks import SPECIMENS, AnySpecimen
from study.solutions.calculix.two_bodies import PAIRS, StackedBlocks, TouchingSpheres

Problem = (
    TwoTriangles
    | Block
    | HalfBeam
    | AnySpecimen
    | StackedBlocks
    | TouchingSpheres
    | HertzLineProblem
    | CylinderOnRubber
    | DieOnBlock
)

PROBLEMS: dict[str, Problem] = {
    "two-triangles": TwoTriangles(),
    "block-even": Block(),
    "block-part": Block(pressed=(1.0, 3.0)),
    "block-lifting": Block(pressed=(1.2, 2.0)),
    "block-friction-0.15": Block(friction=0.3, pull=0.15),
    "block-friction-0.30": Block(friction=0.3, pull=0.3),
    "block-part-CPS6": Block(pressed=(1.0, 3.0), element="CPS6"),
    "block-part-CPS6-thin": Block(pressed=(1.0, 3.0), element="CPS6", thickness=0.01),
    "block-native": BlockWithPrintedContactPressure(),
    **{
        f"beam-{nx}x{ny}-mode{mode}": HalfBeam((nx, ny), mode)
        for nx, ny in ((8, 2), (16, 4))
        for mode in (1, 2)
    },
    **SPECIMENS,
    **PAIRS,
    **HERTZ_LINES,
    **CYLINDERS,
    **DIES,
}
"""Problems by the names of their recorded answers."""
