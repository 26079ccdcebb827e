"""What all studies draw and write: charts, words, HTML pages."""
