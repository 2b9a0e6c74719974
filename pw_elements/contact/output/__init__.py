"""States as fields, pictures and files."""

from pw_elements.contact.output.fields import ContactFields, write
from pw_elements.contact.output.pictures import plot
from pw_elements.contact.output.storage import read_state, write_state
