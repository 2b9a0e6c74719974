"""What a contact computation refuses to return."""

from pw_elements.algebra import SingularSystem


class ContactNotConverged(RuntimeError):
    """No active set satisfies all contact conditions within the iterations allowed."""


class FreeBody(SingularSystem):
    """A rigid motion is held neither by supports nor by contact: never, or no longer."""


class NotUnique(SingularSystem):
    """The tangent of the contact problem is singular although no rigid motion is free."""


class DegenerateMesh(ValueError):
    """Cells without volume, turned inside out, or folded over their neighbours."""
