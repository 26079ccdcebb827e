"""What all studies draw and write: charts and words."""
