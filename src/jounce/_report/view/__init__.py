"""The live view of a robot in a browser, by viser: `viewer` serves it."""
