"""Models of other libraries, read by what they hold; the libraries themselves are not imported here."""
