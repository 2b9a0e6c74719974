"""Methods of contact on one problem, a file each, so that one can be copied without the others."""
