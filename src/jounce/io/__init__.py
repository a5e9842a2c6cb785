"""Input and output: robots from files and names, tables of motions and forces."""
