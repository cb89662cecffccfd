"""An emulated controller of a Universal Robots arm: its network ports, with arithmetic of its own."""
