"""How much noise a mask gets by being turned into its own frame, and what other ways of turning it would give."""
