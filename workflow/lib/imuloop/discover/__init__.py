"""The search for an effect outside the library, and the file that brings it in."""
