"""What the command `torchlinf` does, a file a command."""
