from pw_elements.files import ForeignEntry as ForeignEntry
from pw_elements.files import check_file_replaceable as check_file_replaceable
from pw_elements.files import claim_folder as claim_folder
from pw_elements.files import remove_file as remove_file
from pw_elements.files import remove_unfinished as remove_unfinished
from pw_elements.files import replace_file as replace_file
from pw_elements.files import replacing_folder as replacing_folder
