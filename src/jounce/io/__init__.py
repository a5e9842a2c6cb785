"""What comes in and goes out: robots from files and names, tables of motions and forces."""
