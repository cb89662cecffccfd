"""An emulated controller, for tests and for trying things out without hardware."""
