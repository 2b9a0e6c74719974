"""Output of contact states as fields, time series, plots and files, and reports of progress."""

from pw_elements.contact.output.fields import ContactFields
from pw_elements.contact.output.identity import (
    ProblemFingerprint,
    ResidualCoefficients,
    ResidualFingerprint,
    check_parts_declared_as_changed,
    fingerprint_mesh_supports_and_pairs,
    fingerprint_stiffness,
)
from pw_elements.contact.output.pictures import plot
from pw_elements.contact.output.progress import Progress, ProgressCallback, ProgressReporter
from pw_elements.contact.output.sides import make_own_and_opposite_surface
from pw_elements.contact.output.storage import check_and_convert_path, read_state, write_state
from pw_elements.contact.output.time_series import write
