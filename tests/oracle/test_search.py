"""The oracle's search of all statuses, and its proofs that there is no state."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from pw_elements import prescribe
from pw_elements.contact import NotFound
from tests.contact.cases import at
from tests.oracle.proofs import contradictions, contradicts, linear_increment
from tests.oracle.search import Found, search
from tests.oracle.test_statuses import KINDS, Pressed, refused


@pytest.mark.parametrize("seed", KINDS)
def test_search_finds_a_state_where_trying_all_statuses_does_and_nowhere_else(seed):
    one = Pressed(seed)
    stated = SimpleNamespace(
        K=one.K,
        space=one.space,
        loads=[one.K.createVecLeft()],
        conditions=[prescribe(one.space, axis, at(1, 0.0)) for axis in (0, 1)],
        pairs=[one.pair],
    )
    increment = linear_increment(stated, [])
    found = search(increment)
    assert (found.z is not None) == bool(KINDS[seed]) == (not found.closed)
    assert not found.closed or contradicts(contradictions(increment, found.closed))


def test_closed_branches_contradict_the_law_and_hold_all_statuses():
    """Statics alone do not rule an equilibrium out here, but elasticity does."""
    stated, error = refused(276, NotFound)
    increment = linear_increment(stated, error.states)
    branches = search(increment).closed
    assert contradicts(contradictions(increment, branches))
    # what is no proof is not taken for one
    assert not contradicts(contradictions(increment, branches[1:]))
    assert not contradicts(contradictions(increment, (*branches, branches[0])))
    stretched = replace(branches[0], normal=1.001 * branches[0].normal)
    assert not contradicts(contradictions(increment, (stretched, *branches[1:])))
    wider = branches[-1].allowed | branches[-1].allowed.any(axis=1, keepdims=True)
    widened = replace(branches[-1], allowed=wider)
    assert not contradicts(contradictions(increment, (*branches[:-1], widened)))
    # a search that is not finished proves nothing
    assert search(increment, most=30_000) == Found()


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1310, 2276])
def test_other_searches_prove_it_too(seed):
    stated, error = refused(seed, NotFound)
    increment = linear_increment(stated, error.states)
    branches = search(increment).closed
    assert branches
    assert contradicts(contradictions(increment, branches))
