"""A floppy drive for an old controller: plain files of a folder, served block by block over a serial line.

The protocol of VAL II's own floppy drive is not publicly known. What is here, TU58's Radial Serial Protocol, is a
STAND-IN, chosen because it is documented and belongs to the same family of computers; protocols are plug-ins
(``protocol.py``). The format of VAL II's directory is not known either; ``layout.py`` is a simple one of our own.
Nothing here has ever run on hardware.
"""
