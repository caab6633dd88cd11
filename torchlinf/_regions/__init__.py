"""Decision regions of classifiers: their grids and planes, the answers on them, and what their frame counts as."""
