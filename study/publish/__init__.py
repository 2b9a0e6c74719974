"""What readers get: texts, the report and the site."""
