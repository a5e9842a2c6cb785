"""The paper's example: its numbers and its pictures."""
