"""Models of other libraries, read from their attributes; the libraries themselves are hardly used."""
