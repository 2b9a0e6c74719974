"""Render the recipe for conda-forge: `python3 .ci/recipe.py`, with py-rattler-build on the path.

What a person fills after the release gets stand-ins. Nothing is downloaded: the package is not
built, and that its requirements can be found in conda-forge is not checked.
"""

import re
import sys
from pathlib import Path

from rattler_build import Stage0Recipe, VariantConfig

RECIPE = Path(__file__).resolve().parents[1] / "docs" / "publication" / "recipe.yaml"
STAND_INS = {
    "public URL of the sdist": "https://example.org/pw_elements.tar.gz",
    "sha256 of the sdist": "0" * 64,
    "public URL of the repository": "https://example.org/pw-elements",
    "account of the maintainer": "maintainer",
}


def render_recipe(text: str) -> dict:
    """Return the rendered recipe, which has a single variant.

    Raises:
        RecipeParseError: if a value has another form than the recipe format demands.
    """
    filled = re.sub(r"TO BE FILLED: ([^\"]*)", lambda match: STAND_INS[match[1]], text)
    (variant,) = Stage0Recipe.from_yaml(filled).render(VariantConfig())
    return variant.recipe.to_dict()


def main() -> int:
    """Print package, version and requirements of the rendered recipe."""
    recipe = render_recipe(RECIPE.read_text("utf-8"))
    package, requirements = recipe["package"], recipe["requirements"]
    print(f"== recipe of {package['name']} {package['version']}: {', '.join(requirements['run'])}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
