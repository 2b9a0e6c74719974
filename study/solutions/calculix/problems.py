"""All problems that CalculiX solves for the study."""

from study.solutions.calculix.blocks_in_space import (
    PATCHES,
    SLIDING_BLOCKS,
    RotatedPatch,
    SlidingBlock,
)
from study.solutions.calculix.cylinder import CYLINDERS, CylinderOnRubberBlock
from study.solutions.calculix.decks import (
    BlockWithPrintedContactPressure,
    BucklingHalfBeam,
    PressedAndPulledBlock,
    PressedSquareOfTwoTriangles,
)
from study.solutions.calculix.die import DIES, DieSlidingOnBlock
from study.solutions.calculix.hertz_line import HERTZ_LINES, HertzLineContact
from study.solutions.calculix.plastic import PLASTIC_BLOCKS, CylinderOnPlasticBlock
from study.solutions.calculix.shrink_fit import SHRUNK_TUBES, ShrunkTubes
from study.solutions.calculix.standard_decks import SPECIMENS, AnySpecimen
from study.solutions.calculix.two_bodies import (
    PAIRS,
    QuarterOfTouchingSpheres,
    StackedBlocksPatchTest,
)

Problem = (
    PressedSquareOfTwoTriangles
    | PressedAndPulledBlock
    | BucklingHalfBeam
    | AnySpecimen
    | StackedBlocksPatchTest
    | QuarterOfTouchingSpheres
    | HertzLineContact
    | CylinderOnRubberBlock
    | DieSlidingOnBlock
    | RotatedPatch
    | SlidingBlock
    | CylinderOnPlasticBlock
    | ShrunkTubes
)

PROBLEMS: dict[str, Problem] = {
    "two-triangles": PressedSquareOfTwoTriangles(),
    "block-even": PressedAndPulledBlock(),
    "block-part": PressedAndPulledBlock(pressed=(1.0, 3.0)),
    "block-lifting": PressedAndPulledBlock(pressed=(1.2, 2.0)),
    "block-friction-0.15": PressedAndPulledBlock(friction=0.3, pull=0.15),
    "block-friction-0.30": PressedAndPulledBlock(friction=0.3, pull=0.3),
    "block-part-CPS6": PressedAndPulledBlock(pressed=(1.0, 3.0), element="CPS6"),
    "block-part-CPS6-thin": PressedAndPulledBlock(
        pressed=(1.0, 3.0), element="CPS6", thickness=0.01
    ),
    "block-native": BlockWithPrintedContactPressure(),
    **{
        f"beam-{nx}x{ny}-mode{mode}": BucklingHalfBeam((nx, ny), mode)
        for nx, ny in ((8, 2), (16, 4))
        for mode in (1, 2)
    },
    **SPECIMENS,
    **PAIRS,
    **HERTZ_LINES,
    **CYLINDERS,
    **DIES,
    **PATCHES,
    **SLIDING_BLOCKS,
    **PLASTIC_BLOCKS,
    **SHRUNK_TUBES,
}
"""Problems by the names of their recorded answers."""
