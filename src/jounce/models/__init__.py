"""Models of other libraries, read by what they hold; the libraries are asked for the meaning of a flag at most."""
