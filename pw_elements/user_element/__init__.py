"""Generate user elements for Abaqus, in plain C, from the UFL forms of the library."""

from pw_elements.user_element.source import UserElement, generate_user_element

__all__ = ["UserElement", "generate_user_element"]
