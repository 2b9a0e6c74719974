"""All problems that CalculiX has solved, by the names of their tracked files."""

from study.solutions.calculix.cylinder import CYLINDERS, Cylinder
from study.solutions.calculix.decks import Block, HalfBeam, NativePressure, TwoTriangles
from study.solutions.calculix.die import DIES, Die
from study.solutions.calculix.hertz_line import LINES, Line
from study.solutions.calculix.standard_decks import SPECIMENS, AnySpecimen
from study.solutions.calculix.two_bodies import PAIRS, Blocks, Spheres

Problem = TwoTriangles | Block | HalfBeam | AnySpecimen | Blocks | Spheres | Line | Cylinder | Die

PROBLEMS: dict[str, Problem] = {
    "two-triangles": TwoTriangles(),
    "block-even": Block(),
    "block-part": Block(pressed=(1.0, 3.0)),
    "block-lifting": Block(pressed=(1.2, 2.0)),
    "block-friction-0.15": Block(friction=0.3, pull=0.15),
    "block-friction-0.30": Block(friction=0.3, pull=0.3),
    "block-part-CPS6": Block(pressed=(1.0, 3.0), element="CPS6"),
    "block-part-CPS6-thin": Block(pressed=(1.0, 3.0), element="CPS6", thickness=0.01),
    "block-native": NativePressure(),
    **{
        f"beam-{nx}x{ny}-mode{mode}": HalfBeam((nx, ny), mode)
        for nx, ny in ((8, 2), (16, 4))
        for mode in (1, 2)
    },
    **SPECIMENS,
    **PAIRS,
    **LINES,
    **CYLINDERS,
    **DIES,
}
