"""What the library is compared with. Nothing here uses its code."""
