"""The innermost layer, which imports no other: errors, scalar types, temporary files."""
