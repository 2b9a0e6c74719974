"""Mortars of two sides in space that are deformed and slide on each other."""

from pw_elements.contact.interface.mortars.space.mortar import SpaceSlidingMortar
