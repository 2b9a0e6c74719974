"""What readers get: texts, report and site, and the command line that makes them."""
