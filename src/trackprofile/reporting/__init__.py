"""Results for people: figures, HTML and PDF reports, result files."""
