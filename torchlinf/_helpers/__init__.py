"""Helpers of all packages: argument checks, threads, boxes, extras, and the rule of what is inside a mask."""
