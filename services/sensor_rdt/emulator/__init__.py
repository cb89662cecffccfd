"""An emulated Net F/T box: records, page, and a panel to disturb it; with arithmetic of its own."""
