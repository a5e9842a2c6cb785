"""Tables of the rows of parts while they are written, and the output that is made of them."""
