"""What the entry points cost where people work: label maps, and loaders with a transform."""
