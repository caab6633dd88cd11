"""What does the complexity of decision regions say about a classifier? `python -m benchmarks.regions_study`."""
