"""The JR3 force/torque sensor: driver, card transports, service.

It publishes ``ft`` (``FtPacket``) as ``services.sim`` does: force and torque on the peg in the tool frame, SI units,
1 to 64 samples a packet, the newest last, and the sensor's troubles in ``status``. Tested against its emulator alone:
nothing here has ever run on hardware.
"""
