"""Old public names still work, and say what they are called now."""

from importlib import import_module

import pytest

import pw_elements
from pw_elements import Reduction

RENAMED = {
    ("pw_elements", "State"): "StressState",
    ("pw_elements", "frequencies"): "vibration_modes",
    ("pw_elements", "support"): "prescribe",
    ("pw_elements.mechanics", "State"): "StressState",
    ("pw_elements.mechanics", "support"): "prescribe",
    ("pw_elements.eigen", "frequencies"): "vibration_modes",
    ("pw_elements.recovery", "ContactSurface"): "SurfaceNodes",
}


@pytest.mark.parametrize(("module", "old"), RENAMED)
def test_an_old_name_is_an_alias(module, old):
    new = RENAMED[module, old]
    with pytest.warns(DeprecationWarning, match=rf"{module}.{old} is now called {new}"):
        thing = getattr(import_module(module), old)
    assert thing is getattr(import_module(module), new)


def test_other_names_are_unknown_as_ever():
    with pytest.raises(AttributeError, match="'pw_elements' has no attribute 'nothing'"):
        _ = pw_elements.nothing
    assert all(hasattr(pw_elements, name) for name in pw_elements.__all__)
    assert not {old for _, old in RENAMED} & set(pw_elements.__all__)


def test_the_old_method_is_an_alias():
    calls = []

    class Spy:
        def expand_mode(self, reduced):
            calls.append(reduced)
            return "mode"

    with pytest.warns(DeprecationWarning, match="expand_mode"):
        assert Reduction.shape(Spy(), 3) == "mode"
    assert calls == [3]
