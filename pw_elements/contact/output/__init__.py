"""States as fields, pictures and files."""

from pw_elements.contact.output.fields import ContactFields
from pw_elements.contact.output.identity import (
    Coefficients,
    Identity,
    ResidualProbe,
    check_changed,
    identify_problem,
    identify_stiffness,
)
from pw_elements.contact.output.pictures import plot
from pw_elements.contact.output.progress import Callback, Progress, ProgressReporter
from pw_elements.contact.output.storage import read_state, write_state
from pw_elements.contact.output.time_series import write
