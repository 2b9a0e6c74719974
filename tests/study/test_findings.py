"""Numbers that are only recorded, and findings that a second or two computes, found again.

Computed anew without any stored results; `./run study check` judges all others.
"""

import re

import pytest

from study.judge.claims import judge, load_claims
from tests.study.computed_results import listed

QUICK = """
71: constants constants-galerkin
72: balance composite own transfer transfer-stick displacements condensed
74: own tributary
75: axis units transfer symmetrised-half weights symmetrised-sign guyan-sign
76: weights-. static-symmetrised unsymmetrised-1 safe-exact-1 safe-exact-J-2 thin-1 gap-1
s4: lumped
s5: q9-even identity rigid diagonal q9-unsymmetric
T: (?!order).*
C: symmetrised near-composite pairs
P: native reactions cps6-thin cps6-buckling-thin transferred transferred-lifting surface
P: reduced-contact reduced-radial normal elsewhere-.* tangential solid-friction
V1: own displacement tributary-.* curved-.* round axis
V2: nafems-.* force-order approach
V3: forces-.* depth shear far-field transfer composite
V4: held sawtooth-pw
V5: held pressure shear
V6: sawtooth-pw prototype
V7: holds slides
V8: tube tube-composite strip rod order-rod order-strip better-square
V9: consistent sibling sibling-spectrum positive grows
V10: sphere-median sphere-max
V11: hertz-l2 hertz-inner hertz-dual master-ratio r0094-width unequal calculix-mortar
V12: step-weights unstable release-plane plane
V13: square square-max trefftz-.*
V14: sawtooth-.* moment-linear moment-far force
V15: cook hertz hertz-even order-.* square-H1 infsup-T6-standard identity-.* presses
V17: objective-90 fit
"""
PATTERNS = [f"{section}-{name}" for section, name in listed(QUICK)]
CLAIMS = load_claims()
CHOSEN = [c for c in CLAIMS if c.kind == "finding" and re.fullmatch("|".join(PATTERNS), c.id)]
# Long series; ./run study computes and judges them, too
SLOW = "(V8-(real-all|sym)|C-(?!guyan-v).*)-value"
PINS = [
    pytest.param(one, marks=[pytest.mark.slow] * bool(re.fullmatch(SLOW, one.id)), id=one.id)
    for one in CLAIMS
    if one.kind == "pin"
]


@pytest.mark.parametrize("claim", [*CHOSEN, *PINS], ids=lambda claim: claim.id)
def test_a_number_is_found_again(claim, results):
    (found,) = judge([claim], results)
    assert not found.differs, f"{found.verdict} with {found.measured}, not {found.expected}"
    assert found.verdict == "holds" or claim.kind == "finding"


def test_no_finding_is_missing():
    for pattern in PATTERNS:
        assert any(re.fullmatch(pattern, claim.id) for claim in CHOSEN), pattern
