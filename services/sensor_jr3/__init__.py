"""The JR3 force/torque sensor. Not written yet.

It will publish ``ft`` (``FtPacket``) as ``services.sim`` does: force and torque on the peg in the tool frame, SI units,
one packet of 1 to 64 samples at a time, the newest last, and the sensor's troubles in ``status``. Nothing here has
ever run on hardware.
"""
