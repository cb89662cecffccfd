"""A terminal for a person, or a script, in front of an old controller on a serial line.

Details of VAL II's terminal (echo, line ends, prompts) are not publicly known: each is a setting with the likely value
as default. Nothing here has ever run on hardware.
"""
