"""How calls are computed: arguments are checked, and the first backend that accepts a call runs it."""
