"""What a user would pick instead of the new element: one method a file, on one problem."""
