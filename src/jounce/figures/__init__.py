"""Pictures: curves over time, drawings of robots, the paper's example. Figures are made of data, never of files."""
